#pragma once
// A controller of any mechanism and precision behind one face, and its parameters by name.

#include <array>
#include <memory>
#include <stdexcept>
#include <string>

#define TENODESIS_REAL double
#include "tenodesis/flight_recorder.hpp"
#include "tenodesis/parameters.hpp"
#include "tenodesis/tenodesis.h"

namespace tenodesis::bindings {

inline constexpr int most_axes = TENODESIS_AXES;

template <class P>
struct Field {
  const char* name;
  tenodesis_real P::* member;
};

using AxisParameters = tenodesis_axis_parameters;
using ControlParameters = tenodesis_parameters;

#define TENODESIS_FIELD(type, name) \
  Field<type> { #name, &type::name }
#define AXIS(name) TENODESIS_FIELD(AxisParameters, name)
/// Numbers of an axis, as the C interface calls them.
inline constexpr std::array axis_fields{AXIS(proximal_radius),
                                        AXIS(distal_radius),
                                        AXIS(handle_length),
                                        AXIS(end_effector_length),
                                        AXIS(backbone_length),
                                        AXIS(backbone_rigidity),
                                        AXIS(handle_range),
                                        AXIS(stiffness),
                                        AXIS(pretension),
                                        AXIS(share_sheath),
                                        AXIS(share_handle),
                                        AXIS(share_stem),
                                        AXIS(share_tip),
                                        AXIS(vertex_coefficient),
                                        AXIS(sheath_coefficient),
                                        AXIS(sheath_bend),
                                        AXIS(sheath_bend_rate),
                                        AXIS(spool_radius),
                                        AXIS(drive_speed),
                                        AXIS(drive_acceleration),
                                        AXIS(drive_time_constant),
                                        AXIS(hand_play),
                                        AXIS(sheath_play),
                                        AXIS(play),
                                        AXIS(length_noise),
                                        AXIS(smoothing),
                                        AXIS(friction_scale_std),
                                        AXIS(reference_std),
                                        AXIS(compliance_std),
                                        AXIS(forgetting),
                                        AXIS(slack_tension),
                                        AXIS(gain),
                                        AXIS(breakaway_time),
                                        AXIS(position_gain),
                                        AXIS(dead_band),
                                        AXIS(tendon_speed),
                                        AXIS(common_speed),
                                        AXIS(common_stroke),
                                        AXIS(common_stroke_share),
                                        AXIS(far_lag),
                                        AXIS(patience),
                                        AXIS(settle_time),
                                        AXIS(least_tension),
                                        AXIS(tension_limit),
                                        AXIS(hand_travel),
                                        AXIS(still_time),
                                        AXIS(homing_speed),
                                        AXIS(homing_gain),
                                        AXIS(homing_stroke),
                                        AXIS(homing_overshoot),
                                        AXIS(homing_tolerance),
                                        AXIS(homing_settle_time),
                                        AXIS(homing_time),
                                        AXIS(homing_least_stretch),
                                        AXIS(mean_band),
                                        AXIS(load_cell_range),
                                        AXIS(handle_noise),
                                        AXIS(spool_noise),
                                        AXIS(watch_window)};
#undef AXIS
#define COMMON(name) TENODESIS_FIELD(ControlParameters, name)
/// Numbers that all axes share.
inline constexpr std::array common_fields{COMMON(period),        COMMON(speed_limit),   COMMON(acceleration_limit),
                                          COMMON(engage_time),   COMMON(tension_limit), COMMON(hold_time),
                                          COMMON(neutral_speed), COMMON(relief)};
#undef COMMON
#undef TENODESIS_FIELD
/// Limits of an axis: one per fault, then that of the spools' jumps; threshold and persistence each.
inline constexpr std::size_t limit_count = fault_count + 1;
static_assert(sizeof(AxisParameters) == sizeof(double) * (axis_fields.size() + 2 * limit_count),
              "every number is named");
static_assert(sizeof(ControlParameters) == 10 * sizeof(std::uint32_t) + sizeof(double) * common_fields.size() +
                                               most_axes * sizeof(AxisParameters),
              "every number is named");

using AnyInput = ControlInput<double, most_axes>;
using AnyOutput = ControlOutput<double, most_axes>;

/// What the flight recorder keeps of a tick.
struct Moment {
  std::uint64_t time{};
  OperatingState state{};
  std::uint32_t faults{};
  Measurement<double> measured[most_axes]{};
  double spool_velocity[most_axes][2]{};
  double output_angle[most_axes]{};
};

class AnyController {
 public:
  virtual ~AnyController() = default;
  AnyController() = default;
  AnyController(const AnyController&) = delete;
  AnyController& operator=(const AnyController&) = delete;

  virtual void step(const AnyInput& input, AnyOutput& output) = 0;
  virtual void reset() = 0;
  virtual int axes() const = 0;
  virtual tenodesis_counts counts(int axis) const = 0;
  virtual Phase phase(int axis) const = 0;
  virtual bool watchdog(double since_last_step) const = 0;
  /// Takes another law and actuation on the way; false where it cannot.
  virtual bool choose(ControlLaw /*law*/, Actuation /*actuation*/) { return false; }

  AnyOutput last{};               ///< what the drives were last told
  Request asked{Request::none};   ///< with the next tick of a closed loop
  double passed[most_axes][8]{};  ///< what last went through each place of a closed loop
  // More than the C interface keeps by default, since memory is no matter here: every second tick of the last 200 ms at
  // 2 kHz, the fault, and 10 ms after it.
  static constexpr int stride = 2, after = 10;
  FlightRecorder<Moment, 400 / stride + 1 + after, stride, after> recorder{};
};

template <class A>
class ControllerOf final : public AnyController {
 public:
  using S = A::Scalar;

  explicit ControllerOf(const ControlParameters& parameters) {
    if (!configure(parameters, controller_)) throw std::invalid_argument("the parameters make no controller");
    state_ = controller_.start();
  }

  void step(const AnyInput& input, AnyOutput& output) override {
    ControlInput<S, most_axes> in{};
    in.time = input.time;
    in.request = input.request;
    Moment moment{};
    for (int n = 0; n < most_axes; ++n) {
      const auto& from = input.axis[n];
      in.axis[n] = {S(from.handle_angle),
                    {S(from.tension[0]), S(from.tension[1])},
                    {S(from.spool_angle[0]), S(from.spool_angle[1])}};
      moment.measured[n] = from;
    }
    controller_.step(in, state_, out_);
    output.state = out_.state;
    output.homed = out_.homed;
    output.homing = out_.homing;
    output.faults = out_.faults;
    output.first_faults = out_.first_faults;
    for (int n = 0; n < most_axes; ++n) {
      const auto& from = out_.axis[n];
      auto& to = output.axis[n];
      to.faults = from.faults;
      const auto& e = from.estimate;
      to.estimate = {e.output_angle,  e.output_angle_std, e.tip_force,
                     e.tip_force_std, e.friction_scale,   e.friction_scale_std};
      for (int i = 0; i < 2; ++i) to.spool_velocity[i] = moment.spool_velocity[n][i] = from.spool_velocity[i];
      moment.output_angle[n] = from.estimate.output_angle;
    }
    moment.time = input.time;
    moment.state = output.state;
    moment.faults = output.faults;
    const bool fault = output.state == OperatingState::fault;
    if (!fault && recorder.fault_place() >= 0) recorder.rearm();
    recorder.note(moment, fault);
  }

  void reset() override {
    state_ = controller_.start();
    const ControlOutput<S, most_axes> nothing{};
    out_ = nothing;
    const AnyOutput rest{};
    last = rest;
    asked = Request::none;
    recorder.rearm();
  }

  int axes() const override { return controller_.axes; }

  tenodesis_counts counts(int axis) const override {
    const auto& watch = state_.axis[axis].watch;
    tenodesis_counts counts{};
    for (int n = 0; n < fault_count; ++n) counts.faults[n] = watch.count[n];
    for (int n = 0; n < channel_count; ++n) counts.bad_samples[n] = watch.bad_samples[n];
    counts.late_ticks = watch.late_ticks;
    return counts;
  }

  Phase phase(int axis) const override { return state_.axis[axis].compensator.phase; }

  bool watchdog(double since_last_step) const override {
    return controller_.axis[0].watch.watchdog(S(since_last_step));
  }

  bool choose(ControlLaw law, Actuation actuation) override { return controller_.choose(law, actuation, state_); }

 private:
  Controller<A, most_axes> controller_{};
  ControllerState<S, most_axes> state_{};
  ControlOutput<S, most_axes> out_{};
};

template <class S>
std::unique_ptr<AnyController> make_controller(const ControlParameters& parameters) {
  switch (parameters.joint_type) {
    case TENODESIS_TENDON_GEAR:
      return std::make_unique<ControllerOf<GearAxis<S>>>(parameters);
    case TENODESIS_TENDON_PULLEY:
      return std::make_unique<ControllerOf<PulleyAxis<S>>>(parameters);
    default:
      return std::make_unique<ControllerOf<ContinuumAxis<S>>>(parameters);
  }
}

}  // namespace tenodesis::bindings

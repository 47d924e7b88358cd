#pragma once
// A controller of any mechanism and precision behind one interface, and its parameters by name.

#include <array>
#include <limits>
#include <memory>
#include <stdexcept>

#define TENODESIS_REAL double
#include "fault_injection.hpp"
#include "tenodesis/flight_recorder.hpp"
#include "tenodesis/frame.hpp"
#include "tenodesis/parameters.hpp"
#include "tenodesis/tenodesis.h"

namespace tenodesis::engine {

static_assert(most_axes == TENODESIS_AXES);

using AxisParameters = tenodesis_axis_parameters;
using ControlParameters = tenodesis_parameters;

/// A row of parameter_table.h.
template <class P>
struct TableRow {
  const char* name;
  const char* unit;
  const char* meaning;
  tenodesis_real P::* member;
};

#define TENODESIS_ROW(name, unit, bound, meaning) TableRow<AxisParameters>{#name, unit, meaning, &AxisParameters::name},
inline constexpr std::array axis_parameters{TENODESIS_AXIS_PARAMETERS(TENODESIS_ROW)};
#undef TENODESIS_ROW
#define TENODESIS_ROW(name, unit, bound, meaning) \
  TableRow<ControlParameters>{#name, unit, meaning, &ControlParameters::name},
inline constexpr std::array common_parameters{TENODESIS_COMMON_PARAMETERS(TENODESIS_ROW)};
#undef TENODESIS_ROW

/// Limits of an axis: one per fault, then that of the spools' jumps; threshold and persistence each.
inline constexpr std::size_t limit_count = fault_count + 1;

/// The same parameters as a board takes them.
inline link::ControllerParameters in_single_precision(const ControlParameters& p) {
  link::ControllerParameters to{};
#define TENODESIS_COPY(name, meaning) to.name = p.name;
  TENODESIS_CHOICES(TENODESIS_COPY)
#undef TENODESIS_COPY
#define TENODESIS_COPY(name, unit, bound, meaning) to.name = float(p.name);
  TENODESIS_COMMON_PARAMETERS(TENODESIS_COPY)
#undef TENODESIS_COPY
  to.size = sizeof to;
  for (int n = 0; n < most_axes; ++n) {
    const AxisParameters& axis = p.axis[n];
    link::ControllerParameters::Axis& to_axis = to.axis[n];
#define TENODESIS_COPY(name, unit, bound, meaning) to_axis.name = float(axis.name);
    TENODESIS_AXIS_PARAMETERS(TENODESIS_COPY)
#undef TENODESIS_COPY
    to_axis.spool_jump = {float(axis.spool_jump.threshold), float(axis.spool_jump.persistence)};
    for (int k = 0; k < fault_count; ++k)
      to_axis.limit[k] = {float(axis.limit[k].threshold), float(axis.limit[k].persistence)};
  }
  return to;
}

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
  /// As a board takes them, in single precision.
  virtual const link::ControllerParameters& parameters() const = 0;
  virtual tenodesis_counts counts(int axis) const = 0;
  virtual Phase phase(int axis) const = 0;
  /// How far the motors hold the tip from where it would be with their spools at home, rad; NaN where not known.
  virtual double wound(int /*axis*/) const { return std::numeric_limits<double>::quiet_NaN(); }
  virtual bool watchdog(double since_last_step) const = 0;
  /// Keeps stopped motors where they are, rather than let them return.
  virtual void hold() {}
  /// Changes law and actuation while it runs; false where it cannot.
  virtual bool choose(ControlLaw /*law*/, Actuation /*actuation*/) { return false; }

  AnyOutput last{};                ///< what the drives were last sent
  Request request{Request::none};  ///< to be made with the next tick of a closed loop
  FaultInjector injector{};
  double cut_demanded{};  ///< for which it has demanded that the motors' supply be cut, s
  // More than the C interface keeps by default, since memory is plentiful here: every second tick of the last 200 ms at
  // 2 kHz, the fault, and 10 ms after it.
  static constexpr int stride = 2, after = 10;
  FlightRecorder<Moment, 400 / stride + 1 + after, stride, after> recorder{};

 protected:
  /// Hands a tick to the flight recorder, which starts again after a fault has been cleared.
  void record(const AnyInput& input, const AnyOutput& output) {
    Moment moment{input.time, output.state, output.faults, {}, {}, {}};
    for (int n = 0; n < most_axes; ++n) {
      moment.measured[n] = input.axis[n];
      for (int i = 0; i < 2; ++i) moment.spool_velocity[n][i] = output.axis[n].spool_velocity[i];
      moment.output_angle[n] = output.axis[n].estimate.output_angle;
    }
    const bool fault = output.state == OperatingState::fault;
    if (!fault && recorder.fault_place() >= 0) recorder.rearm();
    recorder.note(moment, fault);
  }

  void forget() {
    const AnyOutput rest{};
    last = rest;
    request = Request::none;
    recorder.rearm();
  }
};

template <class A>
class ControllerOf final : public AnyController {
 public:
  using S = A::Scalar;

  explicit ControllerOf(const ControlParameters& parameters) : parameters_(in_single_precision(parameters)) {
    if (!configure(parameters, controller_)) throw std::invalid_argument("the parameters make no controller");
    state_ = controller_.start();
  }

  void step(const AnyInput& input, AnyOutput& output) override {
    ControlInput<S, most_axes> in{};
    in.time = input.time;
    in.request = input.request;
    for (int n = 0; n < most_axes; ++n) in.axis[n] = measurement_as<Measurement<S>>(input.axis[n]);
    controller_.step(in, state_, out_);
    output.state = out_.state;
    output.homed = out_.homed;
    output.homing = out_.homing;
    output.cut_power = out_.cut_power;
    output.faults = out_.faults;
    output.first_faults = out_.first_faults;
    for (int n = 0; n < most_axes; ++n) {
      const auto& from = out_.axis[n];
      output.axis[n] = {{from.spool_velocity[0], from.spool_velocity[1]},
                        estimate_as<Estimate<double>>(from.estimate),
                        from.faults,
                        from.homing_failure};
    }
    record(input, output);
  }

  void reset() override {
    state_ = controller_.start();
    const ControlOutput<S, most_axes> nothing{};
    out_ = nothing;
    forget();
  }

  int axes() const override { return controller_.axes; }
  const link::ControllerParameters& parameters() const override { return parameters_; }

  tenodesis_counts counts(int axis) const override {
    const auto& watch = state_.axis[axis].watch;
    tenodesis_counts counts{};
    for (int n = 0; n < fault_count; ++n) counts.faults[n] = watch.count[n];
    for (int n = 0; n < channel_count; ++n) counts.bad_samples[n] = watch.bad_samples[n];
    counts.late_ticks = watch.late_ticks;
    return counts;
  }

  Phase phase(int axis) const override { return state_.axis[axis].compensator.shown(); }

  double wound(int axis) const override { return double(controller_.axis[axis].wound(state_.axis[axis])); }

  bool watchdog(double since_last_step) const override {
    return controller_.axis[0].watch.watchdog(S(since_last_step));
  }

  void hold() override {
    for (int n = 0; n < controller_.count(); ++n) state_.axis[n].command.kept = true;
  }

  bool choose(ControlLaw law, Actuation actuation) override { return controller_.choose(law, actuation, state_); }

 private:
  link::ControllerParameters parameters_;
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

/// Signals that a controller adds to a run, per axis.
inline constexpr std::array control_signal_names{"estimated_output_angle",
                                                 "estimated_output_angle_std",
                                                 "estimated_force",
                                                 "estimated_force_std",
                                                 "friction_scale",
                                                 "friction_scale_std",
                                                 "commanded_spool_velocity.agonist",
                                                 "commanded_spool_velocity.antagonist",
                                                 "operating_state",
                                                 "faults",
                                                 "phase",
                                                 "homing_failure"};
inline constexpr std::size_t control_signal_count = control_signal_names.size();
using ControlSignals = std::array<double, control_signal_count>;

inline ControlSignals control_signals(const AnyController& controller, std::size_t n) {
  const AnyOutput& output = controller.last;
  const auto& axis = output.axis[n];
  const auto& e = axis.estimate;
  return {e.output_angle,
          e.output_angle_std,
          e.tip_force,
          e.tip_force_std,
          e.friction_scale,
          e.friction_scale_std,
          axis.spool_velocity[0],
          axis.spool_velocity[1],
          double(output.state),
          double(output.faults),
          double(controller.phase(int(n))),
          double(axis.homing_failure.word())};
}

}  // namespace tenodesis::engine

#pragma once
// The controller under test, in float: that of one axis of the scaled-up instrument, with the parameters that
// `tenodesis export controller` has written.

#include "scaled_up.h"
#include "tenodesis/parameters.hpp"

static_assert(sizeof(tenodesis_real) == sizeof(float));

namespace instrument {

using Input = tenodesis_measurement;

/// Only words, without padding, so that outputs can be compared bit by bit.
struct Output {
  tenodesis_axis_output axis{};
  std::uint32_t state{}, homed{}, homing{}, faults{}, first_faults{};
};

/// The header-only controller, of this mechanism alone.
class Direct {
 public:
  Direct() : ready_(configure(scaled_up, controller_)), state_(controller_.start()) {}

  bool ready() const { return ready_; }

  /// One tick, enabled by the first. Not inlined, so that its instructions can be counted separately.
  [[gnu::noinline]] Output step(const Input& measured) {
    using enum tenodesis::Request;
    Controller::Output got;
    controller_.step({.request = state_.started ? none : enable,
                      .axis = {tenodesis::measurement_as<tenodesis::Measurement<float>>(measured)}},
                     state_, got);
    const auto& axis = got.axis[0];
    const auto& estimate = axis.estimate;
    return {{{axis.spool_velocity[0], axis.spool_velocity[1]},
             estimate.output_angle,
             estimate.output_angle_std,
             estimate.tip_force,
             estimate.tip_force_std,
             estimate.friction_scale,
             estimate.friction_scale_std,
             axis.faults,
             axis.homing_failure.word()},
            static_cast<std::uint32_t>(got.state),
            got.homed,
            got.homing,
            got.faults,
            got.first_faults};
  }

 private:
  using Controller = tenodesis::Controller<tenodesis::GearAxis<float>>;

  Controller controller_{};
  bool ready_;
  Controller::State state_;
};

/// The same through the C interface, which chooses among mechanisms and has a flight recorder; with so many axes, all
/// like the first and with its measurements.
template <unsigned axes>
class ThroughInterface {
 public:
  ThroughInterface() {
    tenodesis_parameters parameters = scaled_up;
    parameters.axes = axes;
    for (unsigned n = 1; n < axes; ++n) parameters.axis[n] = parameters.axis[0];
    ready_ = tenodesis_init(&controller_, &parameters) == TENODESIS_OK;
  }

  bool ready() const { return ready_; }

  [[gnu::noinline]] Output step(const Input& measured) {
    tenodesis_input input{};
    input.request = started_ ? TENODESIS_REQUEST_NONE : TENODESIS_REQUEST_ENABLE;
    for (unsigned n = 0; n < axes; ++n) input.axis[n] = measured;
    started_ = true;
    tenodesis_output got;
    tenodesis_step(&controller_, &input, &got);
    return {got.axis[0], got.state, got.homed, got.homing, got.faults, got.first_faults};
  }

 private:
  tenodesis_controller controller_;
  bool ready_;
  bool started_{};
};

using ThroughC = ThroughInterface<1>;
using TwoAxes = ThroughInterface<2>;

}  // namespace instrument

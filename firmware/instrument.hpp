#pragma once
// The controller under test, in float: that of one axis of the scaled-up instrument. What feeds it, on the PC and on
// the microcontroller, knows no more of it than this file says.

#include "tenodesis/controller.hpp"

namespace instrument {

using Axis = tenodesis::GearAxis<float>;
using Input = tenodesis::Measurement<float>;

inline constexpr float tick = 5e-4f;  ///< s

using Controller = tenodesis::Controller<Axis>;
using State = Controller::State;

/// Words only, without padding between them, so that two outputs can be compared bit by bit.
struct Output {
  tenodesis::AxisOutput<float> axis{};
  std::uint32_t state{}, homed{}, homing{}, faults{}, first_faults{};
};

constexpr float degrees(float angle) { return angle * float(tenodesis::pi / 180); }

inline constexpr Axis axis{
    .proximal = {.radius = 16.875e-3f, .length = 0.160f},
    .distal = {.radius = 7.5e-3f, .length = 0.086f},
    .stiffness = tenodesis::tendon_stiffness(50e9f, 0.54e-3f, 1.f) * 0.85f,
    .pretension = 25,
    .handle_range = degrees(45),
};

// A tendon of 1 m: half of the 0.16 m in the handle lie before its joint, each joint has the span of its two gears.
inline constexpr tenodesis::ControlModel<Axis> model{
    .axis = axis,
    .spool_radius = 5e-3f,
    .share = {0.08f, 0.11375f, 0.79125f, 0.015f},
    .vertex = 0.1f,
    .sheath = 0.1f,
    .sheath_bend = degrees(10),
};

// Stretch by two fifths of the pretension, m.
inline constexpr float stroke = 0.4f * axis.pretension / axis.stiffness;

inline constexpr tenodesis::FrictionObserver<Axis> observer{
    model,
    {.hand_play = degrees(0.06f),
     .sheath_play = 3e-6f,
     .length_noise = 20e-6f,
     .play = 10e-6f,
     .smoothing = 3e-3f,
     .scale_std = 0.4f,
     .reference_std = 5e-6f,
     .compliance_std = 0.05f,
     .forgetting = 0.05f,
     .slack_below = 0.25f},
};

inline constexpr tenodesis::Compensator<Axis> compensator{
    model,
    {.gain = 12,
     .breakaway_time = 0.025f,
     .position_gain = 50,
     .dead_band = degrees(0.1f),
     .speed = 0.05f,
     .common_speed = 4 * stroke,
     .common_stroke = stroke,
     .stroke_share = 0.4f,
     .far = 15,
     .patience = 0.3f,
     .least_tension = 0.15f * axis.pretension,
     .tension_limit = 80,
     .hand_travel = degrees(0.3f),
     .still_time = 0.1f},
    tenodesis::ControlLaw::robust,
};

constexpr tenodesis::Watch<float> watch() {
  using tenodesis::Fault;
  tenodesis::Watch<float> watch{
      .spool_jump = {60, 1.2f * tick},
      .drive = {model.spool_radius, 20, 400, 0.010f, 0},
      .pretension = axis.pretension,
      .stiffness = axis.stiffness,
      .mean_band = 0.35f,
      .load_cell_range = 200,
      .handle_range = axis.handle_range,
      .handle_noise = 0.01f,
      .spool_noise = degrees(0.22f),
      .window = 0.1f,
      .period = tick,
  };
  const auto limit = [&](Fault fault, float threshold, float persistence) {
    watch.limit[static_cast<int>(fault)] = {threshold, persistence};
  };
  limit(Fault::tendon_break, 2, 0.010f);
  limit(Fault::tendon_slack, 1, 2);
  limit(Fault::over_tension, 100, 0.003f);
  limit(Fault::load_cell_stuck, 0.01f, 0.040f);
  limit(Fault::load_cell_range, 2, 0.005f);
  limit(Fault::load_cell_drift, 2.5f, 0.5f);
  limit(Fault::encoder_dropout, 0.1f, 0.005f);
  limit(Fault::encoder_jump, 30, 1.2f * tick);
  limit(Fault::spool_slip, 3, 0.010f);
  limit(Fault::motor_not_following, 0.008f, 0.005f);
  limit(Fault::tick_late, 0.025f, 0);
  return watch;
}

inline constexpr Controller controller{
    .axis = {{.friction = observer, .compensator = compensator, .homing = {model, {}}, .watch = watch()}},
    .supervisor = {.speed_limit = 20,
                   .acceleration_limit = 400,
                   .engage_time = 0.2f,
                   .tension_limit = 100,
                   .hold_time = 0.5f,
                   .neutral_speed = 0.2f,
                   .relief = 0.2f,
                   .period = tick},
    .own_clock = true,
    .homed = true,
};

inline State start() { return controller.start(); }

/// One tick of the controller, enabled by the first. Not inlined, so that its instructions can be told from its
/// surroundings'.
[[gnu::noinline]] inline Output step(const Input& measured, State& state) {
  using enum tenodesis::Request;
  Controller::Output got;
  controller.step({.request = state.started ? none : enable, .axis = {measured}}, state, got);
  return {got.axis[0], static_cast<std::uint32_t>(got.state), got.homed, got.homing, got.faults, got.first_faults};
}

/// What the motors are asked for, rad/s; positive winds.
inline float spool_velocity(const Output& output, int tendon) { return output.axis.spool_velocity[tendon]; }

}  // namespace instrument

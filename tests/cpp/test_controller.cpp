// Claims about the compensators and the controller: what each law gives back, on theory's own plant and on the twin,
// what never reaches a motor, and that precision, number of axes and side make no difference.

#define TENODESIS_REAL double
#include "tenodesis/controller.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "claim.hpp"
#include "instruments.hpp"
#include "tenodesis/parameters.hpp"
#include "tenodesis/tenodesis.h"
#include "tenodesis/twin.hpp"

using namespace tenodesis;

constexpr double degree = pi / 180;
constexpr double dt = 5e-4;               // s
constexpr double spool_radius = 5e-3;     // m
constexpr double counts = 2 * pi / 4096;  // of an encoder, rad
constexpr std::uint64_t tick = 500'000;   // ns

/// Numbers that suit the paper's instruments and those of their size.
template <class A>
tenodesis_axis_parameters axis_parameters(const A& axis) {
  const double stretch = axis.pretension / axis.stiffness;
  tenodesis_axis_parameters p{};
  p.proximal_radius = axis.proximal.radius;
  p.distal_radius = axis.distal.radius;
  p.handle_length = axis.proximal.length;
  p.end_effector_length = axis.distal.length;
  if constexpr (requires { axis.distal.backbone_length; }) {
    p.backbone_length = axis.distal.backbone_length;
    p.backbone_rigidity = axis.distal.backbone_rigidity;
  }
  p.handle_range = axis.handle_range;
  p.stiffness = axis.stiffness;
  p.pretension = axis.pretension;
  p.share_sheath = 0.08, p.share_handle = 0.11, p.share_stem = 0.795, p.share_tip = 0.015;
  p.vertex_coefficient = p.sheath_coefficient = 0.1;
  p.sheath_bend = 10 * degree;
  p.spool_radius = spool_radius;
  p.drive_speed = 20, p.drive_acceleration = 400, p.drive_time_constant = 0.01;
  p.hand_play = 0.7 * counts;
  p.sheath_play = 3e-6;
  p.play = std::max(0.4 * axis.proximal.radius, spool_radius) * counts;
  p.length_noise = 2 * spool_radius * counts;
  p.smoothing = 3e-3;
  p.friction_scale_std = 0.4, p.reference_std = 5e-6, p.compliance_std = 0.25, p.forgetting = 0.05;
  p.slack_tension = 0.3;
  p.gain = 12, p.breakaway_time = 0.025, p.position_gain = 4;
  p.dead_band = 0.1 * degree;
  p.tendon_speed = 0.05;
  p.common_stroke = 0.4 * stretch, p.common_speed = 1.6 * stretch, p.common_stroke_share = 0.4;
  p.far_lag = 15, p.patience = 0.3;
  p.least_tension = 0.15 * axis.pretension;
  p.tension_limit = 80;
  p.hand_travel = 3.5 * counts, p.still_time = 0.1;
  p.homing_speed = 5e-3, p.homing_gain = 8, p.homing_stroke = 0.03, p.homing_overshoot = 0.15;
  p.homing_tolerance = 4e-3, p.homing_settle_time = 0.1, p.homing_time = 16, p.homing_least_stretch = 0.4;
  p.mean_band = 0.45, p.load_cell_range = 200, p.handle_noise = 6 * counts, p.spool_noise = 2.5 * counts;
  p.watch_window = 0.1;
  p.spool_jump = {60, 1.2 * dt};
  const auto set = [&](Fault fault, double threshold, double persistence) {
    p.limit[static_cast<int>(fault)] = {threshold, persistence};
  };
  set(Fault::tendon_break, 0.08 * axis.pretension, 0.01);
  set(Fault::tendon_slack, 0.04 * axis.pretension, 2);
  set(Fault::over_tension, 100, 0.003);
  set(Fault::load_cell_stuck, 0.009, 0.04);
  set(Fault::load_cell_range, 2, 0.005);
  set(Fault::load_cell_drift, 0.1 * axis.pretension, 0.5);
  set(Fault::encoder_dropout, 0.1, 0.005);
  set(Fault::encoder_jump, 30, 1.2 * dt);
  set(Fault::spool_slip, 0.12 * axis.pretension, 0.01);
  set(Fault::motor_not_following, 0.008, 0.005);
  set(Fault::tick_late, 0.025, 0);
  return p;
}

template <class A>
tenodesis_parameters parameters(const A& axis, ControlLaw law, Actuation actuation, int axes = 1) {
  tenodesis_parameters p{};
  p.size = sizeof p;
  p.version = TENODESIS_VERSION;
  p.axes = static_cast<std::uint32_t>(axes);
  p.observer = TENODESIS_OBSERVER_FRICTION;
  p.law = static_cast<std::uint32_t>(law);
  p.actuation = static_cast<std::uint32_t>(actuation);
  p.homed = 1;
  p.period = dt;
  p.speed_limit = 20, p.acceleration_limit = 400, p.engage_time = 0.2, p.tension_limit = 100;
  p.hold_time = 0.5, p.neutral_speed = 0.2, p.relief = 0.2;
  for (int n = 0; n < axes; ++n) p.axis[n] = axis_parameters(axis);
  return p;
}

template <class A>
using As = A::template Rebind<float>;

template <class A, int most_axes = 1>
Controller<A, most_axes> controller(const tenodesis_parameters& p) {
  Controller<A, most_axes> made{};
  CLAIM(configure(p, made));
  return made;
}

constexpr ControlLaw every_law[] = {ControlLaw::off, ControlLaw::paper, ControlLaw::paper_feedback, ControlLaw::exact,
                                    ControlLaw::robust};
constexpr Actuation every_actuation[] = {Actuation::agonist, Actuation::differential};

// ---- parameters

void a_number_that_is_none_makes_no_controller() {
  const auto axis = instruments::scaled_up<double>();
  const auto good = parameters(axis, ControlLaw::robust, Actuation::differential);
  Controller<GearAxis<double>> made{};
  CLAIM(configure(good, made));
  constexpr auto first = offsetof(tenodesis_parameters, period) / sizeof(double);
  constexpr auto numbers = (sizeof(tenodesis_parameters) - sizeof(tenodesis_axis_parameters)) / sizeof(double);
  for (auto at = first; at < numbers; ++at) {
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), -1.0}) {
      double raw[sizeof good / sizeof(double)];
      std::memcpy(raw, &good, sizeof good);
      raw[at] = bad;
      tenodesis_parameters changed{};
      std::memcpy(&changed, raw, sizeof changed);
      const bool made_of_it = configure(changed, made);
      CLAIM(!made_of_it);
      if (made_of_it) std::printf("    number %zu: %g\n", at, bad);
    }
  }
}

void a_choice_that_there_is_not_makes_no_controller() {
  const auto axis = instruments::scaled_up<double>();
  Controller<GearAxis<double>> made{};
  const auto refuses = [&](std::uint32_t tenodesis_parameters::* choice, std::uint32_t value) {
    auto p = parameters(axis, ControlLaw::robust, Actuation::differential);
    p.*choice = value;
    CLAIM(!configure(p, made));
  };
  refuses(&tenodesis_parameters::axes, 0);
  refuses(&tenodesis_parameters::axes, 2);
  refuses(&tenodesis_parameters::observer, 3);
  refuses(&tenodesis_parameters::law, 5);
  refuses(&tenodesis_parameters::actuation, 2);
  refuses(&tenodesis_parameters::safe_state, 2);
  refuses(&tenodesis_parameters::own_clock, 2);
  refuses(&tenodesis_parameters::homed, 2);
}

// ---- laws on the plant of theory

/// How far a law lets a tip lag behind where tendons that do not stretch would hold it.
struct Settled {
  double loss{};     // in the mechanism's coordinate, without compensation
  double after{};    // with it
  double stretch{};  // what the tensions then stretch, in that coordinate
};

// Statics for a plant, spools that turn as they are told.
template <class A>
Settled settle(const A& axis, double handle, double force, ControlLaw law, Actuation actuation) {
  using S = A::Scalar;
  auto p = parameters(axis, law, actuation);
  p.axis[0].dead_band = 1e-7;
  p.axis[0].tension_limit = 1e4;
  const auto one = detail::axis_controller<A>(p.axis[0]);
  Compensator<A> compensator = one.compensator;
  compensator.law = law;
  compensator.actuation = actuation;
  const Load<S> load{S(force), S(0)};
  const auto model = one.model();
  const S free = model.drawn(S(handle)) / axis.distal.excursion_slope();
  Stroke<S> wound{};
  Settled found{};
  FrictionMemory<S> memory{};
  CompensatorState<S> state{};
  for (int n = 0; n < 8000; ++n) {
    const auto angle = output_angle(axis, S(handle), load, wound);
    const auto tension = tensions(axis, S(handle), load, wound);
    CLAIM(angle.status == Status::ok);
    if (angle.status != Status::ok) return found;
    const auto loss = double(free - axis.distal.coordinate(angle.value));
    if (n == 0) found.loss = loss;
    found.after = loss;
    found.stretch = double(tension.value.difference() / (S(2) * axis.stiffness * axis.distal.excursion_slope()));
    const Measurement<S> measured{S(handle),
                                  {tension.value.agonist, tension.value.antagonist},
                                  {wound.agonist / S(spool_radius), wound.antagonist / S(spool_radius)}};
    const Winding<S> speed = compensator.wind(measured, one.friction, memory, S(dt), state);
    wound.agonist = wound.agonist + speed.agonist * S(dt);
    wound.antagonist = wound.antagonist + speed.antagonist * S(dt);
  }
  return found;
}

template <class S>
constexpr double of_loss = sizeof(S) == 4 ? 2e-3 : 1e-4;

// Care point 1: handle motion moves both tendons, one motor moves one.
template <class A>
void eq_22_with_one_motor_leaves_half_the_loss_and_with_both_nothing(const A& axis) {
  using S = A::Scalar;
  const double slack = double(slack_force(axis, S(0)).value);
  for (const double handle : {-0.2, 0.0, 0.3}) {
    for (const double share : {-0.3, 0.3}) {
      const auto one = settle(axis, handle, share * slack, ControlLaw::paper, Actuation::agonist);
      const auto both = settle(axis, handle, share * slack, ControlLaw::paper, Actuation::differential);
      CLAIM_NEAR(one.after / one.stretch, 0.5, of_loss<S>);
      CLAIM_NEAR(both.after / both.loss, 0, of_loss<S>);
    }
  }
}

// What one motor cannot hold is the agonist's: no stroke of it pushes.
template <class A>
void exact_gives_all_back_with_one_motor_or_two_slack_included(const A& axis) {
  using S = A::Scalar;
  const double slack = double(slack_force(axis, S(0)).value);
  for (const double share : {-0.4, 0.5, 1.3}) {
    for (const auto actuation : every_actuation) {
      if (share > 1 && axis.distal.folds() && actuation == Actuation::agonist) continue;
      const auto found = settle(axis, 0.0, share * slack, ControlLaw::exact, actuation);
      CLAIM_NEAR(found.after / found.loss, 0, 3 * of_loss<S>);
    }
  }
}

template <class A>
void off_moves_nothing(const A& axis) {
  const auto found = settle(axis, 0.2, 0.3, ControlLaw::off, Actuation::differential);
  CLAIM(found.after == found.loss);
}

// ---- what never reaches a motor

/// A memory as after any readings.
template <class S, class Random>
Measurement<S> any_reading(Random& random, double handle_range) {
  std::uniform_real_distribution<double> any(0, 1);
  const auto angle = [&] { return S(2 * any(random) - 1); };
  return {S(handle_range * (2 * any(random) - 1)), {S(100 * any(random)), S(100 * any(random))}, {angle(), angle()}};
}

template <class A>
void no_law_winds_a_tendon_at_its_limit_or_faster_than_it_may(const A& axis) {
  using S = A::Scalar;
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  for (const auto law : every_law) {
    for (const auto actuation : every_actuation) {
      const auto p = parameters(axis, law, actuation);
      auto one = detail::axis_controller<A>(p.axis[0]);
      one.compensator.law = law;
      one.compensator.actuation = actuation;
      FrictionMemory<S> memory{};
      CompensatorState<S> state{};
      for (int n = 0; n < 4000; ++n) {
        const auto measured = any_reading<S>(random, double(axis.handle_range));
        one.friction.update(measured, S(dt), memory);
        const Winding<S> speed = one.compensator.wind(measured, one.friction, memory, S(dt), state);
        const S by[2] = {speed.agonist, speed.antagonist};
        for (int i = 0; i < 2; ++i) {
          CLAIM(is_finite(by[i]) && abs(by[i]) <= S(2 * p.axis[0].tendon_speed));
          CLAIM(!(measured.tension[i] >= S(p.axis[0].tension_limit)) || by[i] <= S(0));
        }
        CLAIM(actuation == Actuation::differential || speed.antagonist == S(0));
      }
    }
  }
}

// ---- the closed loop on the twin

using Plant = Twin<GearAxis<double>, Contacts<3>, Capstan<double>>;

Plant plant(const GearAxis<double>& axis, double friction, bool noisy = true) {
  Plant twin{};
  twin.axis = axis;
  const auto p = axis_parameters(axis);
  const double share[4] = {p.share_sheath, p.share_handle, p.share_stem, p.share_tip};
  for (int n = 0; n < 4; ++n) twin.tendon.stiffness[n] = axis.stiffness / share[n];
  twin.tendon.rest_tension = axis.pretension;
  twin.friction = {friction, friction, p.sheath_bend, 0, 0};
  const double inertia = axis.distal.radius > 5e-3 ? 4e-4 : 4e-6, damping = axis.distal.radius > 5e-3 ? 9e-3 : 4e-4;
  twin.body = {inertia, damping, 1.86, 20};
  twin.drive = {spool_radius, 20, 400, 0.01, 0};
  twin.rig = {0.015, axis.distal.rig_arm()};
  const Sensor<double> encoder{1, 0, noisy ? 5.2e-4 : 0, -pi, pi, counts};
  const Sensor<double> cell{1, 0, noisy ? 0.03 : 0, -200, 200, 0.0061};
  twin.sensors = {encoder, encoder, {cell, cell}, {1, 0, 0, -1e3, 1e3, counts}};
  twin.time_step = dt;
  twin.steps_per_sample = 1;
  return twin;
}

template <class S>
Measurement<S> as(const Measurement<double>& m) {
  return {S(m.handle_angle), {S(m.tension[0]), S(m.tension[1])}, {S(m.spool_angle[0]), S(m.spool_angle[1])}};
}

/// Bends the handle in 1.5 s, loads the tip after 3 s, and turns the handle back after 7 s.
struct Script {
  double handle{0.25}, force{};

  double handle_at(double time) const {
    const auto ease = [](double u) {
      const double s = std::clamp(u, 0.0, 1.0);
      return s * s * s * (10 - 15 * s + 6 * s * s);
    };
    return handle * (ease(time / 1.5) - 0.5 * ease((time - 7) / 1.5));
  }
  double force_at(double time) const { return time > 3 ? force : 0; }
};

struct Trace {
  std::vector<Measurement<double>> read;
  std::vector<double> tip, estimate, deviation, velocity[2], tension[2];
  OperatingState state{};
  double target{};  // rad
};

template <class S>
Trace close_loop(const GearAxis<double>& axis, const Script& script, double friction, std::uint64_t seed,
                 ControlLaw law = ControlLaw::robust, Actuation actuation = Actuation::differential,
                 double duration = 11) {
  const auto made = controller<GearAxis<S>>(parameters(axis, law, actuation));
  auto state = made.start();
  const Plant twin = plant(axis, friction);
  auto bench = twin.rest(seed);
  Trace trace{};
  for (int n = 0; n < int(duration / dt); ++n) {
    const Measurement<double> read{bench.reading.handle_angle,
                                   {bench.reading.tension[0], bench.reading.tension[1]},
                                   {bench.reading.spool_angle[0], bench.reading.spool_angle[1]}};
    ControlInput<S, 1> input{tick * std::uint64_t(n + 1), n == 0 ? Request::enable : Request::none, {as<S>(read)}};
    ControlOutput<S, 1> output{};
    trace.state = made.step(input, state, output);
    Command<double> command{};
    command.handle_angle = script.handle_at(n * dt);
    command.force = script.force_at(n * dt);
    for (int i = 0; i < 2; ++i) {
      command.spool_velocity[i] = double(output.axis[0].spool_velocity[i]);
      trace.velocity[i].push_back(command.spool_velocity[i]);
      trace.tension[i].push_back(bench.tendon[i].tension[0]);
    }
    trace.read.push_back(read);
    trace.tip.push_back(bench.output_angle);
    trace.estimate.push_back(double(output.axis[0].estimate.output_angle));
    trace.deviation.push_back(double(output.axis[0].estimate.output_angle_std));
    const Status found = twin.step(command, bench);
    CLAIM(found == Status::ok);
    if (found != Status::ok) return trace;
  }
  const auto model = detail::control_model<GearAxis<double>>(axis_parameters(axis));
  trace.target = axis.distal.angle(model.drawn(script.handle_at(duration)) / axis.distal.excursion_slope());
  return trace;
}

double load_for(const GearAxis<double>& axis) { return 0.35 * slack_force(axis, 0.0).value; }

template <class S>
void robust_gives_the_angle_back_whatever_friction_it_was_told() {
  for (const auto& axis : {instruments::scaled_up<double>(), instruments::real_size<double>()}) {
    for (const double friction : {0.07, 0.1, 0.143}) {
      for (const double sign : {1.0, -1.0}) {
        const Script script{sign * 0.25, sign * load_for(axis)};
        const Trace trace = close_loop<S>(axis, script, friction, 1);
        CLAIM(trace.state == OperatingState::enabled);
        CLAIM_NEAR(trace.tip.back(), trace.target, 0.5 * degree);
        CLAIM(std::fabs(trace.estimate.back() - trace.tip.back()) < 3 * trace.deviation.back());
        for (const auto& velocity : trace.velocity)
          for (std::size_t n = 1; n < trace.tip.size(); ++n)
            CLAIM(std::fabs(velocity[n] - velocity[n - 1]) <= 400 * dt * (1 + 1e-5));
      }
    }
  }
}

// One recording, two precisions. In a loop of its own each goes its own way within the dead band.
void float_and_double_say_the_same_of_one_recording() {
  for (const auto& axis : {instruments::scaled_up<double>(), instruments::real_size<double>()}) {
    const auto p = parameters(axis, ControlLaw::robust, Actuation::differential);
    const Trace trace = close_loop<double>(axis, {0.25, load_for(axis)}, 0.1, 1);
    const auto made = controller<GearAxis<float>>(p);
    auto state = made.start();
    double apart = 0, faster = 0;
    for (std::size_t n = 0; n < trace.read.size(); ++n) {
      ControlInput<float, 1> input{
          tick * (n + 1), n == 0 ? Request::enable : Request::none, {as<float>(trace.read[n])}};
      ControlOutput<float, 1> output{};
      made.step(input, state, output);
      apart = std::max(apart, std::fabs(double(output.axis[0].estimate.output_angle) - trace.estimate[n]));
      for (int i = 0; i < 2; ++i)
        faster = std::max(faster, std::fabs(double(output.axis[0].spool_velocity[i]) - trace.velocity[i][n]));
    }
    CLAIM(apart < 0.002 * degree);
    CLAIM(faster < 0.02);
  }
}

// Flexion and extension are alike: mirrored readings, mirrored answer.
template <class S>
void a_mirrored_recording_gets_the_mirrored_answer() {
  const auto axis = instruments::scaled_up<double>();
  for (const auto law : every_law) {
    const auto p = parameters(axis, law, Actuation::differential);
    const Trace trace = close_loop<S>(axis, {0.25, load_for(axis)}, 0.1, 2, law);
    const auto made = controller<GearAxis<S>>(p);
    auto state = made.start();
    double apart = 0;
    for (std::size_t n = 0; n < trace.read.size(); ++n) {
      const auto& m = trace.read[n];
      const Measurement<S> mirrored{
          S(-m.handle_angle), {S(m.tension[1]), S(m.tension[0])}, {S(m.spool_angle[1]), S(m.spool_angle[0])}};
      ControlInput<S, 1> input{tick * (n + 1), n == 0 ? Request::enable : Request::none, {mirrored}};
      ControlOutput<S, 1> output{};
      made.step(input, state, output);
      for (int i = 0; i < 2; ++i)
        apart = std::max(apart, std::fabs(double(output.axis[0].spool_velocity[i]) - trace.velocity[1 - i][n]));
    }
    CLAIM_NEAR(apart, 0, sizeof(S) == 4 ? 1e-3 : 1e-10);
  }
}

// ---- the controller as such

template <class S>
using Bits = std::conditional_t<sizeof(S) == 4, std::uint32_t, std::uint64_t>;

template <class S>
bool same(const AxisOutput<S>& a, const AxisOutput<S>& b) {
  const auto equal = [](const S& x, const S& y) { return std::bit_cast<Bits<S>>(x) == std::bit_cast<Bits<S>>(y); };
  return equal(a.spool_velocity[0], b.spool_velocity[0]) && equal(a.spool_velocity[1], b.spool_velocity[1]) &&
         equal(a.estimate.output_angle, b.estimate.output_angle) && equal(a.estimate.tip_force, b.estimate.tip_force) &&
         equal(a.estimate.output_angle_std, b.estimate.output_angle_std) &&
         equal(a.estimate.friction_scale, b.estimate.friction_scale) && a.faults == b.faults;
}

// Bit by bit, while neither axis has a fault: that alone they share.
template <class S>
void two_axes_are_two_controllers() {
  const auto axis = instruments::scaled_up<double>();
  const auto law = ControlLaw::robust;
  const Trace first = close_loop<double>(axis, {0.25, load_for(axis)}, 0.1, 1);
  const Trace second = close_loop<double>(axis, {-0.4, -load_for(axis)}, 0.143, 2);
  const auto pair = controller<GearAxis<S>, 2>(parameters(axis, law, Actuation::differential, 2));
  const auto alone = controller<GearAxis<S>>(parameters(axis, law, Actuation::differential));
  auto both = pair.start();
  ControllerState<S, 1> one[2] = {alone.start(), alone.start()};
  for (std::size_t n = 0; n < first.read.size(); ++n) {
    const Request request = n == 0 ? Request::enable : Request::none;
    const Measurement<S> read[2] = {as<S>(first.read[n]), as<S>(second.read[n])};
    ControlInput<S, 2> input{tick * (n + 1), request, {read[0], read[1]}};
    ControlOutput<S, 2> output{};
    pair.step(input, both, output);
    for (int k = 0; k < 2; ++k) {
      ControlInput<S, 1> own{tick * (n + 1), request, {read[k]}};
      ControlOutput<S, 1> got{};
      alone.step(own, one[k], got);
      CLAIM(same(output.axis[k], got.axis[0]));
      CLAIM(output.state == OperatingState::enabled && got.state == OperatingState::enabled);
    }
  }
}

template <class S>
void a_fault_of_one_axis_stops_both() {
  const auto axis = instruments::scaled_up<double>();
  const auto pair = controller<GearAxis<S>, 2>(parameters(axis, ControlLaw::robust, Actuation::differential, 2));
  const Trace trace = close_loop<double>(axis, {0.25, load_for(axis)}, 0.1, 1);
  auto state = pair.start();
  ControlOutput<S, 2> output{};
  bool moved = false;
  for (std::size_t n = 0; n < 2000; ++n) {
    Measurement<S> other = as<S>(trace.read[n]);
    if (n >= 1500) other.tension[0] = std::numeric_limits<S>::quiet_NaN();
    ControlInput<S, 2> input{tick * (n + 1), n == 0 ? Request::enable : Request::none, {as<S>(trace.read[n]), other}};
    CLAIM((pair.step(input, state, output) == OperatingState::fault) == (n >= 1500));
    moved = moved || output.axis[0].spool_velocity[0] != S(0);
  }
  CLAIM(moved);
  for (const auto& one : output.axis) CLAIM(one.spool_velocity[0] == S(0) && one.spool_velocity[1] == S(0));
  CLAIM(output.first_faults == bit(Fault::not_a_number));
}

template <class S>
struct Session {
  Controller<GearAxis<S>> made;
  ControllerState<S, 1> state;
  ControlOutput<S, 1> output{};
  Measurement<double> read{0, {25, 25}, {0, 0}};
  std::uint64_t time{};
  int number{};

  explicit Session(tenodesis_parameters p = parameters(instruments::scaled_up<double>(), ControlLaw::robust,
                                                       Actuation::differential))
      : made(controller<GearAxis<S>>(p)), state(made.start()) {}

  OperatingState step(Request request = Request::none) {
    time += tick;
    // A cell that does not flicker is stuck.
    ++number;
    read.tension[0] = 25 + (number % 2 == 0 ? 0.02 : -0.02);
    read.tension[1] = 25 - (number % 3 == 0 ? 0.02 : -0.02);
    return with(read, request);
  }
  OperatingState with(const Measurement<double>& measured, Request request = Request::none) {
    ControlInput<S, 1> input{time, request, {as<S>(measured)}};
    return made.step(input, state, output);
  }
  bool still() const { return output.axis[0].spool_velocity[0] == S(0) && output.axis[0].spool_velocity[1] == S(0); }
};

template <class S>
void a_reading_that_is_no_number_is_a_fault_and_no_motor_gets_it() {
  for (int channel = 0; channel < 5; ++channel) {
    for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(), 1e30}) {
      Session<S> session;
      session.step(Request::enable);
      for (int n = 0; n < 1000; ++n) CLAIM(session.step() == OperatingState::enabled);
      auto measured = session.read;
      (channel == 0  ? measured.handle_angle
       : channel < 3 ? measured.tension[channel - 1]
                     : measured.spool_angle[channel - 3]) = bad;
      session.time += tick;
      CLAIM(session.with(measured) == OperatingState::fault);
      CLAIM((session.output.first_faults & bit(Fault::not_a_number)) != 0);
      CLAIM(all_finite(session.output.axis[0].spool_velocity[0], session.output.axis[0].spool_velocity[1],
                       session.output.axis[0].estimate.output_angle));
      for (int n = 0; n < 200; ++n) CLAIM(session.step() == OperatingState::fault);
      CLAIM(session.still());
      session.step(Request::clear);
      CLAIM(session.step(Request::enable) == OperatingState::enabled);
      for (int n = 0; n < 1000; ++n) CLAIM(session.step() == OperatingState::enabled);
      CLAIM_NEAR(double(session.output.axis[0].estimate.output_angle), 0, 0.1 * degree);
    }
  }
}

template <class S>
void time_that_runs_backward_or_leaps_is_a_late_tick() {
  for (const std::int64_t leap :
       {-std::int64_t(tick), std::int64_t(0), std::int64_t(30'000'000), std::int64_t(10'000'000'000)}) {
    Session<S> session;
    session.step(Request::enable);
    for (int n = 0; n < 100; ++n) session.step();
    session.time = std::uint64_t(std::int64_t(session.time) + leap);
    CLAIM(session.with(session.read) == OperatingState::fault);
    CLAIM(session.output.first_faults == bit(Fault::tick_late));
  }
}

template <class S>
void a_controller_of_its_own_clock_looks_at_no_other() {
  auto p = parameters(instruments::scaled_up<double>(), ControlLaw::robust, Actuation::differential);
  const auto axis = instruments::scaled_up<double>();
  const Trace trace = close_loop<S>(axis, {0.25, load_for(axis)}, 0.1, 1);
  p.own_clock = 1;
  const auto made = controller<GearAxis<S>>(p);
  auto state = made.start();
  double apart = 0;
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  for (std::size_t n = 0; n < trace.read.size(); ++n) {
    ControlInput<S, 1> input{random(), n == 0 ? Request::enable : Request::none, {as<S>(trace.read[n])}};
    ControlOutput<S, 1> output{};
    CLAIM(made.step(input, state, output) == OperatingState::enabled);
    for (int i = 0; i < 2; ++i)
      apart = std::max(apart, std::fabs(double(output.axis[0].spool_velocity[i]) - trace.velocity[i][n]));
  }
  CLAIM_NEAR(apart, 0, sizeof(S) == 4 ? 1e-3 : 1e-10);
}

template <class S>
void nothing_compensates_before_it_is_homed_and_nothing_moves_unless_enabled() {
  auto p = parameters(instruments::scaled_up<double>(), ControlLaw::robust, Actuation::differential);
  p.homed = 0;
  Session<S> session(p);
  session.step();
  CLAIM(session.step(Request::enable) == OperatingState::disabled && !session.output.homed);
  CLAIM(session.step(Request::resume) == OperatingState::disabled);
  CLAIM(session.step(Request::pause) == OperatingState::disabled && session.still());
  CLAIM(session.step(Request::home) == OperatingState::enabled && session.output.homing);
}

template <class S>
void run() {
  const auto every_mechanism = [](const auto& axis) {
    eq_22_with_one_motor_leaves_half_the_loss_and_with_both_nothing(axis);
    exact_gives_all_back_with_one_motor_or_two_slack_included(axis);
    off_moves_nothing(axis);
    no_law_winds_a_tendon_at_its_limit_or_faster_than_it_may(axis);
  };
  every_mechanism(instruments::real_size<S>());
  every_mechanism(instruments::scaled_up<S>());
  every_mechanism(instruments::pulley<S>());
  robust_gives_the_angle_back_whatever_friction_it_was_told<S>();
  a_mirrored_recording_gets_the_mirrored_answer<S>();
  two_axes_are_two_controllers<S>();
  a_fault_of_one_axis_stops_both<S>();
  a_reading_that_is_no_number_is_a_fault_and_no_motor_gets_it<S>();
  time_that_runs_backward_or_leaps_is_a_late_tick<S>();
  a_controller_of_its_own_clock_looks_at_no_other<S>();
  nothing_compensates_before_it_is_homed_and_nothing_moves_unless_enabled<S>();
}

int main() {
  a_number_that_is_none_makes_no_controller();
  a_choice_that_there_is_not_makes_no_controller();
  run<double>();
  run<float>();
  float_and_double_say_the_same_of_one_recording();
  return claims::report();
}

// Claims about the controller on the twin: what it restores, that it refuses bad parameters and readings, and that
// precision, number of axes and side make no difference.

#include "tenodesis/controller.hpp"

#include <cstring>
#include <limits>
#include <random>
#include <vector>

#include "control_parameters.hpp"
#include "tenodesis/axis_twin.hpp"

// ---- parameters

void a_parameter_out_of_bounds_makes_no_controller() {
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

void an_unknown_choice_makes_no_controller() {
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
  refuses(&tenodesis_parameters::stop, 2);
  refuses(&tenodesis_parameters::own_clock, 2);
  refuses(&tenodesis_parameters::homed, 2);
}

// ---- the closed loop on the twin

using Plant = AxisTwin<GearAxis<double>, Capstan<double>>;

Plant plant(const GearAxis<double>& axis, double friction, bool noisy = true) {
  Plant twin{};
  const auto p = axis_parameters(axis);
  set_axis(twin, axis, {friction, friction, p.sheath_bend});
  const double share[4] = {p.share_sheath, p.share_handle, p.share_stem, p.share_tip};
  for (auto& tendon : twin.tendon)
    for (int n = 0; n < 4; ++n) tendon.stiffness[n] = axis.stiffness / share[n];
  const double inertia = axis.distal.radius > 5e-3 ? 4e-4 : 4e-6, damping = axis.distal.radius > 5e-3 ? 9e-3 : 4e-4;
  set_tip(twin, inertia, damping, 1.86, 20.0);
  twin.drive = {spool_radius, 20, 400, 0.01, 0};
  twin.handle_encoder = twin.output_encoder = {1, 0, noisy ? 5.2e-4 : 0, -pi, pi, counts};
  for (auto& cell : twin.load_cell) cell = {1, 0, noisy ? 0.03 : 0, -200, 200, 0.0061};
  twin.motor_encoder = {1, 0, 0, -1e3, 1e3, counts};
  twin.time_step = dt;
  twin.prepare();
  return twin;
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
    const auto read = measurement_as<Measurement<double>>(reading_of(bench));
    ControlInput<S, 1> input{
        tick * std::uint64_t(n + 1), n == 0 ? Request::enable : Request::none, {measurement_as<Measurement<S>>(read)}};
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
    trace.tip.push_back(bench.angle[0]);
    trace.estimate.push_back(double(output.axis[0].estimate.output_angle));
    trace.deviation.push_back(double(output.axis[0].estimate.output_angle_std));
    const Status found = twin.step(command_of<Plant::Command>(command), bench);
    CLAIM(found == Status::ok);
    if (found != Status::ok) return trace;
  }
  const auto model = detail::control_model<GearAxis<double>>(axis_parameters(axis));
  trace.target = axis.distal.angle(model.aim(script.handle_at(duration)) / axis.distal.excursion_slope());
  return trace;
}

double load_for(const GearAxis<double>& axis) { return 0.35 * slack_force(axis, 0.0).value; }

template <class S>
void robust_restores_the_angle_whatever_friction_it_assumes() {
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
void float_and_double_agree_on_a_recording() {
  for (const auto& axis : {instruments::scaled_up<double>(), instruments::real_size<double>()}) {
    const auto p = parameters(axis, ControlLaw::robust, Actuation::differential);
    const Trace trace = close_loop<double>(axis, {0.25, load_for(axis)}, 0.1, 1);
    const auto made = controller<GearAxis<float>>(p);
    auto state = made.start();
    double apart = 0, faster = 0;
    for (std::size_t n = 0; n < trace.read.size(); ++n) {
      ControlInput<float, 1> input{tick * (n + 1),
                                   n == 0 ? Request::enable : Request::none,
                                   {measurement_as<Measurement<float>>(trace.read[n])}};
      ControlOutput<float, 1> output{};
      made.step(input, state, output);
      apart = std::max(apart, std::fabs(double(output.axis[0].estimate.output_angle) - trace.estimate[n]));
      // A decision of the law may fall a tick earlier or later.
      for (int i = 0; i < 2; ++i) {
        double least = 1;
        for (std::size_t m = n > 0 ? n - 1 : 0; m < std::min(n + 2, trace.read.size()); ++m)
          least = std::min(least, std::fabs(double(output.axis[0].spool_velocity[i]) - trace.velocity[i][m]));
        faster = std::max(faster, least);
      }
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
  ControllerState<S, 1> separate[2] = {alone.start(), alone.start()};
  for (std::size_t n = 0; n < first.read.size(); ++n) {
    const Request request = n == 0 ? Request::enable : Request::none;
    const Measurement<S> read[2] = {measurement_as<Measurement<S>>(first.read[n]),
                                    measurement_as<Measurement<S>>(second.read[n])};
    ControlInput<S, 2> input{tick * (n + 1), request, {read[0], read[1]}};
    ControlOutput<S, 2> output{};
    pair.step(input, both, output);
    for (int k = 0; k < 2; ++k) {
      ControlInput<S, 1> own{tick * (n + 1), request, {read[k]}};
      ControlOutput<S, 1> got{};
      alone.step(own, separate[k], got);
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
    auto other = measurement_as<Measurement<S>>(trace.read[n]);
    if (n >= 1500) other.tension[0] = std::numeric_limits<S>::quiet_NaN();
    ControlInput<S, 2> input{tick * (n + 1),
                             n == 0 ? Request::enable : Request::none,
                             {measurement_as<Measurement<S>>(trace.read[n]), other}};
    CLAIM((pair.step(input, state, output) == OperatingState::fault) == (n >= 1500));
    moved = moved || output.axis[0].spool_velocity[0] != S(0);
  }
  CLAIM(moved);
  for (const auto& each : output.axis) CLAIM(each.spool_velocity[0] == S(0) && each.spool_velocity[1] == S(0));
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
  double speed[2]{};  // of the spools, rad/s

  explicit Session(tenodesis_parameters p = parameters(instruments::scaled_up<double>(), ControlLaw::robust,
                                                       Actuation::differential))
      : made(controller<GearAxis<S>>(p)), state(made.start()) {}

  OperatingState step(Request request = Request::none) {
    time += tick;
    ++number;
    const double flicker[2] = {number % 2 == 0 ? 0.02 : -0.02, number % 3 == 0 ? -0.02 : 0.02};
    const auto& axis = made.axis[0].model().axis;
    for (int i = 0; i < 2; ++i) {
      speed[i] += (double(output.axis[0].spool_velocity[i]) - speed[i]) * dt / 0.01;
      read.spool_angle[i] += speed[i] * dt;
      // A cell that does not flicker is stuck.
      read.tension[i] = 25 + double(axis.stiffness) * spool_radius * read.spool_angle[i] + flicker[i];
    }
    return with(read, request);
  }
  OperatingState with(const Measurement<double>& measured, Request request = Request::none) {
    ControlInput<S, 1> input{time, request, {measurement_as<Measurement<S>>(measured)}};
    return made.step(input, state, output);
  }
  bool still() const { return output.axis[0].spool_velocity[0] == S(0) && output.axis[0].spool_velocity[1] == S(0); }
};

template <class S>
void a_reading_that_is_not_a_number_is_a_fault_and_reaches_no_motor() {
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
void a_controller_with_its_own_clock_ignores_the_inputs_time() {
  auto p = parameters(instruments::scaled_up<double>(), ControlLaw::robust, Actuation::differential);
  const auto axis = instruments::scaled_up<double>();
  const Trace trace = close_loop<S>(axis, {0.25, load_for(axis)}, 0.1, 1);
  p.own_clock = 1;
  const auto made = controller<GearAxis<S>>(p);
  auto state = made.start();
  double apart = 0;
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  for (std::size_t n = 0; n < trace.read.size(); ++n) {
    ControlInput<S, 1> input{
        random(), n == 0 ? Request::enable : Request::none, {measurement_as<Measurement<S>>(trace.read[n])}};
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
  robust_restores_the_angle_whatever_friction_it_assumes<S>();
  a_mirrored_recording_gets_the_mirrored_answer<S>();
  two_axes_are_two_controllers<S>();
  a_fault_of_one_axis_stops_both<S>();
  a_reading_that_is_not_a_number_is_a_fault_and_reaches_no_motor<S>();
  time_that_runs_backward_or_leaps_is_a_late_tick<S>();
  a_controller_with_its_own_clock_ignores_the_inputs_time<S>();
  nothing_compensates_before_it_is_homed_and_nothing_moves_unless_enabled<S>();
}

int main() {
  a_parameter_out_of_bounds_makes_no_controller();
  an_unknown_choice_makes_no_controller();
  run<double>();
  run<float>();
  float_and_double_agree_on_a_recording();
  return claims::report();
}

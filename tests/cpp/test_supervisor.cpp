// Claims about faults and states: every fault is found in time and by its own name, normal work is none, no state
// change jerks, nothing but finite velocities reach a motor, and the recorder keeps what led to a fault.

#include "tenodesis/supervisor.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <random>

#include "claim.hpp"
#include "tenodesis/flight_recorder.hpp"
#include "tenodesis/sensor.hpp"
#include "tenodesis/watch.hpp"

using namespace tenodesis;

constexpr double period = 5e-4;                       // s
constexpr double pretension = 25, stiffness = 11451;  // N, N/m
constexpr double spool_radius = 5e-3;                 // m
constexpr double count_of_encoder = 2 * pi / 4096;    // rad
constexpr double count_of_cell = 400.0 / 65536;       // N
constexpr Drive<double> real_drive{spool_radius, 20, 400, 0.012, 0};
constexpr auto seed = 1;

template <class S>
Watch<S> watch() {
  Watch<S> all{};
  const auto set = [&](Fault fault, double threshold, double persistence) {
    all.limit[static_cast<int>(fault)] = {S(threshold), S(persistence)};
  };
  set(Fault::tendon_break, 2, 0.010);
  set(Fault::tendon_slack, 1, 2);
  set(Fault::over_tension, 100, 0.003);
  set(Fault::load_cell_stuck, 0.01, 0.040);
  set(Fault::load_cell_range, 2, 0.005);
  set(Fault::load_cell_drift, 2.5, 0.5);
  set(Fault::encoder_dropout, 0.1, 0.005);
  set(Fault::encoder_jump, 30, 1.2 * period);
  set(Fault::spool_slip, 3, 0.010);
  set(Fault::motor_not_following, 0.008, 0.005);
  set(Fault::tick_late, 0.025, 0);
  all.spool_jump = {S(60), S(1.2 * period)};
  all.drive = {S(spool_radius), S(20), S(400), S(0.010), S(0)};
  all.pretension = S(pretension);
  all.stiffness = S(stiffness);
  all.mean_band = S(0.35);
  all.load_cell_range = S(200);
  all.handle_range = S(0.7854);
  all.handle_noise = S(0.01);
  all.spool_noise = S(2.5 * count_of_encoder);
  all.window = S(0.1);
  all.period = S(period);
  return all;
}

template <class S>
Supervisor<S> supervisor(SafeState safe = SafeState::hold) {
  return {S(20), S(400), S(0.2), S(100), safe, S(0.5), S(0.2), S(0.2), S(period)};
}

/// Signals of an instrument at work, and what can be broken about it.
struct Bench {
  Noise noise{seed};
  DriveState<double> spool[2]{};
  double command[2]{};   // rad/s
  double handle{};       // rad
  double load{};         // N between the tendons
  double friction{};     // share of the mean tension
  double lost[2]{};      // spool angle that does not wind, rad
  double left[2]{1, 1};  // of a tension, if the tendon is whole
  bool stalled[2]{};

  void step(double dt = period) {
    for (int i = 0; i < 2; ++i) spool[i] = advance(real_drive, spool[i], stalled[i] ? 0 : command[i], 1.0, dt);
  }

  double tension(int i) const {
    const double wound = spool_radius * (spool[0].angle + spool[1].angle - lost[0] - lost[1]) / 2;
    const double mean = std::max(0.0, (pretension + stiffness * wound) * (1 + friction));
    const double half = load / 2;
    // A slack tendon leaves the whole load to the other.
    if (std::fabs(half) > mean) return left[i] * ((i == agonist) == (load > 0) ? std::fabs(load) : 0);
    return left[i] * (mean + (i == agonist ? half : -half));
  }

  Measurement<double> read() {
    const Sensor<double> cell{1, 0, 0.03, -200, 200, count_of_cell};
    const Sensor<double> joint{1, 0, 5.2e-4, -pi, pi, count_of_encoder};
    const Sensor<double> motor{1, 0, 0, -1e3, 1e3, count_of_encoder};
    Measurement<double> seen{};
    seen.handle_angle = joint.read(handle, noise);
    for (int i = 0; i < 2; ++i) {
      seen.tension[i] = cell.read(tension(i), noise);
      seen.spool_angle[i] = motor.read(spool[i].angle, noise);
    }
    return seen;
  }
};

template <class S>
Measurement<S> as(const Measurement<double>& seen) {
  return {
      S(seen.handle_angle), {S(seen.tension[0]), S(seen.tension[1])}, {S(seen.spool_angle[0]), S(seen.spool_angle[1])}};
}

template <class S>
WatchState<S> homed() {
  WatchState<S> state{};
  state.homed = true;
  return state;
}

/// What is done to a bench and to its readings, a time after its start, at a strength where 1 is well beyond a limit;
/// called twice a tick, before and after reading.
using Injection = void (*)(double time, double strength, Bench& bench, Measurement<double>& seen);

struct Found {
  std::uint32_t first{}, all{};
  double after{-1};  // s
};

/// Half a second of rest, then the injection.
template <class S>
Found inject(Injection injection, double strength, double duration) {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  Found found{};
  for (int n = 0; n * period < 0.5 + duration; ++n) {
    const double time = n * period - 0.5;
    const S sent[2] = {S(bench.command[0]), S(bench.command[1])};
    bench.step();
    Measurement<double> untouched{};
    if (time >= 0) injection(time, strength, bench, untouched);
    Measurement<double> seen = bench.read();
    if (time >= 0) injection(time, strength, bench, seen);
    const std::uint32_t now = checks.check(as<S>(seen), sent, S(period), state);
    if (now != 0 && found.first == 0) {
      found.first = now;
      found.after = time;
    }
    found.all |= now;
  }
  return found;
}

struct Case {
  Fault fault;
  double within;    // s
  double below;     // a strength that is not yet a fault
  double duration;  // s
  Injection injection;
};

constexpr Case cases[] = {
    {Fault::tendon_break, 0.045, 0, 2.6,
     [](double time, double strength, Bench& bench, auto&) {
       if (strength <= 0) return;
       bench.left[0] = 0;
       bench.left[1] = std::max(0.0, 1 - time / 0.02);
     }},
    // The other tendon goes on carrying a load.
    {Fault::tendon_break, 0.045, 0, 2.6,
     [](double time, double strength, Bench& bench, auto&) {
       if (strength <= 0) return;
       bench.left[1] = 0;
       bench.left[0] = std::max(0.3, 1 - time / 0.02);
     }},
    {Fault::tendon_slack, 2.001, 0.7, 2.5,
     [](double, double strength, Bench& bench, auto&) { bench.load = 60 * strength; }},
    {Fault::over_tension, 0.004, 0.85, 0.5,
     [](double, double strength, Bench& bench, auto&) { bench.load = -110 * strength; }},
    {Fault::load_cell_stuck, 0.042, 0, 0.5,
     [](double, double strength, Bench&, auto& seen) {
       if (strength > 0) seen.tension[1] = 25;
     }},
    {Fault::load_cell_range, 0.006, 0.5, 0.5,
     [](double, double strength, Bench&, auto& seen) { seen.tension[0] += -28 * (strength > 0.6 ? 1 : 0.2); }},
    // Drifts by 40 N/s at one cell, from 45 N.
    {Fault::load_cell_drift, 1.2, 0.5, 1.5,
     [](double time, double strength, Bench& bench, auto& seen) {
       bench.load = 40 * std::min(1.0, time / 0.2);
       seen.tension[0] -= strength * std::min(30.0, 40 * std::max(0.0, time - 0.1));
     }},
    {Fault::load_cell_drift, 1.2, 0.5, 1.5,
     [](double time, double strength, Bench&, auto& seen) { seen.tension[1] += strength * std::min(30.0, 40 * time); }},
    {Fault::encoder_dropout, 0.006, 0.27, 0.5,
     [](double, double strength, Bench& bench, auto& seen) {
       if (strength < 1)
         bench.handle = std::min(bench.handle + 0.005, pi * strength);
       else
         seen.handle_angle = pi * strength;
     }},
    {Fault::encoder_jump, 0.0011, 0.015, 0.5,
     [](double, double strength, Bench&, auto& seen) { seen.handle_angle += 0.5 * strength; }},
    {Fault::encoder_jump, 0.0011, 0.05, 0.5,
     [](double, double strength, Bench&, auto& seen) { seen.spool_angle[1] += 0.1 * strength; }},
    {Fault::spool_slip, 0.020, 0.5, 0.5,
     [](double time, double strength, Bench& bench, auto&) {
       bench.lost[0] = strength * 0.5 * std::min(1.0, time / 0.005);
     }},
    // A motor that stands still; slower ones take longer to tell from an encoder's steps.
    {Fault::motor_not_following, 0.030, 0.06, 0.5,
     [](double, double strength, Bench& bench, auto&) {
       bench.command[0] = strength;
       bench.stalled[0] = true;
     }},
    {Fault::motor_not_following, 0.050, 0.15, 0.5,
     [](double, double strength, Bench& bench, auto&) {
       bench.command[1] = -0.4 * strength;
       bench.stalled[1] = true;
     }},
    // One that runs away.
    {Fault::motor_not_following, 0.030, 0.06, 0.5,
     [](double, double strength, Bench& bench, auto&) { bench.spool[1].angle += strength * period / 2; }},
    {Fault::not_a_number, 0, 0, 0.1,
     [](double, double strength, Bench&, auto& seen) {
       if (strength > 0) seen.spool_angle[0] = NAN;
     }},
};

template <class S>
void each_fault_is_found_in_time_and_by_its_name() {
  for (const Case& one : cases) {
    const Found found = inject<S>(one.injection, 1, one.duration);
    CLAIM(found.first == bit(one.fault));
    CLAIM(found.all == bit(one.fault));
    CLAIM(found.after >= 0 && found.after <= one.within + period * 1.01);
    if (found.all != bit(one.fault)) std::printf("    %s: all %x\n", name(one.fault), found.all);
    if (found.first != bit(one.fault) || !(found.after <= one.within + period * 1.01))
      std::printf("    %s: mask %x after %g s\n", name(one.fault), found.first, found.after);
  }
}

template <class S>
void below_its_threshold_nothing_is_found() {
  for (const Case& one : cases) {
    const Found found = inject<S>(one.injection, one.below, one.duration);
    CLAIM(found.all == 0);
    if (found.all != 0) std::printf("    %s: mask %x after %g s\n", name(one.fault), found.all, found.after);
  }
}

template <class S>
void a_condition_shorter_than_its_persistence_is_no_fault() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  const S sent[2]{};
  for (int n = 0; n < 20'000; ++n) {
    // 2.5 ms in 5 above the limit of tension, which takes 3.
    bench.load = n % 10 < 5 ? 110 : 40;
    CLAIM(checks.check(as<S>(bench.read()), sent, S(period), state) == 0);
  }
}

template <class S>
void a_slack_tendon_under_a_large_load_is_not_a_drifting_cell() {
  Watch<S> checks = watch<S>();
  const S sent[2]{};
  for (const S empty : {S(2), S(0)}) {
    checks.limit[static_cast<int>(Fault::tendon_break)].threshold = empty;
    WatchState<S> state = homed<S>();
    Bench bench{};
    bench.load = 90;
    for (int n = 0; n < 3000; ++n) {
      Measurement<double> seen = bench.read();
      seen.tension[1] += 0.3;
      CLAIM(checks.check(as<S>(seen), sent, S(period), state) == 0);
    }
  }
}

template <class S>
void a_first_sample_out_of_range_is_not_trusted() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Measurement<double> seen = Bench{}.read();
  seen.handle_angle = pi;
  const S sent[2]{};
  checks.check(as<S>(seen), sent, S(period), state);
  CLAIM(state.trusted.handle_angle <= checks.handle_range);
}

template <class S>
void one_sample_after_a_gap_has_not_lasted() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  const S sent[2]{};
  for (int n = 0; n < 10; ++n) checks.check(as<S>(bench.read()), sent, S(period), state);
  bench.load = 110;
  CLAIM(checks.check(as<S>(bench.read()), sent, S(0.02), state) == 0);
}

template <class S>
void a_sample_that_is_no_number_hides_no_fault() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  bench.load = 110;
  const S sent[2]{};
  for (int n = 0; n < 10; ++n) checks.check(as<S>(bench.read()), sent, S(period), state);
  Measurement<double> seen = bench.read();
  seen.handle_angle = NAN;
  CLAIM(checks.check(as<S>(seen), sent, S(period), state) == (bit(Fault::over_tension) | bit(Fault::not_a_number)));
  CLAIM(checks.check(as<S>(bench.read()), sent, S(period), state) == bit(Fault::over_tension));
}

template <class S>
void a_jump_is_told_once() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  const S sent[2]{};
  int told = 0;
  for (int n = 0; n < 1000; ++n) {
    Measurement<double> seen = bench.read();
    if (n >= 100) seen.handle_angle += 0.7;
    const std::uint32_t found = checks.check(as<S>(seen), sent, S(period), state);
    CLAIM(found == 0 || found == bit(Fault::encoder_jump));
    if (found != 0) ++told;
  }
  CLAIM(told == 1);
  CLAIM(state.bad_samples[static_cast<int>(Channel::handle)] == 2);
}

// As when the watchdog has stopped them.
template <class S>
void motors_that_a_gap_has_stopped_are_followed_from_rest() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  for (const bool after : {false, true}) {
    const double speed = after ? 0 : 5;
    for (int n = 0; n < 40; ++n) {
      const S sent[2] = {S(bench.command[0]), S(bench.command[1])};
      bench.step();
      for (int i = 0; i < 2; ++i) bench.command[i] = i == 0 ? speed : -speed;
      const S dt = S(after && n == 0 ? 0.5 : period);
      const std::uint32_t found = checks.check(as<S>(bench.read()), sent, dt, state);
      CLAIM(found == (after && n == 0 ? bit(Fault::tick_late) : 0U));
      if (n == 39)
        for (auto& spool : bench.spool) spool.speed = 0;
      if (n == 39)
        for (double& command : bench.command) command = 0;
    }
  }
}

template <class S>
void a_late_tick_is_a_fault_at_once() {
  const Watch<S> checks = watch<S>();
  const S sent[2]{};
  for (const double dt : {0.0251, 1.0, 0.0, -1e-3, double(NAN), double(INFINITY)}) {
    WatchState<S> state = homed<S>();
    Bench bench{};
    for (int n = 0; n < 100; ++n) CLAIM(checks.check(as<S>(bench.read()), sent, S(period), state) == 0);
    CLAIM(state.late_ticks == 0);
    CLAIM(checks.check(as<S>(bench.read()), sent, S(0.02), state) == 0);
    CLAIM(state.late_ticks == 1);
    CLAIM(checks.check(as<S>(bench.read()), sent, S(dt), state) == bit(Fault::tick_late));
    CLAIM(state.late_ticks == 2);
    CLAIM(checks.check(as<S>(bench.read()), sent, S(period), state) == 0);
    CLAIM(state.count[static_cast<int>(Fault::tick_late)] == 1);
  }
  CLAIM(!checks.watchdog(S(0.02)));
  CLAIM(checks.watchdog(S(0.03)));
  CLAIM(checks.watchdog(S(NAN)));
}

template <class S>
void a_single_bad_sample_is_counted_but_no_fault() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  const S sent[2]{};
  std::uint32_t glitches = 0;
  for (int n = 0; n < 2000; ++n) {
    Measurement<double> seen = bench.read();
    const bool glitch = n > 0 && n % 20 == 0;
    if (glitch) {
      seen.handle_angle += 0.3;
      seen.spool_angle[0] -= 0.2;
      seen.spool_angle[1] += 3;
      seen.tension[1] = -50;
      ++glitches;
    }
    CLAIM(checks.check(as<S>(seen), sent, S(period), state) == 0);
    // Nobody has to work with a bad sample.
    CLAIM(std::fabs(double(state.trusted.handle_angle)) < 0.01);
    CLAIM(std::fabs(double(state.trusted.spool_angle[0])) < 0.01);
    CLAIM(std::fabs(double(state.trusted.spool_angle[1])) < 0.01);
    CLAIM(std::fabs(double(state.trusted.tension[1]) - pretension) < 1);
  }
  const std::uint32_t expected[channel_count] = {glitches, 0, glitches, glitches, glitches};
  for (int n = 0; n < channel_count; ++n) CLAIM(state.bad_samples[n] == expected[n]);
}

template <class S>
void nothing_is_said_of_the_pair_before_homing() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state{};
  Bench bench{};
  const S sent[2]{};
  for (double& left : bench.left) left = 0.01;
  for (int n = 0; n < 10'000; ++n) CLAIM(checks.check(as<S>(bench.read()), sent, S(period), state) == 0);
  state.homed = true;
  std::uint32_t found = 0;
  for (int n = 0; n < 100; ++n) found |= checks.check(as<S>(bench.read()), sent, S(period), state);
  CLAIM(found == bit(Fault::tendon_break));
  Watch<S>::restart(state);
  CLAIM(state.homed && !state.started && state.confirmed == 0);
  CLAIM(state.count[static_cast<int>(Fault::tendon_break)] == 1);
}

template <class S>
void a_threshold_of_zero_switches_a_check_off() {
  Watch<S> checks = watch<S>();
  for (auto& one : checks.limit) one.threshold = S(0);
  checks.spool_jump.threshold = S(0);
  CLAIM(checks.valid());
  WatchState<S> state = homed<S>();
  std::mt19937 random(seed);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  std::uniform_real_distribution<double> pick(-500, 500);
  const S sent[2] = {S(3), S(-3)};
  for (int n = 0; n < 10'000; ++n) {
    const Measurement<double> seen{pick(random), {pick(random), pick(random)}, {pick(random), pick(random)}};
    CLAIM(checks.check(as<S>(seen), sent, S(n % 7 == 0 ? 1 : period), state) == 0);
  }
}

template <class S>
void counters_saturate() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  for (auto& one : state.count) one = UINT32_MAX - 1;
  for (auto& one : state.bad_samples) one = UINT32_MAX - 1;
  state.late_ticks = UINT32_MAX - 1;
  Bench bench{};
  const S sent[2]{};
  for (int n = 0; n < 20; ++n) {
    const Measurement<S> nan{S(NAN), {S(NAN), S(NAN)}, {S(NAN), S(NAN)}};
    checks.check(n % 2 == 0 ? as<S>(bench.read()) : nan, sent, S(1), state);
  }
  CLAIM(state.count[static_cast<int>(Fault::not_a_number)] == UINT32_MAX);
  CLAIM(state.count[static_cast<int>(Fault::tendon_slack)] == UINT32_MAX - 1);
  for (const auto one : state.bad_samples) CLAIM(one == UINT32_MAX);
  CLAIM(state.late_ticks == UINT32_MAX);
}

// Handle up to 2 Hz, spools up to 5 rad/s, loads beyond the slack limit, friction that turns within milliseconds.
template <class S>
void normal_work_is_no_fault() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  std::mt19937 random(seed);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  std::uniform_real_distribution<double> pick(-1, 1);
  double load = 0, friction = 0, common = 0, across = 0, frequency = 1, phase = 0;
  std::uint32_t found = 0;
  double fastest = 0;
  int slack = 0;
  for (int n = 0; n < 2'000'000; ++n) {
    const double time = n * period;
    if (n % 600 == 0) load = 70 * pick(random);
    if (n % 60 == 0) friction = 0.3 * pick(random);
    if (n % 4000 == 0) frequency = 1.1 + 0.9 * pick(random);
    if (n % 150 == 0) {
      common = 0.6 * pick(random) - 4 * (bench.spool[0].angle + bench.spool[1].angle) / 2;
      across = 4.4 * pick(random) - 4 * (bench.spool[0].angle - bench.spool[1].angle) / 2;
    }
    const S sent[2] = {S(bench.command[0]), S(bench.command[1])};
    bench.step();
    bench.load += (load - bench.load) * 0.02;
    bench.friction += (friction - bench.friction) * 0.1;
    phase += 2 * pi * frequency * period;
    bench.handle = 0.78 * std::sin(phase) * std::sin(time * 0.1);
    bench.command[0] = std::clamp(common + across, -5.0, 5.0);
    bench.command[1] = std::clamp(common - across, -5.0, 5.0);
    fastest = std::max(fastest, std::fabs(bench.spool[0].speed));
    if (bench.tension(0) == 0) ++slack;
    found |= checks.check(as<S>(bench.read()), sent, S(period), state);
  }
  CLAIM(found == 0);
  if (found != 0) std::printf("    mask %x\n", found);
  for (const auto one : state.bad_samples) CLAIM(one == 0);
  CLAIM(fastest > 4.9);
  CLAIM(slack > 10'000);
}

OperatingState expected_state(OperatingState from, Request request, bool faulty) {
  using enum OperatingState;
  if (from == fault) return request == Request::clear && !faulty ? disabled : fault;
  if (faulty) return from == disabled ? disabled : fault;
  if (request == Request::home) return enabled;
  if (request == Request::disable) return disabled;
  if (from == disabled && request == Request::enable) return enabled;
  if (from == enabled && request == Request::pause) return paused;
  if (from == paused && request == Request::resume) return enabled;
  return from;
}

void every_state_answers_every_request_as_it_should() {
  const Supervisor<double> over = supervisor<double>();
  for (int from = 0; from < 4; ++from)
    for (int request = 0; request < 7; ++request)
      for (int n = -1; n < fault_count; ++n) {
        SupervisorState<double> state{};
        state.operating = static_cast<OperatingState>(from);
        if (state.operating == OperatingState::fault) state.first = state.faults = bit(Fault::tick_late);
        const std::uint32_t faults = n < 0 ? 0 : bit(static_cast<Fault>(n));
        const OperatingState expected = expected_state(state.operating, static_cast<Request>(request), faults != 0);
        CLAIM(over.advance(static_cast<Request>(request), faults, period, state) == expected);
        CLAIM(state.operating == expected);
        CLAIM(state.present == faults);
        const bool was = from == static_cast<int>(OperatingState::fault);
        const bool is = expected == OperatingState::fault;
        CLAIM(state.first == (is ? was ? bit(Fault::tick_late) : faults : 0));
        CLAIM(state.faults == (is ? was ? bit(Fault::tick_late) | faults : faults : 0));
        CLAIM(state.homing == (expected == OperatingState::enabled && static_cast<Request>(request) == Request::home));
      }
}

void a_fault_latches_and_is_cleared_once_its_cause_is_gone() {
  const Supervisor<double> over = supervisor<double>();
  SupervisorState<double> state{};
  over.advance(Request::enable, 0, period, state);
  over.advance(Request::none, bit(Fault::spool_slip) | bit(Fault::encoder_jump), period, state);
  for (int request = 0; request < 7; ++request) {
    const bool clears = static_cast<Request>(request) == Request::clear;
    if (!clears) over.advance(static_cast<Request>(request), 0, period, state);
    CLAIM(state.operating == OperatingState::fault);
  }
  over.advance(Request::clear, bit(Fault::load_cell_drift), period, state);
  CLAIM(state.operating == OperatingState::fault);
  CLAIM(state.first == (bit(Fault::spool_slip) | bit(Fault::encoder_jump)));
  CLAIM(state.faults == (state.first | bit(Fault::load_cell_drift)));
  CommandState<double> axis{};
  const double wanted[2] = {0, NAN};
  over.command(wanted, {}, period, state, axis);
  CLAIM((state.faults & bit(Fault::not_a_number)) != 0 && (state.first & bit(Fault::not_a_number)) == 0);
  over.advance(Request::clear, 0, period, state);
  CLAIM(state.operating == OperatingState::disabled);
  CLAIM(state.first == 0 && state.faults == 0);
}

template <class S>
void a_slipped_spool_is_cleared_by_homing_anew() {
  const Watch<S> checks = watch<S>();
  WatchState<S> watched = homed<S>();
  const Supervisor<S> over = supervisor<S>();
  SupervisorState<S> state{};
  Bench bench{};
  const S sent[2]{};
  const auto run = [&](Request request) {
    for (int n = 0; n < 2000; ++n)
      over.advance(request, checks.check(as<S>(bench.read()), sent, S(period), watched), S(period), state);
  };
  run(Request::enable);
  bench.lost[1] = 0.5;
  run(Request::none);
  CLAIM(state.first == bit(Fault::spool_slip));
  run(Request::clear);
  CLAIM(state.operating == OperatingState::fault);
  CLAIM(needs_homing(state.faults));
  watched.homed = false;
  run(Request::clear);
  CLAIM(state.operating == OperatingState::disabled);
}

void homing_ends_in_holding() {
  const Supervisor<double> over = supervisor<double>();
  SupervisorState<double> state{};
  Supervisor<double>::finish_homing(state);
  CLAIM(state.operating == OperatingState::disabled);
  over.advance(Request::home, 0, period, state);
  CLAIM(state.operating == OperatingState::enabled && state.homing);
  Supervisor<double>::finish_homing(state);
  CLAIM(state.operating == OperatingState::paused && !state.homing);
}

template <class S>
void no_transition_jerks() {
  for (const SafeState safe : {SafeState::hold, SafeState::neutral}) {
    const Supervisor<S> over = supervisor<S>(safe);
    SupervisorState<S> state{};
    CommandState<S> axis{};
    std::mt19937 random(seed);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
    std::uniform_real_distribution<double> pick(-1, 1);
    S wanted[2]{};
    Measurement<S> seen{S(0), {S(25), S(25)}, {S(0), S(0)}};
    double worst = 0, fastest = 0;
    int transitions = 0;
    for (int n = 0; n < 400'000; ++n) {
      const auto roll = random() % 400;
      const auto request = roll < 7 ? static_cast<Request>(roll) : Request::none;
      const std::uint32_t faults = random() % 2000 == 0 ? bit(Fault::tendon_slack) : 0;
      if (n % 50 == 0)
        for (S& one : wanted) one = S(30 * pick(random));
      const auto dt = S(period * (1 + 0.9 * pick(random)));
      const OperatingState from = state.operating;
      over.advance(request, faults, dt, state);
      if (from != state.operating) ++transitions;
      const S before[2] = {axis.sent[0], axis.sent[1]};
      CLAIM(over.command(wanted, seen, dt, state, axis) == 0);
      for (int i = 0; i < 2; ++i) {
        worst = std::max(worst, std::fabs(double(axis.sent[i] - before[i])) / double(dt));
        fastest = std::max(fastest, std::fabs(double(axis.sent[i])));
        seen.spool_angle[i] += axis.sent[i] * dt;
      }
    }
    CLAIM(worst <= 400 * (1 + 1e3 * double(std::numeric_limits<S>::epsilon())));
    CLAIM(fastest <= 20);
    CLAIM(fastest > 19.9);
    CLAIM(transitions > 1000);
  }
}

void what_is_wanted_is_faded_in() {
  const Supervisor<double> over = supervisor<double>();
  SupervisorState<double> state{};
  CommandState<double> axis{};
  const double wanted[2] = {10, -10};
  over.advance(Request::enable, 0, period, state);
  for (int n = 0; n < 600; ++n) {
    over.command(wanted, {}, period, state, axis);
    CLAIM_NEAR(axis.sent[0], 10 * std::min(1.0, n * period / 0.2), 1e-9);
    CLAIM_NEAR(axis.sent[1], -axis.sent[0], 0);
    over.advance(Request::none, 0, period, state);
  }
}

void motors_come_to_rest_within_the_stopping_time() {
  const Supervisor<double> over = supervisor<double>();
  for (const Request request : {Request::pause, Request::disable, Request::none}) {
    SupervisorState<double> state{};
    state.operating = OperatingState::enabled;
    CommandState<double> axis{{20, -20}, {}, 0};
    over.advance(request, request == Request::none ? bit(Fault::tendon_break) : 0U, period, state);
    const double wanted[2] = {20, -20};
    for (int n = 0; n < 100; ++n) over.command(wanted, {}, period, state, axis);
    CLAIM_NEAR(axis.sent[0], 0, 1e-9);
    CLAIM_NEAR(axis.sent[1], 0, 1e-9);
  }
}

template <class S>
void a_clock_that_stands_still_stops_the_motors() {
  const Supervisor<S> over = supervisor<S>();
  for (const double dt : {0.0, -1.0, double(NAN), double(INFINITY)}) {
    SupervisorState<S> state{};
    state.operating = OperatingState::enabled;
    CommandState<S> axis{{S(20), S(-20)}, {}, 0};
    const S wanted[2] = {S(20), S(-20)};
    for (int n = 0; n < 101; ++n) {
      over.advance(Request::none, bit(Fault::tick_late), S(dt), state);
      over.command(wanted, {}, S(dt), state, axis);
    }
    for (const S sent : axis.sent) CLAIM_NEAR(double(sent), 0, 1e-4);
  }
}

template <class S>
void nothing_but_finite_velocities_is_sent() {
  const Watch<S> checks = watch<S>();
  WatchState<S> seen_state = homed<S>();
  Supervisor<S> over = supervisor<S>(SafeState::neutral);
  SupervisorState<S> state{};
  CommandState<S> axis{};
  std::mt19937 random(seed);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  const S odd[] = {S(NAN),
                   S(INFINITY),
                   S(-INFINITY),
                   std::numeric_limits<S>::max(),
                   std::numeric_limits<S>::lowest(),
                   std::numeric_limits<S>::denorm_min(),
                   S(0),
                   S(-1),
                   S(25),
                   S(1e-3)};
  const auto any = [&] { return odd[random() % 10]; };
  const auto rarely = [&](S usual) { return random() % 20 == 0 ? any() : usual; };
  int enabled = 0;
  for (int n = 0; n < 300'000; ++n) {
    const Measurement<S> seen{rarely(S(0)), {rarely(S(25)), rarely(S(25))}, {rarely(S(0)), rarely(S(0))}};
    const S dt = rarely(S(period));
    const std::uint32_t faults = n % 3 == 0 ? checks.check(seen, axis.sent, dt, seen_state) : 0U;
    over.advance(static_cast<Request>(random() % 7), faults, dt, state);
    if (state.operating == OperatingState::enabled) ++enabled;
    const S wanted[2] = {rarely(S(3)), rarely(S(-3))};
    const bool finite = all_finite(wanted[0], wanted[1]);
    const std::uint32_t withheld = axis.withheld;
    CLAIM(over.command(wanted, seen, dt, state, axis) == (finite ? 0U : bit(Fault::not_a_number)));
    if (!finite) CLAIM(state.operating == OperatingState::fault || state.operating == OperatingState::disabled);
    CLAIM(axis.withheld == withheld + (finite ? 0U : 1U));
    for (const S sent : axis.sent) CLAIM(std::fabs(double(sent)) <= 20);
    CLAIM(all_finite(seen_state.trusted.handle_angle, seen_state.trusted.tension[0], seen_state.trusted.tension[1],
                     seen_state.trusted.spool_angle[0], seen_state.trusted.spool_angle[1]));
    // Nor does any of it blind the watch.
    CLAIM(all_finite(seen_state.usual_shortfall, seen_state.stuck_at[0], seen_state.stuck_at[1]));
    for (const auto& one : seen_state.following) CLAIM(all_finite(one.behind, one.speed, one.fastest));
  }
  CLAIM(enabled > 10'000);
  // Not even with constants or a state that are no numbers.
  S* const constants[] = {&over.speed_limit,   &over.acceleration_limit,
                          &over.engage_time,   &over.tension_limit,
                          &over.neutral_speed, &over.hold_time,
                          &over.relief,        &over.period,
                          &axis.sent[0],       &axis.sent[1],
                          &state.since};
  for (int n = 0; n < 100'000; ++n) {
    over = supervisor<S>(SafeState::neutral);
    *constants[random() % 11] = any();
    const Measurement<S> seen{rarely(S(0)), {rarely(S(25)), rarely(S(25))}, {rarely(S(1)), rarely(S(-1))}};
    const S wanted[2] = {rarely(S(3)), rarely(S(-3))};
    state.operating = static_cast<OperatingState>(random() % 4);
    over.command(wanted, seen, rarely(S(period)), state, axis);
    for (const S sent : axis.sent) CLAIM(is_finite(sent));
  }
}

void settings_that_are_no_numbers_are_refused() {
  Watch<double> checks = watch<double>();
  CLAIM(checks.valid());
  double* const of_watch[] = {&checks.limit[3].threshold,
                              &checks.limit[12].persistence,
                              &checks.spool_jump.threshold,
                              &checks.drive.speed_limit,
                              &checks.mean_band,
                              &checks.window,
                              &checks.period,
                              &checks.load_cell_range};
  Supervisor<double> over = supervisor<double>();
  CLAIM(over.valid());
  double* const of_supervisor[] = {&over.speed_limit, &over.acceleration_limit, &over.engage_time, &over.relief,
                                   &over.period};
  for (const double bad : {double(NAN), double(INFINITY), -1.0}) {
    for (double* one : of_watch) {
      const double good = *one;
      *one = bad;
      CLAIM(!checks.valid());
      *one = good;
    }
    for (double* one : of_supervisor) {
      const double good = *one;
      *one = bad;
      CLAIM(!over.valid());
      *one = good;
    }
  }
}

template <class S>
void a_tendon_above_its_limit_is_only_unwound() {
  const Supervisor<S> over = supervisor<S>();
  std::mt19937 random(seed);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  std::uniform_real_distribution<double> pick(-20, 20);
  SupervisorState<S> state{};
  CommandState<S> axis{};
  bool unwound = false;
  for (int n = 0; n < 100'000; ++n) {
    const Measurement<S> seen{S(0), {S(n % 100 < 50 ? 101 : 80), S(n % 100 < 50 ? 101 : 95)}, {}};
    const S wanted[2] = {S(pick(random)), S(pick(random))};
    const auto request = random() % 300 == 0 ? static_cast<Request>(random() % 7) : Request::none;
    over.advance(request, random() % 3000 == 0 ? bit(Fault::over_tension) : 0, S(period), state);
    over.command(wanted, seen, S(period), state, axis);
    if (n % 100 < 50) CLAIM(axis.sent[0] <= 0);
    // 95 N is not yet well below the limit.
    CLAIM(axis.sent[1] <= 0);
    if (axis.sent[1] < S(-1)) unwound = true;
  }
  CLAIM(unwound);
}

void over_tension_is_relieved_to_well_below_the_limit_and_no_further() {
  const Supervisor<double> over = supervisor<double>();
  for (const double overshoot : {5.0, 50.0}) {
    SupervisorState<double> state{};
    state.operating = OperatingState::enabled;
    CommandState<double> axis{};
    Measurement<double> seen{0, {25, 25}, {0.1, 0.1}};
    over.advance(Request::none, bit(Fault::over_tension), period, state);
    const double wanted[2] = {5, 5};
    for (int n = 0; n < 10'000; ++n) {
      seen.tension[0] = 100 + overshoot + stiffness * spool_radius * (seen.spool_angle[0] - 0.1);
      over.command(wanted, seen, period, state, axis);
      over.advance(Request::none, 0, period, state);
      for (int i = 0; i < 2; ++i) seen.spool_angle[i] += axis.sent[i] * period;
    }
    CLAIM(seen.spool_angle[1] == 0.1);
    CLAIM_NEAR(axis.sent[0], 0, 1e-12);
    if (overshoot < 10)
      CLAIM_NEAR(seen.tension[0], 90, 0.1);
    else
      CLAIM_NEAR(seen.spool_angle[0], -0.2, 1e-3);
  }
}

void a_load_cell_or_spool_that_is_not_believed_moves_no_motor() {
  const Supervisor<double> over = supervisor<double>(SafeState::neutral);
  for (int n = 0; n < fault_count; ++n) {
    const std::uint32_t fault = bit(static_cast<Fault>(n));
    for (const double tension : {25.0, 95.0, 150.0}) {
      SupervisorState<double> state{};
      state.operating = OperatingState::enabled;
      CommandState<double> axis{};
      // The agonist's spool would creep by unwinding, the antagonist's by winding.
      const Measurement<double> seen{0, {tension, tension}, {0.5, -0.5}};
      over.advance(Request::none, fault, period, state);
      const double wanted[2] = {5, 5};
      for (int k = 0; k < 2000; ++k) {
        over.command(wanted, seen, period, state, axis);
        over.advance(Request::none, fault, period, state);
      }
      const Distrust distrust = distrusted(fault);
      const bool high = tension > 100;
      const bool unwinds = !distrust.spool && !(high && distrust.tension);
      const bool winds = !distrust.spool && !distrust.tension && tension < 90;
      CLAIM_NEAR(axis.sent[0], unwinds ? -0.2 : 0, 1e-12);
      CLAIM_NEAR(axis.sent[1], winds ? 0.2 : 0, 1e-12);
      const Measurement<double> blind{0, {tension, tension}, {NAN, NAN}};
      for (int k = 0; k < 100; ++k) over.command(wanted, blind, period, state, axis);
      CLAIM_NEAR(axis.sent[0], 0, 1e-12);
      CLAIM_NEAR(axis.sent[1], 0, 1e-12);
    }
  }
}

void neutral_is_crept_to_after_holding() {
  const Supervisor<double> over = supervisor<double>(SafeState::neutral);
  SupervisorState<double> state{};
  state.operating = OperatingState::enabled;
  CommandState<double> axis{};
  Measurement<double> seen{0, {25, 25}, {0.6, -0.3}};
  over.advance(Request::none, bit(Fault::encoder_dropout), period, state);
  const double wanted[2] = {5, 5};
  for (int n = 0; n * period < 10; ++n) {
    over.command(wanted, seen, period, state, axis);
    over.advance(Request::none, 0, period, state);
    if (n * period < 0.499) CLAIM(axis.sent[0] == 0 && axis.sent[1] == 0);
    for (int i = 0; i < 2; ++i) {
      CLAIM(std::fabs(axis.sent[i]) <= 0.2 + 1e-12);
      seen.spool_angle[i] += axis.sent[i] * period;
    }
  }
  CLAIM_NEAR(seen.spool_angle[0], 0, 1e-6);
  CLAIM_NEAR(seen.spool_angle[1], 0, 1e-6);
}

void faults_have_names_and_bits_of_their_own() {
  std::uint32_t all = 0;
  for (int n = 0; n < fault_count; ++n) {
    const auto fault = static_cast<Fault>(n);
    CLAIM((all & bit(fault)) == 0);
    all |= bit(fault);
    for (int m = 0; m < n; ++m) CLAIM(std::strcmp(name(fault), name(static_cast<Fault>(m))) != 0);
  }
  CLAIM(std::strcmp(name(Fault::load_cell_drift), "load_cell_drift") == 0);
  CLAIM(std::strcmp(name(static_cast<Fault>(fault_count)), "unknown") == 0);
}

void the_recorder_keeps_what_led_to_a_fault_in_order() {
  FlightRecorder<int, 12, 3, 4> recorder{};
  CLAIM(recorder.size() == 0 && recorder.fault_place() == -1);
  for (const int fault_at : {0, 1, 5, 100, 101, 102}) {
    recorder.rearm();
    for (int n = 0; n < fault_at; ++n) recorder.note(n, false);
    CLAIM(!recorder.frozen());
    int ticks = 0;
    // The fault holds, goes and comes again: only its first tick counts.
    for (int n = fault_at; !recorder.frozen() && ticks < 100; ++n, ++ticks) recorder.note(n, ticks % 4 == 0);
    CLAIM(ticks == 4 * 3 + 1);
    const int size = recorder.size();
    const int place = recorder.fault_place();
    CLAIM(size == std::min(12, (fault_at + 2) / 3 + 5));
    CLAIM(place == size - 5);
    CLAIM(recorder[place] == fault_at);
    for (int n = place; n + 1 < size; ++n) CLAIM(recorder[n + 1] - recorder[n] == 3);
    for (int n = 0; n < place; ++n) CLAIM(recorder[n] == (place - n > 0 ? ((fault_at + 2) / 3 - (place - n)) * 3 : 0));
    const int last = recorder[size - 1];
    recorder.note(-7, true);
    CLAIM(recorder.size() == size && recorder[size - 1] == last);
  }
  recorder.rearm();
  CLAIM(recorder.size() == 0 && !recorder.frozen() && recorder.fault_place() == -1);
}

void a_recorder_that_keeps_nothing_after_freezes_on_the_fault() {
  FlightRecorder<int, 4> recorder{};
  for (int n = 0; n < 10; ++n) recorder.note(n, n == 6);
  CLAIM(recorder.frozen() && recorder.size() == 4 && recorder.fault_place() == 3);
  for (int n = 0; n < 4; ++n) CLAIM(recorder[n] == 3 + n);
}

template <class S>
void in_one_number_type() {
  each_fault_is_found_in_time_and_by_its_name<S>();
  below_its_threshold_nothing_is_found<S>();
  a_condition_shorter_than_its_persistence_is_no_fault<S>();
  a_slack_tendon_under_a_large_load_is_not_a_drifting_cell<S>();
  a_first_sample_out_of_range_is_not_trusted<S>();
  one_sample_after_a_gap_has_not_lasted<S>();
  a_sample_that_is_no_number_hides_no_fault<S>();
  a_jump_is_told_once<S>();
  motors_that_a_gap_has_stopped_are_followed_from_rest<S>();
  a_late_tick_is_a_fault_at_once<S>();
  a_single_bad_sample_is_counted_but_no_fault<S>();
  nothing_is_said_of_the_pair_before_homing<S>();
  a_threshold_of_zero_switches_a_check_off<S>();
  counters_saturate<S>();
  normal_work_is_no_fault<S>();
  no_transition_jerks<S>();
  a_clock_that_stands_still_stops_the_motors<S>();
  nothing_but_finite_velocities_is_sent<S>();
  a_tendon_above_its_limit_is_only_unwound<S>();
  a_slipped_spool_is_cleared_by_homing_anew<S>();
}

int main() {
  in_one_number_type<double>();
  in_one_number_type<float>();
  every_state_answers_every_request_as_it_should();
  a_fault_latches_and_is_cleared_once_its_cause_is_gone();
  homing_ends_in_holding();
  what_is_wanted_is_faded_in();
  motors_come_to_rest_within_the_stopping_time();
  settings_that_are_no_numbers_are_refused();
  over_tension_is_relieved_to_well_below_the_limit_and_no_further();
  a_load_cell_or_spool_that_is_not_believed_moves_no_motor();
  neutral_is_crept_to_after_holding();
  faults_have_names_and_bits_of_their_own();
  the_recorder_keeps_what_led_to_a_fault_in_order();
  a_recorder_that_keeps_nothing_after_freezes_on_the_fault();
  return claims::report();
}

// Claims about the watch: every fault is found in time and by its own name, and normal work is no fault.

#include "tenodesis/watch.hpp"

#include <cstdio>
#include <random>

#include "claim.hpp"
#include "watched_bench.hpp"

/// A fault injected into a bench and its readings, at a time after its start and a strength of which 1 is well beyond
/// the limit; called twice per tick, before and after reading.
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
    const std::uint32_t now = checks.check(measurement_as<Measurement<S>>(seen), sent, S(period), state);
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
    // The other tendon still carries a load.
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
    // A cell's gain that changes at once, and two cells that are exchanged under a load.
    {Fault::load_cell_drift, 0.01, 0.5, 0.5,
     [](double, double strength, Bench&, auto& seen) { seen.tension[0] += 10 * strength; }},
    {Fault::load_cell_drift, 0.2, 0.1, 0.5,
     [](double time, double strength, Bench& bench, auto& seen) {
       bench.load = 20 * strength * std::min(1.0, time / 0.1);
       if (time > 0.19) std::swap(seen.tension[0], seen.tension[1]);
     }},
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
    // A motor that stands still; slow ones take longer to distinguish from an encoder's steps.
    {Fault::motor_not_following, 0.030, 0.03, 0.5,
     [](double, double strength, Bench& bench, auto&) {
       bench.command[0] = strength;
       bench.stalled[0] = true;
     }},
    {Fault::motor_not_following, 0.050, 0.07, 0.5,
     [](double, double strength, Bench& bench, auto&) {
       bench.command[1] = -0.4 * strength;
       bench.stalled[1] = true;
     }},
    // A motor that runs away.
    {Fault::motor_not_following, 0.030, 0.03, 0.5,
     [](double, double strength, Bench& bench, auto&) { bench.spool[1].angle += strength * period / 2; }},
    // An encoder that loses counts.
    {Fault::motor_not_following, 0.4, 0.06, 6.0,
     [](double time, double strength, Bench&, auto& seen) { seen.spool_angle[0] -= 0.05 * strength * time; }},
    {Fault::not_a_number, 0, 0, 0.1,
     [](double, double strength, Bench&, auto& seen) {
       if (strength > 0) seen.spool_angle[0] = NAN;
     }},
};

template <class S>
void each_fault_is_found_in_time_and_by_its_name() {
  for (const Case& each : cases) {
    const Found found = inject<S>(each.injection, 1, each.duration);
    CLAIM(found.first == bit(each.fault));
    CLAIM(found.all == bit(each.fault));
    CLAIM(found.after >= 0 && found.after <= each.within + period * 1.01);
    if (found.all != bit(each.fault)) std::printf("    %s: all %x\n", name(each.fault), found.all);
    if (found.first != bit(each.fault) || !(found.after <= each.within + period * 1.01))
      std::printf("    %s: mask %x after %g s\n", name(each.fault), found.first, found.after);
  }
}

template <class S>
void below_its_threshold_nothing_is_found() {
  for (const Case& each : cases) {
    const Found found = inject<S>(each.injection, each.below, each.duration);
    CLAIM(found.all == 0);
    if (found.all != 0) std::printf("    %s: mask %x after %g s\n", name(each.fault), found.all, found.after);
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
    CLAIM(checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state) == 0);
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
      CLAIM(checks.check(measurement_as<Measurement<S>>(seen), sent, S(period), state) == 0);
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
  checks.check(measurement_as<Measurement<S>>(seen), sent, S(period), state);
  CLAIM(state.trusted.handle_angle <= checks.handle_range);
}

template <class S>
void a_single_sample_after_a_gap_is_no_fault() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  const S sent[2]{};
  for (int n = 0; n < 10; ++n) checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state);
  bench.load = 110;
  CLAIM(checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(0.02), state) == 0);
}

template <class S>
void a_sample_that_is_not_a_number_hides_no_fault() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  bench.load = 110;
  const S sent[2]{};
  for (int n = 0; n < 10; ++n) checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state);
  Measurement<double> seen = bench.read();
  seen.handle_angle = NAN;
  CLAIM(checks.check(measurement_as<Measurement<S>>(seen), sent, S(period), state) ==
        (bit(Fault::over_tension) | bit(Fault::not_a_number)));
  CLAIM(checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state) == bit(Fault::over_tension));
}

template <class S>
void a_jump_is_reported_once() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  Bench bench{};
  const S sent[2]{};
  int reported = 0;
  for (int n = 0; n < 1000; ++n) {
    Measurement<double> seen = bench.read();
    if (n >= 100) seen.handle_angle += 0.7;
    const std::uint32_t found = checks.check(measurement_as<Measurement<S>>(seen), sent, S(period), state);
    CLAIM(found == 0 || found == bit(Fault::encoder_jump));
    if (found != 0) ++reported;
  }
  CLAIM(reported == 1);
  CLAIM(state.bad_samples[static_cast<int>(Channel::handle)] == 2);
}

// As when the watchdog has stopped them.
template <class S>
void motors_stopped_by_a_gap_are_followed_from_rest() {
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
      const std::uint32_t found = checks.check(measurement_as<Measurement<S>>(bench.read()), sent, dt, state);
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
    for (int n = 0; n < 100; ++n)
      CLAIM(checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state) == 0);
    CLAIM(state.late_ticks == 0);
    CLAIM(checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(0.02), state) == 0);
    CLAIM(state.late_ticks == 1);
    CLAIM(checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(dt), state) == bit(Fault::tick_late));
    CLAIM(state.late_ticks == 2);
    CLAIM(checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state) == 0);
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
    CLAIM(checks.check(measurement_as<Measurement<S>>(seen), sent, S(period), state) == 0);
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
void the_pair_is_not_checked_before_homing() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state{};
  Bench bench{};
  const S sent[2]{};
  for (double& left : bench.left) left = 0.01;
  for (int n = 0; n < 10'000; ++n)
    CLAIM(checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state) == 0);
  state.homed = true;
  std::uint32_t found = 0;
  for (int n = 0; n < 100; ++n)
    found |= checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state);
  CLAIM(found == bit(Fault::tendon_break));
  Watch<S>::restart(state);
  CLAIM(state.homed && !state.started && state.confirmed == 0);
  CLAIM(state.count[static_cast<int>(Fault::tendon_break)] == 1);
}

template <class S>
void a_threshold_of_zero_switches_a_check_off() {
  Watch<S> checks = watch<S>();
  for (auto& each : checks.limit) each.threshold = S(0);
  checks.spool_jump.threshold = S(0);
  CLAIM(checks.valid());
  WatchState<S> state = homed<S>();
  std::mt19937 random(seed);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  std::uniform_real_distribution<double> pick(-500, 500);
  const S sent[2] = {S(3), S(-3)};
  for (int n = 0; n < 10'000; ++n) {
    const Measurement<double> seen{pick(random), {pick(random), pick(random)}, {pick(random), pick(random)}};
    CLAIM(checks.check(measurement_as<Measurement<S>>(seen), sent, S(n % 7 == 0 ? 1 : period), state) == 0);
  }
}

template <class S>
void counters_saturate() {
  const Watch<S> checks = watch<S>();
  WatchState<S> state = homed<S>();
  for (auto& each : state.count) each = UINT32_MAX - 1;
  for (auto& each : state.bad_samples) each = UINT32_MAX - 1;
  state.late_ticks = UINT32_MAX - 1;
  Bench bench{};
  const S sent[2]{};
  for (int n = 0; n < 20; ++n) {
    const Measurement<S> nan{S(NAN), {S(NAN), S(NAN)}, {S(NAN), S(NAN)}};
    checks.check(n % 2 == 0 ? measurement_as<Measurement<S>>(bench.read()) : nan, sent, S(1), state);
  }
  CLAIM(state.count[static_cast<int>(Fault::not_a_number)] == UINT32_MAX);
  CLAIM(state.count[static_cast<int>(Fault::tendon_slack)] == UINT32_MAX - 1);
  for (const auto each : state.bad_samples) CLAIM(each == UINT32_MAX);
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
    found |= checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), state);
  }
  CLAIM(found == 0);
  if (found != 0) std::printf("    mask %x\n", found);
  for (const auto each : state.bad_samples) CLAIM(each == 0);
  CLAIM(fastest > 4.9);
  CLAIM(slack > 10'000);
}

template <class S>
void in_one_precision() {
  each_fault_is_found_in_time_and_by_its_name<S>();
  below_its_threshold_nothing_is_found<S>();
  a_condition_shorter_than_its_persistence_is_no_fault<S>();
  a_slack_tendon_under_a_large_load_is_not_a_drifting_cell<S>();
  a_first_sample_out_of_range_is_not_trusted<S>();
  a_single_sample_after_a_gap_is_no_fault<S>();
  a_sample_that_is_not_a_number_hides_no_fault<S>();
  a_jump_is_reported_once<S>();
  motors_stopped_by_a_gap_are_followed_from_rest<S>();
  a_late_tick_is_a_fault_at_once<S>();
  a_single_bad_sample_is_counted_but_no_fault<S>();
  the_pair_is_not_checked_before_homing<S>();
  a_threshold_of_zero_switches_a_check_off<S>();
  counters_saturate<S>();
  normal_work_is_no_fault<S>();
}

int main() {
  in_one_precision<double>();
  in_one_precision<float>();
  return claims::report();
}

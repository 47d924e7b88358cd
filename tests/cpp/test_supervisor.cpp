// Claims about states and commands: no state change jerks, only finite velocities reach a motor, a fault latches.

#include "tenodesis/supervisor.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <random>

#include "claim.hpp"
#include "watched_bench.hpp"

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

void every_state_answers_every_request_as_specified() {
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
void a_slipped_spool_is_cleared_by_homing_again() {
  const Watch<S> checks = watch<S>();
  WatchState<S> watched = homed<S>();
  const Supervisor<S> over = supervisor<S>();
  SupervisorState<S> state{};
  Bench bench{};
  const S sent[2]{};
  const auto run = [&](Request request) {
    for (int n = 0; n < 2000; ++n)
      over.advance(request, checks.check(measurement_as<Measurement<S>>(bench.read()), sent, S(period), watched),
                   S(period), state);
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
        for (S& each : wanted) each = S(30 * pick(random));
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

void wanted_velocities_are_faded_in() {
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
void a_stopped_clock_stops_the_motors() {
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
void only_finite_velocities_are_sent() {
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
    for (const auto& each : seen_state.following) CLAIM(all_finite(each.behind, each.speed, each.fastest));
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

void settings_that_are_not_numbers_are_refused() {
  Watch<double> checks = watch<double>();
  CLAIM(checks.valid());
  double* const of_watch[] = {&checks.limit[3].threshold,
                              &checks.limit[12].persistence,
                              &checks.spool_jump.threshold,
                              &checks.drive.speed_limit,
                              &checks.mean_band,
                              &checks.period,
                              &checks.load_cell_range};
  Supervisor<double> over = supervisor<double>();
  CLAIM(over.valid());
  double* const of_supervisor[] = {&over.speed_limit, &over.acceleration_limit, &over.engage_time, &over.relief,
                                   &over.period};
  for (const double bad : {double(NAN), double(INFINITY), -1.0}) {
    for (double* each : of_watch) {
      const double good = *each;
      *each = bad;
      CLAIM(!checks.valid());
      *each = good;
    }
    for (double* each : of_supervisor) {
      const double good = *each;
      *each = bad;
      CLAIM(!over.valid());
      *each = good;
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
      CLAIM_NEAR(seen.tension[0], 100 * tuning::near_limit, 0.1);
    else
      CLAIM_NEAR(seen.spool_angle[0], -0.2, 1e-3);
  }
}

void a_distrusted_spool_moves_no_motor_and_a_distrusted_load_cell_does_not_keep_them_from_home() {
  Supervisor<double> over = supervisor<double>(SafeState::neutral);
  over.stretch = 1 / (stiffness * spool_radius);
  for (int n = 0; n < fault_count; ++n) {
    const std::uint32_t fault = bit(static_cast<Fault>(n));
    for (const double tension : {0.5, 25.0, 95.0, 150.0}) {
      SupervisorState<double> state{};
      state.operating = OperatingState::enabled;
      CommandState<double> axis{};
      axis.rising = true;
      // The agonist's spool would return by unwinding, the antagonist's by winding.
      const Measurement<double> seen{0, {tension, tension}, {0.5, -0.5}};
      const double rest[2] = {0, 0};
      over.command(rest, seen, period, state, axis);
      over.advance(Request::none, fault, period, state);
      const double wanted[2] = {5, 5};
      for (int k = 0; k < 2000; ++k) {
        over.command(wanted, seen, period, state, axis);
        over.advance(Request::none, fault, period, state);
      }
      const Distrust distrust = distrusted(fault);
      const bool high = tension > 100, hangs = tension < 1;
      const bool stands = distrust.spool || fault == bit(Fault::tendon_break);
      const bool lets_go = distrust.tension || fault == bit(Fault::tendon_slack);
      const bool unwinds = (!stands || (high && !distrust.tension)) && !distrust.spool && !(high && distrust.tension) &&
                           (lets_go || !hangs);
      const bool winds = !stands && !high && (lets_go || tension < 90);
      CLAIM_NEAR(axis.sent[0], unwinds ? -0.2 : 0, 1e-12);
      CLAIM_NEAR(axis.sent[1], winds ? 0.2 : 0, 1e-12);
      const Measurement<double> blind{0, {tension, tension}, {NAN, NAN}};
      for (int k = 0; k < 100; ++k) over.command(wanted, blind, period, state, axis);
      CLAIM_NEAR(axis.sent[0], 0, 1e-12);
      CLAIM_NEAR(axis.sent[1], 0, 1e-12);
    }
  }
}

/// Where the spools are some time (s) after motors so far from home were stopped; stuck: the side of a cell that is.
Measurement<double> returned(const Supervisor<double>& over, Request request, std::uint32_t fault,
                             CommandState<double> axis = {}, double load = 0, double seconds = 10, int stuck = -1) {
  SupervisorState<double> state{};
  state.operating = OperatingState::enabled;
  Measurement<double> seen{0, {}, {0.6, -0.3}};
  const double wanted[2] = {5, 5};
  double lowest = 1;
  for (int n = 0; n * period < seconds; ++n) {
    const double mean = pretension + stiffness * spool_radius * (seen.spool_angle[0] + seen.spool_angle[1]) / 2;
    // Where a tendon hangs, the other carries the load alone.
    for (int i = 0; i < 2; ++i)
      if (i != stuck || n == 0) seen.tension[i] = std::fmax(mean, std::fabs(load)) + (i == agonist ? load : -load);
    const OperatingState before = state.operating;
    over.advance(n == 0 ? request : Request::none, n == 0 ? fault : 0, period, state);
    if (state.operating != before) over.part(before, state, axis);
    over.command(wanted, seen, period, state, axis);
    if (n * period < 0.499) CLAIM(axis.sent[0] == 0 && axis.sent[1] == 0);
    for (int i = 0; i < 2; ++i) {
      CLAIM(std::fabs(axis.sent[i]) <= 0.2 + 1e-12);
      seen.spool_angle[i] += axis.sent[i] * period;
    }
    lowest = std::fmin(lowest, (seen.spool_angle[0] + seen.spool_angle[1]) / 2);
  }
  seen.handle_angle = lowest;
  return seen;
}

void what_stops_returns_home_from_below_unless_it_is_to_hold() {
  Supervisor<double> over = supervisor<double>(SafeState::neutral);
  over.stretch = 1 / (stiffness * spool_radius);
  over.relief = pretension * over.stretch / 2;
  const auto home = [](const Measurement<double>& at) {
    return std::fabs(at.spool_angle[0]) < 1.1e-3 && std::fabs(at.spool_angle[1]) < 1.1e-3;
  };
  const auto stays = [](const Measurement<double>& at) { return at.spool_angle[0] == 0.6; };
  const std::uint32_t lost = bit(Fault::encoder_dropout);
  for (const Request request : {Request::pause, Request::disable}) {
    const Measurement<double> at = returned(over, request, 0);
    CLAIM(home(at));
    // Both tendons end wound alike: friction must not hold the tip where the motors had brought it.
    CLAIM(at.handle_angle < -0.9 * tuning::below_home * over.relief);
    // What moves the tip goes first, as fast as it may: a load that goes meanwhile finds as little as can be.
    const double time = over.hold_time + 0.45 / over.neutral_speed + 1;
    const Measurement<double> soon = returned(over, request, 0, {}, 0, time);
    CLAIM_NEAR(soon.spool_angle[0], soon.spool_angle[1], 5e-3);
    CLAIM_NEAR(soon.spool_angle[0], 0.15 - over.neutral_speed, 0.05);
  }
  CLAIM(home(returned(over, Request::none, lost)));
  over.safe_state = SafeState::hold;
  CLAIM(stays(returned(over, Request::none, lost)));
  over.stop = StopMode::hold;
  CLAIM(stays(returned(over, Request::pause, 0)));
  // Nobody knows where home is, or it is elsewhere.
  over.stop = StopMode::back;
  over.safe_state = SafeState::neutral;
  CommandState<double> axis{};
  axis.knows_home = false;
  CLAIM(stays(returned(over, Request::pause, 0, axis)) && stays(returned(over, Request::none, lost, axis)));
  axis.knows_home = true;
  axis.kept = true;
  CLAIM(stays(returned(over, Request::pause, 0, axis)) && stays(returned(over, Request::none, lost, axis)));
  axis.kept = false;
  axis.home[0] = axis.home[1] = 0.3;
  CLAIM_NEAR(returned(over, Request::disable, 0, axis).spool_angle[1], 0.3, 1.1e-3);
  // Under a load, no tendon is let out until it hangs.
  CLAIM(home(returned(over, Request::disable, 0, {}, 0.8 * pretension)));
  CLAIM(returned(over, Request::disable, 0, {}, 0.8 * pretension).handle_angle > -0.9 * 1.2 * over.relief);
  // Nor where its cell is stuck: once it hangs, the other tendon loses no more.
  for (const double load : {-0.5 * pretension, 0.5 * pretension}) {
    const Measurement<double> at = returned(over, Request::none, bit(Fault::load_cell_stuck), {}, load, 10, load > 0);
    CLAIM(home(at));
    const double check = tuning::hanging * pretension * over.stretch;
    CLAIM_NEAR(at.handle_angle, -0.5 * pretension * over.stretch - check, 1.2 * check);
  }
}

void motors_at_home_do_not_move_when_they_are_stopped() {
  const Supervisor<double> over = supervisor<double>(SafeState::neutral);
  for (const std::uint32_t fault : {0U, bit(Fault::encoder_dropout)}) {
    SupervisorState<double> state{};
    state.operating = OperatingState::enabled;
    CommandState<double> axis{};
    const double wanted[2] = {0, 0};
    for (int n = 0; n < 4000; ++n) {
      const OperatingState before = state.operating;
      over.advance(n == 0 ? Request::pause : Request::none, n == 100 ? fault : 0, period, state);
      if (state.operating != before) over.part(before, state, axis);
      over.command(wanted, {0, {25, 25}, {5e-4, -5e-4}}, period, state, axis);
      CLAIM(std::fabs(axis.sent[0]) < 3e-3 && std::fabs(axis.sent[1]) < 3e-3);
    }
  }
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

template <class S>
void in_one_precision() {
  a_slipped_spool_is_cleared_by_homing_again<S>();
  no_transition_jerks<S>();
  a_stopped_clock_stops_the_motors<S>();
  only_finite_velocities_are_sent<S>();
  a_tendon_above_its_limit_is_only_unwound<S>();
}

struct Answer {
  double velocity{};  ///< sent to the antagonist at the end, rad/s
  double turned{};    ///< angle of the antagonist, rad
  double ran{};       ///< of the agonist, rad
  bool cut{};
};

/// After the agonist's spool has run away at a speed, rad/s; ahead: how far either had turned unasked before, rad.
Answer answer_to_a_spool_that_turns(double speed, double tension_per_radian, std::uint32_t also = 0,
                                    const double (&ahead)[2] = {0, 0}) {
  const Supervisor<double> over = supervisor<double>();
  SupervisorState<double> state{};
  CommandState<double> axis{};
  Measurement<double> measured{0, {pretension, pretension}, {}};
  const double rest[2] = {0, 0};
  over.advance(Request::enable, 0, period, state);
  over.command(rest, measured, period, state, axis);
  for (int n = 0; n < 200; ++n) {
    measured.spool_angle[agonist] += speed * period;
    measured.spool_angle[antagonist] += axis.sent[antagonist] * period;
    for (double& tension : measured.tension)
      tension =
          pretension + tension_per_radian * (measured.spool_angle[agonist] + measured.spool_angle[antagonist]) / 2;
    over.advance(Request::none, bit(Fault::motor_not_following) | also, period, state);
    // As the controller does when the fault is named.
    if (n == 0) std::copy(ahead, ahead + 2, axis.ahead);
    over.command(rest, measured, period, state, axis);
  }
  return {axis.sent[antagonist], measured.spool_angle[antagonist], measured.spool_angle[agonist], state.cut_power};
}

void a_partner_goes_along_with_a_motor_that_runs_away_and_the_supply_is_cut() {
  for (const double speed : {-2.0, 2.0}) {
    const double per_radian = stiffness * spool_radius, unnoticed = speed * 0.01;
    const Answer found = answer_to_a_spool_that_turns(speed, per_radian);
    CLAIM_NEAR(found.velocity, speed, 0.1);
    CLAIM_NEAR(found.turned, found.ran, 0.01);
    CLAIM(found.cut);
    // An encoder that turns alone leaves the tensions as they are.
    CLAIM(answer_to_a_spool_that_turns(speed, 0).velocity == 0);
    CLAIM(answer_to_a_spool_that_turns(speed, per_radian, bit(Fault::load_cell_range)).velocity == 0);
    // What ran before that was noticed is made up for.
    const Answer whole = answer_to_a_spool_that_turns(speed, per_radian, 0, {unnoticed, 0});
    CLAIM_NEAR(whole.turned - found.turned, unnoticed, 0.2 * abs(unnoticed));
    // Exchanged motors both turn as they were not sent; the partner would drive the other.
    CLAIM(answer_to_a_spool_that_turns(speed, per_radian, 0, {unnoticed, -unnoticed}).turned == 0);
  }
  const Supervisor<double> over = supervisor<double>();
  SupervisorState<double> state{};
  over.advance(Request::enable, 0, period, state);
  for (int n = 0; n < 50; ++n) over.advance(Request::none, bit(Fault::motor_not_following), period, state);
  CLAIM(!state.cut_power);
  for (int n = 0; n < 100; ++n) over.advance(Request::none, bit(Fault::motor_not_following), period, state);
  CLAIM(state.cut_power);
  over.advance(Request::clear, 0, period, state);
  CLAIM(!state.cut_power);
}

/// Stroke that is given back across, rad, after a fault while the motors are so far across and press.
double given_back(Fault fault, double across) {
  const Supervisor<double> over = supervisor<double>();
  SupervisorState<double> state{};
  CommandState<double> axis{};
  Measurement<double> measured{0, {pretension, pretension}, {across, -across}};
  const double rest[2] = {0, 0};
  over.advance(Request::enable, 0, period, state);
  over.command(rest, measured, period, state, axis);
  axis.pressing = across;
  over.advance(Request::none, bit(fault), period, state);
  double moved = 0;
  for (double time = 0; time < over.hold_time + 3; time += period) {
    over.advance(Request::none, 0, period, state);
    over.command(rest, measured, period, state, axis);
    CLAIM_NEAR(axis.sent[agonist], -axis.sent[antagonist], 1e-12);
    CLAIM(time < over.hold_time - 2 * period ? axis.sent[agonist] == 0 : abs(axis.sent[agonist]) <= over.neutral_speed);
    moved -= axis.sent[agonist] * period;
  }
  return moved;
}

void a_tip_that_presses_is_let_go_of_after_a_fault_unless_a_motor_does_not_obey() {
  for (const double across : {-0.2, 0.2}) {
    for (const Fault fault : {Fault::load_cell_stuck, Fault::encoder_jump, Fault::tick_late})
      CLAIM_NEAR(given_back(fault, across), across, 0.003);
    CLAIM(given_back(Fault::motor_not_following, across) == 0);
  }
}

int main() {
  a_tip_that_presses_is_let_go_of_after_a_fault_unless_a_motor_does_not_obey();
  a_partner_goes_along_with_a_motor_that_runs_away_and_the_supply_is_cut();
  in_one_precision<double>();
  in_one_precision<float>();
  every_state_answers_every_request_as_specified();
  a_fault_latches_and_is_cleared_once_its_cause_is_gone();
  homing_ends_in_holding();
  wanted_velocities_are_faded_in();
  motors_come_to_rest_within_the_stopping_time();
  settings_that_are_not_numbers_are_refused();
  over_tension_is_relieved_to_well_below_the_limit_and_no_further();
  a_distrusted_spool_moves_no_motor_and_a_distrusted_load_cell_does_not_keep_them_from_home();
  what_stops_returns_home_from_below_unless_it_is_to_hold();
  motors_at_home_do_not_move_when_they_are_stopped();
  faults_have_names_and_bits_of_their_own();
  return claims::report();
}

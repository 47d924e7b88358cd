#pragma once
// The supervisor: operating states, requests, latched faults, and the limits on every velocity that is sent.

#include "tenodesis/control.hpp"
#include "tenodesis/fault.hpp"
#include "tenodesis/tuning.hpp"

namespace tenodesis {

/// As in the Collaborative Robotics Toolkit.
enum class OperatingState : std::uint8_t { disabled, enabled, paused, fault };

enum class Request : std::uint8_t {
  none,
  enable,   ///< from disabled, unless a fault is present
  disable,  ///< from enabled and paused: motors stop, then do what StopMode says
  pause,    ///< from enabled: the same, to be resumed
  resume,   ///< from paused
  home,     ///< from disabled, enabled and paused: enabled and homing, until finish_homing
  clear,    ///< from fault to disabled, once no fault is present
};

/// What the motors do in a fault, after they have come to rest.
enum class SafeState : std::uint8_t {
  hold,     ///< they stand: the tendons keep their lengths, and the instrument works by hand
  neutral,  ///< they return home, to where both tendons had their pretension
};

/// What they do when they are stopped, after they have come to rest.
enum class StopMode : std::uint8_t {
  back,  ///< they return home
  hold,  ///< they stand
};

template <class S>
struct SupervisorState {
  OperatingState operating{OperatingState::disabled};
  bool homing{};            ///< velocities come from homing
  std::uint32_t present{};  ///< faults of this tick
  std::uint32_t first{};    ///< faults that led to the fault state
  std::uint32_t faults{};   ///< those and all since
  bool cut_power{};         ///< a motor does not obey: only a relay in its supply stops it
  S since{};                ///< time in this state, s
};

/// Velocities sent to one axis.
template <class S>
struct CommandState {
  S sent[2]{};               ///< rad/s
  bool over_tension[2]{};    ///< from above the limit until well below it
  S held[2]{};               ///< spool angles before a fault, rad
  S held_tension[2]{};       ///< tensions then, N
  S leaving[2]{};            ///< velocities sent then, rad/s
  S ahead[2]{};              ///< by how far a spool had turned more than was sent then, rad
  S pressing{};              ///< by how far the motors are apart while the tip presses with its limit, rad
  S before[2]{};             ///< spool angles of the last tick, rad
  S speed[2]{};              ///< of the spools, smoothed, rad/s
  std::uint32_t withheld{};  ///< ticks in which a wanted velocity was not finite
  S home[2]{};               ///< spool angles without any stroke of the motors, rad
  S checked{};               ///< how far below home a return was when it was last seen that no tendon hangs, rad
  S checked_tension[2]{};    ///< tensions then, N
  S lost[2]{};               ///< what they had lost since the check before, N
  bool knows_home{true};
  bool returning{};  ///< motors that were stopped, or whose law is off, are to go there
  bool rising{};     ///< they have let out enough, and wind to it
  bool kept{};       ///< they stand wherever they are, until the motors work again or the fault is cleared
};

/// The constants of states and ramps.
template <class S>
struct Supervisor {
  using State = SupervisorState<S>;

  S speed_limit{};         ///< of a spool, rad/s
  S acceleration_limit{};  ///< rad/s^2; speed_limit over it is the longest time to stop
  S engage_time{};         ///< time over which wanted velocities are faded in, s
  S tension_limit{};       ///< above it a tendon is only unwound, N; 0: no limit
  SafeState safe_state{SafeState::hold};
  StopMode stop{StopMode::back};
  S hold_time{};      ///< before they return, s
  S neutral_speed{};  ///< of a return, rad/s
  S relief{};         ///< unwinding past neutral allowed to a tendon above its limit, rad
  S period{};         ///< nominal, of ticks, s
  S stretch{};        ///< of a tendon per its tension, as rotation of its spool, rad/N

  bool valid() const {
    return speed_limit > S(0) && acceleration_limit > S(0) && engage_time >= S(0) && tension_limit >= S(0) &&
           hold_time >= S(0) && neutral_speed >= S(0) && relief >= S(0) && period > S(0) && stretch >= S(0) &&
           all_finite(speed_limit, acceleration_limit, engage_time, tension_limit, hold_time, neutral_speed, relief,
                      period, stretch);
  }

  /// The state after one tick; faults: those present in any axis. A fault takes precedence over any request.
  OperatingState advance(Request request, std::uint32_t faults, const S& dt, State& state) const {
    state.present = faults;
    state.since = smaller(state.since + usable(dt), S(100));
    if (state.operating == OperatingState::fault) {
      state.faults |= faults;
      if (has(faults, Fault::motor_not_following) && state.since > S(0.5 * tuning::watch_window))
        state.cut_power = true;
      if (request == Request::clear && faults == 0) {
        state.first = state.faults = 0;
        state.cut_power = false;
        turn(OperatingState::disabled, state);
      }
    } else if (faults != 0) {
      fail(faults, state);
    } else {
      obey(request, state);
    }
    return state.operating;
  }

  /// Ends homing: the motors hold the pretension until resume engages compensation.
  static void finish_homing(State& state) {
    if (state.homing) turn(OperatingState::paused, state);
  }

  /// Whether motors that have worked return, now that they are stopped or their law is off.
  void part(OperatingState before, const State& state, CommandState<S>& axis) const {
    using enum OperatingState;
    const bool stopped = state.operating == disabled || state.operating == paused;
    if (before == enabled || !stopped) axis.returning = stopped && stop == StopMode::back;
    if (before == fault) axis.returning = stopped && safe_state == SafeState::neutral;
    forget_way(axis);
    if (before == fault || state.operating == enabled) axis.kept = false;
  }

  /// The same where a law has been changed while it works.
  void part_from_law(bool off, CommandState<S>& axis) const {
    axis.returning = off && stop == StopMode::back;
    forget_way(axis);
  }

  void forget_way(CommandState<S>& axis) const {
    axis.rising = false;
    axis.checked = axis.lost[0] = axis.lost[1] = S(0);
  }

  /// How far a spool is from home, rad; zero where that is not known.
  static S away(int i, const Measurement<S>& measured, const CommandState<S>& axis) {
    return axis.knows_home ? measured.spool_angle[i] - axis.home[i] : S(0);
  }

  /// Sets axis.sent, rad/s, which is finite whatever is wanted; returns the mask of faults found in doing so.
  ///
  /// wanted: rad/s; of measured, spool angles and tensions are used.
  std::uint32_t command(const S (&wanted)[2], const Measurement<S>& measured, const S& dt, State& state,
                        CommandState<S>& axis) const {
    const std::uint32_t found = all_finite(wanted[0], wanted[1]) ? 0U : bit(Fault::not_a_number);
    if (found != 0) {
      count(axis.withheld);
      state.present |= found;
      if (state.operating == OperatingState::fault) state.faults |= found;
      fail(found, state);
    }
    for (int i = 0; i < 2; ++i) {
      // A tension that is not a number has no effect here.
      const bool over = is_finite(measured.tension[i]) && measured.tension[i] > tension_limit;
      remember(i, measured, usable(dt), state, axis);
      if (tension_limit > S(0) && over) axis.over_tension[i] = true;
      if (measured.tension[i] < relaxed()) axis.over_tension[i] = false;
      const S target = clamp(target_of(i, wanted[i], measured, state, axis), -speed_limit, speed_limit);
      const S most = acceleration_limit * usable(dt);
      const S ramped = axis.sent[i] + clamp(target - axis.sent[i], -most, most);
      const S sent = clamp(ramped, -speed_limit, axis.over_tension[i] ? S(0) : speed_limit);
      axis.sent[i] = is_finite(sent) ? sent : S(0);
    }
    if (state.operating == OperatingState::fault || axis.returning) follow_return(measured, state, axis);
    if (state.operating == OperatingState::fault)
      for (int i = 0; i < 2; ++i) state.cut_power = state.cut_power || runs_away(i, measured, state, axis);
    if (relaxes(state, axis)) axis.pressing = axis.pressing - crept(axis.pressing) * usable(dt);
    return found;
  }

 private:
  // Of a spool, rad.
  static constexpr S at_home = S(1e-3);

  // Whether a motor that does not follow goes on so fast that its partner comes too late: before the supply would be
  // cut, a tendon would get slack, or come to its limit.
  bool runs_away(int i, const Measurement<S>& measured, const State& state, const CommandState<S>& axis) const {
    if (!has(state.faults, Fault::motor_not_following)) return false;
    const S moved = measured.spool_angle[i] - axis.held[i], speed = axis.speed[i] - axis.sent[i];
    // As far as it may take to stop, it has not run away.
    const S stopping = S(0.02) + S(0.02) * abs(axis.leaving[i]);  // rad; s of its loop's lag
    const auto& before = axis.held_tension;
    const S room = speed > S(0) ? tension_limit - larger(before[0], before[1]) : smaller(before[0], before[1]);
    return abs(moved) > stopping && abs(speed) * S(0.5 * tuning::watch_window) > larger(room, S(0)) * stretch;
  }

  // A clock that has stopped must not keep the motors running.
  S usable(const S& dt) const { return dt > S(0) && is_finite(dt) ? dt : period; }

  S relaxed() const { return S(tuning::near_limit) * tension_limit; }

  // What a fault is judged by: where the spools were before, and how fast they turn.
  static void remember(int i, const Measurement<S>& measured, const S& dt, const State& state, CommandState<S>& axis) {
    const S angle = measured.spool_angle[i];
    if (!all_finite(angle, measured.tension[i])) return;
    if (state.operating == OperatingState::fault) {
      const auto smoothing = S(0.004);  // s
      axis.speed[i] = axis.speed[i] + ((angle - axis.before[i]) - axis.speed[i] * dt) / (smoothing + dt);
    } else {
      axis.held[i] = angle;
      axis.held_tension[i] = measured.tension[i];
      axis.leaving[i] = axis.speed[i] = axis.sent[i];
    }
    axis.before[i] = angle;
  }

  static void turn(OperatingState to, State& state) {
    state.operating = to;
    state.homing = false;
    state.since = S(0);
  }

  static void fail(std::uint32_t faults, State& state) {
    if (state.operating != OperatingState::enabled && state.operating != OperatingState::paused) return;
    state.first = state.faults = faults;
    turn(OperatingState::fault, state);
  }

  static void obey(Request request, State& state) {
    using enum OperatingState;
    const OperatingState from = state.operating;
    switch (request) {
      case Request::enable:
        if (from == disabled) turn(enabled, state);
        return;
      case Request::disable:
        if (from != disabled) turn(disabled, state);
        return;
      case Request::pause:
        if (from == enabled) turn(paused, state);
        return;
      case Request::resume:
        if (from == paused) turn(enabled, state);
        return;
      case Request::home:
        turn(enabled, state);
        state.homing = true;
        return;
      case Request::none:
      case Request::clear:
        return;
    }
  }

  S target_of(int i, const S& wanted, const Measurement<S>& measured, const State& state,
              const CommandState<S>& axis) const {
    switch (state.operating) {
      case OperatingState::enabled:
        if (axis.returning) return return_velocity(i, measured, true, axis);
        return state.since < engage_time ? wanted * (state.since / engage_time) : wanted;
      case OperatingState::fault:
        return safe_velocity(i, measured, state, axis);
      case OperatingState::disabled:
      case OperatingState::paused:
        break;
    }
    if (!axis.returning || state.since < hold_time) return S(0);
    return return_velocity(i, measured, !distrusted(state.present).tension, axis);
  }

  // A return first goes below home by a common stroke, so that at last both tendons are wound alike: friction, which
  // would hold the tip where the motors had brought it, then acts on both alike, and is weak where they turn back.
  S dip() const { return S(tuning::below_home) * relief; }
  S hangs() const { return stretch > S(0) ? S(2) * S(tuning::hanging) * relief / stretch : S(0); }
  bool loose(const Measurement<S>& measured) const {
    return smaller(measured.tension[0], measured.tension[1]) < hangs();
  }
  // Where one cell is not trusted, and nobody knows which, its tendon may hang unseen. The tip then goes with its load,
  // and the other tendon, which had lost tension all the way, loses no more.
  bool hangs_unseen(const Measurement<S>& measured, const S& below, CommandState<S>& axis) const {
    if (below < axis.checked + stretch * hangs()) return false;
    bool found = false;
    for (int i = 0; i < 2; ++i) {
      const S lost = axis.checked_tension[i] - measured.tension[i];
      if (abs(lost) < S(0.5) * axis.lost[i]) found = true;
      axis.lost[i] = lost > S(0.5) * hangs() ? lost : S(0);
      axis.checked_tension[i] = measured.tension[i];
    }
    axis.checked = below;
    return found;
  }

  void follow_return(const Measurement<S>& measured, const State& state, CommandState<S>& axis) const {
    const S away0 = away(0, measured, axis), away1 = away(1, measured, axis);
    const auto at = [&](const S& place) { return abs(away0 - place) < at_home && abs(away1 - place) < at_home; };
    const bool fault = state.operating == OperatingState::fault;
    const Distrust distrust = distrusted(fault ? state.faults : state.present);
    // On the way down they pass it.
    const bool stands = abs(axis.sent[0]) + abs(axis.sent[1]) <= S(0);
    const bool there = at(S(0)) && (axis.rising || stands);
    if (there || distrust.spool) axis.returning = false;
    const S below = -S(0.5) * (away0 + away1);
    if (below < S(0) || abs(away0 - away1) > S(10) * at_home) {
      axis.checked = below;
      for (int i = 0; i < 2; ++i) axis.checked_tension[i] = measured.tension[i];
    }
    const bool unseen = hangs_unseen(measured, below, axis) && distrust.tension;
    if (there || at(-dip()) || loose(measured) || unseen) axis.rising = true;
  }

  // No spool faster than neutral_speed, and what moves the tip first: a load that goes meanwhile finds as little of the
  // stroke as can be. By tensions, where these are trusted, no tendon is wound above its limit, nor let out until it
  // hangs: of what both still have to let out, neither is.
  S return_velocity(int i, const Measurement<S>& measured, bool by_tension, const CommandState<S>& axis) const {
    if (axis.kept || !axis.knows_home || !all_finite(measured.spool_angle[0], measured.spool_angle[1])) return S(0);
    const S place = axis.rising ? S(0) : -dip();
    const S left[2]{place - away(0, measured, axis), place - away(1, measured, axis)};
    const S apart = crept((left[i] - left[1 - i]) * S(0.5));
    const S room = neutral_speed - abs(apart);
    const S common = clamp(crept((left[0] + left[1]) * S(0.5)), -room, room);
    if (!by_tension) return common + apart;
    const S kept = loose(measured) && common < S(0) ? apart : common + apart;
    if (kept > S(0)) return tension_limit > S(0) && !(measured.tension[i] < relaxed()) ? S(0) : kept;
    return measured.tension[i] < hangs() ? S(0) : kept;
  }

  S crept(const S& left) const {
    const S rate(5);  // 1/s: slows down near the end
    return clamp(rate * left, -neutral_speed, neutral_speed);
  }

  // A tip that presses on something is let go of after a fault, by what the motors are commanded, unless these do not
  // obey.
  bool relaxes(const State& state, const CommandState<S>& axis) const {
    const S enough = S(1e-3);  // rad
    return state.operating == OperatingState::fault && state.since >= hold_time && abs(axis.pressing) > enough &&
           !has(state.first, Fault::motor_not_following);
  }

  // A motor that runs away moves the tip, unless the other tendon goes along. The tensions show whether it really runs:
  // where its encoder is what is wrong, they stay.
  S following_velocity(int i, const Measurement<S>& measured, const CommandState<S>& axis) const {
    const int other = 1 - i;
    const S moved = measured.spool_angle[other] - axis.held[other];
    const S own = measured.spool_angle[i] - axis.held[i];
    // What it had run before that was noticed is made up for.
    const S behind = moved + axis.ahead[other] - own - axis.ahead[i];
    // As far as it may take to stop, in its ramp and with its speed loop's lag, it has not run away.
    const S left = larger(moved > S(0) ? axis.leaving[other] : -axis.leaving[other], S(0));
    const S stopping = left * (left / acceleration_limit + S(0.01)) + S(0.005);
    const S before = (axis.held_tension[0] + axis.held_tension[1]) * S(0.5);
    const S mean = (measured.tension[0] + measured.tension[1]) * S(0.5);
    const S changed = moved > S(0) ? mean - before : before - mean;
    // With both tendons wound as far, the mean changes by the pretension over twice the relief. What this motor has
    // changed itself shows nothing of the other.
    const S shown = (S(0.2) * abs(moved) + S(0.4) * larger(moved > S(0) ? own : -own, S(0))) / (S(2) * relief);
    const bool runs = changed > before * smaller(shown, S(0.8));
    // Where neither motor has turned as it was sent, they may be exchanged, and this one would drive the other.
    const bool obeys = abs(axis.ahead[i]) <= S(0.5) * abs(axis.ahead[other]);
    if (!(obeys && behind * moved > S(0) && abs(moved) > stopping && runs)) return S(0);
    // A slack tendon lets nothing more out.
    if (moved < S(0) && measured.tension[i] < S(tuning::hanging) * before) return S(0);
    // Where the other tendon gets slack, this one alone holds the tip, which is where its own stretch says.
    const S tight = moved < S(0) ? clamp(measured.tension[other] / (S(0.3) * before), S(0), S(1)) : S(1);
    const S excursion = own - (measured.tension[i] - axis.held_tension[i]) * stretch;
    // The tip swings on a single tendon, which a fast loop would make grow.
    const S rate(40), rate_alone(10);  // 1/s
    const S speed = tight * (axis.speed[other] + rate * behind) - (S(1) - tight) * rate_alone * excursion;
    return is_finite(speed) && !(speed > S(0) && axis.over_tension[i]) ? speed : S(0);
  }

  S safe_velocity(int i, const Measurement<S>& measured, const State& state, const CommandState<S>& axis) const {
    const Distrust distrust = distrusted(state.faults);
    const S angle = measured.spool_angle[i];
    const Distrust otherwise = distrusted(state.faults & ~bit(Fault::motor_not_following));
    if (state.first == bit(Fault::motor_not_following) && !otherwise.spool && !otherwise.tension)
      return following_velocity(i, measured, axis);
    if (relaxes(state, axis)) return i == agonist ? -crept(axis.pressing) : crept(axis.pressing);
    if (distrust.spool || !is_finite(angle)) return S(0);
    // Bounded, since a wrong load cell would have it unwound without end.
    if (axis.over_tension[i]) return !distrust.tension && angle > -relief ? -neutral_speed : S(0);
    // Where a tendon hangs, the motors press the tip against something: they let go of it.
    const bool hangs = state.faults == bit(Fault::tendon_slack);
    // Where a tendon has broken, nothing is as it was at home.
    const bool broken = has(state.faults, Fault::tendon_break);
    if (broken || (safe_state != SafeState::neutral && !hangs) || state.since < hold_time) return S(0);
    return return_velocity(i, measured, !distrust.tension && !hangs, axis);
  }
};

}  // namespace tenodesis

#pragma once
// Fault detection from the sensors, tendons and motors of one axis: a condition that lasts is a fault.
//
// Two tendons check each other. Handle and tip draw on one tendon the length that they let out on the other, so that
// without friction the mean tension is pretension + stiffness * (mean length wound), whatever the handle, the tip and
// the load do. A slack tendon cannot push, so that the mean can only be higher than this; when a load makes one tendon
// slack, the other carries at least twice the mean. Friction keeps a tendon's tension at the spool within exp(+-E) of
// any other along it, E being the exponents of all its contacts, so the relative error of the mean is at most mean_band
// = exp(E) - 1. No load can lower the mean further: a tendon has broken or come loose, a spool has slipped, or a load
// cell is wrong. A broken tendon cannot be distinguished from a slack one only while a load, or the tip's stop, makes
// the other carry both shares.
//
// Within that band, timing distinguishes them: hand and tip have inertia, so that they change the mean over
// milliseconds, while a tendon that breaks or a spool that slips lowers it at once. Nothing but a load cell raises it
// at once, and only two cells that are exchanged reverse the difference of the tensions at once.
//
// The mean cannot distinguish a tendon's change from an encoder's. What a motor was commanded can: its encoder must
// turn by as much, over a moment and in the long run.

#include "tenodesis/control.hpp"
#include "tenodesis/drive.hpp"
#include "tenodesis/fault.hpp"
#include "tenodesis/tuning.hpp"

namespace tenodesis {

/// A check: its threshold, and for how long this must be exceeded to be a fault, s; a threshold of 0 switches it off.
template <class S>
struct Limit {
  S threshold{};
  S persistence{};

  constexpr bool on() const { return threshold > S(0); }
};

/// Sensors, by which bad samples are counted.
enum class Channel : std::uint8_t { handle, agonist_cell, antagonist_cell, agonist_spool, antagonist_spool };

inline constexpr int channel_count = 5;

/// Places where a condition may hold: the two tendons, and the handle.
inline constexpr int at_handle = 2, place_count = 3;

/// A model of a motor, which the motor should follow.
template <class S>
struct Following {
  S speed{};    ///< of the model, rad/s
  S fastest{};  ///< recent largest speed of the model, rad/s
  S behind{};   ///< recent excess of the spool's rotation over the model's, rad
  S astray{};   ///< the same over a longer time, rad
  S path{};     ///< of the model in that time, either way, rad
};

template <class S>
struct WatchState {
  Measurement<S> trusted{};   ///< the last plausible reading of each sensor
  bool started{};             ///< whether there is one
  bool homed{};               ///< spool angles are counted from pretension, so that they determine the mean tension
  std::uint32_t confirmed{};  ///< faults that are present
  S lasted[fault_count][place_count]{};  ///< for how long each condition has held, s
  S since[place_count]{};                ///< age of the trusted angles: spools, handle, s
  S stuck_at[2]{};                       ///< tensions at which the readings may be stuck, N
  S usual_shortfall{};                   ///< recent shortfall of the mean tension, N
  S level{};                             ///< shortfall a moment ago, or before a sudden fall, N
  bool leveled{};                        ///< whether level is known
  S reversed{};  ///< difference of the tensions before it was reversed at once; 0: it was not, N
  Following<S> following[2]{};
  std::uint32_t count[fault_count]{};          ///< how often each fault was confirmed
  std::uint32_t bad_samples[channel_count]{};  ///< implausible readings
  std::uint32_t late_ticks{};                  ///< ticks later than one and a half periods
};

/// Time from one tick to the next by the times of their measurements, ns, in s; 0 where it runs backward.
template <class S>
constexpr S elapsed(std::uint64_t before, std::uint64_t now) {
  if (now <= before) return S(0);
  // Four seconds and more are too late in any case, and 32 bits take a single instruction to convert.
  const std::uint64_t passed = now - before;
  return S(passed < UINT32_MAX ? static_cast<std::uint32_t>(passed) : UINT32_MAX) * S(1e-9);
}

/// The constants of all checks of one axis.
template <class S>
struct Watch {
  using State = WatchState<S>;

  Limit<S> limit[fault_count]{};  ///< N for tensions, rad for angles, rad/s for the handle's jumps, s for ticks
  Limit<S> spool_jump{};          ///< rad/s
  Drive<S> drive{};               ///< as the motors should follow
  S pretension{};                 ///< N
  S stiffness{};                  ///< of one tendon, N/m
  S mean_band{};                  ///< share by which friction may change the mean tension
  S load_cell_range{};            ///< N
  S handle_range{};               ///< largest |handle angle|, rad
  S handle_noise{};               ///< largest difference of two readings of a handle at rest, rad
  S spool_noise{};                ///< the same of a spool, rad
  S period{};                     ///< nominal, of ticks, s

  constexpr const Limit<S>& of(Fault fault) const { return limit[static_cast<int>(fault)]; }

  /// Sets limits, and what readings are compared with, by parameters of these names.
  template <class P>
  void set_readings(const P& p) {
    for (int n = 0; n < fault_count; ++n) limit[n] = {S(p.limit[n].threshold), S(p.limit[n].persistence)};
    spool_jump = {S(p.spool_jump.threshold), S(p.spool_jump.persistence)};
    pretension = S(p.pretension);
    stiffness = S(p.stiffness);
    load_cell_range = S(p.load_cell_range);
    handle_range = S(p.handle_range);
    handle_noise = S(p.handle_noise);
    spool_noise = S(p.spool_noise);
  }

  bool valid() const {
    bool sound = spool_jump.threshold >= S(0) && spool_jump.persistence >= S(0);
    for (const auto& check : limit) sound = sound && check.threshold >= S(0) && check.persistence >= S(0);
    sound = sound && drive.spool_radius > S(0) && drive.speed_limit > S(0) && drive.acceleration_limit > S(0) &&
            drive.time_constant >= S(0) && pretension >= S(0) && stiffness > S(0) && mean_band >= S(0) &&
            load_cell_range > S(0) && handle_range > S(0) && handle_noise >= S(0) && spool_noise >= S(0) &&
            period > S(0);
    for (const auto& check : limit) sound = sound && all_finite(check.threshold, check.persistence);
    return sound && all_finite(spool_jump.threshold, spool_jump.persistence, drive.spool_radius, drive.speed_limit,
                               drive.acceleration_limit, drive.time_constant, pretension, stiffness, mean_band,
                               load_cell_range, handle_range, handle_noise, spool_noise, period);
  }

  /// Mask of the faults present; commanded: velocities sent to the motors in the last tick, rad/s.
  std::uint32_t check(const Measurement<S>& measured, const S (&commanded)[2], const S& dt, State& state) const {
    const bool ticked = dt > S(0) && is_finite(dt);
    const bool late = !ticked || watchdog(dt);
    const S elapsed = ticked ? smaller(dt, longest) : S(0);
    // One sample after a long gap does not show that a condition has lasted.
    const S step = smaller(elapsed, S(2) * period);
    if (!(elapsed > S(0) && elapsed <= S(1.5) * period)) count(state.late_ticks);
    for (S& age : state.since) age = smaller(age + elapsed, longest);

    std::uint32_t found = 0;
    S moved[2]{};
    bool blind[2]{late, late};
    if (!readable(measured, commanded, state)) {
      // Without readings, nothing shows that a fault has gone.
      found = (state.confirmed & ~bit(Fault::tick_late)) | bit(Fault::not_a_number);
      for (int i = 0; i < 2; ++i) {
        blind[i] = late || !state.started || !(abs(measured.spool_angle[i]) < beyond_any_sensor);
        if (!blind[i]) found |= check_spool(i, measured.spool_angle[i], step, state, moved[i]);
      }
    } else {
      if (!state.started) start(measured, state);
      found |= check_handle(measured.handle_angle, step, state);
      bool cells_in_range = true;
      const S difference = state.trusted.tension[0] - state.trusted.tension[1];
      for (int i = 0; i < 2; ++i) {
        found |= check_spool(i, measured.spool_angle[i], step, state, moved[i]);
        found |= check_cell(i, measured.tension[i], step, state, cells_in_range);
      }
      if (!(state.homed && cells_in_range && elapsed < S(1.5) * S(tuning::watch_moment))) state.leveled = false;
      if (state.homed && cells_in_range) found |= check_pair(measured.tension, difference, step, state);
    }
    found |= lasting(Fault::tick_late, 0, late, step, state);
    for (int i = 0; i < 2; ++i) found |= check_motor(i, commanded[i], moved[i], blind[i], elapsed, step, state);
    std::uint32_t fresh = found & ~state.confirmed;
    for (int n = 0; fresh != 0; ++n, fresh >>= 1U)
      if ((fresh & 1U) != 0) count(state.count[n]);
    state.confirmed = found;
    return found;
  }

  /// Whether the motors must stop because there was no tick for so long, s; for an interrupt of its own.
  bool watchdog(const S& since_last_step) const {
    return of(Fault::tick_late).on() && !(since_last_step <= of(Fault::tick_late).threshold);
  }

  /// The bit of a fault whose condition holds at a place, once it has lasted.
  std::uint32_t lasting(Fault fault, int place, bool holds, const S& step, State& state) const {
    return lasting(fault, place, of(fault), holds, step, state);
  }

  /// Resets all but the counts, as after homing.
  static void restart(State& state) {
    State fresh{};
    fresh.homed = state.homed;
    for (int n = 0; n < fault_count; ++n) fresh.count[n] = state.count[n];
    for (int n = 0; n < channel_count; ++n) fresh.bad_samples[n] = state.bad_samples[n];
    fresh.late_ticks = state.late_ticks;
    state = fresh;
  }

 private:
  // Clocks saturate here, long before rounding would lose ticks.
  static constexpr S longest = S(100);

  // N or rad; smaller readings keep every sum finite.
  static constexpr S beyond_any_sensor = S(1e6);

  using enum Channel;

  static void count_bad(Channel channel, int i, State& state) {
    count(state.bad_samples[static_cast<int>(channel) + i]);
  }

  static std::uint32_t lasting(Fault fault, int place, const Limit<S>& by, bool holds, const S& step, State& state) {
    S& lasted = state.lasted[static_cast<int>(fault)][place];
    if (!holds || !by.on()) {
      lasted = S(0);
      return 0;
    }
    lasted = smaller(lasted + step, longest);
    return lasted >= by.persistence ? bit(fault) : 0U;
  }

  static bool readable(const Measurement<S>& measured, const S (&commanded)[2], State& state) {
    bool all = all_finite(commanded[0], commanded[1]);
    const auto note = [&](Channel channel, int i, const S& reading) {
      if (abs(reading) < beyond_any_sensor) return;
      all = false;
      count_bad(channel, i, state);
    };
    note(handle, 0, measured.handle_angle);
    for (int i = 0; i < 2; ++i) {
      note(agonist_cell, i, measured.tension[i]);
      note(agonist_spool, i, measured.spool_angle[i]);
    }
    return all;
  }

  void start(const Measurement<S>& measured, State& state) const {
    state.started = true;
    state.trusted = measured;
    state.trusted.handle_angle = clamp(measured.handle_angle, -handle_range, handle_range);
    for (int i = 0; i < 2; ++i) state.stuck_at[i] = measured.tension[i];
  }

  // Whether an angle can have changed so far since it was last trusted. If not, it is not trusted, and is a jump once
  // this has lasted; a single bad sample has gone by then. Then the new angle is trusted, so that checking continues.
  static std::uint32_t take(int place, const S& reading, const Limit<S>& jump, const S& noise, Channel channel,
                            const S& step, State& state, S& trusted, S& moved) {
    const S change = reading - trusted;
    const bool reached = !jump.on() || abs(change) <= noise + jump.threshold * state.since[place];
    const std::uint32_t found = lasting(Fault::encoder_jump, place, jump, !reached, step, state);
    moved = reached ? change : S(0);
    if (!reached) count_bad(channel, 0, state);
    if (reached || found != 0) {
      trusted = reading;
      state.since[place] = S(0);
    }
    return found;
  }

  std::uint32_t check_handle(const S& reading, const S& step, State& state) const {
    const Limit<S>& dropout = of(Fault::encoder_dropout);
    const bool dropped = dropout.on() && abs(reading) > handle_range + dropout.threshold;
    const std::uint32_t found = lasting(Fault::encoder_dropout, at_handle, dropped, step, state);
    if (dropped) {
      count_bad(handle, 0, state);
      return found;
    }
    S moved(0);
    return found | take(at_handle, reading, of(Fault::encoder_jump), handle_noise, handle, step, state,
                        state.trusted.handle_angle, moved);
  }

  std::uint32_t check_spool(int i, const S& reading, const S& step, State& state, S& moved) const {
    return take(i, reading, spool_jump, spool_noise, i == agonist ? agonist_spool : antagonist_spool, step, state,
                state.trusted.spool_angle[i], moved);
  }

  std::uint32_t check_cell(int i, const S& tension, const S& step, State& state, bool& in_range) const {
    const Limit<S>& range = of(Fault::load_cell_range);
    const bool outside = range.on() && (tension >= load_cell_range || tension < -range.threshold);
    // At the end of its range a cell does not measure the tendon.
    const bool over = !outside && tension > of(Fault::over_tension).threshold;
    std::uint32_t found = lasting(Fault::over_tension, i, over, step, state);
    const bool left = abs(tension - state.stuck_at[i]) > of(Fault::load_cell_stuck).threshold;
    if (left) state.stuck_at[i] = tension;
    // A cell that stands still does not measure the tendon either.
    const std::uint32_t stuck = lasting(Fault::load_cell_stuck, i, !left, step, state);
    if (stuck != 0) in_range = false;
    found |= stuck;
    found |= lasting(Fault::load_cell_range, i, outside, step, state);
    if (outside) {
      count_bad(agonist_cell, i, state);
      in_range = false;
    } else {
      state.trusted.tension[i] = tension;
    }
    return found;
  }

  // difference: of the tensions a tick ago, N.
  std::uint32_t check_pair(const S (&tension)[2], const S& difference, const S& step, State& state) const {
    const auto& spool = state.trusted.spool_angle;
    const S wound = drive.spool_radius * (spool[0] + spool[1]) * S(0.5);
    const S mean = larger(pretension + stiffness * wound, S(0));
    const S shortfall = mean - (tension[0] + tension[1]) * S(0.5);
    // Of what is let out, the stiffness is as uncertain as friction is of what pulls.
    const S band = mean_band * larger(mean, pretension);
    const S empty = of(Fault::tendon_break).threshold;
    const S slack = of(Fault::tendon_slack).threshold;
    const S looser = smaller(tension[0], tension[1]);
    const S limit_of_slip = of(Fault::spool_slip).threshold;
    if (!state.leveled) state.level = shortfall;
    state.leveled = true;
    const S fallen = shortfall - state.level;
    // A fallen mean is compared with the one before until it comes back or is a fault. A mean that a slack tendon had
    // raised, and that comes down again, has lost nothing.
    const bool fell = of(Fault::spool_slip).on() && fallen > limit_of_slip && shortfall > -band;
    const bool taut = looser >= larger(empty, slack);
    const bool rose = taut && limit_of_slip > S(0) && -fallen > limit_of_slip;
    if (!fell && !rose) state.level = state.level + fallen * smaller(step / S(tuning::watch_moment), S(1));
    const bool gone = fell || shortfall > band + empty;

    std::uint32_t found = 0;
    for (int i = 0; i < 2; ++i) {
      found |= lasting(Fault::tendon_break, i, gone && tension[i] < empty, step, state);
      found |= lasting(Fault::tendon_slack, i, !gone && tension[i] < slack, step, state);
    }
    const S grown = shortfall - state.usual_shortfall;
    state.usual_shortfall = state.usual_shortfall + grown * (step / (S(tuning::watch_window) + step));
    const bool slipped = fell || (grown > limit_of_slip && shortfall > band);
    found |= lasting(Fault::spool_slip, 0, slipped && looser >= empty, step, state);
    const S off = abs(shortfall) - band;
    // A slack tendon may raise the mean; a mean far too low, with a tendon without tension, is a fault of its own.
    const S now = tension[0] - tension[1];
    if (state.reversed != S(0) || abs(now - difference) > limit_of_slip) {
      const auto opposite = [&](const S& before) {
        return abs(before) > limit_of_slip && abs(now + before) < S(0.5) * abs(before);
      };
      if (opposite(difference))
        state.reversed = difference;
      else if (!opposite(state.reversed))
        state.reversed = S(0);
    }
    const Limit<S> at_once{limit_of_slip, of(Fault::spool_slip).persistence};
    found |= lasting(Fault::load_cell_drift, 1, at_once, rose || (taut && state.reversed != S(0)), step, state);
    const bool judged = shortfall > S(0) ? looser >= empty : taut;
    found |= lasting(Fault::load_cell_drift, 0, judged && off > of(Fault::load_cell_drift).threshold, step, state);
    return found;
  }

  // Positions are compared rather than speeds, since an encoder's steps make speeds noisy; the window forgets the
  // model's long-term error.
  std::uint32_t check_motor(int i, const S& commanded, const S& moved, bool blind, const S& elapsed, const S& step,
                            State& state) const {
    Following<S>& following = state.following[i];
    // After a gap the watchdog may have stopped the motor.
    if (blind) {
      following = {};
      return lasting(Fault::motor_not_following, i, false, step, state);
    }
    const S taut(1);
    const DriveState<S> before{following.speed, S(0), S(0)};
    const DriveState<S> model = advance(drive, before, is_finite(commanded) ? commanded : S(0), taut, elapsed);
    const S kept = S(tuning::watch_window) / (S(tuning::watch_window) + elapsed);
    const S kept_longer =
        S(tuning::long_run * tuning::watch_window) / (S(tuning::long_run * tuning::watch_window) + elapsed);
    following.speed = model.speed;
    following.fastest = larger(abs(model.speed), following.fastest * kept);
    const S ahead = moved - model.angle;
    following.behind = (following.behind + ahead) * kept;
    following.astray = (following.astray + ahead) * kept_longer;
    following.path = (following.path + abs(model.angle)) * kept_longer;
    // After a change of speed a loop is behind by the error of its time constant; half of that constant is tolerated.
    const S lag = S(0.5) * drive.time_constant * following.fastest;
    const S threshold = of(Fault::motor_not_following).threshold;
    const bool strays = abs(following.astray) > S(2) * threshold + lag + S(tuning::drive_gain_error) * following.path;
    const bool off = strays || abs(following.behind) > threshold + lag;
    const std::uint32_t found = lasting(Fault::motor_not_following, i, off, step, state);
    // A motor that obeys from now on must not seem to go astray for as long again.
    if (found != 0) following.astray = S(0);
    return found;
  }
};

}  // namespace tenodesis

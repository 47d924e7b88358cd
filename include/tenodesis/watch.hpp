#pragma once
// Watches the sensors, tendons and motors of one axis: a condition that lasts is a fault.
//
// Two tendons check each other. Handle and tip draw on one what they give on the other, so that without friction the
// mean tension is pretension + stiffness * (mean length wound), wherever handle and tip are and whatever pushes on the
// tip. A slack tendon cannot push: it carries more than its straight line would, and the mean only rises; when a load
// has one tendon slack, the other carries at least twice that mean. Friction holds a tendon's tension at the spool
// within exp(+-E) of any other along it, E being the exponents of all its contacts, so the mean stays within
// mean_band = exp(E) - 1 of it, as a share. A mean below that is no load's doing: a tendon has broken or come loose, a
// spool has slipped, a load cell lies. A broken tendon cannot be told from a slack one only while a load, or the tip's
// stop, makes the other carry both shares.
//
// Within that band there is the moment itself to go by: hand and tip have inertia, so that what they take off the mean
// takes milliseconds, while a tendon that breaks or a spool that slips takes it off at once.

#include "tenodesis/control.hpp"
#include "tenodesis/drive.hpp"
#include "tenodesis/fault.hpp"

namespace tenodesis {

/// A check: what it compares with, and how long that must last to be a fault, s; a threshold of 0 switches it off.
template <class S>
struct Limit {
  S threshold{};
  S persistence{};

  constexpr bool on() const { return threshold > S(0); }
};

/// Sensors that may give bad samples.
enum class Channel : std::uint8_t { handle, agonist_cell, antagonist_cell, agonist_spool, antagonist_spool };

inline constexpr int channel_count = 5;

/// Places beside the two tendons that a condition may hold at.
inline constexpr int at_handle = 2, place_count = 3;

/// What a motor should have done of late.
template <class S>
struct Following {
  S speed{};    ///< of the model, rad/s
  S fastest{};  ///< of the model of late, rad/s
  S behind{};   ///< what the spool has turned more than the model of late, rad
};

template <class S>
struct WatchState {
  Measurement<S> trusted{};   ///< the last plausible reading of each sensor
  bool started{};             ///< there is one
  bool homed{};               ///< spool angles count from pretension: what they have wound tells the mean tension
  std::uint32_t confirmed{};  ///< faults that hold
  S lasted[fault_count][place_count]{};  ///< for how long each condition has held, s
  S since[place_count]{};                ///< age of the trusted angles: spools, handle, s
  S stuck_at[2]{};                       ///< tensions that have not been left since, N
  S usual_shortfall{};                   ///< of the mean tension of late, N
  S level{};                             ///< the same a moment ago, or before it fell at once, N
  bool leveled{};                        ///< there was such a moment
  Following<S> following[2]{};
  std::uint32_t count[fault_count]{};          ///< how often each fault was confirmed
  std::uint32_t bad_samples[channel_count]{};  ///< readings that were not plausible
  std::uint32_t late_ticks{};                  ///< ticks later than one and a half periods
};

/// The constants of all checks of one axis.
template <class S>
struct Watch {
  using State = WatchState<S>;

  Limit<S> limit[fault_count]{};  ///< N for tensions, rad for angles, rad/s for the handle's jumps, s for ticks
  Limit<S> spool_jump{};          ///< rad/s
  Drive<S> drive{};               ///< as the motors should follow
  S pretension{};                 ///< N
  S stiffness{};                  ///< of one tendon, N/m
  S mean_band{};                  ///< relative half-width that friction may move the mean tension by
  S load_cell_range{};            ///< N
  S handle_range{};               ///< largest |handle angle|, rad
  S handle_noise{};               ///< by which two readings of a handle at rest may differ, rad
  S spool_noise{};                ///< the same of a spool, rad
  S window{};                     ///< within which a slip happens, and a motor's lag is looked at, s
  S period{};                     ///< nominal, of ticks, s

  constexpr const Limit<S>& of(Fault fault) const { return limit[static_cast<int>(fault)]; }

  bool valid() const {
    bool sound = spool_jump.threshold >= S(0) && spool_jump.persistence >= S(0);
    for (const auto& one : limit) sound = sound && one.threshold >= S(0) && one.persistence >= S(0);
    sound = sound && drive.spool_radius > S(0) && drive.speed_limit > S(0) && drive.acceleration_limit > S(0) &&
            drive.time_constant >= S(0) && pretension >= S(0) && stiffness > S(0) && mean_band >= S(0) &&
            load_cell_range > S(0) && handle_range > S(0) && handle_noise >= S(0) && spool_noise >= S(0) &&
            window > S(0) && period > S(0);
    for (const auto& one : limit) sound = sound && all_finite(one.threshold, one.persistence);
    return sound && all_finite(spool_jump.threshold, spool_jump.persistence, drive.spool_radius, drive.speed_limit,
                               drive.acceleration_limit, drive.time_constant, pretension, stiffness, mean_band,
                               load_cell_range, handle_range, handle_noise, spool_noise, window, period);
  }

  /// Mask of the faults that hold; commanded: what was sent to the motors in the last tick, rad/s.
  std::uint32_t check(const Measurement<S>& measured, const S (&commanded)[2], const S& dt, State& state) const {
    const bool ticked = dt > S(0) && is_finite(dt);
    const bool late = !ticked || watchdog(dt);
    const S elapsed = ticked ? smaller(dt, longest) : S(0);
    // One sample after a long gap is not yet a condition that has lasted.
    const S step = smaller(elapsed, S(2) * period);
    if (!(elapsed > S(0) && elapsed <= S(1.5) * period)) count(state.late_ticks);
    for (S& age : state.since) age = smaller(age + elapsed, longest);

    std::uint32_t found = 0;
    S moved[2]{};
    if (!readable(measured, commanded, state)) {
      // Nothing says that what was wrong has gone.
      found = (state.confirmed & ~bit(Fault::tick_late)) | bit(Fault::not_a_number);
    } else {
      if (!state.started) start(measured, state);
      found |= check_handle(measured.handle_angle, step, state);
      bool cells_in_range = true;
      for (int i = 0; i < 2; ++i) {
        found |= check_spool(i, measured.spool_angle[i], step, state, moved[i]);
        found |= check_cell(i, measured.tension[i], step, state, cells_in_range);
      }
      if (!(state.homed && cells_in_range && elapsed < S(1.5) * moment)) state.leveled = false;
      if (state.homed && cells_in_range) found |= check_pair(measured.tension, step, state);
    }
    found |= lasting(Fault::tick_late, 0, late, step, state);
    for (int i = 0; i < 2; ++i) found |= check_motor(i, commanded[i], moved[i], late, elapsed, step, state);
    for (int n = 0; n < fault_count; ++n)
      if ((found & ~state.confirmed & (std::uint32_t(1) << static_cast<std::uint32_t>(n))) != 0) count(state.count[n]);
    state.confirmed = found;
    return found;
  }

  /// True once the motors must stop because nobody has asked for so long, s; for an interrupt of its own.
  bool watchdog(const S& since_last_step) const {
    return of(Fault::tick_late).on() && !(since_last_step <= of(Fault::tick_late).threshold);
  }

  /// Forgets what was seen, as when spool angles count anew, and keeps the counts.
  static void restart(State& state) {
    State fresh{};
    fresh.homed = state.homed;
    for (int n = 0; n < fault_count; ++n) fresh.count[n] = state.count[n];
    for (int n = 0; n < channel_count; ++n) fresh.bad_samples[n] = state.bad_samples[n];
    fresh.late_ticks = state.late_ticks;
    state = fresh;
  }

 private:
  // Clocks stop here, long before they would lose ticks in rounding.
  static constexpr S longest = S(100);

  // In which hand and tip, for their inertia, do not take off the mean tension what makes a slip, s.
  static constexpr S moment = S(1e-3);

  // N or rad; smaller readings keep every sum below finite.
  static constexpr S beyond_any_sensor = S(1e6);

  using enum Channel;

  static void count_bad(Channel channel, int i, State& state) {
    count(state.bad_samples[static_cast<int>(channel) + i]);
  }

  static std::uint32_t lasting(Fault fault, int place, const Limit<S>& by, bool holds, const S& step, State& state) {
    S& lasted = state.lasted[static_cast<int>(fault)][place];
    const bool counts = holds && by.on();
    lasted = counts ? smaller(lasted + step, longest) : S(0);
    return counts && lasted >= by.persistence ? bit(fault) : 0U;
  }
  std::uint32_t lasting(Fault fault, int place, bool holds, const S& step, State& state) const {
    return lasting(fault, place, of(fault), holds, step, state);
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

  // Whether an angle can have come so far since it was last trusted. One that cannot is not trusted, and a jump once it
  // has lasted; a single bad sample has come back by then. Then the new angle is trusted, so that watching goes on.
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
    // At the end of its range a cell says nothing of the tendon.
    const bool over = !outside && tension > of(Fault::over_tension).threshold;
    std::uint32_t found = lasting(Fault::over_tension, i, over, step, state);
    const bool left = abs(tension - state.stuck_at[i]) > of(Fault::load_cell_stuck).threshold;
    if (left) state.stuck_at[i] = tension;
    found |= lasting(Fault::load_cell_stuck, i, !left, step, state);
    found |= lasting(Fault::load_cell_range, i, outside, step, state);
    if (outside) {
      count_bad(agonist_cell, i, state);
      in_range = false;
    } else {
      state.trusted.tension[i] = tension;
    }
    return found;
  }

  std::uint32_t check_pair(const S (&tension)[2], const S& step, State& state) const {
    const auto& spool = state.trusted.spool_angle;
    const S wound = drive.spool_radius * (spool[0] + spool[1]) * S(0.5);
    const S mean = larger(pretension + stiffness * wound, S(0));
    const S shortfall = mean - (tension[0] + tension[1]) * S(0.5);
    const S band = mean_band * mean;
    const S empty = of(Fault::tendon_break).threshold;
    const S slack = of(Fault::tendon_slack).threshold;
    const S looser = smaller(tension[0], tension[1]);
    const S limit_of_slip = of(Fault::spool_slip).threshold;
    if (!state.leveled) state.level = shortfall;
    state.leveled = true;
    const S fallen = shortfall - state.level;
    // What has fallen is compared with what was before, until it comes back or is a fault.
    // A mean that a slack tendon held above the line, and that comes down to it, has lost nothing.
    const bool fell = of(Fault::spool_slip).on() && fallen > limit_of_slip && shortfall > -band;
    if (!fell) state.level = state.level + fallen * smaller(step / moment, S(1));
    const bool gone = fell || shortfall > band + empty;

    std::uint32_t found = 0;
    for (int i = 0; i < 2; ++i) {
      found |= lasting(Fault::tendon_break, i, gone && tension[i] < empty, step, state);
      found |= lasting(Fault::tendon_slack, i, !gone && tension[i] < slack, step, state);
    }
    const S grown = shortfall - state.usual_shortfall;
    state.usual_shortfall = state.usual_shortfall + grown * (step / (window + step));
    const bool slipped = fell || (grown > limit_of_slip && shortfall > band);
    found |= lasting(Fault::spool_slip, 0, slipped && looser >= empty, step, state);
    const S off = abs(shortfall) - band;
    // A mean above the line may be a slack tendon's; one far below it at a tendon that does not pull has its own name.
    const bool judged = looser >= (shortfall > S(0) ? empty : larger(empty, slack));
    found |= lasting(Fault::load_cell_drift, 0, judged && off > of(Fault::load_cell_drift).threshold, step, state);
    return found;
  }

  // Positions are compared rather than speeds, since an encoder's steps make noise of speeds; the window forgets what a
  // model errs by in the long run.
  std::uint32_t check_motor(int i, const S& commanded, const S& moved, bool late, const S& elapsed, const S& step,
                            State& state) const {
    Following<S>& following = state.following[i];
    // After a gap the watchdog may have stopped the motor.
    if (late) following = {};
    const S taut(1);
    const DriveState<S> before{following.speed, S(0), S(0)};
    const DriveState<S> model =
        late ? before : advance(drive, before, is_finite(commanded) ? commanded : S(0), taut, elapsed);
    const S kept = window / (window + elapsed);
    following.speed = model.speed;
    following.fastest = larger(abs(model.speed), following.fastest * kept);
    following.behind = late ? S(0) : (following.behind + moved - model.angle) * kept;
    // A change of speed puts a loop behind by what its time constant differs from the model's by; half is allowed for.
    const S allowed = of(Fault::motor_not_following).threshold + S(0.5) * drive.time_constant * following.fastest;
    return lasting(Fault::motor_not_following, i, abs(following.behind) > allowed, step, state);
  }
};

}  // namespace tenodesis

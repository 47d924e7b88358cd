#pragma once
// Loads that alternate: friction is left to hold the tip where it can.
//
// Motors that follow such a load are late at each of its jumps, and their strokes free a tip that friction would have
// held. A load alternates if two opposed jumps were made larger by the strokes that the motors had wound, so that each
// more than doubled the square of the error, or if three follow each other at like distances in time. (A load that is
// put on and taken off alternates less: when it is put on, nothing is wound.) Then the motors give their stroke back,
// no further than friction holds the tip. The next jump shows what resting costs: a tip that stays within a share of
// what it had jumped is left to friction, one that does not is tracked. What is left on average is taken away slowly.
// Jumps that friction holds do not show, so their absence is no sign that the load has ceased: only after a long time
// without one, or when the hand moves, the motors look for it again. A load that jumps faster than motors can follow is
// not tracked at all.

#include "tenodesis/observer.hpp"

namespace tenodesis {

/// What the law knows of the tip in a tick, lengths as strokes, m.
template <class S>
struct TrackedTip {
  S certain{};     ///< of the tracking error
  S stroke{};      ///< differential
  S waking{};      ///< error that is worth a stroke
  S jump{};        ///< error that counts as a jump of the load
  S holds{};       ///< how much less stroke friction would still hold
  bool moving{};   ///< whether the hand moves
  bool bounded{};  ///< whether the envelope holds the stroke back
};

template <class S>
struct AlternationState {
  S sign{};             ///< of the error's last jump
  S since{};            ///< time since then, s
  S half{};             ///< time between the last two, s
  S half_before{};      ///< time between the two before, s
  S size{};             ///< of the last jump, m
  S size_before{};      ///< of the one before, m
  S offset{};           ///< error, smoothed, m
  S stroke{};           ///< at the last jump, m
  S mean{};             ///< of the strokes at the last two, m
  S lagged_stroke{};    ///< stroke, smoothed, m
  int jumps{};          ///< each opposed to the one before
  bool wound{};         ///< whether the stroke has made that jump larger
  bool wound_before{};  ///< the same of the one before
  bool armed{true};     ///< whether the error has been small since the last jump
  bool leans{};         ///< whether friction is left to hold the tip
  bool fast{};          ///< whether the load jumps faster than motors can follow

  /// Whether the load alternates, as far as its jumps show.
  constexpr bool alternates() const {
    const bool regular = jumps > 2 && half < S(2) * half_before && half_before < S(2) * half;
    return regular || (jumps > 1 && wound && wound_before);
  }
};

/// Follows the load's jumps, and begins or ends leaving the tip to friction.
template <class S>
void follow(const TrackedTip<S>& tip, const S& dt, AlternationState<S>& state) {
  const S error = abs(tip.certain);
  const S sign = S(tip.certain > S(0) ? 1 : -1);
  const S share = dt / (S(tuning::alternation_smoothing) + dt);
  state.offset = state.offset + (tip.certain - state.offset) * share;
  state.lagged_stroke = state.lagged_stroke + (tip.stroke - state.lagged_stroke) * share;
  state.since = smaller(state.since + dt, S(100));
  if (state.since > S(tuning::alternation_longest) || tip.moving) state.jumps = 0;
  if (error < S(0.5) * tip.jump) state.armed = true;
  // A jump is sudden and takes the tip further off; a change that the motors' own stroke explains is none.
  const S jumped = sign * (tip.certain - state.offset);
  const bool by_load = jumped > larger(tip.jump, S(2) * abs(tip.stroke - state.lagged_stroke));
  if (error > tip.jump && (state.armed || sign != state.sign) && by_load) {
    state.jumps = sign != state.sign ? smaller(state.jumps + 1, 100) : 1;
    state.half_before = state.half;
    state.half = state.since;
    state.since = S(0);
    state.sign = sign;
    state.armed = false;
    state.size_before = state.leans ? larger(state.size, state.size_before) : state.size;
    state.size = error;
    if (!state.leans) {
      state.mean = (state.stroke + tip.stroke) * S(0.5);
      state.stroke = tip.stroke;
      state.wound_before = state.wound;
    }
  }
  if (!state.leans && sign == state.sign && error >= state.size) {
    state.size = error;
    state.wound = S(2) * square(tip.certain + state.stroke) < square(error);
  }
  state.fast = state.alternates() && larger(state.half, state.half_before) < S(tuning::alternation_fastest) &&
               state.since < S(2) * state.half;
  const S jump = larger(state.size, state.size_before);
  // The tip is held if it is near its target, or would be if it went along with a stroke that is given back.
  const S left = smaller(error, abs(tip.certain + tip.stroke - state.mean));
  const bool held = left < larger(tip.waking, S(tuning::alternation_left) * jump);
  // Where friction holds less than half of the stroke, giving it back would free the tip. If one of two jumps is much
  // smaller, the law's own strokes made it, and the larger one is a new load.
  const bool alike = smaller(state.size, state.size_before) > S(tuning::alternation_left) * jump;
  const bool begins = state.alternates() && alike && abs(tip.stroke - state.mean) < S(2) * tip.holds;
  const bool leans = state.fast || (held && (state.leans ? state.jumps > 0 : begins));
  if (leans && !state.leans) state.offset = tip.certain;
  state.leans = leans;
  if (leans && !state.fast && !tip.bounded) state.mean = state.mean + state.offset * (dt / S(tuning::mean_memory));
}

/// Differential speed while the tip is left to friction, m/s; holds: how much less stroke still holds it, m; gain:
/// of a tracking error, 1/s.
template <class S>
S leaning_speed(const AlternationState<S>& state, const S& certain, const S& stroke, const S& holds, const S& gain) {
  const S left = state.mean - stroke;
  const S most = state.fast || left * certain > S(0) ? abs(left) : (S(1) - S(tuning::alternation_left)) * holds;
  return gain * clamp(left, -most, most) + S(tuning::return_rate) * state.offset;
}

}  // namespace tenodesis

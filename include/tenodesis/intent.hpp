#pragma once
// The hand's intent: the handle angle without the hand's tremor.
//
// Physiological tremor turns the handle to and fro 6 to 12 times a second, which nobody does on purpose (Elble, Koller,
// Tremor, 1990; Stiles, Randall, J. Appl. Physiol. 23, 1967). So reversals that follow each other so quickly show how
// large the tremor is, and a play as wide as that takes it away. A play, unlike a filter, does not delay slow motion:
// by as much as it is wide, and by nothing when there is no tremor.

#include "tenodesis/tuning.hpp"

namespace tenodesis {

template <class S>
struct IntentState {
  S angle{};         ///< that the hand means, rad
  S amplitude{};     ///< of the tremor, rad
  S extreme{};       ///< of the handle since its last reversal, rad
  S reversed{};      ///< handle angle at that reversal, rad
  S swing{};         ///< between that reversal and the one before, rad
  S direction{1};    ///< of the handle since then
  S since{};         ///< time since then, s
  S pulsation{50};   ///< of the tremor, rad/s
  S tremor{};        ///< handle angle by tremor, smoothed, rad
  S speed{};         ///< its rate, rad/s
  S smooth_speed{};  ///< the same, smoothed once more
  S acceleration{};  ///< rad/s^2

  /// Where the hand is still.
  static constexpr IntentState at(const S& angle) {
    IntentState state{};
    state.angle = state.extreme = state.reversed = angle;
    return state;
  }

  /// Speed of the tremor after a small part of its period (s), as far as it is sinusoidal, rad/s.
  constexpr S speed_after(const S& delay) const {
    const S turn = pulsation * delay;
    const S square = turn * turn;
    const S sine = delay * (S(1) - square * S(1.0 / 6));
    const S cosine = S(1) - square * (S(0.5) - square * S(1.0 / 24));
    return cosine * speed + sine * acceleration;
  }
};

/// Follows the handle; play: half the width of its angle's noise, rad.
template <class S>
void follow(const S& play, const S& handle_angle, const S& dt, IntentState<S>& state) {
  // Nothing that a hand does reverses more quickly, and motors could not follow it.
  const S quickest = S(tuning::tremor_quickest) * S(tuning::tremor_half_period);
  const bool fast = state.since < S(tuning::tremor_half_period);
  state.since = smaller(state.since + dt, S(10));
  state.amplitude = state.amplitude - state.amplitude * (dt / S(tuning::tremor_memory));
  const S onward = (handle_angle - state.extreme) * state.direction;
  if (onward > S(0)) {
    state.extreme = handle_angle;
  } else if (-onward > play) {
    // What the hand means to do makes every other swing longer, and one alone is no tremor.
    const S swing = abs(state.extreme - state.reversed);
    const S amplitude = smaller(S(0.25) * (swing + state.swing), S(0.75) * smaller(swing, state.swing));
    state.swing = fast ? swing : S(0);
    if (fast && state.since > quickest && amplitude > play * S(0.75)) {
      state.amplitude = smaller(larger(state.amplitude, S(tuning::tremor_spare) * amplitude), S(tuning::tremor_limit));
      state.pulsation = state.pulsation + (S(pi) / state.since - state.pulsation) * S(tuning::tremor_pulsation);
    }
    state.reversed = state.extreme;
    state.extreme = handle_angle;
    state.direction = -state.direction;
    state.since = S(0);
  }
  if (fast && state.amplitude > play) {
    const S middle = (state.extreme + state.reversed) * S(0.5);
    state.angle = state.angle + (middle - state.angle) * (dt / S(tuning::tremor_memory));
  }
  const S width = larger(state.amplitude, play);
  state.angle = clamp(state.angle, handle_angle - width, handle_angle + width);
  const S tremor = state.amplitude > play ? handle_angle - state.angle : S(0);
  const S rate = S(1) / (S(tuning::tremor_smoothing) + dt);
  state.speed = (tremor - state.tremor) * rate;
  state.tremor = state.tremor + state.speed * dt;
  state.acceleration = (state.speed - state.smooth_speed) * rate;
  state.smooth_speed = state.smooth_speed + state.acceleration * dt;
}

}  // namespace tenodesis

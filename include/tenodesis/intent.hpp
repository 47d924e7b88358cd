#pragma once
// The hand's intent: the handle angle without the hand's tremor.
//
// Physiological tremor turns the handle to and fro 6 to 12 times a second, which nobody does on purpose (Elble, Koller,
// Tremor, 1990; Stiles, Randall, J. Appl. Physiol. 23, 1967). So reversals that follow each other so quickly show how
// large the tremor is, and a play as wide as that takes it away. A play, unlike a filter, does not delay slow motion:
// by as much as it is wide, and by nothing when there is no tremor.

#include "tenodesis/scalar.hpp"

namespace tenodesis {

template <class S>
struct IntentSettings {
  S half_period{};  ///< longest time between two reversals of tremor, s
  S limit{};        ///< largest amplitude of tremor, rad
  S play{};         ///< half the width of the noise, rad
  S memory{};       ///< time constant with which the amplitude is forgotten, s
};

template <class S>
struct IntentState {
  S angle{};        ///< that the hand means, rad
  S tremor{};       ///< half the width of the play, rad
  S extreme{};      ///< of the handle since its last reversal, rad
  S reversed{};     ///< handle angle at that reversal, rad
  S direction{1};   ///< of the handle since then
  S since{};        ///< time since then, s
  S shaken{};       ///< handle angle by tremor, rad
  S pulsation{50};  ///< of tremor, rad/s

  /// Where the hand is still.
  static constexpr IntentState at(const S& angle) { return {angle, S(0), angle, angle, S(1), S(0), S(0), S(50)}; }
};

/// Follows the handle, whose angle's noise is within the play.
template <class S>
void follow(const IntentSettings<S>& settings, const S& handle_angle, const S& dt, IntentState<S>& state) {
  // Successive swings of a hand differ.
  const S spare(1.2);
  const bool fast = state.since < settings.half_period;
  state.since = smaller(state.since + dt, S(10));
  state.tremor = state.tremor - state.tremor * (dt / settings.memory);
  const S onward = (handle_angle - state.extreme) * state.direction;
  if (onward > S(0)) {
    state.extreme = handle_angle;
  } else if (-onward > settings.play) {
    const S swing = abs(state.extreme - state.reversed) * S(0.5);
    if (fast && swing > settings.play * S(0.75)) {
      state.tremor = smaller(larger(state.tremor, spare * swing), settings.limit);
      state.pulsation = state.pulsation + (S(pi) / (state.since + dt) - state.pulsation) * S(0.2);
    }
    state.reversed = state.extreme;
    state.extreme = handle_angle;
    state.direction = -state.direction;
    state.since = S(0);
  }
  const S width = larger(state.tremor, settings.play);
  if (fast && state.tremor > settings.play) {
    const S middle = (state.extreme + state.reversed) * S(0.5);
    state.angle = state.angle + (middle - state.angle) * (dt / settings.memory);
  }
  state.angle = clamp(state.angle, handle_angle - width, handle_angle + width);
  // A tremor that is forgotten fades out.
  state.shaken = (handle_angle - state.angle) * clamp(state.tremor / settings.play - S(0.5), S(0), S(1));
}

}  // namespace tenodesis

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
  S least{};        ///< amplitude that stands out from noise, rad
  S memory{};       ///< time constant with which the amplitude is forgotten, s
};

template <class S>
struct IntentState {
  S angle{};       ///< that the hand means, rad
  S tremor{};      ///< half the width of the play, rad
  S extreme{};     ///< of the handle since its last reversal, rad
  S reversed{};    ///< handle angle at that reversal, rad
  S direction{1};  ///< of the handle since then
  S since{};       ///< time since then, s

  /// Where the hand is still.
  static constexpr IntentState at(const S& angle) { return {angle, S(0), angle, angle, S(1), S(0)}; }
};

/// Follows the handle, whose angle is without noise.
template <class S>
void follow(const IntentSettings<S>& settings, const S& handle_angle, const S& dt, IntentState<S>& state) {
  // Successive swings of a hand differ.
  const S spare(1.2);
  const bool fast = state.since < settings.half_period;
  state.since = smaller(state.since + dt, S(10));
  state.tremor = state.tremor - state.tremor * (dt / settings.memory);
  if ((handle_angle - state.extreme) * state.direction >= S(0)) {
    state.extreme = handle_angle;
  } else {
    const S swing = abs(state.extreme - state.reversed) * S(0.5);
    if (fast && swing > settings.least) state.tremor = smaller(larger(state.tremor, spare * swing), settings.limit);
    state.reversed = state.extreme;
    state.extreme = handle_angle;
    state.direction = -state.direction;
    state.since = S(0);
  }
  if (fast) {
    const S middle = (state.extreme + state.reversed) * S(0.5);
    state.angle = state.angle + (middle - state.angle) * (state.tremor > settings.least ? dt / settings.memory : S(0));
  }
  state.angle = clamp(state.angle, handle_angle - state.tremor, handle_angle + state.tremor);
}

}  // namespace tenodesis

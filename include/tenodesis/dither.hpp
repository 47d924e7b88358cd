#pragma once
// Dither: a common vibration of both spools that makes sheath and handle slip both ways in each of its periods.
//
// What friction there does to the tensions alternates with it, so that the mean error of the tip over a period is right
// however strong friction is. The tip's own contact lies beyond the soft stem, is not reached, and holds the tip still.

#include "tenodesis/tuning.hpp"

namespace tenodesis {

template <class S>
struct DitherState {
  S cosine{1};    ///< of the phase
  S sine{};       ///< of the phase
  S rate{};       ///< angular frequency, rad/s
  S speed{};      ///< commanded amplitude of a tendon's speed, m/s
  S sum{};        ///< of the errors in this period, m
  S ticks{};      ///< in this period
  int settled{};  ///< periods in a row whose mean error was in the dead band
};

/// Begins dither of an amplitude (m), as fast as drives of a largest acceleration (m/s^2) and a time constant (s) turn
/// the spools so far to and fro.
template <class S>
DitherState<S> begin_dither(const S& amplitude, const S& acceleration, const S& time_constant) {
  DitherState<S> state{};
  S square = S(tuning::dither_fastest * tuning::dither_fastest);
  // The drives' lag lowers what is commanded. The fixed point is found within 1 % by three steps.
  const auto lowered = [&] { return sqrt(S(1) + square * time_constant * time_constant); };
  for (int n = 0; n < 3; ++n) square = smaller(acceleration / (amplitude * lowered()), square);
  state.rate = sqrt(square);
  state.speed = amplitude * state.rate * lowered();
  return state;
}

/// Speed of both tendons in the next tick, m/s; error: of the tip, by a band that counts as none, m.
template <class S>
S dither(const S& error, const S& band, const S& dt, DitherState<S>& state) {
  const bool was_rising = state.cosine > S(0);
  const S turn = state.rate * dt;
  state.sine = state.sine + turn * state.cosine;
  state.cosine = state.cosine - turn * state.sine;
  state.sum = state.sum + error;
  state.ticks = state.ticks + S(1);
  if (state.cosine > S(0) && !was_rising) {
    state.settled = abs(state.sum) < band * state.ticks ? state.settled + 1 : 0;
    state.sum = state.ticks = S(0);
  }
  return state.speed * state.cosine;
}

}  // namespace tenodesis

#pragma once
// Motor currents in the place of load cells: what the drive's friction makes of a tension, and a tension from a
// current.
//
// Between a tendon and its motor's current lie the spool, a gearbox and the motor's own friction. They let a motor that
// winds pull harder than its tendon, and one that lets out less: the pull is within [e T - f, T / e + f], with the
// gearbox's efficiency e in either direction and load-independent friction f. A motor at rest may pull with anything
// within this band: only motion shows which edge it is.

#include "tenodesis/scalar.hpp"

namespace tenodesis {

/// Spool angle over which friction turns from one edge of its band to the other, rad.
template <Real S>
inline constexpr S presliding = S(2e-3);

/// What lies between a tendon and its motor's current.
template <class S>
struct CurrentSense {
  bool on{};        ///< whether currents take the place of load cells
  S efficiency{1};  ///< of the gearbox
  S friction{};     ///< of motor and gearbox, beside what grows with the load, as tension, N
  S ripple{};       ///< amplitude of the torque's ripple, a triangular wave, share
  S ripple_rate{};  ///< its periods per spool angle, 1/rad
  S drift{};        ///< share of the torque that a warm motor lacks
  S warming{};      ///< approach to the warm motor per sample, share
};

template <class S>
struct CurrentState {
  S pull{};    ///< of the motor, as tension, N
  S angle{};   ///< of the motor at the last sample, rad at the spool
  S warmth{};  ///< 0: cold, 1: warm
};

/// Advances by a sample, at a tendon's tension (N) and its motor's angle at the spool (rad); returns the current as the
/// tension that it stands for in a cold motor without ripple, N.
template <class S>
S sense(const CurrentSense<S>& by, const S& tension, const S& angle, CurrentState<S>& state) {
  const S low = tension * by.efficiency - by.friction;
  const S high = tension / by.efficiency + by.friction;
  const S turned = (angle - state.angle) * (S(1) / S(presliding<ValueOf<S>>));
  state.pull = clamp(state.pull + (high - low) * turned, low, high);
  state.angle = angle;
  state.warmth = state.warmth + (S(1) - state.warmth) * by.warming;
  S torque_per_current = S(1) - by.drift * state.warmth;
  // In dual numbers the mean over the ripple.
  if constexpr (Real<S>) {
    const S periods = by.ripple_rate * angle;
    torque_per_current = torque_per_current * (S(1) + by.ripple * (S(4) * abs(periods - round(periods)) - S(1)));
  }
  return state.pull / torque_per_current;
}

/// Tension that a motor's current stands for, N, with the drive's friction still in it; ends with the current's range.
///
/// tension_per_current: torque constant times gear ratio over spool radius, N/A. The observer takes the friction out,
/// as a part of that of the sheath.
template <class S>
constexpr S tension_from_current(const S& current, const S& tension_per_current, const S& range) {
  // What is no number stays none.
  const S within = current > range ? range : current < -range ? -range : current;
  return within * tension_per_current;
}

}  // namespace tenodesis

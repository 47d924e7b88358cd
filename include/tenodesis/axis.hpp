#pragma once
// One axis of an instrument: a proximal and a distal joint with two tendons between them.

#include "tenodesis/joint.hpp"

namespace tenodesis {

/// Largest number of bending axes of an instrument.
inline constexpr int most_axes = 2;

/// Axial stiffness of a tendon of circular section, N/m: modulus (Pa) times section over length (m).
template <class S>
constexpr S tendon_stiffness(const S& modulus, const S& diameter, const S& length) {
  return modulus * S(pi / 4) * diameter * diameter / length;
}

/// The constants of one axis; the joint's geometry is the joint's alone.
template <class S, template <class> class DistalJoint, template <class> class ProximalJoint = DistalJoint>
struct Axis {
  using Scalar = S;
  template <class T>
  using Rebind = Axis<T, DistalJoint, ProximalJoint>;
  static constexpr Mechanism tip_mechanism = DistalJoint<S>::mechanism, handle_mechanism = ProximalJoint<S>::mechanism;

  ProximalJoint<S> proximal{};
  DistalJoint<S> distal{};
  S stiffness{};     ///< of one tendon, N/m
  S pretension{};    ///< of either tendon at rest, N
  S handle_range{};  ///< largest |handle angle|, rad

  constexpr auto values() const {
    return Rebind<ValueOf<S>>{proximal.values(), distal.values(), value_of(stiffness), value_of(pretension),
                              value_of(handle_range)};
  }
};

/// Tendon length that the handle draws on the agonist and lets out on the antagonist, m.
template <class A, class S>
S handle_excursion(const A& axis, const S& handle_angle) {
  return axis.proximal.excursion_slope() * axis.proximal.coordinate(handle_angle);
}

template <class S>
using GearAxis = Axis<S, TendonGear>;
template <class S>
using PulleyAxis = Axis<S, TendonPulley>;
// The handle of a continuum instrument is an ordinary pulley: only the tip's backbone must fit through the port.
template <class S>
using ContinuumAxis = Axis<S, TendonContinuum, TendonPulley>;

}  // namespace tenodesis

#pragma once
// Elastic similarity: the factors that convert forces and tensions from one instrument to another.

#include "tenodesis/statics.hpp"

namespace tenodesis {

/// Tension that stretches a tendon by the distal radius, k r, N: the unit of tension (Table II).
template <class A>
constexpr auto tension_scale(const A& axis) {
  return axis.stiffness * axis.distal.radius;
}

/// Factor of tip force, scaled-up over real-size, for equal loss of dexterity at an output angle (eq. 17, Table II).
template <class A, class B, class S>
Result<S> force_factor(const A& real_size, const B& scaled_up, const S& output_angle) {
  const Result<S> ours = loss_of_dexterity(real_size, output_angle, S(1));
  const Result<S> theirs = loss_of_dexterity(scaled_up, output_angle, S(1));
  return {ours.value / theirs.value, ours.status != Status::ok ? ours.status : theirs.status};
}

/// Unloaded distal coordinate at the end of the handle's range, as a share of the joint's limit.
template <class A>
auto unloaded_limit(const A& axis) {
  const auto pull = axis.proximal.excursion_slope() * axis.proximal.coordinate(axis.handle_range);
  return pull / axis.distal.excursion_slope() / axis.distal.limit();
}

/// Tension difference per tip force at the straight joint, dimensionless (eq. 1).
template <class A>
auto tension_per_force(const A& axis) {
  const auto straight = axis.distal.coordinate(decltype(axis.stiffness)(0));
  return axis.distal.tangential_arm(straight) / axis.distal.moment_arm(straight);
}

}  // namespace tenodesis

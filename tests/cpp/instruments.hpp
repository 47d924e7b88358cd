#pragma once
// The paper's two instruments (Table I) and one of each other mechanism, for the core's tests.

#include "tenodesis/axis.hpp"
#include "tenodesis/kinematics.hpp"

namespace instruments {

template <class S>
constexpr tenodesis::GearAxis<S> real_size() {
  return {{S(4.5e-3), S(0.120)}, {S(2e-3), S(0.050)}, S(31172), S(30), S(0.7854)};
}

template <class S>
constexpr tenodesis::GearAxis<S> scaled_up() {
  return {{S(16.875e-3), S(0.160)}, {S(7.5e-3), S(0.086)}, S(11451), S(25), S(0.7854)};
}

template <class S>
constexpr tenodesis::PulleyAxis<S> pulley() {
  return {{S(4.5e-3), S(0.120)}, {S(2e-3), S(0.050)}, S(31172), S(30), S(0.7854)};
}

template <class S>
constexpr tenodesis::ContinuumAxis<S> continuum() {
  return {{S(4.5e-3), S(0.120)}, {S(2e-3), S(0.010), S(0.020), S(2e-4)}, S(31172), S(30), S(0.7854)};
}

/// Directions that joints bend to.
enum class Toward : unsigned char { yaw, pitch };

template <class S>
constexpr tenodesis::ChainJoint<S> joint_of(const tenodesis::TendonGear<S>& joint) {
  return {.mechanism = tenodesis::Mechanism::gear, .chord = S(2) * joint.radius, .length = joint.length};
}
template <class S>
constexpr tenodesis::ChainJoint<S> joint_of(const tenodesis::TendonPulley<S>& joint) {
  return {.mechanism = tenodesis::Mechanism::pulley, .length = joint.length};
}
template <class S>
constexpr tenodesis::ChainJoint<S> joint_of(const tenodesis::TendonContinuum<S>& joint) {
  return {.mechanism = tenodesis::Mechanism::continuum, .chord = joint.backbone_length, .length = joint.length};
}

/// The chain of one or two joints of an axis, 4 mm apart at the tip and 9 mm at the handle, on a stem of 300 mm.
template <class A, class S = A::Scalar>
constexpr tenodesis::Chain<S, 2> chain_of(const A& axis, int joints, Toward first) {
  tenodesis::Chain<S, 2> chain{.joints = joints, .handles = joints, .stem_length = S(0.3)};
  for (int i = 0; i < joints; ++i) {
    const bool yaws = (first == Toward::yaw) == (i == 0);
    chain.tip[i] = joint_of(axis.distal);
    chain.handle[i] = joint_of(axis.proximal);
    chain.tip[i].parent = chain.handle[i].parent = i - 1;
    chain.tip[i].axis = chain.handle[i].axis =
        yaws ? tenodesis::Vector<S>{S(0), S(1), S(0)} : tenodesis::Vector<S>{S(-1), S(0), S(0)};
    chain.tip[i].offset = S(i) * S(0.004);
    chain.handle[i].offset = S(i) * S(0.009);
  }
  return chain;
}

}  // namespace instruments

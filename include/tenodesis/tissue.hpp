#pragma once
// Tissue at the tip: how deep the tip is in it, what it stores, and the force with which it resists.

#include "tenodesis/statics.hpp"

namespace tenodesis {

/// Tissue at the tip: beyond a place it pushes back against the tip's path square to the end-effector, and never pulls.
template <class S>
struct Contact {
  S angle{};      ///< output angle at which the tip touches it, rad
  S stiffness{};  ///< N/m; positive: it lies in flexion from there, negative: in extension; 0: there is none
  S damping{};    ///< N s/m

  constexpr Flag<S> present() const { return stiffness != S(0); }
  friend bool operator==(const Contact&, const Contact&) = default;
};

/// An output angle, and the joint's coordinate there.
template <class S>
struct Tip {
  S angle{};
  S x{};
};

template <class J, class S>
Tip<S> tip_at(const J& joint, const S& angle) {
  return {angle, joint.coordinate(angle)};
}

/// How far the tip has come into tissue along its path, m; negative outside.
template <class J, class S>
S depth(const J& joint, const Contact<S>& contact, const Tip<S>& tip) {
  const S touching = joint.tip_path(contact.angle, joint.coordinate(contact.angle));
  const S way = joint.tip_path(tip.angle, tip.x) - touching;
  return if_above(-contact.stiffness, -way, way);
}

/// Whether the tip is within tissue.
template <class J, class S>
bool touches(const J& joint, const Contact<S>& contact, const Tip<S>& tip) {
  return contact.present() && depth(joint, contact, tip) > S(0);
}

/// Energy stored in tissue, J.
template <class J, class S>
S stored_in(const J& joint, const Contact<S>& contact, const S& angle) {
  if (!contact.present()) return S(0);
  const S deep = larger(depth(joint, contact, tip_at(joint, angle)), S(0));
  return abs(contact.stiffness) * deep * deep * S(0.5);
}

/// Mean force of tissue in a step: its size, its moment on the tip, and how that falls with the tip's angle.
template <class S>
struct Resistance {
  S force{};
  S moment{};
  S stiffness{};
};

/// Resistance in a step from one output angle to a tip; without tissue there is none.
///
/// The mean force times the way is what the spring stores, also in a step that enters or leaves, and what its damping
/// loses: whatever the step, tissue gives back no more than it took (Gonzalez 1996,
/// https://doi.org/10.1007/BF02440162). Kept out of line, where it costs the common step no registers.
template <class J, class S>
[[gnu::noinline, gnu::cold]] Resistance<S> resistance(const J& joint, const Contact<S>& contact, const S& per_second,
                                                      const S& from, const Tip<S>& tip) {
  const S x = joint.coordinate(from);
  const S was = depth(joint, contact, Tip<S>{from, x});
  const S is = depth(joint, contact, tip);
  const S inside = larger(is, S(0)) - larger(was, S(0));
  // The share of the way that lies within, unless there is no way.
  const Flag<S> crosses = Flag<S>(was > S(0)) != Flag<S>(is > S(0));
  const S share = where(crosses, inside / (is - was), S(1));
  const S mean = (larger(is, S(0)) + larger(was, S(0))) * S(0.5) * share;
  const S size = abs(contact.stiffness);
  const S force = size * mean + contact.damping * per_second * inside;
  const Flag<S> pushes = force > S(0);
  if (!any(pushes)) return {};
  const S shift = if_above(is, share * (S(1) - share * S(0.5)), share * share * S(0.5));
  const S slope = size * shift + if_above(is, contact.damping * per_second, S(0));
  const S arm = (joint.tangential_arm(x) + joint.tangential_arm(tip.x)) * S(0.5);
  const S against = where(pushes, if_above(-contact.stiffness, -force, force), S(0));
  return {against, -against * arm, where(pushes, slope * arm * arm, S(0))};
}

/// Resistance to a tip that rests in tissue.
template <class J, class S>
Resistance<S> resistance_at_rest(const J& joint, const Contact<S>& contact, const Tip<S>& tip) {
  const S force = contact.stiffness * larger(depth(joint, contact, tip), S(0));
  return {force, -force * joint.tangential_arm(tip.x), S(0)};
}

}  // namespace tenodesis

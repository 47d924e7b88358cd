#pragma once
// Inertia of a wrist's links, by the twists that the rate of a joint gives itself and the links beyond it
// (Featherstone 2008), for joints that turn, move along a chord and turn again.

#include "tenodesis/wrist.hpp"

namespace tenodesis {

/// A rigid body at the far end of a joint, in its axes; z along the link.
template <class S>
struct Link {
  S mass{};             ///< kg
  S centre{};           ///< of mass, from the joint's far end along z, m
  Vector<S> inertia{};  ///< about the far end of the joint, about x, y and z, kg m^2
};

namespace detail {

/// A joint at an angle, as a moving frame.
template <class S>
struct Motion {
  Vector<S> row[3];   ///< of the rotation of vectors of the far side into the axes of the near side
  Vector<S> place{};  ///< of the far end, in the axes and from the end of what the joint stands on, m
  Vector<S> rate{};   ///< of that by the angle, in the axes of the far side, m
  Vector<S> curve{};  ///< second rate, likewise

  Motion(const WristJoint<S>& joint, const S& x) {
    const Vector<S>& axis = joint.axis;
    const Bend<S> bend(joint, x);
    // A joint with a chord bends about an axis across z, in the plane of z and this.
    const Vector<S> side{axis.y, -axis.x, S(0)};
    const auto in_plane = [&](const S& across, const S& along) {
      return Vector<S>{across * side.x, across * side.y, along};
    };
    const S& chord = bend.chord;
    const S& longer = bend.chord_rate;
    const S bow = bend.chord_curve - S(0.25) * chord;
    place = in_plane(chord * bend.sine, joint.offset + chord * bend.cosine);
    rate =
        in_plane(S(0.5) * chord * bend.cosine - longer * bend.sine, S(0.5) * chord * bend.sine + longer * bend.cosine);
    curve = in_plane(longer * bend.cosine - bow * bend.sine, longer * bend.sine + bow * bend.cosine);
    const S versine = S(2) * bend.sine * bend.sine;
    const S cosine = S(1) - versine;
    const Vector<S> a = S(2) * bend.sine * bend.cosine * axis;
    const Vector<S> b = versine * axis;
    row[0] = {cosine + b.x * axis.x, b.x * axis.y - a.z, b.x * axis.z + a.y};
    row[1] = {b.y * axis.x + a.z, cosine + b.y * axis.y, b.y * axis.z - a.x};
    row[2] = {b.z * axis.x - a.y, b.z * axis.y + a.x, cosine + b.z * axis.z};
  }

  Vector<S> outward(const Vector<S>& v) const { return v.x * row[0] + v.y * row[1] + v.z * row[2]; }
};

/// How a link moves: its joint's far end, and its turn, in its axes.
template <class S>
struct Twist {
  Vector<S> moved{};
  Vector<S> turned{};
};

}  // namespace detail

/// Mass matrix of the joints' angles, kg m^2, and the moments that accelerate the links at constant rates, N m.
///
/// x: coordinates of the joints; speed: rates of their angles, rad/s.
template <class W, class S = W::S>
void inertia(const W& wrist, const Link<S>* link, const S* x, const S* speed, S (*matrix)[W::joints], S* bias) {
  constexpr int N = W::joints;
  detail::Twist<S> by[N][N];   // of every link, by the rates of its own joint and of those before it
  detail::Twist<S> faster[N];  // accelerations at constant rates
  Vector<S> turning[N];
  for (int i = 0; i < N; ++i) {
    bias[i] = S(0);
    for (int j = 0; j < N; ++j) matrix[i][j] = S(0);
  }
  for (int k = 0; k < N; ++k) {
    const detail::Motion<S> motion(wrist.joint[k], x[k]);
    const int on = wrist.joint[k].parent;
    const Vector<S> spin = speed[k] * wrist.joint[k].axis;
    by[k][k] = {motion.rate, wrist.joint[k].axis};
    faster[k].moved = speed[k] * speed[k] * motion.curve;
    turning[k] = spin;
    if (on >= 0) {
      for (int i = on; i >= 0; i = wrist.joint[i].parent) {
        const detail::Twist<S>& before = by[on][i];
        by[k][i] = {motion.outward(before.moved + cross(before.turned, motion.place)), motion.outward(before.turned)};
      }
      const Vector<S>& before = turning[on];
      const Vector<S> carried = motion.outward(before);
      const Vector<S> base =
          faster[on].moved + cross(faster[on].turned, motion.place) + cross(before, cross(before, motion.place));
      turning[k] = turning[k] + carried;
      faster[k].moved = faster[k].moved + motion.outward(base) + S(2) * speed[k] * cross(carried, motion.rate);
      faster[k].turned = motion.outward(faster[on].turned) + cross(carried, spin);
    }

    // Momentum of a motion about the joint's far end; the centre of mass lies on the link's z axis.
    const S first = link[k].mass * link[k].centre;
    const Vector<S>& about = link[k].inertia;
    const auto times = [&](const Vector<S>& v) { return Vector<S>{about.x * v.x, about.y * v.y, about.z * v.z}; };
    const auto momentum = [&](const detail::Twist<S>& of) {
      Wrench<S> at{link[k].mass * of.moved, times(of.turned)};
      at.force.x = at.force.x + first * of.turned.y;
      at.force.y = at.force.y - first * of.turned.x;
      at.moment.x = at.moment.x - first * of.moved.y;
      at.moment.y = at.moment.y + first * of.moved.x;
      return at;
    };
    const Vector<S>& w = turning[k];
    Wrench<S> force = momentum(faster[k]);
    force.force = force.force + first * Vector<S>{w.x * w.z, w.y * w.z, -(w.x * w.x + w.y * w.y)};
    force.moment = force.moment + cross(w, times(w));
    const auto work = [&](int i, const Wrench<S>& of) {
      return dot(by[k][i].moved, of.force) + dot(by[k][i].turned, of.moment);
    };
    for (int i = k; i >= 0; i = wrist.joint[i].parent) {
      bias[i] = bias[i] + work(i, force);
      const Wrench<S> at = momentum(by[k][i]);
      for (int j = i; j >= 0; j = wrist.joint[j].parent) matrix[i][j] = matrix[i][j] + work(j, at);
    }
  }
  for (int i = 0; i < N; ++i)
    for (int j = wrist.joint[i].parent; j >= 0; j = wrist.joint[j].parent) matrix[j][i] = matrix[i][j];
}

}  // namespace tenodesis

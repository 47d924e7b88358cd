#pragma once
// Inertia of a wrist's links: mass matrix and the moments of its motion, by the composite-rigid-body method and the
// recursive Newton-Euler method (Featherstone 2008), for joints that turn, move along a chord and turn again.

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

/// Mass, first moment and symmetric inertia of links together, about a point.
template <class S>
struct Composite {
  S mass{};
  Vector<S> first{};    ///< mass times place of its centre, kg m
  Vector<S> column[3];  ///< of the inertia, kg m^2

  Vector<S> times(const Vector<S>& a) const { return a.x * column[0] + a.y * column[1] + a.z * column[2]; }

  void add(const Composite& other) {
    mass = mass + other.mass;
    first = first + other.first;
    for (int c = 0; c < 3; ++c) column[c] = column[c] + other.column[c];
  }

  /// In other axes, by a rotation of vectors.
  template <class Turn>
  Composite turned(const Turn& turn) const {
    Composite to{mass, turn(first), {}};
    // Rows and columns in turn: the transpose in between is its own, since the inertia is symmetric.
    const Vector<S> half[3] = {turn(column[0]), turn(column[1]), turn(column[2])};
    to.column[0] = turn(Vector<S>{half[0].x, half[1].x, half[2].x});
    to.column[1] = turn(Vector<S>{half[0].y, half[1].y, half[2].y});
    to.column[2] = turn(Vector<S>{half[0].z, half[1].z, half[2].z});
    return to;
  }

  /// About another point, from which the present one is at r.
  void move(const Vector<S>& r) {
    const Vector<S> add = mass * r + S(2) * first;
    const S trace = dot(r, add);
    const auto crossed = [&](const S& on, const S& other) { return mass * on * r + on * first + other * r; };
    column[0] = column[0] - crossed(r.x, first.x);
    column[1] = column[1] - crossed(r.y, first.y);
    column[2] = column[2] - crossed(r.z, first.z);
    column[0].x = column[0].x + trace;
    column[1].y = column[1].y + trace;
    column[2].z = column[2].z + trace;
    first = first + mass * r;
  }
};

/// A joint at an angle, as a moving frame.
template <class S>
struct Motion {
  Vector<S> axis{};
  Bend<S> bend{};
  Vector<S> place{};  ///< of the far end, in the axes and from the end of what the joint stands on, m
  Vector<S> rate{};   ///< of that by the angle, in the axes of the far side, m
  Vector<S> curve{};  ///< second rate, likewise

  Motion() = default;
  Motion(const WristJoint<S>& joint, const S& x) : axis(joint.axis), bend(joint, x) {
    const Vector<S> along{S(0), S(0), bend.chord};
    const Vector<S> longer{S(0), S(0), bend.chord_rate};
    place = bend.inward(axis, along);
    place.z = place.z + joint.offset;
    const Vector<S> swept = S(0.5) * cross(axis, along);
    rate = bend.outward(axis, swept + longer);
    curve =
        bend.outward(axis, S(0.5) * cross(axis, swept) + cross(axis, longer) + Vector<S>{S(0), S(0), bend.chord_curve});
  }

  Vector<S> inward(const Vector<S>& v) const { return bend.inward(axis, bend.inward(axis, v)); }
  Vector<S> outward(const Vector<S>& v) const { return bend.outward(axis, bend.outward(axis, v)); }
};

}  // namespace detail

/// Mass matrix of the joints' angles, kg m^2, and the moments that accelerate the links at constant rates, N m.
///
/// x: coordinates of the joints; speed: rates of their angles, rad/s.
template <class W, class S = W::S>
void inertia(const W& wrist, const Link<S>* link, const S* x, const S* speed, S (*matrix)[W::joints], S* bias) {
  constexpr int N = W::joints;
  using detail::Composite;
  using detail::Motion;
  Motion<S> motion[N];
  Composite<S> beyond[N];
  Wrench<S> force[N];
  Vector<S> turning[N];
  Vector<S> turning_faster[N];
  Vector<S> accelerated[N];
  for (int i = 0; i < N; ++i) {
    motion[i] = Motion<S>(wrist.joint[i], x[i]);
    const Motion<S>& by = motion[i];
    const int on = wrist.joint[i].parent;
    const Vector<S> spin = speed[i] * by.axis;
    if (on < 0) {
      turning[i] = spin;
      accelerated[i] = speed[i] * speed[i] * by.curve;
    } else {
      const Vector<S>& before = turning[on];
      const Vector<S> carried = by.outward(before);
      turning[i] = carried + spin;
      turning_faster[i] = by.outward(turning_faster[on]) + cross(carried, spin);
      const Vector<S> base =
          accelerated[on] + cross(turning_faster[on], by.place) + cross(before, cross(before, by.place));
      accelerated[i] = by.outward(base) + S(2) * speed[i] * cross(carried, by.rate) + speed[i] * speed[i] * by.curve;
    }

    const Vector<S>& w = turning[i];
    const Vector<S> first{S(0), S(0), link[i].mass * link[i].centre};
    const Vector<S>& about = link[i].inertia;
    const auto times = [&](const Vector<S>& v) { return Vector<S>{about.x * v.x, about.y * v.y, about.z * v.z}; };
    force[i].force = link[i].mass * accelerated[i] + cross(turning_faster[i], first) + cross(w, cross(w, first));
    force[i].moment = cross(first, accelerated[i]) + times(turning_faster[i]) + cross(w, times(w));
    beyond[i] = {link[i].mass, first, {{about.x, S(0), S(0)}, {S(0), about.y, S(0)}, {S(0), S(0), about.z}}};
  }
  const auto work = [&](int i, const Wrench<S>& w) {
    return dot(motion[i].axis, w.moment) + dot(motion[i].rate, w.force);
  };
  const auto near = [&](int i, const Wrench<S>& far) {
    Wrench<S> at{motion[i].inward(far.force), motion[i].inward(far.moment)};
    at.moment = at.moment + cross(motion[i].place, at.force);
    return at;
  };
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j) matrix[i][j] = S(0);
  for (int i = N - 1; i >= 0; --i) {
    const Motion<S>& by = motion[i];
    bias[i] = work(i, force[i]);
    // Momentum of all beyond at a unit of the joint's rate.
    Wrench<S> momentum{beyond[i].mass * by.rate + cross(by.axis, beyond[i].first),
                       cross(beyond[i].first, by.rate) + beyond[i].times(by.axis)};
    matrix[i][i] = work(i, momentum);
    int at = i;
    for (int on = wrist.joint[i].parent; on >= 0; on = wrist.joint[on].parent) {
      momentum = near(at, momentum);
      matrix[i][on] = matrix[on][i] = work(on, momentum);
      at = on;
    }
    const int on = wrist.joint[i].parent;
    if (on < 0) continue;
    const Wrench<S> passed = near(i, force[i]);
    force[on].force = force[on].force + passed.force;
    force[on].moment = force[on].moment + passed.moment;
    Composite<S> moved = beyond[i].turned([&](const Vector<S>& v) { return by.inward(v); });
    moved.move(by.place);
    beyond[on].add(moved);
  }
}

}  // namespace tenodesis

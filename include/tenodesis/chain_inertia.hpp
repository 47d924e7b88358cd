#pragma once
// Inertia of a chain's links, by the twists that the rate of a joint gives itself and the links beyond it
// (Featherstone 2008), for joints that turn, move along a chord and turn again.

#include "tenodesis/tendon_chain.hpp"

namespace tenodesis {

/// A rigid body at the far end of a joint, in its axes; z along the link.
template <class S>
struct Link {
  S mass{};             ///< kg
  S centre{};           ///< of mass, from the joint's far end along z, m
  Vector<S> inertia{};  ///< about the far end of the joint, about x, y and z, kg m^2
};

namespace detail {

/// How a link moves: its joint's far end, and its turn, in its axes.
template <class S>
struct Twist {
  Vector<S> moved{};
  Vector<S> turned{};
};

/// A joint at an angle, as a moving frame; Axis: a vector, or a direction (rotation.hpp).
template <class S, class Axis>
struct Motion {
  Axis axis;
  S sine{};  ///< of the angle
  S cosine{};
  Vector<S> place{};  ///< of the far end, in the axes and from the end of what the joint stands on, m
  Vector<S> rate{};   ///< of that by the angle, in the axes of the far side, m
  Vector<S> curve{};  ///< second rate, likewise

  // NOLINTNEXTLINE(modernize-pass-by-value): an axis has nothing to move
  Motion(const Axis& about, const Bend<S>& bend, const S& offset) : axis(about) {
    // A joint with a chord bends about an axis across z, in the plane of z and this.
    const Vector<S> side = cross(axis, Vector<S>{S(0), S(0), S(1)});
    const auto in_plane = [&](const S& across, const S& along) {
      return Vector<S>{across * side.x, across * side.y, along};
    };
    const S& chord = bend.chord;
    const S& longer = bend.chord_rate;
    const S bow = bend.chord_curve - S(0.25) * chord;
    place = in_plane(chord * bend.sine, offset + chord * bend.cosine);
    rate =
        in_plane(S(0.5) * chord * bend.cosine - longer * bend.sine, S(0.5) * chord * bend.sine + longer * bend.cosine);
    curve = in_plane(longer * bend.cosine - bow * bend.sine, longer * bend.sine + bow * bend.cosine);
    sine = S(2) * bend.sine * bend.cosine;
    cosine = S(1) - S(2) * bend.sine * bend.sine;
  }

  Vector<S> outward(const Vector<S>& v) const { return turned(axis, v, -sine, cosine); }
};

/// Two joints of which one bends within the other, as one moving frame.
template <class S>
struct PairMotion {
  Vector<S> place{};  ///< of the far end, in the axes and from the end of what they stand on, m
  Twist<S> by_outer{}, by_inner{};
  Vector<S> outer{}, inner{};  ///< axes, at the near end
  Bend<S> around, inside;

  /// k: the inner joint; x: coordinates of all.
  template <class W>
  PairMotion(const W& chain, int k, const S* x)
      : outer(chain.template axis<S>(k - 1)),
        inner(chain.template axis<S>(k)),
        around(chain.bend(k - 1, x[k - 1])),
        inside(chain.bend(k, x[k])) {
    axis_ = around.outward(outer, inner);  // of the inner joint, in the axes of the far end
    // The chord's direction, and the inner axis where it bends, in the axes of the near end.
    const auto back = [](const Bend<S>& bend, const Vector<S>& axis, const Vector<S>& v) {
      return bend.inward(axis, v);
    };
    along_ = back(around, outer, back(inside, inner, Vector<S>{S(0), S(0), S(1)}));
    bent_ = back(around, outer, inner);
    seen_ = around.outward(outer, inside.outward(inner, inside.outward(inner, outer)));
    const S chord = around.chord * inside.chord;
    place = chord * along_;
    place.z = place.z + chain.joint[k - 1].offset;
    const S outer_rate = around.chord_rate * inside.chord, inner_rate = around.chord * inside.chord_rate;
    by_outer = {outward(outer_rate * along_ + (S(0.5) * chord) * cross(outer, along_)), S(0.5) * (outer + seen_)};
    by_inner = {outward(inner_rate * along_ + (S(0.5) * chord) * cross(bent_, along_)), axis_};
  }

  Vector<S> outward(const Vector<S>& v) const {
    return around.outward(outer, inside.outward(inner, inside.outward(inner, around.outward(outer, v))));
  }

  /// Accelerations in the far axes where the angles turn at constant rates, rad/s.
  Twist<S> faster(const S& of_outer, const S& of_inner) const {
    const S chord = around.chord * inside.chord;
    const Vector<S> swing = S(0.5) * (of_outer * outer + of_inner * bent_);  // of the chord
    // The chord's direction turns with the outer joint, and about the inner axis that this carries.
    const Vector<S> turn = cross(swing, along_);
    const Vector<S> bow = cross(swing, turn) + (S(0.25) * of_outer * of_inner) * cross(cross(outer, bent_), along_);
    const S lengthens = of_outer * around.chord_rate * inside.chord + of_inner * around.chord * inside.chord_rate;
    const S faster = of_outer * of_outer * around.chord_curve * inside.chord +
                     S(2) * of_outer * of_inner * around.chord_rate * inside.chord_rate +
                     of_inner * of_inner * around.chord * inside.chord_curve;
    const Vector<S> moved = faster * along_ + (S(2) * lengthens) * turn + chord * bow;
    const Vector<S> half = S(-0.5) * of_outer * outer;
    return {outward(moved), of_inner * cross(half, axis_) +
                                (S(0.5) * of_outer) * (cross(half, seen_) - of_inner * cross(axis_, seen_))};
  }

 private:
  Vector<S> along_{}, bent_{}, axis_{}, seen_{};
};

}  // namespace detail

/// Mass matrix of the joints' angles, kg m^2, and the moments that accelerate the links at constant rates, N m.
///
/// x: coordinates of the joints; speed: rates of their angles, rad/s.
template <class W, class S = W::S>
void inertia(const W& chain, const Link<S>* link, const S* x, const S* speed, S (*matrix)[W::joints], S* bias) {
  constexpr int N = W::joints;
  detail::Twist<S> by[N][N];   // of every link, by the rates of its own joint and of those before it
  detail::Twist<S> faster[N];  // accelerations at constant rates
  Vector<S> turning[N];
  for (int i = 0; i < N; ++i) {
    bias[i] = S(0);
    for (int j = 0; j < N; ++j) matrix[i][j] = S(0);
  }
  W::each_joint([&](auto k) {
    if (chain.is_around(k)) return;
    // What the motions of the joints before make of this link's: its own motion has a rate of its far end by a speed,
    // given twice, and a spin.
    const auto carry = [&](int on, const auto& motion, const S& twice, const Vector<S>& rate, const Vector<S>& spin) {
      if (on < 0) return;
      for (int i = on; i >= 0; i = chain.parent(i)) {
        const detail::Twist<S>& before = by[on][i];
        by[k][i] = {motion.outward(before.moved + cross(before.turned, motion.place)), motion.outward(before.turned)};
      }
      const Vector<S>& before = turning[on];
      const Vector<S> carried = motion.outward(before);
      const Vector<S> base =
          faster[on].moved + cross(faster[on].turned, motion.place) + cross(before, cross(before, motion.place));
      turning[k] = turning[k] + carried;
      faster[k].moved = faster[k].moved + motion.outward(base) + twice * cross(carried, rate);
      faster[k].turned = faster[k].turned + motion.outward(faster[on].turned) + cross(carried, spin);
    };
    if constexpr (!W::known && N > 1)
      if (chain.is_within(k)) {
        const int o = k - 1;
        const detail::PairMotion<S> motion(chain, k, x);
        by[k][o] = motion.by_outer;
        by[k][k] = motion.by_inner;
        const S &of_outer = speed[o], &of_inner = speed[k];
        faster[k] = motion.faster(of_outer, of_inner);
        turning[k] = of_outer * motion.by_outer.turned + of_inner * motion.by_inner.turned;
        const Vector<S> moved = of_outer * motion.by_outer.moved + of_inner * motion.by_inner.moved;
        carry(chain.parent(o), motion, S(2), moved, turning[k]);
      }
    if (!chain.is_within(k)) {
      const auto axis = chain.template axis<S>(k);
      const detail::Motion<S, std::remove_const_t<decltype(axis)>> motion(axis, chain.bend(k, x[k]),
                                                                          chain.joint[k].offset);
      const Vector<S> unit = vector_of(axis);
      by[k][k] = {motion.rate, unit};
      faster[k].moved = speed[k] * speed[k] * motion.curve;
      turning[k] = speed[k] * unit;
      carry(chain.parent(k), motion, S(2) * speed[k], motion.rate, turning[k]);
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
    for (int i = k; i >= 0; i = chain.parent(i)) {
      bias[i] = bias[i] + work(i, force);
      const Wrench<S> at = momentum(by[k][i]);
      for (int j = i; j >= 0; j = chain.parent(j)) matrix[i][j] = matrix[i][j] + work(j, at);
    }
  });
  for (int i = 0; i < N; ++i)
    for (int j = chain.parent(i); j >= 0; j = chain.parent(j)) matrix[j][i] = matrix[i][j];
}

}  // namespace tenodesis

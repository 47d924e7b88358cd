#pragma once
// Kinematics of the instrument in space: a spherical joint at the port, a prismatic joint through it, the joints of the
// tip in a tree, the roll of the end-effectors, and the joints of the handle at the stem's other end (Fig. 1: seven
// joints, with two bending axes).
//
// The port is the origin. At zero angles the stem lies along z, tip up; yaw bends the tip toward x and pitch toward y,
// as pan and tilt do with the stem. A joint turns by half its angle, moves along its chord, and turns by the other
// half: a rolling gear pair about the centre of the fixed gear and then about that of the moving gear.

#include "tenodesis/tendon_chain.hpp"

namespace tenodesis {

/// Position, m, and orientation of a body.
template <class S>
struct Frame {
  Vector<S> position{};
  Rotation<S> rotation{};

  constexpr Frame turned(const Rotation<S>& by) const { return {position, rotation * by}; }
  constexpr Frame moved(const S& along_z) const { return moved(Vector<S>{S(0), S(0), along_z}); }
  constexpr Frame moved(const Vector<S>& by) const { return {position + rotation * by, rotation}; }
};

/// Coordinates of every joint, rad and m; joints in the chain's order. All but the handle's determine the ends.
template <class S, int N>
struct Posture {
  S pan{}, tilt{}, spin{};  ///< of the stem about the port
  S insertion{};            ///< of the stem's distal end beyond the port
  S bend[N]{};              ///< output angles
  S roll{};                 ///< of the end-effectors about themselves
  S handle[N]{};            ///< handle angles
};

/// A bent joint: its carrier starts at its end on the stem's side, its far body at the other end. Of two joints of
/// which one bends within the other, the inner one has the far body of both, and the outer one's carrier begins where
/// its does.
template <class S>
struct Bent {
  Frame<S> carrier, far;
};

/// Frames of all bodies.
template <class S, int N>
struct Bodies {
  Frame<S> stem;  ///< at its distal end
  Bent<S> tip[N], handle[N];
  Frame<S> end_effector[N];  ///< the far body of a tip's joint, rolled
  Frame<S> end[N];           ///< where the force acts
  Frame<S> grip[N];          ///< where the hand acts beyond a joint of the handle
};

/// The constants of an instrument of at most N joints at either end, lengths in m.
template <class Scalar, int N>
struct Chain {
  using S = Scalar;

  int joints{1}, handles{};
  ChainJoint<S> tip[N]{};     ///< each after the one that it stands on
  ChainJoint<S> handle[N]{};  ///< one after another, from the stem outward
  S stem_length{};            ///< between the joints' ends nearest to it
};

/// Orientation of the stem.
template <class S>
Rotation<S> stem_rotation(const S& pan, const S& tilt, const S& spin) {
  return about_y(pan) * about_x(-tilt) * about_z(spin);
}

/// Side to which a positive angle bends a joint about an axis (a unit vector): that of the agonist.
template <class S>
Vector<S> bend_side(const Vector<S>& axis) {
  const bool rolls = axis.z > S(0.999) || axis.z < S(-0.999);
  const Vector<S> side = rolls ? cross(axis, Vector<S>{S(1), S(0), S(0)}) : Vector<S>{axis.y, -axis.x, S(0)};
  return (S(1) / norm(side)) * side;
}

/// A joint of a chain bent by an angle (rad).
template <class C, class S>
constexpr Bend<S> bend_at(const ChainJoint<C>& joint, const S& angle) {
  return {joint, coordinate_at(joint.mechanism, angle)};
}

/// A joint that begins at a frame, bent by an angle (rad); side is -1 where it points to the handle.
template <class C, class S>
Bent<S> bent(const Frame<S>& near, const ChainJoint<C>& joint, const S& angle, int side) {
  const Rotation<S> half = about(joint.axis, angle * S(0.5));
  const Frame<S> carrier = near.turned(half);
  return {carrier, carrier.moved(S(side) * bend_at(joint, angle).chord).turned(half)};
}

/// Whether a joint of the tip bends within the one before it, or the one after it bends within this.
template <class C, int N>
bool is_within(const Chain<C, N>& chain, int i) {
  return i > 0 && i < chain.joints && chain.tip[i].within;
}
template <class C, int N>
bool is_around(const Chain<C, N>& chain, int i) {
  return is_within(chain, i + 1);
}

/// The same of a joint within another, which begins where that one does; outer: the other, bent by its own angle.
template <class C, class S>
Bent<S> bent_within(const Bent<S>& around, const ChainJoint<C>& outer, const S& outer_angle, const ChainJoint<C>& joint,
                    const S& angle) {
  const S chord = bend_at(outer, outer_angle).chord * bend_at(joint, angle).chord;
  const Rotation<S> half = about(joint.axis, angle * S(0.5));
  const Frame<S> carrier = around.carrier.turned(half);
  return {carrier, carrier.moved(chord).turned(half).turned(about(outer.axis, outer_angle * S(0.5)))};
}

/// Frames of all bodies at a posture, in any number type that the chain's scalar converts to (Fig. 1).
template <class C, class S, int N>
Bodies<S, N> bodies(const Chain<C, N>& chain, const Posture<S, N>& at) {
  Bodies<S, N> found{};
  found.stem = Frame<S>{{}, stem_rotation(at.pan, at.tilt, at.spin)}.moved(at.insertion);
  const Rotation<S> rolled = about_z(at.roll);
  for (int i = 0; i < chain.joints; ++i) {
    const ChainJoint<C>& joint = chain.tip[i];
    const Frame<S>& on = joint.parent < 0 ? found.stem : found.tip[joint.parent].far;
    if (i > 0 && is_within(chain, i))
      found.tip[i] = bent_within(found.tip[i - 1], chain.tip[i - 1], at.bend[i - 1], joint, at.bend[i]);
    else
      found.tip[i] = bent(on.moved(S(joint.offset)), joint, at.bend[i], 1);
    found.end_effector[i] = found.tip[i].far.turned(rolled);
    found.end[i] = found.end_effector[i].moved(S(joint.length));
  }
  Frame<S> on = found.stem.moved(S(-chain.stem_length));
  for (int i = 0; i < chain.handles; ++i) {
    const ChainJoint<C>& joint = chain.handle[i];
    found.handle[i] = bent(on.moved(S(-joint.offset)), joint, at.handle[i], -1);
    on = found.handle[i].far;
    found.grip[i] = on.moved(S(-joint.length));
  }
  return found;
}

/// Velocity (m/s) and angular velocity (rad/s) of an end by the rate of each coordinate, in the port's frame: pan,
/// tilt, spin, insertion, the tip's joints, roll.
template <class S, int N>
struct Jacobian {
  Vector<S> linear[5 + N]{};
  Vector<S> angular[5 + N]{};
};

/// The Jacobian of the end beyond a joint of the tip: both halves of an angle turn what is beyond them, and a
/// backbone's chord shortens.
template <class S, int N>
Jacobian<S, N> jacobian(const Chain<S, N>& chain, const Posture<S, N>& at, int end) {
  const Bodies<S, N> found = bodies(chain, at);
  const Vector<S> tip = found.end[end].position, ahead{S(0), S(0), S(1)};
  Jacobian<S, N> rates{};
  const auto turn = [&](int column, const Vector<S>& axis, const Vector<S>& centre) {
    rates.linear[column] = cross(axis, tip - centre);
    rates.angular[column] = axis;
  };
  const Vector<S> stem = found.stem.rotation * ahead;
  turn(0, Vector<S>{S(0), S(1), S(0)}, {});
  turn(1, about_y(at.pan) * Vector<S>{S(-1), S(0), S(0)}, {});
  turn(2, stem, {});
  rates.linear[3] = stem;
  for (int i = end; i >= 0; i = chain.tip[i].parent) {
    const auto& [carrier, far] = found.tip[i];
    if (i > 0 && is_within(chain, i)) {
      // The outer joint turns what is beyond its near end by half, and what is beyond the inner one by half.
      const int o = i - 1;
      const ChainJoint<S>&inner = chain.tip[i], &outer = chain.tip[o];
      const Bend<S> inside = bend_at(inner, at.bend[i]), around = bend_at(outer, at.bend[o]);
      const Vector<S> along = carrier.rotation * ahead, chord = around.chord * inside.chord * along;
      const auto half = [&](int column, const Vector<S>& axis, const Vector<S>& centre) {
        rates.linear[column] = rates.linear[column] + S(0.5) * cross(axis, tip - centre);
        rates.angular[column] = rates.angular[column] + S(0.5) * axis;
      };
      half(4 + o, found.tip[o].carrier.rotation * outer.axis, carrier.position);
      half(4 + o, far.rotation * outer.axis, far.position);
      rates.linear[4 + o] = rates.linear[4 + o] + around.chord_rate * inside.chord * along;
      turn(4 + i, carrier.rotation * inner.axis, carrier.position + S(0.5) * chord);
      rates.linear[4 + i] = rates.linear[4 + i] + around.chord * inside.chord_rate * along;
      continue;
    }
    if (is_around(chain, i)) continue;
    // Its own half turn leaves the axis where it is.
    turn(4 + i, carrier.rotation * chain.tip[i].axis, S(0.5) * (carrier.position + far.position));
    rates.linear[4 + i] =
        rates.linear[4 + i] + bend_at(chain.tip[i], at.bend[i]).chord_rate * (carrier.rotation * ahead);
  }
  turn(4 + chain.joints, found.end_effector[end].rotation * ahead, found.end_effector[end].position);
  return rates;
}

/// How an inverse ended.
enum class Reach : unsigned char {
  ok,
  unreachable,  ///< the tip is too near to the port for the bending joints
  singular,     ///< two joints have the same axis there
  not_finite,
  other_joints,  ///< the tip does not have one or two joints, across the stem and each other
};

/// Result of an inverse.
template <class S, int N>
struct Reached {
  Posture<S, N> posture{};
  S residual{};  ///< error of the tip's position, m
  Reach reach{};
};

namespace detail {

/// Unit vector half-way between two of them.
template <class S>
Vector<S> bisector(const Vector<S>& a, const Vector<S>& b) {
  const Vector<S> sum = a + b;
  return (S(1) / norm(sum)) * sum;
}

/// Angle between two unit vectors, less than half a turn, rad.
template <class S>
S angle_between(const Vector<S>& a, const Vector<S>& b) {
  const Vector<S> apart = a - b;
  const S square = dot(apart, apart);
  // A chord depends only on the angle's square: at zero its slope is zero, where that of a square root is undefined.
  if (!(value_of(square) > ValueOf<S>(0))) return S(0);
  return S(2) * asin(smaller(sqrt(square) * S(0.5), S(1)));
}

template <class S, class C>
constexpr Vector<S> converted(const Vector<C>& v) {
  return {S(v.x), S(v.y), S(v.z)};
}

/// Whether one or two joints, one on the other, bend the tip about axes across the stem and each other.
template <class S, int N>
bool solvable(const Chain<S, N>& chain) {
  const S fine = S(64) * std::numeric_limits<S>::epsilon();
  const auto across = [&](const S& cosine) { return abs(cosine) <= fine; };
  const ChainJoint<S>&first = chain.tip[0], &last = chain.tip[chain.joints - 1];
  return chain.joints <= 2 && !last.within && across(first.axis.z) && across(last.axis.z) &&
         (chain.joints == 1 || (last.parent == 0 && across(dot(first.axis, last.axis))));
}

/// From the stem's distal end to the tip, in the stem's frame; the end-effector's direction determines the bending.
template <class C, class S, int N>
Vector<S> reach_of(const Chain<C, N>& chain, const Vector<S>& pointing) {
  Vector<S> from{S(0), S(0), S(1)};
  Vector<S> sum{};
  for (int i = 0; i < chain.joints; ++i) {
    const ChainJoint<C>& joint = chain.tip[i];
    Vector<S> to = pointing;
    if (i + 1 < chain.joints) {
      // The link between two joints stays in the plane of the first.
      const Vector<S> axis = converted<S>(joint.axis);
      to = to - dot(axis, to) * axis;
      to = (S(1) / norm(to)) * to;
    }
    sum = sum + S(joint.offset) * from + bend_at(joint, angle_between(from, to)).chord * bisector(from, to);
    from = to;
  }
  return sum + S(chain.tip[chain.joints - 1].length) * pointing;
}

/// Vector from port to tip less the joints' part, in the stem's frame before its spin: x and y must vanish, z is the
/// insertion.
template <class C, class S, class V, int N>
Vector<S> left_over(const Chain<C, N>& chain, const Frame<V>& goal, const S& pan, const S& tilt, const V& spin) {
  const Vector<V> axis = goal.rotation * Vector<V>{V(0), V(0), V(1)};
  const Rotation<S> back = stem_rotation(pan, tilt, S(0)).inverse();
  const Vector<S> pointing = back * Vector<S>{S(axis.x), S(axis.y), S(axis.z)};
  const Vector<S> tip = back * Vector<S>{S(goal.position.x), S(goal.position.y), S(goal.position.z)};
  const Rotation<S> spun = about_z(S(spin));
  return tip - spun * reach_of(chain, spun.inverse() * pointing);
}

template <class S>
S within_half_turn(const S& angle) {
  return angle - S(2 * pi) * round(angle * S(0.5 / pi));
}

}  // namespace detail

/// Start of an inverse, rad, that is to stay near a posture.
template <class S>
struct Start {
  bool given{};
  S pan{}, tilt{};
};

inline constexpr int most_reach_steps = 40, most_reach_halvings = 30;
inline constexpr double longest_reach_step = 0.5;  // rad
/// Other starts, in pan and tilt (rad), if the first does not lead to the goal.
inline constexpr double reach_starts[][2] = {{0, 0},     {0.2, 0},    {-0.2, 0},   {0, 0.2},    {0, -0.2},
                                             {0.2, 0.2}, {-0.2, 0.2}, {0.2, -0.2}, {-0.2, -0.2}};

namespace detail {

/// Pan and tilt of the stem, rad, and the remaining error.
template <class S>
struct Pivot {
  S pan{}, tilt{};
  S insertion{};    // m
  S residual{};     // m, beside the stem's axis
  S determinant{};  // of the residual by pan and tilt; positive where the instrument is straight
  Reach reach{Reach::unreachable};
};

/// Newton's method from a start; a step that does not reduce the error is halved.
template <Real S, int N>
void aim(const Chain<S, N>& chain, const Frame<S>& goal, const S& spin, const S& scale, Pivot<S>& at) {
  using D = Dual<S, 2>;
  const S fine = S(8) * std::numeric_limits<S>::epsilon() * scale;
  for (int step = 0; step < most_reach_steps; ++step) {
    const Vector<D> left = left_over(chain, goal, D::variable(at.pan, 0), D::variable(at.tilt, 1), spin);
    const S &x = left.x.value, &y = left.y.value;
    at.insertion = left.z.value;
    at.residual = sqrt(x * x + y * y);
    at.determinant = left.x.slope[0] * left.y.slope[1] - left.x.slope[1] * left.y.slope[0];
    if (at.residual <= fine) {
      at.reach = Reach::ok;
      return;
    }
    const S by_pan = (y * left.x.slope[1] - x * left.y.slope[1]) / at.determinant;
    const S by_tilt = (x * left.y.slope[0] - y * left.x.slope[0]) / at.determinant;
    if (!all_finite(by_pan, by_tilt)) {
      at.reach = Reach::singular;
      return;
    }
    S share = smaller(S(1), S(longest_reach_step) / sqrt(by_pan * by_pan + by_tilt * by_tilt));
    bool nearer = false;
    for (int halved = 0; halved < most_reach_halvings && !nearer; ++halved, share = share * S(0.5)) {
      const S pan = at.pan + share * by_pan, tilt = at.tilt + share * by_tilt;
      const Vector<S> next = left_over(chain, goal, pan, tilt, spin);
      nearer = sqrt(next.x * next.x + next.y * next.y) < at.residual;
      if (nearer) at.pan = pan, at.tilt = tilt;
    }
    if (nearer) continue;
    // The rest is rounding.
    if (at.residual <= S(64) * fine) at.reach = Reach::ok;
    return;
  }
}

/// The pivot that reaches a goal. Where several do (the second joint bent by more than 60 deg), one on the straight
/// instrument's side of the singularity is preferred, unless a start is given.
template <Real S, int N>
Pivot<S> pivot(const Chain<S, N>& chain, const Frame<S>& goal, const S& spin, const Start<S>& start) {
  const Vector<S>& p = goal.position;
  const Vector<S> ahead{S(0), S(0), S(1)};
  const S straight = reach_of(chain, ahead).z;
  // As if all joints bent about one point.
  const Vector<S> middle = p - (S(0.5) * (straight + chain.tip[chain.joints - 1].length)) * (goal.rotation * ahead);
  const S pan = start.given ? start.pan : angle_of(middle.x, middle.z);
  const S tilt = start.given ? start.tilt : angle_of(middle.y, sqrt(middle.x * middle.x + middle.z * middle.z));
  Pivot<S> found{};
  for (const auto& [by_pan, by_tilt] : reach_starts) {
    Pivot<S> at{pan + S(by_pan), tilt + S(by_tilt)};
    aim(chain, goal, spin, norm(p) + straight, at);
    if (at.reach == Reach::ok && !(at.insertion > S(0))) at.reach = Reach::unreachable;
    const bool ok = at.reach == Reach::ok;
    if (ok || found.reach != Reach::ok) found = at;
    if (ok && (start.given || at.determinant > S(0))) break;
  }
  return found;
}

}  // namespace detail

/// Posture that brings the tip to a goal, by Newton's method in pan and tilt; the rest follows in closed form.
///
/// With two joints the chain is redundant, and the spin is as given. With one joint the spin follows, within a quarter
/// turn of the given one. The second bending angle is within a quarter turn. The handle is left straight: its angle
/// depends on the load.
template <Real S, int N>
Reached<S, N> inverse(const Chain<S, N>& chain, const Frame<S>& goal, const S& spin, const Start<S>& start = {}) {
  const Vector<S>& p = goal.position;
  const Rotation<S>& r = goal.rotation;
  Reached<S, N> found{};
  if (!detail::solvable(chain)) found.reach = Reach::other_joints;
  if (!all_finite(p.x, p.y, p.z, r.w, r.x, r.y, r.z, spin, start.pan, start.tilt)) found.reach = Reach::not_finite;
  if (found.reach != Reach::ok) return found;
  const detail::Pivot<S> pivot = detail::pivot(chain, goal, spin, start);
  found.reach = pivot.reach;
  found.residual = pivot.residual;
  if (found.reach != Reach::ok) return found;

  const Vector<S> ahead{S(0), S(0), S(1)}, axis = r * ahead;
  Posture<S, N>& at = found.posture;
  at = {detail::within_half_turn(pivot.pan), detail::within_half_turn(pivot.tilt), spin, pivot.insertion, {}, {}, {}};
  Vector<S> pointing = stem_rotation(pivot.pan, pivot.tilt, S(0)).inverse() * axis;
  const Vector<S> side = bend_side(chain.tip[0].axis);
  if (chain.joints == 1) {
    const S toward_side = dot(side, pointing), beside = dot(cross(ahead, side), pointing);
    if (toward_side * toward_side + beside * beside > S(0)) {
      const S toward = angle_of(beside, toward_side);
      const S half_turns = round((spin - toward) * S(1 / pi));
      at.spin = toward + S(pi) * half_turns;
    }
  }
  pointing = about_z(at.spin).inverse() * pointing;
  const S first = dot(side, pointing);
  at.bend[0] = angle_of(first, pointing.z);
  if (chain.joints == 2) {
    const S second = dot(bend_side(chain.tip[1].axis), pointing);
    at.bend[1] = angle_of(second, sqrt(first * first + pointing.z * pointing.z));
  }
  const Frame<S> unrolled = bodies(chain, at).end[chain.joints - 1];
  const Rotation<S> rolled = unrolled.rotation.inverse() * r;
  at.roll = detail::within_half_turn(S(2) * angle_of(rolled.z, rolled.w));
  const Vector<S> off = unrolled.position - p;
  found.residual = norm(off);
  if (!is_finite(found.residual + at.roll)) found.reach = Reach::singular;
  return found;
}

}  // namespace tenodesis

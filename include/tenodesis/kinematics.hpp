#pragma once
// Kinematics of the instrument in space: a spherical joint at the port, a prismatic joint through it, the bending
// joints and the roll of the end-effector (Fig. 1: seven joints, with two bending axes), and the handle at the stem's
// other end.
//
// The port is the origin. At zero angles the stem lies along z, tip up; yaw bends the tip toward x and pitch toward y,
// as pan and tilt do with the stem. A rolling gear pair rotates by half its angle about the centre of the fixed gear
// and by the other half about that of the moving gear; the other mechanisms do the same at the ends of their chords.

#include "tenodesis/rotation.hpp"
#include "tenodesis/statics.hpp"

namespace tenodesis {

enum class Direction : unsigned char { yaw, pitch };

/// Length between the two ends of a joint bent by an angle (rad), m; it makes half the angle with either end.
template <class S, class T>
constexpr T chord(const TendonGear<S>& joint, const T&) {
  return T(S(2) * joint.radius);
}
template <class S, class T>
constexpr T chord(const TendonPulley<S>&, const T&) {
  return T(0);
}
template <class S, class T>
constexpr T chord(const TendonContinuum<S>& joint, const T& angle) {
  return T(joint.backbone_length) * sinc_of_square(angle * angle * T(0.25));
}

/// Position, m, and orientation of a body.
template <class S>
struct Frame {
  Vector<S> position{};
  Rotation<S> rotation{};

  constexpr Frame turned(const Rotation<S>& by) const { return {position, rotation * by}; }
  constexpr Frame moved(const S& along_z) const { return moved(Vector<S>{S(0), S(0), along_z}); }
  constexpr Frame moved(const Vector<S>& by) const { return {position + rotation * by, rotation}; }
};

/// Coordinates of every joint, rad and m; bending joints from the stem outward. All but the handle's determine the tip.
template <class S>
struct Posture {
  static constexpr int coordinates = 5 + most_axes;

  S pan{}, tilt{}, spin{};  ///< of the stem about the port
  S insertion{};            ///< of the stem's distal end beyond the port
  S bend[most_axes]{};      ///< output angles
  S roll{};                 ///< of the end-effector about itself
  S handle[most_axes]{};    ///< handle angles
};

/// Frames of all bodies; a joint's carrier starts at its end on the stem's side, its far body at the other end.
template <class S>
struct Bodies {
  Frame<S> stem;  ///< at its distal end
  Frame<S> carrier[most_axes], far[most_axes];
  Frame<S> end_effector;  ///< the last joint's far body, rolled
  Frame<S> tip;           ///< where the force acts
  Frame<S> handle_carrier[most_axes], handle_far[most_axes];
  Frame<S> grip;  ///< where the hand acts
};

/// The constants of the instrument, lengths in m.
template <class A>
struct Chain {
  using Scalar = A::Scalar;

  int axes{1};
  A axis[most_axes]{};               ///< from the stem outward
  Direction direction[most_axes]{};  ///< of each axis
  Scalar stem_length{};              ///< between the joints' ends nearest to it
  Scalar joint_spacing{};            ///< of two distal joints, from end to end
  Scalar handle_joint_spacing{};     ///< of two proximal joints

  /// Place of the axis nearest to the tip.
  constexpr int last() const { return axes == most_axes ? most_axes - 1 : 0; }
  /// From the last distal joint's far end to where the force acts.
  constexpr Scalar end_effector_length() const { return axis[last()].distal.length; }
  /// From the last proximal joint's far end to where the hand acts.
  constexpr Scalar handle_length() const { return axis[last()].proximal.length; }
};

/// Rotation that bends a straight joint by an angle (rad).
template <class S>
Rotation<S> bend(Direction direction, const S& angle) {
  return direction == Direction::yaw ? about_y(angle) : about_x(-angle);
}

/// Orientation of the stem.
template <class S>
Rotation<S> stem_rotation(const S& pan, const S& tilt, const S& spin) {
  return bend(Direction::yaw, pan) * bend(Direction::pitch, tilt) * about_z(spin);
}

namespace detail {

/// Places a joint's carrier and far body on a frame, and returns the latter; side is -1 where it points to the handle.
template <class S, class J>
Frame<S> pass(const Frame<S>& on, const J& joint, Direction direction, const S& angle, int side, Frame<S>& carrier,
              Frame<S>& far) {
  const Rotation<S> half = bend(direction, angle * S(0.5));
  carrier = on.turned(half);
  return far = carrier.moved(S(side) * chord(joint, angle)).turned(half);
}

}  // namespace detail

/// Frames of all bodies at a posture, in any number type that the chain's scalar converts to (Fig. 1).
template <class A, class S>
Bodies<S> bodies(const Chain<A>& chain, const Posture<S>& at) {
  Bodies<S> found{};
  found.stem = Frame<S>{{}, stem_rotation(at.pan, at.tilt, at.spin)}.moved(at.insertion);
  Frame<S> on = found.stem;
  Frame<S> handle_on = found.stem.moved(S(-chain.stem_length));
  for (int i = 0; i < chain.axes; ++i) {
    if (i > 0) {
      on = on.moved(S(chain.joint_spacing));
      handle_on = handle_on.moved(S(-chain.handle_joint_spacing));
    }
    const Direction direction = chain.direction[i];
    on = detail::pass(on, chain.axis[i].distal, direction, at.bend[i], 1, found.carrier[i], found.far[i]);
    handle_on = detail::pass(handle_on, chain.axis[i].proximal, direction, at.handle[i], -1, found.handle_carrier[i],
                             found.handle_far[i]);
  }
  found.end_effector = on.turned(about_z(at.roll));
  found.tip = found.end_effector.moved(S(chain.end_effector_length()));
  found.grip = handle_on.moved(S(-chain.handle_length()));
  return found;
}

/// Velocity (m/s) and angular velocity (rad/s) of the tip by the rate of each coordinate, in the port's frame.
template <class S>
struct Jacobian {
  Vector<S> linear[Posture<S>::coordinates]{};
  Vector<S> angular[Posture<S>::coordinates]{};
};

/// The Jacobian of a posture's tip, by dual numbers.
template <class A>
Jacobian<typename A::Scalar> jacobian(const Chain<A>& chain, const Posture<typename A::Scalar>& at) {
  using S = A::Scalar;
  constexpr int n = Posture<S>::coordinates;
  using D = Dual<S, n>;
  Posture<D> point{D::variable(at.pan, 0),
                   D::variable(at.tilt, 1),
                   D::variable(at.spin, 2),
                   D::variable(at.insertion, 3),
                   {},
                   D::variable(at.roll, n - 1),
                   {}};
  for (int i = 0; i < most_axes; ++i) {
    point.bend[i] = D::variable(at.bend[i], std::size_t(4) + std::size_t(i));
    point.handle[i] = D(at.handle[i]);
  }
  const Frame<D> tip = bodies(chain, point).tip;
  const Rotation<D>& r = tip.rotation;
  const Rotation<S> back = Rotation<S>{r.w.value, r.x.value, r.y.value, r.z.value}.inverse();
  Jacobian<S> found{};
  for (int k = 0; k < n; ++k) {
    found.linear[k] = {tip.position.x.slope[k], tip.position.y.slope[k], tip.position.z.slope[k]};
    const Rotation<S> rate = Rotation<S>{r.w.slope[k], r.x.slope[k], r.y.slope[k], r.z.slope[k]} * back;
    found.angular[k] = S(2) * Vector<S>{rate.x, rate.y, rate.z};
  }
  return found;
}

/// Handle angle that holds an axis's output angle without a load, rad (eq. 18).
template <class A>
auto unloaded_handle(const Chain<A>& chain, int axis, const typename A::Scalar& output_angle) {
  return handle_angle(chain.axis[axis], output_angle, Load<typename A::Scalar>{});
}

/// How an inverse ended.
enum class Reach : unsigned char {
  ok,
  unreachable,  ///< the tip is too near to the port for the bending joints
  singular,     ///< two joints have the same axis there
  not_finite,
};

/// Result of an inverse.
template <class S>
struct Reached {
  Posture<S> posture{};
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

template <class S>
constexpr S along(Direction direction, const Vector<S>& v) {
  return direction == Direction::yaw ? v.x : v.y;
}

/// From the stem's distal end to the tip, in the stem's frame; the end-effector's direction determines the bending.
template <class A, class S>
Vector<S> reach_of(const Chain<A>& chain, const Vector<S>& pointing) {
  Vector<S> from{S(0), S(0), S(1)};
  Vector<S> sum{};
  for (int i = 0; i < chain.axes; ++i) {
    Vector<S> to = pointing;
    if (i + 1 < chain.axes) {
      // The link between two joints stays in the plane of the first.
      (chain.direction[i] == Direction::yaw ? to.y : to.x) = S(0);
      to = (S(1) / norm(to)) * to;
      sum = sum + S(chain.joint_spacing) * to;
    }
    sum = sum + chord(chain.axis[i].distal, angle_between(from, to)) * bisector(from, to);
    from = to;
  }
  return sum + S(chain.end_effector_length()) * pointing;
}

/// Vector from port to tip less the joints' part, in the stem's frame before its spin: x and y must vanish, z is the
/// insertion.
template <class A, class S, class V>
Vector<S> left_over(const Chain<A>& chain, const Frame<V>& goal, const S& pan, const S& tilt, const V& spin) {
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
template <Real S, class A>
void aim(const Chain<A>& chain, const Frame<S>& goal, const S& spin, const S& scale, Pivot<S>& at) {
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
template <Real S, class A>
Pivot<S> pivot(const Chain<A>& chain, const Frame<S>& goal, const S& spin, const Start<S>& start) {
  const Vector<S>& p = goal.position;
  const Vector<S> ahead{S(0), S(0), S(1)};
  const S straight = reach_of(chain, ahead).z;
  // As if all joints bent about one point.
  const Vector<S> middle = p - (S(0.5) * (straight + chain.end_effector_length())) * (goal.rotation * ahead);
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
/// With two bending axes the chain is redundant, and the spin is as given. With one axis the spin follows, within a
/// quarter turn of the given one. The second bending angle is within a quarter turn. The handle is left straight: its
/// angle depends on the load.
template <Real S, class A>
Reached<S> inverse(const Chain<A>& chain, const Frame<S>& goal, const S& spin, const Start<S>& start = {}) {
  const Vector<S>& p = goal.position;
  const Rotation<S>& r = goal.rotation;
  Reached<S> found{};
  if (!all_finite(p.x, p.y, p.z, r.w, r.x, r.y, r.z, spin, start.pan, start.tilt)) {
    found.reach = Reach::not_finite;
    return found;
  }
  const detail::Pivot<S> pivot = detail::pivot(chain, goal, spin, start);
  found.reach = pivot.reach;
  found.residual = pivot.residual;
  if (found.reach != Reach::ok) return found;

  const Vector<S> axis = r * Vector<S>{S(0), S(0), S(1)};
  Posture<S>& at = found.posture;
  at = {detail::within_half_turn(pivot.pan), detail::within_half_turn(pivot.tilt), spin, pivot.insertion, {}, {}, {}};
  Vector<S> pointing = stem_rotation(pivot.pan, pivot.tilt, S(0)).inverse() * axis;
  if (chain.axes == 1) {
    const S off = sqrt(pointing.x * pointing.x + pointing.y * pointing.y);
    const bool yaws = chain.direction[0] == Direction::yaw;
    if (off > S(0)) {
      const S toward = yaws ? angle_of(pointing.y, pointing.x) : angle_of(-pointing.x, pointing.y);
      const S half_turns = round((spin - toward) * S(1 / pi));
      at.spin = toward + S(pi) * half_turns;
    }
    pointing = about_z(at.spin).inverse() * pointing;
    at.bend[0] = angle_of(detail::along(chain.direction[0], pointing), pointing.z);
  } else {
    pointing = about_z(spin).inverse() * pointing;
    const S first = detail::along(chain.direction[0], pointing);
    at.bend[0] = angle_of(first, pointing.z);
    at.bend[1] = angle_of(detail::along(chain.direction[1], pointing), sqrt(first * first + pointing.z * pointing.z));
  }
  const Frame<S> unrolled = bodies(chain, at).tip;
  const Rotation<S> rolled = unrolled.rotation.inverse() * r;
  at.roll = detail::within_half_turn(S(2) * angle_of(rolled.z, rolled.w));
  const Vector<S> off = unrolled.position - p;
  found.residual = norm(off);
  if (!is_finite(found.residual + at.roll)) found.reach = Reach::singular;
  return found;
}

}  // namespace tenodesis

#pragma once
// The joint mechanisms: how far bending draws the tendons, and which moments tendons and loads exert.
//
// Each mechanism measures its bending by a coordinate x in which tendon excursion is linear, and provides:
//   coordinate(angle), angle(x)   between the joint's output angle (rad) and x
//   excursion_slope()             tendon drawn per unit of x, m
//   moment_arm(x)                 of one tendon about the output angle, m
//   tangential_arm(x)             of a force at the tip, square to the end-effector, m
//   tip_path(angle, x)            length of the tip's path square to the end-effector, whose rate is that arm, m
//   radial_arm(x)                 of a force at the tip, outward along the end-effector, m
//   passive_stiffness()           moment of the joint's own spring per radian, N·m/rad
//   demand(x, load)               the tension difference that holds a load
//   tame(load, stiffness)         whether Newton's iteration from the unloaded position cannot pass the first root
//   folds()                       whether the demand exceeds any tension on the way to the limit
//   wrap_angle(angle)             total bend of a tendon over the joint, rad
//   tendon_span()                 length of tendon within the straight joint, m
//   rig_arm()                     from the pivot of a load rig to the tip of the straight joint, m
//   limit()                       bound of |x|
//   mechanism                     its name
//   chord(angle)                  between the ends of the bent joint, m; it makes half the angle with either end
//   values()                      the same joint in real numbers
// All arms follow from virtual work on the joint's exact kinematics.
//
// A chain of joints (tendon_chain.hpp) has the mechanism of each as a value, and asks the functions at the end.

#include "tenodesis/rotation.hpp"

namespace tenodesis {

enum class Mechanism : unsigned char { gear, pulley, continuum };

/// Forces at the tip that rotate with it, N. A positive force opposes positive flexion; a radial force pulls outward.
template <class S>
struct Load {
  S force{};
  S radial_force{};
};

/// Tension difference that a load requires and its slope by the coordinate, both times a positive weight.
///
/// Each mechanism chooses the weight such that a Newton step needs a single division.
template <class S>
struct Demand {
  S value{};
  S slope{};
  S weight{};
};

/// Rolling gear pair (eqs. 1, 2, 4, 5); x = sin(angle / 2). The far gear rotates twice as far as the line of centres.
template <class S>
struct TendonGear {
  S radius{};  ///< pitch radius, m
  S length{};  ///< from the moving gear's centre to where the force acts, m

  static constexpr Mechanism mechanism = Mechanism::gear;
  static constexpr S limit() { return S(1); }
  static constexpr S coordinate(const S& angle) { return sin_quarter(angle * S(0.5)); }
  static S angle(const S& x) { return S(2) * asin(x); }
  static constexpr S wrap_angle(const S& angle) { return abs(angle); }

  constexpr S tendon_span() const { return S(2) * radius; }
  constexpr S rig_arm() const { return length + S(2) * radius; }
  constexpr S excursion_slope() const { return S(2) * radius; }
  S moment_arm(const S& x) const { return radius * cosine(x); }
  S tangential_arm(const S& x) const { return length + radius * cosine(x); }
  constexpr S tip_path(const S& angle, const S& x) const { return length * angle + S(2) * radius * x; }
  constexpr S radial_arm(const S& x) const { return radius * x; }
  static constexpr S passive_stiffness() { return S(0); }
  template <class T>
  constexpr T chord(const T&) const {
    return T(S(2) * radius);
  }

  // (F (l + r c) - F_r r x) / (r c) with c = cos(angle / 2), times c^3.
  Demand<S> demand(const S& x, const Load<S>& load) const {
    const S c = cosine(x);
    const S square = c * c;
    const S moment = load.force * (length / radius);
    return {load.force * square * c + (moment - load.radial_force * x) * square, moment * x - load.radial_force,
            square * c};
  }
  static constexpr bool folds() { return true; }
  // Demand is convex in the direction of the force: its second derivative in x, 3 x F_r against (1 + 2 x^2) F l / r,
  // cannot change sign below |F_r| = 0.94 F l / r.
  constexpr bool tame(const Load<S>& load, const S&) const {
    return abs(load.radial_force) * radius <= S(0.94) * abs(load.force) * length;
  }
  constexpr auto values() const { return TendonGear<ValueOf<S>>{value_of(radius), value_of(length)}; }

 private:
  static S cosine(const S& x) { return sqrt((S(1) - x) * (S(1) + x)); }
};

/// Pulley on a fixed axis; x = angle.
template <class S>
struct TendonPulley {
  S radius{};  ///< pulley radius, m
  S length{};  ///< from the axis to where the force acts, m

  static constexpr Mechanism mechanism = Mechanism::pulley;
  static constexpr S limit() { return S(pi); }
  static constexpr S coordinate(const S& angle) { return angle; }
  static constexpr S angle(const S& x) { return x; }
  static constexpr S wrap_angle(const S& angle) { return abs(angle); }

  constexpr S tendon_span() const { return S(2) * radius; }
  constexpr S rig_arm() const { return length; }
  constexpr S excursion_slope() const { return radius; }
  constexpr S moment_arm(const S&) const { return radius; }
  constexpr S tangential_arm(const S&) const { return length; }
  constexpr S tip_path(const S& angle, const S&) const { return length * angle; }
  static constexpr S radial_arm(const S&) { return S(0); }
  static constexpr S passive_stiffness() { return S(0); }
  template <class T>
  static constexpr T chord(const T&) {
    return T(0);
  }

  constexpr Demand<S> demand(const S&, const Load<S>& load) const {
    return {load.force * (length / radius), S(0), S(1)};
  }
  static constexpr bool folds() { return false; }
  static constexpr bool tame(const Load<S>&, const S&) { return true; }
  constexpr auto values() const { return TendonPulley<ValueOf<S>>{value_of(radius), value_of(length)}; }
};

/// Elastic backbone bent to a circular arc by tendons at an offset; x = angle.
template <class S>
struct TendonContinuum {
  S radius{};             ///< tendon offset from the backbone, m
  S length{};             ///< rigid end-effector beyond the backbone, m
  S backbone_length{};    ///< m
  S backbone_rigidity{};  ///< flexural rigidity EI, N·m^2

  static constexpr Mechanism mechanism = Mechanism::continuum;
  static constexpr S limit() { return S(pi); }
  static constexpr S coordinate(const S& angle) { return angle; }
  static constexpr S angle(const S& x) { return x; }
  static constexpr S wrap_angle(const S& angle) { return abs(angle); }

  constexpr S tendon_span() const { return backbone_length; }
  constexpr S rig_arm() const { return length + backbone_length * S(0.5); }
  constexpr S excursion_slope() const { return radius; }
  constexpr S moment_arm(const S&) const { return radius; }
  constexpr S tangential_arm(const S& x) const { return tangential(x, length, backbone_length); }
  constexpr S tip_path(const S& angle, const S&) const {
    return angle * (length + backbone_length * rise_of_square(angle * angle));
  }
  constexpr S radial_arm(const S& x) const { return radial(x, backbone_length); }
  constexpr S passive_stiffness() const { return backbone_rigidity / backbone_length; }
  template <class T>
  constexpr T chord(const T& angle) const {
    return T(backbone_length) * sinc_of_square(angle * angle * T(0.25));
  }

  constexpr Demand<S> demand(const S& x, const Load<S>& load) const {
    using D = Dual<S, 1>;
    const D at = D::variable(x, 0);
    const D moment = D(passive_stiffness()) * at + D(load.force) * tangential(at, D(length), D(backbone_length)) -
                     D(load.radial_force) * radial(at, D(backbone_length));
    return {moment.value / radius, moment.slope[0] / radius, S(1)};
  }
  static constexpr bool folds() { return false; }
  // The balance is monotone, so that it has one root, while one tendon (stiffness in N/m; none: 0) and the spring
  // outweigh the change of the arms: by the angle, at most 0.1351 L for the force and 1/6 L for the radial force.
  constexpr bool tame(const Load<S>& load, const S& stiffness) const {
    const S change = S(0.1351) * abs(load.force) + S(1.0 / 6) * abs(load.radial_force);
    return change * backbone_length < passive_stiffness() + stiffness * radius * radius;
  }
  constexpr auto values() const {
    return TendonContinuum<ValueOf<S>>{value_of(radius), value_of(length), value_of(backbone_length),
                                       value_of(backbone_rigidity)};
  }

 private:
  // l + L (1 - cos x) / x^2
  template <class T>
  static constexpr T tangential(const T& x, const T& end, const T& backbone) {
    const T sinc = sinc_of_square(x * x * T(0.25));
    return end + backbone * T(0.5) * sinc * sinc;
  }
  // L (x - sin x) / x^2
  template <class T>
  static constexpr T radial(const T& x, const T& backbone) {
    return backbone * x * bow_of_square(x * x);
  }
};

/// Largest |coordinate| of a mechanism.
template <class S>
constexpr S coordinate_limit(Mechanism mechanism) {
  return mechanism == Mechanism::gear ? TendonGear<S>::limit() : TendonPulley<S>::limit();
}

/// Angle of a joint at a coordinate, rad.
template <class S>
S angle_at(Mechanism mechanism, const S& x) {
  return mechanism == Mechanism::gear ? TendonGear<S>::angle(x) : x;
}

/// Coordinate of a joint at an angle (rad).
template <class S>
constexpr S coordinate_at(Mechanism mechanism, const S& angle) {
  return mechanism == Mechanism::gear ? TendonGear<S>::coordinate(angle) : angle;
}

/// Rate of a joint's coordinate by its angle, at a coordinate.
template <class S>
constexpr S turn_at(Mechanism mechanism, const S& x) {
  return mechanism == Mechanism::gear ? sqrt((S(1) - x) * (S(1) + x)) * S(0.5) : S(1);
}

/// Tendon drawn by a unit of the coordinate at a distance from the joint's middle plane (m), m.
template <class S>
constexpr S excursion_slope(Mechanism mechanism, const S& distance) {
  return mechanism == Mechanism::gear ? TendonGear<S>{distance}.excursion_slope()
                                      : TendonPulley<S>{distance}.excursion_slope();
}

/// Bend of a tendon over a straight joint that the joint's angle unwinds before it bends the tendon the other way, rad,
/// positive in the sense of a positive angle; lengthens: by a positive angle, the tendon's way over the joint, m.
///
/// A tendon of a constant arm r about a pulley's axis lies on it along r times its wrap, and the wrap changes by what
/// lengthens its way. At a gear's edges, along a backbone and in the middle of a joint bends add up either way.
template <class S>
constexpr S wound_bend(Mechanism mechanism, const S& bend, const S& lengthens) {
  if (mechanism != Mechanism::pulley || lengthens == S(0)) return S(0);
  return lengthens > S(0) ? bend : -bend;
}

/// Chord of a straight joint of a radius or, of a backbone, of a length, m.
template <class S>
constexpr S straight_chord(Mechanism mechanism, const S& radius, const S& backbone_length) {
  if (mechanism == Mechanism::continuum) return TendonContinuum<S>{radius, S(0), backbone_length}.chord(S(0));
  return mechanism == Mechanism::gear ? TendonGear<S>{radius}.chord(S(0)) : TendonPulley<S>::chord(S(0));
}

/// Whether a load may exceed what any tension holds on the way to the limit.
constexpr bool folds(Mechanism mechanism) {
  return mechanism == Mechanism::gear ? TendonGear<double>::folds() : TendonPulley<double>::folds();
}

/// A joint bent to a coordinate.
template <class S>
struct Bend {
  S sine{};         ///< of half the angle
  S cosine{};       ///< likewise
  S turn{};         ///< rate of the coordinate by the angle
  S per_turn{};     ///< its inverse
  S chord{};        ///< m
  S chord_rate{};   ///< by the angle, m
  S chord_curve{};  ///< second rate, m

  constexpr Bend() = default;
  /// straight: the chord of the straight joint, m.
  template <class C>
  constexpr Bend(Mechanism mechanism, const C& straight, const S& x) {
    const bool rolls = mechanism == Mechanism::gear;
    sine = rolls ? x : sin_quarter(x * S(0.5));
    cosine = sqrt((S(1) - sine) * (S(1) + sine));
    turn = rolls ? cosine * S(0.5) : S(1);
    per_turn = rolls ? S(1) / turn : S(1);
    chord = S(straight);
    if (mechanism != Mechanism::continuum) return;
    // L sin(h)/h of the half angle h; its rates by h follow from g = (cos h - sin(h)/h)/h^2 = bow - (1 - cos h)/h^2.
    const S half = x * S(0.5);
    const S square = half * half;
    const S quarter = sinc_of_square(square * S(0.25));
    const S sinc = sinc_of_square(square);
    const S g = bow_of_square(square) - S(0.5) * quarter * quarter;
    chord_rate = chord * S(0.5) * half * g;
    chord_curve = chord * S(-0.25) * (sinc + S(2) * g);
    chord = chord * sinc;
  }
  /// Of anything that has a mechanism and a chord.
  template <class J>
  constexpr Bend(const J& joint, const S& x) : Bend(joint.mechanism, joint.chord, x) {}

  /// A vector of the far side in the axes of the middle, or of the middle in those of the near side.
  template <class Axis>
  constexpr Vector<S> inward(const Axis& axis, const Vector<S>& v) const {
    return rotated(axis, v, sine);
  }
  /// The inverse.
  template <class Axis>
  constexpr Vector<S> outward(const Axis& axis, const Vector<S>& v) const {
    return rotated(axis, v, -sine);
  }

 private:
  template <Along along>
  constexpr Vector<S> rotated(const Direction<S, along>& axis, const Vector<S>& v, const S& by) const {
    return turned(axis, v, by, cosine);
  }
  template <class C>
  constexpr Vector<S> rotated(const Vector<C>& axis, const Vector<S>& v, const S& by) const {
    // About an axis of the link itself two components turn.
    if (axis.x == C(0) && axis.z == C(0)) return turned(Direction<S, Along::y>{S(axis.y)}, v, by, cosine);
    if (axis.y == C(0) && axis.z == C(0)) return turned(Direction<S, Along::x>{S(axis.x)}, v, by, cosine);
    return turned(Vector<S>{S(axis.x), S(axis.y), S(axis.z)}, v, by, cosine);
  }
};

/// Rate of a bent joint's per_turn by the coordinate; a gear's per_turn is 2/sqrt(1 - x^2).
template <class S>
constexpr S per_turn_rate(Mechanism mechanism, const Bend<S>& bend) {
  if (mechanism != Mechanism::gear) return S(0);
  return bend.sine * S(0.25) * bend.per_turn * bend.per_turn * bend.per_turn;
}

}  // namespace tenodesis

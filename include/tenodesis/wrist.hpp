#pragma once
// A wrist: joints one after another, or side by side as jaws are, held by tendons that may cross several of them.
//
// Every joint turns by half its angle, moves along its chord, and turns by the other half, as in kinematics.hpp. Its
// coordinate x is the one of joint.hpp, in which the excursion of every tendon is linear: what a tendon is drawn by is
// the sum of arm times x over the joints that it crosses. A gear's coordinate is the sine of half its angle, and a
// tendon at a distance a from its middle plane has the arm 2 a there; elsewhere x is the angle and the arm the
// distance.

#include <cstdint>

#include "tenodesis/joint.hpp"
#include "tenodesis/rotation.hpp"

namespace tenodesis {

enum class Mechanism : unsigned char { gear, pulley, continuum };

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

/// A joint of a wrist, in the frame of the link before it: z along the straight joint toward the tip.
template <class S>
struct WristJoint {
  Mechanism mechanism{};
  int parent{-1};    ///< the joint that it stands on; -1: the stem
  Vector<S> axis{};  ///< unit vector; a positive angle turns about it
  S offset{};        ///< from the far end of the joint that it stands on, m
  S chord{};         ///< of the straight joint: between a gear pair's centres, or a backbone's length, m
  S length{};        ///< from its far end to where its wrench acts, m
  S stiffness{};     ///< of its own spring, N m/rad
  S share{};         ///< of the wrench that acts at its end
  S grip{};          ///< moment about its axis by a unit of grip force, m
};

/// Force and moment on the tip: N and N m, in the tip's axes, or in the stem's.
template <class S>
struct Wrench {
  Vector<S> force{};
  Vector<S> moment{};
};

template <class S>
struct WristLoad {
  Wrench<S> wrench{};
  S grip{};             ///< force that presses the jaws apart, as an object between them does, N
  bool in_stem_axes{};  ///< whether the wrench keeps its direction while the tip turns
};

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
  template <class C>
  constexpr Bend(const WristJoint<C>& joint, const S& x) {
    const bool rolls = joint.mechanism == Mechanism::gear;
    sine = rolls ? x : sin_quarter(x * S(0.5));
    cosine = sqrt((S(1) - sine) * (S(1) + sine));
    turn = rolls ? cosine * S(0.5) : S(1);
    per_turn = rolls ? S(1) / turn : S(1);
    chord = S(joint.chord);
    if (joint.mechanism != Mechanism::continuum) return;
    // L sin(h)/h of the half angle h; its rates by h follow from g = (cos h - sin(h)/h)/h^2 = bow - (1 - cos h)/h^2.
    const S half = x * S(0.5);
    const S square = half * half;
    const S quarter = sinc_of_square(square * S(0.25));
    const S sinc = sinc_of_square(square);
    const S g = bow_of_square(square) - S(0.5) * quarter * quarter;
    chord = S(joint.chord) * sinc;
    chord_rate = S(joint.chord) * S(0.5) * half * g;
    chord_curve = S(joint.chord) * S(-0.25) * (sinc + S(2) * g);
  }

  /// A vector of the far side in the axes of the middle, or of the middle in those of the near side.
  template <class C>
  constexpr Vector<S> inward(const Vector<C>& axis, const Vector<S>& v) const {
    return rotated(axis, v, sine);
  }
  /// The inverse.
  template <class C>
  constexpr Vector<S> outward(const Vector<C>& axis, const Vector<S>& v) const {
    return rotated(axis, v, -sine);
  }

 private:
  template <class C>
  constexpr Vector<S> rotated(const Vector<C>& axis, const Vector<S>& v, const S& by) const {
    // About an axis of the link itself two components turn.
    if (axis.x == C(0) && axis.z == C(0)) {
      const S s = S(axis.y) * by;
      return {cosine * v.x + s * v.z, v.y, cosine * v.z - s * v.x};
    }
    if (axis.y == C(0) && axis.z == C(0)) {
      const S s = S(axis.x) * by;
      return {v.x, cosine * v.y - s * v.z, cosine * v.z + s * v.y};
    }
    const Vector<S> about{S(axis.x), S(axis.y), S(axis.z)};
    return cosine * v + by * cross(about, v) + ((S(1) - cosine) * dot(about, v)) * about;
  }
};

/// The constants of a wrist of N joints and at most M tendons; a tendon that is not there has no stiffness.
template <class Scalar, int N, int M>
struct Wrist {
  using S = Scalar;
  static constexpr int joints = N;
  static constexpr int tendons = M;

  WristJoint<S> joint[N]{};  ///< each after the one that it stands on
  S arm[M][N]{};             ///< tendon drawn by a unit of each coordinate, m
  S stiffness[M]{};          ///< N/m
  S pretension[M]{};         ///< at rest, N
  bool motor[M]{};           ///< whether a spool winds the tendon
  int handles{};             ///< joints of the handle, at most N
  Mechanism handle[N]{};
  S handle_arm[M][N]{};  ///< tendon wound by a unit of each of the handle's coordinates, m

  /// Length by which handle angles (rad) and strokes of the motors (m) wind each tendon, m.
  template <class T>
  void wind(const T* handle_angle, const T* stroke, T* wound) const {
    for (int m = 0; m < M; ++m) wound[m] = stroke[m];
    for (int h = 0; h < handles; ++h) {
      const T y = coordinate_at(handle[h], handle_angle[h]);
      for (int m = 0; m < M; ++m) wound[m] = wound[m] + T(handle_arm[m][h]) * y;
    }
  }

  /// Length by which the tip draws each tendon at coordinates x, m.
  template <class T>
  void excursions(const T* x, T* drawn) const {
    for (int m = 0; m < M; ++m) {
      drawn[m] = T(arm[m][0]) * x[0];
      for (int i = 1; i < N; ++i) drawn[m] = drawn[m] + T(arm[m][i]) * x[i];
    }
  }

  /// Tension of a tendon that the handle and its motor have drawn by wound, and the tip by drawn, m; negative where it
  /// would have to push.
  template <class T>
  T stretched(int m, const T& wound, const T& drawn) const {
    return T(pretension[m]) + T(stiffness[m]) * (wound - drawn);
  }

  /// Moments of a load about every joint in the direction of its angle, by virtual work, N m, and their rates by the
  /// angles, N m/rad.
  template <class T>
  [[gnu::always_inline]] constexpr void load_moments(const Bend<T>* bend, const WristLoad<T>& load, T* moment,
                                                     T (*rate)[N]) const {
    // At the far end of every joint, in its axes: the wrench, and its rates by the angles of the joints beyond.
    Wrench<T> at[N]{};
    Wrench<T> by[N][N]{};
    std::uint32_t beyond[N]{};
    if (load.in_stem_axes) turn_with_stem(bend, load.wrench, at, by, beyond);
    for (int i = 0; i < N; ++i) {
      const T share(joint[i].share);
      const Wrench<T>& own = load.in_stem_axes ? at[i] : load.wrench;
      at[i] = shared(own, share, T(joint[i].length));
      if (!load.in_stem_axes) continue;
      for (int j = 0; j <= i; ++j) by[i][j] = shared(by[i][j], share, T(joint[i].length));
    }
    for (int i = N - 1; i >= 0; --i) {
      const auto& on = joint[i];
      const Vector<T> axis{T(on.axis.x), T(on.axis.y), T(on.axis.z)};
      const Bend<T>& bent = bend[i];
      const auto pass = [&](const Wrench<T>& far, T& about) {
        Wrench<T> mid{bent.inward(on.axis, far.force), bent.inward(on.axis, far.moment)};
        mid.moment = mid.moment + bent.chord * along(mid.force);
        about = T(0.5) * (dot(axis, far.moment) + dot(axis, mid.moment)) + bent.chord_rate * mid.force.z;
        return mid;
      };
      const auto near = [&](const Wrench<T>& mid) {
        return Wrench<T>{bent.inward(on.axis, mid.force), bent.inward(on.axis, mid.moment)};
      };
      const int parent = on.parent;
      const auto hand_on = [&](Wrench<T>& to, const Wrench<T>& from) {
        to.force = to.force + from.force;
        to.moment = to.moment + from.moment + T(on.offset) * along(from.force);
      };
      const Wrench<T> mid = pass(at[i], moment[i]);
      moment[i] = moment[i] + T(on.grip) * load.grip;
      const Wrench<T> whole = near(mid);
      // By its own angle: both halves turn, and the chord changes.
      Wrench<T> own{};
      rate[i][i] = T(0);
      if (load.in_stem_axes) own = pass(by[i][i], rate[i][i]);
      const Vector<T> force_rate = T(0.5) * cross(axis, mid.force);
      own.force = own.force + force_rate;
      const Vector<T> moment_rate = T(0.5) * cross(axis, mid.moment - bent.chord * along(mid.force)) +
                                    bent.chord_rate * along(mid.force) + bent.chord * along(force_rate);
      own.moment = own.moment + moment_rate;
      rate[i][i] = rate[i][i] + T(0.5) * dot(axis, moment_rate) + bent.chord_curve * mid.force.z +
                   bent.chord_rate * force_rate.z;
      own = near(own);
      own.force = own.force + T(0.5) * cross(axis, whole.force);
      own.moment = own.moment + T(0.5) * cross(axis, whole.moment);
      if (parent >= 0) {
        hand_on(at[parent], whole);
        hand_on(by[parent][i], own);
        beyond[parent] |= beyond[i] | std::uint32_t(1) << i;
      }
      for (int j = 0; j < N; ++j) {
        if (j == i) continue;
        rate[i][j] = T(0);
        if ((beyond[i] >> j & 1u) == 0) continue;
        const Wrench<T> turned = near(pass(by[i][j], rate[i][j]));
        if (parent >= 0) hand_on(by[parent][j], turned);
      }
    }
  }

 private:
  // A wrench in the stem's axes, in those of every joint's far end; its rates by the angles that turn these.
  template <class T>
  constexpr void turn_with_stem(const Bend<T>* bend, const Wrench<T>& wrench, Wrench<T>* at, Wrench<T> (*by)[N],
                                std::uint32_t* before) const {
    for (int i = 0; i < N; ++i) {
      const int on = joint[i].parent;
      const auto outward = [&](const Wrench<T>& w) {
        const auto turned = [&](const Vector<T>& v) {
          return bend[i].outward(joint[i].axis, bend[i].outward(joint[i].axis, v));
        };
        return Wrench<T>{turned(w.force), turned(w.moment)};
      };
      at[i] = outward(on < 0 ? wrench : at[on]);
      for (int j = 0; j < i && on >= 0; ++j) by[i][j] = outward(by[on][j]);
      const Vector<T> axis{T(joint[i].axis.x), T(joint[i].axis.y), T(joint[i].axis.z)};
      by[i][i] = {T(-1) * cross(axis, at[i].force), T(-1) * cross(axis, at[i].moment)};
      for (int j = on; j >= 0; j = joint[j].parent) before[i] |= std::uint32_t(1) << j;
    }
  }

  // The share of a wrench that acts at a joint's end, at its far end.
  template <class T>
  static constexpr Wrench<T> shared(const Wrench<T>& wrench, const T& share, const T& length) {
    const Vector<T> force = share * wrench.force;
    return {force, share * wrench.moment + length * along(force)};
  }

  // z cross v: the moment of a force at a unit of length beyond.
  template <class T>
  static constexpr Vector<T> along(const Vector<T>& v) {
    return {-v.y, v.x, T(0)};
  }
};

}  // namespace tenodesis

#pragma once
// A wrist: joints one after another, or side by side as jaws are, held by tendons that may cross several of them.
//
// Every joint turns by half its angle, moves along its chord, and turns by the other half, as in kinematics.hpp. Its
// coordinate x is the one of joint.hpp, in which the excursion of every tendon is linear: what a tendon is drawn by is
// the sum of arm times x over the joints that it crosses. A gear's coordinate is the sine of half its angle, and a
// tendon at a distance a from its middle plane has the arm 2 a there; elsewhere x is the angle and the arm the distance.

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
  S grip{};                ///< force that presses the jaws apart, as an object between them does, N
  bool in_stem_axes{};     ///< whether the wrench keeps its direction while the tip turns
};

/// A joint bent to a coordinate.
template <class S>
struct Bend {
  S sine{};        ///< of half the angle
  S cosine{};      ///< likewise
  S turn{};        ///< rate of the coordinate by the angle
  S chord{};       ///< m
  S chord_rate{};  ///< by the angle, m

  Bend() = default;
  Bend(const WristJoint<ValueOf<S>>& joint, const S& x) {
    const bool rolls = joint.mechanism == Mechanism::gear;
    sine = rolls ? x : sin_quarter(x * S(0.5));
    cosine = sqrt((S(1) - sine) * (S(1) + sine));
    turn = rolls ? cosine * S(0.5) : S(1);
    chord = S(joint.chord);
    chord_rate = S(0);
    if (joint.mechanism == Mechanism::continuum) {
      // L sin(h)/h of the half angle h, whose rate by h is L (cos h - sin(h)/h)/h.
      const S sinc = sinc_of_square(x * x * S(0.25));
      chord = S(joint.chord) * sinc;
      // (cos h - sin(h)/h)/h = -(1 - cos h)/h + h bow(h), without cancellation.
      const S half = x * S(0.5);
      const S quarter = sinc_of_square(half * half * S(0.25));
      chord_rate = S(joint.chord) * S(0.5) * half * (bow_of_square(half * half) - S(0.5) * quarter * quarter);
    }
  }

  /// A vector of the far side in the axes of the middle, or of the middle in those of the near side.
  Vector<S> inward(const Vector<ValueOf<S>>& axis, const Vector<S>& v) const { return rotated(axis, v, sine); }
  /// The inverse.
  Vector<S> outward(const Vector<ValueOf<S>>& axis, const Vector<S>& v) const { return rotated(axis, v, -sine); }

 private:
  Vector<S> rotated(const Vector<ValueOf<S>>& axis, const Vector<S>& v, const S& by) const {
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

  /// Moment of a load about every joint in the direction of its angle, by virtual work, N m.
  template <class T>
  void load_moments(const Bend<T>* bend, const WristLoad<T>& load, T* moment) const {
    Vector<T> force[N]{};
    Vector<T> torque[N]{};
    Wrench<T> fixed[N]{};
    if (load.in_stem_axes) {
      for (int i = 0; i < N; ++i) {
        const int on = joint[i].parent;
        const Wrench<T>& before = on < 0 ? load.wrench : fixed[on];
        const auto turned = [&](const Vector<T>& v) {
          return bend[i].outward(joint[i].axis, bend[i].outward(joint[i].axis, v));
        };
        fixed[i] = {turned(before.force), turned(before.moment)};
      }
    }
    for (int i = N - 1; i >= 0; --i) {
      const Vector<T> axis{T(joint[i].axis.x), T(joint[i].axis.y), T(joint[i].axis.z)};
      const Wrench<T>& own = load.in_stem_axes ? fixed[i] : load.wrench;
      const T share(joint[i].share);
      const Vector<T> at_end = share * own.force;
      Vector<T> f = force[i] + at_end;
      Vector<T> m = torque[i] + share * own.moment + T(joint[i].length) * along(at_end);
      const T far = dot(axis, m);
      f = bend[i].inward(joint[i].axis, f);
      m = bend[i].inward(joint[i].axis, m) + bend[i].chord * along(f);
      moment[i] = T(0.5) * (far + dot(axis, m)) + bend[i].chord_rate * f.z + T(joint[i].grip) * load.grip;
      const int on = joint[i].parent;
      if (on < 0) continue;
      f = bend[i].inward(joint[i].axis, f);
      force[on] = force[on] + f;
      torque[on] = torque[on] + bend[i].inward(joint[i].axis, m) + T(joint[i].offset) * along(f);
    }
  }

 private:
  // z cross v: the moment of a force at a unit of length beyond.
  template <class T>
  static constexpr Vector<T> along(const Vector<T>& v) {
    return {-v.y, v.x, T(0)};
  }
};

}  // namespace tenodesis

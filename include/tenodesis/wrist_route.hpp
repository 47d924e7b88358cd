#pragma once
// Routes of a wrist's tendons: their contacts and what joints draw, and rows for chains whose length is known at run
// time and whose values may be linear in unknown coordinates.

#include "tenodesis/tendon.hpp"

namespace tenodesis {

/// Up to Most values.
template <class T, int Most>
struct BoundedRow {
  T at[Most]{};
  int length{Most};

  constexpr int size() const { return length; }
  constexpr T& operator[](int i) { return at[i]; }
  constexpr const T& operator[](int i) const { return at[i]; }
};

/// A number that depends linearly on U others.
template <class S, int U>
struct Linear {
  S value;
  S by[U];

  /// Not initialised: a step makes many that it never reads.
  Linear() = default;
  constexpr explicit Linear(const S& constant) : value(constant) {
    for (S& slope : by) slope = S(0);
  }

  /// With other operations on value and slopes.
  friend constexpr Linear operator+(const Linear& a, const Linear& b) {
    Linear sum;
    sum.value = a.value + b.value;
    for (int u = 0; u < U; ++u) sum.by[u] = a.by[u] + b.by[u];
    return sum;
  }
  friend constexpr Linear operator-(const Linear& a, const Linear& b) {
    Linear difference;
    difference.value = a.value - b.value;
    for (int u = 0; u < U; ++u) difference.by[u] = a.by[u] - b.by[u];
    return difference;
  }
  friend constexpr Linear operator+(Linear a, const S& b) {
    a.value = a.value + b;
    return a;
  }
  friend constexpr Linear operator+(const S& a, Linear b) { return b + a; }
  friend constexpr Linear operator*(const S& by, Linear a) {
    a.value = by * a.value;
    for (int u = 0; u < U; ++u) a.by[u] = by * a.by[u];
    return a;
  }
  friend constexpr Linear operator*(const Linear& a, const S& by) { return by * a; }

  S at(const S* x) const {
    S sum = value;
    for (int u = 0; u < U; ++u) sum = sum + by[u] * x[u];
    return sum;
  }
};

/// Values that are not initialised.
template <class T, int N>
struct Unset {
  T at[N];

  Unset() {}  // NOLINT(modernize-use-equals-default): with that, {} would set them
  T& operator[](int i) { return at[i]; }
  const T& operator[](int i) const { return at[i]; }
};

/// Rows of a tendon with at most so many contacts.
template <int most>
struct BoundedContacts {
  template <class T>
  struct Of {
    using PerContact = Row<T, most>;
    using PerSegment = BoundedRow<T, most + 1>;
  };
  template <class S, int U>
  struct Of<Linear<S, U>> {
    using PerContact = Unset<Linear<S, U>, most>;
    using PerSegment = Unset<Linear<S, U>, most + 1>;
  };
  template <class T>
  using PerContact = Of<T>::PerContact;
  template <class T>
  using PerSegment = Of<T>::PerSegment;
};

/// One contact of a tendon's route: in the sheath, or on a joint.
template <class S>
struct Passage {
  int joint{-1};    ///< of the tip, or of the handle counted from N on; -1: the sheath
  S coefficient{};  ///< of friction
  S wrap{};         ///< in the sheath, or on the straight joint, rad
  S share{1};       ///< of the joint's angle, and of the constant and viscous friction of joint or sheath
  S arm{};          ///< by which a unit of the joint's coordinate lengthens the segment that it draws, m
};

/// A segment of a tendon that a joint draws; of two vertices, that between them.
template <class S>
struct Draw {
  int segment{};
  int joint{};
  S arm{};
};

}  // namespace tenodesis

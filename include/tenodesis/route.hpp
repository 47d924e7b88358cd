#pragma once
// Routes of a chain's tendons: their contacts and what joints draw, and rows for tendons whose contacts are counted
// at run time and whose values may be linear in unknown coordinates.

#include "tenodesis/tendon.hpp"

namespace tenodesis {

/// Up to Most values.
template <class T, int Most>
struct BoundedRow {
  T at[Most];
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
  friend constexpr Linear operator+(const S& a, const Linear& b) { return b + a; }
  friend constexpr Linear operator*(const S& by, Linear a) {
    a.value = by * a.value;
    for (int u = 0; u < U; ++u) a.by[u] = by * a.by[u];
    return a;
  }
  friend constexpr Linear operator*(const Linear& a, const S& by) { return by * a; }

  template <class Mask>
    requires(!std::is_same_v<Mask, bool>)
  friend constexpr Linear where(const Mask& mask, const Linear& a, const Linear& b) {
    Linear chosen;
    chosen.value = where(mask, a.value, b.value);
    for (int u = 0; u < U; ++u) chosen.by[u] = where(mask, a.by[u], b.by[u]);
    return chosen;
  }

  S at(const S* x) const {
    S sum = value;
    for (int u = 0; u < U; ++u) sum = sum + by[u] * x[u];
    return sum;
  }
};

/// Rows of a tendon with at most so many contacts; fixed: those of a segment have no length of their own.
template <int most, bool fixed = false>
struct BoundedContacts {
  template <class T>
  using PerContact = Row<T, most>;
  template <class T>
  using PerSegment = std::conditional_t<fixed, Row<T, most + 1>, BoundedRow<T, most + 1>>;
};

/// One contact of a tendon's route: in the sheath, or on a joint.
template <class S>
struct Passage {
  int joint{-1};    ///< of the tip, or of the handle counted from N on; -1: the sheath
  S coefficient{};  ///< of friction
  S wrap{};         ///< in the sheath, or at a joint whatever its angle, rad
  S share{1};       ///< of the joint's angle, and of the constant and viscous friction of joint or sheath
  S arm{};          ///< by which a unit of the joint's coordinate lengthens the segment that it draws, m
  S wound{};        ///< bend over the straight joint that its angle unwinds (wound_bend), rad
};

/// Wrap of a tendon at a joint's contact, rad; turned: the joint's angle. By a joint that turns, the tendon's direction
/// behind it is turned against that before it: beyond what a pulley unwinds, a guide opposite bends the tendon.
template <class S>
constexpr S wrap_at(const Passage<S>& at, const S& turned) {
  return at.wrap + abs(at.wound + turned * at.share);
}

/// Band of a contact, without its drag, by a law of friction.hpp; speed: at which it slips (m/s), held: the tension
/// that the band is linear about, N.
template <class Law, class S>
Band<S> band_of(const Law& law, const S& exponent, const S& wrap, const Passage<S>& at, const S& speed, const S& held) {
  if constexpr (Law::depends_on_tension) {
    Band<S> band = law.band(exponent, held);
    if (at.joint >= 0) band = law.bend(wrap, held, band);
    band.constant = band.constant - law.constant * (S(1) - at.share);
    return band;
  } else {
    Band<S> band = law.band(exponent, speed);
    band.constant = band.constant * at.share;
    return band;
  }
}

/// One of the laws, chosen when a twin is made.
template <class S>
struct ChosenLaw {
  static constexpr bool depends_on_speed = true;
  static constexpr bool depends_on_tension = false;
  enum class Kind : unsigned char { capstan_with_constant, stribeck, capstan_power };

  Kind kind{};
  CapstanWithConstant<S> capstan{};
  Stribeck<S> stribeck{};
  PowerCapstan<S> power{};

  S speed_after(const S& before, const S& slipped, const S& time_step) const {
    return kind == Kind::stribeck ? stribeck.speed_after(before, slipped, time_step) : S(0);
  }
};

template <class S>
Band<S> band_of(const ChosenLaw<S>& law, const S& exponent, const S& wrap, const Passage<S>& at, const S& speed,
                const S& held) {
  using Kind = ChosenLaw<S>::Kind;
  if (law.kind == Kind::stribeck) return band_of(law.stribeck, exponent, wrap, at, speed, held);
  if (law.kind == Kind::capstan_power) return band_of(law.power, exponent, wrap, at, speed, held);
  return band_of(law.capstan, exponent, wrap, at, speed, held);
}

/// A segment of a tendon that a joint draws; of two vertices, that between them.
template <class S>
struct Draw {
  int segment{};
  int joint{};
  S arm{};
};

}  // namespace tenodesis

#pragma once
// Friction laws of one contact between a tendon and what it bends around.
//
// A law turns a contact's exponent (friction coefficient times wrap angle) and slip speed into the band within which
// the tensions on its two sides may differ before the tendon slips. Laws are interchangeable: each answers
// band(exponent, speed), depends_on_speed, and if so speed_after(before, slipped, time_step). One that
// depends_on_tension answers band(exponent, held) and bend(wrap, held, band) instead, with the tension (N) that the
// band is linear about.

#include "tenodesis/scalar.hpp"

namespace tenodesis {

/// Largest tension on the pulled side: ratio times that on the held side, plus constant (N), plus drag (N/m) times the
/// length that slips in the step.
template <class S>
struct Band {
  S ratio;
  S constant;
  S drag;

  /// Whether the contact has no friction.
  constexpr Flag<S> free() const { return ratio == S(1) && constant == S(0); }
};

template <class S>
struct NoFriction {
  static constexpr bool depends_on_speed = false;
  static constexpr bool depends_on_tension = false;
  static constexpr Band<S> band(const S&, const S&) { return {S(1), S(0), S(0)}; }
};

/// Capstan friction: tensions differ by the factor exp(mu phi) before the tendon slips (Euler, Eytelwein).
template <class S>
struct Capstan {
  static constexpr bool depends_on_speed = false;
  static constexpr bool depends_on_tension = false;
  static Band<S> band(const S& exponent, const S&) { return {exp(exponent), S(0), S(0)}; }
};

/// Capstan friction with a part (N) that does not depend on the load: pre-load of a seal or a liner.
template <class S>
struct CapstanWithConstant {
  static constexpr bool depends_on_speed = false;
  static constexpr bool depends_on_tension = false;
  S constant{};

  Band<S> band(const S& exponent, const S&) const { return {exp(exponent), constant, S(0)}; }
};

/// Capstan friction whose coefficient falls from its static to its kinetic value with speed, and a constant part.
///
/// The exponent is the kinetic one; at rest it is static_ratio times as large, and the excess falls as
/// exp(-(speed / stribeck_speed)^2) (Armstrong-Helouvry, Dupont, Canudas de Wit 1994, the Gaussian form).
template <class S>
struct Stribeck {
  static constexpr bool depends_on_speed = true;
  static constexpr bool depends_on_tension = false;
  S constant{};        ///< N
  S static_ratio{1};   ///< static over kinetic friction coefficient
  S stribeck_speed{};  ///< m/s
  S memory{};          ///< time constant with which friction follows the speed, s

  Band<S> band(const S& exponent, const S& speed) const {
    // Beyond this ratio the excess vanishes by rounding, and exp would leave its range.
    const S ratio = smaller(abs(speed) / stribeck_speed, S(8));
    const S excess = (static_ratio - S(1)) * exp(-ratio * ratio);
    return {exp(exponent * (S(1) + excess)), constant, S(0)};
  }

  /// The speed that friction depends on, a step later.
  S speed_after(const S& before, const S& slipped, const S& time_step) const {
    return before + (abs(slipped) / time_step - before) * (time_step / (memory + time_step));
  }
};

/// Friction that grows with a power of the tension (Howell 1953), of a tendon that is stiff in bending.
///
/// Along a contact dT/ds = mu T_ref (T / T_ref)^index, which at index 1 is capstan friction. The tension on the pulled
/// side is a concave function of that on the held side; a band is its tangent, so that it is exact at the tension that
/// it is taken at, and off by the second order of the change from there.
template <class S>
struct PowerCapstan {
  static constexpr bool depends_on_speed = false;
  static constexpr bool depends_on_tension = true;
  S constant{};    ///< N
  S index{1};      ///< power of the tension
  S reference{1};  ///< tension at which the exponent is mu phi, N
  S bending{};     ///< B / (2 r^2) of bending stiffness B on a vertex of radius r, N
  S least{};       ///< tension below which the tangent stays as it is, N

  Band<S> band(const S& exponent, const S& tension) const {
    const S held = larger(tension, least);
    const S less = S(1) - index;
    const S grade = exponent * exp(-less * log(held / reference));
    const S share = less * grade;
    // log(1 + less grade) / less, the exponent that counts, by its series where less is small.
    const bool small = share < S(1e-4);
    const S over = small ? grade * (S(1) - share * (S(0.5) - share * S(1.0 / 3))) : log(S(1) + share) / less;
    const S slope = exp(index * over);
    return {slope, held * (exp(over) - slope) + constant, S(0)};
  }

  /// Adds the loss of bending a tendon over a vertex by an angle, if it gives none of its bending energy back: the
  /// strands of a rope slide. A tendon that springs back loses none (Jung, Pan, Kang 2008).
  ///
  /// The bending energy per length is B / (2 r^2) where the tendon lies on the vertex, and T (1 - cos(wrap / 2)) at the
  /// apex of an elastica, where it is bent too little for that.
  Band<S> bend(const S& wrap, const S& tension, Band<S> band) const {
    const S half = sin_quarter(wrap * S(0.25));
    const S elastica = S(2) * half * half;
    if (tension * elastica < bending)
      band.ratio = band.ratio + elastica;
    else
      band.constant = band.constant + bending;
    return band;
  }
};

}  // namespace tenodesis

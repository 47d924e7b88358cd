#pragma once
// Friction laws of one contact between a tendon and what it bends around.
//
// A law turns a contact's exponent (friction coefficient times wrap angle) and slip speed into the band within which
// the tensions on its two sides may differ before the tendon slips. Laws are interchangeable: each answers
// band(exponent, speed), depends_on_speed, and if so speed_after(before, slipped, time_step).

#include "tenodesis/scalar.hpp"

namespace tenodesis {

/// Largest tension on the pulled side: ratio times that on the held side, plus constant (N), plus drag (N/m) times the
/// length that slips in the step.
template <class S>
struct Band {
  S ratio{1};
  S constant{};
  S drag{};

  /// Whether the contact has no friction.
  constexpr bool free() const { return ratio == S(1) && constant == S(0); }
};

template <class S>
struct NoFriction {
  static constexpr bool depends_on_speed = false;
  static constexpr Band<S> band(const S&, const S&) { return {}; }
};

/// Capstan friction: tensions differ by the factor exp(mu phi) before the tendon slips (Euler, Eytelwein).
template <class S>
struct Capstan {
  static constexpr bool depends_on_speed = false;
  static Band<S> band(const S& exponent, const S&) { return {exp(exponent), S(0), S(0)}; }
};

/// Capstan friction with a part (N) that does not depend on the load: pre-load of a seal or a liner.
template <class S>
struct CapstanWithConstant {
  static constexpr bool depends_on_speed = false;
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

}  // namespace tenodesis

#pragma once
// Tendons whose stiffness grows with tension: tension by stretch, from a table of stiffness by tension.
//
// Between two entries the stiffness k = dT/ds is linear in the tension T, so that T is exponential in the stretch s;
// beyond the last entry k is constant, and a tendon that is slack has the first one's. Stretch is counted as the
// tension that the stiffness at rest would give, so that one curve holds for every segment of a tendon.

#include "tenodesis/scalar.hpp"

namespace tenodesis {

/// Most entries of a table.
inline constexpr int most_stretch_entries = 8;

namespace detail {

/// Argument below which a quotient of a difference is a series, and that its first neglected term is rounding.
inline constexpr double small_argument = 1e-3;

/// (exp(y) - 1) / y.
template <class S>
S exp_quotient(const S& y) {
  if (abs(value_of(y)) < ValueOf<S>(small_argument)) return S(1) + y * (S(0.5) + y * (S(1.0 / 6) + y * S(1.0 / 24)));
  return (exp(y) - S(1)) / y;
}

/// log(1 + y) / y.
template <class S>
S log_quotient(const S& y) {
  if (abs(value_of(y)) < ValueOf<S>(small_argument))
    return S(1) + y * (S(-0.5) + y * (S(1.0 / 3) + y * (S(-0.25) + y * S(0.2))));
  return log(S(1) + y) / y;
}

}  // namespace detail

/// Stiffness by tension, over the stiffness at rest.
template <class S>
struct StretchCurve {
  int entries{};                      ///< 0: the stiffness is constant
  S tension[most_stretch_entries]{};  ///< rising from 0, N
  S ratio[most_stretch_entries]{};    ///< not falling
  S stretch[most_stretch_entries]{};  ///< see rest_at(), N

  /// Counts the stretch from a tension at rest, N.
  void rest_at(const S& rest) {
    stretch[0] = S(0);
    for (int k = 1; k < entries; ++k) stretch[k] = stretch[k - 1] + between(k - 1, tension[k]);
    const S shift = rest - stretch_at(rest);
    for (int k = 0; k < entries; ++k) stretch[k] = stretch[k] + shift;
  }

  /// Tension by stretch, N; negative where the tendon would have to push.
  S tension_at(const S& by) const {
    const int k = last_below(stretch, by);
    const S more = by - stretch[k];
    const S first = ratio[k] * more;
    return tension[k] + (beyond(k, by < stretch[k]) ? first : first * detail::exp_quotient(growth(k) * more));
  }
  /// The inverse.
  S stretch_at(const S& pulled) const {
    const int k = last_below(tension, pulled);
    const S more = (pulled - tension[k]) / ratio[k];
    return stretch[k] + (beyond(k, pulled < tension[k]) ? more : between(k, pulled));
  }
  /// Stiffness at a tension, over that at rest.
  S ratio_at(const S& pulled) const {
    const int k = last_below(tension, pulled);
    return beyond(k, pulled < tension[k]) ? ratio[k] : ratio[k] + growth(k) * (pulled - tension[k]);
  }
  /// Energy of a tendon of a unit of stiffness at rest that a tension has stretched from none, N^2: the integral of
  /// the tension over the stretch.
  S energy_at(const S& pulled) const {
    S sum(0);
    for (int k = 0; k < entries && tension[k] < pulled; ++k) {
      const bool is_last = k + 1 == entries;
      const S end = is_last ? pulled : smaller(pulled, tension[k + 1]);
      const S growing = is_last ? S(0) : growth(k);
      const S more = end - tension[k];
      // T dT / (r + b (T - T_k)), by parts: with b T = (r + b (T - T_k)) - (r - b T_k).
      if (abs(value_of(growing * more)) < ValueOf<S>(detail::small_argument) * value_of(ratio[k])) {
        // Simpson's rule, whose error is of the fourth order in the argument.
        const S middle = tension[k] + S(0.5) * more;
        const S at_middle = ratio[k] + S(0.5) * growing * more;
        sum =
            sum + more / S(6) * (tension[k] / ratio[k] + S(4) * middle / at_middle + end / (ratio[k] + growing * more));
      } else {
        const S logarithm = log(S(1) + growing * more / ratio[k]);
        sum = sum + (more - (ratio[k] - growing * tension[k]) * logarithm / growing) / growing;
      }
    }
    return sum;
  }

 private:
  S growth(int k) const { return (ratio[k + 1] - ratio[k]) / (tension[k + 1] - tension[k]); }
  bool beyond(int k, bool is_below) const { return k + 1 == entries || is_below; }
  S between(int k, const S& pulled) const {
    const S more = (pulled - tension[k]) / ratio[k];
    return more * detail::log_quotient(growth(k) * more);
  }
  int last_below(const S* rising, const S& value) const {
    int k = 0;
    while (k + 1 < entries && rising[k + 1] < value) ++k;
    return k;
  }
};

}  // namespace tenodesis

#pragma once
// What may be known of a chain when a program is compiled: its mechanisms, its axes, and the joints that its tendons
// cross. The same code then runs without asking for them, in registers.

#include <utility>

#include "tenodesis/joint.hpp"

namespace tenodesis {

/// Calls f with each number below count, as a constant.
template <int count, class F>
[[gnu::always_inline]] constexpr void each(const F& f) {
  [&]<int... i>(std::integer_sequence<int, i...>) {
    (f(std::integral_constant<int, i>{}), ...);
  }(std::make_integer_sequence<int, count>{});
}

/// Nothing but sizes.
struct UnknownLayout {
  static constexpr bool known = false;
};

/// N joints one on another, as many of the handle, and M tendons with at most so many contacts.
template <int N, int M, int most>
struct Layout {
  static constexpr bool known = true;
  static constexpr int most_contacts = most;

  Mechanism mechanism[2 * N]{};  ///< of the tip's joints, then of the handle's
  Along axis[N]{};               ///< of the tip's joints
  int contacts[M]{};             ///< of each tendon
  int joint[M][most]{};          ///< of each contact, as a Passage has it
  bool draws[M][most]{};         ///< whether the joint draws the tendon at the contact
  bool ends[M]{};                ///< whether the tip draws a tendon in its last segment alone
};

/// The layout of so many planar axes, each with a joint of the handle, one of the tip and a pair of tendons, which
/// cross the joints of the axes before on their way; the sheath is one contact, and so is each joint.
template <int axes>
constexpr auto planar_layout(Mechanism tip) {
  // As in axis.hpp.
  const Mechanism handle = tip == Mechanism::continuum ? Mechanism::pulley : tip;
  Layout<axes, 2 * axes, 1 + 2 * axes> of{};
  for (int a = 0; a < axes; ++a) {
    of.mechanism[a] = tip;
    of.mechanism[axes + a] = handle;
    of.axis[a] = a % 2 == 0 ? Along::y : Along::x;
    for (int m = 2 * a; m < 2 * a + 2; ++m) {
      int n = 0;
      of.joint[m][n++] = -1;
      for (int h = a; h >= 0; --h) of.joint[m][n++] = axes + h;
      for (int i = 0; i <= a; ++i) of.joint[m][n++] = i;
      of.contacts[m] = n;
      of.draws[m][1] = of.draws[m][n - 1] = true;
      of.ends[m] = true;
    }
  }
  return of;
}

}  // namespace tenodesis

#pragma once
// Slip of a tendon at a contact, as sensors at the spool show it: which way, how certainly, and since which reversal.

#include "tenodesis/tuning.hpp"

namespace tenodesis {

/// Position of a tendon at a contact, with play: it counts as slipping only once it has moved by more than noise.
template <class S>
struct Slip {
  S dragged{};    ///< position that the play was last dragged to, m
  S indicator{};  ///< share of the play by which it was dragged in this tick, negative toward the tip
  S run{};        ///< number of plays by which it was dragged without reversing, up to twice the firm ones
};

template <class S>
Slip<S> follow(const Slip<S>& before, const S& position, const S& play) {
  Slip<S> after{};
  after.dragged = clamp(before.dragged, position - play * S(0.5), position + play * S(0.5));
  after.indicator = clamp((after.dragged - before.dragged) / play, S(-1), S(1));
  const bool turned = after.indicator * before.run < S(0);
  after.run =
      clamp(after.indicator + (turned ? S(0) : before.run), S(-2) * S(tuning::firm_run), S(2) * S(tuning::firm_run));
  return after;
}

/// Tension beyond a contact, N: on the edge that belongs to slip toward the spool (positive indicator) or the tip.
template <class S>
S beyond(const S& ratio, const S& near, const S& held, const S& indicator) {
  const S low = near / ratio;
  const S high = near * ratio;
  const S edge = indicator > S(0) ? low : high;
  return clamp(held + (edge - held) * abs(indicator), low, high);
}

/// e^x, for small x.
template <class S>
S small_exp(const S& x) {
  return S(1) + x * (S(1) + S(0.5) * x);
}

/// Which of a tendon's contacts are known to stick after a reversal.
enum class Stick : unsigned char {
  unknown,
  all,     ///< and soon the sheath slips
  handle,  ///< the sheath slips, the handle's joint sticks
};

/// Course of the tension at a spool since it last reversed.
///
/// After a reversal every contact sticks, one after the other begins to slip the other way, and the last one does once
/// the tension has changed by e^(2 E), E being the exponents of all. Unlike the tendon's positions, this does not
/// depend on where its compliance is.
template <class S>
struct Reversal {
  S direction{1};  ///< of the tension since then
  S turned{};      ///< tension at the reversal, N
  S extreme{};     ///< tension that has gone furthest since, N
  bool slipped{};  ///< whether all contacts slipped when it was there
  Stick stick{Stick::unknown};
  S handle_angle{};  ///< at the reversal, rad
  S tension[2]{};    ///< where the sheath began to slip: at the spool, before the handle's joint, N
  S position{};      ///< of the tendon at the handle's joint there, m

  static constexpr Reversal at(const S& tension) {
    Reversal one{};
    one.turned = one.extreme = tension;
    return one;
  }

  /// Whether the tension has changed by a factor since then.
  constexpr bool beyond(const S& now, const S& factor) const {
    return direction > S(0) ? now >= turned * factor : now * factor <= turned;
  }

  /// Change of tension that is left until then, N.
  constexpr S left(const S& now, const S& factor) const {
    return larger(direction > S(0) ? turned * factor - now : now - turned / factor, S(0));
  }
};

/// Follows the tension, whose noise is within a threshold; slips: whether all contacts slip in its direction.
template <class S>
void follow(const S& tension, const S& threshold, const S& handle_angle, bool slips, Reversal<S>& one) {
  const S onward = (tension - one.extreme) * one.direction;
  if (onward > S(0)) {
    one.extreme = tension;
    one.slipped = slips;
  } else if (onward < -threshold) {
    one.stick = one.slipped ? Stick::all : Stick::unknown;
    one.slipped = false;
    one.handle_angle = handle_angle;
    one.turned = one.extreme;
    one.extreme = tension;
    one.direction = -one.direction;
  }
}

}  // namespace tenodesis

#pragma once
// The settings and the state of homing, and the reasons for which it fails.

#include "tenodesis/control.hpp"
#include "tenodesis/homing_drive.hpp"
#include "tenodesis/parameter_table.h"

namespace tenodesis {

enum class HomingReason : std::uint8_t {
#define TENODESIS_HOMING_REASON(name, NAME, meaning) name,
  TENODESIS_HOMING_REASON_TABLE(TENODESIS_HOMING_REASON)
#undef TENODESIS_HOMING_REASON
};

#define TENODESIS_HOMING_REASON(name, NAME, meaning) #name,
inline constexpr const char* homing_reason_names[] = {TENODESIS_HOMING_REASON_TABLE(TENODESIS_HOMING_REASON)};
#undef TENODESIS_HOMING_REASON
inline constexpr int homing_reason_count = sizeof homing_reason_names / sizeof *homing_reason_names;

constexpr const char* name(HomingReason reason) {
  const int n = static_cast<int>(reason);
  return n < homing_reason_count ? homing_reason_names[n] : "unknown";
}

inline constexpr int no_tendon = -1;

/// Why homing failed, and at which tendon if it is one.
struct HomingFailure {
  HomingReason reason{HomingReason::none};
  int tendon{no_tendon};

  /// Whether a motor or an encoder is not what it should be.
  constexpr bool of_wiring() const {
    return reason >= HomingReason::motor_dead && reason <= HomingReason::spool_reversed;
  }

  /// As in the C interface: the reason, and 256 for the agonist, 512 for the antagonist.
  constexpr std::uint32_t word() const {
    return static_cast<std::uint32_t>(reason) | static_cast<std::uint32_t>(tendon + 1) << 8U;
  }
  static constexpr HomingFailure of_word(std::uint32_t word) {
    return {HomingReason(word & 0xFFU), static_cast<int>(word >> 8U & 3U) - 1};
  }
};

template <class S>
struct HomingSettings {
  S speed{};        ///< of slack tendons, m/s
  S most_stroke{};  ///< largest stroke before a tendon must be tight, m
  S overshoot{};    ///< before the last approach, share of the pretension
  S tolerance{};    ///< of the mean tension, share of the pretension
  S most_time{};    ///< of each stage, s
  S jog{};          ///< stroke of one motor to and fro, m
  S travel{};       ///< stroke by which one tendon alone may pull the tip, m
  S offset{};       ///< largest error of a cell, and difference of the tensions of a free tip, N
  S notice{};       ///< change of a tension that stands out from noise, N
  S hand_travel{};  ///< handle travel above which the hand counts as moving, rad
  S drive_time{};   ///< time constant of the drives, s
  HomingDrive<S> drive{};
  S rest_time{};  ///< for which readings are averaged at first, s

  /// Whether an offset of a current, or a tension by it that stands out, is far more stroke than one tendon may pull
  /// by.
  constexpr bool coarse(const S& stiffness) const {
    const S most = stiffness * travel;
    return drive.play > S(0) && (offset > S(1.3) * most || notice > S(0.6) * most);
  }
};

enum class HomingStage : std::uint8_t {
  idle,
  /// Motors and hand stand still, and all readings are averaged.
  rest,
  /// One motor, then the other, turns by some encoder steps and back: encoders and cells must answer as wired.
  jog,
  /// Taut tendons are let out until the looser one carries almost nothing, and friction is almost nothing: a difference
  /// that is left is a load or a cell's error.
  ease,
  /// If there is one, both are let out a little further, and jogs show which: a slack tendon does not answer.
  slacken,
  /// Both wind until both are tight; one alone may pull the tip by a small travel only.
  tighten,
  /// If one does not get tight, it is let out: if it gets tight now, its motor and encoder are reversed.
  probe,
  /// Past the pretension, below it and up to it, so that every contact ends on the same edge of its friction.
  exceed,
  release,
  approach,
  done,
  /// What was let out is wound again before giving up.
  restore,
  failed,
};

/// Means of both tensions.
template <class S>
struct MeanTensions {
  S sum[2]{};
  S count{};

  constexpr void add(const S (&tension)[2]) {
    for (int i = 0; i < 2; ++i) sum[i] = sum[i] + tension[i];
    count = count + S(1);
  }
  constexpr S of(int i) const { return sum[i] / larger(count, S(1)); }
};

/// One motor after the other to and fro; first index: motor, second: encoder or cell.
template <class S>
struct HomingJogs {
  HomingStage of{};  ///< the stage before
  int motor{};
  bool again{};                 ///< the first turn has shown the edge of the drive's friction alone
  S from[2]{};                  ///< spool angles before, rad
  S expected{};                 ///< as the state's, before, rad
  S asked[2]{};                 ///< of the motor, rad
  S turned[2][2]{};             ///< by the motor, rad
  MeanTensions<S> moving[2]{};  ///< while it turns forth and back
  MeanTensions<S> whole[2]{};   ///< and until it turns again
  S at_once[2][2]{};            ///< tension while turning forth, less that before and while turning back, N
  S answer[2][2]{};             ///< the same until it turns again, N

  /// Of the rotation asked of a motor, the share that an encoder has seen.
  constexpr S share(int of_motor, int encoder) const { return turned[of_motor][encoder] / asked[of_motor]; }

  /// By how much more the motors' own cells answer at once than the others, N: between a motor and the other tendon's
  /// cell are friction, damping and inertia of the tip.
  constexpr S own_answers() const { return at_once[0][0] - at_once[0][1] + at_once[1][1] - at_once[1][0]; }

  /// What is wrong unless either motor turns its own encoder, by as much as it should. flat: change of a tension that
  /// counts as none, N.
  constexpr HomingFailure wrong_encoder(bool taut, const S& flat) const {
    using enum HomingReason;
    const auto moves = [&](int turning, int encoder) { return abs(share(turning, encoder)) > S(0.2); };
    if (!moves(0, 0) && !moves(1, 1) && moves(0, 1) && moves(1, 0))
      return {taut && own_answers() > flat ? encoders_swapped : motors_swapped, no_tendon};
    for (int i = 0; i < 2; ++i) {
      if (moves(i, i) && share(i, i) > S(0.6) && share(i, i) < S(1.45)) continue;
      const bool tightens = answer[i][0] + answer[i][1] > flat;
      return {!moves(i, i)         ? motor_dead
              : share(i, i) > S(0) ? encoder_gain
              : taut && tightens   ? encoder_reversed
                                   : motor_reversed,
              i};
    }
    return {};
  }
};

template <class S>
struct HomingState {
  HomingStage stage{HomingStage::idle};
  HomingFailure failure{};
  S time{};         ///< in this stage, s
  S settled{};      ///< time within the tolerance, s
  S waited{};       ///< for a still hand, s
  S handle{};       ///< smoothed, rad
  S held{};         ///< where the handle must stay, rad
  S tension[2]{};   ///< smoothed, N
  S before{};       ///< mean tension some milliseconds ago, N
  S before_at{};    ///< stroke then, m
  S base[2]{};      ///< tension at the beginning of the stage, N
  S start[2]{};     ///< spool angle at the beginning, rad
  S angle[2]{};     ///< spool angle, rad
  S speed[2]{};     ///< of the drive's model, rad/s
  S expected[2]{};  ///< its rotation, rad
  S wanted[2]{};    ///< recent part of it, rad
  S turned[2]{};    ///< recent rotation of the spool, rad
  HomingDriveState<S> drive[2]{};
  MeanTensions<S> mean{};  ///< at rest
  HomingJogs<S> jogs{};
  bool proven{};     ///< both motors tighten their own tendons, and their own cells say so
  bool eased{};      ///< the next two are known
  S fallen[2]{};     ///< tensions when they last fell noticeably, N
  S fallen_at[2]{};  ///< common strokes then, m
  bool tight[2]{};
  bool taut{};           ///< both
  bool paused{};         ///< before the probe
  S tight_at[2]{};       ///< strokes when both became tight, m
  S tight_by[2]{};       ///< tension then, N
  S stroke{};            ///< stage's own mark, m
  S mean_before{};       ///< tensions when the wiring was proven, N
  S imbalance_before{};  ///< N
  S gain_difference{};   ///< of the cells, share; a measured quantity
  S slack_from{};        ///< common stroke where winding began, m
  S deeper{};            ///< release by more, as share of the pretension
  S offset[2]{};         ///< of the cells, as they read without tension, N
  bool suspect{};        ///< tensions differ by more than cells may
  bool judged{};         ///< stretch and gains

  constexpr bool failed() const { return stage == HomingStage::failed; }

  /// Before a motor turns.
  constexpr void listen() {
    jogs.moving[0] = jogs.moving[1] = jogs.whole[0] = jogs.whole[1] = mean = {};
    time = S(0);
  }
};

}  // namespace tenodesis

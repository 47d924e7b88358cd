#pragma once
// State and settings of the friction observer.

#include "tenodesis/control.hpp"
#include "tenodesis/intent.hpp"
#include "tenodesis/slip.hpp"

namespace tenodesis {

/// State of the friction observer for one tendon.
template <class S>
struct TendonMemory {
  S tension[4]{};     ///< at the spool, before the handle's joint, in the stem, at the tip, N
  Slip<S> slip[2]{};  ///< at the sheath, at the handle's joint
  Reversal<S> reversal{};
  bool slips{};  ///< whether both contacts slip the way the tension at the spool changes, on the edges of their bands
};

template <class S>
struct FrictionMemory {
  TendonMemory<S> tendon[2]{};
  S handle_angle{};         ///< smoothed, rad
  Measurement<S> smooth{};  ///< with play in the handle angle
  IntentState<S> intent{};
  S target{};      ///< of the tip's position, m: with inextensible tendons, or its stop
  S passed[2]{};   ///< exponents of the joints of axes before, at the handle and at the tip, by the parameters
  S nominal[3]{};  ///< exponents of sheath, handle's joint and tip's joint by the parameters' friction
  S together{};    ///< direction in which both tendons slip: 1 toward the spools, -1 the tip, 0 not
  S reversing{1};  ///< factor by which a stroke changes the tension at the spool before all contacts slip
  S ratio[3]{S(1), S(1), S(1)};  ///< of the tensions on either side of a slipping contact there
  S tip{};                       ///< position of the tip as tendon length, m
  S output_angle{};              ///< at that position, rad
  S x{};                         ///< the joint's coordinate there
  S arm{};                       ///< moment arm of the tendons there, m
  S scale{1};                    ///< of friction
  S reference{};                 ///< excess of both tendons' lengths over their references, m
  S reference_at_start{};        ///< the same by the tensions at the start, m
  S by_ropes{};                  ///< how far ropes of another length than then have moved the tip, either way, m
  S earlier_scale{1};            ///< friction scale as it was a stroke ago, smoothed
  S compliance_scale{1};         ///< of the tendons, relative to the parameters
  S compliance{};                ///< stretch of a tendon per newton, m/N
  S share[4]{};                  ///< of the compliance by segment, as it has been found
  S gain_error{};                ///< of the agonist's load cell, the antagonist's being its opposite
  S covariance[4][4]{};          ///< of scale, reference, compliance, gain error; of each pair the first alone
  S share_variance{};            ///< of the share before the handle's joint
  S since_together{};            ///< time since friction was learned from tendons that slip the same way, s
  Slip<S> tip_slip{};            ///< of the tendons at the tip's joint, as length of the agonist
  S tip_edge{};                  ///< friction at the tip's joint over its bound, of the agonist, for the force alone
  S unobservable[2]{};           ///< how far the tip may have moved unseen, toward flexion and extension, m
  S position_variance{};         ///< of the tip, as far as strokes can lower it, m^2
  S deviation{};                 ///< standard deviation of the tip's position, m
  bool started{};
  bool homed{};  ///< whether compliance and gains are known from homing
};

template <class S>
struct FrictionSettings {
  S hand_play{};       ///< half the play that rejects the handle encoder's noise and steps, rad
  S sheath_play{};     ///< of a tendon's slip in the sheath, m
  S length_noise{};    ///< of the difference of two tendon lengths over one play of slip, m
  S play{};            ///< of a slipping tendon, larger than noise, m
  S smoothing{};       ///< time constant of the measurement filter, s
  S scale_std{};       ///< of the friction scale at the start
  S reference_std{};   ///< m
  S compliance_std{};  ///< of the compliance at the start
  S slack_below{};     ///< tension below which a tendon counts as slack, N
  S gain_std{};        ///< of the gain error at the start
  S bias_std{};        ///< of the tip's position by constant errors of cells and handle encoder, and the play, m
  S tremor_play{};     ///< half the width of the handle encoder's noise, rad
};

}  // namespace tenodesis

#pragma once
// Inputs and outputs of the controller of one axis, and its model of the instrument.

#include <cstdint>

#include "tenodesis/friction.hpp"
#include "tenodesis/statics.hpp"

namespace tenodesis {

/// Readings of the proximal sensors of one axis.
template <class S>
struct Measurement {
  S handle_angle{};    ///< rad
  S tension[2]{};      ///< at the spools, agonist first, N
  S spool_angle[2]{};  ///< zero where both tendons have their pretension at a straight handle, rad; positive winds
};

/// The same measurement in another type that has these fields.
template <class To, class From>
constexpr To measurement_as(const From& from) {
  using S = decltype(To::handle_angle);
  return {
      S(from.handle_angle), {S(from.tension[0]), S(from.tension[1])}, {S(from.spool_angle[0]), S(from.spool_angle[1])}};
}

/// What an observer estimates; the standard deviations include what the sensors cannot see.
template <class S>
struct Estimate {
  S output_angle{};        ///< rad
  S output_angle_std{};    ///< rad
  S tip_force{};           ///< tangential at the tip, positive against positive flexion, N
  S tip_force_std{};       ///< N
  S friction_scale{1};     ///< actual friction over that of the parameters
  S friction_scale_std{};  ///< 1
};

/// The same estimate in another type that has these fields.
template <class To, class From>
constexpr To estimate_as(const From& from) {
  using S = decltype(To::output_angle);
  return {S(from.output_angle),  S(from.output_angle_std), S(from.tip_force),
          S(from.tip_force_std), S(from.friction_scale),   S(from.friction_scale_std)};
}

/// Speeds of the two tendons at the spools, winding positive, m/s.
template <class S>
struct Winding {
  S agonist{};
  S antagonist{};
};

/// The constants of one axis that observers and compensators use.
template <class A>
struct ControlModel {
  using S = A::Scalar;

  A axis{};
  S spool_radius{};      ///< m
  S share[4]{};          ///< of a tendon's compliance: to the sheath, to the handle's joint, in the stem, at the tip
  S vertex{};            ///< friction coefficient at the joints' vertices
  S base_wrap{};         ///< wrap angle of a straight joint, rad
  S sheath{};            ///< friction coefficient in the sheath
  S sheath_bend{};       ///< total bend of the sheath, rad
  S sheath_bend_rate{};  ///< added to it per radian of |handle angle|
  S passing{};           ///< friction coefficient where the tendons pass the joints of axes before
  S stop{};              ///< tendon length that the tip takes at its mechanical stop, m
  S yielding{1};         ///< differential stroke per length that the unloaded tip follows it by: its spring stretches

  /// Tendon length that the handle draws on the agonist and lets out on the antagonist, m.
  S excursion(const S& handle_angle) const { return handle_excursion(axis, handle_angle); }
  /// What of it the unloaded tip takes, m: what the laws aim at.
  S aim(const S& handle_angle) const { return unloaded_length(axis, excursion(handle_angle)); }
  /// Differential stroke by which the tip follows by a length, m.
  S stroke_for(const S& length) const { return springs() ? yielding * length : length; }
  /// Whether the joint has a spring of its own; known when compiling where its mechanism has none.
  constexpr bool springs() const { return axis.distal.passive_stiffness() > S(0); }
  /// The same of the tip, for an output angle.
  S taken(const S& output_angle) const { return axis.distal.excursion_slope() * axis.distal.coordinate(output_angle); }
};

}  // namespace tenodesis

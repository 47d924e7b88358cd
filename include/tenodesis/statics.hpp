#pragma once
// Statics of an instrument with a held handle: angles, tensions, transmissibility, stiffness, loss and compensation.
//
// Every function takes an axis and returns a value with a status; the value is valid only if the status is ok.

#include "tenodesis/equilibrium.hpp"

namespace tenodesis {

template <class V>
struct Result {
  V value{};
  Status status{Status::ok};
};

enum class Actuation : unsigned char {
  agonist,       ///< one motor winds the agonist tendon
  differential,  ///< the agonist's motor winds what the antagonist's lets out
};

enum class Law : unsigned char {
  exact,  ///< restores the full loss, slack included
  paper,  ///< eq. 22 of the paper, whatever the actuation
};

/// Index of a tendon in an array of two.
inline constexpr int agonist = 0, antagonist = 1;

/// Rounding that a handle angle converted from degrees may carry past the range, rad.
template <Real S>
inline constexpr S range_tolerance = sizeof(S) == 4 ? S(1e-6) : S(1e-9);

template <class A, class S>
Status check_handle(const A& axis, const S& handle_angle) {
  if (!is_finite(value_of(handle_angle))) return Status::not_finite;
  using V = ValueOf<S>;
  return abs(value_of(handle_angle)) <= value_of(axis.handle_range) + range_tolerance<V> ? Status::ok
                                                                                         : Status::out_of_range;
}

/// Equilibrium at a held handle; see equilibrium.hpp.
template <class A, class S>
Equilibrium<S> equilibrium(const A& axis, const S& handle_angle, const Load<S>& load, const Stroke<S>& wound = {}) {
  const Status handle = check_handle(axis, handle_angle);
  if (handle != Status::ok) return {{}, handle, 0};
  return solve(axis.distal, TendonPair<S>::at_handle(axis, handle_angle, wound), load);
}

/// Output angle of the end-effector, rad (eqs. 9, 18).
template <class A, class S>
Result<S> output_angle(const A& axis, const S& handle_angle, const Load<S>& load, const Stroke<S>& wound = {}) {
  const Equilibrium<S> at = equilibrium(axis, handle_angle, load, wound);
  if (at.status != Status::ok) return {{}, at.status};
  return {axis.distal.angle(at.coordinate), Status::ok};
}

/// Tendon length that the tip takes without load and friction, unwound, where the handle draws a length, m.
///
/// All of it, where the joint has no spring of its own (eq. 18); a spring stretches the tendons.
template <class A, class S>
S unloaded_length(const A& axis, const S& excursion) {
  if (!(axis.distal.passive_stiffness() > S(0))) return excursion;
  return axis.distal.excursion_slope() *
         unloaded_coordinate(axis.distal, TendonPair<S>::at_excursion(axis, excursion, {}));
}

/// Output angle without load and friction, unwound, rad: what compensation restores (eq. 18, with the joint's spring).
template <class A, class S>
Result<S> unloaded_angle(const A& axis, const S& handle_angle) {
  const Status handle = check_handle(axis, handle_angle);
  if (handle != Status::ok) return {{}, handle};
  const S x = unloaded_length(axis, handle_excursion(axis, handle_angle)) / axis.distal.excursion_slope();
  if (!(abs(x) < axis.distal.limit())) return {{}, Status::unreachable};
  return {axis.distal.angle(x), Status::ok};
}

/// Tendon tensions at a held handle, N (eqs. 6-8).
template <class A, class S>
Result<Tensions<S>> tensions(const A& axis, const S& handle_angle, const Load<S>& load, const Stroke<S>& wound = {}) {
  const Equilibrium<S> at = equilibrium(axis, handle_angle, load, wound);
  if (at.status != Status::ok) return {{}, at.status};
  return {TendonPair<S>::at_handle(axis, handle_angle, wound).tensions(at.coordinate), Status::ok};
}

namespace detail {

// Elongation that the joints' bending adds to the agonist and takes from the antagonist.
template <class A, class S>
Result<S> elongation(const A& axis, const Tensions<S>& tension, const Stroke<S>& wound, bool agonist_taut,
                     bool antagonist_taut) {
  const S on_agonist = (tension.agonist - axis.pretension) / axis.stiffness - wound.agonist;
  const S on_antagonist = (axis.pretension - tension.antagonist) / axis.stiffness + wound.antagonist;
  if (agonist_taut && antagonist_taut) return {(on_agonist + on_antagonist) * S(0.5), Status::ok};
  if (agonist_taut) return {on_agonist, Status::ok};
  if (antagonist_taut) return {on_antagonist, Status::ok};
  return {{}, Status::both_slack};
}

}  // namespace detail

/// Handle angle that holds an output angle under load, rad: the inverse of output_angle (eq. 20, slack included).
///
/// There is none for an output angle off the branch that starts at zero load, nor beyond the handle's range.
template <class A, class S>
Result<S> handle_angle(const A& axis, const S& output_angle, const Load<S>& load, const Stroke<S>& wound = {}) {
  using V = ValueOf<S>;
  if (!all_finite(value_of(output_angle), value_of(load.force), value_of(load.radial_force), value_of(wound.agonist),
                  value_of(wound.antagonist)))
    return {{}, Status::not_finite};
  if (!(abs(output_angle) < S(pi))) return {{}, Status::unreachable};
  const S x = axis.distal.coordinate(output_angle);
  const Demand<S> demand = axis.distal.demand(x, load);
  const S difference = demand.value / demand.weight;

  // With both tendons taut, pretension and motors give the mean tension; a tendon that would have to push is slack.
  const S mean = axis.pretension + axis.stiffness * (wound.agonist + wound.antagonist) * S(0.5);
  Tensions<S> tension{mean + difference * S(0.5), mean - difference * S(0.5)};
  const bool both_taut = tension.agonist >= S(0) && tension.antagonist >= S(0);
  const bool agonist_taut = both_taut || difference > S(0);
  const bool antagonist_taut = both_taut || difference < S(0);
  if (!both_taut) tension = {agonist_taut ? difference : S(0), antagonist_taut ? -difference : S(0)};
  const Result<S> stretch = detail::elongation(axis, tension, wound, agonist_taut, antagonist_taut);
  if (stretch.status != Status::ok) return {{}, stretch.status};

  const S proximal = (axis.distal.excursion_slope() * x + stretch.value) / axis.proximal.excursion_slope();
  if (!(abs(proximal) < axis.proximal.limit())) return {{}, Status::unreachable};
  const S angle = axis.proximal.angle(proximal);
  if (check_handle(axis, angle) != Status::ok) return {{}, Status::unreachable};

  // The balance has other roots, past a fold or on another branch: the handle angle must lead back.
  const Equilibrium<V> back =
      equilibrium(axis.values(), value_of(angle), Load<V>{value_of(load.force), value_of(load.radial_force)},
                  Stroke<V>{value_of(wound.agonist), value_of(wound.antagonist)});
  if (back.status != Status::ok) return {{}, back.status};
  // Close to the fold, rounding changes the angle a lot.
  constexpr V near = sizeof(V) == 4 ? V(1e-2) : V(1e-5);
  return {angle, abs(back.coordinate - value_of(x)) <= near ? Status::ok : Status::no_equilibrium};
}

/// Torque transmissibility at a handle angle and a distal coordinate; see torque_transmissibility.
template <class A, class S>
S torque_transmissibility_at(const A& axis, const S& handle_angle, const S& x) {
  const auto per_tension = [](const auto& joint, const S& at) {
    return joint.moment_arm(at) / joint.tangential_arm(at) * joint.tangential_arm(S(0));
  };
  return per_tension(axis.distal, x) / per_tension(axis.proximal, axis.proximal.coordinate(handle_angle));
}

/// Torque transmissibility, ratio of output to input moment carried by the tendons (eqs. 2, 10-14).
///
/// The moment of a continuum's backbone is not included: the tendons do not transmit it.
template <class A, class S>
Result<S> torque_transmissibility(const A& axis, const S& handle_angle, const Load<S>& load,
                                  const Stroke<S>& wound = {}) {
  const Equilibrium<S> at = equilibrium(axis, handle_angle, load, wound);
  if (at.status != Status::ok) return {{}, at.status};
  return {torque_transmissibility_at(axis, handle_angle, at.coordinate), Status::ok};
}

/// Flexural stiffness of the distal joint with both tendons taut, N·m/rad (eqs. 15, 16).
template <class A, class S>
Result<S> flexural_stiffness(const A& axis, const S& output_angle) {
  if (!is_finite(value_of(output_angle))) return {{}, Status::not_finite};
  if (!(abs(output_angle) < S(pi))) return {{}, Status::unreachable};
  const S arm = axis.distal.moment_arm(axis.distal.coordinate(output_angle));
  return {S(2) * axis.stiffness * arm * arm + axis.distal.passive_stiffness(), Status::ok};
}

/// Loss of dexterity, external moment over flexural stiffness, rad (eq. 17): the loss to first order in the force.
template <class A, class S>
Result<S> loss_of_dexterity(const A& axis, const S& output_angle, const S& force) {
  const Result<S> stiffness = flexural_stiffness(axis, output_angle);
  if (stiffness.status != Status::ok) return stiffness;
  if (!is_finite(value_of(force))) return {{}, Status::not_finite};
  const S arm = axis.distal.tangential_arm(axis.distal.coordinate(output_angle));
  return {force * arm / stiffness.value, Status::ok};
}

namespace detail {

// Tangential force that takes a tension difference to hold at a coordinate.
template <class A, class S>
S force_of(const A& axis, const S& x, const S& tension_difference) {
  const auto held = [&](const S& force) {
    const Demand<S> demand = axis.distal.demand(x, Load<S>{force, S(0)});
    return demand.value / demand.weight;
  };
  const S unloaded = held(S(0));
  return (tension_difference - unloaded) / (held(S(1)) - unloaded);
}

}  // namespace detail

/// Tangential force at which the antagonist is slack at a held output angle, N (eqs. 1, 8 where they meet): negative
/// where it is slack without a force.
template <class A, class S>
Result<S> slack_force(const A& axis, const S& output_angle) {
  if (!is_finite(value_of(output_angle))) return {{}, Status::not_finite};
  if (!(abs(output_angle) < S(pi))) return {{}, Status::unreachable};
  return {detail::force_of(axis, axis.distal.coordinate(output_angle), S(2) * axis.pretension), Status::ok};
}

/// Tangential force under which a tendon goes slack at a held handle, N: 0 where one is slack without a force.
template <class A, class S>
Result<S> slack_load(const A& axis, const S& handle_angle, const Stroke<S>& wound = {}) {
  const Equilibrium<S> free = equilibrium(axis, handle_angle, Load<S>{}, wound);
  if (free.status != Status::ok) return {{}, free.status};
  const auto pair = TendonPair<S>::at_handle(axis, handle_angle, wound);
  const Tensions<S> rest = pair.tensions(free.coordinate);
  if (!(rest.agonist > S(0) && rest.antagonist > S(0))) return {S(0), Status::ok};
  // A positive force draws the agonist and lets the antagonist go.
  const S x = -pair.antagonist / pair.rate;
  if (!(abs(x) < axis.distal.limit())) return {{}, Status::unreachable};
  const S force = detail::force_of(axis, x, pair.agonist + pair.antagonist);
  // The joint may have snapped through before.
  const Equilibrium<S> at = equilibrium(axis, handle_angle, Load<S>{force, S(0)}, wound);
  if (at.status != Status::ok) return {{}, at.status};
  using V = ValueOf<S>;
  if (!(abs(value_of(at.coordinate - x)) <= V(sizeof(V) == 4 ? 1e-3 : 1e-6))) return {{}, Status::no_equilibrium};
  return {force, Status::ok};
}

/// Output angle from the proximal sensors without friction, rad (eq. 19, slack and motors included).
///
/// A tendon whose tension is not above slack_below (N) counts as slack and is left out.
template <class A, class S>
Result<S> estimate_output_angle(const A& axis, const S& handle_angle, const Tensions<S>& tension,
                                const Stroke<S>& wound = {}, const S& slack_below = S(0)) {
  const Status handle = check_handle(axis, handle_angle);
  if (handle != Status::ok) return {{}, handle};
  if (!all_finite(value_of(tension.agonist), value_of(tension.antagonist), value_of(wound.agonist),
                  value_of(wound.antagonist), value_of(slack_below)))
    return {{}, Status::not_finite};
  const Result<S> stretch =
      detail::elongation(axis, tension, wound, tension.agonist > slack_below, tension.antagonist > slack_below);
  if (stretch.status != Status::ok) return stretch;
  const S x = (handle_excursion(axis, handle_angle) - stretch.value) / axis.distal.excursion_slope();
  if (!(abs(x) < axis.distal.limit())) return {{}, Status::unreachable};
  return {axis.distal.angle(x), Status::ok};
}

/// Tendon length to wind so that the joint bends as without a load, m (eqs. 21, 22 without the spool).
///
/// Counted from the unwound motors. Differential actuation winds it on the agonist and lets it out on the antagonist.
/// One motor moves one tendon where the handle moves two, so it needs twice the stroke of eq. 22; see docs/model.md.
template <class A, class S>
Result<S> compensation_stroke(const A& axis, const Tensions<S>& tension, const S& handle_angle, Actuation actuation,
                              Law law) {
  const S difference = tension.difference();
  if (!all_finite(value_of(tension.agonist), value_of(tension.antagonist), value_of(handle_angle)))
    return {{}, Status::not_finite};
  // What the joint's own spring stretches the agonist and slackens the antagonist by without a load stays.
  const S excursion = handle_excursion(axis, handle_angle);
  const S stretch = excursion - unloaded_length(axis, excursion);
  const Tensions<S> free{larger(axis.pretension + axis.stiffness * stretch, S(0)),
                         larger(axis.pretension - axis.stiffness * stretch, S(0))};
  if (law == Law::paper) return {(difference - free.difference()) / (S(2) * axis.stiffness), Status::ok};
  if (actuation == Actuation::agonist) {
    const S pull = difference + free.antagonist;
    // A tendon that hangs without a load is wound only if it has to pull.
    if (!(free.agonist > S(0)) && abs(pull) <= settled<ValueOf<S>> * axis.pretension) return {S(0), Status::ok};
    // Letting the agonist out past slack moves the joint no further.
    if (pull < S(0)) return {{}, Status::no_authority};
    return {(difference - (axis.pretension - free.antagonist)) / axis.stiffness - stretch, Status::ok};
  }
  const S size = abs(difference);
  const S stroke = size <= S(2) * axis.pretension ? size * S(0.5) : size - axis.pretension;
  return {(difference < S(0) ? -stroke : stroke) / axis.stiffness - stretch, Status::ok};
}

}  // namespace tenodesis

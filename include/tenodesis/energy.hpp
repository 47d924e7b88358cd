#pragma once
// The energy balance of a step: stored energy, work put in, losses to friction and damping.
//
// All work is integrated by the trapezoidal rule, which for linear springs is exact.

#include "tenodesis/twin.hpp"

namespace tenodesis {

/// Energies of one axis, J.
template <class S>
struct Energy {
  S stored{};    ///< in tendons, backbone, stop, tissue and the tip's motion
  S handle{};    ///< work of the handle on the tendons
  S spools{};    ///< work of the spools on the tendons
  S load{};      ///< work of the load on the tip
  S friction{};  ///< lost at the contacts
  S damping{};   ///< lost at the tip
  S tissue{};    ///< lost in tissue: to its damping, and what was stored in tissue that is taken away
  /// Lost at the contacts by the tensions at the step's end, where the friction law holds: not negative, except for
  /// rounding.
  S friction_at_end{};
};

/// Energy stored in a state, J.
template <class T>
T::S stored_energy(const T& twin, const typename T::State& state) {
  using S = T::S;
  const S motion = twin.quasi_static ? S(0) : twin.body.inertia * state.output_velocity * state.output_velocity;
  S sum = motion + twin.axis.distal.passive_stiffness() * state.output_angle * state.output_angle;
  const S beyond = twin.beyond_stop(state.output_angle);
  sum = sum + twin.body.stop_stiffness * beyond * beyond;
  for (const auto& tendon : state.tendon)
    for (int i = 0; i <= twin.tendon.contacts(); ++i)
      sum = sum + tendon.tension[i] * tendon.tension[i] / twin.tendon.stiffness[i];
  return sum * S(0.5) + stored_in(twin.axis.distal, state.load.contact, state.output_angle);
}

/// The energies of a step between two states, with the loads at its two ends.
template <class T>
Energy<typename T::S> account(const T& twin, const typename T::State& before, const typename T::State& after,
                              const Load<typename T::S>& load_before, const Load<typename T::S>& load_after) {
  using S = T::S;
  const auto mean = [](const S& a, const S& b) { return (a + b) * S(0.5); };
  const auto load_moment = [&](const T::State& state, const Load<S>& load) {
    const S x = twin.axis.distal.coordinate(state.output_angle);
    return load.radial_force * twin.axis.distal.radial_arm(x) - load.force * twin.axis.distal.tangential_arm(x);
  };
  Energy<S> energy{};
  energy.stored = stored_energy(twin, after);
  energy.handle = mean(before.handle_moment, after.handle_moment) * (after.handle_angle - before.handle_angle);
  const S turned = after.output_angle - before.output_angle;
  energy.load = mean(load_moment(before, load_before), load_moment(after, load_after)) * turned;
  if (!twin.quasi_static)
    energy.damping = twin.body.damping * mean(before.output_velocity, after.output_velocity) * turned;
  // Placed or taken away while the tip is where it was, then pushed.
  const auto& contact = after.load.contact;
  energy.tissue = stored_in(twin.axis.distal, before.load.contact, before.output_angle) -
                  stored_in(twin.axis.distal, contact, before.output_angle);
  if (!twin.quasi_static)
    energy.tissue = energy.tissue - after.contact_moment * turned +
                    stored_in(twin.axis.distal, contact, before.output_angle) -
                    stored_in(twin.axis.distal, contact, after.output_angle);
  for (int k = 0; k < 2; ++k) {
    const auto& was = before.tendon[k];
    const auto& is = after.tendon[k];
    const S wound = twin.drive.spool_radius * (after.drive[k].spool - before.drive[k].spool);
    energy.spools = energy.spools + mean(was.tension[0], is.tension[0]) * wound;
    for (int j = 0; j < twin.tendon.contacts(); ++j) {
      const S at_start = was.tension[j] - was.tension[j + 1];
      const S at_end = is.tension[j] - is.tension[j + 1];
      const S slipped = is.slip[j] - was.slip[j];
      energy.friction = energy.friction + mean(at_start, at_end) * slipped;
      energy.friction_at_end = energy.friction_at_end + at_end * slipped;
    }
  }
  return energy;
}

}  // namespace tenodesis

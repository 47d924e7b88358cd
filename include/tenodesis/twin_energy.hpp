#pragma once
// The energy balance of a step of a twin: stored energy, work put in, losses to friction and damping.
//
// All work is integrated by the trapezoidal rule, which for linear springs is exact. In a step of backward Euler
// (twin_step.hpp) it is that of what acts at the step's end, and what such a step takes from a swing counts as damping.

#include "tenodesis/twin.hpp"

namespace tenodesis {

/// Energies of a twin, J.
template <class S>
struct Energy {
  S stored{};    ///< in tendons, springs, stops, tissue, what is gripped and the links' motion
  S handle{};    ///< work of the handle on the tendons
  S spools{};    ///< work of the spools on the tendons
  S load{};      ///< work of the load on the tip
  S friction{};  ///< lost at the contacts
  S damping{};   ///< lost at the tip's joints, within tendons, and of swings that steps do not follow
  S tissue{};    ///< lost in tissue: to its damping, and what was stored in tissue that is taken away
  /// Lost at the contacts by the tensions at the step's end, where the friction law holds: not negative, except for
  /// rounding.
  S friction_at_end{};
};

/// Energy stored in a state, J.
template <class T>
T::S stored_energy(const T& twin, const typename T::State& state) {
  using S = T::S;
  constexpr int N = T::N;
  S twice(0);
  twin.each_tendon([&](int m) {
    typename T::Rope::Lengths stretch;
    const bool nonlinear = twin.is_nonlinear(m);
    if (nonlinear) twin.stretches(m, state, stretch);
    for (int i = 0; i <= twin.contacts(m); ++i) {
      const S& held = state.tendon[m].tension[i];
      const S twice_by =
          nonlinear ? twin.chain.twice_energy(m, larger(twin.elastic(m, i, stretch[i]), S(0))) : held * held;
      twice = twice + twice_by / twin.tendon[m].stiffness[i];
    }
  });
  for (int i = 0; i < N; ++i) {
    const S beyond = twin.beyond_stop(i, state.angle[i]);
    const S square = state.angle[i] * state.angle[i];
    const auto& joint = twin.chain.joint[i];
    twice = twice + (joint.stiffness + S(0.5) * joint.hardening * square) * square +
            twin.stop_stiffness[i] * beyond * beyond;
  }
  twin.chain.each_tie([&](int i, const Tie<S>& tie) {
    const S apart = state.angle[i] - tie.ratio * state.angle[tie.to];
    twice = twice + tie.stiffness * apart * apart;
  });
  if (!twin.quasi_static) {
    S x[N], matrix[N][N], bias[N];
    for (int i = 0; i < N; ++i) x[i] = coordinate_at(twin.mechanism(i), state.angle[i]);
    inertia(twin.chain, twin.link, x, state.velocity, matrix, bias);
    for (int i = 0; i < N; ++i)
      for (int j = 0; j < N; ++j) twice = twice + state.velocity[i] * matrix[i][j] * state.velocity[j];
  }
  const S pressed = larger(state.command.held.opening - twin.opening(state.angle), S(0));
  S stored = S(0.5) * (twice + state.command.held.stiffness * pressed * pressed);
  for (int i = 0; i < N; ++i) stored = stored + stored_in(twin.path(i), state.command.contact[i], state.angle[i]);
  return stored;
}

/// The energies of a step between two states; tissue is what is lost in it and in what the jaws hold.
template <class T>
Energy<typename T::S> twin_energy(const T& twin, const typename T::State& before, const typename T::State& after) {
  using S = T::S;
  constexpr int N = T::N;
  const bool backward = twin.is_backward(before);
  const auto mean = [&](const S& a, const S& b) { return backward ? b : (a + b) * S(0.5); };
  Energy<S> energy{};
  energy.stored = stored_energy(twin, after);
  for (int h = 0; h < N; ++h)
    energy.handle = energy.handle +
                    mean(before.handle_moment[h], after.handle_moment[h]) * (after.angle[N + h] - before.angle[N + h]);
  S was[N], is[N], rate[N][N];
  const auto loads = [&](const T::State& state, S* moment) {
    Bend<S> bend[N];
    for (int i = 0; i < N; ++i) bend[i] = twin.chain.bend(i, coordinate_at(twin.mechanism(i), state.angle[i]));
    twin.chain.load_moments(bend, twin.load_of(state.command), moment, rate);
  };
  loads(before, was);
  loads(after, is);
  for (int i = 0; i < N; ++i) {
    const S turned = after.angle[i] - before.angle[i];
    energy.load = energy.load + mean(was[i], is[i]) * turned;
    if (!twin.quasi_static)
      energy.damping = energy.damping + twin.damping[i] * mean(before.velocity[i], after.velocity[i]) * turned;
  }
  for (int m = 0; m < T::M; ++m) {
    if (!(twin.chain.stiffness[m] > S(0))) continue;
    const auto& then = before.tendon[m];
    const auto& now = after.tendon[m];
    const S wound = twin.drive.spool_radius * (after.drive[m].spool - before.drive[m].spool);
    energy.spools = energy.spools + mean(then.tension[0], now.tension[0]) * wound;
    if (twin.is_nonlinear(m) && !twin.quasi_static) {
      typename T::Rope::Lengths was_by, by;
      twin.stretches(m, before, was_by);
      twin.stretches(m, after, by);
      const auto damped = [&](const auto& of, int i, const S& at) {
        return of.tension[i] - larger(twin.elastic(m, i, at), S(0));
      };
      for (int i = 0; i <= twin.contacts(m); ++i)
        energy.damping = energy.damping + mean(damped(then, i, was_by[i]), damped(now, i, by[i])) * (by[i] - was_by[i]);
    }
    for (int j = 0; j < twin.contacts(m); ++j) {
      const S at_start = then.tension[j] - then.tension[j + 1];
      const S at_end = now.tension[j] - now.tension[j + 1];
      const S slipped = now.slip[j] - then.slip[j];
      energy.friction = energy.friction + mean(at_start, at_end) * slipped;
      energy.friction_at_end = energy.friction_at_end + at_end * slipped;
    }
  }
  // Brought between the jaws while these are where they were, then pressed.
  const auto stored = [&](const Held<S>& held, const S* angle) {
    const S pressed = larger(held.opening - twin.opening(angle), S(0));
    return S(0.5) * held.stiffness * pressed * pressed;
  };
  const auto& held = after.command.held;
  energy.tissue = stored(before.command.held, before.angle) - stored(held, before.angle);
  if (!twin.quasi_static)
    energy.tissue = energy.tissue + after.grip_force * (twin.opening(before.angle) - twin.opening(after.angle)) +
                    stored(held, before.angle) - stored(held, after.angle);
  for (int i = 0; i < N; ++i) {
    const auto in = [&](const T::State& by, const S& angle) {
      return stored_in(twin.path(i), by.command.contact[i], angle);
    };
    const S was_in = in(after, before.angle[i]);
    energy.tissue = energy.tissue + in(before, before.angle[i]) - was_in;
    if (!twin.quasi_static)
      energy.tissue = energy.tissue - after.contact_moment[i] * (after.angle[i] - before.angle[i]) + was_in -
                      in(after, after.angle[i]);
  }
  if (backward)
    energy.damping = energy.handle + energy.spools + energy.load - energy.friction - energy.tissue +
                     stored_energy(twin, before) - energy.stored;
  return energy;
}

}  // namespace tenodesis

#pragma once
// Several twins of one known layout in lockstep, one in each lane of vector registers.
//
// The step is the twin's own (twin_step.hpp). What differs is the search: a pass over all tendons revises the guess of
// each lane, and is repeated while one lane needs it; a lane that has settled is left as it is, so that what a lane
// computes does not depend on its neighbours. Lanes that need many passes, or whose command is beyond what these steps
// know, are left to the twin's own step.

#include "tenodesis/lanes.hpp"
#include "tenodesis/twin.hpp"

#if defined(__GNUC__)

namespace tenodesis {

/// Calls visit(lanes, single) for every number of a command in lanes and of a single one.
template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_commands(Many& many, One& one, const Visit& visit) {
  const auto pair = [&](auto& a, auto& b) {
    for (std::size_t i = 0; i < sizeof(a) / sizeof(a[0]); ++i) visit(a[i], b[i]);
  };
  const auto pair_vectors = [&](auto& a, auto& b) { visit(a.x, b.x), visit(a.y, b.y), visit(a.z, b.z); };
  pair(many.handle_angle, one.handle_angle);
  pair(many.spool_velocity, one.spool_velocity);
  pair_vectors(many.load.wrench.force, one.load.wrench.force);
  pair_vectors(many.load.wrench.moment, one.load.wrench.moment);
  visit(many.load.grip, one.load.grip);
  visit(many.held.opening, one.held.opening);
  visit(many.held.stiffness, one.held.stiffness);
  visit(many.held.damping, one.held.damping);
  visit(many.weight, one.weight);
  visit(many.sheath_bend, one.sheath_bend);
  pair(many.let_out, one.let_out);
  for (std::size_t i = 0; i < sizeof(many.contact) / sizeof(many.contact[0]); ++i) {
    visit(many.contact[i].angle, one.contact[i].angle);
    visit(many.contact[i].stiffness, one.contact[i].stiffness);
    visit(many.contact[i].damping, one.contact[i].damping);
  }
}

/// The same for a state, noise apart, of twins without currents.
template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_states(Many& many, One& one, const Visit& visit) {
  const auto pair = [&](auto& a, auto& b) {
    for (std::size_t i = 0; i < sizeof(a) / sizeof(a[0]); ++i) visit(a[i], b[i]);
  };
  pair(many.angle, one.angle);
  pair(many.velocity, one.velocity);
  pair(many.moment, one.moment);
  pair(many.band_angle, one.band_angle);
  pair(many.handle_moment, one.handle_moment);
  visit(many.grip_force, one.grip_force);
  pair(many.contact_force, one.contact_force);
  pair(many.contact_moment, one.contact_moment);
  pair_commands(many.command, one.command, visit);
  for (int m = 0; m < One::M; ++m) {
    visit(many.drive[m].speed, one.drive[m].speed);
    visit(many.drive[m].angle, one.drive[m].angle);
    visit(many.drive[m].spool, one.drive[m].spool);
    pair(many.tendon[m].slip.at, one.tendon[m].slip.at);
    pair(many.tendon[m].slide.at, one.tendon[m].slide.at);
    pair(many.tendon[m].slack.at, one.tendon[m].slack.at);
    pair(many.tendon[m].tension.at, one.tendon[m].tension.at);
  }
  pair(many.measured_handle, one.measured_handle);
  pair(many.measured_angle, one.measured_angle);
  pair(many.measured_tension, one.measured_tension);
  pair(many.measured_spool, one.measured_spool);
}

/// The same for the constants of twins, but for those that are no numbers.
template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_twins(Many& many, One& one, const Visit& visit) {
  const auto pair = [&](auto& a, auto& b) {
    for (std::size_t i = 0; i < sizeof(a) / sizeof(a[0]); ++i) visit(a[i], b[i]);
  };
  const auto pair_vectors = [&](auto& a, auto& b) { visit(a.x, b.x), visit(a.y, b.y), visit(a.z, b.z); };
  const auto pair_sensors = [&](auto& a, auto& b) {
    visit(a.gain, b.gain), visit(a.bias, b.bias), visit(a.noise, b.noise);
    visit(a.low, b.low), visit(a.high, b.high), visit(a.resolution, b.resolution);
  };
  for (int i = 0; i < One::N; ++i) {
    auto& a = many.chain.joint[i];
    auto& b = one.chain.joint[i];
    pair_vectors(a.axis, b.axis);
    visit(a.offset, b.offset), visit(a.chord, b.chord), visit(a.length, b.length);
    visit(a.stiffness, b.stiffness), visit(a.share, b.share), visit(a.grip, b.grip);
    visit(many.link[i].mass, one.link[i].mass);
    visit(many.link[i].centre, one.link[i].centre);
    pair_vectors(many.link[i].inertia, one.link[i].inertia);
  }
  for (int m = 0; m < One::M; ++m) {
    pair(many.chain.arm[m], one.chain.arm[m]);
    pair(many.chain.handle_arm[m], one.chain.handle_arm[m]);
    visit(many.tendon[m].rest_tension, one.tendon[m].rest_tension);
    pair(many.tendon[m].stiffness.at, one.tendon[m].stiffness.at);
    for (std::size_t j = 0; j < sizeof(one.passage[m]) / sizeof(one.passage[m][0]); ++j) {
      auto& a = many.passage[m][j];
      auto& b = one.passage[m][j];
      visit(a.coefficient, b.coefficient), visit(a.wrap, b.wrap), visit(a.share, b.share), visit(a.arm, b.arm);
    }
    pair_sensors(many.load_cell[m], one.load_cell[m]);
  }
  pair(many.chain.stiffness, one.chain.stiffness);
  pair(many.chain.pretension, one.chain.pretension);
  visit(many.law.constant, one.law.constant);
  pair(many.reach, one.reach);
  pair(many.damping, one.damping);
  pair(many.stop, one.stop);
  pair(many.stop_stiffness, one.stop_stiffness);
  visit(many.viscous, one.viscous);
  visit(many.sheath_bend_rate, one.sheath_bend_rate);
  pair(many.handle_range, one.handle_range);
  visit(many.hand.stiffness, one.hand.stiffness);
  visit(many.hand.damping, one.hand.damping);
  visit(many.hand.inertia, one.hand.inertia);
  visit(many.drive.spool_radius, one.drive.spool_radius);
  visit(many.drive.speed_limit, one.drive.speed_limit);
  visit(many.drive.acceleration_limit, one.drive.acceleration_limit);
  visit(many.drive.time_constant, one.drive.time_constant);
  visit(many.drive.backlash, one.drive.backlash);
  pair_vectors(many.rig.force, one.rig.force);
  pair_vectors(many.rig.moment, one.rig.moment);
  pair_sensors(many.handle_encoder, one.handle_encoder);
  pair_sensors(many.output_encoder, one.output_encoder);
  pair_sensors(many.motor_encoder, one.motor_encoder);
  visit(many.time_step, one.time_step);
  pair(many.tension_scale, one.tension_scale);
  visit(many.lone_inertia, one.lone_inertia);
}

/// Steps the lanes that run, without their sensors, by the command that the next state has: finite numbers; true in
/// those that moved, the rest of the next state of others is undefined. The hands of all lanes yield, or none does.
template <class T>
[[gnu::always_inline]] inline Flag<typename T::S> step_in_lanes(const T& twin, const Flag<typename T::S>& runs,
                                                                const typename T::State& before,
                                                                typename T::State& next) {
  using S = T::S;
  constexpr int N = T::N, M = T::M;
  const typename T::Command& command = next.command;
  for (int m = 0; m < M; ++m) {
    next.drive[m] =
        advance(twin.drive, before.drive[m], command.spool_velocity[m], before.tendon[m].tension[0], twin.time_step);
    // Only the guess: the rest is what a pass writes.
    next.tendon[m].slide = before.tendon[m].slide;
    next.tendon[m].slack = before.tendon[m].slack;
  }
  Flag<S> moved = twin.prescribed()
                      ? TwinStep<T, N>(twin, command, twin.time_step, before, next).solve_all(runs)
                      : TwinStep<T, T::joints>(twin, command, twin.time_step, before, next).solve_all(runs);
  S sum = next.grip_force;
  for (int g = 0; g < T::joints; ++g) sum = sum + next.angle[g] + next.velocity[g] + next.moment[g];
  for (int m = 0; m < M; ++m) sum = sum + next.drive[m].angle;
  // Not of infinities and NaN.
  const S none = sum - sum;  // NOLINT(misc-redundant-expression)
  moved = moved && none == S(0);
  for (int h = 0; h < N; ++h) moved = moved && !twin.beyond_range(h, next.angle[N + h]);
  for (const auto& tissue : command.contact) moved = moved && abs(tissue.angle) <= S(pi);
  return moved;
}

}  // namespace tenodesis

#endif

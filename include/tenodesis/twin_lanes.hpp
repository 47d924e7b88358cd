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

namespace detail {

template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_rows(Many& many, One& one, const Visit& visit) {
  for (std::size_t i = 0; i < sizeof(many) / sizeof(many[0]); ++i) visit(many[i], one[i]);
}

template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_vectors(Many& many, One& one, const Visit& visit) {
  visit(many.x, one.x), visit(many.y, one.y), visit(many.z, one.z);
}

}  // namespace detail

/// Calls visit(lanes, single) for every number of a command in lanes and of a single one.
template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_commands(Many& many, One& one, const Visit& visit) {
  detail::pair_rows(many.handle_angle, one.handle_angle, visit);
  detail::pair_rows(many.spool_velocity, one.spool_velocity, visit);
  detail::pair_vectors(many.load.wrench.force, one.load.wrench.force, visit);
  detail::pair_vectors(many.load.wrench.moment, one.load.wrench.moment, visit);
  visit(many.load.grip, one.load.grip);
  visit(many.held.opening, one.held.opening);
  visit(many.held.stiffness, one.held.stiffness);
  visit(many.held.damping, one.held.damping);
  visit(many.weight, one.weight);
  visit(many.sheath_bend, one.sheath_bend);
  detail::pair_rows(many.let_out, one.let_out, visit);
  for (std::size_t i = 0; i < sizeof(many.contact) / sizeof(many.contact[0]); ++i) {
    visit(many.contact[i].angle, one.contact[i].angle);
    visit(many.contact[i].stiffness, one.contact[i].stiffness);
    visit(many.contact[i].damping, one.contact[i].damping);
  }
  detail::pair_rows(many.spool_tension, one.spool_tension, visit);
}

/// The same for a state, noise apart, of twins without currents.
template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_states(Many& many, One& one, const Visit& visit) {
  detail::pair_rows(many.angle, one.angle, visit);
  detail::pair_rows(many.velocity, one.velocity, visit);
  detail::pair_rows(many.moment, one.moment, visit);
  detail::pair_rows(many.band_angle, one.band_angle, visit);
  detail::pair_rows(many.handle_moment, one.handle_moment, visit);
  visit(many.grip_force, one.grip_force);
  detail::pair_rows(many.contact_force, one.contact_force, visit);
  detail::pair_rows(many.contact_moment, one.contact_moment, visit);
  pair_commands(many.command, one.command, visit);
  for (int m = 0; m < One::M; ++m) {
    visit(many.drive[m].speed, one.drive[m].speed);
    visit(many.drive[m].angle, one.drive[m].angle);
    visit(many.drive[m].spool, one.drive[m].spool);
    detail::pair_rows(many.tendon[m].slip.at, one.tendon[m].slip.at, visit);
    detail::pair_rows(many.tendon[m].slide.at, one.tendon[m].slide.at, visit);
    detail::pair_rows(many.tendon[m].slack.at, one.tendon[m].slack.at, visit);
    detail::pair_rows(many.tendon[m].tension.at, one.tendon[m].tension.at, visit);
  }
  detail::pair_rows(many.measured_handle, one.measured_handle, visit);
  detail::pair_rows(many.measured_angle, one.measured_angle, visit);
  detail::pair_rows(many.measured_tension, one.measured_tension, visit);
  detail::pair_rows(many.measured_spool, one.measured_spool, visit);
}

/// The same for the constants of twins, but for those that are no numbers.
template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_twins(Many& many, One& one, const Visit& visit) {
  const auto pair_sensors = [&](auto& a, auto& b) {
    visit(a.gain, b.gain), visit(a.bias, b.bias), visit(a.noise, b.noise);
    visit(a.low, b.low), visit(a.high, b.high), visit(a.resolution, b.resolution);
  };
  for (int i = 0; i < One::N; ++i) {
    auto& a = many.chain.joint[i];
    auto& b = one.chain.joint[i];
    detail::pair_vectors(a.axis, b.axis, visit);
    visit(a.offset, b.offset), visit(a.chord, b.chord), visit(a.length, b.length);
    visit(a.stiffness, b.stiffness), visit(a.share, b.share), visit(a.grip, b.grip);
    visit(many.link[i].mass, one.link[i].mass);
    visit(many.link[i].centre, one.link[i].centre);
    detail::pair_vectors(many.link[i].inertia, one.link[i].inertia, visit);
  }
  for (int m = 0; m < One::M; ++m) {
    detail::pair_rows(many.chain.arm[m], one.chain.arm[m], visit);
    detail::pair_rows(many.chain.handle_arm[m], one.chain.handle_arm[m], visit);
    visit(many.tendon[m].rest_tension, one.tendon[m].rest_tension);
    detail::pair_rows(many.tendon[m].stiffness.at, one.tendon[m].stiffness.at, visit);
    for (std::size_t j = 0; j < sizeof(one.passage[m]) / sizeof(one.passage[m][0]); ++j) {
      auto& a = many.passage[m][j];
      auto& b = one.passage[m][j];
      visit(a.coefficient, b.coefficient), visit(a.wrap, b.wrap), visit(a.share, b.share), visit(a.arm, b.arm);
      visit(a.wound, b.wound);
    }
    pair_sensors(many.load_cell[m], one.load_cell[m]);
  }
  detail::pair_rows(many.chain.stiffness, one.chain.stiffness, visit);
  detail::pair_rows(many.chain.pretension, one.chain.pretension, visit);
  visit(many.law.constant, one.law.constant);
  detail::pair_rows(many.reach, one.reach, visit);
  detail::pair_rows(many.damping, one.damping, visit);
  detail::pair_rows(many.stop_low, one.stop_low, visit);
  detail::pair_rows(many.stop_high, one.stop_high, visit);
  detail::pair_rows(many.stop_stiffness, one.stop_stiffness, visit);
  visit(many.viscous, one.viscous);
  visit(many.sheath_bend_rate, one.sheath_bend_rate);
  detail::pair_rows(many.handle_range, one.handle_range, visit);
  visit(many.hand.stiffness, one.hand.stiffness);
  visit(many.hand.damping, one.hand.damping);
  visit(many.hand.inertia, one.hand.inertia);
  visit(many.drive.spool_radius, one.drive.spool_radius);
  visit(many.drive.speed_limit, one.drive.speed_limit);
  visit(many.drive.acceleration_limit, one.drive.acceleration_limit);
  visit(many.drive.time_constant, one.drive.time_constant);
  visit(many.drive.backlash, one.drive.backlash);
  detail::pair_vectors(many.rig.force, one.rig.force, visit);
  detail::pair_vectors(many.rig.moment, one.rig.moment, visit);
  pair_sensors(many.handle_encoder, one.handle_encoder);
  pair_sensors(many.output_encoder, one.output_encoder);
  pair_sensors(many.motor_encoder, one.motor_encoder);
  visit(many.time_step, one.time_step);
  detail::pair_rows(many.tension_scale, one.tension_scale, visit);
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

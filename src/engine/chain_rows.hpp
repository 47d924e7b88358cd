#pragma once
// The columns of commands and the signals of a twin of joints and tendons, in rows of numbers.

#include <cstddef>
#include <utility>
#include <vector>

#include "tenodesis/equilibrium.hpp"

namespace tenodesis::engine {

/// How far a run came.
struct Progress {
  std::size_t steps{};
  Status status{Status::ok};
};

inline constexpr std::size_t wrench_components = 6;

#ifndef TENODESIS_MOST_JOINTS
#define TENODESIS_MOST_JOINTS 24
#endif
#ifndef TENODESIS_MOST_TENDONS
#define TENODESIS_MOST_TENDONS 12
#endif
/// Most joints at a chain's tip, and at its handle, and most tendons; chosen when it is built.
inline constexpr std::size_t most_joints = TENODESIS_MOST_JOINTS, most_tendons = TENODESIS_MOST_TENDONS;
static_assert(most_joints > 16 && most_joints <= 64 && most_tendons >= 12, "sizes that the core is not built for");

/// Sizes of a chain.
struct ChainSizes {
  std::size_t joints{}, handles{}, tendons{};
};

/// A name and the number of its columns.
using Column = std::pair<const char*, std::size_t>;

/// Columns of a row of commands; contact: angle, stiffness and damping of each joint; held: opening, stiffness,
/// damping.
inline std::vector<Column> chain_commands(const ChainSizes& of) {
  return {{"handle_angle", of.handles},
          {"spool_velocity", of.tendons},
          {"wrench", wrench_components},
          {"grip_force", 1},
          {"in_stem_axes", 1},
          {"held", 3},
          {"weight", 1},
          {"sheath_bend", 1},
          {"let_out", of.tendons},
          {"contact", 3 * of.joints},
          {"spool_tension", of.tendons}};
}

/// Signals that a step writes, in order.
inline std::vector<Column> chain_signals(const ChainSizes& of) {
  return {{"output_angle", of.joints},
          {"output_velocity", of.joints},
          {"handle_angle", of.handles},
          {"handle_torque", of.handles},
          {"tension", of.tendons},
          {"distal_tension", of.tendons},
          {"spool_angle", of.tendons},
          {"spool_velocity", of.tendons},
          {"grip_force", 1},
          {"contact_force", of.joints},
          {"measured_handle_angle", of.handles},
          {"measured_output_angle", of.joints},
          {"measured_tension", of.tendons},
          {"measured_spool_angle", of.tendons},
          {"sweeps", 1}};
}

inline std::size_t width_of(const std::vector<Column>& columns) {
  std::size_t sum = 0;
  for (const auto& [name, width] : columns) sum += width;
  return sum;
}

/// The command of a row, whose columns take() gives one after another; holds(column): whether it is not zero.
template <class Command, class Take, class Holds>
[[gnu::always_inline]] inline Command chain_command(const ChainSizes& sizes, const Take& take, const Holds& holds) {
  Command command{};
  for (std::size_t h = 0; h < sizes.handles; ++h) command.handle_angle[h] = take();
  for (std::size_t m = 0; m < sizes.tendons; ++m) command.spool_velocity[m] = take();
  auto& wrench = command.load.wrench;
  for (auto* vector : {&wrench.force, &wrench.moment})
    for (auto* part : {&vector->x, &vector->y, &vector->z}) *part = take();
  command.load.grip = take();
  command.load.in_stem_axes = holds(take());
  for (auto* part : {&command.held.opening, &command.held.stiffness, &command.held.damping}) *part = take();
  command.weight = take();
  command.sheath_bend = take();
  for (std::size_t m = 0; m < sizes.tendons; ++m) command.let_out[m] = take();
  for (std::size_t i = 0; i < sizes.joints; ++i)
    for (auto* part : {&command.contact[i].angle, &command.contact[i].stiffness, &command.contact[i].damping})
      *part = take();
  for (std::size_t m = 0; m < sizes.tendons; ++m) command.spool_tension[m] = take();
  return command;
}

/// Gives put() the signals of a state, in their order.
template <class T, class Put>
[[gnu::always_inline]] inline void store_signals(const T& twin, const typename T::State& s, const ChainSizes& sizes,
                                                 const Put& put) {
  constexpr int N = T::N;
  const auto each = [&](std::size_t count, const auto& value) {
    for (std::size_t k = 0; k < count; ++k) put(value(int(k)));
  };
  each(sizes.joints, [&](int i) { return s.angle[i]; });
  each(sizes.joints, [&](int i) { return s.velocity[i]; });
  each(sizes.handles, [&](int h) { return s.angle[N + h]; });
  each(sizes.handles, [&](int h) { return twin.handle_torque(s, h); });
  each(sizes.tendons, [&](int m) { return s.tendon[m].tension[0]; });
  each(sizes.tendons, [&](int m) { return s.tendon[m].tension[twin.tip_segment(m)]; });
  each(sizes.tendons, [&](int m) { return s.drive[m].spool; });
  each(sizes.tendons, [&](int m) { return s.drive[m].speed; });
  put(s.grip_force);
  each(sizes.joints, [&](int i) { return s.contact_force[i]; });
  each(sizes.handles, [&](int h) { return s.measured_handle[h]; });
  each(sizes.joints, [&](int i) { return s.measured_angle[i]; });
  each(sizes.tendons, [&](int m) { return s.measured_tension[m]; });
  each(sizes.tendons, [&](int m) { return s.measured_spool[m]; });
  put(typename T::S(s.sweeps));
}

}  // namespace tenodesis::engine

#pragma once
// The columns of commands and the signals of a twin, in rows of numbers.

#include <array>
#include <cstddef>
#include <vector>

#include "lane_job.hpp"
#include "tenodesis/axis_twin.hpp"

namespace tenodesis::engine {

/// Columns of a row of commands.
inline constexpr std::array command_names{"handle_angle",
                                          "force",
                                          "radial_force",
                                          "weight",
                                          "agonist_spool_velocity",
                                          "antagonist_spool_velocity",
                                          "sheath_bend",
                                          "agonist_let_out",
                                          "antagonist_let_out",
                                          "contact_angle",
                                          "contact_stiffness",
                                          "contact_damping"};
inline constexpr std::size_t command_count = command_names.size();

/// Signals that a step writes, in order.
inline constexpr std::array signal_names{"measured_handle_angle",
                                         "measured_output_angle",
                                         "measured_tension.agonist",
                                         "measured_tension.antagonist",
                                         "measured_spool_angle.agonist",
                                         "measured_spool_angle.antagonist",
                                         "handle_angle",
                                         "handle_torque",
                                         "output_angle",
                                         "output_velocity",
                                         "tension.agonist",
                                         "tension.antagonist",
                                         "distal_tension.agonist",
                                         "distal_tension.antagonist",
                                         "spool_angle.agonist",
                                         "spool_angle.antagonist",
                                         "spool_velocity.agonist",
                                         "spool_velocity.antagonist",
                                         "force",
                                         "contact_force",
                                         "sweeps"};
inline constexpr std::size_t signal_count = signal_names.size();
/// The first of them are readings.
inline constexpr std::size_t measured_signal_count = 6;

/// Where the columns go in a row of the axis's joint and two tendons (chain_rows.hpp); a force is against x.
inline constexpr std::array<tenodesis_lanes::Column, command_count> axis_columns{
    {{0, 1}, {3, -1}, {5, 1}, {14, 1}, {1, 1}, {2, 1}, {15, 1}, {16, 1}, {17, 1}, {18, 1}, {19, 1}, {20, 1}}};

/// The command of an axis by a row whose columns take() gives one after another.
template <class S, class Take>
[[gnu::always_inline]] inline Command<S> axis_command(const Take& take) {
  Command<S> command{};
  for (S* column : {&command.handle_angle, &command.force, &command.radial_force, &command.weight,
                    &command.spool_velocity[0], &command.spool_velocity[1], &command.sheath_bend, &command.let_out[0],
                    &command.let_out[1], &command.contact.angle, &command.contact.stiffness, &command.contact.damping})
    *column = take();
  return command;
}

/// Commands of successive steps, each a row of those columns that are given; null: of all.
struct Commands {
  const double* rows{};
  const std::vector<std::size_t>* given{};

  Command<double> operator[](std::size_t i) const {
    std::array<double, command_count> scattered{};
    const double* row = rows + i * command_count;
    if (given != nullptr) {
      for (std::size_t c = 0; c < given->size(); ++c) scattered[(*given)[c]] = rows[i * given->size() + c];
      row = scattered.data();
    }
    return axis_command<double>([&] { return *row++; });
  }
};

/// How far a run came.
struct Progress {
  std::size_t steps{};
  Status status{Status::ok};
};

/// The signals of an axis's twin after a step, in the order of their names.
template <class T, class S = T::S>
[[gnu::always_inline]] inline std::array<S, signal_count> signals_of(const T& twin, const typename T::State& state) {
  const auto& tendon = state.tendon;
  const auto& drive = state.drive;
  const int last = twin.tip_segment(0);
  return {state.measured_handle[0],
          state.measured_angle[0],
          state.measured_tension[agonist],
          state.measured_tension[antagonist],
          state.measured_spool[agonist],
          state.measured_spool[antagonist],
          state.angle[1],
          twin.handle_torque(state, 0),
          state.angle[0],
          state.velocity[0],
          tendon[agonist].tension[0],
          tendon[antagonist].tension[0],
          tendon[agonist].tension[last],
          tendon[antagonist].tension[last],
          drive[agonist].spool,
          drive[antagonist].spool,
          drive[agonist].speed,
          drive[antagonist].speed,
          -twin.load_of(state.command).wrench.force.x,
          state.contact_force[0],
          S(state.sweeps)};
}

}  // namespace tenodesis::engine

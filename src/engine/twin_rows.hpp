#pragma once
// The columns of commands and the signals of a twin, in rows of numbers.

#include <array>
#include <cstddef>

#include "tenodesis/twin.hpp"

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

/// Commands of successive steps, each a row of command_count values.
struct Commands {
  const double* rows{};

  Command<double> operator[](std::size_t i) const {
    const double* row = rows + i * command_count;
    return {row[0], row[1], row[2], row[3], {row[4], row[5]}, row[6], {row[7], row[8]}, {row[9], row[10], row[11]}};
  }
};

/// How far a run came.
struct Progress {
  std::size_t steps{};
  Status status{Status::ok};
};

/// The signals of a twin after a step, in the order of their names.
template <class T, class S = T::S>
[[gnu::always_inline]] inline std::array<S, signal_count> signals_of(const T& twin, const Command<S>& command,
                                                                     const typename T::State& state,
                                                                     const Reading<S>& reading) {
  const auto& tendon = state.tendon;
  const auto& drive = state.drive;
  const int last = twin.tip_segment();
  return {reading.handle_angle,
          reading.output_angle,
          reading.tension[agonist],
          reading.tension[antagonist],
          reading.spool_angle[agonist],
          reading.spool_angle[antagonist],
          state.handle_angle,
          twin.handle_torque(command, state),
          state.output_angle,
          state.output_velocity,
          tendon[agonist].tension[0],
          tendon[antagonist].tension[0],
          tendon[agonist].tension[last],
          tendon[antagonist].tension[last],
          drive[agonist].spool,
          drive[antagonist].spool,
          drive[agonist].speed,
          drive[antagonist].speed,
          twin.load_of(command).force,
          state.contact_force,
          S(state.sweeps)};
}

}  // namespace tenodesis::engine

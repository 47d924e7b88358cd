#pragma once
// The columns of an axis's commands in rows of numbers.

#include <array>
#include <cstddef>

#include "tenodesis/axis_twin.hpp"

namespace tenodesis::engine {

/// What an axis is given, its place in a row of the commands of its joint and two tendons (chain_rows.hpp), and by how
/// much; a force is against x.
struct AxisColumn {
  const char* name;
  std::size_t width, place;
  double factor;
};
inline constexpr std::array axis_columns{
    AxisColumn{"handle_angle", 1, 0, 1}, AxisColumn{"spool_velocity", 2, 1, 1}, AxisColumn{"force", 1, 3, -1},
    AxisColumn{"radial_force", 1, 5, 1}, AxisColumn{"weight", 1, 14, 1},        AxisColumn{"sheath_bend", 1, 15, 1},
    AxisColumn{"let_out", 2, 16, 1},     AxisColumn{"contact", 3, 18, 1},       AxisColumn{"spool_tension", 2, 21, 1}};
/// Numbers of a row.
inline constexpr std::size_t axis_command_count = 14;

/// The command of an axis by a row.
inline Command<double> axis_command(const double* row) {
  Command<double> command{};
  for (double* column : {&command.handle_angle, &command.spool_velocity[0], &command.spool_velocity[1], &command.force,
                         &command.radial_force, &command.weight, &command.sheath_bend, &command.let_out[0],
                         &command.let_out[1], &command.contact.angle, &command.contact.stiffness,
                         &command.contact.damping, &command.spool_tension[0], &command.spool_tension[1]})
    *column = *row++;
  return command;
}

}  // namespace tenodesis::engine

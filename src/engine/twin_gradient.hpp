#pragma once
// Expected readings of a twin's sensors, with their derivatives by its parameters.

#include <array>
#include <cstddef>

#include "axis_rows.hpp"
#include "chain_rows.hpp"
#include "lane_job.hpp"
#include "twin_spec.hpp"

namespace tenodesis::engine {

/// Readings that are written: handle encoder, output encoder, both load cells.
inline constexpr int reading_count = 4;

template <class State, class S = State::S>
std::array<S, reading_count> readings_of(const State& state) {
  return {state.measured_handle[0], state.measured_angle[0], state.measured_tension[0], state.measured_tension[1]};
}

/// A twin's parameters and its axis's in dual numbers; some are independent variables, one for each direction.
template <class D>
struct Variables {
  std::array<D, twin_parameter_count> row;
  std::array<D, parameter_count> axis;

  /// Variables count the twin's parameters, then the axis's.
  Variables(const double* parameters, const std::size_t* variables, std::size_t count) {
    for (std::size_t p = 0; p < row.size(); ++p) row[p] = D(parameters[p]);
    for (std::size_t p = 0; p < axis.size(); ++p) axis[p] = D(parameters[row.size() + p]);
    for (std::size_t d = 0; d < count; ++d) {
      const std::size_t p = variables[d];
      (p < row.size() ? row[p] : axis[p - row.size()]) = D::variable(parameters[p], d);
    }
  }
};

/// Steps a twin in dual numbers from rest, and writes its readings with their derivatives.
template <class T, class D = T::S>
Progress differentiate(const T& twin, const std::array<D, twin_parameter_count>& row,
                       const tenodesis_lanes::Gradient& of) {
  auto state = twin.rest(0);
  D spool[2]{};
  D turned[2]{};
  for (std::size_t i = 0; i < of.steps; ++i) {
    const Command<double> given = axis_command(of.commands + i * axis_command_count);
    // What is let out is where the motors stand: their spools follow on the flank that a taut tendon keeps them on.
    for (int t = 0; t < 2; ++t) {
      const D wound(-given.let_out[t]);
      const bool taut = state.tendon[t].tension[0] > D(0);
      const D play = row[backlash] * row[spool_radius];
      spool[t] = taut || i == 0 ? wound : clamp(spool[t], wound, wound + play);
      // A current shows which way its motor turns.
      if (twin.current.on) {
        const D angle = wound / row[spool_radius];
        if (i > 0) state.current[t].angle = state.drive[t].angle - (angle - turned[t]);
        turned[t] = angle;
      }
    }
    Command<D> command{D(given.handle_angle),
                       D(given.force),
                       D(given.radial_force),
                       D(given.weight),
                       {D(given.spool_velocity[0]), D(given.spool_velocity[1])},
                       D(given.sheath_bend),
                       {-spool[0], -spool[1]},
                       {D(given.contact.angle), D(given.contact.stiffness), D(given.contact.damping)}};
    if (of.as_read) command.handle_angle = command.handle_angle - row[handle_encoder_offset];
    const Status status = twin.step(command_of<typename T::Command>(command), state);
    if (status != Status::ok) return {i, status};
    // Beside the samples, which the motors' friction goes by.
    const auto current = state.current;
    twin.read(state);
    state.current = current;
    const auto reading = readings_of(state);
    for (std::size_t k = 0; k < reading.size(); ++k) {
      of.out[k * of.rows * of.steps + i] = value_of(reading[k]);
      for (std::size_t d = 0; d < of.variable_count; ++d)
        of.out[(k * of.rows + 1 + of.first + d) * of.steps + i] = slope_of(reading[k], d);
    }
  }
  return {of.steps, Status::ok};
}

}  // namespace tenodesis::engine

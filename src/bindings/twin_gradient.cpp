// Expected readings of a twin's sensors, and their derivatives by the twin's parameters.

#include <tuple>

#include "engine/any_twin.hpp"
#include "module.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

/// Readings that are written: handle encoder, output encoder, both load cells.
inline constexpr int reading_count = 4;

template <class S>
std::array<S, reading_count> readings_of(const Reading<S>& reading) {
  return {reading.handle_angle, reading.output_angle, reading.tension[0], reading.tension[1]};
}

inline constexpr std::size_t directions_at_once = 4;

/// Steps over commands and writes each reading and its derivatives in the given directions, by reading, 1 + direction
/// and step; the handle is where its encoder reads the command, if it is to be taken off its offset.
///
/// Variables count the twin's parameters, then the axis's.
template <std::size_t N>
Progress differentiate(const TwinSpec& spec, const Commands& commands, std::size_t count, bool as_read,
                       std::span<const std::size_t> variables, std::size_t first, double* out, std::size_t rows) {
  using D = Dual<double, N>;
  std::array<D, twin_parameter_count> row;
  std::array<D, parameter_count> parameters;
  for (std::size_t p = 0; p < row.size(); ++p) row[p] = D(spec.row[p]);
  for (std::size_t p = 0; p < parameters.size(); ++p) parameters[p] = D(spec.axis.parameters[p]);
  for (std::size_t d = 0; d < variables.size(); ++d)
    (variables[d] < row.size() ? row[variables[d]] : parameters[variables[d] - row.size()]).slope[d] = 1;
  return with_twin(spec, parameters, row, [&](const auto& twin) -> Progress {
    auto state = twin.rest(0);
    D spool[2]{};
    D turned[2]{};
    for (std::size_t i = 0; i < count; ++i) {
      const Command<double> given = commands[i];
      // What is let out is where the motors stand: their spools follow on the flank that a taut tendon keeps them on.
      for (int t = 0; t < 2; ++t) {
        const D wound(-given.let_out[t]);
        const bool taut = state.tendon[t].tension[0] > D(0);
        const D play = row[backlash] * row[spool_radius];
        spool[t] = taut || i == 0 ? wound : clamp(spool[t], wound, wound + play);
        // A current shows which way its motor turns.
        const D angle = wound / row[spool_radius];
        if (i > 0) state.current[t].angle = state.drive[t].angle - (angle - turned[t]);
        turned[t] = angle;
      }
      Command<D> command{D(given.handle_angle),
                         D(given.force),
                         D(given.radial_force),
                         D(given.weight),
                         {D(given.spool_velocity[0]), D(given.spool_velocity[1])},
                         D(given.sheath_bend),
                         {-spool[0], -spool[1]},
                         {D(given.contact.angle), D(given.contact.stiffness), D(given.contact.damping)}};
      if (as_read) command.handle_angle = command.handle_angle - row[handle_encoder_offset];
      const Status status = twin.step(command, state);
      if (status != Status::ok) return {i, status};
      const auto reading = readings_of(twin.expected(state));
      for (std::size_t k = 0; k < reading.size(); ++k) {
        out[k * rows * count + i] = reading[k].value;
        for (std::size_t d = 0; d < variables.size(); ++d)
          out[(k * rows + 1 + first + d) * count + i] = reading[k].slope[d];
      }
    }
    return {count, Status::ok};
  });
}

std::tuple<std::size_t, Status> gradient(const TwinSpec& spec, const In<2>& commands, bool as_read,
                                         const std::vector<std::size_t>& variables, const Out<3>& out) {
  const std::size_t count = commands.shape(0);
  const std::size_t rows = 1 + variables.size();
  if (commands.shape(1) != command_count || out.shape(0) != reading_count || out.shape(1) != rows ||
      out.shape(2) != count)
    throw nb::value_error("commands and out do not fit");
  for (const std::size_t variable : variables)
    if (variable >= twin_parameter_count + parameter_count) throw nb::value_error("no such variable");
  const nb::gil_scoped_release release;
  const Commands given{commands.data()};
  const std::span<const std::size_t> all(variables);
  Progress done = {count, Status::ok};
  std::size_t first = 0;
  do {
    const auto some = all.subspan(first, std::min(directions_at_once, all.size() - first));
    done = differentiate<directions_at_once>(spec, given, count, as_read, some, first, out.data(), rows);
    first += directions_at_once;
  } while (first < all.size() && done.status == Status::ok);
  return {done.steps, done.status};
}

}  // namespace

void bind_twin_gradient(nb::module_& m) {
  m.def("twin_gradient", &gradient, "spec"_a, "commands"_a, "as_read"_a, "variables"_a, "out"_a,
        nb::sig("def twin_gradient(spec: TwinSpec, commands: NDArray[numpy.float64], as_read: bool, variables: "
                "Sequence[int], out: NDArray[numpy.float64]) -> tuple[int, Status]"),
        "Write the expected readings of handle encoder, output encoder and both load cells, and their derivatives by "
        "parameters of twin and then axis, by reading, 1 + variable and step. Returns the steps taken and the last "
        "status.");
}

}  // namespace tenodesis::bindings

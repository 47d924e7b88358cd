// Expected readings of a twin's sensors, and their derivatives by the twin's parameters.

#include <algorithm>
#include <tuple>

#include "engine/twin_gradient.hpp"
#include "engine/vectors.hpp"
#include "module.hpp"
#include "tenodesis/packed_dual.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

constexpr std::size_t most = tenodesis_lanes::most_directions;

// Of twins that are not compiled for wide vectors.
#if defined(__GNUC__)
using Number = PackedDual;
#else
using Number = Dual<double, most>;
#endif

std::tuple<std::size_t, Status> gradient(const TwinSpec& spec, const In<2>& commands, bool as_read,
                                         const std::vector<std::size_t>& variables, const Out<3>& out) {
  const std::size_t count = commands.shape(0);
  const std::size_t rows = 1 + variables.size();
  if (commands.shape(1) != axis_command_count || out.shape(0) != reading_count || out.shape(1) != rows ||
      out.shape(2) != count)
    throw nb::value_error("commands and out do not fit");
  for (const std::size_t variable : variables)
    if (variable >= twin_parameter_count + parameter_count) throw nb::value_error("no such variable");
  const nb::gil_scoped_release release;
  std::vector<double> parameters(spec.row.begin(), spec.row.end());
  parameters.insert(parameters.end(), spec.axis.parameters.begin(), spec.axis.parameters.end());
  tenodesis_lanes::Gradient of{int(spec.axis.joint_type),
                               spec.axis.handle_range,
                               parameters.data(),
                               commands.data(),
                               count,
                               as_read,
                               variables.data(),
                               variables.size(),
                               out.data(),
                               rows,
                               0};
  const tenodesis_lanes::Lanes* lanes = steps_in_lanes(spec) && !spec.quasi_static ? lanes_of_processor(8) : nullptr;
  Progress done = {count, Status::ok};
  do {
    of.variables = variables.data() + of.first;
    of.variable_count = std::min(most, variables.size() - of.first);
    if (lanes != nullptr && lanes->differentiate != nullptr) {
      std::int64_t outcome[2];
      lanes->differentiate(of, outcome);
      done = {std::size_t(outcome[0]), Status(outcome[1])};
    } else {
      const Variables<Number> at(of.parameters, of.variables, of.variable_count);
      done = with_twin(spec, at.axis, at.row, [&](const auto& twin) { return differentiate(twin, at.row, of); });
    }
    of.first += most;
  } while (of.first < variables.size() && done.status == Status::ok);
  return {done.steps, done.status};
}

}  // namespace

void bind_twin_gradient(nb::module_& m) {
  m.def("twin_gradient", &gradient, "spec"_a, "commands"_a, "as_read"_a, "variables"_a, "out"_a,
        "Write the expected readings of handle encoder, output encoder and both load cells, and their derivatives by "
        "parameters of twin and then axis, by reading, 1 + variable and step. Returns the steps taken and the last "
        "status.");
}

}  // namespace tenodesis::bindings

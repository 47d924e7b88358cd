// The controller for Python: tick by tick for any plant, or in a closed loop with twins.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "closed_loop.hpp"
#include "modules.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace tenodesis::bindings {
namespace {

using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Stack = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using OutputStack = nb::ndarray<double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Requests = nb::ndarray<const std::uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Modes = nb::ndarray<const std::uint8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;

struct Choices {
  std::uint32_t joint_type, observer, law, actuation, safe_state;
  bool own_clock, homed;
};

ControlParameters parameters_of(const Choices& choices, const std::vector<double>& common, const Rows& axis_rows,
                                const Stack& limits) {
  ControlParameters p{};
  const std::size_t axes = axis_rows.shape(0);
  if (axes < 1 || axes > most_axes || common.size() != common_fields.size() ||
      axis_rows.shape(1) != axis_fields.size() || limits.shape(0) != axes || limits.shape(1) != limit_count ||
      limits.shape(2) != 2)
    throw nb::value_error("shapes do not fit");
  p.size = sizeof(p);
  p.version = TENODESIS_VERSION;
  p.joint_type = choices.joint_type;
  p.axes = static_cast<std::uint32_t>(axes);
  p.observer = choices.observer;
  p.law = choices.law;
  p.actuation = choices.actuation;
  p.safe_state = choices.safe_state;
  p.own_clock = choices.own_clock ? 1 : 0;
  p.homed = choices.homed ? 1 : 0;
  for (std::size_t k = 0; k < common.size(); ++k) p.*common_fields[k].member = common[k];
  for (std::size_t n = 0; n < axes; ++n) {
    AxisParameters& axis = p.axis[n];
    for (std::size_t k = 0; k < axis_fields.size(); ++k) axis.*axis_fields[k].member = axis_rows(n, k);
    for (std::size_t k = 0; k < fault_count; ++k) axis.limit[k] = {limits(n, k, 0), limits(n, k, 1)};
    axis.spool_jump = {limits(n, fault_count, 0), limits(n, fault_count, 1)};
  }
  return p;
}

/// Per axis: control signals and the axis's own faults; then state, homed, homing, faults, first faults.
using Answer = std::tuple<std::vector<std::array<double, control_signal_count>>, std::vector<std::uint32_t>, int, bool,
                          bool, std::uint32_t, std::uint32_t>;

Answer step(AnyController& controller, std::uint64_t time, int request, const Rows& measured) {
  const auto axes = static_cast<std::size_t>(controller.axes());
  if (measured.shape(0) != axes || measured.shape(1) != 5) throw nb::value_error("shapes do not fit");
  AnyInput input{};
  input.time = time;
  input.request = Request(request);
  for (std::size_t n = 0; n < axes; ++n)
    input.axis[n] = {measured(n, 0), {measured(n, 1), measured(n, 2)}, {measured(n, 3), measured(n, 4)}};
  AnyOutput& output = controller.last;
  {
    // A board takes its time to answer.
    const nb::gil_scoped_release release;
    controller.step(input, output);
  }
  Answer answer;
  for (std::size_t n = 0; n < axes; ++n) {
    std::get<0>(answer).push_back(control_signals(controller, n));
    std::get<1>(answer).push_back(output.axis[n].faults);
  }
  std::get<2>(answer) = static_cast<int>(output.state);
  std::get<3>(answer) = output.homed;
  std::get<4>(answer) = output.homing;
  std::get<5>(answer) = output.faults;
  std::get<6>(answer) = output.first_faults;
  return answer;
}

std::tuple<std::size_t, Status> run_controlled(const std::vector<AnyTwin*>& twins, AnyController& controller,
                                               const Stack& commands, int steps_per_tick, double time_step,
                                               std::size_t started, const std::optional<Requests>& requests,
                                               const std::optional<Stack>& values, const std::optional<Modes>& modes,
                                               const OutputStack& out, const OutputStack& control) {
  const std::size_t axes = twins.size();
  const std::size_t count = commands.shape(1);
  const auto fits = [&](const auto& stack, std::size_t columns) {
    return stack.shape(0) == axes && stack.shape(1) == count && stack.shape(2) == columns;
  };
  if (std::cmp_not_equal(axes, controller.axes()) || !fits(commands, command_count) || !fits(out, signal_count) ||
      !fits(control, control_signal_count) || steps_per_tick < 1 || (requests && requests->shape(0) != count) ||
      (values.has_value() != modes.has_value()) ||
      (values && (!fits(*values, tamper_places.size()) || !fits(*modes, tamper_places.size()))))
    throw nb::value_error("shapes do not fit");
  Tampered tampered;
  if (values) tampered = {values->data(), modes->data(), nullptr};
  if (requests) tampered.request = requests->data();
  std::vector<Commands> rows;
  rows.reserve(axes);
  for (std::size_t n = 0; n < axes; ++n) rows.push_back({commands.data() + n * count * command_count});
  const nb::gil_scoped_release release;
  ClosedLoop loop({twins.data(), twins.size()}, controller, steps_per_tick, time_step);
  const Progress progress =
      loop.run(rows, count, started, tampered, [&](std::size_t i, std::size_t n, const Command<double>& command) {
        std::ranges::copy(twins[n]->signals(command), out.data() + (n * count + i) * signal_count);
        std::ranges::copy(control_signals(controller, n), control.data() + (n * count + i) * control_signal_count);
      });
  return {progress.steps, progress.status};
}

template <class Fields>
std::vector<std::string> names_of(const Fields& fields) {
  std::vector<std::string> names;
  names.reserve(fields.size());
  for (const auto& field : fields) names.emplace_back(field.name);
  return names;
}

}  // namespace

void bind_control(nb::module_& m) {
  nb::class_<AnyController>(m, "Controller", "The controller of an instrument, with its state.")
      .def(nb::new_([](std::uint32_t joint_type, std::uint32_t observer, std::uint32_t law, std::uint32_t actuation,
                       std::uint32_t safe_state, bool own_clock, bool homed, const std::vector<double>& common,
                       const Rows& axes, const Stack& limits, bool single_precision) {
             const ControlParameters p = parameters_of(
                 {joint_type, observer, law, actuation, safe_state, own_clock, homed}, common, axes, limits);
             return single_precision ? make_controller<float>(p) : make_controller<double>(p);
           }),
           "joint_type"_a, "observer"_a, "law"_a, "actuation"_a, "safe_state"_a, "own_clock"_a, "homed"_a, "common"_a,
           "axes"_a, "limits"_a, "single_precision"_a)
      .def("step", &step, "time"_a, "request"_a, "measured"_a,
           nb::sig("def step(self, time: int, request: int, measured: NDArray[numpy.float64]) -> "
                   "tuple[list[list[float]], list[int], int, bool, bool, int, int]"),
           "One tick, time in ns: per axis the control signals and its faults; state, homed, homing, faults, first.")
      .def("reset", &AnyController::reset, "As when it was made.")
      .def("watchdog", &AnyController::watchdog, "since_last_step"_a, "Whether the motors must stop, given seconds.")
      .def(
          "counts",
          [](const AnyController& controller, int axis) {
            if (axis < 0 || axis >= controller.axes()) throw nb::value_error("no such axis");
            const tenodesis_counts counts = controller.counts(axis);
            return std::make_tuple(
                std::vector<std::uint32_t>(std::begin(counts.faults), std::end(counts.faults)),
                std::vector<std::uint32_t>(std::begin(counts.bad_samples), std::end(counts.bad_samples)),
                counts.late_ticks);
          },
          "axis"_a, "How often each fault was confirmed, bad samples per sensor, late ticks.")
      .def(
          "records",
          [](const AnyController& controller) {
            std::vector<std::vector<double>> rows;
            for (int k = 0; k < controller.recorder.size(); ++k) {
              const Moment& moment = controller.recorder[k];
              std::vector<double> row{double(moment.time) * 1e-9, double(moment.state), double(moment.faults)};
              for (int n = 0; n < controller.axes(); ++n) {
                const auto& measured = moment.measured[n];
                row.insert(row.end(), {measured.handle_angle, measured.tension[0], measured.tension[1],
                                       measured.spool_angle[0], measured.spool_angle[1], moment.spool_velocity[n][0],
                                       moment.spool_velocity[n][1], moment.output_angle[n]});
              }
              rows.push_back(row);
            }
            return std::make_tuple(rows, controller.recorder.fault_place());
          },
          "The flight recorder: time, state, faults, then per axis measurement, sent velocities, output angle; and "
          "which row is the fault's first.");

  m.def("control_parameters", [] { return names_of(common_fields); }, "Names of the numbers that all axes share.");
  m.def("control_axis_parameters", [] { return names_of(axis_fields); }, "Names of the numbers of an axis.");
  m.def(
      "fault_names",
      [] {
        std::vector<std::string> names;
        names.reserve(fault_count);
        for (int n = 0; n < fault_count; ++n) names.emplace_back(name(Fault(n)));
        return names;
      },
      "Names of the faults, in the order of their bits.");
  m.def(
      "control_signals",
      [] { return std::vector<std::string>(control_signal_names.begin(), control_signal_names.end()); },
      "Names of the signals that a controller adds to a run.");
  m.def(
      "tamper_places", [] { return std::vector<std::string>(tamper_places.begin(), tamper_places.end()); },
      "Places between twin and controller where a fault can be put.");
  m.def("run_controlled", &run_controlled, "twins"_a, "controller"_a, "commands"_a, "steps_per_tick"_a, "time_step"_a,
        "started"_a, "requests"_a.none(), "values"_a.none(), "modes"_a.none(), "out"_a, "control"_a,
        nb::sig("def run_controlled(twins: Sequence[Twin], controller: Controller, commands: NDArray[numpy.float64], "
                "steps_per_tick: int, time_step: float, started: int, requests: NDArray[numpy.uint8] | None, values: "
                "NDArray[numpy.float64] | None, modes: NDArray[numpy.uint8] | None, out: NDArray[numpy.float64], "
                "control: NDArray[numpy.float64]) -> tuple[int, Status]"),
        "Step twins and a controller in one loop over rows of commands, axis by axis; returns steps and why no more.");
}

}  // namespace tenodesis::bindings

// The controller for Python: tick by tick for any plant, or in a closed loop with twins.

#include <nanobind/stl/optional.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "engine/any_controller.hpp"
#include "module.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;
using Requests = Array<const std::uint8_t, 1>;
using Modes = Array<const std::uint8_t, 3>;

struct Choices {
  std::uint32_t joint_type, observer, law, actuation, safe_state, stop, observe;
  bool own_clock, homed;
};

ControlParameters parameters_of(const Choices& choices, const std::vector<double>& common, const In<2>& axis_rows,
                                const In<3>& limits) {
  ControlParameters p{};
  const std::size_t axes = axis_rows.shape(0);
  require(axes >= 1 && axes <= most_axes && common.size() == common_parameters.size() &&
              axis_rows.shape(1) == axis_parameters.size() && limits.shape(0) == axes &&
              limits.shape(1) == limit_count && limits.shape(2) == 2,
          "common, axes and limits do not fit");
  p.size = sizeof(p);
  p.version = TENODESIS_VERSION;
  p.joint_type = choices.joint_type;
  p.axes = static_cast<std::uint32_t>(axes);
  p.observer = choices.observer;
  p.law = choices.law;
  p.actuation = choices.actuation;
  p.safe_state = choices.safe_state;
  p.stop = choices.stop;
  p.observe = choices.observe;
  p.own_clock = choices.own_clock ? 1 : 0;
  p.homed = choices.homed ? 1 : 0;
  for (std::size_t k = 0; k < common.size(); ++k) p.*common_parameters[k].member = common[k];
  for (std::size_t n = 0; n < axes; ++n) {
    AxisParameters& axis = p.axis[n];
    for (std::size_t k = 0; k < axis_parameters.size(); ++k) axis.*axis_parameters[k].member = axis_rows(n, k);
    for (std::size_t k = 0; k < fault_count; ++k) axis.limit[k] = {limits(n, k, 0), limits(n, k, 1)};
    axis.spool_jump = {limits(n, fault_count, 0), limits(n, fault_count, 1)};
  }
  return p;
}

/// A measurement from a row of an array: handle angle, tensions, spool angles.
template <class Row>
Measurement<double> measurement_of(const Row& row, std::size_t n) {
  return {row(n, 0), {row(n, 1), row(n, 2)}, {row(n, 3), row(n, 4)}};
}

/// Control signals by axis, faults by axis; state, homed, homing, faults, first faults, cut_power.
using Answer = std::tuple<NewRows, std::vector<std::uint32_t>, int, bool, bool, std::uint32_t, std::uint32_t, bool>;

Answer step(AnyController& controller, std::uint64_t time, int request, const In<2>& measured) {
  const auto axes = static_cast<std::size_t>(controller.axes());
  require(measured.shape(0) == axes && measured.shape(1) == 5, "measured does not fit the controller's axes");
  AnyInput input{};
  input.time = time;
  input.request = Request(request);
  for (std::size_t n = 0; n < axes; ++n) input.axis[n] = measurement_of(measured, n);
  AnyOutput& output = controller.last;
  {
    // A controller on a board takes its time to answer.
    const nb::gil_scoped_release release;
    controller.step(input, output);
  }
  NewRows signals = new_rows(axes, control_signal_count);
  std::vector<std::uint32_t> faults;
  for (std::size_t n = 0; n < axes; ++n) {
    std::ranges::copy(control_signals(controller, n), &signals(n, 0));
    faults.push_back(output.axis[n].faults);
  }
  return {signals,
          std::move(faults),
          static_cast<int>(output.state),
          output.homed,
          output.homing,
          output.faults,
          output.first_faults,
          output.cut_power};
}

std::tuple<std::vector<std::uint32_t>, std::vector<std::uint32_t>, std::uint32_t> counts(
    const AnyController& controller, int axis) {
  require(axis >= 0 && axis < controller.axes(), "no such axis");
  const tenodesis_counts found = controller.counts(axis);
  return {{std::begin(found.faults), std::end(found.faults)},
          {std::begin(found.bad_samples), std::end(found.bad_samples)},
          found.late_ticks};
}

std::tuple<NewRows, int> records(const AnyController& controller) {
  const auto axes = static_cast<std::size_t>(controller.axes());
  const auto& recorder = controller.recorder;
  NewRows rows = new_rows(static_cast<std::size_t>(recorder.size()), 3 + 8 * axes);
  double* to = rows.data();
  const auto write = [&](auto... values) { ((*to++ = double(values)), ...); };
  for (int k = 0; k < recorder.size(); ++k) {
    const Moment& moment = recorder[k];
    write(double(moment.time) * 1e-9, moment.state, moment.faults);
    for (std::size_t n = 0; n < axes; ++n) {
      const auto& measured = moment.measured[n];
      write(measured.handle_angle, measured.tension[0], measured.tension[1], measured.spool_angle[0],
            measured.spool_angle[1], moment.spool_velocity[n][0], moment.spool_velocity[n][1], moment.output_angle[n]);
    }
  }
  return {rows, recorder.fault_place()};
}

using Row = std::tuple<std::string, std::string, std::string>;

/// Names, units and meanings of a table's rows.
template <class Table>
std::vector<Row> rows_of(const Table& table) {
  std::vector<Row> rows;
  rows.reserve(table.size());
  for (const auto& row : table) rows.emplace_back(row.name, row.unit, row.meaning);
  return rows;
}

std::vector<Row> fault_rows() {
  return {
#define TENODESIS_ROW(name, NAME, unit, meaning) {#name, unit, meaning},
      TENODESIS_FAULT_TABLE(TENODESIS_ROW)
#undef TENODESIS_ROW
  };
}

std::vector<std::tuple<std::string, std::string>> homing_reason_rows() {
  return {
#define TENODESIS_ROW(name, NAME, meaning) {#name, meaning},
      TENODESIS_HOMING_REASON_TABLE(TENODESIS_ROW)
#undef TENODESIS_ROW
  };
}

std::vector<std::tuple<std::string, double, std::string, std::string, std::string>> tuning_rows() {
  return {
#define TENODESIS_ROW(name, value, unit, source, meaning) {#name, tuning::name, unit, source, meaning},
      TENODESIS_TUNING(TENODESIS_ROW)
#undef TENODESIS_ROW
  };
}

#ifdef TENODESIS_TUNABLE
void tune(const std::string& name, double value) {
#define TENODESIS_ROW(constant, preset, unit, source, meaning) \
  if (name == #constant) return void(tuning::constant = value);
  TENODESIS_TUNING(TENODESIS_ROW)
#undef TENODESIS_ROW
  throw nb::key_error(name.c_str());
}
#endif

}  // namespace

void bind_control(nb::module_& m) {
  nb::class_<AnyController>(m, "Controller", "The controller of an instrument, with its state.")
      .def(nb::new_([](std::uint32_t joint_type, std::uint32_t observer, std::uint32_t law, std::uint32_t actuation,
                       std::uint32_t safe_state, std::uint32_t stop, std::uint32_t observe, bool own_clock, bool homed,
                       const std::vector<double>& common, const In<2>& axes, const In<3>& limits,
                       bool single_precision) {
             const ControlParameters p =
                 parameters_of({joint_type, observer, law, actuation, safe_state, stop, observe, own_clock, homed},
                               common, axes, limits);
             return single_precision ? make_controller<float>(p) : make_controller<double>(p);
           }),
           "joint_type"_a, "observer"_a, "law"_a, "actuation"_a, "safe_state"_a, "stop"_a, "observe"_a, "own_clock"_a,
           "homed"_a, "common"_a, "axes"_a, "limits"_a, "single_precision"_a)
      .def("step", &step, "time"_a, "request"_a, "measured"_a,
           "One tick, time in ns: control signals and faults by axis; state, homed, homing, faults, first faults, "
           "cut_power.")
      .def(
          "choose",
          [](AnyController& controller, std::uint32_t law, std::uint32_t actuation) {
            return controller.choose(ControlLaw(law), Actuation(actuation));
          },
          "law"_a, "actuation"_a, "Change law and actuation from the next tick on; whether it can.")
      .def("reset", &AnyController::reset, "Return to the initial state.")
      .def(
          "ask", [](AnyController& controller, int request) { controller.request = Request(request); }, "request"_a,
          "Make a request with the next tick of a closed loop.")
      .def("watchdog", &AnyController::watchdog, "since_last_step"_a,
           "Whether the motors must stop after so many seconds without a tick.")
      .def(
          "parameters",
          [](const AnyController& controller) {
            return nb::bytes(&controller.parameters(), sizeof(link::ControllerParameters));
          },
          "Its parameters as a board takes them: a tenodesis_parameters in float.")
      .def(
          "wound", &AnyController::wound, "axis"_a,
          "How far the motors hold the tip from where it would be with their spools at home, rad; NaN where not known.")
      .def("counts", &counts, "axis"_a,
           "How often each fault was confirmed, bad samples of each sensor, number of late ticks.")
      .def("records", &records,
           "The flight recorder, by record: time, state, faults, then per axis measurement, sent velocities, output "
           "angle; and the row of the fault's first tick, -1 without one.");

  m.attr("INTERFACE_VERSION") = TENODESIS_VERSION;
  m.attr("UNKNOWN_DRIVE_FRICTION") = unknown_drive_friction;
  m.attr("SPOOL_JUMP_UNIT") = TENODESIS_SPOOL_JUMP_UNIT;
  m.def(
      "control_parameters", [] { return rows_of(common_parameters); },
      "Name, unit and meaning of the parameters that all axes share.");
  m.def(
      "control_axis_parameters", [] { return rows_of(axis_parameters); },
      "Name, unit and meaning of an axis's parameters.");
  m.def("tuning", &tuning_rows, "Name, value, unit, source and meaning of the controller's constants.");
#ifdef TENODESIS_TUNABLE
  m.def("tune", &tune, "name"_a, "value"_a, "Change a constant of the controller, before any controller is made.");
#endif
  m.def("homing_reasons", &homing_reason_rows, "Name and meaning of each reason for which homing fails, by number.");
  m.def("faults", &fault_rows, "Name, unit of the threshold and meaning of each fault, in the order of their bits.");
  m.def(
      "control_signals", [] { return list_of(control_signal_names); },
      "Names of the signals that a controller adds to a run.");
  m.def(
      "fault_injection_points", [] { return list_of(fault_injection_points); },
      "Points between instrument and controller where a fault can be injected.");
}

}  // namespace tenodesis::bindings

// The live loop for Python: made, started, commanded and watched; nothing here is on the way of a tick.

#include "runtime/runtime.hpp"

#include <nanobind/stl/pair.h>

#include <numbers>
#include <utility>

#include "chain_spec.hpp"
#include "module.hpp"
#include "runtime/mailbox_device.hpp"
#include "runtime/twin_device.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;
using runtime::TwinDevice, runtime::MailboxDevice, runtime::OrderKind, runtime::Problem, runtime::RingReader,
    runtime::Runtime;

constexpr double nanoseconds = 1e9;

std::uint64_t in_nanoseconds(double seconds) {
  require(all_finite(seconds) && seconds >= 0 && seconds < 1e6, "a time must be at least 0 s and below 1e6 s");
  return static_cast<std::uint64_t>(seconds * nanoseconds);
}

Runtime* make_runtime(runtime::Device& device, AnyController& controller,
                      const std::vector<std::array<std::size_t, 3>>& axes, const std::vector<std::size_t>& motors,
                      const std::string& ring, std::size_t ring_capacity, const std::vector<double>& handle_range,
                      double period, double speed, double late_bound, double motor_speed, double motor_tension,
                      bool real_time) {
  const runtime::Sizes& sizes = device.sizes;
  require(std::cmp_equal(axes.size(), controller.axes()) && handle_range.size() == sizes.handles,
          "device, controller and handle ranges differ in the number of axes or joints");
  require(device.commands.width() <= runtime::most_commands, "the device takes too many commands");
  require(all_finite(period, speed, late_bound, motor_speed, motor_tension) && period > 0 && period < 1 &&
              (speed == 0 || (speed >= 0.1 && speed <= 100)) && late_bound > 0 && motor_speed > 0 &&
              ring_capacity >= 16 && ring_capacity <= (1u << 24),
          "period, speed, late_bound, motor_speed or ring_capacity is out of range");
  runtime::Settings settings;
  settings.period = period;
  settings.speed = speed;
  settings.late_bound = late_bound;
  settings.motor_speed = motor_speed;
  settings.motor_tension = motor_tension;
  settings.real_time = real_time;
  settings.handle_range = handle_range;
  settings.motors = motors;
  std::vector<char> taken(sizes.tendons);
  const auto take = [&](std::size_t tendon) {
    require(tendon < sizes.tendons && !taken[tendon], "a tendon is not there, or has two motors");
    taken[tendon] = 1;
  };
  for (const auto& [handle, agonist_at, antagonist_at] : axes) {
    require(handle < sizes.handles, "an axis names a joint of the handle that is not there");
    take(agonist_at);
    take(antagonist_at);
    settings.axes.push_back({handle, agonist_at, antagonist_at});
  }
  for (const std::size_t tendon : motors) take(tendon);
  return new Runtime(device, controller, settings, ring, ring_capacity);
}

// A value that is not finite may be injected into a signal, as the reading of a broken sensor.
bool give_order(Runtime& loop, int kind, int a, int b, std::size_t at, double value, std::uint64_t ticks) {
  require(kind >= 0 && kind < runtime::order_count, "there is no such order");
  const bool injects = OrderKind(kind) == OrderKind::inject_fault;
  require(!injects || (a >= 0 && std::cmp_less(a, injection_point_count) && b >= 0 &&
                       b <= static_cast<int>(InjectionMode::swap)),
          "there is no such point or mode of fault injection");
  require(std::isfinite(value) || (injects && a != static_cast<int>(at_tick)), "value must be finite");
  return loop.order({OrderKind(kind), a, b, at, value, ticks});
}

std::size_t play(Runtime& loop, const In<2>& rows) {
  const runtime::Columns& columns = loop.commands();
  require(rows.shape(1) == columns.width(), "rows must have the device's columns of commands");
  // A motion is played only if all of it can be.
  require(std::all_of(rows.data(), rows.data() + rows.size(), [](double value) { return std::isfinite(value); }),
          "rows must be finite");
  const auto [first, count] = columns.find("contact");
  for (std::size_t k = 0; k < rows.shape(0); ++k)
    for (std::size_t c = first; c < first + count; c += runtime::contact_columns)
      require(std::abs(rows(k, c)) < std::numbers::pi && rows(k, c + 2) >= 0,
              "tissue must lie within half a turn, and its damping must be 0 or more");
  for (std::size_t k = 0; k < rows.shape(0); ++k) {
    runtime::PlayedTick tick{};
    std::copy_n(rows.data() + k * columns.width(), columns.width(), tick.begin());
    if (!loop.play(tick)) return k;
  }
  return rows.shape(0);
}

/// Median, 99th percentile and worst, s, and their number.
std::tuple<double, double, double, std::uint64_t> summary(const runtime::Durations& durations) {
  return {double(durations.percentile(0.5)) / nanoseconds, double(durations.percentile(0.99)) / nanoseconds,
          double(durations.worst()) / nanoseconds, durations.count()};
}

void post(MailboxDevice& box, std::uint64_t time, const std::vector<double>& handle_angle,
          const std::vector<double>& tension, const std::vector<double>& spool_angle,
          const std::vector<double>& output_angle) {
  const runtime::Sizes& sizes = box.sizes;
  require(handle_angle.size() == sizes.handles && tension.size() == sizes.tendons &&
              spool_angle.size() == sizes.tendons && output_angle.size() == sizes.joints,
          "what is measured does not fit the device's joints and tendons");
  MailboxDevice::Sensed sensed;
  sensed.time = time;
  std::ranges::copy(handle_angle, sensed.handle_angle);
  std::ranges::copy(tension, sensed.tension);
  std::ranges::copy(spool_angle, sensed.spool_angle);
  std::ranges::copy(output_angle, sensed.output_angle);
  box.post(sensed);
}

std::tuple<bool, std::vector<double>, std::vector<double>> take(MailboxDevice& box, double timeout) {
  const std::uint64_t most = in_nanoseconds(timeout);
  MailboxDevice::Answer answer;
  bool came = false;
  {
    const nb::gil_scoped_release release;
    came = box.take(answer, most);
  }
  const std::size_t count = came ? box.sizes.tendons : 0;
  return {came, {answer.speed, answer.speed + count}, {answer.tension, answer.tension + count}};
}

std::vector<std::pair<std::string, std::size_t>> named(const runtime::Columns& columns) {
  return {columns.all().begin(), columns.all().end()};
}

std::tuple<std::size_t, std::uint64_t, std::uint64_t> read(const RingReader& ring, std::uint64_t cursor,
                                                           const Out<2>& out) {
  require(out.shape(1) == ring.columns(), "out does not fit the columns of a record");
  std::uint64_t lost = 0;
  std::size_t count = 0;
  {
    const nb::gil_scoped_release release;
    count = ring.read(cursor, out.shape(0), out.data(), lost);
  }
  return {count, cursor, lost};
}

}  // namespace

void bind_runtime(nb::module_& m) {
  nb::enum_<Problem>(m, "LoopProblem", nb::is_arithmetic(),
                     "Why the live loop stopped the motors, or refused an order.")
      .value("NONE", Problem::none)
      .value("TIP_LOST", Problem::tip_lost, "the load was more than the tip can hold, and was not applied")
      .value("LATE", Problem::late, "a tick came later than the bound")
      .value("NO_MEASUREMENT", Problem::no_measurement, "no measurement for longer than the bound")
      .value("OPERATOR_GONE", Problem::operator_gone, "the operator's lease ran out")
      .value("IN_TISSUE", Problem::in_tissue, "the tip is where tissue is to be")
      .value("OVERLOAD", Problem::overload, "a motor without a controller was to wind a tendon beyond the limit")
      .value("NOT_A_NUMBER", Problem::not_a_number, "a sensor of such a motor had no value");
  nb::enum_<OrderKind>(m, "Order", nb::is_arithmetic(), "What the live loop can be ordered to do.")
      .value("REQUEST", OrderKind::request, "a: a request to the controller")
      .value("LAW", OrderKind::law, "a: law, b: actuation")
      .value("HAND", OrderKind::hand, "at: joint of the handle; value: its angle, rad")
      .value("LOAD", OrderKind::load, "at: column of a row of commands; value")
      .value("MOTOR", OrderKind::motor, "at: tendon that no controller commands; value: angle of its spool, rad")
      .value("SPEED", OrderKind::speed, "value: simulated over real time; 0: as fast as possible")
      .value("INJECT_FAULT", OrderKind::inject_fault, "a: point, b: mode, at: axis, value, ticks: for how long")
      .value("DROP", OrderKind::drop, "the rest of a played motion");

  nb::class_<runtime::Device>(m, "LiveDevice", "What the live loop reads and writes, in named columns.")
      .def_prop_ro(
          "commands", [](const runtime::Device& device) { return named(device.commands); },
          "Names and widths of a command's columns.")
      .def_prop_ro(
          "signals", [](const runtime::Device& device) { return named(device.signals); },
          "Names and widths of the signals' columns.");
  nb::class_<TwinDevice, runtime::Device>(m, "TwinDevice", "A digital twin, which each write advances by a tick.")
      .def(nb::init<AnyTwin&, double, int>(), "twin"_a, "time_step"_a, "steps_per_tick"_a, nb::keep_alive<1, 2>());
  nb::class_<MailboxDevice, runtime::Device>(m, "MailboxDevice", "A device that another thread serves.")
      .def(nb::new_([](std::size_t joints, std::size_t handles, std::size_t tendons, bool distal_encoder,
                       bool holds_tension) {
             require(
                 joints <= runtime::most_joints && handles <= runtime::most_joints && tendons <= runtime::most_tendons,
                 "there are too many joints or tendons");
             return new MailboxDevice({joints, handles, tendons}, distal_encoder, holds_tension);
           }),
           "joints"_a, "handles"_a, "tendons"_a, "distal_encoder"_a, "holds_tension"_a, nb::rv_policy::take_ownership)
      .def("post", &post, "time"_a, "handle_angle"_a, "tension"_a, "spool_angle"_a, "output_angle"_a,
           "Post a measurement: its time in ns, and its values by joint or tendon.")
      .def("take", &take, "timeout"_a,
           "Whether an answer to the last post came within so many seconds, and its spool velocities by tendon.")
      .def_prop_ro("power_cut", &MailboxDevice::power_cut,
                   "Whether a motor does not obey, and all must lose their supply.")
      .def_prop_ro("stopped", &MailboxDevice::stopped, "Whether the loop has ended.");

  nb::class_<Runtime>(m, "Runtime", "The live loop, a thread of its own.")
      .def(nb::new_(&make_runtime), "device"_a, "controller"_a, "axes"_a, "motors"_a, "ring"_a, "ring_capacity"_a,
           "handle_range"_a, "period"_a, "speed"_a, "late_bound"_a, "motor_speed"_a, "motor_tension"_a, "real_time"_a,
           nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>(), nb::rv_policy::take_ownership,
           "axes: joint of the handle, agonist and antagonist of each of the controller's; motors: tendons without a "
           "controller.")
      .def("start", &Runtime::start, "Begin.")
      .def("finish", &Runtime::finish, nb::call_guard<nb::gil_scoped_release>(), "End, motors at rest.")
      .def("run_ticks", &Runtime::run_ticks, "count"_a, nb::call_guard<nb::gil_scoped_release>(),
           "Take so many ticks as fast as possible, on this thread.")
      .def("order", &give_order, "kind"_a, "a"_a = 0, "b"_a = 0, "at"_a = 0, "value"_a = 0.0, "ticks"_a = 0,
           "Give an order, by number of its kind; false where too many orders wait already.")
      .def("play", &play, "rows"_a,
           "Queue ticks of a motion, rows of the device's commands; returns how many were taken.")
      .def(
          "lease", [](Runtime& loop, double seconds) { loop.lease(in_nanoseconds(seconds)); }, "seconds"_a,
          "The operator is present for so many seconds more; 0: is absent.")
      .def("stop", &Runtime::stop,
           "Motors to zero with the next tick, until a request releases them, or they return home.")
      .def("forget_timing", &Runtime::forget_timing, "Reset the timing with the next tick.")
      .def_prop_ro("pending_rows", &Runtime::pending_ticks, "Ticks of a motion that are still to be played.")
      .def_prop_ro("running", &Runtime::running)
      .def_prop_ro("ticks", &Runtime::ticks)
      .def_prop_ro("late", &Runtime::late)
      .def_prop_ro("missed", &Runtime::missed)
      .def_prop_ro("speed", &Runtime::speed)
      .def("wound", &Runtime::wound, "axis"_a,
           "How far the motors hold the tip from where it would be with their spools at home, rad.")
      .def_prop_ro("problem", &Runtime::problem, "The first problem since the motors were released.")
      .def_prop_ro("refused", &Runtime::refused)
      .def_prop_ro(
          "compute", [](const Runtime& loop) { return summary(loop.compute()); },
          "Time of a tick: median, 99th percentile, worst, s, and number of ticks.")
      .def_prop_ro(
          "control", [](const Runtime& loop) { return summary(loop.control()); }, "The same of the controller alone.")
      .def_prop_ro(
          "lateness", [](const Runtime& loop) { return summary(loop.lateness()); },
          "The same of the delay with which ticks began.");

  nb::class_<RingReader>(m, "RingReader", "Reads a live loop's records, from any process.")
      .def(nb::init<const std::string&>(), "path"_a)
      .def("read", &read, "cursor"_a, "out"_a,
           "Copy records from the cursor on; returns how many, the cursor after them, and how many were lost.")
      .def_prop_ro("columns", &RingReader::columns)
      .def_prop_ro("capacity", &RingReader::capacity)
      .def_prop_ro("written", &RingReader::written, "Number of records written so far.")
      .def_prop_ro(
          "silence",
          [](const RingReader& ring) {
            const std::uint64_t alive = ring.alive(), time = runtime::now();
            return time > alive ? double(time - alive) / nanoseconds : 0.0;
          },
          "Time since the loop last reported that it is alive, s.");

  m.def("tick_columns", [] { return list_of(runtime::tick_columns); }, "Columns of a record before its commands.");
}

}  // namespace tenodesis::bindings

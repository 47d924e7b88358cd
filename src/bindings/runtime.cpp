// The live loop for Python: made, started, commanded and watched; nothing here is on the way of a tick.

#include "runtime/runtime.hpp"

#include <numbers>
#include <utility>

#include "module.hpp"
#include "runtime/mailbox_device.hpp"
#include "runtime/twin_device.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;
using runtime::MailboxDevice, runtime::OrderKind, runtime::Problem, runtime::RingReader, runtime::Runtime,
    runtime::TwinDevice;

constexpr double nanoseconds = 1e9;

std::uint64_t in_nanoseconds(double seconds) {
  require(all_finite(seconds) && seconds >= 0 && seconds < 1e6, "a time must be at least 0 s and below 1e6 s");
  return static_cast<std::uint64_t>(seconds * nanoseconds);
}

Runtime* make_runtime(runtime::Device& device, AnyController& controller, const std::string& ring,
                      std::size_t ring_capacity, const std::vector<double>& handle_range, double period, double speed,
                      double late_bound, bool real_time) {
  require(device.axes() == controller.axes() && handle_range.size() == std::size_t(device.axes()),
          "device, controller and handle ranges differ in the number of axes");
  require(all_finite(period, speed, late_bound) && period > 0 && period < 1 &&
              (speed == 0 || (speed >= 0.1 && speed <= 100)) && late_bound > 0 && ring_capacity >= 16 &&
              ring_capacity <= (1u << 24),
          "period, speed, late_bound or ring_capacity is out of range");
  runtime::Settings settings;
  settings.period = period;
  settings.speed = speed;
  settings.late_bound = late_bound;
  settings.real_time = real_time;
  std::ranges::copy(handle_range, settings.handle_range);
  return new Runtime(device, controller, settings, ring, ring_capacity);
}

// A value that is not finite may be injected into a signal, as the reading of a broken sensor.
bool give_order(Runtime& loop, int kind, int a, int b, int axis, double value, std::uint64_t ticks) {
  require(kind >= 0 && kind < runtime::order_count, "there is no such order");
  const bool injects = OrderKind(kind) == OrderKind::inject_fault;
  require(!injects || (a >= 0 && std::cmp_less(a, injection_point_count) && b >= 0 &&
                       b <= static_cast<int>(InjectionMode::swap)),
          "there is no such point or mode of fault injection");
  require(std::isfinite(value) || (injects && a != static_cast<int>(at_tick)), "value must be finite");
  return loop.order({OrderKind(kind), a, b, axis, value, ticks});
}

std::size_t play(Runtime& loop, const In<3>& rows) {
  require(rows.shape(1) <= most_axes && (rows.shape(2) == 3 || rows.shape(2) == 6),
          "rows must have the shape (n, axes, 3) or (n, axes, 6)");
  // A motion is played only if all of it can be.
  require(std::all_of(rows.data(), rows.data() + rows.size(), [](double value) { return std::isfinite(value); }),
          "rows must be finite");
  if (rows.shape(2) == 6)
    for (std::size_t k = 0; k < rows.shape(0); ++k)
      for (std::size_t n = 0; n < rows.shape(1); ++n)
        require(std::abs(rows(k, n, 3)) < std::numbers::pi && rows(k, n, 5) >= 0,
                "tissue must lie within half a turn, and its damping must be 0 or more");
  for (std::size_t k = 0; k < rows.shape(0); ++k) {
    runtime::PlayedTick tick;
    for (std::size_t n = 0; n < rows.shape(1); ++n) {
      tick.bench[n] = {rows(k, n, 0), rows(k, n, 1), rows(k, n, 2), {}};
      if (rows.shape(2) == 6) tick.bench[n].contact = {rows(k, n, 3), rows(k, n, 4), rows(k, n, 5)};
    }
    if (!loop.play(tick)) return k;
  }
  return rows.shape(0);
}

/// Median, 99th percentile and worst, s, and their number.
std::tuple<double, double, double, std::uint64_t> summary(const runtime::Durations& durations) {
  return {double(durations.percentile(0.5)) / nanoseconds, double(durations.percentile(0.99)) / nanoseconds,
          double(durations.worst()) / nanoseconds, durations.count()};
}

void post(MailboxDevice& box, std::uint64_t time, const In<2>& measured) {
  const auto axes = static_cast<std::size_t>(box.axes());
  require(measured.shape(0) == axes && measured.shape(1) == 6, "measured does not fit the device's axes");
  MailboxDevice::Sensed sensed;
  sensed.input.time = time;
  for (std::size_t n = 0; n < axes; ++n) {
    sensed.input.axis[n] = {measured(n, 0), {measured(n, 1), measured(n, 2)}, {measured(n, 3), measured(n, 4)}};
    sensed.output_angle[n] = measured(n, 5);
  }
  box.post(sensed);
}

std::tuple<bool, NewRows> take(MailboxDevice& box, double timeout) {
  const std::uint64_t most = in_nanoseconds(timeout);
  MailboxDevice::Answer answer;
  bool came = false;
  {
    const nb::gil_scoped_release release;
    came = box.take(answer, most);
  }
  NewRows speed = new_rows(static_cast<std::size_t>(box.axes()), 2);
  if (came) std::copy_n(&answer.speed[0][0], speed.size(), speed.data());
  return {came, speed};
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
      .value("IN_TISSUE", Problem::in_tissue, "the tip is where tissue is to be");
  nb::enum_<OrderKind>(m, "Order", nb::is_arithmetic(), "What the live loop can be ordered to do.")
      .value("REQUEST", OrderKind::request, "a: a request to the controller")
      .value("LAW", OrderKind::law, "a: law, b: actuation")
      .value("HAND", OrderKind::hand, "value: handle angle, rad; axis")
      .value("FORCE", OrderKind::force, "value: force at the tip, N; axis")
      .value("RADIAL", OrderKind::radial, "value: radial force at the tip, N; axis")
      .value("SPEED", OrderKind::speed, "value: simulated over real time; 0: as fast as possible")
      .value("INJECT_FAULT", OrderKind::inject_fault, "a: point, b: mode, axis, value, ticks: for how long")
      .value("DROP", OrderKind::drop, "the rest of a played motion");

  const nb::class_<runtime::Device> device(m, "LiveDevice", "What the live loop reads and writes.");
  nb::class_<TwinDevice, runtime::Device>(m, "TwinDevice", "The twins of an instrument's axes as a device.")
      .def(nb::init<std::vector<AnyTwin*>, double, int>(), "twins"_a, "time_step"_a, "steps_per_tick"_a,
           nb::keep_alive<1, 2>());
  nb::class_<MailboxDevice, runtime::Device>(m, "MailboxDevice", "A device that another thread serves.")
      .def(nb::init<int>(), "axes"_a)
      .def("post", &post, "time"_a, "measured"_a,
           nb::sig("def post(self, time: int, measured: NDArray[numpy.float64]) -> None"),
           "Post a measurement: its time in ns; per axis handle angle, tensions, spool angles, output angle.")
      .def("take", &take, "timeout"_a, nb::sig("def take(self, timeout: float) -> tuple[bool, NDArray[numpy.float64]]"),
           "Whether an answer to the last post came within so many seconds, and its spool velocities by axis.")
      .def_prop_ro("power_cut", &MailboxDevice::power_cut,
                   "Whether a motor does not obey, and all must lose their supply.")
      .def_prop_ro("stopped", &MailboxDevice::stopped, "Whether the loop has ended.");

  nb::class_<Runtime>(m, "Runtime", "The live loop, a thread of its own.")
      .def(nb::new_(&make_runtime), "device"_a, "controller"_a, "ring"_a, "ring_capacity"_a, "handle_range"_a,
           "period"_a, "speed"_a, "late_bound"_a, "real_time"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>(),
           nb::rv_policy::take_ownership)
      .def("start", &Runtime::start, "Begin.")
      .def("finish", &Runtime::finish, nb::call_guard<nb::gil_scoped_release>(), "End, motors at rest.")
      .def("run_ticks", &Runtime::run_ticks, "count"_a, nb::call_guard<nb::gil_scoped_release>(),
           "Take so many ticks as fast as possible, on this thread.")
      .def("order", &give_order, "kind"_a, "a"_a = 0, "b"_a = 0, "axis"_a = 0, "value"_a = 0.0, "ticks"_a = 0,
           "Give an order, by number of its kind; false where too many orders wait already.")
      .def("play", &play, "rows"_a, nb::sig("def play(self, rows: NDArray[numpy.float64]) -> int"),
           "Queue ticks of a motion, per axis handle angle, force, radial force, and with tissue its angle, stiffness "
           "and damping; returns how many were taken.")
      .def(
          "lease", [](Runtime& loop, double seconds) { loop.lease(in_nanoseconds(seconds)); }, "seconds"_a,
          "The operator is present for so many seconds more; 0: is absent.")
      .def("stop", &Runtime::stop, "Motors to zero with the next tick, until a request releases them.")
      .def("forget_timing", &Runtime::forget_timing, "Reset the timing with the next tick.")
      .def_prop_ro("pending_rows", &Runtime::pending_ticks, "Ticks of a motion that are still to be played.")
      .def_prop_ro("running", &Runtime::running)
      .def_prop_ro("ticks", &Runtime::ticks)
      .def_prop_ro("late", &Runtime::late)
      .def_prop_ro("missed", &Runtime::missed)
      .def_prop_ro("speed", &Runtime::speed)
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
           nb::sig("def read(self, cursor: int, out: NDArray[numpy.float64]) -> tuple[int, int, int]"),
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

  m.def("tick_columns", [] { return list_of(runtime::tick_columns); }, "Columns of a record before its axes'.");
  m.def("bench_columns", [] { return list_of(runtime::bench_columns); }, "Columns of an axis before its signals.");
}

}  // namespace tenodesis::bindings

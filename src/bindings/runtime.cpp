// The live loop for Python: made, started, commanded and watched; nothing here is on the way of a tick.

#include "../runtime/runtime.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "../runtime/mailbox_device.hpp"
#include "../runtime/twin_device.hpp"
#include "modules.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace tenodesis::bindings {
namespace {

using runtime::MailboxDevice, runtime::OrderKind, runtime::RingReader, runtime::Row, runtime::Runtime,
    runtime::Settings, runtime::TwinDevice;
using Stack = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

constexpr double nanoseconds = 1e9;

std::uint64_t in_nanoseconds(double seconds) {
  if (!all_finite(seconds) || seconds < 0 || seconds >= 1e6)
    throw nb::value_error("a time is 0 s or more, and below 1e6 s");
  return static_cast<std::uint64_t>(seconds * nanoseconds);
}

Runtime* make_runtime(runtime::Device& device, AnyController& controller, const std::string& ring,
                      std::size_t ring_capacity, const std::vector<double>& handle_range, double period, double speed,
                      double late_bound, bool real_time) {
  if (device.axes() != controller.axes() || handle_range.size() != std::size_t(device.axes()))
    throw nb::value_error("device and controller differ in their axes");
  if (!all_finite(period, speed, late_bound) || period <= 0 || period >= 1 || speed < 0 || (speed > 0 && speed < 0.1) ||
      speed > 100 || late_bound <= 0 || ring_capacity < 16 || ring_capacity > (1u << 24))
    throw nb::value_error("a period, speed, bound or capacity is out of range");
  Settings settings;
  settings.period = period;
  settings.speed = speed;
  settings.late_bound = late_bound;
  settings.real_time = real_time;
  std::ranges::copy(handle_range, settings.handle_range);
  return new Runtime(device, controller, settings, ring, ring_capacity);
}

bool give_order(Runtime& loop, int kind, int a, int b, int axis, double value, std::uint64_t ticks) {
  if (kind < 0 || kind > static_cast<int>(OrderKind::drop) || !std::isfinite(value))
    throw nb::value_error("there is no such order, or its value is not finite");
  const bool tampers = OrderKind(kind) == OrderKind::tamper;
  if (tampers && (a < 0 || std::size_t(a) >= tamper_places.size())) throw nb::value_error("no such place");
  return loop.order({OrderKind(kind), a, b, axis, value, ticks});
}

// A value that is not a number is how a sensor is made to say so.
bool tamper_not_a_number(Runtime& loop, int place, int axis, std::uint64_t ticks) {
  if (place < 0 || std::size_t(place) + 1 >= tamper_places.size()) throw nb::value_error("no such place");
  return loop.order({OrderKind::tamper, place, static_cast<int>(Tampering::set), axis,
                     std::numeric_limits<double>::quiet_NaN(), ticks});
}

std::size_t play(Runtime& loop, const Stack& rows) {
  if (rows.shape(1) > most_axes || rows.shape(2) != 3) throw nb::value_error("shapes do not fit");
  // All of them first: of a motion that cannot be played nothing is.
  for (std::size_t k = 0; k < rows.shape(0); ++k)
    for (std::size_t n = 0; n < rows.shape(1); ++n)
      if (!all_finite(rows(k, n, 0), rows(k, n, 1), rows(k, n, 2))) throw nb::value_error("a command is not finite");
  std::size_t taken = 0;
  for (; taken < rows.shape(0); ++taken) {
    Row row;
    for (std::size_t n = 0; n < rows.shape(1); ++n)
      row.bench[n] = {rows(taken, n, 0), rows(taken, n, 1), rows(taken, n, 2)};
    if (!loop.play(row)) break;
  }
  return taken;
}

/// p50, p99 and worst, s, and how many there were.
std::tuple<double, double, double, std::uint64_t> told(const runtime::Durations& durations) {
  return {double(durations.percentile(0.5)) / nanoseconds, double(durations.percentile(0.99)) / nanoseconds,
          double(durations.worst()) / nanoseconds, durations.count()};
}

void post(MailboxDevice& box, std::uint64_t time, const Rows& measured) {
  const auto axes = static_cast<std::size_t>(box.axes());
  if (measured.shape(0) != axes || measured.shape(1) != 6) throw nb::value_error("shapes do not fit");
  MailboxDevice::Sensed sensed;
  sensed.input.time = time;
  for (std::size_t n = 0; n < axes; ++n) {
    sensed.input.axis[n] = {measured(n, 0), {measured(n, 1), measured(n, 2)}, {measured(n, 3), measured(n, 4)}};
    sensed.output_angle[n] = measured(n, 5);
  }
  box.post(sensed);
}

std::tuple<bool, std::vector<std::vector<double>>> take(MailboxDevice& box, double timeout) {
  const std::uint64_t most = in_nanoseconds(timeout);
  MailboxDevice::Answer answer;
  bool came = false;
  {
    const nb::gil_scoped_release release;
    came = box.take(answer, most);
  }
  std::vector<std::vector<double>> speed;
  speed.reserve(static_cast<std::size_t>(box.axes()));
  for (int n = 0; n < box.axes(); ++n)
    speed.push_back({came ? answer.speed[n][0] : 0.0, came ? answer.speed[n][1] : 0.0});
  return {came, speed};
}

std::tuple<std::size_t, std::uint64_t, std::uint64_t> read(const RingReader& ring, std::uint64_t cursor,
                                                           const Output& out) {
  if (out.shape(1) != ring.columns()) throw nb::value_error("shapes do not fit");
  std::uint64_t lost = 0;
  std::size_t count = 0;
  {
    const nb::gil_scoped_release release;
    count = ring.read(cursor, out.shape(0), out.data(), lost);
  }
  return {count, cursor, lost};
}

template <class Names>
std::vector<std::string> names_of(const Names& names) {
  return {names.begin(), names.end()};
}

}  // namespace

void bind_runtime(nb::module_& m) {
  const nb::class_<runtime::Device> device(m, "LiveDevice", "What the live loop reads and writes.");
  nb::class_<TwinDevice, runtime::Device>(m, "TwinDevice", "The twins of an instrument's axes as a device.")
      .def(nb::init<std::vector<AnyTwin*>, double, int>(), "twins"_a, "time_step"_a, "steps_per_tick"_a,
           nb::keep_alive<1, 2>());
  nb::class_<MailboxDevice, runtime::Device>(m, "MailboxDevice", "A device that another thread serves.")
      .def(nb::init<int>(), "axes"_a)
      .def("post", &post, "time"_a, "measured"_a,
           nb::sig("def post(self, time: int, measured: NDArray[numpy.float64]) -> None"),
           "Hand over a measurement: its time in ns; per axis handle angle, tensions, spool angles, output angle.")
      .def("take", &take, "timeout"_a, "The spool velocities that answer the last post, and whether any came in time.")
      .def_prop_ro("stopped", &MailboxDevice::stopped, "Whether the loop has ended.");

  nb::class_<Runtime>(m, "Runtime", "The live loop, a thread of its own.")
      .def(nb::new_(&make_runtime), "device"_a, "controller"_a, "ring"_a, "ring_capacity"_a, "handle_range"_a,
           "period"_a, "speed"_a, "late_bound"_a, "real_time"_a, nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>(),
           nb::rv_policy::take_ownership)
      .def("start", &Runtime::start, "Begin.")
      .def("finish", &Runtime::finish, nb::call_guard<nb::gil_scoped_release>(), "End, motors at rest.")
      .def("run_ticks", &Runtime::run_ticks, "count"_a, nb::call_guard<nb::gil_scoped_release>(),
           "Take so many ticks as fast as they go, here.")
      .def("order", &give_order, "kind"_a, "a"_a = 0, "b"_a = 0, "axis"_a = 0, "value"_a = 0.0, "ticks"_a = 0,
           "Ask something of it; false where too much is asked already.")
      .def("tamper_not_a_number", &tamper_not_a_number, "place"_a, "axis"_a, "ticks"_a, "Make a sensor say no number.")
      .def("play", &play, "rows"_a, nb::sig("def play(self, rows: NDArray[numpy.float64]) -> int"),
           "Queue ticks of a played motion, per axis handle angle, force, radial force; returns how many were taken.")
      .def(
          "lease", [](Runtime& loop, double seconds) { loop.lease(in_nanoseconds(seconds)); }, "seconds"_a,
          "The operator is there for so long; 0: there is none.")
      .def("stop", &Runtime::stop, "Motors to zero with the next tick, until a request sets them free.")
      .def("forget_timing", &Runtime::forget_timing, "Count anew from the next tick on.")
      .def_prop_ro("pending_rows", &Runtime::pending_rows)
      .def_prop_ro("running", &Runtime::running)
      .def_prop_ro("ticks", &Runtime::ticks)
      .def_prop_ro("late", &Runtime::late)
      .def_prop_ro("missed", &Runtime::missed)
      .def_prop_ro("speed", &Runtime::speed)
      .def_prop_ro("problem", [](const Runtime& loop) { return static_cast<int>(loop.problem()); })
      .def_prop_ro("refused", &Runtime::refused)
      .def_prop_ro(
          "compute", [](const Runtime& loop) { return told(loop.compute()); },
          "Of a tick: p50, p99, worst, s, and how many.")
      .def_prop_ro(
          "control", [](const Runtime& loop) { return told(loop.control()); }, "Of the controller alone.")
      .def_prop_ro("lateness", [](const Runtime& loop) { return told(loop.lateness()); }, "By which ticks began late.");

  nb::class_<RingReader>(m, "RingReader", "Reads a loop's records from any process.")
      .def(nb::init<const std::string&>(), "path"_a)
      .def("read", &read, "cursor"_a, "out"_a,
           nb::sig("def read(self, cursor: int, out: NDArray[numpy.float64]) -> tuple[int, int, int]"),
           "Copy records from the cursor on; returns how many, the cursor after them, and how many were lost.")
      .def_prop_ro("columns", &RingReader::columns)
      .def_prop_ro("capacity", &RingReader::capacity)
      .def_prop_ro("written", &RingReader::written, "Records there have been.")
      .def_prop_ro(
          "silence",
          [](const RingReader& ring) {
            const std::uint64_t alive = ring.alive(), time = runtime::now();
            return time > alive ? double(time - alive) / nanoseconds : 0.0;
          },
          "Time since the loop last said that it lives, s.");

  m.def("tick_columns", [] { return names_of(runtime::tick_columns); }, "Columns of a record before its axes'.");
  m.def("bench_columns", [] { return names_of(runtime::bench_columns); }, "Columns of an axis before its signals.");
}

}  // namespace tenodesis::bindings

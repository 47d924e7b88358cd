// Boards with the controller on them, for Python: opened, asked what they are, and watched.

#include "../runtime/serial_controller.hpp"
#include "../runtime/streamed_controller.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "modules.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace tenodesis::bindings {
namespace {

using runtime::BoardController, runtime::Image, runtime::SerialController, runtime::StreamedController;
using runtime::StreamedDevice;

bool is_wait(double seconds) { return seconds > 0 && seconds < 1e4; }

template <class Kind>
Kind* make(int descriptor, const nb::bytes& parameters, double timeout, double connect_timeout, int repetitions,
           std::uint32_t silence) {
  Image image{};
  if (parameters.size() != image.size() || !is_wait(timeout) || !is_wait(connect_timeout) || repetitions < 0 ||
      repetitions > 1000)
    throw nb::value_error("no link is made of these numbers");
  std::memcpy(image.data(), parameters.c_str(), image.size());
  const nb::gil_scoped_release release;
  return new Kind(descriptor, image, {timeout, connect_timeout, repetitions, silence});
}

std::optional<std::tuple<std::uint64_t, std::vector<std::vector<double>>>> hear(StreamedDevice& device,
                                                                                double timeout) {
  if (!is_wait(timeout)) throw nb::value_error("no time to wait");
  AnyInput input{};
  {
    const nb::gil_scoped_release release;
    if (!device.read(input, static_cast<std::uint64_t>(timeout * 1e9))) return std::nullopt;
  }
  std::vector<std::vector<double>> rows;
  for (int n = 0; n < device.axes(); ++n) {
    const auto& from = input.axis[n];
    rows.push_back({from.handle_angle, from.tension[0], from.tension[1], from.spool_angle[0], from.spool_angle[1]});
  }
  return std::make_tuple(input.time, rows);
}

void rest(StreamedDevice& device) { device.write({}, {}); }

}  // namespace

void bind_serial(nb::module_& m) {
  nb::class_<BoardController, AnyController>(m, "BoardController", "A controller on a board behind a line of bytes.")
      .def("reset", &BoardController::reset, nb::call_guard<nb::gil_scoped_release>(),
           "As when it was made; sets the link up anew where it was lost.")
      .def("close", &BoardController::close, nb::call_guard<nb::gil_scoped_release>(),
           "Tell the board to stop, and let go of the line.")
      .def(
          "problem",
          [](const BoardController& own) {
            return std::make_tuple(std::string(runtime::link_problem_names[static_cast<std::size_t>(own.problem())]),
                                   own.why());
          },
          "Name of what has gone wrong with the link, empty where nothing has, and what is known of it.")
      .def(
          "board",
          [](const BoardController& own) {
            const link::Board& board = own.board();
            return std::make_tuple(std::string(board.name), link::protocol_version, board.interface_version,
                                   board.clock, board.sensors != 0);
          },
          "Name, version of protocol and interface, clock in Hz, whether it has sensors.")
      .def(
          "link_counts",
          [](const BoardController& own) {
            const runtime::LinkCounts& counts = own.link_counts();
            return std::make_tuple(counts.answers, counts.repetitions, counts.damaged, counts.stale,
                                   counts.board_damaged);
          },
          "Answers, repeated questions, damaged frames, stale answers, frames that the board dropped.")
      .def("busy", &BoardController::busy, "Ticks of the board's clock that the tick before the last took.")
      .def("stopped", &BoardController::stopped, "Whether the board has stopped and waits to be enabled.");
  nb::class_<SerialController, BoardController>(m, "SerialController", "One that is sent a measurement per tick.")
      .def(nb::new_(&make<SerialController>), "descriptor"_a, "parameters"_a, "timeout"_a, "connect_timeout"_a,
           "repetitions"_a, "silence"_a);
  nb::class_<StreamedController, BoardController>(m, "StreamedController",
                                                  "One that measures by itself and sends its ticks.")
      .def(nb::new_(&make<StreamedController>), "descriptor"_a, "parameters"_a, "timeout"_a, "connect_timeout"_a,
           "repetitions"_a, "silence"_a);
  nb::class_<StreamedDevice, runtime::Device>(m, "StreamedDevice", "Sensors and motors of such a board.")
      .def(nb::init<StreamedController&>(), "board"_a, nb::keep_alive<1, 2>())
      .def("read", &hear, "timeout"_a,
           "Its next tick, without a loop: time in ns; per axis handle angle, tensions, spool angles.")
      .def("rest", &rest, "Tell the board that motors are to rest, and that somebody listens.")
      .def("overtaken", &StreamedDevice::overtaken, "Ticks that were lost before the last.");
}

}  // namespace tenodesis::bindings

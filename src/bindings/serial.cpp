// Boards with the controller on them, for Python: opened, asked what they are, and watched.

#include "../runtime/serial_controller.hpp"

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include "modules.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace tenodesis::bindings {
namespace {

using runtime::Image, runtime::SerialController;

bool is_wait(double seconds) { return seconds > 0 && seconds < 1e4; }

SerialController* make_serial(int descriptor, const nb::bytes& parameters, double timeout, double connect_timeout,
                              int repetitions, std::uint32_t silence) {
  Image image{};
  if (parameters.size() != image.size() || !is_wait(timeout) || !is_wait(connect_timeout) || repetitions < 0 ||
      repetitions > 1000)
    throw nb::value_error("no link is made of these numbers");
  std::memcpy(image.data(), parameters.c_str(), image.size());
  const nb::gil_scoped_release release;
  return new SerialController(descriptor, image, {timeout, connect_timeout, repetitions, silence});
}

}  // namespace

void bind_serial(nb::module_& m) {
  nb::class_<SerialController, AnyController>(m, "SerialController", "A controller on a board behind a line of bytes.")
      .def(nb::new_(&make_serial), "descriptor"_a, "parameters"_a, "timeout"_a, "connect_timeout"_a, "repetitions"_a,
           "silence"_a)
      .def("reset", &SerialController::reset, nb::call_guard<nb::gil_scoped_release>(),
           "As when it was made; sets the link up anew where it was lost.")
      .def("close", &SerialController::close, nb::call_guard<nb::gil_scoped_release>(),
           "Tell the board to stop, and let go of the line.")
      .def(
          "problem",
          [](const SerialController& own) {
            return std::make_tuple(std::string(runtime::link_problem_names[static_cast<std::size_t>(own.problem())]),
                                   own.why());
          },
          "Name of what has gone wrong with the link, empty where nothing has, and what is known of it.")
      .def(
          "board",
          [](const SerialController& own) {
            const link::Board& board = own.board();
            return std::make_tuple(std::string(board.name), link::protocol_version, board.interface_version,
                                   board.clock, board.sensors != 0);
          },
          "Name, version of protocol and interface, clock in Hz, whether it has sensors.")
      .def(
          "link_counts",
          [](const SerialController& own) {
            const runtime::LinkCounts& counts = own.link_counts();
            return std::make_tuple(counts.answers, counts.repetitions, counts.damaged, counts.stale,
                                   counts.board_damaged);
          },
          "Answers, repeated questions, damaged frames, stale answers, frames that the board dropped.")
      .def("busy", &SerialController::busy, "Ticks of the board's clock that the frame before the last took.")
      .def("stopped", &SerialController::stopped, "Whether the board has stopped and waits to be enabled.");
}

}  // namespace tenodesis::bindings

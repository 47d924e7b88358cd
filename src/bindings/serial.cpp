// Controllers on boards for Python.

#include "runtime/serial_controller.hpp"
#include "runtime/streamed_controller.hpp"

#include <nanobind/stl/optional.h>

#include "module.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

using runtime::BoardController, runtime::LinkProblem, runtime::SerialController, runtime::StreamedController,
    runtime::StreamedDevice;

bool is_wait(double seconds) { return seconds > 0 && seconds < 1e4; }

template <class Kind>
Kind* make(int descriptor, const nb::bytes& parameters, double timeout, double connect_timeout, int repetitions,
           std::uint32_t silence) {
  link::ControllerParameters image{};
  require(parameters.size() == sizeof image, "parameters have another size than the board takes");
  std::memcpy(&image, parameters.c_str(), sizeof image);
  require(is_wait(timeout) && is_wait(connect_timeout) && repetitions >= 0 && repetitions <= 1000,
          "timeout, connect_timeout or repetitions is out of range");
  const nb::gil_scoped_release release;
  return new Kind(descriptor, image, {timeout, connect_timeout, repetitions, silence});
}

std::optional<std::tuple<std::uint64_t, NewRows>> read(StreamedDevice& device, double timeout) {
  require(is_wait(timeout), "timeout is out of range");
  std::uint64_t time = 0;
  {
    const nb::gil_scoped_release release;
    if (!device.read(time, static_cast<std::uint64_t>(timeout * 1e9))) return std::nullopt;
  }
  NewRows rows = new_rows(device.sizes.handles, 5);
  double* to = rows.data();
  for (std::size_t n = 0; n < device.sizes.handles; ++n) {
    const Measurement<double> from = device.reading({n, 2 * n, 2 * n + 1});
    for (const double value :
         {from.handle_angle, from.tension[0], from.tension[1], from.spool_angle[0], from.spool_angle[1]})
      *to++ = value;
  }
  return std::make_tuple(time, rows);
}

void rest(StreamedDevice& device) {
  const double speed[runtime::most_tendons]{};
  device.write(speed);
}

}  // namespace

void bind_serial(nb::module_& m) {
  nb::enum_<LinkProblem>(m, "LinkProblem", nb::is_arithmetic(), "What has gone wrong with a board.")
      .value("NONE", LinkProblem::none)
      .value("LINK_LOST", LinkProblem::link_lost, "no answer in time")
      .value("LINK_CLOSED", LinkProblem::link_closed, "the other end of the line was closed")
      .value("DAMAGED_FRAMES", LinkProblem::damaged_frames, "too many in a row")
      .value("STALE_ANSWERS", LinkProblem::stale_answers, "only answers to earlier questions")
      .value("WRONG_VERSION", LinkProblem::wrong_version, "another version of the protocol, or of the C interface")
      .value("BOARD_RESTARTED", LinkProblem::board_restarted, "the board does not know the session")
      .value("REFUSED", LinkProblem::refused, "the board refused a question")
      .value("WRONG_TICK", LinkProblem::wrong_tick, "the answer is another tick's")
      .value("BAD_ANSWER", LinkProblem::bad_answer, "of a wrong size, or with an unknown state")
      .value("NOT_A_NUMBER", LinkProblem::not_a_number, "a velocity is not a number")
      .value("BEYOND_LIMIT", LinkProblem::beyond_limit, "a velocity is above the instrument's speed limit");

  nb::class_<BoardController, AnyController>(m, "BoardController", "A controller on a board behind a line of bytes.")
      .def("reset", &BoardController::reset, nb::call_guard<nb::gil_scoped_release>(),
           "Return to the initial state; sets the link up again where it was lost.")
      .def("close", &BoardController::close, nb::call_guard<nb::gil_scoped_release>(),
           "Stop the board and close the line.")
      .def(
          "problem", [](const BoardController& own) { return std::make_tuple(own.problem(), own.why()); },
          "The link's problem and its description.")
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
  nb::class_<SerialController, BoardController>(m, "SerialController", "A board that is sent a measurement per tick.")
      .def(nb::new_(&make<SerialController>), "descriptor"_a, "parameters"_a, "timeout"_a, "connect_timeout"_a,
           "repetitions"_a, "silence"_a);
  nb::class_<StreamedController, BoardController>(m, "StreamedController",
                                                  "A board that measures by itself and sends its ticks.")
      .def(nb::new_(&make<StreamedController>), "descriptor"_a, "parameters"_a, "timeout"_a, "connect_timeout"_a,
           "repetitions"_a, "silence"_a);
  nb::class_<StreamedDevice, runtime::Device>(m, "StreamedDevice", "Sensors and motors of such a board.")
      .def(nb::init<StreamedController&>(), "board"_a, nb::keep_alive<1, 2>())
      .def("read", &read, "timeout"_a,
           "Its next tick, without a loop: time in ns; per axis handle angle, tensions, spool angles.")
      .def("rest", &rest, "Have the motors rest, and keep the board streaming.")
      .def("overtaken", &StreamedDevice::overtaken, "Ticks that were lost before the last.");
}

}  // namespace tenodesis::bindings

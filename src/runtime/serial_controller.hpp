#pragma once
// A controller on a board: each tick is sent to it over a line, and its answer waited for.

#include "board_controller.hpp"

namespace tenodesis::runtime {

class SerialController final : public BoardController {
 public:
  SerialController(int descriptor, const link::ControllerParameters& parameters, const LinkSettings& settings)
      : BoardController(descriptor, parameters, settings) {}

  void step(const AnyInput& input, AnyOutput& output) override {
    const std::scoped_lock guard(mutex());
    const bool clears = input.request == Request::clear;
    const bool linked = link().problem() == LinkProblem::none || (clears && link().resume(parameters()));
    if (!linked || !tick(input, output)) stop(output);
    record(input, output);
  }

  void reset() override {
    const std::scoped_lock guard(mutex());
    if (link().problem() != LinkProblem::none)
      link().start(parameters());
    else
      link().ask(link::Type::reset, nullptr, 0, link::Type::done, 0);
    forget_session();
  }

 private:
  bool tick(const AnyInput& input, AnyOutput& output) {
    link::Step step{input.time, static_cast<std::uint32_t>(input.request), choice(), {}};
    for (int n = 0; n < axes(); ++n) step.axis[n] = measurement_as<link::Measured>(input.axis[n]);
    if (!link().ask(link::Type::step, &step, link::size_with<link::Step>(axes()), link::Type::output,
                    link::size_with<link::Output>(axes())))
      return false;
    const auto answer = link().message<link::Output>();
    if (answer.tick.time != step.time)
      return link().fail(LinkProblem::wrong_tick, "the board answered the tick of " + std::to_string(step.time) +
                                                      " ns as that of " + std::to_string(answer.tick.time) + " ns");
    if (!is_sound(answer)) return false;
    put(answer, output);
    return true;
  }
};

}  // namespace tenodesis::runtime

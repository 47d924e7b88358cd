#pragma once
// In place of a controller where no joint has a law: it only says whether the motors may move.

#include "engine/any_controller.hpp"

namespace tenodesis::runtime {

class MotorSwitch final : public engine::AnyController {
 public:
  MotorSwitch() { last.homed = true; }

  int axes() const override { return 0; }
  const link::ControllerParameters& parameters() const override { return parameters_; }
  tenodesis_counts counts(int /*axis*/) const override { return {}; }
  Phase phase(int /*axis*/) const override { return Phase::rest; }
  bool watchdog(double /*since_last_step*/) const override { return false; }

  void reset() override {
    forget();
    last.homed = true;
  }

  void step(const engine::AnyInput& input, engine::AnyOutput& output) override {
    switch (input.request) {
      case Request::enable:
      case Request::resume:
        output.state = OperatingState::enabled;
        break;
      case Request::pause:
        if (output.state == OperatingState::enabled) output.state = OperatingState::paused;
        break;
      case Request::disable:
        output.state = OperatingState::disabled;
        break;
      default:
        break;
    }
  }

 private:
  link::ControllerParameters parameters_{};
};

}  // namespace tenodesis::runtime

#pragma once
// Twins and a controller in a closed loop, with the faults that are injected between them.

#include <cmath>
#include <limits>
#include <span>

#include "any_controller.hpp"
#include "any_twin.hpp"

namespace tenodesis::engine {

/// What is injected into each step of a run; null pointers where nothing is.
struct InjectedSteps {
  const double* value{};           ///< axes x steps x points
  const unsigned char* mode{};     ///< an InjectionMode for each value
  const unsigned char* request{};  ///< per step; a Request other than none replaces the one that waits

  Injection at(std::size_t axis, std::size_t step, std::size_t count, std::size_t point) const {
    if (mode == nullptr) return {};
    const std::size_t k = (axis * count + step) * injection_point_count + point;
    return {InjectionMode(mode[k]), value[k]};
  }
};

class ClosedLoop {
 public:
  /// relay: time in which one in the motors' supply opens once the controller demands it, s; infinite: there is none.
  ClosedLoop(std::span<AnyTwin* const> twins, AnyController& controller, int steps_per_tick, double time_step,
             double relay = std::numeric_limits<double>::infinity())
      : twins_(twins), controller_(controller), steps_per_tick_(steps_per_tick), time_step_(time_step), relay_(relay) {}

  /// Runs over count steps, of which `started` came before; calls keep(step, axis, command) after each. Returns how far
  /// it came.
  template <class Keep>
  Progress run(std::span<const Commands> commands, std::size_t count, std::size_t started,
               const InjectedSteps& injected, const Keep& keep) {
    Progress progress;
    for (std::size_t i = 0; i < count; ++i) {
      if (injected.request != nullptr && injected.request[i] != 0) controller_.request = Request(injected.request[i]);
      if ((started + i) % std::size_t(steps_per_tick_) == 0) tick(i, count, started, injected);
      // Without ticks the motors are stopped by their own watchdogs.
      const bool silent = controller_.injector.silent() > 0 && controller_.watchdog(controller_.injector.silent());
      double& demanded = controller_.cut_demanded;
      demanded = controller_.last.cut_power ? demanded + time_step_ : 0.0;
      const bool still = silent || demanded > relay_;
      for (std::size_t n = 0; n < twins_.size(); ++n) {
        Command<double> command = commands[n][i];
        const auto velocity =
            controller_.injector.pass_pair(n, at_velocity, controller_.last.axis[n].spool_velocity,
                                           [&](std::size_t point) { return injected.at(n, i, count, point); });
        for (std::size_t k = 0; k < 2; ++k) command.spool_velocity[k] = still ? 0.0 : velocity[k];
        progress.status = twins_[n]->step(command);
        if (progress.status != Status::ok) return progress;
        keep(i, n, command);
      }
      progress.steps = i + 1;
    }
    return progress;
  }

 private:
  void tick(std::size_t i, std::size_t count, std::size_t started, const InjectedSteps& injected) {
    double time = double(started + i + 1) * time_step_ * 1e9;
    if (!controller_.injector.pass_tick(injected.at(0, i, count, at_tick), time)) return;
    AnyInput input{};
    input.time = static_cast<std::uint64_t>(std::llround(time));
    input.request = controller_.request;
    controller_.request = Request::none;
    for (std::size_t n = 0; n < twins_.size(); ++n) {
      const auto read = measurement_as<Measurement<double>>(twins_[n]->reading());
      input.axis[n] =
          controller_.injector.pass(n, read, [&](std::size_t point) { return injected.at(n, i, count, point); });
    }
    controller_.step(input, controller_.last);
  }

  std::span<AnyTwin* const> twins_;
  AnyController& controller_;
  int steps_per_tick_;
  double time_step_;
  double relay_;
};

}  // namespace tenodesis::engine

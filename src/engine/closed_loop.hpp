#pragma once
// A plant and a controller in a closed loop, with the faults that are injected between them.

#include <cmath>
#include <limits>
#include <vector>

#include "any_controller.hpp"
#include "chain_rows.hpp"

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

/// Velocities of an axis's two spools, rad/s.
using SpoolVelocities = std::array<double, 2>;

/// Plant: reading(axis), a Measurement, and step(i, velocities by axis), the Status of its i-th step.
template <class Plant>
class ClosedLoop {
 public:
  /// relay: time in which one in the motors' supply opens once the controller demands it, s; infinite: there is none.
  ClosedLoop(Plant& plant, AnyController& controller, int steps_per_tick, double time_step,
             double relay = std::numeric_limits<double>::infinity())
      : plant_(plant),
        controller_(controller),
        steps_per_tick_(steps_per_tick),
        time_step_(time_step),
        relay_(relay),
        velocity_(std::size_t(controller.axes())) {}

  /// Runs over count steps, of which `started` came before; calls keep(step) after each. Returns how far it came.
  template <class Keep>
  Progress run(std::size_t count, std::size_t started, const InjectedSteps& injected, const Keep& keep) {
    Progress progress;
    for (std::size_t i = 0; i < count; ++i) {
      if (injected.request != nullptr && injected.request[i] != 0) controller_.request = Request(injected.request[i]);
      if ((started + i) % std::size_t(steps_per_tick_) == 0) tick(i, count, started, injected);
      // Without ticks the motors are stopped by their own watchdogs.
      const bool silent = controller_.injector.silent() > 0 && controller_.watchdog(controller_.injector.silent());
      double& demanded = controller_.cut_demanded;
      demanded = controller_.last.cut_power ? demanded + time_step_ : 0.0;
      const bool still = silent || demanded > relay_;
      for (std::size_t n = 0; n < velocity_.size(); ++n) {
        velocity_[n] =
            controller_.injector.pass_pair(n, at_velocity, controller_.last.axis[n].spool_velocity,
                                           [&](std::size_t point) { return injected.at(n, i, count, point); });
        if (still) velocity_[n] = {};
      }
      progress.status = plant_.step(i, velocity_.data());
      if (progress.status != Status::ok) return progress;
      keep(i);
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
    for (std::size_t n = 0; n < velocity_.size(); ++n)
      input.axis[n] = controller_.injector.pass(n, plant_.reading(n),
                                                [&](std::size_t point) { return injected.at(n, i, count, point); });
    controller_.step(input, controller_.last);
  }

  Plant& plant_;
  AnyController& controller_;
  int steps_per_tick_;
  double time_step_;
  double relay_;
  std::vector<SpoolVelocities> velocity_;
};

}  // namespace tenodesis::engine

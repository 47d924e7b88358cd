#pragma once
// Twins and a controller in one loop: what the sensors say goes to the controller, what it answers to the drives; and
// faults put between them.

#include <cmath>
#include <span>

#include "any_controller.hpp"
#include "any_twin.hpp"

namespace tenodesis::bindings {

/// Places between twin and controller that can be tampered with, per axis; the tick's are read from the first axis.
inline constexpr std::array tamper_places{
    "handle_angle",           "tension.agonist",        "tension.antagonist",        "spool_angle.agonist",
    "spool_angle.antagonist", "spool_velocity.agonist", "spool_velocity.antagonist", "tick"};

static_assert(sizeof(AnyController::passed) == sizeof(double) * most_axes * tamper_places.size());

enum class Tampering : unsigned char {
  none,
  add,   ///< a value to a signal; seconds to the tick's time
  set,   ///< a signal to a value, NaN included
  hold,  ///< the last value that went through; of a tick: none
};

/// Signals that the controller adds to a run, per axis.
inline constexpr std::array control_signal_names{"estimated_output_angle",
                                                 "estimated_output_angle_std",
                                                 "estimated_force",
                                                 "estimated_force_std",
                                                 "friction_scale",
                                                 "friction_scale_std",
                                                 "commanded_spool_velocity.agonist",
                                                 "commanded_spool_velocity.antagonist",
                                                 "operating_state",
                                                 "faults",
                                                 "phase"};
inline constexpr std::size_t control_signal_count = control_signal_names.size();

struct Tampered {
  const double* value{};           // axes x steps x places; none without
  const unsigned char* mode{};     // as value
  const unsigned char* request{};  // steps
};

/// Runs a loop; control holds a row of control_signal_count per step and axis. Returns how far it came.
class ClosedLoop {
 public:
  ClosedLoop(std::span<AnyTwin* const> twins, AnyController& controller, int steps_per_tick, double time_step)
      : twins_(twins), controller_(controller), steps_per_tick_(steps_per_tick), time_step_(time_step) {}

  template <class Keep>
  Progress run(std::span<const Commands> commands, std::size_t count, std::size_t started, const Tampered& tampered,
               const Keep& keep) {
    Progress progress;
    for (std::size_t i = 0; i < count; ++i) {
      if (tampered.request != nullptr && tampered.request[i] != 0) controller_.asked = Request(tampered.request[i]);
      if ((started + i) % std::size_t(steps_per_tick_) == 0) tick(i, count, started, tampered);
      for (std::size_t n = 0; n < twins_.size(); ++n) {
        Command<double> command = commands[n][i];
        for (int k = 0; k < 2; ++k)
          command.spool_velocity[k] =
              pass(tampered, n, i, count, 5 + std::size_t(k), controller_.last.axis[n].spool_velocity[k]);
        progress.status = twins_[n]->step(command);
        if (progress.status != Status::ok) return progress;
        keep(i, n, command);
      }
      progress.steps = i + 1;
    }
    return progress;
  }

 private:
  double pass(const Tampered& tampered, std::size_t axis, std::size_t step, std::size_t count, std::size_t place,
              double value) {
    double& kept = controller_.passed[axis][place];
    if (tampered.mode == nullptr) return kept = value;
    const std::size_t at = (axis * count + step) * tamper_places.size() + place;
    switch (Tampering(tampered.mode[at])) {
      case Tampering::add:
        return kept = value + tampered.value[at];
      case Tampering::set:
        return kept = tampered.value[at];
      case Tampering::hold:
        return kept;
      case Tampering::none:
        break;
    }
    return kept = value;
  }

  void tick(std::size_t i, std::size_t count, std::size_t started, const Tampered& tampered) {
    constexpr std::size_t tick_place = tamper_places.size() - 1;
    double time = double(started + i + 1) * time_step_;
    if (tampered.mode != nullptr) {
      const std::size_t at = i * tamper_places.size() + tick_place;
      const auto mode = Tampering(tampered.mode[at]);
      if (mode == Tampering::hold) return;
      if (mode == Tampering::add) time += tampered.value[at];
      if (mode == Tampering::set) time = tampered.value[at];
    }
    AnyInput input{};
    input.time = static_cast<std::uint64_t>(std::llround(time * 1e9));
    input.request = controller_.asked;
    controller_.asked = Request::none;
    for (std::size_t n = 0; n < twins_.size(); ++n) {
      const Reading<double>& reading = twins_[n]->reading();
      Measurement<double>& to = input.axis[n];
      to.handle_angle = pass(tampered, n, i, count, 0, reading.handle_angle);
      for (std::size_t k = 0; k < 2; ++k) {
        to.tension[k] = pass(tampered, n, i, count, 1 + k, reading.tension[k]);
        to.spool_angle[k] = pass(tampered, n, i, count, 3 + k, reading.spool_angle[k]);
      }
    }
    controller_.step(input, controller_.last);
  }

  std::span<AnyTwin* const> twins_;
  AnyController& controller_;
  int steps_per_tick_;
  double time_step_;
};

inline std::array<double, control_signal_count> control_signals(const AnyController& controller, std::size_t n) {
  const AnyOutput& output = controller.last;
  const auto& axis = output.axis[n];
  const auto& e = axis.estimate;
  return {e.output_angle,
          e.output_angle_std,
          e.tip_force,
          e.tip_force_std,
          e.friction_scale,
          e.friction_scale_std,
          axis.spool_velocity[0],
          axis.spool_velocity[1],
          double(output.state),
          double(output.faults),
          double(controller.phase(int(n)))};
}

}  // namespace tenodesis::bindings

#pragma once
// The PC's side of a controller on a board: its parameters, its answers and their checks. Any failure is a fault, with
// motors at rest, until the link is set up again by a clear or a reset.

#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>

#include "serial_link.hpp"

namespace tenodesis::runtime {

using engine::AnyController;
using engine::AnyInput;
using engine::AnyOutput;

class BoardController : public AnyController {
 public:
  int axes() const override { return axes_; }
  const link::ControllerParameters& parameters() const override { return parameters_; }
  Phase phase(int axis) const override { return phase_[axis]; }

  tenodesis_counts counts(int axis) const override {
    const std::scoped_lock guard(mutex_);
    const auto number = static_cast<std::uint32_t>(axis);
    tenodesis_counts counts{};
    if (link_.problem() == LinkProblem::none &&
        link_.ask(link::Type::counts, &number, sizeof number, link::Type::counted, sizeof(link::Counted))) {
      counts_[axis] = link_.message<link::Counted>();
    }
    std::memcpy(&counts, &counts_[axis], sizeof counts);
    return counts;
  }

  bool watchdog(double since_last_step) const override {
    const float limit = parameters_.axis[0].limit[static_cast<int>(Fault::tick_late)].threshold;
    return limit > 0 && !(float(since_last_step) <= limit);
  }

  /// Takes effect with the next tick, and in the parameters of a new session.
  bool choose(ControlLaw law, Actuation actuation) override {
    const std::scoped_lock guard(mutex_);
    if (law == ControlLaw::robust && parameters_.observer != TENODESIS_OBSERVER_FRICTION) return false;
    parameters_.law = static_cast<std::uint32_t>(law);
    parameters_.actuation = static_cast<std::uint32_t>(actuation);
    return true;
  }

  LinkProblem problem() const { return link_.problem(); }
  std::string why() const { return link_.why(); }
  const link::Board& board() const { return link_.board(); }
  const LinkCounts& link_counts() const { return link_.counts(); }
  /// Ticks of the board's clock that the tick before the last took.
  std::uint32_t busy() const { return busy_; }
  /// Whether the board has stopped, by itself or on request, and waits to be enabled.
  bool stopped() const { return (flags_ & link::stopped) != 0; }

  void close() {
    const std::scoped_lock guard(mutex_);
    link_.close();
  }

 protected:
  BoardController(int descriptor, const link::ControllerParameters& parameters, const LinkSettings& settings)
      : parameters_(parameters), link_(descriptor, settings), axes_(static_cast<int>(parameters.axes)) {
    if (axes_ < 1 || axes_ > most_axes) throw std::invalid_argument("the parameters make no controller");
    link_.fail(LinkProblem::link_lost, "there was no handshake yet");
    link_.start(parameters_);
  }

  SerialLink& link() { return link_; }
  std::mutex& mutex() const { return mutex_; }

  link::Choice choice() const {
    return {static_cast<std::uint16_t>(parameters_.law), static_cast<std::uint16_t>(parameters_.actuation)};
  }

  /// Whether motors may do what a board has answered; if not, the link has a problem.
  bool is_sound(const link::Output& answer) {
    if (answer.tick.state > TENODESIS_FAULT)
      return link_.fail(LinkProblem::bad_answer, "the board is in state " + std::to_string(answer.tick.state) +
                                                     "; there are " + std::to_string(TENODESIS_FAULT + 1));
    for (int n = 0; n < axes_; ++n)
      if (!is_sound(answer.axis[n])) return false;
    return true;
  }

  void put(const link::Output& answer, AnyOutput& output) {
    const link::TickAnswer& tick = answer.tick;
    link_.counts().board_damaged = tick.damaged;
    busy_ = tick.busy;
    flags_ = tick.flags;
    output.state = OperatingState(tick.state);
    output.homed = (tick.flags & link::homed) != 0;
    output.homing = (tick.flags & link::homing) != 0;
    output.cut_power = (tick.flags & link::cut_power) != 0;
    output.faults = tick.faults;
    output.first_faults = tick.first_faults;
    for (int n = 0; n < axes_; ++n) {
      const link::AxisAnswer& from = answer.axis[n];
      auto& to = output.axis[n];
      for (int i = 0; i < 2; ++i) to.spool_velocity[i] = from.spool_velocity[i];
      to.estimate = estimate_as<Estimate<double>>(from);
      to.faults = from.faults;
      to.homing_failure = HomingFailure::of_word(from.homing_failure);
      phase_[n] = Phase(from.phase);
    }
  }

  /// Without an answer the tip is unknown, and motors are at rest.
  void stop(AnyOutput& output) {
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    const std::uint32_t fault =
        bit(link_.problem() == LinkProblem::not_a_number ? Fault::not_a_number : Fault::tick_late);
    const bool was_fault = output.state == OperatingState::fault;
    output.state = OperatingState::fault;
    output.homing = false;
    output.faults = was_fault ? output.faults | fault : fault;
    if (!was_fault) output.first_faults = fault;
    for (int n = 0; n < axes_; ++n)
      output.axis[n] = {{0, 0}, {unknown, unknown, unknown, unknown, unknown, unknown}, fault, {}};
    std::ranges::fill(phase_, Phase::rest);
  }

  void forget_session() {
    forget();
    std::ranges::fill(phase_, Phase::track);
  }

 private:
  bool is_sound(const link::AxisAnswer& axis) {
    if (axis.phase > static_cast<std::uint32_t>(Phase::dither))
      return link_.fail(LinkProblem::bad_answer,
                        "the board is in phase " + std::to_string(axis.phase) + " of compensation");
    // Ramps in float may exceed the limit by rounding.
    const float most = parameters_.speed_limit * (1 + 4 * std::numeric_limits<float>::epsilon());
    for (const float velocity : axis.spool_velocity) {
      if (!std::isfinite(velocity))
        return link_.fail(LinkProblem::not_a_number, "the board sent a velocity that is not a number");
      if (std::abs(velocity) > most)
        return link_.fail(LinkProblem::beyond_limit, "the board sent a velocity of " + std::to_string(velocity) +
                                                         " rad/s; it must be at most " + std::to_string(most));
    }
    return true;
  }

  link::ControllerParameters parameters_;
  mutable std::mutex mutex_;  // other threads than that of the ticks ask for counts and close
  mutable SerialLink link_;
  int axes_;
  std::array<Phase, most_axes> phase_{Phase::track, Phase::track};
  mutable std::array<link::Counted, most_axes> counts_{};
  std::uint32_t busy_{};
  std::uint32_t flags_{};
};

}  // namespace tenodesis::runtime

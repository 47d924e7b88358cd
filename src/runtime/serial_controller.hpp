#pragma once
// A controller on a board, as any other: a tick is sent to it over a line and its answer waited for. Whatever fails
// there is a fault, motors at rest, until the link is set up anew by a clear or a reset.

#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>

#include "serial_link.hpp"

namespace tenodesis::runtime {

using bindings::AnyController;
using bindings::AnyInput;
using bindings::AnyOutput;
using bindings::most_axes;

class SerialController final : public AnyController {
 public:
  SerialController(int descriptor, const Image& image, const LinkSettings& settings)
      : image_(image), link_(descriptor, settings), axes_(static_cast<int>(word<std::uint32_t>(axes_word))) {
    if (axes_ < 1 || axes_ > most_axes) throw std::invalid_argument("the parameters make no controller");
    link_.fail(LinkProblem::link_lost, "there was no handshake yet");
    link_.start(image_);
  }

  void step(const AnyInput& input, AnyOutput& output) override {
    const std::scoped_lock guard(mutex_);
    const bool clears = input.request == Request::clear;
    const bool linked = link_.problem() == LinkProblem::none || (clears && link_.resume(image_));
    if (!linked || !tick(input, output)) stop(output);
    note(input, output);
  }

  void reset() override {
    const std::scoped_lock guard(mutex_);
    if (link_.problem() != LinkProblem::none)
      link_.start(image_);
    else
      link_.ask(link::Type::reset, nullptr, 0, link::Type::done, 0);
    const AnyOutput rest{};
    last = rest;
    asked = Request::none;
    std::ranges::fill(phase_, Phase::track);
    recorder.rearm();
  }

  int axes() const override { return axes_; }

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

  Phase phase(int axis) const override { return phase_[axis]; }

  bool watchdog(double since_last_step) const override {
    const auto limit = word<float>(limits_word + 2 * static_cast<std::size_t>(Fault::tick_late));
    return limit > 0 && !(float(since_last_step) <= limit);
  }

  LinkProblem problem() const { return link_.problem(); }
  std::string why() const { return link_.why(); }
  const link::Board& board() const { return link_.board(); }
  const LinkCounts& link_counts() const { return link_.counts(); }
  /// Ticks of the board's clock that the frame before the last took.
  std::uint32_t busy() const { return busy_; }
  /// Whether the board says that it has stopped by itself, or by being told, and waits to be enabled.
  bool stopped() const { return (flags_ & link::stopped) != 0; }

  void close() {
    const std::scoped_lock guard(mutex_);
    link_.close();
  }

 private:
  // Where numbers lie in an image of parameters, in words.
  static constexpr std::size_t axes_word = 3, common_word = 10, speed_limit_word = common_word + 1;
  static constexpr std::size_t limits_word =
      common_word + bindings::common_fields.size() + bindings::axis_fields.size() + 2;
  static_assert((common_word + bindings::common_fields.size() +
                 most_axes * (bindings::axis_fields.size() + 2 * bindings::limit_count)) *
                    sizeof(float) ==
                link::parameters_size);

  template <class T>
  T word(std::size_t at) const {
    T value{};
    std::memcpy(&value, image_.data() + at * sizeof value, sizeof value);
    return value;
  }

  bool tick(const AnyInput& input, AnyOutput& output) {
    link::Step step{};
    step.time = input.time;
    step.request = static_cast<std::uint32_t>(input.request);
    for (int n = 0; n < axes_; ++n) {
      const auto& from = input.axis[n];
      step.axis[n] = {float(from.handle_angle),
                      {float(from.tension[0]), float(from.tension[1])},
                      {float(from.spool_angle[0]), float(from.spool_angle[1])}};
    }
    if (!link_.ask(link::Type::step, &step, link::Step::size(axes_), link::Type::output, link::Output::size(axes_)))
      return false;
    const auto answer = link_.message<link::Output>();
    if (!is_sound(step, answer)) return false;
    link_.counts().board_damaged = answer.damaged;
    busy_ = answer.busy;
    flags_ = answer.flags;
    put(answer, output);
    return true;
  }

  bool is_sound(const link::Step& step, const link::Output& answer) {
    if (answer.time != step.time)
      return link_.fail(LinkProblem::wrong_tick, "the board answered the tick of " + std::to_string(step.time) +
                                                     " ns as that of " + std::to_string(answer.time) + " ns");
    if (answer.state > TENODESIS_FAULT)
      return link_.fail(LinkProblem::bad_answer, "the board is in state " + std::to_string(answer.state) +
                                                     "; there are " + std::to_string(TENODESIS_FAULT + 1));
    // What the ramps add in float may be off by a rounding.
    const float most = word<float>(speed_limit_word) * (1 + 4 * std::numeric_limits<float>::epsilon());
    for (int n = 0; n < axes_; ++n) {
      if (answer.axis[n].phase > static_cast<std::uint32_t>(Phase::release))
        return link_.fail(LinkProblem::bad_answer,
                          "the board is in phase " + std::to_string(answer.axis[n].phase) + " of compensation");
      for (const float velocity : answer.axis[n].spool_velocity) {
        if (!std::isfinite(velocity))
          return link_.fail(LinkProblem::not_a_number, "the board sent a velocity that is not a number");
        if (std::abs(velocity) > most)
          return link_.fail(LinkProblem::beyond_limit, "the board sent a velocity of " + std::to_string(velocity) +
                                                           " rad/s; allowed is at most " + std::to_string(most));
      }
    }
    return true;
  }

  void put(const link::Output& answer, AnyOutput& output) {
    output.state = OperatingState(answer.state);
    output.homed = (answer.flags & link::homed) != 0;
    output.homing = (answer.flags & link::homing) != 0;
    output.faults = answer.faults;
    output.first_faults = answer.first_faults;
    for (int n = 0; n < axes_; ++n) {
      const link::AxisAnswer& from = answer.axis[n];
      auto& to = output.axis[n];
      for (int i = 0; i < 2; ++i) to.spool_velocity[i] = from.spool_velocity[i];
      to.estimate = {from.output_angle,  from.output_angle_std, from.tip_force,
                     from.tip_force_std, from.friction_scale,   from.friction_scale_std};
      to.faults = from.faults;
      phase_[n] = Phase(from.phase);
    }
  }

  // Without an answer nothing is known of the tip, and nothing moves.
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
      output.axis[n] = {{0, 0}, {unknown, unknown, unknown, unknown, unknown, unknown}, fault};
    std::ranges::fill(phase_, Phase::rest);
  }

  void note(const AnyInput& input, const AnyOutput& output) {
    bindings::Moment moment{};
    moment.time = input.time;
    moment.state = output.state;
    moment.faults = output.faults;
    for (int n = 0; n < most_axes; ++n) {
      moment.measured[n] = input.axis[n];
      for (int i = 0; i < 2; ++i) moment.spool_velocity[n][i] = output.axis[n].spool_velocity[i];
      moment.output_angle[n] = output.axis[n].estimate.output_angle;
    }
    const bool fault = output.state == OperatingState::fault;
    if (!fault && recorder.fault_place() >= 0) recorder.rearm();
    recorder.note(moment, fault);
  }

  Image image_;
  mutable std::mutex mutex_;  // whoever asks for counts or closes is another thread than ticks
  mutable SerialLink link_;
  int axes_;
  std::array<Phase, most_axes> phase_{Phase::track, Phase::track};
  mutable std::array<link::Counted, most_axes> counts_{};
  std::uint32_t busy_{};
  std::uint32_t flags_{};
};

}  // namespace tenodesis::runtime

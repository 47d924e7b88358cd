#pragma once
// A board with sensors and motors of its own: it ticks by its own clock, and the loop follows the ticks that it sends.
// What the loop wants of it is sent back with every tick; where the loop receives no more ticks, the board receives no
// more messages, and stops.

#include <thread>

#include "board_controller.hpp"
#include "device.hpp"
#include "queue.hpp"

namespace tenodesis::runtime {

class StreamedController final : public BoardController {
 public:
  StreamedController(int descriptor, const link::ControllerParameters& parameters, const LinkSettings& settings)
      : BoardController(descriptor, parameters, settings) {
    if (problem() == LinkProblem::none) begin();
  }

  /// The board's next tick and its time, ns; false where none has come within so many ns, and the previous one stays.
  bool receive(std::uint64_t& time, std::uint64_t timeout) {
    const auto until = SerialLine::Clock::now() + std::chrono::nanoseconds(timeout);
    const bool fresh = receive(until);
    // A line that has failed returns at once, and the loop must not spin.
    if (!fresh && problem() != LinkProblem::none) std::this_thread::sleep_until(until);
    time = received_.tick.time;
    return fresh;
  }

  /// Ticks that were lost before the last.
  std::uint64_t overtaken() const { return overtaken_; }

  /// What the board has answered already; a request goes to it with the next message.
  void step(const AnyInput& input, AnyOutput& output) override {
    const std::scoped_lock guard(mutex());
    if (problem() != LinkProblem::none && input.request == Request::clear && link().resume(parameters())) begin();
    if (problem() == LinkProblem::none) {
      ask(input.request);
      put(answer_, output);
    } else {
      stop(output);
    }
    record(input, output);
  }

  /// Lets the board drive its motors as it has answered, or stops them where the loop wants other velocities. One
  /// message is under way at a time, except for what stops: a slow board would receive the others late, and take them
  /// for new ones. speed: of the spools, agonist and antagonist of each axis, rad/s.
  void send(const double* speed) {
    const std::scoped_lock guard(mutex());
    if (problem() != LinkProblem::none || !unanswered_) return;
    unanswered_ = false;
    if (received_.number == keep_.number && waiting_.first() != Request::none) set_request(waiting_.pop());
    const bool rested = keep_.rest != 0;
    keep_.rest = 0;
    for (int n = 0; n < axes(); ++n)
      for (int i = 0; i < 2; ++i)
        if (speed[2 * n + i] != double(answer_.axis[n].spool_velocity[i])) keep_.rest = 1;
    keep_.choice = choice();
    const bool arrived = received_.kept == sent_ || number_ - sent_at_ >= longest_way;
    if (!arrived && !urgent_ && (keep_.rest == 0 || rested)) return;
    urgent_ = false;
    sent_ = link().notify(link::Type::keep, &keep_, sizeof keep_);
    sent_at_ = number_;
  }

  /// Stops the motors and the board's ticks.
  void rest() {
    const std::scoped_lock guard(mutex());
    link().notify(link::Type::stop, nullptr, 0);
  }

  void reset() override {
    const std::scoped_lock guard(mutex());
    if (link().start(parameters())) begin();
    forget_session();
  }

  const link::Measured& measured(int axis) const { return received_.axis[axis].measured; }

 private:
  static constexpr std::uint32_t longest_way = 16;  // ticks until a message that arrives has arrived

  void begin() {
    received_ = {};
    answer_ = {};
    keep_ = {};
    waiting_.clear();
    number_ = 0;
    overtaken_ = 0;
    unanswered_ = urgent_ = false;
    sent_at_ = 0 - longest_way;
    link().start_streaming(link::size_with<link::Streamed>(axes()));
  }

  bool receive(SerialLine::Moment until) {
    const std::scoped_lock guard(mutex());
    if (problem() != LinkProblem::none) return false;
    std::uint32_t number = 0;
    link::Streamed streamed{};
    if (!link().receive(streamed, number, number_, until)) return false;
    const link::Output answer{streamed.tick, {streamed.axis[0].answer, streamed.axis[1].answer}};
    if (!is_later(streamed.tick.time) || !is_sound(answer)) {
      link().notify(link::Type::stop, nullptr, 0);
      return false;
    }
    overtaken_ = number - number_ - 1;
    number_ = number;
    received_ = streamed;
    answer_ = answer;
    unanswered_ = true;
    return true;
  }

  bool is_later(std::uint64_t time) {
    if (time > received_.tick.time) return true;
    return link().fail(LinkProblem::wrong_tick, "the board sent a tick of " + std::to_string(time) +
                                                    " ns after that of " + std::to_string(received_.tick.time) + " ns");
  }

  // Sent one at a time, until the board confirms that it has arrived; a request that stops does not wait.
  void ask(Request request) {
    if (request == Request::pause || request == Request::disable) {
      waiting_.clear();
      set_request(request);
      urgent_ = true;
    } else if (request != Request::none) {
      waiting_.push(request);
    }
  }

  // A new number makes it a new request to the board.
  void set_request(Request request) {
    keep_.request = static_cast<std::uint32_t>(request);
    ++keep_.number;
  }

  link::Streamed received_{};  // the last tick
  link::Output answer_{};      // in it
  std::uint32_t number_{};     // of it
  std::uint64_t overtaken_{};
  bool unanswered_{};                 // the last tick
  bool urgent_{};                     // what is to be sent stops motors
  std::uint32_t sent_{}, sent_at_{};  // the last message, and with which tick it was sent
  link::Keep keep_{};                 // what is sent to the board
  RequestQueue waiting_;
};

/// Sensors and motors of such a board, as the loop sees them.
class StreamedDevice final : public Device {
 public:
  explicit StreamedDevice(StreamedController& board)
      : Device(sizes_of(board), bench_commands(sizes_of(board), false), bench_signals(sizes_of(board), false)),
        board_(board) {}

  bool simulated() const override { return false; }
  bool clocked() const override { return true; }
  bool read(std::uint64_t& time, std::uint64_t timeout) override { return board_.receive(time, timeout); }
  Measurement<double> reading(const CompensatedAxis& axis) const override {
    return measurement_as<Measurement<double>>(board_.measured(int(axis.handle)));
  }
  std::uint64_t overtaken() const override { return board_.overtaken(); }

  bool write(const double* row) override {
    board_.send(row);
    return true;
  }

  void store(double* out) const override {
    const int axes = board_.axes();
    for (int n = 0; n < axes; ++n) {
      const link::Measured& from = board_.measured(n);
      out[n] = from.handle_angle;
      for (int i = 0; i < 2; ++i) {
        out[axes + 2 * n + i] = from.tension[i];
        out[3 * axes + 2 * n + i] = from.spool_angle[i];
      }
    }
  }

  void stop() noexcept override { board_.rest(); }

 private:
  static Sizes sizes_of(const StreamedController& board) {
    const auto axes = std::size_t(board.axes());
    return {axes, axes, 2 * axes};
  }

  StreamedController& board_;
};

}  // namespace tenodesis::runtime

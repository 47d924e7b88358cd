#pragma once
// A board with sensors and motors of its own: it ticks by its own clock, and the loop follows what it sends. What the
// loop wants of it goes back with every tick; where the loop stops hearing it, it stops hearing the loop, and rests.

#include <thread>

#include "board_controller.hpp"
#include "device.hpp"

namespace tenodesis::runtime {

class StreamedController final : public BoardController {
 public:
  StreamedController(int descriptor, const Image& image, const LinkSettings& settings)
      : BoardController(descriptor, image, settings) {
    if (problem() == LinkProblem::none) begin();
  }

  /// The next tick of the board's; false where none has come within so many ns, and the input holds the one before.
  bool hear(AnyInput& input, std::uint64_t timeout) {
    const auto until = SerialLine::Clock::now() + std::chrono::nanoseconds(timeout);
    const bool fresh = hear(until);
    // A line that has failed answers at once, and the loop is not to run in circles.
    if (!fresh && problem() != LinkProblem::none) std::this_thread::sleep_until(until);
    input.time = heard_.tick.time;
    for (int n = 0; n < axes(); ++n) {
      const link::Measured& from = heard_.axis[n].measured;
      input.axis[n] = {
          from.handle_angle, {from.tension[0], from.tension[1]}, {from.spool_angle[0], from.spool_angle[1]}};
    }
    return fresh;
  }

  /// Ticks that were lost before the last.
  std::uint64_t overtaken() const { return overtaken_; }

  /// What the board has answered already; a request goes to it with what it is told next.
  void step(const AnyInput& input, AnyOutput& output) override {
    const std::scoped_lock guard(mutex());
    if (problem() != LinkProblem::none && input.request == Request::clear && link().resume(image())) begin();
    if (problem() == LinkProblem::none) {
      ask(input.request);
      put(answer_, output);
    } else {
      stop(output);
    }
    note(input, output);
  }

  /// Lets the motors do what the board wants of them, or have them rest where the loop wants something else. But for
  /// what stops, one message is under way at a time: a slow board would hear of the rest late, and take it for new.
  void tell(const Velocities& speed) {
    const std::scoped_lock guard(mutex());
    if (problem() != LinkProblem::none || !unanswered_) return;
    unanswered_ = false;
    if (heard_.number == keep_.number) next_request();
    const bool rested = keep_.rest != 0;
    keep_.rest = 0;
    for (int n = 0; n < axes(); ++n)
      for (int i = 0; i < 2; ++i)
        if (speed[n][i] != double(answer_.axis[n].spool_velocity[i])) keep_.rest = 1;
    keep_.choice = choice();
    const bool arrived = heard_.kept == told_ || number_ - told_at_ >= longest_way;
    if (!arrived && !urgent_ && (keep_.rest == 0 || rested)) return;
    urgent_ = false;
    told_ = link().tell(link::Type::keep, &keep_, sizeof keep_);
    told_at_ = number_;
  }

  /// Has the motors rest and the board be silent.
  void rest() {
    const std::scoped_lock guard(mutex());
    link().tell(link::Type::stop, nullptr, 0);
  }

  void reset() override {
    const std::scoped_lock guard(mutex());
    if (link().start(image())) begin();
    forget();
  }

  const link::Measured& measured(int axis) const { return heard_.axis[axis].measured; }

 private:
  static constexpr std::uint32_t longest_way = 16;  // ticks in which a message arrives, if it does

  void begin() {
    heard_ = {};
    answer_ = {};
    keep_ = {};
    waiting_count_ = 0;
    number_ = 0;
    overtaken_ = 0;
    unanswered_ = urgent_ = false;
    told_at_ = 0 - longest_way;
    link().listen(link::Streamed::size(axes()));
  }

  bool hear(SerialLine::Moment until) {
    const std::scoped_lock guard(mutex());
    if (problem() != LinkProblem::none) return false;
    std::uint32_t number = 0;
    link::Streamed streamed{};
    if (!link().hear(streamed, number, number_, until)) return false;
    const link::Output answer{streamed.tick, {streamed.axis[0].answer, streamed.axis[1].answer}};
    if (!is_later(streamed.tick.time) || !is_sound(answer)) {
      link().tell(link::Type::stop, nullptr, 0);
      return false;
    }
    overtaken_ = number - number_ - 1;
    number_ = number;
    heard_ = streamed;
    answer_ = answer;
    unanswered_ = true;
    return true;
  }

  bool is_later(std::uint64_t time) {
    if (time > heard_.tick.time) return true;
    return link().fail(LinkProblem::wrong_tick, "the board sent a tick of " + std::to_string(time) +
                                                    " ns after that of " + std::to_string(heard_.tick.time) + " ns");
  }

  // One at a time, until the board says that it has it; what stops does not wait.
  void ask(Request request) {
    if (request == Request::none) return;
    if (request == Request::pause || request == Request::disable) {
      waiting_count_ = 0;
      say(request);
      urgent_ = true;
      return;
    }
    if (waiting_count_ == waiting_.size()) --waiting_count_;
    waiting_[waiting_count_++] = request;
  }

  void next_request() {
    if (waiting_count_ == 0) return;
    say(waiting_[0]);
    std::copy(waiting_.begin() + 1, waiting_.end(), waiting_.begin());
    --waiting_count_;
  }

  void say(Request request) {
    keep_.request = static_cast<std::uint32_t>(request);
    ++keep_.number;
  }

  link::Streamed heard_{};
  link::Output answer_{};   // of it
  std::uint32_t number_{};  // of it
  std::uint64_t overtaken_{};
  bool unanswered_{};                 // the tick that was heard last
  bool urgent_{};                     // what is to be told stops motors
  std::uint32_t told_{}, told_at_{};  // what was told last, and with which tick
  link::Keep keep_{};                 // what the board is told
  std::array<Request, 8> waiting_{};
  std::size_t waiting_count_{};
};

/// Sensors and motors of such a board, as the loop sees them.
class StreamedDevice final : public Device {
 public:
  explicit StreamedDevice(StreamedController& board) : board_(board) {}

  int axes() const override { return board_.axes(); }
  bool simulated() const override { return false; }
  bool clocked() const override { return true; }
  bool read(AnyInput& input, std::uint64_t timeout) override { return board_.hear(input, timeout); }
  std::uint64_t overtaken() const override { return board_.overtaken(); }

  bool write(const Velocities& speed, const Benches& /*bench*/) override {
    board_.tell(speed);
    return true;
  }

  Signals signals(int axis) const override {
    constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
    const link::Measured& from = board_.measured(axis);
    Signals known;
    known.fill(unknown);
    known[0] = from.handle_angle;
    for (std::size_t i = 0; i < 2; ++i) {
      known[2 + i] = from.tension[i];
      known[4 + i] = from.spool_angle[i];
    }
    return known;
  }

  void stop() noexcept override { board_.rest(); }

 private:
  StreamedController& board_;
};

}  // namespace tenodesis::runtime

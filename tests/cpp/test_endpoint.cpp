// Claims about the firmware's side of the link: a board acts on no frame twice or late, and its controller does what it
// does without a link, to the last bit.

#include "../../firmware/endpoint.hpp"

#include <bit>
#include <cmath>
#include <limits>
#include <memory>

#include "claim.hpp"
#include "frames.hpp"
#include "scaled_up.h"

/// A PC and a board, with the line between them.
class Bench {
 public:
  static constexpr std::uint16_t session = 77;
  static constexpr Choice uploaded{TENODESIS_LAW_ROBUST, TENODESIS_ACTUATION_DIFFERENTIAL};

  explicit Bench(bool sensors = false) : endpoint_(std::make_unique<Endpoint>("test", 25000000U, sensors)) {}

  Frame ask(const Frame& frame) {
    const Stream bytes = encoded(frame);
    Bytes answer{};
    for (const std::uint8_t byte : bytes)
      if (to_board_.push(byte)) answer = endpoint_->take(to_board_, now);
    return received(answer);
  }

  Frame received(const Bytes& bytes) {
    Frame found{};
    for (std::size_t k = 0; k < bytes.size; ++k)
      if (to_pc_.push(bytes.data[k])) found = frame_in(to_pc_);
    return found;
  }

  Frame question(Type type, const Stream& payload = {}) {
    return {{protocol_version, type, session, ++sequence}, payload};
  }

  Frame start(std::uint32_t silence = 0, const tenodesis_parameters& parameters = scaled_up) {
    Parameters upload{};
    upload.silence = silence;
    upload.controller = std::bit_cast<ControllerParameters>(parameters);
    return ask(question(Type::parameters, bytes_of(upload)));
  }

  template <class Message>
  static Stream bytes_of(const Message& message) {
    Stream bytes(sizeof message);
    std::memcpy(bytes.data(), &message, sizeof message);
    return bytes;
  }

  Frame tick(const tenodesis_input& input, Choice choice = uploaded) {
    Step step{input.time, input.request, choice, {}};
    std::memcpy(step.axis, input.axis, sizeof step.axis);
    Stream payload = bytes_of(step);
    payload.resize(size_with<Step>(1));
    return question(Type::step, payload);
  }

  Endpoint& endpoint() const { return *endpoint_; }

  std::uint64_t now{1};
  std::uint32_t sequence{};

 private:
  std::unique_ptr<Endpoint> endpoint_;
  Decoder to_board_;
  Decoder to_pc_;
};

template <class Message>
Message message(const Frame& frame) {
  Message message{};
  std::memcpy(&message, frame.payload.data(), std::min(frame.payload.size(), sizeof message));
  return message;
}

/// Readings of an instrument whose spools follow, and whose first tick enables the controller.
class Plant {
 public:
  static constexpr int bad_tick = 700;

  tenodesis_input reading() {
    tenodesis_input input{};
    input.time = 1000U + static_cast<std::uint64_t>(tick_) * 500000U;
    input.request = tick_ == 0 ? TENODESIS_REQUEST_ENABLE : TENODESIS_REQUEST_NONE;
    auto& first = input.axis[0];
    first.handle_angle = 0.3F * float(std::sin(tick_ * 0.004));
    for (int i = 0; i < 2; ++i) {
      const float load = i == 0 ? 3 : -3;
      const float flicker = tick_ % 2 == 0 ? 0.03F : -0.03F;
      first.tension[i] = 25 + load + flicker + stiffness * radius * spool_[i];
      first.spool_angle[i] = spool_[i];
    }
    if (tick_ == bad_tick) first.tension[0] = std::numeric_limits<float>::quiet_NaN();
    ++tick_;
    return input;
  }

  void follow(const float (&velocity)[2]) {
    for (int i = 0; i < 2; ++i) {
      speed_[i] += (velocity[i] - speed_[i]) * 0.05F;
      spool_[i] += speed_[i] * 5e-4F;
    }
  }

 private:
  static constexpr float stiffness = 11451, radius = 0.005F;  // N/m, m

  int tick_{};
  float spool_[2]{}, speed_[2]{};
};

bool same(const Output& first, const tenodesis_output& other) {
  const auto& axis = other.axis[0];
  return std::memcmp(&first.axis[0], &axis, offsetof(tenodesis_axis_output, homing_failure)) == 0 &&
         first.axis[0].homing_failure == axis.homing_failure && first.tick.state == other.state &&
         first.tick.faults == other.faults && first.tick.first_faults == other.first_faults &&
         (first.tick.flags & (homed | homing)) == (other.homed != 0 ? homed : 0U) + (other.homing != 0 ? homing : 0U);
}

void a_board_does_what_the_controller_does_and_nothing_twice() {
  Bench bench;
  CLAIM(bench.start().header.type == Type::done);
  const auto own = std::make_unique<tenodesis_controller>();
  CLAIM(tenodesis_init(own.get(), &scaled_up) == TENODESIS_OK);
  Plant plant;
  int differing = 0;
  int repeated = 0;
  int late = 0;
  int moving = 0;
  Frame before;
  for (int tick = 0; tick < Plant::bad_tick + 100; ++tick) {
    bench.now += 500000;
    const tenodesis_input input = plant.reading();
    tenodesis_output expected;
    tenodesis_step(own.get(), &input, &expected);
    const Frame question = bench.tick(input);
    const Frame answer = bench.ask(question);
    const auto output = message<Output>(answer);
    if (answer.header.type != Type::output || output.tick.time != input.time || !same(output, expected)) ++differing;
    // Repeated, as if its answer had been lost; and then a frame that was delayed.
    if (!(bench.ask(question) == answer)) ++repeated;
    if (tick > 0 && bench.ask(before).header.type != Type::none) ++late;
    before = question;
    if (output.axis[0].spool_velocity[0] != 0) ++moving;
    plant.follow(output.axis[0].spool_velocity);
  }
  CLAIM(differing == 0);
  CLAIM(repeated == 0);
  CLAIM(late == 0);
  CLAIM(moving > 300);
  const Frame counts = bench.ask(bench.question(Type::counts, Bench::bytes_of(std::uint32_t{0})));
  CLAIM(message<Counted>(counts).faults[TENODESIS_FAULT_NOT_A_NUMBER] == 1);
}

Refused refused(const Frame& frame) {
  CLAIM(frame.header.type == Type::refused);
  return message<Refused>(frame);
}

void bad_questions_are_refused_and_change_nothing() {
  Bench bench;
  Plant plant;
  CLAIM(refused(bench.ask(bench.tick({}))).why == Refusal::no_session);
  tenodesis_parameters wrong = scaled_up;
  wrong.period = 0;
  CLAIM(refused(bench.start(0, wrong)).detail == TENODESIS_BAD_PARAMETER);
  wrong = scaled_up;
  wrong.version += 1;
  CLAIM(refused(bench.start(0, wrong)).detail == TENODESIS_BAD_VERSION);
  CLAIM(refused(bench.ask(bench.tick({}))).why == Refusal::no_session);
  CLAIM(bench.start().header.type == Type::done);
  const Frame first = bench.ask(bench.tick(plant.reading()));
  const tenodesis_input second = plant.reading();
  Frame other = bench.tick(second);
  other.header.version = protocol_version + 1;
  CLAIM(refused(bench.ask(other)).why == Refusal::wrong_version);
  other.header.version = protocol_version;
  other.header.session = Bench::session + 1;
  CLAIM(refused(bench.ask(other)).why == Refusal::no_session);
  other.header.session = Bench::session;
  other.payload.push_back(0);
  CLAIM(refused(bench.ask(other)).why == Refusal::bad_size);
  CLAIM(refused(bench.ask(bench.question(Type::board))).why == Refusal::unknown_type);
  CLAIM(refused(bench.ask(bench.question(Type::stream))).why == Refusal::no_sensors);
  CLAIM(refused(bench.ask(bench.question(Type::counts, Bench::bytes_of(std::uint32_t{1})))).why ==
        Refusal::no_such_axis);
  CLAIM(message<Output>(first).tick.state == TENODESIS_ENABLED);
  CLAIM(message<Output>(bench.ask(bench.tick(second))).tick.state == TENODESIS_ENABLED);
}

bool at_rest(const Bench& bench, const Output& output) {
  const auto& velocity = output.axis[0].spool_velocity;
  const auto& endpoint = const_cast<Bench&>(bench).endpoint();
  return velocity[0] == 0 && velocity[1] == 0 && endpoint.velocity(0, 0) == 0 && endpoint.velocity(0, 1) == 0;
}

/// An enabled board at work, and what its sensors go on to say.
class Running {
 public:
  explicit Running(std::uint32_t silence = 0, int ticks = 300) {
    bench.start(silence);
    for (int tick = 0; tick < ticks; ++tick) go_on();
  }

  Output go_on(std::uint32_t request = TENODESIS_REQUEST_NONE) {
    bench.now += 500000;
    tenodesis_input input = plant.reading();
    if (request != TENODESIS_REQUEST_NONE) input.request = request;
    output = message<Output>(bench.ask(bench.tick(input, choice)));
    plant.follow(output.axis[0].spool_velocity);
    return output;
  }

  bool moves() const {
    return output.axis[0].spool_velocity[0] != 0 && velocity(0) == output.axis[0].spool_velocity[0];
  }
  bool rests() const {
    const auto& sent = output.axis[0].spool_velocity;
    return sent[0] == 0 && sent[1] == 0 && velocity(0) == 0 && velocity(1) == 0;
  }
  float velocity(int tendon) const { return bench.endpoint().velocity(0, tendon); }

  Bench bench;
  Plant plant;
  Choice choice{Bench::uploaded};
  Output output;
};

void a_silent_pc_stops_the_board_until_it_is_enabled_again() {
  for (const std::uint32_t silence : {0U, 100U}) {
    const std::uint64_t limit = silence == 0 ? 25000000 : 100000000;  // ns; the scaled-up instrument's watchdog
    Running running(silence);
    Bench& bench = running.bench;
    CLAIM(running.output.tick.state == TENODESIS_ENABLED && running.moves());
    bench.now += limit - 1000;
    bench.endpoint().watch(bench.now);
    CLAIM(running.moves());
    bench.now += 2000;
    bench.endpoint().watch(bench.now);
    CLAIM(running.velocity(0) == 0 && running.velocity(1) == 0);
    // Nothing that it is asked now moves a motor.
    CLAIM(running.go_on(TENODESIS_REQUEST_RESUME).tick.state == TENODESIS_PAUSED && running.rests());
    CLAIM((running.output.tick.flags & silent) != 0 && (running.output.tick.flags & stopped) != 0);
    for (int n = 0; n < 10; ++n)
      CLAIM(running.go_on().tick.state == TENODESIS_PAUSED && running.rests() &&
            (running.output.tick.flags & silent) == 0);
    CLAIM(running.go_on(TENODESIS_REQUEST_RESUME).tick.state == TENODESIS_ENABLED &&
          (running.output.tick.flags & stopped) == 0);
  }
}

void a_late_tick_stops_the_board_even_if_watch_was_not_called() {
  Running running;
  running.bench.now += 30000000;
  CLAIM(running.go_on().tick.state == TENODESIS_PAUSED && running.rests() && (running.output.tick.flags & silent) != 0);
}

void a_stop_stops_and_a_clear_after_it_disables() {
  Running running;
  CLAIM(running.moves());
  CLAIM(running.bench.ask(running.bench.question(Type::stop)).header.type == Type::done);
  CLAIM(running.velocity(0) == 0 && running.velocity(1) == 0);
  CLAIM(running.go_on(TENODESIS_REQUEST_CLEAR).tick.state == TENODESIS_DISABLED && running.rests());
  CLAIM((running.output.tick.flags & halted) != 0);
  CLAIM(running.bench.ask(running.bench.question(Type::reset)).header.type == Type::done);
  CLAIM(running.go_on(TENODESIS_REQUEST_ENABLE).tick.state == TENODESIS_ENABLED);
}

/// A board with sensors of its own at work, and the PC that keeps it going.
class Streaming {
 public:
  Streaming() {
    bench.start();
    CLAIM(bench.ask(bench.question(Type::stream)).header.type == Type::done && bench.endpoint().streams());
  }

  Streamed tick() {
    bench.now += 500000;
    bench.endpoint().watch(bench.now);
    const tenodesis_input input = plant.reading();
    const tenodesis_measurement measured[TENODESIS_AXES]{input.axis[0], {}};
    const Frame frame = bench.received(bench.endpoint().tick(measured, input.time));
    CLAIM(frame.payload.size() == size_with<Streamed>(1) && frame.header.sequence == ++ticks);
    const auto got = message<Streamed>(frame);
    CLAIM(got.axis[0].measured.tension[0] == input.axis[0].tension[0] && got.tick.time == input.time);
    plant.follow(got.axis[0].answer.spool_velocity);
    return got;
  }

  Frame keep() {
    Frame frame = bench.question(Type::keep, Bench::bytes_of(wanted));
    bench.ask(frame);
    return frame;
  }

  /// Ticks, each answered.
  Streamed go_on(int count) {
    Streamed got;
    for (int n = 0; n < count; ++n) {
      keep();
      got = tick();
    }
    return got;
  }

  Streamed ask(std::uint32_t request) {
    wanted.request = request;
    ++wanted.number;
    return go_on(1);
  }

  bool rests() const { return bench.endpoint().velocity(0, 0) == 0 && bench.endpoint().velocity(0, 1) == 0; }

  Bench bench{true};
  Plant plant;
  Keep wanted{0, 0, {TENODESIS_LAW_ROBUST, TENODESIS_ACTUATION_DIFFERENTIAL}, 0};
  std::uint32_t ticks{};
};

void a_board_with_sensors_continues_by_itself_until_the_pc_is_silent() {
  Streaming streaming;
  Streamed got = streaming.ask(TENODESIS_REQUEST_ENABLE);
  CLAIM(got.kept == streaming.bench.sequence && got.number == 1 && got.tick.state == TENODESIS_ENABLED);
  got = streaming.go_on(200);
  CLAIM(got.tick.state == TENODESIS_ENABLED && got.axis[0].answer.spool_velocity[0] != 0);
  streaming.bench.now += 26000000;
  got = streaming.tick();
  CLAIM(got.tick.state == TENODESIS_PAUSED && (got.tick.flags & silent) != 0);
  CLAIM(got.axis[0].answer.spool_velocity[0] == 0 && streaming.rests());
}

void a_request_that_is_repeated_with_every_tick_is_made_once() {
  Streaming streaming;
  streaming.ask(TENODESIS_REQUEST_ENABLE);
  const Frame before = streaming.keep();
  CLAIM(streaming.ask(TENODESIS_REQUEST_PAUSE).tick.state == TENODESIS_PAUSED);
  // Repeated and late frames are ignored, and the same number is the same request.
  streaming.bench.ask(before);
  CLAIM(streaming.go_on(10).tick.state == TENODESIS_PAUSED);
  streaming.wanted.request = TENODESIS_REQUEST_RESUME;
  CLAIM(streaming.go_on(10).tick.state == TENODESIS_PAUSED);
  CLAIM(streaming.ask(TENODESIS_REQUEST_RESUME).tick.state == TENODESIS_ENABLED);
}

void a_pc_that_wants_rest_gets_it_at_once_until_it_enables_again() {
  Streaming streaming;
  streaming.ask(TENODESIS_REQUEST_ENABLE);
  CLAIM(streaming.go_on(200).axis[0].answer.spool_velocity[0] != 0);
  streaming.wanted.rest = 1;
  streaming.keep();
  CLAIM(streaming.rests());
  streaming.wanted.rest = 0;
  const Streamed got = streaming.go_on(20);
  CLAIM(got.tick.state == TENODESIS_PAUSED && (got.tick.flags & stopped) != 0 && streaming.rests());
  CLAIM(streaming.ask(TENODESIS_REQUEST_RESUME).tick.state == TENODESIS_ENABLED);
}

void the_law_is_that_of_the_last_tick_and_an_unknown_law_changes_nothing() {
  Streaming streaming;
  streaming.ask(TENODESIS_REQUEST_ENABLE);
  CLAIM(streaming.go_on(200).axis[0].answer.spool_velocity[0] != 0);
  streaming.wanted.choice.law = 77;
  CLAIM(streaming.go_on(1).axis[0].answer.spool_velocity[0] != 0);
  streaming.wanted.choice.law = TENODESIS_LAW_OFF;
  // The spools return, as slowly as those of stopped motors.
  const Streamed got = streaming.go_on(200);
  CLAIM(got.tick.state == TENODESIS_ENABLED);
  for (const float sent : got.axis[0].answer.spool_velocity) CLAIM(std::fabs(sent) <= scaled_up.neutral_speed * 1.001F);
}

void a_law_chosen_while_it_runs_is_that_of_the_controller() {
  Running running;
  auto own = std::make_unique<tenodesis_controller>();
  tenodesis_init(own.get(), &scaled_up);
  Plant plant;
  int differing = 0;
  for (int tick = 0; tick < 600; ++tick) {
    const tenodesis_input input = plant.reading();
    tenodesis_output expected;
    if (tick == 300)
      CLAIM(tenodesis_choose(own.get(), TENODESIS_LAW_EXACT, TENODESIS_ACTUATION_AGONIST) == TENODESIS_OK);
    tenodesis_step(own.get(), &input, &expected);
    plant.follow(expected.axis[0].spool_velocity);
    if (tick < 300) continue;
    running.choice = {TENODESIS_LAW_EXACT, TENODESIS_ACTUATION_AGONIST};
    if (!same(running.go_on(), expected)) ++differing;
  }
  CLAIM(differing == 0);
}

void noise_never_moves_a_board() {
  Running running;
  Decoder decoder;
  for (const std::uint8_t byte : noise(1000000, 0.03))
    if (decoder.push(byte)) running.bench.endpoint().take(decoder, running.bench.now);
  CLAIM(decoder.damaged() > 10000);
  CLAIM(running.moves());
  CLAIM(running.go_on().tick.state == TENODESIS_ENABLED);
}

int main() {
  a_board_does_what_the_controller_does_and_nothing_twice();
  bad_questions_are_refused_and_change_nothing();
  a_silent_pc_stops_the_board_until_it_is_enabled_again();
  a_late_tick_stops_the_board_even_if_watch_was_not_called();
  a_stop_stops_and_a_clear_after_it_disables();
  a_board_with_sensors_continues_by_itself_until_the_pc_is_silent();
  a_request_that_is_repeated_with_every_tick_is_made_once();
  a_pc_that_wants_rest_gets_it_at_once_until_it_enables_again();
  the_law_is_that_of_the_last_tick_and_an_unknown_law_changes_nothing();
  a_law_chosen_while_it_runs_is_that_of_the_controller();
  noise_never_moves_a_board();
  return claims::report();
}

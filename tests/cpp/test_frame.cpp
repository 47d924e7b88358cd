// Claims about the link to a board: a frame comes through whole or not at all, whatever is done to its bytes; a board
// acts on no frame twice or late, and its controller does what it does without a link, to the last bit.

#include "tenodesis/frame.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <random>
#include <vector>

#include "../../firmware/endpoint.hpp"
#include "claim.hpp"
#include "scaled_up.h"

using namespace tenodesis::link;

using Stream = std::vector<std::uint8_t>;

struct Frame {
  Header header{};
  Stream payload;

  bool operator==(const Frame& other) const {
    return std::memcmp(&header, &other.header, sizeof header) == 0 && payload == other.payload;
  }
};

Stream encoded(const Frame& frame) {
  Stream bytes(encoded_size(frame.payload.size()));
  bytes.resize(encode(frame.header, frame.payload.data(), frame.payload.size(), bytes.data()));
  return bytes;
}

Frame frame_in(const Decoder& decoder) {
  return {decoder.header(), {decoder.payload(), decoder.payload() + decoder.size()}};
}

std::vector<Frame> decoded(Decoder& decoder, const Stream& bytes) {
  std::vector<Frame> found;
  for (const std::uint8_t byte : bytes)
    if (decoder.push(byte)) found.push_back(frame_in(decoder));
  return found;
}

Stream operator+(Stream one, const Stream& other) {
  one.insert(one.end(), other.begin(), other.end());
  return one;
}

/// Bytes of which a share is 0.
Stream noise(std::size_t count, double zeros) {
  static std::mt19937 random{7};  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  Stream bytes(count);
  for (auto& byte : bytes) {
    const bool zero = std::uniform_real_distribution<>(0, 1)(random) < zeros;
    byte = zero ? 0 : static_cast<std::uint8_t>(std::uniform_int_distribution<>(1, 255)(random));
  }
  return bytes;
}

Frame step_frame(std::uint32_t sequence = 3) {
  Step step{};
  step.time = 500000;
  step.axis[0] = {0.3F, {25.5F, 24.25F}, {0, -0.125F}};
  Frame frame{{protocol_version, Type::step, 0xBEEF, sequence}, Stream(size_with<Step>(1))};
  std::memcpy(frame.payload.data(), &step, size_with<Step>(1));
  return frame;
}

void the_check_is_the_published_one() {
  // Check value of CRC-32/ISO-HDLC in the catalogue of parametrised CRC algorithms.
  const auto* digits = reinterpret_cast<const std::uint8_t*>("123456789");
  CLAIM(crc(digits, 9) == 0xCBF43926U);
  CLAIM(crc(digits + 4, 5, crc(digits, 4)) == 0xCBF43926U);
}

void every_payload_comes_through() {
  Decoder decoder;
  bool all = true;
  bool bare = true;
  for (std::size_t size = 0; size <= most_payload; ++size) {
    for (const double zeros : {0.0, 0.01, 0.5, 1.0}) {
      const Frame frame{{protocol_version, Type::output, 0, static_cast<std::uint32_t>(size)}, noise(size, zeros)};
      const Stream bytes = encoded(frame);
      bare = bare && std::ranges::count(bytes, 0) == 2 && bytes.front() == 0 && bytes.back() == 0;
      const auto found = decoded(decoder, bytes);
      all = all && found.size() == 1 && found[0] == frame;
    }
  }
  CLAIM(all);
  CLAIM(bare);
  CLAIM(decoder.damaged() == 0);
}

void the_frame_after_garbage_comes_through() {
  Decoder decoder;
  const Frame frame = step_frame();
  int lost = 0;
  int invented = 0;
  for (int run = 0; run < 2000; ++run) {
    const auto found = decoded(decoder, noise(std::size_t(run), 0.02) + encoded(frame));
    if (found.empty() || !(found.back() == frame)) ++lost;
    if (found.size() > 1) ++invented;
  }
  CLAIM(lost == 0);
  CLAIM(invented == 0);
  CLAIM(decoder.damaged() > 2000);
}

void a_frame_cut_short_is_dropped_and_the_next_is_not() {
  const Frame first = step_frame(1);
  const Frame second = step_frame(2);
  const Stream bytes = encoded(first);
  bool all = true;
  for (std::size_t size = 2; size + 1 < bytes.size(); ++size) {
    Decoder decoder;
    const Stream start(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(size));
    const auto found = decoded(decoder, start + encoded(second));
    all = all && found.size() == 1 && found[0] == second && decoder.damaged() == 1;
  }
  CLAIM(all);
}

// Flips bits of a frame between two others; of what comes out, how many are none of the three.
int strangers_with_flips(const std::vector<Frame>& sent, const Stream& bytes, std::size_t one, std::size_t other) {
  Stream flipped = bytes;
  flipped[one / 8] ^= static_cast<std::uint8_t>(1U << (one % 8));
  if (other != one) flipped[other / 8] ^= static_cast<std::uint8_t>(1U << (other % 8));
  Decoder decoder;
  int strangers = 0;
  for (const Frame& found : decoded(decoder, flipped))
    if (std::ranges::find(sent, found) == sent.end()) ++strangers;
  return strangers;
}

void no_frame_with_flipped_bits_is_taken() {
  const std::vector<Frame> sent{step_frame(1), step_frame(0x01000000), step_frame(3)};
  const Stream before = encoded(sent[0]);
  const Stream bytes = before + encoded(sent[1]) + encoded(sent[2]);
  const std::size_t begin = before.size() * 8;
  const std::size_t end = begin + encoded(sent[1]).size() * 8;
  int single = 0;
  int twice = 0;
  for (std::size_t one = begin; one < end; ++one) {
    single += strangers_with_flips(sent, bytes, one, one);
    for (std::size_t other = one + 1; other < end; ++other) twice += strangers_with_flips(sent, bytes, one, other);
  }
  CLAIM(single == 0);
  CLAIM(twice == 0);
}

void a_frame_too_long_is_dropped() {
  Decoder decoder;
  const Frame frame = step_frame();
  for (const std::size_t size : {encoded_size(most_payload) + 1, std::size_t(100000)}) {
    const auto found = decoded(decoder, Stream{0} + noise(size, 0) + encoded(frame));
    CLAIM(found.size() == 1 && found[0] == frame);
  }
  CLAIM(decoder.damaged() == 2);
}

void sequences_go_round() {
  CLAIM(after(1, 0) && !after(0, 1) && !after(5, 5));
  CLAIM(after(0, 0xFFFFFFFFU) && !after(0xFFFFFFFFU, 0));
}

/// A PC at one end and a board at the other, with a line that does what it is told.
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
    std::memcpy(&upload.controller, &parameters, sizeof parameters);
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

/// What the sensors of an instrument say whose spools follow, and whose first tick enables it.
class Plant {
 public:
  static constexpr int bad_tick = 700;

  tenodesis_input reading() {
    tenodesis_input input{};
    input.time = 1000U + static_cast<std::uint64_t>(tick_) * 500000U;
    input.request = tick_ == 0 ? TENODESIS_REQUEST_ENABLE : TENODESIS_REQUEST_NONE;
    auto& one = input.axis[0];
    one.handle_angle = 0.3F * float(std::sin(tick_ * 0.004));
    for (int i = 0; i < 2; ++i) {
      const float load = i == 0 ? 3 : -3;
      const float flicker = tick_ % 2 == 0 ? 0.03F : -0.03F;
      one.tension[i] = 25 + load + flicker + stiffness * radius * spool_[i];
      one.spool_angle[i] = spool_[i];
    }
    if (tick_ == bad_tick) one.tension[0] = std::numeric_limits<float>::quiet_NaN();
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

bool same(const Output& one, const tenodesis_output& other) {
  const auto& axis = other.axis[0];
  return std::memcmp(&one.axis[0], &axis, offsetof(tenodesis_axis_output, reserved)) == 0 &&
         one.tick.state == other.state && one.tick.faults == other.faults &&
         one.tick.first_faults == other.first_faults &&
         (one.tick.flags & (homed | homing)) == (other.homed != 0 ? homed : 0U) + (other.homing != 0 ? homing : 0U);
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
    // Once more, as if its answer had been lost; and then one that was held up on the way.
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

void what_is_not_allowed_is_refused_and_changes_nothing() {
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

void a_silent_pc_stops_the_board_until_it_is_asked_to_go_on() {
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

void a_late_tick_stops_the_board_even_if_nobody_looked() {
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

void a_board_with_sensors_goes_on_by_itself_until_the_pc_is_silent() {
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

void a_request_that_is_said_with_every_tick_is_made_once() {
  Streaming streaming;
  streaming.ask(TENODESIS_REQUEST_ENABLE);
  const Frame before = streaming.keep();
  CLAIM(streaming.ask(TENODESIS_REQUEST_PAUSE).tick.state == TENODESIS_PAUSED);
  // What comes twice or late is not heard, and the same number is the same request.
  streaming.bench.ask(before);
  CLAIM(streaming.go_on(10).tick.state == TENODESIS_PAUSED);
  streaming.wanted.request = TENODESIS_REQUEST_RESUME;
  CLAIM(streaming.go_on(10).tick.state == TENODESIS_PAUSED);
  CLAIM(streaming.ask(TENODESIS_REQUEST_RESUME).tick.state == TENODESIS_ENABLED);
}

void a_pc_that_wants_rest_gets_it_at_once_and_until_it_enables_again() {
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

void the_law_is_that_of_the_last_tick_and_one_that_there_is_not_changes_nothing() {
  Streaming streaming;
  streaming.ask(TENODESIS_REQUEST_ENABLE);
  CLAIM(streaming.go_on(200).axis[0].answer.spool_velocity[0] != 0);
  streaming.wanted.choice.law = 77;
  CLAIM(streaming.go_on(1).axis[0].answer.spool_velocity[0] != 0);
  streaming.wanted.choice.law = TENODESIS_LAW_OFF;
  const Streamed got = streaming.go_on(200);
  CLAIM(got.tick.state == TENODESIS_ENABLED && streaming.rests());
}

void a_law_chosen_on_the_way_is_that_of_the_controller() {
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
  the_check_is_the_published_one();
  every_payload_comes_through();
  the_frame_after_garbage_comes_through();
  a_frame_cut_short_is_dropped_and_the_next_is_not();
  no_frame_with_flipped_bits_is_taken();
  a_frame_too_long_is_dropped();
  sequences_go_round();
  a_board_does_what_the_controller_does_and_nothing_twice();
  what_is_not_allowed_is_refused_and_changes_nothing();
  a_silent_pc_stops_the_board_until_it_is_asked_to_go_on();
  a_late_tick_stops_the_board_even_if_nobody_looked();
  a_stop_stops_and_a_clear_after_it_disables();
  a_board_with_sensors_goes_on_by_itself_until_the_pc_is_silent();
  a_request_that_is_said_with_every_tick_is_made_once();
  a_pc_that_wants_rest_gets_it_at_once_and_until_it_enables_again();
  the_law_is_that_of_the_last_tick_and_one_that_there_is_not_changes_nothing();
  a_law_chosen_on_the_way_is_that_of_the_controller();
  noise_never_moves_a_board();
  return claims::report();
}

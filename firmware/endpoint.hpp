#pragma once
// The board's side of the link: frames in, an answer to each, and a controller that acts on no frame twice. Independent
// of lines, clocks and motors, so that it runs on any board, and on a PC under test.

#include "tenodesis/frame.hpp"
#include "tenodesis/tenodesis.h"

namespace tenodesis::link {

static_assert(sizeof(tenodesis_real) == sizeof(float), "what is sent is float");
static_assert(sizeof(tenodesis_parameters) == sizeof(ControllerParameters) && most_axes == TENODESIS_AXES);
static_assert(TENODESIS_LAW_ROBUST < 0x10000 && TENODESIS_ACTUATION_DIFFERENTIAL < 0x10000);
static_assert(sizeof(Counted) == sizeof(tenodesis_counts) && sizeof(Measured) == sizeof(tenodesis_measurement));

/// Bytes to send; may be none.
struct Bytes {
  const std::uint8_t* data{};
  std::size_t size{};
};

class Endpoint {
 public:
  /// clock: of the processor, Hz.
  constexpr Endpoint(const char* name, std::uint32_t clock, bool sensors) : clock_(clock), sensors_(sensors) {
    for (int k = 0; k < 31 && name[k] != 0; ++k) name_[k] = name[k];
  }

  /// Takes a frame, at a time by the board's clock, ns. The answer is valid until the next call of any kind.
  Bytes take(const Decoder& frame, std::uint64_t now) {
    const Header header = frame.header();
    damaged_ = frame.damaged();
    if (header.version != protocol_version) return refuse(header, Refusal::wrong_version, protocol_version);
    if (header.type == Type::hello) return introduce(header);
    const bool begins = header.type == Type::parameters;
    // The last action again: its answer was lost.
    if (header.sequence == kept_ && header.session == session_ && session_ != 0) return answer_;
    if (!begins && (session_ == 0 || header.session != session_)) return refuse(header, Refusal::no_session, session_);
    if (!after(header.sequence, kept_)) return {};
    return act(header, frame, now);
  }

  /// Stops if the PC has been silent for too long; to be called between frames.
  void watch(std::uint64_t now) {
    const std::uint64_t silence = now - heard_;
    const bool late = silence_ == 0 ? tenodesis_watchdog(&controller_, silence) == 1 : silence > silence_;
    if (session_ != 0 && late) hold(silent);
  }

  bool streams() const { return streaming_; }
  /// Between ticks of a board that streams, s.
  float period() const { return period_; }

  /// A tick of a board that streams, with its measurements.
  Bytes tick(const tenodesis_measurement (&measured)[most_axes], std::uint64_t now) {
    Step step{now, request_, choice_, {}};
    __builtin_memcpy(step.axis, measured, sizeof step.axis);
    request_ = TENODESIS_REQUEST_NONE;
    const Output output = run(step);
    Streamed streamed{kept_, number_, output.tick, {}};
    for (int n = 0; n < axes_; ++n) streamed.axis[n] = {step.axis[n], output.axis[n]};
    const Header header{protocol_version, Type::streamed, session_, ++ticks_};
    return {streamed_, encode(header, &streamed, size_with<Streamed>(axes_), streamed_)};
  }

  /// Velocity to be sent to a motor now, rad/s.
  float velocity(int axis, int tendon) const { return resting_ ? 0.0F : sent_[axis][tendon]; }
  /// Whether a relay in the motors' supply must open, since one of them does not obey.
  bool cut_power() const { return cut_power_; }

  /// Sets the ticks of the clock that the last frame took, for the next answer.
  void took(std::uint32_t ticks) { busy_ = ticks; }

 private:
  Bytes act(const Header& header, const Decoder& frame, std::uint64_t now) {
    switch (header.type) {
      case Type::parameters:
        return begin(header, frame, now);
      case Type::step:
        if (frame.size() != size_with<Step>(axes_)) break;
        return step(header, frame, now);
      case Type::reset:
        tenodesis_reset(&controller_);
        streaming_ = false;
        held_ = 0;
        rest(TENODESIS_DISABLED);
        heard_ = now;
        return answer(header, Type::done, nullptr, 0);
      case Type::counts:
        return count(header, frame);
      case Type::stop:
        streaming_ = false;
        hold(halted);
        resting_ = true;
        return answer(header, Type::done, nullptr, 0);
      case Type::stream:
        if (!sensors_) return refuse(header, Refusal::no_sensors, 0);
        streaming_ = true;
        number_ = 0;
        ticks_ = 0;
        heard_ = now;
        return answer(header, Type::done, nullptr, 0);
      case Type::keep:
        if (frame.size() != sizeof(Keep)) break;
        watch(now);
        heard_ = now;
        keep(frame.message<Keep>());
        kept_ = header.sequence;
        answer_ = {};
        return {};
      default:
        return refuse(header, Refusal::unknown_type, static_cast<std::uint32_t>(header.type));
    }
    return refuse(header, Refusal::bad_size, static_cast<std::uint32_t>(frame.size()));
  }

  Bytes introduce(const Header& header) {
    Board board{TENODESIS_VERSION,
                sizeof(tenodesis_real),
                sizeof(tenodesis_parameters),
                most_axes,
                session_,
                kept_,
                clock_,
                sensors_ ? 1U : 0U,
                {}};
    __builtin_memcpy(board.name, name_, sizeof name_);
    return aside(header, Type::board, &board, sizeof board);
  }

  Bytes begin(const Header& header, const Decoder& frame, std::uint64_t now) {
    if (frame.size() != sizeof(Parameters) || header.session == 0)
      return refuse(header, Refusal::bad_size, static_cast<std::uint32_t>(frame.size()));
    rest(TENODESIS_DISABLED);
    streaming_ = false;
    held_ = 0;
    session_ = 0;
    tenodesis_parameters parameters;
    __builtin_memcpy(&parameters, frame.payload() + offsetof(Parameters, controller), sizeof parameters);
    const int found = tenodesis_init(&controller_, &parameters);
    if (found != TENODESIS_OK) return refuse(header, Refusal::bad_parameters, static_cast<std::uint32_t>(found));
    choice_ = {static_cast<std::uint16_t>(parameters.law), static_cast<std::uint16_t>(parameters.actuation)};
    chosen_ = choice_;
    axes_ = static_cast<int>(parameters.axes);
    period_ = parameters.period;
    silence_ = std::uint64_t(frame.message<std::uint32_t>()) * 1000000U;
    session_ = header.session;
    heard_ = now;
    request_ = TENODESIS_REQUEST_NONE;
    return answer(header, Type::done, nullptr, 0);
  }

  void keep(const Keep& wanted) {
    if (wanted.number != number_) request_ = wanted.request;
    number_ = wanted.number;
    choice_ = wanted.choice;
    if (wanted.rest != 0) hold(halted);
  }

  Bytes step(const Header& header, const Decoder& frame, std::uint64_t now) {
    watch(now);
    heard_ = now;
    const Output output = run(frame.message<Step>());
    return answer(header, Type::output, &output, size_with<Output>(axes_));
  }

  Output run(const Step& step) {
    tenodesis_input input{};
    input.time = step.time;
    input.request = held_ == 0 ? step.request : without_power(step.request);
    __builtin_memcpy(input.axis, step.axis, sizeof input.axis);
    if (step.choice != chosen_) tenodesis_choose(&controller_, step.choice.law, step.choice.actuation);
    chosen_ = step.choice;
    tenodesis_output got;
    tenodesis_step(&controller_, &input, &got);
    if (got.state == TENODESIS_ENABLED) resting_ = false;
    Output output{{step.time, got.state, held_, got.faults, got.first_faults, busy_, damaged_}, {}};
    cut_power_ = got.cut_power != 0;
    output.tick.flags |= (got.homed != 0 ? homed : 0U) | (got.homing != 0 ? homing : 0U) | (resting_ ? stopped : 0U) |
                         (cut_power_ ? link::cut_power : 0U);
    held_ = 0;
    state_ = got.state;
    for (int n = 0; n < axes_; ++n) {
      const tenodesis_axis_output& from = got.axis[n];
      for (int i = 0; i < 2; ++i) sent_[n][i] = from.spool_velocity[i];
      output.axis[n] = {{velocity(n, 0), velocity(n, 1)},
                        from.output_angle,
                        from.output_angle_std,
                        from.tip_force,
                        from.tip_force_std,
                        from.friction_scale,
                        from.friction_scale_std,
                        from.faults,
                        static_cast<std::uint16_t>(tenodesis_phase(&controller_, n)),
                        static_cast<std::uint16_t>(from.homing_failure)};
    }
    return output;
  }

  // A controller that was stopped only takes requests that move no motor.
  std::uint32_t without_power(std::uint32_t request) const {
    if (request == TENODESIS_REQUEST_CLEAR && state_ == TENODESIS_FAULT) return request;
    const bool off = request == TENODESIS_REQUEST_DISABLE || request == TENODESIS_REQUEST_CLEAR;
    return off ? TENODESIS_REQUEST_DISABLE : TENODESIS_REQUEST_PAUSE;
  }

  // At rest from now on; the controller pauses with its next tick. A disabled controller has nothing to stop.
  void hold(std::uint32_t why) {
    if (resting_ || state_ == TENODESIS_DISABLED) return;
    held_ = why;
    resting_ = true;
  }

  void rest(std::uint32_t state) {
    state_ = state;
    resting_ = cut_power_ = false;
    for (auto& axis : sent_) axis[0] = axis[1] = 0;
  }

  Bytes count(const Header& header, const Decoder& frame) {
    const auto number = frame.message<std::uint32_t>();
    const auto axis = static_cast<int>(number);
    tenodesis_counts counts;
    if (frame.size() != sizeof number)
      return refuse(header, Refusal::bad_size, static_cast<std::uint32_t>(frame.size()));
    if (axis < 0 || axis >= axes_) return refuse(header, Refusal::no_such_axis, number);
    tenodesis_read_counts(&controller_, axis, &counts);
    return answer(header, Type::counted, &counts, sizeof counts);
  }

  // An action's answer, kept for a repetition.
  Bytes answer(const Header& header, Type type, const void* payload, std::size_t size) {
    kept_ = header.sequence;
    const Header own{protocol_version, type, header.session, header.sequence};
    answer_ = {answered_, encode(own, payload, size, answered_)};
    return answer_;
  }

  // An answer that is no action's.
  Bytes aside(const Header& header, Type type, const void* payload, std::size_t size) {
    const Header own{protocol_version, type, header.session, header.sequence};
    return {aside_, encode(own, payload, size, aside_)};
  }

  Bytes refuse(const Header& header, Refusal why, std::uint32_t detail) {
    const Refused refused{why, detail};
    return aside(header, Type::refused, &refused, sizeof refused);
  }

  tenodesis_controller controller_{};
  std::uint32_t clock_;
  bool sensors_;
  char name_[32]{};
  std::uint16_t session_{};
  std::uint32_t kept_{};  // sequence of the last action
  int axes_{};
  float period_{};
  std::uint64_t silence_{};  // ns; 0: by the controller's own watchdog
  std::uint64_t heard_{};    // when the last tick or keep came, ns
  std::uint32_t state_{};
  std::uint32_t held_{};  // why the controller pauses with its next tick
  bool resting_{};        // motors, until the controller is enabled again
  bool cut_power_{};
  float sent_[most_axes][2]{};
  bool streaming_{};
  std::uint32_t request_{};  // to be made with the next tick of a board that streams,
  std::uint32_t number_{};   // and the PC's number of it
  Choice choice_{};          // of the PC
  Choice chosen_{};          // that the controller has
  std::uint32_t ticks_{};
  std::uint32_t busy_{};
  std::uint32_t damaged_{};
  Bytes answer_{};
  std::uint8_t answered_[encoded_size(sizeof(Output))]{};
  std::uint8_t aside_[encoded_size(sizeof(Board))]{};
  std::uint8_t streamed_[encoded_size(sizeof(Streamed))]{};
};

}  // namespace tenodesis::link

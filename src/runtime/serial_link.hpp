#pragma once
// The PC's side of the link to a board: questions, answers, and the problems of the link.

#include <algorithm>
#include <array>
#include <atomic>
#include <mutex>
#include <optional>
#include <random>
#include <string>

#include "engine/any_controller.hpp"
#include "serial_line.hpp"

namespace tenodesis::runtime {

/// What has gone wrong with a board; the first problem stays until the link is set up again.
enum class LinkProblem : unsigned char {
  none,
  link_lost,        ///< no answer in time
  link_closed,      ///< the other end of the line was closed
  damaged_frames,   ///< too many in a row
  stale_answers,    ///< only answers to earlier questions
  wrong_version,    ///< another version of the protocol, or of the C interface
  board_restarted,  ///< the board does not know the session
  refused,          ///< the board refused a question
  wrong_tick,       ///< the answer is another tick's
  bad_answer,       ///< of a wrong size, or with an unknown state
  not_a_number,     ///< a velocity is not a number
  beyond_limit,     ///< a velocity is above the instrument's speed limit
};

struct LinkSettings {
  double timeout{};          ///< of a question with all its repetitions, s
  double connect_timeout{};  ///< the same while a session is set up, s
  int repetitions{};         ///< of a question whose answer is lost or damaged
  std::uint32_t silence{};   ///< see link::Parameters
};

struct LinkCounts {
  std::uint64_t answers{};        ///< used
  std::uint64_t repetitions{};    ///< questions sent again
  std::uint64_t damaged{};        ///< frames dropped here
  std::uint64_t stale{};          ///< answers to earlier or others' questions
  std::uint64_t board_damaged{};  ///< frames that the board has dropped
};

class SerialLink {
 public:
  SerialLink(int descriptor, const LinkSettings& settings) : line_(descriptor), settings_(settings) {}

  /// Starts a new session with these parameters.
  bool start(const link::ControllerParameters& controller) {
    problem_ = LinkProblem::none;
    if (!hello(settings_.connect_timeout)) return false;
    session_ = other_than(board_.session);
    const link::Parameters parameters{settings_.silence, 0, controller};
    return ask(link::Type::parameters, &parameters, sizeof parameters, link::Type::done, 0, settings_.connect_timeout);
  }

  /// After a problem: continues the session where the board still has it, with its motors stopped.
  bool resume(const link::ControllerParameters& controller) {
    problem_ = LinkProblem::none;
    if (!hello(settings_.timeout)) return false;
    if (board_.session != session_) return start(controller);
    return ask(link::Type::stop, nullptr, 0, link::Type::done, 0);
  }

  bool ask(link::Type question, const void* payload, std::size_t size, link::Type answer, std::size_t answer_size) {
    return ask(question, payload, size, answer, answer_size, settings_.timeout);
  }

  /// Sends a message that is not answered, and returns its number. What the line cannot take at once is lost.
  std::uint32_t notify(link::Type type, const void* payload, std::size_t size) {
    send({link::protocol_version, type, session_, ++sequence_}, payload, size, SerialLine::Clock::now());
    return sequence_;
  }

  /// Requests the board to send its ticks, of so many bytes, from now on.
  bool start_streaming(std::size_t tick_size) {
    tick_size_ = tick_size;
    early_count_ = 0;
    note_received();
    return ask(link::Type::stream, nullptr, 0, link::Type::done, 0);
  }

  /// The next tick that the board sends by itself, and its number, one above `last` if none was lost; false where none
  /// has come until then, or the link has failed.
  bool receive(link::Streamed& streamed, std::uint32_t& number, std::uint32_t last, SerialLine::Moment until) {
    for (std::size_t k = 0; k < early_count_; ++k) {
      if (!link::after(early_[k].number, last)) continue;
      number = early_[k].number;
      streamed = early_[k].tick;
      return true;
    }
    early_count_ = 0;
    for (;;) {
      switch (line_.receive(decoder_, until)) {
        case Found::nothing:
          return keep_waiting();
        case Found::closed:
          return fail(LinkProblem::link_closed, "the line's other end was closed");
        case Found::damaged:
          ++counts_.damaged;
          if (++damaged_in_a_row_ > most_damaged)
            return fail(LinkProblem::damaged_frames,
                        std::to_string(damaged_in_a_row_) + " frames came damaged and no tick intact");
          break;
        case Found::frame:
          if (is_tick() && link::after(decoder_.header().sequence, last)) {
            note_received();
            ++counts_.answers;
            number = decoder_.header().sequence;
            streamed = message<link::Streamed>();
            return true;
          }
          if (!is_acceptable()) return false;
      }
      if (SerialLine::Clock::now() >= until) return keep_waiting();
    }
  }

  /// The last answer.
  template <class Message>
  Message message() const {
    return decoder_.message<Message>();
  }

  bool fail(LinkProblem problem, const std::string& why) {
    const std::scoped_lock guard(why_mutex_);
    problem_ = problem;
    why_ = why;
    return false;
  }

  /// Sends a stop, without waiting for its answer, and closes the line.
  void close() {
    if (!line_.is_open()) return;
    send({link::protocol_version, link::Type::stop, session_, ++sequence_}, nullptr, 0, moment(settings_.timeout));
    line_.close();
    fail(LinkProblem::link_closed, "the link was closed");
  }

  LinkProblem problem() const { return problem_; }
  /// What is known of the problem; by any thread, also while an answer is waited for.
  std::string why() const {
    const std::scoped_lock guard(why_mutex_);
    return why_;
  }
  const link::Board& board() const { return board_; }
  LinkCounts& counts() { return counts_; }

 private:
  using Found = SerialLine::Found;
  using Moment = SerialLine::Moment;

  static Moment moment(double seconds) {
    return SerialLine::Clock::now() + std::chrono::nanoseconds(static_cast<std::int64_t>(seconds * 1e9));
  }

  static std::uint16_t other_than(std::uint32_t session) {
    std::random_device random;
    std::uniform_int_distribution<std::uint16_t> any(1, 0xFFFF);
    std::uint16_t chosen = any(random);
    while (chosen == session) chosen = any(random);
    return chosen;
  }

  void note_received() {
    received_at_ = SerialLine::Clock::now();
    damaged_in_a_row_ = 0;
  }

  bool is_tick() const {
    const link::Header got = decoder_.header();
    return got.version == link::protocol_version && got.type == link::Type::streamed && got.session == session_ &&
           decoder_.size() == tick_size_;
  }

  // Without a tick: false, and a problem after the timeout.
  bool keep_waiting() {
    const double silent = std::chrono::duration<double>(SerialLine::Clock::now() - received_at_).count();
    if (silent <= settings_.timeout) return false;
    return fail(LinkProblem::link_lost, "the board has sent no tick for " + std::to_string(silent) + " s");
  }

  // A frame that is no new tick: an earlier tick, an answer that is not expected, or a board that has another session.
  bool is_acceptable() {
    const link::Header got = decoder_.header();
    if (got.version != link::protocol_version) return another_version(std::to_string(got.version));
    if (got.type == link::Type::refused && got.session == session_) return refuse(message<link::Refused>());
    if (got.session != session_)
      return fail(LinkProblem::board_restarted,
                  "the board answers another session: it was restarted, or another program has begun one");
    if (got.type == link::Type::streamed && decoder_.size() != tick_size_)
      return fail(LinkProblem::bad_answer, "the board sent a tick of " + std::to_string(decoder_.size()) + " bytes");
    ++counts_.stale;
    return true;
  }

  // A tick that comes while an answer is waited for is kept for the next call of receive.
  bool keep_early() {
    if (!is_tick()) return false;
    if (early_count_ < early_.size()) early_[early_count_++] = {decoder_.header().sequence, message<link::Streamed>()};
    return true;
  }

  bool send(const link::Header& header, const void* payload, std::size_t size, Moment until) {
    const std::size_t encoded = link::encode(header, payload, size, sent_.data());
    return line_.send({sent_.data(), encoded}, until);
  }

  // With a random number, so that the answer to an earlier hello is not taken for its own.
  bool hello(double timeout) {
    const std::uint32_t number = std::random_device{}();
    const link::Header header{link::protocol_version, link::Type::hello, 0, number};
    if (!converse(header, nullptr, 0, link::Type::board, sizeof(link::Board), timeout)) return false;
    board_ = message<link::Board>();
    board_.name[sizeof board_.name - 1] = 0;
    sequence_ = board_.last_sequence;
    if (board_.real_size != sizeof(float) || board_.parameters_size != sizeof(link::ControllerParameters) ||
        board_.interface_version != interface_version)
      return fail(LinkProblem::wrong_version, "the board has version " + std::to_string(board_.interface_version) +
                                                  " of the C interface with reals of " +
                                                  std::to_string(board_.real_size) + " bytes; it must be version " +
                                                  std::to_string(interface_version) + " with 4 bytes");
    return true;
  }

  bool ask(link::Type question, const void* payload, std::size_t size, link::Type answer, std::size_t answer_size,
           double timeout) {
    const link::Header header{link::protocol_version, question, session_, ++sequence_};
    return converse(header, payload, size, answer, answer_size, timeout);
  }

  // Frames that came while one answer was waited for.
  struct Useless {
    int damaged{};
    int stale{};
  };

  // Repeats a message until there is an answer; the board recognises a repetition by its sequence number.
  bool converse(const link::Header& header, const void* payload, std::size_t size, link::Type answer,
                std::size_t answer_size, double timeout) {
    const int attempts = settings_.repetitions + 1;
    const Moment end = moment(timeout);
    Useless useless;
    for (int attempt = 1; attempt <= attempts; ++attempt) {
      if (attempt > 1) ++counts_.repetitions;
      const bool last = attempt == attempts;
      const Moment until = last ? end : std::min(end, moment(timeout / attempts));
      send(header, payload, size, until);
      switch (await(header, until, last, useless)) {
        case Found::frame:
          return judge(header, answer, answer_size);
        case Found::closed:
          return fail(LinkProblem::link_closed, "the line's other end was closed");
        case Found::damaged:
        case Found::nothing:
          break;
      }
      if (useless.damaged > most_damaged) break;
    }
    const std::string asked = name_of(header.type) + ", in " + std::to_string(attempts) + " attempts within " +
                              std::to_string(timeout) + " s";
    if (useless.damaged > 0)
      return fail(LinkProblem::damaged_frames,
                  std::to_string(useless.damaged) + " damaged frames came and no intact answer to " + asked);
    if (useless.stale >= attempts)
      return fail(LinkProblem::stale_answers,
                  std::to_string(useless.stale) + " answers to earlier messages came and none to " + asked);
    return fail(LinkProblem::link_lost, "the board did not answer " + asked);
  }

  // The frame that answers, or why there is none; a damaged frame may have been the answer, so that the question is
  // repeated.
  Found await(const link::Header& header, Moment until, bool last, Useless& useless) {
    for (;;) {
      const Found found = line_.receive(decoder_, until);
      if (found == Found::damaged) {
        ++counts_.damaged;
        if (++useless.damaged > most_damaged || !last) return found;
      } else if (found == Found::frame && keep_early()) {
        continue;
      } else if (found != Found::frame || answers(header)) {
        return found;
      } else {
        ++counts_.stale;
        ++useless.stale;
      }
    }
  }

  bool answers(const link::Header& header) const {
    const link::Header got = decoder_.header();
    return got.version != link::protocol_version || (got.session == header.session && got.sequence == header.sequence);
  }

  bool judge(const link::Header& header, link::Type answer, std::size_t answer_size) {
    const link::Header got = decoder_.header();
    if (got.version != link::protocol_version) return another_version(std::to_string(got.version));
    if (got.type == link::Type::refused) return refuse(message<link::Refused>());
    if (got.type != answer || decoder_.size() != answer_size)
      return fail(LinkProblem::bad_answer, "the board answered " + name_of(header.type) + " with a frame of type " +
                                               std::to_string(static_cast<int>(got.type)) + " and " +
                                               std::to_string(decoder_.size()) + " bytes");
    ++counts_.answers;
    return true;
  }

  bool another_version(const std::string& version) {
    return fail(LinkProblem::wrong_version, "the board has version " + version + " of the protocol; it must be " +
                                                std::to_string(link::protocol_version));
  }

  bool refuse(const link::Refused& refused) {
    const std::string detail = std::to_string(refused.detail);
    switch (refused.why) {
      case link::Refusal::wrong_version:
        return another_version(detail);
      case link::Refusal::no_session:
        return fail(LinkProblem::board_restarted,
                    "the board does not know this session: it was restarted, or another "
                    "program has begun one");
      case link::Refusal::no_sensors:
        return fail(LinkProblem::refused, "the board measures nothing by itself");
      case link::Refusal::bad_parameters:
        return fail(LinkProblem::refused,
                    "the board cannot make a controller from the parameters (code " + detail + ")");
      default:
        return fail(LinkProblem::refused, "the board refused (" +
                                              std::to_string(static_cast<std::uint32_t>(refused.why)) + ", detail " +
                                              detail + ")");
    }
  }

  static std::string name_of(link::Type question) {
    switch (question) {
      case link::Type::hello:
        return "a hello";
      case link::Type::parameters:
        return "the upload of parameters";
      case link::Type::step:
        return "a tick";
      default:
        return "a question of type " + std::to_string(static_cast<int>(question));
    }
  }

  static constexpr std::uint32_t interface_version = TENODESIS_VERSION;
  static constexpr int most_damaged = 20;  // frames, while one answer is waited for

  SerialLine line_;
  LinkSettings settings_;
  link::Decoder decoder_{};
  link::Board board_{};
  std::uint16_t session_{};
  std::uint32_t sequence_{};
  std::atomic<LinkProblem> problem_{LinkProblem::none};
  mutable std::mutex why_mutex_;
  std::string why_;
  LinkCounts counts_{};
  struct Early {
    std::uint32_t number{};
    link::Streamed tick{};
  };
  std::array<Early, 64> early_{};  // ticks that came while an answer was waited for
  std::size_t early_count_{};
  std::size_t tick_size_{};
  SerialLine::Moment received_at_;
  int damaged_in_a_row_{};
  std::array<std::uint8_t, link::encoded_size(link::most_payload)> sent_{};
};

}  // namespace tenodesis::runtime

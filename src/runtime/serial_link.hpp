#pragma once
// The PC's side of the link to a board: questions, their answers, and what has gone wrong between.

#include <algorithm>
#include <array>
#include <atomic>
#include <mutex>
#include <optional>
#include <random>
#include <string>

#include "../bindings/any_controller.hpp"
#include "serial_line.hpp"

namespace tenodesis::runtime {

/// What has gone wrong with a board; the first of them stays until the link is set up anew.
enum class LinkProblem : unsigned char {
  none,
  link_lost,        ///< no answer in time
  link_closed,      ///< the line's other end has gone
  damaged_frames,   ///< more than are bearable in a row
  stale_answers,    ///< answers of the past only
  wrong_version,    ///< another version of the protocol, or of the C interface
  board_restarted,  ///< it does not know the session
  refused,          ///< it says that it cannot
  wrong_tick,       ///< the answer is another tick's
  bad_answer,       ///< of a size or with a state that there is not
  not_a_number,     ///< a velocity
  beyond_limit,     ///< a velocity above the instrument's speed limit
};

inline constexpr std::array link_problem_names{
    "",        "link_lost",  "link_closed", "damaged_frames", "stale_answers", "wrong_version", "board_restarted",
    "refused", "wrong_tick", "bad_answer",  "not_a_number",   "beyond_limit"};

struct LinkSettings {
  double timeout{};          ///< of a question with all its repetitions, s
  double connect_timeout{};  ///< the same while a session is set up, s
  int repetitions{};         ///< of a question whose answer is lost or damaged
  std::uint32_t silence{};   ///< see link::Parameters
};

struct LinkCounts {
  std::uint64_t answers{};        ///< that were used
  std::uint64_t repetitions{};    ///< questions asked again
  std::uint64_t damaged{};        ///< frames dropped here
  std::uint64_t stale{};          ///< answers to what was asked before, or by others
  std::uint64_t board_damaged{};  ///< frames that the board has dropped
};

using Image = std::array<std::uint8_t, link::parameters_size>;

class SerialLink {
 public:
  SerialLink(int descriptor, const LinkSettings& settings) : line_(descriptor), settings_(settings) {}

  /// Sets a session up with these parameters, whatever went before.
  bool start(const Image& image) {
    problem_ = LinkProblem::none;
    if (!hello(settings_.connect_timeout)) return false;
    session_ = other_than(board_.session);
    link::Parameters parameters{};
    parameters.silence = settings_.silence;
    std::ranges::copy(image, std::begin(parameters.image));
    return ask(link::Type::parameters, &parameters, sizeof parameters, link::Type::done, 0, settings_.connect_timeout);
  }

  /// After a problem: goes on with the session where the board still has it, its motors stopped.
  bool resume(const Image& image) {
    problem_ = LinkProblem::none;
    if (!hello(settings_.timeout)) return false;
    if (board_.session != session_) return start(image);
    return ask(link::Type::stop, nullptr, 0, link::Type::done, 0);
  }

  bool ask(link::Type question, const void* payload, std::size_t size, link::Type answer, std::size_t answer_size) {
    return ask(question, payload, size, answer, answer_size, settings_.timeout);
  }

  /// Says something that is not answered, and returns its number. What the line cannot take at once is lost.
  std::uint32_t tell(link::Type what, const void* payload, std::size_t size) {
    send({link::protocol_version, what, session_, ++sequence_}, payload, size, SerialLine::Clock::now());
    return sequence_;
  }

  /// Has the board send its ticks, of so many bytes, from now on.
  bool listen(std::size_t tick_size) {
    tick_size_ = tick_size;
    early_count_ = 0;
    heard();
    return ask(link::Type::stream, nullptr, 0, link::Type::done, 0);
  }

  /// The next tick that the board sends by itself, and its number, one above `last` if none was lost; false where none
  /// has come until then, or the link has failed.
  bool hear(link::Streamed& streamed, std::uint32_t& number, std::uint32_t last, SerialLine::Moment until) {
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
          return wait_on();
        case Found::closed:
          return fail(LinkProblem::link_closed, "the line's other end has gone");
        case Found::damaged:
          ++counts_.damaged;
          if (++damaged_in_a_row_ > most_damaged)
            return fail(LinkProblem::damaged_frames,
                        std::to_string(damaged_in_a_row_) + " frames came damaged and no tick whole");
          break;
        case Found::frame:
          if (is_tick() && link::after(decoder_.header().sequence, last)) {
            heard();
            ++counts_.answers;
            number = decoder_.header().sequence;
            streamed = message<link::Streamed>();
            return true;
          }
          if (!is_bearable()) return false;
      }
      if (SerialLine::Clock::now() >= until) return wait_on();
    }
  }

  /// Of the last answer.
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

  /// Tells the motors to stop, without waiting whether it is heard, and lets go of the line.
  void close() {
    if (!line_.is_open()) return;
    send({link::protocol_version, link::Type::stop, session_, ++sequence_}, nullptr, 0, moment(settings_.timeout));
    line_.close();
    fail(LinkProblem::link_closed, "the link was closed");
  }

  LinkProblem problem() const { return problem_; }
  /// By any thread, also while an answer is waited for.
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

  void heard() {
    heard_at_ = SerialLine::Clock::now();
    damaged_in_a_row_ = 0;
  }

  bool is_tick() const {
    const link::Header got = decoder_.header();
    return got.version == link::protocol_version && got.type == link::Type::streamed && got.session == session_ &&
           decoder_.size() == tick_size_;
  }

  // Without a tick: patient, but not for ever.
  bool wait_on() {
    const double silent = std::chrono::duration<double>(SerialLine::Clock::now() - heard_at_).count();
    if (silent <= settings_.timeout) return false;
    return fail(LinkProblem::link_lost, "the board has sent no tick for " + std::to_string(silent) + " s");
  }

  // A frame that is no new tick: the past, an answer to what was not asked, or a board that has another session.
  bool is_bearable() {
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

  // A tick that comes while an answer is waited for is kept for whoever hears next.
  bool keep_early() {
    if (!is_tick()) return false;
    if (early_count_ < early_.size()) early_[early_count_++] = {decoder_.header().sequence, message<link::Streamed>()};
    return true;
  }

  bool send(const link::Header& header, const void* payload, std::size_t size, Moment until) {
    const std::size_t encoded = link::encode(header, payload, size, sent_.data());
    return line_.send({sent_.data(), encoded}, until);
  }

  // Asked with a number that no hello before had, so that its answer is none of theirs.
  bool hello(double timeout) {
    const std::uint32_t number = std::random_device{}();
    const link::Header header{link::protocol_version, link::Type::hello, 0, number};
    if (!converse(header, nullptr, 0, link::Type::board, sizeof(link::Board), timeout)) return false;
    board_ = message<link::Board>();
    board_.name[sizeof board_.name - 1] = 0;
    sequence_ = board_.last_sequence;
    if (board_.real_size != sizeof(float) || board_.parameters_size != link::parameters_size ||
        board_.interface_version != interface_version)
      return fail(LinkProblem::wrong_version, "the board has version " + std::to_string(board_.interface_version) +
                                                  " of the C interface with numbers of " +
                                                  std::to_string(board_.real_size) + " bytes; allowed is version " +
                                                  std::to_string(interface_version) + " with 4");
    return true;
  }

  bool ask(link::Type question, const void* payload, std::size_t size, link::Type answer, std::size_t answer_size,
           double timeout) {
    const link::Header header{link::protocol_version, question, session_, ++sequence_};
    return converse(header, payload, size, answer, answer_size, timeout);
  }

  // What one question has led to.
  struct Course {
    int damaged{};
    int stale{};
  };

  // Asks until there is an answer; the board takes a repetition for one, by its sequence.
  bool converse(const link::Header& header, const void* payload, std::size_t size, link::Type answer,
                std::size_t answer_size, double timeout) {
    const int attempts = settings_.repetitions + 1;
    const Moment end = moment(timeout);
    Course course;
    for (int attempt = 1; attempt <= attempts; ++attempt) {
      if (attempt > 1) ++counts_.repetitions;
      const bool last = attempt == attempts;
      const Moment until = last ? end : std::min(end, moment(timeout / attempts));
      send(header, payload, size, until);
      switch (await(header, until, last, course)) {
        case Found::frame:
          return judge(header, answer, answer_size);
        case Found::closed:
          return fail(LinkProblem::link_closed, "the line's other end has gone");
        case Found::damaged:
        case Found::nothing:
          break;
      }
      if (course.damaged > most_damaged) break;
    }
    const std::string asked =
        what(header.type) + ", in " + std::to_string(attempts) + " attempts within " + std::to_string(timeout) + " s";
    if (course.damaged > 0)
      return fail(LinkProblem::damaged_frames,
                  std::to_string(course.damaged) + " frames came damaged and no answer whole to " + asked);
    if (course.stale >= attempts)
      return fail(LinkProblem::stale_answers,
                  std::to_string(course.stale) + " answers of the past came and none to " + asked);
    return fail(LinkProblem::link_lost, "the board did not answer " + asked);
  }

  // The frame that answers, or why there is none; a damaged one may have been it, so that it is worth asking again.
  Found await(const link::Header& header, Moment until, bool last, Course& course) {
    for (;;) {
      const Found found = line_.receive(decoder_, until);
      if (found == Found::damaged) {
        ++counts_.damaged;
        if (++course.damaged > most_damaged || !last) return found;
      } else if (found == Found::frame && keep_early()) {
        continue;
      } else if (found != Found::frame || answers(header)) {
        return found;
      } else {
        ++counts_.stale;
        ++course.stale;
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
      return fail(LinkProblem::bad_answer, "the board answered " + what(header.type) + " with a frame of type " +
                                               std::to_string(static_cast<int>(got.type)) + " and " +
                                               std::to_string(decoder_.size()) + " bytes");
    ++counts_.answers;
    return true;
  }

  bool another_version(const std::string& version) {
    return fail(LinkProblem::wrong_version, "the board speaks version " + version + " of the protocol; allowed is " +
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
        return fail(LinkProblem::refused, "the board makes no controller of the parameters (code " + detail + ")");
      default:
        return fail(LinkProblem::refused, "the board refused (" +
                                              std::to_string(static_cast<std::uint32_t>(refused.why)) + ", detail " +
                                              detail + ")");
    }
  }

  static std::string what(link::Type question) {
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
  SerialLine::Moment heard_at_;
  int damaged_in_a_row_{};
  std::array<std::uint8_t, link::encoded_size(link::most_payload)> sent_{};
};

}  // namespace tenodesis::runtime

#pragma once
// A line of bytes to a board: a serial port or a socket, with a deadline for each wait.

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstdint>
#include <span>
#include <system_error>

#include "tenodesis/frame.hpp"

namespace tenodesis::runtime {

class SerialLine {
 public:
  using Clock = std::chrono::steady_clock;
  using Moment = Clock::time_point;

  enum class Found : unsigned char {
    frame,    ///< in the decoder
    damaged,  ///< a frame was dropped
    nothing,  ///< until the deadline
    closed,   ///< and nothing more will come
  };

  /// Keeps a duplicate of the open descriptor.
  explicit SerialLine(int descriptor) : descriptor_(::fcntl(descriptor, F_DUPFD_CLOEXEC, 0)) {
    const int flags = descriptor_ < 0 ? -1 : ::fcntl(descriptor_, F_GETFL);
    if (flags < 0 || ::fcntl(descriptor_, F_SETFL, flags | O_NONBLOCK) < 0) {
      const int problem = errno;
      close();
      throw std::system_error(problem, std::generic_category(), "no line of bytes");
    }
    struct stat status{};
    is_socket_ = ::fstat(descriptor_, &status) == 0 && S_ISSOCK(status.st_mode);
  }
  ~SerialLine() { close(); }
  SerialLine(const SerialLine&) = delete;
  SerialLine& operator=(const SerialLine&) = delete;

  bool is_open() const { return descriptor_ >= 0; }

  void close() {
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = -1;
  }

  /// False where not all bytes were sent by the deadline.
  bool send(std::span<const std::uint8_t> bytes, Moment until) {
    while (is_open() && !bytes.empty()) {
      const ssize_t sent = write(bytes);
      if (sent > 0) {
        bytes = bytes.subspan(static_cast<std::size_t>(sent));
      } else if ((sent < 0 && !is_temporary(errno)) || !wait(POLLOUT, until)) {
        return false;
      }
    }
    return bytes.empty();
  }

  /// The next frame; bytes behind it stay for the next call. Returns by the deadline even if noise never ends.
  Found receive(link::Decoder& decoder, Moment until) {
    while (is_open()) {
      while (taken_ < filled_) {
        const std::uint32_t before = decoder.damaged();
        if (decoder.push(buffer_[taken_++])) return Found::frame;
        if (decoder.damaged() != before) return Found::damaged;
      }
      const ssize_t got = ::read(descriptor_, buffer_, sizeof buffer_);
      if (got > 0) {
        filled_ = static_cast<std::size_t>(got);
        taken_ = 0;
        if (Clock::now() >= until) return Found::nothing;
        continue;
      }
      // A terminal reads 0 bytes from an idle line, too.
      const bool ended = got == 0 && (is_socket_ || hung_up_);
      if (ended || (got < 0 && !is_temporary(errno))) return Found::closed;
      if (!wait(POLLIN, until)) return Found::nothing;
    }
    return Found::closed;
  }

 private:
  static bool is_temporary(int problem) { return problem == EAGAIN || problem == EINTR; }

  // A socket whose other end was closed would otherwise end the program by a signal.
  ssize_t write(std::span<const std::uint8_t> bytes) const {
    return is_socket_ ? ::send(descriptor_, bytes.data(), bytes.size(), MSG_NOSIGNAL)
                      : ::write(descriptor_, bytes.data(), bytes.size());
  }

  bool wait(short event, Moment until) {
    const auto left = std::chrono::duration_cast<std::chrono::nanoseconds>(until - Clock::now()).count();
    if (left <= 0) return false;
    const timespec time{static_cast<time_t>(left / 1'000'000'000), static_cast<long>(left % 1'000'000'000)};
    pollfd line{descriptor_, event, 0};
    const int ready = ::ppoll(&line, 1, &time, nullptr);
    hung_up_ = ready > 0 && (line.revents & event) == 0;
    return ready > 0 || (ready < 0 && errno == EINTR);
  }

  int descriptor_;
  bool is_socket_{};
  bool hung_up_{};
  std::uint8_t buffer_[4096]{};
  std::size_t filled_{};
  std::size_t taken_{};
};

}  // namespace tenodesis::runtime

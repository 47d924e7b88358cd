#pragma once
// A device whose sensors and motors are served by another thread, which may be slow: it posts what it has measured and
// takes what the controller answers. The live loop waits for a post no longer than a given time.

#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cerrno>

#include "device.hpp"
#include "durations.hpp"

namespace tenodesis::runtime {

/// A value that one thread writes and another reads undivided, without either waiting for the other.
template <class T>
class SharedValue {
  static_assert(std::is_trivially_copyable_v<T> && sizeof(T) % sizeof(std::uint64_t) == 0);
  static constexpr std::size_t words = sizeof(T) / sizeof(std::uint64_t);

 public:
  void set(const T& value) {
    const auto bits = std::bit_cast<std::array<std::uint64_t, words>>(value);
    const std::uint64_t stamp = stamp_.load(std::memory_order_relaxed);
    stamp_.store(stamp + 1, std::memory_order_relaxed);
    std::atomic_thread_fence(std::memory_order_release);
    for (std::size_t k = 0; k < words; ++k) value_[k].store(bits[k], std::memory_order_relaxed);
    stamp_.store(stamp + 2, std::memory_order_release);
  }

  /// The number of the value, counted from 1; 0 where there is none, and where the writer is held up half-way: a
  /// reader of higher priority would wait for it in vain.
  std::uint64_t get(T& value) const {
    for (int tries = 0; tries < 100; ++tries) {
      const std::uint64_t stamp = stamp_.load(std::memory_order_acquire);
      if (stamp % 2 == 1) continue;
      std::array<std::uint64_t, words> bits;
      for (std::size_t k = 0; k < words; ++k) bits[k] = value_[k].load(std::memory_order_relaxed);
      std::atomic_thread_fence(std::memory_order_acquire);
      if (stamp_.load(std::memory_order_relaxed) != stamp) continue;
      value = std::bit_cast<T>(bits);
      return stamp / 2;
    }
    return 0;
  }

 private:
  std::array<std::atomic<std::uint64_t>, words> value_;
  std::atomic<std::uint64_t> stamp_;
};

/// Wakes a thread that waits for another. A semaphore with a monotonic deadline is missing from older C libraries and
/// from musl; the call of the kernel on which it would stand is not.
class Wakeup {
 public:
  void notify() {
    notified_.store(1, std::memory_order_release);
    ::syscall(SYS_futex, &notified_, FUTEX_WAKE_PRIVATE, 1, nullptr, nullptr, 0);
  }

  /// False where nothing was notified until a time, ns of the monotonic clock; what was notified before counts.
  bool wait_until(std::uint64_t time) {
    const long until[2] = {long(time / 1'000'000'000), long(time % 1'000'000'000)};
    while (notified_.exchange(0, std::memory_order_acquire) == 0)
      if (::syscall(SYS_futex, &notified_, FUTEX_WAIT_BITSET_PRIVATE, 0, until, nullptr, FUTEX_BITSET_MATCH_ANY) != 0 &&
          errno == ETIMEDOUT)
        return false;
    return true;
  }

 private:
  std::atomic<std::uint32_t> notified_;
  static_assert(sizeof notified_ == 4 && decltype(notified_)::is_always_lock_free);
};

class MailboxDevice final : public Device {
 public:
  struct Sensed {
    std::uint64_t time{};  ///< ns
    double handle_angle[most_joints]{}, output_angle[most_joints]{};
    double tension[most_tendons]{}, spool_angle[most_tendons]{};
  };
  struct Answer {
    std::uint64_t measurement{};     ///< number of the measurement that it answers, from 1
    double speed[most_tendons]{};    ///< of the spools, rad/s
    double tension[most_tendons]{};  ///< that drives hold instead, N; 0: they follow the speed
  };

  MailboxDevice(const Sizes& sizes, bool distal_encoder, bool holds_tension)
      : Device(sizes, bench_commands(sizes, holds_tension), bench_signals(sizes, distal_encoder)),
        holds_tension_(holds_tension) {}

  // For the thread that serves the hardware.
  void post(const Sensed& sensed) {
    sensed_.set(sensed);
    ++posted_;
    came_.notify();
  }
  /// The answer to the last post; false where none comes within so many ns.
  bool take(Answer& answer, std::uint64_t timeout) {
    const std::uint64_t until = now() + timeout;
    while (true) {
      if (answer_.get(answer) != 0 && answer.measurement >= posted_) return true;
      if (!answered_.wait_until(until)) return false;
    }
  }
  bool stopped() const { return stopped_.load(std::memory_order_acquire); }
  bool power_cut() const { return power_cut_.load(std::memory_order_acquire); }

  bool simulated() const override { return false; }
  bool clocked() const override { return true; }

  bool read(std::uint64_t& time, std::uint64_t timeout) override {
    const std::uint64_t until = now() + timeout;
    std::uint64_t number = sensed_.get(last_);
    while ((number == read_ || number == 0) && came_.wait_until(until)) number = sensed_.get(last_);
    const bool fresh = number != read_ && number != 0;
    if (fresh) {
      overtaken_ = read_ == 0 ? 0 : number - read_ - 1;
      read_ = number;
    }
    time = last_.time;
    return fresh;
  }

  Measurement<double> reading(const CompensatedAxis& of) const override {
    return {last_.handle_angle[of.handle],
            {last_.tension[of.agonist], last_.tension[of.antagonist]},
            {last_.spool_angle[of.agonist], last_.spool_angle[of.antagonist]}};
  }

  bool may_be_late() const override { return true; }
  std::uint64_t overtaken() const override { return overtaken_; }

  bool write(const double* row) override {
    Answer answer{read_, {}, {}};
    std::copy_n(row, sizes.tendons, answer.speed);
    if (holds_tension_) std::copy_n(row + sizes.tendons, sizes.tendons, answer.tension);
    answer_.set(answer);
    answered_.notify();
    return true;
  }

  void store(double* out) const override {
    out = std::copy_n(last_.handle_angle, sizes.handles, out);
    out = std::copy_n(last_.tension, sizes.tendons, out);
    out = std::copy_n(last_.spool_angle, sizes.tendons, out);
    if (signals.find("measured_output_angle").second != 0) std::copy_n(last_.output_angle, sizes.joints, out);
  }

  void cut_power() noexcept override { power_cut_.store(true, std::memory_order_release); }

  void stop() noexcept override {
    const Answer rest{std::numeric_limits<std::uint64_t>::max(), {}, {}};
    answer_.set(rest);
    stopped_.store(true, std::memory_order_release);
    answered_.notify();
  }

 private:
  SharedValue<Sensed> sensed_;
  SharedValue<Answer> answer_;
  bool holds_tension_;
  Wakeup came_, answered_;
  std::uint64_t posted_{};              // by the serving thread
  std::uint64_t read_{}, overtaken_{};  // by the loop
  Sensed last_{};
  std::atomic<bool> stopped_, power_cut_;
};

}  // namespace tenodesis::runtime

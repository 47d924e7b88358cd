#pragma once
// Monotonic time, and a histogram of durations in classes a sixteenth of an octave wide: any number of them takes the
// same memory, and a percentile is right to 6 %.

#include <time.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cstdint>

namespace tenodesis::runtime {

/// Time of the monotonic clock, ns.
inline std::uint64_t now() {
  timespec time{};
  ::clock_gettime(CLOCK_MONOTONIC, &time);
  return static_cast<std::uint64_t>(time.tv_sec) * 1'000'000'000 + static_cast<std::uint64_t>(time.tv_nsec);
}

/// Durations in ns; one thread notes them, any thread reads.
class Durations {
 public:
  void note(std::uint64_t duration) {
    counts_[place(duration)].fetch_add(1, std::memory_order_relaxed);
    total_.fetch_add(1, std::memory_order_relaxed);
    if (duration > worst_.load(std::memory_order_relaxed)) worst_.store(duration, std::memory_order_relaxed);
  }

  std::uint64_t count() const { return total_.load(std::memory_order_relaxed); }
  std::uint64_t worst() const { return worst_.load(std::memory_order_relaxed); }

  /// The duration that a share of all does not exceed, at most 6 % too long; 0 where there are none.
  std::uint64_t percentile(double share) const {
    const auto wanted = static_cast<std::uint64_t>(share * double(count()));
    std::uint64_t seen = 0;
    for (std::size_t k = 0; k < counts_.size(); ++k) {
      seen += counts_[k].load(std::memory_order_relaxed);
      if (seen > wanted) return std::min(upper(k), worst());
    }
    return worst();
  }

  void clear() {
    for (auto& count : counts_) count.store(0, std::memory_order_relaxed);
    total_.store(0, std::memory_order_relaxed);
    worst_.store(0, std::memory_order_relaxed);
  }

 private:
  static constexpr int fine_bits = 4;
  static constexpr std::uint64_t fine = 1u << fine_bits;

  static std::size_t place(std::uint64_t value) {
    if (value < fine) return value;
    const int octave = static_cast<int>(std::bit_width(value)) - 1 - fine_bits;
    return std::size_t(octave + 1) * fine + ((value >> octave) & (fine - 1));
  }
  static std::uint64_t upper(std::size_t place) {
    if (place < fine) return place;
    const std::size_t octave = place / fine - 1;
    return ((fine + place % fine + 1) << octave) - 1;
  }

  std::array<std::atomic<std::uint64_t>, (64 - fine_bits + 1) * fine> counts_{};
  std::atomic<std::uint64_t> total_;
  std::atomic<std::uint64_t> worst_;
};

}  // namespace tenodesis::runtime

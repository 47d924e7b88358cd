#pragma once
// Whether constants in memory are what they were: their check word, of which each tick computes a part.

#include <cstdint>
#include <cstring>

namespace tenodesis {

struct CheckWord {
  static constexpr std::uint32_t ticks = 512;  // such that a tick has few words to check

  std::uint32_t kept{}, sum{}, at{};

  template <class T>
  static constexpr std::uint32_t words = sizeof(T) / sizeof(std::uint32_t);

  template <class T>
  void add(const T& constants, std::uint32_t count) {
    const auto* const bytes = reinterpret_cast<const unsigned char*>(&constants);
    for (std::uint32_t n = 0; n < count && at < words<T>; ++n, ++at) {
      std::uint32_t word{};
      std::memcpy(&word, bytes + at * sizeof word, sizeof word);
      sum = sum * 0x9E3779B1U + word;
    }
  }

  template <class T>
  void keep(const T& constants) {
    at = sum = 0;
    add(constants, words<T>);
    kept = sum;
    at = sum = 0;
  }

  /// False where a round has ended with another word.
  template <class T>
  bool holds(const T& constants) {
    add(constants, words<T> / ticks + 1);
    if (at < words<T>) return true;
    const bool same = sum == kept;
    at = sum = 0;
    return same;
  }
};

}  // namespace tenodesis

#pragma once
// Sensors: from a true value to the reading that the data acquisition stores.

#include <cstdint>

#include "tenodesis/scalar.hpp"

namespace tenodesis {

/// A stream of random numbers as a function of seed and count: a copy repeats it, another seed gives another stream.
struct Noise {
  std::uint64_t seed{};
  std::uint64_t count{};

  /// The next 64 random bits (a Weyl sequence through the finaliser of SplitMix64; Steele, Lea, Flood 2014).
  constexpr std::uint64_t bits() {
    std::uint64_t z = seed + ++count * 0x9E3779B97F4A7C15U;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31U);
  }

  /// A number of mean 0 and deviation 1, nearly normal: the sum of 32 fair bits and one uniform number.
  ///
  /// Its excess kurtosis is -0.06, its largest size 5.9.
  template <Real S>
  constexpr S normal() {
    const std::uint64_t drawn = bits();
    const auto coins = static_cast<std::uint32_t>(drawn >> 32U);
    const S uniform = S(static_cast<std::uint32_t>(drawn)) * S(1.0 / 4294967296.0) - S(0.5);
    constexpr S deviation = S(2.8431203515386634);  // sqrt(32 / 4 + 1 / 12)
    return (S(ones(coins)) - S(16) + uniform) / deviation;
  }

 private:
  // Without the library call that a compiler's builtin needs where the processor has no such instruction.
  static constexpr int ones(std::uint32_t v) {
    v = v - ((v >> 1U) & 0x55555555U);
    v = (v & 0x33333333U) + ((v >> 2U) & 0x33333333U);
    return static_cast<int>((((v + (v >> 4U)) & 0x0F0F0F0FU) * 0x01010101U) >> 24U);
  }
};

/// The constants of one sensor, in the unit of what it measures.
template <class S>
struct Sensor {
  S gain{1};
  S bias{};
  S noise{};  ///< standard deviation
  S low{};    ///< range of the converter
  S high{};
  S resolution{};  ///< one step of the converter

  S read(const S& value, Noise& random) const {
    S disturbed = gain * value + bias;
    // In dual numbers the expected reading: neither noise nor steps have a derivative.
    if constexpr (Real<S>) {
      if (noise > S(0)) disturbed = disturbed + noise * random.template normal<S>();
      disturbed = clamp(round(disturbed / resolution) * resolution, low, high);
    }
    return disturbed;
  }
};

}  // namespace tenodesis

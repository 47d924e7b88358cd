#pragma once
// Sensors: from a true value to the reading that the data acquisition stores.

#include <cstdint>

#include "tenodesis/scalar.hpp"

namespace tenodesis {

/// A stream of random numbers as a function of seed and count: a copy repeats it, another seed gives another stream.
///
/// Word: 64 bits, or those of several streams side by side.
template <class Word>
struct NoiseOf {
  Word seed{};
  Word count{};

  /// The next 64 random bits (a Weyl sequence through the finaliser of SplitMix64; Steele, Lea, Flood 2014).
  constexpr Word bits() {
    count = count + 1U;
    Word z = seed + count * 0x9E3779B97F4A7C15U;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    return z ^ (z >> 31U);
  }

  /// A number of mean 0 and deviation 1, nearly normal: the sum of 32 fair bits and one uniform number.
  ///
  /// Its excess kurtosis is -0.06, its largest size 5.9.
  template <class S>
  constexpr S normal() {
    const Word drawn = bits();
    const S uniform = number_of<S>(drawn & 0xFFFFFFFFU) * S(1.0 / 4294967296.0) - S(0.5);
    constexpr auto deviation = ValueOf<S>(2.8431203515386634);  // sqrt(32 / 4 + 1 / 12)
    return (number_of<S>(ones(drawn >> 32U)) - S(16) + uniform) / S(deviation);
  }

 private:
  // Of the lower 32 bits; without the library call that a compiler's builtin needs where the processor has no such
  // instruction.
  static constexpr Word ones(const Word& of) {
    Word v = of - ((of >> 1U) & 0x55555555U);
    v = (v & 0x33333333U) + ((v >> 2U) & 0x33333333U);
    return ((((v + (v >> 4U)) & 0x0F0F0F0FU) * 0x01010101U) >> 24U) & 0xFFU;
  }
};

using Noise = NoiseOf<std::uint64_t>;

/// The constants of one sensor, in the unit of what it measures.
template <class S>
struct Sensor {
  S gain{1};
  S bias{};
  S noise{};  ///< standard deviation
  S low{};    ///< range of the converter
  S high{};
  S resolution{};  ///< one step of the converter

  template <class Random>
  S read(const S& value, Random& random) const {
    S disturbed = gain * value + bias;
    // In dual numbers the expected reading: neither noise nor steps have a derivative.
    if constexpr (requires { round(value); }) {
      const Flag<S> noisy = noise > S(0);
      if (any(noisy)) {
        const auto before = random.count;
        disturbed = disturbed + noise * random.template normal<S>();
        random.count = before + one_where(noisy);
      }
      disturbed = clamp(round(disturbed / resolution) * resolution, low, high);
    }
    return disturbed;
  }
};

}  // namespace tenodesis

#pragma once
// The file by which the PC tells the microcontroller what the sensors said and what the controller answered.

#include <bit>
#include <cstdint>
#include <type_traits>

#include "instrument.hpp"

namespace recording {

struct Header {
  std::uint32_t ticks;
  std::uint32_t tick_size;  ///< so that a file of another controller is not mistaken for one of this
};

struct Tick {
  instrument::Input input;
  instrument::Output output;
};

/// An output's bits, since numbers may compare as equal that are not the same (0 and -0), and the same as not (NaN).
struct Words {
  static constexpr std::uint32_t count = sizeof(instrument::Output) / sizeof(std::uint32_t);
  std::uint32_t word[count];

  explicit Words(const instrument::Output& output) { *this = std::bit_cast<Words>(output); }
};

static_assert(std::is_trivially_copyable_v<Tick> && std::endian::native == std::endian::little);

}  // namespace recording

#pragma once
// The file of recorded inputs and outputs that the PC writes and the microcontroller replays.

#include <bit>
#include <cstdint>
#include <type_traits>

#ifdef PARAMETERS
#include "joints.hpp"
#else
#include "instrument.hpp"
#endif

namespace recording {

struct Header {
  std::uint32_t ticks;
  std::uint32_t tick_size;  ///< so that a file of another controller is refused
};

struct Tick {
  instrument::Input input;
  instrument::Output output;
};

/// An output's bits, since different values may compare as equal (0 and -0), and equal bits as different (NaN).
struct Words {
  static constexpr std::uint32_t count = sizeof(instrument::Output) / sizeof(std::uint32_t);
  std::uint32_t word[count];

  explicit Words(const instrument::Output& output) { *this = std::bit_cast<Words>(output); }
};

static_assert(std::is_trivially_copyable_v<Tick> && std::endian::native == std::endian::little);

}  // namespace recording

#pragma once
// Frames between a PC and a board with the controller on it, over any line of bytes.
//
// On the line: a zero, bytes other than zero (consistent overhead byte stuffing), a zero. They encode header, payload
// and the CRC-32 of both, little-endian. A receiver is synchronised again at the next zero, whatever came before; a
// damaged frame is dropped and counted. The CRC has 32 bits rather than 16, since each frame moves motors and a bad
// line damages thousands a second: of those, one in 4 billion passes the check rather than one in 65 thousand.

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "tenodesis/fault.hpp"

namespace tenodesis::link {

/// Raised whenever a message or its meaning changes; header, hello and refusal are the same in all versions.
inline constexpr std::uint8_t protocol_version = 3;

enum class Type : std::uint8_t {
  none = 0,
  // from the PC
  hello = 1,       ///< requests the board's description; changes nothing
  parameters = 2,  ///< starts a session: a fresh controller, disabled
  step = 3,        ///< one tick; answered by output
  reset = 4,       ///< the controller returns to the start of the session
  counts = 5,      ///< counts of faults and bad samples of an axis
  stop = 6,        ///< motors to zero; an enabled controller pauses with its next tick
  stream = 7,      ///< the board measures and steps by itself from now on, and sends each tick
  keep = 8,        ///< keeps a streaming board running; not answered
  // from the board
  board = 0x81,
  done = 0x82,  ///< parameters, reset, stop, stream
  output = 0x83,
  counted = 0x85,
  streamed = 0x87,
  refused = 0xFF,
};

enum class Refusal : std::uint32_t {
  none = 0,
  wrong_version = 1,   ///< detail: the board's own
  unknown_type = 2,    ///< detail: the type
  bad_size = 3,        ///< detail: the size
  no_session = 4,      ///< the board does not know this session: it was restarted, or another was started
  bad_parameters = 5,  ///< detail: what tenodesis_init returned
  no_such_axis = 6,    ///< detail: the axis
  no_sensors = 7,      ///< the board has no sensors of its own
};

struct Header {
  std::uint8_t version{protocol_version};
  Type type{};
  std::uint16_t session{};   ///< chosen by the PC; 0: none
  std::uint32_t sequence{};  ///< of each action, one more than the last; an answer has that of its request
};

inline constexpr int most_axes = 2;

/// Bytes of a message that ends with an array of all axes and is sent without those that the instrument does not have.
template <class Message>
constexpr std::size_t size_with(int axes) {
  return sizeof(Message) - static_cast<std::size_t>(most_axes - axes) * sizeof(Message::axis[0]);
}

/// Answer to hello.
struct Board {
  std::uint32_t interface_version{};  ///< TENODESIS_VERSION
  std::uint32_t real_size{};          ///< bytes of a tenodesis_real
  std::uint32_t parameters_size{};    ///< bytes of its tenodesis_parameters
  std::uint32_t axes{};               ///< largest number
  std::uint32_t session{};            ///< current one; 0: none
  std::uint32_t last_sequence{};      ///< of the last action; the next is one more
  std::uint32_t clock{};              ///< of the processor, Hz
  std::uint32_t sensors{};            ///< 1: it can stream
  char name[32]{};
};

/// tenodesis_parameters in float, whatever tenodesis_real is in this program.
struct ControllerParameters {
#define TENODESIS_CHOICE_FIELD(name, meaning) std::uint32_t name{};
#define TENODESIS_REAL_FIELD(name, unit, bound, meaning) float name{};
  struct Limit {
    float threshold{}, persistence{};
  };
  struct Axis {
    TENODESIS_AXIS_PARAMETERS(TENODESIS_REAL_FIELD)
    Limit spool_jump{};
    Limit limit[fault_count]{};
  };

  TENODESIS_CHOICES(TENODESIS_CHOICE_FIELD)
  TENODESIS_COMMON_PARAMETERS(TENODESIS_REAL_FIELD)
  Axis axis[most_axes]{};
#undef TENODESIS_CHOICE_FIELD
#undef TENODESIS_REAL_FIELD
};

struct Parameters {
  /// Time without a tick or a keep, by the board's clock, after which it stops, ms; 0: the controller's own watchdog.
  std::uint32_t silence{};
  std::uint32_t reserved{};
  ControllerParameters controller{};
};

struct Measured {
  float handle_angle{};    // rad
  float tension[2]{};      // N
  float spool_angle[2]{};  // rad
};

/// TENODESIS_LAW_... and TENODESIS_ACTUATION_...; a choice that the controller cannot take is ignored.
struct Choice {
  std::uint16_t law{}, actuation{};

  friend constexpr bool operator==(const Choice&, const Choice&) = default;
};

/// Sent with the instrument's axes only.
struct Step {
  std::uint64_t time{};     ///< of the measurement, ns
  std::uint32_t request{};  ///< TENODESIS_REQUEST_...
  Choice choice{};
  Measured axis[most_axes]{};
};

struct AxisAnswer {
  float spool_velocity[2]{};  // rad/s
  float output_angle{};       // rad
  float output_angle_std{};
  float tip_force{};  // N
  float tip_force_std{};
  float friction_scale{};
  float friction_scale_std{};
  std::uint32_t faults{};
  std::uint16_t phase{};           ///< of compensation
  std::uint16_t homing_failure{};  ///< as in tenodesis_axis_output
};

/// Bits of TickAnswer::flags.
inline constexpr std::uint32_t homed = 1, homing = 2;
inline constexpr std::uint32_t silent = 4;    ///< has stopped since the last answer: too long without a tick or a keep
inline constexpr std::uint32_t halted = 8;    ///< has stopped since the last answer: by a stop
inline constexpr std::uint32_t stopped = 16;  ///< motors at rest until the controller is enabled again
inline constexpr std::uint32_t cut_power = 32;  ///< a motor does not obey: a relay in the motors' supply must open

struct TickAnswer {
  std::uint64_t time{};   ///< of the measurement that is answered, ns
  std::uint32_t state{};  ///< TENODESIS_DISABLED ...
  std::uint32_t flags{};
  std::uint32_t faults{};
  std::uint32_t first_faults{};
  std::uint32_t busy{};     ///< ticks of the board's clock from the previous frame's last byte to its answer
  std::uint32_t damaged{};  ///< frames that the board has dropped
};

/// Sent with the instrument's axes only.
struct Output {
  TickAnswer tick{};
  AxisAnswer axis[most_axes]{};
};

/// A tick that the board has measured by itself; its sequence counts ticks. Sent with the instrument's axes only.
struct Streamed {
  struct Axis {
    Measured measured{};
    AxisAnswer answer{};
  };

  std::uint32_t kept{};    ///< sequence of the PC's last action
  std::uint32_t number{};  ///< of the last request that arrived
  TickAnswer tick{};
  Axis axis[most_axes]{};
};

/// What the PC wants of a streaming board, repeated with every tick, so that a lost frame does no harm.
struct Keep {
  std::uint32_t request{};  ///< TENODESIS_REQUEST_...; made once, however often it is repeated
  std::uint32_t number{};   ///< of the request; a new number makes it a new request
  Choice choice{};
  std::uint32_t rest{};  ///< 1: motors at zero until the controller is enabled again
};

struct Counted {
  std::uint32_t faults[fault_count]{};
  std::uint32_t bad_samples[5]{};
  std::uint32_t late_ticks{};
};

struct Refused {
  Refusal why{};
  std::uint32_t detail{};
};

// Neither compiler may put padding anywhere.
static_assert(sizeof(Header) == 8 && sizeof(Board) == 64 && sizeof(Parameters) == 8 + sizeof(ControllerParameters));
static_assert(size_with<Step>(0) == 16 && size_with<Output>(0) == 32 && size_with<Streamed>(0) == 40);
static_assert(sizeof(Measured) == 20 && sizeof(AxisAnswer) == 40 && sizeof(Keep) == 16);
static_assert(sizeof(Counted) == 20 + 4 * (fault_count + 1) && sizeof(Refused) == 8);
static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "structs are sent as they are in memory");

/// Whether a sequence is after another, on a circle of 2^32.
constexpr bool after(std::uint32_t one, std::uint32_t other) { return static_cast<std::int32_t>(one - other) > 0; }

namespace detail {

struct CrcTable {
  std::uint32_t of[256]{};

  constexpr CrcTable() {
    for (std::uint32_t byte = 0; byte < 256; ++byte) {
      std::uint32_t rest = byte;
      for (int bit = 0; bit < 8; ++bit) rest = (rest >> 1U) ^ ((rest & 1U) != 0 ? 0xEDB88320U : 0U);
      of[byte] = rest;
    }
  }
};
inline constexpr CrcTable crc_table{};

}  // namespace detail

/// CRC-32 of IEEE 802.3, continued from that of the previous bytes.
constexpr std::uint32_t crc(const std::uint8_t* bytes, std::size_t count, std::uint32_t before = 0) {
  std::uint32_t rest = ~before;
  for (std::size_t k = 0; k < count; ++k) rest = (rest >> 8U) ^ detail::crc_table.of[(rest ^ bytes[k]) & 0xFFU];
  return ~rest;
}

inline constexpr std::size_t crc_size = 4;
inline constexpr std::size_t most_payload = sizeof(Parameters);
inline constexpr std::size_t most_content = sizeof(Header) + most_payload + crc_size;

/// Largest number of bytes of an encoded payload.
constexpr std::size_t encoded_size(std::size_t payload) {
  const std::size_t content = sizeof(Header) + payload + crc_size;
  return content + content / 254 + 1 + 2;
}

/// Writes a frame; returns its size, at most encoded_size(size).
inline std::size_t encode(const Header& header, const void* payload, std::size_t size, std::uint8_t* to) {
  std::size_t end = 0;
  to[end++] = 0;
  std::size_t code = end++;  // where the distance to the next zero goes
  const auto put = [&](const std::uint8_t* bytes, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) {
      if (bytes[k] != 0) to[end++] = bytes[k];
      if (bytes[k] == 0 || end - code == 255) {
        to[code] = static_cast<std::uint8_t>(end - code);
        code = end++;
      }
    }
  };
  std::uint8_t head[sizeof header];
  std::memcpy(head, &header, sizeof header);
  const auto* body = static_cast<const std::uint8_t*>(payload);
  const std::uint32_t check = crc(body, size, crc(head, sizeof header));
  std::uint8_t tail[crc_size];
  std::memcpy(tail, &check, crc_size);
  put(head, sizeof header);
  put(body, size);
  put(tail, crc_size);
  to[code] = static_cast<std::uint8_t>(end - code);
  to[end++] = 0;
  return end;
}

/// Finds intact frames in the bytes that are received.
class Decoder {
 public:
  /// Takes a byte; true where it ends a frame, which then stays until the next byte.
  bool push(std::uint8_t byte) {
    if (byte != 0) {
      // More than the longest frame: only counted, to be dropped.
      if (filled_ < sizeof buffer_) buffer_[filled_] = byte;
      if (filled_ <= sizeof buffer_) ++filled_;
      return false;
    }
    const std::size_t filled = filled_;
    filled_ = 0;
    if (filled == 0) return false;
    content_ = filled <= sizeof buffer_ ? unstuff(filled) : 0;
    const bool intact = content_ >= sizeof(Header) + crc_size && is_sound();
    if (!intact) ++damaged_;
    return intact;
  }

  Header header() const { return read<Header>(0); }
  const std::uint8_t* payload() const { return buffer_ + sizeof(Header); }
  std::size_t size() const { return content_ - sizeof(Header) - crc_size; }

  /// The payload as a message; fields that were not sent keep their defaults.
  template <class Message>
  Message message() const {
    Message message{};
    std::memcpy(&message, payload(), size() < sizeof message ? size() : sizeof message);
    return message;
  }

  /// Frames that were dropped, and stretches of noise between zeros.
  std::uint32_t damaged() const { return damaged_; }

 private:
  template <class T>
  T read(std::size_t at) const {
    T value{};
    std::memcpy(&value, buffer_ + at, sizeof value);
    return value;
  }

  // In place: reading is never behind writing. 0 where the stuffing is invalid.
  std::size_t unstuff(std::size_t filled) {
    std::size_t end = 0;
    std::size_t at = 0;
    while (at < filled) {
      const std::size_t code = buffer_[at++];
      if (at + code - 1 > filled) return 0;
      for (std::size_t k = 1; k < code; ++k) buffer_[end++] = buffer_[at++];
      if (code < 255 && at < filled) buffer_[end++] = 0;
    }
    return end;
  }

  bool is_sound() const { return crc(buffer_, content_ - crc_size) == read<std::uint32_t>(content_ - crc_size); }

  alignas(8) std::uint8_t buffer_[encoded_size(most_payload)]{};
  std::size_t filled_{};
  std::size_t content_{};
  std::uint32_t damaged_{};
};

}  // namespace tenodesis::link

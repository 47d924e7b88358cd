#pragma once
// What can go wrong, by name, and which sensors are not to be believed then.

#include <cstdint>

namespace tenodesis {

enum class Fault : std::uint8_t {
  tendon_break,         ///< a tendon does not pull although its spool should make it
  tendon_slack,         ///< a tendon hangs for long
  over_tension,         ///< a tendon pulls more than it may
  load_cell_stuck,      ///< a reading does not even flicker
  load_cell_range,      ///< a reading that no tendon can cause
  load_cell_drift,      ///< the pair's mean tension is not what the spools have wound
  encoder_dropout,      ///< the handle is where it cannot be
  encoder_jump,         ///< a handle or spool angle moved faster than it can
  spool_slip,           ///< the mean tension fell off at once, and no tendon broke
  motor_not_following,  ///< a spool does not turn as it was told
  tick_late,            ///< a tick came too late, or time stood still
  not_a_number,         ///< NaN, infinity, or beyond what any sensor can say
  homing_failed,        ///< pretension was not reached
};

inline constexpr int fault_count = 13;

/// A fault's place in a mask.
constexpr std::uint32_t bit(Fault fault) { return std::uint32_t(1) << static_cast<std::uint32_t>(fault); }

constexpr const char* name(Fault fault) {
  switch (fault) {
    case Fault::tendon_break:
      return "tendon_break";
    case Fault::tendon_slack:
      return "tendon_slack";
    case Fault::over_tension:
      return "over_tension";
    case Fault::load_cell_stuck:
      return "load_cell_stuck";
    case Fault::load_cell_range:
      return "load_cell_range";
    case Fault::load_cell_drift:
      return "load_cell_drift";
    case Fault::encoder_dropout:
      return "encoder_dropout";
    case Fault::encoder_jump:
      return "encoder_jump";
    case Fault::spool_slip:
      return "spool_slip";
    case Fault::motor_not_following:
      return "motor_not_following";
    case Fault::tick_late:
      return "tick_late";
    case Fault::not_a_number:
      return "not_a_number";
    case Fault::homing_failed:
      return "homing_failed";
  }
  return "unknown";
}

/// Kinds of sensors whose readings are not to be used.
struct Distrust {
  bool tension{};
  bool handle{};
  bool spool{};
};

/// What a mask of faults says about the sensors.
constexpr Distrust distrusted(std::uint32_t faults) {
  const auto any = [faults](auto... fault) { return (faults & (bit(fault) | ...)) != 0; };
  // A dead load cell looks like a broken tendon, a slipped spool like a drifting cell.
  return {any(Fault::tendon_break, Fault::load_cell_stuck, Fault::load_cell_range, Fault::load_cell_drift,
              Fault::not_a_number),
          any(Fault::encoder_dropout, Fault::encoder_jump, Fault::not_a_number),
          any(Fault::encoder_jump, Fault::load_cell_drift, Fault::spool_slip, Fault::motor_not_following,
              Fault::not_a_number)};
}

/// Whether it must be asked anew what the spools have wound: until then the pair's faults would not clear.
constexpr bool needs_homing(std::uint32_t faults) {
  return (faults & (bit(Fault::tendon_break) | bit(Fault::load_cell_drift) | bit(Fault::encoder_jump) |
                    bit(Fault::spool_slip) | bit(Fault::homing_failed))) != 0;
}

/// Counts without ever starting anew.
constexpr void count(std::uint32_t& counter) {
  if (counter != UINT32_MAX) ++counter;
}

}  // namespace tenodesis

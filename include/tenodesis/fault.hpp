#pragma once
// The faults of parameter_table.h in C++, and which sensors each of them makes unusable.

#include <cstdint>

#include "tenodesis/parameter_table.h"

namespace tenodesis {

enum class Fault : std::uint8_t {
#define TENODESIS_FAULT(name, NAME, unit, meaning) name,
  TENODESIS_FAULT_TABLE(TENODESIS_FAULT)
#undef TENODESIS_FAULT
};

#define TENODESIS_FAULT(name, NAME, unit, meaning) #name,
inline constexpr const char* fault_names[] = {TENODESIS_FAULT_TABLE(TENODESIS_FAULT)};
#undef TENODESIS_FAULT
inline constexpr int fault_count = sizeof fault_names / sizeof *fault_names;

/// A fault's bit in a mask.
constexpr std::uint32_t bit(Fault fault) { return std::uint32_t(1) << static_cast<std::uint32_t>(fault); }

/// Whether a mask has any of some faults.
constexpr bool has(std::uint32_t faults, auto... fault) { return (faults & (bit(fault) | ...)) != 0; }

constexpr const char* name(Fault fault) {
  const int n = static_cast<int>(fault);
  return n < fault_count ? fault_names[n] : "unknown";
}

/// Kinds of sensors whose readings are not to be used.
struct Distrust {
  bool tension{};
  bool handle{};
  bool spool{};
};

/// The sensors that a mask of faults makes unusable.
constexpr Distrust distrusted(std::uint32_t faults) {
  // A dead load cell looks like a broken tendon, a slipped spool and a rope that gets longer like a drifting cell.
  return {has(faults, Fault::tendon_break, Fault::load_cell_stuck, Fault::load_cell_range, Fault::load_cell_drift,
              Fault::stroke_unexplained, Fault::rope_length, Fault::not_a_number),
          has(faults, Fault::encoder_dropout, Fault::encoder_jump, Fault::not_a_number),
          has(faults, Fault::encoder_jump, Fault::load_cell_drift, Fault::spool_slip, Fault::motor_not_following,
              Fault::stroke_unexplained)};
}

/// Whether the spools' zeros are unknown after a fault, so that the instrument must be homed before the faults can
/// clear.
constexpr bool needs_homing(std::uint32_t faults) {
  return has(faults, Fault::tendon_break, Fault::load_cell_drift, Fault::encoder_jump, Fault::spool_slip,
             Fault::homing_failed, Fault::stroke_unexplained, Fault::rope_length);
}

/// Counts up to the largest number, and stays there.
constexpr void count(std::uint32_t& counter) {
  if (counter != UINT32_MAX) ++counter;
}

}  // namespace tenodesis

#pragma once
// Whether two outputs of the C interface are the same to the last bit; what is not a number is like any other.

#include <bit>
#include <cmath>
#include <cstdint>
#include <type_traits>

#include "tenodesis/tenodesis.h"

using Bits = std::conditional_t<sizeof(tenodesis_real) == 4, std::uint32_t, std::uint64_t>;
inline bool same(tenodesis_real a, tenodesis_real b) {
  return std::bit_cast<Bits>(a) == std::bit_cast<Bits>(b) || (std::isnan(a) && std::isnan(b));
}

inline bool same(const tenodesis_output& a, const tenodesis_output& b) {
  bool all = a.state == b.state && a.homed == b.homed && a.homing == b.homing && a.faults == b.faults &&
             a.first_faults == b.first_faults;
  for (int n = 0; n < TENODESIS_AXES; ++n) {
    const auto& each = a.axis[n];
    const auto& other = b.axis[n];
    all = all && same(each.spool_velocity[0], other.spool_velocity[0]) &&
          same(each.spool_velocity[1], other.spool_velocity[1]) && same(each.output_angle, other.output_angle) &&
          same(each.output_angle_std, other.output_angle_std) && same(each.tip_force, other.tip_force) &&
          same(each.tip_force_std, other.tip_force_std) && same(each.friction_scale, other.friction_scale) &&
          same(each.friction_scale_std, other.friction_scale_std) && each.faults == other.faults;
  }
  return all;
}

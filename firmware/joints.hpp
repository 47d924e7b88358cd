#pragma once
// The controller of all joints under test, in float, through its C interface: with the sizes and parameters of an
// exported header, PARAMETERS, that is included before all else.

#include <bit>
#include <cstdint>

#include "tenodesis/joints.h"

static_assert(sizeof(tenodesis_real) == sizeof(float));

namespace instrument {

using Input = tenodesis_joints_input;
using Output = tenodesis_joints_output;

class Joints {
 public:
  Joints() : ready_(tenodesis_joints_init(&controller_, &PARAMETERS) == TENODESIS_OK) {}

  bool ready() const { return ready_; }

  /// One tick. Not inlined, so that its instructions can be counted separately.
  [[gnu::noinline]] Output step(const Input& measured) {
    Output got;
    tenodesis_joints_step(&controller_, &measured, &got);
    return got;
  }

 private:
  tenodesis_joints controller_;
  bool ready_;
};

}  // namespace instrument

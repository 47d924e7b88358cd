#pragma once
// A controller that twins in lanes ask.

#include <cmath>

#include "any_controller.hpp"
#include "lane_job.hpp"

namespace tenodesis::engine {

/// Asks a controller at a time (s), with readings and for velocities as a lane job has them.
inline void tick_in_lanes(AnyController& controller, double time, const double* readings, double* velocities) {
  AnyInput input{};
  input.time = static_cast<std::uint64_t>(std::llround(time * 1e9));
  input.request = controller.request;
  controller.request = Request::none;
  for (int n = 0; n < controller.axes(); ++n, readings += tenodesis_lanes::axis_readings)
    input.axis[n] = {readings[0], {readings[1], readings[2]}, {readings[3], readings[4]}};
  controller.step(input, controller.last);
  for (int n = 0; n < controller.axes(); ++n)
    velocities = std::copy_n(controller.last.axis[n].spool_velocity, 2, velocities);
}

}  // namespace tenodesis::engine

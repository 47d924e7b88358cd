#pragma once
// A spool on a speed-controlled motor with limits of speed and acceleration, a first-order loop, and backlash.

#include "tenodesis/scalar.hpp"

namespace tenodesis {

/// The constants of a drive; speeds and angles are those at the spool, whatever the gear ratio.
template <class S>
struct Drive {
  S spool_radius{};        ///< m
  S speed_limit{};         ///< rad/s
  S acceleration_limit{};  ///< rad/s^2
  S time_constant{};       ///< of the speed loop, s
  S backlash{};            ///< of the gearbox, rad at the spool
};

template <class S>
struct DriveState {
  S speed{};  ///< of the motor, rad/s at the spool
  S angle{};  ///< of the motor, rad at the spool; positive winds
  S spool{};  ///< rad
};

/// The drive one step later; the tendon's tension (N) holds the spool on the flank that unwinds.
template <class S>
DriveState<S> advance(const Drive<S>& drive, const DriveState<S>& before, const S& command, const S& tension,
                      const S& time_step) {
  const S wanted = clamp(command, -drive.speed_limit, drive.speed_limit);
  // Backward Euler on the loop, so that a loop faster than the step follows at once.
  const S acceleration = clamp((wanted - before.speed) / (drive.time_constant + time_step), -drive.acceleration_limit,
                               drive.acceleration_limit);
  DriveState<S> after = before;
  after.speed = before.speed + acceleration * time_step;
  after.angle = before.angle + (before.speed + after.speed) * S(0.5) * time_step;
  const S play = drive.backlash * S(0.5);
  const S low = after.angle - play;
  after.spool = if_above(tension, low, clamp(before.spool, low, after.angle + play));
  return after;
}

}  // namespace tenodesis

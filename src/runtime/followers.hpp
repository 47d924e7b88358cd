#pragma once
// What follows sliders: the hand, and motors that no controller commands.

#include <algorithm>
#include <cmath>
#include <vector>

#include "device.hpp"
#include "orders.hpp"

namespace tenodesis::runtime {

/// A critically damped follower.
struct Follower {
  double target{}, at{}, speed{};

  /// Speed after a period, s, of its own; rate: 1/s.
  double wanted_speed(double period, double rate) const {
    return speed + period * rate * (rate * (target - at) - 2 * speed);
  }
};

/// Motors that no controller commands: their spools follow orders, or the velocities of a played motion.
class Motors {
 public:
  Motors(const Settings& settings, std::size_t tendons) : settings_(settings), point_(tendons) {}

  void order(std::size_t tendon, double angle) {
    if (tendon < point_.size()) point_[tendon].target = angle;
  }

  /// Replaces the velocities of such motors, of all tendons, by those that they are sent; where a motor is in trouble,
  /// all rest, and the problem is returned. They rest where they are not free, too. A played motion may have a motor
  /// hold a tension instead; without a column of them there is no such motor.
  Problem command(const Device& device, bool free, bool played, double* velocity, double* held) {
    if (free) point();
    Problem found = Problem::none;
    for (const std::size_t m : settings_.motors) {
      const Measurement<double> read = device.reading({0, m, m});
      const double tension = read.tension[0], at = read.spool_angle[0];
      if (!played) velocity[m] = point_[m].speed + settings_.motor_gain * (point_[m].at - at);
      if (!free || played) point_[m] = {at, at, 0};
      if (held != nullptr) held[m] = free && played ? std::clamp(held[m], 0.0, settings_.motor_tension) : 0;
      if (!free) {
        velocity[m] = 0;
        continue;
      }
      velocity[m] = std::clamp(velocity[m], -settings_.motor_speed, settings_.motor_speed);
      if (!std::isfinite(tension) || !std::isfinite(at) || !std::isfinite(velocity[m]) ||
          (held != nullptr && !std::isfinite(held[m])))
        found = Problem::not_a_number;
      if (tension > settings_.motor_tension && velocity[m] > 0) found = Problem::overload;
    }
    if (found != Problem::none)
      for (const std::size_t m : settings_.motors) {
        velocity[m] = 0;
        if (held != nullptr) held[m] = 0;
      }
    return found;
  }

 private:
  // All of them slow down where one is at its largest speed, so that tendons that move together stay together.
  void point() {
    const double rate = 1 / settings_.hand_smoothing;
    double fastest = settings_.motor_speed;
    for (const std::size_t m : settings_.motors)
      fastest = std::max(fastest, std::abs(point_[m].wanted_speed(settings_.period, rate)));
    for (const std::size_t m : settings_.motors) {
      Follower& motor = point_[m];
      motor.speed = motor.wanted_speed(settings_.period, rate) * settings_.motor_speed / fastest;
      motor.at += settings_.period * motor.speed;
    }
  }

  const Settings& settings_;
  std::vector<Follower> point_;
};

}  // namespace tenodesis::runtime

#pragma once
// Faults injected between an instrument and its controller: into what the sensors read, what the drives are sent, and
// the tick itself.

#include <algorithm>
#include <array>

#include "tenodesis/control.hpp"

namespace tenodesis::engine {

/// Points where a fault can be injected, per axis; the tick is common to all axes, and its fault is the first axis's.
inline constexpr std::array fault_injection_points{
    "handle_angle",           "tension.agonist",        "tension.antagonist",        "spool_angle.agonist",
    "spool_angle.antagonist", "spool_velocity.agonist", "spool_velocity.antagonist", "tick"};
inline constexpr std::size_t injection_point_count = fault_injection_points.size();

/// The first of each kind of point.
enum InjectionPoint : std::size_t {
  at_handle_angle = 0,
  at_tension = 1,
  at_spool_angle = 3,
  at_velocity = 5,
  at_tick = 7
};

enum class InjectionMode : unsigned char {
  none,
  add,    ///< adds a value to the signal; seconds to the tick's time
  set,    ///< replaces the signal by a value, NaN included
  hold,   ///< repeats the last value; leaves the tick out
  scale,  ///< multiplies the signal by a value; not of the tick
  swap,   ///< exchanges the signals of the two tendons, whichever of them it is at
};

struct Injection {
  InjectionMode mode{};
  double value{};
};

/// The signal path from sensors to controller to drives; remembers the last value of each signal, for holding it.
class FaultInjector {
 public:
  /// The value that arrives when one is sent.
  double pass(std::size_t axis, std::size_t point, double value, const Injection& fault) {
    double& last = last_[axis][point];
    if (fault.mode == InjectionMode::hold) return last;
    if (fault.mode == InjectionMode::set) return last = fault.value;
    if (fault.mode == InjectionMode::scale) return last = value * fault.value;
    return last = fault.mode == InjectionMode::add ? value + fault.value : value;
  }

  /// The same for both tendons, from the agonist's point on; a fault of either may exchange them.
  template <class FaultAt>
  std::array<double, 2> pass_pair(std::size_t axis, std::size_t point, const double (&sent)[2],
                                  const FaultAt& fault_at) {
    const Injection at[2]{fault_at(point), fault_at(point + 1)};
    const bool crossed = at[0].mode == InjectionMode::swap || at[1].mode == InjectionMode::swap;
    return {pass(axis, point, sent[crossed ? 1 : 0], at[0]), pass(axis, point + 1, sent[crossed ? 0 : 1], at[1])};
  }

  /// The same for all sensors of an axis; fault_at gives the fault of a point.
  template <class FaultAt>
  Measurement<double> pass(std::size_t axis, const Measurement<double>& read, const FaultAt& fault_at) {
    const auto tension = pass_pair(axis, at_tension, read.tension, fault_at);
    const auto spool_angle = pass_pair(axis, at_spool_angle, read.spool_angle, fault_at);
    return {pass(axis, at_handle_angle, read.handle_angle, fault_at(at_handle_angle)),
            {tension[0], tension[1]},
            {spool_angle[0], spool_angle[1]}};
  }

  /// Shifts the time of a tick, ns; false where the tick is left out.
  bool pass_tick(const Injection& fault, double& time) {
    const bool given = fault.mode != InjectionMode::hold;
    if (given) given_at_ = time;
    silent_ = (time - given_at_) * 1e-9;
    if (fault.mode == InjectionMode::add) time = std::max(0.0, time + fault.value * 1e9);
    if (fault.mode == InjectionMode::set) time = std::max(0.0, fault.value * 1e9);
    return given;
  }

  /// Time since the last tick that was not left out, s.
  double silent() const { return silent_; }

 private:
  double given_at_{}, silent_{};
  double last_[most_axes][injection_point_count]{};
};

}  // namespace tenodesis::engine

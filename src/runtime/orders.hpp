#pragma once
// What the live loop is set up with, what it can be ordered to do, and what it reports and records.

#include <array>
#include <cstdint>

#include "device.hpp"

namespace tenodesis::runtime {

struct Settings {
  double period{5e-4};          ///< of ticks, s
  double speed{1};              ///< simulated over real time; 0: as fast as possible
  double late_bound{0.05};      ///< delay beyond which real motors are stopped, s
  double hand_speed{3};         ///< of a hand that follows a slider, rad/s
  double hand_smoothing{0.04};  ///< s
  double handle_range[most_axes]{};
  bool real_time{true};  ///< whether to ask the operating system for real-time scheduling
};

enum class OrderKind : unsigned char {
  request,       ///< a: a Request
  law,           ///< a: ControlLaw, b: Actuation
  hand,          ///< value: handle angle, rad; axis
  force,         ///< value: N; axis
  radial,        ///< value: N; axis
  speed,         ///< value: simulated over real time; 0: as fast as possible
  inject_fault,  ///< a: point, b: InjectionMode, axis, value; ticks: for how long
  drop,          ///< the rest of a played motion, and its tissue; the hand stays where it is
};
inline constexpr int order_count = 8;

struct Order {
  OrderKind kind{};
  int a{}, b{}, axis{};
  double value{};
  std::uint64_t ticks{};
};

/// One tick of a played motion: what is done to each axis of the bench.
struct PlayedTick {
  Benches bench{};
};

/// Why the loop has stopped the motors by itself, or did not carry out an order.
enum class Problem : unsigned char {
  none,
  tip_lost,        ///< the load was more than the tip can hold, and was not applied
  late,            ///< a tick came later than the bound
  no_measurement,  ///< the device sent no measurement for longer than the bound
  operator_gone,   ///< the lease ran out
  in_tissue,       ///< the tip was where tissue was to be, which is placed as soon as the tip has left
};

/// Columns of a record: those of the tick, then those of each axis.
inline constexpr std::array tick_columns{"time",    "request", "homed", "homing",          "first_faults",
                                         "stopped", "problem", "late",  "controller_time", "fresh"};
inline constexpr std::array bench_columns{"commanded_handle_angle", "radial_force", "contact_angle",
                                          "contact_stiffness", "contact_damping"};
inline constexpr std::size_t axis_columns = bench_columns.size() + engine::signal_count + engine::control_signal_count;

inline std::size_t columns(int axes) { return tick_columns.size() + std::size_t(axes) * axis_columns; }

}  // namespace tenodesis::runtime

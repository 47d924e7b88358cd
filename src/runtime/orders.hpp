#pragma once
// What the live loop is set up with, what it can be ordered to do, and what it reports and records.

#include <array>
#include <cstdint>
#include <vector>

#include "device.hpp"
#include "engine/any_controller.hpp"

namespace tenodesis::runtime {

struct Settings {
  double period{5e-4};                ///< of ticks, s
  double speed{1};                    ///< simulated over real time; 0: as fast as possible
  double late_bound{0.05};            ///< delay beyond which real motors are stopped, s
  double hand_speed{3};               ///< of a hand that follows a slider, rad/s
  double hand_smoothing{0.04};        ///< of hand and motors that follow sliders, s
  std::vector<double> handle_range;   ///< of each joint of the handle, rad
  std::vector<CompensatedAxis> axes;  ///< what the controller compensates, in its order
  std::vector<std::size_t> motors;    ///< tendons whose motors no controller commands, and that follow orders
  double motor_speed{1};              ///< largest of their spools, rad/s
  double motor_gain{10};              ///< of their position loop, 1/s
  double motor_tension{};             ///< beyond which they do not wind, N
  bool real_time{true};               ///< whether to ask the operating system for real-time scheduling
};

enum class OrderKind : unsigned char {
  request,       ///< a: a Request
  law,           ///< a: ControlLaw, b: Actuation
  hand,          ///< at: joint of the handle; value: its angle, rad
  load,          ///< at: column of a row of commands, other than the handle's and the spools'; value
  motor,         ///< at: tendon; value: angle of its spool, rad
  speed,         ///< value: simulated over real time; 0: as fast as possible
  inject_fault,  ///< a: point, b: InjectionMode, at: axis, value; ticks: for how long
  drop,          ///< the rest of a played motion, tissue and what the jaws hold; the hand stays where it is
};
inline constexpr int order_count = 8;

struct Order {
  OrderKind kind{};
  int a{}, b{};
  std::size_t at{};
  double value{};
  std::uint64_t ticks{};
};

/// One tick of a played motion: a row of commands, whose velocities of spools are for motors without a controller.
using PlayedTick = std::array<double, most_commands>;

/// Why the loop has stopped the motors by itself, or did not carry out an order.
enum class Problem : unsigned char {
  none,
  tip_lost,        ///< the load was more than the tip can hold, and was not applied
  late,            ///< a tick came later than the bound
  no_measurement,  ///< the device sent no measurement for longer than the bound
  operator_gone,   ///< the lease ran out
  in_tissue,       ///< the tip was where tissue was to be, which is placed as soon as the tip has left
  overload,        ///< a motor without a controller was to wind a tendon beyond the largest tension
  not_a_number,    ///< a sensor of such a motor had no value
};

/// Columns of a record: those of the tick; then a row of commands, of signals, and of each axis of the controller.
inline constexpr std::array tick_columns{"time",    "request", "state", "homed",           "homing", "first_faults",
                                         "stopped", "problem", "late",  "controller_time", "fresh"};

inline std::size_t columns(const Device& device, std::size_t axes) {
  return tick_columns.size() + device.commands.width() + device.signals.width() + axes * engine::control_signal_count;
}

}  // namespace tenodesis::runtime

#pragma once
// What the live loop reads sensors from and sends speeds to.

#include <array>
#include <cstdint>

#include "../bindings/any_controller.hpp"
#include "../bindings/any_twin.hpp"

namespace tenodesis::runtime {

using bindings::AnyInput;
using bindings::most_axes;
using bindings::signal_count;

/// What is done to one axis of a simulated bench.
struct Bench {
  double handle_angle{};  ///< where the hand has it, rad
  double force{};         ///< tangential at the tip, N
  double radial_force{};  ///< N
};

using Benches = std::array<Bench, most_axes>;
using Velocities = double[most_axes][2];
using Signals = std::array<double, signal_count>;

class Device {
 public:
  virtual ~Device() = default;
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  virtual int axes() const = 0;
  /// Whether time and motors are of a computer's making.
  virtual bool simulated() const = 0;
  /// Whether `read` waits for the device; otherwise the loop keeps time.
  virtual bool clocked() const = 0;
  /// The newest measurement; false where none has come within so many ns, and the input holds the one before.
  virtual bool read(AnyInput& input, std::uint64_t timeout) = 0;
  /// Measurements that came before the last one read, and were not.
  virtual std::uint64_t overtaken() const { return 0; }
  /// Sends speeds, rad/s at the spools; false where the bench cannot be what was asked, and is as before.
  virtual bool write(const Velocities& speed, const Benches& bench) = 0;
  /// What is known of an axis after that; NaN where it is not.
  virtual Signals signals(int axis) const = 0;
  virtual void stop() noexcept = 0;
};

}  // namespace tenodesis::runtime

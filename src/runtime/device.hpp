#pragma once
// What the live loop reads measurements from and sends velocities to.

#include <array>
#include <cstdint>
#include <limits>

#include "engine/any_controller.hpp"
#include "engine/any_twin.hpp"

namespace tenodesis::runtime {

using engine::AnyInput;

inline constexpr double unknown = std::numeric_limits<double>::quiet_NaN();

/// What is done to one axis of a simulated bench.
struct Bench {
  double handle_angle{};  ///< where the hand holds it, rad
  double force{};         ///< tangential at the tip, N
  double radial_force{};  ///< N
  Contact<double> contact{};
};

using Benches = std::array<Bench, most_axes>;
using Velocities = double[most_axes][2];
using Signals = std::array<double, engine::signal_count>;

class Device {
 public:
  virtual ~Device() = default;
  Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  virtual int axes() const = 0;
  /// Whether time and motors are simulated.
  virtual bool simulated() const = 0;
  /// Whether `read` waits for the device; otherwise the loop keeps time.
  virtual bool clocked() const = 0;
  /// The newest measurement; false where none has come within so many ns, and the input holds the previous one.
  virtual bool read(AnyInput& input, std::uint64_t timeout) = 0;
  /// Whether a measurement that has not come is only late, so that the controller may wait for it.
  virtual bool may_be_late() const { return false; }
  /// Measurements that were lost before the last one read.
  virtual std::uint64_t overtaken() const { return 0; }
  /// Sends velocities, rad/s at the spools; false where the bench cannot carry its load, and is as before.
  virtual bool write(const Velocities& speed, const Benches& bench) = 0;
  /// Whether tissue was not placed, since the tip is where it was to be.
  virtual bool in_tissue(int /*axis*/) const { return false; }
  /// An axis's signals after that; NaN where they are not known.
  virtual Signals signals(int axis) const = 0;
  /// Takes the motors' supply away, since one of them does not obey; it does not come back.
  virtual void cut_power() noexcept {}
  virtual void stop() noexcept = 0;
};

}  // namespace tenodesis::runtime

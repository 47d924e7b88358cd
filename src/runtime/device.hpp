#pragma once
// What the live loop reads measurements from and sends commands to, in named columns.

#include <cstdint>
#include <limits>
#include <string_view>
#include <utility>
#include <vector>

#include "engine/any_twin.hpp"

namespace tenodesis::runtime {

using engine::Column, engine::CompensatedAxis;
using Sizes = engine::ChainSizes;

inline constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
using engine::most_joints, engine::most_tendons;
/// Columns of tissue per joint: angle, stiffness, damping.
inline constexpr std::size_t contact_columns = 3;
/// Room for a row of commands (chain_rows.hpp): what joints and tendons have, the wrench, and single ones.
inline constexpr std::size_t most_commands =
    (1 + contact_columns) * most_joints + 3 * most_tendons + engine::wrench_components + 7;

/// Columns of a row, by name.
class Columns {
 public:
  explicit Columns(std::vector<Column> columns) : columns_(std::move(columns)), width_(engine::width_of(columns_)) {}

  const std::vector<Column>& all() const { return columns_; }
  std::size_t width() const { return width_; }
  /// First column of a name and how many there are; none of a name that is not there.
  std::pair<std::size_t, std::size_t> find(std::string_view wanted) const {
    std::size_t first = 0;
    for (const auto& [name, count] : columns_) {
      if (name == wanted) return {first, count};
      first += count;
    }
    return {0, 0};
  }

 private:
  std::vector<Column> columns_;
  std::size_t width_;
};

/// Where a row of commands has a tissue's columns.
inline Contact<double> contact_at(const double* from) { return {from[0], from[1], from[2]}; }

class Device {
 public:
  /// commands: what `write` takes, spool_velocity among them; signals: what `store` writes.
  Device(const Sizes& sizes, std::vector<Column> commands, std::vector<Column> signals)
      : sizes(sizes), commands(std::move(commands)), signals(std::move(signals)) {}
  virtual ~Device() = default;
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  /// Whether time and motors are simulated.
  virtual bool simulated() const = 0;
  /// Whether `read` waits for the device; otherwise the loop keeps time.
  virtual bool clocked() const = 0;
  /// Takes the newest measurement and its time, ns; false where none has come within so many ns, and the previous one
  /// stays.
  virtual bool read(std::uint64_t& time, std::uint64_t timeout) = 0;
  /// Of that measurement, what a controller's axis has.
  virtual Measurement<double> reading(const CompensatedAxis& axis) const = 0;
  /// Whether a measurement that has not come is only late, so that the controller may wait for it.
  virtual bool may_be_late() const { return false; }
  /// Measurements that were lost before the last one read.
  virtual std::uint64_t overtaken() const { return 0; }
  /// Carries out a row of commands; false where the bench cannot carry its load, and is as before.
  virtual bool write(const double* row) = 0;
  /// Whether tissue was not placed on a joint, since the tip is where it was to be.
  virtual bool in_tissue(std::size_t /*joint*/) const { return false; }
  /// Writes the signals after that; NaN where they are not known.
  virtual void store(double* out) const = 0;
  /// Takes the motors' supply away, since one of them does not obey; it does not come back.
  virtual void cut_power() noexcept {}
  virtual void stop() noexcept = 0;

  const Sizes sizes;
  const Columns commands, signals;
};

/// Columns that a bench of real motors takes and has.
inline std::vector<Column> bench_commands(const Sizes& of, bool holds_tension) {
  std::vector<Column> columns{{"spool_velocity", of.tendons}};
  if (holds_tension) columns.emplace_back("spool_tension", of.tendons);
  return columns;
}
inline std::vector<Column> bench_signals(const Sizes& of, bool distal_encoder) {
  std::vector<Column> columns{
      {"measured_handle_angle", of.handles}, {"measured_tension", of.tendons}, {"measured_spool_angle", of.tendons}};
  if (distal_encoder) columns.emplace_back("measured_output_angle", of.joints);
  return columns;
}

}  // namespace tenodesis::runtime

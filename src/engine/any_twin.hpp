#pragma once
// A twin of any kind behind one interface: commands in, signals out, row by row.

#include <algorithm>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "chain_rows.hpp"
#include "closed_loop.hpp"
#include "lane_job.hpp"
#include "tenodesis/tissue.hpp"

namespace tenodesis::engine {

inline constexpr std::array energy_names{"stored_before",  "stored_after",   "handle",     "spools",
                                         "load",           "friction",       "damping",    "tissue",
                                         "least_friction", "worst_residual", "most_sweeps"};

/// A joint that a controller's axis compensates: its joint of the handle and its pair of tendons.
using CompensatedAxis = tenodesis_lanes::Axis;

/// A twin that can step in lanes, and its state, as the bytes of their types.
struct LaneTwinBytes {
  tenodesis_lanes::Kind kind;
  bool yields;  ///< the hand
  int steps_per_sample, until_sample;
  const void* twin;
  const void* state;

  /// Whether they can step together.
  bool goes_with(const LaneTwinBytes& other) const {
    return kind.axes == other.kind.axes && kind.mechanism == other.kind.mechanism &&
           kind.quasi_static == other.kind.quasi_static && yields == other.yields &&
           steps_per_sample == other.steps_per_sample && until_sample == other.until_sample;
  }
};

class AnyTwin {
 public:
  virtual ~AnyTwin() = default;
  virtual std::unique_ptr<AnyTwin> copy() const = 0;
  virtual const ChainSizes& sizes() const = 0;
  /// Columns of a row of commands; the spools' velocities follow the handle's angles.
  virtual std::vector<Column> commands() const = 0;
  /// Signals that a step writes, in order.
  virtual std::vector<Column> signals() const = 0;
  /// One step by a row of commands.
  virtual Status step(const double* command) = 0;
  /// The same, with its energies added to a row of energy_names.
  virtual Status audit(const double* command, double* energy) = 0;
  /// The same, where a part that cannot take it takes its last command, with the new velocities of its spools; false if
  /// there was one.
  virtual bool step_or_hold(const double* command) = 0;
  virtual double stored() const = 0;
  /// Writes a row of signals; returns what follows it.
  virtual double* store(double* out) const = 0;
  virtual Measurement<double> reading(const CompensatedAxis& axis) const = 0;
  /// On the tip by the last command, along x, N.
  virtual double force() const = 0;
  /// By the last command, rad.
  virtual double handle_wanted(std::size_t h) const = 0;
  virtual Contact<double> contact(std::size_t joint) const = 0;
  /// Whether the tip is within tissue across its path about a joint, were it there.
  virtual bool inside(std::size_t joint, const Contact<double>& contact) const = 0;
  virtual std::string state() const = 0;
  virtual void set_state(std::string_view bytes) = 0;
  /// Nothing if it cannot step in lanes.
  virtual std::optional<LaneTwinBytes> in_lanes() const = 0;
  /// Where the columns of its commands go in lanes.
  virtual std::vector<tenodesis_lanes::Column> lane_columns() const = 0;

 protected:
  AnyTwin() = default;
  AnyTwin(const AnyTwin&) = default;
  AnyTwin& operator=(const AnyTwin&) = default;
};

/// Rows of commands of successive steps, of so many columns, some of which are given; none: all of them.
struct GivenRows {
  const double* data;
  std::size_t width;
  std::span<const std::size_t> given;

  /// Writes the columns of a step's row that are given; others stay as they are.
  void read(std::size_t i, double* row) const {
    if (given.empty()) std::copy_n(data + i * width, width, row);
    for (std::size_t c = 0; c < given.size(); ++c) row[given[c]] = data[i * given.size() + c];
  }
};

/// A twin whose rows of commands a controller's velocities replace, as a closed loop's plant.
class CompensatedTwin {
 public:
  CompensatedTwin(AnyTwin& twin, std::span<const CompensatedAxis> axes, const GivenRows& rows)
      : twin_(twin), axes_(axes), rows_(rows), row_(rows.width) {}

  Measurement<double> reading(std::size_t n) const { return twin_.reading(axes_[n]); }

  Status step(std::size_t i, const SpoolVelocities* velocity) {
    rows_.read(i, row_.data());
    const std::size_t first = twin_.sizes().handles;
    for (std::size_t n = 0; n < axes_.size(); ++n) {
      row_[first + axes_[n].agonist] = velocity[n][0];
      row_[first + axes_[n].antagonist] = velocity[n][1];
    }
    return twin_.step(row_.data());
  }

 private:
  AnyTwin& twin_;
  std::span<const CompensatedAxis> axes_;
  GivenRows rows_;
  std::vector<double> row_;
};

}  // namespace tenodesis::engine

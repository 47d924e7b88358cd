#pragma once
// Digital twins as devices: each write advances them by one tick.

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "device.hpp"
#include "engine/any_twin.hpp"

namespace tenodesis::runtime {

/// What both kinds share: simulated time, and tissue that is not placed where the tip is.
class SimulatedDevice : public Device {
 public:
  /// A tick is so many steps of the twin.
  SimulatedDevice(const Sizes& sizes, std::vector<Column> commands, std::vector<Column> signals, double time_step,
                  int steps_per_tick)
      : Device(sizes, std::move(commands), std::move(signals)),
        time_step_(time_step),
        steps_per_tick_(steps_per_tick),
        contact_(this->commands.find("contact").first),
        in_tissue_(sizes.joints),
        row_(this->commands.width()) {}

  bool simulated() const override { return true; }
  bool clocked() const override { return false; }

  bool read(std::uint64_t& time, std::uint64_t /*timeout*/) override {
    time = static_cast<std::uint64_t>(std::llround(double(steps_ + 1) * time_step_ * 1e9));
    return true;
  }

  bool write(const double* row) override {
    std::copy_n(row, row_.size(), row_.begin());
    for (std::size_t j = 0; j < in_tissue_.size(); ++j) {
      double* at = row_.data() + contact_ + contact_columns * j;
      in_tissue_[j] = enters(j, contact_at(at));
      if (in_tissue_[j]) std::fill_n(at, contact_columns, 0.0);
    }
    bool taken = true;
    for (int k = 0; k < steps_per_tick_; ++k) {
      ++steps_;
      if (!step(row_.data())) taken = false;
    }
    return taken;
  }

  bool in_tissue(std::size_t joint) const override { return in_tissue_[joint]; }
  void stop() noexcept override {}

 protected:
  /// One step; false where the load cannot be carried, and the step is made with the previous one.
  virtual bool step(const double* row) = 0;
  /// Whether the tip is in tissue that comes with the next step.
  virtual bool enters(std::size_t joint, const Contact<double>& contact) const = 0;

 private:
  double time_step_;
  int steps_per_tick_;
  std::uint64_t steps_{};
  std::size_t contact_;
  std::vector<char> in_tissue_;
  std::vector<double> row_;
};

/// The twin of a chain of joints.
class ChainDevice final : public SimulatedDevice {
 public:
  /// The twin must outlive it.
  ChainDevice(engine::AnyWristTwin& twin, double time_step, int steps_per_tick)
      : SimulatedDevice(twin.sizes(), engine::wrist_commands(twin.sizes()), engine::wrist_signals(twin.sizes()),
                        time_step, steps_per_tick),
        twin_(twin),
        held_(commands.width()) {}

  Measurement<double> reading(const CompensatedAxis& axis) const override { return twin_.reading(axis); }
  void store(double* out) const override { twin_.store(out); }

 protected:
  bool step(const double* row) override {
    if (twin_.step(row) == Status::ok) {
      std::copy_n(row, held_.size(), held_.begin());
      return true;
    }
    const auto [first, count] = commands.find("spool_velocity");
    std::copy_n(row + first, count, held_.data() + first);
    twin_.step(held_.data());
    return false;
  }

  bool enters(std::size_t joint, const Contact<double>& contact) const override {
    return contact != twin_.contact(joint) && twin_.inside(joint, contact);
  }

 private:
  engine::AnyWristTwin& twin_;
  std::vector<double> held_;
};

/// The twins of axes that do not act on each other, each with a joint of the handle and two tendons of its own.
class AxesDevice final : public SimulatedDevice {
 public:
  /// The twins must outlive it.
  AxesDevice(std::vector<engine::AnyTwin*> twins, double time_step, int steps_per_tick)
      : SimulatedDevice(sizes_of(twins.size()), commands_of(twins.size()), signals_of(twins.size()), time_step,
                        steps_per_tick),
        twins_(std::move(twins)),
        held_(twins_.size()),
        last_(twins_.size()) {}

  Measurement<double> reading(const CompensatedAxis& axis) const override {
    return measurement_as<Measurement<double>>(twins_[axis.handle]->reading());
  }

  void store(double* out) const override {
    const std::size_t axes = twins_.size();
    for (std::size_t n = 0; n < axes; ++n) {
      const auto values = twins_[n]->signals(last_[n]);
      double* to = out;
      for (std::size_t k = 0; k < values.size(); to += axes * width_at(k), k += width_at(k))
        std::copy_n(values.begin() + std::ptrdiff_t(k), width_at(k), to + n * width_at(k));
    }
  }

 protected:
  bool step(const double* row) override {
    bool taken = true;
    for (std::size_t n = 0; n < twins_.size(); ++n) {
      const Command<double> command = command_of(row, n);
      if (advance(n, command)) {
        held_[n] = command;
        continue;
      }
      taken = false;
      Command<double> before = held_[n];
      std::ranges::copy(command.spool_velocity, before.spool_velocity);
      advance(n, before);
    }
    return taken;
  }

  bool enters(std::size_t joint, const Contact<double>& contact) const override {
    return contact != twins_[joint]->contact() && twins_[joint]->inside(contact);
  }

 private:
  static Sizes sizes_of(std::size_t axes) { return {axes, axes, 2 * axes}; }

  static std::vector<Column> commands_of(std::size_t axes) {
    return {{"handle_angle", axes},
            {"spool_velocity", 2 * axes},
            {"force", axes},
            {"radial_force", axes},
            {"contact", contact_columns * axes}};
  }

  /// Columns of an axis that the signal at a place of an axis's row has: two of a tendon's.
  static std::size_t width_at(std::size_t k) {
    return std::string_view(engine::signal_names[k]).ends_with(".agonist") ? 2 : 1;
  }

  static std::vector<Column> signals_of(std::size_t axes) {
    // Names of tendons' signals without the tendon.
    static constexpr std::array paired{"measured_tension", "measured_spool_angle", "tension",
                                       "distal_tension",   "spool_angle",          "spool_velocity"};
    std::vector<Column> columns;
    std::size_t pair = 0;
    for (std::size_t k = 0; k < engine::signal_count; k += width_at(k))
      columns.emplace_back(width_at(k) == 2 ? paired[pair++] : engine::signal_names[k], axes * width_at(k));
    return columns;
  }

  Command<double> command_of(const double* row, std::size_t n) const {
    const std::size_t axes = twins_.size();
    Command<double> command{};
    command.handle_angle = row[n];
    std::copy_n(row + axes + 2 * n, 2, command.spool_velocity);
    command.force = row[3 * axes + n];
    command.radial_force = row[4 * axes + n];
    command.contact = contact_at(row + 5 * axes + contact_columns * n);
    return command;
  }

  bool advance(std::size_t n, const Command<double>& command) {
    last_[n] = command;
    return twins_[n]->step(command) == Status::ok;
  }

  std::vector<engine::AnyTwin*> twins_;
  std::vector<Command<double>> held_, last_;
};

}  // namespace tenodesis::runtime

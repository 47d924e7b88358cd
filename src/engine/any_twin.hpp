#pragma once
// A twin of any mechanism behind one interface: commands in, signals out, row by row.

#include <algorithm>
#include <cstring>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>

#include "closed_loop.hpp"
#include "tenodesis/wrist_energy.hpp"
#include "twin_spec.hpp"

namespace tenodesis::engine {

struct EnergyTotals {
  // stored before, stored after, handle, spools, load, friction, damping, tissue
  std::array<double, 8> values{};
  double least_friction{};  // the smallest loss in any step, by the tensions at its end
  double worst_residual{};
  int most_sweeps{};
};

class AnyTwin {
 public:
  virtual ~AnyTwin() = default;
  AnyTwin() = default;
  AnyTwin(const AnyTwin&) = delete;
  AnyTwin& operator=(const AnyTwin&) = delete;

  /// Runs over count commands; out holds a row of signals per step.
  virtual Progress run(const Commands& commands, std::size_t count, double* out) = 0;
  /// Runs and keeps the chosen signals of every n-th step, one row of out per signal.
  virtual Progress sample(const Commands& commands, std::size_t count, std::span<const std::size_t> signals,
                          std::size_t every, double* out, std::size_t columns) = 0;
  virtual Progress audit(const Commands& commands, std::size_t count, EnergyTotals& totals) = 0;
  /// One step, for a loop that is closed by the caller.
  virtual Status step(const Command<double>& command) = 0;
  virtual Reading<double> reading() const = 0;
  virtual std::string state() const = 0;
  virtual void set_state(const std::string& bytes) = 0;
  virtual double handle_wanted() const = 0;
  /// By the last command.
  virtual Contact<double> contact() const = 0;
  /// Whether the tip is within tissue, were it there.
  virtual bool inside(const Contact<double>& contact) const = 0;
  /// As they stand.
  virtual std::array<double, signal_count> signals() const = 0;
  std::array<double, signal_count> signals(const Command<double>& /*command*/) const { return signals(); }
};

template <class T>
class TwinOf final : public AnyTwin {
 public:
  using State = T::State;
  static_assert(std::is_trivially_copyable_v<State>);

  TwinOf(const T& twin, std::uint64_t seed) : twin_(twin), state_(twin.rest(seed)) {}

  Progress run(const Commands& commands, std::size_t count, double* out) override {
    return walk(commands, count,
                [&](std::size_t i) { std::ranges::copy(signals_of(twin_, state_), out + i * signal_count); });
  }

  Progress sample(const Commands& commands, std::size_t count, std::span<const std::size_t> signals, std::size_t every,
                  double* out, std::size_t columns) override {
    return walk(commands, count, [&](std::size_t i) {
      if ((i + 1) % every != 0) return;
      const auto row = signals_of(twin_, state_);
      for (std::size_t k = 0; k < signals.size(); ++k) out[k * columns + i / every] = row[signals[k]];
    });
  }

  Progress audit(const Commands& commands, std::size_t count, EnergyTotals& totals) override {
    Progress progress;
    totals.values[0] = wrist_stored_energy(twin_, state_);
    totals.values[1] = totals.values[0];
    for (std::size_t i = 0; i < count; ++i) {
      const State before = state_;
      progress.status = step(commands[i]);
      if (progress.status != Status::ok) return progress;
      progress.steps = i + 1;
      const Energy<double> energy = wrist_energy(twin_, before, state_);
      totals.values[1] = energy.stored;
      totals.values[2] += energy.handle;
      totals.values[3] += energy.spools;
      totals.values[4] += energy.load;
      totals.values[5] += energy.friction;
      totals.values[6] += energy.damping;
      totals.values[7] += energy.tissue;
      totals.least_friction = std::min(totals.least_friction, energy.friction_at_end);
      totals.worst_residual = std::max(totals.worst_residual, twin_.residual(before, state_));
      totals.most_sweeps = std::max(totals.most_sweeps, state_.sweeps);
    }
    return progress;
  }

  Status step(const Command<double>& command) override {
    return twin_.step(command_of<typename T::Command>(command), state_);
  }

  Reading<double> reading() const override { return reading_of(state_); }

  std::string state() const override {
    std::string bytes(sizeof(State), '\0');
    std::memcpy(bytes.data(), &state_, sizeof(State));
    return bytes;
  }

  void set_state(const std::string& bytes) override {
    if (bytes.size() != sizeof(State)) throw std::invalid_argument("the state belongs to another kind of twin");
    std::memcpy(&state_, bytes.data(), sizeof(State));
  }

  double handle_wanted() const override { return state_.command.handle_angle[0]; }

  Contact<double> contact() const override { return state_.command.contact[0]; }

  bool inside(const Contact<double>& contact) const override {
    return touches(twin_.path(0), contact, tip_at(twin_.path(0), state_.angle[0]));
  }

  std::array<double, signal_count> signals() const override { return signals_of(twin_, state_); }

 private:
  /// Steps over commands until one fails; calls keep(step) after each.
  template <class Keep>
  Progress walk(const Commands& commands, std::size_t count, const Keep& keep) {
    Progress progress;
    for (std::size_t i = 0; i < count; ++i) {
      progress.status = step(commands[i]);
      if (progress.status != Status::ok) break;
      keep(i);
      progress.steps = i + 1;
    }
    return progress;
  }

  T twin_;
  State state_;
};

/// Twins side by side, one an axis, as a closed loop's plant.
class TwinsByAxis {
 public:
  /// commands: of each axis.
  TwinsByAxis(std::span<AnyTwin* const> twins, std::span<const Commands> commands)
      : twins_(twins), commands_(commands) {}

  Measurement<double> reading(std::size_t n) const { return measurement_as<Measurement<double>>(twins_[n]->reading()); }

  Status step(std::size_t i, const SpoolVelocities* velocity) {
    for (std::size_t n = 0; n < twins_.size(); ++n) {
      Command<double> command = commands_[n][i];
      std::ranges::copy(velocity[n], command.spool_velocity);
      const Status status = twins_[n]->step(command);
      if (status != Status::ok) return status;
    }
    return Status::ok;
  }

  std::array<double, signal_count> signals(std::size_t n) const { return twins_[n]->signals(); }

 private:
  std::span<AnyTwin* const> twins_;
  std::span<const Commands> commands_;
};

inline std::unique_ptr<AnyTwin> make_twin(const TwinSpec& spec, std::uint64_t seed) {
  return with_twin(spec, [&]<class T>(const T& twin) -> std::unique_ptr<AnyTwin> {
    return std::make_unique<TwinOf<T>>(twin, seed);
  });
}

}  // namespace tenodesis::engine

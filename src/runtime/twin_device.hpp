#pragma once
// The digital twin as a device: each write advances it by one tick.

#include <cmath>
#include <utility>
#include <vector>

#include "device.hpp"

namespace tenodesis::runtime {

class TwinDevice final : public Device {
 public:
  /// The twins must outlive it; a tick is so many of their steps.
  TwinDevice(std::vector<engine::AnyTwin*> twins, double time_step, int steps_per_tick)
      : twins_(std::move(twins)), time_step_(time_step), steps_per_tick_(steps_per_tick) {}

  int axes() const override { return static_cast<int>(twins_.size()); }
  bool simulated() const override { return true; }
  bool clocked() const override { return false; }

  bool read(AnyInput& input, std::uint64_t /*timeout*/) override {
    input.time = static_cast<std::uint64_t>(std::llround(double(steps_ + 1) * time_step_ * 1e9));
    for (std::size_t n = 0; n < twins_.size(); ++n)
      input.axis[n] = measurement_as<Measurement<double>>(twins_[n]->reading());
    return true;
  }

  // A load that a tip cannot hold is not applied: the step is made with the previous one. Nor is tissue placed where
  // the tip is.
  bool write(const Velocities& speed, const Benches& given) override {
    bool taken = true;
    Benches bench = given;
    for (std::size_t n = 0; n < twins_.size(); ++n) {
      in_tissue_[n] = bench[n].contact != twins_[n]->contact() && twins_[n]->inside(bench[n].contact);
      if (in_tissue_[n]) bench[n].contact = {};
    }
    for (int k = 0; k < steps_per_tick_; ++k) {
      ++steps_;
      for (std::size_t n = 0; n < twins_.size(); ++n) {
        if (step(n, speed[n], bench[n])) continue;
        taken = false;
        step(n, speed[n], held_[n]);
      }
    }
    return taken;
  }

  bool in_tissue(int axis) const override { return in_tissue_[static_cast<std::size_t>(axis)]; }

  Signals signals(int axis) const override {
    const auto n = static_cast<std::size_t>(axis);
    return twins_[n]->signals(last_[n]);
  }

  void stop() noexcept override {}

 private:
  bool step(std::size_t n, const double (&speed)[2], const Bench& bench) {
    Command<double> command{};
    command.handle_angle = bench.handle_angle;
    command.force = bench.force;
    command.radial_force = bench.radial_force;
    command.contact = bench.contact;
    for (int i = 0; i < 2; ++i) command.spool_velocity[i] = speed[i];
    last_[n] = command;
    if (twins_[n]->step(command) != Status::ok) return false;
    held_[n] = bench;
    return true;
  }

  std::vector<engine::AnyTwin*> twins_;
  double time_step_;
  int steps_per_tick_;
  std::uint64_t steps_{};
  Benches held_{};
  bool in_tissue_[most_axes]{};
  std::array<Command<double>, most_axes> last_{};
};

}  // namespace tenodesis::runtime

#pragma once
// A digital twin as a device: each write advances it by one tick.

#include <algorithm>
#include <cmath>
#include <vector>

#include "device.hpp"
#include "engine/any_twin.hpp"

namespace tenodesis::runtime {

/// In simulated time; tissue that comes with the next step is not placed where the tip is.
class TwinDevice final : public Device {
 public:
  /// A tick is so many steps of the twin, which must outlive it.
  TwinDevice(engine::AnyTwin& twin, double time_step, int steps_per_tick)
      : Device(twin.sizes(), twin.commands(), twin.signals()),
        twin_(twin),
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
  Measurement<double> reading(const CompensatedAxis& axis) const override { return twin_.reading(axis); }
  void store(double* out) const override { twin_.store(out); }

  /// False where the load cannot be carried, and the step is made with the previous one.
  bool write(const double* row) override {
    std::copy_n(row, row_.size(), row_.begin());
    for (std::size_t j = 0; j < in_tissue_.size(); ++j) {
      double* at = row_.data() + contact_ + contact_columns * j;
      const Contact<double> contact = contact_at(at);
      in_tissue_[j] = contact != twin_.contact(j) && twin_.inside(j, contact);
      if (in_tissue_[j]) std::fill_n(at, contact_columns, 0.0);
    }
    bool taken = true;
    for (int k = 0; k < steps_per_tick_; ++k) {
      ++steps_;
      taken = twin_.step_or_hold(row_.data()) && taken;
    }
    return taken;
  }

  bool in_tissue(std::size_t joint) const override { return in_tissue_[joint]; }
  void stop() noexcept override {}

 private:
  engine::AnyTwin& twin_;
  double time_step_;
  int steps_per_tick_;
  std::uint64_t steps_{};
  std::size_t contact_;
  std::vector<char> in_tissue_;
  std::vector<double> row_;
};

}  // namespace tenodesis::runtime

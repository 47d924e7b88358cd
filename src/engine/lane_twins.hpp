#pragma once
// A group of twins that step in lockstep.

#include <array>
#include <cstdint>
#include <limits>
#include <utility>

#include "lane_job.hpp"
#include "tenodesis/twin_lanes.hpp"
#include "twin_rows.hpp"
#include "twin_spec.hpp"

namespace tenodesis::engine {

/// N twins with an axis of axis.hpp; their tendons have one contact in the sheath and one at each joint, their friction
/// law is the capstan's.
template <template <class> class AxisOf, int N>
class LaneTwins {
 public:
  using L = Lanes<double, N>;
  using Rows = Contacts<1 + tendon_joints>;
  using One = Twin<AxisOf<double>, Rows, CapstanWithConstant<double>>;
  using Many = Twin<AxisOf<L>, Rows, CapstanWithConstant<L>>;

  explicit LaneTwins(const tenodesis_lanes::Kind& kind) : steps_per_sample_(kind.steps_per_sample) {
    spec_.axis.joint_type = JointType(kind.joint_type);
    spec_.axis.handle_range = kind.handle_range;
    spec_.quasi_static = kind.quasi_static;
    // Sensors are read beside the steps.
    spec_.steps_per_sample = std::numeric_limits<int>::max();
  }

  void start(int k, const double* parameters, std::uint64_t seed) {
    for (std::size_t p = 0; p < row_.size(); ++p) {
      spec_.row[p] = parameters[p];
      row_[p].set(k, parameters[p]);
    }
    for (std::size_t p = 0; p < axis_row_.size(); ++p) {
      spec_.axis.parameters[p] = parameters[row_.size() + p];
      axis_row_[p].set(k, parameters[row_.size() + p]);
    }
    make(spec_.axis.parameters, spec_.row, one_[k]);
    make(axis_row_, row_, many_);
    const typename One::State rest = one_[k].rest(seed);
    put(k, rest, state_[current_]);
    state_[current_].noise.seed[k] = rest.noise.seed;
    state_[current_].noise.count[k] = rest.noise.count;
    state_[1 - current_].noise.seed[k] = rest.noise.seed;
    const Reading<double>& read = rest.reading;
    reading_.handle_angle.set(k, read.handle_angle);
    reading_.output_angle.set(k, read.output_angle);
    for (int i = 0; i < 2; ++i) {
      reading_.tension[i].set(k, read.tension[i]);
      reading_.spool_angle[i].set(k, read.spool_angle[i]);
    }
    runs_.set(k, true);
  }

  void advance(const tenodesis_lanes::Job& job) {
    if (spec_.quasi_static)
      advance_all<true>(job);
    else
      advance_all<false>(job);
  }

 private:
  // Flat, since a compiler inlines less of a larger file.
  template <bool resting>
  [[gnu::flatten]] void advance_all(const tenodesis_lanes::Job& job) {
    for (std::size_t k = 0; k < job.runs; ++k) {
      job.outcomes[2 * k] = runs_[int(k)] ? std::int64_t(job.steps) : 0;
      job.outcomes[2 * k + 1] = std::int64_t(runs_[int(k)] ? Status::ok : Status::no_equilibrium);
    }
    bool measured = job.tick != nullptr;
    for (std::size_t s = 0; s < job.signal_count; ++s) measured = measured || job.signals[s] < measured_signal_count;
    int until_sample = steps_per_sample_;
    // A copy that nothing else can change, so that what follows from its constants is computed once.
    const Many twin = [&] {
      Many copy = many_;
      copy.quasi_static = resting;
      return copy;
    }();
    for (std::size_t i = 0; i < job.steps && any(runs_); ++i) {
      if (job.tick != nullptr && i % std::size_t(job.steps_per_tick) == 0) tick(job, i);
      const Command<L> command = command_at(job, i);
      step(InLanes<Many, resting>{twin}, command, [&](int k, Status status) {
        runs_.set(k, false);
        if (std::cmp_greater_equal(k, job.runs)) return;
        job.outcomes[2 * k] = std::int64_t(i);
        job.outcomes[2 * k + 1] = std::int64_t(status);
      });
      if (--until_sample <= 0) {
        until_sample = steps_per_sample_;
        // A reading that nobody sees need not be made; the last one is that of the next call.
        const std::size_t kept = (i + job.every) / job.every * job.every - 1;
        if (measured && (job.tick != nullptr || kept < i + std::size_t(steps_per_sample_)))
          reading_ = readings(twin.sensors, twin.drive, state_[current_]);
        else
          skip_reading();
      }
      if ((i + 1) % job.every == 0) keep(job, i / job.every, command);
    }
  }

  template <class T, class S>
  void make(const std::array<S, parameter_count>& parameters, const std::array<S, twin_parameter_count>& row,
            T& twin) const {
    const AnyAxis<S> any = make_axis(spec_.axis, parameters);
    twin.axis = *std::get_if<AxisOf<S>>(&any);
    twin.law = CapstanWithConstant<S>{row[constant]};
    fill(twin, spec_, row, parameters[tendon_length]);
  }

  static void put(int k, const One::State& one, Many::State& to) {
    pair_states(to, one, [&](auto& all, const auto& own) { all.set(k, own); });
    to.sweeps.set(k, one.sweeps);
  }

  void tick(const tenodesis_lanes::Job& job, std::size_t i) {
    for (int k = 0; std::cmp_less(k, job.runs); ++k) {
      if (!runs_[k]) continue;
      const double read[] = {reading_.handle_angle[k], reading_.tension[0][k], reading_.tension[1][k],
                             reading_.spool_angle[0][k], reading_.spool_angle[1][k]};
      double asked[2];
      job.tick(job.loop, std::size_t(k), i, read, asked);
      for (int m = 0; m < 2; ++m) velocity_[m].set(k, asked[m]);
    }
  }

  // Lanes without a run of their own repeat the first.
  [[gnu::always_inline]] Command<L> command_at(const tenodesis_lanes::Job& job, std::size_t i) const {
    const double* rows[N];
    for (int k = 0; k < N; ++k) rows[k] = job.commands[std::cmp_less(k, job.runs) ? k : 0] + i * command_count;
    bool common = true;
    for (int k = 1; k < N; ++k) common = common && rows[k] == rows[0];
    const auto column = [&](std::size_t c) {
      L all(rows[0][c]);
      if (common) return all;
      for (int k = 0; k < N; ++k) all.set(k, rows[k][c]);
      return all;
    };
    const bool closed = job.tick != nullptr;
    return {column(0),
            column(1),
            column(2),
            column(3),
            {closed ? velocity_[0] : column(4), closed ? velocity_[1] : column(5)},
            column(6),
            {column(7), column(8)},
            {column(9), column(10), column(11)}};
  }

  // One step; fails(lane, status) is called for each lane of those that run and cannot.
  template <class Steps, class Fails>
  [[gnu::always_inline]] void step(const Steps& steps, const Command<L>& command, const Fails& fails) {
    const typename Many::State& now = state_[current_];
    typename Many::State& next = state_[1 - current_];
    const Mask<double, N> moved = steps.step(command, runs_, now, next);
    const Mask<double, N> left = runs_ && !moved;
    if (any(left)) [[unlikely]]
      for (int k = 0; k < N; ++k)
        if (left[k]) {
          const Status status = step_alone(k, command, now, next);
          if (status != Status::ok) fails(k, status);
        }
    next.noise = now.noise;
    current_ = 1 - current_;
  }

  [[gnu::noinline, gnu::cold]] Status step_alone(int k, const Command<L>& command, const Many::State& now,
                                                 Many::State& next) const {
    typename One::State state{};
    pair_states(now, state, [&](const auto& all, auto& own) { own = all[k]; });
    state.until_sample = std::numeric_limits<int>::max();
    const Command<double> own{command.handle_angle[k],
                              command.force[k],
                              command.radial_force[k],
                              command.weight[k],
                              {command.spool_velocity[0][k], command.spool_velocity[1][k]},
                              command.sheath_bend[k],
                              {command.let_out[0][k], command.let_out[1][k]},
                              {command.contact.angle[k], command.contact.stiffness[k], command.contact.damping[k]}};
    const Status status = one_[k].step(own, state);
    put(k, state, next);
    return status;
  }

  // Draws what a reading would.
  void skip_reading() {
    auto& count = state_[current_].noise.count;
    const auto draw = [&](const Sensor<L>& sensor) { count = count + one_where(sensor.noise > L(0.0)); };
    draw(many_.sensors.handle_encoder);
    draw(many_.sensors.output_encoder);
    for (int i = 0; i < 2; ++i) {
      draw(many_.sensors.load_cell[i]);
      draw(many_.sensors.motor_encoder);
    }
  }

  void keep(const tenodesis_lanes::Job& job, std::size_t column, const Command<L>& command) {
    const auto row = signals_of(many_, command, state_[current_], reading_);
    for (std::size_t k = 0; k < job.runs; ++k) {
      if (!runs_[int(k)]) continue;
      for (std::size_t s = 0; s < job.signal_count; ++s)
        job.out[k][s * job.columns + column] = row[job.signals[s]][int(k)];
      if (job.keep != nullptr) job.keep(job.loop, k, column);
    }
  }

  // What is aligned most comes first.
  Mask<double, N> runs_ = false;
  L velocity_[2]{};
  Reading<L> reading_{};
  std::array<L, parameter_count> axis_row_{};
  std::array<L, twin_parameter_count> row_{};
  Many many_{};
  Many::State state_[2]{};
  TwinSpec spec_{};
  std::array<One, N> one_{};
  int current_{};
  int steps_per_sample_;
};

}  // namespace tenodesis::engine

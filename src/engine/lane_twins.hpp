#pragma once
// A group of twins that step in lockstep.

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <utility>

#include "chain_rows.hpp"
#include "lane_job.hpp"
#include "tenodesis/twin_lanes.hpp"

namespace tenodesis::engine {

template <int axes, Mechanism tip, class S>
using LaneTwin = Twin<TendonChain<S, axes, 2 * axes, planar_layout<axes>(tip)>, 1 + 2 * axes>;

/// K twins of so many axes, of one tip's mechanism; their friction law is the capstan's.
template <int axes, Mechanism tip, int K>
class LaneTwins {
 public:
  using L = Lanes<double, K>;
  using One = LaneTwin<axes, tip, double>;
  using Many = LaneTwin<axes, tip, L>;

  explicit LaneTwins(const tenodesis_lanes::Kind& kind) : alone_(kind.step_alone) {
    many_.quasi_static = kind.quasi_static;
  }
  LaneTwins(const LaneTwins&) = delete;
  LaneTwins& operator=(const LaneTwins&) = delete;
  ~LaneTwins() = default;

  void start(int k, const void* twin, const void* state) {
    std::memcpy(&one_[k], twin, sizeof(One));
    typename One::State from;
    std::memcpy(&from, state, sizeof from);
    steps_per_sample_ = one_[k].steps_per_sample;
    until_sample_ = from.until_sample;
    // Sensors are read beside the steps.
    one_[k].steps_per_sample = std::numeric_limits<int>::max();
    pair_twins(many_, one_[k], [&](auto& all, const auto& own) { all.set(k, own); });
    for (int m = 0; m < One::M; ++m) many_.alike[m] = one_[k].alike[m] && (many_.alike[m] || !any(runs_));
    put(k, from, state_[current_]);
    for (auto& each : state_) each.noise.seed[k] = from.noise.seed;
    state_[current_].noise.count[k] = from.noise.count;
    runs_.set(k, true);
  }

  // Flat, since a compiler inlines less of a larger file.
  [[gnu::flatten]] void advance(const tenodesis_lanes::Job& job) {
    for (std::size_t k = 0; k < job.runs; ++k) {
      job.outcomes[2 * k] = runs_[int(k)] ? std::int64_t(job.steps) : 0;
      job.outcomes[2 * k + 1] = std::int64_t(runs_[int(k)] ? Status::ok : Status::no_equilibrium);
    }
    const bool measured = job.tick != nullptr || is_measured(job);
    for (std::size_t c = 0; c < job.column_count; ++c)
      for (int s = 0; s < 2; ++s) column_[s][c] = column_of(state_[s].command, job.columns[c].place);
    // A copy that nothing else can change, so that what follows from its constants is computed once.
    const Many twin = many_;
    for (std::size_t i = 0; i < job.steps && any(runs_); ++i) {
      if (job.tick != nullptr && i % std::size_t(job.steps_per_tick) == 0) tick(job, i);
      // What no column gives was that of other calls.
      if (i < 2) state_[1 - current_].command = {};
      step(twin, job, i);
      if (--until_sample_ <= 0) {
        until_sample_ = steps_per_sample_;
        // A reading that nobody sees need not be made; the last one is that of the next call.
        const std::size_t kept = (i + job.every) / job.every * job.every - 1;
        if (measured && (job.tick != nullptr || kept < i + std::size_t(steps_per_sample_)))
          twin.read(state_[current_]);
        else
          skip_reading(twin);
      }
      if ((i + 1) % job.every == 0) keep(twin, job, i / job.every);
    }
  }

 private:
  static constexpr ChainSizes sizes{axes, axes, 2 * axes};
  // Columns of a chain's commands; that which says in which axes the wrench is.
  static constexpr std::size_t most_columns = 14 + 8 * axes;
  static constexpr std::size_t stem_place = 7 + 3 * axes;

  // Whether readings are among the kept signals.
  static bool is_measured(const tenodesis_lanes::Job& job) {
    return std::any_of(job.signals, job.signals + job.signal_count, [](std::size_t s) { return s >= first_measured; });
  }

  static void put(int k, const One::State& one, Many::State& to) {
    pair_states(to, one, [&](auto& all, const auto& own) { all.set(k, own); });
    to.sweeps.set(k, one.sweeps);
  }
  static void take(int k, const Many::State& from, One::State& to) {
    pair_states(from, to, [&](const auto& all, auto& own) { own = all[k]; });
  }

  void tick(const tenodesis_lanes::Job& job, std::size_t i) {
    const auto& now = state_[current_];
    for (int k = 0; std::cmp_less(k, job.runs); ++k) {
      if (!runs_[k]) continue;
      double read[axes * tenodesis_lanes::axis_readings];
      double asked[2 * axes];
      for (std::size_t n = 0; n < job.axis_count; ++n) {
        const auto& [handle, first, second] = job.axes[n];
        double* to = read + n * tenodesis_lanes::axis_readings;
        to[0] = now.measured_handle[handle][k];
        to[1] = now.measured_tension[first][k];
        to[2] = now.measured_tension[second][k];
        to[3] = now.measured_spool[first][k];
        to[4] = now.measured_spool[second][k];
      }
      job.tick(job.loop, std::size_t(k), i, read, asked);
      for (std::size_t n = 0; n < job.axis_count; ++n) {
        velocity_[job.axes[n].agonist].set(k, asked[2 * n]);
        velocity_[job.axes[n].antagonist].set(k, asked[2 * n + 1]);
      }
    }
  }

  // A row's column of a command, by its place; null: whether the wrench keeps its direction.
  template <class Command>
  static auto* column_of(Command& command, std::size_t place) {
    using S = Command::S;
    S* found = nullptr;
    if (place == stem_place) return found;
    std::size_t left = place - (place > stem_place ? 1 : 0);
    pair_commands(command, command, [&](S& value, const S&) {
      if (left-- == 0) found = &value;
    });
    return found;
  }

  [[gnu::always_inline]] void step(const Many& twin, const tenodesis_lanes::Job& job, std::size_t i) {
    const typename Many::State& now = state_[current_];
    typename Many::State& next = state_[1 - current_];
    auto& command = next.command;
    // Lanes without a run of their own repeat the first.
    const double* rows[K];
    for (int k = 0; k < K; ++k) rows[k] = job.commands[std::cmp_less(k, job.runs) ? k : 0] + i * job.column_count;
    bool common = true;
    for (int k = 1; k < K; ++k) common = common && rows[k] == rows[0];
    // Lanes whose wrench is in other axes than the first's step alone.
    Mask<double, K> same = true;
    L sum(0.0);
    for (std::size_t c = 0; c < job.column_count; ++c) {
      L all(rows[0][c]);
      if (!common)
        for (int k = 0; k < K; ++k) all.set(k, rows[k][c]);
      sum = sum + all;
      if (L* to = column_[1 - current_][c]; to != nullptr) {
        *to = all * L(job.columns[c].factor);
      } else {
        command.load.in_stem_axes = all[0] != 0;
        const Mask<double, K> holds = all != L(0.0);
        same = command.load.in_stem_axes ? holds : !holds;
      }
    }
    if (job.tick != nullptr)
      for (std::size_t n = 0; n < job.axis_count; ++n)
        for (const std::size_t m : {job.axes[n].agonist, job.axes[n].antagonist}) {
          command.spool_velocity[m] = velocity_[m];
          sum = sum + velocity_[m];
        }
    // Not of infinities and NaN.
    same = same && sum - sum == L(0.0);  // NOLINT(misc-redundant-expression)
    const Mask<double, K> moved = step_in_lanes(twin, runs_ && same, now, next);
    const Mask<double, K> left = runs_ && !(moved && same);
    if (any(left)) [[unlikely]]
      for (int k = 0; k < K; ++k)
        if (left[k]) step_alone(k, job, i, rows[k], now, next);
    next.noise = now.noise;
    for (int n = 0; n < axes; ++n) {
      next.measured_handle[n] = now.measured_handle[n];
      next.measured_angle[n] = now.measured_angle[n];
    }
    for (int m = 0; m < 2 * axes; ++m) {
      next.measured_tension[m] = now.measured_tension[m];
      next.measured_spool[m] = now.measured_spool[m];
    }
    current_ = 1 - current_;
  }

  [[gnu::noinline, gnu::cold]] void step_alone(int k, const tenodesis_lanes::Job& job, std::size_t i, const double* row,
                                               const Many::State& now, Many::State& next) {
    typename One::State state{};
    take(k, now, state);
    state.until_sample = std::numeric_limits<int>::max();
    typename One::Command command{};
    for (std::size_t c = 0; c < job.column_count; ++c) {
      const auto [place, factor] = job.columns[c];
      if (double* to = column_of(command, place); to != nullptr)
        *to = row[c] * factor;
      else
        command.load.in_stem_axes = row[c] != 0;
    }
    if (job.tick != nullptr)
      for (std::size_t n = 0; n < job.axis_count; ++n)
        for (const std::size_t m : {job.axes[n].agonist, job.axes[n].antagonist})
          command.spool_velocity[m] = velocity_[m][k];
    const auto status = Status(alone_(&one_[k], &command, &state));
    put(k, state, next);
    if (status == Status::ok) return;
    runs_.set(k, false);
    if (std::cmp_greater_equal(k, job.runs)) return;
    job.outcomes[2 * k] = std::int64_t(i);
    job.outcomes[2 * k + 1] = std::int64_t(status);
  }

  // Draws what a reading would.
  void skip_reading(const Many& twin) {
    auto& count = state_[current_].noise.count;
    const auto draw = [&](const Sensor<L>& sensor) { count = count + one_where(sensor.noise > L(0.0)); };
    for (int n = 0; n < axes; ++n) draw(twin.handle_encoder);
    for (int n = 0; n < axes; ++n) draw(twin.output_encoder);
    for (int m = 0; m < 2 * axes; ++m) {
      draw(twin.load_cell[m]);
      draw(twin.motor_encoder);
    }
  }

  void keep(const Many& twin, const tenodesis_lanes::Job& job, std::size_t sample) {
    std::array<L, most_signals> row;
    std::size_t width = 0;
    store_signals(twin, state_[current_], sizes, [&](const L& value) { row[width++] = value; });
    row[width] = -twin.load_of(state_[current_].command).wrench.force.x;
    for (std::size_t k = 0; k < job.runs; ++k) {
      if (!runs_[int(k)]) continue;
      for (std::size_t s = 0; s < job.signal_count; ++s)
        job.out[k][s * job.samples + sample] = row[job.signals[s]][int(k)];
      if (job.keep != nullptr) job.keep(job.loop, k, sample);
    }
  }

  // Columns of a chain's signals, and the force against x.
  static constexpr std::size_t first_measured = 13 * axes + 1;
  static constexpr std::size_t most_signals = 19 * axes + 3;

  // What is aligned most comes first.
  Mask<double, K> runs_ = false;
  L velocity_[2 * axes]{};
  Many many_{};
  Many::State state_[2]{};
  L* column_[2][most_columns]{};
  std::array<One, K> one_{};
  decltype(tenodesis_lanes::Kind::step_alone) alone_;
  int current_{};
  int steps_per_sample_{1};
  int until_sample_{1};
};

}  // namespace tenodesis::engine

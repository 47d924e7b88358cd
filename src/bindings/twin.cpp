// The digital twin for Python: a single one, and many of them over threads.

#include <algorithm>
#include <atomic>
#include <cmath>
#include <memory>
#include <thread>

#include "engine/any_twin.hpp"
#include "engine/lane_loop.hpp"
#include "engine/vectors.hpp"
#include "module.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

Commands commands_of(const In<2>& rows) {
  require(rows.shape(1) == command_count, "a command has another number of columns");
  return {rows.data()};
}

// A row of parameters: the twin's, then its axis's.
constexpr std::size_t row_count = std::size_t(twin_parameter_count) + std::size_t(parameter_count);

TwinSpec with_row(const TwinSpec& spec, const double* row) {
  TwinSpec own = spec;
  std::copy_n(row, twin_parameter_count, own.row.begin());
  std::copy_n(row + twin_parameter_count, parameter_count, own.axis.parameters.begin());
  return own;
}

/// Twins side by side, each with its own parameters and state, stepped together; where they can, in lanes.
class TwinBatch {
 public:
  TwinBatch(const TwinSpec& spec, std::size_t count, int most_lanes, bool in_lanes)
      : spec_(spec), count_(count), lanes_(in_lanes ? lanes_of_processor(most_lanes) : nullptr) {
    if (lanes_ == nullptr) {
      alone_.resize(count);
      return;
    }
    for (std::size_t i = 0; i < count; i += stride())
      groups_.emplace_back(lanes_->make({1, int(mechanism_of(spec.axis.joint_type)), spec.quasi_static}),
                           lanes_->release);
  }

  /// Whether twins of a spec can step in lanes, whose rows of parameters all have a hand that yields, or none has.
  static bool in_lanes(const TwinSpec& spec, const In<2>& rows) {
    const auto yields = [&](std::size_t i) { return rows(i, hand_stiffness) > 0; };
    for (std::size_t i = 1; i < rows.shape(0); ++i)
      if (yields(i) != yields(0)) return false;
    return steps_in_lanes(spec);
  }

  TwinBatch(const TwinBatch&) = delete;
  TwinBatch& operator=(const TwinBatch&) = delete;
  ~TwinBatch() = default;

  std::size_t count() const { return count_; }
  /// Twins that are stepped together.
  std::size_t stride() const { return lanes_ != nullptr ? std::size_t(lanes_->count) : 1; }

  /// Puts a twin to rest, with a row of parameters.
  void start(std::size_t i, const double* row, std::uint64_t seed) {
    if (lanes_ == nullptr) {
      alone_[i] = make_twin(with_row(spec_, row), seed);
      return;
    }
    void* group = groups_[i / stride()].get();
    with_twin(with_row(spec_, row), [&](const auto& twin) {
      const auto rest = twin.rest(seed);
      lanes_->start(group, int(i % stride()), &twin, &rest);
      // What fills a group up repeats its first.
      if (i % stride() == 0)
        for (std::size_t k = count_ - i; k < stride(); ++k) lanes_->start(group, int(k), &twin, &rest);
    });
  }

  struct Work {
    std::size_t steps;
    const double* commands;
    const std::vector<std::size_t>& given;  // columns of the commands
    bool common;                            // commands are for all
    const std::vector<std::size_t>& signals;
    std::size_t every;
    double* out;
    std::size_t rows, columns;  // of out
    std::int64_t* outcome;
    const std::vector<AnyController*>& controllers;  // none: no loop is closed
    int steps_per_tick;
    double time_step;

    const double* commands_of(std::size_t i) const { return commands + (common ? 0 : i * steps * given.size()); }
    double* kept(std::size_t i) const { return out + i * rows * columns; }
  };

  /// Steps all twins over their commands, over threads.
  void advance(const Work& work, int threads) {
    std::atomic<std::size_t> next{0};
    const auto some = [&] {
      for (std::size_t i = next.fetch_add(stride()); i < count_; i = next.fetch_add(stride()))
        if (lanes_ != nullptr)
          advance_group(work, i);
        else
          advance_alone(work, i);
    };
    // Starting a thread costs as much as some ten thousand steps.
    const std::size_t useful = count_ * work.steps / 20000 + 1;
    const std::size_t groups = (count_ + stride() - 1) / stride();
    std::vector<std::jthread> pool;
    for (std::size_t n = 1; n < std::min({std::size_t(threads), groups, useful}); ++n) pool.emplace_back(some);
    some();
  }

 private:
  // A loop through controllers, for the lanes.
  struct Loop {
    const Work& work;
    std::size_t first;

    static void tick(void* of, std::size_t run, std::size_t step, const double* readings, double* velocities) {
      const Loop& loop = *static_cast<const Loop*>(of);
      tick_in_lanes(*loop.work.controllers[loop.first + run], double(step + 1) * loop.work.time_step, readings,
                    velocities);
    }

    static void keep(void* of, std::size_t run, std::size_t column) {
      const Loop& loop = *static_cast<const Loop*>(of);
      keep_control(loop.work, loop.first + run, column);
    }
  };

  // The controller's signals follow the twin's.
  static void keep_control(const Work& work, std::size_t i, std::size_t column) {
    const ControlSignals found = control_signals(*work.controllers[i], 0);
    for (std::size_t s = 0; s < work.signals.size(); ++s)
      if (work.signals[s] >= signal_count)
        work.kept(i)[s * work.columns + column] = found[work.signals[s] - signal_count];
  }

  void advance_group(const Work& work, std::size_t first) {
    const std::size_t runs = std::min(stride(), count_ - first);
    std::array<const double*, 16> commands{};
    std::array<double*, 16> kept{};
    for (std::size_t k = 0; k < runs; ++k) {
      commands[k] = work.commands_of(first + k);
      kept[k] = work.kept(first + k);
    }
    const auto own = std::ranges::find_if(work.signals, [](std::size_t s) { return s >= signal_count; });
    const bool closed = !work.controllers.empty();
    Loop loop{work, first};
    constexpr tenodesis_lanes::Axis axis{0, agonist, antagonist};
    std::array<tenodesis_lanes::Column, command_count> columns;
    std::ranges::transform(work.given, columns.begin(), [](std::size_t c) { return axis_columns[c]; });
    lanes_->advance(groups_[first / stride()].get(), {.runs = runs,
                                                      .steps = work.steps,
                                                      .commands = commands.data(),
                                                      .columns = columns.data(),
                                                      .column_count = work.given.size(),
                                                      .planar = true,
                                                      .signals = work.signals.data(),
                                                      .signal_count = std::size_t(own - work.signals.begin()),
                                                      .every = work.every,
                                                      .out = kept.data(),
                                                      .signal_stride = work.columns,
                                                      .sample_stride = 1,
                                                      .outcomes = work.outcome + 2 * first,
                                                      .tick = closed ? &Loop::tick : nullptr,
                                                      .keep = closed ? &Loop::keep : nullptr,
                                                      .loop = &loop,
                                                      .axes = &axis,
                                                      .axis_count = 1,
                                                      .steps_per_tick = work.steps_per_tick});
  }

  void advance_alone(const Work& work, std::size_t i) {
    Progress progress;
    if (work.controllers.empty()) {
      progress =
          alone_[i]->sample({work.commands_of(i), &work.given}, work.steps, work.signals, work.every, work.kept(i), work.columns);
    } else {
      AnyTwin* const twins[] = {alone_[i].get()};
      const Commands rows[] = {{work.commands_of(i), &work.given}};
      TwinsByAxis plant(twins, rows);
      ClosedLoop loop(plant, *work.controllers[i], work.steps_per_tick, work.time_step);
      const auto keep = [&](std::size_t step) {
        if ((step + 1) % work.every != 0) return;
        const auto found = plant.signals(0);
        for (std::size_t s = 0; s < work.signals.size(); ++s)
          if (work.signals[s] < signal_count)
            work.kept(i)[s * work.columns + step / work.every] = found[work.signals[s]];
        keep_control(work, i, step / work.every);
      };
      progress = loop.run(work.steps, 0, {}, keep);
    }
    work.outcome[2 * i] = std::int64_t(progress.steps);
    work.outcome[2 * i + 1] = std::int64_t(progress.status);
  }

  TwinSpec spec_;
  std::size_t count_;
  const tenodesis_lanes::Lanes* lanes_;
  std::vector<std::unique_ptr<void, void (*)(void*)>> groups_;
  std::vector<std::unique_ptr<AnyTwin>> alone_;
};

std::unique_ptr<TwinBatch> make_batch(const TwinSpec& spec, const In<2>& parameters,
                                      const Array<const std::uint64_t, 1>& seeds, int most_lanes) {
  if (parameters.shape(1) != row_count || parameters.shape(0) != seeds.shape(0))
    throw nb::value_error("parameters and seeds do not fit");
  auto batch =
      std::make_unique<TwinBatch>(spec, parameters.shape(0), most_lanes, TwinBatch::in_lanes(spec, parameters));
  for (std::size_t i = 0; i < batch->count(); ++i) batch->start(i, &parameters(i, 0), seeds.data()[i]);
  return batch;
}

/// Restarts some twins of a batch.
void restart(TwinBatch& batch, const Array<const std::int64_t, 1>& which, const In<2>& parameters,
             const Array<const std::uint64_t, 1>& seeds) {
  if (parameters.shape(1) != row_count || parameters.shape(0) != which.shape(0) || seeds.shape(0) != which.shape(0))
    throw nb::value_error("which, parameters and seeds do not fit");
  for (std::size_t n = 0; n < which.shape(0); ++n) {
    const auto i = std::size_t(which.data()[n]);
    if (i >= batch.count()) throw nb::value_error("no such twin");
    batch.start(i, &parameters(n, 0), seeds.data()[n]);
  }
}

void advance(TwinBatch& batch, const In<3>& commands, const std::vector<std::size_t>& given,
             const std::vector<std::size_t>& signals, std::size_t every, const Out<3>& out,
             const Array<std::int64_t, 2>& outcome, int threads, const std::vector<AnyController*>& controllers,
             int steps_per_tick, double time_step) {
  const std::size_t runs = batch.count();
  const std::size_t count = commands.shape(1);
  if (commands.shape(2) != given.size() || (commands.shape(0) != runs && commands.shape(0) != 1) ||
      out.shape(0) != runs || out.shape(1) != signals.size() || every == 0 || out.shape(2) != count / every ||
      outcome.shape(0) != runs || outcome.shape(1) != 2 || (!controllers.empty() && controllers.size() != runs) ||
      steps_per_tick < 1)
    throw nb::value_error("commands, controllers and outputs do not fit");
  if (given.size() > command_count ||
      !std::ranges::all_of(given, [](std::size_t column) { return column < command_count; }))
    throw nb::value_error("no such column");
  const std::size_t known = signal_count + (controllers.empty() ? 0 : control_signal_count);
  if (!std::ranges::all_of(signals, [&](std::size_t signal) { return signal < known; }) ||
      !std::ranges::is_sorted(signals, {}, [](std::size_t signal) { return signal >= signal_count; }))
    throw nb::value_error("no such signal");
  const nb::gil_scoped_release release;
  batch.advance({count, commands.data(), given, commands.shape(0) == 1, signals, every, out.data(), out.shape(1), out.shape(2),
                 outcome.data(), controllers, steps_per_tick, time_step},
                threads);
}

}  // namespace

void bind_twin(nb::module_& m) {
  nb::class_<TwinSpec>(m, "TwinSpec", "A twin of one axis, in SI units.")
      .def(
          "__init__",
          [](TwinSpec* self, const Spec& axis, const TwinRow& row, bool speed_dependent, bool tension_dependent,
             int sheath_contacts, int vertices_per_joint, int steps_per_sample, bool quasi_static, bool currents) {
            if (sheath_contacts < 1 || sheath_contacts > most_sheath_contacts)
              throw nb::value_error("no such number of sheath contacts");
            if (vertices_per_joint < 1 || vertices_per_joint > most_vertices_per_joint)
              throw nb::value_error("no such number of vertices of a joint");
            if (speed_dependent && tension_dependent) throw nb::value_error("no such friction law");
            new (self) TwinSpec{axis,
                                speed_dependent,
                                tension_dependent,
                                sheath_contacts,
                                vertices_per_joint,
                                steps_per_sample,
                                quasi_static,
                                currents,
                                row};
          },
          "axis"_a, "row"_a, "speed_dependent"_a, "tension_dependent"_a, "sheath_contacts"_a, "vertices_per_joint"_a,
          "steps_per_sample"_a, "quasi_static"_a, "currents"_a = false);

  nb::class_<AnyTwin>(m, "Twin", "The digital twin of one axis, with its state.")
      .def(nb::new_([](const TwinSpec& spec, std::uint64_t seed) { return make_twin(spec, seed); }), "spec"_a, "seed"_a)
      .def(
          "run",
          [](AnyTwin& twin, const In<2>& commands, const Out<2>& out) {
            const std::size_t count = commands.shape(0);
            if (out.shape(0) != count || out.shape(1) != signal_count) throw nb::value_error("out does not fit");
            const Commands rows = commands_of(commands);
            const nb::gil_scoped_release release;
            const Progress progress = twin.run(rows, count, out.data());
            return std::make_tuple(progress.steps, progress.status);
          },
          "commands"_a, "out"_a,
          nb::sig("def run(self, commands: NDArray[numpy.float64], out: NDArray[numpy.float64]) -> tuple[int, Status]"),
          "Step over rows of commands; a row of signals per step in out. Returns the steps taken and the last status.")
      .def(
          "audit",
          [](AnyTwin& twin, const In<2>& commands) {
            EnergyTotals totals;
            const Commands rows = commands_of(commands);
            Progress progress;
            {
              const nb::gil_scoped_release release;
              progress = twin.audit(rows, commands.shape(0), totals);
            }
            return std::make_tuple(progress.steps, progress.status, totals.values, totals.least_friction,
                                   totals.worst_residual, totals.most_sweeps);
          },
          "commands"_a,
          nb::sig("def audit(self, commands: NDArray[numpy.float64]) -> "
                  "tuple[int, Status, list[float], float, float, int]"),
          "Step over rows of commands: steps, status, energies in J (stored before and after, handle, spools, load, "
          "friction, damping, tissue), least friction loss of a step, worst residual, most sweeps.")
      .def_prop_rw(
          "state",
          [](const AnyTwin& twin) {
            const std::string bytes = twin.state();
            return nb::bytes(bytes.data(), bytes.size());
          },
          [](AnyTwin& twin, const nb::bytes& bytes) { twin.set_state({bytes.c_str(), bytes.size()}); },
          "The state, as bytes.")
      .def_prop_ro("handle_wanted", &AnyTwin::handle_wanted, "Handle angle of the last command, rad.")
      .def_prop_ro(
          "contact",
          [](const AnyTwin& twin) {
            const Contact<double> contact = twin.contact();
            return std::make_tuple(contact.angle, contact.stiffness, contact.damping);
          },
          "Tissue by the last command: angle in rad, stiffness in N/m, damping in N s/m.")
      .def(
          "signals", [](const AnyTwin& twin, const In<2>& /*command*/) { return twin.signals(); }, "command"_a,
          nb::sig("def signals(self, command: NDArray[numpy.float64]) -> list[float]"), "The signals as they stand.");

  nb::class_<TwinBatch>(m, "TwinBatch", "Many twins of one axis each, with their states, stepped together.")
      .def(nb::new_(&make_batch), "spec"_a, "parameters"_a, "seeds"_a, "most_lanes"_a = 8,
           "One twin per row of parameters (a twin's, then its axis's), at rest; at most so many in a vector's lanes.")
      .def("restart", &restart, "which"_a, "parameters"_a, "seeds"_a,
           nb::sig("def restart(self, which: NDArray[numpy.int64], parameters: NDArray[numpy.float64], seeds: "
                   "NDArray[numpy.uint64]) -> None"),
           "Put some of them to rest, with new parameters and seeds.")
      .def_prop_ro("together", &TwinBatch::stride, "How many step in lockstep, in the lanes of a vector.")
      .def(
          "advance", &advance, "commands"_a, "given"_a, "signals"_a, "every"_a, "out"_a, "outcome"_a, "threads"_a, "controllers"_a,
          "steps_per_tick"_a, "time_step"_a,
          nb::sig("def advance(self, commands: NDArray[numpy.float64], given: Sequence[int], signals: Sequence[int], every: int, out: "
                  "NDArray[numpy.float64], outcome: NDArray[numpy.int64], threads: int, controllers: "
                  "Sequence[Controller], steps_per_tick: int, time_step: float) -> None"),
          "Step over commands by twin, step and column of those that are given, or common ones, with a controller each "
          "if there are any; "
          "write every n-th step's signals, the controllers' counted on after the twins', by twin, signal and sample; "
          "outcome: steps taken and status of each. A twin that could not take a step stands still until its restart.");

  m.def(
      "twin_parameters", [] { return list_of(twin_parameter_names); }, "Names of a twin's parameters, in their order.");
  m.def("twin_commands", [] { return list_of(command_names); }, "Names of a command's columns.");
  m.def("twin_signals", [] { return list_of(signal_names); }, "Names of the signals a step writes, in their order.");
  m.def("most_sheath_contacts", [] { return most_sheath_contacts; }, "How many contacts a twin's sheath can have.");
  m.def(
      "rig_arm",
      [](const Spec& spec) {
        return std::visit([](const auto& axis) { return axis.distal.rig_arm(); }, make_axis(spec));
      },
      "spec"_a, "From a load rig's pivot to the tip of the straight joint, m.");
  m.def(
      "joint_shares",
      [](const Spec& spec) {
        return std::visit(
            [&](const auto& axis) {
              const double length = spec.parameters[tendon_length];
              return std::make_tuple(axis.proximal.tendon_span() / length, axis.distal.tendon_span() / length);
            },
            make_axis(spec));
      },
      "spec"_a, "Shares of a tendon's length that lie in the handle's joint and in the tip's.");
}

}  // namespace tenodesis::bindings

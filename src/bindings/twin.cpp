// Digital twins for Python: a single one, and many of them over threads.

#include <algorithm>
#include <atomic>
#include <numeric>
#include <thread>

#include "engine/axes_twin.hpp"
#include "engine/lane_loop.hpp"
#include "engine/vectors.hpp"
#include "module.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

namespace tenodesis::bindings {
namespace {

using namespace engine;

using Outcome = std::tuple<std::size_t, Status>;
using AxisPlaces = std::vector<std::array<std::size_t, 3>>;

std::vector<CompensatedAxis> axes_of(const AxisPlaces& axes, const ChainSizes& sizes) {
  std::vector<CompensatedAxis> compensated;
  for (const auto& [handle, agonist_at, antagonist_at] : axes) {
    require(handle < sizes.handles && agonist_at < sizes.tendons && antagonist_at < sizes.tendons,
            "an axis names what is not there");
    compensated.push_back({handle, agonist_at, antagonist_at});
  }
  return compensated;
}

Outcome run(AnyTwin& twin, const In<2>& commands, const Out<2>& out, const std::optional<Out<1>>& energy) {
  const std::size_t width = width_of(twin.commands());
  require(commands.shape(1) == width && out.shape(1) == width_of(twin.signals()) && out.shape(0) == commands.shape(0) &&
              (!energy || energy->shape(0) == energy_names.size()),
          "commands, signals or energies do not fit the twin");
  const nb::gil_scoped_release release;
  double* const totals = energy ? energy->data() : nullptr;
  if (totals != nullptr) {
    std::fill_n(totals, energy_names.size(), 0.0);
    totals[0] = totals[1] = twin.stored();
  }
  double* to = out.data();
  for (std::size_t i = 0; i < commands.shape(0); ++i) {
    const double* row = commands.data() + i * width;
    const Status found = totals != nullptr ? twin.audit(row, totals) : twin.step(row);
    if (found != Status::ok) return {i, found};
    to = twin.store(to);
  }
  return {commands.shape(0), Status::ok};
}

Outcome run_controlled(AnyTwin& twin, AnyController& controller, const AxisPlaces& axes, const In<2>& commands,
                       int steps_per_tick, double time_step, double relay, std::size_t started,
                       const std::optional<Array<const std::uint8_t, 1>>& requests, const std::optional<In<3>>& values,
                       const std::optional<Array<const std::uint8_t, 3>>& modes, const Out<2>& out,
                       const Out<3>& control) {
  const std::size_t count = commands.shape(0);
  const std::size_t width = width_of(twin.commands());
  const auto fits = [&](const auto& stack) {
    return stack.shape(0) == axes.size() && stack.shape(1) == count && stack.shape(2) == injection_point_count;
  };
  require(commands.shape(1) == width && out.shape(1) == width_of(twin.signals()) && out.shape(0) == count &&
              steps_per_tick >= 1 && (!requests || requests->shape(0) == count) &&
              values.has_value() == modes.has_value() && (!values || (fits(*values) && fits(*modes))) &&
              std::cmp_equal(axes.size(), controller.axes()) && control.shape(0) == count &&
              control.shape(1) == axes.size() && control.shape(2) == control_signal_count,
          "commands, requests, injected faults, signals and axes do not fit the twin and its controller");
  const std::vector<CompensatedAxis> compensated = axes_of(axes, twin.sizes());
  InjectedSteps injected;
  if (values && modes) injected = {values->data(), modes->data(), nullptr};
  if (requests) injected.request = requests->data();
  const nb::gil_scoped_release release;
  CompensatedTwin plant(twin, compensated, {commands.data(), width, {}});
  ClosedLoop loop(plant, controller, steps_per_tick, time_step, relay);
  double* to = out.data();
  double* said = control.data();
  const Progress progress = loop.run(count, started, injected, [&](std::size_t) {
    to = twin.store(to);
    for (std::size_t n = 0; n < compensated.size(); ++n)
      said = std::ranges::copy(control_signals(controller, n), said).out;
  });
  return {progress.steps, progress.status};
}

/// The lanes that twins can step in together; null if they cannot.
const tenodesis_lanes::Lanes* lanes_of(const std::vector<AnyTwin*>& twins, int most) {
  const auto first = twins[0]->in_lanes();
  if (!first) return nullptr;
  const bool together = std::ranges::all_of(twins, [&](const AnyTwin* twin) {
    const auto bytes = twin->in_lanes();
    return bytes && bytes->goes_with(*first);
  });
  return together ? lanes_of_processor(most) : nullptr;
}

/// Twins side by side, each with its own state, stepped together; where they can, in lanes.
class TwinBatch {
 public:
  TwinBatch(const std::vector<AnyTwin*>& twins, int most_lanes)
      : count_(twins.size()),
        sizes_(twins.at(0)->sizes()),
        commands_(width_of(twins[0]->commands())),
        signals_(width_of(twins[0]->signals())),
        columns_(twins[0]->lane_columns()),
        lanes_(lanes_of(twins, most_lanes)),
        alone_(lanes_ == nullptr ? count_ : 0) {
    for (const AnyTwin* twin : twins)
      require(width_of(twin->commands()) == commands_ && width_of(twin->signals()) == signals_,
              "the twins differ in joints or tendons");
    if (const auto first = twins[0]->in_lanes(); first && lanes_ != nullptr)
      for (std::size_t i = 0; i < count_; i += stride())
        groups_.emplace_back(lanes_->make(first->kind), lanes_->release);
    for (std::size_t i = 0; i < count_; ++i) start(i, *twins[i]);
  }

  TwinBatch(const TwinBatch&) = delete;
  TwinBatch& operator=(const TwinBatch&) = delete;
  ~TwinBatch() = default;

  std::size_t count() const { return count_; }
  const ChainSizes& sizes() const { return sizes_; }
  std::size_t commands() const { return commands_; }
  std::size_t signals() const { return signals_; }
  /// Twins that are stepped together.
  std::size_t stride() const { return lanes_ != nullptr ? std::size_t(lanes_->count) : 1; }

  /// Puts a twin, in its state, in a place.
  void start(std::size_t i, const AnyTwin& twin) {
    if (lanes_ == nullptr) {
      alone_[i] = twin.copy();
      return;
    }
    const auto bytes = twin.in_lanes();
    if (!bytes) throw nb::value_error("the twin does not step in lanes");
    void* group = groups_[i / stride()].get();
    lanes_->start(group, int(i % stride()), bytes->twin, bytes->state);
    // What fills a group up repeats its first.
    if (i % stride() == 0)
      for (std::size_t k = count_ - i; k < stride(); ++k) lanes_->start(group, int(k), bytes->twin, bytes->state);
  }

  struct Work {
    std::size_t steps;
    const double* commands;
    const std::vector<std::size_t>& given;  // columns of the commands
    bool common;                            // commands are for all
    const std::vector<std::size_t>& signals;
    std::size_t every;
    double* out;
    std::size_t samples;  // of each signal in out
    std::int64_t* outcome;
    const std::vector<AnyController*>& controllers;  // none: no loop is closed
    const std::vector<CompensatedAxis>& axes;
    int steps_per_tick;
    double time_step;

    const double* commands_of(std::size_t i) const { return commands + (common ? 0 : i * steps * given.size()); }
    double* kept(std::size_t i) const { return out + i * signals.size() * samples; }
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
    const TwinBatch& batch;
    const Work& work;
    std::size_t first;

    static void tick(void* of, std::size_t run, std::size_t step, const double* readings, double* velocities) {
      const Loop& loop = *static_cast<const Loop*>(of);
      tick_in_lanes(*loop.work.controllers[loop.first + run], double(step + 1) * loop.work.time_step, readings,
                    velocities);
    }

    static void keep(void* of, std::size_t run, std::size_t sample) {
      const Loop& loop = *static_cast<const Loop*>(of);
      loop.batch.keep_control(loop.work, loop.first + run, sample);
    }
  };

  // The controller's signals follow the twin's, by axis.
  void keep_control(const Work& work, std::size_t i, std::size_t sample) const {
    for (std::size_t n = 0; n < work.axes.size(); ++n) {
      const ControlSignals found = control_signals(*work.controllers[i], n);
      const std::size_t first = signals_ + n * found.size();
      for (std::size_t s = 0; s < work.signals.size(); ++s)
        if (work.signals[s] >= first && work.signals[s] < first + found.size())
          work.kept(i)[s * work.samples + sample] = found[work.signals[s] - first];
    }
  }

  void advance_group(const Work& work, std::size_t first) {
    const std::size_t runs = std::min(stride(), count_ - first);
    std::array<const double*, 16> commands{};
    std::array<double*, 16> kept{};
    for (std::size_t k = 0; k < runs; ++k) {
      commands[k] = work.commands_of(first + k);
      kept[k] = work.kept(first + k);
    }
    std::vector<tenodesis_lanes::Column> columns;
    columns.reserve(work.given.size());
    for (const std::size_t column : work.given) columns.push_back(columns_[column]);
    const auto own = std::ranges::find_if(work.signals, [&](std::size_t s) { return s >= signals_; });
    const bool closed = !work.controllers.empty();
    Loop loop{*this, work, first};
    lanes_->advance(groups_[first / stride()].get(), {.runs = runs,
                                                      .steps = work.steps,
                                                      .commands = commands.data(),
                                                      .columns = columns.data(),
                                                      .column_count = columns.size(),
                                                      .signals = work.signals.data(),
                                                      .signal_count = std::size_t(own - work.signals.begin()),
                                                      .every = work.every,
                                                      .out = kept.data(),
                                                      .samples = work.samples,
                                                      .outcomes = work.outcome + 2 * first,
                                                      .tick = closed ? &Loop::tick : nullptr,
                                                      .keep = closed ? &Loop::keep : nullptr,
                                                      .loop = &loop,
                                                      .axes = work.axes.data(),
                                                      .axis_count = work.axes.size(),
                                                      .steps_per_tick = work.steps_per_tick});
  }

  void advance_alone(const Work& work, std::size_t i) {
    AnyTwin& twin = *alone_[i];
    const GivenRows rows{work.commands_of(i), commands_, work.given};
    std::vector<double> row(commands_), signals(signals_);
    const auto keep = [&](std::size_t step) {
      if ((step + 1) % work.every != 0) return;
      twin.store(signals.data());
      for (std::size_t s = 0; s < work.signals.size(); ++s)
        if (work.signals[s] < signals_) work.kept(i)[s * work.samples + step / work.every] = signals[work.signals[s]];
    };
    Progress progress;
    if (!work.controllers.empty()) {
      CompensatedTwin plant(twin, work.axes, rows);
      ClosedLoop loop(plant, *work.controllers[i], work.steps_per_tick, work.time_step);
      progress = loop.run(work.steps, 0, {}, [&](std::size_t step) {
        keep(step);
        if ((step + 1) % work.every == 0) keep_control(work, i, step / work.every);
      });
    } else {
      for (; progress.steps < work.steps; ++progress.steps) {
        rows.read(progress.steps, row.data());
        progress.status = twin.step(row.data());
        if (progress.status != Status::ok) break;
        keep(progress.steps);
      }
    }
    work.outcome[2 * i] = std::int64_t(progress.steps);
    work.outcome[2 * i + 1] = std::int64_t(progress.status);
  }

  std::size_t count_;
  ChainSizes sizes_;
  std::size_t commands_, signals_;  // columns
  std::vector<tenodesis_lanes::Column> columns_;
  const tenodesis_lanes::Lanes* lanes_;
  std::vector<std::unique_ptr<void, void (*)(void*)>> groups_;
  std::vector<std::unique_ptr<AnyTwin>> alone_;
};

/// Restarts some twins of a batch.
void restart(TwinBatch& batch, const std::vector<std::size_t>& which, const std::vector<AnyTwin*>& twins) {
  require(which.size() == twins.size(), "which and twins do not fit");
  for (std::size_t n = 0; n < which.size(); ++n) {
    require(which[n] < batch.count(), "no such twin");
    batch.start(which[n], *twins[n]);
  }
}

void advance(TwinBatch& batch, const In<3>& commands, const std::vector<std::size_t>& given,
             const std::vector<std::size_t>& signals, std::size_t every, const Out<3>& out,
             const Array<std::int64_t, 2>& outcome, int threads, const std::vector<AnyController*>& controllers,
             const AxisPlaces& axes, int steps_per_tick, double time_step) {
  const std::size_t runs = batch.count();
  const std::size_t count = commands.shape(1);
  require(commands.shape(2) == given.size() && (commands.shape(0) == runs || commands.shape(0) == 1) &&
              out.shape(0) == runs && out.shape(1) == signals.size() && every > 0 && out.shape(2) == count / every &&
              outcome.shape(0) == runs && outcome.shape(1) == 2 &&
              (controllers.empty() || controllers.size() == runs) && steps_per_tick >= 1,
          "commands, controllers and outputs do not fit");
  require(!given.empty() && given.size() <= batch.commands() &&
              std::ranges::all_of(given, [&](std::size_t column) { return column < batch.commands(); }),
          "no such column");
  for (const AnyController* controller : controllers)
    require(std::cmp_equal(axes.size(), controller->axes()), "an axis is missing, or one too many");
  const std::vector<CompensatedAxis> compensated =
      controllers.empty() ? std::vector<CompensatedAxis>{} : axes_of(axes, batch.sizes());
  const std::size_t known = batch.signals() + compensated.size() * control_signal_count;
  require(std::ranges::all_of(signals, [&](std::size_t signal) { return signal < known; }) &&
              std::ranges::is_sorted(signals, {}, [&](std::size_t signal) { return signal >= batch.signals(); }),
          "no such signal");
  const nb::gil_scoped_release release;
  batch.advance({count, commands.data(), given, commands.shape(0) == 1, signals, every, out.data(), out.shape(2),
                 outcome.data(), controllers, compensated, steps_per_tick, time_step},
                threads);
}

std::unique_ptr<AnyTwin> make_axes_twin(const std::vector<TwinSpec>& specs, const std::vector<std::uint64_t>& seeds) {
  require(!specs.empty() && specs.size() == seeds.size(), "specs and seeds do not fit");
  std::vector<std::unique_ptr<AnyTwin>> parts;
  parts.reserve(specs.size());
  for (std::size_t n = 0; n < specs.size(); ++n) parts.push_back(make_twin(specs[n], seeds[n]));
  return std::make_unique<AxesTwin>(std::move(parts));
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

  nb::class_<AnyTwin>(m, "Twin", "A digital twin, with its state.")
      .def("copy", &AnyTwin::copy)
      .def(
          "run", &run, "commands"_a, "out"_a, "energy"_a.none() = nb::none(),
          "Step over rows of commands; a row of signals per step in out, totals in energy. Returns the steps taken and "
          "the last status.")
      .def("run_controlled", &run_controlled, "controller"_a, "axes"_a, "commands"_a, "steps_per_tick"_a, "time_step"_a,
           "relay"_a, "started"_a, "requests"_a.none(), "values"_a.none(), "modes"_a.none(), "out"_a, "control"_a,
           "The same with a controller in the loop; axes: joint of the handle, agonist and antagonist of each; values "
           "and modes: what is injected, by axis, step and point; control: the controller's signals by step and axis.")
      .def_prop_rw(
          "state",
          [](const AnyTwin& twin) {
            const std::string bytes = twin.state();
            return nb::bytes(bytes.data(), bytes.size());
          },
          [](AnyTwin& twin, const nb::bytes& bytes) { twin.set_state({bytes.c_str(), bytes.size()}); },
          "The state, as bytes.")
      .def_prop_ro(
          "commands", [](const AnyTwin& twin) { return twin.commands(); }, "Names and widths of a command's columns.")
      .def_prop_ro(
          "signals", [](const AnyTwin& twin) { return twin.signals(); },
          "Names and widths of the signals that a step writes.")
      .def(
          "now",
          [](const AnyTwin& twin, const Out<1>& out) {
            require(out.shape(0) == width_of(twin.signals()), "signals do not fit the twin");
            twin.store(out.data());
          },
          "out"_a, "Write the signals as they stand.")
      .def(
          "handle_wanted",
          [](const AnyTwin& twin, std::size_t joint) {
            require(joint < twin.sizes().handles, "no such joint of the handle");
            return twin.handle_wanted(joint);
          },
          "joint"_a, "Angle of a joint of the handle by the last command, rad.")
      .def(
          "contact",
          [](const AnyTwin& twin, std::size_t joint) {
            require(joint < twin.sizes().joints, "no such joint");
            const Contact<double> contact = twin.contact(joint);
            return std::make_tuple(contact.angle, contact.stiffness, contact.damping);
          },
          "joint"_a, "Tissue across the tip's path about a joint by the last command: angle in rad, N/m, N s/m.");
  m.def("axes_twin", &make_axes_twin, "specs"_a, "seeds"_a,
        "The twins of axes that do not act on each other, side by side, at rest.");

  nb::class_<TwinBatch>(m, "TwinBatch", "Many twins, with their states, stepped together.")
      .def(nb::init<const std::vector<AnyTwin*>&, int>(), "twins"_a, "most_lanes"_a = 8,
           "Copies of twins, in their states; at most so many step in a vector's lanes.")
      .def("restart", &restart, "which"_a, "twins"_a, "Put other twins, in their states, in the place of some.")
      .def_prop_ro("together", &TwinBatch::stride, "How many step in lockstep, in the lanes of a vector.")
      .def("advance", &advance, "commands"_a, "given"_a, "signals"_a, "every"_a, "out"_a, "outcome"_a, "threads"_a,
           "controllers"_a, "axes"_a, "steps_per_tick"_a, "time_step"_a,
           "Step over commands by twin, step and column of those that are given, or common ones, with a controller "
           "each if there are any; write every n-th step's signals, the controllers' counted on after the twins', axis "
           "by axis, by twin, signal and sample; outcome: steps taken and status of each. A twin that could not take a "
           "step stands still until its restart.");

  m.def(
      "twin_parameters", [] { return list_of(twin_parameter_names); }, "Names of a twin's parameters, in their order.");
  m.def(
      "axis_commands",
      [] {
        std::vector<Column> columns;
        columns.reserve(axis_columns.size());
        for (const AxisColumn& column : axis_columns) columns.emplace_back(column.name, column.width);
        return columns;
      },
      "Names and widths of the columns of an axis's command.");
  m.def("energies", [] { return list_of(energy_names); }, "Names of the totals of an energy balance, in their order.");
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

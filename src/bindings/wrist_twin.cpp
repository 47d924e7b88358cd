// The twin of a wrist of joints that share tendons, for Python.

#include "engine/wrist_twin.hpp"
#include "engine/lane_loop.hpp"
#include "engine/vectors.hpp"

#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <atomic>
#include <numeric>
#include <thread>

#include "wrist_spec.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

using Outcome = std::tuple<std::size_t, Status>;

std::vector<CompensatedAxis> axes_of(const std::vector<std::array<int, 3>>& axes, const WristSizes& sizes) {
  std::vector<CompensatedAxis> compensated;
  for (const auto& [handle, agonist_at, antagonist_at] : axes) {
    require(handle >= 0 && std::cmp_less(handle, sizes.handles) && agonist_at >= 0 &&
                std::cmp_less(agonist_at, sizes.tendons) && antagonist_at >= 0 &&
                std::cmp_less(antagonist_at, sizes.tendons),
            "an axis names what is not there");
    compensated.push_back({std::size_t(handle), std::size_t(agonist_at), std::size_t(antagonist_at)});
  }
  return compensated;
}

/// A twin with its state, and the shapes of its rows.
class PyWristTwin {
 public:
  PyWristTwin(const WristSpec& spec, const In<3>& passages, const std::vector<int>& contacts, const In<2>& segments,
              const In<2>& links, const In<2>& load_cells, const std::array<double, wrench_components>& rig,
              const std::vector<double>& parameters, int law, int steps_per_sample, bool quasi_static, bool currents,
              std::uint64_t seed) {
    const std::size_t tendons = spec.tendons();
    require(passages.shape(0) == tendons && passages.shape(2) == passage_numbers && contacts.size() == tendons &&
                tendons > 0 && segments.shape(0) == tendons && segments.shape(1) == passages.shape(1) + 1 &&
                links.shape(0) == spec.joints() && links.shape(1) == link_numbers && load_cells.shape(0) == tendons &&
                load_cells.shape(1) == load_cell_numbers && parameters.size() == wrist_twin_names.size() && law >= 0 &&
                law <= int(WristLaw::capstan_power),
            "the twin's rows do not fit the wrist");
    const auto most = std::size_t(2 * most_vertices) * spec.joints() + std::size_t(most_long_sheath_contacts);
    for (std::size_t m = 0; m < tendons; ++m) {
      require(contacts[m] >= 1 && std::cmp_less_equal(contacts[m], passages.shape(1)) &&
                  std::cmp_less_equal(contacts[m], most),
              "a tendon has too many contacts");
      for (std::size_t j = 0; std::cmp_less(j, contacts[m]); ++j)
        require(passages(m, j, passage_joint) >= -1 &&
                    passages(m, j, passage_joint) < double(spec.joints() + spec.handles()),
                "a tendon crosses a joint that is not there");
    }
    const WristTwinRows rows{passages.data(),
                             passages.shape(1),
                             contacts,
                             segments.data(),
                             links.data(),
                             load_cells.data(),
                             rig.data(),
                             parameters.data(),
                             WristLaw(law),
                             steps_per_sample,
                             quasi_static,
                             currents,
                             seed};
    const WristSizes sizes{spec.joints(), spec.handles(), tendons};
    twin_ = std::visit([&](const auto& wrist) { return make_twin<int(most_wrist_tendons)>(wrist, rows, sizes); },
                       spec.any());
    commands_ = width_of(wrist_commands(sizes));
    signals_ = width_of(wrist_signals(sizes));
  }
  PyWristTwin(const PyWristTwin& other)
      : twin_(other.twin_->copy()), commands_(other.commands_), signals_(other.signals_) {}
  PyWristTwin& operator=(const PyWristTwin&) = delete;
  ~PyWristTwin() = default;

  AnyWristTwin& twin() const { return *twin_; }
  std::size_t commands() const { return commands_; }
  std::size_t signals() const { return signals_; }

  Outcome run(const In<2>& commands, const Out<2>& out, const std::optional<Out<1>>& energy) {
    require(commands.shape(1) == commands_ && out.shape(1) == signals_ && out.shape(0) == commands.shape(0) &&
                (!energy || energy->shape(0) == wrist_energy_names.size()),
            "commands, signals or energies do not fit the twin");
    const nb::gil_scoped_release release;
    double* const totals = energy ? energy->data() : nullptr;
    if (totals != nullptr) {
      std::fill_n(totals, wrist_energy_names.size(), 0.0);
      totals[0] = totals[1] = twin_->stored();
    }
    double* to = out.data();
    for (std::size_t i = 0; i < commands.shape(0); ++i) {
      const double* row = commands.data() + i * commands_;
      const Status found = totals != nullptr ? twin_->audit(row, totals) : twin_->step(row);
      if (found != Status::ok) return {i, found};
      to = twin_->store(to);
    }
    return {commands.shape(0), Status::ok};
  }

  Outcome run_controlled(AnyController& controller, const std::vector<std::array<int, 3>>& axes, const In<2>& commands,
                         int steps_per_tick, double time_step, double relay, std::size_t started,
                         const std::optional<Array<const std::uint8_t, 1>>& requests,
                         const std::optional<In<3>>& values, const std::optional<Array<const std::uint8_t, 3>>& modes,
                         const Out<2>& out, const Out<3>& control) {
    const std::size_t count = commands.shape(0);
    const auto fits = [&](const auto& stack) {
      return stack.shape(0) == axes.size() && stack.shape(1) == count && stack.shape(2) == injection_point_count;
    };
    require(commands.shape(1) == commands_ && out.shape(1) == signals_ && out.shape(0) == count &&
                steps_per_tick >= 1 && (!requests || requests->shape(0) == count) &&
                values.has_value() == modes.has_value() && (!values || (fits(*values) && fits(*modes))) &&
                std::cmp_equal(axes.size(), controller.axes()) && control.shape(0) == count &&
                control.shape(1) == axes.size() && control.shape(2) == control_signal_count,
            "commands, requests, injected faults, signals and axes do not fit the twin and its controller");
    const std::vector<CompensatedAxis> compensated = axes_of(axes, twin_->sizes());
    InjectedSteps injected;
    if (values && modes) injected = {values->data(), modes->data(), nullptr};
    if (requests) injected.request = requests->data();
    const nb::gil_scoped_release release;
    CompensatedWrist plant(*twin_, compensated, commands.data());
    ClosedLoop loop(plant, controller, steps_per_tick, time_step, relay);
    double* to = out.data();
    double* said = control.data();
    const Progress progress = loop.run(count, started, injected, [&](std::size_t) {
      to = twin_->store(to);
      for (std::size_t n = 0; n < compensated.size(); ++n)
        said = std::ranges::copy(control_signals(controller, n), said).out;
    });
    return {progress.steps, progress.status};
  }

 private:
  std::unique_ptr<AnyWristTwin> twin_;
  std::size_t commands_{}, signals_{};
};

/// Twins, their commands and what is kept of them, for several runs.
struct Batch {
  const std::vector<PyWristTwin*>& twins;
  const In<3>& commands;  // of each run, or common ones
  std::size_t every;
  const Out<3>& out;
  const std::vector<AnyController*>& controllers;
  const std::vector<CompensatedAxis>& axes;
  int steps_per_tick;
  double time_step;
  double* control;

  std::size_t count() const { return commands.shape(1); }
  const double* rows(std::size_t r) const {
    return commands.data() + (commands.shape(0) == 1 ? 0 : r * count() * commands.shape(2));
  }
  double* kept(std::size_t r) const { return out.data() + r * out.shape(1) * out.shape(2); }
  void keep_control(std::size_t r, std::size_t sample) const {
    double* said = control + (r * out.shape(1) + sample) * axes.size() * control_signal_count;
    for (std::size_t n = 0; n < axes.size(); ++n)
      said = std::ranges::copy(control_signals(*controllers[r], n), said).out;
  }

  Outcome run_alone(std::size_t r) const {
    AnyWristTwin& twin = twins[r]->twin();
    double* to = kept(r);
    if (controllers.empty()) {
      for (std::size_t i = 0; i < count(); ++i) {
        const Status found = twin.step(rows(r) + i * commands.shape(2));
        if (found != Status::ok) return {i, found};
        if ((i + 1) % every == 0) to = twin.store(to);
      }
      return {count(), Status::ok};
    }
    CompensatedWrist plant(twin, axes, rows(r));
    ClosedLoop loop(plant, *controllers[r], steps_per_tick, time_step);
    const Progress progress = loop.run(count(), 0, {}, [&](std::size_t i) {
      if ((i + 1) % every != 0) return;
      to = twin.store(to);
      keep_control(r, i / every);
    });
    return {progress.steps, progress.status};
  }

  // A loop through controllers, for the lanes.
  struct Loop {
    const Batch& of;
    std::size_t first;

    static void tick(void* loop, std::size_t run, std::size_t step, const double* readings, double* velocities) {
      const auto& [of, first] = *static_cast<const Loop*>(loop);
      tick_in_lanes(*of.controllers[first + run], double(step + 1) * of.time_step, readings, velocities);
    }
    static void keep(void* loop, std::size_t run, std::size_t sample) {
      const auto& [of, first] = *static_cast<const Loop*>(loop);
      of.keep_control(first + run, sample);
    }
  };

  /// Runs some from first on, in the lanes of a vector.
  void run_in_lanes(const tenodesis_lanes::Lanes& lanes, std::size_t first, Outcome* outcomes) const {
    const auto width = std::size_t(lanes.count);
    const std::size_t runs = std::min(width, twins.size() - first);
    const auto leader = twins[first]->twin().in_lanes();
    if (!leader) return;
    const std::unique_ptr<void, void (*)(void*)> group(lanes.make(leader->kind), lanes.release);
    std::vector<const double*> given(runs);
    std::vector<double*> to(runs);
    std::vector<std::int64_t> ends(2 * runs);
    // What fills the lanes up repeats the first.
    for (std::size_t k = 0; k < width; ++k) {
      const auto bytes = twins[first + (k < runs ? k : 0)]->twin().in_lanes();
      if (!bytes) return;
      lanes.start(group.get(), int(k), bytes->twin, bytes->state);
      if (k >= runs) continue;
      given[k] = rows(first + k);
      to[k] = kept(first + k);
    }
    std::vector<tenodesis_lanes::Column> columns(commands.shape(2));
    for (std::size_t c = 0; c < columns.size(); ++c) columns[c] = {c, 1};
    std::vector<std::size_t> signals(out.shape(2));
    std::iota(signals.begin(), signals.end(), std::size_t(0));
    std::vector<tenodesis_lanes::Axis> compensated;
    compensated.reserve(axes.size());
    for (const auto& [handle, agonist_at, antagonist_at] : axes)
      compensated.push_back({handle, agonist_at, antagonist_at});
    Loop loop{*this, first};
    const bool closed = !controllers.empty();
    lanes.advance(group.get(), {.runs = runs,
                                .steps = count(),
                                .commands = given.data(),
                                .columns = columns.data(),
                                .column_count = columns.size(),
                                .planar = false,
                                .signals = signals.data(),
                                .signal_count = signals.size(),
                                .every = every,
                                .out = to.data(),
                                .signal_stride = 1,
                                .sample_stride = signals.size(),
                                .outcomes = ends.data(),
                                .tick = closed ? &Loop::tick : nullptr,
                                .keep = closed ? &Loop::keep : nullptr,
                                .loop = &loop,
                                .axes = compensated.data(),
                                .axis_count = closed ? compensated.size() : 0,
                                .steps_per_tick = steps_per_tick});
    for (std::size_t k = 0; k < runs; ++k) {
      outcomes[first + k] = {std::size_t(ends[2 * k]), Status(ends[2 * k + 1])};
      std::string state = twins[first + k]->twin().state();
      lanes.state(group.get(), int(k), state.data());
      twins[first + k]->twin().set_state(state);
    }
  }
};

/// The lanes that twins can step in together; null if they cannot.
const tenodesis_lanes::Lanes* lanes_of(const std::vector<PyWristTwin*>& twins, int most) {
  const auto first = twins[0]->twin().in_lanes();
  if (!first) return nullptr;
  const bool together = std::ranges::all_of(twins, [&](const PyWristTwin* twin) {
    const auto bytes = twin->twin().in_lanes();
    return bytes && bytes->goes_with(*first);
  });
  return together ? lanes_of_processor(most) : nullptr;
}

/// Steps twins over their commands, or over common ones, in lanes where they can, by threads, and keeps the signals of
/// every n-th step; with a controller each, its signals too. Returns the steps taken and the last status of each.
std::vector<Outcome> run_wrist_twins(const std::vector<PyWristTwin*>& twins, const In<3>& commands, std::size_t every,
                                     const Out<3>& out, const std::vector<AnyController*>& controllers,
                                     const std::vector<std::array<int, 3>>& axes, int steps_per_tick, double time_step,
                                     const std::optional<Array<double, 4>>& control, int threads, int most_lanes) {
  const std::size_t runs = twins.size();
  const std::size_t count = commands.shape(1);
  require(runs > 0 && every > 0 && (commands.shape(0) == runs || commands.shape(0) == 1) && out.shape(0) == runs &&
              out.shape(1) == count / every && steps_per_tick >= 1 &&
              (controllers.empty() || (controllers.size() == runs && control.has_value())),
          "twins, commands, controllers and outputs do not fit");
  for (const PyWristTwin* twin : twins)
    require(commands.shape(2) == twin->commands() && out.shape(2) == twin->signals(),
            "commands or signals do not fit the twins");
  const std::vector<CompensatedAxis> compensated = axes_of(axes, twins[0]->twin().sizes());
  if (control)
    require(control->shape(0) == runs && control->shape(1) == count / every && control->shape(2) == axes.size() &&
                control->shape(3) == control_signal_count,
            "control does not fit the controllers");
  for (const AnyController* controller : controllers)
    require(std::cmp_equal(axes.size(), controller->axes()), "an axis is missing, or one too many");
  std::vector<Outcome> outcomes(runs);
  const Batch batch{twins,
                    commands,
                    every,
                    out,
                    controllers,
                    compensated,
                    steps_per_tick,
                    time_step,
                    control ? control->data() : nullptr};
  const nb::gil_scoped_release release;
  const auto* lanes = lanes_of(twins, most_lanes);
  const std::size_t stride = lanes != nullptr ? std::size_t(lanes->count) : 1;
  std::atomic<std::size_t> next{0};
  const auto some = [&] {
    for (std::size_t r = next.fetch_add(stride); r < runs; r = next.fetch_add(stride))
      if (lanes != nullptr)
        batch.run_in_lanes(*lanes, r, outcomes.data());
      else
        outcomes[r] = batch.run_alone(r);
  };
  const std::size_t groups = (runs + stride - 1) / stride;
  std::vector<std::jthread> pool;
  for (std::size_t n = 1; n < std::min(std::size_t(std::max(threads, 1)), groups); ++n) pool.emplace_back(some);
  some();
  pool.clear();
  return outcomes;
}

using Columns = std::vector<std::pair<std::string, std::size_t>>;

Columns named(const std::vector<Column>& columns) { return {columns.begin(), columns.end()}; }

/// Mass matrix and moments of constant rates of every point.
void wrist_inertia(const WristSpec& spec, const In<2>& links, const In<2>& angles, const In<2>& speeds,
                   const Out<3>& matrix, const Out<2>& bias) {
  const std::size_t n = spec.joints();
  const std::size_t count = angles.shape(0);
  require(links.shape(0) == n && links.shape(1) == link_numbers && angles.shape(1) == n && speeds.shape(0) == count &&
              speeds.shape(1) == n && matrix.shape(0) == count && matrix.shape(1) == n && matrix.shape(2) == n &&
              bias.shape(0) == count && bias.shape(1) == n,
          "the arrays do not fit the wrist");
  std::visit(
      [&]<class W>(const W& wrist) {
        constexpr int N = W::joints;
        Link<double> link[N]{};
        for (int i = 0; i < N; ++i) {
          const double* at = links.data() + std::size_t(i) * link_numbers;
          link[i] = {at[link_mass], at[link_centre], {at[inertia_x], at[inertia_y], at[inertia_z]}};
        }
        for (std::size_t p = 0; p < count; ++p) {
          double x[N], mass[N][N];
          for (int i = 0; i < N; ++i)
            x[i] = coordinate_at(wrist.joint[i].mechanism, angles.data()[p * n + std::size_t(i)]);
          inertia(wrist, link, x, speeds.data() + p * n, mass, bias.data() + p * n);
          for (int i = 0; i < N; ++i) std::copy_n(mass[i], n, matrix.data() + (p * n + std::size_t(i)) * n);
        }
      },
      spec.any());
}

}  // namespace

AnyWristTwin& wrist_twin_of(nb::handle object) { return nb::cast<PyWristTwin&>(object).twin(); }

void bind_wrist_twin(nb::module_& m) {
  nb::class_<PyWristTwin>(m, "WristTwin", "The twin of a wrist, with its state.")
      .def(nb::init<const WristSpec&, const In<3>&, const std::vector<int>&, const In<2>&, const In<2>&, const In<2>&,
                    const std::array<double, wrench_components>&, const std::vector<double>&, int, int, bool, bool,
                    std::uint64_t>(),
           "wrist"_a, "passages"_a, "contacts"_a, "segments"_a, "links"_a, "load_cells"_a, "rig"_a, "parameters"_a,
           "law"_a, "steps_per_sample"_a, "quasi_static"_a, "currents"_a, "seed"_a,
           "passages: by tendon and contact the joint (-1: the sheath; the handle's count on), friction coefficient, "
           "wrap in rad of the straight joint or in the sheath, share, arm in m; links: by joint mass, its centre, "
           "inertia about x, y, z, damping, stop, its stiffness, reach of the tip; load_cells: gain, bias, "
           "noise, range and resolution by tendon; rig: wrench on the tip by a newton of weight; law: 0 capstan with a "
           "constant part, 1 Stribeck, 2 power.")
      .def("copy", [](const PyWristTwin& twin) { return PyWristTwin(twin); })
      .def(
          "run", &PyWristTwin::run, "commands"_a, "out"_a, "energy"_a.none(),
          nb::sig("def run(self, commands: NDArray[numpy.float64], out: NDArray[numpy.float64], energy: "
                  "NDArray[numpy.float64] | None) -> tuple[int, Status]"),
          "Step over rows of commands; a row of signals per step in out, totals in energy. Returns the steps taken and "
          "the last status.")
      .def("run_controlled", &PyWristTwin::run_controlled, "controller"_a, "axes"_a, "commands"_a, "steps_per_tick"_a,
           "time_step"_a, "relay"_a, "started"_a, "requests"_a.none(), "values"_a.none(), "modes"_a.none(), "out"_a,
           "control"_a,
           nb::sig("def run_controlled(self, controller: Controller, axes: Sequence[Sequence[int]], commands: "
                   "NDArray[numpy.float64], steps_per_tick: int, time_step: float, relay: float, started: int, "
                   "requests: NDArray[numpy.uint8] | None, values: NDArray[numpy.float64] | None, modes: "
                   "NDArray[numpy.uint8] | None, out: NDArray[numpy.float64], control: NDArray[numpy.float64]) -> "
                   "tuple[int, Status]"),
           "The same with a controller in the loop; axes: joint of the handle, agonist and antagonist of each; values "
           "and modes: what is injected, by axis, step and point; control: the controller's signals by step and axis.")
      .def_prop_rw(
          "state",
          [](const PyWristTwin& twin) {
            const std::string bytes = twin.twin().state();
            return nb::bytes(bytes.data(), bytes.size());
          },
          [](PyWristTwin& twin, const nb::bytes& bytes) { twin.twin().set_state({bytes.c_str(), bytes.size()}); },
          "The state, as bytes.")
      .def_prop_ro(
          "commands", [](const PyWristTwin& twin) { return named(wrist_commands(twin.twin().sizes())); },
          "Names and widths of a command's columns.")
      .def_prop_ro(
          "signals", [](const PyWristTwin& twin) { return named(wrist_signals(twin.twin().sizes())); },
          "Names and widths of the signals that a step writes.")
      .def(
          "now",
          [](const PyWristTwin& twin, const Out<1>& out) {
            require(out.shape(0) == width_of(wrist_signals(twin.twin().sizes())), "signals do not fit the twin");
            twin.twin().store(out.data());
          },
          "out"_a, nb::sig("def now(self, out: NDArray[numpy.float64]) -> None"), "Write the signals as they stand.")
      .def(
          "handle_wanted",
          [](const PyWristTwin& twin, std::size_t joint) {
            require(joint < twin.twin().sizes().handles, "no such joint of the handle");
            return twin.twin().handle_wanted(joint);
          },
          "joint"_a, "Angle of a joint of the handle by the last command, rad.")
      .def(
          "contact",
          [](const PyWristTwin& twin, std::size_t joint) {
            require(joint < twin.twin().sizes().joints, "no such joint");
            const Contact<double> contact = twin.twin().contact(joint);
            return std::make_tuple(contact.angle, contact.stiffness, contact.damping);
          },
          "joint"_a, "Tissue across the tip's path about a joint by the last command: angle in rad, N/m, N s/m.");
  m.def("run_wrist_twins", &run_wrist_twins, "twins"_a, "commands"_a, "every"_a, "out"_a, "controllers"_a, "axes"_a,
        "steps_per_tick"_a, "time_step"_a, "control"_a.none(), "threads"_a, "most_lanes"_a = 8,
        nb::sig(
            "def run_wrist_twins(twins: Sequence[WristTwin], commands: NDArray[numpy.float64], every: int, out: "
            "NDArray[numpy.float64], controllers: Sequence[Controller], axes: Sequence[Sequence[int]], "
            "steps_per_tick: int, time_step: float, control: NDArray[numpy.float64] | None, threads: int, most_lanes: "
            "int = 8) -> list[tuple[int, Status]]"),
        "Step twins over their commands by run, step and column, or over common ones, at most so many in a vector's "
        "lanes, and keep the signals of every n-th step by run, sample and column, those of their controllers by run, "
        "sample and axis. Returns steps taken "
        "and the last status of each.");
  m.def("wrist_inertia", &wrist_inertia, "wrist"_a, "links"_a, "angles"_a, "speeds"_a, "matrix"_a, "bias"_a);
  m.def("wrist_twin_parameters", [] { return list_of(wrist_twin_names); });
  m.def("wrist_energies", [] { return list_of(wrist_energy_names); });
}

}  // namespace tenodesis::bindings

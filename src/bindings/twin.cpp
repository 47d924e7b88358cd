// The digital twin for Python: a single one, and many of them over threads.

#include <algorithm>
#include <atomic>
#include <thread>

#include "engine/any_twin.hpp"
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

/// Runs one twin per row of parameters, from rest, over its own commands or common ones.
void run_many(const TwinSpec& spec, const In<2>& parameters, const In<3>& commands,
              const Array<const std::uint64_t, 1>& seeds, const std::vector<std::size_t>& signals, std::size_t every,
              const Out<3>& out, const Array<std::int64_t, 2>& outcome, int threads) {
  const std::size_t runs = parameters.shape(0);
  const std::size_t count = commands.shape(1);
  if (parameters.shape(1) != row_count || commands.shape(2) != command_count ||
      (commands.shape(0) != runs && commands.shape(0) != 1) || seeds.shape(0) != runs || out.shape(0) != runs ||
      out.shape(1) != signals.size() || every == 0 || out.shape(2) != count / every || outcome.shape(0) != runs ||
      outcome.shape(1) != 2)
    throw nb::value_error("parameters, commands, seeds and outputs do not fit");
  for (const std::size_t signal : signals)
    if (signal >= signal_count) throw nb::value_error("no such signal");
  const nb::gil_scoped_release release;
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < runs; i = next++) {
      const auto twin = make_twin(with_row(spec, parameters.data() + i * parameters.shape(1)), seeds.data()[i]);
      const double* own = commands.data() + (commands.shape(0) == 1 ? 0 : i * count * command_count);
      double* kept = out.data() + i * out.shape(1) * out.shape(2);
      const Progress progress = twin->sample({own}, count, signals, every, kept, out.shape(2));
      outcome.data()[2 * i] = std::int64_t(progress.steps);
      outcome.data()[2 * i + 1] = std::int64_t(progress.status);
    }
  };
  std::vector<std::jthread> pool;
  for (std::size_t i = 1; i < std::min(std::size_t(threads), runs); ++i) pool.emplace_back(work);
  work();
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
          "signals", [](const AnyTwin& twin, const In<2>& command) { return twin.signals(commands_of(command)[0]); },
          "command"_a, nb::sig("def signals(self, command: NDArray[numpy.float64]) -> list[float]"),
          "The signals as they stand.");

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
  m.def(
      "run_many", &run_many, "spec"_a, "parameters"_a, "commands"_a, "seeds"_a, "signals"_a, "every"_a, "out"_a,
      "outcome"_a, "threads"_a,
      nb::sig("def run_many(spec: TwinSpec, parameters: NDArray[numpy.float64], commands: NDArray[numpy.float64], "
              "seeds: NDArray[numpy.uint64], signals: Sequence[int], every: int, out: NDArray[numpy.float64], outcome: "
              "NDArray[numpy.int64], threads: int) -> None"),
      "Run one twin per row of parameters (a twin's, then its axis's); outcome: steps taken and status of each.");
}

}  // namespace tenodesis::bindings

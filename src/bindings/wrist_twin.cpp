// The twin of a wrist of joints that share tendons: commands in, signals out, row by row.

#include <algorithm>
#include <array>
#include <cmath>

#include "engine/any_controller.hpp"
#include "tenodesis/wrist_energy.hpp"
#include "wrist_spec.hpp"

namespace tenodesis::bindings {
namespace {

inline constexpr std::size_t most_wrist_sheath_contacts = 4;
/// Numbers of a contact and of a joint's link, in this order.
enum PassageNumber { passage_joint, passage_coefficient, passage_wrap, passage_arm, passage_numbers };
enum LinkNumber {
  link_mass,
  link_centre,
  inertia_x,
  inertia_y,
  inertia_z,
  link_damping,
  link_stop,
  link_stop_stiffness,
  link_numbers
};

/// Parameters of a wrist's twin, in this order.
inline constexpr std::array wrist_twin_names{"constant",
                                             "viscous",
                                             "hand_stiffness",
                                             "hand_damping",
                                             "hand_inertia",
                                             "spool_radius",
                                             "spool_speed_limit",
                                             "spool_acceleration_limit",
                                             "drive_time_constant",
                                             "backlash",
                                             "encoder_noise",
                                             "encoder_range",
                                             "encoder_resolution",
                                             "motor_encoder_resolution",
                                             "load_cell_noise",
                                             "load_cell_range",
                                             "load_cell_resolution",
                                             "time_step"};
enum WristTwinNumber {
  constant,
  viscous,
  hand_stiffness,
  hand_damping,
  hand_inertia,
  spool_radius,
  spool_speed_limit,
  spool_acceleration_limit,
  drive_time_constant,
  backlash,
  encoder_noise,
  encoder_range,
  encoder_resolution,
  motor_encoder_resolution,
  load_cell_noise,
  load_cell_range,
  load_cell_resolution,
  time_step
};

inline constexpr std::array wrist_energy_names{"stored_before",  "stored_after",  "handle",  "spools",
                                               "load",           "friction",      "damping", "gripped",
                                               "least_friction", "worst_residual"};

/// Constants of a twin as Python gives them.
struct WristTwinRows {
  const In<3>& passages;  // tendons, contacts, numbers
  const std::vector<int>& contacts;
  const In<2>& segments;  // tendons, contacts + 1: stiffness
  const In<2>& links;
  const std::vector<double>& parameters;
  int sheath_contacts;
  int steps_per_sample;
  bool quasi_static;
};

Link<double> link_of(const double* row) {
  return {row[link_mass], row[link_centre], {row[inertia_x], row[inertia_y], row[inertia_z]}};
}

/// A joint that a controller's axis compensates, with its joint of the handle and its pair of tendons.
struct CompensatedAxis {
  std::size_t handle, agonist, antagonist;
};

/// A controller in the loop of a run.
struct Loop {
  engine::AnyController& controller;
  std::vector<CompensatedAxis> axes;
  int steps_per_tick;
  double time_step;
  std::size_t started;
  const std::uint8_t* requests;
  double* control;  ///< by step and axis
};

class WristTwinBase {
 public:
  virtual ~WristTwinBase() = default;
  virtual std::pair<std::size_t, Status> run(const double* commands, std::size_t count, double* out, double* energy,
                                             const Loop* loop) = 0;
  virtual std::unique_ptr<WristTwinBase> copy() const = 0;
};

template <class W>
class WristTwinOf final : public WristTwinBase {
  using Twin = WristTwin<W, 2 * W::joints + int(most_wrist_sheath_contacts)>;

 public:
  WristTwinOf(const W& wrist, const WristSpec& spec, const WristTwinRows& rows, std::uint64_t seed)
      : joints_(spec.joints()), tendons_(spec.tendons()), handles_(spec.handles()) {
    twin_.wrist = wrist;
    const auto& p = rows.parameters;
    const std::size_t width = rows.passages.shape(1);
    for (std::size_t m = 0; m < tendons_; ++m) {
      const int n = rows.contacts[m];
      require(n >= 1 && std::cmp_less_equal(n, width) && n <= 2 * W::joints + int(most_wrist_sheath_contacts),
              "a tendon has too many contacts");
      twin_.tendon[m].rest_tension = wrist.pretension[m];
      twin_.tendon[m].stiffness.length = n + 1;
      for (int i = 0; i <= n; ++i)
        twin_.tendon[m].stiffness[i] = rows.segments.data()[m * (width + 1) + std::size_t(i)];
      for (int j = 0; j < n; ++j) {
        const double* at = rows.passages.data() + (m * width + std::size_t(j)) * passage_numbers;
        const int joint = int(at[passage_joint]);
        require(joint >= -1 && joint < int(joints_ + handles_), "a tendon crosses a joint that is not there");
        // Joints of the handle are counted from the room for the tip's on.
        const int place = std::cmp_less(joint, joints_) ? joint : joint - int(joints_) + W::joints;
        const double ratio = std::exp(at[passage_coefficient] * at[passage_wrap]);
        twin_.passage[m][j] = {place, at[passage_coefficient], ratio, at[passage_arm]};
      }
    }
    for (std::size_t i = 0; i < joints_; ++i) {
      const double* at = rows.links.data() + i * link_numbers;
      twin_.link[i] = link_of(at);
      twin_.damping[i] = at[link_damping];
      twin_.stop[i] = at[link_stop];
      twin_.stop_stiffness[i] = at[link_stop_stiffness];
    }
    twin_.sheath_contacts = rows.sheath_contacts;
    twin_.constant = p[constant];
    twin_.viscous = p[viscous];
    twin_.hand = {p[hand_stiffness], p[hand_damping], p[hand_inertia]};
    twin_.drive = {p[spool_radius], p[spool_speed_limit], p[spool_acceleration_limit], p[drive_time_constant],
                   p[backlash]};
    const double half = p[encoder_range] / 2;
    twin_.encoder = {1, 0, p[encoder_noise], -half, half, p[encoder_resolution]};
    twin_.load_cell = {1, 0, p[load_cell_noise], -p[load_cell_range], p[load_cell_range], p[load_cell_resolution]};
    twin_.motor_encoder = {1, 0, 0, -1e9, 1e9, p[motor_encoder_resolution]};
    twin_.time_step = p[time_step];
    twin_.steps_per_sample = rows.steps_per_sample;
    twin_.quasi_static = rows.quasi_static;
    twin_.set_draws();
    state_ = twin_.rest(seed);
  }

  std::pair<std::size_t, Status> run(const double* commands, std::size_t count, double* out, double* energy,
                                     const Loop* loop) override {
    const std::size_t columns = handles_ + tendons_ + load_components + 4;
    if (energy != nullptr) {
      std::fill_n(energy, wrist_energy_names.size(), 0.0);
      energy[0] = energy[1] = wrist_stored_energy(twin_, state_);
    }
    for (std::size_t i = 0; i < count; ++i) {
      const double* from = commands + i * columns;
      WristCommand<W> command{};
      std::copy_n(from, handles_, command.handle_angle);
      from += handles_;
      std::copy_n(from, tendons_, command.spool_velocity);
      from += tendons_;
      command.load = {{{from[0], from[1], from[2]}, {from[3], from[4], from[5]}}, from[6], from[7] != 0};
      command.held = {from[8], from[9], from[10]};
      if (loop != nullptr) close(*loop, i, command);
      const auto before = state_;
      const Status found = twin_.step(command, state_);
      if (found != Status::ok) return {i, found};
      if (energy != nullptr) add(before, energy);
      out = store(out);
    }
    return {count, Status::ok};
  }

  std::unique_ptr<WristTwinBase> copy() const override { return std::make_unique<WristTwinOf>(*this); }

 private:
  // A tick of the controller where one is due, and its velocities.
  void close(const Loop& loop, std::size_t i, WristCommand<W>& command) const {
    engine::AnyController& controller = loop.controller;
    if (loop.requests != nullptr && loop.requests[i] != 0) controller.request = Request(loop.requests[i]);
    const std::size_t step = loop.started + i;
    if (step % std::size_t(loop.steps_per_tick) == 0) {
      engine::AnyInput input{};
      input.time = std::uint64_t(std::llround(double(step + 1) * loop.time_step * 1e9));
      input.request = controller.request;
      controller.request = Request::none;
      for (std::size_t n = 0; n < loop.axes.size(); ++n) {
        const CompensatedAxis& of = loop.axes[n];
        input.axis[n] = {state_.measured_handle[of.handle],
                         {state_.measured_tension[of.agonist], state_.measured_tension[of.antagonist]},
                         {state_.measured_spool[of.agonist], state_.measured_spool[of.antagonist]}};
      }
      controller.step(input, controller.last);
    }
    double* to = loop.control + i * loop.axes.size() * engine::control_signal_count;
    for (std::size_t n = 0; n < loop.axes.size(); ++n) {
      const CompensatedAxis& of = loop.axes[n];
      command.spool_velocity[of.agonist] = controller.last.axis[n].spool_velocity[0];
      command.spool_velocity[of.antagonist] = controller.last.axis[n].spool_velocity[1];
      to = std::ranges::copy(engine::control_signals(controller, n), to).out;
    }
  }

  void add(const Twin::State& before, double* energy) const {
    const auto of = wrist_energy(twin_, before, state_);
    energy[1] = of.stored;
    energy[2] += of.handle;
    energy[3] += of.spools;
    energy[4] += of.load;
    energy[5] += of.friction;
    energy[6] += of.damping;
    energy[7] += of.tissue;
    energy[8] = std::min(energy[8], of.friction_at_end);
    energy[9] = std::max(energy[9], twin_.residual(before, state_));
  }

  double* store(double* out) const {
    const auto& s = state_;
    constexpr int N = W::joints;
    const auto each_tendon = [&](const auto& value) {
      for (std::size_t m = 0; m < tendons_; ++m) *out++ = value(m);
    };
    out = std::copy_n(s.angle, joints_, out);
    out = std::copy_n(s.velocity, joints_, out);
    out = std::copy_n(s.angle + N, handles_, out);
    for (std::size_t h = 0; h < handles_; ++h)
      *out++ = twin_.prescribed() ? s.handle_moment[h]
                                  : twin_.hand.stiffness * (s.command.handle_angle[h] - s.angle[N + h]) -
                                        (twin_.quasi_static ? 0.0 : twin_.hand.damping * s.velocity[N + h]);
    each_tendon([&](std::size_t m) { return s.tendon[m].tension[0]; });
    each_tendon([&](std::size_t m) { return s.tendon[m].tension[twin_.tendon[m].contacts()]; });
    each_tendon([&](std::size_t m) { return s.drive[m].spool; });
    each_tendon([&](std::size_t m) { return s.drive[m].speed; });
    *out++ = s.grip_force;
    out = std::copy_n(s.measured_handle, handles_, out);
    out = std::copy_n(s.measured_angle, joints_, out);
    out = std::copy_n(s.measured_tension, tendons_, out);
    out = std::copy_n(s.measured_spool, tendons_, out);
    *out++ = s.sweeps;
    return out;
  }

  std::size_t joints_, tendons_, handles_;
  Twin twin_{};
  Twin::State state_{};
};

class AnyWristTwin {
 public:
  AnyWristTwin(const WristSpec& spec, const In<3>& passages, const std::vector<int>& contacts, const In<2>& segments,
               const In<2>& links, const std::vector<double>& parameters, int sheath_contacts, int steps_per_sample,
               bool quasi_static, std::uint64_t seed)
      : handles_(spec.handles()),
        tendons_(spec.tendons()),
        steps_per_sample_(steps_per_sample),
        commands_(spec.handles() + spec.tendons() + load_components + 4),
        signals_(3 * spec.joints() + 3 * spec.handles() + 6 * spec.tendons() + 2) {
    require(passages.shape(0) == spec.tendons() && passages.shape(2) == passage_numbers &&
                contacts.size() == spec.tendons() && segments.shape(0) == spec.tendons() &&
                segments.shape(1) == passages.shape(1) + 1 && links.shape(0) == spec.joints() &&
                links.shape(1) == link_numbers && parameters.size() == wrist_twin_names.size(),
            "the twin's rows do not fit the wrist");
    const WristTwinRows rows{passages,   contacts,        segments,         links,
                             parameters, sheath_contacts, steps_per_sample, quasi_static};
    twin_ = std::visit(
        [&]<class W>(const W& wrist) -> std::unique_ptr<WristTwinBase> {
          return std::make_unique<WristTwinOf<W>>(wrist, spec, rows, seed);
        },
        spec.any());
  }
  AnyWristTwin(const AnyWristTwin& other)
      : handles_(other.handles_),
        tendons_(other.tendons_),
        steps_per_sample_(other.steps_per_sample_),
        commands_(other.commands_),
        signals_(other.signals_),
        twin_(other.twin_->copy()) {}

  nb::tuple run(const In<2>& commands, const Out<2>& out, const nb::object& energy) {
    require(commands.shape(1) == commands_ && out.shape(1) == signals_ && out.shape(0) == commands.shape(0),
            "commands or signals do not fit the twin");
    double* totals = nullptr;
    if (!energy.is_none()) {
      const auto row = nb::cast<Out<1>>(energy);
      require(row.shape(0) == wrist_energy_names.size(), "energies do not fit");
      totals = row.data();
    }
    std::pair<std::size_t, Status> progress;
    {
      const nb::gil_scoped_release release;
      progress = twin_->run(commands.data(), commands.shape(0), out.data(), totals, nullptr);
    }
    return nb::make_tuple(progress.first, int(progress.second));
  }

  nb::tuple run_controlled(engine::AnyController& controller, const std::vector<std::array<int, 3>>& axes,
                           const In<2>& commands, double time_step, std::size_t started,
                           const Array<const std::uint8_t, 1>& requests, const Out<2>& out, const Out<3>& control) {
    require(commands.shape(1) == commands_ && out.shape(1) == signals_ && out.shape(0) == commands.shape(0) &&
                requests.shape(0) == commands.shape(0) && std::cmp_equal(axes.size(), controller.axes()) &&
                control.shape(0) == commands.shape(0) && control.shape(1) == axes.size() &&
                control.shape(2) == engine::control_signal_count,
            "commands, requests, signals and axes do not fit the twin and its controller");
    Loop loop{controller, {}, steps_per_sample_, time_step, started, requests.data(), control.data()};
    for (const auto& [handle, agonist_at, antagonist_at] : axes) {
      require(handle >= 0 && std::cmp_less(handle, handles_) && agonist_at >= 0 &&
                  std::cmp_less(agonist_at, tendons_) && antagonist_at >= 0 && std::cmp_less(antagonist_at, tendons_),
              "an axis names what is not there");
      loop.axes.push_back({std::size_t(handle), std::size_t(agonist_at), std::size_t(antagonist_at)});
    }
    const nb::gil_scoped_release release;
    const auto progress = twin_->run(commands.data(), commands.shape(0), out.data(), nullptr, &loop);
    const nb::gil_scoped_acquire acquire;
    return nb::make_tuple(progress.first, int(progress.second));
  }

 private:
  std::size_t handles_, tendons_;
  int steps_per_sample_;
  std::size_t commands_, signals_;
  std::unique_ptr<WristTwinBase> twin_;
};

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
        for (std::size_t i = 0; i < n; ++i) link[i] = link_of(links.data() + i * link_numbers);
        for (std::size_t p = 0; p < count; ++p) {
          double x[N], mass[N][N];
          for (std::size_t i = 0; i < n; ++i) x[i] = coordinate_at(wrist.joint[i].mechanism, angles.data()[p * n + i]);
          inertia(wrist, link, x, speeds.data() + p * n, mass, bias.data() + p * n);
          for (std::size_t i = 0; i < n; ++i) std::copy_n(mass[i], n, matrix.data() + (p * n + i) * n);
        }
      },
      spec.any());
}

}  // namespace

void bind_wrist_twin(nb::module_& m) {
  nb::class_<AnyWristTwin>(m, "WristTwin")
      .def(nb::init<const WristSpec&, const In<3>&, const std::vector<int>&, const In<2>&, const In<2>&,
                    const std::vector<double>&, int, int, bool, std::uint64_t>(),
           "wrist"_a, "passages"_a, "contacts"_a, "segments"_a, "links"_a, "parameters"_a, "sheath_contacts"_a,
           "steps_per_sample"_a, "quasi_static"_a, "seed"_a)
      .def("copy", [](const AnyWristTwin& twin) { return AnyWristTwin(twin); })
      .def("run", &AnyWristTwin::run, "commands"_a, "out"_a, "energy"_a.none(),
           nb::sig("def run(self, commands: NDArray[numpy.float64], out: NDArray[numpy.float64], energy: "
                   "NDArray[numpy.float64] | None) -> tuple[int, int]"))
      .def("run_controlled", &AnyWristTwin::run_controlled, "controller"_a, "axes"_a, "commands"_a, "time_step"_a,
           "started"_a, "requests"_a, "out"_a, "control"_a,
           nb::sig("def run_controlled(self, controller: Controller, axes: Sequence[Sequence[int]], commands: "
                   "NDArray[numpy.float64], time_step: float, started: int, requests: NDArray[numpy.uint8], out: "
                   "NDArray[numpy.float64], control: NDArray[numpy.float64]) -> tuple[int, int]"));
  m.def("wrist_inertia", &wrist_inertia, "wrist"_a, "links"_a, "angles"_a, "speeds"_a, "matrix"_a, "bias"_a);
  m.def("wrist_twin_parameters", [] { return list_of(wrist_twin_names); });
  m.def("wrist_energies", [] { return list_of(wrist_energy_names); });
}

}  // namespace tenodesis::bindings

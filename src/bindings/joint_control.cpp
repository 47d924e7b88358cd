// Observer and law of any chain of joints and tendons, for Python: tick by tick, or in a closed loop with a twin.

#include <algorithm>

#include "chain_spec.hpp"
#include "engine/any_twin.hpp"
#include "engine/chain_twin.hpp"
#include "tenodesis/joint_law.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

/// Numbers of a controller of joints, in the order of a row.
#define TENODESIS_JOINT_CONTROL(ROW)                                                                             \
  ROW(constant), ROW(static_ratio), ROW(stribeck_speed), ROW(memory), ROW(load_index), ROW(reference_tension),   \
      ROW(bending_loss), ROW(sheath_bend_rate), ROW(spool_radius), ROW(play), ROW(tension_play), ROW(smoothing), \
      ROW(tension_deviation), ROW(length_deviation), ROW(friction_deviation), ROW(stiffness_deviation),          \
      ROW(force_deviation), ROW(moment_deviation), ROW(grip_deviation), ROW(imbalance), ROW(rate), ROW(gain),    \
      ROW(speed), ROW(tension_limit), ROW(least_tension), ROW(deviations), ROW(period)

#define TENODESIS_ROW(name) at_##name
enum JointControlNumber : std::size_t { TENODESIS_JOINT_CONTROL(TENODESIS_ROW) };
#undef TENODESIS_ROW
#define TENODESIS_ROW(name) #name
constexpr std::array joint_control_names{TENODESIS_JOINT_CONTROL(TENODESIS_ROW)};
#undef TENODESIS_ROW

/// A controller of a chain of any size.
class AnyJointController {
 public:
  virtual ~AnyJointController() = default;
  AnyJointController() = default;
  AnyJointController(const AnyJointController&) = delete;
  AnyJointController& operator=(const AnyJointController&) = delete;

  virtual const ChainSizes& sizes() const = 0;
  /// One tick; compensates: else the motors only follow the targets. velocity: of the spools, rad/s.
  virtual void step(const double* handle, const double* tension, const double* spool, const double* target,
                    bool compensates, double* velocity) = 0;
  virtual std::size_t width() const = 0;
  /// Writes the estimate: angles, deviations, moments, load, its deviations, friction scale and its deviation,
  /// tensions at the far ends, covariance.
  virtual double* store(double* out) const = 0;
  virtual void reset() = 0;
};

template <class W>
class JointControllerOf final : public AnyJointController {
 public:
  static constexpr int N = W::joints, M = W::tendons;
  static constexpr int most_contacts = 2 * most_vertices * N + most_long_sheath_contacts;
  using Observer = JointObserver<W, most_contacts>;

  JointControllerOf(const Observer& observer, const JointLaw<W>& law, const ChainSizes& sizes)
      : observer_(observer), law_(law), sizes_(sizes) {}

  const ChainSizes& sizes() const override { return sizes_; }

  void step(const double* handle, const double* tension, const double* spool, const double* target, bool compensates,
            double* velocity) override {
    typename Observer::Measured measured{};
    std::copy_n(handle, sizes_.handles, measured.handle_angle);
    std::copy_n(tension, sizes_.tendons, measured.tension);
    std::copy_n(spool, sizes_.tendons, measured.spool_angle);
    double wanted[N]{}, sent[M]{};
    std::copy_n(target, sizes_.joints, wanted);
    const auto& found = observer_.update(measured, memory_->observer);
    law_.update(measured, found, wanted, compensates, memory_->law, sent);
    std::copy_n(sent, sizes_.tendons, velocity);
  }

  std::size_t width() const override {
    return (3 + sizes_.joints) * sizes_.joints + 2 * joint_load_components + 2 + sizes_.tendons;
  }

  double* store(double* out) const override {
    const auto& found = memory_->observer.estimate;
    const std::size_t n = sizes_.joints;
    out = std::copy_n(found.angle, n, out);
    for (std::size_t i = 0; i < n; ++i) *out++ = std::sqrt(found.covariance.at[i][i]);
    out = std::copy_n(found.moment, n, out);
    out = std::ranges::copy(found.load, out).out;
    out = std::ranges::copy(found.load_std, out).out;
    *out++ = found.friction_scale;
    *out++ = found.friction_scale_std;
    out = std::copy_n(found.far_tension, sizes_.tendons, out);
    for (std::size_t i = 0; i < n; ++i) out = std::copy_n(found.covariance.at[i], n, out);
    return out;
  }

  void reset() override { *memory_ = {}; }

 private:
  struct Memory {
    Observer::Memory observer{};
    JointLaw<W>::Memory law{};
  };

  Observer observer_;
  JointLaw<W> law_;
  ChainSizes sizes_;
  std::unique_ptr<Memory> memory_ = std::make_unique<Memory>();
};

std::unique_ptr<AnyJointController> make_joint_controller(const ChainSpec& spec, const In<3>& passages,
                                                          const std::vector<int>& contacts, const In<2>& segments,
                                                          const std::vector<double>& numbers, int law) {
  const std::size_t tendons = spec.tendons();
  require(passages.shape(0) == tendons && passages.shape(2) == passage_numbers && contacts.size() == tendons &&
              segments.shape(0) == tendons && segments.shape(1) == passages.shape(1) + 1 &&
              numbers.size() == joint_control_names.size() && law >= 0 && law <= int(ChainLaw::capstan_power),
          "the controller's rows do not fit the chain");
  const ChainSizes sizes{spec.joints(), spec.handles(), tendons};
  const auto p = [&](JointControlNumber at) { return numbers[at]; };
  return std::visit(
      [&]<class W>(const W& chain) -> std::unique_ptr<AnyJointController> {
        using Made = JointControllerOf<W>;
        typename Made::Observer observer{};
        observer.chain = chain;
        for (std::size_t m = 0; m < tendons; ++m) {
          const int n = contacts[m];
          require(n >= 1 && n <= Made::most_contacts && std::cmp_less_equal(n, passages.shape(1)),
                  "a tendon has too many contacts");
          observer.contacts[m] = n;
          for (int j = 0; j <= n; ++j) observer.compliance[m][j] = 1 / segments(m, std::size_t(j));
          for (int j = 0; j < n; ++j) {
            const double* at = &passages(m, std::size_t(j), 0);
            const int joint = int(at[passage_joint]);
            require(joint >= -1 && std::cmp_less(joint, sizes.joints + sizes.handles),
                    "a tendon crosses a joint that is not there");
            const int place = std::cmp_less(joint, sizes.joints) ? joint : joint - int(sizes.joints) + W::joints;
            observer.passage[m][j] = {place, at[passage_coefficient], at[passage_wrap], at[passage_share],
                                      at[passage_arm]};
          }
        }
        const double least = 1e-3 * *std::ranges::max_element(chain.pretension);
        observer.law = {ChainLaw(law),
                        {p(at_constant)},
                        {p(at_constant), p(at_static_ratio), p(at_stribeck_speed), p(at_memory)},
                        {p(at_constant), p(at_load_index), p(at_reference_tension), p(at_bending_loss), least}};
        observer.sheath_bend_rate = p(at_sheath_bend_rate);
        observer.spool_radius = p(at_spool_radius);
        observer.play = p(at_play);
        observer.tension_play = p(at_tension_play);
        observer.smoothing = p(at_smoothing);
        observer.deviations = {p(at_tension_deviation),   p(at_length_deviation), p(at_friction_deviation),
                               p(at_stiffness_deviation), p(at_force_deviation),  p(at_moment_deviation),
                               p(at_grip_deviation),      p(at_imbalance)};
        JointLaw<W> compensation{};
        compensation.chain = chain;
        compensation.rate = p(at_rate);
        compensation.gain = p(at_gain);
        compensation.speed = p(at_speed);
        compensation.spool_radius = p(at_spool_radius);
        compensation.tension_limit = p(at_tension_limit);
        compensation.least_tension = p(at_least_tension);
        compensation.deviations = p(at_deviations);
        compensation.period = p(at_period);
        require(compensation.prepare(), "neither tendon nor spring holds a joint");
        return std::make_unique<Made>(observer, compensation, sizes);
      },
      spec.any());
}

/// Columns of a twin's signal in a row of all.
std::size_t place_of(const AnyTwin& twin, std::string_view wanted) {
  std::size_t place = 0;
  for (const auto& [name, width] : twin.signals()) {
    if (name == wanted) break;
    place += width;
  }
  return place;
}

std::tuple<std::size_t, Status> run(AnyTwin& twin, AnyJointController& controller, const In<2>& commands,
                                    const In<2>& targets, bool compensates, int steps_per_tick, std::size_t started,
                                    const Out<2>& out, const Out<2>& control) {
  const std::size_t count = commands.shape(0), width = width_of(twin.commands()), signals = width_of(twin.signals());
  const ChainSizes& sizes = controller.sizes();
  require(sizes.joints == twin.sizes().joints && sizes.handles == twin.sizes().handles &&
              sizes.tendons == twin.sizes().tendons && commands.shape(1) == width && targets.shape(0) == count &&
              targets.shape(1) == sizes.joints && out.shape(0) == count && out.shape(1) == signals &&
              control.shape(0) == count && control.shape(1) == controller.width() + sizes.tendons &&
              steps_per_tick >= 1,
          "commands, targets, signals and controller do not fit the twin");
  const std::size_t handle = place_of(twin, "measured_handle_angle"), tension = place_of(twin, "measured_tension"),
                    spool = place_of(twin, "measured_spool_angle");
  const nb::gil_scoped_release release;
  std::vector<double> now(signals), row(width), velocity(sizes.tendons);
  twin.store(now.data());
  const double* seen = now.data();
  double* to = out.data();
  double* said = control.data();
  for (std::size_t i = 0; i < count; ++i) {
    if (i == 0 || (started + i) % std::size_t(steps_per_tick) == 0)
      controller.step(seen + handle, seen + tension, seen + spool, targets.data() + i * sizes.joints, compensates,
                      velocity.data());
    std::copy_n(commands.data() + i * width, width, row.data());
    std::ranges::copy(velocity, row.data() + sizes.handles);
    const Status found = twin.step(row.data());
    if (found != Status::ok) return {i, found};
    seen = to;
    to = twin.store(to);
    said = std::ranges::copy(velocity, controller.store(said)).out;
  }
  return {count, Status::ok};
}

}  // namespace

void bind_joint_control(nb::module_& m) {
  nb::class_<AnyJointController>(m, "JointController", "Observer and law of a chain of joints and tendons.")
      .def(nb::new_(&make_joint_controller), "chain"_a, "passages"_a, "contacts"_a, "segments"_a, "numbers"_a, "law"_a)
      .def(
          "step",
          [](AnyJointController& controller, const In<1>& handle, const In<1>& tension, const In<1>& spool,
             const In<1>& target, bool compensates, const Out<1>& out) {
            const ChainSizes& sizes = controller.sizes();
            require(handle.shape(0) == sizes.handles && tension.shape(0) == sizes.tendons &&
                        spool.shape(0) == sizes.tendons && target.shape(0) == sizes.joints &&
                        out.shape(0) == controller.width() + sizes.tendons,
                    "the measurement does not fit the controller");
            controller.step(handle.data(), tension.data(), spool.data(), target.data(), compensates,
                            out.data() + controller.width());
            controller.store(out.data());
          },
          "handle"_a, "tension"_a, "spool"_a, "target"_a, "compensates"_a, "out"_a,
          nb::sig("def step(self, handle: NDArray[numpy.float64], tension: NDArray[numpy.float64], spool: "
                  "NDArray[numpy.float64], target: NDArray[numpy.float64], compensates: bool, out: "
                  "NDArray[numpy.float64]) -> None"),
          "One tick: estimate, then the spools' velocities, in out.")
      .def(
          "run",
          [](AnyJointController& controller, AnyTwin& twin, const In<2>& commands, const In<2>& targets,
             bool compensates, int steps_per_tick, std::size_t started, const Out<2>& out, const Out<2>& control) {
            return run(twin, controller, commands, targets, compensates, steps_per_tick, started, out, control);
          },
          "twin"_a, "commands"_a, "targets"_a, "compensates"_a, "steps_per_tick"_a, "started"_a, "out"_a, "control"_a,
          nb::sig("def run(self, twin: Twin, commands: NDArray[numpy.float64], targets: NDArray[numpy.float64], "
                  "compensates: bool, steps_per_tick: int, started: int, out: NDArray[numpy.float64], control: "
                  "NDArray[numpy.float64]) -> tuple[int, Status]"),
          "Steps of a twin with it in the loop; returns the steps taken and the last status.")
      .def_prop_ro("width", &AnyJointController::width, "Numbers of an estimate.")
      .def("reset", &AnyJointController::reset, "Return to the initial state.");
  m.def("joint_control_parameters", [] { return list_of(joint_control_names); });
}

}  // namespace tenodesis::bindings

// Observer and law of any chain of joints and tendons, for Python: tick by tick, or in a closed loop with a twin.

#include <algorithm>
#include <functional>
#include <utility>

#include "chain_spec.hpp"
#include "engine/any_twin.hpp"
#include "engine/chain_twin.hpp"
#ifndef TENODESIS_WITHOUT_LIVE
#include "runtime/device.hpp"
#endif
#include "tenodesis/joint_controller.hpp"

namespace tenodesis::bindings {
namespace {

using namespace engine;

/// Numbers of a controller of joints: a row in the order of the table, by name.
struct JointNumbers {
#define TENODESIS_ROW(name, unit, bound, meaning) double name;
  TENODESIS_JOINTS_PARAMETERS(TENODESIS_ROW)
#undef TENODESIS_ROW
  Limit<double> limit[fault_count], spool_jump;
};
#define TENODESIS_ROW(name, unit, bound, meaning) &JointNumbers::name,
constexpr double JointNumbers::* joint_numbers_by_name[] = {TENODESIS_JOINTS_PARAMETERS(TENODESIS_ROW)};
#undef TENODESIS_ROW

std::vector<std::tuple<std::string, std::string, std::string>> joint_control_rows() {
  return {
#define TENODESIS_ROW(name, unit, bound, meaning) {#name, unit, meaning},
      TENODESIS_JOINTS_PARAMETERS(TENODESIS_ROW)
#undef TENODESIS_ROW
  };
}

/// What a controller takes in a tick.
struct JointTick {
  const double* handle;   ///< rad
  const double* tension;  ///< N
  const double* spool;    ///< rad
  const double* target;   ///< of a tool without a handle, rad
  const double* wound;    ///< by commands to the spools, m
  const double* direct;   ///< as of JointInput
  Request request{};
  bool compensates{};
  double since{};  ///< the last tick, s
};

/// A controller of a chain of any size.
class AnyJointController {
 public:
  virtual ~AnyJointController() = default;
  AnyJointController() = default;
  AnyJointController(const AnyJointController&) = delete;
  AnyJointController& operator=(const AnyJointController&) = delete;

  virtual const ChainSizes& sizes() const = 0;
  virtual double spool_radius() const = 0;
  virtual void step(const JointTick& tick) = 0;
  virtual std::size_t width() const = 0;
  /// Writes the estimate: angles, deviations, moments, load, its deviations, friction scale and its deviation,
  /// tensions at the far ends, those that lengths leave unexplained and their deviations, covariance; then velocities
  /// of the spools (rad/s), angles aimed at (rad), state, faults present, and first faults.
  virtual double* store(double* out) const = 0;
  /// What the law has prepared: of joints by joints within and response, then by tendons settled.
  virtual std::vector<double> prepared() const = 0;
  virtual void reset() = 0;

  /// A tick with the request that waits, and what has been wound.
  void tick(const double* handle, const double* tension, const double* spool, const double* target, bool compensates,
            double since) {
    wound_.resize(sizes().tendons);
    step({handle, tension, counted(spool), target, wound_.data(), nullptr, std::exchange(request, Request::none),
          compensates, since});
    begun = true;
  }
  /// A tick in which velocities of the spools (rad/s) pass; the tendons have been wound as far as the spools say.
  void pass(const double* handle, const double* tension, const double* spool, const double* target,
            const double* velocity, double since) {
    wound_.resize(sizes().tendons);
    spool = counted(spool);
    for (std::size_t m = 0; m < wound_.size(); ++m)
      if (is_finite(spool[m])) wound_[m] = spool_radius() * spool[m];
    step(
        {handle, tension, spool, target, wound_.data(), velocity, std::exchange(request, Request::none), false, since});
    begun = true;
  }
  /// Winds the tendons by velocities of their spools (rad/s) for a time (s), as a rigid coupling would.
  void wind(const double* velocity, double time) {
    wound_.resize(sizes().tendons);
    for (std::size_t m = 0; m < wound_.size(); ++m) wound_[m] += spool_radius() * velocity[m] * time;
  }

  /// Counts the spools' angles from these, rad.
  void count_from(const double* spool) { zero_.assign(spool, spool + sizes().tendons); }

  double wound(std::size_t tendon) const { return tendon < wound_.size() ? wound_[tendon] : 0; }

  Request request{};  ///< to be made with the next tick
  bool begun{};       ///< whether there has been a tick

 protected:
  void forget() {
    wound_.clear();
    zero_.clear();
    request = Request::none;
    begun = false;
  }

 private:
  const double* counted(const double* spool) {
    if (zero_.empty()) return spool;
    counted_.resize(zero_.size());
    std::transform(spool, spool + zero_.size(), zero_.begin(), counted_.begin(), std::minus{});
    return counted_.data();
  }

  std::vector<double> wound_;           // m
  std::vector<double> zero_, counted_;  // rad
};

template <class W>
class JointControllerOf final : public AnyJointController {
 public:
  static constexpr int N = W::joints, M = W::tendons;
  static constexpr int most_contacts = 2 * most_vertices * N + most_long_sheath_contacts;
  using Controller = JointController<W, most_contacts>;

  JointControllerOf(const Controller& controller, const ChainSizes& sizes) : controller_(controller), sizes_(sizes) {}

  const ChainSizes& sizes() const override { return sizes_; }

  void step(const JointTick& tick) override {
    typename Controller::Input in{};
    std::copy_n(tick.handle, sizes_.handles, in.measured.handle_angle);
    std::copy_n(tick.tension, sizes_.tendons, in.measured.tension);
    std::copy_n(tick.spool, sizes_.tendons, in.measured.spool_angle);
    std::copy_n(tick.target, sizes_.joints, in.commanded);
    double wound[M]{};
    std::copy_n(tick.wound, sizes_.tendons, wound);
    in.wound = wound;
    in.direct = tick.direct;
    in.request = tick.request;
    in.compensates = tick.compensates;
    in.since = tick.since;
    controller_.template step<true>(in, *memory_);
  }

  std::size_t width() const override {
    return (3 + sizes_.joints) * sizes_.joints + 2 * load_components + 2 + 3 * sizes_.tendons;
  }

  double* store(double* out) const override {
    const auto& found = memory_->observer.estimate;
    const std::size_t n = sizes_.joints, m = sizes_.tendons;
    out = std::copy_n(found.angle, n, out);
    for (std::size_t i = 0; i < n; ++i) *out++ = std::sqrt(found.covariance.at[i][i]);
    out = std::copy_n(found.moment, n, out);
    out = std::ranges::copy(found.load, out).out;
    out = std::ranges::copy(found.load_std, out).out;
    *out++ = found.friction_scale;
    *out++ = found.friction_scale_std;
    for (const auto* by_tendon : {found.far_tension, found.unexplained, found.unexplained_std})
      out = std::copy_n(by_tendon, m, out);
    for (std::size_t i = 0; i < n; ++i) out = std::copy_n(found.covariance.at[i], n, out);
    out = std::copy_n(memory_->velocity, m, out);
    out = std::copy_n(memory_->aim, n, out);
    const auto& state = memory_->supervisor.state;
    for (const double one : {double(state.operating), double(memory_->faults()), double(state.first)}) *out++ = one;
    return out;
  }

  std::vector<double> prepared() const override {
    const auto& from = controller_.law.prepared;
    std::vector<double> out;
    for (const auto* of_joints : {&from.within, &from.response})
      for (std::size_t i = 0; i < sizes_.joints; ++i)
        out.insert(out.end(), (*of_joints)[i], (*of_joints)[i] + sizes_.joints);
    for (std::size_t i = 0; i < sizes_.joints; ++i)
      out.insert(out.end(), from.settled[i], from.settled[i] + sizes_.tendons);
    return out;
  }

  void reset() override {
    *memory_ = {};
    forget();
  }
  double spool_radius() const override { return controller_.law.spool_radius; }

 private:
  Controller controller_;
  ChainSizes sizes_;
  std::unique_ptr<typename Controller::Memory> memory_ = std::make_unique<typename Controller::Memory>();
};

std::unique_ptr<AnyJointController> make_joint_controller(const ChainSpec& spec, const In<3>& passages,
                                                          const std::vector<int>& contacts, const In<2>& segments,
                                                          const std::vector<double>& numbers, const In<2>& limits,
                                                          int law) {
  const std::size_t tendons = spec.tendons();
  require(passages.shape(0) == tendons && passages.shape(2) == passage_numbers && contacts.size() == tendons &&
              segments.shape(0) == tendons && segments.shape(1) == passages.shape(1) + 1 &&
              numbers.size() == std::size(joint_numbers_by_name) && limits.shape(0) == limit_count &&
              limits.shape(1) == 2 && law >= 0 && law <= int(ChainLaw::capstan_power),
          "the controller's rows do not fit the chain");
  const ChainSizes sizes{spec.joints(), spec.handles(), tendons};
  JointNumbers p{};
  for (std::size_t k = 0; k < numbers.size(); ++k) p.*joint_numbers_by_name[k] = numbers[k];
  for (std::size_t k = 0; k < limit_count; ++k)
    (k < std::size_t(fault_count) ? p.limit[k] : p.spool_jump) = Limit<double>{limits(k, 0), limits(k, 1)};
  return std::visit(
      [&]<class W>(const W& chain) -> std::unique_ptr<AnyJointController> {
        using Made = JointControllerOf<W>;
        typename Made::Controller controller{};
        auto& observer = controller.observer;
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
            observer.passage[m][j] = {place,           at[passage_coefficient], at[passage_wrap], at[passage_share],
                                      at[passage_arm], at[passage_wound]};
          }
        }
        observer.law.kind = ChainLaw(law);
        controller.supervisor.tendons = int(tendons);
        require(controller.set_numbers(p), "the controller's numbers are out of range");
        require(controller.law.prepare(), "neither tendon nor spring holds a joint");
        return std::make_unique<Made>(controller, sizes);
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

/// Numbers that a controller stores in all.
std::size_t stored(const AnyJointController& controller) {
  return controller.width() + controller.sizes().tendons + controller.sizes().joints + 3;
}

std::tuple<std::size_t, Status> run(AnyJointController& controller, AnyTwin& twin, const In<2>& commands,
                                    const In<2>& targets, const std::vector<int>& requests, bool compensates,
                                    int steps_per_tick, double time_step, std::size_t started, const Out<2>& out,
                                    const Out<2>& control) {
  const std::size_t count = commands.shape(0), width = width_of(twin.commands()), signals = width_of(twin.signals());
  const ChainSizes& sizes = controller.sizes();
  require(sizes.joints == twin.sizes().joints && sizes.handles == twin.sizes().handles &&
              sizes.tendons == twin.sizes().tendons && commands.shape(1) == width && targets.shape(0) == count &&
              targets.shape(1) == sizes.joints && requests.size() == count && out.shape(0) == count &&
              out.shape(1) == signals && control.shape(0) == count && control.shape(1) == stored(controller) &&
              steps_per_tick >= 1 && time_step > 0,
          "commands, targets, signals and controller do not fit the twin");
  const std::size_t handle = place_of(twin, "measured_handle_angle"), tension = place_of(twin, "measured_tension"),
                    spool = place_of(twin, "measured_spool_angle");
  const nb::gil_scoped_release release;
  std::vector<double> now(signals), row(width);
  twin.store(now.data());
  const double* seen = now.data();
  double* to = out.data();
  double* said = control.data();
  for (std::size_t i = 0; i < count; ++i) {
    std::copy_n(commands.data() + i * width, width, row.data());
    double* const velocity = row.data() + sizes.handles;
    controller.wind(velocity, time_step);
    if (requests[i] != 0) controller.request = Request(requests[i]);
    if ((started + i) % std::size_t(steps_per_tick) == 0 || !controller.begun)
      controller.tick(seen + handle, seen + tension, seen + spool, targets.data() + i * sizes.joints, compensates,
                      steps_per_tick * time_step);
    controller.store(said);
    std::copy_n(said + controller.width(), sizes.tendons, velocity);
    const Status found = twin.step(row.data());
    if (found != Status::ok) return {i, found};
    seen = to;
    to = twin.store(to);
    said += control.shape(1);
  }
  return {count, Status::ok};
}

#ifndef TENODESIS_WITHOUT_LIVE

/// Where a tick's numbers end with state, faults, and first faults.
enum JointState : std::size_t { at_state, at_faults, at_first_faults, joint_states };

/// In the live loop, between it and its device: what the loop commands the spools are targets of the law.
class LiveJoints final : public runtime::Device {
 public:
  LiveJoints(runtime::Device& device, AnyJointController& controller, double period)
      : Device(device.sizes, device.commands.all(), with_own(device)),
        device_(device),
        controller_(controller),
        period_(period),
        spools_(device.commands.find("spool_velocity").first),
        now_(device.signals.width()),
        said_(stored(controller)),
        row_(device.commands.width()),
        straight_(sizes.joints) {
    controller_.store(said_.data());
  }

  bool simulated() const override { return device_.simulated(); }
  bool clocked() const override { return device_.clocked(); }
  bool read(std::uint64_t& time, std::uint64_t timeout) override {
    fresh_ = device_.read(time, timeout);
    since_ = time > read_at_ && read_at_ != 0 ? double(time - read_at_) * 1e-9 : period_;
    // Whole nanoseconds are no other period.
    if (std::abs(since_ - period_) < 1e-6 * period_) since_ = period_;
    if (fresh_) read_at_ = time;
    return fresh_;
  }
  bool may_be_late() const override { return device_.may_be_late(); }
  std::uint64_t overtaken() const override { return device_.overtaken(); }
  bool in_tissue(std::size_t joint) const override { return device_.in_tissue(joint); }
  void cut_power() noexcept override { device_.cut_power(); }
  void stop() noexcept override { device_.stop(); }

  /// With the law its spool angles are those that were commanded: the loop has nothing to correct.
  Measurement<double> reading(const CompensatedAxis& axis) const override {
    Measurement<double> read = device_.reading(axis);
    const std::size_t tendons[]{axis.agonist, axis.antagonist};
    for (int i = 0; i < 2; ++i)
      if (compensates && is_finite(read.spool_angle[i]))
        read.spool_angle[i] = controller_.wound(tendons[i]) / controller_.spool_radius();
    return read;
  }

  bool write(const double* row) override {
    std::copy_n(row, row_.size(), row_.begin());
    double* const velocity = row_.data() + spools_;
    device_.store(now_.data());
    const auto at = [&](const char* name) { return now_.data() + device_.signals.find(name).first; };
    const double *const handle = at("measured_handle_angle"), *const tension = at("measured_tension"),
                        *const spool = at("measured_spool_angle");
    if (compensates) controller_.wind(velocity, period_);
    // A measurement that has not come is waited for; that it stays away, the loop notices.
    if (fresh_ && compensates) controller_.tick(handle, tension, spool, straight_.data(), true, since_);
    if (fresh_ && !compensates) controller_.pass(handle, tension, spool, straight_.data(), velocity, since_);
    controller_.store(said_.data());
    std::copy_n(said_.data() + controller_.width(), sizes.tendons, velocity);
    return device_.write(row_.data());
  }

  void store(double* out) const override {
    device_.store(out);
    out += device_.signals.width();
    const std::size_t n = sizes.joints;
    const double* const velocity = said_.data() + controller_.width();
    out = std::copy_n(velocity, sizes.tendons, out);
    out = std::copy_n(velocity + sizes.tendons, n, out);
    out = std::copy_n(said_.data(), 2 * n, out);
    const double* const scale = said_.data() + 3 * n + 2 * load_components;
    for (const double one : {scale[0], scale[1], said(at_state), said(at_faults)}) out = std::fill_n(out, n, one);
  }

  double said(JointState which) const { return said_[said_.size() - joint_states + which]; }
  AnyJointController& controller() { return controller_; }

  bool compensates{true};

 private:
  static std::vector<engine::Column> with_own(const runtime::Device& device) {
    std::vector<engine::Column> columns = device.signals.all();
    columns.emplace_back("commanded_spool_velocity", device.sizes.tendons);
    for (const char* name : {"commanded_output_angle", "estimated_output_angle", "estimated_output_angle_std",
                             "friction_scale", "friction_scale_std", "operating_state", "faults"})
      columns.emplace_back(name, device.sizes.joints);
    return columns;
  }

  runtime::Device& device_;
  AnyJointController& controller_;
  double period_;
  std::size_t spools_;
  std::vector<double> now_, said_, row_, straight_;
  bool fresh_{true};
  std::uint64_t read_at_{};  // ns
  double since_{};           // s
};

/// What the loop asks and is told of a controller of all joints, which itself runs between loop and device.
class JointSwitch final : public AnyController {
 public:
  explicit JointSwitch(LiveJoints& joints) : joints_(joints) { last.homed = true; }

  int axes() const override { return 0; }
  const link::ControllerParameters& parameters() const override { return parameters_; }
  tenodesis_counts counts(int /*axis*/) const override { return {}; }
  Phase phase(int /*axis*/) const override { return Phase::rest; }
  bool watchdog(double /*since_last_step*/) const override { return false; }
  bool choose(ControlLaw law, Actuation /*actuation*/) override {
    joints_.compensates = law != ControlLaw::off;
    return true;
  }
  void reset() override {
    joints_.controller().reset();
    forget();
    last.homed = true;
  }

  void step(const AnyInput& input, AnyOutput& output) override {
    if (input.request != Request::none) joints_.controller().request = input.request;
    SupervisorState<double> state{};
    state.operating = OperatingState(int(joints_.said(at_state)));
    output.state = Supervisor<double>{}.advance(input.request, 0, 0, state);
    output.faults = std::uint32_t(joints_.said(at_faults));
    output.first_faults = std::uint32_t(joints_.said(at_first_faults));
  }

 private:
  LiveJoints& joints_;
  link::ControllerParameters parameters_{};
};

#endif

}  // namespace

void bind_joint_control(nb::module_& m) {
  nb::class_<AnyJointController>(m, "JointController", "Observer and law of a chain of joints and tendons.")
      .def(nb::new_(&make_joint_controller), "chain"_a, "passages"_a, "contacts"_a, "segments"_a, "numbers"_a,
           "limits"_a, "law"_a)
      .def(
          "step",
          [](AnyJointController& controller, const In<1>& handle, const In<1>& tension, const In<1>& spool,
             const In<1>& target, int request, bool compensates, double since, const Out<1>& out) {
            const ChainSizes& sizes = controller.sizes();
            require(handle.shape(0) == sizes.handles && tension.shape(0) == sizes.tendons &&
                        spool.shape(0) == sizes.tendons && target.shape(0) == sizes.joints &&
                        out.shape(0) == stored(controller),
                    "the measurement does not fit the controller");
            if (request != 0) controller.request = Request(request);
            controller.tick(handle.data(), tension.data(), spool.data(), target.data(), compensates, since);
            controller.store(out.data());
          },
          "handle"_a, "tension"_a, "spool"_a, "target"_a, "request"_a, "compensates"_a, "since"_a, "out"_a,
          "One tick, since seconds after the last; out: what is stored of it.")
      .def("run", &run, "twin"_a, "commands"_a, "targets"_a, "requests"_a, "compensates"_a, "steps_per_tick"_a,
           "time_step"_a, "started"_a, "out"_a, "control"_a,
           "Steps of a twin with it in the loop; returns the steps taken and the last status.")
      .def_prop_ro("width", &AnyJointController::width, "Numbers of an estimate.")
      .def_prop_ro("stored", &stored, "Numbers of a tick.")
      .def_prop_ro("prepared", &AnyJointController::prepared, "Constants of the law: within, response, settled.")
      .def(
          "count_from",
          [](AnyJointController& controller, const In<1>& spool) {
            require(spool.shape(0) == controller.sizes().tendons, "the spools do not fit the controller");
            controller.count_from(spool.data());
          },
          "spool"_a, "Count the spools' angles from these, rad.")
      .def("reset", &AnyJointController::reset, "Return to the initial state.");
#ifndef TENODESIS_WITHOUT_LIVE
  nb::class_<LiveJoints, runtime::Device>(m, "LiveJoints", "A controller of all joints between live loop and device.")
      .def(nb::init<runtime::Device&, AnyJointController&, double>(), "device"_a, "controller"_a, "period"_a,
           nb::keep_alive<1, 2>(), nb::keep_alive<1, 3>())
      .def_rw("compensates", &LiveJoints::compensates, "Whether the motors give back what joints lose.");
  nb::class_<JointSwitch, AnyController>(m, "JointSwitch", "What the live loop asks a controller of all joints.")
      .def(nb::init<LiveJoints&>(), "joints"_a, nb::keep_alive<1, 2>());
#endif
  m.def("joint_control_parameters", &joint_control_rows, "Name, unit and meaning of the controller's numbers.");
  m.attr("JOINTS_VERSION") = TENODESIS_JOINTS_VERSION;
}

}  // namespace tenodesis::bindings

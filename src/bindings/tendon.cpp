// One tendon of any number of contacts for Python.

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "module.hpp"
#include "tenodesis/far_end.hpp"
#include "tenodesis/tendon.hpp"

namespace tenodesis::bindings {
namespace {

/// A row whose length is set when a tendon is made.
template <class T>
struct VectorRow {
  std::vector<T> at;

  int size() const { return int(at.size()); }
  decltype(auto) operator[](int i) { return at[std::size_t(i)]; }
  decltype(auto) operator[](int i) const { return at[std::size_t(i)]; }
};

struct AnyContacts {
  template <class T>
  using PerContact = VectorRow<T>;
  template <class T>
  using PerSegment = VectorRow<T>;
};

struct AnyTendon {
  Tendon<double, AnyContacts> tendon;
  VectorRow<Band<double>> band;
  TendonState<double, AnyContacts> state;
  Tendon<double, AnyContacts>::Line line;
  double viscous{};

  AnyTendon(const std::vector<double>& stiffness, const std::vector<double>& exponent, double constant, double drag,
            double rest_tension)
      : viscous(drag) {
    const std::size_t n = exponent.size();
    require(n > 0 && stiffness.size() == n + 1, "a tendon has one segment more than contacts");
    tendon.stiffness.at = stiffness;
    tendon.rest_tension = rest_tension;
    const CapstanWithConstant<double> law{constant};
    for (const double each : exponent) band.at.push_back(law.band(each, 0));
    state.slip.at.assign(n, 0);
    state.slide.at.assign(n, Slide::none);
    state.slack.at.assign(n + 1, false);
    state.tension.at.assign(n + 1, rest_tension);
    line.at_rest.at.assign(n, 0);
    line.rate.at.assign(n, 0);
  }

  /// Steps over prescribed ends: the spool's as wound length or as tension, the tip's as length drawn.
  ///
  /// out: proximal and distal tension, wound length, loss to friction (J) and residual (N) of each step.
  int run(const In<1>& spool, const In<1>& drawn, bool by_tension, double time_step, const Out<2>& out) {
    const std::size_t count = spool.shape(0);
    const int n = tendon.contacts();
    if (drawn.shape(0) != count || out.shape(0) != 5 || out.shape(1) != count)
      throw nb::value_error("arrays do not fit");
    const nb::gil_scoped_release release;
    VectorRow<double> pull{std::vector<double>(std::size_t(n) + 1, 0.0)};
    int most = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const TendonState<double, AnyContacts> before = state;
      pull[n] = drawn.data()[i];
      double scale = tendon.rest_tension;
      for (const double tension : state.tension.at) scale = std::max(scale, tension);
      for (int j = 0; j < n; ++j) band[j].drag = viscous / time_step + least_drag<double> * tendon.stiffness[j];
      const Reaction<double> end =
          by_tension ? Reaction<double>{spool.data()[i], 0} : tendon.held_by_spool(spool.data()[i]);
      most = std::max(most, settle(tendon, band, pull, end, friction_tolerance<double> * (scale + 1), state, line));
      double lost = 0;
      for (int j = 0; j < n; ++j) lost += (state.tension[j] - state.tension[j + 1]) * (state.slip[j] - before.slip[j]);
      const double wound = state.slip[0] + (state.tension[0] - tendon.rest_tension) / tendon.stiffness[0];
      const double row[5] = {state.tension[0], state.tension[n], by_tension ? wound : spool.data()[i], lost,
                             tendon.residual(band, before.slip, state)};
      for (std::size_t k = 0; k < 5; ++k) out.data()[k * count + i] = row[k];
    }
    return most;
  }
};

void transmit_all(const In<1>& tension, double exponent, double gain, double held, const Out<2>& out) {
  if (out.shape(0) != 1 || out.shape(1) != tension.shape(0)) throw nb::value_error("out does not fit");
  const Band<double> band = Capstan<double>::band(exponent, 0);
  const nb::gil_scoped_release release;
  for (std::size_t i = 0; i < tension.shape(0); ++i) {
    // A load cell's noise may be negative, but no tendon can push.
    held = transmit(band, larger(tension.data()[i], 0.0), held);
    out.data()[i] = gain * held;
  }
}

/// By which bound a value that only moves where a band pushes it was last pushed: k + 1 for upper[k], -(k + 1) for
/// lower[k], 0 before the first.
void play(const In<1>& lower, const In<1>& upper, double start, const Array<std::int64_t, 1>& source) {
  const std::size_t count = lower.shape(0);
  if (upper.shape(0) != count || source.shape(0) != count) throw nb::value_error("arrays do not fit");
  const nb::gil_scoped_release release;
  std::int64_t last = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const double low = lower.data()[i], high = upper.data()[i];
    if (start > high) {
      start = high;
      last = std::int64_t(i) + 1;
    } else if (start < low) {
      start = low;
      last = -(std::int64_t(i) + 1);
    }
    source.data()[i] = last;
  }
}

/// Parameters of a transmission by name, in their order.
std::vector<std::pair<const char*, double*>> parameters_of(Transmission<double>& to) {
  auto& drive = to.drive;
  return {{"torque_constant", &drive.torque_constant},
          {"drive_friction", &drive.friction},
          {"drive_friction_slope", &drive.friction_slope},
          {"load_friction", &drive.load_friction},
          {"viscous", &drive.viscous},
          {"heat_loss", &drive.heat_loss},
          {"heat_time", &drive.heat_time},
          {"speed_time", &drive.speed_time},
          {"drive_play", &drive.play},
          {"torque_offset", &to.offset},
          {"ratio", &to.ratio},
          {"torque_ratio", &to.torque_ratio},
          {"near_compliance", &to.near_compliance},
          {"compliance", &to.compliance},
          {"far_compliance", &to.far_compliance},
          {"near_stiffness", &to.near_stiffness},
          {"far_stiffness", &to.far_stiffness},
          {"near_friction", &to.near_friction},
          {"friction_exponent", &to.exponent},
          {"pretension", &to.pretension},
          {"joint_friction", &to.joint_friction},
          {"play", &to.play}};
}

std::vector<std::string> transmission_names() {
  Transmission<double> any{};
  std::vector<std::string> names;
  for (const auto& [name, place] : parameters_of(any)) names.emplace_back(name);
  return names;
}

Transmission<double> transmission_of(const In<1>& values) {
  Transmission<double> to{};
  const auto places = parameters_of(to);
  require(values.shape(0) == places.size(), "values do not fit the names of a transmission");
  for (std::size_t i = 0; i < places.size(); ++i) *places[i].second = values.data()[i];
  return to;
}

void far_end(const In<1>& values, const In<1>& angle, const In<1>& signal, double time_step, const Out<2>& out) {
  const std::size_t count = angle.shape(0);
  if (signal.shape(0) != count || out.shape(0) != 5 || out.shape(1) != count)
    throw nb::value_error("arrays do not fit");
  const Transmission<double> transmission = transmission_of(values);
  const nb::gil_scoped_release release;
  FarEndMemory<double> memory{};
  for (std::size_t i = 0; i < count; ++i) {
    const FarEnd<double> far = follow_far_end(transmission, angle.data()[i], signal.data()[i], time_step, memory);
    const double row[5] = {far.angle, far.torque, far.hidden_angle, far.hidden_torque, far.near_torque};
    for (std::size_t k = 0; k < 5; ++k) out.data()[k * count + i] = row[k];
  }
}

}  // namespace

void bind_tendon(nb::module_& m) {
  nb::class_<AnyTendon>(m, "Tendon", "An elastic tendon through contacts with friction, with its state.")
      .def(nb::init<const std::vector<double>&, const std::vector<double>&, double, double, double>(), "stiffness"_a,
           "exponent"_a, "constant"_a, "viscous"_a, "rest_tension"_a)
      .def("run", &AnyTendon::run, "spool"_a, "drawn"_a, "by_tension"_a, "time_step"_a, "out"_a,
           "Step over prescribed ends; out: proximal and distal tension, wound length, friction loss, residual. "
           "Returns the most sweeps.")
      .def_prop_ro(
          "tension", [](const AnyTendon& own) { return own.state.tension.at; }, "Tension of every segment, N.")
      .def_prop_ro("slip", [](const AnyTendon& own) { return own.state.slip.at; }, "Slip past every contact, m.");
  m.def("transmit", &transmit_all, "tension"_a, "exponent"_a, "gain"_a, "held"_a, "out"_a,
        "Write the distal tension of one contact; held: the distal tension before, N.");
  m.def("play", &play, "lower"_a, "upper"_a, "start"_a, "source"_a,
        "Write by which bound a value was pushed last: k + 1 by upper[k], -(k + 1) by lower[k], 0 by none.");
  m.def("transmission_parameters", &transmission_names, "Names of a transmission's parameters, in their order.");
  m.def(
      "far_end", &far_end, "values"_a, "angle"_a, "signal"_a, "time_step"_a, "out"_a,
      "Write angle and torque of the far end of a transmission, how far friction may hide each, and its near torque.");
}

}  // namespace tenodesis::bindings

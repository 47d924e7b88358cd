// The Python module over the core: arrays in, arrays out, interpreter lock released; and the statics.

#include "evaluate.hpp"
#include "module.hpp"
#include "tenodesis/current.hpp"
#include "tenodesis/similarity.hpp"
#include "tenodesis/version.h"

namespace tenodesis::bindings {
namespace {

using namespace engine;

struct Arguments {
  std::vector<Column> columns;
  std::size_t count{1};

  Arguments(const std::vector<In<1>>& inputs, int expected) {
    require(inputs.size() == std::size_t(expected), "wrong number of inputs");
    for (const In<1>& input : inputs)
      if (input.shape(0) != 1) count = input.shape(0);
    for (const In<1>& input : inputs) {
      require(input.shape(0) == count || input.shape(0) == 1, "inputs differ in length");
      columns.push_back({input.data(), input.shape(0) != count});
    }
  }

  Points points() const { return {columns, count}; }
};

// Calls f with the operation of a name as a type, and whether it is a held one.
template <class F, class... H, class... D>
bool dispatch(const std::string& name, const F& f, List<H...>, List<D...>) {
  return ((name == H::name && (f.template operator()<H, true>(), true)) || ...) ||
         ((name == D::name && (f.template operator()<D, false>(), true)) || ...);
}

template <class F>
void dispatch(const std::string& name, const F& f) {
  if (!dispatch(name, f, HeldOperations{}, DirectOperations{}))
    throw nb::value_error(("no operation named " + name).c_str());
}

template <class Operation, bool held>
constexpr int inputs_of() {
  if constexpr (held)
    return held_inputs;
  else
    return Operation::inputs;
}

/// Arrays that an operation writes: outputs by rows by points, and the status of every point.
struct Results {
  Out<3> out;
  Statuses status;
};

/// Runs work(operation, points, out, status, begin, end) over threads without the interpreter lock.
template <class Work>
void over_points(const std::string& name, const std::vector<In<1>>& inputs, const Results& results, std::size_t rows,
                 int threads, std::size_t least, const Work& work) {
  dispatch(name, [&]<class Operation, bool held>() {
    const Arguments arguments(inputs, inputs_of<Operation, held>());
    const Points points = arguments.points();
    require(results.out.shape(0) == std::size_t(Operation::outputs) && results.out.shape(1) == rows &&
                results.out.shape(2) == points.count && results.status.shape(0) == points.count,
            "outputs do not fit operation and inputs");
    std::array<double*, Operation::outputs> out{};
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = results.out.data() + k * rows * points.count;
    if (points.count == 0) return;
    const nb::gil_scoped_release release;
    over_threads(points.count, threads, least, [&](std::size_t begin, std::size_t end) {
      work.template operator()<Operation, held>(points, out, results.status.data(), begin, end);
    });
  });
}

void evaluate(const Spec& spec, const std::string& name, const std::vector<In<1>>& inputs, const Out<3>& out,
              const Statuses& status, int threads) {
  const AnyAxis<double> any = make_axis(spec);
  over_points(name, inputs, {out, status}, 1, threads, points_per_thread,
              [&]<class Operation, bool held>(const Points& points, std::span<double* const> data, unsigned char* found,
                                              std::size_t begin, std::size_t end) {
                std::visit(
                    [&](const auto& axis) {
                      if constexpr (held)
                        evaluate_held<Operation>(axis, points, data, found, begin, end);
                      else
                        evaluate_direct<Operation>(axis, points, data, found, begin, end);
                    },
                    any);
              });
}

void gradient(const Spec& spec, const std::string& name, const std::vector<In<1>>& inputs,
              const std::vector<std::size_t>& variables, const Out<3>& out, const Statuses& status, int threads) {
  require(!variables.empty(), "no variables");
  for (const std::size_t variable : variables) require(variable < parameter_count + inputs.size(), "no such variable");
  // A derivative costs several times as much as a value, so that fewer of them justify a thread.
  over_points(name, inputs, {out, status}, variables.size(), threads, points_per_thread / 8,
              [&]<class Operation, bool held>(const Points& points, std::span<double* const> data, unsigned char* found,
                                              std::size_t begin, std::size_t end) {
                using Pointwise = std::conditional_t<held, Direct<Operation>, Operation>;
                differentiate<Pointwise>(spec, points, variables, data, found, begin, end);
              });
}

}  // namespace

NB_MODULE(_core, m) {
  // Instruments may keep their spec for longer than the module exists.
  nb::set_leak_warnings(false);
  m.doc() = "The C++ core over arrays; the package's modules are its interface.";
  m.attr("VERSION") = TENODESIS_VERSION_STRING;

  nb::enum_<Status>(m, "Status", nb::is_arithmetic(), "How a solve ended.")
      .value("OK", Status::ok, "solved")
      .value("NO_EQUILIBRIUM", Status::no_equilibrium, "loaded past the fold: the joint snaps through")
      .value("UNREACHABLE", Status::unreachable, "outside the mechanism's range")
      .value("BOTH_SLACK", Status::both_slack, "neither tendon holds the joint")
      .value("NO_AUTHORITY", Status::no_authority, "no stroke of the acting motors restores the angle")
      .value("OUT_OF_RANGE", Status::out_of_range, "handle angle beyond the handle's range")
      .value("NOT_FINITE", Status::not_finite, "NaN or infinite input");

  nb::enum_<JointType>(m, "JointType", "Joint mechanism.")
      .value("TENDON_GEAR", JointType::tendon_gear)
      .value("TENDON_PULLEY", JointType::tendon_pulley)
      .value("CONTINUUM", JointType::continuum);

  nb::class_<Spec>(m, "Spec", "One axis of an instrument, in SI units.")
      .def(
          "__init__",
          [](Spec* self, JointType type, const std::array<double, parameter_count>& parameters, double range) {
            new (self) Spec{type, parameters, range};
          },
          "joint_type"_a, "parameters"_a, "handle_range"_a)
      .def("__getstate__",
           [](const Spec& spec) { return std::make_tuple(spec.joint_type, spec.parameters, spec.handle_range); })
      .def("__setstate__",
           [](Spec& spec, const std::tuple<JointType, std::array<double, parameter_count>, double>& state) {
             new (&spec) Spec{std::get<0>(state), std::get<1>(state), std::get<2>(state)};
           });

  m.def("parameters", [] { return list_of(parameter_names); }, "Names of a spec's parameters, in their order.");
  m.def(
      "tendon_stiffness",
      [](const Spec& spec) { return std::visit([](const auto& axis) { return axis.stiffness; }, make_axis(spec)); },
      "spec"_a, "Stiffness of one tendon, N/m.");
  m.def(
      "unloaded_limit",
      [](const Spec& spec) {
        return std::visit([](const auto& axis) { return unloaded_limit(axis); }, make_axis(spec));
      },
      "spec"_a, "Unloaded distal coordinate at the end of the handle's range, as a share of the joint's limit.");
  // Python allocates the results: NumPy uses huge pages, which saves a page fault per 4 KiB.
  m.def("evaluate", &evaluate, "spec"_a, "operation"_a, "inputs"_a, "out"_a, "status"_a, "threads"_a,
        "Write an operation's outputs, by output, 1 and point, and the status of every point.");
  m.def("gradient", &gradient, "spec"_a, "operation"_a, "inputs"_a, "variables"_a, "out"_a, "status"_a, "threads"_a,
        "Write the derivatives, by output, variable and point, and the status of every point.");

  m.def("tension_from_current", &tension_from_current<double>, "current"_a, "tension_per_current"_a, "range"_a,
        "Tension that a motor's current (A) stands for, N.");

  bind_joint(m);
  bind_tendon(m);
  bind_tendon_chain(m);
  bind_chain_twin(m);
  bind_twin(m);
  bind_twin_gradient(m);
  bind_control(m);
#ifndef TENODESIS_WITHOUT_LIVE
  bind_runtime(m);
  bind_serial(m);
#endif
  bind_joint_control(m);
  bind_similarity(m);
  bind_kinematics(m);
}

}  // namespace tenodesis::bindings

// The Python module over the core: arrays in, arrays out, interpreter lock released.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "evaluate.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace tenodesis::bindings {
namespace {

using Input = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<nb::numpy, double>;
using StatusOutput = nb::ndarray<nb::numpy, unsigned char, nb::ndim<1>>;

template <class T>
T* owned(std::size_t size, nb::capsule& owner) {
  T* data = new T[size];
  owner = nb::capsule(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
  return data;
}

struct Arguments {
  std::vector<Column> columns;
  std::size_t count{1};

  Arguments(const std::vector<Input>& inputs, int expected) {
    if (inputs.size() != std::size_t(expected)) throw nb::value_error("wrong number of inputs");
    for (const Input& input : inputs)
      if (input.shape(0) != 1) count = input.shape(0);
    for (const Input& input : inputs) {
      if (input.shape(0) != count && input.shape(0) != 1) throw nb::value_error("inputs differ in length");
      columns.push_back({input.data(), input.shape(0) != count});
    }
  }

  Points points() const { return {columns, count}; }
};

// Calls f with the operation of a name, as a type; held ones and direct ones alike.
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

nb::tuple evaluate(const Spec& spec, const std::string& name, const std::vector<Input>& inputs, int threads) {
  nb::object result;
  dispatch(name, [&]<class Operation, bool held>() {
    const Arguments arguments(inputs, inputs_of<Operation, held>());
    const Points points = arguments.points();
    nb::capsule status_owner;
    auto* status = owned<unsigned char>(points.count, status_owner);
    std::array<nb::capsule, Operation::outputs> owners;
    std::array<double*, Operation::outputs> out{};
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = owned<double>(points.count, owners[k]);
    {
      nb::gil_scoped_release release;
      const AnyAxis<double> any = make_axis(spec);
      over_threads(points.count, threads, points_per_thread, [&](std::size_t begin, std::size_t end) {
        std::visit(
            [&](const auto& axis) {
              if constexpr (held)
                evaluate_held<Operation>(axis, points, out, status, begin, end);
              else
                evaluate_direct<Operation>(axis, points, out, status, begin, end);
            },
            any);
      });
    }
    nb::list values;
    for (std::size_t k = 0; k < out.size(); ++k) values.append(Output(out[k], {points.count}, owners[k]));
    result = nb::make_tuple(values, StatusOutput(status, {points.count}, status_owner));
  });
  return nb::cast<nb::tuple>(result);
}

nb::tuple gradient(const Spec& spec, const std::string& name, const std::vector<Input>& inputs,
                   const std::vector<std::size_t>& variables, int threads) {
  nb::object result;
  dispatch(name, [&]<class Operation, bool held>() {
    const Arguments arguments(inputs, inputs_of<Operation, held>());
    const Points points = arguments.points();
    nb::capsule status_owner;
    auto* status = owned<unsigned char>(points.count, status_owner);
    std::array<nb::capsule, Operation::outputs> owners;
    std::array<double*, Operation::outputs> out{};
    for (std::size_t k = 0; k < out.size(); ++k) out[k] = owned<double>(points.count * variables.size(), owners[k]);
    {
      nb::gil_scoped_release release;
      using Pointwise = std::conditional_t<held, Direct<Operation>, Operation>;
      over_threads(points.count, threads, points_per_thread / 8, [&](std::size_t begin, std::size_t end) {
        differentiate<Pointwise>(spec, points, variables, out, status, begin, end);
      });
    }
    nb::list values;
    for (std::size_t k = 0; k < out.size(); ++k)
      values.append(Output(out[k], {variables.size(), points.count}, owners[k]));
    result = nb::make_tuple(values, StatusOutput(status, {points.count}, status_owner));
  });
  return nb::cast<nb::tuple>(result);
}

}  // namespace

NB_MODULE(_core, m) {
  // Instruments keep their spec for as long as they live, which may be longer than the module does.
  nb::set_leak_warnings(false);
  m.doc() = "The C++ core over arrays; the package's modules are its interface.";

  nb::enum_<Status>(m, "Status", nb::is_arithmetic(), "How a solve ended.")
      .value("OK", Status::ok, "solved")
      .value("NO_EQUILIBRIUM", Status::no_equilibrium, "loaded past the fold: the joint snaps through")
      .value("UNREACHABLE", Status::unreachable, "outside what the mechanism can bend to")
      .value("BOTH_SLACK", Status::both_slack, "neither tendon holds the joint")
      .value("NO_AUTHORITY", Status::no_authority, "no stroke of the acting motors gives the angle back")
      .value("OUT_OF_RANGE", Status::out_of_range, "handle angle beyond the handle's range")
      .value("NOT_FINITE", Status::not_finite, "NaN or infinite input");

  nb::enum_<JointType>(m, "JointType", "Joint mechanism.")
      .value("TENDON_GEAR", JointType::tendon_gear)
      .value("TENDON_PULLEY", JointType::tendon_pulley)
      .value("CONTINUUM", JointType::continuum);

  nb::class_<Spec>(m, "Spec", "One axis of an instrument, as numbers in SI units.")
      .def(
          "__init__",
          [](Spec* self, JointType type, const std::array<double, parameter_count>& parameters, double range) {
            new (self) Spec{type, parameters, range};
          },
          "joint_type"_a, "parameters"_a, "handle_range"_a);

  m.def(
      "parameters",
      [] {
        return std::vector<std::string>{"proximal_radius",     "distal_radius",   "handle_length",
                                        "end_effector_length", "given_stiffness", "tendon_modulus",
                                        "tendon_diameter",     "tendon_length",   "pretension",
                                        "backbone_rigidity",   "backbone_length"};
      },
      "Names of a spec's parameters, in their order.");
  m.def(
      "tendon_stiffness",
      [](const Spec& spec) { return std::visit([](const auto& axis) { return axis.stiffness; }, make_axis(spec)); },
      "spec"_a, "Stiffness of one tendon, N/m.");
  m.def(
      "unloaded_limit",
      [](const Spec& spec) {
        // How far the handle's range would bend the distal joint without a load, as a share of its limit.
        return std::visit(
            [](const auto& axis) {
              const double pull = axis.proximal.excursion_slope() * axis.proximal.coordinate(axis.handle_range);
              return pull / axis.distal.excursion_slope() / axis.distal.limit();
            },
            make_axis(spec));
      },
      "spec"_a, "Unloaded distal coordinate at the end of the handle's range, as a share of the joint's limit.");
  m.def("evaluate", &evaluate, "spec"_a, "operation"_a, "inputs"_a, "threads"_a,
        nb::sig("def evaluate(spec: Spec, operation: str, inputs: Sequence[NDArray[numpy.float64]], threads: int) -> "
                "tuple[list[NDArray[numpy.float64]], NDArray[numpy.uint8]]"),
        "Outputs of an operation and the status of every point.");
  m.def("gradient", &gradient, "spec"_a, "operation"_a, "inputs"_a, "variables"_a, "threads"_a,
        nb::sig("def gradient(spec: Spec, operation: str, inputs: Sequence[NDArray[numpy.float64]], variables: "
                "Sequence[int], threads: int) -> tuple[list[NDArray[numpy.float64]], NDArray[numpy.uint8]]"),
        "Derivatives of every output by parameters and inputs, variable first, and the status of every point.");
}

}  // namespace tenodesis::bindings

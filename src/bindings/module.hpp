#pragma once
// What the parts of the Python module share: types of arrays, lists of names, and the parts themselves, one source file
// each.

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <cstdint>
#include <memory>

namespace tenodesis::bindings {

namespace nb = nanobind;
using namespace nb::literals;

template <class T, std::size_t dimensions>
using Array = nb::ndarray<T, nb::ndim<dimensions>, nb::c_contig, nb::device::cpu>;
template <std::size_t dimensions>
using In = Array<const double, dimensions>;
template <std::size_t dimensions>
using Out = Array<double, dimensions>;
/// Of points or runs.
using Statuses = Array<unsigned char, 1>;

/// A new array of NumPy's, to be returned.
using NewRows = nb::ndarray<nb::numpy, double, nb::ndim<2>, nb::c_contig>;

inline NewRows new_rows(std::size_t rows, std::size_t columns) {
  auto memory = std::make_unique<double[]>(rows * columns);
  const nb::capsule owner(memory.get(), [](void* data) noexcept { delete[] static_cast<double*>(data); });
  return {memory.release(), {rows, columns}, owner};
}

template <class Names>
std::vector<std::string> list_of(const Names& names) {
  return {names.begin(), names.end()};
}

/// Raises ValueError unless the condition holds.
inline void require(bool condition, const char* otherwise) {
  if (!condition) throw nb::value_error(otherwise);
}

void bind_twin(nb::module_& m);
void bind_twin_gradient(nb::module_& m);
void bind_chain_twin(nb::module_& m);
void bind_control(nb::module_& m);
void bind_joint(nb::module_& m);
void bind_joint_control(nb::module_& m);
void bind_kinematics(nb::module_& m);
void bind_runtime(nb::module_& m);
void bind_serial(nb::module_& m);
void bind_similarity(nb::module_& m);
void bind_tendon(nb::module_& m);
void bind_tendon_chain(nb::module_& m);

}  // namespace tenodesis::bindings

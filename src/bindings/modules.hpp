#pragma once
// The parts of the Python module, one source file each.

#include <nanobind/nanobind.h>

namespace tenodesis::bindings {

void bind_twin(nanobind::module_& m);
void bind_twin_gradient(nanobind::module_& m);
void bind_control(nanobind::module_& m);
void bind_kinematics(nanobind::module_& m);
void bind_runtime(nanobind::module_& m);
void bind_serial(nanobind::module_& m);
void bind_similarity(nanobind::module_& m);
void bind_tendon(nanobind::module_& m);

}  // namespace tenodesis::bindings

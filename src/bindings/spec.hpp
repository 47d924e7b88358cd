#pragma once
// An instrument axis as Python hands it over: a joint type and a row of numbers.

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <variant>

#include "tenodesis/axis.hpp"

namespace tenodesis::bindings {

enum Parameter : std::size_t {
  proximal_radius,
  distal_radius,
  handle_length,
  end_effector_length,
  given_stiffness,  // NaN: follows from modulus, diameter and length
  tendon_modulus,
  tendon_diameter,
  tendon_length,
  pretension,
  backbone_rigidity,
  backbone_length,
  parameter_count,
};

inline constexpr std::array<const char*, parameter_count> parameter_names{
    "proximal_radius", "distal_radius", "handle_length", "end_effector_length", "given_stiffness", "tendon_modulus",
    "tendon_diameter", "tendon_length", "pretension",    "backbone_rigidity",   "backbone_length"};
static_assert(parameter_names.back() != nullptr, "every parameter has a name");

enum class JointType { tendon_gear, tendon_pulley, continuum };

struct Spec {
  JointType joint_type{};
  std::array<double, parameter_count> parameters{};
  double handle_range{};
};

template <class S>
using AnyAxis = std::variant<GearAxis<S>, PulleyAxis<S>, ContinuumAxis<S>>;

/// The axis a spec describes, in whatever number type its parameters come.
template <class S>
AnyAxis<S> make_axis(const Spec& spec, const std::array<S, parameter_count>& p) {
  const S stiffness = std::isnan(spec.parameters[given_stiffness])
                          ? tendon_stiffness(p[tendon_modulus], p[tendon_diameter], p[tendon_length])
                          : p[given_stiffness];
  const S range(spec.handle_range);
  switch (spec.joint_type) {
    case JointType::tendon_gear:
      return GearAxis<S>{{p[proximal_radius], p[handle_length]},
                         {p[distal_radius], p[end_effector_length]},
                         stiffness,
                         p[pretension],
                         range};
    case JointType::tendon_pulley:
      return PulleyAxis<S>{{p[proximal_radius], p[handle_length]},
                           {p[distal_radius], p[end_effector_length]},
                           stiffness,
                           p[pretension],
                           range};
    case JointType::continuum:
      break;
  }
  return ContinuumAxis<S>{{p[proximal_radius], p[handle_length]},
                          {p[distal_radius], p[end_effector_length], p[backbone_length], p[backbone_rigidity]},
                          stiffness,
                          p[pretension],
                          range};
}

inline AnyAxis<double> make_axis(const Spec& spec) { return make_axis(spec, spec.parameters); }

}  // namespace tenodesis::bindings

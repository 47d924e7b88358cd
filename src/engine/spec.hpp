#pragma once
// An axis of an instrument as it is given in arrays: a joint type and a row of parameters.

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <variant>

#include "tenodesis/axis.hpp"

namespace tenodesis::engine {

/// Parameters of an axis in SI units, in the order of a row; without a given stiffness (NaN), it follows from modulus,
/// diameter and length.
#define TENODESIS_SPEC_PARAMETERS(ROW)                                                                          \
  ROW(proximal_radius), ROW(distal_radius), ROW(handle_length), ROW(end_effector_length), ROW(given_stiffness), \
      ROW(tendon_modulus), ROW(tendon_diameter), ROW(tendon_length), ROW(pretension), ROW(backbone_rigidity),   \
      ROW(backbone_length)

#define TENODESIS_ROW(name) name
enum Parameter : std::size_t { TENODESIS_SPEC_PARAMETERS(TENODESIS_ROW) };
#undef TENODESIS_ROW
#define TENODESIS_ROW(name) #name
inline constexpr std::array parameter_names{TENODESIS_SPEC_PARAMETERS(TENODESIS_ROW)};
#undef TENODESIS_ROW
inline constexpr std::size_t parameter_count = parameter_names.size();

enum class JointType { tendon_gear, tendon_pulley, continuum };

/// Mechanism of the tip's joint.
constexpr Mechanism mechanism_of(JointType type) {
  if (type == JointType::tendon_gear) return Mechanism::gear;
  return type == JointType::tendon_pulley ? Mechanism::pulley : Mechanism::continuum;
}

struct Spec {
  JointType joint_type{};
  std::array<double, parameter_count> parameters{};
  double handle_range{};
};

template <class S>
using AnyAxis = std::variant<GearAxis<S>, PulleyAxis<S>, ContinuumAxis<S>>;

/// The axis that a spec describes, in the number type of its parameters.
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

}  // namespace tenodesis::engine

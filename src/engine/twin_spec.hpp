#pragma once
// A twin as it is given in arrays: an axis, a row of parameters, and the choices that are types in the core.

#include <array>
#include <cstddef>
#include <variant>

#include "spec.hpp"
#include "tenodesis/axis_twin.hpp"

namespace tenodesis::engine {

/// Parameters of a twin beside its axis, in SI units and the order of a row.
///
/// handle_length_share is that of the tendon between spool and handle joint, anchor_share that beyond a second vertex
/// of the tip's joint; the span ratios are the compliance of a joint's span over that of its length. tension_gain is
/// that of a reading over what a current stands for.
#define TENODESIS_TWIN_PARAMETERS(ROW)                                                                              \
  ROW(vertex_coefficient), ROW(sheath_coefficient), ROW(sheath_bend), ROW(sheath_bend_rate), ROW(viscous),          \
      ROW(constant), ROW(static_ratio), ROW(stribeck_speed), ROW(memory), ROW(handle_length_share),                 \
      ROW(stiffness_ratio), ROW(pretension_ratio), ROW(tip_inertia), ROW(tip_damping), ROW(output_stop),            \
      ROW(stop_stiffness), ROW(hand_stiffness), ROW(hand_damping), ROW(hand_inertia), ROW(spool_radius),            \
      ROW(spool_speed_limit), ROW(spool_acceleration_limit), ROW(drive_time_constant), ROW(backlash),               \
      ROW(rig_pulley_radius), ROW(encoder_noise), ROW(encoder_range), ROW(encoder_resolution),                      \
      ROW(handle_encoder_offset), ROW(output_encoder_offset), ROW(motor_encoder_resolution), ROW(load_cell_noise),  \
      ROW(load_cell_range), ROW(load_cell_resolution), ROW(agonist_load_cell_gain), ROW(antagonist_load_cell_gain), \
      ROW(agonist_load_cell_bias), ROW(antagonist_load_cell_bias), ROW(time_step), ROW(base_wrap),                  \
      ROW(handle_span_ratio), ROW(tip_span_ratio), ROW(anchor_share), ROW(load_index), ROW(reference_tension),      \
      ROW(vertex_radius_ratio), ROW(bending_loss), ROW(gear_efficiency), ROW(friction_torque), ROW(torque_ripple),  \
      ROW(ripple_rate), ROW(thermal_drift), ROW(thermal_time), ROW(tension_gain)

#define TENODESIS_ROW(name) name
enum TwinParameter : std::size_t { TENODESIS_TWIN_PARAMETERS(TENODESIS_ROW) };
#undef TENODESIS_ROW
#define TENODESIS_ROW(name) #name
inline constexpr std::array twin_parameter_names{TENODESIS_TWIN_PARAMETERS(TENODESIS_ROW)};
#undef TENODESIS_ROW
inline constexpr std::size_t twin_parameter_count = twin_parameter_names.size();

using TwinRow = std::array<double, twin_parameter_count>;

struct TwinSpec {
  Spec axis;
  bool speed_dependent{};    ///< the Stribeck law
  bool tension_dependent{};  ///< a power of the tension, or a tendon that is stiff in bending
  int sheath_contacts{1};
  int vertices_per_joint{1};
  int steps_per_sample{1};
  bool quasi_static{};
  bool currents{};  ///< in the place of load cells
  TwinRow row{};

  RouteContacts route() const { return {sheath_contacts, vertices_per_joint}; }
};

/// Whether twins of a spec can step in lanes (lane_job.hpp); others step one by one.
inline bool steps_in_lanes(const TwinSpec& spec) {
  return !spec.speed_dependent && !spec.tension_dependent && !spec.currents && spec.sheath_contacts == 1 &&
         spec.vertices_per_joint == 1;
}

inline constexpr int most_sheath_contacts = 32;
inline constexpr int most_vertices_per_joint = 2;
inline constexpr int most_contacts = RouteContacts{most_sheath_contacts, most_vertices_per_joint}.count();

/// Fills in the constants of a twin of an axis from its row; length: of a tendon, m.
template <class T, class A, class S = T::S>
void fill(T& twin, A axis, const TwinSpec& spec, const std::array<S, twin_parameter_count>& row, const S& length) {
  axis.stiffness = axis.stiffness * row[stiffness_ratio];
  axis.pretension = axis.pretension * row[pretension_ratio];
  RouteFriction<S> friction{
      row[vertex_coefficient], row[sheath_coefficient], row[sheath_bend], row[sheath_bend_rate], row[viscous],
      row[base_wrap]};
  if (spec.tension_dependent)
    friction.vertex = friction.vertex * exp((S(1) - row[load_index]) * log(row[vertex_radius_ratio]));
  set_axis(twin, axis, friction, spec.route());
  set_tip(twin, row[tip_inertia], row[tip_damping], row[output_stop], row[stop_stiffness]);
  set_rig(twin, row[rig_pulley_radius], axis.distal.rig_arm());
  twin.hand = {row[hand_stiffness], row[hand_damping], row[hand_inertia]};
  twin.drive = {row[spool_radius], row[spool_speed_limit], row[spool_acceleration_limit], row[drive_time_constant],
                row[backlash]};
  const auto encoder = [&](const S& offset) {
    return Sensor<S>{S(1),
                     offset,
                     row[encoder_noise],
                     -row[encoder_range] * S(0.5),
                     row[encoder_range] * S(0.5),
                     row[encoder_resolution]};
  };
  const auto load_cell = [&](const S& gain, const S& bias) {
    return Sensor<S>{
        gain, bias, row[load_cell_noise], -row[load_cell_range], row[load_cell_range], row[load_cell_resolution]};
  };
  const S turns(1e9);  // a motor's encoder has no end
  twin.handle_encoder = encoder(row[handle_encoder_offset]);
  twin.output_encoder = encoder(row[output_encoder_offset]);
  twin.load_cell[agonist] = load_cell(row[agonist_load_cell_gain] * row[tension_gain], row[agonist_load_cell_bias]);
  twin.load_cell[antagonist] =
      load_cell(row[antagonist_load_cell_gain] * row[tension_gain], row[antagonist_load_cell_bias]);
  twin.motor_encoder = {S(1), S(0), S(0), -turns, turns, row[motor_encoder_resolution]};
  twin.time_step = row[time_step];
  if (spec.currents) {
    const S sample = row[time_step] * S(spec.steps_per_sample);
    twin.current = {true,
                    row[gear_efficiency],
                    row[friction_torque] / row[spool_radius],
                    row[torque_ripple],
                    row[ripple_rate],
                    row[thermal_drift],
                    sample / (row[thermal_time] + sample)};
  }
  twin.steps_per_sample = spec.steps_per_sample;
  twin.quasi_static = spec.quasi_static;

  // Compliance by length, from the spool: the sheath in the handle, its joint, the stem, the tip's joint, the anchor.
  const int sheath = spec.sheath_contacts;
  const S in_handle = row[handle_length_share] / S(sheath + 1);
  const S at_handle = axis.proximal.tendon_span() / length * row[handle_span_ratio];
  const S at_tip = axis.distal.tendon_span() / length * row[tip_span_ratio];
  const S in_stem = S(1) - row[handle_length_share] - at_handle - at_tip - row[anchor_share];
  const auto stiffness = [&](const S& share) { return axis.stiffness / share; };
  for (auto& tendon : twin.tendon) {
    auto& segment = tendon.stiffness;
    for (int i = 0; i < sheath; ++i) segment[i] = stiffness(in_handle);
    if (spec.vertices_per_joint == 1) {
      segment[sheath] = stiffness(in_handle + at_handle);
      segment[sheath + 1] = stiffness(in_stem);
      segment[sheath + 2] = stiffness(at_tip);
    } else {
      segment[sheath] = stiffness(in_handle);
      segment[sheath + 1] = stiffness(at_handle);
      segment[sheath + 2] = stiffness(in_stem);
      segment[sheath + 3] = stiffness(at_tip);
      segment[sheath + 4] = stiffness(row[anchor_share]);
    }
  }
  if constexpr (requires { twin.law.kind; }) {
    using Kind = decltype(twin.law.kind);
    twin.law = {spec.tension_dependent ? Kind::capstan_power
                : spec.speed_dependent ? Kind::stribeck
                                       : Kind::capstan_with_constant,
                {row[constant]},
                {row[constant], row[static_ratio], row[stribeck_speed], row[memory]},
                {row[constant], row[load_index], row[reference_tension], row[bending_loss], axis.pretension * S(1e-3)}};
  } else {
    twin.law = {row[constant]};
  }
  twin.prepare();
}

/// Calls work(twin) with the twin that a spec describes, in the number type of its parameters.
template <class S, class Work>
auto with_twin(const TwinSpec& spec, const std::array<S, parameter_count>& parameters,
               const std::array<S, twin_parameter_count>& row, const Work& work) {
  const AnyAxis<S> any = make_axis(spec.axis, parameters);
  return std::visit(
      [&]<class A>(const A& axis) {
        const auto filled = [&]<class T>(T&& twin) {
          fill(twin, axis, spec, row, parameters[tendon_length]);
          return work(twin);
        };
        // Known layouts are the fastest; the rarer laws and routes make do with one that is not.
        if (!spec.speed_dependent && !spec.tension_dependent && spec.sheath_contacts == 1 &&
            spec.vertices_per_joint == 1)
          return filled(AxisTwin<A>{});
        return filled(Twin<TendonChain<S, 1, 2>, most_contacts, ChosenLaw<S>>{});
      },
      any);
}

/// The same in double precision.
template <class Work>
auto with_twin(const TwinSpec& spec, const Work& work) {
  return with_twin(spec, spec.axis.parameters, spec.row, work);
}

}  // namespace tenodesis::engine

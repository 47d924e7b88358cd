// The twin of joints and tendons moves a single joint as the twin did that was written for one, whatever it is made of,
// and as well where its layout is known.

#include <array>
#include <cmath>
#include <exception>

#include "claim.hpp"
#include "engine/twin_spec.hpp"
#include "one_joint_golden.hpp"
#include "tenodesis/twin_energy.hpp"

using namespace tenodesis;
using namespace tenodesis::engine;

namespace {

struct Case {
  JointType joint{};
  bool quasi_static{};
  bool speed_dependent{}, tension_dependent{};
  int sheath{1}, vertices{1};
  double hand{};
  bool currents{}, tissue{}, slack{}, radial{};
};

TwinSpec spec_of(const Case& of) {
  TwinSpec spec{};
  spec.axis.joint_type = of.joint;
  spec.axis.handle_range = 1.2;
  auto& p = spec.axis.parameters;
  p[proximal_radius] = 9e-3;
  p[distal_radius] = 4e-3;
  p[end_effector_length] = 0.05;
  p[given_stiffness] = std::nan("");
  p[tendon_modulus] = 6e10;
  p[tendon_diameter] = 0.5e-3;
  p[tendon_length] = 0.4;
  p[pretension] = 20;
  p[backbone_length] = 0.03;
  p[backbone_rigidity] = 1e-3;
  auto& r = spec.row;
  r[vertex_coefficient] = 0.15;
  r[sheath_coefficient] = 0.1;
  r[sheath_bend] = 0.4;
  r[sheath_bend_rate] = 0.3;
  r[viscous] = 2.0;
  r[constant] = 0.2;
  r[static_ratio] = 1.5;
  r[stribeck_speed] = 1e-3;
  r[memory] = 5e-3;
  r[base_wrap] = 0.1;
  r[load_index] = 0.8;
  r[reference_tension] = 10;
  r[vertex_radius_ratio] = 0.7;
  r[bending_loss] = 0.05;
  r[handle_length_share] = 0.2;
  r[handle_span_ratio] = 1.3;
  r[tip_span_ratio] = 0.8;
  r[anchor_share] = of.vertices == 2 ? 0.01 : 0;
  r[stiffness_ratio] = 0.9;
  r[pretension_ratio] = 1.1;
  r[tip_inertia] = 6e-5;
  r[tip_damping] = 2e-3;
  r[output_stop] = 1.3;
  r[stop_stiffness] = 10;
  r[hand_stiffness] = of.hand;
  r[hand_damping] = 0.05;
  r[hand_inertia] = 2e-3;
  r[spool_radius] = 5e-3;
  r[spool_speed_limit] = 20;
  r[spool_acceleration_limit] = 400;
  r[drive_time_constant] = 0.01;
  r[backlash] = 0.02;
  r[rig_pulley_radius] = 0.015;
  r[encoder_noise] = 1e-4;
  r[encoder_range] = 6.28;
  r[encoder_resolution] = 1e-5;
  r[handle_encoder_offset] = 0.01;
  r[output_encoder_offset] = -0.02;
  r[motor_encoder_resolution] = 1e-4;
  r[load_cell_noise] = 0.01;
  r[load_cell_range] = 400;
  r[load_cell_resolution] = 1e-3;
  r[agonist_load_cell_gain] = 1.02;
  r[antagonist_load_cell_gain] = 0.97;
  r[agonist_load_cell_bias] = 0.1;
  r[antagonist_load_cell_bias] = -0.2;
  r[time_step] = 5e-4;
  r[gear_efficiency] = 0.8;
  r[friction_torque] = 2e-3;
  r[torque_ripple] = 0.02;
  r[ripple_rate] = 30;
  r[thermal_drift] = 0.05;
  r[thermal_time] = 10;
  r[tension_gain] = of.currents ? 1.05 : 1;
  spec.speed_dependent = of.speed_dependent;
  spec.tension_dependent = of.tension_dependent;
  spec.sheath_contacts = of.sheath;
  spec.vertices_per_joint = of.vertices;
  spec.steps_per_sample = 2;
  spec.quasi_static = of.quasi_static;
  spec.currents = of.currents;
  return spec;
}

Command<double> command(const Case& of, int step) {
  const double t = step * 5e-4;
  const auto wave = [&](double rate, double phase) { return std::sin(6.283 * rate * t + phase) - std::sin(phase); };
  Command<double> to{};
  const double start = std::min(1.0, 10 * t);
  to.handle_angle = 0.25 * start * wave(1.5, 0.3);
  if (!of.slack || t > 0.35) to.force = 0.4 * start * wave(2.3, 1);
  if (of.radial && !of.slack) to.radial_force = 0.5 * start * wave(1.1, 2);
  if (t > 0.3 && !of.slack) to.weight = 1;
  to.spool_velocity[0] = t > 0.15 ? 0.3 : 0;
  to.spool_velocity[1] = t > 0.2 ? -0.2 : 0.1;
  to.sheath_bend = t > 0.1 ? 0.2 * wave(0.8, 0) : 0;
  if (of.slack) to.let_out[0] = to.let_out[1] = t > 0.1 && t < 0.5 ? 1.5e-3 : 0;
  if (!of.slack) to.let_out[1] = t > 0.3 ? 1e-4 : 0;
  if (of.tissue && t > 0.05) to.contact = {0.1, t < 0.4 ? 2000.0 : -2000.0, 5.0};
  if (t > 0.4) to.contact.angle = 0.0;
  return to;
}

template <class T>
void compare(const Case& of, const T& twin, const golden::Found* golden) {
  auto state = twin.rest(5);
  double residual = 0, friction = 0, balance = 0, moved = 0;
  double stored = stored_energy(twin, state);
  int steps = 0;
  for (; steps < 1200; ++steps) {
    const auto before = state;
    const Status found = twin.step(command_of<typename T::Command>(command(of, steps)), state);
    CLAIM(found == Status::ok);
    if (found != Status::ok) return;
    residual = std::fmax(residual, twin.residual(before, state));
    const auto energy = twin_energy(twin, before, state);
    friction += energy.friction;
    const double lost = energy.friction + energy.damping + energy.tissue;
    balance += energy.stored - stored - (energy.handle + energy.spools + energy.load - lost);
    moved += std::fabs(energy.handle) + std::fabs(energy.spools) + std::fabs(energy.load);
    stored = energy.stored;
    if (steps != 599 && steps != 1199) continue;
    // The planar twin ended its searches for the handle's angle and, where tendons go slack, for the tip's, within
    // 1e-11 rad, from which velocities differ.
    const bool searches = !of.quasi_static && (of.hand > 0 || of.slack);
    const auto& then = *golden++;
    const auto near = [](double a, double b, double by) { return std::fabs(a - b) < by; };
    CLAIM(near(state.angle[0], then.output_angle, searches ? 5e-8 : 1e-9));
    CLAIM(near(state.tendon[0].tension[0], then.tension, searches ? 1e-5 : 1e-7));
    CLAIM(near(state.tendon[1].tension[twin.tip_segment(1)], then.distal, searches ? 1e-5 : 1e-7));
    CLAIM(near(twin.handle_torque(state, 0), then.handle_torque, searches ? 5e-7 : 1e-8));
    CLAIM(near(friction, then.friction, searches ? 2e-7 : 1e-8));
  }
  CLAIM(residual < 1e-9);
  // A step lets things out, or brings tissue, without work.
  if (!of.slack && !of.tissue) CLAIM(std::fabs(balance) < 0.05 * moved);
}

void claim(const Case& of, const golden::Found* golden) {
  const TwinSpec spec = spec_of(of);
  with_twin(spec, [&](const auto& twin) {
    compare(of, twin, golden);
    return 0;
  });
  // Where the layout is known, it changes nothing but the time it takes.
  std::visit(
      [&](const auto& axis) {
        Twin<TendonChain<double, 1, 2>, most_contacts, ChosenLaw<double>> twin{};
        fill(twin, axis, spec, spec.row, spec.axis.parameters[tendon_length]);
        compare(of, twin, golden);
      },
      make_axis(spec.axis));
}

}  // namespace

int main() try {
  const auto* golden = golden::one_joint;
  for (const JointType joint : {JointType::tendon_gear, JointType::tendon_pulley, JointType::continuum})
    for (const bool quasi_static : {false, true}) {
      claim({.joint = joint, .quasi_static = quasi_static, .radial = true}, *golden++);
      claim({.joint = joint, .quasi_static = quasi_static, .speed_dependent = true}, *golden++);
      claim({.joint = joint, .quasi_static = quasi_static, .tension_dependent = true}, *golden++);
      claim({.joint = joint, .quasi_static = quasi_static, .vertices = 2}, *golden++);
      claim({.joint = joint, .quasi_static = quasi_static, .sheath = 3, .vertices = 2, .currents = true}, *golden++);
      claim({.joint = joint, .quasi_static = quasi_static, .hand = 8, .currents = true}, *golden++);
      claim({.joint = joint, .quasi_static = quasi_static, .tissue = true}, *golden++);
      claim({.joint = joint, .quasi_static = quasi_static, .hand = 8, .tissue = true, .radial = true}, *golden++);
      claim({.joint = joint, .quasi_static = quasi_static, .slack = true}, *golden++);
    }
  return claims::report();
} catch (const std::exception&) {
  return 1;
}

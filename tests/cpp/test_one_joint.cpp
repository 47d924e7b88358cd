// The twin of joints and tendons moves a single joint as the planar twin does, whatever it is made of.

#include <array>
#include <cmath>
#include <exception>

#include "claim.hpp"
#include "engine/twin_rows.hpp"
#include "engine/twin_spec.hpp"
#include "tenodesis/energy.hpp"
#include "tenodesis/wrist_energy.hpp"

using namespace tenodesis;
using namespace tenodesis::engine;

namespace {

template <Mechanism tip, Mechanism handle>
using Known = Wrist<double, 1, 2, planar_layout<1>(tip, handle)>;

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

// The same twin as joints and tendons.
template <class W, class P>
auto general(const P& planar, const TwinSpec& spec) {
  constexpr int most = [] {
    if constexpr (W::known)
      return W::layout.most_contacts;
    else
      return 8;
  }();
  WristTwin<W, most, typename P::Law> t{};
  const bool gears = spec.axis.joint_type == JointType::tendon_gear;
  const bool bends = spec.axis.joint_type == JointType::continuum;
  auto& joint = t.wrist.joint[0];
  joint.mechanism = gears ? Mechanism::gear : bends ? Mechanism::continuum : Mechanism::pulley;
  joint.axis = {0, 1, 0};
  const auto& parameters = spec.axis.parameters;
  joint.chord = gears ? 2 * parameters[distal_radius] : bends ? parameters[backbone_length] : 0;
  joint.length = t.reach[0] = parameters[end_effector_length];
  joint.stiffness = planar.axis.distal.passive_stiffness();
  joint.share = 1;
  t.wrist.handles = 1;
  t.wrist.handle[0] = gears ? Mechanism::gear : Mechanism::pulley;
  t.law = planar.law;
  t.link[0] = {0, 0, {planar.body.inertia, planar.body.inertia, 0}};
  t.damping[0] = planar.body.damping;
  t.stop[0] = planar.body.stop;
  t.stop_stiffness[0] = planar.body.stop_stiffness;
  t.viscous = planar.friction.viscous;
  t.sheath_bend_rate = planar.friction.sheath_bend_rate;
  const double per_vertex = 1.0 / spec.vertices_per_joint;
  const double coefficient = planar.friction.vertex * planar.friction.vertex_factor;
  const double wrap = planar.friction.base_wrap * per_vertex;
  for (int m = 0; m < 2; ++m) {
    const double side = m == 0 ? 1 : -1;
    t.wrist.arm[m][0] = side * planar.axis.distal.excursion_slope();
    t.wrist.handle_arm[m][0] = side * planar.axis.proximal.excursion_slope();
    t.wrist.stiffness[m] = planar.axis.stiffness;
    t.wrist.pretension[m] = planar.axis.pretension;
    t.wrist.motor[m] = true;
    auto& tendon = t.tendon[m];
    tendon.rest_tension = planar.tendon.rest_tension;
    if constexpr (!W::known) tendon.stiffness.length = planar.tendon.contacts() + 1;
    for (int i = 0; i <= planar.tendon.contacts(); ++i) tendon.stiffness[i] = planar.tendon.stiffness[i];
    int n = 0;
    for (int k = 0; k < spec.sheath_contacts; ++k) {
      const double share = 1.0 / spec.sheath_contacts;
      t.passage[m][n++] = {-1, planar.friction.sheath, planar.friction.sheath_bend * share, share, 0};
    }
    for (int k = 0; k < spec.vertices_per_joint; ++k) {
      const bool draws = k == spec.vertices_per_joint - 1;
      t.passage[m][n++] = {1, coefficient, wrap, per_vertex, draws ? t.wrist.handle_arm[m][0] : 0};
    }
    for (int k = 0; k < spec.vertices_per_joint; ++k)
      t.passage[m][n++] = {0, coefficient, wrap, per_vertex, k == 0 ? -t.wrist.arm[m][0] : 0};
    t.load_cell[m] = planar.sensors.load_cell[m];
  }
  t.hand = planar.hand;
  t.drive = planar.drive;
  t.rig.force.x = -planar.rig.force(1);
  t.handle_encoder = planar.sensors.handle_encoder;
  t.output_encoder = planar.sensors.output_encoder;
  t.motor_encoder = planar.sensors.motor_encoder;
  t.current = planar.sensors.current;
  t.time_step = planar.time_step;
  t.steps_per_sample = planar.steps_per_sample;
  t.quasi_static = planar.quasi_static;
  t.prepare();
  return t;
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

struct Worst {
  double angle{}, force{}, moment{}, reading{}, energy{};
};

template <class W, class P>
void compare(const Case& of, const TwinSpec& spec, const P& planar) {
  const auto joined = general<W>(planar, spec);
  auto a = planar.rest(5);
  auto b = joined.rest(5);
  Worst worst{};
  const auto note = [](double& to, double x, double y) { to = std::fmax(to, std::fabs(x - y)); };
  int steps = 0;
  double residual = 0;
  for (; steps < 1200; ++steps) {
    const Command<double> given = command(of, steps);
    typename decltype(joined)::Command same{};
    same.handle_angle[0] = given.handle_angle;
    for (int m = 0; m < 2; ++m) same.spool_velocity[m] = given.spool_velocity[m], same.let_out[m] = given.let_out[m];
    same.load.wrench.force = {-given.force, 0, given.radial_force};
    same.weight = given.weight;
    same.sheath_bend = given.sheath_bend;
    same.contact[0] = given.contact;
    const auto a_before = a;
    const auto b_before = b;
    const Status one = planar.step(given, a), other = joined.step(same, b);
    CLAIM(one == other);
    if (one != Status::ok || other != Status::ok) break;
    note(worst.angle, a.output_angle, b.angle[0]);
    note(worst.angle, a.handle_angle, b.angle[1]);
    for (int m = 0; m < 2; ++m) {
      note(worst.force, a.tendon[m].tension[0], b.tendon[m].tension[0]);
      note(worst.force, a.tendon[m].tension[planar.tip_segment()], b.tendon[m].tension[joined.tip_segment(m)]);
      note(worst.reading, a.reading.tension[m], b.measured_tension[m]);
      note(worst.angle, a.drive[m].spool, b.drive[m].spool);
    }
    note(worst.force, a.contact_force, b.contact_force[0]);
    note(worst.moment, a.contact_moment, b.contact_moment[0]);
    note(worst.moment, a.handle_moment, b.handle_moment[0]);
    note(worst.moment, planar.handle_torque(given, a), joined.handle_torque(b, 0));
    note(worst.reading, a.reading.handle_angle, b.measured_handle[0]);
    note(worst.reading, a.reading.output_angle, b.measured_angle[0]);
    const auto ea = account(planar, a_before, a, a_before.load, a.load);
    const auto eb = wrist_energy(joined, b_before, b);
    for (const auto& [x, y] : {std::pair{ea.stored, eb.stored},
                               {ea.handle, eb.handle},
                               {ea.spools, eb.spools},
                               {ea.load, eb.load},
                               {ea.friction, eb.friction},
                               {ea.damping, eb.damping},
                               {ea.tissue, eb.tissue},
                               {ea.friction_at_end, eb.friction_at_end}})
      note(worst.energy, x, y);
    residual = std::fmax(residual, joined.residual(b_before, b));
  }
  CLAIM(steps == 1200);
  // The planar twin ends its searches for the handle's angle and, where tendons go slack, for the tip's, within 1e-11
  // rad, from which velocities differ.
  const bool searches = !of.quasi_static && (of.hand > 0 || of.slack);
  CLAIM(worst.angle < (searches ? 5e-8 : 1e-9));
  CLAIM(worst.force < (searches ? 1e-5 : 1e-7));
  CLAIM(worst.moment < (searches ? 5e-7 : 1e-8));
  CLAIM(worst.energy < (searches ? 2e-8 : 1e-9));
  // At most a step of a converter.
  CLAIM(worst.reading < 1.1e-3);
  CLAIM(residual < 1e-9);
}

void claim(const Case& of) {
  const TwinSpec spec = spec_of(of);
  with_twin(spec, [&]<class P>(const P& planar) {
    compare<Wrist<double, 1, 2>>(of, spec, planar);
    if constexpr (requires { P::Rows::vertices_per_joint; })
      if (spec.contacts() == 3 && !of.tension_dependent) {
        using enum Mechanism;
        if (of.joint == JointType::tendon_gear) compare<Known<gear, gear>>(of, spec, planar);
        if (of.joint == JointType::tendon_pulley) compare<Known<pulley, pulley>>(of, spec, planar);
        if (of.joint == JointType::continuum) compare<Known<continuum, pulley>>(of, spec, planar);
      }
    return 0;
  });
}

}  // namespace

int main() try {
  for (const JointType joint : {JointType::tendon_gear, JointType::tendon_pulley, JointType::continuum})
    for (const bool quasi_static : {false, true}) {
      claim({.joint = joint, .quasi_static = quasi_static, .radial = true});
      claim({.joint = joint, .quasi_static = quasi_static, .speed_dependent = true});
      claim({.joint = joint, .quasi_static = quasi_static, .tension_dependent = true});
      claim({.joint = joint, .quasi_static = quasi_static, .vertices = 2});
      claim({.joint = joint, .quasi_static = quasi_static, .sheath = 3, .vertices = 2, .currents = true});
      claim({.joint = joint, .quasi_static = quasi_static, .hand = 8, .currents = true});
      claim({.joint = joint, .quasi_static = quasi_static, .tissue = true});
      claim({.joint = joint, .quasi_static = quasi_static, .hand = 8, .tissue = true, .radial = true});
      claim({.joint = joint, .quasi_static = quasi_static, .slack = true});
    }
  return claims::report();
} catch (const std::exception&) {
  return 1;
}

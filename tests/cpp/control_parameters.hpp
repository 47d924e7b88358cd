#pragma once
// Parameters of a controller that suit the paper's instruments and others of their size.

#define TENODESIS_REAL double
#include <algorithm>

#include "claim.hpp"
#include "instruments.hpp"
#include "tenodesis/parameters.hpp"
#include "tenodesis/tenodesis.h"

using namespace tenodesis;

constexpr double degree = pi / 180;
constexpr double dt = 5e-4;               // s
constexpr double spool_radius = 5e-3;     // m
constexpr double counts = 2 * pi / 4096;  // of an encoder, rad
constexpr std::uint64_t tick = 500'000;   // ns

template <class A>
tenodesis_axis_parameters axis_parameters(const A& axis) {
  const double stretch = axis.pretension / axis.stiffness;
  tenodesis_axis_parameters p{};
  p.proximal_radius = axis.proximal.radius;
  p.distal_radius = axis.distal.radius;
  p.handle_length = axis.proximal.length;
  p.end_effector_length = axis.distal.length;
  if constexpr (requires { axis.distal.backbone_length; }) {
    p.backbone_length = axis.distal.backbone_length;
    p.backbone_rigidity = axis.distal.backbone_rigidity;
  }
  p.handle_range = axis.handle_range;
  p.output_stop = 107 * degree;
  p.stiffness = axis.stiffness;
  p.pretension = axis.pretension;
  p.share_sheath = 0.08, p.share_handle = 0.11, p.share_stem = 0.795, p.share_tip = 0.015;
  p.vertex_coefficient = p.sheath_coefficient = 0.1;
  p.sheath_bend = 10 * degree;
  p.spool_radius = spool_radius;
  p.drive_time_constant = 0.01;
  p.tip_frequency = 30;
  p.hand_play = 0.7 * counts;
  p.sheath_play = 3e-6;
  p.play = std::max(0.4 * axis.proximal.radius, spool_radius) * counts;
  p.friction_scale_std = 0.4, p.reference_std = 5e-6, p.compliance_std = 0.25;
  p.slack_tension = 0.3;
  p.gain = 12, p.position_gain = 4;
  p.dead_band = 0.1 * degree;
  p.tendon_speed = 0.05;
  p.common_stroke = 0.4 * stretch;
  p.least_tension = 0.15 * axis.pretension;
  p.tension_limit = 80;
  p.homing_speed = 5e-3, p.homing_stroke = 0.03, p.homing_overshoot = 0.15;
  p.tremor_delay = 0.02, p.tremor_gain = 1.05, p.assistance = 1;
  p.homing_tolerance = 4e-3;
  p.homing_jog = std::max(4 * spool_radius * counts, 0.8 * degree * axis.distal.radius);
  p.homing_travel = 1.6 * degree * axis.distal.radius;
  p.homing_offset = axis.stiffness * axis.distal.radius * degree;
  p.homing_notice = 0.15, p.homing_efficiency = 1;
  p.mean_band = 0.45, p.load_cell_range = 200, p.handle_noise = 6 * counts, p.spool_noise = 2.5 * counts;
  p.spool_jump = {60, 1.2 * dt};
  const auto set = [&](Fault fault, double threshold, double persistence) {
    p.limit[static_cast<int>(fault)] = {threshold, persistence};
  };
  set(Fault::tendon_break, 0.08 * axis.pretension, 0.01);
  set(Fault::tendon_slack, 0.04 * axis.pretension, 2);
  set(Fault::over_tension, 100, 0.003);
  set(Fault::load_cell_stuck, 0.009, 0.04);
  set(Fault::load_cell_range, 2, 0.005);
  set(Fault::load_cell_drift, 0.1 * axis.pretension, 0.5);
  set(Fault::encoder_dropout, 0.1, 0.005);
  set(Fault::encoder_jump, 30, 1.2 * dt);
  set(Fault::spool_slip, 0.12 * axis.pretension, 0.01);
  set(Fault::motor_not_following, 0.008, 0.005);
  set(Fault::tick_late, 0.025, 0);
  set(Fault::stroke_unexplained, degree, 1);
  set(Fault::rope_length, 4 * degree, 0.5);
  return p;
}

template <class A>
tenodesis_parameters parameters(const A& axis, ControlLaw law, Actuation actuation, int axes = 1) {
  tenodesis_parameters p{};
  p.size = sizeof p;
  p.version = TENODESIS_VERSION;
  p.axes = static_cast<std::uint32_t>(axes);
  p.observer = TENODESIS_OBSERVER_FRICTION;
  p.law = static_cast<std::uint32_t>(law);
  p.actuation = static_cast<std::uint32_t>(actuation);
  p.homed = 1;
  p.period = dt;
  p.speed_limit = 20, p.acceleration_limit = 400, p.engage_time = 0.2, p.tension_limit = 100;
  p.hold_time = 0.5, p.neutral_speed = 0.2, p.relief = 0.2;
  for (int n = 0; n < axes; ++n) p.axis[n] = axis_parameters(axis);
  return p;
}

template <class A>
using As = A::template Rebind<float>;

template <class A, int most_axes = 1>
Controller<A, most_axes> controller(const tenodesis_parameters& p) {
  Controller<A, most_axes> made{};
  CLAIM(configure(p, made));
  return made;
}

constexpr ControlLaw every_law[] = {ControlLaw::off, ControlLaw::paper, ControlLaw::paper_feedback, ControlLaw::exact,
                                    ControlLaw::robust};
constexpr Actuation every_actuation[] = {Actuation::agonist, Actuation::differential};

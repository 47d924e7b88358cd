#pragma once
// The parts of the twin beside its axis and its tendons, and its commands, readings and state.

#include "tenodesis/bands.hpp"
#include "tenodesis/current.hpp"
#include "tenodesis/drive.hpp"
#include "tenodesis/sensor.hpp"
#include "tenodesis/tissue.hpp"

namespace tenodesis {

/// The tip as a rigid body that rotates by the output angle.
template <class S>
struct Body {
  S inertia{};         ///< kg m^2
  S damping{};         ///< N m s/rad
  S stop{};            ///< output angle at the mechanical stop, rad
  S stop_stiffness{};  ///< N m/rad
};

/// The hand on the handle; without stiffness the handle angle is prescribed.
template <class S>
struct Hand {
  S stiffness{};  ///< N m/rad
  S damping{};    ///< N m s/rad
  S inertia{};    ///< of hand and handle, kg m^2
};

/// The load rig of Fig. 13: weights on cables turn a bar that pushes the tip sideways through a sliding link.
template <class S>
struct Rig {
  S pulley_radius{};  ///< lever arm of the cables, m
  S arm{};            ///< from the bar's pivot to the tip, m

  S force(const S& weight) const { return weight * (pulley_radius / arm); }
};

template <class S>
struct Sensors {
  Sensor<S> handle_encoder{};
  Sensor<S> output_encoder{};
  Sensor<S> load_cell[2]{};
  Sensor<S> motor_encoder{};
  CurrentSense<S> current{};
};

/// Input of one axis in a step; all values are those at the step's end.
template <class S>
struct Command {
  S handle_angle{};       ///< of the handle, or wanted by the hand, rad
  S force{};              ///< tangential at the tip, N
  S radial_force{};       ///< N
  S weight{};             ///< difference of the weights on the load rig's two cables, N
  S spool_velocity[2]{};  ///< rad/s
  S sheath_bend{};        ///< added to the sheath's own, rad
  S let_out[2]{};         ///< tendon length that has come off the spool, or is torn, m
  Contact<S> contact{};

  bool finite() const {
    return all_finite(value_of(handle_angle), value_of(force), value_of(radial_force), value_of(weight),
                      value_of(spool_velocity[0]), value_of(spool_velocity[1]), value_of(sheath_bend),
                      value_of(let_out[0]), value_of(let_out[1]), value_of(contact.angle), value_of(contact.stiffness),
                      value_of(contact.damping));
  }
};

/// Readings of the sensors of one axis.
template <class S>
struct Reading {
  S handle_angle{};
  S output_angle{};
  S tension[2]{};
  S spool_angle[2]{};
};

/// Joints that a tendon passes after the sheath: the handle's and the tip's.
inline constexpr int tendon_joints = 2;

template <class S, class Rows>
struct TwinState {
  S output_angle{};
  S output_velocity{};
  S handle_angle{};
  S handle_velocity{};
  S handle_moment{};      ///< of the tendons on the handle's joint, against positive handle angles, N m
  S tip_moment{};         ///< of everything on the tip except its inertia and tissue, N m
  S contact_force{};      ///< of tissue on the tip, mean of the last step, against flexion, N
  S contact_moment{};     ///< its mean moment, in flexion, N m
  S net_handle_torque{};  ///< of hand and tendons, N m
  S handle_wanted{};      ///< by the last command, rad
  TipLoad<S> load{};      ///< by the last command
  S sheath_bend{};        ///< added to the sheath's own, by the last command, rad
  S let_out[2]{};         ///< by the last command, m
  TendonState<S, Rows> tendon[2]{};
  Rows::template PerContact<S> slip_speed[2]{};  ///< for laws that depend on it, m/s
  DriveState<S> drive[2]{};
  CurrentState<S> current[2]{};
  NoiseOf<typename SideBySide<S>::Word> noise{};
  Reading<S> reading{};
  int until_sample{};
  SideBySide<S>::Count sweeps{};  ///< of the last step
  S residual_in_parts{-1};        ///< largest of the last step's parts; -1: it was not divided
};

/// How the torque on the handle falls with its angle in a step, N m/rad, on tendons of that stiffness; time_step: s, 0
/// leaves inertia and damping out.
template <class S>
S handle_stiffness(const Hand<S>& hand, const S& time_step, const S& tendons) {
  const S held = hand.stiffness + tendons;
  if (!any(time_step > S(0))) return held;
  const S rate = S(2) / time_step;
  return (held + hand.damping * rate) * S(0.5) + hand.inertia * rate / time_step;
}

/// Torque on the handle that is left when a step has moved it to an angle (rad), against one that the hand wants, N m;
/// it goes into the next state, with the handle's velocity.
template <class S, class State>
S unbalanced_handle(const Hand<S>& hand, const S& time_step, const S& angle, const S& wanted, const State& before,
                    State& next) {
  const S turned = angle - before.handle_angle;
  next.net_handle_torque = hand.stiffness * (wanted - angle) - next.handle_moment;
  if (!any(time_step > S(0))) return next.net_handle_torque;
  const S rate = S(2) / time_step;
  next.handle_velocity = rate * turned - before.handle_velocity;
  next.net_handle_torque = next.net_handle_torque - hand.damping * next.handle_velocity;
  return (next.net_handle_torque + before.net_handle_torque) * S(0.5) -
         hand.inertia * rate / time_step * (turned - before.handle_velocity * time_step);
}

/// Readings in a state, from which their noise is drawn.
template <class S, class State>
Reading<S> readings(const Sensors<S>& sensors, const Drive<S>& drive, State& state) {
  Reading<S> reading{};
  reading.handle_angle = sensors.handle_encoder.read(state.handle_angle, state.noise);
  reading.output_angle = sensors.output_encoder.read(state.output_angle, state.noise);
  for (int i = 0; i < 2; ++i) {
    S tension = state.tendon[i].tension[0];
    if (sensors.current.on) tension = sense(sensors.current, tension, state.drive[i].angle, state.current[i]);
    reading.tension[i] = sensors.load_cell[i].read(tension, state.noise);
    reading.spool_angle[i] = sensors.motor_encoder.read(state.drive[i].angle - drive.backlash * S(0.5), state.noise);
  }
  return reading;
}

}  // namespace tenodesis

#pragma once
// The parts of the twin beside its axis and its tendons, and its commands, readings and state.

#include "tenodesis/drive.hpp"
#include "tenodesis/sensor.hpp"
#include "tenodesis/statics.hpp"
#include "tenodesis/tendon.hpp"

namespace tenodesis {

/// Friction coefficients and bends, from which a friction law makes bands.
template <class S>
struct Friction {
  S vertex{};            ///< friction coefficient at the joints' vertices
  S sheath{};            ///< friction coefficient in the sheath
  S sheath_bend{};       ///< total bend of the sheath, rad
  S sheath_bend_rate{};  ///< bend added per radian of |handle angle|: the sheath bends as the hand moves
  S viscous{};           ///< of each joint and of the sheath, N s/m
  S base_wrap{};         ///< wrap angle of a joint when it is straight, rad
  S vertex_factor{1};    ///< of the coefficient at the vertices, for their radius
};

/// The tip as a rigid body that rotates by the output angle.
template <class S>
struct Body {
  S inertia{};         ///< kg m^2
  S damping{};         ///< N m s/rad
  S stop{};            ///< output angle at the mechanical stop, rad
  S stop_stiffness{};  ///< N m/rad
};

/// Tissue at the tip: beyond a place it pushes back against the tip's path square to the end-effector, and never pulls.
template <class S>
struct Contact {
  S angle{};      ///< output angle at which the tip touches it, rad
  S stiffness{};  ///< N/m; positive: it lies in flexion from there, negative: in extension; 0: there is none
  S damping{};    ///< N s/m

  constexpr bool present() const { return stiffness != S(0); }
  friend constexpr bool operator==(const Contact&, const Contact&) = default;
};

/// What acts on the tip.
template <class S>
struct TipLoad : Load<S> {
  Contact<S> contact{};
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
  Noise noise{};
  Reading<S> reading{};
  int until_sample{};
  int sweeps{};             ///< of the last step
  S residual_in_parts{-1};  ///< largest of the last step's parts; -1: it was not divided
};

}  // namespace tenodesis

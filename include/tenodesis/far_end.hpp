#pragma once
// Angle and torque at the far end of a tendon transmission, from those at its near end.
//
// The tendon is cut into equal pieces with a contact before each, as in tendon.hpp. The near torque is followed from
// contact to contact as the friction observer does (observer.hpp): a contact that slips has the tension beyond it on
// the edge of its friction band, a contact that sticks holds it inside. Slip is the near end's motion less the stretch
// up to the contact. The far end's joint and the gearbox of a drive are contacts with a band of their own.
//
// Angles are in rad and torques in N m at the near end's shaft, positive as the tendon is pulled; tensions are torques
// by their radius.

#include "tenodesis/friction.hpp"
#include "tenodesis/observer.hpp"

namespace tenodesis {

inline constexpr int far_end_pieces = 8;

/// Motor and gearbox, by which a current gives the torque of the near end.
template <class S>
struct CurrentDrive {
  S torque_constant{};  ///< at the near end's shaft, N m/A; zero: the near signal is a torque
  S friction{};         ///< of motor and gearbox in the middle of the travel, N m
  S friction_slope{};   ///< its growth along the travel, N m/rad
  S load_friction{};    ///< share of the motor's torque that the gearbox loses to friction
  S viscous{};          ///< N m s/rad
  S heat_loss{};        ///< share of the torque constant that is lost per A^2 of mean square current, 1/A^2
  S heat_time{60};      ///< over which that mean is taken, s
  S speed_time{0.1};    ///< over which the speed is taken, s
  S play{};             ///< motion by which the gearbox counts as slipping, rad
};

/// Constants of the transmission.
template <class S>
struct Transmission {
  CurrentDrive<S> drive{};
  S offset{};           ///< near torque without load, N m
  S ratio{1};           ///< far angle per near angle
  S torque_ratio{1};    ///< far torque per torque of the tendon
  S near_compliance{};  ///< before the first contact, rad/(N m)
  S compliance{};       ///< of the tendon, along all its contacts
  S far_compliance{};   ///< behind the last contact
  S near_stiffness{};   ///< of what springs back at the near end, N m/rad
  S far_stiffness{};    ///< of what springs back at the far end
  S near_friction{};    ///< load-independent, at the near end's bearing, N m
  S exponent{};         ///< friction coefficient times wrap angle of the tendon
  S pretension{};       ///< N m
  S joint_friction{};   ///< load-independent, at the far end's joint, N m
  S play{};             ///< motion by which a contact counts as slipping, rad
};

/// Estimate of the far end; hidden: how far friction may hide it where contacts have not slipped since they reversed.
template <class S>
struct FarEnd {
  S angle{};         ///< rad, without the zero of its sensor
  S torque{};        ///< N m
  S hidden_angle{};  ///< of the opposite sign to hidden_torque: more tension stretches more
  S hidden_torque{};
  S near_torque{};  ///< of the near end's shaft
};

/// Torque beyond a contact with a band: on the edge of the direction in which it slips, held where it sticks.
template <class S>
struct HeldTorque {
  S torque{};
  S hidden{};
  Slip<S> slip{};

  /// low, high: edges of the band, of slip toward the near end and toward the far end.
  void update(const S& low, const S& high, const S& position, const S& play, bool started) {
    if (!started) {
      slip = {position, S(0), S(0)};
      torque = (low + high) * S(0.5);
    } else {
      slip = follow(slip, position, play);
      const S edge = slip.indicator > S(0) ? low : high;
      torque = clamp(torque + (edge - torque) * abs(slip.indicator), low, high);
    }
    hidden = (high - low) * S(0.5) * (S(1) - smaller(abs(slip.run), S(1)));
  }
};

template <class S>
struct FarEndMemory {
  HeldTorque<S> gearbox{};
  HeldTorque<S> contact[far_end_pieces + 1]{};
  HeldTorque<S> joint{};
  S position{};  ///< rad
  S speed{};     ///< rad/s
  S heat{};      ///< mean square current, A^2
  bool started{};
};

/// Torque at the near end's shaft, from the motor's current.
template <class S>
S shaft_torque(const CurrentDrive<S>& drive, const S& current, const S& angle, const S& dt, FarEndMemory<S>& memory) {
  if (!memory.started) memory.position = angle;
  memory.speed = memory.speed + ((angle - memory.position) / dt - memory.speed) * (dt / (drive.speed_time + dt));
  memory.position = angle;
  memory.heat = memory.heat + (current * current - memory.heat) * (dt / (drive.heat_time + dt));
  const S constant = drive.torque_constant * (S(1) - drive.heat_loss * memory.heat);
  const S motor = constant * current - drive.viscous * memory.speed;
  const S friction = larger(drive.friction + drive.friction_slope * angle + drive.load_friction * abs(motor), S(0));
  memory.gearbox.update(motor - friction, motor + friction, angle, drive.play, memory.started);
  return memory.gearbox.torque;
}

/// The far end after a sample of the near end: its angle from the middle of the travel, and its torque, or the motor's
/// current if the transmission has a drive.
template <class S>
FarEnd<S> follow_far_end(const Transmission<S>& given, const S& near_angle, const S& near_signal, const S& dt,
                         FarEndMemory<S>& memory) {
  const bool by_current = given.drive.torque_constant > S(0);
  const S shaft = by_current ? shaft_torque(given.drive, near_signal, near_angle, dt, memory) : near_signal;
  const S start = given.ratio * near_angle - given.near_compliance * shaft;
  const S near = shaft - given.offset - given.near_stiffness * start + given.pretension;
  const S piece = S(1) / S(far_end_pieces);
  const Band<S> each = Capstan<S>::band(given.exponent * piece, S(0));

  S position = start;
  S stretch(0), tension(near), hidden(by_current ? memory.gearbox.hidden : S(0)), hidden_stretch(0);
  for (int j = 0; j <= far_end_pieces; ++j) {
    const Band<S> band = j == 0 ? Band<S>{S(1), given.near_friction, S(0)} : each;
    auto& contact = memory.contact[j];
    const S low = larger((tension - band.constant) / band.ratio, S(0));
    const S high = larger(tension * band.ratio + band.constant, S(0));
    contact.update(low, high, position, given.play, memory.started);
    tension = contact.torque;
    hidden = hidden / band.ratio + contact.hidden;
    // Half a piece lies before the first contact of the tendon and behind the last.
    const S share = given.compliance * piece * (j == 0 || j == far_end_pieces ? S(0.5) : S(1));
    stretch = stretch + share * (tension - given.pretension);
    hidden_stretch = hidden_stretch + share * hidden;
    position = start - stretch;
  }
  FarEnd<S> far{};
  far.near_torque = shaft;
  far.angle = position - given.far_compliance * (tension - given.pretension);
  const S moved = tension - given.pretension - given.far_stiffness * far.angle;
  memory.joint.update(moved - given.joint_friction, moved + given.joint_friction, far.angle, given.play,
                      memory.started);
  far.torque = given.torque_ratio * memory.joint.torque;
  far.hidden_torque = given.torque_ratio * (hidden + memory.joint.hidden);
  far.hidden_angle = -(hidden_stretch + given.far_compliance * hidden);
  memory.started = true;
  return far;
}

}  // namespace tenodesis

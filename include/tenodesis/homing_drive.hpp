#pragma once
// Tensions by motor currents while homing: a drive's friction is taken out of a reading by the edge that it is on.
//
// Where the observer takes that friction for one of the tendon's contacts, homing judges tensions of tendons that may
// be slack, and small changes of them.

#include "tenodesis/scalar.hpp"

namespace tenodesis {

/// Share of a drive's friction that may be other than the parameters say.
inline constexpr double unknown_drive_friction = 0.15;

template <class S>
struct HomingDriveState {
  int edge{};   ///< of its friction, 1: winding, -1: letting out, 0: unknown
  S turned{};   ///< stroke furthest on that edge, m
  S tension{};  ///< last known, N
  bool started{};
  bool turning{};  ///< has been commanded to leave its edge, and not yet moved on
};

/// A drive whose current measures its tendon's tension; of load cells it has no friction, and changes nothing.
template <class S>
struct HomingDrive {
  S efficiency{1};
  S friction{};  ///< that does not grow with the tension, N
  S gain{1};     ///< of a reading over the motor's pull
  S play{};      ///< stroke over which friction turns from one edge to the other, m; 0 with load cells

  bool has_friction() const { return efficiency < S(1) || friction > S(0); }

  /// What may be unknown of the friction, as a difference of tension between its edges, N.
  S uncertainty(const S& tension) const {
    return S(unknown_drive_friction) * ((S(1) / efficiency - efficiency) * abs(tension) + S(2) * friction);
  }

  /// Tension by a reading, N, at the stroke of the spool, m; while friction turns, the last one that was known. sent:
  /// the drive's velocity as commanded, of which less than an encoder's step turns friction.
  S tension(const S& reading, const S& stroke, const S& sent, HomingDriveState<S>& state) const {
    if (!has_friction()) return reading;
    if (!state.started) state = {0, stroke, reading, true, false};
    const S beyond = stroke - state.turned, ahead = beyond * S(state.edge);
    state.turning = sent * S(state.edge) < S(0) || (state.turning && ahead <= S(0));
    const bool onward = state.edge != 0 && ahead >= S(0) && !state.turning;
    if (onward || abs(beyond) > play) {
      if (!onward) state.edge = beyond > S(0) ? 1 : -1;
      state.turned = stroke;
      state.turning = false;
      const S pull = reading / gain;
      state.tension = state.edge > 0 ? (pull - friction) * efficiency : (pull + friction) / efficiency;
    } else if (state.edge == 0) {
      state.tension = reading;
    }
    return state.tension;
  }
};

}  // namespace tenodesis

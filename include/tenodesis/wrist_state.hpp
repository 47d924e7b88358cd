#pragma once
// Commands and state of a wrist's twin.

#include "tenodesis/twin_parts.hpp"
#include "tenodesis/wrist.hpp"
#include "tenodesis/wrist_route.hpp"

namespace tenodesis {

/// An object between the jaws, as a spring that is pressed below an opening (m, by the arms of the grip).
template <class S>
struct Held {
  S opening{};
  S stiffness{};  ///< N/m; 0: there is none
  S damping{};    ///< N s/m
};

template <class W>
struct WristCommand {
  using S = W::S;
  S handle_angle[W::joints]{};     ///< of the handle's joints, or wanted by the hand, rad
  S spool_velocity[W::tendons]{};  ///< rad/s
  WristLoad<S> load{};
  Held<S> held{};

  bool finite() const {
    bool all = all_finite(load.wrench.force.x, load.wrench.force.y, load.wrench.force.z, load.wrench.moment.x,
                          load.wrench.moment.y, load.wrench.moment.z, load.grip) &&
               all_finite(held.opening, held.stiffness, held.damping);
    for (const S& angle : handle_angle) all = all && is_finite(angle);
    for (const S& velocity : spool_velocity) all = all && is_finite(velocity);
    return all;
  }
};

/// Angles of all joints, of the tip first, then of the handle, with rates and moments.
template <class W, int most_contacts>
struct WristState {
  using S = W::S;
  static constexpr int N = W::joints, M = W::tendons;

  S angle[2 * N]{};       ///< rad
  S velocity[2 * N]{};    ///< rad/s
  S moment[2 * N]{};      ///< of everything except inertia and what is gripped, N m
  S band_angle[2 * N]{};  ///< that the last step's friction is of, rad
  S handle_moment[N]{};   ///< of the tendons on the handle's joints, against positive angles, N m
  S grip_force{};         ///< on what is gripped, mean of the last step, N
  WristCommand<W> command{};
  TendonState<S, BoundedContacts<most_contacts>> tendon[M]{};
  DriveState<S> drive[M]{};
  Noise noise{};
  S measured_handle[N]{};
  S measured_angle[N]{};
  S measured_tension[M]{};
  S measured_spool[M]{};
  int until_sample{};
  int sweeps{};
};

}  // namespace tenodesis

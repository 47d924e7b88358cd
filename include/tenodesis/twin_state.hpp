#pragma once
// Commands and state of a chain's twin.

#include "tenodesis/current.hpp"
#include "tenodesis/drive.hpp"
#include "tenodesis/route.hpp"
#include "tenodesis/sensor.hpp"
#include "tenodesis/tendon_chain.hpp"
#include "tenodesis/tissue.hpp"

namespace tenodesis {

/// An object between the jaws, as a spring that is pressed below an opening (m, by the arms of the grip).
template <class S>
struct Held {
  S opening{};
  S stiffness{};  ///< N/m; 0: there is none
  S damping{};    ///< N s/m
};

/// The path of the tip about one joint while the others stay straight, as tissue.hpp asks for it.
template <class S>
struct TipPath {
  Mechanism mechanism{};
  S chord{};  ///< of the straight joint, m
  S reach{};  ///< from its far end to the tip, m

  S coordinate(const S& angle) const { return coordinate_at(mechanism, angle); }
  S tip_path(const S& angle, const S& x) const {
    return about([&](const auto& joint) { return joint.tip_path(angle, x); });
  }
  S tangential_arm(const S& x) const {
    return about([&](const auto& joint) { return joint.tangential_arm(x); });
  }

 private:
  template <class Ask>
  S about(const Ask& ask) const {
    if (mechanism == Mechanism::gear) return ask(TendonGear<S>{chord * S(0.5), reach});
    if (mechanism == Mechanism::pulley) return ask(TendonPulley<S>{S(0), reach});
    return ask(TendonContinuum<S>{S(0), reach, chord, S(0)});
  }
};

template <class W>
struct TwinCommand {
  using S = W::S;
  S handle_angle[W::joints]{};     ///< of the handle's joints, or wanted by the hand, rad
  S spool_velocity[W::tendons]{};  ///< rad/s
  ChainLoad<S> load{};
  Held<S> held{};
  S weight{};                       ///< on the load rig, N
  S sheath_bend{};                  ///< added to that of every tendon's sheath, rad
  S let_out[W::tendons]{};          ///< tendon length that has come off the spool, or is torn, m
  Contact<S> contact[W::joints]{};  ///< tissue across the tip's path about each joint
  S spool_tension[W::tendons]{};  ///< that a drive holds whatever its spool does for it, N; 0: it follows its velocity

  bool finite() const {
    // The difference of infinities, and of NaN, is no number, nor is what it is added to.
    ValueOf<S> none(0);
    const auto add = [&](const auto&... v) { ((none += value_of(v) - value_of(v)), ...); };
    const Wrench<S>& wrench = load.wrench;
    add(wrench.force.x, wrench.force.y, wrench.force.z, wrench.moment.x, wrench.moment.y, wrench.moment.z, load.grip);
    add(held.opening, held.stiffness, held.damping, weight, sheath_bend);
    for (const S& angle : handle_angle) add(angle);
    for (const S& velocity : spool_velocity) add(velocity);
    for (const S& length : let_out) add(length);
    for (const S& tension : spool_tension) add(tension);
    for (const auto& tissue : contact) add(tissue.angle, tissue.stiffness, tissue.damping);
    return none == ValueOf<S>(0);
  }
};

/// What a friction law remembers of every tendon's contacts, m/s; nothing where it does not depend on the slip's speed.
template <class Slips, int M, bool depends_on_speed>
struct SlipSpeeds {};
template <class Slips, int M>
struct SlipSpeeds<Slips, M, true> {
  Slips of[M]{};
};

/// Angles of all joints, of the tip first, then of the handle, with rates and moments.
template <class W, int most_contacts, class Law>
// What belongs together stands together, although lanes leave room between.
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding)
struct TwinState {
  using S = W::S;
  using Rows = BoundedContacts<most_contacts, W::known>;
  static constexpr int N = W::joints, M = W::tendons;

  S angle[2 * N]{};       ///< rad
  S velocity[2 * N]{};    ///< rad/s
  S moment[2 * N]{};      ///< of everything except inertia, tissue and what is gripped, N m
  S band_angle[2 * N]{};  ///< that the last step's friction is of, rad
  S handle_moment[N]{};   ///< of the tendons on the handle's joints, against positive angles, N m
  S grip_force{};         ///< on what is gripped, mean of the last step, N
  S contact_force[N]{};   ///< of tissue on the tip about each joint, mean of the last step, against its angle, N
  S contact_moment[N]{};  ///< its mean moment, N m
  TwinCommand<W> command{};
  TendonState<S, Rows> tendon[M]{};
  SlipSpeeds<typename Rows::template PerContact<S>, M, Law::depends_on_speed> slip_speed{};
  DriveState<S> drive[M]{};
  Row<CurrentState<S>, M> current{};
  NoiseOf<typename SideBySide<S>::Word> noise{};
  S measured_handle[N]{};
  S measured_angle[N]{};
  S measured_tension[M]{};
  S measured_spool[M]{};
  int until_sample{};
  SideBySide<S>::Count sweeps{};
  bool swings{};            ///< whether the last step was of a swing that steps do not follow; not of known layouts
  S residual_in_parts{-1};  ///< largest of the last step's parts; -1: it was not divided
};

}  // namespace tenodesis

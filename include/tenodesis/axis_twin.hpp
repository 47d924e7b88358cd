#pragma once
// The twin of one axis of axis.hpp, as joints and tendons: its geometry, routes, commands and readings.
//
// A tendon runs spool - load cell - sheath - handle joint - stem - tip joint - anchor. A joint of one vertex is one
// contact with its total wrap angle; the length that its bending draws lies on the far side from the stem, so that the
// stem's tension is on the held side whichever joint is moved. A joint of two vertices is two contacts with half of the
// angle each, and the length that its bending draws is that of the span between them.

#include "tenodesis/axis.hpp"
#include "tenodesis/twin.hpp"

namespace tenodesis {

/// The joints and tendons of an axis A, with one contact in the sheath and at each joint.
template <class A>
using AxisChain = TendonChain<typename A::Scalar, 1, 2, planar_layout<1>(A::tip_mechanism)>;
template <class A, class Law = CapstanWithConstant<typename A::Scalar>>
using AxisTwin = Twin<AxisChain<A>, AxisChain<A>::layout.most_contacts, Law>;

/// Friction along a tendon's route: sheath, handle joint, tip joint.
template <class S>
struct RouteFriction {
  S vertex{};            ///< friction coefficient at the joints' vertices
  S sheath{};            ///< friction coefficient in the sheath
  S sheath_bend{};       ///< total bend of the sheath, rad
  S sheath_bend_rate{};  ///< bend added per radian of |handle angle|: the sheath bends as the hand moves
  S viscous{};           ///< of each joint and of the sheath, N s/m
  S base_wrap{};         ///< wrap angle of a joint when it is straight, rad
};

/// Contacts of an axis's tendons.
struct RouteContacts {
  int sheath{1};
  int vertices{1};  ///< of each joint

  constexpr int count() const { return sheath + 2 * vertices; }
};

/// Input of an axis in a step; all values are those at the step's end.
template <class S>
struct Command {
  S handle_angle{};       ///< of the handle, or wanted by the hand, rad
  S force{};              ///< tangential at the tip, against flexion, N
  S radial_force{};       ///< outward along the end-effector, N
  S weight{};             ///< difference of the weights on the load rig's two cables, N
  S spool_velocity[2]{};  ///< rad/s
  S sheath_bend{};        ///< added to the sheath's own, rad
  S let_out[2]{};         ///< tendon length that has come off the spool, or is torn, m
  Contact<S> contact{};
  S spool_tension[2]{};  ///< that a drive holds whatever its spool does for it, N; 0: it follows its velocity
};

/// Readings of the sensors of an axis.
template <class S>
struct Reading {
  S handle_angle{};
  S output_angle{};
  S tension[2]{};
  S spool_angle[2]{};
};

/// Sets joints, tendons and routes; stiffness of the tendons' segments is set apart.
template <class T, class A, class S = T::S>
void set_axis(T& twin, const A& axis, const RouteFriction<S>& friction, const RouteContacts& route = {}) {
  auto& chain = twin.chain;
  chain.joint[0] = {.mechanism = A::tip_mechanism,
                    .axis = {S(0), S(1), S(0)},
                    .chord = axis.distal.chord(S(0)),
                    .length = axis.distal.length,
                    .stiffness = axis.distal.passive_stiffness(),
                    .share = S(1)};
  chain.handles = 1;
  chain.handle[0] = A::handle_mechanism;
  twin.reach[0] = axis.distal.length;
  twin.handle_range[0] = axis.handle_range;
  twin.viscous = friction.viscous;
  twin.sheath_bend_rate = friction.sheath_bend_rate;
  const S in_sheath = S(1) / S(route.sheath);
  const S per_vertex = S(1) / S(route.vertices);
  const S wrap = friction.base_wrap * per_vertex;
  for (int m = 0; m < 2; ++m) {
    const S side(m == agonist ? 1 : -1);
    chain.arm[m][0] = side * axis.distal.excursion_slope();
    chain.handle_arm[m][0] = side * axis.proximal.excursion_slope();
    chain.stiffness[m] = axis.stiffness;
    chain.pretension[m] = axis.pretension;
    chain.motor[m] = true;
    auto& tendon = twin.tendon[m];
    tendon.rest_tension = axis.pretension;
    if constexpr (!T::known) tendon.stiffness.length = route.count() + 1;
    auto* at = twin.passage[m];
    for (int k = 0; k < route.sheath; ++k)
      *at++ = {-1, friction.sheath, friction.sheath_bend * in_sheath, in_sheath, S(0)};
    for (int k = 0; k < route.vertices; ++k)
      *at++ = {1, friction.vertex, wrap, per_vertex, k == route.vertices - 1 ? chain.handle_arm[m][0] : S(0)};
    for (int k = 0; k < route.vertices; ++k)
      *at++ = {0, friction.vertex, wrap, per_vertex, k == 0 ? -chain.arm[m][0] : S(0)};
  }
}

/// The tip as a rigid body that rotates by the output angle: inertia (kg m^2), damping (N m s/rad), stop (rad) and its
/// stiffness (N m/rad).
template <class T, class S = T::S>
void set_tip(T& twin, const S& inertia, const S& damping, const S& stop, const S& stop_stiffness) {
  twin.link[0] = {S(0), S(0), {inertia, inertia, S(0)}};
  twin.damping[0] = damping;
  twin.stop_low[0] = -stop;
  twin.stop_high[0] = stop;
  twin.stop_stiffness[0] = stop_stiffness;
}

/// The load rig of Fig. 13: weights on cables turn a bar that pushes the tip sideways through a sliding link; radius:
/// lever arm of the cables, arm: from the bar's pivot to the tip, m.
template <class T, class S = T::S>
void set_rig(T& twin, const S& radius, const S& arm) {
  twin.rig.force.x = -(radius / arm);
}

/// An axis's command as that of its twin, To.
template <class To, class S>
constexpr To command_of(const Command<S>& axis) {
  To command{};
  command.handle_angle[0] = axis.handle_angle;
  command.load.wrench.force = {-axis.force, S(0), axis.radial_force};
  command.weight = axis.weight;
  command.sheath_bend = axis.sheath_bend;
  for (int m = 0; m < 2; ++m) {
    command.spool_velocity[m] = axis.spool_velocity[m];
    command.let_out[m] = axis.let_out[m];
    command.spool_tension[m] = axis.spool_tension[m];
  }
  command.contact[0] = axis.contact;
  return command;
}

template <class State, class S = State::S>
constexpr Reading<S> reading_of(const State& state) {
  return {state.measured_handle[0],
          state.measured_angle[0],
          {state.measured_tension[0], state.measured_tension[1]},
          {state.measured_spool[0], state.measured_spool[1]}};
}

}  // namespace tenodesis

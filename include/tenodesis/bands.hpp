#pragma once
// Friction along a tendon's route: sheath, handle joint, tip joint.

#include "tenodesis/friction.hpp"
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

/// Bands of a tendon's contacts, with the slip speed (m/s) of each and the tensions (N) in its segments.
template <class T>
T::Bands bands(const T& twin, const typename T::S& handle_angle, const typename T::S& tip_angle,
               const typename T::S& more_bend, const typename T::Rows::template PerContact<typename T::S>& slip_speed,
               const typename T::Rows::template PerSegment<typename T::S>& tension) {
  using S = T::S;
  const auto& law = twin.law;
  const Friction<S>& friction = twin.friction;
  const int n = twin.tendon.contacts();
  const int vertices = twin.vertices();
  const int sheath = twin.sheath_contacts();
  const S bend = larger(friction.sheath_bend + friction.sheath_bend_rate * abs(handle_angle) + more_bend, S(0));
  const S per_vertex = S(1) / S(vertices);
  const S wraps[2] = {(twin.axis.proximal.wrap_angle(handle_angle) + friction.base_wrap) * per_vertex,
                      (twin.axis.distal.wrap_angle(tip_angle) + friction.base_wrap) * per_vertex};
  const S exponents[3] = {friction.sheath * bend / S(sheath), friction.vertex * wraps[0], friction.vertex * wraps[1]};
  const auto place = [&](int j) { return j < sheath ? 0 : j < sheath + vertices ? 1 : 2; };
  typename T::Bands band{};
  if constexpr (T::Law::depends_on_tension) {
    for (int j = 0; j < n; ++j) {
      // The held side is the slacker one.
      const S held = smaller(tension[j], tension[j + 1]);
      const int at = place(j);
      band[j] = law.band(at == 0 ? exponents[0] : friction.vertex_factor * exponents[at], held);
      if (at > 0) band[j] = law.bend(wraps[at - 1], held, band[j]);
    }
  } else if constexpr (T::Law::depends_on_speed) {
    for (int j = 0; j < n; ++j) band[j] = law.band(exponents[place(j)], slip_speed[j]);
  } else {
    const Band<S> places[3] = {law.band(exponents[0], S(0)), law.band(exponents[1], S(0)),
                               law.band(exponents[2], S(0))};
    for (int j = 0; j < n; ++j) band[j] = places[place(j)];
  }
  for (int j = 0; j < n; ++j) {
    // The contacts of the sheath, and those of a joint, share its constant and viscous friction.
    const S share = place(j) == 0 ? S(1) / S(sheath) : per_vertex;
    if constexpr (T::Law::depends_on_tension)
      band[j].constant = band[j].constant - law.constant * (S(1) - share);
    else
      band[j].constant = band[j].constant * share;
    band[j].drag = friction.viscous * twin.per_second() * share + least_drag<ValueOf<S>> * twin.axis.stiffness;
  }
  return band;
}

}  // namespace tenodesis

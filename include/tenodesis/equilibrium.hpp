#pragma once
// Equilibrium of one distal joint between two elastic tendons under load.
//
// The branch is the one that grows out of the unloaded position. In the joint's own coordinate the tendons' tension
// difference is piecewise linear and a gear's demand is convex, so Newton's iteration from the unloaded position runs
// monotonically toward the nearest root and cannot pass it; a slope that turns before the residual does is the fold
// beyond which there is no equilibrium.

#include "tenodesis/axis.hpp"

namespace tenodesis {

enum class Status : unsigned char {
  ok,
  no_equilibrium,  ///< loaded past the fold: the joint snaps through
  unreachable,     ///< outside what the mechanism can bend to
  both_slack,      ///< neither tendon holds the joint
  no_authority,    ///< no stroke of the acting motors gives the angle back
  out_of_range,    ///< handle angle beyond the handle's range
  not_finite,      ///< NaN or infinite input
};

/// Tendon length wound in by the motors, m.
template <class S>
struct Stroke {
  S agonist{};
  S antagonist{};
};

/// Tendon tensions, N.
template <class S>
struct Tensions {
  S agonist{};
  S antagonist{};

  constexpr S difference() const { return agonist - antagonist; }
};

/// The two tendons as the distal joint meets them at a held handle; neither pushes (eqs. 3-8).
template <class S>
struct TendonPair {
  S agonist{};     ///< agonist tension at coordinate zero, were it able to push, N
  S antagonist{};  ///< antagonist tension likewise, N
  S rate{};        ///< tension per unit of the coordinate, N

  template <class A>
  static TendonPair at_handle(const A& axis, const S& handle_angle, const Stroke<S>& wound) {
    const S pull = axis.proximal.excursion_slope() * axis.proximal.coordinate(handle_angle);
    return {axis.pretension + axis.stiffness * (pull + wound.agonist),
            axis.pretension - axis.stiffness * (pull - wound.antagonist),
            axis.stiffness * axis.distal.excursion_slope()};
  }

  constexpr Tensions<S> tensions(const S& x) const {
    return {larger(agonist - rate * x, S(0)), larger(antagonist + rate * x, S(0))};
  }

  // Without a spring at the joint, at least one tendon counts: between two slack ones, the next to hold is the one that
  // the load moves toward.
  constexpr S difference_slope(const S& x, bool sprung) const {
    const int taut = int(agonist - rate * x >= S(0)) + int(antagonist + rate * x >= S(0));
    return taut == 2 ? S(-2) * rate : (taut == 0 && sprung ? S(0) : -rate);
  }

  constexpr bool loose() const { return agonist + antagonist < S(0); }
};

/// Moment balance at one coordinate (eq. 1), in weighted tension: residual, its slope, and Newton's correction.
template <class S>
struct Balance {
  S residual{};
  S slope{};
  S correction{};
};

template <class J, class S>
Balance<S> balance(const J& joint, const TendonPair<S>& pair, const Load<S>& load, const S& x) {
  const Demand<S> demand = joint.demand(x, load);
  const S residual = pair.tensions(x).difference() * demand.weight - demand.value;
  const S slope = pair.difference_slope(x, joint.passive_stiffness() > S(0)) * demand.weight - demand.slope;
  return {residual, slope, residual / slope};
}

/// Coordinate at which the tendons and the joint's own spring balance without a load.
///
/// Where both tendons pull, they balance between the two places at which either alone would; loose ones leave the
/// joint to its spring. Without a branch, so that a loop over it becomes vector instructions.
template <class J, class S>
S unloaded_coordinate(const J& joint, const TendonPair<S>& pair) {
  const S alone = pair.rate + joint.passive_stiffness() / joint.excursion_slope();
  const S on_agonist = pair.agonist / alone;
  const S on_antagonist = -pair.antagonist / alone;
  const S together = (pair.agonist - pair.antagonist) / (alone + pair.rate);
  const S free = pair.loose() ? S(0) : together;
  return smaller(larger(free, smaller(on_agonist, on_antagonist)), larger(on_agonist, on_antagonist));
}

template <class S>
struct Equilibrium {
  S coordinate{};
  Status status{Status::ok};
  int iterations{};
};

/// Correction below which Newton's iteration has arrived: the one after is of the order of its square.
template <Real S>
inline constexpr S settled = sizeof(S) == 4 ? S(1e-5) : S(1e-11);

inline constexpr int most_iterations = 64;

namespace detail {

// Root between x0, where the residual has the sign of direction, and x1, where it has not: Newton kept inside by
// halving.
template <class J, Real S>
Equilibrium<S> solve_between(const J& joint, const TendonPair<S>& pair, const Load<S>& load, S x0, S x1, S direction,
                             int spent) {
  S x = (x0 + x1) * S(0.5);
  for (int n = 0; n < most_iterations; ++n) {
    const Balance<S> at = balance(joint, pair, load, x);
    const S newton = x - at.correction;
    if (abs(at.correction) <= settled<S>) return {newton, Status::ok, spent + n + 1};
    (at.residual * direction > S(0) ? x0 : x1) = x;
    const bool inside = (newton - x0) * (newton - x1) < S(0);
    x = inside ? newton : (x0 + x1) * S(0.5);
  }
  return {x, Status::ok, spent + most_iterations};
}

// The first sign change on the way to the joint's limit, for demands whose shape promises nothing.
template <class J, Real S>
Equilibrium<S> solve_by_search(const J& joint, const TendonPair<S>& pair, const Load<S>& load, S start, S direction,
                               int spent) {
  // Just short of the limit itself, where a gear's demand is without bound.
  const S end = direction * joint.limit() * (S(1) - settled<S>);
  const S stride = (end - start) / S(most_iterations);
  for (int n = 1; n <= most_iterations; ++n) {
    const S x = start + stride * S(n);
    if (balance(joint, pair, load, x).residual * direction <= S(0))
      return solve_between(joint, pair, load, x - stride, x, direction, spent + n);
  }
  return {start, Status::no_equilibrium, spent + most_iterations};
}

}  // namespace detail

/// Equilibrium coordinate on the branch that grows out of the unloaded position; at most 3 * most_iterations balances.
template <class J, Real S>
Equilibrium<S> solve(const J& joint, const TendonPair<S>& pair, const Load<S>& load) {
  if (!is_finite(pair.agonist + pair.antagonist + load.force + load.radial_force)) return {{}, Status::not_finite, 0};
  S start = unloaded_coordinate(joint, pair);
  if (!(abs(start) < joint.limit())) return {start, Status::unreachable, 0};

  S direction = balance(joint, pair, load, start).residual;
  direction = direction > S(0) ? S(1) : S(direction < S(0) ? -1 : 0);
  if (pair.loose() && !(joint.passive_stiffness() > S(0))) {
    // Between two slack tendons the load moves the joint freely until one of them holds it.
    start = S(0.5) * (pair.agonist - pair.antagonist) / pair.rate;
    direction = -joint.demand(start, load).value;
    if (direction == S(0)) return {start, Status::both_slack, 0};
    direction = direction > S(0) ? S(1) : S(-1);
    start = direction < S(0) ? pair.agonist / pair.rate : -pair.antagonist / pair.rate;
    if (!(abs(start) < joint.limit())) return {start, Status::unreachable, 0};
  }
  if (direction == S(0)) return {start, Status::ok, 0};

  S x = start;
  S before = start;
  int n = 1;
  for (; n <= most_iterations; ++n) {
    const Balance<S> at = balance(joint, pair, load, x);
    if (at.slope < S(0) && abs(at.correction) <= settled<S>) return {x - at.correction, Status::ok, n};
    if (at.residual * direction < S(0)) return detail::solve_between(joint, pair, load, before, x, direction, n);
    const S next = x - at.correction;
    if (!(at.slope < S(0)) || !(abs(next) < joint.limit())) break;
    before = x;
    x = next;
  }
  if (joint.convex(load)) return {x, Status::no_equilibrium, n};
  return detail::solve_by_search(joint, pair, load, start, direction, n);
}

/// The same with derivatives: solved in plain numbers, then one Newton step in dual ones, which is exact by the
/// implicit function theorem.
template <class J, class S>
  requires(!Real<S>)
Equilibrium<S> solve(const J& joint, const TendonPair<S>& pair, const Load<S>& load) {
  using V = ValueOf<S>;
  const TendonPair<V> pair_value{value_of(pair.agonist), value_of(pair.antagonist), value_of(pair.rate)};
  const Load<V> load_value{value_of(load.force), value_of(load.radial_force)};
  const Equilibrium<V> found = solve(joint.values(), pair_value, load_value);
  const S x(found.coordinate);
  if (found.status != Status::ok) return {x, found.status, found.iterations};
  return {x - balance(joint, pair, load, x).correction, found.status, found.iterations};
}

}  // namespace tenodesis

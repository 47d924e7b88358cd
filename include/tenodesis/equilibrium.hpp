#pragma once
// Equilibrium of one distal joint between two elastic tendons under load.
//
// The solution is on the branch that starts at the unloaded position. In the joint's own coordinate the tendons'
// tension difference is piecewise linear and a gear's demand is convex, so Newton's iteration from the unloaded
// position converges monotonically to the nearest root and cannot pass it; a slope that changes its sign before the
// residual does marks the fold, beyond which there is no equilibrium. Demands of another shape are followed from zero
// load.

#include "tenodesis/axis.hpp"

namespace tenodesis {

enum class Status : unsigned char {
  ok,
  no_equilibrium,  ///< loaded past the fold: the joint snaps through
  unreachable,     ///< outside the mechanism's range
  both_slack,      ///< neither tendon holds the joint
  no_authority,    ///< no stroke of the acting motors restores the angle
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

/// The two tendons as seen by the distal joint at a held handle; neither can push (eqs. 3-8).
template <class S>
struct TendonPair {
  S agonist{};     ///< agonist tension at coordinate zero; negative where it would have to push, N
  S antagonist{};  ///< antagonist tension likewise, N
  S rate{};        ///< tension per unit of the coordinate, N

  template <class A>
  static TendonPair at_handle(const A& axis, const S& handle_angle, const Stroke<S>& wound) {
    return at_excursion(axis, handle_excursion(axis, handle_angle), wound);
  }

  /// The same where the handle draws a length, m.
  template <class A>
  static TendonPair at_excursion(const A& axis, const S& length, const Stroke<S>& wound) {
    return {axis.pretension + axis.stiffness * (length + wound.agonist),
            axis.pretension - axis.stiffness * (length - wound.antagonist),
            axis.stiffness * axis.distal.excursion_slope()};
  }

  constexpr Tensions<S> tensions(const S& x) const {
    return {larger(agonist - rate * x, S(0)), larger(antagonist + rate * x, S(0))};
  }

  // Where both tendons are slack, the load tightens one of them next. Only a joint with a spring can rest between two
  // slack tendons.
  constexpr S difference_slope(const S& x, bool sprung) const {
    const S first = agonist - rate * x;
    const S second = antagonist + rate * x;
    const S slack = sprung && first < S(0) && second < S(0) ? S(0) : -rate;
    return first > S(0) && second > S(0) ? S(-2) * rate : slack;
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
/// Two tight tendons balance between the two places at which either alone would; with loose tendons only the joint's
/// spring acts. Without a branch, so that a loop over it becomes vector instructions.
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

/// Correction below which Newton's iteration has converged: the next is of the order of its square.
template <Real S>
inline constexpr S settled = sizeof(S) == 4 ? S(1e-5) : S(1e-11);

inline constexpr int most_iterations = 64;

/// Bound on the number of evaluations of the balance in one solve.
inline constexpr int most_balances = 8 * most_iterations;

namespace detail {

// Largest coordinate tried: just short of the limit itself, where a gear's demand is unbounded.
template <class J>
auto reachable(const J& joint) {
  using S = decltype(joint.limit());
  return joint.limit() * (S(1) - settled<S>);
}

// Root between x0, where the residual has the sign of direction, and x1, where it has not: Newton's iteration, kept
// inside by bisection.
template <class J, Real S>
Equilibrium<S> solve_between(const J& joint, const TendonPair<S>& pair, const Load<S>& load, S x0, S x1, S direction,
                             int spent) {
  S x = (x0 + x1) * S(0.5);
  for (int n = 1; n <= most_iterations; ++n) {
    const Balance<S> at = balance(joint, pair, load, x);
    const S newton = x - at.correction;
    if (abs(at.correction) <= settled<S>) return {newton, Status::ok, spent + n};
    (at.residual * direction > S(0) ? x0 : x1) = x;
    const bool inside = (newton - x0) * (newton - x1) < S(0);
    x = inside ? newton : (x0 + x1) * S(0.5);
  }
  return {x, abs(x1 - x0) <= settled<S> ? Status::ok : Status::no_equilibrium, spent + most_iterations};
}

// The share of a load that tendons and spring hold at x. A load that pushes back by itself is held whatever its share.
template <class J, Real S>
S held_share(const J& joint, const TendonPair<S>& pair, const Load<S>& load, const S& x) {
  const S unloaded = balance(joint, pair, Load<S>{}, x).residual;
  const S share = unloaded / (unloaded - balance(joint, pair, load, x).residual);
  return share < S(0) ? std::numeric_limits<S>::max() : share;
}

// Follows the branch from zero load, for demands of any shape: from the unloaded position the share of the load that is
// held grows, to 1 at the root, or to a maximum below 1, which is the fold.
template <class J, Real S>
Equilibrium<S> solve_by_following(const J& joint, const TendonPair<S>& pair, const Load<S>& load, S start,
                                  S direction) {
  const S end = direction * reachable(joint);
  const S stride = (end - start) / S(most_iterations);
  S share(0);
  for (int n = 1; n <= most_iterations; ++n) {
    const S x = start + stride * S(n);
    const S next = held_share(joint, pair, load, x);
    if (next >= S(1)) return solve_between(joint, pair, load, x - stride, x, direction, 2 * n);
    if (!(next > share)) {
      // It has passed its maximum within the last two strides: ternary search decides whether the maximum reaches 1.
      S low = n > 1 ? x - stride - stride : start;
      S high = x;
      const S first = low;
      for (int k = 1; k <= most_iterations; ++k) {
        const S a = low + (high - low) * S(1.0 / 3);
        const S b = high - (high - low) * S(1.0 / 3);
        const S at_a = held_share(joint, pair, load, a);
        const S at_b = held_share(joint, pair, load, b);
        if (at_a >= S(1) || at_b >= S(1))
          return solve_between(joint, pair, load, first, at_a >= S(1) ? a : b, direction, 2 * n + 4 * k);
        (at_a < at_b ? low : high) = at_a < at_b ? a : b;
      }
      return {x, Status::no_equilibrium, 2 * n + 4 * most_iterations};
    }
    share = next;
  }
  return {end, joint.folds() ? Status::no_equilibrium : Status::unreachable, 2 * most_iterations};
}

// With both tendons slack, the load moves the joint to the end of the gap between them.
template <class J, Real S>
Equilibrium<S> end_of_gap(const J& joint, const TendonPair<S>& pair, const Load<S>& load) {
  const S ends[2] = {pair.agonist / pair.rate, -pair.antagonist / pair.rate};
  const S bound = reachable(joint);
  S pushes[2];
  for (int k = 0; k < 2; ++k) pushes[k] = -joint.demand(larger(-bound, smaller(ends[k], bound)), load).value;
  // A load that changes its direction within the gap holds the joint nowhere.
  if (!(pushes[0] * pushes[1] > S(0))) return {S(0), Status::both_slack, 0};
  const S end = pushes[0] < S(0) ? ends[0] : ends[1];
  return {end, abs(end) < joint.limit() ? Status::ok : Status::unreachable, 0};
}

}  // namespace detail

/// Equilibrium coordinate on the branch that starts at the unloaded position.
template <class J, Real S>
Equilibrium<S> solve(const J& joint, const TendonPair<S>& pair, const Load<S>& load) {
  if (!all_finite(pair.agonist, pair.antagonist, pair.rate, load.force, load.radial_force))
    return {{}, Status::not_finite, 0};
  S start = unloaded_coordinate(joint, pair);
  if (pair.loose() && !(joint.passive_stiffness() > S(0))) {
    const Equilibrium<S> end = detail::end_of_gap(joint, pair, load);
    if (end.status != Status::ok) return end;
    start = end.coordinate;
  }
  if (!(abs(start) < joint.limit())) return {start, Status::unreachable, 0};
  const S push = joint.demand(start, Load<S>{}).value - joint.demand(start, load).value;
  if (push == S(0)) return {start, Status::ok, 0};
  const S direction = push > S(0) ? S(1) : S(-1);

  const S least_stiffness = pair.loose() ? S(0) : pair.rate / joint.excursion_slope();
  if (!joint.tame(load, least_stiffness)) return detail::solve_by_following(joint, pair, load, start, direction);

  S x = start;
  S before = start;
  for (int n = 1; n <= most_iterations; ++n) {
    const Balance<S> at = balance(joint, pair, load, x);
    const bool stable = at.slope < S(0);
    if (stable && abs(at.correction) <= settled<S>) return {x - at.correction, Status::ok, n};
    if (at.residual * direction < S(0)) return detail::solve_between(joint, pair, load, before, x, direction, n);
    const S next = x - at.correction;
    const bool beyond = !(abs(next) < joint.limit());
    if (!stable || (beyond && joint.folds())) return {x, Status::no_equilibrium, n};
    if (beyond) {
      // With a demand that is not convex, the step may have been too long.
      const S end = direction * detail::reachable(joint);
      if (balance(joint, pair, load, end).residual * direction > S(0)) return {x, Status::unreachable, n};
      return detail::solve_between(joint, pair, load, x, end, direction, n + 1);
    }
    before = x;
    x = next;
  }
  return {x, Status::no_equilibrium, most_iterations};
}

/// The same with derivatives: solved in real numbers, then one Newton step in dual numbers, which is exact by the
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

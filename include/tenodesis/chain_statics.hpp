#pragma once
// Statics of a chain (tendon_chain.hpp): all angles and tensions under a wrench at the tip and a grip force.
//
// Without a load the balance is that of springs, linear in the coordinates while the same tendons are taut. A load is
// raised from zero and the angles follow by Newton's iteration, so that the solution lies on the branch that starts
// unloaded; where the stiffness matrix loses its sign on the way, the branch has ended in a fold.

#include "tenodesis/equilibrium.hpp"
#include "tenodesis/tendon_chain.hpp"

namespace tenodesis {

/// A square matrix of N rows.
template <class S, int N>
struct Square {
  S at[N][N];
};

/// Solves rows x = right by elimination with pivots; returns the determinant's sign, 0 if it is singular or a pivot is
/// not larger than none.
template <class S, int N>
int solve_linear(Square<S, N> matrix, S* right, ValueOf<S> none = ValueOf<S>(0)) {
  int sign = 1;
  for (int k = 0; k < N; ++k) {
    int best = k;
    for (int i = k + 1; i < N; ++i)
      if (abs(value_of(matrix.at[i][k])) > abs(value_of(matrix.at[best][k]))) best = i;
    if (best != k) {
      for (int j = 0; j < N; ++j) {
        const S held = matrix.at[k][j];
        matrix.at[k][j] = matrix.at[best][j];
        matrix.at[best][j] = held;
      }
      const S held = right[k];
      right[k] = right[best];
      right[best] = held;
      sign = -sign;
    }
    const S pivot = matrix.at[k][k];
    if (!(abs(value_of(pivot)) > none)) return 0;
    if (pivot < S(0)) sign = -sign;
    for (int i = k + 1; i < N; ++i) {
      const S by = matrix.at[i][k] / pivot;
      for (int j = k + 1; j < N; ++j) matrix.at[i][j] = matrix.at[i][j] - by * matrix.at[k][j];
      right[i] = right[i] - by * right[k];
    }
  }
  for (int k = N - 1; k >= 0; --k) {
    for (int j = k + 1; j < N; ++j) right[k] = right[k] - matrix.at[k][j] * right[j];
    right[k] = right[k] / matrix.at[k][k];
  }
  return sign;
}

/// Where a chain comes to rest.
template <class S, int N>
struct ChainEquilibrium {
  S x[N]{};  ///< coordinates
  Status status{Status::ok};
  int iterations{};
};

/// Balance at given coordinates, as work by each coordinate: what is left over, N m, and its slopes by the coordinates.
template <class S, int N>
struct ChainBalance {
  S residual[N]{};
  Square<S, N> slope{};
};

/// Most parts of a load that is raised from zero.
inline constexpr int most_load_parts = 4096;

namespace detail {

/// Stiffness of a slack tendon as a share of a taut one's, in Newton's slope alone: a loose joint moves until a tendon
/// tightens.
template <Real S>
inline constexpr S slack_stiffness = sizeof(S) == 4 ? S(1e-4) : S(1e-8);

}  // namespace detail

/// What is left of the balance at coordinates x, and its slopes.
///
/// T is a number, or several in lanes. serial: as of load_moments. slack: share of their stiffness that slack tendons
/// keep in the slopes.
template <bool serial = false, class W, class T>
[[gnu::always_inline]] constexpr ChainBalance<T, W::joints> balance(const W& chain, const T* wound,
                                                                    const ChainLoad<T>& load, const T* x,
                                                                    const typename W::S& slack) {
  constexpr int N = W::joints, M = W::tendons;
  ChainBalance<T, N> at{};
  Bend<T> bend[N];
  for (int i = 0; i < N; ++i) bend[i] = Bend<T>(chain.joint[i], x[i]);
  T moment[N], rate[N][N], excursion[M];
  chain.template load_moments<serial>(bend, load, moment, rate);
  chain.excursions(x, excursion);
  for (int m = 0; m < M; ++m) {
    const T tension = chain.stretched(m, wound[m], excursion[m]);
    const T pull = larger(tension, T(0));
    T taut(chain.stiffness[m]);
    if constexpr (std::is_same_v<T, typename W::S>) taut = taut * chain.growth_at(m, pull);
    const T stiffness = if_above(tension, taut, T(chain.stiffness[m] * slack));
    for (int i = 0; i < N; ++i) {
      const T arm(chain.arm[m][i]);
      at.residual[i] = at.residual[i] + arm * pull;
      for (int j = 0; j <= i; ++j)
        at.slope.at[i][j] = at.slope.at[i][j] - stiffness * T(chain.arm[m][i] * chain.arm[m][j]);
    }
  }
  T angle[N];
  for (int i = 0; i < N; ++i) {
    for (int j = 0; j < i; ++j) at.slope.at[j][i] = at.slope.at[i][j];
    const auto& joint = chain.joint[i];
    const bool is_sprung = joint.stiffness > typename W::S(0) || joint.hardening > typename W::S(0);
    if (is_sprung || chain.has_ties()) angle[i] = angle_at(joint.mechanism, x[i]);
    if (!is_sprung) continue;
    moment[i] = moment[i] - chain.spring(i, angle[i]);
    rate[i][i] = rate[i][i] - chain.spring_rate(i, angle[i]);
  }
  if (chain.has_ties()) {
    chain.add_ties(angle, moment);
    chain.add_tie_rates(T(1), rate);
  }
  for (int i = 0; i < N; ++i) {
    const T& per = bend[i].per_turn;
    at.residual[i] = at.residual[i] + moment[i] * per;
    for (int j = 0; j < N; ++j) at.slope.at[i][j] = at.slope.at[i][j] + rate[i][j] * per * bend[j].per_turn;
    at.slope.at[i][i] = at.slope.at[i][i] + moment[i] * per_turn_rate(chain.joint[i].mechanism, bend[i]);
  }
  return at;
}

namespace detail {

/// Slopes of the balance without a load, all tendons taken as taut, the other way round.
template <class W, class S = W::S>
Square<S, W::joints> unloaded_stiffness(const W& chain) {
  constexpr int N = W::joints, M = W::tendons;
  Square<S, N> stiffness{};
  for (int i = 0; i < N; ++i) {
    for (int j = 0; j < N; ++j)
      for (int m = 0; m < M; ++m)
        stiffness.at[i][j] = stiffness.at[i][j] + chain.stiffness[m] * chain.arm[m][i] * chain.arm[m][j];
    const S per_turn = Bend<S>(chain.joint[i], S(0)).per_turn;
    stiffness.at[i][i] = stiffness.at[i][i] + chain.joint[i].stiffness * per_turn * per_turn;
  }
  // As of coordinates that are angles; Newton's iteration corrects what gears make of them.
  chain.add_tie_rates(S(-1), stiffness.at);
  return stiffness;
}

/// Coordinates at which all tendons, taken as taut, and springs balance without a load: the start of the search.
template <class W, class S = W::S>
int unloaded_start(const W& chain, const S* wound, S* x) {
  constexpr int N = W::joints, M = W::tendons;
  for (int i = 0; i < N; ++i) {
    x[i] = S(0);
    for (int m = 0; m < M; ++m) x[i] = x[i] + chain.arm[m][i] * (chain.pretension[m] + chain.stiffness[m] * wound[m]);
  }
  return solve_linear(unloaded_stiffness(chain), x);
}

/// Newton's iteration from x; ok if it arrives at a stable equilibrium, unreachable if it leaves a joint's limits.
///
/// Where joints are loose, the slopes leave out the load's own change, which would outweigh what little holds them.
template <class W, class S = W::S>
Status newton(const W& chain, const S* wound, const ChainLoad<S>& load, S* x, int& iterations, bool are_loose = false) {
  constexpr int N = W::joints;
  // Residuals fall with the coordinates: all signs of a stable slope are negative.
  constexpr int stable = N % 2 == 0 ? 1 : -1;
  for (int n = 0; n < most_iterations; ++n) {
    ++iterations;
    ChainBalance<S, N> at = balance(chain, wound, load, x, slack_stiffness<S>);
    if (are_loose) at.slope = balance(chain, wound, ChainLoad<S>{}, x, slack_stiffness<S>).slope;
    S step[N];
    for (int i = 0; i < N; ++i) step[i] = at.residual[i];
    if (solve_linear(at.slope, step) != stable) return Status::no_equilibrium;
    S largest(0);
    for (int i = 0; i < N; ++i) largest = larger(largest, abs(step[i]));
    // Where tendons tighten and slacken in turn, shorter steps end the cycle.
    const S longest = S(n < most_iterations / 2 ? 0.25 : 0.02);
    const S share = largest > longest ? longest / largest : S(1);
    for (int i = 0; i < N; ++i) {
      x[i] = x[i] - share * step[i];
      const Mechanism mechanism = chain.joint[i].mechanism;
      if (!(abs(x[i]) < coordinate_limit<S>(mechanism)))
        return folds(mechanism) ? Status::no_equilibrium : Status::unreachable;
    }
    if (largest <= settled<S>) return Status::ok;
  }
  return Status::no_equilibrium;
}

template <class S>
ChainLoad<S> part_of(const ChainLoad<S>& load, S share) {
  return {{share * load.wrench.force, share * load.wrench.moment}, share * load.grip, load.in_stem_axes};
}

/// Farthest that a coordinate may move while a part of the load is added: a solution farther off is another branch.
inline constexpr double longest_part = 0.3;
/// Part of a load that is added first where a joint is loose without one.
inline constexpr double first_part = 1.0 / 64;
/// Rounding by which a stiffness of a loose joint may differ from none, as a share of a taut one's.
template <Real S>
inline constexpr S no_stiffness = sizeof(S) == 4 ? S(1e-5) : S(1e-11);

/// Whether joints can move without a change of the balance: tendons are slack, and no spring holds what they held.
template <class W, class S = W::S>
bool loose(const W& chain, const S* wound, const ChainLoad<S>& load, const S* x) {
  constexpr int N = W::joints, M = W::tendons;
  S excursion[M];
  chain.excursions(x, excursion);
  bool slack = false;
  S taut[N];
  for (int i = 0; i < N; ++i) taut[i] = chain.joint[i].stiffness;
  chain.each_tie([&](int i, const Tie<S>& tie) {
    taut[i] = taut[i] + tie.stiffness;
    taut[tie.to] = taut[tie.to] + tie.ratio * tie.ratio * tie.stiffness;
  });
  for (int m = 0; m < M; ++m) {
    if (!(chain.stiffness[m] > S(0))) continue;
    slack = slack || !(chain.stretched(m, wound[m], excursion[m]) > S(0));
    for (int i = 0; i < N; ++i) taut[i] = taut[i] + chain.stiffness[m] * chain.arm[m][i] * chain.arm[m][i];
  }
  if (!slack) return false;
  Square<S, N> slope = balance(chain, wound, load, x, S(0)).slope;
  S none[N]{};
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j) slope.at[i][j] = slope.at[i][j] / sqrt(taut[i] * taut[j]);
  return solve_linear(slope, none, no_stiffness<S>) == 0;
}

}  // namespace detail

template <class S>
bool is_finite(const ChainLoad<S>& load) {
  const Vector<S>& force = load.wrench.force;
  const Vector<S>& moment = load.wrench.moment;
  return all_finite(force.x, force.y, force.z, moment.x, moment.y, moment.z, load.grip);
}

/// Equilibrium on the branch that starts unloaded.
///
/// wound: length wound in by handle and motors on each tendon, m.
template <class W, class S = W::S>
ChainEquilibrium<S, W::joints> solve(const W& chain, const S* wound, const ChainLoad<S>& load) {
  constexpr int N = W::joints, M = W::tendons;
  ChainEquilibrium<S, N> at{};
  bool finite = is_finite(load);
  for (int m = 0; m < M; ++m) finite = finite && is_finite(wound[m]);
  if (!finite) {
    at.status = Status::not_finite;
    return at;
  }
  if (detail::unloaded_start(chain, wound, at.x) == 0) {
    at.status = Status::both_slack;
    return at;
  }
  for (int i = 0; i < N; ++i)
    if (!(abs(at.x[i]) < coordinate_limit<S>(chain.joint[i].mechanism))) at.status = Status::unreachable;
  if (at.status != Status::ok) return at;
  at.status = detail::newton(chain, wound, detail::part_of(load, S(0)), at.x, at.iterations);
  if (at.status != Status::ok) return at;
  // What no tendon holds moves freely, until a little more of the load presses it against its tendons.
  bool may_jump = detail::loose(chain, wound, ChainLoad<S>{}, at.x);
  S raised(0);
  S part = may_jump ? S(detail::first_part) : S(1);
  while (raised < S(1)) {
    const S next = smaller(S(1), raised + part);
    const ChainLoad<S> more = detail::part_of(load, next);
    S x[N];
    Status found = Status::no_equilibrium;
    for (int way = 0; way <= int(may_jump) && found != Status::ok; ++way) {
      for (int i = 0; i < N; ++i) x[i] = at.x[i];
      found = way > 0 ? detail::newton(chain, wound, more, x, at.iterations, true) : Status::ok;
      if (found == Status::ok) found = detail::newton(chain, wound, more, x, at.iterations);
    }
    for (int i = 0; i < N && found == Status::ok && !may_jump; ++i)
      if (!(abs(x[i] - at.x[i]) <= S(detail::longest_part))) found = Status::no_equilibrium;
    if (found == Status::ok) {
      for (int i = 0; i < N; ++i) at.x[i] = x[i];
      raised = next;
      part = part + part;
      may_jump = detail::loose(chain, wound, ChainLoad<S>{}, at.x);
    } else {
      part = part * S(0.5);
      if (part < S(1) / S(most_load_parts)) {
        at.status = found;
        return at;
      }
    }
  }
  // A joint that no tendon or spring holds rests anywhere.
  if (detail::loose(chain, wound, load, at.x)) at.status = Status::both_slack;
  return at;
}

/// How a chain at rest answers: rates of its angles, and its stiffness.
template <class W>
struct ChainAnswer {
  using S = W::S;
  static constexpr int N = W::joints, M = W::tendons;

  S stiffness[N][N]{};  ///< moment by angle, the load's own change included, N m/rad
  S by_wrench[N][6]{};  ///< angles by force (rad/N) and moment (rad/(N m))
  S by_grip[N]{};       ///< by the grip force, rad/N
  S by_stroke[N][M]{};  ///< by the motors, rad/m
  S by_handle[N][N]{};  ///< by the handle's angles
};

/// Rates at an equilibrium, exact by the implicit function theorem; not ok where the stiffness is singular.
template <class W, class S = W::S>
Status answer(const W& chain, const S* wound, const ChainLoad<S>& load, const S* handle_angle, const S* x,
              ChainAnswer<W>& out) {
  constexpr int N = W::joints, M = W::tendons;
  Bend<S> bend[N];
  for (int i = 0; i < N; ++i) bend[i] = Bend<S>(chain.joint[i], x[i]);
  const ChainBalance<S, N> at = balance(chain, wound, load, x, S(0));
  Square<S, N> stiffness{};
  for (int i = 0; i < N; ++i)
    for (int j = 0; j < N; ++j)
      out.stiffness[i][j] = stiffness.at[i][j] = -bend[i].turn * at.slope.at[i][j] * bend[j].turn;
  Status found = Status::ok;
  const auto rates = [&](const S* moment, const auto& store) {
    S angle[N];
    for (int i = 0; i < N; ++i) angle[i] = moment[i];
    if (solve_linear(stiffness, angle) == 0) found = Status::both_slack;
    for (int i = 0; i < N; ++i) store(i, angle[i]);
  };
  S moment[N], rate[N][N];
  for (int k = 0; k < 6; ++k) {
    ChainLoad<S> unit{{}, S(0), load.in_stem_axes};
    Vector<S>& v = k < 3 ? unit.wrench.force : unit.wrench.moment;
    (k % 3 == 0 ? v.x : k % 3 == 1 ? v.y : v.z) = S(1);
    chain.load_moments(bend, unit, moment, rate);
    rates(moment, [&](int i, const S& by) { out.by_wrench[i][k] = by; });
  }
  chain.load_moments(bend, ChainLoad<S>{{}, S(1), load.in_stem_axes}, moment, rate);
  rates(moment, [&](int i, const S& by) { out.by_grip[i] = by; });
  S excursion[M];
  chain.excursions(x, excursion);
  for (int m = 0; m < M; ++m) {
    const S tension = chain.stretched(m, wound[m], excursion[m]);
    const S taut = if_above(tension, chain.stiffness[m] * chain.growth_at(m, tension), S(0));
    for (int i = 0; i < N; ++i) moment[i] = taut * chain.arm[m][i] * bend[i].turn;
    rates(moment, [&](int i, const S& by) { out.by_stroke[i][m] = by; });
  }
  for (int h = 0; h < chain.handles; ++h) {
    const S turn = Bend<S>(chain.handle[h], S(0), coordinate_at(chain.handle[h], handle_angle[h])).turn;
    for (int i = 0; i < N; ++i) {
      out.by_handle[i][h] = S(0);
      for (int m = 0; m < M; ++m)
        out.by_handle[i][h] = out.by_handle[i][h] + out.by_stroke[i][m] * chain.handle_arm[m][h] * turn;
    }
  }
  return found;
}

/// Handle angles at which the chain holds given angles under a load; as many of the handle's joints as of the tip's.
template <class W, class S = W::S>
Status handle_angles(const W& chain, const S* angle, const ChainLoad<S>& load, const S* stroke, S* handle_angle) {
  constexpr int N = W::joints, M = W::tendons;
  if (chain.handles != N) return Status::unreachable;
  if (!is_finite(load)) return Status::not_finite;
  S x[N], y[N];
  for (int i = 0; i < N; ++i) {
    if (!is_finite(angle[i])) return Status::not_finite;
    if (!(abs(angle[i]) < S(pi))) return Status::unreachable;
    x[i] = coordinate_at(chain.joint[i].mechanism, angle[i]);
    y[i] = S(0);
  }
  Bend<S> bend[N];
  for (int i = 0; i < N; ++i) bend[i] = Bend<S>(chain.joint[i], x[i]);
  S moment[N], rate[N][N], excursion[M];
  chain.load_moments(bend, load, moment, rate);
  chain.excursions(x, excursion);
  chain.add_springs(angle, moment);
  bool arrived = false;
  for (int n = 0; n < most_iterations && !arrived; ++n) {
    Square<S, N> slope{};
    S step[N];
    for (int i = 0; i < N; ++i) step[i] = moment[i] / bend[i].turn;
    for (int m = 0; m < M; ++m) {
      S wound = stroke[m];
      for (int h = 0; h < N; ++h) wound = wound + chain.handle_arm[m][h] * y[h];
      const S tension = chain.stretched(m, wound, excursion[m]);
      const S share = tension > S(0) ? chain.growth_at(m, tension) : detail::slack_stiffness<S>;
      for (int i = 0; i < N; ++i) {
        step[i] = step[i] + chain.arm[m][i] * larger(tension, S(0));
        for (int h = 0; h < N; ++h)
          slope.at[i][h] = slope.at[i][h] + share * chain.stiffness[m] * chain.arm[m][i] * chain.handle_arm[m][h];
      }
    }
    if (solve_linear(slope, step) == 0) return Status::both_slack;
    arrived = true;
    for (int h = 0; h < N; ++h) {
      y[h] = y[h] - clamp(step[h], S(-0.5), S(0.5));
      arrived = arrived && abs(step[h]) <= settled<S>;
      if (!(abs(y[h]) < S(2) * coordinate_limit<S>(chain.handle[h]))) return Status::unreachable;
    }
  }
  if (!arrived) return Status::no_equilibrium;
  for (int h = 0; h < N; ++h) {
    if (!(abs(y[h]) < coordinate_limit<S>(chain.handle[h]))) return Status::unreachable;
    handle_angle[h] = angle_at(chain.handle[h], y[h]);
  }
  // The balance may have other branches: the handle's angles must lead back.
  S wound[M];
  chain.wind(handle_angle, stroke, wound);
  const ChainEquilibrium<S, N> back = solve(chain, wound, load);
  if (back.status != Status::ok) return back.status;
  constexpr S near = sizeof(S) == 4 ? S(1e-2) : S(1e-5);
  for (int i = 0; i < N; ++i)
    if (!(abs(back.x[i] - x[i]) <= near)) return Status::no_equilibrium;
  return Status::ok;
}

/// Strokes of the motors with which the chain under a load takes the angles that it has without one.
///
/// wound: length wound in by the handle, m. The change of the tensions that carries the load is the smallest in the sum
/// of its squares, no tendon below zero; every motor winds what its own tendon is stretched by more.
template <class W, class S = W::S>
Status compensation_strokes(const W& chain, const S* wound, const ChainLoad<S>& load, S* stroke) {
  constexpr int N = W::joints, M = W::tendons;
  if (!is_finite(load)) return Status::not_finite;
  const ChainEquilibrium<S, N> at = solve(chain, wound, ChainLoad<S>{});
  if (at.status != Status::ok) return at.status;
  Bend<S> bend[N];
  for (int i = 0; i < N; ++i) bend[i] = Bend<S>(chain.joint[i], at.x[i]);
  S moment[N], rate[N][N], excursion[M], before[M];
  chain.load_moments(bend, load, moment, rate);
  chain.excursions(at.x, excursion);
  for (int m = 0; m < M; ++m) before[m] = chain.stretched(m, wound[m], excursion[m]);
  const auto held = [&](int m) { return larger(before[m], S(0)); };
  bool slack[M]{};
  S change[M]{};
  // A tendon without a motor keeps its tension, since the angles are kept.
  const auto acts = [&](int m) { return chain.motor[m] && !slack[m]; };
  for (int round = 0; round <= M; ++round) {
    // Least squares over the tendons that act: change = arm (arm^T arm)^-1 moment.
    Square<S, N> normal{};
    S dual[N];
    for (int i = 0; i < N; ++i) {
      dual[i] = -moment[i] * bend[i].per_turn;
      for (int m = 0; m < M; ++m) {
        if (slack[m]) dual[i] = dual[i] + chain.arm[m][i] * held(m);
        for (int j = 0; j < N && acts(m); ++j) normal.at[i][j] = normal.at[i][j] + chain.arm[m][i] * chain.arm[m][j];
      }
    }
    ValueOf<S> size(0);
    for (int i = 0; i < N; ++i) size += value_of(normal.at[i][i]);
    if (solve_linear(normal, dual, detail::no_stiffness<ValueOf<S>> * size) == 0) return Status::no_authority;
    bool again = false;
    for (int m = 0; m < M; ++m) {
      change[m] = slack[m] ? -held(m) : S(0);
      if (!acts(m)) continue;
      for (int i = 0; i < N; ++i) change[m] = change[m] + chain.arm[m][i] * dual[i];
      if (change[m] < -held(m)) slack[m] = again = true;
    }
    if (again) continue;
    for (int m = 0; m < M; ++m) {
      // A slack tendon is wound in only if it has to pull.
      const S wanted = held(m) + change[m];
      const bool moves = chain.stiffness[m] > S(0) && (wanted > S(0) || before[m] > S(0)) && change[m] != S(0);
      stroke[m] = moves ? (chain.linear_at(m, wanted) - chain.linear_at(m, before[m])) / chain.stiffness[m] : S(0);
    }
    return Status::ok;
  }
  return Status::no_authority;
}

}  // namespace tenodesis

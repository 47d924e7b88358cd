#pragma once
// Equilibria of a chain at several points at once, in the lanes of vector registers.
//
// Newton's iteration as in chain_statics.hpp, a fixed number of steps from the unloaded angles. A lane counts if the
// scalar search would have gone the same way: no tendon slack before the load, every slope stable, no step shortened,
// and no coordinate farther than a part of a load may move it. The last step is so short that the next would be
// rounding.

#include "tenodesis/chain_statics.hpp"
#include "tenodesis/lanes.hpp"

#if defined(__GNUC__)

namespace tenodesis {

/// Newton's steps of a block.
inline constexpr int chain_block_steps = 4;
/// Longest step that may follow: the steps shrink by as much as the last one did, or faster.
template <Real S>
inline constexpr S longest_next_step = sizeof(S) == 4 ? S(1e-6) : S(1e-13);

/// Coordinates and whether each lane is decided: 1 or 0.
template <class L, int N>
struct ChainLanes {
  L x[N];
  L angle[N];  ///< rad
  L decided;
};

/// Solves all lanes; those that are not decided are left to solve().
template <bool serial = false, class W, class S, int K>
[[gnu::always_inline]] inline ChainLanes<Lanes<S, K>, W::joints> solve_lanes(const W& chain, const Lanes<S, K>* wound,
                                                                             const ChainLoad<Lanes<S, K>>& load) {
  using L = Lanes<S, K>;
  constexpr int N = W::joints, M = W::tendons;
  ChainLanes<L, N> at;
  const Square<S, N> spring = detail::unloaded_stiffness(chain);
  L pull[N];
  for (int i = 0; i < N; ++i) {
    pull[i] = L(S(0));
    for (int m = 0; m < M; ++m)
      pull[i] = pull[i] + L(chain.arm[m][i]) * (L(chain.pretension[m]) + L(chain.stiffness[m]) * wound[m]);
  }
  // The unloaded coordinates are linear in what is wound.
  for (int i = 0; i < N; ++i) at.x[i] = L(S(0));
  L worst(S(1));
  for (int j = 0; j < N; ++j) {
    S column[N]{};
    column[j] = S(1);
    if (solve_linear(spring, column) == 0) worst = L(S(0));
    for (int i = 0; i < N; ++i) at.x[i] = at.x[i] + L(column[i]) * pull[j];
  }
  const auto keep = [&](const auto& condition) { worst.v = condition ? worst.v : L(S(0)).v; };
  L excursion[M];
  chain.excursions(at.x, excursion);
  for (int m = 0; m < M; ++m)
    if (chain.stiffness[m] > S(0)) keep(chain.stretched(m, wound[m], excursion[m]).v >= L(S(0)).v);
  L start[N];
  for (int i = 0; i < N; ++i) start[i] = at.x[i];
  L last(S(0)), before(S(0));
  // Elimination without pivots: all pivots of a stable slope are positive, or the lane is not
  // decided.
  L matrix[N][N];
  const auto step = [&](auto renews) {
    const ChainBalance<L, N> of = balance<serial>(chain, wound, load, at.x, S(0));
    L right[N];
    for (int i = 0; i < N; ++i) right[i] = of.residual[i];
    if constexpr (decltype(renews)::value) {
      for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) matrix[i][j] = -of.slope.at[i][j];
      for (int k = 0; k < N; ++k) {
        keep(matrix[k][k].v > L(S(0)).v);
        matrix[k][k] = L(S(1)) / matrix[k][k];
        for (int i = k + 1; i < N; ++i) {
          matrix[i][k] = matrix[i][k] * matrix[k][k];
          for (int j = k + 1; j < N; ++j) matrix[i][j] = matrix[i][j] - matrix[i][k] * matrix[k][j];
        }
      }
    }
    for (int k = 0; k < N; ++k)
      for (int i = k + 1; i < N; ++i) right[i] = right[i] - matrix[i][k] * right[k];
    before = last;
    last = L(S(0));
    for (int k = N - 1; k >= 0; --k) {
      for (int j = k + 1; j < N; ++j) right[k] = right[k] - matrix[k][j] * right[j];
      right[k] = right[k] * matrix[k][k];
      last = larger(last, abs(right[k]));
    }
    keep(last.v <= L(S(0.25)).v);
    for (int i = 0; i < N; ++i) at.x[i] = at.x[i] + right[i];
  };
  for (int n = 1; n < chain_block_steps; ++n) step(std::true_type{});
  // The slopes of the step before the last are as good as its own.
  step(std::false_type{});
  const L longest(longest_next_step<S>);
  keep((last * last).v <= (longest * (before + longest)).v);
  for (int i = 0; i < N; ++i) {
    keep(abs(at.x[i]).v < L(coordinate_limit<S>(chain.joint[i].mechanism)).v);
    keep(abs(at.x[i] - start[i]).v <= L(S(detail::longest_part)).v);
  }
  for (int i = 0; i < N; ++i) at.angle[i] = angle_at(chain.joint[i].mechanism, at.x[i]);
  at.decided = worst;
  return at;
}

}  // namespace tenodesis

#endif

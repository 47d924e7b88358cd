#pragma once
// The equilibrium of many points at once: the core's Newton step over a block of points, in vector instructions.
//
// Points that have not arrived monotonically after the block's fixed number of steps go through the core's own solve,
// which decides what they are.

#include <array>

#include "operations.hpp"

#if defined(__x86_64__) && defined(__GNUC__)
#define TENODESIS_WIDE [[gnu::target("avx2,fma"), gnu::flatten]]
#define TENODESIS_HAS_WIDE 1
#else
#define TENODESIS_HAS_WIDE 0
#endif

namespace tenodesis::bindings {

inline constexpr int block_size = 64;
inline constexpr int block_steps = 5;
inline constexpr std::size_t most_outputs = 3;

using Lane = std::array<double, block_size>;

struct Block {
  std::array<Lane, held_inputs> in;
  Lane agonist, antagonist;  // of the tendon pair
  Lane start, x, first, correction, worst_slope, worst_turn;
  std::array<Lane, most_outputs> out;

  std::array<double, held_inputs> inputs(int i) const {
    std::array<double, held_inputs> row{};
    for (std::size_t k = 0; k < held_inputs; ++k) row[k] = in[k][std::size_t(i)];
    return row;
  }
};

template <class A>
[[gnu::always_inline]] inline void run_newton(const A& axis, Block& block) {
  const double rate = axis.stiffness * axis.distal.excursion_slope();
  const auto pair = [&](std::size_t i) { return TendonPair<double>{block.agonist[i], block.antagonist[i], rate}; };
  const auto load = [&](std::size_t i) {
    return Load<double>{block.in[held_force][i], block.in[held_radial_force][i]};
  };
  for (std::size_t i = 0; i < block_size; ++i) {
    const auto at = TendonPair<double>::at_handle(
        axis, block.in[held_handle_angle][i], {block.in[held_agonist_wound][i], block.in[held_antagonist_wound][i]});
    block.agonist[i] = at.agonist;
    block.antagonist[i] = at.antagonist;
    block.start[i] = block.x[i] = unloaded_coordinate(axis.distal, at);
  }
  for (std::size_t i = 0; i < block_size; ++i) {
    const Balance<double> at = balance(axis.distal, pair(i), load(i), block.x[i]);
    block.first[i] = at.correction;
    block.worst_slope[i] = at.slope;
    block.worst_turn[i] = 0;
    block.x[i] -= at.correction;
  }
  for (int step = 1; step < block_steps; ++step) {
    for (std::size_t i = 0; i < block_size; ++i) {
      const Balance<double> at = balance(axis.distal, pair(i), load(i), block.x[i]);
      const double turn = at.correction * block.first[i];
      block.correction[i] = at.correction;
      block.worst_slope[i] = block.worst_slope[i] > at.slope ? block.worst_slope[i] : at.slope;
      block.worst_turn[i] = block.worst_turn[i] < turn ? block.worst_turn[i] : turn;
      block.x[i] -= at.correction;
    }
  }
}

/// The operation's outputs at the block's coordinates.
template <class Operation, class A>
[[gnu::always_inline]] inline void finish(const A& axis, Block& block) {
  const double rate = axis.stiffness * axis.distal.excursion_slope();
  for (std::size_t i = 0; i < block_size; ++i) {
    double result[Operation::outputs];
    Operation::at(axis, block.in[held_handle_angle][i], {block.agonist[i], block.antagonist[i], rate}, block.x[i],
                  result);
    for (std::size_t k = 0; k < std::size_t(Operation::outputs); ++k) block.out[k][i] = result[k];
  }
}

template <class A>
[[gnu::flatten]] void run_newton_plain(const A& axis, Block& block) {
  run_newton(axis, block);
}
template <class Operation, class A>
[[gnu::flatten]] void finish_plain(const A& axis, Block& block) {
  finish<Operation>(axis, block);
}

#if TENODESIS_HAS_WIDE
template <class A>
TENODESIS_WIDE void run_newton_wide(const A& axis, Block& block) {
  run_newton(axis, block);
}
template <class Operation, class A>
TENODESIS_WIDE void finish_wide(const A& axis, Block& block) {
  finish<Operation>(axis, block);
}
inline const bool wide = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
#endif

// Whether Newton's iteration ran straight to a root: every slope a stable one, every step in the first one's
// direction, the last one settled. A NaN anywhere fails a comparison.
template <class A>
bool arrived(const A& axis, const Block& block, std::size_t i) {
  const double limit = axis.distal.limit();
  const bool loose = !(block.agonist[i] + block.antagonist[i] >= 0);
  return !loose && block.worst_slope[i] < 0 && block.worst_turn[i] >= -settled<double> * abs(block.first[i]) &&
         abs(block.correction[i]) <= settled<double> && abs(block.start[i]) < limit && abs(block.x[i]) < limit;
}

/// Outputs and status of each of the block's first n points; the rest must hold numbers too.
template <class Operation, class A>
void solve_block(const A& axis, Block& block, std::array<Status, block_size>& status, int n) {
#if TENODESIS_HAS_WIDE
  wide ? run_newton_wide(axis, block) : run_newton_plain(axis, block);
#else
  run_newton_plain(axis, block);
#endif
  for (std::size_t i = 0; i < std::size_t(n); ++i) {
    status[i] = check_handle(axis, block.in[held_handle_angle][i]);
    if (status[i] != Status::ok || arrived(axis, block, i)) continue;
    const auto row = block.inputs(int(i));
    const Equilibrium<double> found =
        equilibrium(axis, row[held_handle_angle], held_load(row.data()), held_stroke(row.data()));
    block.x[i] = found.coordinate;
    status[i] = found.status;
  }
#if TENODESIS_HAS_WIDE
  wide ? finish_wide<Operation>(axis, block) : finish_plain<Operation>(axis, block);
#else
  finish_plain<Operation>(axis, block);
#endif
}

}  // namespace tenodesis::bindings

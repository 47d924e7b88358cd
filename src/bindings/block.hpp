#pragma once
// The equilibrium of a block of points: the core's Newton steps in vector instructions.
//
// Points that have not converged monotonically after the block's fixed number of steps are solved by the core's own
// function, which decides their status.

#include <array>
#include <limits>

#include "engine/vectors.hpp"
#include "operations.hpp"

namespace tenodesis::bindings {

using engine::in_widest_vectors;

inline constexpr int block_size = 64;
inline constexpr int block_steps = 7;
inline constexpr std::size_t most_outputs = 3;

using Lane = std::array<double, block_size>;

struct Block {
  std::array<Lane, held_inputs> in;
  Lane agonist, antagonist;  // of the tendon pair
  Lane start, x, first, correction, worst_slope, worst_turn;
  Lane verdict;  // of a point; a real number, to be computed in vectors like the rest
  std::array<Lane, most_outputs> out;

  std::array<double, held_inputs> inputs(int i) const {
    std::array<double, held_inputs> row{};
    for (std::size_t k = 0; k < held_inputs; ++k) row[k] = in[k][std::size_t(i)];
    return row;
  }
};

/// Verdicts on a point after the block's Newton steps.
inline constexpr double arrived = 0, past_fold = 1, undecided = 2;

// Arrived: the load is tame, and from a start within range every slope was stable, every step had the first one's
// direction, and the last step was below the tolerance. Past the fold: Newton's iteration cannot have passed a root,
// and yet a slope changed its sign, or the joint's limit was crossed. All other points, invalid input included, are
// left to the core's own solve.
template <class A>
[[gnu::always_inline]] inline void judge(const A axis, Block& block) {
  const double limit = axis.distal.limit();
  const double range = axis.handle_range + range_tolerance<double>;
  for (std::size_t i = 0; i < block_size; ++i) {
    const Load<double> load{block.in[held_force][i], block.in[held_radial_force][i]};
    const double sum = block.agonist[i] + block.antagonist[i];
    const bool valid = (abs(block.in[held_handle_angle][i]) <= range) & (sum >= 0) & (abs(block.start[i]) < limit) &
                       is_finite(sum + load.force + load.radial_force) & axis.distal.tame(load, axis.stiffness);
    const bool straight = (block.worst_slope[i] < 0) & (abs(block.x[i]) < limit);
    const bool forward = block.worst_turn[i] >= -settled<double> * abs(block.first[i]);
    const bool settled_last = abs(block.correction[i]) <= settled<double>;
    const bool lost = valid & axis.distal.folds() & !straight;
    const double otherwise = lost ? past_fold : undecided;
    block.verdict[i] = valid & straight & forward & settled_last ? arrived : otherwise;
  }
}

template <class A>
[[gnu::always_inline]] inline void run_newton(const A axis, Block& block) {
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
    block.start[i] = unloaded_coordinate(axis.distal, at);
    block.x[i] = block.start[i];
    block.worst_slope[i] = -std::numeric_limits<double>::infinity();
    block.worst_turn[i] = 0;
    block.first[i] = 0;
  }
  for (int step = 0; step < block_steps; ++step) {
    for (std::size_t i = 0; i < block_size; ++i) {
      const Balance<double> at = balance(axis.distal, pair(i), load(i), block.x[i]);
      const double turn = at.correction * block.first[i];
      block.correction[i] = at.correction;
      block.first[i] = step == 0 ? at.correction : block.first[i];
      block.worst_slope[i] = block.worst_slope[i] > at.slope ? block.worst_slope[i] : at.slope;
      block.worst_turn[i] = block.worst_turn[i] < turn ? block.worst_turn[i] : turn;
      block.x[i] -= at.correction;
    }
  }
  judge(axis, block);
}

/// The operation's outputs at the block's coordinates.
template <class Operation, class A>
[[gnu::always_inline]] inline void finish(const A axis, Block& block) {
  const double rate = axis.stiffness * axis.distal.excursion_slope();
  for (std::size_t i = 0; i < block_size; ++i) {
    double result[Operation::outputs];
    Operation::at(axis, block.in[held_handle_angle][i], {block.agonist[i], block.antagonist[i], rate}, block.x[i],
                  result);
    for (std::size_t k = 0; k < std::size_t(Operation::outputs); ++k)
      block.out[k][i] = block.verdict[i] == arrived ? result[k] : std::numeric_limits<double>::quiet_NaN();
  }
}

/// Outputs, NaN without a solution, and status of every point of the block.
template <class Operation, class A>
void solve_block(const A& axis, Block& block, std::array<unsigned char, block_size>& status) {
  in_widest_vectors([&] { run_newton(axis, block); });
  for (std::size_t i = 0; i < block_size; ++i) {
    status[i] = static_cast<unsigned char>(block.verdict[i] == arrived ? Status::ok : Status::no_equilibrium);
    if (block.verdict[i] != undecided) continue;
    const auto row = block.inputs(int(i));
    const Equilibrium<double> found =
        equilibrium(axis, row[held_handle_angle], held_load(row.data()), held_stroke(row.data()));
    block.x[i] = found.coordinate;
    block.verdict[i] = found.status == Status::ok ? arrived : past_fold;
    status[i] = static_cast<unsigned char>(found.status);
  }
  in_widest_vectors([&] { finish<Operation>(axis, block); });
}

}  // namespace tenodesis::bindings

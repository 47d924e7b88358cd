// Claims about the block solve: for every mechanism and any input, it finds what the point-by-point solve finds.

#include "bindings/block.hpp"

#include <random>

#include "claim.hpp"
#include "instruments.hpp"

using namespace tenodesis;
using namespace tenodesis::bindings;

template <class A>
void blocks_find_what_points_find(const A& axis, double force_scale) {
  std::mt19937 random(7);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  int solved = 0, unsolved = 0;
  for (int round = 0; round < 300; ++round) {
    Block block{};
    const bool radial = round % 3 == 1, wound = round % 4 == 2, loose = round % 8 == 6;
    for (std::size_t i = 0; i < block_size; ++i) {
      block.in[held_handle_angle][i] = between(-0.8, 0.8);
      block.in[held_force][i] = force_scale * between(-3, 3);
      block.in[held_radial_force][i] = radial ? between(-80, 80) : 0;
      block.in[held_agonist_wound][i] = wound ? between(-1e-3, 1e-3) + (loose ? -4e-3 : 0) : 0;
      block.in[held_antagonist_wound][i] = wound ? between(-1e-3, 1e-3) : 0;
    }
    block.in[std::size_t(round) % held_inputs][5] = std::nan("");
    block.in[held_force][9] = HUGE_VAL;
    std::array<unsigned char, block_size> status{};
    const Block given = block;
    solve_block<HeldState>(axis, block, status);
    for (std::size_t i = 0; i < block_size; ++i) {
      const auto row = given.inputs(int(i));
      const auto at = equilibrium(axis, row[held_handle_angle], held_load(row.data()), held_stroke(row.data()));
      CLAIM(status[i] == static_cast<unsigned char>(at.status));
      ++(at.status == Status::ok ? solved : unsolved);
      for (std::size_t k = 0; k < 3; ++k) CLAIM(is_finite(block.out[k][i]) == (at.status == Status::ok));
      if (at.status == Status::ok) CLAIM_NEAR(block.out[0][i], axis.distal.angle(at.coordinate), 1e-9);
    }
  }
  CLAIM(solved > 5000);
  CLAIM(unsolved > 500);
}

int main() {
  blocks_find_what_points_find(instruments::real_size<double>(), 1);
  blocks_find_what_points_find(instruments::scaled_up<double>(), 3);
  blocks_find_what_points_find(instruments::pulley<double>(), 2);
  blocks_find_what_points_find(instruments::continuum<double>(), 3);
  return claims::report();
}

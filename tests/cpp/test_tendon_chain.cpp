// Claims about chains: lanes give what the scalar search gives.

#include "tenodesis/chain_block.hpp"

#include <random>

#include "claim.hpp"
#include "tenodesis/statics.hpp"

using namespace tenodesis;

constexpr double stiffness = 31172.5;
constexpr double pretension = 30;
constexpr double radius = 2e-3;
constexpr double handle_radius = 4.5e-3;
constexpr double end_effector = 0.05;

/// Gears, each with a pair of tendons; yaw, then pitch.
template <int N>
TendonChain<double, N, 2 * N> gears() {
  TendonChain<double, N, 2 * N> chain{};
  chain.handles = N;
  for (int i = 0; i < N; ++i) {
    chain.joint[i].parent = i - 1;
    chain.joint[i].axis = i == 0 ? Vector<double>{0, 1, 0} : Vector<double>{-1, 0, 0};
    chain.joint[i].offset = i == 0 ? 0 : 2 * radius;
    chain.joint[i].chord = 2 * radius;
    for (int side = 0; side < 2; ++side) {
      const int m = 2 * i + side;
      const double sign = side == 0 ? 1 : -1;
      chain.arm[m][i] = sign * 2 * radius;
      chain.handle_arm[m][i] = sign * 2 * handle_radius;
      chain.stiffness[m] = stiffness;
      chain.pretension[m] = pretension;
      chain.motor[m] = true;
    }
  }
  chain.joint[N - 1].length = end_effector;
  chain.joint[N - 1].share = 1;
  return chain;
}

void lanes_give_what_the_scalar_search_gives() {
  constexpr int lanes = 8;
  using L = Lanes<double, lanes>;
  const auto chain = gears<2>();
  std::mt19937 random(2);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  std::uniform_real_distribution<double> share(-1, 1);
  double worst = 0;
  int decided = 0;
  for (int block = 0; block < 200; ++block) {
    L wound[4];
    ChainLoad<L> load{};
    double own[lanes][4];
    ChainLoad<double> one[lanes]{};
    for (int k = 0; k < lanes; ++k) {
      const double handle[2] = {0.5 * share(random), 0.5 * share(random)};
      const double stroke[4] = {};
      chain.wind(handle, stroke, own[k]);
      // A fifth of the loads is so large that tendons slacken or joints snap through.
      const double size = k % 5 == 0 ? 5 : 1;
      one[k].wrench.force = {size * share(random), size * share(random), size * share(random)};
      for (int m = 0; m < 4; ++m) wound[m].v[k] = own[k][m];
      load.wrench.force.x.v[k] = one[k].wrench.force.x;
      load.wrench.force.y.v[k] = one[k].wrench.force.y;
      load.wrench.force.z.v[k] = one[k].wrench.force.z;
    }
    const auto found = solve_lanes(chain, wound, load);
    for (int k = 0; k < lanes; ++k) {
      if (!(found.decided[k] > 0)) continue;
      ++decided;
      const auto alone = solve(chain, own[k], one[k]);
      CLAIM(alone.status == Status::ok);
      for (int i = 0; i < 2; ++i) worst = std::fmax(worst, std::fabs(found.x[i][k] - alone.x[i]));
    }
  }
  CLAIM(decided > 200 * lanes / 2);
  CLAIM(worst < 1e-12);
}

void an_infinite_load_has_no_equilibrium() {
  const auto chain = gears<2>();
  const double wound[4] = {};
  ChainLoad<double> load{};
  load.wrench.force.x = std::numeric_limits<double>::infinity();
  CLAIM(solve(chain, wound, load).status == Status::not_finite);
}

int main() {
  lanes_give_what_the_scalar_search_gives();
  an_infinite_load_has_no_equilibrium();
  return claims::report();
}

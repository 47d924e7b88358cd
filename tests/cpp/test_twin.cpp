// The twin of a chain of two gear joints, whose pitch tendons pass the yaw gears.

#include <initializer_list>

#include "claim.hpp"
#include "tenodesis/twin_energy.hpp"

using namespace tenodesis;

namespace {

template <class S>
using W = TendonChain<S, 2, 4>;
template <class S>
using T = Twin<W<S>, 8>;

template <class S>
T<S> twin(bool quasi_static, double hand = 0) {
  T<S> t{};
  for (int i = 0; i < 2; ++i) {
    t.chain.joint[i] = {.mechanism = Mechanism::gear,
                        .parent = i - 1,
                        .axis = i == 0 ? Vector<S>{S(0), S(1), S(0)} : Vector<S>{S(-1), S(0), S(0)},
                        .offset = S(i * 4e-3),
                        .chord = S(4e-3),
                        .length = S(i * 0.05),
                        .share = S(i)};
    t.chain.handle[i] = Mechanism::gear;
    t.link[i] = {S(0.01), S(0.02), {S(8e-6), S(8e-6), S(1e-7)}};
    t.damping[i] = S(1e-4);
    t.stop_low[i] = S(-1.8);
    t.stop_high[i] = S(1.8);
    t.stop_stiffness[i] = S(1);
  }
  t.chain.handles = 2;
  for (int m = 0; m < 4; ++m) {
    const double side = m % 2 == 0 ? 1 : -1;
    const int axis = m / 2;
    t.chain.arm[m][axis] = S(side * 4e-3);
    t.chain.handle_arm[m][axis] = S(side * 9e-3);
    t.chain.stiffness[m] = S(3e4);
    t.chain.pretension[m] = S(30);
    t.chain.motor[m] = true;
    t.tendon[m].rest_tension = S(30);
    int n = 0;
    const auto passes = [&](int joint, double arm) { t.passage[m][n++] = {joint, S(0.1), S(0.2), S(1), S(arm)}; };
    passes(-1, 0);
    passes(2 + axis, side * 9e-3);
    if (axis > 0) {
      passes(2, 0);
      passes(0, 0);
    }
    passes(axis, -side * 4e-3);
    t.tendon[m].stiffness.length = n + 1;
    for (int i = 0; i <= n; ++i) t.tendon[m].stiffness[i] = S(3e4 * (n + 1));
  }
  t.hand = {S(hand), S(0.05), S(2e-3)};
  t.drive = {S(5e-3), S(20), S(400), S(0.01), S(0)};
  t.handle_encoder = t.output_encoder = {S(1), S(0), S(0), S(-4), S(4), S(1e-6)};
  for (auto& cell : t.load_cell) cell = {S(1), S(0), S(0), S(-200), S(200), S(1e-4)};
  t.motor_encoder = {S(1), S(0), S(0), S(-1e6), S(1e6), S(1e-6)};
  t.time_step = S(5e-4);
  t.quasi_static = quasi_static;
  t.prepare();
  return t;
}

// A slow triangle of handle angles and a force across the tip.
template <class S>
TwinCommand<W<S>> command(int step) {
  const double phase = step % 2000 / 2000.0;
  const double triangle = phase < 0.25 ? 4 * phase : phase < 0.75 ? 2 - 4 * phase : 4 * phase - 4;
  TwinCommand<W<S>> to{};
  to.handle_angle[0] = S(0.4 * triangle);
  to.handle_angle[1] = S(-0.3 * triangle);
  to.spool_velocity[0] = S(0.05 * triangle);
  to.load.wrench.force = {S(0.3 * triangle), S(-0.2 * triangle), S(0.1)};
  return to;
}

void at_rest_nothing_moves() {
  for (const bool quasi_static : {false, true}) {
    const auto t = twin<double>(quasi_static);
    auto state = t.rest(1);
    for (int k = 0; k < 100; ++k) CLAIM(t.step({}, state) == Status::ok);
    for (const double angle : state.angle) CLAIM(abs(angle) < 1e-14);
    for (const auto& tendon : state.tendon) CLAIM(abs(tendon.tension[0] - 30) < 1e-9);
  }
}

void single_precision_follows_double() {
  const auto exact = twin<double>(false);
  const auto rough = twin<float>(false);
  auto a = exact.rest(1);
  auto b = rough.rest(1);
  for (int k = 0; k < 2000; ++k) {
    CLAIM(exact.step(command<double>(k), a) == Status::ok);
    CLAIM(rough.step(command<float>(k), b) == Status::ok);
    for (int i = 0; i < 2; ++i) CLAIM(abs(a.angle[i] - double(b.angle[i])) < 2e-4);
  }
}

void a_refused_step_leaves_the_state() {
  const auto t = twin<double>(false);
  auto state = t.rest(1);
  for (int k = 0; k < 50; ++k) CLAIM(t.step(command<double>(k), state) == Status::ok);
  const auto before = state;
  auto wrong = command<double>(50);
  wrong.spool_velocity[3] = std::numeric_limits<double>::quiet_NaN();
  CLAIM(t.step(wrong, state) == Status::not_finite);
  wrong = command<double>(50);
  wrong.handle_angle[1] = 3.2;
  CLAIM(t.step(wrong, state) == Status::out_of_range);
  wrong = command<double>(50);
  wrong.load.wrench.force.x = 1e6;
  CLAIM(t.step(wrong, state) == Status::no_equilibrium);
  for (int g = 0; g < 4; ++g) CLAIM(state.angle[g] == before.angle[g]);
  for (int m = 0; m < 4; ++m) CLAIM(state.tendon[m].tension[0] == before.tendon[m].tension[0]);
}

}  // namespace

int main() {
  at_rest_nothing_moves();
  single_precision_follows_double();
  a_refused_step_leaves_the_state();
  return claims::report();
}

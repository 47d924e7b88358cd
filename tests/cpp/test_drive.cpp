// Claims about a drive: its limits are kept, its loop lags by its time constant, and its play is felt by a slack
// tendon.

#include "tenodesis/drive.hpp"

#include <algorithm>
#include <random>

#include "claim.hpp"

using namespace tenodesis;

constexpr double time_step = 1e-3;  // s
constexpr double taut = 10;         // N

void speed_and_acceleration_keep_their_limits() {
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  std::uniform_real_distribution<double> pick(-100, 100);
  const Drive<double> drive{0.01, 30, 500, 0.002, 0};
  DriveState<double> state{};
  double command = 0, fastest = 0, hardest = 0;
  for (int i = 0; i < 20'000; ++i) {
    if (i % 40 == 0) command = pick(random);
    const DriveState<double> before = state;
    state = advance(drive, before, command, taut, time_step);
    const double acceleration = std::fabs(state.speed - before.speed) / time_step;
    fastest = std::max(fastest, std::fabs(state.speed));
    hardest = std::max(hardest, acceleration);
    CLAIM_NEAR(state.angle - before.angle, (before.speed + state.speed) / 2 * time_step, 1e-12);
  }
  CLAIM(fastest <= 30 * (1 + 1e-12));
  CLAIM(hardest <= 500 * (1 + 1e-9));
  CLAIM(fastest > 29);
  CLAIM(hardest > 499);
}

void the_loop_lags_by_its_time_constant() {
  // Backward Euler's error over a second is first order in the step.
  double error[2];
  for (int fine = 0; fine < 2; ++fine) {
    const double step = fine == 0 ? 1e-3 : 5e-4;
    const Drive<double> drive{0.01, 100, 1e9, 0.05, 0};
    DriveState<double> state{};
    double worst = 0;
    for (int i = 1; i * step <= 0.3; ++i) {
      state = advance(drive, state, 20.0, taut, step);
      worst = std::max(worst, std::fabs(state.speed - 20 * (1 - std::exp(-i * step / 0.05))));
    }
    error[fine] = worst;
  }
  CLAIM(error[0] <= 20 * 0.02 / 2 * 0.5);
  CLAIM_NEAR(error[0] / error[1], 2, 0.05);
}

void a_loop_without_lag_follows_at_once() {
  const Drive<double> drive{0.01, 100, 1e9, 0, 0};
  CLAIM_NEAR(advance(drive, {}, 20.0, taut, time_step).speed, 20, 1e-12);
  CLAIM_NEAR(advance(drive, {}, -20.0, taut, time_step).speed, -20, 1e-12);
}

void a_constant_acceleration_turns_the_spool_by_the_parabola() {
  const Drive<double> drive{0.01, 1000, 50, 0, 0};
  DriveState<double> state{};
  for (int i = 1; i <= 100; ++i) {
    state = advance(drive, state, 1000.0, taut, time_step);
    const double time = i * time_step;
    CLAIM_NEAR(state.angle, 25 * time * time, 1e-12);
    CLAIM(state.spool == state.angle);
  }
}

void a_taut_tendon_keeps_the_spool_on_the_flank_that_unwinds() {
  const Drive<double> drive{0.01, 30, 1e9, 0, 0.02};
  DriveState<double> state{};
  for (int i = 0; i < 400; ++i) {
    state = advance(drive, state, i < 200 ? 5.0 : -5.0, taut, time_step);
    CLAIM_NEAR(state.spool, state.angle - 0.01, 1e-15);
  }
}

void a_slack_tendon_lets_the_gearbox_play() {
  const Drive<double> drive{0.01, 30, 1e9, 0, 0.02};
  DriveState<double> state{};
  int still = 0;
  for (int i = 0; i < 400; ++i) {
    const DriveState<double> before = state;
    state = advance(drive, before, i < 200 ? 5.0 : -5.0, 0.0, time_step);
    CLAIM(std::fabs(state.spool - state.angle) <= 0.01 + 1e-15);
    const double way = i < 200 ? 1 : -1;
    CLAIM((state.spool - before.spool) * way >= 0);
    const bool stood = state.spool == before.spool;
    if (stood) ++still;
    // What moves is pushed by the flank behind it.
    if (!stood) CLAIM_NEAR(state.spool, state.angle - way * 0.01, 1e-15);
  }
  // The motor crosses half the play at the start and all of it at the reversal, 0.005 rad a step: 2 steps and 4.
  CLAIM(still >= 5 && still <= 7);
}

int main() {
  speed_and_acceleration_keep_their_limits();
  the_loop_lags_by_its_time_constant();
  a_loop_without_lag_follows_at_once();
  a_constant_acceleration_turns_the_spool_by_the_parabola();
  a_taut_tendon_keeps_the_spool_on_the_flank_that_unwinds();
  a_slack_tendon_lets_the_gearbox_play();
  return claims::report();
}

#pragma once
// A bench with faults to inject, with the watch and the supervisor that suit it.

#include <algorithm>
#include <cmath>

#include "tenodesis/sensor.hpp"
#include "tenodesis/supervisor.hpp"
#include "tenodesis/watch.hpp"

using namespace tenodesis;

constexpr double period = 5e-4;                       // s
constexpr double pretension = 25, stiffness = 11451;  // N, N/m
constexpr double spool_radius = 5e-3;                 // m
constexpr double count_of_encoder = 2 * pi / 4096;    // rad
constexpr double count_of_cell = 400.0 / 65536;       // N
constexpr Drive<double> real_drive{spool_radius, 20, 400, 0.012, 0};
constexpr auto seed = 1;

template <class S>
Watch<S> watch() {
  Watch<S> all{};
  const auto set = [&](Fault fault, double threshold, double persistence) {
    all.limit[static_cast<int>(fault)] = {S(threshold), S(persistence)};
  };
  set(Fault::tendon_break, 2, 0.010);
  set(Fault::tendon_slack, 1, 2);
  set(Fault::over_tension, 100, 0.003);
  set(Fault::load_cell_stuck, 0.01, 0.040);
  set(Fault::load_cell_range, 2, 0.005);
  set(Fault::load_cell_drift, 2.5, 0.5);
  set(Fault::encoder_dropout, 0.1, 0.005);
  set(Fault::encoder_jump, 30, 1.2 * period);
  set(Fault::spool_slip, 3, 0.010);
  set(Fault::motor_not_following, 0.008, 0.005);
  set(Fault::tick_late, 0.025, 0);
  all.spool_jump = {S(60), S(1.2 * period)};
  all.drive = {S(spool_radius), S(20), S(400), S(0.010), S(0)};
  all.pretension = S(pretension);
  all.stiffness = S(stiffness);
  all.mean_band = S(0.35);
  all.load_cell_range = S(200);
  all.handle_range = S(0.7854);
  all.handle_noise = S(0.01);
  all.spool_noise = S(2.5 * count_of_encoder);
  all.period = S(period);
  return all;
}

template <class S>
Supervisor<S> supervisor(SafeState safe = SafeState::hold) {
  return {S(20), S(400), S(0.2), S(100), safe, StopMode::back, S(0.5), S(0.2), S(0.2), S(period)};
}

/// Signals of a working instrument, with faults to inject.
struct Bench {
  Noise noise{seed};
  DriveState<double> spool[2]{};
  double command[2]{};   // rad/s
  double handle{};       // rad
  double load{};         // N between the tendons
  double friction{};     // share of the mean tension
  double lost[2]{};      // spool angle that does not wind, rad
  double left[2]{1, 1};  // share of a tension that is left; 1: the tendon is intact
  bool stalled[2]{};

  void step(double dt = period) {
    for (int i = 0; i < 2; ++i) spool[i] = advance(real_drive, spool[i], stalled[i] ? 0 : command[i], 1.0, dt);
  }

  double tension(int i) const {
    const double wound = spool_radius * (spool[0].angle + spool[1].angle - lost[0] - lost[1]) / 2;
    const double mean = std::max(0.0, (pretension + stiffness * wound) * (1 + friction));
    const double half = load / 2;
    // With one tendon slack, the other carries the load.
    if (std::fabs(half) > mean) return left[i] * ((i == agonist) == (load > 0) ? std::fabs(load) : 0);
    return left[i] * (mean + (i == agonist ? half : -half));
  }

  Measurement<double> read() {
    const Sensor<double> cell{1, 0, 0.03, -200, 200, count_of_cell};
    const Sensor<double> joint{1, 0, 5.2e-4, -pi, pi, count_of_encoder};
    const Sensor<double> motor{1, 0, 0, -1e3, 1e3, count_of_encoder};
    Measurement<double> seen{};
    seen.handle_angle = joint.read(handle, noise);
    for (int i = 0; i < 2; ++i) {
      seen.tension[i] = cell.read(tension(i), noise);
      seen.spool_angle[i] = motor.read(spool[i].angle, noise);
    }
    return seen;
  }
};

template <class S>
WatchState<S> homed() {
  WatchState<S> state{};
  state.homed = true;
  return state;
}

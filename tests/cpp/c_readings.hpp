#pragma once
// Parameters and readings for claims about the C interface.

#include <cmath>
#include <limits>
#include <random>

#include "scaled_up.h"
#include "tenodesis/tenodesis.h"

using Number = tenodesis_real;

constexpr int two = TENODESIS_AXES;
constexpr auto seed = 1;

inline tenodesis_parameters parameters(unsigned joint_type, unsigned axes) {
  tenodesis_parameters p = scaled_up;
  p.joint_type = joint_type;
  p.axes = axes;
  p.own_clock = 0;
  if (joint_type == TENODESIS_CONTINUUM) {
    p.axis[0].backbone_length = Number(0.03);
    p.axis[0].backbone_rigidity = Number(5e-3);
  }
  p.axis[1] = p.axis[0];
  p.axis[1].pretension = Number(20);
  return p;
}

/// What the sensors of an instrument held against a load say; now and then what they cannot.
class Readings {
 public:
  tenodesis_input at(int tick) {
    tenodesis_input input{};
    input.time = 1000U + static_cast<std::uint64_t>(tick) * 500000U;
    if (tick % 1000 == 0) input.request = TENODESIS_REQUEST_ENABLE;
    if (tick % 1000 == 900) input.request = TENODESIS_REQUEST_CLEAR;
    if (tick % 1000 == 700) input.request = TENODESIS_REQUEST_PAUSE;
    for (int n = 0; n < two; ++n) {
      auto& each = input.axis[n];
      each.handle_angle = Number(0.5 * std::sin(tick * 0.002));
      for (int i = 0; i < 2; ++i) {
        const double load = i == 0 ? 3 : -3;
        const double noise = std::uniform_real_distribution<>(-0.05, 0.05)(random_);
        each.tension[i] = Number(25 - 5 * n + load + noise) + stiffness * radius * spool_[n][i];
        each.spool_angle[i] = spool_[n][i];
      }
    }
    if (tick % 1000 == bad_tick) input.axis[0].tension[1] = std::numeric_limits<Number>::quiet_NaN();
    return input;
  }

  void follow(const tenodesis_output& output) {
    for (int n = 0; n < two; ++n) {
      for (int i = 0; i < 2; ++i) {
        speed_[n][i] += (output.axis[n].spool_velocity[i] - speed_[n][i]) * Number(0.05);
        spool_[n][i] += speed_[n][i] * Number(5e-4);
      }
    }
  }

  static constexpr int bad_tick = 800;

 private:
  static constexpr Number stiffness = Number(11451), radius = Number(0.005);  // N/m, m

  std::mt19937 random_{seed};  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  Number spool_[two][2]{}, speed_[two][2]{};
};

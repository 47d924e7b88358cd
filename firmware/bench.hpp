#pragma once
// Simulates the sensors and motors of a board: two tendons of the scaled-up instrument at a straight handle, on spools
// that follow their commands exactly.

#include "tenodesis/tenodesis.h"

class Bench {
 public:
  void measure(tenodesis_measurement& measured) {
    noise_ = -noise_;  // a reading that never flickers counts as stuck
    measured = {};
    for (int i = 0; i < 2; ++i) {
      measured.spool_angle[i] = angle_[i];
      measured.tension[i] = pretension + stiffness * radius * angle_[i] + noise_;
    }
  }

  void drive(int tendon, float velocity, float seconds) { angle_[tendon] += velocity * seconds; }

 private:
  static constexpr float pretension = 25, stiffness = 11451, radius = 0.005F;  // N, N/m, m

  float angle_[2]{};  // rad
  float noise_{0.03F};
};

// Claims about dither: how far and how fast drives turn the spools, and when the tip counts as on target.

#include "tenodesis/dither.hpp"

#include <algorithm>

#include "claim.hpp"
#include "tenodesis/drive.hpp"

using namespace tenodesis;

constexpr double dt = 5e-4;              // s
constexpr double amplitude = 50e-6;      // m
constexpr double acceleration = 2;       // m/s^2
constexpr double spool_radius = 5e-3;    // m
constexpr double tension = 20;           // N
constexpr double after_transient = 0.1;  // s

template <class S>
void drives_turn_the_spools_as_far_as_asked_within_their_acceleration() {
  for (const double time_constant : {1e-3, 5e-3, 10e-3, 30e-3}) {
    const Drive<S> drive{S(spool_radius), S(20), S(acceleration / spool_radius), S(time_constant), S(0)};
    DitherState<S> state = begin_dither(S(amplitude), S(acceleration), S(time_constant));
    CLAIM(state.rate <= S(tuning::dither_fastest) * S(1.000001));
    DriveState<S> spool{};
    double least = 1, most = -1, before = 0, quickest = 0;
    for (int n = 0; n * dt < 0.5; ++n) {
      const double speed = double(dither(S(0), S(1), S(dt), state));
      if (n > 0) quickest = std::max(quickest, std::abs(speed - before) / dt);
      before = speed;
      spool = advance(drive, spool, S(speed / spool_radius), S(tension), S(dt));
      if (n * dt < after_transient) continue;
      least = std::min(least, double(spool.spool) * spool_radius);
      most = std::max(most, double(spool.spool) * spool_radius);
    }
    CLAIM_NEAR((most - least) / 2, amplitude, 0.05 * amplitude);
    CLAIM(quickest < 1.05 * acceleration);
  }
}

template <class S>
void a_small_dither_is_no_faster_than_its_limit() {
  const DitherState<S> state = begin_dither(S(1e-6), S(acceleration), S(10e-3));
  CLAIM_NEAR(double(state.rate), tuning::dither_fastest, 1e-3);
}

template <class S>
void the_mean_error_of_a_period_is_judged_and_not_what_alternates() {
  for (const double mean : {0.0, 2.0}) {
    DitherState<S> state = begin_dither(S(amplitude), S(acceleration), S(10e-3));
    int periods = 0;
    for (int n = 0; n * dt < 0.5; ++n) {
      const bool was_rising = state.cosine > S(0);
      dither(S(mean) + S(5) * state.cosine, S(1), S(dt), state);
      if (!was_rising && state.cosine > S(0)) ++periods;
    }
    CLAIM(periods > 5);
    // The first is no whole one.
    CLAIM(state.settled == (mean == 0.0 ? periods - 1 : 0));
  }
}

template <class S>
void in_one_precision() {
  drives_turn_the_spools_as_far_as_asked_within_their_acceleration<S>();
  a_small_dither_is_no_faster_than_its_limit<S>();
  the_mean_error_of_a_period_is_judged_and_not_what_alternates<S>();
}

int main() {
  in_one_precision<double>();
  in_one_precision<float>();
  return claims::report();
}

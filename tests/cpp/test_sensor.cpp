// Claims about sensors: their noise has the moments it is said to have, and their converter its steps and its range.

#include "tenodesis/sensor.hpp"

#include <algorithm>

#include "claim.hpp"

using namespace tenodesis;

constexpr int draws = 1'000'000;
constexpr int pairs = 100'000;

template <class S>
void noise_is_nearly_normal() {
  Noise noise{42};
  double sum = 0, square = 0, cube = 0, fourth = 0, largest = 0;
  for (int i = 0; i < draws; ++i) {
    const auto v = double(noise.normal<S>());
    sum += v;
    square += v * v;
    cube += v * v * v;
    fourth += v * v * v * v;
    largest = std::max(largest, std::fabs(v));
  }
  // Five standard errors of each moment.
  const double root = std::sqrt(double(draws));
  CLAIM_NEAR(sum / draws, 0, 5 / root);
  CLAIM_NEAR(square / draws, 1, 5 * std::sqrt(2.0) / root);
  CLAIM_NEAR(cube / draws, 0, 5 * std::sqrt(15.0) / root);
  // Of 32 coins of fourth cumulant -1/8 and a uniform number's -1/120, over the variance squared.
  const double excess = (32 * -0.125 - 1.0 / 120) / ((8 + 1.0 / 12) * (8 + 1.0 / 12));
  CLAIM_NEAR(excess, -0.06, 0.002);
  CLAIM_NEAR(fourth / draws, 3 + excess, 5 * std::sqrt(96.0) / root);
  CLAIM(largest <= 16.5 / std::sqrt(8 + 1.0 / 12) + 1e-6);
  CLAIM(largest > 4);
}

// Correlation of two streams, one of them late.
double correlation(std::uint64_t seed, std::uint64_t other, int late) {
  Noise a{seed}, b{other};
  for (int i = 0; i < late; ++i) b.bits();
  double sum = 0;
  for (int i = 0; i < pairs; ++i) sum += a.normal<double>() * b.normal<double>();
  return sum / pairs;
}

void streams_are_independent_of_each_other_and_of_their_own_past() {
  const double five_errors = 5 / std::sqrt(double(pairs));
  for (const std::uint64_t seed : {0U, 1U, 2U, 3U, 1000U}) {
    for (int late = 0; late < 3; ++late) {
      CLAIM_NEAR(correlation(seed, seed + 1, late), 0, five_errors);
      CLAIM_NEAR(correlation(seed, ~seed, late), 0, five_errors);
    }
    for (int late = 1; late < 8; ++late) CLAIM_NEAR(correlation(seed, seed, late), 0, five_errors);
  }
}

void a_copy_repeats_the_stream() {
  Noise noise{7};
  noise.bits();
  Noise copy = noise;
  for (int i = 0; i < 100; ++i) CLAIM(noise.normal<double>() == copy.normal<double>());
}

int main() {
  noise_is_nearly_normal<double>();
  noise_is_nearly_normal<float>();
  streams_are_independent_of_each_other_and_of_their_own_past();
  a_copy_repeats_the_stream();
  return claims::report();
}

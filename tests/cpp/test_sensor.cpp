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

void a_reading_is_the_nearest_step_of_the_converter() {
  const Sensor<double> sensor{1, 0, 0, -10, 10, 0.125};
  Noise noise{1};
  for (int i = -1000; i <= 1000; ++i) {
    const double value = i * 0.0077;
    const double reading = sensor.read(value, noise);
    CLAIM(std::fabs(reading - value) <= 0.125 / 2);
    CLAIM(reading / 0.125 == std::nearbyint(reading / 0.125));
  }
}

void a_reading_stays_in_range() {
  const Sensor<double> sensor{1, 0, 0.1, -2, 3, 0.01};
  Noise noise{1};
  CLAIM(sensor.read(50.0, noise) == 3);
  CLAIM(sensor.read(-50.0, noise) == -2);
  for (int i = 0; i < 1000; ++i) {
    const double reading = sensor.read(3.0, noise);
    CLAIM(reading >= -2 && reading <= 3);
  }
}

void gain_bias_and_noise_are_what_they_say() {
  const Sensor<double> sensor{0.8, 0.5, 0.2, -100, 100, 1e-6};
  Noise noise{3};
  double sum = 0, square = 0;
  for (int i = 0; i < draws; ++i) {
    const double off = sensor.read(10.0, noise) - 8.5;
    sum += off;
    square += off * off;
  }
  CLAIM_NEAR(sum / draws, 0, 5 * 0.2 / std::sqrt(double(draws)));
  CLAIM_NEAR(std::sqrt(square / draws), 0.2, 5 * 0.2 / std::sqrt(2.0 * draws));
}

int main() {
  noise_is_nearly_normal<double>();
  noise_is_nearly_normal<float>();
  streams_are_independent_of_each_other_and_of_their_own_past();
  a_copy_repeats_the_stream();
  a_reading_is_the_nearest_step_of_the_converter();
  a_reading_stays_in_range();
  gain_bias_and_noise_are_what_they_say();
  return claims::report();
}

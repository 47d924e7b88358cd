// Claims about the hand's intent: what counts as tremor and is taken away, and what passes.

#include "tenodesis/intent.hpp"

#include <random>

#include "claim.hpp"

using namespace tenodesis;

constexpr double degree = pi / 180;
constexpr double dt = 5e-4;             // s
constexpr double play = 0.02 * degree;  // half the width of noise

template <class S>
struct Fixture {
  IntentState<S> state{};
  double time{};
  double least{}, most{}, apart{};  // of the intent, and its largest distance from the handle, rad

  /// Follows a handle, rad by time; what is noted is noted anew.
  template <class Handle>
  void follow_for(double seconds, const Handle& handle) {
    least = 1e9, most = -1e9, apart = 0;
    for (const double until = time + seconds; time < until; time += dt) {
      follow(S(play), S(handle(time)), S(dt), state);
      const auto angle = double(state.angle);
      least = std::fmin(least, angle), most = std::fmax(most, angle);
      apart = std::fmax(apart, std::fabs(handle(time) - angle));
    }
  }
};

auto sine(double frequency, double amplitude, double middle = 0) {
  return [=](double time) { return middle + amplitude * std::sin(2 * pi * frequency * time); };
}

template <class S>
void tremor_is_taken_away() {
  for (const double frequency : {6.0, 7.0, 10.0, 12.0})
    for (const double amplitude : {0.1 * degree, 0.3 * degree, degree}) {
      Fixture<S> fixture;
      const auto handle = sine(frequency, amplitude, 0.3);
      fixture.follow_for(3, handle);
      fixture.follow_for(2, handle);
      CLAIM(fixture.most - fixture.least < 0.15 * 2 * amplitude);
      CLAIM_NEAR((fixture.most + fixture.least) / 2, 0.3, 0.15 * amplitude);
      CLAIM_NEAR(double(fixture.state.amplitude) / amplitude, 1.2, 0.15);
      CLAIM_NEAR(double(fixture.state.pulsation) / (2 * pi * frequency), 1, 0.02);
    }
}

template <class S>
void slow_motion_passes_but_for_the_play() {
  Fixture<S> fixture;
  fixture.follow_for(5, sine(1, 5 * degree));
  CLAIM(fixture.apart <= play * (1 + 1e-3));
  CLAIM(fixture.state.amplitude == S(0) && fixture.state.speed == S(0));
}

template <class S>
void a_hand_that_means_to_move_is_followed_through_its_tremor() {
  const double tremor = 0.2 * degree;
  const auto meant = sine(1, 3 * degree);
  Fixture<S> fixture;
  const auto handle = [&](double time) { return meant(time) + sine(8, tremor)(time); };
  fixture.follow_for(5, handle);
  CLAIM(fixture.apart < 1.5 * tremor);
}

template <class S>
void a_single_step_is_no_tremor() {
  Fixture<S> fixture;
  const auto handle = [](double time) { return time > 1 && time < 1.05 ? degree : 0.0; };
  fixture.follow_for(2, handle);
  CLAIM(fixture.state.amplitude == S(0));
  CLAIM(std::fabs(double(fixture.state.angle)) <= play * (1 + 1e-3));
}

template <class S>
void a_still_noisy_handle_does_not_tremble() {
  std::minstd_rand random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  std::uniform_real_distribution<double> noise(-play / 2, play / 2);
  Fixture<S> fixture;
  fixture.follow_for(20, [&](double) { return 0.5 + noise(random); });
  CLAIM(fixture.state.amplitude == S(0));
  CLAIM(fixture.state.tremor == S(0) && fixture.state.speed == S(0) && fixture.state.speed_after(S(0.02)) == S(0));
}

template <class S>
void tremor_that_has_ended_is_forgotten() {
  Fixture<S> fixture;
  fixture.follow_for(3, sine(7, degree));
  fixture.follow_for(6, [](double) { return degree; });
  CLAIM_NEAR(double(fixture.state.angle), degree, play * 1.001);
  CLAIM_NEAR(double(fixture.state.speed), 0, 1e-6);
}

// Smoothed once, a speed is late by the time constant, and its own rate by twice as much: on average by 1.5.
template <class S>
void the_speed_of_a_sine_is_predicted() {
  const double delay = 0.02;
  for (const double frequency : {6.0, 8.0, 10.0}) {
    const double amplitude = 0.3 * degree;
    const double pulsation = 2 * pi * frequency;
    Fixture<S> fixture;
    fixture.follow_for(3, sine(frequency, amplitude));
    double off = 0;
    for (int n = 0; n < 1000; ++n) {
      fixture.follow_for(dt, sine(frequency, amplitude));
      const double ahead = fixture.time - dt + delay - 1.5 * tuning::tremor_smoothing;
      const double speed = amplitude * pulsation * std::cos(pulsation * ahead);
      off = std::fmax(off, std::fabs(double(fixture.state.speed_after(S(delay))) - speed));
    }
    CLAIM(off < 0.15 * amplitude * pulsation);
  }
}

template <class S>
void any_finite_handle_gives_finite_numbers() {
  std::minstd_rand random(2);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  std::uniform_real_distribution<double> power(-40, 38);
  std::bernoulli_distribution positive;
  Fixture<S> fixture;
  fixture.follow_for(10, [&](double) { return std::pow(10.0, power(random)) * (positive(random) ? 1 : -1); });
  const auto& state = fixture.state;
  CLAIM(all_finite(state.angle, state.amplitude, state.pulsation, state.tremor, state.speed, state.acceleration));
  CLAIM(is_finite(state.speed_after(S(0.02))));
  CLAIM(state.amplitude <= S(tuning::tremor_limit));
}

template <class S>
void in_one_precision() {
  tremor_is_taken_away<S>();
  slow_motion_passes_but_for_the_play<S>();
  a_hand_that_means_to_move_is_followed_through_its_tremor<S>();
  a_single_step_is_no_tremor<S>();
  a_still_noisy_handle_does_not_tremble<S>();
  tremor_that_has_ended_is_forgotten<S>();
  the_speed_of_a_sine_is_predicted<S>();
  any_finite_handle_gives_finite_numbers<S>();
}

int main() {
  in_one_precision<double>();
  in_one_precision<float>();
  return claims::report();
}

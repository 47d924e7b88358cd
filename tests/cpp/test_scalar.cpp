// Claims about number types and joints: series match the C library, dual numbers finite differences.

#include "claim.hpp"
#include "instruments.hpp"
#include "tenodesis/joint.hpp"
#include "tenodesis/packed_dual.hpp"

using namespace tenodesis;

// In extended precision, since the difference cancels.
double bow(double u) {
  const long double wide = u;
  return double((wide - sinl(wide)) / (wide * wide));
}

// By Simpson's rule.
double rise(double u) {
  const int parts = 200;
  const auto rate = [](double v) { return v == 0 ? 0.5 : 2 * std::pow(std::sin(v / 2) / v, 2); };
  double sum = 0;
  for (int n = 0; n < parts; ++n) {
    const double from = u * n / parts, to = u * (n + 1) / parts;
    sum += (rate(from) + 4 * rate((from + to) / 2) + rate(to)) / 6;
  }
  return sum / parts;
}

template <class S>
void series_match_the_c_library(double tolerance) {
  for (int i = -2000; i <= 2000; ++i) {
    const double x = i / 2000.0;
    CLAIM_NEAR(double(tenodesis::asin(S(x))), std::asin(double(S(x))), tolerance * 2);
    const double quarter = x * pi / 2;
    CLAIM_NEAR(double(sin_quarter(S(quarter))), std::sin(double(S(quarter))), tolerance);
    const auto half = double(S(x * pi));
    if (i != 0) CLAIM_NEAR(double(S(half) * bow_of_square(S(half) * S(half))), bow(half), tolerance * 2);
    CLAIM_NEAR(double(rise_of_square(S(half) * S(half))), rise(half), tolerance * 2 + 1e-12);
  }
}

template <class S>
void log_matches_the_c_library(double tolerance) {
  for (int i = -2000; i <= 2000; ++i) {
    const S v = S(std::exp(i / 25.0));
    CLAIM_NEAR(double(tenodesis::log(v)), std::log(double(v)),
               tolerance * std::max(1.0, std::abs(std::log(double(v)))));
  }
  CLAIM(tenodesis::log(S(1)) == S(0));
}

void asin_is_odd_and_exact_at_its_ends() {
  CLAIM(tenodesis::asin(0.0) == 0.0);
  CLAIM_NEAR(tenodesis::asin(1.0), pi / 2, 1e-16);
  CLAIM(tenodesis::asin(-0.3) == -tenodesis::asin(0.3));
  CLAIM(!is_finite(tenodesis::asin(1.0000001)));
}

template <class D>
void dual_numbers_match_finite_differences() {
  const auto f = [](const auto& a, const auto& b) {
    // Not the C library's, which are visible as well.
    using tenodesis::abs, tenodesis::asin, tenodesis::log, tenodesis::sqrt;
    return asin(sqrt(a * b) / (a + b)) - abs(b) * a / (b + 2.0) * log(a);
  };
  const double a = 0.7, b = 0.3, h = 1e-6;
  const D value = f(D::variable(a, 0), D::variable(b, 1));
  CLAIM_NEAR(value_of(value), f(a, b), 1e-15);
  CLAIM_NEAR(slope_of(value, 0), (f(a + h, b) - f(a - h, b)) / (2 * h), 1e-9);
  CLAIM_NEAR(slope_of(value, 1), (f(a, b + h) - f(a, b - h)) / (2 * h), 1e-9);
}

void wrap_angle_is_the_joints_own_angle() {
  CLAIM(TendonGear<double>::wrap_angle(-0.4) == 0.4);
  CLAIM(TendonPulley<double>::wrap_angle(0.4) == 0.4);
  CLAIM(TendonContinuum<double>::wrap_angle(-0.4) == 0.4);
}

void what_is_not_finite_is_told_apart() {
  CLAIM(is_finite(1.0));
  CLAIM(!is_finite(std::nan("")));
  CLAIM(!is_finite(HUGE_VAL));
  CLAIM(!is_finite(-HUGE_VAL));
}

// Distance to the next larger number.
template <class S>
double last_place(double of) {
  const S size = std::fabs(S(of));
  return double(std::nextafter(size, std::numeric_limits<S>::infinity())) - double(size);
}

template <class S>
void exp_matches_the_c_library_to_two_units_in_the_last_place(double range) {
  double worst = 0;
  for (int i = -200'000; i <= 200'000; ++i) {
    const S u = S(range * i / 200'000);
    const double expected = std::exp(double(u));
    worst = std::fmax(worst, std::fabs(double(tenodesis::exp(u)) - expected) / last_place<S>(expected));
  }
  CLAIM(worst <= 2);
  CLAIM(tenodesis::exp(S(0)) == S(1));
  CLAIM(tenodesis::exp(-S(0)) == S(1));
}

template <class S>
void round_finds_the_nearest_whole_number(double largest) {
  for (int i = -2000; i <= 2000; ++i) {
    const S u = S(i) / S(7);
    CLAIM(tenodesis::round(u) == std::nearbyint(u));
    CLAIM(tenodesis::round(S(i)) == S(i));
    CLAIM(tenodesis::round(S(i) + S(0.5)) == std::nearbyint(S(i) + S(0.5)));
  }
  CLAIM(double(tenodesis::round(S(largest - 1))) == largest - 1);
  CLAIM(double(tenodesis::round(S(1 - largest))) == 1 - largest);
}

void clamp_keeps_a_number_between_its_bounds() {
  CLAIM(clamp(0.5, -1.0, 1.0) == 0.5);
  CLAIM(clamp(-3.0, -1.0, 1.0) == -1.0);
  CLAIM(clamp(HUGE_VAL, -1.0, 1.0) == 1.0);
  CLAIM(clamp(2.0, 1.5, 1.5) == 1.5);
}

template <class J>
void the_tips_path_grows_by_its_arm(const J& joint) {
  const double h = 1e-5;
  CLAIM(joint.tip_path(0.0, 0.0) == 0.0);
  for (double angle = -2.5; angle <= 2.5; angle += 0.1) {
    const auto path = [&](double a) { return joint.tip_path(a, joint.coordinate(a)); };
    const double rate = (path(angle + h) - path(angle - h)) / (2 * h);
    CLAIM_NEAR(rate, joint.tangential_arm(joint.coordinate(angle)), 1e-11);
  }
}

int main() {
  the_tips_path_grows_by_its_arm(instruments::scaled_up<double>().distal);
  the_tips_path_grows_by_its_arm(instruments::pulley<double>().distal);
  the_tips_path_grows_by_its_arm(instruments::continuum<double>().distal);
  series_match_the_c_library<double>(2.3e-16);
  series_match_the_c_library<float>(2.4e-7);
  log_matches_the_c_library<double>(4e-16);
  log_matches_the_c_library<float>(2.4e-7);
  exp_matches_the_c_library_to_two_units_in_the_last_place<double>(700);
  exp_matches_the_c_library_to_two_units_in_the_last_place<float>(80);
  round_finds_the_nearest_whole_number<double>(0x1p51);
  round_finds_the_nearest_whole_number<float>(0x1p22);
  clamp_keeps_a_number_between_its_bounds();
  asin_is_odd_and_exact_at_its_ends();
  dual_numbers_match_finite_differences<Dual<double, 2>>();
#if defined(__GNUC__)
  dual_numbers_match_finite_differences<PackedDual>();
#endif
  what_is_not_finite_is_told_apart();
  wrap_angle_is_the_joints_own_angle();
  return claims::report();
}

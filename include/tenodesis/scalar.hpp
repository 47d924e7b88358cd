#pragma once
// The number types the core computes in: float, double and dual numbers over them.
//
// These functions need no math library. Build with -fno-math-errno, so that a square root is one instruction instead of
// a call.

#if !defined(__cpp_concepts) || __cpp_concepts < 201907L
#error "tenodesis needs a C++20 compiler: GCC 11, Clang 14, MSVC 19.30 or newer"
#endif
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) || defined(_M_FP_FAST)
#error "tenodesis must not be compiled with -ffast-math or /fp:fast: NaN could reach a motor, and exp would be wrong"
#endif
#if defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__)
#error "tenodesis must not be compiled with -funsafe-math-optimizations: exp relies on the order of operations"
#endif

#include <bit>
#include <compare>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <type_traits>
#if defined(_MSC_VER) && !defined(__clang__)
#include <cmath>
#endif

namespace tenodesis {

template <class S>
concept Real = std::floating_point<S>;

inline constexpr double pi = 3.14159265358979323846;

#if defined(_MSC_VER) && !defined(__clang__)
inline float sqrt(float v) { return std::sqrt(v); }
inline double sqrt(double v) { return std::sqrt(v); }
// Of a negative zero, too.
constexpr float abs(float v) { return v > 0 ? v : 0 - v; }
constexpr double abs(double v) { return v > 0 ? v : 0 - v; }
#else
inline float sqrt(float v) { return __builtin_sqrtf(v); }
inline double sqrt(double v) { return __builtin_sqrt(v); }
constexpr float abs(float v) { return __builtin_fabsf(v); }
constexpr double abs(double v) { return __builtin_fabs(v); }
#endif

/// False for NaN and both infinities.
template <Real S>
constexpr bool is_finite(S v) {
  return v - v == S(0);  // NOLINT(misc-redundant-expression): not for infinities and NaN
}

template <class S>
constexpr S square(const S& v) {
  return v * v;
}

template <Real... S>
constexpr bool all_finite(S... v) {
  return (is_finite(v) && ...);
}

/// The real value of a number, without a dual number's derivatives.
template <Real S>
constexpr S value_of(S v) {
  return v;
}

template <class S>
using ValueOf = decltype(value_of(S{}));

template <class S>
constexpr S smaller(const S& a, const S& b) {
  return a < b ? a : b;
}
template <class S>
constexpr S larger(const S& a, const S& b) {
  return a > b ? a : b;
}

/// One of two numbers, by whether a is above zero.
template <class S>
constexpr S if_above(const S& a, const S& above, const S& otherwise) {
  return a > S(0) ? above : otherwise;
}

/// What a number type has beside its numbers: conditions on them, choices by them, and random bits for them; for
/// numbers side by side see lanes.hpp.
template <class S>
struct SideBySide {
  using Flag = bool;
  template <class E>
  using Choice = E;
  using Count = int;
  using Word = std::uint64_t;
};

template <class S>
using Flag = SideBySide<S>::Flag;

/// Whether a condition holds in any lane.
constexpr bool any(bool condition) { return condition; }

/// One of two values, by a condition.
template <class T>
constexpr T where(bool condition, const T& then, const T& otherwise) {
  return condition ? then : otherwise;
}

/// One where a condition holds, else zero.
constexpr std::uint64_t one_where(bool condition) { return condition ? 1U : 0U; }

/// A whole number below 2^32 as a number.
template <Real S>
constexpr S number_of(std::uint64_t whole) {
  return S(static_cast<std::uint32_t>(whole));
}

namespace detail {

// Adding and subtracting so large a number rounds to the nearest integer.
template <Real S>
inline constexpr S rounding = S(std::int64_t(3) << (std::numeric_limits<S>::digits - 2));
inline constexpr double per_doubling = 1.4426950408889634074;  // 1 / ln 2
// ln 2 in two parts; the first has so few bits that its multiples are exact.
template <Real S>
inline constexpr S ln2_high = sizeof(S) == 4 ? S(0.693359375) : S(6.93147180369123816490e-1);
template <Real S>
inline constexpr S ln2_low = sizeof(S) == 4 ? S(-2.12194440e-4) : S(1.90821492927058770002e-10);

template <Real S, std::size_t N>
struct Series {
  S coefficient[N];

  // Horner's scheme in t^2 for even and odd terms side by side, which halves the latency; the first term apart, which
  // keeps the rounding small. By recursion, since an inner loop would prevent vectorisation of the outer one.
  template <class T>
  constexpr T operator()(const T& t) const {
    const T square = t * t;
    return (terms_from<2>(square) * t + terms_from<1>(square)) * t + T(coefficient[0]);
  }

 private:
  template <std::size_t n, class T>
  constexpr T terms_from(const T& square) const {
    if constexpr (n + 2 >= N)
      return T(coefficient[n]);
    else
      return terms_from<n + 2>(square) * square + T(coefficient[n]);
  }
};

// Lengths for which the first term left out is below half a unit in the last place on the stated range.
template <Real S>
inline constexpr std::size_t sinc_terms = sizeof(S) == 4 ? 7 : 11;  // |u| <= pi/2
template <Real S>
inline constexpr std::size_t arc_terms = sizeof(S) == 4 ? 12 : 24;  // |x| <= 1/2
template <Real S>
inline constexpr std::size_t bow_terms = sizeof(S) == 4 ? 9 : 15;  // |u| <= pi

template <Real S>
inline constexpr std::size_t rise_terms = bow_terms<S>;  // |u| <= pi

template <Real S>
inline constexpr std::size_t exp_terms = sizeof(S) == 4 ? 8 : 14;  // |u| <= ln(2)/2

template <Real S>
inline constexpr std::size_t log_terms = sizeof(S) == 4 ? 5 : 11;  // |s| <= 3 - sqrt(8)

template <Real S>
inline constexpr auto exp_series = [] {
  Series<S, exp_terms<S>> series{};
  double term = 1;
  for (std::size_t n = 0; n < exp_terms<S>; ++n) {
    series.coefficient[n] = S(term);
    term /= double(n + 1);
  }
  return series;
}();

// artanh(s)/s as a series in s^2: 1 / (2n+1)
template <Real S>
inline constexpr auto log_series = [] {
  Series<S, log_terms<S>> series{};
  for (std::size_t n = 0; n < log_terms<S>; ++n) series.coefficient[n] = S(1.0 / double(2 * n + 1));
  return series;
}();

// sin(u)/u as a series in u^2: (-1)^n / (2n+1)!
template <Real S>
inline constexpr auto sinc_series = [] {
  Series<S, sinc_terms<S>> series{};
  double term = 1;
  for (std::size_t n = 0; n < sinc_terms<S>; ++n) {
    series.coefficient[n] = S(term);
    term /= -double((2 * n + 2) * (2 * n + 3));
  }
  return series;
}();

// asin(x)/x as a series in x^2: (2n)! / (4^n n!^2 (2n+1))
template <Real S>
inline constexpr auto arc_series = [] {
  Series<S, arc_terms<S>> series{};
  double binomial = 1;
  for (std::size_t n = 0; n < arc_terms<S>; ++n) {
    series.coefficient[n] = S(binomial / double(2 * n + 1));
    binomial *= double(2 * n + 1) / double(2 * n + 2);
  }
  return series;
}();

// (u - sin u)/u^3 as a series in u^2: (-1)^n / (2n+3)!
template <Real S>
inline constexpr auto bow_series = [] {
  Series<S, bow_terms<S>> series{};
  double term = 1.0 / 6;
  for (std::size_t n = 0; n < bow_terms<S>; ++n) {
    series.coefficient[n] = S(term);
    term /= -double((2 * n + 4) * (2 * n + 5));
  }
  return series;
}();

// the integral of (1 - cos u)/u^2 from 0, over u, as a series in u^2: (-1)^n / ((2n+2)! (2n+1))
template <Real S>
inline constexpr auto rise_series = [] {
  Series<S, rise_terms<S>> series{};
  double term = 0.5;
  for (std::size_t n = 0; n < rise_terms<S>; ++n) {
    series.coefficient[n] = S(term / double(2 * n + 1));
    term /= -double((2 * n + 3) * (2 * n + 4));
  }
  return series;
}();

}  // namespace detail

/// sin(u)/u, given u^2; |u| <= pi/2.
template <class S>
constexpr S sinc_of_square(const S& square) {
  return detail::sinc_series<ValueOf<S>>(square);
}

/// (u - sin u)/u^3, given u^2; |u| <= pi.
template <class S>
constexpr S bow_of_square(const S& square) {
  return detail::bow_series<ValueOf<S>>(square);
}

/// The mean of (1 - cos v)/v^2 for v from 0 to u, given u^2; |u| <= pi.
template <class S>
constexpr S rise_of_square(const S& square) {
  return detail::rise_series<ValueOf<S>>(square);
}

/// Sine of an angle within a quarter turn, |u| <= pi/2, rad.
template <class S>
constexpr S sin_quarter(const S& u) {
  return u * sinc_of_square(u * u);
}

/// Inverse sine, |x| <= 1, in rad. Without a branch, so that a loop over it becomes vector instructions.
template <Real S>
inline S asin(S x) {
  const S size = abs(x);
  // asin x = pi/2 - 2 asin sqrt((1 - x)/2) keeps the series' argument below one half.
  const S near = x * x;
  const S far = (S(1) - size) * S(0.5);
  const S square = smaller(near, far);
  const S arc = sqrt(square) * detail::arc_series<S>(square);
  const S angle = size <= S(0.5) ? arc : S(pi / 2) - S(2) * arc;
  return x < S(0) ? -angle : angle;
}

/// Exponential; |u| below 80 in float, 700 in double.
template <Real S>
inline S exp(S u) {
  using Bits = std::conditional_t<sizeof(S) == 4, std::int32_t, std::int64_t>;
  constexpr int mantissa = std::numeric_limits<S>::digits - 1;
  const S doublings = (u * S(detail::per_doubling) + detail::rounding<S>)-detail::rounding<S>;
  const S rest = (u - doublings * detail::ln2_high<S>)-doublings * detail::ln2_low<S>;
  const Bits power = (Bits(doublings) + (std::numeric_limits<S>::max_exponent - 1)) << mantissa;
  return detail::exp_series<S>(rest) * std::bit_cast<S>(power);
}

/// Natural logarithm of a normal number above 0.
template <Real S>
inline S log(S v) {
  using Bits = std::conditional_t<sizeof(S) == 4, std::int32_t, std::int64_t>;
  constexpr int mantissa = std::numeric_limits<S>::digits - 1;
  // The power of two that leaves a number between sqrt(1/2) and sqrt(2).
  constexpr Bits root = std::bit_cast<Bits>(S(0.70710678118654752440));
  const Bits doublings = (std::bit_cast<Bits>(v) - root) >> mantissa;
  const S rest = std::bit_cast<S>(Bits(std::bit_cast<Bits>(v) - (doublings << mantissa)));
  const S share = (rest - S(1)) / (rest + S(1));
  return S(doublings) * S(0.69314718055994530942) + S(2) * share * detail::log_series<S>(share * share);
}

/// Nearest integer; |u| below 2^22 in float, 2^51 in double.
template <Real S>
inline S round(S u) {
  return (u + detail::rounding<S>)-detail::rounding<S>;
}

/// A number between bounds.
template <class S>
constexpr S clamp(const S& v, const S& low, const S& high) {
  return smaller(larger(v, low), high);
}

/// A value with its derivatives in N directions: forward-mode differentiation, exact to rounding.
template <class S, std::size_t N>
struct Dual {
  S value{};
  S slope[N]{};

  constexpr Dual() = default;
  constexpr Dual(const S& v) : value(v) {}  // NOLINT(misc-explicit-constructor): a constant is a dual number
  template <class T>
    requires(std::convertible_to<T, S> && !std::same_as<T, S>)
  constexpr explicit Dual(T v) : value(S(v)) {}

  /// The independent variable of one direction.
  static constexpr Dual variable(const S& v, std::size_t direction) {
    Dual dual(v);
    dual.slope[direction] = S(1);
    return dual;
  }

  friend constexpr Dual operator+(const Dual& a, const Dual& b) { return combine(a.value + b.value, a, S(1), b, S(1)); }
  friend constexpr Dual operator-(const Dual& a, const Dual& b) {
    return combine(a.value - b.value, a, S(1), b, S(-1));
  }
  friend constexpr Dual operator*(const Dual& a, const Dual& b) {
    return combine(a.value * b.value, a, b.value, b, a.value);
  }
  friend constexpr Dual operator/(const Dual& a, const Dual& b) {
    const S ratio = a.value / b.value;
    return combine(ratio, a, S(1) / b.value, b, -ratio / b.value);
  }
  friend constexpr Dual operator-(const Dual& a) { return chain(a, -a.value, S(-1)); }
  friend constexpr bool operator==(const Dual& a, const Dual& b) { return a.value == b.value; }
  friend constexpr auto operator<=>(const Dual& a, const Dual& b) { return a.value <=> b.value; }

  friend constexpr auto value_of(const Dual& a) {
    using tenodesis::value_of;
    return value_of(a.value);
  }
  /// The derivative in one direction.
  friend constexpr S slope_of(const Dual& a, std::size_t direction) { return a.slope[direction]; }
  friend Dual sqrt(const Dual& a) {
    using tenodesis::sqrt;
    const S root = sqrt(a.value);
    return chain(a, root, S(1) / (S(2) * root));
  }
  friend Dual exp(const Dual& a) {
    using tenodesis::exp;
    const S power = exp(a.value);
    return chain(a, power, power);
  }
  friend Dual log(const Dual& a) {
    using tenodesis::log;
    return chain(a, log(a.value), S(1) / a.value);
  }
  friend constexpr Dual abs(const Dual& a) { return a.value < S(0) ? -a : a; }
  friend Dual asin(const Dual& a) {
    using tenodesis::asin, tenodesis::sqrt;
    return chain(a, asin(a.value), S(1) / sqrt((S(1) - a.value) * (S(1) + a.value)));
  }

 private:
  static constexpr Dual chain(const Dual& a, const S& value, const S& derivative) {
    Dual result(value);
    for (std::size_t n = 0; n < N; ++n) result.slope[n] = derivative * a.slope[n];
    return result;
  }
  static constexpr Dual combine(const S& value, const Dual& a, const S& by_a, const Dual& b, const S& by_b) {
    Dual result(value);
    for (std::size_t n = 0; n < N; ++n) result.slope[n] = by_a * a.slope[n] + by_b * b.slope[n];
    return result;
  }
};

}  // namespace tenodesis

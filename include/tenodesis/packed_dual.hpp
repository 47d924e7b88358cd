#pragma once
// A dual number that fills vector registers: its value beside its slopes, so that both are loaded and added as one.

#include "tenodesis/lanes.hpp"

#if defined(__GNUC__)

namespace tenodesis {

/// A value with its derivatives in seven directions, as Dual has them.
class PackedDual {
 public:
  static constexpr std::size_t directions = 7;

  PackedDual() = default;
  // As for Lanes.
  [[gnu::always_inline]] PackedDual(const PackedDual& other) {
    for (int i = 0; i < parts; ++i) part_[i] = other.part_[i];
  }
  PackedDual& operator=(const PackedDual&) = default;
  PackedDual(double v) { part_[0][0] = v; }  // NOLINT(misc-explicit-constructor): a constant is a dual number
  template <class T>
    requires(std::convertible_to<T, double> && !std::same_as<T, double>)
  explicit PackedDual(T v) : PackedDual(double(v)) {}

  /// The independent variable of one direction.
  static PackedDual variable(double v, std::size_t direction) {
    PackedDual dual(v);
    dual.part_[(direction + 1) / width][(direction + 1) % width] = 1;
    return dual;
  }

  friend double value_of(const PackedDual& a) { return a.part_[0][0]; }
  friend double slope_of(const PackedDual& a, std::size_t direction) {
    return a.part_[(direction + 1) / width][(direction + 1) % width];
  }

  [[gnu::always_inline]] friend PackedDual operator+(const PackedDual& a, const PackedDual& b) {
    return combine(value_of(a) + value_of(b), a, 1, b, 1);
  }
  [[gnu::always_inline]] friend PackedDual operator-(const PackedDual& a, const PackedDual& b) {
    return combine(value_of(a) - value_of(b), a, 1, b, -1);
  }
  [[gnu::always_inline]] friend PackedDual operator*(const PackedDual& a, const PackedDual& b) {
    return combine(value_of(a) * value_of(b), a, value_of(b), b, value_of(a));
  }
  [[gnu::always_inline]] friend PackedDual operator/(const PackedDual& a, const PackedDual& b) {
    const double ratio = value_of(a) / value_of(b);
    return combine(ratio, a, 1 / value_of(b), b, -ratio / value_of(b));
  }
  [[gnu::always_inline]] friend PackedDual operator-(const PackedDual& a) { return chain(a, -value_of(a), -1); }
  friend bool operator==(const PackedDual& a, const PackedDual& b) { return value_of(a) == value_of(b); }
  friend auto operator<=>(const PackedDual& a, const PackedDual& b) { return value_of(a) <=> value_of(b); }

  friend PackedDual sqrt(const PackedDual& a) {
    const double root = tenodesis::sqrt(value_of(a));
    return chain(a, root, 1 / (2 * root));
  }
  friend PackedDual exp(const PackedDual& a) {
    const double power = tenodesis::exp(value_of(a));
    return chain(a, power, power);
  }
  friend PackedDual log(const PackedDual& a) { return chain(a, tenodesis::log(value_of(a)), 1 / value_of(a)); }
  friend PackedDual abs(const PackedDual& a) { return value_of(a) < 0 ? -a : a; }
  friend PackedDual asin(const PackedDual& a) {
    return chain(a, tenodesis::asin(value_of(a)), 1 / tenodesis::sqrt((1 - value_of(a)) * (1 + value_of(a))));
  }

 private:
  // What a compiler makes of wider vectors than the processor's is slow.
#if defined(__AVX512F__)
  static constexpr int width = 8;
#elif defined(__AVX__)
  static constexpr int width = 4;
#else
  static constexpr int width = 2;
#endif
  static constexpr int parts = (1 + int(directions)) / width;
  using Vector = detail::VectorOf<double, width>::Type;

  [[gnu::always_inline]] static PackedDual chain(const PackedDual& a, double value, double derivative) {
    return with(value, [&](int i) { return derivative * a.part_[i]; });
  }
  [[gnu::always_inline]] static PackedDual combine(double value, const PackedDual& a, double by_a, const PackedDual& b,
                                                   double by_b) {
    return with(value, [&](int i) { return by_a * a.part_[i] + by_b * b.part_[i]; });
  }
  // The value is put into a register, not into memory, from where the whole could not be loaded at once.
  template <class Part>
  [[gnu::always_inline]] static PackedDual with(double value, const Part& part) {
    PackedDual result;
    Vector first = part(0);
    first[0] = value;
    result.part_[0] = first;
    for (int i = 1; i < parts; ++i) result.part_[i] = part(i);
    return result;
  }

  Vector part_[parts]{};
};

}  // namespace tenodesis

#endif

#pragma once
// Numbers side by side in a vector register: the same computation on several points at once.
//
// A core function that does not branch on its numbers runs on lanes as it is; what it decides by branches is decided
// afterwards, lane by lane.

#include "tenodesis/scalar.hpp"

#if defined(__GNUC__)

namespace tenodesis {

namespace detail {

// The attribute does not take a type that is a template's parameter.
template <Real S, int N>
struct VectorOf;
template <int N>
struct VectorOf<double, N> {
  using Type [[gnu::vector_size(N * 8)]] = double;
};
template <int N>
struct VectorOf<float, N> {
  using Type [[gnu::vector_size(N * 4)]] = float;
};

}  // namespace detail

template <Real S, int N>
struct Lanes {
  using Vector = detail::VectorOf<S, N>::Type;

  Vector v{};

  constexpr Lanes() = default;
  // Not trivial, so that lanes are passed and returned in memory: a vector's own register depends on what the function
  // is compiled for, and callers are compiled for several processors.
  [[gnu::always_inline]] constexpr Lanes(const Lanes& other) : v(other.v) {}
  constexpr Lanes& operator=(const Lanes&) = default;
  // NOLINTBEGIN(misc-explicit-constructor): a constant in all lanes is lanes
  [[gnu::always_inline]] constexpr Lanes(Vector of) : v(of) {}
  [[gnu::always_inline]] constexpr Lanes(S same) : v(Vector{} + same) {}
  // NOLINTEND(misc-explicit-constructor)
  constexpr explicit Lanes(int same) : Lanes(S(same)) {}

  S operator[](int lane) const { return v[lane]; }

  [[gnu::always_inline]] friend constexpr Lanes operator+(const Lanes& a, const Lanes& b) { return {a.v + b.v}; }
  [[gnu::always_inline]] friend constexpr Lanes operator-(const Lanes& a, const Lanes& b) { return {a.v - b.v}; }
  [[gnu::always_inline]] friend constexpr Lanes operator*(const Lanes& a, const Lanes& b) { return {a.v * b.v}; }
  [[gnu::always_inline]] friend constexpr Lanes operator/(const Lanes& a, const Lanes& b) { return {a.v / b.v}; }
  [[gnu::always_inline]] friend constexpr Lanes operator-(const Lanes& a) { return {-a.v}; }

  [[gnu::always_inline]] friend Lanes larger(const Lanes& a, const Lanes& b) { return {a.v > b.v ? a.v : b.v}; }
  [[gnu::always_inline]] friend Lanes smaller(const Lanes& a, const Lanes& b) { return {a.v < b.v ? a.v : b.v}; }
  [[gnu::always_inline]] friend Lanes if_above(const Lanes& a, const Lanes& above, const Lanes& otherwise) {
    return {a.v > Vector{} ? above.v : otherwise.v};
  }
  [[gnu::always_inline]] friend Lanes abs(const Lanes& a) { return larger(a, -a); }
  [[gnu::always_inline]] friend Lanes sqrt(const Lanes& a) {
    Lanes root;
    for (int i = 0; i < N; ++i) root.v[i] = tenodesis::sqrt(a.v[i]);
    return root;
  }
  // As for a single number (scalar.hpp).
  [[gnu::always_inline]] friend Lanes asin(const Lanes& a) {
    const Lanes size = abs(a);
    const Lanes near = a * a;
    const Lanes far = (Lanes(S(1)) - size) * Lanes(S(0.5));
    const Lanes square = smaller(near, far);
    const Lanes arc = sqrt(square) * detail::arc_series<S>(square);
    const Lanes angle = if_above(size - Lanes(S(0.5)), Lanes(S(pi / 2)) - Lanes(S(2)) * arc, arc);
    return if_above(-a, -angle, angle);
  }
  /// The type of a lane, as ValueOf has it.
  friend constexpr S value_of(const Lanes& a) { return a.v[0]; }
};

}  // namespace tenodesis

#endif

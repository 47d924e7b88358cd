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
  constexpr Lanes(Vector of) : v(of) {}            // NOLINT(misc-explicit-constructor)
  constexpr Lanes(S same) : v(Vector{} + same) {}  // NOLINT(misc-explicit-constructor): a constant in all lanes
  constexpr explicit Lanes(int same) : Lanes(S(same)) {}

  S operator[](int lane) const { return v[lane]; }

  friend constexpr Lanes operator+(const Lanes& a, const Lanes& b) { return {a.v + b.v}; }
  friend constexpr Lanes operator-(const Lanes& a, const Lanes& b) { return {a.v - b.v}; }
  friend constexpr Lanes operator*(const Lanes& a, const Lanes& b) { return {a.v * b.v}; }
  friend constexpr Lanes operator/(const Lanes& a, const Lanes& b) { return {a.v / b.v}; }
  friend constexpr Lanes operator-(const Lanes& a) { return {-a.v}; }

  friend Lanes larger(const Lanes& a, const Lanes& b) { return {a.v > b.v ? a.v : b.v}; }
  friend Lanes smaller(const Lanes& a, const Lanes& b) { return {a.v < b.v ? a.v : b.v}; }
  friend Lanes if_above(const Lanes& a, const Lanes& above, const Lanes& otherwise) {
    return {a.v > Vector{} ? above.v : otherwise.v};
  }
  friend Lanes abs(const Lanes& a) { return larger(a, -a); }
  friend Lanes sqrt(const Lanes& a) {
    Lanes root;
    for (int i = 0; i < N; ++i) root.v[i] = tenodesis::sqrt(a.v[i]);
    return root;
  }
  friend Lanes asin(const Lanes& a) {
    Lanes arc;
    for (int i = 0; i < N; ++i) arc.v[i] = tenodesis::asin(a.v[i]);
    return arc;
  }
  /// The type of a lane, as ValueOf has it.
  friend constexpr S value_of(const Lanes& a) { return a.v[0]; }
};

}  // namespace tenodesis

#endif

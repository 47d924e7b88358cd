#pragma once
// Numbers side by side in a vector register: the same computation on several points at once.
//
// A core function that does not branch on its numbers runs on lanes as it is. What it chooses by where() is chosen in
// each lane; what it decides by branches is decided afterwards, lane by lane.

#include "tenodesis/scalar.hpp"

#if defined(__GNUC__)

#if defined(__AVX__)
#include <immintrin.h>
#endif

namespace tenodesis {

namespace detail {

// The attribute does not take a type that is a template's parameter.
template <class T, int N>
struct VectorOf;
template <int N>
struct VectorOf<double, N> {
  using Type [[gnu::vector_size(N * 8)]] = double;
};
template <int N>
struct VectorOf<float, N> {
  using Type [[gnu::vector_size(N * 4)]] = float;
};
template <int N>
struct VectorOf<std::int64_t, N> {
  using Type [[gnu::vector_size(N * 8)]] = std::int64_t;
};
template <int N>
struct VectorOf<std::int32_t, N> {
  using Type [[gnu::vector_size(N * 4)]] = std::int32_t;
};
template <int N>
struct VectorOf<std::uint64_t, N> {
  using Type [[gnu::vector_size(N * 8)]] = std::uint64_t;
};

template <Real S>
using BitsOf = std::conditional_t<sizeof(S) == 4, std::int32_t, std::int64_t>;

// Whether a bit is set anywhere; by halves, since a loop over the lanes would take each one out of the register.
template <class I, int N>
[[gnu::always_inline]] inline bool any_bit(const typename VectorOf<I, N>::Type& v) {
#if defined(__AVX512F__)
  if constexpr (sizeof(v) == sizeof(__m512i)) return _mm512_test_epi32_mask(__m512i(v), __m512i(v)) != 0;
#endif
#if defined(__AVX__)
  if constexpr (sizeof(v) == sizeof(__m256i)) return _mm256_testz_si256(__m256i(v), __m256i(v)) == 0;
#endif
  struct Halves {
    VectorOf<I, N / 2>::Type low, high;
  };
  const auto halves = std::bit_cast<Halves>(v);
  if constexpr (N == 2)
    return (halves.low[0] | halves.high[0]) != 0;
  else
    return any_bit<I, N / 2>(halves.low | halves.high);
}

}  // namespace detail

/// A condition in each lane.
template <Real S, int N>
struct Mask {
  using Bits = detail::BitsOf<S>;
  using Vector = detail::VectorOf<Bits, N>::Type;

  Vector v;  ///< all bits, or none

  // Not initialised, like a number: a step has many that it never reads.
  Mask() = default;
  // As for Lanes.
  [[gnu::always_inline]] constexpr Mask(const Mask& other) : v(other.v) {}
  constexpr Mask& operator=(const Mask&) = default;
  // NOLINTBEGIN(misc-explicit-constructor): what holds in all lanes is a mask
  [[gnu::always_inline]] constexpr Mask(Vector of) : v(of) {}
  [[gnu::always_inline]] constexpr Mask(bool same) : v(Vector{} - Bits(same)) {}
  // NOLINTEND(misc-explicit-constructor)

  template <class V>
  [[gnu::always_inline]] static constexpr Mask above(const V& a, const V& b) {
    return {a > b};
  }
  template <class V>
  [[gnu::always_inline]] static constexpr Mask not_below(const V& a, const V& b) {
    return {a >= b};
  }
  template <class V>
  [[gnu::always_inline]] static constexpr Mask equal(const V& a, const V& b) {
    return {a == b};
  }
  /// a where it holds, otherwise b.
  template <class V>
  [[gnu::always_inline]] constexpr V choose(const V& a, const V& b) const {
    return v ? a : b;
  }

  bool operator[](int lane) const { return v[lane] != 0; }
  void set(int lane, bool holds) { v[lane] = -Bits(holds); }

  // Both sides are evaluated, which they may be.
  [[gnu::always_inline]] friend constexpr Mask operator&&(const Mask& a, const Mask& b) { return {a.v & b.v}; }
  [[gnu::always_inline]] friend constexpr Mask operator||(const Mask& a, const Mask& b) { return {a.v | b.v}; }
  [[gnu::always_inline]] friend constexpr Mask operator!(const Mask& a) { return {~a.v}; }
  [[gnu::always_inline]] friend constexpr Mask operator!=(const Mask& a, const Mask& b) { return {a.v ^ b.v}; }
  [[gnu::always_inline]] friend constexpr Mask where(const Mask& mask, const Mask& a, const Mask& b) {
    return {(mask.v & a.v) | (~mask.v & b.v)};
  }
  [[gnu::always_inline]] friend bool any(const Mask& a) { return detail::any_bit<Bits, N>(a.v); }
  [[gnu::always_inline]] friend constexpr auto one_where(const Mask& a) {
    return typename detail::VectorOf<std::uint64_t, N>::Type(-a.v);
  }
};

#if defined(__AVX512F__)
/// As above; a bit for each lane, since these processors compare to bits and choose by them.
template <>
struct Mask<double, 8> {
  using Integers = detail::VectorOf<std::int64_t, 8>::Type;

  std::uint8_t bits;

  Mask() = default;
  // As for Lanes.
  [[gnu::always_inline]] constexpr Mask(const Mask& other) : bits(other.bits) {}
  constexpr Mask& operator=(const Mask&) = default;
  // NOLINTNEXTLINE(misc-explicit-constructor): what holds in all lanes is a mask
  [[gnu::always_inline]] constexpr Mask(bool same) : bits(same ? 0xFF : 0) {}
  [[gnu::always_inline]] constexpr explicit Mask(std::uint8_t of) : bits(of) {}

  [[gnu::always_inline]] static Mask above(__m512d a, __m512d b) { return Mask(_mm512_cmp_pd_mask(a, b, _CMP_GT_OQ)); }
  [[gnu::always_inline]] static Mask not_below(__m512d a, __m512d b) {
    return Mask(_mm512_cmp_pd_mask(a, b, _CMP_GE_OQ));
  }
  [[gnu::always_inline]] static Mask equal(__m512d a, __m512d b) { return Mask(_mm512_cmp_pd_mask(a, b, _CMP_EQ_OQ)); }
  [[gnu::always_inline]] static Mask equal(const Integers& a, const Integers& b) {
    return Mask(_mm512_cmpeq_epi64_mask(__m512i(a), __m512i(b)));
  }
  [[gnu::always_inline]] __m512d choose(__m512d a, __m512d b) const { return _mm512_mask_blend_pd(bits, b, a); }
  [[gnu::always_inline]] Integers choose(const Integers& a, const Integers& b) const {
    return Integers(_mm512_mask_blend_epi64(bits, __m512i(b), __m512i(a)));
  }

  bool operator[](int lane) const { return (bits >> lane & 1) != 0; }
  void set(int lane, bool holds) { bits = std::uint8_t((bits & ~(1 << lane)) | int(holds) << lane); }

  [[gnu::always_inline]] friend constexpr Mask operator&&(const Mask& a, const Mask& b) { return of(a.bits & b.bits); }
  [[gnu::always_inline]] friend constexpr Mask operator||(const Mask& a, const Mask& b) { return of(a.bits | b.bits); }
  [[gnu::always_inline]] friend constexpr Mask operator!(const Mask& a) { return of(~a.bits); }
  [[gnu::always_inline]] friend constexpr Mask operator!=(const Mask& a, const Mask& b) { return of(a.bits ^ b.bits); }
  [[gnu::always_inline]] friend constexpr Mask where(const Mask& mask, const Mask& a, const Mask& b) {
    return of((mask.bits & a.bits) | (~mask.bits & b.bits));
  }
  [[gnu::always_inline]] friend bool any(const Mask& a) { return a.bits != 0; }
  [[gnu::always_inline]] friend auto one_where(const Mask& a) {
    return detail::VectorOf<std::uint64_t, 8>::Type(_mm512_maskz_set1_epi64(a.bits, 1));
  }

 private:
  [[gnu::always_inline]] static constexpr Mask of(int bits) { return Mask(std::uint8_t(bits)); }
};
#endif

template <Real S, int N>
struct Lanes {
  using Vector = detail::VectorOf<S, N>::Type;
  using Bits = detail::BitsOf<S>;
  using Integers = detail::VectorOf<Bits, N>::Type;

  Vector v;

  Lanes() = default;
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
  void set(int lane, S to) { v[lane] = to; }

  [[gnu::always_inline]] friend constexpr Lanes operator+(const Lanes& a, const Lanes& b) { return {a.v + b.v}; }
  [[gnu::always_inline]] friend constexpr Lanes operator-(const Lanes& a, const Lanes& b) { return {a.v - b.v}; }
  [[gnu::always_inline]] friend constexpr Lanes operator*(const Lanes& a, const Lanes& b) { return {a.v * b.v}; }
  [[gnu::always_inline]] friend constexpr Lanes operator/(const Lanes& a, const Lanes& b) { return {a.v / b.v}; }
  [[gnu::always_inline]] friend constexpr Lanes operator-(const Lanes& a) { return {-a.v}; }

  [[gnu::always_inline]] friend constexpr Mask<S, N> operator>(const Lanes& a, const Lanes& b) {
    return Mask<S, N>::above(a.v, b.v);
  }
  [[gnu::always_inline]] friend constexpr Mask<S, N> operator>=(const Lanes& a, const Lanes& b) {
    return Mask<S, N>::not_below(a.v, b.v);
  }
  [[gnu::always_inline]] friend constexpr Mask<S, N> operator==(const Lanes& a, const Lanes& b) {
    return Mask<S, N>::equal(a.v, b.v);
  }
  [[gnu::always_inline]] friend constexpr Mask<S, N> operator<(const Lanes& a, const Lanes& b) { return b > a; }
  [[gnu::always_inline]] friend constexpr Mask<S, N> operator<=(const Lanes& a, const Lanes& b) { return b >= a; }
  [[gnu::always_inline]] friend constexpr Mask<S, N> operator!=(const Lanes& a, const Lanes& b) { return !(a == b); }
  [[gnu::always_inline]] friend constexpr Lanes where(const Mask<S, N>& mask, const Lanes& a, const Lanes& b) {
    return {Vector(mask.choose(a.v, b.v))};
  }

  [[gnu::always_inline]] friend Lanes larger(const Lanes& a, const Lanes& b) { return {a.v > b.v ? a.v : b.v}; }
  [[gnu::always_inline]] friend Lanes smaller(const Lanes& a, const Lanes& b) { return {a.v < b.v ? a.v : b.v}; }
  [[gnu::always_inline]] friend Lanes if_above(const Lanes& a, const Lanes& above, const Lanes& otherwise) {
    return {a.v > Vector{} ? above.v : otherwise.v};
  }
  [[gnu::always_inline]] friend Lanes abs(const Lanes& a) {
    return {Vector(Integers(a.v) & std::numeric_limits<Bits>::max())};
  }
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
  [[gnu::always_inline]] friend Lanes round(const Lanes& a) {
    const Lanes large(detail::rounding<S>);
    return (a + large) - large;
  }
  [[gnu::always_inline]] friend Lanes exp(const Lanes& a) {
    const Lanes large(detail::rounding<S>);
    const Lanes shifted = a * Lanes(S(detail::per_doubling)) + large;
    const Lanes doublings = shifted - large;
    const Lanes rest = (a - doublings * Lanes(detail::ln2_high<S>)) - doublings * Lanes(detail::ln2_low<S>);
    // The lowest bits of what was rounded that way are the integer.
    constexpr int mantissa = std::numeric_limits<S>::digits - 1;
    const Integers power = (Integers(shifted.v) + (std::numeric_limits<S>::max_exponent - 1)) << mantissa;
    return detail::exp_series<S>(rest) * Lanes(Vector(power));
  }
  /// The type of a lane, as ValueOf has it.
  friend constexpr S value_of(const Lanes& a) { return a.v[0]; }
};

/// A choice in each lane, of an enumeration.
template <class E, Real S, int N>
struct LanesOf {
  using Vector = detail::VectorOf<detail::BitsOf<S>, N>::Type;

  Vector v;

  LanesOf() = default;
  // As for Lanes.
  [[gnu::always_inline]] constexpr LanesOf(const LanesOf& other) : v(other.v) {}
  constexpr LanesOf& operator=(const LanesOf&) = default;
  // NOLINTNEXTLINE(misc-explicit-constructor): the same choice in all lanes
  [[gnu::always_inline]] constexpr LanesOf(E same) : v(Vector{} + detail::BitsOf<S>(same)) {}

  E operator[](int lane) const { return E(v[lane]); }
  void set(int lane, E to) { v[lane] = detail::BitsOf<S>(to); }

  [[gnu::always_inline]] friend constexpr Mask<S, N> operator==(const LanesOf& a, const LanesOf& b) {
    return Mask<S, N>::equal(a.v, b.v);
  }
  [[gnu::always_inline]] friend constexpr Mask<S, N> operator!=(const LanesOf& a, const LanesOf& b) {
    return !(a == b);
  }
  [[gnu::always_inline]] friend constexpr LanesOf where(const Mask<S, N>& mask, const LanesOf& a, const LanesOf& b) {
    LanesOf chosen;
    chosen.v = mask.choose(a.v, b.v);
    return chosen;
  }
};

/// In lanes, what one number has as bool, as an enumeration, as int and as 64 bits.
template <Real S, int N>
struct SideBySide<Lanes<S, N>> {
  using Flag = Mask<S, N>;
  template <class E>
  using Choice = LanesOf<E, S, N>;
  using Count = Lanes<S, N>;
  using Word = detail::VectorOf<std::uint64_t, N>::Type;
};

/// Whole numbers below 2^32 as numbers, lane by lane.
template <class L>
  requires(!Real<L>)
[[gnu::always_inline]] inline L number_of(const typename SideBySide<L>::Word& whole) {
  static_assert(std::same_as<ValueOf<L>, double>);
  // As the lowest bits of 2^52, which is then taken away.
  constexpr double large = 4503599627370496.0;
  return L(typename L::Vector(whole | std::bit_cast<std::uint64_t>(large))) - L(large);
}

}  // namespace tenodesis

#endif

#pragma once
// Vectors and rotations in space; rotations are unit quaternions, made from sine and cosine of half an angle.

#include "tenodesis/scalar.hpp"

namespace tenodesis {

template <class S>
struct Vector {
  S x{}, y{}, z{};

  friend constexpr Vector operator+(const Vector& a, const Vector& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
  friend constexpr Vector operator-(const Vector& a, const Vector& b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
  friend constexpr Vector operator*(const S& by, const Vector& a) { return {by * a.x, by * a.y, by * a.z}; }
};

template <class S>
constexpr S dot(const Vector<S>& a, const Vector<S>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}

template <class S>
constexpr Vector<S> cross(const Vector<S>& a, const Vector<S>& b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

/// Which coordinate axis a direction lies along, where that is known when this is compiled.
enum class Along : unsigned char { any, x, y };

/// A direction along x or y, by its size there.
template <class S, Along along>
struct Direction {
  S size{};
};

template <class S>
constexpr Vector<S> vector_of(const Vector<S>& v) {
  return v;
}
template <class S, Along along>
constexpr Vector<S> vector_of(const Direction<S, along>& a) {
  if constexpr (along == Along::x)
    return {a.size, S(0), S(0)};
  else
    return {S(0), a.size, S(0)};
}

template <class S, Along along>
constexpr S dot(const Direction<S, along>& a, const Vector<S>& v) {
  return a.size * (along == Along::x ? v.x : v.y);
}

template <class S, Along along>
constexpr Vector<S> cross(const Direction<S, along>& a, const Vector<S>& v) {
  if constexpr (along == Along::x)
    return {S(0), -(a.size * v.z), a.size * v.y};
  else
    return {a.size * v.z, S(0), -(a.size * v.x)};
}

/// Turned about a direction, by the sine and cosine of the angle.
template <class S, Along along>
constexpr Vector<S> turned(const Direction<S, along>& about, const Vector<S>& v, const S& sine, const S& cosine) {
  const S s = about.size * sine;
  if constexpr (along == Along::x)
    return {v.x, cosine * v.y - s * v.z, cosine * v.z + s * v.y};
  else
    return {cosine * v.x + s * v.z, v.y, cosine * v.z - s * v.x};
}
/// The same about a unit vector.
template <class S>
constexpr Vector<S> turned(const Vector<S>& about, const Vector<S>& v, const S& sine, const S& cosine) {
  return cosine * v + sine * cross(about, v) + ((S(1) - cosine) * dot(about, v)) * about;
}

/// A unit quaternion.
template <class S>
struct Rotation {
  S w{S(1)}, x{}, y{}, z{};

  friend constexpr Rotation operator*(const Rotation& a, const Rotation& b) {
    return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
            a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
  }
  friend constexpr Vector<S> operator*(const Rotation& r, const Vector<S>& v) {
    const Vector<S> axis{r.x, r.y, r.z};
    const Vector<S> twice = S(2) * cross(axis, v);
    return v + r.w * twice + cross(axis, twice);
  }
  constexpr Rotation inverse() const { return {w, -x, -y, -z}; }
};

/// Sine and cosine of half an angle, rad; a full turn more changes the sign of both, which is the same rotation.
template <class S>
struct HalfTurn {
  S sine{}, cosine{};

  explicit HalfTurn(const S& angle) {
    using V = ValueOf<S>;
    const V turns = round(value_of(angle) * V(0.5 / pi));
    const S half = (angle - S(turns * V(2 * pi))) * S(0.5);
    const S quarter = sin_quarter(half * S(0.5));
    sine = sin_quarter(half);
    cosine = S(1) - S(2) * quarter * quarter;
  }
};

template <class S>
Rotation<S> about_x(const S& angle) {
  const HalfTurn<S> half(angle);
  return {half.cosine, half.sine, S(0), S(0)};
}
template <class S>
Rotation<S> about_y(const S& angle) {
  const HalfTurn<S> half(angle);
  return {half.cosine, S(0), half.sine, S(0)};
}
template <class S>
Rotation<S> about_z(const S& angle) {
  const HalfTurn<S> half(angle);
  return {half.cosine, S(0), S(0), half.sine};
}

/// About an axis, a unit vector.
template <class S, class C>
Rotation<S> about(const Vector<C>& axis, const S& angle) {
  const HalfTurn<S> half(angle);
  return {half.cosine, half.sine * S(axis.x), half.sine * S(axis.y), half.sine * S(axis.z)};
}

template <class S>
S norm(const Vector<S>& v) {
  return sqrt(dot(v, v));
}

/// Angle from x to y of a point of the plane that is not the origin, within half a turn, rad.
template <class S>
S angle_of(const S& y, const S& x) {
  const S away = sqrt(x * x + y * y) + abs(x);
  // Half the angle from the nearer side of the x axis, whose sine is at most sin(pi/4).
  const S near = S(2) * asin(y / sqrt(away * away + y * y));
  if (!(x < S(0))) return near;
  return (y < S(0) ? S(-pi) : S(pi)) - near;
}

}  // namespace tenodesis

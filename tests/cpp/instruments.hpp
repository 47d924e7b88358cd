#pragma once
// The paper's two instruments (Table I) and one of each other mechanism, for the core's tests.

#include "tenodesis/axis.hpp"

namespace instruments {

template <class S>
constexpr tenodesis::GearAxis<S> real_size() {
  return {{S(4.5e-3), S(0.120)}, {S(2e-3), S(0.050)}, S(31172), S(30), S(0.7854)};
}

template <class S>
constexpr tenodesis::GearAxis<S> scaled_up() {
  return {{S(16.875e-3), S(0.160)}, {S(7.5e-3), S(0.086)}, S(11451), S(25), S(0.7854)};
}

template <class S>
constexpr tenodesis::PulleyAxis<S> pulley() {
  return {{S(4.5e-3), S(0.120)}, {S(2e-3), S(0.050)}, S(31172), S(30), S(0.7854)};
}

template <class S>
constexpr tenodesis::ContinuumAxis<S> continuum() {
  return {{S(4.5e-3), S(0.120)}, {S(2e-3), S(0.010), S(0.020), S(2e-4)}, S(31172), S(30), S(0.7854)};
}

}  // namespace instruments

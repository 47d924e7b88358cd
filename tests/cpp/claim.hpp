#pragma once
// A claim is a condition that must hold; the program counts those that do not and prints them.

#include <cmath>
#include <cstdio>

namespace claims {

inline int kept = 0;
inline int broken = 0;

inline void check(bool holds, const char* claim, const char* file, int line) {
  ++(holds ? kept : broken);
  if (!holds) std::printf("%s:%d: broken: %s\n", file, line, claim);
}

inline void check_near(double a, double b, double tolerance, const char* claim, const char* file, int line) {
  const bool holds = std::fabs(a - b) <= tolerance;
  check(holds, claim, file, line);
  if (!holds) std::printf("    %.17g and %.17g differ by %.3g, allowed %.3g\n", a, b, std::fabs(a - b), tolerance);
}

inline int report() {
  std::printf("%d claims kept, %d broken\n", kept, broken);
  return broken == 0 && kept > 0 ? 0 : 1;
}

}  // namespace claims

#define CLAIM(condition) claims::check((condition), #condition, __FILE__, __LINE__)
#define CLAIM_NEAR(a, b, tolerance) claims::check_near((a), (b), (tolerance), #a " = " #b, __FILE__, __LINE__)

// Prints the output angle of the scaled-up instrument, rad, at a handle angle of 0.3 rad and a load of 1 N.
#include <cstdio>

#include "tenodesis/statics.hpp"
#include "tenodesis/version.h"

int main() {
  const double stiffness = tenodesis::tendon_stiffness(50e9, 0.54e-3, 1.0);
  const tenodesis::GearAxis<double> axis{{16.875e-3, 0.160}, {7.5e-3, 0.086}, stiffness, 25.0, tenodesis::pi / 4};
  const auto angle = tenodesis::output_angle(axis, 0.3, tenodesis::Load<double>{1.0});
  std::printf("%d.%d.%d %.17g\n", TENODESIS_VERSION_MAJOR, TENODESIS_VERSION_MINOR, TENODESIS_VERSION_PATCH,
              angle.value);
  return angle.status == tenodesis::Status::ok ? 0 : 1;
}

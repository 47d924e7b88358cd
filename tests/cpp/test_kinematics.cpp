// Claims about the instrument in space: the inverse leads back, in either precision and for every mechanism, and it
// says so where it does not.

#include "tenodesis/kinematics.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "claim.hpp"
#include "instruments.hpp"

using namespace tenodesis;
using instruments::chain_of, instruments::Toward;

constexpr int postures = 500;

template <class S>
S off(const Frame<S>& a, const Frame<S>& b) {
  return norm(a.position - b.position);
}

/// Sine of half the angle between two orientations.
template <class S>
S turned(const Frame<S>& a, const Frame<S>& b) {
  const Rotation<S> r = a.rotation.inverse() * b.rotation;
  return norm(Vector<S>{r.x, r.y, r.z});
}

template <class A>
void the_inverse_leads_back(const A& axis, int axes, Toward first, double tolerance) {
  using S = A::Scalar;
  const Chain<S, 2> chain = chain_of(axis, axes, first);
  std::mt19937 random(7);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  const auto within = [&](double most) { return S(std::uniform_real_distribution<double>(-most, most)(random)); };
  double worst = 0, worst_bend = 0;
  for (int n = 0; n < postures; ++n) {
    Posture<S, 2> at{
        within(1.05), within(1.05), within(1.5), S(0.15) + within(0.09), {within(1.39), within(1.39)}, within(3.1), {}};
    if (axes == 1) at.bend[1] = S(0);
    const Frame<S> goal = bodies(chain, at).end[axes - 1];
    const Reached<S, 2> found = inverse(chain, goal, at.spin);
    CLAIM(found.reach == Reach::ok);
    const Frame<S> tip = bodies(chain, found.posture).end[axes - 1];
    worst = std::max({worst, double(off(goal, tip)), double(turned(goal, tip))});
    // Beyond 60 deg of the second joint, a goal may have other postures than the one it comes from.
    if (std::fabs(double(at.bend[1])) < 1.04)
      worst_bend = std::max(worst_bend, std::fabs(double(found.posture.bend[0] - at.bend[0])));
    const Reached<S, 2> near = inverse(chain, goal, at.spin, Start<S>{true, at.pan, at.tilt});
    CLAIM(near.reach == Reach::ok);
    CLAIM_NEAR(double(near.posture.pan), double(at.pan), 1e4 * tolerance);
  }
  CLAIM(worst < tolerance);
  CLAIM(worst_bend < 1e2 * tolerance);
  std::printf("tip off by %.1e at most, first bend by %.1e\n", worst, worst_bend);
}

template <class S>
void every_mechanism_leads_back(double tolerance) {
  for (const int axes : {1, 2})
    for (const Toward first : {Toward::yaw, Toward::pitch}) {
      the_inverse_leads_back(instruments::real_size<S>(), axes, first, tolerance);
      the_inverse_leads_back(instruments::scaled_up<S>(), axes, first, tolerance);
      the_inverse_leads_back(instruments::pulley<S>(), axes, first, tolerance);
      the_inverse_leads_back(instruments::continuum<S>(), axes, first, tolerance);
    }
}

void what_cannot_be_reached_is_named() {
  const auto chain = chain_of(instruments::real_size<double>(), 2, Toward::yaw);
  const double nan = std::nan("");
  CLAIM(inverse(chain, Frame<double>{{nan, 0, 0.1}, {}}, 0.0).reach == Reach::not_finite);
  CLAIM(inverse(chain, Frame<double>{{0, 0, 0.2}, {}}, HUGE_VAL).reach == Reach::not_finite);
  // The end-effector alone is 50 mm long: with the tip 30 mm beyond the port it would have to lie within it.
  CLAIM(inverse(chain, Frame<double>{{0, 0, 0.03}, {}}, 0.0).reach == Reach::unreachable);
  // Straight on, the middle of the joints at the port: no pan or tilt moves it.
  const double middle = 0.05 + (4 * 0.002 + 0.004) / 2;
  CLAIM(inverse(chain, Frame<double>{{0, 0, middle}, {}}, 0.0).reach != Reach::ok);
  auto side_by_side = chain;
  side_by_side.tip[1].parent = -1;
  CLAIM(inverse(side_by_side, Frame<double>{{0, 0, 0.2}, {}}, 0.0).reach == Reach::other_joints);
}

void angles_come_back_in_every_quadrant() {
  for (double angle = -3.14; angle < 3.14; angle += 0.01) {
    CLAIM_NEAR(angle_of(std::sin(angle), std::cos(angle)), angle, 1e-15 * 4);
    const Rotation<double> r = about_z(angle + 8 * pi);
    const Vector<double> v = r * Vector<double>{1, 0, 0};
    CLAIM_NEAR(v.x, std::cos(angle), 1e-14);
    CLAIM_NEAR(v.y, std::sin(angle), 1e-14);
  }
}

int main() {
  angles_come_back_in_every_quadrant();
  every_mechanism_leads_back<double>(1e-13);
  every_mechanism_leads_back<float>(1e-5);
  what_cannot_be_reached_is_named();
  return claims::report();
}

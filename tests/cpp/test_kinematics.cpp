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

/// The far gear rolls on the fixed one: the arcs that the contact travels on both are equal, and centres stay apart.
void a_gear_pair_rolls_without_slip() {
  const auto chain = chain_of(instruments::real_size<double>(), 1, Toward::yaw);
  const double r = chain.tip[0].chord / 2;
  for (const double angle : {-1.2, 0.3, 1.4}) {
    Posture<double, 2> at{};
    at.bend[0] = angle;
    const Bodies<double, 2> found = bodies(chain, at);
    CLAIM_NEAR(norm(found.tip[0].far.position - found.stem.position), 2 * r, 1e-16);
    const Vector<double> apart = found.tip[0].far.position - found.stem.position;
    const double on_fixed = std::atan2(apart.x, apart.z);
    const Vector<double> back = found.tip[0].far.rotation.inverse() * (-1.0 * apart);
    const double on_far = std::atan2(back.x, -back.z);
    CLAIM_NEAR(on_fixed, angle / 2, 1e-15);
    CLAIM_NEAR(on_far, on_fixed, 1e-15);
  }
}

/// Joints in a tree, of any axis: the Jacobian of each end is what finite differences tell.
void an_end_moves_as_its_jacobian_tells() {
  const auto backbone = instruments::joint_of(instruments::continuum<double>().distal);
  const auto gear = instruments::joint_of(instruments::real_size<double>().distal);
  const auto pulley = instruments::joint_of(instruments::pulley<double>().distal);
  Chain<double, 4> chain{.joints = 4, .stem_length = 0.3};
  const int parents[] = {-1, 0, 1, 1};
  const Vector<double> axes[] = {{0, 1, 0}, {-0.6, 0.8, 0}, {0, 0.6, 0.8}, {1, 0, 0}};
  const ChainJoint<double> joints[] = {backbone, gear, pulley, backbone};
  for (int i = 0; i < 4; ++i) {
    chain.tip[i] = joints[i];
    chain.tip[i].parent = parents[i];
    chain.tip[i].axis = axes[i];
    chain.tip[i].offset = 0.003;
  }
  const Posture<double, 4> at{0.3, -0.4, 0.5, 0.1, {0.7, -0.6, 0.5, 0.9}, 0.4, {}};
  const auto moved = [&](int column, double by) {
    Posture<double, 4> to = at;
    double* const all[] = {&to.pan,     &to.tilt,    &to.spin,    &to.insertion, to.bend,
                           to.bend + 1, to.bend + 2, to.bend + 3, &to.roll};
    *all[column] += by;
    return to;
  };
  constexpr double step = 1e-5;
  for (const int end : {2, 3}) {
    const auto rates = jacobian(chain, at, end);
    for (int column = 0; column < 9; ++column) {
      const Frame<double> before = bodies(chain, moved(column, -step)).end[end];
      const Frame<double> after = bodies(chain, moved(column, step)).end[end];
      CLAIM(norm((0.5 / step) * (after.position - before.position) - rates.linear[column]) < 1e-10);
      const Rotation<double> turned = after.rotation * before.rotation.inverse();
      CLAIM(norm((1 / step) * Vector<double>{turned.x, turned.y, turned.z} - rates.angular[column]) < 1e-9);
    }
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
  a_gear_pair_rolls_without_slip();
  every_mechanism_leads_back<double>(1e-13);
  every_mechanism_leads_back<float>(1e-5);
  an_end_moves_as_its_jacobian_tells();
  what_cannot_be_reached_is_named();
  return claims::report();
}

// Claims about the equilibrium solve, over every mechanism and number type.

#include <initializer_list>

#include "claim.hpp"
#include "instruments.hpp"
#include "tenodesis/statics.hpp"

using namespace tenodesis;

constexpr double degree = pi / 180;

template <class A>
double residual(const A& axis, double handle, const Load<double>& load, const Stroke<double>& wound, double x) {
  const auto pair = TendonPair<double>::at_handle(axis, handle, wound);
  const auto& joint = axis.distal;
  const double moment = pair.tensions(x).difference() * joint.moment_arm(x) -
                        joint.passive_stiffness() * joint.angle(x) - load.force * joint.tangential_arm(x) +
                        load.radial_force * joint.radial_arm(x);
  return moment / joint.moment_arm(0.0);
}

template <class A>
void every_equilibrium_balances_the_moments(const A& axis) {
  int solved = 0, slack = 0;
  for (double handle = -40; handle <= 40; handle += 4)
    for (double force = -3; force <= 3; force += 0.25)
      for (double radial : {-8.0, 0.0, 8.0})
        for (double wound : {-1.5e-3, 0.0, 4e-4}) {
          const Load<double> load{force, radial};
          const Stroke<double> stroke{wound, 0};
          const auto at = equilibrium(axis, handle * degree, load, stroke);
          CLAIM(at.iterations <= most_balances);
          if (at.status != Status::ok) continue;
          ++solved;
          const auto tension = TendonPair<double>::at_handle(axis, handle * degree, stroke).tensions(at.coordinate);
          slack += tension.agonist == 0 || tension.antagonist == 0;
          CLAIM(tension.agonist >= 0 && tension.antagonist >= 0);
          CLAIM_NEAR(residual(axis, handle * degree, load, stroke, at.coordinate), 0, 1e-9);
        }
  CLAIM(solved > 2500);
  CLAIM(slack > 300);
}

// Where small steps of load from no load on lead, and the share of the load at which they lose the branch (1: never).
struct Followed {
  double x;
  double share;
  double least_slope;  // relative to the first
};

template <class A>
Followed follow(const A& axis, const TendonPair<double>& pair, const Load<double>& full, double x) {
  const int steps = 4000;
  double first = 0, least = 1e300;
  for (int n = 1; n <= steps; ++n) {
    const Load<double> load{full.force * n / steps, full.radial_force * n / steps};
    for (int k = 0; k < 4; ++k) {
      const auto at = balance(axis.distal, pair, load, x);
      const double weight = axis.distal.demand(x, load).weight;
      if (n == 1 && k == 0) first = -at.slope / weight;
      least = std::fmin(least, -at.slope / weight);
      const double next = x - at.correction;
      if (!(at.slope < 0) || std::fabs(at.correction) > 0.05 || !(std::fabs(next) < axis.distal.limit()))
        return {x, double(n) / steps, least / first};
      x = next;
    }
  }
  return {x, 1, least / first};
}

template <class A>
void the_branch_is_the_one_that_grows_out_of_no_load(const A& axis, int least_lost) {
  int kept = 0, lost = 0;
  for (double handle = -36; handle <= 36; handle += 6)
    for (double force : {-2.5, -0.8, 0.02, 0.8, 2.5})
      for (double radial : {0.0, 15.0, -15.0, 60.0, 200.0})
        for (double wound : {0.0, 3e-4}) {
          const Load<double> load{force, radial};
          const auto pair = TendonPair<double>::at_handle(axis, handle * degree, {wound, 0});
          const double start = unloaded_coordinate(axis.distal, pair);
          if (!(std::fabs(start) < axis.distal.limit())) continue;
          const Followed followed = follow(axis, pair, load, start);
          const auto solved = equilibrium(axis, handle * degree, load, {wound, 0});
          if (followed.share < 0.999) {
            ++lost;
            CLAIM(solved.status != Status::ok);
          } else if (followed.share == 1 && followed.least_slope > 0.02) {
            ++kept;
            CLAIM(solved.status == Status::ok);
            CLAIM_NEAR(solved.coordinate, followed.x, 1e-9);
          }
        }
  CLAIM(kept > 300);
  CLAIM(lost >= least_lost);
}

void loose_tendons_hold_the_tip_only_at_the_end_of_their_gap() {
  const auto axis = instruments::real_size<double>();
  int held = 0, free = 0;
  for (double handle = -30; handle <= 30; handle += 5)
    for (double force : {-0.4, -0.001, 0.001, 0.1, 0.4})
      for (double radial : {0.0, -0.5, 0.5, 20.0})
        for (double out : {-1.1e-3, -2e-3, -4e-3, -8e-3}) {
          const Stroke<double> wound{out, -2e-3};
          const Load<double> load{force, radial};
          const auto at = equilibrium(axis, handle * degree, load, wound);
          if (at.status != Status::ok) {
            ++free;
            continue;
          }
          ++held;
          const auto tension = TendonPair<double>::at_handle(axis, handle * degree, wound).tensions(at.coordinate);
          CLAIM(tension.agonist == 0 || tension.antagonist == 0);
          CLAIM_NEAR(residual(axis, handle * degree, load, wound, at.coordinate), 0, 1e-9);
          const double angle = axis.distal.angle(at.coordinate);
          const auto back = handle_angle(axis, angle, load, wound);
          CLAIM(back.status == Status::ok);
          CLAIM_NEAR(back.value, handle * degree, 1e-10);
        }
  CLAIM(held > 300 && free > 50);
  // Nothing holds these: the end of the gap is out of reach, or the radial force alone keeps the tip where it is.
  CLAIM(equilibrium(axis, 0.5, Load<double>{-0.01, 0}, Stroke<double>{-2e-3, -8e-3}).status == Status::unreachable);
  CLAIM(equilibrium(axis, 0.1, Load<double>{0.001, -0.5}, Stroke<double>{-3e-3, -3e-3}).status == Status::both_slack);
}

void a_continuum_bends_on_to_its_limit_without_a_gap() {
  const ContinuumAxis<double> axis{{35.15625e-3, 0.125}, {11.71875e-3, 0.0625, 0.09375, 3.90625e-3}, 628.3185, 25, 0.6};
  double before = 10;
  int solved = 0;
  for (double force = 0; force <= 11; force += 0.01) {
    const auto tip = output_angle(axis, 0.5, Load<double>{force, 0});
    if (tip.status != Status::ok) {
      CLAIM(tip.status == Status::unreachable);
      CLAIM(before < -3.1);
      continue;
    }
    ++solved;
    CLAIM(tip.value < before && before - tip.value < (solved == 1 ? 10 : 0.02));
    before = tip.value;
  }
  CLAIM(solved > 1000 && solved < 1100);
}

void a_radial_force_can_snap_a_continuum() {
  const ContinuumAxis<double> axis{{4.5e-3, 0.120}, {2e-3, 0.010, 0.020, 2e-4}, 12566.37, 30, 0.7854};
  const auto at = [&](double share) {
    return output_angle(axis, -0.0601934, Load<double>{0.98625 * share, 28.623 * share});
  };
  CLAIM(at(0.97).status == Status::ok);
  CLAIM(at(1.0).status == Status::no_equilibrium);
}

void past_the_fold_there_is_no_equilibrium() {
  const auto axis = instruments::real_size<double>();
  // A fold is where load grows no further with the angle; just below it there is a solution, just above none.
  double below = 0, above = 3;
  for (int n = 0; n < 60; ++n) {
    const double force = (below + above) / 2;
    (output_angle(axis, -33.2 * degree, Load<double>{force, 0}).status == Status::ok ? below : above) = force;
  }
  // MuJoCo, which knows no equation, puts the fold at an unloaded output of -80 degrees at 1.10404 N.
  CLAIM_NEAR(below, 1.10404, 1e-3);
  const auto near = equilibrium(axis, -33.2 * degree, Load<double>{below * (1 - 1e-9), 0});
  CLAIM(near.status == Status::ok);
  CLAIM(near.iterations <= most_iterations);
  CLAIM(output_angle(axis, -33.2 * degree, Load<double>{above * (1 + 1e-9), 0}).status == Status::no_equilibrium);
}

void what_cannot_be_solved_says_so() {
  const auto axis = instruments::real_size<double>();
  const double nan = std::nan("");
  CLAIM(output_angle(axis, nan, Load<double>{}).status == Status::not_finite);
  CLAIM(output_angle(axis, 0.1, Load<double>{nan, 0}).status == Status::not_finite);
  CLAIM(output_angle(axis, 0.1, Load<double>{HUGE_VAL, 0}).status == Status::not_finite);
  CLAIM(output_angle(axis, 0.1, Load<double>{}, Stroke<double>{nan, 0}).status == Status::not_finite);
  CLAIM(output_angle(axis, 0.8, Load<double>{}).status == Status::out_of_range);
  auto wide = axis;
  wide.handle_range = 1.5;
  CLAIM(output_angle(wide, 1.0, Load<double>{}).status == Status::unreachable);
  CLAIM(output_angle(axis, 0.0, Load<double>{}, Stroke<double>{-2e-3, -2e-3}).status == Status::both_slack);
  CLAIM(output_angle(axis, 0.0, Load<double>{0.1, 0}, Stroke<double>{-1e-3, -1e-3}).status == Status::ok);
  CLAIM(handle_angle(axis, 170 * degree, Load<double>{}).status == Status::unreachable);
  CLAIM(handle_angle(axis, nan, Load<double>{}).status == Status::not_finite);
  CLAIM(compensation_stroke(axis, Tensions<double>{0, 31}, 0.1, Actuation::agonist, Law::exact).status ==
        Status::no_authority);
  CLAIM(estimate_output_angle(axis, 0.1, Tensions<double>{0, 0}).status == Status::both_slack);
}

void a_backbone_holds_the_tip_where_both_tendons_are_slack() {
  const auto axis = instruments::continuum<double>();
  const Stroke<double> out{-5e-3, -5e-3};
  for (double force : {-0.2, -0.05, 0.0, 0.05, 0.2}) {
    const auto tip = output_angle(axis, 0.1, Load<double>{force, 0}, out);
    CLAIM(tip.status == Status::ok);
    const auto tension = tensions(axis, 0.1, Load<double>{force, 0}, out).value;
    CLAIM(tension.agonist == 0 && tension.antagonist == 0);
    const double spring = axis.distal.passive_stiffness();
    CLAIM_NEAR(tip.value, -force * axis.distal.tangential_arm(tip.value) / spring, 1e-12);
  }
}

void float_agrees_with_double() {
  const auto wide = instruments::real_size<double>();
  const auto narrow = instruments::real_size<float>();
  for (double handle = -30; handle <= 40; handle += 5)
    for (double force = 0; force <= 2.5; force += 0.25) {
      const auto a = output_angle(wide, handle * degree, Load<double>{force, 0});
      const auto b = output_angle(narrow, float(handle * degree), Load<float>{float(force), 0});
      CLAIM(a.status == b.status);
      if (a.status == Status::ok) CLAIM_NEAR(a.value, double(b.value), 2e-5);
    }
}

int main() {
  every_equilibrium_balances_the_moments(instruments::real_size<double>());
  every_equilibrium_balances_the_moments(instruments::scaled_up<double>());
  every_equilibrium_balances_the_moments(instruments::pulley<double>());
  every_equilibrium_balances_the_moments(instruments::continuum<double>());
  the_branch_is_the_one_that_grows_out_of_no_load(instruments::real_size<double>(), 60);
  the_branch_is_the_one_that_grows_out_of_no_load(instruments::scaled_up<double>(), 0);
  the_branch_is_the_one_that_grows_out_of_no_load(instruments::pulley<double>(), 0);
  the_branch_is_the_one_that_grows_out_of_no_load(instruments::continuum<double>(), 60);
  past_the_fold_there_is_no_equilibrium();
  what_cannot_be_solved_says_so();
  a_backbone_holds_the_tip_where_both_tendons_are_slack();
  loose_tendons_hold_the_tip_only_at_the_end_of_their_gap();
  a_continuum_bends_on_to_its_limit_without_a_gap();
  a_radial_force_can_snap_a_continuum();
  float_agrees_with_double();
  return claims::report();
}

// Claims about observer and law of joints whose tendons turn several of them.

#include "tenodesis/joint_law.hpp"

#include <limits>

#include "claim.hpp"

using namespace tenodesis;

constexpr double stiffness = 1e5, pretension = 20, spool = 2.5e-3, period = 5e-4;

using Wrist = TendonChain<double, 3, 6>;
using Observer = JointObserver<Wrist, 4>;

/// A pitch joint and two jaws on it, whose tendons run over the pitch pulley.
Wrist wrist() {
  Wrist chain{};
  const double arms[3] = {2.5e-3, 2.1e-3, 2.1e-3};
  for (int i = 0; i < 3; ++i) {
    auto& joint = chain.joint[i];
    joint.mechanism = Mechanism::pulley;
    joint.parent = i == 0 ? -1 : 0;
    joint.axis = i == 0 ? Vector<double>{-1, 0, 0} : Vector<double>{0, 1, 0};
    joint.offset = i == 0 ? 0 : 9e-3;
    joint.length = 10e-3;
    joint.share = i == 0 ? 0 : 0.5;
    joint.grip = i == 0 ? 0 : (i == 1 ? 5e-3 : -5e-3);
    for (int side = 0; side < 2; ++side) {
      const int m = 2 * i + side;
      const double sign = side == 0 ? 1 : -1;
      chain.arm[m][i] = sign * arms[i];
      if (i > 0) chain.arm[m][0] = sign * 1.7e-3;
      chain.stiffness[m] = stiffness;
      chain.pretension[m] = pretension;
      chain.motor[m] = true;
    }
  }
  return chain;
}

/// coefficient: in the sheath, over one radian.
Observer observer_of(double coefficient) {
  Observer observer{};
  observer.chain = wrist();
  for (int m = 0; m < 6; ++m) {
    int n = 0;
    observer.passage[m][n++] = {-1, coefficient, 1, 1, 0};
    for (int i = 0; i < 3; ++i)
      if (observer.chain.arm[m][i] != 0) observer.passage[m][n++] = {i, 0, 0, 1, -observer.chain.arm[m][i]};
    observer.contacts[m] = n;
    for (int j = 0; j <= n; ++j) observer.compliance[m][j] = 1 / (stiffness * (n + 1));
  }
  observer.spool_radius = spool;
  observer.play = 1e-6;
  observer.deviations = {0.03, 5e-6, 0.2, 1e-3, 5, 0.05, 5, 1e-5};
  return observer;
}

/// What sensors show of the wrist at rest, without friction.
Observer::Measured measured_at(const Wrist& chain, const double* stroke, const double* x) {
  Observer::Measured measured{};
  double drawn[6];
  chain.excursions(x, drawn);
  for (int m = 0; m < 6; ++m) {
    measured.spool_angle[m] = stroke[m] / spool;
    measured.tension[m] = std::fmax(0, chain.stretched(m, stroke[m], drawn[m]));
  }
  return measured;
}

void angles_under_load_are_those_at_rest_without_friction() {
  const Observer observer = observer_of(0);
  const double turned[3] = {0.4, -0.3, 0.5};
  double stroke[6];
  observer.chain.excursions(turned, stroke);
  // The second load is such that tendons go slack.
  for (const double force : {1.0, 6.0}) {
    const auto rest = solve(observer.chain, stroke, {{{force, -force, 0.5}, {}}, 1, false});
    CLAIM(rest.status == Status::ok);
    const auto measured = measured_at(observer.chain, stroke, rest.x);
    Observer::Memory memory{};
    for (int n = 0; n < 20; ++n) observer.update(measured, memory);
    int taut = 0;
    for (const bool one : memory.estimate.taut) taut += one ? 1 : 0;
    CLAIM(force < 2 ? taut == 6 : taut < 6);
    for (int i = 0; i < 3; ++i) {
      CLAIM_NEAR(memory.estimate.angle[i], rest.x[i], 1e-4);
      CLAIM(std::fabs(rest.x[i] - turned[i]) > 1e-3);
    }
  }
}

void moments_that_tendons_do_not_balance_are_a_load() {
  Observer observer = observer_of(0);
  observer.deviations.imbalance = 1e-7;
  double stroke[6]{}, by_load[3][load_components], left[3];
  const ChainLoad<double> load{{{1, -1, 0.5}, {}}, 1, false};
  const auto rest = solve(observer.chain, stroke, load);
  Observer::Memory memory{};
  for (int n = 0; n < 20; ++n) observer.update<true>(measured_at(observer.chain, stroke, rest.x), memory);
  const auto& found = memory.estimate;
  Bend<double> bend[3];
  for (int i = 0; i < 3; ++i) bend[i] = Bend<double>(observer.chain.joint[i], rest.x[i]);
  observer.chain.load_rows(bend, by_load);
  for (int i = 0; i < 3; ++i) {
    left[i] = found.moment[i];
    for (int k = 0; k < load_components; ++k) left[i] += by_load[i][k] * found.load[k];
    CLAIM_NEAR(left[i], 0, 1e-5);
  }
  // What no joint feels stays as it was known; jaws feel the grip.
  CLAIM_NEAR(found.load[2], 0, 1);
  CLAIM_NEAR(found.load[6], 1, 3 * found.load_std[6]);
  CLAIM(found.load_std[6] < observer.deviations.grip && found.load_std[2] < 1.01 * observer.deviations.force);
}

void components_of_a_load_are_those_of_any_load() {
  Wrist chain = wrist();
  chain.joint[0].mechanism = Mechanism::gear;
  chain.joint[0].chord = 4e-3;
  for (int i = 1; i < 3; ++i) chain.joint[i] = {.mechanism = Mechanism::continuum, .parent = i - 1, .share = 0.5};
  chain.joint[1].axis = {1, 0, 0};
  chain.joint[1].chord = 20e-3;
  chain.joint[2].axis = {0, 1, 0};
  chain.joint[2].chord = 1;
  chain.joint[2].length = 7e-3;
  const double x[3] = {0.2, -0.5, 0.7}, given[load_components] = {1, -2, 3, 0.04, -0.05, 0.06, 7};
  for (const bool within : {false, true}) {
    chain.joint[2].within = within;
    Bend<double> bend[3];
    for (int i = 0; i < 3; ++i) bend[i] = Bend<double>(chain.joint[i], x[i]);
    double row[3][load_components], moment[3], unused[3][3];
    chain.load_rows(bend, row);
    const ChainLoad<double> load{{{1, -2, 3}, {0.04, -0.05, 0.06}}, 7, false};
    chain.load_moments<false, false>(bend, load, moment, unused);
    for (int i = 0; i < 3; ++i) {
      double sum = 0;
      for (int k = 0; k < load_components; ++k) sum += row[i][k] * given[k];
      CLAIM_NEAR(sum, moment[i], 1e-14);
    }
  }
}

/// All tendons pulled alike through their sheaths, which have a friction of their own, then moved back by a length.
Observer::Memory pulled(const Observer& observer, double coefficient, double back) {
  Observer::Memory memory{};
  constexpr int ticks = 300;
  for (int n = 0; n <= ticks + 1; ++n) {
    const double near = pretension + 30.0 * std::fmin(n, ticks) / ticks;
    const double beyond = std::fmax(near * std::exp(-coefficient), pretension);
    Observer::Measured measured{};
    for (int m = 0; m < 6; ++m) {
      const double soft = 1 / (stiffness * (observer.contacts[m] + 1));
      const double stretch = soft * (near - pretension + observer.contacts[m] * (beyond - pretension));
      measured.tension[m] = near;
      measured.spool_angle[m] = (stretch - (n > ticks ? back : 0)) / spool;
    }
    observer.update(measured, memory);
  }
  return memory;
}

void a_common_pull_shows_friction() {
  for (const double scale : {0.8, 1.0, 1.2}) {
    const auto observer = observer_of(0.3);
    const auto memory = pulled(observer, 0.3 * scale, 0);
    // Six tendons, each with a deviation of its own as large as that of all, tell six parts in seven.
    CLAIM_NEAR(memory.estimate.friction_scale, 1 + (scale - 1) * 6 / 7, 0.01);
    CLAIM_NEAR(memory.estimate.friction_scale_std, observer.deviations.friction / std::sqrt(7), 0.01);
    for (const double angle : memory.estimate.angle) CLAIM_NEAR(angle, 0, 1e-6);
  }
  CLAIM_NEAR(pulled(observer_of(0.3), 0.3, 0).estimate.far_tension[0], 50 * std::exp(-0.3), 1e-6);
}

void what_sticks_after_a_reversal_is_in_the_deviation() {
  const auto firm = pulled(observer_of(0.3), 0.3, 0), stuck = pulled(observer_of(0.3), 0.3, 1.3e-6);
  for (int i = 0; i < 3; ++i) CLAIM(stuck.estimate.covariance.at[i][i] > 4 * firm.estimate.covariance.at[i][i]);
}

void errors_that_all_measurements_have_alike_are_in_the_deviation_of_the_stiffness() {
  Observer observer = observer_of(0);
  observer.deviations.stiffness = 0.25;
  // Of the mean of all lengths, one deviation.
  const double longer = observer.deviations.length / std::sqrt(6);
  Observer::Memory memory{};
  constexpr int ticks = 2000;
  for (int n = 0; n <= ticks; ++n) {
    const double rise = 0.6 * pretension * (1 - std::fabs(2.0 * n / ticks - 1));
    Observer::Measured measured{};
    for (int m = 0; m < 6; ++m) {
      measured.tension[m] = pretension + rise;
      measured.spool_angle[m] = (rise / stiffness + longer) / spool;
    }
    observer.update(measured, memory, true);
  }
  const auto& [scale, weight, tension] = memory.learned;
  const double std = std::sqrt(weight[0] / (weight[0] * weight[2] - weight[1] * weight[1]));
  CLAIM(std::fabs(scale[1]) < std);
  CLAIM(std < 0.2 * observer.deviations.stiffness);
}

JointLaw<Wrist> law() {
  JointLaw<Wrist> made{};
  made.chain = wrist();
  made.rate = 8;
  made.gain = 40;
  made.speed = 0.05;
  made.spool_radius = spool;
  made.tension_limit = 100;
  made.least_tension = 0.15;
  made.period = period;
  CLAIM(made.prepare());
  return made;
}

void joints_reach_their_targets_and_are_never_farther_than_without() {
  Observer observer = observer_of(0);
  observer.deviations.length = 1e-6;
  const auto compensation = law();
  const double target[3] = {0.3, 0.2, -0.1};
  double worst_off[3]{}, last[3]{};
  for (const bool compensates : {false, true}) {
    Observer::Memory memory{};
    JointLaw<Wrist>::Memory own{};
    double stroke[6], velocity[6];
    observer.chain.excursions(target, stroke);
    for (int n = 0; n < 3000; ++n) {
      const auto rest = solve(observer.chain, stroke, {{{3, 4, 0}, {}}, 0, false});
      CLAIM(rest.status == Status::ok);
      const auto measured = measured_at(observer.chain, stroke, rest.x);
      const auto& found = observer.update(measured, memory);
      compensation.update(measured, found, target, compensates, own, velocity);
      for (int m = 0; m < 6; ++m) stroke[m] += period * spool * velocity[m];
      for (int i = 0; i < 3; ++i) {
        last[i] = std::fabs(rest.x[i] - target[i]);
        if (compensates) CLAIM(last[i] < worst_off[i] + 1e-4);
        if (!compensates) worst_off[i] = std::fmax(worst_off[i], last[i]);
      }
    }
    for (const double one : last) CLAIM(compensates ? one < 5e-4 : one > 5e-3);
  }
}

void whatever_is_true_within_the_deviation_a_joint_is_no_farther_than_without() {
  const auto compensation = law();
  const double target[3] = {0.3, 0, 0};
  for (const double loss : {-0.03, -0.005, 0.001, 0.004, 0.01}) {
    for (const double std : {1e-4, 1e-3, 2e-3, 1e-2}) {
      Observer::Measured measured{};
      JointEstimate<double, 3, 6> found{};
      JointLaw<Wrist>::Memory own{};
      found.valid = true;
      found.covariance.at[0][0] = std * std;
      for (int m = 0; m < 6; ++m) {
        found.taut[m] = true;
        found.far_tension[m] = measured.tension[m] = pretension;
      }
      double velocity[6];
      for (int n = 0; n < 4000; ++n) {
        found.angle[0] = target[0] - loss + own.given[0];
        compensation.update(measured, found, target, true, own, velocity);
      }
      for (const double deviations : {-2.0, -1.0, 0.0, 1.0, 2.0}) {
        const double lost = loss + deviations * std;
        CLAIM(std::fabs(lost - own.given[0]) <= std::fabs(lost) + 1e-9);
      }
      if (std::fabs(loss) > 4 * std) CLAIM_NEAR(own.given[0], loss, 1e-5);
    }
  }
}

void jaws_that_were_closed_and_are_pressed_apart_keep_their_grip() {
  Observer observer = observer_of(0);
  observer.deviations.length = 1e-6;
  const auto compensation = law();
  const double opened[3] = {0, 0.2, -0.2}, target[3] = {0, 0.1, -0.1};
  Observer::Memory memory{};
  JointLaw<Wrist>::Memory own{};
  double stroke[6], commanded[6], velocity[6];
  observer.chain.excursions(target, commanded);
  observer.chain.excursions(target, stroke);
  for (int n = 0; n < 2000; ++n) {
    const auto rest = solve(observer.chain, stroke, {{{3, 0, 0}, {}}, 5, false});
    const auto measured = measured_at(observer.chain, stroke, rest.x);
    const auto& found = observer.update(measured, memory);
    if (n == 0) compensation.update(measured, found, opened, false, own, velocity);
    compensation.update(measured, found, target, true, own, velocity);
    for (int m = 0; m < 6; ++m) stroke[m] += period * spool * velocity[m];
    if (n + 1 < 2000) continue;
    CLAIM_NEAR((rest.x[1] + rest.x[2]) / 2, 0, 5e-4);
    CLAIM(rest.x[1] - rest.x[2] > 0.2 + 0.03);
  }
  // Strokes of the two jaws differ as commanded.
  CLAIM_NEAR(stroke[2] - stroke[4], commanded[2] - commanded[4], 1e-7);
  CLAIM(std::fabs(stroke[2] - commanded[2]) > 1e-5);
}

void a_reading_that_is_not_a_number_stops_the_spools() {
  const Observer observer = observer_of(0);
  Observer::Memory memory{};
  Observer::Measured measured{};
  for (double& one : measured.tension) one = pretension;
  observer.update(measured, memory);
  const double before = memory.estimate.angle[0];
  measured.tension[2] = std::numeric_limits<double>::quiet_NaN();
  const auto& found = observer.update(measured, memory);
  CLAIM(!found.valid);
  CLAIM(found.angle[0] == before);
  JointLaw<Wrist>::Memory own{};
  const double target[3] = {0.3, 0.2, -0.1};
  double velocity[6];
  law().update(measured, found, target, true, own, velocity);
  for (const double one : velocity) CLAIM(one == 0);
}

int main() {
  angles_under_load_are_those_at_rest_without_friction();
  moments_that_tendons_do_not_balance_are_a_load();
  components_of_a_load_are_those_of_any_load();
  a_common_pull_shows_friction();
  what_sticks_after_a_reversal_is_in_the_deviation();
  errors_that_all_measurements_have_alike_are_in_the_deviation_of_the_stiffness();
  joints_reach_their_targets_and_are_never_farther_than_without();
  whatever_is_true_within_the_deviation_a_joint_is_no_farther_than_without();
  jaws_that_were_closed_and_are_pressed_apart_keep_their_grip();
  a_reading_that_is_not_a_number_stops_the_spools();
  return claims::report();
}

// Claims about what the observers make of the proximal sensors: closed forms, and tendons whose friction is known.

#include "tenodesis/observer.hpp"

#include <algorithm>
#include <random>

#include "claim.hpp"
#include "instruments.hpp"

using namespace tenodesis;

constexpr double spool_radius = 5e-3;  // m
constexpr double dt = 5e-4;            // s

template <class A>
ControlModel<A> model_of(const A& axis, double friction) {
  using S = A::Scalar;
  ControlModel<A> model{};
  model.axis = axis;
  model.spool_radius = S(spool_radius);
  constexpr double share[4] = {0.1, 0.1, 0.75, 0.05};
  for (int n = 0; n < 4; ++n) model.share[n] = S(share[n]);
  model.vertex = model.sheath = S(friction);
  model.sheath_bend = S(0.5);
  return model;
}

template <class A>
FrictionObserver<A> observer_of(const A& axis, double friction) {
  using S = A::Scalar;
  return {model_of(axis, friction),
          {.hand_play = S(0),
           .sheath_play = S(3e-6),
           .length_noise = S(1e-5),
           .play = S(5e-6),
           .smoothing = S(1e-3),
           .scale_std = S(0.4),
           .reference_std = S(5e-6),
           .compliance_std = S(0.25),
           .slack_below = S(0.25),
           .gain_std = S(0.01),
           .tremor_play = S(0)}};
}

/// What a frictionless instrument shows at a handle angle, under a load, with tendon wound.
template <class A>
struct Frictionless {
  double output_angle{};
  Measurement<typename A::Scalar> measured{};
};

template <class A>
Frictionless<A> frictionless(const A& axis, double handle, double force, double on_agonist, double on_antagonist) {
  using S = A::Scalar;
  const Stroke<S> wound{S(on_agonist), S(on_antagonist)};
  const auto angle = output_angle(axis, S(handle), Load<S>{S(force), S(0)}, wound);
  const auto tension = tensions(axis, S(handle), Load<S>{S(force), S(0)}, wound);
  CLAIM(angle.status == Status::ok && tension.status == Status::ok);
  return {double(angle.value),
          {S(handle),
           {tension.value.agonist, tension.value.antagonist},
           {S(on_agonist / spool_radius), S(on_antagonist / spool_radius)}}};
}

template <class S>
constexpr double rounding = sizeof(S) == 4 ? 3e-5 : 1e-11;

// What eq. 19 leaves out is (wound on the agonist less on the antagonist) / (4 r), in sin(angle / 2).
template <class S>
void paper_does_not_know_what_the_motors_wound() {
  const auto axis = instruments::scaled_up<S>();
  for (const double wound : {-1e-3, 5e-4}) {
    const auto at = frictionless(axis, 0.2, 0.5, wound, -wound / 2);
    const double seen = double(paper_output_angle(model_of(axis, 0.0), at.measured));
    CLAIM_NEAR(std::sin(at.output_angle / 2) - std::sin(seen / 2), 1.5 * wound / (4 * 7.5e-3), rounding<S>);
  }
}

template <class A>
void paper_stays_finite_whatever_the_tensions(const A& axis) {
  using S = A::Scalar;
  for (const double tension : {-1e6, -10.0, 0.0, 1e6}) {
    const Measurement<S> measured{axis.handle_range, {S(tension), S(-tension)}, {}};
    CLAIM(is_finite(paper_output_angle(model_of(axis, 0.1), measured)));
  }
}

// Started at rest, without friction, it is the exact estimate; moved there, it comes to it as its smoothing settles.
template <class A>
void without_friction_the_friction_observer_is_the_exact_one(const A& axis) {
  using S = A::Scalar;
  auto observer = observer_of(axis, 0);
  observer.settings.reference_std = S(0);
  const double slack = double(slack_force(axis, S(0)).value);
  for (const double share : {-0.8, 0.0, 0.7}) {
    for (const double wound : {0.0, 2e-4}) {
      FrictionMemory<S> started{}, moved{};
      const auto end = frictionless(axis, 0.3, share * slack, wound, -wound / 3);
      observer.update(end.measured, S(dt), started);
      const auto& m = end.measured;
      const auto exact =
          estimate_output_angle(axis, m.handle_angle, Tensions<S>{m.tension[0], m.tension[1]},
                                Stroke<S>{S(spool_radius) * m.spool_angle[0], S(spool_radius) * m.spool_angle[1]});
      CLAIM_NEAR(double(exact.value), end.output_angle, 10 * rounding<S>);
      CLAIM_NEAR(double(observer.estimate(started).output_angle), end.output_angle, 10 * rounding<S>);
      for (int n = 0; n <= 400; ++n) {
        const double part = std::min(1.0, n / 200.0);
        const auto at = frictionless(axis, 0.3 * part, share * slack * part, wound * part, -wound * part / 3);
        observer.update(at.measured, S(dt), moved);
      }
      CLAIM_NEAR(double(observer.estimate(moved).output_angle), end.output_angle, 30 * rounding<S>);
      CLAIM_NEAR(double(observer.estimate(moved).tip_force), share * slack, sizeof(S) == 4 ? 2e-4 * slack : 1e-8);
    }
  }
}

/// Both tendons of a straight instrument, dragged through their sheaths alike: what a spool winds is stretch.
struct Dragged {
  double friction{};          // coefficient
  double compliance_scale{};  // over the nominal one
  double stem{};              // N, of both
  double slide{};             // 1: all the way toward the spools, -1: toward the tip; between, the sheath holds

  template <class S>
  Measurement<S> measured(const ControlModel<GearAxis<S>>& model) const {
    const double spool = stem * std::exp(slide * friction * double(model.sheath_bend));
    const double unit = compliance_scale / double(model.axis.stiffness);
    const auto to = double(model.axis.pretension);
    const double stretch = unit * (double(model.share[0]) * (spool - to) +
                                   double(model.share[1] + model.share[2] + model.share[3]) * (stem - to));
    return {S(0), {S(spool), S(spool)}, {S(stretch / spool_radius), S(stretch / spool_radius)}};
  }
};

// Pulled and let out again and again: a straight instrument's only friction is its sheath's.
template <class S>
FrictionMemory<S> learned(const FrictionObserver<GearAxis<S>>& observer, double friction, double compliance_scale,
                          int strokes) {
  constexpr int turn = 100, drag = 400;
  FrictionMemory<S> memory{};
  Dragged at{friction, compliance_scale, 25, 0};
  for (int stroke = 0; stroke < strokes; ++stroke) {
    const int direction = stroke % 2 == 0 ? 1 : -1;
    for (int n = 0; n < turn + drag; ++n) {
      if (n < turn)
        at.slide = std::clamp(at.slide + direction * 2.0 / turn, -1.0, 1.0);
      else
        at.stem += direction * 10.0 / drag;
      observer.update(at.measured(observer.model), S(dt), memory);
    }
  }
  return memory;
}

template <class S>
void common_strokes_tell_friction_and_compliance() {
  for (const double friction : {0.07, 0.1, 0.143}) {
    for (const double compliance_scale : {0.85, 1.0, 1.15}) {
      const auto observer = observer_of(instruments::scaled_up<S>(), 0.1);
      const auto memory = learned(observer, friction, compliance_scale, 8);
      const auto estimate = observer.estimate(memory);
      CLAIM_NEAR(double(estimate.friction_scale), friction / 0.1, 0.1 * friction / 0.1);
      CLAIM_NEAR(double(memory.compliance_scale), compliance_scale, 0.03);
      CLAIM(std::fabs(double(estimate.friction_scale) - friction / 0.1) < 3 * double(estimate.friction_scale_std));
      CLAIM(double(estimate.friction_scale_std) < 0.1);
      CLAIM_NEAR(double(estimate.output_angle), 0, 1e-3);
    }
  }
}

// By Cholesky's factors of the correlations; of a covariance the upper half is kept.
template <class S>
bool is_positive_definite(const S (&p)[4][4]) {
  double factor[4][4]{};
  for (int n = 0; n < 4; ++n) {
    if (!(double(p[n][n]) > 0)) return false;
    for (int m = n; m < 4; ++m) {
      double left = double(p[n][m]) / std::sqrt(double(p[n][n]) * double(p[m][m]));
      for (int k = 0; k < n; ++k) left -= factor[k][n] * factor[k][m];
      if (m == n && !(left > 0)) return false;
      factor[n][m] = m == n ? std::sqrt(left) : left / factor[n][n];
    }
  }
  return true;
}

template <class S>
void the_covariance_stays_positive_however_long_and_finely_it_learns() {
  for (const double length_noise : {1e-5, 1e-6}) {
    auto observer = observer_of(instruments::scaled_up<S>(), 0.1);
    observer.settings.length_noise = S(length_noise);
    const auto memory = learned(observer, 0.12, 1.1, 2000);
    CLAIM(is_positive_definite(memory.covariance));
    CLAIM(all_finite(memory.scale, memory.reference, memory.compliance_scale));
    CLAIM(std::fabs(double(memory.scale) - 1.2) < 0.12);
  }
}

// One tendon that moves alone, or two that go opposite ways, say nothing about friction.
template <class S>
void nothing_is_learned_from_tendons_that_do_not_slip_together() {
  const auto axis = instruments::scaled_up<S>();
  const auto observer = observer_of(axis, 0.1);
  for (const double other : {0.0, -1.0}) {
    FrictionMemory<S> memory{};
    for (int n = 0; n < 4000; ++n) {
      const double wound = 5e-4 * std::sin(n * 0.01);
      const auto at = frictionless(axis, 0.2, 0.3, wound, other * wound);
      observer.update(at.measured, S(dt), memory);
      CLAIM(memory.scale == S(1) && memory.compliance_scale == S(1) && memory.reference == S(0));
    }
  }
}

template <class S>
void a_tendon_at_rest_under_noise_does_not_slip() {
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  std::uniform_real_distribution<double> noise(-0.45, 0.45);
  const S play = S(1e-5);
  Slip<S> slip{};
  for (int n = 0; n < 20000; ++n) {
    slip = follow(slip, S(double(play) * noise(random)), play);
    CLAIM(slip.indicator == S(0) && slip.run == S(0) && slip.dragged == S(0));
  }
}

template <class S>
void a_dragged_tendon_slips_until_it_turns_and_a_turn_takes_a_whole_play() {
  const S play = S(1e-5);
  Slip<S> slip{};
  double at = 0;
  for (int n = 0; n < 200; ++n) slip = follow(slip, S(at += 2e-6), play);
  CLAIM(slip.indicator > S(0) && slip.run == S(2 * tuning::firm_run));
  const S dragged = slip.dragged;
  for (int n = 0; n < 4; ++n) slip = follow(slip, S(at -= 2e-6), play);
  CLAIM(slip.indicator == S(0) && slip.dragged == dragged && slip.run == S(2 * tuning::firm_run));
  for (int n = 0; n < 3; ++n) slip = follow(slip, S(at -= 2e-6), play);
  CLAIM(double(slip.indicator) < 0 && double(slip.run) < 0 && double(slip.run) > -tuning::firm_run);
}

template <class S>
void a_tension_beyond_a_contact_stays_within_its_friction() {
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  std::uniform_real_distribution<double> any(0, 1);
  for (int n = 0; n < 10000; ++n) {
    const S ratio = S(1 + any(random)), near = S(60 * any(random)), held = S(60 * any(random));
    const S indicator = S(2 * any(random) - 1);
    const S tension = beyond(ratio, near, held, indicator);
    CLAIM(tension >= near / ratio && tension <= near * ratio);
  }
  CLAIM(beyond(S(2), S(30), S(40), S(1)) == S(15));
  CLAIM(beyond(S(2), S(30), S(40), S(-1)) == S(60));
  CLAIM(beyond(S(2), S(30), S(40), S(0)) == S(40));
}

// The worst readings in any order: what reaches the motors by way of the observer must stay a number.
template <class A>
void no_finite_reading_makes_the_tip_or_the_friction_not_a_number(const A& axis) {
  using S = A::Scalar;
  std::mt19937 random(3);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  std::uniform_real_distribution<double> any(-1, 1);
  for (const double friction : {0.0, 0.3}) {
    const auto observer = observer_of(axis, friction);
    FrictionMemory<S> memory{};
    for (int n = 0; n < 20000; ++n) {
      const double size = std::pow(10, 3 * any(random));
      const auto any_value = [&] { return S(size * any(random)); };
      const Measurement<S> measured{
          S(double(axis.handle_range) * any(random)), {any_value(), any_value()}, {any_value(), any_value()}};
      observer.update(measured, S(dt), memory);
      const auto estimate = observer.estimate(memory);
      CLAIM(all_finite(memory.scale, memory.compliance_scale, memory.reference, memory.tip, memory.output_angle));
      CLAIM(all_finite(estimate.output_angle, estimate.tip_force, observer.breakaway(memory, S(1)),
                       observer.breakaway(memory, S(-1))));
      CLAIM(memory.scale >= S(0.05) && memory.scale <= S(20));
      CLAIM(estimate.output_angle_std >= S(0) && estimate.friction_scale_std >= S(0));
    }
  }
}

template <class S>
void breakaway_is_nothing_without_friction_and_grows_with_it() {
  const auto axis = instruments::scaled_up<S>();
  double before = 0;
  for (const double friction : {0.0, 0.05, 0.1, 0.2}) {
    const auto observer = observer_of(axis, friction);
    FrictionMemory<S> memory{};
    const auto at = frictionless(axis, 0.3, 0.3, 0, 0);
    for (int n = 0; n < 50; ++n) observer.update(at.measured, S(dt), memory);
    const double needed = double(observer.breakaway(memory, S(1)));
    CLAIM(friction == 0 ? std::fabs(needed) < 1e-9 : needed > before);
    before = needed;
  }
}

template <class S>
void run() {
  paper_does_not_know_what_the_motors_wound<S>();
  const auto every_mechanism = [](const auto& axis) {
    paper_stays_finite_whatever_the_tensions(axis);
    without_friction_the_friction_observer_is_the_exact_one(axis);
    no_finite_reading_makes_the_tip_or_the_friction_not_a_number(axis);
  };
  every_mechanism(instruments::real_size<S>());
  every_mechanism(instruments::scaled_up<S>());
  every_mechanism(instruments::pulley<S>());
  every_mechanism(instruments::continuum<S>());
  common_strokes_tell_friction_and_compliance<S>();
  the_covariance_stays_positive_however_long_and_finely_it_learns<S>();
  nothing_is_learned_from_tendons_that_do_not_slip_together<S>();
  a_tendon_at_rest_under_noise_does_not_slip<S>();
  a_dragged_tendon_slips_until_it_turns_and_a_turn_takes_a_whole_play<S>();
  a_tension_beyond_a_contact_stays_within_its_friction<S>();
  breakaway_is_nothing_without_friction_and_grows_with_it<S>();
}

int main() {
  run<double>();
  run<float>();
  return claims::report();
}

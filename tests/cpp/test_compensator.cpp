// Claims about the compensation laws: how much of the loss each restores without friction, and that none exceeds a
// limit.

#include "tenodesis/compensator.hpp"

#include <random>

#include "control_parameters.hpp"

// ---- laws on a plant without friction

/// Lag of the tip behind its unloaded position, under a law.
struct Settled {
  double loss{};     // in the mechanism's coordinate, without compensation
  double after{};    // with it
  double stretch{};  // of the tendons by the load and the final tensions, in that coordinate
};

// The plant is statics, with spools that follow their commands exactly.
template <class A>
Settled settle(const A& axis, double handle, double force, ControlLaw law, Actuation actuation) {
  using S = A::Scalar;
  auto p = parameters(axis, law, actuation);
  p.axis[0].dead_band = 1e-7;
  p.axis[0].tension_limit = 1e4;
  const auto own = detail::axis_controller<A>(p, 0);
  Compensator<A> compensator = own.compensator;
  compensator.law = law;
  compensator.actuation = actuation;
  const Load<S> load{S(force), S(0)};
  const auto model = own.model();
  const S excursion = model.excursion(S(handle)), slope = axis.distal.excursion_slope();
  const S free = axis.distal.coordinate(unloaded_angle(axis, S(handle)).value);
  Stroke<S> wound{};
  Settled found{};
  FrictionMemory<S> memory{};
  CompensatorState<S> state{};
  for (int n = 0; n < 8000; ++n) {
    const auto angle = output_angle(axis, S(handle), load, wound);
    const auto tension = tensions(axis, S(handle), load, wound);
    CLAIM(angle.status == Status::ok);
    if (angle.status != Status::ok) return found;
    const auto loss = double(free - axis.distal.coordinate(angle.value));
    if (n == 0) found.loss = loss;
    found.after = loss;
    found.stretch = double(tension.value.difference() / (S(2) * axis.stiffness * slope) - (excursion / slope - free));
    const Measurement<S> measured{S(handle),
                                  {tension.value.agonist, tension.value.antagonist},
                                  {wound.agonist / S(spool_radius), wound.antagonist / S(spool_radius)}};
    const Winding<S> speed = compensator.wind(measured, own.friction, memory, S(dt), state);
    wound.agonist = wound.agonist + speed.agonist * S(dt);
    wound.antagonist = wound.antagonist + speed.antagonist * S(dt);
  }
  return found;
}

template <class S>
constexpr double of_loss = sizeof(S) == 4 ? 2e-3 : 1e-4;

// Care point 1: handle motion moves both tendons, one motor moves one.
template <class A>
void eq_22_with_one_motor_leaves_half_the_loss_and_with_both_nothing(const A& axis) {
  using S = A::Scalar;
  const double slack = double(slack_force(axis, S(0)).value);
  for (const double handle : {-0.2, 0.0, 0.3}) {
    for (const double share : {-0.3, 0.3}) {
      const auto own = settle(axis, handle, share * slack, ControlLaw::paper, Actuation::agonist);
      const auto both = settle(axis, handle, share * slack, ControlLaw::paper, Actuation::differential);
      CLAIM_NEAR(own.after / own.stretch, 0.5, of_loss<S>);
      CLAIM_NEAR(both.after / both.loss, 0, of_loss<S>);
    }
  }
}

// With one motor only the agonist acts, which cannot push.
template <class A>
void exact_restores_everything_with_one_motor_or_two_slack_included(const A& axis) {
  using S = A::Scalar;
  const double slack = double(slack_force(axis, S(0)).value);
  for (const double share : {-0.4, 0.5, 1.3}) {
    for (const auto actuation : every_actuation) {
      if (share > 1 && axis.distal.folds() && actuation == Actuation::agonist) continue;
      const auto found = settle(axis, 0.0, share * slack, ControlLaw::exact, actuation);
      CLAIM_NEAR(found.after / found.loss, 0, 3 * of_loss<S>);
    }
  }
}

template <class A>
void off_moves_nothing(const A& axis) {
  const auto found = settle(axis, 0.2, 0.3, ControlLaw::off, Actuation::differential);
  CLAIM(found.after == found.loss);
}

// ---- what never reaches a motor

template <class S, class Random>
Measurement<S> any_reading(Random& random, double handle_range) {
  std::uniform_real_distribution<double> any(0, 1);
  const auto angle = [&] { return S(2 * any(random) - 1); };
  return {S(handle_range * (2 * any(random) - 1)), {S(100 * any(random)), S(100 * any(random))}, {angle(), angle()}};
}

template <class A>
void no_law_winds_a_tendon_at_its_limit_or_faster_than_it_may(const A& axis) {
  using S = A::Scalar;
  std::mt19937 random(1);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed): the same on every run
  for (const auto law : every_law) {
    for (const auto actuation : every_actuation) {
      const auto p = parameters(axis, law, actuation);
      auto own = detail::axis_controller<A>(p, 0);
      own.compensator.law = law;
      own.compensator.actuation = actuation;
      FrictionMemory<S> memory{};
      CompensatorState<S> state{};
      for (int n = 0; n < 4000; ++n) {
        const auto measured = any_reading<S>(random, double(axis.handle_range));
        own.friction.update(measured, S(dt), memory);
        const Winding<S> speed = own.compensator.wind(measured, own.friction, memory, S(dt), state);
        const S by[2] = {speed.agonist, speed.antagonist};
        for (int i = 0; i < 2; ++i) {
          CLAIM(is_finite(by[i]) && abs(by[i]) <= S(2 * p.axis[0].tendon_speed));
          CLAIM(!(measured.tension[i] >= S(p.axis[0].tension_limit)) || by[i] <= S(0));
        }
        // With one motor the other one lets out what it has wound, and no more.
        const bool wound = (law == ControlLaw::robust && memory.smooth.spool_angle[antagonist] > S(0)) ||
                           (own.model().springs() && measured.spool_angle[antagonist] > S(0));
        CLAIM(actuation == Actuation::differential || speed.antagonist == S(0) || (wound && speed.antagonist < S(0)));
      }
    }
  }
}

template <class S>
void in_one_precision() {
  const auto every_mechanism = [](const auto& axis) {
    eq_22_with_one_motor_leaves_half_the_loss_and_with_both_nothing(axis);
    exact_restores_everything_with_one_motor_or_two_slack_included(axis);
    off_moves_nothing(axis);
    no_law_winds_a_tendon_at_its_limit_or_faster_than_it_may(axis);
  };
  every_mechanism(instruments::real_size<S>());
  every_mechanism(instruments::scaled_up<S>());
  every_mechanism(instruments::pulley<S>());
  every_mechanism(instruments::continuum<S>());
  // A backbone that takes half of the angle and slackens a tendon from 0.6 rad on.
  auto stiff = instruments::continuum<S>();
  stiff.distal.backbone_rigidity = S(0.125 * 0.02);
  stiff.handle_range = S(1.2);
  every_mechanism(stiff);
}

int main() {
  in_one_precision<double>();
  in_one_precision<float>();
  return claims::report();
}

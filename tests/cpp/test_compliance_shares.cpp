// Claims about reversals of a tendon's tension, and about the compliance before the handle's joint that they show.

#include "tenodesis/compliance_shares.hpp"

#include "control_parameters.hpp"

// Tensions change by 0.02 N a tick; 0.3 N is their noise.
constexpr double step = 0.02, noise = 0.3;

template <class S>
void lead(Reversal<S>& one, double from, double to, bool slips) {
  const int count = int(std::lround(std::fabs(to - from) / step));
  for (int n = 1; n <= count; ++n) follow(S(from + (to - from) * n / count), S(noise), S(0), slips, one);
}

template <class S>
void a_tension_has_reversed_once_it_has_come_back_by_more_than_noise() {
  auto one = Reversal<S>::at(S(20));
  lead(one, 20, 30, true);
  CLAIM(one.direction == S(1) && one.turned == S(20));
  lead(one, 30, 30 - 0.9 * noise, false);
  CLAIM(one.direction == S(1) && one.stick == Stick::unknown);
  lead(one, 30 - 0.9 * noise, 28, false);
  CLAIM(one.direction == S(-1) && one.stick == Stick::all);
  CLAIM_NEAR(double(one.turned), 30, 1e-5);
  CLAIM(one.beyond(S(28), S(1.05)) && !one.beyond(S(28), S(1.1)));
  CLAIM(one.left(S(28), S(1.05)) == S(0));
  CLAIM_NEAR(double(one.left(S(28), S(1.2))), 28 - 30 / 1.2, 1e-5);
}

// Contacts that did not slip before the reversal may slip right after it.
template <class S>
void contacts_are_known_to_stick_only_if_they_slipped_before() {
  auto one = Reversal<S>::at(S(20));
  lead(one, 20, 30, false);
  lead(one, 30, 28, false);
  CLAIM(one.direction == S(-1) && one.stick == Stick::unknown);
}

template <class S>
struct Fixture {
  using A = GearAxis<S>;

  AxisController<A> own{};
  FrictionMemory<S> memory{};

  explicit Fixture(const A& axis) {
    own = detail::axis_controller<A>(parameters(axis, ControlLaw::robust, Actuation::differential), 0);
    memory.compliance = S(1) / axis.stiffness;
    for (int j = 0; j < 4; ++j) memory.share[j] = own.model().share[j];
    memory.share_variance = square(S(tuning::share_std));
    memory.covariance[2][2] = S(1e-4);
    memory.nominal[0] = S(0.02);
    memory.nominal[1] = S(0.12);
  }

  double before() const { return double(memory.share[0] + memory.share[1]); }

  /// The agonist, of which a share of the compliance is before the handle's joint, is let out from 50 N while that
  /// joint sticks, and its tension beyond the sheath follows; moving: what the handle turns in a tick, rad.
  void let_out(double share, double moving = 0) {
    auto& one = memory.tendon[agonist];
    one.reversal = Reversal<S>::at(S(20));
    lead(one.reversal, 20, 50, true);
    for (int n = 0; n < 600; ++n) {
      const double tension = 50 - step * n;
      memory.smooth.handle_angle = memory.smooth.handle_angle + S(moving);
      one.tension[0] = S(tension);
      one.tension[1] = S(std::clamp(50 / std::exp(0.02), tension, tension * std::exp(0.02)));
      const double wound = share * (tension - 50) * double(memory.compliance);
      const S seems =
          memory.compliance * (memory.share[0] * (one.tension[0] - S(50)) + memory.share[1] * (one.tension[1] - S(50)));
      const S position[2] = {S(wound) - seems, S(0)};
      follow(one.tension[0], S(noise), memory.smooth.handle_angle, false, one.reversal);
      learn_shares(own.model(), own.friction.settings, position, memory);
    }
  }
};

template <class S>
void a_stroke_that_reverses_shows_the_compliance_before_the_joint_that_sticks() {
  for (const double share : {0.2, 0.35, 0.55}) {
    Fixture<S> fixture(instruments::scaled_up<S>());
    const double before = std::fabs(fixture.before() - share), variance = double(fixture.memory.share_variance);
    for (int n = 0; n < 4; ++n) fixture.let_out(share);
    CLAIM_NEAR(fixture.before(), share, std::fmax(0.03, 0.1 * before));
    CLAIM(double(fixture.memory.share_variance) < 0.1 * variance);
    S sum(0);
    for (const S& one : fixture.memory.share) sum = sum + one;
    CLAIM_NEAR(double(sum), 1, 1e-5);
  }
}

template <class S>
void a_hand_that_moves_shows_nothing() {
  Fixture<S> fixture(instruments::scaled_up<S>());
  const double before = fixture.before();
  fixture.let_out(0.55, 1e-4);
  CLAIM(fixture.before() == before && fixture.memory.share_variance == square(S(tuning::share_std)));
}

template <class S>
void all_claims() {
  a_tension_has_reversed_once_it_has_come_back_by_more_than_noise<S>();
  contacts_are_known_to_stick_only_if_they_slipped_before<S>();
  a_stroke_that_reverses_shows_the_compliance_before_the_joint_that_sticks<S>();
  a_hand_that_moves_shows_nothing<S>();
}

int main() {
  all_claims<double>();
  all_claims<float>();
  return claims::report();
}

// Claims about the envelope: which strokes a load explains, and when a law loses its gain.

#include "tenodesis/envelope.hpp"

#include "control_parameters.hpp"

template <class A>
struct Fixture {
  using S = A::Scalar;

  AxisController<A> own{};
  FrictionMemory<S> memory{};
  EnvelopeState<S> state{};
  S least{};  // lag by which a reversal stands out, m

  explicit Fixture(const A& axis) {
    own = detail::axis_controller<A>(parameters(axis, ControlLaw::robust, Actuation::differential), 0);
    memory.compliance = S(1) / axis.stiffness;
    for (S& tension : memory.smooth.tension) tension = axis.pretension;
    for (auto& one : memory.tendon)
      for (S& tension : one.tension) tension = axis.pretension;
    least = S(3 * 0.1 * degree) * axis.distal.moment_arm(S(0));
  }

  const Envelope<A>& envelope() const { return own.compensator.envelope; }
  S margin() const { return envelope().settings.margin; }

  void load(double difference) {
    memory.smooth.tension[agonist] = own.model().axis.pretension + S(difference / 2);
    memory.smooth.tension[antagonist] = own.model().axis.pretension - S(difference / 2);
  }

  void settle_bounds() {
    for (int n = 0; n < 4000; ++n) envelope().update(S(0), S(0), least, own.friction, memory, S(dt), state);
  }

  /// Lets the tracking error and the stroke, in reversals that stand out, and the handle (rad) swing for a while;
  /// returns the factor of the gain.
  double swing(double error, double handle, double frequency, double seconds, double stroke = 0) {
    for (int n = 0; n < int(seconds / dt); ++n) {
      const double at = std::sin(2 * pi * frequency * n * dt);
      memory.intent.angle = S(handle * at);
      envelope().update(S(error * at) * least, S(stroke * at) * least, least, own.friction, memory, S(dt), state);
    }
    return double(state.gain_factor);
  }
};

template <class A>
void a_load_explains_the_stroke_that_restores_its_loss_and_no_more(const A& axis) {
  using S = A::Scalar;
  for (const double difference : {-8.0, 0.0, 8.0}) {
    Fixture<A> fixture(axis);
    fixture.own.friction.model.vertex = fixture.own.friction.model.sheath = S(0);
    fixture.load(difference);
    fixture.settle_bounds();
    const double restores = difference / (2 * double(axis.stiffness));
    const double above = 1.3 * std::fmax(restores, 0.0) + double(fixture.margin());
    const double below = 1.3 * std::fmin(restores, 0.0) - double(fixture.margin());
    CLAIM_NEAR(fixture.state.high / above, 1, 1e-3);
    CLAIM_NEAR(fixture.state.low / below, 1, 1e-3);
  }
}

template <class A>
void beyond_its_bounds_a_stroke_is_taken_back_whatever_the_law_wants(const A& axis) {
  using S = A::Scalar;
  Fixture<A> fixture(axis);
  fixture.settle_bounds();
  auto& state = fixture.state;
  const auto fast = S(0.05);
  CLAIM(fixture.envelope().within(S(0), S(0), state) == S(0) && !state.bounded);
  CLAIM(fixture.envelope().within(fast, state.high, state) == S(0) && state.bounded);
  CLAIM(fixture.envelope().within(fast, S(1.5) * state.high, state) < S(0) && state.excess > S(0));
  CLAIM(fixture.envelope().within(-fast, S(1.5) * state.low, state) > S(0) && state.excess > S(0));
  CLAIM(fixture.envelope().within(-fast, state.high, state) < S(0) && state.excess == S(0));
}

template <class A>
void an_error_that_reverses_at_3_hz_takes_the_gain_and_gives_it_back(const A& axis) {
  Fixture<A> fixture(axis);
  CLAIM(fixture.swing(0.4, 0, 3, 3) == 1);  // too small to stand out
  CLAIM(fixture.swing(5, 0, 3, 3) == 0);
  CLAIM(!Envelope<A>::steady(fixture.state));
  CLAIM(fixture.swing(0, 0, 3, 4) == 1);
  CLAIM(Envelope<A>::steady(fixture.state));
}

// A stroke that reverses leaves both tendons' contacts unknown for a while, each time.
template <class A>
void an_error_that_is_only_unknown_for_a_while_takes_none(const A& axis) {
  using S = A::Scalar;
  Fixture<A> fixture(axis);
  for (int n = 0; n < int(3 / dt); ++n) {
    const double at = std::sin(2 * pi * 3 * n * dt);
    const S error = S(5) * fixture.least;
    const S off = S(at > 0 ? 4 * at : 0) * fixture.least;
    fixture.memory.unobservable[0] = fixture.memory.unobservable[1] = off;
    fixture.envelope().update(error - off, S(0), fixture.least, fixture.own.friction, fixture.memory, S(dt),
                              fixture.state);
  }
  CLAIM(fixture.state.gain_factor == S(1));
}

template <class A>
void neither_the_hand_nor_rare_loads_nor_the_tips_own_oscillation_take_it(const A& axis) {
  Fixture<A> hand(axis);
  CLAIM(hand.swing(5, 10 * degree, 2, 4, 2.5) == 1);
  Fixture<A> rare(axis);
  CLAIM(rare.swing(20, 0, 0.25, 12) == 1);
  Fixture<A> ringing(axis);
  CLAIM(ringing.swing(5, 0, 60, 1) == 1);
}

template <class A>
void reversals_count_by_what_strokes_leave_of_the_error(const A& axis) {
  Fixture<A> earns(axis);
  CLAIM(earns.swing(5, 0, 3, 3, 20) == 1);
  Fixture<A> earns_nothing(axis);
  CLAIM(earns_nothing.swing(5, 0, 3, 3, -10) == 0);
  // The same for reversals that the hand makes.
  Fixture<A> hand(axis);
  CLAIM(hand.swing(5, 10 * degree, 2, 4, -10) < 1);
}

template <class A>
void without_gain_a_stroke_returns_to_the_mean_of_what_is_lost(const A& axis) {
  using S = A::Scalar;
  Fixture<A> fixture(axis);
  const S lost = S(4) * fixture.least;
  for (int n = 0; n < int(20 / dt); ++n)
    fixture.envelope().update(S(0), lost, fixture.least, fixture.own.friction, fixture.memory, S(dt), fixture.state);
  const S half = S(0.5) * lost;
  CLAIM_NEAR(fixture.envelope().returning(half, S(1), fixture.state) / (S(tuning::return_rate) * half), 1, 1e-2);
  CLAIM_NEAR(fixture.envelope().returning(half, S(0.5), fixture.state) / half, 0, 1e-1);
}

template <class S>
void in_one_precision() {
  const auto claim = [](const auto& axis) {
    a_load_explains_the_stroke_that_restores_its_loss_and_no_more(axis);
    beyond_its_bounds_a_stroke_is_taken_back_whatever_the_law_wants(axis);
    an_error_that_reverses_at_3_hz_takes_the_gain_and_gives_it_back(axis);
    an_error_that_is_only_unknown_for_a_while_takes_none(axis);
    neither_the_hand_nor_rare_loads_nor_the_tips_own_oscillation_take_it(axis);
    reversals_count_by_what_strokes_leave_of_the_error(axis);
    without_gain_a_stroke_returns_to_the_mean_of_what_is_lost(axis);
  };
  claim(instruments::real_size<S>());
  claim(instruments::scaled_up<S>());
  claim(instruments::pulley<S>());
  claim(instruments::continuum<S>());
}

int main() {
  in_one_precision<double>();
  in_one_precision<float>();
  return claims::report();
}

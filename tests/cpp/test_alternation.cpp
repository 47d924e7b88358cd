// Claims about loads that alternate: when they are known, and when the tip is left to friction.

#include <initializer_list>

#include "tenodesis/alternation.hpp"

#include "claim.hpp"

using namespace tenodesis;

constexpr double dt = 1e-3;      // s
constexpr double jump = 1e-4;    // m
constexpr double waking = 2e-5;  // m
constexpr double tracked = 0.1;  // s, in which motors bring the tip back

template <class S>
struct Fixture {
  AlternationState<S> state{};
  S stroke{}, holds{S(8 * jump)};
  double time{}, leaned{};  // s

  void tick(double certain, bool moving = false) {
    follow<S>({S(certain), stroke, S(waking), S(jump), holds, moving, false}, S(dt), state);
    time += dt;
    if (state.leans) leaned += dt;
  }

  /// A load that jumps to and fro, by so much of the error, until the motors or friction have the tip on target.
  void alternate(double half, int jumps, double size, double left_by_friction = 1) {
    for (int n = 0; n < jumps; ++n) {
      const double side = n % 2 == 0 ? 1 : -1;
      for (double at = 0; at < half; at += dt) {
        const double error = side * size * (state.leans ? left_by_friction : at < tracked ? 1 : 0);
        tick(error);
      }
    }
  }
};

template <class S>
void three_opposed_jumps_show_a_load_that_alternates_and_then_friction_holds_the_tip() {
  Fixture<S> fixture;
  fixture.alternate(1, 2, 4 * jump);
  CLAIM(!fixture.state.alternates() && !fixture.state.leans);
  fixture.alternate(1, 2, 4 * jump, 0.1);
  CLAIM(fixture.state.alternates() && fixture.state.leans);
  CLAIM(fixture.leaned > 1.5);
}

// The stroke that has been wound for one load makes the jump to the next one larger, which is known after two. When a
// load is put on, nothing is wound.
template <class S>
void two_opposed_jumps_suffice_where_wound_strokes_made_both_larger() {
  const auto jumps = [](double before_first) {
    Fixture<S> fixture;
    fixture.stroke = S(before_first);
    for (double at = 0; at < 5; at += dt) fixture.tick(0);
    for (const double side : {1.0, -1.0}) {
      for (double at = 0; at < 3; at += dt) {
        fixture.tick(at < tracked ? side * 4 * jump : 0);
        if (at > tracked && !fixture.state.leans) fixture.stroke = S(side * 4 * jump);
      }
    }
    return fixture;
  };
  CLAIM(jumps(-4 * jump).state.leans);
  const auto put_on_and_taken_off = jumps(0);
  CLAIM(put_on_and_taken_off.state.jumps == 2 && put_on_and_taken_off.leaned == 0);
}

// As those of a load that is put on for long and is gone for a short time.
template <class S>
void jumps_at_unlike_distances_are_no_such_load() {
  Fixture<S> fixture;
  for (int n = 0; n < 6; ++n) {
    const double side = n % 2 == 0 ? 1 : -1;
    const double half = n % 2 == 0 ? 2.5 : 1;
    for (double at = 0; at < half; at += dt) fixture.tick(at < tracked ? side * 4 * jump : 0);
  }
  CLAIM(fixture.state.jumps > 3 && fixture.leaned == 0);
}

template <class S>
void a_tip_that_friction_does_not_hold_is_tracked() {
  Fixture<S> fixture;
  fixture.alternate(1, 12, 4 * jump, 0.9);
  CLAIM(!fixture.state.leans || fixture.leaned < 0.5 * fixture.time);
}

// Where friction holds less than half of the stroke, giving that back would free the tip anyway.
template <class S>
void friction_that_does_not_hold_half_of_the_stroke_begins_nothing() {
  const auto leaned = [](double held) {
    Fixture<S> fixture;
    fixture.holds = S(held);
    for (int n = 0; n < 6; ++n) {
      const double side = n % 2 == 0 ? 1 : -1;
      for (double at = 0; at < 1; at += dt) {
        fixture.tick(at < tracked ? side * 4 * jump : 0);
        if (at > tracked) fixture.stroke = S(side * 2 * jump);
      }
    }
    CLAIM(fixture.state.alternates());
    return fixture.leaned;
  };
  CLAIM(leaned(0.9 * jump) == 0);
  CLAIM(leaned(1.1 * jump) > 0);
}

// The law's own overshoot after a load that has been taken off, or a load after strokes that have moved the tip.
template <class S>
void two_jumps_of_unlike_sizes_begin_nothing() {
  const auto leaned = [](double first, double second, double last) {
    Fixture<S> fixture;
    for (const double size : {first, second, last})
      for (double at = 0; at < 1; at += dt) fixture.tick(at < tracked ? size * jump : 0);
    CLAIM(fixture.state.alternates());
    return fixture.leaned;
  };
  CLAIM(leaned(4, -8, 1.5) == 0);
  CLAIM(leaned(4, -8, 4) > 0);
  CLAIM(leaned(1.5, -1.5, 8) == 0);
  CLAIM(leaned(1.5, -1.5, 4) > 0);
}

template <class S>
void small_errors_and_jumps_to_one_side_are_no_such_load() {
  Fixture<S> small;
  small.alternate(1, 12, 0.9 * jump);
  CLAIM(small.state.jumps == 0 && small.leaned == 0);
  Fixture<S> one_sided;
  for (int n = 0; n < 6000; ++n) one_sided.tick(n % 1000 < 100 ? 4 * jump : 0);
  CLAIM(!one_sided.state.alternates() && one_sided.leaned == 0);
}

// A hand that moves makes jumps itself, and so does the motors' own stroke.
template <class S>
void neither_the_hand_nor_the_motors_make_a_load() {
  Fixture<S> moving;
  moving.alternate(1, 6, 4 * jump, 0.1);
  moving.tick(0, true);
  CLAIM(!moving.state.alternates() && !moving.state.leans);
  Fixture<S> stroke;
  for (int n = 0; n < 6000; ++n) {
    const double side = n / 1000 % 2 == 0 ? 1 : -1;
    const bool wound = n % 1000 < 100;
    stroke.stroke = S(wound ? 4 * side * jump : 0);
    stroke.tick(wound ? 4 * side * jump : 0);
  }
  CLAIM(!stroke.state.alternates() && stroke.leaned == 0);
}

template <class S>
void a_load_that_has_ceased_is_forgotten() {
  Fixture<S> fixture;
  fixture.alternate(1, 4, 4 * jump, 0.1);
  CLAIM(fixture.state.leans);
  for (double at = 0; at < 1.1 * tuning::alternation_longest; at += dt) fixture.tick(0);
  CLAIM(!fixture.state.leans && !fixture.state.alternates());
}

template <class S>
void what_friction_leaves_is_taken_away_and_a_stroke_given_back_only_as_far_as_friction_holds() {
  AlternationState<S> state{};
  state.mean = S(-1e-4);
  const S held = S(2e-5);
  const S speed = leaning_speed(state, S(0), S(0), held, S(12));
  CLAIM(speed < S(0));
  CLAIM_NEAR(double(speed), -12.0 * (1 - tuning::alternation_left) * double(held), 1e-9);
  CLAIM(leaning_speed(state, S(0), S(0), S(0), S(12)) == S(0));
  state.offset = S(1e-5);
  CLAIM(leaning_speed(state, S(0), S(0), S(0), S(12)) > S(0));
  // Where that takes the tip to its target, or motors are too slow for the load, the stroke goes all the way.
  state.offset = S(0);
  CLAIM_NEAR(double(leaning_speed(state, S(-jump), S(0), held, S(12))), 12.0 * double(state.mean), 1e-9);
  state.fast = true;
  CLAIM_NEAR(double(leaning_speed(state, S(0), S(0), held, S(12))), 12.0 * double(state.mean), 1e-9);
}

template <class S>
void in_one_precision() {
  three_opposed_jumps_show_a_load_that_alternates_and_then_friction_holds_the_tip<S>();
  two_opposed_jumps_suffice_where_wound_strokes_made_both_larger<S>();
  jumps_at_unlike_distances_are_no_such_load<S>();
  a_tip_that_friction_does_not_hold_is_tracked<S>();
  friction_that_does_not_hold_half_of_the_stroke_begins_nothing<S>();
  two_jumps_of_unlike_sizes_begin_nothing<S>();
  small_errors_and_jumps_to_one_side_are_no_such_load<S>();
  neither_the_hand_nor_the_motors_make_a_load<S>();
  a_load_that_has_ceased_is_forgotten<S>();
  what_friction_leaves_is_taken_away_and_a_stroke_given_back_only_as_far_as_friction_holds<S>();
}

int main() {
  in_one_precision<double>();
  in_one_precision<float>();
  return claims::report();
}

#pragma once
// Several twins of one kind in lockstep, one in each lane of vector registers.
//
// The equations are the twin's own (twin.hpp). What differs is the search: a pass over all tendons revises the guess of
// each lane, and is repeated while one lane needs it; a lane that has settled is left as it is, so that what a lane
// computes does not depend on its neighbours. Lanes that need many passes, or whose command is beyond what these steps
// know, are left to the twin's own step.

#include "tenodesis/lanes.hpp"
#include "tenodesis/twin.hpp"

#if defined(__GNUC__)

namespace tenodesis {

/// Most passes of a solve in lanes.
inline constexpr int most_lane_passes = 6;
/// Most corrections of the bands in a quasi-static step in lanes.
inline constexpr int most_lane_corrections = 16;
/// Most trials of the handle's angle of a step in lanes.
inline constexpr int most_lane_trials = 8;

/// Calls visit(lanes, single) for every number of a state in lanes and of a single one.
template <class Many, class One, class Visit>
[[gnu::always_inline]] inline void pair_states(Many& many, One& one, const Visit& visit) {
  visit(many.output_angle, one.output_angle);
  visit(many.output_velocity, one.output_velocity);
  visit(many.handle_angle, one.handle_angle);
  visit(many.handle_velocity, one.handle_velocity);
  visit(many.handle_moment, one.handle_moment);
  visit(many.tip_moment, one.tip_moment);
  visit(many.contact_force, one.contact_force);
  visit(many.contact_moment, one.contact_moment);
  visit(many.net_handle_torque, one.net_handle_torque);
  visit(many.handle_wanted, one.handle_wanted);
  visit(many.load.force, one.load.force);
  visit(many.load.radial_force, one.load.radial_force);
  visit(many.load.contact.angle, one.load.contact.angle);
  visit(many.load.contact.stiffness, one.load.contact.stiffness);
  visit(many.load.contact.damping, one.load.contact.damping);
  visit(many.sheath_bend, one.sheath_bend);
  for (int i = 0; i < 2; ++i) {
    visit(many.let_out[i], one.let_out[i]);
    visit(many.drive[i].speed, one.drive[i].speed);
    visit(many.drive[i].angle, one.drive[i].angle);
    visit(many.drive[i].spool, one.drive[i].spool);
    for (int j = 0; j < many.tendon[i].slip.size(); ++j) {
      visit(many.tendon[i].slip[j], one.tendon[i].slip[j]);
      visit(many.tendon[i].slide[j], one.tendon[i].slide[j]);
      visit(many.slip_speed[i][j], one.slip_speed[i][j]);
    }
    for (int j = 0; j < many.tendon[i].tension.size(); ++j) {
      visit(many.tendon[i].slack[j], one.tendon[i].slack[j]);
      visit(many.tendon[i].tension[j], one.tendon[i].tension[j]);
    }
  }
}

/// The steps of twins in lanes, which are quasi-static or are not; those with two vertices are not among them.
template <class T, bool resting>
struct InLanes {
  using S = T::S;
  using State = T::State;

  const T& twin;

  /// Steps the lanes that run, without their sensors; true in those that moved, the next state of others is undefined.
  [[gnu::always_inline]] Flag<S> step(const Command<S>& command, const Flag<S>& runs, const State& before,
                                      State& next) const {
    next.sheath_bend = command.sheath_bend;
    for (int i = 0; i < 2; ++i) {
      next.let_out[i] = command.let_out[i];
      next.drive[i] =
          advance(twin.drive, before.drive[i], command.spool_velocity[i], before.tendon[i].tension[0], twin.time_step);
    }
    const TipLoad<S> load = twin.load_of(command);
    const Flag<S> held = twin.hand.stiffness > S(0);
    next.net_handle_torque = before.net_handle_torque;
    const Flag<S> moved = any(held) ? move_handle(held, command.handle_angle, load, runs, before, next)
                                    : move_tip(command.handle_angle, load, runs, before, next);
    next.handle_wanted = command.handle_angle;
    next.load = load;
    return moved && finite(command, next);
  }

 private:
  // NaN and infinities in a command spread to what is summed here, or are an angle out of range.
  [[gnu::always_inline]] static Flag<S> finite(const Command<S>& command, const State& next) {
    const S sum = next.output_angle + next.output_velocity + next.tip_moment + next.drive[0].angle +
                  next.drive[1].angle + command.force + command.radial_force + command.weight +
                  command.spool_velocity[0] + command.spool_velocity[1] + command.sheath_bend + command.let_out[0] +
                  command.let_out[1] + command.contact.stiffness + command.contact.damping;
    // Not of infinities and NaN.
    const S none = sum - sum;  // NOLINT(misc-redundant-expression)
    return none == S(0) && abs(command.contact.angle) <= S(pi);
  }

  // Moves the tips to the step's end at given handle angles; true in the lanes that have settled.
  [[gnu::always_inline]] Flag<S> move_tip(const S& handle_angle, const TipLoad<S>& load, const Flag<S>& runs,
                                          const State& before, State& next) const {
    Tip<S> tip = twin.first_guess(before);
    typename T::Chain both = twin.chain(handle_angle, tip.angle, before, next);
    next.handle_angle = handle_angle;
    next.handle_velocity = (handle_angle - before.handle_angle) * twin.per_second();
    // Only the guess: the rest is what a pass writes.
    for (int i = 0; i < 2; ++i) {
      for (int j = 0; j < before.tendon[i].slide.size(); ++j) next.tendon[i].slide[j] = before.tendon[i].slide[j];
      for (int j = 0; j < before.tendon[i].slack.size(); ++j) next.tendon[i].slack[j] = before.tendon[i].slack[j];
    }
    next.sweeps = S(0);
    Flag<S> moved;
    if constexpr (resting)
      moved = balance(both, load, runs, before, tip, next);
    else
      moved = settle(both, load, runs, before, tip, next);
    twin.finish(load, before, tip, next);
    return moved && abs(handle_angle) <= twin.axis.handle_range + S(range_tolerance<ValueOf<S>>);
  }

  // Guess, pass, revise, in the lanes that run; true in those that have settled. Others stay as they are.
  [[gnu::always_inline]] Flag<S> settle(T::Chain& both, const TipLoad<S>& load, const Flag<S>& runs,
                                        const State& before, Tip<S>& tip, State& next) const {
    const S tolerance = twin.tolerance();
    Flag<S> open = runs;
    for (int pass = 0; pass < most_lane_passes && any(open); ++pass) {
      next.sweeps = next.sweeps + where(open, S(1), S(0));
      Reaction<S> end[2];
      for (int i = 0; i < 2; ++i)
        end[i] = twin.tendon.eliminate(both.band[i], both.spool[i], both.pull[i], before.tendon[i].slip, next.tendon[i],
                                       both.line[i]);
      Flag<S> revised = open;
      if constexpr (resting) {
        twin.at_rest().balance_tip(end, load, tip, revised);
        // Where the guess has no equilibrium, later passes are not to find one.
        tip.x = where(revised, S(std::numeric_limits<ValueOf<S>>::quiet_NaN()), tip.x);
      } else {
        twin.push_tip(end, load, before, tip, revised);
      }
      const S y = twin.axis.distal.excursion_slope() * tip.x;
      for (int i = 0; i < 2; ++i) {
        twin.tendon.substitute(both.spool[i], both.pull[i], both.line[i], i == agonist ? y : -y, next.tendon[i]);
        revised = revised || twin.tendon.revise_all(both.band[i], before.tendon[i].slip, tolerance, next.tendon[i]);
      }
      open = open && revised;
    }
    return runs && !open;
  }

  // Balances the tips at rest, with bands at the angle where each is found; true in the lanes that have settled.
  [[gnu::always_inline]] Flag<S> balance(T::Chain& both, const TipLoad<S>& load, const Flag<S>& runs,
                                         const State& before, Tip<S>& tip, State& next) const {
    S length[2];
    Flag<S> open = runs && !twin.at_rest().slack_about(both, load, length);
    Flag<S> found = false;
    S angle = tip.angle;
    for (int n = 0; n <= most_lane_corrections && any(open); ++n) {
      if (n > 0) {
        angle = where(open, tip.angle, angle);
        twin.set_bands(next.handle_angle, angle, before, next, both);
      }
      open = settle(both, load, open, before, tip, next);
      if (n == 0) continue;
      const Flag<S> agreed = open && abs(tip.angle - angle) <= S(settled<ValueOf<S>>);
      found = found || agreed;
      open = open && !agreed;
    }
    return found;
  }

  // Finds the handle angles at which hands and tendons are balanced, by the secant method; without a hand they are
  // given.
  [[gnu::always_inline]] Flag<S> move_handle(const Flag<S>& held, const S& wanted, const TipLoad<S>& load,
                                             const Flag<S>& runs, const State& before, State& next) const {
    S stiffness = twin.first_handle_stiffness(before);
    S angle = where(held, twin.first_handle_angle(before), wanted);
    S tried(0);
    S missed(0);
    Flag<S> open = held && runs;
    Flag<S> moved = runs;
    for (int n = 0; n < most_lane_trials; ++n) {
      // What a trial that has not settled leaves is no guide to the next.
      moved = move_tip(angle, load, moved, before, next);
      const S velocity = next.handle_velocity;
      const S off = unbalanced_handle(twin.hand, twin.step_of_hand(), angle, wanted, before, next);
      next.handle_velocity = where(held, next.handle_velocity, velocity);
      next.net_handle_torque = where(held, next.net_handle_torque, before.net_handle_torque);
      const S secant = n > 0 ? (missed - off) / (angle - tried) : S(0);
      stiffness = if_above(secant, secant, stiffness);
      const S correction = off / stiffness;
      open = open && !(abs(correction) <= S(settled<ValueOf<S>>));
      if (!any(open && moved)) break;
      tried = angle;
      missed = off;
      angle = where(open, angle + correction, angle);
    }
    return moved && !open;
  }
};

}  // namespace tenodesis

#endif

#pragma once
// The digital twin: the instrument on its bench, simulated in time steps: a handle, two spools on drives, two tendons
// with friction, a tip with inertia under load, and sensors.
//
// A tendon runs spool - load cell - sheath - handle joint - stem - tip joint - anchor. A joint of one vertex is one
// contact with its total wrap angle; the length that its bending draws lies on the far side from the stem, so that the
// stem's tension is on the held side whichever joint is moved. A joint of two vertices is two contacts with half of the
// angle each, and the length that its bending draws is that of the span between them. By virtual work the tension where
// a joint draws has its moment arm about the joint.
//
// A step is the trapezoidal rule for the tip's inertia, with tendons without mass. Their tensions are linear in the
// tip's coordinate while the guess of the sliding contacts holds (tendon.hpp), so that tip and tendons are solved
// together.

#include "tenodesis/twin_at_rest.hpp"

namespace tenodesis {

/// Steps of several twins at once (twin_lanes.hpp).
template <class T, bool resting>
struct InLanes;

/// One axis of an instrument on the bench; Law is one of friction.hpp's, Rows the rows of tendon.hpp.
template <class A, class RowsOf, class LawOf>
struct Twin {
  using S = A::Scalar;
  using Rows = RowsOf;
  using Law = LawOf;
  using State = TwinState<S, Rows>;
  using Line = Tendon<S, Rows>::Line;
  using Bands = Tendon<S, Rows>::Bands;
  using Lengths = Tendon<S, Rows>::Lengths;

  A axis{};
  Tendon<S, Rows> tendon{};
  Law law{};
  Friction<S> friction{};
  Body<S> body{};
  Hand<S> hand{};
  Drive<S> drive{};
  Rig<S> rig{};
  Sensors<S> sensors{};
  S time_step{};
  int steps_per_sample{1};
  bool quasi_static{};
  int joint_vertices{1};  ///< per joint, where the rows do not say

  template <class T, bool resting>
  friend struct InLanes;
  friend struct AtRest<Twin>;

  /// At rest, both tendons at pretension and all else at zero.
  State rest(std::uint64_t seed) const {
    State state{};
    for (auto& own : state.tendon)
      for (int i = 0; i <= tendon.contacts(); ++i) own.tension[i] = tendon.rest_tension;
    for (auto& own : state.drive) own.angle = drive.backlash * S(0.5);
    for (auto& own : state.current) own = {tendon.rest_tension, drive.backlash * S(0.5), S(0)};
    state.noise.seed = seed;
    state.reading = readings(sensors, drive, state);
    state.until_sample = steps_per_sample;
    return state;
  }

  /// Advances the state by one step; it is unchanged unless the status is ok.
  Status step(const Command<S>& command, State& state) const {
    if (!command.finite()) return Status::not_finite;
    if (abs(command.contact.angle) > S(pi)) return Status::unreachable;
    State next = state;
    next.sheath_bend = command.sheath_bend;
    for (int i = 0; i < 2; ++i) next.let_out[i] = command.let_out[i];
    next.residual_in_parts = S(-1);
    const TipLoad<S> load = load_of(command);
    for (int i = 0; i < 2; ++i)
      next.drive[i] = advance(drive, state.drive[i], command.spool_velocity[i], state.tendon[i].tension[0], time_step);
    Status found = move(command.handle_angle, load, state, next);
    if (found == Status::no_equilibrium && quasi_static)
      found = at_rest().move_in_parts(command.handle_angle, load, state, next);
    if (found != Status::ok) return found;
    next.handle_wanted = command.handle_angle;
    next.load = load;
    if (--next.until_sample <= 0) {
      next.reading = readings(sensors, drive, next);
      next.until_sample = steps_per_sample;
    }
    state = next;
    return Status::ok;
  }

  TipLoad<S> load_of(const Command<S>& command) const {
    return {{command.force + rig.force(command.weight), command.radial_force}, command.contact};
  }

  /// Torque that the hand holds the handle with, N m.
  S handle_torque(const Command<S>& command, const State& state) const {
    const S resistance = quasi_static ? S(0) : hand.damping * state.handle_velocity;
    const S torque = hand.stiffness * (command.handle_angle - state.handle_angle) - resistance;
    return if_above(hand.stiffness, torque, state.handle_moment);
  }

  /// Expected readings; in dual numbers without noise and steps.
  Reading<S> expected(State state) const { return readings(sensors, drive, state); }

  /// Largest violation of the friction law in a step, as a share of the tension scale.
  S residual(const State& before, const State& after) const {
    if (after.residual_in_parts >= S(0)) return after.residual_in_parts;
    S worst(0);
    for (int i = 0; i < 2; ++i) {
      const S tip_angle = quasi_static ? after.output_angle : first_guess(before).angle;
      const Bands band = bands_of(i, after.handle_angle, tip_angle, before, after);
      worst = larger(worst, tendon.residual(band, before.tendon[i].slip, after.tendon[i]));
    }
    return worst / tension_scale();
  }

  /// A typical tension, N.
  S tension_scale() const { return tendon.rest_tension + axis.stiffness * axis.distal.excursion_slope() * S(0.1); }

  /// Moment of everything on the tip except its inertia and tissue, positive in flexion, N m.
  S tip_moment(const S& angle, const S& velocity, const S& x, const S& difference, const Load<S>& load) const {
    return difference * axis.distal.moment_arm(x) - axis.distal.passive_stiffness() * angle -
           load.force * axis.distal.tangential_arm(x) + load.radial_force * axis.distal.radial_arm(x) -
           body.damping * velocity - body.stop_stiffness * beyond_stop(angle);
  }

  // A single division per step, since the compiler sees that all uses are the same.
  S per_second() const { return S(1) / time_step; }
  /// Contacts of a joint.
  int vertices() const {
    if constexpr (requires { Rows::vertices_per_joint; })
      return Rows::vertices_per_joint;
    else
      return joint_vertices;
  }
  int sheath_contacts() const { return tendon.contacts() - tendon_joints * vertices(); }

  /// The segment in which the tip's joint draws a tendon.
  int tip_segment() const { return tendon.contacts() + 1 - vertices(); }

  /// Excess of an output angle over the mechanical stop, rad.
  S beyond_stop(const S& angle) const { return angle - clamp(angle, -body.stop, body.stop); }

 private:
  AtRest<Twin> at_rest() const { return {*this}; }
  bool prescribed() const { return !(hand.stiffness > S(0)); }
  // Where the handle's joint draws.
  int handle_segment() const { return sheath_contacts() + vertices() - 1; }
  static S difference_in(int segment, const State& state) {
    return state.tendon[agonist].tension[segment] - state.tendon[antagonist].tension[segment];
  }

  // Both tendons in a pass: bands, spool ends and lengths drawn by the handle.
  struct Chain {
    Bands band[2]{};
    Reaction<S> spool[2]{};
    Lengths pull[2]{};
    Line line[2]{};
  };

  Chain chain(const S& handle_angle, const S& tip_angle, const State& before, const State& next) const {
    Chain both{};
    const S drawn = axis.proximal.excursion_slope() * axis.proximal.coordinate(handle_angle);
    for (int i = 0; i < 2; ++i) {
      both.pull[i][handle_segment()] = i == agonist ? drawn : -drawn;
      both.spool[i] = tendon.held_by_spool(drive.spool_radius * next.drive[i].spool - next.let_out[i]);
    }
    set_bands(handle_angle, tip_angle, before, next, both);
    return both;
  }

  Bands bands_of(int i, const S& handle_angle, const S& tip_angle, const State& before, const State& next) const {
    return bands(*this, handle_angle, tip_angle, next.sheath_bend, before.slip_speed[i], before.tendon[i].tension);
  }

  void set_bands(const S& handle_angle, const S& tip_angle, const State& before, const State& next, Chain& both) const {
    both.band[0] = bands_of(0, handle_angle, tip_angle, before, next);
    both.band[1] = Law::depends_on_speed || Law::depends_on_tension ? bands_of(1, handle_angle, tip_angle, before, next)
                                                                    : both.band[0];
  }

  Status move(const S& handle_angle, const TipLoad<S>& load, const State& before, State& next) const {
    return prescribed() ? move_tip(handle_angle, load, before, next) : move_handle(handle_angle, load, before, next);
  }

  // Rare branches are kept out of line, where they cost the common one no registers, and compile time.

  // Moves the tip to the step's end at a given handle angle.
  Status move_tip(const S& handle_angle, const TipLoad<S>& load, const State& before, State& next) const {
    if (check_handle(axis, handle_angle) != Status::ok) return Status::out_of_range;
    Tip<S> tip = first_guess(before);
    Chain both = chain(handle_angle, tip.angle, before, next);
    next.handle_angle = handle_angle;
    next.handle_velocity = (handle_angle - before.handle_angle) * per_second();
    for (int i = 0; i < 2; ++i) next.tendon[i] = before.tendon[i];
    next.sweeps = 0;
    const bool loose = quasi_static && at_rest().stays_loose(both, load, before, next, tip);
    Status found = loose ? Status::ok : settle(both, load, before, tip, next);
    // Quasi-static, the tip's wrap angle is that at the step's end; in motion the first guess is close enough.
    bool agreed = !quasi_static || loose;
    for (int n = 0; !agreed && found == Status::ok && n < most_corrections; ++n) {
      const S angle = tip.angle;
      set_bands(handle_angle, angle, before, next, both);
      found = settle(both, load, before, tip, next);
      agreed = abs(tip.angle - angle) <= settled<ValueOf<S>>;
    }
    if (found == Status::ok && !agreed) return Status::no_equilibrium;
    if (found != Status::ok) return found;

    finish(load, before, tip, next);
    return Status::ok;
  }

  // What follows from the tip's angle and the tensions at the step's end.
  void finish(const TipLoad<S>& load, const State& before, const Tip<S>& tip, State& next) const {
    next.output_angle = tip.angle;
    next.output_velocity =
        quasi_static ? (tip.angle - before.output_angle) * per_second() : velocity(before, tip.angle);
    const S difference = difference_in(tip_segment(), next);
    next.tip_moment = tip_moment(tip.angle, next.output_velocity, tip.x, difference, load);
    const Resistance<S> tissue = resistance_of(load.contact, before, tip);
    next.contact_force = tissue.force;
    next.contact_moment = tissue.moment;
    next.handle_moment =
        difference_in(handle_segment(), next) * axis.proximal.moment_arm(axis.proximal.coordinate(next.handle_angle));
    if constexpr (Law::depends_on_speed)
      for (int i = 0; i < 2; ++i)
        for (int j = 0; j < tendon.contacts(); ++j)
          next.slip_speed[i][j] =
              law.speed_after(before.slip_speed[i][j], next.tendon[i].slip[j] - before.tendon[i].slip[j], time_step);
  }

  Tip<S> first_guess(const State& before) const {
    if (quasi_static) return tip_at(axis.distal, before.output_angle);
    const S moment = before.tip_moment + before.contact_moment;
    const S velocity = before.output_velocity + moment / body.inertia * time_step * S(0.5);
    return {before.output_angle + velocity * time_step, S(0)};
  }

  // Guess of how the torque on the handle falls with its angle.
  S first_handle_stiffness(const State& before) const {
    const S arm = axis.proximal.moment_arm(axis.proximal.coordinate(before.handle_angle));
    return handle_stiffness(hand, step_of_hand(), S(2) * axis.stiffness * arm * arm);
  }

  S first_handle_angle(const State& before) const {
    return before.handle_angle + (quasi_static ? S(0) : before.handle_velocity * time_step);
  }

  // Without inertia and damping a step takes no time.
  S step_of_hand() const { return quasi_static ? S(0) : time_step; }

  S tolerance() const { return friction_tolerance<ValueOf<S>> * tension_scale(); }

  // How a tendon's tension at the tip's joint reacts to the length that the joint lets out, under the present guess.
  Reaction<S> reaction(Chain& both, int i, const State& before, const State& next) const {
    const auto& from = before.tendon[i].slip;
    if (vertices() == 1)
      return tendon.eliminate(both.band[i], both.spool[i], both.pull[i], from, next.tendon[i], both.line[i]);
    const Reaction<S> end = tendon.eliminate(tendon.contacts() - 1, both.band[i], both.spool[i], both.pull[i], from,
                                             next.tendon[i], both.line[i]);
    return tendon.eliminate_last(both.band[i], end, both.pull[i], from, next.tendon[i], both.line[i]);
  }

  // Guess, pass, revise (tendon.hpp), with the tip's own equation at the tendons' end.
  Status settle(Chain& both, const TipLoad<S>& load, const State& before, Tip<S>& tip, State& next) const {
    const Tip<S> start = tip;
    for (int sweep = 1; sweep <= hasty_sweeps; ++sweep) {
      ++next.sweeps;
      Reaction<S> end[2];
      for (int i = 0; i < 2; ++i) end[i] = reaction(both, i, before, next);
      if (correct_tip(end, load, before, tip) != Status::ok) break;
      const S y = axis.distal.excursion_slope() * tip.x;
      int revised = 0;
      for (int i = 0; i < 2; ++i) {
        const S drawn = i == agonist ? y : -y;
        if (vertices() == 1)
          tendon.substitute(both.spool[i], both.pull[i], both.line[i], drawn, next.tendon[i]);
        else
          tendon.substitute_last(both.spool[i], both.pull[i], both.line[i], drawn, next.tendon[i]);
        revised += tendon.revise(both.band[i], before.tendon[i].slip, tolerance(), next.tendon[i]);
      }
      if (revised == 0) return Status::ok;
    }
    tip = start;
    return settle_by_bracketing(both, load, before, tip, next);
  }

  // Solves one tendon with the tip held.
  int settle_alone(Chain& both, int i, const State& before, const Tip<S>& tip, State& next) const {
    const S y = axis.distal.excursion_slope() * tip.x;
    Lengths pull = both.pull[i];
    pull[tip_segment()] = pull[tip_segment()] + (i == agonist ? -y : y);
    next.tendon[i].slip = before.tendon[i].slip;
    return tenodesis::settle(tendon, both.band[i], pull, both.spool[i], tolerance(), next.tendon[i], both.line[i]);
  }

  // Solves the tip's equation by bracketing, with both tendons solved for every trial: slower, but up to a fold the
  // moment falls with the tip's angle, so that its sign shows on which side the solution lies.
  [[gnu::noinline, gnu::cold]] Status settle_by_bracketing(Chain& both, const TipLoad<S>& load, const State& before,
                                                           Tip<S>& tip, State& next) const {
    S low = -axis.distal.angle(axis.distal.limit());
    S high = -low;
    for (int turn = 0; turn < most_corrections; ++turn) {
      tip.x = axis.distal.coordinate(tip.angle);
      Reaction<S> end[2];
      for (int i = 0; i < 2; ++i) {
        next.sweeps += settle_alone(both, i, before, tip, next);
        end[i] = reaction(both, i, before, next);
      }
      const S push = unbalanced_at(load, before, next, tip);
      if (push == S(0)) return held_at(tip);
      Tip<S> better = tip;
      const bool corrected = correct_tip(end, load, before, better) == Status::ok && better.angle != tip.angle;
      if (corrected && abs(better.angle - tip.angle) <= settled<ValueOf<S>>) return held_at(tip);
      (push > S(0) ? low : high) = tip.angle;
      const bool inside = corrected && better.angle > low && better.angle < high;
      tip.angle = inside ? better.angle : (low + high) * S(0.5);
      if (high - low <= settled<ValueOf<S>>) break;
    }
    return high - low <= settled<ValueOf<S>> ? held_at(tip) : Status::no_equilibrium;
  }

  // At the end of the joint's range tendons have no moment arm: a load that gets there is not held.
  Status held_at(const Tip<S>& tip) const {
    return abs(tip.x) < axis.distal.limit() * S(0.999) ? Status::ok : Status::no_equilibrium;
  }

  // Unbalanced moment on the tip with the present tensions.
  S unbalanced_at(const TipLoad<S>& load, const State& before, const State& next, const Tip<S>& tip) const {
    const S difference = difference_in(tip_segment(), next);
    if (quasi_static) {
      const Demand<S> demand = at_rest().demand_at(tip.x, load);
      return difference * demand.weight - demand.value;
    }
    return unbalanced(tip, difference, load, before) + resistance_of(load.contact, before, tip).moment;
  }

  // Mean moment of the step's two ends, without tissue's, less the moment that accelerates the tip this far.
  S unbalanced(const Tip<S>& tip, const S& difference, const Load<S>& load, const State& before) const {
    const S moment = tip_moment(tip.angle, velocity(before, tip.angle), tip.x, difference, load);
    const S turned = tip.angle - before.output_angle;
    return (moment + before.tip_moment) * S(0.5) - inertial() * (turned - before.output_velocity * time_step);
  }

  Resistance<S> resistance_of(const Contact<S>& contact, const State& before, const Tip<S>& tip) const {
    if (!any(contact.present())) return {};
    if (quasi_static) return resistance_at_rest(axis.distal, contact, tip);
    return resistance(axis.distal, contact, per_second(), before.output_angle, tip);
  }

  S inertial() const { return S(2) * body.inertia * per_second() * per_second(); }

  S velocity(const State& before, const S& angle) const {
    return S(2) * per_second() * (angle - before.output_angle) - before.output_velocity;
  }

  // The trapezoidal rule: the mean moment of the step's two ends accelerates the tip, and tissue's over the step.
  // Open is where it has not converged.
  void push_tip(const Reaction<S>* end, const TipLoad<S>& load, const State& before, Tip<S>& tip, Flag<S>& open) const {
    const S slope = axis.distal.excursion_slope();
    const S pull = end[agonist].at_rest - end[antagonist].at_rest;
    const S springs = end[agonist].stiffness + end[antagonist].stiffness;
    const S rate = springs * slope;
    const S spring = axis.distal.passive_stiffness() + body.damping * S(2) * per_second();
    for (int n = 0; n < most_corrections; ++n) {
      const S x = axis.distal.coordinate(tip.angle);
      const S arm = axis.distal.moment_arm(x);
      const S stop = where(Flag<S>(beyond_stop(tip.angle) == S(0)), S(0), body.stop_stiffness);
      const Resistance<S> tissue = resistance_of(load.contact, before, {tip.angle, x});
      const S stiffness = (springs * arm * arm + spring + stop) * S(0.5) + inertial() + tissue.stiffness;
      const S correction = (unbalanced({tip.angle, x}, pull - rate * x, load, before) + tissue.moment) / stiffness;
      const S angle = tip.angle + correction;
      tip.angle = where(open, angle, tip.angle);
      tip.x = where(open, x + correction * arm / slope, tip.x);
      const Flag<S> lost = open && !(abs(angle) < S(pi));
      if (any(lost)) {
        tip.angle = where(lost, S(std::numeric_limits<ValueOf<S>>::quiet_NaN()), tip.angle);
        if (!any(open && !lost)) return;
      }
      // The slope neglects terms orders of magnitude below the inertia: the next correction would be rounding.
      using V = ValueOf<S>;
      constexpr V arrived = sizeof(V) == 4 ? V(1e-5) : V(1e-7);
      open = open && !(abs(correction) <= S(arrived));
      if (!any(open)) return;
    }
  }

  Status correct_tip(const Reaction<S>* end, const TipLoad<S>& load, const State& before, Tip<S>& tip) const {
    Flag<S> open = true;
    if (quasi_static)
      at_rest().balance_tip(end, load, tip, open);
    else
      push_tip(end, load, before, tip, open);
    return any(open) ? Status::no_equilibrium : Status::ok;
  }

  // Finds the handle angle at which hand and tendons are balanced, by the secant method.
  [[gnu::noinline]] Status move_handle(const S& wanted, const TipLoad<S>& load, const State& before,
                                       State& next) const {
    S stiffness = first_handle_stiffness(before);
    S angle = first_handle_angle(before);
    S tried(0);
    S missed(0);
    for (int n = 0; n < most_corrections; ++n) {
      const Status found = move_tip(angle, load, before, next);
      if (found != Status::ok) return found;
      const S off = unbalanced_handle(hand, step_of_hand(), angle, wanted, before, next);
      const S secant = n > 0 ? (missed - off) / (angle - tried) : S(0);
      if (secant > S(0)) stiffness = secant;
      const S correction = off / stiffness;
      if (abs(correction) <= settled<ValueOf<S>>) return Status::ok;
      tried = angle;
      missed = off;
      angle = angle + correction;
    }
    return Status::no_equilibrium;
  }
};

}  // namespace tenodesis

#pragma once
// What only quasi-static steps of a twin have: the tip is balanced where it rests, may lie loose between slack tendons,
// and a large step is divided.

#include "tenodesis/twin_parts.hpp"

namespace tenodesis {

/// Most corrections of an angle in one solve.
inline constexpr int most_corrections = 64;
/// Most parts that a quasi-static step is divided into.
inline constexpr int most_parts = 1024;

/// The quasi-static steps of a twin (twin.hpp).
template <class T>
struct AtRest {
  using S = T::S;
  using State = T::State;
  using Chain = T::Chain;

  const T& twin;

  Demand<S> demand_at(const S& x, const TipLoad<S>& load) const {
    return any(load.contact.present()) ? demand_in_tissue(twin.axis.distal, x, load) : twin.axis.distal.demand(x, load);
  }

  // Newton's iteration on the moment balance at rest (eq. 1), in the joint's own coordinate. Open is where it has not
  // converged.
  void balance_tip(const Reaction<S>* end, const TipLoad<S>& load, Tip<S>& tip, Flag<S>& open) const {
    const auto& joint = twin.axis.distal;
    const S pull = end[agonist].at_rest - end[antagonist].at_rest;
    const S rate = (end[agonist].stiffness + end[antagonist].stiffness) * joint.excursion_slope();
    const S longest = joint.limit() * S(0.2);
    Flag<S> searched = open;
    Flag<S> moved = false;
    for (int n = 0; n < most_corrections && any(searched); ++n) {
      const Demand<S> demand = demand_at(tip.x, load);
      const S slope = rate * demand.weight + demand.slope;
      // Both tendons are slack by the guess: the next pass revises it.
      open = open && !(searched && slope == S(0));
      searched = searched && slope > S(0);
      if (!any(searched)) break;
      const S correction = ((pull - rate * tip.x) * demand.weight - demand.value) / slope;
      tip.x = where(searched, tip.x + clamp(correction, -longest, longest), tip.x);
      moved = moved || searched;
      searched = searched && abs(tip.x) < joint.limit();
      const Flag<S> arrived = searched && abs(correction) <= S(settled<ValueOf<S>>);
      open = open && !arrived;
      searched = searched && !arrived;
    }
    if (any(moved)) tip.angle = where(moved, joint.angle(tip.x), tip.angle);
  }

  // Where the tendons would let a tip without load and spring stay where it is; length: that each lets out.
  Flag<S> slack_about(const Chain& both, const TipLoad<S>& load, S (&length)[2]) const {
    const Flag<S> bare =
        load.force == S(0) && load.radial_force == S(0) && !(twin.axis.distal.passive_stiffness() > S(0));
    if (!any(bare)) return bare;
    for (int i = 0; i < 2; ++i)
      length[i] = twin.tendon.rest_tension / twin.axis.stiffness + both.pull[i][twin.handle_segment()] +
                  (both.spool[i].at_rest - twin.tendon.rest_tension) / both.spool[i].stiffness;
    return bare && length[agonist] + length[antagonist] < S(0);
  }

  // Between two slack tendons, a tip without load and spring stays where it is, or is moved by the tendon that becomes
  // tight. Friction may keep parts of a loose tendon tight, which then move it.
  [[gnu::noinline, gnu::cold]] bool stays_loose(Chain& both, const TipLoad<S>& load, const State& before, State& next,
                                                Tip<S>& tip) const {
    S length[2];
    if (!slack_about(both, load, length)) return false;
    const auto& joint = twin.axis.distal;
    const S slope = joint.excursion_slope();
    const S x = clamp(tip.x, length[agonist] / slope, -length[antagonist] / slope);
    const Tip<S> resting{joint.angle(x), x};
    if (touches(joint, load.contact, resting)) return false;
    twin.set_bands(next.handle_angle, resting.angle, before, next, both);
    S tightest(0);
    for (int i = 0; i < 2; ++i) {
      next.sweeps += twin.settle_alone(both, i, before, resting, next);
      tightest = larger(tightest, next.tendon[i].tension[twin.tip_segment()]);
    }
    if (tightest <= twin.tolerance()) {
      tip = resting;
      return true;
    }
    for (int i = 0; i < 2; ++i) next.tendon[i] = before.tendon[i];
    twin.set_bands(next.handle_angle, tip.angle, before, next, both);
    return false;
  }

  // Divides a large step: a guess within it may have no equilibrium although the tendons have one.
  [[gnu::noinline, gnu::cold]] Status move_in_parts(const S& handle_angle, const TipLoad<S>& load, const State& before,
                                                    State& next) const {
    const State wound = next;
    Status found = Status::no_equilibrium;
    for (int parts = 16; parts <= most_parts && found == Status::no_equilibrium; parts *= 8) {
      T part = twin;
      part.time_step = twin.time_step / S(parts);
      State at = before;
      S worst(0);
      int sweeps = 0;
      found = Status::ok;
      for (int k = 1; k <= parts && found == Status::ok; ++k) {
        const S share = S(k) / S(parts);
        const auto between = [&](const S& from, const S& to) { return from + (to - from) * share; };
        State to = at;
        to.sheath_bend = wound.sheath_bend;
        for (int i = 0; i < 2; ++i) {
          to.let_out[i] = wound.let_out[i];
          to.drive[i] = wound.drive[i];
          to.drive[i].spool = between(before.drive[i].spool, wound.drive[i].spool);
        }
        const TipLoad<S> carried{
            {between(before.load.force, load.force), between(before.load.radial_force, load.radial_force)},
            load.contact};
        found = part.move(between(before.handle_wanted, handle_angle), carried, at, to);
        worst = larger(worst, part.residual(at, to));
        sweeps += to.sweeps;
        at = to;
      }
      next = at;
      next.sweeps = sweeps;
      next.residual_in_parts = worst;
    }
    next.output_velocity = (next.output_angle - before.output_angle) * twin.per_second();
    next.handle_velocity = (next.handle_angle - before.handle_angle) * twin.per_second();
    return found;
  }
};

}  // namespace tenodesis

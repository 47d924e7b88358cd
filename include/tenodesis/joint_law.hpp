#pragma once
// Strokes of all spools that bring the joints of any chain to their targets, from an observer's estimate of them.
//
// What a joint has lost is target less estimate, and what the motors have already given back. The motors are to move
// the joints by a stroke between nothing and twice the least loss that the estimate's deviation admits: whatever is
// true within it, no joint is then farther from its target than with motors off. Strokes are the routing matrix times
// the coordinates to move; springs that share the moment with the tendons are counted in. Tendons about to go slack are
// tightened by strokes that turn no joint.

#include "tenodesis/joint_observer.hpp"
#include "tenodesis/supervisor.hpp"
#include "tenodesis/watch.hpp"

namespace tenodesis {

template <class S, int N, int M>
struct JointLawMemory {
  S given[N]{};   ///< coordinates that the motors wind beyond the targets
  S common[M]{};  ///< strokes that turn no joint, m
  S beyond[M]{};  ///< strokes of both, m
  S opening{};    ///< of the jaws by their targets with a play, m
  S before[M]{};  ///< strokes of the last tick, their targets' included, m
  S homing{};     ///< time that is left of it, s
  bool started{};
};

/// Law of a chain W.
template <class W>
struct JointLaw {
  using S = W::S;
  static constexpr int N = W::joints, M = W::tendons;
  using Measured = JointMeasurement<S, N, M>;
  using Estimate = JointEstimate<S, N, M>;
  using Memory = JointLawMemory<S, N, M>;

  W chain{};
  S rate{};           ///< at which a loss is given back, 1/s
  S gain{};           ///< of the spools' positions, 1/s
  S speed{};          ///< of the spools, m/s
  S spool_radius{};   ///< m
  S tension_limit{};  ///< N
  S least_tension{};  ///< share of the pretension
  S deviations{2};    ///< of the estimate that a stroke leaves room for
  S period{};         ///< of a tick, s
  S homing_time{};    ///< s
  S homing_rise{};    ///< of the tensions in it, share of the pretension
  /// What is constant.
  struct Prepared {
    S within[N][N]{};    ///< of lost coordinates, what tendons can give
    S response[N][N]{};  ///< coordinates by which joints follow those that motors wind, springs counted in
    S settled[N][M]{};   ///< coordinates by lengths wound, were there no springs, 1/m
  } prepared{};

  /// Prepares that; false where tendons and springs leave a joint free. In float springs of arcs would be lost in
  /// rounding.
  bool prepare() {
    Square<S, N> tendons{};
    for (int m = 0; m < M; ++m)
      for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j)
          tendons.at[i][j] = tendons.at[i][j] + chain.stiffness[m] * chain.arm[m][i] * chain.arm[m][j];
    S largest(0);
    for (int i = 0; i < N; ++i) largest = larger(largest, tendons.at[i][i]);
    // Of arcs that tendons bend together each is to have its part: the least solution.
    Root<S, N> by_tendons{tendons}, whole{tendons};
    S least[N];
    for (int i = 0; i < N; ++i) {
      least[i] = S(least_share) * largest;
      by_tendons.lower.at[i][i] = by_tendons.lower.at[i][i] + least[i];
      const S per_turn = Bend<S>(chain.joint[i], S(0)).per_turn;
      whole.lower.at[i][i] = whole.lower.at[i][i] + least[i] + chain.joint[i].stiffness * per_turn * per_turn;
    }
    chain.add_tie_rates(S(-1), whole.lower.at);
    if (!by_tendons.take(least) || !whole.take(least)) return false;
    const auto column = [](const Root<S, N>& root, S* right, auto& to, int j) {
      root.solve(right);
      for (int i = 0; i < N; ++i) to[i][j] = right[i];
    };
    for (int j = 0; j < larger(N, M); ++j) {
      S within[N], answered[N], settled[N];
      for (int i = 0; i < N; ++i) {
        if (j < N) within[i] = answered[i] = tendons.at[i][j];
        if (j < M) settled[i] = chain.stiffness[j] * chain.arm[j][i];
      }
      if (j < N) column(by_tendons, within, prepared.within, j);
      if (j < N) column(whole, answered, prepared.response, j);
      if (j < M) column(by_tendons, settled, prepared.settled, j);
    }
    return true;
  }

  /// Angles that are commanded (rad), and beyond them those to which lengths wound (m), if there are, turn unloaded
  /// joints.
  void aim(const S* commanded, const S* wound, S* angle) const {
    S x[N];
    if (wound != nullptr) unload(wound, x);
    for (int i = 0; i < N; ++i)
      angle[i] = commanded[i] + (wound != nullptr ? angle_at(chain.joint[i].mechanism, x[i]) : S(0));
  }

  /// Coordinates of the joints where tendons do not stretch: by the handle's angles, or of a tool without one by the
  /// angles commanded (rad).
  void targets(const S* handle_angle, const S* commanded, S* x) const {
    if (chain.handles == 0) {
      for (int i = 0; i < N; ++i) x[i] = coordinate_at(chain.joint[i].mechanism, commanded[i]);
      return;
    }
    S none[M]{}, wound[M];
    chain.wind(handle_angle, none, wound);
    unload(wound, x);
  }

  /// Velocities of the spools for the next tick, rad/s; unless it compensates, they follow the targets alone.
  void update(const Measured& measured, const Estimate& found, const S* commanded, bool compensates, Memory& memory,
              S* velocity) const {
    for (int m = 0; m < M; ++m) velocity[m] = S(0);
    if (!found.valid) return;
    S target[N], lost[N], moved[N], stroke[M];
    targets(measured.handle_angle, commanded, target);
    bool tense = false;
    for (int m = 0; m < M; ++m) tense = tense || measured.tension[m] > tension_limit;
    S apart[N], turn[N];
    for (int i = 0; i < N; ++i) {
      const Mechanism mechanism = chain.joint[i].mechanism;
      const S x = coordinate_at(mechanism, found.angle[i]);
      apart[i] = target[i] - x;
      turn[i] = turn_at(mechanism, x);
    }
    for (int i = 0; i < N; ++i) {
      lost[i] = moved[i] = S(0);
      for (int j = 0; j < N; ++j) {
        lost[i] = lost[i] + prepared.within[i][j] * apart[j];
        moved[i] = moved[i] + prepared.response[i][j] * memory.given[j];
      }
      lost[i] = lost[i] + moved[i];
    }
    leave_grip(target, memory, lost);
    for (int i = 0; i < N; ++i) {
      const S uncertainty = deviations * sqrt(larger(variance(i, found, turn), S(0)));
      const S room = S(2) * larger(abs(lost[i]) - uncertainty, S(0));
      const S aim = clamp(lost[i], -room, room);
      // What is certainly off is brought nearer, also where friction keeps it there after strokes that went back.
      const S off = lost[i] - moved[i];
      const S most = S(2) * larger(abs(off) - uncertainty, S(0));
      const S nearer = clamp(off, -most, most);
      const S change = most == S(0) ? aim - moved[i]
                       : off > S(0) ? larger(aim - moved[i], nearer)
                                    : smaller(aim - moved[i], nearer);
      const S step = tense || !compensates ? -memory.given[i] : change;
      memory.given[i] = memory.given[i] + rate * period * step;
    }
    if (compensates) tighten(found, memory);
    if (chain.handles > 0)
      for (S& one : target) one = S(0);
    chain.excursions(target, stroke);
    chain.excursions(memory.given, memory.beyond);
    if (memory.homing > S(0)) wind_alike(memory.homing, stroke);
    for (int m = 0; m < M; ++m) {
      memory.beyond[m] = memory.beyond[m] + memory.common[m];
      stroke[m] = stroke[m] + memory.beyond[m];
      const S ahead = memory.started ? (stroke[m] - memory.before[m]) / period : S(0);
      const S off = stroke[m] - spool_radius * measured.spool_angle[m];
      velocity[m] = chain.motor[m] ? clamp(ahead + gain * off, -speed, speed) / spool_radius : S(0);
      memory.before[m] = stroke[m];
    }
    memory.started = true;
  }

 private:
  // By which jaws are commanded to close, or to open again, at least, as an angle of each, rad.
  static constexpr double least_closing = 0.01;
  // Stiffness of a joint that no tendon holds, as a share of the stiffest.
  static constexpr double least_share = 1e-7;

  // Coordinates that lengths wound (m) move unloaded joints to, were there no springs.
  void settle(const S* wound, S* x) const {
    for (int i = 0; i < N; ++i) {
      x[i] = S(0);
      for (int m = 0; m < M; ++m) x[i] = x[i] + prepared.settled[i][m] * wound[m];
    }
  }

  // Strokes (m) that wind all tendons alike and turn no joint, up and down while homing, of which so much time is left.
  // All contacts slip both ways: stiffness follows from tensions by lengths, friction from how these differ.
  void wind_alike(const S& left, S* stroke) const {
    const S rise = homing_rise * (S(1) - abs(S(2) * left / homing_time - S(1)));
    S wound[M], turned[N], excursion[M];
    for (int m = 0; m < M; ++m)
      wound[m] = chain.motor[m] && chain.stiffness[m] > S(0) ? rise * chain.pretension[m] / chain.stiffness[m] : S(0);
    settle(wound, turned);
    chain.excursions(turned, excursion);
    for (int m = 0; m < M; ++m) stroke[m] = stroke[m] + wound[m] - excursion[m];
  }

  // Coordinates that lengths wound (m) move unloaded joints to, against their springs.
  void unload(const S* wound, S* x) const {
    S settled[N];
    settle(wound, settled);
    for (int i = 0; i < N; ++i) {
      x[i] = S(0);
      for (int j = 0; j < N; ++j) x[i] = x[i] + prepared.response[i][j] * settled[j];
    }
  }

  // Of the part of a coordinate that tendons can move; turn: rates of the coordinates by the angles.
  S variance(int i, const Estimate& found, const S* turn) const {
    S row[N], sum(0);
    for (int j = 0; j < N; ++j) row[j] = prepared.within[i][j] * turn[j];
    for (int j = 0; j < N; ++j) {
      S part = S(0.5) * found.covariance.at[j][j] * row[j];
      for (int k = 0; k < j; ++k) part = part + found.covariance.at[j][k] * row[k];
      sum = sum + row[j] * part;
    }
    return S(2) * sum;
  }

  // Takes the jaws' opening out of what is lost where they were last commanded to close: something may hold them open,
  // and their grip is as commanded.
  void leave_grip(const S* target, Memory& memory, S* lost) const {
    S size(0), opened(0), aim(0), play(0);
    for (int i = 0; i < N; ++i) size = size + chain.joint[i].grip * chain.joint[i].grip;
    if (!(size > S(0))) return;
    for (int i = 0; i < N; ++i) {
      aim = aim + chain.joint[i].grip * target[i];
      play = play + abs(chain.joint[i].grip) * S(least_closing);
      opened = opened - chain.joint[i].grip * lost[i];
    }
    // To and fro by less than that is the noise of a handle.
    memory.opening = memory.started ? clamp(memory.opening, aim - play, aim + play) : aim - play;
    const bool closes = memory.opening > aim;
    if (!closes || !(opened > S(0))) return;
    for (int i = 0; i < N; ++i) lost[i] = lost[i] + chain.joint[i].grip * (opened / size);
  }

  // Winds tendons that are slack, which turns no joint, and those that are about to be, of which strokes that turn
  // none.
  void tighten(const Estimate& found, Memory& memory) const {
    bool any = false;
    S wound[M]{};
    for (int m = 0; m < M; ++m) {
      const S wanted = least_tension * chain.pretension[m];
      if (!chain.motor[m] || !(chain.stiffness[m] > S(0)) || found.far_tension[m] >= wanted) continue;
      // By how much it hangs, its length says.
      const S missing = wanted - found.far_tension[m] - (found.taut[m] ? S(0) : smaller(found.unexplained[m], S(0)));
      const S step = rate * period * missing / chain.stiffness[m];
      S& to = found.taut[m] ? wound[m] : memory.common[m];
      to = to + step;
      any = any || found.taut[m];
    }
    if (!any) return;
    S turned[N], excursion[M];
    settle(wound, turned);
    chain.excursions(turned, excursion);
    for (int m = 0; m < M; ++m) memory.common[m] = memory.common[m] + wound[m] - excursion[m];
  }
};

template <class S, int M>
struct JointSupervisorMemory {
  SupervisorState<S> state{};
  WatchState<S> watch[(M + 1) / 2]{};
  S sent[M]{};              ///< to the spools, rad/s
  bool over_tension[M]{};   ///< from above the limit until well below it
  S drifted[M]{};           ///< for how long a tendon's length has not explained its tension, s
  S missing[M]{};           ///< for how long a slack tendon should have been taut, s
  std::uint32_t present{};  ///< faults of this tick
};

/// States, requests and latched faults of the motors of a chain W: while it does not work, they stand.
///
/// Sensors and motors are watched two tendons at a time, as those of a planar axis are, but for what two tendons of one
/// joint show of each other: in its place each tendon's tension is compared with that by which the estimate explains
/// its length.
template <class W>
struct JointSupervisor {
  using S = W::S;
  static constexpr int N = W::joints, M = W::tendons;
  using Measured = JointMeasurement<S, N, M>;
  using Estimate = JointEstimate<S, N, M>;
  using Memory = JointSupervisorMemory<S, M>;

  Supervisor<S> states{};
  Watch<S> watch{};      ///< of any two tendons
  int tendons{};         ///< that there are
  S stroke_limit{};      ///< of a tendon, beyond what its target needs, m
  S most_deviations{4};  ///< deviations within which a tension is explained
  S unlike{};            ///< tension that friction unlike the observer's explains, too, before homing, N

  /// Faults of this tick by what is measured, before the law moves; dt: since the last tick, s.
  void inspect(const Measured& measured, const Estimate& found, int handles, bool homed, const S& dt,
               Memory& memory) const {
    std::uint32_t faults = found.valid ? 0U : bit(Fault::not_a_number);
    for (int k = 0; 2 * k < tendons; ++k) {
      const int a = 2 * k, b = smaller(a + 1, tendons - 1);
      const Measurement<S> two{k < handles ? measured.handle_angle[k] : S(0),
                               {measured.tension[a], measured.tension[b]},
                               {measured.spool_angle[a], measured.spool_angle[b]}};
      const S sent[2]{memory.sent[a], memory.sent[b]};
      faults |= watch.check(two, sent, dt, memory.watch[k]);
    }
    for (int m = 0; m < tendons && found.valid; ++m) {
      const S explained = most_deviations * found.unexplained_std[m];
      const S least = larger(explained, watch.of(Fault::load_cell_drift).threshold + (homed ? S(0) : unlike));
      faults |= lasts(Fault::load_cell_drift, found.taut[m] && abs(found.unexplained[m]) > least, found.unexplained[m],
                      dt, memory.drifted[m]);
      faults |= lasts(Fault::tendon_break, !found.taut[m] && found.unexplained[m] > explained, found.unexplained[m], dt,
                      memory.missing[m]);
    }
    memory.present = faults;
  }

  /// Whether the law works in this tick, after a request and with a stroke of each tendon beyond its target's, m.
  bool works(Request request, const S* stroke, const S& dt, Memory& memory) const {
    for (int m = 0; m < tendons; ++m)
      if (abs(stroke[m]) > stroke_limit) memory.present |= bit(Fault::stroke_unexplained);
    return states.advance(request, memory.present, dt, memory.state) == OperatingState::enabled;
  }

  /// Velocities that are sent, rad/s, from those that are wanted, smooth or as they are; finite whatever these are.
  void command(const Measured& measured, const S* wanted, bool smooth, const S& dt, Memory& memory, S* velocity) const {
    const auto& state = memory.state;
    const bool enabled = state.operating == OperatingState::enabled;
    const S share = smooth && state.since < states.engage_time ? state.since / states.engage_time : S(1);
    for (int m = 0; m < tendons; ++m) {
      bool& over = memory.over_tension[m];
      if (measured.tension[m] > states.tension_limit) over = true;
      if (measured.tension[m] < S(tuning::near_limit) * states.tension_limit) over = false;
      const S most = smooth ? states.acceleration_limit * dt : S(2) * states.speed_limit;
      const S aim = enabled && is_finite(wanted[m]) ? share * wanted[m] : S(0);
      const S ramped = memory.sent[m] + clamp(aim - memory.sent[m], -most, most);
      const S sent = clamp(ramped, -states.speed_limit, over ? S(0) : states.speed_limit);
      memory.sent[m] = is_finite(sent) ? sent : S(0);
      velocity[m] = memory.sent[m];
    }
  }

 private:
  std::uint32_t lasts(Fault fault, bool holds, const S& tension, const S& dt, S& lasted) const {
    const Limit<S>& limit = watch.of(fault);
    lasted = limit.on() && holds && abs(tension) > limit.threshold ? smaller(lasted + dt, S(100)) : S(0);
    return lasted > limit.persistence ? bit(fault) : 0U;
  }
};

}  // namespace tenodesis

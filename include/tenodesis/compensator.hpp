#pragma once
// What the motors should do about the angle that is lost.
//
// Lengths of tendon throughout: the agonist's motor winds the differential stroke on and the antagonist's lets it out,
// which moves the tip; a common stroke winds both, which moves their tension.
//
// The robust law spends the common stroke on knowledge. While both motors pull, every contact slips toward its spool,
// and the observer sees the tip; so it corrects while pulling, slower than it pulls, so that neither tendon turns back.
// It then lets out further than it pulled, correcting still, and pulls in again to the mean tension it started from.
// There it rests, every contact on the edge of slipping toward the spool: whichever way a load pushes the tip, one of
// the tendons gives way and tells.

#include "tenodesis/observer.hpp"

namespace tenodesis {

enum class ControlLaw : unsigned char {
  off,             ///< the motors stand still
  paper,           ///< eq. 22 as a set point of the spools
  paper_feedback,  ///< the pseudo-error by eq. 19 winds the spools until it is gone
  exact,           ///< the whole stroke that frictionless theory asks for, slack included, as a set point
  robust,          ///< pulls to know, corrects while pulling
};

template <class S>
struct CompensatorSettings {
  S gain{};            ///< of the tip's lag, 1/s
  S breakaway_time{};  ///< in which the friction that holds a tip is overcome, s
  S position_gain{};   ///< of a spool's set point, 1/s
  S dead_band{};       ///< of the output angle, rad
  S speed{};           ///< of a tendon at most, m/s
  S common_speed{};    ///< of the common stroke, m/s
  S common_stroke{};   ///< at most to either side of where it keeps the tendons tight, m
  S far{};             ///< lag beyond which it is made up without common stroke first, in dead bands
  S patience{};        ///< for which that is tried, s
  S least_tension{};   ///< that either tendon is to keep in the stem, N
  S tension_limit{};   ///< N
  S hand_play{};       ///< within which a handle counts as held, rad
  S still_time{};      ///< for which it must be, s
};

enum class Phase : unsigned char { rest, track, pull, release };

template <class S>
struct CompensatorState {
  Phase phase{Phase::track};
  S handle_angle{};  ///< smoothed, rad
  S anchor{};        ///< where the handle was last held, rad
  S hand{};          ///< direction that it was last moved in
  S still{};         ///< time that the handle has been held, s
  S since{};         ///< time in this phase, s
};

/// Speeds of the two tendons at the spools, winding positive, m/s.
template <class S>
struct Winding {
  S agonist{};
  S antagonist{};
};

template <class A>
struct RobustLaw {
  using S = A::Scalar;
  using State = CompensatorState<S>;

  ControlModel<A> model{};
  CompensatorSettings<S> settings{};
  Actuation actuation{Actuation::differential};

  /// lag: of the tip, m; memory: the friction observer's.
  Winding<S> wind(const FrictionObserver<A>& observer, const FrictionMemory<S>& memory, const S& dt,
                  State& state) const {
    const S lag = observer.lag(memory);
    const S x = model.axis.distal.coordinate(observer.output_angle(memory));
    const S dead = settings.dead_band * model.axis.distal.moment_arm(x);
    watch_hand(memory.smooth.handle_angle, dt, state);
    const bool moving = state.still < settings.still_time;
    if (actuation == Actuation::agonist) {
      const bool resting = state.phase == Phase::rest;
      state.phase = abs(lag) > (resting ? S(2) * dead : dead * S(0.5)) ? Phase::track : Phase::rest;
      if (state.phase == Phase::rest) return {};
      return {clamp(S(2) * settings.gain * lag, -settings.speed, settings.speed), S(0)};
    }
    const S common = model.spool_radius * (memory.smooth.spool_angle[0] + memory.smooth.spool_angle[1]) * S(0.5);
    const S wanted = wanted_common(memory);
    choose(lag, dead, moving, common - wanted, memory, dt, state);
    if (state.phase == Phase::rest) return {};
    S across = settings.gain * lag;
    if (moving && lag * state.hand > dead) {
      // The hand has turned and friction holds the tip: make that up before the tip is late.
      across = across + state.hand * observer.breakaway(memory, state.hand) / settings.breakaway_time;
    }
    if (state.phase == Phase::track) {
      across = clamp(across, -settings.speed, settings.speed);
      return {across, -across};
    }
    across = clamp(across, -ride * settings.speed, ride * settings.speed);
    const S along = larger(settings.common_speed, abs(across) / ride) * (state.phase == Phase::pull ? S(1) : S(-1));
    return {along + across, along - across};
  }

 private:
  // Of the common speed, what the differential one may be at most: neither tendon is to turn back.
  static constexpr S ride = S(0.8);

  // A handle counts as moving from when it leaves a play wider than its encoder's noise.
  void watch_hand(const S& handle_angle, const S& dt, State& state) const {
    state.handle_angle = state.handle_angle + (handle_angle - state.handle_angle) * (dt / (S(0.02) + dt));
    const S anchor =
        clamp(state.anchor, state.handle_angle - settings.hand_play, state.handle_angle + settings.hand_play);
    if (anchor != state.anchor) state.hand = anchor > state.anchor ? S(1) : S(-1);
    state.still = anchor == state.anchor ? smaller(state.still + dt, S(1)) : S(0);
    state.anchor = anchor;
  }

  // The common stroke at which the looser tendon keeps its least tension.
  S wanted_common(const FrictionMemory<S>& memory) const {
    const auto& tendon = memory.tendon;
    const S half = abs(tendon[agonist].tension[2] - tendon[antagonist].tension[2]) * S(0.5);
    const S more = half + settings.least_tension - model.axis.pretension;
    return larger(more, S(0)) * memory.compliance / model.axis.stiffness;
  }

  static bool slipped(const FrictionMemory<S>& memory, const S& direction) {
    return memory.tendon[agonist].run * direction > S(4) && memory.tendon[antagonist].run * direction > S(4);
  }

  void choose(const S& lag, const S& dead, bool moving, const S& above, const FrictionMemory<S>& memory, const S& dt,
              State& state) const {
    const S unseen = larger(memory.freedom[0], memory.freedom[1]);
    const bool far = abs(lag) > settings.far * dead;
    state.since = smaller(state.since + dt, S(10));
    if (moving || (far && state.phase == Phase::rest)) return turn(Phase::track, state);
    switch (state.phase) {
      case Phase::track:
        if (!far || state.since > settings.patience) turn(above > S(0) ? Phase::release : Phase::pull, state);
        return;
      case Phase::rest:
        if (abs(lag) > S(2) * dead || unseen > S(4) * dead) turn(above > S(0) ? Phase::release : Phase::pull, state);
        return;
      case Phase::pull:
        if (slipped(memory, S(1)) && abs(lag) < dead) return turn(Phase::rest, state);
        if (above > settings.common_stroke) turn(Phase::release, state);
        return;
      case Phase::release:
        if (slipped(memory, S(-1)) && abs(lag) < dead) return turn(Phase::rest, state);
        if (above < -settings.common_stroke) turn(Phase::pull, state);
        return;
    }
  }

  static void turn(Phase phase, State& state) {
    if (state.phase != phase) state.since = S(0);
    state.phase = phase;
  }
};

}  // namespace tenodesis

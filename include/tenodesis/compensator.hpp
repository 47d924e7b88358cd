#pragma once
// The compensation laws: spool motion that restores the lost angle.
//
// In lengths of tendon: a differential stroke winds the agonist and lets the antagonist out, which moves the tip; a
// common stroke winds both, which raises their tension.
//
// The robust law uses common strokes for observation. While both motors wind, every contact slips toward its spool and
// the observer sees the tip; the law corrects while it winds, by less than it winds, so that neither tendon reverses.
// Letting both out serves as well, so that it winds when the mean tension is low and lets out when it is high. Where it
// stops, every contact is on the same edge of its friction band: whichever way a load pushes the tip next, one of the
// tendons slips at once and shows it. While the hand moves, it makes the tendons slip, and no common stroke is needed.
// Dither (dither.hpp) may take the place of the first strokes after a change.

#include "tenodesis/alternation.hpp"
#include "tenodesis/dither.hpp"
#include "tenodesis/envelope.hpp"

namespace tenodesis {

enum class ControlLaw : unsigned char {
  off,             ///< the motors stand still
  paper,           ///< eq. 22 as a set point of the spools
  paper_feedback,  ///< the pseudo-error by eq. 19 winds the spools until it is gone
  exact,           ///< the stroke that theory without friction requires, slack included, as a set point
  robust,          ///< observes by common strokes and corrects during them; needs the friction observer
};

/// By what the robust law makes the tendons slip to see the tip.
enum class Observe : unsigned char {
  strokes,
  dither,     ///< after a change, and strokes later
  automatic,  ///< dither where the drives can turn so fast that it serves better than strokes
};

template <class S>
struct CompensatorSettings {
  S gain{};             ///< of the tracking error, 1/s
  S breakaway_speed{};  ///< largest speed of the tip that breaks away, rad/s
  S position_gain{};    ///< of a spool's set point, 1/s
  S dead_band{};        ///< of the output angle, rad
  S speed{};            ///< largest speed of a tendon, m/s
  S acceleration{};     ///< largest of a tendon, m/s^2
  S drive_time{};       ///< time constant of the drives, s
  S common_speed{};     ///< least speed of a common stroke, m/s
  S common_stroke{};    ///< largest common stroke to either side of the one that keeps the tendons tight, m
  S stroke_share{};     ///< growth of it per stroke that keeps them tight
  S least_tension{};    ///< tension that either tendon is to keep in the stem, N
  S tension_limit{};    ///< tension above which no tendon is wound, N
  S force_limit{};      ///< tip force that the motors do not go beyond, N; 0: none
  S assistance{1};      ///< share of the lost angle that is given back
  S hand_travel{};      ///< handle travel above which the hand counts as moving, rad
  S tremor_delay{};     ///< by which the motors follow late, s
  S tremor_gain{};      ///< of the speed at which they take the tremor away
};

enum class Phase : unsigned char {
  rest,
  track,
  pull,
  release,
  restrained,  ///< as shown: tracking, with less than the law wants (envelope.hpp)
  yielding,    ///< as shown: the tip presses with the force limit, and stays behind
  dither,      ///< both spools vibrate alike
};

template <class S>
struct CompensatorState {
  Phase phase{Phase::track};
  Phase stroke{Phase::pull};  ///< the last stroke
  bool moving{};              ///< whether the hand moves
  bool correcting{};          ///< whether the tip, as a stroke has shown it, is corrected without a stroke
  bool yielding{};            ///< whether the force limit has held the law back in this tick
  bool second{};              ///< whether this tick is the second of two
  bool dithered{};            ///< whether dither has followed the last change
  int turns{};                ///< reversals of strokes since the motors last rested
  S handle_angle{};           ///< with the observer's play, rad
  S held_angle{};             ///< handle angle when the hand was last still, rad
  S stepped_angle{};          ///< handle angle at its last step that stands out, rad
  S hand{};                   ///< direction of the handle's last motion
  S still{};                  ///< time since that motion, s
  S since{};                  ///< time in this phase, s
  S near{};                   ///< time that the tip has been within the dead band, less three times that it has not, s
  S tolerance{1};             ///< factor by which the dead band has grown over strokes that did not end in it
  S goal{};                   ///< differential stroke of that correction, or at the begin of a stroke, m
  S reach{};                  ///< how far a stroke may go from there, m
  EnvelopeState<S> envelope{};
  AlternationState<S> load{};
  DitherState<S> dither{};
  S short_of{};  ///< by how much the last stroke ended early because a tendon got loose, m

  constexpr Phase shown() const {
    if (yielding) return Phase::yielding;
    return phase == Phase::track && (envelope.restrained() || load.leans) ? Phase::restrained : phase;
  }
};

template <class A>
struct Compensator {
  using S = A::Scalar;
  using State = CompensatorState<S>;

  ControlModel<A> model{};
  CompensatorSettings<S> settings{};
  Envelope<A> envelope{};
  ControlLaw law{ControlLaw::off};
  Actuation actuation{Actuation::differential};
  Observe observe{Observe::strokes};

  /// Winding speeds, m/s; spool angles are counted from home.
  Winding<S> wind(const Measurement<S>& measured, const FrictionObserver<A>& observer, const FrictionMemory<S>& memory,
                  const S& dt, State& state) const {
    switch (law) {
      case ControlLaw::off:
        break;
      case ControlLaw::paper:
      case ControlLaw::exact:
        return guarded(measured, to_set_point(measured));
      case ControlLaw::paper_feedback:
        return guarded(measured, by_pseudo_error(measured));
      case ControlLaw::robust:
        return guarded(measured, kept_tight(memory, within_envelope(observer, memory, dt, state)));
    }
    return {};
  }

 private:
  // The dead band as differential stroke; arm: of the tendons at the tip, m.
  S dead_stroke(const S& arm) const { return model.stroke_for(settings.dead_band * arm); }

  S wound(const Measurement<S>& measured, int i) const { return model.spool_radius * measured.spool_angle[i]; }

  S limited(const S& speed) const { return clamp(speed, -settings.speed, settings.speed); }

  static S looser_tension(const FrictionMemory<S>& memory) {
    return smaller(memory.tendon[agonist].tension[0], memory.tendon[antagonist].tension[0]);
  }

  // Near the tension limit a tendon is wound more slowly, and just below it, where the drives still need to stop, not
  // at all. Where the hand goes on, against the joint's own spring, the motor lets out what it has wound.
  Winding<S> guarded(const Measurement<S>& measured, const Winding<S>& wanted) const {
    const auto guard = [&](int i, const S& speed) {
      const S spare = (S(1) + S(tuning::near_limit)) * S(0.5) * settings.tension_limit - measured.tension[i];
      const S near = S(0.1) * settings.tension_limit;
      const S allowed = speed > S(0) && spare < near ? speed * larger(spare / near, S(0)) : speed;
      if (!model.springs() || spare >= S(0) || wound(measured, i) <= S(0)) return allowed;
      return smaller(allowed, limited(S(tuning::approach_rate) / model.axis.stiffness * spare));
    };
    return {guard(agonist, wanted.agonist), guard(antagonist, wanted.antagonist)};
  }

  Winding<S> within_envelope(const FrictionObserver<A>& observer, const FrictionMemory<S>& memory, const S& dt,
                             State& state) const {
    // What changes slowly is followed in every other tick, by turns.
    state.second = !state.second;
    const S tremor_gain = this->tremor_gain(state);
    const S stroke = differential_stroke(observer, memory, tremor_gain);
    if (!state.second) {
      envelope.update(
          observer.tracking_error(memory), stroke,
          S(tuning::least_swing) * (settings.dead_band * memory.arm) + S(0.5) * observer.tremor_length(memory),
          observer, memory, S(2) * dt, state.envelope);
    }
    if (actuation == Actuation::agonist) {
      const Winding<S> wanted = one_motor(stroke, observer, memory, state);
      // The other motor winds only to keep its tendon tight, and lets that out again.
      const S spare = larger(wound(memory.smooth, antagonist) - dead_stroke(memory.arm), S(0));
      return {S(2) * limited(envelope.within(wanted.agonist * S(0.5), stroke, state.envelope)),
              -smaller(S(tuning::return_rate) * spare, settings.common_speed)};
    }
    const Winding<S> wanted = two_motors(stroke, observer, memory, dt, state);
    const S allowed = envelope.within((wanted.agonist - wanted.antagonist) * S(0.5), stroke, state.envelope);
    const S common = (wanted.agonist + wanted.antagonist) * S(0.5);
    // Where one tendon is at its limit, tightening the other would take the stroke further beyond its bounds.
    const bool at_limit = larger(memory.smooth.tension[agonist], memory.smooth.tension[antagonist]) >
                          S(tuning::near_limit) * settings.tension_limit;
    const S along = at_limit && state.envelope.excess > S(0) ? smaller(common, S(0)) : common;
    // Between the limit and a tendon that would hang, the motors cannot bring the stroke back.
    if (at_limit && settings.least_tension > looser_tension(memory)) state.envelope.excess = S(0);
    // The motors take the hand's tremor away, as far as it is known when they follow.
    const S against = observer.trembles(memory)
                          ? tremor_gain * observer.tremor_arm() * memory.intent.speed_after(settings.tremor_delay)
                          : S(0);
    const S differential = limited(allowed - against);
    return {along + differential, along - differential};
  }

  // Where the law's gain falls to zero, half of the tremor is left to shake the tip free of its friction, as with
  // motors at rest.
  S tremor_gain(const State& state) const {
    return settings.tremor_gain * (S(0.5) + S(0.5) * state.envelope.gain_factor);
  }

  // The differential stroke without what takes the tremor away, m.
  S differential_stroke(const FrictionObserver<A>& observer, const FrictionMemory<S>& memory,
                        const S& tremor_gain) const {
    const S stroke = (wound(memory.smooth, agonist) - wound(memory.smooth, antagonist)) * S(0.5);
    if (actuation == Actuation::agonist) return stroke;
    return stroke + smaller(tremor_gain, S(1)) * observer.tremor_arm() * memory.intent.tremor;
  }

  // The stroke that is missing to the motors' share of the loss; error: of tracking, m.
  S missing(const S& error, const S& stroke) const {
    return settings.assistance * model.stroke_for(error) - (S(1) - settings.assistance) * stroke;
  }

  /// How far the stroke may go on either way, m.
  struct Room {
    S least{};
    S most{};

    constexpr S of(const S& missing) const { return clamp(missing, least, most); }
  };

  // The tip must not press harder than it may. Where it does, the motors give back what they have wound, and no more:
  // the rest is the hand's.
  Room room(const S& stroke, const FrictionObserver<A>& observer, const FrictionMemory<S>& memory) const {
    constexpr S endless = std::numeric_limits<S>::infinity();
    if (!(settings.force_limit > S(0))) return {-endless, endless};
    const S limit = settings.force_limit * observer.stretch_per_force(memory) + observer.exerted_unseen(memory);
    const S exerted = observer.exerted(memory);
    return {smaller(-limit - exerted, larger(-stroke, S(0))), larger(limit - exerted, smaller(-stroke, S(0)))};
  }

  // A slack tendon neither moves the tip nor shows where it is: near the least tension it is let out more slowly, then
  // not at all, and where it hangs it is wound.
  Winding<S> kept_tight(const FrictionMemory<S>& memory, const Winding<S>& wanted) const {
    const auto keep = [&](int i, const S& speed) {
      const S near = settings.least_tension * S(0.5);
      const S left = memory.tendon[i].tension[0] - near;
      if (left >= near || speed > S(0)) return speed;
      if (left > S(0)) return speed * (left / near);
      return settings.common_speed * S(0.25) * clamp(S(-4) * left / settings.least_tension - S(1), S(0), S(1));
    };
    return {keep(agonist, wanted.agonist), keep(antagonist, wanted.antagonist)};
  }

  Winding<S> to_set_point(const Measurement<S>& measured) const {
    const Tensions<S> tension{measured.tension[agonist], measured.tension[antagonist]};
    const Law theory = law == ControlLaw::paper ? Law::paper : Law::exact;
    const Result<S> found = compensation_stroke(model.axis, tension, measured.handle_angle, actuation, theory);
    // Where no stroke restores the angle, letting out the agonist until it is slack comes closest.
    const S stroke = found.status == Status::ok ? found.value : -model.axis.pretension / model.axis.stiffness;
    const auto approach = [&](int i, const S& target) {
      const S missing = target - wound(measured, i);
      return abs(missing) <= dead_stroke(model.axis.distal.moment_arm(S(0)))
                 ? S(0)
                 : limited(settings.position_gain * model.stroke_for(missing));
    };
    return {approach(agonist, stroke), actuation == Actuation::differential ? approach(antagonist, -stroke) : S(0)};
  }

  Winding<S> by_pseudo_error(const Measurement<S>& measured) const {
    const S estimated = paper_output_angle(model, measured);
    const S missing = model.stroke_for(model.aim(measured.handle_angle) - model.taken(estimated));
    if (abs(missing) <= dead_stroke(model.axis.distal.moment_arm(model.axis.distal.coordinate(estimated)))) return {};
    const S speed = limited(settings.gain * missing);
    return {speed, actuation == Actuation::differential ? -speed : S(0)};
  }

  // One motor cannot make both tendons slip the same way: it corrects by the observer's estimate as it is.
  Winding<S> one_motor(const S& stroke, const FrictionObserver<A>& observer, const FrictionMemory<S>& memory,
                       State& state) const {
    const S missing = this->missing(observer.tracking_error(memory), stroke);
    const S error = room(stroke, observer, memory).of(missing);
    state.yielding = error != missing;
    // It takes no tremor away, and must not follow it.
    const S dead = dead_stroke(memory.arm) + S(0.5) * observer.tremor_length(memory);
    const bool resting = state.phase == Phase::rest;
    state.phase = abs(error) > (resting ? S(2) * dead : dead * S(0.5)) ? Phase::track : Phase::rest;
    if (state.phase == Phase::rest) return {};
    return {limited(S(2) * settings.gain * error), S(0)};
  }

  Winding<S> two_motors(const S& stroke, const FrictionObserver<A>& observer, const FrictionMemory<S>& memory,
                        const S& dt, State& state) const {
    const S missing = this->missing(observer.tracking_error(memory), stroke);
    const Room room = this->room(stroke, observer, memory);
    const S error = room.of(missing);
    state.yielding = error != missing;
    // Some of the tremor is left.
    const S tremor = observer.tremor_length(memory);
    const S dead = dead_stroke(memory.arm) * state.tolerance + S(tuning::tremor_in_band) * tremor;
    // A tip at rest is held by friction, which strokes would break: it must be further off to be worth them.
    const S waking = S(tuning::waking) * dead + S(0.5) * tremor;
    // A tremor turns the contacts at the handle to and fro, whatever the strokes do.
    const bool trembles = observer.trembles(memory);
    const bool moving = detect_hand_motion(memory.intent.angle, trembles, dt, state);
    const S common = (wound(memory.smooth, agonist) + wound(memory.smooth, antagonist)) * S(0.5);
    const S wanted = wanted_common(memory);
    // A tick later than it was chosen, when there is less to compute.
    const bool begins = state.since <= S(0);
    choose({error, dead, waking, moving, trembles, stroke, wanted, common - wanted}, observer, memory, dt, state);
    const S certain = observer.certain(missing, memory);
    AlternationState<S>& load = state.load;
    // Not worked out while no load alternates.
    const S holds = load.leans || load.jumps > 1 ? observer.breakaway(memory, S(load.mean > stroke ? 1 : -1)) : S(0);
    if (state.second) {
      const S jump = model.stroke_for(S(tuning::notable_angle) * memory.arm) + S(0.5) * tremor;
      follow<S>({certain, stroke, waking, jump, holds, moving, state.envelope.bounded}, S(2) * dt, load);
    }
    if (state.phase == Phase::rest && !load.leans) return {};
    // They show the tip itself, not only what is certain of it.
    const bool strokes = state.phase == Phase::pull || state.phase == Phase::release || state.phase == Phase::dither;
    // A load that alternates is left to friction or tracked.
    const S gain_factor = load.alternates() ? S(1) : state.envelope.gain_factor;
    S differential = settings.gain * gain_factor * (strokes ? missing : certain);
    if (!strokes && !state.correcting && load.leans)
      differential = leaning_speed(load, certain, stroke, holds, settings.gain);
    else if (!strokes && !state.correcting && gain_factor < S(1))
      differential =
          differential + (S(1) - gain_factor) * envelope.returning(stroke, settings.assistance, state.envelope);
    if (moving && error * state.hand > dead) {
      // The hand has reversed and friction holds the tip: the friction is overcome before the tip stays behind, but not
      // so fast that the tip leaps.
      const S speed = observer.breakaway(memory, state.hand) / S(tuning::breakaway_time);
      differential = differential + state.hand * gain_factor * smaller(speed, settings.breakaway_speed * memory.arm);
    }
    if (state.correcting)
      differential = differential + gain_factor / S(tuning::correction_time) * (state.goal - stroke);
    // Into what is left of the force as fast as the tip may break away, out of it as the error is corrected.
    const S inward = S(1) / S(tuning::breakaway_time);
    differential = clamp(differential, (room.least < S(0) ? inward : settings.gain) * room.least,
                         (room.most > S(0) ? inward : settings.gain) * room.most);
    if (begins) begin(strokes, stroke, missing, dead, observer, memory, state);
    if (state.since > S(0) && (strokes || state.correcting)) {
      // A load may still grow.
      if (strokes) state.reach = larger(state.reach, abs(missing) + dead);
      const S left = state.goal - stroke;
      differential = differential > S(0)
                         ? smaller(differential, S(tuning::approach_rate) * larger(left + state.reach, S(0)))
                         : larger(differential, S(tuning::approach_rate) * smaller(left - state.reach, S(0)));
    }
    if (!strokes) {
      // A moving hand may need more tension to keep the looser tendon tight, and must not wait for it until it rests.
      // While gain is withheld or the tip is left to friction there are no strokes that let out again what is wound
      // beyond that.
      const S needed = wanted - common;
      const S slowly = gain_factor < S(1) ? smaller(needed, S(0)) * S(1 / tuning::mean_memory) : S(0);
      const S least = load.leans ? S(-tuning::slow_stroke) * settings.common_speed : slowly;
      const S most = wanted > S(0) || load.leans ? settings.common_speed : S(0);
      const S tightening = clamp(settings.gain * needed, least, most);
      return {tightening + limited(differential), tightening - limited(differential)};
    }
    if (state.phase == Phase::dither) {
      const S tightening = clamp(settings.gain * (wanted - common), S(0), settings.common_speed);
      const S along = tightening + dither(missing, dead, dt, state.dither);
      return {along + limited(differential), along - limited(differential)};
    }
    if (!trembles) {
      // So that the stroke itself does not move the tip.
      const S way = state.phase == Phase::pull ? S(1) : S(-1);
      const S uneven = way * settings.common_speed * observer.uneven(memory, way);
      differential = differential + uneven;
      state.goal = state.goal + uneven * dt;
    }
    differential = clamp(differential, -S(tuning::differential_share) * settings.speed,
                         S(tuning::differential_share) * settings.speed);
    // On target a stroke continues slowly until the tip has come to rest there.
    const S least = state.near > S(0) ? settings.common_speed * S(tuning::slow_stroke) : settings.common_speed;
    const S along =
        larger(least, abs(differential) / S(tuning::differential_share)) * (state.phase == Phase::pull ? S(1) : S(-1));
    return {along + differential, along - differential};
  }

  void begin_dither(const FrictionObserver<A>& observer, const FrictionMemory<S>& memory, State& state) const {
    const S tension = larger(memory.smooth.tension[agonist], memory.smooth.tension[antagonist]);
    const S turned = memory.scale * (memory.nominal[0] + memory.nominal[1]) * tension * memory.compliance *
                     (memory.share[0] + memory.share[1]);
    const S seen = S(tuning::firm_run) * observer.settings.play;
    state.dither = tenodesis::begin_dither(larger(S(tuning::dither_margin) * turned, seen), settings.acceleration,
                                           settings.drive_time);
    state.dithered = true;
    ++state.turns;
    // Slower dither would be taken for the hand's tremor.
    const S slowest = S(pi / (tuning::tremor_quickest * tuning::tremor_half_period));
    if (observe == Observe::automatic && state.dither.rate < slowest) turn(Phase::pull, state);
  }

  // A hand counts as moving once it has travelled further than noise does, until it has been still for a while.
  bool detect_hand_motion(const S& handle_angle, bool trembles, const S& dt, State& state) const {
    const S moved = handle_angle - state.handle_angle;
    state.handle_angle = handle_angle;
    if (moved != S(0)) state.hand = moved > S(0) ? S(1) : S(-1);
    // In a tremor the intent creeps.
    const S least = trembles ? settings.hand_travel * S(0.2) : S(0);
    if (abs(handle_angle - state.stepped_angle) > least) {
      state.stepped_angle = handle_angle;
      state.still = S(0);
    } else {
      state.still = smaller(state.still + dt, S(tuning::still_time));
    }
    if (state.still >= S(tuning::still_time)) {
      state.held_angle = handle_angle;
      state.moving = false;
    } else if (abs(handle_angle - state.held_angle) > settings.hand_travel) {
      state.moving = true;
    }
    return state.moving;
  }

  // The common stroke at which the looser tendon keeps its least tension.
  S wanted_common(const FrictionMemory<S>& memory) const {
    const auto& tendon = memory.tendon;
    const S half = abs(tendon[agonist].tension[2] - tendon[antagonist].tension[2]) * S(0.5);
    const S more = half + settings.least_tension - model.axis.pretension;
    return larger(more, S(0)) * memory.compliance;
  }

  /// What a choice depends on besides observer and state.
  struct Situation {
    S error{};   ///< of the tip, as the stroke that corrects it, m
    S dead{};    ///< band of it, m
    S waking{};  ///< above which a tip at rest is corrected, m
    bool moving{};
    bool trembles{};
    S stroke{};  ///< differential, m
    S wanted{};  ///< common stroke that keeps the tendons tight, m
    S above{};   ///< common stroke above that one, m
  };

  void choose(const Situation& now, const FrictionObserver<A>& observer, const FrictionMemory<S>& memory, const S& dt,
              State& state) const {
    const auto& [error, dead, waking, moving, trembles, differential, wanted, above] = now;
    // What the law would give back of the tracking error, as a stroke.
    const S share = model.stroke_for(settings.assistance);
    // Whether the tip may have moved so far unseen that it is worth strokes: by twice the error that wakes the motors.
    const bool unseen = share * larger(memory.unobservable[0], memory.unobservable[1]) > S(2) * waking;
    const S stroke = settings.common_stroke + settings.stroke_share * wanted;
    const bool loose = settings.least_tension > looser_tension(memory);
    const bool tight = larger(memory.tendon[agonist].tension[0], memory.tendon[antagonist].tension[0]) >
                       S(tuning::near_limit) * settings.tension_limit;
    // Noise that crosses the band's edge for a tick must not begin the time anew.
    state.near = abs(error) < dead ? smaller(state.near + dt, S(tuning::settle_time) + dt)
                                   : larger(state.near - S(3) * dt, S(0));
    const bool near = state.near > S(tuning::settle_time);
    const bool on_target = state.dither.settled > 1;
    const auto dithered = [&] { return state.phase == Phase::pull && state.dithered && on_target; };
    // While the first strokes still find more friction, the tip is behind the estimate by more than its deviation says.
    const auto learned = [&] {
      return state.turns > 1 || memory.scale < S(tuning::rising_friction) * memory.earlier_scale || dithered();
    };
    // What no stroke can show must not keep the motors awake.
    const bool sure =
        near && ((share * share * memory.position_variance < square(S(tuning::outlier) * dead) && learned()) ||
                 S(state.turns) > S(tuning::most_turns));
    const auto& load = state.load;
    const bool steady = Envelope<A>::steady(state.envelope) && !load.alternates() && !load.leans;
    const auto dithers = [&] {
      const int most = static_cast<int>(tuning::most_turns);
      return observe != Observe::strokes && steady && !state.dithered && state.turns < most && !trembles && !tight &&
             !loose;
    };
    state.since = smaller(state.since + dt, S(10));
    if (moving || load.fast || load.leans) return turn(Phase::track, state);
    switch (state.phase) {
      case Phase::track:
        if (state.correcting) {
          const S left = state.goal - differential;
          const bool there = error * left < S(0) || abs(left) < S(0.5) * dead || state.near > S(0.01);
          if (state.since > (there ? S(0.002) : S(tuning::correction_time))) turn(Phase::pull, state);
          return;
        }
        if (near && (trembles || (sure && !unseen))) return turn(Phase::rest, state);
        if (dithers()) return turn(Phase::dither, state);
        if (loose && tight) return;
        if (steady) turn(above > S(0) && !loose ? Phase::release : Phase::pull, state);
        return;
      case Phase::rest:
        // A load that alternates is tracked without strokes of both tendons.
        if (load.alternates() && abs(error) > waking) return turn(Phase::track, state);
        if (steady && (abs(error) > waking || (!trembles && unseen)))
          turn(dithers() ? Phase::dither : next_stroke(above, stroke, loose, state), state);
        return;
      case Phase::dither:
        // Two periods, since the first has the transient; in the tick before it begins they are those of the last one.
        if (!(on_target && state.since > dt) && state.since <= S(tuning::dither_time)) return;
        // The pull that follows ends where every contact is on the same edge.
        if (on_target) state.near = S(tuning::settle_time) + dt;
        return turn(Phase::pull, state);
      case Phase::pull:
        if (near && (trembles || (sure && observer.slip_together(memory, S(1))))) return turn(Phase::rest, state);
        // Between slack and the limit there is no room for strokes: only tracking is left.
        if (loose && tight) return turn(Phase::track, state);
        if (above > larger(stroke, state.short_of + stroke) || tight)
          turn_back(Phase::release, S(0), abs(error) < S(2) * dead, state);
        return;
      case Phase::release:
        if (near && (trembles || (sure && observer.slip_together(memory, S(-1))))) return turn(Phase::rest, state);
        if (!(above < -stroke || loose)) return;
        turn_back(Phase::pull, larger(above + stroke, S(0)), abs(error) < S(2) * dead, state);
        if (state.turns > 1 && (load.alternates() || state.envelope.gain_factor > S(0)) &&
            observer.slip_together(memory, S(-1)))
          correct(state);
        return;
      case Phase::restrained:
      case Phase::yielding:
        return;
    }
  }

  // An error soon after a stroke is its remainder: continuing the same way spares the tip a reversal of its friction.
  static Phase next_stroke(const S& above, const S& stroke, bool loose, const State& state) {
    if (loose) return Phase::pull;
    const bool soon = state.since < S(tuning::transient_time);
    if (soon && abs(above) < stroke) return state.stroke;
    return above > S(0) ? Phase::release : Phase::pull;
  }

  // Strokes that do not end within the dead band must not continue for ever: after some, it grows, and sooner where a
  // wider one would have ended them.
  void turn_back(Phase phase, const S& short_of, bool close, State& state) const {
    turn(phase, state);
    state.short_of = short_of;
    ++state.turns;
    if (S(state.turns) > (close ? S(tuning::few_turns) : S(tuning::most_turns)))
      state.tolerance = smaller(state.tolerance * S(tuning::tolerance_growth), S(tuning::most_tolerance));
  }

  // The tip is known, and friction at its joint is least at the end of a release: it is overcome without a stroke, and
  // another stroke then shows the tip.
  static void correct(State& state) {
    state.short_of = S(0);
    state.correcting = true;
    state.phase = Phase::track;
  }

  void begin(bool stroke_begins, const S& stroke, const S& missing, const S& dead, const FrictionObserver<A>& observer,
             const FrictionMemory<S>& memory, State& state) const {
    const S way = S(missing > S(0) ? 1 : -1);
    if (stroke_begins) {
      // While friction holds the tip a stroke must not wind up more than is missing and half of what frees the tip,
      // which would leap.
      state.goal = stroke;
      state.reach = abs(missing) + dead + S(0.5) * observer.breakaway(memory, way);
      // A tip that its own friction holds cannot leap by dither.
      if (state.phase == Phase::dither) {
        state.reach = std::numeric_limits<S>::max();
        begin_dither(observer, memory, state);
      }
    } else if (state.correcting) {
      state.goal = stroke + missing +
                   way * S(tuning::correction_over_breakaway) * settings.assistance * observer.breakaway(memory, way);
      state.reach = S(0);
    }
  }

  static void turn(Phase phase, State& state) {
    state.correcting = false;
    // A new load has woken the motors, rather than their own last stroke: the full accuracy applies again.
    if (phase == Phase::track || (state.phase == Phase::rest && state.since > S(tuning::correction_time))) {
      state.tolerance = S(1);
      state.turns = 0;
    }
    if (state.phase != phase) state.since = S(0);
    if (phase == Phase::pull || phase == Phase::release) {
      state.stroke = phase;
    } else {
      state.short_of = S(0);
      state.dithered = false;
    }
    state.phase = phase;
  }
};

}  // namespace tenodesis

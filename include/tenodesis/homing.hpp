#pragma once
// Homing: proves the wiring, then brings both tendons to their pretension without moving the tip.
//
// Under a load on the tip T1 - T2 is given by the load, and of a free tip it is zero, wherever the spools are: tensions
// do not show where the tip should be, and a loop on their difference would wind the tip away. Homing therefore winds
// only common strokes, which leave the tip where the handle has put it, and regulates the mean tension. Beforehand it
// must know that the strokes are common and that the tip is free, by the stages of homing_state.hpp.
//
// What the spools have wound is at last held against the tension of each tendon, an independent relation.

#include "tenodesis/fault.hpp"
#include "tenodesis/homing_state.hpp"
#include "tenodesis/tuning.hpp"

namespace tenodesis {

template <class A>
struct Homing {
  using S = A::Scalar;
  using State = HomingState<S>;
  using enum HomingStage;
  using enum HomingReason;

  ControlModel<A> model{};
  HomingSettings<S> settings{};

  State begin(const Measurement<S>& measured) const {
    State state{};
    state.stage = rest;
    state.handle = state.held = measured.handle_angle;
    for (int i = 0; i < 2; ++i) {
      state.tension[i] = measured.tension[i];
      state.before = state.before + measured.tension[i] * S(0.5);
      state.start[i] = state.angle[i] = measured.spool_angle[i];
    }
    if (settings.coarse(model.axis.stiffness)) fail(too_coarse, no_tendon, state);
    return state;
  }

  /// Winding speeds, m/s; the state's stage shows the progress. sent: velocities of the last tick, rad/s.
  Winding<S> wind(const Measurement<S>& read, const S (&sent)[2], const S& dt, State& state) const {
    Measurement<S> measured = read;
    for (int i = 0; i < 2; ++i) {
      const S stroke = model.spool_radius * read.spool_angle[i];
      measured.tension[i] = settings.drive.tension(read.tension[i], stroke, sent[i], state.drive[i]);
    }
    const bool gone = follow(measured, sent, dt, state);
    state.time = state.time + dt;
    if (gone && state.stage != rest && state.stage != probe) fail(tendon_broken, looser(state), state);
    if (abs(state.handle - state.held) > settings.hand_travel) hand_moved(state);
    if (state.stage != done && state.time > settings.most_time) fail(timed_out, no_tendon, state);
    switch (state.stage) {
      case rest:
        return average(measured, state);
      case jog:
        return turn_one(measured, state);
      case ease:
        return let_out(state);
      case slacken:
        return let_out_further(state);
      case tighten:
        return take_up(state);
      case probe:
        return let_out_one(state);
      case exceed:
      case release:
      case approach:
      case done:
        return regulate(dt, state);
      case restore:
        return wind_back(state);
      case idle:
      case failed:
        break;
    }
    return {};
  }

  /// The watch's faults as far as homing does not judge them itself: jogs are too short for a model of the drive. Of a
  /// motor that does not follow, the failure says why.
  std::uint32_t explain(std::uint32_t faults, State& state) const {
    if (state.stage == jog) return faults & ~bit(Fault::motor_not_following);
    if (state.stage != idle && has(faults, Fault::motor_not_following)) blame(state);
    return faults;
  }

  /// Spool angle at home, rad: where the tendon would have its pretension along its full length. After homing, every
  /// contact is about to slip toward the spool.
  S zero(int i, const Measurement<S>& measured) const {
    const S handle = abs(measured.handle_angle);
    const S at_sheath = exp(-model.sheath * (model.sheath_bend + model.sheath_bend_rate * handle));
    const S at_handle = exp(-model.vertex * (model.base_wrap + model.axis.proximal.wrap_angle(handle)));
    const S near = measured.tension[i] * at_sheath;
    const S held = near * at_handle;
    const S mean =
        model.share[0] * measured.tension[i] + model.share[1] * near + (model.share[2] + model.share[3]) * held;
    return measured.spool_angle[i] - (mean - model.axis.pretension) / (model.axis.stiffness * model.spool_radius);
  }

 private:
  // Times, s: in which jogs listen, turn, and wait in addition to the drive's own time; in which a tip comes to rest.
  static constexpr S listen = S(0.02), turn = S(0.025), wait = S(0.015), pause = S(0.15);
  S flat() const { return S(tuning::homing_proof) * settings.notice; }
  // Speeds: of tight tendons, by their stretch, and of one that may pull the tip or is almost slack.
  S brisk() const { return S(2) * model.axis.pretension / model.axis.stiffness; }
  S creep() const { return smaller(settings.travel * S(5), settings.speed * S(0.5)); }
  static S mean(const State& state) { return (state.tension[0] + state.tension[1]) * S(0.5); }
  static int looser(const State& state) { return state.tension[0] < state.tension[1] ? 0 : 1; }

  // Stroke of a tendon, and of both in common, since homing began, m.
  S wound(int i, const State& state) const { return model.spool_radius * (state.angle[i] - state.start[i]); }
  S common(const State& state) const { return (wound(0, state) + wound(1, state)) * S(0.5); }

  // Of a free tip: a continuum joint's own spring bends it back. Its friction is the same for both tendons.
  S difference_of_free_tip(const State& state) const {
    const auto& joint = model.axis.distal;
    if (!model.springs()) return S(0);
    const S x = clamp(model.aim(state.held) / joint.excursion_slope(), -joint.limit(), joint.limit());
    return joint.passive_stiffness() * joint.angle(x) / joint.moment_arm(x);
  }
  S imbalance(const State& state) const { return state.tension[0] - state.tension[1] - difference_of_free_tip(state); }

  // Both spools at one speed; what separates them nevertheless is wound back.
  Winding<S> together(const S& speed, const State& state) const {
    const S apart = (wound(0, state) - wound(1, state)) * S(0.5);
    const S back = abs(apart) > settings.jog * S(0.25) ? S(tuning::homing_gain) * apart : S(0);
    return {speed - back, speed + back};
  }

  static Winding<S> alone(int i, const S& speed) {
    return i == agonist ? Winding<S>{speed, S(0)} : Winding<S>{S(0), speed};
  }

  static void go(HomingStage stage, State& state) {
    state.stage = stage;
    state.time = state.settled = S(0);
    for (int i = 0; i < 2; ++i) state.base[i] = state.tension[i];
    state.stroke = S(0);
  }

  static void fail(HomingReason reason, int tendon, State& state) {
    go(failed, state);
    state.failure = {reason, tendon};
  }

  static Winding<S> stop(HomingReason reason, int tendon, State& state) {
    fail(reason, tendon, state);
    return {};
  }

  // Gives up once what was let out is wound again.
  void give_up(HomingReason reason, int tendon, State& state) const {
    go(restore, state);
    state.failure = {reason, tendon};
  }

  // Takes a tick's readings; true where the mean tension has fallen at once, which no load can do, by more than the
  // stroke let out explains even if friction holds all beyond the sheath.
  bool follow(const Measurement<S>& measured, const S (&sent)[2], const S& dt, State& state) const {
    const S share = dt / (S(0.003) + dt);
    const S now = (measured.tension[0] + measured.tension[1]) * S(0.5);
    const S quick = dt / (S(0.01) + dt);
    const S kept = S(0.1) / (S(0.1) + dt);
    state.handle = state.handle + (measured.handle_angle - state.handle) * share;
    for (int i = 0; i < 2; ++i) {
      state.tension[i] = state.tension[i] + (measured.tension[i] - state.tension[i]) * share;
      state.speed[i] = state.speed[i] + (sent[i] - state.speed[i]) * (dt / (settings.drive_time + dt));
      state.expected[i] = state.expected[i] + state.speed[i] * dt;
      state.wanted[i] = (state.wanted[i] + state.speed[i] * dt) * kept;
      state.turned[i] = (state.turned[i] + measured.spool_angle[i] - state.angle[i]) * kept;
      state.angle[i] = measured.spool_angle[i];
    }
    const S fallen = state.before - now, out = state.before_at - common(state);
    state.before = state.before - fallen * quick;
    state.before_at = state.before_at - out * quick;
    return fallen > S(tuning::homing_sudden) * model.axis.pretension +
                        S(2) * settings.drive.uncertainty(model.axis.pretension) +
                        S(2) * larger(out, S(0)) * model.axis.stiffness / model.share[0];
  }

  static void blame(State& state) {
    for (int i = 0; i < 2; ++i) {
      const S wanted = state.wanted[i], turned = state.turned[i];
      if (abs(turned - wanted) < S(0.05) * abs(wanted)) continue;
      const bool answers = abs(turned) > S(0.3) * abs(wanted);
      return fail(!answers ? motor_dead : turned * wanted < S(0) ? motor_reversed : encoder_gain, i, state);
    }
  }

  void hand_moved(State& state) const {
    // Before anything has moved, homing waits for the hand; afterwards nothing that was measured holds.
    if (state.stage == failed || state.stage == restore) return;
    if (state.stage != rest) return fail(handle_moved, no_tendon, state);
    state.held = state.handle;
    state.waited = state.waited + state.time;
    if (state.waited > settings.most_time) return fail(handle_moved, no_tendon, state);
    state.mean = {};
    state.time = S(0);
  }

  Winding<S> average(const Measurement<S>& measured, State& state) const {
    state.mean.add(measured.tension);
    if (state.time < settings.rest_time) return {};
    for (int i = 0; i < 2; ++i) state.tension[i] = state.mean.of(i);
    return start_jogs(rest, state);
  }

  static Winding<S> start_jogs(HomingStage of, State& state) {
    go(jog, state);
    state.jogs = {};
    state.jogs.of = of;
    state.mean = {};
    return {};
  }

  Winding<S> turn_one(const Measurement<S>& measured, State& state) const {
    auto& jogs = state.jogs;
    const S hold = wait + S(4) * settings.drive_time, stroke = turn + hold;
    const S since = state.time - listen;
    const int i = jogs.motor != 0 ? 1 : 0;
    // Slack tendons are not to get tight by it.
    const S speed = (jogs.of == slacken ? -settings.jog : settings.jog) / turn;
    if (since < S(0)) {
      state.mean.add(measured.tension);
      for (int k = 0; k < 2; ++k) jogs.from[k] = state.angle[k];
      jogs.expected = state.expected[i];
      return {};
    }
    const bool back = since >= stroke;
    const S into = back ? since - stroke : since;
    jogs.whole[back].add(measured.tension);
    if (into < turn + settings.drive_time) jogs.moving[back].add(measured.tension);
    if (into < turn) return alone(i, back ? -speed : speed);
    if (!back) {
      for (int k = 0; k < 2; ++k) jogs.turned[i][k] = state.angle[k] - jogs.from[k];
      jogs.asked[i] = state.expected[i] - jogs.expected;
    } else if (into >= stroke) {
      for (int k = 0; k < 2; ++k) {
        jogs.answer[i][k] = jogs.whole[0].of(k) - (state.mean.of(k) + jogs.whole[1].of(k)) * S(0.5);
        jogs.at_once[i][k] = jogs.moving[0].of(k) - (state.mean.of(k) + jogs.moving[1].of(k)) * S(0.5);
      }
      // A drive that stood may be on either edge of its friction.
      jogs.again = settings.drive.has_friction() && !jogs.again;
      if (jogs.again) {
        state.listen();
      } else if (i == 1) {
        judge_jogs(state);
      } else {
        jogs.motor = 1;
        state.listen();
      }
    }
    return {};
  }

  void judge_jogs(State& state) const {
    const auto& jogs = state.jogs;
    const HomingStage of = jogs.of;
    const auto& base = state.base;
    const bool taut = of == tighten || (of == rest && base[0] > settings.offset && base[1] > settings.offset);
    const HomingFailure encoder = jogs.wrong_encoder(taut, flat());
    if (encoder.reason != none) return fail(encoder.reason, encoder.tendon, state);
    if (taut && !judge_answers(state)) return;
    if (of == tighten) return go(exceed, state);
    const int high = base[0] > base[1] ? 0 : 1, low = 1 - high;
    const S still = flat() + settings.drive.uncertainty(S(0));
    const auto moves = [&](int i) { return larger(abs(jogs.answer[i][i]), abs(jogs.at_once[i][i])) > still; };
    const bool answers[2]{moves(0), moves(1)};
    if (of == slacken) {
      if (!answers[high]) return give_up(cell_offset, high, state);
      return answers[low] ? give_up(cell_offset, low, state) : give_up(tip_loaded, no_tendon, state);
    }
    if (taut) return go(ease, state);
    if (base[low] < -settings.offset) return fail(cell_offset, low, state);
    // Of a bent handle, one tendon may be tight against the tip's own spring.
    const S bent = difference_of_free_tip(state) * (high == agonist ? S(1) : S(-1));
    if (base[high] <= settings.offset + larger(bent, S(0))) return begin_to_tighten(state);
    state.suspect = true;
    if (answers[low]) return go(slacken, state);
    return answers[high] ? fail(tip_loaded, no_tendon, state) : fail(cell_offset, high, state);
  }

  // Whether winding raises tension, and its own tendon's first; of taut tendons.
  bool judge_answers(State& state) const {
    const auto& answer_of = state.jogs.answer;
    const auto refuse = [&](HomingReason reason, int tendon) {
      if (state.jogs.of == rest)
        fail(reason, tendon, state);
      else
        give_up(reason, tendon, state);
      return false;
    };
    const S uncertainty = settings.drive.uncertainty(mean(state));
    for (int i = 0; i < 2; ++i)
      if (answer_of[i][0] + answer_of[i][1] < -flat() - uncertainty) return refuse(spool_reversed, i);
    if (state.jogs.own_answers() < -flat() - S(2) * uncertainty) return refuse(cells_swapped, no_tendon);
    for (int i = 0; i < 2; ++i)
      if (answer_of[i][i] < flat() - uncertainty) return refuse(cell_offset, i);
    state.proven = true;
    return true;
  }

  // ---- from taut to almost slack

  Winding<S> let_out(State& state) const {
    const S least = state.tension[looser(state)];
    if (least <= settings.offset) {
      // A difference that has shrunk with the tensions is one of the cells' gains, which is judged later.
      const S before = state.base[0] - state.base[1] - difference_of_free_tip(state);
      const bool shrunk = abs(imbalance(state)) < S(0.4) * abs(before);
      state.suspect = abs(imbalance(state)) > settings.offset * (shrunk ? S(2) : S(1));
      go(slacken, state);
      return {};
    }
    // A reading that no longer falls is not its tendon's: that is slack, and the other may hold a load alone.
    const S noticed =
        settings.drive.has_friction() ? settings.notice / (model.axis.stiffness * S(tuning::homing_least_slope)) : S(0);
    const S silent = larger(S(0.6) * settings.travel, noticed);
    for (int i = 0; i < 2; ++i) {
      if (!state.eased || state.tension[i] < state.fallen[i] - settings.notice) {
        state.fallen[i] = state.tension[i];
        state.fallen_at[i] = common(state);
      }
      if (state.fallen_at[i] - common(state) > silent) return start_jogs(slacken, state);
    }
    state.eased = true;
    const S fast = S(tuning::homing_gain) * (least - settings.offset * S(0.5)) / model.axis.stiffness;
    return together(-clamp(fast, creep() * S(0.1), brisk()), state);
  }

  Winding<S> let_out_further(State& state) const {
    const S stroke = S(1.6) * settings.offset / model.axis.stiffness;
    if (!(state.stroke > S(0))) state.stroke = stroke - common(state);
    if (common(state) > -state.stroke) return together(-creep(), state);
    if (state.suspect) return start_jogs(slacken, state);
    begin_to_tighten(state);
    return {};
  }

  Winding<S> wind_back(State& state) const {
    const S missing = -common(state);
    if (missing < settings.jog * S(0.5)) {
      const HomingFailure failure = state.failure;
      return stop(failure.reason, failure.tendon, state);
    }
    return together(clamp(S(tuning::homing_gain) * missing, creep() * S(0.1), brisk()), state);
  }

  void begin_to_tighten(State& state) const {
    go(tighten, state);
    state.slack_from = common(state);
  }

  Winding<S> take_up(State& state) const {
    const S pretension = model.axis.pretension;
    const S at = common(state);
    // A tight tendon would be noticed within this stroke: one that is not was slack, and what its cell read is its
    // offset.
    const S silent = S(2) * settings.notice / (model.axis.stiffness * S(tuning::homing_least_slope));
    for (int i = 0; i < 2; ++i) {
      if (state.tension[i] < -settings.offset) return stop(cell_reversed, i, state);
      if (state.tight[i] || state.tension[i] - state.base[i] < settings.notice) continue;
      state.tight[i] = true;
      if (at - state.slack_from > silent) state.offset[i] = state.base[i];
      if (!state.tight[1 - i]) state.stroke = at;
    }
    if (!state.tight[0] && !state.tight[1]) {
      if (at <= settings.most_stroke) return together(settings.speed, state);
      return stop(tendons_slack, no_tendon, state);
    }
    if (!state.tight[0] || !state.tight[1]) return pull_one(at - state.stroke, state);
    if (!state.taut) mark_taut(state);
    if (state.tension[looser(state)] > S(0.8) * S(tuning::homing_proof) * pretension ||
        mean(state) > S(2) * S(tuning::homing_proof) * pretension) {
      state.mean_before = mean(state);
      state.imbalance_before = imbalance(state);
      if (!state.proven) return start_jogs(tighten, state);
      go(exceed, state);
      return {};
    }
    const S stretched = at - state.stroke - settings.travel - reach(state);
    if (stretched * model.axis.stiffness * S(tuning::homing_least_slope) > S(tuning::homing_proof) * pretension)
      return stop(tendon_broken, looser(state), state);
    const S fast =
        S(tuning::homing_gain) * (S(1.5) * S(tuning::homing_proof) * pretension - mean(state)) / model.axis.stiffness;
    return together(clamp(fast, smaller(creep(), brisk()), brisk()), state);
  }

  void mark_taut(State& state) const {
    state.taut = true;
    for (int i = 0; i < 2; ++i) {
      state.tight_at[i] = wound(i, state);
      state.tight_by[i] = state.tension[i];
    }
  }

  // Stroke over which one tendon may draw the tip to where the handle is, m: a bent handle has drawn on that tendon.
  S reach(const State& state) const {
    const S excursion = model.excursion(state.held);
    const S stretch = S(1.5) * abs(difference_of_free_tip(state)) / model.axis.stiffness;
    return abs(excursion) > settings.travel && state.tight[excursion > S(0) ? agonist : antagonist]
               ? abs(excursion) + stretch
               : S(0);
  }

  // One tendon is tight and pulls the tip.
  Winding<S> pull_one(const S& pulled, State& state) const {
    const int slack = state.tight[0] ? 1 : 0;
    const S left = settings.travel + reach(state) - pulled;
    if (held(1 - slack, state) > S(2) * settings.offset) return stop(tip_loaded, no_tendon, state);
    if (left > S(0)) return together(left > S(3) * settings.travel ? settings.speed * S(0.5) : creep(), state);
    const S out = wound(slack, state), before[2]{state.base[0], state.base[1]};
    go(probe, state);
    for (int i = 0; i < 2; ++i) state.base[i] = before[i];
    state.stroke = out;
    state.jogs.motor = slack;
    return {};
  }

  // What a tendon alone carries more than a free tip asks of it: that resists by friction, damping, inertia and a
  // spring of its own.
  S held(int i, const State& state) const {
    return state.tension[i] - state.base[i] - abs(difference_of_free_tip(state));
  }

  Winding<S> let_out_one(State& state) const {
    const int i = state.jogs.motor != 0 ? 1 : 0;
    if (state.time < pause) return {};
    // At rest a free tip hardly resists; and a tendon that carried something before was not free.
    if (!state.paused &&
        (held(1 - i, state) > settings.offset * S(0.5) || state.base[1 - i] - state.base[i] > S(0.5) * settings.notice))
      return stop(tip_loaded, no_tendon, state);
    state.paused = true;
    // As far beyond its start as it was wound before: what that has let out is then wound again.
    const bool over = wound(i, state) < -state.stroke - S(3) * settings.travel;
    const bool tight = state.tension[i] - state.base[i] > settings.notice;
    if (over || tight) return stop(tight ? spool_reversed : tendon_broken, i, state);
    return alone(i, -settings.speed);
  }

  S goal(const State& state) const {
    const S pretension = model.axis.pretension;
    if (state.stage == exceed) return pretension * (S(1) + settings.overshoot);
    if (state.stage == release) return pretension * (S(1) - settings.overshoot - state.deeper);
    return pretension;
  }

  Winding<S> regulate(const S& dt, State& state) const {
    const S pretension = model.axis.pretension;
    for (int i = 0; i < 2; ++i)
      if (state.tension[i] < S(tuning::hanging) * pretension) return stop(tendon_broken, i, state);
    if (!state.judged && mean(state) > S(tuning::homing_judged) * pretension) judge_stretch(state);
    const S load = imbalance(state) - state.gain_difference * mean(state);
    if (state.judged && abs(load) > S(2) * settings.offset) fail(tip_loaded, no_tendon, state);
    if (state.stage == failed) return {};
    const S missing = goal(state) - mean(state);
    S speed = clamp(S(tuning::homing_gain) * missing / model.axis.stiffness, -brisk(), brisk());
    bool near = abs(missing) <= settings.tolerance * pretension;
    // By currents, a drive that turns back shows nothing at first, and may wind too much meanwhile.
    if (settings.drive.has_friction()) {
      const bool lets_out = state.stage == release;
      if (state.stage == approach && missing < S(-0.02) * pretension) {
        if (state.deeper > S(0.25)) return stop(stiffness_wrong, no_tendon, state);
        state.deeper = state.deeper + S(0.1);
        go(release, state);
        return {};
      }
      near = near || (missing < S(0)) != lets_out;
      speed = state.stage == done ? S(0) : lets_out ? smaller(speed, S(0)) : larger(speed, S(0));
    }
    state.settled = near ? state.settled + dt : S(0);
    // Of two axes, the first one done holds its tension until the other is.
    if (state.stage != done && state.settled >= S(tuning::still_time))
      go(HomingStage(static_cast<unsigned char>(state.stage) + 1), state);
    return together(speed, state);
  }

  // Both tendons' stretch by their tensions against what their spools have wound since they became tight.
  void judge_stretch(State& state) const {
    state.judged = true;
    S slope[2];
    for (int i = 0; i < 2; ++i) {
      const S stretched = larger(wound(i, state) - state.tight_at[i], settings.jog * S(0.1));
      slope[i] = (state.tension[i] - state.tight_by[i]) / (stretched * model.axis.stiffness);
    }
    state.gain_difference = (imbalance(state) - state.imbalance_before) / (mean(state) - state.mean_before);
    const S constant = imbalance(state) - state.gain_difference * mean(state);
    const int steeper = slope[0] > slope[1] ? 0 : 1;
    if (abs(state.gain_difference) > S(tuning::most_gain_difference)) return fail(cell_gains_apart, 1 - steeper, state);
    if (slope[steeper] * S(tuning::homing_least_slope) > S(1)) return fail(tendon_jammed, steeper, state);
    if (abs(constant) > S(1.5) * settings.offset) return fail(tip_loaded, no_tendon, state);
    if (slope[0] < S(tuning::homing_least_slope) || slope[1] < S(tuning::homing_least_slope))
      return fail(stiffness_wrong, no_tendon, state);
  }
};

}  // namespace tenodesis

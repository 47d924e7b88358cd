#pragma once
// Homing: from slack tendons to their pretension, by both motors, load cells and spool encoders.
//
// Both motors wind until their tendons are tight, first quickly, then in proportion to the missing tension. Past the
// pretension they let out again and approach it from below, so that every contact ends on the same edge of its friction
// band, whatever the tendons' state before: this makes homing repeatable. A tendon that never gets tight is broken or
// off its spool; one that gets tight over much too short a stroke is jammed.

#include "tenodesis/control.hpp"

namespace tenodesis {

template <class S>
struct HomingSettings {
  S speed{};          ///< of a slack tendon, m/s
  S gain{};           ///< of a tight tendon's missing stretch, 1/s
  S most_stroke{};    ///< largest stroke before a tendon must be tight, m
  S overshoot{};      ///< before the last approach, share of the pretension
  S tolerance{};      ///< share of the pretension
  S settle_time{};    ///< time for which both tensions must be within the tolerance, s
  S most_time{};      ///< of each stage, s
  S least_stretch{};  ///< while a tension grows by 0.6 of the pretension, share of an elastic tendon's stretch
};

enum class HomingStage : unsigned char { idle, tighten, exceed, release, approach, done, broken, jammed, timed_out };

template <class S>
struct HomingState {
  HomingStage stage{HomingStage::idle};
  S time{};         ///< in this stage, s
  S settled{};      ///< time within the tolerance, s
  S tension[2]{};   ///< smoothed, N
  S start[2]{};     ///< spool angle at the beginning, rad
  S tight_at[2]{};  ///< spool angle when the tendon was first tight, rad
  S tight_by[2]{};  ///< tension then, N
  bool tight[2]{};
  bool judged[2]{};

  constexpr bool failed() const { return stage > HomingStage::done; }
};

template <class A>
struct Homing {
  using S = A::Scalar;
  using State = HomingState<S>;

  ControlModel<A> model{};
  HomingSettings<S> settings{};

  State begin(const Measurement<S>& measured) const {
    State state{};
    state.stage = HomingStage::tighten;
    for (int i = 0; i < 2; ++i) {
      state.tension[i] = measured.tension[i];
      state.start[i] = measured.spool_angle[i];
    }
    return state;
  }

  /// Winding speeds, m/s; the state's stage shows the progress.
  Winding<S> wind(const Measurement<S>& measured, const S& dt, State& state) const {
    const S share = dt / (S(0.005) + dt);
    bool all_tight = true;
    bool all_near = true;
    S wanted[2];
    for (int i = 0; i < 2; ++i) {
      state.tension[i] = state.tension[i] + (measured.tension[i] - state.tension[i]) * share;
      judge(i, measured, state);
      if (state.stage > HomingStage::done) return {};
      const S missing = goal(state.stage) - state.tension[i];
      all_tight = all_tight && state.tight[i];
      all_near = all_near && abs(missing) <= settings.tolerance * model.axis.pretension;
      const S fastest = state.tight[i] ? settings.speed * S(0.5) : settings.speed;
      // A tight tendon waits for the other: alone it would only bend the tip.
      wanted[i] = state.stage == HomingStage::tighten && state.tight[i]
                      ? S(0)
                      : clamp(settings.gain * missing / model.axis.stiffness, -fastest, fastest);
    }
    state.time = state.time + dt;
    state.settled = all_near ? state.settled + dt : S(0);
    // Of two axes, the first one done holds its tension until the other is.
    if (state.stage == HomingStage::done) return {wanted[agonist], wanted[antagonist]};
    const bool there = state.stage == HomingStage::tighten ? all_tight : state.settled >= settings.settle_time;
    if (there) {
      state.stage = HomingStage(static_cast<unsigned char>(state.stage) + 1);
      state.time = S(0);
      state.settled = S(0);
    } else if (state.time > settings.most_time) {
      state.stage = HomingStage::timed_out;
    }
    return {wanted[agonist], wanted[antagonist]};
  }

  /// Spool angle at home, rad: where the tendon would have its pretension along its full length. After homing, every
  /// contact is about to slip toward the spool.
  S zero(int i, const Measurement<S>& measured) const {
    const S handle = abs(measured.handle_angle);
    const S at_sheath = exp(-model.sheath * (model.sheath_bend + model.sheath_bend_rate * handle));
    const S at_handle = exp(-model.vertex * model.axis.proximal.wrap_angle(handle));
    const S near = measured.tension[i] * at_sheath;
    const S held = near * at_handle;
    const S mean =
        model.share[0] * measured.tension[i] + model.share[1] * near + (model.share[2] + model.share[3]) * held;
    return measured.spool_angle[i] - (mean - model.axis.pretension) / (model.axis.stiffness * model.spool_radius);
  }

 private:
  S goal(HomingStage stage) const {
    const S pretension = model.axis.pretension;
    if (stage == HomingStage::exceed) return pretension * (S(1) + settings.overshoot);
    if (stage == HomingStage::release) return pretension * (S(1) - settings.overshoot);
    return pretension;
  }

  void judge(int i, const Measurement<S>& measured, State& state) const {
    const S pretension = model.axis.pretension;
    const S wound = model.spool_radius * (measured.spool_angle[i] - state.start[i]);
    if (!state.tight[i] && state.tension[i] > S(0.2) * pretension) {
      state.tight[i] = true;
      state.tight_at[i] = measured.spool_angle[i];
      state.tight_by[i] = state.tension[i];
    }
    if (!state.tight[i] && wound > settings.most_stroke) state.stage = HomingStage::broken;
    if (state.tight[i] && state.tension[i] < S(0.05) * pretension) state.stage = HomingStage::broken;
    // A tendon that is tight from the beginning stretches less, or not at all: that is no jam.
    if (state.tight[i] && !state.judged[i] && state.tension[i] - state.tight_by[i] > S(0.6) * pretension) {
      state.judged[i] = true;
      const S stretched = model.spool_radius * (measured.spool_angle[i] - state.tight_at[i]);
      if (stretched < settings.least_stretch * S(0.6) * pretension / model.axis.stiffness)
        state.stage = HomingStage::jammed;
    }
  }
};

}  // namespace tenodesis

#pragma once
// The envelope: what the motors' differential stroke may be, whatever the law wants.
//
// Where the tip is on target, each tendon has been wound by as much as it is stretched. The tensions at the spools and
// the strongest plausible friction bound this stretch, and with it the differential stroke that a load can explain. A
// stroke beyond these bounds would push the tip further off than motors at rest leave it.
//
// A law that corrects a tip which friction holds may also hunt: it winds until the tip breaks away, and then back. So
// the reversals of the tracking error that no tremor has made are counted, each by how little the strokes since the one
// before have taken from the error's mean square; one that the hand has made only where they have taken less than half.
// Where many follow each other the law's gain goes to zero, and the spools go to the mean of what has been lost.

#include "tenodesis/observer.hpp"

namespace tenodesis {

template <class S>
struct EnvelopeSettings {
  S margin{};      ///< of the differential stroke beyond its bounds, m
  S swing_time{};  ///< least time between two reversals, s: the tip itself oscillates faster
};

/// What the law may do at present.
template <class S>
struct EnvelopeState {
  S low{};  ///< bounds of the differential stroke, m
  S high{};
  S excess{};        ///< of the stroke over them, m
  S error{};         ///< of the tip, moved only by what is certain, m
  S extreme{};       ///< of the error since its last reversal, m
  S reversed{};      ///< error at that reversal, m
  S direction{1};    ///< of the error since then
  S since{};         ///< time since then, s
  S squared{};       ///< integral of the squared error since then, m^2 s
  S unmoved{};       ///< the same of the error without the differential stroke, m^2 s
  S handle_angle{};  ///< at that reversal, rad
  S reversals{};     ///< recent reversals, each by how little the strokes have earned
  S mean_loss{};     ///< error without the differential stroke, smoothed, m
  S gain_factor{1};  ///< of the law's gain, from 1 to 0
  bool loose{};      ///< whether a tendon is slack
  bool bounded{};    ///< whether a bound has held the law back in this tick
  bool started{};

  /// Whether the law may not do what it wants.
  constexpr bool restrained() const { return bounded || gain_factor < S(1); }
};

template <class A>
struct Envelope {
  using S = A::Scalar;
  using State = EnvelopeState<S>;

  ControlModel<A> model{};
  EnvelopeSettings<S> settings{};

  /// Follows the bounds, the error and the differential stroke; threshold: of a reversal, m.
  void update(const S& error, const S& differential, const S& threshold, const FrictionObserver<A>& observer,
              const FrictionMemory<S>& memory, const S& dt, State& state) const {
    follow_bounds(observer, memory, dt, state);
    // An error that only becomes uncertain, as while a stroke reverses, has not moved.
    state.error = clamp(state.error, error - memory.unobservable[0], error + memory.unobservable[1]);
    const S lost = state.error + differential;
    state.squared = state.squared + square(state.error) * dt;
    state.unmoved = state.unmoved + square(lost) * dt;
    state.mean_loss = state.mean_loss + (lost - state.mean_loss) * (dt / S(tuning::mean_memory));
    // A tremor that the motors leave turns the error as often as the hand.
    const S tremor = observer.trembles(memory) ? S(tuning::tremor_half_period) : S(0);
    count_reversals(threshold, larger(settings.swing_time, tremor), memory.intent.angle, dt, state);
  }

  /// Whether the tracking error is steady enough for common strokes, which free what friction holds.
  static bool steady(const State& state) { return state.reversals <= S(tuning::few_reversals); }

  /// Differential speed that leads a law back whose gain is zero, m/s; differential: the present differential stroke,
  /// m; assistance: share of a loss that is given back.
  static S returning(const S& differential, const S& assistance, const State& state) {
    return S(tuning::return_rate) * (assistance * state.mean_loss - differential);
  }

  /// A differential speed within the bounds, m/s.
  S within(const S& speed, const S& differential, State& state) const {
    const S allowed = clamp(speed, S(tuning::approach_rate) * (state.low - differential),
                            S(tuning::approach_rate) * (state.high - differential));
    state.bounded = allowed != speed;
    state.excess = state.loose ? S(0) : larger(larger(differential - state.high, state.low - differential), S(0));
    return allowed;
  }

 private:
  void follow_bounds(const FrictionObserver<A>& observer, const FrictionMemory<S>& memory, const S& dt,
                     State& state) const {
    const S lost = observer.measured_loss(memory);
    // What a slack tendon would have to let out does not show in its tension.
    state.loose = observer.loose(memory);
    const S slack = state.loose ? model.axis.pretension / model.axis.stiffness : S(0);
    const S hidden = observer.hidden_loss(memory, S(tuning::envelope_friction)) + slack;
    const S high = S(tuning::envelope_compliance) * larger(lost + hidden, S(0)) + settings.margin;
    const S low = S(tuning::envelope_compliance) * smaller(lost - hidden, S(0)) - settings.margin;
    const S share = state.started ? dt / (S(tuning::envelope_smoothing) + dt) : S(1);
    state.started = true;
    state.high = state.high + (high - state.high) * share;
    state.low = state.low + (low - state.low) * share;
  }

  // Reversals that follow sooner than the least time are the tip's own oscillation, or tremor.
  void count_reversals(const S& threshold, const S& least, const S& handle_angle, const S& dt, State& state) const {
    const S& error = state.error;
    state.reversals = state.reversals - state.reversals * dt / S(tuning::swing_memory);
    state.since = smaller(state.since + dt, S(100));
    if ((error - state.extreme) * state.direction > S(0)) {
      state.extreme = error;
    } else if ((state.extreme - error) * state.direction > threshold) {
      if (state.since >= least) {
        const S left = state.squared < state.unmoved ? state.squared / state.unmoved : S(1);
        // A tip that friction holds stays behind by what the hand has drawn, and by no more.
        const S excursion = abs(model.excursion(handle_angle) - model.excursion(state.handle_angle));
        const bool by_hand = abs(handle_angle - state.handle_angle) >= S(tuning::notable_angle) &&
                             abs(state.extreme - state.reversed) <= S(tuning::tremor_spare) * excursion;
        state.reversals = state.reversals + (by_hand ? larger(S(2) * left - S(1), S(0))
                                                     : smaller(left * S(1 / tuning::useless_share), S(1)));
      }
      state.since = S(0);
      state.squared = S(0);
      state.unmoved = S(0);
      state.direction = -state.direction;
      state.reversed = state.extreme;
      state.extreme = error;
      state.handle_angle = handle_angle;
    }
    state.gain_factor = clamp(
        (S(tuning::many_reversals) - state.reversals) / S(tuning::many_reversals - tuning::few_reversals), S(0), S(1));
  }
};

}  // namespace tenodesis

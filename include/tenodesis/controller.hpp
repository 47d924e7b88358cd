#pragma once
// The controller of an instrument: sensors in, spool velocities out, once per tick.
//
// watch -> supervisor -> observer -> homing or compensator -> supervisor. A tick depends only on its input and its
// state, and every velocity passes the supervisor last.

#include "tenodesis/compensator.hpp"
#include "tenodesis/homing.hpp"
#include "tenodesis/supervisor.hpp"
#include "tenodesis/watch.hpp"

namespace tenodesis {

enum class ObserverKind : unsigned char {
  paper,     ///< eq. 19 as printed
  exact,     ///< eq. 19 with slack and motors
  friction,  ///< tracks each contact of both tendons
};

/// Input of one tick.
template <class S, int axes>
struct ControlInput {
  std::uint64_t time{};  ///< of the measurements, ns; not used with own_clock
  Request request{Request::none};
  Measurement<S> axis[axes]{};
};

template <class S>
struct AxisOutput {
  S spool_velocity[2]{};  ///< to send to the drives, rad/s
  Estimate<S> estimate{};
  std::uint32_t faults{};          ///< present in this axis
  HomingFailure homing_failure{};  ///< of the last homing
};

/// Output of one tick.
template <class S, int axes>
struct ControlOutput {
  AxisOutput<S> axis[axes]{};
  OperatingState state{OperatingState::disabled};
  bool homed{};
  bool homing{};
  bool cut_power{};              ///< a motor does not obey: a relay in the motors' supply must open
  std::uint32_t faults{};        ///< latched ones in the fault state, otherwise those present
  std::uint32_t first_faults{};  ///< those that led to the fault state
};

/// State of the controller of one axis.
template <class S>
struct AxisMemory {
  FrictionMemory<S> friction{};
  CompensatorState<S> compensator{};
  HomingState<S> homing{};
  WatchState<S> watch{};
  CommandState<S> command{};
  HomingFailure homing_failure{};  ///< of the last homing
  S zero[2]{};                     ///< spool angles at home, rad
  S offset[2]{};                   ///< of the load cells, as homing has found it, N
  S correction[2]{S(1), S(1)};     ///< of their gains
  S yielded{};                     ///< time for which the force limit has held the law back, s
  std::uint32_t failed{};          ///< faults to report with the next tick
};

template <class S, int axes>
struct ControllerState {
  AxisMemory<S> axis[axes]{};
  SupervisorState<S> supervisor{};
  std::uint64_t time{};  ///< of the last tick, ns
  bool started{};
  bool homed{};
};

/// The constants of one axis.
template <class A>
struct AxisController {
  using S = A::Scalar;
  using Memory = AxisMemory<S>;

  ObserverKind observer{ObserverKind::friction};
  FrictionObserver<A> friction{};
  Compensator<A> compensator{};
  Homing<A> homing{};
  Watch<S> watch{};

  const ControlModel<A>& model() const { return friction.model; }

  /// The measurement with spool angles counted from home.
  Measurement<S> from_zero(const Measurement<S>& measured, const Memory& memory) const {
    Measurement<S> counted = measured;
    for (int i = 0; i < 2; ++i) counted.spool_angle[i] = measured.spool_angle[i] - memory.zero[i];
    return counted;
  }

  /// How far the motors hold the tip from where it would be with their spools at home, rad.
  S wound(const Memory& memory) const {
    const auto away = [&](int i) { return Supervisor<S>::away(i, memory.watch.trusted, memory.command); };
    const S stroke = model().spool_radius * S(0.5) * (away(agonist) - away(antagonist));
    return stroke / model().axis.distal.moment_arm(S(0));
  }

  /// Corrects the tensions by what homing has found of the cells.
  static void correct(const Memory& memory, Measurement<S>& measured) {
    for (int i = 0; i < 2; ++i) measured.tension[i] = (measured.tension[i] - memory.offset[i]) * memory.correction[i];
  }

  /// Estimate of the chosen observer; standard deviations that it does not know are NaN.
  Estimate<S> estimate(const Measurement<S>& measured, const Memory& memory) const {
    if (observer == ObserverKind::friction && memory.friction.started) return friction.estimate(memory.friction);
    const A& axis = model().axis;
    constexpr S unknown = std::numeric_limits<S>::quiet_NaN();
    Estimate<S> estimate{unknown, unknown, unknown, unknown, S(1), unknown};
    if (observer == ObserverKind::friction) return estimate;
    if (observer == ObserverKind::paper) {
      estimate.output_angle = paper_output_angle(model(), measured);
    } else {
      const Tensions<S> tension{measured.tension[agonist], measured.tension[antagonist]};
      const Stroke<S> wound{model().spool_radius * measured.spool_angle[agonist],
                            model().spool_radius * measured.spool_angle[antagonist]};
      const S handle = clamp(measured.handle_angle, -axis.handle_range, axis.handle_range);
      const Result<S> found = estimate_output_angle(axis, handle, tension, wound, friction.settings.slack_below);
      if (found.status != Status::ok) return estimate;
      estimate.output_angle = found.value;
    }
    const S x = axis.distal.coordinate(estimate.output_angle);
    const S moment = (measured.tension[agonist] - measured.tension[antagonist]) * axis.distal.moment_arm(x) -
                     axis.distal.passive_stiffness() * estimate.output_angle;
    estimate.tip_force = moment / axis.distal.tangential_arm(x);
    return estimate;
  }

  /// Spool velocities that compensate or home, rad/s.
  void want(const Measurement<S>& measured, bool home, const S& dt, Memory& memory, S (&wanted)[2]) const {
    const Winding<S> winding = home ? homing.wind(measured, memory.command.sent, dt, memory.homing)
                                    : compensator.wind(measured, friction, memory.friction, dt, memory.compensator);
    wanted[agonist] = winding.agonist / model().spool_radius;
    wanted[antagonist] = winding.antagonist / model().spool_radius;
    if (!home) judge(dt, memory);
    // The tip presses on something if it has yielded for a while: a load that comes makes it yield for a moment.
    // A fault may end that before it is named.
    const S enough = S(tuning::transient_time), most = S(4.0 / 3) * S(tuning::transient_time);
    S& yielded = memory.yielded;
    yielded = clamp(yielded + (memory.compensator.yielding ? dt : -dt), S(0), most);
    memory.command.pressing =
        yielded >= enough ? (measured.spool_angle[agonist] - measured.spool_angle[antagonist]) * S(0.5) : S(0);
  }

  /// Whether the motors have been beyond the envelope for long, as when a sensor, a rope or a motor is not what it
  /// seems; or ropes have another length than when they were homed.
  void judge(const S& dt, Memory& memory) const {
    const auto lasting = [&](Fault fault, bool beyond) {
      memory.failed |= watch.lasting(fault, 0, beyond, dt, memory.watch);
    };
    const auto limit = [&](Fault fault) { return watch.of(fault).threshold * model().axis.distal.moment_arm(S(0)); };
    const S excess = memory.compensator.envelope.excess;
    lasting(Fault::stroke_unexplained, excess > S(0) && excess > model().stroke_for(limit(Fault::stroke_unexplained)));
    // A square root only where it may matter.
    const S by_ropes = memory.friction.by_ropes;
    const S most = limit(Fault::rope_length);
    lasting(Fault::rope_length,
            by_ropes > most && by_ropes > most + S(0.5) * S(tuning::outlier) * sqrt(memory.friction.covariance[1][1]));
  }
};

/// One or two axes of one mechanism; A is the axis's type, most_axes the number of axes that there is memory for.
template <class A, int most_axes = 1>
struct Controller {
  using S = A::Scalar;
  using State = ControllerState<S, most_axes>;
  using Input = ControlInput<S, most_axes>;
  using Output = ControlOutput<S, most_axes>;

  AxisController<A> axis[most_axes]{};
  Supervisor<S> supervisor{};
  int axes{most_axes};
  bool own_clock{};  ///< ticks come once per period, whatever the input's time
  bool homed{};      ///< at the start, spool angles are zero where tendons have pretension

  /// Number of axes, with a bound that the compiler can see.
  int count() const { return smaller(axes, most_axes); }

  /// Changes law and actuation between ticks; false, and nothing changed, where the law does not work with the
  /// observer.
  bool choose(ControlLaw law, Actuation actuation, State& state) {
    for (int n = 0; n < count(); ++n)
      if (law == ControlLaw::robust && axis[n].observer != ObserverKind::friction) return false;
    const bool works = state.supervisor.operating == OperatingState::enabled && !state.supervisor.homing;
    for (int n = 0; n < count(); ++n) {
      if (works && law != axis[n].compensator.law)
        supervisor.part_from_law(law == ControlLaw::off, state.axis[n].command);
      axis[n].compensator.law = law;
      axis[n].compensator.actuation = actuation;
      state.axis[n].compensator = {};
    }
    return true;
  }

  State start() const {
    State state{};
    state.homed = homed;
    for (int n = 0; n < count(); ++n) state.axis[n].watch.homed = state.axis[n].command.knows_home = homed;
    return state;
  }

  OperatingState step(const Input& input, State& state, Output& output) const {
    const S dt = elapsed(input, state);
    const Request request = allowed(input.request, state);
    std::uint32_t faults = 0;
    for (int n = 0; n < count(); ++n) {
      AxisMemory<S>& memory = state.axis[n];
      const Measurement<S> measured = axis[n].from_zero(input.axis[n], memory);
      std::uint32_t found = axis[n].watch.check(measured, memory.command.sent, dt, memory.watch);
      if (state.supervisor.homing) found = axis[n].homing.explain(found, memory.homing);
      output.axis[n].faults = found | memory.failed;
      memory.failed = 0;
      faults |= output.axis[n].faults;
    }
    const OperatingState before = state.supervisor.operating;
    const bool was_homing = state.supervisor.homing;
    supervisor.advance(request, faults, dt, state.supervisor);
    const bool homing = state.supervisor.homing;
    if (homing && (!was_homing || input.request == Request::home)) begin_homing(state);
    if (state.supervisor.operating != before || homing != was_homing) begin_anew(before, state);

    for (int n = 0; n < count(); ++n) {
      const bool readable = !has(output.axis[n].faults, Fault::not_a_number);
      AxisMemory<S>& memory = state.axis[n];
      // An implausible reading is not used while the watch waits whether it lasts.
      Measurement<S> measured = readable ? memory.watch.trusted : axis[n].from_zero(input.axis[n], memory);
      if (readable) axis[n].correct(memory, measured);
      run(n, measured, readable, dt, state, output.axis[n]);
    }
    if (state.supervisor.homing) finish_homing(state);

    output.state = state.supervisor.operating;
    output.homed = state.homed;
    output.homing = state.supervisor.homing;
    output.cut_power = state.supervisor.cut_power;
    output.faults = output.state == OperatingState::fault ? state.supervisor.faults : state.supervisor.present;
    output.first_faults = state.supervisor.first;
    return output.state;
  }

 private:
  S elapsed(const Input& input, State& state) const {
    const std::uint64_t before = state.time;
    const bool first = !state.started;
    state.started = true;
    state.time = input.time;
    // Time that runs backward gives no interval, which the watch reports.
    return own_clock || first ? supervisor.period : tenodesis::elapsed<S>(before, input.time);
  }

  // Where a fault leaves the spools' zeros unknown, homing must come before compensation; a fault that only homing
  // can end must not prevent clearing.
  Request allowed(Request request, State& state) const {
    if (request == Request::clear && needs_homing(state.supervisor.faults)) forget_home(state);
    const std::uint32_t faults = state.supervisor.faults;
    if (request == Request::clear && (distrusted(faults).spool || has(faults, Fault::tendon_break)))
      for (int n = 0; n < count(); ++n) state.axis[n].command.knows_home = false;
    const bool engages = request == Request::enable || request == Request::resume;
    return engages && !state.homed ? Request::none : request;
  }

  void forget_home(State& state) const {
    state.homed = false;
    for (int n = 0; n < count(); ++n) state.axis[n].watch.homed = false;
  }

  void begin_homing(State& state) const {
    forget_home(state);
    for (int n = 0; n < count(); ++n) {
      state.axis[n].homing = axis[n].homing.begin(state.axis[n].watch.trusted);
      // Where it is refused, it leaves the spools as it has found them, or as they were before the law has wound them.
      CommandState<S>& command = state.axis[n].command;
      if (!command.knows_home)
        for (int i = 0; i < 2; ++i) command.home[i] = state.axis[n].watch.trusted.spool_angle[i];
      state.axis[n].homing_failure = {};
      // Homing judges the cells themselves.
      for (int i = 0; i < 2; ++i) {
        state.axis[n].offset[i] = S(0);
        state.axis[n].correction[i] = S(1);
      }
    }
  }

  // After a change of the operating state; before: that state.
  void begin_anew(OperatingState before, State& state) const {
    for (int n = 0; n < count(); ++n) {
      state.axis[n].compensator = {};
      supervisor.part(before, state.supervisor, state.axis[n].command);
      for (int i = 0; i < 2; ++i) state.axis[n].command.ahead[i] = state.axis[n].watch.following[i].behind;
      // Estimates made during a fault are not trusted.
      if (before == OperatingState::fault) state.axis[n].friction = FrictionMemory<S>{};
    }
  }

  void run(int n, const Measurement<S>& measured, bool readable, const S& dt, State& state,
           AxisOutput<S>& output) const {
    AxisMemory<S>& memory = state.axis[n];
    const AxisController<A>& own = axis[n];
    const S step = dt > S(0) ? smaller(dt, S(4) * supervisor.period) : supervisor.period;
    S wanted[2]{};
    if (readable) {
      if (needs_friction(own)) {
        if (n > 0) pass(n, state);
        own.friction.update(measured, step, memory.friction);
      }
      if (state.supervisor.operating == OperatingState::enabled)
        own.want(measured, state.supervisor.homing, step, memory, wanted);
    }
    // An unreadable tick is estimated from the last plausible readings.
    if (readable) {
      output.estimate = own.estimate(measured, memory);
    } else {
      Measurement<S> last = memory.watch.trusted;
      own.correct(memory, last);
      output.estimate = own.estimate(last, memory);
    }
    output.faults |= supervisor.command(wanted, measured, dt, state.supervisor, memory.command);
    for (int i = 0; i < 2; ++i) output.spool_velocity[i] = memory.command.sent[i];
    memory.command.knows_home = memory.command.knows_home || memory.homing.proven;
    if (memory.homing.failed()) {
      // By motors or encoders that are not wired as they should be, none finds home.
      if (memory.homing.failure.of_wiring()) memory.command.knows_home = false;
      memory.failed = bit(Fault::homing_failed);
      memory.homing_failure = memory.homing.failure;
      if (memory.homing_failure.reason == HomingReason::tendon_broken) memory.failed |= bit(Fault::tendon_break);
      memory.homing = {};
    }
    output.homing_failure = memory.homing_failure;
  }

  // Tendons of an axis bend over the joints of the axes before.
  void pass(int n, State& state) const {
    const S& coefficient = axis[n].model().passing;
    S handle(0);
    S tip(0);
    for (int k = 0; k < n; ++k) {
      handle = handle + abs(state.axis[k].friction.smooth.handle_angle);
      tip = tip + abs(state.axis[k].friction.output_angle);
    }
    state.axis[n].friction.passed[0] = coefficient * handle;
    state.axis[n].friction.passed[1] = coefficient * tip;
  }

  static bool needs_friction(const AxisController<A>& own) {
    return own.observer == ObserverKind::friction || own.compensator.law == ControlLaw::robust;
  }

  void finish_homing(State& state) const {
    for (int n = 0; n < count(); ++n)
      if (state.axis[n].homing.stage != HomingStage::done) return;
    for (int n = 0; n < count(); ++n) {
      AxisMemory<S>& memory = state.axis[n];
      // Trusted angles count from the zeros before.
      for (int i = 0; i < 2; ++i) {
        memory.offset[i] = memory.homing.offset[i];
        memory.correction[i] = S(1) / (S(1) + memory.homing.gain_difference * (i == agonist ? S(0.5) : S(-0.5)));
      }
      Measurement<S> measured = memory.watch.trusted;
      AxisController<A>::correct(memory, measured);
      for (int i = 0; i < 2; ++i) {
        const S zero = axis[n].homing.zero(i, measured);
        memory.zero[i] = memory.zero[i] + zero;
        memory.command.home[i] = measured.spool_angle[i] - zero;
      }
      memory.command.knows_home = true;
      Watch<S>::restart(memory.watch);
      memory.watch.homed = true;
      memory.friction.started = false;
      memory.friction.homed = true;
    }
    state.homed = true;
    Supervisor<S>::finish_homing(state.supervisor);
  }
};

}  // namespace tenodesis

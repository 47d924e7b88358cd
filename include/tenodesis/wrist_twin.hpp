#pragma once
// The twin of a wrist (wrist.hpp) in time: tendons with friction at every contact of their routes, links with inertia,
// jaws that grip, motors, sensors and hand.

#include "tenodesis/wrist_step.hpp"

namespace tenodesis {

template <class W, int most>
struct WristTwin {
  using S = W::S;
  using Wrist = W;
  static constexpr int N = W::joints, M = W::tendons, joints = 2 * N;
  using Rows = BoundedContacts<most>;
  using State = WristState<W, most>;
  using Command = WristCommand<W>;
  using Rope = Tendon<S, Rows>;

  W wrist{};
  Rope tendon[M]{};
  Passage<S> passage[M][most]{};
  Draw<S> draw[M][joints]{};  ///< by the passages, see set_draws()
  int draws[M]{};
  Link<S> link[N]{};
  S damping[N]{};  ///< of the tip's joints, N m s/rad
  S stop[N]{};     ///< angle of the mechanical stop, rad
  S stop_stiffness[N]{};
  S constant{};    ///< friction of each joint and of the sheath that does not depend on the load, N
  S viscous{};     ///< likewise, N s/m
  Hand<S> hand{};  ///< on each joint of the handle
  Drive<S> drive{};
  int sheath_contacts{1};
  Sensor<S> encoder{};
  Sensor<S> load_cell{};
  Sensor<S> motor_encoder{};
  S time_step{};
  int steps_per_sample{1};
  bool quasi_static{};

  /// Lists what joints draw, the nearest to the spool first; to be called when all passages are there.
  void set_draws() {
    for (int m = 0; m < M; ++m) {
      draws[m] = 0;
      for (int j = 0; j < tendon[m].contacts(); ++j) {
        const Passage<S>& at = passage[m][j];
        if (at.joint >= 0 && at.arm != S(0)) draw[m][draws[m]++] = {at.joint < N ? j + 1 : j, at.joint, at.arm};
      }
    }
  }

  /// At rest, tendons at pretension and all else at zero.
  State rest(std::uint64_t seed) const {
    State state{};
    for (int m = 0; m < M; ++m) {
      for (int i = 0; i <= tendon[m].contacts(); ++i) state.tendon[m].tension[i] = tendon[m].rest_tension;
      state.drive[m].angle = drive.backlash * S(0.5);
    }
    state.noise.seed = seed;
    for (int i = 0; i < N; ++i) state.moment[i] = S(0);
    read(state);
    state.until_sample = steps_per_sample;
    return state;
  }

  /// Advances the state by one step; it is unchanged unless the status is ok.
  Status step(const Command& command, State& state) const {
    if (!command.finite()) return Status::not_finite;
    for (int h = 0; h < wrist.handles; ++h)
      if (!(abs(command.handle_angle[h]) < S(pi))) return Status::out_of_range;
    State next = state;
    Status found = advance_to(command, time_step, state, next);
    if (found == Status::no_equilibrium && quasi_static) found = in_parts(command, state, next);
    if (found != Status::ok) return found;
    next.command = command;
    if (--next.until_sample <= 0) {
      read(next);
      next.until_sample = steps_per_sample;
    }
    state = next;
    return Status::ok;
  }

  bool prescribed() const { return !(hand.stiffness > S(0)); }
  S per_second() const { return S(1) / time_step; }

  /// A typical tension, N.
  S tension_scale(int m) const { return tendon[m].rest_tension + wrist.stiffness[m] * S(1e-3); }

  /// Opening of the jaws by the arms of the grip, m.
  S opening(const S* angle) const {
    S sum(0);
    for (int i = 0; i < N; ++i) sum = sum + wrist.joint[i].grip * angle[i];
    return sum;
  }

  /// Ratio of tensions that a joint's angle adds, which most tendons over it share.
  struct Turned {
    S coefficient{-1};
    S ratio{};
  };

  /// Bands of a tendon's contacts at given angles of all joints; shared: of every joint, filled as needed.
  void bands(int m, const S* angle, Turned* shared, Rope::Bands& band) const {
    const int n = tendon[m].contacts();
    const S drag = viscous * per_second();
    const S least = least_drag<ValueOf<S>> * wrist.stiffness[m];
    const S share = S(1) / S(sheath_contacts);
    for (int j = 0; j < n; ++j) {
      const Passage<S>& at = passage[m][j];
      if (at.joint < 0) {
        band[j] = {at.ratio, constant * share, drag * share + least};
        continue;
      }
      Turned& turned = shared[at.joint];
      if (turned.coefficient != at.coefficient) turned = {at.coefficient, exp(at.coefficient * abs(angle[at.joint]))};
      band[j] = {at.ratio * turned.ratio, constant, drag + least};
    }
  }

  /// Largest violation of the friction law in a step, as a share of the tension scale.
  S residual(const State& before, const State& after) const {
    S worst(0);
    Turned turned[joints];
    for (int m = 0; m < M; ++m) {
      if (!taut(m)) continue;
      typename Rope::Bands band;
      bands(m, after.band_angle, turned, band);
      worst = larger(worst, tendon[m].residual(band, before.tendon[m].slip, after.tendon[m]) / tension_scale(m));
    }
    return worst;
  }

  /// Whether a tendon is there.
  bool taut(int m) const { return wrist.stiffness[m] > S(0); }
  Mechanism mechanism(int g) const { return g < N ? wrist.joint[g].mechanism : wrist.handle[g - N]; }

 private:
  void read(State& state) const {
    for (int h = 0; h < wrist.handles; ++h) state.measured_handle[h] = encoder.read(state.angle[N + h], state.noise);
    for (int i = 0; i < N; ++i) state.measured_angle[i] = encoder.read(state.angle[i], state.noise);
    for (int m = 0; m < M; ++m) {
      if (!taut(m)) continue;
      state.measured_tension[m] = load_cell.read(state.tendon[m].tension[0], state.noise);
      state.measured_spool[m] = motor_encoder.read(state.drive[m].angle - drive.backlash * S(0.5), state.noise);
    }
  }

  // Divides a large quasi-static step: a guess within it may have no equilibrium although the wrist has one.
  [[gnu::noinline, gnu::cold]] Status in_parts(const Command& command, const State& before, State& next) const {
    Status found = Status::no_equilibrium;
    for (int parts = 16; parts <= 1024 && found == Status::no_equilibrium; parts *= 8) {
      State at = before;
      found = Status::ok;
      for (int k = 1; k <= parts && found == Status::ok; ++k) {
        const S share = S(k) / S(parts);
        const auto between = [&](const S& from, const S& to) { return from + (to - from) * share; };
        Command part = command;
        const Command& from = before.command;
        for (int h = 0; h < N; ++h) part.handle_angle[h] = between(from.handle_angle[h], command.handle_angle[h]);
        part.load = {{from.load.wrench.force + share * (command.load.wrench.force - from.load.wrench.force),
                      from.load.wrench.moment + share * (command.load.wrench.moment - from.load.wrench.moment)},
                     between(from.load.grip, command.load.grip),
                     command.load.in_stem_axes};
        if (from.held.stiffness > S(0) || command.held.stiffness > S(0))
          part.held.stiffness = between(from.held.stiffness, command.held.stiffness);
        State to = at;
        found = advance_to(part, time_step / S(parts), at, to);
        at = to;
      }
      if (found == Status::ok) {
        at.until_sample = next.until_sample;
        next = at;
      }
    }
    return found;
  }

  Status advance_to(const Command& command, const S& duration, const State& before, State& next) const {
    for (int m = 0; m < M; ++m)
      if (wrist.motor[m] && taut(m))
        next.drive[m] =
            advance(drive, before.drive[m], command.spool_velocity[m], before.tendon[m].tension[0], duration);
    return prescribed() ? WristStep<WristTwin, N>(*this, command, duration, before, next).solve()
                        : WristStep<WristTwin, joints>(*this, command, duration, before, next).solve();
  }
};

}  // namespace tenodesis

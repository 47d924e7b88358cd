#pragma once
// The twin of a wrist (wrist.hpp) in time: tendons with friction at every contact of their routes, links with inertia,
// jaws that grip, motors, sensors and hand.

#include "tenodesis/wrist_step.hpp"

namespace tenodesis {

/// W: a wrist; most: contacts of a tendon; Law: one of friction.hpp's.
template <class W, int most, class LawOf = CapstanWithConstant<typename W::S>>
struct WristTwin {
  using S = W::S;
  using Wrist = W;
  using Law = LawOf;
  static constexpr int N = W::joints, M = W::tendons, joints = 2 * N;
  using Rows = BoundedContacts<most>;
  using State = WristState<W, most, Law>;
  using Command = WristCommand<W>;
  using Rope = Tendon<S, Rows>;

  W wrist{};
  Law law{};
  Rope tendon[M]{};
  Passage<S> passage[M][most]{};
  Draw<S> draw[M][joints]{};  ///< by the passages, see prepare()
  int draws[M]{};
  Link<S> link[N]{};
  S reach[N]{};    ///< of the tip from each joint's far end while the joints beyond are straight, m
  S damping[N]{};  ///< of the tip's joints, N m s/rad
  S stop[N]{};     ///< angle of the mechanical stop, rad
  S stop_stiffness[N]{};
  S viscous{};           ///< friction of each joint and of the sheath, N s/m
  S sheath_bend_rate{};  ///< bend of a tendon's sheath per radian of each |angle| of the handle's joints that draw it
  Hand<S> hand{};        ///< on each joint of the handle
  Drive<S> drive{};
  Wrench<S> rig{};  ///< on the tip by a newton on the load rig, in the axes of the load
  Sensor<S> handle_encoder{};
  Sensor<S> output_encoder{};
  Sensor<S> load_cell[M]{};
  Sensor<S> motor_encoder{};
  CurrentSense<S> current{};
  S time_step{};
  int steps_per_sample{1};
  bool quasi_static{};

  S tension_scale[M]{};  ///< typical tensions, see prepare(), N
  bool ends_drawn[M]{};  ///< whether the tip draws a tendon in its last segment alone, see prepare()
  S lone_inertia{};      ///< of a single joint whose link has no mass, about its axis, see prepare(), kg m^2

  /// Sets what follows from the rest: what joints draw, the nearest to the spool first, tension scales and inertia.
  void prepare() {
    if (N == 1 && link[0].mass == S(0)) {
      const Vector<S>&axis = wrist.joint[0].axis, &about = link[0].inertia;
      lone_inertia = about.x * axis.x * axis.x + about.y * axis.y * axis.y + about.z * axis.z * axis.z;
    }
    for (int m = 0; m < M; ++m) {
      S largest(0);
      for (int i = 0; i < N; ++i) largest = larger(largest, abs(wrist.arm[m][i]));
      tension_scale[m] = tendon[m].rest_tension + wrist.stiffness[m] * largest * S(0.1);
      draws[m] = 0;
      for (int j = 0; j < tendon[m].contacts(); ++j) {
        const Passage<S>& at = passage[m][j];
        if (at.joint >= 0 && at.arm != S(0)) draw[m][draws[m]++] = {at.joint < N ? j + 1 : j, at.joint, at.arm};
      }
      int by_tip = 0;
      for (int d = 0; d < draws[m]; ++d) by_tip += draw[m][d].joint < N ? 1 : 0;
      ends_drawn[m] = by_tip == 1 && draw[m][draws[m] - 1].segment == tendon[m].contacts();
    }
  }

  /// At rest, tendons at pretension and all else at zero.
  State rest(std::uint64_t seed) const {
    State state{};
    for (int m = 0; m < M; ++m) {
      for (int i = 0; i <= tendon[m].contacts(); ++i) state.tendon[m].tension[i] = tendon[m].rest_tension;
      state.drive[m].angle = drive.backlash * S(0.5);
      state.current[m] = {tendon[m].rest_tension, drive.backlash * S(0.5), S(0)};
    }
    state.noise.seed = seed;
    read(state);
    state.until_sample = steps_per_sample;
    return state;
  }

  /// Advances the state by one step; it is unchanged unless the status is ok.
  Status step(const Command& command, State& state) const {
    if (!command.finite()) return Status::not_finite;
    for (int h = 0; h < wrist.handles; ++h)
      if (!(abs(command.handle_angle[h]) < S(pi))) return Status::out_of_range;
    for (const Contact<S>& tissue : command.contact)
      if (abs(tissue.angle) > S(pi)) return Status::unreachable;
    const State before = state;
    state.residual_in_parts = S(-1);
    for (int m = 0; m < M; ++m)
      if (wrist.motor[m] && taut(m))
        state.drive[m] =
            advance(drive, before.drive[m], command.spool_velocity[m], before.tendon[m].tension[0], time_step);
    Status found = move(command, time_step, before, state);
    if (found == Status::no_equilibrium && quasi_static) found = move_in_parts(command, before, state);
    if (found != Status::ok) {
      state = before;
      return found;
    }
    state.command = command;
    if (--state.until_sample <= 0) {
      read(state);
      state.until_sample = steps_per_sample;
    }
    return Status::ok;
  }

  bool prescribed() const { return !(hand.stiffness > S(0)); }
  S per_second() const { return S(1) / time_step; }

  /// Opening of the jaws by the arms of the grip, m.
  S opening(const S* angle) const {
    S sum(0);
    for (int i = 0; i < N; ++i) sum = sum + wrist.joint[i].grip * angle[i];
    return sum;
  }

  /// The load of a command, with that of the rig.
  WristLoad<S> load_of(const Command& command) const {
    WristLoad<S> load = command.load;
    if (command.weight == S(0)) return load;
    load.wrench.force = load.wrench.force + command.weight * rig.force;
    load.wrench.moment = load.wrench.moment + command.weight * rig.moment;
    return load;
  }

  /// Torque that the hand holds a joint of the handle with, N m.
  S handle_torque(const State& state, int h) const {
    if (prescribed()) return state.handle_moment[h];
    const S resistance = quasi_static ? S(0) : hand.damping * state.velocity[N + h];
    return hand.stiffness * (state.command.handle_angle[h] - state.angle[N + h]) - resistance;
  }

  TipPath<S> path(int i) const { return {wrist.joint[i].mechanism, wrist.joint[i].chord, reach[i]}; }

  /// The segment whose tension turns a tendon's last joint.
  int tip_segment(int m) const {
    int j = tendon[m].contacts() - 1;
    if (passage[m][j].joint < 0) return j + 1;
    while (j > 0 && passage[m][j - 1].joint == passage[m][j].joint) --j;
    return j + 1;
  }

  /// The last exponent at a joint or in the sheaths and its band, which most tendons share.
  struct Shared {
    S exponent{-1};
    Band<S> band{};
  };

  /// Bands of a tendon's contacts in a step of 1/rate from a state, at given angles of all joints; shared: of every
  /// joint and of the sheaths, filled as needed.
  void bands(int m, const S* angle, const S& more_bend, const S& rate, const State& before, Shared* shared,
             Rope::Bands& band) const {
    const int n = tendon[m].contacts();
    const S drag = viscous * rate;
    const S least = least_drag<ValueOf<S>> * wrist.stiffness[m];
    S bent = more_bend;
    if (sheath_bend_rate > S(0))
      for (int d = 0; d < draws[m]; ++d)
        if (draw[m][d].joint >= N) bent = bent + sheath_bend_rate * abs(angle[draw[m][d].joint]);
    for (int j = 0; j < n; ++j) {
      const Passage<S>& at = passage[m][j];
      const bool in_sheath = at.joint < 0;
      const S wrap = in_sheath ? larger(at.wrap + bent * at.share, S(0)) : at.wrap + abs(angle[at.joint]) * at.share;
      const S exponent = at.coefficient * wrap;
      const auto& tension = before.tendon[m].tension;
      // The held side is the slacker one.
      const auto held = [&] { return smaller(tension[j], tension[j + 1]); };
      if constexpr (Law::depends_on_speed) {
        band[j] = band_of(law, exponent, wrap, at, before.slip_speed.of[m][j], held());
      } else if constexpr (Law::depends_on_tension) {
        band[j] = band_of(law, exponent, wrap, at, S(0), held());
      } else if constexpr (Real<S>) {
        Shared& same = shared[in_sheath ? joints : at.joint];
        if (same.exponent != exponent) same = {exponent, law.band(exponent, S(0))};
        band[j] = same.band;
        band[j].constant = band[j].constant * at.share;
      } else {
        band[j] = band_of(law, exponent, wrap, at, S(0), S(0));
      }
      band[j].drag = drag * at.share + least;
    }
  }

  /// Largest violation of the friction law in a step, as a share of the tension scale.
  S residual(const State& before, const State& after) const {
    return after.residual_in_parts >= S(0) ? after.residual_in_parts : residual(before, after, per_second());
  }

  /// Whether a tendon is there.
  bool taut(int m) const { return wrist.stiffness[m] > S(0); }
  Mechanism mechanism(int g) const { return g < N ? wrist.joint[g].mechanism : wrist.handle[g - N]; }

 private:
  S residual(const State& before, const State& after, const S& rate) const {
    S worst(0);
    Shared shared[joints + 1];
    for (int m = 0; m < M; ++m) {
      if (!taut(m)) continue;
      typename Rope::Bands band;
      bands(m, after.band_angle, after.command.sheath_bend, rate, before, shared, band);
      worst = larger(worst, tendon[m].residual(band, before.tendon[m].slip, after.tendon[m]) / tension_scale[m]);
    }
    return worst;
  }

  void read(State& state) const {
    for (int h = 0; h < wrist.handles; ++h)
      state.measured_handle[h] = handle_encoder.read(state.angle[N + h], state.noise);
    for (int i = 0; i < N; ++i) state.measured_angle[i] = output_encoder.read(state.angle[i], state.noise);
    for (int m = 0; m < M; ++m) {
      if (!taut(m)) continue;
      S tension = state.tendon[m].tension[0];
      if (current.on) tension = sense(current, tension, state.drive[m].angle, state.current[m]);
      state.measured_tension[m] = load_cell[m].read(tension, state.noise);
      state.measured_spool[m] = motor_encoder.read(state.drive[m].angle - drive.backlash * S(0.5), state.noise);
    }
  }

  // Divides a large quasi-static step: a guess within it may have no equilibrium although the wrist has one.
  [[gnu::noinline, gnu::cold]] Status move_in_parts(const Command& command, const State& before, State& next) const {
    const State wound = next;
    const Command& from = before.command;
    Status found = Status::no_equilibrium;
    for (int parts = 16; parts <= most_parts && found == Status::no_equilibrium; parts *= 8) {
      State at = before;
      S worst(0);
      int sweeps = 0;
      found = Status::ok;
      for (int k = 1; k <= parts && found == Status::ok; ++k) {
        const S share = S(k) / S(parts);
        const auto between = [&](const S& a, const S& b) { return a + (b - a) * share; };
        Command part = command;
        for (int h = 0; h < N; ++h) part.handle_angle[h] = between(from.handle_angle[h], command.handle_angle[h]);
        part.load = {{from.load.wrench.force + share * (command.load.wrench.force - from.load.wrench.force),
                      from.load.wrench.moment + share * (command.load.wrench.moment - from.load.wrench.moment)},
                     between(from.load.grip, command.load.grip),
                     command.load.in_stem_axes};
        part.weight = between(from.weight, command.weight);
        if (from.held.stiffness > S(0) || command.held.stiffness > S(0))
          part.held.stiffness = between(from.held.stiffness, command.held.stiffness);
        State to = at;
        to.command = part;
        for (int m = 0; m < M; ++m) {
          to.drive[m] = wound.drive[m];
          to.drive[m].spool = between(before.drive[m].spool, wound.drive[m].spool);
        }
        found = move(part, time_step / S(parts), at, to);
        worst = larger(worst, residual(at, to, S(parts) * per_second()));
        sweeps += to.sweeps;
        at = to;
      }
      at.sweeps = sweeps;
      at.residual_in_parts = worst;
      next = at;
    }
    for (int g = 0; g < joints; ++g) next.velocity[g] = (next.angle[g] - before.angle[g]) * per_second();
    return found;
  }

  Status move(const Command& command, const S& duration, const State& before, State& next) const {
    return prescribed() ? WristStep<WristTwin, N>(*this, command, duration, before, next).solve()
                        : WristStep<WristTwin, joints>(*this, command, duration, before, next).solve();
  }
};

}  // namespace tenodesis

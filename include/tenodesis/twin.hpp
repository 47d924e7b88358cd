#pragma once
// The digital twin: joints and tendons (tendon_chain.hpp) on their bench, simulated in time steps: tendons with
// friction at every contact of their routes, links with inertia, jaws that grip, motors, sensors and hand.

#include "tenodesis/twin_step.hpp"

namespace tenodesis {

/// Most parts that a quasi-static step is divided into.
inline constexpr int most_parts = 1024;

/// The hand on the handle; without stiffness the handle angle is prescribed.
template <class S>
struct Hand {
  S stiffness{};  ///< N m/rad
  S damping{};    ///< N m s/rad
  S inertia{};    ///< of hand and handle, kg m^2
};

/// W: a chain; most: contacts of a tendon, those of the chain's layout if that is known; Law: one of friction.hpp's.
template <class W, int most, class LawOf = CapstanWithConstant<typename W::S>>
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): in lanes, a part that is not a number is as wide
struct Twin {
  using S = W::S;
  using TendonChain = W;
  using Law = LawOf;
  static constexpr int N = W::joints, M = W::tendons, joints = 2 * N;
  static constexpr bool known = W::known;
  using Rows = BoundedContacts<most, known>;
  using State = TwinState<W, most, Law>;
  using Command = TwinCommand<W>;
  using Rope = Tendon<S, Rows>;

  W chain{};
  Law law{};
  Rope tendon[M]{};
  Passage<S> passage[M][most]{};
  Draw<S> draw[M][joints]{};  ///< where the layout is unknown, by the passages, see prepare()
  int draw_count[M]{};
  Link<S> link[N]{};
  S reach[N]{};                     ///< of the tip from each joint's far end while the joints beyond are straight, m
  S damping[N]{};                   ///< of the tip's joints, N m s/rad
  S stop_low[N]{}, stop_high[N]{};  ///< angles of the mechanical stops, rad
  S stop_stiffness[N]{};
  S tendon_damping[M]{};  ///< of each tendon by the rate of its stretch, N s/m; none where the layout is known
  S viscous{};            ///< friction of each joint and of the sheath, N s/m
  S sheath_bend_rate{};   ///< bend of a tendon's sheath per radian of each |angle| of the handle's joints that draw it
  S handle_range[N]{};    ///< largest |angle| of each joint of the handle, rad; 0: any below half a turn
  Hand<S> hand{};         ///< on each joint of the handle
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
  bool ends[M]{};        ///< whether the tip draws a tendon in its last segment alone, see prepare()
  bool alike[M]{};       ///< whether friction bounds a tendon as the one before, whatever its tensions, see prepare()
  S lone_inertia{};      ///< of a single joint whose link has no mass, about its axis, see prepare(), kg m^2

  /// Sets what follows from the rest: what joints draw, the nearest to the spool first, tension scales and inertia.
  void prepare() {
    if (N == 1 && link[0].mass == S(0)) {
      const Vector<S>&axis = chain.joint[0].axis, &about = link[0].inertia;
      lone_inertia = about.x * axis.x * axis.x + about.y * axis.y * axis.y + about.z * axis.z * axis.z;
    }
    for (int m = 0; m < M; ++m) {
      S largest(0);
      for (int i = 0; i < N; ++i) largest = larger(largest, abs(chain.arm[m][i]));
      tension_scale[m] = tendon[m].rest_tension + chain.stiffness[m] * largest * S(0.1);
      draw_count[m] = 0;
      for (int j = 0; j < contacts(m); ++j)
        if (draws(m, j)) draw[m][draw_count[m]++] = draw_at(m, j);
      int by_tip = 0;
      for (int d = 0; d < draw_count[m]; ++d) by_tip += draw[m][d].joint < N ? 1 : 0;
      ends[m] = by_tip == 1 && draw[m][draw_count[m] - 1].segment == contacts(m);
      // In dual numbers, what is the same may have other derivatives.
      alike[m] = Real<S> && !Law::depends_on_speed && !Law::depends_on_tension && m > 0 && taut(m - 1) &&
                 has_route_of(m, m - 1);
    }
  }

  /// At rest, tendons at pretension and all else at zero.
  State rest(std::uint64_t seed) const {
    State state{};
    for (int m = 0; m < M; ++m) {
      for (int i = 0; i <= contacts(m); ++i) state.tendon[m].tension[i] = tendon[m].rest_tension;
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
    for (int h = 0; h < handles(); ++h)
      if (prescribed() ? beyond_range(h, command.handle_angle[h]) : !(abs(command.handle_angle[h]) < S(pi)))
        return Status::out_of_range;
    for (const Contact<S>& tissue : command.contact)
      if (abs(tissue.angle) > S(pi)) return Status::unreachable;
    const State before = state;
    state.residual_in_parts = S(-1);
    for (int m = 0; m < M; ++m)
      if (chain.motor[m] && taut(m))
        state.drive[m] =
            advance(drive, before.drive[m], command.spool_velocity[m], before.tendon[m].tension[0], time_step);
    Status found = move(command, time_step, before, state);
    if (found == Status::no_equilibrium && quasi_static) found = move_in_parts(command, before, state);
    for (int h = 0; h < handles() && found == Status::ok && !prescribed(); ++h)
      if (beyond_range(h, state.angle[N + h])) found = Status::out_of_range;
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

  /// Whether the step from a state is one of backward Euler.
  bool is_backward(const State& before) const {
    if constexpr (known)
      return false;
    else
      return before.swings && !quasi_static;
  }
  /// Whether the handle is held where a command says.
  bool prescribed() const { return !any(hand.stiffness > S(0)); }
  Flag<S> beyond_range(int h, const S& angle) const {
    const S range = if_above(handle_range[h], handle_range[h] + S(range_tolerance<ValueOf<S>>), S(pi));
    return !(abs(angle) <= range) || abs(angle) >= S(pi);
  }
  S per_second() const { return S(1) / time_step; }

  /// Opening of the jaws by the arms of the grip, m.
  S opening(const S* angle) const {
    S sum(0);
    for (int i = 0; i < N; ++i) sum = sum + chain.joint[i].grip * angle[i];
    return sum;
  }

  /// The load of a command, with that of the rig.
  ChainLoad<S> load_of(const Command& command) const {
    ChainLoad<S> load = command.load;
    if (!any(command.weight != S(0))) return load;
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

  TipPath<S> path(int i) const { return {mechanism(i), chain.joint[chain.is_within(i) ? i - 1 : i].chord, reach[i]}; }

  /// Angle of a joint, rad; where another bends within it, of both.
  S turned(const S* angle, int joint) const {
    if constexpr (!known && N > 1)
      if (joint < N && chain.is_around(joint))
        return sqrt(angle[joint] * angle[joint] + angle[joint + 1] * angle[joint + 1]);
    return angle[joint];
  }

  /// The segment whose tension turns a tendon's last joint.
  int tip_segment(int m) const {
    int j = contacts(m) - 1;
    if (joint_at(m, j) < 0) return j + 1;
    while (j > 0 && joint_at(m, j - 1) == joint_at(m, j)) --j;
    return j + 1;
  }

  Mechanism mechanism(int g) const { return chain.mechanism(g); }
  /// Joints of the handle.
  int handles() const { return known ? N : chain.handles; }
  /// Beyond its nearer stop, an angle of a joint, rad.
  S beyond_stop(int i, const S& angle) const { return angle - clamp(angle, stop_low[i], stop_high[i]); }
  /// Whether a tendon's segments are more than springs of a constant stiffness.
  bool is_nonlinear(int m) const {
    if constexpr (known)
      return false;
    else
      return chain.grows(m) || tendon_damping[m] > S(0);
  }
  /// Lengths by which a tendon's segments are stretched more than at rest, m; negative where they hang.
  ///
  /// x: coordinates of all joints; wound: by the spool, less what has been let out, m.
  void stretches(int m, const S* x, const S& wound, const State& state, Rope::Lengths& by) const {
    const int n = contacts(m);
    const auto& slip = state.tendon[m].slip;
    for (int i = 0; i <= n; ++i) by[i] = (i > 0 ? slip[i - 1] : wound) - (i < n ? slip[i] : S(0));
    each_draw(m, [&](const Draw<S>& at) { by[at.segment] = by[at.segment] + at.arm * x[at.joint]; });
  }
  /// The same of a state.
  void stretches(int m, const State& state, Rope::Lengths& by) const {
    S x[joints];
    for (int g = 0; g < joints; ++g) x[g] = coordinate_at(mechanism(g), state.angle[g]);
    stretches(m, x, drive.spool_radius * state.drive[m].spool - state.command.let_out[m], state, by);
  }
  /// Tension of a segment without damping at a stretch (m), N; negative where it would have to push.
  S elastic(int m, int i, const S& stretch) const {
    return chain.tension_at(m, chain.pretension[m] + tendon[m].stiffness[i] * stretch);
  }
  /// Damping of a segment, N s/m.
  S damping_of(int m, int i) const { return tendon_damping[m] * tendon[m].stiffness[i] / chain.stiffness[m]; }
  /// Whether a tendon is there.
  bool taut(int m) const {
    if constexpr (known)
      return true;
    else
      return chain.stiffness[m] > S(0);
  }
  int contacts(int m) const {
    if constexpr (known)
      return W::layout.contacts[m];
    else
      return tendon[m].contacts();
  }
  /// The joint of a contact, as a Passage has it.
  int joint_at(int m, int j) const {
    if constexpr (known)
      return W::layout.joint[m][j];
    else
      return passage[m][j].joint;
  }
  /// Whether the joint of a contact draws the tendon there.
  bool draws(int m, int j) const {
    if constexpr (known)
      return W::layout.draws[m][j];
    else
      return passage[m][j].joint >= 0 && passage[m][j].arm != S(0);
  }
  Draw<S> draw_at(int m, int j) const {
    const int joint = joint_at(m, j);
    return {joint < N ? j + 1 : j, joint, passage[m][j].arm};
  }
  Draw<S> last_draw(int m) const {
    if constexpr (known)
      return draw_at(m, contacts(m) - 1);
    else
      return draw[m][draw_count[m] - 1];
  }
  /// Whether the tip draws a tendon in its last segment alone.
  bool ends_drawn(int m) const {
    if constexpr (known)
      return W::layout.ends[m];
    else
      return ends[m];
  }
  /// Calls f with the number of every tendon that is there.
  template <class F>
  [[gnu::always_inline]] void each_tendon(const F& f) const {
    if constexpr (known) {
      each<M>([&](auto m) { f(m); });
    } else {
      for (int m = 0; m < M; ++m)
        if (taut(m)) f(m);
    }
  }
  /// Calls f with the number of every contact of a tendon.
  template <class F>
  [[gnu::always_inline]] void each_contact(int m, const F& f) const {
    if constexpr (known) {
      each<most>([&](auto j) {
        if (j < contacts(m)) f(j);
      });
    } else {
      for (int j = 0; j < contacts(m); ++j) f(j);
    }
  }
  /// Calls f with what joints draw of a tendon, the nearest to the spool first.
  template <class F>
  [[gnu::always_inline]] void each_draw(int m, const F& f) const {
    if constexpr (known) {
      each_contact(m, [&](int j) {
        if (draws(m, j)) f(draw_at(m, j));
      });
    } else {
      for (int d = 0; d < draw_count[m]; ++d) f(draw[m][d]);
    }
  }

  /// The last exponent at a joint or in the sheaths and its band, which most tendons share.
  struct Shared {
    S exponent{-1};
    Band<S> band;
  };

  /// Bands of a tendon's contacts in a step of 1/rate from a state, at given angles of all joints; shared: of every
  /// joint and of the sheaths, filled as needed.
  void bands(int m, const S* angle, const S& more_bend, const S& rate, const State& before, Shared* shared,
             Rope::Bands& band) const {
    const S drag = viscous * rate;
    const S least = S(least_drag<ValueOf<S>>) * chain.stiffness[m];
    S bent = more_bend;
    if (any(sheath_bend_rate > S(0)))
      each_draw(m, [&](const Draw<S>& by) {
        if (by.joint >= N) bent = bent + sheath_bend_rate * abs(angle[by.joint]);
      });
    each_contact(m, [&](int j) {
      const Passage<S>& at = passage[m][j];
      const int joint = joint_at(m, j);
      const bool in_sheath = joint < 0;
      const S wrap = in_sheath ? larger(at.wrap + bent * at.share, S(0)) : wrap_at(at, turned(angle, joint));
      const S exponent = at.coefficient * wrap;
      const auto& tension = before.tendon[m].tension;
      // The held side is the slacker one.
      const auto held = [&] { return smaller(tension[j], tension[j + 1]); };
      // In dual numbers, exponents that are the same may have other derivatives.
      if constexpr (Law::depends_on_speed) {
        band[j] = band_of(law, exponent, wrap, at, before.slip_speed.of[m][j], held());
      } else if constexpr (Law::depends_on_tension) {
        band[j] = band_of(law, exponent, wrap, at, S(0), held());
      } else if constexpr (Real<S> || !std::is_same_v<Flag<S>, bool>) {
        Shared& same = shared[in_sheath ? joints : joint];
        // The first tendon of a known layout comes past nothing twice.
        if ((known && m == 0) || any(same.exponent != exponent)) same = {exponent, law.band(exponent, S(0))};
        band[j] = same.band;
        band[j].constant = band[j].constant * at.share;
      } else {
        band[j] = band_of(law, exponent, wrap, at, S(0), S(0));
      }
      band[j].drag = drag * at.share + least;
    });
  }

  /// Largest violation of the friction law in a step, as a share of the tension scale.
  S residual(const State& before, const State& after) const {
    return after.residual_in_parts >= S(0) ? after.residual_in_parts : residual(before, after, per_second());
  }

  /// Reads the sensors.
  void read(State& state) const {
    for (int h = 0; h < N && h < handles(); ++h)
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

 private:
  // Whether all that friction is of is the same along two tendons.
  bool has_route_of(int m, int other) const {
    bool same = contacts(m) == contacts(other) && chain.stiffness[m] == chain.stiffness[other];
    for (int j = 0; same && j < contacts(m); ++j) {
      const Passage<S>&a = passage[m][j], &b = passage[other][j];
      same = a.coefficient == b.coefficient && a.wrap == b.wrap && a.wound == b.wound && a.share == b.share &&
             joint_at(m, j) == joint_at(other, j) && (joint_at(m, j) < N || draws(m, j) == draws(other, j));
    }
    return same;
  }

  S residual(const State& before, const State& after, const S& rate) const {
    S worst(0);
    Shared shared[joints + 1];
    each_tendon([&](int m) {
      typename Rope::Bands band;
      bands(m, after.band_angle, after.command.sheath_bend, rate, before, shared, band);
      worst = larger(worst,
                     tendon[m].residual(contacts(m), band, before.tendon[m].slip, after.tendon[m]) / tension_scale[m]);
    });
    return worst;
  }

  // Divides a large quasi-static step: a guess within it may have no equilibrium although the chain has one.
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
    const bool found = prescribed() ? TwinStep<Twin, N>(*this, command, duration, before, next).solve(true)
                                    : TwinStep<Twin, joints>(*this, command, duration, before, next).solve(true);
    return found ? Status::ok : Status::no_equilibrium;
  }
};

}  // namespace tenodesis

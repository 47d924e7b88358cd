#pragma once
// The twin of a wrist (wrist.hpp) in time: tendons with friction at every contact of their routes, links with inertia,
// jaws that grip, motors, sensors and hand.
//
// Every tendon is the chain of tendon.hpp. Joints that it crosses draw it in segments of the chain, so that under a
// guess of what slides and what is slack its tensions are linear in the joints' coordinates; the joints' own equations
// follow with these, by Newton's iteration, and the guess is revised until nothing contradicts it. A joint at the
// handle draws the segment before its contact, one at the tip the segment beyond.

#include "tenodesis/tendon.hpp"
#include "tenodesis/twin_parts.hpp"
#include "tenodesis/wrist_inertia.hpp"
#include "tenodesis/wrist_statics.hpp"

namespace tenodesis {

/// Up to Most values.
template <class T, int Most>
struct BoundedRow {
  T at[Most]{};
  int length{Most};

  constexpr int size() const { return length; }
  constexpr T& operator[](int i) { return at[i]; }
  constexpr const T& operator[](int i) const { return at[i]; }
};

/// Rows of a tendon with at most so many contacts.
template <int most>
struct BoundedContacts {
  template <class T>
  using PerContact = Row<T, most>;
  template <class T>
  using PerSegment = BoundedRow<T, most + 1>;
};

/// A number that depends linearly on U others.
template <class S, int U>
struct Linear {
  S value;
  S by[U];

  /// Not initialised: a step makes many that it never reads.
  Linear() = default;
  constexpr explicit Linear(const S& constant) : value(constant) {
    for (S& slope : by) slope = S(0);
  }

  /// With other operations on value and slopes.
  friend constexpr Linear operator+(const Linear& a, const Linear& b) {
    Linear sum;
    sum.value = a.value + b.value;
    for (int u = 0; u < U; ++u) sum.by[u] = a.by[u] + b.by[u];
    return sum;
  }
  friend constexpr Linear operator-(const Linear& a, const Linear& b) {
    Linear difference;
    difference.value = a.value - b.value;
    for (int u = 0; u < U; ++u) difference.by[u] = a.by[u] - b.by[u];
    return difference;
  }
  friend constexpr Linear operator+(Linear a, const S& b) {
    a.value = a.value + b;
    return a;
  }
  friend constexpr Linear operator+(const S& a, Linear b) { return b + a; }
  friend constexpr Linear operator*(const S& by, Linear a) {
    a.value = by * a.value;
    for (int u = 0; u < U; ++u) a.by[u] = by * a.by[u];
    return a;
  }
  friend constexpr Linear operator*(const Linear& a, const S& by) { return by * a; }

  S at(const S* x) const {
    S sum = value;
    for (int u = 0; u < U; ++u) sum = sum + by[u] * x[u];
    return sum;
  }
};

/// One contact of a tendon's route: in the sheath, or on a joint.
template <class S>
struct Passage {
  int joint{-1};    ///< of the tip, or of the handle counted from N on; -1: the sheath
  S coefficient{};  ///< of friction
  S ratio{1};       ///< of the tensions at which the sheath, or the straight joint, slips
  S arm{};          ///< by which a unit of the joint's coordinate lengthens the segment that it draws, m
};

/// A segment of a tendon that a joint draws.
template <class S>
struct Draw {
  int segment{};
  int joint{};
  S arm{};
};

/// An object between the jaws, as a spring that is pressed below an opening (m, by the arms of the grip).
template <class S>
struct Held {
  S opening{};
  S stiffness{};  ///< N/m; 0: there is none
  S damping{};    ///< N s/m
};

template <class W>
struct WristCommand {
  using S = W::S;
  S handle_angle[W::joints]{};     ///< of the handle's joints, or wanted by the hand, rad
  S spool_velocity[W::tendons]{};  ///< rad/s
  WristLoad<S> load{};
  Held<S> held{};

  bool finite() const {
    bool all = all_finite(load.wrench.force.x, load.wrench.force.y, load.wrench.force.z, load.wrench.moment.x,
                          load.wrench.moment.y, load.wrench.moment.z, load.grip) &&
               all_finite(held.opening, held.stiffness, held.damping);
    for (const S& angle : handle_angle) all = all && is_finite(angle);
    for (const S& velocity : spool_velocity) all = all && is_finite(velocity);
    return all;
  }
};

/// Angles of all joints, of the tip first, then of the handle, with rates and moments.
template <class W, int most_contacts>
struct WristState {
  using S = W::S;
  static constexpr int N = W::joints, M = W::tendons;

  S angle[2 * N]{};       ///< rad
  S velocity[2 * N]{};    ///< rad/s
  S moment[2 * N]{};      ///< of everything except inertia and what is gripped, N m
  S band_angle[2 * N]{};  ///< that the last step's friction is of, rad
  S handle_moment[N]{};   ///< of the tendons on the handle's joints, against positive angles, N m
  S grip_force{};         ///< on what is gripped, mean of the last step, N
  WristCommand<W> command{};
  TendonState<S, BoundedContacts<most_contacts>> tendon[M]{};
  DriveState<S> drive[M]{};
  Noise noise{};
  S measured_handle[N]{};
  S measured_angle[N]{};
  S measured_tension[M]{};
  S measured_spool[M]{};
  int until_sample{};
  int sweeps{};
};

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
  Rope::Bands bands(int m, const S* angle, Turned* shared) const {
    typename Rope::Bands band;
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
    return band;
  }

  /// Largest violation of the friction law in a step, as a share of the tension scale.
  S residual(const State& before, const State& after) const {
    S worst(0);
    Turned turned[joints];
    for (int m = 0; m < M; ++m) {
      if (!taut(m)) continue;
      worst =
          larger(worst, tendon[m].residual(bands(m, after.band_angle, turned), before.tendon[m].slip, after.tendon[m]) /
                            tension_scale(m));
    }
    return worst;
  }

 private:
  bool taut(int m) const { return wrist.stiffness[m] > S(0); }
  Mechanism mechanism(int g) const { return g < N ? wrist.joint[g].mechanism : wrist.handle[g - N]; }

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
    return prescribed() ? Step<N>(*this, command, duration, before, next).solve()
                        : Step<joints>(*this, command, duration, before, next).solve();
  }

  /// One step: U joints whose angles are unknown.
  template <int U>
  struct Step {
    using Sum = Linear<S, U>;

    const WristTwin& twin;
    const Command& command;
    const State& before;
    State& next;
    S duration;
    S per_second;
    typename Rope::Bands band[M];
    // Before the first segment that an unknown joint draws, numbers; from there on, linear in the unknown coordinates.
    int first[M];
    typename Rope::Line near[M];
    typename Rope::template LineOf<Sum> line[M];
    Reaction<S> spool[M];
    Rope::Lengths known[M];
    Rows::template PerSegment<Sum> pull[M];
    Sum moment[U];         // of the tendons by each coordinate, N m per unit
    Square<S, U> heavy{};  // 2 M / h^2
    S bias[U]{};
    S angle[joints];
    // Moments at the step's end and their slopes, as last computed, and the load's, which in motion changes little.
    S pushed[U];
    Square<S, U> yielding;
    S load_angle[N];
    S load_moment[N];
    S load_rate[N][N];
    bool is_loaded{};

    Step(const WristTwin& of, const Command& with, const S& lasting, const State& from, State& to)
        : twin(of), command(with), before(from), next(to), duration(lasting), per_second(S(1) / lasting) {}

    Status solve() {
      for (int g = 0; g < joints; ++g) angle[g] = g >= N && U == N ? command.handle_angle[g - N] : before.angle[g];
      if (!twin.quasi_static) {
        set_inertia();
        guess();
      }
      set_pulls();
      set_bands();
      next.sweeps = 0;
      Status found = settle();
      // Quasi-static, friction is that of the step's end; in motion the first guess is close enough.
      bool agreed = !twin.quasi_static;
      for (int n = 0; n < most_corrections && !agreed && found == Status::ok; ++n) {
        S was[joints];
        for (int g = 0; g < joints; ++g) was[g] = angle[g];
        set_bands();
        found = settle();
        agreed = true;
        for (int g = 0; g < joints; ++g) agreed = agreed && abs(angle[g] - was[g]) <= settled<ValueOf<S>>;
      }
      if (found == Status::ok && !agreed) return Status::no_equilibrium;
      if (found == Status::ok) finish();
      return found;
    }

    static constexpr int most_corrections = 64;
    // Change of angles within which a load's moments are linear to rounding, rad.
    static constexpr double near_angle = 1e-5;

    void set_inertia() {
      S x[N], speed[N], matrix[N][N];
      for (int i = 0; i < N; ++i) {
        speed[i] = before.velocity[i];
        x[i] = coordinate_at(twin.mechanism(i), before.angle[i] + speed[i] * duration * S(0.5));
      }
      inertia(twin.wrist, twin.link, x, speed, matrix, bias);
      const S twice = S(2) * per_second * per_second;
      for (int i = 0; i < N; ++i)
        for (int j = 0; j < N; ++j) heavy.at[i][j] = twice * matrix[i][j];
      for (int h = N; h < U; ++h) heavy.at[h][h] = twice * twin.hand.inertia;
    }

    // Where rates and moments at the step's beginning lead.
    void guess() {
      S turned[U];
      for (int u = 0; u < U; ++u) {
        const S gripped = u < N ? twin.wrist.joint[u].grip * before.grip_force : S(0);
        turned[u] = before.moment[u] + gripped - bias[u];
      }
      if (solve_linear(heavy, turned) == 0) return;
      for (int u = 0; u < U; ++u) angle[u] = angle[u] + before.velocity[u] * duration + turned[u];
    }

    // What the joints, known or unknown, draw in each segment.
    void set_pulls() {
      S given[N]{};
      for (int h = 0; h < twin.wrist.handles; ++h) given[h] = coordinate_at(twin.wrist.handle[h], angle[N + h]);
      for (int m = 0; m < M; ++m) {
        if (!twin.taut(m)) continue;
        const auto& tendon = twin.tendon[m];
        const int n = tendon.contacts();
        for (int i = 0; i <= n; ++i) known[m][i] = S(0);
        first[m] = n;
        for (int d = twin.draws[m] - 1; d >= 0; --d) {
          const Draw<S>& by = twin.draw[m][d];
          // The sheath comes before: no joint draws the first segment.
          if (U > N || by.joint < N)
            first[m] = by.segment - 1;
          else
            known[m][by.segment] = known[m][by.segment] + by.arm * given[by.joint - N];
        }
        for (int i = first[m] + 1; i <= n; ++i) pull[m][i] = Sum(known[m][i]);
        for (int d = 0; d < twin.draws[m]; ++d) {
          const Draw<S>& by = twin.draw[m][d];
          if (U > N || by.joint < N) pull[m][by.segment].by[by.joint] = by.arm;
        }
        spool[m] = tendon.held_by_spool(twin.drive.spool_radius * next.drive[m].spool);
      }
    }

    void set_bands() {
      for (int g = 0; g < joints; ++g) next.band_angle[g] = angle[g];
      Turned turned[joints];
      for (int m = 0; m < M; ++m)
        if (twin.taut(m)) band[m] = twin.bands(m, angle, turned);
    }

    S tolerance(int m) const { return friction_tolerance<ValueOf<S>> * twin.tension_scale(m); }

    // Tensions of a tendon as functions of the coordinates under its guess, as moments on the joints.
    void eliminate(int m) {
      const auto& tendon = twin.tendon[m];
      const int n = tendon.contacts();
      const auto& from = before.tendon[m].slip;
      auto& state = next.tendon[m];
      const Reaction<S> at_first = tendon.eliminate(first[m], band[m], spool[m], known[m], from, state, near[m]);
      const Reaction<Sum, S> begin{Sum(at_first.at_rest), at_first.stiffness};
      tendon.eliminate(first[m], n, band[m], begin, pull[m], from, state, line[m]);
      Sum beyond(S(0));
      for (int j = n - 1; j >= first[m]; --j) {
        const Sum slip = line[m].at_rest[j] + line[m].rate[j] * beyond;
        const Passage<S>& at = twin.passage[m][j];
        const bool at_tip = at.joint >= 0 && at.joint < N;
        if (at_tip && at.arm != S(0) && !state.slack[j + 1])
          push(at, tendon.rest_tension + tendon.stiffness[j + 1] * (pull[m][j + 1] + slip - beyond));
        line[m].at_rest[j] = slip;  // in terms of the coordinates alone
        if constexpr (U > N) {
          if (at.joint >= N && at.arm != S(0) && !state.slack[j]) {
            const Sum held = line[m].at_rest[j - 1] + line[m].rate[j - 1] * slip;
            push(at, tendon.rest_tension + tendon.stiffness[j] * (pull[m][j] + held - slip));
          }
        }
        beyond = slip;
      }
    }

    void push(const Passage<S>& at, const Sum& tension) { moment[at.joint] = moment[at.joint] - at.arm * tension; }

    // Slips and tensions at given coordinates.
    void substitute(int m, const S* x) {
      const auto& tendon = twin.tendon[m];
      auto& state = next.tendon[m];
      S beyond(0);
      for (int j = tendon.contacts() - 1; j >= first[m]; --j) {
        const S slip = line[m].at_rest[j].at(x);
        state.tension[j + 1] = tendon.rest_tension + tendon.stiffness[j + 1] * (pull[m][j + 1].at(x) + slip - beyond);
        state.slip[j] = slip;
        beyond = slip;
      }
      tendon.substitute(first[m], spool[m], known[m], near[m], beyond, state);
    }

    void coordinates(S* x) const {
      for (int u = 0; u < U; ++u) x[u] = coordinate_at(twin.mechanism(u), angle[u]);
    }

    // Guess, pass, revise (tendon.hpp), with the joints' own equations.
    Status settle() {
      S start[joints];
      for (int g = 0; g < joints; ++g) start[g] = angle[g];
      for (int sweep = 0; sweep < hasty_sweeps; ++sweep) {
        ++next.sweeps;
        for (int u = 0; u < U; ++u) moment[u] = Sum(S(0));
        for (int m = 0; m < M; ++m)
          if (twin.taut(m)) eliminate(m);
        if (newton() != Status::ok) break;
        S x[U];
        coordinates(x);
        int revised = 0;
        for (int m = 0; m < M; ++m) {
          if (!twin.taut(m)) continue;
          substitute(m, x);
          revised += twin.tendon[m].revise(band[m], before.tendon[m].slip, tolerance(m), next.tendon[m]);
        }
        if (revised == 0) return Status::ok;
      }
      for (int g = 0; g < joints; ++g) angle[g] = start[g];
      return settle_in_turn();
    }

    // Slower, but sure: the tendons are settled at given angles, and these are moved until the joints' equations hold.
    [[gnu::noinline, gnu::cold]] Status settle_in_turn() {
      S last[joints]{};
      S share(1);
      S smallest(-1);
      S step[U]{};
      for (int n = 0; n < 4 * most_corrections; ++n) {
        S x[U];
        coordinates(x);
        for (int u = 0; u < U; ++u) moment[u] = Sum(S(0));
        for (int m = 0; m < M; ++m) {
          if (!twin.taut(m)) continue;
          settle_alone(m, x);
          eliminate(m);
        }
        S off[U];
        Square<S, U> slope{};
        unbalanced(off, slope);
        S size(0);
        S scaled[U];
        for (int u = 0; u < U; ++u) {
          scaled[u] = off[u];
        }
        if (solve_linear(slope, scaled) == 0) return Status::no_equilibrium;
        for (int u = 0; u < U; ++u) size = size + off[u] * off[u] / (slope.at[u][u] * slope.at[u][u]);
        S largest(0);
        for (int u = 0; u < U; ++u) largest = larger(largest, abs(scaled[u]));
        if (largest <= settled<ValueOf<S>>) return Status::ok;
        // A step that leads farther away is halved.
        if (smallest >= S(0) && !(size < smallest) && share > S(1e-4)) {
          share = share * S(0.5);
        } else {
          smallest = size;
          share = S(1);
          for (int g = 0; g < joints; ++g) last[g] = angle[g];
          const S cut = largest > S(0.2) ? S(0.2) / largest : S(1);
          for (int u = 0; u < U; ++u) step[u] = cut * scaled[u];
        }
        for (int u = 0; u < U; ++u) angle[u] = last[u] - share * step[u];
        if (!within()) return Status::no_equilibrium;
      }
      return Status::no_equilibrium;
    }

    void settle_alone(int m, const S* x) {
      typename Rope::Lengths drawn{};
      drawn.length = twin.tendon[m].contacts() + 1;
      for (int i = 1; i < drawn.length; ++i) drawn[i] = i > first[m] ? pull[m][i].at(x) : known[m][i];
      typename Rope::Line own{};
      next.tendon[m].slip = before.tendon[m].slip;
      next.sweeps += tenodesis::settle(twin.tendon[m], band[m], drawn, spool[m], tolerance(m), next.tendon[m], own);
    }

    bool within() const {
      for (int u = 0; u < U; ++u) {
        const S limit = coordinate_limit<S>(twin.mechanism(u));
        const S x = coordinate_at(twin.mechanism(u), angle[u]);
        if (!(abs(angle[u]) < S(pi)) || !(abs(x) < limit)) return false;
      }
      return true;
    }

    // The joints' equations under the present guess.
    Status newton() {
      for (int n = 0; n < most_corrections; ++n) {
        S off[U];
        Square<S, U> slope{};
        unbalanced(off, slope);
        if (solve_linear(slope, off) == 0) return Status::no_equilibrium;
        S largest(0);
        for (int u = 0; u < U; ++u) largest = larger(largest, abs(off[u]));
        const S share = largest > S(0.25) ? S(0.25) / largest : S(1);
        for (int u = 0; u < U; ++u) {
          angle[u] = angle[u] - share * off[u];
          for (int v = 0; v < U; ++v) pushed[u] = pushed[u] - yielding.at[u][v] * share * off[v];
        }
        if (!within()) return Status::no_equilibrium;
        using V = ValueOf<S>;
        // In motion inertia outweighs all else: the next correction would be of this one's square, and smaller still.
        const V arrived = twin.quasi_static ? settled<V> : sizeof(V) == 4 ? V(1e-4) : V(3e-5);
        if (largest <= arrived) return Status::ok;
      }
      return Status::no_equilibrium;
    }

    // What is left over about every unknown joint, N m, and its slopes by the angles, N m/rad; without slopes of rates.
    void unbalanced(S* off, Square<S, U>& slope) {
      moments(off, slope);
      for (int u = 0; u < U; ++u) pushed[u] = off[u];
      yielding = slope;
      const S share = twin.quasi_static ? S(1) : S(0.5);
      for (int u = 0; u < U; ++u) {
        if (!twin.quasi_static) off[u] = (off[u] + before.moment[u]) * share - bias[u];
        for (int v = 0; v < U; ++v) slope.at[u][v] = slope.at[u][v] * share;
      }
      if (!twin.quasi_static)
        for (int u = 0; u < U; ++u)
          for (int v = 0; v < U; ++v) {
            const S turned = angle[v] - before.angle[v] - before.velocity[v] * duration;
            off[u] = off[u] - heavy.at[u][v] * turned;
            slope.at[u][v] = slope.at[u][v] - heavy.at[u][v];
          }
      const Held<S>& held = command.held;
      const S pressed = held.opening - twin.opening(angle);
      if (!(held.stiffness > S(0)) || !(pressed > S(0))) {
        next.grip_force = S(0);
        return;
      }
      const S drag = twin.quasi_static ? S(0) : held.damping * per_second;
      const S force = held.stiffness * pressed + drag * (twin.opening(before.angle) - twin.opening(angle));
      next.grip_force = larger(force, S(0));
      if (!(force > S(0))) return;
      for (int i = 0; i < N; ++i) {
        off[i] = off[i] + twin.wrist.joint[i].grip * force;
        for (int j = 0; j < N; ++j)
          slope.at[i][j] =
              slope.at[i][j] - (held.stiffness + drag) * twin.wrist.joint[i].grip * twin.wrist.joint[j].grip;
      }
    }

    // Rate of a joint's coordinate by its angle.
    S turn_at(int g, const S& x) const {
      return twin.mechanism(g) == Mechanism::gear ? S(0.5) * sqrt((S(1) - x) * (S(1) + x)) : S(1);
    }

    // Moments of the load; near where they were last computed in motion, by their rates.
    void set_load(const S* x, S* load) {
      bool is_near = is_loaded && !twin.quasi_static;
      for (int i = 0; i < N && is_near; ++i) is_near = abs(angle[i] - load_angle[i]) < S(near_angle);
      if (!is_near) {
        Bend<S> bend[N];
        for (int i = 0; i < N; ++i) {
          bend[i] = Bend<S>(twin.wrist.joint[i], x[i]);
          load_angle[i] = angle[i];
        }
        twin.wrist.load_moments(bend, command.load, load_moment, load_rate);
        is_loaded = true;
      }
      for (int i = 0; i < N; ++i) {
        load[i] = load_moment[i];
        for (int j = 0; j < N; ++j) load[i] = load[i] + load_rate[i][j] * (angle[j] - load_angle[j]);
      }
    }

    // Moments of everything but inertia and what is gripped at the step's end, and their slopes.
    void moments(S* at, Square<S, U>& slope) {
      S x[U];
      coordinates(x);
      S load[N];
      set_load(x, load);
      S turn[U];
      for (int i = 0; i < N; ++i) turn[i] = turn_at(i, x[i]);
      for (int h = N; h < U; ++h) turn[h] = turn_at(h, x[h]);
      const S speed_rate = twin.quasi_static ? S(0) : S(2) * per_second;
      for (int u = 0; u < U; ++u) {
        const S pulled = moment[u].at(x);
        at[u] = turn[u] * pulled;
        for (int v = 0; v < U; ++v) slope.at[u][v] = turn[u] * moment[u].by[v] * turn[v];
        // The rate of a gear's cos(half angle)/2.
        if (twin.mechanism(u) == Mechanism::gear) slope.at[u][u] = slope.at[u][u] - S(0.25) * x[u] * pulled;
        const S velocity = twin.quasi_static ? S(0) : speed_rate * (angle[u] - before.angle[u]) - before.velocity[u];
        if (u < N) {
          const int i = u < N ? u : 0;
          const S beyond = angle[i] - clamp(angle[i], -twin.stop[i], twin.stop[i]);
          const S spring = twin.wrist.joint[i].stiffness;
          at[i] = at[i] + load[i] - spring * angle[i] - twin.damping[i] * velocity - twin.stop_stiffness[i] * beyond;
          for (int j = 0; j < N; ++j) slope.at[i][j] = slope.at[i][j] + load_rate[i][j];
          slope.at[i][i] =
              slope.at[i][i] - spring - twin.damping[i] * speed_rate - (beyond == S(0) ? S(0) : twin.stop_stiffness[i]);
          // A joint that nothing holds stays where it is.
          if (twin.quasi_static) {
            const S keep = detail::slack_stiffness<S> * twin.stop_stiffness[i];
            at[i] = at[i] - keep * (angle[i] - before.angle[i]);
            slope.at[i][i] = slope.at[i][i] - keep;
          }
        } else {
          const S rest = twin.quasi_static ? S(0) : twin.hand.damping;
          at[u] = at[u] + twin.hand.stiffness * (command.handle_angle[u - N] - angle[u]) - rest * velocity;
          slope.at[u][u] = slope.at[u][u] - twin.hand.stiffness - rest * speed_rate;
        }
      }
    }

    void finish() {
      for (int g = 0; g < joints; ++g) {
        const S turned = angle[g] - before.angle[g];
        const bool is_free = g < U && !twin.quasi_static;
        next.velocity[g] = is_free ? S(2) * per_second * turned - before.velocity[g] : turned * per_second;
        next.angle[g] = angle[g];
        next.moment[g] = g < U ? pushed[g < U ? g : 0] : S(0);
      }
      for (int h = 0; h < twin.wrist.handles; ++h) {
        next.handle_moment[h] = S(0);
        const S turn = turn_at(N + h, coordinate_at(twin.wrist.handle[h], angle[N + h]));
        for (int m = 0; m < M; ++m)
          for (int d = 0; d < twin.draws[m] && twin.taut(m); ++d)
            if (twin.draw[m][d].joint == N + h)
              next.handle_moment[h] =
                  next.handle_moment[h] + turn * twin.draw[m][d].arm * next.tendon[m].tension[twin.draw[m][d].segment];
      }
    }
  };
};

}  // namespace tenodesis

#pragma once
// One step of a chain's twin: guess what slides and what is slack, solve the joints' equations, revise the guess.
//
// Every tendon is a row of contacts (tendon.hpp). Joints that it crosses draw it in segments between these, so that
// under a guess its tensions are linear in the joints' coordinates; the joints' own equations follow with these, by
// Newton's iteration, and the guess is revised until nothing contradicts it. A joint at the handle draws the segment
// before its contact, one at the tip the segment beyond.
//
// In motion the rule is trapezoidal. It resists a slip by the mean of friction at the step's ends; at a contact that
// stuck at its beginning that is less than the slip takes. Where a swing lasts a few steps, as beside contacts that
// stick, what is missing each time makes it grow. So a step after one of such a swing is of backward Euler.

#include <type_traits>

#include "tenodesis/chain_inertia.hpp"
#include "tenodesis/chain_statics.hpp"
#include "tenodesis/twin_state.hpp"

namespace tenodesis {

/// Most corrections of an angle in one solve.
inline constexpr int most_corrections = 64;
/// Most passes of a step of several twins in lockstep.
inline constexpr int most_lane_passes = 6;

/// Solves rows x = right by elimination without pivots, as a definite matrix allows; false where one is zero.
template <class S, int N>
[[gnu::always_inline]] constexpr Flag<S> solve_definite(Square<S, N> matrix, S* right) {
  Flag<S> regular = true;
  S inverse[N];
  for (int k = 0; k < N; ++k) {
    regular = regular && abs(matrix.at[k][k]) > S(0);
    inverse[k] = S(1) / matrix.at[k][k];
    for (int i = k + 1; i < N; ++i) {
      const S by = matrix.at[i][k] * inverse[k];
      for (int j = k + 1; j < N; ++j) matrix.at[i][j] = matrix.at[i][j] - by * matrix.at[k][j];
      right[i] = right[i] - by * right[k];
    }
  }
  for (int k = N - 1; k >= 0; --k) {
    for (int j = k + 1; j < N; ++j) right[k] = right[k] - matrix.at[k][j] * right[j];
    right[k] = right[k] * inverse[k];
  }
  return regular;
}

/// Rounds in which a loose tip's coordinates are brought to where no tendon is stretched; with a pair a joint one does.
inline constexpr int loosening_rounds = 4;
/// Stretch of a slack tendon that is rounding, m.
template <Real S>
inline constexpr S loose_by = sizeof(S) == 4 ? S(1e-9) : S(1e-15);

/// Error of a tension on a curve of stiffness, as a share of the tension scale.
template <Real S>
inline constexpr S curve_tolerance = sizeof(S) == 4 ? S(1e-5) : S(1e-10);

/// Corrections after which a moment that is negligible may be left over, and its share of what tendons can hold.
inline constexpr int patience = 8;
template <Real S>
inline constexpr S negligible = sizeof(S) == 4 ? S(1e-5) : S(1e-10);

/// (Frequency of a swing, rad/s, times the time step) squared from which on steps do not follow it: 2 pi steps long.
inline constexpr double most_followed = 1;
/// Turns in a step that are no swing, rad.
inline constexpr double least_swing = 1e-9;

/// Change of angles within which a load's moments are linear to 1e-8 of them, rad.
inline constexpr double near_angle = 1e-4;

/// One step of a twin T, with U joints whose angles are unknown.
template <class T, int U>
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): as of the state
struct TwinStep {
  using S = T::S;
  using Rows = T::Rows;
  using Rope = T::Rope;
  using State = T::State;
  using Command = T::Command;
  static constexpr int N = T::N, M = T::M, joints = T::joints;
  using Sum = Linear<S, U>;
  using Count = SideBySide<S>::Count;
  static constexpr bool alone = std::is_same_v<Flag<S>, bool>;  // not one of several in lanes

  // Tendons that are not linear.
  struct Linearised {
    Rope rope[M];
    Rope::Lengths shift[M];
    Rope::Lengths begun[M];  // stretches at the step's beginning, m
  };
  struct Nothing {};

  const T& twin;
  const Command& command;
  const State& before;
  State& next;
  S duration;
  S per_second;
  Rope::Bands band[M];
  // Before the first segment that an unknown joint draws, numbers; from there on, linear in the unknown coordinates.
  int first[M];
  Rope::Line near[M];
  Rope::template LineOf<Sum> line[M];
  Reaction<S> spool[M];
  Rope::Lengths known[M];
  [[no_unique_address]] std::conditional_t<T::known, Nothing, Linearised> linearised;
  Rows::template PerSegment<Sum> pull[M];
  Sum moment[U];         // of the tendons by each coordinate, N m per unit
  Square<S, U> heavy{};  // 2 M / h^2; of backward Euler M / h^2
  S bias[U]{};
  S angle[joints];
  S coordinate[U];  // of the unknown joints
  S turn[U];        // their rates by the angles
  S given[N];       // of the handle's joints, if they are known
  // Moments at the step's end, after the last correction of the angles; and as last computed, with their slopes and the
  // force on what is gripped.
  S pushed[U];
  S pushes[U];
  Square<S, U> yielding;
  S gripped;
  // The load's, which in motion changes little.
  S load_angle[N];
  S load_moment[N];
  S load_rate[N][N];
  bool is_loaded{};

  TwinStep(const T& of, const Command& with, const S& lasting, const State& from, State& to)
      : twin(of), command(with), before(from), next(to), duration(lasting), per_second(S(1) / lasting) {}

  /// Moves to the step's end, in the lanes that run; true where there is one.
  Flag<S> solve(const Flag<S>& runs) {
    if constexpr (T::known && Real<S>)
      return solve_flat(runs);
    else
      return solve_all(runs);
  }
  // All of it in one function, in which what is known of the layout is constants.
  [[gnu::flatten]] Flag<S> solve_flat(const Flag<S>& runs) { return solve_all(runs); }

  Flag<S> solve_all(const Flag<S>& runs) {
    for (int g = 0; g < joints; ++g) angle[g] = g >= N && U == N ? command.handle_angle[g - N] : before.angle[g];
    if (!twin.quasi_static) {
      set_inertia();
      guess();
    }
    if constexpr (!T::known) linearise();
    set_pulls();
    for (int g = 0; g < joints; ++g) next.band_angle[g] = angle[g];
    next.sweeps = Count(0);
    Flag<S> open = runs;
    Flag<S> found = false;
    if (U == N && twin.quasi_static) {
      S x[N];
      const Flag<S> loose = runs && slack_about(x);
      if constexpr (alone) {
        if (loose && rests(x)) {
          finish();
          return true;
        }
      } else {
        // Left to their own step.
        open = open && !loose;
      }
    }
    S last[U]{}, missed[U]{};
    for (int n = 0; n <= most_corrections && any(open); ++n) {
      if (n > 0) correct_bands(open, n, last, missed);
      set_bands();
      open = settle(open);
      if constexpr (!T::known)
        for (int k = 0; k < most_corrections && open && linearise_again(); ++k) open = settle(open);
      Flag<S> agreed = open;
      for (int u = first_exact(); u < U; ++u)
        agreed = agreed && abs(angle[u] - next.band_angle[u]) <= S(settled<ValueOf<S>>);
      found = found || agreed;
      open = open && !agreed;
    }
    if (any(found)) finish();
    return found;
  }

  // Takes friction at the angles that were found, and from the second time on between these and the last ones, where
  // the two misses, as functions of what is taken, are smallest (Anderson 1965).
  void correct_bands(const Flag<S>& open, int n, S* last, S* missed) {
    S along(0), square(0);
    for (int u = first_exact(); u < U && n > 1; ++u) {
      const S miss = angle[u] - next.band_angle[u];
      const S change = miss - missed[u];
      along = along + miss * change;
      square = square + change * change;
    }
    const S back = if_above(square, clamp(along / square, S(-4), S(0.9)), S(0));
    for (int u = first_exact(); u < U; ++u) {
      missed[u] = angle[u] - next.band_angle[u];
      const S mixed = n > 1 ? angle[u] - back * (angle[u] - last[u]) : angle[u];
      last[u] = angle[u];
      next.band_angle[u] = where(open, mixed, next.band_angle[u]);
    }
  }

  // The first joint whose friction is that of the step's end: quasi-static all, else those of a handle that a hand
  // moves; at the tip in motion the first guess is close enough.
  int first_exact() const { return twin.quasi_static ? 0 : N; }

  // Where tendons would let a tip without load and springs lie; x: its coordinates there, the nearest to its own.
  Flag<S> slack_about(S* x) {
    const ChainLoad<S> load = twin.load_of(command);
    S pushed_by = abs(load.grip) + command.held.stiffness;
    for (const Vector<S>& by : {load.wrench.force, load.wrench.moment})
      pushed_by = pushed_by + abs(by.x) + abs(by.y) + abs(by.z);
    for (int i = 0; i < N; ++i) pushed_by = pushed_by + twin.chain.joint[i].stiffness + twin.chain.joint[i].hardening;
    twin.chain.each_tie([&](int, const Tie<S>& tie) { pushed_by = pushed_by + tie.stiffness; });
    Flag<S> bare = pushed_by == S(0);
    if (!any(bare)) return bare;
    S stretched[M];
    Flag<S> slack = bare;
    twin.each_tendon([&](int m) {
      const auto& tendon = twin.tendon[m];
      const S none = tendon.rest_tension - twin.chain.linear_at(m, S(0));
      stretched[m] = wound(m);
      for (int i = 0; i <= twin.contacts(m); ++i)
        stretched[m] = stretched[m] + none / tendon.stiffness[i] + known[m][i] - shift(m, i);
      slack = slack && !pulls(m);
    });
    for (int i = 0; i < N; ++i) x[i] = coordinate_at(twin.mechanism(i), angle[i]);
    bare = slack;
    for (int round = 0; round < loosening_rounds; ++round) {
      slack = bare;
      twin.each_tendon([&](int m) {
        S by = stretched[m];
        S square(0);
        twin.each_draw(m, [&](const Draw<S>& at) {
          if (at.joint >= N) return;
          by = by + at.arm * x[at.joint];
          square = square + at.arm * at.arm;
        });
        slack = slack && by <= S(loose_by<ValueOf<S>>);
        const S share = if_above(by, by / square, S(0));
        twin.each_draw(m, [&](const Draw<S>& at) {
          if (at.joint < N) x[at.joint] = x[at.joint] - share * at.arm;
        });
      });
    }
    return slack;
  }

  // Whether a loose tip rests at coordinates x: friction may keep parts of a loose tendon tight, which then move it.
  [[gnu::noinline, gnu::cold]] bool rests(const S* x) {
    const State start = next;
    S was[N];
    for (int i = 0; i < N; ++i) {
      was[i] = angle[i];
      coordinate[i] = x[i];
      angle[i] = next.band_angle[i] = angle_at(twin.mechanism(i), x[i]);
    }
    bool still = true;
    for (int i = 0; i < N; ++i)
      still = still && !touches(twin.path(i), command.contact[i], Tip<S>{angle[i], coordinate[i]});
    set_bands();
    twin.each_tendon([&](int m) {
      if (!still) return;
      settle_alone(m);
      twin.each_draw(m, [&](const Draw<S>& by) {
        if (by.joint < N) still = still && next.tendon[m].tension[by.segment] <= tolerance(m);
      });
    });
    if (still) {
      for (S& moment_at_end : pushed) moment_at_end = S(0);
      next.grip_force = S(0);
      return true;
    }
    next = start;
    for (int i = 0; i < N; ++i) angle[i] = was[i];
    return false;
  }

  bool is_backward() const { return twin.is_backward(before); }
  // Rate of a speed by the angle at the step's end, and speed that the step begins with, as far as it counts.
  S speed_rate() const { return twin.quasi_static ? S(0) : is_backward() ? per_second : S(2) * per_second; }
  S carried(int u) const { return is_backward() ? S(0) : before.velocity[u]; }

  void set_inertia() {
    const S by = speed_rate() * per_second;
    for (int h = N; h < U; ++h) heavy.at[h][h] = by * twin.hand.inertia;
    if (N == 1 && any(twin.lone_inertia > S(0))) {
      heavy.at[0][0] = by * twin.lone_inertia;
      return;
    }
    S x[N], speed[N], matrix[N][N];
    for (int i = 0; i < N; ++i) {
      speed[i] = before.velocity[i];
      x[i] = coordinate_at(twin.mechanism(i), before.angle[i] + speed[i] * duration * S(0.5));
    }
    inertia(twin.chain, twin.link, x, speed, matrix, bias);
    for (int i = 0; i < N; ++i)
      for (int j = 0; j < N; ++j) heavy.at[i][j] = by * matrix[i][j];
  }

  // Where rates and moments at the step's beginning lead.
  void guess() {
    S turned[U];
    for (int u = 0; u < U; ++u) {
      const S held = u < N ? twin.chain.joint[u].grip * before.grip_force : S(0);
      const S pushed_back = u < N ? before.contact_moment[u] : S(0);
      turned[u] = before.moment[u] + held + pushed_back - bias[u];
    }
    const Flag<S> regular = solve_definite(heavy, turned);
    for (int u = 0; u < U; ++u)
      angle[u] = where(regular, angle[u] + before.velocity[u] * duration + turned[u], angle[u]);
  }

  // Whether the unknown joints draw a tendon at its end alone: then the rest of it is numbers.
  bool ends_drawn(int m) const { return U == N && twin.ends_drawn(m); }

  // Whether a drive holds a tension that is commanded, in any lane.
  bool pulls(int m) const { return any(command.spool_tension[m] > S(0)); }

  // The spool of such a drive gives way; its tension follows the command with the drive's lag, at rest at once.
  void hold_tension(int m) {
    const Flag<S> held = command.spool_tension[m] > S(0);
    const S& from = before.tendon[m].tension[0];
    const S share = twin.quasi_static ? S(1) : duration / (duration + twin.drive.time_constant);
    spool[m].at_rest = where(held, from + share * (command.spool_tension[m] - from), spool[m].at_rest);
    spool[m].stiffness = where(held, S(0), spool[m].stiffness);
  }

  // Where such a spool comes to be: as far as its segment has been stretched and has slipped past the first contact.
  void follow_tension(int m) {
    const Flag<S> held = command.spool_tension[m] > S(0);
    const auto& tendon = next.tendon[m];
    const S linear = twin.chain.linear_at(m, tendon.tension[0]);
    const S stretch = (linear - twin.tendon[m].rest_tension) / twin.tendon[m].stiffness[0];
    const S drawn = (stretch + tendon.slip[0] + command.let_out[m]) / twin.drive.spool_radius;
    auto& drive = next.drive[m];
    drive.speed = where(held, (drawn - before.drive[m].spool) * per_second, drive.speed);
    drive.angle = where(held, drawn + twin.drive.backlash * S(0.5), drive.angle);
    drive.spool = where(held, drawn, drive.spool);
  }

  // Length that a spool has wound in, m.
  S wound(int m) const { return twin.drive.spool_radius * next.drive[m].spool - command.let_out[m]; }

  // A tendon, as linear as it is about where it was last.
  const Rope& rope(int m) const {
    if constexpr (!T::known)
      if (twin.is_nonlinear(m)) return linearised.rope[m];
    return twin.tendon[m];
  }
  // By how much its segments are to be taken as longer drawn for that, m.
  S shift(int m, int i) const {
    if constexpr (!T::known)
      if (twin.is_nonlinear(m)) return linearised.shift[m][i];
    return S(0);
  }

  // Takes the segments of a tendon as linear about stretches, m.
  void linearise(int m, const Rope::Lengths& about) {
    const auto& tendon = twin.tendon[m];
    linearised.rope[m] = tendon;
    for (int i = 0; i <= twin.contacts(m); ++i) {
      const S at = twin.elastic(m, i, about[i]);
      const S elastic = tendon.stiffness[i] * twin.chain.growth_at(m, at);
      const S viscous = twin.quasi_static ? S(0) : twin.damping_of(m, i) * per_second;
      linearised.rope[m].stiffness[i] = elastic + viscous;
      const S rest = at - elastic * about[i] - viscous * linearised.begun[m][i];
      linearised.shift[m][i] = (rest - tendon.rest_tension) / linearised.rope[m].stiffness[i];
    }
  }

  // Takes what is not linear about the step's beginning.
  void linearise() {
    twin.each_tendon([&](int m) {
      if (!twin.is_nonlinear(m)) return;
      twin.stretches(m, before, linearised.begun[m]);
      linearise(m, linearised.begun[m]);
    });
  }

  // Takes it about the stretches that were found, unless their tensions are right.
  bool linearise_again() {
    bool again = false;
    twin.each_tendon([&](int m) {
      if (!twin.is_nonlinear(m)) return;
      S x[joints];
      for (int g = 0; g < joints; ++g)
        x[g] = g < U ? coordinate[g < U ? g : 0] : g - N < twin.handles() ? given[g - N] : S(0);
      typename Rope::Lengths found;
      twin.stretches(m, x, wound(m), next, found);
      bool right = true;
      for (int i = pulls(m) ? 1 : 0; i <= twin.contacts(m); ++i) {
        const S viscous = twin.quasi_static ? S(0) : twin.damping_of(m, i) * per_second;
        const S held = larger(twin.elastic(m, i, found[i]) + viscous * (found[i] - linearised.begun[m][i]), S(0));
        right =
            right && abs(held - next.tendon[m].tension[i]) <= S(curve_tolerance<ValueOf<S>>) * twin.tension_scale[m];
      }
      if (right) return;
      again = true;
      linearise(m, found);
    });
    if (again) set_pulls();
    return again;
  }

  // What the joints, known or unknown, draw in each segment.
  void set_pulls() {
    for (int h = 0; h < N && h < twin.handles(); ++h) given[h] = coordinate_at(twin.mechanism(N + h), angle[N + h]);
    twin.each_tendon([&](int m) {
      const int n = twin.contacts(m);
      first[m] = n;
      for (int i = 0; i <= n; ++i) known[m][i] = i > 0 ? shift(m, i) : S(0);
      spool[m] = rope(m).held_by_spool(wound(m) + shift(m, 0));
      if (pulls(m)) hold_tension(m);
      twin.each_draw(m, [&](const Draw<S>& by) {
        // The sheath comes before: no joint draws the first segment.
        if (U > N || by.joint < N)
          first[m] = first[m] < by.segment - 1 ? first[m] : by.segment - 1;
        else
          known[m][by.segment] = known[m][by.segment] + by.arm * given[by.joint - N];
      });
      if (ends_drawn(m)) return;
      for (int i = first[m] + 1; i <= n; ++i) pull[m][i] = Sum(known[m][i]);
      twin.each_draw(m, [&](const Draw<S>& by) {
        if (U > N || by.joint < N) pull[m][by.segment].by[by.joint] = by.arm;
      });
    });
  }

  void set_bands() {
    typename T::Shared shared[joints + 1];
    twin.each_tendon([&](int m) {
      if (m > 0 && twin.alike[m])
        band[m] = band[m - 1];
      else
        twin.bands(m, next.band_angle, command.sheath_bend, per_second, before, shared, band[m]);
    });
  }

  S tolerance(int m) const { return friction_tolerance<ValueOf<S>> * twin.tension_scale[m]; }

  // Tensions of a tendon as functions of the coordinates under its guess, as moments on the joints.
  void eliminate(int m) {
    const auto& tendon = rope(m);
    const int n = twin.contacts(m);
    const auto& from = before.tendon[m].slip;
    auto& state = next.tendon[m];
    if (ends_drawn(m)) {
      const Reaction<S> end = tendon.eliminate(n, band[m], spool[m], known[m], from, state, near[m]);
      const Draw<S> by = twin.last_draw(m);
      moment[by.joint].value = moment[by.joint].value - by.arm * end.at_rest;
      moment[by.joint].by[by.joint] = moment[by.joint].by[by.joint] - by.arm * by.arm * end.stiffness;
      return;
    }
    const Reaction<S> at_first = tendon.eliminate(first[m], band[m], spool[m], known[m], from, state, near[m]);
    const Reaction<Sum, S> begin{Sum(at_first.at_rest), at_first.stiffness};
    tendon.eliminate(first[m], n, band[m], begin, pull[m], from, state, line[m]);
    Sum beyond(S(0));
    for (int j = n - 1; j >= first[m]; --j) {
      const Sum slip = line[m].at_rest[j] + line[m].rate[j] * beyond;
      const int joint = twin.joint_at(m, j);
      const bool draws = twin.draws(m, j);
      const S& arm = twin.passage[m][j].arm;
      if (draws && joint < N)
        push(joint, arm, state.slack[j + 1],
             tendon.rest_tension + tendon.stiffness[j + 1] * (pull[m][j + 1] + slip - beyond));
      line[m].at_rest[j] = slip;  // in terms of the coordinates alone
      if constexpr (U > N) {
        if (draws && joint >= N) {
          const Sum held = line[m].at_rest[j - 1] + line[m].rate[j - 1] * slip;
          push(joint, arm, state.slack[j], tendon.rest_tension + tendon.stiffness[j] * (pull[m][j] + held - slip));
        }
      }
      beyond = slip;
    }
  }

  void push(int joint, const S& arm, const Flag<S>& slack, const Sum& tension) {
    moment[joint] = where(slack, moment[joint], moment[joint] - arm * tension);
  }

  // Slips and tensions at given coordinates.
  void substitute(int m) {
    const auto& tendon = rope(m);
    const int n = twin.contacts(m);
    auto& state = next.tendon[m];
    if (ends_drawn(m)) {
      const Draw<S> by = twin.last_draw(m);
      tendon.substitute(n, spool[m], known[m], near[m], -by.arm * coordinate[by.joint], state);
      return;
    }
    S beyond(0);
    for (int j = n - 1; j >= first[m]; --j) {
      const S slip = line[m].at_rest[j].at(coordinate);
      state.tension[j + 1] =
          tendon.rest_tension + tendon.stiffness[j + 1] * (pull[m][j + 1].at(coordinate) + slip - beyond);
      state.slip[j] = slip;
      beyond = slip;
    }
    tendon.substitute(first[m], spool[m], known[m], near[m], beyond, state);
  }

  void set_coordinates() {
    for (int u = 0; u < U; ++u) coordinate[u] = coordinate_at(twin.mechanism(u), angle[u]);
  }

  // Guess, pass, revise (tendon.hpp), with the joints' own equations, in the lanes that run; true where it has settled.
  // Others stay as they are.
  Flag<S> settle(const Flag<S>& runs) {
    S start[joints];
    if constexpr (alone)
      for (int g = 0; g < joints; ++g) start[g] = angle[g];
    // What a lane that does not run has found stays to the last bit.
    for (int u = 0; u < U; ++u) coordinate[u] = where(runs, coordinate_at(twin.mechanism(u), angle[u]), coordinate[u]);
    Flag<S> open = runs;
    Flag<S> found = false;
    for (int sweep = 0; sweep < (alone ? hasty_sweeps : most_lane_passes) && any(open); ++sweep) {
      next.sweeps = next.sweeps + where(open, Count(1), Count(0));
      for (int u = 0; u < U; ++u) moment[u] = Sum(S(0));
      twin.each_tendon([&](int m) { eliminate(m); });
      open = newton(open);
      if (!any(open)) break;
      Flag<S> revised = false;
      twin.each_tendon([&](int m) {
        substitute(m);
        const auto& from = before.tendon[m].slip;
        if constexpr (alone)
          revised |= rope(m).revise(twin.contacts(m), band[m], from, tolerance(m), next.tendon[m]) > 0;
        else
          revised = revised || rope(m).revise_all(twin.contacts(m), band[m], from, tolerance(m), next.tendon[m]);
      });
      found = found || (open && !revised);
      open = open && revised;
    }
    if constexpr (alone) {
      if (found) return true;
      for (int g = 0; g < joints; ++g) angle[g] = start[g];
      return settle_in_turn() == Status::ok;
    }
    return found;
  }

  // Slower, but sure: the tendons are settled at given angles, and these are moved until the joints' equations hold.
  [[gnu::noinline, gnu::cold]] Status settle_in_turn() {
    S last[joints]{};
    S share(1);
    S smallest(-1);
    S weight[U]{};
    S step[U]{};
    set_coordinates();
    for (int n = 0; n < 4 * most_corrections; ++n) {
      // Near a fold there may be no equilibrium with the friction of other angles.
      for (int u = first_exact(); u < U; ++u) next.band_angle[u] = angle[u];
      if (first_exact() < U) set_bands();
      for (int u = 0; u < U; ++u) moment[u] = Sum(S(0));
      twin.each_tendon([&](int m) {
        settle_alone(m);
        eliminate(m);
      });
      S off[U];
      Square<S, U> slope{};
      unbalanced(off, slope);
      S size(0);
      S scaled[U];
      for (int u = 0; u < U; ++u) scaled[u] = off[u];
      if (solve_linear(slope, scaled) == 0) return Status::no_equilibrium;
      // By slopes that stay: where a tendon starts to slip, they fall by orders, and what is left over does not rise.
      for (int u = 0; u < U; ++u) {
        if (n == 0) weight[u] = S(1) / (slope.at[u][u] * slope.at[u][u]);
        size = size + off[u] * off[u] * weight[u];
      }
      S largest(0);
      for (int u = 0; u < U; ++u) largest = larger(largest, abs(scaled[u]));
      for (int u = 0; u < U; ++u) pushed[u] = pushes[u];
      next.grip_force = gripped;
      if (largest <= settled<ValueOf<S>> || (n >= patience && is_negligible(off))) return Status::ok;
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
      set_coordinates();
      if (!within()) return Status::no_equilibrium;
    }
    return Status::no_equilibrium;
  }

  // Whether what is left over about the joints is nothing beside what the tendons can hold: about a loose joint, drag
  // alone moves the tendons, and rounding the angle.
  bool is_negligible(const S* off) const {
    S largest(0);
    twin.each_tendon([&](int m) {
      twin.each_draw(m, [&](const Draw<S>& by) { largest = larger(largest, twin.tension_scale[m] * abs(by.arm)); });
    });
    for (int u = 0; u < U; ++u)
      if (!(abs(off[u]) <= S(negligible<ValueOf<S>>) * largest)) return false;
    return true;
  }

  void settle_alone(int m) {
    const int n = twin.contacts(m);
    typename Rope::Lengths excursion{};
    for (int i = 1; i <= n; ++i)
      excursion[i] = i > first[m] && !ends_drawn(m) ? pull[m][i].at(coordinate) : known[m][i];
    if (ends_drawn(m)) excursion[n] = twin.last_draw(m).arm * coordinate[twin.last_draw(m).joint];
    typename Rope::Line own{};
    next.tendon[m].slip = before.tendon[m].slip;
    next.sweeps += tenodesis::settle(rope(m), n, band[m], excursion, spool[m], tolerance(m), next.tendon[m], own);
  }

  // Whether angles and coordinates are possible.
  Flag<S> within() const {
    Flag<S> possible = true;
    for (int u = 0; u < U; ++u)
      possible =
          possible && abs(angle[u]) < S(pi) && abs(coordinate[u]) < S(coordinate_limit<ValueOf<S>>(twin.mechanism(u)));
    return possible;
  }

  // The joints' equations under the present guess, in the lanes that run; true where they are solved.
  Flag<S> newton(const Flag<S>& runs) {
    Flag<S> open = runs;
    Flag<S> found = false;
    for (int n = 0; n < most_corrections && any(open); ++n) {
      S off[U];
      Square<S, U> slope{};
      unbalanced(off, slope);
      open = open && solve_definite(slope, off);
      S largest = abs(off[0]);
      for (int u = 1; u < U; ++u) largest = larger(largest, abs(off[u]));
      const S share = smaller(S(0.25) / largest, S(1));
      using V = ValueOf<S>;
      // In motion inertia outweighs all else: the next correction would be of this one's square, and smaller still.
      const V arrived = twin.quasi_static ? settled<V> : sizeof(V) == 4 ? V(1e-4) : V(1e-7);
      const Flag<S> arrives = open && largest <= S(arrived);
      for (int u = 0; u < U; ++u) {
        angle[u] = where(open, angle[u] - share * off[u], angle[u]);
        // Beyond the correction's square there is nothing but rounding.
        coordinate[u] = where(arrives, coordinate[u] - turn[u] * off[u], coordinate[u]);
        S less = yielding.at[u][0] * off[0];
        for (int v = 1; v < U; ++v) less = less + yielding.at[u][v] * off[v];
        pushed[u] = where(open, pushes[u] - share * less, pushed[u]);
      }
      next.grip_force = where(open, gripped, next.grip_force);
      const Flag<S> far = open && !arrives;
      if (any(far))
        for (int u = 0; u < U; ++u)
          coordinate[u] = where(far, coordinate_at(twin.mechanism(u), angle[u]), coordinate[u]);
      const Flag<S> possible = within();
      found = found || (arrives && possible);
      open = open && possible && !arrives;
    }
    return found;
  }

  // What is left over about every unknown joint, N m, and its slopes by the angles, N m/rad; without slopes of rates.
  void unbalanced(S* off, Square<S, U>& slope) {
    moments(off, slope);
    for (int u = 0; u < U; ++u) pushes[u] = off[u];
    yielding = slope;
    const bool by_end = twin.quasi_static || is_backward();
    const S share = by_end ? S(1) : S(0.5);
    for (int u = 0; u < U; ++u) {
      if (!by_end) off[u] = (off[u] + before.moment[u]) * share;
      if (!twin.quasi_static) off[u] = off[u] - bias[u];
      for (int v = 0; v < U; ++v) slope.at[u][v] = slope.at[u][v] * share;
    }
    if (!twin.quasi_static)
      for (int u = 0; u < U; ++u)
        for (int v = 0; v < U; ++v) {
          const S turned = angle[v] - before.angle[v] - before.velocity[v] * duration;
          off[u] = off[u] - heavy.at[u][v] * turned;
          slope.at[u][v] = slope.at[u][v] - heavy.at[u][v];
        }
    for (int i = 0; i < N; ++i) {
      if (!any(command.contact[i].present())) continue;
      const Resistance<S> tissue = resistance_about(i);
      off[i] = off[i] + tissue.moment;
      slope.at[i][i] = slope.at[i][i] - tissue.stiffness;
    }
    const Held<S>& held = command.held;
    gripped = S(0);
    if (!any(held.stiffness > S(0))) return;
    const S pressed = held.opening - twin.opening(angle);
    const S drag = twin.quasi_static ? S(0) : held.damping * per_second;
    // Only the way within the object: a push that began with the speed at which jaws come would have them touch in no
    // step, neither with it nor without.
    const S was = larger(held.opening - twin.opening(before.angle), S(0));
    const S push = held.stiffness * pressed + drag * (pressed - was);
    const Flag<S> holds = held.stiffness > S(0) && pressed > S(0) && push > S(0);
    gripped = where(holds, push, S(0));
    const S stiffness = where(holds, held.stiffness + drag, S(0));
    for (int i = 0; i < N; ++i) {
      off[i] = off[i] + twin.chain.joint[i].grip * gripped;
      for (int j = 0; j < N; ++j)
        slope.at[i][j] = slope.at[i][j] - stiffness * twin.chain.joint[i].grip * twin.chain.joint[j].grip;
    }
  }

  // Of tissue to the tip's turn about a joint.
  Resistance<S> resistance_about(int i) const {
    const TipPath<S> path = twin.path(i);
    const Contact<S>& contact = command.contact[i];
    const Tip<S> tip{angle[i], coordinate[i]};
    if (!twin.quasi_static) return resistance(path, contact, per_second, before.angle[i], tip);
    Resistance<S> at_rest = resistance_at_rest(path, contact, tip);
    const S arm = path.tangential_arm(tip.x);
    at_rest.stiffness =
        where(Flag<S>(depth(path, contact, tip) > S(0)), abs(contact.stiffness) * arm * arm, at_rest.stiffness);
    return at_rest;
  }

  // Rate of a joint's coordinate by its angle.
  S turn_at(int g, const S& x) const {
    return twin.mechanism(g) == Mechanism::gear ? S(0.5) * sqrt((S(1) - x) * (S(1) + x)) : S(1);
  }

  // Moments of the load; near where they were last computed in motion, by their rates.
  void set_load(S* load) {
    Flag<S> is_near = is_loaded && !twin.quasi_static;
    for (int i = 0; i < N && any(is_near); ++i) is_near = is_near && abs(angle[i] - load_angle[i]) < S(near_angle);
    if (any(!is_near)) {
      Bend<S> bend[N];
      for (int i = 0; i < N; ++i) bend[i] = twin.chain.bend(i, coordinate[i]);
      const auto all = twin.load_of(command);
      S at[N];
      // In motion the rates of the step's first guess do.
      if (is_loaded && !twin.quasi_static)
        twin.chain.template load_moments<false, false>(bend, all, at, load_rate);
      else
        twin.chain.load_moments(bend, all, at, load_rate);
      for (int i = 0; i < N; ++i) {
        load_moment[i] = is_loaded ? where(is_near, load_moment[i], at[i]) : at[i];
        load_angle[i] = is_loaded ? where(is_near, load_angle[i], angle[i]) : angle[i];
      }
      is_loaded = true;
    }
    for (int i = 0; i < N; ++i) {
      load[i] = load_moment[i];
      for (int j = 0; j < N; ++j) load[i] = load[i] + load_rate[i][j] * (angle[j] - load_angle[j]);
    }
  }

  // Moments of everything but inertia and what is gripped at the step's end, and their slopes.
  void moments(S* at, Square<S, U>& slope) {
    S load[N];
    set_load(load);
    for (int u = 0; u < U; ++u) turn[u] = turn_at(u, coordinate[u]);
    const S speed_rate = this->speed_rate();
    for (int u = 0; u < U; ++u) {
      const S pulled = moment[u].at(coordinate);
      at[u] = turn[u] * pulled;
      for (int v = 0; v < U; ++v) slope.at[u][v] = turn[u] * moment[u].by[v] * turn[v];
      // The rate of a gear's cos(half angle)/2.
      if (twin.mechanism(u) == Mechanism::gear) slope.at[u][u] = slope.at[u][u] - S(0.25) * coordinate[u] * pulled;
      const S velocity = twin.quasi_static ? S(0) : speed_rate * (angle[u] - before.angle[u]) - carried(u);
      if (u < N) {
        const int i = u < N ? u : 0;
        const S beyond = twin.beyond_stop(i, angle[i]);
        // At rest there are no stops, as in statics: a load that the tendons cannot hold is lost.
        const S stop = twin.quasi_static ? S(0) : twin.stop_stiffness[i];
        at[i] = at[i] + load[i] - twin.chain.spring(i, angle[i]) - twin.damping[i] * velocity - stop * beyond;
        for (int j = 0; j < N; ++j) slope.at[i][j] = slope.at[i][j] + load_rate[i][j];
        slope.at[i][i] = slope.at[i][i] - twin.chain.spring_rate(i, angle[i]) - twin.damping[i] * speed_rate -
                         where(Flag<S>(beyond == S(0)), S(0), stop);
        // A joint that nothing holds stays where it is.
        if (twin.quasi_static)
          slope.at[i][i] = slope.at[i][i] - S(detail::slack_stiffness<ValueOf<S>>) * twin.stop_stiffness[i];
      } else {
        const S rest = twin.quasi_static ? S(0) : twin.hand.damping;
        at[u] = at[u] + twin.hand.stiffness * (command.handle_angle[u - N] - angle[u]) - rest * velocity;
        slope.at[u][u] = slope.at[u][u] - twin.hand.stiffness - rest * speed_rate;
      }
    }
    twin.chain.each_tie([&](int i, const Tie<S>& tie) {
      // The trapezoidal rule would let what is stiff ring from step to step; friction of half a step's time ends it.
      const S lag = twin.quasi_static || !tie.is_rigid ? S(0) : S(0.5) * duration;
      const auto rate = [&](int j) { return speed_rate * (angle[j] - before.angle[j]) - carried(j); };
      const S apart = angle[i] - tie.ratio * angle[tie.to] + lag * (rate(i) - tie.ratio * rate(tie.to));
      const S held = tie.stiffness * apart, by = tie.stiffness * (S(1) + lag * speed_rate);
      at[i] = at[i] - held;
      at[tie.to] = at[tie.to] + tie.ratio * held;
      slope.at[i][i] = slope.at[i][i] - by;
      slope.at[i][tie.to] = slope.at[i][tie.to] + tie.ratio * by;
      slope.at[tie.to][i] = slope.at[tie.to][i] + tie.ratio * by;
      slope.at[tie.to][tie.to] = slope.at[tie.to][tie.to] - tie.ratio * tie.ratio * by;
    });
  }

  // Whether moments fell along the step's way, and by their slopes would, by more than inertia times its rate's square:
  // a pure swing of stiffness k and inertia m has k h^2 / m of that. Neither a joint that tendons draw about a turning
  // point nor one that moves with its motors swings.
  bool swings() const {
    if (twin.quasi_static) return false;
    S fallen(0), falling(0), weighed(0), largest(0);
    for (int u = 0; u < U; ++u) {
      const S turned = angle[u] - before.angle[u];
      largest = larger(largest, abs(turned));
      fallen = fallen - turned * (next.moment[u] - before.moment[u]);
      for (int v = 0; v < U; ++v) {
        const S along = turned * (angle[v] - before.angle[v]);
        falling = falling - along * yielding.at[u][v];
        weighed = weighed + along * heavy.at[u][v];
      }
    }
    const S least = S(most_followed) * per_second / speed_rate() * weighed;
    return largest > S(least_swing) && fallen > least && falling > least;
  }

  void finish() {
    twin.each_tendon([&](int m) {
      if (pulls(m)) follow_tension(m);
    });
    for (int g = 0; g < joints; ++g) {
      const S turned = angle[g] - before.angle[g];
      const bool is_free = g < U && !twin.quasi_static;
      const bool is_mean = is_free && !is_backward();  // of the speeds at both ends, what turned in the step
      next.velocity[g] = is_mean ? S(2) * per_second * turned - before.velocity[g] : turned * per_second;
      next.angle[g] = angle[g];
      next.moment[g] = g < U ? pushed[g < U ? g : 0] : S(0);
    }
    if constexpr (!T::known) next.swings = swings();
    for (int i = 0; i < N; ++i) {
      next.contact_force[i] = next.contact_moment[i] = S(0);
      if (!any(command.contact[i].present())) continue;
      const Resistance<S> tissue = resistance_about(i);
      next.contact_force[i] = tissue.force;
      next.contact_moment[i] = tissue.moment;
    }
    if constexpr (T::Law::depends_on_speed)
      twin.each_tendon([&](int m) {
        for (int j = 0; j < twin.contacts(m); ++j)
          next.slip_speed.of[m][j] = twin.law.speed_after(before.slip_speed.of[m][j],
                                                          next.tendon[m].slip[j] - before.tendon[m].slip[j], duration);
      });
    S pulled[joints]{};
    twin.each_tendon([&](int m) {
      twin.each_draw(m, [&](const Draw<S>& by) {
        pulled[by.joint] = pulled[by.joint] + by.arm * next.tendon[m].tension[by.segment];
      });
    });
    for (int h = 0; h < N && h < twin.handles(); ++h)
      next.handle_moment[h] = turn_at(N + h, U > N ? coordinate[U > N ? N + h : 0] : given[h]) * pulled[N + h];
  }
};

}  // namespace tenodesis

#pragma once
// One tendon: elastic segments between contacts with friction, from the spool (segment 0) to the tip (the last one).
//
// Its state is the length that has slipped past each contact toward the spool. A segment is a linear spring that cannot
// push. At a contact the tendon sticks while the tensions on both sides lie within the friction law's band, else it
// slides on the band's edge, and only in the direction that edge resists.
//
// Which contacts slide, which way, and which segments are slack, is guessed from the previous step; with that guess the
// tendon is a chain of linear equations, eliminated exactly in one pass from the spool to the tip. Where the result
// contradicts the guess, the guess is revised and the pass repeated. Every equation has the sign pattern of an M-matrix
// (its own slip relieves a contact, its neighbours' slip loads it), so that the solution is unique, and a few passes
// find it. Should the passes cycle, contacts are relaxed one after another, which cannot cycle, and after that only the
// first contradiction of a pass is revised (Murty 1974), which ends at the solution too: relaxation is slow where all
// of a tendon but its ends is held by drag alone. Slip is counted from the step's beginning, so that a contact never
// slides back from where a pass overshot.

#include "tenodesis/friction.hpp"

namespace tenodesis {

/// A row of N values.
template <class T, int N>
struct Row {
  T at[N];

  static constexpr int size() { return N; }
  constexpr T& operator[](int i) { return at[i]; }
  constexpr const T& operator[](int i) const { return at[i]; }
};

/// Rows of a tendon whose number of contacts is known at compile time.
template <int contacts>
struct Contacts {
  template <class T>
  using PerContact = Row<T, contacts>;
  template <class T>
  using PerSegment = Row<T, contacts + 1>;
};

enum class Slide : signed char { toward_tip = -1, none = 0, toward_spool = 1 };

/// State of the contacts and segments of a tendon; slide and slack are the guess for the next step.
template <class S, class Rows>
struct TendonState {
  Rows::template PerContact<S> slip{};  ///< past each contact toward the spool, m
  Rows::template PerContact<typename SideBySide<S>::template Choice<Slide>> slide{};  ///< in the last step
  Rows::template PerSegment<Flag<S>> slack{};
  Rows::template PerSegment<S> tension{};  ///< N
};

/// How the end of a tendon reacts to a displacement y toward the spool: tension = at_rest - stiffness y.
template <class A, class S = A>
struct Reaction {
  A at_rest;    ///< N
  S stiffness;  ///< N/m
};

/// Most passes of one step.
constexpr int most_sweeps(int contacts) { return 96 + 16 * contacts; }
/// Passes after which the contacts are relaxed.
inline constexpr int hasty_sweeps = 16;
/// Passes after which places are revised one at a time.
inline constexpr int joint_sweeps = 2 * hasty_sweeps;
/// Rounds of a relaxation.
inline constexpr int relaxation_rounds = 512;

/// Drag of every contact as a share of a segment's stiffness: makes the slip of a slack tendon unique.
template <Real S>
inline constexpr S least_drag = sizeof(S) == 4 ? S(1e-5) : S(1e-9);

/// Tolerance of bands and of slack, as a share of the tension scale.
template <Real S>
inline constexpr S friction_tolerance = sizeof(S) == 4 ? S(2e-6) : S(1e-13);

/// The constants of one tendon.
template <class S, class Rows>
struct Tendon {
  using State = TendonState<S, Rows>;
  using Bands = Rows::template PerContact<Band<S>>;
  using Lengths = Rows::template PerSegment<S>;
  using Slips = Rows::template PerContact<S>;

  Lengths stiffness{};  ///< of each segment, N/m
  S rest_tension{};     ///< of every segment before any motion, N

  int contacts() const { return int(stiffness.size()) - 1; }

  /// Slip of each contact as a linear function of the next contact's slip.
  template <class A>
  struct LineOf {
    Rows::template PerContact<A> at_rest;
    Slips rate;
  };
  using Line = LineOf<S>;

  /// Reaction of segment 0 to a spool that has drawn the tendon by pull, m.
  Reaction<S> held_by_spool(const S& pull) const { return {rest_tension + stiffness[0] * pull, stiffness[0]}; }

  /// One pass toward the tip over the first n contacts under the state's guess: returns how segment n reacts, and in
  /// line each slip by the next.
  ///
  /// spool: how segment 0 reacts to the first contact's slip; pull: lengthening of each other segment, m; from: slips
  /// at the step's beginning. A is a number, or a linear function of what draws the tendon on its way (twin_step.hpp);
  /// so are its slips then.
  template <class A>
  Reaction<A, S> eliminate(int n, const Bands& band, const Reaction<A, S>& spool,
                           const Rows::template PerSegment<A>& pull, const Slips& from, const State& state,
                           LineOf<A>& line) const {
    const Reaction<A, S> start{where(state.slack[0], A(S(0)), spool.at_rest),
                               where(state.slack[0], S(0), spool.stiffness)};
    return eliminate(0, n, band, start, pull, from, state, line);
  }

  /// The same from contact i on: end is how the segment before it reacts.
  template <class A>
  Reaction<A, S> eliminate(int i, int n, const Bands& band, Reaction<A, S> end,
                           const Rows::template PerSegment<A>& pull, const Slips& from, const State& state,
                           LineOf<A>& line) const {
    for (int j = i; j < n; ++j) {
      const S k = where(state.slack[j + 1], S(0), stiffness[j + 1]);
      const S rest = where(state.slack[j + 1], S(0), rest_tension);
      A slip(from[j]);
      S rate(0);
      S stiffness_beyond = k;
      const Flag<S> slides = state.slide[j] != Slide::none;
      if (any(slides)) {
        // On the edge, the pulled side has ratio times the held side's tension, plus constant and drag.
        const Flag<S> to_spool = state.slide[j] == Slide::toward_spool;
        const S on_spool = where(to_spool, S(1), band[j].ratio);
        const S on_tip = where(to_spool, band[j].ratio, S(1));
        const S constant = where(to_spool, -band[j].constant, band[j].constant);
        const S held_spool = on_spool * end.stiffness + band[j].drag;
        const S resistance = held_spool + on_tip * k;
        // Between two slack segments nothing moves the tendon.
        const Flag<S> moves = slides && resistance > S(0);
        if (any(moves)) {
          const S inverse = S(1) / resistance;
          const A tip = rest + k * pull[j + 1];
          const A slid = (on_spool * end.at_rest - on_tip * tip + constant + band[j].drag * from[j]) * inverse;
          slip = where(moves, slid, slip);
          rate = where(moves, on_tip * k * inverse, rate);
          // k (1 - rate), without the cancellation that would give a loose tendon some stiffness.
          stiffness_beyond = where(moves, k * held_spool * inverse, stiffness_beyond);
        }
      }
      line.at_rest[j] = slip;
      line.rate[j] = rate;
      end = {rest + k * (pull[j + 1] + slip), stiffness_beyond};
    }
    return end;
  }

  /// The pass back: slips and tensions when the end of the first n contacts is displaced by y, m.
  void substitute(int n, const Reaction<S>& spool, const Lengths& pull, const Line& line, const S& y,
                  State& state) const {
    S beyond = y;
    for (int j = n - 1; j >= 0; --j) {
      const S slip = line.at_rest[j] + line.rate[j] * beyond;
      state.tension[j + 1] = rest_tension + stiffness[j + 1] * (pull[j + 1] + slip - beyond);
      state.slip[j] = slip;
      beyond = slip;
    }
    state.tension[0] = spool.at_rest - spool.stiffness * beyond;
  }

  /// Revises the guess where a pass contradicts it, in so many places at most, and returns their number; slack segments
  /// get zero tension.
  int revise(int n, const Bands& band, const Slips& from, const S& tolerance, State& state,
             int most = std::numeric_limits<int>::max()) const {
    int revised = 0;
    for (int i = 0; i <= n; ++i) {
      const bool slack = slack_after(state, i, tolerance);
      if (slack != state.slack[i] && revised < most) {
        state.slack[i] = slack;
        ++revised;
      }
      if (slack || state.tension[i] < S(0)) state.tension[i] = S(0);
    }
    for (int j = 0; j < n; ++j) {
      const Slide slide =
          slide_of(band[j], state.tension[j], state.tension[j + 1], state.slip[j] - from[j], tolerance, state.slide[j]);
      if (slide != state.slide[j] && revised < most) {
        state.slide[j] = slide;
        ++revised;
      }
    }
    return revised;
  }

  /// The same in lanes and in all places; true where there was a contradiction.
  Flag<S> revise_all(int n, const Bands& band, const Slips& from, const S& tolerance, State& state) const {
    Flag<S> revised = false;
    for (int i = 0; i <= n; ++i) {
      const Flag<S> slack = slack_after(state, i, tolerance);
      revised = revised || slack != state.slack[i];
      state.slack[i] = slack;
      state.tension[i] = where(slack || state.tension[i] < S(0), S(0), state.tension[i]);
    }
    for (int j = 0; j < n; ++j) {
      const auto slide =
          slide_of(band[j], state.tension[j], state.tension[j + 1], state.slip[j] - from[j], tolerance, state.slide[j]);
      revised = revised || slide != state.slide[j];
      state.slide[j] = slide;
    }
    return revised;
  }

  /// Projects one contact after another onto its friction law, with its neighbours held, starting from the step's
  /// beginning; the result is the state, and the next guess.
  [[gnu::noinline, gnu::cold]] void relax(const Bands& band, const Reaction<S>& spool, const Lengths& pull, const S& y,
                                          const Slips& from, State& state, int n) const {
    state.slip = from;
    for (int round = 0; round < relaxation_rounds; ++round) {
      for (int j = 0; j < n; ++j) {
        const S before = j > 0 ? state.slip[j - 1] : S(0);
        const S beyond = j + 1 < n ? state.slip[j + 1] : y;
        const Reaction<S> spool_side =
            j > 0 ? Reaction<S>{rest_tension + stiffness[j] * (pull[j] + before), stiffness[j]} : spool;
        const Reaction<S> tip_side{rest_tension + stiffness[j + 1] * (pull[j + 1] - beyond), stiffness[j + 1]};
        state.slip[j] = project(band[j], spool_side, tip_side, from[j]);
      }
    }
    for (int i = 0; i <= n; ++i) {
      const S before = i > 0 ? state.slip[i - 1] : S(0);
      const S beyond = i < n ? state.slip[i] : y;
      const S tension =
          i > 0 ? rest_tension + stiffness[i] * (pull[i] + before - beyond) : spool.at_rest - spool.stiffness * beyond;
      state.slack[i] = tension < S(0);
      state.tension[i] = larger(tension, S(0));
    }
    for (int j = 0; j < n; ++j) {
      const S slipped = state.slip[j] - from[j];
      state.slide[j] = slipped > S(0) ? Slide::toward_spool : slipped < S(0) ? Slide::toward_tip : Slide::none;
      if (band[j].free()) state.slide[j] = Slide::toward_spool;
    }
  }

  /// Largest violation of the friction law at any contact, N.
  S residual(const Bands& band, const Slips& from, const State& state) const {
    return residual(contacts(), band, from, state);
  }
  S residual(int n, const Bands& band, const Slips& from, const State& state) const {
    S worst(0);
    for (int j = 0; j < n; ++j) {
      const S spool = state.tension[j];
      const S tip = state.tension[j + 1];
      const S slipped = state.slip[j] - from[j];
      const auto beyond = [&](const S& pulled, const S& held, const S& by) {
        return pulled - (band[j].ratio * held + band[j].constant + band[j].drag * by);
      };
      const S to_spool = beyond(spool, tip, larger(slipped, S(0)));
      const S to_tip = beyond(tip, spool, larger(-slipped, S(0)));
      const S stuck = larger(larger(to_spool, to_tip), S(0));
      const S off = slipped > S(0) ? abs(to_spool) : slipped < S(0) ? abs(to_tip) : stuck;
      // Slip between two slack segments meets no friction.
      if (spool > S(0) || tip > S(0)) worst = larger(worst, off);
    }
    return worst;
  }

 private:
  /// Slip of a contact between two sides that react to it.
  static S project(const Band<S>& band, const Reaction<S>& spool, const Reaction<S>& tip, const S& from) {
    const S on_spool = larger(spool.at_rest - spool.stiffness * from, S(0));
    const S on_tip = larger(tip.at_rest + tip.stiffness * from, S(0));
    const bool to_spool = on_spool > band.ratio * on_tip + band.constant;
    const bool to_tip = on_tip > band.ratio * on_spool + band.constant;
    if (to_spool) {
      const S slip = (spool.at_rest - band.ratio * tip.at_rest - band.constant + band.drag * from) /
                     (spool.stiffness + band.ratio * tip.stiffness + band.drag);
      if (tip.at_rest + tip.stiffness * slip >= S(0)) return slip;
      return (spool.at_rest - band.constant + band.drag * from) / (spool.stiffness + band.drag);
    }
    if (to_tip) {
      const S slip = (band.ratio * spool.at_rest - tip.at_rest + band.constant + band.drag * from) /
                     (band.ratio * spool.stiffness + tip.stiffness + band.drag);
      if (spool.at_rest - spool.stiffness * slip >= S(0)) return slip;
      return (-tip.at_rest + band.constant + band.drag * from) / (tip.stiffness + band.drag);
    }
    return from;
  }

  static Flag<S> slack_after(const State& state, int i, const S& tolerance) {
    return where(state.slack[i], Flag<S>(state.tension[i] <= tolerance), Flag<S>(state.tension[i] < -tolerance));
  }

  using Slides = SideBySide<S>::template Choice<Slide>;
  static Slides slide_of(const Band<S>& band, const S& spool, const S& tip, const S& slipped, const S& tolerance,
                         const Slides& slide) {
    constexpr Slide none = Slide::none, to_spool = Slide::toward_spool, to_tip = Slide::toward_tip;
    if constexpr (std::is_same_v<Flag<S>, bool>) {
      // The same as below, with no more compared than is needed.
      if (band.free()) return to_spool;
      if (band.constant == S(0) && spool <= tolerance && tip <= tolerance) return slide;
      if (slide != none) return (slide == to_spool ? slipped < S(0) : slipped > S(0)) ? none : slide;
      if (spool > band.ratio * tip + band.constant + tolerance) return to_spool;
      return tip > band.ratio * spool + band.constant + tolerance ? to_tip : none;
    }
    // The slip of a slack tendon is rounding, and any direction of it is right.
    const Flag<S> as_before = band.constant == S(0) && spool <= tolerance && tip <= tolerance;
    const Flag<S> back = (slide == to_spool && slipped < S(0)) || (slide == to_tip && slipped > S(0));
    const Slides pushed =
        where(Flag<S>(tip > band.ratio * spool + band.constant + tolerance), Slides(to_tip), Slides(none));
    const Slides moved = where(Flag<S>(spool > band.ratio * tip + band.constant + tolerance), Slides(to_spool), pushed);
    const Slides held = where(Flag<S>(slide == none), moved, where(back, Slides(none), slide));
    return where(band.free(), Slides(to_spool), where(as_before, slide, held));
  }
};

/// Solves a tendon with given ends, over its first n contacts: the last segment's end is displaced by pull, the spool's
/// end reacts.
///
/// Returns the number of passes, or most_sweeps + 1 if every guess was contradicted and the state is a relaxed one.
template <class S, class Rows>
int settle(const Tendon<S, Rows>& tendon, int n, const typename Tendon<S, Rows>::Bands& band,
           const typename Tendon<S, Rows>::Lengths& pull, const Reaction<S>& spool, const S& tolerance,
           TendonState<S, Rows>& state, typename Tendon<S, Rows>::Line& line) {
  const int most = most_sweeps(n);
  const auto from = state.slip;
  for (int sweep = 1; sweep <= most; ++sweep) {
    tendon.eliminate(n, band, spool, pull, from, state, line);
    tendon.substitute(n, spool, pull, line, S(0), state);
    const int places = sweep <= joint_sweeps ? n * 2 + 1 : 1;
    if (tendon.revise(n, band, from, tolerance, state, places) == 0) return sweep;
    if (sweep <= joint_sweeps && sweep % hasty_sweeps == 0) tendon.relax(band, spool, pull, S(0), from, state, n);
  }
  tendon.relax(band, spool, pull, S(0), from, state, n);
  return most + 1;
}

/// The same over all of them.
template <class S, class Rows>
int settle(const Tendon<S, Rows>& tendon, const typename Tendon<S, Rows>::Bands& band,
           const typename Tendon<S, Rows>::Lengths& pull, const Reaction<S>& spool, const S& tolerance,
           TendonState<S, Rows>& state, typename Tendon<S, Rows>::Line& line) {
  return settle(tendon, tendon.contacts(), band, pull, spool, tolerance, state, line);
}

/// Tension beyond one contact, N: constant while the contact sticks, on the band's edge while it slides.
///
/// pulled: the present tension on the near side; held: the previous tension beyond.
template <class S>
S transmit(const Band<S>& band, const S& pulled, const S& held) {
  return clamp(held, larger((pulled - band.constant) / band.ratio, S(0)), pulled * band.ratio + band.constant);
}

}  // namespace tenodesis

#pragma once
// A chain: joints one after another, or side by side as jaws are, held by tendons that may cross several of them.
//
// Every joint turns by half its angle, moves along its chord, and turns by the other half, as in kinematics.hpp. Its
// coordinate x is the one of joint.hpp, in which the excursion of every tendon is linear: what a tendon is drawn by is
// the sum of arm times x over the joints that it crosses.
//
// An arc that bends in two planes is two joints, the second within the first: half of the first, half of the second,
// the chord, and the other halves the other way round. That is an arc without torsion: its rotation has no part about
// the axis half-way between its ends, and its chord lies in the plane in which it bends.

#include <cstdint>

#include "tenodesis/chain_layout.hpp"
#include "tenodesis/stretch_curve.hpp"

namespace tenodesis {

/// Most joints of a chain whose loops over them are written out when it is compiled.
inline constexpr int most_unrolled = 4;

/// A spring between two joints, relaxed where the angle of one is a ratio times that of the other.
template <class S>
struct Tie {
  S ratio{};
  S stiffness{};    ///< moment by the difference of the angles, N m/rad
  int to{-1};       ///< the other joint, which comes before; -1: there is no tie
  bool is_rigid{};  ///< whether it stands for parts that cannot yield
};

/// A joint of a chain, in the frame of the link before it: z along the straight joint toward the tip.
template <class S>
struct ChainJoint {
  Mechanism mechanism{};
  bool within{};     ///< whether it bends, about an axis across, what the joint before it bends; its chord is then 1
  int parent{-1};    ///< the joint that it stands on; -1: the stem
  Vector<S> axis{};  ///< unit vector; a positive angle turns about it
  S offset{};        ///< from the far end of the joint that it stands on, m
  S chord{};         ///< of the straight joint: between a gear pair's centres, or a backbone's length, m
  S length{};        ///< from its far end to where its wrench acts, m
  S stiffness{};     ///< of its own spring, N m/rad
  S hardening{};     ///< moment of the spring by the cube of the angle, N m/rad^3
  Tie<S> tie{};      ///< to a joint before it
  S share{};         ///< of the wrench that acts at its end
  S grip{};          ///< moment about its axis by a unit of grip force, m
};

/// Force and moment on the tip: N and N m, in the tip's axes, or in the stem's.
template <class S>
struct Wrench {
  Vector<S> force{};
  Vector<S> moment{};
};

/// Components of a load: force, moment, grip.
inline constexpr int load_components = 7;

template <class S>
struct ChainLoad {
  Wrench<S> wrench{};
  S grip{};             ///< force that presses the jaws apart, as an object between them does, N
  bool in_stem_axes{};  ///< whether the wrench keeps its direction while the tip turns
};

/// The constants of a chain of N joints and at most M tendons; a tendon that is not there has no stiffness.
///
/// of: its layout (chain_layout.hpp), if that is known when this is compiled; the numbers below say the same then.
template <class Scalar, int N, int M, auto of = UnknownLayout{}>
struct TendonChain {
  using S = Scalar;
  static constexpr int joints = N;
  static constexpr int tendons = M;
  static constexpr auto layout = of;
  static constexpr bool known = of.known;

  ChainJoint<S> joint[N]{};  ///< each after the one that it stands on
  S arm[M][N]{};             ///< tendon drawn by a unit of each coordinate, m
  S stiffness[M]{};          ///< of each tendon, at rest if it grows, N/m
  S pretension[M]{};         ///< at rest, N
  bool motor[M]{};           ///< whether a spool winds the tendon
  int handles{};             ///< joints of the handle, at most N
  Mechanism handle[N]{};
  S handle_arm[M][N]{};  ///< tendon wound by a unit of each of the handle's coordinates, m
  /// Growth of the tendons' stiffness with tension; none where the layout is known.
  struct Curves {
    StretchCurve<S> at[known ? 1 : M]{};
  };
  struct NoCurves {};
  [[no_unique_address]] std::conditional_t<known, NoCurves, Curves> curves{};

  /// Mechanism of a joint, of the handle from N on.
  constexpr Mechanism mechanism(int g) const {
    if constexpr (known)
      return layout.mechanism[g];
    else
      return g < N ? joint[g].mechanism : handle[g - N];
  }
  /// The joint that a joint stands on; -1: the stem.
  constexpr int parent(int i) const {
    if constexpr (known)
      return i - 1;
    else
      return joint[i].parent;
  }
  /// The axis of a joint, as a direction where that is known; its number is then a constant.
  template <class T, class I>
  constexpr auto axis(I i) const {
    const auto& at = joint[i].axis;
    if constexpr (!known)
      return Vector<T>{T(at.x), T(at.y), T(at.z)};
    else if constexpr (layout.axis[I::value] == Along::x)
      return Direction<T, Along::x>{T(at.x)};
    else
      return Direction<T, Along::y>{T(at.y)};
  }
  /// Calls f with the number of every joint, from the stem outward; as a constant where that saves time.
  template <class F>
  [[gnu::always_inline]] static constexpr void each_joint(const F& f) {
    if constexpr (known || N <= most_unrolled)
      each<N>(f);
    else
      for (int i = 0; i < N; ++i) f(i);
  }
  /// The same toward the stem.
  template <class F>
  [[gnu::always_inline]] static constexpr void each_joint_inward(const F& f) {
    if constexpr (known || N <= most_unrolled)
      each<N>([&](auto from_end) { f(std::integral_constant<int, N - 1 - decltype(from_end)::value>{}); });
    else
      for (int i = N - 1; i >= 0; --i) f(i);
  }
  /// Whether a joint bends within the one before it, or the one after it bends within this.
  constexpr bool is_within(int i) const { return !known && i > 0 && joint[i].within; }
  constexpr bool is_around(int i) const { return !known && i + 1 < N && joint[i + 1].within; }
  /// Joint i bent to a coordinate.
  template <class T>
  constexpr Bend<T> bend(int i, const T& x) const {
    return {mechanism(i), joint[i].chord, x};
  }

  /// Whether any joints are tied.
  constexpr bool has_ties() const {
    bool any = false;
    each_tie([&](int, const Tie<S>&) { any = true; });
    return any;
  }
  /// Calls f with every joint that is tied and its tie.
  template <class F>
  constexpr void each_tie(const F& f) const {
    if constexpr (!known)
      for (int i = 0; i < N; ++i)
        if (joint[i].tie.to >= 0) f(i, joint[i].tie);
  }
  /// Adds the moments of the joints' springs at angles (rad) to moments, N m.
  template <class T>
  constexpr void add_springs(const T* angle, T* moment) const {
    for (int i = 0; i < N; ++i) moment[i] = moment[i] - spring(i, angle[i]);
    add_ties(angle, moment);
  }
  /// Moment of a joint's spring at an angle (rad), N m, and its rate.
  template <class T>
  constexpr T spring(int i, const T& angle) const {
    if constexpr (known) return T(joint[i].stiffness) * angle;
    return (T(joint[i].stiffness) + T(joint[i].hardening) * angle * angle) * angle;
  }
  template <class T>
  constexpr T spring_rate(int i, const T& angle) const {
    if constexpr (known) return T(joint[i].stiffness);
    return T(joint[i].stiffness) + T(3) * T(joint[i].hardening) * angle * angle;
  }
  /// The same of the ties alone.
  template <class T>
  constexpr void add_ties(const T* angle, T* moment) const {
    each_tie([&](int i, const Tie<S>& tie) {
      const T ratio(tie.ratio), pull = T(tie.stiffness) * (angle[i] - ratio * angle[tie.to]);
      moment[i] = moment[i] - pull;
      moment[tie.to] = moment[tie.to] + ratio * pull;
    });
  }
  /// Adds a factor times the rates of the ties' moments by the angles to those of the joints.
  template <class T, class Rates>
  constexpr void add_tie_rates(const T& factor, Rates& rate) const {
    each_tie([&](int i, const Tie<S>& tie) {
      const T ratio(tie.ratio), by = factor * T(tie.stiffness);
      rate[i][i] = rate[i][i] - by;
      rate[i][tie.to] = rate[i][tie.to] + ratio * by;
      rate[tie.to][i] = rate[tie.to][i] + ratio * by;
      rate[tie.to][tie.to] = rate[tie.to][tie.to] - ratio * ratio * by;
    });
  }

  /// Length by which handle angles (rad) and strokes of the motors (m) wind each tendon, m.
  template <class T>
  void wind(const T* handle_angle, const T* stroke, T* wound) const {
    for (int m = 0; m < M; ++m) wound[m] = stroke[m];
    for (int h = 0; h < handles; ++h) {
      const T y = coordinate_at(handle[h], handle_angle[h]);
      for (int m = 0; m < M; ++m) wound[m] = wound[m] + T(handle_arm[m][h]) * y;
    }
  }

  /// Length by which the tip draws each tendon at coordinates x, m.
  template <class T>
  void excursions(const T* x, T* excursion) const {
    for (int m = 0; m < M; ++m) {
      excursion[m] = T(arm[m][0]) * x[0];
      for (int i = 1; i < N; ++i) excursion[m] = excursion[m] + T(arm[m][i]) * x[i];
    }
  }

  /// Tension of a tendon that the handle and its motor have drawn by wound, and the tip by drawn, m; negative where it
  /// would have to push.
  template <class T>
  T stretched(int m, const T& wound, const T& excursion) const {
    const T linear = T(pretension[m]) + T(stiffness[m]) * (wound - excursion);
    if constexpr (std::is_same_v<T, S>)
      if (grows(m)) return tension_at(m, linear);
    return linear;
  }
  /// Whether the stiffness of a tendon grows.
  bool grows(int m) const {
    if constexpr (known)
      return false;
    else
      return curves.at[m].entries > 0;
  }
  /// Whether all tendons and springs are linear.
  bool is_linear() const {
    bool linear = true;
    for (int m = 0; m < M; ++m) linear = linear && !grows(m);
    for (int i = 0; i < N; ++i) linear = linear && joint[i].hardening == S(0);
    return linear;
  }
  /// Tension of a tendon that a stretch gives, counted as the tension that the stiffness at rest would give, N.
  S tension_at(int m, const S& linear) const {
    if constexpr (!known)
      if (grows(m)) return curves.at[m].tension_at(linear);
    return linear;
  }
  /// The inverse.
  S linear_at(int m, const S& tension) const {
    if constexpr (!known)
      if (grows(m)) return curves.at[m].stretch_at(tension);
    return tension;
  }
  /// Twice the energy of a tendon of a unit of stiffness at rest, stretched from no tension to one, N^2.
  S twice_energy(int m, const S& tension) const {
    if constexpr (!known)
      if (grows(m)) return S(2) * curves.at[m].energy_at(tension);
    return tension * tension;
  }
  /// Stiffness of a tendon at a tension, over that at rest.
  S growth_at(int m, const S& tension) const {
    if constexpr (!known)
      if (grows(m)) return curves.at[m].ratio_at(tension);
    return S(1);
  }

  /// Whether every joint stands on the one before it, and none bends within another.
  constexpr bool is_serial() const {
    for (int i = 0; i < N; ++i)
      if (joint[i].parent != i - 1 || joint[i].within) return false;
    return true;
  }

  /// Moments of a load about every joint in the direction of its angle, by virtual work, N m, and their rates by the
  /// angles, N m/rad, unless these are not asked for.
  ///
  /// serial: the joints stand one on another, and the wrench turns with the tip; all places are then known when this is
  /// compiled, and numbers stay in registers.
  template <bool serial = false, bool rates = true, class T>
  [[gnu::always_inline]] constexpr void load_moments(const Bend<T>* bend, const ChainLoad<T>& load, T* moment,
                                                     T (*rate)[N]) const {
    if constexpr (known && !serial)
      if (!load.in_stem_axes) return load_moments<true, rates>(bend, load, moment, rate);
    // At the far end of every joint, in its axes: the wrench, and its rates by the angles of the joints beyond.
    Wrench<T> at[N]{};
    Wrench<T> by[N][N]{};
    std::uint64_t beyond[N]{};
    const bool turns = !serial && load.in_stem_axes;
    if (turns) turn_with_stem(bend, load.wrench, at, by, beyond);
    each_joint([&](int i) {
      const T share(joint[i].share);
      const Wrench<T>& own = turns ? at[i] : load.wrench;
      at[i] = shared(own, share, T(joint[i].length));
      if (!rates || !turns) return;
      for (int j = 0; j <= i; ++j) by[i][j] = shared(by[i][j], share, T(joint[i].length));
    });
    each_joint_inward([&](auto i) {
      if (is_around(i)) return;
      if constexpr (!known && N > 1)
        if (is_within(i)) {
          load_pair_moments<rates>(i, bend, load.grip, turns, at, by, beyond, moment, rate);
          return;
        }
      const auto& on = joint[i];
      const auto axis = this->template axis<T>(i);
      const auto& given = given_axis<T>(i, axis);
      const Bend<T>& bent = bend[i];
      const auto pass = [&](const Wrench<T>& far, T& about) {
        Wrench<T> mid{bent.inward(given, far.force), bent.inward(given, far.moment)};
        mid.moment = mid.moment + bent.chord * along(mid.force);
        about = T(0.5) * (dot(axis, far.moment) + dot(axis, mid.moment)) + bent.chord_rate * mid.force.z;
        return mid;
      };
      const auto near = [&](const Wrench<T>& mid) {
        return Wrench<T>{bent.inward(given, mid.force), bent.inward(given, mid.moment)};
      };
      const int parent = serial ? i - 1 : this->parent(i);
      const Wrench<T> mid = pass(at[i], moment[i]);
      moment[i] = moment[i] + T(on.grip) * load.grip;
      const Wrench<T> whole = near(mid);
      if (parent >= 0) hand_on(T(on.offset), at[parent], whole);
      if constexpr (!rates) return;
      // By its own angle: both halves turn, and the chord changes.
      Wrench<T> own{};
      rate[i][i] = T(0);
      if (turns) own = pass(by[i][i], rate[i][i]);
      const Vector<T> force_rate = T(0.5) * cross(axis, mid.force);
      own.force = own.force + force_rate;
      const Vector<T> moment_rate = T(0.5) * cross(axis, mid.moment - bent.chord * along(mid.force)) +
                                    bent.chord_rate * along(mid.force) + bent.chord * along(force_rate);
      own.moment = own.moment + moment_rate;
      rate[i][i] = rate[i][i] + T(0.5) * dot(axis, moment_rate) + bent.chord_curve * mid.force.z +
                   bent.chord_rate * force_rate.z;
      own = near(own);
      own.force = own.force + T(0.5) * cross(axis, whole.force);
      own.moment = own.moment + T(0.5) * cross(axis, whole.moment);
      if (parent >= 0) {
        hand_on(T(on.offset), by[parent][i], own);
        beyond[parent] |= beyond[i] | std::uint64_t(1) << i;
      }
      each_joint([&](int j) {
        if (j == i) return;
        rate[i][j] = T(0);
        if (serial ? j < i : (beyond[i] >> j & 1u) == 0) return;
        const Wrench<T> turned = near(pass(by[i][j], rate[i][j]));
        if (parent >= 0) hand_on(T(on.offset), by[parent][j], turned);
      });
    });
  }

  /// Moments about every joint by a unit of each component of a load in the tip's axes: forces, moments, grip.
  template <class T>
  constexpr void load_rows(const Bend<T>* bend, T (*row)[load_components]) const {
    // As of load_moments, for a force along each axis; a moment along it turns as that force does.
    Wrench<T> at[N][3];
    for (int i = 0; i < N; ++i) {
      const T share(joint[i].share), lever = T(joint[i].length) * share, none(0);
      at[i][0] = {{share, none, none}, {none, lever, none}};
      at[i][1] = {{none, share, none}, {-lever, none, none}};
      at[i][2] = {{none, none, share}, {}};
      row[i][6] = T(joint[i].grip);
    }
    for (int i = N - 1; i >= 0; --i) {
      if (is_around(i)) continue;
      const Vector<S>& given = joint[i].axis;
      if constexpr (!known && N > 1)
        if (is_within(i)) {
          const Pair<T> pair(*this, bend, i);
          for (int k = 0; k < 3; ++k) {
            const auto passed = pair.inward(at[i][k]);
            row[i - 1][k] = passed.about_outer;
            row[i][k] = passed.about_inner;
            row[i - 1][3 + k] = T(0.5) * (dot(pair.outer, passed.first.force) + dot(pair.outer, passed.last.force));
            row[i][3 + k] = dot(pair.inner, passed.middle.force);
            if (parent(i - 1) >= 0) hand_on(T(joint[i - 1].offset), at[parent(i - 1)][k], passed.near);
          }
          continue;
        }
      if (given.x == S(0) && given.z == S(0))
        pass_units(i, bend[i], Direction<T, Along::y>{T(given.y)}, at, row);
      else if (given.y == S(0) && given.z == S(0))
        pass_units(i, bend[i], Direction<T, Along::x>{T(given.x)}, at, row);
      else
        pass_units(i, bend[i], Vector<T>{T(given.x), T(given.y), T(given.z)}, at, row);
    }
  }

 private:
  template <class T, class Axis>
  constexpr void pass_units(int i, const Bend<T>& bent, const Axis& axis, Wrench<T> (*at)[3],
                            T (*row)[load_components]) const {
    const auto inward = [&](const Wrench<T>& w) {
      return Wrench<T>{turned(axis, w.force, bent.sine, bent.cosine), turned(axis, w.moment, bent.sine, bent.cosine)};
    };
    for (int k = 0; k < 3; ++k) {
      const Wrench<T>& far = at[i][k];
      Wrench<T> mid = inward(far);
      mid.moment = mid.moment + bent.chord * along(mid.force);
      row[i][k] = T(0.5) * (dot(axis, far.moment) + dot(axis, mid.moment)) + bent.chord_rate * mid.force.z;
      row[i][3 + k] = dot(axis, mid.force);
      if (parent(i) >= 0) hand_on(T(joint[i].offset), at[parent(i)][k], inward(mid));
    }
  }

  // Two joints, i within the one before it, as load_moments has them one by one.
  template <bool rates, class T>
  [[gnu::noinline]] constexpr void load_pair_moments(int i, const Bend<T>* bend, const T& grip, bool turns,
                                                     Wrench<T>* at, Wrench<T> (*by)[N], std::uint64_t* beyond,
                                                     T* moment, T (*rate)[N]) const {
    const int o = i - 1;
    const Pair<T> pair(*this, bend, i);
    const auto whole = pair.inward(at[i]);
    moment[o] = whole.about_outer + T(joint[o].grip) * grip;
    moment[i] = whole.about_inner + T(joint[i].grip) * grip;
    const int on = parent(o);
    const T offset(joint[o].offset);
    if (on >= 0) hand_on(offset, at[on], whole.near);
    if constexpr (!rates) return;
    for (int j = 0; j < N; ++j) {
      rate[o][j] = rate[i][j] = T(0);
      const bool is_own = j == o || j == i;
      if (!is_own && (beyond[i] >> j & 1u) == 0) continue;
      typename Pair<T>::Passed turned{};
      if (!is_own || turns) turned = pair.inward(by[i][j]);
      if (is_own) turned = turned + pair.rate_of(whole, j == o);
      rate[o][j] = turned.about_outer;
      rate[i][j] = turned.about_inner;
      if (on >= 0) hand_on(offset, by[on][j], turned.near);
    }
    if (on >= 0) beyond[on] |= beyond[i] | std::uint64_t(3) << o;
  }

  // Hands the wrench at a joint's near end on to the far end of what it stands on.
  template <class T>
  static constexpr void hand_on(const T& offset, Wrench<T>& to, const Wrench<T>& from) {
    to.force = to.force + from.force;
    to.moment = to.moment + from.moment + offset * along(from.force);
  }

  // A joint within the one before it.
  template <class T>
  struct Pair {
    const T chord;
    const Vector<T> outer, inner;
    const Vector<S>&outer_given, &inner_given;  // as a bent joint asks for them
    const Bend<T>&around, &inside;

    constexpr Pair(const TendonChain& chain, const Bend<T>* bend, int i)
        : chord(bend[i - 1].chord * bend[i].chord),
          outer(chain.template axis<T>(i - 1)),
          inner(chain.template axis<T>(i)),
          outer_given(chain.joint[i - 1].axis),
          inner_given(chain.joint[i].axis),
          around(bend[i - 1]),
          inside(bend[i]) {}

    /// What passes both joints from their far end: the wrench where the far half of the outer joint ends, the middle
    /// before and after the chord, where the near half of the inner begins, and the near end; and moments about both.
    struct Passed {
      Wrench<T> first{}, before{}, middle{}, last{}, near{};
      T about_outer{}, about_inner{};

      friend constexpr Passed operator+(Passed a, const Passed& b) {
        a.near = {a.near.force + b.near.force, a.near.moment + b.near.moment};
        a.about_outer = a.about_outer + b.about_outer;
        a.about_inner = a.about_inner + b.about_inner;
        return a;
      }
    };

    constexpr Passed inward(const Wrench<T>& far) const {
      Passed at;
      at.first = turned(around, outer_given, far);
      at.before = turned(inside, inner_given, at.first);
      at.middle = at.before;
      at.middle.moment = at.middle.moment + chord * along(at.before.force);
      at.last = turned(inside, inner_given, at.middle);
      at.near = turned(around, outer_given, at.last);
      const T& pull = at.before.force.z;
      at.about_outer = T(0.5) * (dot(outer, at.first.moment) + dot(outer, at.last.moment)) + rate(true) * pull;
      at.about_inner = T(0.5) * (dot(inner, at.before.moment) + dot(inner, at.middle.moment)) + rate(false) * pull;
      return at;
    }

    /// Rates of the same by the angle of the outer joint or the inner, the wrench at the far end as it is.
    constexpr Passed rate_of(const Passed& at, bool of_outer) const {
      Passed by;
      const auto spun = [](const Vector<T>& axis, const Wrench<T>& w) {
        return Wrench<T>{T(0.5) * cross(axis, w.force), T(0.5) * cross(axis, w.moment)};
      };
      if (of_outer) by.first = spun(outer, at.first);
      by.before = turned(inside, inner_given, by.first);
      if (!of_outer) by.before = spun(inner, at.before);
      by.middle = by.before;
      by.middle.moment = by.middle.moment + rate(of_outer) * along(at.before.force) + chord * along(by.before.force);
      by.last = turned(inside, inner_given, by.middle);
      if (!of_outer) {
        const Wrench<T> own = spun(inner, at.last);
        by.last = {by.last.force + own.force, by.last.moment + own.moment};
      }
      by.near = turned(around, outer_given, by.last);
      if (of_outer) {
        const Wrench<T> own = spun(outer, at.near);
        by.near = {by.near.force + own.force, by.near.moment + own.moment};
      }
      const T mixed = around.chord_rate * inside.chord_rate;
      const T& pull = at.before.force.z;
      const T& more = by.before.force.z;
      by.about_outer = T(0.5) * (dot(outer, by.first.moment) + dot(outer, by.last.moment)) + rate(true) * more +
                       (of_outer ? around.chord_curve * inside.chord : mixed) * pull;
      by.about_inner = T(0.5) * (dot(inner, by.before.moment) + dot(inner, by.middle.moment)) + rate(false) * more +
                       (of_outer ? mixed : around.chord * inside.chord_curve) * pull;
      return by;
    }

    /// A wrench at the near end, at the far one.
    constexpr Wrench<T> outward(const Wrench<T>& near) const {
      return back(around, outer_given,
                  back(inside, inner_given, back(inside, inner_given, back(around, outer_given, near))));
    }
    /// Its rate by an angle, the wrench at the near end as it is.
    constexpr Wrench<T> outward_rate(const Wrench<T>& near, const Wrench<T>& far, bool of_outer) const {
      const auto spun = [](const T& share, const Vector<T>& axis, const Wrench<T>& w) {
        return Wrench<T>{-share * cross(axis, w.force), -share * cross(axis, w.moment)};
      };
      const Wrench<T> first = back(around, outer_given, near);
      if (!of_outer)
        return back(around, outer_given,
                    spun(T(1), inner, back(inside, inner_given, back(inside, inner_given, first))));
      const Wrench<T> begun =
          back(around, outer_given, back(inside, inner_given, back(inside, inner_given, spun(T(0.5), outer, first))));
      const Wrench<T> ended = spun(T(0.5), outer, far);
      return {begun.force + ended.force, begun.moment + ended.moment};
    }

   private:
    constexpr T rate(bool of_outer) const {
      return of_outer ? around.chord_rate * inside.chord : around.chord * inside.chord_rate;
    }
    static constexpr Wrench<T> turned(const Bend<T>& by, const Vector<S>& axis, const Wrench<T>& w) {
      return {by.inward(axis, w.force), by.inward(axis, w.moment)};
    }
    static constexpr Wrench<T> back(const Bend<T>& by, const Vector<S>& axis, const Wrench<T>& w) {
      return {by.outward(axis, w.force), by.outward(axis, w.moment)};
    }
  };

  // A wrench in the stem's axes, in those of every joint's far end; its rates by the angles that turn these.
  template <class T>
  constexpr void turn_with_stem(const Bend<T>* bend, const Wrench<T>& wrench, Wrench<T>* at, Wrench<T> (*by)[N],
                                std::uint64_t* before) const {
    each_joint([&](auto i) {
      const int on = parent(i);
      const Wrench<T>& base = on < 0 ? wrench : at[on];
      for (int j = on; j >= 0; j = parent(j)) before[i] |= std::uint64_t(1) << j;
      if (is_around(i)) {
        // The joint within it turns for both.
        at[i] = base;
        for (int j = 0; j < i && on >= 0; ++j) by[i][j] = by[on][j];
        return;
      }
      if constexpr (!known && N > 1)
        if (is_within(i)) {
          const Pair<T> pair(*this, bend, i);
          at[i] = pair.outward(base);
          for (int j = 0; j < i - 1; ++j) by[i][j] = pair.outward(by[on][j]);
          by[i][i - 1] = pair.outward_rate(base, at[i], true);
          by[i][i] = pair.outward_rate(base, at[i], false);
          return;
        }
      const auto axis = this->template axis<T>(i);
      const auto outward = [&](const Wrench<T>& w) {
        const auto turned = [&](const Vector<T>& v) {
          const auto& given = given_axis<T>(i, axis);
          return bend[i].outward(given, bend[i].outward(given, v));
        };
        return Wrench<T>{turned(w.force), turned(w.moment)};
      };
      at[i] = outward(base);
      for (int j = 0; j < i && on >= 0; ++j) by[i][j] = outward(by[on][j]);
      by[i][i] = {T(-1) * cross(axis, at[i].force), T(-1) * cross(axis, at[i].moment)};
    });
  }

  // The axis of joint i as a bent joint asks for it: where it is unknown, in the chain's own numbers.
  template <class T, class Axis>
  constexpr const auto& given_axis(int i, const Axis& axis) const {
    if constexpr (known)
      return axis;
    else
      return joint[i].axis;
  }

  // The share of a wrench that acts at a joint's end, at its far end.
  template <class T>
  static constexpr Wrench<T> shared(const Wrench<T>& wrench, const T& share, const T& length) {
    const Vector<T> force = share * wrench.force;
    return {force, share * wrench.moment + length * along(force)};
  }

  // z cross v: the moment of a force at a unit of length beyond.
  template <class T>
  static constexpr Vector<T> along(const Vector<T>& v) {
    return {-v.y, v.x, T(0)};
  }
};

}  // namespace tenodesis

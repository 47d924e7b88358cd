#pragma once
// Angles of all joints from the drive end of all tendons, for any routing.
//
// Each tendon's tension is followed from the spool from contact to contact, as far_end.hpp does with one tendon: a
// contact that slips has the tension beyond it on the edge of its band, one that sticks holds it inside. The stretch
// that these tensions make, less what spool and handle have wound, is the length that the joints have drawn: one
// equation a taut tendon. The balance of each joint, of its tendons' moments, its spring and the load, is another one.
// Unknown are the angles and errors of friction and stiffness that all tendons share, each with what is known of it
// beforehand; weighted least squares about the last estimate gives them together. The load at the tip, of which its
// size is known beforehand, makes the balances uncertain; what is left of them gives the load. What the sensors do not
// determine is in the covariance.

#include "tenodesis/chain_statics.hpp"
#include "tenodesis/far_end.hpp"
#include "tenodesis/route.hpp"

namespace tenodesis {

/// Square root of a definite matrix of K rows: lower triangular, the inverse of its diagonal in the diagonal's place.
template <class S, int K>
struct Root {
  Square<S, K> lower{};

  /// In the place of the matrix, of which the lower half is read; least: bounds of the pivots from below, which keep it
  /// definite whatever is rounded. False where a pivot vanishes.
  bool take(const S* least) {
    auto& at = lower.at;
    for (int k = 0; k < K; ++k) {
      S pivot = at[k][k];
      for (int j = 0; j < k; ++j) pivot = pivot - at[k][j] * at[k][j];
      if (!tenodesis::is_finite(pivot)) return false;
      pivot = larger(pivot, least[k]);
      if (!(pivot > S(0))) return false;
      at[k][k] = S(1) / sqrt(pivot);
      for (int i = k + 1; i < K; ++i) {
        S sum = at[i][k];
        for (int j = 0; j < k; ++j) sum = sum - at[i][j] * at[k][j];
        at[i][k] = sum * at[k][k];
      }
    }
    return true;
  }
  /// Divides columns, of a matrix with so many, by the root.
  template <int columns>
  void divide(S (*rows)[columns]) const {
    for (int i = 0; i < K; ++i) {
      for (int j = 0; j < i; ++j)
        for (int c = 0; c < columns; ++c) rows[i][c] = rows[i][c] - lower.at[i][j] * rows[j][c];
      for (int c = 0; c < columns; ++c) rows[i][c] = rows[i][c] * lower.at[i][i];
    }
  }
  /// Solves the matrix times x = right, in the place of right.
  void solve(S* right) const {
    for (int i = 0; i < K; ++i) {
      for (int j = 0; j < i; ++j) right[i] = right[i] - lower.at[i][j] * right[j];
      right[i] = right[i] * lower.at[i][i];
    }
    for (int i = K - 1; i >= 0; --i) {
      for (int j = i + 1; j < K; ++j) right[i] = right[i] - lower.at[j][i] * right[j];
      right[i] = right[i] * lower.at[i][i];
    }
  }
  /// In its own place its inverse, of which the lower half is written.
  void invert() {
    auto& at = lower.at;
    for (int i = 0; i < K; ++i)
      for (int j = 0; j < i; ++j) {
        S sum = at[i][j] * at[j][j];
        for (int k = j + 1; k < i; ++k) sum = sum + at[i][k] * at[k][j];
        at[i][j] = -at[i][i] * sum;
      }
  }
};

/// What the drive end of a chain of N joints and M tendons shows.
template <class S, int N, int M>
struct JointMeasurement {
  S handle_angle[N]{};  ///< rad
  S tension[M]{};       ///< beside the spools, N
  S spool_angle[M]{};   ///< from the pretension at straight joints, positive winds, rad
};

/// Deviations of what is known beforehand, and of the sensors.
template <class S>
struct JointDeviations {
  S tension{};    ///< of a tension's reading, N
  S length{};     ///< of a tendon's length, its spool's reading included, m
  S friction{};   ///< share of all friction
  S stiffness{};  ///< share of all tendons' stiffness
  S force{};      ///< of each component of the force at the tip, N
  S moment{};     ///< of each component of the moment at the tip, N m
  S grip{};       ///< N
  S imbalance{};  ///< moment of a joint that no load explains, N m
};

template <class S, int N, int M>
struct JointEstimate {
  S angle[N]{};               ///< rad
  Square<S, N> covariance{};  ///< of the angles, rad^2
  S moment[N]{};              ///< of the tendons about the joints, N m
  S load[load_components]{};  ///< force (N) and moment (N m) in the tip's axes, grip (N)
  S load_std[load_components]{};
  S friction_scale{1};  ///< over the friction that is assumed
  S friction_scale_std{};
  S far_tension[M]{};  ///< at the tendons' ends, N
  bool taut[M]{};
  S unexplained[M]{};  ///< tension that a tendon would have to have more, by its length, N
  S unexplained_std[M]{};
  bool valid{};  ///< false: a measurement is not finite, and the last estimate stands
};

/// Friction and stiffness as homing has found them.
template <class S, int M>
struct JointLearning {
  S scale[2]{};    ///< of friction and stiffness, beyond 1
  S weight[3]{};   ///< inverse of their covariance: friction, both, stiffness
  S tension[M]{};  ///< when these were last learned, N
};

template <class S, int N, int M, int contacts>
struct JointMemory {
  HeldTorque<S> contact[M][contacts]{};
  S handle_angle[N]{};  ///< without the steps of its encoder, rad
  JointLearning<S, M> learned{};
  bool started{};
  JointEstimate<S, N, M> estimate{};
};

/// Largest angles of joints that an estimate has, short of the mechanisms' limits, rad.
inline constexpr double most_angle = 0.98 * pi, most_gear_angle = 2.7409;
/// Least change of a tension, as a fraction of the pretension, after which friction and stiffness are learned again.
inline constexpr double least_change = 0.02;
/// Measurements of both in a homing that raises tensions by 0.6 of the pretension and lowers them again.
inline constexpr double measurements_of_homing = 2 * 0.6 / least_change;
/// Deviations that homing leaves of them at least: contacts differ, and a rope's compliance is not all along it alike.
inline constexpr double least_friction_std = 0.05, least_stiffness_std = 0.02;
/// Deviation of an angle before any tendon has been read, rad.
inline constexpr double prior_angle_std = 1.0;

/// Observer of a chain W whose tendons have at most so many contacts.
template <class W, int most_contacts>
struct JointObserver {
  using S = W::S;
  static constexpr int N = W::joints, M = W::tendons;
  static constexpr int unknowns = 2 + N;
  using Measured = JointMeasurement<S, N, M>;
  using Found = JointEstimate<S, N, M>;
  using Memory = JointMemory<S, N, M, most_contacts>;

  W chain{};
  Passage<S> passage[M][most_contacts]{};
  int contacts[M]{};                     ///< of each tendon; 0: there is no such tendon
  S compliance[M][most_contacts + 1]{};  ///< of each segment at rest, m/N
  ChosenLaw<S> law{};
  S sheath_bend_rate{};  ///< bend of the sheath by the angles of the handle
  S spool_radius{};      ///< m
  S play{};              ///< length by which a contact counts as slipping, m
  S handle_play{};       ///< by which that is larger from the handle's joints on, m
  S tension_play{};      ///< tension by whose stretch up to a contact that length is larger, N
  S smoothing{1};        ///< share of the handle's reading in that which contacts follow
  JointDeviations<S> deviations{};

  /// Estimate after a sample of the sensors; the memory keeps it. with_load: whether the load is in it, too; learns:
  /// whether friction and stiffness are learned from it.
  template <bool with_load = false>
  const Found& update(const Measured& measured, Memory& memory, bool learns = false) const {
    Found& now = memory.estimate;
    now.valid = is_finite(measured);
    if (!now.valid) return now;
    // Constant errors are the same in all measurements.
    const S alike = learns ? S(measurements_of_homing) : S(1);
    Equations equations;
    equations.of_cells = alike * square(deviations.tension);
    equations.of_lengths = alike * square(deviations.length);
    for (int h = 0; h < chain.handles; ++h) {
      S& smooth = memory.handle_angle[h];
      const S& read = measured.handle_angle[h];
      smooth = memory.started ? smooth + smoothing * (read - smooth) : read;
    }
    Joints joints(chain, measured, memory.handle_angle, now.angle, sheath_bend_rate);
    for (int m = 0; m < M; ++m)
      if (contacts[m] > 0) follow_tendon(m, measured, joints, memory, equations);
    memory.started = true;
    S least[unknowns];
    least[at_friction] = S(1) / square(deviations.friction);
    least[at_stiffness] = S(1) / square(deviations.stiffness);
    for (int i = 0; i < N; ++i) least[at_angle + i] = S(1) / square(S(prior_angle_std));
    auto& root = equations.root;
    for (int i = at_angle; i < unknowns; ++i) root.lower.at[i][i] = root.lower.at[i][i] + least[i];
    expect(memory.learned, equations);
    now.valid = add_balance(joints, equations) && root.take(least);
    if (!now.valid) return now;
    const S* const value = equations.right;
    root.solve(equations.right);
    root.invert();
    for (int i = 0; i < N; ++i) {
      const S most = chain.joint[i].mechanism == Mechanism::gear ? S(most_gear_angle) : S(most_angle);
      now.angle[i] = clamp(now.angle[i] + value[at_angle + i], -most, most);
      now.moment[i] = joints.moment[i] + joints.moment_by_friction[i] * value[at_friction];
      for (int j = 0; j <= i; ++j)
        now.covariance.at[i][j] = now.covariance.at[j][i] = covariance(root.lower, at_angle + i, at_angle + j);
    }
    if constexpr (with_load) add_load(equations, now);
    auto& learned = memory.learned;
    now.friction_scale = S(1) + learned.scale[0] + value[at_friction];
    now.friction_scale_std = sqrt(covariance(root.lower, at_friction, at_friction));
    if (learns && is_informative(measured, learned)) learn(root.lower, value, measured, learned);
    // A stiffness that the file does not admit explains nothing.
    const S softer = clamp(value[at_stiffness], S(-2) * deviations.stiffness, S(2) * deviations.stiffness);
    for (int m = 0; m < M; ++m) {
      if (contacts[m] == 0) continue;
      const auto& tendon = equations.tendon[m];
      S left = tendon.value;
      for (int j = 0; j < unknowns; ++j) left = left - tendon.row[j] * (j == at_stiffness ? softer : value[j]);
      now.unexplained[m] = left / tendon.soft;
      S variance = tendon.variance;
      // An equation that did not count gave no angles.
      for (int i = 0; i < N && !tendon.counts; ++i)
        for (int j = 0; j < N; ++j)
          variance = variance + tendon.row[at_angle + i] * now.covariance.at[i][j] * tendon.row[at_angle + j];
      now.unexplained_std[m] = sqrt(larger(variance, S(0))) / tendon.soft;
    }
    // What a single tendon leaves unexplained has its errors once.
    for (int m = 0; m < M && learns; ++m) {
      if (contacts[m] == 0) continue;
      const S own = square(now.unexplained_std[m]) -
                    S(1 - 1 / measurements_of_homing) *
                        (equations.of_cells + equations.of_lengths / square(equations.tendon[m].soft));
      now.unexplained_std[m] = sqrt(larger(own, S(0)));
    }
    return now;
  }

 private:
  static constexpr int at_friction = 0, at_stiffness = 1, at_angle = 2;

  // Weighted equations in shares of friction and stiffness and the changes of the angles.
  struct Equations {
    struct Tendon {
      S row[unknowns];
      S value, variance;
      S soft;  // m/N
      bool counts;
    };
    S of_cells, of_lengths;    // variances of the tendons' constant errors, N^2 and m^2
    Root<S, unknowns> root{};  // of the weights
    S right[unknowns]{};
    Tendon tendon[M];
    // Balance of the joints over its root of what load and tendons leave open: rows, then values; and the load's.
    S balance[N][unknowns + 1];
    S load[N][load_components];

    void add(const S* row, const S& value, const S& weight) {
      auto& at = root.lower.at;
      for (int i = 0; i < unknowns; ++i) {
        if (row[i] == S(0)) continue;
        const S by = weight * row[i];
        for (int j = 0; j <= i; ++j) at[i][j] = at[i][j] + by * row[j];
        right[i] = right[i] + by * value;
      }
    }
  };

  // Friction is linear about what was learned of it, stiffness about the file's.
  void expect(JointLearning<S, M>& learned, Equations& equations) const {
    auto& [scale, weight, tension] = learned;
    if (!(weight[0] > S(0))) {
      weight[0] = S(1) / square(deviations.friction);
      weight[2] = S(1) / square(deviations.stiffness);
    }
    auto& at = equations.root.lower.at;
    at[at_friction][at_friction] = at[at_friction][at_friction] + weight[0];
    at[at_stiffness][at_friction] = at[at_stiffness][at_friction] + weight[1];
    at[at_stiffness][at_stiffness] = at[at_stiffness][at_stiffness] + weight[2];
    equations.right[at_friction] = equations.right[at_friction] + weight[1] * scale[1];
    equations.right[at_stiffness] = equations.right[at_stiffness] + weight[2] * scale[1];
  }

  // Whether tensions have changed since the last measurement that counted: at the same ones errors are the same.
  bool is_informative(const Measured& measured, const JointLearning<S, M>& learned) const {
    bool changed = false;
    for (int m = 0; m < M; ++m) {
      const S least = S(least_change) * chain.pretension[m];
      changed = changed || (least > S(0) && abs(measured.tension[m] - learned.tension[m]) > least);
    }
    return changed;
  }

  // inverse: of the weights' root.
  void learn(const Square<S, unknowns>& inverse, const S* value, const Measured& measured,
             JointLearning<S, M>& learned) const {
    const S friction = larger(covariance(inverse, at_friction, at_friction), square(S(least_friction_std)));
    for (int m = 0; m < M; ++m) learned.tension[m] = measured.tension[m];
    const S stiffness = larger(covariance(inverse, at_stiffness, at_stiffness), square(S(least_stiffness_std)));
    const S both = covariance(inverse, at_stiffness, at_friction);
    const S by = S(1) / (friction * stiffness - square(both));
    const S weight[3]{by * stiffness, -by * both, by * friction};
    for (int k = 0; k < 3; ++k) learned.weight[k] = weight[k];
    const S most[2]{S(2) * deviations.friction, S(2) * deviations.stiffness};
    learned.scale[0] = clamp(learned.scale[0] + value[at_friction], -most[0], most[0]);
    learned.scale[1] = clamp(value[at_stiffness], -most[1], most[1]);
  }

  // Of two unknowns, by the inverse of the root.
  static S covariance(const Square<S, unknowns>& inverse, int i, int j) {
    S sum(0);
    for (int k = larger(i, j); k < unknowns; ++k) sum = sum + inverse.at[k][i] * inverse.at[k][j];
    return sum;
  }

  // Joints at the last estimate, and what tendons do to them.
  struct Joints {
    Bend<S> bend[N];
    S angle[N];  // of the tip
    S x[N];
    S y[N]{};           // of the handle
    S slow[N]{};        // likewise, without its encoder's steps
    S bent{};           // of the sheath by the handle's angles, rad
    S turned[2 * N]{};  // by which tendons wrap; the handle's joints from N on
    S moment[N]{};
    S moment_by_friction[N]{};
    S variance[N]{};
    // The last band in the sheaths and at every joint, which most tendons come past alike.
    struct {
      S exponent{-1}, share;
      Band<S> band;
    } last_band[2 * N + 1];

    Joints(const W& of, const Measured& measured, const S* smooth, const S* estimated, const S& bend_rate) {
      for (int i = 0; i < N; ++i) {
        angle[i] = estimated[i];
        x[i] = coordinate_at(of.joint[i].mechanism, angle[i]);
        bend[i] = Bend<S>(of.joint[i], x[i]);
        turned[i] = of.is_around(i) ? sqrt(square(angle[i]) + square(estimated[i + 1])) : angle[i];
      }
      for (int h = 0; h < of.handles; ++h) {
        turned[N + h] = measured.handle_angle[h];
        y[h] = coordinate_at(of.handle[h], turned[N + h]);
        slow[h] = coordinate_at(of.handle[h], smooth[h]);
        bent = bent + abs(turned[N + h]);
      }
      bent = bend_rate * bent;
    }
  };

  bool is_finite(const Measured& measured) const {
    bool finite = true;
    for (int h = 0; h < chain.handles; ++h) finite = finite && tenodesis::is_finite(measured.handle_angle[h]);
    for (int m = 0; m < M; ++m)
      if (contacts[m] > 0) finite = finite && all_finite(measured.tension[m], measured.spool_angle[m]);
    return finite;
  }

  S load_deviation(int k) const { return k < 3 ? deviations.force : k < 6 ? deviations.moment : deviations.grip; }

  S wrap_of(const Passage<S>& at, const Joints& joints) const {
    if (at.joint < 0) return larger(at.wrap + joints.bent * at.share, S(0));
    return wrap_at(at, joints.turned[at.joint]);
  }

  // Tensions along a tendon, its moments about the joints, and its equation.
  void follow_tendon(int m, const Measured& measured, Joints& joints, Memory& memory, Equations& equations) const {
    S tension = larger(measured.tension[m], S(0)), hidden(0), by_friction(0);
    S position = spool_radius * measured.spool_angle[m];
    S wound = position;  // by spool and handle
    S hidden_stretch(0), stretch_by_friction(0), stretched(0), total(0);
    const bool grows = chain.grows(m);
    const auto pass = [&](int i) {
      const S& at_rest = compliance[m][i];
      const S longer = at_rest * ((grows ? chain.linear_at(m, tension) : tension) - chain.pretension[m]);
      const S soft = grows ? at_rest / chain.growth_at(m, tension) : at_rest;
      position = position - longer;
      stretched = stretched + longer;
      total = total + soft;
      hidden_stretch = hidden_stretch + soft * hidden;
      stretch_by_friction = stretch_by_friction + soft * by_friction;
    };
    for (int h = 0; h < chain.handles; ++h) wound = wound + chain.handle_arm[m][h] * joints.y[h];
    const S scale = S(1) + memory.learned.scale[0];
    S slips = play;
    for (int j = 0; j < contacts[m]; ++j) {
      const Passage<S>& at = passage[m][j];
      pass(j);
      // A joint of the handle draws the segment before its last contact.
      if (at.joint >= N && at.arm != S(0)) {
        position = position + at.arm * joints.slow[at.joint - N];
        slips = play + handle_play;
      }
      const S wrap = wrap_of(at, joints);
      const S known = at.coefficient * wrap, exponent = scale * known;
      auto& [of, share_of, band] = joints.last_band[at.joint + 1];
      if (of != exponent || share_of != at.share || law.kind == ChosenLaw<S>::Kind::capstan_power) {
        of = exponent;
        share_of = at.share;
        band = band_of(law, exponent, wrap, at, S(0), tension);
      }
      auto& contact = memory.contact[m][j];
      const S low = larger((tension - band.constant) / band.ratio, S(0));
      const S high = tension * band.ratio + band.constant;
      contact.update(low, high, position, slips + tension_play * total, memory.started);
      const S way = clamp(contact.slip.run, S(-1), S(1));
      const S share = contact.torque / larger(tension, S(1e-9));
      by_friction = share * by_friction - way * (known * contact.torque + band.constant);
      hidden = hidden / band.ratio + contact.hidden;
      tension = contact.torque;
      if (at.joint < 0 || at.joint >= N || at.arm == S(0)) continue;
      // A joint at the tip draws the segment beyond its first contact.
      const int i = at.joint;
      position = position + at.arm * joints.x[i];
      const S arm = -at.arm * joints.bend[i].turn;
      joints.moment[i] = joints.moment[i] + arm * tension;
      joints.moment_by_friction[i] = joints.moment_by_friction[i] + arm * by_friction;
      joints.variance[i] = joints.variance[i] + square(arm) * (square(deviations.tension) + square(hidden) / S(3) +
                                                               square(deviations.friction * by_friction));
    }
    pass(contacts[m]);
    auto& estimate = memory.estimate;
    estimate.far_tension[m] = tension;
    estimate.taut[m] = tension > S(3) * deviations.tension;
    auto& [row, value, variance, soft, counts] = equations.tendon[m];
    value = wound - stretched;
    for (int i = 0; i < N; ++i) {
      row[at_angle + i] = chain.arm[m][i] * joints.bend[i].turn;
      value = value - chain.arm[m][i] * joints.x[i];
    }
    row[at_friction] = stretch_by_friction;
    row[at_stiffness] = -stretched;
    soft = total;
    // What is known of friction is that of all; each tendon has its own.
    variance = square(total) * equations.of_cells + equations.of_lengths + square(hidden_stretch) / S(3) +
               square(deviations.friction * stretch_by_friction);
    // A slack tendon is longer than what it spans, unless the joints are where it would not be.
    counts = estimate.taut[m] || estimate.unexplained[m] > S(0);
    if (counts) equations.add(row, value, S(1) / variance);
  }

  // Moments about each joint: of tendons, springs and load they add up to nothing. What is known of the load beforehand
  // makes its moments uncertain, all joints' together.
  bool add_balance(const Joints& joints, Equations& equations) const {
    auto& [of_cells, of_lengths, root, right, tendon, row, load] = equations;
    S left[N], variance[N], rate[N][N]{};
    for (int i = 0; i < N; ++i) {
      left[i] = joints.moment[i];
      rate[i][i] = -chain.spring_rate(i, joints.angle[i]);
    }
    chain.add_springs(joints.angle, left);
    chain.add_tie_rates(S(1), rate);
    chain.load_rows(joints.bend, load);
    Root<S, N> open{};
    for (int i = 0; i < N; ++i) {
      for (int k = 0; k < load_components; ++k) load[i][k] = load[i][k] * load_deviation(k);
      for (int j = 0; j <= i; ++j)
        for (int k = 0; k < load_components; ++k) open.lower.at[i][j] = open.lower.at[i][j] + load[i][k] * load[j][k];
      variance[i] = joints.variance[i] + square(deviations.imbalance);
      open.lower.at[i][i] = open.lower.at[i][i] + variance[i];
      for (int j = 0; j < N; ++j) row[i][at_angle + j] = rate[i][j];
      row[i][at_friction] = joints.moment_by_friction[i];
      row[i][at_stiffness] = S(0);
      row[i][unknowns] = -left[i];
    }
    if (!open.take(variance)) return false;
    open.divide(row);
    open.divide(load);
    for (int i = 0; i < N; ++i) equations.add(row[i], row[i][unknowns], S(1));
    return true;
  }

  // The load that explains what is left of the balance, and its deviation.
  void add_load(const Equations& equations, Found& now) const {
    const auto& balance = equations.balance;
    for (int k = 0; k < load_components; ++k) {
      S by[unknowns]{}, found(0), variance(1);
      for (int i = 0; i < N; ++i) {
        S left = balance[i][unknowns];
        for (int j = 0; j < unknowns; ++j) {
          left = left - balance[i][j] * equations.right[j];
          by[j] = by[j] + balance[i][j] * equations.load[i][k];
        }
        found = found + equations.load[i][k] * left;
        variance = variance - square(equations.load[i][k]);
      }
      for (int i = 0; i < unknowns; ++i) {
        S sum(0);
        for (int j = 0; j <= i; ++j) sum = sum + equations.root.lower.at[i][j] * by[j];
        variance = variance + square(sum);
      }
      now.load[k] = load_deviation(k) * found;
      now.load_std[k] = load_deviation(k) * sqrt(larger(variance, S(0)));
    }
  }
};

}  // namespace tenodesis

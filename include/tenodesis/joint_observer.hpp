#pragma once
// Angles of all joints from the drive end of all tendons, for any routing.
//
// Each tendon's tension is followed from the spool from contact to contact, as far_end.hpp does with one tendon: a
// contact that slips has the tension beyond it on the edge of its band, one that sticks holds it inside. The stretch
// that these tensions make, less what spool and handle have wound, is the length that the joints have drawn: one
// equation a taut tendon. The balance of each joint, of its tendons' moments, its spring and the load, is another one.
// Unknown are the angles, errors of friction and stiffness that all tendons share, and the load at the tip, each with
// what is known of it beforehand; weighted least squares about the last estimate gives them together. What the sensors
// do not determine is in the covariance.

#include "tenodesis/chain_statics.hpp"
#include "tenodesis/far_end.hpp"
#include "tenodesis/route.hpp"

namespace tenodesis {

/// Inverts a definite matrix in its place; false where a pivot vanishes.
template <class S, int K>
bool invert_definite(Square<S, K>& matrix) {
  for (int k = 0; k < K; ++k) {
    const S pivot = matrix.at[k][k];
    if (!(pivot > S(0))) return false;
    const S inverse = S(1) / pivot;
    matrix.at[k][k] = S(1);
    for (int j = 0; j < K; ++j) matrix.at[k][j] = matrix.at[k][j] * inverse;
    for (int i = 0; i < K; ++i) {
      if (i == k) continue;
      const S by = matrix.at[i][k];
      matrix.at[i][k] = S(0);
      for (int j = 0; j < K; ++j) matrix.at[i][j] = matrix.at[i][j] - by * matrix.at[k][j];
    }
  }
  return true;
}

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

inline constexpr int joint_load_components = 7;

template <class S, int N, int M>
struct JointEstimate {
  S angle[N]{};                     ///< rad
  Square<S, N> covariance{};        ///< of the angles, rad^2
  S moment[N]{};                    ///< of the tendons about the joints, N m
  S load[joint_load_components]{};  ///< force (N) and moment (N m) in the tip's axes, grip (N)
  S load_std[joint_load_components]{};
  S friction_scale{1};  ///< over the friction that is assumed
  S friction_scale_std{};
  S far_tension[M]{};  ///< at the tendons' ends, N
  bool taut[M]{};
  S unexplained[M]{};  ///< tension that a tendon would have to have more, by its length, N
  S unexplained_std[M]{};
  bool valid{};  ///< false: a measurement is not finite, and the last estimate stands
};

template <class S, int N, int M, int contacts>
struct JointMemory {
  HeldTorque<S> contact[M][contacts]{};
  S handle_angle[N]{};  ///< without the steps of its encoder, rad
  bool started{};
  JointEstimate<S, N, M> estimate{};
};

/// Deviation of an angle before any tendon has been read, rad.
inline constexpr double prior_angle_std = 1.0;

/// Observer of a chain W whose tendons have at most so many contacts.
template <class W, int most_contacts>
struct JointObserver {
  using S = W::S;
  static constexpr int N = W::joints, M = W::tendons;
  static constexpr int unknowns = N + 2 + joint_load_components;
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
  S tension_play{};      ///< tension by whose stretch up to a contact that length is larger, N
  S smoothing{1};        ///< share of the handle's reading in that which contacts follow
  JointDeviations<S> deviations{};

  /// Estimate after a sample of the sensors; the memory keeps it.
  const Found& update(const Measured& measured, Memory& memory) const {
    Found& now = memory.estimate;
    now.valid = is_finite(measured);
    if (!now.valid) return now;
    Equations equations{};
    for (int h = 0; h < chain.handles; ++h) {
      S& smooth = memory.handle_angle[h];
      const S& read = measured.handle_angle[h];
      smooth = memory.started ? smooth + smoothing * (read - smooth) : read;
    }
    Joints joints(chain, measured, memory.handle_angle, now.angle);
    for (int m = 0; m < M; ++m)
      if (contacts[m] > 0) follow_tendon(m, measured, joints, memory, equations);
    memory.started = true;
    add_balance(joints, equations);
    for (int i = 0; i < N; ++i) equations.expect(i, S(prior_angle_std));
    equations.expect(at_friction, deviations.friction);
    equations.expect(at_stiffness, deviations.stiffness);
    for (int k = 0; k < joint_load_components; ++k) equations.expect(at_load + k, load_deviation(k));
    now.valid = invert_definite(equations.weight);
    if (!now.valid) return now;
    const auto& covariance = equations.weight.at;
    const auto value = [&](int i) {
      S sum(0);
      for (int j = 0; j < unknowns; ++j) sum = sum + covariance[i][j] * equations.right[j];
      return sum;
    };
    for (int i = 0; i < N; ++i) {
      const Mechanism mechanism = chain.joint[i].mechanism;
      const S most = angle_at(mechanism, S(0.98) * smaller(coordinate_limit<S>(mechanism), S(pi)));
      now.angle[i] = clamp(now.angle[i] + value(i), -most, most);
      now.moment[i] = joints.moment[i] + joints.moment_by_friction[i] * value(at_friction);
      for (int j = 0; j < N; ++j) now.covariance.at[i][j] = covariance[i][j];
    }
    for (int k = 0; k < joint_load_components; ++k) {
      now.load[k] = value(at_load + k);
      now.load_std[k] = sqrt(covariance[at_load + k][at_load + k]);
    }
    now.friction_scale = S(1) + value(at_friction);
    now.friction_scale_std = sqrt(covariance[at_friction][at_friction]);
    // A stiffness that the file does not admit explains nothing.
    const S softer = clamp(value(at_stiffness), S(-2) * deviations.stiffness, S(2) * deviations.stiffness);
    for (int m = 0; m < M; ++m) {
      if (contacts[m] == 0) continue;
      const auto& tendon = equations.tendon[m];
      S left = tendon.value;
      for (int j = 0; j < unknowns; ++j) left = left - tendon.row[j] * (j == at_stiffness ? softer : value(j));
      now.unexplained[m] = left / tendon.soft;
      S variance = tendon.variance;
      // An equation that did not count gave no angles.
      for (int i = 0; i < N && !tendon.counts; ++i)
        for (int j = 0; j < N; ++j) variance = variance + tendon.row[i] * covariance[i][j] * tendon.row[j];
      now.unexplained_std[m] = sqrt(larger(variance, S(0))) / tendon.soft;
    }
    return now;
  }

 private:
  static constexpr int at_friction = N, at_stiffness = N + 1, at_load = N + 2;

  // Weighted equations in the changes of the angles, shares of friction and stiffness, and the load.
  struct Equations {
    struct Tendon {
      S row[unknowns]{};
      S value{}, variance{};
      S soft{1};  // m/N
      bool counts{};
    };
    Square<S, unknowns> weight{};
    S right[unknowns]{};
    Tendon tendon[M]{};

    void add(const S* row, const S& value, const S& variance) {
      const S by = S(1) / variance;
      for (int i = 0; i < unknowns; ++i) {
        if (row[i] == S(0)) continue;
        for (int j = 0; j < unknowns; ++j) weight.at[i][j] = weight.at[i][j] + by * row[i] * row[j];
        right[i] = right[i] + by * row[i] * value;
      }
    }
    // An unknown that is zero within a deviation.
    void expect(int i, const S& deviation) { weight.at[i][i] = weight.at[i][i] + S(1) / (deviation * deviation); }
  };

  // Joints at the last estimate, and what tendons do to them.
  struct Joints {
    Bend<S> bend[N];
    S angle[N];  // of the tip
    S x[N];
    S y[N]{};     // of the handle
    S slow[N]{};  // likewise, without its encoder's steps
    S bent{};     // sum of the handle's angles
    S handle_angle[N]{};
    S moment[N]{};
    S moment_by_friction[N]{};
    S variance[N]{};

    Joints(const W& of, const Measured& measured, const S* smooth, const S* estimated) {
      for (int i = 0; i < N; ++i) {
        angle[i] = estimated[i];
        x[i] = coordinate_at(of.joint[i].mechanism, angle[i]);
        bend[i] = Bend<S>(of.joint[i], x[i]);
      }
      for (int h = 0; h < of.handles; ++h) {
        handle_angle[h] = measured.handle_angle[h];
        y[h] = coordinate_at(of.handle[h], handle_angle[h]);
        slow[h] = coordinate_at(of.handle[h], smooth[h]);
        bent = bent + abs(handle_angle[h]);
      }
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

  // Wrap of a contact; the handle's joints are counted from N on.
  S wrap_at(const Passage<S>& at, const Joints& joints) const {
    if (at.joint < 0) return larger(at.wrap + sheath_bend_rate * joints.bent * at.share, S(0));
    if (at.joint >= N) return at.wrap + abs(joints.handle_angle[at.joint - N]) * at.share;
    S turned = abs(joints.angle[at.joint]);
    if (chain.is_around(at.joint)) turned = sqrt(square(turned) + square(joints.angle[at.joint + 1]));
    return at.wrap + turned * at.share;
  }

  // Stretch of a segment at a tension, m.
  S stretch(int m, int i, const S& tension) const {
    return compliance[m][i] * (chain.linear_at(m, tension) - chain.pretension[m]);
  }

  // Tensions along a tendon, its moments about the joints, and its equation.
  void follow_tendon(int m, const Measured& measured, Joints& joints, Memory& memory, Equations& equations) const {
    S tension = larger(measured.tension[m], S(0)), hidden(0), by_friction(0);
    S position = spool_radius * measured.spool_angle[m];
    S wound = position;  // by spool and handle, less the stretch
    S hidden_stretch(0), stretch_by_friction(0), stretched(0), total(0);
    const auto pass = [&](int i) {
      const S longer = stretch(m, i, tension);
      const S soft = compliance[m][i] / chain.growth_at(m, tension);
      wound = wound - longer;
      position = position - longer;
      stretched = stretched + longer;
      total = total + soft;
      hidden_stretch = hidden_stretch + soft * hidden;
      stretch_by_friction = stretch_by_friction + soft * by_friction;
    };
    for (int h = 0; h < chain.handles; ++h) wound = wound + chain.handle_arm[m][h] * joints.y[h];
    for (int j = 0; j < contacts[m]; ++j) {
      const Passage<S>& at = passage[m][j];
      pass(j);
      // A joint of the handle draws the segment before its last contact.
      if (at.joint >= N) position = position + at.arm * joints.slow[at.joint - N];
      const S wrap = wrap_at(at, joints);
      const S exponent = at.coefficient * wrap;
      const Band<S> band = band_of(law, exponent, wrap, at, S(0), tension);
      auto& contact = memory.contact[m][j];
      const S low = larger((tension - band.constant) / band.ratio, S(0));
      const S high = tension * band.ratio + band.constant;
      contact.update(low, high, position, play + tension_play * total, memory.started);
      const S way = clamp(contact.slip.run, S(-1), S(1));
      const S share = contact.torque / larger(tension, S(1e-9));
      by_friction = share * by_friction - way * (exponent * contact.torque + band.constant);
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
    value = wound;
    for (int i = 0; i < N; ++i) {
      row[i] = chain.arm[m][i] * joints.bend[i].turn;
      value = value - chain.arm[m][i] * joints.x[i];
    }
    row[at_friction] = stretch_by_friction;
    row[at_stiffness] = -stretched;
    soft = total;
    // What is known of friction is that of all; each tendon has its own.
    variance = square(total * deviations.tension) + square(deviations.length) + square(hidden_stretch) / S(3) +
               square(deviations.friction * stretch_by_friction);
    // A slack tendon is longer than what it spans, unless the joints are where it would not be.
    counts = estimate.taut[m] || estimate.unexplained[m] > S(0);
    if (counts) equations.add(row, value, variance);
  }

  // Moments about each joint: of tendons, springs and load they add up to nothing.
  void add_balance(const Joints& joints, Equations& equations) const {
    S row[N][unknowns]{}, left[N], unused[N][N];
    for (int i = 0; i < N; ++i) left[i] = joints.moment[i];
    chain.add_springs(joints.angle, left);
    S rate[N][N]{};
    for (int i = 0; i < N; ++i) rate[i][i] = -chain.spring_rate(i, joints.angle[i]);
    chain.add_tie_rates(S(1), rate);
    for (int k = 0; k < joint_load_components; ++k) {
      ChainLoad<S> unit{};
      S* const part[] = {&unit.wrench.force.x,
                         &unit.wrench.force.y,
                         &unit.wrench.force.z,
                         &unit.wrench.moment.x,
                         &unit.wrench.moment.y,
                         &unit.wrench.moment.z,
                         &unit.grip};
      *part[k] = S(1);
      S moment[N];
      chain.template load_moments<false, false>(joints.bend, unit, moment, unused);
      for (int i = 0; i < N; ++i) row[i][at_load + k] = moment[i];
    }
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j < N; ++j) row[i][j] = rate[i][j];
      row[i][at_friction] = joints.moment_by_friction[i];
      equations.add(row[i], -left[i], joints.variance[i] + square(deviations.imbalance));
    }
  }
};

}  // namespace tenodesis

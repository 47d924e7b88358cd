#pragma once
// Observers: output angle, tip force and friction from the proximal sensors.
//
// Without friction a tension is the same along its tendon, and eq. 19 gives the tip's angle from the two. With friction
// the tension beyond a contact is only known within a band, unless the direction is known in which the tendon slips
// there: then that tension lies on the band's edge. Slip is observable: the length wound by the spool less the stretch
// of the tendon up to a contact is the tendon's position there. So tension and slip are followed from the spool to the
// tip, contact by contact. A tendon that slips determines the tip's position; a tendon that sticks gives bounds of it.
// Two tendons that slip the same way, as when both motors wind, determine it twice, and their disagreement reveals how
// strong friction is. Two that stick reveal where their compliance is (compliance_shares.hpp).

#include "tenodesis/compliance_shares.hpp"

namespace tenodesis {

/// Output angle by eq. 19 as printed: without slack, wound lengths and friction.
template <class A, class S>
S paper_output_angle(const ControlModel<A>& model, const Measurement<S>& measured) {
  const A& axis = model.axis;
  const S stretch = (measured.tension[agonist] - measured.tension[antagonist]) / (S(2) * axis.stiffness);
  const S x = (model.excursion(measured.handle_angle) - stretch) / axis.distal.excursion_slope();
  const S most = axis.distal.limit() * S(0.999);
  return axis.distal.angle(clamp(x, -most, most));
}

/// Tracks both tendons' friction from the spools to the tip.
template <class A>
struct FrictionObserver {
  using S = A::Scalar;
  using Memory = FrictionMemory<S>;

  ControlModel<A> model{};
  FrictionSettings<S> settings{};

  void update(const Measurement<S>& measured, const S& dt, Memory& memory) const {
    if (!memory.started) return start(measured, memory);
    smooth(measured, dt, memory);
    const S excursion = model.excursion(memory.smooth.handle_angle);
    follow(settings.tremor_play, memory.handle_angle, dt, memory.intent);
    memory.target = clamp(model.aim(memory.intent.angle), -model.stop, model.stop);
    set_exponents(memory);
    S* const ratio = memory.ratio;
    for (int j = 0; j < 3; ++j) ratio[j] = exp(memory.scale * memory.nominal[j]);
    memory.reversing = small_exp(S(2) * S(tuning::reversing_share) * larger(memory.scale, S(1)) *
                                 (memory.nominal[0] + memory.nominal[1]));
    S position[2];
    for (int i = 0; i < 2; ++i) position[i] = follow_to_stem(i, excursion, ratio, memory);
    const auto& [one, other] = memory.tendon;
    const bool together = one.slips && other.slips && one.reversal.direction == other.reversal.direction;
    memory.together = together ? one.reversal.direction : S(0);
    const S tip = memory.tip;
    place_tip(position, ratio, memory);
    memory.tip_edge = clamp(memory.tip_edge + (memory.tip - tip) / settings.play, S(-1), S(1));
    if (!calm(measured, memory) || !learn(position, ratio, memory)) {
      grow(dt, memory);
      learn_shares(model, settings, position, memory);
    }
    memory.tip_slip = follow(memory.tip_slip, at_joint(memory), S(tuning::tip_plays) * settings.play);
    for (int i = 0; i < 2; ++i) follow_to_tip(i, position[i], ratio, memory);
    update_variance(memory);
  }

  /// Tracking error: the tip's target less its position, as tendon length, m.
  S tracking_error(const Memory& memory) const { return memory.target - memory.tip; }

  /// The part of a missing stroke that is certain: the tip may have moved unseen toward its target, m.
  S certain(const S& missing, const Memory& memory) const {
    return missing > S(0) ? larger(missing - model.stroke_for(memory.unobservable[0]), S(0))
                          : smaller(missing + model.stroke_for(memory.unobservable[1]), S(0));
  }

  /// Stretch by which a force at the tip differs the two tendons, halved, per its size, m/N.
  S stretch_per_force(const Memory& memory) const {
    return model.axis.distal.tangential_arm(memory.x) / memory.arm * memory.compliance * S(0.5);
  }

  /// The same of the force that the tip exerts, positive toward flexion, m.
  S exerted(const Memory& memory) const {
    const S difference = memory.tendon[agonist].tension[3] - memory.tendon[antagonist].tension[3];
    const S passive = model.axis.distal.passive_stiffness() * memory.output_angle / memory.arm;
    return (difference - passive) * memory.compliance * S(0.5);
  }

  /// How far friction at the tip's joint may hide it, m.
  S exerted_unseen(const Memory& memory) const {
    const S both = memory.tendon[agonist].tension[2] + memory.tendon[antagonist].tension[2];
    return memory.scale * memory.nominal[2] * both * memory.compliance * S(0.5);
  }

  /// Half the difference of both tendons' stretches if their tensions were those at the spools, less what the joint's
  /// own spring takes, m: without friction, the differential stroke that restores the angle.
  S measured_loss(const Memory& memory) const {
    const S stretch = (memory.smooth.tension[agonist] - memory.smooth.tension[antagonist]) * memory.compliance * S(0.5);
    if (!model.springs()) return stretch;
    const S excursion = model.excursion(memory.intent.angle);
    return stretch + memory.tip - excursion + model.stroke_for(unloaded_length(model.axis, excursion) - memory.tip);
  }

  /// Tendon length that the handle draws by a small angle, per its size, m.
  S tremor_arm() const { return model.axis.proximal.moment_arm(S(0)); }
  /// Tendon length that the hand's tremor draws at most, m.
  S tremor_length(const Memory& memory) const { return tremor_arm() * memory.intent.amplitude; }
  /// Whether the hand trembles by more than noise does.
  bool trembles(const Memory& memory) const { return memory.intent.amplitude > settings.tremor_play; }

  /// Whether a tendon is slack, or as good as slack.
  bool loose(const Memory& memory) const {
    return smaller(memory.tendon[agonist].tension[0], memory.tendon[antagonist].tension[0]) <=
           S(2) * S(tuning::calm_lag) * settings.slack_below;
  }

  /// How far friction, so many times as strong as it is taken for, may have changed that difference, m.
  S hidden_loss(const Memory& memory, const S& times) const {
    const S* const nominal = memory.nominal;
    // e^x - 1 to x^3: within 2 % at an exponent of 0.7, which no instrument of use has.
    const auto grown = [](const S& x) { return x * (S(1) + x * (S(0.5) + x * S(1.0 / 6))); };
    const S at_sheath = grown(times * nominal[0]);
    const S at_stem = grown(times * (nominal[0] + nominal[1]));
    const S both = larger(memory.smooth.tension[agonist], S(0)) + larger(memory.smooth.tension[antagonist], S(0));
    return both * memory.compliance * S(0.5) *
           (model.share[1] * at_sheath + (model.share[2] + model.share[3]) * at_stem);
  }

  /// Differential stroke needed before the tip breaks away toward flexion (direction 1) or extension (-1), m.
  S breakaway(const Memory& memory, const S& direction) const {
    const S at_tip = memory.ratio[2];
    const S all = smaller(memory.ratio[0] * memory.ratio[1] * at_tip, S(1e9));
    const auto& pulled = memory.tendon[direction > S(0) ? agonist : antagonist];
    const auto& held = memory.tendon[direction > S(0) ? antagonist : agonist];
    const S needed = pulled.tension[3] - held.tension[3];
    const S in_stem = needed - (pulled.tension[2] / at_tip - held.tension[2] * at_tip);
    const S at_spool = needed - (pulled.tension[0] / all - held.tension[0] * all);
    return memory.compliance * S(0.5) *
           (memory.share[2] * larger(in_stem, S(0)) + (memory.share[0] + memory.share[1]) * larger(at_spool, S(0)));
  }

  /// By how much more the agonist must be wound than the antagonist until both slip toward the spools (direction 1) or
  /// the tip (-1), as a share of both: tendons under unlike tensions need unlike strokes, and the one that slipped
  /// first would draw the tip along.
  S uneven(const Memory& memory, const S& direction) const {
    const S all = memory.ratio[0] * memory.ratio[1];
    const S edge = direction > S(0) ? all : S(1) / all;
    S left[2];
    for (int i = 0; i < 2; ++i) {
      const auto& tension = memory.tendon[i].tension;
      left[i] = larger(direction * (edge * tension[2] - tension[0]), S(0));
    }
    const S both = left[agonist] + left[antagonist];
    // Near its least value, the scale says that there is no friction.
    const bool rubs = memory.scale > S(2) * S(tuning::least_friction);
    return rubs && both > settings.slack_below ? (left[agonist] - left[antagonist]) / both : S(0);
  }

  Estimate<S> estimate(const Memory& memory) const {
    Estimate<S> estimate{};
    const A& axis = model.axis;
    const S angle = memory.output_angle;
    const S arm = memory.arm;
    estimate.output_angle = angle;
    const S off = memory.deviation;
    estimate.output_angle_std = off / arm;
    const auto& tendon = memory.tendon;
    const S reach = axis.distal.tangential_arm(memory.x);
    // Friction at the tip's joint may be anywhere within its bounds, on both tendons alike. It follows the tip's motion
    // without the play that keeps the law's tensions from turning: a wrong turn costs a force less than an angle.
    const S pulled = tendon[agonist].tension[2];
    const S held = tendon[antagonist].tension[2];
    const S band = memory.scale * memory.nominal[2] * (pulled + held);
    const S difference = pulled - held - memory.tip_edge * band;
    estimate.tip_force = (difference * arm - axis.distal.passive_stiffness() * angle) / reach;
    // Where the tip may have moved unseen, that friction may have turned.
    const S unseen = larger(memory.unobservable[0], memory.unobservable[1]);
    const S turned = memory.tip_edge * smaller(unseen / (S(2) * settings.play), S(1));
    const S stretched = off * axis.stiffness;
    const S by_friction = band * band * (S(1.0 / 3) + turned * turned);
    estimate.tip_force_std = sqrt(S(4) * stretched * stretched + by_friction) * arm / reach;
    estimate.friction_scale = memory.scale;
    estimate.friction_scale_std = sqrt(memory.covariance[0][0]);
    return estimate;
  }

  /// Whether both tendons have slipped toward the spools (direction 1) or the tip (-1), at sheath and handle, far
  /// enough that their tensions lie on the edges of their bands.
  bool slip_together(const Memory& memory, const S& direction) const { return memory.together == direction; }

 private:
  static constexpr int unknowns = 4;

  // Standard deviation of the tip's position, as tendon length, and what of it strokes can lower.
  void update_variance(Memory& memory) const {
    const auto& tendon = memory.tendon;
    const S* const share = memory.share;
    S apart[4];
    for (int j = 0; j < 4; ++j) apart[j] = tendon[agonist].tension[j] - tendon[antagonist].tension[j];
    const S half = S(0.5) * memory.compliance;
    const S near = share[0] * apart[0] + share[1] * apart[1];
    const S by_friction = half * share[2] * (apart[0] - apart[2]) / memory.scale;
    const S by_compliance = half * (near + share[2] * apart[2] + share[3] * apart[3]) / memory.compliance_scale;
    const S by_share = half * (near / (share[0] + share[1]) - apart[2]);
    const S unseen = larger(memory.unobservable[0], memory.unobservable[1]);
    // A tremor moves what no stroke has proven.
    const S by_tremor = S(0.5) * tremor_length(memory);
    const S by_gain = half * (tendon[agonist].tension[0] + tendon[antagonist].tension[0]);
    const auto& p = memory.covariance;
    memory.position_variance = unseen * unseen * S(1.0 / 3) + by_friction * by_friction * p[0][0] + p[1][1] * S(0.25) +
                               by_compliance * by_compliance * p[2][2] + by_share * by_share * memory.share_variance;
    // The sum of both ropes' lengths is observed, and their difference is not. What the tensions at the start leave
    // open is not counted.
    const S at_start = memory.reference_at_start;
    memory.by_ropes = S(0.5) * larger(abs(memory.reference - at_start) - abs(at_start), S(0));
    memory.deviation = sqrt(settings.bias_std * settings.bias_std + memory.by_ropes * memory.by_ropes +
                            by_gain * by_gain * p[3][3] + by_tremor * by_tremor + memory.position_variance);
  }

  void set_exponents(Memory& memory) const {
    const S handle = memory.smooth.handle_angle;
    memory.nominal[0] = model.sheath * (model.sheath_bend + model.sheath_bend_rate * abs(handle));
    memory.nominal[1] = model.vertex * (model.base_wrap + model.axis.proximal.wrap_angle(handle)) + memory.passed[0];
    memory.nominal[2] =
        model.vertex * (model.base_wrap + model.axis.distal.wrap_angle(memory.output_angle)) + memory.passed[1];
  }

  S stretch(const TendonMemory<S>& one, const Memory& memory) const {
    S sum(0);
    for (int j = 0; j < 4; ++j) sum = sum + memory.share[j] * (one.tension[j] - model.axis.pretension);
    return sum * memory.compliance;
  }

  S stretch_of(int segment, const S& tension, const Memory& memory) const {
    return memory.share[segment] * memory.compliance * (tension - model.axis.pretension);
  }

  void start(const Measurement<S>& measured, Memory& memory) const {
    const bool homed = memory.homed;
    const S compliance_scale = memory.compliance_scale;
    const S unsure = memory.covariance[2][2];
    memory = Memory{};
    memory.started = true;
    if (homed) memory.compliance_scale = compliance_scale;
    memory.compliance = memory.compliance_scale / model.axis.stiffness;
    for (int j = 0; j < 4; ++j) memory.share[j] = model.share[j];
    memory.smooth = measured;
    memory.handle_angle = measured.handle_angle;
    memory.intent = IntentState<S>::at(measured.handle_angle);
    memory.covariance[0][0] = settings.scale_std * settings.scale_std;
    const S left = homed ? S(tuning::homed_share) : S(1);
    memory.covariance[2][2] = larger(unsure, square(left * settings.compliance_std));
    memory.covariance[3][3] = square(left * settings.gain_std);
    memory.share_variance = square(S(tuning::share_std));
    const S excursion = model.excursion(measured.handle_angle);
    S tip(0), both(0);
    for (int i = 0; i < 2; ++i) {
      auto& one = memory.tendon[i];
      for (S& tension : one.tension) tension = measured.tension[i];
      one.reversal = Reversal<S>::at(measured.tension[i]);
      const S side = i == agonist ? S(1) : S(-1);
      const S wound = model.spool_radius * measured.spool_angle[i];
      one.slip[0].dragged = wound - stretch_of(0, measured.tension[i], memory);
      one.slip[1].dragged = one.slip[0].dragged + side * excursion - stretch_of(1, measured.tension[i], memory);
      const S position = wound + side * excursion - stretch(one, memory);
      tip = tip + side * S(0.5) * position;
      both = both + position;
    }
    // Tensions that are not the parameters' where the spools are at home are those of other lengths, or of friction;
    // or of noise.
    const S explained = square(settings.reference_std) + square(settings.length_noise);
    memory.reference_at_start = homed || both * both < square(S(tuning::outlier)) * explained ? S(0) : both;
    memory.reference = memory.reference_at_start;
    memory.covariance[1][1] = square(settings.reference_std) + square(memory.reference_at_start);
    put_tip(tip, memory);
    set_exponents(memory);
    memory.target = clamp(model.aim(measured.handle_angle), -model.stop, model.stop);
    memory.tip_slip.dragged = at_joint(memory);
    update_variance(memory);
  }

  void smooth(const Measurement<S>& measured, const S& dt, Memory& memory) const {
    Measurement<S>& smooth = memory.smooth;
    const S share = dt / (settings.smoothing + dt);
    const auto approach = [&](S& at, const S& to) { at = at + (to - at) * share; };
    approach(memory.handle_angle, measured.handle_angle);
    smooth.handle_angle =
        clamp(smooth.handle_angle, memory.handle_angle - settings.hand_play, memory.handle_angle + settings.hand_play);
    for (int i = 0; i < 2; ++i) {
      approach(smooth.tension[i], measured.tension[i]);
      approach(smooth.spool_angle[i], measured.spool_angle[i]);
    }
  }

  // Friction, lengths and stiffness may change while nothing shows it.
  void grow(const S& dt, Memory& memory) const {
    const S start[3] = {settings.scale_std, settings.reference_std, settings.compliance_std};
    const S growth = square(S(tuning::forgetting)) * dt;
    memory.since_together = memory.since_together + dt;
    memory.earlier_scale =
        memory.earlier_scale + (memory.scale - memory.earlier_scale) * (dt * S(1 / tuning::stroke_time));
    for (int n = 0; n < 3; ++n) {
      const S most = start[n] * start[n];
      S& variance = memory.covariance[n][n];
      if (variance < most) variance = smaller(variance + most * growth, most);
    }
  }

  // From the spool past the handle's joint; returns the tendon's position there.
  S follow_to_stem(int i, const S& excursion, const S* ratio, Memory& memory) const {
    auto& one = memory.tendon[i];
    const S side = i == agonist ? S(1) : S(-1);
    one.tension[0] = larger(memory.smooth.tension[i] * (S(1) - side * memory.gain_error), S(0));
    const S at_sheath = model.spool_radius * memory.smooth.spool_angle[i] - stretch_of(0, one.tension[0], memory);
    one.slip[0] = follow(one.slip[0], at_sheath, settings.sheath_play);
    one.tension[1] = beyond(ratio[0], one.tension[0], one.tension[1], one.slip[0].indicator);
    const S at_handle =
        at_sheath + side * excursion - stretch_of(1, one.tension[1], memory) - memory.reference * S(0.5);
    one.slip[1] = follow(one.slip[1], at_handle, settings.play);
    one.slips = !slack(one) && slips(one, memory);
    follow(one.tension[0], settings.slack_below, memory.smooth.handle_angle, one.slips, one.reversal);
    return at_handle;
  }

  bool slips(const TendonMemory<S>& one, const Memory& memory) const {
    const S direction = one.reversal.direction;
    return one.slip[0].run * direction >= S(tuning::firm_run) && one.slip[1].run * direction >= S(tuning::firm_run) &&
           one.reversal.beyond(one.tension[0], memory.reversing);
  }

  // Position of the tendons at the tip's joint, as length of the agonist: the tip's, less what is stretched beyond.
  S at_joint(const Memory& memory) const {
    const S beyond_joint = memory.tendon[agonist].tension[3] - memory.tendon[antagonist].tension[3];
    return memory.tip + S(0.5) * memory.share[3] * memory.compliance * beyond_joint;
  }

  // Position of the tip by one tendon and its tension in the stem, as length of the agonist.
  S tip_by(int i, const S& position, const S& stem, const Memory& memory) const {
    const S length = position - stretch_of(2, stem, memory) - stretch_of(3, memory.tendon[i].tension[3], memory);
    return i == agonist ? length : -length;
  }

  bool slack(const TendonMemory<S>& one) const { return one.tension[0] <= settings.slack_below; }

  void put_tip(const S& tip, Memory& memory) const {
    const S most = model.axis.distal.limit() * S(0.999);
    memory.tip = tip;
    memory.x = clamp(tip / model.axis.distal.excursion_slope(), -most, most);
    memory.output_angle = model.axis.distal.angle(memory.x);
    memory.arm = model.axis.distal.moment_arm(memory.x);
  }

  void place_tip(const S* position, const S* ratio, Memory& memory) const {
    S low = -std::numeric_limits<S>::max();
    S high = std::numeric_limits<S>::max();
    S pull(0);
    S weight(0);
    for (int i = 0; i < 2; ++i) {
      auto& one = memory.tendon[i];
      if (slack(one)) continue;
      const S at_low = tip_by(i, position[i], one.tension[1] / ratio[1], memory);
      const S at_high = tip_by(i, position[i], one.tension[1] * ratio[1], memory);
      low = larger(low, smaller(at_low, at_high));
      high = smaller(high, larger(at_low, at_high));
      const S indicator = one.slip[1].indicator;
      pull = pull + abs(indicator) * ((indicator > S(0) ? at_low : at_high) - memory.tip);
      weight = weight + abs(indicator);
    }
    S tip = memory.tip + pull / larger(weight, S(1));
    tip = low <= high ? clamp(tip, low, high) : (low + high) * S(0.5);
    put_tip(tip, memory);
  }

  void follow_to_tip(int i, const S& position, const S* ratio, Memory& memory) const {
    auto& one = memory.tendon[i];
    const S compliance = memory.compliance;
    const S side = i == agonist ? S(1) : S(-1);
    const S stem = model.axis.pretension + (position - side * memory.tip - stretch_of(3, one.tension[3], memory)) /
                                               (memory.share[2] * compliance);
    one.tension[2] = clamp(stem, one.tension[1] / ratio[1], one.tension[1] * ratio[1]);
    one.tension[3] = beyond(ratio[2], one.tension[2], one.tension[3], side * memory.tip_slip.indicator);
    // Unobserved motion of the tip with a tendon lowers its tension to the lower edge, motion against it raises it.
    const S both = ratio[0] * ratio[1];
    const S stretch = memory.share[2] * compliance;
    const S with = slack(one) ? std::numeric_limits<S>::max() : stretch * (one.tension[2] - one.tension[0] / both);
    const S against = slack(one) ? std::numeric_limits<S>::max() : stretch * (one.tension[0] * both - one.tension[2]);
    const S toward[2] = {i == agonist ? with : against, i == agonist ? against : with};
    for (int n = 0; n < 2; ++n)
      memory.unobservable[n] = larger(i == agonist ? toward[n] : smaller(memory.unobservable[n], toward[n]), S(0));
  }

  // Variance of the compared lengths from that of the estimates; gain: covariance with each.
  static S spread_by(const S* by, const Memory& memory, S* gain) {
    for (int n = 0; n < unknowns; ++n) {
      gain[n] = memory.covariance[0][n] * by[0];
      for (int m = 1; m < unknowns; ++m) gain[n] = gain[n] + memory.covariance[smaller(n, m)][larger(n, m)] * by[m];
    }
    S spread = by[0] * gain[0];
    for (int n = 1; n < unknowns; ++n) spread = spread + by[n] * gain[n];
    return larger(spread, S(0));
  }

  void reset_scale_variance(Memory& memory) const {
    for (int n = 1; n < unknowns; ++n) memory.covariance[0][n] = S(0);
    memory.covariance[0][0] = settings.scale_std * settings.scale_std;
  }

  // In a jerk the filter's lag would be taken for friction, and a tendon that is nearly slack for a longer tendon.
  bool calm(const Measurement<S>& measured, const Memory& memory) const {
    for (int i = 0; i < 2; ++i) {
      const S behind = measured.tension[i] - memory.smooth.tension[i];
      if (abs(behind) > S(tuning::calm_lag) * settings.slack_below ||
          memory.smooth.tension[i] < S(2) * S(tuning::calm_lag) * settings.slack_below)
        return false;
    }
    return true;
  }

  void set_compliance(const S& scale, Memory& memory) const {
    memory.compliance_scale = clamp(scale, S(1) / S(tuning::most_compliance), S(tuning::most_compliance));
    memory.compliance = memory.compliance_scale / model.axis.stiffness;
  }

  // The other unknowns keep their deviations: a Schmidt-Kalman filter (Schmidt, Adv. Control Syst. 3, 1966).
  void learn_stiffness(const S& step, const S& trusted, const S* gain, Memory& memory) const {
    set_compliance(memory.compliance_scale - gain[2] * step, memory);
    for (int n = 0; n < unknowns; ++n) {
      S& covariance = memory.covariance[smaller(n, 2)][larger(n, 2)];
      // Rounding must not make the variance negative.
      const S left = covariance - gain[n] * (trusted * gain[2]);
      covariance = n == 2 ? larger(left, S(1e-3) * covariance) : left;
    }
  }

  // Both tendons slip: their two positions of the tip differ by errors of friction, lengths, stiffness and gains.
  // Whether anything was learned. While the hand draws one and lets the other go, friction acts by the difference of
  // their tensions and may be wrong in more ways than its scale. Stiffness acts by their sum, and is learned alone,
  // where strokes have shown nothing for a while.
  bool learn(const S* position, const S* ratio, Memory& memory) const {
    const auto& [first, second] = memory.tendon;
    if (!first.slips || !second.slips) return false;
    const S way[2] = {first.reversal.direction, second.reversal.direction};
    const S weight = smaller(way[0] * first.slip[1].indicator, way[1] * second.slip[1].indicator);
    if (!(weight > S(0))) return false;
    const bool together = way[0] == way[1];
    if (!together && memory.since_together < S(tuning::apart_after)) return false;
    const S compliance = memory.compliance;
    const S* const share = memory.share;
    const S at_joint = share[1] * memory.nominal[0], at_stem = share[2] * (memory.nominal[0] + memory.nominal[1]);
    // Tensions by the compliance that they stretch, up to the handle's joint and beyond.
    S near(0), beyond_it(0), stems(0), apart(0), rubbing(0), sticking(0);
    const S reversed = S(1) + S(tuning::surely_reversed) * (memory.reversing - S(1));
    for (int i = 0; i < 2; ++i) {
      const auto& one = memory.tendon[i];
      const S stem = way[i] > S(0) ? one.tension[1] / ratio[1] : one.tension[1] * ratio[1];
      const S before = share[0] * one.tension[0] + share[1] * one.tension[1];
      const S after = share[2] * stem + share[3] * one.tension[3];
      near = near + before;
      beyond_it = beyond_it + after;
      stems = stems + stem;
      apart = before + after - apart;
      rubbing = rubbing + way[i] * (at_joint * one.tension[1] + at_stem * stem);
      const S left = one.reversal.left(one.tension[0], reversed);
      sticking = sticking + left * left;
    }
    const S pretensions = S(2) * model.axis.pretension;
    const S to_joint = share[0] + share[1];
    const S residual = position[0] + position[1] - compliance * (beyond_it - pretensions * (S(1) - to_joint));
    const S by_share = compliance * (stems - near / to_joint);
    // Without friction in the parameters, its effect must not be taken for one of the gains.
    const S by_gain = at_stem > S(0) ? -compliance * apart : S(0);
    const S by[unknowns] = {compliance * rubbing, S(-1), (pretensions - near - beyond_it) / model.axis.stiffness,
                            by_gain};
    const S by_stem = compliance * share[2];
    const S noise = settings.length_noise * settings.length_noise +
                    S(tuning::share_plays) * by_share * by_share * memory.share_variance +
                    S(tuning::sticking_plays) * by_stem * by_stem * sticking;
    S gain[unknowns];
    S spread = spread_by(by, memory, gain);
    if (residual * residual > square(S(tuning::outlier)) * (spread + noise)) {
      // More than the deviations explain: just after a reversal it is the model that is wrong about where a tendon
      // slips, later most likely the hand has bent the sheath, or a rope has got longer.
      if (!together) return false;
      for (const auto& one : memory.tendon)
        if (abs(one.slip[0].run) < S(2) * S(tuning::firm_run) || abs(one.slip[1].run) < S(2) * S(tuning::firm_run))
          return false;
      reset_scale_variance(memory);
      memory.covariance[1][1] = memory.covariance[1][1] + square(residual);
      spread = spread_by(by, memory, gain);
    }
    spread = spread + noise / weight;
    const S trusted = S(1) / spread;
    const S step = residual * trusted;
    if (!together) {
      learn_stiffness(step, trusted, gain, memory);
      return true;
    }
    memory.since_together = S(0);
    memory.scale = clamp(memory.scale - gain[0] * step, S(tuning::least_friction), S(tuning::most_friction));
    memory.reference = memory.reference - gain[1] * step;
    set_compliance(memory.compliance_scale - gain[2] * step, memory);
    memory.gain_error = clamp(memory.gain_error - gain[3] * step, S(-0.5) * S(tuning::most_gain_difference),
                              S(0.5) * S(tuning::most_gain_difference));
    for (int n = 0; n < unknowns; ++n) {
      const S part = gain[n] * trusted;
      // Rounding must not make it negative.
      const S least = S(1e-3) * memory.covariance[n][n];
      for (int m = n; m < unknowns; ++m) memory.covariance[n][m] = memory.covariance[n][m] - part * gain[m];
      memory.covariance[n][n] = larger(memory.covariance[n][n], least);
    }
    return true;
  }
};

}  // namespace tenodesis

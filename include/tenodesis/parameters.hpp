#pragma once
// A controller from the parameters of the C interface, in whatever precision they are given.

#include "tenodesis/controller.hpp"

namespace tenodesis {

/// Largest sum of all contacts' exponents: where friction leaves less than a fiftieth of a tendon's tension, it cannot
/// be observed.
template <class S>
inline constexpr S most_friction = S(4);

/// Longest interval between ticks that the controller measures, s: a larger limit could never be exceeded.
template <class S>
inline constexpr S longest_tick = S(4);

namespace detail {

template <class P, class S>
constexpr void set_joint(const P& p, TendonGear<S>& joint, bool distal) {
  joint = {S(distal ? p.distal_radius : p.proximal_radius), S(distal ? p.end_effector_length : p.handle_length)};
}
template <class P, class S>
constexpr void set_joint(const P& p, TendonPulley<S>& joint, bool distal) {
  joint = {S(distal ? p.distal_radius : p.proximal_radius), S(distal ? p.end_effector_length : p.handle_length)};
}
template <class P, class S>
constexpr void set_joint(const P& p, TendonContinuum<S>& joint, bool) {
  joint = {S(p.distal_radius), S(p.end_effector_length), S(p.backbone_length), S(p.backbone_rigidity)};
}

template <class A, class P>
constexpr ControlModel<A> control_model(const P& p) {
  using S = A::Scalar;
  ControlModel<A> model{};
  set_joint(p, model.axis.proximal, false);
  set_joint(p, model.axis.distal, true);
  model.axis.stiffness = S(p.stiffness);
  model.axis.pretension = S(p.pretension);
  model.axis.handle_range = S(p.handle_range);
  model.spool_radius = S(p.spool_radius);
  model.share[0] = S(p.share_sheath);
  model.share[1] = S(p.share_handle);
  model.share[2] = S(p.share_stem);
  model.share[3] = S(p.share_tip);
  model.vertex = S(p.vertex_coefficient);
  model.base_wrap = S(p.base_wrap);
  model.sheath = S(p.sheath_coefficient);
  model.sheath_bend = S(p.sheath_bend);
  model.sheath_bend_rate = S(p.sheath_bend_rate);
  model.passing = S(p.passing_coefficient);
  model.stop = model.taken(S(p.output_stop));
  const S slope = model.axis.distal.excursion_slope();
  model.yielding = S(1) + model.axis.distal.passive_stiffness() / (S(2) * model.axis.stiffness * slope * slope);
  return model;
}

/// Of a reading over a motor's pull: the geometric mean of both edges of friction is the tension, at the pretension.
template <class S, class P>
constexpr HomingDrive<S> homing_drive(const P& p) {
  const S e = S(p.homing_efficiency), f = S(p.homing_friction), share = f / S(p.pretension);
  return {e, f, S(1) / sqrt((e - share) * (S(1) / e + share)), S(p.homing_play)};
}

template <class A, class P>
constexpr AxisController<A> axis_controller(const P& all, int number) {
  using S = A::Scalar;
  const auto& p = all.axis[number];
  const S period = S(all.period);
  const S hand_travel = S(tuning::hand_travel) * S(p.hand_play);
  AxisController<A> axis{};
  const ControlModel<A> model = control_model<A>(p);
  axis.friction = {
      model,
      {S(p.hand_play), S(p.sheath_play), larger(S(0.8) * S(p.spool_noise) * S(p.spool_radius), S(p.sheath_play)),
       S(p.play), S(tuning::smoothing) * period, S(p.friction_scale_std), S(p.reference_std), S(p.compliance_std),
       S(p.slack_tension), S(p.cell_gain_std), S(p.bias_std), S(p.hand_play)}};
  axis.compensator.model = model;
  axis.compensator.settings = {S(p.gain),
                               S(tuning::breakaway_angle) * S(p.tip_frequency),
                               S(p.position_gain),
                               S(p.dead_band),
                               S(p.tendon_speed),
                               S(all.acceleration_limit) * S(p.spool_radius),
                               S(p.drive_time_constant),
                               S(p.common_stroke) / S(tuning::stroke_time),
                               S(p.common_stroke),
                               S(p.common_stroke) * S(p.stiffness) / S(p.pretension),
                               S(p.least_tension),
                               S(p.tension_limit),
                               S(p.force_limit),
                               S(p.assistance),
                               hand_travel,
                               S(p.tremor_delay),
                               S(p.tremor_gain)};
  axis.compensator.envelope = {model,
                               {model.stroke_for(S(tuning::notable_angle) * model.axis.distal.moment_arm(S(0))),
                                larger(S(tuning::tremor_quickest * tuning::tremor_half_period),
                                       S(tuning::swing_half_periods * pi) / S(p.tip_frequency))}};
  axis.homing = {model,
                 {S(p.homing_speed), S(p.homing_stroke), S(p.homing_overshoot), S(p.homing_tolerance),
                  S(p.homing_stroke) / S(p.homing_speed) + S(tuning::homing_time), S(p.homing_jog), S(p.homing_travel),
                  S(p.homing_offset), S(p.homing_notice), hand_travel, S(p.drive_time_constant), homing_drive<S>(p),
                  S(tuning::still_time)}};
  Watch<S>& watch = axis.watch;
  watch.set_readings(p);
  watch.drive = {S(p.spool_radius), S(all.speed_limit), S(all.acceleration_limit), S(p.drive_time_constant), S(0)};
  watch.mean_band = S(p.mean_band);
  watch.period = period;
  return axis;
}

/// Whether an axis's parameters keep their bounds and fit each other; whether they describe the instrument is for the
/// caller to know.
template <class S, class P>
constexpr bool plausible(const P& p, bool continuum) {
  // In the precision of the controller: what is finite in double need not be in float.
  const auto positive = [](const S& v) { return v > S(0) && is_finite(v); };
  const auto not_negative = [](const S& v) { return v >= S(0) && is_finite(v); };
  const S shares = S(p.share_sheath) + S(p.share_handle) + S(p.share_stem) + S(p.share_tip);
  const S friction = S(p.sheath_coefficient) * (S(p.sheath_bend) + S(p.sheath_bend_rate) * S(p.handle_range)) +
                     S(p.vertex_coefficient) * (S(2) * S(p.base_wrap) + S(p.handle_range) + S(pi)) +
                     S(p.passing_coefficient) * (S(p.handle_range) + S(pi));
#define TENODESIS_KEEPS_BOUND(name, unit, bound, meaning) bound(S(p.name)) &&
  return TENODESIS_AXIS_PARAMETERS(TENODESIS_KEEPS_BOUND) abs(shares - S(1)) < S(0.01) &&
         (!continuum || S(p.backbone_length) > S(0)) && S(p.handle_range) < S(pi) && friction <= most_friction<S> &&
         S(p.pretension) < S(p.tension_limit) && S(p.homing_overshoot) < S(1) && S(p.assistance) <= S(1) &&
         S(p.homing_efficiency) <= S(1) && S(p.homing_friction) < S(p.homing_efficiency) * S(p.pretension) &&
         S(p.tremor_gain) <= S(2) && S(p.tremor_delay) <= S(tuning::tremor_quickest * tuning::tremor_half_period) &&
         S(p.limit[static_cast<int>(Fault::tick_late)].threshold) <= longest_tick<S>;
#undef TENODESIS_KEEPS_BOUND
}

}  // namespace detail

/// Sets a controller up; false, and the controller unusable, if the parameters are not plausible.
template <class A, int most_axes, class P>
bool configure(const P& p, Controller<A, most_axes>& controller) {
  using S = A::Scalar;
  if (p.axes < 1 || p.axes > static_cast<unsigned>(most_axes)) return false;
  if (p.observer > 2 || p.law > 4 || p.actuation > 1 || p.safe_state > 1 || p.stop > 1 || p.own_clock > 1 ||
      p.homed > 1 || p.observe > 2)
    return false;
  controller.axes = static_cast<int>(p.axes);
  controller.own_clock = p.own_clock == 1;
  controller.homed = p.homed == 1;
  controller.supervisor = {
      S(p.speed_limit), S(p.acceleration_limit), S(p.engage_time),   S(p.tension_limit), SafeState(p.safe_state),
      StopMode(p.stop), S(p.hold_time),          S(p.neutral_speed), S(p.relief),        S(p.period)};
  if (!controller.supervisor.valid()) return false;
  constexpr bool continuum = requires(A a) { a.distal.backbone_length; };
  for (int n = 0; n < controller.axes; ++n) {
    if (!detail::plausible<S>(p.axis[n], continuum)) return false;
    AxisController<A>& axis = controller.axis[n];
    axis = detail::axis_controller<A>(p, n);
    if (n == 0) controller.supervisor.stretch = S(1) / (axis.model().axis.stiffness * axis.model().spool_radius);
    axis.observer = ObserverKind(p.observer);
    axis.compensator.law = ControlLaw(p.law);
    axis.compensator.actuation = Actuation(p.actuation);
    axis.compensator.observe = Observe(p.observe);
    // Jogs need motion that is not faded in.
    axis.homing.settings.rest_time = larger(axis.homing.settings.rest_time, S(p.engage_time));
    if (!axis.watch.valid()) return false;
  }
  return true;
}

}  // namespace tenodesis

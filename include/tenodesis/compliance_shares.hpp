#pragma once
// Where along a tendon its compliance is, as strokes show it.
//
// After a stroke has reversed every contact sticks, and the spool works against what is before it: once the sheath
// slips, against all that is before the handle's joint. So the slope of the tension tells this share, before the joint
// slips, too. Friction alone is not enough to tell it: the lengths of slipping tendons depend on friction times the
// compliance beyond.

#include "tenodesis/friction_memory.hpp"

namespace tenodesis {

/// Corrects the shares by a measurement; moved: what a tendon seems to have moved at the handle's joint, where it
/// sticks, m.
template <class A, class S>
void correct_shares(const ControlModel<A>& model, const FrictionSettings<S>& settings, const TendonMemory<S>& one,
                    const S& moved, FrictionMemory<S>& memory) {
  const S first = one.tension[0] - one.reversal.tension[0];
  if (abs(first) < S(tuning::share_tension) * settings.slack_below) return;
  S* const share = memory.share;
  const S before = share[0] + share[1];
  const S stretched = memory.compliance * (share[0] * first + share[1] * (one.tension[1] - one.reversal.tension[1]));
  const S by = stretched / before;
  const S unsure =
      memory.covariance[2][2] / (memory.compliance_scale * memory.compliance_scale) + square(S(tuning::share_error));
  const S noise = settings.length_noise * settings.length_noise + stretched * stretched * unsure;
  const S spread = by * by * memory.share_variance + noise;
  if (moved * moved > square(S(tuning::outlier)) * spread) return;
  const S least = S(0.5) * (model.share[0] + model.share[1]);
  const S most = S(2) * least + S(tuning::most_share_of_stem) * model.share[2];
  // So steep only where the tendon slips at the joint, friction being less than assumed.
  if (before + moved / by > most) return;
  const S found = clamp(before + by * memory.share_variance * moved / spread, least, most);
  memory.share_variance = memory.share_variance * noise / spread;
  // The tendons have not moved.
  const S grown = found / before - S(1);
  for (auto& each : memory.tendon) {
    S moves(0);
    for (int j = 0; j < 2; ++j) {
      moves = moves + grown * share[j] * memory.compliance * (each.tension[j] - model.axis.pretension);
      each.slip[j].dragged = each.slip[j].dragged - moves;
    }
  }
  for (int j = 0; j < 2; ++j) share[j] = share[j] + grown * share[j];
  share[2] = share[2] + before - found;
}

/// Learns the shares from a tendon that sticks at the handle's joint; position: of both tendons there, m.
template <class A, class S>
void learn_shares(const ControlModel<A>& model, const FrictionSettings<S>& settings, const S* position,
                  FrictionMemory<S>& memory) {
  for (int i = 0; i < 2; ++i) {
    auto& one = memory.tendon[i];
    auto& since = one.reversal;
    if (since.stick == Stick::unknown) continue;
    if (memory.smooth.handle_angle != since.handle_angle) {
      since.stick = Stick::unknown;
      continue;
    }
    // Before the sheath slips, the tension beyond it is not known well enough.
    if ((one.tension[0] - one.tension[1]) * since.direction < S(0)) continue;
    const S begin = S(tuning::from_sheath) * memory.nominal[0];
    const S end = S(tuning::to_handle) * smaller(memory.scale, S(1)) * (memory.nominal[0] + memory.nominal[1]);
    if (since.stick == Stick::all) {
      if (!since.beyond(one.tension[0], small_exp(begin))) continue;
      const bool late = begin > end || since.beyond(one.tension[0], small_exp(end));
      since.stick = late ? Stick::unknown : Stick::handle;
      since.position = position[i];
      for (int j = 0; j < 2; ++j) since.tension[j] = one.tension[j];
    } else if (since.beyond(one.tension[0], small_exp(end))) {
      since.stick = Stick::unknown;
      correct_shares(model, settings, one, position[i] - since.position, memory);
    }
  }
}

}  // namespace tenodesis

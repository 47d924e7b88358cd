#pragma once
// The controller of all joints of a chain: observer, law and supervisor in one tick; and it from parameters by name.

#include "tenodesis/joint_law.hpp"
#include "tenodesis/joint_table.h"

namespace tenodesis {

/// What a controller of joints takes in a tick.
template <class S, int N, int M>
struct JointInput {
  JointMeasurement<S, N, M> measured{};
  S commanded[N]{};   ///< of a tool without a handle, rad
  const S* wound{};   ///< by commands to the spools, m; null: there are none
  const S* direct{};  ///< velocities of the spools that pass in place of the law's, rad/s; null: there are none
  Request request{};
  bool compensates{};  ///< else the motors only follow the targets
  S since{};           ///< the last tick, s
};

/// Controller of a chain W whose tendons have at most so many contacts.
template <class W, int most_contacts>
struct JointController {
  using S = W::S;
  static constexpr int N = W::joints, M = W::tendons;
  using Input = JointInput<S, N, M>;

  struct Memory {
    JointMemory<S, N, M, most_contacts> observer{};
    JointLawMemory<S, N, M> law{};
    JointSupervisorMemory<S, M> supervisor{};
    bool homed{};     ///< what homing has learned counts
    S aim[N]{};       ///< rad
    S spool[M]{};     ///< spool angles between their encoders' steps, rad
    S turning[M]{};   ///< speeds of the spools by what was sent, rad/s
    S velocity[M]{};  ///< of the spools, rad/s; finite whatever is measured

    /// Latched faults in a fault, otherwise those present.
    std::uint32_t faults() const {
      const auto& state = supervisor.state;
      return state.operating == OperatingState::fault ? state.faults : state.present;
    }
  };

  JointObserver<W, most_contacts> observer{};
  JointLaw<W> law{};
  JointSupervisor<W> supervisor{};
  S spool_step{};   ///< of the spools' encoders, rad
  S spool_share{};  ///< of what was sent, by which the spools' speed changes in a tick

  template <bool with_load>
  void step(const Input& in, Memory& memory) const {
    S wanted[M]{};
    law.aim(in.commanded, in.wound, memory.aim);
    auto measured = in.measured;
    for (int m = 0; m < supervisor.tendons; ++m) measured.spool_angle[m] = follow_spool(m, in.measured, memory);
    if (in.request == Request::home) {
      memory.observer.learned = {};
      memory.homed = false;
    }
    const bool learns = memory.law.homing > S(0);
    const auto& found = observer.template update<with_load>(measured, memory.observer, learns);
    supervisor.inspect(in.measured, found, observer.chain.handles, memory.homed, in.since, memory.supervisor);
    const bool works = supervisor.works(in.request, memory.law.beyond, in.since, memory.supervisor);
    const bool passes = in.direct != nullptr;
    if (passes) memory.law = {};
    for (int m = 0; m < supervisor.tendons && works && passes; ++m) wanted[m] = in.direct[m];
    auto& state = memory.supervisor.state;
    S& homing = memory.law.homing;
    homing = !works || !state.homing ? S(0) : in.request == Request::home ? law.homing_time : homing;
    const bool compensates = in.compensates && !state.homing;
    if (works && !passes) law.update(in.measured, found, memory.aim, compensates, memory.law, wanted);
    if (!works) memory.law.started = false;
    homing = larger(homing - law.period, S(0));
    if (homing == S(0) && state.homing) {
      memory.homed = works && !passes;
      Supervisor<S>::finish_homing(state);
    }
    supervisor.command(in.measured, wanted, !passes, in.since, memory.supervisor, memory.velocity);
  }

  /// Sets all but chain and routes by parameters that are named as in joint_table.h; false if they are out of bounds.
  template <class P>
  bool set_numbers(const P& p) {
    // In the precision of the controller: what is finite in double need not be in float.
    const auto positive = [](const S& v) { return v > S(0) && is_finite(v); };
    const auto not_negative = [](const S& v) { return v >= S(0) && is_finite(v); };
#define TENODESIS_KEEPS_BOUND(name, unit, bound, meaning) bound(S(p.name)) &&
    if (!(TENODESIS_JOINTS_PARAMETERS(TENODESIS_KEEPS_BOUND) S(p.smoothing) <= S(1))) return false;
#undef TENODESIS_KEEPS_BOUND
    S least(0);
    for (const S& one : observer.chain.pretension) least = larger(least, S(1e-3) * one);
    const S constant(p.constant);
    observer.law.capstan = {constant};
    observer.law.stribeck = {constant, S(p.static_ratio), S(p.stribeck_speed), S(p.memory)};
    observer.law.power = {constant, S(p.load_index), S(p.reference_tension), S(p.bending_loss), least};
    observer.sheath_bend_rate = S(p.sheath_bend_rate);
    observer.play = S(p.play);
    spool_step = S(p.spool_step);
    observer.handle_play = S(p.handle_play);
    observer.tension_play = S(p.tension_play);
    observer.smoothing = S(p.smoothing);
    observer.deviations = {S(p.tension_deviation),   S(p.length_deviation), S(p.friction_deviation),
                           S(p.stiffness_deviation), S(p.force_deviation),  S(p.moment_deviation),
                           S(p.grip_deviation),      S(p.imbalance)};
    law.chain = observer.chain;
    law.rate = S(p.rate);
    law.gain = S(p.gain);
    law.speed = S(p.speed);
    observer.spool_radius = law.spool_radius = S(p.spool_radius);
    law.tension_limit = S(p.tension_limit);
    law.least_tension = S(p.least_tension);
    law.deviations = S(p.deviations);
    law.homing_time = S(p.homing_time);
    law.homing_rise = S(p.homing_rise);
    auto& states = supervisor.states;
    auto& watch = supervisor.watch;
    law.period = states.period = watch.period = S(p.period);
    spool_share = law.period / (S(p.drive_time_constant) + law.period);
    supervisor.stroke_limit = S(p.stroke_limit);
    supervisor.unlike = S(p.unlike_friction);
    states.speed_limit = S(p.speed_limit);
    states.acceleration_limit = S(p.acceleration_limit);
    states.engage_time = S(p.engage_time);
    states.tension_limit = S(p.tension_of_fault);
    watch.set_readings(p);
    watch.drive = {S(p.spool_radius), S(p.speed_limit), S(p.acceleration_limit), S(p.drive_time_constant), S(0)};
    return states.valid() && watch.valid();
  }

  /// Sets chain and routes by the parameters of joints.h; false if they do not fit each other.
  template <class P>
  bool set_routes(const P& p) {
    W& chain = observer.chain;
    chain.handles = static_cast<int>(p.handles);
    for (int i = 0; i < N; ++i) {
      const auto& from = p.joint[i];
      if (from.mechanism > 2 || p.handle[i] > 2) return false;
      chain.handle[i] = Mechanism(p.handle[i]);
      chain.joint[i] = {.mechanism = Mechanism(from.mechanism),
                        .within = from.within != 0,
                        .parent = static_cast<int>(from.parent) - 1,
                        .axis = {S(from.axis_x), S(from.axis_y), S(from.axis_z)},
                        .offset = S(from.offset),
                        .chord = S(from.chord),
                        .length = S(from.length),
                        .stiffness = S(from.stiffness),
                        .hardening = S(from.hardening),
                        .tie = {S(from.tie_ratio), S(from.tie_stiffness), static_cast<int>(from.tied_to) - 1},
                        .share = S(from.share),
                        .grip = S(from.grip)};
    }
    supervisor.tendons = M;
    for (int m = 0; m < M; ++m) set_tendon(p.tendon[m], m);
    if (!in_bounds()) return false;
    for (int m = 0; m < M; ++m)
      if (chain.grows(m)) chain.curves.at[m].rest_at(chain.pretension[m]);
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j < N; ++j) law.prepared.within[i][j] = S(p.within[i][j]);
      for (int j = 0; j < N; ++j) law.prepared.response[i][j] = S(p.response[i][j]);
      for (int m = 0; m < M; ++m) law.prepared.settled[i][m] = S(p.settled[i][m]);
    }
    return true;
  }

  /// Whether all numbers of joints and contacts are of some that there are: memory may be damaged.
  bool in_bounds() const {
    const W& chain = observer.chain;
    const auto within = [](int number, int from, int end) { return number >= from && number < end; };
    bool sound =
        within(chain.handles, 0, N + 1) && within(law.chain.handles, 0, N + 1) && within(supervisor.tendons, 0, M + 1);
    for (int i = 0; i < N; ++i) {
      const auto& joint = chain.joint[i];
      sound = sound && within(joint.parent, -1, i) && within(joint.tie.to, -1, i) && (!joint.within || i > 0);
    }
    // With the sheath, which is -1.
    const auto joints = static_cast<unsigned>(N + chain.handles);
    for (int m = 0; m < M; ++m) {
      sound = sound && within(observer.contacts[m], 0, most_contacts + 1) &&
              within(chain.curves.at[m].entries, 0, most_stretch_entries + 1);
      for (int j = 0; j < observer.contacts[m] && sound; ++j)
        sound = static_cast<unsigned>(observer.passage[m][j].joint + 1) <= joints;
    }
    return sound;
  }

 private:
  // Where a spool is between two steps of its encoder, by what was sent: one step may be more than what reverses the
  // contact beside it.
  S follow_spool(int m, const JointMeasurement<S, N, M>& measured, Memory& memory) const {
    const S read = measured.spool_angle[m], half = spool_step * S(0.5);
    if (!is_finite(read)) return read;
    memory.turning[m] = memory.turning[m] + spool_share * (memory.velocity[m] - memory.turning[m]);
    memory.spool[m] = clamp(memory.spool[m] + law.period * memory.turning[m], read - half, read + half);
    return memory.spool[m];
  }

  template <class P>
  void set_tendon(const P& from, int m) {
    W& chain = observer.chain;
    chain.stiffness[m] = S(from.stiffness);
    chain.pretension[m] = S(from.pretension);
    chain.motor[m] = from.motor != 0;
    for (int i = 0; i < N; ++i) {
      chain.arm[m][i] = S(from.arm[i]);
      chain.handle_arm[m][i] = S(from.handle_arm[i]);
    }
    auto& curve = chain.curves.at[m];
    curve.entries = static_cast<int>(from.curve_entries);
    for (int k = 0; k < most_stretch_entries; ++k) {
      curve.tension[k] = S(from.curve_tension[k]);
      curve.ratio[k] = S(from.curve_ratio[k]);
    }
    observer.contacts[m] = static_cast<int>(from.contacts);
    for (int j = 0; j < most_contacts; ++j) {
      const auto& at = from.contact[j];
      observer.passage[m][j] = {
          static_cast<int>(at.joint) - 1, S(at.coefficient), S(at.wrap), S(at.share), S(at.arm), S(at.wound)};
      observer.compliance[m][j] = S(at.compliance);
    }
    if (observer.contacts[m] >= 0 && observer.contacts[m] <= most_contacts)
      observer.compliance[m][observer.contacts[m]] = S(from.end_compliance);
  }
};

}  // namespace tenodesis

#pragma once
// The functions of statics under one signature: arrays of scalars in, scalars and a status out.
//
// A held operation needs the equilibrium at a held handle, which is solved for many points together; a direct operation
// is evaluated point by point.

#include "tenodesis/statics.hpp"

namespace tenodesis::bindings {

/// A held operation's inputs, in this order.
enum HeldInput {
  held_handle_angle,
  held_force,
  held_radial_force,
  held_agonist_wound,
  held_antagonist_wound,
  held_inputs
};

template <class S>
Load<S> held_load(const S* in) {
  return {in[held_force], in[held_radial_force]};
}

template <class S>
Stroke<S> held_stroke(const S* in) {
  return {in[held_agonist_wound], in[held_antagonist_wound]};
}

struct OutputAngle {
  static constexpr const char* name = "output_angle";
  static constexpr int outputs = 1;
  template <class A, class S>
  static void at(const A& axis, const S&, const TendonPair<S>&, const S& x, S* out) {
    out[0] = axis.distal.angle(x);
  }
};

struct TendonTensions {
  static constexpr const char* name = "tensions";
  static constexpr int outputs = 2;
  template <class A, class S>
  static void at(const A&, const S&, const TendonPair<S>& pair, const S& x, S* out) {
    const Tensions<S> tension = pair.tensions(x);
    out[0] = tension.agonist;
    out[1] = tension.antagonist;
  }
};

struct HeldState {
  static constexpr const char* name = "equilibrium";
  static constexpr int outputs = 3;
  template <class A, class S>
  static void at(const A& axis, const S& handle_angle, const TendonPair<S>& pair, const S& x, S* out) {
    OutputAngle::at(axis, handle_angle, pair, x, out);
    TendonTensions::at(axis, handle_angle, pair, x, out + 1);
  }
};

struct TorqueTransmissibility {
  static constexpr const char* name = "torque_transmissibility";
  static constexpr int outputs = 1;
  template <class A, class S>
  static void at(const A& axis, const S& handle_angle, const TendonPair<S>&, const S& x, S* out) {
    out[0] = torque_transmissibility_at(axis, handle_angle, x);
  }
};

template <class S>
Status store(const Result<S>& result, S* out) {
  out[0] = result.value;
  return result.status;
}

struct HandleAngle {
  static constexpr const char* name = "handle_angle";
  static constexpr int inputs = held_inputs;
  static constexpr int outputs = 1;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    return store(handle_angle(axis, in[0], held_load(in), held_stroke(in)), out);
  }
};

struct FlexuralStiffness {
  static constexpr const char* name = "flexural_stiffness";
  static constexpr int inputs = 1;
  static constexpr int outputs = 1;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    return store(flexural_stiffness(axis, in[0]), out);
  }
};

struct LossOfDexterity {
  static constexpr const char* name = "loss_of_dexterity";
  static constexpr int inputs = 2;
  static constexpr int outputs = 1;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    return store(loss_of_dexterity(axis, in[0], in[1]), out);
  }
};

struct SlackForce {
  static constexpr const char* name = "slack_force";
  static constexpr int inputs = 1;
  static constexpr int outputs = 1;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    return store(slack_force(axis, in[0]), out);
  }
};

struct SlackLoad {
  static constexpr const char* name = "slack_load";
  static constexpr int inputs = 3;
  static constexpr int outputs = 1;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    return store(slack_load(axis, in[0], Stroke<S>{in[1], in[2]}), out);
  }
};

struct UnloadedAngle {
  static constexpr const char* name = "unloaded_angle";
  static constexpr int inputs = 1;
  static constexpr int outputs = 1;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    return store(unloaded_angle(axis, in[0]), out);
  }
};

struct EstimateOutputAngle {
  static constexpr const char* name = "estimate_output_angle";
  static constexpr int inputs = 6;
  static constexpr int outputs = 1;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    return store(estimate_output_angle(axis, in[0], Tensions<S>{in[1], in[2]}, Stroke<S>{in[3], in[4]}, in[5]), out);
  }
};

template <Actuation actuation, Law law>
struct CompensationStroke {
  static constexpr const char* name =
      law == Law::paper ? "compensation_stroke:paper"
                        : (actuation == Actuation::agonist ? "compensation_stroke:agonist:exact"
                                                           : "compensation_stroke:differential:exact");
  static constexpr int inputs = 3;
  static constexpr int outputs = 1;
  template <class A, class S>
  static Status run(const A& axis, const S* in, S* out) {
    return store(compensation_stroke(axis, Tensions<S>{in[0], in[1]}, in[2], actuation, law), out);
  }
};

template <class... T>
struct List {};

using HeldOperations = List<OutputAngle, TendonTensions, HeldState, TorqueTransmissibility>;
using DirectOperations =
    List<HandleAngle, FlexuralStiffness, LossOfDexterity, SlackForce, SlackLoad, UnloadedAngle, EstimateOutputAngle,
         CompensationStroke<Actuation::agonist, Law::exact>, CompensationStroke<Actuation::differential, Law::exact>,
         CompensationStroke<Actuation::agonist, Law::paper>>;

}  // namespace tenodesis::bindings

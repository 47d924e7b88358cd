// Statics, motions and twins, instantiated without a library: built freestanding, they must not refer to a single
// symbol but memory moves. Controllers are in the C library, of which the same is claimed.

#include "instruments.hpp"
#include "tenodesis/axis_twin.hpp"
#include "tenodesis/kinematics.hpp"
#include "tenodesis/statics.hpp"

static_assert(__STDC_HOSTED__ == 0, "this file is built with -ffreestanding");
#ifdef __cpp_exceptions
#error "this file is built with -fno-exceptions"
#endif
#ifdef __cpp_rtti
#error "this file is built with -fno-rtti"
#endif

using namespace tenodesis;

template <class S, class A>
S everything(const A& axis, const S* in) {
  const Load<S> load{in[0], in[1]};
  const Stroke<S> wound{in[2], in[3]};
  const Tensions<S> tension{in[4], in[5]};
  return output_angle(axis, in[6], load, wound).value + handle_angle(axis, in[6], load, wound).value +
         tensions(axis, in[6], load, wound).value.agonist + torque_transmissibility(axis, in[6], load, wound).value +
         flexural_stiffness(axis, in[6]).value + loss_of_dexterity(axis, in[6], in[0]).value +
         slack_force(axis, in[6]).value + unloaded_angle(axis, in[6]).value +
         estimate_output_angle(axis, in[6], tension, wound).value +
         compensation_stroke(axis, tension, in[6], Actuation::agonist, Law::exact).value +
         compensation_stroke(axis, tension, in[6], Actuation::differential, Law::exact).value;
}

extern "C" float everything_in_float(const float* in) {
  return everything<float>(instruments::real_size<float>(), in) + everything<float>(instruments::pulley<float>(), in) +
         everything<float>(instruments::continuum<float>(), in);
}

extern "C" double everything_in_double(const double* in) {
  return everything<double>(instruments::real_size<double>(), in) +
         everything<double>(instruments::pulley<double>(), in) +
         everything<double>(instruments::continuum<double>(), in);
}

extern "C" void derivatives(const double* in, double* out) {
  using D = Dual<double, 2>;
  D row[7];
  for (int i = 0; i < 7; ++i) row[i] = D(in[i]);
  row[0] = D::variable(in[0], 0);
  row[6] = D::variable(in[6], 1);
  const D value = everything<D>(instruments::real_size<D>(), row) + everything<D>(instruments::continuum<D>(), row);
  out[0] = value.slope[0];
  out[1] = value.slope[1];
}

template <class A>
auto a_motion(const A& axis, const typename A::Scalar* in) {
  using S = A::Scalar;
  const Chain<S, 2> chain = instruments::chain_of(axis, 2, instruments::Toward::yaw);
  const Posture<S, 2> at{in[3], in[4], in[5], in[6], {in[7], in[8]}, in[9], {in[10], in[11]}};
  const Bodies<S, 2> found = bodies(chain, at);
  return found.grip[1].position.x + jacobian(chain, at, 1).linear[4].x +
         inverse(chain, found.end[1], in[5]).posture.roll;
}

extern "C" float motions_in_float(const float* in) {
  return a_motion(instruments::real_size<float>(), in) + a_motion(instruments::pulley<float>(), in) +
         a_motion(instruments::continuum<float>(), in);
}

extern "C" double motions_in_double(const double* in) {
  return a_motion(instruments::real_size<double>(), in) + a_motion(instruments::pulley<double>(), in) +
         a_motion(instruments::continuum<double>(), in);
}

template <class S, class A, class FrictionLaw>
S a_step(const A& axis, const FrictionLaw& law, const S* in) {
  AxisTwin<A, FrictionLaw> twin{};
  set_axis(twin, axis, {in[0], in[1], in[2], in[3], in[4]});
  set_tip(twin, in[5], in[6], in[7], in[8]);
  set_rig(twin, in[17], in[18]);
  twin.law = law;
  for (auto& tendon : twin.tendon)
    for (S& stiffness : tendon.stiffness.at) stiffness = axis.stiffness * S(5);
  twin.hand = {in[9], in[10], in[11]};
  twin.drive = {in[12], in[13], in[14], in[15], in[16]};
  twin.time_step = in[19];
  twin.quasi_static = in[20] > S(0);
  twin.prepare();
  auto state = twin.rest(1);
  const auto before = state;
  const Command<S> command{in[21], in[22], in[23], in[24], {in[25], in[26]}, S(0), {}, {in[34], in[35], in[36]}};
  const Status status = twin.step(command_of<typename AxisTwin<A, FrictionLaw>::Command>(command), state);
  return status == Status::ok ? state.measured_angle[0] + twin.residual(before, state) + twin.handle_torque(state, 0) +
                                    transmit(Band<S>{in[27], S(0), S(0)}, in[28], in[29])
                              : S(0);
}

/// The law that is chosen as it runs has all others in it.
template <class S, class A>
S a_step_by_any_law(const A& axis, const S* in) {
  using Law = ChosenLaw<S>;
  const Law law{typename Law::Kind(static_cast<unsigned char>(in[35])),
                {in[30]},
                {in[30], in[31], in[32], in[33]},
                {in[30], in[31], in[32], in[33], in[34]}};
  return a_step<S>(axis, law, in);
}

extern "C" float twins_in_float(const float* in) {
  return a_step_by_any_law<float>(instruments::real_size<float>(), in) +
         a_step_by_any_law<float>(instruments::pulley<float>(), in) +
         a_step_by_any_law<float>(instruments::continuum<float>(), in);
}

extern "C" double twins_in_double(const double* in) {
  return a_step_by_any_law<double>(instruments::real_size<double>(), in) +
         a_step_by_any_law<double>(instruments::pulley<double>(), in) +
         a_step_by_any_law<double>(instruments::continuum<double>(), in);
}

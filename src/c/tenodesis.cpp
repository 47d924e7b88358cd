// The C interface: a controller of any mechanism in memory that the caller owns.

#include "tenodesis/tenodesis.h"

#include <new>

#include "tenodesis/flight_recorder.hpp"
#include "tenodesis/parameters.hpp"

namespace {

using namespace tenodesis;
using S = tenodesis_real;

constexpr int after_fault = 10;

// What the caller's memory holds.
struct Session {
  template <class A>
  struct Of {
    Controller<A, TENODESIS_AXES> controller;
    ControllerState<S, TENODESIS_AXES> state;
  };

  Session() : gear{} {}

  std::uint64_t mark{};
  std::uint32_t joint_type{};
  FlightRecorder<tenodesis_record, TENODESIS_RECORDS, TENODESIS_RECORD_TICKS, after_fault> recorder{};
  union {
    Of<GearAxis<S>> gear;
    Of<PulleyAxis<S>> pulley;
    Of<ContinuumAxis<S>> continuum;
  };
};

static_assert(sizeof(Session) <= sizeof(tenodesis_controller), "TENODESIS_STORAGE_WORDS is too small");
static_assert(fault_count == TENODESIS_FAULTS);
static_assert(static_cast<int>(Fault::homing_failed) == TENODESIS_FAULT_HOMING_FAILED);
static_assert(static_cast<int>(ControlLaw::robust) == TENODESIS_LAW_ROBUST);
static_assert(static_cast<int>(Actuation::differential) == TENODESIS_ACTUATION_DIFFERENTIAL);
static_assert(static_cast<int>(ObserverKind::friction) == TENODESIS_OBSERVER_FRICTION);
static_assert(static_cast<int>(Request::clear) == TENODESIS_REQUEST_CLEAR);
static_assert(static_cast<int>(OperatingState::fault) == TENODESIS_FAULT);
static_assert(static_cast<int>(SafeState::neutral) == TENODESIS_SAFE_NEUTRAL);
static_assert(channel_count == 5);

// "tenodesi", with the version and the precision: memory of another build is not ours.
constexpr std::uint64_t mark = 0x74656e6f64657369U ^ (std::uint64_t(TENODESIS_VERSION) << 8U) ^ sizeof(S);

Session* session_of(tenodesis_controller* controller) {
  auto* session = reinterpret_cast<Session*>(controller);
  return session->mark == mark && session->joint_type <= TENODESIS_CONTINUUM ? session : nullptr;
}
const Session* session_of(const tenodesis_controller* controller) {
  return session_of(const_cast<tenodesis_controller*>(controller));
}

template <class Session, class Work>
auto with(Session& session, const Work& work) {
  switch (session.joint_type) {
    case TENODESIS_TENDON_GEAR:
      return work(session.gear);
    case TENODESIS_TENDON_PULLEY:
      return work(session.pulley);
    default:
      return work(session.continuum);
  }
}

template <class A>
bool set_up(const tenodesis_parameters& parameters, Session::Of<A>& own) {
  new (&own) Session::Of<A>{};
  if (!configure(parameters, own.controller)) return false;
  own.state = own.controller.start();
  return true;
}

void put(const ControlOutput<S, TENODESIS_AXES>& from, tenodesis_output& to) {
  for (int n = 0; n < TENODESIS_AXES; ++n) {
    const Estimate<S>& estimate = from.axis[n].estimate;
    to.axis[n] = {{from.axis[n].spool_velocity[0], from.axis[n].spool_velocity[1]},
                  estimate.output_angle,
                  estimate.output_angle_std,
                  estimate.tip_force,
                  estimate.tip_force_std,
                  estimate.friction_scale,
                  estimate.friction_scale_std,
                  from.axis[n].faults,
                  0};
  }
  to.state = static_cast<std::uint32_t>(from.state);
  to.homed = from.homed ? 1 : 0;
  to.homing = from.homing ? 1 : 0;
  to.faults = from.faults;
  to.first_faults = from.first_faults;
}

}  // namespace

int tenodesis_init(tenodesis_controller* controller, const tenodesis_parameters* parameters) {
  if (controller == nullptr || parameters == nullptr) return TENODESIS_NULL;
  auto* session = new (controller) Session;
  if (parameters->size != sizeof(tenodesis_parameters) || parameters->version != TENODESIS_VERSION)
    return TENODESIS_BAD_VERSION;
  if (parameters->joint_type > TENODESIS_CONTINUUM) return TENODESIS_BAD_PARAMETER;
  session->joint_type = parameters->joint_type;
  if (!with(*session, [&](auto& own) { return set_up(*parameters, own); })) return TENODESIS_BAD_PARAMETER;
  session->mark = mark;
  return TENODESIS_OK;
}

int tenodesis_step(tenodesis_controller* controller, const tenodesis_input* input, tenodesis_output* output) {
  if (output != nullptr) *output = {};
  if (controller == nullptr || input == nullptr || output == nullptr) return TENODESIS_NULL;
  Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  const bool known = input->request <= TENODESIS_REQUEST_CLEAR;

  ControlInput<S, TENODESIS_AXES> in{};
  in.time = input->time;
  in.request = known ? Request(input->request) : Request::none;
  tenodesis_record record{};
  record.time = input->time;
  for (int n = 0; n < TENODESIS_AXES; ++n) {
    const tenodesis_measurement& from = input->axis[n];
    in.axis[n] = {from.handle_angle, {from.tension[0], from.tension[1]}, {from.spool_angle[0], from.spool_angle[1]}};
    record.measured[n] = from;
  }
  ControlOutput<S, TENODESIS_AXES> out{};
  with(*session, [&](auto& own) { return own.controller.step(in, own.state, out); });
  put(out, *output);

  for (int n = 0; n < TENODESIS_AXES; ++n) {
    for (int i = 0; i < 2; ++i) record.spool_velocity[n][i] = out.axis[n].spool_velocity[i];
    record.output_angle[n] = out.axis[n].estimate.output_angle;
  }
  record.state = output->state;
  record.faults = output->faults;
  const bool fault = out.state == OperatingState::fault;
  if (!fault && session->recorder.fault_place() >= 0) session->recorder.rearm();
  session->recorder.note(record, fault);
  return known ? TENODESIS_OK : TENODESIS_BAD_REQUEST;
}

int tenodesis_reset(tenodesis_controller* controller) {
  if (controller == nullptr) return TENODESIS_NULL;
  Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  session->recorder.rearm();
  with(*session, [](auto& own) { own.state = own.controller.start(); });
  return TENODESIS_OK;
}

int tenodesis_watchdog(const tenodesis_controller* controller, uint64_t since_last_step) {
  if (controller == nullptr) return 1;
  const Session* session = session_of(controller);
  if (session == nullptr) return 1;
  const S since = S(since_last_step) * S(1e-9);
  return with(*session, [&](const auto& own) { return own.controller.axis[0].watch.watchdog(since); }) ? 1 : 0;
}

int tenodesis_records(const tenodesis_controller* controller) {
  const Session* session = controller == nullptr ? nullptr : session_of(controller);
  return session == nullptr ? 0 : session->recorder.size();
}

int tenodesis_read_record(const tenodesis_controller* controller, int number, tenodesis_record* record) {
  if (controller == nullptr || record == nullptr) return TENODESIS_NULL;
  const Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  if (number < 0 || number >= session->recorder.size()) return TENODESIS_BAD_PARAMETER;
  *record = session->recorder[number];
  return TENODESIS_OK;
}

int tenodesis_read_counts(const tenodesis_controller* controller, int axis, tenodesis_counts* counts) {
  if (controller == nullptr || counts == nullptr) return TENODESIS_NULL;
  const Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  return with(*session, [&](const auto& own) -> int {
    if (axis < 0 || axis >= own.controller.axes) return TENODESIS_BAD_PARAMETER;
    const auto& watch = own.state.axis[axis].watch;
    for (int n = 0; n < fault_count; ++n) counts->faults[n] = watch.count[n];
    for (int n = 0; n < channel_count; ++n) counts->bad_samples[n] = watch.bad_samples[n];
    counts->late_ticks = watch.late_ticks;
    return TENODESIS_OK;
  });
}

uint32_t tenodesis_version(void) { return TENODESIS_VERSION; }
uint32_t tenodesis_real_size(void) { return sizeof(tenodesis_real); }
const char* tenodesis_fault_name(uint32_t number) {
  return name(Fault(static_cast<unsigned char>(number < 255 ? number : 255)));
}

// The C interface: a controller of any mechanism in memory that the caller owns.

#include "tenodesis/tenodesis.h"

#include <cstring>
#include <new>
#include <type_traits>

#include "tenodesis/caller_memory.hpp"
#include "tenodesis/check_word.hpp"
#include "tenodesis/current.hpp"
#include "tenodesis/flight_recorder.hpp"
#include "tenodesis/parameters.hpp"

namespace {

using namespace tenodesis;
using S = tenodesis_real;

constexpr int after_fault = 10;

using Recorder = FlightRecorder<tenodesis_record, TENODESIS_RECORDS, TENODESIS_RECORD_TICKS, after_fault>;

// Contents of the caller's memory.
struct Session {
  template <class A>
  struct Of {
    Controller<A, TENODESIS_AXES> controller;
    ControllerState<S, TENODESIS_AXES> state;
  };

  Session() : gear{} {}

  std::uint64_t mark{};
  std::uint32_t joint_type{};
  CheckWord check{};
  Recorder recorder{};
  // Of the last tick: kept, since making them anew costs every tick more than a hundred bytes to clear.
  ControlInput<S, TENODESIS_AXES> in{};
  ControlOutput<S, TENODESIS_AXES> out{};
  union {
    Of<GearAxis<S>> gear;
    Of<PulleyAxis<S>> pulley;
    Of<ContinuumAxis<S>> continuum;
  };
};

static_assert(sizeof(Session) <= sizeof(tenodesis_controller), "TENODESIS_STORAGE_WORDS is too small");
static_assert(alignof(Session) <= alignof(tenodesis_controller));
static_assert(std::is_trivially_copyable_v<Session> && std::is_trivially_destructible_v<Session>,
              "the caller may copy it, and need not destroy it");
static_assert(fault_count == TENODESIS_FAULTS);
static_assert(static_cast<int>(ControlLaw::robust) == TENODESIS_LAW_ROBUST);
static_assert(static_cast<int>(Actuation::differential) == TENODESIS_ACTUATION_DIFFERENTIAL);
static_assert(static_cast<int>(ObserverKind::friction) == TENODESIS_OBSERVER_FRICTION);
static_assert(static_cast<int>(Observe::automatic) == TENODESIS_OBSERVE_AUTO);
static_assert(static_cast<int>(Request::clear) == TENODESIS_REQUEST_CLEAR);
static_assert(static_cast<int>(OperatingState::fault) == TENODESIS_FAULT);
static_assert(static_cast<int>(SafeState::neutral) == TENODESIS_SAFE_NEUTRAL);
static_assert(static_cast<int>(StopMode::hold) == TENODESIS_STOP_HOLD);
static_assert(channel_count == 5);

// Layouts that are the same for every compiler: no padding, in either precision.
constexpr std::size_t words(std::size_t reals, std::size_t integers) { return reals * sizeof(S) + integers * 4; }
#define TENODESIS_ROW(...) 0,
constexpr char choice_rows[] = {TENODESIS_CHOICES(TENODESIS_ROW)};
constexpr char common_rows[] = {TENODESIS_COMMON_PARAMETERS(TENODESIS_ROW)};
constexpr char axis_rows[] = {TENODESIS_AXIS_PARAMETERS(TENODESIS_ROW)};
#undef TENODESIS_ROW
static_assert(sizeof(tenodesis_axis_parameters) == words(sizeof axis_rows + 2 * (TENODESIS_FAULTS + 1), 0));
static_assert(sizeof(tenodesis_parameters) ==
              words(sizeof common_rows, sizeof choice_rows) + TENODESIS_AXES * sizeof(tenodesis_axis_parameters));
static_assert(sizeof(tenodesis_input) == words(5 * TENODESIS_AXES, 4));
static_assert(sizeof(tenodesis_axis_output) == words(8, 2));
static_assert(sizeof(tenodesis_output) == TENODESIS_AXES * sizeof(tenodesis_axis_output) + words(0, 6));
static_assert(sizeof(tenodesis_record) == words(8 * TENODESIS_AXES, 4));
static_assert(sizeof(tenodesis_counts) == words(0, TENODESIS_FAULTS + 6));

// "tenodesi", with version, precision and size: memory of another build is not accepted.
constexpr std::uint64_t mark = 0x74656e6f64657369U ^ (std::uint64_t(TENODESIS_VERSION) << 8U) ^ sizeof(S) ^
                               (std::uint64_t(sizeof(Session)) << 32U);
// In its place once the parameters have changed.
constexpr std::uint64_t damaged = ~mark;

static_assert(offsetof(Session, mark) == 0);

// The mark says which mechanism, too.
Session* session_of(tenodesis_controller* controller) {
  const std::uint64_t joint_type = mark_of(controller) ^ mark;
  if (joint_type > TENODESIS_CONTINUUM) return nullptr;
  auto* session = std::launder(reinterpret_cast<Session*>(controller));
  return session->joint_type == joint_type ? session : nullptr;
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

void keep_check(Session& session) {
  with(session, [&](const auto& own) { session.check.keep(own.controller); });
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
                  from.axis[n].homing_failure.word()};
  }
  to.state = static_cast<std::uint32_t>(from.state);
  to.homed = from.homed ? 1 : 0;
  to.homing = from.homing ? 1 : 0;
  to.faults = from.faults;
  to.first_faults = from.first_faults;
  to.cut_power = from.cut_power ? 1 : 0;
}

void record(const ControlInput<S, TENODESIS_AXES>& in, const ControlOutput<S, TENODESIS_AXES>& out, int axes,
            Recorder& recorder) {
  const bool fault = out.state == OperatingState::fault;
  if (!fault && recorder.fault_place() >= 0) recorder.rearm();
  tenodesis_record* const kept = recorder.place(fault);
  if (kept == nullptr) return;
  kept->time = in.time;
  kept->state = static_cast<std::uint32_t>(out.state);
  kept->faults = out.faults;
  for (int n = 0; n < axes; ++n) {
    kept->measured[n] = measurement_as<tenodesis_measurement>(in.axis[n]);
    for (int i = 0; i < 2; ++i) kept->spool_velocity[n][i] = out.axis[n].spool_velocity[i];
    kept->output_angle[n] = out.axis[n].estimate.output_angle;
  }
}

}  // namespace

int tenodesis_init(tenodesis_controller* controller, const tenodesis_parameters* parameters) {
  if (!good(controller)) return TENODESIS_BAD_POINTER;
  auto* session = new (controller) Session;
  if (!good(parameters)) return TENODESIS_BAD_POINTER;
  if (parameters->size != sizeof(tenodesis_parameters) || parameters->version != TENODESIS_VERSION)
    return TENODESIS_BAD_VERSION;
  if (parameters->joint_type > TENODESIS_CONTINUUM) return TENODESIS_BAD_PARAMETER;
  session->joint_type = parameters->joint_type;
  if (!with(*session, [&](auto& own) { return set_up(*parameters, own); })) return TENODESIS_BAD_PARAMETER;
  session->mark = mark ^ session->joint_type;
  keep_check(*session);
  return TENODESIS_OK;
}

int tenodesis_step(tenodesis_controller* controller, const tenodesis_input* input, tenodesis_output* output) {
  const bool usable = good(controller, input, output);
  Session* session = usable ? session_of(controller) : nullptr;
  if (session == nullptr) {
    if (good(output)) *output = {};
    if (!usable) return TENODESIS_BAD_POINTER;
    return mark_of(controller) == damaged ? TENODESIS_DAMAGED : TENODESIS_NOT_STARTED;
  }
  const bool known = input->request <= TENODESIS_REQUEST_CLEAR;
  ControlInput<S, TENODESIS_AXES>& in = session->in;
  ControlOutput<S, TENODESIS_AXES>& out = session->out;
  in.time = input->time;
  in.request = known ? Request(input->request) : Request::none;
  int axes = 0;
  with(*session, [&](auto& own) {
    if (!session->check.holds(own.controller)) return;
    axes = own.controller.count();
    for (int n = 0; n < axes; ++n) in.axis[n] = measurement_as<Measurement<S>>(input->axis[n]);
    own.controller.step(in, own.state, out);
  });
  if (axes < 1) {
    session->mark = damaged;
    *output = {};
    return TENODESIS_DAMAGED;
  }
  put(out, *output);
  record(in, out, axes, session->recorder);
  return known ? TENODESIS_OK : TENODESIS_BAD_REQUEST;
}

int tenodesis_reset(tenodesis_controller* controller) {
  if (!good(controller)) return TENODESIS_BAD_POINTER;
  Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  session->recorder.rearm();
  with(*session, [](auto& own) { own.state = own.controller.start(); });
  return TENODESIS_OK;
}

int tenodesis_choose(tenodesis_controller* controller, uint32_t law, uint32_t actuation) {
  if (!good(controller)) return TENODESIS_BAD_POINTER;
  Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  if (law > TENODESIS_LAW_ROBUST || actuation > TENODESIS_ACTUATION_DIFFERENTIAL) return TENODESIS_BAD_PARAMETER;
  const bool taken = with(
      *session, [&](auto& own) { return own.controller.choose(ControlLaw(law), Actuation(actuation), own.state); });
  keep_check(*session);
  return taken ? TENODESIS_OK : TENODESIS_BAD_PARAMETER;
}

int tenodesis_watchdog(const tenodesis_controller* controller, uint64_t since_last_step) {
  const Session* session = good(controller) ? session_of(controller) : nullptr;
  if (session == nullptr) return 1;
  // 32 bits take a single instruction to convert, and no tick may take that long.
  static_assert(longest_tick<double> < UINT32_MAX * 1e-9);
  const S since = S(static_cast<std::uint32_t>(smaller<std::uint64_t>(since_last_step, UINT32_MAX))) * S(1e-9);
  return with(*session, [&](const auto& own) { return own.controller.axis[0].watch.watchdog(since); }) ? 1 : 0;
}

int tenodesis_records(const tenodesis_controller* controller) {
  const Session* session = good(controller) ? session_of(controller) : nullptr;
  return session == nullptr ? 0 : session->recorder.size();
}

int tenodesis_read_record(const tenodesis_controller* controller, int number, tenodesis_record* record) {
  if (!good(controller, record)) return TENODESIS_BAD_POINTER;
  const Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  if (number < 0 || number >= session->recorder.size()) return TENODESIS_BAD_PARAMETER;
  *record = session->recorder[number];
  return TENODESIS_OK;
}

int tenodesis_read_counts(const tenodesis_controller* controller, int axis, tenodesis_counts* counts) {
  if (!good(controller, counts)) return TENODESIS_BAD_POINTER;
  const Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  return with(*session, [&](const auto& own) -> int {
    if (axis < 0 || axis >= own.controller.count()) return TENODESIS_BAD_PARAMETER;
    const auto& watch = own.state.axis[axis].watch;
    for (int n = 0; n < fault_count; ++n) counts->faults[n] = watch.count[n];
    for (int n = 0; n < channel_count; ++n) counts->bad_samples[n] = watch.bad_samples[n];
    counts->late_ticks = watch.late_ticks;
    return TENODESIS_OK;
  });
}

uint32_t tenodesis_phase(const tenodesis_controller* controller, int axis) {
  if (!good(controller)) return 0;
  const Session* session = session_of(controller);
  if (session == nullptr) return 0;
  return with(*session, [&](const auto& own) -> uint32_t {
    if (axis < 0 || axis >= own.controller.count()) return 0;
    return static_cast<uint32_t>(own.state.axis[axis].compensator.shown());
  });
}

tenodesis_real tenodesis_wound(const tenodesis_controller* controller, int axis) {
  const Session* session = good(controller) ? session_of(controller) : nullptr;
  if (session == nullptr) return 0;
  return with(*session, [&](const auto& own) {
    return axis < 0 || axis >= own.controller.count() ? S(0) : own.controller.axis[axis].wound(own.state.axis[axis]);
  });
}

tenodesis_real tenodesis_tension_from_current(tenodesis_real current, tenodesis_real tension_per_current,
                                              tenodesis_real range) {
  return tension_from_current(current, tension_per_current, range);
}

uint32_t tenodesis_version(void) { return TENODESIS_VERSION; }
uint32_t tenodesis_real_size(void) { return sizeof(tenodesis_real); }
const char* tenodesis_fault_name(uint32_t number) { return number < fault_count ? name(Fault(number)) : "unknown"; }
const char* tenodesis_homing_reason_name(uint32_t number) {
  return number < homing_reason_count ? name(HomingReason(number)) : "unknown";
}

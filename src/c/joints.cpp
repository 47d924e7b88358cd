// The C interface of the controller of all joints, of the sizes that it is built with.

#include "tenodesis/joints.h"

#include <cstring>
#include <new>
#include <type_traits>

#include "tenodesis/caller_memory.hpp"
#include "tenodesis/check_word.hpp"
#include "tenodesis/flight_recorder.hpp"
#include "tenodesis/joint_controller.hpp"

namespace {

using namespace tenodesis;
using S = tenodesis_real;

constexpr int N = TENODESIS_JOINTS, M = TENODESIS_TENDONS;

using Controls = JointController<TendonChain<S, N, M>, TENODESIS_CONTACTS>;
using Recorder = FlightRecorder<tenodesis_joints_record, TENODESIS_JOINTS_RECORDS, TENODESIS_RECORD_TICKS, 10>;

struct Session {
  // What is checked for damage.
  struct Constants {
    Controls controls{};
    std::uint32_t compensates{}, shows_load{}, own_clock{}, reserved{};
  };

  std::uint64_t mark{};
  std::uint64_t time{};  // of the last tick, ns
  CheckWord check{};
  std::uint32_t started{};
  Recorder recorder{};
  Constants constants{};
  Controls::Memory memory{};
  // Of the last tick: kept, since making it anew costs every tick more than a hundred bytes to clear.
  Controls::Input in{};
};

static_assert(sizeof(Session) <= sizeof(tenodesis_joints), "TENODESIS_JOINTS_REALS is too small");
static_assert(alignof(Session) <= alignof(tenodesis_joints));
static_assert(std::is_trivially_copyable_v<Session> && std::is_trivially_destructible_v<Session>,
              "the caller may copy it, and need not destroy it");
static_assert(load_components == TENODESIS_LOAD && most_stretch_entries == TENODESIS_CURVE_ENTRIES);

// Layouts that are the same for every compiler: no padding, in either precision.
#define TENODESIS_ROW(...) 0,
constexpr char choice_rows[] = {TENODESIS_JOINTS_CHOICES(TENODESIS_ROW)};
constexpr char number_rows[] = {TENODESIS_JOINTS_PARAMETERS(TENODESIS_ROW)};
#undef TENODESIS_ROW
static_assert(sizeof(tenodesis_joint) == 12 * sizeof(S) + 16);
static_assert(sizeof(tenodesis_contact) == 6 * sizeof(S) + 8);
static_assert(sizeof(tenodesis_tendon) == (3 + 2 * N + 2 * TENODESIS_CURVE_ENTRIES) * sizeof(S) + 16 +
                                              TENODESIS_CONTACTS * sizeof(tenodesis_contact));
static_assert(sizeof(tenodesis_joints_parameters) ==
              4 * (sizeof choice_rows + N + N % 2) +
                  (sizeof number_rows + 2 * (TENODESIS_FAULTS + 1) + 2 * N * N + N * M) * sizeof(S) +
                  N * sizeof(tenodesis_joint) + M * sizeof(tenodesis_tendon));

// "joints", with version, precision and sizes: memory of another build is not accepted.
constexpr std::uint64_t mark = 0x6a6f696e7473U ^ (std::uint64_t(TENODESIS_JOINTS_VERSION) << 8U) ^ sizeof(S) ^
                               (std::uint64_t(sizeof(Session)) << 32U);
// In its place once the parameters have changed.
constexpr std::uint64_t damaged = ~mark;

static_assert(offsetof(Session, mark) == 0);

Session* session_of(tenodesis_joints* controller) {
  return mark_of(controller) == mark ? std::launder(reinterpret_cast<Session*>(controller)) : nullptr;
}
const Session* session_of(const tenodesis_joints* controller) {
  return session_of(const_cast<tenodesis_joints*>(controller));
}

void put(const Session& session, tenodesis_joints_output& to) {
  const auto& memory = session.memory;
  const auto& found = memory.observer.estimate;
  const auto& state = memory.supervisor.state;
  to.state = static_cast<std::uint32_t>(state.operating);
  to.faults = memory.faults();
  to.first_faults = state.first;
  to.cut_power = state.cut_power ? 1 : 0;
  for (int m = 0; m < M; ++m) to.spool_velocity[m] = memory.velocity[m];
  for (int i = 0; i < N; ++i) {
    to.output_angle[i] = found.angle[i];
    to.output_angle_std[i] = sqrt(found.covariance.at[i][i]);
  }
  to.friction_scale = found.friction_scale;
  to.friction_scale_std = found.friction_scale_std;
  for (int k = 0; k < load_components; ++k) {
    to.load[k] = found.load[k];
    to.load_std[k] = found.load_std[k];
  }
}

void record(const tenodesis_joints_input& in, const tenodesis_joints_output& out, Recorder& recorder) {
  const bool fault = out.state == TENODESIS_FAULT;
  if (!fault && recorder.fault_place() >= 0) recorder.rearm();
  tenodesis_joints_record* const kept = recorder.place(fault);
  if (kept == nullptr) return;
  kept->time = in.time;
  kept->state = out.state;
  kept->faults = out.faults;
  for (int i = 0; i < N; ++i) {
    kept->handle_angle[i] = in.handle_angle[i];
    kept->output_angle[i] = out.output_angle[i];
  }
  for (int m = 0; m < M; ++m) {
    kept->tension[m] = in.tension[m];
    kept->spool_angle[m] = in.spool_angle[m];
    kept->spool_velocity[m] = out.spool_velocity[m];
  }
}

}  // namespace

int tenodesis_joints_init(tenodesis_joints* controller, const tenodesis_joints_parameters* parameters) {
  if (!good(controller)) return TENODESIS_BAD_POINTER;
  auto* session = new (controller) Session;
  if (!good(parameters)) return TENODESIS_BAD_POINTER;
  const tenodesis_joints_parameters& p = *parameters;
  if (p.size != sizeof p || p.version != TENODESIS_JOINTS_VERSION) return TENODESIS_BAD_VERSION;
  if (p.friction_law > 2 || p.compensates > 1 || p.shows_load > 1 || p.own_clock > 1) return TENODESIS_BAD_PARAMETER;
  auto& [controls, compensates, shows_load, own_clock, reserved] = session->constants;
  controls.observer.law.kind = ChosenLaw<S>::Kind(p.friction_law);
  if (!controls.set_routes(p) || !controls.set_numbers(p)) return TENODESIS_BAD_PARAMETER;
  compensates = p.compensates;
  shows_load = p.shows_load;
  own_clock = p.own_clock;
  session->check.keep(session->constants);
  session->mark = mark;
  return TENODESIS_OK;
}

int tenodesis_joints_step(tenodesis_joints* controller, const tenodesis_joints_input* input,
                          tenodesis_joints_output* output) {
  const bool usable = good(controller, input, output);
  Session* session = usable ? session_of(controller) : nullptr;
  if (session == nullptr) {
    if (good(output)) *output = {};
    if (!usable) return TENODESIS_BAD_POINTER;
    return mark_of(controller) == damaged ? TENODESIS_DAMAGED : TENODESIS_NOT_STARTED;
  }
  const auto& [controls, compensates, shows_load, own_clock, reserved] = session->constants;
  if (!session->check.holds(session->constants) || !controls.in_bounds()) {
    session->mark = damaged;
    *output = {};
    return TENODESIS_DAMAGED;
  }
  const bool known = input->request <= TENODESIS_REQUEST_CLEAR;
  Controls::Input& in = session->in;
  in.wound = in.direct = nullptr;
  for (int i = 0; i < N; ++i) {
    in.measured.handle_angle[i] = input->handle_angle[i];
    in.commanded[i] = input->target[i];
  }
  for (int m = 0; m < M; ++m) {
    in.measured.tension[m] = input->tension[m];
    in.measured.spool_angle[m] = input->spool_angle[m];
  }
  in.request = known ? Request(input->request) : Request::none;
  in.compensates = compensates != 0;
  const bool counts = own_clock != 0 || session->started == 0;
  in.since = counts ? controls.law.period : elapsed<S>(session->time, input->time);
  session->time = input->time;
  session->started = 1;
  if (shows_load != 0)
    controls.step<true>(in, session->memory);
  else
    controls.step<false>(in, session->memory);
  put(*session, *output);
  record(*input, *output, session->recorder);
  return known ? TENODESIS_OK : TENODESIS_BAD_REQUEST;
}

int tenodesis_joints_reset(tenodesis_joints* controller) {
  if (!good(controller)) return TENODESIS_BAD_POINTER;
  Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  session->recorder.rearm();
  session->memory = {};
  session->started = 0;
  return TENODESIS_OK;
}

int tenodesis_joints_choose(tenodesis_joints* controller, uint32_t compensates) {
  if (!good(controller)) return TENODESIS_BAD_POINTER;
  Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  if (compensates > 1) return TENODESIS_BAD_PARAMETER;
  session->constants.compensates = compensates;
  session->check.keep(session->constants);
  return TENODESIS_OK;
}

int tenodesis_joints_watchdog(const tenodesis_joints* controller, uint64_t since_last_step) {
  const Session* session = good(controller) ? session_of(controller) : nullptr;
  if (session == nullptr) return 1;
  return session->constants.controls.supervisor.watch.watchdog(elapsed<S>(0, since_last_step)) ? 1 : 0;
}

int tenodesis_joints_records(const tenodesis_joints* controller) {
  const Session* session = good(controller) ? session_of(controller) : nullptr;
  return session == nullptr ? 0 : session->recorder.size();
}

int tenodesis_joints_read_record(const tenodesis_joints* controller, int number, tenodesis_joints_record* record) {
  if (!good(controller, record)) return TENODESIS_BAD_POINTER;
  const Session* session = session_of(controller);
  if (session == nullptr) return TENODESIS_NOT_STARTED;
  if (number < 0 || number >= session->recorder.size()) return TENODESIS_BAD_PARAMETER;
  *record = session->recorder[number];
  return TENODESIS_OK;
}

// Random structs, random calls in random order, on random memory: whatever comes in, no call crashes, reads or writes
// past what it was given, or computes what the language leaves undefined (built with the sanitizers that detect it),
// and nothing but finite velocities within the limit comes out. Usage: fuzz_c_interface [ROUNDS [SEED]]

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <random>

#include "same_output.hpp"
#include "scaled_up.h"
#include "tenodesis/tenodesis.h"

namespace {

using Real = tenodesis_real;
using Limits = std::numeric_limits<Real>;

constexpr std::size_t axis_numbers = sizeof(tenodesis_axis_parameters) / sizeof(Real);
constexpr int episode = 400;  // ticks; homing of a stiff tendon takes some thousand

struct Seen {
  long rounds, accepted, refused, steps, bad_requests, homed, broken;  ///< homed: by homing
  std::array<long, 4> state;
  std::array<long, TENODESIS_FAULTS> fault;
};

/// The simplest plant that lets homing and laws run: frictionless tendons, and motors that follow exactly.
struct Plant {
  Real handle{}, spool[TENODESIS_AXES][2]{}, speed[TENODESIS_AXES][2]{};
  int moving{};  ///< ticks that the hand has moved for: it waits for homing

  tenodesis_measurement measure(const tenodesis_axis_parameters& p, int n, Real noise) const {
    const Real pull = p.proximal_radius * handle * Real(0.1);
    tenodesis_measurement measured{};
    measured.handle_angle = handle;
    for (int i = 0; i < 2; ++i) {
      const Real stretch = p.spool_radius * spool[n][i] + (i == 0 ? pull : -pull);
      measured.tension[i] = std::max(Real(0), p.pretension + p.stiffness * stretch) + noise;
      measured.spool_angle[i] = spool[n][i];
    }
    return measured;
  }

  void follow(const tenodesis_output& output) {
    constexpr auto period = Real(5e-4), lag = Real(0.01);  // s
    for (int n = 0; n < TENODESIS_AXES; ++n) {
      for (int i = 0; i < 2; ++i) {
        speed[n][i] += (output.axis[n].spool_velocity[i] - speed[n][i]) * (period / (lag + period));
        spool[n][i] += speed[n][i] * period;
      }
    }
    if (output.homing == 0) ++moving;
    handle = Real(0.5 * std::sin(moving * 0.002));
  }
};

class Fuzz {
 public:
  Fuzz(std::uint64_t seed, Seen& seen) : random_(seed), seed_(seed), seen_(seen) {}

  void round() {
    ++seen_.rounds;
    // Of its exact size on the heap, so that an access beyond it is detected.
    const auto controller = std::make_unique<tenodesis_controller>();
    if (chance(0.3)) scramble(*controller);
    for (int call = 0; call < 12; ++call) any_call(*controller);
    const tenodesis_parameters parameters = any_parameters();
    if (!init(*controller, parameters)) return;
    if (chance(0.5)) {
      for (int call = 0; call < 40; ++call) any_call(*controller);
      if (!init(*controller, parameters)) return fail("what init has accepted it does not accept again");
    }
    live(*controller, parameters);
  }

 private:
  bool chance(double share) { return std::uniform_real_distribution<>(0, 1)(random_) < share; }
  template <class T = int>
  T below(T count) {
    return std::uniform_int_distribution<T>(0, count - 1)(random_);
  }
  Real between(double low, double high) { return Real(std::uniform_real_distribution<>(low, high)(random_)); }

  template <class T>
  void scramble(T& what) {
    auto* bytes = reinterpret_cast<unsigned char*>(&what);
    for (std::size_t n = 0; n < sizeof what; ++n) bytes[n] = static_cast<unsigned char>(random_() >> 13U);
  }

  Real any_number() {
    switch (below(12)) {
      case 0:
        return Limits::quiet_NaN();
      case 1:
        return Limits::infinity();
      case 2:
        return -Limits::infinity();
      case 3:
        return Limits::max();
      case 4:
        return Limits::lowest();
      case 5:
        return Limits::denorm_min() * Real(below(100));
      case 6:
        return Real(-0.0);
      case 7: {
        Real bits;
        scramble(bits);
        return bits;
      }
      case 8:
        return Real(std::pow(10.0, double(between(-37, 37)))) * (chance(0.3) ? Real(-1) : Real(1));
      case 9:
        return between(-1e6, 1e6);
      default:
        return between(-4, 4);
    }
  }

  // An instrument's, with some of its numbers others.
  tenodesis_parameters mutated() {
    tenodesis_parameters p = scaled_up;
    p.joint_type = below(3U);
    p.axes = 1 + below(2U);
    p.observer = below(3U);
    p.law = below(5U);
    p.actuation = below(2U);
    p.safe_state = below(2U);
    p.stop = below(2U);
    p.own_clock = below(2U);
    p.homed = below(2U);
    p.axis[1] = p.axis[0];
    if (p.joint_type == TENODESIS_CONTINUUM) {
      for (auto& axis : p.axis) {
        axis.backbone_length = Real(0.03);
        axis.backbone_rigidity = Real(5e-3);
      }
    }
    // Without checks more of what is bad goes through.
    if (chance(0.3)) {
      for (auto& axis : p.axis) {
        axis.spool_jump.threshold = 0;
        for (auto& limit : axis.limit) limit.threshold = 0;
      }
    }
    const int changes = chance(0.4) ? 0 : 1 + below(chance(0.5) ? 3 : 40);
    const bool wild = chance(0.4);
    for (int n = 0; n < changes; ++n) {
      std::array<Real, axis_numbers> numbers{};
      auto& axis = p.axis[below(2)];
      std::memcpy(numbers.data(), &axis, sizeof axis);
      change(numbers[below(axis_numbers)], wild);
      std::memcpy(&axis, numbers.data(), sizeof axis);
      std::array<Real*, 8> common{&p.period,        &p.speed_limit, &p.acceleration_limit, &p.engage_time,
                                  &p.tension_limit, &p.hold_time,   &p.neutral_speed,      &p.relief};
      if (chance(0.1)) change(*common[below(common.size())], wild);
    }
    return p;
  }

  void change(Real& number, bool wild) {
    if (wild && chance(0.3))
      number = any_number();
    else if (chance(0.1))
      number = 0;
    else
      number *= Real(std::pow(10.0, double(wild ? between(-30, 30) : between(-2, 2))));
  }

  tenodesis_parameters any_parameters() {
    tenodesis_parameters p = mutated();
    if (chance(0.1)) {
      scramble(p);
      if (chance(0.9)) {
        p.size = sizeof p;
        p.version = TENODESIS_VERSION;
        p.joint_type = below(4U);
        p.axes = below(4U);
      }
    }
    if (chance(0.03)) scramble(p.size);
    if (chance(0.03)) scramble(p.version);
    if (chance(0.03)) scramble(p.axes);
    if (chance(0.03)) scramble(p.law);
    return p;
  }

  tenodesis_input any_input() {
    tenodesis_input input{};
    if (chance(0.2)) {
      scramble(input);
      return input;
    }
    input.time = chance(0.5) ? random_() : below<std::uint64_t>(1000000000);
    input.request = below(8U);
    for (auto& each : input.axis) {
      each = {any_number(), {any_number(), any_number()}, {any_number(), any_number()}};
    }
    return input;
  }

  // Any function with any arguments, null among them; what it answers must be an answer.
  void any_call(tenodesis_controller& controller) {
    tenodesis_controller* const at = chance(0.05) ? nullptr : &controller;
    const auto maybe = [&](auto& what) { return chance(0.05) ? nullptr : &what; };
    int code = TENODESIS_OK;
    switch (below(10)) {
      case 0: {
        const tenodesis_parameters parameters = any_parameters();
        code = tenodesis_init(at, maybe(parameters));
        if (code == TENODESIS_OK) speed_limit_ = parameters.speed_limit;
        break;
      }
      case 1:
        code = tenodesis_reset(at);
        break;
      case 2:
        if (const int stop = tenodesis_watchdog(at, random_()); stop != 0 && stop != 1) fail("no answer of a watchdog");
        break;
      case 3: {
        const int records = tenodesis_records(at);
        if (records < 0 || records > TENODESIS_RECORDS) fail("more records than there is memory for");
        tenodesis_record record;
        code = tenodesis_read_record(at, chance(0.5) ? below(TENODESIS_RECORDS) : int(random_()), maybe(record));
        break;
      }
      case 4: {
        tenodesis_counts counts;
        code = tenodesis_read_counts(at, chance(0.8) ? below(2) : int(random_()), maybe(counts));
        break;
      }
      case 5:
        code = tenodesis_choose(at, std::uint32_t(chance(0.8) ? below(5) : random_()), std::uint32_t(below(3)));
        break;
      case 6:
        if (std::strlen(tenodesis_fault_name(std::uint32_t(random_()))) == 0) fail("a fault without a name");
        break;
      default: {
        const tenodesis_input input = any_input();
        tenodesis_output output;
        scramble(output);
        const auto* from = maybe(input);
        auto* to = maybe(output);
        code = tenodesis_step(at, from, to);
        if (to != nullptr) check(code, output, speed_limit_);
        break;
      }
    }
    if (code < TENODESIS_OK || code > TENODESIS_BAD_REQUEST) fail("an unknown code");
  }

  bool init(tenodesis_controller& controller, const tenodesis_parameters& parameters) {
    const int code = tenodesis_init(&controller, &parameters);
    ++(code == TENODESIS_OK ? seen_.accepted : seen_.refused);
    if (code == TENODESIS_OK) speed_limit_ = parameters.speed_limit;
    return code == TENODESIS_OK;
  }

  // Ticks of an instrument that is used, with bad ones among them.
  void live(tenodesis_controller& controller, const tenodesis_parameters& p) {
    tenodesis_controller copy = controller;
    Plant plant{};
    // From slack, as homing wants it.
    if (p.homed == 0) {
      for (int n = 0; n < TENODESIS_AXES; ++n)
        for (Real& angle : plant.spool[n])
          angle = -(p.axis[n].pretension / p.axis[n].stiffness) / p.axis[n].spool_radius;
    }
    std::uint64_t time = random_() >> 20U;
    const int ticks = chance(0.1) ? 20 * episode : episode;
    const bool bad = chance(0.5);
    bool homed = p.homed == 1;
    for (int tick = 0; tick < ticks; ++tick) {
      tenodesis_input input{};
      time += 500000;
      input.time = bad && chance(0.01) ? random_() : time;
      if (tick == 0) input.request = p.homed == 1 ? TENODESIS_REQUEST_ENABLE : TENODESIS_REQUEST_HOME;
      if (bad && chance(0.005)) input.request = below(8U);
      if (bad && chance(0.02)) input.request = chance(0.5) ? TENODESIS_REQUEST_CLEAR : TENODESIS_REQUEST_ENABLE;
      if (bad && chance(0.002)) input.request = TENODESIS_REQUEST_HOME;
      for (int n = 0; n < TENODESIS_AXES; ++n) {
        input.axis[n] = plant.measure(p.axis[n], n, between(-0.05, 0.05));
        if (bad && chance(0.01)) input.axis[n].tension[below(2)] = any_number();
        if (bad && chance(0.01)) input.axis[n].spool_angle[below(2)] = any_number();
        if (bad && chance(0.01)) input.axis[n].handle_angle = any_number();
      }
      tenodesis_output output;
      scramble(output);
      const int code = tenodesis_step(&controller, &input, &output);
      check(code, output, p.speed_limit);
      check_numbers(p, input, output);
      if (code != (input.request > TENODESIS_REQUEST_CLEAR ? TENODESIS_BAD_REQUEST : TENODESIS_OK))
        fail("a tick of a started controller was not taken");
      tenodesis_output again;
      if (tenodesis_step(&copy, &input, &again) != code || !same(output, again)) fail("a copy does otherwise");
      count(output, code);
      if (!homed && output.homed == 1) ++seen_.homed;
      homed = output.homed == 1;
      plant.follow(output);
    }
  }

  void check(int code, const tenodesis_output& output, Real speed_limit) {
    const bool taken = code == TENODESIS_OK || code == TENODESIS_BAD_REQUEST;
    for (const auto& axis : output.axis) {
      for (const Real velocity : axis.spool_velocity) {
        if (!std::isfinite(velocity)) fail("a velocity is not finite");
        if (std::fabs(velocity) > (taken ? speed_limit : Real(0))) fail("a velocity is beyond its limit");
      }
      if (axis.faults >> TENODESIS_FAULTS != 0) fail("an unknown fault of an axis");
    }
    if (output.state > TENODESIS_FAULT || output.homed > 1 || output.homing > 1) fail("an unknown state");
    if (output.faults >> TENODESIS_FAULTS != 0 || output.first_faults >> TENODESIS_FAULTS != 0)
      fail("an unknown fault");
  }

  void check_numbers(const tenodesis_parameters& p, const tenodesis_input& input, const tenodesis_output& output) {
    bool readable = true;
    for (unsigned n = 0; n < p.axes; ++n) {
      const auto& each = input.axis[n];
      for (const Real number :
           {each.handle_angle, each.tension[0], each.tension[1], each.spool_angle[0], each.spool_angle[1]})
        readable = readable && std::isfinite(number);
    }
    if (readable) return;
    if (output.state == TENODESIS_ENABLED) fail("enabled on what is not a number");
    if ((output.faults & (1U << TENODESIS_FAULT_NOT_A_NUMBER)) == 0) fail("what is not a number is no fault");
  }

  void count(const tenodesis_output& output, int code) {
    ++seen_.steps;
    if (code == TENODESIS_BAD_REQUEST) ++seen_.bad_requests;
    ++seen_.state[output.state];
    for (unsigned n = 0; n < TENODESIS_FAULTS; ++n) seen_.fault[n] += output.faults >> n & 1U;
  }

  void fail(const char* what) {
    if (++seen_.broken <= 20) std::printf("round with seed %llu: %s\n", static_cast<unsigned long long>(seed_), what);
  }

  std::mt19937_64 random_;
  std::uint64_t seed_;
  Real speed_limit_{};
  Seen& seen_;
};

}  // namespace

int main(int argc, char** argv) {
  const long rounds = argc > 1 ? std::strtol(argv[1], nullptr, 10) : 400;
  const std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
  Seen seen{};
  for (long n = 0; n < rounds; ++n) Fuzz(seed + std::uint64_t(n), seen).round();
  std::printf("%ld rounds; parameters accepted %ld, refused %ld; %ld ticks: disabled %ld, enabled %ld, paused %ld, ",
              seen.rounds, seen.accepted, seen.refused, seen.steps, seen.state[0], seen.state[1], seen.state[2]);
  std::printf("fault %ld; homed %ld; %ld broken\n", seen.state[3], seen.homed, seen.broken);
  for (unsigned n = 0; n < TENODESIS_FAULTS; ++n) std::printf("  %s: %ld\n", tenodesis_fault_name(n), seen.fault[n]);
  // What was never reached was not tried.
  const bool reached = std::ranges::all_of(seen.state, [](long ticks) { return ticks > 0; }) && seen.homed > 0 &&
                       seen.accepted > rounds / 10 && seen.refused > rounds / 10;
  if (argc <= 1 && !reached) std::printf("not every state was reached\n");
  return seen.broken == 0 && (argc > 1 || reached) ? 0 : 1;
}

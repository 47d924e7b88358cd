// Claims about the C interface: every call in the wrong order, with the wrong struct or in the wrong memory is answered
// with its code; reset is a fresh start.

#include <array>
#include <cmath>
#include <cstring>
#include <limits>

#include "c_readings.hpp"
#include "claim.hpp"
#include "same_output.hpp"
#include "tenodesis/fault.hpp"
#include "tenodesis/tenodesis.h"

void sizes_are_those_that_the_header_promises() {
  constexpr std::size_t real = sizeof(Number);
  CLAIM(tenodesis_version() == TENODESIS_VERSION);
  CLAIM(tenodesis_real_size() == real);
  CLAIM(sizeof(tenodesis_parameters) == (real == 4 ? 800 : 1552));
  CLAIM(sizeof(tenodesis_input) == (real == 4 ? 56 : 96));
  CLAIM(sizeof(tenodesis_output) == (real == 4 ? 104 : 168));
  CLAIM(sizeof(tenodesis_record) == (real == 4 ? 80 : 144));
  CLAIM(sizeof(tenodesis_counts) == 84);
  CLAIM(sizeof(tenodesis_controller) == 4096 * real);
}

void what_comes_before_init_is_refused() {
  tenodesis_controller controller;
  tenodesis_input input{};
  tenodesis_output output;
  tenodesis_record record;
  tenodesis_counts counts;
  for (const int filling : {0x00, 0xFF, 0x5A}) {
    std::memset(&controller, filling, sizeof controller);
    std::memset(&output, 0xFF, sizeof output);
    CLAIM(tenodesis_step(&controller, &input, &output) == TENODESIS_NOT_STARTED);
    CLAIM(output.axis[0].spool_velocity[0] == Number(0) && output.axis[1].spool_velocity[1] == Number(0));
    CLAIM(output.state == TENODESIS_DISABLED);
    CLAIM(tenodesis_reset(&controller) == TENODESIS_NOT_STARTED);
    CLAIM(tenodesis_read_record(&controller, 0, &record) == TENODESIS_NOT_STARTED);
    CLAIM(tenodesis_read_counts(&controller, 0, &counts) == TENODESIS_NOT_STARTED);
    CLAIM(tenodesis_records(&controller) == 0);
    CLAIM(tenodesis_phase(&controller, 0) == 0);
    CLAIM(tenodesis_choose(&controller, TENODESIS_LAW_OFF, 0) == TENODESIS_NOT_STARTED);
    CLAIM(tenodesis_watchdog(&controller, 0) == 1);
  }
}

void bad_pointers_are_refused() {
  const tenodesis_parameters p = parameters(TENODESIS_TENDON_GEAR, 1);
  std::array<tenodesis_controller, 2> memory{};
  tenodesis_controller& controller = memory[0];
  tenodesis_input input{};
  tenodesis_output output{};
  CLAIM(tenodesis_init(nullptr, &p) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_init(&controller, nullptr) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_init(&controller, &p) == TENODESIS_OK);
  output.axis[0].spool_velocity[0] = 1;
  CLAIM(tenodesis_step(nullptr, &input, &output) == TENODESIS_BAD_POINTER);
  CLAIM(output.axis[0].spool_velocity[0] == Number(0));
  CLAIM(tenodesis_step(&controller, nullptr, &output) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_step(&controller, &input, nullptr) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_reset(nullptr) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_read_record(&controller, 0, nullptr) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_read_counts(&controller, 0, nullptr) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_records(nullptr) == 0);
  CLAIM(tenodesis_watchdog(nullptr, 0) == 1);
  auto* const odd = reinterpret_cast<tenodesis_controller*>(reinterpret_cast<char*>(memory.data()) + 1);
  CLAIM(tenodesis_init(odd, &p) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_step(odd, &input, &output) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_reset(odd) == TENODESIS_BAD_POINTER);
  CLAIM(tenodesis_watchdog(odd, 0) == 1);
}

template <class Change>
int init_with(const Change& change) {
  tenodesis_parameters p = parameters(TENODESIS_TENDON_GEAR, two);
  change(p);
  static tenodesis_controller controller;
  const tenodesis_parameters good = parameters(TENODESIS_TENDON_GEAR, two);
  CLAIM(tenodesis_init(&controller, &good) == TENODESIS_OK);
  const int code = tenodesis_init(&controller, &p);
  const tenodesis_input input{};
  tenodesis_output output;
  CLAIM(tenodesis_step(&controller, &input, &output) == (code == TENODESIS_OK ? TENODESIS_OK : TENODESIS_NOT_STARTED));
  return code;
}

void parameters_that_make_no_controller_are_refused() {
  using P = tenodesis_parameters;
  constexpr Number nan = std::numeric_limits<Number>::quiet_NaN();
  constexpr Number infinity = std::numeric_limits<Number>::infinity();
  CLAIM(init_with([](P&) {}) == TENODESIS_OK);
  CLAIM(init_with([](P& p) { p.size += 4; }) == TENODESIS_BAD_VERSION);
  CLAIM(init_with([](P& p) { p.version += 1; }) == TENODESIS_BAD_VERSION);
  const auto refused = [](const auto& change) { return init_with(change) == TENODESIS_BAD_PARAMETER; };
  CLAIM(refused([](P& p) { p.joint_type = 3; }));
  CLAIM(refused([](P& p) { p.axes = 0; }));
  CLAIM(refused([](P& p) { p.axes = 3; }));
  CLAIM(refused([](P& p) { p.observer = 3; }));
  CLAIM(refused([](P& p) { p.law = 5; }));
  CLAIM(refused([](P& p) { p.actuation = 2; }));
  CLAIM(refused([](P& p) { p.safe_state = 2; }));
  CLAIM(refused([](P& p) { p.stop = 2; }));
  CLAIM(refused([](P& p) { p.own_clock = 2; }));
  CLAIM(refused([](P& p) { p.homed = 2; }));
  CLAIM(refused([](P& p) { p.period = 0; }));
  CLAIM(refused([](P& p) { p.axis[1].pretension = p.axis[1].tension_limit; }));
  CLAIM(refused([](P& p) { p.axis[1].share_stem += Number(0.1); }));
  CLAIM(refused([](P& p) { p.axis[1].vertex_coefficient = 2; }));
  CLAIM(refused([](P& p) { p.axis[1].handle_range = 4; }));
  CLAIM(refused([](P& p) { p.axis[1].limit[TENODESIS_FAULT_TICK_LATE].threshold = 5; }));
  CLAIM(refused([](P& p) { p.axis[1].limit[TENODESIS_FAULT_TENDON_BREAK].persistence = -1; }));
  // No number may be missing, negative or without bound, whichever it is.
  constexpr std::size_t count = sizeof(tenodesis_axis_parameters) / sizeof(Number);
  std::size_t kept = 0;
  for (std::size_t place = 0; place < count; ++place) {
    for (const Number bad : {nan, infinity, -infinity, Number(-1)}) {
      kept += std::size_t(refused([&](P& p) {
        std::array<Number, count> numbers{};
        std::memcpy(numbers.data(), &p.axis[1], sizeof numbers);
        numbers[place] = bad;
        std::memcpy(&p.axis[1], numbers.data(), sizeof numbers);
      }));
    }
  }
  CLAIM(kept == 4 * count);
  // The axis that is not used may be anything.
  CLAIM(init_with([&](P& p) {
          p.axes = 1;
          p.axis[1].stiffness = nan;
        }) == TENODESIS_OK);
}

void a_request_that_is_none_takes_the_tick_without_it() {
  tenodesis_controller controller;
  const tenodesis_parameters p = parameters(TENODESIS_TENDON_GEAR, 1);
  CLAIM(tenodesis_init(&controller, &p) == TENODESIS_OK);
  tenodesis_controller other = controller;
  Readings readings;
  tenodesis_input input = readings.at(1);
  tenodesis_output output;
  tenodesis_output without;
  CLAIM(tenodesis_step(&other, &input, &without) == TENODESIS_OK);
  input.request = TENODESIS_REQUEST_CLEAR + 1;
  CLAIM(tenodesis_step(&controller, &input, &output) == TENODESIS_BAD_REQUEST);
  CLAIM(same(output, without));
}

void reset_is_a_fresh_start() {
  const tenodesis_parameters p = parameters(TENODESIS_CONTINUUM, two);
  tenodesis_controller used;
  tenodesis_controller fresh;
  CLAIM(tenodesis_init(&used, &p) == TENODESIS_OK);
  CLAIM(tenodesis_init(&fresh, &p) == TENODESIS_OK);
  tenodesis_output output;
  Readings before;
  for (int tick = 0; tick < 2500; ++tick) {
    const tenodesis_input input = before.at(tick);
    tenodesis_step(&used, &input, &output);
    before.follow(output);
  }
  CLAIM(tenodesis_reset(&used) == TENODESIS_OK);
  CLAIM(tenodesis_records(&used) == 0);
  tenodesis_counts counts;
  CLAIM(tenodesis_read_counts(&used, 1, &counts) == TENODESIS_OK && counts.faults[TENODESIS_FAULT_NOT_A_NUMBER] == 0);
  Readings after;
  int differing = 0;
  for (int tick = 0; tick < 2500; ++tick) {
    const tenodesis_input input = after.at(tick);
    tenodesis_output expected;
    tenodesis_step(&used, &input, &output);
    tenodesis_step(&fresh, &input, &expected);
    after.follow(output);
    if (!same(output, expected)) ++differing;
  }
  CLAIM(differing == 0);
}

void a_copy_goes_on_by_itself() {
  const tenodesis_parameters p = parameters(TENODESIS_TENDON_PULLEY, 1);
  tenodesis_controller original;
  CLAIM(tenodesis_init(&original, &p) == TENODESIS_OK);
  Readings readings;
  tenodesis_output output;
  for (int tick = 0; tick < 500; ++tick) {
    const tenodesis_input input = readings.at(tick);
    tenodesis_step(&original, &input, &output);
    readings.follow(output);
  }
  tenodesis_controller copy = original;
  const tenodesis_input input = readings.at(500);
  tenodesis_output of_copy;
  tenodesis_step(&copy, &input, &of_copy);
  CLAIM(tenodesis_records(&original) == TENODESIS_RECORDS && tenodesis_reset(&copy) == TENODESIS_OK &&
        tenodesis_records(&original) == TENODESIS_RECORDS);
  tenodesis_step(&original, &input, &output);
  CLAIM(same(output, of_copy));
}

void the_watchdog_stops_the_motors_past_its_time() {
  const tenodesis_parameters p = parameters(TENODESIS_TENDON_GEAR, 1);  // 25 ms
  tenodesis_controller controller;
  CLAIM(tenodesis_init(&controller, &p) == TENODESIS_OK);
  CLAIM(tenodesis_watchdog(&controller, 0) == 0);
  CLAIM(tenodesis_watchdog(&controller, 24900000) == 0);
  CLAIM(tenodesis_watchdog(&controller, 25100000) == 1);
  CLAIM(tenodesis_watchdog(&controller, std::uint64_t(1) << 32U) == 1);
  CLAIM(tenodesis_watchdog(&controller, UINT64_MAX) == 1);
}

void records_lead_up_to_the_fault_and_stop_there() {
  const tenodesis_parameters p = parameters(TENODESIS_TENDON_GEAR, 1);
  tenodesis_controller controller;
  CLAIM(tenodesis_init(&controller, &p) == TENODESIS_OK);
  Readings readings;
  tenodesis_output output;
  tenodesis_record record;
  const auto run = [&](int from, int to) {
    for (int tick = from; tick < to; ++tick) {
      const tenodesis_input input = readings.at(tick);
      tenodesis_step(&controller, &input, &output);
      readings.follow(output);
    }
  };
  run(0, 40);
  CLAIM(tenodesis_records(&controller) == 10);
  CLAIM(tenodesis_read_record(&controller, 0, &record) == TENODESIS_OK && record.time == 1000);
  CLAIM(tenodesis_read_record(&controller, 9, &record) == TENODESIS_OK && record.time == 1000 + 36 * 500000);
  CLAIM(tenodesis_read_record(&controller, 10, &record) == TENODESIS_BAD_PARAMETER);
  CLAIM(tenodesis_read_record(&controller, -1, &record) == TENODESIS_BAD_PARAMETER);
  run(40, 899);
  CLAIM(output.state == TENODESIS_FAULT && tenodesis_records(&controller) == TENODESIS_RECORDS);
  int first = -1;
  for (int n = 0; n < TENODESIS_RECORDS; ++n) {
    CLAIM(tenodesis_read_record(&controller, n, &record) == TENODESIS_OK);
    if (first < 0 && record.state == TENODESIS_FAULT) first = n;
    if (n == first)
      CLAIM(record.time == 1000 + Readings::bad_tick * 500000 && std::isnan(record.measured[0].tension[1]));
  }
  CLAIM(first == TENODESIS_RECORDS - 11);
  run(899, 905);
  CLAIM(output.state == TENODESIS_DISABLED && tenodesis_records(&controller) < 3);
}

void counts_tell_what_was_seen() {
  const tenodesis_parameters p = parameters(TENODESIS_TENDON_GEAR, 1);
  tenodesis_controller controller;
  CLAIM(tenodesis_init(&controller, &p) == TENODESIS_OK);
  Readings readings;
  tenodesis_output output;
  for (int tick = 0; tick < 2900; ++tick) {
    const tenodesis_input input = readings.at(tick);
    tenodesis_step(&controller, &input, &output);
    readings.follow(output);
  }
  tenodesis_counts counts;
  CLAIM(tenodesis_read_counts(&controller, 0, &counts) == TENODESIS_OK);
  CLAIM(counts.faults[TENODESIS_FAULT_NOT_A_NUMBER] == 3);
  CLAIM(counts.bad_samples[2] >= 3 && counts.bad_samples[0] == 0);
  CLAIM(counts.late_ticks == 0);
  CLAIM(tenodesis_read_counts(&controller, 1, &counts) == TENODESIS_BAD_PARAMETER);
  CLAIM(tenodesis_read_counts(&controller, -1, &counts) == TENODESIS_BAD_PARAMETER);
}

void faults_have_names() {
  for (std::uint32_t n = 0; n < TENODESIS_FAULTS; ++n)
    CLAIM(std::strcmp(tenodesis_fault_name(n), tenodesis::name(tenodesis::Fault(n))) == 0);
  CLAIM(std::strcmp(tenodesis_fault_name(TENODESIS_FAULTS), "unknown") == 0);
  CLAIM(std::strcmp(tenodesis_fault_name(UINT32_MAX), "unknown") == 0);
}

// Parameters and headers that were written for this version must keep their meaning.
void the_layout_of_version_6_is_unchanged() {
  constexpr std::size_t real = sizeof(tenodesis_real);
  using Axis = tenodesis_axis_parameters;
  static_assert(TENODESIS_VERSION == 6);
  CLAIM(offsetof(tenodesis_parameters, homed) == 40 && offsetof(tenodesis_parameters, relief) == 48 + 7 * real);
  CLAIM(sizeof(tenodesis_parameters) == 48 + 188 * real);
  CLAIM(offsetof(Axis, handle_range) == 6 * real && offsetof(Axis, sheath_bend_rate) == 19 * real);
  CLAIM(offsetof(Axis, slack_tension) == 29 * real && offsetof(Axis, force_limit) == 41 * real);
  CLAIM(offsetof(Axis, homing_play) == 53 * real && offsetof(Axis, spool_noise) == 57 * real);
  CLAIM(offsetof(Axis, spool_jump) == 58 * real && offsetof(Axis, limit) == 60 * real);
  CLAIM(TENODESIS_FAULT_ENCODER_JUMP == 7 && TENODESIS_FAULT_ROPE_LENGTH == TENODESIS_FAULTS - 1);
  CLAIM(TENODESIS_HOMING_TIP_LOADED == 1 && TENODESIS_HOMING_TIMED_OUT == 18);
}

void a_current_stands_for_a_tension_up_to_its_range() {
  const Number per_current = 20, range = 6;
  CLAIM(tenodesis_tension_from_current(2, per_current, range) == 40);
  CLAIM(tenodesis_tension_from_current(-7, per_current, range) == -120);
  const Number nothing = std::numeric_limits<Number>::quiet_NaN();
  const Number none = tenodesis_tension_from_current(nothing, per_current, range);
  CLAIM(none != none);
}

int main() {
  the_layout_of_version_6_is_unchanged();
  sizes_are_those_that_the_header_promises();
  what_comes_before_init_is_refused();
  bad_pointers_are_refused();
  parameters_that_make_no_controller_are_refused();
  a_request_that_is_none_takes_the_tick_without_it();
  reset_is_a_fresh_start();
  a_copy_goes_on_by_itself();
  the_watchdog_stops_the_motors_past_its_time();
  records_lead_up_to_the_fault_and_stop_there();
  counts_tell_what_was_seen();
  faults_have_names();
  a_current_stands_for_a_tension_up_to_its_range();
  return claims::report();
}

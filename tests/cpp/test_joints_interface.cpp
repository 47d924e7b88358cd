// Claims about the C interface of the controller of all joints, in the precision that it is built with.

#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <random>

#include "claim.hpp"
#include "tenodesis/joints.h"

namespace {

using Number = tenodesis_real;
constexpr int tendons = TENODESIS_TENDONS;

/// Readings of the tool at rest, which flicker.
tenodesis_joints_input at_rest(int tick) {
  tenodesis_joints_input input{};
  input.time = std::uint64_t(tick) * 500000;
  input.request = tick == 0 ? TENODESIS_REQUEST_ENABLE : TENODESIS_REQUEST_NONE;
  for (int m = 0; m < tendons; ++m)
    input.tension[m] = needle_driver.tendon[m].pretension + Number(((tick + m) % 3 - 1) * 0.03);
  return input;
}

int run(tenodesis_joints& controller, int from, int to, tenodesis_joints_output& output) {
  int code = TENODESIS_OK;
  for (int tick = from; tick < to && code == TENODESIS_OK; ++tick) {
    const tenodesis_joints_input input = at_rest(tick);
    code = tenodesis_joints_step(&controller, &input, &output);
  }
  return code;
}

void it_steps_only_where_it_was_started_with_sound_parameters() {
  auto controller = std::make_unique<tenodesis_joints>();
  tenodesis_joints_output output;
  const tenodesis_joints_input input = at_rest(0);
  CLAIM(tenodesis_joints_step(controller.get(), &input, &output) == TENODESIS_NOT_STARTED);
  CLAIM(tenodesis_joints_watchdog(controller.get(), 0) == 1);
  CLAIM(tenodesis_joints_init(nullptr, &needle_driver) == TENODESIS_BAD_POINTER);
  const auto refused = [&](const auto& change) {
    tenodesis_joints_parameters p = needle_driver;
    change(p);
    return tenodesis_joints_init(controller.get(), &p);
  };
  CLAIM(refused([](auto& p) { ++p.size; }) == TENODESIS_BAD_VERSION);
  CLAIM(refused([](auto& p) { p.gain = 0; }) == TENODESIS_BAD_PARAMETER);
  CLAIM(refused([](auto& p) { p.period = std::numeric_limits<Number>::quiet_NaN(); }) == TENODESIS_BAD_PARAMETER);
  CLAIM(refused([](auto& p) { p.joint[0].parent = 1; }) == TENODESIS_BAD_PARAMETER);
  CLAIM(refused([](auto& p) { p.joint[1].tied_to = 4; }) == TENODESIS_BAD_PARAMETER);
  CLAIM(refused([](auto& p) { p.tendon[2].contact[0].joint = 4; }) == TENODESIS_BAD_PARAMETER);
  CLAIM(refused([](auto& p) { p.tendon[2].contacts = TENODESIS_CONTACTS + 1; }) == TENODESIS_BAD_PARAMETER);
  CLAIM(tenodesis_joints_step(controller.get(), &input, &output) == TENODESIS_NOT_STARTED);
  CLAIM(refused([](auto&) {}) == TENODESIS_OK);
  CLAIM(tenodesis_joints_step(controller.get(), &input, &output) == TENODESIS_OK);
  CLAIM(output.state == TENODESIS_ENABLED);
}

void a_reading_that_is_no_number_stops_the_motors_and_is_recorded() {
  auto controller = std::make_unique<tenodesis_joints>();
  CLAIM(tenodesis_joints_init(controller.get(), &needle_driver) == TENODESIS_OK);
  tenodesis_joints_output output;
  CLAIM(run(*controller, 0, 50, output) == TENODESIS_OK && output.state == TENODESIS_ENABLED);
  tenodesis_joints_input input = at_rest(50);
  input.tension[3] = std::numeric_limits<Number>::quiet_NaN();
  for (int tick = 0; tick < 2000; ++tick) tenodesis_joints_step(controller.get(), &input, &output);
  CLAIM(output.state == TENODESIS_FAULT && (output.first_faults >> TENODESIS_FAULT_NOT_A_NUMBER & 1U) == 1);
  for (const Number sent : output.spool_velocity) CLAIM(sent == 0);
  tenodesis_joints_record record;
  const int count = tenodesis_joints_records(controller.get());
  CLAIM(tenodesis_joints_read_record(controller.get(), count - 1, &record) == TENODESIS_OK);
  CLAIM(record.state == TENODESIS_FAULT && std::isnan(record.tension[3]));
  CLAIM(tenodesis_joints_read_record(controller.get(), count, &record) == TENODESIS_BAD_PARAMETER);
  CLAIM(tenodesis_joints_reset(controller.get()) == TENODESIS_OK);
  CLAIM(run(*controller, 0, 5, output) == TENODESIS_OK && output.state == TENODESIS_ENABLED);
  input = at_rest(5);
  input.request = TENODESIS_REQUEST_CLEAR + 1;
  CLAIM(tenodesis_joints_step(controller.get(), &input, &output) == TENODESIS_BAD_REQUEST);
  CLAIM(tenodesis_joints_choose(controller.get(), 2) == TENODESIS_BAD_PARAMETER);
  CLAIM(tenodesis_joints_choose(controller.get(), 0) == TENODESIS_OK);
  CLAIM(run(*controller, 6, 700, output) == TENODESIS_OK);
}

// Whatever bit flips, and when.
void damaged_memory_never_crashes_it_and_stops_the_motors_where_parameters_change() {
  auto controller = std::make_unique<tenodesis_joints>(), damaged = std::make_unique<tenodesis_joints>();
  CLAIM(tenodesis_joints_init(controller.get(), &needle_driver) == TENODESIS_OK);
  tenodesis_joints_output output;
  CLAIM(run(*controller, 0, 100, output) == TENODESIS_OK);
  std::mt19937 random(7);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
  for (int trial = 0; trial < 4000; ++trial) {
    *damaged = *controller;
    const std::size_t at = random() % sizeof *damaged;
    reinterpret_cast<unsigned char*>(damaged.get())[at] ^= static_cast<unsigned char>(1U << (random() % 8));
    for (int tick = 100; tick < 104; ++tick) {
      const tenodesis_joints_input input = at_rest(tick);
      tenodesis_joints_step(damaged.get(), &input, &output);
      for (const Number sent : output.spool_velocity) CLAIM(std::isfinite(sent));
    }
  }
  const Number gain = needle_driver.gain;
  auto* const bytes = reinterpret_cast<unsigned char*>(controller.get());
  const auto number = [&](std::size_t place) {
    Number found;
    std::memcpy(&found, bytes + place, sizeof found);
    return found;
  };
  std::size_t at = 0;
  while (number(at) != gain) at += sizeof gain;
  bytes[at] ^= 1U;
  CLAIM(run(*controller, 100, 100 + 1024 + 1, output) == TENODESIS_DAMAGED);
  for (const Number sent : output.spool_velocity) CLAIM(sent == 0);
  CLAIM(tenodesis_joints_reset(controller.get()) == TENODESIS_NOT_STARTED);
}

}  // namespace

int main() {
  it_steps_only_where_it_was_started_with_sound_parameters();
  a_reading_that_is_no_number_stops_the_motors_and_is_recorded();
  damaged_memory_never_crashes_it_and_stops_the_motors_where_parameters_change();
  return claims::report();
}

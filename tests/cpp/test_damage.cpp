// Claims about memory that is damaged: it never crashes the controller, and stops its motors where parameters change.

#include <cmath>
#include <cstring>
#include <memory>
#include <random>

#include "c_readings.hpp"
#include "claim.hpp"

/// Bytes from the controller's memory on that a session uses.
std::size_t used_bytes(const tenodesis_controller& controller) {
  const auto* const bytes = reinterpret_cast<const unsigned char*>(&controller);
  std::size_t used = sizeof controller;
  while (used > 0 && bytes[used - 1] == 0) --used;
  return used;
}

// Whatever bit flips, and when.
void a_bit_that_flips_never_crashes_and_sends_no_motor_what_is_no_number() {
  for (const unsigned joint_type : {TENODESIS_TENDON_GEAR, TENODESIS_CONTINUUM}) {
    tenodesis_parameters p = parameters(joint_type, two);
    auto controller = std::make_unique<tenodesis_controller>();
    std::memset(controller.get(), 0, sizeof *controller);
    CLAIM(tenodesis_init(controller.get(), &p) == TENODESIS_OK);
    Readings readings;
    tenodesis_output output;
    for (int tick = 0; tick < 300; ++tick) {
      const tenodesis_input input = readings.at(tick);
      tenodesis_step(controller.get(), &input, &output);
    }
    const std::size_t used = used_bytes(*controller);
    std::mt19937 random(seed);  // NOLINT(cert-msc32-c,cert-msc51-cpp,bugprone-random-generator-seed)
    auto damaged = std::make_unique<tenodesis_controller>();
    for (int trial = 0; trial < 6000; ++trial) {
      *damaged = *controller;
      // Each byte of the head, where marks, check word and the recorder's places are, and others at random.
      const std::size_t at = trial < 3000 ? std::size_t(trial) % 120 : random() % used;
      reinterpret_cast<unsigned char*>(damaged.get())[at] ^= static_cast<unsigned char>(1U << (random() % 8));
      Readings after = readings;
      for (int tick = 300; tick < 305; ++tick) {
        const tenodesis_input input = after.at(tick);
        tenodesis_step(damaged.get(), &input, &output);
        for (const auto& axis : output.axis)
          for (const Number sent : axis.spool_velocity) CLAIM(std::isfinite(sent));
        tenodesis_record record;
        for (int n = 0; n < tenodesis_records(damaged.get()); n += 7) tenodesis_read_record(damaged.get(), n, &record);
        tenodesis_phase(damaged.get(), 1);
        tenodesis_wound(damaged.get(), 1);
      }
    }
  }
}

void parameters_that_have_changed_in_memory_stop_the_motors() {
  tenodesis_parameters p = parameters(TENODESIS_TENDON_GEAR, two);
  const Number gain = p.axis[0].gain = Number(11.8125);
  tenodesis_controller controller;
  CLAIM(tenodesis_init(&controller, &p) == TENODESIS_OK);
  CLAIM(tenodesis_choose(&controller, TENODESIS_LAW_ROBUST, TENODESIS_ACTUATION_DIFFERENTIAL) == TENODESIS_OK);
  auto* const bytes = reinterpret_cast<unsigned char*>(&controller);
  const auto number = [&](std::size_t place) {
    Number found;
    std::memcpy(&found, bytes + place, sizeof found);
    return found;
  };
  std::size_t at = 0;
  while (number(at) != gain) ++at;
  Readings readings;
  tenodesis_output output;
  int code = TENODESIS_OK, tick = 0;
  for (; tick < 1400 && code == TENODESIS_OK; ++tick) {
    if (tick == 200) bytes[at] ^= 1U;
    const tenodesis_input input = readings.at(tick);
    code = tenodesis_step(&controller, &input, &output);
  }
  CLAIM(code == TENODESIS_DAMAGED && tick > 200 && tick <= 200 + 1024 + 1);
  const tenodesis_input input = readings.at(tick);
  CLAIM(tenodesis_step(&controller, &input, &output) == TENODESIS_DAMAGED);
  CLAIM(output.axis[0].spool_velocity[0] == 0 && output.state == TENODESIS_DISABLED);
  CLAIM(tenodesis_reset(&controller) == TENODESIS_NOT_STARTED);
  CLAIM(tenodesis_init(&controller, &p) == TENODESIS_OK);
  CLAIM(tenodesis_step(&controller, &input, &output) == TENODESIS_OK);
}

int main() {
  a_bit_that_flips_never_crashes_and_sends_no_motor_what_is_no_number();
  parameters_that_have_changed_in_memory_stop_the_motors();
  return claims::report();
}

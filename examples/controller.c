/* The controller from C99: set it up with an exported header, run it against a made-up instrument, and have it refuse
 * a bad reading.
 *
 *   tenodesis export controller scaled-up --own-clock --out scaled_up.h
 *   c++ -std=c++20 -O2 -fno-math-errno -Iinclude -c src/c/tenodesis.cpp
 *   cc -std=c99 -Iinclude -I. examples/controller.c tenodesis.o -lm
 *
 * Add -DTENODESIS_REAL=double to both for double precision. Research software, not a medical device.
 */
#include <math.h>
#include <stdio.h>

#include "scaled_up.h"

#define DEGREE 0.017453292519943295

/* An instrument without friction: the load bends its tip back, its motors follow with a delay. */
typedef struct {
  double handle_angle; /* rad */
  double tip;          /* sine of half the output angle */
  double force;        /* at the tip, N */
  double spool[2];     /* rad */
  double speed[2];     /* rad/s */
  unsigned noise;      /* of the load cells; a reading that never flickers counts as stuck */
} plant;

static void measure(plant* on, const tenodesis_axis_parameters* p, tenodesis_measurement* to) {
  const double cosine = sqrt(1 - on->tip * on->tip);
  const double difference = on->force * (p->end_effector_length / (p->distal_radius * cosine) + 1);
  const double wound = p->spool_radius * (on->spool[0] + on->spool[1]) / 2;
  const double drawn = 2 * p->proximal_radius * sin(on->handle_angle / 2);
  const double across = p->spool_radius * (on->spool[0] - on->spool[1]) / 2;
  on->tip = (drawn + across - difference / (2 * p->stiffness)) / (2 * p->distal_radius);
  to->handle_angle = TENODESIS_C(on->handle_angle);
  for (int i = 0; i < 2; ++i) {
    on->noise = on->noise * 1664525u + 1013904223u;
    const double flicker = ((on->noise >> 16) / 65536.0 - 0.5) * 0.1;
    const double half = i == 0 ? difference / 2 : -difference / 2;
    to->tension[i] = TENODESIS_C(p->pretension + p->stiffness * wound + half + flicker);
    to->spool_angle[i] = TENODESIS_C(on->spool[i]);
  }
}

static void follow(plant* on, const tenodesis_axis_parameters* p, const tenodesis_axis_output* from, double period) {
  for (int i = 0; i < 2; ++i) {
    on->speed[i] += (from->spool_velocity[i] - on->speed[i]) * period / (p->drive_time_constant + period);
    on->spool[i] += on->speed[i] * period;
  }
}

static void print(double time, const plant* on, const tenodesis_output* output) {
  static const char* const state[] = {"disabled", "enabled", "paused", "fault"};
  const tenodesis_axis_output* axis = &output->axis[0];
  printf("%4.1f s  %-8s  tip %6.2f deg, estimated %6.2f +- %.2f deg  force %5.2f N  friction %.2f", time,
         state[output->state], 2 * asin(on->tip) / DEGREE, axis->output_angle / DEGREE, axis->output_angle_std / DEGREE,
         axis->tip_force, axis->friction_scale);
  for (uint32_t n = 0; n < TENODESIS_FAULTS; ++n) {
    if (output->faults >> n & 1u) printf("  %s", tenodesis_fault_name(n));
  }
  printf("\n");
}

int main(void) {
  static tenodesis_controller controller;
  const tenodesis_axis_parameters* axis = &scaled_up.axis[0];
  const double period = scaled_up.period;
  plant instrument = {0};
  tenodesis_output output;

  if (tenodesis_version() != TENODESIS_VERSION || tenodesis_real_size() != sizeof(tenodesis_real)) return 1;
  const int code = tenodesis_init(&controller, &scaled_up);
  if (code != TENODESIS_OK) {
    printf("tenodesis_init: %d\n", code);
    return 1;
  }

  for (int tick = 0; tick < 10000; ++tick) {
    const double time = tick * period;
    tenodesis_input input = {0};
    input.time = (uint64_t)tick * 500000u; /* ns */
    input.request = tick == 0 ? TENODESIS_REQUEST_ENABLE : TENODESIS_REQUEST_NONE;
    instrument.handle_angle = 20 * DEGREE * (time < 1 ? (1 - cos(3.141592653589793 * time)) / 2 : 1);
    instrument.force = time < 1.5 ? 0 : 0.5;
    measure(&instrument, axis, &input.axis[0]);

    /* A reading that is not a number, a request to clear the fault, and one to enable again. */
    if (tick == 7000) input.axis[0].handle_angle = (tenodesis_real)NAN;
    if (tick == 7600) input.request = TENODESIS_REQUEST_CLEAR;
    if (tick == 7800) input.request = TENODESIS_REQUEST_ENABLE;

    if (tenodesis_step(&controller, &input, &output) != TENODESIS_OK) return 1;
    follow(&instrument, axis, &output.axis[0], period);
    if (tick % 1000 == 999 || tick == 7000 || tick == 7600 || tick == 7800) print(time, &instrument, &output);
    if (tick == 7000 && output.state != TENODESIS_FAULT) return 1;
  }

  tenodesis_counts counts;
  if (tenodesis_read_counts(&controller, 0, &counts) != TENODESIS_OK) return 1;
  printf("bad readings of the handle: %u\n", (unsigned)counts.bad_samples[0]);
  const double lost = 2 * asin(axis->proximal_radius / axis->distal_radius * sin(instrument.handle_angle / 2)) -
                      2 * asin(instrument.tip);
  printf("lost to the load: %.2f deg\n", lost / DEGREE);
  return output.state == TENODESIS_ENABLED && fabs(lost) < DEGREE ? 0 : 1;
}

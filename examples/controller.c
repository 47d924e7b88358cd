/* The controller from C99: set it up with an exported header, run it against a made-up instrument, and have it refuse
 * a bad reading.
 *
 *   tenodesis export controller real-size --homed --own-clock
 *   c++ -std=c++20 -O2 -fno-math-errno -Iinclude -c src/c/tenodesis.cpp
 *   cc -std=c99 -Iinclude -I. -DINSTRUMENT=real_size examples/controller.c tenodesis.o -lm
 *
 * INSTRUMENT is the name that the export printed: of the header, without .h, and of the constant in it. Without it the
 * example takes scaled_up; that of this folder where -Iexamples is given. Add -DTENODESIS_REAL=double to both compilers
 * for double precision. Research software, not a medical device.
 */
#include <math.h>
#include <stdio.h>

#ifndef INSTRUMENT
#define INSTRUMENT scaled_up
#endif
#define HEADER_OF(name) <name.h>
#define TEXT_OF(name) #name
#define EXPANDED(macro, name) macro(name)
/* In angle brackets, so that the folders of -I decide, not the folder of this file. */
#include EXPANDED(HEADER_OF, INSTRUMENT)

#define DEGREE 0.017453292519943295

/* One axis without friction: the load bends its tip back, its motors follow with a delay. */
typedef struct {
  double handle_angle; /* rad */
  double output_angle; /* rad */
  double force;        /* at the tip, N */
  double spool[2];     /* rad */
  double speed[2];     /* rad/s */
  unsigned noise;      /* of the load cells; a reading that never flickers counts as stuck */
} plant;

/* Tendon that a joint takes up when it turns, and its inverse: a gear's tendon runs straight, a pulley's is wound. */
static double excursion(double radius, double angle) {
  return INSTRUMENT.joint_type == TENODESIS_TENDON_GEAR ? 2 * radius * sin(angle / 2) : radius * angle;
}
static double turned(double radius, double drawn) {
  return INSTRUMENT.joint_type == TENODESIS_TENDON_GEAR ? 2 * asin(drawn / (2 * radius)) : drawn / radius;
}

/* Difference of the tensions that balances a force at the tip. */
static double balance(const plant* on, const tenodesis_axis_parameters* p) {
  const double leverage = p->end_effector_length / p->distal_radius;
  const int gear = INSTRUMENT.joint_type == TENODESIS_TENDON_GEAR;
  return on->force * (gear ? leverage / cos(on->output_angle / 2) + 1 : leverage);
}

static void measure(plant* on, const tenodesis_axis_parameters* p, tenodesis_measurement* to) {
  const double difference = balance(on, p);
  const double wound = p->spool_radius * (on->spool[0] + on->spool[1]) / 2;
  const double across = p->spool_radius * (on->spool[0] - on->spool[1]) / 2;
  const double drawn = excursion(p->proximal_radius, on->handle_angle) + across - difference / (2 * p->stiffness);
  on->output_angle = turned(p->distal_radius, drawn);
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
         state[output->state], on->output_angle / DEGREE, axis->output_angle / DEGREE, axis->output_angle_std / DEGREE,
         axis->tip_force, axis->friction_scale);
  for (uint32_t n = 0; n < TENODESIS_FAULTS; ++n) {
    if (output->faults >> n & 1u) printf("  %s", tenodesis_fault_name(n));
  }
  printf("\n");
}

int main(void) {
  static tenodesis_controller controller;
  const tenodesis_axis_parameters* const axis = INSTRUMENT.axis;
  const double period = INSTRUMENT.period;
  plant instrument[TENODESIS_AXES] = {{0}};
  tenodesis_output output;

  if (INSTRUMENT.joint_type == TENODESIS_CONTINUUM) {
    printf("this example simulates gears and pulleys only\n");
    return 1;
  }
  if (tenodesis_version() != TENODESIS_VERSION || tenodesis_real_size() != sizeof(tenodesis_real)) return 1;
  const int code = tenodesis_init(&controller, &INSTRUMENT);
  if (code != TENODESIS_OK) {
    printf("tenodesis_init: %d\n", code);
    return 1;
  }
  printf("%s: radii %g and %g mm, pretension %g N\n", EXPANDED(TEXT_OF, INSTRUMENT), axis->proximal_radius * 1e3,
         axis->distal_radius * 1e3, axis->pretension);

  for (int tick = 0; tick < 10000; ++tick) {
    const double time = tick * period;
    tenodesis_input input = {0};
    input.time = (uint64_t)tick * 500000u; /* ns */
    input.request = tick == 0 ? TENODESIS_REQUEST_ENABLE : TENODESIS_REQUEST_NONE;
    instrument[0].handle_angle = 20 * DEGREE * (time < 1 ? (1 - cos(3.141592653589793 * time)) / 2 : 1);
    instrument[0].force = time < 1.5 ? 0 : 0.5;
    for (uint32_t n = 0; n < INSTRUMENT.axes; ++n) measure(&instrument[n], &axis[n], &input.axis[n]);

    /* A reading that is not a number, a request to clear the fault, and one to enable again. */
    if (tick == 7000) input.axis[0].handle_angle = (tenodesis_real)NAN;
    if (tick == 7600) input.request = TENODESIS_REQUEST_CLEAR;
    if (tick == 7800) input.request = TENODESIS_REQUEST_ENABLE;

    if (tenodesis_step(&controller, &input, &output) != TENODESIS_OK) return 1;
    for (uint32_t n = 0; n < INSTRUMENT.axes; ++n) follow(&instrument[n], &axis[n], &output.axis[n], period);
    if (tick % 1000 == 999 || tick == 7000 || tick == 7600 || tick == 7800) print(time, &instrument[0], &output);
    if (tick == 7000 && output.state != TENODESIS_FAULT) return 1;
  }

  tenodesis_counts counts;
  if (tenodesis_read_counts(&controller, 0, &counts) != TENODESIS_OK) return 1;
  printf("bad readings of the handle: %u\n", (unsigned)counts.bad_samples[0]);
  const double drawn = excursion(axis->proximal_radius, instrument[0].handle_angle);
  const double lost = turned(axis->distal_radius, drawn) - instrument[0].output_angle;
  printf("lost to the load: %.2f deg\n", lost / DEGREE);
  return output.state == TENODESIS_ENABLED && fabs(lost) < DEGREE ? 0 : 1;
}

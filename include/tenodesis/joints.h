/* The controller of all joints of an instrument behind a plain C interface: also where tendons turn several joints.
 *
 * Its sizes are chosen when it is built: TENODESIS_JOINTS at the tip (those of the handle are not more),
 * TENODESIS_TENDONS, and TENODESIS_CONTACTS at most along a tendon. `tenodesis export controller` writes a header with
 * the sizes and the parameters of an instrument; build src/c/joints.cpp with the same sizes, as by -include of that
 * header, and with the same TENODESIS_REAL. What tenodesis.h says of memory, requests, states and faults holds here,
 * too.
 *
 *   tenodesis_joints controller;
 *   tenodesis_joints_init(&controller, &parameters);
 *   each tick: tenodesis_joints_step(&controller, &input, &output);  then send output.spool_velocity
 *
 * Spools are at the pretension, joints straight, where their angles count from. Homing, which it does without, learns
 * stiffness and friction: it winds all tendons alike and back, with a free tip, and ends paused. SI units and radians.
 * Research software, not a medical device.
 */
#ifndef TENODESIS_JOINTS_H
#define TENODESIS_JOINTS_H

#include "tenodesis/joint_table.h"
#include "tenodesis/tenodesis.h"

#if !defined(TENODESIS_JOINTS) || !defined(TENODESIS_TENDONS) || !defined(TENODESIS_CONTACTS)
#error "define TENODESIS_JOINTS, TENODESIS_TENDONS and TENODESIS_CONTACTS: an exported header does"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define TENODESIS_LOAD 7          /* components: force (N) and moment (N m) in the tip's axes, grip (N) */
#define TENODESIS_CURVE_ENTRIES 8 /* of a tendon's table of stiffness by tension */
#ifndef TENODESIS_JOINTS_RECORDS
#define TENODESIS_JOINTS_RECORDS TENODESIS_RECORDS /* of the flight recorder, 12 or more; ticks as of tenodesis.h */
#endif

/* Fields, with units and meanings: joint_table.h. */
#define TENODESIS_CHOICE_FIELD(name, meaning) uint32_t name;
#define TENODESIS_REAL_FIELD(name, unit, bound, meaning) tenodesis_real name;

typedef struct {
  TENODESIS_JOINT_CHOICES(TENODESIS_CHOICE_FIELD)
  TENODESIS_JOINT_PARAMETERS(TENODESIS_REAL_FIELD)
} tenodesis_joint;

typedef struct {
  TENODESIS_CONTACT_CHOICES(TENODESIS_CHOICE_FIELD)
  TENODESIS_CONTACT_PARAMETERS(TENODESIS_REAL_FIELD)
} tenodesis_contact;

typedef struct {
  TENODESIS_TENDON_CHOICES(TENODESIS_CHOICE_FIELD)
  TENODESIS_TENDON_PARAMETERS(TENODESIS_REAL_FIELD)
  tenodesis_real arm[TENODESIS_JOINTS];                  /* drawn by a unit of each joint's coordinate, m */
  tenodesis_real handle_arm[TENODESIS_JOINTS];           /* wound by a unit of each of the handle's, m */
  tenodesis_real curve_tension[TENODESIS_CURVE_ENTRIES]; /* rising from 0, N */
  tenodesis_real curve_ratio[TENODESIS_CURVE_ENTRIES];   /* stiffness there over that at rest */
  tenodesis_contact contact[TENODESIS_CONTACTS];
} tenodesis_tendon;

typedef struct {
  TENODESIS_JOINTS_CHOICES(TENODESIS_CHOICE_FIELD)
  uint32_t handle[TENODESIS_JOINTS + TENODESIS_JOINTS % 2]; /* mechanisms of the handle: TENODESIS_TENDON_GEAR, ... */
  TENODESIS_JOINTS_PARAMETERS(TENODESIS_REAL_FIELD)
  tenodesis_limit spool_jump;              /* rad/s */
  tenodesis_limit limit[TENODESIS_FAULTS]; /* by number of the fault */
  tenodesis_joint joint[TENODESIS_JOINTS];
  tenodesis_tendon tendon[TENODESIS_TENDONS];
  /* Of coordinates, that the law has prepared: what tendons can give of those lost, what joints follow of those wound,
   * and those by lengths wound, 1/m. */
  tenodesis_real within[TENODESIS_JOINTS][TENODESIS_JOINTS];
  tenodesis_real response[TENODESIS_JOINTS][TENODESIS_JOINTS];
  tenodesis_real settled[TENODESIS_JOINTS][TENODESIS_TENDONS];
} tenodesis_joints_parameters;

#undef TENODESIS_CHOICE_FIELD
#undef TENODESIS_REAL_FIELD

typedef struct {
  uint64_t time;    /* ns */
  uint32_t request; /* TENODESIS_REQUEST_... */
  uint32_t reserved;
  tenodesis_real handle_angle[TENODESIS_JOINTS]; /* rad */
  tenodesis_real target[TENODESIS_JOINTS];       /* angles commanded of a tool without a handle, rad */
  tenodesis_real tension[TENODESIS_TENDONS];     /* N */
  tenodesis_real spool_angle[TENODESIS_TENDONS]; /* rad; positive winds */
} tenodesis_joints_input;

typedef struct {
  uint32_t state;        /* TENODESIS_DISABLED ... */
  uint32_t faults;       /* latched ones in the fault state, otherwise those present */
  uint32_t first_faults; /* those that led to the fault state */
  uint32_t cut_power;    /* 1: a motor does not obey; a relay in the supply of the motors must open */
  tenodesis_real spool_velocity[TENODESIS_TENDONS]; /* rad/s; finite whatever the input */
  tenodesis_real output_angle[TENODESIS_JOINTS];    /* rad */
  tenodesis_real output_angle_std[TENODESIS_JOINTS];
  tenodesis_real friction_scale;
  tenodesis_real friction_scale_std;
  tenodesis_real load[TENODESIS_LOAD]; /* zero unless the parameters ask for it */
  tenodesis_real load_std[TENODESIS_LOAD];
} tenodesis_joints_output;

/* A tick in the flight recorder. */
typedef struct {
  uint64_t time;
  uint32_t state;
  uint32_t faults;
  tenodesis_real handle_angle[TENODESIS_JOINTS];
  tenodesis_real output_angle[TENODESIS_JOINTS];
  tenodesis_real tension[TENODESIS_TENDONS];
  tenodesis_real spool_angle[TENODESIS_TENDONS];
  tenodesis_real spool_velocity[TENODESIS_TENDONS];
} tenodesis_joints_record;

/* Memory of a controller, words; its contents are private. */
#define TENODESIS_JOINTS_REALS                                                     \
  (700u + 130u * TENODESIS_JOINTS + 8u * TENODESIS_JOINTS * TENODESIS_JOINTS +     \
   TENODESIS_TENDONS * (160u + 6u * TENODESIS_JOINTS + 20u * TENODESIS_CONTACTS) + \
   TENODESIS_JOINTS_RECORDS * (2u * TENODESIS_JOINTS + 3u * TENODESIS_TENDONS + 6u))
typedef struct {
  uint64_t storage[TENODESIS_JOINTS_REALS * sizeof(tenodesis_real) / 8u + 1u];
} tenodesis_joints;

/* Return values and meanings as of the functions of tenodesis.h with the same names. */
TENODESIS_API int tenodesis_joints_init(tenodesis_joints* controller, const tenodesis_joints_parameters* parameters);
TENODESIS_API int tenodesis_joints_step(tenodesis_joints* controller, const tenodesis_joints_input* input,
                                        tenodesis_joints_output* output);
TENODESIS_API int tenodesis_joints_reset(tenodesis_joints* controller);
/* Whether the motors give back what joints lose (1), from the next tick on, or follow their targets alone (0). */
TENODESIS_API int tenodesis_joints_choose(tenodesis_joints* controller, uint32_t compensates);
TENODESIS_API int tenodesis_joints_watchdog(const tenodesis_joints* controller, uint64_t since_last_step);
TENODESIS_API int tenodesis_joints_records(const tenodesis_joints* controller);
TENODESIS_API int tenodesis_joints_read_record(const tenodesis_joints* controller, int number,
                                               tenodesis_joints_record* record);

#ifdef __cplusplus
}
#endif

#endif

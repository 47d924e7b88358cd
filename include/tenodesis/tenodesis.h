/* The controller behind a plain C interface: for firmware, LabVIEW, Simulink and other programs that call C.
 *
 * Every struct is plain data of fixed layout; the controller itself is kept in memory that the caller owns. No call
 * allocates, blocks or keeps a pointer, and none reads beyond its arguments: sizes are checked, and whether a
 * controller was initialised. Controllers share nothing, and a copy of a controller is an independent controller.
 *
 *   tenodesis_controller controller;
 *   tenodesis_init(&controller, &parameters);
 *   each tick: tenodesis_step(&controller, &input, &output);  then send output.axis[n].spool_velocity
 *
 * Build src/c/tenodesis.cpp with the same TENODESIS_REAL. `tenodesis export controller` writes the parameters of an
 * instrument file as a header. SI units and radians. Research software, not a medical device.
 */
#ifndef TENODESIS_TENODESIS_H
#define TENODESIS_TENODESIS_H

#include <stddef.h>
#include <stdint.h>

#include "tenodesis/parameter_table.h"

#ifndef TENODESIS_REAL
#define TENODESIS_REAL float
#endif

/* Of a shared library these functions are all that is visible. It is built with TENODESIS_SHARED and TENODESIS_BUILDS,
 * and used with TENODESIS_SHARED. */
#if !defined(TENODESIS_SHARED)
#define TENODESIS_API
#elif defined(_WIN32) && defined(TENODESIS_BUILDS)
#define TENODESIS_API __declspec(dllexport)
#elif defined(_WIN32)
#define TENODESIS_API __declspec(dllimport)
#else
#define TENODESIS_API __attribute__((visibility("default")))
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef TENODESIS_REAL tenodesis_real;

#define TENODESIS_C(value) ((tenodesis_real)(value)) /* a constant */

#define TENODESIS_VERSION 6u /* of this interface: raised whenever a struct or a meaning changes */
#define TENODESIS_AXES 2
#define TENODESIS_FAULTS 15
#define TENODESIS_RECORDS 111    /* of the flight recorder: 100 before a fault, the fault's, 10 after */
#define TENODESIS_RECORD_TICKS 4 /* ticks per record: the last 200 ms at 2 kHz */

#define TENODESIS_STORAGE_WORDS (512u * sizeof(tenodesis_real)) /* 16 KiB in float, 32 KiB in double */

/* Return values. */
enum {
  TENODESIS_OK = 0,
  TENODESIS_BAD_POINTER = 1,   /* a pointer is null, or not aligned for its type */
  TENODESIS_NOT_STARTED = 2,   /* the controller was not initialised, or with another build */
  TENODESIS_BAD_VERSION = 3,   /* the parameters are of another version, size or precision */
  TENODESIS_BAD_PARAMETER = 4, /* a parameter, record or axis is out of range; see tenodesis_init */
  TENODESIS_BAD_REQUEST = 5,   /* there is no such request; the tick was taken without it */
  TENODESIS_DAMAGED = 6        /* the memory of the controller has changed: initialise it again */
};

enum { TENODESIS_TENDON_GEAR, TENODESIS_TENDON_PULLEY, TENODESIS_CONTINUUM };
enum { TENODESIS_OBSERVER_PAPER, TENODESIS_OBSERVER_EXACT, TENODESIS_OBSERVER_FRICTION };
enum {
  TENODESIS_LAW_OFF,
  TENODESIS_LAW_PAPER,
  TENODESIS_LAW_PAPER_FEEDBACK,
  TENODESIS_LAW_EXACT,
  TENODESIS_LAW_ROBUST
};
/* By what the robust law sees the tip: common strokes, or dither of both spools after each change. */
enum { TENODESIS_OBSERVE_STROKES, TENODESIS_OBSERVE_DITHER, TENODESIS_OBSERVE_AUTO };
enum { TENODESIS_ACTUATION_AGONIST, TENODESIS_ACTUATION_DIFFERENTIAL };
/* After a fault the motors stand, or return home; stopped motors (disabled, paused, or their law off) return, or stand.
 * They begin after hold_time, and never by spools whose zero a fault makes unknown. */
enum { TENODESIS_SAFE_HOLD, TENODESIS_SAFE_NEUTRAL };
enum { TENODESIS_STOP_RETURN, TENODESIS_STOP_HOLD };
enum {
  TENODESIS_REQUEST_NONE,
  TENODESIS_REQUEST_ENABLE,
  TENODESIS_REQUEST_DISABLE,
  TENODESIS_REQUEST_PAUSE,
  TENODESIS_REQUEST_RESUME,
  TENODESIS_REQUEST_HOME,
  TENODESIS_REQUEST_CLEAR
};
enum { TENODESIS_DISABLED, TENODESIS_ENABLED, TENODESIS_PAUSED, TENODESIS_FAULT };

/* Faults, TENODESIS_FAULT_TENDON_BREAK and so on: bit 1u << number of a mask. */
enum {
#define TENODESIS_FAULT_NUMBER(name, NAME, unit, meaning) TENODESIS_FAULT_##NAME,
  TENODESIS_FAULT_TABLE(TENODESIS_FAULT_NUMBER)
#undef TENODESIS_FAULT_NUMBER
};

/* Why homing failed: TENODESIS_HOMING_TIP_LOADED and so on. */
enum {
#define TENODESIS_HOMING_NUMBER(name, NAME, meaning) TENODESIS_HOMING_##NAME,
  TENODESIS_HOMING_REASON_TABLE(TENODESIS_HOMING_NUMBER)
#undef TENODESIS_HOMING_NUMBER
};

typedef struct {
  tenodesis_real threshold;   /* 0 switches the check off */
  tenodesis_real persistence; /* s */
} tenodesis_limit;

/* Fields, with units and meanings: parameter_table.h. */
#define TENODESIS_CHOICE_FIELD(name, meaning) uint32_t name;
#define TENODESIS_REAL_FIELD(name, unit, bound, meaning) tenodesis_real name;

typedef struct {
  TENODESIS_AXIS_PARAMETERS(TENODESIS_REAL_FIELD)
  tenodesis_limit spool_jump;              /* rad/s */
  tenodesis_limit limit[TENODESIS_FAULTS]; /* by number of the fault */
} tenodesis_axis_parameters;

typedef struct {
  TENODESIS_CHOICES(TENODESIS_CHOICE_FIELD)
  TENODESIS_COMMON_PARAMETERS(TENODESIS_REAL_FIELD)
  tenodesis_axis_parameters axis[TENODESIS_AXES];
} tenodesis_parameters;

#undef TENODESIS_CHOICE_FIELD
#undef TENODESIS_REAL_FIELD

typedef struct {
  tenodesis_real handle_angle;   /* rad */
  tenodesis_real tension[2];     /* agonist, antagonist, N */
  tenodesis_real spool_angle[2]; /* rad; positive winds */
} tenodesis_measurement;

typedef struct {
  uint64_t time;    /* ns */
  uint32_t request; /* TENODESIS_REQUEST_... */
  uint32_t reserved;
  tenodesis_measurement axis[TENODESIS_AXES];
} tenodesis_input;

typedef struct {
  tenodesis_real spool_velocity[2]; /* rad/s; finite whatever the input */
  tenodesis_real output_angle;      /* rad; a standard deviation that the observer does not know is NaN */
  tenodesis_real output_angle_std;
  tenodesis_real tip_force; /* N */
  tenodesis_real tip_force_std;
  tenodesis_real friction_scale;
  tenodesis_real friction_scale_std;
  uint32_t faults; /* present in this axis */
  uint32_t
      homing_failure; /* of the last homing: TENODESIS_HOMING_..., and 256 for the agonist, 512 for the antagonist */
} tenodesis_axis_output;

typedef struct {
  tenodesis_axis_output axis[TENODESIS_AXES];
  uint32_t state; /* TENODESIS_DISABLED ... */
  uint32_t homed;
  uint32_t homing;
  uint32_t faults;       /* latched ones in the fault state, otherwise those present */
  uint32_t first_faults; /* those that led to the fault state */
  uint32_t cut_power;    /* 1: a motor does not obey; a relay in the supply of the motors must open */
} tenodesis_output;

/* A tick in the flight recorder. */
typedef struct {
  uint64_t time;
  uint32_t state;
  uint32_t faults;
  tenodesis_measurement measured[TENODESIS_AXES];
  tenodesis_real spool_velocity[TENODESIS_AXES][2];
  tenodesis_real output_angle[TENODESIS_AXES];
} tenodesis_record;

/* How often each fault was confirmed, and the number of implausible samples of each sensor. */
typedef struct {
  uint32_t faults[TENODESIS_FAULTS];
  uint32_t bad_samples[5]; /* handle, agonist and antagonist load cell, agonist and antagonist spool */
  uint32_t late_ticks;
} tenodesis_counts;

/* Memory of a controller; its contents are private. */
typedef struct {
  uint64_t storage[TENODESIS_STORAGE_WORDS];
} tenodesis_controller;

/* Sets a controller up, disabled. After an error it cannot be stepped, whatever it was before. Every parameter must be
 * finite, keep its bound in parameter_table.h, be one of the choices above, and fit the others. */
TENODESIS_API int tenodesis_init(tenodesis_controller* controller, const tenodesis_parameters* parameters);
/* One tick. On any error except TENODESIS_BAD_REQUEST the output is all zero. A part of the parameters, as the
 * controller keeps them, is checked with each tick, and all of them within 1,024 ticks. */
TENODESIS_API int tenodesis_step(tenodesis_controller* controller, const tenodesis_input* input,
                                 tenodesis_output* output);
/* Returns to the state after tenodesis_init. */
TENODESIS_API int tenodesis_reset(tenodesis_controller* controller);
/* Changes law (TENODESIS_LAW_...) and actuation (TENODESIS_ACTUATION_...) from the next tick on. Where there is no such
 * choice, or the law does not work with the observer, nothing changes: TENODESIS_BAD_PARAMETER. A reset keeps them. */
TENODESIS_API int tenodesis_choose(tenodesis_controller* controller, uint32_t law, uint32_t actuation);
/* Whether motors must stop (1) because there was no tick for so long, ns; for an independent timer. Always 1 without a
 * controller. */
TENODESIS_API int tenodesis_watchdog(const tenodesis_controller* controller, uint64_t since_last_step);
/* The flight recorder: number of records (0 without a controller), and a record by its age (0 is the oldest). */
TENODESIS_API int tenodesis_records(const tenodesis_controller* controller);
TENODESIS_API int tenodesis_read_record(const tenodesis_controller* controller, int number, tenodesis_record* record);
TENODESIS_API int tenodesis_read_counts(const tenodesis_controller* controller, int axis, tenodesis_counts* counts);
/* Phase of the robust law on an axis: 0 rest, 1 track, 2 pull, 3 release, 4 restrained (tracking, by less than the law
 * wants), 5 yielding (at the force limit); 0 without such a controller or axis. */
TENODESIS_API uint32_t tenodesis_phase(const tenodesis_controller* controller, int axis);
/* How far the motors hold the tip from where it would be with their spools at home, rad; 0 without such an axis. */
TENODESIS_API tenodesis_real tenodesis_wound(const tenodesis_controller* controller, int axis);
/* Tension, N, for an input without load cells: what a motor's current (A) stands for, at torque constant times gear
 * ratio over spool radius (N/A), up to the current's range (A). The drive's friction is still in it: of parameters that
 * `tenodesis export controller` has written for currents, it is a part of the sheath's. */
TENODESIS_API tenodesis_real tenodesis_tension_from_current(tenodesis_real current, tenodesis_real tension_per_current,
                                                            tenodesis_real range);
/* Version of the library, and the size of its tenodesis_real. */
TENODESIS_API uint32_t tenodesis_version(void);
TENODESIS_API uint32_t tenodesis_real_size(void);
/* Name of a fault, and of a reason for which homing failed; "unknown" for other numbers. */
TENODESIS_API const char* tenodesis_fault_name(uint32_t number);
TENODESIS_API const char* tenodesis_homing_reason_name(uint32_t number);

#ifdef __cplusplus
}
#endif

#endif

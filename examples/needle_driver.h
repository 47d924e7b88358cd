/* The controller of all joints of needle-driver for tenodesis_joints_init:
 * pitch, jaw_1, jaw_2.
 *
 * Written by tenodesis 0.1.0 from needle-driver,
 * for version 3 of the C interface:
 * the input's clock.
 *
 * Spools are at the pretension and joints straight where spool angles count from. Build src/c/joints.cpp by
 * -include of this header, and of no other.
 */
#ifndef TENODESIS_PARAMETERS_NEEDLE_DRIVER_H
#define TENODESIS_PARAMETERS_NEEDLE_DRIVER_H

#ifndef TENODESIS_JOINTS
#define TENODESIS_JOINTS 3
#elif TENODESIS_JOINTS != 3
#error "another instrument's size: TENODESIS_JOINTS"
#endif
#ifndef TENODESIS_TENDONS
#define TENODESIS_TENDONS 6
#elif TENODESIS_TENDONS != 6
#error "another instrument's size: TENODESIS_TENDONS"
#endif
#ifndef TENODESIS_CONTACTS
#define TENODESIS_CONTACTS 3
#elif TENODESIS_CONTACTS != 3
#error "another instrument's size: TENODESIS_CONTACTS"
#endif
#include "tenodesis/joints.h"

#if TENODESIS_JOINTS_VERSION != 3u
#error "written for another version of the C interface: export the instrument again"
#endif

static const tenodesis_joints_parameters needle_driver = {
    .size = sizeof(tenodesis_joints_parameters),
    .version = TENODESIS_JOINTS_VERSION,
    .handles = 0,
    .friction_law = 0,
    .compensates = 1,
    .shows_load = 0,
    .own_clock = 0,
    .reserved = 0,
    .handle = {0},
    .constant = TENODESIS_C(0.0), /* N: friction that does not depend on the load */
    .static_ratio = TENODESIS_C(1.0), /* 1: static over kinetic friction */
    .stribeck_speed = TENODESIS_C(0.001), /* m/s: over which static friction falls to kinetic */
    .memory = TENODESIS_C(0.005), /* s: with which friction follows the speed */
    .load_index = TENODESIS_C(1.0), /* 1: power of the tension in friction */
    .reference_tension = TENODESIS_C(1.0), /* N: at which that power counts nothing */
    .bending_loss = TENODESIS_C(0.0), /* N: of a tendon that is stiff in bending */
    .sheath_bend_rate = TENODESIS_C(0.0), /* rad/rad: bend of the sheath by the handle's angles */
    .spool_radius = TENODESIS_C(0.0025465), /* m: radius of a spool */
    .spool_step = TENODESIS_C(0.001533980787885641), /* rad: step of a spool's encoder */
    .play = TENODESIS_C(9.765705190876963e-07), /* m: slip that stands out from noise */
    .handle_play = TENODESIS_C(0.0), /* m: by which it is larger from the handle's joints on */
    .tension_play = TENODESIS_C(0.1444140625), /* N: tension by whose stretch that slip is larger farther on */
    .smoothing = TENODESIS_C(0.009900990099009901), /* 1: share of the handle's reading in that which contacts follow */
    .tension_deviation = TENODESIS_C(0.10458132196039893), /* N: standard deviation of a tension */
    .length_deviation = TENODESIS_C(5.125581590252462e-06), /* m: standard deviation of a tendon's length */
    .friction_deviation = TENODESIS_C(0.4), /* 1: standard deviation of the friction scale */
    .stiffness_deviation = TENODESIS_C(0.25), /* 1: standard deviation of the stiffness scale */
    .force_deviation = TENODESIS_C(8.324292941092956), /* N: size of a component of the force at the tip */
    .moment_deviation = TENODESIS_C(0.23640991952704), /* N m: size of a component of the moment at the tip */
    .grip_deviation = TENODESIS_C(8.324292941092956), /* N: size of the force that presses jaws apart */
    .imbalance = TENODESIS_C(0.00023640991952704), /* N m: moment of a joint that no load explains */
    .rate = TENODESIS_C(8.0), /* 1/s: at which a loss is given back */
    .gain = TENODESIS_C(40.0), /* 1/s: of the spools' positions */
    .speed = TENODESIS_C(0.05093), /* m/s: largest speed of a tendon */
    .tension_limit = TENODESIS_C(80.0), /* N: above it the motors give nothing more */
    .least_tension = TENODESIS_C(0.15), /* 1: share of the pretension below which a tendon is tightened */
    .deviations = TENODESIS_C(1.0), /* 1: of the estimate that a stroke leaves room for */
    .homing_time = TENODESIS_C(2.0), /* s: of strokes that wind all tendons alike */
    .homing_rise = TENODESIS_C(0.6), /* 1: of the tensions in it, share of the pretension */
    .period = TENODESIS_C(0.0005), /* s: nominal time between ticks */
    .speed_limit = TENODESIS_C(20.0), /* rad/s: largest speed of a spool */
    .acceleration_limit = TENODESIS_C(400.0), /* rad/s^2: largest acceleration of a spool */
    .drive_time_constant = TENODESIS_C(0.01), /* s: of the drives' speed loop */
    .engage_time = TENODESIS_C(0.2), /* s: over which motion is faded in */
    .tension_of_fault = TENODESIS_C(100.0), /* N: above it a tendon is only unwound; 0: no limit */
    .unlike_friction = TENODESIS_C(6.0), /* N: tension that is not missed before homing */
    .stroke_limit = TENODESIS_C(0.0024), /* m: largest stroke of a tendon beyond its target */
    .pretension = TENODESIS_C(20.0), /* N: largest of all tendons */
    .stiffness = TENODESIS_C(100000.0), /* N/m: least of all tendons */
    .load_cell_range = TENODESIS_C(199.993896484375), /* N: largest reading of a load cell */
    .handle_range = TENODESIS_C(1.0), /* rad: largest absolute handle angle */
    .handle_noise = TENODESIS_C(0.009203884727313847), /* rad: largest difference of two readings of a handle at rest */
    .spool_noise = TENODESIS_C(0.0038349519697141025), /* rad: the same of a spool */
    .spool_jump = {TENODESIS_C(60.0), TENODESIS_C(0.0006)}, /* rad/s, s */
    .limit =
        {
            {TENODESIS_C(7.6), TENODESIS_C(0.008)}, /* tendon_break: N, s */
            {TENODESIS_C(0.4), TENODESIS_C(2.0)}, /* tendon_slack: N, s */
            {TENODESIS_C(100.0), TENODESIS_C(0.003)}, /* over_tension: N, s */
            {TENODESIS_C(0.009), TENODESIS_C(0.04)}, /* load_cell_stuck: N, s */
            {TENODESIS_C(1.6), TENODESIS_C(0.005)}, /* load_cell_range: N, s */
            {TENODESIS_C(1.0), TENODESIS_C(0.5)}, /* load_cell_drift: N, s */
            {TENODESIS_C(0.1), TENODESIS_C(0.005)}, /* encoder_dropout: rad, s */
            {TENODESIS_C(30.0), TENODESIS_C(0.0006)}, /* encoder_jump: rad/s, s */
            {TENODESIS_C(2.0), TENODESIS_C(0.006)}, /* spool_slip: N, s */
            {TENODESIS_C(0.008), TENODESIS_C(0.005)}, /* motor_not_following: rad, s */
            {TENODESIS_C(0.025), TENODESIS_C(0.0)}, /* tick_late: s, s */
            {TENODESIS_C(0.0), TENODESIS_C(0.0)}, /* not_a_number: 1, s */
            {TENODESIS_C(0.0), TENODESIS_C(0.0)}, /* homing_failed: 1, s */
            {TENODESIS_C(0.017453292519943295), TENODESIS_C(1.0)}, /* stroke_unexplained: rad, s */
            {TENODESIS_C(0.06981317007977318), TENODESIS_C(0.5)}, /* rope_length: rad, s */
        },
    .joint =
        {
            {.mechanism = 1, .within = 0, .parent = 0, .tied_to = 0, .axis_x = TENODESIS_C(-1.0), .axis_y = TENODESIS_C(0.0), .axis_z = TENODESIS_C(0.0), .offset = TENODESIS_C(0.0), .chord = TENODESIS_C(0.0), .length = TENODESIS_C(0.0), .stiffness = TENODESIS_C(0.0), .hardening = TENODESIS_C(0.0), .tie_ratio = TENODESIS_C(0.0), .tie_stiffness = TENODESIS_C(0.0), .share = TENODESIS_C(0.0), .grip = TENODESIS_C(0.0)}, /* pitch */
            {.mechanism = 1, .within = 0, .parent = 1, .tied_to = 0, .axis_x = TENODESIS_C(0.0), .axis_y = TENODESIS_C(1.0), .axis_z = TENODESIS_C(0.0), .offset = TENODESIS_C(0.0091), .chord = TENODESIS_C(0.0), .length = TENODESIS_C(0.010199999999999999), .stiffness = TENODESIS_C(0.0), .hardening = TENODESIS_C(0.0), .tie_ratio = TENODESIS_C(0.0), .tie_stiffness = TENODESIS_C(0.0), .share = TENODESIS_C(0.5), .grip = TENODESIS_C(0.010199999999999999)}, /* jaw_1 */
            {.mechanism = 1, .within = 0, .parent = 1, .tied_to = 0, .axis_x = TENODESIS_C(0.0), .axis_y = TENODESIS_C(1.0), .axis_z = TENODESIS_C(0.0), .offset = TENODESIS_C(0.0091), .chord = TENODESIS_C(0.0), .length = TENODESIS_C(0.010199999999999999), .stiffness = TENODESIS_C(0.0), .hardening = TENODESIS_C(0.0), .tie_ratio = TENODESIS_C(0.0), .tie_stiffness = TENODESIS_C(0.0), .share = TENODESIS_C(0.5), .grip = TENODESIS_C(-0.010199999999999999)}, /* jaw_2 */
        },
    .tendon =
        {
            { /* pitch_wound */
                .contacts = 2, .motor = 1, .curve_entries = 0, .reserved = 0, .stiffness = TENODESIS_C(100000.0), .pretension = TENODESIS_C(20.0), .end_compliance = TENODESIS_C(9.990009990009991e-09),
                .arm = {TENODESIS_C(0.0025), TENODESIS_C(0.0), TENODESIS_C(0.0)},
                .handle_arm = {0},
                .curve_tension = {0},
                .curve_ratio = {0},
                .contact =
                    {
                        {.joint = 0, .reserved = 0, .compliance = TENODESIS_C(4.995004995004996e-07), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.0), .wound = TENODESIS_C(0.0)},
                        {.joint = 1, .reserved = 0, .compliance = TENODESIS_C(9.490509490509493e-06), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(-0.0025), .wound = TENODESIS_C(-0.0)},
                    },
            },
            { /* pitch_unwound */
                .contacts = 2, .motor = 1, .curve_entries = 0, .reserved = 0, .stiffness = TENODESIS_C(100000.0), .pretension = TENODESIS_C(20.0), .end_compliance = TENODESIS_C(9.990009990009991e-09),
                .arm = {TENODESIS_C(-0.0025), TENODESIS_C(0.0), TENODESIS_C(0.0)},
                .handle_arm = {0},
                .curve_tension = {0},
                .curve_ratio = {0},
                .contact =
                    {
                        {.joint = 0, .reserved = 0, .compliance = TENODESIS_C(4.995004995004996e-07), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.0), .wound = TENODESIS_C(0.0)},
                        {.joint = 1, .reserved = 0, .compliance = TENODESIS_C(9.490509490509493e-06), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.0025), .wound = TENODESIS_C(0.0)},
                    },
            },
            { /* jaw_1_wound */
                .contacts = 3, .motor = 1, .curve_entries = 0, .reserved = 0, .stiffness = TENODESIS_C(100000.0), .pretension = TENODESIS_C(20.0), .end_compliance = TENODESIS_C(9.980039920159684e-09),
                .arm = {TENODESIS_C(0.001705123994088), TENODESIS_C(0.002091065856462), TENODESIS_C(0.0)},
                .handle_arm = {0},
                .curve_tension = {0},
                .curve_ratio = {0},
                .contact =
                    {
                        {.joint = 0, .reserved = 0, .compliance = TENODESIS_C(4.990019960079842e-07), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.0), .wound = TENODESIS_C(0.0)},
                        {.joint = 1, .reserved = 0, .compliance = TENODESIS_C(9.4810379241517e-06), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(-0.001705123994088), .wound = TENODESIS_C(-1.5707963267948966)},
                        {.joint = 2, .reserved = 0, .compliance = TENODESIS_C(9.980039920159684e-09), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(-0.002091065856462), .wound = TENODESIS_C(-0.0)},
                    },
            },
            { /* jaw_1_unwound */
                .contacts = 3, .motor = 1, .curve_entries = 0, .reserved = 0, .stiffness = TENODESIS_C(100000.0), .pretension = TENODESIS_C(20.0), .end_compliance = TENODESIS_C(9.980039920159684e-09),
                .arm = {TENODESIS_C(-0.001705123994088), TENODESIS_C(-0.002091065856462), TENODESIS_C(0.0)},
                .handle_arm = {0},
                .curve_tension = {0},
                .curve_ratio = {0},
                .contact =
                    {
                        {.joint = 0, .reserved = 0, .compliance = TENODESIS_C(4.990019960079842e-07), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.0), .wound = TENODESIS_C(0.0)},
                        {.joint = 1, .reserved = 0, .compliance = TENODESIS_C(9.4810379241517e-06), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.001705123994088), .wound = TENODESIS_C(1.5707963267948966)},
                        {.joint = 2, .reserved = 0, .compliance = TENODESIS_C(9.980039920159684e-09), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.002091065856462), .wound = TENODESIS_C(0.0)},
                    },
            },
            { /* jaw_2_wound */
                .contacts = 3, .motor = 1, .curve_entries = 0, .reserved = 0, .stiffness = TENODESIS_C(100000.0), .pretension = TENODESIS_C(20.0), .end_compliance = TENODESIS_C(9.980039920159684e-09),
                .arm = {TENODESIS_C(0.001705123994088), TENODESIS_C(0.0), TENODESIS_C(0.002091065856462)},
                .handle_arm = {0},
                .curve_tension = {0},
                .curve_ratio = {0},
                .contact =
                    {
                        {.joint = 0, .reserved = 0, .compliance = TENODESIS_C(4.990019960079842e-07), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.0), .wound = TENODESIS_C(0.0)},
                        {.joint = 1, .reserved = 0, .compliance = TENODESIS_C(9.4810379241517e-06), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(-0.001705123994088), .wound = TENODESIS_C(-1.5707963267948966)},
                        {.joint = 3, .reserved = 0, .compliance = TENODESIS_C(9.980039920159684e-09), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(-0.002091065856462), .wound = TENODESIS_C(-0.0)},
                    },
            },
            { /* jaw_2_unwound */
                .contacts = 3, .motor = 1, .curve_entries = 0, .reserved = 0, .stiffness = TENODESIS_C(100000.0), .pretension = TENODESIS_C(20.0), .end_compliance = TENODESIS_C(9.980039920159684e-09),
                .arm = {TENODESIS_C(-0.001705123994088), TENODESIS_C(0.0), TENODESIS_C(-0.002091065856462)},
                .handle_arm = {0},
                .curve_tension = {0},
                .curve_ratio = {0},
                .contact =
                    {
                        {.joint = 0, .reserved = 0, .compliance = TENODESIS_C(4.990019960079842e-07), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.0), .wound = TENODESIS_C(0.0)},
                        {.joint = 1, .reserved = 0, .compliance = TENODESIS_C(9.4810379241517e-06), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.001705123994088), .wound = TENODESIS_C(1.5707963267948966)},
                        {.joint = 3, .reserved = 0, .compliance = TENODESIS_C(9.980039920159684e-09), .coefficient = TENODESIS_C(0.0), .wrap = TENODESIS_C(0.0), .share = TENODESIS_C(1.0), .arm = TENODESIS_C(0.002091065856462), .wound = TENODESIS_C(0.0)},
                    },
            },
        },
    .within =
        {
            {TENODESIS_C(0.9999998069617565), TENODESIS_C(1.5740970067465452e-07), TENODESIS_C(1.5740970076596983e-07)},
            {TENODESIS_C(1.5740970043050688e-07), TENODESIS_C(0.9999995957198993), TENODESIS_C(-1.2835702079787058e-07)},
            {TENODESIS_C(1.5740970043050685e-07), TENODESIS_C(-1.283570207033871e-07), TENODESIS_C(0.999999595719899)},
        },
    .response =
        {
            {TENODESIS_C(0.9999998069617565), TENODESIS_C(1.5740970067465452e-07), TENODESIS_C(1.5740970076596983e-07)},
            {TENODESIS_C(1.5740970043050688e-07), TENODESIS_C(0.9999995957198993), TENODESIS_C(-1.2835702079787058e-07)},
            {TENODESIS_C(1.5740970043050685e-07), TENODESIS_C(-1.283570207033871e-07), TENODESIS_C(0.999999595719899)},
        },
    .settled =
        {
            {TENODESIS_C(199.99991004952878), TENODESIS_C(-199.99991004952878), TENODESIS_C(3.763862820910809e-05), TENODESIS_C(-3.763862820910809e-05), TENODESIS_C(3.763862822771182e-05), TENODESIS_C(-3.763862822771182e-05)},
            {TENODESIS_C(-163.08647108863548), TENODESIS_C(163.08647108863548), TENODESIS_C(239.1124106946729), TENODESIS_C(-239.1124106946729), TENODESIS_C(-3.069176908291347e-05), TENODESIS_C(3.069176908291347e-05)},
            {TENODESIS_C(-163.08647108863548), TENODESIS_C(163.08647108863548), TENODESIS_C(-3.069176906722188e-05), TENODESIS_C(3.069176906722188e-05), TENODESIS_C(239.11241069467283), TENODESIS_C(-239.11241069467283)},
        },
};

#endif

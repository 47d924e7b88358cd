/* The controller of scaled-up for tenodesis_init: yaw.
 *
 * Written by tenodesis 0.1.0 from scaled-up,
 * for version 6 of the C interface:
 * observer friction, law robust, actuation differential, its own clock.
 *
 * It starts as homed: only where both tendons have the pretension, and spool angles count from there.
 */
#ifndef TENODESIS_PARAMETERS_SCALED_UP_H
#define TENODESIS_PARAMETERS_SCALED_UP_H

#include "tenodesis/tenodesis.h"

#if TENODESIS_VERSION != 6u
#error "written for another version of the C interface: export the instrument again"
#endif

static const tenodesis_parameters scaled_up = {
    .size = sizeof(tenodesis_parameters),
    .version = TENODESIS_VERSION,
    .joint_type = TENODESIS_TENDON_GEAR,
    .axes = 1,
    .observer = TENODESIS_OBSERVER_FRICTION,
    .law = TENODESIS_LAW_ROBUST,
    .actuation = TENODESIS_ACTUATION_DIFFERENTIAL,
    .safe_state = TENODESIS_SAFE_NEUTRAL,
    .stop = TENODESIS_STOP_RETURN,
    .own_clock = 1,
    .homed = 1,
    .observe = TENODESIS_OBSERVE_STROKES,
    .period = TENODESIS_C(0.0005), /* s: nominal time between ticks */
    .speed_limit = TENODESIS_C(20.0), /* rad/s: largest speed of a spool */
    .acceleration_limit = TENODESIS_C(400.0), /* rad/s^2: largest acceleration of a spool */
    .engage_time = TENODESIS_C(0.2), /* s: time over which motion is faded in */
    .tension_limit = TENODESIS_C(100.0), /* N: above it a tendon is only unwound; 0: no limit */
    .hold_time = TENODESIS_C(0.5), /* s: time for which motors that stop stand before they return */
    .neutral_speed = TENODESIS_C(0.2617993877991494), /* rad/s: largest speed of a spool that returns */
    .relief = TENODESIS_C(0.21831953784896477), /* rad: unwinding past neutral allowed to a tendon above its limit */
    .axis =
        {
            /* yaw */
            {
                .proximal_radius = TENODESIS_C(0.016875), /* m: tendon radius at the handle's joint */
                .distal_radius = TENODESIS_C(0.0075), /* m: tendon radius at the tip's joint */
                .handle_length = TENODESIS_C(0.16), /* m: from the handle's joint to where the hand acts */
                .end_effector_length = TENODESIS_C(0.08600000000000001), /* m: from the tip's joint to where the force acts */
                .backbone_length = TENODESIS_C(0.0), /* m: length of a continuum joint's backbone */
                .backbone_rigidity = TENODESIS_C(0.0), /* N m^2: flexural rigidity of the backbone */
                .handle_range = TENODESIS_C(0.7853981633974483), /* rad: largest absolute handle angle */
                .output_stop = TENODESIS_C(1.861684535460618), /* rad: output angle at the tip's mechanical stop */
                .tip_frequency = TENODESIS_C(56.75053606602903), /* rad/s: natural angular frequency of the straight, unloaded tip */
                .stiffness = TENODESIS_C(11451.105222334798), /* N/m: axial stiffness of one tendon */
                .pretension = TENODESIS_C(25.0), /* N: tension of either tendon at rest */
                .share_sheath = TENODESIS_C(0.08), /* 1: share of a tendon's compliance from the spool to the sheath's friction */
                .share_handle = TENODESIS_C(0.11375), /* 1: share from there to the handle's joint */
                .share_stem = TENODESIS_C(0.7912499999999999), /* 1: share from there to the tip's joint */
                .share_tip = TENODESIS_C(0.015), /* 1: share beyond the tip's joint */
                .vertex_coefficient = TENODESIS_C(0.1), /* 1: friction coefficient at the joints */
                .base_wrap = TENODESIS_C(0.0), /* rad: wrap angle of a straight joint */
                .sheath_coefficient = TENODESIS_C(0.1), /* 1: friction coefficient in the sheath */
                .sheath_bend = TENODESIS_C(0.17453292519943295), /* rad: total bend of the sheath */
                .sheath_bend_rate = TENODESIS_C(0.0), /* rad/rad: bend added per unit of absolute handle angle */
                .passing_coefficient = TENODESIS_C(0.0), /* 1: friction coefficient at the joints of the axes before */
                .spool_radius = TENODESIS_C(0.005), /* m: radius of a spool */
                .drive_time_constant = TENODESIS_C(0.01), /* s: time constant of the speed loop */
                .hand_play = TENODESIS_C(0.0010737865515199488), /* rad: half the play that rejects the handle encoder's noise */
                .sheath_play = TENODESIS_C(3e-06), /* m: slip in the sheath that stands out from noise */
                .play = TENODESIS_C(1.035437031822808e-05), /* m: slip at the handle's joint that stands out from noise */
                .friction_scale_std = TENODESIS_C(0.4), /* 1: initial standard deviation of the friction scale */
                .reference_std = TENODESIS_C(5e-06), /* m: initial standard deviation of the tendons' reference length */
                .compliance_std = TENODESIS_C(0.25), /* 1: initial standard deviation of the compliance */
                .slack_tension = TENODESIS_C(0.25), /* N: tension below which a tendon counts as slack */
                .cell_gain_std = TENODESIS_C(0.01), /* 1: standard deviation of half the difference of the load cells' gains */
                .bias_std = TENODESIS_C(1.6176927175975965e-05), /* m: of the tip's position by what slip does not show: constant errors of sensors, play */
                .tremor_delay = TENODESIS_C(0.020475), /* s: by which the motors follow late */
                .tremor_gain = TENODESIS_C(1.05), /* 1: gain of the speed at which they take it away */
                .gain = TENODESIS_C(12.0), /* 1/s: gain of the tracking error */
                .position_gain = TENODESIS_C(4.0), /* 1/s: gain of a spool's set point */
                .dead_band = TENODESIS_C(0.0017453292519943296), /* rad: dead band of the output angle */
                .tendon_speed = TENODESIS_C(0.05), /* m/s: largest speed of a tendon */
                .common_stroke = TENODESIS_C(0.0008732781513958592), /* m: largest common stroke to either side */
                .least_tension = TENODESIS_C(3.75), /* N: tension that either tendon is to keep in the stem */
                .tension_limit = TENODESIS_C(80.0), /* N: tension above which no tendon is wound */
                .force_limit = TENODESIS_C(2.5), /* N: tip force that the motors do not go beyond; 0: none */
                .assistance = TENODESIS_C(1.0), /* 1: share of the lost angle that is given back */
                .homing_speed = TENODESIS_C(0.005), /* m/s: speed of a slack tendon */
                .homing_stroke = TENODESIS_C(0.03), /* m: largest stroke before a tendon must be tight */
                .homing_overshoot = TENODESIS_C(0.15), /* 1: overshoot before the last approach, share of the pretension */
                .homing_tolerance = TENODESIS_C(0.004), /* 1: tolerance of the pretension, share of it */
                .homing_jog = TENODESIS_C(0.00010471975511965977), /* m: stroke of one motor to and fro, by which the wiring is proven */
                .homing_travel = TENODESIS_C(0.00020943951023931953), /* m: stroke by which one tendon alone may pull the tip */
                .homing_offset = TENODESIS_C(1.4989461684154464), /* N: largest error of a cell, and difference of the tensions of a free tip */
                .homing_notice = TENODESIS_C(0.15), /* N: change of a tension that stands out from noise */
                .homing_efficiency = TENODESIS_C(1.0), /* 1: of drives whose currents measure tension; 1 with load cells */
                .homing_friction = TENODESIS_C(0.0), /* N: of such drives, beside what grows with the load */
                .homing_play = TENODESIS_C(0.0), /* m: stroke over which that friction turns */
                .mean_band = TENODESIS_C(0.3), /* 1: share by which friction may change the mean tension */
                .load_cell_range = TENODESIS_C(199.993896484375), /* N: largest reading of a load cell */
                .handle_noise = TENODESIS_C(0.009203884727313847), /* rad: largest difference of two readings of a handle at rest */
                .spool_noise = TENODESIS_C(0.003834951969714103), /* rad: the same of a spool */
                .spool_jump = {TENODESIS_C(60.0), TENODESIS_C(0.0006)}, /* rad/s, s */
                .limit =
                    {
                        {TENODESIS_C(2.0), TENODESIS_C(0.008)}, /* tendon_break: N, s */
                        {TENODESIS_C(0.5), TENODESIS_C(2.0)}, /* tendon_slack: N, s */
                        {TENODESIS_C(100.0), TENODESIS_C(0.003)}, /* over_tension: N, s */
                        {TENODESIS_C(0.009), TENODESIS_C(0.04)}, /* load_cell_stuck: N, s */
                        {TENODESIS_C(2.0), TENODESIS_C(0.005)}, /* load_cell_range: N, s */
                        {TENODESIS_C(1.25), TENODESIS_C(0.5)}, /* load_cell_drift: N, s */
                        {TENODESIS_C(0.1), TENODESIS_C(0.005)}, /* encoder_dropout: rad, s */
                        {TENODESIS_C(30.0), TENODESIS_C(0.0006)}, /* encoder_jump: rad/s, s */
                        {TENODESIS_C(2.5), TENODESIS_C(0.006)}, /* spool_slip: N, s */
                        {TENODESIS_C(0.008), TENODESIS_C(0.005)}, /* motor_not_following: rad, s */
                        {TENODESIS_C(0.025), TENODESIS_C(0.0)}, /* tick_late: s, s */
                        {TENODESIS_C(0.0), TENODESIS_C(0.0)}, /* not_a_number: 1, s */
                        {TENODESIS_C(0.0), TENODESIS_C(0.0)}, /* homing_failed: 1, s */
                        {TENODESIS_C(0.017453292519943295), TENODESIS_C(1.0)}, /* stroke_unexplained: rad, s */
                        {TENODESIS_C(0.06981317007977318), TENODESIS_C(0.5)}, /* rope_length: rad, s */
                    },
            },
        },
};

#endif

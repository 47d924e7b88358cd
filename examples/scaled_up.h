/* The controller of scaled-up for tenodesis_init: yaw.
 *
 * Written by tenodesis 0.1.0 from scaled-up,
 * for version 1 of the C interface:
 * observer friction, law robust, actuation differential, homed, its own clock.
 */
#ifndef TENODESIS_PARAMETERS_SCALED_UP_H
#define TENODESIS_PARAMETERS_SCALED_UP_H

#include "tenodesis/tenodesis.h"

#if TENODESIS_VERSION != 1u
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
    .safe_state = TENODESIS_SAFE_HOLD,
    .own_clock = 1,
    .homed = 1,
    .period = TENODESIS_C(0.0005), /* s */
    .speed_limit = TENODESIS_C(20.0), /* rad/s */
    .acceleration_limit = TENODESIS_C(400.0), /* rad/s^2 */
    .engage_time = TENODESIS_C(0.2), /* s */
    .tension_limit = TENODESIS_C(100.0), /* N */
    .hold_time = TENODESIS_C(0.5), /* s */
    .neutral_speed = TENODESIS_C(0.2), /* rad/s */
    .relief = TENODESIS_C(0.21831953784896477), /* rad */
    .axis =
        {
            /* yaw */
            {
                .proximal_radius = TENODESIS_C(0.016875), /* m */
                .distal_radius = TENODESIS_C(0.0075), /* m */
                .handle_length = TENODESIS_C(0.16), /* m */
                .end_effector_length = TENODESIS_C(0.08600000000000001), /* m */
                .backbone_length = TENODESIS_C(0.0), /* m */
                .backbone_rigidity = TENODESIS_C(0.0), /* N m^2 */
                .handle_range = TENODESIS_C(0.7853981633974483), /* rad */
                .stiffness = TENODESIS_C(11451.105222334798), /* N/m */
                .pretension = TENODESIS_C(25.0), /* N */
                .share_sheath = TENODESIS_C(0.08), /* 1 */
                .share_handle = TENODESIS_C(0.11375), /* 1 */
                .share_stem = TENODESIS_C(0.7912499999999999), /* 1 */
                .share_tip = TENODESIS_C(0.015), /* 1 */
                .vertex_coefficient = TENODESIS_C(0.1), /* 1 */
                .sheath_coefficient = TENODESIS_C(0.1), /* 1 */
                .sheath_bend = TENODESIS_C(0.17453292519943295), /* rad */
                .sheath_bend_rate = TENODESIS_C(0.0), /* rad/rad */
                .spool_radius = TENODESIS_C(0.005), /* m */
                .drive_speed = TENODESIS_C(20.0), /* rad/s */
                .drive_acceleration = TENODESIS_C(400.0), /* rad/s^2 */
                .drive_time_constant = TENODESIS_C(0.01), /* s */
                .hand_play = TENODESIS_C(0.0010737865515199488), /* rad */
                .sheath_play = TENODESIS_C(3e-06), /* m */
                .play = TENODESIS_C(1.035437031822808e-05), /* m */
                .length_noise = TENODESIS_C(1.5339807878856413e-05), /* m */
                .smoothing = TENODESIS_C(0.003), /* s */
                .friction_scale_std = TENODESIS_C(0.4), /* 1 */
                .reference_std = TENODESIS_C(5e-06), /* m */
                .compliance_std = TENODESIS_C(0.25), /* 1 */
                .forgetting = TENODESIS_C(0.05), /* 1/s^0.5 */
                .slack_tension = TENODESIS_C(0.25), /* N */
                .gain = TENODESIS_C(12.0), /* 1/s */
                .breakaway_time = TENODESIS_C(0.025), /* s */
                .position_gain = TENODESIS_C(4.0), /* 1/s */
                .dead_band = TENODESIS_C(0.0017453292519943296), /* rad */
                .tendon_speed = TENODESIS_C(0.05), /* m/s */
                .common_speed = TENODESIS_C(0.0034931126055834367), /* m/s */
                .common_stroke = TENODESIS_C(0.0008732781513958592), /* m */
                .common_stroke_share = TENODESIS_C(0.4), /* 1 */
                .far_lag = TENODESIS_C(15.0), /* 1 */
                .patience = TENODESIS_C(0.3), /* s */
                .settle_time = TENODESIS_C(0.03), /* s */
                .least_tension = TENODESIS_C(3.75), /* N */
                .tension_limit = TENODESIS_C(80.0), /* N */
                .hand_travel = TENODESIS_C(0.005368932757599744), /* rad */
                .still_time = TENODESIS_C(0.1), /* s */
                .homing_speed = TENODESIS_C(0.005), /* m/s */
                .homing_gain = TENODESIS_C(8.0), /* 1/s */
                .homing_stroke = TENODESIS_C(0.03), /* m */
                .homing_overshoot = TENODESIS_C(0.15), /* 1 */
                .homing_tolerance = TENODESIS_C(0.004), /* 1 */
                .homing_settle_time = TENODESIS_C(0.1), /* s */
                .homing_time = TENODESIS_C(16.0), /* s */
                .homing_least_stretch = TENODESIS_C(0.4), /* 1 */
                .mean_band = TENODESIS_C(0.3), /* 1 */
                .load_cell_range = TENODESIS_C(199.993896484375), /* N */
                .handle_noise = TENODESIS_C(0.009203884727313847), /* rad */
                .spool_noise = TENODESIS_C(0.003834951969714103), /* rad */
                .watch_window = TENODESIS_C(0.1), /* s */
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
                        {TENODESIS_C(3.0), TENODESIS_C(0.006)}, /* spool_slip: N, s */
                        {TENODESIS_C(0.008), TENODESIS_C(0.005)}, /* motor_not_following: rad, s */
                        {TENODESIS_C(0.025), TENODESIS_C(0.0)}, /* tick_late: s, s */
                        {TENODESIS_C(0.0), TENODESIS_C(0.0)}, /* not_a_number: 1, s */
                        {TENODESIS_C(0.0), TENODESIS_C(0.0)}, /* homing_failed: 1, s */
                    },
            },
        },
};

#endif

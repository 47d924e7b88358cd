/* The controller's parameters, once each: the structs of tenodesis.h, the checks of parameters.hpp, the names and units
 * in Python and the comments of exported headers all follow from these tables.
 *
 * A row gives the name, the unit, the bound that the value must keep (positive or not_negative) and the meaning. Rows
 * are in the order in which the values lie in memory: a change is a new TENODESIS_VERSION.
 */
#ifndef TENODESIS_PARAMETER_TABLE_H
#define TENODESIS_PARAMETER_TABLE_H

/* Integers at the head of tenodesis_parameters: name, meaning. */
#define TENODESIS_CHOICES(ROW)                                                       \
  ROW(size, "sizeof(tenodesis_parameters)")                                          \
  ROW(version, "TENODESIS_VERSION")                                                  \
  ROW(joint_type, "TENODESIS_TENDON_GEAR, ...")                                      \
  ROW(axes, "1 or 2")                                                                \
  ROW(observer, "TENODESIS_OBSERVER_...")                                            \
  ROW(law, "TENODESIS_LAW_...")                                                      \
  ROW(actuation, "TENODESIS_ACTUATION_...")                                          \
  ROW(safe_state, "TENODESIS_SAFE_...")                                              \
  ROW(stop, "TENODESIS_STOP_...")                                                    \
  ROW(own_clock, "1: ticks come once per period; 0: time is taken from the input")   \
  ROW(homed, "1: at the start, spool angles are zero where tendons have pretension") \
  ROW(observe, "TENODESIS_OBSERVE_...")

/* Parameters that all axes share: name, unit, bound, meaning. */
#define TENODESIS_COMMON_PARAMETERS(ROW)                                                        \
  ROW(period, "s", positive, "nominal time between ticks")                                      \
  ROW(speed_limit, "rad/s", positive, "largest speed of a spool")                               \
  ROW(acceleration_limit, "rad/s^2", positive, "largest acceleration of a spool")               \
  ROW(engage_time, "s", not_negative, "time over which motion is faded in")                     \
  ROW(tension_limit, "N", not_negative, "above it a tendon is only unwound; 0: no limit")       \
  ROW(hold_time, "s", not_negative, "time for which motors that stop stand before they return") \
  ROW(neutral_speed, "rad/s", not_negative, "largest speed of a spool that returns")            \
  ROW(relief, "rad", not_negative, "unwinding past neutral allowed to a tendon above its limit")

/* Parameters of one axis: name, unit, bound, meaning. */
#define TENODESIS_AXIS_PARAMETERS(ROW)                                                                        \
  /* joints; what a mechanism does not have is 0 */                                                           \
  ROW(proximal_radius, "m", positive, "tendon radius at the handle's joint")                                  \
  ROW(distal_radius, "m", positive, "tendon radius at the tip's joint")                                       \
  ROW(handle_length, "m", not_negative, "from the handle's joint to where the hand acts")                     \
  ROW(end_effector_length, "m", not_negative, "from the tip's joint to where the force acts")                 \
  ROW(backbone_length, "m", not_negative, "length of a continuum joint's backbone")                           \
  ROW(backbone_rigidity, "N m^2", not_negative, "flexural rigidity of the backbone")                          \
  ROW(handle_range, "rad", positive, "largest absolute handle angle")                                         \
  ROW(output_stop, "rad", positive, "output angle at the tip's mechanical stop")                              \
  ROW(tip_frequency, "rad/s", positive, "natural angular frequency of the straight, unloaded tip")            \
  /* tendons */                                                                                               \
  ROW(stiffness, "N/m", positive, "axial stiffness of one tendon")                                            \
  ROW(pretension, "N", positive, "tension of either tendon at rest")                                          \
  ROW(share_sheath, "1", positive, "share of a tendon's compliance from the spool to the sheath's friction")  \
  ROW(share_handle, "1", positive, "share from there to the handle's joint")                                  \
  ROW(share_stem, "1", positive, "share from there to the tip's joint")                                       \
  ROW(share_tip, "1", not_negative, "share beyond the tip's joint")                                           \
  ROW(vertex_coefficient, "1", not_negative, "friction coefficient at the joints")                            \
  ROW(base_wrap, "rad", not_negative, "wrap angle of a straight joint")                                       \
  ROW(sheath_coefficient, "1", not_negative, "friction coefficient in the sheath")                            \
  ROW(sheath_bend, "rad", not_negative, "total bend of the sheath")                                           \
  ROW(sheath_bend_rate, "rad/rad", not_negative, "bend added per unit of absolute handle angle")              \
  ROW(passing_coefficient, "1", not_negative, "friction coefficient at the joints of the axes before")        \
  /* drives */                                                                                                \
  ROW(spool_radius, "m", positive, "radius of a spool")                                                       \
  ROW(drive_time_constant, "s", not_negative, "time constant of the speed loop")                              \
  /* friction observer */                                                                                     \
  ROW(hand_play, "rad", not_negative, "half the play that rejects the handle encoder's noise")                \
  ROW(sheath_play, "m", positive, "slip in the sheath that stands out from noise")                            \
  ROW(play, "m", positive, "slip at the handle's joint that stands out from noise")                           \
  ROW(friction_scale_std, "1", positive, "initial standard deviation of the friction scale")                  \
  ROW(reference_std, "m", not_negative, "initial standard deviation of the tendons' reference length")        \
  ROW(compliance_std, "1", not_negative, "initial standard deviation of the compliance")                      \
  ROW(slack_tension, "N", not_negative, "tension below which a tendon counts as slack")                       \
  ROW(cell_gain_std, "1", not_negative, "standard deviation of half the difference of the load cells' gains") \
  ROW(bias_std, "m", not_negative,                                                                            \
      "of the tip's position by what slip does not show: constant errors of sensors, play")                   \
  /* the hand's tremor */                                                                                     \
  ROW(tremor_delay, "s", not_negative, "by which the motors follow late")                                     \
  ROW(tremor_gain, "1", not_negative, "gain of the speed at which they take it away")                         \
  /* compensator */                                                                                           \
  ROW(gain, "1/s", positive, "gain of the tracking error")                                                    \
  ROW(position_gain, "1/s", positive, "gain of a spool's set point")                                          \
  ROW(dead_band, "rad", not_negative, "dead band of the output angle")                                        \
  ROW(tendon_speed, "m/s", positive, "largest speed of a tendon")                                             \
  ROW(common_stroke, "m", positive, "largest common stroke to either side")                                   \
  ROW(least_tension, "N", not_negative, "tension that either tendon is to keep in the stem")                  \
  ROW(tension_limit, "N", positive, "tension above which no tendon is wound")                                 \
  ROW(force_limit, "N", not_negative, "tip force that the motors do not go beyond; 0: none")                  \
  ROW(assistance, "1", not_negative, "share of the lost angle that is given back")                            \
  /* homing */                                                                                                \
  ROW(homing_speed, "m/s", positive, "speed of a slack tendon")                                               \
  ROW(homing_stroke, "m", positive, "largest stroke before a tendon must be tight")                           \
  ROW(homing_overshoot, "1", not_negative, "overshoot before the last approach, share of the pretension")     \
  ROW(homing_tolerance, "1", positive, "tolerance of the pretension, share of it")                            \
  ROW(homing_jog, "m", positive, "stroke of one motor to and fro, by which the wiring is proven")             \
  ROW(homing_travel, "m", positive, "stroke by which one tendon alone may pull the tip")                      \
  ROW(homing_offset, "N", positive, "largest error of a cell, and difference of the tensions of a free tip")  \
  ROW(homing_notice, "N", positive, "change of a tension that stands out from noise")                         \
  ROW(homing_efficiency, "1", positive, "of drives whose currents measure tension; 1 with load cells")        \
  ROW(homing_friction, "N", not_negative, "of such drives, beside what grows with the load")                  \
  ROW(homing_play, "m", not_negative, "stroke over which that friction turns")                                \
  /* fault detection */                                                                                       \
  ROW(mean_band, "1", not_negative, "share by which friction may change the mean tension")                    \
  ROW(load_cell_range, "N", positive, "largest reading of a load cell")                                       \
  ROW(handle_noise, "rad", not_negative, "largest difference of two readings of a handle at rest")            \
  ROW(spool_noise, "rad", not_negative, "the same of a spool")

/* Faults in the order of their bits: name, NAME, unit of the threshold, meaning. */
#define TENODESIS_FAULT_TABLE(ROW)                                                                             \
  ROW(tendon_break, TENDON_BREAK, "N", "a tendon carries no tension although its spool should give it some")   \
  ROW(tendon_slack, TENDON_SLACK, "N", "a tendon is slack for long")                                           \
  ROW(over_tension, OVER_TENSION, "N", "a tension is above its limit")                                         \
  ROW(load_cell_stuck, LOAD_CELL_STUCK, "N", "a reading does not even flicker")                                \
  ROW(load_cell_range, LOAD_CELL_RANGE, "N", "a reading that no tendon can cause")                             \
  ROW(load_cell_drift, LOAD_CELL_DRIFT, "N", "the mean tension of the pair is not what the spools have wound") \
  ROW(encoder_dropout, ENCODER_DROPOUT, "rad", "the handle is read outside its range")                         \
  ROW(encoder_jump, ENCODER_JUMP, "rad/s", "a handle or spool angle changed faster than it can")               \
  ROW(spool_slip, SPOOL_SLIP, "N", "the mean tension fell at once, and no tendon broke")                       \
  ROW(motor_not_following, MOTOR_NOT_FOLLOWING, "rad", "a spool does not turn as commanded")                   \
  ROW(tick_late, TICK_LATE, "s", "a tick came too late, or time stood still")                                  \
  ROW(not_a_number, NOT_A_NUMBER, "1", "NaN, infinity, or beyond the range of any sensor")                     \
  ROW(homing_failed, HOMING_FAILED, "1", "homing found something wrong: the reason says what")                 \
  ROW(stroke_unexplained, STROKE_UNEXPLAINED, "rad", "the motors moved the tip further than a load explains")  \
  ROW(rope_length, ROPE_LENGTH, "rad", "the ropes got longer or shorter, and may have moved the tip")

/* Why homing failed, in the order of their numbers: name, NAME, meaning. */
#define TENODESIS_HOMING_REASON_TABLE(ROW)                                                                           \
  ROW(none, NONE, "it has not failed")                                                                               \
  ROW(tip_loaded, TIP_LOADED, "a load is on the tip")                                                                \
  ROW(cell_offset, CELL_OFFSET, "a reading is of a tension that its tendon does not have")                           \
  ROW(cell_reversed, CELL_REVERSED, "a tension's reading falls as its tendon is wound")                              \
  ROW(cells_swapped, CELLS_SWAPPED,                                                                                  \
      "the readings of the tensions, or the motors together with their encoders, are exchanged")                     \
  ROW(cell_gains_apart, CELL_GAINS_APART, "the gains of the two readings differ, this one's being the smaller")      \
  ROW(motor_dead, MOTOR_DEAD, "an encoder does not answer its motor")                                                \
  ROW(motor_reversed, MOTOR_REVERSED, "a motor turns against its encoder; with slack tendons it may be the encoder") \
  ROW(motors_swapped, MOTORS_SWAPPED, "the motors are exchanged; with slack tendons it may be the encoders")         \
  ROW(encoder_reversed, ENCODER_REVERSED, "an encoder counts against its motor")                                     \
  ROW(encoders_swapped, ENCODERS_SWAPPED, "the spool encoders are exchanged")                                        \
  ROW(encoder_gain, ENCODER_GAIN, "a spool's encoder counts more or less than its motor turns")                      \
  ROW(spool_reversed, SPOOL_REVERSED, "a motor and its encoder wind where they should let out")                      \
  ROW(tendon_broken, TENDON_BROKEN, "a tendon does not get tight, or carries no tension any more")                   \
  ROW(tendons_slack, TENDONS_SLACK, "neither tendon gets tight: too much slack, or both spools reversed")            \
  ROW(tendon_jammed, TENDON_JAMMED, "a tendon gets tight over too short a stroke")                                   \
  ROW(stiffness_wrong, STIFFNESS_WRONG, "tension grows far too little by the stroke, or does not fall")              \
  ROW(handle_moved, HANDLE_MOVED, "the handle was moved")                                                            \
  ROW(timed_out, TIMED_OUT, "it took too long")                                                                      \
  ROW(too_coarse, TOO_COARSE, "currents show tensions so coarsely that homing would move the tip")

/* The limits of spool jumps have no fault of their own: they raise encoder_jump. */
#define TENODESIS_SPOOL_JUMP_UNIT "rad/s"

#endif

/* Parameters of the controller of all joints, once each, as those of one axis in parameter_table.h: the structs of
 * joints.h, the checks of joint_controller.hpp, the names in Python and the comments of exported headers follow from
 * these tables. Rows are in the order in which the values lie in memory: a change is a new TENODESIS_JOINTS_VERSION.
 */
#ifndef TENODESIS_JOINT_TABLE_H
#define TENODESIS_JOINT_TABLE_H

/* Of the interface in joints.h: raised whenever a struct or a meaning changes. NOLINTNEXTLINE(*-macro-to-enum) */
#define TENODESIS_JOINTS_VERSION 3u

/* Integers at the head of the parameters: name, meaning. */
#define TENODESIS_JOINTS_CHOICES(ROW)                                                \
  ROW(size, "sizeof(tenodesis_joints_parameters)")                                   \
  ROW(version, "TENODESIS_JOINTS_VERSION")                                           \
  ROW(handles, "joints of the handle, at most TENODESIS_JOINTS")                     \
  ROW(friction_law, "0: capstan with a constant, 1: Stribeck, 2: power of the load") \
  ROW(compensates, "1: motors give back what joints lose; 0: they follow alone")     \
  ROW(shows_load, "1: the output has the load at the tip")                           \
  ROW(own_clock, "1: ticks come once per period; 0: time is taken from the input")   \
  ROW(reserved, "0")

/* A joint of the tip. */
#define TENODESIS_JOINT_CHOICES(ROW)                                  \
  ROW(mechanism, "TENODESIS_TENDON_GEAR, ...")                        \
  ROW(within, "1: it bends within the joint before it")               \
  ROW(parent, "joint that it stands on, counted from 1; 0: the stem") \
  ROW(tied_to, "joint before it that a spring ties it to, from 1; 0: no tie")
#define TENODESIS_JOINT_PARAMETERS(ROW)                                                      \
  ROW(axis_x, "1", finite, "of its axis, a unit vector in the axes of the link before it")   \
  ROW(axis_y, "1", finite, "likewise")                                                       \
  ROW(axis_z, "1", finite, "likewise; z runs toward the tip")                                \
  ROW(offset, "m", finite, "from the far end of the joint that it stands on")                \
  ROW(chord, "m", not_negative, "of the straight joint; 1 of one within another")            \
  ROW(length, "m", finite, "from its far end to where the load acts")                        \
  ROW(stiffness, "N m/rad", not_negative, "of its own spring")                               \
  ROW(hardening, "N m/rad^3", not_negative, "moment of the spring by the cube of the angle") \
  ROW(tie_ratio, "1", finite, "its angle over that of the joint tied to, at rest")           \
  ROW(tie_stiffness, "N m/rad", not_negative, "of the tie")                                  \
  ROW(share, "1", not_negative, "of the load that acts at its end")                          \
  ROW(grip, "m", finite, "moment about its axis by a unit of the force that presses jaws apart")

/* A tendon, beside what it draws and its contacts. */
#define TENODESIS_TENDON_CHOICES(ROW)                                           \
  ROW(contacts, "number of its contacts")                                       \
  ROW(motor, "1: a spool winds it")                                             \
  ROW(curve_entries, "of its table of stiffness by tension; 0: it is constant") \
  ROW(reserved, "0")
#define TENODESIS_TENDON_PARAMETERS(ROW)         \
  ROW(stiffness, "N/m", not_negative, "at rest") \
  ROW(pretension, "N", not_negative, "at rest")  \
  ROW(end_compliance, "m/N", not_negative, "at rest, of what is beyond its last contact")

/* A contact of a tendon, from the spool outward. */
#define TENODESIS_CONTACT_CHOICES(ROW)                                                        \
  ROW(joint, "0: the sheath; joint of the tip from 1, of the handle behind those of the tip") \
  ROW(reserved, "0")
#define TENODESIS_CONTACT_PARAMETERS(ROW)                                                           \
  ROW(compliance, "m/N", not_negative, "at rest, of the segment before it")                         \
  ROW(coefficient, "1", not_negative, "of friction")                                                \
  ROW(wrap, "rad", not_negative, "in the sheath, or at a joint whatever its angle")                 \
  ROW(share, "1", not_negative, "of the joint's angle, and of constant friction")                   \
  ROW(arm, "m", finite, "by which a unit of the joint's coordinate lengthens the segment it draws") \
  ROW(wound, "rad", finite, "bend over the straight joint that its angle unwinds, positive in its sense")

/* Numbers of the whole controller: name, unit, bound, meaning. */
#define TENODESIS_JOINTS_PARAMETERS(ROW)                                                             \
  /* friction */                                                                                     \
  ROW(constant, "N", not_negative, "friction that does not depend on the load")                      \
  ROW(static_ratio, "1", not_negative, "static over kinetic friction")                               \
  ROW(stribeck_speed, "m/s", not_negative, "over which static friction falls to kinetic")            \
  ROW(memory, "s", not_negative, "with which friction follows the speed")                            \
  ROW(load_index, "1", not_negative, "power of the tension in friction")                             \
  ROW(reference_tension, "N", positive, "at which that power counts nothing")                        \
  ROW(bending_loss, "N", not_negative, "of a tendon that is stiff in bending")                       \
  ROW(sheath_bend_rate, "rad/rad", not_negative, "bend of the sheath by the handle's angles")        \
  /* observer */                                                                                     \
  ROW(spool_radius, "m", positive, "radius of a spool")                                              \
  ROW(spool_step, "rad", not_negative, "step of a spool's encoder")                                  \
  ROW(play, "m", positive, "slip that stands out from noise")                                        \
  ROW(handle_play, "m", not_negative, "by which it is larger from the handle's joints on")           \
  ROW(tension_play, "N", not_negative, "tension by whose stretch that slip is larger farther on")    \
  ROW(smoothing, "1", positive, "share of the handle's reading in that which contacts follow")       \
  ROW(tension_deviation, "N", positive, "standard deviation of a tension")                           \
  ROW(length_deviation, "m", positive, "standard deviation of a tendon's length")                    \
  ROW(friction_deviation, "1", positive, "standard deviation of the friction scale")                 \
  ROW(stiffness_deviation, "1", positive, "standard deviation of the stiffness scale")               \
  ROW(force_deviation, "N", positive, "size of a component of the force at the tip")                 \
  ROW(moment_deviation, "N m", positive, "size of a component of the moment at the tip")             \
  ROW(grip_deviation, "N", positive, "size of the force that presses jaws apart")                    \
  ROW(imbalance, "N m", positive, "moment of a joint that no load explains")                         \
  /* law */                                                                                          \
  ROW(rate, "1/s", positive, "at which a loss is given back")                                        \
  ROW(gain, "1/s", positive, "of the spools' positions")                                             \
  ROW(speed, "m/s", positive, "largest speed of a tendon")                                           \
  ROW(tension_limit, "N", positive, "above it the motors give nothing more")                         \
  ROW(least_tension, "1", not_negative, "share of the pretension below which a tendon is tightened") \
  ROW(deviations, "1", not_negative, "of the estimate that a stroke leaves room for")                \
  ROW(homing_time, "s", positive, "of strokes that wind all tendons alike")                          \
  ROW(homing_rise, "1", not_negative, "of the tensions in it, share of the pretension")              \
  ROW(period, "s", positive, "nominal time between ticks")                                           \
  /* supervisor */                                                                                   \
  ROW(speed_limit, "rad/s", positive, "largest speed of a spool")                                    \
  ROW(acceleration_limit, "rad/s^2", positive, "largest acceleration of a spool")                    \
  ROW(drive_time_constant, "s", not_negative, "of the drives' speed loop")                           \
  ROW(engage_time, "s", not_negative, "over which motion is faded in")                               \
  ROW(tension_of_fault, "N", not_negative, "above it a tendon is only unwound; 0: no limit")         \
  ROW(unlike_friction, "N", not_negative, "tension that is not missed before homing")                \
  ROW(stroke_limit, "m", positive, "largest stroke of a tendon beyond its target")                   \
  ROW(pretension, "N", not_negative, "largest of all tendons")                                       \
  ROW(stiffness, "N/m", positive, "least of all tendons")                                            \
  ROW(load_cell_range, "N", positive, "largest reading of a load cell")                              \
  ROW(handle_range, "rad", positive, "largest absolute handle angle")                                \
  ROW(handle_noise, "rad", not_negative, "largest difference of two readings of a handle at rest")   \
  ROW(spool_noise, "rad", not_negative, "the same of a spool")

#endif

#pragma once
// Every constant of observer, law, envelope, homing, supervisor and watch that does not follow from the instrument.
//
// What depends on the instrument is a parameter (parameter_table.h). Numbers that follow from a formula, as the half of
// a sum, stand where they are used. A build with TENODESIS_TUNABLE may change the constants while it runs, for
// studies/tuning.py, which varies each by half.

#include "tenodesis/scalar.hpp"

/// Constants: name, value, unit, source, meaning. A source is where the value comes from: literature, a bound of what
/// is plausible, the study whose figures it was chosen by, or chosen, where no study has shown yet that it matters.
#define TENODESIS_TUNING(ROW)                                                                                          \
  /* slip and friction at the contacts */                                                                              \
  ROW(most_friction, 4, "1", "bound: a sheath bent twice as far, twice as rough; studies/faults.py",                   \
      "friction over that of the parameters, at most")                                                                 \
  ROW(least_friction, 0.05, "1", "studies/plants.py", "the same, at least")                                            \
  ROW(firm_run, 4, "1", "studies/plants.py", "plays after which a contact surely slips")                               \
  ROW(reversing_share, 0.75, "1", "studies/plants.py",                                                                 \
      "of the change of tension that makes all contacts slip after a reversal")                                        \
  ROW(surely_reversed, 1.9, "1", "studies/plants.py",                                                                  \
      "the same by which they slip even if friction is a third stronger")                                              \
  ROW(tip_plays, 3, "1", "studies/plants.py", "plays by which friction at the tip's joint turns")                      \
  ROW(smoothing, 6, "1", "studies/plants.py", "time constant of the measurement filter, in ticks")                     \
  /* what the friction observer learns */                                                                              \
  ROW(forgetting, 0.05, "1/s^0.5", "studies/plants.py",                                                                \
      "growth of its deviations, share of their start per root second")                                                \
  ROW(outlier, 3, "1", "99.7 % of a normal distribution", "deviations beyond which a measurement is not explained")    \
  ROW(apart_after, 2, "s", "studies/harm.py",                                                                          \
      "without both tendons slipping the same way, after which stiffness is learned while they slip apart")            \
  ROW(calm_lag, 2, "1", "studies/plants.py",                                                                           \
      "lag of the filtered tension, in slack tensions, above which nothing is learned; a tendon is loose below twice " \
      "it")                                                                                                            \
  ROW(homed_share, 0.12, "1", "chosen", "of the deviations of compliance and gains, that homing leaves")               \
  ROW(most_compliance, 2, "1", "studies/plants.py", "largest compliance over that of the parameters, or its inverse")  \
  ROW(share_plays, 2, "1", "studies/plants.py", "plays of slip for which errors of where the compliance is are alike") \
  ROW(sticking_plays, 10, "1", "studies/plants.py", "the same of errors of contacts that still stick")                 \
  ROW(share_std, 0.25, "1", "studies/plants.py",                                                                       \
      "deviation of the compliance share before the handle's joint, at the start")                                     \
  ROW(share_error, 0.05, "1", "studies/plants.py", "relative deviation of one measurement of it")                      \
  ROW(share_tension, 2.5, "1", "studies/plants.py", "change of tension, in slack tensions, from which it is measured") \
  ROW(most_share_of_stem, 0.6, "1", "studies/plants.py", "of the stem's share that may lie before the handle's joint") \
  ROW(from_sheath, 3, "1", "studies/plants.py",                                                                        \
      "friction of the sheath over the parameters' at which it surely slips")                                          \
  ROW(to_handle, 1.2, "1", "studies/plants.py", "the same of the handle's joint up to which it surely sticks")         \
  /* tremor */                                                                                                         \
  ROW(tremor_half_period, 0.1, "s", "Elble, Koller, Tremor, 1990: 6 to 12 Hz",                                         \
      "longest time between two reversals of tremor")                                                                  \
  ROW(tremor_quickest, 0.4, "1", "the same: up to 12 Hz", "shortest over longest")                                     \
  ROW(tremor_limit, 0.020943951023931952, "rad", "studies/tremor.py",                                                  \
      "largest amplitude of tremor, at the handle (1.2 deg)")                                                          \
  ROW(tremor_memory, 1, "s", "studies/tremor.py", "time constant with which that amplitude is forgotten")              \
  ROW(tremor_smoothing, 0.004, "s", "studies/tremor.py", "time constant of tremor's speed")                            \
  ROW(tremor_spare, 1.2, "1", "studies/tremor.py", "largest over usual swing of a hand, or of a tip that it draws")    \
  ROW(tremor_pulsation, 0.2, "1", "studies/tremor.py", "share by which a swing changes the pulsation")                 \
  /* law */                                                                                                            \
  ROW(breakaway_time, 0.025, "s", "studies/changes.py", "in which friction is overcome after the hand reverses")       \
  ROW(transient_time, 0.3, "s", "studies/tremor.py",                                                                   \
      "after which an error is no remainder of the last stroke, and a tip that yields presses on something")           \
  ROW(settle_time, 0.03, "s", "studies/harm.py", "within the dead band before the motors rest")                        \
  ROW(rising_friction, 1.1, "1", "studies/plants.py",                                                                  \
      "friction scale over that of a stroke ago, above which a tip is not yet where it is estimated")                  \
  ROW(breakaway_angle, 0.010471975511965976, "rad", "studies/tremor.py",                                               \
      "speed of a tip that breaks away, over its angular frequency (0.6 deg)")                                         \
  ROW(stroke_time, 0.25, "s", "chosen", "in which a common stroke goes from its middle to either end")                 \
  ROW(hand_travel, 5, "1", "chosen", "travel of the handle, in plays, above which the hand counts as moving")          \
  ROW(still_time, 0.1, "s", "studies/homing.py", "for which a hand, or a mean tension while homing, must be still")    \
  ROW(waking, 2, "1", "chosen", "error that moves motors at rest, in dead bands")                                      \
  ROW(correction_time, 1, "s", "studies/changes.py",                                                                   \
      "longest of a correction between two strokes; after a longer rest a disturbance is a new load")                  \
  ROW(correction_over_breakaway, 1.3, "1", "chosen", "stroke of a correction over that which frees the tip")           \
  ROW(approach_rate, 30, "1/s", "chosen", "at which a stroke may approach its bounds")                                 \
  ROW(few_turns, 2, "1", "studies/tremor.py",                                                                          \
      "reversals of strokes after which the dead band grows, where a wider one had ended them")                        \
  ROW(most_turns, 4, "1", "studies/harm.py", "the same where it had not")                                              \
  ROW(tolerance_growth, 1.5, "1", "chosen", "of the dead band by a stroke")                                            \
  ROW(most_tolerance, 3, "1", "studies/tremor.py", "dead bands up to which it grows")                                  \
  ROW(differential_share, 0.8, "1", "chosen", "of a common stroke's speed: no tendon is to reverse")                   \
  ROW(slow_stroke, 0.25, "1", "studies/tremor.py", "of the speed of a stroke on target")                               \
  ROW(near_limit, 0.94, "1", "bound: beside the noise of a cell",                                                      \
      "of the tension limit, above which no stroke tightens, and below which a tendon may be wound again")             \
  ROW(tremor_in_band, 0.15, "1", "studies/tremor.py", "of the tremor, that widens the dead band")                      \
  ROW(dither_margin, 4, "1", "studies/plants.py", "amplitude of dither over that which turns sheath and handle")       \
  ROW(dither_fastest, 251.32741228718345, "rad/s", "drives of 10 ms leave a third of it",                              \
      "largest angular frequency of dither (40 Hz)")                                                                   \
  ROW(dither_time, 0.5, "s", "studies/plants.py", "longest time of dither after a change")                             \
  /* envelope */                                                                                                       \
  ROW(envelope_friction, 1.5, "1", "studies/harm.py", "largest plausible friction over the observer's")                \
  ROW(envelope_compliance, 1.3, "1", "bound", "largest plausible compliance over the observer's")                      \
  ROW(envelope_smoothing, 0.1, "s", "studies/harm.py", "time constant of a stroke's bounds")                           \
  ROW(least_swing, 3, "1", "studies/harm.py", "tracking error by which its reversal stands out, in dead bands")        \
  ROW(swing_half_periods, 1.3, "1", "studies/harm.py",                                                                 \
      "of the tip, which itself oscillates faster: least time between two reversals of the tracking error")            \
  ROW(swing_memory, 2, "s", "studies/harm.py", "time constant of recent reversals")                                    \
  ROW(mean_memory, 3, "s", "studies/harm.py", "time constant of the mean loss")                                        \
  ROW(useless_share, 0.4, "1", "studies/harm.py",                                                                      \
      "of the mean square that an error had without strokes, from which its reversal counts whole")                    \
  ROW(few_reversals, 2, "1", "studies/harm.py", "recent reversals from which the law's gain falls")                    \
  ROW(many_reversals, 4, "1", "studies/harm.py", "from which it is zero")                                              \
  ROW(return_rate, 5, "1/s", "studies/harm.py", "at which a stroke or a mean error that is not wanted is taken back")  \
  /* loads that alternate */                                                                                           \
  ROW(notable_angle, 0.017453292519943295, "rad", "studies/harm.py: what it counts as harm",                           \
      "of the tip: a jump of the load, or by how much a stroke may exceed what one explains; of the handle between "   \
      "reversals that the hand made (1 deg)")                                                                          \
  ROW(alternation_fastest, 0.3, "s", "studies/changes.py", "time between jumps that motors can follow")                \
  ROW(alternation_left, 0.25, "1", "studies/changes.py",                                                               \
      "of a jump, that is left to friction; the rest of the stroke that it holds is given back")                       \
  ROW(alternation_longest, 60, "s", "studies/changes.py",                                                              \
      "after which jumps are forgotten, and strokes look for a hidden load")                                           \
  ROW(alternation_smoothing, 0.6, "s", "studies/changes.py", "of mean error and mean stroke")                          \
  /* supervisor */                                                                                                     \
  ROW(hanging, 0.05, "1", "bound", "of the pretension, below which a tendon hangs")                                    \
  ROW(below_home, 1.36, "1", "studies/changes.py, studies/harm.py",                                                    \
      "stroke below home of a return, over that which makes the tendons half as tight")                                \
  /* watch */                                                                                                          \
  ROW(watch_window, 0.1, "s", "studies/faults.py",                                                                     \
      "in which slip and a motor's lag are judged; in a fault a motor must obey in half of it")                        \
  ROW(watch_moment, 1e-3, "s", "studies/faults.py",                                                                    \
      "in which inertia keeps hand and tip from lowering the mean tension as a slip does")                             \
  ROW(long_run, 40, "1", "studies/faults.py", "windows after which motor and encoder agree in the long run")           \
  ROW(drive_gain_error, 0.01, "1", "studies/faults.py", "share of a motor's path by which they need not")              \
  /* homing */                                                                                                         \
  ROW(homing_gain, 8, "1/s", "studies/homing.py", "of a tight tendon's missing stretch")                               \
  ROW(homing_time, 10, "s", "studies/homing.py", "longest time of a stage, beside that of its largest stroke")         \
  ROW(homing_proof, 0.25, "1", "studies/homing.py",                                                                    \
      "of the pretension, or of the least tension that is noticed, that proves the wiring")                            \
  ROW(homing_judged, 0.8, "1", "studies/homing.py", "of the pretension, at which the stretch is judged")               \
  ROW(homing_sudden, 0.07, "1", "studies/homing.py", "of the pretension: fall at once by which a tendon has broken")   \
  ROW(homing_least_slope, 0.45, "1", "bound", "of tension by stroke, over the nominal one, or its inverse")            \
  ROW(most_gain_difference, 0.12, "1", "bound", "of the load cells")

namespace tenodesis::tuning {

#ifdef TENODESIS_TUNABLE
#define TENODESIS_CONSTANT(name, value, unit, source, meaning) inline double name = value;
#else
#define TENODESIS_CONSTANT(name, value, unit, source, meaning) inline constexpr double name = value;
#endif
TENODESIS_TUNING(TENODESIS_CONSTANT)
#undef TENODESIS_CONSTANT

}  // namespace tenodesis::tuning

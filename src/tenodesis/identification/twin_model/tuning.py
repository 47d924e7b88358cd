"""Constants of the twin's model that were chosen by trial, with their units and trade-offs."""

# Smoothing of an encoder's noise (`steps.smoothed`). The blur is the wavelength that the smoother halves.
BLUR_SHORTEST = 4.0
"""Samples: with less there is nothing to smooth."""
BLUR_LONGEST = 0.2
"""s: features of the hand's motion that are slower cannot be distinguished from drift."""
BLURS = 14
"""How many between these are tried."""
KINK_DEVIATIONS = 5.0
"""Standard errors by which a path must miss the signal before a kink is put there: fewer would find kinks in noise."""
KINK_BLUR = 2.0
"""Ratio of the blur of a path that misses kinks to the best blur, which already follows them."""
KINK_WINDOWS = (5, 11, 21, 41, 81)
"""Samples over which a miss is averaged: sharp kinks show over short times, slight kinks over long times."""
KINK_WIDTH = 5
"""Samples to either side of a found kink that may be the kink instead."""
KINK_ROUNDS = 20
"""Most searches for further kinks."""
NODE_DISTANCE = 0.35
"""Distance, as a share of the blur, of the points that describe a path's error; closer points would be nearly equal."""
MOST_NODES = 300
"""Of these places: time grows with their square."""
NODE_REACH = 2.0
"""Blurs beyond which the error of a place has died away."""
SAME_ERROR = 1e-6
"""Share of the largest variance below which combinations of errors are numerically the same."""

# Undoing a converter's rounding (`steps.unrounded`).
REST_LENGTH = 4
"""Times that a converter's step must outlast its neighbours for the signal to rest there."""
STOPPING_TIME = 0.05
"""s, in which a spool's drive comes to rest at most."""
STOPPING_ERRORS = ((0.0, 1.0, 2.0, 0.3), (1.0, 2.0, 6.0, 0.15))
"""Begin, peak and end in stopping times, and size in converter's steps, of errors in how a spool comes to rest."""
CHORD_ERROR = 1 / 8
"""A parabola's distance from its chord, over acceleration and squared time (exact)."""
NEGLIGIBLE_STEP = 0.02
"""Converter's steps below which an error of a turning spool is left out."""

# Marginalising input errors (`marginalise`).
MOST_RUNS = 20
"""Runs of the model, each of which carries many errors far apart: more runs, less overlap."""
LEAST_MEMORY = 0.2
"""s after its end for which an error acts on readings at least: friction forgets it at the handle's next reversal."""
MEMORY_SHRINKAGE = 0.8
"""Factor by which that time is shortened, from the entire run, until there are few enough runs."""
NEGLIGIBLE_EFFECT = 1e-12
"""Variance of an effect, over that of a reading, below which its shrinkage is replaced by its limit."""
# How a recording begins (`steps`).
LEAD_TIME = 0.5
"""s, for the way from rest to the start of a run that does not begin at rest."""
REST_SHARE = 5e-3
"""Of the handle's range, and of the pretension and its stretch, within which an instrument is at rest."""
BEGINNING = 0.05
"""s, whose median shows where a run begins: noise averages out, little moves."""
TAUT_SHARE = 0.2
"""Of the pretension, above which a tendon is taut."""
REFERENCE_SHARE = 0.5
"""Of the pretension, by which a tension may differ from what the spool's angle predicts if the spool counts from it."""
TURN_SHARE = 0.1
"""Of the handle's range of motion, beyond which it has reversed."""
HELD_SHARE = 0.7
"""Of rows with a new reading, below which sensors are slower than the recording and their repeats are left out."""

# Time steps and linearisation (`problem`).
LONGEST_STEP = 2e-3
"""s, of a step over which samples are averaged: time against the error of stepping."""
LONGEST_SHARE = 0.5
"""Of the longest step that the tip allows, above which samples are apart too far for one step of the model: near that
step it chatters, and its derivatives grow without bound."""
STEP_BIAS = 1.0
"""Standard deviations by which a longer step may move the parameters altogether."""
COARSE_STEP = 0.5
"""RMS error, in deviations of a step's mean reading, above which a step is too long without asking for its bias."""
UNSEEN_DIRECTION = 1e-8
"""Share of the largest singular value below which a direction of the parameters is not seen."""
SWIFTER = 1.1
"""Ratio of the tip's frequency to that of before above which steps are chosen anew."""
LOST_RESIDUAL = 1e3
"""Standard deviations assigned to a sample where the model's tip is lost: finite, but large."""
CELL = 5e-3
"""Of its range, by which a parameter may change before effects of input errors are computed anew."""
CELLS_KEPT = 4
"""Number of such computations kept, since a search alternates between neighbours."""
FAR = 9.0
"""Mean square of residuals, in variances, above which parameters are too far off for input errors to matter."""

# Bounds of parameters (`problem`).
MOST_HANDLE_SHARE = 0.9
"""Of the compliance that the joints leave over, between spool and handle joint."""
MOST_DAMPING = 2.0
"""Times the critical damping of the tip: beyond it nothing swings, and more changes nothing."""
INERTIA_RATIO = 50.0
"""Of the tip's inertia over the file's, up or down: where none is given the file's is a guess, of a tip of 20 Hz."""

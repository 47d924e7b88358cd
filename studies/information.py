"""What the sensors can show at most: the least error of the tip that any estimator could have, as a standard deviation.

The Cramér-Rao bound with a prior (van Trees, 1968). The law runs on the twin, and its spool velocities are played back
on twins that differ a little in one unknown each. What this changes of the tensions over the whole run is the
information; the unknowns are what a row does not know, with the spread of the prior, and the load, which nobody knows.
With the sensors' noise alone the load is known to be a step, and the equations to be the twin's: a real estimator has
to do without both, so that it can only be worse. Equations that err by a little, for a while at a time, are the second
noise. Errors are those of the tip off its target, as `plants.py` has them.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import law
import numpy as np

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.instrument import Instrument
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column
from tenodesis.twin import TIME_STEP, Twin

Array = law.Array

EASED, LOADED, SECONDS, EARLY = 1.2, 1.5, 8.0, 0.3  # s
FORCE = law.RATED["scaled-up"]  # N
# Standard deviations of what is unknown.
COEFFICIENTS = {"friction.vertex_coefficient": 0.3, "friction.sheath_coefficient": 0.3}
"""Relative"""
ARRANGEMENT = {"friction.handle_compliance_share": 0.2, "friction.base_wrap": 0.3}
"""Of the keys' own units"""
STIFFNESS = {"tendon_stiffness": 0.15}
"""Relative"""
GAINS = {"gain.agonist": 0.02, "gain.antagonist": 0.02}
"""Relative"""
OFFSETS = {"offset.agonist": 0.5, "offset.antagonist": 0.5}
"""N"""
ENCODER = {"handle_offset": np.radians(0.2)}
"""rad"""
EVERYTHING = COEFFICIENTS | ARRANGEMENT | STIFFNESS | GAINS | OFFSETS | ENCODER
STEP = 0.02
"""Of a difference, in standard deviations"""
MODEL_ERROR, MODEL_TIME = 0.2, 0.5
"""Error of the equations, N, and for how long it lasts, s"""


class ModelMismatch(NamedTuple):
    """What differs from the file, and what an estimator does not know."""

    words: str
    changes: Mapping[str, Any]
    unknown: Mapping[str, float]


STRONG = {"friction.vertex_coefficient": 0.25, "friction.sheath_coefficient": 0.25}
TWO = {"friction.vertices_per_joint": 2}
FRONT = {"friction.handle_compliance_share": 0.55}
BASE = {"friction.base_wrap": 0.3}
ROWS = (
    ModelMismatch("friction alone", {}, COEFFICIENTS),
    ModelMismatch("load cell gains", {}, COEFFICIENTS | GAINS),
    ModelMismatch("load cell offsets", {}, COEFFICIENTS | OFFSETS),
    ModelMismatch("handle encoder's zero", {}, COEFFICIENTS | ENCODER),
    ModelMismatch("gains, two vertices", TWO, COEFFICIENTS | GAINS),
    ModelMismatch("gains, coefficient 0.25", STRONG, COEFFICIENTS | GAINS),
    ModelMismatch("where the compliance is, stiffness", FRONT, COEFFICIENTS | ARRANGEMENT | STIFFNESS),
    ModelMismatch("all at once", STRONG | TWO | FRONT | BASE, EVERYTHING),
)


class Playback(NamedTuple):
    """A run of the law, and what is played back of it."""

    handle: Array
    """rad, shape (n,)"""
    velocity: Array
    """rad/s, shape (n, 2)"""


def motion(inst: Instrument, state: float) -> Array:
    return float(tn.statics.handle_angle(inst, np.radians(state))) * law.eased(law.clock(SECONDS), EASED)


def load(size: float, count: int) -> Array:
    return np.where(np.arange(1, count + 1) * TIME_STEP > LOADED, size, 0.0)


def play(inst: Instrument, playback: Playback, key: str = "", change: float = 0.0) -> tuple[Array, Array]:
    """Return tensions as read but for the noise, (n, 2), and the tip's error, (n,), with one unknown changed."""
    handle, force, rest = playback.handle, FORCE, 0.0
    if key == "load":
        force += change
    elif key == "rest":
        rest = change
    elif key == "handle_offset":
        handle = handle + change
    elif "." not in key or key.startswith("friction"):
        inst = inst.replace(**{key: change}) if key else inst
    run = Twin(inst).run(handle, rest + load(force, handle.size), spool_velocity=playback.velocity)
    read = np.array(run["tension"])
    kind, _, side = key.partition(".")
    if kind in ("gain", "offset"):
        column = ("agonist", "antagonist").index(side)
        read[:, column] += change * (read[:, column] if kind == "gain" else 1)
    return read, run["output_angle"] - tn.statics.output_angle(inst, handle, 0.0)


def sensitivity(inst: Instrument, playback: Playback, key: str, deviation: float) -> tuple[Array, Array]:
    """Return the derivatives of readings and error by an unknown in its standard deviations."""
    at, size, lowest = 0.0, deviation, -np.inf
    if key.startswith("friction") or key == "tendon_stiffness":
        group, _, name = key.rpartition(".")
        at, lowest = getattr(inst.friction if group else inst, name), 0.0
        size = deviation if key in ARRANGEMENT else deviation * at
    ends = at + STEP * size, max(at - STEP * size, lowest)
    high, low = (play(inst, playback, key, end) for end in ends)
    span = (ends[0] - ends[1]) / size
    return (high[0] - low[0]) / span, (high[1] - low[1]) / span


def bounds(number: int, state: float) -> dict[str, float]:
    """Return the least standard deviation (deg) of the tip's error in a state (deg) of a row.

    By sensors soon after the load (early) and at the end (late), and there with the error of the equations (modelled).
    """
    row = ROWS[number]
    inst = law.instrument("scaled-up").replace(mismatch=None, **row.changes)
    handle = motion(inst, state)
    run = Twin(inst).run(handle, load(FORCE, handle.size), controller=Controller(inst))
    playback = Playback(handle, run["commanded_spool_velocity"])
    # Nothing tells that the tip is free before the load comes.
    unknown = dict(row.unknown) | {"load": 2 * FORCE, "rest": 2 * FORCE}
    found = [sensitivity(inst, playback, key, deviation) for key, deviation in unknown.items()]
    readings, errors = np.stack([one[0] for one in found], -1), np.stack([one[1] for one in found], -1)
    sensors = inst.sensors
    step = 2 * sensors.load_cell_range / 2**sensors.load_cell_bits
    by_sensors = np.hypot(sensors.load_cell_noise, step / np.sqrt(12))
    # As white noise with the same low frequencies.
    by_model = MODEL_ERROR * np.sqrt(MODEL_TIME / TIME_STEP)

    def bound(seconds: float, noise: float) -> float:
        count = round(seconds / TIME_STEP)
        seen = readings[:count].reshape(-1, len(unknown)) / noise
        weight = np.eye(len(unknown)) + seen.T @ seen
        return float(np.degrees(np.sqrt(errors[count - 1] @ np.linalg.solve(weight, errors[count - 1]))))

    return {
        "early": bound(LOADED + EARLY, by_sensors),
        "late": bound(SECONDS, by_sensors),
        "modelled": bound(SECONDS, by_model),
    }


BOUNDS = [
    Column(f"sensors alone, {EARLY:g} s after the load, deg", "early", campaign.rms, ".4f"),
    Column("sensors alone, at the end, deg", "late", campaign.rms, ".4f"),
    Column(f"equations wrong by {MODEL_ERROR:g} N, deg", "modelled", campaign.rms, ".3f"),
    Column("the same worst", "modelled", np.max, ".3f"),
]


def main() -> None:
    options = law.arguments(__doc__).parse_args()
    cases = campaign.cases(number=range(len(ROWS)), state=law.OUTPUTS)
    rows = campaign.run(bounds, cases, "information", results=options.results)
    print(f"least error of any estimator, deg RMS over {', '.join(f'{one:g}' for one in law.OUTPUTS)}°, scaled-up")
    law.show(options, "information", {ROWS[n].words: own for n, own in rows.by("number").items()}, BOUNDS, "unknown")


if __name__ == "__main__":
    main()

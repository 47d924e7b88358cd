"""Dither in the place of the first common strokes after a load, on twins that differ from what the law assumes.

Peer: the same twins observed by strokes. The hand moves to four states and the rated load comes at once; the controller
assumes friction of 0.7, 1 and 1.3 times the truth, and knows none of a row's changes. Errors are distances of the tip
from where the handle puts it without load and friction.
"""

from typing import Any

import law
import numpy as np

from tenodesis.control import Controller
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, rms
from tenodesis.twin import TIME_STEP, Twin

EASED, LOADED, SECONDS, LAST = 1.0, 2.5, 7.0, 1.0  # s; the motors rest before the load
OBSERVED = ("strokes", "dither", "auto")
MEAN = round(0.05 / TIME_STEP)
"""Steps of a mean in which dither and the tip's own swing cancel."""
DITHERS = 6  # of the signal phase
CHANGES: dict[str, dict[str, Any]] = {
    "nothing": {},
    "hand of 5 N m/rad": {"dynamics.hand_stiffness": 5.0},
    "backlash of 2° before the spools": {"drives.backlash": np.radians(2)},
    "friction that falls with speed": {
        "friction.law": "stribeck",
        "friction.static_ratio": 1.3,
        "friction.stribeck_speed": 1e-3,
    },
    "coefficients of 0.25, known": law.friction(law.instrument("scaled-up"), 2.5),
    "drives of 5 ms, known": {"drives.time_constant": 0.005},
    "drives of 30 ms, known": {"drives.time_constant": 0.03},
    "10 % softer": {"tendon_stiffness": 0.9},
}
KNOWN = ("coefficients of 0.25, known", "drives of 5 ms, known", "drives of 30 ms, known")


def load(instrument: str, change: str, observe: str, angle: float, assumed: float) -> dict[str, Any]:
    """Load a tip at an angle, deg, and return how its mean error went, deg, and how the handle was shaken, mN m."""
    truth = law.instrument(instrument)
    changes = dict(CHANGES[change])
    if "tendon_stiffness" in changes:
        changes["tendon_stiffness"] *= truth.tendon_stiffness
    plant = truth.replace(**changes)
    file = (plant if change in KNOWN else truth).replace(**{"control.observe": observe})
    known = file.replace(**law.friction(file, assumed))
    time = law.clock(SECONDS)
    handle = law.held(truth, angle, time, EASED)
    run = Twin(plant, seed=1).run(handle, law.RATED[instrument] * (time > LOADED), controller=Controller(known))
    error = np.degrees(run["output_angle"] - law.target(truth, run["handle_angle"]))
    mean = np.convolve(error, np.full(MEAN, 1 / MEAN), "valid")
    at = run.time[MEAN - 1 :]
    after = at > LOADED
    found = {f"within_{name}": _last(mean[after], at[after], most) for name, most in (("1", 1.0), ("03", 0.3))}
    dithers = run["phase"] == DITHERS
    windows = run["handle_torque"][: run.time.size // MEAN * MEAN].reshape(-1, MEAN)
    whole = dithers[: windows.size].reshape(windows.shape).all(1)
    later = (run.time > LOADED + LAST) & (run.time < LOADED + 3 * LAST)
    return found | {
        "final": error[run.time > SECONDS - LAST].mean(),
        "swing": np.ptp(np.degrees(run["output_angle"][later])),
        "shaken": 1e3 * np.ptp(windows[whole], axis=1).max(initial=0.0),
        "dither": dithers.mean() * SECONDS,
        "faults": law.faults(run),
    }


def _last(mean: law.Array, time: law.Array, most: float) -> float:
    beyond = np.flatnonzero(np.abs(mean) > most)
    return float(time[beyond[-1]]) - LOADED if beyond.size else 0.0


COLUMNS = [
    Column("final error RMS", "final", rms),
    Column("final error worst", "final", lambda values: np.abs(values).max()),
    Column("within 1° at last, s", "within_1", np.max),
    Column("within 0.3° median, s", "within_03", np.median),
    Column("tip's swing from 1 to 3 s median", "swing", np.median),
    Column("dither, s", "dither", np.mean),
    Column("handle shaken at most, mN m", "shaken", np.max),
    Column("faults", "faults", campaign.names, ""),
]


def main() -> None:
    options = law.arguments(__doc__, law.RATED).parse_args()
    cases = campaign.cases(
        instrument=options.instrument or list(law.RATED),
        change=list(CHANGES),
        observe=OBSERVED,
        angle=law.OUTPUTS,
        assumed=law.ASSUMED,
    )
    rows = campaign.run(load, cases, "dither", results=options.results)
    law.show(options, "dither", rows.by("instrument", "change", "observe"), COLUMNS, ("instrument", "change", "by"))


if __name__ == "__main__":
    main()

"""Dither in the place of the first common strokes after a load, on twins that differ from what the law assumes.

Peer: the same twins observed by strokes. The hand moves to four states and the rated load comes at once; the controller
assumes friction of 0.7, 1 and 1.3 times the truth, and knows none of a row's changes. Errors are distances of the tip
from where the handle puts it without load and friction.
"""

from typing import Any

import law
import numpy as np

from tenodesis.control import Controller
from tenodesis.instrument import Instrument
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, rms
from tenodesis.twin import TIME_STEP, Twin

EASED, LOADED, SECONDS, LAST = 1.0, 2.5, 7.0, 1.0  # s; the motors rest before the load
OBSERVED = ("strokes", "dither", "auto")
DITHERS = 6  # of the signal phase


def unknown(inst: Instrument) -> dict[str, dict[str, Any]]:
    """Return what a plant may have that its controller does not know."""
    return {
        "nothing": {},
        "hand of 5 N m/rad": {"dynamics.hand_stiffness": 5.0},
        "backlash of 2° before the spools": {"drives.backlash": np.radians(2)},
        "friction that falls with speed": {
            "friction.law": "stribeck",
            "friction.static_ratio": 1.3,
            "friction.stribeck_speed": 1e-3,
        },
        "10 % softer": {"tendon_stiffness": 0.9 * inst.tendon_stiffness},
    }


def known(inst: Instrument) -> dict[str, dict[str, Any]]:
    """Return what a plant may have that stands in its file."""
    return {
        "coefficients of 0.25, known": law.friction(inst, 2.5),
        "drives of 5 ms, known": {"drives.time_constant": 0.005},
        "drives of 30 ms, known": {"drives.time_constant": 0.03},
    }


def load(instrument: str, change: str, observe: str, angle: float, assumed: float) -> dict[str, Any]:
    """Load a tip at an angle, deg, and return how its mean error went, deg, and how the handle was shaken, mN m."""
    truth = law.instrument(instrument)
    stated = known(truth).get(change, {})
    plant = truth.replace(**stated, **unknown(truth).get(change, {}))
    file = truth.replace(**stated, **{"control.observe": observe})
    assuming = file.replace(**law.friction(file, assumed))
    time = law.clock(SECONDS)
    handle = law.held(truth, angle, time, EASED)
    run = Twin(plant, seed=1).run(handle, law.RATED[instrument] * (time > LOADED), controller=Controller(assuming))
    error = np.degrees(run["output_angle"] - law.target(truth, run["handle_angle"]))
    found = {
        f"within_{name}": law.last_beyond(run.time, error, LOADED, most) for name, most in (("1", 1.0), ("03", 0.3))
    }
    dithers = run["phase"] == DITHERS
    count = round(law.MEAN / TIME_STEP)
    windows = run["handle_torque"][: run.time.size // count * count].reshape(-1, count)
    whole = dithers[: windows.size].reshape(windows.shape).all(1)
    later = (run.time > LOADED + LAST) & (run.time < LOADED + 3 * LAST)
    return found | {
        "final": error[run.time > SECONDS - LAST].mean(),
        "swing": np.ptp(np.degrees(run["output_angle"][later])),
        "shaken": 1e3 * np.ptp(windows[whole], axis=1).max(initial=0.0),
        "dither": dithers.mean() * SECONDS,
        "faults": law.faults(run),
    }


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
        change=[*unknown(law.instrument("scaled-up")), *known(law.instrument("scaled-up"))],
        observe=OBSERVED,
        angle=law.OUTPUTS,
        assumed=law.ASSUMED,
    )
    rows = campaign.run(load, cases, "dither", results=options.results)
    law.show(options, "dither", rows.by("instrument", "change", "observe"), COLUMNS, ("instrument", "change", "by"))


if __name__ == "__main__":
    main()

"""What the robust law reaches with motor currents in the place of load cells, and what it does when they fail.

The scaled-up instrument on its twin, the paper's step load in the four states of Fig. 15, friction of the tendons
assumed as 0.7, 1 and 1.3 times what it is. The drives' friction is in the currents, not in the load cells.

Peers: load cells, and motors that stand.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import law
import numpy as np

import tenodesis as tn
from tenodesis.control import Controller, LawName
from tenodesis.instrument import Instrument
from tenodesis.paper import step_response
from tenodesis.run import Run
from tenodesis.simulate import FaultInjection, campaign
from tenodesis.simulate.campaign import Column
from tenodesis.twin import Twin

BEFORE, AFTER, LAST, FAILS = 4.0, 6.0, 1.0, 0.5  # s
CURRENTS: dict[str, Any] = {"sensors.kind": "current", "sensors.current_range": 6.0, "drives.torque_constant": 0.1}
"""A direct drive of 20 N/A at a spool of 5 mm."""


class DriveMismatch(NamedTuple):
    """A row of the table: the true instrument's values, and what the controller assumes instead."""

    words: str
    changes: Mapping[str, Any]
    stated: Mapping[str, Any] = {}
    lost: float = 0.0
    """Share of the torque constant that the true motors lack"""


def drive(efficiency: float, friction: float, **rest: float) -> dict[str, Any]:
    """Return the keys of a drive; friction at the spool, N m."""
    own = {"drives.gear_efficiency": efficiency, "drives.friction_torque": friction}
    return CURRENTS | own | {f"drives.{key}": value for key, value in rest.items()}


GEARED = drive(0.9, 5e-3)
ROWS = {
    "cells": DriveMismatch("load cells", {}),
    "ideal": DriveMismatch("currents of a drive without friction or ripple", drive(1.0, 0.0, torque_ripple=0.0)),
    "direct": DriveMismatch("the same with ripple of 2 %", drive(1.0, 0.0)),
    "geared": DriveMismatch("gear of 0.9, friction of 1 N", GEARED),
    "less": DriveMismatch(
        "the same, its friction assumed as 0.7", GEARED, {"gear_efficiency": 0.93, "friction_torque": 3.5e-3}
    ),
    "more": DriveMismatch(
        "the same, its friction assumed as 1.3", GEARED, {"gear_efficiency": 0.87, "friction_torque": 6.5e-3}
    ),
    "warm": DriveMismatch("the same, motors warm by 3 %", drive(0.9, 5e-3, thermal_drift=0.03, thermal_time=0.1)),
    "apart": DriveMismatch("the same, torque constants 2 % apart", GEARED, lost=0.02),
    "coarse": DriveMismatch("gear of 0.8, friction of 2 N", drive(0.8, 10e-3)),
    "worm": DriveMismatch("gear of 0.6, friction of 4 N", drive(0.6, 20e-3)),
}


def trial(inst: Instrument, assumed: Instrument, output: float, law: LawName = "robust", **faults: Any) -> Run:
    """Return a run in a state (deg)."""
    force = step_response.step_force(inst)
    motion = step_response.held_motion(inst, float(np.radians(output)), force, BEFORE, AFTER)
    return Twin(inst, seed=1).run(motion.handle_angle, motion.force, controller=Controller(assumed, law=law), **faults)


def known(inst: Instrument, share: float, stated: Mapping[str, Any]) -> Instrument:
    """Return what the controller knows: identified stiffness, friction times a share, and what the row states."""
    model = step_response.controller_model(inst)
    return model.replace(**law.friction(inst, share), **{f"drives.{key}": value for key, value in stated.items()})


def plant(row: str) -> Instrument:
    inst, lost = tn.load("scaled-up").replace(**ROWS[row].changes), ROWS[row].lost
    return inst.replace(**{"mismatch.load_cell_gain": (1 + lost / 2, 1 - lost / 2)}) if lost else inst


def held(row: str, output: float, share: float) -> dict[str, Any]:
    """Hold a state (deg), friction assumed as a share: errors at the end, deg, of the force N, and NEES."""
    inst = plant(row)
    assumed = known(inst, share, ROWS[row].stated)
    run, standing = (trial(inst, assumed, output, law) for law in ("robust", "off"))
    last, wanted = run.time > run.time[-1] - LAST, np.radians(output)
    missed = run["estimated_output_angle"] - run["output_angle"]
    return {
        "final": np.degrees((run["output_angle"][last] - wanted).mean()),
        "off": np.degrees((standing["output_angle"][last] - wanted).mean()),
        "estimate": np.degrees(campaign.rms(missed[last])),
        "nees": ((missed / run["estimated_output_angle_std"])[run.time > 2] ** 2).mean(),
        "force": (run["estimated_force"] - run["force"])[last].mean(),
        "faults": law.faults(run),
    }


FAILING: dict[str, dict[str, Any]] = {
    "stands still": {"mode": "hold"},
    "at the end of its range": {"mode": "set"},
    "zero": {"mode": "set", "value": 0.0},
    "drifts by 10 N/s": {"mode": "add", "value": 0.0, "rate": 10.0},
}


def failure(row: str, tendon: str, words: str) -> dict[str, Any]:
    """Return by how much further than with motors off the tip goes, deg, when the reading of a tension fails."""
    inst, at = plant(row), BEFORE - FAILS
    assumed, how = known(inst, 1.0, {}), {"value": plant(row).tension_sensor.range, **FAILING[words]}
    injected = FaultInjection(f"tension.{tendon}", start=at, **how)  # type: ignore[arg-type]
    runs = trial(inst, assumed, 67.0, fault_injection=[injected]), trial(inst, assumed, 67.0, "off")
    off = [np.abs(run["output_angle"] - np.radians(67.0))[run.time > at].max() for run in runs]
    named = ", ".join(f"{name} after {when - at:.3f} s" for name, when in runs[0].fault_times.items())
    return {"more": np.degrees(off[0] - off[1]), "named": named or "no fault"}


HELD = [
    Column("final error RMS", "final", campaign.rms),
    Column("worst", "final", campaign.farthest),
    Column("motors off", "off", campaign.rms),
    Column("estimate", "estimate", campaign.rms),
    Column("NEES, ", "nees", form=".1f"),
    Column("force, N", "force", campaign.rms),
    Column("faults", "faults", campaign.names, ""),
]
FAILED = [Column("further off, deg", "more"), Column("named", lambda rows: rows[0]["named"], form="")]


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], default=[*ROWS], metavar="ROW")
    options = parser.parse_args()
    cases = campaign.cases(row=options.rows, output=law.OUTPUTS, share=law.ASSUMED)
    rows = campaign.run(held, cases, "currents", results=options.results)
    law.show(options, "currents", {ROWS[row].words: own for row, own in rows.by("row").items()}, HELD, "sensors")
    failing = {"geared": "currents of the drive with a gear of 0.9", "cells": "load cells"}
    cases = campaign.cases(row=failing, words=FAILING, tendon=("agonist", "antagonist"))
    failed = campaign.run(failure, cases, "failures")
    for row, words in failing.items():
        print(f"{words} that fail {FAILS:g} s before the load, 67°: how much further off than motors off, at worst")
        groups = failed.where(row=row).by("tendon", "words")
        law.show(options, f"currents_fail_{row}", groups, FAILED, ("", ""))


if __name__ == "__main__":
    main()

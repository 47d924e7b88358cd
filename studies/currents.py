"""What the robust law reaches with motor currents in the place of load cells, and what it does when they fail.

The scaled-up instrument on its twin, the paper's step load in the four states of Fig. 15, friction of the tendons
assumed as 0.7, 1 and 1.3 times what it is. The drives' friction is in the currents, not in the load cells.

Peers: load cells, and motors that stand.
"""

import argparse
import warnings
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.errors import FaultWarning
from tenodesis.instrument import Instrument
from tenodesis.paper import step_response
from tenodesis.run import Run
from tenodesis.simulate import FaultInjection
from tenodesis.twin import Twin

Array = NDArray[np.float64]

OUTPUTS = (0.0, 33.0, 67.0, 80.0)  # deg, Fig. 15
ASSUMED = (0.7, 1.0, 1.3)
BEFORE, AFTER, LAST = 4.0, 6.0, 1.0  # s
COEFFICIENTS = ("vertex_coefficient", "sheath_coefficient")
CURRENTS: dict[str, Any] = {
    "sensors.kind": "current",
    "sensors.current_range": 6.0,
    "drives.torque_constant": 0.1,
}
"""A direct drive of 20 N/A at a spool of 5 mm."""


class Row(NamedTuple):
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
    "cells": Row("load cells", {}),
    "ideal": Row("currents of a drive without friction or ripple", drive(1.0, 0.0, torque_ripple=0.0)),
    "direct": Row("the same with ripple of 2 %", drive(1.0, 0.0)),
    "geared": Row("gear of 0.9, friction of 1 N", GEARED),
    "less": Row("the same, its friction assumed as 0.7", GEARED, {"gear_efficiency": 0.93, "friction_torque": 3.5e-3}),
    "more": Row("the same, its friction assumed as 1.3", GEARED, {"gear_efficiency": 0.87, "friction_torque": 6.5e-3}),
    "warm": Row("the same, motors warm by 3 %", drive(0.9, 5e-3, thermal_drift=0.03, thermal_time=0.1)),
    "apart": Row("the same, torque constants 2 % apart", GEARED, lost=0.02),
    "coarse": Row("gear of 0.8, friction of 2 N", drive(0.8, 10e-3)),
    "worm": Row("gear of 0.6, friction of 4 N", drive(0.6, 20e-3)),
}


class Summary(NamedTuple):
    """What a row came to over states and assumed friction, deg unless said."""

    final_rms: float
    final_worst: float
    off_rms: float
    estimate_rms: float
    nees: float
    force_rms: float
    """Of the estimated tip force in the last second, N"""
    faults: tuple[str, ...]


def trial(
    inst: Instrument, assumed: Instrument, output: float, law: str = "robust", **faults: Any
) -> tuple[Run, float]:
    """Return a run in a state (deg), and the output angle that the handle wants there without friction, rad."""
    force = step_response.step_force(inst)
    motion = step_response.held_motion(inst, float(np.radians(output)), force, BEFORE, AFTER)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FaultWarning)
        controller = Controller(assumed, law=law)  # type: ignore[arg-type]
        run = Twin(inst, seed=1).run(motion.handle_angle, motion.force, controller=controller, **faults)
    return run, float(np.radians(output))


def known(inst: Instrument, share: float, stated: Mapping[str, Any]) -> Instrument:
    """Return what the controller knows: identified stiffness, friction times a share, and what the row states."""
    model = step_response.controller_model(inst)
    coefficients = {f"friction.{key}": share * getattr(inst.friction, key) for key in COEFFICIENTS}
    return model.replace(**coefficients, **{f"drives.{key}": value for key, value in stated.items()})


def judge(row: Row) -> Summary:
    """Run a row's cases."""
    inst = tn.load("scaled-up").replace(**row.changes)
    if row.lost:
        inst = inst.replace(**{"mismatch.load_cell_gain": (1 + row.lost / 2, 1 - row.lost / 2)})
    final, off, estimate, nees, force, names = [], [], [], [], [], []
    for output, share in product(OUTPUTS, ASSUMED):
        assumed = known(inst, share, row.stated)
        run, wanted = trial(inst, assumed, output)
        last = run.time > run.time[-1] - LAST
        final.append(float((run["output_angle"][last] - wanted).mean()))
        missed = run["estimated_output_angle"] - run["output_angle"]
        estimate.append(float(np.sqrt((missed[last] ** 2).mean())))
        nees.append(float(((missed / run["estimated_output_angle_std"])[run.time > 2] ** 2).mean()))
        force.append(float((run["estimated_force"] - run["force"])[last].mean()))
        names += run.fault_times
        standing, _ = trial(inst, assumed, output, law="off")
        off.append(float((standing["output_angle"][last] - wanted).mean()))
    angles = np.degrees([rms(final), float(np.abs(final).max()), rms(off), rms(estimate)]).tolist()
    return Summary(*angles, float(np.mean(nees)), rms(force), tuple(dict.fromkeys(names)))


def rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def failures(inst: Instrument, what: str) -> None:
    """Print by how much further than with motors off the tip goes when the reading of a tension fails."""
    sensor = inst.tension_sensor
    print(f"{what} that fail 0.5 s before the load, 67°: how much further off than with motors off, at worst")
    assumed = known(inst, 1.0, {})
    standing, wanted = trial(inst, assumed, 67.0, law="off")
    after = standing.time > BEFORE - 0.5
    least = float(np.abs(standing["output_angle"] - wanted)[after].max())
    failing = {
        "stands still": {"mode": "hold"},
        "at the end of its range": {"mode": "set", "value": sensor.range},
        "zero": {"mode": "set", "value": 0.0},
        "drifts by 10 N/s": {"mode": "add", "rate": 10.0},
    }
    for words, how in failing.items():
        for tendon in ("agonist", "antagonist"):
            injected = FaultInjection(f"tension.{tendon}", start=BEFORE - 0.5, **how)  # type: ignore[arg-type]
            run, _ = trial(inst, assumed, 67.0, fault_injection=[injected])
            worst = float(np.abs(run["output_angle"] - wanted)[after].max())
            named = ", ".join(f"{name} after {at - BEFORE + 0.5:.3f} s" for name, at in run.fault_times.items())
            print(f"  {tendon:12s}{words:26s}{np.degrees(worst - least):7.2f}°   {named or 'no fault'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], default=[*ROWS], metavar="ROW")
    options = parser.parse_args()
    print(
        f"  {'final error, deg':48s}{'RMS':>7s}{'worst':>7s}{'off':>7s}{'estimate':>10s}{'NEES':>6s}{'force, N':>10s}"
    )
    for name in options.rows:
        one = judge(ROWS[name])
        print(
            f"  {ROWS[name].words:48s}{one.final_rms:7.2f}{one.final_worst:7.2f}{one.off_rms:7.2f}"
            f"{one.estimate_rms:10.2f}{one.nees:6.1f}{one.force_rms:10.2f}  {', '.join(one.faults)}"
        )
    failures(tn.load("scaled-up").replace(**GEARED), "currents of the drive with a gear of 0.9")
    failures(tn.load("scaled-up"), "load cells")


if __name__ == "__main__":
    main()

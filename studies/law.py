"""What the studies of the law have in common: instruments, what a controller assumes of them, hands, arguments."""

import argparse
import functools
import warnings
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.errors import FaultWarning
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.simulate.command import SMOOTH
from tenodesis.twin import TIME_STEP

Array = NDArray[np.float64]

RATED = {"scaled-up": 1.485, "real-size": 0.52}  # N; 0.15 N m on the large one, and the same on the small one
OUTPUTS = (0.0, 33.0, 67.0, 80.0)  # deg, Fig. 15
ASSUMED = (0.7, 1.0, 1.3)
"""Friction that a controller assumes, over the truth."""
COEFFICIENTS = ("vertex_coefficient", "sheath_coefficient")


@functools.cache
def instrument(name: str) -> Instrument:
    """Return the first axis of an instrument."""
    inst = tn.load(name)
    return inst.axis(inst.axes[0])


def friction(inst: Instrument, factor: float) -> dict[str, float]:
    """Return the changes that give an instrument other friction coefficients."""
    return {f"friction.{name}": getattr(inst.friction, name) * factor for name in COEFFICIENTS}


def differing(inst: Instrument, factor: float = 1.0, stiffness: float = 1.0) -> Instrument:
    """Return the instrument with other friction, and with the true stiffness times a factor."""
    true = inst.tendon_stiffness * inst.mismatch.stiffness_ratio
    mismatch = inst.mismatch.model_dump() | {"stiffness_ratio": 1 / stiffness}
    return inst.replace(tendon_stiffness=true * stiffness, mismatch=mismatch, **friction(inst, factor))


def clock(seconds: float) -> Array:
    """Return the times of the steps of a run, s."""
    return np.arange(1, round(seconds / TIME_STEP) + 1, dtype=np.float64) * TIME_STEP


def eased(time: Array, span: float) -> Array:
    """Return the way of a hand that moves smoothly for a time, as a share."""
    return np.asarray(SMOOTH.way(np.clip(time / span, 0, 1)))


def target(inst: Instrument, handle: Array) -> Array:
    """Return where the handle puts the tip without load and friction, rad."""
    return np.clip(tn.statics.output_angle(inst, handle, 0.0), -inst.output_stop, inst.output_stop)


def faults(run: Run) -> list[str]:
    """Return the names of a run's faults."""
    return list(run.fault_times)


def arguments(doc: str | None, instruments: Iterable[str] = ()) -> argparse.ArgumentParser:
    """Return the arguments that every study takes; with instruments, which of them."""
    # Faults are results here.
    warnings.simplefilter("ignore", FaultWarning)
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--results", type=Path, help="JSON file of all runs, from which a stopped study goes on")
    if instruments:
        parser.add_argument("--instrument", choices=[*instruments], action="append", help="by default all")
    return parser

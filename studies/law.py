"""What the studies of the law have in common: instruments, what a controller assumes of them, hands, arguments."""

import argparse
import functools
import sys
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import figures
import numpy as np
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.errors import FaultWarning
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, Rows
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
    parser.add_argument("--figures", type=Path, help="JSON file into which the tables are written: docs/results.json")
    if instruments:
        parser.add_argument("--instrument", choices=[*instruments], action="append", help="by default all")
    return parser


def show(
    options: argparse.Namespace,
    name: str,
    groups: Mapping[Any, Rows],
    columns: Sequence[Column],
    heading: str | Sequence[str] = "",
    *,
    unit: str = "deg",
) -> None:
    """Print a table, and write it into the file of figures, if there is one.

    What follows the last comma of a column's heading is its unit, others have that of the table.
    """
    printed = [replace(column, heading=column.heading.removesuffix(", ")) for column in columns]
    print(campaign.table(groups, printed, heading))
    if options.figures is None:
        return
    headings = []
    for column in columns:
        text, _, own = column.heading.rpartition(", ")
        text, own = (text, own) if text else (own, unit if column.form else "")
        headings.append(figures.Heading(figures.slug(text), text, own, column.form))
    rows = {
        " ".join(str(part) for part in label if part != "") if isinstance(label, tuple) else str(label): [
            one.value(own) for one in columns
        ]
        for label, own in groups.items()
    }
    command = " ".join(["python", f"studies/{Path(sys.argv[0]).name}", *_without_files(sys.argv[1:])])
    of = heading if isinstance(heading, str) else " ".join(filter(None, heading))
    figures.keep(name, figures.Table(command, of, headings, rows), options.figures)


def _without_files(words: Sequence[str]) -> list[str]:
    pairs = zip(["", *words], words, strict=False)
    return [word for last, word in pairs if not {last, word} & {"--figures", "--results"}]

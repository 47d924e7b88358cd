"""What the studies of the law have in common: instruments, what a controller assumes of them, hands, arguments."""

import argparse
import functools
import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import figures
import numpy as np
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.control import parameters
from tenodesis.errors import FaultWarning
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, Rows
from tenodesis.simulate.command import SMOOTH
from tenodesis.twin import TIME_STEP, Twin
from tenodesis.twin.rows import columns_by_name

Array = NDArray[np.float64]

RATED = {"scaled-up": 1.485, "real-size": 0.52}  # N; 0.15 N m on the large one, and the same on the small one
OUTPUTS = (0.0, 33.0, 67.0, 80.0)  # deg, Fig. 15
ASSUMED = (0.7, 1.0, 1.3)
"""Friction that a controller assumes, over the truth."""
MEAN = 0.05  # s
"""In which dither and the tip's own swing cancel."""
TICK = 4
"""Steps between two readings of a sensor at the tip"""
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
    return np.asarray(SMOOTH.way(np.clip(time / span, 0, 1)), np.float64)


def target(inst: Instrument, handle: Array) -> Array:
    """Return where the handle puts the tip without load and friction, rad."""
    return np.clip(tn.statics.output_angle(inst, handle, 0.0), -inst.output_stop, inst.output_stop)


def held(inst: Instrument, angle: float, time: Array, span: float) -> Array:
    """Return a handle that moves smoothly, for a time, to where the tip is at an angle, deg, and stays."""
    way = eased(time, span)
    return way * float(tn.statics.handle_angle(inst, np.radians(angle)))


def last_beyond(time: Array, error: Array, since: float, bound: float) -> float:
    """Return how long after a time, s, an error, averaged over :data:`MEAN`, was last beyond a bound."""
    after, window = time > since, round(MEAN / (time[1] - time[0]))
    mean = np.convolve(error[after], np.full(window, 1 / window), "valid")
    beyond = np.flatnonzero(np.abs(mean) > bound)
    return float(time[after][beyond[-1] + window - 1 if beyond.size else 0] - since)


class MovingTissue(Twin):
    """A twin whose tissue moves: (n, 3), angle, stiffness (negative in extension) and damping at each step of a run."""

    def __init__(self, inst: Instrument, tissue: Array, seed: int) -> None:
        super().__init__(inst, seed=seed)
        self._tissue = tissue

    def _rows(self, handle_angle: Any, force: Any, **loads: Any) -> tuple[Array, int]:
        rows, count = super()._rows(handle_angle, force, **loads)
        rows[:, self._core.columns["contact"]] = self._tissue
        return rows, count


def tip_sensor(  # noqa: PLR0917
    inst: Instrument,
    seed: int,
    handle: Array,
    force: Array,
    aim: Array,
    lasting: float = 0.0,
    tissue: Any = None,
    stop: float = np.inf,
) -> Array:
    """Return the tip's angle, rad, whose motors give back what a sensor without error finds lost, for a time (s).

    The drives, the limit of their speed and the gain are the robust law's; aim: of the tip, rad; tissue: as
    :class:`MovingTissue` takes it; stop: when the motors return home, s.
    """
    own = parameters(inst).axes[0]
    per_angle = own["distal_radius"] / own["spool_radius"]
    fastest = own["tendon_speed"] / own["spool_radius"]
    twin = Twin(inst, seed=seed).core
    given, found = columns_by_name(twin.commands), columns_by_name(twin.signals)
    commands, signals = (np.zeros((handle.size, sum(width for _, width in of))) for of in (twin.commands, twin.signals))
    commands[:, given["handle_angle"].start], commands[:, given["force"].start] = handle, force
    commands[:, given["contact"]] = 0.0 if tissue is None else tissue
    motors, spools, tip = given["spool_velocity"], found["spool_angle"], found["output_angle"].start
    lost = np.zeros(max(1, round(lasting / (TICK * TIME_STEP))))
    for n in range(handle.size // TICK):
        now, following = slice(n * TICK, (n + 1) * TICK), slice((n + 1) * TICK, (n + 2) * TICK)
        twin.run(commands[now], signals[now])
        last = signals[now][-1]
        wound = -np.diff(last[spools])[0] / (2 * per_angle)
        lost[n % lost.size] = aim[now][-1] - last[tip] + wound
        lasted = max(lost.min(), 0.0) + min(lost.max(), 0.0) if n * TICK * TIME_STEP < stop else 0.0
        speed = float(np.clip(own["gain"] * per_angle * (lasted - wound), -fastest, fastest))
        commands[following, motors] = speed, -speed
    return np.asarray(signals[:, tip])


def faults(run: Run) -> list[str]:
    """Return the names of a run's faults."""
    return list(run.fault_times)


def arguments(doc: str | None, instruments: Iterable[str] = ()) -> argparse.ArgumentParser:
    """Return the arguments that every study takes; with instruments, which of them."""
    # Faults are results here.
    warnings.simplefilter("ignore", FaultWarning)
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--results", type=Path, help="JSON file of all runs, from which a stopped study goes on")
    figures.arguments(parser)
    if instruments:
        parser.add_argument("--instrument", choices=[*instruments], action="append", help="by default all")
    return parser


def counts(names: Counter[str]) -> str:
    """Return names with how often each occurs, as a cell of a table."""
    return ", ".join(f"{name} {count}" for name, count in names.items())


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
    figures.keep(name, figures.FigureTable(command, of, headings, rows), options.figures)


def _without_files(words: Sequence[str]) -> list[str]:
    pairs = zip(["", *words], words, strict=False)
    return [word for last, word in pairs if not {last, word} & {"--figures", "--results"}]

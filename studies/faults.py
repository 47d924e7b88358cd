"""False alarms: how often normal work on the twin is reported as a fault, over hours, and the computing time.

Hand motions like a surgeon's, loads up to 90 % of the slack force, a sheath that bends by up to a quarter turn;
controllers with the right instrument and with wrong ones, under every law.
"""

import os
import time
from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

import law
import numpy as np

import tenodesis as tn
from tenodesis.control import Controller, OperatingState, parameters
from tenodesis.control.controller import fault_names
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, Rows
from tenodesis.simulate.command import SMOOTH
from tenodesis.twin import TIME_STEP, Contact, Side, Twin

Array = law.Array

HOURS = 10.0
CHUNK = 60.0  # s of work between two readings of the clock
FASTEST = 2.0  # Hz
MOST_BEND = np.pi / 2  # rad
LOAD = 0.9  # of the slack force
TREMOR = (0.05, 1.0)  # deg, at the handle
TISSUE = (100.0, 10000.0)  # N/m


class TwinInputs(NamedTuple):
    """Inputs of an instrument per step: rad, N, rad, each of shape (n,)."""

    handle_angle: Array
    force: Array
    sheath_bend: Array


class Setting(NamedTuple):
    """A controller and the errors of its instrument."""

    observer: str = "friction"
    law: str = "robust"
    actuation: str = "differential"
    friction: float = 1.0
    """Coefficients that the controller assumes, over the true ones."""
    stiffness: float = 1.0


SETTINGS = (
    Setting(),
    Setting(friction=0.7),
    Setting(friction=1.3),
    Setting(stiffness=1 / 0.85),
    Setting(law="off"),
    Setting(observer="paper", law="paper"),
    Setting(observer="paper", law="paper-feedback"),
    Setting(observer="exact", law="exact"),
    Setting(actuation="agonist"),
    Setting(friction=0.7, stiffness=1 / 0.85),
)


def work(inst: Instrument, random: np.random.Generator, seconds: float) -> TwinInputs:
    """Return normal work: motions, holds, sudden stops and tremor under varying loads."""
    count = round(seconds / TIME_STEP)
    reach = float(tn.statics.handle_angle(inst, inst.output_range))
    most = LOAD * float(tn.statics.slack_force(inst, inst.output_range))
    columns = [np.zeros(count) for _ in TwinInputs._fields]
    for column, segment in zip(columns, (_hand, _load, _bend), strict=True):
        largest = (reach, most, MOST_BEND)[(_hand, _load, _bend).index(segment)]
        at = 0
        while at < count:
            span = round(random.uniform(0.3, 4.0) / TIME_STEP)
            t = np.arange(1, span + 1, dtype=np.float64) * TIME_STEP
            before = column[at - 1] if at else 0.0
            column[at : at + span] = segment(random, t, before, largest)[: count - at]
            at += span
    columns[0] = np.clip(columns[0] + _tremor(random, count), -inst.handle_range, inst.handle_range)
    return TwinInputs(*columns)


def _tremor(random: np.random.Generator, count: int) -> Array:
    """Return a hand's tremor, rad, which comes and goes."""
    t = np.arange(1, count + 1, dtype=np.float64) * TIME_STEP
    size = np.radians(random.uniform(*TREMOR)) * (random.random() < 0.5)
    rates, phases, beat = random.uniform(6, 12, (3, 1)), random.uniform(0, 2 * np.pi, (3, 1)), random.uniform(0.1, 1)
    tones = np.sin(2 * np.pi * rates * t + phases).sum(0) / np.sqrt(3)
    return np.asarray(size * np.sin(np.pi * beat * t) ** 2 * tones)


def _tissue(random: np.random.Generator, at: float) -> Contact | None:
    """Return tissue that a tip at an output angle, rad, may move into, or none."""
    if random.random() < 0.5:
        return None
    side: Side = "flexion" if random.random() < 0.5 else "extension"
    away = np.radians(random.uniform(2, 30)) * (1 if side == "flexion" else -1)
    return Contact(at + away, float(np.exp(random.uniform(*np.log(TISSUE)))), side=side)


def _hand(random: np.random.Generator, t: Array, before: float, most: float) -> Array:
    kind = random.integers(4)
    if kind == 0:
        return np.full(t.size, before)
    if kind == 1:
        return _moved(t, before, random.uniform(-most, most), random.uniform(0.25, 1.5))
    frequency = random.uniform(0.1, FASTEST, 3)[:, np.newaxis]
    size = random.dirichlet(np.ones(3))[:, np.newaxis] * random.uniform(0, 0.7) * most
    phase = random.uniform(0, 2 * np.pi, (3, 1))
    # It ends at any velocity: a sudden stop if a hold follows.
    swaying = size * (np.sin(2 * np.pi * frequency * t + phase) - np.sin(phase))
    return np.asarray(np.clip(before + swaying.sum(0), -most, most))


def _load(random: np.random.Generator, t: Array, before: float, most: float) -> Array:
    kind = random.integers(4)
    if kind == 0:
        return np.zeros(t.size)
    if kind == 1:
        return np.full(t.size, random.uniform(-most, most))
    if kind == 2:
        return _moved(t, before, random.uniform(-most, most), random.uniform(0.1, 2.0))
    mean = random.uniform(-0.5, 0.5) * most
    return np.asarray(mean + random.uniform(0, 0.5) * most * np.sin(2 * np.pi * random.uniform(0.1, FASTEST) * t))


def _bend(random: np.random.Generator, t: Array, before: float, most: float) -> Array:
    return _moved(t, before, random.uniform(0, most), random.uniform(0.5, 2.0))


def _moved(t: Array, start: float, end: float, span: float) -> Array:
    return start + (end - start) * SMOOTH.way(np.clip(t / span, 0, 1))


class ChunkFaults(NamedTuple):
    """Faults in a chunk of work."""

    ticks: int
    true_faults: list[str]
    """Confirmed by the twin: a tendon was slack, or beyond its limit."""
    false_faults: list[str]
    computing: float
    """s"""


def watched(inst: Instrument, setting: Setting, seed: int, seconds: float) -> Iterator[ChunkFaults]:
    """Yield the outcome of each chunk of work; after a fault controller and twin start again."""
    known = law.differing(inst, setting.friction, setting.stiffness)
    choices: dict[str, Any] = {key: getattr(setting, key) for key in ("observer", "law", "actuation")}
    random = np.random.default_rng(seed)
    twin, controller = Twin(inst, seed=seed), Controller(known, **choices)
    start, tip = np.zeros(3), 0.0
    left = seconds
    while left > 0:
        done = work(inst, random, min(CHUNK, left))
        left -= CHUNK
        # A chunk starts from rest at the end of the one before.
        eased = 0.5 * (1 - np.cos(np.pi * np.arange(1, 2001) / 2001))
        columns = [np.concatenate([a + (b[0] - a) * eased, b]) for a, b in zip(start, done, strict=True)]
        tissue = _tissue(random, tip)
        began = time.perf_counter()
        run = twin.run(columns[0], columns[1], sheath_bend=columns[2], contact=tissue, controller=controller)
        spent = time.perf_counter() - began
        start, tip = np.array([column[-1] for column in columns]), float(run["output_angle"][-1])
        failed = np.flatnonzero(run["operating_state"] == OperatingState.FAULT)
        faults: dict[bool, list[str]] = {True: [], False: []}
        if failed.size:
            row = int(failed[0])
            found = fault_names(int(run["faults"][row]))
            faults[all(confirmed(known, run, name, row) for name in found)].append("+".join(found))
            twin, controller = Twin(inst, seed=seed), Controller(known, **choices)
            start, tip = np.zeros(3), 0.0
        yield ChunkFaults(len(run), faults[True], faults[False], spent)


def confirmed(inst: Instrument, run: Run, fault: str, row: int) -> bool:
    """Return whether the true tensions confirm a fault at a row of a run."""
    limits = parameters(inst).limits[0]
    if fault not in ("tendon_slack", "over_tension"):
        # Both tendons are slack, which a broken tendon cannot be distinguished from.
        return fault == "tendon_break" and bool(run["tension"][row].max() < limits["tendon_slack"][0])
    threshold, persistence = limits[fault]
    tension = run["tension"][max(0, row - round(0.98 * persistence / TIME_STEP)) : row + 1]
    lasting = tension < 1.1 * threshold if fault == "tendon_slack" else tension > 0.99 * threshold
    return bool(lasting.all(0).any())


def trial(instrument: str, number: int, seed: int, seconds: float) -> dict[str, Any]:
    """Watch normal work for a time, s: simulated seconds, faults, and the computing time over the simulated one."""
    parts = list(watched(law.instrument(instrument), SETTINGS[number], seed, seconds))
    simulated = sum(part.ticks for part in parts) * TIME_STEP
    false, true = ([name for part in parts for name in getattr(part, f"{which}_faults")] for which in ("false", "true"))
    return {
        "simulated": simulated,
        "false": false,
        "true": true,
        "computing": sum(part.computing for part in parts),
        "slowest": max(part.computing / (part.ticks * TIME_STEP) for part in parts),
    }


def counted(rows: Rows, which: str) -> Counter[str]:
    return Counter(name for row in rows for name in row[which])


WATCHED = [
    Column("simulated, h", "simulated", lambda seconds: sum(seconds) / 3600, ".3f"),
    Column("false", lambda rows: counted(rows, "false").total(), form="d"),
    Column("which", lambda rows: law.counts(counted(rows, "false")), form=""),
    Column("a tendon slack or beyond its limit", lambda rows: law.counts(counted(rows, "true")), form=""),
]


def main() -> None:
    parser = law.arguments(__doc__)
    hours = float(os.environ.get("HOURS", HOURS))
    parser.add_argument("--hours", type=float, default=hours, help="simulated, over all instruments and controllers")
    options = parser.parse_args()
    pairs = [(inst, n) for inst in law.RATED for n in range(len(SETTINGS))]
    each = 3600 * options.hours / len(pairs)
    cases = [{"instrument": inst, "number": n, "seed": at, "seconds": each} for at, (inst, n) in enumerate(pairs)]
    rows = campaign.run(trial, cases, "normal work", results=options.results)
    labels = ("instrument", "law", "actuation", "friction assumed x", "stiffness x")

    def label(row: dict[str, Any]) -> tuple[str, ...]:
        one = SETTINGS[row["number"]]
        return row["instrument"], one.law, one.actuation, f"{one.friction:g}", f"{one.stiffness:.3g}"

    groups: dict[Any, Rows] = {label(row): Rows([row]) for row in rows}
    law.show(options, "faults", groups | {("all", "", "", "", ""): rows}, WATCHED, labels, unit="")
    simulated, false = rows["simulated"].sum(), counted(rows, "false").total()
    print(
        f"{simulated / 3600:.2f} simulated hours, {simulated / TIME_STEP / 1e6:.1f} M ticks, {false} false faults "
        f"({false / simulated * 3600:.3g} per hour; target 0)\n"
        f"  twin and controller over real time: mean {simulated / rows['computing'].sum():.0f}x   worst "
        f"{1 / rows['slowest'].max():.0f}x"
    )


if __name__ == "__main__":
    main()

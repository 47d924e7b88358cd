"""The controller on a family of plants that shares no code with the twin, each differing from what it assumes.

``run(cases)`` closes the loop of plants (plant.py) with controllers.

Peer: the same plants with motors that stand. Errors are distances of the tip from where the handle puts it without load
and friction.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import law
import numpy as np
from law import ASSUMED, OUTPUTS
from numpy.typing import NDArray
from peers.plant import PERIOD, Plant, Plants, plant_of

import tenodesis as tn
from tenodesis import _core
from tenodesis.control import Controller
from tenodesis.control.controller import LawName, fault_names
from tenodesis.instrument import Instrument
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, rms

Array = law.Array
Signal = NDArray[np.float32]

EASED, ONSET, LOADED, SECONDS, JUDGED = 1.2, 0.2, 1.5, 8.0, 2.0  # s; the estimate is judged from JUDGED on
LATER, LAST, AVERAGED = 3.0, 1.0, 0.1  # s
RATED = law.RATED | {"pulley wrist": 1.0}  # N
EXAMPLES = Path(__file__).parents[1] / "examples"


class Case(NamedTuple):
    """A plant at work, and what its controller knows of it."""

    plant: Plant
    known: Instrument | None
    """None: motors stand"""
    output: float
    """Where the handle is moved to, as the angle of the tip without load and friction, rad"""
    force: float = 0.0
    """At the tip from :data:`LOADED` on, N"""
    tremor: float = 0.0
    """Amplitude at the handle, rad"""
    rate: float = 7.0
    """Of the tremor, Hz"""
    seed: int = 0
    """Of the sensors' noise, and of the tremor's phase"""
    law: LawName = "robust"

    def handle(self, at: Array) -> Array:
        """Return the handle's angle over time, rad."""
        # The phase differs between seeds by the golden angle.
        trembling = self.tremor * np.sin(2 * np.pi * self.rate * at + 2.4 * self.seed)
        trembling *= np.clip((at - EASED) / ONSET, 0, 1)
        return self.plant.handle_angle(self.output) * law.eased(at, EASED) + trembling

    @property
    def kind(self) -> tuple[bool, int, int]:
        """What cases that run together have in common."""
        return self.plant.gears, self.plant.contacts, self.plant.substeps


class CaseResponse(NamedTuple):
    """What a case did, by tick; single precision, since only the memory counts."""

    time: Array
    tip: Signal
    error: Signal
    """Of the tip, rad"""
    estimate: Signal
    std: Signal
    force: Signal
    """At the tip by the observer, N, and its standard deviation"""
    force_std: Signal
    friction_scale: Signal
    touch: Signal
    """Force on the tissue, N"""
    tension: Signal
    """Higher of the two beside the spools, N"""
    read: Signal
    """Tensions beside the spools as read, N, shape (2, tick)"""
    faults: list[str]


def run(cases: Sequence[Case], seconds: float = SECONDS) -> list[CaseResponse]:
    """Run cases for a time, those that can together, each with its own controller stepped by the tick."""
    found: dict[int, CaseResponse] = {}
    kinds = dict.fromkeys(case.kind for case in cases)
    for kind in kinds:
        places = [n for n, case in enumerate(cases) if case.kind == kind]
        found.update(zip(places, _run_together([cases[n] for n in places], seconds), strict=True))
    return [found[n] for n in range(len(cases))]


def _run_together(cases: Sequence[Case], seconds: float) -> list[CaseResponse]:
    count = round(seconds / PERIOD)
    at = np.arange(1, count + 1) * PERIOD
    handle = np.stack([case.handle(at) for case in cases], 1)
    load = np.array([case.force for case in cases])
    plants = Plants([case.plant for case in cases], [case.seed for case in cases])
    controllers = {n: Controller(case.known, law=case.law) for n, case in enumerate(cases) if case.known is not None}
    controlled, requests = [*controllers], {n: int(one.take_request()) for n, one in controllers.items()}
    steps = {n: one.core.step for n, one in controllers.items()}
    wanted = [f"estimated_{what}{end}" for what in ("output_angle", "force") for end in ("", "_std")]
    wanted += ["friction_scale", *(f"commanded_spool_velocity.{side}" for side in ("agonist", "antagonist"))]
    columns = [_core.control_signals().index(name) for name in wanted]
    kept = np.full((11, count, len(cases)), np.nan, np.float32)
    faults = np.zeros(len(cases), int)
    command = np.zeros((2, len(cases)))
    for k in range(count):
        plants.step(handle[k], load if at[k] > LOADED else 0.0, command)
        readings = plants.read()
        if controlled:
            asked = requests if k == 0 else {}
            answers = [step((k + 1) * 500_000, asked.get(n, 0), readings[n : n + 1]) for n, step in steps.items()]
            outputs = np.concatenate([rows for rows, *_ in answers])[:, columns].T
            kept[2:7, k, controlled], command[:, controlled] = outputs[:5], outputs[5:]
            faults[controlled] |= [mask for *_, mask, _, _ in answers]
        kept[0, k], kept[1, k] = plants.tip, plants.tip - plants.target
        kept[7, k], kept[8, k], kept[9:, k] = plants.touch, plants.tension[0].max(0), readings[:, 1:3].T
    names = [list(fault_names(mask)) for mask in faults]
    return [CaseResponse(at, *kept[:9, :, n], kept[9:, :, n], names[n]) for n in range(len(cases))]


class PlantMismatch(NamedTuple):
    """A row of the table: what differs, and at which work."""

    words: str
    changes: Mapping[str, Any]
    """Of the plant, by the keys of :func:`plant_of`; the controller knows none of them"""
    stated: Mapping[str, float]
    """Values of the instrument's file, which the controller knows"""
    instrument: str = "scaled-up"
    states: tuple[float, ...] = OUTPUTS
    """deg"""
    load: float = 1.0
    """Of the rated one"""
    tremors: tuple[float, ...] = (0.0,)
    """deg"""
    depths: tuple[float, ...] = (0.0,)
    """Of the target in the tissue, deg; 0: there is none"""


def row(words: str, stated: Mapping[str, float] | None = None, **rest: Any) -> PlantMismatch:
    """Return a row; keys that are not a row's own are changes of the plant."""
    own = {key: value for key, value in rest.items() if key in PlantMismatch._fields}
    return PlantMismatch(words, {key: value for key, value in rest.items() if key not in own}, stated or {}, **own)


def coefficient(value: float) -> dict[str, float]:
    return {"friction.vertex_coefficient": value, "friction.sheath_coefficient": value}


BENT: dict[str, float] = {"friction.sheath_bend": np.radians(60)}
GAINS = (1.02, 0.98)
TISSUE = 1e4  # N/m
WRIST_STIFFNESS = 84e3  # N/m, at which 1 N takes 0.4 deg
TWO: dict[str, Any] = {"vertices": 2}
FRONT: dict[str, Any] = {"before_handle": 0.55}
BASE: dict[str, Any] = {"base": 0.03}
SOFT: dict[str, Any] = {"softer": 0.85}
ROWS = {
    "nothing": row("nothing"),
    "two": row("two vertices a joint", **TWO),
    "front": row("compliance 55 % before handle joint", **FRONT),
    "rough": row("coefficient 0.25, known", coefficient(0.25)),
    "four": row("two vertices, 0.25 known, base 0.03, 15 % softer", coefficient(0.25), **TWO, **BASE, **SOFT),
    "gains": row("load cell gains 1.02/0.98", cell_gain=GAINS),
    "wrist": row("wrist, pulleys of 3.2/6 mm, tip of 12 mm", instrument="pulley wrist"),
    "tremor": row("hand trembles 0.1/0.3° at 7 Hz, no load", states=(33.0, 67.0), load=0.0, tremors=(0.1, 0.3)),
    "still": row("a still hand at 67°, no load", states=(67.0,), load=0.0),
    "tissue": row("tissue of 10 N/mm, 5° into it", states=(33.0,), load=0.0, depths=(5.0,)),
    "tissue-deep": row("tissue of 10 N/mm, 12° into it", states=(33.0,), load=0.0, depths=(12.0,)),
    "rougher": row("coefficient 0.4, known", coefficient(0.4)),
    "base": row("base exponent 0.03 a joint", **BASE),
    "soft": row("15 % softer", **SOFT),
    "offsets": row("load cells off by +0.5/-0.5 N", cell_offset=(0.5, -0.5)),
    "encoder": row("handle encoder off by 0.2°", handle_offset=np.radians(0.2)),
    "calibration": row(
        "cells and handle encoder off by their standard deviations",
        cell_offset=(0.1, -0.1),
        cell_gain=(1.005, 0.995),
        handle_offset=np.radians(0.05),
    ),
    "smooth": row("no friction, but assumed", vertex=0.0, sheath=0.0),
    "assumed-none": row(
        "friction, but assumed to have none", coefficient(0.0), vertex=0.1, sheath=0.1 * np.radians(10)
    ),
    "hand": row("a hand of 5 N m/rad", hand_stiffness=5.0),
    "bent": row("sheath of 60°, known", BENT),
    "bent-two": row("sheath of 60°, known, two vertices", BENT, **TWO),
    "bent-front": row("sheath of 60°, known, compliance 55 %", BENT, **FRONT),
    "bent-rough": row("sheath of 60° and coefficient 0.25, known", BENT | coefficient(0.25)),
    "two-front": row("two vertices, compliance 55 %", **TWO, **FRONT),
    "two-gains": row("two vertices, gains", cell_gain=GAINS, **TWO),
    "rough-soft": row("0.25 known, 15 % softer", coefficient(0.25), **SOFT),
    "rough-gains": row("0.25 known, gains", coefficient(0.25), cell_gain=GAINS),
    "still-two": row("a still hand at 67°, no load, two vertices", states=(67.0,), load=0.0, **TWO),
    "real": row("nothing, real-size", instrument="real-size"),
    "real-two": row("two vertices, real-size", instrument="real-size", **TWO),
    "all": row(
        "all at once: two vertices, 55 %, 0.25 known, base, softer, gains",
        coefficient(0.25),
        cell_gain=GAINS,
        **TWO,
        **FRONT,
        **BASE,
        **SOFT,
    ),
}
"""Rows of the table by name."""


def instrument(name: str) -> Instrument:
    """Return an instrument of one axis, whose file has the true stiffness."""
    if name == "pulley wrist":
        return tn.load(EXAMPLES / "pulley.toml").replace(
            proximal_pulley_radius=6e-3,
            distal_pulley_radius=3.2e-3,
            end_effector_length=12e-3,
            tendon_stiffness=WRIST_STIFFNESS,
            friction={"law": "capstan", "sheath_bend": np.radians(10), **dict.fromkeys(law.COEFFICIENTS, 0.1)},
        )
    inst = law.instrument(name)
    return inst.replace(tendon_stiffness=inst.tendon_stiffness * inst.mismatch.stiffness_ratio, mismatch=None)


def cases_of(row: PlantMismatch, seeds: int = 1, drawn: bool = False, observe: str = "strokes") -> list[Case]:
    """Return a row's cases, those with motors first, and then the same with motors that stand.

    drawn: whether each plant's sensors have errors of calibration, drawn as the instrument's file states them;
    observe: as the controller's file has it.
    """
    inst = instrument(row.instrument).replace(**row.stated)
    plant, load = plant_of(inst, **row.changes), RATED[row.instrument] * row.load
    known = [inst.replace(**law.friction(inst, assumed), **{"control.observe": observe}) for assumed in ASSUMED]
    found: list[Case] = []
    for _, state, tremor, depth in product(range(seeds), row.states, row.tremors, row.depths):
        lane = with_tissue(plant, np.radians(state - depth)) if depth else plant
        for model in known:
            seed = len(found)
            own = with_calibration(lane, inst, seed) if drawn else lane
            found.append(Case(own, model, np.radians(state), load, np.radians(tremor), seed=seed))
    return found + [case._replace(known=None) for case in found]


def with_tissue(plant: Plant, angle: float) -> Plant:
    """Return a plant whose tip meets tissue at an output angle, damped a fifth of critically."""
    damping = 0.4 * np.sqrt(TISSUE * plant.inertia) / plant.tip_length
    return replace(plant, tissue_angle=angle, tissue_stiffness=TISSUE, tissue_damping=damping)


def with_calibration(plant: Plant, inst: Instrument, seed: int) -> Plant:
    """Return a plant whose cells and handle encoder have errors drawn from the deviations that the file states."""
    rng, sensors = np.random.default_rng(seed), inst.sensors
    gains = np.array(plant.cell_gain) * (1 + rng.normal(0, sensors.load_cell_gain_error, 2))
    offsets = np.array(plant.cell_offset) + rng.normal(0, sensors.load_cell_offset, 2)
    return replace(
        plant,
        cell_gain=(float(gains[0]), float(gains[1])),
        cell_offset=(float(offsets[0]), float(offsets[1])),
        handle_offset=plant.handle_offset + rng.normal(0, sensors.encoder_offset),
    )


def summary(cases: Sequence[Case], responses: Sequence[CaseResponse]) -> dict[str, Any]:
    """Summarise cases, the second half of which are with motors that stand (off).

    Final errors, deg, are means over the last second, the estimate's (estimate_rms) RMS over it, later_worst is the
    error :data:`LATER` s after the load; nees is the estimate's squared error over its variance, mean over time and
    cases, nees_worst that of the case with the largest; within_1 and within_03 are the times after the load until the
    mean error stays within 1° (the latest) and 0.3° (the median), s; swings are of the tip, deg peak to peak in the
    last second, and
    from :data:`LATER` s after the load on (swing_since); touch is the force on the tissue in the last second, N;
    scales are the friction's at the end, over the truth.
    """
    half = len(cases) // 2
    on, off = responses[:half], responses[half:]
    at = on[0].time
    last, judged = at > at[-1] - LAST, at > JUDGED
    later = np.abs(at - LOADED - LATER) < AVERAGED / 2

    def over(of: Iterable[CaseResponse], value: Callable[[CaseResponse], Any]) -> Array:
        return np.array([value(one) for one in of], float)

    def settled(within: float) -> Array:
        return over(on, lambda one: law.last_beyond(at, np.degrees(one.error), LOADED, within))

    final, standing = (np.degrees(over(of, lambda one: one.error[last].mean())) for of in (on, off))
    nees = over(on, lambda one: (((one.estimate - one.tip) / one.std)[judged].astype(float) ** 2).mean())
    missed = np.degrees(over(on, lambda one: rms((one.estimate - one.tip)[last].astype(float))))
    swing, swing_off = (np.degrees(over(of, lambda one: np.ptp(one.tip[last]))).max() for of in (on, off))
    touch, touch_off = (over(of, lambda one: one.touch[last].mean()).max() for of in (on, off))
    assumed = np.array([ASSUMED[n % len(ASSUMED)] for n in range(half)])
    scale = over(on, lambda one: one.friction_scale[-1]) * assumed
    return {
        "final_rms": rms(final),
        "final_worst": np.abs(final).max(),
        "off_rms": rms(standing),
        "off_worst": np.abs(standing).max(),
        "later_worst": np.abs(np.degrees(over(on, lambda one: one.error[later].mean()))).max(),
        "within_1": settled(1.0).max(),
        "within_03": np.median(settled(0.3)),
        "estimate_rms": rms(missed),
        "nees": nees.mean(),
        "nees_worst": nees.max(),
        "swing": swing,
        "swing_off": swing_off,
        "swing_since": np.degrees(over(on, lambda one: np.ptp(one.tip[at > LOADED + LATER]))).max(),
        "touch": touch,
        "touch_off": touch_off,
        "highest_tension": over(on, lambda one: one.tension.max()).max(),
        "least_scale": scale.min(),
        "most_scale": scale.max(),
        "faults": list(dict.fromkeys(name for one in on for name in one.faults)),
    }


def judge(
    row: str, seeds: int = 1, drawn: bool = False, observe: str = "strokes", seconds: float = SECONDS
) -> dict[str, Any]:
    """Run a row, all of its cases together, and summarise it."""
    cases = cases_of(ROWS[row], seeds, drawn, observe)
    return summary(cases, run(cases, seconds))


JUDGED_BY = [
    Column("final error RMS", "final_rms"),
    Column("final error worst", "final_worst"),
    Column("motors off RMS", "off_rms"),
    Column("motors off worst", "off_worst"),
    Column("3 s after the load worst", "later_worst"),
    Column("within 1° at last, s", "within_1"),
    Column("within 0.3° median, s", "within_03"),
    Column("estimate RMS", "estimate_rms", form=".3f"),
    Column("NEES, ", "nees", form=".1f"),
    Column("NEES worst, ", "nees_worst", form=".1f"),
    Column("swing", "swing"),
    Column("swing off", "swing_off"),
    Column("swing since", "swing_since"),
    Column("least friction scale, ", "least_scale"),
    Column("most friction scale, ", "most_scale"),
    Column("highest tension, N", "highest_tension", form=".0f"),
    Column("presses, N", "touch"),
    Column("presses off, N", "touch_off"),
    Column("faults", "faults", campaign.names, ""),
]


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--rows", nargs="+", choices=[*ROWS], metavar="ROW", help=f"of {', '.join(ROWS)}")
    parser.add_argument("--quick", action="store_true", help="the first three rows only")
    parser.add_argument("--seeds", type=int, default=1, help="of noise and the tremor's phase")
    parser.add_argument("--drawn", action="store_true", help="errors of calibration as the instrument's file states")
    parser.add_argument("--observe", choices=["strokes", "dither", "auto"], default="strokes")
    options = parser.parse_args()
    names = options.rows or list(ROWS)[: 3 if options.quick else None]
    cases = campaign.cases(row=names, seeds=[options.seeds], drawn=[options.drawn], observe=[options.observe])
    rows = campaign.run(judge, cases, "plants", results=options.results)
    groups = {ROWS[name].words: own for name, own in rows.by("row").items()}
    name = "_".join(["plants", *["drawn"] * options.drawn, *[options.observe] * (options.observe != "strokes")])
    law.show(options, name, groups, JUDGED_BY, "what differs")


if __name__ == "__main__":
    main()

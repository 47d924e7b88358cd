"""What the motors do when the world changes while they are wound: loads that alternate or go, stops, ropes, tissue.

Peers, of the same instrument, hand, load and friction: motors that stand at home (off), and motors with a tip sensor
that is never wrong (ideal). Of these the better has the smaller RMS. Errors are distances of the tip from where the
handle puts it without load and friction.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import law
import numpy as np
from law import RATED, eased

from tenodesis.control import Controller, OperatingState, Request
from tenodesis.control.controller import fault_names, homing_failure
from tenodesis.instrument import Instrument
from tenodesis.run import Run, concatenate
from tenodesis.simulate import FaultInjection, campaign
from tenodesis.simulate.campaign import Column, Rows
from tenodesis.twin import TIME_STEP, Twin

Array = law.Array

EASED, LOADED, STOPPED, GONE = 1.2, 1.5, 4.0, 5.0  # s
LONGER, NOTABLE, IN_TIME = 2.0, 2.0, 2.0
"""When a rope begins to get longer, s; the error of the tip, deg, after which so many s are time to name it."""
AFTER, MEAN = 5.0, 0.5  # s after a load has gone; over which an end is averaged
SEED = 1
ANGLES = (0.0, 33.0, 67.0)  # deg
SIDES = (-1.0, 1.0)


class Scenario(NamedTuple):
    """What happens in a run, and from when on it is judged."""

    seconds: float
    force: Array
    judged: float
    """s; the end is judged over the last :data:`MEAN`"""
    handle: Array | None = None
    """Instead of one that is eased to an angle, rad"""
    known: Mapping[str, Any] = {}
    """What the controller's file states otherwise"""
    homed: bool = True
    requests: Mapping[float, Request] = {}
    faults: tuple[FaultInjection, ...] = ()
    let_out: Array | float = 0.0
    tissue: Array | None = None
    """Angle, stiffness and damping at each step"""
    law_off: float = np.inf
    """When the law is switched off, s"""
    ideal: bool = False
    """Whether a tip sensor is run, too"""


def steps(seconds: float, rated: float, of: Callable[[Array], Any]) -> tuple[Array, Array]:
    """Return the times of a run, and a load as a share of the rated one."""
    time = law.clock(seconds)
    return time, np.asarray(rated * of(time), np.float64)


def alternating(inst: Instrument, angle: float, share: float, period: float) -> Scenario:
    """Steps of a load to and fro; judged once three reversals have passed."""
    _, force = steps(
        16, RATED[inst.name], lambda t: share * np.sign(np.sin(2 * np.pi * (t - LOADED) / period)) * (t > LOADED)
    )
    return Scenario(16, force, max(2.5, LOADED + 1.5 * period + 1e-9), ideal=True)


STOPS: dict[str, tuple[dict[float, Request], tuple[FaultInjection, ...]]] = {
    "stop": ({STOPPED: Request.DISABLE}, ()),
    "pause": ({STOPPED: Request.PAUSE}, ()),
    "NaN": ({}, (FaultInjection("tension.agonist", "set", float("nan"), start=STOPPED),)),
    "cell stuck": ({}, (FaultInjection("tension.agonist", "hold", start=STOPPED),)),
    "handle lost": ({}, (FaultInjection("handle_angle", "set", 9.0, start=STOPPED),)),
    "stop in mid-stroke": ({1.6: Request.DISABLE}, ()),
    "law off": ({}, ()),
}


def stopped(inst: Instrument, angle: float, side: float, by: str) -> Scenario:
    """Motors that are stopped while they are wound; then the load goes."""
    _, force = steps(GONE + AFTER + MEAN, side * RATED[inst.name], lambda t: (t > LOADED) & (t < GONE))
    requests, faults = STOPS[by]
    return Scenario(
        GONE + AFTER + MEAN,
        force,
        STOPPED,
        requests=requests,
        faults=faults,
        law_off=STOPPED if by == "law off" else np.inf,
    )


def rope(inst: Instrument, angle: float, side: float, longer: float, pretension: float) -> Scenario:
    """A rope that gets longer by so many mm in 4 s, or a pretension that is not the file's."""
    time, force = steps(12, side * RATED[inst.name], lambda t: t > LOADED)
    grown = np.outer(longer * 1e-3 * eased(time - LONGER, 4), [1, 0])
    return Scenario(12, force, 6.0, known={"pretension": inst.pretension * pretension}, let_out=grown)


def snapping(inst: Instrument, angle: float, side: float) -> Scenario:
    """A thread that is pulled with more and more force, and snaps."""
    _, force = steps(8, side * RATED[inst.name], lambda t: np.clip((t - 1.8) / 2, 0, 1) * (t < GONE))
    return Scenario(8, force, 1.8, ideal=True)


def tissue(inst: Instrument, angle: float, side: float, stiffness: float, period: float) -> Scenario:
    """Tissue (N/mm) that moves in by 10 deg beyond the tip, and out again."""
    time, force = steps(10, 0, np.zeros_like)
    beat = (time - 1.8) / period % 1
    way = np.where(beat < 0.5, eased(beat, 0.1), 1 - eased(beat - 0.5, 0.1)) * (time > 1.8)
    place = np.radians(angle + side * (20 - 30 * way))
    wall = np.stack([place, np.full(time.size, side * 1e3 * stiffness), np.full(time.size, 5.0 * stiffness)], 1)
    return Scenario(10, force, 2.5, tissue=wall, ideal=True)


def refused(inst: Instrument, angle: float, side: float, at: float, share: float) -> Scenario:
    """A load that comes while homing eases the tendons, so that it is refused, and that stays."""
    _, force = steps(GONE + AFTER + MEAN, side * share * RATED[inst.name], lambda t: t > at)
    return Scenario(GONE + AFTER + MEAN, force, at, homed=False, requests={TIME_STEP: Request.HOME})


SCENES: dict[str, Callable[..., Scenario]] = {
    one.__name__: one for one in (alternating, stopped, rope, snapping, tissue, refused)
}


def run(inst: Instrument, angle: float, scenario: Scenario, *, on: bool) -> Run:
    """Run a scenario with the law, or with motors that stand."""
    time = law.clock(scenario.seconds)
    handle = law.held(inst, angle, time, EASED)
    request = np.zeros(time.size, int)
    for at, asked in scenario.requests.items():
        request[round(at / TIME_STEP) - 1] = asked
    known = inst.replace(**scenario.known)
    controller = Controller(known, homed=scenario.homed, enabled=scenario.homed) if on else None
    given: dict[str, Any] = (
        {"controller": controller, "request": request, "fault_injection": scenario.faults} if on else {}
    )
    twin = law.MovingTissue(inst, scenario.tissue, SEED) if scenario.tissue is not None else Twin(inst, seed=SEED)
    if controller is None or scenario.law_off > scenario.seconds:
        return twin.run(handle, scenario.force, let_out=scenario.let_out, **given)
    at = round(scenario.law_off / TIME_STEP)
    first = twin.run(handle[:at], scenario.force[:at], controller=controller)
    controller.choose("off")
    return concatenate([first, twin.run(handle[at:], scenario.force[at:], controller=controller)])


def trial(scene: str, instrument: str, angle: float, **how: Any) -> dict[str, Any]:
    """Compare a scene with the law to its peers: errors, deg, from when it is judged on; speeds of the tip, deg/s."""
    inst = law.instrument(instrument)
    made = SCENES[scene](inst, angle, **how)
    runs = {"": run(inst, angle, made, on=True), "_off": run(inst, angle, made, on=False)}
    handle = runs["_off"]["handle_angle"]
    target = np.degrees(law.target(inst, handle))
    tips = {name: np.degrees(one["output_angle"]) for name, one in runs.items()}
    if made.ideal:
        tips["_ideal"] = np.degrees(
            law.tip_sensor(inst, SEED, handle, made.force, np.radians(target), tissue=made.tissue)
        )
    time = law.clock(made.seconds)
    judged, last = time > made.judged, time > made.seconds - MEAN
    row: dict[str, Any] = {}
    for name, tip in tips.items():
        error = tip - target
        row |= {f"rms{name}": campaign.rms(error[judged]), f"peak{name}": campaign.farthest(error[judged])}
        row[f"end{name}"] = float(np.abs(error[last]).mean())
        row[f"speed{name}"] = float(np.abs(np.gradient(tip, TIME_STEP))[judged].max())
    on = runs[""]
    estimated = np.degrees(on["estimated_output_angle"] - on["output_angle"])[judged]
    row["estimate"] = campaign.rms(np.nan_to_num(estimated, nan=99.0))
    faulty = np.flatnonzero(on["operating_state"] == OperatingState.FAULT)
    row["named"] = float(time[faulty[0]]) if faulty.size else np.nan
    row["names"] = list(fault_names(int(on["faults"][faulty[0]]))) if faulty.size else []
    notable = np.flatnonzero((time > LONGER) & (np.abs(tips[""] - target) > NOTABLE))
    unnamed = notable.size and not row["named"] <= time[notable[0]] + IN_TIME
    row["failure"] = homing_failure(int(on["homing_failure"][-1]))
    peers = [name for name in ("_off", "_ideal") if f"rms{name}" in row]
    better = min(peers, key=lambda name: row[f"rms{name}"])
    for what in ("rms", "peak"):
        row[f"more_{what}"] = row[what] - row[what + better]
        row[f"worse_{what}"] = row[what] - max(row[what + name] for name in peers)
    row["more_end"] = row["end"] - row["end_off"]
    row["more_unnamed"] = row["more_rms"] if unnamed else 0.0
    words = ", ".join(f"{key} {value}" for key, value in how.items())
    return row | {"words": f"{scene}, {instrument} at {angle:g}°, {words}: " + ",".join(row["names"])}


def peers(what: str, *others: str) -> list[Column]:
    """Return the columns of the mean of a metric with the law and with its peers, and its worst excess."""
    names = {"": "on", "_off": "off", "_ideal": "ideal"}
    columns = [Column(f"{what} {names[end]}", f"{what}{end}") for end in ("", *others)]
    return [*columns, Column(f"worst excess over the better: {what}", f"more_{what}", np.max, "+.2f")]


RUNS = Column("runs, ", len, form="d")
NAMES = Column("faults", "names", campaign.names, "")
SPEED = [
    Column(f"tip's speed {words}, °/s", f"speed{end}", np.max, ".0f") for words, end in (("on", ""), ("off", "_off"))
]
COMPARED = [RUNS, *peers("rms", "_off", "_ideal"), *peers("peak", "_off", "_ideal"), *SPEED, NAMES]
ENDED = [RUNS, *peers("end", "_off"), *peers("peak", "_off"), NAMES]
ROPES = [RUNS, *peers("rms", "_off"), Column("estimate off by", "estimate", np.max), NAMES]


class Report(NamedTuple):
    """Cases of a scene, how its rows are grouped, and its targets: a metric, and what it may be at most."""

    axes: Mapping[str, Any]
    by: tuple[str, ...]
    columns: list[Column]
    targets: Mapping[str, float]


LOADS = {"angle": ANGLES, "side": SIDES}
REPORTS: dict[str, Report] = {
    "alternating": Report(
        {"angle": law.OUTPUTS, "share": (0.25, 0.5, 0.75), "period": (0.4, 0.7, 1.0, 1.5, 2.5, 4.0)},
        ("angle",),
        COMPARED,
        {"more_rms": 0.5, "more_peak": 2.0},
    ),
    "stopped": Report(LOADS | {"by": [*STOPS]}, ("by",), ENDED, {"more_end": 1.0}),
    "rope": Report(
        {"angle": ANGLES, "side": (0.0, *SIDES)}
        | {"longer, pretension": ((0.2, 1.0), (0.4, 1.0), (0.0, 0.8), (0.0, 1.2))},
        ("longer", "pretension"),
        ROPES,
        {"more_unnamed": 1.0},
    ),
    "snapping": Report(LOADS, ("angle",), COMPARED, {"worse_rms": 0.1, "worse_peak": 1.0}),
    "tissue": Report(
        LOADS | {"stiffness": (0.1, 1.0, 10.0), "period": (0.5, 1.5)},
        ("stiffness",),
        COMPARED,
        {"worse_rms": 0.1, "worse_peak": 1.0},
    ),
    "refused": Report(
        {"angle": (0.0,), "side": SIDES, "share": (0.3, 1.0), "at": np.arange(0.4, 3.5, 0.3).round(1).tolist()},
        ("share",),
        [
            *ENDED,
            Column("homing", lambda rows: ", ".join(dict.fromkeys(filter(None, rows["failure"].tolist()))), form=""),
        ],
        {"more_end": 1.0},
    ),
}


def cases(scene: str, instruments: list[str]) -> list[dict[str, Any]]:
    """Return the cases of a scene; axes whose name is several, with a comma, vary together."""
    found = []
    for case in campaign.cases(scene=[scene], instrument=instruments, **REPORTS[scene].axes):
        for names in [key for key in case if ", " in key]:
            case |= dict(zip(names.split(", "), case.pop(names), strict=True))
        found.append(case)
    return found


def main() -> None:
    parser = law.arguments(__doc__, RATED)
    parser.add_argument("--scenes", nargs="+", choices=[*REPORTS], metavar="SCENE", help=f"of {', '.join(REPORTS)}")
    options = parser.parse_args()
    names = options.instrument or [*RATED]
    for scene in options.scenes or REPORTS:
        report = REPORTS[scene]
        rows = campaign.run(trial, cases(scene, names), scene, results=options.results)
        doc = (SCENES[scene].__doc__ or "").strip()
        print(f"{scene}: {doc}")
        groups: dict[Any, Rows] = rows.by("instrument", *report.by)
        law.show(options, f"changes_{scene}", groups, report.columns, ("instrument", *report.by))
        for metric, most in report.targets.items():
            print(
                campaign.verdict(
                    f"{metric.replace('more_', '')} beyond the better peer by {most:g}°", rows, metric, most
                )
            )


if __name__ == "__main__":
    main()

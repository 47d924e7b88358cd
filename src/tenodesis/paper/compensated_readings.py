"""Which reading of Fig. 12 does what Fig. 15 shows: eq. 22 as a set point or fed back, by one motor or by two."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tenodesis.control import LawName
from tenodesis.instrument import Instrument
from tenodesis.paper import compensated_run as bench
from tenodesis.paper.context import Context
from tenodesis.paper.step_load import AFTER, BEFORE
from tenodesis.report.content import Table, fixed
from tenodesis.statics import Actuation

_SLOW = 1e-4  # m/s
_RELEASED = 1.0  # N
_LATE = 1.0  # s
_CULMINATES = 0.1  # deg


class Reading(NamedTuple):
    """One way to read Fig. 12, by tendons as fast as the drives wind them or slow ones."""

    law: LawName
    actuation: Actuation
    slow: bool

    @property
    def key(self) -> str:
        """Name among the results."""
        law = "set_point" if self.law == "paper" else "feedback"
        return f"{law}.{self.actuation}.{'slow' if self.slow else 'fast'}"

    @property
    def name(self) -> str:
        """Name for reading."""
        law = "eq. 22 as set point" if self.law == "paper" else "pseudo-error fed back"
        motors = "one motor" if self.actuation == "agonist" else "both motors"
        return f"{law}, {motors}{', slow' if self.slow else ''}"


class Trace(NamedTuple):
    """What a reading does in one state."""

    outcome: bench.Outcome
    delay: float
    """s"""
    wound: float
    """By the agonist's motor until the tip follows, m."""
    released: float
    """How far the agonist's tension falls back from its peak, N."""


_READINGS = [
    Reading(law, actuation, slow)
    for slow in (False, True)
    for law in ("paper", "paper-feedback")
    for actuation in ("agonist", "differential")
]


def _told(traces: Sequence[Trace]) -> dict[str, bool]:
    """Return what the paper tells of its four traces, and whether a reading's do so."""
    straight, bent, far, farthest = traces
    return {
        "back at 0°": abs(straight.outcome.final) <= bench.NEAR,
        "culminating at 0° before it settles": straight.outcome.overshoot > straight.outcome.final + _CULMINATES,
        "the agonist let out again at 0°": straight.released > _RELEASED,
        "the tip at least a second behind the motor at 0°": straight.delay >= _LATE,
        "back at 33°": abs(bent.outcome.final) <= bench.NEAR,
        "farther above the wanted angle at 33° than at 0°": bent.outcome.overshoot
        > max(straight.outcome.overshoot, _CULMINATES),
        "poor at 67°": abs(far.outcome.final) > bench.NEAR,
        "poor at 80°": abs(farthest.outcome.final) > bench.NEAR,
    }


def readings(context: Context, inst: Instrument, states: Sequence[float], force: float) -> tuple[str, Table]:
    """Compute what every reading does in the four states; return what follows from it, and the table."""
    cases = [(reading, state) for reading in _READINGS for state in states]

    def work(case: tuple[Reading, float]) -> Trace:
        reading, state = case
        told = bench.known(inst)
        if reading.slow:
            told = told.replace(**{"control.tendon_speed": _SLOW})
        motion = bench.held(inst, state, force, BEFORE, 2 * AFTER if reading.slow else AFTER)
        run, paused = (
            bench.apply(inst, told, motion, reading.law, reading.actuation, paused=paused) for paused in (False, True)
        )
        agonist = run["tension"][motion.loaded :, 0]
        late, wound = bench.delay(run, paused, motion, inst.drives.spool_radius)
        return Trace(bench.outcome(run, motion), late, wound, float(agonist.max() - agonist[-1]))

    found = dict(zip(cases, bench.together(work, cases), strict=True))
    rows = [[_PAPER, "settled, mild overshoot", "settled, larger overshoot", "poor", "poor", "–"]]
    scores: dict[Reading, dict[str, bool]] = {}
    for reading in _READINGS:
        traces = [trace for state in states if (trace := found[reading, state]) is not None]
        if len(traces) < 4:
            continue
        scores[reading] = told = _told(traces)
        rows.append([reading.name, *(_cell(trace) for trace in traces), f"{sum(told.values())} of {len(told)}"])
        _add(context, reading, states, traces, told)
    table = Table(
        "Readings of Fig. 12: final tip error / highest after the load [°], both against eq. 18; delay of the tip "
        f"behind the motor [s]; stroke wound by then [mm]. Slow: tendons wound at {1e3 * _SLOW:g} mm/s at most",
        ["reading", *(f"{np.degrees(state):.4g}°" for state in states), "as the paper tells"],
        rows,
    )
    return _verdict(scores, found, states), table


_PAPER = "the paper’s traces, delays of a few seconds"


def _cell(trace: Trace) -> str:
    late = "does not follow" if np.isnan(trace.delay) else f"{trace.delay:.2f}&nbsp;s, {1e3 * trace.wound:.2f}&nbsp;mm"
    fault = ", fault" if trace.outcome.faulted else ""
    final, highest = (fixed(round(value, 1) + 0.0, 1) for value in (trace.outcome.final, trace.outcome.overshoot))
    return f"{final}&nbsp;/&nbsp;{highest}; {late}{fault}"


def _add(
    context: Context, reading: Reading, states: Sequence[float], traces: Sequence[Trace], told: dict[str, bool]
) -> None:
    key = f"compensated.readings.{reading.key}"
    context.add(
        f"{key}.agreement",
        sum(told.values()),
        "1",
        f"How many of {len(told)} things that the paper tells of Fig. 15 hold for {reading.name}",
    )
    for state, trace in zip(states, traces, strict=True):
        at = f"{np.degrees(state):.4g}"
        for name, value, unit, what in (
            ("final_error", trace.outcome.final, "deg", "Final tip error"),
            ("overshoot", trace.outcome.overshoot, "deg", "Highest tip error after the load"),
            ("delay", trace.delay, "s", "Time from the load until the tip follows the motor"),
        ):
            if np.isfinite(value):
                context.add(f"{key}.{name}_at_{at}deg", value, unit, f"{what}, {reading.name}, {at} deg")


def _verdict(
    scores: dict[Reading, dict[str, bool]], found: dict[tuple[Reading, float], Trace | None], states: Sequence[float]
) -> str:
    if not scores:
        return ""
    agreement = {reading: sum(told.values()) for reading, told in scores.items()}
    most = max(agreement.values())
    best = [reading for reading, count in agreement.items() if count == most]
    missing = {reading: [name for name, held in scores[reading].items() if not held] for reading in best}
    told = "; ".join(
        f"“{reading.name}”" + (f" (not: {', '.join(missing[reading])})" if missing[reading] else "") for reading in best
    )
    runaway = [
        reading.name for reading in scores if max(abs(t.outcome.final) for t in _traces(reading, found, states)) > 10
    ]
    half = _traces(_READINGS[0], found, states)[0]
    text = (
        f"<p>Of the {len(next(iter(scores.values())))} things that the paper tells of its traces, most hold, {most}, "
        f"for {told}. With one motor eq. 22 as a set point stays {fixed(-half.outcome.final, 1)}° short even at 0°"
    )
    if runaway:
        names = ", ".join(f"“{name}”" for name in runaway)
        text += (
            f"; {names} end more than 10° off: eq. 19 takes what the motors wind for load, so that the error fed back "
            "does not become smaller, and only the tension limit or the supervisor ends the winding"
        )
    late = [trace.delay for reading in best if reading.slow for trace in _traces(reading, found, states)]
    if late:
        text += (
            f". The drives of the file are fast; wound at {1e3 * _SLOW:g} mm/s, the stroke that friction swallows "
            f"makes the tip {min(late):.1f} to {max(late):.1f} s late; the paper tells of a few seconds"
        )
    return text + ".</p>"


def _traces(reading: Reading, found: dict[tuple[Reading, float], Trace | None], states: Sequence[float]) -> list[Trace]:
    return [trace for state in states if (trace := found[reading, state]) is not None]

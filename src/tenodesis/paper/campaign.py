"""The robust law over states, friction errors and noise seeds, and where its targets are met: the statistics table."""

from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import similarity, statics
from tenodesis.control.parameters import tension_limit
from tenodesis.instrument import Instrument
from tenodesis.paper import compensated_run as bench
from tenodesis.paper.compensated import FRICTION_ERRORS
from tenodesis.paper.context import Context
from tenodesis.report.content import Section, Table, fixed, named
from tenodesis.twin import TIME_STEP

Array = NDArray[np.float64]

TITLE = "The robust law over states, friction errors and seeds"
SEEDS = 20
"""Noise seeds of the step load."""
SEEDS_ELSEWHERE = 4
"""One seed in so many for the conditions beyond the step load itself."""
_BEFORE, _AFTER = 4.0, 10.0  # s
_SHARE_OF_SLACK = 0.9
_LOW_PRETENSION = 0.4
_BEND, _BENDING = np.pi / 2, 2.0  # rad, s


class Condition(NamedTuple):
    """What is varied: a plant, what its controller is told, and the load by state."""

    key: str
    name: str
    inst: Instrument
    load: Callable[[float], float]
    """N, by output angle, rad."""
    identified: bool = True
    """Whether the controller knows the tendons' true stiffness."""
    bend: tuple[float, float] = (0.0, 0.0)
    """Bend of the sheath beside its own before the load and two seconds after, rad."""
    bound: str = ""
    """What bounds it where targets are missed."""


class Trial(NamedTuple):
    """One run of the campaign."""

    state: float
    error: float
    """Of the friction that the controller was told."""
    outcome: bench.Outcome
    excursion: float
    """How much farther off than with the motors held from the load on, deg."""
    scale_error: float
    """Error of the friction found, as a share of the true one; NaN where there is none."""


class Figure(NamedTuple):
    """A figure of the campaign: what it is, its target and how it follows from the trials."""

    key: str
    heading: str
    unit: str
    told: str
    of: Callable[[Sequence[Trial]], float]
    target: Callable[[Instrument], float] | None
    decimals: int = 2


def _rms(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


FIGURES = (
    Figure(
        "final_error_rms",
        "final error, RMS [°]",
        "deg",
        "RMS of the final tip error against eq. 18",
        lambda trials: _rms([one.outcome.final for one in trials]),
        lambda _: 0.3,
    ),
    Figure(
        "final_error_worst",
        "worst [°]",
        "deg",
        "Largest final tip error against eq. 18",
        lambda trials: max(abs(one.outcome.final) for one in trials),
        lambda _: 0.7,
    ),
    Figure(
        "time",
        "time to within 1° [s]",
        "s",
        "Longest time from the load until the tip stays within 1 deg, none if it does not",
        lambda trials: max(one.outcome.settled for one in trials),
        lambda _: 3.0,
    ),
    Figure(
        "excursion",
        "excursion [°]",
        "deg",
        "How much farther off the tip goes than with the motors held from the load on, at most",
        lambda trials: max(one.excursion for one in trials),
        lambda _: 1.0,
    ),
    Figure(
        "tension",
        "highest tension [N]",
        "N",
        "Highest tension",
        lambda trials: max(one.outcome.highest for one in trials),
        tension_limit,
        1,
    ),
    Figure(
        "observer_error_rms",
        "observer at rest, RMS [°]",
        "deg",
        "RMS error of the observer at rest",
        lambda trials: _rms([one.outcome.observed for one in trials]),
        lambda _: 0.3,
    ),
    Figure(
        "friction_error",
        "friction scale, worst [%]",
        "%",
        "Largest error of the friction scale found",
        lambda trials: 100 * max(abs(one.scale_error) for one in trials),
        lambda _: 10.0,
        1,
    ),
    Figure(
        "rest",
        "motors at rest after [s]",
        "s",
        "Longest time from the load until the motors stand, none if they do not",
        lambda trials: max(one.outcome.rest for one in trials),
        None,
    ),
)


def conditions(context: Context) -> list[Condition]:
    """Return what the campaign goes through, the step load of Fig. 15 first."""
    inst = context.tested
    force = bench.load(inst)
    loose = inst.replace(pretension=_LOW_PRETENSION * inst.pretension)

    def same(_: float) -> float:
        return force

    found = [
        Condition("step_load", f"step load of {force:.3g} N", inst, same),
        Condition(
            "slack_limit",
            f"{_SHARE_OF_SLACK:g} of the load that slackens a tendon",
            inst,
            lambda state: _SHARE_OF_SLACK * float(statics.slack_force(inst, state)),
            bound="the tension limit leaves the drives little to stop in",
        ),
        Condition(
            "low_pretension",
            f"T<sub>o</sub> = {loose.pretension:g} N",
            loose,
            same,
            bound="the tip is back after two or three strokes, as short as the pretension is low, in which friction "
            "has hardly shown; the observer’s own deviation of the scale is 0.2 to 0.3 there",
        ),
        Condition(
            "bending",
            "sheath bent by 90° more within 2 s of the load",
            inst,
            same,
            bend=(0.0, _BEND),
            bound=_ONE_SCALE,
        ),
        Condition(
            "straightening",
            "sheath straightened by 90° within 2 s of the load",
            inst,
            same,
            bend=(_BEND, 0.0),
            bound=_ONE_SCALE,
        ),
        Condition(
            "nominal_stiffness",
            f"controller told the nominal stiffness, {inst.mismatch.stiffness_ratio:g} of it true",
            inst,
            same,
            identified=False,
            bound="the compliance is learned beside friction from the same strokes",
        ),
    ]
    if inst.mismatch.stiffness_ratio == 1:
        found.pop()
    if context.scaled is not None and inst.name != context.inst.name:
        real = context.inst if len(context.inst.axes) == 1 else context.inst.axis(context.inst.axes[0])
        factor = float(similarity.compare(real, inst).factors["force"])
        found.append(
            Condition(
                "instrument",
                f"{named(real)} under {force / factor:.2g} N, as by similarity",
                real,
                lambda _: force / factor,
                bound="with straight joints friction is the sheath’s alone, less than 2 % of the tension, and the few "
                "strokes that bring the tip back hardly tell it",
            )
        )
    return found


_ONE_SCALE = (
    "nobody tells the controller of the bend, and its one friction scale stands for the sheath and the joints alike; "
    "it is compared with that of the sheath as the file has it. A changed scale is found by the next strokes, "
    "and these come when a tendon slips or the tip is off: what the sheath changes after the motors have come to rest, "
    "nothing tells"
)


def trials(condition: Condition, seeds: int) -> list[Trial]:
    """Run a condition over its states, friction errors and so many seeds."""
    inst = condition.inst
    start, end = condition.bend
    time = np.arange(1, round((_BEFORE + _AFTER) / TIME_STEP) + 1) * TIME_STEP
    bend = start + (end - start) * np.clip((time - _BEFORE) / _BENDING, 0, 1)
    told = {error: bench.known(inst, 1 + error, condition.identified) for error in FRICTION_ERRORS}
    motions = {state: bench.held(inst, state, condition.load(state), _BEFORE, _AFTER) for state in bench.states(inst)}

    def work(case: tuple[float, float, int]) -> Trial:
        state, error, seed = case
        motion = motions[state]
        worked, stood = (
            bench.outcome(
                bench.apply(inst, told[error], motion, "robust", seed=seed, paused=paused, sheath_bend=bend), motion
            )
            for paused in (False, True)
        )
        found = worked.scale * (1 + error) - 1 if inst.friction.law != "none" else np.nan
        return Trial(state, error, worked, worked.farthest - stood.farthest, found)

    cases = list(product(motions, FRICTION_ERRORS, range(seeds)))
    return [one for one in bench.together(work, cases) if one is not None]


def section(context: Context, seeds: int = SEEDS) -> Section:
    """Compute the campaign with so many noise seeds, a quarter of them beyond the step load itself."""
    inst = context.tested
    if bench.refusal(inst) is not None or not seeds:
        why = f"{named(inst)} cannot be compensated" if seeds else "no noise seeds were asked for"
        return Section("campaign", TITLE, f"<p>Not run: {why}.</p>")
    few = max(1, seeds // SEEDS_ELSEWHERE)
    rows, missed, lost = [], [], []
    main: list[Trial] = []
    for n, condition in enumerate(conditions(context)):
        found = trials(condition, few if n else seeds)
        if not found:
            lost.append(condition.name)
            continue
        main = main or found
        cells = []
        failed = []
        for figure in FIGURES:
            value, met = _judge(figure, condition.inst, found)
            if np.isnan(value):
                cells.append(_shown(figure, value))
                continue
            context.add(
                f"campaign.{condition.key}.{figure.key}",
                value,
                figure.unit,
                f"{figure.told}, robust law, {_plain(condition.name)}",
            )
            cells.append(_shown(figure, value) + ("" if figure.target is None else " met" if met else " missed"))
            if not met:
                failed.append(f"{figure.heading.partition(' [')[0]} {_shown(figure, value)}")
        rows.append([f"{condition.name} ({len(found)} runs)", *cells])
        if failed:
            because = f": {condition.bound}" if condition.bound and context.is_paper else ""
            missed.append(f"<li>{condition.name} ({'; '.join(failed)}){because}.</li>")
    if not rows:
        text = f"<p>Not run: in none of the states does {named(inst)} hold the load.</p>"
        return Section("campaign", TITLE, text)
    tables = [
        Table(
            f"The robust law over {len(bench.states(inst))} states, the friction told wrong by −30 %, 0 and +30 %, and "
            f"{seeds} noise seeds ({few} in all rows but the first)",
            ["condition", *(_target(figure, inst) for figure in FIGURES)],
            rows,
        )
    ]
    tables.append(_by_state(main))
    return Section("campaign", TITLE, _text(main, missed, lost) + bench.caveat(inst), [], tables)


def _plain(text: str) -> str:
    return text.replace("<sub>o</sub>", "o")


def _shown(figure: Figure, value: float) -> str:
    return "never" if np.isinf(value) else fixed(value, figure.decimals)


def _judge(figure: Figure, inst: Instrument, found: Sequence[Trial]) -> tuple[float, bool]:
    value = figure.of(found)
    return value, figure.target is None or bool(value <= figure.target(inst))


def _target(figure: Figure, inst: Instrument) -> str:
    return figure.heading + ("" if figure.target is None else f", target {figure.target(inst):g}")


def _by_state(main: Sequence[Trial]) -> Table:
    rows = []
    for state, error in dict.fromkeys((one.state, one.error) for one in main):
        part = [one for one in main if (one.state, one.error) == (state, error)]
        told = f"{100 * error:+.0f} %".replace("-", "−") if error else "right"
        rows.append(
            [
                f"{np.degrees(state):.4g}°, {told}",
                *(_shown(figure, figure.of(part)) for figure in FIGURES),
                fixed(max(abs(one.outcome.before) for one in part)),
            ]
        )
    return Table(
        "The step load by state and the friction told",
        [
            "state, friction",
            *(figure.heading for figure in FIGURES),
            "error before the load, worst [°]",
        ],
        rows,
    )


def _text(main: Sequence[Trial], missed: Sequence[str], lost: Sequence[str]) -> str:
    text = (
        f"<p>Each run: handle to its angle, the load at {_BEFORE:g} s, {_AFTER:g} s under it, the controller at work "
        "from the start. Every run is made twice: with the motors at work, and paused from the load on, which is the "
        "load’s own drop; the excursion is how much farther from eq. 18 the tip goes in the first than in the second, "
        "to either side, negative if it stays nearer. The time is the last moment at which the tip is 1° off. The "
        "tension is the true one at the spools, its target the controller’s limit.</p>"
    )
    restless = sum(np.isinf(one.outcome.rest) for one in main)
    if restless:
        text += (
            f"<p>In {restless} of the {len(main)} runs of the first row the motors are at work in the last second "
            "still, or again: where a stroke ends, the tip is found to lie two dead bands off once more, or too little "
            "is known of it, and another stroke begins.</p>"
        )
    if lost:
        text += f"<p>Not run, since the joint does not hold the load: {'; '.join(lost)}.</p>"
    if not missed:
        return text + "<p>All targets are met.</p>"
    return text + f"<p>Targets missed, and what bounds them:</p><ul>{''.join(missed)}</ul>"

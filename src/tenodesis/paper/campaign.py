"""The campaign: statistics of the robust law over held states, friction errors and noise seeds, against its targets."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from tenodesis import similarity, statics
from tenodesis.control.parameters import tension_limit
from tenodesis.instrument import ShortForm
from tenodesis.paper import step_response
from tenodesis.paper.compensated_step import friction_errors, friction_label
from tenodesis.paper.context import Context, has_friction
from tenodesis.paper.step_load import step_force
from tenodesis.report.content import Section, Table, fixed, named
from tenodesis.run import Run
from tenodesis.simulate.campaign import Rows, farthest, rms
from tenodesis.twin import TIME_STEP

TITLE = "The robust law over states, friction errors and seeds"
SEED_DIVISOR = 4
"""Divisor of the number of seeds in the conditions beyond the step load."""
_BEFORE, _AFTER = 4.0, 10.0  # s
_SHARE_OF_SLACK = 0.9
_LOW_PRETENSION = 0.4
_BEND, _BENDING = np.pi / 2, 2.0  # rad, s
_ONE_SCALE = (
    "the controller does not measure the bend, and its one friction scale stands for the sheath and the joints alike; "
    "it is compared with the scale of the sheath in the file. A changed scale is found in the next strokes, and these "
    "come when a tendon slips or the tip is off: a change of the sheath after the motors have come to rest is not "
    "observable"
)


class Condition(NamedTuple):
    """A condition of the campaign: the plant, the model of its controller, and the load by state."""

    key: str
    name: str
    inst: ShortForm
    load: Callable[[float], float]
    """N, by output angle, rad."""
    identified: bool = True
    """Whether the controller has the tendons' true stiffness."""
    bend: tuple[float, float] = (0.0, 0.0)
    """Additional bend of the sheath before the load and two seconds after, rad."""
    limit: str = ""
    """The reason if targets are missed."""


class Metric(NamedTuple):
    """A statistic of the trials: its names, the column that it is of, and its target."""

    key: str
    heading: str
    unit: str
    description: str
    column: str
    statistic: Callable[[Any], float]
    target: float | Callable[[ShortForm], float] | None
    decimals: int = 2

    def of(self, rows: Rows) -> float:
        """Return the statistic of trials."""
        return float(self.statistic(rows[self.column]))

    def aim(self, inst: ShortForm) -> float | None:
        """Return the target of an instrument."""
        return self.target(inst) if callable(self.target) else self.target


METRICS = (
    Metric(
        "final_error_rms", "final error, RMS [°]", "deg", "RMS of the final tip error against eq. 18", "final", rms, 0.3
    ),
    Metric("final_error_worst", "worst [°]", "deg", "Largest final tip error against eq. 18", "final", farthest, 0.7),
    Metric(
        "time",
        "time to within 1° [s]",
        "s",
        "Longest time from the load until the tip stays within 1 deg, none if it does not stay",
        "settling_time",
        np.max,
        3.0,
    ),
    Metric(
        "excursion",
        "excursion [°]",
        "deg",
        "How much larger the largest error is than with the motors stopped when the load comes, at most",
        "excursion",
        np.max,
        1.0,
    ),
    Metric("tension", "highest tension [N]", "N", "Highest tension", "highest_tension", np.max, tension_limit, 1),
    Metric(
        "observer_error_rms",
        "observer at rest, RMS [°]",
        "deg",
        "RMS error of the observer at rest",
        "observer_error",
        rms,
        0.3,
    ),
    Metric(
        "friction_error",
        "friction scale, worst [%]",
        "%",
        "Largest error of the friction scale found",
        "scale_error",
        lambda errors: 100 * farthest(errors),
        10.0,
        1,
    ),
    Metric(
        "rest",
        "motors at rest after [s]",
        "s",
        "Longest time from the load until the motors stand, none if they still move",
        "rest_time",
        np.max,
        None,
    ),
)


def conditions(context: Context) -> list[Condition]:
    """Return the conditions of the campaign, the step load of Fig. 15 first."""
    inst = context.tested
    force = step_force(inst)
    loose = inst.replace(pretension=_LOW_PRETENSION * inst.pretension)

    def same(_: float) -> float:
        return force

    found = [
        Condition("step_load", f"step load of {force:.3g} N", inst, same),
        Condition(
            "slack_limit",
            f"{_SHARE_OF_SLACK:g} of the load that slackens a tendon, no force limit",
            inst.replace(**{"control.force_limit": 0.0}),
            lambda state: _SHARE_OF_SLACK * float(statics.slack_force(inst, state)),
            limit="the tension limit leaves the drives little room to stop",
        ),
        Condition(
            "low_pretension",
            f"T<sub>o</sub> = {loose.pretension:g} N",
            loose,
            same,
            limit="the tip is back after two or three strokes, which are short at a low pretension and show little of "
            "the friction; the observer’s own standard deviation of the scale is 0.2 to 0.3 there",
        ),
        Condition(
            "bending", "sheath bent by 90° more within 2 s of the load", inst, same, bend=(0.0, _BEND), limit=_ONE_SCALE
        ),
        Condition(
            "straightening",
            "sheath straightened by 90° within 2 s of the load",
            inst,
            same,
            bend=(_BEND, 0.0),
            limit=_ONE_SCALE,
        ),
        Condition(
            "nominal_stiffness",
            f"controller assumes the nominal stiffness, the true stiffness is {inst.mismatch.stiffness_ratio:g} of it",
            inst,
            same,
            identified=False,
            limit="the compliance is estimated together with friction from the same strokes",
        ),
    ]
    if inst.mismatch.stiffness_ratio == 1:
        found.pop()
    if context.is_own and not inst.friction.sheath_coefficient:
        found = [condition for condition in found if condition.bend == (0.0, 0.0)]
    if context.scaled is not None and inst.name != context.inst.name:
        real = context.inst.planar[0]
        factor = float(similarity.compare(real, inst).factors["force"])
        found.append(
            Condition(
                "instrument",
                f"{named(real)} under {force / factor:.2g} N, as by similarity",
                real,
                lambda _: force / factor,
                limit="with straight joints friction is the sheath’s alone, less than 2 % of the tension, and hardly "
                "observable in the few strokes that bring the tip back",
            )
        )
    return found


def trials(condition: Condition, seeds: int) -> Rows:
    """Run a condition over its states, friction errors and a number of noise seeds.

    A row has the response of the tip, the excursion, its largest error minus that with the motors stopped when the load
    comes, deg, and the error of the friction found, as a share of the true scale, NaN without friction.
    """
    inst = condition.inst
    start, end = condition.bend
    time = np.arange(1, round((_BEFORE + _AFTER) / TIME_STEP) + 1) * TIME_STEP
    bend = start + (end - start) * np.clip((time - _BEFORE) / _BENDING, 0, 1)

    def measure(run: Callable[..., Run], motion: step_response.HeldMotion, _: ShortForm) -> dict[str, float]:
        enabled, stopped = (step_response.response(run(paused=paused), motion) for paused in (False, True))
        return enabled._asdict() | {"excursion": enabled.largest - stopped.largest}

    found = step_response.held(
        inst,
        step_response.held_states(inst),
        {"robust": friction_errors(inst)},
        (_BEFORE, _AFTER),
        measure,
        load=condition.load,
        identified=condition.identified,
        seeds=range(seeds),
        sheath_bend=bend,
    )
    known = inst.friction.law != "none"
    return Rows(
        row | {"scale_error": row["friction_scale"] * (1 + row["error"]) - 1 if known else np.nan} for row in found
    )


def section(context: Context) -> Section:
    """Compute the campaign with the context's noise seeds, a quarter of them beyond the step load itself."""
    inst, seeds = context.tested, context.seeds
    if why := step_response.missing(inst, seeds=seeds):
        return Section.not_run("campaign", title(inst), why)
    few = max(1, seeds // SEED_DIVISOR)
    rows, missed, lost = [], [], []
    main = Rows()
    for n, condition in enumerate(conditions(context)):
        found = trials(condition, few if n else seeds)
        if not found:
            lost.append(condition.name)
            continue
        main = main or found
        row, failed = _row(context, condition, found)
        rows.append(row)
        if failed:
            because = f": {condition.limit}" if condition.limit and context.is_paper else ""
            missed.append(f"<li>{condition.name} ({'; '.join(failed)}){because}.</li>")
    if not rows:
        return Section.not_run("campaign", title(inst), f"in none of the states does {named(inst)} hold the load")
    varied = f"{len(step_response.held_states(inst))} states"
    if has_friction(inst):
        varied += ", errors of −30 %, 0 and +30 % in the friction that the controller assumes,"
    table = Table(
        f"The robust law over {varied} and {seeds} noise seeds ({few} in all rows but the first)",
        ["condition", *(_heading(context, metric) for metric in _metrics(inst))],
        rows,
    )
    text = _text(context, main, missed, lost)
    return Section("campaign", title(inst), text, [], [table, _by_state(inst, main)])


def title(inst: ShortForm) -> str:
    """Return the title of the section."""
    return TITLE if has_friction(inst) else "The robust law over states and seeds"


def _metrics(inst: ShortForm) -> tuple[Metric, ...]:
    """Return the statistics that an instrument has."""
    return tuple(metric for metric in METRICS if metric.key != "friction_error" or has_friction(inst))


def _heading(context: Context, metric: Metric) -> str:
    """Return the heading of a statistic, with its target where the instrument is the paper's."""
    target = None if context.is_own else metric.aim(context.tested)
    return metric.heading if target is None else f"{metric.heading}, target {target:g}"


def _row(context: Context, condition: Condition, found: Rows) -> tuple[list[str], list[str]]:
    """Return the cells of a condition, and the metrics that miss their targets."""
    cells, failed = [f"{condition.name} ({len(found)} runs)"], []
    for metric in _metrics(condition.inst):
        value = metric.of(found)
        shown = _shown(metric, value)
        if np.isnan(value):
            cells.append(shown)
            continue
        name = condition.name.replace("<sub>o</sub>", "o")
        key, about = f"campaign.{condition.key}.{metric.key}", f"{metric.description}, robust law, {name}"
        context.add(key, value, metric.unit, about)
        target = metric.aim(condition.inst)
        judged = target is not None and not context.is_own
        met = target is None or value <= target
        cells.append(shown + ("" if not judged else " met" if met else " missed"))
        if judged and not met:
            failed.append(f"{metric.heading.partition(' [')[0]} {shown}")
    return cells, failed


def _shown(metric: Metric, value: float) -> str:
    return "never" if np.isinf(value) else fixed(value, metric.decimals)


def _by_state(inst: ShortForm, main: Rows) -> Table:
    rows, metrics, rough = [], _metrics(inst), has_friction(inst)
    for (state, error), part in main.by("state", "error").items():
        rows.append(
            [
                f"{np.degrees(state):.4g}°" + (f", {friction_label(error)}" if rough else ""),
                *(_shown(metric, metric.of(part)) for metric in metrics),
                fixed(farthest(part["before"])),
            ]
        )
    return Table(
        "The step load by state" + (" and error of the assumed friction" if rough else ""),
        [
            "state, friction" if rough else "state",
            *(one.heading for one in metrics),
            "error before the load, worst [°]",
        ],
        rows,
    )


def _text(context: Context, main: Rows, missed: Sequence[str], lost: Sequence[str]) -> str:
    limit = (
        f"; the controller’s limit is {tension_limit(context.tested):.3g} N"
        if context.is_own
        else (", its target the controller’s limit")
    )
    text = (
        f"<p>Each run: handle to its angle, the load at {_BEFORE:g} s, {_AFTER:g} s under it, the controller enabled "
        "from the start. Every run is made twice: with the motors enabled, and with the motors stopped when the load "
        "comes, which shows the load’s own effect. The excursion is the largest error of the first run minus that of "
        "the second, negative if the first stays nearer to the unloaded angle. The time is the last moment at which "
        f"the tip is 1° off. The tension is the true tension at the spools{limit}.</p>"
    )
    moving = np.isinf(main["rest_time"]).sum()
    if moving:
        text += (
            f"<p>In {moving} of the {len(main)} runs of the first row the motors still move in the last second, or "
            "move again: at the end of a stroke the tip is found two dead bands off once more, or its estimate is too "
            "uncertain, and another stroke begins.</p>"
        )
    if lost:
        text += f"<p>Not run, since the joint does not hold the load: {'; '.join(lost)}.</p>"
    if context.is_own:
        return text
    if not missed:
        return text + "<p>All targets are met.</p>"
    return text + f"<p>Missed targets and the reasons:</p><ul>{''.join(missed)}</ul>"

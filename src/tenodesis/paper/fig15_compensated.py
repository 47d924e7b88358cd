"""Fig. 15 with compensation: the held instrument under a sudden load, by the paper's law and by the robust law.

For the paper's instruments also which reading of Fig. 12 agrees with Fig. 15: eq. 22 as a set point or fed back, by one
motor or by two.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tenodesis.control import LawName
from tenodesis.instrument import ShortForm
from tenodesis.paper import step_response
from tenodesis.paper.context import DRAWN, Context, has_friction
from tenodesis.paper.fig15_step_load import AFTER, BEFORE
from tenodesis.paper.step_response import NEAR, Motion, Response
from tenodesis.report import style
from tenodesis.report.content import Chart, Column, Plot, Section, Table, fixed, named
from tenodesis.run import Run
from tenodesis.simulate.campaign import Rows
from tenodesis.statics import Actuation

TITLE = "Compensation on the bench"
FRICTION_ERRORS = (-0.3, 0.0, 0.3)
"""Errors of the friction that the controller assumes, as shares of the true friction."""

_FROM, _UNTIL = BEFORE - 1, BEFORE + 6  # s
_LABELS: dict[LawName, str] = {
    "off": "no compensation",
    "paper": "eq. 22, both motors",
    "exact": "exact, both motors",
    "robust": "robust, both motors",
}
_DRAWN: dict[LawName, tuple[str, str, str]] = {
    "off": ("no compensation", style.MUTED, ":"),
    "paper": ("law “paper” (eq. 22), both motors", style.ANTAGONIST, "-"),
    "robust": ("robust law", style.AGONIST, "-"),
}
_SLOW = 1e-4  # m/s
_RELEASED = 1.0  # N
_LATE = 1.0  # s
_CULMINATES = 0.1  # deg


def friction_errors(inst: ShortForm) -> tuple[float, ...]:
    """Return the errors of the friction that an instrument's controller assumes; 0 alone where there is none."""
    return FRICTION_ERRORS if has_friction(inst) else (0.0,)


def friction_label(error: float) -> str:
    """Return the error of the friction that a controller assumes (a share) as tables name it."""
    return f"{100 * error:+.0f} %".replace("-", "−") if error else "right"


def section(context: Context) -> Section:
    """Compute the held states under the step load without compensation, by the paper's law and by the robust law."""
    inst = context.tested
    if not step_response.can_compensate(inst):
        return Section("compensated", TITLE, f"<p>Not run: {named(inst)} cannot be compensated.</p>")
    force = step_response.step_force(inst)
    states = step_response.held_states(inst)
    laws = {law: friction_errors(inst) if law == "robust" else (0.0,) for law in _LABELS}

    def measure(run: Callable[..., Run], motion: Motion, _: ShortForm) -> dict[str, Any]:
        done = run()
        return {"response": step_response.response(done, motion), "run": done[DRAWN]}

    rows = step_response.held(inst, states, laws, (BEFORE, AFTER), measure, load=force)
    cases = sum(map(len, laws.values()))
    held = {state: own for state, own in rows.by("state").items() if len(own) == cases}
    if not held:
        text = f"<p>Not run: in none of the states does {named(inst)} hold the load of {force:.3g} N.</p>"
        return Section("compensated", TITLE, text)
    tables: list[Table] = [_table(context, held)]
    text = (
        "<p>The handle is moved to the angle that without load and friction gives the desired output angle "
        "(eq. 18), with the controller enabled from the start, and held; the load comes at 10 s. Errors are against "
        "that output angle"
    )
    if has_friction(inst):
        text += (
            ", so that they include what friction takes before the load. The controller knows the tendons’ identified "
            "stiffness; the table says where it assumes a wrong friction, which the laws from theory without friction "
            "do not use"
        )
    text += ". Without a slack tendon the exact law with both motors is the law “paper” (eq. 22).</p>"
    if context.is_paper:
        more, table = readings(context, inst, [*held], force)
        text += more
        tables.append(table)
    return Section("compensated", TITLE, text, [_plot(context, held, force)], tables)


def _table(context: Context, held: dict[float, Rows]) -> Table:
    rows: dict[str, list[str]] = {}
    rough = has_friction(context.tested)
    for row in (row for own in held.values() for row in own):
        label, angle, law, error = _LABELS[row["law"]], f"{np.degrees(row['state']):.4g}", row["law"], row["error"]
        if rough and law == "robust":
            label = f"robust, friction {friction_label(error)}"
        final = context.add(
            f"compensated.{law}{f'.friction_{100 * error:+.0f}' if error else ''}.final_error_at_{angle}deg",
            row["response"].final,
            "deg",
            f"Tip error against eq. 18, 10 s after the step load, {label}, {angle} deg",
        )
        rows.setdefault(label, []).append(fixed(final) + (" (fault)" if row["response"].faulted else ""))
    return Table(
        "Tip error against the unloaded angle (eq. 18) after 10 s under the load [°], by state"
        + (", law and the friction that the controller assumes" if rough else " and law"),
        ["law", *(f"{np.degrees(state):.4g}°" for state in held)],
        [[label, *cells] for label, cells in rows.items()],
    )


def _plot(context: Context, held: dict[float, Rows], force: float) -> Plot:
    inst = context.tested
    chart = Chart(Figure(figsize=(2.5 * len(held) + 0.8, 4.8), layout="constrained"))
    axes = chart.figure.subplots(2, len(held), squeeze=False, sharex=True, sharey="row")
    for (tip, tension), (state, rows) in zip(axes.T, held.items(), strict=True):
        at = f"at {np.degrees(state):.4g} deg"
        runs = {row["law"]: row["run"] for row in rows if not row["error"]}
        time = chart.keep(f"time {at} [s]", runs["off"].time)
        shown = (time >= _FROM) & (time <= _UNTIL)
        for law, (_, color, line) in _DRAWN.items():
            run = runs[law]
            output = chart.keep(f"output_angle {law} {at} [deg]", np.degrees(run["output_angle"]))
            agonist = chart.keep(f"agonist {law} {at} [N]", run["measured_tension"][:, 0])
            tip.plot(time[shown], output[shown] - np.degrees(state), line, color=color, lw=1.3)
            tension.plot(time[shown], agonist[shown], line, color=color, lw=1.1)
        tip.axhline(0, color=style.INK, ls="--", lw=0.8)
        tip.set(title=f"{np.degrees(state):.4g}°")
        tension.set(xlabel="time [s]", xlim=(_FROM, _UNTIL))
    axes[0, 0].set_ylabel("off the unloaded angle [deg]")
    axes[1, 0].set_ylabel("agonist tension [N]")
    style.legend_outside(chart.figure, *_DRAWN.values())
    return chart.plot(
        context.file_name("fig15", "compensated" + "_step_load" * context.is_own),
        f"Output angle and agonist tension when {force:.3g} N at the tip are applied suddenly while the handle is "
        f"held, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N{context.figure_of('Fig. 15(a)–(d)')}. The same "
        "twin and seed three times; dashed: no error.",
    )


class Reading(NamedTuple):
    """A reading of Fig. 12, with the drives at their own speed or slow."""

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
        """Name in the text."""
        law = "eq. 22 as set point" if self.law == "paper" else "pseudo-error fed back"
        motors = "one motor" if self.actuation == "agonist" else "both motors"
        return f"{law}, {motors}{', slow' if self.slow else ''}"


class Trace(NamedTuple):
    """The response of a reading in a state."""

    response: Response
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


def _observations(traces: Sequence[Trace]) -> dict[str, bool]:
    """Return which of the paper's observations of its four traces hold for those of a reading."""
    at_0, at_33, at_67, at_80 = (trace.response for trace in traces)
    return {
        "back at 0°": abs(at_0.final) <= NEAR,
        "culminating at 0° before it settles": at_0.overshoot > at_0.final + _CULMINATES,
        "the agonist released again at 0°": traces[0].released > _RELEASED,
        "the tip at least a second behind the motor at 0°": traces[0].delay >= _LATE,
        "back at 33°": abs(at_33.final) <= NEAR,
        "farther above the desired angle at 33° than at 0°": at_33.overshoot > max(at_0.overshoot, _CULMINATES),
        "poor at 67°": abs(at_67.final) > NEAR,
        "poor at 80°": abs(at_80.final) > NEAR,
    }


def _trace(run: Callable[..., Run], motion: Motion, model: ShortForm) -> dict[str, Trace]:
    enabled, paused = run(), run(paused=True)
    agonist = enabled["tension"][motion.loaded :, 0]
    late, wound = step_response.tip_delay(enabled, paused, motion, model.drives.spool_radius)
    released = float(agonist.max() - agonist[-1])
    return {"trace": Trace(step_response.response(enabled, motion), late, wound, released)}


def readings(context: Context, inst: ShortForm, states: Sequence[float], force: float) -> tuple[str, Table]:
    """Compute the response of every reading in the four states; return the conclusions and the table."""
    traces: dict[Reading, list[Trace]] = {}
    for reading in _READINGS:
        model = inst.replace(**{"control.tendon_speed": _SLOW}) if reading.slow else inst
        times, laws = (BEFORE, 2 * AFTER if reading.slow else AFTER), {reading.law: (0.0,)}
        rows = step_response.held(
            model, states, laws, times, _trace, load=force, plant=inst, actuation=reading.actuation
        )
        traces[reading] = [row["trace"] for row in rows]
    observed = {reading: _observations(several) for reading, several in traces.items() if len(several) == 4}
    count = len(next(iter(observed.values()), ()))
    table = context.table(
        "Readings of Fig. 12: final tip error / highest after the load [°], both against eq. 18; delay of the tip "
        f"behind the motor [s]; stroke wound by then [mm]. Slow: tendons wound at {1e3 * _SLOW:g} mm/s at most",
        "reading",
        *(f"{np.degrees(state):.4g}°" for state in states),
        Column(
            "agrees with the paper",
            "compensated.readings.{reading.key}.agreement",
            "1",
            f"How many of the paper's {count} observations on Fig. 15 hold for {{reading.name}}",
            form=lambda value: f"{value:.0f} of {count}",
        ),
    )
    table.row(
        "the paper’s traces, delays of a few seconds",
        "settled, mild overshoot",
        "settled, larger overshoot",
        "poor",
        "poor",
        "–",
    )
    for reading, held in observed.items():
        cells = [_cell(trace) for trace in traces[reading]]
        table.row(reading.name, *cells, sum(held.values()), reading=reading)
        for state, trace in zip(states, traces[reading], strict=True):
            for name, value, unit, about in (
                ("final_error", trace.response.final, "deg", "Final tip error"),
                ("overshoot", trace.response.overshoot, "deg", "Highest tip error after the load"),
                ("delay", trace.delay, "s", "Time from the load until the tip follows the motor"),
            ):
                key = f"compensated.readings.{reading.key}.{name}_at_{np.degrees(state):.4g}deg"
                if np.isfinite(value):
                    context.add(key, value, unit, f"{about}, {reading.name}, {np.degrees(state):.4g} deg")
    return _verdict(observed, traces), table


def _cell(trace: Trace) -> str:
    late = "does not follow" if np.isnan(trace.delay) else f"{trace.delay:.2f}&nbsp;s, {1e3 * trace.wound:.2f}&nbsp;mm"
    fault = ", fault" if trace.response.faulted else ""
    return f"{fixed(trace.response.final, 1)}&nbsp;/&nbsp;{fixed(trace.response.overshoot, 1)}; {late}{fault}"


def _verdict(observed: dict[Reading, dict[str, bool]], traces: dict[Reading, list[Trace]]) -> str:
    if not observed:
        return ""
    agreement = {reading: sum(held.values()) for reading, held in observed.items()}
    most = max(agreement.values())
    best = [reading for reading, count in agreement.items() if count == most]
    missing = {reading: [name for name, holds in observed[reading].items() if not holds] for reading in best}
    names = "; ".join(
        f"“{reading.name}”" + (f" (not: {', '.join(missing[reading])})" if missing[reading] else "") for reading in best
    )
    short = -traces[_READINGS[0]][0].response.final
    text = (
        f"<p>Of the paper’s {len(next(iter(observed.values())))} observations on its traces, most hold, {most}, for "
        f"{names}. With one motor, eq. 22 as a set point stays {fixed(short, 1)}° short even at 0°"
    )
    runaway = [
        f"“{reading.name}”" for reading in observed if max(abs(trace.response.final) for trace in traces[reading]) > 10
    ]
    if runaway:
        text += (
            f"; {', '.join(runaway)} end more than 10° off: eq. 19 takes the length that the motors wind for load, so "
            "that the error fed back does not become smaller, and only the tension limit or the supervisor stops the "
            "motors"
        )
    late = [trace.delay for reading in best if reading.slow for trace in traces[reading]]
    if late:
        text += (
            f". The drives of the file are fast; at {1e3 * _SLOW:g} mm/s, the stroke lost to friction delays the tip "
            f"by {min(late):.1f} to {max(late):.1f} s; the paper reports a few seconds"
        )
    return text + ".</p>"

"""The held instrument under a sudden load with the controller enabled: what each law leaves (Fig. 15).

For the paper's instruments also which reading of Fig. 12 agrees with Fig. 15: eq. 22 as a set point or fed back, by one
motor or by two.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from tenodesis import control
from tenodesis.control import Controller, LawName
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.paper import step_response
from tenodesis.paper.context import DRAWN, Context, has_friction
from tenodesis.paper.step_load import AFTER, BEFORE, respond, step_force
from tenodesis.paper.step_response import NEAR, HeldMotion, StepResponse
from tenodesis.paper.subject import Load, Subject
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Plot, ResultColumn, Section, Table, fixed, named
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.statics import Actuation

TITLE = "Compensation on the bench"
FRICTION_ERRORS = (-0.3, 0.0, 0.3)
"""Errors of the friction that the controller assumes, as shares of the true friction."""
LABELS: dict[LawName, str] = {
    "off": "no compensation",
    "paper": "eq. 22, both motors",
    "exact": "exact, both motors",
    "robust": "robust, both motors",
}

_LASTS = 7.0
"""Time under the load on several joints, s."""
_JUDGED = 0.5
"""Time at the end over which errors are taken, s."""
_FROM, _UNTIL = BEFORE - 1, BEFORE + 6  # s
_DRAWN: dict[LawName, tuple[str, str, str]] = {
    "off": ("no compensation", style.MUTED, ":"),
    "paper": ("law “paper” (eq. 22), both motors", style.ANTAGONIST, "-"),
    "robust": ("robust law", style.AGONIST, "-"),
}
_SLOW = 1e-4  # m/s
_RELEASED = 1.0  # N
_LATE = 1.0  # s
_CULMINATES = 0.1  # deg


class Trial(NamedTuple):
    """What a law leaves of a step load on the joints that a controller serves."""

    case: str
    """State or load, in words"""
    key: str
    """The same among results"""
    law: LawName
    error: float
    """Of the friction that the controller assumes, as a share of the true friction"""
    time: Array
    """(n,), s"""
    angle: Array
    """(n, joints), deg: output angles of a planar instrument, errors of several joints"""
    aim: float
    """Where it is without load and friction, deg"""
    tension: Array
    """Agonist's, (n,), N; empty of several joints"""
    final: Array
    """Error at the end, (joints,), deg"""
    faults: str


def friction_errors(inst: ShortForm) -> tuple[float, ...]:
    """Return the errors of the friction that an instrument's controller assumes; 0 alone where there is none."""
    return FRICTION_ERRORS if has_friction(inst) else (0.0,)


def friction_label(error: float) -> str:
    """Return the error of the friction that a controller assumes (a share) as tables name it."""
    return f"{100 * error:+.0f} %".replace("-", "−") if error else "right"


def controller_of(inst: Instrument, law: str) -> Controller | None:
    """Return the controller of a law; None where the motors are off."""
    return Controller(inst, law="robust", enabled=True) if law == "robust" else None


def served(subject: Subject) -> dict[str, int]:
    """Return the places of the joints that a controller serves, by the name among results."""
    if subject.plane is not None:
        return {"": 0}
    bends = [subject.inst.tip_joints[pair.joint].bend for pair in control.pairs(subject.inst).values()]
    return {bend: subject.joints.index(bend) for bend in bends}


def section(context: Context) -> Section:
    """Compute the step loads without compensation, and by every law that serves the instrument."""
    subject = context.bench
    if (inst := subject.plane) is not None and (why := step_response.missing(inst)):
        return Section.not_run("compensated", TITLE, why)
    found = _over_loads(subject) if inst is None else _over_states(inst)
    if not found:
        return Section.not_run("compensated", TITLE, f"{named(subject.given)} holds the load in none of the states")
    tables: list[Table] = [_table(context, found)]
    if inst is None:
        robust = max(float(np.abs(trial.final).max()) for trial in found if trial.law == "robust")
        context.add("compensated.robust.worst", robust, "deg", "Largest final error of a compensated joint, robust law")
        others = ", ".join(name for name in subject.joints if name not in served(subject))
        text = (
            f"<p>As above, {subject.described(subject.states[-1])}, with the controller enabled on the joints that "
            f"have a pair of tendons of their own: {' and '.join(served(subject))}. It knows tensions, spool and "
            f"handle angles, not the tip.{f' Not compensated: {others}.' if others else ''}</p>"
        )
    else:
        text = (
            "<p>The handle is moved to the angle that without load and friction gives the desired output angle "
            "(eq. 18), with the controller enabled from the start, and held; the load comes at 10 s. Errors are "
            "against that output angle"
        )
        if has_friction(inst):
            text += (
                ", so that they include what friction takes before the load. The controller knows the tendons’ "
                "identified stiffness; the table says where it assumes a wrong friction, which the laws from theory "
                "without friction do not use"
            )
        text += ". Without a slack tendon the exact law with both motors is the law “paper” (eq. 22).</p>"
        if context.is_paper:
            held = {trial.case for trial in found}
            states = [state for state in step_response.held_states(inst) if _angle(state) in held]
            more, table = readings(context, inst, states, step_force(inst))
            text += more
            tables.append(table)
    return Section("compensated", TITLE, text, [_plot(context, found)], tables)


def _angle(state: float) -> str:
    return f"{np.degrees(state):.4g}°"


def _over_states(inst: ShortForm) -> list[Trial]:
    """Return every law in the held states under the step load, of the states that all laws hold."""
    laws = {law: friction_errors(inst) if law == "robust" else (0.0,) for law in LABELS}

    def measure(run: Callable[..., Run], motion: HeldMotion, _: ShortForm) -> dict[str, Any]:
        done = run()
        return {"response": step_response.response(done, motion), "run": done[DRAWN]}

    rows = step_response.held(inst, step_response.held_states(inst), laws, (BEFORE, AFTER), measure)
    return [
        Trial(
            _angle(state),
            f"_at_{np.degrees(state):.4g}deg",
            row["law"],
            row["error"],
            row["run"].time,
            np.degrees(row["run"].by_column("output_angle")),
            float(np.degrees(state)),
            row["run"]["measured_tension"][:, 0],
            np.array([row["response"].final]),
            "fault" if row["response"].faulted else "",
        )
        for state, own in rows.by("state").items()
        if len(own) == sum(map(len, laws.values()))
        for row in own
    ]


def _over_loads(subject: Subject) -> list[Trial]:
    """Return the robust law, and none, on the bent instrument under a force in every direction."""
    made_for, joints = control.compensated(subject.given), list(served(subject).values())

    def trial(load: Load, law: LawName) -> dict[str, Trial] | None:
        controller = controller_of(made_for, law)
        done = respond(subject, subject.states[-1], load, controller=controller, after=_LASTS)
        if done is None:
            return None
        run = done.shown
        off = np.degrees(subject.turned(run) - subject.angles(run.by_column("handle_angle")))[:, joints]
        final = off[-round(_JUDGED / np.diff(run.time[:2])[0]) :].mean(axis=0)
        faults = ", ".join(done.run.fault_times)
        time = run.time - run.time[0]
        return {"trial": Trial(load.text, f".{load.name}", law, 0.0, time, off, 0.0, np.empty(0), final, faults)}

    across = [load for load in subject.loads if load.wrench.any()]
    return [
        row["trial"] for row in campaign.run(trial, campaign.cases(load=across, law=("off", "robust")), on="threads")
    ]


def _table(context: Context, found: list[Trial]) -> Table:
    joints, rough = served(context.bench), context.bench.plane is not None and has_friction(context.bench.given)
    after = AFTER if context.bench.plane is not None else _LASTS
    rows: dict[str, list[str]] = {}
    for trial in found:
        label, wrong = LABELS[trial.law], f".friction_{100 * trial.error:+.0f}" if trial.error else ""
        if rough and trial.law == "robust":
            label = f"robust, friction {friction_label(trial.error)}"
        for joint, final in zip(joints, trial.final, strict=True):
            key = f"compensated.{trial.law}{wrong}.final_error{'.' * bool(joint)}{joint}{trial.key}"
            about = f"error against eq. 18, {after:g} s after the step load, {label}, {trial.case.replace('°', ' deg')}"
            context.add(key, final, "deg", f"{joint or 'Tip'} {about}")
            rows.setdefault(label, []).append(fixed(final) + (f" ({trial.faults})" if trial.faults else ""))
    cases = dict.fromkeys(trial.case for trial in found)
    return Table(
        f"Error against the unloaded angle (eq. 18) after {after:g} s under the load [°], by law"
        + (", and the friction that the controller assumes" if rough else ""),
        ["law", *(", ".join(filter(None, (joint, case))) for case in cases for joint in joints)],
        [[label, *cells] for label, cells in rows.items()],
    )


def _plot(context: Context, found: list[Trial]) -> Plot:
    inst, joints = context.bench.given, served(context.bench)
    planar = context.bench.plane is not None
    shown = [trial for trial in found if trial.law in _DRAWN and not trial.error]
    cases = list(dict.fromkeys(trial.case for trial in shown))
    size = (2.5 * len(cases) + 0.8, 4.8) if planar else (max(7.0, 2.8 * len(cases) + 0.4), 3.6)
    chart = Chart(Figure(figsize=size, layout="constrained"))
    axes = chart.figure.subplots(
        1 + planar, len(cases), squeeze=False, sharex=planar, sharey="row" if planar else False
    )
    colors = style.colors(len(joints) + 1)[1:]
    for trial in shown:
        column, (_, law_color, line) = axes[:, cases.index(trial.case)], _DRAWN[trial.law]
        at, where = trial.case.replace("°", " deg"), f"{trial.key.removeprefix('.')}, {trial.law}"
        time = chart.keep(f"time at {at} [s]" if planar else f"time, {where} [s]", trial.time)
        within = (time >= _FROM) & (time <= _UNTIL) if planar else slice(None)
        for joint, color, angle in zip(joints, [law_color] if planar else colors, trial.angle.T, strict=True):
            heading = f"output_angle {trial.law} at {at} [deg]" if planar else f"error of {joint}, {where} [deg]"
            kept = chart.keep(heading, angle) - trial.aim
            column[0].plot(time[within], kept[within], line, color=color, lw=1.3)
        if planar:
            kept = chart.keep(f"agonist {trial.law} at {at} [N]", trial.tension)
            column[1].plot(time[within], kept[within], line, color=law_color, lw=1.1)
        column[0].axhline(0, color=style.INK, ls="--", lw=0.8)
        column[0].set(title=trial.case)
        column[-1].set(xlabel="time [s]", xlim=(_FROM, _UNTIL) if planar else (time[0], time[-1]))
    axes[0, 0].set_ylabel("off the unloaded angle [deg]")
    axes[-1, 0].set_ylabel("agonist tension [N]") if planar else None
    lines = [(joint, color, "-") for joint, color in zip(joints, colors, strict=True) if joint]
    laws = [one if planar else (one[0], style.MUTED, one[2]) for one in _DRAWN.values() if planar or "22" not in one[0]]
    style.legend_outside(chart.figure, *lines, *laws)
    about = (
        f"Output angle and agonist tension when {step_force(context.tested):.3g} N at the tip are applied suddenly "
        f"while the handle is held, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N"
        f"{context.figure_of('Fig. 15(a)–(d)')}. The same twin and seed three times; dashed: no error."
        if planar
        else f"Error of the compensated joints when a load comes, {named(inst)}."
    )
    name = context.file_name("fig15", "compensated" + "_step_load" * context.is_own) if planar else "compensated"
    return chart.plot(name, about)


class StepReading(NamedTuple):
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


class StepTrace(NamedTuple):
    """The response of a reading in a state."""

    response: StepResponse
    delay: float
    """s"""
    wound: float
    """By the agonist's motor until the tip follows, m."""
    released: float
    """How far the agonist's tension falls back from its peak, N."""


_READINGS = [
    StepReading(law, actuation, slow)
    for slow in (False, True)
    for law in ("paper", "paper-feedback")
    for actuation in ("agonist", "differential")
]


def _observations(traces: Sequence[StepTrace]) -> dict[str, bool]:
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


def _trace(run: Callable[..., Run], motion: HeldMotion, model: ShortForm) -> dict[str, StepTrace]:
    enabled, paused = run(), run(paused=True)
    agonist = enabled["tension"][motion.loaded :, 0]
    late, wound = step_response.tip_delay(enabled, paused, motion, model.drives.spool_radius)
    released = float(agonist.max() - agonist[-1])
    return {"trace": StepTrace(step_response.response(enabled, motion), late, wound, released)}


def readings(context: Context, inst: ShortForm, states: Sequence[float], force: float) -> tuple[str, Table]:
    """Compute the response of every reading in the four states; return the conclusions and the table."""
    traces: dict[StepReading, list[StepTrace]] = {}
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
        ResultColumn(
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


def _cell(trace: StepTrace) -> str:
    late = "does not follow" if np.isnan(trace.delay) else f"{trace.delay:.2f}&nbsp;s, {1e3 * trace.wound:.2f}&nbsp;mm"
    fault = ", fault" if trace.response.faulted else ""
    return f"{fixed(trace.response.final, 1)}&nbsp;/&nbsp;{fixed(trace.response.overshoot, 1)}; {late}{fault}"


def _verdict(observed: dict[StepReading, dict[str, bool]], traces: dict[StepReading, list[StepTrace]]) -> str:
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

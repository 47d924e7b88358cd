"""Hysteresis: every joint of the handle, or the motors, there and back on the twin, and what follows (Fig. 14).

Of a planar instrument also eq. 19's estimate from the tensions that are measured there.
"""

from typing import Any, NamedTuple

import numpy as np

from tenodesis import simulate, statics
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.magnitude import rms_of_finite
from tenodesis.paper import published
from tenodesis.paper.context import DRAWN, WAYS, Context, RecordedRun, has_friction
from tenodesis.paper.subject import HANDLE_SPEED, SPEED, FarMotion, Load, Subject, panels
from tenodesis.report import style
from tenodesis.report.content import (
    Array,
    Plot,
    ResultColumn,
    ResultTable,
    Section,
    Table,
    fixed,
    named,
    number,
    unit_text,
)
from tenodesis.report.curves import Loop, estimated_output_angle, hysteresis, loop_panels
from tenodesis.run import Run
from tenodesis.units import unit_of

LOADING, RESTING = 1.0, 0.5
"""Time in which the load comes, and rest under it, s."""
SEED = 14


class CycleRun(NamedTuple):
    """The cycles of a motion under a load, or none: signals from the first way out on, and what the last shows."""

    motion: FarMotion
    load: Load | None
    recorded: RecordedRun
    run: Run
    behind: float
    """How far the joint that follows stays behind theory on the way out, mean over the last cycle, rad"""
    ahead: float
    """How far it is ahead of theory on the way back, rad"""
    beside: float
    """Largest deviation of another joint from theory, rad"""
    tensions: Array
    """By how much the tendons' tensions are higher on the way out than on the way back, (tendons,), N"""
    estimate: Array
    """Of a planar instrument, eq. 19's output angle, (n,), rad; empty of others"""
    error: float
    """Root mean square error of the estimate against the distal encoder, rad"""
    estimated_width: float
    """Width of the estimate's loop, mean over the last cycle, rad"""

    @property
    def words(self) -> str:
        """The load in words."""
        return "no load" if self.load is None else self.load.text


def protocol(subject: Subject, motion: FarMotion, load: Load | None) -> simulate.Protocol:
    """Return the protocol of cycles of a motion under a load, or none."""
    words = "no load" if load is None else load.text
    return simulate.Protocol(
        name=f"cycles at {words}" if subject.plane else f"cycles of {motion.name}"[:60],
        description=f"There and back, {words}",
        phases=[*loading(load), *subject.there_and_back(motion)],
    )


def loading(load: Load | None) -> list[simulate.AnyPhase]:
    """Return the phases in which a load comes, or the same time without one."""
    if load is None:
        return [simulate.Hold(duration=LOADING + RESTING)]
    return [simulate.Ramp(duration=LOADING, **load.keys()), simulate.Hold(duration=RESTING)]


def cycle(subject: Subject, motion: FarMotion, load: Load | None) -> CycleRun | None:
    """Run cycles of a motion under a load, or none, on the twin; None if the joints cannot hold it."""
    recorded = RecordedRun.of(subject.given, protocol(subject, motion, load), SEED)
    if recorded is None:
        return None
    run = recorded.run.rows(int(np.searchsorted(recorded.run.time, LOADING + RESTING, "right")))
    # Both halves of the last cycle are compared where the handle, or the motors, are at the same share of their way.
    moved = subject.share(motion, run)
    first = len(run) - len(run) // subject.cycles
    top = first + int(np.argmax(moved[first:]))
    halves = slice(first, top), slice(len(run) - 1, top, -1)

    def compared(values: Array) -> tuple[Array, Array]:
        """Return columns (n, columns) on the way out and on the way back, (shares, columns) each."""
        out, back = (np.array([np.interp(WAYS, moved[half], one[half]) for one in values.T]).T for half in halves)
        return out, back

    theory, follows = subject.way(motion, WAYS, load), motion.follows
    out, back = (angles - theory for angles in compared(subject.turned(run)))
    sign = float(np.sign(motion.angles[-1] - motion.angles[0])[follows])
    last = run.rows(first, None, DRAWN.step)
    off = subject.turned(last) - subject.target(last, load)
    higher = np.subtract(*compared(run["tension"])).mean(axis=0)
    estimate, error, width = np.empty(0), np.nan, np.nan
    if subject.plane is not None:
        estimate = estimated_output_angle(subject.plane, run)
        error = rms_of_finite(estimate - run["measured_output_angle"])
        width = -_mean(np.subtract(*compared(estimate[:, np.newaxis])))
    return CycleRun(
        motion,
        load,
        recorded,
        run,
        -sign * _mean(out[:, follows]),
        sign * _mean(back[:, follows]),
        float(np.abs(np.delete(off, follows, axis=1)).max(initial=0.0)),
        higher,
        estimate,
        error,
        width,
    )


def _mean(values: Array) -> float:
    """Return the mean of the values that are not NaN; NaN if all are."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else float("nan")


def section(context: Context) -> Section:
    """Compute the cycles of every motion under its loads."""
    subject = context.bench
    title = "Flexion and extension" + " with friction" * has_friction(subject.given)
    pairs = [(motion, load) for motion in subject.motions for load in subject.loads_of(motion)]
    found = [done for done in (cycle(subject, *pair) for pair in pairs) if done is not None]
    if not found:
        return Section.not_run("hysteresis", title, f"{named(subject.given)} holds no load while it moves")
    for done in found:
        name = "_".join(filter(None, ("cycles" * context.is_own, done.motion.name, done.load and done.load.short)))
        context.recordings[context.file_name("fig14", name)] = done.recorded
    text = _text(context, subject)
    if subject.plane is not None:
        plots = [_estimates(context, subject.plane, found), _tensions(context, subject.plane, found)]
    else:
        plots = [_angles(subject, found)]
        widest = max(abs(float(np.degrees(done.behind + done.ahead))) for done in found)
        context.add("hysteresis.widest", widest, "deg", "Largest mean width of a joint's loop on the twin")
        text += f"<p>The widest loop has {fixed(widest)}°.</p>"
    return Section("hysteresis", title, text, plots, [_table(context, subject, found), *_parameters(subject.given)])


def _table(context: Context, subject: Subject, found: list[CycleRun]) -> ResultTable:
    planar, several, papers = subject.plane is not None, subject.plane is None, int(context.is_paper)
    who, where = ("tip", "{words}") if planar else ("joint", "{motion}, {words}")

    def column(heading: str, name: str, about: str, unit: str = "deg") -> ResultColumn:
        key = f"hysteresis.{'{motion}.' * several}{name}.{{load}}"
        return ResultColumn(heading, key, unit, f"{about}, {where}")

    agonist, antagonist = "Agonist tension, flexion minus extension", "Antagonist tension, extension minus flexion"
    of_tensions = [
        column("estimate's loop [°]", "estimated_width", "Width of the estimate's loop"),
        column("agonist higher at flexion [N]", "agonist_at_flexion", agonist, "N"),
        column("antagonist higher at extension [N]", "antagonist_at_extension", antagonist, "N"),
    ]
    more = (
        "error of the estimate from the tensions (eq. 19) against the distal encoder; difference of the tensions"
        if planar
        else "neighbours: largest deviation of another joint from theory"
    )
    table = context.table(
        "Means over the last cycle: how far what follows stays behind theory at flexion and is ahead of it at "
        f"extension, and widths of loops; {more}",
        *["motion"] * several,
        "load",
        *["follows"] * several,
        *[column("rms error [°]", "estimation_error", "RMS error of eq. 19's estimate on the twin")] * planar,
        *["published [°]"] * papers,
        column("behind at flexion [°]", "shift_at_flexion", f"How far the {who} stays behind theory at flexion"),
        column("ahead at extension [°]", "shift_at_extension", f"How far the {who} runs ahead at extension"),
        "loop [°]" if planar else column("loop [°]", "width", "Width of the joint's loop"),
        *of_tensions * planar,
        *[column("neighbours [°]", "neighbours", "Largest deviation of another joint from theory")] * several,
    )
    for done in found:
        printed = published.ESTIMATION_ERRORS.get(round(done.load.size, 6)) if papers and done.load else None
        behind, ahead, beside = np.degrees([done.behind, done.ahead, done.beside])
        table.row(
            *[done.motion.name] * several,
            done.words,
            *[subject.joints[done.motion.follows]] * several,
            *[(float(np.degrees(done.error)), printed)] * planar,
            *["–" if printed is None else fixed(printed.value)] * papers,
            *(behind, ahead, behind + ahead),
            *[float(np.degrees(done.estimated_width)), done.tensions[0], -done.tensions[-1]] * planar,
            *[beside] * several,
            motion=done.motion.name,
            load="unloaded" if done.load is None else done.load.name,
            words=done.words,
        )
    return table


def _parameters(inst: Instrument) -> list[Table]:
    """Return the table of the file's friction, mismatch and dynamics, with sources; empty if the file has none."""
    rows = []
    for name in ("friction", "mismatch", "dynamics"):
        table: Any = inst.__dict__.get(name)
        for field_name, field in () if table is None else type(table).model_fields.items():
            if field_name not in table.model_fields_set:
                continue
            value, unit = getattr(table, field_name), unit_of(field)
            if unit == "rad":
                text = f"{fixed(float(np.degrees(value)), 1)}°"
            elif isinstance(value, float):
                text = " ".join([number(value), *([unit_text(unit)] if unit else [])])
            else:
                text = str(value)
            source = inst.sources.get(f"{name}.{field_name}", inst.sources.get(name, ""))
            rows.append([f"{name}: {field_name.replace('_', ' ')}", text, source])
    table = Table("Parameters of the twin besides the dimensions", ["key", "value", "source"], rows)
    return [table] if rows else []


def _text(context: Context, subject: Subject) -> str:
    inst = subject.given
    if not has_friction(inst):
        return (
            "<p>The instrument file has no friction, so the twin's loops are closed but for the lag of moving joints "
            "and its sensors' noise; a <code>[friction]</code> table opens them.</p>"
        )
    moved = "Each joint of the handle" if subject.motions[0].handle.any() else "The motors for each joint"
    text = (
        "<p>The twin takes the place of the test bench: elastic tendons with capstan friction, drives, and sensors "
        "with noise and 12 bits. Friction holds the tip back at flexion and forward at extension, and shifts the "
        "tensions that the load cells measure"
        + (
            "; the estimate from the tensions (eq. 19) reads both as load"
            if subject.plane is not None
            else f". {moved} in turn goes to the far end of its motion and back, {subject.cycles} times, such that the "
            f"joint that follows turns by about {np.degrees(SPEED):.0f}°/s"
        )
        + ". The runs are recorded, in <code>recordings/</code>.</p>"
    )
    if context.is_paper and subject.plane is not None:
        offset = fixed(float(np.degrees(subject.plane.mismatch.output_encoder_offset)), 1)
        text += (
            f"<p>The ratio of true to nominal tendon stiffness ({subject.plane.mismatch.stiffness_ratio:g}) and the "
            f"distal encoder's offset ({offset}°) were fitted to the three published errors; the friction coefficient "
            f"({inst.friction.vertex_coefficient:g}) was chosen so that the paper's other observations hold as well: "
            "more shift at flexion, a higher agonist tension there and a higher antagonist tension at extension, an "
            "estimate whose loop is wider than the measured loop, and a tip that gives way in all four states of Fig. "
            "15. Other coefficients fit the three errors equally well; see the instrument file.</p>"
        )
    return text


def _loops(found: list[CycleRun]) -> list[Loop]:
    return [Loop(done.words, done.run[DRAWN], done.estimate[DRAWN]) for done in found]


def _estimates(context: Context, inst: ShortForm, found: list[CycleRun]) -> Plot:
    return hysteresis(inst, _loops(found), "twin, measured").plot(
        context.file_name("fig14a", "cycles"),
        f"Input and output over flexion and extension, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N, "
        f"{inst.conditions.cycles or 2} cycles at {np.degrees(HANDLE_SPEED):.0f}°/s{context.figure_of('Fig. 14(a)')}. "
        "Dotted: no load; dashed: theory.",
    )


def _tensions(context: Context, inst: ShortForm, found: list[CycleRun]) -> Plot:
    chart, axes = loop_panels(_loops(found), "tension [N]")
    grid = np.linspace(0, statics.reach(inst), 101)
    sides = (("agonist", style.AGONIST), ("antagonist", style.ANTAGONIST))
    for axis, done in zip(axes, found, strict=True):
        run = done.run[DRAWN]
        handle = chart.keep(f"handle_angle at {done.words} [deg]", np.degrees(run["measured_handle_angle"]))
        axis.axhline(inst.pretension, color=style.MUTED, ls=":", lw=1.3)
        theory = statics.tensions(inst, grid, done.load.size if done.load else 0.0)
        for (side, color), measured, expected in zip(sides, run["measured_tension"].T, theory, strict=True):
            chart.curve(axis, handle, f"{side} at {done.words} [N]", measured, color=color, lw=0.9)
            axis.plot(np.degrees(grid), expected, "--", color=color, lw=1.3)
    lines = [(side, color, "-") for side, color in sides]
    style.legend_outside(chart.figure, *lines, ("pretension", style.MUTED, ":"), ("theory", style.INK, "--"))
    return chart.plot(
        context.file_name("fig14b", "cycles_" * context.is_own + "tensions"),
        f"Tendon tensions beside the spools over the same cycles{context.figure_of('Fig. 14(b)')}. "
        "Dotted: pretension; dashed: theory.",
    )


def _angles(subject: Subject, found: list[CycleRun]) -> Plot:
    names = list(dict.fromkeys(done.motion.name for done in found))
    chart, axes = panels(len(names), 3.2, 3.7)
    panel_of = dict(zip(names, axes, strict=True))
    for done in found:
        shown, follows = done.run[DRAWN], done.motion.follows
        axis, joint = panel_of[done.motion.name], subject.joints[follows]
        color, at = style.AGONIST if done.load else style.INK, f"{done.motion.name}, {done.words} [deg]"
        unloaded, theory, angle = (
            np.degrees(angles[:, follows])
            for angles in (subject.target(shown), subject.target(shown, done.load), subject.turned(shown))
        )
        chart.curve(axis, chart.keep(f"unloaded angle, {at}", unloaded), f"{joint} by {at}", angle, color=color, lw=1.1)
        order = np.argsort(unloaded)
        axis.plot(unloaded[order], chart.keep(f"theory, {at}", theory)[order], "--", color=style.ANTAGONIST, lw=1.0)
        loads = [one.words for one in found if one.motion is done.motion and one.load]
        axis.set(title=", ".join([done.motion.name, *loads]), xlabel=f"unloaded angle of {joint} [deg]")
    axes[0].set_ylabel("angle on the twin [deg]")
    style.legend_outside(
        chart.figure,
        ("no load", style.INK, "-"),
        ("under the load above", style.AGONIST, "-"),
        ("theory, no friction", style.ANTAGONIST, "--"),
    )
    return chart.plot(
        "cycles",
        f"Angle of the joint that follows over its unloaded angle, {named(subject.given)}, {subject.cycles} cycles of "
        "each motion.",
    )

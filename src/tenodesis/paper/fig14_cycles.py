"""Fig. 14: flexion and extension under load on the twin, and eq. 19's estimate from the tensions measured there."""

from typing import NamedTuple

import numpy as np

from tenodesis import simulate, statics
from tenodesis.instrument import ShortForm
from tenodesis.paper import published
from tenodesis.paper.context import DRAWN, WAYS, Context, RecordedRun, has_friction
from tenodesis.report import style
from tenodesis.report.content import Array, Column, Plot, Section, Table, fixed, named, number, unit_text
from tenodesis.report.curves import Loop, estimated_output_angle, forces, hysteresis, load_name, loop_panels
from tenodesis.run import Run
from tenodesis.units import unit_of

SPEED = float(np.radians(10))
"""Speed of the handle, rad/s."""

_LOADING, _RESTING = 1.0, 0.5  # s
_SEED = 14
_TITLE = "Flexion and extension"


class Cycles(NamedTuple):
    """The cycles under a force: signals from the first flexion on, the estimate, and derived measures."""

    force: float
    recorded: RecordedRun
    run: Run
    estimate: Array
    error: float
    """Root mean square error of the estimate, rad."""
    shift_at_flexion: float
    """How far the output angle stays behind theory, mean over the last flexion, rad."""
    shift_at_extension: float
    """How far it is ahead of theory, mean over the last extension, rad."""
    estimated_width: float
    """Width of the estimate's loop, mean over the last cycle, rad."""
    agonist_at_flexion: float
    """Agonist tension, by how much higher at flexion than at extension, N."""
    antagonist_at_extension: float
    """Antagonist tension, by how much higher at extension than at flexion, N."""


def protocol(inst: ShortForm, force: float) -> simulate.Protocol:
    """Return the protocol of the experiment under a force (N)."""
    return simulate.Protocol(
        name=f"cycles at {force:g} N",
        description="Fig. 14: flexion and extension of the handle through the working range under a constant force",
        phases=[
            simulate.Ramp(force=force, duration=_LOADING),
            simulate.Hold(duration=_RESTING),
            simulate.Cycles(amplitude=statics.reach(inst), speed=SPEED, count=inst.conditions.cycles or 2, force=force),
        ],
    )


def cycle(inst: ShortForm, force: float) -> Cycles | None:
    """Run the cycles under a force (N) on the twin; None if the joint cannot hold it."""
    recorded = RecordedRun.of(inst, protocol(inst, force), _SEED)
    if recorded is None:
        return None
    run = recorded.run.rows(int(np.searchsorted(recorded.run.time, _LOADING + _RESTING, "right")))
    estimate = estimated_output_angle(inst, run)
    error = float(np.sqrt(_mean((estimate - run["measured_output_angle"]) ** 2)))
    return Cycles(force, recorded, run, estimate, error, *_widths(inst, force, run, estimate))


def _mean(values: Array) -> float:
    """Return the mean of the values that are not NaN; NaN if all are."""
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else float("nan")


def _widths(inst: ShortForm, force: float, run: Run, estimate: Array) -> tuple[float, float, float, float, float]:
    """Compare flexion and extension of the last cycle at the same handle angles, clear of the reversals."""
    cycles = inst.conditions.cycles or 2
    samples = len(run) // cycles
    last = slice((cycles - 1) * samples, cycles * samples)
    top = last.start + int(np.argmax(run["handle_angle"][last]))
    grid = WAYS * statics.reach(inst)

    def halves(values: Array) -> tuple[Array, Array]:
        handle = run["handle_angle"]
        up, down = slice(last.start, top), slice(last.stop - 1, top, -1)
        return np.interp(grid, handle[up], values[up]), np.interp(grid, handle[down], values[down])

    theory = statics.output_angle(inst, grid, force)
    flexion, extension = halves(run["output_angle"])
    estimated = halves(estimate)
    agonist, antagonist = halves(run["tension"][:, 0]), halves(run["tension"][:, 1])
    return (
        _mean(theory - flexion),
        _mean(extension - theory),
        _mean(estimated[1] - estimated[0]),
        float(np.mean(agonist[0] - agonist[1])),
        float(np.mean(antagonist[1] - antagonist[0])),
    )


def section(context: Context) -> Section:
    """Compute the cycles under every force of the instrument's conditions."""
    inst = context.tested
    title = f"{_TITLE} with friction" if has_friction(inst) else _TITLE
    cycles = [done for done in (cycle(inst, force) for force in forces(inst)[1:]) if done is not None]
    if not cycles:
        text = f"<p>Not run: {named(inst)} holds none of the forces while its handle moves.</p>"
        return Section("hysteresis", title, text)
    context.recordings |= {
        context.file_name("fig14", "cycles_" * context.is_own + f"{done.force:g}N"): done.recorded for done in cycles
    }
    plots = [_angles(context, inst, cycles), _tensions(context, inst, cycles)]
    return Section("hysteresis", title, _text(context, inst), plots, [_table(context, cycles), *_parameters(inst)])


def _table(context: Context, cycles: list[Cycles]) -> Table:
    def column(heading: str, name: str, unit: str, description: str) -> Column:
        return Column(heading, f"hysteresis.{name}.at_{{force:g}}N", unit, f"{description}, {{force:g}} N")

    table = context.table(
        "Error of the estimate from the tensions (eq. 19) against the distal encoder; how far the tip stays behind "
        "theory at flexion and is ahead of it at extension, and the loops' widths, means over the last cycle; "
        "difference of the tensions",
        "force",
        column("rms error [°]", "estimation_error", "deg", "RMS error of eq. 19's estimate on the twin"),
        *(["published [°]"] if context.is_paper else []),
        column("behind at flexion [°]", "shift_at_flexion", "deg", "How far the tip stays behind theory at flexion"),
        column("ahead at extension [°]", "shift_at_extension", "deg", "How far the tip runs ahead at extension"),
        "loop [°]",
        column("estimate's loop [°]", "estimated_width", "deg", "Width of the estimate's loop"),
        column("agonist higher at flexion [N]", "agonist_at_flexion", "N", "Agonist tension, flexion minus extension"),
        column(
            "antagonist higher at extension [N]",
            "antagonist_at_extension",
            "N",
            "Antagonist tension, extension minus flexion",
        ),
    )
    for done in cycles:
        printed = published.ESTIMATION_ERRORS.get(round(done.force, 6)) if context.is_paper else None
        behind, ahead = np.degrees([done.shift_at_flexion, done.shift_at_extension])
        table.row(
            f"{done.force:g} N",
            (np.degrees(done.error), printed),
            *(["–" if printed is None else fixed(printed.value)] if context.is_paper else []),
            behind,
            ahead,
            behind + ahead,
            np.degrees(done.estimated_width),
            done.agonist_at_flexion,
            done.antagonist_at_extension,
            force=done.force,
        )
    return table


def _parameters(inst: ShortForm) -> list[Table]:
    """Return the table of the file's friction, mismatch and dynamics, with sources; empty if the file has none."""
    rows = []
    for name in ("friction", "mismatch", "dynamics"):
        table = getattr(inst, name)
        for key, field in type(table).model_fields.items():
            if key not in table.model_fields_set:
                continue
            value, unit = getattr(table, key), unit_of(field)
            if unit == "rad":
                text = f"{fixed(float(np.degrees(value)), 1)}°"
            elif isinstance(value, float):
                text = " ".join([number(value), *([unit_text(unit)] if unit else [])])
            else:
                text = str(value)
            source = inst.sources.get(f"{name}.{key}", inst.sources.get(name, ""))
            rows.append([f"{name}: {key.replace('_', ' ')}", text, source])
    table = Table("Parameters of the twin besides the dimensions", ["key", "value", "source"], rows)
    return [table] if rows else []


def _text(context: Context, inst: ShortForm) -> str:
    if inst.friction.law == "none":
        return (
            "<p>The instrument file has no friction, so the twin's loops are closed but for its sensors' noise; a "
            "<code>[friction]</code> table opens them.</p>"
        )
    text = (
        "<p>The twin takes the place of the test bench: elastic tendons with capstan friction, drives, and sensors "
        "with noise and 12 bits. Friction holds the tip back at flexion and forward at extension, and shifts the "
        "tensions that the load cells measure; the estimate from the tensions (eq. 19) reads both as load. The "
        "runs are recorded, in <code>recordings/</code>.</p>"
    )
    if context.is_paper:
        offset = fixed(float(np.degrees(inst.mismatch.output_encoder_offset)), 1)
        text += (
            f"<p>The ratio of true to nominal tendon stiffness ({inst.mismatch.stiffness_ratio:g}) and the distal "
            f"encoder's offset ({offset}°) were fitted to the three "
            f"published errors; the friction coefficient ({inst.friction.vertex_coefficient:g}) was chosen so that "
            "the paper's other observations hold as well: more shift at flexion, a higher agonist tension there and a "
            "higher antagonist tension at extension, an estimate whose loop is wider than the measured loop, and a tip "
            "that gives way in all four states of Fig. 15. Other coefficients fit the three errors equally well; see "
            "the instrument file.</p>"
        )
    return text


def _loops(cycles: list[Cycles]) -> list[Loop]:
    return [Loop(load_name(done.force), done.run[DRAWN], done.estimate[DRAWN]) for done in cycles]


def _angles(context: Context, inst: ShortForm, cycles: list[Cycles]) -> Plot:
    chart = hysteresis(inst, _loops(cycles), "twin, measured")
    return chart.plot(
        context.file_name("fig14a", "cycles"),
        f"Input and output over flexion and extension, {named(inst)}, T<sub>o</sub> = {inst.pretension:g} N, "
        f"{inst.conditions.cycles or 2} cycles at {np.degrees(SPEED):.0f}°/s{context.figure_of('Fig. 14(a)')}. "
        "Dotted: no load; dashed: theory.",
    )


def _tensions(context: Context, inst: ShortForm, cycles: list[Cycles]) -> Plot:
    chart, axes = loop_panels(_loops(cycles), "tension [N]")
    grid = np.linspace(0, statics.reach(inst), 101)
    sides = (("agonist", style.AGONIST), ("antagonist", style.ANTAGONIST))
    for axis, done in zip(axes, cycles, strict=True):
        run = done.run[DRAWN]
        handle = chart.keep(f"handle_angle at {done.force:g} N [deg]", np.degrees(run["measured_handle_angle"]))
        axis.axhline(inst.pretension, color=style.MUTED, ls=":", lw=1.3)
        theory = statics.tensions(inst, grid, done.force)
        for (side, color), measured, expected in zip(sides, run["measured_tension"].T, theory, strict=True):
            chart.curve(axis, handle, f"{side} at {done.force:g} N [N]", measured, color=color, lw=0.9)
            axis.plot(np.degrees(grid), expected, "--", color=color, lw=1.3)
    lines = [(side, color, "-") for side, color in sides]
    style.legend_outside(chart.figure, *lines, ("pretension", style.MUTED, ":"), ("theory", style.INK, "--"))
    return chart.plot(
        context.file_name("fig14b", "cycles_" * context.is_own + "tensions"),
        f"Tendon tensions beside the spools over the same cycles{context.figure_of('Fig. 14(b)')}. "
        "Dotted: pretension; dashed: theory.",
    )

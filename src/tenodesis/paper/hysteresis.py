"""Fig. 14: flexion and extension under load on the twin, and what eq. 19 makes of the tensions measured there."""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tenodesis import simulate, statics, twin
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import Instrument
from tenodesis.paper import published
from tenodesis.paper.context import Context, Session
from tenodesis.paper.input_output import forces
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named, number
from tenodesis.run import Run
from tenodesis.units import unit_of

Array = NDArray[np.float64]

SPEED = float(np.radians(10))  # of the handle, rad/s
_LOADING, _RESTING = 1.0, 0.5  # s
_SEED = 14
_TITLE = "Flexion and extension with friction"
_KEPT = 20  # every so-manieth sample is drawn


class Cycles(NamedTuple):
    """The cycles under one force: signals from the first flexion on, the estimate, and what they come to."""

    force: float
    run: Run
    estimate: Array
    error: float
    """Root mean square error of the estimate, rad."""
    shift_at_flexion: float
    """How far the output angle stays behind theory, mean over the last flexion, rad."""
    shift_at_extension: float
    """How far it runs ahead of theory, mean over the last extension, rad."""
    estimated_width: float
    """Width of the estimate's loop, mean over the last cycle, rad."""
    agonist_at_flexion: float
    """Agonist tension, by how much higher at flexion than at extension, N."""
    antagonist_at_extension: float
    """Antagonist tension, by how much higher at extension than at flexion, N."""


def protocol(inst: Instrument, force: float) -> simulate.Protocol:
    """Return what is done on the bench under one force (N)."""
    return simulate.Protocol(
        name=f"cycles at {force:g} N",
        description="Fig. 14: flexion and extension of the handle through the working range under a constant force",
        phases=[
            simulate.Ramp(force=force, duration=_LOADING),
            simulate.Hold(duration=_RESTING),
            simulate.Cycles(amplitude=statics.reach(inst), speed=SPEED, count=inst.conditions.cycles or 2, force=force),
        ],
    )


def cycle(inst: Instrument, force: float) -> Cycles | None:
    """Run the cycles under one force (N) on the twin; None if the joint does not hold it."""
    try:
        return _cycle(inst, force)
    except NoSolutionError:
        return None


def _cycle(inst: Instrument, force: float) -> Cycles:
    whole = simulate.execute(twin.Twin(inst, seed=_SEED), protocol(inst, force))
    run = _from(whole, _LOADING + _RESTING)
    handle = np.clip(run["measured_handle_angle"], -inst.handle_range, inst.handle_range)
    estimate = statics.estimate_output_angle(inst, handle, run["measured_tension"][:, 0], run["measured_tension"][:, 1])
    error = float(np.sqrt(_mean((estimate - run["measured_output_angle"]) ** 2)))
    return Cycles(force, run, estimate, error, *_widths(inst, force, run, estimate))


def _from(run: Run, time: float) -> Run:
    later = run.time > time
    return Run(run.time[later] - time, run.axes, **{name: values[later] for name, values in run.signals().items()})


def _mean(values: Array) -> float:
    """Return the mean of the values that are there; NaN if none is."""
    there = values[np.isfinite(values)]
    return float(there.mean()) if there.size else float("nan")


def _widths(inst: Instrument, force: float, run: Run, estimate: Array) -> tuple[float, float, float, float, float]:
    """Compare flexion and extension of the last cycle at the same handle angles, clear of the reversals."""
    cycles = inst.conditions.cycles or 2
    samples = len(run) // cycles
    last = slice((cycles - 1) * samples, cycles * samples)
    top = last.start + int(np.argmax(run["handle_angle"][last]))
    grid = np.linspace(0.15, 0.9, 61) * statics.reach(inst)

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
    tried = [cycle(inst, force) for force in forces(inst)[1:]]
    cycles = [one for one in tried if one is not None]
    if not cycles:
        text = f"<p>Not run: {named(inst)} holds none of the forces while its handle moves.</p>"
        return Section("hysteresis", _TITLE, text)
    for one in cycles:
        context.recordings[f"fig14_{one.force:g}N"] = Session(inst, protocol(inst, one.force), _SEED)
        _add(context, one)
    rows = []
    for one in cycles:
        printed = published.ESTIMATION_ERRORS.get(round(one.force, 6)) if context.is_paper else None
        rows.append(
            [
                f"{one.force:g} N",
                fixed(float(np.degrees(one.error))),
                "–" if printed is None else fixed(printed.value),
                fixed(float(np.degrees(one.shift_at_flexion))),
                fixed(float(np.degrees(one.shift_at_extension))),
                fixed(float(np.degrees(one.shift_at_flexion + one.shift_at_extension))),
                fixed(float(np.degrees(one.estimated_width))),
                fixed(one.agonist_at_flexion),
                fixed(one.antagonist_at_extension),
            ]
        )
    conditions = (
        f"{named(inst)}, T<sub>o</sub> = {inst.pretension:g} N, {inst.conditions.cycles or 2} cycles at "
        f"{np.degrees(SPEED):.0f}°/s"
    )
    plots = [
        Plot(
            "fig14a_cycles",
            f"Input and output over flexion and extension, {conditions} ({context.figure_of('Fig. 14(a)')}). "
            "Dotted: no load; dashed: theory.",
            _angles(inst, cycles),
            _angle_curves(inst, cycles),
        ),
        Plot(
            "fig14b_tensions",
            f"Tendon tensions beside the spools over the same cycles ({context.figure_of('Fig. 14(b)')}). "
            "Dotted: pretension; dashed: theory.",
            _tensions(inst, cycles),
            _tension_curves(cycles),
        ),
    ]
    table = Table(
        "Error of eq. 19's estimate against the distal encoder; how far the tip stays behind theory at flexion and "
        "runs ahead of it at extension, and the loops' widths, means over the last cycle; by how much the tensions "
        "differ",
        [
            "force",
            "rms error [°]",
            "published [°]",
            "behind at flexion [°]",
            "ahead at extension [°]",
            "loop [°]",
            "estimate's loop [°]",
            "agonist higher at flexion [N]",
            "antagonist higher at extension [N]",
        ],
        rows,
    )
    return Section("hysteresis", _TITLE, _text(context, inst), plots, [table, *_made_of(inst)])


def _made_of(inst: Instrument) -> list[Table]:
    """Return what the file says of friction, mismatch and dynamics, with sources; no table if it says nothing."""
    rows = []
    for name in ("friction", "mismatch", "dynamics"):
        table = getattr(inst, name)
        for key, field in type(table).model_fields.items():
            if key not in table.model_fields_set:
                continue
            value, unit = getattr(table, key), unit_of(field)
            if unit == "rad":
                told = f"{fixed(float(np.degrees(value)), 1)}°"
            elif isinstance(value, float):
                told = " ".join([number(value), *([unit.replace("*", "·").replace("^2", "²")] if unit else [])])
            else:
                told = str(value)
            source = inst.sources.get(f"{name}.{key}", inst.sources.get(name, ""))
            rows.append([f"{name}: {key.replace('_', ' ')}", told, source])
    table = Table("What the twin is made of besides the dimensions", ["key", "value", "source"], rows)
    return [table] if rows else []


def _text(context: Context, inst: Instrument) -> str:
    if inst.friction.law == "none":
        return (
            "<p>The instrument file has no friction, so the twin's loops are closed but for its sensors' noise; a "
            "<code>[friction]</code> table opens them.</p>"
        )
    text = (
        "<p>The twin stands for the bench: elastic tendons with capstan friction, drives, and sensors with noise and "
        "12 bits. Friction holds the tip back at flexion and forward at extension, and shifts the tensions that the "
        "load cells see; eq. 19 reads both as load. The runs are recorded, in <code>recordings/</code>.</p>"
    )
    if context.is_paper:
        offset = fixed(float(np.degrees(inst.mismatch.output_encoder_offset)), 1)
        text += (
            f"<p>The ratio of true to nominal tendon stiffness ({inst.mismatch.stiffness_ratio:g}) and the distal "
            f"encoder's offset ({offset}°) were fitted to the three "
            f"published errors; the friction coefficient ({inst.friction.vertex_coefficient:g}) was chosen so that "
            "what the paper tells besides holds as well: more shift at flexion, a higher agonist tension there and a "
            "higher antagonist tension at extension, an estimate whose loop is wider than the measured one, and a tip "
            "that gives way in all four states of Fig. 15. Other coefficients fit the three numbers alike; see the "
            "instrument file.</p>"
        )
    return text


def _add(context: Context, one: Cycles) -> None:
    force, key = f"{one.force:g} N", f"at_{one.force:g}N"
    printed = published.ESTIMATION_ERRORS.get(round(one.force, 6))
    context.add(
        f"hysteresis.estimation_error.{key}",
        np.degrees(one.error),
        "deg",
        f"RMS error of eq. 19's estimate on the twin, {force}",
        printed,
    )
    for name, value, unit, told in (
        ("shift_at_flexion", np.degrees(one.shift_at_flexion), "deg", "How far the tip stays behind theory at flexion"),
        ("shift_at_extension", np.degrees(one.shift_at_extension), "deg", "How far the tip runs ahead at extension"),
        ("estimated_width", np.degrees(one.estimated_width), "deg", "Width of the estimate's loop"),
        ("agonist_at_flexion", one.agonist_at_flexion, "N", "Agonist tension, flexion minus extension"),
        ("antagonist_at_extension", one.antagonist_at_extension, "N", "Antagonist tension, extension minus flexion"),
    ):
        context.add(f"hysteresis.{name}.{key}", value, unit, f"{told}, {force}")


def _panels(cycles: list[Cycles], ylabel: str) -> tuple[Figure, list[Axes]]:
    fig, axes = style.figure(len(cycles), width=3.1 * len(cycles) + 0.6, height=3.6)
    for axis, one in zip(axes, cycles, strict=True):
        axis.set(title=f"{one.force:g} N", xlabel="handle angle $\\theta_h$ [deg]")
    axes[0].set_ylabel(ylabel)
    return fig, list(axes)


def _angles(inst: Instrument, cycles: list[Cycles]) -> Figure:
    fig, axes = _panels(cycles, "output angle $\\theta_e$ [deg]")
    grid = np.linspace(0, statics.reach(inst), 101)
    for axis, one in zip(axes, cycles, strict=True):
        handle = np.degrees(one.run["measured_handle_angle"])[::_KEPT]
        axis.plot(np.degrees(grid), np.degrees(statics.output_angle(inst, grid)), ":", color=style.MUTED, lw=1.3)
        axis.plot(
            np.degrees(grid), np.degrees(statics.output_angle(inst, grid, one.force)), "--", color=style.INK, lw=1.3
        )
        axis.plot(handle, np.degrees(one.estimate)[::_KEPT], color=style.ANTAGONIST, lw=1.0)
        axis.plot(handle, np.degrees(one.run["measured_output_angle"])[::_KEPT], color=style.AGONIST, lw=1.0)
    _legend(
        fig,
        ("twin, measured", style.AGONIST, "-"),
        ("estimate, eq. 19", style.ANTAGONIST, "-"),
        ("theory, no load", style.MUTED, ":"),
    )
    return fig


def _tensions(inst: Instrument, cycles: list[Cycles]) -> Figure:
    fig, axes = _panels(cycles, "tension [N]")
    grid = np.linspace(0, statics.reach(inst), 101)
    for axis, one in zip(axes, cycles, strict=True):
        handle = np.degrees(one.run["measured_handle_angle"])[::_KEPT]
        axis.axhline(inst.pretension, color=style.MUTED, ls=":", lw=1.3)
        theory = statics.tensions(inst, grid, one.force)
        for n, (color, expected) in enumerate(zip((style.AGONIST, style.ANTAGONIST), theory, strict=True)):
            axis.plot(handle, one.run["measured_tension"][::_KEPT, n], color=color, lw=0.9)
            axis.plot(np.degrees(grid), expected, "--", color=color, lw=1.3)
    _legend(
        fig,
        ("agonist", style.AGONIST, "-"),
        ("antagonist", style.ANTAGONIST, "-"),
        ("pretension", style.MUTED, ":"),
    )
    return fig


def _legend(fig: Figure, *entries: tuple[str, str, str]) -> None:
    lines = (*entries, ("theory", style.INK, "--"))
    axis = fig.axes[0]
    handles = [axis.plot([], [], ls, color=color, label=name)[0] for name, color, ls in lines]
    fig.legend(handles=handles, loc="outside upper left", ncols=len(lines))


def _angle_curves(inst: Instrument, cycles: list[Cycles]) -> dict[str, Array]:
    curves: dict[str, Array] = {}
    for one in cycles:
        handle = one.run["measured_handle_angle"][::_KEPT]
        clipped = np.clip(handle, -inst.handle_range, inst.handle_range)
        curves[f"handle_angle at {one.force:g} N [deg]"] = np.degrees(handle)
        curves[f"measured_output_angle at {one.force:g} N [deg]"] = np.degrees(
            one.run["measured_output_angle"][::_KEPT]
        )
        curves[f"estimate at {one.force:g} N [deg]"] = np.degrees(one.estimate[::_KEPT])
        curves[f"theory at {one.force:g} N [deg]"] = np.degrees(statics.output_angle(inst, clipped, one.force))
    return curves


def _tension_curves(cycles: list[Cycles]) -> dict[str, Array]:
    curves: dict[str, Array] = {}
    for one in cycles:
        curves[f"handle_angle at {one.force:g} N [deg]"] = np.degrees(one.run["measured_handle_angle"][::_KEPT])
        for n, side in enumerate(("agonist", "antagonist")):
            curves[f"{side} at {one.force:g} N [N]"] = one.run["measured_tension"][::_KEPT, n]
    return curves

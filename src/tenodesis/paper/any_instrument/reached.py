"""Where the tip gets to in space by handle or motors, and how far the largest load moves it there."""

from typing import NamedTuple

import numpy as np

from tenodesis import kinematics, statics
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import FullForm
from tenodesis.paper.any_instrument.held import Load, loads
from tenodesis.paper.context import Context
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Column, Plot, Section, named
from tenodesis.statics import chain

_POSTURES = 800
_SEED = 3
_FLAT = 0.01
"""Share of the largest extent below which a side is not drawn."""
_TITLE = "Workspace of the tip"


class Places(NamedTuple):
    """Postures within all ranges, and where the tip is there, (n, 3), m; NaN where a load cannot be held."""

    handle: Array
    strokes: Array
    free: Array
    """Mean of the ends at which forces act"""


def section(context: Context) -> Section:
    """Compute the tip's places over the ranges of all joints, and how far each load moves them."""
    inst = context.whole
    places = _places(inst)
    if not len(places.free):
        return Section("workspace", _TITLE, f"<p>Neither handle nor motors move the tip of {named(inst)}.</p>")
    spans = 1e3 * np.ptp(places.free, axis=0)
    for axis, span in zip("xyz", spans, strict=True):
        context.add(f"workspace.span.{axis}", span, "mm", f"How far the places of the tip spread along {axis}")
    table = context.table(
        "How far a load moves the tip, over all postures",
        "load",
        Column("mean [mm]", "workspace.moved.{load}.mean", "mm", "Mean way of the tip under {words}"),
        Column("largest [mm]", "workspace.moved.{load}.largest", "mm", "Largest way of the tip under {words}"),
        Column("held [%]", "workspace.moved.{load}.held", "%", "Share of postures that hold {words}", digits=0),
    )
    applied = [load for load in loads(inst) if load.wrench.any()]
    moved = [np.linalg.norm(_loaded(inst, places, load) - places.free, axis=1) for load in applied]
    for load, way in zip(applied, moved, strict=True):
        held = np.isfinite(way)
        shown = 1e3 * way[held] if held.any() else np.array([np.nan])
        labels = {"load": load.name, "words": load.text()}
        table.row(load.text(), float(shown.mean()), float(shown.max()), 100 * float(held.mean()), **labels)
    text = (
        f"<p>{len(places.free)} random postures within the ranges of all joints, from the port, or the stem’s end; z "
        f"points along the stem. The tip’s places spread over {spans[0]:.3g}, {spans[1]:.3g} and {spans[2]:.3g} mm. "
        "The shade is how far the load that moves it most takes it from there, handle and motors held.</p>"
    )
    worst = int(np.argmax([np.nanmean(way) if np.isfinite(way).any() else 0.0 for way in moved]))
    return Section("workspace", _TITLE, text, [_plot(context, places, applied[worst], moved[worst])], [table])


def _places(inst: FullForm) -> Places:
    random = np.random.default_rng(_SEED)
    joints = inst.handle_joints or inst.tip_joints
    ranges = np.array([joint.range for joint in joints])
    drawn = random.uniform(-ranges, ranges, (_POSTURES, len(joints)))
    if not inst.handle_joints:
        # Jaws turn together, closed.
        drawn[:, inst.jaws[1:]] = drawn[:, inst.jaws[:1]]
    handle, strokes = np.zeros((_POSTURES, len(inst.handle_joints))), np.zeros((_POSTURES, len(inst.tendons)))
    if inst.handle_joints:
        handle = drawn
    else:
        for row, angles in zip(strokes, drawn, strict=True):
            try:
                row[:] = statics.hold(inst, angles)[1]
            except NoSolutionError:
                row[:] = np.nan
        strokes = strokes[np.isfinite(strokes).all(axis=1)]
        handle = handle[: len(strokes)]
    angles = chain.output_angles(inst, handle, strokes=strokes)
    within = (np.abs(angles) <= [joint.range + 1e-6 for joint in inst.tip_joints]).all(axis=1)
    return Places(handle[within], strokes[within], _tip(inst, angles[within]))


def _tip(inst: FullForm, angles: Array) -> Array:
    return np.asarray(kinematics.tip_pose(inst, angles).position.mean(axis=-2))


def _loaded(inst: FullForm, places: Places, load: Load) -> Array:
    angles = chain.output_angles(inst, places.handle, load.wrench, strokes=places.strokes)
    held = np.isfinite(angles).all(axis=1)
    found = np.full((len(angles), 3), np.nan)
    found[held] = _tip(inst, angles[held])
    return found


def _plot(context: Context, places: Places, load: Load, way: Array) -> Plot:
    across = [n for n in (0, 1) if np.ptp(places.free[:, n]) > _FLAT * np.ptp(places.free)]
    chart, axes = Chart.panels(len(across), width=max(7.0, 4.5 * len(across)), height=4.0)
    x, y, z = (chart.keep(f"{axis} [mm]", column) for axis, column in zip("xyz", 1e3 * places.free.T, strict=True))
    shade = chart.keep(f"moved by {load.text()} [mm]", 1e3 * way)
    order = np.argsort(np.nan_to_num(shade))
    low, high = min(0.0, float(z.min())), max(0.0, float(z.max()))
    margin = 0.05 * (high - low)
    for axis, n in zip(axes, across, strict=True):
        drawn = axis.scatter((x, y)[n][order], z[order], c=shade[order], s=9, cmap="viridis", vmin=0, lw=0)
        axis.plot(0, 0, "o", color=style.ACCENT, ms=5)
        axis.annotate("origin", (0, 0), (6, -3), textcoords="offset points", color=style.ACCENT)
        axis.set(xlabel=f"{'xy'[n]} [mm]", aspect="equal", ylim=(low - margin, high + margin))
    axes[0].set_ylabel("z, along the stem [mm]")
    chart.figure.colorbar(drawn, ax=list(axes), label=f"moved by {load.text()} [mm]", shrink=0.85, pad=0.02)
    return chart.plot("workspace", f"Places of the tip, from each side to which it moves, {named(context.whole)}.")

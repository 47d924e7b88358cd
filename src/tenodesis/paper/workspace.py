"""The instrument in space: where the tip gets to, and how much of it is lost under a load."""

import html
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from tenodesis import kinematics, statics
from tenodesis.errors import InstrumentError, NoSolutionError
from tenodesis.instrument import FullForm, ShortForm
from tenodesis.kinematics import Workspace
from tenodesis.paper.context import Context
from tenodesis.paper.subject import Load, Subject
from tenodesis.report import style
from tenodesis.report.content import Array, Chart, Plot, ResultColumn, Section, named
from tenodesis.statics import chain

WIDE = np.radians(90.0)
"""Span of directions from which a place counts as reachable from many sides."""

_TITLE = "Workspace through the port"
_POSTURES = 800
_SEED = 3
_FLAT = 0.01
"""Share of the largest extent below which a side is not drawn."""
_FORCES = 13
_SHADES = 16


class ReachedPlaces(NamedTuple):
    """Postures within all ranges, and where the tip is there, (n, 3), m; NaN where a load cannot be held."""

    handle: Array
    strokes: Array
    free: Array
    """Mean of the ends at which forces act"""


def section(context: Context) -> Section:
    """Compute the tip's places and how far loads move them, or through the port, and the directions that are left."""
    subject = context.subject
    if subject.plane is not None:
        return _through_port(context, context.inst)
    inst, title = subject.inst, "Workspace of the tip"
    places = _places(inst)
    if not len(places.free):
        return Section("workspace", title, f"<p>Neither handle nor motors move the tip of {named(inst)}.</p>")
    spans = 1e3 * np.ptp(places.free, axis=0)
    for axis, span in zip("xyz", spans, strict=True):
        context.add(f"workspace.span.{axis}", span, "mm", f"How far the places of the tip spread along {axis}")
    table = context.table(
        "How far a load moves the tip, over all postures",
        "load",
        ResultColumn("mean [mm]", "workspace.moved.{load}.mean", "mm", "Mean way of the tip under {words}"),
        ResultColumn("largest [mm]", "workspace.moved.{load}.largest", "mm", "Largest way of the tip under {words}"),
        ResultColumn("held [%]", "workspace.moved.{load}.held", "%", "Share of postures that hold {words}", digits=0),
    )
    applied = [load for load in subject.loads if load.wrench.any()]
    moved = [np.linalg.norm(_loaded(inst, places, load) - places.free, axis=1) for load in applied]
    for load, way in zip(applied, moved, strict=True):
        held = np.isfinite(way)
        shown = 1e3 * way[held] if held.any() else np.array([np.nan])
        labels = {"load": load.name, "words": load.text}
        table.row(load.text, float(shown.mean()), float(shown.max()), 100 * float(held.mean()), **labels)
    text = (
        f"<p>{len(places.free)} random postures within the ranges of all joints, from the port, or the stem’s end; z "
        f"points along the stem. The tip’s places spread over {spans[0]:.3g}, {spans[1]:.3g} and {spans[2]:.3g} mm. "
        "The shade is how far the load that moves it most takes it from there, handle and motors held.</p>"
    )
    worst = int(np.argmax([np.nanmean(way) if np.isfinite(way).any() else 0.0 for way in moved]))
    return Section("workspace", title, text, [_scattered(subject, places, applied[worst], moved[worst])], [table])


def _places(inst: FullForm) -> ReachedPlaces:
    random = np.random.default_rng(_SEED)
    limits = np.array([joint.limits for joint in inst.handle_joints]) if inst.handle_joints else inst.bend_limits
    drawn = random.uniform(limits[:, 0], limits[:, 1], (_POSTURES, len(limits)))
    if not inst.handle_joints:
        drawn = np.array([inst.bent(angles) for angles in drawn])
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
    summed = Subject(inst).bends.summed
    low, high = summed(np.array([joint.limits for joint in inst.tip_joints]).T)
    within = ((summed(angles) >= low - 1e-6) & (summed(angles) <= high + 1e-6)).all(axis=1)
    return ReachedPlaces(handle[within], strokes[within], _tip(inst, angles[within]))


def _tip(inst: FullForm, angles: Array) -> Array:
    return np.asarray(kinematics.tip_pose(inst, angles).position.mean(axis=-2))


def _loaded(inst: FullForm, places: ReachedPlaces, load: Load) -> Array:
    angles = chain.output_angles(inst, places.handle, load.wrench, strokes=places.strokes)
    held = np.isfinite(angles).all(axis=1)
    found = np.full((len(angles), 3), np.nan)
    found[held] = _tip(inst, angles[held])
    return found


def _scattered(subject: Subject, places: ReachedPlaces, load: Load, way: Array) -> Plot:
    across = [n for n in (0, 1) if np.ptp(places.free[:, n]) > _FLAT * np.ptp(places.free)]
    chart, axes = Chart.panels(len(across), width=max(7.0, 4.5 * len(across)), height=4.0)
    x, y, z = (chart.keep(f"{axis} [mm]", column) for axis, column in zip("xyz", 1e3 * places.free.T, strict=True))
    shade = chart.keep(f"moved by {load.text} [mm]", 1e3 * way)
    order = np.argsort(np.nan_to_num(shade))
    low, high = min(0.0, float(z.min())), max(0.0, float(z.max()))
    margin = 0.05 * (high - low)
    for axis, n in zip(axes, across, strict=True):
        drawn = axis.scatter((x, y)[n][order], z[order], c=shade[order], s=9, cmap="viridis", vmin=0, lw=0)
        axis.plot(0, 0, "o", color=style.ACCENT, ms=5)
        axis.annotate("origin", (0, 0), (6, -3), textcoords="offset points", color=style.ACCENT)
        axis.set(xlabel=f"{'xy'[n]} [mm]", aspect="equal", ylim=(low - margin, high + margin))
    axes[0].set_ylabel("z, along the stem [mm]")
    chart.figure.colorbar(drawn, ax=list(axes), label=f"moved by {load.text} [mm]", shrink=0.85, pad=0.02)
    return chart.plot("workspace", f"Places of the tip, from each side to which it moves, {named(subject.inst)}.")


def _through_port(context: Context, inst: ShortForm) -> Section:
    try:
        lengths = kinematics.dimensions(inst)
    except InstrumentError as problem:
        return Section("workspace", _TITLE, f"<p>Left out: {html.escape(str(problem))}</p>")
    force = context.add(
        "workspace.force",
        max(inst.conditions.forces, default=1.0),
        "N",
        "Force that the loaded workspace is computed for",
    )
    free, loaded = kinematics.workspace(inst), kinematics.workspace(inst, force)
    wide = f"{np.degrees(WIDE):g}"

    def column(heading: str, name: str, unit: str, about: str, digits: int) -> ResultColumn:
        return ResultColumn(heading, f"workspace.{{name}}.{name}", unit, f"{about}, {{load}}", digits)

    points = f"Area where the end-effector can point over at least {wide} deg"
    table = context.table(
        "Workspace in the plane of the pan.",
        "load",
        ResultColumn(
            "largest output angle [°]", "workspace.{name}.bend", "deg", "Largest output angle {load}", digits=1
        ),
        column("area [cm²]", "area", "cm^2", "Area that the tip reaches in the plane of the pan", 0),
        column(f"area with ≥ {wide}° [cm²]", "wide_area", "cm^2", points, 0),
        column("mean span [°]", "span", "deg", "Mean angle over which the end-effector can point", 1),
    )
    for shown, name, space, load in (
        ("no load", "unloaded", free, "without a load"),
        (f"{force:.3g} N", "loaded", loaded, f"against {force:.3g} N"),
    ):
        area, wide_area = 1e4 * space.area, 1e4 * space.area_with(WIDE)
        table.row(shown, np.degrees(space.bend), area, wide_area, np.degrees(space.mean_span), name=name, load=load)
    chain = "a chain" if context.is_own else "the chain of Fig. 1"
    text = (
        f"<p>{named(inst)} as {chain}: spherical and prismatic joint at the port, then yaw, pitch and roll "
        f"of the end-effector; a stem of {1e3 * lengths.stem_length:.0f} mm. Pan and insertion bring the tip to a "
        "place; the bending joints set the directions from which the end-effector can work there. A load reduces the "
        "span of these directions, since the handle reaches the end of its range before the output angle does: "
        f"{force:.3g} N {_taken(free, loaded)}. Compensation by the motors restores this, as far as their stroke "
        f"allows. Limits of pan and insertion are our choice where the file has none.</p>"
    )
    return Section("workspace", _TITLE, text, [_plot(inst, force, free, loaded)], [table])


def _taken(free: Workspace, loaded: Workspace) -> str:
    """Return how much is lost under a load, as part of a sentence."""
    span, area = (
        100 * (1 - after / before) for before, after in ((free.mean_span, loaded.mean_span), (free.area, loaded.area))
    )
    return f"takes {_share(span)} of the mean span of directions and {_share(area)} of the area that the tip reaches"


def _share(percent: float) -> str:
    return f"{percent:.0f} %" if round(percent) else "hardly any"


def _plot(inst: ShortForm, force: float, free: Workspace, loaded: Workspace) -> Plot:
    chart, axes = Chart.panels(3, width=10.5, height=3.6)
    shades = Normalize(0.0, float(np.degrees(free.span.max())))
    for axis, space, load in ((axes[0], free, "no load"), (axes[1], loaded, f"{force:.3g} N against flexion")):
        _draw(axis, space, shades)
        axis.set(title=load, xlabel="x [mm]", ylabel="z, into the patient [mm]" if axis is axes[0] else "")
    chart.figure.colorbar(
        ScalarMappable(shades, "viridis"), ax=list(axes[:2]), label="span of directions [deg]", shrink=0.8, pad=0.02
    )
    axis = axes[2]
    forces = chart.keep("force [N]", np.linspace(0.0, 2 * force, _FORCES))
    spaces = [kinematics.workspace(inst, float(each), points=61) for each in forces]
    span = np.degrees([space.mean_span for space in spaces])
    heading = "mean span of directions [deg]"
    chart.curve(axis, forces, heading, span, color=style.ACCENT, label="mean span of directions")
    bend = chart.keep("largest output angle [deg]", np.degrees([space.bend for space in spaces]))
    axis.plot(forces, 2 * bend, color=style.INK, label="span of output angles")
    axis.axvline(force, color=style.REFERENCE, lw=1, ls=":")
    axis.set(title="by load", xlabel="tip force [N]", ylabel="[deg]", ylim=(0, 2.5 * bend.max() + 1))
    axis.legend(loc="upper right")
    for load, space in (("no load", free), (f"{force:.3g} N", loaded)):
        inside = space.span > 0
        share = np.where(inside, space.span, 0).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)
        chart.keep(f"distance from the port, {load} [mm]", 1e3 * space.distance)
        chart.keep(f"mean span of directions there, {load} [deg]", np.degrees(share))
    return chart.plot(
        "workspace_section",
        "Workspace through the port in the plane of the pan: the shade is the angle over which the end-effector can "
        "point at a place. Right: its mean, by load.",
    )


def _draw(axis: Axes, space: Workspace, shades: Normalize) -> None:
    angle, distance = np.meshgrid(space.angle, 1e3 * space.distance, indexing="ij")
    x, z = distance * np.sin(angle), distance * np.cos(angle)
    span = np.degrees(space.span)
    levels = np.linspace(0.0, shades.vmax or 1.0, _SHADES + 1)
    levels[0] = 1e-3 * levels[-1]  # where the tip cannot go stays white
    axis.contourf(x, z, span, levels, norm=shades, cmap="viridis")
    wide = axis.contour(x, z, np.degrees(space.span), [np.degrees(WIDE)], colors="white", linewidths=1.0)
    axis.clabel(wide, fmt=lambda level: f"{level:.0f}°", fontsize=7)
    axis.plot(0, 0, "o", color=style.ACCENT, ms=5)
    axis.annotate("port", (0, 0), (6, -3), textcoords="offset points", color=style.ACCENT)
    axis.set(aspect="equal", ylim=(-0.15 * distance.max(), 1.05 * distance.max()))

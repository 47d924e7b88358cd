"""The whole instrument in space: its workspace through the port, and what a load takes of it."""

import html

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from scipy.spatial.transform import Rotation

from tenodesis import kinematics
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.kinematics import Posture, Workspace
from tenodesis.paper.context import Context
from tenodesis.report import style
from tenodesis.report.content import Plot, Section, Table, fixed, named, number
from tenodesis.verification import kinematics_peers

WIDE = np.radians(90.0)
"""Span of directions from which on a place counts as one where the end-effector can work from many sides."""

_POSTURES = 20
_FORCES = 13
_SHADES = 16


def section(context: Context) -> Section:
    """Compute the workspace through the port, without a load and with one, and check the chain against MuJoCo."""
    inst = context.inst
    title = "Workspace through the port"
    try:
        lengths = kinematics.dimensions(inst)
    except InstrumentError as problem:
        return Section("workspace", title, f"<p>Left out: {html.escape(str(problem))}</p>")
    force = _force(inst)
    free, loaded = kinematics.workspace(inst), kinematics.workspace(inst, force)
    for name, space, told in (("unloaded", free, "without a load"), ("loaded", loaded, f"against {force:.3g} N")):
        key = f"workspace.{name}"
        context.add(f"{key}.bend", np.degrees(space.bend), "deg", f"Largest output angle {told}")
        context.add(f"{key}.area", 1e4 * space.area, "cm^2", f"Area that the tip gets to in the plane of pan, {told}")
        context.add(
            f"{key}.wide_area",
            1e4 * space.area_with(WIDE),
            "cm^2",
            f"Part of it where the end-effector can point over at least {np.degrees(WIDE):g} deg, {told}",
        )
        context.add(f"{key}.span", np.degrees(space.mean_span), "deg", f"Mean angle that it can point over, {told}")
    context.add("workspace.force", force, "N", "Force that the loaded workspace is for")
    off = context.add(
        "workspace.mujoco",
        _off_mujoco(inst),
        "m",
        "Largest distance, or entry of rotation, from where MuJoCo puts a body",
    )
    rows = [
        [
            told,
            fixed(np.degrees(space.bend), 1),
            fixed(1e4 * space.area, 0),
            fixed(1e4 * space.area_with(WIDE), 0),
            fixed(np.degrees(space.mean_span), 1),
        ]
        for told, space in (("no load", free), (f"{force:.3g} N", loaded))
    ]
    table = Table(
        "Workspace in the plane of the pan.",
        ("load", "output angle to [deg]", "area [cm²]", f"area with ≥ {np.degrees(WIDE):g}° [cm²]", "mean span [deg]"),
        rows,
    )
    text = (
        f"<p>{named(inst)} as the chain of Fig. 1: spherical and prismatic joint at the port, then yaw, pitch and roll "
        f"of the end-effector; a stem of {1e3 * lengths.stem_length:.0f} mm. Pan and insertion bring the tip to a "
        "place; the bending joints tell from which directions the end-effector can work there. A load takes from "
        f"these, for the handle's range ends before the output angle is reached: one of {force:.3g} N "
        f"{_taken(free, loaded)}. Compensation "
        "by the motors gives that back, as far as their stroke goes. Limits of pan and insertion are our choice where "
        f"the file has none. All bodies stand where MuJoCo puts those of the exported model, to {number(off, 1)} m, "
        "and as entries of rotation matrices.</p>"
    )
    return Section("workspace", title, text, plots=[_plot(inst, force, free, loaded)], tables=[table])


def _taken(free: Workspace, loaded: Workspace) -> str:
    """Return what a load takes, as part of a sentence."""
    span, area = (
        100 * (1 - after / before) for before, after in ((free.mean_span, loaded.mean_span), (free.area, loaded.area))
    )
    return f"takes {span:.0f} % of the mean span of directions and {area:.0f} % of the area that the tip gets to"


def _force(inst: Instrument) -> float:
    """Return a load that the instrument is told to work under: the largest."""
    return max(inst.conditions.forces, default=1.0)


def _off_mujoco(inst: Instrument) -> float:
    """Return how far the bodies are from MuJoCo's at random postures, m and as entries of rotation matrices."""
    random = np.random.default_rng(0)
    postures = []
    for _ in range(_POSTURES):
        drawn = {key: float(random.uniform(*ends)) for key, ends in kinematics.limits(inst)._asdict().items()}
        handle = {f"handle_{axis}": float(random.uniform(-1, 1)) * inst.axis(axis).handle_range for axis in inst.axes}
        postures.append(Posture(**drawn, **handle))
    joints = [kinematics.joint_positions(inst, posture) for posture in postures]
    worst = 0.0
    for posture, theirs in zip(postures, kinematics_peers.mujoco_poses(kinematics.mjcf(inst), joints), strict=True):
        for name, frame in kinematics.frames(inst, posture).bodies.items():
            position, rotation = theirs[name]
            turned = Rotation.from_quat(frame.quaternion, scalar_first=True).as_matrix()
            worst = max(worst, float(np.abs(frame.position - position).max()))
            worst = max(worst, float(np.abs(turned - rotation).max()))
    return worst


def _plot(inst: Instrument, force: float, free: Workspace, loaded: Workspace) -> Plot:
    fig, axes = style.figure(3, width=10.5, height=3.6)
    shades = Normalize(0.0, float(np.degrees(free.span.max())))
    for axis, space, told in ((axes[0], free, "no load"), (axes[1], loaded, f"{force:.3g} N against flexion")):
        _draw(axis, space, shades)
        axis.set(title=told, xlabel="x [mm]", ylabel="z, into the patient [mm]" if axis is axes[0] else "")
    fig.colorbar(
        ScalarMappable(shades, "viridis"), ax=list(axes[:2]), label="span of directions [deg]", shrink=0.8, pad=0.02
    )
    forces = np.linspace(0.0, 2 * force, _FORCES)
    spaces = [kinematics.workspace(inst, float(one), points=61) for one in forces]
    span = np.degrees([space.mean_span for space in spaces])
    bend = np.degrees([space.bend for space in spaces])
    axes[2].plot(forces, span, color=style.ACCENT, label="mean span of directions")
    axes[2].plot(forces, 2 * bend, color=style.INK, label="span of output angles")
    axes[2].axvline(force, color=style.REFERENCE, lw=1, ls=":")
    axes[2].set(title="what a load leaves", xlabel="tip force [N]", ylabel="[deg]", ylim=(0, 2.5 * bend.max() + 1))
    axes[2].legend(loc="upper right")
    caption = (
        "Workspace through the port in the plane of the pan: shade is the angle over which the end-effector can point "
        "at a place. Right: the same, averaged, by load."
    )
    curves = {
        "force [N]": forces,
        "mean span of directions [deg]": span,
        "largest output angle [deg]": bend,
        **_by_distance(free, "no load"),
        **_by_distance(loaded, f"{force:.3g} N"),
    }
    return Plot("workspace_section", caption, fig, curves)


def _draw(axis: Axes, space: Workspace, shades: Normalize) -> None:
    angle, distance = np.meshgrid(space.angle, 1e3 * space.distance, indexing="ij")
    x, z = distance * np.sin(angle), distance * np.cos(angle)
    span = np.degrees(space.span)
    levels = np.linspace(0.0, shades.vmax or 1.0, _SHADES + 1)
    levels[0] = 1e-3 * levels[-1]  # where the tip cannot be is left white
    axis.contourf(x, z, span, levels, norm=shades, cmap="viridis")
    wide = axis.contour(x, z, np.degrees(space.span), [np.degrees(WIDE)], colors="white", linewidths=1.0)
    axis.clabel(wide, fmt=lambda level: f"{level:.0f}°", fontsize=7)
    axis.plot(0, 0, "o", color=style.ACCENT, ms=5)
    axis.annotate("port", (0, 0), (6, -3), textcoords="offset points", color=style.ACCENT)
    axis.set(aspect="equal", ylim=(-0.15 * distance.max(), 1.05 * distance.max()))


def _by_distance(space: Workspace, told: str) -> dict[str, np.ndarray]:
    """Return the mean span by distance from the port, within what the tip gets to there."""
    inside = space.span > 0
    share = np.where(inside, space.span, 0).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)
    return {
        f"distance from the port, {told} [mm]": 1e3 * space.distance,
        f"mean span of directions there, {told} [deg]": np.degrees(share),
    }

"""An instrument in space: links as cylinders, gears and pulleys as wheels, tendons as lines along their routes."""

from math import pi
from pathlib import Path
from typing import Any, Literal, TypeAlias

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import ArrayLike

from tenodesis.instrument import FullForm, Joint
from tenodesis.kinematics import Frame, Frames, frames
from tenodesis.kinematics.chain import STEM, Array, bend_side, rotated
from tenodesis.kinematics.parts import parts
from tenodesis.report import style
from tenodesis.report.routing import tendon_colours

_SIDES = 20  # of a cylinder
_THICK = 0.3  # wheels, over their radius
_STUB = 0.25  # of the stem that is drawn, over the length of the joints at its end
_METAL, _WHEEL, _BACKBONE = "#b0b8c2", "#c4a05a", "#7d8794"
_VIEW = {"elev": 18.0, "azim": -62.0}
_End: TypeAlias = Literal["handle", "tip"]


def draw(inst: FullForm, angles: ArrayLike = 0.0, handle_angles: ArrayLike = 0.0) -> Figure:
    """Return the picture of an instrument at angles (rad): its tip, and its handle if it has joints.

    Each end has its own scale, and a piece of the stem.
    """
    ends: list[_End] = ["handle", "tip"] if inst.handle_joints else ["tip"]
    bent = frames(inst, angles, handle_angles)
    with style.applied():
        fig = style.StyledFigure(figsize=(4.2 * len(ends), 4.6))
        for place, end in enumerate(ends, 1):
            axis: Any = fig.add_subplot(1, len(ends), place, projection="3d", computed_zorder=False)
            _draw_end(axis, inst, end, bent)
        handles = [mpl.lines.Line2D([], [], color=colour, lw=1.4) for colour in tendon_colours(len(inst.tendons))]
        fig.legend(handles, [tendon.name for tendon in inst.tendons], loc="lower center", ncols=3, fontsize=7.5)
        fig.subplots_adjust(0, 0.1, 1, 0.95, 0, 0)
    return fig


def write(path: Path, inst: FullForm, angles: ArrayLike, handle_angles: ArrayLike = 0.0) -> None:
    """Write the picture as SVG, PNG or PDF."""
    with mpl.rc_context({"svg.fonttype": "none"}):
        draw(inst, angles, handle_angles).savefig(path, metadata={"Date": None} if path.suffix == ".svg" else None)


def _draw_end(axis: Any, inst: FullForm, end: _End, bent: Frames) -> None:
    tree = {part.name: part for part in parts(inst, "urdf")}
    joints = [joint for joint in inst.joints if joint.place == end]
    names = [name for joint in joints for name in tree if name.rpartition("_")[0] == joint.name]
    reach, length = sum(abs(tree[name].offset) for name in names), inst.stem_length or STEM
    stub = min(_STUB * reach, length / 2)
    cut = -stub if end == "tip" else stub - length
    thick = (tree["stem"].cylinder or (0.0, 0.0, 0.0))[2]
    backbones = {f"{joint}_carrier" for joint in bent.backbones}
    solids = [(_cylinder(thick, *sorted((cut, 0.0 if end == "tip" else -length))), _METAL)]
    for name in names:
        cylinder = tree[name].cylinder
        if cylinder is not None and name not in backbones:
            start, stop, radius = cylinder
            solids.append((_placed(_cylinder(radius, start, stop), bent.bodies[name]), _METAL))
    for joint in joints:
        if joint.name in bent.backbones:
            axis.plot(*bent.backbones[joint.name].T, color=_BACKBONE, lw=5, zorder=1)
        if joint.mechanism == "continuum" or joint.is_twist:
            continue
        wheels = (bent.bodies.get(f"{joint.name}_{part}") for part in ("carrier", "far"))
        solids += [(_wheel(joint, frame), _WHEEL) for frame in wheels if frame is not None]
    faces = [face for solid, _ in solids for face in solid]
    tints = [tint for solid, tint in solids for _ in solid]
    axis.add_collection3d(Poly3DCollection(faces, facecolors=tints, shade=True, alpha=0.55, lw=0, zorder=2))
    shown = [np.concatenate(faces)]
    for path, colour in zip(bent.tendons.values(), tendon_colours(len(inst.tendons)), strict=True):
        shown.append(_cut(path, end, cut, -length / 2))
        axis.plot(*shown[-1].T, color=colour, lw=1.4, zorder=3)
    points = np.concatenate(shown)
    centre, half = (points.max(0) + points.min(0)) / 2, np.ptp(points, axis=0).max() / 2
    for key, middle in zip("xyz", centre, strict=True):
        getattr(axis, f"set_{key}lim")(middle - half, middle + half)
    axis.set_box_aspect((1, 1, 1), zoom=1.5)
    axis.view_init(**_VIEW)
    axis.set_axis_off()
    axis.set_title(end)


def _cut(path: Array, end: _End, cut: float, middle: float) -> Array:
    """Return the part of a tendon (n, 3) at one end, from where it leaves the drawn piece of the stem."""
    beyond = int(np.argmax(path[:, 2] > middle))
    if not beyond:
        return path if end == "tip" else path[:0]
    near, far = path[beyond - 1], path[beyond]
    at = near + (far - near) * (cut - near[2]) / (far[2] - near[2])
    return np.vstack([at, path[beyond:]] if end == "tip" else [path[:beyond], at])


def _cylinder(radius: float, start: float, end: float) -> list[Array]:
    """Return the faces (4, 3) of a cylinder along z."""
    around = 2 * pi * np.arange(_SIDES) / _SIDES
    ring = radius * np.column_stack([np.cos(around), np.sin(around), np.zeros(_SIDES)])
    after = np.roll(ring, -1, axis=0)
    low, high = (0, 0, start), (0, 0, end)
    sides = np.stack([ring + low, after + low, after + high, ring + high], axis=1)
    fan = np.stack([0 * ring, ring, after, np.roll(ring, -2, axis=0)], axis=1)[::2]
    return [*sides, *(fan + low)[:, ::-1], *(fan + high)]


def _wheel(joint: Joint, frame: Frame) -> list[Array]:
    """Return the faces of a gear or pulley about a joint's axis."""
    axis = np.array(joint.axis_vector)
    side = bend_side(joint.axis_vector)
    basis = np.stack([side, np.cross(axis, side), axis])
    half = _THICK * joint.radius / 2
    return _placed([face @ basis for face in _cylinder(joint.radius, -half, half)], frame)


def _placed(faces: list[Array], frame: Frame) -> list[Array]:
    return [rotated(frame.quaternion, face) + frame.position for face in faces]

"""The parts of an instrument from the glTF file of its assembly, to be drawn in place of plain solids."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh

from tenodesis import _core, kinematics
from tenodesis.console.solids import Solid, about
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument
from tenodesis.instrument.joints import AXES, MECHANISMS
from tenodesis.kinematics.chain import rotated
from tenodesis.kinematics.gltf import BODY_NODE, described
from tenodesis.run import Array

DISC = "disc "
"""Begin of the name of the body of a backbone's disc; its distance along the backbone, m, follows."""
_LEFT_OUT = ("bench", "rig_bar", "rod")
"""Bodies that the page does not draw: the bench, and the backbone, which it draws as a line."""
_SAME = 1e-6  # m
_STRAIGHT = 1e-6  # rad
_TUBE = 0.35
"""Opacity of the stem's tube, through which the tendons are seen."""


class Assembly(NamedTuple):
    """Parts of an instrument in the frames of its bodies, of a planar one of one axis, yaw; :func:`load` makes it."""

    described: Mapping[str, str | float]
    """Joint type and lengths of the instrument, m, or those of its joints."""
    solids: tuple[Solid, ...]

    def differs(self, inst: Instrument) -> str:
        """Return how an instrument differs from the one whose parts these are; nothing where they are its own."""
        if inst.short_form is not None and len(inst.short_form.axes) > 1:
            return f"{inst.name} has two bending axes, the solids have one"
        for key, value in described(inst).items():
            given: Any = self.described.get(key)
            if isinstance(value, str):
                if given != value:
                    return f"{key} is {value}, that of the solids {given or 'missing'}"
            elif not isinstance(given, int | float) or abs(given - value) > _SAME:
                shown = f"{1e3 * given:.6g} mm" if isinstance(given, int | float) else "missing"
                return f"{key} of {inst.name} is {1e3 * value:.6g} mm, that of the solids {shown}"
        return ""

    def of(self, inst: Instrument, stem_length: float) -> list[Solid]:
        """Return the parts for an instrument, its axis of any name if it has one, its stem cut to a length, m."""
        axis = "yaw" if inst.short_form is None else inst.short_form.axes[0]
        short, turned = float(self.described["stem_length"]) - stem_length, about(AXES[axis])
        found = []
        for solid in self.solids:
            mesh = solid.mesh.copy()
            if solid.body == "stem":
                # What belongs to the handle's end comes nearer.
                mesh.vertices[:, 2] += np.where(mesh.vertices[:, 2] < -(stem_length + short) / 2, short, 0.0)
            mesh.apply_transform(turned)
            found.append(solid._replace(body=solid.body.replace("yaw", axis), mesh=mesh))
        return found


def load(path: Path) -> Assembly:
    """Read the glTF file of an assembly that tenodesis cad has written.

    Raises ArgumentError if it cannot be read, or is no such file.
    """
    try:
        scene: Any = trimesh.load(path)
        return Assembly(dict(scene.metadata["tenodesis"]), tuple(_solids_of(scene)))
    except Exception as problem:
        reason = str(problem) if isinstance(problem, OSError | ValueError) else "no file of tenodesis cad"
        raise ArgumentError(
            f"{path} cannot be shown: {reason}; it must be the assembly.glb that tenodesis cad has written.",
            key="solids",
            value=str(path),
        ) from None


def _solids_of(scene: Any) -> Iterator[Solid]:
    parents = scene.graph.transforms.parents
    for name in scene.graph.nodes_geometry:
        body = str(parents[name]).removeprefix(BODY_NODE)
        if body in _LEFT_OUT:
            continue
        place, geometry = scene.graph.get(name, frame_from=parents[name])
        shape = scene.geometry[geometry]
        red, green, blue = (int(share) for share in shape.visual.material.main_color[:3])
        mesh = trimesh.Trimesh(shape.vertices, shape.faces, process=False)
        if body == "arc":
            # A disc is drawn in a frame of its own.
            body = f"{DISC}{float(place[2, 3])!r}"
        else:
            mesh.apply_transform(place)
        yield Solid(name, body, mesh, (red, green, blue), _TUBE if name == "stem" else None)


def disc_place(near: kinematics.Frame, far: kinematics.Frame, along: float, length: float) -> kinematics.Frame:
    """Return the frame at a distance along an arc of a backbone, of a length, m, from its near end to its far end."""
    first, last = near.quaternion, far.quaternion
    last = last if first @ last >= 0 else -last
    half = float(np.arccos(np.clip(first @ last, -1.0, 1.0)))

    def turned(share: float) -> Array:
        if half < _STRAIGHT:
            return np.asarray(first)
        return np.asarray((np.sin((1 - share) * half) * first + np.sin(share * half) * last) / np.sin(half))

    share = along / length
    # The chord from the arc's begin points half as far round.
    reach = _core.joint_chord(MECHANISMS["continuum"], along, np.array([2 * share * half]))[0]
    chord = reach * rotated(turned(share / 2), np.array([0.0, 0.0, 1.0]))
    return kinematics.Frame(near.position + chord, turned(share))

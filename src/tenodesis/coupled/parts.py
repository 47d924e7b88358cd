"""A coupled instrument as a tree of rigid parts with hinges and slides, from which URDF and MJCF are written."""

from collections.abc import Mapping
from math import radians
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.coupled.description import CoupledInstrument, Joint
from tenodesis.coupled.motion import STEM, Array, angle_rows, chord, end_length
from tenodesis.coupled.reading import CoupledLike, load
from tenodesis.instrument.lengths import STEM_PER_RADIUS
from tenodesis.kinematics.parts import Joint as Hinge
from tenodesis.kinematics.parts import Part, cylinder

Format: TypeAlias = Literal["urdf", "mjcf"]

_VERTEBRAE = 8  # that MuJoCo's backbone is divided into
# A string wraps around a MuJoCo cylinder by a quarter turn while its joint is straight, and leaves it beyond.
_WIDEST_WRAP = radians(80)


class _Piece(NamedTuple):
    """A rigid part of a joint: name, offset from the one before (m), and what moves it."""

    name: str
    offset: float
    hinges: bool = True
    slides: bool = False


def parts(inst: CoupledInstrument, format: Format) -> list[Part]:
    """Return the parts of an instrument for a format, parents first, named as the bodies of :func:`frames`.

    A backbone is its chord between two hinges in URDF, and a row of vertebrae in MuJoCo.
    """
    radii = [joint.radius for joint in inst.tip_joints]
    thick = (STEM_PER_RADIUS * max(radii) if inst.stem_diameter is None else inst.stem_diameter) / 2
    length = inst.stem_length or STEM
    found = [Part("stem", None, 0.0, (), (-length, 0.0, thick))]
    for joint, on, beyond in _stacked(inst):
        side = 1.0 if joint.place == "tip" else -1.0
        at, start = (f"{on}_far", 0.0) if on else ("stem", 0.0 if side > 0 else -length)
        pieces = _pieces(joint, format)
        turning = [f"{joint.name}_{piece.name}" for piece in pieces if piece.hinges]
        share = joint.range / len(turning)
        for place, piece in enumerate(pieces):
            name = f"{joint.name}_{piece.name}"
            offset = start + side * (piece.offset + (joint.offset if place == 0 else 0.0))
            following = pieces[place + 1].offset if place + 1 < len(pieces) else beyond
            first = None if name == turning[0] else turning[0]
            slide = Hinge(f"{joint.name}_chord", "slide", (0.0, 0.0, side), -joint.chord, 0.0)
            hinge = Hinge(name, "hinge", joint.axis_vector, -share, share, same_as=first)
            joints = ((slide,) if piece.slides else ()) + ((hinge,) if piece.hinges else ())
            is_far = piece.name == "far"
            back = -joint.radius / 2 if is_far and joint.mechanism != "continuum" else 0.0
            wide = (0.7 if is_far else 0.5) * joint.radius
            found.append(Part(name, at, offset, joints, cylinder(side * back, side * following, wide)))
            at, start = name, 0.0
        reach = end_length(inst, joint)
        if reach is not None:
            kind, wide = ("tip", 0.4 * thick) if side > 0 else ("grip", 2 * thick)
            body = cylinder(side * (min(beyond, reach) - reach), 0.0, wide)
            found.append(Part(f"{joint.name}_{kind}", at, side * reach, (), body))
    return found


def joint_positions(
    inst: CoupledLike, angles: ArrayLike, handle_angles: ArrayLike = 0.0, *, format: Format = "urdf"
) -> Mapping[str, Array]:
    """Return the positions of the joints of an exported model at angles, rad and m, by name, (...) each.

    Arguments and errors as :func:`frames`.
    """
    inst = load(inst)
    given: dict[str, tuple[Joint, Array]] = {}
    for key, value, joints in (
        ("angles", angles, inst.tip_joints),
        ("handle_angles", handle_angles, inst.handle_joints),
    ):
        columns = np.moveaxis(angle_rows(key, value, joints), -1, 0)
        given |= {joint.name: (joint, column) for joint, column in zip(joints, columns, strict=True)}
    tree = [hinge for part in parts(inst, format) for hinge in part.joints]
    found: dict[str, Array] = {}
    for name, (joint, angle) in given.items():
        own = [hinge for hinge in tree if hinge.name.rpartition("_")[0] == name]
        count = sum(hinge.kind == "hinge" for hinge in own)
        for hinge in own:
            found[hinge.name] = angle / count if hinge.kind == "hinge" else chord(joint, angle) - joint.chord
    return found


def moving(joint: Joint, format: Format) -> list[str]:
    """Return the names of the parts that turn with a joint, each by the same share of its angle."""
    return [f"{joint.name}_{piece.name}" for piece in _pieces(joint, format) if piece.hinges]


def _pieces(joint: Joint, format: Format) -> list[_Piece]:
    if joint.mechanism == "pulley":
        halves = format == "mjcf" and joint.range > _WIDEST_WRAP
        return [_Piece("carrier", 0.0), _Piece("far", 0.0)] if halves else [_Piece("far", 0.0)]
    if joint.mechanism == "tendon-gear" or format == "urdf":
        return [_Piece("carrier", 0.0), _Piece("far", joint.chord, slides=joint.mechanism == "continuum")]
    pitch = joint.chord / _VERTEBRAE
    # In the proportions of Gregory's rule the row reaches as far as the arc, but for a high order of its bends.
    steps = [5 / 12, 13 / 12, *[1.0] * (_VERTEBRAE - 3), 13 / 12]
    row = [_Piece(f"{place}", step * pitch) for place, step in enumerate(steps, 1)]
    return [*row, _Piece("far", 5 / 12 * pitch, hinges=False)]


def _stacked(inst: CoupledInstrument) -> list[tuple[Joint, str, float]]:
    """Return the joints, each with the one that it stands on, if any, and the length to those that stand on it, m."""
    tips, handles = inst.tip_joints, inst.handle_joints
    on = {joint.name: "" if parent < 0 else tips[parent].name for joint, parent in zip(tips, inst.parents, strict=True)}
    on |= {joint.name: handles[place - 1].name if place else "" for place, joint in enumerate(handles)}
    beyond = dict.fromkeys(on, 0.0)
    for joint in (*tips, *handles):
        if on[joint.name]:
            beyond[on[joint.name]] = max(beyond[on[joint.name]], joint.offset)
    return [(joint, on[joint.name], beyond[joint.name]) for joint in (*tips, *handles)]

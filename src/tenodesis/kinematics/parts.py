"""An instrument as a tree of rigid parts with hinges and slides, from which URDF and MJCF are written."""

from math import radians
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.instrument import InstrumentLike, Joint
from tenodesis.instrument.joints import AXES
from tenodesis.instrument.lengths import STEM_PER_RADIUS
from tenodesis.kinematics.chain import Skeleton, end_length, skeleton
from tenodesis.kinematics.motion import AT_REST, Port, Posture, coordinates, frames
from tenodesis.statics.query import FloatOrArray

Triple = tuple[float, float, float]
Format: TypeAlias = Literal["urdf", "mjcf"]

Z: Triple = (0.0, 0.0, 1.0)
STEEL = 7800.0
"""Density of the parts, which are solid, kg/m^3."""
_VERTEBRAE = 8  # that MuJoCo's backbone is divided into
_HINGES_OF_ARC = 6  # of a backbone in several; with four each, MuJoCo's would be 0.07 deg off
# A string wraps around a MuJoCo cylinder by a quarter turn while its joint is straight, and leaves it beyond.
_WIDEST_WRAP = radians(80)


class PartJoint(NamedTuple):
    """A hinge or slide of a part, in its own frame; limits in rad or m."""

    name: str
    kind: Literal["hinge", "slide"]
    axis: Triple
    least: float
    most: float
    same_as: str | None = None
    """Joint that it moves with."""
    ratio: float = 1.0
    """Its angle over that joint's."""


class RigidPart(NamedTuple):
    """A rigid part: its parent, its offset along the parent's z when all joints are at zero, its joints, a cylinder."""

    name: str
    parent: str | None
    offset: float
    joints: tuple[PartJoint, ...]
    cylinder: tuple[float, float, float] | None
    """From and to along z, and radius, m."""


class _Piece(NamedTuple):
    """A rigid part of a bending joint: name, offset from the one before (m), and what moves it."""

    name: str
    offset: float
    hinge: Joint | None = None
    slides: bool = False


def parts(inst: InstrumentLike, format: Format) -> list[RigidPart]:
    """Return the parts of an instrument for a format, parents first, named as the bodies of :func:`frames`.

    A backbone is its chord between two hinges in URDF, and a row of vertebrae in MuJoCo. Raises InstrumentError if the
    instrument's lengths leave no stem.
    """
    of = skeleton(inst)
    radii = [joint.radius for joint in of.inst.tip_joints]
    thick = (STEM_PER_RADIUS * max(radii) if of.inst.stem_diameter is None else of.inst.stem_diameter) / 2
    found = [RigidPart("stem", None, 0.0, _in_port(of), (-of.stem_length, 0.0, thick))]
    for joint, on, beyond in _stacked(of):
        side = 1.0 if joint.place == "tip" else -1.0
        at, start = (f"{on}_far", 0.0) if on else ("stem", 0.0 if side > 0 else -of.stem_length)
        pieces = _pieces(of, joint, format)
        first_offset = (of.around(joint) or joint).offset
        for place, piece in enumerate(pieces):
            offset = start + side * (piece.offset + (first_offset if place == 0 else 0.0))
            following = pieces[place + 1].offset if place + 1 < len(pieces) else beyond
            slide = PartJoint(f"{joint.name}_chord", "slide", (0.0, 0.0, side), -_chord(of, joint), 0.0)
            joints: tuple[PartJoint, ...] = (slide,) if piece.slides else ()
            if piece.hinge is not None:
                joints += (_hinge(of, piece.name, piece.hinge, format),)
            is_far = piece.name.endswith("_far")
            back = -joint.radius / 2 if is_far and joint.mechanism != "continuum" else 0.0
            wide = (0.7 if is_far else 0.5) * joint.radius
            found.append(RigidPart(piece.name, at, offset, joints, _cylinder(side * back, side * following, wide)))
            at, start = piece.name, 0.0
        reach = end_length(of.inst, joint)
        if reach is not None:
            found += _end(of, joint, reach, reach - min(beyond, reach), thick)
    return found


def joint_positions(
    inst: InstrumentLike,
    angles: Posture | ArrayLike,
    handle_angles: ArrayLike = 0.0,
    *,
    port: Port = AT_REST,
    format: Format = "urdf",
) -> dict[str, FloatOrArray]:
    """Return the positions of the joints of an exported model, rad and m, by name, (...) each.

    Arguments and errors as :func:`frames`, and NoSolutionError if a posture leaves a single handle angle out and the
    handle cannot bend as far as the output angle requires.
    """
    of = skeleton(inst)
    given = coordinates(inst, angles, handle_angles, port, reachable=True)
    bodies = frames(inst, angles, handle_angles, port=port).bodies
    pieces = {piece.name: (piece, joint) for joint in of.inst.joints for piece in _pieces(of, joint, format)}
    found = {}
    for part in parts(inst, format):
        for joint in part.joints:
            piece, own = pieces.get(part.name, (None, None))
            if piece is None or own is None:
                value = given.port[joint.name]
            elif joint.kind == "hinge":
                assert piece.hinge is not None
                value = given.joints[piece.hinge.name] / len(moving(of, piece.hinge, format))
            else:
                carrier, far = (bodies[f"{own.name}_{end}"].position for end in ("carrier", "far"))
                value = np.linalg.norm(far - carrier, axis=-1) - _chord(of, own)
            found[joint.name] = float(value) if np.ndim(value) == 0 else value
    return found


def moving(of: Skeleton, joint: Joint, format: Format) -> list[str]:
    """Return the names of the parts that turn with a bending joint, each by the same share of its angle."""
    pieces = _pieces(of, of.inside(joint) or joint, format)
    return [piece.name for piece in pieces if piece.hinge is not None and piece.hinge.name == joint.name]


def _hinge(of: Skeleton, name: str, joint: Joint, format: Format) -> PartJoint:
    """Return the hinge by which a part turns with a joint."""
    turning = moving(of, joint, format)
    low, high = (limit / len(turning) for limit in _limits(joint))
    first = None if name == turning[0] or (joint.arc and format == "mjcf") else turning[0]
    ratio = 1.0
    if name == turning[0] and joint.tied_to is not None:
        other = next(one for one in of.inst.tip_joints if one.name == joint.tied_to)
        others = moving(of, other, format)
        first, ratio = others[0], joint.tie_ratio * len(others) / len(turning)
    return PartJoint(name, "hinge", joint.axis_vector, low, high, same_as=first, ratio=ratio)


def _chord(of: Skeleton, joint: Joint) -> float:
    """Return the length of the straight joint, or of that around it, m."""
    return (of.around(joint) or joint).chord


def text(value: float) -> str:
    """Return a number as the text of an attribute, to the last bit."""
    return repr(float(value))


def _in_port(of: Skeleton) -> tuple[PartJoint, ...]:
    """Return the joints of the stem, of an instrument whose file gives a port."""
    if of.port is None:
        return ()
    bounds = of.port
    return (
        PartJoint("pan", "hinge", AXES["yaw"], *bounds.pan),
        PartJoint("tilt", "hinge", AXES["pitch"], *bounds.tilt),
        PartJoint("spin", "hinge", Z, *bounds.spin),
        PartJoint("insertion", "slide", Z, *bounds.insertion),
    )


def _end(of: Skeleton, joint: Joint, reach: float, free: float, thick: float) -> list[RigidPart]:
    """Return what is beyond a last joint, over a free length, m."""
    far = f"{joint.name}_far"
    if joint.place == "handle":
        return [RigidPart(of.end(joint, "grip"), far, -reach, (), _cylinder(0.0, free, 2 * thick))]
    if of.port is None or not of.rolls:
        return [RigidPart(of.end(joint, "tip"), far, reach, (), _cylinder(-free, 0.0, 0.4 * thick))]
    rolled, jaws = of.end(joint, "end_effector"), of.port.jaw_length
    roll = PartJoint("roll", "hinge", Z, *of.port.roll)
    return [
        RigidPart(rolled, far, 0.0, (roll,), (0.0, max(reach - jaws, 0.2 * reach), 0.8 * thick)),
        RigidPart(of.end(joint, "tip"), rolled, reach, (), (-jaws, 0.0, 0.4 * thick)),
    ]


def _limits(joint: Joint) -> tuple[float, float]:
    """Return the angles of a joint's mechanical stops, rad: as given, or the ends of its working range."""
    return joint.limits if joint.stop is None else joint.stops


def _pieces(of: Skeleton, joint: Joint, format: Format) -> list[_Piece]:
    """Return the parts of a joint, from the stem outward; of one around another none: they are the other's."""
    if of.inside(joint) is not None:
        return []
    carrier, far = f"{joint.name}_carrier", f"{joint.name}_far"
    chord, around = _chord(of, joint), of.around(joint)
    if joint.mechanism == "pulley":
        halves = format == "mjcf" and max(map(abs, _limits(joint))) > _WIDEST_WRAP
        return [_Piece(carrier, 0.0, joint), _Piece(far, 0.0, joint)] if halves else [_Piece(far, 0.0, joint)]
    if joint.mechanism == "tendon-gear" or format == "urdf":
        slides = joint.mechanism == "continuum"
        if around is None:
            return [_Piece(carrier, 0.0, joint), _Piece(far, chord, joint, slides)]
        between = _Piece(f"{joint.name}_between", chord, joint, slides)
        return [
            _Piece(f"{around.name}_carrier", 0.0, around),
            _Piece(carrier, 0.0, joint),
            between,
            _Piece(far, 0.0, around),
        ]
    if joint.arc:
        # Hinges in the middle of the pieces, which bend as they are pushed.
        half = chord / _HINGES_OF_ARC / 2
        steps, end = [half] + [2 * half] * (_HINGES_OF_ARC - 1), half
    else:
        pitch = chord / _VERTEBRAE
        # In the proportions of Gregory's rule the row reaches as far as the arc, but for a high order of its bends.
        steps, end = [pitch * step for step in (5 / 12, 13 / 12, *[1.0] * (_VERTEBRAE - 3), 13 / 12)], 5 / 12 * pitch
    row = []
    for place, step in enumerate(steps, 1):
        # In two planes each vertebra turns about both axes, in turn about one of them first.
        axes = [joint] if around is None else [around, joint] if place % 2 else [joint, around]
        row += [_Piece(f"{axis.name}_{place}", 0.0 if n else step, axis) for n, axis in enumerate(axes)]
    return [*row, _Piece(far, end)]


def _stacked(of: Skeleton) -> list[tuple[Joint, str, float]]:
    """Return the joints, each with the one that it stands on, if any, and the length to those that stand on it, m.

    Two joints of which one bends within the other stand on the same one.
    """
    tips, handles = of.inst.tip_joints, of.inst.handle_joints
    parents = zip(tips, of.inst.parents, strict=True)
    on = {joint.name: "" if parent < 0 else tips[parent].name for joint, parent in parents}
    on |= {joint.name: on[joint.within] for joint in tips if joint.within is not None}
    on |= {joint.name: handles[place - 1].name if place else "" for place, joint in enumerate(handles)}
    beyond = dict.fromkeys(on, 0.0)
    for joint in (*tips, *handles):
        if on[joint.name]:
            beyond[on[joint.name]] = max(beyond[on[joint.name]], joint.offset)
    return [(joint, on[joint.name], beyond[joint.name]) for joint in (*tips, *handles)]


def _cylinder(start: float, end: float, radius: float) -> tuple[float, float, float] | None:
    """Return the cylinder of a part between two places along it, m; None if it has no length."""
    return None if start == end else (min(start, end), max(start, end), radius)

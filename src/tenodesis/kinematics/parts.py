"""The instrument as a tree of rigid parts with hinges and slides, from which URDF and MJCF are written."""

from typing import Literal, NamedTuple

import numpy as np

from tenodesis import _core, statics
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.instrument.lengths import Dimensions
from tenodesis.kinematics.dimensions import dimensions, limits
from tenodesis.kinematics.motion import Posture, frames
from tenodesis.statics.query import FloatOrArray

Triple = tuple[float, float, float]

Z: Triple = (0.0, 0.0, 1.0)
BEND: dict[str, Triple] = {"yaw": (0.0, 1.0, 0.0), "pitch": (-1.0, 0.0, 0.0)}
"""Axis that a positive angle turns about, by direction."""
TOWARD: dict[str, Triple] = {"yaw": (1.0, 0.0, 0.0), "pitch": (0.0, 1.0, 0.0)}
"""Side of the agonist, by direction."""

STEEL = 7800.0
"""Density of the parts, which are solid, kg/m^3."""


class Joint(NamedTuple):
    """A hinge or slide of a part, in its own frame; limits in rad or m."""

    name: str
    kind: Literal["hinge", "slide"]
    axis: Triple
    least: float
    most: float
    same_as: str | None = None
    """Joint that it moves with, by the same angle."""


class Part(NamedTuple):
    """A rigid part: its parent, its offset along the parent's z when all joints are at zero, its joints, a cylinder."""

    name: str
    parent: str | None
    offset: float
    joints: tuple[Joint, ...]
    cylinder: tuple[float, float, float] | None
    """From and to along z, and radius, m."""


def parts(inst: ShortForm) -> list[Part]:
    """Return the parts of an instrument, parents first, named as the bodies of :func:`frames`.

    Raises InstrumentError if the instrument's lengths leave no stem.
    """
    lengths, bounds = dimensions(inst), limits(inst)
    thick = lengths.stem_diameter / 2
    stem = Part(
        "stem",
        None,
        0.0,
        (
            Joint("pan", "hinge", BEND["yaw"], *bounds.pan),
            Joint("tilt", "hinge", BEND["pitch"], *bounds.tilt),
            Joint("spin", "hinge", Z, *bounds.spin),
            Joint("insertion", "slide", Z, *bounds.insertion),
        ),
        (-lengths.stem_length, 0.0, thick),
    )
    jaws = lengths.end_effector_length - lengths.jaw_length
    found = [stem, *_stack(inst, lengths, distal=True)]
    found += [
        Part(
            "end_effector",
            found[-1].name,
            0.0,
            (Joint("roll", "hinge", Z, *bounds.roll),),
            (0.0, max(jaws, 0.2 * lengths.end_effector_length), 0.8 * thick),
        ),
        Part("tip", "end_effector", lengths.end_effector_length, (), (-lengths.jaw_length, 0.0, 0.4 * thick)),
    ]
    handle = _stack(inst, lengths, distal=False)
    grip = Part("grip", handle[-1].name, -lengths.handle_length, (), (0.0, lengths.handle_length, 2 * thick))
    return [*found, *handle, grip]


def joint_positions(inst: InstrumentLike, posture: Posture) -> dict[str, FloatOrArray]:
    """Return the positions of the joints of an exported model at a posture, rad and m, by name.

    Raises
    ------
    ValueError, InstrumentError
        As :func:`forward`.
    NoSolutionError
        A single handle angle is left out, and the handle cannot bend as far as its output angle requires.
    """
    inst = as_short_form(inst)
    given = posture._asdict()
    if posture.insertion is None:
        given["insertion"] = dimensions(inst).insertion
    for name, planar in zip(inst.axes, inst.planar, strict=True):
        if given[f"handle_{name}"] is None:
            given[f"handle_{name}"] = statics.handle_angle(planar, given[name])
    bodies = frames(inst, Posture(**given)).bodies
    found: dict[str, FloatOrArray] = {}
    for part in parts(inst):
        for joint in part.joints:
            if joint.name in given:
                found[joint.name] = given[joint.name]
                continue
            bend = part.name.rpartition("_")[0]
            if joint.kind == "slide":
                apart = bodies[part.name].position - bodies[f"{bend}_carrier"].position
                found[joint.name] = np.linalg.norm(apart, axis=-1) - abs(part.offset)
            else:
                found[joint.name] = np.asarray(given[bend]) / 2
    return {name: float(value) if np.ndim(value) == 0 else np.asarray(value) for name, value in found.items()}


def _stack(inst: ShortForm, lengths: Dimensions, *, distal: bool) -> list[Part]:
    """Return the parts of the bending joints at an end, from the stem outward; they point to -z at the handle."""
    end, side = ("", 1.0) if distal else ("handle_", -1.0)
    spacing = side * (lengths.joint_spacing if distal else lengths.handle_joint_spacing)
    on, offset = "stem", 0.0 if distal else -lengths.stem_length
    found = []
    for place, (axis, planar) in enumerate(zip(lengths.axes, inst.planar, strict=True)):
        chords = _core.joint_lengths(planar.spec)
        chord = side * (chords[0] if distal else chords[1])
        radius = (lengths.distal_radii if distal else lengths.proximal_radii)[place]
        half = (planar.output_stop if distal else planar.handle_range) / 2
        name = f"{end}{axis}"
        carrier = Joint(f"{name}_carrier", "hinge", BEND[axis], -half, half)
        far = Joint(f"{name}_far", "hinge", BEND[axis], -half, half, same_as=carrier.name)
        # A backbone bends along its length, so that its chord shortens.
        bends_along = distal and inst.joint_type == "continuum"
        slides = (Joint(f"{name}_chord", "slide", Z, -abs(chord), 0.0),) if bends_along else ()
        link = spacing if place + 1 < len(lengths.axes) else 0.0
        found += [
            Part(carrier.name, on, offset, (carrier,), cylinder(0.0, chord, 0.5 * radius)),
            Part(far.name, carrier.name, chord, (*slides, far), cylinder(-side * radius / 2, link, 0.7 * radius)),
        ]
        on, offset = far.name, spacing
    return found


def text(value: float) -> str:
    """Return a number as the text of an attribute, to the last bit."""
    return repr(float(value))


def cylinder(start: float, end: float, radius: float) -> tuple[float, float, float] | None:
    """Return the cylinder of a part between two places along it, m; None if it has no length."""
    return None if start == end else (min(start, end), max(start, end), radius)

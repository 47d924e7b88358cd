"""The assembly at given angles: where its parts are, whether they overlap, and whether its gears mesh."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from tenodesis import kinematics
from tenodesis.cad import kernel as k
from tenodesis.cad.backbone_parts import Backbone, arc_place, bent_rod
from tenodesis.cad.gears import GearJoint
from tenodesis.cad.kernel import Location, Solid
from tenodesis.cad.model import Model
from tenodesis.cad.parts import Part
from tenodesis.errors import ArgumentError
from tenodesis.kinematics import Posture
from tenodesis.run import Array

_TOUCHING = 1e-3
"""Shared volume, mm³, below which parts count as touching only."""
Progress = Callable[[float, float, str], None]
Placing = Callable[[Part, Location], Location]
"""The place of a part's body, by the part and its place in it."""


class Placed(NamedTuple):
    """A part at one of its places in the assembly."""

    part: Part
    number: int
    """Of its places, from 0."""
    solid: Solid

    @property
    def name(self) -> str:
        """Its part's name, with its number where there are several."""
        return self.part.name if len(self.part.places) == 1 else f"{self.part.name}_{self.number + 1}"


class Overlap(NamedTuple):
    """Two parts that share a volume, m³, at an output and a handle angle, rad."""

    first: str
    second: str
    volume: float
    output_angle: float
    handle_angle: float


def assembled(
    model: Model, output_angle: float = 0.0, handle_angle: float | None = None, *, exploded: float = 0.0
) -> list[Placed]:
    """Return all parts in their places in the frame of the stem's distal end, mm, at angles in rad.

    Without a handle angle it is that of the output angle without a load (eq. 18). A share `exploded` moves parts apart.
    Raises ValueError if the handle cannot bend as far.
    """
    frame = frames_of(model, output_angle, handle_angle)
    found = []
    for part in model.parts:
        x, y, z = part.away
        away = k.at(exploded * x, exploded * y, exploded * z)
        for number, place in enumerate(part.places):
            solid = bent_rod(backbone_of(model), output_angle) if part.body == "rod" else part.solid
            found.append(Placed(part, number, frame(part, place) * away * own_place(place, part) * solid))
    return found


def interference(
    model: Model, output_angles: Sequence[float], handle_angles: Sequence[float] = (), progress: Progress | None = None
) -> list[Overlap]:
    """Return parts that overlap by more than 0.001 mm³ at any of the output angles, or of the handle angles, rad.

    Parts at one end of the stem are compared at every angle of that end, all parts at the first angle.
    """
    postures = [(angle, 0.0) for angle in output_angles] + [(0.0, angle) for angle in handle_angles]
    found: list[Overlap] = []
    for done, (output, handle) in enumerate(postures):
        if progress is not None:
            progress(done, len(postures), "interference")
        placed = assembled(model, output, handle)
        boxes = [k.bounds(one.solid) for one in placed]
        at_tip = done < len(output_angles)
        for number, one in enumerate(placed):
            for beyond, other in enumerate(placed[number + 1 :], start=number + 1):
                (low, high), (least, most) = boxes[number], boxes[beyond]
                if (low >= most).any() or (high <= least).any():
                    continue
                fixed = one.part.body == other.part.body and one.part.body != "arc"
                if done and (fixed or not (_moves(one, at_tip) or _moves(other, at_tip))):
                    continue
                volume = k.common_volume(one.solid, other.solid)
                if volume > _TOUCHING:
                    found.append(Overlap(one.name, other.name, volume * 1e-9, output, handle))
    return found


def mesh_play(model: Model, output_angle: float, *, tip: bool = True) -> tuple[float, float]:
    """Return how far a gear pair's far body can turn about its axis either way until its teeth touch, rad.

    The two angles are the backlash that the solids have; found by bisection, to a tenth of the process's backlash.
    Raises ValueError if the joint is no gear pair.
    """
    names = ("tip_gear_near", "tip_gear_far") if tip else ("handle_gear_near", "handle_gear_far")
    if model.instrument.joint_type != "tendon-gear":
        raise ArgumentError(key="model", value=model.instrument.joint_type, allowed="an instrument of gear pairs")
    angles = (output_angle, 0.0) if tip else (0.0, output_angle)
    near, far = (next(one for one in assembled(model, *angles) if one.name == name) for name in names)
    frame = frames_of(model, *angles)(far.part, k.at())
    # Only the teeth about the point of contact matter.
    joint = model.joints[0 if tip else 1]
    assert isinstance(joint, GearJoint)
    reach = 3 * joint.gear.module
    window = k.at(z=(1 if tip else -1) * joint.gear.pitch_radius) * k.box(*[(-reach, reach)] * 3)
    window = frames_of(model, *angles)(model.part("tip_link" if tip else "handle_link"), k.at()) * window
    teeth = k.common(near.solid, window)
    back = frame.inverse() * k.common(far.solid, window)
    found = []
    for side in (1, -1):
        usual = joint.gear.backlash / (2 * joint.gear.pitch_radius)
        free, stuck = 0.0, 3 * usual
        while stuck - free > usual / 10:
            middle = (free + stuck) / 2
            turned = frame * k.turned_about_y(side * middle) * back
            free, stuck = (free, middle) if k.common_volume(teeth, turned) > 1e-4 else (middle, stuck)
        found.append(free)
    return found[0], found[1]


def frames_of(model: Model, output_angle: float, handle_angle: float | None) -> Placing:
    """Return the function that places a part's body, by the part and its place."""
    inst = model.instrument
    frames = kinematics.frames(inst, Posture(yaw=output_angle, handle_yaw=handle_angle))
    stem = frames.bodies["stem"].position
    places = {}
    for name, frame in frames.bodies.items():
        x, _, z = k.MM * (frame.position - stem)
        w, _, y, _ = frame.quaternion
        places[name] = (float(x), float(z), 2 * math.atan2(float(y), float(w)))
    if not np.isfinite(places["grip"]).all():
        raise ArgumentError(
            key="output_angle",
            value=output_angle,
            allowed=f"within what the handle of {inst.name} reaches, or given with a handle_angle",
        )
    tip, pivot = places["tip"], model.rig.pivot
    places["rig_bar"] = (0.0, pivot, math.atan2(tip[0], tip[1] - pivot))

    def placed(part: Part, place: Location) -> Location:
        if part.body in ("bench", "rod"):
            return k.at()
        if part.body == "arc":
            return arc_place(place.position.Z, backbone_of(model).length, output_angle)
        x, z, turn = places[part.body]
        return k.at(x, 0.0, z) * k.turned_about_y(turn)

    return placed


def own_place(place: Location, part: Part) -> Location:
    """Return a part's place within its body; that along a backbone is already part of its frame."""
    return k.at() if part.body == "arc" else place


def backbone_of(model: Model) -> Backbone:
    """Return the backbone of an instrument that has one."""
    joint = model.joints[0]
    assert isinstance(joint, Backbone)
    return joint


def _moves(one: Placed, at_tip: bool) -> bool:
    body = one.part.body
    if body in ("bench", "stem"):
        return False
    return body.startswith("handle_") != at_tip


def matrix(place: Location) -> Array:
    """Return a place as a matrix (4, 4), mm."""
    transformation = place.wrapped.Transformation()
    return np.array(
        [[transformation.Value(row, column) for column in range(1, 5)] for row in range(1, 4)] + [[0, 0, 0, 1]]
    )

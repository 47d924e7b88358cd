"""The assembly at given angles: where its parts are, whether they overlap, and whether its gears mesh."""

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import kinematics, statics
from tenodesis.cad import kernel as k
from tenodesis.cad.backbone_parts import Backbone, arc_place, bent_rod
from tenodesis.cad.gears import GearJoint
from tenodesis.cad.kernel import Location, Solid
from tenodesis.cad.model import Model, Station
from tenodesis.cad.parts import Part
from tenodesis.errors import ArgumentError
from tenodesis.run import Array

_TOUCHING = 1e-3
"""Shared volume, mm³, below which parts count as touching only."""
_STILL = 1e-7
"""To which places of parts against each other are told apart, mm and of unit vectors."""
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
    """Two parts that share a volume, m³, at an output and a handle angle, rad: of several joints the largest."""

    first: str
    second: str
    volume: float
    output_angle: float
    handle_angle: float


def assembled(
    model: Model, output_angle: ArrayLike = 0.0, handle_angle: ArrayLike | None = None, *, exploded: float = 0.0
) -> list[Placed]:
    """Return all parts in their places in the frame of the stem's distal end, mm, at angles in rad.

    Angles are of the joints of the tip, and of the handle, or one for all. Without a handle angle it is that of the
    output angle without a load (eq. 18). A share `exploded` moves parts apart. Raises ValueError if the handle cannot
    bend as far.
    """
    frame = frames_of(model, output_angle, handle_angle)
    found = []
    for part in model.parts:
        x, y, z = part.away
        away = k.at(exploded * x, exploded * y, exploded * z)
        for number, place in enumerate(part.places):
            if part.body == "rod":
                found.append(Placed(part, number, away * _bent_rod(model, output_angle, frame)))
            else:
                found.append(Placed(part, number, frame(part, place) * away * place * part.solid))
    return found


class BenchPosture(NamedTuple):
    """Angles of the joints of tip and handle, rad, and whether the load rig stands there."""

    tip: Array
    handle: Array
    with_rig: bool


def postures(model: Model, output_angles: Sequence[float], handle_angles: Sequence[float] = ()) -> list[BenchPosture]:
    """Return the straight posture, each joint bent to each of the angles, and all of an end at once to their ends.

    Angles are those of the first joint at either end, or of its backbone, rad; the others are bent to the same shares
    of their ranges, arcs of a backbone alike. The rig stands where it loads the first joint; for the others the
    instrument is turned and moved in its clamps.
    """
    still = np.zeros(len(model.at(tip=True))), np.zeros(len(model.at(tip=False)))
    found = []
    for place, angles in enumerate((output_angles, handle_angles)):
        limits = _limits(model, tip=place == 0)
        if not len(limits):
            continue
        # Ends of the ranges over that of the first joint.
        ends = limits / np.abs(limits[0]).max()
        bent = [
            (number == 0, abs(angle) * ends[number, int(angle > 0)] * np.eye(len(ends))[number])
            for number in range(len(ends))
            for angle in angles
            if number == 0 or angle != 0
        ]
        if len(ends) > 1 and angles:
            most = max(map(abs, angles))
            bent += [(False, most * np.array(corner)) for corner in product(*ends)]
        if place == 0:
            bent = [(alone, model.instrument.expanded.bent(row)) for alone, row in bent]
        for alone, row in bent:
            found.append(
                BenchPosture(_held(model, row), still[1], alone) if place == 0 else BenchPosture(still[0], row, True)
            )
    return found


def _limits(model: Model, *, tip: bool) -> Array:
    """Return the ends of the ranges of what bends by itself at an end, (bends, 2), rad."""
    if tip:
        return model.instrument.expanded.bend_limits
    return np.array([one.joint.limits for one in model.at(tip=False)])


def ranges(model: Model, *, tip: bool) -> Array:
    """Return the largest angles of what bends by itself at an end, (bends,), rad: of joints, or of backbones."""
    limits = _limits(model, tip=tip)
    return np.abs(limits).max(axis=1) if len(limits) else np.zeros(0)


def _held(model: Model, angles: Array) -> Array:
    """Return angles of the tip's joints at which jaws that would pass through each other touch, on the middle."""
    arms = model.instrument.expanded.grip_arms
    jaws = np.flatnonzero(arms)
    if len(jaws) < 2 or arms @ angles >= 0:
        return angles
    return np.where(arms != 0, angles[jaws].mean(), angles)


def interference(
    model: Model, output_angles: Sequence[float], handle_angles: Sequence[float] = (), progress: Progress | None = None
) -> list[Overlap]:
    """Return parts that overlap by more than 0.001 mm³ at any of the output angles, or of the handle angles, rad.

    Angles are those of the first joint at either end; of several, each is bent to the same shares of its range, and
    last all of an end at once to their limits. The load rig stands there for the first joint alone. All parts are
    compared in the first posture, and in the others those that have not been placed so before.
    """
    found: list[Overlap] = []
    compared: set[tuple[str, str, tuple[float, ...]]] = set()
    every = postures(model, output_angles, handle_angles)
    for done, posture in enumerate(every):
        if progress is not None:
            progress(done, len(every), "interference")
        placed = assembled(model, posture.tip, posture.handle)
        frame = frames_of(model, posture.tip, posture.handle)
        places = [matrix(frame(one.part, one.part.places[one.number])) for one in placed]
        boxes = [k.bounds(one.solid) for one in placed]
        for number, one in enumerate(placed):
            back = np.linalg.inv(places[number])
            for beyond, other in enumerate(placed[number + 1 :], start=number + 1):
                if done and not posture.with_rig and (_is_rig(one.part) or _is_rig(other.part)):
                    continue
                bent = posture.tip if "rod" in (one.part.body, other.part.body) else posture.tip[:0]
                apart = np.concatenate([(back @ places[beyond]).ravel(), bent])
                pair = (one.name, other.name, tuple((apart / _STILL).round().tolist()))
                if pair in compared:
                    continue
                compared.add(pair)
                (low, high), (least, most) = boxes[number], boxes[beyond]
                if (low >= most).any() or (high <= least).any():
                    continue
                volume = k.common_volume(one.solid, other.solid)
                if volume > _TOUCHING:
                    output, handle = (
                        float(max(angles, key=abs, default=0.0)) for angles in (posture.tip, posture.handle)
                    )
                    found.append(Overlap(one.name, other.name, volume * 1e-9, output, handle))
    return found


def _is_rig(part: Part) -> bool:
    return part.name.startswith("rig_")


def mesh_play(model: Model, output_angle: float, *, tip: bool = True, joint: int = 0) -> tuple[float, float]:
    """Return how far a gear pair's far body can turn about its axis either way until its teeth touch, rad.

    The two angles are the backlash that the solids have; found by bisection, to a tenth of the process's backlash. The
    joint is the first at its end, or another by its number. Raises ValueError if the joint is no gear pair.
    """
    station = model.at(tip=tip)[joint]
    sizes, end = station.sizes, station.end
    if not isinstance(sizes, GearJoint):
        raise ArgumentError(key="model", value=station.joint.mechanism, allowed="an instrument of gear pairs")
    angles = [np.zeros(len(model.at(tip=True))), np.zeros(len(model.at(tip=False)))]
    angles[0 if tip else 1][joint] = output_angle
    frame = frames_of(model, *angles)
    link = model.part(f"{end.prefix}_link")
    # Only the teeth about the point of contact matter.
    reach = 3 * sizes.gear.module
    window = k.at(z=end.outward * sizes.gear.pitch_radius) * k.box(*[(-reach, reach)] * 3)
    window = frame(link, k.at()) * window
    halves = []
    for body in (end.near, end.far):
        teeth = [
            k.common(frame(part, k.at()) * place * part.solid, window)
            for part in model.parts
            if part.body == body and part.made
            for place in part.places
        ]
        halves.append(max(teeth, key=lambda solid: float(solid.volume)))
    moved = frame(next(part for part in model.parts if part.body == end.far), k.at())
    moved = moved * k.at(turn=(0, 0, end.turn))
    teeth, back = halves[0], moved.inverse() * halves[1]
    found = []
    for side in (1, -1):
        usual = sizes.gear.backlash / (2 * sizes.gear.pitch_radius)
        free, stuck = 0.0, 3 * usual
        while stuck - free > usual / 10:
            middle = (free + stuck) / 2
            turned = moved * k.turned_about_y(side * middle) * back
            free, stuck = (free, middle) if k.common_volume(teeth, turned) > 1e-4 else (middle, stuck)
        found.append(free)
    return found[0], found[1]


def frames_of(model: Model, output_angle: ArrayLike, handle_angle: ArrayLike | None) -> Placing:
    """Return the function that places a part's body, by the part and its place."""
    full = model.instrument.expanded
    angles = np.broadcast_to(np.asarray(output_angle, float), (len(full.tip_joints),))
    handles = _handle_angles(model, angles) if handle_angle is None else np.asarray(handle_angle, float)
    frames = kinematics.frames(full, angles, np.broadcast_to(handles, (len(full.handle_joints),)))
    stem = frames.bodies["stem"].position
    places = {name: k.placed(k.MM * (one.position - stem), one.quaternion) for name, one in frames.bodies.items()}
    places |= {"bench": k.at(), "rod": k.at()}
    rig = model.rig
    if rig is not None:
        plane = k.at(turn=(0, 0, rig.turn))
        tip = (plane.inverse() * places[f"{model.bearing.joint.name}_tip"]).position
        places["bench"] = plane
        places["rig_bar"] = plane * k.at(z=rig.pivot) * k.turned_about_y(math.atan2(tip.X, tip.Z - rig.pivot))

    arcs = arcs_of(model, angles)

    def placed(part: Part, place: Location) -> Location:
        if part.body != "arc":
            return places[part.body]
        along = place.position.Z
        # The last arc that begins before it.
        arc, angle, begin = [one for one in arcs if one[2] <= along][-1]
        turn = k.at(turn=(0, 0, arc.end.turn))
        bent = turn * arc_place(along - begin, size_of(arc).length, angle) * turn.inverse()
        return places[arc.end.near] * bent * k.at(z=-along)

    return placed


def arcs_of(model: Model, angles: Array) -> list[tuple[Station, float, float]]:
    """Return the arcs of a tip's backbones, their angles, rad, and where they begin along it, mm."""
    found, begin = [], 0.0
    for one, angle in zip(model.at(tip=True), angles, strict=True):
        if isinstance(one.sizes, Backbone):
            found.append((one, float(angle), begin))
            begin += one.sizes.length
    return found


def size_of(arc: Station) -> Backbone:
    """Return the sizes of an arc."""
    assert isinstance(arc.sizes, Backbone)
    return arc.sizes


def _bent_rod(model: Model, output_angle: ArrayLike, frame: Placing) -> Solid:
    """Return the rod of a tip's backbones, bent, in the frame of the stem's distal end."""
    arcs = arcs_of(model, np.broadcast_to(np.asarray(output_angle, float), (len(model.at(tip=True)),)))
    disc = next(part for part in model.parts if part.body == "arc")
    bent = []
    for one, angle, begin in arcs:
        start = k.at(z=begin)
        bent.append((size_of(one).length, angle, frame(disc, start) * start * k.at(turn=(0, 0, one.end.turn))))
    size = size_of(arcs[-1][0])
    return bent_rod(size.rod, bent, size.collar)


def _handle_angles(model: Model, angles: Array) -> Array:
    """Return the handle angles at which the unloaded tip has angles, rad."""
    inst = model.instrument
    if not model.at(tip=False):
        return np.zeros(0)
    found = np.atleast_1d(statics.handle_angle(inst, np.array(angles)))
    if not np.isfinite(found).all():
        raise ArgumentError(
            key="output_angle",
            value=float(angles[np.abs(angles).argmax()]),
            allowed=f"within what the handle of {inst.name} reaches, or given with a handle_angle",
        )
    return found


def matrix(place: Location) -> Array:
    """Return a place as a matrix (4, 4), mm."""
    transformation = place.wrapped.Transformation()
    return np.array(
        [[transformation.Value(row, column) for column in range(1, 5)] for row in range(1, 4)] + [[0, 0, 0, 1]]
    )

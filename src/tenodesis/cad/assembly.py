"""The assembly at given angles, and what its solids say: interference, masses, inertias, tendons, the tip."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from tenodesis import kinematics
from tenodesis.cad import kernel as k
from tenodesis.cad.backbone_parts import Backbone, arc_place, bent_rod
from tenodesis.cad.kernel import Location, Solid
from tenodesis.cad.model import Model
from tenodesis.cad.parts import Part
from tenodesis.errors import ArgumentError
from tenodesis.kinematics import Posture
from tenodesis.run import Array

_TOUCHING = 1e-3
"""Shared volume, mm³, below which parts count as touching only."""
Progress = Callable[[float, float, str], None]


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


class Mass(NamedTuple):
    """Mass, kg, of all pieces of a part, and its volume, m³."""

    part: str
    pieces: int
    mass: float
    volume: float


def assembled(
    model: Model, output_angle: float = 0.0, handle_angle: float | None = None, *, exploded: float = 0.0
) -> list[Placed]:
    """Return all parts in their places in the frame of the stem's distal end, mm, at angles in rad.

    Without a handle angle it is that of the output angle without a load (eq. 18). A share `exploded` moves parts apart.
    Raises ValueError if the handle cannot bend as far.
    """
    frame = _frames(model, output_angle, handle_angle)
    found = []
    for part in model.parts:
        away = k.at(*(exploded * one for one in part.away))
        for number, place in enumerate(part.places):
            solid = bent_rod(_backbone(model), output_angle) if part.body == "rod" else part.solid
            found.append(Placed(part, number, frame(part, place) * away * _own(place, part) * solid))
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
        at_tip = done < len(output_angles)
        for number, one in enumerate(placed):
            for other in placed[number + 1 :]:
                fixed = one.part.body == other.part.body and one.part.body != "arc"
                if done and (fixed or not (_moves(one, at_tip) or _moves(other, at_tip))):
                    continue
                volume = k.common_volume(one.solid, other.solid)
                if volume > _TOUCHING:
                    found.append(Overlap(one.name, other.name, volume * 1e-9, output, handle))
    return found


def mesh_play(model: Model, output_angle: float, *, tip: bool = True, step: float = 2e-4) -> tuple[float, float]:
    """Return how far a gear pair's far body can turn about its axis either way until its teeth touch, rad.

    The two angles are the backlash that the solids have; found to `step` by bisection with the kernel. Raises
    ValueError if the joint is no gear pair.
    """
    names = ("tip_gear_near", "tip_gear_far") if tip else ("handle_gear_near", "handle_gear_far")
    if model.instrument.joint_type != "tendon-gear":
        raise ArgumentError(key="model", value=model.instrument.joint_type, allowed="an instrument of gear pairs")
    angles = (output_angle, 0.0) if tip else (0.0, output_angle)
    near, far = (next(one for one in assembled(model, *angles) if one.name == name) for name in names)
    frame = _frames(model, *angles)(far.part, k.at())
    back = frame.inverse() * far.solid
    found = []
    for side in (1, -1):
        free, stuck = 0.0, 0.2
        while stuck - free > step:
            middle = (free + stuck) / 2
            turned = frame * k.turned_about_y(side * middle) * back
            free, stuck = (free, middle) if k.common_volume(near.solid, turned) > 1e-4 else (middle, stuck)
        found.append(free)
    return found[0], found[1]


def masses(model: Model) -> list[Mass]:
    """Return the mass of every part, from its solid and its density."""
    return [
        Mass(
            part.name,
            len(part.places),
            part.solid.volume * 1e-9 * part.density * len(part.places),
            part.solid.volume * 1e-9 * len(part.places),
        )
        for part in model.parts
    ]


class Inertia(NamedTuple):
    """Mass, kg; centre of mass, m; and inertia about it, kg·m² (3, 3): of a body in its own frame."""

    mass: float
    centre: Array
    about_centre: Array

    def about(self, point: Array) -> Array:
        """Return the inertia about a point, kg·m² (3, 3)."""
        arm = np.asarray(point) - self.centre
        moved: Array = self.about_centre + self.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return moved


def inertias(model: Model) -> dict[str, Inertia]:
    """Return the inertia of each moving body of the instrument, by the names of :func:`tenodesis.kinematics.frames`.

    Bodies of the bench and the load rig are left out; the backbone and its discs count as one body, straight.
    """
    found: dict[str, Inertia] = {}
    bench = ("bench", "rig_bar")
    for body in dict.fromkeys(part.body for part in model.parts if part.body not in bench):
        pieces = []
        for part in model.parts:
            if part.body != body:
                continue
            solid = part.solid
            centre = np.array([*solid.center(k.kernel().CenterOf.MASS)])
            own = np.array(solid.matrix_of_inertia) * part.density * 1e-15
            for place in part.places:
                matrix = _matrix(place)
                turn, shift = matrix[:3, :3], matrix[:3, 3]
                mass = solid.volume * 1e-9 * part.density
                pieces.append(Inertia(mass, (turn @ centre + shift) * 1e-3, turn @ own @ turn.T))
        found[body] = _joined(pieces)
    return found


def tip_inertia(model: Model) -> float:
    """Return the inertia about the output angle of what turns with the tip, kg·m², for the twin's dynamics.tip_inertia.

    A gear pair's far body goes round the near axis as well: at a straight joint it is as if it turned about the line of
    centres' middle, and the links turn by half the angle. A backbone's discs count by their share of the angle.
    """
    bodies = inertias(model)
    joint = model.joints[0]
    far = bodies["yaw_far"]
    if isinstance(joint, Backbone):
        arc = sum(
            one.solid.volume * 1e-9 * one.density * (place.position.Z * 1e-3 / 2) ** 2 * (place.position.Z / joint.length) ** 2
            for one in model.parts
            if one.body == "arc"
            for place in one.places
        )
        return float(far.about(np.array([0.0, 0.0, -joint.length * 1e-3 / 2]))[1, 1]) + arc
    apart = 2e-3 * joint.gear.pitch_radius if hasattr(joint, "gear") else 0.0
    own = float(far.about(np.array([0.0, 0.0, -apart / 2]))[1, 1])
    carrier = bodies.get("yaw_carrier")
    links = float(carrier.about(np.zeros(3))[1, 1]) / 4 if carrier is not None and apart else 0.0
    return own + links


def tendon_length(model: Model, output_angle: float, handle_angle: float = 0.0) -> tuple[float, float]:
    """Return the lengths of agonist and antagonist from the handle's far body to the tip's, m, read from the solids.

    Tunnels are the cylindrical faces of the parts, pulleys the round bottoms of their grooves; the tendon goes straight
    between the tunnels' mouths, on the tunnels' axes, and round a pulley at its groove's bottom plus half a rope.
    """
    frame = _frames(model, output_angle, handle_angle)
    first, second = (
        _way(model, frame, side, output_angle, handle_angle, tip=True)
        + _way(model, frame, side, output_angle, handle_angle, tip=False)
        for side in (1, -1)
    )
    return first * 1e-3, second * 1e-3


def tip_place(model: Model, output_angle: float) -> Array:
    """Return where the eye of the end-effector is, from the stem's distal end, m (3,), read from the solid's face."""
    part = model.part("end_effector")
    axes = [axis for axis in _bores(part.solid) if abs(axis.way[1]) > 0.999]
    eye = max(axes, key=lambda axis: axis.middle[2])
    placed = _matrix(_frames(model, output_angle, 0.0)(part, k.at()))
    found: Array = (placed @ np.array([eye.middle[0], 0.0, eye.middle[2], 1.0]))[:3] * 1e-3
    return found


class _Bore(NamedTuple):
    """A cylindrical face: direction, middle and ends of its axis, mm, and its radius."""

    way: Array
    middle: Array
    ends: tuple[Array, Array]
    radius: float


def _bores(solid: Solid) -> Iterator[_Bore]:
    """Yield the cylindrical faces of a solid, with their extent along their axes."""
    b = k.kernel()
    for face in solid.faces().filter_by(b.GeomType.CYLINDER):
        cylinder = k.surface(face).Cylinder()
        axis, origin = cylinder.Axis().Direction(), cylinder.Axis().Location()
        way = np.array([axis.X(), axis.Y(), axis.Z()])
        point = np.array([origin.X(), origin.Y(), origin.Z()])
        along = [float(np.dot(np.array([*vertex]) - point, way)) for vertex in face.vertices()]
        ends = (point + min(along) * way, point + max(along) * way)
        yield _Bore(way, (ends[0] + ends[1]) / 2, ends, cylinder.Radius())


def _mouth(part: Part, place: Array, side: int, tunnel: float, *, far: bool = False) -> Array:
    """Return the mouth of a tunnel toward its part's z, mm, placed; with `far` the mouth at its other end."""
    found = [
        bore
        for bore in _bores(part.solid)
        if abs(bore.radius - tunnel / 2) < 1e-6 and abs(bore.way[2]) > 0.999 and side * bore.middle[0] > 1e-6
    ]
    ends = [end for bore in found for end in bore.ends]
    chosen = (min if far else max)(ends, key=lambda end: end[2])
    mouth: Array = (place @ np.append(chosen, 1.0))[:3]
    return mouth


def _way(
    model: Model, frame: "_Frame", side: int, output_angle: float, handle_angle: float, *, tip: bool
) -> float:
    """Return the length of a tendon over one joint, mm, side 1 for the agonist."""
    joint = model.joints[0 if tip else 1]
    tunnel = k.MM * (model.instrument.tendon_diameter or 0.0) + k.MM * model.process.bore
    prefix = "tip" if tip else "handle"
    if isinstance(joint, Backbone):
        names = ("tip_socket", "tip_disc", "tip_plate")
        points = []
        for name in names:
            part = model.part(name)
            for place in part.places:
                matrix = _matrix(frame(part, place) * _own(place, part))
                ends = [_mouth(part, matrix, side, tunnel)]
                if name == "tip_disc":
                    ends.insert(0, _mouth(part, matrix, side, tunnel, far=True))
                points += ends
        return float(sum(np.linalg.norm(two - one) for one, two in zip(points, points[1:], strict=False)))
    if hasattr(joint, "gear"):
        mouths = []
        for name in (f"{prefix}_gear_near", f"{prefix}_gear_far"):
            part = model.part(name)
            place = part.places[0]
            mouths.append(_mouth(part, _matrix(frame(part, place) * _own(place, part)), side, tunnel))
        return float(np.linalg.norm(mouths[1] - mouths[0]))
    part = model.part(f"{prefix}_pulley")
    b = k.kernel()
    grooves = {}
    for face in part.solid.faces().filter_by(b.GeomType.TORUS):
        torus = k.surface(face).Torus()
        grooves[torus.Axis().Location().Y() > 0] = torus.MajorRadius() - torus.MinorRadius()
    radius = grooves[side > 0] + k.MM * (model.instrument.tendon_diameter or 0.0) / 2
    # The tendon meets the pulley where its way from the tunnel, along the stem, touches the circle; bending unwinds the
    # agonist at the tip and winds it on at the handle.
    bent = output_angle if tip else -handle_angle
    return float(radius * (joint.wrap - side * bent))


_Frame = Callable[[Part, Location], Location]


def _frames(model: Model, output_angle: float, handle_angle: float | None) -> _Frame:
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
        if part.body == "bench" or part.body == "rod":
            return k.at()
        if part.body == "arc":
            return arc_place(place.position.Z, _backbone(model).length, output_angle)
        x, z, turn = places[part.body]
        return k.at(x, 0.0, z) * k.turned_about_y(turn)

    return placed


def _own(place: Location, part: Part) -> Location:
    """Return a part's place within its body; that along a backbone is already part of its frame."""
    return k.at() if part.body == "arc" else place


def _backbone(model: Model) -> Backbone:
    joint = model.joints[0]
    assert isinstance(joint, Backbone)
    return joint


def _moves(one: Placed, at_tip: bool) -> bool:
    body = one.part.body
    if body in ("bench", "stem"):
        return False
    return body.startswith("handle_") != at_tip


def _matrix(place: Location) -> Array:
    transformation = place.wrapped.Transformation()
    return np.array([[transformation.Value(row, column) for column in range(1, 5)] for row in range(1, 4)] + [[0, 0, 0, 1]])


def _joined(pieces: Sequence[Inertia]) -> Inertia:
    mass = sum(one.mass for one in pieces)
    centre = sum((one.mass * one.centre for one in pieces), np.zeros(3)) / mass
    total = sum((one.about(centre) for one in pieces), np.zeros((3, 3)))
    return Inertia(mass, centre, total)

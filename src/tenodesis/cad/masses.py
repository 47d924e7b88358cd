"""Masses and inertias of parts and bodies, from their solids."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tenodesis import plant
from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import frames_of, matrix
from tenodesis.cad.backbone_parts import Backbone
from tenodesis.cad.model import Model, Station
from tenodesis.instrument import Instrument
from tenodesis.run import Array

_LEAST_MORE = 1e-9  # kg m^2, where the search for what a link needs more begins


class Mass(NamedTuple):
    """Mass, kg, of all pieces of a part, and its volume, m³."""

    part: str
    pieces: int
    mass: float
    volume: float


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
                placed = matrix(place)
                turn, shift = placed[:3, :3], placed[:3, 3]
                mass = solid.volume * 1e-9 * part.density
                pieces.append(Inertia(mass, (turn @ centre + shift) * 1e-3, turn @ own @ turn.T))
        found[body] = _joined(pieces)
    return found


def tip_inertia(model: Model) -> float:
    """Return the inertia about the first output angle of all that turns with the tip, kg·m², the others straight.

    Of a planar instrument it is the twin's dynamics.tip_inertia. A gear pair's far body goes round the near axis as
    well: at a straight joint it is as if it turned about the line of centres' middle, and the links turn by half the
    angle. A backbone's discs count by their share of the angle.
    """
    bodies = inertias(model)
    first, *others = model.at(tip=True)
    joint, axis = first.sizes, np.array(first.joint.axis_vector)
    frame = frames_of(model, 0.0, 0.0)
    place = {part.body: matrix(frame(part, k.at()))[:3, 3] * 1e-3 for part in model.parts if part.body != "arc"}
    apart = joint.length if isinstance(joint, Backbone) else k.MM * first.joint.chord
    middle = place[first.end.far] - np.array([0.0, 0.0, 5e-4 * apart])
    turning = [first.end.far, *(body for one in others for body in (one.end.carrier, one.end.far) if body in bodies)]
    found = sum((float(axis @ bodies[body].about(middle - place[body]) @ axis) for body in turning), 0.0)
    if isinstance(joint, Backbone):
        # A disc turns by its share of the angle, about the middle of the backbone before it.
        discs: float = sum(
            1e-9 * one.solid.volume * one.density * (5e-4 * float(disc.position.Z) ** 2 / joint.length) ** 2
            for one in model.parts
            if one.body == "arc"
            for disc in one.places
        )
        return found + discs
    return found + _links(first, bodies, axis)


def _links(station: Station, bodies: Mapping[str, Inertia], axis: Array) -> float:
    """Return what the links of a gear pair, which turn by half its angle, add to its inertia, kg·m²."""
    carrier = bodies.get(station.end.carrier)
    return 0.0 if carrier is None else float(axis @ carrier.about(np.zeros(3)) @ axis) / 4


def with_inertia(model: Model) -> Instrument:
    """Return the instrument with the inertia of its solids, for its twin: of the tip, or of every link of several.

    A tip that is too light for the twin's time steps gets the least inertia that they can follow, links the least more.
    """
    given, source = model.given, f"solids of tenodesis cad, process {model.process.name}"
    short = given.short_form
    if short is not None:
        least = max(plant.least_tip_inertia(one) for one in short.planar)
        inertia = {"dynamics.tip_inertia": max(tip_inertia(model), least)}
        return short.replace(**inertia, sources={**given.sources, "dynamics.tip_inertia": source})
    bodies, changes = inertias(model), {}
    for one in model.at(tip=True):
        link, axis = bodies[one.end.far], np.array(one.joint.axis_vector)
        across = float(np.diag(link.about(np.zeros(3)))[:2].mean())
        changes[one.joint.name] = {
            "mass": link.mass,
            "centre_of_mass": float(link.centre[2]),
            "inertia": across + _links(one, bodies, axis),
        }
    keys = ("mass", "centre_of_mass", "inertia")

    def built(more: float) -> Instrument:
        joints = []
        for joint in given.as_given("joints"):
            own = dict(changes.get(joint.name, {}))
            if own:
                own["inertia"] += more
            joints.append(joint.model_dump(exclude_unset=True) | own)
        note = f"{source}; {more:.2g} kg*m^2 more than theirs, the least that its twin can follow" if more else source
        sources = {f"joints.{key}": note if key == "inertia" else source for key in keys}
        return given.replace(joints=joints, sources={**given.sources, **sources})

    return built(_least_more(lambda more: float(plant.natural_frequencies(built(more).expanded)[-1])))


def _least_more(fastest: Callable[[float], float]) -> float:
    """Return the least inertia, kg·m², to add to every link so that the twin's time steps follow the fastest motion."""
    most = plant.LARGEST_PHASE_STEP / plant.TIME_STEP
    if fastest(0.0) <= most:
        return 0.0
    low, high = 0.0, _LEAST_MORE
    while fastest(high) > most:
        low, high = high, 2 * high
    while high - low > _LEAST_MORE * 1e-3 + 1e-3 * high:
        middle = (low + high) / 2
        low, high = (middle, high) if fastest(middle) > most else (low, middle)
    return high


def _joined(pieces: Sequence[Inertia]) -> Inertia:
    mass = sum(one.mass for one in pieces)
    centre = sum((one.mass * one.centre for one in pieces), np.zeros(3)) / mass
    total = sum((one.about(centre) for one in pieces), np.zeros((3, 3)))
    return Inertia(mass, centre, total)

"""Masses and inertias of parts and bodies, from their solids."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tenodesis import plant
from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import arcs_of, frames_of, matrix, size_of
from tenodesis.cad.model import Model, Station
from tenodesis.cad.parts import Part
from tenodesis.instrument import Instrument
from tenodesis.run import Array

_SAME = 1e-6  # mm
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
        found[body] = _joined([piece for part in model.parts if part.body == body for piece in _pieces(part)])
    return found


def _pieces(part: Part) -> list[Inertia]:
    """Return the inertia of every piece of a part, in the frame of its body."""
    solid, found = part.solid, []
    centre = np.array([*solid.center(k.kernel().CenterOf.MASS)])
    own = np.array(solid.matrix_of_inertia) * part.density * 1e-15
    for place in part.places:
        placed = matrix(place)
        turn, shift = placed[:3, :3], placed[:3, 3]
        mass = solid.volume * 1e-9 * part.density
        found.append(Inertia(mass, (turn @ centre + shift) * 1e-3, turn @ own @ turn.T))
    return found


def tip_inertia(model: Model) -> float:
    """Return the inertia about the first output angle of all that turns with the tip, kg·m², the others straight.

    Of a planar instrument it is the twin's dynamics.tip_inertia. A gear pair's far body goes round the near axis as
    well: at a straight joint it is as if it turned about the line of centres' middle, and the links turn by half the
    angle. A backbone's discs count by their share of the angle.
    """
    bodies, tips = inertias(model), model.at(tip=True)
    # The arcs of a backbone bend alike.
    own = next(iter(model.instrument.expanded.bends.values()))
    first, axis = tips[0], np.array(tips[0].joint.axis_vector)
    frame = frames_of(model, 0.0, 0.0)
    place = {part.body: matrix(frame(part, k.at()))[:3, 3] * 1e-3 for part in model.parts if part.body != "arc"}
    apart = sum(tips[number].joint.chord for number in own)
    begin = place[first.end.near] + np.array([0.0, 0.0, 1e-3 * first.end.start])
    middle = begin + np.array([0.0, 0.0, apart / 2])
    outer = (body for one in tips[own[-1] + 1 :] for body in (one.end.carrier, one.end.far))
    turning = [body for body in (tips[own[-1]].end.far, *outer) if body in bodies]
    found = sum((float(axis @ bodies[body].about(middle - place[body]) @ axis) for body in turning), 0.0)
    for part in model.parts:
        for disc in part.places if part.body == "arc" else ():
            # A disc turns by its share of the angle, about the middle of the backbone before it.
            along = 1e-3 * float(disc.position.Z)
            reach = along**2 / (2 * apart) if along < apart else along - apart / 2
            found += 1e-9 * part.solid.volume * part.density * reach**2
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
    bodies, changes, tips = inertias(model), {}, model.at(tip=True)
    for name, places in model.instrument.expanded.arc_places.items():
        one, axis = tips[places[-1]], np.array(tips[places[-1]].joint.axis_vector)
        link = _joined([*_discs(model, places), *([bodies[one.end.far]] if one.end.far in bodies else [])])
        across = float(np.diag(link.about(np.zeros(3)))[:2].mean())
        changes[name] = {
            "mass": link.mass,
            # That of discs is before the end of their backbone, where a file has none.
            "centre_of_mass": max(float(link.centre[2]), 0.0),
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


def _discs(model: Model, places: Sequence[int]) -> list[Inertia]:
    """Return the inertias of the discs of a backbone in arcs at places of the tip, straight, from its far end."""
    arcs = arcs_of(model, np.zeros(len(model.at(tip=True))))
    if not arcs:
        return []
    (_, _, low), (last, _, begin) = arcs[places[0]], arcs[places[-1]]
    end = begin + size_of(last).length
    return [
        piece._replace(centre=piece.centre - np.array([0.0, 0.0, 1e-3 * end]))
        for part in model.parts
        if part.body == "arc"
        for piece, place in zip(_pieces(part), part.places, strict=True)
        if low < place.position.Z <= end + _SAME
    ]


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

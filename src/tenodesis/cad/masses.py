"""Masses and inertias of parts and bodies, from their solids."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tenodesis import plant
from tenodesis.cad import kernel as k
from tenodesis.cad.assembly import matrix
from tenodesis.cad.backbone_parts import Backbone
from tenodesis.cad.gears import GearJoint
from tenodesis.cad.model import Model
from tenodesis.instrument import ShortForm
from tenodesis.run import Array


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
    """Return the inertia about the output angle of what turns with the tip, kg·m², for the twin's dynamics.tip_inertia.

    A gear pair's far body goes round the near axis as well: at a straight joint it is as if it turned about the line of
    centres' middle, and the links turn by half the angle. A backbone's discs count by their share of the angle.
    """
    bodies = inertias(model)
    joint = model.joints[0]
    far = bodies["yaw_far"]
    if isinstance(joint, Backbone):
        # A disc turns by its share of the angle, about the middle of the backbone before it.
        discs = [
            1e-9 * one.solid.volume * one.density * (5e-4 * float(place.position.Z) ** 2 / joint.length) ** 2
            for one in model.parts
            if one.body == "arc"
            for place in one.places
        ]
        return float(far.about(np.array([0.0, 0.0, -joint.length * 1e-3 / 2]))[1, 1] + sum(discs))
    apart = 2e-3 * joint.gear.pitch_radius if isinstance(joint, GearJoint) else 0.0
    own = float(far.about(np.array([0.0, 0.0, -apart / 2]))[1, 1])
    carrier = bodies.get("yaw_carrier")
    links = float(carrier.about(np.zeros(3))[1, 1]) / 4 if carrier is not None and apart else 0.0
    return own + links


def with_inertia(model: Model) -> ShortForm:
    """Return the instrument with the inertia of its solids' tip, for its twin.

    A tip that is too light for the twin's time steps gets the least inertia that they can follow.
    """
    least = max(plant.least_tip_inertia(one) for one in model.given.planar)
    source = f"solids of tenodesis cad, process {model.process.name}"
    inertia = {"dynamics.tip_inertia": max(tip_inertia(model), least)}
    return model.given.replace(**inertia, sources={**model.given.sources, "dynamics.tip_inertia": source})


def _joined(pieces: Sequence[Inertia]) -> Inertia:
    mass = sum(one.mass for one in pieces)
    centre = sum((one.mass * one.centre for one in pieces), np.zeros(3)) / mass
    total = sum((one.about(centre) for one in pieces), np.zeros((3, 3)))
    return Inertia(mass, centre, total)

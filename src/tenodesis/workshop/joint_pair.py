"""The errors of scale models of several joints that are built to tolerances, and the grades of their dimensions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tenodesis import tolerance
from tenodesis.errors import ArgumentError, StudyError
from tenodesis.instrument import FullForm
from tenodesis.run import Array
from tenodesis.similarity.joints import JointComparison, compare_joints
from tenodesis.tolerance.evaluation import replaced
from tenodesis.tolerance.parameters import UncertainParameter, resolve
from tenodesis.workshop.grades import Grade, of_backbone, of_length, of_pretension, of_radius, of_spring, of_stiffness

_LENGTHS = ("end_effector_length", "backbone_length")
_WORDS = {
    "radius": "radius to the rope's centre",
    "end_effector_length": "length to force or hand",
    "backbone_length": "length of backbone",
    "backbone_rigidity": "rigidity of backbone",
    "stiffness": "stiffness",
    "pretension": "pretension",
}


class BuiltJoints(NamedTuple):
    """Instruments that values make; None where they make none."""

    insts: list[FullForm | None]


@dataclass(frozen=True)
class JointPair:
    """Two instruments of several joints, and the real-size angles in loops of every joint."""

    real_size: FullForm
    scaled_up: FullForm
    comparison: JointComparison
    reference: Array
    """rad, (n, loops, joints)."""

    @classmethod
    def of(cls, real_size: FullForm, scaled_up: FullForm) -> "JointPair":
        """Return a pair; raises StudyError if they have not the same joints and tendons, or do not hold the loads."""
        try:
            pair = compare_joints(real_size, scaled_up)
        except ArgumentError as problem:
            raise StudyError(str(problem), key="scaled_up", value=scaled_up.name) from None
        found = cls(real_size, scaled_up, pair, pair.motions.angles([pair.real_size])[0])
        if np.isnan(found.errors(found.nominal())).any():
            raise StudyError(
                f"{scaled_up.name} or {real_size.name} does not hold {found.forces[0]:.4g} N (real-size) while its "
                "joints are bent through their ranges; give more pretension.",
                key="forces",
                value=found.forces[0],
            )
        return found

    @property
    def forces(self) -> tuple[float, ...]:
        """The largest force of the working range, N real-size: all loads are judged at once."""
        return (max((one.size for one in self.comparison.loads), default=0.0),)

    @cached_property
    def alike(self) -> dict[str, list[UncertainParameter]]:
        """Values that the workshop makes or sets, by what is alike: key and value, of joints also place and mechanism.

        What is alike has one grade.
        """
        kinds = {joint.name: (joint.place, joint.mechanism) for joint in self.scaled_up.as_given("joints")}
        found: dict[tuple[str, ...], list[UncertainParameter]] = {}
        for one in resolve(tolerance.default(self.scaled_up), self.real_size, self.scaled_up):
            listed, *inner, key = one.key.split(".")
            if listed != "friction":
                kind = kinds[inner[0]] if listed == "joints" else ()
                found.setdefault((listed, key, f"{one.nominal:.9g}", *kind), []).append(one)
        return {_name(own): own for own in found.values()}

    @property
    def columns(self) -> dict[str, dict[str, float]]:
        """Nominal values, SI units, by dimension and key; ropes of one kind have one stiffness, off alike."""
        return {
            name: {one.key: one.nominal for one in (own[:1] if _of_rope(own[0]) else own)}
            for name, own in self.alike.items()
        }

    def members(self, key: str) -> tuple[str, ...]:
        """Return the keys of the instrument file that have a dimension."""
        return tuple(one.key for one in self.alike[key])

    def grades(self, key: str, turn: float, backlash: float | None) -> tuple[Grade, ...]:
        """Return the grades of a dimension; `turn` is how far a joint turns (rad) per share of it.

        The play of gears is not counted: tendons hold their halves, and no encoder of the comparison reads the links.
        """
        one = self.alike[key][0]
        listed, last = one.key.partition(".")[0], one.key.rpartition(".")[2]
        if last == "radius":
            return of_radius(one.nominal)
        if last in _LENGTHS:
            return of_length(one.nominal)
        if last == "pretension":
            return of_pretension(self.scaled_up, one.nominal)
        if last == "backbone_rigidity":
            return of_backbone(one.nominal)
        return of_stiffness(one.nominal, turn) if listed == "tendons" else of_spring(one.nominal)

    def is_drawn(self, key: str) -> bool:
        """Return whether a drawing has a dimension."""
        last = self.alike[key][0].key.rpartition(".")[2]
        return last == "radius" or last in _LENGTHS

    def pieces(self, key: str) -> int:
        """Return how many pieces have a dimension: a joint of gears has two, a rope's grade is for two tendons."""
        if self.alike[key][0].key.startswith("tendons.") and not self.is_drawn(key):
            return math.ceil(len(self.alike[key]) / 2)
        gears = {f"joints.{joint.name}.radius" for joint in self.scaled_up.joints if joint.mechanism == "tendon-gear"}
        return sum(2 if one.key in gears else 1 for one in self.alike[key])

    def errors(self, built: BuiltJoints, forces: Sequence[int] | None = None) -> Array:
        """Return errors, deg, (1, instruments, values): of every joint in all loops and under all loads."""
        angles = self.comparison.motions.angles(built.insts, scaled=True)
        return np.array([[one.angle.ravel() for one in self.comparison.between_many(angles, self.reference)]])

    def built(self, keys: Sequence[str], rows: Array) -> BuiltJoints:
        """Return the instruments that values by key (SI units) make."""
        ropes = {own[0].key: [one.key for one in own] for own in self.alike.values() if _of_rope(own[0])}
        of = {key: ropes.get(key, [key]) for key in keys}
        values = [{one: float(value) for key, value in zip(keys, row, strict=True) for one in of[key]} for row in rows]
        return BuiltJoints([replaced(self.scaled_up, own) for own in values])

    def nominal(self) -> BuiltJoints:
        """Return the instrument as designed."""
        return BuiltJoints([self.scaled_up])


def _of_rope(one: UncertainParameter) -> bool:
    return one.key.startswith("tendons.") and one.key.endswith(".stiffness")


def _name(alike: Sequence[UncertainParameter]) -> str:
    """Return the name of values that are alike: whose they are, and what."""
    of = [one.key.split(".")[1].replace("_", " ") for one in alike]
    last = alike[0].key.rpartition(".")[2]
    what = "tendon " if alike[0].key.startswith("tendons.") else ""
    return f"{what}{_WORDS.get(last, last)} of {', '.join(of)}"

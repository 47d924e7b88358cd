"""The instrument whose joints share tendons: joints and tendons as a file lists them."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, model_validator

from tenodesis import _core, notebook
from tenodesis.errors import InstrumentError
from tenodesis.instrument.hardware import Control, Drives, Friction, Hand, Sensors
from tenodesis.instrument.instrument import Name
from tenodesis.toml import FileTable, validated
from tenodesis.units import (
    AngleRange,
    Coefficient,
    Damping,
    FlexuralRigidity,
    Force,
    HandStiffness,
    Inertia,
    Length,
    Mass,
    Modulus,
    PositiveForce,
    Rate,
    SheathBend,
    Spacing,
    Stiffness,
    StopAngle,
)

Array = NDArray[np.float64]

Mechanism = Literal["tendon-gear", "pulley", "continuum"]
Side = Literal["agonist", "antagonist", "middle"]

AXES: Mapping[str, tuple[float, float, float]] = {"yaw": (0, 1, 0), "pitch": (-1, 0, 0), "roll": (0, 0, 1)}
"""Axis about which a positive angle turns, by its name: yaw bends the tip toward x, pitch toward y."""

_MECHANISMS: Mapping[str, int] = {"tendon-gear": 0, "pulley": 1, "continuum": 2}
COUPLED_LAWS = ("none", "capstan", "capstan-constant")
"""Friction laws that a coupled instrument may have."""
_LAWS = ", ".join(COUPLED_LAWS)
MOST_SHEATH_CONTACTS = 4
SIGNS: Mapping[str, float] = {"agonist": 1.0, "antagonist": -1.0, "middle": 0.0}
"""Side of a joint to which a tendon bends it, by its name."""
MOST_JOINTS = 6
MOST_TENDONS = 12


def _short(name: str) -> str:
    if not (name.isascii() and name.replace("_", "a").isalnum() and len(name) <= 40 and not name[0].isdigit()):
        raise ValueError("it must be a name of letters, digits and underscores, of at most 40 characters")
    return name


ShortName = Annotated[str, Field(min_length=1), AfterValidator(_short)]
"""Name of a joint or a tendon, as recordings and exported models have it."""


class RouteError(ValueError):
    """What is wrong with the routes of an instrument, and where: a tendon, joints, or both.

    Parameters
    ----------
    sentence
        What is wrong.
    inst
        The instrument, whose tables are valid one by one.
    tendon, joints
        Their names, empty if it is not about one.
    """

    def __init__(
        self, sentence: str, inst: "CoupledInstrument", *, tendon: str = "", joints: Sequence[str] = ()
    ) -> None:
        super().__init__(sentence)
        self.inst, self.tendon, self.joints = inst, tendon, tuple(joints)


class Joint(FileTable):
    """A joint at the tip or at the handle."""

    name: ShortName = Field(description="Name of the joint")
    place: Literal["tip", "handle"] = Field(default="tip", description="End of the instrument that it is at")
    mechanism: Mechanism = Field(description="Rolling gear pair, pulley on a fixed axis, or elastic backbone")
    axis: Literal["yaw", "pitch", "roll"] | tuple[float, float, float] = Field(
        description="What a positive angle turns toward: yaw x, pitch y; or the axis of the turn in the link before"
    )
    on: str | None = Field(default=None, description="Joint that it stands on; by default the one listed before it")
    radius: Length = Field(description="Pitch radius of a gear, radius of a pulley, or offset of a continuum's tendons")
    offset: Spacing = Field(default=0.0, description="From the far end of what it stands on")
    backbone_length: Length | None = Field(default=None, description="Length of a continuum's backbone")
    backbone_rigidity: FlexuralRigidity | None = Field(default=None, description="Flexural rigidity of a backbone")
    stiffness: HandStiffness | None = Field(default=None, description="Of a spring in the joint")
    range: AngleRange = Field(default=math.radians(80), description="Working range of its angle to either side")
    end_effector_length: Length | None = Field(
        default=None, description="From the far end of the last joint to where forces act; at the handle, the hand"
    )
    mass: Mass | None = Field(default=None, description="Of the link beyond the joint")
    centre_of_mass: Spacing | None = Field(
        default=None, description="From the joint's far end along the link; by default its middle"
    )
    inertia: Inertia | None = Field(
        default=None, description="About axes through the joint's far end across the link; by default that of a rod"
    )
    damping: Damping | None = Field(default=None, description="Viscous damping of the joint's angle")
    stop: StopAngle | None = Field(
        default=None, description="Angle of its mechanical stop; by default a third beyond its range"
    )

    @property
    def axis_vector(self) -> tuple[float, float, float]:
        """Unit vector about which a positive angle turns."""
        x, y, z = AXES[self.axis] if isinstance(self.axis, str) else self.axis
        norm = math.sqrt(x * x + y * y + z * z)
        return x / norm, y / norm, z / norm

    @property
    def chord(self) -> float:
        """Length of the straight joint, m: between a gear pair's centres, or of the backbone."""
        if self.mechanism == "continuum":
            return self.backbone_length or 0.0
        return 2 * self.radius if self.mechanism == "tendon-gear" else 0.0

    @property
    def own_stiffness(self) -> float:
        """Stiffness of spring and backbone, N m/rad."""
        backbone = (self.backbone_rigidity or 0.0) / self.backbone_length if self.backbone_length else 0.0
        return (self.stiffness or 0.0) + backbone

    @model_validator(mode="after")
    def _complete(self) -> Self:
        is_continuum = self.mechanism == "continuum"
        for key in ("backbone_length", "backbone_rigidity"):
            if is_continuum != (getattr(self, key) is not None):
                needed = "is missing" if is_continuum else f"is given, but a {self.mechanism} has no backbone"
                raise ValueError(f"{key} {needed}; it must be {'given' if is_continuum else 'left out'}")
        if not isinstance(self.axis, str) and not math.hypot(*self.axis) > 0:
            raise ValueError(f"axis is {list(self.axis)}; it must be yaw, pitch, roll or a vector that is not zero")
        if self.mechanism != "pulley" and abs(self.axis_vector[2]) > 1e-9:
            given = self.axis if isinstance(self.axis, str) else list(self.axis)
            raise ValueError(
                f"axis is {given}; a {self.mechanism} bends only about an axis across z, the last number 0"
            )
        return self


class CoupledDynamics(Hand):
    """Motion of the links, and of the hand on each joint of the handle."""

    natural_frequency: Rate = Field(
        default=20.0, description="Lowest of the unloaded wrist, from which the mass of links follows that is not given"
    )
    damping_ratio: Annotated[float, Field(ge=0, le=2)] = Field(
        default=0.2, description="Share of critical damping of joints whose damping is not given"
    )


class Crossing(FileTable):
    """Passage of a tendon over a joint."""

    joint: str = Field(description="Name of the joint")
    side: Side = Field(description="Side of the joint: agonist bends it to positive angles, middle does not bend it")
    radius: Spacing | None = Field(default=None, description="Distance from the joint's middle; by default its radius")
    base_wrap: SheathBend = Field(default=0.0, description="Bend of the tendon over the straight joint")
    coefficient: Coefficient | None = Field(
        default=None, description="Friction coefficient there; by default friction.vertex_coefficient"
    )


class Tendon(FileTable):
    """A tendon and its route from the handle's end to the tip."""

    name: ShortName = Field(description="Name of the tendon")
    start: Literal["spool", "anchor"] = Field(default="spool", description="Its near end: a motor's spool, or fixed")
    route: tuple[Crossing, ...] = Field(min_length=1, description="Joints that it crosses, from handle to tip")
    stiffness: Stiffness | None = Field(default=None, description="By default E A / L")
    length: Length | None = Field(default=None, description="By default the instrument's tendon_length")
    pretension: Force | None = Field(default=None, description="Tension at rest; by default the instrument's")


class Grip(FileTable):
    """Jaws that press on an object."""

    jaws: tuple[str, ...] = Field(min_length=1, max_length=2, description="Joints of the jaws; the first opens to +")
    length: Length | None = Field(default=None, description="From the jaws' axis to the object; by default their tip")


class CoupledInstrument(FileTable):
    """An instrument whose tendons may cross several joints, in SI units and radians; use :func:`load`.

    Raises
    ------
    InstrumentError
        By `load` and `replace`, when a value is missing, unknown or not allowed.
    """

    name: Name = Field(description="Name of the instrument in figures and tables")
    description: str = Field(default="", max_length=200, description="One line about the instrument")
    stem_length: Length | None = Field(default=None, description="Of the stem, for drawings and models")
    stem_diameter: Length | None = Field(default=None, description="Outer diameter of the stem")
    tendon_diameter: Length | None = Field(default=None, description="Diameter of a tendon's load-bearing section")
    tendon_modulus: Modulus | None = Field(default=None, description="Young's modulus of a tendon")
    tendon_length: Length | None = Field(default=None, description="Length of a tendon")
    tendon_stiffness: Stiffness | None = Field(default=None, description="Stiffness of a tendon; by default E A / L")
    pretension: Force = Field(description="Tension of every tendon at rest")
    spool_radius: Length | None = Field(default=None, description="Radius of the motors' spools")
    breaking_load: PositiveForce | None = Field(default=None, description="Tension at which a tendon breaks")
    joints: tuple[Joint, ...] = Field(min_length=1, description="From the stem outward at either end")
    tendons: tuple[Tendon, ...] = Field(min_length=1, max_length=MOST_TENDONS, description="All tendons")
    grip: Grip | None = Field(default=None, description="Jaws that grip")
    friction: Friction = Friction()
    dynamics: CoupledDynamics = CoupledDynamics()
    drives: Drives = Drives()
    sensors: Sensors = Sensors()
    control: Control = Control()
    sources: Mapping[str, str] = Field(default={}, description="Source of each value, by key")

    @property
    def tip_joints(self) -> tuple[Joint, ...]:
        """Joints at the tip, from the stem outward."""
        return tuple(joint for joint in self.joints if joint.place == "tip")

    @property
    def handle_joints(self) -> tuple[Joint, ...]:
        """Joints at the handle, from the stem outward."""
        return tuple(joint for joint in self.joints if joint.place == "handle")

    @property
    def parents(self) -> tuple[int, ...]:
        """Place among the tip's joints of the one that each stands on; -1 for the stem."""
        names = [joint.name for joint in self.tip_joints]
        return tuple(
            i - 1 if joint.on is None else (-1 if joint.on == "stem" else names.index(joint.on))
            for i, joint in enumerate(self.tip_joints)
        )

    @property
    def ends(self) -> tuple[int, ...]:
        """Places of the joints that no other stands on: the end-effector or the jaws."""
        return tuple(i for i in range(len(self.tip_joints)) if i not in self.parents)

    @property
    def bearing(self) -> tuple[int, ...]:
        """Places of the joints among the tip's at whose ends the wrench acts: those with an end_effector_length."""
        return tuple(i for i, joint in enumerate(self.tip_joints) if joint.end_effector_length is not None)

    @property
    def jaws(self) -> tuple[int, ...]:
        """Places of the jaws among the tip's joints; empty if nothing grips."""
        names = [joint.name for joint in self.tip_joints]
        return () if self.grip is None else tuple(names.index(jaw) for jaw in self.grip.jaws)

    @property
    def grip_arms(self) -> Array:
        """Lengths by which the jaws open per angle of the tip's joints, (joints,), m: the first of them to the +."""
        arms = np.zeros(len(self.tip_joints))
        for sign, i in zip((1.0, -1.0), self.jaws, strict=False):
            own = self.grip.length if self.grip is not None else None
            arms[i] = sign * (own or self.tip_joints[i].end_effector_length or 0.0)
        return arms

    def tendon_arms(self, place: Literal["tip", "handle"]) -> Array:
        """Return the arms of the tendons at one end, (tendons, joints), m per unit of the joints' coordinates."""
        joints = self.tip_joints if place == "tip" else self.handle_joints
        index = {joint.name: i for i, joint in enumerate(joints)}
        arms = np.zeros((len(self.tendons), len(joints)))
        for row, tendon in zip(arms, self.tendons, strict=True):
            for crossing in tendon.route:
                if crossing.joint in index:
                    joint = joints[index[crossing.joint]]
                    per_unit = 2.0 if joint.mechanism == "tendon-gear" else 1.0
                    radius = joint.radius if crossing.radius is None else crossing.radius
                    row[index[crossing.joint]] += SIGNS[crossing.side] * per_unit * radius
        return arms

    @cached_property
    def stiffnesses(self) -> Array:
        """Stiffness of every tendon, (tendons,), N/m: as given, or E A / L."""
        return np.array([self._stiffness(tendon) for tendon in self.tendons])

    @cached_property
    def pretensions(self) -> Array:
        """Tension of every tendon at rest, (tendons,), N."""
        own = (self.pretension if tendon.pretension is None else tendon.pretension for tendon in self.tendons)
        return np.array(list(own))

    @cached_property
    def core(self) -> _core.Wrist:
        """The instrument in the core's form."""
        joints, bearing = self.tip_joints, self.bearing
        numbers = np.zeros((len(joints), 9))
        for i, joint in enumerate(joints):
            length = joint.end_effector_length or 0.0
            share = 1 / len(bearing) if i in bearing else 0.0
            arm = self.grip_arms[i]
            numbers[i] = (*joint.axis_vector, joint.offset, joint.chord, length, joint.own_stiffness, share, arm)
        return _core.Wrist(
            [_MECHANISMS[joint.mechanism] for joint in joints],
            list(self.parents),
            numbers,
            self.tendon_arms("tip"),
            np.column_stack([self.stiffnesses, self.pretensions]),
            [int(tendon.start == "spool") for tendon in self.tendons],
            [_MECHANISMS[joint.mechanism] for joint in self.handle_joints],
            np.ascontiguousarray(self.tendon_arms("handle")),
        )

    def replace(self, **changes: Any) -> Self:
        """Return this instrument with some values changed, by key; lists of tables as lists of dictionaries.

        Raises InstrumentError if a key is unknown or a value is not allowed.
        """
        values = self.model_dump(exclude_unset=True) | changes
        kept = {key: value for key, value in values.items() if value is not None}
        return validated(type(self), kept, InstrumentError, entries=ENTRIES)

    def __repr__(self) -> str:
        joints = ", ".join(joint.name for joint in self.tip_joints)
        return f"<CoupledInstrument {self.name!r}: {joints}; {len(self.tendons)} tendons>"

    __str__ = __repr__

    def __hash__(self) -> int:
        return hash((self.name, len(self.joints), len(self.tendons), self.pretension))

    def _repr_html_(self) -> str:
        """Return a table for notebooks: the arms of the tendons about the tip's joints."""
        arms = 1e3 * self.tendon_arms("tip")
        rows = [(tendon.name, *(f"{arm:.4g}" for arm in row)) for tendon, row in zip(self.tendons, arms, strict=True)]
        return notebook.table(f"{self.name}: arms in mm", ("tendon", *(j.name for j in self.tip_joints)), rows)

    def _stiffness(self, tendon: Tendon) -> float:
        if tendon.stiffness is not None:
            return tendon.stiffness
        if self.tendon_stiffness is not None and tendon.length is None:
            return self.tendon_stiffness
        length = self.tendon_length if tendon.length is None else tendon.length
        if self.tendon_modulus is None or self.tendon_diameter is None or length is None:
            raise ValueError(
                f"tendon {tendon.name} has no stiffness; give tendon_stiffness, or tendon_diameter, tendon_modulus and "
                "tendon_length"
            )
        return self.tendon_modulus * math.pi / 4 * self.tendon_diameter**2 / length

    @model_validator(mode="after")
    def _coherent(self) -> Self:
        self._check_joints()
        for tendon in self.tendons:
            _check_route(self, tendon)
            self._stiffness(tendon)
        _check_distinct("tendons", [tendon.name for tendon in self.tendons])
        self._check_held()
        self._check_friction()
        if self.sensors.kind != "load-cell":
            raise ValueError(
                f'sensors.kind is "{self.sensors.kind}", which instruments whose joints share tendons do not have; it '
                "must be load-cell"
            )
        return self

    def _check_joints(self) -> None:
        _check_distinct("joints", [joint.name for joint in self.joints])
        tips, handles = self.tip_joints, self.handle_joints
        if not 1 <= len(tips) <= MOST_JOINTS:
            raise ValueError(f"joints has {len(tips)} at the tip; there must be 1 to {MOST_JOINTS}")
        if len(handles) > len(tips):
            raise ValueError(
                f"joints has {len(handles)} at the handle; there must be at most {len(tips)}, as at the tip"
            )
        before: list[str] = ["stem"]
        for joint in tips:
            if joint.on is not None and joint.on not in before:
                raise ValueError(f"joint {joint.name}: on = {joint.on!r}; it must be one of {', '.join(before)}")
            before.append(joint.name)
        held = self.grip.jaws if self.grip is not None and self.grip.length is not None and self.bearing else ()
        for i in self.ends:
            if tips[i].end_effector_length is None and tips[i].name not in held:
                raise ValueError(f"joint {tips[i].name} is the last; its end_effector_length must be given")
        if self.grip is not None:
            names = [tips[i].name for i in self.ends]
            wrong = [jaw for jaw in self.grip.jaws if jaw not in names]
            if wrong:
                raise ValueError(f"grip.jaws names {wrong[0]!r}; it must name the last joints: {', '.join(names)}")

    def _check_friction(self) -> None:
        friction = self.friction
        if friction.law not in COUPLED_LAWS:
            raise ValueError(f'friction.law is "{friction.law}"; of a coupled instrument it must be one of {_LAWS}')
        if friction.sheath_contacts > MOST_SHEATH_CONTACTS:
            given = friction.sheath_contacts
            raise ValueError(f"friction.sheath_contacts is {given}; it must be at most {MOST_SHEATH_CONTACTS}")
        planar = ("vertices_per_joint", "sheath_bend_per_handle_angle", "base_wrap", "tendon_bending_stiffness")
        for key in (*planar, "passing_coefficient"):
            given, default = getattr(friction, key), Friction.model_fields[key].default
            if given != default:
                instead = "; give base_wrap in a tendon's route" if key == "base_wrap" else ""
                raise ValueError(f"friction.{key} is {given:g}, which a coupled instrument does not have{instead}")
        if self.spool_radius is not None and "spool_radius" in self.drives.model_fields_set:
            raise ValueError("spool_radius and drives.spool_radius are both given; give one of them")

    def _check_held(self) -> None:
        """Refuse joints that nothing holds, and tendons that leave a motion of several joints free."""
        arms = self.tendon_arms("tip")
        sprung = np.array([joint.own_stiffness > 0 for joint in self.tip_joints])
        for joint, column, spring in zip(self.tip_joints, arms.T, sprung, strict=True):
            missing = [side for side, pulls in (("agonist", column > 0), ("antagonist", column < 0)) if not pulls.any()]
            if missing and not spring:
                raise RouteError(
                    f"joint {joint.name} has no {' and no '.join(missing)}: no tendon crosses it on that side; give it "
                    "one, or a spring by its stiffness",
                    self,
                    joints=[joint.name],
                )
        scale = np.abs(arms).max(axis=0)
        held = np.vstack([arms / np.where(scale > 0, scale, 1.0), np.diag(sprung.astype(float))])
        if np.linalg.matrix_rank(held) < len(self.tip_joints):
            names = [joint.name for joint in self.tip_joints]
            raise RouteError(
                f"the coupling matrix of {', '.join(names)} is singular: a motion of several joints draws no tendon; "
                "it must have full rank",
                self,
                joints=names,
            )


ENTRIES = {"joints": "joint", "tendons": "tendon"}
"""What an entry of a list of tables is called in messages."""


def _check_distinct(key: str, names: Sequence[str]) -> None:
    double = next((name for name in names if names.count(name) > 1), None)
    if double is not None:
        raise ValueError(f"{key} has {double} twice; names must differ")


def _check_route(inst: CoupledInstrument, tendon: Tendon) -> None:
    known, sides = [joint.name for joint in inst.joints], dict[str, str]()
    for crossing in tendon.route:
        name = crossing.joint
        if name not in known:
            sentence = f"tendon {tendon.name}: joint = {name!r}; it must be one of {', '.join(known)}"
            raise RouteError(sentence, inst, tendon=tendon.name, joints=[name])
        if name in sides:
            contradiction = sides[name] != crossing.side
            how = f", as {sides[name]} and as {crossing.side}" if contradiction else ""
            sentence = f"tendon {tendon.name} crosses joint {name} twice{how}; it must cross a joint once"
            raise RouteError(sentence, inst, tendon=tendon.name, joints=[name])
        sides[name] = crossing.side

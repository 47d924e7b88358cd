"""Joints and tendons, as a file lists them: what every instrument consists of."""

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import AfterValidator, ConfigDict, Field, model_validator

from tenodesis import _core
from tenodesis.errors import ArgumentError
from tenodesis.instrument.hardware import Hand
from tenodesis.toml import FileTable
from tenodesis.units import (
    Angle,
    AngleRanges,
    Coefficient,
    CubicStiffness,
    Damping,
    FlexuralRigidity,
    Force,
    HandStiffness,
    Inertia,
    Length,
    Mass,
    Rate,
    SheathBend,
    SignedForce,
    Spacing,
    Stiffness,
    StopAngles,
    TendonDamping,
)

Mechanism = Literal["tendon-gear", "pulley", "continuum"]
Side = Literal["agonist", "antagonist", "middle"]
FARTHEST_STOP = 3.0
"""Largest angle of a stop that no file gives, rad."""

AXES: Mapping[str, tuple[float, float, float]] = {"yaw": (0, 1, 0), "pitch": (-1, 0, 0), "roll": (0, 0, 1)}
"""Axis about which a positive angle turns, by its name: yaw bends the tip toward x, pitch toward y."""

MECHANISMS: Mapping[str, int] = {"tendon-gear": 0, "pulley": 1, "continuum": 2}
"""The core's number of a mechanism, by its name."""
SIGNS: Mapping[str, float] = {"agonist": 1.0, "antagonist": -1.0, "middle": 0.0}
"""Side of a joint to which a tendon bends it, by its name."""


def _short(name: str) -> str:
    if not (name.isascii() and name.replace("_", "a").isalnum() and len(name) <= 40 and not name[0].isdigit()):
        raise ArgumentError("it must be a name of letters, digits and underscores, of at most 40 characters")
    return name


TieRatio = Annotated[float, Field(ge=-100, le=100, strict=True)]
"""Angle of a joint over that of another."""
ShortName = Annotated[str, Field(min_length=1), AfterValidator(_short)]
"""Name of a joint or a tendon, as recordings and exported models have it."""


def arc_suffix(arc: int) -> str:
    """Return what follows a backbone's name in that of an arc, as :meth:`tenodesis.run.Names.arcs` finds it."""
    return f"_arc{arc}"


class Joint(FileTable):
    """A joint at the tip or at the handle."""

    # A table that is written out, as a dictionary too, has the file's keys.
    model_config = ConfigDict(serialize_by_alias=True)

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
    arcs: int | None = Field(
        default=None,
        ge=1,
        le=24,
        strict=True,
        description="Arcs that a backbone bends in, 1 or an even number; by default as many as its range takes",
    )
    arc: int = Field(default=0, ge=0, le=24, strict=True, description="Number of this arc, from the stem; 0: no part")
    planes: Literal[1, 2] = Field(
        default=1, description="Planes that a backbone bends in: that of its axis, or also the one across, 90 deg on"
    )
    within: str | None = Field(
        default=None, description="Backbone just before it that bends the same length about another axis"
    )
    torsional_rigidity: FlexuralRigidity | None = Field(
        default=None, description="Torsional rigidity G J of a backbone; by default it does not twist"
    )
    tied_to: str | None = Field(default=None, description="Joint before it at the tip that it turns with, by tie_ratio")
    tie_ratio: TieRatio = Field(default=1.0, description="Its angle over that of the joint that it is tied to")
    stiffness: HandStiffness | None = Field(default=None, description="Of a spring in the joint")
    cubic_stiffness: CubicStiffness = Field(
        default=0.0, description="Moment of the spring by the cube of the angle, in rad, beside that by the angle"
    )
    given_range: AngleRanges = Field(
        default=math.radians(80),
        alias="range",
        description="Working range of its angle to either side; at the tip also a list of its two limits",
    )
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
    stop: StopAngles | None = Field(
        default=None, description="Angle of its mechanical stop, or of both; by default a third beyond its range"
    )

    @property
    def axis_vector(self) -> tuple[float, float, float]:
        """Unit vector about which a positive angle turns."""
        x, y, z = AXES[self.axis] if isinstance(self.axis, str) else self.axis
        norm = math.sqrt(x * x + y * y + z * z)
        return x / norm, y / norm, z / norm

    @property
    def chord(self) -> float:
        """Length of the straight joint, m: between a gear pair's centres, or of the backbone; 0 within another."""
        if self.within is not None:
            return 0.0
        return _core.joint_straight_chord(MECHANISMS[self.mechanism], self.radius, self.backbone_length or 0.0)

    @property
    def arc_count(self) -> int:
        """Arcs that it bends in: one where its file does not say, until the default is found."""
        return self.arcs or 1

    @property
    def bend(self) -> str:
        """Name of what bends: of the backbone that it is an arc of, or its own."""
        return self.name.removesuffix(arc_suffix(self.arc)) if self.arc else self.name

    @property
    def is_twist(self) -> bool:
        """Whether it stands for a part of a backbone's torsion."""
        return bool(self.arc) and self.mechanism == "pulley"

    @property
    def backbone_stiffness(self) -> float:
        """Stiffness E I / L of the backbone as one arc, N m/rad; 0 without one."""
        return (self.backbone_rigidity or 0.0) / self.backbone_length if self.backbone_length else 0.0

    @property
    def own_stiffness(self) -> float:
        """Stiffness of spring and backbone about the straight joint, N m/rad."""
        return (self.stiffness or 0.0) + self.backbone_stiffness

    @property
    def is_sprung(self) -> bool:
        """Whether a spring or a backbone holds it."""
        return self.own_stiffness > 0 or self.cubic_stiffness > 0

    @property
    def limits(self) -> tuple[float, float]:
        """Ends of its working range, rad."""
        given = self.given_range
        return given if isinstance(given, tuple) else (-given, given)

    @property
    def range(self) -> float:
        """Largest angle of its working range to either side, rad."""
        return max(map(abs, self.limits))

    @property
    def range_text(self) -> str:
        """Working range as people write it, in degrees: ±80, or -20 to 80."""
        low, high = map(math.degrees, self.limits)
        return f"±{high:.4g}" if isinstance(self.given_range, float) else f"{low:.4g} to {high:.4g}"

    @property
    def stops(self) -> tuple[float, float]:
        """Angles of its mechanical stops, rad."""
        if self.stop is not None:
            return self.stop if isinstance(self.stop, tuple) else (-self.stop, self.stop)
        low, high = self.limits
        beyond = (high - low) / 6
        return max(low - beyond, -FARTHEST_STOP), min(high + beyond, FARTHEST_STOP)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        is_continuum = self.mechanism == "continuum"
        for key in ("backbone_length", "backbone_rigidity"):
            if is_continuum != (getattr(self, key) is not None):
                needed = "is missing" if is_continuum else f"is given, but a {self.mechanism} has no backbone"
                raise ArgumentError(f"{key} {needed}; it must be {'given' if is_continuum else 'left out'}", key=key)
        bends = is_continuum and self.place == "tip"
        arcs = self.arc_count
        if arcs > 1 and not (bends and arcs % 2 == 0) and not self.is_twist:
            raise ArgumentError(
                f"arcs is {arcs}; it must be 1 or an even number, for a continuum at the tip", key="arcs"
            )
        if self.arc > arcs:
            raise ArgumentError(f"arc is {self.arc}; it must be at most arcs, {arcs}", key="arc")
        if self.place == "handle" and isinstance(self.given_range, tuple):
            raise ArgumentError("range is a list; at the handle it must be one angle, to either side", key="range")
        if self.planes == 2 and isinstance(self.given_range, tuple):
            raise ArgumentError("range is a list; in two planes it must be one angle, to either side", key="range")
        if self.cubic_stiffness and is_continuum:
            raise ArgumentError(
                "cubic_stiffness is given, but a backbone bends by its rigidity; leave it out", key="cubic_stiffness"
            )
        for key, default in (("planes", 1), ("within", None), ("torsional_rigidity", None)):
            if getattr(self, key) != default and not bends:
                raise ArgumentError(f"{key} is given; only a continuum at the tip has it; leave it out", key=key)
        if self.planes == 2 and self.within is not None:
            raise ArgumentError("planes is 2 and within is given; give one of them", key="planes")
        if not isinstance(self.axis, str) and not math.hypot(*self.axis) > 0:
            raise ArgumentError(
                f"axis is {list(self.axis)}; it must be yaw, pitch, roll or a vector that is not zero", key="axis"
            )
        if self.mechanism != "pulley" and abs(self.axis_vector[2]) > 1e-9:
            given = self.axis if isinstance(self.axis, str) else list(self.axis)
            raise ArgumentError(
                f"axis is {given}; a {self.mechanism} bends only about an axis across z, the last number 0", key="axis"
            )
        return self


class LinkDynamics(Hand):
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
    side: Side | None = Field(
        default=None,
        description="Side of the joint: agonist bends it to positive angles, middle does not bend it; or give angle",
    )
    angle: Angle | None = Field(
        default=None, description="Angle round a backbone from its agonist's side, toward y for yaw, instead of side"
    )
    radius: Spacing | None = Field(default=None, description="Distance from the joint's middle; by default its radius")
    far_radius: Spacing | None = Field(
        default=None, description="The same at the far end of a backbone in arcs, if it changes evenly along it"
    )
    base_wrap: SheathBend = Field(
        default=0.0,
        description="Bend over the straight joint; a pulley that turns to the tendon's side unwinds it, else bends add",
    )
    guide_wrap: SheathBend = Field(
        default=0.0, description="Bend over guides or edges beside the joint, to which its angle adds either way"
    )
    coefficient: Coefficient | None = Field(
        default=None, description="Friction coefficient there; by default friction.vertex_coefficient"
    )

    @model_validator(mode="after")
    def _on_a_side(self) -> Self:
        if (self.side is None) == (self.angle is None):
            found = "side and angle are both" if self.side else "neither side nor angle is"
            raise ArgumentError(f"{found} given where joint is {self.joint!r}; give one of them", key="side")
        return self


class GrowingStiffness(FileTable):
    """Stiffness of a tendon by its tension: straight between the entries, and constant beyond the last."""

    tension: tuple[Force, ...] = Field(
        min_length=2, max_length=_core.MOST_STRETCH_ENTRIES, description="Tensions, from 0 N, rising"
    )
    stiffness: tuple[Stiffness, ...] = Field(description="Stiffness at each, not falling")

    @model_validator(mode="after")
    def _grows(self) -> Self:
        if len(self.tension) != len(self.stiffness):
            found = f"stiffness has {len(self.stiffness)} values and tension {len(self.tension)}"
            raise ArgumentError(f"{found}; there must be one for each tension", key="stiffness")
        if self.tension[0] != 0 or any(b <= a for a, b in pairwise(self.tension)):
            raise ArgumentError("tension must begin at 0 N and rise", key="tension")
        fall = next((i for i, (a, b) in enumerate(pairwise(self.stiffness)) if b < a), None)
        if fall is not None:
            raise ArgumentError(
                f"stiffness falls from {self.stiffness[fall]:g} to {self.stiffness[fall + 1]:g} N/m as the tension "
                f"rises from {self.tension[fall]:g} N; it must not fall",
                key="stiffness",
            )
        return self

    def at(self, tension: float) -> float:
        """Return the stiffness at a tension, N/m."""
        return float(np.interp(tension, self.tension, self.stiffness))


class Tendon(FileTable):
    """A tendon and its route from the handle's end to the tip."""

    name: ShortName = Field(description="Name of the tendon")
    start: Literal["spool", "anchor"] = Field(default="spool", description="Its near end: a motor's spool, or fixed")
    route: tuple[Crossing, ...] = Field(min_length=1, description="Joints that it crosses, from handle to tip")
    stiffness: Stiffness | None = Field(default=None, description="By default E A / L")
    stiffness_by_tension: GrowingStiffness | None = Field(
        default=None, description="Stiffness that grows with the tension, instead of stiffness"
    )
    damping: TendonDamping = Field(default=0.0, description="Force by the rate at which the tendon stretches")
    length: Length | None = Field(default=None, description="By default the instrument's tendon_length")
    pretension: Force | None = Field(default=None, description="Tension at rest; by default the instrument's")
    load_cell_bias: SignedForce = Field(default=0.0, description="On the bench, of its load cell or tension by current")

    @model_validator(mode="after")
    def _one_stiffness(self) -> Self:
        if self.stiffness is not None and self.stiffness_by_tension is not None:
            raise ArgumentError("stiffness and stiffness_by_tension are both given; give one of them", key="stiffness")
        return self


class Grip(FileTable):
    """Jaws that press on an object."""

    jaws: tuple[str, ...] = Field(min_length=1, max_length=2, description="Joints of the jaws; the first opens to +")
    length: Length | None = Field(default=None, description="From the jaws' axis to the object; by default their tip")

"""The joint types of the short form: the values that instruments of each have in addition to the common ones."""

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from tenodesis.errors import ArgumentError
from tenodesis.instrument.expansion import expand
from tenodesis.instrument.full_form import FullForm
from tenodesis.instrument.joints import Joint, Tendon
from tenodesis.instrument.short_form import ShortForm
from tenodesis.units import FlexuralRigidity, Length

_LENGTHS = ("handle_length", "end_effector_length")
_TENDON = ("given_stiffness", "tendon_modulus", "tendon_diameter", "tendon_length", "pretension")
_SHARED_FIELDS = {name: name for name in (*_LENGTHS, *_TENDON)}


class Expandable(ShortForm):
    """The short form with the joints and tendons that it stands for."""

    @cached_property
    def expanded(self) -> FullForm:
        """The instrument as joints and tendons: what its file is short for.

        Tendons of the second axis pass the first joint in its middle plane, at the tip as at the handle. The table
        mismatch is left out: it is not of the instrument, but of a bench.
        """
        return expand(self)

    @property
    def as_chain(self) -> FullForm:
        """The joints and tendons that statics act on: those of the first axis."""
        return self.planar[0].expanded

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Joints from the stem outward, those of the handle first."""
        return self.expanded.joints

    @property
    def tendons(self) -> tuple[Tendon, ...]:
        """The pair of tendons of every axis, agonist first."""
        return self.expanded.tendons

    @property
    def grip(self) -> None:
        """Jaws that grip: none."""
        return None


class TendonGear(Expandable):
    """An instrument whose joints are rolling gear pairs."""

    joint_type: Literal["tendon-gear"]
    distal_gear_radius: Length = Field(description="Pitch radius of the distal gears")
    proximal_gear_radius: Length = Field(description="Pitch radius of the proximal gears")

    parameter_fields: ClassVar[Mapping[str, str]] = _SHARED_FIELDS | {
        "proximal_gear_radius": "proximal_radius",
        "distal_gear_radius": "distal_radius",
    }


class TendonPulley(Expandable):
    """An instrument whose joints are pulleys."""

    joint_type: Literal["tendon-pulley"]
    distal_pulley_radius: Length = Field(description="Radius of the distal pulley")
    proximal_pulley_radius: Length = Field(description="Radius of the proximal pulley")

    parameter_fields: ClassVar[Mapping[str, str]] = _SHARED_FIELDS | {
        "proximal_pulley_radius": "proximal_radius",
        "distal_pulley_radius": "distal_radius",
    }


class Continuum(Expandable):
    """An instrument whose tip is an elastic backbone bent by tendons, driven by a pulley at the handle."""

    joint_type: Literal["continuum"]
    distal_tendon_offset: Length = Field(description="Distance of a tendon from the backbone")
    proximal_pulley_radius: Length = Field(description="Radius of the proximal pulley")
    backbone_length: Length = Field(description="Length of the backbone that bends")
    backbone_rigidity: FlexuralRigidity = Field(description="Flexural rigidity E I of the backbone")
    arcs: int = Field(
        default=1,
        ge=1,
        le=24,
        strict=True,
        description="Arcs that the backbone bends in; more than one makes the file one of joints and tendons",
    )

    parameter_fields: ClassVar[Mapping[str, str]] = _SHARED_FIELDS | {
        "proximal_pulley_radius": "proximal_radius",
        "distal_tendon_offset": "distal_radius",
        "backbone_length": "backbone_length",
        "backbone_rigidity": "backbone_rigidity",
    }

    @model_validator(mode="after")
    def _one_arc(self, info: ValidationInfo) -> Self:
        if self.arcs > 1 and not (info.context and info.context.get("file")):
            raise ArgumentError(
                f"arcs is {self.arcs}; equations 1 to 22 know one arc; use tenodesis.instrument.in_arcs", key="arcs"
            )
        return self


JOINT_TYPES: dict[str, type[ShortForm]] = {
    "tendon-gear": TendonGear,
    "tendon-pulley": TendonPulley,
    "continuum": Continuum,
}

SHORT_FORM = Annotated[TendonGear | TendonPulley | Continuum, Field(discriminator="joint_type")]

"""The joint mechanisms: the properties that instruments of each have in addition to the common properties."""

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import Field, TypeAdapter

from tenodesis.instrument.instrument import Instrument
from tenodesis.units import FlexuralRigidity, Length

_LENGTHS = ("handle_length", "end_effector_length")
_TENDON = ("given_stiffness", "tendon_modulus", "tendon_diameter", "tendon_length", "pretension")
_SHARED_FIELDS = {name: name for name in (*_LENGTHS, *_TENDON)}


class TendonGear(Instrument):
    """An instrument whose joints are rolling gear pairs."""

    joint_type: Literal["tendon-gear"]
    distal_gear_radius: Length = Field(description="Pitch radius of the distal gears")
    proximal_gear_radius: Length = Field(description="Pitch radius of the proximal gears")

    parameter_fields: ClassVar[Mapping[str, str]] = _SHARED_FIELDS | {
        "proximal_gear_radius": "proximal_radius",
        "distal_gear_radius": "distal_radius",
    }


class TendonPulley(Instrument):
    """An instrument whose joints are pulleys."""

    joint_type: Literal["tendon-pulley"]
    distal_pulley_radius: Length = Field(description="Radius of the distal pulley")
    proximal_pulley_radius: Length = Field(description="Radius of the proximal pulley")

    parameter_fields: ClassVar[Mapping[str, str]] = _SHARED_FIELDS | {
        "proximal_pulley_radius": "proximal_radius",
        "distal_pulley_radius": "distal_radius",
    }


class Continuum(Instrument):
    """An instrument whose tip is an elastic backbone bent by tendons, driven by a pulley at the handle."""

    joint_type: Literal["continuum"]
    distal_tendon_offset: Length = Field(description="Distance of a tendon from the backbone")
    proximal_pulley_radius: Length = Field(description="Radius of the proximal pulley")
    backbone_length: Length = Field(description="Length of the backbone that bends")
    backbone_rigidity: FlexuralRigidity = Field(description="Flexural rigidity E I of the backbone")

    parameter_fields: ClassVar[Mapping[str, str]] = _SHARED_FIELDS | {
        "proximal_pulley_radius": "proximal_radius",
        "distal_tendon_offset": "distal_radius",
        "backbone_length": "backbone_length",
        "backbone_rigidity": "backbone_rigidity",
    }


JOINT_TYPES: dict[str, type[Instrument]] = {
    "tendon-gear": TendonGear,
    "tendon-pulley": TendonPulley,
    "continuum": Continuum,
}

ANY_INSTRUMENT: TypeAdapter[Instrument] = TypeAdapter(
    Annotated[TendonGear | TendonPulley | Continuum, Field(discriminator="joint_type")]
)

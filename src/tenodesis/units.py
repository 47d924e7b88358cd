"""Physical quantities: written with their unit in files and options, stored in SI; each type with its bounds."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from numbers import Real
from typing import TYPE_CHECKING, Annotated, Any, get_args

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo, WithJsonSchema
from pydantic.fields import FieldInfo

if TYPE_CHECKING:
    from pint import UnitRegistry

STANDARD_GRAVITY = 9.80665
"""Weight of a mass, N/kg."""

_ANGLE_UNITS = {"radian", "milliradian", "degree", "arcminute", "turn"}

_FACTORS = {
    "mm": ("m", 1e-3), "um": ("m", 1e-6), "mN": ("N", 1e-3), "GPa": ("Pa", 1e9), "MPa": ("Pa", 1e6), "g": ("kg", 1e-3),
    "deg": ("rad", math.pi / 180), "deg/s": ("rad/s", math.pi / 180), "ms": ("s", 1e-3), "Hz": ("Hz", 1.0),
    "mm/s": ("m/s", 1e-3), "N/mm": ("N/m", 1e3), "N*mm": ("N*m", 1e-3), "N*mm^2": ("N*m^2", 1e-6),
    "mV": ("V", 1e-3), "deg/V": ("rad/V", math.pi / 180),
}  # fmt: skip
"""SI unit and factor of the usual units, as pint has them: most files do without pint, which takes long to load."""

# Number and unit are separated here, not by pint, which would evaluate arithmetic and ignore a decimal comma.
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+|nan|inf)(?:[eE][-+]?[0-9]+)?"
_UNIT = r"(?:[^\W\d_]+(?:(?:\^|\*\*)-?[0-9])?|°)"
_WRITTEN = re.compile(rf"(?P<number>{_NUMBER})(?P<unit>\s*|\s*(?:1\s*/\s*)?{_UNIT}(?:(?:\s*[*/·]\s*|\s+){_UNIT})*)")


@dataclass(frozen=True)
class Quantity:
    """A kind of quantity: its name, SI unit, an example of how to write it, and its bounds in SI."""

    name: str
    unit: str
    example: str
    above: float | None = None
    at_least: float | None = None
    below: float | None = None

    @property
    def allowed(self) -> str:
        """What a value must be, as the end of a sentence."""
        bounds = [
            f"{word} {bound:g} {self.unit}"
            for word, bound in (("above", self.above), ("of at least", self.at_least), ("below", self.below))
            if bound is not None
        ]
        article = "an" if self.name[0] in "aeiou" else "a"
        return " ".join([f"{article} {self.name}", *([" and ".join(bounds)] if bounds else [])])

    def allows(self, number: float) -> bool:
        """Return whether a number, in SI, is finite and within the bounds."""
        return (
            math.isfinite(number)
            and (self.above is None or number > self.above)
            and (self.at_least is None or number >= self.at_least)
            and (self.below is None or number < self.below)
        )

    def parse(self, value: Any, info: ValidationInfo) -> float:
        """Read a value into SI: text with a unit, or outside files a bare SI number.

        Raises
        ------
        ValueError
            The value is no number, lacks its unit, has another dimension or is outside its bounds.
        """
        if isinstance(value, str):
            number = self._read(value)
        elif isinstance(value, bool) or not isinstance(value, Real):
            raise ValueError(f'it must be {self.allowed}, written like "{self.example}"')
        elif info.context and info.context.get("file"):
            raise ValueError(f'it has no unit; write {self.allowed} like "{self.example}"')
        else:
            number = float(value)
        if not self.allows(number):
            raise ValueError(f"it must be {self.allowed}")
        return number

    def _read(self, text: str) -> float:
        written = _WRITTEN.fullmatch(text.strip())
        if written is None and (point := re.sub(r"(?<=\d),(?=\d)", ".", text)) != text:
            raise ValueError(f'it has a decimal comma; write it with a point, like "{point.strip()}"')
        if written is None:
            raise ValueError(f'it is not understood; write {self.allowed} like "{self.example}"')
        number, unit_text = float(written["number"]), str(written["unit"]).strip()
        if not unit_text:
            raise ValueError(f'it has no unit; write {self.allowed} like "{self.example}"')
        si_unit, factor = _FACTORS.get(unit_text, (unit_text, 1.0))
        if si_unit == self.unit:
            return number * factor
        units = _units()
        try:
            unit: Any = units.Unit(unit_text.replace("·", "*"))
        except Exception as problem:  # pint raises whatever its tokenizer does
            raise ValueError(f'it is not understood; write {self.allowed} like "{self.example}"') from problem
        # Angles have no dimension, and neither have percents or mm/mm, which are no angles.
        angle = self.unit == "rad"
        if unit.dimensionality != units.Unit(self.unit).dimensionality or (angle and str(unit) not in _ANGLE_UNITS):
            raise ValueError(f'it is measured in {unit_text}; it must be {self.allowed}, written like "{self.example}"')
        return float(units.Quantity(number, unit).to(self.unit).magnitude)


def annotation(quantity: Quantity) -> tuple[BeforeValidator, WithJsonSchema, Quantity]:
    """Return the annotation of a pydantic field of this quantity: its reader, its editor schema, and itself."""
    description = f"{quantity.allowed}, with its unit"
    schema = {
        "type": "string",
        "description": description[0].upper() + description[1:],
        "examples": [quantity.example],
        "pattern": r"^\s*[-+]?[0-9.]+([eE][-+]?[0-9]+)?(\s*[^0-9\s]|\s+1\s*/).*$",
    }
    return BeforeValidator(quantity.parse), WithJsonSchema(schema), quantity


def either_side(quantity: Quantity, limit: Quantity) -> tuple[BeforeValidator, WithJsonSchema, Quantity]:
    """Return the annotation of a field that holds an angle to either side, or a list of its two limits round zero."""

    def parse(value: Any, info: ValidationInfo) -> float | tuple[float, float]:
        if not isinstance(value, list | tuple):
            return quantity.parse(value, info)
        if len(value) != 2:
            example = f'["{limit.example}", "{quantity.example}"]'
            raise ValueError(f"it must be {quantity.allowed}, or two limits like {example}")
        low, high = (limit.parse(one, info) for one in value)
        if not (low <= 0 <= high and low < high):
            raise ValueError("its limits must rise and have zero, the straight joint, between them")
        return low, high

    _, schema, _ = annotation(quantity)
    _, one, _ = annotation(limit)
    either = {"anyOf": [schema.json_schema, {"type": "array", "items": one.json_schema, "minItems": 2, "maxItems": 2}]}
    return BeforeValidator(parse), WithJsonSchema(either), quantity


def quantity_of(field: FieldInfo) -> Quantity | None:
    """Return the kind of quantity of a pydantic field, or None; for an optional field or a list, that of its values."""
    return _quantity_of(field.annotation, field.metadata)


def unit_in(text: str) -> str:
    """Return the unit of a quantity as it is written."""
    written = _WRITTEN.fullmatch(text.strip())
    return "" if written is None else str(written["unit"]).strip()


def unit_of(field: FieldInfo) -> str:
    """Return the SI unit of a pydantic field, empty if it is no quantity."""
    quantity = quantity_of(field)
    return quantity.unit if quantity else ""


def _quantity_of(annotation: Any, metadata: Sequence[Any] = ()) -> Quantity | None:
    found = next((item for item in metadata if isinstance(item, Quantity)), None)
    inner = (_quantity_of(option, getattr(option, "__metadata__", ())) for option in get_args(annotation))
    return found or next((quantity for quantity in inner if quantity is not None), None)


@cache
def in_unit(unit: str, si_unit: str) -> float:
    """Return the factor from `si_unit` to `unit`, for showing SI values on screen and in reports."""
    usual, factor = _FACTORS.get(unit, (unit, 1.0))
    if usual == si_unit:
        return 1 / factor
    return float(_units().Quantity(1.0, si_unit).to(unit).magnitude)


READABLE = {"m": "mm", "Pa": "GPa", "rad": "deg", "s": "ms", "rad/s": "deg/s", "m/s": "mm/s"}
"""Units of drawings, by SI unit."""


def in_words(value: float, si_unit: str) -> str:
    """Return a value as text for people, to six digits, in the unit of drawings."""
    unit = READABLE.get(si_unit, si_unit)
    factor = in_unit(unit, si_unit) if unit != si_unit else 1.0
    return f"{value * factor:.6g} {unit.replace('*', '·').replace('^2', '²')}".removesuffix(" 1")


@cache
def _units() -> "UnitRegistry[float]":
    """Return pint's units; pint takes long to import, and only text with a unit needs it."""
    from pint import UnitRegistry  # noqa: PLC0415

    return UnitRegistry()


def _not_zero(value: float) -> float:
    if value == 0:
        raise ValueError("it is 0; it must be any other value")
    return value


def _oscillating(value: Any) -> Any:
    """Refuse text in a unit of angular velocity, whose number is 2 pi times that of the frequency."""
    if isinstance(value, str) and _TURNING_UNIT.search(value):
        raise ValueError('it is measured by angle; write a frequency like "0.5 Hz"')
    return value


_TURNING_UNIT = re.compile(r"deg|°|rad|turn|rev|arcmin|rpm")


def _turning(value: Any) -> Any:
    """Refuse text in a unit that is as often a second but no angle, such as Hz."""
    if isinstance(value, str) and any(letter.isalpha() for letter in value) and not _TURNING_UNIT.search(value):
        raise ValueError('it is not measured by angle; write it like "20 deg/s"')
    return value


# The bounds are wide of anything that can be built; they keep slips of a unit, and of arithmetic, out of the results.

Length = Annotated[float, *annotation(Quantity("length", "m", "2 mm", above=1e-7, below=100))]
Spacing = Annotated[float, *annotation(Quantity("length", "m", "4 mm", at_least=0, below=100))]
LengthDeviation = Annotated[float, *annotation(Quantity("length", "m", "5 um", at_least=0, below=1))]

Force = Annotated[float, *annotation(Quantity("force", "N", "30 N", at_least=0, below=1e5))]
PositiveForce = Annotated[float, *annotation(Quantity("force", "N", "0.5 N", above=1e-6, below=1e5))]
SignedForce = Annotated[float, *annotation(Quantity("force", "N", "-0.2 N", above=-1e5, below=1e5))]
WindingTension = Annotated[float, *annotation(Quantity("force", "N", "30 N", above=0, below=1e5))]
LoadCellRange = Annotated[float, *annotation(Quantity("force", "N", "200 N", above=0, below=1e6))]
Moment = Annotated[float, *annotation(Quantity("moment", "N*m", "0.15 N*m", above=0, below=1e5))]
SignedMoment = Annotated[float, *annotation(Quantity("moment", "N*m", "0.15 N*m", above=-1e5, below=1e5))]

Angle = Annotated[float, *annotation(Quantity("angle", "rad", "20 deg"))]
_RANGE = Quantity("angle", "rad", "45 deg", above=0, below=math.pi)
AngleRange = Annotated[float, *annotation(_RANGE)]
AngleError = Annotated[float, *annotation(Quantity("angle", "rad", "0.5 deg", at_least=0, below=math.pi))]
SimilarityError = Annotated[float, *annotation(Quantity("angle", "rad", "2 deg", above=0, below=4))]
_LIMIT = Quantity("angle", "rad", "-20 deg", above=-math.pi, below=math.pi)
AngleRanges = Annotated[float | tuple[float, float], *either_side(_RANGE, _LIMIT)]
SheathBend = Annotated[float, *annotation(Quantity("angle", "rad", "60 deg", at_least=0, below=1e3))]
_STOP = Quantity("angle", "rad", "100 deg", above=0, below=3.0)
StopAngle = Annotated[float, *annotation(_STOP)]
_STOP_LIMIT = Quantity("angle", "rad", "-30 deg", above=-3.0, below=3.0)
StopAngles = Annotated[float | tuple[float, float], *either_side(_STOP, _STOP_LIMIT)]
EncoderRange = Annotated[float, *annotation(Quantity("angle", "rad", "360 deg", above=0, below=1e3))]
PivotRange = Annotated[float, *annotation(Quantity("angle", "rad", "60 deg", above=0, below=math.pi / 2))]
TurnRange = Annotated[float, *annotation(Quantity("angle", "rad", "180 deg", above=0, below=100))]

Time = Annotated[float, *annotation(Quantity("time", "s", "20 ms", at_least=0, below=1e3))]
Duration = Annotated[float, *annotation(Quantity("duration", "s", "2 s", above=0, below=1e6))]
Delay = Annotated[float, *annotation(Quantity("duration", "s", "0.5 s", at_least=0, below=1e6))]
Rate = Annotated[float, *annotation(Quantity("rate", "Hz", "2000 Hz", above=0, below=1e9))]
Frequency = Annotated[
    float, *annotation(Quantity("frequency", "Hz", "0.5 Hz", above=1e-6, below=1e6)), BeforeValidator(_oscillating)
]
Gain = Annotated[float, *annotation(Quantity("gain", "1/s", "12 1/s", above=0, below=1e4))]

SlipSpeed = Annotated[float, *annotation(Quantity("speed", "m/s", "1 mm/s", above=0, below=1e3))]
TendonSpeedLimit = Annotated[float, *annotation(Quantity("speed", "m/s", "50 mm/s", above=0, below=10))]
HomingSpeed = Annotated[float, *annotation(Quantity("speed", "m/s", "5 mm/s", above=0, below=1))]
WindingSpeed = Annotated[float, *annotation(Quantity("speed", "m/s", "1 mm/s", above=1e-7, below=10))]
MotorSpeed = Annotated[float, *annotation(Quantity("angular velocity", "rad/s", "8000 deg/s", above=0, below=1e6))]
MotorAcceleration = Annotated[
    float, *annotation(Quantity("angular acceleration", "rad/s^2", "1e5 rad/s^2", above=0, below=1e9))
]
HandleSpeed = Annotated[
    float, *annotation(Quantity("speed", "rad/s", "20 deg/s", above=1e-6, below=1e3)), BeforeValidator(_turning)
]
SpoolVelocity = Annotated[
    float, *annotation(Quantity("velocity", "rad/s", "1 rad/s", above=-1e4, below=1e4)), BeforeValidator(_turning)
]

STIFFNESS = Quantity("stiffness", "N/m", "31 N/mm", above=1e-3, below=1e12)
"""The stiffness of a tendon, which may also follow from other values."""
Stiffness = Annotated[float, *annotation(STIFFNESS)]
Modulus = Annotated[float, *annotation(Quantity("modulus", "Pa", "50 GPa", above=1e3, below=1e13))]
Strength = Annotated[float, *annotation(Quantity("tensile strength", "Pa", "1570 MPa", above=1e6, below=1e11))]
FlexuralRigidity = Annotated[
    float, *annotation(Quantity("flexural rigidity", "N*m^2", "2e-4 N*m^2", above=1e-12, below=1e3))
]
TissueStiffness = Annotated[float, *annotation(Quantity("stiffness", "N/m", "1 N/mm", at_least=0, below=1e7))]
TissueDamping = Annotated[float, *annotation(Quantity("damping", "N*s/m", "5 N*s/m", at_least=0, below=1e5))]
BendingStiffness = Annotated[
    float, *annotation(Quantity("flexural rigidity", "N*m^2", "1e-5 N*m^2", at_least=0, below=1e3))
]
HandStiffness = Annotated[float, *annotation(Quantity("stiffness", "N*m", "20 N*m", at_least=0, below=1e6))]
Damping = Annotated[float, *annotation(Quantity("damping", "N*m*s", "1e-3 N*m*s", at_least=0, below=1e3))]
CubicStiffness = Annotated[float, *annotation(Quantity("stiffness", "N*m", "0.1 N*m", at_least=0, below=1e6))]
TendonDamping = Annotated[float, *annotation(Quantity("damping", "N*s/m", "2 N*s/m", at_least=0, below=1e6))]
Viscosity = Annotated[float, *annotation(Quantity("viscous friction", "N*s/m", "5 N*s/m", at_least=0, below=1e6))]
Inertia = Annotated[float, *annotation(Quantity("inertia", "kg*m^2", "4e-4 kg*m^2", above=1e-12, below=1e3))]
Mass = Annotated[float, *annotation(Quantity("mass", "kg", "500 g", at_least=0, below=1e3))]
PositiveMass = Annotated[float, *annotation(Quantity("mass", "kg", "500 g", above=0, below=1e3))]

Current = Annotated[float, *annotation(Quantity("current", "A", "2 A", above=0, below=1e4))]
CurrentError = Annotated[float, *annotation(Quantity("current", "A", "5 mA", at_least=0, below=1e4))]
TorqueConstant = Annotated[float, *annotation(Quantity("torque constant", "N*m/A", "50 mN*m/A", above=1e-6, below=1e4))]
FrictionTorque = Annotated[float, *annotation(Quantity("torque", "N*m", "5 mN*m", at_least=0, below=1e4))]
Voltage = Annotated[float, *annotation(Quantity("voltage", "V", "10 V", above=0, below=1e3))]
SignedVoltage = Annotated[float, *annotation(Quantity("voltage", "V", "-2 mV", above=-1e3, below=1e3))]
AnglePerCount = Annotated[float, *annotation(Quantity("angle", "rad", "0.088 deg")), AfterValidator(_not_zero)]
TensionPerCount = Annotated[float, *annotation(Quantity("force", "N", "6.1 mN")), AfterValidator(_not_zero)]
AnglePerVolt = Annotated[
    float, *annotation(Quantity("angle per voltage", "rad/V", "72 deg/V")), AfterValidator(_not_zero)
]
TensionPerVolt = Annotated[
    float, *annotation(Quantity("force per voltage", "N/V", "20 N/V")), AfterValidator(_not_zero)
]
CurrentPerVolt = Annotated[
    float, *annotation(Quantity("current per voltage", "A/V", "0.5 A/V")), AfterValidator(_not_zero)
]
SignedCurrent = Annotated[float, *annotation(Quantity("current", "A", "-5 mA", above=-1e4, below=1e4))]
SpeedPerVolt = Annotated[
    float, *annotation(Quantity("angular velocity per voltage", "rad/s/V", "2 rad/s/V")), AfterValidator(_not_zero)
]

Coefficient = Annotated[float, Field(ge=0, le=3)]
Ratio = Annotated[float, Field(gt=0, le=10)]
Share = Annotated[float, Field(gt=0, le=1)]
Bits = Annotated[int, Field(ge=4, le=32, strict=True)]

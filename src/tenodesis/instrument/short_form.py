"""The short form of an instrument: joints in one plane or two, each with a pair of tendons of its own."""

import math
from collections.abc import Iterator, Mapping
from functools import cache, cached_property
from typing import Any, ClassVar, Literal, Self

from pydantic import BaseModel, Field, ValidationInfo, field_validator, model_validator

from tenodesis import _core, notebook
from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.instrument.hardware import Dynamics, Mismatch
from tenodesis.instrument.instrument import Instrument
from tenodesis.instrument.tension import TensionSensor, tension_sensor
from tenodesis.toml import did_you_mean, file_keys, validated
from tenodesis.units import STIFFNESS, AngleRange, Length, Quantity, in_words

PARAMETERS = tuple(_core.parameters())
"""The core's parameters of an instrument, in its order."""

AxisName = Literal["yaw", "pitch"]

_NAMED = ("overall_length", "pretension", "tendon_stiffness", "handle_range", "output_range")
"""Dimensions by which instruments of a joint type differ."""
_STOP_BEYOND_RANGE = 4 / 3
_FARTHEST_STOP = 2.9  # rad; half a turn is the end of every mechanism


class ShortForm(Instrument):
    """An instrument whose file gives a joint type, its bending axes and their radii."""

    joint_type: str
    axes: tuple[AxisName, ...] = Field(default=("yaw",), description="Bending axes: yaw, pitch, or both")
    overall_length: Length = Field(description="Overall length; the tendons' length unless that is given")
    end_effector_length: Length = Field(description="From the distal joint's moving part to the point of the force")
    handle_length: Length = Field(description="From the proximal joint's moving part to the point of the hand")
    handle_range: AngleRange = Field(description="Largest handle angle to either side")
    output_range: AngleRange = Field(
        default=math.radians(80), description="Working range of the output angle to either side"
    )
    dynamics: Dynamics = Dynamics()
    mismatch: Mismatch = Mismatch()
    overrides: Mapping[AxisName, Mapping[str, Any]] = Field(
        default={}, description="Values that differ on an axis, by axis"
    )
    parameter_fields: ClassVar[Mapping[str, str]] = {}
    """Parameter of the core, by the field that sets it."""

    @property
    def short_form(self) -> Self:
        """The instrument in the short form: itself."""
        return self

    @property
    def tendon_stiffness(self) -> float:
        """Stiffness of one tendon, N/m: as given, or E A / L (Table I)."""
        return _core.tendon_stiffness(self.spec)

    @property
    def rig_arm(self) -> float:
        """Distance from the load rig's pivot to the tip of the straight instrument, m (Fig. 13)."""
        return _core.rig_arm(self.spec)

    @property
    def output_stop(self) -> float:
        """Output angle at which the distal joint reaches its mechanical stop, rad."""
        return self.dynamics.output_stop or min(_STOP_BEYOND_RANGE * self.output_range, _FARTHEST_STOP)

    @cached_property
    def tension_sensor(self) -> TensionSensor:
        """What measures the tensions of the first axis."""
        return tension_sensor(self.drives, self.sensors, self.pretension)

    @cached_property
    def spec(self) -> _core.Spec:
        """The first axis in the core's form."""
        row = dict.fromkeys(PARAMETERS, math.nan)
        for field, parameter in self.parameter_fields.items():
            value = getattr(self, field)
            row[parameter] = math.nan if value is None else value
        if self.tendon_length is None:
            row["tendon_length"] = self.overall_length
        joint = _core.JointType[self.joint_type.replace("-", "_").upper()]
        return _core.Spec(joint, [row[parameter] for parameter in PARAMETERS], self.handle_range)

    @property
    def closed_form(self) -> _core.Spec:
        """The first axis in the core's form."""
        return self.spec

    def quantities(self) -> Iterator[tuple[str, float, Quantity]]:
        """Yield key, value in SI and kind of quantity of every dimension given, stiffness included."""
        yield from super().quantities()
        if self.given_stiffness is None:
            yield "tendon_stiffness", self.tendon_stiffness, STIFFNESS

    def axis(self, name: str) -> Self:
        """Return the instrument of a single axis, with that axis's own values.

        Raises InstrumentError if the instrument has no such axis.
        """
        if name not in self.axes:
            has = " and ".join(self.axes)
            raise InstrumentError(
                f"{self.name} has no axis {name!r}; it has {has}.", key="axis", value=name, allowed=has
            )
        own = {axis: values for axis, values in self.overrides.items() if axis == name}
        return self.replace(axes=(name,), overrides=None, **dict(*own.values()))

    @property
    def planar(self) -> tuple[Self, ...]:
        """The one-axis instrument of each axis, in the order of :attr:`axes`; the instrument itself if it is planar."""
        return (self,) if len(self.axes) == 1 else self._by_axis

    @cached_property
    def _by_axis(self) -> tuple[Self, ...]:
        return tuple(self.axis(name) for name in self.axes)

    def _check_override(self, axis: AxisName, values: Mapping[str, Any], *, in_file: bool) -> None:
        if axis not in self.axes[1:]:
            raise ArgumentError(
                f"overrides.{axis} is given, but the second axis is {self.axes[1] if self.axes[1:] else 'not there'}; "
                "the first axis has its values at the top",
                key=f"overrides.{axis}",
            )
        allowed = [key for key, _, _ in self.quantities()]
        foreign = [key for key in values if key not in {*allowed, "tendon_length"}]
        if foreign:
            raise ArgumentError(
                f"overrides.{axis}: {foreign[0]} is not a known key{did_you_mean(foreign[0], allowed)}; it must be one "
                f"of {', '.join(allowed)}",
                key=f"overrides.{axis}",
            )
        bare = [key for key, value in values.items() if in_file and isinstance(value, int | float)]
        if bare:
            raise ArgumentError(f"overrides.{axis}.{bare[0]} = {values[bare[0]]!r}: it has no unit")
        alone = self.with_values({"axes": (axis,), "overrides": None} | dict(values))
        try:
            validated(type(self), alone, InstrumentError, f"overrides.{axis}")
        except InstrumentError as invalid:
            raise ArgumentError(str(invalid).rstrip(".")) from None

    def __repr__(self) -> str:
        in_file = {key: in_words(value, kind.unit) for key, value, kind in self.quantities()}
        shown = ", ".join(f"{key} {in_file[key]}" for key in _NAMED if key in in_file)
        return (
            f"<{type(self).__name__} {self.name!r}: {' and '.join(self.axes)}, {shown}, friction {self.friction.law}>"
        )

    __str__ = __repr__

    def _repr_html_(self) -> str:
        """Return a table for notebooks: values in the units of drawings, with their sources."""
        rows = [(key, in_words(value, kind.unit), self.sources.get(key, "")) for key, value, kind in self.quantities()]
        rows.append(("friction", self.friction.law, self.sources.get("friction", "")))
        title = f"{self.name}: {self.joint_type}, {' and '.join(self.axes)}"
        return notebook.table(title, ("key", "value", "source"), rows)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.joint_type, self.name, tuple((key, value) for key, value, _ in self.quantities())))

    @field_validator("axes")
    @classmethod
    def _distinct_axes(cls, axes: tuple[AxisName, ...]) -> tuple[AxisName, ...]:
        if not axes or len(set(axes)) < len(axes):
            raise ArgumentError("it must name one or two different axes, yaw and pitch")
        return axes

    @model_validator(mode="after")
    def _coherent(self, info: ValidationInfo) -> Self:
        missing = [key for key in ("tendon_diameter", "tendon_modulus") if getattr(self, key) is None]
        if self.given_stiffness is None and missing:
            raise ArgumentError(
                f"{missing[0]} is missing; give tendon_diameter and tendon_modulus, or tendon_stiffness", key=missing[0]
            )
        stiffness = self.tendon_stiffness
        if not STIFFNESS.allows(stiffness):
            raise ArgumentError(
                f"tendon_stiffness follows as {stiffness:.3g} N/m; it must be {STIFFNESS.allowed}",
                key="tendon_stiffness",
            )
        if self.pretension / stiffness >= (self.tendon_length or self.overall_length):
            raise ArgumentError(
                f"pretension is {self.pretension:g} N, which would stretch tendons of {stiffness:.3g} N/m by more than "
                "their length; give less pretension or a stiffer tendon",
                key="pretension",
            )
        if self.breaking_load is not None and self.pretension >= self.breaking_load:
            raise ArgumentError(
                f"pretension is {self.pretension:g} N, at which a tendon of {self.breaking_load:g} N breaking_load has "
                "broken; give less pretension or a stronger tendon",
                key="pretension",
            )
        tension_sensor(self.drives, self.sensors, self.pretension)
        self.devices.check_tensions(self.sensors.kind)
        reach = _core.unloaded_limit(self.spec)
        if not reach < 1:
            raise ArgumentError(
                f"handle_range is {math.degrees(self.handle_range):.4g} deg, which would bend the distal joint "
                f"{reach:.4g} times as far as it can (for gears, R/r sin(handle_range / 2) must stay below 1); "
                "give a smaller handle_range or a larger distal radius",
                key="handle_range",
            )
        for axis, values in self.overrides.items():
            self._check_override(axis, values, in_file=bool(info.context and info.context.get("file")))
        for key in self.sources:
            if key not in _known(type(self)):
                hint = did_you_mean(key, (), _known(type(self)))
                raise ArgumentError(f"sources.{key} names no key of an instrument{hint}", key=f"sources.{key}")
        return self


@cache
def _known(kind: type[BaseModel]) -> frozenset[str]:
    """Return the keys that a file may have, those within tables with a dot."""
    return frozenset(file_keys(kind))

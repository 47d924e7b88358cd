"""What follows from an instrument's values: stiffness, reach, loads, limits and the steps of its sensors."""

from collections.abc import Iterator
from math import isfinite, nan, pi
from typing import NamedTuple

import numpy as np

from tenodesis import kinematics, plant, statics
from tenodesis.control.one_arc import one_arc
from tenodesis.control.parameters import force_limit, tension_limit
from tenodesis.errors import InstrumentError
from tenodesis.instrument import ShortForm

_SHOWN = {"rad": ("deg", 180 / pi), "m": ("mm", 1e3), "m/s": ("mm/s", 1e3)}


class Derived(NamedTuple):
    """A quantity that follows from an instrument's values."""

    key: str
    value: float
    """In SI, NaN where there is none"""
    unit: str
    """SI unit"""
    meaning: str

    @property
    def text(self) -> str:
        """The value in units for people."""
        if not isfinite(self.value):
            return "none"
        unit, factor = _SHOWN.get(self.unit, (self.unit, 1.0))
        shown = self.value * factor
        digits = 5 if abs(shown) >= 1000 else 4
        return f"{shown:.{digits}g} {unit}".strip()


def derive(inst: ShortForm) -> Iterator[Derived]:
    """Yield what follows from an instrument's values, of each axis that has its own."""
    if not inst.overrides:
        yield from _derive(inst.planar[0])
        return
    for axis in inst.planar:
        for one in _derive(axis):
            yield one._replace(key=f"{axis.axes[0]}: {one.key}")


def _derive(inst: ShortForm) -> Iterator[Derived]:
    end = statics.reach(inst)
    reached = float(statics.output_angle(inst, np.array([inst.handle_range]))[0])
    slope = statics.gradient(statics.output_angle, inst, 0.0, wrt=["handle_angle"])["handle_angle"]
    slack = statics.slack_load(inst, np.array([0.0, end]))
    numbers = plant.parameters(inst)
    drives, sensor = inst.drives, inst.tension_sensor
    if inst.given_stiffness is None:
        yield Derived("tendon_stiffness", inst.tendon_stiffness, "N/m", "E A / L of one tendon")
    yield Derived("stem_length", _stem(inst), "m", "between the joints")
    yield Derived("angle_ratio", float(slope), "", "output over handle angle, straight")
    yield Derived("reach", end, "rad", "handle angle that bends the unloaded tip through its working range")
    yield Derived("largest_output_angle", reached, "rad", "unloaded, at handle_range")
    yield Derived("output_stop", inst.output_stop, "rad", "mechanical stop of the tip")
    yield Derived("flexural_stiffness", float(statics.flexural_stiffness(inst, 0.0)), "N*m/rad", "of the straight tip")
    yield _slack("slack_force", float(slack[0]), "straight")
    yield _slack("slack_force_flexed", float(slack[1]), "at the end of the working range")
    if (arc := one_arc(inst.axis(inst.axes[0]))) is not None:
        in_more = f"under {arc.force:g} N across, handle held, as one arc; {1e3 * arc.finer:.3g} mm in {arc.arcs} arcs"
        yield Derived("tip_deflection", arc.given, "m", in_more)
    yield Derived("tip_inertia", numbers["tip_inertia"], "kg*m^2", _given(inst.dynamics.tip_inertia))
    yield Derived("tip_damping", numbers["tip_damping"], "N*m*s", _given(inst.dynamics.tip_damping))
    yield Derived("natural_frequency", plant.natural_frequency(inst) / (2 * pi), "Hz", "of the straight, unloaded tip")
    wound = drives.motor_speed / drives.gear_ratio * drives.spool_radius
    yield Derived("winding_speed", wound, "m/s", "of a tendon at its spool, at most")
    yield Derived("tension_limit", tension_limit(inst), "N", "no tendon is wound above it")
    yield Derived("force_limit", force_limit(inst), "N", "force at the tip beyond which the motors yield")
    if sensor.per_current:
        yield Derived("current_step", numbers["load_cell_resolution"], "N", "of a current's converter, as tension")
        yield Derived(
            "tension_per_current", sensor.per_current, "N/A", "of a motor's current, with the drive's friction"
        )
    else:
        yield Derived("load_cell_step", numbers["load_cell_resolution"], "N", "of its converter")
    if sensor.friction:
        yield Derived("drive_friction", sensor.friction, "", "exponent of the drive at the pretension, as of a contact")
    yield Derived("encoder_step", numbers["encoder_resolution"], "rad", "of a joint encoder's converter")
    step = numbers["motor_encoder_resolution"] * drives.spool_radius
    yield Derived("spool_step", step, "m", "of tendon by the motor's encoder")


def _slack(key: str, force: float, where: str) -> Derived:
    meaning = (
        "load under which the first tendon goes slack, handle held" if force else "a tendon is slack without a load"
    )
    return Derived(key, force, "N", f"{meaning}, tip {where}")


def _given(value: float | None) -> str:
    return "about the output angle, " + ("by default" if value is None else "as given")


def _stem(inst: ShortForm) -> float:
    try:
        return kinematics.dimensions(inst).stem_length
    except InstrumentError:
        return nan

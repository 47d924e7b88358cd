"""What the sensors resolve at the tip: the errors of their readings, propagated through the estimate (eq. 19)."""

from functools import lru_cache
from math import degrees, inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np

from tenodesis import plant, statics
from tenodesis.control.pairs import compensated
from tenodesis.control.parameters import TUNING, force_limit, parameters
from tenodesis.errors import InstrumentError
from tenodesis.instrument import InstrumentLike, ShortForm

_PLACES = 17
_USUAL_LOAD = 1.0  # N


class Contributions(NamedTuple):
    """Standard deviations of the estimated output angle by each kind of error, rad."""

    handle_encoder: float
    """By steps and noise of the handle's encoder"""
    spool_encoders: float
    """By the steps of both spools' encoders"""
    load_cells: float
    """By steps and noise of both load cells"""
    handle_offset: float
    """By ``sensors.encoder_offset``"""
    cell_offsets: float
    """By ``sensors.load_cell_offset``"""
    cell_gains: float
    """By ``sensors.load_cell_gain_error``"""

    @property
    def calibration(self) -> float:
        """By offsets and gains, which calibration has left, rad."""
        return float(np.linalg.norm(self[3:]))

    @property
    def total(self) -> float:
        """Root of the sum of all squares, rad."""
        return float(np.linalg.norm(self))


class Resolution(NamedTuple):
    """What an instrument's sensors resolve at its tip, and what its largest load takes."""

    straight: Contributions
    end: Contributions
    """At the end of the working range, or of what the handle reaches"""
    worst: Contributions
    """Where their total is largest over the working range"""
    tip_force: float
    """Standard deviation of the tip force by all errors of the load cells, N, largest over the working range"""
    hidden_force: float
    """Tip force that the friction of drives at rest may hide where currents measure the tensions, N, the same; 0 with
    load cells"""
    load: float
    """The largest of ``conditions.forces``, N; 1 N where the file has none"""
    loss: float
    """The output angle that it takes, rad, largest over the working range; infinite where nothing can hold it"""


def resolution(inst: InstrumentLike) -> Resolution:
    """Return what the sensors of an instrument's first axis resolve at the unloaded tip; friction is left out.

    A step of a converter is an error of uniform probability, of step over root 12: while nothing moves, no filter
    lessens it (noise may, which is not counted). Noise counts behind the controller's measurement filter. Deviations
    are propagated by the derivatives of :func:`tenodesis.statics.estimate_output_angle`; without pretension they are
    not finite.
    """
    return _resolution(compensated(inst))


@lru_cache(maxsize=16)
def _resolution(inst: ShortForm) -> Resolution:
    inst = inst.planar[0]
    sensors, sensor, control = inst.sensors, inst.tension_sensor, parameters(inst)
    numbers = plant.parameters(inst, control.common["period"])
    # Of a first-order filter's output over its input, for noise that is white.
    passed = 1 / sqrt(1 + 2 * TUNING["smoothing"].value)
    handle_error = np.hypot(numbers["encoder_resolution"] / sqrt(12), passed * numbers["encoder_noise"])
    wound_error = numbers["motor_encoder_resolution"] * inst.drives.spool_radius / sqrt(12)
    cell_error = np.hypot(numbers["load_cell_resolution"] / sqrt(12), passed * numbers["load_cell_noise"])

    handle = np.linspace(0.0, statics.reach(inst), _PLACES)
    tension = statics.tensions(inst, handle)
    wrt = ("handle_angle", "agonist", "antagonist", "agonist_wound", "antagonist_wound")
    by_handle, *by_tension, by_agonist, by_antagonist = statics.gradient(
        "estimate_output_angle", inst, handle, *tension, wrt=wrt
    ).values()
    by_cells = np.hypot(*by_tension)
    by_gains = np.hypot(*(slope * held for slope, held in zip(by_tension, tension, strict=True)))
    columns = (
        handle_error * np.abs(by_handle),
        wound_error * np.hypot(by_agonist, by_antagonist),
        cell_error * by_cells,
        sensors.encoder_offset * np.abs(by_handle),
        sensor.offset * by_cells,
        sensor.gain_error * by_gains,
    )
    places = [Contributions(*map(float, row)) for row in zip(*columns, strict=True)]
    worst = places[int(np.argmax([place.total for place in places]))]

    by_force = statics.gradient("tensions", inst, handle, wrt=["force"])["force"]
    steady = np.hypot(cell_error, sensor.offset)
    off = [np.hypot(steady, sensor.gain_error * held) for held in tension]
    with np.errstate(divide="ignore", invalid="ignore"):
        per_force = np.abs(by_force.agonist - by_force.antagonist)
        tip_force = float(np.max(np.hypot(*off) / per_force))
        hidden = float(np.max(np.sinh(sensor.friction) * np.add(*tension) / per_force))
    load = max(inst.conditions.forces, default=_USUAL_LOAD)
    taken = statics.output_angle(inst, handle) - statics.output_angle(inst, handle, load)
    loss = float(np.max(np.where(np.isfinite(taken), taken, inf)))
    return Resolution(places[0], places[-1], worst, tip_force, hidden, load, loss)


def sentences(inst: ShortForm) -> tuple[str, ...]:
    """Return in a sentence what the sensors resolve and what a load takes, for each axis that has its own values."""
    found = []
    for prefix, axis in _different_axes(inst):
        known = resolution(axis)
        found.append(prefix + _sentence(known))
        if axis.sensors.kind == "current":
            hides = f"; until they move, the friction of the drives hides up to {known.hidden_force:.2g} N at the tip"
            found.append(
                f"{prefix}the motors' currents measure the tensions, {axis.tension_sensor.per_current:.3g} N/A"
                f"{hides if known.hidden_force else ''}."
            )
    return tuple(sentence[0].upper() + sentence[1:] for sentence in found)


def shares(inst: ShortForm) -> tuple[str, ...]:
    """Return in a sentence how much each kind of sensor takes of that angle, for each axis that has its own values."""
    found = []
    for prefix, axis in _different_axes(inst):
        worst = resolution(axis).worst
        parts = {
            "handle encoder": worst.handle_encoder,
            "spool encoders": worst.spool_encoders,
            _measured_by(axis): worst.load_cells,
            "calibration": worst.calibration,
        }
        if isfinite(worst.total):
            listed = ", ".join(f"{name} {_degrees(part)}" for name, part in parts.items())
            found.append(f"{prefix}standard deviations: {listed}.")
    return tuple(sentence[0].upper() + sentence[1:] for sentence in found)


def warnings(inst: ShortForm) -> tuple[str, ...]:
    """Return in sentences where the sensors do not suffice for compensation, or for the limit of the tip force."""
    found = []
    for prefix, axis in _different_axes(inst):
        known = resolution(axis)
        if known.worst.total > known.loss:
            found.append(
                f"{prefix}the sensors resolve {_degrees(known.worst.total)} at the tip, and a load of {known.load:g} N "
                f"takes only {_degrees(known.loss)}: motors would do as much harm as good."
            )
        if _is_unresolved(axis, known):
            found.append(f"{prefix}{_unresolved_limit(axis, known)}")
    return tuple(found)


def check_force_limit(inst: ShortForm) -> None:
    """Refuse an instrument whose file gives a limit of the tip force that its load cells do not resolve.

    Raises
    ------
    InstrumentError
        It does. The default limit is not refused; :func:`warnings` names it.
    """
    if inst.control.force_limit is None:
        return
    for _, axis in _different_axes(inst):
        known = resolution(axis)
        if _is_unresolved(axis, known):
            raise _unresolved_limit(axis, known)


def _different_axes(inst: ShortForm) -> list[tuple[str, ShortForm]]:
    """Return an instrument's axes that have values of their own, each with what a sentence about it begins with."""
    if not inst.overrides:
        return [("", inst.planar[0])]
    return [(f"{axis.axes[0]}: ", axis) for axis in inst.planar]


def _is_unresolved(inst: ShortForm, known: Resolution) -> bool:
    return 0 < force_limit(inst) < known.tip_force < inf


def _unresolved_limit(inst: ShortForm, known: Resolution) -> InstrumentError:
    limit = force_limit(inst)
    sensors = _measured_by(inst)
    allowed = f"at least {known.tip_force:.3g} N, which is what the {sensors} resolve at the tip, or 0 for none"
    return InstrumentError(
        f"control.force_limit is {limit:g} N; it must be {allowed}.",
        key="control.force_limit",
        value=limit,
        allowed=allowed,
    )


def _measured_by(inst: ShortForm) -> str:
    return "currents" if inst.sensors.kind == "current" else "load cells"


def _sentence(known: Resolution) -> str:
    worst = known.worst
    if not isfinite(worst.total):
        return "without pretension the sensors resolve nothing at the tip."
    takes = f"takes {_degrees(known.loss)}" if isfinite(known.loss) else "is more than the tip can hold"
    return (
        f"the sensors resolve {_degrees(worst.total)} and {known.tip_force:.2g} N at the tip; a load of "
        f"{known.load:g} N {takes}."
    )


def _degrees(angle: float) -> str:
    shown = degrees(angle)
    return f"{shown:.2g}°" if shown < 10 else f"{shown:.0f}°"

"""Calls of the core by the statics: arguments checked and broadcast, points solved, errors explained."""

import sys
from collections.abc import Mapping
from math import degrees, prod
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core
from tenodesis._core import Status
from tenodesis.errors import ArgumentError, NoSolutionError
from tenodesis.instrument import PARAMETERS, Instrument, InstrumentLike, ShortForm, as_instrument
from tenodesis.threads import threads

FloatOrArray: TypeAlias = Any
"""A float where every argument was a number, otherwise an array of float64 of the shape they broadcast to."""

_HELD_INPUTS = ("handle_angle", "force", "radial_force", "agonist_wound", "antagonist_wound")
INPUTS = {
    "output_angle": _HELD_INPUTS,
    "tensions": _HELD_INPUTS,
    "equilibrium": _HELD_INPUTS,
    "torque_transmissibility": _HELD_INPUTS,
    "handle_angle": ("output_angle", *_HELD_INPUTS[1:]),
    "flexural_stiffness": ("output_angle",),
    "loss_of_dexterity": ("output_angle", "force"),
    "slack_force": ("output_angle",),
    "slack_load": ("handle_angle", "agonist_wound", "antagonist_wound"),
    "estimate_output_angle": (
        "handle_angle",
        "agonist",
        "antagonist",
        "agonist_wound",
        "antagonist_wound",
        "slack_below",
    ),
    "unloaded_angle": ("handle_angle",),
    "compensation_stroke": ("agonist", "antagonist", "handle_angle"),
}
"""Arguments of each function beside the instrument, in the core's order; wound lengths by tendon."""

_OUTPUTS = {"tensions": 2, "equilibrium": 3}
_ANGLES = {"handle_angle", "output_angle"}

_REASONS = {
    Status.NO_EQUILIBRIUM: "there is no equilibrium, the load is past the fold where the joint snaps through; "
    "it must be smaller, or the pretension larger where a tendon is slack",
    Status.UNREACHABLE: "it is outside what the mechanism can bend to and the handle's range of ±{range:.4g} deg "
    "can reach",
    Status.BOTH_SLACK: "both tendons are slack, so nothing holds the tip; at least one must be taut",
    Status.NO_AUTHORITY: "letting the agonist out beyond slack restores no angle; "
    "the agonist's tension must be at most the pretension of {pretension:g} N below the antagonist's",
}


class Tensions(NamedTuple):
    """Tendon tensions, N; the agonist is the tendon that a positive handle angle stretches."""

    agonist: FloatOrArray
    antagonist: FloatOrArray


class Equilibrium(NamedTuple):
    """Where an instrument comes to rest; NaN where there is no equilibrium."""

    output_angle: FloatOrArray
    """Of one joint, or of the tip's joints in the last axis, rad"""
    tensions: Any
    """:class:`Tensions` of one joint's pair of tendons, otherwise of the tendons in the last axis, N"""
    status: FloatOrArray
    """How each solve ended: a :class:`Status`, or an array of its values"""

    @property
    def angles(self) -> FloatOrArray:
        """As :attr:`output_angle`."""
        return self.output_angle

    @property
    def agonist(self) -> FloatOrArray:
        """Tension of the agonist of a pair, N."""
        return self.tensions.agonist

    @property
    def antagonist(self) -> FloatOrArray:
        """Tension of the antagonist of a pair, N."""
        return self.tensions.antagonist


class Query(NamedTuple):
    """A function of the statics and its arguments, flat: columns of the common length, or of length one."""

    name: str
    operation: str
    inst: Instrument
    spec: _core.Spec
    columns: list[NDArray[np.float64]]
    shape: tuple[int, ...]

    def value(self, key: str, index: int) -> float:
        """Return an argument's value at a flat index."""
        column = self.columns[INPUTS[self.name].index(key)]
        return float(column[index if column.size > 1 else 0])


def _operation(name: str, arguments: dict[str, Any]) -> str:
    """Return the core's name of a function; the laws of compensation are operations of their own."""
    if name != "compensation_stroke":
        return name
    for argument, allowed in (("actuation", ("agonist", "differential")), ("law", ("exact", "paper"))):
        if arguments[argument] not in allowed:
            raise ArgumentError(key=argument, value=arguments[argument], allowed=" or ".join(allowed))
    if arguments["law"] == "paper":
        return "compensation_stroke:paper"
    return f"compensation_stroke:{arguments['actuation']}:exact"


def prepare(name: str, inst: InstrumentLike, arguments: dict[str, Any]) -> Query:
    """Return a function's arguments, checked and broadcast, for :func:`solve`.

    Raises ArgumentError for an instrument whose equilibrium has no closed form.
    """
    inst = as_instrument(inst)
    spec = inst.closed_form
    if spec is None:
        allowed = "an instrument of one joint between two tendons alike"
        raise ArgumentError(
            f"{name} takes {allowed}, which {inst.name} is not.", key="inst", value=inst, allowed=allowed
        )
    values = dict(arguments)
    if "wound" in values:
        wound = values.pop("wound")
        pair = wound if isinstance(wound, tuple) else (wound, 0.0)
        if len(pair) != 2:
            raise ArgumentError(key="wound", value=wound, allowed="the agonist's length, or a tuple of both tendons'")
        values["agonist_wound"], values["antagonist_wound"] = pair
    arrays = [numbers(key, values[key]) for key in INPUTS[name]]
    shape = common_shape({key: array.shape for key, array in zip(INPUTS[name], arrays, strict=True)})
    columns = [
        array.reshape(1) if array.size == 1 else np.ascontiguousarray(np.broadcast_to(array, shape)).reshape(-1)
        for array in arrays
    ]
    return Query(name, _operation(name, arguments), inst, spec, columns, shape)


def common_shape(shapes: Mapping[str, tuple[int, ...]]) -> tuple[int, ...]:
    """Return the shape that arguments, by name, broadcast to; raises ArgumentError if they do not."""
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        given = ", ".join(f"{key} {shape}" for key, shape in shapes.items())
        raise ArgumentError(f"the shapes do not broadcast: {given}.") from None


def numbers(key: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return an argument as float64; refuse text, times, complex and masked values, which NumPy would convert."""
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.array(None)
    # numpy.ma takes long to import, and without it no array is masked
    masked = "numpy.ma" in sys.modules and np.ma.isMaskedArray(value)
    if array.dtype.kind not in "buif" or masked:
        raise ArgumentError(key=key, value=value, allowed="a number or an array of numbers")
    return array.astype(np.float64, copy=False)


def solve(query: Query, variables: list[int] | None = None) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return outputs, or their derivatives by some variables of the core, and the status of every point.

    Outputs are (outputs, 1, n), derivatives (outputs, variables, n), and the status (n,). Raises ValueError if an input
    is not finite or beyond the handle's range.
    """
    count = prod(query.shape)
    rows = 1 if variables is None else len(variables)
    out = np.empty((_OUTPUTS.get(query.name, 1), rows, count))
    status = np.empty(count, np.uint8)
    if variables is None:
        _core.evaluate(query.spec, query.operation, query.columns, out, status, threads())
    else:
        _core.gradient(query.spec, query.operation, query.columns, variables, out, status, threads())
    _check_valid(query, status)
    return out, status


def shaped(values: NDArray[np.float64], shape: tuple[int, ...]) -> FloatOrArray:
    """Return flat values in a query's shape, a float for a single point."""
    return float(values[0]) if shape == () else values.reshape(shape)


def variable(name: str, inst: ShortForm, key: str) -> int:
    """Return the core's index of a parameter or an argument to differentiate by."""
    inputs = INPUTS[name]
    if key in inputs:
        return len(PARAMETERS) + inputs.index(key)
    fields = dict(inst.parameter_fields)
    if inst.given_stiffness is None:
        del fields["given_stiffness"]
        if inst.tendon_length is None:
            fields["overall_length"] = fields.pop("tendon_length")
    else:
        fields = {field: value for field, value in fields.items() if not field.startswith("tendon_")}
        fields["tendon_stiffness"] = fields.pop("given_stiffness")
    if key not in fields:
        hint = " (tendon_stiffness follows from modulus, diameter and length here)" * (key == "tendon_stiffness")
        allowed = f"one of {', '.join([*fields, *inputs])}"
        raise ArgumentError(f"wrt names {key!r}{hint}; it must be {allowed}.", key="wrt", value=key, allowed=allowed)
    return PARAMETERS.index(fields[key])


def place(index: int, shape: tuple[int, ...]) -> str:
    """Return a flat index as it would be written behind an array's name: "[3, 0]"; empty for a single value."""
    return "" if shape == () else f"[{', '.join(str(i) for i in np.unravel_index(index, shape))}]"


def _range(spec: _core.Spec) -> float:
    """Return the handle's range to either side, rad."""
    return float(spec.__getstate__()[2])


def _value(key: str, value: float) -> str:
    return f"{value:.6g} rad ({degrees(value):.7g} deg)" if key in _ANGLES else f"{value:.6g}"


def _check_valid(query: Query, status: NDArray[np.uint8]) -> None:
    """Raise ArgumentError for the first argument that is not finite or beyond the handle's range."""
    # NumPy takes long to compare with a member of an enumeration.
    if not status.size or int(status.max()) < int(Status.OUT_OF_RANGE):
        return
    first = int(np.argmax(status >= Status.OUT_OF_RANGE))
    at = place(first, query.shape)
    for key in INPUTS[query.name]:
        value = query.value(key, first)
        if not np.isfinite(value):
            raise ArgumentError(key=f"{key}{at}", value=value, allowed="a finite number")
    if status[first] == Status.NOT_FINITE:
        key = max(INPUTS[query.name], key=lambda name: abs(query.value(name, first)))
        raise ArgumentError(key=f"{key}{at}", value=query.value(key, first), allowed="a number of physical size")
    angle = query.value("handle_angle", first)
    raise handle_angle_error(_range(query.spec), angle, at)


def handle_angle_error(handle_range: float, angle: float, at: str) -> ArgumentError:
    """Return the error for a handle angle (rad) beyond the handle's range (rad), at a place in its array."""
    allowed = f"within the handle's range of ±{degrees(handle_range):.4g} deg"
    problem = f"handle_angle{at} is {_value('handle_angle', angle)}; it must be {allowed}."
    return ArgumentError(problem, key=f"handle_angle{at}", value=angle, allowed=allowed)


def check_solved(query: Query, status: NDArray[np.uint8]) -> None:
    """Raise NoSolutionError where a single point has no solution."""
    if query.shape != () or int(status[0]) == int(Status.OK):
        return
    inputs = INPUTS[query.name]
    values = {key: query.value(key, 0) for key in inputs}
    given = ", ".join(f"{key} = {_value(key, value)}" for key, value in values.items() if value or key == inputs[0])
    inst = query.inst
    given_range = degrees(_range(query.spec))
    reason = _REASONS[Status(int(status[0]))].format(range=given_range, pretension=inst.pretension)
    raise NoSolutionError(f"{query.name} of {inst.name} at {given}: {reason}.", key=query.name)

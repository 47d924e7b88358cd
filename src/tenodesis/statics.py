"""What a held instrument does under load, without friction.

Angles in rad, forces in N, lengths in m. Every function takes numbers or arrays, which broadcast as in NumPy, and
returns a float for numbers and an array for arrays. Functions act on an instrument's first axis; ``inst.axis("pitch")``
is the other one. A single point without a solution raises :class:`tenodesis.NoSolutionError`; in an array it becomes
NaN, and :func:`equilibrium` tells why. Input that is not finite, or a handle angle beyond the handle's range, raises
``ValueError`` in either case.
"""

import inspect
from collections.abc import Callable, Sequence
from enum import IntEnum
from math import degrees, prod
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import PARAMETERS, Instrument
from tenodesis.threads import threads

FloatOrArray: TypeAlias = Any
"""A float where every argument was a number, otherwise an array of float64."""

Wound: TypeAlias = ArrayLike | tuple[ArrayLike, ArrayLike]
"""Tendon length wound in by the motors, m: the agonist's, or a pair of agonist's and antagonist's."""

Actuation: TypeAlias = Literal["agonist", "differential"]
Law: TypeAlias = Literal["exact", "paper"]


class Status(IntEnum):
    """How the solve of one point ended."""

    OK = _core.Status.OK.value
    NO_EQUILIBRIUM = _core.Status.NO_EQUILIBRIUM.value
    UNREACHABLE = _core.Status.UNREACHABLE.value
    BOTH_SLACK = _core.Status.BOTH_SLACK.value
    NO_AUTHORITY = _core.Status.NO_AUTHORITY.value
    OUT_OF_RANGE = _core.Status.OUT_OF_RANGE.value
    NOT_FINITE = _core.Status.NOT_FINITE.value


class Tensions(NamedTuple):
    """Tendon tensions, N; the agonist is the tendon that a positive handle angle stretches."""

    agonist: FloatOrArray
    antagonist: FloatOrArray


class Equilibrium(NamedTuple):
    """Output angle (rad), tendon tensions (N) and status of a held instrument, NaN where there is no equilibrium."""

    output_angle: FloatOrArray
    agonist: FloatOrArray
    antagonist: FloatOrArray
    status: FloatOrArray


_HELD_INPUTS = ("handle_angle", "force", "radial_force", "agonist_wound", "antagonist_wound")
_INPUTS = {
    "output_angle": _HELD_INPUTS,
    "tensions": _HELD_INPUTS,
    "equilibrium": _HELD_INPUTS,
    "torque_transmissibility": _HELD_INPUTS,
    "handle_angle": ("output_angle", *_HELD_INPUTS[1:]),
    "flexural_stiffness": ("output_angle",),
    "loss_of_dexterity": ("output_angle", "force"),
    "slack_force": ("output_angle",),
    "estimate_output_angle": (
        "handle_angle",
        "agonist",
        "antagonist",
        "agonist_wound",
        "antagonist_wound",
        "slack_below",
    ),
    "compensation_stroke": ("agonist", "antagonist"),
}
_OUTPUTS = {"tensions": 2, "equilibrium": 3}
_ANGLES = {"handle_angle", "output_angle"}

_REASONS = {
    Status.NO_EQUILIBRIUM: "there is no equilibrium, the load is past the fold where the joint snaps through; "
    "allowed is a smaller load, or a larger pretension where a tendon is slack",
    Status.UNREACHABLE: "it is outside what the mechanism can bend to and the handle's range of ±{range:.4g} deg "
    "can reach",
    Status.BOTH_SLACK: "both tendons are slack, so nothing holds the tip; allowed is at least one taut tendon",
    Status.NO_AUTHORITY: "letting the agonist out beyond slack gives no angle back; "
    "allowed is an agonist tension that falls short of the antagonist's by at most the pretension of {pretension:g} N",
}


def output_angle(
    inst: Instrument,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
) -> FloatOrArray:
    """Return the output angle at a held handle under load (eqs. 9, 18), rad.

    Parameters
    ----------
    inst
        The instrument.
    handle_angle
        Handle angle, rad.
    force
        Tangential force at the tip, N, turning with it; positive opposes positive flexion.
    radial_force
        Force along the end-effector, N, turning with it; positive outward.
    wound
        Tendon length wound in by the motors, m: the agonist's, or a pair.

    Raises
    ------
    ValueError
        An input is not finite or beyond the handle's range.
    NoSolutionError
        A single point has no equilibrium.
    """
    return _evaluate("output_angle", inst, locals())[0]


def handle_angle(
    inst: Instrument,
    output_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
) -> FloatOrArray:
    """Return the handle angle that holds an output angle under load (eq. 20, slack included), rad.

    The inverse of :func:`output_angle`, with the same other parameters (N, m) and errors; output_angle is in rad.
    """
    return _evaluate("handle_angle", inst, locals())[0]


def tensions(
    inst: Instrument,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
) -> Tensions:
    """Return the tendon tensions at a held handle under load (eqs. 6-8), N.

    Parameters and errors are those of :func:`output_angle`.
    """
    return Tensions(*_evaluate("tensions", inst, locals()))


def torque_transmissibility(
    inst: Instrument,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
) -> FloatOrArray:
    """Return the torque transmissibility, output over input moment (eqs. 10-14), dimensionless.

    Parameters and errors are those of :func:`output_angle`. The moment of a continuum's own backbone is not counted.
    """
    return _evaluate("torque_transmissibility", inst, locals())[0]


def equilibrium(
    inst: Instrument,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
) -> Equilibrium:
    """Return output angle (rad), tensions (N) and status, without an error where there is no equilibrium.

    Parameters are those of :func:`output_angle`; status is a :class:`Status`, or an array of its numbers.

    Raises
    ------
    ValueError
        An input is not finite or beyond the handle's range.
    """
    query = _query("equilibrium", inst, locals())
    outputs, status = _solve(query)
    angle, agonist, antagonist = (_shaped(output[0], query.shape) for output in outputs)
    told = Status(int(status[0])) if query.shape == () else status.reshape(query.shape)
    return Equilibrium(angle, agonist, antagonist, told)


def flexural_stiffness(inst: Instrument, output_angle: ArrayLike) -> FloatOrArray:
    """Return the flexural stiffness of the distal joint at an output angle (rad), tendons taut (eqs. 15, 16), N·m/rad.

    Raises
    ------
    ValueError
        The angle is not finite.
    NoSolutionError
        A single angle is half a turn or more.
    """
    return _evaluate("flexural_stiffness", inst, locals())[0]


def loss_of_dexterity(inst: Instrument, output_angle: ArrayLike, force: ArrayLike) -> FloatOrArray:
    """Return the loss of dexterity at an output angle (rad) under a tangential force (N), rad (eq. 17).

    It is the loss of output angle to first order in the force.

    Raises
    ------
    ValueError
        An input is not finite.
    NoSolutionError
        A single angle is half a turn or more.
    """
    return _evaluate("loss_of_dexterity", inst, locals())[0]


def slack_force(inst: Instrument, output_angle: ArrayLike) -> FloatOrArray:
    """Return the tangential force at which the antagonist goes slack at an output angle (rad), N (eq. 8).

    Raises
    ------
    ValueError
        The angle is not finite.
    NoSolutionError
        A single angle is half a turn or more.
    """
    return _evaluate("slack_force", inst, locals())[0]


def estimate_output_angle(
    inst: Instrument,
    handle_angle: ArrayLike,
    agonist: ArrayLike,
    antagonist: ArrayLike,
    wound: Wound = 0.0,
    *,
    slack_below: ArrayLike = 0.0,
) -> FloatOrArray:
    """Return the output angle that handle and tensions tell without friction (eq. 19, slack and motor aware), rad.

    Parameters
    ----------
    inst
        The instrument.
    handle_angle
        Handle angle, rad.
    agonist, antagonist
        Measured tendon tensions, N.
    wound
        Tendon length wound in by the motors, m: the agonist's, or a pair.
    slack_below
        Tension, N, up to which a tendon counts as slack; with noisy load cells, above their noise.

    Raises
    ------
    ValueError
        An input is not finite or beyond the handle's range.
    NoSolutionError
        At a single point both tendons are slack, or no angle fits.
    """
    return _evaluate("estimate_output_angle", inst, locals())[0]


def compensation_stroke(
    inst: Instrument,
    agonist: ArrayLike,
    antagonist: ArrayLike,
    actuation: Actuation = "agonist",
    law: Law = "exact",
) -> FloatOrArray:
    """Return the tendon length to wind so that the tip bends as if tendons did not stretch (eqs. 21, 22), m.

    Parameters
    ----------
    inst
        The instrument.
    agonist, antagonist
        Measured tendon tensions, N.
    actuation
        "agonist": one motor winds the agonist; "differential": it winds, and the antagonist's lets out the same.
    law
        "exact": gives the whole loss back, slack included; "paper": eq. 22 as printed, whatever the actuation, which
        with one motor gives back half.

    Raises
    ------
    ValueError
        An input is not finite, or actuation or law is unknown.
    NoSolutionError
        At a single point the agonist's motor alone cannot give the angle back.
    """
    return _evaluate("compensation_stroke", inst, locals())[0]


def gradient(
    function: Callable[..., Any] | str, inst: Instrument, *args: Any, wrt: Sequence[str], **kwargs: Any
) -> Any:
    """Return the exact derivatives of one of this module's functions by parameters of the instrument or by inputs.

    Parameters
    ----------
    function
        The function, or its name: one of this module that returns angles, tensions, ratios, stiffnesses or strokes.
    inst
        The instrument.
    *args, **kwargs
        The function's other arguments.
    wrt
        What to differentiate by: keys of the instrument (SI units), or inputs such as "force" or "agonist_wound".

    Returns
    -------
    dict of str to float or array
        The derivative by each of `wrt`; for `tensions`, a :class:`Tensions` of derivatives. At the onset of slack,
        where the derivative jumps, it is the one with the slack tendon.

    Raises
    ------
    ValueError
        The function or a name in `wrt` is unknown or has no effect, or an input is invalid.
    NoSolutionError
        A single point has no solution.
    """
    name = function if isinstance(function, str) else getattr(function, "__name__", str(function))
    if name not in _INPUTS or name == "equilibrium":
        allowed = ", ".join(key for key in _INPUTS if key != "equilibrium")
        raise ValueError(f"function is {name!r}; allowed are {allowed}.")
    if isinstance(wrt, str) or not wrt:
        raise ValueError(f"wrt is {wrt!r}; allowed is a list of names.")
    bound = inspect.signature(globals()[name]).bind(inst, *args, **kwargs)
    bound.apply_defaults()
    query = _query(name, inst, bound.arguments)
    outputs, status = _solve(query, [_variable(name, inst, key) for key in wrt])
    _refuse_unsolved(query, status)
    shaped = [[_shaped(row, query.shape) for row in output] for output in outputs]
    rows = [Tensions(*pair) for pair in zip(*shaped, strict=True)] if name == "tensions" else shaped[0]
    return dict(zip(wrt, rows, strict=True))


def reach(inst: Instrument) -> float:
    """Return the handle angle (rad) that bends the unloaded tip through its working range, or the handle's range."""
    needed = handle_angle(inst, np.array([inst.output_range]))[0]
    return float(np.fmin(needed, inst.handle_range))


class _Query(NamedTuple):
    """A function of this module at its inputs: flat arrays of the common length, or of length one, by name."""

    name: str
    operation: str
    inst: Instrument
    columns: list[NDArray[np.float64]]
    shape: tuple[int, ...]

    def value(self, key: str, index: int) -> float:
        """Return an input's value at a flat index."""
        column = self.columns[_INPUTS[self.name].index(key)]
        return float(column[index if column.size > 1 else 0])


def _evaluate(name: str, inst: Instrument, arguments: dict[str, Any]) -> list[FloatOrArray]:
    query = _query(name, inst, arguments)
    outputs, status = _solve(query)
    _refuse_unsolved(query, status)
    return [_shaped(output[0], query.shape) for output in outputs]


def _solve(query: _Query, variables: list[int] | None = None) -> tuple[NDArray[np.float64], NDArray[np.uint8]]:
    """Return outputs, or their derivatives by some variables, by output, row and point, and every point's status.

    Raises
    ------
    ValueError
        An input is not finite or beyond the handle's range.
    """
    count = prod(query.shape)
    rows = 1 if variables is None else len(variables)
    out = np.empty((_OUTPUTS.get(query.name, 1), rows, count))
    status = np.empty(count, np.uint8)
    if variables is None:
        _core.evaluate(query.inst.spec, query.operation, query.columns, out, status, threads())
    else:
        _core.gradient(query.inst.spec, query.operation, query.columns, variables, out, status, threads())
    _refuse_invalid(query, status)
    return out, status


def _operation(name: str, arguments: dict[str, Any]) -> str:
    """Return the core's name of a function; the laws of compensation are operations of their own."""
    if name != "compensation_stroke":
        return name
    for argument, allowed in (("actuation", ("agonist", "differential")), ("law", ("exact", "paper"))):
        if arguments[argument] not in allowed:
            raise ValueError(f"{argument} is {arguments[argument]!r}; allowed are {' and '.join(allowed)}.")
    if arguments["law"] == "paper":
        return "compensation_stroke:paper"
    return f"compensation_stroke:{arguments['actuation']}:exact"


def _query(name: str, inst: Instrument, arguments: dict[str, Any]) -> _Query:
    """Broadcast a function's arguments, as it was called with them."""
    if not isinstance(inst, Instrument):
        raise TypeError(f"inst is {inst!r}; allowed is an instrument, as tenodesis.load gives it.")
    values = dict(arguments)
    if "wound" in values:
        wound = values.pop("wound")
        pair = wound if isinstance(wound, tuple) else (wound, 0.0)
        if len(pair) != 2:
            raise ValueError(f"wound is {wound!r}; allowed is the agonist's length, or a tuple of both tendons'.")
        values["agonist_wound"], values["antagonist_wound"] = pair
    arrays = [_numbers(key, values[key]) for key in _INPUTS[name]]
    try:
        shape = np.broadcast_shapes(*(array.shape for array in arrays))
    except ValueError:
        shapes = ", ".join(f"{key} {array.shape}" for key, array in zip(_INPUTS[name], arrays, strict=True))
        raise ValueError(f"the shapes do not broadcast: {shapes}.") from None
    columns = [
        array.reshape(1) if array.size == 1 else np.ascontiguousarray(np.broadcast_to(array, shape)).reshape(-1)
        for array in arrays
    ]
    return _Query(name, _operation(name, arguments), inst, columns, shape)


def _numbers(key: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return an argument as float64; text, times, complex and masked ones are refused, which NumPy would convert."""
    try:
        array = np.asarray(value)
    except ValueError:
        array = np.array(None)
    if array.dtype.kind not in "buif" or np.ma.isMaskedArray(value):
        raise ValueError(f"{key} is {value!r}; allowed is a number or an array of numbers.")
    return array.astype(np.float64, copy=False)


def _shaped(values: NDArray[np.float64], shape: tuple[int, ...]) -> FloatOrArray:
    return float(values[0]) if shape == () else values.reshape(shape)


def _variable(name: str, inst: Instrument, key: str) -> int:
    """Return the core's number of a parameter or an input to differentiate by."""
    inputs = _INPUTS[name]
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
        raise ValueError(f"wrt names {key!r}{hint}; allowed are {', '.join([*fields, *inputs])}.")
    return PARAMETERS.index(fields[key])


def _at(index: int, shape: tuple[int, ...]) -> str:
    """Return a flat index as it would be written behind an array's name."""
    return "" if shape == () else f"[{', '.join(str(i) for i in np.unravel_index(index, shape))}]"


def _value(key: str, value: float) -> str:
    return f"{value:.6g} rad ({degrees(value):.7g} deg)" if key in _ANGLES else f"{value:.6g}"


def _refuse_invalid(query: _Query, status: NDArray[np.uint8]) -> None:
    """Raise ValueError for the first input that is not finite or beyond the handle's range."""
    if not status.size or status.max() < Status.OUT_OF_RANGE:
        return
    first = int(np.argmax(status >= Status.OUT_OF_RANGE))
    place = _at(first, query.shape)
    for key in _INPUTS[query.name]:
        value = query.value(key, first)
        if not np.isfinite(value):
            raise ValueError(f"{key}{place} is {value}; allowed is a finite number.")
    raise ValueError(
        f"handle_angle{place} is {_value('handle_angle', query.value('handle_angle', first))}; "
        f"allowed is the handle's range of ±{degrees(query.inst.handle_range):.4g} deg."
    )


def _refuse_unsolved(query: _Query, status: NDArray[np.uint8]) -> None:
    """Raise NoSolutionError where a single point has no solution."""
    if query.shape != () or status[0] == Status.OK:
        return
    inputs = _INPUTS[query.name]
    values = {key: query.value(key, 0) for key in inputs}
    given = ", ".join(f"{key} = {_value(key, value)}" for key, value in values.items() if value or key == inputs[0])
    inst = query.inst
    reason = _REASONS[Status(int(status[0]))].format(range=degrees(inst.handle_range), pretension=inst.pretension)
    raise NoSolutionError(f"{query.name} of {inst.name} at {given}: {reason}.")

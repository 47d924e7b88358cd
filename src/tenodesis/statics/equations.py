"""The paper's equations 1 to 22: an instrument with its handle held, under load, without friction.

=====================  =========================================================
Equations 1-8          :func:`tensions`; of eq. 8, :func:`slack_force`, :func:`slack_load`
Equations 9, 18        :func:`output_angle`; with status, :func:`equilibrium`
Equation 18            :func:`unloaded_angle`, which compensation restores
Equations 10-14        :func:`torque_transmissibility`
Equations 15, 16       :func:`flexural_stiffness`
Equation 17            :func:`loss_of_dexterity`
Equation 19            :func:`estimate_output_angle`
Equation 20            :func:`handle_angle`
Equations 21, 22       :func:`compensation_stroke`
=====================  =========================================================

Angles in rad, forces in N, lengths in m. Functions of an instrument of one joint take numbers or arrays of any shapes
that broadcast as in NumPy; they return a float where all are numbers, and otherwise an array of the shape that they
broadcast to. Of several joints, angles have a last axis with the joints, tensions and what is wound one with the
tendons, and a force one with x, y and z in the tip's axes, which may be followed by a moment's. An instrument in the
short form is its first axis here; ``inst.axis("pitch")`` is the other one, ``inst.expanded`` all joints together.

One joint between two tendons alike has a closed form, which the core takes; functions that say "one joint" have no
other. A single point without a solution, such as an output angle of half a turn, raises
:class:`tenodesis.NoSolutionError`; in an array it becomes NaN, and :func:`equilibrium` gives the reason. Input that is
not finite or not allowed, or a handle angle beyond the handle's range, raises ``ValueError`` in either case.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from tenodesis._core import Status
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike, as_instrument, as_short_form
from tenodesis.statics import chain
from tenodesis.statics.chain import Axes, Rates
from tenodesis.statics.loads import of_joints, rows
from tenodesis.statics.query import (
    INPUTS,
    Equilibrium,
    FloatOrArray,
    Query,
    Tensions,
    check_solved,
    prepare,
    shaped,
    solve,
    variable,
)

HANDLE = "handle_angle"
_LOADS = "force", "radial_force", "wound"

Wound: TypeAlias = ArrayLike | tuple[ArrayLike, ArrayLike]
"""Tendon length wound in by the motors, m: the agonist's, a pair of agonist's and antagonist's, or of every tendon."""

Actuation: TypeAlias = Literal["agonist", "differential"]
"""Which motors act: the agonist's alone, or both in opposite directions."""
Law: TypeAlias = Literal["exact", "paper"]
"""The stroke that restores all of the loss, or eq. 22 as printed (care point 1)."""


def output_angle(
    inst: InstrumentLike,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> FloatOrArray:
    """Return the output angle at a held handle under load (eqs. 9, 18), rad.

    Parameters
    ----------
    handle_angle
        Of the handle's joints, rad.
    force
        At the tip, N, turning with it. Of one joint tangential, positive opposes positive flexion; of several x, y, z,
        (..., 3), or also the moment's, N m, (..., 6). Each end bears an equal share, jaws half.
    radial_force
        Of one joint: force along the end-effector, N, turning with it; positive outward.
    wound
        Tendon length wound in by the motors, m: the agonist's, a pair, or of every tendon, (..., tendons).
    grip_force
        Force with which an object presses the jaws apart, N.
    axes
        "tip": the force turns with the end-effector; "stem": it keeps its direction.
    """
    return _held("output_angle", inst, locals(), chain.output_angles)


def unloaded_angle(inst: InstrumentLike, handle_angle: ArrayLike) -> FloatOrArray:
    """Return the output angle without load, friction and strokes of the motors (eq. 18), rad: what laws restore.

    A backbone bends by less than the tendons are drawn, since these stretch against it. Of several joints, angles have
    a last axis with the joints.
    """
    if as_instrument(inst).closed_form is None:
        return output_angle(inst, handle_angle)
    return _evaluate("unloaded_angle", inst, locals())[0]


def handle_angle(
    inst: InstrumentLike,
    output_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> FloatOrArray:
    """Return the handle angle that maintains an output angle under load (eq. 20, slack included), rad.

    The inverse of :func:`output_angle`, with its other parameters (N, m).
    """
    return _held("handle_angle", inst, locals(), chain.handle_angles, "output_angle")


def tensions(
    inst: InstrumentLike,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Any:
    """Return the tendon tensions at a held handle under load (eqs. 6-8), N; parameters as of :func:`output_angle`.

    :class:`Tensions` of one joint's pair of tendons, otherwise an array with the tendons in its last axis.
    """
    given = locals()
    if (query := _closed("tensions", inst, given)) is not None:
        return Tensions(*_outputs(query))
    return _of_chain(inst, given, chain.tensions)


def torque_transmissibility(
    inst: InstrumentLike,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
) -> FloatOrArray:
    """Return the torque transmissibility, output over input moment (eqs. 10-14), dimensionless.

    Parameters are those of :func:`output_angle`. The moment of a continuum's own backbone is not counted.
    """
    return _evaluate("torque_transmissibility", inst, locals())[0]


def equilibrium(
    inst: InstrumentLike,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Equilibrium:
    """Return output angle (rad), tensions (N) and status, without an error where there is no equilibrium.

    Parameters are those of :func:`output_angle`.
    """
    given = locals()
    if (query := _closed("equilibrium", inst, given)) is None:
        found = _of_chain(inst, given | {"handle_angle": [given["handle_angle"]]}, chain.equilibrium)
        angle = of_joints(as_instrument(inst).as_chain, found.output_angle[0])
        reason = found.status[0] if found.status.ndim > 1 else Status(int(found.status[0]))
        return Equilibrium(angle, found.tensions[0], reason)
    outputs, status = solve(query)
    angle, agonist, antagonist = (shaped(output[0], query.shape) for output in outputs)
    reason = Status(int(status[0])) if query.shape == () else status.reshape(query.shape)
    return Equilibrium(angle, Tensions(agonist, antagonist), reason)


def rates(
    inst: InstrumentLike,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> Rates:
    """Return stiffness, compliances and transmissibility at rest as matrices, exact.

    Parameters are those of :func:`output_angle`; the matrices of one joint are 1 by 1.
    """
    found: Rates = _of_chain(inst, locals(), chain.rates)
    return found


def compensation_strokes(
    inst: InstrumentLike,
    handle_angle: ArrayLike,
    force: ArrayLike = 0.0,
    *,
    radial_force: ArrayLike = 0.0,
    wound: Wound = 0.0,
    grip_force: ArrayLike = 0.0,
    axes: Axes = "tip",
) -> FloatOrArray:
    """Return the lengths to wind so that all joints keep their unloaded angles under a load, (..., tendons), m.

    The tensions change by as little as carries the load, in the sum of their squares, none below zero; every motor
    winds what its own tendon is stretched by more, beyond what is wound. Parameters are those of :func:`output_angle`.

    Raises
    ------
    NoSolutionError
        The tendons with motors cannot carry the load at a single point.
    """
    return _of_chain(inst, locals(), chain.compensation_strokes)


def flexural_stiffness(inst: InstrumentLike, output_angle: ArrayLike) -> FloatOrArray:
    """Return the distal joint's flexural stiffness at an output angle (rad), tendons taut (eqs. 15, 16), N·m/rad."""
    return _evaluate("flexural_stiffness", inst, locals())[0]


def loss_of_dexterity(inst: InstrumentLike, output_angle: ArrayLike, force: ArrayLike) -> FloatOrArray:
    """Return the loss of dexterity at an output angle (rad) under a tangential force (N), rad (eq. 17).

    It is the loss of output angle to first order in the force.
    """
    return _evaluate("loss_of_dexterity", inst, locals())[0]


def slack_force(inst: InstrumentLike, output_angle: ArrayLike) -> FloatOrArray:
    """Return the force at which the antagonist of one joint is slack, its output angle (rad) held, N (eq. 8).

    Negative where it is slack without a force. With the handle held, see :func:`slack_load`.
    """
    return _evaluate("slack_force", inst, locals())[0]


def estimate_output_angle(
    inst: InstrumentLike,
    handle_angle: ArrayLike,
    agonist: ArrayLike,
    antagonist: ArrayLike,
    wound: Wound = 0.0,
    *,
    slack_below: ArrayLike = 0.0,
) -> FloatOrArray:
    """Return the output angle estimated from handle angle and tensions (eq. 19, slack and motor aware), rad.

    There is none where both tendons are slack, or no angle fits.

    Parameters
    ----------
    agonist, antagonist
        Measured tendon tensions, N.
    wound
        Tendon length wound in by the motors, m: the agonist's, or a pair.
    slack_below
        Tension, N, up to which a tendon counts as slack; with noisy load cells, above their noise.
    """
    return _evaluate("estimate_output_angle", inst, locals())[0]


def compensation_stroke(
    inst: InstrumentLike,
    agonist: ArrayLike,
    antagonist: ArrayLike,
    actuation: Actuation = "agonist",
    law: Law = "exact",
    *,
    handle_angle: ArrayLike = 0.0,
) -> FloatOrArray:
    """Return the tendon length to wind so that the tip bends as without the load (eqs. 21, 22), m.

    There is none where the agonist's motor alone cannot restore the angle.

    Parameters
    ----------
    agonist, antagonist
        Measured tendon tensions, N.
    actuation
        "agonist": one motor winds the agonist; "differential": it winds, and the antagonist's lets out the same.
    law
        "exact": restores all of the lost angle, slack included; "paper": eq. 22 as printed, whatever the actuation,
        which restores half of it with one motor.
    handle_angle
        Where the tensions were measured, rad: there a backbone stretches the tendons without a load, too.
    """
    return _evaluate("compensation_stroke", inst, locals())[0]


def gradient(
    function: Callable[..., Any] | str, inst: InstrumentLike, *args: Any, wrt: Sequence[str], **kwargs: Any
) -> Any:
    """Return the exact derivatives of a function of this module by parameters of the instrument or by inputs.

    Parameters
    ----------
    function
        The function, or its name: one of this module that returns angles, tensions, ratios, stiffnesses or strokes.
    *args, **kwargs
        The function's other arguments.
    wrt
        What to differentiate by: keys of the instrument (SI units), or inputs such as "force" or "agonist_wound".

    Returns
    -------
    dict
        The derivative by each of `wrt`, a float or an array; for `tensions`, a :class:`Tensions` of derivatives. At
        the onset of slack, where the derivative jumps, it is the one with the slack tendon.

    Raises
    ------
    ValueError
        The function or a name in `wrt` is unknown or has no effect.
    """
    inst = as_short_form(inst)
    name = function if isinstance(function, str) else getattr(function, "__name__", str(function))
    if name not in INPUTS or name == "equilibrium":
        allowed = ", ".join(key for key in INPUTS if key != "equilibrium")
        raise ArgumentError(key="function", value=name, allowed=f"one of {allowed}")
    if isinstance(wrt, str) or not wrt:
        raise ArgumentError(key="wrt", value=wrt, allowed="a list of names")
    bound = inspect.signature(globals()[name]).bind(inst, *args, **kwargs)
    bound.apply_defaults()
    query = prepare(name, inst, bound.arguments)
    outputs, status = solve(query, [variable(name, inst, key) for key in wrt])
    check_solved(query, status)
    derivatives = [[shaped(row, query.shape) for row in output] for output in outputs]
    rows = [Tensions(*pair) for pair in zip(*derivatives, strict=True)] if name == "tensions" else derivatives[0]
    return dict(zip(wrt, rows, strict=True))


def reach(inst: InstrumentLike) -> float:
    """Return the handle angle (rad) that bends the unloaded tip through its working range, or the handle's range."""
    inst = as_short_form(inst)
    needed = handle_angle(inst, np.array([inst.output_range]))[0]
    return float(np.fmin(needed, inst.handle_range))


def _closed(name: str, inst: InstrumentLike, arguments: dict[str, Any]) -> Query | None:
    """Return the query of an instrument's closed form; None where it has none, or none under such a load."""
    inst = as_instrument(inst)
    if inst.closed_form is None or arguments["axes"] != "tip" or np.any(arguments["grip_force"]):
        return None
    return prepare(name, inst, arguments)


def _of_chain(inst: InstrumentLike, arguments: dict[str, Any], function: Callable[..., Any], key: str = HANDLE) -> Any:
    joints = as_instrument(inst).as_chain
    held, wrench, strokes = rows(joints, (key, arguments[key]), *(arguments[name] for name in _LOADS))
    return function(joints, held, wrench, strokes=strokes, grip_force=arguments["grip_force"], axes=arguments["axes"])


def _held(
    name: str, inst: InstrumentLike, arguments: dict[str, Any], function: Callable[..., Any], key: str = HANDLE
) -> FloatOrArray:
    if (query := _closed(name, inst, arguments)) is not None:
        return _outputs(query)[0]
    return of_joints(as_instrument(inst).as_chain, _of_chain(inst, arguments, function, key))


def _evaluate(name: str, inst: InstrumentLike, arguments: dict[str, Any]) -> list[FloatOrArray]:
    return _outputs(prepare(name, inst, arguments))


def _outputs(query: Query) -> list[FloatOrArray]:
    outputs, status = solve(query)
    check_solved(query, status)
    return [shaped(output[0], query.shape) for output in outputs]

"""What loads take from the joints of a held instrument, what gives it back, and from where on a tendon is slack."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis.errors import ArgumentError, NoSolutionError
from tenodesis.instrument import FullForm, InstrumentLike, expanded
from tenodesis.statics.bends import Bends
from tenodesis.statics.chain import compensation_strokes, coordinates, equilibrium, handle_angles, rates
from tenodesis.statics.loads import rows
from tenodesis.statics.slack import first_slack

Array = NDArray[np.float64]

_HALF = 0.5
_WEIGHT = 1e4
_TAKEN = np.radians(10.0)
"""What a usual load takes about, from the joint that gives way most."""
_LARGEST = 5.0  # N
_FELT = 0.02
"""Share of the largest loss, by direction of a force, below which the direction is left out."""


class Loss(NamedTuple):
    """What a load takes at a held handle, and what gives it back; SI, NaN where there is none."""

    wrench: Array
    """Force and moment at the tip, (6,), N and N m"""
    grip_force: float
    """N"""
    output_angles: Array
    """Without the load, (joints,), rad"""
    loaded_angles: Array
    """(joints,), rad"""
    lost: Array
    """The unloaded minus the loaded angles, (joints,), rad"""
    tensions: Array
    """Under the load, (tendons,), N"""
    strokes: Array
    """Lengths that the motors wind besides to bring all joints back, (tendons,), m"""
    handle_corrections: Array
    """By which the hand would have to move the handle instead, (handle joints,), rad"""
    slack_factor: float
    """Multiple of the load under which the first tendon goes slack, handle held; 0 if one is slack without a load"""
    slack_tendon: str
    """Its name, empty if there is none"""


def hold(inst: InstrumentLike, output_angles: ArrayLike) -> tuple[Array, Array]:
    """Return the handle's angles and the motors' strokes at which an unloaded instrument takes given angles.

    By the handle if it has as many joints as the tip, otherwise by the motors, with the smallest change of tensions;
    joints that neither can turn stay where they are.

    Parameters
    ----------
    inst
        The instrument.
    output_angles
        Of the tip's joints, (..., joints), rad.

    Returns
    -------
    tuple
        Handle angles (..., handle joints), rad, NaN where it cannot hold one of several, and strokes (..., tendons), m.

    Raises
    ------
    ArgumentError
        They are not as many as the joints.
    NoSolutionError
        The handle cannot hold these angles, of a single state.
    """
    from scipy.optimize import nnls  # noqa: PLC0415 - takes long to load

    inst = expanded(inst)
    angles = np.atleast_1d(np.asarray(output_angles, float))
    if angles.shape[-1] != len(inst.tip_joints):
        raise ArgumentError(key="output_angles", value=output_angles, allowed=f"{len(inst.tip_joints)} numbers, rad")
    many = angles.shape[:-1]
    handle, strokes = (np.zeros((*many, len(parts))) for parts in (inst.handle_joints, inst.tendons))
    if not angles.any():
        return handle, strokes
    if handle.shape[-1] == angles.shape[-1]:
        return np.where(angles.any(axis=-1, keepdims=True), handle_angles(inst, angles), 0.0), strokes
    if many:
        found = [hold(inst, row)[1] for row in angles.reshape(-1, angles.shape[-1])]
        return handle, np.array(found).reshape(strokes.shape)
    at, turns = coordinates(inst.tip_joints, angles)
    arms = inst.tendon_arms("tip")
    motors = np.array([tendon.start == "spool" for tendon in inst.tendons])
    cubic = np.array([joint.cubic_stiffness for joint in inst.tip_joints])
    springs = (inst.springs @ angles + cubic * angles**3) / turns
    drawn, rest = arms @ at, inst.pretensions
    fixed = inst.tensions_at(-drawn)[~motors]
    needed = springs - arms[~motors].T @ np.maximum(fixed, 0.0)
    # Tensions nearest to those at rest, none negative; the balance outweighs their change.
    weight = _WEIGHT / np.abs(arms).max()
    rows = np.vstack([weight * arms[motors].T, np.eye(motors.sum())])
    tensions, _ = nnls(rows, np.concatenate([weight * needed, rest[motors]]))
    wanted = rest.copy()
    wanted[motors] = tensions
    strokes[motors] = (drawn + inst.stretches(wanted))[motors]
    return handle, strokes


def usual_states(inst: InstrumentLike, shares: Sequence[float] = (_HALF,)) -> list[Array]:
    """Return the angles of the straight tip, (joints,), and of those bent by shares of its range, or of the handle's.

    Shares that neither can be held at are left out.
    """
    inst = expanded(inst)
    ends = [joint.range for joint in inst.handle_joints]
    found = [np.zeros(len(inst.tip_joints))]
    for share in shares:
        for place in ("tip", "handle"):
            try:
                if place == "tip":
                    bent = inst.bent(share * inst.bend_ends)
                else:
                    bent = equilibrium(inst, [share * end for end in ends]).output_angle
                hold(inst, bent)
            except NoSolutionError:
                continue
            found.append(bent)
            break
    return found


class UsualLoad(NamedTuple):
    """A load against flexion of the bent state of :func:`usual_states`."""

    name: str
    """x, y, z of the tip's axes, or grip"""
    size: float
    """N"""
    wrench: Array
    """Force and moment at the tip, (6,), N and N m"""
    grip_force: float
    """Force that presses the jaws apart, N"""


def usual_loads(inst: InstrumentLike) -> list[UsualLoad]:
    """Return the forces along the tip's axes that take something from a joint, and the grip if there are jaws.

    Forces have the second size of the instrument's conditions. Without them, and of the grip, the size is one digit of
    what takes about ten degrees from a joint of the bent state, at most five newtons.
    """
    inst = expanded(inst)
    bends, bent = Bends.of(inst), usual_states(inst)[-1]
    handle, strokes = hold(inst, bent)
    answer = bends.rates(rates(inst, handle, strokes=strokes))
    by_force = answer.by_wrench[:, :3]
    most = np.abs(by_force).max(axis=0)
    given = sorted(inst.conditions.forces)
    size = given[min(1, len(given) - 1)] if given else _one_digit(float(most.max()))
    found = []
    for n, axis in enumerate("xyz"):
        if most[n] >= _FELT * most.max():
            sign = -1.0 if by_force[:, n] @ np.sign(bends.summed(bent) + 1e-12) > 0 else 1.0
            wrench = np.zeros(6)
            wrench[n] = sign * size
            found.append(UsualLoad(axis, size, wrench, 0.0))
    if inst.jaws:
        grip = _one_digit(float(np.abs(answer.by_grip).max()))
        found.append(UsualLoad("grip", grip, np.zeros(6), grip))
    return found


def up_to_force(loads: Sequence[UsualLoad], force: float) -> list[UsualLoad]:
    """Return loads of which the largest force at the tip has another size, N, and the others are in proportion."""
    share = force / max((one.size for one in loads if one.wrench.any()), default=force)
    return [
        one._replace(size=one.size * share, wrench=one.wrench * share) if one.wrench.any() else one for one in loads
    ]


def _one_digit(rate: float) -> float:
    return float(f"{_TAKEN / max(rate, _TAKEN / _LARGEST):.1g}")


def loss(inst: InstrumentLike, output_angles: ArrayLike, wrench: ArrayLike, grip_force: float = 0.0) -> Loss:
    """Return what a load takes from an instrument that is held at given angles of its unloaded joints.

    Parameters
    ----------
    inst
        The instrument.
    output_angles
        Of the tip's joints, (joints,), rad, as :func:`hold` holds them.
    wrench
        Force (N) and moment (N m) on the tip, (6,), in its axes; of one joint the tangential force, N.
    grip_force
        Force with which an object presses the jaws apart, N.

    Raises
    ------
    ArgumentError
        An argument does not fit the instrument.
    NoSolutionError
        The unloaded instrument cannot be held at these angles.
    """
    inst = expanded(inst)
    handle, strokes = hold(inst, output_angles)
    free = equilibrium(inst, handle, 0.0, strokes=strokes).output_angle
    # Of arrays, points without an equilibrium are NaN.
    whole = wrench if np.ndim(wrench) else rows(inst, ("output_angles", free), wrench, 0.0, 0.0).wrench
    row = np.atleast_2d(np.asarray(whole, float))
    under = equilibrium(inst, handle, row, grip_force=grip_force, strokes=strokes)
    restoring = compensation_strokes(inst, handle, row, grip_force=grip_force, strokes=strokes)[0]
    correction = np.full(len(handle), np.nan)
    if len(handle) == len(free):
        correction = handle_angles(inst, free, row, grip_force=grip_force, strokes=strokes)[0] - handle
    factor, tendon = _slack(inst, handle, strokes, row[0], grip_force)
    angles = under.output_angle[0]
    return Loss(
        row[0], grip_force, free, angles, free - angles, under.tensions[0], restoring, correction, factor, tendon
    )


def _slack(inst: FullForm, handle: Array, strokes: Array, wrench: Array, grip: float) -> tuple[float, str]:
    """Return the multiple of a load at which the first of the tendons goes slack, and its name."""
    if not (wrench.any() or grip):
        return np.nan, ""

    def tensions(factor: Array) -> Array:
        found = equilibrium(inst, handle, [factor * wrench], grip_force=factor * grip, strokes=strokes).tensions
        return np.asarray(found[0])

    first = first_slack(tensions, (), float(inst.pretensions.max()))
    return float(first.factor), inst.tendons[int(first.tendon)].name if first.tendon >= 0 else ""

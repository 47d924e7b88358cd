"""The tendon-driven rolling joint of a single axis in motion, simulated in MuJoCo.

The mechanism is that of :mod:`peers.mujoco_peer`, without friction and gravity: two elastic tendons
that only pull, a handle that moves as prescribed, and loads that turn with the end-effector. What the tip adds is a
constant effective inertia J and viscous damping c about the output angle. Quantities are in SI units (m, N, rad, s).

Carrier and moving gear turn by q, half the output angle. An armature I on either joint stores 2 (I q'^2 / 2) =
(I / 2) (output velocity)^2 / 2, and a damping d on either takes 2 d q'^2 = (d / 2) (output velocity)^2, hence I = 2 J
and d = 2 c.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from math import isnan
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray
from peers.mujoco_peer import mechanism_xml, settle

from tenodesis.errors import NoSolutionError
from tenodesis.extras import require
from tenodesis.instrument import TendonGear

Array: TypeAlias = NDArray[np.float64]

_TIP = ("tip_yaw_carrier", "tip_yaw_moving")
_HANDLE = ("handle_yaw_carrier", "handle_yaw_moving")
# MuJoCo refuses bodies without inertia. Each of the tip's two has this share of J: together they add 9/4 of it to J.
_BODY_SHARE = 1e-9
# Inertia (kg m^2) against which no tendon changes the prescribed velocity of the handle's joints.
_IMMOVABLE = 1e12
_BATCH = 1000  # steps between two looks at the clock


@dataclass(frozen=True)
class Motion:
    """The tip's motion: angle (rad), its rate (rad/s) and tendon tensions (N), each per sample, shape (n,).

    All are NaN from the sample on at which the joint has snapped through.
    """

    output_angle: Array
    output_velocity: Array
    agonist: Array
    antagonist: Array


def simulate(
    inst: TendonGear,
    handle_angle: ArrayLike,
    force: ArrayLike,
    time_step: float,
    *,
    inertia: float,
    damping: float,
    substeps: int = 10,
    radial_force: ArrayLike | None = None,
) -> Motion:
    """Move the handle and load the tip as prescribed, and follow the tip from rest.

    Sample k holds the state after step k, at whose end handle angle (rad) and forces (N), each (n,), have their values
    k; within the step they run linearly from their values k - 1. Before the first sample the instrument rests under its
    values. A force acts across the end-effector, positive against positive flexion, a radial one along it, positive
    outward.

    Time steps are in s, inertia (kg m^2) and viscous damping (N m s/rad) about the output angle. A sample takes
    `substeps` of MuJoCo's Runge-Kutta integrator, of fourth order as long as no tendon slackens or tautens.

    Raises
    ------
    NoSolutionError
        There is no equilibrium to start from.
    MissingExtraError
        MuJoCo is not installed.
    """
    handle = np.asarray(handle_angle, float)
    inputs = np.column_stack([handle, force, np.zeros_like(handle) if radial_force is None else radial_force])
    mujoco = require("mujoco", "verify")
    spec = _mechanism(mujoco, inst, None, time_step=time_step / substeps, inertia=inertia, damping=damping)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for load in spec.actuators:  # its control is then the rate of the load, which changes within a step, too
        load.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
    model = spec.compile()
    data = mujoco.MjData(model)
    tip = [model.joint(name).qposadr[0] for name in _TIP]
    data.qpos[tip] = _resting(inst, *inputs[0].tolist()) / 2
    motion = np.full((len(inputs), 4), np.nan)
    for sample, state in enumerate(_states(mujoco, model, data, inputs, substeps)):
        motion[sample] = state
    return Motion(*motion.T.copy())


def steps_per_second(
    inst: TendonGear,
    *,
    inertia: float,
    damping: float,
    handle_angle: float = 0.0,
    force: float = 0.0,
    time_step: float = 5e-4,
    seconds: float = 1.0,
) -> float:
    """Measure how many steps a second one core makes with this instrument in MuJoCo, handle held and load constant.

    Everything that MuJoCo can do without is left out: the handle and all else that rests is one body, nothing is
    rendered, sensed or checked for contact, and the cheapest integrator and solver run in C, a batch at a time.
    Quantities and errors are those of :func:`simulate`; it measures for some seconds.
    """
    mujoco = require("mujoco", "verify")
    spec = _mechanism(mujoco, inst, handle_angle, time_step=time_step, inertia=inertia, damping=damping)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.solver = mujoco.mjtSolver.mjSOL_PGS  # exact for a single tie
    without = mujoco.mjtDisableBit
    spec.option.disableflags |= int(without.mjDSBL_ISLAND | without.mjDSBL_EULERDAMP | without.mjDSBL_SENSOR)
    spec.compiler.fusestatic = True
    spec.delete(spec.actuator("radial_force"))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = _resting(inst, handle_angle, force, 0.0) / 2
    data.ctrl[0] = force
    return step_rate(model, data, seconds)


def step_rate(model: Any, data: Any, seconds: float) -> float:
    """Return the steps per second of a model of MuJoCo over at least so many seconds, after a first batch."""
    mujoco = require("mujoco", "verify")
    mujoco.mj_step(model, data, _BATCH)
    steps, elapsed, start = 0, 0.0, perf_counter()
    while elapsed < seconds or not steps:
        mujoco.mj_step(model, data, _BATCH)
        steps += _BATCH
        elapsed = perf_counter() - start
    return steps / elapsed


def _mechanism(
    mujoco: Any, inst: TendonGear, handle_angle: float | None, *, time_step: float, inertia: float, damping: float
) -> Any:
    """Describe the mechanism in motion, its handle held at this angle (rad) or on joints of its own (None)."""
    spec = mujoco.MjSpec.from_string(mechanism_xml(inst, {"yaw": handle_angle}))
    spec.option.timestep = time_step
    without = mujoco.mjtDisableBit
    spec.option.disableflags = int(without.mjDSBL_CONTACT | without.mjDSBL_LIMIT | without.mjDSBL_FRICTIONLOSS)
    for joint in spec.joints:
        tip = joint.name in _TIP
        joint.armature = 2 * inertia if tip else _IMMOVABLE
        joint.damping[0] = 2 * damping if tip else 0.0
        joint.parent.inertia = np.full(3, _BODY_SHARE * inertia)
        joint.parent.mass = _BODY_SHARE * inertia / inst.distal_gear_radius**2
    for tie in spec.equalities:
        tie.solref = 2 * time_step, 1.0  # as stiff as MuJoCo allows; it acts on the difference of the angles alone
    return spec


def _resting(inst: TendonGear, handle_angle: float, force: float, radial_force: float) -> float:
    """Find the output angle (rad) at rest under a handle angle (rad) and loads (N)."""
    angle = settle(inst, handle_angle, force, radial_force).output_angle
    if isnan(angle):
        raise NoSolutionError("there is no equilibrium to start from under this handle angle and load")
    return angle


def _states(mujoco: Any, model: Any, data: Any, inputs: Array, substeps: int) -> Iterator[Array]:
    """Yield angle (rad), velocity (rad/s) and both tensions (N) after each sample, up to a snap-through."""
    handle, tip = ([model.joint(name).qposadr[0] for name in joints] for joints in (_HANDLE, _TIP))
    before = np.vstack([inputs[:1], inputs[:-1]])
    rates = (inputs - before) / (substeps * model.opt.timestep)
    for begin, rate in zip(before, rates, strict=True):
        data.qpos[handle], data.qvel[handle] = begin[0] / 2, rate[0] / 2
        data.act[:], data.ctrl[:] = begin[1:], rate[1:]
        mujoco.mj_step(model, data, substeps)
        # A carrier turned by a right angle lines up with its tendons, which then have no lever to hold it.
        if not np.abs(data.qpos[tip]).max() < np.pi / 2:
            return
        mujoco.mj_fwdPosition(model, data)
        tensions = model.tendon_stiffness * (data.ten_length - model.tendon_lengthspring[:, 1]).clip(min=0.0)
        yield np.array([data.qpos[tip].sum(), data.qvel[tip].sum(), *tensions])

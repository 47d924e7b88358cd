"""Joints that share tendons in motion, simulated in MuJoCo.

The mechanism is the exported model of :func:`tenodesis.kinematics.mjcf`, without friction and gravity: strings that
only pull, handle joints that move as prescribed, loads that turn with the tip. Links have the masses, inertias and
dampings that the twin has; mechanical stops are left out. Quantities are in SI units (m, N, rad, s).

A gear pair is two hinges, half its angle each, a backbone eight; ties hold them together. Bodies between them weigh
nothing, so that their hinges have a little inertia of their own; those of an only joint have all of its link's, which
adds up to it whatever the angle.
"""

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from peers.chain_peer import IMMOVABLE, ChainPeer

from tenodesis import kinematics
from tenodesis.errors import NoSolutionError
from tenodesis.extras import require
from tenodesis.instrument import FullForm
from tenodesis.kinematics.chain import skeleton
from tenodesis.kinematics.parts import moving
from tenodesis.plant import link_rows

Array = NDArray[np.float64]

# Inertia that the hinges of a joint, if several, add to a link, as a share of its own: ties of lighter ones are softer.
_ARMATURE_SHARE = 1e-3
_LEAST = 1e-14  # kg, kg m^2: MuJoCo compiles no body that weighs less
_TOLERANCE = 1e-8  # of the solver: MuJoCo's own
_BATCH = 1000  # steps between two looks at the clock


@dataclass(frozen=True)
class Motion:
    """By sample: angles of the tip's joints (rad) and their rates (rad/s), (n, joints); tensions (N), (n, tendons)."""

    output_angle: Array
    output_velocity: Array
    tension: Array


class _Model:
    """The model, and places of its hinges by joint."""

    def __init__(self, inst: FullForm, time_step: float) -> None:
        mujoco = self.mujoco = require("mujoco", "verify")
        self.inst = inst
        spec = mujoco.MjSpec.from_string(kinematics.mjcf(inst))
        spec.option.timestep, spec.option.tolerance = time_step, _TOLERANCE
        without = mujoco.mjtDisableBit
        spec.option.disableflags = int(without.mjDSBL_CONTACT | without.mjDSBL_LIMIT)
        for geom in spec.geoms:
            geom.mass = 0.0
        links = link_rows(inst)
        alone = len(inst.tip_joints) == 1
        share = 1.0 if alone else _ARMATURE_SHARE
        far = {} if alone else {f"{one.name}_far": row for one, row in zip(inst.tip_joints, links, strict=True)}
        for body in spec.bodies[1:]:
            mass, centre, *about = far.get(body.name, np.zeros(5))[:5]
            body.explicitinertial = True
            body.mass, body.ipos = max(mass, _LEAST), (0.0, 0.0, centre)
            body.inertia = np.maximum(np.array(about) - mass * centre**2 * np.array([1.0, 1.0, 0.0]), _LEAST)
        for tie in spec.equalities:
            tie.solref = 2 * time_step, 1.0  # as stiff as MuJoCo allows
        for string in spec.tendons:
            string.damping[0] = 0.0
        for joint in inst.handle_joints:
            spec.delete(spec.actuator(joint.name))
            for name in moving(skeleton(inst), joint, "mjcf"):
                spec.joint(name).armature = IMMOVABLE
                spec.joint(name).damping[0] = 0.0
        for joint, row in zip(inst.tip_joints, links, strict=True):
            names = moving(skeleton(inst), joint, "mjcf")
            for name in names:
                spec.joint(name).armature = len(names) * share * row[2:5].max() if alone or len(names) > 1 else 0.0
                spec.joint(name).damping[0] = len(names) * row[5]
        self.spec = spec

    def compiled(self) -> tuple[Any, Any]:
        """Return model and data; nothing weighs only so that it compiles."""
        model = self.spec.compile()
        light = model.body_mass <= _LEAST
        model.body_mass[light] = 0.0
        model.body_inertia[model.body_inertia <= _LEAST] = 0.0
        data = self.mujoco.MjData(model)
        self.mujoco.mj_setConst(model, data)
        self.mujoco.mj_resetData(model, data)
        return model, data

    def shares(self, model: Any, place: str) -> Array:
        """Return the share of each joint's angle at an end that each hinge turns by, (hinges, joints)."""
        joints = self.inst.tip_joints if place == "tip" else self.inst.handle_joints
        found = np.zeros((model.nv, len(joints)))
        for i, joint in enumerate(joints):
            names = moving(skeleton(self.inst), joint, "mjcf")
            found[[model.joint(name).dofadr[0] for name in names], i] = 1 / len(names)
        return found


def simulate(
    inst: FullForm,
    handle_angles: ArrayLike,
    wrench: ArrayLike,
    time_step: float,
    *,
    strokes: ArrayLike = 0.0,
    substeps: int = 10,
) -> Motion:
    """Move handle and motors and load the tip as prescribed, and follow the tip from rest.

    Sample k holds the state after step k, at whose end handle angles (n, handle joints; rad), wrench (n, 6; N and N m,
    in the tip's axes) and strokes of the motors (n, tendons; m) have their values k; within the step they run linearly
    from their values k - 1. Before the first sample the instrument rests under its values. A sample of a time step (s)
    takes `substeps` of MuJoCo's Runge-Kutta integrator.

    Raises
    ------
    NoSolutionError
        There is no equilibrium to start from.
    MissingExtraError
        MuJoCo is not installed.
    """
    loads = np.atleast_2d(np.asarray(wrench, float))
    ends = len(inst.bearing)
    handles = np.broadcast_to(np.asarray(handle_angles, float), (len(loads), len(inst.handle_joints)))
    wound = np.broadcast_to(np.asarray(strokes, float), (len(loads), len(inst.tendons)))
    rest = ChainPeer(inst).settle(handles[0], loads[0], strokes=wound[0]).angles
    if np.isnan(rest).any():
        raise NoSolutionError("there is no equilibrium to start from under this handle angle and load")
    of = _Model(inst, time_step / substeps)
    mujoco = of.mujoco
    of.spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    for actuator in of.spec.actuators:  # its control is then the rate of what it does, which changes within a step, too
        actuator.dyntype = mujoco.mjtDyn.mjDYN_INTEGRATOR
    model, data = of.compiled()
    tip, held = of.shares(model, "tip"), of.shares(model, "handle")
    acted = np.hstack([wound, np.tile(loads / ends, ends)])
    handle_hinges = held.any(axis=1)
    data.qpos[:] = tip @ rest + held @ handles[0]
    counted = (tip > 0).T.astype(float)
    motion = Motion(np.empty((len(loads), len(rest))), np.empty((len(loads), len(rest))), np.empty(wound.shape))
    for k in range(len(loads)):
        last = max(k - 1, 0)
        data.qpos[handle_hinges] = (held @ handles[last])[handle_hinges]
        data.qvel[handle_hinges] = (held @ (handles[k] - handles[last]))[handle_hinges] / time_step
        data.act[:], data.ctrl[:] = acted[last], (acted[k] - acted[last]) / time_step
        mujoco.mj_step(model, data, substeps)
        mujoco.mj_forward(model, data)
        motion.output_angle[k], motion.output_velocity[k] = counted @ data.qpos, counted @ data.qvel
        motion.tension[k] = -data.actuator_force[: wound.shape[1]]
    return motion


def mass_matrix(inst: FullForm, angles: ArrayLike, speeds: ArrayLike) -> tuple[Array, Array]:
    """Return the mass matrix of the tip's joints, kg m^2, and the moments that their rates take, N m, by MuJoCo.

    Angles (rad) and rates (rad/s) of shape (joints,); hinges of a joint turn by the same share of it.
    """
    of = _Model(inst, 1e-3)
    model, data = of.compiled()
    shares = of.shares(model, "tip")
    data.qpos[:], data.qvel[:] = shares @ np.asarray(angles, float), shares @ np.asarray(speeds, float)
    of.mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    of.mujoco.mj_fullM(model, data, full)
    full -= np.diag(model.dof_armature)
    return shares.T @ full @ shares, shares.T @ data.qfrc_bias


def steps_per_second(
    inst: FullForm, wrench: ArrayLike, *, time_step: float = 5e-4, seconds: float = 1.0, as_exported: bool = True
) -> float:
    """Measure how many steps a second one core makes with this instrument in MuJoCo, under a constant wrench (6,).

    The model is the exported one, its handle free to move; or else one without everything that MuJoCo can do without:
    the handle, held straight, and all else that rests is one body, nothing is sensed or checked for contact, motors
    without a load are left out, and the cheapest integrator and solver run. Both run in C, a batch at a time, for some
    seconds. Quantities and errors are those of :func:`simulate`.
    """
    mujoco = require("mujoco", "verify")
    acting = np.tile(np.asarray(wrench, float) / len(inst.bearing), len(inst.bearing))
    if as_exported:
        model = mujoco.MjModel.from_xml_string(kinematics.mjcf(inst))
        model.opt.timestep, model.opt.tolerance = time_step, _TOLERANCE
        data = mujoco.MjData(model)
        data.ctrl[-acting.size :] = acting
    else:
        model, data = _fastest(inst, acting, time_step)
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


def _fastest(inst: FullForm, acting: Array, time_step: float) -> tuple[Any, Any]:
    """Return model and data of the least that moves as the tip does, under loads by motor (N, N m)."""
    of = _Model(inst, time_step)
    mujoco, spec = of.mujoco, of.spec
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    without = mujoco.mjtDisableBit
    spec.option.disableflags |= int(
        without.mjDSBL_FRICTIONLOSS | without.mjDSBL_ISLAND | without.mjDSBL_EULERDAMP | without.mjDSBL_SENSOR
    )
    spec.compiler.fusestatic = True
    held = {name for joint in inst.handle_joints for name in moving(skeleton(inst), joint, "mjcf")}
    for tie in [tie for tie in spec.equalities if tie.name1 in held]:
        spec.delete(tie)
    # The cheapest one is exact for a single tie.
    spec.option.solver = mujoco.mjtSolver.mjSOL_NEWTON if spec.equalities[1:] else mujoco.mjtSolver.mjSOL_PGS
    for name in held:
        spec.delete(spec.joint(name))
    winding, loads = spec.actuators[: len(inst.tendons)], spec.actuators[len(inst.tendons) :]
    for string, motor in zip(spec.tendons, winding, strict=True):
        # Of what no motor winds, a spring that cannot push is less work.
        stiffness = -motor.biasprm[1]
        string.stiffness[0], string.springlength = stiffness, (0.0, motor.biasprm[0] / stiffness)
        spec.delete(motor)
    for motor, force in zip(loads, acting, strict=True):
        if not force:
            spec.delete(motor)
    model, data = of.compiled()
    data.ctrl[:] = acting[acting != 0]
    return model, data

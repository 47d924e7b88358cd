"""An independent check of joints that share tendons: their MuJoCo model, settled.

Nothing here uses the statics of the core: gears are two hinges tied to each other, pulleys are cylinders that strings
wrap around, a backbone is a row of vertebrae, strings pull and never push, forces act at sites, and the angles are
wherever the mechanism comes to rest. All quantities are in SI units (m, N, rad). Straight, the instrument lies along z,
tip up.
"""

from dataclasses import dataclass
from math import nan, pi
from typing import Any
from xml.etree.ElementTree import SubElement, fromstring, tostring

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import kinematics
from tenodesis.extras import require
from tenodesis.instrument import FullForm
from tenodesis.kinematics.chain import skeleton
from tenodesis.kinematics.parts import moving

Array = NDArray[np.float64]

# The straight joint, at its stiffest, is overdamped at this rate (rad/s): it then creeps to the nearest
# equilibrium without overshoot, so that a load close to the fold is not carried over it by momentum.
RATE = 200.0
_STILL = 1e-10  # rad: how far velocity and acceleration may still carry a joint that is called settled
_NEARLY_STILL = 1e-5  # rad: the same before the load comes, whose rest only decides where that one begins
_BATCH = 10  # steps between two looks at the state
_MAX_STEPS = 60_000  # only within a few parts in 100 000 of the fold does creeping there take longer
IMMOVABLE = 1e12
"""Inertia (kg m^2) against which no tendon moves the handle's joints."""


@dataclass(frozen=True)
class Settled:
    """Equilibrium: angles of the tip's joints (rad) and tensions of the tendons (N), all NaN if there is none."""

    angles: Array
    tensions: Array
    steps: int


class ChainPeer:
    """An instrument of joints and tendons in MuJoCo; raises MissingExtraError if MuJoCo is not installed."""

    def __init__(self, inst: FullForm) -> None:
        mujoco = self._mujoco = require("mujoco", "verify")
        self._inst = inst
        self._model = mujoco.MjModel.from_xml_string(_with_fixed_wrench(inst))
        # The statics have no mechanical stops.
        self._model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        self._data = mujoco.MjData(self._model)
        # Nor inertia, without which it creeps to where it rests.
        self._model.body_mass *= 1e-3
        self._model.body_inertia *= 1e-3
        mujoco.mj_setConst(self._model, self._data)
        for joint in inst.handle_joints:
            for name in moving(skeleton(inst), joint, "mjcf"):
                self._model.dof_armature[self._model.joint(name).dofadr] = IMMOVABLE
        self._hinges = {
            joint.name: [self._model.joint(name).qposadr[0] for name in moving(skeleton(inst), joint, "mjcf")]
            for joint in inst.joints
        }

    def settle(
        self,
        handle_angles: ArrayLike,
        wrench: ArrayLike = (0.0,) * 6,
        *,
        grip_force: float = 0.0,
        strokes: ArrayLike = 0.0,
        axes: str = "tip",
    ) -> Settled:
        """Let the instrument come to rest, first unloaded and then under its load; arguments as in `tn.statics.chain`.

        The grip force acts between the jaws: opposite forces there have a moment about the jaws' axis and no sum.
        """
        mujoco, model, data, inst = self._mujoco, self._model, self._data, self._inst
        mujoco.mj_resetData(model, data)
        for joint, angle in zip(inst.handle_joints, np.asarray(handle_angles, float), strict=True):
            hinges = self._hinges[joint.name]
            data.qpos[hinges] = data.actuator(joint.name).ctrl[:] = angle / len(hinges)
        handles, tendons, steps = len(inst.handle_joints), len(inst.tendons), 0
        motors = slice(handles, handles + tendons)
        data.ctrl[motors] = strokes
        for share, still in ((0.0, _NEARLY_STILL), (1.0, _STILL)):
            load = share * np.asarray(wrench, float) / len(inst.bearing)
            own, fixed = (load, 0 * load) if axes == "tip" else (0 * load, load)
            data.ctrl[handles + tendons :] = np.concatenate([np.tile(part, len(inst.bearing)) for part in (own, fixed)])
            for jaw, sign in zip(inst.jaws, (1.0, -1.0), strict=False):
                joint = inst.tip_joints[jaw]
                length = (inst.grip and inst.grip.length) or joint.end_effector_length or 0.0
                data.qfrc_applied[self._hinges[joint.name]] = share * sign * length * grip_force
            taken, resting = relax(mujoco, model, data, still)
            steps += taken
            if not resting:
                return Settled(np.full(len(inst.tip_joints), nan), np.full(tendons, nan), steps)
        angles = np.array([data.qpos[self._hinges[joint.name]].sum() for joint in inst.tip_joints])
        return Settled(angles, -data.actuator_force[motors], steps)


def relax(mujoco: Any, model: Any, data: Any, still: float) -> tuple[int, bool]:
    """Step until the joints rest (rad), snap through or run out of steps: steps taken, and whether they rest."""
    for steps in range(_BATCH, _MAX_STEPS + 1, _BATCH):
        mujoco.mj_step(model, data, _BATCH)
        # A carrier turned by a right angle lines up with its tendons, which then have no lever to hold it.
        if not abs(data.qpos).max() < pi / 2:
            return steps, False
        if abs(data.qvel).max() < still * RATE and abs(data.qacc).max() < still * RATE**2:
            return steps, True
    return _MAX_STEPS, False


def _with_fixed_wrench(inst: FullForm) -> str:
    """Return the model with a second wrench at each end, in the stem's axes."""
    root = fromstring(kinematics.mjcf(inst))
    actuators = root.find("actuator")
    assert actuators is not None
    for motor in actuators.findall("motor"):
        name, site, gear = (motor.get(key, "") for key in ("name", "site", "gear"))
        SubElement(actuators, "motor", name=f"{name}_in_stem", site=site, gear=gear, refsite="stem_origin")
    return tostring(root, encoding="unicode")

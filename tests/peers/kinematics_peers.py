"""An independent check of the instrument in space: the exported models, put into postures by MuJoCo and Pinocchio.

Nothing here uses the equations of the chain: inputs are joint positions by name, outputs are frames of bodies.
Positions are in m;
orientations are rotation matrices.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tenodesis.extras import require

Array = NDArray[np.float64]
Poses = Mapping[str, tuple[Array, Array]]
"""Position (3,), m, and rotation matrix (3, 3) by body."""


def mujoco_poses(xml: str, postures: Sequence[Mapping[str, float]]) -> list[Poses]:
    """Return the poses of all bodies of a MuJoCo model at positions of its joints by name, rad and m."""
    mujoco = require("mujoco", "verify")
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    found: list[Poses] = []
    for posture in postures:
        for joint, position in posture.items():
            data.joint(joint).qpos[0] = position
        mujoco.mj_kinematics(model, data)
        bodies = [(model.body(i).name, data.body(i)) for i in range(1, model.nbody)]
        found.append({name: (body.xpos.copy(), body.xmat.reshape(3, 3).copy()) for name, body in bodies})
    return found


def pinocchio_poses(urdf: str, postures: Sequence[Mapping[str, float]]) -> list[Poses]:
    """Return the poses of all links of a URDF in Pinocchio at positions of its joints by name, rad and m."""
    pinocchio = require("pinocchio", "verify")
    model = pinocchio.buildModelFromXML(urdf)
    data = model.createData()
    found: list[Poses] = []
    for posture in postures:
        _place(pinocchio, model, data, posture)
        frames = [(frame.name, data.oMf[i]) for i, frame in enumerate(model.frames) if frame.type.name == "BODY"]
        found.append({name: (pose.translation.copy(), pose.rotation.copy()) for name, pose in frames})
    return found


def pinocchio_jacobian(urdf: str, posture: Mapping[str, float], link: str) -> Mapping[str, Array]:
    """Return the velocity (m/s) over angular velocity (rad/s) of a link (6,), by joint, along the base's axes."""
    pinocchio = require("pinocchio", "verify")
    model = pinocchio.buildModelFromXML(urdf)
    data = model.createData()
    place = _place(pinocchio, model, data, posture)
    frame = model.getFrameId(link)
    columns = pinocchio.computeFrameJacobian(model, data, place, frame, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED)
    return {name: columns[:, model.joints[model.getJointId(name)].idx_v] for name in posture}


def _place(pinocchio: Any, model: Any, data: Any, posture: Mapping[str, float]) -> Array:
    place = np.zeros(model.nq)
    for joint, position in posture.items():
        place[model.joints[model.getJointId(joint)].idx_q] = position
    pinocchio.framesForwardKinematics(model, data, place)
    return place

"""Instruments in space: forward and inverse kinematics through the port, workspace, models for other tools.

The chain of a planar instrument is that of Fig. 1: a spherical joint at the port (pan, tilt, spin), a prismatic one
through it (insertion), and three that turn the end-effector (yaw, pitch, roll); the handle's joints are at the other
end of the stem. Any other instrument has the joints of its file, at the tip in a tree.

The port is the origin, in metres; without a port in the file it is the stem's tip end. At zero angles the stem lies
along z, tip up, into the patient; pan and yaw go toward x, tilt and pitch toward y, spin and roll turn about z.
Quaternions are unit quaternions, (w, x, y, z), w not negative. Coordinates are a :class:`Posture`, or arrays with the
joints of an end in the last axis; they and goals broadcast as in NumPy.

For a view, :func:`frames` gives everything at once::

    view = tn.kinematics.frames(inst, tn.kinematics.Posture(yaw=0.5, handle_yaw=0.21))
    view = tn.kinematics.frames("needle-driver", [0.2, 0.5, -0.5])
    view.bodies["stem"].position            # (3,) m; each body's Frame(position, quaternion)
    view.bodies["stem"].quaternion          # (4,) w, x, y, z
    view.tendons["yaw_agonist"]             # (points, 3) m, from the handle to the tendon's end
    tn.kinematics.dimensions(inst)          # lengths and radii to draw the bodies with, m

:func:`urdf` and :func:`mjcf` write the instrument for other tools, and :func:`joint_positions` returns the positions of
their joints.
"""

from tenodesis.instrument.lengths import Dimensions
from tenodesis.kinematics.dimensions import Limits, dimensions, limits
from tenodesis.kinematics.mjcf import mjcf
from tenodesis.kinematics.motion import (
    Frame,
    Frames,
    Port,
    Posture,
    forward,
    frames,
    inverse,
    jacobian,
    tip_pose,
    within_limits,
)
from tenodesis.kinematics.parts import joint_positions
from tenodesis.kinematics.urdf import urdf
from tenodesis.kinematics.workspace import Workspace, workspace

__all__ = [
    "Dimensions",
    "Frame",
    "Frames",
    "Limits",
    "Port",
    "Posture",
    "Workspace",
    "dimensions",
    "forward",
    "frames",
    "inverse",
    "jacobian",
    "joint_positions",
    "limits",
    "mjcf",
    "tip_pose",
    "urdf",
    "within_limits",
    "workspace",
]


def __dir__() -> list[str]:
    return sorted(__all__)

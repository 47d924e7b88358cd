"""The instrument at rest against tip poses of another solver."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tenodesis import statics
from tenodesis.errors import IdentificationError
from tenodesis.instrument import FullForm, InstrumentLike, expanded, in_arcs
from tenodesis.json_values import json_values
from tenodesis.kinematics import Port, tip_pose
from tenodesis.kinematics.chain import rotated
from tenodesis.magnitude import rms_of_finite
from tenodesis.poses.reading import ReferencePoses, load
from tenodesis.run import Array
from tenodesis.statics import Axes, chain

_LONGER = 1.05
"""Distance of a pose from the stem's end, over the instrument's length, beyond which its unit is mistaken."""
_STRAIGHT = Port(insertion=0.0)
_UNITS = {
    "reference": "m", "position": "m", "error": "m", "length": "m", "strokes": "m", "tensions": "N", "angles": "rad",
    "angle_error": "rad",
}  # fmt: skip


@dataclass(frozen=True)
class PoseComparison:
    """Poses of another solver, and the instrument's under the same; NaN where it has no equilibrium."""

    inst: FullForm
    given: ReferencePoses
    axes: Axes
    angles: Array
    """Of the tip's joints, (n, joints), rad"""
    position: Array
    """Of the tip, (n, 3), m"""
    tensions: Array
    """(n, tendons), N"""
    strokes: Array
    """(n, tendons), m"""
    angle_error: Array | None
    """Of the tip's direction, (n,), rad; None where the file gives none"""

    @property
    def length(self) -> float:
        """From the stem's end to the tip of the straight instrument, m."""
        return float(np.linalg.norm(_tip(self.inst, np.zeros(len(self.inst.tip_joints)))[0]))

    @property
    def error(self) -> Array:
        """Distance between both tips, (n,), m."""
        return np.asarray(np.linalg.norm(self.position - self.given.position, axis=1))

    @property
    def solved(self) -> int:
        """Number of poses at which the instrument has an equilibrium."""
        return int(np.isfinite(self.error).sum())

    @property
    def worst(self) -> int:
        """Place of the pose with the largest error of position."""
        return int(np.nanargmax(self.error))

    @property
    def summary(self) -> dict[str, float]:
        """Root mean square and largest error: of position in mm and % of the length, of the direction in deg."""
        found = {}
        scales = {"mm": (self.error, 1e3), "%": (self.error, 100 / self.length)}
        if self.angle_error is not None:
            scales["deg"] = (self.angle_error, float(np.degrees(1)))
        for unit, (values, scale) in scales.items():
            found[f"rms [{unit}]"] = scale * rms_of_finite(values)
            found[f"largest [{unit}]"] = scale * float(np.nanmax(np.abs(values)))
        return found

    @property
    def notes(self) -> list[str]:
        """What is to be known of the comparison, a sentence each."""
        found = []
        if missing := len(self.error) - self.solved:
            found.append(f"{self.inst.name} has no equilibrium at {missing} of {len(self.error)} poses.")
        alone = [joint.name for joint in self.inst.tip_joints if joint.mechanism == "continuum" and not joint.arc]
        if alone:
            found.append(f"{' and '.join(alone)} bends as one arc, which is inexact under forces across; give arcs.")
        if len(self.inst.bearing) > 1:
            found.append(f"Of the ends that of {self.inst.tip_joints[self.inst.bearing[0]].name} is compared.")
        if self.given.wrench is not None:
            found.append(f"Forces and moments are taken in the axes of the {self.axes}.")
        return found

    def to_json(self) -> dict[str, Any]:
        """Return the comparison as plain values for JSON, SI."""
        columns = {
            "reference": self.given.position,
            "position": self.position,
            "error": self.error,
            "angles": self.angles,
            "tensions": self.tensions,
            "strokes": self.strokes,
        } | ({} if self.angle_error is None else {"angle_error": self.angle_error})
        content: dict[str, Any] = {
            "instrument": self.inst.name,
            "poses": self.given.name,
            "driven_by": self.given.driven,
            "axes_of_loads": self.axes,
            "joints": [joint.name for joint in self.inst.tip_joints],
            "tendons": [tendon.name for tendon in self.inst.tendons],
            "length": self.length,
            "solved": self.solved,
            "worst": self.worst,
            "summary": self.summary,
            "notes": self.notes,
            "units": _UNITS,
            "rows": [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)],
        }
        return dict(json_values(content))


def compare(
    inst: InstrumentLike, poses: ReferencePoses | Path | str, *, arcs: int | None = None, axes: Axes = "tip"
) -> PoseComparison:
    """Return an instrument at rest, without friction, against tip poses that another solver computed.

    Parameters
    ----------
    inst
        Any instrument.
    poses
        Poses, or a CSV file of them, see :func:`tenodesis.poses.load`.
    arcs
        In how many arcs the backbones bend; by default those of the instrument.
    axes
        In which forces and moments are given, as of :func:`tenodesis.statics.equilibrium`.

    Raises
    ------
    IdentificationError
        The file cannot be read, a pose is farther from the stem's end than the instrument is long, or the instrument
        has an equilibrium at none.
    """
    whole = expanded(inst) if arcs is None else in_arcs(inst, arcs)
    if not whole.bearing:
        raise IdentificationError(
            f"{whole.name} has no end; a joint must have an end_effector_length.", key="inst", value=whole.name
        )
    given = poses if isinstance(poses, ReferencePoses) else load(poses, whole)
    length = float(np.linalg.norm(_tip(whole, np.zeros(len(whole.tip_joints)))[0]))
    away = np.linalg.norm(given.position, axis=1)
    if (far := int(away.argmax())) >= 0 and away[far] > _LONGER * length:
        raise IdentificationError(
            f"{given.name}: row {far + 1}: the tip is {1e3 * away[far]:.4g} mm from the stem's end, and {whole.name} "
            f"is {1e3 * length:.4g} mm long; units and origin must be right.",
            key="position",
            value=float(away[far]),
        )
    count, tendons = len(given.position), len(whole.tendons)
    handle = np.zeros((count, len(whole.handle_joints))) if given.handle_angles is None else given.handle_angles
    wrench = np.zeros((count, 6)) if given.wrench is None else given.wrench
    strokes = np.zeros((count, tendons)) if given.strokes is None else given.strokes
    grip = 0.0 if given.grip_force is None else given.grip_force
    if given.tensions is not None:
        strokes = statics.strokes_at_tensions(whole, given.tensions, handle, wrench, grip_force=grip, axes=axes)
    known = np.asarray(np.isfinite(strokes).all(axis=1, keepdims=True))
    rest = chain.equilibrium(whole, handle, wrench, strokes=np.where(known, strokes, 0.0), grip_force=grip, axes=axes)
    angles = np.where(known, rest.output_angle, np.nan)
    known &= np.isfinite(angles).all(axis=1, keepdims=True)
    if not known.any():
        raise IdentificationError(
            f"{whole.name} has an equilibrium at none of the {count} poses of {given.name}; loads must be smaller, or "
            "tensions and units right.",
            key="poses",
            value=given.name,
        )
    position, turns = _tip(whole, np.where(known, angles, 0.0))
    position = np.where(known, position, np.nan)
    error = _angle_error(whole, given, turns)
    return PoseComparison(
        whole,
        given,
        axes,
        angles,
        position,
        np.where(known, rest.tensions, np.nan),
        strokes,
        None if error is None else np.where(known[:, 0], error, np.nan),
    )


def _tip(inst: FullForm, angles: Array) -> tuple[Array, Array]:
    """Return position (..., 3), m, and quaternion (..., 4) of the first end, from the stem's."""
    found = tip_pose(inst, angles, port=_STRAIGHT)
    return found.position[..., 0, :], found.quaternion[..., 0, :]


def _angle_error(inst: FullForm, given: ReferencePoses, turns: Array) -> Array | None:
    """Return the angle between both directions, or that of ours minus theirs where a file gives one, (n,), rad."""
    if given.quaternion is not None:
        conjugate = turns * [1, -1, -1, -1]
        w, u = conjugate[:, :1], conjugate[:, 1:]
        v, t = given.quaternion[:, :1], given.quaternion[:, 1:]
        apart = w * t + v * u + np.cross(u, t)
        same = w * v - np.sum(u * t, axis=1, keepdims=True)
        return np.asarray(2 * np.arctan2(np.linalg.norm(apart, axis=1), np.abs(same[:, 0])))
    if given.angle is None:
        return None
    x, y, z = rotated(turns, np.array([0.0, 0.0, 1.0])).T
    axes = np.abs([joint.axis_vector for joint in inst.tip_joints]).max(axis=0) > 1e-9
    # About the stem's y a joint bends toward x, about the opposite of x toward y.
    across = x if axes.tolist() == [False, True, False] else y if axes.tolist() == [True, False, False] else None
    own = np.arctan2(np.hypot(x, y), z) if across is None else np.arctan2(across, z)
    off = own - given.angle
    return np.asarray((off + np.pi) % (2 * np.pi) - np.pi)

"""An independent check of tendon-driven rolling joints of one axis or two: their MuJoCo model, settled.

All quantities are in SI units (m, N, rad). A handle is held at an angle; forces act across the end-effector, positive
against positive flexion, or along it, positive outward, and turn with it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import asin, cos, inf, isnan, sin
from typing import NamedTuple

from peers.chain_peer import ChainPeer

from tenodesis.instrument import ShortForm, TendonGear

_peer = lru_cache(maxsize=4)(ChainPeer)


class Settled(NamedTuple):
    """Equilibrium of a single axis: angle (rad) and tensions (N), all NaN if there is none."""

    output_angle: float
    agonist: float
    antagonist: float


class TwoAxis(NamedTuple):
    """Equilibrium of two axes: angles (rad), NaN if there is none."""

    yaw: float
    pitch: float


@dataclass(frozen=True)
class Coupling:
    """A change (rad) of one axis's settled angle, and the output angles (rad) and forces (N) behind it."""

    change: float
    axis: str
    yaw: float
    pitch: float
    force_yaw: float
    force_pitch: float


@dataclass(frozen=True)
class Independence:
    """The largest coupling between the axes, without and with loads, the cases that never settled, and all of them.

    Each of `cases` has the unloaded output angles (rad) and the forces (N) of yaw and pitch.
    """

    unloaded: Coupling
    loaded: Coupling
    unsettled: int
    cases: Mapping[tuple[float, ...], TwoAxis]


def settle(inst: ShortForm, handle_angle: float, force: float, radial_force: float = 0.0) -> Settled:
    """Let the first axis alone come to rest, first unloaded and then under its tip loads."""
    found = _peer(inst.axis("yaw").expanded).settle([handle_angle], [-force, 0.0, radial_force, 0.0, 0.0, 0.0])
    return Settled(*found.angles.tolist(), *found.tensions.tolist())


def radial_coefficient(inst: TendonGear, settled: Settled, force: float, radial_force: float) -> float:
    """Return the factor of a radial force (N) in eq. 1, as found from the settled tensions, dimensionless."""
    half = settled.output_angle / 2
    by_force = force * (inst.end_effector_length / (inst.distal_gear_radius * cos(half)) + 1)
    return (by_force - (settled.agonist - settled.antagonist)) / radial_force


def settle_two_axis(inst: ShortForm, yaw: float, pitch: float, force_yaw: float, force_pitch: float) -> TwoAxis:
    """Let both axes of the stacked joint, which are alike, come to rest, first unloaded and then under tip forces."""
    peer = _peer(inst.replace(overrides=None).expanded)
    return TwoAxis(*peer.settle([yaw, pitch], [-force_yaw, -force_pitch, 0.0, 0.0, 0.0, 0.0]).angles.tolist())


def axis_independence(
    inst: TendonGear,
    output_angles: Sequence[float],
    forces: Sequence[float],
    progress: Callable[[], None] | None = None,
) -> Independence:
    """Find how far the settled angle of an axis changes because the other is moved and loaded.

    Every pair of unloaded output angles (rad) meets every pair of tip forces (N); each axis is compared with itself in
    the same model while the other is held straight and free of force. `progress` is called after every load case.
    """
    settled: dict[tuple[float, ...], TwoAxis] = {}

    def case(*where: float) -> TwoAxis:
        if where not in settled:
            handles = _handle_angle(inst, where[0]), _handle_angle(inst, where[1])
            settled[where] = settle_two_axis(inst, *handles, *where[2:])
            if progress is not None:
                progress()
        return settled[where]

    def couplings(yaw: float, pitch: float, force_yaw: float, force_pitch: float) -> list[Coupling]:
        where = yaw, pitch, force_yaw, force_pitch
        both = case(*where)
        change_yaw = both.yaw - case(yaw, 0.0, force_yaw, 0.0).yaw
        change_pitch = both.pitch - case(0.0, pitch, 0.0, force_pitch).pitch
        return [Coupling(change_yaw, "yaw", *where), Coupling(change_pitch, "pitch", *where)]

    poses = product(output_angles, output_angles)
    unloaded = [found for yaw, pitch in poses for found in couplings(yaw, pitch, 0.0, 0.0)]
    cases = product(output_angles, output_angles, forces, forces)
    loaded = [found for where in cases for found in couplings(*where)]
    unsettled = sum(isnan(found.change) for found in unloaded + loaded)
    return Independence(max(unloaded, key=_size), max(loaded, key=_size), unsettled, settled)


def _handle_angle(inst: TendonGear, output_angle: float) -> float:
    """Find the handle angle (rad) that leaves both tendons at pretension at this output angle (rad)."""
    return 2 * asin(inst.distal_gear_radius / inst.proximal_gear_radius * sin(output_angle / 2))


def _size(found: Coupling) -> float:
    """Rank a coupling by its magnitude (rad), a case without equilibrium last."""
    return -inf if isnan(found.change) else abs(found.change)

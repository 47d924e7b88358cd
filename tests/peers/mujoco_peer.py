"""An independent check of the tendon-driven rolling joint, built and settled in MuJoCo.

Nothing here uses the joint's force balance: the gears are bodies, the tendons are strings through sites,
the loads turn with the end-effector, and the angle is wherever the mechanism comes to rest. All quantities
are in SI units (m, N, rad). At zero angles the instrument lies along z, tip up; yaw bends it toward x and
pitch toward y.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from math import asin, cos, hypot, inf, isnan, nan, pi, sin
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from tenodesis.extras import require
from tenodesis.instrument import TendonGear

TIME_STEP = 1e-3  # s
# The straight joint, at its stiffest, is overdamped at this rate (rad/s): it then creeps to the nearest
# equilibrium without overshoot, so that a load close to the fold is not carried over it by momentum.
RATE, _DAMPING_RATIO = 200.0, 1.2
_STILL = 1e-10  # rad: how far velocity and acceleration may still carry a joint that is called settled
_BATCH = 10  # steps between two looks at the state
_MAX_STEPS = 60_000  # only within a few parts in 100 000 of the fold does creeping there take longer

_TURN = {"yaw": "0 1 0", "pitch": "-1 0 0"}  # positive angles carry the tip toward ...
_TOWARD = {"yaw": (1.0, 0.0), "pitch": (0.0, 1.0)}  # ... this (x, y) side, where the agonist runs
_SIDES = {"agonist": 1.0, "antagonist": -1.0}


@dataclass(frozen=True)
class Settled:
    """Equilibrium of a single axis: angle (rad) and tensions (N), all NaN if there is none."""

    output_angle: float
    agonist: float
    antagonist: float
    steps: int


@dataclass(frozen=True)
class TwoAxis:
    """Equilibrium of two axes: angles (rad) and (agonist, antagonist) tensions (N), NaN if there is none."""

    yaw: float
    pitch: float
    yaw_tensions: tuple[float, float]
    pitch_tensions: tuple[float, float]


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


def settle(inst: TendonGear, handle_angle: float, force: float, radial_force: float = 0.0) -> Settled:
    """Let a single axis come to rest, first unloaded and then under its tip loads.

    The handle is held at an angle (rad). A force (N) acts across the end-effector, positive against positive flexion, a
    radial one along it, positive outward; both turn with it. Beyond the fold there is no equilibrium, and all is NaN.
    """
    (axis,) = _settle(planar_xml(inst, handle_angle), (force, radial_force))
    return axis


def radial_coefficient(inst: TendonGear, settled: Settled, force: float, radial_force: float) -> float:
    """Return the factor of a radial force (N) in eq. 1, as found from the settled tensions, dimensionless."""
    half = settled.output_angle / 2
    by_force = force * (inst.end_effector_length / (inst.distal_gear_radius * cos(half)) + 1)
    return (by_force - (settled.agonist - settled.antagonist)) / radial_force


def settle_two_axis(
    inst: TendonGear,
    yaw: float,
    pitch: float,
    force_yaw: float,
    force_pitch: float,
    *,
    gap: float | None = None,
) -> TwoAxis:
    """Let both axes of the stacked joint come to rest, first unloaded and then under their tip forces.

    Both axes share gears and tendons. The handle is held at angles (rad); forces (N) turn with the end-effector,
    positive against their axis's positive flexion. The rigid link between the tip's two pairs is `gap` long (m), by
    default a pair's centre distance. Beyond the fold there is no equilibrium, and all is NaN.
    """
    yawed, pitched = _settle(two_axis_xml(inst, yaw, pitch, gap=gap), (force_yaw, force_pitch, 0.0))
    tensions = (yawed.agonist, yawed.antagonist), (pitched.agonist, pitched.antagonist)
    return TwoAxis(yawed.output_angle, pitched.output_angle, *tensions)


def axis_independence(
    inst: TendonGear,
    output_angles: Sequence[float],
    forces: Sequence[float],
    progress: Callable[[], None] | None = None,
    *,
    gap: float | None = None,
) -> Independence:
    """Find how far the settled angle of an axis changes because the other is moved and loaded.

    Every pair of unloaded output angles (rad) meets every pair of tip forces (N); each axis is compared with itself in
    the same model while the other is held straight and free of force. `progress` is called after every load case; `gap`
    as in :func:`settle_two_axis`.
    """
    settled: dict[tuple[float, ...], TwoAxis] = {}

    def case(*where: float) -> TwoAxis:
        if where not in settled:
            handles = _handle_angle(inst, where[0]), _handle_angle(inst, where[1])
            settled[where] = settle_two_axis(inst, *handles, *where[2:], gap=gap)
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


def planar_xml(inst: TendonGear, handle_angle: float) -> str:
    """Write the MuJoCo model (MJCF) of one axis with the handle held at this angle (rad)."""
    return mechanism_xml(inst, {"yaw": handle_angle})


def two_axis_xml(inst: TendonGear, yaw: float, pitch: float, *, gap: float | None = None) -> str:
    """Write the MuJoCo model (MJCF) of both axes with the handle held at these angles (rad), gap in m."""
    return mechanism_xml(inst, {"yaw": yaw, "pitch": pitch}, gap)


def _settle(xml: str, loads: tuple[float, ...]) -> list[Settled]:
    """Settle each axis of a model, first unloaded and then under these loads (N, in actuator order)."""
    mujoco = require("mujoco", "verify")
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    steps = 0
    for share in (0.0, 1.0):
        data.ctrl[:] = [share * load for load in loads]
        taken, resting = relax(mujoco, model, data)
        steps += taken
        if not resting:
            return [Settled(nan, nan, nan, steps)] * model.neq
    angles = data.qpos.reshape(-1, 2).sum(axis=1)
    tensions = model.tendon_stiffness * (data.ten_length - model.tendon_lengthspring[:, 1]).clip(min=0.0)
    axes = zip(angles.tolist(), *tensions.reshape(-1, 2).T.tolist(), strict=True)
    return [Settled(angle, agonist, antagonist, steps) for angle, agonist, antagonist in axes]


def relax(mujoco: Any, model: Any, data: Any) -> tuple[int, bool]:
    """Step until the joints rest, snap through or run out of steps: steps taken, and whether they rest."""
    for steps in range(_BATCH, _MAX_STEPS + 1, _BATCH):
        mujoco.mj_step(model, data, _BATCH)
        # A carrier turned by a right angle lines up with its tendons, which then have no lever to hold it.
        if not abs(data.qpos).max() < pi / 2:
            return steps, False
        if abs(data.qvel).max() < _STILL * RATE and abs(data.qacc).max() < _STILL * RATE**2:
            return steps, True
    return _MAX_STEPS, False


def _handle_angle(inst: TendonGear, output_angle: float) -> float:
    """Find the handle angle (rad) that leaves both tendons at pretension at this output angle (rad)."""
    return 2 * asin(inst.distal_gear_radius / inst.proximal_gear_radius * sin(output_angle / 2))


def _size(found: Coupling) -> float:
    """Rank a coupling by its magnitude (rad), a case without equilibrium last."""
    return -inf if isnan(found.change) else abs(found.change)


def mechanism_xml(inst: TendonGear, held: Mapping[str, float | None], gap: float | None = None) -> str:
    """Write the model whose pairs, from the stem outward, are those the handle is `held` at (rad), or free (None)."""
    large, small, axes = inst.proximal_gear_radius, inst.distal_gear_radius, list(held)
    gap = 2 * small if gap is None else gap
    pair, link = 2 * (large + small), 2 * large + gap  # lengths of both ends together
    jointed = len(axes) * pair + (len(axes) - 1) * link
    stem = inst.overall_length - inst.handle_length - inst.end_effector_length - jointed

    root = Element("mujoco", model="tendon-driven rolling joint")
    SubElement(root, "compiler", angle="radian")
    SubElement(root, "option", timestep=f"{TIME_STEP}", integrator="implicitfast", gravity="0 0 0")
    default = SubElement(root, "default")
    # Inertia has no part in an equilibrium, so it is chosen to suit the time step; each pair has two joints.
    stiffness = 8 * inst.tendon_stiffness * small**2
    armature, damping = stiffness / RATE**2 / 2, _DAMPING_RATIO * stiffness / RATE
    SubElement(default, "joint", armature=f"{armature}", damping=f"{damping}")
    # The stiffest tie MuJoCo allows: the two angles of a pair then agree to about 1e-6 rad.
    SubElement(default, "equality", solref=f"{2 * TIME_STEP} 1", solimp="0.9999 0.9999 0.001 0.5 2")
    SubElement(default, "tendon", stiffness=f"{inst.tendon_stiffness}")

    world = SubElement(root, "worldbody")
    bottom = SubElement(world, "body", name="stem_bottom")
    handle = _stack(bottom, "handle", held, -large, -2 * large)
    SubElement(handle, "site", name="grip", pos=f"0 0 {-inst.handle_length}")
    top = SubElement(world, "body", name="stem_top", pos=f"0 0 {stem}")
    effector = _stack(top, "tip", dict.fromkeys(axes), small, gap)
    SubElement(effector, "site", name="tip", pos=f"0 0 {inst.end_effector_length}")

    tendons, ties = SubElement(root, "tendon"), SubElement(root, "equality")
    loads = SubElement(root, "actuator")
    rest = hypot(stem, large - small) - inst.pretension / inst.tendon_stiffness
    for place, axis in enumerate(axes):
        gears = [f"{passed}_{gear}" for passed in axes[: place + 1] for gear in ("fixed", "moving")]
        route = [f"handle_{gear}" for gear in reversed(gears)] + [f"tip_{gear}" for gear in gears]
        slack = rest + (place + 1) * pair + place * link
        for side in _SIDES:
            # A range of rest lengths that starts at zero makes a string: it pulls, and never pushes.
            string = SubElement(tendons, "spatial", name=f"{axis}_{side}", springlength=f"0 {slack}")
            for gear in route:
                SubElement(string, "site", site=f"{gear}_{axis}_{side}")
        SubElement(ties, "joint", joint1=f"tip_{axis}_moving", joint2=f"tip_{axis}_carrier")
        x, y = _TOWARD[axis]
        SubElement(loads, "motor", name=f"{axis}_force", site="tip", gear=f"{-x} {-y} 0 0 0 0")
    SubElement(loads, "motor", name="radial_force", site="tip", gear="0 0 1 0 0 0")
    indent(root)
    return tostring(root, encoding="unicode")


def _stack(body: Element, end: str, pairs: Mapping[str, float | None], radius: float, gap: float) -> Element:
    """Stack rolling pairs on a body, each held at an angle (rad) or free (None): the last moving gear.

    Each is a carrier turning about the fixed gear's centre and the moving gear turning about its own, by
    half the angle each; gear radius and gap (m) are negative where the stack points down.
    """
    for place, (axis, angle) in enumerate(pairs.items()):
        guided = list(pairs)[place:]
        if place:
            body = SubElement(body, "body", name=f"{end}_{axis}_fixed", pos=f"0 0 {gap}")
        _guides(body, f"{end}_{axis}_fixed", guided, abs(radius))
        for part, height in (("carrier", 0.0), ("moving", 2 * radius)):
            body = SubElement(body, "body", name=f"{end}_{axis}_{part}", pos=f"0 0 {height}")
            if angle is None:
                SubElement(body, "joint", name=f"{end}_{axis}_{part}", axis=_TURN[axis])
                SubElement(body, "inertial", pos="0 0 0", mass="1e-6", diaginertia="1e-9 1e-9 1e-9")
            else:
                body.set("axisangle", f"{_TURN[axis]} {angle / 2}")
        _guides(body, f"{end}_{axis}_moving", guided, abs(radius))
    return body


def _guides(body: Element, gear: str, axes: Sequence[str], radius: float) -> None:
    """Put the sites that guide these axes' tendons at a gear's centre height, `radius` (m) to each side."""
    for axis, (side, sign) in product(axes, _SIDES.items()):
        x, y = (sign * radius * share for share in _TOWARD[axis])
        SubElement(body, "site", name=f"{gear}_{axis}_{side}", pos=f"{x} {y} 0")

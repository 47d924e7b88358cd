"""The law on wrists: both axes under forces in any direction, pushes on the neighbour, the grip meanwhile.

A two-axis hybrid instrument, whose pitch tendons pass the yaw gears, has friction at every bend of every tendon. Its
handle goes to a state and stays; then a force comes. The controller assumes friction that is up to 30 % wrong. Errors
are those of both angles over the last half second, against the unloaded instrument without friction.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import control, instrument, statics
from tenodesis.control import Controller
from tenodesis.control.controller import LawName, fault_names
from tenodesis.statics import chain
from tenodesis.twin import Held, Twin

Array: TypeAlias = NDArray[np.float64]

STATES = ((0, 0), (33, 33), (67, 0), (0, 67), (67, -33), (80, 80), (-80, 67))
"""Yaw and pitch, deg."""
FORCES = {"hybrid-real-size": 0.3, "hybrid-scaled-up": 1.0}
"""Size of the force at the tip, N."""
DIRECTIONS = ((1, 0, 0), (0, -1, 0), (-0.7, 0.7, 0), (0.6, 0.5, -0.6))
FRICTION = (0.7, 1.0, 1.3)
"""Friction of the instrument over what the controller assumes."""
STEP = 5e-4
ARRIVED, LOADED, END = 1.0, 2.0, 7.0
"""When the handle has arrived, when the force comes, and the end, s."""


@dataclass(frozen=True)
class Case:
    """A run: errors of yaw and pitch (deg) and the larger speed of their motors (rad/s), each (samples, 2)."""

    state: tuple[float, float]
    direction: tuple[float, float, float]
    friction: float
    error: Array
    winding: Array
    faults: tuple[str, ...]

    @property
    def final(self) -> Array:
        """Errors over the last half second."""
        return self.error[-round(0.5 / STEP) :]


def true_instrument(name: str, friction: float) -> instrument.FullForm:
    """Return the instrument with friction so many times as strong as in its file."""
    inst = instrument.expanded(name)
    table = inst.friction.model_dump(exclude_none=True)
    for key in ("vertex_coefficient", "sheath_coefficient"):
        table[key] *= friction
    return inst.replace(friction=table)


def commands(inst: instrument.FullForm, state: tuple[float, float]) -> Array:
    """Handle angles that lead to a state, (steps, handle joints), rad; the trigger stays."""
    time = np.arange(round(END / STEP)) * STEP
    share = np.clip(time / ARRIVED, 0, 1)
    angles = np.zeros((time.size, len(inst.handle_joints)))
    planar = control.compensated(inst)
    for (axis, pair), wanted in zip(control.pairs(inst).items(), np.radians(state), strict=True):
        angle = float(statics.handle_angle(planar.axis(axis), wanted))
        angles[:, pair.handle] = angle * share**2 * (3 - 2 * share)
    return angles


def run(
    name: str, state: tuple[float, float], direction: tuple[float, float, float], friction: float, law: LawName
) -> Case:
    """Run a state under a force, with the motors off or with the robust law."""
    assumed, inst = instrument.expanded(name), true_instrument(name, friction)
    handle = commands(assumed, state)
    time = np.arange(len(handle)) * STEP
    wrench = np.zeros((len(handle), 6))
    wrench[:, :3] = FORCES[name] * np.asarray(direction) * np.clip((time[:, None] - LOADED) / 0.1, 0, 1)
    controller = None if law == "off" else Controller(assumed, law=law, enabled=True)
    out = Twin(inst, seed=1).run(handle, wrench=wrench, controller=controller)
    joints = [pair.joint for pair in control.pairs(inst).values()]
    target = chain.output_angles(assumed, handle[-1])[joints]
    faults = fault_names(int(np.bitwise_or.reduce(out["faults"].astype(int).ravel()))) if controller else ()
    speeds = np.abs(out["commanded_spool_velocity"])
    own = [[pair.agonist, pair.antagonist] for pair in control.pairs(inst).values()]
    winding = np.stack([speeds[:, tendons].max(axis=1) for tendons in own], axis=1)
    return Case(state, direction, friction, np.degrees(out["output_angle"][:, joints] - target), winding, faults)


def neighbour_push(case: Case) -> float:
    """Largest movement of an axis, deg, while its own motors rest under the load and those of the other wind."""
    start = round((LOADED + 0.5) / STEP)
    moving = np.abs(case.winding[start:]) > 1e-3
    pushes = [0.0]
    for axis in (0, 1):
        pushed = np.flatnonzero(moving[:, 1 - axis] & ~moving[:, axis])
        for window in np.split(pushed, np.flatnonzero(np.diff(pushed) > 1) + 1):
            pushes.append(float(np.ptp(case.error[start:][window, axis])) if window.size else 0.0)
    return max(pushes)


def grip_kept(name: str, state: tuple[float, float] = (60, 45)) -> tuple[float, float, float]:
    """Grip force before the wrist moves, and its smallest and largest share of it while the wrist moves and after."""
    inst = instrument.expanded(name)
    steps = round(1.0 / STEP)
    controller = Controller(inst, law="robust", enabled=True)
    twin = Twin(inst, seed=1)
    trigger = [joint.name for joint in inst.handle_joints].index("trigger")
    closing = np.zeros((steps, len(inst.handle_joints)))
    closing[:, trigger] = np.radians(25) * np.clip(np.arange(steps) / steps * 2, 0, 1)
    jaw = inst.jaws[0]
    object_ = Held(opening=-0.5 * abs(inst.grip_arms[jaw]) * np.radians(15), stiffness=3e3, damping=1.0)
    gripped = twin.run(closing, held=object_, controller=controller)
    moving = commands(inst, state)[: round(4 / STEP)]
    moving[:, trigger] = closing[-1, trigger]
    moved = twin.run(moving, held=object_, controller=controller)
    start = float(gripped["grip_force"][-1])
    return start, float(moved["grip_force"].min() / start), float(moved["grip_force"].max() / start)

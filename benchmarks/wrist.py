"""The law on coupled wrists: final errors of all axes at once, pushes on the neighbour, the grip while the wrist moves.

    python benchmarks/wrist.py

A two-axis hybrid instrument, whose pitch tendons pass the yaw gears, has friction at every bend of every tendon. Its
handle goes to a state and stays; then a force in any direction comes. The controller is told friction that is up to
30 % wrong. Errors are those of both angles over the last half second, against the unloaded instrument without friction.
"""

import itertools
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.control.controller import fault_names

STATES = ((0, 0), (33, 33), (67, 0), (0, 67), (67, -33), (80, 80), (-80, 67))
"""Yaw and pitch, deg."""
FORCES = {"hybrid-real-size": 0.3, "hybrid-scaled-up": 1.0}
"""Size of the force at the tip, N."""
DIRECTIONS = ((1, 0, 0), (0, -1, 0), (-0.7, 0.7, 0), (0.6, 0.5, -0.6))
FRICTION = (0.7, 1.0, 1.3)
"""Friction of the instrument over what the controller is told."""
STEP = 5e-4
ARRIVED, LOADED, END = 1.0, 2.0, 7.0
"""When the handle has arrived, when the force comes, and the end, s."""


@dataclass(frozen=True)
class Case:
    """A run: errors of yaw and pitch (deg) and the larger speed of their motors (rad/s), each (samples, 2)."""

    state: tuple[float, float]
    direction: tuple[float, float, float]
    friction: float
    error: np.ndarray
    winding: np.ndarray
    faults: tuple[str, ...]

    @property
    def final(self) -> np.ndarray:
        """Errors over the last half second."""
        return self.error[-round(0.5 / STEP) :]


def true_instrument(name: str, friction: float) -> tn.coupled.CoupledInstrument:
    """The instrument with friction so many times as strong as in its file."""
    inst = tn.coupled.load(name)
    table = inst.friction.model_dump(exclude_none=True)
    for key in ("vertex_coefficient", "sheath_coefficient"):
        table[key] *= friction
    return inst.replace(friction=table)


def commands(inst: tn.coupled.CoupledInstrument, state: tuple[float, float]) -> np.ndarray:
    """Handle angles that lead to a state, (steps, handle joints), rad; the trigger stays."""
    time = np.arange(round(END / STEP)) * STEP
    share = np.clip(time / ARRIVED, 0, 1)
    angles = np.zeros((time.size, len(inst.handle_joints)))
    for axis, pair in tn.coupled.pairs(inst).items():
        planar = tn.coupled.compensated(inst).axis(axis)
        wanted = np.radians(state[list(tn.coupled.pairs(inst)).index(axis)])
        angle = float(tn.statics.handle_angle(planar, wanted))
        angles[:, pair.handle] = angle * share**2 * (3 - 2 * share)
    return angles


def run(
    name: str, state: tuple[float, float], direction: tuple[float, float, float], friction: float, law: str
) -> Case:
    """Run a state under a force, with the motors off or with the robust law."""
    told, inst = tn.coupled.load(name), true_instrument(name, friction)
    handle = commands(told, state)
    time = np.arange(len(handle)) * STEP
    wrench = np.zeros((len(handle), 6))
    wrench[:, :3] = FORCES[name] * np.asarray(direction) * np.clip((time[:, None] - LOADED) / 0.1, 0, 1)
    controller = None if law == "off" else Controller(tn.coupled.compensated(told), law=law, enabled=True)
    out = tn.coupled.Twin(inst, seed=1).run(handle, wrench, controller=controller)
    joints = [pair.joint for pair in tn.coupled.pairs(inst).values()]
    target = tn.coupled.output_angles(told, handle[-1])[joints]
    faults = fault_names(int(np.bitwise_or.reduce(out["faults"].astype(int).ravel()))) if controller else ()
    speeds = np.abs(out["commanded_spool_velocity"])
    own = [[pair.agonist, pair.antagonist] for pair in tn.coupled.pairs(inst).values()]
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
    inst = tn.coupled.load(name)
    steps = round(1.0 / STEP)
    controller = Controller(tn.coupled.compensated(inst), law="robust", enabled=True)
    twin = tn.coupled.Twin(inst, seed=1)
    trigger = [joint.name for joint in inst.handle_joints].index("trigger")
    closing = np.zeros((steps, len(inst.handle_joints)))
    closing[:, trigger] = np.radians(25) * np.clip(np.arange(steps) / steps * 2, 0, 1)
    jaw = inst.jaws[0]
    object_ = tn.coupled.Held(opening=-0.5 * abs(inst.grip_arms[jaw]) * np.radians(15), stiffness=3e3, damping=1.0)
    gripped = twin.run(closing, np.zeros((steps, 6)), held=object_, controller=controller)
    moving = commands(inst, state)[: round(4 / STEP)]
    moving[:, trigger] = closing[-1, trigger]
    moved = twin.run(moving, np.zeros((len(moving), 6)), held=object_, controller=controller)
    start = float(gripped["grip_force"][-1])
    return start, float(moved["grip_force"].min() / start), float(moved["grip_force"].max() / start)


def errors(final: np.ndarray) -> tuple[float, float]:
    """Root of the mean square and largest size."""
    return float(np.sqrt(np.mean(final**2))), float(np.abs(final).max())


def main(name: Annotated[str, typer.Option(help="Instrument, or all.")] = "all") -> None:
    """Print final errors, off and robust, of every instrument."""
    for one in FORCES if name == "all" else (name,):
        print(f"{one}, {FORCES[one]:g} N in {len(DIRECTIONS)} directions, friction 0.7, 1, 1.3 of what is told")
        print(f"{'yaw, pitch':>12}  {'off RMS':>8} {'worst':>6}  {'robust RMS':>10} {'worst':>6}  {'push':>5}  faults")
        whole: dict[str, list[np.ndarray]] = {"off": [], "robust": []}
        pushes = []
        for state in STATES:
            rows: dict[str, list[Case]] = {"off": [], "robust": []}
            for law, (direction, friction) in itertools.product(rows, itertools.product(DIRECTIONS, FRICTION)):
                rows[law].append(run(one, state, direction, friction, law))
            finals = {law: np.concatenate([case.final for case in cases]) for law, cases in rows.items()}
            faults = {fault for case in rows["robust"] for fault in case.faults}
            pushes.append(max(neighbour_push(case) for case in rows["robust"]))
            figures = [
                value for law in rows for value in (np.sqrt(np.mean(finals[law] ** 2)), np.abs(finals[law]).max())
            ]
            print(
                f"{state[0]:>6}, {state[1]:>4}  {figures[0]:>8.2f} {figures[1]:>6.2f}  {figures[2]:>10.2f} "
                f"{figures[3]:>6.2f}  {pushes[-1]:>5.2f}  {', '.join(sorted(faults)) or 'none'}"
            )
            for law, final in finals.items():
                whole[law].append(final)
        figures = [figure for parts in whole.values() for figure in errors(np.concatenate(parts))]
        print(
            f"{'all':>12}  {figures[0]:>8.2f} {figures[1]:>6.2f}  {figures[2]:>10.2f} {figures[3]:>6.2f}  "
            f"{max(pushes):>5.2f}  (targets 0.3 RMS, 0.7 worst, 0.3 push)"
        )
        start, least, most = grip_kept(one)
        print(f"grip of {start:.2f} N while the wrist moves: {least:.3f} to {most:.3f} of it (target 0.95 to 1.05)\n")


if __name__ == "__main__":
    typer.run(main)

"""The law on wrists: final errors of all axes at once, pushes on the neighbour, the grip while the wrist moves.

    python studies/wrist.py

A two-axis hybrid instrument, whose pitch tendons pass the yaw gears, has friction at every bend of every tendon. Its
handle goes to a state and stays; then a force comes. The controller assumes friction that is up to 30 % wrong. Errors
are those of both angles over the last half second, against the unloaded instrument without friction.
"""

from typing import Any

import figures
import law
import numpy as np
from numpy.typing import NDArray

from tenodesis import control, instrument, statics
from tenodesis.control import Controller
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.simulate.campaign import Column, Rows
from tenodesis.statics import chain
from tenodesis.twin import Held, Twin

Array = NDArray[np.float64]

STATES = ((0, 0), (33, 33), (67, 0), (0, 67), (67, -33), (80, 80), (-80, 67))
"""Yaw and pitch, deg."""
FORCES = {"hybrid-real-size": 0.3, "hybrid-scaled-up": 1.0}
"""Size of the force at the tip, N."""
DIRECTIONS = ((1, 0, 0), (0, -1, 0), (-0.7, 0.7, 0), (0.6, 0.5, -0.6))
LAWS = ("off", "robust")
STEP = 5e-4
ARRIVED, LOADED, END = 1.0, 2.0, 7.0
"""When the handle has arrived, when the force comes, and the end, s."""
LAST, STILL = 0.5, 1e-3  # s, rad/s


def true_instrument(name: str, friction: float) -> instrument.FullForm:
    """Return the instrument with friction so many times as strong as in its file."""
    inst = instrument.expanded(name)
    table = inst.friction.model_dump(exclude_none=True)
    return inst.replace(friction=table | {key: friction * table[key] for key in law.COEFFICIENTS})


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


def trial(
    name: str, state: tuple[float, float], direction: tuple[float, float, float], friction: float, law_name: str
) -> dict[str, Any]:
    """Run a state under a force, with the motors off or with the robust law: final errors, pushes, deg, and faults."""
    assumed, inst = instrument.expanded(name), true_instrument(name, friction)
    handle = commands(assumed, state)
    time = np.arange(len(handle)) * STEP
    wrench = np.zeros((len(handle), 6))
    wrench[:, :3] = FORCES[name] * np.asarray(direction) * np.clip((time[:, None] - LOADED) / 0.1, 0, 1)
    controller = None if law_name == "off" else Controller(assumed, law="robust", enabled=True)
    run = Twin(inst, seed=1).run(handle, wrench=wrench, controller=controller)
    pairs = control.pairs(inst).values()
    joints = [pair.joint for pair in pairs]
    error = np.degrees(run["output_angle"][:, joints] - chain.output_angles(assumed, handle[-1])[joints])
    final = error[-round(LAST / STEP) :]
    speeds = np.abs(run["commanded_spool_velocity"])
    winding = np.stack([speeds[:, [pair.agonist, pair.antagonist]].max(axis=1) for pair in pairs], axis=1)
    push = 0.0 if controller is None else neighbour_push(error, winding)
    return {"rms": campaign.rms(final), "worst": campaign.farthest(final), "push": push, "faults": law.faults(run)}


def neighbour_push(error: Array, winding: Array) -> float:
    """Largest movement of an axis, deg, while its own motors rest under the load and those of the other wind."""
    start = round((LOADED + 0.5) / STEP)
    moving, pushes = winding[start:] > STILL, [0.0]
    for axis in (0, 1):
        pushed = np.flatnonzero(moving[:, 1 - axis] & ~moving[:, axis])
        windows = np.split(pushed, np.flatnonzero(np.diff(pushed) > 1) + 1)
        pushes += [float(np.ptp(error[start:][window, axis])) for window in windows if window.size]
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

    def gripping(handle: Array) -> Run:
        return twin.run(handle, held=object_, controller=controller)

    start = float(gripping(closing)["grip_force"][-1])
    moving = commands(inst, state)[: round(4 / STEP)]
    moving[:, trigger] = closing[-1, trigger]
    force = gripping(moving)["grip_force"]
    return start, float(force.min() / start), float(force.max() / start)


def study(name: str, states: Any = STATES, laws: Any = LAWS, **how: Any) -> Rows:
    """Return the rows of an instrument over states, directions, friction and laws."""
    axes = {"name": [name], "state": states, "direction": DIRECTIONS, "friction": law.ASSUMED, "law_name": laws}
    return campaign.run(trial, campaign.cases(**axes), name, **how)


def main() -> None:
    parser = law.arguments(__doc__)
    parser.add_argument("--name", choices=[*FORCES], action="append", help="by default all")
    options = parser.parse_args()
    of = {own: (lambda rows, own=own: rows.where(law_name=own)) for own in LAWS}
    columns = [
        Column(f"{own} {heading}", lambda rows, own=own, key=key, over=over: over(of[own](rows)[key]))
        for own in LAWS
        for heading, key, over in (("RMS", "rms", campaign.rms), ("worst", "worst", np.max))
    ]
    columns += [
        Column("push", "push", np.max),
        Column("faults", "faults", lambda values: campaign.names(values) or "none", ""),
    ]
    for name in options.name or FORCES:
        print(f"{name}, {FORCES[name]:g} N in {len(DIRECTIONS)} directions, friction 0.7, 1, 1.3 of what is assumed")
        rows = study(name, results=options.results)
        groups = rows.by("state") | {("all", ""): rows}
        law.show(options, f"wrist_{figures.slug(name)}", groups, columns, ("yaw,", "pitch"))
        print("targets 0.3 RMS, 0.7 worst, 0.3 push")
        start, least, most = grip_kept(name)
        print(f"grip of {start:.2f} N while the wrist moves: {least:.3f} to {most:.3f} of it (target 0.95 to 1.05)\n")


if __name__ == "__main__":
    main()

"""What a backbone costs by its arcs, how far it is from the elastica, and MuJoCo on the same backbone in hinges.

One core, in one run: equilibria under loads across, steps of the twin with friction at every arc, and steps of the
model that is exported, without friction.
"""

from functools import partial
from timeit import repeat

import numpy as np
from peers import chain_dynamics, elastica

import tenodesis as tn
from tenodesis.instrument import FullForm, in_arcs
from tenodesis.statics import chain

POINTS, STEPS, ROUNDS, TIME_STEP = 20_000, 20_000, 5, 5e-4
FORCE = 1.0  # N, across
BACKBONE = elastica.Backbone(40e-3, 1e-3, 2e-3, 100e3, 20.0, 10e-3)


def backbone(arcs: int) -> FullForm:
    """Return a backbone between two tendons, with friction."""
    joint = {
        "name": "bend", "mechanism": "continuum", "axis": "yaw", "radius": BACKBONE.offset, "range": 1.5,
        "backbone_length": BACKBONE.length, "backbone_rigidity": BACKBONE.rigidity,
        "end_effector_length": BACKBONE.end_effector_length,
    }  # fmt: skip
    tendons = [{"name": side, "route": [{"joint": "bend", "side": side}]} for side in ("agonist", "antagonist")]
    like = tn.instrument.expanded("two-segment-continuum")
    stiff = {"tendon_stiffness": BACKBONE.stiffness, "pretension": BACKBONE.pretension}
    friction = {"law": "capstan", "vertex_coefficient": 0.1}
    return in_arcs(like.replace(joints=[joint], tendons=tendons, friction=friction, sources=None, **stiff), arcs)


def off(inst: FullForm) -> float:
    """Return how far the backbone's end is from where the elastica has it under the force, as a share of its length."""
    angles = chain.output_angles(inst, np.zeros(0), [FORCE, 0, 0, 0, 0, 0])
    middle = np.cumsum(angles) - angles / 2
    chords = BACKBONE.length / len(angles) * np.sinc(angles / (2 * np.pi))
    exact = elastica.tip(BACKBONE, (FORCE, 0.0), 0.0, (0.0, 0.0))
    return float(np.hypot(chords @ np.sin(middle) - exact.x, chords @ np.cos(middle) - exact.z) / BACKBONE.length)


def main() -> None:
    """Print a row for each number of arcs."""
    tn.set_threads(1)
    loads = np.zeros((POINTS, 6))
    loads[:, 0] = np.linspace(-FORCE, FORCE, POINTS)
    still, wrench = np.zeros((STEPS, 0)), np.zeros((STEPS, 6))
    wrench[:, 0] = FORCE * np.sin(2 * np.pi * TIME_STEP * np.arange(STEPS))
    print("  arcs  off the elastica  equilibrium [ns]  step [ns]  MuJoCo's step of the same in hinges [ns]  ratio")
    for arcs in (1, 2, 4, 8):
        inst = backbone(arcs)
        twin = tn.twin.Twin(inst, time_step=TIME_STEP)
        rests, moves = partial(chain.output_angles, inst, np.zeros(0), loads), partial(twin.run, still, wrench=wrench)
        solve = min(repeat(rests, number=1, repeat=ROUNDS)) / POINTS
        step = min(repeat(moves, number=1, repeat=ROUNDS)) / STEPS
        theirs = 1 / chain_dynamics.steps_per_second(inst, [FORCE, 0, 0, 0, 0, 0], time_step=TIME_STEP, seconds=0.5)
        print(
            f"  {arcs:4d}  {100 * off(inst):14.3f} %  {1e9 * solve:16.0f}  {1e9 * step:9.0f}  {1e9 * theirs:40.0f}  "
            f"{theirs / step:4.1f}x"
        )


if __name__ == "__main__":
    main()

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
FEW = 4  # tendons, of which two are in the plane of the force
BACKBONE = elastica.Backbone(40e-3, 1e-3, 2e-3, 100e3, 20.0, 10e-3)


def backbone(arcs: int, planes: int = 1, count: int = 2) -> FullForm:
    """Return a backbone between tendons at equal angles round it, with friction."""
    joint = {
        "name": "bend", "mechanism": "continuum", "axis": "yaw", "planes": planes, "radius": BACKBONE.offset,
        "range": 1.5, "backbone_length": BACKBONE.length, "backbone_rigidity": BACKBONE.rigidity,
        "end_effector_length": BACKBONE.end_effector_length,
    }  # fmt: skip
    tendons = [{"name": f"t{n}", "route": [{"joint": "bend", "angle": 2 * np.pi * n / count}]} for n in range(count)]
    like = tn.instrument.expanded("two-segment-continuum")
    stiff = {"tendon_stiffness": BACKBONE.stiffness, "pretension": BACKBONE.pretension}
    friction = {"law": "capstan", "vertex_coefficient": 0.1}
    return in_arcs(like.replace(joints=[joint], tendons=tendons, friction=friction, sources=None, **stiff), arcs)


def off(inst: FullForm) -> float:
    """Return how far the backbone's end is from where the elastica has it under the force, as a share of its length."""
    angles = chain.output_angles(inst, np.zeros(0), [FORCE, 0, 0, 0, 0, 0])[next(iter(inst.bends.values()))]
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
    print("  planes  tendons  arcs  off the elastica  equilibrium [ns]  step [ns]  MuJoCo's step in hinges [ns]  ratio")
    sizes = [(1, 2, arcs) for arcs in (1, 2, 4, 8)] + [(2, count, arcs) for count in (4, 6) for arcs in (1, 2, 4, 8)]
    for planes, count, arcs in sizes:
        inst = backbone(arcs, planes, count)
        twin = tn.twin.Twin(inst, time_step=TIME_STEP)
        rests, moves = partial(chain.output_angles, inst, np.zeros(0), loads), partial(twin.run, still, wrench=wrench)
        solve = min(repeat(rests, number=1, repeat=ROUNDS)) / POINTS
        step = min(repeat(moves, number=1, repeat=ROUNDS)) / STEPS
        theirs = 1 / chain_dynamics.steps_per_second(inst, [FORCE, 0, 0, 0, 0, 0], time_step=TIME_STEP, seconds=0.5)
        # Six tendons hold it more stiffly than the elastica's two.
        apart = f"{100 * off(inst):.3f} %" if count <= FEW else "-"
        print(
            f"  {planes:6d}  {count:7d}  {arcs:4d}  {apart:>16s}  {1e9 * solve:16.0f}  {1e9 * step:9.0f}  "
            f"{1e9 * theirs:28.0f}  {theirs / step:4.1f}x"
        )


if __name__ == "__main__":
    main()

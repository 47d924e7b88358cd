"""What a backbone costs by its arcs, how far it is from the elastica, and MuJoCo on the same backbone in hinges.

One core, in one run: equilibria under loads across, steps of the twin with friction at every arc, and steps of the
model that is exported, without friction. Instructions are counted by valgrind, in a process of its own. With
``--figures docs/results.json`` the table of docs/joints_and_tendons.md is written anew.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from timeit import repeat

import numpy as np
from peers import chain_dynamics, elastica

import tenodesis as tn
from tenodesis.instrument import FullForm, in_arcs
from tenodesis.statics import chain

sys.path.append(str(Path(__file__).parents[1] / "studies"))

import figures

POINTS, STEPS, ROUNDS, TIME_STEP = 20_000, 20_000, 5, 5e-4
FORCE = 1.0  # N, across
FEW = 4  # tendons, of which two are in the plane of the force
SIZES = [(arcs, 1, 2) for arcs in (1, 2, 4, 8)]
SIZES += [(arcs, planes, count) for planes, count in ((1, 4), (2, 4), (2, 6)) for arcs in (4, 8)] + [(16, 1, 2)]
COUNTED = (100, 400)
COLUMNS = (
    figures.Heading("off", "off the elastica", "% of length", ".3g"),
    figures.Heading("equilibrium", "an equilibrium", "ns", ".4g"),
    figures.Heading("equilibrium_instructions", "its instructions", "", ".4g"),
    figures.Heading("step", "a step", "ns", ".4g"),
    figures.Heading("step_instructions", "its instructions", "", ".4g"),
    figures.Heading("mujoco", "MuJoCo's step, in hinges", "ns", ".4g"),
    figures.Heading("ratio", "times ours", "", ".3g"),
)
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


def works(inst: FullForm) -> tuple[Callable[[int], object], Callable[[int], object]]:
    """Return what finds so many equilibria under loads across, and what takes so many steps of the twin."""

    def rests(points: int) -> object:
        loads = np.zeros((points, 6))
        loads[:, 0] = np.linspace(-FORCE, FORCE, points)
        return chain.output_angles(inst, np.zeros(0), loads)

    twin = tn.twin.Twin(inst, time_step=TIME_STEP)

    def moves(steps: int) -> object:
        wrench = np.zeros((steps, 6))
        wrench[:, 0] = FORCE * np.sin(2 * np.pi * TIME_STEP * np.arange(steps))
        return twin.run(np.zeros((steps, 0)), wrench=wrench)

    return rests, moves


def counting() -> None:
    """Run all works of all sizes twice, and have callgrind dump what each took."""

    def tell(*what: str) -> None:
        subprocess.run(["callgrind_control", *what, str(os.getpid())], check=True, stdout=subprocess.DEVNULL)

    for size in SIZES:
        for work in works(backbone(*size)):
            work(COUNTED[0])
            for count in COUNTED:
                tell("-i", "on")
                work(count)
                tell("-i", "off")
                tell("-d")


def instructions() -> list[int]:
    """Return the instructions of an equilibrium and of a step, of every size in turn."""
    with tempfile.TemporaryDirectory() as folder:
        valgrind = ["valgrind", "--tool=callgrind", "--instr-atstart=no", f"--callgrind-out-file={folder}/out"]
        subprocess.run([*valgrind, sys.executable, __file__, "--counting"], check=True, capture_output=True)
        dumps = sorted(Path(folder).glob("out.*"), key=lambda path: int(path.suffix[1:]))
        totals = [re.findall(r"^(?:totals|summary): (\d+)", path.read_text(), re.MULTILINE)[-1] for path in dumps]
    few, many = np.array(totals, float).reshape(-1, len(COUNTED))[: 2 * len(SIZES)].T
    return [round(one) for one in (many - few) / (COUNTED[1] - COUNTED[0])]


def main() -> None:
    """Print a row for each size."""
    parser = argparse.ArgumentParser()
    figures.arguments(parser)
    parser.add_argument("--counting", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    tn.set_threads(1)
    if given.counting:
        counting()
        return
    counted, rows = iter(instructions()), dict[str, list[float | None]]()
    print(figures.headed(COLUMNS))
    for arcs, planes, count in SIZES:
        inst = backbone(arcs, planes, count)
        rests, moves = works(inst)
        solve = min(repeat(partial(rests, POINTS), number=1, repeat=ROUNDS)) / POINTS
        step = min(repeat(partial(moves, STEPS), number=1, repeat=ROUNDS)) / STEPS
        theirs = 1 / chain_dynamics.steps_per_second(inst, [FORCE, 0, 0, 0, 0, 0], time_step=TIME_STEP, seconds=0.5)
        # Six tendons hold it more stiffly than the elastica's two.
        apart = 100 * off(inst) if count <= FEW else None
        name = f"{planes}, {count}, {arcs}"
        rows[name] = [apart, 1e9 * solve, next(counted), 1e9 * step, next(counted), 1e9 * theirs, theirs / step]
        print(f"{name}: {figures.shown(rows[name])}")
    if given.figures is not None:
        command = "python benchmarks/backbones.py --figures docs/results.json"
        figures.keep("backbones", figures.FigureTable(command, "planes, tendons, arcs", COLUMNS, rows), given.figures)


if __name__ == "__main__":
    main()

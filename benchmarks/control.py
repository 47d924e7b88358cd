"""What a tick of the controller costs on this PC, as a ratio against the twin's own step, and how well it controls.

Peer: one step of the twin of the same instrument, with full friction, drives and sensors, measured in the same run in
turns with the two together. What a microcontroller takes, ``make firmware`` counts.
"""

import argparse
import os
import time

import numpy as np
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.instrument import Instrument
from tenodesis.paper import campaign, step_response
from tenodesis.paper.context import Context
from tenodesis.twin import Twin

Array = NDArray[np.float64]

SEEDS = 20
CHUNK = 200  # ticks
ROUNDS = 5
BEFORE, AFTER = 4.0, 6.0  # s
TARGET = 1e-6  # s
OUTPUTS = (0.0, 33.0, 67.0, 80.0)  # deg, Fig. 15


def chunks(inst: Instrument, motion: step_response.HeldMotion, controller: Controller | None) -> Array:
    """Time that each chunk of a run takes, s, shape (chunks,)."""
    twin = Twin(inst, seed=1)
    taken = []
    for at in range(0, motion.force.size, CHUNK):
        part = slice(at, at + CHUNK)
        start = time.perf_counter()
        twin.run(motion.handle_angle[part], motion.force[part], controller=controller)
        taken.append(time.perf_counter() - start)
    return np.array(taken)


def overhead(inst: Instrument, controller: Controller | None) -> float:
    """Time that a call takes beside its steps, s: of a run of one step, in the median."""
    twin = Twin(inst)
    taken = []
    for _ in range(2000):
        start = time.perf_counter()
        twin.run(np.zeros(1), np.zeros(1), controller=controller)
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def ticks(inst: Instrument) -> None:
    """Compute time of a tick, by chunks: friction observer, robust law, watch and supervisor, over the runs of Fig. 15.

    A chunk's time is the least of several equal runs, since what others do on this PC is no part of it; with the
    controller less without it, less what the call itself takes, over the chunk's ticks.
    """
    print(f"{inst.name}, one axis, friction + robust + supervisor, double, ticks of 0.5 ms, chunks of {CHUNK}:")
    calls = overhead(inst, Controller(step_response.controller_model(inst))) - overhead(inst, None)
    for output in OUTPUTS:
        motion = step_response.held_motion(
            inst, float(np.radians(output)), step_response.step_force(inst), BEFORE, AFTER
        )
        alone, both = [], []
        for _ in range(ROUNDS):
            alone.append(chunks(inst, motion, None))
            both.append(chunks(inst, motion, Controller(step_response.controller_model(inst))))
        step = np.min(alone, axis=0) / CHUNK
        tick = (np.min(both, axis=0) - np.min(alone, axis=0) - calls) / CHUNK
        ratio = tick / step.mean()
        verdict = "reached" if np.median(tick) <= TARGET else "MISSED"
        print(
            f"  held at {output:<4g}° p50 {1e9 * np.median(tick):4.0f} ns   mean {1e9 * tick.mean():4.0f} ns   worst "
            f"{1e9 * tick.max():4.0f} ns   target p50 {1e9 * TARGET:g} ns {verdict}   over a step of the twin of "
            f"{1e9 * step.mean():.0f} ns: p50 {np.median(ratio):.2f}x   mean {ratio.mean():.2f}x   worst "
            f"{ratio.max():.2f}x"
        )


def accuracy(seeds: int) -> None:
    """The campaign of the bench report."""
    context = Context(tn.load("real-size"), tn.load("scaled-up"), is_paper=True)
    few = max(1, seeds // campaign.SEED_DIVISOR)
    print(f"the robust law over 4 states, friction errors of -30, 0 and +30 %, {seeds} seeds, {few} beyond the first:")
    for n, condition in enumerate(campaign.conditions(context)):
        start = time.perf_counter()
        trials = campaign.trials(condition, few if n else seeds)
        spent = time.perf_counter() - start
        print(f"  {condition.key.replace('_', ' ')}: {len(trials)} runs, {spent:.1f} s")
        for metric in campaign.METRICS:
            value = metric.of(trials)
            target = metric.aim(condition.inst)
            verdict = "" if target is None else f"   target {target:g} {'reached' if value <= target else 'MISSED'}"
            print(f"    {metric.heading:<28} {value:8.3f}{verdict}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=int(os.environ.get("SEEDS", SEEDS)), help="noise seeds")
    arguments = parser.parse_args()
    ticks(tn.load("scaled-up"))
    ticks(tn.load("real-size").axis("yaw"))
    accuracy(arguments.seeds)


if __name__ == "__main__":
    main()

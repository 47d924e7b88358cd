"""What a tick of the controller costs on this PC, as a ratio against the twin's own step.

Peer: one step of the twin of the same instrument, with full friction, drives and sensors, measured in the same run in
turns with the two together. What a microcontroller takes, ``make firmware`` counts.
"""

import time

import numpy as np
from numpy.typing import NDArray
from turns import judged

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.instrument import Instrument
from tenodesis.paper import step_response
from tenodesis.twin import Twin

Array = NDArray[np.float64]

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
        print(
            f"  held at {output:<4g}° p50 {1e9 * np.median(tick):4.0f} ns   mean {1e9 * tick.mean():4.0f} ns   "
            f"worst {1e9 * tick.max():4.0f} ns   p50 {judged(1e9 * np.median(tick), 1e9 * TARGET, ' ns', most=True)}   "
            f"over a step of the twin of {1e9 * step.mean():.0f} ns: p50 {np.median(ratio):.2f}x   "
            f"mean {ratio.mean():.2f}x   worst {ratio.max():.2f}x"
        )


if __name__ == "__main__":
    ticks(tn.load("scaled-up"))
    ticks(tn.load("real-size").axis("yaw"))

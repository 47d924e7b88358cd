"""How often 95 % intervals of coupling, play and offset hold the truth: joints from commands and angles alone.

    python studies/kinematic.py [--seeds 50]

Joints of a random coupling, play and offset, 60 s at 50 Hz with white noise of 0.06 degrees.
"""

import argparse

import numpy as np

from tenodesis.identification import Kinematic, fit, recorded
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.kinematic.model import ELEMENTS, LAWS
from tenodesis.run import Array

JOINTS = ("roll", "pitch", "yaw")
STEP = 0.02
"""s."""
NOISE = 1e-3
"""rad."""


def simulated(seed: int, law: str, *, samples: int = 3000, motion: int = 0) -> tuple[MeasuredRun, dict[str, float]]:
    """Return a recording of joints with a law, and their parameters; motions and noise of one seed are several."""
    draw, moves = np.random.default_rng(seed), np.random.default_rng([seed, motion])
    time: Array = np.linspace(0, STEP * (samples - 1), samples)
    command = {
        joint: sum(
            amplitude * np.sin(2 * np.pi * frequency * time + phase)
            for amplitude, frequency, phase in zip(
                moves.uniform(0.1, 0.5, 3), moves.uniform(0.03, 0.3, 3), moves.uniform(0, 6, 3), strict=True
            )
        )
        for joint in JOINTS
    }
    truth: dict[str, float] = {}
    angle: dict[str, Array] = {}
    for place, joint in enumerate(JOINTS):
        truth[f"offset.{joint}"] = draw.normal(0, 0.05)
        truth[f"gain.{joint}"] = draw.normal(1, 0.05)
        moved = truth[f"offset.{joint}"] + truth[f"gain.{joint}"] * command[joint]
        for other in JOINTS:
            if other != joint:
                truth[f"coupling.{joint}.{other}"] = draw.normal(0, 0.1)
                moved = moved + truth[f"coupling.{joint}.{other}"] * command[other]
        for other in JOINTS[:place] if law == "passed" else ():
            truth[f"follow.{joint}.{other}"] = draw.normal(0, 0.5)
            moved = moved + truth[f"follow.{joint}.{other}"] * (angle[other] - command[other])
        plays = np.zeros(1)
        if law != "none":
            truth[f"play.{joint}"] = draw.uniform(0.03, 0.15)
            plays = np.full(1, truth[f"play.{joint}"])
        if law == "soft":
            truth[f"softness.{joint}"] = draw.uniform(0.3, 0.8)
            plays = plays * (1 - truth[f"softness.{joint}"] * np.linspace(0, 1, ELEMENTS))
        angle[joint] = np.mean([_behind(moved, one / 2) for one in plays], axis=0)
    measured = {joint: one + moves.normal(0, NOISE, samples) for joint, one in angle.items()}
    return recorded(time, command, measured), truth


def _behind(moved: Array, half: float) -> Array:
    angle, found = moved[0], []
    for one in moved.tolist():
        angle = min(max(angle, one - half), one + half)
        found.append(angle)
    return np.array(found)


def main() -> None:
    """Print how many intervals hold the truth, by law and kind of parameter."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=50)
    seeds = parser.parse_args().seeds
    for law in LAWS[1:]:
        inside: dict[str, list[bool]] = {}
        for seed in range(seeds):
            run, truth = simulated(seed, law)
            found = fit(Kinematic([run], law=law), train=[0], starts=1)
            for name, (low, high) in found.interval_95.items():
                if name in truth:
                    inside.setdefault(name.partition(".")[0], []).append(low <= truth[name] <= high)
        every = [one for some in inside.values() for one in some]
        print(
            f"{law}: {100 * np.mean(every):.1f} % of {len(every)}",
            {k: round(float(np.mean(v)), 3) for k, v in inside.items()},
        )


if __name__ == "__main__":
    main()

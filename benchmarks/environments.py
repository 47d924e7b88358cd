"""Environment steps per second of many instruments, beside environments that do nothing, measured in the same run.

Peer: Gymnasium's own vector environment of as many empty ones.
"""

import argparse
from functools import partial
from timeit import timeit
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import SyncVectorEnv
from numpy.typing import NDArray

from tenodesis import gym
from tenodesis.twin import TIME_STEP

STEPS = 50
ROUNDS = 5

Observation = NDArray[np.float32]


class Empty(gymnasium.Env[Observation, Observation]):
    """An environment with the instrument's spaces that does nothing."""

    def __init__(self, like: gym.TendonVectorEnv) -> None:
        self.observation_space, self.action_space = like.single_observation_space, like.single_action_space
        self._observed = np.zeros(like.single_observation_space.shape or (), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode: an observation of zeros."""
        super().reset(seed=seed, options=options)
        return self._observed, {}

    def step(self, action: Observation) -> Any:
        """Do nothing."""
        return self._observed, 0.0, False, False, {}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--envs", type=int, default=4096)
    count = parser.parse_args().envs
    ours = gym.TendonVectorEnv(gym.randomised("scaled-up", 64), count)
    empty = SyncVectorEnv([partial(Empty, ours)] * count)
    speeds = []
    for many in (ours, empty):
        many.reset(seed=1)
        action = 0.02 * many.action_space.sample()
        speeds.append(max(STEPS * count / timeit(partial(many.step, action), number=STEPS) for _ in range(ROUNDS)))
    per_step = ours.task.period / TIME_STEP
    print(
        f"{count} instruments: {speeds[0] / 1e3:.0f} k environment steps/s ({per_step * speeds[0] / 1e6:.1f} M steps "
        f"of the twin), {speeds[0] / speeds[1]:.1f}x Gymnasium's own of empty environments ({speeds[1] / 1e3:.0f} k)"
    )


if __name__ == "__main__":
    main()

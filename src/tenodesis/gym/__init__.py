"""Environments for reinforcement learning, by Gymnasium's interfaces (extra ``gym``)."""

from tenodesis.extras import require

require("gymnasium", "gym")

from tenodesis.gym.environment import TendonEnv, TendonVectorEnv  # noqa: E402
from tenodesis.gym.episodes import Task, randomised  # noqa: E402

__all__ = ["Task", "TendonEnv", "TendonVectorEnv", "randomised"]


def __dir__() -> list[str]:
    return sorted(__all__)

"""From a scale model's plan to its parts: tolerances, order list, assembly and first run."""

from tenodesis.workshop.budget import Budget, Dimension, Spread, tolerate
from tenodesis.workshop.grades import Grade

__all__ = ["Budget", "Dimension", "Grade", "Spread", "tolerate"]


def __dir__() -> list[str]:
    return sorted(__all__)

"""Tip poses that other solvers compute, compared with the instrument at rest under the same tensions or strokes."""

from tenodesis.poses.comparison import Comparison, compare
from tenodesis.poses.reading import ReferencePoses, load
from tenodesis.poses.report import plot, write

__all__ = ["Comparison", "ReferencePoses", "compare", "load", "plot", "write"]


def __dir__() -> list[str]:
    return sorted(__all__)

"""Tip poses that other solvers compute, compared with the instrument at rest under the same tensions or strokes."""

from tenodesis.poses.comparison import PoseComparison, compare
from tenodesis.poses.reading import ReferencePoses, load
from tenodesis.poses.report import plot, write

__all__ = ["PoseComparison", "ReferencePoses", "compare", "load", "plot", "write"]


def __dir__() -> list[str]:
    return sorted(__all__)

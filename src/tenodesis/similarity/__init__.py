"""Similarity of two instruments: factors, dimensionless groups, the similarity error, and its causes.

The paper calls the real-size instrument the model and the scaled-up one the prototype; a factor is scaled-up over
real-size.
"""

from tenodesis.similarity.causes import Cause, Causes
from tenodesis.similarity.comparison import Comparison, compare
from tenodesis.similarity.frictionless import GRID, SimilarityError
from tenodesis.similarity.groups import Group, Kind
from tenodesis.similarity.joints import JointComparison, JointError, compare_joints
from tenodesis.similarity.loops import LoopError, LoopPoint

__all__ = [
    "GRID",
    "Cause",
    "Causes",
    "Comparison",
    "Group",
    "JointComparison",
    "JointError",
    "Kind",
    "LoopError",
    "LoopPoint",
    "SimilarityError",
    "compare",
    "compare_joints",
]


def __dir__() -> list[str]:
    return sorted(__all__)

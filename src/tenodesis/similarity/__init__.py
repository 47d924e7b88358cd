"""Similarity of two instruments: what scales how, which groups match, what the mismatch costs and what causes it.

The paper calls the small instrument the model and the large one the prototype; a factor is prototype over model.
"""

from tenodesis.similarity.causes import Cause, Causes
from tenodesis.similarity.comparison import Comparison, compare
from tenodesis.similarity.frictionless import GRID, SimilarityError
from tenodesis.similarity.groups import Group, Kind
from tenodesis.similarity.loops import LoopError, Place

__all__ = ["GRID", "Cause", "Causes", "Comparison", "Group", "Kind", "LoopError", "Place", "SimilarityError", "compare"]

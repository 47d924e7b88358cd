"""From a scale model's plan to its parts: tolerances, order list, assembly and first run."""

from tenodesis.workshop.budget import TARGET, Budget, Spread, TolerancedDimension, tolerate
from tenodesis.workshop.first_run import Demand, FirstRun, Reading, rehearse
from tenodesis.workshop.grades import Grade
from tenodesis.workshop.order import Item, RopeLength, Step, checklist, order_list, rope_lengths
from tenodesis.workshop.pack import FILES, Pack, prepare

__all__ = [
    "FILES",
    "TARGET",
    "Budget",
    "Demand",
    "FirstRun",
    "Grade",
    "Item",
    "Pack",
    "Reading",
    "RopeLength",
    "Spread",
    "Step",
    "TolerancedDimension",
    "checklist",
    "order_list",
    "prepare",
    "rehearse",
    "rope_lengths",
    "tolerate",
]


def __dir__() -> list[str]:
    return sorted(__all__)

"""The digital twin: a single twin in time, or many in parallel."""

from tenodesis.plant import TIME_STEP
from tenodesis.twin.batch import Batch, run_many
from tenodesis.twin.closed_loop import LoopController, SignalFault
from tenodesis.twin.commands import Held
from tenodesis.twin.contact import Contact, Side
from tenodesis.twin.twin import Energy, State, Twin

__all__ = [
    "TIME_STEP",
    "Batch",
    "Contact",
    "Energy",
    "Held",
    "LoopController",
    "Side",
    "SignalFault",
    "State",
    "Twin",
    "run_many",
]


def __dir__() -> list[str]:
    return sorted(__all__)

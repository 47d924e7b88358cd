"""The digital twin: one in time, or many side by side."""

from tenodesis.plant import TIME_STEP
from tenodesis.twin.batch import Batch, run_many
from tenodesis.twin.rows import as_run
from tenodesis.twin.twin import ClosesLoop, Energy, Injection, State, Twin

__all__ = ["TIME_STEP", "Batch", "ClosesLoop", "Energy", "Injection", "State", "Twin", "as_run", "run_many"]

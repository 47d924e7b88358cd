"""The bench: every figure and table of the paper for an instrument, as one report."""

from tenodesis.bench.run import BenchError, run

__all__ = ["BenchError", "run"]

"""Every figure and table of the paper, computed, checked and written as one report, and the campaigns beyond it."""

from tenodesis.paper.run import run

__all__ = ["run"]

"""Formats of recordings, one file each: all give a `MeasuredRun`, checked by what they share (`raw`, `table`)."""

from tenodesis.identification.formats.measured import MeasuredRun, Source, distinct_names, load_all

__all__ = ["MeasuredRun", "Source", "distinct_names", "load_all"]

"""Formats of recordings, one file each: all return a `MeasuredRun`, checked by common code (`measured`)."""

from tenodesis.identification.formats.measured import MeasuredRun, Source, distinct_names, load_all

__all__ = ["MeasuredRun", "Source", "distinct_names", "load_all"]

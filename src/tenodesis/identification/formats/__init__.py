"""Formats of recordings: one file each, all giving `Measured`."""

from tenodesis.identification.formats.measured import Measured, Source
from tenodesis.identification.formats.names import distinct_names, load_all

__all__ = ["Measured", "Source", "distinct_names", "load_all"]

"""Formats of recordings: one file each, all giving `Measured`."""

from tenodesis.identification.formats.measured import Measured, Source

__all__ = ["Measured", "Source"]

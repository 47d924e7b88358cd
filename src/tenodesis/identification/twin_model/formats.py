"""Recordings of an instrument, CSV and MCAP, with the instrument's twin as their model."""

from pathlib import Path

from tenodesis.identification.formats import csv
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.registry import Format
from tenodesis.identification.twin_model.arrangements import arrangements
from tenodesis.identification.twin_model.problem import DEFAULT_LAW, LAWS, problem


def _load_mcap(path: Path) -> InstrumentRun:
    from tenodesis.identification.formats import mcap  # noqa: PLC0415 - slow to load

    return mcap.load(path)


CSV = Format(csv.load, problem, LAWS, DEFAULT_LAW, arrangements=arrangements)
MCAP = Format(_load_mcap, problem, LAWS, DEFAULT_LAW, arrangements=arrangements)

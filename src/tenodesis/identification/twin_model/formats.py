"""Recordings of an instrument, CSV and MCAP, with its twin as their model, and its arrangements of contacts."""

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tenodesis.identification.formats import csv
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.registry import Arranged, Format
from tenodesis.identification.twin_model.problem import DEFAULT_LAW, LAWS, instrument_of, problem
from tenodesis.instrument import ShortForm
from tenodesis.instrument.compliance import compliance_shares

if TYPE_CHECKING:
    from tenodesis.recording.blocks import Progress

_FIRST_BASE_WRAP = 0.1
"""rad, at which the search for a base wrap begins."""
_COMPLIANCE = "handle_length_share"


def arrangements(
    runs: Sequence[MeasuredRun], *, law: str, instrument: ShortForm | None, fitted: Sequence[str]
) -> list[Arranged]:
    """Return the arrangements to compare, that of the instrument first.

    They are joints of one vertex and of two, without and with a base wrap, and with the compliance where it is and
    free; parameters that are `fitted` are so in all of them. Without friction there is nothing to arrange.

    Raises IdentificationError if no instrument is known.
    """
    inst = instrument_of(runs, instrument).planar[0]
    own = inst.friction
    found = [Arranged(_name(own.vertices_per_joint, wrapped=own.base_wrap > 0), inst)]
    if law == "none":
        return found
    for vertices, wrap, share in product((1, 2), (False, True), (False, True)):
        changes: dict[str, Any] = {}
        if vertices != own.vertices_per_joint:
            changes |= {"friction.vertices_per_joint": vertices, "friction.anchor_compliance_share": None}
        if wrap != (own.base_wrap > 0):
            changes["friction.base_wrap"] = _FIRST_BASE_WRAP if wrap else None
        unknowns = ("friction.base_wrap",) * (wrap and not own.base_wrap) + (_COMPLIANCE,) * share
        changed = inst.replace(**changes)
        known = not (changes or unknowns) or (share and _COMPLIANCE in fitted)
        if not known and compliance_shares(changed).stem > 0:
            found.append(Arranged(_name(vertices, wrapped=wrap, free=share), changed, unknowns))
    return found


def _name(vertices: int, *, wrapped: bool, free: bool = False) -> str:
    parts = ["one vertex a joint" if vertices == 1 else "two vertices a joint"]
    return ", ".join(parts + ["base wrap"] * wrapped + ["free compliance"] * free)


def _load_mcap(path: Path, progress: "Progress | None" = None) -> InstrumentRun:
    from tenodesis.identification.formats import mcap  # noqa: PLC0415 - slow to load

    return mcap.load(path, progress)


def _load(path: Path, progress: "Progress | None" = None) -> InstrumentRun:
    """Return a recording of any kind, as its content shows."""
    from tenodesis.identification.formats import mcap  # noqa: PLC0415 - slow to load
    from tenodesis.recording import lab_map, lab_tables  # noqa: PLC0415 - slow to load

    recorded = (path.is_dir() or mcap.is_sqlite(path)) and lab_map.map_beside(path) is None
    return mcap.load(path, progress) if recorded or not lab_tables.is_table(path) else csv.load(path)


RECORDING = Format(_load, problem, LAWS, DEFAULT_LAW, arrangements=arrangements, shows_progress=True)
CSV = Format(csv.load, problem, LAWS, DEFAULT_LAW, arrangements=arrangements)
MCAP = Format(_load_mcap, problem, LAWS, DEFAULT_LAW, arrangements=arrangements, shows_progress=True)

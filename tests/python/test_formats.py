"""Claims about what loaders accept, repair, note and refuse: the checks that all formats share, on one of them."""

import math
import os
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS
from tenodesis.identification.datasets import davinci_tool, tendon_sheath
from tenodesis.identification.datasets.davinci_tool import JAW_COUNTS, SPINDLE_COUNTS, TORQUE_PER_COUNT, load
from tenodesis.identification.formats import distinct_names, load_all
from tenodesis.identification.formats.csv import read_rows
from tenodesis.identification.formats.measured import Raw, Source, Unit
from tenodesis.run import Array

from .conftest import refused
from .dataset_files import JAW, JAW_TORQUE, SAMPLES, SPINDLE, TIME, TORQUE, said, table, write

DATA = Path(os.environ.get("TENODESIS_DATA", Path(__file__).parents[3] / "shared" / "data"))


def test_counts_become_radians_and_newton_metres(tmp_path: Path) -> None:
    rows = table()
    run = load(write(tmp_path, rows))
    assert len(run) == SAMPLES
    assert run.sample_time == pytest.approx(1e-3, rel=1e-9)
    assert run["spindle_angle"] == pytest.approx(rows[:, SPINDLE] * 2 * math.pi / SPINDLE_COUNTS, rel=1e-12)
    assert run["jaw_angle"] == pytest.approx(rows[:, JAW] * 2 * math.pi / JAW_COUNTS, rel=1e-12)
    assert run["spindle_torque"] == pytest.approx(rows[:, TORQUE] * TORQUE_PER_COUNT, rel=1e-12)
    assert run["jaw_torque"] == pytest.approx(rows[:, JAW_TORQUE] * TORQUE_PER_COUNT, rel=1e-12)


def test_a_source_is_that_of_published_files_only(tmp_path: Path) -> None:
    run = load(write(tmp_path, table()))
    place = "MRDLab/mis-tool-characterization at 03658b2cce"
    assert run.notes == (
        f"none of the {len(davinci_tool.SOURCE.checksums)} files of {place} whose checksums are known here: another "
        "file of it, another recording, or a changed one",
    )
    assert run.source is None
    known = Source("owner/name", "0123456789ab", "data", "ODbL 1.0", "", {"a.txt": run.checksum})
    assert known.published(run.checksum) == "a.txt"
    assert known.note(run.checksum) == "as published: data/a.txt of owner/name at 0123456789; licence: ODbL 1.0"
    own = Raw("b.txt", [0.0], {"x": [1.0]})
    assert own.done(known, run.checksum).source is known
    assert own.done(known, "other").source is None


@pytest.mark.data
def test_a_published_file_is_known_by_its_bytes_not_by_its_name(tmp_path: Path) -> None:
    published = DATA / "tendon-sheath" / "2024-01-08-loadcells.csv"
    if not published.is_file():
        pytest.skip(f"no measured tensions at {published}: set TENODESIS_DATA to the folder that holds tendon-sheath/")
    text = published.read_bytes()
    same, changed = tmp_path / "same.csv", tmp_path / published.name
    same.write_bytes(text)
    changed.write_bytes(text.rstrip() + b"\n\n")
    run, other = FORMATS["tendon-sheath"].load(same), FORMATS["tendon-sheath"].load(changed)
    assert run.source is tendon_sheath.SOURCE
    assert run.notes[0].startswith("as published: test_mhe/loadcell_measurements.csv of jerluenn/RAL2024-GIRAFFE")
    assert other.source is None
    assert other.notes[0].startswith("none of the ")
    assert "jerluenn/RAL2024-GIRAFFE" in other.notes[0]


def test_rows_that_cannot_be_read_or_are_corrupt_are_dropped_and_said(tmp_path: Path) -> None:
    rows = table()
    rows[1000, SPINDLE] = 31000  # beyond what the spindle can reach
    rows[1500, JAW] += 400  # a jump
    rows[2000, TORQUE] += 8000
    run = load(write(tmp_path, rows, extra=[(100, "0.1,12"), (200, "0.2,x,1,1,1,1,1,1,1,1"), (300, "garbage")]))
    assert len(run) == SAMPLES - 3
    warnings = said(run)
    assert "dropped 3 rows: not numbers in every column" in warnings
    assert "dropped 1 row: corrupt (the spindle over 1500 counts, 65.9 deg, off its median), first at 1 s" in warnings
    assert "dropped 1 row: outliers of jaw_angle" in warnings
    assert "dropped 1 row: outliers of spindle_torque" in warnings


ROWS = table()
ALL = slice(None)
Edits: TypeAlias = tuple[tuple[Any, int | list[int], Any], ...]
"""Rows, columns and what their values become."""


def edited(edits: Edits) -> Array:
    rows = ROWS.copy()
    for at, column, values in edits:
        rows[at, column] = values
    return rows


@pytest.mark.parametrize(
    ("edits", "lost", "note"),
    [
        (((ALL, SPINDLE, ROWS[:, SPINDLE] + 3000), (1000, SPINDLE, 700)), 1, "corrupt (the spindle over 1500 counts, "),
        (((ALL, JAW_TORQUE, -1000), (77, JAW_TORQUE, 30000)), 0, ""),
        (((0, JAW, ROWS[0, JAW] + 400), (-1, TORQUE, -9000)), 2, "outliers of jaw_angle (over 0.0873 off the rows "),
        (((slice(500), SPINDLE, ROWS[:, SPINDLE].max()),), 0, ""),
        (((ALL, TIME, 1e3 * ROWS[:, TIME]), (50, TIME, 10.0)), 1, "ran back or stood still), first at time 10"),
    ],
)  # fmt: skip
def test_bad_rows_alone_are_dropped_and_said(tmp_path: Path, edits: Edits, lost: int, note: str) -> None:
    run = load(write(tmp_path, edited(edits)))
    assert len(run) == SAMPLES - lost
    assert (np.diff(run.time) > 0).all()
    assert note in said(run)


@pytest.mark.parametrize(
    ("edits", "key", "allowed", "sentence"),
    [
        (((ALL, SPINDLE, 700), (5, SPINDLE, 1200)), "spindle_angle", "at least", "no excitation: spindle_angle moves"),
        (((slice(None, None, 25), SPINDLE, 31000),), "rows", "at most 2 %", "run.TXT: 160 of 4000 rows are corrupt "),
        (((ALL, SPINDLE, 0.7654321 * ROWS[:, SPINDLE]),), "spindle_angle", "in one unit", "spindle_angle (fractions "),
        (((slice(2000, None), TIME, ROWS[2000:, TIME] - 1),), "time", "at most 1 %", "are out of order (the clock ran"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_refused_and_says_why(
    tmp_path: Path, edits: Edits, key: str, allowed: str, sentence: str
) -> None:
    with refused(key, kind=IdentificationError) as problem:
        load(write(tmp_path, edited(edits)))
    assert problem.value.allowed.startswith(allowed)
    assert sentence in str(problem.value)


def test_columns_that_a_loader_checks_itself_are_refused_by_name(tmp_path: Path) -> None:
    with refused("columns", "tip", kind=IdentificationError):
        load(write(tmp_path, ROWS))["tip"]
    with refused("samples", 50, kind=IdentificationError):
        load(write(tmp_path, ROWS[:50]))
    units = (Unit("kN", 1e3, 1e-3, 1e-2), Unit("N", 1.0, 1, 10), Unit("gf", 9.80665e-3, 1, 1000))
    with refused("x", ["N", "gf"], kind=IdentificationError):
        Raw("two", np.arange(300), {"x": np.linspace(0, 5.5, 300)}).unit(units, "x")
    with refused("time", 4e9, kind=IdentificationError):
        Raw("slow", 4e9 * np.arange(300), {"x": np.arange(300)}).clock()
    with refused("x", 0, kind=IdentificationError) as problem:
        Raw("still", np.arange(300), {"x": np.full(300, 2.0)}).excited("x", 1.0, "N")
    assert problem.value.allowed == "at least 1 N"


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_angles_in_another_unit_are_found_by_magnitude_and_said(tmp_path: Path, unit: str) -> None:
    rows = table()
    right = load(write(tmp_path, rows))
    turn = 2 * math.pi if unit == "rad" else 360.0
    rows[:, SPINDLE] *= turn / SPINDLE_COUNTS
    rows[:, JAW] *= turn / JAW_COUNTS
    run = load(write(tmp_path, rows))
    assert f"spindle_angle taken as {unit}, not counts: its values have a spread of" in said(run)
    assert f"jaw_angle taken as {unit}, not counts" in said(run)
    for column in ("spindle_angle", "jaw_angle"):
        assert run[column] == pytest.approx(right[column], abs=1e-5)


@pytest.mark.parametrize(("unit", "scale"), [("N*m", 1.0), ("mN*m", 1e3)])
def test_torques_in_another_unit_are_found_by_magnitude_and_said(tmp_path: Path, unit: str, scale: float) -> None:
    rows = table()
    right = load(write(tmp_path, rows))
    rows[:, [TORQUE, JAW_TORQUE]] *= TORQUE_PER_COUNT * scale
    run = load(write(tmp_path, rows))
    assert f"spindle_torque and jaw_torque taken as {unit}, not counts" in said(run)
    assert run["spindle_torque"] == pytest.approx(right["spindle_torque"], abs=1e-6)


def test_time_in_milliseconds_is_found_by_its_interval_and_said(tmp_path: Path) -> None:
    rows = table()
    rows[:, TIME] *= 1e3
    run = load(write(tmp_path, rows))
    assert "time taken as ms: its rows are 1 apart" in said(run)
    assert run.sample_time == pytest.approx(1e-3)


def test_a_sensor_that_holds_every_value_is_not_called_saturated_where_it_holds_its_highest() -> None:
    steps = np.repeat([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0], 50)
    raw = Raw("coarse", 0.01 * np.arange(350), {"x": steps})
    raw.saturated("x")
    assert raw.notes == []
    raw = Raw("slack", 0.01 * np.arange(350), {"x": np.maximum(np.sin(0.1 * np.arange(350)), 0)})
    raw.saturated("x", may_rest_at_zero=True)
    assert raw.notes == []
    raw = Raw("stuck", 0.01 * np.arange(999), {"x": np.clip(np.sin(0.05 * np.arange(999)), 0, 0.999999)})
    with refused("x", kind=IdentificationError):
        raw.saturated("x")


def test_a_byte_order_mark_costs_no_row(tmp_path: Path) -> None:
    path = write(tmp_path, table())
    path.write_bytes(b"\xef\xbb\xbf" + b"\n".join(path.read_bytes().split(b"\n")[2:]))
    assert len(load(path)) == SAMPLES


def test_a_file_that_is_missing_or_something_else_is_refused(tmp_path: Path) -> None:
    with refused("path", tmp_path / "none.TXT", kind=IdentificationError):
        load(tmp_path / "none.TXT")
    other = tmp_path / "other.txt"
    for text in (b"hello\nworld\n", b"", bytes(range(256)) * 50):
        other.write_bytes(text)
        with refused("path", other, kind=IdentificationError):
            load(other)


def test_white_space_and_header_lines_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "plain.txt"
    path.write_text("time a\n0 1\n1 2 9\n\n2\n")
    assert read_rows(path, 2, delimiter=None, comment=None, skip=1) == pytest.approx(
        np.array([[0, 1], [1, 2], [np.nan, np.nan]]), nan_ok=True
    )


# --- names -------------------------------------------------------------------------------------------------------


def test_files_of_one_name_are_told_apart_by_as_few_folders_as_needed(tmp_path: Path) -> None:
    paths = ["a/x/run.csv", "b/x/run.csv", "b/other.csv", "b/y/run.csv"]
    assert distinct_names([tmp_path / path for path in paths]) == [
        "a/x/run.csv",
        "b/x/run.csv",
        "other.csv",
        "y/run.csv",
    ]
    assert distinct_names([Path("one/run.csv"), Path("run.csv")]) == ["one/run.csv", f"{Path.cwd().name}/run.csv"]
    assert distinct_names([Path(), Path("run.csv")]) == [Path.cwd().name, "run.csv"]
    assert distinct_names([Path("run.csv"), Path("run.csv")])[0].endswith("run.csv")


def test_recordings_and_what_is_refused_bear_their_distinct_names(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("monday", "tuesday")]
    for folder in folders:
        folder.mkdir()
        write(folder, table())
    paths = [folder / "run.TXT" for folder in folders]
    assert [one.name for one in load_all(load, paths)] == ["monday/run.TXT", "tuesday/run.TXT"]
    write(folders[1], table()[:50])
    with refused("samples", 50, kind=IdentificationError) as problem:
        load_all(load, paths)
    assert str(problem.value).startswith("tuesday/run.TXT: ")

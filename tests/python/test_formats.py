"""Claims about what loaders accept, repair, note and refuse: the checks that all formats share, on one of them."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS
from tenodesis.identification.datasets import tendon_sheath
from tenodesis.identification.datasets.davinci_tool import JAW_COUNTS, SPINDLE_COUNTS, TORQUE_PER_COUNT, load
from tenodesis.identification.formats import distinct_names, load_all
from tenodesis.identification.formats.csv import read_rows
from tenodesis.identification.formats.measured import Raw, Source, Unit

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
    assert run.notes == (f"none of the files published in {place}: another recording, or a changed one",)
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
    assert other.notes[0].startswith("none of the files published in jerluenn/RAL2024-GIRAFFE")


def test_an_unknown_column_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match=r"no column 'tip'; it has spindle_angle, spindle_torque"):
        load(write(tmp_path, table()))["tip"]


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


def test_another_tools_encoder_may_be_zero_elsewhere(tmp_path: Path) -> None:
    rows = table()
    rows[:, SPINDLE] += 3000
    rows[1000, SPINDLE] = 700
    run = load(write(tmp_path, rows))
    assert len(run) == SAMPLES - 1
    assert "corrupt (the spindle over 1500 counts, 65.9 deg, off its median)" in said(run)


def test_a_constant_torque_at_the_jaw_is_no_fault(tmp_path: Path) -> None:
    rows = table()
    rows[:, JAW_TORQUE] = -1000
    rows[77, JAW_TORQUE] = 30000
    assert len(load(write(tmp_path, rows))) == SAMPLES


def test_outliers_at_either_end_are_dropped_too(tmp_path: Path) -> None:
    rows = table()
    rows[0, JAW] += 400
    rows[-1, TORQUE] -= 9000
    run = load(write(tmp_path, rows))
    assert len(run) == SAMPLES - 2
    assert "outliers of jaw_angle (over 0.0873 off the rows around them), first at 0 s" in said(run)


def test_one_spike_is_no_excitation(tmp_path: Path) -> None:
    rows = table()
    rows[:, SPINDLE] = 700
    rows[5, SPINDLE] = 1200
    with pytest.raises(IdentificationError, match="no excitation: spindle_angle moves by 0"):
        load(write(tmp_path, rows))


def test_too_many_corrupt_rows_are_refused(tmp_path: Path) -> None:
    rows = table()
    rows[::25, SPINDLE] = 31000
    with pytest.raises(IdentificationError, match=r"run.TXT: 160 of 4000 rows are corrupt .* at most 2 % may be"):
        load(write(tmp_path, rows))


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


def test_units_that_fit_nothing_or_two_things_are_refused(tmp_path: Path) -> None:
    rows = table()
    rows[:, SPINDLE] *= 0.7654321  # fractions, and too large for radians or degrees
    with pytest.raises(IdentificationError, match=r"spindle_angle \(fractions with a spread of .*\) fits no unit"):
        load(write(tmp_path, rows))
    raw = Raw("two", np.arange(300), {"x": np.linspace(0, 5.5, 300)})
    with pytest.raises(IdentificationError, match=r"two: x .* may be N or gf; a spread may be 0.001 to"):
        raw.unit((Unit("kN", 1e3, 1e-3, 1e-2), Unit("N", 1.0, 1, 10), Unit("gf", 9.80665e-3, 1, 1000)), "x")


def test_a_clock_that_runs_back_once_loses_the_rows_out_of_order(tmp_path: Path) -> None:
    rows = table()
    rows[2000:2010, TIME] -= 0.5
    rows[3000, TIME] += 100.0  # and one that leaps ahead
    run = load(write(tmp_path, rows))
    assert len(run) == SAMPLES - 11
    assert (np.diff(run.time) > 0).all()
    assert "dropped 11 rows: out of order (the clock ran back or stood still)" in said(run)


def test_a_clock_that_starts_again_is_refused(tmp_path: Path) -> None:
    rows = table()
    rows[2000:, TIME] -= 1.0
    with pytest.raises(IdentificationError, match=r"rows are out of order \(the clock ran back or stood still\)"):
        load(write(tmp_path, rows))


def test_a_time_that_is_no_clock_is_refused(tmp_path: Path) -> None:
    rows = table()
    rows[:, TIME] = 0.0
    with pytest.raises(IdentificationError, match=r"out of order|no clock"):
        load(write(tmp_path, rows))
    raw = Raw("slow", 4e9 * np.arange(300), {"x": np.arange(300)})
    with pytest.raises(IdentificationError, match=r"slow: time rises by 4e\+09 a row \(median\), which is no clock"):
        raw.clock()


def test_duplicated_samples_are_dropped_however_many(tmp_path: Path) -> None:
    rows = np.repeat(table(), 3, axis=0)
    run = load(write(tmp_path, rows))
    assert len(run) == SAMPLES
    assert "dropped 8000 rows: duplicates of the row before" in said(run)


def test_gaps_are_said_and_too_many_refused(tmp_path: Path) -> None:
    rows = table()
    run = load(write(tmp_path, np.delete(rows, np.s_[1000:1200], axis=0)))
    assert "1 gap of 0.201 s together in 4 s, first at 0.999 s" in said(run)
    with pytest.raises(IdentificationError, match=r"at most 20 % may be missing"):
        load(write(tmp_path, np.delete(rows, np.s_[1000:2500], axis=0)))


def test_a_saturated_torque_sensor_loses_its_rows_or_is_refused(tmp_path: Path) -> None:
    rows = table()
    rows[1000:1300, TORQUE] += 3000 * np.sin(math.pi * np.arange(300) / 300)
    rows[:, TORQUE] = np.minimum(np.round(rows[:, TORQUE]), np.sort(rows[:, TORQUE])[-120])
    run = load(write(tmp_path, rows))
    assert "saturated: spindle_torque stays at its extreme" in said(run)
    assert 20 <= SAMPLES - len(run) <= 120
    rows[:, TORQUE] = np.minimum(rows[:, TORQUE], 1600)
    with pytest.raises(IdentificationError, match=r"rows are saturated: spindle_torque .* at most 5 % may be"):
        load(write(tmp_path, rows))


def test_an_encoder_at_rest_is_not_called_saturated(tmp_path: Path) -> None:
    rows = table()
    rows[:500, SPINDLE] = rows[:, SPINDLE].max()
    assert len(load(write(tmp_path, rows))) == SAMPLES


def test_a_sensor_that_holds_every_value_is_not_called_saturated_where_it_holds_its_highest() -> None:
    steps = np.repeat([0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0], 50)
    raw = Raw("coarse", 0.01 * np.arange(350), {"x": steps})
    raw.saturated("x")
    assert raw.notes == []
    raw = Raw("slack", 0.01 * np.arange(350), {"x": np.maximum(np.sin(0.1 * np.arange(350)), 0)})
    raw.saturated("x", may_rest_at_zero=True)
    assert raw.notes == []
    raw = Raw("stuck", 0.01 * np.arange(999), {"x": np.clip(np.sin(0.05 * np.arange(999)), 0, 0.999999)})
    with pytest.raises(IdentificationError, match="rows are saturated: x stays at its extreme"):
        raw.saturated("x")


def test_where_a_clock_is_not_yet_known_its_number_is_said_without_a_unit(tmp_path: Path) -> None:
    rows = table()
    rows[:, TIME] *= 1e3
    rows[50, TIME] = rows[10, TIME]
    assert "out of order (the clock ran back or stood still), first at time 10" in said(load(write(tmp_path, rows)))


def test_a_column_with_missing_values_is_named(tmp_path: Path) -> None:
    rows = table()
    rows[200, JAW] = np.nan
    assert "dropped 1 row: not numbers in every column (jaw_angle), first at time 0.2" in said(
        load(write(tmp_path, rows))
    )


def test_a_byte_order_mark_costs_no_row(tmp_path: Path) -> None:
    path = write(tmp_path, table())
    path.write_bytes(b"\xef\xbb\xbf" + b"\n".join(path.read_bytes().split(b"\n")[2:]))
    assert len(load(path)) == SAMPLES


def test_too_few_samples_are_refused(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match=r"run.TXT: 50 samples are left, which is too few; at least 200"):
        load(write(tmp_path, table()[:50]))


@pytest.mark.parametrize(
    ("column", "name"), [(SPINDLE, "spindle_angle"), (JAW, "jaw_angle"), (TORQUE, "spindle_torque")]
)
@pytest.mark.parametrize("still", [0.0, 1.0])
def test_a_recording_without_excitation_is_refused_with_the_reason(
    tmp_path: Path, column: int, name: str, still: float
) -> None:
    rows = table()
    rows[:, column] = 700 + still * (np.arange(SAMPLES) % 3)
    with pytest.raises(IdentificationError, match=rf"run.TXT: no excitation: {name} moves by"):
        load(write(tmp_path, rows))


def test_a_file_that_is_missing_or_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match=r"none.TXT cannot be read: No such file"):
        load(tmp_path / "none.TXT")
    other = tmp_path / "other.txt"
    other.write_text("hello\nworld\n")
    with pytest.raises(IdentificationError, match=r"other.txt has no row of 10 numbers"):
        load(other)
    other.write_text("")
    with pytest.raises(IdentificationError, match=r"other.txt has no row of 10 numbers"):
        load(other)
    other.write_bytes(bytes(range(256)) * 50)
    with pytest.raises(IdentificationError, match=r"other.txt has no row of 10 numbers"):
        load(other)


def test_white_space_and_header_lines_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "plain.txt"
    path.write_text("time a\n0 1\n1 2 9\n\n2\n")
    assert read_rows(path, 2, delimiter=None, comment=None, skip=1) == pytest.approx(
        np.array([[0, 1], [1, 2], [np.nan, np.nan]]), nan_ok=True
    )


def test_excitation_is_asked_for_in_si() -> None:
    raw = Raw("still", np.arange(300), {"x": np.full(300, 2.0)})
    with pytest.raises(IdentificationError, match=r"still: no excitation: x moves by 0 N, and at least 1 N is needed"):
        raw.excited("x", 1.0, "N")


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
    with pytest.raises(IdentificationError, match=r"^tuesday/run.TXT: 50 samples are left"):
        load_all(load, paths)

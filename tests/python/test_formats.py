"""Claims about what loaders accept, repair, say and refuse: the checks all share, and those of three formats."""

import math
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS
from tenodesis.identification.datasets import endoscope_pair, tendon_sheath
from tenodesis.identification.datasets.davinci_tool import JAW_COUNTS, SPINDLE_COUNTS, TORQUE_PER_COUNT, load
from tenodesis.identification.formats import distinct_names, load_all
from tenodesis.identification.formats.measured import MeasuredRun, Source
from tenodesis.identification.formats.raw import GRAM_FORCE, Raw, Unit
from tenodesis.identification.formats.table import read_rows
from tenodesis.run import Array

TIME, SPINDLE, TORQUE, JAW, JAW_TORQUE = 0, 1, 2, 4, 5
SAMPLES = 4000
DATA = Path(os.environ.get("TENODESIS_DATA", Path(__file__).parents[3] / "shared" / "data"))


def table() -> Array:
    """Return rows as the bench writes them: a slow sine of 30 degrees at 1 kHz, in counts."""
    time = 0.001 * np.arange(SAMPLES)
    angle = 30 * np.cos(2 * math.pi * 0.4 * time)
    noise = np.random.default_rng(3)
    rows = np.zeros((SAMPLES, 10))
    rows[:, TIME] = time
    rows[:, SPINDLE] = np.round((30 + angle) / 360 * SPINDLE_COUNTS)
    rows[:, TORQUE] = np.round(1500 + 900 * np.sin(2 * math.pi * 0.4 * time) + noise.normal(0, 8, SAMPLES))
    rows[:, JAW] = np.round((40 - angle) / 360 * JAW_COUNTS)
    rows[:, JAW_TORQUE] = np.round(-1000 + 100 * np.sin(2 * math.pi * 0.4 * time) + noise.normal(0, 8, SAMPLES))
    return rows


def write(folder: Path, rows: Array, *, extra: Sequence[tuple[int, str]] = ()) -> Path:
    """Write rows in the bench's format, with lines of text put in before some of them."""
    lines = [",".join(f"{value:.6g}" if column else f"{value:.6f}" for column, value in enumerate(row)) for row in rows]
    for at, line in sorted(extra, reverse=True):
        lines.insert(at, line)
    path = folder / "run.TXT"
    path.write_text("% a header\n%more of it\n" + "\n".join(lines) + "\n")
    return path


def said(measured: MeasuredRun) -> str:
    return "; ".join(measured.notes)


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
    told = said(run)
    assert "dropped 3 rows: not numbers in every column" in told
    assert "dropped 1 row: corrupt (the spindle over 1500 counts, 65.9 deg, off its median), first at 1 s" in told
    assert "dropped 1 row: outliers of jaw_angle" in told
    assert "dropped 1 row: outliers of spindle_torque" in told


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


# --- pair of sheathed tendons ------------------------------------------------------------------------------------

COMMAND, OUTPUT, AGONIST, ANTAGONIST = 1, 3, 4, 5
HELD = 4


def pair(samples: int = 500) -> Array:
    """Return rows as the manipulator writes them: deg and N, each row four times with the clock held."""
    time = 0.025 * np.arange(samples)
    rows = np.zeros((samples, 6))
    rows[:, TIME] = time
    rows[:, COMMAND] = 60 * np.sin(time)
    rows[:, OUTPUT] = 25 * np.sin(time - 0.2)
    rows[:, AGONIST] = 5 + 4 * np.sin(time + 0.3)
    rows[:, ANTAGONIST] = 5 - 4 * np.sin(time + 0.2)
    return np.repeat(rows, HELD, axis=0)


def write_pair(folder: Path, rows: Array, name: str = "60.txt") -> Path:
    path = folder / name
    path.write_text("\n".join(", ".join(f"{value:.7g}" for value in row) + " " for row in rows))
    return path


@pytest.mark.parametrize(
    ("name", "bend"),
    [
        ("bend120.txt", 120),
        ("120_day2.txt", 120),
        ("120 (1).txt", 120),
        ("60.5", 60.5),
        ("60.5.txt", 60.5),
        ("60.5deg.txt", 60.5),
        ("60.5deg", 60.5),
        ("day2_120deg_3.txt", 120),
        ("Bend-90 run 2.txt", 90),
        ("2024-01-08_bend_45.csv", 45),
        ("sheath30.txt", 30),
        ("pi2_sheath120.txt", 120),
        ("0", 0),
    ],
)
def test_the_bend_is_the_one_number_of_the_name_that_can_be_it(tmp_path: Path, name: str, bend: float) -> None:
    run = endoscope_pair.load(write_pair(tmp_path, pair(), name))
    assert run["sheath_bend"] == pytest.approx(math.radians(bend), rel=1e-12)
    assert f"sheath bend {bend:g} deg, from the file's name" in run.notes


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("120_2.txt", "which number of the name '120_2' is the sheath's bend cannot be told; .* such as 120.txt or"),
        ("2024-01-08_120.txt", "which number .* cannot be told"),
        ("60,5.txt", "which number .* cannot be told"),
        ("day2run3.txt", "the name 'day2run3' is no sheath bend"),
        ("pi2.txt", "the name 'pi2' is no sheath bend"),
        ("straight.txt", "the name 'straight' is no sheath bend; allowed is a number from 0 to 1080, in degrees"),
        ("-60.txt", "the name '-60' is no sheath bend"),
        ("bend2000.txt", "the name 'bend2000' is no sheath bend"),
    ],
)
def test_a_name_that_does_not_tell_the_bend_is_refused_with_what_to_do(tmp_path: Path, name: str, reason: str) -> None:
    with pytest.raises(IdentificationError, match=reason):
        endoscope_pair.load(write_pair(tmp_path, pair(), name))


def test_a_published_file_under_another_bend_is_said(tmp_path: Path) -> None:
    published = DATA / "endoscope-pair" / "60.txt"
    if not published.is_file():
        pytest.skip(f"no measured pair at {published}: set TENODESIS_DATA to the folder that holds endoscope-pair/")
    other, same = tmp_path / "120.txt", tmp_path / "60_copy.txt"
    for path in (other, same):
        path.write_bytes(published.read_bytes())
    assert "bend of 120 deg, but its bytes are those published as 60.txt, of 60 deg" in said(endoscope_pair.load(other))
    assert "but its bytes" not in said(endoscope_pair.load(same))


def test_outliers_do_not_reach_the_mean_of_held_rows(tmp_path: Path) -> None:
    right = endoscope_pair.load(write_pair(tmp_path, pair()))
    rows = pair()
    rows[HELD * 100 + 1, AGONIST] += 3.5
    rows[HELD * 200 + 2, OUTPUT] -= 30
    run = endoscope_pair.load(write_pair(tmp_path, rows))
    assert len(run) == 500
    for column in ("agonist_tension", "output_angle"):
        assert run[column] == pytest.approx(right[column], abs=1e-9)
    assert "dropped 1 row: outliers of agonist_tension" in said(run)
    assert "dropped 1 row: outliers of output_angle" in said(run)
    rows[HELD * 300 : HELD * 301, ANTAGONIST] += 3.5
    run = endoscope_pair.load(write_pair(tmp_path, rows))
    assert len(run) == 499
    assert "dropped 1 row: outliers of antagonist_tension" in said(run)


def test_an_output_in_another_unit_than_the_command_is_found_and_said(tmp_path: Path) -> None:
    right = endoscope_pair.load(write_pair(tmp_path, pair()))
    rows = pair()
    rows[:, OUTPUT] = np.radians(rows[:, OUTPUT])
    run = endoscope_pair.load(write_pair(tmp_path, rows))
    assert "output_angle taken as rad, not deg: its values have a spread of" in said(run)
    assert run["output_angle"] == pytest.approx(right["output_angle"], abs=1e-6)
    rows = pair()
    rows[:, COMMAND] = np.radians(rows[:, COMMAND])
    run = endoscope_pair.load(write_pair(tmp_path, rows))
    assert "commanded_angle taken as rad, not deg" in said(run)
    assert "output_angle taken as deg, not rad" in said(run)
    assert run["output_angle"] == pytest.approx(right["output_angle"], abs=1e-6)


@pytest.mark.parametrize(
    ("column", "factor", "reason"),
    [
        (
            OUTPUT,
            4096 / 360,
            r"output_angle \(fractions with a spread of 56\d.*\) fits no unit; a spread may be 2 to 400 in",
        ),
        (OUTPUT, 2.2 / 50, r"output_angle .* may be deg or rad; .*; write it in deg"),
        (OUTPUT, 1e-4, "no excitation: output_angle moves by 0.00494, and at least 2 deg or 0.0349 rad is needed"),
        (COMMAND, 1e-4, "no excitation: commanded_angle moves by 0.0119"),
        ([AGONIST, ANTAGONIST], 0.01, "no excitation: agonist_tension and antagonist_tension move by at most 0.079"),
        (ANTAGONIST, 0.01, "no excitation: antagonist_tension moves by 0.079 N, and at least 0.2 N is needed"),
        ([AGONIST, ANTAGONIST], 300.0, "tension .* may be gram-force or mN; .*; write both in N"),
    ],
)
def test_a_column_of_the_pair_that_cannot_be_used_is_refused_for_the_right_reason(
    tmp_path: Path, column: int | list[int], factor: float, reason: str
) -> None:
    rows = pair()
    rows[:, column] *= factor
    with pytest.raises(IdentificationError, match=reason):
        endoscope_pair.load(write_pair(tmp_path, rows))


@pytest.mark.parametrize(("unit", "newton"), [("gram-force", GRAM_FORCE), ("mN", 1e-3)])
def test_tensions_of_the_pair_in_another_unit_are_told_together(tmp_path: Path, unit: str, newton: float) -> None:
    rows = pair()
    rows[:, ANTAGONIST] = 5 + 0.03 * (rows[:, ANTAGONIST] - 5) * 8
    right = endoscope_pair.load(write_pair(tmp_path, rows))
    rows[:, [AGONIST, ANTAGONIST]] /= newton
    run = endoscope_pair.load(write_pair(tmp_path, rows))
    assert f"agonist_tension and antagonist_tension taken as {unit}, not N: their values have a spread of" in said(run)
    for column in ("agonist_tension", "antagonist_tension"):
        assert run[column] == pytest.approx(right[column], abs=1e-4)


# --- one sheathed tendon -----------------------------------------------------------------------------------------

HEAD = ",Time,layout.dim,layout.data_offset,data_0,data_1,data_2,data_3"


def sheath(samples: int = 1500, peak: float = 10.0) -> Array:
    """Return time, proximal and distal tension in N, with the noise of a load cell."""
    time = 0.012 * np.arange(samples)
    pull = peak * (0.5 - 0.5 * np.cos(1.4 * time)) + np.random.default_rng(5).normal(0, 0.005, samples)
    return np.column_stack([time, pull, 0.5 * pull])


def write_sheath(folder: Path, rows: Array, *, unit: float = 1.0, head: str = HEAD, start: str = "") -> Path:
    path = folder / "pulls.csv"
    lines = [f"{at},{t:.6f},[],0,{one / unit:.7g},0.1,{two / unit:.7g},0.2" for at, (t, one, two) in enumerate(rows)]
    path.write_text(start + "\n".join([head, *lines]), encoding="utf-8")
    return path


def test_both_tensions_are_in_one_unit_which_is_said(tmp_path: Path) -> None:
    rows = sheath()
    rows[:, 2] *= 0.16  # 0.8 N, less than 100 in gram-force
    run = tendon_sheath.load(write_sheath(tmp_path, rows, unit=GRAM_FORCE))
    assert run["distal_tension"] == pytest.approx(rows[:, 2], abs=0.01)
    assert "tensions taken as gram-force, the format's unit, with a spread of 9.88 N; if they are mN (1.01 N)" in said(
        run
    )


@pytest.mark.parametrize(("name", "newton", "peak"), [("N", 1.0, 10.0), ("mN", 1e-3, 12.0)])
def test_tensions_that_cannot_be_gram_force_are_told_together(
    tmp_path: Path, name: str, newton: float, peak: float
) -> None:
    rows = sheath(peak=peak)
    run = tendon_sheath.load(write_sheath(tmp_path, rows, unit=newton))
    told = f"proximal_tension and distal_tension taken as {name}, not gram-force: their values have a spread of up to"
    assert told in said(run)
    assert run["distal_tension"] == pytest.approx(rows[:, 2], abs=0.02)


@pytest.mark.parametrize(("numbers", "units"), [(50.0, "gram-force or N"), (8000.0, "gram-force or mN")])
def test_tensions_that_may_be_in_two_units_are_refused_until_their_headings_say(
    tmp_path: Path, numbers: float, units: str
) -> None:
    rows = sheath(peak=numbers)
    with pytest.raises(
        IdentificationError, match=f"proximal_tension and distal_tension .* may be {units}; .* 'data_0 "
    ):
        tendon_sheath.load(write_sheath(tmp_path, rows))
    unit = "gf" if "or N" in units else "mN"
    stated = HEAD.replace("data_0", f"data_0 [{unit}]").replace("data_2", f"data_2 [{unit}]")
    run = tendon_sheath.load(write_sheath(tmp_path, rows, head=stated))
    scale = GRAM_FORCE if unit == "gf" else 1e-3
    assert run["proximal_tension"] == pytest.approx(scale * rows[:, 1], abs=1e-3 * scale * numbers)
    assert f"tensions taken as {unit}, from their headings" in run.notes


@pytest.mark.parametrize(
    ("head", "reason"),
    [
        (
            HEAD.replace("data_0", "data_0 [N]"),
            "headings of data_0 and data_2 give 'N' and no unit; allowed is one unit",
        ),
        (
            HEAD.replace("data_0", "data_0 [m]").replace("data_2", "data_2 [m]"),
            "is 'm'; allowed is a unit of the dimension",
        ),
        (
            HEAD.replace("data_0", "data_0 [kN]").replace("data_2", "data_2 [kN]"),
            "fits no unit; a spread may be .* in kN",
        ),
        (HEAD.replace("Time", "Time [ms]"), "time rises by 0.012 a row .* in ms"),
        (HEAD.replace("data_2", "data_9"), "pulls.csv has no column data_2; needed are Time, data_0, data_2"),
    ],
)
def test_headings_that_cannot_be_are_refused(tmp_path: Path, head: str, reason: str) -> None:
    with pytest.raises(IdentificationError, match=reason):
        tendon_sheath.load(write_sheath(tmp_path, sheath(), head=head))


def test_quoted_headings_and_a_byte_order_mark_are_read(tmp_path: Path) -> None:
    right = tendon_sheath.load(write_sheath(tmp_path, sheath(), unit=GRAM_FORCE))
    quoted = ",".join(f'"{name}"' for name in HEAD.split(","))
    run = tendon_sheath.load(write_sheath(tmp_path, sheath(), unit=GRAM_FORCE, head=quoted, start="\ufeff"))
    assert np.array_equal(run["distal_tension"], right["distal_tension"])
    bare = tendon_sheath.load(write_sheath(tmp_path, sheath(), unit=GRAM_FORCE, head=HEAD[1:].join(["n,", ""])))
    assert len(bare) == len(right)


def test_outliers_that_last_do_not_pass_the_median_of_three(tmp_path: Path) -> None:
    rows = sheath()
    rows[700:702, 2] += 20
    run = tendon_sheath.load(write_sheath(tmp_path, rows, unit=GRAM_FORCE))
    assert "dropped 2 rows: outliers of distal_tension" in said(run)
    assert run["distal_tension"].max() < 5.1


# --- what every text format has to bear --------------------------------------------------------------------------

FILES: dict[str, tuple[Callable[[], Array], Callable[[Path, Array], Path]]] = {
    "davinci-tool": (table, write),
    "endoscope-pair": (lambda: pair()[::HELD], write_pair),
    "tendon-sheath": (sheath, lambda folder, rows: write_sheath(folder, rows, unit=GRAM_FORCE)),
}
SENSOR = {"davinci-tool": TORQUE, "endoscope-pair": AGONIST, "tendon-sheath": 1}


@pytest.mark.parametrize("kind", FILES)
def test_every_format_says_gaps_duplicates_and_backward_clocks(tmp_path: Path, kind: str) -> None:
    make, put = FILES[kind]
    rows = make()
    count, whole = len(rows), FORMATS[kind].load(put(tmp_path, make()))
    assert len(whole) == count
    gone = FORMATS[kind].load(put(tmp_path, np.delete(rows, np.s_[100:120], axis=0)))
    assert len(gone) == count - 20
    assert "1 gap of" in said(gone)
    with pytest.raises(IdentificationError, match="at most 20 % may be missing"):
        FORMATS[kind].load(put(tmp_path, np.delete(rows, np.s_[count // 4 : count // 2], axis=0)))
    twice = FORMATS[kind].load(put(tmp_path, np.repeat(rows, 2, axis=0)))
    assert len(twice) == count
    assert "duplicates" in said(twice) or "the mean of rows of the same time" in said(twice)
    back = rows.copy()
    back[200:203, 0] -= 50 * (rows[1, 0] - rows[0, 0])
    run = FORMATS[kind].load(put(tmp_path, back))
    assert len(run) == count - 3
    assert "dropped 3 rows: out of order (the clock ran back or stood still)" in said(run)
    back[count // 2 :, 0] -= rows[count // 2, 0]
    with pytest.raises(IdentificationError, match="out of order"):
        FORMATS[kind].load(put(tmp_path, back))


@pytest.mark.parametrize("kind", FILES)
def test_every_format_tells_a_saturated_sensor(tmp_path: Path, kind: str) -> None:
    make, put = FILES[kind]
    rows = make()
    sensor = rows[:, SENSOR[kind]]
    length, top = round(0.048 * len(rows)), np.ceil(1.05 * sensor.max())
    clipped = rows.copy()
    clipped[100 : 100 + length, SENSOR[kind]] += 20 * sensor.max() * np.sin(math.pi * np.arange(length) / length)
    clipped[:, SENSOR[kind]] = np.minimum(clipped[:, SENSOR[kind]], top)
    run = FORMATS[kind].load(put(tmp_path, clipped))
    assert "saturated: " in said(run)
    assert 20 <= len(rows) - len(run) <= length
    clipped[:, SENSOR[kind]] = np.minimum(sensor, np.round(np.median(sensor)))
    with pytest.raises(IdentificationError, match="rows are saturated"):
        FORMATS[kind].load(put(tmp_path, clipped))


@pytest.mark.parametrize("kind", ["endoscope-pair", "tendon-sheath"])
def test_a_tension_of_the_wrong_sign_is_refused_and_an_offset_is_not(tmp_path: Path, kind: str) -> None:
    make, put = FILES[kind]
    rows = make()
    rows[:, SENSOR[kind]] -= np.median(rows[:, SENSOR[kind]]) + 0.04
    assert len(FORMATS[kind].load(put(tmp_path, rows))) == len(rows)
    rows = make()
    rows[:, SENSOR[kind]] *= -1
    with pytest.raises(IdentificationError, match=r"tension \w+ is negative: its median is -\d.* N; reverse its sign"):
        FORMATS[kind].load(put(tmp_path, rows))


@pytest.mark.parametrize(("kind", "sensor"), [("endoscope-pair", OUTPUT), ("endoscope-pair", 4), ("tendon-sheath", 2)])
def test_a_sensor_that_stays_the_same_while_others_move_is_said(tmp_path: Path, kind: str, sensor: int) -> None:
    make, put = FILES[kind]
    rows = make()
    assert "frozen" not in said(FORMATS[kind].load(put(tmp_path, rows)))
    begin = np.flatnonzero(np.abs(np.diff(rows[:, sensor])) > 0)[len(rows) // 3]
    rows[begin : begin + round(0.25 * len(rows)), sensor] = rows[begin, sensor]
    told = said(FORMATS[kind].load(put(tmp_path, rows)))
    found = re.search(r"exactly the same from (\S+) s to \S+ s while \w+ moves: a frozen sensor, unless it was", told)
    assert found, told
    assert float(found[1]) == pytest.approx(rows[begin, 0], abs=2 * (rows[1, 0] - rows[0, 0]))


def test_a_slack_tendon_at_zero_is_no_frozen_sensor(tmp_path: Path) -> None:
    rows = pair()
    rows[:, AGONIST] = np.maximum(0.0, rows[:, AGONIST] - 5)
    assert "frozen" not in said(endoscope_pair.load(write_pair(tmp_path, rows)))

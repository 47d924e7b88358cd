"""Claims about what loaders accept, repair, say and refuse: the checks all formats share, and the da Vinci tool's."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats import davinci_tool
from tenodesis.identification.formats.davinci_tool import JAW_COUNTS, SPINDLE_COUNTS, TORQUE_PER_COUNT, load
from tenodesis.identification.formats.measured import Measured, Raw, Source, Unit, read_rows
from tenodesis.signals import Array

TIME, SPINDLE, TORQUE, JAW, JAW_TORQUE = 0, 1, 2, 4, 5
SAMPLES = 4000


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


def said(measured: Measured) -> str:
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


def test_a_file_says_whether_it_is_a_published_one_and_under_which_licence(tmp_path: Path) -> None:
    run = load(write(tmp_path, table()))
    assert run.notes == ("run.TXT is not one of the files published in MRDLab/mis-tool-characterization at 03658b2cce",)
    assert run.source is davinci_tool.SOURCE
    assert "ODbL" in run.source.licence
    assert len(run.checksum) == 64
    known = Source("owner/name", "0123456789ab", "", "", "", {"a.txt": run.checksum})
    assert known.note("b.txt", run.checksum) == "b.txt is the published a.txt (owner/name at 0123456789), unmodified"


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
    assert "dropped 1 row: corrupt (the spindle beyond 1500 counts), first at 1 s" in told
    assert "dropped 1 row: outliers of jaw_angle" in told
    assert "dropped 1 row: outliers of spindle_torque" in told


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
    rows[:, TORQUE] *= TORQUE_PER_COUNT * scale
    run = load(write(tmp_path, rows))
    assert f"spindle_torque taken as {unit}, not counts" in said(run)
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
        raw.unit("x", (Unit("kN", 1e3, 1e-3, 1e-2), Unit("N", 1.0, 1, 10), Unit("gf", 9.80665e-3, 1, 1000)))


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
    assert "1 gaps of 0.201 s together in 4 s, first at 0.999 s" in said(run)
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
    with pytest.raises(IdentificationError, match=rf"run.TXT: no excitation: {name} moves by [02]"):
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


def test_the_formats_own_unit_holds_when_another_fits_as_well() -> None:
    raw = Raw("both", np.arange(300), {"x": np.linspace(0, 5, 300)})
    assert raw.unit("x", (Unit("N", 1.0, 1, 10), Unit("gf", 9.80665e-3, 1, 1000))) == "N"
    assert raw.notes == []


def test_excitation_is_asked_for_in_si() -> None:
    raw = Raw("still", np.arange(300), {"x": np.full(300, 2.0)})
    with pytest.raises(IdentificationError, match=r"still: no excitation: x moves by 0 N, and at least 1 N is needed"):
        raw.excited("x", 1.0, "N")

"""Claims about the loaders of the sheathed tendons, a pair and one alone, and what every text format has to bear."""

import math
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS
from tenodesis.identification.datasets import endoscope_pair, tendon_sheath
from tenodesis.identification.formats.measured import GRAM_FORCE
from tenodesis.run import Array

from .conftest import refused
from .dataset_files import (
    AGONIST,
    ANTAGONIST,
    COMMAND,
    HEAD,
    HELD,
    OUTPUT,
    TORQUE,
    pair,
    said,
    sheath,
    table,
    write,
    write_pair,
    write_sheath,
)

DATA = Path(os.environ.get("TENODESIS_DATA", Path(__file__).parents[3] / "shared" / "data"))
FILES: dict[str, tuple[Callable[[], Array], Callable[[Path, Array], Path]]] = {
    "davinci-tool": (table, write),
    "endoscope-pair": (lambda: pair()[::HELD], write_pair),
    "tendon-sheath": (sheath, lambda folder, rows: write_sheath(folder, rows, unit=GRAM_FORCE)),
}
SENSOR = {"davinci-tool": TORQUE, "endoscope-pair": AGONIST, "tendon-sheath": 1}


# --- pair of sheathed tendons ---


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
        ("120_2.txt", "the name '120_2' leaves open which number is the sheath's bend; .* such as 120.txt or"),
        ("2024-01-08_120.txt", "leaves open which number"),
        ("60,5.txt", "leaves open which number"),
        ("day2run3.txt", "the name 'day2run3' is no sheath bend"),
        ("pi2.txt", "the name 'pi2' is no sheath bend"),
        ("straight.txt", "the name 'straight' is no sheath bend; it must hold one number from 0 to 1080, in degrees"),
        ("-60.txt", "the name '-60' is no sheath bend"),
        ("bend2000.txt", "the name 'bend2000' is no sheath bend"),
    ],
)
def test_a_name_that_leaves_the_bend_open_is_refused_with_what_to_do(tmp_path: Path, name: str, reason: str) -> None:
    with pytest.raises(IdentificationError, match=reason):
        endoscope_pair.load(write_pair(tmp_path, pair(), name))


@pytest.mark.data
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
    assert right["commanded_angle"] == pytest.approx(np.radians(rows[::HELD, COMMAND]), abs=1e-7)
    with refused("path", kind=IdentificationError):
        endoscope_pair.load(write_pair(tmp_path, rows[:, :3]))
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
    ("column", "factor", "key", "allowed"),
    [
        (OUTPUT, 4096 / 360, "output_angle", "in one unit"),
        (OUTPUT, 2.2 / 50, "output_angle", "in one unit"),
        (OUTPUT, 1e-4, "output_angle", "at least 2 deg or 0.0349 rad"),
        (COMMAND, 1e-4, "commanded_angle", "at least"),
        ([AGONIST, ANTAGONIST], 0.01, "agonist_tension", "at least"),
        (ANTAGONIST, 0.01, "antagonist_tension", "at least 0.2 N"),
        ([AGONIST, ANTAGONIST], 300.0, "antagonist_tension", "in one unit"),
    ],
)
def test_a_column_of_the_pair_that_cannot_be_used_is_refused_for_the_right_reason(
    tmp_path: Path, column: int | list[int], factor: float, key: str, allowed: str
) -> None:
    rows = pair()
    rows[:, column] *= factor
    with refused(key, kind=IdentificationError, allowed=allowed):
        endoscope_pair.load(write_pair(tmp_path, rows))


@pytest.mark.parametrize(("unit", "newton"), [("gram-force", GRAM_FORCE), ("mN", 1e-3)])
def test_tensions_of_the_pair_in_another_unit_are_converted_together(tmp_path: Path, unit: str, newton: float) -> None:
    rows = pair()
    rows[:, ANTAGONIST] = 5 + 0.03 * (rows[:, ANTAGONIST] - 5) * 8
    right = endoscope_pair.load(write_pair(tmp_path, rows))
    rows[:, [AGONIST, ANTAGONIST]] /= newton
    run = endoscope_pair.load(write_pair(tmp_path, rows))
    assert f"agonist_tension and antagonist_tension taken as {unit}, not N: their values have a spread of" in said(run)
    for column in ("agonist_tension", "antagonist_tension"):
        assert run[column] == pytest.approx(right[column], abs=1e-4)


# --- one sheathed tendon ---


def test_both_tensions_are_in_one_unit_which_is_said(tmp_path: Path) -> None:
    rows = sheath()
    rows[:, 2] *= 0.16  # 0.8 N, less than 100 in gram-force
    run = tendon_sheath.load(write_sheath(tmp_path, rows, unit=GRAM_FORCE))
    assert run["distal_tension"] == pytest.approx(rows[:, 2], abs=0.01)
    assert "tensions taken as gram-force, the format's unit, with a spread of 9.88 N; if they are mN (1.01 N)" in said(
        run
    )


@pytest.mark.parametrize(("name", "newton", "peak"), [("N", 1.0, 10.0), ("mN", 1e-3, 12.0)])
def test_tensions_that_cannot_be_gram_force_are_converted_together(
    tmp_path: Path, name: str, newton: float, peak: float
) -> None:
    rows = sheath(peak=peak)
    run = tendon_sheath.load(write_sheath(tmp_path, rows, unit=newton))
    warning = (
        f"proximal_tension and distal_tension taken as {name}, not gram-force: their values have a spread of up to"
    )
    assert warning in said(run)
    assert run["distal_tension"] == pytest.approx(rows[:, 2], abs=0.02)


@pytest.mark.parametrize(("numbers", "units"), [(50.0, "gram-force or N"), (8000.0, "gram-force or mN")])
def test_tensions_that_may_be_in_two_units_are_refused_until_their_headings_say(
    tmp_path: Path, numbers: float, units: str
) -> None:
    rows = sheath(peak=numbers)
    with refused("proximal_tension", kind=IdentificationError, allowed="in one unit"):
        tendon_sheath.load(write_sheath(tmp_path, rows))
    unit = "gf" if "or N" in units else "mN"
    stated = HEAD.replace("data_0", f"data_0 [{unit}]").replace("data_2", f"data_2 [{unit}]")
    run = tendon_sheath.load(write_sheath(tmp_path, rows, head=stated))
    scale = GRAM_FORCE if unit == "gf" else 1e-3
    assert run["proximal_tension"] == pytest.approx(scale * rows[:, 1], abs=1e-3 * scale * numbers)
    assert f"tensions taken as {unit}, from their headings" in run.notes


@pytest.mark.parametrize(
    ("head", "key"),
    [
        (HEAD.replace("data_0", "data_0 [N]"), "data_0"),
        (
            HEAD.replace("data_0", "data_0 [m]").replace("data_2", "data_2 [m]"),
            "pulls.csv: the unit of data_0 and data_2",
        ),
        (HEAD.replace("data_0", "data_0 [kN]").replace("data_2", "data_2 [kN]"), "proximal_tension"),
        (HEAD.replace("Time", "Time [ms]"), "time"),
        (HEAD.replace("data_2", "data_9"), "columns"),
    ],
)
def test_headings_that_cannot_be_are_refused(tmp_path: Path, head: str, key: str) -> None:
    with refused(key, kind=IdentificationError):
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
    rows[300, 2] += 1
    run = tendon_sheath.load(write_sheath(tmp_path, rows, unit=GRAM_FORCE))
    assert "dropped 2 rows: outliers of distal_tension" in said(run)
    assert "distal_tension: median of three samples, which took 1 spikes of over 0.05 N out" in said(run)
    assert run["distal_tension"].max() < 5.1


# --- every text format ---


@pytest.mark.parametrize("kind", FILES)
def test_every_format_notes_gaps_duplicates_and_backward_clocks(tmp_path: Path, kind: str) -> None:
    make, put = FILES[kind]
    rows = make()
    count, whole = len(rows), FORMATS[kind].load(put(tmp_path, make()))
    assert len(whole) == count
    gone = FORMATS[kind].load(put(tmp_path, np.delete(rows, np.s_[100:120], axis=0)))
    assert len(gone) == count - 20
    assert "1 gap of" in said(gone)
    with refused("gaps", kind=IdentificationError, allowed="at most 20 %"):
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
    with refused("time", kind=IdentificationError, allowed="at most 1 %"):
        FORMATS[kind].load(put(tmp_path, back))


@pytest.mark.parametrize("kind", FILES)
def test_every_format_drops_rows_of_no_numbers_and_refuses_what_says_nothing(tmp_path: Path, kind: str) -> None:
    make, put = FILES[kind]
    load, rows, sensor = FORMATS[kind].load, make(), SENSOR[kind]
    rows[300, sensor] = math.nan
    run = load(put(tmp_path, rows))
    assert len(run) == len(rows) - 1
    assert "dropped 1 row: not numbers in every column" in said(run)
    rows[:, sensor] = rows[0, sensor]
    with pytest.raises(IdentificationError, match="no excitation: ") as still:
        load(put(tmp_path, rows))
    assert still.value.allowed.startswith("at least")
    with refused("samples", kind=IdentificationError, allowed="at least 200"):
        load(put(tmp_path, make()[:100]))
    with refused("path", kind=IdentificationError):
        load(tmp_path / "60.none")


@pytest.mark.parametrize("kind", FILES)
def test_every_format_notes_a_saturated_sensor(tmp_path: Path, kind: str) -> None:
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
    with pytest.raises(IdentificationError) as problem:
        FORMATS[kind].load(put(tmp_path, clipped))
    assert problem.value.allowed == "at most 5 %"


@pytest.mark.parametrize("kind", ["endoscope-pair", "tendon-sheath"])
def test_a_tension_of_the_wrong_sign_is_refused_and_an_offset_is_not(tmp_path: Path, kind: str) -> None:
    make, put = FILES[kind]
    rows = make()
    rows[:, SENSOR[kind]] -= np.median(rows[:, SENSOR[kind]]) + 0.04
    assert len(FORMATS[kind].load(put(tmp_path, rows))) == len(rows)
    rows = make()
    rows[:, SENSOR[kind]] *= -1
    with pytest.raises(IdentificationError) as problem:
        FORMATS[kind].load(put(tmp_path, rows))
    assert problem.value.key.endswith("_tension") and problem.value.allowed == "positive"


@pytest.mark.parametrize(("kind", "sensor"), [("endoscope-pair", OUTPUT), ("endoscope-pair", 4), ("tendon-sheath", 2)])
def test_a_sensor_that_stays_the_same_while_others_move_is_said(tmp_path: Path, kind: str, sensor: int) -> None:
    make, put = FILES[kind]
    rows = make()
    assert "frozen" not in said(FORMATS[kind].load(put(tmp_path, rows)))
    begin = np.flatnonzero(np.abs(np.diff(rows[:, sensor])) > 0)[len(rows) // 3]
    rows[begin : begin + round(0.25 * len(rows)), sensor] = rows[begin, sensor]
    warning = said(FORMATS[kind].load(put(tmp_path, rows)))
    found = re.search(
        r"exactly the same from (\S+) s to \S+ s while \w+ moves: a frozen sensor, unless it was", warning
    )
    assert found, warning
    assert float(found[1]) == pytest.approx(rows[begin, 0], abs=2 * (rows[1, 0] - rows[0, 0]))


def test_a_slack_tendon_at_zero_is_no_frozen_sensor(tmp_path: Path) -> None:
    rows = pair()
    rows[:, AGONIST] = np.maximum(0.0, rows[:, AGONIST] - 5)
    assert "frozen" not in said(endoscope_pair.load(write_pair(tmp_path, rows)))

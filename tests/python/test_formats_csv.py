"""Recordings of instruments as CSV: the same run as from MCAP, by headings or by a map."""

from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.recording import Recording

from .conftest import refused
from .recording_files import headed, read, same, table


def test_an_export_is_the_recording(recorded: InstrumentRun, log: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    Recording.open(log).to_csv(path)
    loaded = read(path)
    assert same(loaded, recorded)
    assert loaded.instrument is None


def test_headings_may_be_the_columns_names_with_units(recorded: InstrumentRun, tmp_path: Path) -> None:
    columns = headed(recorded)
    columns["handle_angle [deg]"] = np.degrees(columns.pop("handle_angle"))
    columns["time [ms]"] = 1e3 * columns.pop("time")
    assert same(read(table(tmp_path / "run.csv", columns)), recorded, 1e-9)


def test_a_map_beside_the_file_names_columns_units_and_signs(recorded: InstrumentRun, tmp_path: Path) -> None:
    columns = {"t": 1e3 * recorded.time, "theta": -np.degrees(recorded["handle_angle"])}
    columns |= {"F1": 1e3 * recorded["tension_agonist"], "F2": recorded["tension_antagonist"], "junk": recorded.time}
    path = table(tmp_path / "bench.csv", columns, ";", lambda value: repr(value).replace(".", ","))
    (tmp_path / "bench.csv.columns.toml").write_text(
        'time = { column = "t", unit = "ms" }\n'
        'handle_angle = { column = "theta", unit = "deg", factor = -1 }\n'
        'tension_agonist = { column = "F1", unit = "mN" }\n'
        'tension_antagonist = { column = "F2", unit = "N" }\n'
    )
    loaded = read(path)
    assert set(loaded.columns) == {"handle_angle", "tension_agonist", "tension_antagonist"}
    for name in loaded.columns:
        assert loaded[name] == pytest.approx(recorded[name], abs=1e-9)
    assert "columns by bench.csv.columns.toml" in loaded.notes


def test_one_map_serves_all_files_of_a_folder_that_have_none_of_their_own(
    recorded: InstrumentRun, tmp_path: Path
) -> None:
    columns = {"t": recorded.time, "theta": np.degrees(recorded["handle_angle"])}
    columns |= {"F1": recorded["tension_agonist"], "F2": recorded["tension_antagonist"]}
    shared = (
        'time = { column = "t", unit = "s" }\n'
        'handle_angle = { column = "theta", unit = "deg" }\n'
        'tension_agonist = { column = "F1", unit = "N" }\n'
        'tension_antagonist = { column = "F2", unit = "N" }\n'
    )
    (tmp_path / "columns.toml").write_text(shared)
    runs = [read(table(tmp_path / name, columns)) for name in ("first.csv", "second.csv", "own.csv")]
    assert all("columns by columns.toml" in run.notes for run in runs)
    assert runs[1]["handle_angle"] == pytest.approx(recorded["handle_angle"], abs=1e-12)
    (tmp_path / "own.csv.columns.toml").write_text(shared.replace('"F1"', '"F2"'))
    own = read(tmp_path / "own.csv")
    assert "columns by own.csv.columns.toml" in own.notes
    assert np.array_equal(own["tension_agonist"], own["tension_antagonist"])


def test_quoted_headings_and_a_byte_order_mark_are_read(recorded: InstrumentRun, tmp_path: Path) -> None:
    path = table(tmp_path / "run.csv", headed(recorded))
    head, rest = path.read_text().split("\n", 1)
    quoted = ", ".join(f'"{name.strip()}"' for name in head.split(","))
    path.write_text(f"\ufeff{quoted}\n{rest}", encoding="utf-8")
    assert same(read(path), recorded)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ('handle = { column = "t", unit = "rad" }', "handle is no column; it must be one of time, handle_angle"),
        ('time = "t"', "it must be a table like"),
        ('time = { column = "x", unit = "s" }', "column is 'x'; it must be one of 't'"),
        ('time = { column = "t", unit = "N" }', "the unit of time is 'N'"),
        ('time = { column = "t", unit = "quux" }', "the unit of time is 'quux'"),
        ('time = { column = "t", unit = "s", factor = 0 }', "factor is 0"),
        ("time = ", "is not valid TOML"),
        ('time = { column = "t", unit = "s" }', "lacks handle_angle, tension_agonist, tension_antagonist"),
    ],
)
def test_a_map_that_is_wrong_is_refused_with_the_reason(tmp_path: Path, line: str, reason: str) -> None:
    path = table(tmp_path / "run.csv", {"t": np.arange(5.0), "a": np.arange(5.0)})
    (tmp_path / "run.csv.columns.toml").write_text(line)
    with pytest.raises(IdentificationError, match=reason.replace("(", r"\(")):
        read(path)


def test_a_wrong_unit_is_found_by_its_magnitude_and_noted(recorded: InstrumentRun, tmp_path: Path) -> None:
    columns = headed(recorded, handle_angle=np.degrees(recorded["handle_angle"]))
    columns |= {name: 1e3 * recorded[name] for name in ("tension_agonist", "tension_antagonist")}
    loaded = read(table(tmp_path / "run.csv", columns))
    assert same(loaded, recorded, 1e-9)
    assert any("handle_angle taken as deg, not rad" in note for note in loaded.notes)
    assert any("tension_agonist taken as mN, not N" in note for note in loaded.notes)


def test_a_handle_stated_in_degrees_that_is_in_radians_is_noted(recorded: InstrumentRun, tmp_path: Path) -> None:
    columns = headed(recorded)
    columns["handle_angle [deg]"] = columns.pop("handle_angle")
    loaded = read(table(tmp_path / "run.csv", columns))
    assert same(loaded, recorded, 1e-9)
    assert any("handle_angle taken as rad, not deg: its values have a spread of 0." in note for note in loaded.notes)


def test_a_handle_may_turn_far(recorded: InstrumentRun, tmp_path: Path) -> None:
    columns = headed(recorded, handle_angle=4.5 * recorded["handle_angle"])
    loaded = read(table(tmp_path / "run.csv", columns))
    assert loaded["handle_angle"] == pytest.approx(4.5 * recorded["handle_angle"], abs=1e-12)


def test_tensions_that_may_be_in_two_units_are_refused_with_what_to_do(recorded: InstrumentRun, tmp_path: Path) -> None:
    # 15 N in gram-force, which would be 1.5 N in mN
    tension = {f"tension_{one}": 160 * recorded[f"tension_{one}"] for one in ("agonist", "antagonist")}
    with refused("tension_agonist", "N", kind=IdentificationError):
        read(table(tmp_path / "run.csv", headed(recorded, **tension)))


def test_an_implausible_column_is_refused(recorded: InstrumentRun, tmp_path: Path) -> None:
    columns = headed(recorded, handle_angle=1e6 * recorded["handle_angle"])
    with refused("handle_angle", "rad", kind=IdentificationError):
        read(table(tmp_path / "run.csv", columns))


def test_headings_without_a_known_name_are_refused_with_what_to_do(tmp_path: Path) -> None:
    path = table(tmp_path / "run.csv", {"t": np.arange(5.0), "a": np.arange(5.0)})
    with refused("columns", kind=IdentificationError):
        read(path)
    (tmp_path / "empty.csv").write_text("")
    with refused("path", kind=IdentificationError):
        read(tmp_path / "empty.csv")
    with refused("path", kind=IdentificationError):
        read(tmp_path / "none.csv")


def test_corrupt_rows_are_dropped_and_said(recorded: InstrumentRun, tmp_path: Path) -> None:
    time, tension = recorded.time.copy(), recorded["tension_agonist"].copy()
    time[500] = time[400]
    tension[700], tension[900] = np.nan, 150.0
    columns = headed(recorded, time=time, tension_agonist=tension)
    path = table(tmp_path / "run.csv", {name: np.insert(values, 51, values[50]) for name, values in columns.items()})
    loaded = read(path)
    assert len(loaded) == len(recorded) - 3
    for word in ("not numbers", "duplicates", "clock ran back", "outliers of tension_agonist"):
        assert any(word in note for note in loaded.notes)


def test_an_encoder_that_slips_for_a_sample_is_dropped_and_said(recorded: InstrumentRun, tmp_path: Path) -> None:
    output = recorded["measured_output_angle"].copy()
    output[500] += np.radians(90)
    tension = recorded["tension_agonist"].copy()
    tension[600], tension[700] = 1e6, 200  # the greater does not hide the lesser
    loaded = read(table(tmp_path / "run.csv", headed(recorded, measured_output_angle=output, tension_agonist=tension)))
    assert len(loaded) == len(recorded) - 3
    assert any("dropped 1 row: outliers of measured_output_angle" in note for note in loaded.notes)
    assert any("dropped 2 rows: outliers of tension_agonist" in note for note in loaded.notes)


def test_a_sensor_that_was_not_recorded_is_left_out(recorded: InstrumentRun, tmp_path: Path) -> None:
    nothing = np.full(len(recorded), np.nan)
    loaded = read(table(tmp_path / "run.csv", headed(recorded, measured_output_angle=nothing)))
    assert "measured_output_angle" not in loaded.columns
    assert len(loaded) == len(recorded)


def test_a_handle_that_rests_and_too_few_samples_are_refused(recorded: InstrumentRun, tmp_path: Path) -> None:
    still = headed(recorded, handle_angle=np.zeros(len(recorded)))
    with refused("handle_angle", 0.0, kind=IdentificationError):
        read(table(tmp_path / "still.csv", still))
    short = {name: values[:50] for name, values in headed(recorded).items()}
    with refused("samples", 50, kind=IdentificationError):
        read(table(tmp_path / "short.csv", short))


def test_a_saturated_load_cell_is_said_and_a_slack_tendon_is_none(recorded: InstrumentRun, tmp_path: Path) -> None:
    tension = recorded["tension_agonist"].copy()
    tension[300:340] = tension.max() + 5
    loaded = read(table(tmp_path / "run.csv", headed(recorded, tension_agonist=tension)))
    assert any("saturated: tension_agonist" in note for note in loaded.notes)
    slack = recorded["tension_agonist"].copy()
    slack[300:600] = 0
    loaded = read(table(tmp_path / "slack.csv", headed(recorded, tension_agonist=slack)))
    assert len(loaded) == len(recorded)
    slack[1000:1040] = slack.max() + 5
    loaded = read(table(tmp_path / "both.csv", headed(recorded, tension_agonist=slack)))
    assert len(loaded) == len(recorded) - 40
    assert any("saturated: tension_agonist" in note for note in loaded.notes)

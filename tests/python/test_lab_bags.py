"""Bags of ROS 1 and 2 with topics and joints of other names: shown, mapped, and identified from as the export is."""

from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import MissingExtraError, RecordingError
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.recording import Recording, lab_map
from tenodesis.run import Array

from .conftest import Command
from .lab_writers import WRENCH, bag
from .recording_files import read


@pytest.fixture(scope="module")
def columns(recorded: InstrumentRun) -> dict[str, Array]:
    """Angles in degrees, under the headings of a laboratory."""
    names = {"handle_angle": "theta_h", "measured_handle_angle": "theta_m", "measured_output_angle": "theta_e"}
    angles = {short: np.degrees(recorded[name]) for name, short in names.items()}
    tensions = {"F1": recorded["tension_agonist"], "F2": recorded["tension_antagonist"]}
    return {"t": recorded.time, **angles, **tensions, "load": recorded["force"]}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "storage"), [("run.bag", ""), ("run_db3", "SQLITE3"), ("run_mcap", "MCAP")])
def test_a_bag_of_other_names_is_shown_mapped_and_read_as_the_recording(
    tenodesis: Command,
    recorded: InstrumentRun,
    columns: dict[str, Array],
    tmp_path: Path,
    name: str,
    storage: str,
) -> None:
    path = bag(tmp_path / name, columns, storage=storage)
    code, said, _ = tenodesis("info", name)
    assert code == 0
    assert "/PSM/tendons/measured_js" in said.replace("\n", "")
    code, said, errors = tenodesis("map", name)
    assert code == 0, errors
    loaded = read(path, "recording")
    expected = [one for one in recorded.columns if not one.startswith(("spool", "radial"))]
    assert set(expected) <= set(loaded.columns)
    for column in expected:
        assert loaded[column] == pytest.approx(recorded[column], abs=1e-12), column
    assert loaded.time - loaded.time[0] == pytest.approx(recorded.time - recorded.time[0], abs=1e-9)


def test_topics_of_another_clock_are_interpolated(columns: dict[str, Array], tmp_path: Path) -> None:
    path = bag(tmp_path / "run.bag", columns, shifted=0.2e-3)
    found = lab_map.numbers_in(path)
    force = found.columns[found.headings.index(f"{WRENCH}.force.x [N]")]
    assert np.isnan(force[0])
    expected = np.interp(columns["t"], columns["t"] + 0.2e-3, columns["load"])
    assert force[1:] == pytest.approx(expected[1:], abs=1e-6)


def test_a_torn_bag_and_a_bag_without_numbers_are_one_sentence(columns: dict[str, Array], tmp_path: Path) -> None:
    path = bag(tmp_path / "run.bag", {name: values[:200] for name, values in columns.items()})
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(RecordingError, match=r"run\.bag cannot be read: .*") as raised:
        Recording.open(path)
    assert "\n" not in str(raised.value)


def test_a_missing_library_is_named(columns: dict[str, Array], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag(tmp_path / "run.bag", {name: values[:5] for name, values in columns.items()})
    monkeypatch.setitem(__import__("sys").modules, "rosbags.highlevel", None)
    with pytest.raises(MissingExtraError) as raised:
        Recording.open(path)
    assert raised.value.extra == "formats"


def test_a_text_without_rows_of_numbers_gets_no_map(tenodesis: Command, tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("# Bench, notes\nOne, two\nand three\n")
    code, _, errors = tenodesis("map", "README.md")
    assert code == 1
    assert "holds no rows of numbers" in errors.replace("\n", " ")
    assert [one.name for one in tmp_path.iterdir()] == ["README.md"]

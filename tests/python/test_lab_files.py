"""Files that laboratories write, of one run: each is read, mapped, and identified from as the export is."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io

from tenodesis import plot
from tenodesis.errors import MissingExtraError, RecordingError
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.recording import Recording, lab_guess, lab_map, lab_tables

from . import lab_writers
from .conftest import Command, refused
from .lab_writers import Columns, tdms
from .recording_files import read, same, table

KINDS = {name: write for name, write in lab_writers.KINDS.items() if not name.startswith("run")} | {"no_suffix": tdms}
SHORT = {
    "handle_angle": "theta_h",
    "tension_agonist": "F1",
    "tension_antagonist": "F2",
    "measured_output_angle": "theta_e",
    "force": "load",
}
DIGITS = 1e-6


def parquet(path: Path, columns: Columns) -> None:
    pd.DataFrame(columns).to_parquet(path)


@pytest.fixture(scope="module")
def columns(recorded: InstrumentRun) -> Columns:
    """Angles in degrees, under short names."""
    signals = {
        "t": recorded.time,
        **{SHORT[name]: values for name, values in recorded.columns.items() if name in SHORT},
    }
    return {name: np.degrees(values) if name.startswith("theta") else values for name, values in signals.items()}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_any_kind_is_shown_mapped_drawn_and_read_as_the_export_is(
    tenodesis: Command, recorded: InstrumentRun, columns: Columns, tmp_path: Path, kind: str
) -> None:
    path = tmp_path / kind
    KINDS[kind](path, columns)
    code, said, _ = tenodesis("info", kind)
    assert code == 0
    assert len(recorded) == len(Recording.open(path).run)
    code, said, _ = tenodesis("map", kind)
    assert code == 0, said
    assert (tmp_path / f"{kind}.columns.png").stat().st_size > 1000
    loaded = read(path, "recording")
    expected = {name: values for name, values in recorded.columns.items() if name in SHORT}
    assert set(loaded.columns) == set(expected)
    for name, values in expected.items():
        assert loaded[name] == pytest.approx(values, abs=DIGITS)
    assert loaded.time == pytest.approx(recorded.time, abs=DIGITS)
    run = Recording.open(path).run
    assert plot.run(run, ["measured_tension"])
    assert run["measured_tension.agonist"] == pytest.approx(recorded["tension_agonist"], abs=DIGITS)


@pytest.mark.parametrize("name", ["run.csv", "run.parquet"])
def test_an_export_needs_no_map_and_no_format(recorded: InstrumentRun, log: Path, tmp_path: Path, name: str) -> None:
    own = Recording.open(log)
    own.to_csv(tmp_path / name) if name == "run.csv" else own.to_parquet(tmp_path / name)
    assert same(read(tmp_path / name, "recording"), recorded)
    assert same(read(log, "recording"), recorded)
    again = Recording.open(tmp_path / name).run
    assert np.array_equal(again["measured_tension"], own.run["measured_tension"])


def test_a_map_says_what_it_could_not_find_and_turns_tensions_that_push(tmp_path: Path) -> None:
    clock = np.arange(500) * 1e-3
    path = table(tmp_path / "x.csv", {"t": clock, "Seilkraft 1": -20 - clock, "what": clock**2})
    read_table = lab_tables.read_table(path)
    found = lab_guess.guess(read_table)
    assert found["tension_agonist"].factor == -1
    text = lab_guess.as_toml(read_table, found)
    assert "needed by tenodesis identify: handle_angle, tension_antagonist" in text
    assert "'what'" in text
    mapped = lab_map.by_map(read_table, text, "map")
    assert mapped.values("tension_agonist") == pytest.approx(20 + clock)


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ","), (";", "."), ("\t", ",")])
def test_separators_and_decimal_commas_are_told_apart(tmp_path: Path, separator: str, decimal: str) -> None:
    lines = [["t, clock", "x, y"] if separator != "," else ["t", "x"], ["0.0", "-0.25"], ["0.1", "1.5"]]
    rows = [separator.join(one.replace(".", decimal) for one in line) for line in lines]
    (tmp_path / "x.csv").write_text("\n".join(rows))
    found = lab_tables.read_table(tmp_path / "x.csv")
    assert [list(one) for one in found.columns] == [[0.0, 0.1], [-0.25, 1.5]]


def test_decimal_commas_between_commas_and_headings_alone_are_named(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_text("t,x\n0,0,-0,25\n0,1,1,5\n")
    with refused("columns", 4, kind=RecordingError, allowed="2 values in a row"):
        lab_tables.read_table(tmp_path / "x.csv")
    (tmp_path / "y.csv").write_text("t [s],x [rad]\n")
    with pytest.raises(RecordingError, match="holds headings, and no row below them"):
        lab_map.numbers_in(tmp_path / "y.csv")


def test_grams_hint_at_their_weight() -> None:
    with refused("x", "g", kind=RecordingError, allowed="gf"):
        lab_map.scale_of("g", "N", "x")


@pytest.mark.parametrize("kind", ["bench.tdms", "newer.mat", "bench.xlsx", "bench.mat", "bench.npz", "bench.parquet"])
def test_a_damaged_file_is_one_sentence(columns: Columns, tmp_path: Path, kind: str) -> None:
    path = tmp_path / kind
    KINDS.get(kind, parquet)(path, columns)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 3])
    try:
        lab_tables.read_table(path)
    except RecordingError as problem:
        assert "\n" not in str(problem)


@pytest.mark.parametrize(
    ("kind", "module"), [("bench.tdms", "nptdms"), ("newer.mat", "h5py"), ("bench.xlsx", "openpyxl")]
)
def test_a_missing_library_is_named(
    columns: Columns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, module: str
) -> None:
    KINDS[kind](tmp_path / kind, columns)
    monkeypatch.setitem(__import__("sys").modules, module, None)
    with pytest.raises(MissingExtraError) as raised:
        Recording.open(tmp_path / kind)
    assert (raised.value.value, raised.value.extra) == (module, "formats")


def test_a_table_that_does_not_fit_into_memory_is_one_sentence(
    columns: Columns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise MemoryError

    np.savez(tmp_path / "run.npz", **columns)
    monkeypatch.setattr(np, "load", full)
    with pytest.raises(RecordingError, match=r"run\.npz does not fit into memory\.$"):
        lab_tables.read_table(tmp_path / "run.npz")


@pytest.mark.parametrize("kind", ["bomb.mat", "bomb.h5", "bomb.tdms", "bomb.npz", "bomb.parquet"])
def test_what_expands_to_too_much_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    path, nothing = tmp_path / kind, np.zeros(200_000)
    if kind.endswith("mat"):
        scipy.io.savemat(path, {"a": {"b": nothing}}, do_compression=True)
    elif kind.endswith("h5"):
        with h5py.File(path, "w") as file:
            file.create_dataset("a", data=nothing, compression="gzip")
    elif kind.endswith("npz"):
        np.savez_compressed(path, a=nothing)
    elif kind.endswith("parquet"):
        parquet(path, {"a": nothing})
    else:
        tdms(path, {"t": nothing[:50_000], "a": nothing[:50_000]}, waveform=False)
    monkeypatch.setattr(lab_tables, "_LARGEST", 700_000)
    if kind.endswith("tdms"):
        monkeypatch.setattr(lab_tables, "_start", lambda path: path.read_bytes()[:4096])
    with pytest.raises(RecordingError, match=r"holds more than 0\.7 MB"):
        lab_tables.read_table(path)


def test_a_recording_of_this_package_is_drawn_and_gets_no_map(tenodesis: Command, log: Path, tmp_path: Path) -> None:
    shutil.copy(log, tmp_path / "run.mcap")
    code, said, _ = tenodesis("map", "run.mcap")
    assert (code, "need no map" in said) == (0, True)
    assert (tmp_path / "run.mcap.columns.png").stat().st_size > 1000
    assert lab_map.map_beside(tmp_path / "run.mcap") is None

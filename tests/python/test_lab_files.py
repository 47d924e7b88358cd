"""Files that laboratories write, of one run: each is read, mapped, and identified from as the export is."""

import struct
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter

from tenodesis import plot
from tenodesis.errors import MissingExtraError, RecordingError
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.recording import Recording, lab_guess, lab_map, lab_tables
from tenodesis.run import Array

from .conftest import refused
from .recording_files import read, same, table

HEADINGS = {
    "handle_angle": "theta_h",
    "tension_agonist": "F1",
    "tension_antagonist": "F2",
    "measured_output_angle": "theta_e",
    "force": "load",
}
DIGITS = 1e-6
Columns = dict[str, Array]


def lvm(path: Path, columns: Columns, *, x: bool = True) -> None:
    header = ["LabVIEW Measurement", "Separator\tTab", "Decimal_Separator\t,", "***End_of_Header***\t", "\t"]
    count = len(columns) - 1
    step = float(columns["t"][1] - columns["t"][0])
    header += [f"Channels\t{count}", "X0" + "\t0" * count, "Delta_X" + f"\t{step!r}".replace(".", ",") * count]
    header += ["***End_of_Header***", "\t".join(["X_Value", *list(columns)[1:], "Comment"])]
    rows = [
        "\t".join([f"{time!r}" if x else "", *map(repr, rest), ""]).replace(".", ",")
        for time, *rest in np.column_stack([*columns.values()]).tolist()
    ]
    path.write_text("\n".join([*header, *rows]) + "\n")


def stamped(path: Path, columns: Columns) -> None:
    nanoseconds = np.round(columns["t"] * 1e9) + 999_500_000
    clock = {"sec": 1.7e9 + nanoseconds // 1e9, "nanosec": nanoseconds % 1e9}
    table(path, clock | {name: values for name, values in columns.items() if name != "t"})


def tdms(path: Path, columns: Columns, *, waveform: bool = False) -> None:
    about = {"wf_increment": float(columns["t"][1] - columns["t"][0]), "wf_start_offset": 0.0}
    names = list(columns)[1:] if waveform else list(columns)
    with TdmsWriter(path) as writer:
        one = [ChannelObject("bench", name, columns[name], about if waveform else {}) for name in names]
        writer.write_segment(one)


def mat73(path: Path, columns: Columns) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in columns.items():
            file[f"bench/{name}"] = values[np.newaxis]
    with path.open("r+b") as start:
        start.write(b"MATLAB 7.3 MAT-file".ljust(124) + struct.pack("<H", 0x0200) + b"IM")


def xlsx(path: Path, columns: Columns) -> None:
    book = openpyxl.Workbook(write_only=True)
    sheet = book.create_sheet()
    sheet.append(list(columns))
    for row in np.column_stack([*columns.values()]).tolist():
        sheet.append(row)
    book.save(path)


def german(path: Path, columns: Columns) -> None:
    words = {"t": "Zeit", "theta_h": "Griff", "theta_e": "Spitze", "load": "Last"}
    renamed = {words.get(name, name): values for name, values in columns.items()}
    table(path, renamed, ";", lambda value: repr(value).replace(".", ","))


KINDS: dict[str, Callable[[Path, Columns], object]] = {
    "comma.csv": table,
    "german.csv": german,
    "tabs.txt": lambda path, columns: table(path, columns, "\t"),
    "milliseconds.csv": lambda path, columns: table(
        path, {"t [ms]": 1e3 * columns["t"]} | dict(list(columns.items())[1:])
    ),
    "stamped.csv": stamped,
    "bench.lvm": lvm,
    "no_x.lvm": lambda path, columns: lvm(path, columns, x=False),
    "bench.tdms": tdms,
    "waveform.tdms": lambda path, columns: tdms(path, columns, waveform=True),
    "bench.mat": scipy.io.savemat,
    "structure.mat": lambda path, columns: scipy.io.savemat(path, {"bench": columns}),
    "newer.mat": mat73,
    "bench.xlsx": xlsx,
    "no_suffix": tdms,
}


@pytest.fixture(scope="module")
def columns(recorded: InstrumentRun) -> Columns:
    """Angles in degrees, under short names."""
    found = {"t": recorded.time}
    for name, short in HEADINGS.items():
        found[short] = np.degrees(recorded[name]) if name.endswith("angle") else recorded[name]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_any_kind_is_shown_mapped_drawn_and_read_as_the_export_is(
    tenodesis: Callable[..., tuple[int, str, str]], recorded: InstrumentRun, columns: Columns, tmp_path: Path, kind: str
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
    expected = {name: values for name, values in recorded.columns.items() if name in HEADINGS}
    assert set(loaded.columns) == set(expected)
    for name, values in expected.items():
        assert loaded[name] == pytest.approx(values, abs=DIGITS)
    assert loaded.time == pytest.approx(recorded.time, abs=DIGITS)
    run = Recording.open(path).run
    assert plot.run(run, ["measured_tension"])
    assert run["measured_tension.agonist"] == pytest.approx(recorded["tension_agonist"], abs=DIGITS)


def test_an_export_needs_no_map_and_no_format(recorded: InstrumentRun, log: Path, tmp_path: Path) -> None:
    Recording.open(log).to_csv(tmp_path / "run.csv")
    assert same(read(tmp_path / "run.csv", "recording"), recorded)
    assert same(read(log, "recording"), recorded)
    again = Recording.open(tmp_path / "run.csv").run
    assert np.array_equal(again["measured_tension"], Recording.open(log).run["measured_tension"])


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


def test_grams_hint_at_their_weight() -> None:
    with refused("x", "g", kind=RecordingError, allowed="gf"):
        lab_map.scale_of("g", "N", "x")


@pytest.mark.parametrize("kind", ["bench.tdms", "newer.mat", "bench.xlsx", "bench.mat"])
def test_a_damaged_file_is_one_sentence(columns: Columns, tmp_path: Path, kind: str) -> None:
    path = tmp_path / kind
    KINDS[kind](path, columns)
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


@pytest.mark.parametrize("kind", ["bomb.mat", "bomb.h5", "bomb.tdms"])
def test_what_expands_to_too_much_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    path, nothing = tmp_path / kind, np.zeros(200_000)
    if kind.endswith("mat"):
        scipy.io.savemat(path, {"a": {"b": nothing}}, do_compression=True)
    elif kind.endswith("h5"):
        with h5py.File(path, "w") as file:
            file.create_dataset("a", data=nothing, compression="gzip")
    else:
        tdms(path, {"t": nothing[:50_000], "a": nothing[:50_000]}, waveform=False)
    monkeypatch.setattr(lab_tables, "_LARGEST", 700_000)
    if kind.endswith("tdms"):
        monkeypatch.setattr(lab_tables, "_start", lambda path: path.read_bytes()[:4096])
    with pytest.raises(RecordingError, match=r"holds more than 0\.7 MB"):
        lab_tables.read_table(path)

"""Recordings of instruments as MCAP, bags of ROS 2 and CSV: the same run whatever file it comes from."""

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.writer import Writer

import tenodesis as tn
from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.protocols import Cycles, Protocol
from tenodesis.recording import Recording, schemas
from tenodesis.recording.session import record
from tenodesis.signals import Array

PROTOCOL = Protocol(
    name="formats",
    phases=(Cycles(amplitude=np.radians(20), symmetric=True, speed=np.radians(60), count=1, force=0.5),),
)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("formats") / "run.mcap"
    record(tn.load("scaled-up"), PROTOCOL, path, seed=2)
    return path


@pytest.fixture(scope="module")
def recorded(log: Path) -> InstrumentRun:
    return read(log)


def read(path: Path, kind: str | None = None) -> InstrumentRun:
    loaded = FORMATS[kind or ("csv" if path.suffix == ".csv" else "mcap")].load(path)
    assert isinstance(loaded, InstrumentRun)
    return loaded


def same(one: InstrumentRun, other: InstrumentRun, tolerance: float = 0.0) -> bool:
    assert set(one.columns) == set(other.columns)
    columns = [(one.time, other.time), *((one[name], other[name]) for name in one.columns)]
    return all(np.allclose(a, b, rtol=0, atol=tolerance) for a, b in columns)


def table(path: Path, columns: dict[str, Array], separator: str = ",", cell: Callable[[float], str] = repr) -> Path:
    with path.open("w", newline="") as file:
        writer = csv.writer(file, delimiter=separator)
        writer.writerow(columns)
        for row in np.column_stack([*columns.values()]).tolist():
            writer.writerow("" if np.isnan(value) else cell(value) for value in row)
    return path


def headed(run: InstrumentRun, **changes: Array | None) -> dict[str, Array]:
    """Return a run under its columns' own names."""
    found: dict[str, Array | None] = {"time": run.time, **run.columns} | changes
    return {name: values for name, values in found.items() if values is not None}


# MCAP and bags


def test_a_recording_has_every_column_and_its_instrument(recorded: InstrumentRun, log: Path) -> None:
    run = Recording.open(log).run
    assert np.array_equal(recorded["handle_angle"], run["commanded_handle_angle"])
    assert np.array_equal(recorded["tension_antagonist"], run["measured_tension"][:, 1])
    assert recorded.instrument == tn.load("scaled-up")
    assert recorded.notes == ()
    assert recorded.time[0] == 0


def test_what_a_real_instrument_lacks_is_left_out(log: Path, tmp_path: Path) -> None:
    run = Recording.open(log).run
    bag = written(tmp_path / "real.mcap", run, leave=("/tip/measured2_js", "/handle/setpoint_js", "/rig/measured_cf"))
    loaded = read(bag)
    assert "measured_output_angle" not in loaded.columns
    assert np.array_equal(loaded["handle_angle"], loaded["measured_handle_angle"])
    assert "no force was recorded: the tip is taken to be free" in loaded.notes
    assert any("the handle is where its encoder says" in note for note in loaded.notes)
    assert loaded.instrument is None


def written(
    path: Path, run: tn.signals.Run, *, leave: tuple[str, ...] = (), part: slice = slice(None), late: int = 0
) -> Path:
    """Write a run as another program would: topics may each be stamped a little later than the one before."""
    with path.open("wb") as file:
        writer = Writer(file)
        for n, topic in enumerate(t for t in schemas.topics(("yaw",)) if t.name not in leave and t.name != "/time"):
            if topic.name.startswith(("/twin", "/controller")) or topic.name == "/motors/setpoint_js":
                continue
            definition = writer.register_msgdef(topic.type, schemas.definition(topic.type))
            for i in range(len(run))[part]:
                stamp = round(run.time[i] * 1e9) + n * late
                header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": topic.frame}
                if topic.type == schemas.JOINT_STATE:
                    message = {
                        "header": header,
                        "name": list(topic.joints),
                        "position": [],
                        "velocity": [],
                        "effort": [],
                    }
                    for field, signal in topic.signals.items():
                        message[field] = np.atleast_1d(run[signal][i] + 0.0).tolist()
                else:
                    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
                    force = zero | {field[-1]: float(run[signal][i]) for field, signal in topic.signals.items()}
                    message = {"header": header, "wrench": {"force": force, "torque": zero}}
                writer.write_message(topic.name, definition, message, log_time=stamp, publish_time=stamp, sequence=i)
        writer.finish()
    return path


def test_a_bag_in_parts_with_clocks_of_their_own_is_brought_together(log: Path, tmp_path: Path) -> None:
    run = Recording.open(log).run
    folder = tmp_path / "bag"
    folder.mkdir()
    half = len(run) // 2
    written(folder / "bag_0.mcap", run, part=slice(0, half), late=100_000)
    written(folder / "bag_1.mcap", run, part=slice(half, None), late=100_000)
    loaded = read(folder)
    assert any("stamps of their own" in note for note in loaded.notes)
    whole = read(log)
    assert abs(len(loaded) - len(whole)) < 5
    # brought to a clock 0.1 ms apart, a handle that turns at 1 rad/s is a tenth of a mrad off
    first = len(whole) - len(loaded)
    for name in ("handle_angle", "force"):
        assert min(
            np.abs(loaded[name] - whole[name][shift : shift + len(loaded)]).max() for shift in range(first + 1)
        ) < (2e-3 if name == "handle_angle" else 0.3)


def test_a_folder_without_recordings_and_a_file_that_is_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(IdentificationError, match="holds no MCAP file"):
        read(tmp_path, "mcap")
    (tmp_path / "text.mcap").write_text("no recording")
    with pytest.raises(IdentificationError, match="no MCAP file"):
        read(tmp_path / "text.mcap")


def test_a_recording_that_was_cut_off_says_so(log: Path, tmp_path: Path) -> None:
    part = tmp_path / "cut.mcap"
    part.write_bytes(log.read_bytes()[: 2 * log.stat().st_size // 3])
    loaded = read(part)
    assert any("is read up to" in note for note in loaded.notes)


# CSV


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


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ('handle = { column = "t", unit = "rad" }', "handle is no column; allowed are time, handle_angle"),
        ('time = "t"', "allowed is a table like"),
        ('time = { column = "x", unit = "s" }', "column is 'x'; allowed are 't'"),
        ('time = { column = "t", unit = "N" }', "the unit of time is 'N'"),
        ('time = { column = "t", unit = "quux" }', "the unit of time is 'quux'"),
        ('time = { column = "t", unit = "s", factor = 0 }', "factor is 0"),
        ("time = ", "is no TOML"),
        ('time = { column = "t", unit = "s" }', "lacks handle_angle, tension_agonist, tension_antagonist"),
    ],
)
def test_a_map_that_is_wrong_is_refused_with_the_reason(tmp_path: Path, line: str, reason: str) -> None:
    path = table(tmp_path / "run.csv", {"t": np.arange(5.0), "a": np.arange(5.0)})
    (tmp_path / "run.csv.columns.toml").write_text(line)
    with pytest.raises(IdentificationError, match=reason.replace("(", r"\(")):
        read(path)


def test_a_wrong_unit_is_told_by_the_magnitude_and_said(recorded: InstrumentRun, tmp_path: Path) -> None:
    columns = headed(recorded, handle_angle=np.degrees(recorded["handle_angle"]))
    columns |= {name: 1e3 * recorded[name] for name in ("tension_agonist", "tension_antagonist")}
    loaded = read(table(tmp_path / "run.csv", columns))
    assert same(loaded, recorded, 1e-9)
    assert any("handle_angle taken as deg, not rad" in note for note in loaded.notes)
    assert any("tension_agonist taken as mN, not N" in note for note in loaded.notes)


def test_an_implausible_column_is_refused(recorded: InstrumentRun, tmp_path: Path) -> None:
    columns = headed(recorded, handle_angle=1e6 * recorded["handle_angle"])
    with pytest.raises(IdentificationError, match=r"handle_angle .* fits no unit"):
        read(table(tmp_path / "run.csv", columns))


def test_headings_that_say_nothing_are_told_with_what_is_allowed(tmp_path: Path) -> None:
    path = table(tmp_path / "run.csv", {"t": np.arange(5.0), "a": np.arange(5.0)})
    with pytest.raises(IdentificationError, match=r"headings are 't', 'a'; allowed are .* run.csv.columns.toml"):
        read(path)
    (tmp_path / "empty.csv").write_text("")
    with pytest.raises(IdentificationError, match="is empty"):
        read(tmp_path / "empty.csv")
    with pytest.raises(IdentificationError, match="cannot be read"):
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


def test_a_sensor_that_was_not_recorded_is_left_out(recorded: InstrumentRun, tmp_path: Path) -> None:
    nothing = np.full(len(recorded), np.nan)
    loaded = read(table(tmp_path / "run.csv", headed(recorded, measured_output_angle=nothing)))
    assert "measured_output_angle" not in loaded.columns
    assert len(loaded) == len(recorded)


def test_a_handle_that_rests_and_too_few_samples_are_refused(recorded: InstrumentRun, tmp_path: Path) -> None:
    still = headed(recorded, handle_angle=np.zeros(len(recorded)))
    with pytest.raises(IdentificationError, match="no excitation: handle_angle"):
        read(table(tmp_path / "still.csv", still))
    short = {name: values[:50] for name, values in headed(recorded).items()}
    with pytest.raises(IdentificationError, match="too few"):
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

"""Claims about recordings: what is written comes back to the last bit, and stock tools read it."""

import errno
import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as StockWriter
from rich.console import Console

from tenodesis.errors import MissingExtraError, RecordingError
from tenodesis.recording import Blocks, Recorder, Recording
from tenodesis.recording.decode import Misfit
from tenodesis.recording.schemas import JOINT_STATE, WRENCH, definition
from tenodesis.recording.summary import contents, describe
from tenodesis.run import SIGNALS, Run, concatenate

from .conftest import refused
from .recording_samples import a_run, bits, recorded

AXES = [("yaw",), ("pitch",), ("yaw", "pitch")]


@pytest.mark.parametrize("axes", AXES)
def test_a_run_comes_back_bit_by_bit(axes: tuple[str, ...], tmp_path: Path) -> None:
    run = a_run(300, axes)
    recording = Recording.open(recorded(tmp_path / "run.mcap", run, chunk_seconds=0.02))
    assert recording.damage is None
    assert recording.left_out == {}
    assert recording.run.axes == axes
    assert bits(recording.run) == bits(run)


@pytest.mark.parametrize("name", SIGNALS)
def test_a_signal_alone_comes_back_alone(name: str, tmp_path: Path) -> None:
    run = a_run(3, ("yaw", "pitch"), names=[name])
    assert bits(Recording.open(recorded(tmp_path / "run.mcap", run)).run) == bits(run)


def test_blocks_come_back_as_one_run(tmp_path: Path) -> None:
    blocks = [a_run(1), a_run(7, start=1), a_run(0), a_run(25, start=8)]
    run = Recording.open(recorded(tmp_path / "run.mcap", *blocks, chunk_seconds=0.004)).run
    for name, (_, content) in bits(run).items():
        assert content == b"".join(bits(block)[name][1] for block in blocks), name


def test_equal_runs_make_equal_files(tmp_path: Path) -> None:
    first, second = (recorded(tmp_path / f"{i}.mcap", a_run(60)).read_bytes() for i in range(2))
    assert first == second


def test_time_comes_back_whatever_the_stamps_start_at(tmp_path: Path) -> None:
    run = replace(a_run(50), time=np.cumsum(np.random.default_rng(1).random(50)))
    path = recorded(tmp_path / "run.mcap", run, start_time=1_700_000_000_123_456_789)
    assert bits(Recording.open(path).run) == bits(run)
    with path.open("rb") as file:
        first = next(iter(make_reader(file).iter_messages()))[2]
    assert first.log_time == 1_700_000_000_123_456_789 + round(run.time[0] * 1e9)


def test_a_recording_without_rows_is_whole_and_empty(tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap", axes=("yaw", "pitch")):
        pass
    recording = Recording.open(tmp_path / "run.mcap")
    assert (len(recording.run), recording.run.axes, recording.damage) == (0, ("yaw", "pitch"), None)


def test_metadata_is_kept_and_gives_the_instrument(tmp_path: Path) -> None:
    text = (Path(__file__).parents[2] / "instruments" / "real-size.toml").read_text("utf-8")
    path = recorded(tmp_path / "run.mcap", a_run(2), metadata={"instrument": text, "seed": "3", "mine": "ä"})
    recording = Recording.open(path)
    assert recording.instrument().joint_type == "tendon-gear"
    named = {"joints": "yaw", "handle_joints": "handle_yaw", "tendons": "yaw_agonist yaw_antagonist"}
    assert {"seed": "3", "mine": "ä", "compensated": "yaw", **named}.items() <= recording.metadata.items()
    assert {"tenodesis", "python", "numpy"} <= recording.metadata.keys()
    with refused("instrument", kind=RecordingError, allowed="in the recording"):
        Recording.open(recorded(tmp_path / "bare.mcap", a_run(2))).instrument()


@pytest.mark.parametrize("axes", [("yaw",), ("yaw", "pitch")])
def test_stock_readers_decode_the_same_values(axes: tuple[str, ...], tmp_path: Path) -> None:
    run = a_run(20, axes)
    path = recorded(tmp_path / "run.mcap", run, metadata={"seed": "7"})
    messages: dict[str, list[Any]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            messages.setdefault(channel.topic, []).append(decoded)
            assert message.log_time == message.publish_time
        records = list(reader.iter_metadata())
        summary = reader.get_summary()
    assert [record.name for record in records] == ["tenodesis", "tenodesis.rows"]
    assert records[0].metadata["seed"] == "7"
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == 20 * len(messages)

    def values(topic: str, array: str) -> bytes:
        return np.array([getattr(message, array) for message in messages[topic]]).tobytes()

    first = messages["/tendons/measured_js"][3]
    assert first.name == [f"{axis}_{tendon}" for axis in axes for tendon in ("agonist", "antagonist")]
    assert (list(first.position), list(first.velocity)) == ([], [])
    assert (first.header.stamp.sec, first.header.stamp.nanosec) == (0, 1_500_000)
    for topic, array, signal_name in (
        ("/handle/measured_js", "position", "measured_handle_angle"),
        ("/handle/setpoint_js", "position", "commanded_handle_angle"),
        ("/motors/measured_js", "position", "measured_spool_angle"),
        ("/motors/setpoint_js", "velocity", "commanded_spool_velocity"),
        ("/tendons/measured_js", "effort", "measured_tension"),
        ("/tip/measured2_js", "position", "measured_output_angle"),
        ("/twin/handle/measured_js", "effort", "handle_torque"),
        ("/twin/tip/measured_js", "velocity", "output_velocity"),
        ("/twin/tendons/distal/measured_js", "effort", "distal_tension"),
        ("/twin/motors/measured_js", "position", "spool_angle"),
    ):
        assert values(topic, array) == run.signals()[signal_name].tobytes(), topic
    assert run.force is not None
    assert run.radial_force is not None
    for i, axis in enumerate(axes):
        topic = f"/rig/{axis}/measured_cf" if axes[1:] else "/rig/measured_cf"
        wrenches = [message.wrench.force for message in messages[topic]]
        force = [run.force.reshape(20, -1)[:, i], run.radial_force.reshape(20, -1)[:, i]]
        assert np.array([(wrench.x, wrench.z) for wrench in wrenches]).tobytes() == np.stack(force, 1).tobytes()


@pytest.mark.parametrize("axes", [("yaw",), ("yaw", "pitch")])
def test_messages_have_the_bytes_the_stock_writer_gives_them(axes: tuple[str, ...], tmp_path: Path) -> None:
    ours = recorded(tmp_path / "run.mcap", a_run(3, axes)).read_bytes()
    stream = io.BytesIO()
    stock = StockWriter(stream)
    known: dict[str, Any] = {}
    for schema, channel, message, decoded in make_reader(
        io.BytesIO(ours), decoder_factories=[DecoderFactory()]
    ).iter_decoded_messages():
        assert schema is not None
        if schema.name not in known:
            known[schema.name] = stock.register_msgdef(schema.name, schema.data.decode())
        stock.write_message(channel.topic, known[schema.name], decoded, message.log_time)
    stock.finish()

    def payloads(data: bytes) -> set[tuple[str, int, bytes]]:
        found = make_reader(io.BytesIO(data)).iter_messages()
        return {(channel.topic, message.log_time, message.data) for _, channel, message in found}

    assert payloads(ours) == payloads(stream.getvalue())


def test_a_path_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with refused("path", kind=RecordingError, allowed="in a folder that exists"):
        Recorder(tmp_path / "none" / "run.mcap", axes=("yaw",))
    with refused("path", kind=RecordingError):
        Recorder(tmp_path, axes=("yaw",), overwrite=True)


def test_a_file_is_overwritten_only_when_asked(tmp_path: Path) -> None:
    path = recorded(tmp_path / "run.mcap", a_run(5))
    before = path.read_bytes()
    with refused("path", kind=RecordingError, allowed="a path that does not exist, or overwrite"):
        Recorder(path, axes=("yaw",))
    assert path.read_bytes() == before
    recorded(path, a_run(9), overwrite=True)
    assert len(Recording.open(path).run) == 9


@pytest.mark.parametrize(
    ("second", "said"),
    [
        (a_run(5, start=2), "time of row 5"),
        (replace(a_run(2, start=9), time=np.array([1.0, np.nan])), "time of row 6 = nan"),
        (replace(a_run(2, start=9), force=None), "the runs before had force"),
        (replace(a_run(2, start=9), force=np.zeros(3)), r"force has shape \(3,\); it must have \(2,\)"),
        (a_run(2, ("pitch",), start=9), "joints are pitch; they must be yaw"),
    ],
)
def test_a_block_that_does_not_fit_is_refused_and_spoils_nothing(second: Run, said: str, tmp_path: Path) -> None:
    with Recorder(tmp_path / "run.mcap", axes=("yaw",)) as recorder:
        recorder.write(a_run(5))
        with pytest.raises(RecordingError, match=said):
            recorder.write(second)
        recorder.write(a_run(5, start=5))
    recording = Recording.open(tmp_path / "run.mcap")
    assert (len(recording.run), recording.damage) == (10, None)


def test_metadata_that_is_no_text_is_refused(tmp_path: Path) -> None:
    metadata: Any = {"seed": 7}
    with refused("seed", 7, kind=RecordingError):
        Recorder(tmp_path / "run.mcap", axes=("yaw",), metadata=metadata)
    assert not (tmp_path / "run.mcap").exists()


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "other"
    with refused("path", kind=RecordingError):
        Recording.open(path)
    path.write_bytes(b"")
    with refused("path", kind=RecordingError, allowed="an MCAP file"):
        Recording.open(path)
    path.write_text("time,force\na,b\n")
    with refused("path", kind=RecordingError, allowed="an MCAP file"):
        Recording.open(path)
    with refused("path", kind=RecordingError):
        Recording.open(tmp_path)
    stock(path, {"/camera": [joints(i, ["lens"]) for i in range(3)]})
    with refused("topics", kind=RecordingError):
        Recording.open(path)


def test_a_file_with_foreign_joints_only_is_refused_with_their_names(tmp_path: Path) -> None:
    path = stock(tmp_path / "other.mcap", {"/motors/measured_js": [joints(0, ["m1", "m2"], position=[1.0, 2.0])]})
    with refused("topics", kind=RecordingError):
        Recording.open(path)


def joints(stamp: int, names: list[str], frame: str = "", **arrays: list[float]) -> dict[str, Any]:
    sec, nanosec = divmod(stamp, 1_000_000_000)
    header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": frame}
    return {"header": header, "name": names, "position": [], "velocity": [], "effort": []} | arrays


def stock(path: Path, topics: dict[str, list[dict[str, Any]]], kind: str = JOINT_STATE) -> Path:
    with path.open("wb") as file, StockWriter(file) as writer:
        schema = writer.register_msgdef(kind, definition(kind))
        for topic, messages in topics.items():
            for i, message in enumerate(messages):
                writer.write_message(topic, schema, message, 1000 + i)
    return path


@pytest.mark.parametrize("frame", [["base"] * 4, ["a", "base", "", "a"]])
def test_another_programs_file_loads_what_fits(frame: list[str], tmp_path: Path) -> None:
    stamps = [1_700_000_000_000_000_000 + 2_000_000 * i for i in range(4)]
    names = ["pitch_antagonist", "spare", "pitch_agonist"]
    path = stock(
        tmp_path / "other.mcap",
        {
            "/handle/measured_js": [
                joints(stamp, ["handle_pitch"], frame[i], position=[0.1 * i], velocity=[9.0])
                for i, stamp in enumerate(stamps)
            ],
            "/tendons/measured_js": [
                joints(stamp, names, frame[i], effort=[1.0 * i, 7.0, 2.0 * i]) for i, stamp in enumerate(stamps[:3])
            ],
            "/tip/measured2_js": [joints(stamp + 1, ["tip_pitch"], position=[1.0]) for stamp in stamps],
            "/motors/measured_js": [joints(stamp, ["m1", "m2"], position=[1.0, 2.0]) for stamp in stamps],
            "/camera": [joints(stamp, ["lens"]) for stamp in stamps],
        },
    )
    recording = Recording.open(path)
    assert recording.damage is None
    assert recording.run.axes == ("pitch",)
    assert recording.run.time.tolist() == [0.0, 0.002, 0.004]
    arrays = {name: values.tolist() for name, values in recording.to_numpy().items() if name != "time"}
    assert arrays == {
        "measured_handle_angle": [0.0, 0.1, 0.2],
        "measured_tension": [[0.0, 0.0], [2.0, 1.0], [4.0, 2.0]],
    }
    reasons = {topic: left_out.reason for topic, left_out in recording.left_out.items()}
    assert reasons == {"/tip/measured2_js": Misfit.STAMPS, "/motors/measured_js": Misfit.JOINTS}
    assert recording.topics["/camera"].messages == 4
    topics = json.loads(json.dumps(contents(recording)))["topics"]
    left_out = {name: topic["left_out"] for name, topic in topics.items() if topic["left_out"] is not None}
    assert left_out == {topic: why.text for topic, why in recording.left_out.items()}


def test_messages_of_another_type_are_left_out_with_the_reason(tmp_path: Path) -> None:
    header = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    wrench = {
        "header": header,
        "wrench": {"force": {"x": 1.5, "y": 0.0, "z": 2.5}, "torque": dict.fromkeys("xyz", 0.0)},
    }
    path = stock(tmp_path / "rig.mcap", {"/rig/measured_cf": [wrench]}, WRENCH)
    arrays = {name: values.tolist() for name, values in Recording.open(path).to_numpy().items()}
    assert arrays == {"time": [0.0], "force": [1.5], "radial_force": [2.5]}
    # Of another's bag, which has the estimate as a wrench alone.
    path = stock(tmp_path / "force.mcap", {"/controller/measured_cf": [wrench]}, WRENCH)
    assert Recording.open(path).run["estimated_force"].tolist() == [1.5]
    path = tmp_path / "mixed.mcap"
    with path.open("wb") as file, StockWriter(file) as writer:
        text = writer.register_msgdef("std_msgs/msg/String", "string data\n")
        writer.write_message("/tendons/measured_js", text, {"data": "12 N"}, 1)
        state = writer.register_msgdef(JOINT_STATE, definition(JOINT_STATE))
        writer.write_message("/handle/measured_js", state, joints(0, ["handle_yaw"], position=[0.5]), 1)
    recording = Recording.open(path)
    assert recording.left_out == {"/tendons/measured_js": (Misfit.TYPE, "its messages are std_msgs/msg/String")}
    assert recording.run.measured_handle_angle is not None


@pytest.mark.parametrize("axes", [("yaw",), ("yaw", "pitch")])
def test_tables_hold_the_values_to_the_last_bit(axes: tuple[str, ...], tmp_path: Path) -> None:
    run = a_run(20, axes)
    recording = Recording.open(recorded(tmp_path / "run.mcap", run))
    table = recording.to_pandas()
    recording.to_csv(tmp_path / "run.csv")
    recording.to_parquet(tmp_path / "run.parquet")
    csv = pd.read_csv(tmp_path / "run.csv", index_col=0, float_precision="round_trip")
    for read in (table, csv, pd.read_parquet(tmp_path / "run.parquet")):
        pd.testing.assert_frame_equal(read, table, check_exact=True)
        assert read.index.name == "time [s]"
        assert read.index.tolist() == run.time.tolist()
    assert run.measured_tension is not None
    last = f"measured_tension.{axes[-1]}.antagonist [N]"
    np.testing.assert_array_equal(table[last], run.measured_tension[:, -1])
    assert {"handle_torque.yaw [N*m]", "wrench.my [N*m]", "grip_force [N]"} <= {*table.columns}


def test_tables_are_written_whole_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording.open(recorded(tmp_path / "run.mcap", a_run(20)))
    target = tmp_path / "run.csv"
    target.write_text("before")

    def fails(path: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", fails)
        for write in (recording.to_csv, recording.to_parquet):
            with refused("path", kind=RecordingError):
                write(target)
    assert target.read_text() == "before"
    assert {path.name for path in tmp_path.iterdir()} == {"run.mcap", "run.csv"}
    with refused("path", kind=RecordingError):
        recording.to_csv(tmp_path / "none" / "run.csv")


def test_without_pandas_tables_say_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = Recording.open(recorded(tmp_path / "run.mcap", a_run(2)))
    monkeypatch.setitem(sys.modules, "pandas", None)
    with refused("module", "pandas", kind=MissingExtraError):
        recording.to_pandas()
    recording.to_csv(tmp_path / "run.csv")


def test_a_description_says_what_is_in_the_file(tmp_path: Path) -> None:
    run = Run(np.arange(5) / 2000, ("yaw",), measured_handle_angle=np.radians([0, 10, -20, np.nan, 5.0]))
    metadata = {"seed": "7", "protocol": 'name = "friction"\nsteps = 3'}
    console = Console(width=200, record=True, file=io.StringIO())
    console.print(describe(Recording.open(recorded(tmp_path / "run.mcap", run, metadata=metadata))))
    recorded(tmp_path / "cut.mcap", a_run(60), chunk_seconds=0.005)
    (tmp_path / "cut.mcap").write_bytes((tmp_path / "cut.mcap").read_bytes()[:-5000])
    console.print(describe(Recording.open(tmp_path / "cut.mcap")))
    text = " ".join(console.export_text().split())
    for said in (
        "instrument not recorded",
        "protocol friction",
        "seed 7",
        "rate 2000 Hz",
        "/handle/measured_js 5 2000 sensor_msgs/msg/JointState",
        "measured_handle_angle.yaw -20 10 deg",
        "cut.mcap is read up to",
    ):
        assert said in text


@pytest.mark.parametrize("every", [1, 7])
def test_blocks_are_the_recording(every: int, tmp_path: Path) -> None:
    run = a_run(9000)
    path = recorded(tmp_path / "run.mcap", run)
    whole = Recording.open(path).run
    blocks = Blocks(path, every=every)
    parts = list(blocks)
    assert len(parts) > 1
    assert bits(concatenate(parts)) == bits(run.rows(step=every))
    assert blocks.damage is None
    some = Recording.open(path, signals=["measured_tension"], every=every).run
    assert set(some.signals()) == {"measured_tension"}
    assert some["measured_tension"].tobytes() == whole.rows(step=every)["measured_tension"].tobytes()

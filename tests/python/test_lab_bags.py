"""Bags of ROS 1 and 2 with topics and joints of other names: shown, mapped, and identified from as the export is."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rosbags import rosbag1, rosbag2
from rosbags.typesys import Stores, get_typestore

from tenodesis.errors import MissingExtraError, RecordingError
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.recording import Recording, lab_map
from tenodesis.run import Array

from .recording_files import read

JOINTS = {
    "/MTM/setpoint_js": ("position", ("handle_angle",)),
    "/MTM/measured_js": ("position", ("measured_handle_angle",)),
    "/PSM/output/measured_js": ("position", ("measured_output_angle",)),
    "/PSM/tendons/measured_js": ("effort", ("tension_agonist", "tension_antagonist")),
}
WRENCH = "/PSM/tip/measured_cf"


def bag(path: Path, columns: dict[str, Array], *, storage: str = "", shifted: float = 0.0) -> Path:
    """Write a bag as a robot's controller would: ROS 1, or ROS 2 by a storage plugin; the wrench may come later."""
    store = get_typestore(Stores.ROS2_HUMBLE if storage else Stores.ROS1_NOETIC)
    types = store.types
    joint_state, wrench_stamped = types["sensor_msgs/msg/JointState"], types["geometry_msgs/msg/WrenchStamped"]
    number = {} if storage else {"seq": 0}

    def header(time: float) -> tuple[int, object]:
        stamp = 1_700_000_000_000_000_000 + round(time * 1e9)
        clock = types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
        return stamp, types["std_msgs/msg/Header"](stamp=clock, frame_id="base", **number)

    def write(writer: object, kind: str, topic: str, messages: list[tuple[int, object]]) -> None:
        connection = writer.add_connection(topic, kind, typestore=store)  # type: ignore[attr-defined]
        pack = store.serialize_cdr if storage else store.serialize_ros1
        for stamp, message in messages:
            writer.write(connection, stamp, pack(message, kind))  # type: ignore[attr-defined]

    made = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage]) if storage else None
    with made or rosbag1.Writer(path) as writer:
        for topic, (field, names) in JOINTS.items():
            rows = np.stack([columns[name] for name in names], axis=1)
            nothing = np.empty(0)
            messages = []
            for time, row in zip(columns["time"], rows, strict=True):
                stamp, head = header(time)
                arrays = {"position": nothing, "velocity": nothing, "effort": nothing} | {field: row}
                joints = [f"wire_{at}" for at in (1, 2)] if names[1:] else ["jaw"]
                messages.append((stamp, joint_state(header=head, name=joints, **arrays)))
            write(writer, "sensor_msgs/msg/JointState", topic, messages)
        vector, wrench = types["geometry_msgs/msg/Vector3"], types["geometry_msgs/msg/Wrench"]
        messages = []
        for time, force in zip(columns["time"] + shifted, columns["force"], strict=True):
            stamp, head = header(time)
            push = wrench(force=vector(x=force, y=0.0, z=0.0), torque=vector(x=0.0, y=0.0, z=0.0))
            messages.append((stamp, wrench_stamped(header=head, wrench=push)))
        write(writer, "geometry_msgs/msg/WrenchStamped", WRENCH, messages)
    return path


@pytest.fixture(scope="module")
def columns(recorded: InstrumentRun) -> dict[str, Array]:
    return {"time": recorded.time, **recorded.columns}


@pytest.mark.parametrize(("name", "storage"), [("run.bag", ""), ("run_db3", "SQLITE3"), ("run_mcap", "MCAP")])
def test_a_bag_of_other_names_is_shown_mapped_and_read_as_the_recording(
    tenodesis: Callable[..., tuple[int, str, str]],
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
    expected = np.interp(columns["time"], columns["time"] + 0.2e-3, columns["force"])
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


def test_a_text_without_rows_of_numbers_gets_no_map(
    tenodesis: Callable[..., tuple[int, str, str]], tmp_path: Path
) -> None:
    (tmp_path / "README.md").write_text("# Bench, notes\nOne, two\nand three\n")
    code, _, errors = tenodesis("map", "README.md")
    assert code == 1
    assert "holds no rows of numbers" in errors.replace("\n", " ")
    assert [one.name for one in tmp_path.iterdir()] == ["README.md"]

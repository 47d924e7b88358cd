"""Recordings of instruments as MCAP and ROS 2 bags: the same run whatever file it comes from."""

import sqlite3
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.writer import Writer

import tenodesis as tn
from tenodesis.errors import IdentificationError
from tenodesis.identification import measured
from tenodesis.identification.formats import mcap
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.recording import Recording, blocks, container, schemas
from tenodesis.run import Names, Run

from .conftest import refused
from .recording_files import read, same


def test_a_recording_has_every_column_and_its_instrument(recorded: InstrumentRun, log: Path) -> None:
    run = Recording.open(log).run
    assert np.array_equal(recorded["handle_angle"], run["commanded_handle_angle"])
    assert np.array_equal(recorded["tension_antagonist"], run["measured_tension"][:, 1])
    assert recorded.instrument == tn.load("scaled-up")
    assert recorded.notes == ()
    assert recorded.time[0] == 0


def test_a_run_needs_no_file(recorded: InstrumentRun, log: Path) -> None:
    run = measured(Recording.open(log).run, "scaled-up", name="run.mcap")
    assert (run.notes, run.instrument) == (recorded.notes, recorded.instrument)
    assert np.array_equal(run.time, recorded.time)
    assert run.columns.keys() == recorded.columns.keys()
    assert all(np.array_equal(run[name], recorded[name]) for name in run.columns)
    with refused("signals", kind=IdentificationError):
        measured(Run(run.time, ("yaw",)))


def test_what_a_real_instrument_lacks_is_left_out(log: Path, tmp_path: Path) -> None:
    run = Recording.open(log).run
    bag = written(tmp_path / "real.mcap", run, leave=("/tip/measured2_js", "/handle/setpoint_js", "/rig/measured_cf"))
    loaded = read(bag)
    assert "measured_output_angle" not in loaded.columns
    assert np.array_equal(loaded["handle_angle"], loaded["measured_handle_angle"])
    assert "no force was recorded: the tip is taken to be free" in loaded.notes
    assert any("the handle angle is that of its encoder" in note for note in loaded.notes)
    assert loaded.instrument is None


def written(
    path: Path,
    run: tn.run.Run,
    *,
    leave: tuple[str, ...] = (),
    part: slice = slice(None),
    late: int = 0,
    short: str = "",
) -> Path:
    """Write a run as another program would: each topic a little later than the one before, one ending early."""
    with path.open("wb") as file:
        writer = Writer(file)
        all_topics = schemas.topics(Names.paired(["yaw"]))
        for n, topic in enumerate(t for t in all_topics if t.name not in leave and t.name != "/time"):
            if topic.name.startswith(("/twin", "/controller")) or topic.name == "/motors/setpoint_js":
                continue
            if not set(topic.signals.values()) <= run.signals().keys():
                continue
            definition = writer.register_msgdef(topic.type, schemas.definition(topic.type))
            for i in range(len(run))[part][: -100 if topic.name == short else None]:
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


@pytest.mark.slow
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
    with refused("path", kind=IdentificationError):
        read(tmp_path, "mcap")
    (tmp_path / "bag_0.db3.zstd").write_bytes(b"")
    with refused("path", kind=IdentificationError):
        read(tmp_path, "mcap")
    (tmp_path / "text.mcap").write_text("no recording")
    with refused("path", kind=IdentificationError, allowed="an MCAP file"):
        read(tmp_path / "text.mcap")


def test_a_recording_that_was_cut_off_says_so(log: Path, tmp_path: Path) -> None:
    part = tmp_path / "cut.mcap"
    part.write_bytes(log.read_bytes()[: 2 * log.stat().st_size // 3])
    loaded = read(part)
    assert any("is read up to" in note for note in loaded.notes)


# SQLite


Messages = list[container.Message]


def as_sqlite(
    source: Path, path: Path, *, more: str = "", edit: dict[str, Callable[[Messages], Messages]] | None = None
) -> Path:
    """Write the messages of an MCAP file, those of some topics edited, into the tables of a bag as ROS 2 has them."""
    with blocks.opened(source) as (file, size):
        contents, edits = container.contents_of(file, size), edit or {}
    bag = sqlite3.connect(path)
    bag.execute(
        "CREATE TABLE topics (id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
    )
    bag.execute(
        "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
        "data BLOB NOT NULL)"
    )
    bag.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    bag.execute("INSERT INTO topics VALUES (99, '/camera', 'sensor_msgs/msg/Image', 'cdr', '')")
    bag.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (99, 0, x'00010000')")
    for number, channel in contents.channels.items():
        kind = contents.schemas[channel.schema_id].name
        bag.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (number, channel.topic, kind))
        bag.executemany(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)",
            [(number, one.stamp, one.data) for one in edits.get(channel.topic, list)(list(contents.messages[number]))],
        )
    bag.commit()
    if more:
        bag.executescript(more)
    bag.commit()
    bag.close()
    return path


@pytest.fixture(scope="module")
def plain(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording as another program would write it, all topics with the same stamps."""
    return written(tmp_path_factory.mktemp("plain") / "run.mcap", Recording.open(log).run)


def test_a_bag_in_sqlite_is_the_recording(plain: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  storage_identifier: sqlite3\n")
    file = as_sqlite(plain, folder / "bag_0.db3")
    file.chmod(0o444)
    whole = read(plain)
    for path in (folder, file):
        loaded = read(path)
        assert same(loaded, whole, 1e-12)
        assert loaded.name == path.name
        assert loaded.notes == whole.notes == ()
    assert not list(folder.glob("*-wal"))


def test_a_bag_in_sqlite_in_two_parts_is_brought_together(plain: Path, tmp_path: Path) -> None:
    whole = read(plain)
    half = len(whole) // 2
    folder = tmp_path / "bag"
    folder.mkdir()
    # the tenth part comes before the second by its name
    topics = [topic.name for topic in schemas.topics(Names.paired(["yaw"]))]
    as_sqlite(plain, folder / "bag_2.db3", edit=dict.fromkeys(topics, lambda all_: all_[:half]))
    as_sqlite(plain, folder / "bag_10.db3", edit=dict.fromkeys(topics, lambda all_: all_[half:]))
    loaded = read(folder)
    assert same(loaded, whole, 1e-12)
    assert loaded.notes == ()


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        ("DROP TABLE topics", "cannot be read as a bag of ROS 2: no such table: topics"),
        ("DELETE FROM topics WHERE name = '/tendons/measured_js'", "lacks measured_tension; its topics are"),
        ("UPDATE topics SET type = 'std_msgs/msg/String' WHERE name LIKE '/tendons%'", "lacks measured_tension"),
        ("DELETE FROM messages", "lacks measured_tension; its topics are none of these"),
    ],
)
def test_a_bag_in_sqlite_that_is_none_is_refused(plain: Path, tmp_path: Path, more: str, reason: str) -> None:
    with pytest.raises(IdentificationError, match=reason):
        read(as_sqlite(plain, tmp_path / "bag.db3", more=more), "mcap")


def test_a_bag_in_sqlite_that_is_packed_or_torn_is_refused(plain: Path, tmp_path: Path) -> None:
    packed = {"/tendons/measured_js": lambda all_: [one._replace(data=b"\x28\xb5\x2f\xfd" + one.data) for one in all_]}
    with refused("path", kind=IdentificationError, allowed="a bag of plain messages"):
        read(as_sqlite(plain, tmp_path / "packed.db3", edit=packed), "mcap")
    torn = as_sqlite(plain, tmp_path / "torn.db3")
    data = bytearray(torn.read_bytes())
    torn.write_bytes(data[: len(data) // 2])
    with refused("path", kind=IdentificationError):
        read(torn, "mcap")


def test_a_bag_in_sqlite_with_a_bad_page_is_read_up_to_it_and_says_so(plain: Path, tmp_path: Path) -> None:
    whole = read(plain)
    # messages by turns of their topics, as they arrive, and not topic by topic
    turns = (
        "CREATE TABLE sorted AS SELECT * FROM messages ORDER BY timestamp; DELETE FROM messages; "
        "INSERT INTO messages (topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM sorted; "
        "DROP TABLE sorted; VACUUM"
    )
    path = as_sqlite(plain, tmp_path / "bag.db3", more=turns)
    data = bytearray(path.read_bytes())
    page = len(data) // 2 // 4096 * 4096
    data[page : page + 4096] = b"\xff" * 4096
    path.write_bytes(data)
    loaded = read(path, "mcap")
    assert 0.1 * len(whole) < len(loaded) < 0.9 * len(whole)
    assert loaded["tension_agonist"] == pytest.approx(whole["tension_agonist"][: len(loaded)], abs=1e-12)
    assert any(note.startswith("bag.db3 is read in part only: ") for note in loaded.notes)


def test_two_kinds_of_files_in_a_bag_are_refused(plain: Path, tmp_path: Path) -> None:
    as_sqlite(plain, tmp_path / "run.db3")
    (tmp_path / "run.mcap").write_bytes(plain.read_bytes())
    with refused("path", kind=IdentificationError, allowed="a bag of one kind, or one of its files"):
        read(tmp_path, "mcap")


def test_a_type_that_is_not_known_is_said(plain: Path, tmp_path: Path) -> None:
    more = "UPDATE topics SET type = 'sensor_msgs/msg/Imu' WHERE name = '/tip/measured2_js'"
    loaded = read(as_sqlite(plain, tmp_path / "bag.db3", more=more), "mcap")
    assert "measured_output_angle" not in loaded.columns
    assert "/tip/measured2_js is left out of bag.db3: its messages are sensor_msgs/msg/Imu" in loaded.notes


# Topics with clocks of their own


HANDLE = "/handle/setpoint_js"


def test_messages_that_came_twice_or_out_of_order_are_left_out_and_said(plain: Path, tmp_path: Path) -> None:
    whole = read(plain)
    edit = {HANDLE: lambda all_: [*all_[:500], *all_[480:500], all_[501], all_[500], all_[500], *all_[502:]]}
    loaded = read(as_sqlite(plain, tmp_path / "a.db3", edit=edit), "mcap")
    assert f"{HANDLE}: dropped 1 row: duplicates of the row before, first at time 0.25" in loaded.notes
    assert any(f"{HANDLE}: dropped 21 rows: out of order (the clock ran back" in note for note in loaded.notes)
    assert len(loaded) == len(whole)
    assert loaded["handle_angle"] == pytest.approx(whole["handle_angle"], abs=1e-3)
    back = {HANDLE: lambda all_: [*all_[1000:], *all_[:1000]]}
    with refused("time", 1000, kind=IdentificationError):
        read(as_sqlite(plain, tmp_path / "b.db3", edit=back), "mcap")


@pytest.mark.slow
def test_a_gap_in_one_topic_is_not_filled_in(plain: Path, tmp_path: Path) -> None:
    whole = read(plain)
    loaded = read(as_sqlite(plain, tmp_path / "a.db3", edit={HANDLE: lambda all_: all_[:1000] + all_[1200:]}), "mcap")
    assert len(loaded) == len(whole) - 200
    assert any("1 gap of 0.1" in note for note in loaded.notes)
    kept = np.isin(np.round(whole.time, 6), np.round(loaded.time, 6))
    assert loaded["handle_angle"] == pytest.approx(whole["handle_angle"][kept], abs=1e-9)
    # one message lost is no gap
    loaded = read(as_sqlite(plain, tmp_path / "b.db3", edit={HANDLE: lambda all_: all_[:1000] + all_[1001:]}), "mcap")
    assert len(loaded) == len(whole)
    with refused("gaps", kind=IdentificationError):
        read(as_sqlite(plain, tmp_path / "c.db3", edit={HANDLE: lambda all_: all_[:500] + all_[2000:]}), "mcap")


def test_a_tendon_without_a_joint_of_its_own_is_said(plain: Path, tmp_path: Path) -> None:
    edit = {
        "/motors/measured_js": lambda all_: [
            one._replace(data=one.data.replace(b"yaw_antagonist", b"yaw_anything__")) for one in all_
        ]
    }
    loaded = read(as_sqlite(plain, tmp_path / "a.db3", edit=edit), "mcap")
    assert "spool_agonist" not in loaded.columns
    assert "/motors/measured_js is left out: its joints are yaw_agonist, yaw_anything__" in loaded.notes


def test_stamps_are_seconds_whatever_their_interval(plain: Path, tmp_path: Path) -> None:
    slow = {topic.name: lambda all_: all_[::1300] for topic in schemas.topics(Names.paired(["yaw"]))}
    with refused("time", 0.65, kind=IdentificationError):
        read(as_sqlite(plain, tmp_path / "a.db3", edit=slow), "mcap")


def test_topics_that_end_apart_are_said(log: Path, tmp_path: Path) -> None:
    run = Recording.open(log).run
    path = written(tmp_path / "short.mcap", run, part=slice(0, 1500), short="/handle/measured_js")
    loaded = read(path)
    assert len(loaded) == 1400
    assert "topics do not end together: the first 1400 of up to 1500 rows are taken" in loaded.notes


def test_a_long_recording_is_not_read_beyond_the_rows_that_are_taken(
    recorded: InstrumentRun, log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torn = tmp_path / "torn.mcap"
    torn.write_bytes(log.read_bytes()[:-2000])
    assert "is read up to" in read(torn).notes[0]
    monkeypatch.setattr(blocks, "LEAST_ROWS", 300)
    monkeypatch.setattr(mcap, "MOST_ROWS", 600)
    loaded = read(torn)
    assert 600 <= len(loaded) < len(recorded) / 2
    assert loaded.notes == (f"it is long: its first {loaded.time[-1]:.4g} s are taken",)
    assert np.array_equal(loaded["tension_agonist"], recorded["tension_agonist"][: len(loaded)])

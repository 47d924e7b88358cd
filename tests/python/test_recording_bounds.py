"""Claims about recordings that inflate or compute: what they take is bounded by their size, and they are named."""

import os
import sqlite3
import struct
import time
import tracemalloc
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import MCAP0_MAGIC

from tenodesis.errors import IdentificationError, RecordingError
from tenodesis.identification.formats import mcap
from tenodesis.recording import Recording, blocks, container
from tenodesis.recording.inflate import LARGEST_CHUNK, Allowance, InflationError, inflate

from .conftest import refused
from .recording_samples import a_run, recorded
from .test_formats_mcap import as_sqlite

MESSAGE = struct.pack("<BQHIQQ", Opcode.MESSAGE, 22, 1, 0, 0, 0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded(tmp_path_factory.mktemp("whole") / "run.mcap", a_run(60))


def chunk(content: bytes, size: int | None = None, compression: str = "zstd") -> bytes:
    """Return the record of a chunk that says it holds so many bytes."""
    packed = zstandard.compress(content) if compression == "zstd" else lz4.frame.compress(content)
    stated = len(content) if size is None else size
    name = compression.encode()
    body = struct.pack("<QQQII", 0, 0, stated, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    return struct.pack("<BQ", Opcode.CHUNK, len(body)) + body


def with_chunk(whole: Path, path: Path, record: bytes) -> Path:
    """Write a recording whose first chunk is replaced, and followed by nothing."""
    data = whole.read_bytes()
    summary = make_reader(BytesIO(data)).get_summary()
    assert summary is not None
    path.write_bytes(data[: summary.chunk_indexes[0].chunk_start_offset] + record)
    return path


def _contents(data: bytes) -> container.Contents:
    return container.contents_of(BytesIO(data), len(data))


def damage(path: Path) -> str:
    contents = _contents(path.read_bytes())
    assert contents.damage is not None
    return contents.damage


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize(
    ("content", "size", "says"),
    [
        (bytes(10**6), None, "corrupted"),
        (bytes(10**6), LARGEST_CHUNK + 1, "it must hold at most 268 MB"),
        (MESSAGE * 60_000, None, "records of less than 2 bytes"),
        (MESSAGE, 10**8, "inflates the file to more than 48 times its size"),
        (MESSAGE * 1000, 30, "corrupted|holds more than the 30 bytes"),
        (MESSAGE, 10**6, "corrupted"),
    ],
)
def test_a_chunk_that_inflates_is_read_no_further(
    whole: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    compression: str,
    content: bytes,
    size: int | None,
    says: str,
) -> None:
    monkeypatch.setattr("tenodesis.recording.inflate._FREE_RECORDS", 1000)
    path = with_chunk(whole, tmp_path / "bomb.mcap", chunk(content, size, compression))
    assert path.stat().st_size < 200_000
    begun = time.process_time()
    tracemalloc.start()
    found = damage(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert any(part in found for part in says.split("|"))
    assert most < 250e6
    assert time.process_time() - begun < 20
    print(f"{says}: {most / 1e6:.0f} MB, {time.process_time() - begun:.1f} s")


def test_many_chunks_together_inflate_no_further_than_one(whole: Path, tmp_path: Path) -> None:
    records = chunk(struct.pack("<BQ", 0x80, 10**7) + bytes(10**7)) * 5
    assert "inflates the file to more than 48 times" in damage(with_chunk(whole, tmp_path / "bomb.mcap", records))


def test_what_recordings_hold_is_well_within_the_allowance() -> None:
    """Constant signals compress best."""
    allowance = Allowance(1_000_000)
    allowance.take_bytes(30_000_000 + 32_000_000)
    for _ in range(250_000):
        allowance.take_records(1)
    rows = np.zeros(100_000).tobytes()
    assert inflate(zstandard.compress(rows), "zstd", len(rows), allowance) == rows
    with pytest.raises(InflationError, match="48 times"):
        allowance.take_bytes(48_000_000)


def test_messages_of_a_channel_that_is_not_described_are_left_out_and_named(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "strange.mcap"
    strange = MESSAGE.replace(struct.pack("<H", 1), struct.pack("<H", 999), 1)
    data = whole.read_bytes()
    path.write_bytes(data[:8] + chunk(strange) + data[8:])
    assert len(Recording.open(path).run) == 60
    notes: list[str] = []
    assert mcap._topics([path], notes)
    assert f"{path.name} holds messages of a channel that it does not describe: 999" in notes


@pytest.mark.parametrize(
    "event",
    [b'{{"event": "x", "time": 0.1}', b'{"event": "x", "tine": 0.1}', b'{"event": "x", "time": "a"}', b"[]", b"\xff"],
)
def test_an_event_that_cannot_be_read_is_none(event: bytes) -> None:
    assert blocks.as_event(struct.pack("<4sI", b"\0\1\0\0", len(event) + 1) + event + b"\0") is None


@pytest.mark.parametrize("name", ["pipe.mcap", "folder.mcap", "absent.mcap"])
def test_what_is_no_regular_file_is_not_opened(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / "pipe.mcap")
    (tmp_path / "folder.mcap").mkdir()
    with refused("path", kind=RecordingError):
        Recording.open(tmp_path / name)


def endless(columns: str) -> str:
    return (
        "WITH RECURSIVE counted(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM counted) "
        f"SELECT n AS id, {columns} FROM counted"
    )


TOPICS = "'/time' AS name, 'std_msgs/msg/Float64' AS type, 'cdr' AS serialization_format"


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ("DROP TABLE messages", "no such table: messages"),
        ("ALTER TABLE messages RENAME COLUMN data TO x", "no such column: data"),
        ("UPDATE messages SET data = 'text'", "has no stamp or no data"),
        ("UPDATE messages SET timestamp = 'text'", "has no stamp or no data"),
        ("UPDATE topics SET type = x'ff'", "a row of its topics has no number, name, type and format"),
        (
            f"DROP TABLE messages; CREATE VIEW messages AS {endless('n % 9 AS topic_id, n AS timestamp, x AS data')}",
            "no such column: x",
        ),
        (
            "DROP TABLE messages; CREATE VIEW messages AS "
            + endless("n % 9 AS topic_id, n AS timestamp, zeroblob(9) AS data"),
            "read in part only: interrupted",
        ),
        (
            "DROP TABLE messages; CREATE VIEW messages AS "
            "SELECT 1 AS id, id AS topic_id, 1 AS timestamp, zeroblob(900000000) AS data FROM topics",
            "too big",
        ),
        (f"DROP TABLE topics; CREATE VIEW topics AS {endless(TOPICS)}", "interrupted"),
    ],
)
def test_a_bag_that_is_damaged_or_computes_is_named_and_takes_no_more_than_its_size(
    whole: Path, tmp_path: Path, more: str, says: str
) -> None:
    begun = time.process_time()
    with pytest.raises(IdentificationError, match=says) as caught:
        mcap.load(as_sqlite(whole, tmp_path / "bag.db3", more=more))
    assert "\n" not in str(caught.value)
    assert time.process_time() - begun < 20


def test_a_bag_with_any_bytes_wrong_is_read_or_refused(whole: Path, tmp_path: Path) -> None:
    path = as_sqlite(whole, tmp_path / "bag.db3")
    data, rng = path.read_bytes(), np.random.default_rng(11)

    def check(change: Callable[[bytearray], None]) -> None:
        torn = bytearray(data)
        change(torn)
        path.write_bytes(torn)
        try:
            mcap.load(path)
        except IdentificationError as problem:
            assert "bag.db3" in str(problem)

    def spoil(torn: bytearray) -> None:
        for place in rng.integers(0, len(torn), 20):
            torn[place] = int(rng.integers(0, 256))

    for _ in range(40):
        check(spoil)
    for end in range(100, len(data), len(data) // 10):
        check(lambda torn, end=end: torn.__delitem__(slice(end, None)))  # type: ignore[misc]


def test_a_bag_that_is_whole_is_read_within_its_allowance(whole: Path, tmp_path: Path) -> None:
    path = as_sqlite(whole, tmp_path / "bag.db3")
    with sqlite3.connect(path) as bag:
        (count,) = bag.execute("SELECT count(*) FROM messages").fetchone()
    contents = mcap._contents(path)
    assert contents.damage is None
    assert sum(map(len, contents.messages.values())) > 0.5 * count
    assert MCAP0_MAGIC not in path.read_bytes()


def test_chunks_do_not_each_cost_what_all_schemas_do(tmp_path: Path) -> None:
    def record(opcode: int, body: bytes) -> bytes:
        return struct.pack("<BQ", opcode, len(body)) + body

    schemas = b"".join(record(Opcode.SCHEMA, struct.pack("<HIII", n, 0, 0, 0)) for n in range(1, 60_000))
    empty = record(Opcode.CHUNK, struct.pack("<QQQIIQ", 0, 0, 0, 0, 0, 0))
    data = MCAP0_MAGIC + schemas + 1000 * empty
    begin = time.process_time()
    _contents(MCAP0_MAGIC + schemas)
    between = time.process_time()
    _contents(data)
    assert time.process_time() - between < 0.5 + 3 * (between - begin)

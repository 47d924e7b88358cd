"""Claims about the writer of chunks: its files are those of the library, byte by byte."""

import io
from typing import Any

import numpy as np
import pytest
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer

from tenodesis.recording.chunks import ChunkedFile

SIZES = {1: 5, 2: 12, 3: 4}


def stock(stream: Any) -> Writer:
    writer = Writer(stream, chunk_size=2**62, enable_data_crcs=True)
    writer.start("ros2", "tenodesis")
    return writer


@pytest.mark.parametrize("seed", range(3))
def test_files_are_those_of_the_library_byte_by_byte(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ours, theirs = io.BytesIO(), io.BytesIO()
    mine, other = ChunkedFile(ours, "ros2", "tenodesis"), stock(theirs)
    for writer in (mine, other):
        writer.add_metadata("tenodesis", {"axes": "yaw", "mine": "ä"})
    schemas = [mine.add_schema(f"s{n}", SchemaEncoding.ROS2, bytes(n)) for n in range(2)]
    assert schemas == [other.register_schema(f"s{n}", SchemaEncoding.ROS2, bytes(n)) for n in range(2)]
    for channel in SIZES:
        entry = (f"/{channel}", MessageEncoding.CDR, schemas[channel % 2], {"signals": "x y"})
        assert mine.add_channel(*entry) == other.register_channel(*entry) == channel
    sequence = 0
    for _ in range(30):
        count = int(rng.integers(1, 40))
        channels = rng.permutation([*SIZES])[: rng.integers(1, 4)].tolist()
        stamps = rng.integers(0, 2**61, count)
        blocks = {channel: rng.bytes(count * SIZES[channel]) for channel in channels}
        mine.add_rows(stamps, np.arange(sequence, sequence + count), blocks)
        for row, stamp in enumerate(stamps.tolist()):
            for channel in channels:
                size = SIZES[channel]
                data = blocks[channel][row * size : (row + 1) * size]
                other.add_message(channel, stamp, data, stamp, sequence + row)
        sequence += count
        if rng.random() < 0.3:
            mine.flush()
            other.flush()
            assert ours.getvalue() == theirs.getvalue()
        if rng.random() < 0.1:
            entry = (f"/late{sequence}", MessageEncoding.CDR, schemas[0], {})
            assert mine.add_channel(*entry) == other.register_channel(*entry)
    mine.finish()
    other.finish()
    assert ours.getvalue() == theirs.getvalue()


@pytest.mark.parametrize("channels", [0, 2])
def test_a_file_without_messages_is_that_of_the_library(channels: int) -> None:
    ours, theirs = io.BytesIO(), io.BytesIO()
    mine, other = ChunkedFile(ours, "ros2", "tenodesis"), stock(theirs)
    for _ in range(channels):
        mine.add_channel("/x", MessageEncoding.CDR, 0, {})
        other.register_channel("/x", MessageEncoding.CDR, 0, {})
    for writer in (mine, other):
        writer.flush()
        writer.finish()
    assert ours.getvalue() == theirs.getvalue()

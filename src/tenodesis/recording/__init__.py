"""Recordings: runs kept in MCAP files as ROS 2 messages, readable by stock tools and after a crash."""

from tenodesis.recording.reader import Blocks, Recording
from tenodesis.recording.tables import to_csv, to_pandas, to_parquet
from tenodesis.recording.writer import Recorder

__all__ = ["Blocks", "Recorder", "Recording", "to_csv", "to_pandas", "to_parquet"]


def __dir__() -> list[str]:
    return sorted(__all__)

"""Recordings: runs kept in MCAP files as ROS 2 messages, readable by stock tools and after a crash."""

from tenodesis.recording.reader import Recording
from tenodesis.recording.writer import Recorder

__all__ = ["Recorder", "Recording"]


def __dir__() -> list[str]:
    return sorted(__all__)

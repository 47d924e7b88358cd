"""The messages of a run, topic by topic, for files and for whoever listens."""

import json
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis.recording import cdr, schemas
from tenodesis.recording.schemas import Topic
from tenodesis.run import Array, Run


class Messages(NamedTuple):
    """The messages on one topic: where their numbers lie, and the signal that each of them is."""

    topic: Topic
    signals: Mapping[str, str]
    layout: cdr.Layout

    def encode(self, stamps: NDArray[np.int64], columns: Mapping[str, Array]) -> bytes:
        """Return the messages with these stamps (n,), in ns, of :func:`columns`, one after the other."""
        numbers = {field: columns[signal][:, self.topic.columns] for field, signal in self.signals.items()}
        return self.layout.encode(stamps, numbers)


def of_signals(axes: tuple[str, ...], names: Collection[str]) -> list[Messages]:
    """Return the messages that carry these signals, the time among them."""
    found = []
    for topic in schemas.topics(axes):
        signals = {field: signal for field, signal in topic.signals.items() if signal in names}
        if signals:
            found.append(Messages(topic, signals, _layout(topic, signals)))
    return found


def columns(run: Run) -> dict[str, Array]:
    """Return a run's signals and time with rows down and axes and tendons across."""
    return {name: values.reshape(len(run), -1) for name, values in ({"time": run.time} | run.signals()).items()}


def event(time: float, content: Mapping[str, Any]) -> bytes:
    """Return the message of an event at a time (s): JSON in a String.

    Raises
    ------
    TypeError, ValueError
        The content cannot be told in JSON.
    """
    return cdr.text(json.dumps({**content, "time": time}))


def _layout(topic: Topic, signals: Mapping[str, str]) -> cdr.Layout:
    if topic.type == schemas.JOINT_STATE:
        return cdr.joint_state(topic.joints, dict.fromkeys(signals, len(topic.joints)), topic.frame)
    return cdr.wrench(topic.frame) if topic.type == schemas.WRENCH else cdr.number()

"""Bags of ROS 1 and ROS 2 as tables: a column for each number of each joint, on the clock of the busiest topic."""

import sqlite3
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from tenodesis.errors import RecordingError
from tenodesis.extras import require
from tenodesis.recording import cdr, schemas
from tenodesis.recording.container import Message
from tenodesis.recording.decode import Decoded, Decoder, LeftOut
from tenodesis.run import SIGNALS, Array, Names

ROS1 = b"#ROSBAG V"
SQLITE = b"SQLite format 3\0"
_UNITS = {"position": "rad", "velocity": "rad/s", "force": "N", "torque": "N*m"}
_AT_ONCE = 20_000
"""Messages decoded together."""
_MOST_BYTES = 4_000_000_000
"""Largest content of a bag's messages, bytes."""
_GAP = 5.0
"""Steps of a topic's clock without a message, between which nothing is interpolated."""

_Series = tuple[NDArray[np.int64], dict[str, Array]]


def is_bag(path: Path) -> bool:
    """Return whether a path is the folder of a ROS 2 bag."""
    return (path / "metadata.yaml").is_file()


def no_bag(path: Path) -> RecordingError:
    """Return the refusal of a folder that is none."""
    return RecordingError(
        f"{path} is a folder without the metadata.yaml of a ROS 2 bag; name a file in it.", key="path", value=path
    )


def columns(path: Path) -> tuple[Array, dict[str, Array]]:
    """Return the times (n,), s from the first, and columns (n,) by heading, ``/psm/measured_js.yaw.position``.

    What this package would record has the headings of its export. Columns are interpolated to the times, NaN outside
    of a topic's messages and in its gaps.

    Raises
    ------
    RecordingError
        The bag holds no joint states, wrenches or numbers, or more than 4 GB of them.
    MissingExtraError
        rosbags is not installed.
    """
    series = {topic: _joined(topic, parts) for topic, parts in _topics(path).items()}
    if not series:
        raise RecordingError(
            f"{path} holds no joint states, no wrenches and no numbers.",
            key="path",
            value=path,
            allowed=", ".join(schemas.NUMBERS),
        )
    clock = max((stamps for stamps, _ in series.values()), key=len)
    found = {}
    for stamps, own in series.values():
        for heading, values in own.items():
            found[heading] = _interpolated(clock, stamps, values)
    return (clock - clock[0]) / cdr.SECOND, found


def _topics(path: Path) -> dict[str, list[Decoded]]:
    """Return the decoded parts of every topic of a known type, whose messages keep their joints."""
    anyreader = require("rosbags.highlevel", "formats")
    stores = require("rosbags.typesys", "formats")
    humble = stores.get_typestore(stores.Stores.ROS2_HUMBLE)
    for file in [path] if path.is_file() else sorted(path.glob("*.db3")):
        _plain(file)
    found: dict[str, list[Decoded]] = defaultdict(list)
    factory = DecoderFactory()
    numbers = {
        kind: Schema(at, schemas.definition(kind).encode(), "ros2msg", kind)
        for at, kind in enumerate(schemas.NUMBERS, 1)
    }
    with anyreader.AnyReader([path], default_typestore=humble) as reader:
        wanted = [one for one in reader.connections if one.msgtype in schemas.NUMBERS]
        for topic, messages in _parts(reader, humble, wanted) if wanted else ():
            part = Decoder(factory, numbers[topic.msgtype], "cdr")(messages)
            earlier = found[topic.topic]
            if not isinstance(part, LeftOut) and (not earlier or part.joints == earlier[0].joints):
                earlier.append(part)
    return {topic: parts for topic, parts in found.items() if parts}


def _parts(reader: Any, store: Any, wanted: list[Any]) -> Iterator[tuple[Any, list[Message]]]:
    """Yield messages of a topic, as CDR, in groups."""
    waiting: dict[int, list[Message]] = defaultdict(list)
    by_number = {one.id: one for one in wanted}
    taken = 0
    for one, stamp, raw in reader.messages(wanted):
        if not reader.is2:
            # the types of ROS 2 leave out the number that a header of ROS 1 begins with
            raw = store.ros1_to_cdr(raw, one.msgtype)  # noqa: PLW2901
        data = bytes(raw)
        taken += len(data)
        if taken > _MOST_BYTES:
            raise RecordingError(f"{reader.paths[0]} holds more than {_MOST_BYTES / 1e9:g} GB of messages.", key="path")
        waiting[one.id].append(Message(len(waiting[one.id]), stamp, data))
        if len(waiting[one.id]) == _AT_ONCE:
            yield one, waiting.pop(one.id)
    for number, messages in waiting.items():
        yield by_number[number], messages


def _plain(file: Path) -> None:
    """Check that the tables of a file of SQLite are tables: a view may be a computation without an end."""
    with file.open("rb") as start:
        if start.read(len(SQLITE)) != SQLITE:
            return
    with closing(sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)) as bag:
        kinds = dict(bag.execute("SELECT name, type FROM sqlite_master WHERE name IN ('topics', 'messages')"))
    if kinds != {"topics": "table", "messages": "table"}:
        raise RecordingError(f"{file} has no tables of topics and messages.", key="path", value=file)


def _joined(topic: str, parts: list[Decoded]) -> _Series:
    """Return a topic's rising stamps (n,), ns, and its columns by heading."""
    fields = [field for field in parts[0].numbers if all(field in part.numbers for part in parts)]
    stamps = np.concatenate([part.stamps for part in parts])
    stamps, kept = np.unique(stamps, return_index=True)
    joints = parts[0].joints
    own = _own(topic, joints)
    found = {}
    for field in fields:
        values = np.concatenate([part.numbers[field] for part in parts])[kept]
        for at in range(values.shape[1]):
            joint = joints[at] if at < len(joints) else ""
            name = ".".join(part for part in (topic, joint, field) if part)
            unit = _UNITS.get(field.partition(".")[0])
            found[own.get((field, joint), f"{name} [{unit}]" if unit else name)] = values[:, at]
    return stamps, found


def _own(topic: str, joints: tuple[str, ...]) -> Mapping[tuple[str, str], str]:
    """Return the headings of an export by field and joint, for a topic of this package."""
    names = Names.paired(schemas.axes_of({topic: joints}) or ("yaw",))
    known = next((one for one in schemas.topics(names) if one.name == topic), None)
    order = None if known is None else schemas.places(known.joints, joints)
    if known is None or order is None:
        return {}
    found = {}
    for field, signal in known.signals.items():
        if signal in SIGNALS:
            headings = names.headings(signal)[known.columns]
            for heading, joint in zip(headings, [joints[at] for at in order] or [""], strict=False):
                found[field, joint] = f"{heading} [{SIGNALS[signal].unit}]"
    return found


def _interpolated(clock: NDArray[np.int64], stamps: NDArray[np.int64], values: Array) -> Array:
    if np.array_equal(clock, stamps):
        return values
    # counted from the first, for a float has no digits for nanoseconds since 1970
    found = np.interp(clock - clock[0], stamps - clock[0], values)
    return np.where(covered(clock, stamps), found, np.nan)


def covered(clock: NDArray[Any], times: NDArray[Any]) -> NDArray[np.bool_]:
    """Return which times of a clock lie between two messages of a topic, at rising times, that are no gap."""
    inside: NDArray[np.bool_] = (clock >= times[0]) & (clock <= times[-1])
    step = np.diff(times)
    if step.size:
        after = np.clip(np.searchsorted(times, clock, side="right") - 1, 0, step.size - 1)
        inside &= (step[after] <= _GAP * np.median(step)) | np.isin(clock, times)
    return inside

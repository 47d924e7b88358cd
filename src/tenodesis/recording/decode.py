"""Messages of a topic as arrays."""

import io
from collections.abc import Collection, Iterator, Sequence
from contextlib import redirect_stderr
from enum import Enum, auto
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import NDArray

from tenodesis.recording import cdr
from tenodesis.recording.container import Contents, Message, Messages
from tenodesis.recording.schemas import FLOAT64, JOINT_STATE, NUMBERS, WRENCH, layout
from tenodesis.run import Array


class Decoded(NamedTuple):
    """The n messages of a topic: stamps (n,) in ns, the joints' names, and each array of numbers (n, count)."""

    stamps: NDArray[np.int64]
    joints: tuple[str, ...]
    numbers: dict[str, Array]


class Misfit(Enum):
    """Why a topic is left out of a recording's run."""

    TYPE = auto()
    """Its messages have another type or encoding, or cannot be decoded."""
    JOINTS = auto()
    """Its messages are about other joints than those of the instrument, or not all about the same."""
    STAMPS = auto()
    """Its stamps are not those of the other topics."""


class LeftOut(NamedTuple):
    """A topic that is left out: the reason, also as the end of a sentence."""

    reason: Misfit
    text: str

    def __str__(self) -> str:
        """Return the text."""
        return self.text


def decoded(contents: Contents, wanted: Collection[str]) -> Iterator[tuple[str, "Decoded | LeftOut"]]:
    """Yield the topics of a file that are wanted: their messages as arrays, or why they do not fit a recording."""
    factory = DecoderFactory()
    for number, messages in contents.messages.items():
        channel = contents.channels.get(number)
        schema = None if channel is None else contents.schemas.get(channel.schema_id)
        if channel is not None and schema is not None and channel.topic in wanted:
            yield channel.topic, Decoder(factory, schema, channel.message_encoding)(messages)


class Decoder:
    """Messages of a topic to arrays; the layout of the first is tried on all.

    Parameters
    ----------
    factory
        Keeps its decoders; the topics of a file share it.
    schema, encoding
        Of the messages.
    """

    def __init__(self, factory: DecoderFactory, schema: Schema, encoding: str) -> None:
        self._factory, self._schema, self._encoding = factory, schema, encoding
        self._known: tuple[tuple[str, ...], cdr.MessageLayout] | None = None

    def __call__(self, messages: Sequence[Message] | Messages) -> Decoded | LeftOut:
        """Return messages, one or more, as arrays, or the reason why they do not fit a recording."""
        kind = self._schema.name
        if kind not in NUMBERS:
            return LeftOut(Misfit.TYPE, f"its messages are {kind}")
        given = Messages.of(messages)
        try:
            found = None if self._known is None else _together(kind, given, *self._known)
            if found is not None:
                return found
            # The library prints what it then raises.
            with redirect_stderr(io.StringIO()):
                return self._decoded(given)
        # The definition is the other program's, so that anything can go wrong with it.
        except Exception:
            return LeftOut(Misfit.TYPE, f"its messages cannot be decoded as {kind}")

    def _decoded(self, messages: Messages) -> Decoded | LeftOut:
        schema = self._schema
        decoder = self._factory.decoder_for(self._encoding, schema)
        if decoder is None:
            return LeftOut(Misfit.TYPE, f"its messages are encoded as {self._encoding}, {schema.encoding}")
        first = decoder(messages.first.data)
        joints = tuple(first.name) if schema.name == JOINT_STATE else ()
        counts = {name: len(values) for name, values in _numbers(schema.name, first).items()}
        frame = "" if schema.name == FLOAT64 else first.header.frame_id
        self._known = (joints, layout(schema.name, joints, counts, frame))
        found = _together(schema.name, messages, *self._known)
        if found is not None:
            return found
        return _decoded_singly(schema.name, joints, [decoder(message.data) for message in messages], messages)


def _together(kind: str, messages: Messages, joints: tuple[str, ...], known: cdr.MessageLayout) -> Decoded | None:
    """Return messages that all have one layout, None if they do not."""
    parts = [known.decode(part.data) for part in messages.parts]
    rows = [part for part in parts if part is not None]
    if len(rows) < len(parts):
        return None
    names = [name for name in known.dtype.names or () if name not in {"sec", "nanosec"}]
    numbers = {name: np.concatenate([part[name] for part in rows]) for name in names}
    if kind == FLOAT64:
        return Decoded(messages.stamps, joints, numbers)
    return Decoded(
        np.concatenate([part["sec"] * np.int64(cdr.SECOND) + part["nanosec"] for part in rows]), joints, numbers
    )


def _decoded_singly(kind: str, joints: tuple[str, ...], decoded: list[Any], messages: Messages) -> Decoded | LeftOut:
    rows = [_numbers(kind, message) for message in decoded]
    counts = {name: len(values) for name, values in rows[0].items()}
    same = all({name: len(values) for name, values in row.items()} == counts for row in rows)
    if not same or (kind == JOINT_STATE and any(tuple(message.name) != joints for message in decoded)):
        return LeftOut(Misfit.JOINTS, "its messages are not all about the same joints")
    numbers = {name: np.array([row[name] for row in rows], np.float64) for name, count in counts.items() if count}
    if kind == FLOAT64:
        return Decoded(messages.stamps, joints, numbers)
    stamps = [message.header.stamp for message in decoded]
    nanoseconds = np.array([stamp.sec * cdr.SECOND + stamp.nanosec for stamp in stamps], np.int64)
    return Decoded(nanoseconds, joints, numbers)


def _numbers(kind: str, message: Any) -> dict[str, list[float]]:
    prefix = "wrench." if kind == WRENCH else ""
    found = {name: attrgetter(prefix + name)(message) for name in NUMBERS[kind]}
    return {name: list(one) if kind == JOINT_STATE else [one] for name, one in found.items()}

"""A live instrument over a Foxglove WebSocket: the topics of the recordings, to watch only."""

import ipaddress
import math
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from mcap.well_known import MessageEncoding, SchemaEncoding

from tenodesis.errors import LiveError
from tenodesis.extras import require
from tenodesis.live import events
from tenodesis.live.events import Tail
from tenodesis.live.ticks import RowSource, start_time
from tenodesis.recording import cdr, schemas
from tenodesis.recording.schemas import TopicMessages
from tenodesis.run import Run

if TYPE_CHECKING:
    from foxglove.channel import Channel

HOST = "127.0.0.1"
PORT = 8765
RATE = 100.0
"""Messages per second on a topic, Hz."""

_PERIOD = 0.02
"""Time between two looks at the ring, s."""
_MOST = 2000
"""Rows taken at a time."""
_BACKLOG = 1 << 16
"""Messages that wait for a slow client: those of a block on all topics; beyond that it misses the oldest."""


class FoxgloveServer:
    """A server that is listening; a context manager that stops it.

    It offers none of the protocol's ways to publish, call or set anything, so that no client can move a motor.

    Parameters
    ----------
    source
        The instrument's rows.
    host, port
        Where to listen; port 0 takes any that is free.
    rate
        Rows per second of the instrument's time that are sent, Hz; None sends all.
    folder
        The runtime's folder, whose events are sent as well.

    Raises
    ------
    LiveError
        It cannot listen there, or the rate is no rate.
    """

    def __init__(
        self,
        source: RowSource,
        host: str = HOST,
        port: int = PORT,
        *,
        rate: float | None = RATE,
        folder: Path | None = None,
    ) -> None:
        if rate is not None and not 0 < rate < math.inf:
            raise LiveError(key="rate", value=rate, allowed="above 0 Hz and finite")
        if not 0 <= port < 1 << 16:
            raise LiveError(key="port", value=port, allowed="from 1 to 65535, or 0 for any that is free")
        foxglove = require("foxglove", "live")
        self._source = source
        self._stride = 1 if rate is None else max(1, round(1 / (rate * source.time_step)))
        self._tail = None if folder is None else Tail(folder / events.FILE, at_end=True)
        self._context = foxglove.Context()
        self._channels: list[tuple[TopicMessages, Channel]] | None = None
        self._start = 0
        self._time = 0.0
        self._row = 0
        self.lost = 0
        """Rows that were overwritten before they were read."""
        try:
            self._server = foxglove.start_server(
                name=f"Tenodesis: {source.inst.name}",
                host=host,
                port=port,
                capabilities=[],
                context=self._context,
                message_backlog_size=_BACKLOG,
            )
        except RuntimeError as problem:
            cause = str(problem).rpartition("port: ")[2]
            raise LiveError(
                f"cannot listen on {host}, port {port}: {cause}; it must be an address of this computer and a "
                "free port.",
                key="port",
                value=port,
                allowed="a free port",
            ) from None
        self._events = self._channel(schemas.EVENTS, schemas.STRING, {})

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def port(self) -> int:
        """Address on which it listens."""
        return int(self._server.port)

    def publish(self) -> bool:
        """Send new messages; return whether more may come."""
        alive = self._source.alive
        run, lost = self._source.read(_MOST)
        self.lost += lost
        if len(run):
            self._send(run)
        sent = self._send_events()
        return alive or bool(len(run)) or sent

    def stop(self) -> None:
        """Disconnect all clients; a second call does nothing."""
        self._server.stop()
        if self._tail is not None:
            self._tail.close()

    def _send(self, run: Run) -> None:
        if self._channels is None:
            self._start = start_time(run)
            self._channels = [
                (one, self._channel(one.topic.name, one.topic.type, {"signals": " ".join(one.signals.values())}))
                for one in schemas.messages_of(run.names, schemas.flat_columns(run).keys())
            ]
        first = -self._row % self._stride
        self._row += len(run)
        rows = np.arange(first, len(run), self._stride)
        kept = rows[(run.time[rows] >= 0) & (run.time[rows] <= events.LONGEST)]
        if not kept.size:
            return
        columns = {name: values[kept] for name, values in schemas.flat_columns(run).items()}
        stamps = self._start + np.rint(run.time[kept] * cdr.SECOND).astype(np.int64)
        self._time = float(run.time[kept[-1]])
        for one, channel in self._channels:
            if not channel.has_sinks():
                continue
            block, size = one.encode(stamps, columns), one.layout.size
            for i, stamp in enumerate(stamps.tolist()):
                channel.log(block[i * size : (i + 1) * size], log_time=stamp)

    def _send_events(self) -> bool:
        if self._tail is None:
            return False
        happened = self._tail.read()
        for event in happened:
            time = event.at(self._time)
            self._events.log(
                schemas.event_message(time, event.content), log_time=self._start + round(time * cdr.SECOND)
            )
        return bool(happened)

    def _channel(self, topic: str, message_type: str, metadata: dict[str, str]) -> "Channel":
        foxglove = require("foxglove", "live")
        definition = schemas.definition(message_type).encode()
        schema = foxglove.Schema(name=message_type, encoding=SchemaEncoding.ROS2, data=definition)
        channel: Channel = foxglove.Channel(
            topic, schema=schema, message_encoding=MessageEncoding.CDR, context=self._context, metadata=metadata
        )
        return channel


def serve(server: FoxgloveServer, stop: threading.Event) -> None:
    """Send new messages until the runtime ends or `stop` is set."""
    while not stop.is_set() and server.publish():
        stop.wait(_PERIOD)


def warning(host: str) -> str | None:
    """Return a warning about listening on an address, in a sentence; None on loopback."""
    try:
        loopback = ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = host == "localhost"
    if loopback:
        return None
    return f"{host} is not this computer alone: everyone who can reach it can watch the instrument, but not move it."

"""Claims about the Foxglove WebSocket: a plain client sees what a recording would hold, and can do nothing else."""

import json
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from typer.testing import CliRunner
from websockets import Subprotocol
from websockets.sync.client import ClientConnection, connect

import tenodesis as tn
from tenodesis.cli import live as live_commands
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.live import joined
from tenodesis.live.foxglove import FoxgloveServer, serve, warning
from tenodesis.recording import Recorder
from tenodesis.recording.schemas import flat_columns, messages_of, topics
from tenodesis.run import Names

from .conftest import refused
from .live_loop import LiveLoop, Played
from .test_recording import a_run

pytestmark = pytest.mark.process

MESSAGE = struct.Struct("<BIQ")
FIRST = 10
FORCE = ("/controller/measured_cf", "/controller/tip/measured_js", "/controller/tip/measured_js_std")
"""Rows that open the channels."""


class Client:
    """Speaks the protocol by its published rules, without any of the code that serves it."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.info = json.loads(socket.recv(timeout=20))
        self.channels: dict[int, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = {}

    def say(self, **content: Any) -> None:
        self.socket.send(json.dumps(content))

    def answer(self, **content: Any) -> dict[str, Any]:
        """Say something that the server answers; what was said before has then been done."""
        self.say(**content)
        while True:
            heard = self.hear()
            if heard is not None and heard["op"] not in {"advertise", "unadvertise"}:
                return heard

    def hear(self) -> dict[str, Any] | None:
        """Take one frame in; what it says if it is text."""
        frame = self.socket.recv(timeout=20)
        if isinstance(frame, str):
            heard: dict[str, Any] = json.loads(frame)
            for channel in heard.get("channels", []) if heard["op"] == "advertise" else []:
                self.channels[channel["id"]] = channel
            return heard
        opcode, subscription, stamp = MESSAGE.unpack_from(frame)
        assert opcode == 1
        topic = self.channels[subscription - 1000]["topic"]
        self.messages.setdefault(topic, []).append((stamp, frame[MESSAGE.size :]))
        return None

    def subscribe(self, number: int) -> None:
        """Subscribe to all channels, of which there are so many."""
        while len(self.channels) < number:
            self.hear()
        self.say(op="subscribe", subscriptions=[{"id": 1000 + id, "channelId": id} for id in self.channels])
        self.answer(op="advertise", channels=[])

    def take(self, topic: str, count: int) -> None:
        while len(self.messages.get(topic, [])) < count:
            self.hear()


@contextmanager
def client(server: FoxgloveServer) -> Iterator[Client]:
    protocols = [Subprotocol("foxglove.sdk.v1")]
    with connect(f"ws://127.0.0.1:{server.port}", subprotocols=protocols, compression=None, max_queue=None) as socket:
        yield Client(socket)


@pytest.mark.parametrize("axes", [("yaw",), ("yaw", "pitch")])
def test_topics_schemas_and_values_are_those_of_a_recording(
    axes: tuple[str, ...], scaled: Instrument, tmp_path: Path
) -> None:
    run = a_run(200, axes)
    inst = scaled.axis("yaw") if len(axes) == 1 and len(scaled.axes) > 1 else scaled
    source = Played(run, inst, [FIRST, 90, 100])
    with FoxgloveServer(source, port=0, rate=None, folder=tmp_path) as server:
        server.publish()
        with client(server) as watcher:
            watcher.subscribe(1 + len(topics(Names.paired(axes))))
            while server.publish():
                pass
            for topic in topics(Names.paired(axes)):
                watcher.take(topic.name, 200 - FIRST)

    stamps = [stamp for stamp, _ in watcher.messages["/time"]]
    start = stamps[0] - round(run.time[FIRST] * 1e9)
    with Recorder(tmp_path / "run.mcap", axes=axes, start_time=start) as recorder:
        recorder.write(run)
    held: dict[str, list[tuple[int, bytes]]] = {}
    described = {}
    with (tmp_path / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            held.setdefault(channel.topic, []).append((message.log_time, message.data))
            topic = (schema.name, schema.encoding, schema.data.decode(), channel.message_encoding)
            described[channel.topic] = topic
    advertised = {
        one["topic"]: (one["schemaName"], one["schemaEncoding"], one["schema"], one["encoding"])
        for one in watcher.channels.values()
    }
    assert advertised.pop("/events")[:2] == ("std_msgs/msg/String", "ros2msg")
    assert advertised == described
    assert watcher.messages == {topic: messages[FIRST:] for topic, messages in held.items()}


def decoded(watcher: Client, topic: str) -> list[Any]:
    """Decode a topic's messages with a stock decoder, by what the server said of them."""
    channel = next(one for one in watcher.channels.values() if one["topic"] == topic)
    schema = Schema(1, channel["schema"].encode(), channel["schemaEncoding"], channel["schemaName"])
    decoder = DecoderFactory().decoder_for(channel["encoding"], schema)
    assert decoder is not None
    return [decoder(data) for _, data in watcher.messages[topic]]


def test_a_stock_decoder_reads_the_values_of_the_loop_itself(tmp_path: Path) -> None:
    loop = LiveLoop(tmp_path, tn.load("scaled-up"))
    loop.ask("enable")
    loop.load(0.5)
    loop.ticks(300)
    (run,) = loop.runs
    with FoxgloveServer(Played(run, loop.inst, [FIRST, 290]), port=0, rate=None) as server:
        server.publish()
        with client(server) as watcher:
            watcher.subscribe(1 + len(list(messages_of(run.names, flat_columns(run).keys()))))
            server.publish()
            for topic in ("/tendons/measured_js", "/rig/measured_cf", *FORCE, "/controller/operating_state", "/time"):
                watcher.take(topic, 290)
    tensions = decoded(watcher, "/tendons/measured_js")
    assert run.measured_tension is not None
    assert [list(message.effort) for message in tensions] == run.measured_tension[FIRST:].tolist()
    assert tensions[0].name == ["yaw_agonist", "yaw_antagonist"]
    stamp = tensions[7].header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == watcher.messages["/tendons/measured_js"][7][0]
    assert [message.wrench.force.x for message in decoded(watcher, "/rig/measured_cf")] == [0.5] * 290
    force, estimate, deviation = (decoded(watcher, topic) for topic in FORCE)
    assert run.estimated_force is not None
    assert run.estimated_force_std is not None
    assert (
        [one.wrench.force.x for one in force] == [*run.estimated_force[FIRST:]] == [one.effort[0] for one in estimate]
    )
    assert [one.effort[0] for one in deviation] == run.estimated_force_std[FIRST:].tolist()
    assert [message.data for message in decoded(watcher, "/controller/operating_state")] == [1.0] * 290
    assert [message.data for message in decoded(watcher, "/time")] == run.time[FIRST:].tolist()


def test_rows_are_thinned_evenly_whatever_blocks_they_come_in(scaled: Instrument) -> None:
    run = a_run(2000, names=["force"])
    source = Played(run, scaled, [10, 1, 0, 389, 13, 7, 580, 1000])
    with FoxgloveServer(source, port=0) as server:
        server.publish()
        with client(server) as watcher:
            watcher.subscribe(3)
            while server.publish():
                pass
            watcher.take("/time", 99)
    times = [message.data for message in decoded(watcher, "/time")]
    assert times == run.time[20::20].tolist()


def test_events_are_sent_as_they_happen_and_not_those_before(scaled: Instrument, tmp_path: Path) -> None:
    events = tmp_path / "events.jsonl"
    events.write_text('{"time": 0.001, "event": "law", "law": "off"}\n')
    run = a_run(30, names=["force"])
    with FoxgloveServer(Played(run, scaled, [10, 20]), port=0, folder=tmp_path) as server:
        server.publish()
        with client(server) as watcher:
            watcher.subscribe(3)
            with events.open("a") as file:
                file.write(
                    '{"time": 0.004, "event": "command", "origin": "page 1"}\n{"time": 1e300, "event": "fault"}\n'
                )
            server.publish()
            watcher.take("/events", 2)
            watcher.take("/time", 1)
    said = [json.loads(message.data) for message in decoded(watcher, "/events")]
    assert said == [{"time": 0.004, "event": "command", "origin": "page 1"}, {"time": run.time[20], "event": "fault"}]
    (stamp, _), (later, _) = watcher.messages["/events"]
    assert later - stamp == round((run.time[20] - 0.004) * 1e9)
    assert watcher.messages["/time"][0][0] == later


def test_no_client_can_do_anything_but_watch(scaled: Instrument) -> None:
    run = a_run(40, names=["force"])
    with FoxgloveServer(Played(run, scaled, [10, 30]), port=0) as server:
        server.publish()
        with client(server) as watcher:
            assert watcher.info["capabilities"] == []
            channel = {"id": 1, "topic": "/handle/servo_jp", "encoding": "json", "schemaName": "x"}
            attempts: list[dict[str, Any]] = [
                {"op": "advertise", "channels": [channel]},
                {"op": "setParameters", "parameters": [{"name": "force", "value": 100}]},
                {"op": "getParameters", "parameterNames": []},
                {"op": "fetchAsset", "uri": "file:///etc/passwd", "requestId": 1},
                {"op": "subscribeConnectionGraph"},
            ]
            for attempt in attempts:
                answers = watcher.answer(**attempt)
                assert answers["op"] in {"status", "fetchAssetResponse"}, attempt
                assert answers.get("level", 2) == 2 or answers["op"] == "fetchAssetResponse"
            watcher.socket.send(struct.pack("<BI", 1, 1) + b'{"position": 3}')
            watcher.socket.send(b"\xff" * 1000)
            watcher.socket.send("no json")
            with client(server) as other:
                other.subscribe(3)
                server.publish()
                other.take("/time", 1)
    assert [message.data for message in decoded(other, "/time")] == [run.time[20]]


def test_it_serves_until_the_runtime_ends_or_it_is_stopped(scaled: Instrument) -> None:
    run = a_run(100, names=["force"])
    source = Played(run, scaled, [10, 20, 30])
    with FoxgloveServer(source, port=0) as server:
        serve(server, threading.Event())
        assert not source.alive
    stop = threading.Event()
    stop.set()
    source = Played(run, scaled, [10])
    with FoxgloveServer(source, port=0) as server:
        serve(server, stop)
        assert source.alive
        server.stop()


def test_rows_without_a_time_of_the_day_are_left_out(scaled: Instrument) -> None:
    run = a_run(40, names=["force"])
    run.time[[12, 15, 20, 30]] = np.nan, -1.0, np.inf, 1e300
    with FoxgloveServer(Played(run, scaled, [10, 30]), port=0, rate=None) as server:
        server.publish()
        with client(server) as watcher:
            watcher.subscribe(3)
            server.publish()
            watcher.take("/time", 26)
    times = [message.data for message in decoded(watcher, "/time")]
    assert times == np.delete(run.time, [*range(10), 12, 15, 20, 30]).tolist()


def test_lost_rows_are_counted(scaled: Instrument) -> None:
    with FoxgloveServer(Played(a_run(100, names=["force"]), scaled, [10, (5, 20), (7, 10)]), port=0) as server:
        while server.publish():
            pass
        assert server.lost == 12


def test_a_bad_address_port_or_rate_is_one_sentence(scaled: Instrument) -> None:
    source = Played(a_run(10), scaled, [10])
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(LiveError, match=r"cannot listen on 127\.0\.0\.1, port \d+: Address already in use"):
            FoxgloveServer(source, port=taken.getsockname()[1])
    with pytest.raises(LiveError, match=r"cannot listen on no-such-host\.invalid"):
        FoxgloveServer(source, "no-such-host.invalid", 0)
    for port in (-1, 65536):
        with pytest.raises(LiveError, match=f"port is {port}; it must be"):
            FoxgloveServer(source, port=port)
    for rate in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(LiveError, match=r"rate is .*; it must be above 0 Hz"):
            FoxgloveServer(source, port=0, rate=rate)


def test_only_loopback_goes_without_a_warning() -> None:
    assert [warning(host) for host in ("127.0.0.1", "127.3.2.1", "::1", "localhost")] == [None] * 4
    for host in ("0.0.0.0", "::", "192.168.1.4", "bench.lab"):
        assert str(warning(host)).endswith("everyone who can reach it can watch the instrument, but not move it.")


def test_the_command_listens_on_loopback_alone_and_says_so(
    scaled: Instrument, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = typer.Typer()
    app.callback()(lambda: None)
    app.command()(live_commands.foxglove)
    monkeypatch.setattr("tenodesis.cli.live.Reader", lambda _: Played(a_run(100), scaled, [100]))
    said = CliRunner().invoke(app, ["foxglove", str(tmp_path), "--port", "0"])
    assert said.exit_code == 0
    assert said.output.startswith("Foxglove: ws://127.0.0.1:")
    assert said.output.endswith("The runtime has ended.\n")
    said = CliRunner().invoke(app, ["foxglove", str(tmp_path), "--port", "0", "--host", "0.0.0.0", "--all"])
    assert said.output.startswith("warning: 0.0.0.0 is not this computer alone: everyone who can reach it can watch")
    said = CliRunner().invoke(app, ["foxglove", str(tmp_path), "--port", "0", "--rate", "-3"])
    assert isinstance(said.exception, LiveError)


def test_the_one_instrument_that_runs_is_found(
    scaled: Instrument, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(joined, "_PLACES", (tmp_path, tmp_path / "none"))
    with refused("FOLDER", kind=LiveError, allowed="of a live instrument that runs"):
        joined.running()
    (tmp_path / "tenodesis-0" / "1").mkdir(parents=True)
    (tmp_path / "tenodesis-0" / "1" / "ring").write_bytes(b"left over")
    loops = []
    for name in ("tenodesis-1", "tenodesis-2"):
        (tmp_path / name / "1").mkdir(parents=True)
        loops.append(LiveLoop(tmp_path / name / "1", scaled, ring="ring"))
        loops[-1].describe_folder()
    loops[0].ticks(1)
    assert joined.running() == tmp_path / "tenodesis-1" / "1"
    for loop in loops:
        loop.ticks(1)
    with refused("FOLDER", kind=LiveError, allowed="one folder"):
        joined.running()

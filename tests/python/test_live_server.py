"""The live server: who operates, malformed commands, and clients, recorders and runtimes that end."""

import contextlib
import json
import os
import signal
import socket
import threading
import time

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import _core
from tenodesis.errors import LiveError
from tenodesis.live import folder as folders
from tenodesis.live import lease as leases
from tenodesis.live.client import Client, wait_for
from tenodesis.live.host import Host
from tenodesis.live.loop import PROBLEMS
from tenodesis.live.server import Server
from tenodesis.live.status import ProtocolState
from tenodesis.live.ticks import Reader
from tenodesis.recording import Recording

from .conftest import refused, until
from .test_live import INST, looped

pytestmark = pytest.mark.process


@pytest.fixture
def served(tmp_path, monkeypatch):
    # A busy machine may hold an operator's heartbeat up for longer than a second.
    monkeypatch.setattr(leases, "SECONDS", 10.0)
    folder = tmp_path / "run"
    folder.mkdir(mode=0o700)
    server = Server(looped(folder), tmp_path / "recordings")
    server.start()
    yield folder, server
    server.finish()


def operating(folder):
    """A connection that operates for as long as it is open."""
    client = Client(folder, "one")
    assert client.acquire()

    def beat():
        with contextlib.suppress(LiveError):
            while client.heartbeat():
                time.sleep(0.2)

    threading.Thread(target=beat, daemon=True).start()
    return client


def with_a_last_word(served, monkeypatch):
    """Two connections, of which the first has enabled the motors and renewed its lease for one second more."""
    folder, _ = served
    one, other = Client(folder, "one"), Client(folder, "other")
    one.acquire()
    one.request("enable")
    until(lambda: other.status().state == "ENABLED")
    monkeypatch.setattr(leases, "SECONDS", 1.0)
    assert one.heartbeat()
    return one, other


def test_one_operates_and_others_watch_until_they_take_over(served):
    folder, _ = served
    one, other = Client(folder, "one"), Client(folder, "other")
    with refused("operator", None, kind=LiveError, allowed="one"):
        one.request("enable")
    assert one.acquire()
    assert not other.acquire()
    one.request("enable")
    with refused("operator", "one", kind=LiveError, allowed="other"):
        other.hand([0.1])
    until(lambda: one.status().state == "ENABLED")
    assert other.acquire(force=True)
    with refused("operator", "other", kind=LiveError, allowed="one"):
        one.hand([0.1])
    # Anyone may stop.
    one.stop()
    until(lambda: one.status().state == "PAUSED")
    assert one.status().stopped

    def events():
        return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]

    assert [e["origin"] for e in events() if e["event"] == "operator"] == ["one", "other"]
    until(lambda: any(e["event"] == "stop" and e["origin"] == "one" for e in events()))


def test_an_operator_that_goes_away_leaves_a_pause(served):
    folder, _ = served
    one, other = Client(folder, "one"), Client(folder, "other")
    one.acquire()
    one.request("enable")
    until(lambda: other.status().state == "ENABLED")
    one.close()
    until(lambda: other.status().state == "PAUSED")
    assert other.status().operator is None


def test_a_protocol_ends_with_its_operator_and_homes_nobodys_motors(served):
    folder, _ = served
    one, other = Client(folder, "one"), Client(folder, "other")
    one.acquire()
    one.play(tn.simulate.load("pretension"), record=False)
    one.close()
    until(lambda: other.status().protocol.problem is not None)
    time.sleep(0.3)
    status = other.status()
    assert status.protocol.problem == "the operator has left"
    assert status.state in {"DISABLED", "PAUSED"}
    assert not status.homing


def test_whoever_takes_over_from_one_that_says_nothing_finds_a_pause(served, monkeypatch):
    _, other = with_a_last_word(served, monkeypatch)
    until(other.acquire)
    until(lambda: other.status().state == "PAUSED")


def test_an_operator_that_says_nothing_is_taken_to_be_gone(served, monkeypatch):
    _, other = with_a_last_word(served, monkeypatch)
    until(lambda: other.status().state == "PAUSED")
    assert other.status().problem == PROBLEMS[4]


def test_the_last_seconds_come_thinned_and_in_order(served):
    folder, _ = served
    one = Client(folder, "one")
    until(lambda: len(one.history(5)["time"]) > 20)
    history = one.history(5, rows=10)
    assert 1 <= len(history["time"]) <= 10
    assert (np.diff(history["time"]) > 0).all()
    assert history["output_angle"].shape == history["time"].shape


def test_a_malformed_order_is_answered_and_moves_nothing(served):
    folder, server = served
    for line in (b"\x00\xff", b"[]", b"{}", b'{"op": "fly"}', b'{"op": 7}', b"[" * 5000, b'{"op":"hand"}'):
        with socket.socket(socket.AF_UNIX) as raw:
            raw.connect(str(folder / folders.SOCKET))
            raw.sendall(line + b"\n")
            assert "error" in json.loads(raw.makefile("rb").readline()), line
    ticks = server.loop.core.ticks
    until(lambda: server.loop.core.ticks > ticks)


def test_a_client_that_floods_delays_no_tick_and_the_last_word_counts(served):
    folder, server = served
    one = operating(folder)
    ticks = server.loop.core.ticks
    for n in range(2000):
        try:
            one.hand([0.2 * n / 1999])
        except LiveError as problem:
            assert "too many" in str(problem)
    one.hand([0.2])
    until(lambda: abs(one.latest()["commanded_handle_angle"] - 0.2) < 1e-4)
    assert server.loop.core.ticks > ticks
    lines = (folder / "events.jsonl").read_text().splitlines()
    told_of = [json.loads(line) for line in lines if '"hand"' in line]
    assert sum(e["times"] for e in told_of) >= 2000
    assert len(told_of) < 1500


def test_a_protocol_runs_at_a_request_and_is_recorded_whole(served):
    folder, _ = served
    one = operating(folder)
    one.request("enable")
    protocol = tn.simulate.parse(
        'name = "turn"\n[[phases]]\nkind = "ramp"\nhandle_angle = "20 deg"\nduration = "1 s"\n'
    )
    one.play(protocol)
    with refused("protocol", "turn", kind=LiveError):
        one.hand([0.0])
    path = one.status().recording
    until(lambda: not one.status().protocol.runs)
    assert one.status().protocol.state is ProtocolState.DONE
    until(lambda: one.status().recording is None)
    recording = Recording.open(path)
    run = recording.run
    assert {"play", "protocol_ended"} <= {event.content["event"] for event in recording.events}
    assert np.allclose(np.diff(run.time), 1 / INST.sensors.sampling_rate)
    assert abs(np.degrees(run.commanded_handle_angle).max() - 20) < 1e-6


def test_a_recorder_that_is_killed_is_said_and_its_file_can_be_read_to_the_last_chunk(served):
    folder, server = served
    one = operating(folder)
    path = one.record(True, "long")
    until(lambda: server.runtime.recorder.status().get("rows", 0) > 1000)
    before = server.runtime.recorder.status()["rows"]
    os.kill(server.runtime.recorder.status()["pid"], signal.SIGKILL)
    until(lambda: one.status().problem)
    assert "The recorder of" in one.status().problem
    assert "SIGKILL" in one.status().problem
    assert one.status().recording is None
    recording = Recording.open(path)
    # Chunks are of a quarter of a second.
    assert len(recording.run) >= before - 0.25 / server.loop.period
    ticks = server.loop.core.ticks
    until(lambda: server.loop.core.ticks > ticks)


def test_a_recorder_that_hangs_is_said_while_it_hangs(served):
    folder, server = served
    one = operating(folder)
    path = one.record(True, "long")
    until(lambda: server.runtime.recorder.status().get("rows", 0) > 1000)
    assert one.status().problem is None
    pid = server.runtime.recorder.status()["pid"]
    os.kill(pid, signal.SIGSTOP)
    begun = time.monotonic()
    until(lambda: one.status().problem)
    print(f"reported after {time.monotonic() - begun:.2f} s")
    assert one.status().problem == f"The recorder of {path} hangs: what happens now may not be in its file."
    assert one.status().recording == path
    os.kill(pid, signal.SIGCONT)
    until(lambda: one.status().problem is None)


def test_a_runtime_that_is_killed_is_said_and_can_be_started_again(tmp_path):
    host = Host("scaled-up", recordings=tmp_path)
    try:
        link = host.connect("one")
        assert link.acquire()
        link.request("enable")
        os.kill(host.pid, signal.SIGKILL)
        until(lambda: link.status().state == "GONE")
        assert "The runtime has ended" in link.status().problem
        until(lambda: not link.alive)
        link.restart()
        assert link.status().state == "DISABLED"
        link.acquire()
        with pytest.raises(tn.InstrumentError):
            link.load('name = "no"\n')
        link.load("real-size")
        assert link.inst.name == tn.load("real-size").name
    finally:
        host.close()


def test_a_runtime_ends_with_what_started_it(tmp_path):
    host = Host("scaled-up", recordings=tmp_path)
    client = wait_for(host.folder, "one")
    reader = Reader(host.folder)
    process = host._process._process
    process.stdin.close()
    process.wait(10)
    assert not _core.RingReader(str(host.folder / folders.RING)).silence < 0
    until(lambda: not reader.alive)
    assert client.status().state == "GONE"
    host.close()

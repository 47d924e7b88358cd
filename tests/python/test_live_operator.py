"""Claims about who is heard: a stop wins over all that is under way, and there is always room for it."""

import contextlib
import json
import os
import signal
import socket
import threading
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import LiveError
from tenodesis.live import folder as folders
from tenodesis.live import lease as leases
from tenodesis.live import protocol_runner
from tenodesis.live import server as servers
from tenodesis.live.client import Client
from tenodesis.live.layout import TICK
from tenodesis.live.loop import LiveLoop
from tenodesis.live.server import Server
from tenodesis.live.ticks import Reader
from tenodesis.recording import Recording

from . import test_live_server
from .conftest import refused, until
from .test_live import looped
from .test_live_server import operating

pytestmark = pytest.mark.process
served = test_live_server.served

RAMP = tn.simulate.parse(
    'name = "turn"\n[[phases]]\nkind = "ramp"\nhandle_angle = "20 deg"\nduration = "1 s"\n'
    '[[phases]]\nkind = "hold"\nduration = "20 s"\n'
)


def events(folder):
    return [json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()]


def waiting(monkeypatch, place, name):
    """Let a function wait; returns what says that it does, and what lets it go on."""
    reached, go = threading.Event(), threading.Event()
    function = getattr(place, name)

    def waits(*arguments, **named):
        reached.set()
        assert go.wait(30)
        return function(*arguments, **named)

    monkeypatch.setattr(place, name, waits)
    return reached, go


def failing(work):
    """Do something in a thread; returns the thread, and the list that what goes wrong is put in."""
    problems = []

    def run():
        try:
            work()
        except LiveError as problem:
            problems.append(str(problem))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return thread, problems


@pytest.mark.parametrize(
    ("place", "name"), [(tn.simulate, "parse"), (tn.simulate.Protocol, "plan"), (protocol_runner, "Player")]
)
def test_a_stop_that_comes_while_a_protocol_is_being_prepared_wins(served, monkeypatch, place, name):
    # So long that it is not the operator's absence that ends it.
    monkeypatch.setattr(leases, "SECONDS", 60.0)
    folder, server = served
    one = Client(folder, "one")
    one.acquire()
    one.request("enable")
    until(lambda: one.status().state == "ENABLED")
    reader = Reader(folder)
    reached, go = waiting(monkeypatch, place, name)
    thread, problems = failing(lambda: one.play(RAMP, record=True))
    assert reached.wait(30)
    # On the connection that is still waiting for its answer.
    one.stop()
    until(lambda: one.latest().get("stopped") == 1)
    go.set()
    thread.join(30)
    assert problems == ["it was stopped, or the operator went, before the protocol began."]
    ticks = server.loop.core.ticks
    until(lambda: server.loop.core.ticks > ticks + 600)
    run, _ = reader.read(10**5)
    assert not run.commanded_handle_angle.any()
    assert run.operating_state[-1] == tn.control.OperatingState.PAUSED
    status = one.status()
    assert (status.protocol, status.recording, status.stopped) == (None, None, True)
    assert "play" not in [event["event"] for event in events(folder)]


def test_a_protocol_asks_for_nothing_after_a_stop(served, monkeypatch):
    """The stop comes within a turn of the protocol that then resumes and moves the hand."""
    folder, server = served
    one = operating(folder)
    one.request("enable")
    reader = Reader(folder)
    reached, go = threading.Event(), threading.Event()

    def turn(player):
        reached.set()
        assert go.wait(30)
        player._ask("resume")
        player._ask("home")
        player._queue.push(player._columns.row({"handle_angle": np.full(200, 0.1)}, 200))

    monkeypatch.setattr(protocol_runner.Player, "advance", turn)
    one.play(RAMP, record=False)
    assert reached.wait(30)
    thread, problems = failing(Client(folder, "other").stop)
    until(lambda: one.latest().get("stopped") == 1)
    until(lambda: server.runtime.protocols.stops == 1)
    go.set()
    thread.join(30)
    assert problems == []
    ticks = server.loop.core.ticks
    until(lambda: server.loop.core.ticks > ticks + 200)
    rows, _ = reader.rows(10**5)
    stopped = rows[:, TICK.index("stopped")]
    assert stopped[np.argmax(stopped) :].all()
    assert not one.latest()["commanded_handle_angle"]


def test_a_pause_is_the_operators_to_end_also_where_a_protocol_would_home(served):
    folder, server = served
    one = operating(folder)
    one.request("enable")
    one.play(RAMP, record=False)
    held = []
    for request in ("pause", "clear", "resume", "disable", "enable", "pause", "home"):
        one.request(request)
        held.append(server.runtime.protocols._player.held)
    assert held == [True, True, False, True, False, True, False]


def test_a_protocol_ends_when_another_takes_over(served):
    folder, _ = served
    one, other = operating(folder), Client(folder, "other")
    one.request("enable")
    one.play(RAMP, record=False)
    assert other.acquire(force=True)
    until(lambda: other.heartbeat() and other.status().protocol.problem is not None)
    assert other.status().protocol.problem == "the operator has left"


def connected(folder, says=b""):
    raw = socket.socket(socket.AF_UNIX)
    raw.settimeout(20)
    until(lambda: raw.connect_ex(str(folder / folders.SOCKET)) == 0)
    if says:
        raw.sendall(says)
        assert b"ok" in raw.recv(10_000)
    return raw


@pytest.mark.parametrize("says", [b"", b'{"op": "hello", "origin": "idle"}\n', b'{"op": "status"}\n' * 3])
def test_there_is_always_room_for_one_who_stops_and_the_operator_stays(served, says):
    folder, server = served
    one, watcher = operating(folder), Client(folder, "watcher")
    one.request("enable")
    crowd = [connected(folder, says) for _ in range(3 * servers._MOST_CLIENTS // 2)]
    assert len(server._clients) <= servers._MOST_CLIENTS
    late = Client(folder, "late")
    late.stop()
    until(lambda: one.latest().get("stopped") == 1)
    assert one.heartbeat()
    assert late.status().operator == "one"
    # Who was sent away comes back by asking.
    assert watcher.status().state == "PAUSED"
    watcher.stop()
    # Who was there first without saying more than others was sent away first, and everybody is notified.
    while crowd[0].recv(10_000):
        pass
    until(lambda: any(event["event"] == "sent_away" for event in events(folder)))
    for raw in crowd:
        raw.close()


def test_those_who_never_spoke_go_before_those_who_watch(served):
    folder, server = served
    watchers = [Client(folder, f"watcher {n}") for n in range(10)]
    crowd = [connected(folder) for _ in range(200)]
    origins = {connection.origin for connection in server._clients}
    assert {watcher.origin for watcher in watchers} <= origins
    for raw in crowd:
        raw.close()


def test_a_thread_that_cannot_be_had_for_one_leaves_room_for_the_next(served, monkeypatch):
    folder, _ = served

    class NoThread:
        def __init__(self, **_named):
            raise RuntimeError("can't start new thread")

    with monkeypatch.context() as short:
        short.setattr(servers, "threading", SimpleNamespace(Thread=NoThread))
        raw = connected(folder)
        assert raw.recv(10) == b""
    Client(folder, "next").stop()


def test_a_protocol_is_not_run_unrecorded_while_the_recording_before_is_closed(served):
    folder, server = served
    one = operating(folder)
    one.request("enable")
    one.record(True, "first")
    until(lambda: server.runtime.recorder.ready)
    recorder = server.runtime.recorder.status()["pid"]
    os.kill(recorder, signal.SIGSTOP)
    one.record(False)
    with refused("path", kind=LiveError):
        one.play(RAMP)
    assert one.status().protocol is None
    os.kill(recorder, signal.SIGCONT)
    until(lambda: one.status().recording is None)
    assert one.status().problem is None
    one.play(RAMP)
    assert one.status().recording is not None


def test_a_recorder_that_is_ended_before_it_began_is_said(served):
    folder, _ = served
    one = operating(folder)
    path = one.record(True, "short" * 100)
    one.record(False)
    until(lambda: one.status().recording is None)
    assert not path.exists()
    assert "there is no such file" in one.status().problem


def test_a_recording_tells_that_the_runtime_ended_and_which_ticks_were_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(LiveLoop, "unanswered", property(lambda loop: 7 if loop.core.ticks > 200 else 0))
    folder = tmp_path / "run"
    folder.mkdir()
    server = Server(looped(folder), tmp_path)
    server.start()
    with contextlib.closing(operating(folder)) as one:
        path = one.record(True)
        until(lambda: server.runtime.recorder.status().get("rows", 0) > 100)
        server.finish()
    events = [event.content for event in Recording.open(path).events]
    assert [content["event"] for content in events][-2:] == ["ended", "recording_ended"]
    missed = [content for content in events if content["event"] == "ticks_missed"]
    assert all(one["in_all"] - before["in_all"] == one["ticks"] for before, one in pairwise(missed))
    assert missed[-1]["in_all"] >= 7


def test_a_folder_that_others_can_enter_is_refused(tmp_path):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o755)
    given = SimpleNamespace(folder=tmp_path / "open", instrument="scaled-up")
    with refused("folder", kind=LiveError, allowed="its owner's alone"):
        servers._started(given)
    assert list((tmp_path / "open").iterdir()) == []


def test_an_order_of_the_operators_that_makes_no_sense_is_refused_in_a_sentence(served):
    folder, _ = served
    raw = connected(folder, b'{"op": "acquire"}\n')
    answers = raw.makefile("rb")
    for order, says in (
        ({"op": []}, "op is []; it must be one of hello, status"),
        ({"op": "hand", "angles": [True]}, "angles is [True]; it must be a list of finite numbers"),
        ({"op": "hand", "angles": [float("nan")]}, "angles is [nan]; it must be a list of finite numbers"),
        ({"op": "force", "force": [10**400]}, "it must be a list of finite numbers"),
        ({"op": "speed", "factor": float("inf")}, "factor is inf; it must be a finite number"),
        ({"op": "record", "on": 1}, "on is 1; it must be true or false"),
        ({"op": "play"}, "protocol is None; it must be the text of a protocol"),
        ({"op": "play", "protocol": RAMP.to_toml(), "record": [[]]}, "record is [[]]; it must be true or false"),
        ({"op": "law", "law": "off"}, "actuation is None; it must be text"),
        ({"op": "inject_fault", "point": "tick", "mode": "add", "value": 1, "seconds": 1, "axis": 2}, "axis is 2; it"),
    ):
        raw.sendall(json.dumps(order).encode() + b"\n")
        assert says in json.loads(answers.readline())["error"]
    raw.close()

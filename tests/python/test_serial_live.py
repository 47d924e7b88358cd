"""Claims about the live loop with boards: lock-step with the twin is what happens without a board, to the last bit; a
board with sensors of its own is followed tick by tick, does what it is asked once, and rests when either side is gone.
"""

import os
import signal
import socket
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tenodesis.control import Controller, OperatingState
from tenodesis.devices import registry
from tenodesis.devices.communication_test import measure
from tenodesis.devices.serial import SerialDevice
from tenodesis.errors import DeviceError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import Serial
from tenodesis.live import loop as loops
from tenodesis.live.loop import PROBLEMS, Choices, LiveLoop
from tenodesis.live.ticks import Reader
from tenodesis.run import Run, concatenate

from . import serial_board as sb
from .conftest import refused, until
from .serial_board import Frame, Streamed
from .test_live import commanded

pytestmark = pytest.mark.process

ENABLED, PAUSED, FAULT = OperatingState.ENABLED, OperatingState.PAUSED, OperatingState.FAULT


def with_board(inst: Instrument, sensors: str, timeout: float = 0.25) -> Instrument:
    return inst.replace(**{"devices.serial": {"sensors": sensors, "timeout": timeout}})


@pytest.fixture
def streaming(scaled: Instrument) -> Instrument:
    """One whose board measures by itself, and bears a machine that does something else for a while."""
    return with_board(scaled.replace(**{"control.watchdog": 0.5}), "board", timeout=5.0)


@contextmanager
def looped(inst: Instrument, folder: Path, address: str, late_bound: float = 2.0) -> Iterator[tuple[LiveLoop, Reader]]:
    folder.mkdir(exist_ok=True)
    choices = Choices(device="serial", address=address, real_time=False, late_bound=late_bound)
    loop = commanded(LiveLoop(inst, folder, choices), folder)
    try:
        yield loop, Reader(folder)
    finally:
        loop.finish()


def new_rows(reader: Reader) -> Run:
    """Give what has come since the last time, none of it lost."""
    run, lost = reader.read(10**5)
    assert lost == 0
    return run


def comes_to(loop: LiveLoop, reader: Reader, request: str, state: OperatingState) -> None:
    loop.request(request)
    wait_for_state(reader, state)


def begins_to_home(loop: LiveLoop, reader: Reader) -> None:
    """Ask for homing, and wait until it winds; no machine answers, so that it fails by itself after some seconds."""

    def winds() -> bool:
        run = new_rows(reader)
        # On a busy machine the homing before has failed, or a tick was late, before anyone asked for another.
        if len(run) and run.operating_state[-1] == FAULT:
            loop.request("clear")
            loop.request("home")
        return bool(np.any((run.operating_state == ENABLED) & run.commanded_spool_velocity.any(axis=1)))

    loop.request("home")
    until(winds)


def wait_for_state(reader: Reader, state: OperatingState) -> None:
    def reached() -> bool:
        states = new_rows(reader).operating_state
        return bool(len(states)) and states[-1] == state

    until(reached)


def is_at_rest(frame: Frame) -> bool:
    tick = Streamed.of(frame)
    return tick.state != ENABLED and tick.velocity == (0.0, 0.0)


# ---- the twin's sensors


def test_the_live_loop_with_its_controller_on_a_board_is_that_without_to_the_last_bit(
    tmp_path: Path, scaled: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands = {"handle_angle": np.radians(20) * np.arange(300) / 300, "force": 0.5 * (np.arange(300) >= 180)}

    def played(loop: LiveLoop, reader: Reader) -> Run:
        loop.request("enable")
        assert loop.push(loop.commands.row(commands, 300)) == 300
        loop.core.run_ticks(150)
        loop.choose("exact", "agonist")
        loop.core.run_ticks(150)
        return new_rows(reader)

    monkeypatch.setattr(loops, "Controller", partial(Controller, precision="single"))
    (tmp_path / "here").mkdir()
    here = commanded(LiveLoop(scaled, tmp_path / "here", Choices(real_time=False)), tmp_path / "here")
    expected = played(here, Reader(tmp_path / "here"))
    inst = with_board(scaled, "twin", timeout=10.0)
    with sb.qemu(tmp_path) as (address, _), looped(inst, tmp_path / "there", address) as (loop, reader):
        run = played(loop, reader)
        assert loop.problem is None
    for name, values in expected.signals().items():
        assert np.array_equal(run[name], values, equal_nan=True), name
    assert np.abs(run.commanded_spool_velocity[:150]).max() > 0.1
    assert len(set(run.phase[:150])) > 1


# ---- sensors of its own


def test_a_board_with_sensors_is_followed_and_does_what_it_is_asked(tmp_path: Path, streaming: Instrument) -> None:
    with sb.qemu(tmp_path) as (address, _):
        with looped(streaming, tmp_path / "live", address) as (loop, reader):
            assert not loop.capabilities.simulated
            assert loop.capabilities.clocked
            loop.start()
            for _ in range(3):
                begins_to_home(loop, reader)
                comes_to(loop, reader, "pause", PAUSED)
            begins_to_home(loop, reader)
            loop.stop()
            wait_for_state(reader, PAUSED)
            rows = [new_rows(reader)]

            def come() -> bool:
                rows.append(new_rows(reader))
                return np.count_nonzero(np.diff(np.concatenate([run.time for run in rows])) > 0) > 50

            until(come)
            run = concatenate([run for run in rows if len(run)])
            assert not np.any(run.commanded_spool_velocity)
            fresh = np.diff(run.time) > 0
            # It sends bytes between ticks, one by one, which may hold up the next.
            assert np.median(np.diff(run.time)[fresh]) == pytest.approx(loop.period, rel=0.1)
            assert run.measured_tension.mean() == pytest.approx(streaming.pretension, abs=5.0)
            assert loop.problem is None
            begins_to_home(loop, reader)
        # QEMU may lose what is on the line when that closes; then it is the board itself that has missed the loop.
        with sb.connected(address) as line, suppress(TimeoutError):
            line.settimeout(1.0)
            for _ in sb.frames_from(line, until=is_at_rest):
                pass


def test_a_board_that_is_killed_is_a_fault_and_the_loop_does_not_run_in_circles(
    tmp_path: Path, streaming: Instrument
) -> None:
    with sb.qemu(tmp_path) as (address, board), looped(streaming, tmp_path / "live", address) as (loop, reader):
        loop.start()
        begins_to_home(loop, reader)
        board.kill()
        wait_for_state(reader, FAULT)
        new_rows(reader)
        missed, since = loop.core.missed, time.monotonic()
        until(lambda: loop.core.missed > missed + 50)
        waited = time.monotonic() - since
        run = new_rows(reader)
        assert not np.any(run.commanded_spool_velocity)
        assert np.isnan(run.estimated_output_angle).all()
        # It waits two periods for each tick that does not come, however busy the machine.
        assert loop.core.missed - missed <= 1.2 * waited / loop.period + 50
        assert loop.problem == "the line's other end was closed"
        comes_to(loop, reader, "clear", FAULT)


def test_a_board_that_hangs_rests_and_goes_on_once_it_is_cleared(tmp_path: Path, streaming: Instrument) -> None:
    with sb.qemu(tmp_path) as (address, board), looped(streaming, tmp_path / "live", address) as (loop, reader):
        loop.start()
        begins_to_home(loop, reader)
        os.kill(board.pid, signal.SIGSTOP)
        wait_for_state(reader, FAULT)
        assert loop.problem is not None
        assert "no tick for" in loop.problem
        assert PROBLEMS[loop.core.problem] == PROBLEMS[3]
        os.kill(board.pid, signal.SIGCONT)
        time.sleep(0.2)
        loop.request("clear")
        until(lambda: bool(np.any(np.diff(new_rows(reader).time) > 0)))
        assert loop.controller.problem is None  # type: ignore[attr-defined]
        begins_to_home(loop, reader)


def test_requests_arrive_once_over_a_line_that_loses_doubles_and_damages(tmp_path: Path, streaming: Instrument) -> None:
    with sb.qemu(tmp_path) as (address, _):
        line = sb.BadLine(address, every=7)
        with line.between() as between, looped(streaming, tmp_path / "live", between) as (loop, reader):
            loop.start()
            line.bad = True
            for request, state in [("home", ENABLED), ("pause", PAUSED)] * 4:
                comes_to(loop, reader, request, state)
                time.sleep(0.02)
                assert set(new_rows(reader).operating_state) <= {state}

            def suffered() -> bool:
                counts = loop.controller.link_counts  # type: ignore[attr-defined]
                return min(counts.damaged, counts.stale, counts.board_damaged, loop.core.missed) > 0

            until(suffered)
            line.bad = False
            assert loop.problem is None
        assert min(line.done.values()) > 3


# ---- boards that lie


class StreamingBoard:
    """Streams ticks of a motor that turns, and from one on what it is given.

    Parameters
    ----------
    lie
        Returns the bytes that are sent instead of a tick, given a good one, its session and its sequence.
    """

    GOOD = 60

    def __init__(self, lie: Callable[[Streamed, int, int], bytes]) -> None:
        self._lie = lie
        self.heard: list[tuple[float, Frame]] = []
        self.lied_at = float("inf")

    def served(self) -> AbstractContextManager[str]:
        return sb.behind(self._serve)

    def _serve(self, server: socket.socket) -> None:
        with suppress(OSError):
            line, _ = server.accept()
            split, sequence, streams, session, kept, number = sb.Split(), 0, False, 0, 0, 0
            due = time.monotonic()
            with line:
                while True:
                    received = b""
                    line.settimeout(max(1e-4, due - time.monotonic()))
                    with suppress(TimeoutError):
                        received = line.recv(4096)
                        if not received:
                            return
                    for frame in filter(None, map(sb.decoded, split(received))):
                        self.heard.append((time.monotonic(), frame))
                        kept, session = frame.sequence, frame.session
                        streams = frame.type == sb.STREAM or (streams and frame.type != sb.STOP)
                        if frame.type == sb.KEEP:
                            number = struct.unpack("<2I", frame.payload[:8])[1]
                        else:
                            line.sendall(self._answer(frame))
                    if time.monotonic() < due:
                        continue
                    due = time.monotonic() + 0.005
                    if not streams:
                        continue
                    sequence += 1
                    good = Streamed(sequence * 5_000_000, kept, number, int(ENABLED), 1, velocity=(0.5, -0.5))
                    if sequence <= self.GOOD:
                        line.sendall(good.frame(session, sequence).encoded())
                    else:
                        self.lied_at = min(self.lied_at, time.monotonic())
                        line.sendall(self._lie(good, session, sequence))

    def _answer(self, frame: Frame) -> bytes:
        if frame.type == sb.HELLO:
            return sb.info(frame, streams=True).encoded()
        return Frame(sb.DONE, frame.session, frame.sequence).encoded()

    @property
    def kept_going(self) -> int:
        """How many ticks it was to go on for after it had begun to lie."""
        keeps = [at for at, frame in self.heard if frame.type == sb.KEEP and _rest(frame) == 0]
        return sum(at > self.lied_at for at in keeps)


def _rest(keep: Frame) -> int:
    return int(struct.unpack("<I", keep.payload[12:16])[0])


LIES: dict[str, tuple[str, Callable[[Streamed, int, int], bytes]]] = {
    "not a number": ("not_a_number", lambda t, s, n: t._replace(velocity=(float("nan"), 0.0)).frame(s, n).encoded()),
    "too fast": ("beyond_limit", lambda t, s, n: t._replace(velocity=(0.0, -1e3)).frame(s, n).encoded()),
    "no state": ("bad_answer", lambda t, s, n: t._replace(state=4).frame(s, n).encoded()),
    "the past": ("wrong_tick", lambda t, s, n: t._replace(time=5_000_000).frame(s, n).encoded()),
    "the same tick": ("link_lost", lambda t, s, n: t.frame(s, StreamingBoard.GOOD).encoded()),
    "another session": ("board_restarted", lambda t, s, n: t.frame(s ^ 1, n).encoded()),
    "was restarted": ("board_restarted", lambda t, s, n: Frame(sb.REFUSED, s, 0, struct.pack("<2I", 4, 0)).encoded()),
    "another version": ("wrong_version", lambda t, s, n: t.frame(s, n)._replace(version=sb.VERSION + 1).encoded()),
    "too short": ("bad_answer", lambda t, s, n: t.frame(s, n)._replace(payload=bytes(60)).encoded()),
    "silence": ("link_lost", lambda t, s, n: b""),
    "a flood of noise": ("damaged_frames", lambda t, s, n: b"\x05\x00" * 10_000),
    "a flood of the past": ("link_lost", lambda t, s, n: t.frame(s, StreamingBoard.GOOD - 20).encoded() * 200),
    "an endless frame": ("link_lost", lambda t, s, n: b"\x05" * 50_000),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_board_that_lies_is_named_and_kept_going_no_longer(lie: str, tmp_path: Path, scaled: Instrument) -> None:
    name, told_instead = LIES[lie]
    board = StreamingBoard(told_instead)
    # What is not heard is given up soon; what is heard may have to wait for the processor.
    silence, timeout = (0.3, 1.0) if name == "link_lost" else (2.0, 10.0)
    inst = with_board(scaled.replace(**{"sensors.sampling_rate": 200.0}), "board", timeout=timeout)
    with board.served() as address:
        with looped(inst, tmp_path / "live", address, late_bound=silence) as (loop, reader):
            loop.start()
            until(lambda: loop.controller.problem is not None)  # type: ignore[attr-defined]
            written = reader.written
            until(lambda: reader.written > written + 40)
            run, _ = reader.read(10**5)
            assert loop.controller.problem.name == name  # type: ignore[attr-defined]
            assert loop.problem
        unheard = lie in {"silence", "the same tick", "an endless frame"}
        if not unheard:
            # The board reads in a thread of its own, which a busy machine may delay.
            until(lambda: board.heard[-1][1].type == sb.STOP)
    moved = np.any(run.commanded_spool_velocity != 0, axis=1)
    assert moved[:40].any()
    assert not moved[-20:].any()
    assert run.operating_state[-1] == FAULT
    # Until the bound of silence has stopped it, or at once: by ticks, whatever time the machine takes for them.
    assert board.kept_going < 20 + (200 * silence if name == "link_lost" else 0)
    assert board.heard[-1][1].type == sb.STOP or unheard


def test_a_board_that_measures_nothing_is_refused(tmp_path: Path, scaled: Instrument) -> None:
    def reply(frame: Frame) -> list[bytes] | None:
        return [sb.refusal(frame, 7).encoded()] if frame.type == sb.STREAM else None

    with sb.served(sb.FakeBoard(reply)) as address, refused("port", kind=DeviceError, allowed="sensors of its own"):
        LiveLoop(with_board(scaled, "board"), tmp_path, Choices(device="serial", address=address))


# ---- the communication test


@pytest.mark.parametrize("sensors", ["twin", "board"])
def test_the_communication_test_measures_a_boards_line(tmp_path: Path, scaled: Instrument, sensors: str) -> None:
    with sb.qemu(tmp_path) as (address, _):
        device = SerialDevice(scaled, Serial(port=address, sensors=sensors, timeout=5.0))  # type: ignore[arg-type]
        found = measure(device, scaled, 1.0)
        assert not found.problem
        assert found.measurements > 5
        assert found.backward == found.twice == 0
        assert found.turned == 0
        assert bool(found.round_trips.size) == (sensors == "twin")
        if sensors == "board":
            assert found.quantile(0.5) == pytest.approx(1 / scaled.sensors.sampling_rate, rel=0.2)


def test_the_communication_test_names_a_board_that_falls_silent(scaled: Instrument) -> None:
    with StreamingBoard(lambda _tick, _session, _number: b"").served() as address:
        device = SerialDevice(scaled, Serial(port=address, sensors="board"))
        assert device.counts == {}
        found = measure(device, scaled, 20.0)
    assert "no tick for" in found.verdict
    assert not found.good


def test_an_address_is_for_serial_devices_only(scaled: Instrument) -> None:
    with refused("--address", kind=DeviceError, allowed="left out: canopen has none, only serial "):
        registry.make("canopen", scaled, "/dev/ttyACM0")
    assert isinstance(registry.make("serial", scaled, "/dev/ttyACM0"), SerialDevice)

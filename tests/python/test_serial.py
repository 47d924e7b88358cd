"""Claims about a controller on a board: the firmware under QEMU closes the loop with the twin to the last bit of the
controller in this process; and whatever line or board do wrong is named, and leaves the motors at rest."""

import os
import signal
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, OperatingState, Request
from tenodesis.control.export import INTERFACE_VERSION
from tenodesis.devices.serial import SerialController
from tenodesis.errors import ArgumentError, DeviceError, Error
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.twin import TIME_STEP, Twin

from . import serial_board as sb
from .conftest import EXAMPLES, refused
from .serial_board import Frame, Streamed

pytestmark = pytest.mark.process

PATIENT: dict[str, Any] = {"timeout": 20.0, "silence": 600.0}
"""For a board that computes beside everything else that this machine does."""


def step_load(inst: Instrument, seconds: float) -> tuple[Array, Array]:
    """Fig. 15 in short: the handle is brought to 33.2 deg and held, then 10 N hang on the load rig; rad, N."""
    clock = np.arange(1, round(seconds / TIME_STEP) + 1) * TIME_STEP
    share = np.clip(clock / (0.45 * seconds), 0, 1)
    handle = np.radians(33.2) * share**3 * (10 - 15 * share + 6 * share**2)
    return handle, np.where(clock > 0.6 * seconds, 10.0, 0.0)


def run_of(inst: Instrument, controller: Controller, seconds: float) -> Run:
    handle, weight = step_load(inst, seconds)
    if len(inst.axes) > 1:
        return Twin(inst, seed=1).run(np.stack([handle, -handle / 2], 1), 0.2, controller=controller)
    load = {"weight": weight} if inst.conditions.cable_pulley_radius else {"force": weight / 20}
    return Twin(inst, seed=1).run(handle, controller=controller, **load)


def differing(one: Run, other: Run) -> list[str]:
    """Names of the signals of which a bit differs; all that is not a number is alike."""
    return [
        name
        for name, values in one.signals().items()
        if not np.all(
            (values.view(np.uint64) == other[name].view(np.uint64)) | np.isnan(values) & np.isnan(other[name])
        )
    ]


@pytest.fixture(scope="module")
def board(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A board under QEMU that one line after another is opened to."""
    with sb.qemu(tmp_path_factory.mktemp("board")) as (address, _):
        yield address


def test_fig_15_with_the_controller_on_a_board_is_that_in_this_process_to_the_last_bit(
    board: str, scaled: Instrument
) -> None:
    inst = scaled
    with SerialController(board, inst, own_clock=True, **PATIENT) as there:
        run = run_of(inst, there, 0.8)
        here = Controller(inst, precision="single", own_clock=True)
        expected = run_of(inst, here, 0.8)
        assert there.problem is None
        assert differing(run, expected) == []
        assert there.counts() == here.counts()
        for one, other in zip(there.flight_record(), here.flight_record(), strict=True):
            np.testing.assert_array_equal(one, other)
    assert set(run.operating_state) == {OperatingState.ENABLED}
    assert np.abs(run.commanded_spool_velocity).max() > 0.5
    assert len(set(run.phase)) > 1


@pytest.mark.parametrize("name", ["real", "pulley", "continuum"])
def test_every_mechanism_and_two_axes_are_the_same_on_a_board(
    board: str, name: str, request: pytest.FixtureRequest
) -> None:
    inst: Instrument = request.getfixturevalue(name)
    with SerialController(board, inst, **PATIENT) as there:
        assert differing(run_of(inst, there, 0.06), run_of(inst, Controller(inst, precision="single"), 0.06)) == []
        assert there.problem is None
        # Once more from the start, with an observer that does not know its deviations.
    options: dict[str, Any] = {"observer": "paper", "law": "paper-feedback", "actuation": "agonist"}
    with SerialController(board, inst, **options, **PATIENT) as there:
        here = Controller(inst, **options, precision="single")
        assert differing(run_of(inst, there, 0.03), run_of(inst, here, 0.03)) == []
        there.reset()
        here.reset()
        assert differing(run_of(inst, there, 0.03), run_of(inst, here, 0.03)) == []


def test_requests_and_faults_go_through(board: str, scaled: Instrument) -> None:
    asked = {1: "pause", 3: "resume", 7: "clear", 8: "enable"}
    with SerialController(board, scaled, own_clock=True, **PATIENT) as there:
        here = Controller(scaled, precision="single", own_clock=True)
        states = []
        for tick in range(10):
            tension = (float("nan") if tick == 5 else 25.0, 25.0)
            given = (tick * 5e-4, 0.0, tension, (0.0, 0.0), asked.get(tick, "none"))
            out, expected = there.step(*given), here.step(*given)
            np.testing.assert_array_equal(out[0], expected[0])
            assert out[7:] == expected[7:]
            states.append(out.state.name[0])
        assert "".join(states) == "EPPEEFFDEE"
        assert there.counts() == here.counts()


# ---- a line that loses, doubles, delays and damages


def test_a_bad_line_slows_the_loop_down_and_changes_nothing(board: str, scaled: Instrument) -> None:
    line = sb.BadLine(board, every=9)
    with line.between() as address:
        there = SerialController(address, scaled, own_clock=True, timeout=20.0, repetitions=199, silence=600.0)
        line.bad = True
        run = run_of(scaled, there, 0.1)
        line.bad = False
        there.close()
    expected = run_of(scaled, Controller(scaled, precision="single", own_clock=True), 0.1)
    assert differing(run, expected) == []
    assert min(line.done.values()) > 5
    counts = there.link_counts
    assert min(counts.repetitions, counts.damaged, counts.stale, counts.board_damaged) > 2


def test_malformed_frames_move_nothing_and_are_counted(board: str, scaled: Instrument) -> None:
    random = np.random.default_rng(5)
    step = Frame(sb.STEP, 7, 2**31 - 1, bytes(36)).encoded()
    with SerialController(board, scaled, own_clock=True, **PATIENT) as there:
        there.step(0.0, 0.0, (25.0, 25.0), (0.0, 0.0))
    with sb.connected(board) as line:
        before = sb.answer_to(line, Frame(sb.HELLO, 0, 1)).payload
        noise = random.integers(0, 256, 3000, np.uint8).tobytes()
        flipped = [step[:n] + bytes([step[n] ^ 1 << n % 8]) + step[n + 1 :] for n in range(1, len(step) - 1)]
        malformed = noise + b"".join(flipped) + step[: len(step) // 2]
        assert sb.answer_to(line, Frame(sb.HELLO, 0, 2), malformed).payload == before
        for frame, why in (
            (Frame(sb.STEP, 7, 2**31 - 1, bytes(36), version=sb.VERSION + 1), 1),
            (Frame(sb.STEP, 0, 2**31 - 1, bytes(36)), 4),
            (Frame(sb.PARAMETERS, 7, 2**30, bytes(sb.PARAMETERS_SIZE)), 3),
        ):
            answer = sb.answer_to(line, frame)
            assert (answer.type, struct.unpack("<I", answer.payload[:4])[0]) == (sb.REFUSED, why)


# ---- a board or a line that is lost


def at_rest_from(run: Run) -> int:
    """Return the first step of the fault, after which nothing moves."""
    first = int(np.argmax(run.operating_state == OperatingState.FAULT))
    assert np.all(run.operating_state[first:] == OperatingState.FAULT)
    assert not run.commanded_spool_velocity[first:].any()
    assert np.isnan(run.estimated_output_angle[first:]).all()
    return first


def test_a_killed_board_is_a_fault_that_stays(tmp_path: Path, scaled: Instrument) -> None:
    with sb.qemu(tmp_path) as (address, process):
        there = SerialController(address, scaled, own_clock=True, **PATIENT)
        handle, _ = step_load(scaled, 0.2)
        twin = Twin(scaled, seed=1)
        moving = twin.run(handle, controller=there)
        assert np.abs(moving.commanded_spool_velocity[-1]).max() > 0
        timer = threading.Timer(0.3, process.kill)
        timer.start()
        run = twin.run(np.full(6000, handle[-1]), controller=there)
        first = at_rest_from(run)
        assert 0 < first < 6000
        assert there.problem is not None
        assert there.problem.name == "link_closed"
        still = twin.run(np.full(400, handle[-1]), controller=there)
        assert at_rest_from(still) == 0
        assert np.abs(still.spool_velocity[-1]).max() < 1e-6
        there.ask("clear")
        assert at_rest_from(twin.run(np.full(5, handle[-1]), controller=there)) == 0
        assert there.step(10.0, 0.0, (25.0, 25.0), (0.0, 0.0)).faults == ("tick_late",)


def test_a_board_that_hangs_is_a_fault_until_it_is_cleared(tmp_path: Path, scaled: Instrument) -> None:
    with sb.qemu(tmp_path) as (address, process):
        there = SerialController(address, scaled, own_clock=True, timeout=3.0, repetitions=0, silence=600.0)
        twin = Twin(scaled, seed=1)
        assert np.all(twin.run(np.zeros(20), controller=there).operating_state == OperatingState.ENABLED)
        os.kill(process.pid, signal.SIGSTOP)
        assert at_rest_from(twin.run(np.zeros(20), controller=there)) == 0
        assert there.problem is not None
        assert there.problem.name == "link_lost"
        os.kill(process.pid, signal.SIGCONT)
        assert at_rest_from(twin.run(np.zeros(5), controller=there)) == 0
        requests = np.zeros(10, int)
        requests[2], requests[5] = Request.CLEAR, Request.ENABLE
        run = twin.run(np.zeros(10), request=requests, controller=there)
        assert "".join(OperatingState(int(state)).name[0] for state in run.operating_state) == "FFDDDEEEEE"
        assert there.problem is None
        there.close()


def test_another_program_that_takes_the_board_is_named(board: str, scaled: Instrument) -> None:
    line = sb.BadLine(board, every=10**9)
    with line.between() as address, SerialController(address, scaled, own_clock=True, **PATIENT) as there:
        twin = Twin(scaled, seed=1)
        twin.run(np.zeros(5), controller=there)
        line.forget_session()
        assert at_rest_from(twin.run(np.zeros(5), controller=there)) == 0
        assert there.problem is not None
        assert there.problem.name == "board_restarted"
        there.reset()
        assert there.problem is None
        assert np.all(twin.run(np.zeros(5), controller=there).operating_state == OperatingState.ENABLED)


def test_a_board_that_hears_nothing_stops_by_itself(tmp_path: Path, scaled: Instrument) -> None:
    with (
        sb.qemu(tmp_path, by_instructions=False) as (address, _),
        SerialController(address, scaled, own_clock=True, timeout=20.0, silence=1.0) as there,
    ):
        twin = Twin(scaled, seed=1)
        twin.run(np.full(20, 0.01), controller=there)
        # The board's clock may be slower than the wall's where the machine is busy; each tick begins the silence anew.
        for silence in (1.5, 3.0, 6.0, 12.0):
            time.sleep(silence)
            run = twin.run(np.full(20, 0.01), controller=there)
            if run.operating_state[0] != OperatingState.ENABLED:
                break
        assert np.all(run.operating_state == OperatingState.PAUSED)
        assert not run.commanded_spool_velocity.any()
        assert there.stopped
        assert there.problem is None
        there.ask("resume")
        assert np.all(twin.run(np.full(2, 0.01), controller=there).operating_state == OperatingState.ENABLED)
        assert not there.stopped


def test_a_board_with_sensors_measures_steps_and_sends_by_itself(tmp_path: Path, scaled: Instrument) -> None:
    with sb.qemu(tmp_path, by_instructions=False) as (address, _):
        other = scaled.replace(**{"control.watchdog": 0.5})
        with SerialController(address, other, own_clock=True, **PATIENT) as there:
            image = there.core.parameters()
        with sb.connected(address) as line:
            parameters = Frame(sb.PARAMETERS, 9, 100, struct.pack("<2I", 0, 0) + image)
            assert sb.answer_to(line, parameters).type == sb.DONE
            line.sendall(Frame(sb.STREAM, 9, 101).encoded())
            frames = sb.frames_from(line)
            assert next(frames).type == sb.DONE
            # Enabled before its first tick, a board that has to wait for the processor would show no other state.
            ticks = [next(frames)]
            line.sendall(sb.keep(1, Request.ENABLE, 9, 102).encoded())
            for frame in frames:
                ticks.append(frame)
                if Streamed.of(frame).state == OperatingState.PAUSED:
                    break
    assert {frame.type for frame in ticks} == {sb.STREAMED}
    first = ticks[0].sequence
    assert [frame.sequence for frame in ticks] == list(range(first, first + len(ticks)))
    states = {Streamed.of(frame).state for frame in ticks}
    assert sorted(states) == [OperatingState.DISABLED, OperatingState.ENABLED, OperatingState.PAUSED]
    last = Streamed.of(ticks[-1])
    assert (last.kept, last.number, last.flags & 0b10100) == (102, 1, 0b10100)
    assert last.velocity == (0.0, 0.0)
    assert last.tension == pytest.approx((scaled.pretension, scaled.pretension), abs=1.0)


# ---- boards that are none, or lie

LIES: dict[str, tuple[str, Callable[[Frame], list[bytes]]]] = {
    "another version": ("wrong_version", lambda f: [sb.output(f)._replace(version=sb.VERSION + 1).encoded()]),
    "refuses the version": ("wrong_version", lambda f: [sb.refusal(f, 1, 9).encoded()]),
    "was restarted": ("board_restarted", lambda f: [sb.refusal(f, 4).encoded()]),
    "not a number": ("not_a_number", lambda f: [sb.output(f, float("nan")).encoded()]),
    "infinite": ("not_a_number", lambda f: [sb.output(f, float("-inf")).encoded()]),
    "too fast": ("beyond_limit", lambda f: [sb.output(f, 1e3).encoded()]),
    "the past": ("stale_answers", lambda f: [sb.output(f, sequence=f.sequence - 1).encoded()]),
    "another tick": ("wrong_tick", lambda f: [sb.output(f, time=17).encoded()]),
    "no state": ("bad_answer", lambda f: [sb.output(f, state=4).encoded()]),
    "no phase": ("bad_answer", lambda f: [sb.output(f, phase=7).encoded()]),
    "too short": ("bad_answer", lambda f: [sb.output(f)._replace(payload=bytes(20)).encoded()]),
    "another type": ("bad_answer", lambda f: [sb.output(f)._replace(type=sb.DONE).encoded()]),
    "damaged": ("damaged_frames", lambda f: [sb.output(f).encoded().replace(b"\x01", b"\x02")]),
    "a flood of noise": ("damaged_frames", lambda _: [b"\x05\x00" * 100_000]),
    "a flood of the past": ("stale_answers", lambda f: [sb.output(f, sequence=f.sequence - 1).encoded() * 2000]),
    "silence": ("link_lost", lambda _: []),
    "an endless frame": ("link_lost", lambda _: [b"\x05" * 500_000]),
}


@pytest.mark.parametrize("lie", LIES)
def test_a_board_that_lies_moves_no_motor(lie: str, scaled: Instrument) -> None:
    name, lying = LIES[lie]

    def reply(frame: Frame) -> list[bytes] | None:
        if frame.type != sb.STEP:
            return None
        return lying(frame) if fake.ticks > 10 else [sb.output(frame, 0.01, state=1).encoded()]

    fake = sb.FakeBoard(reply)
    # What does not answer is given up soon; an answer that comes may have to wait for the processor.
    timeout = 1.0 if name in ("link_lost", "stale_answers", "damaged_frames") else 20.0
    with sb.served(fake) as address, SerialController(address, scaled, timeout=timeout, repetitions=1) as there:
        run = Twin(scaled, seed=1).run(np.zeros(30), controller=there)
        assert at_rest_from(run) == 10
        assert np.all(run.commanded_spool_velocity[:10] == np.float32(0.01))
        assert there.problem is not None
        assert there.problem.name == name
        assert there.flight_record().fault_row is not None


@pytest.mark.parametrize(
    ("lie", "said"),
    [
        (lambda f: [sb.info(f)._replace(version=7).encoded()], "version 7 of the protocol"),
        (
            lambda f: [sb.info(f, interface=INTERFACE_VERSION + 1).encoded()],
            f"version {INTERFACE_VERSION + 1} of the C interface",
        ),
        (lambda f: [sb.info(f, real=8, parameters=1800).encoded()], "8 bytes"),
        (lambda f: [sb.info(f)._replace(payload=bytes(3)).encoded()], "3 bytes"),
        (lambda _: [b"login: "], "did not answer a hello"),
    ],
)
def test_what_is_no_board_of_this_version_is_refused(
    lie: Callable[[Frame], list[bytes]], said: str, scaled: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What does not answer is given up soon; an answer that comes may have to wait for the processor.
    monkeypatch.setattr("tenodesis.devices.serial._CONNECT_TIMEOUT", 0.5 if "did not answer" in said else 20.0)
    with sb.served(lie) as address, pytest.raises(DeviceError, match=said):
        SerialController(address, scaled, timeout=0.5)


def test_a_serial_port_does_what_a_socket_does(scaled: Instrument) -> None:
    fake = sb.FakeBoard(lambda frame: [sb.output(frame, 0.01, state=1).encoded()] if frame.type == sb.STEP else None)
    with sb.terminal(fake) as path, SerialController(path, scaled, timeout=5.0) as there:
        assert there.board.name == "fake"
        run = Twin(scaled, seed=1).run(np.zeros(20), controller=there)
        assert np.all(run.commanded_spool_velocity == np.float32(0.01))
        assert there.problem is None


@pytest.mark.parametrize(
    ("address", "error", "key"),
    [
        ("socket://127.0.0.1:1", DeviceError, "port"),
        ("unix:///nowhere/at/all", DeviceError, "port"),
        ("/dev/no-such-port", DeviceError, "port"),
        ("socket://127.0.0.1", ArgumentError, "address"),
        ("socket://127.0.0.1:99999", ArgumentError, "address"),
        ("http://127.0.0.1:80", ArgumentError, "address"),
    ],
)
def test_what_is_no_line_is_refused(address: str, error: type[Error], key: str, scaled: Instrument) -> None:
    with refused(key, address, kind=error):
        SerialController(address, scaled)


@pytest.mark.parametrize(
    "options", [{"timeout": 0.0}, {"timeout": float("nan")}, {"repetitions": -1}, {"silence": 0.0}, {"law": "best"}]
)
def test_bad_options_are_refused_before_a_board_is_asked(options: dict[str, Any], scaled: Instrument) -> None:
    with refused(*next(iter(options.items()))):
        SerialController("/dev/no-such-port", scaled, **options)


def test_the_image_of_the_parameters_is_what_the_compiler_makes_of_the_exported_header(
    tmp_path: Path, scaled: Instrument
) -> None:
    """The same numbers by another way: exported as C and compiled."""
    from .test_c_interface import COMPILER

    if COMPILER is None:
        pytest.skip("needs a C++ compiler")
    sent: list[bytes] = []
    fake = sb.FakeBoard(lambda frame: sent.append(frame.payload) if frame.type == sb.PARAMETERS else None)
    for name, inst in (
        ("scaled", scaled),
        ("real", tn.load("real-size")),
        ("bent", tn.load(EXAMPLES / "continuum.toml")),
    ):
        sent.clear()
        with sb.served(fake) as address:
            SerialController(address, inst, "exact", "exact", homed=False, own_clock=True, timeout=20.0).close()
        tn.control.export_header(
            inst, tmp_path / "other.h", "other", observer="exact", law="exact", homed=False, own_clock=True
        )
        source = '#include <cstdio>\n#include "other.h"\nint main() { std::fwrite(&other, sizeof other, 1, stdout); }\n'
        (tmp_path / "image.cpp").write_text(source)
        program = str(tmp_path / name)
        include = str(EXAMPLES.parent / "include")
        subprocess.run([COMPILER, "-std=c++20", f"-I{include}", str(tmp_path / "image.cpp"), "-o", program], check=True)
        image = subprocess.run([program], check=True, capture_output=True).stdout
        assert sent[0][8:] == image

"""The live loop of instruments given by joints and tendons: the same loop, with columns by their names."""

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import simulate
from tenodesis.control import Controller, OperatingState
from tenodesis.errors import ArgumentError, DeviceError, LiveError
from tenodesis.live import foxglove
from tenodesis.live.host import Host
from tenodesis.live.loop import PROBLEMS, Choices, LiveLoop, rehearse
from tenodesis.live.protocol_feed import Player
from tenodesis.live.ticks import Reader
from tenodesis.run import Run, concatenate
from tenodesis.statics import chain
from tenodesis.twin import Held, Twin

from .conftest import refused, until
from .test_live import looped
from .test_live_replacement import operating

NAMES = ("needle-driver", "two-segment-continuum", "hybrid-scaled-up")


def ran(loop: LiveLoop, reader: Reader, seconds: float) -> Run:
    """Take ticks, and return their rows."""
    count = round(seconds / loop.period)
    loop.core.run_ticks(count)
    run, lost = reader.read(count)
    assert lost == 0
    assert len(run) == count
    return run


def angles(loop: LiveLoop) -> np.ndarray:
    """Return angles to ask for."""
    count = len(loop.inst.handle_joints) or len(loop.inst.bends)
    return np.radians([12.0, -8.0, 15.0])[:count]


@pytest.mark.parametrize("actuation", ["differential", "agonist"])
def test_the_live_loop_of_a_chain_does_what_a_run_does_bit_for_bit(tmp_path: Path, actuation: Any) -> None:
    inst = tn.load("hybrid-scaled-up")
    loop = looped(tmp_path, inst, seed=3, actuation=actuation)
    reader = Reader(tmp_path)
    share = np.arange(1, 2001) / 2000
    handle = np.outer(share, angles(loop))
    wrench = np.outer(share > 0.5, [0.5, 0.2, 0, 0, 0, 0])
    # The motor that no controller commands winds a little meanwhile.
    motors = np.zeros((2000, 5))
    motors[1500:, 4] = 0.02
    loop.request("enable")
    rows = loop.commands.row({"handle_angle": handle, "wrench": wrench, "spool_velocity": motors}, 2000)
    assert loop.push(rows) == 2000
    live = ran(loop, reader, 1.0)
    controller = Controller(tn.control.compensated(inst), actuation=actuation)
    run = Twin(inst, seed=3).run(handle, wrench=wrench, spool_velocity=motors, controller=controller)
    assert np.abs(live.time - run.time).max() < 1e-12
    assert live.names == run.names
    for name, values in run.signals().items():
        assert np.array_equal(live[name], values, equal_nan=True), name


def test_the_live_law_of_all_joints_does_what_a_run_does_bit_for_bit_and_is_switched(tmp_path: Path) -> None:
    inst = tn.load("needle-driver")
    loop = looped(tmp_path, inst, seed=3)
    reader = Reader(tmp_path)
    share = np.arange(1, 2001) / 2000
    wrench = np.outer(share > 0.5, [1.0, 2.0, 0, 0, 0, 0])
    motors = np.zeros((2000, 6))
    motors[500:1000, :2] = 0.3, -0.3
    loop.request("enable")
    rows = loop.commands.row({"wrench": wrench, "spool_velocity": motors}, 2000)
    assert loop.push(rows) == 2000
    live = ran(loop, reader, 1.0)
    controller = tn.control.JointController(inst)
    run = Twin(inst, seed=3).run(np.zeros((2000, 0)), wrench=wrench, spool_velocity=motors, controller=controller)
    assert live.names == run.names
    for name, values in run.signals().items():
        assert np.array_equal(live[name], values, equal_nan=True), name
    left = run["output_angle"][-1] - run["commanded_output_angle"][-1]
    loop.choose("off", "differential")
    lost = ran(loop, reader, 1.0)["output_angle"][-1] - run["commanded_output_angle"][-1]
    assert abs(lost[0]) > 2 * abs(left[0])


@pytest.mark.parametrize("name", NAMES)
def test_joints_go_where_the_operator_asks_but_for_friction(tmp_path: Path, name: str) -> None:
    loop = looped(tmp_path, tn.load(name).replace(friction={"law": "none"}))
    reader = Reader(tmp_path)
    loop.request("enable")
    loop.hand(angles(loop))
    run = ran(loop, reader, 1.5)
    strokes = 0.0 if loop.inst.handle_joints else run["spool_angle"][-1] * loop._spool_radius
    target = chain.output_angles(loop.inst, run.by_column("handle_angle")[-1], strokes=strokes)
    assert run.by_column("output_angle")[-1] == pytest.approx(target, abs=1e-3)
    if name == "needle-driver":
        assert target == pytest.approx(angles(loop), abs=1e-3)


def test_motors_without_a_law_rest_until_they_are_enabled_and_from_a_stop_on(tmp_path: Path) -> None:
    loop = looped(tmp_path, tn.load("needle-driver"), law="off")
    reader = Reader(tmp_path)
    loop.hand(angles(loop))
    off = ran(loop, reader, 0.2)
    assert not off.commanded_spool_velocity.any()
    loop.request("enable")
    assert not ran(loop, reader, 0.2).commanded_spool_velocity[1:].any(), "what was asked before does not count"
    loop.hand(angles(loop))
    on = ran(loop, reader, 0.1)
    assert on.commanded_spool_velocity.any()
    fastest = np.abs(on.commanded_spool_velocity).max()
    assert fastest <= loop._motor_speed + 1e-12
    loop.stop()
    stopped = ran(loop, reader, 0.2)
    assert not stopped.commanded_spool_velocity.any()
    assert reader.layout.signals_of(reader.newest())["state"] == OperatingState.PAUSED
    loop.request("resume")
    assert not ran(loop, reader, 0.2).commanded_spool_velocity.any(), "what was asked before the stop does not count"


def test_a_lease_that_runs_out_pauses_motors_without_a_law(tmp_path: Path) -> None:
    loop = looped(tmp_path, tn.load("needle-driver"), law="off")
    reader = Reader(tmp_path)
    loop.core.lease(0.05)
    loop.request("enable")
    loop.hand(angles(loop))
    ran(loop, reader, 0.05)
    time.sleep(0.06)
    over = ran(loop, reader, 0.1)
    assert not over.commanded_spool_velocity[2:].any()
    assert loop.problem == PROBLEMS[4]
    loop.request("enable")
    loop.hand(angles(loop))
    assert not ran(loop, reader, 0.1).commanded_spool_velocity.any(), "without an operator nothing is released"


def test_a_motor_without_a_law_does_not_wind_beyond_the_largest_tension(tmp_path: Path) -> None:
    inst = tn.load("needle-driver").replace(control={"tension_limit": 25.0})
    loop = looped(tmp_path, inst, law="off")
    reader = Reader(tmp_path)
    loop.request("enable")
    # Both tendons of the pitch at once: they pull against each other.
    loop.move_motors([1.0, 1.0, 0, 0, 0, 0])
    run = ran(loop, reader, 1.0)
    # What a drive still winds while it stops.
    assert run["tension"].max() < 30.0
    assert not run.commanded_spool_velocity[-100:].any()
    assert "largest tension" in str(loop.problem)
    loop.request("resume")
    loop.move_motors(np.zeros(6))
    assert ran(loop, reader, 1.0)["tension"].max(axis=1)[-1] == pytest.approx(inst.pretension, abs=1.0)
    assert loop.problem is None


def test_motors_that_move_together_stay_together_where_one_is_at_its_largest_speed(tmp_path: Path) -> None:
    loop = looped(tmp_path, tn.load("needle-driver"), law="off")
    reader = Reader(tmp_path)
    loop.request("enable")
    ran(loop, reader, 0.01)
    loop.move_motors([1.0, -1.0, 0.4, -0.4, 0.2, -0.2])
    run = ran(loop, reader, 3.0)
    turned = run["spool_angle"]
    assert turned[-1] == pytest.approx([1.0, -1.0, 0.4, -0.4, 0.2, -0.2], abs=2e-3)
    assert np.abs(turned[:, 2] - 0.4 * turned[:, 0]).max() < 1e-2
    assert np.abs(turned[:, 4] - 0.2 * turned[:, 0]).max() < 1e-2


def test_what_the_jaws_hold_presses_back_until_it_is_taken_away(tmp_path: Path) -> None:
    loop = looped(tmp_path, tn.load("needle-driver"))
    reader = Reader(tmp_path)
    loop.request("enable")
    ran(loop, reader, 0.01)
    loop.hand([0, 0.3, -0.3])
    angle = ran(loop, reader, 1.0).by_column("output_angle")[-1]
    with refused("held.opening", 1.0):
        loop.hold(Held(1.0, 5e3), angle)
    loop.hold(Held(0.5 * float(loop.inst.grip_arms @ angle), 5e3), angle)
    loop.hand([0, 0.05, -0.05])
    assert ran(loop, reader, 1.0)["grip_force"][-1] > 0.1
    loop.hold(None, angle)
    assert ran(loop, reader, 0.1)["grip_force"][-1] == 0


@pytest.mark.parametrize(
    ("name", "order", "says"),
    [
        ("needle-driver", lambda loop: loop.force([1.0]), "force cannot be given to needle-driver: it takes wrench"),
        ("needle-driver", lambda loop: loop.wrench([np.nan, 0, 0, 0, 0, 0]), "wrench is .*6 finite numbers"),
        ("needle-driver", lambda loop: loop.choose("robust", "agonist"), "it must be one of off, joints"),
        ("needle-driver", lambda loop: loop.inject_fault("tick", "add", 1, 1), "takes no injected faults"),
        ("needle-driver", lambda loop: loop.move_motors([0.1]), "angles is .*6 finite numbers"),
        ("two-segment-continuum", lambda loop: loop.grip_force(1.0), "nothing that grips"),
        ("scaled-up", lambda loop: loop.wrench(np.zeros(6)), "wrench cannot be given"),
        ("scaled-up", lambda loop: loop.move_motors([0.1]), "no motors but those that its controller commands"),
    ],
)
def test_what_an_instrument_does_not_take_is_refused_in_a_sentence(
    tmp_path: Path, name: str, order: Any, says: str
) -> None:
    loop = looped(tmp_path, tn.load(name))
    with pytest.raises((LiveError, ArgumentError), match=says):
        order(loop)


def test_a_board_serves_only_joints_with_a_law() -> None:
    with pytest.raises(DeviceError, match="serves pairs of tendons, and no joint of needle-driver"):
        rehearse(tn.load("needle-driver"), Choices(device="serial"))


def played_on(loop: LiveLoop, reader: Reader, protocol: simulate.Protocol) -> Iterator[Run]:
    """Play a protocol, and yield the run in parts of 20 ms."""
    player = Player(
        protocol.plan(loop.inst, loop.period),
        SimpleNamespace(push=loop.push, drop=loop.drop, **{"pending": 0}),
        loop.request,
        lambda: reader.layout.signals_of(reader.newest()),
        inst=loop.inst,
        assumed=loop.assumed,
        columns=loop.commands,
        time_step=loop.period,
    )
    while not player.finished:
        player._queue.pending = loop.pending
        player.advance()
        yield ran(loop, reader, 0.02)


def test_a_protocol_begins_with_straight_joints_wherever_the_one_before_has_left_them(tmp_path: Path) -> None:
    loop = looped(tmp_path, tn.load("needle-driver"))
    reader = Reader(tmp_path)
    loop.request("enable")
    ran(loop, reader, 0.01)
    bent = simulate.Ramp(duration=0.3, handle_angles={"pitch": 0.3, "jaw_1": -0.2})
    rest = simulate.Hold(duration=0.3)
    for phases, end in (([bent, rest], [0.3, -0.2, 0.0]), ([rest], [0.0, 0.0, 0.0])):
        *_, last = played_on(loop, reader, simulate.Protocol(name="bent", phases=phases))
        assert last["commanded_output_angle"][-1] == pytest.approx(end, abs=np.radians(0.02))
        assert last["output_angle"][-1] == pytest.approx(end, abs=0.01)


@pytest.mark.parametrize("name", ["hybrid-scaled-up", "needle-driver"])
def test_a_protocol_on_a_live_chain_is_commanded_tick_by_tick_with_what_the_jaws_hold(
    tmp_path: Path, name: str
) -> None:
    inst = tn.load(name)
    loop = looped(tmp_path, inst, law="off" if name == "needle-driver" else "robust")
    reader = Reader(tmp_path)
    loop.request("enable")
    ran(loop, reader, 0.01)
    phases: list[Any] = [
        simulate.StepLoad(wrench=simulate.Wrench(fy=0.5), delay=0.05, duration=0.2, release=0.1),
        simulate.Ramp(duration=0.2, spool_velocities={inst.tendons[loop.motors[-1]].name: 0.1}),
    ]
    wanted = simulate.Protocol(name="loads", phases=tuple(phases)).commands(inst, loop.period)
    phases += [simulate.GrippedObject(stiffness=2e3), simulate.Hold(duration=0.3)]
    protocol = simulate.Protocol(name="loads", phases=tuple(phases))
    runs, held = [], []
    for run in played_on(loop, reader, protocol):
        runs.append(run)
        held.append(reader.layout.signals_of(reader.newest())["commands"]["held"])
    assert max(stiffness for _, stiffness, _ in held) == 2e3
    ran(loop, reader, 0.02)
    assert not reader.layout.signals_of(reader.newest())["commands"]["held"].any()
    run = concatenate(runs)
    loaded = np.flatnonzero(run.wrench.any(axis=1))[0] - np.flatnonzero(wanted["wrench"].any(axis=1))[0]
    played = run.rows(int(loaded), int(loaded) + len(wanted["wrench"]))
    assert np.array_equal(played.wrench, wanted["wrench"])
    free = played.commanded_spool_velocity[:, loop.motors]
    assert np.array_equal(free, wanted["spool_velocity"][:, loop.motors])


@pytest.mark.process
def test_a_chain_runs_in_the_live_process_is_recorded_and_shown(tmp_path: Path) -> None:
    host = Host("needle-driver", Choices(real_time=False), tmp_path)
    try:
        with closing(host.connect("test")) as link, operating(link):
            assert link.acquire()
            link.request("enable")
            file = link.record(True, "wrist")
            assert file is not None
            until(file.exists)
            link.hand([0.2, -0.1, 0.1])
            link.wrench([0.3, 0, 0, 0, 0, 0])
            with foxglove.FoxgloveServer(Reader(host.folder), port=0) as server:
                until(lambda: abs(float(link.latest()["output_angle"][0]) - 0.2) < 0.05)
                assert server.publish()
            link.stop()
            until(lambda: link.status().state == "PAUSED")
            assert link.heartbeat()
            link.record(False)
            until(lambda: not link.status().recording)
    finally:
        host.close()
    recording = tn.recording.Recording.open(file)
    assert recording.instrument() == tn.load("needle-driver")
    assert recording.run.tendons == tuple(one.name for one in tn.load("needle-driver").tendons)
    assert recording.run["wrench"][-1, 0] == 0.3
    assert recording.run["measured_output_angle"][-1, 0] == pytest.approx(0.2, abs=0.05)
    happened = [event.content["event"] for event in recording.events]
    assert {"hand", "wrench", "request", "state"} <= set(happened)

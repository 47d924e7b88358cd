"""Claims about protocols on a live instrument: the loop does what was planned, or stands still and says why."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import OperatingState
from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.live.protocol_feed import Player
from tenodesis.run import Array, concatenate
from tenodesis.simulate import Chirp, Cycles, Motion, Pretension, Protocol, Ramp, StepLoad

from .live_loop import TURN, LiveLoop

STEPS = Protocol(
    name="steps",
    phases=(
        StepLoad(handle_angle=0.2, force=0.8, delay=0.1, duration=0.3, release=0.2),
        Cycles(amplitude=0.15, period=0.8, count=1, force=0.4),
    ),
)
HOMING = Protocol(name="homing", phases=(Pretension(timeout=30.0), *STEPS.phases[:1]))


def player(loop: LiveLoop, protocol: Protocol) -> Player:
    plan = protocol.plan(loop.inst, loop.time_step)
    return Player(plan, loop, loop.ask, loop.latest, **loop.playing)


def turns(playing: Player, loop: LiveLoop, most: int = 2000, ticks: int = TURN) -> None:
    """Take turns until it is over, or waits for somebody."""
    for _ in range(most):
        playing.advance()
        if playing.finished or playing.problem is not None:
            return
        loop.ticks(ticks)
    raise AssertionError("it goes on")


def go_on(playing: Player, loop: LiveLoop, count: int) -> None:
    for _ in range(count):
        playing.advance()
        loop.ticks(TURN)


def commanded(loop: LiveLoop) -> Array:
    """Return what was commanded, shape (ticks, 3), without the ticks in which nothing changed."""
    run = concatenate(loop.runs)
    rows = np.stack([run["commanded_handle_angle"], run["force"], run["radial_force"]], -1)
    return np.asarray(rows.reshape(len(run), -1))


def planned(protocol: Protocol, loop: LiveLoop) -> Array:
    commands = protocol.commands(loop.inst, loop.time_step)
    rows = np.stack([commands[name] for name in ("handle_angle", "force", "radial_force")], -1)
    return np.asarray(rows.reshape(len(rows), -1))


def test_the_loop_is_commanded_what_was_planned_tick_by_tick(loop: LiveLoop) -> None:
    playing = player(loop, STEPS)
    turns(playing, loop)
    rows = planned(STEPS, loop)
    found = commanded(loop)[TURN : TURN + len(rows)]
    assert (found == rows).all()
    assert playing.finished
    assert playing.problem is None
    assert playing.progress == (playing.progress.total,) * 2
    assert playing.progress.total == pytest.approx(STEPS.duration(loop.inst, loop.time_step))
    assert loop.asked == ["enable"]
    before = len(loop.runs)
    playing.advance()
    playing.cancel()
    assert len(loop.runs) == before


def test_chirps_load_steps_and_joined_motions_are_commanded_as_planned(loop: LiveLoop) -> None:
    data = "time,angle\n0,0\n0.2,4\n0.4,8\n"
    protocol = Protocol(
        name="swept",
        phases=(
            Chirp(amplitude=0.1, start_frequency=5, end_frequency=10, duration=0.6, load_steps=[{"force": 0.5}]),
            Chirp(force_amplitude=0.2, start_frequency=5, end_frequency=10, duration=0.4),
            Motion(data=data, angle_unit="deg"),
            Motion(data=data, angle_unit="deg", offset="8 deg"),
        ),
    )
    turns(player(loop, protocol), loop)
    rows = planned(protocol, loop)
    assert (commanded(loop)[TURN : TURN + len(rows)] == rows).all()


def test_the_tip_does_what_it_does_offline(loop: LiveLoop, scaled: Instrument) -> None:
    """The same protocol after the same time enabled at rest, executed by the function that records protocols."""
    twin = tn.twin.Twin(scaled)
    controller = tn.control.Controller(scaled, enabled=False)
    rest = {"handle_angle": np.zeros(TURN), "request": np.r_[1, np.zeros(TURN - 1)].astype(np.uint8)}
    twin.run(**rest, controller=controller)
    offline = tn.simulate.execute(twin, STEPS, controller)
    turns(player(loop, STEPS), loop)
    live = concatenate(loop.runs)
    rows = slice(TURN, TURN + len(offline))
    for name in ("output_angle", "measured_tension", "estimated_output_angle", "commanded_spool_velocity"):
        assert (live[name][rows] == offline[name]).all(), name


def test_both_axes_are_commanded(tmp_path: Path) -> None:
    loop = LiveLoop(tmp_path, tn.load("real-size"))
    assert len(loop.inst.axes) == 2
    loop.ask("enable")
    loop.ticks(TURN)
    protocol = Protocol(
        name="both",
        phases=(
            Cycles(axis="yaw", amplitude=0.1, period=0.4, count=1),
            StepLoad(axis="pitch", handle_angle=0.1, force=0.2, duration=0.1),
        ),
    )
    turns(player(loop, protocol), loop)
    commands = protocol.commands(loop.inst, loop.time_step)
    run = concatenate(loop.runs)
    rows = slice(TURN, TURN + len(commands["force"]))
    assert (run["commanded_handle_angle"][rows] == commands["handle_angle"]).all()
    assert (run["force"][rows] == commands["force"]).all()


def test_the_queue_never_runs_dry_and_is_never_far_ahead(loop: LiveLoop) -> None:
    playing = player(loop, STEPS)
    rows = len(planned(STEPS, loop))
    given = 0
    for _ in range(rows // TURN - 2):
        playing.advance()
        given += TURN
        assert TURN <= loop.pending <= max(round(0.1 / loop.time_step), 5 * TURN)
        loop.ticks(TURN)
        assert playing.progress.done == pytest.approx(given * loop.time_step)


def test_faster_time_takes_more_ahead(loop: LiveLoop) -> None:
    """Ten times as fast, after a turn in which it cannot know."""
    playing = player(loop, STEPS)
    turns(playing, loop, ticks=10 * TURN)
    moved = commanded(loop)
    dry = 10 * TURN - 200
    rows = planned(STEPS, loop)
    assert (moved[TURN : TURN + 200] == rows[:200]).all()
    assert (moved[TURN + 200 + dry :][: len(rows) - 200] == rows[200:]).all()


def test_it_begins_where_the_instrument_is_without_a_jump(loop: LiveLoop) -> None:
    loop.hand(0.3)
    loop.load(0.6)
    loop.ticks(2000)
    before = sum(map(len, loop.runs))
    playing = player(loop, STEPS)
    turns(playing, loop)
    rows = planned(STEPS, loop)
    found = commanded(loop)[before:]
    begins = int(np.flatnonzero((found == 0).all(axis=1))[0]) + 1
    way = np.vstack([commanded(loop)[before - 1], found[:begins]])
    speed = np.abs(np.diff(way[:, 0])) / loop.time_step
    assert 0.9 * np.radians(20) < speed.max() < 1.001 * np.radians(20)
    assert (np.diff(way[:, :2], axis=0) <= 1e-12).all()
    assert way[0, 1] == 0.6
    assert np.abs(np.diff(way[:, 1])).max() < 0.01
    assert (found[begins : begins + len(rows)] == rows).all()


def test_in_a_fault_nothing_is_asked_or_sent(loop: LiveLoop) -> None:
    loop.inject_fault(1, 1, 1e6, 120)
    loop.ticks(10 * TURN)
    playing = player(loop, HOMING)
    go_on(playing, loop, 5)
    assert "clear it and home the instrument to go on" in str(playing.problem)
    assert loop.asked == ["enable"]
    assert not commanded(loop).any()


def test_a_fault_stops_what_is_sent_and_it_goes_on_once_it_is_mended(loop: LiveLoop) -> None:
    playing = player(loop, STEPS)
    go_on(playing, loop, 20)
    # The agonist's load cell is 1 MN off for 60 ms.
    loop.inject_fault(1, 1, 1e6, 120)
    turns(playing, loop)
    assert loop.latest()["operating_state"] == OperatingState.FAULT
    assert playing.problem is not None
    assert playing.problem.startswith("steps: phase 1 (step-load) waits at ")
    assert "fault " in playing.problem
    assert playing.problem.endswith("clear it and enable the instrument to go on, or cancel the protocol.")
    done = playing.progress.done
    go_on(playing, loop, 30)
    assert loop.pending == 0
    stood = commanded(loop)[-20 * TURN :]
    assert (stood == stood[0]).all()
    assert playing.progress.done <= done + 0.11
    mend(loop)
    turns(playing, loop)
    assert playing.finished
    assert playing.problem is None
    check_all_of_it(loop, STEPS)


def mend(loop: LiveLoop) -> None:
    """Do what an operator would to get on after a fault."""
    for request in ("clear", "home"):
        loop.ask(request)
        loop.ticks(TURN)
    for _ in range(1000):
        if not loop.latest()["homing"]:
            break
        loop.ticks(TURN)
    loop.ask("resume")
    loop.ticks(TURN)
    assert loop.latest()["operating_state"] == OperatingState.ENABLED


def check_all_of_it(loop: LiveLoop, protocol: Protocol) -> None:
    """Check that nothing planned was left out or done twice, but for standing still."""

    def changes(rows: Array) -> Array:
        return rows[np.r_[True, (np.diff(rows, axis=0) != 0).any(axis=1)]]

    assert changes(commanded(loop)).tolist() == changes(np.vstack([np.zeros(3), planned(protocol, loop)])).tolist()


@pytest.mark.parametrize("paused", [0, 1, 20])
def test_a_pause_holds_it_and_resuming_goes_on(paused: int, loop: LiveLoop) -> None:
    playing = player(loop, STEPS)
    go_on(playing, loop, 20)
    loop.ask("pause")
    loop.ticks(TURN)
    playing.advance()
    assert playing.problem is not None
    assert "the instrument is PAUSED; resume it to go on" in playing.problem
    go_on(playing, loop, paused)
    loop.ask("resume")
    loop.ticks(TURN)
    turns(playing, loop)
    assert playing.finished
    check_all_of_it(loop, STEPS)


def test_after_a_stop_the_handle_goes_back_smoothly_to_where_it_goes_on(loop: LiveLoop) -> None:
    playing = player(loop, STEPS)
    go_on(playing, loop, 90)
    loop.stop()
    loop.ticks(TURN)
    turns(playing, loop)
    loop.hand(-0.2)
    go_on(playing, loop, 50)
    assert commanded(loop)[-1, 0] == pytest.approx(-0.2, abs=1e-3)
    stopped = sum(map(len, loop.runs))
    loop.ask("resume")
    loop.ticks(TURN)
    turns(playing, loop)
    assert playing.finished
    rows = commanded(loop)[stopped:]
    planned_speed = np.abs(np.diff(planned(STEPS, loop)[:, 0])).max()
    assert np.abs(np.diff(rows[:, 0])).max() <= max(planned_speed, np.radians(20) * loop.time_step) * 1.001
    assert (rows[-1] == planned(STEPS, loop)[-1]).all()


def test_an_instrument_that_is_not_enabled_is_not_moved(tmp_path: Path, scaled: Instrument) -> None:
    loop = LiveLoop(tmp_path, scaled)
    loop.ticks(TURN)
    playing = player(loop, STEPS)
    turns(playing, loop)
    assert playing.problem is not None
    assert playing.problem.endswith("the instrument is DISABLED; enable it to go on, or cancel the protocol.")
    go_on(playing, loop, 5)
    assert not commanded(loop).any()
    assert loop.asked == []
    loop.ask("enable")
    loop.ticks(TURN)
    turns(playing, loop)
    assert playing.finished
    unhomed = LiveLoop(tmp_path / "..", scaled, homed=False, ring=f"{tmp_path.name}/unhomed")
    unhomed.ticks(TURN)
    playing = player(unhomed, STEPS)
    turns(playing, unhomed)
    assert "is DISABLED and not homed; home and resume it to go on" in str(playing.problem)


def test_cancelling_stops_at_once_and_forgets_what_was_ahead(loop: LiveLoop) -> None:
    playing = player(loop, STEPS)
    go_on(playing, loop, 100)
    playing.advance()
    assert loop.pending
    done = playing.progress.done
    playing.cancel()
    at, before = commanded(loop)[-2:]
    assert (at != before).any()
    go_on(playing, loop, 10)
    assert (commanded(loop)[-10 * TURN :] == before).all()
    assert playing.finished
    assert playing.progress.done == done < playing.progress.total


def test_a_bench_whose_handle_nobody_commands_is_not_approached(loop: LiveLoop) -> None:
    def latest() -> dict[str, Any]:
        return loop.latest() | {"commands": {}}

    plan = STEPS.plan(loop.inst, loop.time_step)
    playing = Player(plan, loop, loop.ask, latest, **loop.playing)
    turns(playing, loop)
    rows = planned(STEPS, loop)
    assert (commanded(loop)[TURN : TURN + len(rows)] == rows).all()


@pytest.mark.parametrize(
    ("phases", "said"),
    [
        ((Pretension(tension=3.0),), "tension is 3 N; with a controller it must be"),
        ((Ramp(duration=1.0, spool_velocity=(1.0, 1.0)),), "spool_velocity is given"),
    ],
)
def test_what_no_controller_can_run_is_refused_before_it_begins(
    phases: tuple[Any, ...], said: str, loop: LiveLoop
) -> None:
    with pytest.raises(ProtocolError, match=said):
        player(loop, Protocol(name="refused", phases=phases))
    assert loop.pending == 0

"""Homing within a protocol on a live instrument: by the protocol, by its operator, or not at all."""

from pathlib import Path

import numpy as np
import pytest

from tenodesis.control import OperatingState
from tenodesis.errors import LiveError
from tenodesis.instrument import Instrument
from tenodesis.live.protocol_feed import Player
from tenodesis.run import concatenate
from tenodesis.simulate import Pretension, Protocol, Ramp

from .live_loop import TURN, LiveLoop
from .test_live_protocols import HOMING, STEPS, commanded, go_on, planned, player, turns

PAUSED = Protocol(name="paused", phases=(Ramp(handle_angle=0.0, duration=0.3), Pretension(timeout=30.0)))


def test_a_pretension_phase_is_homing_and_what_follows_is_as_planned(tmp_path: Path, scaled: Instrument) -> None:
    loop = LiveLoop(tmp_path, scaled, homed=False, loosened=2e-3)
    loop.ticks(TURN)
    playing = player(loop, HOMING)
    far = [0.0]
    while not playing.finished:
        playing.advance()
        loop.ticks(TURN)
        far.append(playing.progress.done)
        if "resume" not in loop.asked:
            assert far[-1] - far[-2] == pytest.approx(TURN * loop.time_step if far[-1] else 0.0)
            homed = far[-1]
    assert playing.problem is None
    assert 0.5 < homed < 30
    assert far == sorted(far)
    assert next(done for done in far if done > homed) >= 30
    assert loop.asked == ["home", "resume"]
    run = concatenate(loop.runs)
    assert run["operating_state"][-1] == OperatingState.ENABLED
    assert loop.latest()["homed"] == 1
    loaded = int(np.flatnonzero(run["force"])[0])
    # Of both tendons: with a bent handle friction divides it between them.
    assert run["measured_tension"][loaded - 200 : loaded].mean() == pytest.approx(scaled.pretension, abs=2.0)
    alone = Protocol(name="steps", phases=HOMING.phases[1:])
    rows = planned(alone, loop)
    moving = int(np.flatnonzero(run["commanded_handle_angle"])[0])
    assert (commanded(loop)[moving : moving + len(rows)] == rows).all()
    assert playing.progress.total == pytest.approx(30 + len(rows) * loop.time_step)


def test_homing_waits_until_the_handle_is_straight_and_the_tip_free(tmp_path: Path, scaled: Instrument) -> None:
    loop = LiveLoop(tmp_path, scaled)
    loop.hand(0.3)
    loop.load(0.5)
    loop.ticks(2000)
    asked: list[tuple[str, int, list[float]]] = []

    def ask(request: str) -> None:
        asked.append((request, loop.pending, commanded(loop)[-1].tolist()))
        loop.ask(request)

    plan = HOMING.plan(scaled, loop.time_step)
    turns(Player(plan, loop, ask, loop.latest, **loop.playing), loop)
    assert asked == [("home", 0, [0.0, 0.0, 0.0]), ("resume", 0, [0.0, 0.0, 0.0])]


def test_cancelling_while_homing_pauses_the_motors(tmp_path: Path, scaled: Instrument) -> None:
    loop = LiveLoop(tmp_path, scaled, homed=False, loosened=2e-3)
    loop.ticks(TURN)
    playing = player(loop, HOMING)
    go_on(playing, loop, 10)
    assert loop.latest()["homing"] == 1
    playing.cancel()
    loop.ticks(TURN)
    assert loop.asked == ["home", "pause"]
    assert loop.latest()["operating_state"] == OperatingState.PAUSED


def test_homing_that_lasts_too_long_is_paused_and_is_the_operators_to_repeat(
    tmp_path: Path, scaled: Instrument
) -> None:
    loop = LiveLoop(tmp_path, scaled, homed=False, loosened=2e-3)
    loop.ticks(TURN)
    quick = Protocol(name="quick", phases=(Pretension(timeout=0.2), *STEPS.phases[:1]))
    playing = player(loop, quick)
    turns(playing, loop)
    assert loop.asked == ["home", "pause"]
    assert "it has not homed within 0.2 s; home the instrument to go on" in str(playing.problem)
    loop.ticks(TURN)
    go_on(playing, loop, 10)
    assert loop.latest()["operating_state"] == OperatingState.PAUSED
    assert loop.asked == ["home", "pause"]
    assert playing.problem is not None
    assert not commanded(loop).any()


def test_homing_that_a_fault_ends_goes_on_after_the_operator_homed(tmp_path: Path, scaled: Instrument) -> None:
    loop = LiveLoop(tmp_path, scaled, homed=False, loosened=2e-3)
    loop.ticks(TURN)
    playing = player(loop, HOMING)
    go_on(playing, loop, 10)
    loop.inject_fault(1, 1, 1e6, 120)
    turns(playing, loop)
    assert "clear it and home the instrument to go on" in str(playing.problem)
    loop.ticks(10 * TURN)
    loop.ask("clear")
    loop.ticks(TURN)
    go_on(playing, loop, 10)
    assert loop.asked == ["home", "clear"]
    loop.ask("home")
    loop.ticks(TURN)
    playing.advance()
    turns(playing, loop)
    assert playing.finished
    assert loop.asked == ["home", "clear", "home", "resume"]


def test_an_instrument_that_does_not_home_is_told(tmp_path: Path, scaled: Instrument) -> None:
    """It hears nothing of what it is asked."""
    loop = LiveLoop(tmp_path, scaled)
    loop.ticks(TURN)
    plan = HOMING.plan(scaled, loop.time_step)
    asked: list[str] = []
    playing = Player(plan, loop, asked.append, loop.latest, **loop.playing)
    turns(playing, loop)
    assert asked == ["home"]
    assert "the instrument does not begin to home; home it to go on" in str(playing.problem)
    assert not commanded(loop).any()


def test_a_protocol_does_not_home_over_the_operators_pause(loop: LiveLoop) -> None:
    """A pause when the last commands before homing are on their way already."""
    playing = player(loop, PAUSED)
    while loop.pending + sum(map(len, loop.runs)) < TURN + 600:
        playing.advance()
        loop.ticks(TURN)
    assert playing.problem is None
    playing.held = True
    loop.ask("pause")
    loop.ticks(400)
    turns(playing, loop)
    assert playing.problem is not None
    assert "the operator has paused it, and it is PAUSED; home it to go on" in playing.problem
    assert loop.asked == ["enable", "pause"]
    assert concatenate(loop.runs)["operating_state"][-400:].max() == OperatingState.PAUSED
    playing.held = False
    loop.ask("home")
    loop.ticks(TURN)
    for _ in range(2000):
        playing.advance()
        if playing.finished:
            break
        loop.ticks(TURN)
    assert playing.finished
    assert loop.asked == ["enable", "pause", "home", "resume"]


def test_a_protocol_does_not_resume_over_the_operators_pause_after_homing(loop: LiveLoop) -> None:
    playing = player(loop, HOMING)
    while not loop.latest()["homing"]:
        playing.advance()
        loop.ticks(TURN)
    while loop.latest()["homing"]:
        loop.ticks(TURN)
        if loop.latest()["homing"]:
            playing.advance()
    playing.held = True
    loop.ask("pause")
    loop.ticks(TURN)
    turns(playing, loop)
    assert playing.problem is not None
    assert "the instrument is PAUSED; resume it to go on" in playing.problem
    assert "resume" not in loop.asked


def test_what_cannot_forget_its_commands_still_pauses_homing_when_it_is_cancelled(
    tmp_path: Path, scaled: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = LiveLoop(tmp_path, scaled, homed=False, loosened=2e-3)
    loop.ticks(TURN)
    playing = player(loop, HOMING)
    while not loop.latest()["homing"]:
        playing.advance()
        loop.ticks(TURN)

    def full() -> None:
        raise LiveError("too many commands at once; this one was refused.")

    monkeypatch.setattr(loop, "drop", full)
    with pytest.raises(LiveError):
        playing.cancel()
    loop.ticks(TURN)
    assert loop.asked[-1] == "pause"
    assert not loop.latest()["homing"]

"""Claims about tissue in protocols: on a twin, in recordings and their replay, and on a live instrument."""

import math
from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import _core, simulate
from tenodesis.control import Controller
from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.recording import Recording
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record
from tenodesis.run import TISSUE, concatenate
from tenodesis.simulate import Cycles, Hold, Pretension, Protocol, TissueContact
from tenodesis.twin import Contact, Twin

from .conftest import refused
from .live_loop import TURN, LiveLoop
from .test_live_protocols import player, turns
from .twin_motions import same

PHASE = 'name = "p"\n[[phases]]\nkind = "contact"\n'
PRESS = Protocol(
    name="press",
    phases=(
        TissueContact(angle=math.radians(10), stiffness=1e3, damping=5.0),
        Cycles(amplitude=0.15, period=1.0, count=1),
        TissueContact(stiffness=0.0),
        Cycles(amplitude=0.15, period=1.0, count=1),
    ),
)


def test_the_shipped_protocol_presses_into_tissue_and_lets_go(scaled: Instrument) -> None:
    run = simulate.execute(Twin(scaled), simulate.load("tissue"))
    force = run["contact_force"]
    assert 0.3 < force.max() < 1.5
    assert force[-1] == 0
    assert (run["contact_stiffness"] == 1e3).all()
    assert np.degrees(run["contact_angle"][0]) == pytest.approx(28)


def test_tissue_is_there_from_its_phase_until_it_is_taken_away(scaled: Instrument) -> None:
    run = simulate.execute(Twin(scaled), PRESS)
    half = len(run) // 2
    assert (run["contact_stiffness"][:half] == 1e3).all() and (run["contact_stiffness"][half:] == 0).all()
    assert run["contact_force"][:half].max() > 0.1
    assert (run["contact_force"][half:] == 0).all()
    whole = Twin(scaled).run(run["commanded_handle_angle"][:half], contact=Contact(math.radians(10), 1e3, 5.0))
    np.testing.assert_array_equal(run["contact_force"][:half], whole["contact_force"])


def test_a_phase_with_a_duration_takes_its_tissue_away(scaled: Instrument) -> None:
    protocol = Protocol(
        name="p", phases=(TissueContact(angle=0.2, stiffness=1e3, side="flexion", duration=0.2), Hold(duration=0.1))
    )
    run = simulate.execute(Twin(scaled), protocol)
    assert np.count_nonzero(run["contact_stiffness"]) == round(0.2 * len(run) / 0.3)
    assert run["contact_stiffness"][-1] == 0


def test_it_lies_on_the_side_and_the_axis_that_are_given(real: Instrument) -> None:
    protocol = Protocol(
        name="p",
        phases=(
            TissueContact(axis="pitch", angle=-0.1, stiffness=500.0, side="extension"),
            Cycles(axis="pitch", amplitude=-0.15, period=1.0, count=1),
        ),
    )
    run = simulate.execute(Twin(real), protocol)
    assert not run["contact_force"][:, 0].any()
    assert run["contact_force"][:, 1].min() < -0.02
    assert run["contact_force"].max() == 0


def test_a_joint_with_a_pair_of_its_own_meets_tissue_beside_others_that_share_tendons() -> None:
    wrist = tn.load("hybrid-scaled-up")
    run = simulate.execute(Twin(wrist), simulate.load("tissue"))
    assert 0.3 < run["contact_force.yaw"].max() < 1.5
    assert not run["contact_force"][:, 1:].any()
    assert np.abs(run["wrench"]).max() == 0


def test_a_protocol_without_tissue_is_as_before(scaled: Instrument) -> None:
    run = simulate.execute(Twin(scaled), Protocol(name="p", phases=PRESS.phases[3:]))
    assert not set(TISSUE) & run.signals().keys()
    assert (run["contact_force"] == 0).all()


def test_a_file_is_read_with_its_units_and_written_again(scaled: Instrument) -> None:
    text = PHASE + 'stiffness = "1 N/mm"\ndamping = "5 N*s/m"\nangle = "28 deg"\nside = "extension"\nduration = "2 s"\n'
    protocol = simulate.parse(text)
    (phase,) = protocol.phases
    assert phase == TissueContact(stiffness=1e3, damping=5.0, angle=math.radians(28), side="extension", duration=2.0)
    assert simulate.parse(protocol.to_toml()) == protocol
    assert simulate.parse(PRESS.to_toml()) == PRESS
    assert protocol.duration(scaled) == 2.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("angle = '28 deg'", "phase 1 (contact): stiffness is missing"),
        ("stiffness = '1 N/mm'", "phase 1 (contact): angle is missing; give the output angle"),
        ("angle = '28 deg'\nstiffness = '1 N/mm'\nside = 'left'", "side = 'left': it must be 'flexion' or 'extension'"),
    ],
)
def test_wrong_files_are_refused(given: str, message: str) -> None:
    with pytest.raises(ProtocolError) as caught:
        simulate.parse(f"{PHASE}{given}\n")
    assert message in str(caught.value)


def test_a_place_beyond_the_stop_is_refused(scaled: Instrument) -> None:
    protocol = Protocol(name="p", phases=(TissueContact(angle=2.5, stiffness=1e3),))
    with refused("angle", kind=ProtocolError):
        protocol.plan(scaled, 1e-3)


def test_tissue_where_the_tip_is_is_refused(scaled: Instrument) -> None:
    protocol = Protocol(name="p", phases=(TissueContact(angle=-0.1, stiffness=1e3), Hold(duration=0.1)))
    with pytest.raises(ProtocolError) as caught:
        simulate.execute(Twin(scaled), protocol)
    assert str(caught.value).startswith("p: phase 1 (contact): angle is -5.72958 deg, but the tip, at 0 deg, is inside")


def test_commands_alone_do_not_say_what_tissue_does(scaled: Instrument) -> None:
    with refused("phase", "contact", kind=ProtocolError):
        PRESS.commands(scaled, 1e-3)


@pytest.mark.parametrize("controlled", [False, True], ids=["alone", "with a controller"])
@pytest.mark.parametrize("name", ["scaled", "real"])
def test_a_recording_has_tissue_and_replays_bit_for_bit(
    request: pytest.FixtureRequest, name: str, controlled: bool, tmp_path: Path
) -> None:
    inst = request.getfixturevalue(name)
    path = tmp_path / "run.mcap"
    run = record(inst, PRESS, path, controller=Controller(inst) if controlled else None, seed=3)
    recording = Recording.open(path)
    same(run, recording.run)
    assert {"contact_force", *TISSUE} <= recording.run.signals().keys()
    again = replay(recording)
    assert again.exact
    assert again.run["contact_force"].max() > 0.01


def test_a_recording_that_begins_with_slack_tendons_has_tissue_too(scaled: Instrument, tmp_path: Path) -> None:
    protocol = Protocol(name="p", phases=(Pretension(), *PRESS.phases[:2]))
    run = record(scaled, protocol, tmp_path / "run.mcap")
    assert run["contact_stiffness"][0] == 0 and run["contact_stiffness"][-1] == 1e3


def test_a_recording_without_it_stays_readable(scaled: Instrument, tmp_path: Path) -> None:
    from dataclasses import replace

    old = replace(Twin(scaled).run(np.zeros(50)), contact_force=None)
    with tn.Recorder(tmp_path / "old.mcap", axes=old.axes) as recorder:
        recorder.write(old)
    assert Recording.open(tmp_path / "old.mcap").run.contact_force is None


# Live


def test_a_live_tip_meets_tissue_as_it_does_offline(loop: LiveLoop, scaled: Instrument) -> None:
    twin, controller = Twin(scaled), Controller(scaled, enabled=False)
    request = np.r_[1, np.zeros(TURN - 1)].astype(np.uint8)
    twin.run(handle_angle=np.zeros(TURN), request=request, controller=controller)
    offline = simulate.execute(twin, PRESS, controller)
    turns(player(loop, PRESS), loop)
    live = concatenate(loop.runs)
    rows = slice(TURN, TURN + len(offline))
    for name in ("output_angle", "contact_force", "measured_tension", *TISSUE):
        assert (live[name][rows] == offline[name]).all(), name
    assert live["contact_force"].max() > 0.1


@pytest.mark.parametrize("cancelled", [False, True], ids=["done", "cancelled"])
def test_tissue_goes_with_its_protocol(loop: LiveLoop, cancelled: bool) -> None:
    protocol = Protocol(name="p", phases=(PRESS.phases[0], simulate.Ramp(duration=0.5, handle_angle=0.2)))
    playing = player(loop, protocol)
    if cancelled:
        for _ in range(20):
            playing.advance()
            loop.ticks(TURN)
        playing.cancel()
    else:
        turns(playing, loop)
    assert loop.latest()["contact_force"] > 0.1
    loop.ticks(TURN)
    assert loop.latest()["contact_stiffness"] == loop.latest()["contact_force"] == 0


def test_tissue_where_a_live_tip_is_waits_until_it_has_left(loop: LiveLoop) -> None:
    loop.hand(0.25)
    loop.ticks(4000)
    at = float(loop.latest()["output_angle"])
    commands = {"handle_angle": np.linspace(0.25, 0.0, 4000), "contact": (Contact(at / 2, 1e3),)}
    rows = loop.layout.commands.row(commands, 4000)
    loop.push(rows[:2000])
    loop.ticks(100)
    assert loop.latest()["contact_stiffness"] == 0
    assert loop._runtime.problem == _core.LoopProblem.IN_TISSUE
    loop.ticks(1900)
    loop.push(rows[2000:])
    loop.ticks(2000)
    assert loop.latest()["contact_stiffness"] == 1e3
    assert loop._runtime.problem == 0
    assert (concatenate(loop.runs)["contact_force"] == 0).all()

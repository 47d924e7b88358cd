"""What the page draws and reckons, without a browser."""

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import kinematics
from tenodesis.console.display import shown_signals
from tenodesis.console.plots import SLACK, TensionColours
from tenodesis.console.scene import extents, with_short_stem
from tenodesis.console.solids import solids
from tenodesis.console.status import ADVICE, CURRENT_ADVICE, CURRENT_REMEDIES, HOMING_REMEDIES, status_line
from tenodesis.console.tab_files import compare, repeated
from tenodesis.console.tab_law import ACTUATIONS, LAWS
from tenodesis.console.tab_move import motion_protocol, next_to_try
from tenodesis.control import FAULTS, HOMING_REASONS
from tenodesis.control.controller import ActuationName, LawName
from tenodesis.errors import ProtocolError, RecordingError
from tenodesis.instrument import Instrument
from tenodesis.kinematics.chain import skeleton
from tenodesis.live.status import RuntimeState

from .conftest import EXAMPLES, ROOT, refused


@pytest.fixture(params=[*tn.shipped(), EXAMPLES / "pulley.toml", EXAMPLES / "continuum.toml"], ids=str)
def inst(request: pytest.FixtureRequest) -> Instrument:
    """Every instrument that comes with the package, and every mechanism."""
    return tn.load(request.param)


def test_every_solid_is_closed_and_lies_on_a_body_of_its_own_name(inst: Instrument) -> None:
    drawn = with_short_stem(inst)
    found = solids(drawn)
    assert all(solid.mesh.is_volume for solid in found)
    assert {solid.body for solid in found} <= kinematics.frames(drawn, 0.0).bodies.keys()
    assert len(found) == len({(solid.body, solid.name) for solid in found})


def test_a_stem_drawn_short_leaves_both_ends_as_they_are(inst: Instrument) -> None:
    drawn = with_short_stem(inst)
    assert extents(drawn)[::2] == pytest.approx(extents(inst)[::2])
    assert extents(drawn)[1] <= extents(inst)[1]
    joints = skeleton(inst).inst
    angles = np.full(len(joints.tip_joints), 0.4), np.full(len(joints.handle_joints), 0.3)
    whole, cut = (kinematics.frames(one, *angles).bodies for one in (inst, drawn))
    assert whole.keys() == cut.keys()
    starts = {"stem": "stem"} | {f"{joint.name}_far": "stem" for joint in joints.tip_joints}
    first = [f"{joint.name}_far" for joint in joints.handle_joints[:1]]
    starts |= {name: first[0] for name in cut if first and name not in starts and "handle" in name}
    for end, start in starts.items():
        ways = [bodies[end].position - bodies[start].position for bodies in (whole, cut)]
        assert ways[0] == pytest.approx(ways[1], abs=1e-12)


def test_what_the_hand_asks_for_is_the_output_angle_without_load(any_inst: Instrument) -> None:
    axes = len(any_inst.axes)
    angles = np.linspace(-any_inst.handle_range, any_inst.handle_range, 7)
    handle = np.stack([angles] * axes, -1)
    seen = shown_signals(any_inst, {"time": np.arange(7.0), "handle_angle": handle if axes > 1 else angles})
    for n, name in enumerate(any_inst.axes):
        alone = any_inst.axis(name) if axes > 1 else any_inst
        assert seen.target[:, n] == pytest.approx(tn.statics.output_angle(alone, angles), abs=1e-12)
    assert seen.tension.shape == (7, 2 * axes)
    assert np.isnan(seen.tension).all()


def test_the_tip_is_shown_by_the_best_that_is_known(scaled: Instrument) -> None:
    nothing = np.nan
    measured = {"time": 0.0, "output_angle": nothing, "measured_output_angle": 0.2, "estimated_output_angle": 0.3}
    assert shown_signals(scaled, measured).output == pytest.approx([0.2])
    assert shown_signals(scaled, measured | {"output_angle": 0.1}).output == pytest.approx([0.1])
    assert shown_signals(scaled, measured | {"measured_output_angle": nothing}).output == pytest.approx([0.3])


def test_colours_tell_slack_from_tight_and_redden_to_the_limit(scaled: Instrument) -> None:
    colours = TensionColours(scaled)
    tension = np.array([0.0, np.nan, 0.5 * colours.slack, 1.0, 25.0, colours.limit, 10 * colours.limit])
    found = colours(tension)
    assert [tuple(one) for one in found[:3]] == [SLACK] * 3
    assert found[3, 2] > found[3, 0]
    assert (found[5] == found[6]).all()
    assert found[5, 0] > 2 * found[5, 2]
    assert f"limit {colours.limit:.3g} N" in colours.legend()
    assert "pretension 25 N" in colours.legend()


@pytest.mark.parametrize(
    ("handle", "force", "state", "law", "says"),
    [
        (0.0, 0.0, "DISABLED", "robust", "Move the handle"),
        (0.3, 0.0, "DISABLED", "robust", "Apply the load"),
        (0.3, 1.0, "DISABLED", "robust", "Press *Enable*"),
        (-0.3, -1.0, "PAUSED", "robust", "Press *Resume*"),
        (0.3, 1.0, "ENABLED", "robust", "choose *off*"),
        (0.3, 1.0, "ENABLED", "off", "choose *robust*"),
    ],
)
def test_a_newcomer_is_led_from_the_handle_to_the_law(
    handle: float, force: float, state: str, law: str, says: str
) -> None:
    seen = SimpleNamespace(handle=np.array([0.0, handle]), force=np.array([force, 0.0]), wrench=np.full(6, np.nan))
    now: Any = SimpleNamespace(shown=seen, status=SimpleNamespace(state=state, law=law))
    assert says in next_to_try(now, tn.load("real-size"))


def test_nothing_is_proposed_while_a_fault_has_to_be_cleared() -> None:
    seen = SimpleNamespace(handle=np.array([0.3]), force=np.array([1.0]), wrench=np.full(6, np.nan))
    now: Any = SimpleNamespace(shown=seen, status=SimpleNamespace(state="FAULT", law="robust"))
    assert next_to_try(now, tn.load("scaled-up")) == ""


def test_two_recordings_differ_by_the_rms_of_their_difference() -> None:
    time = np.linspace(0, 2 * np.pi, 4001)
    later = np.linspace(5, 5 + 4 * np.pi, 3000)
    found = compare((time, np.sin(time)), (later, np.sin(later - 5) + 0.1 * np.cos(later - 5)))
    assert found.time[-1] == pytest.approx(2 * np.pi)
    assert found.rms == pytest.approx(0.1 / np.sqrt(2), rel=1e-3)
    assert found.largest == pytest.approx(0.1, rel=1e-3)
    with refused("tip_angle", kind=RecordingError, allowed="in both recordings"):
        compare((time, np.sin(time)), (later, np.full(later.shape, np.nan)))
    with refused("rows", 1, kind=RecordingError):
        compare((time[:1], time[:1]), (later, later))


def test_a_recorded_motion_is_read_by_the_names_of_its_columns(scaled: Instrument) -> None:
    protocol = motion_protocol(b"# a wrist\nangle_deg,time_s\n0,0\n10,1\n-5,2\n", "wrist.csv")
    angles = protocol.commands(scaled, 1e-3)["handle_angle"]
    assert np.degrees(angles.max()) == pytest.approx(10)
    assert np.degrees(angles[-1]) == pytest.approx(-5)
    with pytest.raises(ProtocolError, match=r"x\.csv has the columns a, b; it must have"):
        motion_protocol(b"a,b\n1,2\n", "x.csv")
    with pytest.raises(ProtocolError, match="not UTF-8"):
        motion_protocol(b"\xff\xfe", "x.csv")
    with pytest.raises(ProtocolError, match="at_rad is 'x'"):
        motion_protocol(b"time,at_rad\n0,1\n1,x\n", "x.csv")


def test_a_recording_is_repeated_by_the_hand(scaled: Instrument, tmp_path: Path) -> None:
    handle = 0.3 * np.sin(np.linspace(0, 3, 2000)) ** 2
    run = tn.twin.Twin(scaled).run(handle)
    path = tmp_path / "run.mcap"
    with tn.Recorder(path, axes=run.axes) as recorder:
        recorder.write(run)
    again = repeated(tn.Recording.open(path)).commands(scaled, 5e-4)["handle_angle"]
    encoder = run["measured_handle_angle"]
    assert np.abs(again[-encoder.size :] - encoder[-again.size :]).max() < 0.01


def test_an_instrument_with_currents_is_not_said_to_have_load_cells(scaled: Instrument) -> None:
    # That they are too coarse is put right by load cells.
    failures = {f"axis{n}": reason for n, reason in enumerate(HOMING_REMEDIES) if reason != "too_coarse"}
    flags = dict.fromkeys(("homed", "homing", "stopped", "problem", "recorder_lost", "operator"))
    status: Any = SimpleNamespace(
        state="FAULT", faults=FAULTS, first_faults=(), homing_failures=failures, wound={}, **flags
    )
    assert "load cell" in status_line(status, "")
    assert "load cell" not in status_line(status, "", currents=True)
    currents = {"sensors.kind": "current", "sensors.current_range": 6.0, "drives.torque_constant": 0.1}
    seen = shown_signals(scaled.replace(**currents), {"time": 0.0, "measured_tension": [20.0, 40.0]})
    assert seen.current == pytest.approx(np.array([1.0, 2.0]))
    assert np.isnan(shown_signals(scaled, {"time": 0.0, "measured_tension": [20.0, 40.0]}).current).all()


@pytest.mark.parametrize(("state", "button"), [("PAUSED", "Resume"), ("DISABLED", "Enable"), ("FAULT", "Clear")])
def test_the_page_says_how_far_stopped_motors_hold_the_tip_and_what_takes_it_back(state: str, button: str) -> None:
    flags = dict.fromkeys(("homed", "homing", "stopped", "problem", "recorder_lost", "operator"))
    given = {"faults": (), "first_faults": (), "homing_failures": {}, **flags}
    wound = {"yaw": np.radians(-7.3), "pitch": np.radians(0.1)}
    line = status_line(SimpleNamespace(state=RuntimeState(state), wound=wound, **given), "")  # type: ignore[arg-type]
    assert "yaw: the motors hold the tip -7.3°" in line
    assert button in line
    assert "pitch" not in line
    working: Any = SimpleNamespace(state=RuntimeState.ENABLED, wound=wound, **given)
    assert "yaw" not in status_line(working, "")


def test_every_fault_and_every_choice_has_its_words() -> None:
    assert tuple(ADVICE) == FAULTS
    assert ("none", *HOMING_REMEDIES) == tuple(HOMING_REASONS)
    assert {*CURRENT_ADVICE} < {*ADVICE}
    assert {*CURRENT_REMEDIES} < {*HOMING_REMEDIES}
    # What forces homing says so.
    header = (ROOT / "include/tenodesis/fault.hpp").read_text("utf-8")
    forcing = re.findall(r"Fault::(\w+)", header.partition("needs_homing")[2].partition("}")[0])
    assert len(forcing) == 7
    assert not [name for name in forcing if " home" not in ADVICE[name].remedy]
    assert tuple(LAWS) == (*LawName.__args__, "joints")
    assert tuple(ACTUATIONS) == ActuationName.__args__

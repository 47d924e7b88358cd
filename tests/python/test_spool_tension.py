"""Claims about drives that hold a tension that is commanded, whatever their spools do for it."""

from math import exp
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w

import tenodesis as tn
from tenodesis.errors import ArgumentError, ProtocolError
from tenodesis.instrument import FullForm
from tenodesis.live.layout import CommandColumns
from tenodesis.live.protocol_feed import Player
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record
from tenodesis.simulate import Protocol

REAL = tn.load("real-size").replace(axes=("yaw",))


def two_segments() -> FullForm:
    """Joints with springs of their own: tensions alone hold no others."""
    return tn.load("two-segment-continuum").replace(friction={}).expanded


def test_at_rest_every_tendon_has_its_tension_and_the_joints_are_where_the_statics_have_them_at_these_strokes() -> None:
    inst = two_segments()
    tensions = inst.pretensions * np.linspace(0.9, 1.2, len(inst.tendons))
    wrench = np.array([0.1, -0.05, 0.1, 0, 0, 0])
    run = tn.twin.Twin(inst, quasi_static=True).run(
        np.zeros((20, len(inst.handle_joints))), wrench=wrench, spool_tension=tensions
    )
    np.testing.assert_allclose(run["tension"][-1], tensions, rtol=1e-12)
    strokes = inst.own_drives.spool_radius * run["spool_angle"][-1]
    rest = tn.statics.chain.equilibrium(inst, np.zeros(len(inst.handle_joints)), wrench, strokes=strokes)
    np.testing.assert_allclose(run["output_angle"][-1], rest.output_angle, atol=1e-9)
    np.testing.assert_allclose(rest.tensions, tensions, rtol=1e-9)


def test_a_load_moves_the_tip_and_the_spools_but_no_tension() -> None:
    inst = two_segments()
    wrench = np.zeros((200, 6))
    wrench[:, 0] = np.linspace(0, 0.2, 200)
    run = tn.twin.Twin(inst, quasi_static=True).run(
        np.zeros((200, len(inst.handle_joints))), wrench=wrench, spool_tension=inst.pretensions
    )
    np.testing.assert_allclose(run["tension"], np.tile(inst.pretensions, (200, 1)), rtol=1e-9)
    assert np.abs(run["output_angle"][-1]).max() > 0.05
    assert np.abs(run["spool_angle"][-1]).max() > 1e-3


@pytest.mark.parametrize("rises", [True, False])
def test_beyond_the_sheath_it_is_less_or_more_by_the_capstan_law(rises: bool) -> None:
    friction = {"law": "capstan", "sheath_coefficient": 0.1, "sheath_bend": "180 deg", "vertex_coefficient": 0.0}
    inst = REAL.replace(friction=friction)
    start, end = (20.0, 60.0) if rises else (60.0, 20.0)
    tensions = np.concatenate([np.linspace(30.0, start, 300), np.linspace(start, end, 600)])
    run = tn.twin.Twin(inst, quasi_static=True).run(np.zeros(900), spool_tension=np.column_stack([tensions, tensions]))
    ratio = exp(-0.1 * np.pi) if rises else exp(0.1 * np.pi)
    np.testing.assert_allclose(run["distal_tension"][-1].ravel(), end * ratio, rtol=1e-6)
    np.testing.assert_allclose(run["output_angle"][-1], 0, atol=1e-9)


def test_in_motion_it_follows_with_the_drives_lag_and_the_energy_is_balanced() -> None:
    inst = two_segments()
    step, count = 1e-4, 4000
    tensions = inst.pretensions * np.linspace(0.9, 1.2, len(inst.tendons))
    still = np.zeros((count, len(inst.handle_joints)))
    energy = tn.twin.Twin(inst, time_step=step).energy(still, spool_tension=tensions)
    gained = energy.stored_after - energy.stored_before
    assert energy.spools > 0
    assert gained == pytest.approx(
        energy.load + energy.spools - energy.friction - energy.damping, abs=1e-3 * energy.spools
    )
    run = tn.twin.Twin(inst, time_step=step).run(still, spool_tension=tensions)
    lag = inst.own_drives.time_constant
    at = round(lag / step) - 1
    changed = np.abs(tensions / inst.pretensions - 1) > 0.01
    share = (run["tension"][at] - inst.pretensions)[changed] / (tensions - inst.pretensions)[changed]
    assert share == pytest.approx(1 - exp(-1), abs=0.02)


def test_of_a_pair_one_drive_may_hold_its_tension_while_the_other_stands() -> None:
    # The other tendon's spool stands.
    given = np.tile([40.0, 0.0], (300, 1))
    alone = tn.twin.Twin(REAL, quasi_static=True).run(np.zeros(300), spool_tension=given)
    assert alone["tension"][-1].ravel()[0] == pytest.approx(40.0, rel=1e-12)
    assert alone["spool_angle"][-1].ravel()[0] > 0
    assert alone["spool_angle"][-1].ravel()[1] == 0


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"spool_tension": [-1.0, 30.0]}, "spool_tension"),
        ({"spool_tension": [np.nan, 30.0]}, "a finite number"),
        ({"spool_tension": [30.0, 30.0], "controller": "robust"}, "and a controller are both given"),
    ],
)
def test_what_no_drive_can_hold_is_refused_and_nothing_moves(change: dict[str, Any], problem: str) -> None:
    twin = tn.twin.Twin(REAL)
    before = twin.state
    if "controller" in change:
        change = change | {"controller": tn.control.Controller(REAL)}
    with pytest.raises(ArgumentError, match=problem):
        twin.run(np.zeros(3), **change)
    assert twin.state == before


def test_a_tendon_without_a_spool_holds_no_tension() -> None:
    inst = two_segments()
    fixed = inst.replace(**{f"tendons.{inst.tendons[0].name}.start": "anchor"})
    with pytest.raises(ArgumentError, match="which has no spool"):
        tn.twin.Twin(fixed).run(np.zeros((3, len(inst.handle_joints))), spool_tension=10.0)


def pulled(inst: FullForm) -> Protocol:
    """Return a protocol in which the first tendon's drive holds 1.3 times its pretension and then stands again."""
    name, tension = inst.tendons[0].name, 1.3 * float(inst.pretensions[0])
    phases = [
        {"kind": "ramp", "duration": "0.2 s", "spool_tensions": {name: f"{tension!r} N"}},
        {"kind": "hold", "duration": "0.1 s"},
        {"kind": "ramp", "duration": "0.1 s", "spool_velocities": {name: "0 rad/s"}},
    ]
    return tn.simulate.parse(tomli_w.dumps({"name": "pull", "phases": phases}))


def test_a_protocol_has_drives_hold_tensions_and_its_recording_replays_to_the_last_bit(tmp_path: Path) -> None:
    inst = two_segments()
    rest, tension = inst.pretensions[0], 1.3 * inst.pretensions[0]
    run = record(inst, pulled(inst), tmp_path / "run.mcap")
    given = run["commanded_spool_tension"][:, 0]
    held, ended = np.searchsorted(run.time, [0.29, 0.31])
    assert (given[held], given[ended]) == (pytest.approx(tension), 0.0)
    assert given[0] == pytest.approx(rest, rel=0.01)
    assert run["tension"][held, 0] == pytest.approx(tension, rel=1e-3)
    assert not run["commanded_spool_tension"][:, 1:].any()
    back = tn.Recording.open(tmp_path / "run.mcap")
    np.testing.assert_array_equal(back.run["commanded_spool_tension"], run["commanded_spool_tension"])
    assert replay(back).exact


def test_many_runs_hold_tensions_as_one_does_to_the_last_bit() -> None:
    given = np.tile([40.0, 0.0], (100, 1))
    alone = tn.twin.Twin(REAL).run(np.zeros(100), spool_tension=given)
    many = tn.twin.run_many(REAL, np.zeros((9, 100)), spool_tension=given, seeds=np.zeros(9, int))
    np.testing.assert_array_equal(many["output_angle"], np.tile(alone["output_angle"].ravel(), (9, 1)))
    with pytest.raises(ArgumentError, match="spool_tension"):
        tn.twin.run_many(REAL, np.zeros((2, 100)), spool_tension=-given)


@pytest.mark.parametrize(
    ("tensions", "problem"),
    [({"nobody": "3 N"}, "names nobody"), ({"near_agonist": "0 N"}, "force"), ({"near_agonist": "-1 N"}, "force")],
)
def test_tensions_that_no_drive_of_a_protocol_can_hold_are_refused(tensions: dict[str, str], problem: str) -> None:
    phases = [{"kind": "ramp", "duration": "0.2 s", "spool_tensions": tensions}]
    with pytest.raises(ProtocolError, match=problem):
        tn.simulate.parse(tomli_w.dumps({"name": "wrong", "phases": phases})).plan(two_segments(), 1e-3)


def test_a_phase_leaves_the_motors_of_a_controller_to_it() -> None:
    with pytest.raises(ProtocolError, match="must leave its motors to it"):
        tn.simulate.execute(tn.twin.Twin(REAL), pulled(REAL.expanded), controller=tn.control.Controller(REAL))


def test_a_bench_whose_drives_follow_speeds_runs_no_such_protocol() -> None:
    inst = two_segments()
    bench = [("spool_velocity", len(inst.tendons))]
    given = {"inst": inst, "assumed": None, "time_step": 1e-3}
    plan = pulled(inst).plan(inst, 1e-3)
    with pytest.raises(ProtocolError, match="follow speeds"):
        Player(plan, Any, print, dict, columns=CommandColumns(bench), **given)
    Player(plan, Any, print, dict, columns=CommandColumns([*bench, ("spool_tension", len(inst.tendons))]), **given)

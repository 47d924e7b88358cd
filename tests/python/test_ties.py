"""Claims about joints that turn with others: snakes, jaws of one drive, gears between joints."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from peers.chain_peer import ChainPeer

import tenodesis as tn
from tenodesis.errors import InstrumentError
from tenodesis.instrument import FullForm, from_dvrk
from tenodesis.statics import chain

from .conftest import tables
from .test_import_dvrk import content, write

SNAKE = [[-1.5, 0, 0, 0], [0, 0, -0.1929, -0.1929], [0, 0, -0.1929, 0.1929], [0, -1.258, 0, 0]]


def snake(ratio: float = 1.0, **changes: Any) -> FullForm:
    """Return a wrist of four discs, pitch, yaw, yaw, pitch, of which either two are tied."""
    joints = [
        {"name": name, "mechanism": "pulley", "axis": axis, "radius": 1.6e-3, "offset": 3.4e-3, "range": 0.39}
        for name, axis in (("p1", "pitch"), ("y1", "yaw"), ("y2", "yaw"), ("p2", "pitch"))
    ]
    joints[2] |= {"tied_to": "y1"}
    joints[3] |= {"tied_to": "p1", "tie_ratio": ratio, "end_effector_length": 17.1e-3}
    tendons = [
        {"name": f"{axis}_{side}", "route": [{"joint": f"{axis}{n}", "side": side} for n in (1, 2)]}
        for axis in ("p", "y")
        for side in ("agonist", "antagonist")
    ]
    like = tn.instrument.expanded("needle-driver")
    values = {"name": "snake", "joints": joints, "tendons": tendons, "grip": None, "sources": None}
    return like.replace(**values, tendon_stiffness=1e5, **changes)


@pytest.mark.parametrize("ratio", [1.0, -0.5, 2.0])
def test_tied_joints_rest_where_virtual_work_says(ratio: float) -> None:
    inst, k, radius, force, length = snake(ratio), 1e5, 1.6e-3, 0.4, 17.1e-3
    # Both pitch joints turn by one angle; a small force along y does the work of both lever arms.
    whole = 1 + ratio
    stiffness = 2 * k * (radius * whole) ** 2
    spacing = 3.4e-3
    arm = length * whole + 3 * spacing
    found = chain.output_angles(inst, 0.0, [0, 1e-3 * force, 0, 0, 0, 0])
    assert found[3] == pytest.approx(ratio * found[0], rel=1e-4)
    assert found[0] == pytest.approx(1e-3 * force * arm / stiffness, rel=1e-3)
    assert found[1:3] == pytest.approx([0, 0], abs=1e-12)


def test_a_snake_settles_as_in_mujoco() -> None:
    inst, rng = snake(), np.random.default_rng(3)
    peer = ChainPeer(inst)
    for _ in range(6):
        wrench = rng.normal(size=6) * [0.5, 0.5, 0.5, 2e-3, 2e-3, 2e-3]
        strokes = rng.uniform(-1, 1, 2).repeat(2) * [1, -1, 1, -1] * 3e-4
        ours = chain.output_angles(inst, np.zeros(0), wrench, strokes=strokes)
        theirs = peer.settle(np.zeros(0), wrench, strokes=strokes)
        assert np.degrees(np.abs(ours - theirs.angles)).max() < 0.05
        assert ours[[2, 3]] == pytest.approx(ours[[1, 0]], abs=1e-4)


def test_a_snake_in_motion_stays_tied_and_comes_to_rest_where_statics_says() -> None:
    inst = snake(friction={})
    wrench = np.tile([0.3, 0.2, 0, 0, 0, 0], (3000, 1))
    twin = tn.twin.Twin(inst)
    energy = twin.energy(np.zeros((500, 0)), wrench=wrench[:500])
    assert abs(energy.unaccounted) < 1e-3 * energy.work
    run = twin.run(np.zeros((3000, 0)), wrench=wrench)
    angles = run["output_angle"]
    assert np.abs(angles[:, 2:] - angles[:, [1, 0]]).max() < 1e-4
    np.testing.assert_allclose(angles[-1], chain.output_angles(inst, np.zeros(0), wrench[0]), atol=1e-4)
    # What is tied does not ring from one step to the next.
    assert np.abs(np.diff(run["output_velocity"][-200:], axis=0)).max() < 1e-3
    assert inst.bends == {"p1": [0], "y1": [1]}


def test_a_snake_of_the_research_kit_turns_as_its_matrix_says(tmp_path: Path) -> None:
    values = content(SNAKE) | {"snake-like": True, "tooltip_offset": np.diag([1, 1, 1, 1]).tolist()}
    values["tooltip_offset"][1][3] = -0.0171
    names = ("roll", "pitch", "yaw", "yaw", "pitch")
    values["DH"]["joints"] = [{"name": name, "qmin": -0.39, "qmax": 0.39, "D": 0.45, "A": 0.0034} for name in names]
    for jaw_angle, share in (("between", 0.5), ("each", 1.0)):
        inst = from_dvrk(write(tmp_path, values), jaw_angle=jaw_angle)  # type: ignore[arg-type]
        drawn = np.kron(np.eye(4), [[inst.spool_radius], [-inst.spool_radius]])
        roll, pitch, yaw, yaw_2, pitch_2, jaw, jaw_2 = chain.coupling(inst) @ drawn
        assert np.array([roll, pitch, yaw, jaw / share]) == pytest.approx(np.array(SNAKE), abs=1e-9)
        assert np.array([yaw_2, pitch_2, -jaw_2]) == pytest.approx(np.array([yaw, pitch, jaw]), abs=1e-9)
        strokes = drawn @ [0.1, 0.4, -0.3, 0.2]
        found = chain.output_angles(inst, np.zeros(0), strokes=strokes)
        assert found == pytest.approx(inst.bent(found[[0, 1, 2, 5]]), abs=1e-6)
        assert found[:3] == pytest.approx((np.array(SNAKE) @ [0.1, 0.4, -0.3, 0.2])[:3], abs=1e-6)
    assert tuple(inst.bends) == ("roll", "pitch_1", "yaw_1", "jaw_1")


@pytest.mark.parametrize(
    ("tie", "problem"),
    [
        ({"tied_to": "p2"}, "tied_to = 'p2'; it must be one before it: p1, y1, y2"),
        ({"tied_to": "nobody"}, "tied_to = 'nobody'; it must be one before it"),
        ({"tied_to": "p1", "tie_ratio": 0.0}, "is tied to p1 and has a tie_ratio of 0"),
        ({"tied_to": "p1", "tie_ratio": 1e9}, "tie_ratio"),
    ],
)
def test_ties_to_itself_in_a_circle_or_to_nothing_are_refused(tie: dict[str, Any], problem: str) -> None:
    inst = snake()
    joints = tables(inst, "joints")
    joints[3] = {key: value for key, value in joints[3].items() if not key.startswith("tie")} | tie
    with pytest.raises(InstrumentError, match=problem) as refused:
        inst.replace(joints=joints)
    assert "\n" not in str(refused.value)


def test_a_handle_joint_is_not_tied_and_arcs_take_no_name_that_is_there() -> None:
    inst = tn.instrument.expanded("hybrid-real-size")
    joints = tables(inst, "joints")
    handle = next(joint for joint in joints if joint.get("place") == "handle")
    handle["tied_to"] = inst.tip_joints[0].name
    with pytest.raises(InstrumentError, match=r"tied_to = .*; it must be one before it: none is"):
        inst.replace(joints=joints)
    two = tn.instrument.expanded("two-segment-continuum")
    near, far = tables(two, "joints")
    tendons = [
        {"name": n, "route": [{"joint": j, "side": s} for j in ("near", "near_arc1")]}
        for n, j, s in (("a", "near", "agonist"), ("b", "near", "antagonist"))
    ]
    with pytest.raises(InstrumentError, match="near_arc1 twice"):
        two.replace(joints=[near | {"arcs": 2}, far | {"name": "near_arc1", "arcs": 1}], tendons=tendons)

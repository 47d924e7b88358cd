"""Claims about backbones cut into arcs: where they end, what friction leaves, and what else knows of their arcs."""

from math import degrees, log
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from scipy.integrate import solve_bvp

import tenodesis as tn
from tenodesis.control.one_arc import one_arc
from tenodesis.errors import InstrumentError
from tenodesis.instrument import FullForm
from tenodesis.paper.subject import Subject
from tenodesis.recording.outcome import outcome
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record
from tenodesis.statics import chain
from tenodesis.statics.bends import Bends, straight_arms
from tests.peers import elastica

from .conftest import tables

ROOT = Path(__file__).parents[2]
CASE = elastica.Backbone(40e-3, 1e-3, 2e-3, 100e3, 20.0, 10e-3)


def single(arcs: int, of: elastica.Backbone = CASE, **changes: Any) -> FullForm:
    joint = {
        "name": "bend", "mechanism": "continuum", "axis": "yaw", "radius": of.offset, "range": "150 deg", "arcs": arcs,
        "backbone_length": of.length, "backbone_rigidity": of.rigidity, "end_effector_length": of.end_effector_length,
    }  # fmt: skip
    tendons = [{"name": side, "route": [{"joint": "bend", "side": side}]} for side in ("agonist", "antagonist")]
    values = {
        "name": "backbone", "pretension": of.pretension, "tendon_stiffness": of.stiffness, "spool_radius": "5 mm",
        "joints": [joint], "tendons": tendons,
    }  # fmt: skip
    inst = tn.parse(tomli_w.dumps(_text(values | changes)))
    assert isinstance(inst, FullForm)
    return inst


def _text(value: Any) -> Any:
    """Return values as a file has them, numbers with the units of their keys."""
    units = {
        "radius": "m", "backbone_length": "m", "backbone_rigidity": "N*m^2", "end_effector_length": "m",
        "pretension": "N", "tendon_stiffness": "N/m",
    }  # fmt: skip
    if isinstance(value, list):
        return [_text(one) for one in value]
    if isinstance(value, dict):
        return {
            key: f"{item!r} {units[key]}" if key in units and isinstance(item, float) else _text(item)
            for key, item in value.items()
        }
    return value


def end_of(inst: FullForm, angles: np.ndarray) -> elastica.Tip:
    """Return where the backbone ends, as arcs one after another."""
    joints = inst.tip_joints
    after = np.cumsum(angles)
    middle, chords = after - angles / 2, [joint.chord for joint in joints] * np.sinc(angles / (2 * np.pi))
    return elastica.Tip(float(after[-1]), float(chords @ np.sin(middle)), float(chords @ np.cos(middle)))


def bent(inst: FullForm, wound: Any, wrench: Any) -> elastica.Tip:
    return end_of(inst, tn.statics.chain.output_angles(inst, np.zeros(0), wrench, strokes=wound))


@pytest.mark.parametrize(("arcs", "share"), [(1, 0.9), (2, 0.01), (4, 1e-3), (6, 1e-4)])
def test_under_a_force_across_the_end_goes_where_the_elastica_goes(arcs: int, share: float) -> None:
    exact = elastica.tip(CASE, (1.0, 0.0), 0.0, (0.0, 0.0))
    assert 1e3 * np.hypot(exact.x, exact.z - CASE.length) == pytest.approx(5.99, abs=0.005)
    found = bent(single(arcs), (0.0, 0.0), (1.0, 0, 0, 0, 0, 0))
    off = np.hypot(found.x - exact.x, found.z - exact.z)
    assert off < share * exact.x
    if arcs == 1:
        assert off > 0.8 * exact.x, "one arc has no S"


@pytest.mark.slow
@pytest.mark.parametrize("tension", [2.0, 7.0, 12.0])
def test_its_own_weight_is_half_of_it_at_the_end_and_a_moment(tension: float) -> None:
    length, weight, held = CASE.length, 0.4, CASE.offset * (tension - 2.0)

    def rates(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        across = weight * (1 - s / length) * np.cos(y[0])
        return np.vstack([y[1] / CASE.rigidity, -across, np.sin(y[0]), np.cos(y[0])])

    s = np.linspace(0.0, length, 41)
    guess = np.array([held / CASE.rigidity * s, np.full_like(s, held), 0 * s, s])
    exact = solve_bvp(rates, lambda a, b: np.array([a[0], a[2], a[3], b[1] - held]), s, guess, tol=1e-8).y[:, -1]
    inst = single(4, CASE._replace(end_effector_length=1e-6))
    moment = -weight * length / 12 * np.cos(exact[0])
    wrench = [weight / 2, 0, 0, 0, moment, 0]
    wound = tn.statics.strokes_at_tensions(inst, [tension, 2.0], wrench=wrench, axes="stem")
    end = end_of(inst, chain.output_angles(inst, 0.0, wrench, strokes=wound, axes="stem"))
    assert np.hypot(end.x - exact[2], end.z - exact[3]) < 1e-3 * length
    assert end.angle == pytest.approx(exact[0], abs=np.radians(0.07))


@pytest.mark.slow
def test_the_end_is_within_half_a_percent_of_the_length_of_any_elastica() -> None:
    rng = np.random.default_rng(37)
    offs, turns, slack = [], [], 0
    for _ in range(200):
        length, pretension = rng.uniform(20e-3, 80e-3), rng.uniform(2.0, 30.0)
        offset = length * rng.uniform(0.02, 0.08)
        # Such that the pretensioned backbone is far from buckling, and a full stroke bends it by a right angle.
        rigidity = pretension * length**2 / rng.uniform(2.0, 20.0)
        of = elastica.Backbone(
            length, rigidity, offset, rng.uniform(2e4, 2e5), pretension, rng.uniform(0.0, 0.5) * length
        )
        stroke = rng.uniform(-1.5, 1.5) * offset
        wound = (stroke, -stroke)
        force = rng.normal(size=2) * rigidity / length**2
        moment = rng.normal() * 0.3 * rigidity / length
        try:
            exact = elastica.tip(of, force, moment, wound)
        except ValueError:
            continue
        inst = single(4, of)
        wrench = (force[0], 0.0, force[1], 0.0, moment, 0.0)
        found = tn.statics.chain.equilibrium(inst, np.zeros(0), wrench, strokes=wound)
        at = end_of(inst, found.output_angle)
        slack += int((found.tensions == 0).any())
        offs.append(np.hypot(at.x - exact.x, at.z - exact.z) / length)
        turns.append(degrees(abs(at.angle - exact.angle)))
    assert len(offs) > 190
    assert slack > 20
    assert max(offs) < 5e-3
    assert max(turns) < 0.1


@pytest.mark.parametrize("coefficient", [0.05, 0.1, 0.2, 0.3])
def test_a_tendon_with_friction_bends_it_as_the_closed_form_says(coefficient: float) -> None:
    base = 12.0
    pull = {"name": "pull", "route": [{"joint": "bend", "side": "agonist"}]}
    inst = single(
        4, CASE._replace(pretension=0.0), tendons=[pull], friction={"law": "capstan", "vertex_coefficient": coefficient}
    )
    run = tn.twin.Twin(inst, quasi_static=True).run(np.zeros((6000, 0)), spool_velocity=np.full((6000, 1), 0.25))
    bend = CASE.offset * base * CASE.length / CASE.rigidity
    tension = run["tension"][:, 0]
    assert tension[-1] > base
    angle = np.interp(base, tension, run["output_angle.bend"])
    distal = np.interp(base, tension, run["distal_tension"][:, 0])
    assert degrees(angle) == pytest.approx(degrees(log(1 + coefficient * bend) / coefficient), abs=0.3)
    # In the middle of the last arc, half an arc before the end.
    assert distal == pytest.approx(base / (1 + coefficient * bend), rel=0.05)


def test_segments_in_arcs_are_asked_for_recorded_and_compensated_by_the_names_of_their_file(tmp_path: Path) -> None:
    inst = tn.instrument.in_arcs("two-segment-continuum", 4)
    assert inst.bends == {"near": [0, 1, 2, 3], "far": [4, 5, 6, 7]}
    np.testing.assert_allclose(inst.bend_ends, np.radians(60))
    run = record(inst, tn.simulate.default_protocol(inst), tmp_path / "run.mcap", time_step=2e-3, quasi_static=True)
    for name in ("near", "far"):
        assert np.abs(run[f"output_angle.{name}"]).max() > np.radians(8)
    # Joints that only have numbers are no arcs of anything.
    jaws = tn.twin.Twin("needle-driver").run(np.zeros((2, 0)))
    assert {"jaw_1", "jaw_2"} <= set(jaws.joints)
    with pytest.raises(KeyError):
        jaws["output_angle.jaw"]
    back = tn.recording.Recording.open(tmp_path / "run.mcap")
    assert back.instrument() == inst
    assert replay(back).exact
    # Tendons bring the directions of the ends back, not the S.
    wrench = np.array([0.3, 0.2, 0, 0, 0, 0])
    strokes = tn.statics.chain.compensation_strokes(inst, np.zeros(0), wrench)
    held = tn.statics.chain.output_angles(inst, np.zeros(0), wrench, strokes=strokes)
    np.testing.assert_allclose([held[:4].sum(), held[4:].sum()], 0, atol=1e-8)
    assert np.abs(held).max() > np.radians(0.2)


def test_a_law_that_knows_one_arc_brings_the_end_of_four_back() -> None:
    inst = tn.instrument.in_arcs(ROOT / "examples" / "continuum.toml", 4).replace(
        friction={"law": "capstan", "vertex_coefficient": 0.1, "sheath_coefficient": 0.08, "sheath_bend": 0.5}
    )
    assert tn.instrument.in_arcs(tn.instrument.in_arcs(inst, 1), 4) == inst
    assert tn.control.pairs(inst)["yaw"][1:] == (0, 0, 1)
    handle, wrench = np.full((12000, 1), np.radians(30)), np.zeros((12000, 6))
    handle[:2000, 0] = np.linspace(0, np.radians(30), 2000)
    wrench[4000:, 0] = -np.minimum(1, np.arange(8000) / 400)
    target = degrees(tn.statics.targets(inst, handle[-1]).sum())
    off, on = (
        tn.twin.Twin(inst, seed=1).run(handle, wrench=wrench, controller=controller)
        for controller in (None, tn.control.Controller(inst, law="robust"))
    )
    assert off.compensated == on.compensated == ("yaw",)
    assert [outcome(run, inst)["tip"].count("yaw") for run in (off, on)] == [1, 1]
    assert outcome(on, inst)["tip"].startswith("yaw ")
    assert target - degrees(off["output_angle.yaw"][-1]) > 9
    assert degrees(on["output_angle.yaw"][-1]) == pytest.approx(target, abs=0.8)
    assert degrees(on["estimated_output_angle"].ravel()[-1]) == pytest.approx(
        degrees(on["output_angle.yaw"][-1]), abs=0.8
    )


@pytest.mark.parametrize(("bend", "arcs"), [(20, 2), (36, 2), (60, 4), (105, 4), (120, 6), (150, 6)])
def test_without_arcs_in_its_file_it_bends_in_as_many_as_half_a_percent_of_its_deflection_takes(
    bend: float, arcs: int
) -> None:
    finest, given = single(16), single(4).as_given("joints")[0]
    chosen = finest.replace(joints=[given.model_copy(update={"arcs": None, "given_range": np.radians(bend)})])
    assert len(chosen.tip_joints) == arcs
    wound = np.array([1.0, -1.0]) * CASE.offset * np.radians(bend)
    across = [0.5 * CASE.rigidity / CASE.length**2, 0, 0, 0, 0, 0]
    ways = []
    for inst in (chosen, finest):
        loaded = chain.output_angles(inst, 0.0, [[0.0] * 6, across], strokes=wound, axes="stem")
        start, end = (end_of(inst, angles) for angles in loaded)
        ways.append(np.array([end.x - start.x, end.z - start.z]))
    assert np.linalg.norm(ways[0] - ways[1]) < 5e-3 * np.linalg.norm(ways[1])


def test_backbones_that_do_not_fit_have_fewer_arcs_than_their_ranges_take() -> None:
    near = single(4).as_given("joints")[0].model_copy(update={"arcs": None, "end_effector_length": None})
    names = [f"bend{i}" for i in range(8)]
    joints = [near.model_copy(update={"name": name}) for name in names]
    joints[-1] = joints[-1].model_copy(update={"end_effector_length": CASE.end_effector_length})
    routes = [(side, [{"joint": name, "side": side} for name in names]) for side in ("agonist", "antagonist")]
    inst = single(4).replace(joints=joints, tendons=[{"name": side, "route": route} for side, route in routes])
    assert len(inst.tip_joints) == 24
    assert {joint.arcs for joint in inst.as_given("joints")} == {None}


def test_the_short_form_of_several_arcs_is_joints_and_tendons() -> None:
    text = (ROOT / "examples" / "continuum.toml").read_text("utf-8")
    arcs = tn.parse(text.replace("handle_range", "arcs = 4\nhandle_range"))
    assert arcs == tn.instrument.in_arcs(ROOT / "examples" / "continuum.toml", 4)
    two = text.replace("handle_range", 'arcs = 4\naxes = ["yaw", "pitch"]\nhandle_range').replace(
        'axes = ["yaw"]\n', ""
    )
    assert list(tn.parse(two).bends) == ["yaw", "pitch"] and len(tn.parse(two).tip_joints) == 8
    with pytest.raises(InstrumentError, match="arcs is 3"):
        tn.parse(text.replace("handle_range", "arcs = 3\nhandle_range"))
    with pytest.raises(InstrumentError, match="in_arcs"):
        tn.load(ROOT / "examples" / "continuum.toml").replace(arcs=2)


def test_one_arc_is_said_to_leave_the_s_out_and_several_are_not() -> None:
    of_single = [one for one in tn.control.implausible(single(1)) if one.key == "joints.arcs"]
    assert len(of_single) == 1 and "give arcs = 6" in of_single[0].sentence
    assert not [one for one in tn.control.implausible(single(4)) if one.key == "joints.arcs"]
    left_out = one_arc(single(1))
    assert left_out is not None
    end = elastica.tip(CASE, (1.0, 0.0), 0.0, (0.0, 0.0))
    beyond = CASE.end_effector_length
    exact = np.hypot(end.x + beyond * np.sin(end.angle), end.z + beyond * np.cos(end.angle) - CASE.length - beyond)
    assert left_out.finer == pytest.approx(exact, rel=5e-3)
    assert left_out.given < 0.3 * left_out.finer


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"arcs": 3}, "arcs is 3; it must be 1 or an even number"),
        ({"arcs": 0}, "arcs"),
        ({"mechanism": "pulley", "backbone_length": None, "backbone_rigidity": None, "arcs": 2}, "for a continuum"),
    ],
)
def test_numbers_of_arcs_that_no_backbone_has_are_refused(change: dict[str, Any], problem: str) -> None:
    given = tn.instrument.expanded("two-segment-continuum").as_given("joints")[0].model_dump(exclude_none=True)
    joint = {key: value for key, value in (given | change).items() if value is not None}
    with pytest.raises(InstrumentError, match=problem):
        tn.load("two-segment-continuum").replace(
            joints=[
                joint | {"name": "near"},
                {"name": "far", "mechanism": "pulley", "axis": "yaw", "radius": 1e-3, "end_effector_length": 1e-2},
            ]
        )


def test_a_file_of_which_every_joint_is_wrong_gets_one_sentence_for_each() -> None:
    two = tn.load("two-segment-continuum")
    joints = [joint | {"arcs": 3} for joint in tables(two, "joints")]
    with pytest.raises(InstrumentError) as refused:
        two.replace(joints=joints)
    sentences = str(refused.value).splitlines()
    assert len(sentences) == len(joints)
    assert all("arcs is 3" in sentence for sentence in sentences)
    with pytest.raises(InstrumentError, match="a list that is not empty"):
        two.replace(joints=[])


def test_the_report_and_check_have_a_backbones_arcs_as_one_joint() -> None:
    two = tn.instrument.expanded("two-segment-continuum")
    arcs, one = tn.instrument.in_arcs(two, 4), tn.instrument.in_arcs(two, 1)
    bends = Bends.of(arcs)
    assert bends.names == Subject(arcs).joints == [joint.name for joint in one.tip_joints]
    strokes = np.array([4e-4, -4e-4, 2e-4, -2e-4])
    ours, theirs = (Subject(inst).rates(np.zeros(0), strokes) for inst in (arcs, one))
    for name in ("stiffness", "by_stroke", "by_handle"):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name), rel=1e-9)
    # A force across bends arcs unlike; a couple does not.
    assert ours.by_wrench[:, 3:] == pytest.approx(theirs.by_wrench[:, 3:], rel=1e-9, abs=1e-12)
    assert straight_arms(arcs) == pytest.approx(tn.statics.straight_arms(one))
    lost = chain.rates(arcs, np.zeros(0), strokes=np.full((2, 4), -5e-3))
    assert np.isfinite(bends.rates(lost).stiffness).all() == np.isfinite(lost.stiffness).all()

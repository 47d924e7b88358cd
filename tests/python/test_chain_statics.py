"""Joints that share tendons: the planar statics as a special case, and properties over random routes."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import tenodesis as tn
from tenodesis import instrument, statics
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import FullForm, Instrument
from tenodesis.run import Array
from tenodesis.statics import Status, chain

from .chain_samples import Point, drawn, holds, two_axes
from .conftest import refused

SIGNS = {"agonist": 1.0, "antagonist": -1.0, "middle": 0.0}


wrists = st.integers(0, 2**32 - 1).map(drawn).filter(holds)
some = settings(max_examples=25)


def place(inst: FullForm, angles: Array, end: int) -> tuple[Array, Rotation]:
    """Position and orientation of where forces act on one of the last joints, body by body."""
    position, turned = np.zeros(3), Rotation.identity()
    chain = [end]
    while inst.parents[chain[0]] >= 0:
        chain.insert(0, inst.parents[chain[0]])
    for i in chain:
        joint = inst.tip_joints[i]
        half = Rotation.from_rotvec(angles[i] / 2 * np.array(joint.axis_vector))
        bow = np.sinc(angles[i] / 2 / np.pi) if joint.mechanism == "continuum" else 1.0
        position = position + turned.apply((0, 0, joint.offset))
        turned = turned * half
        position = position + turned.apply((0, 0, bow * joint.chord))
        turned = turned * half
    return position + turned.apply((0, 0, inst.tip_joints[end].end_effector_length or 0.0)), turned


def velocity(inst: FullForm, angles: Array, end: int) -> Array:
    """Rates of an end's place and orientation by the angles, (6, joints), by central differences."""
    step = 1e-5
    columns = []
    for i in range(len(angles)):
        (p, r), (q, s) = (place(inst, angles + by * np.eye(len(angles))[i], end) for by in (step, -step))
        columns.append(np.concatenate([p - q, (r * s.inv()).as_rotvec()]) / (2 * step))
    return np.array(columns).T


def shortening(inst: FullForm, angles: Array) -> Array:
    """Length by which every tendon is shorter at the tip, m."""
    found = np.zeros(len(inst.tendons))
    names = [joint.name for joint in inst.tip_joints]
    for m, tendon in enumerate(inst.tendons):
        for crossing in tendon.route:
            if crossing.joint not in names:
                continue
            joint, angle = inst.tip_joints[names.index(crossing.joint)], angles[names.index(crossing.joint)]
            arm = SIGNS[crossing.side] * (joint.radius if crossing.radius is None else crossing.radius)
            found[m] += 2 * arm * np.sin(angle / 2) if joint.mechanism == "tendon-gear" else arm * angle
    return found


def rate_of(function: Any, at: Array, step: float = 1e-5) -> Array:
    """Central differences by every element, in the last axis."""
    steps = step * np.eye(len(at))
    return np.stack([(function(at + by) - function(at - by)) / (2 * step) for by in steps], axis=-1)


@pytest.fixture(params=["real", "scaled", "pulley", "continuum"])
def planar(request: pytest.FixtureRequest) -> Instrument:
    inst: Instrument = request.getfixturevalue(request.param)
    return inst.replace(axes=("yaw",))


@pytest.mark.parametrize("axis", ["yaw", "pitch"])
def test_a_single_joint_is_the_planar_one(planar: Instrument, axis: str) -> None:
    planar = planar.replace(axes=(axis,))
    random = np.random.default_rng(3)
    count = 2000
    handle = random.uniform(-planar.handle_range, planar.handle_range, count)
    force, radial = random.uniform(-1.5, 1.5, (2, count)) * float(statics.slack_force(planar, 0.0))
    wound = random.uniform(-1.2, 1.2, (count, 2)) * planar.pretension / planar.tendon_stiffness
    wrench = np.zeros((count, 6))
    wrench[:, 0 if axis == "yaw" else 1] = -force
    wrench[:, 2] = radial
    theirs = statics.equilibrium(planar, handle, force, radial_force=radial, wound=(wound[:, 0], wound[:, 1]))
    ours = chain.equilibrium(planar, handle[:, np.newaxis], wrench, strokes=wound)
    solved = np.asarray(theirs.status) == Status.OK
    assert solved.sum() > count / 2
    np.testing.assert_array_equal(ours.status, theirs.status)
    np.testing.assert_allclose(ours.angles[:, 0], theirs.output_angle, rtol=0, atol=1e-12)
    tensions = np.stack([theirs.agonist, theirs.antagonist], axis=1)
    np.testing.assert_allclose(ours.tensions, tensions, rtol=0, atol=1e-12 * planar.tendon_stiffness)


def test_handle_angle_and_stiffness_of_a_single_joint_are_the_planar_ones(planar: Instrument) -> None:
    output = np.linspace(-0.9, 0.9, 37)
    force = 0.3 * float(statics.slack_force(planar, 0.0))
    wrench = [-force, 0, 0, 0, 0, 0]
    handle = np.asarray(statics.handle_angle(planar, output, force))
    found = chain.handle_angles(planar, output[:, np.newaxis], wrench)
    np.testing.assert_allclose(found[:, 0], handle, rtol=0, atol=1e-12)
    unloaded = np.asarray(statics.handle_angle(planar, output))
    rates = chain.rates(planar, unloaded[:, np.newaxis])
    np.testing.assert_allclose(rates.stiffness[:, 0, 0], statics.flexural_stiffness(planar, output), rtol=1e-12)
    lost = -rates.by_wrench[:, 0, 0] * -force
    np.testing.assert_allclose(lost, statics.loss_of_dexterity(planar, output, force), rtol=1e-12)


@some
@given(wrists, st.integers(0, 2**32 - 1), st.sampled_from(["tip", "stem"]))
def test_the_load_does_the_work_that_springs_and_tendons_take_up(inst: FullForm, seed: int, axes: Any) -> None:
    point = Point(inst, seed)
    at = chain.equilibrium(inst, [point.handle], **point.load(axes=axes))
    assume(at.status[0] == Status.OK)
    angles, tensions = at.angles[0], at.tensions[0]
    moments = rate_of(lambda x: shortening(inst, x), angles).T @ tensions
    moments -= [joint.own_stiffness * angle for joint, angle in zip(inst.tip_joints, angles, strict=True)]
    for jaw, sign in zip(inst.jaws, (1, -1), strict=False):
        moments[jaw] += sign * point.grip * 5e-3
    for end in inst.bearing:
        turned = place(inst, angles, end)[1] if axes == "tip" else Rotation.identity()
        share = turned.apply(point.wrench.reshape(2, 3)).ravel() / len(inst.bearing)
        moments += velocity(inst, angles, end).T @ share
    assert moments == pytest.approx(0, abs=1e-7)
    wound = np.array([SIGNS[tendon.route[0].side] for tendon in inst.tendons]) * 4e-3 * np.repeat(point.handle, 2)
    stretch = wound + point.strokes - shortening(inst, angles)
    assert tensions == pytest.approx(np.maximum(inst.pretensions + inst.stiffnesses * stretch, 0), abs=1e-6)


@some
@given(wrists, st.integers(0, 2**32 - 1), st.sampled_from(["tip", "stem"]))
def test_rates_are_those_of_central_differences(inst: FullForm, seed: int, axes: Any) -> None:
    point = Point(inst, seed)
    held = point.load(axes=axes)
    at = chain.equilibrium(inst, [point.handle], **held)
    # Where a tendon slackens the rates jump.
    assume(at.status[0] == Status.OK and not (at.tensions < 0.5).any())
    rates = chain.rates(inst, point.handle, **held)

    def by(key: str, value: Array, step: float) -> Array:
        return rate_of(lambda x: chain.output_angles(inst, point.handle, **{**held, key: x}), value, step)

    size = float(np.abs(rates.by_wrench[:, :3]).max())
    assert rates.by_wrench == pytest.approx(by("wrench", point.wrench, 1e-5 / size), rel=1e-5, abs=1e-5 * size)
    by_handle = rate_of(lambda x: chain.output_angles(inst, x, **held), point.handle)
    assert rates.by_handle == pytest.approx(by_handle, rel=1e-5, abs=1e-5)
    assert rates.by_stroke == pytest.approx(by("strokes", point.strokes, 1e-8), rel=1e-5, abs=1e-3)
    if inst.grip:
        step = 1e-5 / size
        gripped = [
            chain.output_angles(inst, point.handle, **held | {"grip_force": point.grip + by}) for by in (step, -step)
        ]
        assert rates.by_grip == pytest.approx((gripped[0] - gripped[1]) / (2 * step), rel=1e-5, abs=1e-5 * size)


@some
@given(wrists, st.integers(0, 2**32 - 1))
def test_without_a_load_the_compliance_of_the_tip_is_reciprocal(inst: FullForm, seed: int) -> None:
    point = Point(inst, seed)
    at = chain.equilibrium(inst, [point.handle], strokes=point.strokes)
    assume(at.status[0] == Status.OK)
    rates = chain.rates(inst, point.handle, strokes=point.strokes, axes="stem")
    moved = sum(velocity(inst, at.angles[0], end) for end in inst.bearing) / len(inst.bearing)
    # Metres and radians by N and N m, made alike by a length.
    alike = np.repeat([1.0, 0.01], 3)
    compliance = (alike[:, np.newaxis] * moved) @ (rates.by_wrench * alike)
    assert compliance == pytest.approx(compliance.T, abs=1e-7 * np.abs(compliance).max())


@some
@given(wrists, st.integers(0, 2**32 - 1))
def test_a_force_that_keeps_its_direction_has_a_potential(inst: FullForm, seed: int) -> None:
    point = Point(inst, seed)
    point.wrench[3:] = 0
    at = chain.equilibrium(inst, [point.handle], **point.load(axes="stem"))
    assume(at.status[0] == Status.OK)
    stiffness = chain.rates(inst, point.handle, **point.load(axes="stem")).stiffness
    assert stiffness == pytest.approx(stiffness.T, abs=1e-10 * np.abs(stiffness).max())


@some
@given(wrists, st.integers(0, 2**32 - 1), st.sampled_from(["tip", "stem"]))
def test_handle_angles_lead_back_to_the_angles(inst: FullForm, seed: int, axes: Any) -> None:
    point = Point(inst, seed)
    at = chain.equilibrium(inst, [point.handle], **point.load(axes=axes))
    assume(at.status[0] == Status.OK and not (at.tensions == 0).any())
    handle = chain.handle_angles(inst, at.angles[0], **point.load(axes=axes))
    assert handle == pytest.approx(point.handle, abs=1e-9)


@some
@given(wrists, st.integers(0, 2**32 - 1), st.sampled_from(["tip", "stem"]))
@example(drawn(658495), 33201032, "tip")  # as few tendons stay taut as cannot carry the load
def test_compensation_strokes_give_the_unloaded_angles_back(inst: FullForm, seed: int, axes: Any) -> None:
    point = Point(inst, seed)
    unloaded = chain.equilibrium(inst, [point.handle], strokes=point.strokes)
    assume(unloaded.status[0] == Status.OK)
    load = {"wrench": point.wrench, "grip_force": point.grip, "axes": axes}
    strokes = chain.compensation_strokes(inst, [point.handle], strokes=point.strokes, **load)[0]
    assume(np.isfinite(strokes).all())
    restored = chain.equilibrium(inst, [point.handle], strokes=point.strokes + strokes, **load)
    assume(restored.status[0] == Status.OK)
    assert restored.angles[0] == pytest.approx(unloaded.angles[0], abs=1e-9)


def test_compensation_strokes_give_the_angles_back_when_a_tendon_slackens() -> None:
    inst = two_axes("real-size")
    wrench = [2.0, -1.5, 0.5, 0.02, 0.01, 0.0]
    unloaded = chain.output_angles(inst, [0.2, -0.1])
    strokes = chain.compensation_strokes(inst, [0.2, -0.1], wrench)
    restored = chain.equilibrium(inst, [0.2, -0.1], wrench, strokes=strokes)
    assert restored.angles == pytest.approx(unloaded, abs=1e-9)
    assert restored.tensions.min() == pytest.approx(0, abs=1e-9)


@some
@given(wrists)
def test_coupling_is_the_inverse_of_what_the_angles_draw(inst: FullForm) -> None:
    drawn_by_angle = rate_of(lambda x: shortening(inst, x), np.zeros(len(inst.tip_joints)))
    product = statics.coupling(inst) @ drawn_by_angle
    assert product == pytest.approx(np.eye(len(inst.tip_joints)), abs=1e-8)


def test_a_load_beyond_the_fold_has_no_equilibrium() -> None:
    with refused("handle_angles", kind=NoSolutionError):
        chain.output_angles(two_axes("real-size"), [0.2, 0.1], [-40, -40, 0, 0, 0, 0])


def test_tendons_that_are_all_slack_hold_nothing() -> None:
    inst = two_axes("real-size")
    with refused("handle_angles", kind=NoSolutionError):
        chain.output_angles(inst, 0.0, strokes=[-2e-3, -2e-3, 0, 0])


def test_a_loose_joint_rests_where_a_load_presses_it() -> None:
    """As the planar joint does, which has a closed form there."""
    planar = tn.load("real-size").replace(axes=("yaw",))
    slack = -2 * planar.pretension / planar.tendon_stiffness
    for force in (-0.5, 0.5):
        theirs = statics.output_angle(planar, 0.1, force, wound=(slack, slack))
        ours = chain.output_angles(planar, 0.1, [-force, 0, 0, 0, 0, 0], strokes=[slack, slack])
        assert ours[0] == pytest.approx(theirs, abs=1e-12)


def test_a_joint_cannot_bend_beyond_its_mechanism() -> None:
    with pytest.raises(NoSolutionError, match="farther"):
        chain.output_angles(two_axes("real-size"), 0.0, strokes=[0.02, -0.02, 0, 0])
    with pytest.raises(NoSolutionError, match="farther"):
        chain.handle_angles(two_axes("real-size"), [3.5, 0.0])


def test_in_an_array_what_has_no_solution_is_not_a_number() -> None:
    at = chain.equilibrium(two_axes("real-size"), [[0.0, 0.0], [0.2, 0.1]], [-40, -40, 0, 0, 0, 0])
    assert (at.status == Status.NO_EQUILIBRIUM).all()
    assert np.isnan(at.angles).all()
    assert np.isnan(at.tensions).all()


def test_bad_arguments_are_refused() -> None:
    inst = two_axes("real-size")
    with refused("handle_angles", (3,)):
        chain.output_angles(inst, [0, 0, 0])
    with refused("wrench", (3,)):
        chain.output_angles(inst, 0.0, [1, 0, 0])
    with refused("wrench[1]", np.nan):
        chain.output_angles(inst, 0.0, [0, np.nan, 0, 0, 0, 0])
    with refused("strokes", (2,)):
        chain.output_angles(inst, 0.0, strokes=[0, 0])
    with refused("axes", "world"):
        chain.output_angles(inst, 0.0, axes="world")  # type: ignore[arg-type]
    with refused("grip_force", 1.0):
        chain.output_angles(inst, 0.0, grip_force=1.0)
    with refused("handle_angles of handle_yaw", 1.0):
        chain.output_angles(inst, [1.0, 0.0])
    with refused(""):
        chain.output_angles(inst, np.zeros((2, 2)), np.zeros((3, 6)))
    with refused("inst", "no handle"):
        chain.handle_angles(instrument.parse(NO_HANDLE), [0.1])


def test_without_a_handle_only_the_motors_move_the_tip() -> None:
    angles = chain.output_angles(instrument.parse(NO_HANDLE), 0.0, strokes=[[0.0, 0.0], [6e-4, -6e-4]])
    np.testing.assert_allclose(angles, [[0.0], [0.2]], rtol=0, atol=1e-12)


@pytest.mark.parametrize("axis", ["roll", (0.3, 1.0, 0.5)])
def test_a_gear_or_a_backbone_bends_only_across_the_instrument(axis: Any) -> None:
    joint = instrument.parse(NO_HANDLE).joints[0].model_dump(exclude_none=True)
    assert instrument.Joint(**joint | {"axis": axis}).axis == axis
    with pytest.raises(ValueError, match="across z"):
        instrument.Joint(**joint | {"axis": axis, "mechanism": "tendon-gear"})


NO_HANDLE = """
name = "no handle"
pretension = "5 N"
tendon_stiffness = "10 N/mm"
joints = [{ name = "yaw", mechanism = "pulley", axis = "yaw", radius = "3 mm", end_effector_length = "9 mm" }]
tendons = [
  { name = "left", route = [{ joint = "yaw", side = "agonist" }] },
  { name = "right", route = [{ joint = "yaw", side = "antagonist" }] },
]
"""

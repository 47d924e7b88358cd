"""Claims about the statics as one set of functions: for either form of a file, for one joint and for several."""

from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import statics
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument
from tenodesis.statics import Status

from .conftest import refused

HANDLE = np.linspace(-0.3, 0.3, 41)
SPRUNG = """
name = "two joints under one tendon"
pretension = "5 N"
tendon_stiffness = "1e6 N/m"
joints = [
  { name = "near", mechanism = "pulley", axis = "yaw", radius = "5 mm", stiffness = "0.3 N*m/rad" },
  { name = "far", mechanism = "pulley", axis = "yaw", radius = "5 mm", stiffness = "0.1 N*m/rad", \
    end_effector_length = "10 mm" },
]
tendons = [
  { name = "pull", route = [{ joint = "near", side = "agonist" }, { joint = "far", side = "agonist" }] },
]
"""


@pytest.fixture(params=["real", "scaled", "pulley", "continuum"])
def short(request: pytest.FixtureRequest) -> Instrument:
    inst: Instrument = request.getfixturevalue(request.param)
    return inst.replace(axes=("yaw",))


@pytest.mark.parametrize(
    ("function", "more"),
    [
        ("output_angle", {"radial_force": 0.2, "wound": (1e-4, -2e-4)}),
        ("output_angle", {"wound": 1e-4}),
        ("handle_angle", {"radial_force": 0.2}),
        ("tensions", {}),
        ("torque_transmissibility", {}),
        ("slack_load", {}),
    ],
)
def test_the_short_form_and_the_one_written_out_have_the_same_statics(
    short: Instrument, function: str, more: dict[str, Any]
) -> None:
    force = 0.2 * statics.slack_force(short, 0.0)
    ours, theirs = (getattr(statics, function)(inst, HANDLE, force, **more) for inst in (short, short.expanded))
    np.testing.assert_allclose(np.asarray(ours), np.asarray(theirs), rtol=1e-12, atol=1e-13)


def test_a_force_that_keeps_its_direction_is_solved_by_the_chain_and_is_the_same_at_a_straight_tip(
    short: Instrument,
) -> None:
    force = 0.1 * statics.slack_force(short, 0.0)
    held = statics.output_angle(short, statics.handle_angle(short, 0.0, force), force, axes="stem")
    assert isinstance(held, float)
    assert held == pytest.approx(0.0, abs=1e-9)


def test_one_joint_without_a_closed_form_takes_and_returns_numbers(short: Instrument) -> None:
    joints = short.expanded
    other = joints.tendons[1]
    uneven = joints.replace(**{f"tendons.{other.name}.stiffness": (1 + 1e-9) * (other.stiffness or 0.0)})
    assert uneven.closed_form is None
    force = 0.2 * statics.slack_force(short, 0.0)
    ours = statics.output_angle(uneven, 0.2, force)
    assert isinstance(ours, float)
    assert ours == pytest.approx(statics.output_angle(short, 0.2, force), abs=1e-9)
    np.testing.assert_allclose(
        statics.output_angle(uneven, HANDLE, force, radial_force=force, wound=1e-4),
        statics.output_angle(short, HANDLE, force, radial_force=force, wound=1e-4),
        atol=1e-8,
    )
    at = statics.equilibrium(uneven, 0.2, force)
    assert at.status is Status.OK
    assert at.tensions == pytest.approx(statics.tensions(short, 0.2, force), rel=1e-6)


def test_several_joints_have_a_last_axis() -> None:
    inst = tn.load("real-size").expanded
    handle = np.full((3, 2), 0.1)
    assert statics.output_angle(inst, handle, [0.1, 0.0, 0.0]).shape == (3, 2)
    assert statics.tensions(inst, handle, [0.1, 0.0, 0.0, 0.0, 0.0, 1e-3]).shape == (3, 4)
    assert statics.equilibrium(inst, handle[0]).status is Status.OK
    back = statics.handle_angle(inst, statics.output_angle(inst, handle, [0.1, 0.0, 0.0]), [0.1, 0.0, 0.0])
    np.testing.assert_allclose(back, handle, atol=1e-9)
    with pytest.raises(ArgumentError, match="force has the shape"):
        statics.output_angle(inst, handle, 0.1)
    with pytest.raises(ArgumentError, match="one joint"):
        statics.flexural_stiffness(inst, 0.1)


def test_transmissibility_is_that_of_the_paper_without_its_lever_arms(short: Instrument) -> None:
    found = statics.rates(short, HANDLE).transmissibility[:, 0, 0]
    ratio = [statics.gradient("output_angle", short, angle, wrt=["handle_angle"])["handle_angle"] for angle in HANDLE]
    np.testing.assert_allclose(found, 1 / np.array(ratio), rtol=1e-9)


def test_a_tendon_is_slack_just_beyond_the_load_at_which_it_goes_slack(short: Instrument) -> None:
    load = statics.slack_load(short, HANDLE)
    before, after = (statics.tensions(short, HANDLE, share * load) for share in (0.999, 1.001))
    found = np.isfinite(load) & (load > 0)
    assert found.any()
    assert (np.minimum(before.agonist, before.antagonist)[found] > 0).all()
    assert (np.minimum(after.agonist, after.antagonist)[found] == 0).all()


def test_the_load_at_which_a_tendon_goes_slack_is_the_chains_too(short: Instrument) -> None:
    # A load with a trace of a radial force has no closed form.
    ours = statics.slack_load(short, HANDLE)
    theirs = statics.slack_load(short, HANDLE, radial_force=1e-12)
    np.testing.assert_allclose(theirs, ours, rtol=1e-6)
    lost = statics.loss(short.expanded, [0.3], 1.0)
    assert lost.slack_factor == pytest.approx(statics.slack_load(short, statics.handle_angle(short, 0.3)), rel=1e-6)


def test_a_tendon_that_is_slack_without_a_load_goes_slack_at_none(short: Instrument) -> None:
    assert statics.slack_load(short.replace(pretension=0.0), 0.1) == 0


def test_joints_with_springs_share_what_one_tendon_draws_as_their_springs_do(tmp_path: Any) -> None:
    path = tmp_path / "two.toml"
    path.write_text(SPRUNG)
    inst = tn.load(path)
    by_drawn = np.degrees(statics.coupling(inst))[:, 0] * 1e-3
    assert by_drawn == pytest.approx([2.8648, 8.5944], abs=1e-3)
    stiff = inst.replace(tendon_stiffness=1e9)
    moved = statics.output_angle(stiff, 0.0, wound=[1e-3]) - statics.output_angle(stiff, 0.0)
    assert np.degrees(moved) == pytest.approx(by_drawn, abs=1e-3)


@pytest.mark.parametrize("name", ["needle-driver", "two-segment-continuum", "maryland-dissector"])
def test_the_coupling_of_joints_that_tendons_determine_is_the_pseudo_inverse(name: str) -> None:
    inst = tn.load(name)
    expected = np.linalg.pinv(inst.tendon_arms("tip"))
    turns = statics.straight_arms(inst).sum(axis=0) / np.where(s := inst.tendon_arms("tip").sum(axis=0), s, 1)
    found = statics.coupling(inst)
    moved = np.where(turns, turns, 1)[:, np.newaxis] * found
    np.testing.assert_allclose(moved[turns != 0], expected[turns != 0], atol=1e-9)


def test_not_finite_arguments_are_named_with_their_place() -> None:
    inst = tn.load("real-size").expanded
    with refused("wrench[1, 2]", float("nan")):
        tn.statics.chain.output_angles(inst, 0.0, [[0.0] * 6, [0.0, 0.0, np.nan, 0.0, 0.0, 0.0]])
    with refused("strokes[0]", float("inf")):
        tn.statics.chain.compensation_strokes(inst, 0.0, strokes=[np.inf, 0, 0, 0])

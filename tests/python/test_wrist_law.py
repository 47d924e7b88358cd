"""The law on wrists, what it takes a wrench for, and the axes that a controller has."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.simulate.campaign import rms

from .conftest import load_study, refused

wrist = load_study("wrist")


@pytest.mark.parametrize("name", ["real-size", "scaled-up"])
def test_the_axes_of_a_planar_instrument_come_back(name: str) -> None:
    planar = tn.load(name).replace(axes=("yaw", "pitch"))
    back = tn.control.compensated(tn.instrument.expanded(planar))
    assert back.axes == planar.axes
    for axis in planar.axes:
        was, now = planar.axis(axis), back.axis(axis)
        for key in ("distal_gear_radius", "proximal_gear_radius", "tendon_stiffness", "pretension", "handle_range"):
            assert getattr(now, key) == pytest.approx(getattr(was, key), rel=1e-12)
        assert now.friction.vertex_coefficient == was.friction.vertex_coefficient
    assert back.friction.passing_coefficient == planar.friction.vertex_coefficient


def test_a_joint_without_a_pair_of_its_own_has_no_controller() -> None:
    assert list(tn.control.pairs("hybrid-real-size")) == ["yaw", "pitch"]
    assert tn.control.pairs("needle-driver") == {}
    for refuses in (tn.control.compensated, Controller, tn.control.parameters, tn.control.resolution):
        with pytest.raises(tn.ArgumentError, match="no joint that a controller can compensate"):
            refuses("needle-driver")
    controller = Controller(tn.load("scaled-up"))
    with pytest.raises(tn.ArgumentError, match=r"for yaw of a tendon-gear; .* not yaw and pitch of a tendon-gear"):
        tn.twin.Twin("hybrid-scaled-up").run(np.zeros((2, 3)), controller=controller, wrench=np.zeros(6))


@pytest.mark.parametrize(("state", "direction"), [((33, 33), (1, 0, 0)), ((67, -33), (-0.7, 0.7, 0))])
def test_both_axes_are_given_back_under_a_force_across(
    state: tuple[float, float], direction: tuple[float, float, float]
) -> None:
    off, robust = (wrist.trial("hybrid-scaled-up", state, direction, 1.0, law) for law in ("off", "robust"))
    assert off["worst"] > 2
    assert robust["worst"] < 0.3
    assert robust["faults"] == []
    assert robust["push"] < 0.3


def test_pitch_tendons_that_pass_a_bent_yaw_joint_are_told_their_friction() -> None:
    assert wrist.trial("hybrid-real-size", (67, 0), (0, -1, 0), 1.0, "robust")["worst"] < 0.5


def test_gripped_objects_are_held_with_the_same_force_while_the_wrist_moves() -> None:
    force, least, most = wrist.grip_kept("hybrid-real-size")
    assert force > 1
    assert least > 0.95
    assert most < 1.05


@pytest.mark.slow
@pytest.mark.parametrize("name", wrist.FORCES)
def test_final_errors_over_all_states_and_directions(name: str) -> None:
    rows = wrist.study(name, laws=("robust",), on="threads")
    assert not any(row["faults"] for row in rows)
    assert rows["push"].max() < 0.3
    assert rms(rows["rms"]) < 0.3
    assert rows["worst"].max() < 0.7


def test_moments_by_a_wrench_are_those_of_the_statics() -> None:
    inst = tn.instrument.expanded("maryland-dissector").replace(friction={})
    angles = tn.statics.chain.output_angles(inst, 0, strokes=np.linspace(-2e-4, 2e-4, len(inst.tendons)))
    rates = tn.statics.chain.rates(inst, 0, strokes=np.linspace(-2e-4, 2e-4, len(inst.tendons)))
    assert tn.statics.load_matrix(inst, angles) == pytest.approx(rates.stiffness @ rates.by_wrench, rel=1e-9, abs=1e-12)


def test_two_joints_tell_two_components_and_say_so() -> None:
    inst = tn.instrument.expanded("hybrid-scaled-up")
    angles = np.radians([20.0, -30.0, 0.0])
    force = np.array([0.4, -0.7, 0.0, 0.0, 0.0, 0.0])
    moments = tn.statics.load_matrix(inst, angles) @ force
    moments[2] = np.nan  # the jaw's is not known
    across = tn.statics.tip_wrench(inst, angles, moments, 1e-6, usual=[5, 5, 0, 0, 0, 0])
    assert across.wrench == pytest.approx(force, abs=1e-4)
    anything = tn.statics.tip_wrench(inst, angles, moments, 1e-6)
    deviation = np.sqrt(np.diag(anything.covariance))
    assert np.all(np.abs(anything.wrench - force) < 3 * deviation + 1e-9)
    assert anything.narrowed[2] < 0.6  # along the tip, joints show little
    assert anything.narrowed[5] < 0.5  # no joint turns about the tip's own axis
    nothing = tn.statics.tip_wrench(inst, angles, [np.nan] * 3, 1.0)
    assert nothing.narrowed == pytest.approx(np.zeros(6), abs=1e-12)
    with refused("deviations", -1.0):
        tn.statics.tip_wrench(inst, angles, moments, -1.0)


def test_the_force_at_the_tip_is_estimated_within_its_deviation() -> None:
    inst = tn.instrument.expanded("hybrid-scaled-up")
    handle = wrist.commands(inst, (33, 33))[: round(5 / wrist.STEP)]
    wrench = np.zeros((len(handle), 6))
    wrench[round(2 / wrist.STEP) :, :2] = 0.6, -0.5
    controller = Controller(tn.control.compensated(inst), law="robust", enabled=True)
    run = tn.twin.Twin(inst, seed=2).run(handle, wrench=wrench, controller=controller)
    estimate = tn.control.estimated_wrench(inst, run.rows(-200), usual=[5, 5, 0, 0, 0, 0])
    off = estimate.wrench[:, :2] - wrench[-200:, :2]
    deviation = np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1))[:, :2]
    assert np.all(np.abs(off) < 3 * deviation)
    assert deviation.max() < 0.5
    with refused("run"):
        tn.control.estimated_wrench(inst, tn.twin.Twin(inst).run(handle[:5], wrench=wrench[:5]))

"""The statics against code nobody here wrote: SciPy's root finder and MuJoCo's mechanism."""

import numpy as np
import pytest
from peers import mujoco_peer, scipy_peer

import tenodesis as tn
from tenodesis.instrument import TendonGear


@pytest.mark.parametrize("name", ["real-size", "scaled-up"])
def test_output_angle_agrees_with_scipy_at_ten_thousand_random_points(name: str) -> None:
    inst = tn.load(name)
    assert isinstance(inst, TendonGear)
    random = np.random.default_rng(11)
    handle = random.uniform(-inst.handle_range, inst.handle_range, 10_000)
    force = random.uniform(-1.3, 1.3, 10_000) * tn.statics.slack_force(inst, 0.0)
    state = tn.statics.equilibrium(inst, handle, force)
    theirs = scipy_peer.output_angle(inst, handle, force)
    assert (np.isnan(state.output_angle) == np.isnan(theirs)).all()
    assert np.nanmax(np.abs(state.output_angle - theirs)) <= 1e-9
    assert 0.02 < np.isnan(theirs).mean() < 0.4
    assert ((state.agonist == 0) | (state.antagonist == 0)).mean() > 0.05


@pytest.mark.parametrize("name", ["real-size", "scaled-up"])
def test_output_angle_agrees_with_the_joint_settled_in_mujoco(name: str) -> None:
    inst = tn.load(name)
    assert isinstance(inst, TendonGear)
    reach = float(tn.statics.handle_angle(inst, inst.output_range))
    heaviest = 1.3 * float(tn.statics.slack_force(inst, 0.0))
    compared = slack = 0
    for handle in np.linspace(-reach, reach, 11):
        for force in np.linspace(-heaviest, heaviest, 9):
            ours = tn.statics.equilibrium(inst, float(handle), float(force))
            theirs = mujoco_peer.settle(inst, float(handle), float(force))
            assert np.isnan(ours.output_angle) == np.isnan(theirs.output_angle)
            if np.isnan(ours.output_angle):
                continue
            compared += 1
            slack += min(ours.agonist, ours.antagonist) == 0
            assert np.degrees(abs(ours.output_angle - theirs.output_angle)) < 0.05
            assert ours.agonist == pytest.approx(theirs.agonist, abs=1e-3)
            assert ours.antagonist == pytest.approx(theirs.antagonist, abs=1e-3)
    assert compared > 60
    assert slack > 10


def test_axes_are_independent_without_load_and_not_with_it(real: TendonGear) -> None:
    pose = [float(np.radians(angle)) for angle in (-40, 40)]
    found = mujoco_peer.axis_independence(real, pose, [0.2])
    assert found.unsettled == 0
    assert np.degrees(abs(found.unloaded.change)) < 1e-6
    assert 0.5 < np.degrees(abs(found.loaded.change)) < 1.5
    assert found.loaded.axis == "yaw"

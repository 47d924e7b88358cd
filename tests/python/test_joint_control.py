"""Observer and law for any routing: joints whose tendons turn several of them, with and without a handle."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import FullForm, expanded

from .conftest import refused

STEPS = 6000
FRICTION = {"law": "capstan", "sheath_bend": 0.35}


def with_friction(name: str, coefficient: float) -> FullForm:
    own = {"vertex_coefficient": coefficient, "sheath_coefficient": coefficient}
    return expanded(name).replace(friction=FRICTION | own)


def eased(start: float, span: float) -> np.ndarray:
    share = np.clip((np.arange(1, STEPS + 1) * 5e-4 - start) / span, 0, 1)
    return (share**2 * (3 - 2 * share))[:, np.newaxis]


def left_over(
    truth: FullForm, assumed: FullForm, target: list[float], force: list[float], compensates: bool
) -> tuple[np.ndarray, tn.control.JointEstimate, tn.Run]:
    """Return by what bends what is left of a load's error at the end, deg."""
    angles = truth.bent(target)
    controller = tn.control.JointController(assumed, compensates=compensates)
    wrench = eased(1.2, 0.3) * np.array([*force, 0, 0, 0])
    handle = np.zeros((STEPS, len(truth.handle_joints)))
    run, estimate = tn.twin.Twin(truth).run_joints(controller, handle, eased(0, 1) * angles, wrench=wrench)
    off = run["output_angle"][-200:].mean(axis=0) - angles
    return np.degrees([off[places].sum() for places in truth.bends.values()]), estimate, run


@pytest.mark.parametrize("scale", [0.7, 1.0, 1.3])
@pytest.mark.parametrize("name", ["needle-driver", "maryland-dissector"])
def test_jaws_over_a_wrist_come_back_under_load_whatever_friction(name: str, scale: float) -> None:
    truth, assumed = with_friction(name, 0.1 * scale), with_friction(name, 0.1)
    case = ([0.4, -0.3, 0.5], [6.0, 5.0, 0.5])
    off, _, _ = left_over(truth, assumed, *case, compensates=False)
    left, estimate, run = left_over(truth, assumed, *case, compensates=True)
    assert np.abs(off).max() > 1.5
    assert np.abs(left).max() < 0.7
    error = estimate.angle[-1] - run["output_angle"][-1]
    assert (np.abs(error) < 3 * estimate.angle_std[-1]).all()


def test_segments_that_droop_reach_what_is_commanded() -> None:
    inst = expanded("two-segment-continuum")
    off, _, _ = left_over(inst, inst, [0.5, -0.3], [0.1, 0.0, 0.1], compensates=False)
    left, _, _ = left_over(inst, inst, [0.5, -0.3], [0.1, 0.0, 0.1], compensates=True)
    assert np.abs(off).max() > 5
    assert np.abs(left).max() < 0.5


def test_with_a_handle_its_angles_are_the_targets() -> None:
    inst = expanded("hybrid-real-size")
    controller = tn.control.JointController(inst)
    handle = eased(0, 1) * np.array([0.2, -0.15, 0.0])
    wrench = eased(1.2, 0.3) * np.array([0.2, 0.2, 0, 0, 0, 0])
    run, _ = tn.twin.Twin(inst).run_joints(controller, handle, wrench=wrench)
    planar = tn.control.compensated(inst)
    for n, axis in enumerate(("yaw", "pitch")):
        wanted = tn.statics.output_angle(planar.axis(axis), handle[-1, n], 0.0)
        assert np.degrees(run["output_angle"][-1, n] - wanted) == pytest.approx(0, abs=0.7)


def test_a_tick_is_that_of_the_loop_and_reset_starts_again() -> None:
    inst = expanded("needle-driver")
    controller = tn.control.JointController(inst)
    measured = np.array([21.0, 19.0, 20.0, 20.0, 20.0, 20.0]), np.zeros(6)
    first, estimate = controller.step(*measured)
    controller.step(*measured, target=[0.1, 0.0, 0.0])
    controller.reset()
    again, same = controller.step(*measured)
    assert np.array_equal(first, again)
    assert np.array_equal(estimate.covariance, same.covariance)
    assert estimate.angle_std == pytest.approx(np.sqrt(np.diag(estimate.covariance)))
    assert estimate.moment[0] == pytest.approx(2 * 2.5e-3, rel=0.1)


def test_what_does_not_fit_is_refused() -> None:
    controller = tn.control.JointController("needle-driver")
    with refused("period"):
        tn.control.JointController("needle-driver", period=0.0)
    with pytest.raises(ValueError, match="does not fit"):
        controller.step(np.zeros(4), np.zeros(6))
    with pytest.raises(ValueError, match="do not fit"):
        tn.twin.Twin(expanded("hybrid-real-size")).run_joints(controller, np.zeros((2, 3)))
    with refused("controller"):
        tn.twin.Twin("scaled-up").run_joints(controller, np.zeros((2, 1)))
    with refused("target"):
        tn.twin.Twin("needle-driver").run_joints(controller, np.zeros((2, 0)), target=[0.2, 0.3])

"""Claims about the geometry of joints: one definition, in the core, which chain and closed form share."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import _core
from tenodesis.instrument.joints import MECHANISMS

ANGLES = np.linspace(-2.5, 2.5, 11)


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_the_rate_of_a_chord_is_its_slope(mechanism: str) -> None:
    step = 1e-6
    before, after = (_core.joint_chord(MECHANISMS[mechanism], 0.02, ANGLES + way * step)[0] for way in (-1, 1))
    rate = _core.joint_chord(MECHANISMS[mechanism], 0.02, ANGLES)[1]
    np.testing.assert_allclose(rate, (after - before) / (2 * step), atol=1e-10)


def test_only_a_backbones_chord_shortens_and_as_that_of_an_arc() -> None:
    for mechanism, number in MECHANISMS.items():
        chord = _core.joint_chord(number, 0.02, np.array([1.2]))[0, 0]
        assert chord == pytest.approx(0.02 * (np.sin(0.6) / 0.6 if mechanism == "continuum" else 1.0), rel=1e-15)


def test_a_gears_coordinate_is_the_sine_of_half_its_angle_and_others_are_their_angles() -> None:
    at, turn = _core.joint_coordinate([MECHANISMS["tendon-gear"], MECHANISMS["pulley"]], np.array([0.8, 0.8]))
    np.testing.assert_allclose(at, [np.sin(0.4), 0.8], rtol=1e-15)
    np.testing.assert_allclose(turn, [np.cos(0.4) / 2, 1.0], rtol=1e-15)


@pytest.mark.parametrize("name", ["real-size", "scaled-up"])
def test_arms_of_the_chain_are_those_of_the_closed_form(name: str) -> None:
    inst = tn.load(name)
    arm = tn.statics.straight_arms(inst)[0, 0]
    stiffness = 2 * inst.tendon_stiffness * arm**2
    assert stiffness == pytest.approx(tn.statics.flexural_stiffness(inst, 0.0), rel=1e-12)

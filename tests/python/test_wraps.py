"""Where tendons wrap at joints: the geometry of pulleys, gears and backbones, and friction there by capstans alone."""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import root

import tenodesis as tn
from tenodesis import _core
from tenodesis.instrument import FullForm
from tenodesis.instrument.joints import MECHANISMS
from tenodesis.plant import TwinRows, twin_rows
from tenodesis.run import Array

from .conftest import EXAMPLES, tables

ANGLES = np.radians([-80.0, -30.0, 0.0, 30.0, 80.0])
COEFFICIENT, BEND = 0.12, np.radians(20)
STEP = 1e-3
EVERY: dict[str, Any] = {"vertex_coefficient": COEFFICIENT, "sheath_coefficient": COEFFICIENT, "sheath_bend": BEND}
FRICTION: dict[str, Any] = {"law": "capstan"} | EVERY


def needle_driver(**friction: Any) -> FullForm:
    return tn.instrument.expanded("needle-driver").replace(friction=FRICTION | friction)


def passages(inst: FullForm) -> TwinRows:
    return twin_rows(inst, 1e-5, quasi_static=True)


def wraps(inst: FullForm, tendon: int, angle: float) -> list[float]:
    """Return the wraps of a tendon at its contacts on joints, all at one angle, from the core's rows."""
    rows = passages(inst)
    contacts = rows.passages[tendon, : rows.contacts[tendon]]
    return [wrap + _core.joint_wrap(wound, angle * share) for joint, _, wrap, share, _, wound in contacts if joint >= 0]


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_pulley_winds_as_much_tendon_as_lengthens_its_way(side: float) -> None:
    arm, base = side * 2e-3, np.radians(90)
    wound = _core.joint_wound_bend(MECHANISMS["pulley"], base, -arm)
    lies_on = [abs(arm) * _core.joint_wrap(wound, angle) for angle in ANGLES]
    np.testing.assert_allclose(lies_on, abs(arm) * base - arm * ANGLES, rtol=1e-14)


def test_where_a_tendon_has_left_its_pulley_a_guide_bends_it_by_what_is_missing() -> None:
    # Directions before and behind the joint differ by its angle and the base: no way that is as long bends less.
    wound = _core.joint_wound_bend(MECHANISMS["pulley"], 0.3, -1e-3)
    assert _core.joint_wrap(wound, 0.5) == pytest.approx(0.2)
    assert [_core.joint_wrap(0.0, angle) for angle in ANGLES] == list(np.abs(ANGLES))


@pytest.mark.parametrize("mechanism", ["tendon-gear", "continuum"])
def test_edges_and_backbones_unwind_nothing(mechanism: str) -> None:
    assert _core.joint_wound_bend(MECHANISMS[mechanism], 0.3, 1e-3) == 0
    assert _core.joint_wound_bend(MECHANISMS["pulley"], 0.3, 0.0) == 0


def test_a_route_says_by_its_side_where_its_tendon_wraps() -> None:
    inst = needle_driver()
    at = {tendon.name: wraps(inst, m, np.radians(60)) for m, tendon in enumerate(inst.tendons)}
    degrees = {name: np.degrees(found).round(9).tolist() for name, found in at.items()}
    assert degrees["pitch_wound"] == degrees["pitch_unwound"] == [60]
    assert degrees["jaw_1_wound"] == degrees["jaw_2_wound"] == [30, 60]
    assert degrees["jaw_1_unwound"] == degrees["jaw_2_unwound"] == [150, 60]


def test_guides_bend_a_tendon_whatever_the_angle_and_two_vertices_share_all() -> None:
    route = [{"joint": "pitch", "side": "agonist", "base_wrap": "20 deg", "guide_wrap": "40 deg"}]
    tendons = [{"name": "pitch_wound", "route": route}, *tables(needle_driver(), "tendons")[1:]]
    for vertices in (1, 2):
        inst = needle_driver(vertices_per_joint=vertices).replace(tendons=tendons)
        for angle, sum_of_all in ((-50, 110), (0, 60), (10, 50), (50, 70)):
            found = wraps(inst, 0, np.radians(angle))
            assert len(found) == vertices
            assert np.degrees(sum(found)) == pytest.approx(sum_of_all)


def test_a_pulley_of_the_handle_winds_the_tendon_that_it_draws() -> None:
    planar = tn.load(EXAMPLES / "pulley.toml")
    inst = tn.instrument.expanded(planar)
    tendons = tables(inst, "tendons")
    for tendon in tendons:
        for crossing in tendon["route"]:
            crossing |= {"guide_wrap": 0.0, "base_wrap": 1.0}
    based = inst.replace(tendons=tendons)
    assert wraps(based, 0, 0.4) == pytest.approx([1.4, 0.6])
    assert wraps(based, 1, 0.4) == pytest.approx([0.6, 1.4])
    # The vertices of all joints of the short form unwind nothing.
    stated = tn.instrument.expanded(planar.replace(**{"friction.base_wrap": 1.0}))
    assert wraps(stated, 0, 0.4) == wraps(stated, 1, -0.4) == pytest.approx([1.4, 1.4])


def pulled(inst: FullForm, pitch: float, jaw: float) -> tuple[Array, Array, Array]:
    """Return strokes (m), angles and tensions of a needle driver whose tendons, after a motion, are wound alike."""
    aim = np.array([pitch, jaw, -0.6 * jaw])
    moved = inst.tendon_arms("tip") @ aim
    way = np.clip(np.arange(1, 1201) * STEP / 0.8, 0, 1)[:, np.newaxis]
    wound = 1.2e-3 * np.clip(np.arange(1, 1201)[:, np.newaxis] * STEP - 0.8, 0, 0.4) / 0.4
    place = way * moved + wound
    twin = tn.twin.Twin(inst, quasi_static=True, time_step=STEP)
    velocity = np.diff(place, axis=0, prepend=0) / STEP / inst.own_drives.spool_radius
    run = twin.run(np.zeros((len(place), 0)), spool_velocity=velocity)
    return inst.own_drives.spool_radius * run["spool_angle"][-1], run["output_angle"][-1], run["tension"][-1]


def by_capstans(inst: FullForm, stroke: Array) -> tuple[Array, Array]:
    """Return angles and spool tensions of a needle driver whose tendons all slip toward their spools.

    Each contact leaves e^(-mu phi) of the tension, phi on the pitch pulley a right angle less what pitch unwinds.
    """
    segments = passages(inst).segments
    arms, rest = inst.tendon_arms("tip"), inst.pretensions[0]

    def tensions(angles: Array) -> list[Array]:
        found = []
        for m, arm in enumerate(arms):
            drawn = arm[0]
            base = np.pi / 2 if arm[1:].any() else 0.0
            bends = [BEND, abs(base - np.sign(drawn) * angles[0])]
            if arm[1:].any():
                bends.append(abs(angles[1:][arm[1:] != 0][0]))
            left = np.exp(-COEFFICIENT * np.cumsum([0.0, *bends]))
            soft = 1 / segments[m, : len(left)]
            found.append(left * (stroke[m] - arm @ angles + rest * soft.sum()) / (soft @ left))
        return found

    def unbalanced(angles: Array) -> Array:
        about = np.zeros(3)
        for tension, arm in zip(tensions(angles), arms, strict=True):
            about[0] += arm[0] * tension[2]
            about[1:] += arm[1:] * tension[-1]
        return about

    found = root(unbalanced, np.zeros(3), tol=1e-13)
    assert found.success
    return found.x, np.array([tension[0] for tension in tensions(found.x)])


@pytest.mark.parametrize(("pitch", "jaw"), [(1.0, 0.4), (-1.0, 0.4), (0.5, -0.7)])
def test_tendons_pulled_through_a_wrist_have_the_tensions_of_capstans_by_their_sides(pitch: float, jaw: float) -> None:
    # Behind stiff ends a joint's two tendons slip opposite ways.
    inst = needle_driver(tip_joint_compliance_share=0.25)
    stroke, angles, tensions = pulled(inst, pitch, jaw)
    expected, at_spools = by_capstans(inst, stroke)
    np.testing.assert_allclose(angles, expected, rtol=0, atol=2e-7)
    np.testing.assert_allclose(tensions, at_spools, rtol=1e-5)

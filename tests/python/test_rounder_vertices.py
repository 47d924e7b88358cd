"""Claims about rounder vertices: the radius that a joint holds, what it does to friction, and the study's command."""

import json
from math import cos, inf, radians, sin, tan
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

from tenodesis import instrument
from tenodesis.cli import vertices as command
from tenodesis.errors import CommandError, InstrumentError, StudyError
from tenodesis.instrument import Instrument
from tenodesis.paper import rounder_vertices as rounder
from tenodesis.paper.rounder_vertices import METAL, PLASTIC, SPRINGY, VertexDesign, VertexRope, VertexStudy

from .conftest import EXAMPLES, refused

REFERENCE = 0.27e-3
STIFF = VertexRope("stiff", 4e-6)


@pytest.fixture(scope="module")
def scaled_up() -> Instrument:
    return instrument.load("scaled-up").planar[0]


@pytest.fixture(scope="module")
def small(scaled_up: Instrument) -> VertexStudy:
    held = rounder.radius_limits(scaled_up).largest
    return rounder.study(scaled_up, radii=[held], shares=(0.5,), tendons=(SPRINGY, STIFF), surfaces=(METAL,))


def _hysteresis(inst: Instrument, radius: float, rope: VertexRope = SPRINGY, surface: rounder.Surface = METAL) -> float:
    changed = rounder.redesigned(inst, VertexDesign(radius, 0.1, rope, surface), REFERENCE)
    return rounder.loop(changed, "yaw", 1.5)[0]


def test_rounder_vertices_never_reduce_friction_without_bending(scaled_up: Instrument) -> None:
    # The pressure falls with the radius, and by the power law the coefficient rises: mu_r (rho / rho_r)^(1 - n).
    loops = [_hysteresis(scaled_up, radius, surface=PLASTIC) for radius in (REFERENCE, 1e-3, 3e-3, 7e-3)]
    assert np.all(np.diff(loops) > 0)


def test_on_metal_the_radius_changes_nothing_without_bending(scaled_up: Instrument) -> None:
    assert _hysteresis(scaled_up, REFERENCE) == _hysteresis(scaled_up, 7e-3)


def test_with_a_stiff_rope_on_metal_rounder_vertices_reduce_the_loop_to_that_without_bending(
    scaled_up: Instrument,
) -> None:
    loops = [_hysteresis(scaled_up, radius, STIFF) for radius in (1e-3, 2e-3, 4e-3, 8e-3, 0.1)]
    without = _hysteresis(scaled_up, REFERENCE)
    assert np.all(np.diff(loops) < 0)
    assert loops[-1] == pytest.approx(without, abs=0.01)


def test_arcs_of_the_largest_radius_meet_in_the_span(scaled_up: Instrument) -> None:
    # The contact is at the height r above the gear's centre; the arc's centre is where the arc ends.
    radius, phi = 7.5e-3, radians(40)

    def beyond(rho: float) -> float:
        return (radius + rho) * sin(phi) - rho * tan(phi / 2) * cos(phi) - radius

    assert rounder.radius_limits(scaled_up).span == pytest.approx(brentq(beyond, 0, 1), rel=1e-9)


def test_an_arc_of_the_largest_radius_uses_up_the_wall(scaled_up: Instrument) -> None:
    limits = rounder.radius_limits(scaled_up)
    assert limits.wall * (1 - cos(radians(40))) == pytest.approx((18.75e-3 - 2 * 7.5e-3 - 0.54e-3) / 2, rel=1e-12)
    assert limits.largest == limits.wall
    assert limits.reason == "the wall of the joint"


def test_a_joint_without_an_outer_diameter_is_limited_by_its_span(scaled_up: Instrument) -> None:
    limits = rounder.radius_limits(scaled_up.replace(stem_diameter=None))
    assert limits.wall == inf
    assert limits.largest == limits.span


def test_arcs_change_the_pretension_as_the_length_of_the_rounded_way_says(scaled_up: Instrument) -> None:
    # Tangent, arc, tangent in one link, from far below the vertex to the contact; both tendons, both links.
    rho, radius = 5e-3, 7.5e-3
    begin = rho * tan(radians(20))

    def way(phi: float, side: int) -> float:
        # The arc's centre is beside the tendon and `begin` below the vertex; the arc ends at its height.
        height = (side * radius + rho) * sin(phi) - begin * cos(phi)
        return rho * phi + radius - height

    growth = [way(phi, 1) + way(phi, -1) - way(0, 1) - way(0, -1) for phi in np.linspace(0, radians(40), 201)]
    expected = scaled_up.tendon_stiffness * np.abs(growth).max()
    assert rounder.pretension_shift(scaled_up, rho) == pytest.approx(expected, rel=1e-9)


def test_the_bending_stiffness_of_a_rope_is_that_of_its_wires() -> None:
    # 49 wires of 0.06 mm, whose modulus gives the rope's stiffness over the full circle of 0.54 mm.
    wire, count = 0.06e-3, 49
    modulus = 73.2e9 * 0.54e-3**2 / (count * wire**2)
    assert rounder.bending_stiffness("7x7 stainless", 0.54e-3, 73.2e9) == pytest.approx(
        count * modulus * np.pi * wire**4 / 64, rel=1e-12
    )
    with refused("rope", "1x19", kind=StudyError):
        rounder.bending_stiffness("1x19", 1e-3, 1e11)


@pytest.mark.slow
def test_the_study_is_finite_and_more_friction_widens_the_loop(small: VertexStudy) -> None:
    for row in small.designs:
        assert np.isfinite([row["hysteresis"], row["delay"], *row["off"], *row["paper"], *row["robust"]]).all()
    for less, more in small.designs.by("rope", "radius").values():
        assert less["coefficient"] < more["coefficient"]
        assert less["hysteresis"] < more["hysteresis"]
        assert less["delay"] < more["delay"]


def test_no_radius_saves_the_papers_law_and_half_the_coefficient_does(small: VertexStudy) -> None:
    assert small.good_radii(SPRINGY, METAL) == []
    half, whole = (rounder.worst(row, "paper") for row in small.along_coefficient)
    assert half <= rounder.GOOD < whole
    assert "No radius up to the 6.9 mm that the joint holds brings" in rounder.answer(small)
    assert "a coefficient of at most 0.05 instead of 0.1 does" in rounder.answer(small)


def test_the_study_writes_a_page_with_its_figure_and_results(small: VertexStudy, tmp_path: Path) -> None:
    rounder.write(small, tmp_path)
    page = (tmp_path / "vertices.html").read_text("utf-8")
    assert "<svg" in page
    assert "<script src" not in page
    assert "<img" not in page
    results = json.loads((tmp_path / "results.json").read_text("utf-8"))
    assert results["answer"] == rounder.answer(small)
    assert len(results["designs"]) == len(small.designs)
    assert (tmp_path / "sweep.csv").read_text("utf-8").count("\n") == len(small.designs) + 1
    assert (tmp_path / "figures/vertices.png").is_file()


def test_wrong_inputs_are_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InstrumentError, match=r"^absent: there is no such file"):
        command.study_vertices("absent")
    with pytest.raises(InstrumentError, match=r"^joints.mechanism is 'pulley'; it must be tendon-gear, whose vertices"):
        command.study_vertices(str(EXAMPLES / "pulley.toml"), out=tmp_path)
    with pytest.raises(CommandError, match=r"^--force = '-1 N'"):
        command.study_vertices("scaled-up", force="-1 N", out=tmp_path)
    with pytest.raises(InstrumentError, match=r"^friction.vertex_coefficient is 0; it must be above 0"):
        rounder.study(instrument.load("scaled-up").planar[0].replace(friction=None))


def test_of_several_joints_those_of_gears_are_judged_one_by_one() -> None:
    inst = instrument.load("hybrid-real-size")
    assert rounder.axes_of(inst) == ("yaw", "pitch")
    plane = instrument.load("real-size").planar[0]
    assert rounder.radius_limits(inst) == pytest.approx(rounder.radius_limits(plane))
    for name in ("needle-driver", "two-segment-continuum"):
        with refused("joints.mechanism", kind=InstrumentError):
            rounder.axes_of(instrument.load(name))
    with refused("axis", "jaw", kind=InstrumentError):
        rounder.study(inst, axis="jaw")


@pytest.mark.slow
def test_joints_have_the_loop_of_the_planar_instrument_while_the_others_are_straight() -> None:
    inst, plane = instrument.load("hybrid-real-size"), instrument.load("real-size").planar[0]
    yaw, pitch = (rounder.loop(inst, axis, 0.0)[0] for axis in ("yaw", "pitch"))
    assert yaw == pytest.approx(rounder.loop(plane, "yaw", 0.0)[0], rel=0.02)
    assert pitch == pytest.approx(yaw, rel=0.02)


@pytest.mark.parametrize(("given", "studied"), [(None, "yaw"), ("pitch", "pitch")])
def test_of_two_planar_axes_one_is_studied(
    given: str | None, studied: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    seen: list[Instrument] = []

    def study(inst: Instrument, *_: object, **__: object) -> VertexStudy:
        seen.append(inst)
        raise StudyError(key="seen", value=inst.name, allowed="no more")

    monkeypatch.setattr(rounder, "study", study)
    with refused("seen", kind=StudyError):
        command.study_vertices("real-size", axis=given, out=tmp_path)
    assert seen == [instrument.load("real-size").axis(studied)]
    assert rounder.radius_limits(seen[0]).largest < inf

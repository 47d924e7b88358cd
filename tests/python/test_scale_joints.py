import csv
import math
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis import similarity, workshop
from tenodesis.cli.app import app
from tenodesis.errors import DesignError, StudyError
from tenodesis.instrument import FullForm, expanded
from tenodesis.scaling import catalogue, design_joints, enlarged
from tenodesis.scaling.transfer import ALL_JOINTS, carry
from tenodesis.similarity.joints import with_pretensions

from .conftest import refused

FULL = ("hybrid-real-size", "maryland-dissector", "needle-driver", "two-segment-continuum")


@pytest.fixture(scope="module")
def driver() -> FullForm:
    return expanded("needle-driver")


@pytest.mark.parametrize("name", FULL)
def test_an_enlarged_instrument_has_every_group_and_no_error(name: str) -> None:
    real = tn.load(name)
    pair = similarity.compare_joints(real, enlarged(real, 4.0, 0.5))
    assert pair.factors["length"] == pytest.approx(4)
    assert pair.factors["tension"] == pytest.approx(2)
    assert pair.factors["force"] == pytest.approx(2)
    assert pair.factors["moment"] == pytest.approx(8)
    assert pair.factors["time"] == pytest.approx(math.sqrt(4**3 / 0.5))
    assert [group.name for group in pair.groups if not abs(group.ratio - 1) < 1e-9 and group.real_size] == []
    error = pair.error()
    assert error.largest.max() < 1e-9
    assert error.largest_at_tip < 1e-9
    assert error.unsolved == 0
    assert pair.error_at_rest().largest.max() < 1e-6


def test_one_axis_has_the_factors_and_errors_of_the_planar_comparison() -> None:
    real, scaled = tn.load("real-size").axis("yaw"), tn.load("scaled-up").axis("yaw")
    pair, planar = similarity.compare_joints(real, scaled), similarity.compare(real, scaled)
    for key in ("length", "tendon_stiffness", "tension", "torque", "handle_torque"):
        assert pair.factors[key] == pytest.approx(planar.factors[key], rel=1e-6)
    states, factor = pair.states, pair.factors["force"]
    handle, force = states.handle, -states.wrench[:, 0]
    scaled = scaled.replace(pretension=planar.scaled_pretension)
    expected = tn.statics.output_angle(scaled, handle, force * factor) - tn.statics.output_angle(real, handle, force)
    np.testing.assert_allclose(pair.error().angle[..., 0], np.degrees(expected), atol=1e-6)


def test_an_arm_that_is_not_similar_is_named_and_costs_degrees(driver: FullForm) -> None:
    large = enlarged(driver, 4, 1)
    jaw = large.joints[0]
    pair = similarity.compare_joints(driver, large.replace(**{f"joints.{jaw.name}.radius": 1.05 * jaw.radius}))
    assert any(not group.matches and group.name.startswith("r(jaw_1)/r") for group in pair.groups)
    assert pair.error().largest[0] > 0.05


def test_error_at_the_tip_is_that_of_the_angles_on_the_real_size_lengths(driver: FullForm) -> None:
    pair = similarity.compare_joints(driver, driver)
    bent = np.zeros((1, 1, 3))
    off = bent.copy()
    off[..., 0] = 1e-3
    reach = 9.1e-3 + 10.2e-3
    assert pair.between(off, bent).tip[0, 0] == pytest.approx(1e-3 * reach, rel=1e-3)


def test_loops_end_where_the_motors_are_meant_to_be(driver: FullForm) -> None:
    pair = similarity.compare_joints(driver, driver)
    angles = pair.motions.angles([driver])[0]
    flexion, _ = pair.motions.last_loop
    at = pair.motions.names.index("jaw_1")
    assert np.degrees(angles[flexion][-1, at, 1]) == pytest.approx(120, abs=0.2)
    assert pair.error_at_rest().largest.max() == 0


def test_other_joints_or_tendons_are_refused(driver: FullForm) -> None:
    with refused("scaled_up"):
        similarity.compare_joints(driver, "two-segment-continuum")


def test_a_design_is_similar_and_within_its_constraints(driver: FullForm) -> None:
    parts = catalogue.load()
    front = design_joints(driver, parts, pins={"factor": 4.0})
    design = front[front.best()]
    assert design.objectives.similarity_error < 1e-6
    assert design.comparison.factors["length"] == pytest.approx(4)
    assert design.error_at_rest.largest.max() < 0.05
    limits = parts.constraints
    assert design.choice.rope.breaking_load / design.largest_tension >= limits.tension_margin
    assert limits.overall_length is not None
    assert limits.overall_length[0] <= design.objectives.overall_length <= limits.overall_length[1]
    read = tn.instrument.parse(design.scaled_up.to_toml())
    assert read == design.scaled_up
    tensions = design.comparison.scaled_pretensions
    np.testing.assert_allclose(design.scaled_up.pretensions, tensions)


def test_wheels_in_stock_are_those_of_the_catalogue(driver: FullForm) -> None:
    parts = catalogue.load()
    near = parts.constraints.model_copy(update={"factor": (4.4, 5.1)})
    front = design_joints(driver, parts.model_copy(update={"constraints": near}))
    stock = front.in_stock
    assert stock is not None
    radii = np.array([pulley.radius for pulley in parts.pulleys])
    assert all(np.isclose(radii, one, rtol=1e-9).any() for one in stock.radii)
    assert 0.01 < stock.error < 1


def test_a_rod_of_a_backbone_sets_the_stiffness_of_the_tendons() -> None:
    real = tn.load("two-segment-continuum")
    front = design_joints(real)
    design = front[front.best()]
    rod = design.choice.rods[0][1]
    rigidity = [joint.backbone_rigidity for joint in design.scaled_up.as_given("joints")]
    assert rigidity == [rod.rigidity, rod.rigidity]
    assert design.error.largest.max() < 1e-6


@pytest.mark.parametrize(
    ("pins", "key"), [({"rope": "twine"}, "rope"), ({"end_effector_length": 0.1}, "end_effector_length")]
)
def test_pins_of_no_part_are_refused(driver: FullForm, pins: dict[str, object], key: str) -> None:
    with refused(key, kind=DesignError):
        design_joints(driver, pins=pins)


def test_a_factor_without_wheels_is_answered_with_the_nearest_that_has_some(driver: FullForm) -> None:
    with pytest.raises(DesignError, match="end-effector must be 30 to 300 mm long") as caught:
        design_joints(driver, pins={"factor": 2.0})
    assert len(design_joints(driver, pins={"factor": float(caught.value.allowed)}).sets) > 0


def test_constraints_that_contradict_are_named(driver: FullForm) -> None:
    parts = catalogue.load()
    tight = parts.constraints.model_copy(update={"tension_margin": 500.0})
    with refused("tension_margin", kind=DesignError):
        design_joints(driver, parts.model_copy(update={"constraints": tight}), pins={"factor": 4.0})


def test_a_run_of_a_similar_instrument_becomes_the_run_of_the_real_one() -> None:
    real = tn.load("hybrid-real-size").replace(dynamics={"natural_frequency": 20, "hand_stiffness": 0})
    scaled = enlarged(real, 4.0, 0.5)
    factors = similarity.compare_joints(real, scaled).factors
    time = np.arange(600) * 5e-4
    handle = np.zeros((600, 3))
    handle[:, :2] = np.radians(10) * np.sin(8 * time)[:, None]
    wrench = np.outer(time > 0.1, [-0.3, 0.2, 0, 0, 0, 0])
    direct = tn.twin.Twin(real, time_step=5e-4).run(handle, wrench=wrench)
    large = tn.twin.Twin(scaled, time_step=5e-4 * factors["time"]).run(handle, wrench=wrench * factors["force"])
    carried = carry(large, real, scaled_up=scaled)
    assert list(carried.factors) == [ALL_JOINTS]
    np.testing.assert_allclose(carried.run.time, direct.time, rtol=1e-9)
    np.testing.assert_allclose(carried.run["output_angle"], direct["output_angle"], atol=1e-6)
    np.testing.assert_allclose(carried.run["tension"], direct["tension"], atol=1e-4)
    assert carried.run.wrench == pytest.approx(wrench)
    assert carried.similarity_error() < 1e-6
    assert carried.real_size.friction.vertex_coefficient == 0.1


def test_tolerances_of_tendons_are_each_their_own(driver: FullForm) -> None:
    scaled = enlarged(driver, 4.0, 0.5)
    keys = [one.key for one in tn.tolerance.default(scaled).parameters]
    assert {"joints.pitch.radius", "tendons.jaw_1_wound.pitch.radius", "tendons.jaw_2_wound.stiffness"} <= set(keys)
    text = '[[parameters]]\nkey = "tendons.pitch_wound.stiffness"\ndistribution = "uniform"\nhalf_width = "10 %"\n'
    study = tn.tolerance.study(driver, scaled, tn.tolerance.parse(text), samples=8)
    assert study.joints == ("pitch", "jaw_1", "jaw_2")
    pitch = study.responses["similarity_largest.pitch"]
    assert pitch.nominal < 1e-3
    assert 0.02 < pitch.quantile(0.95) < 1
    assert study.responses["tip_largest"].unit == "mm"


def test_a_scale_model_with_other_pretensions_is_not_similar_under_load(driver: FullForm) -> None:
    scaled = enlarged(driver, 4.0, 0.5)
    pair = similarity.compare_joints(driver, with_pretensions(scaled, 0.1 * scaled.pretensions))
    assert pair.error(pretensions=pair.scaled_up.pretensions).largest.max() > 0.1
    assert pair.error().largest.max() < 1e-9


def test_the_real_size_instrument_comes_first(driver: FullForm) -> None:
    with refused("real_size", kind=StudyError):
        tn.tolerance.study(enlarged(driver, 4.0, 0.5), driver, samples=8)


@pytest.mark.slow
def test_scale_writes_model_plan_and_parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tenodesis.cli.common.console.width", 80)
    monkeypatch.setattr("tenodesis.cli.scale._SAMPLES", 4)
    monkeypatch.setattr("tenodesis.workshop.budget.JOINT_SAMPLES", 100)
    monkeypatch.setattr("tenodesis.workshop.pack.rehearse", partial(workshop.rehearse, brief=True))
    out = tmp_path / "prototype"
    result = CliRunner().invoke(app, ["scale", "needle-driver", "--factor", "4", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert "at the real-size tip" in result.output
    assert max(len(line.rstrip()) for line in result.output.splitlines() if line.startswith(" ")) <= 80
    assert tn.load(out / "scaled-up.toml").name == "needle-driver-scaled-up"
    assert "jaw_1_wound" in (out / "plan.html").read_text("utf-8")
    with (out / "parts.csv").open(encoding="utf-8") as file:
        assert any(row["part"] == "rope for tendons" for row in csv.DictReader(file))
    assert "Tolerances:" in (out / "plan.html").read_text("utf-8")
    assert {"order.csv", "checklist.csv", "first-run.toml", "controller.h"} <= {one.name for one in out.iterdir()}
    assert tn.simulate.load(out / "first-run.toml").duration(tn.load(out / "scaled-up.toml")) < 3600
    studied = tn.tolerance.load(out / "tolerances.toml")
    assert {"joints.pitch.radius", "tendons.jaw_2_wound.stiffness"} <= {one.key for one in studied.parameters}


def test_loss_of_two_axes_has_both_joints_at_once(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text(tn.load("real-size").replace(axes=["yaw", "pitch"]).to_toml(), "utf-8")
    both = CliRunner().invoke(app, ["loss", str(path), "--load", "0.5 N", "--angle", "0 deg"])
    assert both.exit_code == 0, both.output
    # The nearer joint has the farther one's length in its lever, which an axis by itself has not.
    assert "6.91" in both.output
    assert "5.98" in both.output
    one = CliRunner().invoke(app, ["loss", str(path), "--axis", "yaw", "--load", "0.5 N", "--angle", "0 deg"])
    assert "5.98" in one.output
    assert "6.91" not in one.output

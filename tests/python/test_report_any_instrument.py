"""Claims about the report on any instrument: which chapters it has, and that their numbers are those of the statics."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import instrument, statics
from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument, expanded
from tenodesis.paper import report, run
from tenodesis.paper.context import Context
from tenodesis.paper.cycles import cycle
from tenodesis.paper.run import CHAPTERS, chosen, left_out, steps
from tenodesis.paper.subject import Subject
from tenodesis.report import style
from tenodesis.similarity.joints import compare_joints
from tenodesis.statics import chain
from tenodesis.statics.bends import Bends

from .chain_samples import backbone, drawn, jaws, two_axes

SHIPPED = ("needle-driver", "maryland-dissector", "two-segment-continuum", "hybrid-real-size", "hybrid-scaled-up")
ANY = {"jaws": jaws, "backbone": backbone, "gears": lambda: two_axes("scaled-up"), "drawn": lambda: drawn(3)}
STATICS = ("posture", "input-output", "slack", "transmissibility", "stiffness", "loss", "workspace")


def sample(name: str) -> Instrument:
    return ANY[name]() if name in ANY else tn.load(name)


def computed(inst: Instrument, *names: str, scaled: Instrument | None = None) -> tuple[Context, str]:
    """Compute chapters, lay out their figures without saving them, and return the text of the report on them."""
    context = Context.of(inst, scaled)
    with style.applied():
        sections = [chosen(context, [name])[name].section(context) for name in names]
        for plot in (plot for section in sections for plot in section.plots):
            assert all(np.isfinite(np.asarray(values, float)).any() for values in plot.curves.values()), plot.name
            plot.figure.draw_without_rendering()
    drawings = {plot.name: "" for section in sections for plot in section.plots}
    return context, re.sub(r"<style.*?</style>", "", report.render(context, sections, drawings), flags=re.S)


@pytest.mark.parametrize("name", [*SHIPPED, *ANY, "real-size", "scaled-up"])
def test_every_chapter_applies_or_says_in_a_sentence_why_not(name: str) -> None:
    context = Context.of(sample(name))
    found, missing = chosen(context), left_out(context)
    assert found.keys() | missing.keys() == CHAPTERS.keys()
    assert not found.keys() & missing.keys()
    assert all(reason.endswith(".") for reason in missing.values())
    for chapter in missing:
        with pytest.raises(ArgumentError, match=f"only names {chapter}, which {context.given.name} does not have: "):
            chosen(context, [chapter])


def test_only_planar_axes_that_stand_alone_have_their_stiffness_in_the_chapter_on_loss() -> None:
    own = Context.of(tn.load("scaled-up").axis("yaw").replace(name="own", pretension=20))
    assert not {"stiffness", "posture"} & chosen(own).keys()
    two = Context.of(tn.load("real-size").replace(name="own"))
    assert "stiffness" in chosen(two)


def test_only_joints_with_a_pair_of_their_own_are_compensated() -> None:
    missing = left_out(Context.of(tn.load("needle-driver")))
    assert missing["compensated-step-load"] == missing["compensated-cycles"]
    assert "no joint of needle-driver" in missing["compensated-cycles"]
    assert {"compensated-step-load", "compensated-cycles"} <= chosen(Context.of(tn.load("hybrid-real-size"))).keys()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", [*SHIPPED, *ANY])
def test_the_statics_of_any_instrument_get_a_report(name: str) -> None:
    context, text = computed(sample(name), *STATICS)
    assert ">nan" not in text
    for joint in context.subject.joints:
        assert joint in text
        assert any(f".{joint}." in key or key.endswith(f".{joint}") for key in context.results)


@pytest.mark.parametrize("name", ["needle-driver", "two-segment-continuum", "hybrid-real-size"])
def test_losses_and_slack_are_those_of_the_statics(name: str) -> None:
    inst = tn.load(name)
    context, _ = computed(inst, "loss", "slack")
    bends = Bends.of(context.whole)
    for state, angles in zip(("straight", "bent"), statics.usual_states(inst), strict=True):
        for load in context.subject.loads:
            expected = statics.loss(inst, angles, load.wrench, load.grip)
            for joint, lost in zip(bends.names, bends.summed(expected.lost), strict=True):
                shown = context.results[f"loss.{joint}.{state}.{load.name}.{load.size:.3g}N"]
                assert shown.value == pytest.approx(np.degrees(lost), abs=1e-9)
            for joint, more in zip(context.subject.handles, expected.handle_corrections, strict=False):
                shown = context.results[f"loss.compensation_angle.{joint}.{state}.{load.name}.{load.size:.3g}N"]
                assert shown.value == pytest.approx(np.degrees(more), abs=1e-9, nan_ok=True)
            slack_from = expected.slack_factor * load.size
            found = context.results.get(f"slack.{state}.{load.name}")
            assert (found is None) == (not np.isfinite(slack_from))
            assert found is None or found.value == pytest.approx(slack_from, rel=1e-9)


@pytest.mark.parametrize("name", ["needle-driver", "two-segment-continuum", "hybrid-scaled-up"])
def test_matrices_are_the_rates_at_rest(name: str) -> None:
    inst = tn.load(name)
    context, _ = computed(inst, "stiffness", "transmissibility")
    whole, bends = context.whole, Bends.of(context.whole)
    for state in context.subject.states:
        rates = bends.rates(chain.rates(inst, state.handle, strokes=state.strokes))
        for i, joint in enumerate(bends.names):
            for j, other in enumerate(bends.names):
                shown = context.results[f"stiffness.{state.name}.{joint}.{other}"].value
                assert shown == pytest.approx(rates.stiffness[i, j], rel=1e-12)
            for j, tendon in enumerate(whole.tendons):
                shown = context.results[f"by_stroke.{state.name}.{joint}.{tendon.name}"].value
                assert shown == pytest.approx(1e-3 * np.degrees(rates.by_stroke[i, j]), abs=1e-12)
            for j, axis in enumerate("xyz"):
                shown = context.results[f"compliance.{state.name}.{joint}.{axis}"].value
                assert shown == pytest.approx(np.degrees(rates.by_wrench[i, j]), abs=1e-12)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "friction"), [("hybrid-real-size", True), ("needle-driver", False)])
def test_the_chapter_on_the_scale_model_of_several_joints_has_the_errors_of_their_comparison(
    name: str, friction: bool
) -> None:
    inst = tn.load(name)
    stiffer = inst.replace(tendon_stiffness=2e5, name="stiffer", pretension=25)
    context, text = computed(inst, "similarity", scaled=stiffer)
    pair = compare_joints(inst, stiffer)
    assert context.results["factors.tendon_stiffness"].value == pair.factors["tendon_stiffness"]
    for pretension, tensions in (("scaled", None), ("as_used", stiffer.pretensions)):
        error = pair.error(pretensions=tensions)
        key = f"similarity.{pretension}.without_friction"
        for joint, rms, largest in zip(error.joints, error.rms, error.largest, strict=True):
            assert context.results[f"{key}.{joint}.rms"].value == rms
            assert context.results[f"{key}.{joint}.largest"].value == largest
        assert context.results[f"{key}.tip.largest"].value == 1e3 * error.largest_at_tip
    assert ("with friction, at rest" in text) == friction
    assert "similarity" not in chosen(Context.of(inst))


@pytest.mark.parametrize("name", ["real-size", "scaled-up"])
def test_the_matrix_of_moments_is_eq_13_for_one_joint(name: str) -> None:
    inst = tn.load(name).axis("yaw")
    context, _ = computed(expanded(inst), "transmissibility")
    shown = context.results["transmissibility.straight.yaw.handle_yaw"].value
    assert shown == pytest.approx(tn.statics.torque_transmissibility(inst, 0.0), rel=1e-9)


@pytest.mark.parametrize("name", ["real-size", "scaled-up"])
def test_one_joint_in_either_form_moves_alike(name: str) -> None:
    plane = tn.load(name).axis("yaw")
    short, full = Subject.of(plane), Subject.of(expanded(plane))
    (motion,), shares = short.motions, np.linspace(0.0, 1.0, 11)
    (across,) = (load for load in full.loads if load.name == "x")
    for load in short.loads[0].all:
        same = across.times(load.size / across.size)
        assert short.way(motion, shares, load) == pytest.approx(full.way(motion, shares, same), abs=1e-12)


def test_loads_are_against_flexion_where_a_joint_feels_them() -> None:
    continuum = instrument.expanded("two-segment-continuum")
    assert {load.name for load in Subject(continuum).loads} == {"x", "z"}
    driver = instrument.expanded("needle-driver")
    assert {load.name for load in Subject(driver).loads} == {"x", "y", "grip"}
    given = driver.replace(conditions={"forces": [1.0, 2.0, 4.0]})
    force = next(load for load in Subject(given).loads if load.name == "x")
    assert (force.size, force.multiples) == (2.0, (0.5, 1.0, 2.0))


@pytest.mark.parametrize("name", [*SHIPPED, *ANY])
def test_motions_stay_within_all_ranges_and_turn_their_joint_most(name: str) -> None:
    inst = instrument.expanded(sample(name))
    found = Subject(inst).motions
    assert found
    for motion in found:
        turned = np.abs(motion.angles[-1] - motion.angles[0])
        assert motion.follows == np.argmax(turned)
        assert (np.abs(motion.angles) <= inst.bend_limits[:, 1] + 1e-5).all()


def test_friction_opens_the_loops_of_a_motion_and_nothing_else_does() -> None:
    rough = instrument.expanded("two-segment-continuum").replace(
        friction={"law": "capstan", "vertex_coefficient": 0.2, "sheath_coefficient": 0.1, "sheath_bend": 0.5}
    )
    widths = []
    for inst in (rough.replace(friction=None), rough):
        done = cycle(Subject(inst), Subject(inst).motions[0], None)
        assert done is not None
        widths.append(np.degrees(done.behind + done.ahead))
    assert widths[0] < 0.3
    assert widths[1] > 2 * widths[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["needle-driver", "hybrid-real-size"])
def test_the_report_is_written_with_its_recordings_and_what_is_left_out(name: str, tmp_path: Path) -> None:
    progress: list[str] = []
    inst = tn.load(name)
    context = run(inst, None, tmp_path, progress.append)
    assert len(progress) == steps(inst, None)
    names = json.loads((tmp_path / "results.json").read_text("utf-8"))
    assert names["chapters"] == [name for name in CHAPTERS if name in chosen(context)]
    html = (tmp_path / "report.html").read_text("utf-8")
    for chapter, reason in context.left_out.items():
        assert f"<li><b>{chapter}</b>: {reason.split(';')[0]}" in html
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    for target in re.findall(r'href="#([^"]+)"', html):
        assert target in ids
    recordings = {path.stem for path in (tmp_path / "recordings").iterdir()}
    assert recordings == set(context.recordings)
    assert any(stem.startswith("cycles_") for stem in recordings)
    if name == "hybrid-real-size":
        assert context.results["compensated.robust.worst"].value < 0.6
        for joint, load in (("yaw", "x"), ("pitch", "y")):
            off, robust = (
                abs(context.results[f"compensated.{law}.final_error.{joint}.{load}"].value) for law in ("off", "robust")
            )
            assert robust < off / 4

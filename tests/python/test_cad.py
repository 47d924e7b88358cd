"""Solid models: gears mesh, nothing collides, tendons and tip are where the model has them, files can be made from."""

import csv
import json
import math
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import cad, kinematics, plant
from tenodesis.cad import kernel, pack, picture
from tenodesis.cad.assembly import postures
from tenodesis.cad.backbone_parts import Backbone, section
from tenodesis.cad.gears import Gear
from tenodesis.cad.lever_parts import Lever
from tenodesis.cad.model import fitting, gear_of
from tenodesis.cad.parts import Sizes
from tenodesis.cad.wrist_parts import Wrist
from tenodesis.errors import InstrumentError, MissingExtraError
from tenodesis.instrument import Instrument, InstrumentLike
from tenodesis.tolerance.defaults import general_tolerance

from .conftest import Command, refused, tables

_COMMON = """
overall_length = "1000 mm"
proximal_pulley_radius = "18 mm"
handle_length = "160 mm"
tendon_diameter = "0.81 mm"
tendon_modulus = "50 GPa"
pretension = "60 N"
handle_range = "45 deg"
"""
PULLEY = f"""
name = "pulley"
joint_type = "tendon-pulley"
distal_pulley_radius = "8 mm"
end_effector_length = "80 mm"
{_COMMON}"""
CONTINUUM = f"""
name = "continuum"
joint_type = "continuum"
distal_tendon_offset = "8 mm"
backbone_length = "80 mm"
backbone_rigidity = "9000 N*mm^2"
end_effector_length = "60 mm"
{_COMMON}"""
ENDS = [math.radians(-80), 0.0, math.radians(80)]


def built(inst: InstrumentLike, **choices: Any) -> cad.Model:
    pytest.importorskip("build123d", reason="the extra [cad] is not installed")
    return cad.build(inst, **choices)


@pytest.fixture(scope="module")
def gears() -> cad.Model:
    return built("scaled-up", process="fdm", rig=False)


@pytest.fixture(scope="module")
def hybrid() -> cad.Model:
    return built("hybrid-scaled-up", process="fdm")


@pytest.fixture(scope="module", params=["needle-driver", "maryland-dissector"])
def wrist(request: pytest.FixtureRequest) -> cad.Model:
    return built(request.param, process="milled", rig=False)


@pytest.fixture(scope="module")
def pulley() -> cad.Model:
    return built(tn.parse(PULLEY), process="fdm")


@pytest.fixture(scope="module")
def segments() -> cad.Model:
    return built("two-segment-continuum", process="milled", rig=False)


@pytest.fixture(scope="module")
def continuum() -> cad.Model:
    return built(tn.parse(CONTINUUM), process="fdm", rig=False)


# What needs no kernel.


@pytest.mark.parametrize(("teeth", "undercut"), [(12, True), (18, True), (22, False), (40, False)])
def test_gears_of_fewer_than_22_teeth_are_undercut(teeth: int, undercut: bool) -> None:
    gear = Gear(1.0, teeth)
    base = gear.pitch_radius * math.cos(math.radians(20))
    spaces = gear.space(np.linspace(max(base, gear.root_radius) * 1.0001, gear.pitch_radius, 400))
    # An involute's space widens outward; an undercut space is wider below. A rack cuts so where its depth of 1.25
    # modules is more than half the teeth times the square of sin 20 deg.
    assert (np.diff(spaces) < 0).any() == undercut


def test_tooth_and_space_are_half_a_pitch_and_backlash_is_taken_from_the_teeth() -> None:
    pitch = 2 * math.pi / 27
    for backlash in (0.0, 0.15):
        gear = Gear(1.25, 27, backlash)
        space = 2 * float(gear.space(np.array([gear.pitch_radius]))[0])
        assert (space - pitch / 2) * gear.pitch_radius == pytest.approx(backlash / 2, abs=1e-12)


def test_module_and_teeth_are_the_coarsest_of_the_catalogue_that_give_the_radius() -> None:
    assert gear_of("distal_gear_radius", 7.5e-3) == (1.25e-3, 12)
    assert gear_of("proximal_gear_radius", 16.875e-3) == (1.25e-3, 27)


@pytest.mark.parametrize(
    ("changes", "choices", "says"),
    [
        (
            {"distal_gear_radius": "7.61 mm"},
            {},
            r"distal_gear_radius is 7.61 mm: no gear has that pitch radius; it must be half a module .* such as "
            r"7.6 mm \(module",
        ),
        (
            {},
            {"modules": {"distal": 1e-3 / 3}},
            r"module is 0.3333 mm: teeth of gears of distal_gear_radius are 0.449 mm thick .* at least 0.557 mm, or "
            "the process milled",
        ),
        (
            {"distal_gear_radius": "3 mm", "handle_range": "10 deg", "output_range": "107 deg"},
            {"modules": {"distal": 0.5e-3}, "process": "sla"},
            r"distal_gear_radius is 3 mm: with tunnels of 0.64 mm .* touch at 98 deg, before its stop at 117 deg; it "
            r"must be at least 5.56 mm",
        ),
        ({"stem_diameter": "15.5 mm"}, {}, r"stem_diameter is 15.5 mm: .* leave 0 mm for the tube's wall; .* 15.9 mm"),
        ({"end_effector_length": "10 mm"}, {}, r"end_effector_length is 10 mm: the far half .* at least 1\d.* mm"),
        ({"tendon_diameter": None, "tendon_stiffness": "11 N/mm"}, {}, "has no tendon_diameter"),
        ({}, {"process": "casting"}, "process is 'casting'; it must be one of fdm, sla, milled"),
    ],
)
def test_what_cannot_be_made_is_named_with_what_would_do(
    scaled: Instrument, changes: dict[str, Any], choices: dict[str, Any], says: str
) -> None:
    inst = scaled.replace(**changes)
    with pytest.raises(ValueError, match=says):
        cad.build(inst, **{"process": "fdm"} | choices)


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("joints.trigger.offset", 0.0, r"the fork of trigger take .* at least \d+.* process fdm"),
        ("joints.jaw.offset", 15e-3, r"the fork of jaw take .* at least"),
        ("joints.jaw.offset", 78e-3, r"leaves .* for the jaw that moves; it must be at most"),
        ("joints.jaw.stiffness", 5.0, r"is 5 N m/rad: no wire of .* two springs of it"),
        ("joints.pitch.offset", 8e-3, r"leave .* between them .* at least 9"),
        ("joints.pitch.radius", 7.61e-3, r"no gear has that pitch radius"),
        ("joints.pitch.axis", [1.0, 1.0, 0.0], "by quarter turns; it must be yaw or pitch"),
        ("joints.handle_pitch.end_effector_length", 80e-3, "before the grip"),
    ],
)
def test_what_cannot_be_made_of_several_joints_is_named_by_its_key(key: str, value: Any, says: str) -> None:
    with pytest.raises(InstrumentError, match=says) as found:
        cad.build(tn.load("hybrid-scaled-up").replace(**{key: value}), process="fdm")
    assert found.value.key == key


def test_joints_of_which_no_parts_are_made_are_refused() -> None:
    with pytest.raises(InstrumentError) as found:
        cad.build("hybrid-scaled-up", axis="yaw")
    assert found.value.key == "axis"


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"planes": 2}, "joints.far.planes"),
        ({"backbone_rigidity": 1e-3}, "joints.far.backbone_rigidity"),
        ({"offset": 2e-3}, "joints.far.offset"),
        ({"torsional_rigidity": 1e-3}, "joints.far.torsional_rigidity"),
        ({"axis": "pitch"}, "tendons.far_agonist.route"),
        ({"mechanism": "pulley", "backbone_length": None, "backbone_rigidity": None}, "joints.near.mechanism"),
        ({"radius": 1.5e-3}, "tendons.far_agonist.route"),
    ],
)
def test_backbones_of_which_no_parts_are_made_are_refused_by_the_keys_of_the_file(
    changes: dict[str, Any], key: str
) -> None:
    with pytest.raises(InstrumentError) as found:
        cad.build(_two_segments(**changes), process="milled")
    assert found.value.key == key


def _two_segments(**changes: Any) -> Instrument:
    """Return the two-segment continuum with keys of its far segment changed."""
    inst = tn.load("two-segment-continuum")
    near, far = tables(inst, "joints")
    far = {name: value for name, value in (far | changes).items() if value is not None}
    return inst.replace(joints=[near, far])


def _past_the_inner_segment() -> Instrument:
    inst = tn.load("two-segment-continuum")
    tendons = tables(inst, "tendons")
    tendons[2]["route"] = tendons[2]["route"][1:]
    return inst.replace(tendons=tendons)


def _turning_both_jaws() -> Instrument:
    inst = tn.load("needle-driver")
    tendons = tables(inst, "tendons")
    tendons[2]["route"] = [*tendons[2]["route"], {"joint": "jaw_2", "side": "antagonist", "radius": 1e-3}]
    return inst.replace(tendons=tendons)


@pytest.mark.parametrize(
    ("made", "process", "key", "value"),
    [
        (
            lambda: tn.parse(PULLEY).replace(distal_pulley_radius="1.5 mm", handle_range="5 deg"),
            "fdm", "distal_pulley_radius", 1.5,
        ),
        (lambda: tn.parse(CONTINUUM).replace(backbone_length="12 mm"), "fdm", "backbone_length", 12.0),
        (lambda: tn.load("two-segment-continuum"), "fdm", "tendon_diameter", 0.3),
        (_past_the_inner_segment, "milled", "tendons.far_agonist.route", "far"),
        (
            lambda: tn.load("needle-driver").replace(**{"joints.jaw_2.tied_to": "jaw_1"}),
            "milled", "joints.jaw_2.tied_to", "jaw_1",
        ),
        (_turning_both_jaws, "milled", "tendons.jaw_1_wound.route.radius", 1.0),
    ],
    ids=["no room for a pin", "discs touch", "no room for ferrules", "a segment skipped", "a snake", "both jaws"],
)  # fmt: skip
def test_what_has_no_room_or_no_part_is_refused_by_key_and_value(
    made: Callable[[], Instrument], process: str, key: str, value: Any
) -> None:
    with refused(key, value, kind=InstrumentError):
        cad.build(made(), process=process)


@pytest.mark.parametrize("name", ["needle-driver", "maryland-dissector"])
def test_a_wrist_that_cannot_be_printed_at_its_size_is_refused_with_a_process_and_a_scale_that_fit(name: str) -> None:
    inst = tn.load(name)
    with pytest.raises(InstrumentError, match=r"stem_diameter is 8 mm: .* or process milled, or all") as no:
        cad.build(inst, process="sla")
    assert no.value.key == "stem_diameter"
    factor = float(str(no.value).removesuffix(".").rpartition(" ")[2])
    assert _sized(_longer(inst, factor), "sla")
    with pytest.raises(InstrumentError):
        _sized(_longer(inst, factor - 0.25), "sla")


def _longer(inst: Instrument, factor: float) -> Instrument:
    """Return an instrument of pulleys with all its lengths times a factor."""
    longer = {"radius", "offset", "end_effector_length"}
    joints, tendons = tables(inst, "joints"), tables(inst, "tendons")
    for one in [*joints, *(crossing for tendon in tendons for crossing in tendon["route"])]:
        one.update({key: factor * value for key, value in one.items() if key in longer})
    own = {key: factor * getattr(inst, key) for key in ("stem_diameter", "tendon_diameter")}
    return inst.replace(joints=joints, tendons=tendons, **own)


def _sized(inst: Instrument, process: str) -> tuple[Any, ...]:
    """Return the sizes of a wrist and its jaws."""
    sizes = Sizes(cad.PROCESSES[process], 1e3 * float(inst.tendon_diameter or 0.0))
    return fitting(inst, inst.expanded, sizes)


def test_guide_wheels_of_a_scale_model_do_not_reach_each_others_pins() -> None:
    inst = _longer(tn.load("needle-driver"), 4.0).replace(tendon_diameter=0.75e-3)
    made = _sized(inst, "sla")[0]
    # Pins end at the rib on their own side of the pulley in the middle.
    assert made.ribs[0] > made.pulley.outside
    beside = [(one, other) for one in made.lanes for other in made.lanes if one.y * other.y > 0]
    apart = [math.dist(one.guide, other.guide) for one, other in beside]
    assert all(one == 0 or one > made.guide + 0.25 * 0.75 + made.guide_pin / 2 for one in apart)


@pytest.mark.parametrize(
    ("wheel", "jaw", "offset"),
    [
        # as ProGrasp forceps and clip appliers have them: half the pitch pulley's
        (1.2337e-3, 2.4343e-3, 10.7e-3),
        # as bowel graspers have them: jaws wider than the wrist
        (1.69725e-3, 3.39449e-3, 10.7e-3),
    ],
)
def test_small_wheels_have_guides_beside_the_pitch_pulley_and_tendons_get_to_wide_jaws(
    wheel: float, jaw: float, offset: float
) -> None:
    inst = tn.load("needle-driver")
    joints, tendons = tables(inst, "joints"), tables(inst, "tendons")
    for one in joints[1:]:
        one.update(radius=jaw, offset=offset)
    for tendon in tendons[2:]:
        tendon["route"][0]["radius"] = wheel
    made = _sized(inst.replace(joints=joints, tendons=tendons), "milled")[0]
    assert [side for _, side, _ in made.guide_pins] == [-1, 1]
    assert all(abs(lane.y) - 0.3 > made.ribs[1] - 1e-9 for lane in made.lanes)
    assert made.around(Sizes(cad.PROCESSES["milled"], 0.4)) < 4.0


@pytest.mark.parametrize(("name", "wrap"), [("needle-driver", 90.0), ("maryland-dissector", 90.0)])
def test_guide_wheels_give_tendons_the_wrap_of_the_file_and_leave_room_for_every_rope(name: str, wrap: float) -> None:
    inst = tn.load(name)
    made, *jaws = _sized(inst, "milled")
    assert isinstance(made, Wrist)
    assert (len(made.lanes), len(jaws)) == (4, 2)
    for lane in made.lanes:
        # On the inner common tangent of two wheels, r + g across it and t along it, the rope has the direction that it
        # winds from: that is the wrap.
        x, z = lane.way.side * lane.guide[0], lane.guide[1]
        across = lane.way.radius + made.guide
        along = math.sqrt(x * x + z * z - across**2)
        turn = math.atan2(across * -z - along * x, across * x - along * z)
        assert math.degrees(turn) == pytest.approx(wrap, abs=1e-9)
        assert math.hypot(x, z) > lane.way.radius + made.guide + made.pulley.play
    levels = sorted(abs(lane.y) for lane in made.lanes)
    assert levels[2] - levels[1] > 0.4
    assert levels[0] - 0.2 > made.pulley.outside


def test_a_tendon_of_an_imported_tool_without_a_wrap_gets_one_that_its_joints_range_does_not_unwind() -> None:
    inst = tn.load("needle-driver")
    tendons = tables(inst, "tendons")
    for tendon in tendons:
        for crossing in tendon["route"]:
            crossing.pop("base_wrap", None)
    made = _sized(inst.replace(tendons=tendons, sources={}), "milled")[0]
    assert {round(math.degrees(lane.way.wrap), 9) for lane in made.lanes} == {90.0}


def test_without_the_kernel_one_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "build123d", None)
    with refused("module", "build123d", kind=MissingExtraError):
        cad.build("scaled-up")


# What the solids say.


@pytest.mark.slow
def test_gears_mesh_and_nothing_collides_over_the_working_range(gears: cad.Model) -> None:
    assert cad.interference(gears, ENDS, [math.radians(45)]) == []
    joint = gears.joints[0]
    play = cad.mesh_play(gears, 0.0)
    # Teeth hold each other: half a backlash either way, and no further.
    assert play == pytest.approx([gears.process.backlash * 1e3 / (2 * joint.gear.pitch_radius)] * 2, rel=0.2)  # type: ignore[union-attr]


@pytest.mark.slow
def test_an_overlap_is_named_with_its_parts_and_angle(gears: cad.Model) -> None:
    beyond = math.radians(130)
    found = cad.interference(gears, [beyond])
    assert {"tip_gear_near", "tip_gear_far"} <= {name for one in found for name in one[:2]}
    assert all(one.output_angle == beyond and one.volume > 0 for one in found)


@pytest.mark.slow
def test_tendons_and_tip_of_gears_and_pulleys_are_where_the_model_has_them(gears: cad.Model, pulley: cad.Model) -> None:
    for model in (gears, pulley):
        found = cad.agreement(model)
        assert found.angles == 50
        assert found.excursion < 1e-6
        assert found.tip < 1e-9


@pytest.mark.slow
def test_tendons_and_tip_of_several_joints_are_where_the_model_has_them(hybrid: cad.Model) -> None:
    found = cad.agreement(hybrid)
    assert found.angles == 50
    assert found.excursion < 1e-9
    assert found.tip < 1e-9


@pytest.mark.slow
def test_each_tendon_of_several_joints_changes_length_with_its_own_joints_alone(hybrid: cad.Model) -> None:
    yaw, pitch, jaw = np.radians((50.0, -70.0, -20.0))
    handle_yaw, handle_pitch, trigger = np.radians((30.0, 40.0, 15.0))
    straight = cad.tendon_lengths(hybrid, np.zeros(3), np.zeros(3))
    bent = cad.tendon_lengths(hybrid, [yaw, pitch, jaw], [handle_yaw, handle_pitch, trigger])
    # A gear pair's span is 2 r (1 -+ sin of half its angle); a pulley winds its radius times its angle.
    pairs = [
        2 * 16.875e-3 * math.sin(handle / 2) - 2 * 7.5e-3 * math.sin(angle / 2)
        for handle, angle in ((handle_yaw, yaw), (handle_pitch, pitch))
    ]
    grip = 7.5e-3 * trigger + 5.625e-3 * jaw
    assert bent - straight == pytest.approx([pairs[0], -pairs[0], pairs[1], -pairs[1], grip], abs=1e-12)


@pytest.mark.slow
def test_nothing_of_several_joints_collides_with_all_of_them_bent_to_their_ends(hybrid: cad.Model) -> None:
    assert cad.interference(hybrid, ENDS[2:], [math.radians(45)]) == []


@pytest.mark.slow
def test_tendons_of_a_wrist_change_length_by_the_radii_of_the_file_and_both_jaws_are_where_the_model_has_them(
    wrist: cad.Model,
) -> None:
    arms = wrist.instrument.expanded.tendon_arms("tip")
    ranges = [one.joint.range for one in wrist.stations]
    angles = np.random.default_rng(7).uniform(-1.0, 1.0, (40, 3)) * ranges
    straight = cad.tendon_lengths(wrist, np.zeros(3), np.zeros(0))
    changes = cad.tendon_lengths(wrist, angles, np.zeros(0)) - straight
    assert np.abs(changes + angles @ arms.T).max() < 1e-15
    found = cad.agreement(wrist)
    assert found.angles == 50
    assert found.excursion < 1e-15
    assert found.tip < 1e-15


@pytest.mark.slow
def test_nothing_of_a_wrist_collides_over_its_range_and_its_jaws_do_not_pass_each_other(wrist: cad.Model) -> None:
    ends = [0.0, *(share * wrist.stations[0].joint.range for share in (-1.0, -0.5, 0.5, 1.0))]
    assert cad.interference(wrist, ends) == []
    every = postures(wrist, ends)
    assert all(one.tip[1] >= one.tip[2] for one in every)
    most = np.max([np.abs(one.tip) for one in every], axis=0)
    assert most == pytest.approx([one.joint.range for one in wrist.stations])


@pytest.mark.slow
def test_a_wrist_is_written_with_a_closed_mesh_of_every_part_and_masses_of_its_links(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pack, "_STEPS", 1)
    monkeypatch.setattr(picture, "_FINE", 1)
    model = built("needle-driver", process="milled")
    checks = cad.write(model, tmp_path)
    names = {one.part for one in checks.printable}
    assert names >= {"pitch_fork", "pitch_body", "pitch_wheel", "pitch_guide", "jaw_1_jaw", "jaw_2_jaw", "stem_base"}
    assert all(one.watertight for one in checks.printable)
    assert [len(model.part(name).places) for name in ("pitch_wheel", "pitch_guide", "spool")] == [4, 4, 6]
    masses = [joint.mass for joint in tn.load(tmp_path / "instrument.toml").expanded.tip_joints]
    assert masses == pytest.approx([cad.inertias(model)[one.end.far].mass for one in model.stations], rel=1e-6)


@pytest.mark.slow
def test_the_bench_has_a_drive_for_every_tendon_and_the_instrument_gets_the_masses_of_its_links(
    hybrid: cad.Model,
) -> None:
    assert [len(hybrid.part(name).places) for name in ("spool", "motor_mount", "load_cell_mount")] == [5, 5, 5]
    bodies, inst = cad.inertias(hybrid), cad.with_inertia(hybrid)
    masses = {joint.name: joint.mass for joint in inst.expanded.tip_joints}
    assert masses == pytest.approx({name: bodies[f"{name}_far"].mass for name in ("yaw", "pitch", "jaw")})
    run = tn.twin.Twin(inst).run(np.zeros((50, 3)))
    assert np.isfinite(run.measured_output_angle).all()


@pytest.mark.slow
def test_the_springs_of_a_jaw_have_its_stiffness(hybrid: cad.Model) -> None:
    lever = next(one.sizes for one in hybrid.stations if one.joint.name == "jaw")
    assert isinstance(lever, Lever)
    assert lever.spring is not None
    wire, diameter, coils = lever.spring
    # A wire as long as its coils bends by moment x length / (E I); two springs side by side.
    length, rigidity = coils * math.pi * diameter * 1e-3, 206e9 * math.pi * (wire * 1e-3) ** 4 / 64
    assert 2 * rigidity / length == pytest.approx(2e-2, rel=1e-9)


@pytest.mark.slow
def test_tendons_between_discs_differ_from_the_arcs_of_the_model_by_less_than_a_micrometre(
    continuum: cad.Model,
) -> None:
    found = cad.agreement(continuum)
    joint = continuum.joints[0]
    # What is left: radius times (angle)^3 over 24 and the square of the number of spans.
    left = 8e-3 * ENDS[-1] ** 3 / (24 * joint.spans**2)  # type: ignore[union-attr]
    assert 0.5 * left < found.excursion < 1e-6
    assert found.tip < 1e-9
    assert cad.interference(continuum, ENDS[1:]) == []


def _between_discs(size: Backbone, spans: int, beside: float, angle: float) -> float:
    """Return the length, mm, of a tendon over spans of discs that bend by an angle in all, straight between them."""
    turn, bend = angle / spans, spans * size.pitch / angle
    length, last = 0.0, None
    for number in range(spans + 1):
        # Faces of the inner segment's last disc, of discs and the plate, about the centre of the bend.
        along = np.array([math.cos(number * turn), math.sin(number * turn)])
        for side in (-1, 1)[number == 0 :] if number < spans else (0,):
            point = (beside - bend) * along + side * size.disc / 2 * np.array([along[1], -along[0]])
            length += 0.0 if last is None else float(np.linalg.norm(point - last))
            last = point
    return length


@pytest.mark.slow
def test_tendons_of_an_outer_segment_pass_through_the_inner_one_and_have_the_lengths_of_their_ways(
    segments: cad.Model,
) -> None:
    full, size = segments.instrument.expanded, segments.joints[0]
    assert isinstance(size, Backbone)
    angle, names = math.radians(50), [tendon.name for tendon in full.tendons]
    straight = cad.tendon_lengths(segments, 0.0)
    near, far, both = (
        cad.tendon_lengths(segments, full.bent(np.radians(row))) - straight for row in ([50, 0], [0, 50], [50, 50])
    )
    # The near segment's own tendons end half a disc before those of its arcs.
    spans = 4 * size.spans
    for name, side in (("far_agonist", 1), ("far_antagonist", -1)):
        number = names.index(name)
        own = _between_discs(size, spans, side * 1.8, angle) - (spans * size.pitch - size.disc / 2)
        assert 1e3 * far[number] == pytest.approx(own, abs=1e-9)
        assert near[number] == pytest.approx(-side * 1.8e-3 * angle, abs=1e-6)
        assert both[number] == pytest.approx(near[number] + far[number], abs=1e-9)
    for name, side in (("near_agonist", 1), ("near_antagonist", -1)):
        number = names.index(name)
        assert near[number] == pytest.approx(-side * 1.8e-3 * angle, abs=1e-6)
        assert far[number] == pytest.approx(0.0, abs=1e-15)


@pytest.mark.slow
def test_segments_agree_with_the_model_and_nothing_collides_with_both_bent_to_their_ends(segments: cad.Model) -> None:
    found = cad.agreement(segments)
    # What is left of both: radius times (angle)^3 over 24 and the square of the number of spans.
    assert found.excursion < 2 * 1.8e-3 * math.radians(60) ** 3 / (24 * 12**2)
    assert found.tip < 1e-9
    ends = [math.radians(-60), math.radians(60)]
    rows = [row.tip for row in postures(segments, ends)]
    assert len(rows) == 8
    assert any(np.allclose(row, np.radians([15] * 4 + [-15] * 4)) for row in rows)
    assert cad.interference(segments, ends) == []


@pytest.mark.slow
def test_tendons_of_a_segment_across_pass_the_inner_one_beside_a_round_rod_and_change_length_with_their_own_alone() -> (
    None
):
    inst = _two_segments(axis="pitch")
    tendons = tables(inst, "tendons")
    for tendon in tendons[2:]:
        tendon["route"] = [{"joint": "near", "side": "middle"}, *tendon["route"][1:]]
    made = built(inst.replace(tendons=tendons), process="milled", rig=False)
    size = made.joints[0]
    assert isinstance(size, Backbone)
    assert size.rod.wide == 0
    full = made.instrument.expanded
    bent = cad.tendon_lengths(made, full.bent(np.radians([50, 0]))) - cad.tendon_lengths(made, 0.0)
    assert bent[:2] == pytest.approx(np.array([-1.8e-3, 1.8e-3]) * math.radians(50), abs=1e-6)
    # In the middle of the bend, spans between discs of a third of the pitch keep their lengths to the second order; the
    # first, from the socket's face, does not.
    pitch, disc, turn = size.pitch, size.disc, math.radians(50) / (4 * size.spans)
    first = turn**2 * (disc / 16 + disc**2 / (32 * (pitch - disc / 2)) - pitch / 24)
    assert 1e3 * bent[2:] == pytest.approx(first, rel=5e-3)
    assert cad.agreement(made).excursion < 1e-6
    assert cad.interference(made, [math.radians(-60), math.radians(60)]) == []


def test_a_strip_has_the_rigidity_of_the_file_and_is_nine_times_as_stiff_to_the_side() -> None:
    made = section(1.2e-3, strip=True)
    rigidity = 60e9 * 1e-12 / 12 * made.thick**3 * made.wide
    assert rigidity == pytest.approx(1.2e-3, rel=1e-12)
    assert made.wide**2 / made.thick**2 == pytest.approx(9.0)
    assert 60e9 * math.pi / 64 * (1e-3 * section(1.2e-3, strip=False).thick) ** 4 == pytest.approx(1.2e-3, rel=1e-12)


@pytest.mark.slow
def test_discs_have_the_volume_of_their_holes_less_than_a_cylinder(segments: cad.Model) -> None:
    size, tunnel = segments.joints[0], 0.34
    assert isinstance(size, Backbone)
    hole, pocket = math.pi * tunnel**2 / 4, math.pi * (1.25 * 0.3 + 0.02) ** 2
    slot = (size.rod.thick + 0.04) * (size.rod.wide + 0.04)
    for name, holes, pockets in (("near_disc", 4, 0), ("far_disc", 2, 0), ("near_end", 4, 2)):
        part = segments.part(name)
        outer = next(one for one in part.dimensions if one.name == "outer diameter").value / 2
        deep = size.disc - 0.15
        solid = (math.pi * outer**2 - slot - holes * hole) * size.disc - pockets * (pocket - hole) * deep
        assert kernel.volume(part.solid) == pytest.approx(solid, rel=1e-6)


@pytest.mark.slow
def test_segments_are_written_with_closed_meshes_and_masses_of_their_links(segments: cad.Model, tmp_path: Path) -> None:
    found = cad.write(segments, tmp_path / "pack")
    assert all(one.watertight for one in found.printable)
    weighed = {one.part: one.mass for one in cad.masses(segments)}
    inst = tn.load(tmp_path / "pack" / "instrument.toml")
    near, far = (joint.mass for joint in inst.as_given("joints"))
    assert near == pytest.approx(weighed["near_disc"] + weighed["near_end"], rel=1e-3)
    assert far == pytest.approx(weighed["far_disc"] + weighed["tip_plate"] + weighed["end_effector"], rel=1e-3)


@pytest.mark.slow
def test_the_tips_inertia_is_its_kinetic_energy(gears: cad.Model) -> None:
    rate = 1e-3
    energy = 0.0
    two = zip(cad.assembled(gears, -rate, 0.0), cad.assembled(gears, rate, 0.0), strict=True)
    for before, after in two:
        if before.part.body not in ("yaw_carrier", "yaw_far"):
            continue
        mass = before.part.density * before.solid.volume * 1e-9
        moved = np.subtract([*after.solid.center()], [*before.solid.center()]) * 1e-3
        share = 0.5 if before.part.body == "yaw_carrier" else 1.0
        own = before.part.density * np.array(before.solid.matrix_of_inertia)[1, 1] * 1e-15
        energy += mass * float(moved @ moved) / (2 * rate) ** 2 + own * share**2
    assert cad.tip_inertia(gears) == pytest.approx(energy, rel=1e-4)


@pytest.fixture(scope="module")
def folder(pulley: cad.Model, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pack, "_STEPS", 1)
        patch.setattr(picture, "_FINE", 1)
        out = tmp_path_factory.mktemp("pack")
        cad.write(pulley, out, {"distal_pulley_radius": 0.02e-3})
        yield out


@pytest.mark.slow
def test_a_pack_has_a_step_of_every_part_and_a_closed_mesh_of_every_part_to_make(
    pulley: cad.Model, folder: Path
) -> None:
    assert {path.name for path in folder.iterdir()} == {*cad.FILES, *cad.FOLDERS}
    assert {path.stem for path in (folder / "step").iterdir()} == {part.name for part in pulley.parts}
    made = {part.name for part in pulley.parts if part.made}
    assert {path.stem for path in (folder / "stl").iterdir()} == made
    found = json.loads((folder / "geometry.json").read_text("utf-8"))
    assert {one["part"] for one in found["meshes"]} == made
    assert all(one["watertight"] and abs(one["volume_error"]) < 5e-3 for one in found["meshes"])
    assert min(one["least_wall"] for one in found["meshes"]) > 0.98 * pulley.process.wall
    assert found["overlaps"] == []
    assert (folder / "assembly.glb").read_bytes().startswith(b"glTF")
    assert len(re.findall(rb"/Type /Page\b", (folder / "drawings.pdf").read_bytes())) == len(made)
    rows = list(csv.DictReader((folder / "parts.csv").open(encoding="utf-8")))
    assert [row["part"] for row in rows] == [part.name for part in pulley.parts]


@pytest.mark.slow
def test_urdf_has_the_inertias_of_the_solids(pulley: cad.Model, folder: Path) -> None:
    bodies = cad.inertias(pulley)
    root = ElementTree.parse(folder / "instrument.urdf").getroot()
    weighed = {str(link.get("name")): link.find("inertial/mass") for link in root.iter("link")}
    masses = {name: float(mass.get("value", "")) for name, mass in weighed.items() if mass is not None}
    assert masses["yaw_far"] == pytest.approx(bodies["yaw_far"].mass)
    assert masses["stem"] == pytest.approx(bodies["stem"].mass)
    assert masses["tip"] < 1e-5


@pytest.mark.slow
def test_the_instrument_file_of_a_pack_has_the_solids_inertia_and_is_what_the_twin_takes(
    pulley: cad.Model, folder: Path
) -> None:
    inst = tn.load(folder / "instrument.toml")
    assert plant.parameters(inst)["tip_inertia"] == pytest.approx(cad.tip_inertia(pulley), rel=1e-8)
    assert "process fdm" in inst.sources["dynamics.tip_inertia"]
    # Nothing but the inertia has changed.
    own, given = (one.replace(dynamics=None, sources={}) for one in (inst, pulley.given))
    assert own == given


@pytest.mark.slow
def test_a_tip_too_light_for_the_twins_steps_gets_the_least_that_they_follow(pulley: cad.Model) -> None:
    stiff = replace(pulley, given=pulley.given.replace(tendon_modulus=None, tendon_stiffness=1e9))
    inst = cad.with_inertia(stiff)
    assert plant.parameters(inst)["tip_inertia"] == pytest.approx(plant.least_tip_inertia(inst))
    assert plant.least_tip_inertia(inst) > cad.tip_inertia(pulley)


@pytest.mark.slow
def test_the_gltf_of_a_pack_has_a_node_for_each_body_at_the_size_of_the_instrument(
    pulley: cad.Model, folder: Path
) -> None:
    import trimesh

    scene: Any = trimesh.load(folder / cad.ASSEMBLY)
    parents = scene.graph.transforms.parents
    assert scene.metadata["tenodesis"]["stem_length"] == pytest.approx(
        kinematics.dimensions(pulley.instrument).stem_length
    )
    for one in pulley.parts:
        name = one.name if len(one.places) == 1 else f"{one.name}_1"
        assert parents[name] == f"body {one.body}"
    eye = scene.geometry["end_effector"].bounds[1][2]
    assert eye == pytest.approx(pulley.instrument.end_effector_length, abs=4e-3)


@pytest.mark.slow
def test_a_mesh_that_the_kernel_leaves_a_face_out_of_is_made_finer(monkeypatch: pytest.MonkeyPatch) -> None:
    b = pytest.importorskip("build123d", reason="the extra [cad] is not installed")
    box = b.Box(1, 2, 3)
    own, turns = type(box).tessellate, []

    def lacking(solid: Any, chord: float, turn: float) -> Any:
        turns.append(turn)
        if turn > 0.25:
            raise AttributeError("no triangulation")
        return own(solid, chord, turn)

    monkeypatch.setattr(type(box), "tessellate", lacking)
    assert len(kernel.meshed(box, 0.1, 0.4).faces) == 12
    assert turns == pytest.approx([0.4, 0.28, 0.2])


@pytest.mark.slow
def test_a_pack_is_written_whole_or_not_at_all(
    pulley: cad.Model, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> None:
        raise OSError("no space")

    monkeypatch.setattr(pack, "check", lambda *_: None)
    monkeypatch.setattr(pack, "_write_step", fails)
    with pytest.raises(OSError, match="no space"):
        cad.write(pulley, tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_pulley_of_an_instruments_size_is_drawn_and_its_step_file_has_its_volume(tmp_path: Path) -> None:
    small = {"distal_pulley_radius": 2.5e-3, "proximal_pulley_radius": 5e-3, "tendon_diameter": 0.5e-3}
    lengths = {"end_effector_length": 14e-3, "overall_length": 0.45, "handle_length": 95e-3, "stem_diameter": 8e-3}
    model = built(tn.parse(PULLEY).replace(**small, **lengths), process="milled", rig=False)
    for name in ("tip_pulley", "handle_pulley"):
        part = model.part(name)
        pack._write_step(part.solid, tmp_path / f"{name}.step", name)
        assert cad.draw_part(model, part).axes


@pytest.mark.slow
def test_clamps_of_the_bench_stand_on_the_stem_behind_a_long_backbone() -> None:
    inst = tn.parse(CONTINUUM).replace(backbone_length=150e-3, overall_length=1.5)
    clamps = built(inst, process="fdm").part("rig_clamp")
    assert all(place.position.Z + kernel.bounds(clamps.solid)[1][2] < 0 for place in clamps.places)


@pytest.mark.slow
def test_drawings_say_radii_to_the_ropes_centre_and_to_the_grooves_bottom_with_their_tolerances(
    pulley: cad.Model,
) -> None:
    table = {row.name: row for row in cad.rows(pulley.part("tip_pulley"), {"distal_pulley_radius": 0.02e-3})}
    centre, bottom = table["radius to the rope's centre"], table["radius to the groove's bottom"]
    assert (centre.nominal, bottom.nominal) == pytest.approx((8.0, 8.0 - 0.81 / 2))
    assert (centre.tolerance, bottom.tolerance, centre.own) == (0.02, 0.02, True)
    assert table["rim"].tolerance == general_tolerance(table["rim"].nominal * 1e-3, "m")
    assert not table["rim"].own


def test_the_command_says_what_to_install_before_it_writes_anything(
    tenodesis: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "build123d", None)
    for words in (("cad", "scaled-up"), ("scale", "real-size", "--cad", "solids")):
        code, _, wrong = tenodesis(*words)
        assert code == 1
        assert "pip install 'tenodesis[cad]'" in wrong
    assert list(tmp_path.iterdir()) == []

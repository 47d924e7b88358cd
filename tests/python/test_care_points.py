"""Each place where the paper needs care (docs/model.md), with its number."""

import numpy as np
import pytest
from peers import mujoco_peer

import tenodesis as tn
from tenodesis.instrument import TendonGear
from tenodesis.paper.published import STATES
from tenodesis.statics.stroke import settled_stroke, wound


@pytest.mark.care(1)
@pytest.mark.equation(22)
def test_eq_22_with_one_motor_leaves_exactly_half_the_loss(scaled: TendonGear) -> None:
    inst = scaled
    handle, force = tn.statics.handle_angle(inst, np.radians([0.0, 33, 67, 80])), 1.5
    free = np.sin(tn.statics.output_angle(inst, handle) / 2)
    shift = 4 * inst.tendon_stiffness * inst.distal_gear_radius
    for actuation, law, share in (
        ("agonist", "paper", 0.5),
        ("agonist", "exact", 0.0),
        ("differential", "paper", 0.0),
        ("differential", "exact", 0.0),
    ):
        stroke = settled_stroke(inst, handle, force, actuation, law)
        state = tn.statics.equilibrium(inst, handle, force, wound=wound(stroke, actuation))
        asked = (state.agonist - state.antagonist) / shift
        left = free - np.sin(state.output_angle / 2)
        assert left / asked == pytest.approx(share, abs=1e-9)


@pytest.mark.care(2)
@pytest.mark.equation(19)
def test_eq_19_holds_without_slack_and_only_the_slack_aware_estimate_with_it(real: TendonGear) -> None:
    inst, handle = real, 0.55
    for force, slack in ((0.8, False), (2.5, True)):
        state = tn.statics.equilibrium(inst, handle, force)
        assert (state.antagonist == 0) is slack
        ratio = inst.proximal_gear_radius / inst.distal_gear_radius
        share = (state.agonist - state.antagonist) / (4 * inst.tendon_stiffness * inst.distal_gear_radius)
        printed = 2 * np.arcsin(ratio * np.sin(handle / 2) - share)
        aware = tn.statics.estimate_output_angle(inst, handle, state.agonist, state.antagonist)
        assert aware == pytest.approx(state.output_angle, abs=1e-12)
        assert (abs(printed - state.output_angle) > np.radians(3)) == slack
        if not slack:
            assert printed == pytest.approx(state.output_angle, abs=1e-12)


@pytest.mark.care(2)
def test_a_slack_tendon_with_a_noisy_load_cell_still_counts_as_slack(real: TendonGear) -> None:
    state = tn.statics.equilibrium(real, 0.55, 2.5)
    noisy = tn.statics.estimate_output_angle(real, 0.55, state.agonist, 0.3, slack_below=1.0)
    assert noisy == pytest.approx(state.output_angle, abs=1e-12)


@pytest.mark.care(2)
@pytest.mark.equation(22)
def test_the_exact_law_gives_everything_back_even_where_the_antagonist_goes_slack(real: TendonGear) -> None:
    handle = np.array([0.0, 0.3, 0.5])
    force = 1.15 * float(tn.statics.slack_force(real, 0.0))
    for actuation in ("agonist", "differential"):
        stroke = settled_stroke(real, handle, force, actuation, "exact")
        state = tn.statics.equilibrium(real, handle, force, wound=wound(stroke, actuation))
        assert state.output_angle == pytest.approx(tn.statics.output_angle(real, handle), abs=1e-9)
        assert ((state.antagonist == 0) == (actuation == "differential")).all()
    stroke = settled_stroke(real, handle, force, "differential", "paper")
    left = tn.statics.output_angle(real, handle) - tn.statics.output_angle(real, handle, force, wound=(stroke, -stroke))
    assert np.degrees(left).min() > 1


@pytest.mark.care(3)
@pytest.mark.equation(19)
def test_the_estimate_needs_to_know_what_the_motors_have_wound(real: TendonGear) -> None:
    strokes = (4e-4, -1e-4)
    state = tn.statics.equilibrium(real, 0.3, 0.8, wound=strokes)
    pulls = state.agonist, state.antagonist
    aware = tn.statics.estimate_output_angle(real, 0.3, *pulls, wound=strokes)
    blind = tn.statics.estimate_output_angle(real, 0.3, *pulls)
    assert aware == pytest.approx(state.output_angle, abs=1e-12)
    shift = (strokes[0] - strokes[1]) / (4 * real.distal_gear_radius)
    assert np.sin(aware / 2) - np.sin(blind / 2) == pytest.approx(shift, abs=1e-12)


@pytest.mark.care(4)
def test_similarity_is_exact_at_one_angle_only(real: TendonGear, scaled: TendonGear) -> None:
    comparison = tn.similarity.compare(real, scaled)
    factors = comparison.force_factor(np.radians([0.0, 40, 80]))
    assert factors == pytest.approx([2.873, 2.880, 2.902], abs=5e-4)
    matches = {group.name: group.matches for group in comparison.groups}
    assert matches["R/r"]
    assert not matches["l_d/r"]


@pytest.mark.care(5)
def test_pretension_must_scale_or_slack_begins_too_early(real: TendonGear, scaled: TendonGear) -> None:
    comparison = tn.similarity.compare(real, scaled)
    similar = real.pretension * comparison.tension_factor
    assert similar == pytest.approx(41.3, abs=0.05)
    factor = comparison.force_factor(0.0)
    onset = [tn.statics.slack_force(scaled.replace(pretension=tension), 0.0) / factor for tension in (similar, 25.0)]
    meant = tn.statics.slack_force(real, 0.0)
    assert abs(onset[0] / meant - 1) < 0.005
    assert onset[1] / meant < 0.65
    assert comparison.errors["as used"].rms > 10 * comparison.errors["scaled"].rms


@pytest.mark.care(6)
@pytest.mark.equation(18)
def test_the_pairs_of_fig_15_contradict_eq_18(scaled: TendonGear) -> None:
    handle = np.radians([handle.value for handle, _ in STATES])
    output = np.radians([output.value for _, output in STATES])
    follows = np.degrees(tn.statics.output_angle(scaled, handle))
    assert follows == pytest.approx([0, 22.6, 46.0, 60.8], abs=0.05)
    assert np.degrees(tn.statics.handle_angle(scaled, output))[3] == pytest.approx(33.2, abs=0.05)


@pytest.mark.care(7)
def test_ten_newton_on_the_cable_are_half_a_newton_on_the_real_instrument(real: TendonGear, scaled: TendonGear) -> None:
    rig = scaled.conditions
    assert rig.cable_force is not None
    assert rig.cable_pulley_radius is not None
    moment = rig.cable_force * rig.cable_pulley_radius
    assert moment == pytest.approx(rig.external_moment)
    tip = moment / (scaled.end_effector_length + 2 * scaled.distal_gear_radius)
    assert tip == pytest.approx(1.5, abs=0.02)
    assert 1.5 / tn.similarity.compare(real, scaled).force_factor() == pytest.approx(0.52, abs=0.002)


@pytest.mark.care(8)
def test_stiffnesses_of_table_1_follow_from_e_a_over_l(real: TendonGear, scaled: TendonGear) -> None:
    assert real.given_stiffness is None
    assert scaled.given_stiffness is None
    assert real.tendon_stiffness == pytest.approx(31172, abs=0.5)
    assert scaled.tendon_stiffness == pytest.approx(11451, abs=0.5)
    assert real.replace(overall_length=1.0).tendon_stiffness == pytest.approx(real.tendon_stiffness / 2)
    assert real.replace(tendon_length="1 m").tendon_stiffness == pytest.approx(real.tendon_stiffness / 2)


@pytest.mark.care(9)
@pytest.mark.equation(1)
def test_mujoco_says_that_the_radial_term_of_eq_1_is_a_tangent(real: TendonGear, scaled: TendonGear) -> None:
    for inst in (real, scaled):
        for unloaded, radial in ((60.0, -10.0), (70.0, 10.0)):
            handle, force = float(tn.statics.handle_angle(inst, np.radians(unloaded))), 0.2
            settled = mujoco_peer.settle(inst, handle, force, radial)
            half = settled.output_angle / 2
            coefficient = mujoco_peer.radial_coefficient(inst, settled, force, radial)
            assert coefficient == pytest.approx(np.tan(half), abs=1e-5)
            assert abs(coefficient - np.sin(half)) > 0.05
            ours = tn.statics.output_angle(inst, handle, force, radial_force=radial)
            assert np.degrees(abs(ours - settled.output_angle)) < 1e-3

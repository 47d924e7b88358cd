"""Claims about similarity against Tables I and II and against instruments that are similar by construction."""

from typing import get_args

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument, TendonGear, TendonPulley
from tenodesis.paper.published import SCALE_FACTORS
from tenodesis.plant import natural_frequency

from .similar import FRICTION, geometrically_scaled


def test_factors_of_tables_1_and_2_come_out_as_printed(real: TendonGear, scaled: TendonGear) -> None:
    factors = tn.similarity.compare(real, scaled).factors
    for key, printed in SCALE_FACTORS.items():
        if key != "loss_of_dexterity":
            # Printed with three or four digits, the last one cut off rather than rounded in places.
            assert factors[key] == pytest.approx(printed.value, rel=2.6e-3), key
    assert factors["flexural_stiffness"] == pytest.approx(3.75**2 * 0.857142857**2 / 2, rel=1e-8)


def test_loss_of_dexterity_is_equal_at_the_angle_the_factor_is_made_for(real: TendonGear, scaled: TendonGear) -> None:
    comparison = tn.similarity.compare(real, scaled)
    for angle in np.radians([0.0, 40, 80]):
        factor = comparison.force_factor(angle)
        ours = tn.statics.loss_of_dexterity(scaled, angle, factor)
        assert ours == pytest.approx(tn.statics.loss_of_dexterity(real, angle, 1.0), rel=1e-14)


def test_error_over_the_working_range_is_small_only_with_scaled_pretension(
    real: TendonGear, scaled: TendonGear
) -> None:
    errors = tn.similarity.compare(real, scaled).errors
    assert errors["scaled"].scaled_up_pretension == pytest.approx(41.33, abs=0.01)
    assert errors["as used"].scaled_up_pretension == 25
    tested = tn.similarity.compare(real, scaled).error(pretension=25.0, largest_force=0.52)
    assert tested.force.max() == 0.52
    assert tested.largest < 0.15
    assert tested.unsolved == 0
    assert errors["scaled"].rms < 0.35
    assert errors["as used"].rms > 7
    span = np.degrees(tn.statics.output_angle(real, errors["scaled"].handle_angle[[0, -1]]))
    assert span == pytest.approx([-80, 80], abs=1e-6)
    assert errors["scaled"].force[[0, -1]].tolist() == [0, 3]
    handle, force = errors["as used"].worst
    ours = tn.statics.output_angle(scaled, handle, force * errors["as used"].force_factor)
    theirs = tn.statics.output_angle(real, handle, force)
    assert abs(np.degrees(ours - theirs)) == pytest.approx(errors["as used"].largest, rel=1e-9)


@pytest.mark.parametrize("hand", [0.0, 20.0])
def test_a_geometrically_scaled_instrument_is_similar_in_every_group_and_everywhere(
    any_inst: Instrument, hand: float
) -> None:
    """Every length times s, the same modulus: forces scale with s squared and all angles agree, folds included."""
    s = 2.5
    inst = any_inst.replace(**FRICTION, **{"dynamics.hand_stiffness": hand, "drives.backlash": 0.01})
    comparison = tn.similarity.compare(inst, geometrically_scaled(inst, s))
    assert [group.name for group in comparison.groups if not group.matches] == []
    assert ("K_h/(k R^2)" in {group.name for group in comparison.groups}) == bool(hand)
    assert comparison.force_factor() == pytest.approx(s**2, rel=1e-12)
    expected = {
        "length": s,
        "force": s**2,
        "tension": s**2,
        "torque": s**3,
        "handle_torque": s**3,
        "motor_stroke": s,
        "spool_angle": 1,
        "spool_velocity": 1 / s,
        "time": s,
    }
    for key, factor in expected.items():
        assert comparison.factors[key] == pytest.approx(factor, rel=1e-12), key
    assert comparison.errors["scaled"].largest < 1e-6
    assert comparison.errors["as used"].largest < 1e-6
    assert comparison.errors["scaled"].held_by_one == 0


def test_groups_show_what_the_papers_scale_model_keeps(real: Instrument, scaled: Instrument) -> None:
    comparison = tn.similarity.compare(real, scaled)
    groups = {group.name: group for group in comparison.groups}
    kept = {"R/r", "theta_stop", "Theta", "mu", "mu_s", "phi_s", "J/(kappa t^2)"}
    lost = {"l_d/r", "F/(kr)", "T_o/(kr)", "F_slack/F", "l_p/R", "handle share", "stem share", "v_m t/r", "zeta"}
    assert {name for name in kept | lost if groups[name].matches} == kept
    assert groups["l_d/r"].real_size == pytest.approx(25)
    assert groups["l_d/r"].scaled_up == pytest.approx(86 / 7.5)
    assert groups["T_o/(kr)"].ratio == pytest.approx(25 / 41.3265, rel=1e-5)
    shares = [group for group in comparison.groups if group.name.endswith("share")]
    assert sum(group.real_size for group in shares) == pytest.approx(1)
    assert {group.kind for group in groups.values()} == set(get_args(tn.similarity.Kind))
    assert all(group.meaning and "\n" not in group.meaning for group in groups.values())


def test_only_the_groups_that_force_and_time_are_scaled_by_match_in_any_two_instruments(
    scaled: Instrument, continuum: Instrument
) -> None:
    groups = tn.similarity.compare(continuum, scaled).groups
    imposed = {group.name for group in groups if group.imposed}
    assert imposed == {"Theta", "J/(kappa t^2)"}
    assert imposed <= {group.name for group in groups if group.matches}


def test_time_scales_so_that_both_tips_swing_alike(real: Instrument, scaled: Instrument) -> None:
    factors = tn.similarity.compare(real, scaled).factors
    assert factors["time"] == pytest.approx(natural_frequency(real) / natural_frequency(scaled), rel=1e-12)
    assert factors["spool_velocity"] == pytest.approx(factors["spool_angle"] / factors["time"], rel=1e-12)
    wider = scaled.replace(**{"drives.spool_radius": 2 * scaled.drives.spool_radius})
    halved = tn.similarity.compare(real, wider).factors
    assert halved["spool_angle"] == pytest.approx(factors["spool_angle"] / 2)
    assert halved["motor_stroke"] == factors["motor_stroke"]


def test_a_group_that_one_mechanism_lacks_has_no_counterpart(real: Instrument, continuum: Instrument) -> None:
    groups = {group.name: group for group in tn.similarity.compare(real, continuum).groups}
    for name in ("L_b/r", "EI/(k r^2 L_b)"):
        assert np.isnan(groups[name].real_size)
        assert groups[name].scaled_up > 0
        assert not groups[name].matches
    stribeck = real.replace(**{"friction.law": "stribeck", "friction.static_ratio": 1.5})
    groups = {group.name: group for group in tn.similarity.compare(stribeck, real).groups}
    assert groups["mu_0/mu"].real_size == 1.5
    assert np.isnan(groups["mu_0/mu"].scaled_up)


def test_instruments_of_different_mechanisms_are_compared_at_equal_unloaded_angles(
    real: Instrument, pulley: Instrument, continuum: Instrument
) -> None:
    for scaled_up in (pulley, continuum):
        comparison = tn.similarity.compare(real, scaled_up)
        handle = np.linspace(-comparison.reach, comparison.reach, 21)
        mapped = comparison.scaled_up_handle_angle(handle)
        bent = tn.statics.output_angle(scaled_up, mapped)
        assert bent == pytest.approx(tn.statics.output_angle(real, handle), abs=1e-12)
        assert comparison.covered == 1
        assert np.abs(comparison.error().error[:, 0]).max() < 1e-10
        at_middle = tn.statics.loss_of_dexterity(scaled_up, real.output_range / 2, comparison.force_factor())
        assert at_middle == pytest.approx(tn.statics.loss_of_dexterity(real, real.output_range / 2, 1.0), rel=1e-14)


def test_a_gear_and_a_pulley_of_equal_loss_agree_at_small_angles(real: TendonGear, pulley: TendonPulley) -> None:
    """Gears lose as pulleys do but for the cosine of half the angle, so that the error goes with the angle cubed."""
    errors = []
    for small in (1.0, 0.5):
        gear = real.replace(output_range=small * np.radians(10))
        other = pulley.replace(
            end_effector_length=1.1 * real.end_effector_length,
            distal_pulley_radius=1.5 * real.distal_gear_radius,
            proximal_pulley_radius=1.5 * real.proximal_gear_radius,
        )
        comparison = tn.similarity.compare(gear, other, largest_force=0.2 * small)
        assert comparison.factors["motor_stroke"] == pytest.approx(1.5)
        error = comparison.error()
        assert error.scaled_up_pretension == pytest.approx(1.5 * real.pretension)
        errors.append(error.largest)
    assert errors[0] < 0.03
    assert errors[0] / errors[1] == pytest.approx(8, rel=0.05)


def test_what_cannot_be_compared_is_refused(real: TendonGear, pulley: Instrument) -> None:
    for narrow in (real.replace(handle_range=0.1), pulley.replace(handle_range=0.1)):
        with pytest.raises(ValueError, match=r"scaled_up reaches .* deg of the real-size working range of 80 deg"):
            tn.similarity.compare(real, narrow)
    with pytest.raises(ValueError, match="largest_force is -1"):
        tn.similarity.compare(real, real, largest_force=-1)


def test_a_prototype_with_less_reach_is_judged_as_far_as_it_goes(real: TendonGear, pulley: Instrument) -> None:
    for scaled_up in (real, pulley):
        narrow = scaled_up.replace(handle_range=0.4)
        comparison = tn.similarity.compare(real, narrow)
        end = tn.statics.output_angle(narrow, 0.4)
        assert comparison.covered == pytest.approx(end / real.output_range, rel=1e-9)
        assert tn.statics.output_angle(real, comparison.reach) == pytest.approx(end, rel=1e-9)
        assert not np.isnan(comparison.error().error[:, 0]).any()


def test_held_by_one_counts_where_just_one_of_the_two_has_an_equilibrium(real: TendonGear) -> None:
    comparison = tn.similarity.compare(real, real, largest_force=4.0)
    same, weaker = comparison.error(), comparison.error(pretension=0.6 * real.pretension)
    assert same.held_by_one == 0
    assert same.unsolved > 0
    handle, force = np.meshgrid(weaker.handle_angle, weaker.force, indexing="ij")
    ours, theirs = (
        tn.statics.equilibrium(inst, handle, force).status == tn.statics.Status.OK
        for inst in (real, real.replace(pretension=0.6 * real.pretension))
    )
    assert weaker.held_by_one > 0.01
    assert weaker.held_by_one == pytest.approx(np.mean(ours != theirs))
    assert weaker.unsolved == pytest.approx(1 - np.mean(ours & theirs))


def test_a_tip_that_snapped_through_counts_as_standing_at_its_stop(real: TendonGear) -> None:
    error = tn.similarity.compare(real, real, largest_force=3.0).error(pretension=0.6 * real.pretension)
    lost = np.isnan(error.scaled_up_angle) & ~np.isnan(error.real_size_angle)
    assert lost.any()
    assert error.snapped[lost] == pytest.approx(np.degrees(-real.output_stop - error.real_size_angle[lost]))
    assert error.largest_snapped > error.largest
    assert not np.isnan(error.snapped[~np.isnan(error.real_size_angle)]).any()


def test_errors_of_the_papers_pair(real: TendonGear, scaled: TendonGear) -> None:
    """Our own numbers, so that none of them moves unnoticed: to 3 N, and to Fig. 14's 1.5 N on the scaled-up one."""
    comparison = tn.similarity.compare(real, scaled)
    found = {
        (pretension, limit): comparison.error(pretension=pretension, largest_force=limit)
        for pretension in (None, 25.0)
        for limit in (3.0, 1.5 / 2.88)
    }
    assert [(round(one.largest, 3), round(one.rms, 4)) for one in found.values()] == [
        (6.682, 0.3214),
        (0.149, 0.0188),
        (32.253, 7.1198),
        (0.149, 0.0188),
    ]
    assert found[25.0, 3.0].largest_snapped == pytest.approx(53.4, abs=0.1)
    assert found[25.0, 3.0].held_by_one == pytest.approx(0.044, abs=1e-3)


def perturbed(inst: Instrument, name: str, share: float) -> tuple[Instrument, dict[str, float]]:
    """Return a prototype in which one group differs by a share, and how it is to be tested."""
    if name == "T_o/(kr)":
        return inst, {"pretension": inst.pretension * (1 + share)}
    if name == "Theta":
        return inst, {"force_factor": 1 + share}
    field = {
        "R/r": next(key for key, parameter in inst.parameter_fields.items() if parameter == "proximal_radius"),
        "l_d/r": "end_effector_length",
        "EI/(k r^2 L_b)": "backbone_rigidity",
        "L_b/r": "backbone_length",
    }[name]
    changes = {field: getattr(inst, field) * (1 + share)}
    if name == "L_b/r":
        changes["backbone_rigidity"] = inst.backbone_rigidity * (1 + share)  # type: ignore[attr-defined]
    return inst.replace(**changes), {}


CAUSES = ("R/r", "l_d/r", "Theta", "T_o/(kr)", "L_b/r", "EI/(k r^2 L_b)")


@pytest.mark.parametrize("name", CAUSES)
def test_an_error_of_one_group_is_put_down_to_that_group(any_inst: Instrument, name: str) -> None:
    if any_inst.joint_type != "continuum" and name in CAUSES[-2:]:
        pytest.skip("a group of continuum tips")
    if any_inst.joint_type == "tendon-pulley" and name == "l_d/r":
        pytest.skip("a pulley's loss is the same at all angles, so that its l_d/r does nothing at equal Theta")
    scaled_up, test = perturbed(any_inst, name, 0.03)
    # Far enough for slack, where alone the pretension matters.
    slack = float(tn.statics.slack_force(any_inst, 0.0))
    comparison = tn.similarity.compare(any_inst, scaled_up, largest_force=1.1 * slack)
    causes = comparison.causes(**test)
    assert causes.worst == name
    assert abs(causes.remainder) < 0.02 * abs(causes.error)
    assert causes.remainder_rms < 0.05 * causes.error_rms
    assert causes[name].ratio == pytest.approx(1.03)
    assert all(cause.rms < 1e-9 for cause in causes.causes if cause.name != name)
    with pytest.raises(KeyError):
        causes["mu"]


def test_causes_of_small_mismatches_add_up_to_the_error(any_inst: Instrument) -> None:
    """Taut, where the output angle is smooth in every group, the path integral closes to rounding."""
    scaled_up, _ = perturbed(any_inst, "R/r", -0.01)
    scaled_up, _ = perturbed(scaled_up, "l_d/r", 0.04)
    comparison = tn.similarity.compare(any_inst, geometrically_scaled(scaled_up, 2.0))
    taut = 0.5 * float(tn.statics.slack_force(any_inst, 0.0))
    causes = comparison.causes(force_factor=1.02 * comparison.force_factor(), largest_force=taut)
    assert causes.remainder_rms < 1e-9
    assert causes.error_rms > 0.05
    assert sum(cause.at_worst for cause in causes.causes) == pytest.approx(causes.error, abs=1e-9)
    sizes = [abs(cause.at_worst) for cause in causes.causes]
    assert sizes == sorted(sizes, reverse=True)


def test_causes_are_derivatives_to_first_order(real: TendonGear) -> None:
    scaled_up = real.replace(proximal_gear_radius=real.proximal_gear_radius * 1.0001)
    causes = tn.similarity.compare(real, scaled_up, largest_force=1.0).causes()
    slope = tn.statics.gradient(
        "output_angle", real, causes.place.handle_angle, causes.place.force, wrt=["proximal_gear_radius"]
    )
    first_order = np.degrees(slope["proximal_gear_radius"] * real.proximal_gear_radius) * np.log(causes["R/r"].ratio)
    assert causes["R/r"].at_worst == pytest.approx(first_order, rel=1e-3)


def test_the_papers_errors_come_from_the_end_effector_and_as_used_from_the_pretension(
    real: TendonGear, scaled: TendonGear
) -> None:
    comparison = tn.similarity.compare(real, scaled)
    assert comparison.causes().worst == "l_d/r"
    used = comparison.causes(pretension=25.0)
    assert used.worst == "T_o/(kr)"
    assert used.remainder_rms < 0.02 * used.error_rms


def test_between_mechanisms_what_groups_do_not_explain_is_the_mechanisms(real: TendonGear, pulley: Instrument) -> None:
    comparison = tn.similarity.compare(real, pulley, largest_force=1.0)
    causes = comparison.causes(pretension=20.0, force_factor=1.01 * comparison.force_factor())
    assert {cause.name for cause in causes.causes} == {"T_o/(kr)", "Theta", "joint type"}
    assert causes["joint type"].rms > 0
    assert causes.remainder_rms < 0.02 * causes.error_rms

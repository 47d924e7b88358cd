"""Claims about the statics against closed forms."""

import sys
import threading

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import tenodesis as tn
from tenodesis.instrument import Continuum, Instrument, TendonGear
from tenodesis.statics import Status


@pytest.mark.equation(18)
def test_unloaded_tip_follows_the_reference_kinematic_relationship(real: TendonGear, scaled: TendonGear) -> None:
    for inst in (real, scaled):
        handle = np.linspace(-0.57, 0.57, 101)
        ratio = inst.proximal_gear_radius / inst.distal_gear_radius
        expected = 2 * np.arcsin(ratio * np.sin(handle / 2))
        assert np.abs(tn.statics.output_angle(inst, handle) - expected).max() < 1e-14


def test_loaded_continuum_balances_by_virtual_work_on_its_integrated_shape(continuum: Continuum) -> None:
    """The lever is the derivative of the tip's position, here by quadrature along the arc."""
    c = continuum

    def lever(angle: float, direction: str) -> float:
        def along(s: float) -> float:
            inner = angle * (1 - s)
            return s * (np.cos(inner) if direction == "tangential" else np.sin(inner))

        arc = c.backbone_length * quad(along, 0, 1, epsabs=1e-14)[0]
        return arc + (c.end_effector_length if direction == "tangential" else 0.0)

    def balance(angle: float, handle: float, force: float, radial: float) -> float:
        stretch = c.proximal_pulley_radius * handle - c.distal_tendon_offset * angle
        agonist = max(0.0, c.pretension + c.tendon_stiffness * stretch)
        antagonist = max(0.0, c.pretension - c.tendon_stiffness * stretch)
        passive = c.backbone_rigidity / c.backbone_length * angle
        load = force * lever(angle, "tangential") - radial * lever(angle, "radial")
        return float((agonist - antagonist) * c.distal_tendon_offset - passive - load)

    for handle in (-0.6, -0.1, 0.3, 0.7):
        for force, radial in ((0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (-2.0, 1.5), (0.5, -4.0)):
            expected = brentq(balance, -3.1, 3.1, args=(handle, force, radial), xtol=1e-13)
            found = tn.statics.output_angle(c, handle, force, radial_force=radial)
            assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.equation(1, 3, 4, 5, 6, 7, 8, 9)
def test_tensions_and_angle_satisfy_the_papers_equations_as_printed(real: TendonGear, scaled: TendonGear) -> None:
    for inst in (real, scaled):
        big, small, k = inst.proximal_gear_radius, inst.distal_gear_radius, inst.tendon_stiffness
        heaviest = 1.2 * tn.statics.slack_force(inst, 0.0)
        handle, force = np.meshgrid(np.linspace(-0.2, 0.6, 40), np.linspace(0, heaviest, 31))
        state = tn.statics.equilibrium(inst, handle, force)
        solved = state.status == Status.OK
        assert solved.mean() > 0.9
        theta_p, theta_d = handle[solved] / 2, state.output_angle[solved] / 2
        stretch = 2 * (big * np.sin(theta_p) - small * np.sin(theta_d))
        agonist, antagonist = state.agonist[solved], state.antagonist[solved]
        assert np.abs(agonist - np.maximum(0, inst.pretension + k * stretch)).max() < 1e-9
        assert np.abs(antagonist - np.maximum(0, inst.pretension - k * stretch)).max() < 1e-9
        moment = force[solved] * (inst.end_effector_length / (small * np.cos(theta_d)) + 1)
        assert np.abs(agonist - antagonist - moment).max() < 1e-9
        taut = antagonist > 0
        difference = np.where(taut, 2 * k * stretch, inst.pretension + k * stretch)
        assert np.abs(agonist - antagonist - difference).max() < 1e-9
        assert 0 < taut.mean() < 1


@pytest.mark.equation(2, 10, 11, 12, 13, 14)
def test_transmissibility_is_the_ratio_of_the_moments_both_forces_make(real: TendonGear) -> None:
    handle, force = np.array([0.0, 0.2, 0.4, 0.55]), 0.9
    state = tn.statics.equilibrium(real, handle, force)
    theta_p = handle / 2
    hand = (state.agonist - state.antagonist) / (real.handle_length / (real.proximal_gear_radius * np.cos(theta_p)) + 1)
    moment_out = force * (real.end_effector_length + 2 * real.distal_gear_radius) + force * real.end_effector_length
    moment_in = hand * (real.handle_length + 2 * real.proximal_gear_radius) + hand * real.handle_length
    found = tn.statics.torque_transmissibility(real, handle, force)
    assert np.abs(found - moment_out / moment_in).max() < 1e-12
    slender = real.distal_gear_radius * np.cos(state.output_angle / 2)
    slender /= real.proximal_gear_radius * np.cos(theta_p)
    assert np.abs(found / slender - 1).max() < 0.015


@pytest.mark.equation(15, 16)
def test_flexural_stiffness_is_what_resists_a_moment_at_the_output(any_inst: Instrument) -> None:
    """By eq. 15's definition: the moment of the tendons (and backbone) against a small turn of the held joint."""
    inst = any_inst
    handle = 0.25
    free = tn.statics.output_angle(inst, handle)
    step = 1e-5
    lost = free - tn.statics.output_angle(inst, handle, step)
    lever = tn.statics.loss_of_dexterity(inst, free, 1.0) * tn.statics.flexural_stiffness(inst, free)
    assert tn.statics.flexural_stiffness(inst, free) == pytest.approx(step * lever / lost, rel=1e-5)


@pytest.mark.equation(16)
def test_flexural_stiffness_has_the_papers_closed_form(real: TendonGear) -> None:
    angle = np.radians([0, 40, 80])
    expected = 2 * real.tendon_stiffness * real.distal_gear_radius**2 * np.cos(angle / 2) ** 2
    assert tn.statics.flexural_stiffness(real, angle) == pytest.approx(expected, rel=1e-14)


@pytest.mark.equation(17)
def test_loss_equals_loss_of_dexterity_to_first_order_in_force(any_inst: Instrument) -> None:
    handle = np.linspace(-0.5, 0.5, 21)
    free = tn.statics.output_angle(any_inst, handle)
    slope = tn.statics.gradient(tn.statics.output_angle, any_inst, handle, wrt=["force"])["force"]
    assert -slope == pytest.approx(tn.statics.loss_of_dexterity(any_inst, free, 1.0), rel=1e-9)


@pytest.mark.equation(20)
def test_handle_angle_inverts_output_angle(any_inst: Instrument) -> None:
    random = np.random.default_rng(3)
    handle = random.uniform(-0.6, 0.6, 20_000)
    force = random.uniform(-1.3, 1.3, 20_000) * tn.statics.slack_force(any_inst, 0.0)
    radial = random.uniform(-5, 5, 20_000)
    output = tn.statics.output_angle(any_inst, handle, force, radial_force=radial)
    solved = np.isfinite(output)
    assert solved.mean() > 0.6
    back = tn.statics.handle_angle(any_inst, output[solved], force[solved], radial_force=radial[solved])
    assert np.abs(back - handle[solved]).max() < 1e-10
    assert np.sum(tn.statics.tensions(any_inst, handle, force).antagonist == 0) > 100


@pytest.mark.equation(20)
def test_handle_angle_without_slack_is_equation_20(real: TendonGear) -> None:
    output, force = np.radians([10.0, 40, 70]), 0.8
    handle = tn.statics.handle_angle(real, output, force)
    first, second = tn.statics.tensions(real, handle, force)
    small, big, k = real.distal_gear_radius, real.proximal_gear_radius, real.tendon_stiffness
    expected = 2 * np.arcsin(small / big * np.sin(output / 2) + (first - second) / (4 * k * big))
    assert handle == pytest.approx(expected, abs=1e-12)


@pytest.mark.equation(21)
def test_compensation_angle_and_stroke_are_the_same_length_of_tendon(real: TendonGear) -> None:
    """What the hand adds in excursion, 2R (sin θ_h*/2 - sin θ_h/2), is eq. 22's ΔT / 2k."""
    desired, force = np.radians(50.0), 0.7
    handle = tn.statics.handle_angle(real, desired)
    more = tn.statics.handle_angle(real, desired, force)
    stroke = 2 * real.proximal_gear_radius * (np.sin(more / 2) - np.sin(handle / 2))
    tension = tn.statics.tensions(real, more, force)
    assert tn.statics.compensation_stroke(real, *tension, "differential", "paper") == pytest.approx(stroke, rel=1e-12)


def test_slack_starts_where_variation_equals_pretension(any_inst: Instrument) -> None:
    output = tn.statics.output_angle(any_inst, -0.1)
    force = tn.statics.slack_force(any_inst, output)
    handle = tn.statics.handle_angle(any_inst, output, force)
    tension = tn.statics.tensions(any_inst, handle, force)
    assert tension.antagonist == pytest.approx(0, abs=1e-9)
    assert tension.agonist - any_inst.pretension == pytest.approx(any_inst.pretension, abs=1e-9)
    assert tn.statics.tensions(any_inst, handle, force * 1.001).antagonist == 0
    assert tn.statics.tensions(any_inst, handle, force * 0.999).antagonist > 0


def test_winding_both_motors_alike_changes_only_the_mean_tension(real: TendonGear) -> None:
    plain = tn.statics.equilibrium(real, 0.3, 0.8)
    pulled = tn.statics.equilibrium(real, 0.3, 0.8, wound=(5e-4, 5e-4))
    assert pulled.output_angle == pytest.approx(plain.output_angle, abs=1e-13)
    assert pulled.agonist - plain.agonist == pytest.approx(real.tendon_stiffness * 5e-4, rel=1e-12)


def test_no_equilibrium_past_the_fold_is_nan_in_arrays_and_an_error_alone(real: TendonGear) -> None:
    handle = np.radians([-33.2, 0.0])
    state = tn.statics.equilibrium(real, handle, 1.5)
    assert list(state.status) == [Status.NO_EQUILIBRIUM, Status.OK]
    assert np.isnan([state.output_angle[0], state.agonist[0], state.antagonist[0]]).all()
    assert np.isnan(tn.statics.output_angle(real, handle, 1.5)).tolist() == [True, False]
    with pytest.raises(tn.NoSolutionError, match="past the fold"):
        tn.statics.output_angle(real, float(handle[0]), 1.5)
    assert tn.statics.equilibrium(real, float(handle[0]), 1.5).status is Status.NO_EQUILIBRIUM


def test_arrays_broadcast_and_scalars_stay_scalars(real: Instrument) -> None:
    assert isinstance(tn.statics.output_angle(real, 0.1, 1), float)
    grid = tn.statics.output_angle(real, np.zeros((3, 1, 2)), np.zeros((4, 1)), wound=(np.zeros(2), 0.0))
    assert grid.shape == (3, 4, 2)
    assert tn.statics.output_angle(real, [], 1.0).shape == (0,)
    assert tn.statics.output_angle(real, [0.1]).shape == (1,)
    assert tn.statics.output_angle(real, np.arange(3, dtype=np.int8) / 10).shape == (3,)
    strided = np.linspace(0, 0.4, 20)[::2]
    assert (tn.statics.output_angle(real, strided) == tn.statics.output_angle(real, strided.copy())).all()


def test_array_points_equal_single_points_and_have_derivatives_where_solved(any_inst: Instrument) -> None:
    random, count = np.random.default_rng(5), 2000
    scale = float(tn.statics.slack_force(any_inst, 0.0))
    handle = random.uniform(-0.6, 0.6, count)
    force, radial = random.uniform(-3, 3, count) * scale, random.uniform(-80, 80, count) * (random.random(count) < 0.3)
    # Some tendons are let out so far that none holds the tip.
    agonist, antagonist = random.uniform(-1e-3, 1e-3, (2, count)) - 4e-3 * (random.random(count) < 0.1)
    points = handle, force, radial, agonist, antagonist
    state = tn.statics.equilibrium(any_inst, handle, force, radial_force=radial, wound=(agonist, antagonist))
    solved = state.status == Status.OK
    assert 0.2 < solved.mean() < 0.95
    assert (np.isfinite(state.output_angle) == solved).all() and (np.isfinite(state.agonist) == solved).all()
    for at, status, angle in zip(np.transpose(points).tolist(), state.status, state.output_angle, strict=True):
        alone = tn.statics.equilibrium(any_inst, at[0], at[1], radial_force=at[2], wound=(at[3], at[4]))
        assert alone.status == status
        assert alone.output_angle == pytest.approx(angle, abs=1e-9, nan_ok=True)
    gradient = tn.statics.gradient("output_angle", any_inst, handle, force, wrt=["force"])["force"]
    assert (np.isnan(gradient) == np.isnan(tn.statics.output_angle(any_inst, handle, force))).all()


def test_results_do_not_depend_on_the_number_of_threads(real: Instrument) -> None:
    random = np.random.default_rng(7)
    handle, force = random.uniform(-0.6, 0.6, 50_001), random.uniform(-3, 3, 50_001)
    before = tn.threads.threads()
    results = []
    try:
        for count in (1, 2, 7):
            tn.set_threads(count)
            results.append(tn.statics.equilibrium(real, handle, force))
    finally:
        tn.set_threads(before)
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            assert np.array_equal(one, two, equal_nan=True)


def test_two_axes_have_their_own_values(real: Instrument) -> None:
    both = real.replace(overrides={"pitch": {"end_effector_length": "45 mm"}})
    assert both.axis("yaw").end_effector_length == 0.050
    assert both.axis("pitch").end_effector_length == 0.045
    assert both.axis("pitch").axes == ("pitch",)
    assert tn.statics.output_angle(both.axis("pitch"), 0.3, 1) > tn.statics.output_angle(both.axis("yaw"), 0.3, 1)


def test_other_python_threads_run_while_the_core_computes(real: Instrument) -> None:
    handle = np.linspace(-0.5, 0.5, 400_000)
    keys = ["pretension", "tendon_modulus", "distal_gear_radius", "force", "handle_angle"]
    done = threading.Event()

    def work() -> None:
        tn.statics.gradient("output_angle", real, handle, 0.5, wrt=keys)
        done.set()

    worker = threading.Thread(target=work)
    interval = sys.getswitchinterval()
    turns = 0
    try:
        sys.setswitchinterval(1e-5)
        worker.start()
        while not done.is_set():
            turns += 1
    finally:
        sys.setswitchinterval(interval)
    worker.join()
    # With the lock held, this loop would get only a few slices of a hundredth of a millisecond, before and after.
    assert turns > 100_000

"""The instrument moving in time in MuJoCo against theory, the statics and SciPy: what checks must itself be right."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from peers import chain_dynamics
from scipy.integrate import solve_ivp

import tenodesis as tn
from tenodesis.instrument import TendonGear

Array = NDArray[np.float64]
STEP = 5e-4  # s
DAMPING_RATIO = 0.1


class Case(NamedTuple):
    """An instrument, the inertia of its tip (kg m^2), and stiffness (N m/rad) and frequency (rad/s) when straight."""

    inst: TendonGear
    inertia: float
    stiffness: float
    frequency: float

    def damping(self, ratio: float = DAMPING_RATIO) -> float:
        return 2 * ratio * float(np.sqrt(self.stiffness * self.inertia))

    def force(self, angle: float) -> float:
        """Force (N) that turns the straight joint by a small angle (rad)."""
        return angle * self.stiffness / (self.inst.end_effector_length + self.inst.distal_gear_radius)


@pytest.fixture(params=[("real-size", 8e-6), ("scaled-up", 3e-4)], ids=lambda param: param[0])
def case(request: pytest.FixtureRequest) -> Case:
    name, inertia = request.param
    inst = tn.load(name)
    assert isinstance(inst, TendonGear)
    stiffness = float(tn.statics.flexural_stiffness(inst, 0.0))
    return Case(inst, inertia, stiffness, float(np.sqrt(stiffness / inertia)))


class Motion(NamedTuple):
    """The tip's angle (rad), its rate (rad/s) and tensions of the tendons (N), each (n,)."""

    output_angle: Array
    output_velocity: Array
    agonist: Array
    antagonist: Array


def simulate(
    inst: TendonGear, loads: tuple[Array, Array, Array], *, inertia: float, damping: float, substeps: int = 10
) -> Motion:
    """Follow a tip of an inertia and damping about its angle under handle angle, force across it and force along it."""
    handle, force, radial = loads
    wrench = np.zeros((len(handle), 6))
    wrench[:, 0], wrench[:, 2] = -force, radial
    moving = inst.axis("yaw").replace(**{"dynamics.tip_inertia": inertia, "dynamics.tip_damping": damping}).expanded
    found = chain_dynamics.simulate(moving, handle[:, np.newaxis], wrench, STEP, substeps=substeps)
    return Motion(found.output_angle[:, 0], found.output_velocity[:, 0], *found.tension.T)


def released(case: Case, angle: float, damping: float, periods: float) -> Motion:
    """Let go of the straight joint, held away by an angle (rad), for some periods."""
    force = np.zeros(int(periods * 2 * np.pi / case.frequency / STEP))
    force[0] = -case.force(angle)
    return simulate(case.inst, (0 * force, force, 0 * force), inertia=case.inertia, damping=damping)


def driven(case: Case, amplitude: float, share: float, samples: int) -> tuple[Array, Array, Array]:
    """Oscillating handle angle (rad) and forces (N), tangential up to a share of the straight tip's slack force."""
    time = np.arange(samples) * STEP
    handle = 0.1 + amplitude * np.sin(2 * np.pi * 5 * time)
    slack = float(tn.statics.slack_force(case.inst, 0.0))
    force: Array = slack * np.where(time > samples * STEP / 4, share, 0.1)
    return handle, force, 0.5 * np.sin(2 * np.pi * 9 * time)


def run(case: Case, inputs: tuple[Array, Array, Array], damping: float, **options: Any) -> Motion:
    return simulate(case.inst, inputs, inertia=case.inertia, damping=damping, **options)


def apart(one: Array, other: Array) -> float:
    """Largest difference of two angles, deg."""
    return float(np.degrees(np.abs(one - other).max()))


@pytest.mark.parametrize("radial", [0.0, 2.0])
@pytest.mark.parametrize("share", [0.5, -1.02])
def test_a_moved_handle_and_a_stepped_force_end_in_the_static_equilibrium(
    case: Case, share: float, radial: float
) -> None:
    force = share * float(tn.statics.slack_force(case.inst, 0.0))
    ramp = np.clip(np.arange(200 / case.frequency / STEP) / 200, 0, 1)
    inputs = (0.2 * ramp - 0.15, np.where(ramp > 0.5, force, 0.0), np.where(ramp > 0.7, radial, 0.0))
    motion = run(case, inputs, case.damping(0.8))
    for sample in (0, -1):
        expected = tn.statics.equilibrium(
            case.inst, inputs[0][sample], inputs[1][sample], radial_force=inputs[2][sample]
        )
        assert np.degrees(abs(motion.output_angle[sample] - expected.output_angle)) < 1e-5
        assert motion.agonist[sample] == pytest.approx(expected.agonist, abs=1e-5)
        assert motion.antagonist[sample] == pytest.approx(expected.antagonist, abs=1e-5)
    assert (min(motion.agonist[-1], motion.antagonist[-1]) == 0) == (abs(share) > 1)


def test_energy_is_conserved_without_damping_even_as_tendons_slacken(case: Case) -> None:
    slack = float(tn.statics.slack_force(case.inst, 0.0))
    motion = released(case, 1.15 * slack / case.force(1.0), 0.0, 20)
    assert (motion.agonist == 0).any()
    assert (motion.antagonist == 0).any()
    kinetic = case.inertia * motion.output_velocity**2 / 2
    elastic = (motion.agonist**2 + motion.antagonist**2) / (2 * case.inst.tendon_stiffness)
    at_rest = case.inst.pretension**2 / case.inst.tendon_stiffness
    energy = (kinetic + elastic - at_rest)[1:]  # the force does work until the first sample
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)


def test_the_motion_converges_with_the_fourth_power_of_the_substep(case: Case) -> None:
    inputs = driven(case, 0.05, 0.2, 300)
    finest = run(case, inputs, case.damping(), substeps=24)
    assert (np.minimum(finest.agonist, finest.antagonist) > 0).all()
    errors = [
        apart(run(case, inputs, case.damping(), substeps=substeps).output_angle, finest.output_angle)
        for substeps in (1, 2, 4)
    ]
    assert errors[0] < 1e-4
    assert 14 < errors[0] / errors[1] < 18
    assert 14 < errors[1] / errors[2] < 18


def test_the_default_substeps_agree_with_scipy_on_the_equation_of_motion(case: Case) -> None:
    inputs = driven(case, 0.3, 0.6, 300)
    motion = run(case, inputs, case.damping())
    angle, agonist, antagonist = by_scipy(case, inputs, case.damping(), float(motion.output_angle[0]))
    assert np.ptp(np.degrees(angle)) > 50
    assert apart(motion.output_angle, angle) < 1e-4
    np.testing.assert_allclose(motion.agonist, agonist, atol=1e-4)
    np.testing.assert_allclose(motion.antagonist, antagonist, atol=1e-4)


def tensions(inst: TendonGear, handle: Any, angle: Any) -> tuple[Any, Any]:
    """Tensions (N) at a handle and an output angle (rad), from docs/model.md as printed."""
    shorter = inst.proximal_gear_radius * np.sin(handle / 2) - inst.distal_gear_radius * np.sin(angle / 2)
    more = 2 * inst.tendon_stiffness * shorter
    return np.maximum(0.0, inst.pretension + more), np.maximum(0.0, inst.pretension - more)


def by_scipy(case: Case, inputs: tuple[Array, Array, Array], damping: float, start: float) -> tuple[Array, ...]:
    """Output angle (rad) and tensions (N) by SciPy, from docs/model.md as printed."""
    inst, given = case.inst, np.array(inputs)

    def slope(share: float, state: Array, before: Array, after: Array) -> list[float]:
        handle, force, radial = before + (after - before) * share
        agonist, antagonist = tensions(inst, handle, state[0])
        arm = inst.distal_gear_radius * np.cos(state[0] / 2)
        moment = (agonist - antagonist) * arm - force * (inst.end_effector_length + arm)
        moment += radial * inst.distal_gear_radius * np.sin(state[0] / 2)
        return [STEP * state[1], STEP * (moment - damping * state[1]) / case.inertia]

    states = [np.array([start, 0.0])]
    for before, after in zip(given.T[:-1], given.T[1:], strict=True):
        solved = solve_ivp(slope, (0, 1), states[-1], args=(before, after), method="DOP853", rtol=1e-9, atol=1e-11)
        states.append(solved.y[:, -1])
    angle = np.array(states)[:, 0]
    return angle, *tensions(inst, given[0], angle)


def test_a_handle_acts_on_the_tip_through_the_tendons_alone(case: Case) -> None:
    loose = case.inst.replace(tendon_stiffness=0.01, pretension=0.0)
    handle = np.linspace(0, 0.5, 50)
    motion = simulate(loose, (handle, 0 * handle, 0 * handle), inertia=case.inertia, damping=0.0)
    stretch = 2 * loose.proximal_gear_radius * np.sin(handle / 2)
    np.testing.assert_allclose(motion.agonist, 0.01 * stretch, atol=1e-9)
    largest = 0.01 * stretch[-1] * loose.distal_gear_radius / case.inertia  # acceleration, rad/s^2
    assert 0 < motion.output_angle[-1] < largest * (50 * STEP) ** 2 / 2

"""Claims about tissue at the tip: force against independent statics and dynamics, energy, and what is refused."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

import tenodesis as tn
from tenodesis import _core, plant
from tenodesis.control import Controller
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import Continuum, Instrument, TendonGear
from tenodesis.run import Run
from tenodesis.twin import TIME_STEP, Contact, Twin, run_many

from .conftest import refused
from .twin_motions import Array, alone, clock, eased, handle, same, smooth, with_friction

SIDES = {"flexion": 1, "extension": -1}
STIFFNESSES = [100.0, 300.0, 1e3, 3e3, 1e4]


def way(inst: Instrument, start: float, end: float) -> float:
    """The tip's way between two angles, square to the end-effector, by the joints' kinematics as in docs/model.md."""
    (one,) = inst.planar

    def arm(angle: float) -> float:
        if isinstance(one, TendonGear):
            return float(one.end_effector_length + one.distal_gear_radius * math.cos(angle / 2))
        if isinstance(one, Continuum):
            share = (1 - math.cos(angle)) / angle**2 if angle else 0.5
            return float(one.end_effector_length + one.backbone_length * share)
        return float(one.end_effector_length)

    return float(quad(arm, start, end)[0])


def by_root_finding(inst: Instrument, handle_angle: float, contact: Contact) -> tuple[float, float]:
    """Output angle and force at which the statics' tip is in equilibrium with tissue."""
    sign = SIDES[contact.side]

    def force(angle: float) -> float:
        return sign * contact.stiffness * max(sign * way(inst, contact.angle, angle), 0.0)

    def off(angle: float) -> float:
        try:
            return float(tn.statics.output_angle(inst, handle_angle, force(angle))) - angle
        except NoSolutionError:  # so deep that the load would be past the fold
            return -sign

    found = float(brentq(off, contact.angle, float(tn.statics.output_angle(inst, handle_angle)), xtol=1e-13))
    return found, force(found)


def pressed(inst: Instrument, contact: Contact | None, degrees: float = 33.0, rest: float = 1.5, **plant: Any) -> Run:
    """The tip of a handle that bends it to an angle where tissue may be in the way, from a straight one on."""
    goal = handle(inst, math.radians(degrees))
    motion = np.concatenate([eased(goal, 1.0), np.full(round(rest / TIME_STEP), goal)])
    return Twin(inst, **plant).run(motion, contact=contact)


# Statics


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("stiffness", STIFFNESSES)
@pytest.mark.parametrize("quasi_static", [True, False], ids=["at rest", "settled"])
def test_without_friction_tip_and_tissue_balance_where_root_finding_says(
    any_inst: Instrument, stiffness: float, side: Any, quasi_static: bool
) -> None:
    inst, sign = smooth(any_inst), SIDES[side]
    contact = Contact(sign * math.radians(20), stiffness, damping=2.0, side=side)
    run = pressed(inst, contact, sign * 33, rest=0.1 if quasi_static else 4.0, quasi_static=quasi_static)
    angle, force = by_root_finding(inst, handle(inst, sign * math.radians(33)), contact)
    assert sign * force > 0.01
    assert run["output_angle"][-1] == pytest.approx(angle, abs=1e-8)
    assert run["contact_force"][-1] == pytest.approx(force, rel=1e-5)


def test_a_handle_that_jumps_at_rest_ends_where_root_finding_says(any_inst: Instrument) -> None:
    inst = smooth(any_inst)
    goal = handle(inst, 0.6)
    contact = Contact(0.3, 1e4)
    run = Twin(inst, quasi_static=True).run([goal], contact=contact)
    assert run["output_angle"][0] == pytest.approx(by_root_finding(inst, goal, contact)[0], abs=1e-7)


@pytest.mark.parametrize("quasi_static", [True, False], ids=["at rest", "moving"])
def test_tissue_pushes_out_a_tip_whose_tendons_are_let_out(any_inst: Instrument, quasi_static: bool) -> None:
    inst = smooth(any_inst)
    contact = Contact(0.3, 1e3, damping=5.0)
    twin = Twin(inst, quasi_static=quasi_static)
    twin.run(eased(handle(inst, 0.5), 1.0), contact=contact)
    count = round(2.0 / TIME_STEP)
    out = 3 * inst.pretension / inst.tendon_stiffness + plant.parameters(inst)["distal_radius"]
    let_out = np.linspace(0, out, count)[:, np.newaxis] * np.ones(2)
    run = twin.run(np.full(count, handle(inst, 0.5)), let_out=let_out, contact=contact)
    assert run["contact_force"][0] > 0.05
    assert run["contact_force"][-1] == pytest.approx(0, abs=1e-6)
    assert run["output_angle"][-1] <= 0.3 + 1e-6


# Motion


def by_integration(inst: Instrument, handle_angle: Array, contact: Contact) -> Array:
    """The tip's angle by SciPy: a wheel of some inertia between two springs, at whose rim there is tissue."""
    p = plant.parameters(inst)
    radius, length = p["distal_radius"], p["end_effector_length"]
    time = TIME_STEP * np.arange(handle_angle.size + 1)
    aim = p["proximal_radius"] * np.concatenate([[0.0], handle_angle])

    def rates(now: float, state: Array) -> list[float]:
        angle, speed = state
        into = length * (angle - contact.angle)
        force = max(0.0, contact.stiffness * into + contact.damping * length * speed) if into > 0 else 0.0
        stretch = np.interp(now, time, aim) - radius * angle
        moment = 2 * inst.tendon_stiffness * stretch * radius - p["tip_damping"] * speed - force * length
        return [speed, moment / p["tip_inertia"]]

    found = solve_ivp(rates, (0, time[-1]), [0.0, 0.0], t_eval=time[1:], max_step=TIME_STEP / 2, rtol=1e-9, atol=1e-12)
    return np.asarray(found.y[0])


@pytest.mark.parametrize("damping", [0.0, 10.0])
def test_it_meets_tissue_as_an_independent_integration_says(pulley: Instrument, damping: float) -> None:
    inst = smooth(pulley)
    handle_angle = eased(handle(inst, 0.6), 0.4)
    handle_angle = np.concatenate([handle_angle, handle_angle[::-1]])
    contact = Contact(0.35, 2e3, damping)
    run = Twin(inst).run(handle_angle, contact=contact)
    peer = by_integration(inst, handle_angle, contact)
    free = Twin(inst).run(handle_angle)["output_angle"]
    assert np.degrees(np.abs(free - peer).max()) > 5
    assert np.degrees(np.abs(run["output_angle"] - peer).max()) < 0.01


@pytest.mark.parametrize("place", [28.0, 20.0])
@pytest.mark.parametrize("relaxation", [0.0, 5e-3, 0.1])
@pytest.mark.parametrize("stiffness", STIFFNESSES)
@pytest.mark.parametrize("name", ["real", "scaled"])
def test_against_tissue_the_tip_settles_without_chatter(
    request: pytest.FixtureRequest, name: str, stiffness: float, relaxation: float, place: float
) -> None:
    inst = alone(request.getfixturevalue(name))
    run = pressed(inst, Contact(math.radians(place), stiffness, relaxation * stiffness), rest=2.0)
    late = run.rows(-round(0.5 / TIME_STEP))
    assert late["contact_force"][-1] > 0.05
    assert np.ptp(late["contact_force"]) < 1e-3 * late["contact_force"][-1]
    assert np.degrees(np.ptp(late["output_angle"])) < 1e-3
    touching = run["contact_force"] > 0
    assert np.count_nonzero(np.diff(touching.astype(int))) <= 9  # it may bounce, and comes to rest


@pytest.mark.parametrize("side", SIDES)
def test_tissue_never_pulls(any_inst: Instrument, side: Any) -> None:
    inst, sign = with_friction(any_inst), SIDES[side]
    t = clock(2.0)
    contact = Contact(sign * 0.2, 500.0, damping=200.0, side=side)
    run = Twin(inst).run(sign * handle(inst, 0.5) * np.abs(np.sin(9 * t)), contact=contact)
    force, into = sign * run["contact_force"], sign * run["output_angle"] - 0.2
    assert (force >= 0).all()
    assert force.max() > 0.1
    assert (force[1:][(into[1:] <= 0) & (into[:-1] <= 0)] == 0).all()
    # It follows the tip no faster than its damper lets it.
    assert ((into > 0) & (force == 0)).any()


def test_both_sides_are_alike(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    one = pressed(inst, Contact(0.3, 1e3, 5.0))
    other = pressed(inst, Contact(-0.3, 1e3, 5.0, side="extension"), -33)
    np.testing.assert_allclose(other["contact_force"], -one["contact_force"], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(other["output_angle"], -one["output_angle"], rtol=1e-9, atol=1e-12)


def test_tissue_that_is_not_met_changes_nothing(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    free = pressed(inst, None)
    for contact in (Contact(0.0, 0.0, damping=50.0), Contact(0.7, 1e4), Contact(-0.2, 1e4, side="extension")):
        run = pressed(inst, contact)
        assert (run["contact_force"] == 0).all()
        for name, values in free.signals().items():
            assert values.tobytes() == run[name].tobytes(), name


def test_a_hand_yields_to_tissue(scaled: Instrument) -> None:
    inst = smooth(scaled)
    contact = Contact(math.radians(20), 1e4)
    stiff, soft = (
        pressed(inst.replace(**{"dynamics.hand_stiffness": stiffness}), contact, rest=4.0) for stiffness in (200.0, 2.0)
    )
    held = pressed(inst, contact, rest=4.0)
    for run in (stiff, soft):
        angle, force = by_root_finding(inst, float(run["handle_angle"][-1]), contact)
        assert run["output_angle"][-1] == pytest.approx(angle, abs=1e-7)
        assert run["contact_force"][-1] == pytest.approx(force, rel=1e-4)
    assert 0 < soft["contact_force"][-1] < stiff["contact_force"][-1] < held["contact_force"][-1]


# Energy


@pytest.mark.parametrize("law", [None, "capstan", "stribeck"])
@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_tissue_gives_back_no_more_energy_than_it_took(any_inst: Instrument, damping: float, law: str | None) -> None:
    inst = with_friction(any_inst, law) if law else smooth(any_inst)
    motion = handle(inst, 0.5) * np.abs(np.sin(9 * clock(1.0)))
    twin, contact = Twin(inst), Contact(0.2, 2e3, damping)
    steps = [twin.energy(motion[n : n + 1], contact=contact) for n in range(motion.size)]
    lost = np.array([step.tissue for step in steps])
    energy = Twin(inst).energy(motion, contact=contact)
    assert lost.min() > -1e-7 * energy.work
    assert energy.tissue == pytest.approx(lost.sum())
    assert abs(energy.unaccounted) < 1e-3 * energy.work
    if damping:
        assert energy.tissue > 1e-3 * energy.work
    else:
        assert abs(energy.tissue) < 1e-6 * energy.work


def test_without_any_damping_the_tip_bounces_for_ever_and_no_higher(pulley: Instrument) -> None:
    inst = smooth(pulley).replace(**{"dynamics.tip_damping": 0.0})
    twin, contact = Twin(inst), Contact(0.001, 5e3)
    twin.run(np.zeros(20), -0.3, contact=contact)
    stored = np.array([twin.energy(np.zeros(500), contact=contact).stored_after for _ in range(40)])
    rest = Twin(inst).energy(np.zeros(1)).stored_before
    assert stored[0] > 1.001 * rest
    assert np.ptp(stored) < 1e-6 * (stored[0] - rest)


def test_what_is_stored_in_tissue_that_is_taken_away_is_lost(scaled: Instrument) -> None:
    inst = smooth(scaled)
    goal, contact = handle(inst, 0.5), Contact(0.3, 1e3)
    twin = Twin(inst)
    twin.run(np.concatenate([eased(goal, 1.0), np.full(4000, goal)]), contact=contact)
    into = way(inst, contact.angle, float(twin.run([goal], contact=contact)["output_angle"][-1]))
    energy = twin.energy([goal])
    assert energy.tissue == pytest.approx(0.5 * contact.stiffness * into**2, rel=1e-6)
    assert abs(energy.unaccounted) < 1e-3 * energy.tissue


# Runs


def test_it_stays_in_place_from_call_to_call_and_with_a_stored_state(scaled: Instrument) -> None:
    inst = with_friction(scaled)
    contact = Contact(0.3, 1e3, 5.0)
    whole = pressed(inst, contact)
    goal = handle(inst, math.radians(33))
    twin = Twin(inst)
    twin.run(eased(goal, 1.0), contact=contact)
    state = twin.state
    for _ in range(2):
        twin.state = state
        late = twin.run(np.full(round(1.5 / TIME_STEP), goal), contact=contact)
        same(late, whole.rows(round(1.0 / TIME_STEP)))
    away = twin.run(np.full(2000, goal))
    assert (away["contact_force"] == 0).all()
    assert away["output_angle"][-1] > late["output_angle"][-1] + 0.01
    assert away.contact_stiffness is None


def test_each_axis_has_its_own(real: Instrument) -> None:
    t = clock(1.0)
    angles = np.stack([0.3 * np.sin(3 * t), -0.3 * np.sin(3 * t)], -1)
    contacts = (None, Contact(-0.2, 1e3, side="extension"))
    both = Twin(real).run(angles, contact=contacts)
    for n, name in enumerate(real.axes):
        one = Twin(real.axis(name)).run(angles[:, n], contact=contacts[n])
        np.testing.assert_array_equal(both["contact_force"][:, n], one["contact_force"])
        np.testing.assert_array_equal(both["output_angle"][:, n], one["output_angle"])
    assert both["contact_force"].any(axis=0).tolist() == [False, True]
    assert both["contact_stiffness"][0].tolist() == [0.0, -1e3]


def test_many_runs_meet_the_same_tissue_as_single_ones(scaled: Instrument) -> None:
    inst = with_friction(scaled)
    motion = eased(handle(inst, 0.5), 0.5)
    contacts = [None, Contact(0.3, 1e3), Contact(0.2, 5e3, 2.0)]
    batch = run_many(inst, motion, contact=contacts, signals=("output_angle", "contact_force"))
    for n, contact in enumerate(contacts):
        run = Twin(inst, seed=n).run(motion, contact=contact)
        for name in ("output_angle", "contact_force"):
            np.testing.assert_array_equal(batch[name][n], run[name])
    shared = run_many(inst, motion, contact=contacts[1], seeds=[1], signals=("contact_force",))
    np.testing.assert_array_equal(shared["contact_force"][0], batch["contact_force"][1])


def test_a_controller_meets_tissue_too(scaled: Instrument) -> None:
    goal = handle(scaled, math.radians(33))
    motion = np.concatenate([eased(goal, 1.0), np.full(2000, goal)])
    contact = Contact(math.radians(28), 1e3, 5.0)
    run = Twin(scaled).run(motion, contact=contact, controller=Controller(scaled, enabled=False))
    off = Twin(scaled).run(motion, contact=contact)
    np.testing.assert_allclose(run["contact_force"], off["contact_force"], rtol=1e-9, atol=1e-9)
    assert run["contact_force"].max() > 0.1


def test_one_motor_takes_back_what_kept_the_other_tendon_tight(real: Instrument) -> None:
    inst = real.axis("yaw")
    goal = handle(inst, math.radians(54))
    motion = np.concatenate([eased(goal, 2.0), np.full(6000, goal), goal - eased(goal, 1.0), np.zeros(4000)])
    run = Twin(inst).run(
        motion, contact=Contact(math.radians(2), 2500.0), controller=Controller(inst, actuation="agonist")
    )
    assert not run.fault_times
    # Pressed that hard the antagonist gets slack, and is wound.
    assert run["tension"][:, 1].min() < 1
    wound = run["spool_angle"][:, 1]
    assert wound.max() > 0.1
    assert abs(wound[-1]) < 0.05 * wound.max()
    assert run["tension"][-1].max() < 1.2 * inst.pretension


def test_expected_readings_have_derivatives_in_tissue(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    motion = eased(handle(inst, 0.5), 0.3)
    rows = np.zeros((motion.size, sum(width for _, width in _core.axis_commands())))
    rows[:, 0] = motion
    rows[:, -3:] = Contact(0.2, 2e3, 5.0).row
    names = [*_core.twin_parameters(), *tn.instrument.PARAMETERS]
    wanted = ["vertex_coefficient", "tip_inertia", "pretension"]
    variables = [names.index(name) for name in wanted]
    values = plant.parameter_row(inst, TIME_STEP)

    def readings(parameters: list[float], variables: list[int]) -> Array:
        count = len(_core.twin_parameters())
        axis = inst.spec.__class__.__new__(inst.spec.__class__)
        joint, _, *rest = inst.spec.__getstate__()
        axis.__setstate__((joint, parameters[count:], *rest))
        spec = plant.core_spec(inst, axis, parameters[:count], 1, False)
        out = np.empty((4, 1 + len(variables), motion.size))
        steps, status = _core.twin_gradient(spec, rows, False, variables, out)
        assert (steps, status) == (motion.size, tn.statics.Status.OK)
        return out

    exact = readings(values, variables)[1, 1:, -1]
    for place, variable in enumerate(variables):
        step = 1e-6 * values[variable]
        either = ([v + sign * step * (n == variable) for n, v in enumerate(values)] for sign in (1, -1))
        up, down = (readings(changed, [])[1, 0, -1] for changed in either)
        assert exact[place] == pytest.approx((up - down) / (2 * step), rel=1e-3, abs=1e-9), wanted[place]


# Bad input


@pytest.mark.parametrize(
    ("given", "key", "sentence"),
    [
        ({"stiffness": -1.0}, "contact.stiffness", "contact.stiffness is -1.0; it must be 0 N/m or more."),
        ({"stiffness": math.nan}, "contact.stiffness", "contact.stiffness is nan; it must be 0 N/m or more."),
        ({"damping": -0.1}, "contact.damping", "contact.damping is -0.1; it must be 0 N s/m or more."),
        ({"damping": math.inf}, "contact.damping", "contact.damping is inf; it must be 0 N s/m or more."),
        ({"angle": 4.0}, "contact.angle", "contact.angle is 4.0; it must be between -pi and pi rad."),
        ({"side": "left"}, "contact.side", "contact.side is 'left'; it must be one of flexion, extension."),
    ],
)
def test_what_tissue_cannot_be_is_refused(given: dict[str, Any], key: str, sentence: str) -> None:
    with refused(key) as caught:
        Contact(**({"angle": 0.3, "stiffness": 1e3} | given))
    assert str(caught.value) == sentence


def test_tissue_is_not_placed_where_the_tip_is(scaled: Instrument, real: Instrument) -> None:
    twin = Twin(scaled)
    with refused("contact.angle", -0.1) as caught:
        twin.run([0.0], contact=Contact(-0.1, 1e3))
    assert str(caught.value) == (
        "contact.angle is -5.72958 deg, but the tip, at 0 deg, is inside that tissue already; it must be at or above "
        "the tip's angle."
    )
    with refused("contact.angle", 0.1):
        twin.run([0.0], contact=Contact(0.1, 1e3, side="extension"))
    with refused("contact.angle", -0.1):
        run_many(scaled, [0.0], contact=Contact(-0.1, 1e3))
    with refused("contact"):
        Twin(real).run(np.zeros((1, 2)), contact=Contact(0.1, 1e3))
    assert twin.time == 0
    twin.run([0.0], contact=Contact(0.0, 1e3))  # it may touch

"""Claims about parts that are no linear springs: tendons that stiffen or damp, springs that grow, ropes that run back,
and ranges to one side."""

from typing import Any

import numpy as np
import pytest
from peers.chain_peer import ChainPeer
from scipy.integrate import quad
from scipy.optimize import brentq

import tenodesis as tn
from tenodesis.errors import InstrumentError
from tenodesis.instrument import FullForm
from tenodesis.instrument.text import to_toml
from tenodesis.statics import chain

TENSIONS = [0.0, 4.0, 10.0, 30.0]
STIFFNESSES = [10e3, 20e3, 60e3, 80e3]
RADIUS, REACH, REST = 5e-3, 20e-3, 5.0
NO_FRICTION = {"vertex_coefficient": 0.0, "sheath_coefficient": 0.0, "sheath_bend": 0.0}
PAIR = [
    {"name": "flexor", "route": [{"joint": "wrist", "side": "agonist"}]},
    {"name": "extensor", "route": [{"joint": "wrist", "side": "antagonist"}]},
]


def pulley(joint: Any = None, tendon: Any = None, **changes: Any) -> FullForm:
    """Return one joint without a handle between two tendons on spools."""
    wrist = {"name": "wrist", "mechanism": "pulley", "axis": "yaw", "radius": RADIUS, "end_effector_length": REACH}
    values: dict[str, Any] = {
        "name": "pulley",
        "joints": [wrist | (joint or {})],
        "tendons": [one | (tendon or {}) for one in PAIR],
        "pretension": REST,
        "given_stiffness": 2e4,
        "friction": NO_FRICTION,
    }
    return FullForm.model_validate(
        {("tendon_stiffness" if k == "given_stiffness" else k): v for k, v in (values | changes).items()}
    )


def growing() -> FullForm:
    return pulley(tendon={"stiffness_by_tension": {"tension": TENSIONS, "stiffness": STIFFNESSES}})


def stretch(tension: float) -> float:
    """Return by how much a tendon is stretched more than at rest, by quadrature of 1/k(T)."""
    inner = [one for one in TENSIONS if min(REST, tension) < one < max(REST, tension)]
    return quad(lambda t: 1 / np.interp(t, TENSIONS, STIFFNESSES), REST, tension, points=inner or None, epsrel=1e-13)[0]


def pulled(by: float) -> float:
    """Return the inverse, by bisection; none where the tendon is slack."""
    return 0.0 if by <= stretch(0.0) else brentq(lambda t: stretch(t) - by, 0.0, 1e3, xtol=1e-13)


def test_a_growing_stiffness_stretches_as_the_quadrature_of_its_table_does() -> None:
    inst = growing()
    tensions = np.array([[0.0, 1.0], [3.0, 5.0], [7.0, 12.0], [29.0, 31.0], [60.0, 100.0]])
    expected = np.vectorize(stretch)(tensions)
    np.testing.assert_allclose(inst.stretches(tensions), expected, atol=1e-15)
    np.testing.assert_allclose(inst.tensions_at(expected), tensions, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("force", [0.0, 0.3, -1.0, 2.5])
@pytest.mark.parametrize("wound", [0.0, 3e-4])
def test_statics_and_twin_rest_where_such_tendons_balance_the_load(force: float, wound: float) -> None:
    inst = growing()
    strokes = np.array([wound, 0.5 * wound])
    wrench = np.array([force, 0, 0, 0, 0, 0])

    def tensions(angle: float) -> np.ndarray:
        return np.array([pulled(strokes[0] - RADIUS * angle), pulled(strokes[1] + RADIUS * angle)])

    # A force across the tip turns with it.
    expected = brentq(lambda angle: RADIUS * -np.diff(tensions(angle))[0] + REACH * force, -1, 1, xtol=1e-14)
    rest = chain.equilibrium(inst, np.zeros(0), wrench, strokes=strokes)
    assert rest.output_angle[0] == pytest.approx(expected, abs=1e-11)
    np.testing.assert_allclose(rest.tensions, tensions(expected), atol=1e-8)
    twin = tn.twin.Twin(inst, quasi_static=True, time_step=1e-3)
    speed = strokes / inst.own_drives.spool_radius / 0.2
    moved = np.outer(np.clip(np.arange(400) / 200, 0, 1) < 1, speed)
    run = twin.run(np.zeros((400, 0)), wrench=wrench, spool_velocity=moved)
    turned = inst.own_drives.spool_radius * run["spool_angle"][-1]
    again = chain.equilibrium(inst, np.zeros(0), wrench, strokes=turned)
    np.testing.assert_allclose(run["output_angle"][-1], again.output_angle, atol=1e-9)
    np.testing.assert_allclose(run["tension"][-1], again.tensions, atol=1e-6)


def test_rates_of_growing_tendons_and_springs_are_their_differences() -> None:
    inst = growing().replace(joints=[*_joints(growing(), cubic_stiffness=0.3, stiffness=0.02)])
    wrench, strokes, step = np.array([0.8, 0, 0.2, 0, 0.01, 0]), np.array([4e-4, -1e-4]), 1e-7
    rates = chain.rates(inst, np.zeros(0), wrench, strokes=strokes)
    for m in range(2):
        near = [
            chain.output_angles(inst, np.zeros(0), wrench, strokes=strokes + s * step * np.eye(2)[m]) for s in (1, -1)
        ]
        assert rates.by_stroke[0, m] == pytest.approx((near[0] - near[1])[0] / (2 * step), rel=1e-5)
    near = [
        chain.output_angles(inst, np.zeros(0), wrench + np.array([s * 1e-5, 0, 0, 0, 0, 0]), strokes=strokes)
        for s in (1, -1)
    ]
    assert rates.by_wrench[0, 0] == pytest.approx((near[0] - near[1])[0] / 2e-5, rel=1e-6)


def _joints(inst: FullForm, **changes: Any) -> list[dict[str, Any]]:
    return [joint.model_dump(exclude_unset=True) | changes for joint in inst.joints]


@pytest.mark.parametrize("moment", [-0.05, 0.02, 0.2])
def test_a_spring_that_grows_holds_a_moment_by_its_cubic(moment: float) -> None:
    linear, cubic = 0.05, 0.4
    inst = pulley({"stiffness": linear, "cubic_stiffness": cubic}, tendons=[PAIR[0]], pretension=0.0)
    # The only tendon is let out: the spring alone holds the joint.
    found = chain.output_angles(inst, np.zeros(0), [0, 0, 0, 0, moment, 0], strokes=[-4e-3])
    expected = brentq(lambda angle: linear * angle + cubic * angle**3 - moment, -2, 2, xtol=1e-14)
    assert found[0] == pytest.approx(expected, abs=1e-10)


def test_without_a_linear_part_such_a_spring_still_holds_a_joint() -> None:
    inst = pulley({"cubic_stiffness": 0.4}, tendons=[PAIR[0]])
    assert chain.output_angles(inst, np.zeros(0), strokes=[1e-4])[0] > 0


def test_a_rope_that_runs_back_over_a_pulley_draws_it_with_twice_its_tension() -> None:
    route = [{"joint": "wrist", "side": "antagonist"}] * 2
    inst = pulley(tendons=[PAIR[0], {"name": "doubled", "route": route}])
    np.testing.assert_allclose(inst.tendon_arms("tip")[:, 0], [RADIUS, -2 * RADIUS], rtol=1e-12)
    rest = chain.equilibrium(inst, np.zeros(0), strokes=[2e-4, 2e-4])
    # In balance 2 : 1, and a load across by the sum of both.
    assert rest.tensions[0] == pytest.approx(2 * rest.tensions[1], rel=1e-9)
    loaded = chain.equilibrium(inst, np.zeros(0), [0.4, 0, 0, 0, 0, 0], strokes=[2e-4, 2e-4])
    assert RADIUS * (loaded.tensions[0] - 2 * loaded.tensions[1]) == pytest.approx(-REACH * 0.4, rel=1e-9)
    held = inst.replace(friction={"law": "capstan"} | NO_FRICTION | {"vertex_coefficient": 0.1})
    run = tn.twin.Twin(held, quasi_static=True).run(np.zeros((400, 0)), spool_velocity=np.tile([0.0, 0.05], (400, 1)))
    angle = abs(run["output_angle"].ravel()[-1])
    assert angle > 0.01
    # Wound in, its tension falls by the capstan law at each of the two passages.
    flexor, doubled = run["tension"][-1].ravel() * np.exp([0.1 * angle, -0.1 * angle])
    assert run["distal_tension"][-1].ravel() == pytest.approx([flexor, doubled], rel=1e-6)
    assert flexor == pytest.approx(doubled * (1 + np.exp(-0.1 * angle)), rel=1e-6)


@pytest.mark.parametrize("damping", [0.0, 40.0])
def test_a_tendons_damping_takes_the_energy_that_is_missing(damping: float) -> None:
    table = {"tension": TENSIONS, "stiffness": STIFFNESSES}
    inst = pulley(
        {"damping": 0.0}, {"damping": damping, "stiffness_by_tension": table}, dynamics={"damping_ratio": 0.0}
    )
    step, count = 2e-5, 20000
    wrench = np.zeros((count, 6))
    wrench[:2000, 0] = 0.5
    energy = tn.twin.Twin(inst, time_step=step).energy(np.zeros((count, 0)), wrench=wrench)
    gained = energy.stored_after - energy.stored_before
    work = abs(energy.load)
    assert work > 2e-5
    assert gained == pytest.approx(energy.load + energy.spools - energy.friction - energy.damping, abs=2e-3 * work)
    if damping:
        assert energy.damping > 0.2 * work
    else:
        assert energy.damping == pytest.approx(0, abs=1e-6 * work)


def test_damped_tendons_let_the_tip_decay_as_the_closed_form_says() -> None:
    damping, mass = 3.0, 0.01
    link = {"damping": 0.0, "mass": mass, "centre_of_mass": REACH, "inertia": mass * REACH**2}
    inst = pulley(link, {"damping": damping}, given_stiffness=2e4)
    inertia, stiffness = mass * REACH**2, 2 * 2e4 * RADIUS**2
    rate = np.sqrt(stiffness / inertia)
    decay = 2 * damping * RADIUS**2 / (2 * inertia)
    step = 0.002 / rate
    count = round(6 * np.pi / rate / step)
    wrench = np.zeros((count, 6))
    wrench[0, 0] = 0.1
    angle = tn.twin.Twin(inst, time_step=step).run(np.zeros((count, 0)), wrench=wrench)["output_angle"].ravel()
    time = step * np.arange(count)
    peaks = np.flatnonzero((angle[1:-1] > angle[:-2]) & (angle[1:-1] >= angle[2:])) + 1
    found = -np.polyfit(time[peaks], np.log(angle[peaks]), 1)[0]
    assert found == pytest.approx(decay, rel=0.01)


def test_a_range_to_one_side_ends_at_its_two_stops() -> None:
    inst = pulley({"range": (-0.3, 1.2), "stop": (-0.35, 1.3)})
    joint = inst.tip_joints[0]
    assert (joint.limits, joint.stops, joint.range) == ((-0.3, 1.2), (-0.35, 1.3), 1.2)
    tendons, stop_stiffness = 2 * 2e4 * RADIUS**2, 20 * 2 * 2e4 * RADIUS**2
    for sign, stop in ((1, 1.3), (-1, 0.35)):
        moment = np.zeros((3000, 6))
        moment[:, 4] = sign * 3.0
        run = tn.twin.Twin(inst, time_step=1e-4).run(np.zeros((3000, 0)), wrench=moment)
        # One tendon is slack there.
        expected = (3.0 - RADIUS * REST + stop_stiffness * stop) / (stop_stiffness + tendons / 2)
        assert run["output_angle"].ravel()[-1] == pytest.approx(sign * expected, rel=1e-3)
    assert 'range="-0.35 1.3"' in tn.kinematics.mjcf(inst)
    assert tn.parse(to_toml(inst)) == inst


WRONG: list[tuple[dict[str, Any], dict[str, Any], str]] = [
    ({}, {"stiffness_by_tension": {"tension": ["0 N", "5 N"], "stiffness": ["30 N/mm", "20 N/mm"]}}, "must not fall"),
    ({}, {"stiffness_by_tension": {"tension": ["1 N", "5 N"], "stiffness": ["3 N/mm", "20 N/mm"]}}, "begin at 0 N"),
    ({}, {"stiffness_by_tension": {"tension": ["0 N", "5 N"], "stiffness": ["3 N/mm"]}}, "one for each"),
    (
        {},
        {"stiffness": "3 N/mm", "stiffness_by_tension": {"tension": ["0 N", "5 N"], "stiffness": ["3 N/mm"] * 2}},
        "both",
    ),
    ({}, {"damping": "-1 N*s/m"}, "damping"),
    ({"range": ["10 deg", "80 deg"]}, {}, "zero"),
    ({"range": ["-10 deg", "80 deg", "90 deg"]}, {}, "two limits"),
    ({"range": ["-10 deg", "190 deg"]}, {}, "angle"),
    ({"cubic_stiffness": "-1 N*m"}, {}, "cubic_stiffness"),
]


@pytest.mark.parametrize(("joint", "tendon", "problem"), WRONG)
def test_what_cannot_be_is_one_sentence(joint: dict[str, Any], tendon: dict[str, Any], problem: str) -> None:
    inst = pulley()
    changes = {"joints": _joints(inst, **joint), "tendons": [PAIR[0] | tendon, PAIR[1]]}
    with pytest.raises(InstrumentError, match=problem) as caught:
        inst.replace(**changes)
    assert str(caught.value).count("\n") == 0


def test_a_doubled_rope_and_a_growing_spring_settle_as_in_mujoco() -> None:
    route = [{"joint": "wrist", "side": "antagonist"}] * 2
    spring = {"stiffness": 0.02, "cubic_stiffness": 0.5}
    inst = pulley(spring, tendons=[PAIR[0], {"name": "doubled", "route": route}])
    peer = ChainPeer(inst)
    for force, wound in ((0.0, 2e-3), (1.0, 1e-3), (-2.0, 3e-3), (6.0, -1e-3)):
        wrench, strokes = np.array([force, 0, 0, 0, 0.01, 0]), np.array([wound, 0.0])
        ours = chain.output_angles(inst, np.zeros(0), wrench, strokes=strokes)
        theirs = peer.settle(np.zeros(0), wrench, strokes=strokes)
        assert abs(ours[0]) > 0.005
        assert np.degrees(np.abs(ours - theirs.angles)).max() < 0.05


def compound() -> FullForm:
    """Return a wrist whose flexor runs over a block that a rope from a spool carries, away from the flexor's anchor."""
    block = {"name": "block", "mechanism": "pulley", "axis": "yaw", "on": "stem", "radius": 4e-3, "mass": 1e-3}
    wrist = {"name": "wrist", "mechanism": "pulley", "axis": "yaw", "on": "stem", "radius": RADIUS}
    crossing = {"joint": "block", "side": "antagonist"}
    flexor = {"name": "flexor", "start": "anchor", "route": [crossing, crossing, *PAIR[0]["route"]]}
    carrier = {"name": "carrier", "pretension": 2 * REST, "route": [{"joint": "block", "side": "agonist"}]}
    joints = [block, wrist | {"end_effector_length": REACH}]
    return pulley(joints=joints, tendons=[flexor, carrier, PAIR[1]])


def test_a_rope_over_a_block_has_half_the_tension_of_the_rope_that_carries_it() -> None:
    inst = compound()
    for force, wound in ((0.0, 0.0), (-0.5, 1e-3), (0.3, 2e-3)):
        strokes = np.array([0.0, wound, 0.0])
        rest = chain.equilibrium(inst, np.zeros(0), [force, 0, 0, 0, 0, 0], strokes=strokes)
        flexor, carrier, extensor = rest.tensions
        assert carrier == pytest.approx(2 * flexor, rel=1e-9)
        assert RADIUS * (flexor - extensor) == pytest.approx(-REACH * force, rel=1e-6, abs=1e-12)
        # The carrier winds 1 : 2 on the flexor, less what each of them stretches.
        stretched = (rest.tensions - inst.pretensions) / inst.stiffnesses
        wrist = rest.output_angle[1] * RADIUS
        assert 2 * (wound - stretched[1]) == pytest.approx(stretched[0] + wrist, abs=1e-12)
    run = tn.twin.Twin(inst, quasi_static=True).run(
        np.zeros((300, 0)), spool_velocity=np.tile([0.0, 0.5, 0.0], (300, 1))
    )
    assert run["tension"][-1][1] == pytest.approx(2 * run["tension"][-1][0], rel=1e-9)
    assert run["output_angle"][-1][1] > 0.01

"""Claims about backbones that bend in two planes, and twist: where they end, and what else knows of them."""

from math import degrees, log, radians
from typing import Any

import numpy as np
import pytest
from peers.chain_peer import ChainPeer
from peers.rod import End, Rod, end, turned

import tenodesis as tn
from tenodesis.errors import InstrumentError
from tenodesis.instrument import FullForm
from tenodesis.instrument.text import to_toml
from tenodesis.plant import link_rows, mass_matrix
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record
from tenodesis.report.space import draw

from .chain_samples import brought_to_rest

LENGTH, RIGIDITY, OFFSET, STIFFNESS, PRETENSION, BEYOND = 40e-3, 1e-3, 2e-3, 100e3, 20.0, 10e-3
THIRDS = (0.0, 120.0, 240.0)


def bending(arcs: int = 4, *, torsion: float | None = None, angles: Any = THIRDS, **changes: Any) -> FullForm:
    """Return a backbone whose tendons run at angles (deg) round it."""
    joint = {
        "name": "bend", "mechanism": "continuum", "axis": "yaw", "planes": 2, "arcs": arcs, "radius": OFFSET,
        "range": radians(150), "backbone_length": LENGTH, "backbone_rigidity": RIGIDITY, "end_effector_length": BEYOND,
    }  # fmt: skip
    if torsion is not None:
        joint["torsional_rigidity"] = torsion
    joint |= changes.pop("joint", {})
    crossing = changes.pop("crossing", {})
    tendons = [
        {"name": f"t{n}", "route": [{"joint": "bend", "angle": radians(at)} | crossing]} for n, at in enumerate(angles)
    ]
    values = {
        "name": "rod",
        "pretension": PRETENSION,
        "tendon_stiffness": STIFFNESS,
        "spool_radius": 5e-3,
        "friction": {},
    }
    inst = tn.load("two-segment-continuum").replace(
        **values | changes, joints=[joint], tendons=tendons, stem_length=0.3
    )
    return inst.expanded


def rod_of(torsion: float = np.inf, angles: Any = THIRDS, far: float = OFFSET) -> Rod:
    at = np.radians(angles)
    places = np.column_stack([radius * part(at) for radius in (OFFSET, far) for part in (np.cos, np.sin)])
    return Rod(LENGTH, RIGIDITY, torsion, places, STIFFNESS, PRETENSION, BEYOND)


def off(inst: FullForm, rod: Rod, wrench: Any, wound: Any) -> tuple[float, float]:
    """Return how far the tip is from the rod's, as a part of its length, and by how much it points elsewhere, deg."""
    return apart(inst, end(rod, wrench, wound), wrench, wound)


def apart(inst: FullForm, exact: End, wrench: Any, wound: Any) -> tuple[float, float]:
    angles = tn.statics.chain.output_angles(inst, np.zeros(0), wrench, strokes=wound)
    pose = tn.kinematics.tip_pose(inst, angles)
    ahead = turned(exact.rotation, np.array([0, 0, 1.0]))
    points = turned(np.asarray(pose.quaternion), np.array([0, 0, 1.0]))
    place = exact.place + BEYOND * ahead
    return float(np.linalg.norm(pose.position - place)) / LENGTH, degrees(np.linalg.norm(np.cross(ahead, points)))


@pytest.mark.parametrize(
    ("wrench", "wound"),
    [
        ((1, 0, 0, 0, 0, 0), (0, 0, 0)),
        ((1, 0.5, 0, 0, 0, 0), (0, 0, 0)),
        ((0, 0, 0, 0, 0, 0), (1e-3, 0.5e-3, -1e-3)),
        ((0.7, -0.4, 0.3, 0, 0, 0), (1.5e-3, 0.5e-3, -1e-3)),
        ((0.7, -0.4, -0.3, 0.01, 0, 0), (-1.5e-3, 1.5e-3, 0.5e-3)),
    ],
)
def test_four_arcs_in_two_planes_end_where_a_rod_in_space_does(wrench: Any, wound: Any) -> None:
    place, direction = off(bending(), rod_of(), wrench, wound)
    assert place < 1e-3
    assert direction < 0.1


def test_in_one_plane_they_are_the_arcs_of_one_plane() -> None:
    flat = bending(joint={"planes": 1}, angles=(0.0, 180.0))
    inst = bending(angles=(0.0, 180.0, 90.0, 270.0))
    wrench = (0.8, 0, -0.2, 0, 0.004, 0)
    one = tn.statics.chain.output_angles(flat, np.zeros(0), wrench, strokes=(1e-3, -1e-3))
    two = tn.statics.chain.output_angles(inst, np.zeros(0), wrench, strokes=(1e-3, -1e-3, 0, 0))
    np.testing.assert_allclose(two[inst.bends["bend_yaw"]], one, atol=1e-12)
    np.testing.assert_allclose(two[inst.bends["bend_pitch"]], 0, atol=1e-12)


def test_a_moment_about_the_rod_twists_it_where_the_file_gives_its_torsional_rigidity() -> None:
    torsion, moment = 8e-4, 4e-3
    wrench, wound = (0.5, -0.3, 0, 0, 0, moment), (1e-3, 0, -0.5e-3)
    place, direction = off(bending(torsion=torsion), rod_of(torsion), wrench, wound)
    assert place < 1e-2
    assert direction < 1.0
    stiff, _ = off(bending(), rod_of(torsion), wrench, wound)
    assert stiff > 2 * place
    straight = bending(torsion=torsion)
    alone = tn.statics.chain.output_angles(straight, np.zeros(0), (0, 0, 0, 0, 0, moment))
    twists = [i for i, joint in enumerate(straight.tip_joints) if joint.is_twist]
    assert alone[twists].sum() == pytest.approx(moment * LENGTH / torsion, rel=1e-9)


@pytest.mark.slow
def test_any_rod_in_space_is_followed_by_its_arcs() -> None:
    rng = np.random.default_rng(37)
    slack = 0
    offs: dict[int, list[tuple[float, float]]] = {4: [], 6: []}
    for _ in range(30):
        angles = np.sort(rng.uniform(0, 360, 4))
        far = OFFSET * rng.uniform(0.5, 1.0)
        wrench = rng.normal(size=6) * [0.5, 0.5, 0.5, 5e-3, 5e-3, 5e-3]
        wound = rng.uniform(-1, 1, 4) * OFFSET / 2
        try:
            exact = end(rod_of(np.inf, angles, far), wrench, wound)
        except ValueError:
            continue
        slack += int((exact.tensions == 0).any())
        for arcs, found in offs.items():
            found.append(apart(bending(arcs, angles=angles, crossing={"far_radius": far}), exact, wrench, wound))
    assert len(offs[4]) > 25
    assert slack > 5
    # The farthest bend by more than 90 deg.
    for arcs, farthest, turned_off in ((4, 1.3e-2, 0.8), (6, 5e-3, 0.35)):
        place, direction = np.array(offs[arcs]).T
        assert np.median(place) < 1e-3
        assert place.max() < farthest
        assert direction.max() < turned_off


def test_the_rates_of_the_angles_are_their_differences() -> None:
    inst = bending(2, torsion=8e-4)
    at: dict[str, Any] = {"strokes": np.array([1e-3, 0.3e-3, -0.8e-3])}
    for axes in ("tip", "stem"):
        at["axes"] = axes
        wrench = np.array([0.4, -0.3, 0.2, 2e-3, -1e-3, 1e-3])
        rates = tn.statics.chain.rates(inst, np.zeros(0), wrench, **at)
        for component, by in enumerate(1e-5 * np.eye(6)):
            apart = [tn.statics.chain.output_angles(inst, np.zeros(0), wrench + sign * by, **at) for sign in (1, -1)]
            np.testing.assert_allclose(
                rates.by_wrench[:, component], (apart[0] - apart[1]) / 2e-5, rtol=1e-5, atol=1e-7
            )


def test_the_jacobian_is_the_difference_of_poses() -> None:
    inst = bending(2, torsion=8e-4)
    angles = np.array([0.3, -0.2, 0.15, 0.25, 0.4])
    jacobian = tn.kinematics.jacobian(inst, angles)
    step = 1e-6
    for joint in range(len(angles)):
        by = step * np.eye(len(angles))[joint]
        poses = [tn.kinematics.tip_pose(inst, angles + sign * by).position for sign in (1, -1)]
        np.testing.assert_allclose(
            np.squeeze(jacobian)[:3, joint], np.squeeze(poses[0] - poses[1]) / (2 * step), atol=1e-8
        )


def test_mass_matrix_and_moments_of_rates_are_those_of_the_kinetic_energy() -> None:
    inst = bending(2, torsion=8e-4)
    links = link_rows(inst)
    names = [joint.name for joint in inst.tip_joints]
    around = {joint.within for joint in inst.tip_joints}
    rng = np.random.default_rng(3)
    angles, speeds, step = rng.uniform(-0.4, 0.4, 5), rng.uniform(-3, 3, 5), 1e-6

    def energy(at: np.ndarray, rates: np.ndarray) -> float:
        """Return the kinetic energy, J, from frames at two instants."""
        total = 0.0
        before, after = (tn.kinematics.frames(inst, at + sign * step * rates).bodies for sign in (-1, 1))
        for name, (mass, centre, across, _, about) in zip(names, links[:, :5], strict=True):
            if name in around:
                continue
            one, two = before[f"{name}_far"], after[f"{name}_far"]
            q = np.asarray(two.quaternion)
            spin = 2 * _product(_conjugate(np.asarray(one.quaternion)), q)[1:] / (2 * step)
            middle = np.array([0, 0, centre])
            places = [frame.position + turned(np.asarray(frame.quaternion), middle) for frame in (one, two)]
            velocity = (places[1] - places[0]) / (2 * step)
            inner = np.array([across - mass * centre**2] * 2 + [about])
            total += 0.5 * mass * velocity @ velocity + 0.5 * spin @ (inner * spin)
        return total

    matrix, bias = mass_matrix(inst, links, angles, speeds)
    assert energy(angles, speeds) == pytest.approx(0.5 * speeds @ matrix @ speeds, rel=1e-6)
    # Lagrange: the moments of constant rates are d/dt(M v) - dT/dq.
    by = 1e-5
    along = (
        mass_matrix(inst, links, angles + by * speeds)[0] - mass_matrix(inst, links, angles - by * speeds)[0]
    ) @ speeds
    expected = along / (2 * by)
    for joint in range(5):
        move = by * np.eye(5)[joint]
        ends = [0.5 * speeds @ mass_matrix(inst, links, angles + sign * move)[0] @ speeds for sign in (1, -1)]
        expected[joint] -= (ends[0] - ends[1]) / (2 * by)
    np.testing.assert_allclose(bias, expected, rtol=1e-5, atol=1e-6 * np.abs(expected).max())


def _conjugate(q: np.ndarray) -> np.ndarray:
    return q * [1, -1, -1, -1]


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def test_mujoco_with_a_row_of_hinges_about_both_axes_settles_where_the_statics_say() -> None:
    inst = bending(2, torsion=8e-4)
    peer = ChainPeer(inst)
    rng = np.random.default_rng(7)
    for _ in range(6):
        wrench = rng.normal(size=6) * [0.3, 0.3, 0.3, 2e-3, 2e-3, 1e-3]
        strokes = rng.uniform(-2e-4, 2e-4, 3)
        ours = tn.statics.chain.equilibrium(inst, np.zeros(0), wrench, strokes=strokes)
        theirs = peer.settle(np.zeros(0), wrench, strokes=strokes)
        for joints in inst.bends.values():
            assert degrees(abs((ours.angles - theirs.angles)[..., joints].sum())) < 0.05
        assert np.ravel(ours.tensions) == pytest.approx(theirs.tensions, abs=0.1)


def test_in_motion_it_keeps_its_energy_and_comes_to_rest_where_the_statics_say() -> None:
    inst = bending(2, torsion=8e-4)
    brought_to_rest(inst, [0.4, -0.3, 0, 0, 0, 2e-3])


def test_friction_along_it_is_that_of_its_bend_in_whichever_plane() -> None:
    base, coefficient = 12.0, 0.2
    bend = OFFSET * base * LENGTH / RIGIDITY
    wanted = degrees(log(1 + coefficient * bend) / coefficient)
    for at in (0.0, 45.0, 90.0):
        inst = bending(angles=(at,), pretension=0.0).replace(
            friction={"law": "capstan", "vertex_coefficient": coefficient, "sheath_coefficient": 0.0}
        )
        run = tn.twin.Twin(inst, quasi_static=True).run(np.zeros((6000, 0)), spool_velocity=np.full((6000, 1), 0.25))
        angles = [
            np.interp(base, run["tension"][:, 0], run[f"output_angle.bend_{plane}"]) for plane in ("yaw", "pitch")
        ]
        assert degrees(np.hypot(*angles)) == pytest.approx(wanted, abs=0.3)
        assert degrees(np.arctan2(angles[1], angles[0])) == pytest.approx(at, abs=1.0)


def test_it_is_recorded_replayed_and_written_back_as_its_file_has_it(tmp_path: Any) -> None:
    inst = bending(4, torsion=8e-4)
    text = to_toml(inst)
    assert text.count("[[joints]]") == 1
    assert tn.parse(text) == inst
    assert tn.instrument.in_arcs(inst, 4) == inst
    assert len(tn.instrument.in_arcs(inst, 1).tip_joints) == 3
    run = record(inst, tn.simulate.default_protocol(inst), tmp_path / "run.mcap", time_step=2e-3, quasi_static=True)
    back = tn.recording.Recording.open(tmp_path / "run.mcap")
    assert back.instrument() == inst
    assert replay(back).exact
    assert np.isfinite(run["output_angle.bend_pitch"]).all()


def test_it_is_drawn_as_one_line_between_its_ends() -> None:
    inst = bending(2, torsion=8e-4)
    angles = np.array([0.3, -0.2, 0.1, 0.25, 0.4])
    bent = tn.kinematics.frames(inst, angles)
    lines = list(bent.backbones.values())
    assert len(lines) == 2
    np.testing.assert_allclose(lines[0][0], 0, atol=1e-12)
    np.testing.assert_allclose(lines[0][-1], lines[1][0], atol=1e-12)
    np.testing.assert_allclose(lines[1][-1], bent.bodies["bend_yaw_arc2_far"].position, atol=1e-12)
    picture = draw(inst, angles)
    assert len(picture.axes[0].lines) == len(lines) + len(inst.tendons)


@pytest.mark.parametrize(
    ("changes", "key", "problem"),
    [
        ({"joint": {"planes": 3}}, "joints", "planes"),
        (
            {"joint": {"mechanism": "pulley", "backbone_length": None, "backbone_rigidity": None, "arcs": 1}},
            "joints",
            "planes is given",
        ),
        ({"crossing": {"side": "agonist"}}, "tendons", "side and angle are both given"),
        ({"crossing": {"radius": 20e-3}}, "tendons", "nothing would be left of it on the inner side"),
        ({"arcs": 12, "torsion": 1e-3}, "joints", "there must be 1 to 24"),
    ],
)
def test_what_no_backbone_is_is_refused(changes: dict[str, Any], key: str, problem: str) -> None:
    with pytest.raises(InstrumentError, match=problem):
        bending(**changes)


def test_in_one_arc_tendons_that_come_nearer_run_at_their_mean_distance() -> None:
    tapered = tn.instrument.in_arcs(bending(4, crossing={"far_radius": OFFSET / 2}), 1)
    mean = bending(1, crossing={"radius": 0.75 * OFFSET})
    assert tapered.tendon_arms("tip") == pytest.approx(mean.tendon_arms("tip"), rel=1e-12)

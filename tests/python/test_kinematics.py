"""The instrument in space: closed forms, MuJoCo and Pinocchio on the exported models, and the way there and back."""

import itertools

import numpy as np
import pytest
from peers import kinematics_peers as peers
from scipy.spatial.transform import Rotation

import tenodesis as tn
from tenodesis import kinematics as km
from tenodesis.kinematics.motion import COORDINATES

from .conftest import refused
from .kinematic_instruments import INSTRUMENTS, REAL, every_instrument

# A universal joint: both pulleys on one point, which makes the determinant of the Jacobian a closed form.
COMPACT = INSTRUMENTS["pulley"].replace(geometry={"joint_spacing": 0.0})


def postures(inst, count, *, seed=0, share=1.0, handle=False):
    """Random postures within the limits, or a share of them."""
    random = np.random.default_rng(seed)
    found = {key: share * random.uniform(*ends, count) for key, ends in km.limits(inst)._asdict().items()}
    found["insertion"] = random.uniform(*km.limits(inst).insertion, count)
    if handle:
        found |= {f"handle_{axis}": random.uniform(-0.6, 0.6, count) for axis in inst.axes}
    return km.Posture(**found)


def one(posture, i):
    return km.Posture(*(None if values is None else float(values[i]) for values in posture))


def matrix(quaternion):
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()


def largest_difference(inst, posture, theirs, *, left_out=()):
    """How far the bodies of our frames are from a peer's, m and as entries of rotation matrices."""
    bodies = {name: frame for name, frame in km.frames(inst, posture).bodies.items() if name not in left_out}
    assert set(bodies) <= set(theirs[0])
    worst = 0.0
    for i, poses in enumerate(theirs):
        for name, frame in bodies.items():
            position, rotation = poses[name]
            worst = max(worst, np.abs(frame.position[i] - position).max())
            worst = max(worst, np.abs(matrix(frame.quaternion[i]) - rotation).max())
    return worst


def joint_rows(inst, posture, count, format):
    return [km.joint_positions(inst, one(posture, i), format=format) for i in range(count)]


def span(path):
    return np.linalg.norm(np.diff(path, axis=-2), axis=-1).sum(axis=-1)


@every_instrument
def test_every_body_is_where_mujoco_puts_it(inst):
    posture = postures(inst, 40, handle=True)
    theirs = peers.mujoco_poses(km.mjcf(inst), joint_rows(inst, posture, 40, "mjcf"))
    # There a backbone is a row of vertebrae, which is an arc up to a high order of its bends, and has no carrier.
    rows = {f"{axis}_carrier" for axis in inst.axes if inst.joint_type == "continuum"}
    assert largest_difference(inst, posture, theirs, left_out=rows) < (5e-5 if rows else 1e-12)


@pytest.mark.slow
@every_instrument
def test_every_body_is_where_pinocchio_puts_it(inst):
    pytest.importorskip("pinocchio")
    posture = postures(inst, 40, seed=1, handle=True)
    theirs = peers.pinocchio_poses(km.urdf(inst), joint_rows(inst, posture, 40, "urdf"))
    assert largest_difference(inst, posture, theirs) < 1e-12


@every_instrument
def test_the_tip_moves_as_finite_differences_tell(inst):
    posture, step = postures(inst, 30, seed=2), 1e-4
    jacobian = km.jacobian(inst, posture)
    for column, key in enumerate(COORDINATES):
        if key in ("yaw", "pitch") and key not in inst.axes:
            assert not jacobian[..., column].any()
            continue
        moved = [
            km.forward(inst, posture._replace(**{key: getattr(posture, key) + by * step})) for by in (-2, -1, 1, 2)
        ]
        before, less, more, after = (frame.position for frame in moved)
        linear = (8 * (more - less) - (after - before)) / (12 * step)
        np.testing.assert_allclose(jacobian[:, :3, column], linear, atol=1e-11)
        before, less, more, after = (matrix(frame.quaternion) for frame in moved)
        rate = (8 * (more - less) - (after - before)) / (12 * step)
        skew = rate @ np.swapaxes(matrix(km.forward(inst, posture).quaternion), -1, -2)
        angular = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(jacobian[:, 3:, column], angular, atol=1e-10)


def test_the_tip_moves_as_pinocchio_tells():
    pytest.importorskip("pinocchio")
    posture = postures(REAL, 10, seed=3)
    ours = km.jacobian(REAL, posture)
    for i in range(10):
        theirs = peers.pinocchio_jacobian(km.urdf(REAL), km.joint_positions(REAL, one(posture, i)), "tip")
        for column, key in enumerate(COORDINATES):
            # Both halves of a rolling pair turn by half of the angle.
            halves = (theirs[f"{key}_carrier"] + theirs[f"{key}_far"]) / 2 if key in ("yaw", "pitch") else theirs[key]
            np.testing.assert_allclose(ours[i, :, column], halves, atol=1e-12)


@every_instrument
def test_the_inverse_brings_the_tip_back(inst):
    posture = postures(inst, 4000, seed=4)
    tip = km.forward(inst, posture)
    found = km.inverse(inst, *tip, posture.spin)
    again = km.forward(inst, found)
    np.testing.assert_allclose(again.position, tip.position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(matrix(again.quaternion), matrix(tip.quaternion), rtol=0, atol=1e-13)
    if len(inst.axes) == 2:
        np.testing.assert_array_equal(found.spin, posture.spin)


@pytest.mark.parametrize("name", ["real-size", "pitch first", "pitch thicker", "pulley"])
def test_the_inverse_finds_the_posture_the_tip_came_from(name):
    inst = INSTRUMENTS[name]
    posture = postures(inst, 4000, seed=5, share=0.75)
    found = km.inverse(inst, *km.forward(inst, posture), posture.spin)
    for key in COORDINATES:
        np.testing.assert_allclose(getattr(found, key), getattr(posture, key), atol=1e-11)


def test_a_goal_of_several_postures_has_the_one_that_it_starts_near():
    inst = INSTRUMENTS["continuum"]
    posture = postures(inst, 20_000, seed=6)
    tip = km.forward(inst, posture)
    other = np.abs(km.inverse(inst, *tip, posture.spin).yaw - posture.yaw) > 0.1
    assert 0 < other.mean() < 0.01
    assert np.abs(posture.pitch[other]).min() > np.radians(55)
    near = km.inverse(inst, *tip, posture.spin, near=posture)
    np.testing.assert_allclose(near.yaw, posture.yaw, atol=1e-9)


def test_one_axis_reaches_its_goals_by_spinning_and_bends_the_way_of_the_spin_that_is_given():
    inst = INSTRUMENTS["scaled-up"]
    posture = postures(inst, 500, seed=7)
    posture = posture._replace(yaw=np.abs(posture.yaw) + 0.05)
    tip = km.forward(inst, posture)
    np.testing.assert_allclose(km.inverse(inst, *tip, posture.spin).yaw, posture.yaw, atol=1e-10)
    np.testing.assert_allclose(km.inverse(inst, *tip, posture.spin + np.pi).yaw, -posture.yaw, atol=1e-10)


def test_singular_postures_are_those_of_a_universal_joint_on_a_spherical_arm():
    # With the spin held: det = s^2 cos(tilt) cos(pitch), s from the port to the universal joint.
    posture = postures(COMPACT, 200, seed=8)
    columns = [COORDINATES.index(key) for key in COORDINATES if key != "spin"]
    held = np.abs(np.linalg.det(km.jacobian(COMPACT, posture)[..., columns]))
    expected = posture.insertion**2 * np.cos(posture.tilt) * np.cos(posture.pitch)
    np.testing.assert_allclose(held, expected, rtol=1e-9)
    singular = {
        "yaw and roll turn about one axis": km.Posture(pan=0.3, yaw=0.5, pitch=np.pi / 2),
        "pan and spin turn about one axis": km.Posture(tilt=np.pi / 2, yaw=0.5, pitch=0.2),
        "the port is at the joint": km.Posture(insertion=0.0, yaw=0.5, pitch=0.2),
    }
    for posture in singular.values():
        assert abs(np.linalg.det(km.jacobian(COMPACT, posture)[:, columns])) < 1e-15


def test_the_joint_that_is_one_too_many_is_the_spin_which_rolls_a_straight_instrument():
    straight = km.jacobian(REAL, km.Posture(pan=0.4, tilt=-0.2))
    np.testing.assert_allclose(
        straight[:, COORDINATES.index("spin")], straight[:, COORDINATES.index("roll")], atol=1e-15
    )
    assert np.linalg.matrix_rank(straight) == 6
    one_axis = km.jacobian(tn.load("scaled-up"), km.Posture(pan=0.4, tilt=-0.2))
    assert np.linalg.matrix_rank(one_axis, tol=1e-9) == 5
    bent = km.jacobian(tn.load("scaled-up"), km.Posture(pan=0.4, tilt=-0.2, yaw=0.3))
    assert np.linalg.matrix_rank(bent, tol=1e-9) == 6


def test_no_posture_within_the_limits_of_the_real_size_instrument_is_singular():
    columns = [COORDINATES.index(key) for key in COORDINATES if key != "spin"]
    determinant = np.linalg.det(km.jacobian(REAL, postures(REAL, 20_000, seed=9))[..., columns])
    assert (determinant > 0).all() or (determinant < 0).all()


@pytest.mark.parametrize("name", ["real-size", "scaled-up", "pitch first"])
def test_tendons_keep_their_length_where_the_tip_follows_the_handle_without_a_load(name):
    inst = INSTRUMENTS[name]
    posture = postures(inst, 50, seed=10)
    straight, bent = km.frames(inst, km.Posture()).tendons, km.frames(inst, posture).tendons
    for tendon, path in bent.items():
        np.testing.assert_allclose(span(path), span(straight[tendon]), rtol=0, atol=1e-13)


def test_tendons_stretch_by_what_their_tensions_tell():
    inst = REAL.axis("yaw")
    handle, force = np.linspace(-0.5, 0.5, 11), 1.0
    state = tn.statics.equilibrium(inst, handle, force)
    straight = km.frames(inst, km.Posture()).tendons
    drawn = km.frames(inst, km.Posture(yaw=state.output_angle, handle_yaw=handle)).tendons
    for tendon, tension in (("yaw_agonist", state.agonist), ("yaw_antagonist", state.antagonist)):
        stretch = span(drawn[tendon]) - span(straight[tendon])
        expected = np.maximum(inst.pretension + inst.tendon_stiffness * stretch, 0)
        np.testing.assert_allclose(tension, expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("name", ["pulley", "continuum"])
def test_tendons_are_drawn_by_the_radius_times_the_angle(name):
    inst = INSTRUMENTS[name]
    for axis, radius in (("yaw", 2e-3), ("pitch", 2e-3)):
        moved = {
            angle: km.frames(inst, km.Posture(**{axis: angle, "handle_yaw": 0.0, "handle_pitch": 0.0})).tendons
            for angle in (0.0, 0.6)
        }
        for side, sign in (("agonist", -1), ("antagonist", 1)):
            drawn = span(moved[0.6][f"{axis}_{side}"]) - span(moved[0.0][f"{axis}_{side}"])
            assert drawn == pytest.approx(sign * radius * 0.6, rel=0.02)


def test_lengths_add_up_to_the_overall_length():
    for name, joints in (("real-size", 4 * 2e-3 + 4e-3 + 4 * 4.5e-3 + 9e-3), ("scaled-up", 2 * 7.5e-3 + 2 * 16.875e-3)):
        inst = tn.load(name)
        lengths = km.dimensions(inst)
        total = lengths.stem_length + lengths.handle_length + lengths.end_effector_length + joints
        assert total == pytest.approx(inst.overall_length, abs=1e-15)
        ends = km.frames(inst, km.Posture()).bodies
        assert ends["tip"].position[2] - ends["grip"].position[2] == pytest.approx(inst.overall_length, abs=1e-15)


def test_the_port_stays_on_the_stem():
    posture = postures(REAL, 100, seed=11)
    stem = km.frames(REAL, posture).bodies["stem"]
    along = matrix(stem.quaternion)[..., 2]
    np.testing.assert_allclose(stem.position, posture.insertion[:, None] * along, atol=1e-15)


def test_arguments_broadcast_and_numbers_give_single_frames():
    tip = km.forward(REAL, km.Posture(pan=np.zeros((3, 1)), yaw=np.linspace(0, 1, 4)))
    assert (tip.position.shape, tip.quaternion.shape) == ((3, 4, 3), (3, 4, 4))
    assert km.jacobian(REAL, km.Posture(roll=np.zeros(5))).shape == (5, 6, 7)
    found = km.inverse(REAL, tip.position, tip.quaternion, np.zeros((2, 1, 1)))
    assert np.shape(found.pan) == (2, 3, 4)
    single = km.inverse(REAL, tip.position[0, 1], tip.quaternion[0, 1])
    assert isinstance(single.yaw, float)
    view = km.frames(REAL, km.Posture())
    assert view.bodies["tip"].position.shape == (3,)
    assert view.tendons["pitch_agonist"].shape[-1] == 3


def test_a_handle_that_cannot_bend_so_far_has_no_frames():
    inst = REAL.replace(handle_range=0.3)
    view = km.frames(inst, km.Posture(yaw=1.3))
    assert np.isnan(view.bodies["grip"].position).any()
    assert np.isfinite(view.bodies["tip"].position).all()
    assert np.isfinite(km.frames(inst, km.Posture(yaw=1.3, handle_yaw=0.3)).bodies["grip"].position).all()


@pytest.mark.parametrize(
    ("change", "key", "value"),
    [({"pan": np.nan}, "pan", np.nan), ({"yaw": 3.5}, "yaw", 3.5), ({"roll": "far"}, "roll", "far")],
)
def test_bad_coordinates_are_named(change, key, value):
    with refused(key, value):
        km.forward(REAL, km.Posture(**change))


def test_coordinates_must_broadcast():
    with pytest.raises(ValueError, match=r"do not broadcast: pan \(2,"):
        km.forward(REAL, km.Posture(pan=np.zeros(2), roll=np.zeros(3)))


def test_what_is_no_posture_or_no_instrument_is_named():
    tip = ([0.0, 0.0, 0.2], [1.0, 0.0, 0.0, 0.0])
    for call in (lambda: km.forward(REAL, (0, 0)), lambda: km.within_limits(REAL, {"pan": 0})):
        with pytest.raises(TypeError):
            call()
    with pytest.raises(TypeError):
        km.inverse(REAL, *tip, near=(0.0, 0.0))
    for call in (km.dimensions, km.limits, km.workspace, km.urdf, km.mjcf, lambda inst: km.inverse(inst, *tip)):
        with pytest.raises(TypeError):
            call(3)
    with refused("pan", "far"):
        km.within_limits(REAL, km.Posture(pan="far"))
    assert km.within_limits(REAL, km.Posture(pan=np.nan)) is False


@pytest.mark.parametrize(
    ("argument", "value"), [("force", "much"), ("force", np.inf), ("force", -1.0), ("points", 2.5), ("points", 1)]
)
def test_a_workspace_of_no_load_or_no_points_is_refused(argument, value):
    with refused(argument, value):
        km.workspace(REAL, **{argument: value})


@pytest.mark.parametrize("bend", [0.0, 0.4])
def test_one_axis_finds_a_posture_where_it_is_straight_too(bend):
    inst = tn.load("scaled-up")
    tip = km.forward(inst, km.Posture(pan=0.2, tilt=-0.1, yaw=bend, roll=0.7))
    again = km.forward(inst, km.inverse(inst, *tip, 0.3))
    np.testing.assert_allclose(again.position, tip.position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(matrix(again.quaternion), matrix(tip.quaternion), rtol=0, atol=1e-13)


def test_an_axis_that_is_not_there_cannot_bend():
    with refused("pitch", 0.1):
        km.forward(tn.load("scaled-up"), km.Posture(pitch=0.1))


def test_goals_that_cannot_be_reached_are_named_alone_and_nan_in_arrays():
    upright = [1.0, 0.0, 0.0, 0.0]
    with refused("goal", kind=tn.NoSolutionError):
        km.inverse(REAL, [0.0, 0.0, 0.03], upright)
    both = km.inverse(REAL, [[0.0, 0.0, 0.03], [0.0, 0.0, 0.2]], upright)
    assert np.isnan(both.pan).tolist() == [True, False]
    with refused("goal", kind=tn.NoSolutionError):
        km.inverse(REAL, [0.0, 0.0, 0.2], [0.0, 1.0, 0.0, 0.0])  # it would have to look back at the port
    for far in (1e7, -1e200):
        with refused("position", far):
            km.inverse(REAL, [[0.0, 0.0, 0.2], [0.0, far, 0.0]], upright)
    with refused("quaternion", 2.0):
        km.inverse(REAL, [0.0, 0.0, 0.2], [2.0, 0.0, 0.0, 0.0])
    with refused("position", (2,)):
        km.inverse(REAL, [0.0, 0.2], upright)


def test_limits_are_those_of_the_file():
    inst = REAL.replace(geometry={"pivot_range": "30 deg", "least_insertion": "60 mm", "most_insertion": "200 mm"})
    assert km.limits(inst).tilt == pytest.approx((-np.radians(30), np.radians(30)))
    inside = km.within_limits(inst, km.Posture(pan=np.radians([0, 29, 31]), insertion=0.2))
    assert inside.tolist() == [True, True, False]
    assert km.within_limits(inst, km.Posture(insertion=0.21)) is False
    assert km.within_limits(inst, km.Posture(yaw=inst.output_range)) is True


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"geometry": {"least_insertion": 0.2, "most_insertion": 0.1}}, "least_insertion is 0.2 m"),
        ({"geometry": {"pivot_range": "95 deg"}}, "geometry.pivot_range"),
        ({"geometry": {"length": 1.0}}, "geometry.length is not a known key"),
    ],
)
def test_bad_geometry_is_named(changes, sentence):
    with pytest.raises(tn.InstrumentError, match=sentence):
        REAL.replace(**changes)


def test_an_instrument_without_room_for_a_stem_says_so():
    with refused("overall_length", 0.2, tn.InstrumentError):
        km.dimensions(REAL.replace(overall_length=0.2))
    assert km.dimensions(REAL.replace(overall_length=0.2, geometry={"stem_length": 0.3})).stem_length == 0.3
    with refused("geometry.insertion", 0.29, tn.InstrumentError):
        km.dimensions(REAL.replace(geometry={"insertion": 0.29}))


def test_without_bending_the_workspace_is_a_sector():
    inst = REAL.replace(output_range="0.01 deg")
    space = km.workspace(inst, points=201)
    lengths, bounds = km.dimensions(inst), km.limits(inst)
    beyond = km.forward(inst, km.Posture(insertion=1.0)).position[2] - 1.0
    least, most = (insertion + beyond for insertion in bounds.insertion)
    assert space.area == pytest.approx(bounds.pan[1] * (most**2 - least**2), rel=0.02)
    assert lengths.end_effector_length < beyond


def test_the_workspace_holds_what_random_postures_reach_and_what_they_point_to():
    inst = REAL.axis("yaw")
    space = km.workspace(inst)
    posture = postures(inst, 5000, seed=12)._replace(tilt=0.0, spin=0.0, roll=0.0)
    tip = km.forward(inst, posture).position
    distance, angle = np.hypot(tip[:, 0], tip[:, 2]), np.arctan2(tip[:, 0], tip[:, 2])
    rows = np.abs(space.angle[:, None] - angle).argmin(axis=0)
    columns = np.abs(space.distance[:, None] - distance).argmin(axis=0)
    assert (space.span[rows, columns] > 0).mean() > 0.98
    assert space.span.max() <= 2 * space.bend + 2 * km.limits(inst).pan[1]
    np.testing.assert_allclose(space.span, space.span[::-1], atol=np.radians(1.5))


def test_a_load_shrinks_the_workspace_by_what_it_takes_of_the_output_angle():
    spaces = [km.workspace(REAL, force) for force in (0.0, 1.0, 2.0, 3.0)]
    for less, more in itertools.pairwise(spaces):
        assert (more.span <= less.span + 1e-12).all()
        assert more.mean_span <= less.mean_span
    assert spaces[-1].bend < spaces[0].bend == REAL.output_range
    handle = REAL.handle_range
    assert spaces[-1].bend == pytest.approx(tn.statics.output_angle(REAL.axis("yaw"), handle, 3.0), abs=1e-9)


def test_a_joint_may_be_named_as_a_coordinate_of_the_stem_is():
    inst = tn.load("hybrid-real-size")
    names = {"yaw": "roll", "pitch": "insertion", "jaw": "pan"}

    def renamed(value, key=""):
        if isinstance(value, dict):
            return {inner: renamed(one, inner) for inner, one in value.items()}
        if isinstance(value, list | tuple):
            return [renamed(one, key) for one in value]
        return names.get(value, value) if key in ("name", "on", "joint", "jaws") else value

    values = inst.model_dump(exclude_unset=True)
    other = inst.replace(**{key: renamed(values[key]) for key in ("joints", "tendons", "grip")})
    assert [joint.name for joint in other.tip_joints] == ["roll", "insertion", "pan"]
    for ours, theirs in zip(km.tip_pose(other, [0.3, -0.2, 0.1]), km.tip_pose(inst, [0.3, -0.2, 0.1]), strict=True):
        np.testing.assert_array_equal(ours, theirs)

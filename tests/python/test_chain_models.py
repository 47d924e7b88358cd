"""Poses of joints and tendons, and their models for other programs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from peers.kinematics_peers import mujoco_poses
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis import instrument, kinematics
from tenodesis.cli.app import app
from tenodesis.instrument import FullForm, expanded
from tenodesis.kinematics import Port, Posture
from tenodesis.statics import chain

from .chain_samples import LISTED, backbone, drawn, holds, jaws
from .kinematic_instruments import INSTRUMENTS

SHIPPED = [instrument.expanded(name) for name in LISTED]
SAMPLES = [*SHIPPED, jaws(), backbone(), *(drawn(seed) for seed in range(4))]
every_sample = pytest.mark.parametrize("inst", SAMPLES, ids=lambda inst: inst.name)


def bent(inst: FullForm, points: int = 3) -> tuple[Any, Any]:
    """Return random angles of the tip and of the handle, (points, joints)."""
    random = np.random.default_rng(2)
    return tuple(
        random.uniform(-1, 1, (points, len(joints))) * [joint.range for joint in joints]
        for joints in (inst.tip_joints, inst.handle_joints)
    )


def apart(inst: FullForm, text: str, format: Any) -> float:
    """Return how far MuJoCo's bodies in a model are from the frames, m and in quaternions, at most."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_string(text)
    data, worst = mujoco.MjData(model), 0.0
    names = {model.body(place).name for place in range(model.nbody)}
    for tip, handle in zip(*bent(inst), strict=True):
        positions = kinematics.joint_positions(inst, tip, handle, format=format)
        assert {model.joint(place).name for place in range(model.njnt)} == set(positions)
        for name, value in positions.items():
            data.joint(name).qpos[0] = value
        mujoco.mj_forward(model, data)
        found = kinematics.frames(inst, tip, handle).bodies
        # MuJoCo merges URDF links that a fixed joint ties.
        for name in names & set(found):
            turned = data.body(name).xquat * np.sign(data.body(name).xquat @ found[name].quaternion)
            worst = max(worst, np.abs(turned - found[name].quaternion).max())
            worst = max(worst, np.abs(data.body(name).xpos - found[name].position).max())
        assert {f"{joint.name}_far" for joint in inst.joints} <= names
    return worst


@every_sample
def test_links_of_the_urdf_are_where_the_frames_are(inst: FullForm) -> None:
    assert apart(inst, kinematics.urdf(inst), "urdf") < 1e-12


@every_sample
def test_bodies_of_the_mujoco_model_are_where_the_frames_are(inst: FullForm) -> None:
    has_row = any(joint.mechanism == "continuum" for joint in inst.joints)
    # A row of vertebrae is an arc up to a high order of its bends.
    assert apart(inst, kinematics.mjcf(inst), "mjcf") < (2e-5 if has_row else 1e-12)


def test_the_model_as_written_follows_its_controls_to_where_the_statics_are() -> None:
    mujoco = pytest.importorskip("mujoco")
    inst = instrument.expanded("hybrid-real-size")
    handle, stroke, force = [0.2, -0.15, 0.3], 5e-4, 0.4
    model = mujoco.MjModel.from_xml_string(kinematics.mjcf(inst))
    data = mujoco.MjData(model)
    for joint, angle in zip(inst.handle_joints, handle, strict=True):
        data.actuator(joint.name).ctrl[0] = angle / (2 if joint.mechanism == "tendon-gear" else 1)
    data.actuator("yaw_agonist").ctrl[0] = stroke
    data.actuator("pitch_force_y").ctrl[0] = force
    mujoco.mj_step(model, data, 3000)
    assert np.abs(data.qvel).max() < 1e-6
    strokes = np.array([stroke if tendon.name == "yaw_agonist" else 0.0 for tendon in inst.tendons])
    rest = chain.equilibrium(inst, handle, [0, force, 0, 0, 0, 0], strokes=strokes)
    positions = kinematics.joint_positions(inst, rest.angles, handle, format="mjcf")
    found = {name: float(data.joint(name).qpos[0]) for name in positions}
    assert found == pytest.approx(positions, abs=np.radians(1e-3))
    tensions = [-float(data.actuator(tendon.name).force[0]) for tendon in inst.tendons]
    assert tensions == pytest.approx(list(rest.tensions), rel=1e-4)


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_joints_and_tendons_of_a_planar_file_have_its_poses_without_the_port(name: str) -> None:
    planar = INSTRUMENTS[name]
    inst = expanded(planar)
    tip, handle = bent(inst)
    port = Port(pan=0.3, tilt=-0.2, spin=0.4, insertion=0.1, roll=0.7)
    angles = {joint.name: tip[:, i] for i, joint in enumerate(inst.tip_joints)}
    angles |= {joint.name: handle[:, i] for i, joint in enumerate(inst.handle_joints)}
    posture = Posture(**port._asdict(), **angles)
    theirs, ours = kinematics.frames(planar, posture).bodies, kinematics.frames(inst, tip, handle, port=port).bodies
    last = planar.axes[-1]
    for mine, other in ((f"{last}_tip", "tip"), (f"handle_{last}_grip", "grip"), (f"{last}_far", f"{last}_far")):
        np.testing.assert_array_equal(ours[mine].position, theirs[other].position)
        np.testing.assert_array_equal(ours[mine].quaternion, theirs[other].quaternion)


@pytest.mark.parametrize("inst", [SHIPPED[0], jaws(), backbone()], ids=lambda inst: inst.name)
def test_a_port_in_the_file_places_the_stem_in_frames_and_models(inst: FullForm) -> None:
    ported = inst.replace(geometry={"pivot_range": 1.0, "insertion": 0.04, "least_insertion": 0.02})
    port = Port(pan=0.3, tilt=-0.2, spin=0.4, insertion=0.05, roll=0.6 if len(inst.bearing) == 1 else 0.0)
    tip, handle = (angles[0] for angles in bent(ported))
    ours = kinematics.frames(ported, tip, handle, port=port).bodies
    assert kinematics.frames(ported, 0.0).bodies["stem"].position[2] == 0.04
    for format, text in (("urdf", kinematics.urdf(ported)), ("mjcf", kinematics.mjcf(ported))):
        mujoco = pytest.importorskip("mujoco")
        positions = kinematics.joint_positions(ported, tip, handle, port=port, format=format)
        assert {"pan", "tilt", "spin", "insertion"} <= set(positions)
        (poses,) = mujoco_poses(text, [positions])
        has_row = format == "mjcf" and any(joint.mechanism == "continuum" for joint in inst.joints)
        for name in set(poses) & set(ours):
            np.testing.assert_allclose(ours[name].position, poses[name][0], atol=5e-5 if has_row else 1e-12)
        assert {f"{joint.name}_far" for joint in inst.joints} <= set(poses)
        if format == "mjcf":
            model = mujoco.MjModel.from_xml_string(text)
            data = mujoco.MjData(model)
            mujoco.mj_resetDataKeyframe(model, data, 0)
            assert data.joint("insertion").qpos[0] == data.actuator("insertion").ctrl[0] == 0.04


@pytest.mark.parametrize("inst", [inst for inst in SAMPLES if holds(inst)], ids=lambda inst: inst.name)
def test_the_jacobian_gives_the_moments_by_which_the_statics_answer_a_wrench(inst: FullForm) -> None:
    handle = np.full((1, len(inst.handle_joints)), 0.1)
    rest = chain.equilibrium(inst, handle)
    assert rest.status[0] == tn.statics.Status.OK
    answer = chain.rates(inst, handle, axes="stem")
    moments = kinematics.jacobian(inst, rest.angles).mean(axis=-3).swapaxes(-1, -2)
    np.testing.assert_allclose(answer.stiffness @ answer.by_wrench, moments, atol=1e-12)


def test_a_tendon_ends_where_it_meets_its_last_joint_whatever_the_angles() -> None:
    driver = instrument.expanded("needle-driver")
    tip, _ = bent(driver, 5)
    paths, bodies = kinematics.frames(driver, tip).tendons, kinematics.frames(driver, tip).bodies
    ends = np.linalg.norm(paths["jaw_1_wound"][:, -1] - bodies["jaw_1_far"].position, axis=-1)
    np.testing.assert_allclose(ends, driver.tip_joints[1].radius)
    assert kinematics.tip_pose(driver, tip).position.shape == (5, 2, 3)


@pytest.mark.parametrize(("name", "ends"), [("two-segment-continuum", 1), ("hybrid-real-size", 2)])
def test_the_picture_in_space_shows_the_ends_that_have_joints_and_every_tendon(name: str, ends: int) -> None:
    inst = instrument.expanded(name)
    figure = tn.plot.posture(inst, *(angles[0] for angles in bent(inst, 1)))
    assert [axis.get_title() for axis in figure.axes] == ["handle", "tip"][-ends:]
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [tendon.name for tendon in inst.tendons]


@pytest.mark.parametrize("angles", [[0.0, 0.0, np.nan], [0.0, 0.0, 4.0], [0.0, 0.0]], ids=["nan", "wide", "two"])
def test_angles_that_are_none_are_refused(angles: list[float]) -> None:
    with pytest.raises(tn.ArgumentError, match="angles"):
        kinematics.tip_pose("needle-driver", angles)


@pytest.mark.parametrize(("kind", "lost"), [("urdf", "- tendons:"), ("mjcf", "- friction of the tendons")])
def test_export_writes_the_model_and_says_what_is_lost(
    kind: str, lost: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["export", kind, "two-segment-continuum"])
    (file,) = tmp_path.iterdir()
    inst = instrument.expanded("two-segment-continuum")
    assert file.read_text("utf-8") == (kinematics.urdf if kind == "urdf" else kinematics.mjcf)(inst)
    assert lost in done.output
    assert "the arc of a backbone" in done.output

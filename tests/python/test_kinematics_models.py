"""The instrument's models for others, URDF and MJCF, as MuJoCo, Pinocchio and ROS read them."""

import re
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import kinematics as km
from tenodesis.kinematics.chain import skeleton
from tenodesis.kinematics.parts import moving

from .kinematic_instruments import INSTRUMENTS, REAL, every_instrument


@every_instrument
def test_the_urdf_is_a_tree_and_its_mimics_name_their_joints(inst):
    text = km.urdf(inst)
    root = ElementTree.fromstring(text)
    links = [link.get("name") for link in root.findall("link")]
    assert len(set(links)) == len(links)
    children = [joint.find("child").get("link") for joint in root.findall("joint")]
    parents = [joint.find("parent").get("link") for joint in root.findall("joint")]
    assert sorted([*children, "port"]) == sorted(links)
    assert set(parents) <= set(links)
    names = {joint.get("name") for joint in root.findall("joint")}
    mimics = {joint.get("name"): joint.find("mimic") for joint in root.findall("joint")}
    mimics = {name: mimic.get("joint") for name, mimic in mimics.items() if mimic is not None}
    assert set(mimics.values()) <= names
    halved = {joint.name for joint in tn.instrument.expanded(inst).joints if joint.mechanism != "pulley"}
    assert {name.rsplit("_", 1)[0] for name in mimics} == halved


def test_what_a_format_does_not_carry_is_said_in_it():
    assert re.search(r"does not contain.*tendons.*rolling contact.*friction", km.urdf(REAL), re.DOTALL)
    assert re.search(r"does not contain.*rolling contact.*friction", km.mjcf(REAL), re.DOTALL)
    for inst in INSTRUMENTS.values():
        assert ("the arc of a backbone" in km.mjcf(inst)) == ("the arc of a backbone" in km.urdf(inst))


@pytest.mark.parametrize("name", tn.shipped())
def test_every_instrument_that_is_shipped_makes_models_that_load(name):
    mujoco, pinocchio = pytest.importorskip("mujoco"), pytest.importorskip("pinocchio")
    inst = tn.load(name)
    joints, in_mujoco = (set(km.joint_positions(inst, 0.0, format=format)) for format in ("urdf", "mjcf"))
    model = mujoco.MjModel.from_xml_string(km.mjcf(inst))
    assert {model.joint(n).name for n in range(model.njnt)} == in_mujoco
    assert set(pinocchio.buildModelFromXML(km.urdf(inst)).names) - {"universe"} == joints


@every_instrument
def test_the_urdf_loads_in_mujoco_and_pinocchio_with_the_same_masses(inst):
    mujoco, pinocchio = pytest.importorskip("mujoco"), pytest.importorskip("pinocchio")
    text = km.urdf(inst)
    theirs, other = mujoco.MjModel.from_xml_string(text), pinocchio.buildModelFromXML(text)
    assert {theirs.joint(n).name for n in range(theirs.njnt)} == set(other.names) - {"universe"}
    data = mujoco.MjData(theirs)
    mujoco.mj_forward(theirs, data)
    full = np.zeros((theirs.nv, theirs.nv))
    mujoco.mj_fullM(theirs, data, full)
    ours = pinocchio.crba(other, other.createData(), np.zeros(other.nq))
    ours = np.triu(ours) + np.triu(ours, 1).T
    order = [other.joints[other.getJointId(theirs.joint(n).name)].idx_v for n in range(theirs.njnt)]
    np.testing.assert_allclose(full, ours[np.ix_(order, order)], rtol=1e-6, atol=1e-10)


@pytest.mark.process
@every_instrument
def test_the_urdf_is_read_by_the_parser_of_ros(inst, tmp_path):
    check = shutil.which("check_urdf", path=str(Path(sys.executable).parent)) or shutil.which("check_urdf")
    if check is None:
        pytest.skip("check_urdf is not installed")
    (tmp_path / "inst.urdf").write_text(km.urdf(inst), "utf-8")
    done = subprocess.run([check, tmp_path / "inst.urdf"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Successfully Parsed XML" in done.stdout


@every_instrument
def test_the_tip_of_the_urdf_has_the_inertia_of_the_file(inst):
    pinocchio = pytest.importorskip("pinocchio")
    model = pinocchio.buildModelFromXML(km.urdf(inst.replace(**{"dynamics.tip_inertia": 3.3e-6})))
    full = pinocchio.crba(model, model.createData(), np.zeros(model.nq))
    full = np.triu(full) + np.triu(full, 1).T
    turning = np.zeros(model.nv)
    hinges = [
        name
        for name in km.joint_positions(inst, 0.0)
        if name in moving(skeleton(inst), tn.instrument.expanded(inst).tip_joints[-1], "urdf")
    ]
    turning[[model.joints[model.getJointId(name)].idx_v for name in hinges]] = 1 / len(hinges)
    assert turning @ full @ turning == pytest.approx(3.3e-6, rel=1e-2)


@pytest.mark.parametrize("name", ["real-size", "scaled-up", "pulley"])
def test_the_mujoco_model_settles_where_the_statics_tell(name):
    mujoco = pytest.importorskip("mujoco")
    inst = INSTRUMENTS[name]
    model = mujoco.MjModel.from_xml_string(km.mjcf(inst))
    # The second joint, straight, lengthens the arm of a force about the first.
    arm = np.diff([km.frames(inst, km.Posture()).bodies[body].position[2] for body in ("yaw_far", "tip")])[0]
    alone = inst.axis("yaw").replace(end_effector_length=arm)
    hinges = {joint.name: moving(skeleton(inst), joint, "mjcf") for joint in tn.instrument.expanded(inst).joints}
    for handle, force in ((0.3, 0.0), (0.3, 0.5)):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        data.actuator("handle_yaw").ctrl[0] = handle / len(hinges["handle_yaw"])
        data.actuator("tip_force_x").ctrl[0] = -force
        mujoco.mj_step(model, data, 2000)
        assert np.abs(data.qvel).max() < 1e-6
        held, yaw = (sum(data.joint(name).qpos[0] for name in hinges[key]) for key in ("handle_yaw", "yaw"))
        assert held == pytest.approx(handle, abs=1e-3)
        assert np.degrees(yaw) == pytest.approx(np.degrees(tn.statics.output_angle(alone, held, force)), abs=1e-4)

"""Claims about tool files of the da Vinci Research Kit: what is read reproduces the file's matrix, or is refused."""

import json
import math
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.errors import InstrumentError
from tenodesis.instrument import FullForm, JawAngle, dvrk_text, from_dvrk, jaw_reading, parse
from tenodesis.run import Array
from tenodesis.statics import coupling

from .conftest import Command, refused

# jhu-dvrk/sawIntuitiveResearchKit, share/tool/NAME.json: coupling.ActuatorToJointPosition.
MATRICES = {
    "LARGE_NEEDLE_DRIVER_400006": [
        [-1.5632, 0, 0, 0],
        [0, 1.0186, 0, 0],
        [0, -0.8306, 0.6089, 0.6089],
        [0, 0, -1.2177, 1.2177],
    ],
    "PROGRASP_FORCEPS_420093": [
        [-1.5631, 0, 0, 0],
        [0, 1, 0, 0],
        [0, -0.5068, -0.5135, -0.5135],
        [0, 0, -0.5279, 0.5279],
    ],
}
SPATULA = [[-1.5632, 0, 0, 0], [0, 1.1353, 0, 0], [0, 0.7827, -1.0582, 0], [0, 0, 0, 1]]
"""PERMANENT_CAUTERY_SPATULA_400184 of the same place: no jaws, and a last disk that is not used."""


def content(matrix: Any, **changes: Any) -> dict[str, Any]:
    """Return what a tool file has, with the limits and lengths of LARGE_NEEDLE_DRIVER_400006."""
    limits = {"qmin": -1.39626, "qmax": 1.39626}
    return {
        "DH": {"joints": [{"qmin": -4.53786, "qmax": 4.53786, "D": 0.4162}, limits, {**limits, "A": 0.0091}]},
        "jaw": {"qmin": -0.698132, "qmax": 1.39626, "ftmax": 0.16},
        "coupling": {"ActuatorToJointPosition": matrix},
        **changes,
    }


def write(folder: Path, values: Any, name: str = "LARGE_NEEDLE_DRIVER_400006") -> Path:
    """Write a tool file with the comments that such files have."""
    path = folder / f"{name}.json"
    path.write_text('/* -*- Mode: "x" -*- */ // {\n' + json.dumps(values, indent=1).replace(",\n", ", // a//b\n"))
    return path


def by_turns(inst: FullForm, jaws: float = 1.0) -> Array:
    """Return roll, pitch, yaw and jaw by the turns of the disks, each of which winds one tendon and unwinds another.

    The jaw angle is a number of times the angle between the jaws.
    """
    assert inst.spool_radius is not None
    drawn = np.kron(np.eye(len(inst.tip_joints)), [[inst.spool_radius], [-inst.spool_radius]])
    angles = coupling(inst) @ drawn
    if inst.grip is None:
        return angles
    return np.vstack([angles[:2], angles[2:].mean(axis=0), jaws * (angles[2] - angles[3])])


@pytest.mark.parametrize("name", MATRICES)
def test_rigid_coupling_is_the_files_matrix(tmp_path: Path, name: str) -> None:
    path = write(tmp_path, content(MATRICES[name]), name)
    for radius in (2.5e-3, 4e-3):
        inst = from_dvrk(path, pulley_radius=radius)
        assert by_turns(inst) == pytest.approx(np.array(MATRICES[name]), abs=1e-9)
        assert inst.tip_joints[1].radius == pytest.approx(radius)
    assert inst.name == name.lower().replace("_", "-")


@pytest.mark.parametrize("seed", range(5))
def test_rigid_coupling_is_any_invertible_matrix(tmp_path: Path, seed: int) -> None:
    matrix = np.random.default_rng(seed).normal(size=(4, 4))
    assert by_turns(from_dvrk(write(tmp_path, content(matrix.tolist())))) == pytest.approx(matrix, abs=1e-9)


TOOLS = Path(os.environ.get("TENODESIS_DATA", Path(__file__).parents[3] / "shared" / "data")) / "dvrk-tools"


@pytest.mark.data
@pytest.mark.skipif(not TOOLS.is_dir(), reason=f"no tool files in {TOOLS} (set TENODESIS_DATA)")
def test_every_published_tool_file_is_read_and_turns_as_its_matrix_says() -> None:
    paths = [path for path in sorted(TOOLS.glob("*.json")) if path.name != "index.json"]
    assert len(paths) == 54
    for path in paths:
        inst = from_dvrk(path)
        text = re.sub(r"//[^\n]*|/\*.*?\*/", " ", path.read_text("utf-8"), flags=re.DOTALL)
        matrix = np.array(json.loads(text)["coupling"]["ActuatorToJointPosition"], float)
        assert inst.spool_radius is not None
        disks = len(inst.tendons) // 2
        angles = coupling(inst) @ np.kron(np.eye(disks), [[inst.spool_radius], [-inst.spool_radius]])
        if "pitch_2" in inst.joints[-3].name:
            found = np.vstack([angles[:3], 2 * angles[5]])
        elif inst.grip is None:
            found, matrix = angles, matrix[:3, :3]
        else:
            found = np.vstack([angles[:2], angles[2:].mean(axis=0), angles[2] - angles[3]])
        assert found == pytest.approx(matrix, abs=1e-9), path.name


PROGRASP = MATRICES["PROGRASP_FORCEPS_420093"]


def test_a_jaw_angle_of_each_jaw_is_the_files_matrix_too_and_half_of_that_between_them(tmp_path: Path) -> None:
    path = write(tmp_path, content(PROGRASP))
    inst = from_dvrk(path, jaw_angle="each")
    assert by_turns(inst, 0.5) == pytest.approx(np.array(PROGRASP), abs=1e-9)
    assert inst.tip_joints[2].range == pytest.approx(2 * 1.39626)
    alone = from_dvrk(path, jaw_angle="pulleys")
    assert by_turns(alone, 0.5279 / 0.5135 / 2) == pytest.approx(np.array(PROGRASP), abs=1e-9)
    # of the tendons that turn jaws, each turns one
    arms = np.abs(alone.tendon_arms("tip")[:, 2:])
    assert arms.min(axis=1) == pytest.approx(0.0, abs=1e-15) and (arms.max(axis=1)[-4:] > 1e-3).all()
    with refused("jaw_angle", "both"):
        from_dvrk(path, jaw_angle="both")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("jaw_angle", "here", "there"), [("between", 32, [1, 0]), ("each", 1, [32, 0]), ("pulleys", 0, [32, 1])]
)
def test_the_reading_of_the_jaw_angle_is_said_with_what_the_other_ones_mean(
    tmp_path: Path, tenodesis: Command, jaw_angle: JawAngle, here: int, there: list[int]
) -> None:
    path = write(tmp_path, content(PROGRASP))
    said = jaw_reading(path, jaw_angle)
    assert said is not None
    assert [int(number) for number in re.findall(r"(\d+) %", said)] == [here, *there]
    code, printed, _ = tenodesis("import", "dvrk", path, "--out", tmp_path / "a.toml", "--jaw-angle", jaw_angle)
    assert code == 0 and said in " ".join(printed.split())
    assert said in (tmp_path / "a.toml").read_text("utf-8").replace("\n# ", " ")
    assert tn.load(tmp_path / "a.toml") == from_dvrk(path, jaw_angle=jaw_angle)


def test_a_tool_without_jaws_has_three_angles(tmp_path: Path) -> None:
    values = content(SPATULA, jaw={"qmin": 0.0, "qmax": 0.5, "ftmax": 0.0})
    inst = from_dvrk(write(tmp_path, values))
    assert by_turns(inst) == pytest.approx(np.array(SPATULA)[:3, :3], abs=1e-9)
    assert inst.grip is None
    assert jaw_reading(tmp_path / "LARGE_NEEDLE_DRIVER_400006.json") is None


def test_limits_and_lengths_are_the_files(tmp_path: Path) -> None:
    inst = from_dvrk(write(tmp_path, content(MATRICES["LARGE_NEEDLE_DRIVER_400006"])))
    roll, pitch, *jaws = inst.tip_joints
    assert math.degrees(roll.range) == pytest.approx(179)
    assert pitch.range == pytest.approx(1.39626)
    assert all(jaw.range == pytest.approx(1.5 * 1.39626) and jaw.offset == pytest.approx(0.0091) for jaw in jaws)
    assert inst.stem_length == pytest.approx(0.4162)


def test_the_command_writes_what_the_function_reads(tmp_path: Path, tenodesis: Command) -> None:
    path, out = write(tmp_path, content(MATRICES["LARGE_NEEDLE_DRIVER_400006"])), tmp_path / "driver.toml"
    code, said, _ = tenodesis("import", "dvrk", path, "--out", out, "--pulley-radius", "3 mm")
    assert code == 0 and "8 tendons, angles roll, pitch, jaw_1, jaw_2" in said
    assert tn.instrument.expanded(out) == from_dvrk(path, pulley_radius=3e-3)
    code, _, error = tenodesis("import", "dvrk", path, "--out", out)
    assert code == 1 and "exists already" in error
    assert tenodesis("import", "dvrk", path, "--out", out, "--overwrite")[0] == 0


GOOD = MATRICES["LARGE_NEEDLE_DRIVER_400006"]


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ([], "is no object of keys; it must be a tool file of the da Vinci Research Kit, JSON."),
        (content(GOOD, coupling={}), "coupling.ActuatorToJointPosition is missing; it must be given."),
        (content(np.eye(7).tolist()), "has the shape (7, 7); it must be 4 rows of 4 finite numbers."),
        (content([[1, 2], [3]]), "is no matrix of numbers; it must be 4 rows of 4 finite numbers."),
        (content([*GOOD[:3], [0, 0, 0, math.nan]]), "has a number that is not finite"),
        (
            content([*GOOD[:3], GOOD[2]]),
            "is singular: turns of the disks leave every angle unchanged; it must be regular.",
        ),
        (
            content(SPATULA, **{"snake-like": True, "jaw": {"qmin": 0.0, "qmax": 0.5, "ftmax": 0.0}}),
            "snake-like is true, but jaw.ftmax is 0; it must be a tool with jaws.",
        ),
        (
            content(GOOD, DH={"joints": []}),
            "qmin and qmax of DH.joints, roll are missing; they must be two finite numbers",
        ),
        (
            content(GOOD, jaw={"qmin": "0", "qmax": 1}),
            "qmin and qmax of jaw are ['0', 1]; they must be two finite numbers",
        ),
        (content(GOOD, jaw={"ftmax": 0}), "jaw.ftmax is 0, but coupling.ActuatorToJointPosition couples the jaw"),
    ],
)
def test_a_malformed_file_is_refused_in_one_sentence(tmp_path: Path, values: Any, sentence: str) -> None:
    path = write(tmp_path, values)
    with pytest.raises(InstrumentError, match=re.escape(sentence)) as problem:
        from_dvrk(path)
    assert str(problem.value).startswith(f"{path}: ") and "\n" not in str(problem.value)


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (b"<robot/>", "is not JSON: Expecting value"),
        (b"[" * 100_000, "is not JSON"),
        (b"\xff\xfe", "is not UTF-8 text; it must be a tool file"),
    ],
)
def test_what_is_no_json_is_refused_in_one_sentence(tmp_path: Path, data: bytes, sentence: str) -> None:
    path = tmp_path / "tool.json"
    path.write_bytes(data)
    with pytest.raises(InstrumentError, match=re.escape(sentence)):
        from_dvrk(path)
    with pytest.raises(InstrumentError, match="cannot be read: No such file"):
        from_dvrk(tmp_path / "none.json")


def test_the_text_names_what_it_assumes(tmp_path: Path) -> None:
    text = dvrk_text(write(tmp_path, content(GOOD)))
    assert parse(text).sources["joints.radius"].startswith("ours:")
    assert "LARGE_NEEDLE_DRIVER_400006.json" in text.splitlines()[0]

"""Tip poses of another solver against the instrument: an elastica by SciPy, and files that are wrong."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis import poses, statics
from tenodesis.cli.app import app
from tenodesis.errors import ArgumentError, IdentificationError
from tenodesis.statics import chain
from tests.peers import elastica

from .conftest import tables

ROOT = Path(__file__).parents[2]
FILE, POSES = ROOT / "examples/backbone.toml", ROOT / "examples/backbone_poses.csv"
INST = tn.instrument.expanded(FILE)
BEYOND = 10e-3
POSITION = "x [mm],y [mm],z [mm]"
TENSIONS = "tension.agonist [N],tension.antagonist [N]"


def _elastica(stiffness: float, pretension: float = 5.0) -> elastica.Backbone:
    return elastica.Backbone(40e-3, 1e-3, 2e-3, stiffness, pretension, BEYOND)


def _tip(found: elastica.Tip) -> tuple[float, float, float]:
    return found.x + BEYOND * np.sin(found.angle), 0.0, found.z + BEYOND * np.cos(found.angle)


def _file(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def test_the_example_is_met_to_half_a_percent() -> None:
    found = poses.compare(FILE, POSES)
    assert found.solved == len(found.error) == 12
    assert found.error.max() < 0.005 * found.length
    assert np.degrees(np.abs(found.angle_error).max()) < 0.1
    assert np.allclose(found.tensions, found.given.tensions, atol=1e-6)
    assert poses.compare(FILE, POSES, arcs=1).error.max() > 10 * found.error.max()


def test_the_examples_poses_are_those_of_the_elastica() -> None:
    given = poses.load(POSES, INST)
    soft = _elastica(1e-4)
    for tension, wrench, place in zip(given.tensions, given.wrench, given.position, strict=True):
        tip = elastica.tip(soft, (wrench[0], wrench[2]), wrench[4], (tension - soft.pretension) / soft.stiffness)
        assert np.allclose(_tip(tip), place, atol=2e-8)


def test_strokes_are_met(tmp_path: Path) -> None:
    tendon = _elastica(float(INST.stiffnesses[0]))
    rows = []
    for wound, force in ((1e-3, 0.0), (2e-3, 0.4), (-1.5e-3, -0.6)):
        x, y, z = _tip(elastica.tip(tendon, (force, 0.0), 0.0, (wound, -wound)))
        rows.append(f"{1e3 * wound},{-1e3 * wound},{force},0,0,{x},{y},{z}")
    path = _file(tmp_path / "p.csv", "stroke.agonist [mm],stroke.antagonist [mm],fx,fy,fz,x,y,z", *rows)
    found = poses.compare(FILE, path)
    assert found.given.driven == "stroke"
    assert found.error.max() < 0.005 * found.length


def test_two_planes_are_compared_in_space(tmp_path: Path) -> None:
    two = tn.instrument.expanded("two-segment-continuum")
    near, far = tables(two, "joints")
    inst = two.replace(joints=[near, far | {"axis": "pitch"}])
    strokes = np.array([4e-4, -4e-4, 7e-4, -7e-4])
    angles = np.asarray(chain.equilibrium(inst, 0.0, strokes=strokes).output_angle)
    where = tn.kinematics.tip_pose(inst, angles)
    assert min(np.abs(where.position[0, :2])) > 1e-3
    w, *vector = where.quaternion[0]
    turn = 2 * np.arctan2(np.linalg.norm(vector), w) * np.array(vector) / np.linalg.norm(vector)
    heads = ",".join(f"stroke.{tendon.name}" for tendon in inst.tendons)
    for direction, values in (("qw,qx,qy,qz", where.quaternion[0]), ("rx,ry,rz", turn)):
        row = ",".join(repr(float(value)) for value in (*strokes, *where.position[0], *values))
        found = poses.compare(inst, _file(tmp_path / "p.csv", f"{heads},x,y,z,{direction}", row))
        assert found.error.max() < 1e-9
        assert found.angle_error is not None
        assert found.angle_error.max() < 1e-7
    turned = np.array(where.quaternion[0]) * [1, 1, -1, 1]
    row = ",".join(repr(float(value)) for value in (*strokes, *where.position[0] * [-1, 1, 1], *turned))
    off = poses.compare(inst, _file(tmp_path / "p.csv", f"{heads},x,y,z,qw,qx,qy,qz", row))
    assert off.error[0] == pytest.approx(2 * abs(where.position[0, 0]))


def test_a_map_names_the_columns(tmp_path: Path) -> None:
    path = _file(tmp_path / "fem.csv", "T1;T2;X;Y;Z", "15;5;22,338;0;42,835")
    (tmp_path / "fem.csv.columns.toml").write_text(
        '"tension.agonist" = { column = "T1", unit = "N" }\n"tension.antagonist" = { column = "T2", unit = "N" }\n'
        + "".join(f'{name} = {{ column = "{name.upper()}", unit = "mm" }}\n' for name in "xyz")
    )
    assert poses.compare(FILE, path).error[0] < 1e-6


def test_tensions_held_are_the_tensions() -> None:
    rng = np.random.default_rng(3)
    inst = tn.instrument.in_arcs("two-segment-continuum")
    wanted = rng.uniform(0, 8, (20, 4))
    wanted[0, 0] = 0.0
    wrench = np.zeros((20, 6))
    wrench[:, 0] = rng.uniform(-0.3, 0.3, 20)
    strokes = statics.strokes_at_tensions(inst, wanted, 0.0, wrench)
    assert np.allclose(chain.equilibrium(inst, 0.0, wrench, strokes=strokes).tensions, wanted, atol=1e-6)
    assert statics.strokes_at_tensions(inst, wanted[3], wrench=wrench[3]) == pytest.approx(strokes[3], abs=1e-12)
    for wrong in (-1.0, np.nan):
        with pytest.raises(ArgumentError) as caught:
            statics.strokes_at_tensions(inst, [1.0, 1.0, 1.0, wrong])
        assert caught.value.key == "tensions"


@pytest.mark.parametrize(
    ("key", "lines"),
    [
        ("position", ["x,y", "0,0"]),
        ("tension", [f"tension.agonist,{POSITION}", "5,0,0,50"]),
        ("a heading", [f"tension.third,{POSITION}", "5,0,0,50"]),
        ("rows", [POSITION]),
        ("row 2: z", [POSITION, "0,0,50", "0,0,nan"]),
        ("row 1: z", [POSITION, "0,0"]),
        ("row 1: x", [POSITION, "a,0,50"]),
        ("row 1: tension.antagonist", [f"{TENSIONS},{POSITION}", "5,-1,0,0,50"]),
        ("position", [POSITION.replace("mm", "m"), "0,0,50"]),
        ("the unit of x", [POSITION.replace("mm", "N"), "0,0,50"]),
        ("quaternion", [f"{POSITION},qw,qx,qy,qz", "0,0,50,1,1,0,0"]),
        ("quaternion", [f"{POSITION},angle,qw,qx,qy,qz", "0,0,50,0,1,0,0,0"]),
        ("tension", [f"{TENSIONS},stroke.agonist,stroke.antagonist,{POSITION}", "5,5,0,0,0,0,50"]),
        ("x", [f"{POSITION},x [mm]", "0,0,50,0"]),
        ("poses", [f"fx,fy,fz,mx,my,mz,{POSITION}", "0,0,0,0,500,0,0,0,50"]),
    ],
)
def test_a_file_that_is_wrong_is_refused_in_a_sentence(tmp_path: Path, key: str, lines: list[str]) -> None:
    path = _file(tmp_path / "poses.csv", *lines)
    with pytest.raises(IdentificationError) as caught:
        poses.compare(FILE, path)
    assert caught.value.key.endswith(key)
    assert str(caught.value).endswith(".")


def test_the_command_prints_json_and_writes_a_page(tmp_path: Path) -> None:
    out, picture = tmp_path / "page.html", tmp_path / "tips.png"
    wanted = ["compare", str(FILE), str(POSES), "--out", str(out), "--picture", str(picture), "--json"]
    done = CliRunner().invoke(app, wanted)
    assert done.exit_code == 0, done.output
    answer = json.loads(done.stdout)
    assert answer["summary"]["largest [%]"] < 0.5
    assert len(answer["rows"]) == 12
    assert "<svg" in out.read_text("utf-8")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert CliRunner().invoke(app, wanted[:3]).exit_code == 0

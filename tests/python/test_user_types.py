"""Claims about the types that a user's own code gets from a strict type checker."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import tenodesis as tn
from tenodesis.instrument import JOINT_TYPES, ShortForm

SOURCE = Path(tn.__file__).parents[1]

EXPECTED = {
    "inst": "Instrument",
    "inst.distal_gear_radius": "float",
    "inst.proximal_gear_radius": "float",
    "inst.distal_pulley_radius": "float",
    "inst.proximal_pulley_radius": "float",
    "inst.distal_tendon_offset": "float",
    "inst.backbone_length": "float",
    "inst.backbone_rigidity": "float",
    "inst.arcs": "int",
    "inst.friction.vertex_coefficient": "float",
    "inst.replace(pretension=20.0)": "Instrument",
    "run": "Run",
    'run["output_angle"]': "ndarray[tuple[Any, ...], dtype[float64]]",
    "run[1.0:2.0]": "Run",
    "run.fault_times": "dict[str, float]",
    "run.plot()": "Figure",
    "tn.plot.loss('mine.toml')": "Figure",
    "front[0]": "Design",
    "front[:10]": "Front",
    "front[[True, False]]": "Front",
    "front.sorted_by('overall_length')": "Front",
    "tn.similarity.compare('real-size', inst).errors['scaled'].largest": "float",
    "tn.control.Controller(inst).step(0.0, 0.0, [25.0, 25.0], [0.0, 0.0]).state": "OperatingState",
    "tn.kinematics.forward(inst, tn.kinematics.Posture()).position": "ndarray[tuple[Any, ...], dtype[float64]]",
}
BEFORE = """from pathlib import Path

import numpy as np

import tenodesis as tn

inst: tn.InstrumentLike = tn.load("real-size")
inst = tn.load(inst)
run = tn.twin.Twin(Path("mine.toml")).run(np.zeros(10), force=0.5)
front = tn.scaling.design("real-size")
angle: float = tn.statics.output_angle("real-size", 0.1)
"""
REFUSED = {
    "tn.control.Controller(inst, law='none')": "arg-type",
    "tn.statics.reach(3)": "arg-type",
    "inst.tip_radius": "attr-defined",
}


def test_every_dimension_of_a_mechanism_is_among_the_expected_types() -> None:
    own = {name for kind in JOINT_TYPES.values() for name in kind.model_fields} - set(ShortForm.model_fields)
    assert {f"inst.{name}" for name in own} <= set(EXPECTED)


@pytest.mark.slow
@pytest.mark.process
def test_a_users_code_is_typed_strictly(tmp_path: Path) -> None:
    file = tmp_path / "mine.py"
    reveals = [f"reveal_type({expression})" for expression in EXPECTED]
    file.write_text(BEFORE + "\n".join([*reveals, *REFUSED]) + "\n", "utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--no-error-summary", "--cache-dir", str(tmp_path / "cache")]
    found = subprocess.run(
        [*command, file.name],
        cwd=tmp_path,
        env=os.environ | {"MYPYPATH": str(SOURCE)},
        capture_output=True,
        text=True,
        check=False,
    ).stdout.splitlines()
    revealed = [re.search(r'Revealed type is "(.*)"', line) for line in found]
    short = [re.sub(r"[\w.]+\.(\w)", r"\1", one[1]) for one in revealed if one]
    assert dict(zip(EXPECTED, short, strict=True)) == EXPECTED
    errors = [re.search(r"error: .*\[([\w-]+)\]$", line) for line in found]
    assert [one[1] for one in errors if one] == list(REFUSED.values())

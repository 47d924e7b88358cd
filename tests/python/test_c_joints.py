"""Claims about the C interface of all joints from instrument file to numbers: exported, compiled, beside Python's."""

import ctypes
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import control, twin
from tenodesis.instrument import FullForm, expanded
from tenodesis.run import Array

from .conftest import ROOT

COMPILER = os.environ.get("CXX") or shutil.which("c++")
C_COMPILER = os.environ.get("CC") or shutil.which("cc")
TICKS = 1000
REALS = {"double": (ctypes.c_double, 1e-9, 1e-9), "float": (ctypes.c_float, np.radians(1e-3), 0.01)}
"""Type, and how far angles (rad) and all else, over its largest value, may be from Python's."""

pytestmark = [pytest.mark.process, pytest.mark.skipif(COMPILER is None, reason="needs a C++ compiler")]


def tool(coefficient: float) -> FullForm:
    """Return the needle driver with friction."""
    own = dict.fromkeys(("sheath_coefficient", "vertex_coefficient"), coefficient)
    return expanded("needle-driver").replace(friction={"law": "capstan", "sheath_bend": 0.35, **own})


@pytest.fixture(scope="module")
def assumed() -> FullForm:
    return tool(0.1)


@pytest.fixture(scope="module")
def readings(assumed: FullForm) -> dict[str, Array]:
    """Readings of a closed loop under a force, and what Python's controller makes of them."""
    way = np.clip(np.arange(TICKS) / 400, 0, 1)[:, np.newaxis]
    target = way * np.array([0.3, 0.4, -0.2])
    wrench = np.clip(np.arange(TICKS) / 100 - 5, 0, 1)[:, np.newaxis] * np.array([2.0, -1.0, 0, 0, 0, 0])
    run = twin.Twin(tool(0.12), seed=3).run(
        np.zeros((TICKS, 0)), controller=control.JointController(assumed), target=target, wrench=wrench
    )
    first = {"measured_tension": assumed.pretensions, "measured_spool_angle": np.zeros(6)}
    tension, spool = (np.vstack([row, run[name][:-1]]) for name, row in first.items())
    own, found = control.JointController(assumed), []
    for tick in range(TICKS):
        output = own.step(tension[tick], spool[tick], target=target[tick])
        load = output.estimate.load
        found.append(np.concatenate([output.spool_velocity, output.estimate.angle, load, [output.state]]))
    return {"tension": tension, "spool_angle": spool, "target": target, "found": np.array(found)}


@pytest.mark.parametrize("real", REALS)
def test_an_exported_controller_gives_what_python_does(
    real: str, assumed: FullForm, readings: dict[str, Array], tmp_path: Path
) -> None:
    number, of_angle, of_all = REALS[real]
    header = tmp_path / "tool.h"
    control.export_joints_header(assumed, header, "tool", own_clock=True, shows_load=True)
    # C++ gives a constant of its own to a program in C.
    source = tmp_path / "tool.c"
    source.write_text('#include "tool.h"\nconst tenodesis_joints_parameters* parameters(void) { return &tool; }\n')
    real_of_both = [f"-DTENODESIS_REAL={real}", f"-I{ROOT / 'include'}", "-fPIC", "-c"]
    flags = ["-std=c99", "-pedantic-errors", "-Wall", "-Wextra", "-Werror"]
    subprocess.run([C_COMPILER or "cc", *flags, *real_of_both, "tool.c"], cwd=tmp_path, check=True)
    core = [str(ROOT / "src/c/joints.cpp"), "-std=c++20", "-O1", "-fno-math-errno", "-include", str(header)]
    subprocess.run([str(COMPILER), *core, *real_of_both], cwd=tmp_path, check=True)
    subprocess.run([str(COMPILER), "-shared", "tool.o", "joints.o", "-o", "tool.so"], cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "tool.so"))
    library.parameters.restype = ctypes.c_void_p
    word = ctypes.c_uint32
    fields = {"time": ctypes.c_uint64, "request": word, "reserved": word, "handle_angle": number * 3}
    given = _struct(**fields, target=number * 3, tension=number * 6, spool_angle=number * 6)
    state = {"state": word, "faults": word, "first_faults": word, "cut_power": word}
    angles = {"output_angle": number * 3, "output_angle_std": number * 3, "friction": number * 2}
    output = _struct(**state, spool_velocity=number * 6, **angles, load=number * 7, load_std=number * 7)()
    controller = (ctypes.c_uint64 * 20000)()
    assert library.tenodesis_joints_init(controller, ctypes.c_void_p(library.parameters())) == 0
    found = []
    for tick in range(TICKS):
        one = given(request=int(tick == 0))
        for name in ("target", "tension", "spool_angle"):
            getattr(one, name)[:] = readings[name][tick]
        assert library.tenodesis_joints_step(controller, ctypes.byref(one), ctypes.byref(output)) == 0
        found.append([*output.spool_velocity, *output.output_angle, *output.load, output.state])
    expected = readings["found"]
    off = np.abs(np.array(found) - expected)
    assert np.all(expected[:, -1] == control.OperatingState.ENABLED) and np.all(off[:, -1] == 0)
    assert np.max(off[:, 6:9]) < of_angle
    assert np.all(np.max(off, axis=0) <= of_all * np.max(np.abs(expected), axis=0) + 1e-12)


def test_an_exported_header_refuses_other_sizes(assumed: FullForm, tmp_path: Path) -> None:
    (tmp_path / "tool.h").write_text(control.joints_header(assumed, "tool"))
    command = [str(COMPILER), "-std=c++20", f"-I{ROOT / 'include'}", "-DTENODESIS_JOINTS=4", "-fsyntax-only", "tool.h"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert "another instrument's size: TENODESIS_JOINTS" in done.stderr


@pytest.mark.parametrize("name", ["two-segment-continuum", "hybrid-real-size", "real-size", "maryland-dissector"])
def test_every_instrument_has_a_header(name: str) -> None:
    inst = expanded(name)
    text = control.joints_header(inst)
    assert f"#define TENODESIS_JOINTS {len(inst.tip_joints)}\n" in text
    assert text.count(".handle_arm = ") == len(inst.tendons)
    assert tn.load(name).name in text


def _struct(**fields: Any) -> Any:
    return type("Struct", (ctypes.Structure,), {"_fields_": list(fields.items())})

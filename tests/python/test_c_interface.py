"""Claims about the C interface from instrument file to last bit: exported, compiled, run beside Python's."""

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
from tenodesis.instrument import Instrument

from .conftest import EXAMPLES, ROOT

COMPILER = os.environ.get("CXX") or shutil.which("c++")
REALS = {"double": ctypes.c_double, "single": ctypes.c_float}

pytestmark = [pytest.mark.process, pytest.mark.skipif(COMPILER is None, reason="needs a C++ compiler")]


class Interface:
    """The C interface in one precision, with the exported parameters of some instruments."""

    def __init__(self, library: ctypes.CDLL, real: Any) -> None:
        measurement = _struct(handle_angle=real, tension=real * 2, spool_angle=real * 2)
        axis = _struct(
            spool_velocity=real * 2,
            output_angle=real,
            output_angle_std=real,
            tip_force=real,
            tip_force_std=real,
            friction_scale=real,
            friction_scale_std=real,
            faults=ctypes.c_uint32,
            reserved=ctypes.c_uint32,
        )
        word = ctypes.c_uint32
        self.library, self.real = library, real
        self.input = _struct(time=ctypes.c_uint64, request=word, reserved=word, axis=measurement * 2)
        self.output = _struct(
            axis=axis * 2, state=word, homed=word, homing=word, faults=word, first_faults=word, reserved=word
        )
        self.controller = ctypes.c_uint64 * (512 * ctypes.sizeof(real))

    def start(self, name: str) -> Any:
        controller = self.controller()
        assert self.library.tenodesis_init(controller, ctypes.byref(ctypes.c_char.in_dll(self.library, name))) == 0
        return controller


def _struct(**fields: Any) -> Any:
    return type("Struct", (ctypes.Structure,), {"_fields_": list(fields.items())})


CASES: dict[str, tuple[str | Path, dict[str, Any]]] = {
    "gear": ("scaled-up", {}),
    "two_axes": ("real-size", {}),
    "pulley": (EXAMPLES / "pulley.toml", {}),
    "continuum": (EXAMPLES / "continuum.toml", {}),
    "exact": ("scaled-up", {"observer": "exact", "law": "exact"}),
    "paper": ("real-size", {"observer": "paper", "law": "paper-feedback", "actuation": "agonist"}),
}


@pytest.fixture(scope="module")
def interfaces(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Interface]:
    assert COMPILER is not None
    folder = tmp_path_factory.mktemp("c")
    source = ['#include "tenodesis/tenodesis.h"']
    for name, (inst, choices) in CASES.items():
        control.export_header(inst, folder / f"{name}.h", name, homed=True, **choices)
        source += [f'#include "{name}.h"', f"extern const tenodesis_parameters exported_{name};"]
        source += [f"const tenodesis_parameters exported_{name} = {name};"]
    (folder / "exported.cpp").write_text('extern "C" {\n' + "\n".join(source) + "\n}\n")
    running = {}
    for precision, name in (("double", "double"), ("single", "float")):
        command = [COMPILER, "-std=c++20", "-O1", "-shared", "-fPIC", "-fno-math-errno", "-ffp-contract=off"]
        command += [f"-DTENODESIS_REAL={name}", f"-I{ROOT / 'include'}", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
        files = [str(folder / "exported.cpp"), str(ROOT / "src/c/tenodesis.cpp")]
        running[precision] = subprocess.Popen([*command, *files, "-o", str(folder / f"{precision}.so")])
    for process in running.values():
        assert process.wait() == 0
    return {p: Interface(ctypes.CDLL(str(folder / f"{p}.so")), REALS[p]) for p in running}


def _closed_loop(inst: Instrument, ctl: control.Controller, seconds: float) -> tn.Run:
    """Return what a controller has seen and done on a loaded twin."""
    time = np.arange(1, round(seconds / twin.TIME_STEP) + 1) * twin.TIME_STEP
    shape = (len(time), len(inst.axes)) if len(inst.axes) > 1 else (len(time),)
    handle = np.empty(shape)
    handle.T[:] = 0.3 * np.sin(4 * time)
    force = np.zeros(shape)
    force[len(time) // 3 :] = 0.3
    return twin.Twin(inst, seed=1).run(handle, force, controller=ctl)


@pytest.mark.parametrize("precision", REALS)
@pytest.mark.parametrize("name", CASES)
def test_c_equals_python_to_the_last_bit(interfaces: dict[str, Interface], name: str, precision: Any) -> None:
    inst, choices = tn.load(CASES[name][0]), CASES[name][1]
    c = interfaces[precision]
    controller = c.start(f"exported_{name}")
    python = control.Controller(inst, precision=precision, enabled=False, **choices)
    axes = len(inst.axes)
    run = _closed_loop(inst, control.Controller(inst, **choices), 0.8)
    handle = np.asarray(run.measured_handle_angle).reshape(-1, axes)
    tension = np.asarray(run.measured_tension).reshape(-1, axes, 2)
    spool = np.asarray(run.measured_spool_angle).reshape(-1, axes, 2)
    tension[len(tension) * 9 // 10, 0, 0] = np.nan
    moved = 0
    states = set()
    for tick in range(len(handle)):
        request = control.Request.ENABLE if tick == 0 else control.Request.NONE
        given = c.input(time=500_000 * tick, request=int(request))
        for n in range(axes):
            given.axis[n].handle_angle = handle[tick, n]
            given.axis[n].tension[:] = tension[tick, n]
            given.axis[n].spool_angle[:] = spool[tick, n]
        got = c.output()
        assert c.library.tenodesis_step(controller, ctypes.byref(given), ctypes.byref(got)) == 0
        one = (tick, slice(None)) if axes > 1 else (tick, 0)
        out = python.step(tick * 5e-4, handle[one], tension[one], spool[one], request)
        assert (got.state, bool(got.homed)) == (out.state, out.homed)
        assert control.controller.fault_names(got.faults) == out.faults
        expected = np.column_stack(
            [np.reshape(out.spool_velocity, (axes, 2)), *(np.reshape(value, axes) for value in out[1:7])]
        )
        axis = [got.axis[n] for n in range(axes)]
        values = [[*one.spool_velocity, *(getattr(one, key) for key in out._fields[1:7])] for one in axis]
        np.testing.assert_array_equal(np.array(values), expected)
        moved += bool(np.any(expected[:, :2]))
        states.add(got.state)
    assert moved > 100
    assert states >= {control.OperatingState.ENABLED, control.OperatingState.FAULT}


def test_memory_of_the_other_precision_is_refused(interfaces: dict[str, Interface]) -> None:
    double, single = interfaces["double"], interfaces["single"]
    memory = double.start("exported_gear")
    for library, code in ((double.library, 0), (single.library, 2)):
        assert library.tenodesis_reset(memory) == code
    assert single.library.tenodesis_watchdog(memory, 0) == 1
    parameters = ctypes.byref(ctypes.c_char.in_dll(single.library, "exported_gear"))
    assert double.library.tenodesis_init(memory, parameters) == 3
    assert double.library.tenodesis_reset(memory) == 2

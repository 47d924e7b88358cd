"""One joint moves as a twin did that was written for one alone, whatever it is made of.

Its results are those of before the twin of joints and tendons took its place (commit fe92ac7): by case, after 600 and
1200 steps.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tenodesis import _core
from tenodesis.run import Array
from tenodesis.twin import TIME_STEP

RECORDED = np.loadtxt(Path(__file__).parents[1] / "recordings/one_joint.csv", delimiter=",", skiprows=1)
AXIS = {
    "proximal_radius": 9e-3, "distal_radius": 4e-3, "end_effector_length": 0.05, "given_stiffness": np.nan,
    "tendon_modulus": 6e10, "tendon_diameter": 0.5e-3, "tendon_length": 0.4, "pretension": 20,
    "backbone_length": 0.03, "backbone_rigidity": 1e-3,
}  # fmt: skip
TWIN = {
    "vertex_coefficient": 0.15, "sheath_coefficient": 0.1, "sheath_bend": 0.4, "sheath_bend_rate": 0.3, "viscous": 2,
    "constant": 0.2, "static_ratio": 1.5, "stribeck_speed": 1e-3, "memory": 5e-3, "base_wrap": 0.1, "load_index": 0.8,
    "reference_tension": 10, "vertex_radius_ratio": 0.7, "bending_loss": 0.05, "handle_length_share": 0.2,
    "handle_span_ratio": 1.3, "tip_span_ratio": 0.8, "stiffness_ratio": 0.9, "pretension_ratio": 1.1,
    "tip_inertia": 6e-5, "tip_damping": 2e-3, "output_stop": 1.3, "stop_stiffness": 10, "hand_damping": 0.05,
    "hand_inertia": 2e-3, "spool_radius": 5e-3, "spool_speed_limit": 20, "spool_acceleration_limit": 400,
    "drive_time_constant": 0.01, "backlash": 0.02, "rig_pulley_radius": 0.015, "encoder_noise": 1e-4,
    "encoder_range": 6.28, "encoder_resolution": 1e-5, "handle_encoder_offset": 0.01, "output_encoder_offset": -0.02,
    "motor_encoder_resolution": 1e-4, "load_cell_noise": 0.01, "load_cell_range": 400, "load_cell_resolution": 1e-3,
    "agonist_load_cell_gain": 1.02, "antagonist_load_cell_gain": 0.97, "agonist_load_cell_bias": 0.1,
    "antagonist_load_cell_bias": -0.2, "time_step": TIME_STEP, "gear_efficiency": 0.8, "friction_torque": 2e-3,
    "torque_ripple": 0.02, "ripple_rate": 30, "thermal_drift": 0.05, "thermal_time": 10,
}  # fmt: skip
CASES: list[dict[str, Any]] = [
    {"radial": True},
    {"speed_dependent": True},
    {"tension_dependent": True},
    {"vertices": 2},
    {"vertices": 2, "sheath": 3, "currents": True},
    {"hand": 8, "currents": True},
    {"tissue": True},
    {"tissue": True, "hand": 8, "radial": True},
    {"slack": True},
]


def spec_of(joint: _core.JointType, still: bool, of: dict[str, Any]) -> _core.TwinSpec:
    more = {
        "anchor_share": 0.01 if of.get("vertices") == 2 else 0.0,
        "hand_stiffness": of.get("hand", 0.0),
        "tension_gain": 1.05 if "currents" in of else 1.0,
    }
    row = [(TWIN | more)[name] for name in _core.twin_parameters()]
    axis = _core.Spec(joint, [AXIS.get(name, 0.0) for name in _core.parameters()], 1.2)
    laws = "speed_dependent" in of, "tension_dependent" in of
    return _core.TwinSpec(axis, row, *laws, of.get("sheath", 1), of.get("vertices", 1), 2, still, "currents" in of)


def commands_of(twin: _core.Twin, of: dict[str, Any]) -> Array:
    t = np.arange(1200)[:, np.newaxis] * TIME_STEP
    start, slack = np.minimum(1, 10 * t), "slack" in of

    def wave(rate: float, phase: float) -> Array:
        return np.asarray(np.sin(6.283 * rate * t + phase) - np.sin(phase))

    out = np.where((t > 0.1) & (t < 0.5), 1.5e-3, 0.0) if slack else np.where(t > 0.3, [0, 1e-4], 0.0)
    place = np.where(t > 0.4, 0.0, 0.1)
    tissue = np.concatenate([place, np.where(t < 0.4, 2000, -2000), np.full_like(t, 5)], 1) * ("tissue" in of)
    given = {
        "handle_angle": 0.25 * start * wave(1.5, 0.3),
        "force": 0.4 * start * wave(2.3, 1) * (not slack or t > 0.35),
        "radial_force": 0.5 * start * wave(1.1, 2) * ("radial" in of),
        "weight": 1.0 * (t > 0.3) * (not slack),
        "spool_velocity": np.concatenate([np.where(t > 0.15, 0.3, 0.0), np.where(t > 0.2, -0.2, 0.1)], 1),
        "sheath_bend": 0.2 * wave(0.8, 0) * (t > 0.1),
        "let_out": out,
        "contact": tissue * (t > 0.05),
    }
    blocks = [np.broadcast_to(given.get(name, 0.0), (len(t), width)) for name, width in twin.commands]
    return np.ascontiguousarray(np.concatenate(blocks, axis=1), float)


@pytest.mark.parametrize("case", range(len(CASES)), ids=[" ".join(of) for of in CASES])
@pytest.mark.parametrize("still", [False, True], ids=["in motion", "at rest"])
@pytest.mark.parametrize("joint", list(_core.JointType)[:3], ids=lambda joint: joint.name)
def test_it_moves_as_the_twin_that_was_written_for_one(joint: _core.JointType, still: bool, case: int) -> None:
    of = CASES[case]
    twin = _core.axes_twin([spec_of(joint, still, of)], [5])
    commands = commands_of(twin, of)
    columns = np.cumsum([0, *(width for _, width in twin.signals)])
    at = dict(zip((name for name, _ in twin.signals), columns, strict=False))
    # That twin ended its searches for the handle's angle and, where tendons go slack, for the tip's, within 1e-11 rad,
    # from which velocities differ.
    searches = not still and ("hand" in of or "slack" in of)
    allowed = [5e-8, 1e-5, 1e-5, 5e-7, 2e-7] if searches else [1e-9, 1e-7, 1e-7, 1e-8, 1e-8]
    first = 2 * (case + len(CASES) * (still + 2 * list(_core.JointType).index(joint)))
    friction = 0.0
    for half, expected in zip((commands[:600], commands[600:]), RECORDED[first : first + 2], strict=True):
        out, energy = np.empty((600, columns[-1])), np.zeros(len(_core.energies()))
        assert twin.run(half, out, energy) == (600, _core.Status.OK)
        total = dict(zip(_core.energies(), energy, strict=True))
        friction += total["friction"]
        places = [at["output_angle"], at["tension"], at["distal_tension"] + 1, at["handle_torque"]]
        found = [*out[-1, places], friction]
        assert (np.abs(found - expected) < allowed).all()
        assert total["worst_residual"] < 1e-9

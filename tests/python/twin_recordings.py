"""Recordings of twins whose truth is known, for tests of identification."""

import dataclasses

import numpy as np

import tenodesis as tn
from tenodesis.identification import FORMATS, Fit, fit, measured
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.twin_model.problem import TwinProblem
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run

STEP = 5e-4
RADII = ("distal_gear_radius", "distal_pulley_radius")
MISMATCH = {
    "mismatch.stiffness_ratio": 0.85,
    "mismatch.pretension_ratio": 1.1,
    "mismatch.output_encoder_offset": np.radians(-1.4),
}
TRUTH = {
    "stiffness_ratio": 0.85,
    "pretension_ratio": 1.1,
    "handle_length_share": 0.16,
    "friction.vertex_coefficient": 0.13,
    "friction.sheath_coefficient": 0.07,
    "mismatch.output_encoder_offset": np.radians(-1.4),
}
KEYS = {name: value for name, value in TRUTH.items() if name.startswith("friction")}


NOMINAL = tn.load("scaled-up").replace(mismatch=None, **{"friction.sheath_bend": 1.0})
"""What the file says."""
TRUE = NOMINAL.replace(**MISMATCH, **KEYS)
"""What is on the bench."""


def commands(inst: Instrument, seconds: float = 3.0) -> tuple[Array, Array]:
    """Return handle angle and force: cycles of falling amplitude under a load that comes and goes."""
    time = np.arange(1, int(seconds / STEP) + 1) * STEP
    way = 2 / np.pi * np.arcsin(np.sin(1.5 * np.pi * time)) * (1 - 0.6 * time / seconds)
    radius = next((getattr(inst, key) for key in RADII if hasattr(inst, key)), 1e-3)
    force = 0.2 * inst.pretension * radius / inst.end_effector_length
    return 0.75 * inst.handle_range * way, force * (1 - np.cos(4 * np.pi * time / seconds))


def recorded(
    inst: Instrument, seed: int = 0, *, seconds: float = 3.0, distal: bool = True, commanded: bool = True
) -> InstrumentRun:
    """Return a recording of a twin."""
    handle, force = commands(inst, seconds)
    return columns(tn.twin.Twin(inst, time_step=STEP, seed=seed).run(handle, force), distal=distal, commanded=commanded)


def columns(run: Run, *, distal: bool = True, commanded: bool = True) -> InstrumentRun:
    """Return a run as a recording, without a distal encoder, or with the handle's encoder instead of the command."""
    found = measured(run, name="recording")
    columns = dict(found.columns)
    del columns["radial_force"]
    if not distal:
        del columns["measured_output_angle"]
    if not commanded:
        columns["handle_angle"] = columns.pop("measured_handle_angle")
    return dataclasses.replace(found, columns=columns)


def problem(runs: InstrumentRun | list[InstrumentRun], inst: Instrument, law: str = "capstan") -> TwinProblem:
    built = FORMATS["mcap"].problem(runs if isinstance(runs, list) else [runs], [], law=law, instrument=inst)
    assert isinstance(built, TwinProblem)
    return built


def start(one: TwinProblem, **changes: float) -> Array:
    values = {parameter.name: parameter.start for parameter in one.parameters} | changes
    assert len(values) == len(one.parameters)
    return np.array(list(values.values()))


def found_again(run: InstrumentRun, inst: Instrument = NOMINAL, names: list[str] | None = None) -> Fit:
    return fit(problem(run, inst), names or list(TRUTH), train=[0], starts=1)


def deviations(found: Fit, truth: dict[str, float]) -> dict[str, float]:
    return {name: (found.values[name] - truth[name]) / found.std[name] for name in found.free if name in truth}

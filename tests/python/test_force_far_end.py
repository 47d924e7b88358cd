"""Claims about the far end of a transmission from its near end: the core's estimator, and a tool on recordings."""

import json
import math
import os
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import IdentificationError
from tenodesis.identification.datasets import davinci_posture, davinci_tool
from tenodesis.identification.force import ForceModel, fit_force
from tenodesis.identification.force.model import (
    Band,
    Bands,
    ForceBench,
    Signal,
    bench_of,
    checked,
    from_json,
    predicted,
    series_of,
    to_json,
    unknowns,
)
from tenodesis.identification.force.report import RunResult, assess, bounds_of, pooled, traces
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.run import Array
from tenodesis.tendon import far_end

from .conftest import Command, refused
from .dataset_files import TORQUE, table, write

RATE = 100
BENCH = ForceBench(load=1.0, jaw=-1.0, current=1.0, jaw_load=1.0, middle=0.5)
TOOL = {
    "near_compliance": 0.1,
    "compliance": 0.3,
    "far_compliance": 1.0,
    "far_stiffness": 0.02,
    "near_friction": 0.01,
    "friction_exponent": 0.4,
    "pretension": 0.06,
    "joint_friction": 0.005,
    "play": 0.03,
}


def stroke(seconds: float = 12.0, frequency: float = 0.2) -> Array:
    time = np.arange(round(seconds * RATE)) / RATE
    return -0.5 * np.cos(2 * math.pi * frequency * time)


# --- the core's estimator --------------------------------------------------------------------------------------------


def test_without_friction_and_compliance_the_far_end_is_the_near_end() -> None:
    angle, torque = stroke(), np.linspace(0, 0.2, 1200)
    found = far_end({"ratio": 0.9, "torque_ratio": 1.1}, angle, torque=torque)
    assert found.angle == pytest.approx(0.9 * angle, abs=1e-12)
    assert found.torque == pytest.approx(1.1 * torque, abs=1e-12)
    assert np.abs(found.hidden_torque).max() == 0


def test_a_tendon_that_is_pulled_passes_the_capstan_share_and_holds_at_reversal() -> None:
    angle = np.concatenate([np.linspace(0, 1, 1000), np.full(500, 1.0)])
    torque = np.concatenate([np.full(1000, 0.2), np.linspace(0.2, 0.15, 500)])
    found = far_end({"friction_exponent": 0.8, "pretension": 0.05, "play": 0.01}, angle, torque=torque)
    sliding = 0.25 * math.exp(-0.8) - 0.05
    assert found.torque[999] == pytest.approx(sliding, rel=1e-3)
    assert found.hidden_torque[999] == pytest.approx(0, abs=1e-12)
    # the near end stands still: what its torque loses within the band does not reach the far end
    assert np.ptp(found.torque[999:]) < 1e-3 * sliding


def test_friction_hides_the_far_end_until_the_tendon_has_slipped_back() -> None:
    angle = np.concatenate([np.linspace(0, 1, 1000), np.linspace(1, 0, 1000)])
    found = far_end({"friction_exponent": 0.5, "pretension": 0.1, "play": 0.02}, angle, torque=np.full(2000, 0.1))
    assert found.hidden_torque[999] == pytest.approx(0, abs=1e-12)
    assert found.hidden_torque[1015:1030].max() > 0.02
    assert found.hidden_torque[1600] == pytest.approx(0, abs=1e-12)
    assert found.torque[1600] == pytest.approx(0.2 * math.exp(0.5) - 0.1, rel=1e-3)


def test_a_current_without_drive_friction_is_a_torque() -> None:
    angle, current = stroke(), 0.2 + 0.1 * np.sin(np.arange(1200) / 100)
    by_torque = far_end(TOOL, angle, torque=0.8 * current)
    by_current = far_end({**TOOL, "torque_constant": 0.8}, angle, current=current)
    assert by_current.torque == pytest.approx(by_torque.torque, abs=1e-12)
    rubbed = far_end({**TOOL, "torque_constant": 0.8, "drive_friction": 0.02}, angle, current=current)
    # pulling, the gearbox takes its friction from the motor's torque; let out, it adds it
    assert rubbed.near_torque[150] == pytest.approx(0.8 * current[150] - 0.02, abs=3e-3)
    assert rubbed.near_torque[400] == pytest.approx(0.8 * current[400] + 0.02, abs=3e-3)


def test_the_estimate_does_not_depend_on_the_rate_of_samples() -> None:
    fine = np.linspace(0, 8, 8001)
    angle, torque = -0.5 * np.cos(fine), 0.1 + 0.05 * np.sin(fine)
    dense = far_end(TOOL, angle, torque=torque, time_step=1e-3)
    thin = far_end(TOOL, angle[::10], torque=torque[::10], time_step=1e-2)
    assert dense.torque[::10] == pytest.approx(thin.torque, abs=5e-3)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"current": [0.1]}, r"parameters\['torque_constant'\] is 0.0; it must be above 0 N\*m/A for a current"),
        ({}, "torque and current are both or neither given; give one of them"),
        ({"torque": [0.1, 0.2]}, "torque is 'of 2 samples'; it must be of 1, those of angle"),
        ({"torque": [math.nan]}, r"torque\[0\] is nan; it must be a finite number"),
    ],
)
def test_what_cannot_be_estimated_is_refused(given: Mapping[str, list[float]], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        far_end({}, [0.0], **given)
    with pytest.raises(ValueError, match="parameters is 'stiffnes'; it must be names of torque_constant"):
        far_end({"stiffnes": 1.0}, [0.0], torque=[0.1])


# --- a tool's model --------------------------------------------------------------------------------------------------


def truth(signal: Signal) -> dict[str, float]:
    values = {one.name: one.start for one in unknowns(signal, wrist=False)} | TOOL
    return values | {"angle_offset": 0.8} | ({"torque_constant": 1.2} if signal == "current" else {})


def recorded(level: float, signal: Signal = "torque", **other: float) -> MeasuredRun:
    """Return a run whose far end the model gives, with the noise of its sensors."""
    angle = stroke()
    noise = np.random.default_rng(round(1e3 * level))
    torque = level + (0.06 + 0.3 * level) * np.tanh(5 * np.gradient(angle) * RATE) + 0.01 * angle
    columns = {
        "spindle_angle": BENCH.middle - angle,
        "spindle_torque": torque,
        "motor_current": torque / 1.2,
        "jaw_angle": 0.0 * angle,
        "jaw_torque": 0.0 * angle + level,
    }
    run = MeasuredRun(f"load {level:g}", np.arange(angle.size) / RATE, columns)
    far = predicted({**truth(signal), **other}, series_of(run, BENCH), signal, BENCH)
    columns["jaw_angle"] = far.angle + noise.normal(0, 1e-3, angle.size)
    columns["jaw_torque"] = far.torque + noise.normal(0, 3e-4, angle.size)
    return replace(run, columns=columns)


@cache
def fitted() -> ForceModel:
    return fit_force([recorded(level) for level in (0.02, 0.1)], "torque")


@pytest.mark.slow
def test_a_simulated_tool_is_estimated_under_a_load_that_was_not_fitted() -> None:
    found = assess(traces(fitted(), recorded(0.06)))
    assert found.torque_rmse < 2e-3
    assert found.angle_rmse < math.radians(0.2)
    assert found.torque_covered > 0.9
    assert found.angle_covered > 0.9


@pytest.mark.slow
def test_the_motor_of_another_bench_is_known_after_one_recording() -> None:
    own = truth("current") | {"torque_constant": 1.0}
    known = ForceModel(
        signal="current",
        bench=BENCH,
        values=own,
        free=(),
        covariance=np.diag(np.full(len(own), 1e-8)),
        prior_spread={},
        known=Bands(Band(0.003, 0.3, 1.0), Band(0.002, 0.2, 1.0)),
        new=Bands(Band(0.003, 0.3, 1.0), Band(0.002, 0.2, 1.0)),
        pitches=(),
        wrist=False,
    )
    model = fit_force([recorded(0.1, "current")], "current", prior=known, groups=("offset", "drive"))
    assert model.values["torque_constant"] == pytest.approx(1.2, rel=0.05)
    assert assess(traces(model, recorded(0.06, "current"))).torque_rmse < 4e-3


@pytest.mark.slow
def test_one_recording_of_another_tool_recalibrates_friction_and_says_what_it_does_not_tell() -> None:
    other = {"friction_exponent": 0.5, "angle_offset": 0.6}
    model = fit_force([recorded(0.06, **other)], "torque", prior=fitted())
    assert model.values["friction_exponent"] == pytest.approx(0.5, abs=0.08)
    assert model.values["ratio"] == fitted().values["ratio"]
    assert "ratio" not in model.free
    assert set(model.undetermined()) < set(model.free)
    test = recorded(0.1, **other)
    before = fit_force([recorded(0.06, **other)], "torque", prior=fitted(), groups=("offset",))
    assert assess(traces(model, test)).torque_rmse < assess(traces(before, test)).torque_rmse
    again = from_json(json.loads(json.dumps(to_json(model))), "model.json")
    assert again.estimate(test).torque_std == pytest.approx(model.estimate(test).torque_std, rel=1e-9)


def test_noise_and_what_repeats_are_measured_in_the_recording() -> None:
    run = recorded(0.05)
    found = bounds_of(series_of(run, bench_of([run])))
    assert found.far_torque_noise == pytest.approx(3e-4, rel=0.2)
    assert found.period == pytest.approx(5, abs=0.05)
    assert found.far_angle_cycles == pytest.approx(1e-3, rel=0.2)


def test_currents_that_tell_nothing_are_refused_in_a_sentence() -> None:
    run = recorded(0.1)
    without = replace(run, columns={name: one for name, one in run.columns.items() if name != "motor_current"})
    with refused("motor_current", kind=IdentificationError):
        checked(without, "current")
    assert checked(without, "torque") is without
    noise = np.random.default_rng(1).normal(0, 1e-3, len(run))
    clipped = np.clip(run["motor_current"] + noise, None, 0.1)
    with refused("motor_current", 670, kind=IdentificationError):
        checked(replace(run, columns={**run.columns, "motor_current": clipped}), "current")
    with refused("motor_current", 0.0, kind=IdentificationError):
        checked(replace(run, columns={**run.columns, "motor_current": 0 * noise}), "current")
    model = ForceModel.__new__(ForceModel)
    object.__setattr__(model, "signal", "torque")
    with refused("prior", "torque", kind=IdentificationError):
        fit_force([run], "current", prior=model)
    with refused("prior", kind=IdentificationError):
        from_json({"signal": "current"}, "x.json")


@pytest.mark.slow
def test_the_command_writes_a_model_and_prints_errors(tmp_path: Path, tenodesis: Command) -> None:
    rows = table()
    rows[:, 3] = 1e-3 * rows[:, TORQUE] * 0.04
    path = write(tmp_path, rows)
    code, said, wrong = tenodesis("force", str(path), "--out", str(tmp_path / "out"))
    assert code == 0, wrong
    assert "What bounds it" in said
    assert json.loads((tmp_path / "out/model.json").read_text())["signal"] == "torque"
    assert (tmp_path / "out/force.svg").exists()


# --- a real grasper --------------------------------------------------------------------------------------------------

ROOT = Path(__file__).parents[2]
DATA = Path(os.environ.get("TENODESIS_DATA", ROOT.parent / "shared" / "data"))
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA} (set TENODESIS_DATA)")


def tool(*names: str) -> list[MeasuredRun]:
    return [davinci_tool.load(DATA / "davinci-tool" / f"{name}.TXT") for name in names]


def errors(model: ForceModel, runs: list[MeasuredRun]) -> RunResult:
    return pooled([assess(traces(model, one)) for one in runs])


@pytest.mark.data
@needs_data
@pytest.mark.parametrize(("signal", "torque", "angle"), [("torque", 5e-3, 0.5), ("current", 12e-3, 0.7)])
def test_a_measured_jaws_torque_under_loads_and_speeds_that_were_not_fitted(
    signal: Signal, torque: float, angle: float
) -> None:
    model = fit_force(tool("00", "02", "04", "06", "08"), signal)
    loads = errors(model, tool("01", "03", "05", "07", "09"))
    assert loads.torque_rmse < torque
    assert math.degrees(loads.angle_rmse) < angle
    assert loads.torque_covered > 0.9
    assert loads.angle_covered > 0.9
    assert errors(model, tool("30", "34", "38")).torque_rmse < torque


@pytest.mark.data
@needs_data
def test_one_recording_of_a_posture_is_worth_nearly_a_full_fit() -> None:
    before = fit_force(tool("00", "03", "06", "09"), "torque")
    first, *others = (
        davinci_posture.load(DATA / "davinci-posture" / f"pitch0_00{level}.TXT") for level in (1, 0, 2, 3)
    )
    assert errors(fit_force([first], "torque", prior=before), others).torque_rmse < 7e-3

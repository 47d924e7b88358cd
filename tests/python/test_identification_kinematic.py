"""Claims about joints identified from commands and angles alone: truth in the intervals, the law, what is read."""

import json
import math
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from tenodesis.errors import ArgumentError, IdentificationError
from tenodesis.identification import Kinematic, fit, jacobian_error, recorded
from tenodesis.identification.datasets.reference import held
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.kinematic import of_run
from tenodesis.identification.kinematic.recordings import load
from tenodesis.run import Array, Run

from .conftest import ROOT, Command, refused

sys.path.append(str(ROOT / "studies"))
from coverage import JOINTS, simulated

DATA = Path(os.environ.get("TENODESIS_DATA", Path(__file__).parents[3] / "shared" / "data")) / "endoscope-pair"


def table(path: Path, columns: dict[str, Array]) -> Path:
    np.savetxt(path, np.column_stack(list(columns.values())), "%.9g", ",", header=",".join(columns), comments="")
    return path


def logged(path: Path, run: MeasuredRun) -> Path:
    said = {"command": "setpoint_js.{} [deg]", "measured": "{}_measured [rad]"}
    columns = {"time [s]": run.time}
    for name, values in run.columns.items():
        kind, joint = name.split(".")
        columns[said[kind].format(joint)] = np.degrees(values) if kind == "command" else values
    return table(path, columns)


@pytest.mark.parametrize("law", ["none", "play", "soft", "passed"])
def test_derivatives_agree_with_differences(law: str) -> None:
    run, truth = simulated(3, law, samples=400)
    problem = Kinematic([run], law=law)
    values = np.array([truth.get(one.name, 0.0) for one in problem.parameters])
    assert jacobian_error(problem, values, 0, quantile=0.97) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("law", ["play", "soft", "passed"])
def test_the_truth_is_in_the_intervals(law: str) -> None:
    inside = []
    for seed in range(3):
        run, truth = simulated(seed, law, samples=800)
        found = fit(Kinematic([run], law=law), train=[0], starts=1)
        inside += [low <= truth[name] <= high for name, (low, high) in found.interval_95.items()]
    assert np.mean(inside) > 0.88


@pytest.mark.slow
def test_the_simplest_law_that_predicts_is_taken_and_predicts() -> None:
    for law in ("none", "play"):
        run, _ = simulated(5, law, samples=600)
        other, truth = simulated(5, law, samples=600, motion=1)
        problem = Kinematic([run], [other])
        assert {joint.law for joint in problem.joints} == {law}
        found = fit(problem, train=[0], test=[1], starts=1)
        assert max(found.test_rmse.values()) < 0.07
        _, rows = problem.coupling(found.vector)
        assert rows[0] == pytest.approx(
            [truth[f"gain.{JOINTS[0]}"], *(truth[f"coupling.roll.{j}"] for j in JOINTS[1:])], abs=1e-3
        )


@pytest.mark.slow
def test_an_effort_that_stretches_is_found_and_one_that_says_nothing_is_left_out() -> None:
    run, _ = simulated(2, "play", samples=800)
    effort = {"roll": np.sin(0.7 * run.time), "yaw": np.cos(run.time)}
    groups = [
        {name.split(".")[1]: values for name, values in run.columns.items() if name.startswith(kind)}
        for kind in ("command", "measured")
    ]
    groups[1]["yaw"] = groups[1]["yaw"] - 0.05 * effort["yaw"]
    problem = Kinematic([recorded(run.time, *groups, effort=effort)])
    assert [joint.effort for joint in problem.joints] == [False, False, True]


def test_a_joint_that_stands_still_is_neither_fitted_nor_a_mover() -> None:
    run, _ = simulated(1, "play", samples=400)
    still = dict(run.columns) | {"command.jaw": np.zeros(len(run)), "measured.jaw": np.zeros(len(run))}
    problem = Kinematic([MeasuredRun("run", run.time, still)], law="play")
    assert tuple(joint.name for joint in problem.joints) == JOINTS
    assert not [one.name for one in problem.parameters if "jaw" in one.name]


def test_recordings_that_cannot_be_used_are_refused() -> None:
    time: Array = np.linspace(0, 6, 300)
    with pytest.raises(IdentificationError, match="no joint has a commanded and a measured angle"):
        recorded(time, {"yaw": time}, {"pitch": time})
    with pytest.raises(IdentificationError, match="no joint that was measured moves"):
        recorded(time, {"yaw": np.zeros(300)}, {"yaw": time})
    run, _ = simulated(1, "play", samples=400)
    with refused("law", "bouc-wen", kind=ArgumentError):
        Kinematic([run], law="bouc-wen")
    with refused("train", kind=IdentificationError):
        Kinematic([])


def test_a_table_says_by_its_headings_what_is_what(tmp_path: Path) -> None:
    run, _ = simulated(1, "play", samples=400)
    read = load(logged(tmp_path / "log.csv", run))
    assert read.columns.keys() == run.columns.keys()
    for name, values in run.columns.items():
        assert np.abs(read[name] - values).max() < 1e-7, name
    ours = table(
        tmp_path / "ours.csv",
        {
            "time [s]": run.time,
            "commanded_handle_angle.yaw [rad]": run["command.yaw"],
            "handle_angle.yaw [rad]": run["command.roll"],
            "measured_output_angle.yaw [rad]": run["measured.yaw"],
            "force.yaw [N]": run.time,
        },
    )
    assert set(load(ours).columns) == {"command.yaw", "measured.yaw"}
    with pytest.raises(IdentificationError, match="no column of the time"):
        load(table(tmp_path / "clock.csv", {"a_command": run.time, "a_measured": run.time}))
    with pytest.raises(IdentificationError, match="second clock, t_measured"):
        load(table(tmp_path / "two.csv", {"time [s]": run.time, "t_measured [s]": run.time, "a_command": run.time}))


def test_what_is_left_out_of_a_table_is_said(tmp_path: Path) -> None:
    run, _ = simulated(1, "play", samples=400)
    columns = {"time [s]": run.time} | {f"command.{name} [rad]": run[f"command.{name}"] for name in JOINTS}
    measured = {"wrist": "roll", "pitch": "pitch", "yaw": "yaw"}
    columns |= {f"measured.{name} [rad]": run[f"measured.{of}"] for name, of in measured.items()}
    notes = load(table(tmp_path / "wrist.csv", columns)).notes
    assert notes[:2] == (
        "wrist measured, but not commanded: left out", "roll commanded, but not measured: moves others at most"
    )  # fmt: skip


@pytest.mark.parametrize("unit", [" [rad]", ""])
def test_degrees_under_a_heading_in_radians_are_taken_as_such_or_named(tmp_path: Path, unit: str) -> None:
    time: Array = np.linspace(0, 20, 500)
    angle = 0.5 * np.sin(time)
    columns = {"time [s]": time, f"command.yaw{unit}": np.degrees(angle), "measured.yaw [rad]": angle}
    read = load(table(tmp_path / "far.csv", columns))
    assert read["command.yaw"] == pytest.approx(angle, abs=1e-7)
    assert "command.yaw taken as deg, not rad" in read.notes[0]
    columns = {name: values * (1 if "time" in name else 0.1) for name, values in columns.items()}
    with refused("yaw", kind=IdentificationError):
        load(table(tmp_path / "near.csv", columns))


def test_a_reversed_encoder_turns_signs_and_adds_no_coupling() -> None:
    run, truth = simulated(4, "passed", samples=400)
    turned = dict(run.columns) | {"measured.pitch": -run["measured.pitch"]}
    found = [
        fit(Kinematic([MeasuredRun("run", run.time, columns)], law="passed"), train=[0], starts=1).values
        for columns in (dict(run.columns), turned)
    ]
    for name, value in found[0].items():
        _, joint, *other = name.split(".")
        sign = -1 if (joint == "pitch") != (name.startswith("follow") and other == ["pitch"]) else 1
        assert found[1][name] == pytest.approx(value if name.startswith("play") else sign * value, abs=1e-5), name
    assert found[0]["coupling.yaw.pitch"] == pytest.approx(truth["coupling.yaw.pitch"], abs=2e-3)


def test_a_run_gives_its_handles_and_measured_angles() -> None:
    run, _ = simulated(1, "play", samples=400)
    whole = Run(
        time=run.time,
        joints=("yaw",),
        handle_joints=("yaw",),
        tendons=("a", "b"),
        commanded_handle_angle=run["command.yaw"],
        measured_output_angle=run["measured.yaw"],
    )
    assert np.array_equal(of_run(whole)["measured.yaw"], run["measured.yaw"])


@pytest.mark.slow
def test_identify_sees_that_tensions_are_missing(tmp_path: Path, tenodesis: Command) -> None:
    logs = [logged(tmp_path / f"{n}.csv", simulated(7, "play", samples=400, motion=n)[0]) for n in range(2)]
    truth = simulated(7, "play", samples=400)[1]
    arguments = (logs[0], "--test", logs[1], "--law", "play", "--out", tmp_path / "out", "--json")
    code, printed, said = tenodesis("identify", *arguments, "--instrument", "needle-driver")
    assert code == 0, said
    found = json.loads(printed)
    assert found["format"] == "joints"
    assert "needle-driver has no joint roll; it has pitch, jaw_1, jaw_2, yaw, jaw." in found["warnings"]
    assert found["parameters"]["play.yaw"]["value"] == pytest.approx(truth["play.yaw"], abs=math.radians(0.1))


@pytest.mark.data
@pytest.mark.skipif(not DATA.is_dir(), reason=f"no measured data in {DATA} (set TENODESIS_DATA)")
@pytest.mark.parametrize("bend", [0, 120, 240])
def test_a_real_joint_is_predicted_by_its_command_ten_times_as_well_as_without_play(bend: int) -> None:
    rows = np.loadtxt(DATA / f"{bend}.txt", delimiter=",")
    rows = rows[np.append(True, np.diff(rows[:, 0]) > 0)]
    halves = [
        recorded(half[:, 0], {"pitch": np.radians(half[:, 1])}, {"pitch": np.radians(half[:, 3])})
        for half in np.array_split(rows, 2)
    ]
    errors = {}
    for law in ("none", "auto"):
        found = fit(Kinematic(halves[:1], halves[1:], law=law), train=[0], test=[1], starts=1)
        errors[law] = found.test_rmse["pitch_angle_deg"]
    assert errors["auto"] < 1.3
    assert errors["none"] > 5 * errors["auto"]


def test_a_joint_that_is_late_is_given_a_delay_and_its_own_play() -> None:
    time: Array = np.arange(600) / 30
    late = time - 0.08
    moved = 0.4 * np.sin(1.3 * late) + 0.2 * np.sin(3.1 * late)
    angle = held(moved - 0.05, moved + 0.05, moved[0]) + np.random.default_rng(0).normal(0, 2e-3, time.size)
    command = 0.4 * np.sin(1.3 * time) + 0.2 * np.sin(3.1 * time)
    model = Kinematic([recorded(time, {"pitch": command}, {"pitch": angle})])
    found = fit(model, train=[0], starts=1)
    assert model.joints[0].delay
    assert found.values["delay.pitch"] == pytest.approx(0.08, abs=2e-3)
    assert found.values["play.pitch"] == pytest.approx(0.1, abs=2e-3)

"""Claims about unknowns of any routing: truth in the intervals, what a recording must hold, what the command fits."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import tenodesis as tn
from tenodesis import threads
from tenodesis.cli import identify
from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS, fit, routing
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.results import to_json
from tenodesis.instrument import FullForm
from tenodesis.instrument.text import to_toml
from tenodesis.recording import Recorder, lab_tables, signal_tables, tables
from tenodesis.run import Run

from .conftest import ROOT, Command, refused

sys.path.append(str(ROOT / "studies"))
from coverage import excited, routed, sensed

OPEN = ["jaw_1_wound.stiffness", "pitch_wound.pretension", "friction.vertex_coefficient", "jaw_2.encoder_offset"]


@pytest.fixture(scope="module")
def driven() -> tuple[FullForm, FullForm, Run]:
    return routed(2, "needle-driver", seconds=2.0)


def known(inst: FullForm, true: FullForm) -> FullForm:
    """The true instrument but for what is open."""
    own = {one.name: one for one in inst.as_given("tendons")}
    return true.replace(
        **{
            "tendons.jaw_1_wound.stiffness": own["jaw_1_wound"].stiffness,
            "tendons.pitch_wound.pretension": own["pitch_wound"].pretension,
            "friction.vertex_coefficient": 0.1,
        }
    )


def test_the_truth_is_in_the_intervals(driven: tuple[FullForm, FullForm, Run]) -> None:
    inst, true, run = driven
    problem = routing.problem([routing.of_run(run, known(inst, true))], [], law="capstan")
    shown: list[float] = []
    found = fit(problem, OPEN, train=[0], starts=1, progress=lambda done, total: shown.append(done / total))
    for name, (low, high) in found.interval_95.items():
        assert low <= problem.value(true, name) <= high
    # searches near the optimum count as those from starts do
    assert shown == sorted(shown)
    assert (min(shown) < 0.2, shown[-1]) == (True, 1.0)
    assert any(0.2 < one < 0.8 for one in shown)
    assert found.train_rmse["tension_N"] < 1.2 * inst.sensors.load_cell_noise
    identified = problem.instrument(found.vector)
    assert identified.friction.vertex_coefficient == found.values["friction.vertex_coefficient"]


def test_the_truth_leaves_the_sensors_noise(driven: tuple[FullForm, FullForm, Run]) -> None:
    inst, true, run = driven
    problem = routing.problem([routing.of_run(run, inst)], [], law="capstan")
    truth = np.array([problem.value(true, one.name) for one in problem.parameters])
    residuals = problem.residuals(truth, 0)
    assert 1.56 < np.quantile(np.abs(residuals), 0.9) < 1.75  # 1.645 of a normal distribution
    # No tendon slips earlier or later than it did.
    assert np.abs(residuals).max() < 6
    assert {"friction", "stiffness", "pretension", "radius", "compliance", "offset", "viscous"} == set(problem.groups)


def test_tendons_that_end_slack_tell_what_load_cells_are_off_however_they_lay_at_first() -> None:
    inst, _, _ = routed(0, "two-segment-continuum", seconds=0.1)
    offsets = (0.12, -0.1, 0.0, 0.07)  # N
    named = zip(inst.tendons, offsets, strict=True)
    true = inst.replace(**{f"tendons.{one.name}.load_cell_bias": bias for one, bias in named})
    # what is let out at once, m, leaves tendons as no twin begins
    run = excited(true, inst, seed=1, seconds=1.2, slack=1.5e-3, let_out=[5e-6, -5e-6, 8e-6, 0.0])
    problem = routing.problem([routing.of_run(run, inst, settled=0.6)], [], law="capstan")
    assert next(iter(problem.traces(problem.starting_values([0]), 0).values())).time[0] == pytest.approx(0.6, abs=1e-3)
    pretensions = [f"{one.name}.pretension" for one in inst.tendons]
    found = fit(problem, pretensions, train=[0], starts=1)
    for tendon, bias in zip(inst.tendons, offsets, strict=True):
        error = found.files[0].sensors[f"tension.{tendon.name}.offset"]
        assert abs(error.value - bias) < 4 * error.std
        assert (error.std < 0.2 * inst.sensors.load_cell_offset, error.unit) == (True, "N")
    written = to_json(found, format="tendons", law="capstan")["files"]["run"]["sensors"]
    name = "tension.near_agonist.offset"
    assert written[name] == found.files[0].sensors[name]._asdict()


def test_a_recording_that_is_cut_off_before_its_first_row_is_said_to_be_so(tmp_path: Path) -> None:
    inst = tn.load("needle-driver")
    run = tn.twin.Twin(inst).run(np.zeros((400, 0)), spool_velocity=np.full((400, 6), 0.1))
    with Recorder(tmp_path / "whole.mcap", axes=run.names, metadata={"instrument": to_toml(inst)}) as recorder:
        recorder.write(run)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((tmp_path / "whole.mcap").read_bytes()[:20_000])
    for name in ("recording", "tendons", "joints"):
        with refused("path", value=cut, kind=IdentificationError) as problem:
            FORMATS[name].load(cut)
        assert "is cut off" in str(problem.value)


def test_what_is_not_fitted_stays_at_the_files_value() -> None:
    inst = tn.instrument.expanded(tn.load("needle-driver"))
    assert inst.friction.law == "none"
    twin = tn.twin.Twin(inst)
    time = np.arange(800) * twin.time_step
    velocity = np.outer(0.5 * np.sin(6 * np.pi * time), [1.0, -1.0] * 3)
    run = twin.run(np.zeros((time.size, 0)), spool_velocity=velocity)
    problem = routing.problem([routing.of_run(run, inst)], [], law="capstan")
    found = fit(problem, ["pitch_wound.stiffness"], train=[0], starts=1)
    assert found.values["friction.vertex_coefficient"] == 0
    assert found.train_rmse["tension_N"] < 1.2 * inst.sensors.load_cell_noise
    # a search for it begins above
    names = [one.name for one in problem.parameters]
    assert problem.starting_values([0])[names.index("friction.vertex_coefficient")] > 0


@pytest.fixture(scope="module")
def uneven() -> tuple[FullForm, FullForm, Run]:
    """Stiff tendons, whose twin takes half of the sensors' period, with pretensions of 28.4 and 30.5 N in a pair."""
    return routed(3, "hybrid-real-size")


def test_rows_that_repeat_a_reading_are_not_compared(uneven: tuple[FullForm, FullForm, Run]) -> None:
    inst, _, run = uneven
    part = run.rows(0, 2000)
    problem = routing.problem([routing.of_run(part, inst)], [], law="capstan")
    assert part.time[1] - part.time[0] == pytest.approx(0.5 / inst.sensors.sampling_rate)
    assert problem.sample_time(0) == pytest.approx(1 / inst.sensors.sampling_rate)
    start = problem.traces(np.array([one.start for one in problem.parameters]), 0)
    for channel in ("tension.yaw_agonist_N", "output_angle.yaw_deg"):
        signal = channel.split(".", maxsplit=1)[0]
        read = run.by_column(f"measured_{signal}")[:, 0]
        scale = 1.0 if signal == "tension" else np.degrees(1)
        assert_allclose(start[channel].measured, scale * read[1:2000:2])


def test_a_search_begins_with_pretensions_as_they_were_first_read(uneven: tuple[FullForm, FullForm, Run]) -> None:
    inst, true, run = uneven
    problem = routing.problem([routing.of_run(run, inst), routing.of_run(run.rows(900), inst)], [], law="capstan")
    began, later = problem.starting_values([0]), problem.starting_values([1])
    for n, one in enumerate(problem.parameters):
        if one.name.endswith(".pretension"):
            assert began[n] == pytest.approx(problem.value(true, one.name), abs=5 * inst.sensors.load_cell_noise)
            assert later[n] == one.start
    # what was loaded or wound when it began tells nothing
    assert_allclose(later, [one.start for one in problem.parameters])


@pytest.mark.slow
def test_pretensions_that_friction_does_not_hold_apart_are_found(uneven: tuple[FullForm, FullForm, Run]) -> None:
    inst, true, run = uneven
    readings, offsets = sensed(run, inst, 3, by_encoders=False)
    problem = routing.problem([readings], [], law="capstan")
    found = fit(problem, train=[0], starts=1)
    held = [
        low <= offsets.get(name, problem.value(true, name)) <= high for name, (low, high) in found.interval_95.items()
    ]
    assert sum(held) >= 0.9 * len(held)
    # load cells are in the weights: the level of their tensions is no longer open to their gains of 0.5 %
    assert found.std["yaw_agonist.pretension"] < 0.005 * 30
    # readings are linear in encoders' offsets, whatever friction does: these leave no mean
    angles = problem.residuals(found.vector, 0).reshape(problem.channels(0), -1)[len(inst.tendons) :]
    assert_allclose(angles.mean(axis=1), 0, atol=1e-6)


def test_recordings_without_a_spool_or_a_motion_are_refused(driven: tuple[FullForm, FullForm, Run]) -> None:
    inst, _, run = driven
    whole = routing.of_run(run, inst)
    less = {name: row for name, row in whole.columns.items() if name != "spool_velocity.jaw_1_wound"}
    with refused("columns", kind=IdentificationError):
        pose(whole, less)
    still = {name: row if name.startswith("tension") else 0 * row for name, row in whole.columns.items()}
    with refused("columns", kind=IdentificationError):
        pose(whole, still)
    with refused("instrument", kind=IdentificationError):
        routing.problem([routing.of_run(run)], [], law="capstan")


def pose(whole: MeasuredRun, columns: dict[str, np.ndarray], law: str = "none") -> routing.Routing:
    assert isinstance(whole, routing.RoutingRun)
    return routing.problem([routing.RoutingRun("run", whole.time, columns, instrument=whole.instrument)], [], law=law)


@pytest.mark.slow
def test_any_tensions_and_angles_will_do_with_spools_by_their_encoders(
    driven: tuple[FullForm, FullForm, Run],
) -> None:
    inst, true, run = driven
    whole = routing.of_run(run, known(inst, true))
    kept = ("tension.jaw_1", "output_angle.pitch", "wrench")
    columns = {name: row for name, row in whole.columns.items() if name.startswith(kept)}
    for name, angle in zip(run.tendons, run.by_column("measured_spool_angle").T, strict=True):
        columns[f"spool_angle.{name}"] = angle
    problem = pose(whole, columns, law="capstan")
    assert problem.sensors(0) == ("tension.jaw_1_wound", "tension.jaw_1_unwound", "output_angle.pitch")
    found = fit(problem, OPEN[:3], train=[0], starts=1)
    for name, (low, high) in found.interval_95.items():
        assert low <= problem.value(true, name) <= high


def test_the_tip_seen_by_a_camera_tells_arms_and_stiffness(driven: tuple[FullForm, FullForm, Run]) -> None:
    _, true, run = driven
    whole = routing.of_run(run, true.replace(**{"tendons.jaw_1_wound.stiffness": 1e5}))
    seen = tn.kinematics.tip_pose(true, run.by_column("output_angle"), port=tn.kinematics.Port(insertion=0.0))
    columns = {name: row for name, row in whole.columns.items() if not name.startswith(("tension", "output_angle"))}
    noise = 1e-4 * np.random.default_rng(0).standard_normal((len(run), 3))
    columns |= dict(zip(("position.x", "position.y", "position.z"), (seen.position[:, 0] + noise).T, strict=True))
    problem = pose(whole, columns, law="capstan")
    found = fit(problem, ["jaw_1_wound.stiffness", "pitch.radius"], train=[0], starts=1)
    for name, (low, high) in found.interval_95.items():
        assert low <= problem.value(true, name) <= high
    assert found.train_rmse["position_mm"] == pytest.approx(0.1, rel=0.05)


def test_slopes_are_the_same_on_any_number_of_threads_and_take_no_twin_for_offsets(
    driven: tuple[FullForm, FullForm, Run], monkeypatch: pytest.MonkeyPatch
) -> None:
    inst, _, run = driven
    short = routing.of_run(run.rows(0, 600), inst)
    simulated: list[int] = []
    step = routing.Routing._simulated

    def counted(self: routing.Routing, *given: Any) -> Any:
        simulated.append(1)
        return step(self, *given)

    monkeypatch.setattr(routing.Routing, "_simulated", counted)
    slopes = []
    for count in (1, 3):
        monkeypatch.setattr(threads, "_threads", count)
        problem = routing.problem([short], [], law="capstan")
        slopes.append(problem.jacobian(problem.starting_values([0]), 0))
    assert_array_equal(*slopes)
    # two for each other parameter, and one at which all offsets are
    assert len(simulated) == 2 * (2 * int(np.sum(~problem.linear)) + 1)
    for one in (problem.starting_values([0]), problem.starting_values([0]) + 0.1 * problem.linear):
        problem.residuals(one, 0)
    assert len(simulated) == 2 * (2 * int(np.sum(~problem.linear)) + 1)


@pytest.mark.slow
def test_a_table_is_mapped_and_fitted_and_what_was_held_out_predicted(
    driven: tuple[FullForm, FullForm, Run], tmp_path: Path, tenodesis: Command
) -> None:
    inst, true, run = driven
    columns = {"t [s]": run.time}
    for signal, unit, word in (
        ("measured_tension", "N", "F"),
        ("measured_spool_angle", "rad", "spool"),
        ("commanded_spool_velocity", "rad/s", "speed"),
        ("measured_output_angle", "rad", "encoder"),
    ):
        for name, row in zip(run.names.columns(signal), run.by_column(signal).T, strict=True):
            columns[f"{word} {name} [{unit}]"] = row
    columns |= {f"load {one} [N]": run["wrench"][:, n] for n, one in enumerate(("fx", "fy"))}
    np.savetxt("run.csv", np.stack([*columns.values()], axis=1), "%.9g", ",", header=",".join(columns), comments="")
    Path("known.toml").write_text(to_toml(known(inst, true)))
    assert tenodesis("map", "run.csv", "--instrument", "known.toml")[0] == 0
    assert '"measured_tension.jaw_1_wound" = { column = "F jaw_1_wound [N]"' in Path("run.csv.columns.toml").read_text()
    words = (
        "--format",
        "tendons",
        "--instrument",
        "known.toml",
        "--train-until",
        "0.6",
        "--fit",
        ",".join(OPEN),
        "--json",
    )
    code, out, _ = tenodesis("identify", "run.csv", *words)
    found = json.loads(out)
    assert code == 0
    low, high = found["parameters"][OPEN[0]]["interval_95"]
    assert low <= routing.Routing.value(true, OPEN[0]) <= high
    assert found["test_rmse"]["tension_N"] < 1.5 * found["train_rmse"]["tension_N"]
    assert found["test_rmse"]["output_angle_deg"] < 1.5 * found["train_rmse"]["output_angle_deg"]


@pytest.mark.slow
def test_what_the_model_does_not_explain_is_not_identifiable(
    driven: tuple[FullForm, FullForm, Run], tmp_path: Path, tenodesis: Command
) -> None:
    inst, _, run = driven
    with Recorder("run.mcap", axes=run.names, metadata={"instrument": to_toml(inst)}) as recorder:
        recorder.write(run)
    code, out, _ = tenodesis("identify", "run.mcap", "--fit", "dynamics.damping_ratio", "--json")
    assert code == 1
    assert not json.loads(out)["parameters"]["dynamics.damping_ratio"]["identifiable"]


def test_what_the_jaws_hold_ends_a_recording(driven: tuple[FullForm, FullForm, Run]) -> None:
    inst, _, run = driven
    held = np.where(run.time < run.time[0] + 1, 0.0, 1e3)
    object.__setattr__(run, "held_stiffness", held)
    assert routing.of_run(run, inst).time[-1] == pytest.approx(run.time[0] + 1, abs=1e-3)


@pytest.mark.slow
def test_the_command_fits_all_tendons_of_a_recording(
    driven: tuple[FullForm, FullForm, Run], tmp_path: Path, tenodesis: Command
) -> None:
    inst, true, run = driven
    with Recorder("run.mcap", axes=run.names, metadata={"instrument": to_toml(known(inst, true))}) as recorder:
        recorder.write(run)
    code, out, _ = tenodesis("identify", "run.mcap", "--fit", ",".join(OPEN), "--json")
    found = json.loads(out)
    assert code == 0
    assert found["format"] == "tendons"
    assert (tmp_path / "out" / "identification" / "report.html").exists()
    identified = tn.load("out/identification/instrument.toml")
    assert isinstance(identified, FullForm)
    own = next(one for one in identified.as_given("tendons") if one.name == "jaw_1_wound")
    named = found["parameters"]
    assert_allclose(own.stiffness, named["jaw_1_wound.stiffness"]["value"], rtol=1e-8)


def test_forces_on_two_planar_axes_are_one_force_on_the_tip_and_the_command_reads_once_and_fits_both(
    tenodesis: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    inst = tn.load("real-size")
    count = np.arange(600)
    handle = 0.2 * np.sin(count[:, np.newaxis] / (200, 150))
    force = 0.3 * np.sin(count[:, np.newaxis] / (120, 170))
    planar = tn.twin.Twin(inst, time_step=1e-3).run(handle, force)
    columns = routing.of_run(planar, inst).columns
    assert_allclose(columns["wrench.fx"], -force[:, 0])
    assert_allclose(columns["wrench.fy"], -force[:, 1])
    assert_allclose(columns["handle_angle.handle_pitch"], handle[:, 1])
    # the export's columns, of which the simulation's own tensions are no readings, give the same
    given = {"time [s]": planar.time} | tables.columns(planar)
    np.savetxt("two.csv", np.stack([*given.values()], axis=1), "%.17g", ",", header=",".join(given), comments="")
    read_columns = routing.load(Path("two.csv")).columns
    assert read_columns.keys() == columns.keys()
    for name, values in columns.items():
        assert_allclose(read_columns[name], values, rtol=1e-12)
    read_table = lab_tables.read_table(Path("two.csv"))
    guesses = signal_tables.guess(read_table, inst.expanded)
    assert guesses["wrench.fx"].factor == -1
    lost = [name.startswith("measured_tension") for name in read_table.headings]
    kept = lab_tables.LabTable(
        "", *([one for one, gone in zip(of, lost, strict=True) if not gone] for of in read_table[1:])
    )
    assert not [name for name in signal_tables.guess(kept, inst.expanded) if name.startswith("measured_tension")]
    # its joints act on each other, as those of a bench do
    run = tn.twin.Twin(inst.expanded, time_step=1e-3).run(handle)
    with Recorder("two.mcap", axes=run.names, metadata={"instrument": to_toml(inst)}) as recorder:
        recorder.write(run)
    formats: list[str] = []
    read = identify._read_as
    monkeypatch.setattr(identify, "_read_as", lambda name, files: formats.append(name) or read(name, files))
    code, out, _ = tenodesis(
        "identify", "two.mcap", "--fit", "yaw_agonist.pretension,pitch_agonist.pretension", "--json"
    )
    found = json.loads(out)
    assert (code, found["format"], formats) == (0, "tendons", ["tendons"])
    for axis in inst.axes:
        pretension = found["parameters"][f"{axis}_agonist.pretension"]
        # of one draw of noise; coverage is what studies/coverage.py counts
        assert_allclose(pretension["value"], 30.0, rtol=0, atol=3 * pretension["std"])
        assert pretension["std"] < 0.01


def test_of_axes_that_the_twin_moved_each_by_itself_the_first_is_fitted_alone(
    tenodesis: Command,
) -> None:
    inst = tn.load("real-size")
    handle = 0.2 * np.sin(np.arange(1500)[:, np.newaxis] / (200, 150))
    run = tn.twin.Twin(inst).run(handle, np.zeros_like(handle))
    metadata = {"instrument": to_toml(inst), "mode": "dynamic"}
    with Recorder("apart.mcap", axes=run.names, metadata=metadata) as recorder:
        recorder.write(run)
    code, out, _ = tenodesis("identify", "apart.mcap", "--fit", "pretension_ratio", "--starts", "1", "--json")
    found = json.loads(out)
    assert (code, found["format"]) == (0, "recording")
    assert_allclose(found["parameters"]["pretension_ratio"]["value"], 1, atol=0.01)

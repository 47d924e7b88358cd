"""Instruments found again in recordings of their twins, whose truth is known."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import tenodesis as tn
from tenodesis.errors import IdentificationError
from tenodesis.identification import FORMATS, fit
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.problem import differenced, scales
from tenodesis.instrument import Instrument
from tenodesis.recording.simulation import record
from tenodesis.run import TENDONS
from tenodesis.simulate import Cycles, Pretension, Protocol

from .conftest import refused
from .twin_recordings import (
    KEYS,
    MISMATCH,
    NOMINAL,
    STEP,
    TRUE,
    TRUTH,
    columns,
    commands,
    deviations,
    found_again,
    problem,
    recorded,
    start,
)

# derivatives


@pytest.mark.parametrize("law", ["capstan", "capstan-constant", "stribeck", "none", "capstan-power"])
def test_derivatives_are_those_of_differences_for_every_mechanism(any_inst: Instrument, law: str) -> None:
    inst = any_inst.axis(any_inst.axes[0])
    keys: dict[str, object] = {"friction": None}
    if law != "none":
        keys = {f"friction.{key}": value for key, value in (("law", law), ("vertex_coefficient", 0.12))}
        keys |= {"friction.sheath_coefficient": 0.1, "friction.sheath_bend": 1.0, "friction.viscous": 0.5}
    if law in ("capstan-constant", "stribeck"):
        keys["friction.constant"] = 0.3
    if law == "stribeck":
        keys |= {"friction.static_ratio": 1.3, "friction.stribeck_speed": 2e-3}
    if law == "capstan-power":
        keys |= {"friction.load_index": 0.8, "friction.base_wrap": 0.1, "friction.vertices_per_joint": 2}
    inst = inst.replace(**keys)
    one = problem(recorded(inst, seconds=2.0), inst, law)
    lower, upper = (np.array([getattr(p, side) for p in one.parameters]) for side in ("lower", "upper"))
    values = np.clip(1.03 * start(one), lower, upper)
    own = one.jacobian(values, 0)
    other = differenced(lambda at: one.residuals(at, 0), values, lower, upper, scales(one.parameters, values))
    size = np.maximum(np.abs(other).max(axis=0), 1e-4 * np.abs(other).max())
    # a Stribeck law lets neighbouring solutions part where a contact breaks loose
    share, allowed = (0.9, 0.02) if law == "stribeck" else (0.99, 4e-4)
    assert np.quantile(np.abs(own - other) / size, share, axis=0).max() < allowed


def test_derivatives_hold_on_the_lower_bounds_where_differences_are_one_sided() -> None:
    one = problem(recorded(NOMINAL, seconds=1.0), NOMINAL)
    names = [p.name for p in one.parameters]
    lower, upper = (np.array([getattr(p, side) for p in one.parameters]) for side in ("lower", "upper"))
    values = start(one, **{"friction.viscous": 0.0, "dynamics.tip_damping": 0.0, "drives.backlash": 0.0})
    other = differenced(lambda at: one.residuals(at, 0), values, lower, upper, scales(one.parameters, values))
    own = one.jacobian(values, 0)
    for name in ("friction.viscous", "dynamics.tip_damping"):
        n = names.index(name)
        assert np.quantile(np.abs(own - other)[:, n], 0.99) < 5e-3 * np.abs(other[:, n]).max()


def test_derivatives_by_some_parameters_are_columns_of_all() -> None:
    one = problem(recorded(NOMINAL, seconds=2.0), NOMINAL)
    values = start(one)
    assert np.array_equal(one.derivatives(values, 0, [4, 1]), one.jacobian(values, 0)[:, [4, 1]])


# what is found


@pytest.mark.slow
def test_six_parameters_are_found_again_within_their_intervals() -> None:
    fits = [found_again(recorded(TRUE, seed)) for seed in range(8)]
    off = np.array([list(deviations(one, TRUTH).values()) for one in fits])
    assert all(all(one.identifiability.identifiable.values()) for one in fits)
    hits = np.array(
        [[one.interval_95[name][0] <= TRUTH[name] <= one.interval_95[name][1] for name in one.free] for one in fits]
    )
    # no parameter misses more often than chance leaves, and none by far
    assert (hits.sum(axis=0) >= stats.binom.ppf(0.001, len(fits), 0.95)).all()
    assert hits.sum() >= stats.binom.ppf(0.001, hits.size, 0.95)
    assert np.abs(off).max() < 5


def test_other_mechanisms_are_found_again(pulley: Instrument, continuum: Instrument) -> None:
    for inst in (pulley, continuum):
        nominal = inst.axis(inst.axes[0]).replace(
            mismatch=None,
            friction={"law": "capstan", "vertex_coefficient": 0.1, "sheath_coefficient": 0.1, "sheath_bend": 1.0},
        )
        found = found_again(
            recorded(nominal.replace(**MISMATCH, **KEYS)), nominal, [n for n in TRUTH if "length" not in n]
        )
        assert max(map(abs, deviations(found, TRUTH).values())) < 4.5


def test_without_a_distal_encoder_the_proximal_side_identifies_the_same() -> None:
    names = [name for name in TRUTH if "encoder" not in name]
    one = problem(recorded(TRUE, distal=False), NOMINAL)
    assert "mismatch.output_encoder_offset" not in [parameter.name for parameter in one.parameters]
    blind = fit(one, names, train=[0], starts=1)
    assert list(blind.train_rmse) == ["tension_N"]
    assert max(map(abs, deviations(blind, TRUTH).values())) < 4.5
    seeing = found_again(recorded(TRUE))
    assert all(blind.std[name] > 0.7 * seeing.std[name] for name in names)


@pytest.mark.slow
def test_a_handle_known_by_its_encoder_alone_is_paid_for_by_wider_intervals() -> None:
    names = [*TRUTH, "mismatch.handle_encoder_offset"]
    found = found_again(recorded(TRUE, 1, commanded=False), NOMINAL, names)
    assert max(map(abs, deviations(found, {**TRUTH, "mismatch.handle_encoder_offset": 0.0}).values())) < 4
    sure = found_again(recorded(TRUE, 1), NOMINAL, names)
    assert all(found.std[name] > sure.std[name] for name in names)


def test_reversals_of_an_encoders_handle_hardly_bias_parameters() -> None:
    # one cycle turns in corners, which smoothing would round
    one = problem(recorded(TRUE, 2, seconds=2.0, commanded=False), NOMINAL)
    names = [parameter.name for parameter in one.parameters]
    values = start(one, **TRUTH)
    wanted = [names.index(name) for name in [*TRUTH, "mismatch.handle_encoder_offset"]]
    step = np.linalg.lstsq(one.derivatives(values, 0, wanted), -one.residuals(values, 0))[0]
    off = dict(zip(TRUTH, step, strict=False))
    assert abs(off["handle_length_share"]) < 0.01
    assert abs(off["friction.vertex_coefficient"]) < 0.002


def test_strokes_of_the_spools_are_followed_within_their_encoders_steps() -> None:
    time = np.arange(1, 8001) * STEP
    handle = 0.25 * np.sin(np.pi * np.clip(time - 2.2, 0, 2))
    stroke = np.where((time > 0.2) & (time < 0.7), 0.36, np.where((time > 1.3) & (time < 1.8), -0.36, 0.0))
    run = tn.twin.Twin(TRUE, time_step=STEP).run(handle, spool_velocity=np.stack([stroke, 0.7 * stroke], axis=1))
    assert np.ptp(run["spool_angle"][:, 0]) > 0.15
    one = problem(columns(run), NOMINAL)
    names = [parameter.name for parameter in one.parameters]
    wanted = [names.index(name) for name in TRUTH]
    values = start(one, **TRUTH)
    slopes, residuals = one.derivatives(values, 0, wanted), one.residuals(values, 0)
    off = np.linalg.lstsq(slopes, -residuals)[0]
    spread = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes)))
    assert np.abs(off / spread).max() < 4
    assert np.mean(residuals**2) < 1.05


@pytest.mark.slow
def test_two_runs_narrow_intervals_more_than_one() -> None:
    runs = [recorded(TRUE, 1), recorded(TRUE, 2, seconds=2.0)]
    both = fit(problem(runs, NOMINAL), list(TRUTH), train=[0, 1], starts=1)
    alone = found_again(runs[0])
    assert max(map(abs, deviations(both, TRUTH).values())) < 4.5
    assert both.std["stiffness_ratio"] < alone.std["stiffness_ratio"]


def test_a_held_out_run_is_predicted_to_its_sensors_noise() -> None:
    built = FORMATS["mcap"].problem([recorded(TRUE, 1)], [recorded(TRUE, 2)], law="capstan", instrument=NOMINAL)
    found = fit(built, list(TRUTH), train=[0], test=[1], starts=1)
    for name, rmse in found.test_rmse.items():
        assert rmse == pytest.approx(found.train_rmse[name], rel=0.05)


# what cannot be found


def test_of_a_sheath_only_coefficient_times_bend_is_identifiable() -> None:
    one = problem(recorded(TRUE), NOMINAL)
    found = fit(one, ["friction.sheath_coefficient", "friction.sheath_bend"], train=[0], starts=1)
    assert not any(found.identifiability.identifiable.values())
    assert "product" in str(found.identifiability.statements)
    twice = {"friction.sheath_coefficient": 0.2, "friction.sheath_bend": 0.5}
    assert one.residuals(start(one), 0) == pytest.approx(one.residuals(start(one, **twice), 0), abs=1e-6)


def test_without_a_load_gains_are_not_identifiable_beside_stiffness_and_pretension() -> None:
    # slowly, since what the tip's inertia takes is a load as well
    slow = 0.75 * NOMINAL.handle_range * np.sin(np.pi / 8 * np.arange(0, 8, STEP)) ** 2
    inst = TRUE.replace(mismatch=None)
    one = problem(columns(tn.twin.Twin(TRUE, time_step=STEP).run(slow)), inst)
    names = [*(f"mismatch.load_cell_gain.{tendon}" for tendon in TENDONS), "stiffness_ratio", "pretension_ratio"]
    found = fit(one, [*names, "mismatch.output_encoder_offset"], train=[0], starts=1)
    loaded = fit(problem(recorded(TRUE), inst), [*names, "mismatch.output_encoder_offset"], train=[0], starts=1)
    for name in names:
        assert found.std[name] > 5 * loaded.std[name]


def test_nothing_is_seen_of_a_backlash_that_taut_tendons_hide() -> None:
    one = problem(recorded(TRUE, seconds=2.0), NOMINAL)
    found = fit(one, ["stiffness_ratio", "friction.vertex_coefficient", "drives.backlash"], train=[0], starts=1)
    assert not found.identifiability.identifiable["drives.backlash"]


def test_the_mismatch_of_a_given_file_is_the_start_and_that_of_a_recording_is_not_looked_at() -> None:
    run = recorded(TRUE, seconds=1.0)
    names = ("stiffness_ratio", "pretension_ratio", "mismatch.output_encoder_offset")
    given = {one.name: one.start for one in problem(run, TRUE).parameters}
    assert [given[name] for name in names] == pytest.approx([TRUTH[name] for name in names])
    inside = FORMATS["mcap"].problem([dataclasses.replace(run, instrument=TRUE)], [], law="capstan", instrument=None)
    assert inside.parameters == problem(run, TRUE.replace(mismatch=None)).parameters


def test_a_written_instrument_has_the_mismatch_that_was_fitted_or_held() -> None:
    one = problem(recorded(TRUE, seconds=1.0), TRUE)
    written = one.instrument(start(one))
    assert written.tendon_stiffness == pytest.approx(0.85 * TRUE.tendon_stiffness)
    assert written.mismatch.output_encoder_offset == pytest.approx(TRUE.mismatch.output_encoder_offset)


def test_a_tip_of_unknown_inertia_does_not_bias_the_stiffness(pulley: Instrument) -> None:
    nominal = pulley.axis("yaw").replace(friction={"law": "capstan", "vertex_coefficient": 0.1})
    names = ["stiffness_ratio", "friction.vertex_coefficient", "dynamics.tip_damping"]
    truth = {"stiffness_ratio": 0.88, "friction.vertex_coefficient": 0.1, "dynamics.tip_inertia": 3e-6}
    light = nominal.replace(**{"mismatch.stiffness_ratio": 0.88, "dynamics.tip_inertia": 3e-6})
    time = np.arange(1, int(4 / STEP) + 1) * STEP
    swept = 0.5 - 0.5 * np.cos(2 * np.pi * (0.5 + 0.5 * time) * time)
    run = columns(tn.twin.Twin(light, time_step=STEP).run(0.2 * np.sin(np.pi * time), swept))
    held = fit(problem(run, nominal), names, train=[0], starts=1)
    assert held.std["stiffness_ratio"] > 10 * held.std_white["stiffness_ratio"]
    assert "not white" in str(held.warnings)
    found = fit(problem(run, nominal), [*names, "dynamics.tip_inertia"], train=[0], starts=1)
    assert max(map(abs, deviations(found, truth).values())) < 4.5
    assert "not white" not in str(found.warnings)


# the instrument that is written


def test_the_written_instrument_does_what_was_recorded() -> None:
    true = TRUE.replace(**{"friction.handle_compliance_share": 0.25})
    run = recorded(true, 3)
    one = problem(run, NOMINAL)
    written = one.instrument(fit(one, list(TRUTH), train=[0], starts=1).vector)
    assert written.friction.handle_compliance_share == pytest.approx(0.25, abs=3e-3)
    again = tn.twin.Twin(written, time_step=STEP, seed=4).run(*commands(NOMINAL))
    noise = {"measured_output_angle": np.hypot(NOMINAL.sensors.encoder_noise, 2 * np.pi / 2**12 / np.sqrt(12))}
    assert np.std(again["measured_output_angle"] - run["measured_output_angle"]) < 1.1 * np.sqrt(2) * min(
        noise.values()
    )
    for n, tendon in enumerate(TENDONS):
        off = again["measured_tension"][:, n] - run[f"tension_{tendon}"]
        assert np.sqrt(np.mean(off**2)) < 1.1 * np.sqrt(2) * NOMINAL.sensors.load_cell_noise


def test_an_instrument_changes_only_where_values_do() -> None:
    one = problem(recorded(NOMINAL, seconds=1.0), NOMINAL)
    same = one.instrument(start(one))
    assert (
        same.friction == NOMINAL.friction
        and same.mismatch == NOMINAL.mismatch
        and same.pretension == NOMINAL.pretension
    )
    other = one.instrument(start(one, pretension_ratio=1.2, stiffness_ratio=0.5))
    assert other.pretension == pytest.approx(1.2 * NOMINAL.pretension)
    assert other.tendon_stiffness == pytest.approx(0.5 * NOMINAL.tendon_stiffness)


# runs that do not begin at rest


@pytest.fixture(scope="module")
def tightened(tmp_path_factory: pytest.TempPathFactory) -> InstrumentRun:
    """A recording that begins with slack tendons, which the motors wind up."""
    phases = (
        Pretension(),
        Cycles(output_amplitude=np.radians(50), symmetric=True, speed=np.radians(60), count=1, force=0.0),
        Cycles(output_amplitude=np.radians(40), symmetric=True, speed=np.radians(60), count=1, force=1.0),
    )
    path = tmp_path_factory.mktemp("slack") / "run.mcap"
    record(TRUE, Protocol(name="slack", phases=phases), path, seed=3)
    loaded = FORMATS["mcap"].load(path)
    assert isinstance(loaded, InstrumentRun)
    return loaded


@pytest.mark.slow
def test_slack_tendons_wound_up_are_followed_from_the_spools(tightened: InstrumentRun) -> None:
    found = found_again(tightened)
    assert max(map(abs, deviations(found, TRUTH).values())) < 4
    assert found.std["stiffness_ratio"] < 2e-3
    assert found.train_rmse["tension_N"] < 1.2 * 0.03


@pytest.mark.slow
def test_spools_may_count_from_anywhere_and_tendons_be_slack_at_first(tightened: InstrumentRun) -> None:
    begun = tightened.time > 1.0
    moved = {name: values[begun] + {"spool_agonist": 1.7, "spool_antagonist": -2.3}.get(name, 0)
             for name, values in tightened.columns.items()}  # fmt: skip
    run = dataclasses.replace(tightened, time=tightened.time[begun], columns=moved)
    found = found_again(run)
    for name in ("stiffness_ratio", "friction.vertex_coefficient", "friction.sheath_coefficient"):
        assert found.values[name] == pytest.approx(TRUTH[name], rel=0.02)


def test_a_recording_that_begins_anywhere_is_led_there() -> None:
    time = np.arange(0, 6, STEP)
    handle = 0.75 * NOMINAL.handle_range * np.sin(2 * np.pi * time / 2)
    whole = columns(tn.twin.Twin(TRUE, time_step=STEP).run(handle, 0.5 - 0.5 * np.cos(0.9 * time)))
    late = whole.time > 1.3
    run = dataclasses.replace(
        whole, time=whole.time[late], columns={name: values[late] for name, values in whole.columns.items()}
    )
    assert abs(run["handle_angle"][0]) > 0.1
    found = found_again(run)
    for name, value in TRUTH.items():
        if name != "handle_length_share":
            assert found.values[name] == pytest.approx(value, rel=0.05)


# the optimiser's ways


def test_a_start_that_loses_the_tip_comes_back() -> None:
    run = recorded(TRUE)
    weak = NOMINAL.replace(pretension=0.35 * NOMINAL.pretension, tendon_modulus=0.3 * (NOMINAL.tendon_modulus or 0))
    found = found_again(run, weak)
    assert found.values["stiffness_ratio"] * 0.3 == pytest.approx(0.85, rel=0.01)


@pytest.mark.slow
def test_an_encoder_with_an_offset_may_exceed_the_handles_range() -> None:
    run = recorded(TRUE, seconds=2.0, commanded=False)
    far = {**run.columns, "handle_angle": run["handle_angle"] + 0.26}
    found = found_again(dataclasses.replace(run, columns=far), NOMINAL, ["mismatch.handle_encoder_offset", *TRUTH])
    assert np.abs(far["handle_angle"]).max() > NOMINAL.handle_range
    assert found.values["mismatch.handle_encoder_offset"] == pytest.approx(0.26, abs=0.01)
    with refused("handle_angle", kind=IdentificationError):
        problem(dataclasses.replace(run, columns={**far, "handle_angle": run["handle_angle"] + 0.6}), NOMINAL)


@pytest.mark.slow
def test_a_compliant_hand_is_taken_from_its_encoder() -> None:
    hand = {"dynamics.hand_stiffness": "20 N*m"}
    found = found_again(recorded(TRUE.replace(**hand), seconds=1.5), NOMINAL.replace(**hand))
    for name, value in TRUTH.items():
        if name != "handle_length_share":
            assert found.values[name] == pytest.approx(value, rel=0.02)


def test_sensors_held_over_several_rows_count_once() -> None:
    slow = TRUE.replace(**{"sensors.sampling_rate": "500 Hz"})
    one = problem(recorded(slow), NOMINAL)
    assert one.sample_time(0) == pytest.approx(2e-3)
    found = fit(one, list(TRUTH), train=[0], starts=1)
    assert max(map(abs, deviations(found, TRUTH).values())) < 4.5


def test_rows_that_were_dropped_leave_a_gap_and_no_residuals() -> None:
    run = recorded(NOMINAL, seconds=2.0)
    kept = (run.time < 0.5) | (run.time > 0.7)
    cut = dataclasses.replace(
        run, time=run.time[kept], columns={name: values[kept] for name, values in run.columns.items()}
    )
    whole, less = problem(run, NOMINAL), problem(cut, NOMINAL)
    covered = [one.residuals(start(one), 0).size * one.sample_time(0) for one in (less, whole)]
    share = covered[0] / covered[1]
    assert share == pytest.approx(kept.mean(), abs=0.01)


def test_bad_requests_are_refused() -> None:
    run = recorded(NOMINAL, seconds=1.0)
    with refused("law", "bouc-wen", kind=IdentificationError):
        problem(run, NOMINAL, "bouc-wen")
    with refused("instrument", kind=IdentificationError):
        FORMATS["mcap"].problem([run], [], law="capstan", instrument=None)
    sparse = dataclasses.replace(run, time=run.time * 40)
    with refused("sample_time", kind=IdentificationError):
        problem(sparse, NOMINAL)


@pytest.mark.parametrize("name", ["real-size"])
def test_of_two_axes_the_first_is_identified(name: str, tmp_path: Path) -> None:
    inst = tn.load(name)
    phases = (Cycles(amplitude=np.radians(20), symmetric=True, speed=np.radians(40), count=1),)
    path = tmp_path / "run.mcap"
    record(inst.replace(**{"mismatch.stiffness_ratio": 0.9}), Protocol(name="two", phases=phases), path)
    loaded = FORMATS["mcap"].load(path)
    assert "of the axes yaw and pitch the first is taken, and the instrument found has it alone" in loaded.notes
    built = FORMATS["mcap"].problem([loaded], [], law="capstan", instrument=None)
    found = fit(built, ["stiffness_ratio", "pretension_ratio"], train=[0], starts=1)
    assert found.values["pretension_ratio"] == pytest.approx(1, abs=2e-3)

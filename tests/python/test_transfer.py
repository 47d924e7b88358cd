"""Claims about carrying an experiment on a scaled-up instrument to the real-size one."""

import tomllib
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

import tenodesis as tn
from tenodesis.cli import transfer as transfer_command
from tenodesis.errors import InstrumentError, RecordingError
from tenodesis.instrument import Instrument, TendonGear
from tenodesis.instrument.text import to_toml
from tenodesis.recording import Recorder, Recording, blocks
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record
from tenodesis.run import SIGNALS, Run
from tenodesis.scaling.transfer import QUANTITY, carry, carry_friction, left_behind
from tenodesis.simulate import Cycles, Protocol
from tenodesis.twin import Twin

from .conftest import refused
from .recording_samples import bits
from .similar import geometrically_scaled

LIMIT = 0.3
"""Root mean square difference over a hysteresis cycle that a round trip may have, deg."""


def cycles(force: float, speed: str = "40 deg/s", amplitude: str = "60 deg") -> Protocol:
    """Two cycles of flexion and extension to both sides under a constant force (N), as on the paper's bench."""
    phase = Cycles(output_amplitude=cast(Any, amplitude), symmetric=True, speed=cast(Any, speed), count=2, force=force)
    return Protocol(name="cycles", phases=(phase,))


def scaled_pretension(real_size: Instrument, scaled_up: Instrument) -> Instrument:
    factor = tn.similarity.compare(real_size, scaled_up).tension_factor
    return scaled_up.replace(pretension=real_size.pretension * factor)


def recorded(path: Path, inst: Instrument, protocol: Protocol, **options: Any) -> Recording:
    record(inst, protocol, path, **options)
    return Recording.open(path)


def directly(inst: Instrument, run: Run, time_step: float = 5e-4) -> tuple[Run, np.ndarray]:
    """Return a run of an instrument's twin by a run's commands on its own clock, and that clock."""
    time = np.arange(1, int(run.time[-1] / time_step)) * time_step
    commands = [np.interp(time, run.time, run[name]) for name in ("commanded_handle_angle", "force")]
    return Twin(inst, time_step=time_step).run(*commands), time


@pytest.fixture(scope="module")
def real_size(real: TendonGear) -> TendonGear:
    """The real-size instrument, of the axis that was tested on the scaled-up one."""
    return real.axis("yaw")


@pytest.fixture(scope="module")
def ideal(real_size: TendonGear, scaled: TendonGear) -> TendonGear:
    """The paper's scaled-up instrument as its file means it to be, pretensioned as similarity asks."""
    return cast(TendonGear, scaled_pretension(real_size, scaled.replace(mismatch=None)))


@pytest.fixture(scope="module")
def log(ideal: TendonGear, tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """A short recording on it."""
    return recorded(tmp_path_factory.mktemp("log") / "log.mcap", ideal, cycles(1.5, "200 deg/s", "20 deg"))


# The round trip


@pytest.mark.parametrize(
    ("end_effector", "force"),
    [(None, 0.0), (None, 0.5), (None, 1.0), (None, 1.5), (0.1875, 0.0), (0.1875, 0.5)],
    ids=lambda value: "paper's" if value is None else str(value),
)
def test_the_bench_predicts_what_the_real_instrument_does(
    real_size: TendonGear, ideal: TendonGear, tmp_path: Path, force: float, end_effector: float | None
) -> None:
    """Hysteresis loops of the large one under the forces of Fig. 14, carried over, are the small one's."""
    scaled_up = ideal if end_effector is None else ideal.replace(end_effector_length=end_effector)
    carried = carry(recorded(tmp_path / "log.mcap", scaled_up, cycles(force)), real_size)
    twin, time = directly(real_size, carried.run)
    predicted = np.interp(time, carried.run.time, carried.run["measured_output_angle"])
    off = np.degrees(predicted - twin["measured_output_angle"])
    assert np.sqrt(np.mean(off**2)) <= LIMIT
    assert carried.warnings == ()
    half_a_loop = np.degrees(
        np.ptp(twin["output_angle"] - np.interp(time, carried.run.time, _unloaded(real_size, carried.run)))
    )
    assert half_a_loop > 10 * LIMIT


def _unloaded(inst: Instrument, run: Run) -> np.ndarray:
    return cast(np.ndarray, tn.statics.output_angle(inst, run["commanded_handle_angle"]))


def test_ropes_softer_than_their_file_says_are_accounted_for(
    real_size: TendonGear, ideal: TendonGear, tmp_path: Path
) -> None:
    """Identified as 0.85 of nominal, the stiffness makes the factors; by the nominal ones the round trip is worse."""
    soft = ideal.replace(**{"mismatch.stiffness_ratio": 0.85, "pretension": ideal.pretension * 0.85})
    log = recorded(tmp_path / "log.mcap", soft, cycles(1.5))
    carried = carry(log, real_size)
    assert [warning.split(":")[0] for warning in carried.warnings] == ["scaled-up has mismatch.stiffness_ratio 0.85"]
    assert carried.factors["yaw"]["tension"] == pytest.approx(0.85 * 1.37755, rel=1e-5)
    errors = []
    for scaled_up in (soft, soft.replace(mismatch=None)):
        run = carry(log, real_size, scaled_up=scaled_up).run
        twin, time = directly(real_size, run)
        off = np.interp(time, run.time, run["output_angle"]) - twin["output_angle"]
        errors.append(np.degrees(np.sqrt(np.mean(off**2))))
    assert errors[0] <= LIMIT
    assert errors[0] < errors[1]


def test_there_and_back_is_where_it_began(any_inst: Instrument, tmp_path: Path) -> None:
    small = any_inst.axis(any_inst.axes[0]).replace(mismatch=None)
    large = geometrically_scaled(small, 2.5)
    log = recorded(tmp_path / "log.mcap", large, cycles(0.2, "200 deg/s", "20 deg"), quasi_static=True)
    carried = carry(log, small)
    assert carried.factors[small.axes[0]]["force"] == pytest.approx(2.5**2)
    assert carried.factors[small.axes[0]]["handle_torque"] == pytest.approx(2.5**3)
    carried.write(tmp_path / "there.mcap")
    back = carry(Recording.open(tmp_path / "there.mcap"), large).run
    assert back.time == pytest.approx(log.run.time, rel=1e-12)
    for name, values in log.run.signals().items():
        assert back[name] == pytest.approx(values, rel=1e-12, abs=1e-15), name
    assert carried.warnings == (() if small.friction.law != "none" else carried.warnings[:1])


# What is carried, and how


def test_every_signal_with_a_dimension_is_carried_by_its_factor() -> None:
    for name, signal in SIGNALS.items():
        dimensional = signal.unit not in ("rad", "1") or "spool" in name
        assert (name in QUANTITY) == dimensional, name


def test_signals_are_divided_by_the_factors_and_angles_are_not(
    log: Recording, real_size: TendonGear, ideal: TendonGear
) -> None:
    carried = carry(log, real_size)
    before, after, scale = log.run, carried.run, carried.factors["yaw"]
    for name, key in QUANTITY.items():
        if name in before.signals():
            assert after[name] == pytest.approx(before[name] / scale[key], rel=1e-14), name
    for name in before.signals().keys() - QUANTITY.keys():
        assert (after[name] == before[name]).all(), name
    assert scale["force"] == pytest.approx(2.880, abs=1e-3)
    assert scale["tension"] == pytest.approx(1.3776, abs=1e-4)
    assert carried.largest_force == pytest.approx(1.5 / scale["force"])
    assert carried.largest_tension == pytest.approx(
        max(np.abs(before[name]).max() for name in before.signals() if name.endswith("tension")) / scale["tension"]
    )
    assert after["output_velocity"][200:] == pytest.approx(
        np.gradient(after["output_angle"], after.time)[200:], abs=0.05 * np.abs(after["output_velocity"]).max()
    )
    rest = carry(log, real_size, time_factor=2.0)
    assert rest.run.time == pytest.approx(before.time / 2, rel=1e-15)
    assert rest.factors["yaw"]["spool_velocity"] == pytest.approx(scale["spool_angle"] / 2)
    assert (carry(log, real_size).run.time == after.time).all()
    assert 0 < carried.similarity_error() < LIMIT


def test_a_controllers_estimates_are_carried_and_its_state_is_not(
    real_size: TendonGear, ideal: TendonGear, tmp_path: Path
) -> None:
    controller = tn.control.Controller(ideal)
    log = recorded(tmp_path / "log.mcap", ideal, cycles(1.5, "200 deg/s", "20 deg"), controller=controller)
    carried = carry(log, real_size)
    carried.write(tmp_path / "real.mcap")
    after = Recording.open(tmp_path / "real.mcap").run
    for name in ("operating_state", "faults", "phase", "request", "friction_scale", "estimated_output_angle_std"):
        assert np.array_equal(after[name], log.run[name], equal_nan=True), name
    for name in ("estimated_force", "estimated_force_std"):
        expected = log.run[name] / carried.factors["yaw"]["force"]
        assert after[name] == pytest.approx(expected, nan_ok=True), name


def test_the_file_says_where_it_is_from_and_reads_as_any_other(
    log: Recording, real_size: TendonGear, real: TendonGear, ideal: TendonGear, tmp_path: Path
) -> None:
    carried = carry(log, real)
    carried.write(tmp_path / "real.mcap")
    back = Recording.open(tmp_path / "real.mcap")
    assert (back.run.time == carried.run.time).all()
    assert back.topics.keys() == log.topics.keys()
    assert back.instrument() == carried.real_size
    assert carried.real_size.replace(friction=None, sources=None) == real_size.replace(friction=None, sources=None)
    assert carried.real_size.friction == ideal.friction
    assert tn.parse(back.metadata["scaled_up_instrument"]) == ideal
    assert back.metadata["transferred_from"] == "log.mcap"
    assert tomllib.loads(back.metadata["transfer_factors"])["yaw"] == pytest.approx(carried.factors["yaw"])
    assert "protocol" not in back.metadata
    assert back.metadata["scaled_up_protocol"] == log.metadata["protocol"]
    with refused("transferred_from", "log.mcap", kind=RecordingError):
        replay(back)


def test_each_axis_has_factors_of_its_own(real: TendonGear, tmp_path: Path) -> None:
    small = real.replace(friction=None)
    large = small.replace(
        distal_gear_radius=6e-3,
        proximal_gear_radius=13.5e-3,
        overrides={"pitch": {"distal_gear_radius": 8e-3, "proximal_gear_radius": 18e-3}},
    )
    with Recorder(tmp_path / "log.mcap", axes=large.axes, metadata={"instrument": to_toml(large)}) as recorder:
        recorder.write(Twin(large).run(np.linspace(0, 0.1, 40), 0.5))
    log = Recording.open(tmp_path / "log.mcap")
    carried = carry(log, small)
    yaw, pitch = (carried.factors[axis] for axis in ("yaw", "pitch"))
    assert (yaw["tension"], pitch["tension"]) == pytest.approx((3.0, 4.0))
    assert yaw["time"] == pitch["time"]
    assert carried.run["tension"] == pytest.approx(log.run["tension"] / [3.0, 3.0, 4.0, 4.0], rel=1e-12)
    assert carried.run["force"] == pytest.approx(log.run["force"] / [yaw["force"], pitch["force"]], rel=1e-12)
    assert carried.real_size.axes == ("yaw", "pitch")
    assert [warning.partition(" N,")[0] for warning in carried.warnings] == [
        "the pretension of real-size (yaw) was 30",
        "the pretension of real-size (pitch) was 30",
        "real-size has no friction to transfer: real-size keeps its own.",
    ]


# Warnings


def test_a_pretension_that_was_not_scaled_is_reported_with_the_right_one(
    real_size: TendonGear, scaled: TendonGear, tmp_path: Path
) -> None:
    """As the paper tested: 25 N where 30 N on the real one scale to 41.3 N."""
    log = recorded(tmp_path / "log.mcap", scaled.replace(mismatch=None), cycles(0.5, "200 deg/s", "20 deg"))
    assert carry(log, real_size).warnings == (
        "the pretension of scaled-up was 25 N, 16.3 N less than the 41.33 N that 30 N of real-size scale to: "
        "slack is not similar.",
    )


def test_other_ratios_of_radii_and_sensors_in_error_are_reported(
    log: Recording, real_size: TendonGear, ideal: TendonGear
) -> None:
    other = ideal.replace(
        proximal_gear_radius="15 mm",
        **{"mismatch.output_encoder_offset": "-1.4 deg", "mismatch.load_cell_bias": (0.1, -0.2)},
    )
    ratio, sensors = carry(log, real_size, scaled_up=other).warnings
    assert ratio == (
        "R/r is 2 on scaled-up and 2.25 on real-size: the same handle angle leads to another output angle."
    )
    assert sensors == (
        "scaled-up has mismatch.output_encoder_offset -1.4 deg, load_cell_bias 0.1 N and -0.2 N: "
        "measured signals are converted as measured."
    )


def test_a_damaged_recording_is_carried_as_far_as_it_reads(
    log: Recording, real_size: TendonGear, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.mcap"
    data = log.path.read_bytes()
    cut.write_bytes(data[: len(data) // 2])
    part = Recording.open(cut)
    carried = carry(part, real_size)
    assert 0 < len(carried.run) == len(part.run) < len(log.run)
    assert carried.warnings == (part.damage,)
    cut.write_bytes(data[:6000])
    with refused("rows", 0, kind=RecordingError):
        carry(Recording.open(cut), real_size)


# Friction


def test_identified_friction_is_carried_by_dimension(real_size: TendonGear, ideal: TendonGear) -> None:
    rubbing = {"law": "stribeck", "vertex_coefficient": 0.2, "sheath_coefficient": 0.15, "sheath_bend": "30 deg",
               "constant": "2 N", "viscous": "3 N*s/m", "static_ratio": 1.4, "sheath_contacts": 3}  # fmt: skip
    identified = ideal.replace(friction=rubbing)
    carried = carry_friction(identified, real_size, source="identified.toml")
    before, after = identified.friction, carried.friction
    for key in ("law", "vertex_coefficient", "sheath_coefficient", "sheath_bend", "static_ratio", "sheath_contacts"):
        assert getattr(after, key) == getattr(before, key), key
    tension, stroke, time = 1.37755, 3.75, np.sqrt(100 * 1.37755 * 3.75) / (1.37755 * 3.75)
    assert after.constant == pytest.approx(2 / tension, rel=1e-5)
    assert after.viscous == pytest.approx(3 / (tension * time / stroke), rel=1e-5)
    assert after.stribeck_speed == pytest.approx(1e-3 / (stroke / time), rel=1e-5)
    assert after.memory == pytest.approx(5e-3 / time, rel=1e-5)
    assert carried.sources["friction"] == "transferred from scaled-up (identified.toml)"
    assert carried.replace(friction=None, sources=None) == real_size.replace(friction=None, sources=None)
    assert tn.parse(to_toml(carried)) == carried


def test_the_stiffness_of_a_rope_stays_with_the_rope(real_size: TendonGear, scaled: TendonGear) -> None:
    carried = carry_friction(scaled, real_size)
    assert carried.mismatch == real_size.mismatch
    assert carried.tendon_stiffness == real_size.tendon_stiffness
    assert left_behind(scaled)[0].startswith("scaled-up has mismatch.stiffness_ratio 0.85: a property of its ropes")
    assert "friction.sheath_bend" not in carried.sources
    assert carried.sources["pretension"] == real_size.sources["pretension"]


# Refusals


def test_what_cannot_be_carried_is_refused_in_one_sentence(
    log: Recording, real_size: TendonGear, ideal: TendonGear, pulley: Instrument, tmp_path: Path
) -> None:
    with pytest.raises(InstrumentError, match="scaled-up has joint_type tendon-gear, pulley wrist tendon-pulley; both"):
        carry(log, pulley)
    with pytest.raises(InstrumentError, match="real-size has no axis 'yaw'; it has pitch"):
        carry(log, real_size.replace(axes=("pitch",)))
    with pytest.raises(RecordingError, match="has the axes yaw, scaled-up pitch; the scaled-up instrument must"):
        carry(log, real_size, scaled_up=ideal.replace(axes=("pitch",)))
    for factor in (0.0, np.nan, -1.0):
        with pytest.raises(ValueError, match=r"time_factor is .*; it must be a number above 0"):
            carry(log, real_size, time_factor=factor)
    with pytest.raises(InstrumentError, match=r"scaled-up has no friction to transfer; its friction.law must"):
        carry_friction(ideal.replace(friction=None), real_size)
    with Recorder(tmp_path / "bare.mcap", axes=("yaw",)) as recorder:
        recorder.write(log.run)
    bare = Recording.open(tmp_path / "bare.mcap")
    with pytest.raises(RecordingError, match=r"bare\.mcap does not contain its instrument; give"):
        carry(bare, real_size)
    assert carry(bare, real_size, scaled_up=ideal).run["force"] == pytest.approx(carry(log, real_size).run["force"])
    with pytest.raises(RecordingError, match="the run does not contain its instrument; give"):
        carry(log.run, real_size)


def test_a_run_is_carried_as_its_recording_is(
    log: Recording, real_size: TendonGear, ideal: TendonGear, tmp_path: Path
) -> None:
    carried, recorded = carry(log.run, real_size, scaled_up=ideal), carry(log, real_size)
    for name, values in recorded.run.signals().items():
        assert np.array_equal(carried.run[name], values, equal_nan=True), name
    assert (carried.run.time == recorded.run.time).all()
    assert carried.factors == recorded.factors
    carried.write(tmp_path / "real.mcap")
    assert Recording.open(tmp_path / "real.mcap").metadata["transferred_from"] == "a run of scaled-up"


# The command


@pytest.fixture
def folder(log: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.mcap").write_bytes(log.path.read_bytes())
    return tmp_path


def command(monkeypatch: pytest.MonkeyPatch, *words: str) -> Result:
    monkeypatch.setenv("COLUMNS", "200")
    app = typer.Typer()
    app.callback()(lambda: None)
    app.command()(transfer_command.transfer)
    return CliRunner().invoke(app, ["transfer", *words])


def test_the_command_writes_both_files_and_reports_the_factors(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blocks, "LEAST_ROWS", 300)
    done = command(monkeypatch, "real-size", "log.mcap", "--instrument-out", "rubbing.toml")
    assert done.exit_code == 0
    whole = carry(Recording.open("log.mcap"), tn.load("real-size"))
    for words in (
        "force 2.8802 force",
        "unchanged: commanded_handle_angle",
        "largest force on real-size: 0.5208 N.",
        f"largest tension on real-size: {whole.largest_tension:.4g} N.",
        f"{len(whole.run)} rows.",
        "largest similarity error up to that force, without friction: ",
        "log-real-size.mcap: log.mcap in units of real-size",
        "rubbing.toml: real-size with the friction of scaled-up.",
    ):
        assert words in " ".join(done.output.split())
    written = Recording.open("log-real-size.mcap").run
    assert written["force"].max() == pytest.approx(1.5 / 2.8802, rel=1e-4)
    assert bits(written) == bits(whole.run)
    rubbing = tn.load("rubbing.toml")
    assert rubbing.axes == ("yaw", "pitch")
    assert rubbing.sources["friction"] == "transferred from scaled-up (log.mcap)"
    again = command(monkeypatch, "rubbing.toml", "log.mcap", "--out", "again.mcap", "--scaled-up", "scaled-up")
    assert again.exit_code == 0
    assert "warning: scaled-up has mismatch.stiffness_ratio 0.85" in again.output


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["real-size", "no.mcap"], "no.mcap cannot be read: there is no such file."),
        (["pulley.toml", "log.mcap"], "scaled-up has joint_type tendon-gear"),
        (["real-size", "log.mcap", "--time-factor", "0"], "time_factor is 0.0; it must be a number above 0."),
        (["real-size", "log.mcap", "--out", "pulley.toml"], "pulley.toml: --out writes an MCAP recording, whose"),
    ],
)
def test_mistakes_end_in_one_sentence_and_leave_inputs_alone(
    folder: Path, pulley: Instrument, monkeypatch: pytest.MonkeyPatch, words: list[str], message: str
) -> None:
    (folder / "pulley.toml").write_text(to_toml(pulley))
    before = {file: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    done = command(monkeypatch, *words)
    assert done.exit_code == 1
    assert str(done.exception).startswith(message)
    assert "\n" not in str(done.exception)
    assert {file: file.read_bytes() for file in folder.iterdir() if file.is_file()} == before

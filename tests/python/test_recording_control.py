"""Claims about recordings of a controller: its signals are on file, and the file gives the same run again."""

import runpy
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rich.console import Console

import tenodesis as tn
from tenodesis import simulate
from tenodesis.control import FAULTS, Controller, OperatingState
from tenodesis.errors import ArgumentError, ProtocolError, RecordingError
from tenodesis.instrument import Instrument
from tenodesis.recording import Recorder, Recording
from tenodesis.recording.metadata import CONTROLLER_INSTRUMENT, restored_controller
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record
from tenodesis.recording.summary import describe, facts, outcome, tip_error
from tenodesis.run import CONTROL
from tenodesis.simulate import Cycles, Hold, Pretension, Protocol, Ramp, StepLoad
from tenodesis.twin import Twin

from .conftest import EXAMPLES, refused
from .recording_samples import bits
from .test_protocols_control import Stuck

PROTOCOL = Protocol(
    name="short",
    phases=(
        Cycles(amplitude="15 deg", period="0.6 s", count=1, shape="sine", force=0.5),
        StepLoad(handle_angle="5 deg", force="-0.5 N", rise=0.05, duration=0.6, release=0.1, approach="60 deg/s"),
    ),
)
SLACK = Protocol(name="slack", phases=(Pretension(), *PROTOCOL.phases))


def another(inst: Instrument) -> Instrument:
    """A controller's own idea of an instrument: stiffer tendons, and a smaller dead band."""
    return inst.replace(tendon_stiffness=1.1 * inst.tendon_stiffness, **{"control.dead_band": "0.2 deg"})


def shown(recording: Recording) -> str:
    console = Console(width=160)
    with console.capture() as capture:
        console.print(describe(recording))
    return capture.get()


# What is on file


def test_a_controlled_run_is_on_file_and_replays_bit_by_bit(any_inst: Instrument, tmp_path: Path) -> None:
    controller = Controller(another(any_inst), homed=False)
    run = record(any_inst, SLACK, tmp_path / "run.mcap", controller=controller, seed=5)
    recording = Recording.open(tmp_path / "run.mcap")
    assert (recording.damage, recording.left_out) == (None, {})
    assert bits(recording.run) == bits(run)
    assert set(CONTROL) <= run.signals().keys()
    again = replay(recording)
    assert again.exact
    assert bits(again.run) == bits(run)


@pytest.mark.parametrize(
    ("law", "observer", "actuation"),
    [("off", "friction", "agonist"), ("paper", "paper", "agonist"), ("exact", "exact", "differential")],
)
def test_every_choice_is_made_again(
    scaled: Instrument, law: Any, observer: Any, actuation: Any, tmp_path: Path
) -> None:
    controller = Controller(scaled, observer, law, actuation, enabled=law != "off", period=1e-3)
    record(scaled, PROTOCOL, tmp_path / "run.mcap", controller=controller)
    recording = Recording.open(tmp_path / "run.mcap")
    made = restored_controller(recording)
    assert made is not None
    for name in ("inst", "law", "observer", "actuation", "homed_at_start", "enabled_at_start", "parameters"):
        assert getattr(made, name) == getattr(controller, name), name
    assert CONTROLLER_INSTRUMENT not in recording.metadata
    assert tomllib.loads(recording.metadata["controller"])["faults"] == list(FAULTS)
    assert replay(recording).exact


@pytest.mark.parametrize("choice", [{"precision": "single"}, {"own_clock": True}], ids=str)
def test_precision_and_clock_are_made_again(scaled: Instrument, choice: dict[str, Any], tmp_path: Path) -> None:
    record(scaled, PROTOCOL, tmp_path / "run.mcap", controller=Controller(scaled, **choice))
    made = tomllib.loads(Recording.open(tmp_path / "run.mcap").metadata["controller"])
    assert {key: made[key] for key in choice} == choice
    assert replay(Recording.open(tmp_path / "run.mcap")).exact


def test_ticks_slower_than_steps_replay_in_one_piece_what_ran_in_blocks(scaled: Instrument, tmp_path: Path) -> None:
    record(scaled, PROTOCOL, tmp_path / "run.mcap", controller=Controller(scaled), time_step=2.5e-4)
    assert replay(Recording.open(tmp_path / "run.mcap")).exact


def test_a_quasi_static_run_replays(scaled: Instrument, tmp_path: Path) -> None:
    controller = Controller(scaled, period=1e-3)
    record(scaled, PROTOCOL, tmp_path / "run.mcap", controller=controller, time_step=1e-3, quasi_static=True)
    assert replay(Recording.open(tmp_path / "run.mcap")).exact


def test_a_controller_is_recorded_from_its_start(scaled: Instrument, tmp_path: Path) -> None:
    controller = Controller(scaled)
    runs = [record(scaled, PROTOCOL, tmp_path / f"{n}.mcap", controller=controller) for n in range(2)]
    assert bits(runs[0]) == bits(runs[1])


def test_before_it_runs_the_signals_of_a_controller_are_nan(scaled: Instrument, tmp_path: Path) -> None:
    only = Protocol(name="only", phases=(Pretension(),))
    run = record(scaled, only, tmp_path / "run.mcap", controller=Controller(scaled, homed=False))
    started = int(np.argmax(~np.isnan(run["operating_state"])))
    assert run["tension"][started - 1].max() == 0
    for name in CONTROL:
        assert np.isnan(run[name][:started]).all(), name
    assert not np.isnan(run["operating_state"][started:]).any()
    assert run["commanded_spool_velocity"][:started].min() < 0


@pytest.mark.parametrize("name", ["scaled", "real"])
def test_stock_readers_find_the_controllers_signals_by_topic(name: str, request: Any, tmp_path: Path) -> None:
    inst: Instrument = request.getfixturevalue(name)
    hold = Protocol(name="hold", phases=(Hold(duration=0.1),))
    run = record(inst, hold, tmp_path / "run.mcap", controller=Controller(inst))
    messages: dict[str, list[Any]] = {}
    with (tmp_path / "run.mcap").open("rb") as file:
        for _, channel, _, decoded in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            messages.setdefault(channel.topic, []).append(decoded)
    for topic, array, signal in (
        ("/controller/tip/measured_js", "position", "estimated_output_angle"),
        ("/controller/tip/measured_js", "effort", "estimated_force"),
        ("/controller/tip/measured_js_std", "position", "estimated_output_angle_std"),
        ("/controller/tip/measured_js_std", "effort", "estimated_force_std"),
    ):
        assert messages[topic][0].name == [*inst.axes]
        assert np.array([getattr(message, array) for message in messages[topic]]).tobytes() == run[signal].tobytes()
    for signal in ("friction_scale", "friction_scale_std", "operating_state", "faults", "phase", "request"):
        for n, axis in enumerate(inst.axes):
            topic = f"/controller/{axis}/{signal}" if inst.axes[1:] else f"/controller/{signal}"
            found = np.array([message.data for message in messages[topic]])
            assert found.tobytes() == run[signal].reshape(len(run), -1)[:, n].tobytes()


def test_a_recording_without_a_controller_is_as_it_was(scaled: Instrument, tmp_path: Path) -> None:
    run = record(scaled, PROTOCOL, tmp_path / "run.mcap")
    recording = Recording.open(tmp_path / "run.mcap")
    assert not set(CONTROL) & run.signals().keys()
    assert not [name for name in recording.topics if name.startswith("/controller")]
    assert not [key for key in recording.metadata if key.startswith("controller")]
    assert restored_controller(recording) is None
    assert "controller" not in facts(recording)
    assert replay(recording).exact


# Run again


def test_a_cut_off_recording_replays_up_to_there(scaled: Instrument, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    record(scaled, SLACK, path, controller=Controller(scaled, homed=False))
    whole = path.read_bytes()
    rows = []
    for share in (0.05, 0.2, 0.7):
        path.write_bytes(whole[: int(share * len(whole))])
        recording = Recording.open(path)
        rows.append(len(recording.run))
        assert recording.damage is not None
        assert replay(recording).exact
    assert 0 < rows[0] < rows[1] < rows[2]


def test_on_another_instrument_the_controller_stays_what_it_was(scaled: Instrument, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    record(scaled, PROTOCOL, path, controller=Controller(scaled))
    other = scaled.replace(**{"mismatch.stiffness_ratio": 0.7})
    again = replay(Recording.open(path), other)
    assert not again.exact
    by_hand = simulate.execute(Twin(other), PROTOCOL, Controller(scaled))
    assert bits(again.run) == bits(by_hand)


def test_wrong_choices_in_a_recording_are_refused(scaled: Instrument, tmp_path: Path) -> None:
    hold = Protocol(name="hold", phases=(Hold(duration=0.1),))
    run = record(scaled, hold, tmp_path / "run.mcap", controller=Controller(scaled))
    metadata = dict(Recording.open(tmp_path / "run.mcap").metadata)
    good = metadata["controller"]
    for text, sentence in (
        ("law = ", "metadata controller is not valid TOML"),
        (good.replace('"robust"', '"magic"'), "metadata controller: law is 'magic'"),
        (good.replace('observer = "friction"', 'observer = "paper"'), '"friction"'),
        (good + "\nmood = 3\n", "metadata controller: .*mood"),
    ):
        with Recorder(
            tmp_path / "bad.mcap", axes=run.axes, metadata=metadata | {"controller": text}, overwrite=True
        ) as recorder:
            recorder.write(run)
        bad = Recording.open(tmp_path / "bad.mcap")
        with pytest.raises(RecordingError, match=sentence):
            replay(bad)
        assert "controller" in shown(bad)


# What came of it


def test_the_tip_is_compared_with_the_instrument_without_load_and_friction(any_inst: Instrument) -> None:
    quiet = any_inst.replace(
        friction=None, mismatch=None, **{"sensors.encoder_noise": 0.0, "sensors.load_cell_noise": 0.0}
    )
    run = simulate.execute(
        Twin(quiet), Protocol(name="bend", phases=(Ramp(handle_angle=0.2, duration=1.0), Hold(duration=2.0)))
    )
    error = tip_error(run, quiet)
    assert error.shape == (len(run), len(quiet.axes))
    assert abs(error[-1, 0]) < 1e-3
    handle = run["handle_angle"].reshape(len(run), -1)[:, 0]
    off = run["output_angle"].reshape(len(run), -1)[:, 0] - tn.statics.output_angle(quiet, handle)
    np.testing.assert_allclose(error[:, 0], off, atol=1e-9)


def test_the_summary_has_state_faults_and_tip(scaled: Instrument, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    run = record(scaled, SLACK, path, controller=Controller(another(scaled), homed=False))
    facts = outcome(run, scaled)
    off = np.degrees(tip_error(run, scaled)[-1, 0])
    assert facts["state"].startswith("ENABLED at the end (ENABLED ")
    assert facts["faults"] == "none"
    assert facts["tip"].startswith(f"yaw {off:+.2f} deg off the unloaded angle at the end, ")
    text = shown(Recording.open(path))
    for words in (
        "robust law, friction observer, differential actuation, made for another instrument (scaled-up)",
        *facts.values(),
        "/controller/tip/measured_js_std",
        "estimated_output_angle.yaw",
    ):
        assert words in text


def test_without_a_controller_the_summary_has_what_the_load_took(scaled: Instrument) -> None:
    run = simulate.execute(Twin(scaled), PROTOCOL)
    facts = outcome(run, scaled)
    off = np.degrees(tip_error(run, scaled)[:, 0])
    worst = np.abs(off).argmax()
    assert facts["tip"] == (
        f"yaw {off[worst]:+.2f} deg off the unloaded angle at most, at {run.time[worst]:.4g} s, "
        f"{off[-1]:+.2f} deg at the end"
    )
    least = run["tension"].min(axis=0)
    assert facts["tensions"].startswith(f"yaw_agonist {least[0]:.3g} to ")
    assert facts["slack"] == "no tendon"
    slack = outcome(replace(run, distal_tension=run["distal_tension"] - [0.0, 1e3]), scaled)["slack"]
    assert slack.startswith("yaw_antagonist for ")
    rounded = replace(run, distal_tension=np.where([True, False], 4e-15, run["distal_tension"]))
    assert outcome(rounded, scaled)["slack"].startswith("yaw_agonist for ")


def test_faults_are_named_with_their_first_time(scaled: Instrument) -> None:
    run = simulate.execute(Stuck(scaled), PROTOCOL, Controller(scaled))
    facts = outcome(run, scaled)
    assert facts["faults"].startswith("load_cell_stuck from 0.5")
    assert facts["state"].startswith("FAULT at the end (ENABLED 0.5")
    renamed = outcome(run, scaled, [f"old_{name}" for name in FAULTS])
    assert renamed["faults"].startswith("old_load_cell_stuck from 0.5")


def test_a_run_into_a_fault_is_recorded_to_its_end_and_replays(scaled: Instrument, tmp_path: Path) -> None:
    loose = scaled.replace(**{"mismatch.pretension_ratio": 0.2})
    run = record(loose, PROTOCOL, tmp_path / "run.mcap", controller=Controller(scaled))
    assert run["operating_state"][-1] == OperatingState.FAULT
    assert run.time[-1] == pytest.approx(PROTOCOL.duration(scaled), abs=0.01)
    recording = Recording.open(tmp_path / "run.mcap")
    assert "FAULT at the end" in shown(recording)
    assert replay(recording).exact


def test_the_summary_of_a_run_of_sensors_alone_takes_the_sensors(scaled: Instrument) -> None:
    run = simulate.execute(Twin(scaled), PROTOCOL, Controller(scaled))
    bench = replace(run, handle_angle=None, output_angle=None)
    assert "deg off the unloaded angle" in outcome(bench, scaled)["tip"]
    assert "tip" not in outcome(replace(bench, measured_output_angle=None), scaled)


# Bad input


def test_what_a_controller_cannot_run_leaves_no_file(
    scaled: Instrument, real: Instrument, pulley: Instrument, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    for controller, protocol, problem, key in (
        (Controller(pulley), PROTOCOL, ArgumentError, "controller"),
        (Controller(real), PROTOCOL, ArgumentError, "controller"),
        (
            Controller(scaled),
            Protocol(name="p", phases=(Ramp(duration=0.1, spool_velocity=(0.1, 0.1)),)),
            ProtocolError,
            "spool_velocity",
        ),
    ):
        with refused(key, kind=problem):
            record(scaled, protocol, path, controller=controller)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_the_example_restores_the_lost_angle(capsys: pytest.CaptureFixture[str]) -> None:
    runpy.run_path(str(EXAMPLES / "control.py"))
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert [row[0] for row in rows] == ["none", "paper", "robust"]
    assert [row[-2:] for row in rows] == [["same", "bits"]] * 3
    none, paper, robust = (abs(float(row[3])) for row in rows)
    assert robust < 0.7 < paper < none

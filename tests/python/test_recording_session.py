"""Claims about recorded sessions: a run on file can be run again, to the last bit, from what the file says."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tenodesis as tn
from tenodesis import simulate
from tenodesis.errors import InstrumentError, NoSolutionError, ProtocolError, RecordingError
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml
from tenodesis.recording import Recorder, Recording
from tenodesis.recording.replay import replay
from tenodesis.recording.simulation import record, write_run
from tenodesis.run import MEASURED, Names, Run
from tenodesis.simulate import Cycles, Hold, Motion, Pretension, Protocol, Ramp, StepLoad
from tenodesis.twin import Twin

from .conftest import EXAMPLES, refused
from .recording_samples import bits

SHORT = Protocol(
    name="short",
    phases=(
        Cycles(amplitude="15 deg", period="0.4 s", count=1, shape="sine", force=0.0, force_end=1.0),
        StepLoad(handle_angle="5 deg", force="-0.5 N", rise=0.05, duration=0.1, release=0.1, approach="60 deg/s"),
        Ramp(duration=0.2, spool_velocity=(0.1, -0.1), radial_force=0.3),
    ),
)


def bench_run(run: Run) -> Run:
    """A twin's run as a bench would have it: without the truth and without what only the hand knows."""
    names = {*MEASURED, "force", "commanded_spool_velocity"}
    return Run(run.time, run.axes, **{name: values for name, values in run.signals().items() if name in names})


# Instruments and protocols as text


@pytest.mark.parametrize("name", ["real-size", "scaled-up", EXAMPLES / "pulley.toml", EXAMPLES / "continuum.toml"])
def test_an_instrument_comes_back_from_its_text(name: Any) -> None:
    inst = tn.load(name)
    assert tn.parse(to_toml(inst)) == inst


@settings(max_examples=30, deadline=None)
@given(
    name=st.text(st.characters(exclude_categories=["C", "Z"]), min_size=1, max_size=20),
    description=st.text(max_size=50),
    pretension=st.floats(1, 60),
    modulus=st.floats(1e10, 2e11),
    coefficient=st.floats(0, 1),
    bias=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    forces=st.lists(st.floats(1e-3, 10), max_size=4),
    counts=st.integers(1, 2**24),
    rigid=st.booleans(),
)
def test_a_changed_instrument_comes_back_to_the_last_bit(
    name: str,
    description: str,
    pretension: float,
    modulus: float,
    coefficient: float,
    bias: tuple[float, float],
    forces: list[float],
    counts: int,
    rigid: bool,
) -> None:
    inst = tn.load("real-size").replace(
        name=name,
        description=description,
        pretension=pretension,
        tendon_modulus=modulus,
        tendon_stiffness=modulus / 1e6 if rigid else None,
        overrides={"pitch": {"pretension": f"{pretension / 2!r} N"}},
        **{
            "friction.law": "stribeck",
            "friction.vertex_coefficient": coefficient,
            "friction.static_ratio": 1 + coefficient,
            "mismatch.load_cell_bias": bias,
            "conditions.forces": tuple(forces),
            "drives.encoder_counts": counts,
        },
    )
    again = tn.parse(to_toml(inst))
    assert again == inst
    assert again.axis("pitch") == inst.axis("pitch")


def test_bare_numbers_among_overrides_come_back_with_their_unit(real: Instrument) -> None:
    inst = real.replace(overrides={"pitch": {"pretension": 1 / 3, "tendon_length": 0.6}})
    again = tn.parse(to_toml(inst))
    assert again.axis("pitch") == inst.axis("pitch")
    assert again.overrides["pitch"]["pretension"] == "0.3333333333333333 N"


@pytest.mark.parametrize("name", ["cycles", "pretension", "step-load", EXAMPLES / "protocol.toml"])
def test_a_protocol_comes_back_from_its_text(name: Any) -> None:
    protocol = simulate.load(name)
    assert simulate.parse(protocol.to_toml()) == protocol
    assert simulate.parse(SHORT.to_toml()) == SHORT


def test_a_protocols_text_holds_the_recorded_motion(scaled: Instrument, tmp_path: Path) -> None:
    file = tmp_path / "motion.csv"
    file.write_text('# mine\n"t, ""s""",x,angle\n0.1,0,0.30000000000000004\n0.7,0,-1e-3\n')
    protocol = Protocol(
        name="m", phases=(Motion(file=file, time_column='t, "s"', angle_unit="deg", limit=True, offset="1 deg"),)
    )
    again = simulate.parse(protocol.to_toml())
    file.unlink()
    for name, values in protocol.commands(scaled, 1e-3).items():
        np.testing.assert_array_equal(values, again.commands(scaled, 1e-3)[name])


# Recording and replaying


@pytest.mark.parametrize("quasi_static", [False, True])
def test_a_recording_is_what_the_twin_did_and_replays_bit_by_bit(
    any_inst: Instrument, quasi_static: bool, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    run = record(any_inst, SHORT, path, seed=2**64 - 1, time_step=2.5e-4, quasi_static=quasi_static)
    twin = Twin(any_inst, seed=2**64 - 1, time_step=2.5e-4, quasi_static=quasi_static)
    assert bits(run) == bits(simulate.execute(twin, SHORT))
    recording = Recording.open(path)
    assert bits(recording.run) == bits(run)
    assert recording.instrument() == any_inst
    assert simulate.parse(recording.metadata["protocol"]) == SHORT
    again = replay(recording)
    assert again.exact
    assert bits(again.run) == bits(run)
    assert {difference.largest for difference in again.differences().values()} == {0.0}


def test_a_run_written_afterwards_is_the_same_file(scaled: Instrument, tmp_path: Path) -> None:
    for name, controller in (("plain", None), ("controlled", tn.control.Controller(scaled))):
        protocol = Protocol(name="p", phases=SHORT.phases[:2])
        now, later = tmp_path / f"{name}.mcap", tmp_path / f"{name}-later.mcap"
        run = record(scaled, protocol, now, controller=controller, seed=3)
        write_run(run, scaled, later, protocol=protocol, controller=controller, seed=3)
        assert now.read_bytes() == later.read_bytes()


def test_a_weight_recorded_as_its_force_replays_bit_by_bit(scaled: Instrument, tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    weight, force = rng.uniform(-10, 10, 2000), rng.uniform(-0.5, 0.5, 2000)
    run = Twin(scaled).run(np.zeros(2000), force, weight=weight)
    path = tmp_path / "run.mcap"
    with Recorder(path, axes=run.axes, metadata={"instrument": to_toml(scaled), "time_step": "0.0005"}) as recorder:
        recorder.write(run)
    assert replay(Recording.open(path)).exact


@pytest.mark.parametrize("name", ["real-size", "scaled-up", EXAMPLES / "pulley.toml", EXAMPLES / "continuum.toml"])
def test_a_pretension_begins_slack_and_replays(name: Any, tmp_path: Path) -> None:
    inst = tn.load(name)
    run = record(inst, simulate.load("pretension"), tmp_path / "run.mcap")
    assert run.tension is not None
    assert run.tension.min() == 0
    assert np.abs(run.tension[-1] - inst.pretension).max() < 0.5
    assert replay(Recording.open(tmp_path / "run.mcap")).exact


def test_a_slow_protocol_is_written_in_chunks_of_a_quarter_second(scaled: Instrument, tmp_path: Path) -> None:
    run = record(scaled, simulate.load("pretension"), tmp_path / "run.mcap")
    from mcap.reader import make_reader

    with (tmp_path / "run.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    spans = [chunk.message_end_time - chunk.message_start_time for chunk in summary.chunk_indexes]
    assert len(spans) < 1.2 * run.time[-1] / 0.25 + 2
    assert max(spans) < 0.25e9


def test_differences_to_another_instrument_are_measured(scaled: Instrument, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    run = record(scaled, SHORT, path)
    other = scaled.replace(pretension=20.0)
    again = replay(Recording.open(path), other)
    assert not again.exact
    differences = again.differences()
    assert list(differences) == ["output_angle.yaw", "tension.yaw.agonist", "tension.yaw.antagonist"]
    assert run.tension is not None
    assert again.run.tension is not None
    off = again.run.tension[:, 0] - run.tension[:, 0]
    assert differences["tension.yaw.agonist"] == (pytest.approx(np.sqrt(np.mean(off**2))), np.abs(off).max(), "N")


def test_a_benchs_recording_is_compared_by_its_sensors(scaled: Instrument, tmp_path: Path) -> None:
    run = bench_run(record(scaled, SHORT, tmp_path / "twin.mcap"))
    with Recorder(tmp_path / "bench.mcap", axes=run.axes, start_time=10**18) as recorder:
        recorder.write(run)
    recording = Recording.open(tmp_path / "bench.mcap")
    with refused("instrument", kind=RecordingError, allowed="in the recording"):
        replay(recording)
    again = replay(recording, scaled.replace(**{"dynamics.hand_stiffness": 50.0}))
    assert not again.exact
    differences = again.differences()
    assert list(differences) == [
        "measured_output_angle.yaw",
        "measured_tension.yaw.agonist",
        "measured_tension.yaw.antagonist",
    ]
    assert 0 < differences["measured_output_angle.yaw"].rms < np.radians(5)


@pytest.mark.parametrize(
    ("change", "metadata", "sentence"),
    [
        ({"time": np.array([0.0, 1e-3, 2.5e-3])}, {}, "no even time step, 0.001 s after row 0"),
        ({"commanded_handle_angle": None}, {}, "has no handle angle"),
        ({}, {"seed": "many"}, "metadata seed = 'many': it must be a number"),
        ({}, {"time_step": "nan"}, "time_step is nan"),
        ({"commanded_handle_angle": np.array([0.0, 2.0, 0.0])}, {}, "the handle's range"),
        (Names.paired(["pitch"])._asdict(), {}, "has the joints pitch, scaled-up yaw; the instr.*same"),
    ],
)
def test_what_cannot_be_replayed_is_refused(
    scaled: Instrument, tmp_path: Path, change: dict[str, Any], metadata: dict[str, str], sentence: str
) -> None:
    run = replace(
        Run(np.array([0.0, 5e-4, 1e-3]), ("yaw",), commanded_handle_angle=np.zeros(3), force=np.zeros(3)), **change
    )
    with Recorder(tmp_path / "run.mcap", axes=run.axes, metadata=metadata) as recorder:
        recorder.write(run)
    with pytest.raises((RecordingError, ValueError), match=sentence):
        replay(Recording.open(tmp_path / "run.mcap"), scaled)


def test_a_protocol_that_cannot_be_run_leaves_no_file(scaled: Instrument, tmp_path: Path) -> None:
    beyond = Protocol(name="far", phases=(Cycles(amplitude="70 deg", period=1.0, count=1),))
    with refused("amplitude", kind=ProtocolError, allowed="within the handle's range of ±45 deg"):
        record(scaled, beyond, tmp_path / "run.mcap")
    with refused("time_step", 1.0):
        record(scaled, SHORT, tmp_path / "run.mcap", time_step=1.0)
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_breaks_off_leaves_what_was_before(scaled: Instrument, tmp_path: Path) -> None:
    heavy = Protocol(name="heavy", phases=(Hold(duration=1.5), Ramp(duration=1.0, force=300.0)))
    with pytest.raises(NoSolutionError):
        record(scaled, heavy, tmp_path / "run.mcap", quasi_static=True)
    recording = Recording.open(tmp_path / "run.mcap")
    assert (recording.damage, len(recording.run)) == (None, 3000)
    assert replay(recording).exact


# Pretension on the twin


class Faulty(Twin):
    """A twin one of whose tendons is broken: its load cell reads nothing."""

    def run(self, *arguments: Any, **commands: Any) -> Run:
        run = super().run(*arguments, **commands)
        assert run.measured_tension is not None
        return replace(run, measured_tension=run.measured_tension * [1.0, 0.0])


def tightened(inst: Instrument, seed: int = 0) -> Run:
    twin = Twin(inst, seed=seed)
    twin.loosen(2e-3)
    return simulate.execute(twin, simulate.load("pretension"))


VARIANTS: list[dict[str, Any]] = [
    {},
    {"sensors.load_cell_noise": 0.3},
    {"drives.time_constant": 0.3},
    {"drives.backlash": 0.1, "mismatch.stiffness_ratio": 2.0},
    {"friction.vertex_coefficient": 0.6, "friction.sheath_coefficient": 0.4},
]


@pytest.mark.parametrize("changes", VARIANTS, ids=str)
def test_pretension_is_repeatable_to_two_percent(scaled: Instrument, changes: dict[str, Any]) -> None:
    ends = []
    for seed in range(3):
        run = tightened(scaled.replace(**changes), seed)
        assert run.tension is not None
        assert np.abs(run.tension[-1] - scaled.pretension).max() < 0.5
        assert run.commanded_spool_velocity is not None
        ends.append(run.tension[-1])
    assert np.ptp(ends, axis=0).max() < 0.02 * scaled.pretension


def test_a_broken_tendon_ends_the_run(scaled: Instrument) -> None:
    twin = Faulty(scaled)
    twin.loosen()
    protocol = Protocol(name="p", phases=(Pretension(travel="8 mm"),))
    with pytest.raises(ProtocolError) as problem:
        simulate.execute(twin, protocol)
    assert problem.value.key in ("tension", "tip_angle")


def test_load_cells_that_disagree_do_not_pull_the_tip_aside(pulley: Instrument) -> None:
    with refused("tip_angle", kind=ProtocolError, allowed="at most 10 deg from the start"):
        tightened(pulley.replace(**{"mismatch.load_cell_bias": (0.8, -0.8)}))


def test_a_load_cell_out_of_range_ends_the_run(scaled: Instrument) -> None:
    with refused("tension", 20.0, kind=ProtocolError):
        tightened(scaled.replace(**{"sensors.load_cell_range": 20.0}))


def test_a_jammed_motor_ends_the_run(scaled: Instrument) -> None:
    twin = Twin(scaled.replace(**{"drives.motor_speed": 1e-3}))
    protocol = Protocol(name="p", phases=(Pretension(tension="35 N", timeout="2 s"),))
    with refused("tension", kind=ProtocolError, allowed="35 ± 0.5 N"):
        simulate.execute(twin, protocol)


def test_an_instruments_text_of_another_version_is_refused_in_a_sentence(tmp_path: Path) -> None:
    run = Run(np.array([0.0, 5e-4]), ("yaw",), commanded_handle_angle=np.zeros(2))
    with Recorder(tmp_path / "run.mcap", axes=("yaw",), metadata={"instrument": 'name = "x"'}) as recorder:
        recorder.write(run)
    with refused("joint_type", kind=InstrumentError, allowed="one of tendon-gear, tendon-pulley, conti"):
        replay(Recording.open(tmp_path / "run.mcap"))


def test_who_takes_the_blocks_of_a_run_gets_all_of_it_and_the_last_is_returned(tmp_path: Path) -> None:
    protocol = Protocol(name="short", phases=(Hold(duration=0.1), Hold(duration=0.05)))
    whole = record("scaled-up", protocol, tmp_path / "whole.mcap")
    blocks: list[Run] = []
    last = record("scaled-up", protocol, tmp_path / "blocks.mcap", each=blocks.append)
    assert last["tension"].tobytes() == blocks[-1]["tension"].tobytes()
    assert len(blocks) > 1
    np.testing.assert_array_equal(np.concatenate([one["tension"] for one in blocks]), whole["tension"])
    assert (tmp_path / "blocks.mcap").read_bytes() == (tmp_path / "whole.mcap").read_bytes()


def test_of_a_thinned_recording_one_row_of_so_many_is_written_and_it_is_not_replayed(tmp_path: Path) -> None:
    protocol = Protocol(name="short", phases=(Hold(duration=0.1),))
    whole = record("scaled-up", protocol, tmp_path / "whole.mcap")
    thin = record("scaled-up", protocol, tmp_path / "thin.mcap", every=7)
    assert len(thin) == len(whole)
    again = Recording.open(tmp_path / "thin.mcap")
    np.testing.assert_array_equal(again.run["tension"], whole.rows(step=7)["tension"])
    with pytest.raises(RecordingError, match="one of 7 rows"):
        replay(again)

"""Claims about protocols: what is asked of the handle and the loads, and that every bad one ends in a sentence."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

import tenodesis as tn
from tenodesis import simulate
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.simulate import Cycles, Hold, Motion, Pretension, Protocol, ProtocolError, Ramp, StepLoad
from tenodesis.simulate.motion import csv_text

DT = 1e-3
DEG = math.radians(1)


@dataclass
class Springs:
    """A twin that is no more than tendons of the instrument's stiffness, with load cells."""

    inst: Instrument
    time_step: float = DT
    spool_radius: float = 0.01
    hooked: Array = field(default_factory=lambda: np.ones(2))
    measures: bool = True
    time: float = 0.0

    def __post_init__(self) -> None:
        self.wound = np.zeros((len(self.inst.axes), 2))

    def run(self, *, handle_angle: Array, force: Array, radial_force: Array, spool_velocity: Array) -> Run:
        time: Array = self.time + self.time_step * np.arange(1.0, len(force) + 1)
        velocity = spool_velocity.reshape(len(force), -1, 2)
        wound = self.wound + self.time_step * self.spool_radius * np.cumsum(velocity, axis=0)
        self.wound, self.time = wound[-1], float(time[-1])
        tension = np.maximum(0, self.hooked * self.inst.tendon_stiffness * wound).reshape(spool_velocity.shape)
        return Run(
            time,
            self.inst.axes,
            commanded_handle_angle=handle_angle,
            force=force,
            radial_force=radial_force,
            commanded_spool_velocity=spool_velocity,
            measured_tension=tension if self.measures else None,
        )


def one(phase: Any, *more: Any) -> Protocol:
    return Protocol(name="test", phases=[phase, *more])


def commands(inst: Instrument, *phases: Any, time_step: float = DT) -> dict[str, Array]:
    return Protocol(name="test", phases=phases).commands(inst, time_step)


def same(first: dict[str, Array], second: dict[str, Array]) -> None:
    assert list(first) == list(second) == ["handle_angle", "force", "radial_force", "spool_velocity"]
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name])


@pytest.fixture
def motion_file(tmp_path: Path) -> Path:
    file = tmp_path / "motion.csv"
    file.write_text("# made up\ntime,other,angle\n\n1.0,x,0\n1.25,x,5\n1.5,x,12\n2.0,x,12\n2.125,x,-3\n")
    return file


# What is asked


@pytest.mark.parametrize("name", simulate.shipped())
def test_every_shipped_protocol_runs_on_every_mechanism(any_inst: Instrument, name: str) -> None:
    protocol = simulate.load(name)
    assert protocol.name == name
    assert protocol.description
    run = simulate.execute(Springs(any_inst), protocol)
    assert len(run) * DT <= protocol.duration(any_inst) + 1e-9
    assert run.commanded_handle_angle is not None
    assert np.abs(run.commanded_handle_angle).max() <= any_inst.handle_range


def test_the_shipped_protocols_are_the_ones_promised() -> None:
    assert simulate.shipped() == ("cycles", "pretension", "step-load", "wrist")


def test_the_shipped_wrist_is_said_to_be_synthetic() -> None:
    wrist = simulate.load("wrist")
    assert "synthetic" in wrist.description
    phase = wrist.phases[0]
    assert isinstance(phase, Motion)
    assert phase.file.read_text().startswith("# Synthetic")
    assert len(phase.samples.times) < 1000


def test_a_protocol_from_toml_and_from_python_asks_for_the_same(scaled: Instrument, motion_file: Path) -> None:
    text = """
        name = "all"
        [[phases]]
        kind = "hold"
        duration = "0.1 s"
        [[phases]]
        kind = "cycles"
        from = "-5 deg"
        amplitude = "20 deg"
        speed = "40 deg/s"
        count = 2
        shape = "sine"
        force = "1 N"
        force_end = "2 N"
        approach = "100 deg/s"
        [[phases]]
        kind = "step-load"
        output_angle = "30 deg"
        delay = "50 ms"
        force = "1.5 N"
        rise = "20 ms"
        duration = "0.2 s"
        release = "0.1 s"
        [[phases]]
        kind = "ramp"
        duration = "0.3 s"
        handle_angle = "0.1 rad"
        radial_force = "-1 N"
        spool_velocity = ["1 rad/s", "-60 deg/s"]
        [[phases]]
        kind = "motion"
        file = "motion.csv"
        angle_unit = "deg"
        scale = -1.0
        offset = "2 deg"
    """
    python = Protocol(
        name="all",
        phases=[
            Hold(duration=0.1),
            Cycles(
                start="-5 deg",
                amplitude=math.radians(20),
                speed="40 deg/s",
                count=2,
                shape="sine",
                force=1,
                force_end=2,
                approach="100 deg/s",
            ),
            StepLoad(output_angle="30 deg", delay=0.05, force=1.5, rise=0.02, duration=0.2, release=0.1),
            Ramp(duration=0.3, handle_angle=0.1, radial_force=-1, spool_velocity=(1, "-60 deg/s")),
            Motion(file=motion_file, angle_unit="deg", scale=-1.0, offset="2 deg"),
        ],
    )
    same(
        simulate.parse(text, folder=motion_file.parent).commands(scaled, DT),
        python.commands(scaled, DT),
    )


def test_a_recording_is_found_beside_the_protocol_file(scaled: Instrument, motion_file: Path) -> None:
    file = motion_file.parent / "p.toml"
    file.write_text('name = "p"\n[[phases]]\nkind = "motion"\nfile = "motion.csv"\nangle_unit = "deg"\n')
    assert simulate.load(file).duration(scaled) == pytest.approx(1.125)


@pytest.mark.parametrize("seconds", [0.0005, 0.0137, 1.0, 100.0])
def test_blocks_joined_are_the_commands(scaled: Instrument, seconds: float) -> None:
    protocol = simulate.load("step-load")
    blocks = list(protocol.blocks(scaled, DT, seconds))
    assert max(block["force"].size for block in blocks) * DT <= max(seconds, DT) + 1e-12
    whole = {name: np.concatenate([block[name] for block in blocks]) for name in blocks[0]}
    same(whole, protocol.commands(scaled, DT))


def test_the_duration_is_that_of_the_commands(any_inst: Instrument) -> None:
    for name in ("cycles", "step-load", "wrist"):
        protocol = simulate.load(name)
        for step in (1e-3, 7e-4):
            length = protocol.commands(any_inst, step)["force"].shape[0] * step
            assert protocol.duration(any_inst, step) == pytest.approx(length, rel=1e-12)


@pytest.mark.parametrize("shape", ["triangle", "sine", "smooth"])
@pytest.mark.parametrize("step", [1e-3, 7.3e-4])
def test_cycles_reach_either_end_exactly_and_count_times(scaled: Instrument, shape: str, step: float) -> None:
    cycles = Cycles(amplitude=0.4, start=-0.1, speed=1.0, count=3, shape=shape)
    angle = commands(scaled, cycles, time_step=step)["handle_angle"]
    assert np.count_nonzero(angle == 0.4) == 3
    assert angle.max() == 0.4
    assert angle.min() == -0.1
    assert angle[-1] == -0.1
    assert np.count_nonzero(angle == -0.1) == 4


def test_symmetric_cycles_go_from_one_side_to_the_other(scaled: Instrument) -> None:
    angle = commands(scaled, Cycles(amplitude=0.3, symmetric=True, speed=1, count=2))["handle_angle"]
    assert (angle.min(), angle.max()) == (-0.3, 0.3)
    assert np.count_nonzero(angle == 0.3) == 2


def test_an_output_amplitude_is_reached_without_load(any_inst: Instrument) -> None:
    angle = commands(any_inst, Cycles(output_amplitude="50 deg", period=1, count=1))["handle_angle"]
    assert tn.statics.output_angle(any_inst, angle.max()) == pytest.approx(math.radians(50))


def test_a_period_and_the_mean_speed_that_it_makes_are_the_same(scaled: Instrument) -> None:
    same(
        commands(scaled, Cycles(amplitude=0.4, period=0.8, count=2, shape="sine")),
        commands(scaled, Cycles(amplitude=0.4, speed=1.0, count=2, shape="sine")),
    )


@pytest.mark.parametrize(("shape", "peak"), [("triangle", 1), ("sine", math.pi / 2), ("smooth", 1.875)])
def test_the_handle_never_moves_further_in_a_step_than_its_speed_allows(
    scaled: Instrument, shape: str, peak: float
) -> None:
    speed = 0.7
    phases = (
        Cycles(amplitude=0.4, start=0.1, speed=speed, count=2, shape=shape, approach=speed * peak),
        StepLoad(handle_angle=-0.3, force=1, duration=0.1, approach=speed * peak),
        Hold(duration=0.1),
        Cycles(amplitude=-0.2, symmetric=True, speed=speed, count=1, shape=shape, approach=speed * peak),
    )
    angle = commands(scaled, *phases)["handle_angle"]
    jumps = np.abs(np.diff(angle, prepend=0.0))
    assert jumps.max() <= speed * peak * DT * (1 + 1e-9)
    assert jumps.max() > 0.98 * speed * peak * DT


def test_a_phase_that_begins_elsewhere_is_approached_smoothly_under_the_load_there_was(scaled: Instrument) -> None:
    step = StepLoad(force=2, duration=0.1)
    cycles = Cycles(start=0.3, amplitude=0.4, speed=1, count=1, force=1, approach=0.5)
    run = commands(scaled, step, cycles)
    approach = slice(100, 100 + math.ceil(1.875 * 0.3 / 0.5 / DT))
    assert (run["force"][approach] == 2).all()
    assert run["handle_angle"][approach][-1] == 0.3
    assert run["force"][approach.stop] == 1
    speed = np.diff(run["handle_angle"][approach], prepend=0) / DT
    assert speed.max() == pytest.approx(0.5, rel=1e-3)
    assert abs(np.diff(speed, prepend=0)).max() < 0.01


def test_a_sudden_load_is_there_within_one_step_and_taken_off_again(scaled: Instrument) -> None:
    force = commands(scaled, StepLoad(delay=0.01, force=2, duration=0.02, release=0.03))["force"]
    np.testing.assert_array_equal(force, [0] * 10 + [2] * 20 + [0] * 30)


def test_a_load_with_a_rise_comes_and_goes_linearly(scaled: Instrument) -> None:
    force = commands(scaled, StepLoad(force=2, rise=0.004, duration=0.002, release=0.001))["force"]
    np.testing.assert_allclose(force, [0.5, 1, 1.5, 2, 2, 2, 1.5, 1, 0.5, 0, 0])


def test_a_load_without_release_stays_until_it_is_changed(scaled: Instrument) -> None:
    run = commands(scaled, StepLoad(force=2, duration=0.1), Hold(duration=0.1), Ramp(force=0, duration=0.1))
    assert (run["force"][:200] == 2).all()
    assert run["force"][-1] == 0


def test_weight_and_moment_act_by_way_of_the_load_rig() -> None:
    rig: Any = SimpleNamespace(name="x", rig_arm=0.15, conditions=SimpleNamespace(cable_pulley_radius=0.015))
    assert StepLoad(weight="10 N", duration=1).tip_force(rig) == pytest.approx(1)
    assert StepLoad(moment="0.15 N*m", duration=1).tip_force(rig) == pytest.approx(1)
    assert StepLoad(force="-2 N", duration=1).tip_force(rig) == -2


def test_a_force_may_change_linearly_while_the_handle_moves(scaled: Instrument, motion_file: Path) -> None:
    for phase in (
        Cycles(amplitude=0.4, speed=1, count=2, force=1, force_end=3, radial_force=0.5),
        Motion(file=motion_file, angle_unit="deg", force=1, force_end=3, radial_force=0.5),
    ):
        run = commands(scaled, phase)
        np.testing.assert_allclose(run["force"], np.linspace(1, 3, run["force"].size + 1)[1:])
        assert (run["radial_force"] == 0.5).all()


def test_a_ramp_goes_linearly_from_where_things_are_and_they_stay_there(scaled: Instrument) -> None:
    run = commands(
        scaled,
        Ramp(duration=0.2, handle_angle=0.2, spool_velocity=(1, -1)),
        Ramp(duration=0.1, handle_angle=-0.1, force=3),
        Hold(duration=0.1),
    )
    np.testing.assert_allclose(run["handle_angle"][:200], DT * np.arange(1, 201))
    np.testing.assert_allclose(run["handle_angle"][200:300], 0.2 - 3 * DT * np.arange(1, 101), atol=1e-15)
    assert run["handle_angle"][-1] == -0.1
    assert run["force"][-1] == 3
    np.testing.assert_array_equal(run["spool_velocity"][199:], np.tile([1.0, -1.0], (201, 1)))


def test_a_motion_passes_through_the_samples_and_does_not_overshoot(scaled: Instrument, motion_file: Path) -> None:
    angle = commands(scaled, Motion(file=motion_file, angle_unit="deg", scale=0.5, offset="1 deg"))["handle_angle"]
    approach = math.ceil(1.875 * 1 / 20 / DT)
    motion = angle[approach - 1 :] / DEG
    np.testing.assert_allclose(motion[[0, 250, 500, 1000, 1125]], [1, 3.5, 7, 7, -0.5], rtol=1e-12)
    assert (np.diff(motion[:500]) > 0).all()
    np.testing.assert_allclose(motion[500:1001], 7, rtol=1e-12)
    assert motion.max() <= 7 + 1e-12


def test_a_motion_stays_within_the_ranges_where_it_is_to_be_limited(scaled: Instrument, motion_file: Path) -> None:
    motion = Motion(file=motion_file, angle_unit="deg", scale=10.0, limit=True)
    angle = commands(scaled, motion)["handle_angle"]
    assert tn.statics.output_angle(scaled, angle.max()) == pytest.approx(scaled.output_range)


def test_a_motion_starts_and_ends_at_rest_and_is_monotone_between_samples(scaled: Instrument) -> None:
    rng = np.random.default_rng(3)
    times, values = np.cumsum(rng.uniform(0.1, 1, 30)), rng.normal(scale=0.1, size=30)
    motion = Motion(data=csv_text(times, values, "time", "angle"), angle_unit="rad", approach="100 deg/s")
    angle = commands(scaled, motion, time_step=1e-4)["handle_angle"]
    angle = angle[-math.ceil((times[-1] - times[0]) / 1e-4) :]
    speed = np.diff(angle) / 1e-4
    assert np.abs(speed[[0, -1]]).max() < 0.02 * np.abs(speed).max()
    assert np.abs(np.diff(speed)).max() < 0.01 * np.abs(speed).max()
    at = np.searchsorted(1e-4 * np.arange(1, angle.size + 1), times - times[0])[1:-1]
    np.testing.assert_allclose(angle[at], values[1:-1], atol=1e-4)
    for first, last in pairwise(at):
        assert (np.sign(np.diff(angle[first + 1 : last])) == np.sign(angle[last] - angle[first])).all()


def test_two_samples_make_a_smooth_stroke(scaled: Instrument) -> None:
    motion = Motion(data="time,angle\n0,0\n2,0.2\n", angle_unit="rad")
    at = DT * np.arange(1, 2001)
    np.testing.assert_allclose(commands(scaled, motion)["handle_angle"], 0.2 * at**2 * (3 - at) / 4, atol=1e-15)


def test_on_two_axes_the_other_one_keeps_its_last_command(real: Instrument) -> None:
    run = commands(
        real,
        Cycles(axis="pitch", start=0.1, amplitude=0.3, speed=1, count=1, force=1),
        Ramp(handle_angle=-0.2, spool_velocity=(1, 2), duration=0.1),
    )
    steps = run["force"].shape[0]
    assert run["handle_angle"].shape == run["force"].shape == run["radial_force"].shape == (steps, 2)
    assert run["spool_velocity"].shape == (steps, 2, 2)
    assert (run["handle_angle"][:-100, 0] == 0).all()
    assert run["handle_angle"][:, 1].max() == 0.3
    np.testing.assert_array_equal(run["handle_angle"][-1], [-0.2, 0.1])
    np.testing.assert_array_equal(run["force"][-1], [0, 1])
    np.testing.assert_array_equal(run["spool_velocity"][-1], [[1, 2], [0, 0]])


# Running


def test_executing_gives_one_run_of_all_commands_and_tells_block_by_block(scaled: Instrument) -> None:
    protocol = simulate.load("cycles")
    seen: list[Run] = []
    told: list[tuple[float, float]] = []
    run = simulate.execute(Springs(scaled), protocol, on_block=seen.append, progress=lambda *times: told.append(times))
    expected = protocol.commands(scaled, DT)
    np.testing.assert_array_equal(run.commanded_handle_angle, expected["handle_angle"])
    np.testing.assert_array_equal(run.commanded_spool_velocity, expected["spool_velocity"])
    np.testing.assert_allclose(np.diff(run.time), DT)
    assert sum(len(block) for block in seen) == len(run)
    assert max(len(block) for block in seen) == 1000
    assert told == sorted(told)
    assert told[-1] == pytest.approx((protocol.duration(scaled),) * 2)


def test_pretension_winds_every_tendon_to_what_the_instrument_asks(any_inst: Instrument) -> None:
    twin = Springs(any_inst)
    run = simulate.execute(twin, one(Pretension(), Hold(duration=0.1)))
    assert run.measured_tension is not None
    assert run.commanded_spool_velocity is not None
    assert run.measured_tension.shape[1:] == ((2, 2) if len(any_inst.axes) > 1 else (2,))
    np.testing.assert_allclose(run.measured_tension[-290:], any_inst.pretension, atol=0.5)
    assert np.abs(run.commanded_spool_velocity).max() <= 1e-3 / twin.spool_radius * (1 + 1e-12)
    assert (run.commanded_spool_velocity[-100:] == 0).all()


def test_pretension_lets_out_what_is_too_tight(scaled: Instrument) -> None:
    twin = Springs(scaled)
    twin.wound[:] = 40 / scaled.tendon_stiffness
    run = simulate.execute(twin, one(Pretension(tension="10 N", tolerance="0.1 N", rate="5 mm/s")))
    assert run.measured_tension is not None
    np.testing.assert_allclose(run.measured_tension[-1], 10, atol=0.1)


def test_pretension_on_one_axis_leaves_the_other_alone(real: Instrument) -> None:
    run = simulate.execute(Springs(real), one(Pretension(axis="pitch")))
    assert run.measured_tension is not None
    np.testing.assert_allclose(run.measured_tension[-1], [[0, 0], [30, 30]], atol=0.5)


def test_pretension_holds_handle_and_load_where_they_were(scaled: Instrument) -> None:
    run = simulate.execute(Springs(scaled), one(Ramp(handle_angle=0.2, force=1, duration=0.1), Pretension()))
    assert run.commanded_handle_angle is not None
    assert run.force is not None
    assert (run.commanded_handle_angle[99:] == 0.2).all()
    assert (run.force[99:] == 1).all()


def test_a_tendon_that_does_not_get_tight_ends_the_run(scaled: Instrument) -> None:
    twin = Springs(scaled, hooked=np.array([1.0, 0.0]))
    with pytest.raises(ProtocolError) as told:
        simulate.execute(twin, one(Hold(duration=0.1), Pretension(timeout="1 s", rate="20 mm/s")))
    assert str(told.value) == (
        "test: phase 2 (pretension): the antagonist of yaw reads 0 N after the timeout of 1 s; allowed is "
        "25 ± 0.5 N for 0.2 s: hook it in, or give a larger timeout, rate or tolerance."
    )
    assert twin.time == pytest.approx(1.1, abs=0.011)


def test_pretension_without_load_cells_ends_the_run(scaled: Instrument) -> None:
    with pytest.raises(ProtocolError, match=r"phase 1 \(pretension\): the load cells read no tension"):
        simulate.execute(Springs(scaled, measures=False), one(Pretension()))


def test_nothing_runs_before_the_whole_protocol_was_checked(scaled: Instrument) -> None:
    twin = Springs(scaled)
    with pytest.raises(ProtocolError, match="phase 2"):
        simulate.execute(twin, one(Hold(duration=1), Ramp(handle_angle=3, duration=1)))
    assert twin.time == 0


def test_runs_that_differ_are_not_joined(scaled: Instrument) -> None:
    zeros = np.zeros(3)
    run = Run(zeros, ("yaw",), force=zeros)
    assert len(simulate.concatenate([run, run])) == 6
    for bad in ([], [run, Run(zeros, ("yaw",))], [run, Run(zeros, ("pitch",), force=zeros)]):
        with pytest.raises(ValueError, match="allowed are"):
            simulate.concatenate(bad)


# Bad input

CYCLES = '[[phases]]\nkind = "cycles"\namplitude = "20 deg"\nspeed = "20 deg/s"\ncount = 2\n'
STEP = '[[phases]]\nkind = "step-load"\nforce = "1 N"\nduration = "1 s"\n'
HOLD = '[[phases]]\nkind = "hold"\nduration = "1 s"\n'

BAD = [
    ("", "phases is missing; it is required."),
    ("phases = []", "phases = []: allowed are one or more phases."),
    ("phases = 3", "phases = 3: it must be a list; phases are one, of tables [[phases]]."),
    ("phases = [3]", "phase 1 is 3; allowed is a table, [[phases]]."),
    ("speed = 1\n" + HOLD, "speed is not a known key; allowed are name, description, phases."),
    ("[[phases", "is not valid TOML: "),
    (
        "[[phases]]\nduration = '1 s'",
        "phase 1: kind is missing; allowed are pretension, hold, cycles, step-load, ramp, m",
    ),
    (HOLD + HOLD.replace("hold", "rest"), "phase 2: kind is 'rest'; allowed are pretension, hold, "),
    (HOLD + "time = '1 s'", "phase 1 (hold): time is not a known key; allowed are axis, kind, duration."),
    (CYCLES + "start_angle = '1 deg'", "phase 1 (cycles): start_angle is not a known key; allowed are axis, approach,"),
    (HOLD.replace('"1 s"', '"-1 s"'), "phase 1 (hold): duration = '-1 s': it must be a duration above 0 s and below "),
    (HOLD.replace('"1 s"', "1"), "phase 1 (hold): duration = 1: it has no unit; write a duration above 0 s"),
    (HOLD.replace('"1 s"', '"1 N"'), "phase 1 (hold): duration = '1 N': it is measured in N; it must be a duration"),
    (HOLD.replace('"1 s"', '"nan s"'), "phase 1 (hold): duration = 'nan s': it must be a duration"),
    (HOLD.replace('duration = "1 s"', ""), "phase 1 (hold): duration is missing; it is required."),
    (HOLD + "axis = 'roll'", "phase 1 (hold): axis = 'roll': it must be 'yaw' or 'pitch'."),
    (CYCLES.replace("count = 2", "count = 0"), "count = 0: it must be greater than or equal to 1"),
    (CYCLES.replace("count = 2", "count = -3"), "count = -3: it must be greater than or equal to 1"),
    (CYCLES.replace("count = 2", "count = 2.5"), "count = 2.5: it must be a valid integer"),
    (CYCLES.replace("20 deg/s", "20 Hz"), "speed = '20 Hz': it is not measured by angle; write it like"),
    (CYCLES.replace("20 deg/s", "20 mm/s"), "speed = '20 mm/s': it is not measured by angle"),
    (CYCLES.replace("20 deg/s", "0 deg/s"), "speed = '0 deg/s': it must be a speed above 1e-06 rad/s"),
    (CYCLES.replace('speed = "20 deg/s"', ""), "phase 1 (cycles): none of speed and period is given; allowed is"),
    (CYCLES + "period = '1 s'", "phase 1 (cycles): speed and period are given; allowed is one of them."),
    (CYCLES.replace('amplitude = "20 deg"', ""), "none of amplitude and output_amplitude is given; allowed is exactly"),
    (CYCLES + "output_amplitude = '1 deg'", "amplitude and output_amplitude are given; allowed is one of them."),
    (CYCLES + "from = '1 deg'\nsymmetric = true", "from and symmetric are both given; allowed is one of them."),
    (CYCLES + "shape = 'square'", "shape = 'square': it must be 'triangle', 'sine' or 'smooth'."),
    (CYCLES + "symmetric = 1", "symmetric = 1: it must be a valid boolean"),
    (STEP + "weight = '1 N'", "phase 1 (step-load): force and weight are given; allowed is one of them."),
    (STEP.replace('force = "1 N"', ""), "none of force, weight and moment is given; allowed is exactly one of them."),
    (
        STEP + "handle_angle = '1 deg'\noutput_angle = '1 deg'",
        "handle_angle and output_angle are given; allowed is one",
    ),
    (STEP + "delay = '-1 s'", "delay = '-1 s': it must be a duration of at least 0 s"),
    (STEP + "release = '-1 s'", "release = '-1 s': it must be a duration above 0 s"),
    ('[[phases]]\nkind = "motion"\nfile = 3\nangle_unit = "deg"', "file = 3: it must be the path of a CSV file."),
    ('[[phases]]\nkind = "ramp"\nduration = "1 s"', "phase 1 (ramp): nothing is ramped; give handle_angle, force,"),
    (
        '[[phases]]\nkind = "ramp"\nduration = "1 s"\nspool_velocity = ["1 rad/s", "1 m/s"]',
        "phase 1 (ramp): spool_velocity.1 = '1 m/s': it is not measured by angle",
    ),
    ('[[phases]]\nkind = "pretension"\ntension = "-1 N"', "tension = '-1 N': it must be a force above 0 N"),
    ('[[phases]]\nkind = "pretension"\nrate = "1 deg/s"', "rate = '1 deg/s': it is measured in deg/s; it must be a sp"),
]


@pytest.mark.parametrize(("text", "told"), BAD)
def test_a_bad_file_ends_in_a_sentence_that_helps(text: str, told: str) -> None:
    with pytest.raises(ProtocolError) as problem:
        simulate.parse(f'name = "p"\n{text}', "my.toml")
    assert str(problem.value).startswith("my.toml")
    assert told in str(problem.value)
    assert str(problem.value).endswith(".")
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize("name", ['""', '"a\\nb"', f'"{"x" * 61}"', "3"])
def test_a_name_that_cannot_be_shown_is_refused(name: str) -> None:
    with pytest.raises(ProtocolError, match="name = "):
        simulate.parse(f"name = {name}\n{HOLD}")


MOTION = [
    ("", "has no column 'time'; it has none"),
    ("t,angle\n0,1\n1,2\n", "has no column 'time'; it has t, angle"),
    ("time,a,b\n0,1\n1,2\n", "has no column 'angle'; it has time, a, b"),
    ("time,angle\n", "has 0 rows of numbers; allowed are two or more"),
    ("time,angle\n0,1\n", "has 1 rows of numbers; allowed are two or more"),
    ("# x\ntime,angle\n0,1\n1,nan\n", "line 4: angle is 'nan'; allowed is a finite number"),
    ("time,angle\n0,1\n1,\n", "line 3: angle is ''; allowed is a finite number"),
    ("time,angle\n0,1\n1\n", "line 3: angle is ''; allowed is a finite number"),
    ("time,angle\n0,1\ninf,2\n", "line 3: time is 'inf'; allowed is a finite number"),
    ("time,angle\n0,1\n1,2\n1,3\n", "line 4: time is 1 after 1; allowed are times that increase strictly"),
    ("time,angle\n0,1\n1,2\n0.5,3\n", "line 4: time is 0.5 after 1; allowed are times"),
]


@pytest.mark.parametrize(("rows", "told"), MOTION)
def test_a_bad_recording_is_refused_when_the_protocol_is_read(tmp_path: Path, rows: str, told: str) -> None:
    (tmp_path / "m.csv").write_text(rows)
    text = 'name = "p"\n[[phases]]\nkind = "motion"\nfile = "m.csv"\nangle_unit = "deg"\n'
    with pytest.raises(ProtocolError) as problem:
        simulate.parse(text, folder=tmp_path)
    assert "phase 1 (motion): " in str(problem.value)
    assert told in str(problem.value)


def test_a_recording_that_is_not_there_or_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    for name, told in (("a.csv", "there is no such file"), ("b.csv", "is not UTF-8"), (".", "there is no such file")):
        with pytest.raises(ValidationError, match=told):
            Motion(file=tmp_path / name, angle_unit="deg")


def test_the_unit_of_recorded_angles_must_be_told(motion_file: Path) -> None:
    for unit, told in (
        ("", "angle_unit is missing"),
        ('angle_unit = "gon"', "angle_unit = 'gon': it must be 'deg' or"),
    ):
        with pytest.raises(ProtocolError, match=told):
            simulate.parse(
                f'name = "p"\n[[phases]]\nkind = "motion"\nfile = "motion.csv"\n{unit}', folder=motion_file.parent
            )


BEYOND: list[tuple[Callable[[], Any], str]] = [
    (
        lambda: Cycles(amplitude="50 deg", speed=1, count=1),
        "test: phase 2 (cycles): amplitude is 50 deg; allowed is the handle's range of ±45 deg.",
    ),
    (lambda: Cycles(amplitude=0.1, start=-0.8, speed=1, count=1), "phase 2 (cycles): from is -45.8366 deg; allowed is"),
    (
        lambda: Cycles(amplitude="44 deg", speed=1, count=1),
        "phase 2 (cycles): amplitude is 44 deg, which bends the unloaded tip to 114.888 deg; "
        "the joint stops at ±106.667 deg.",
    ),
    (
        lambda: Cycles(output_amplitude="90 deg", speed=1, count=1),
        "phase 2 (cycles): output_amplitude is 90 deg; allowed is the output range of ±80 deg.",
    ),
    (lambda: Cycles(amplitude=0, speed=1, count=1), "phase 2 (cycles): the cycles begin where they go to; allowed is"),
    (
        lambda: StepLoad(handle_angle=1, force=1, duration=1),
        "phase 2 (step-load): handle_angle is 57.2958 deg; allowed",
    ),
    (lambda: StepLoad(output_angle=1.5, force=1, duration=1), "phase 2 (step-load): output_angle is 85.9437 deg; allo"),
    (
        lambda: Ramp(handle_angle=-1, duration=1),
        "phase 2 (ramp): handle_angle is -57.2958 deg; allowed is the handle's",
    ),
    (lambda: Hold(axis="pitch", duration=1), "phase 2 (hold): axis is pitch; allowed is yaw, which scaled-up has."),
    (lambda: Pretension(axis="pitch"), "phase 2 (pretension): axis is pitch; allowed is yaw"),
    (lambda: Hold(duration="2 h"), "phase 2 (hold): the run lasts 2 h by its end; allowed is 1 h in all, since every"),
    (lambda: Cycles(amplitude=0.1, period=1e5, count=1_000_000), "phase 2 (cycles): the run lasts "),
]


@pytest.mark.parametrize(("phase", "told"), BEYOND)
def test_what_an_instrument_cannot_do_is_refused(scaled: Instrument, phase: Callable[[], Any], told: str) -> None:
    protocol = one(Hold(duration=0.1), phase())
    for ask in (protocol.duration, lambda inst: next(iter(protocol.blocks(inst, DT)))):
        with pytest.raises(ProtocolError) as problem:
            ask(scaled)
        assert told in str(problem.value)


def test_a_recorded_angle_beyond_the_range_is_named_by_line_and_time(scaled: Instrument, motion_file: Path) -> None:
    for scale, told in (
        (4.0, "48 deg; allowed is the handle's range"),
        (3.6, "43.2 deg, which bends the unloaded tip"),
    ):
        with pytest.raises(ProtocolError) as problem:
            one(Motion(file=motion_file, angle_unit="deg", scale=scale)).duration(scaled)
        assert f"test: phase 1 (motion): {motion_file}: line 6 (1.5 s): the handle angle is {told}" in str(
            problem.value
        )


def test_a_weight_needs_the_pulley_of_the_rig(real: Instrument) -> None:
    with pytest.raises(ProtocolError, match=r"weight is given, but real-size has no conditions\.cable_pulley_radius"):
        one(StepLoad(weight=1, duration=1)).duration(real)


def test_commands_of_a_closed_loop_phase_are_refused(scaled: Instrument) -> None:
    with pytest.raises(ProtocolError, match="the commands of a pretension phase follow from what load cells read"):
        one(Pretension()).commands(scaled, DT)
    assert list(one(Pretension()).blocks(scaled, DT)) == []


@pytest.mark.parametrize("bad", [0.0, -1e-3, 1e-320, math.nan, math.inf])
def test_a_time_step_or_block_that_is_no_time_is_refused(scaled: Instrument, bad: float) -> None:
    protocol = one(Hold(duration=1))
    with pytest.raises(ProtocolError, match="time_step is"):
        protocol.duration(scaled, bad)
    with pytest.raises(ProtocolError, match="seconds is"):
        list(protocol.blocks(scaled, DT, bad))


def test_a_protocol_that_is_not_there_is_refused_with_what_there_is(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    for bad, told in (
        (
            "nothing",
            "nothing: there is no such file and no protocol of that name; .* cycles, pretension, step-load, wr",
        ),
        (tmp_path, "there is no such file"),
        (tmp_path / "b.toml", "is not UTF-8 text"),
        ("a\0b", "is no path"),
    ):
        with pytest.raises(ProtocolError, match=told):
            simulate.load(bad)


def test_every_problem_of_a_file_is_told_at_once() -> None:
    with pytest.raises(ProtocolError) as problem:
        simulate.parse(HOLD.replace('"1 s"', "1") + CYCLES.replace("count = 2", "count = 0"), "my.toml")
    assert [line.split(" = ")[0] for line in str(problem.value).splitlines()] == [
        "my.toml: name is missing; it is required.",
        "my.toml: phase 1 (hold): duration",
        "my.toml: phase 2 (cycles): count",
    ]


@pytest.mark.parametrize("name", simulate.shipped())
def test_the_same_file_gives_the_same_protocol(name: str) -> None:
    first, second = simulate.load(name), simulate.load(name)
    assert first == second
    assert hash(first) == hash(second)


def test_phases_do_not_change() -> None:
    hold = Hold(duration=1)
    with pytest.raises(ValidationError, match="frozen"):
        hold.duration = 2  # type: ignore[misc]

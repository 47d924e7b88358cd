"""Claims about protocols: what they command of the handle and the loads."""

import math
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import simulate
from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.simulate import Cycles, Hold, Motion, Protocol, Ramp, StepLoad, Wrench
from tenodesis.simulate.motion import csv_text

from .conftest import refused

DT = 1e-3
DEG = math.radians(1)


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
    same(simulate.parse(text, folder=motion_file.parent).commands(scaled, DT), python.commands(scaled, DT))


def test_a_recording_is_found_beside_the_protocol_file(scaled: Instrument, motion_file: Path) -> None:
    file = motion_file.parent / "p.toml"
    file.write_text('name = "p"\n[[phases]]\nkind = "motion"\nfile = "motion.csv"\nangle_unit = "deg"\n')
    assert simulate.load(file).duration(scaled) == pytest.approx(1.125)


def test_the_duration_is_that_of_the_commands(any_inst: Instrument) -> None:
    for name in ("cycles", "step-load", "wrist"):
        protocol = simulate.load(name)
        for step in (1e-3, 7e-4):
            length = protocol.commands(any_inst, step)["force"].shape[0] * step
            assert protocol.duration(any_inst, step) == pytest.approx(length, rel=1e-12)


def test_the_shipped_cycles_load_the_tip_as_the_instruments_conditions_have_it(scaled: Instrument) -> None:
    cycles = simulate.load("cycles")
    for forces, usual in (((0.5, 2.0, 4.0, 5.0), 2.0), ((0.3,), 0.3), ((), 1.0)):
        inst = scaled.replace(conditions={"forces": forces})
        assert cycles.commands(inst, 1e-2)["force"].max() == usual


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
    inst = SimpleNamespace(name="x", conditions=SimpleNamespace(cable_pulley_radius=0.015))
    rig: Any = SimpleNamespace(inst=inst, rig_arm=0.15)
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
    assert run["spool_velocity"].shape == (steps, 4)
    assert (run["handle_angle"][:-100, 0] == 0).all()
    assert run["handle_angle"][:, 1].max() == 0.3
    np.testing.assert_array_equal(run["handle_angle"][-1], [-0.2, 0.1])
    np.testing.assert_array_equal(run["force"][-1], [0, 1])
    np.testing.assert_array_equal(run["spool_velocity"][-1], [1, 2, 0, 0])


def test_a_motion_of_astronomic_duration_is_refused_as_too_long(scaled: Instrument) -> None:
    motion = simulate.Motion(
        data="time_s,angle_rad\n0,0\n1e17,0.1\n", time_column="time_s", angle_column="angle_rad", angle_unit="rad"
    )
    with pytest.raises(tn.ProtocolError, match=r"phase 1 \(motion\): the run lasts .* it must last at most 1 h"):
        simulate.Protocol(name="endless", phases=(motion,)).plan(scaled, 5e-4)


def test_joints_of_the_handle_and_tendons_may_be_named_in_place_of_axes(real: Instrument) -> None:
    by_axis = (
        Ramp(axis="pitch", handle_angle=0.1, spool_velocity=(0.2, -0.1), duration=0.1),
        Cycles(axis="pitch", amplitude=0.2, period=0.4, count=1),
    )
    by_name = (
        Ramp(
            handle_angles={"handle_pitch": 0.1},
            spool_velocities={"pitch_agonist": 0.2, "pitch_antagonist": -0.1},
            duration=0.1,
        ),
        Cycles(joint="handle_pitch", amplitude=0.2, period=0.4, count=1),
    )
    one, other = (Protocol(name="p", phases=phases).commands(real, DT) for phases in (by_axis, by_name))
    assert one.keys() == other.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name])


def test_a_wrench_is_the_forces_that_its_components_are(real: Instrument) -> None:
    by_axis = (
        Ramp(axis="yaw", force=-0.5, radial_force=0.2, duration=0.1),
        Ramp(axis="pitch", force=0.3, radial_force=0.2, duration=0.1),
    )
    by_component = (Ramp(wrench=Wrench(fx=0.5), duration=0.1), Ramp(wrench=Wrench(fy=-0.3, fz=0.2), duration=0.1))
    one, other = (Protocol(name="p", phases=phases).commands(real, DT) for phases in (by_axis, by_component))
    for name in ("force", "radial_force"):
        np.testing.assert_array_equal(one[name][-1], other[name][-1])


def test_a_force_on_a_joint_with_a_pair_of_its_own_is_a_component_of_the_wrench() -> None:
    wrist = tn.load("hybrid-scaled-up")
    phases = (Ramp(axis="pitch", force=0.3, radial_force=-0.1, duration=0.1), Ramp(force=0.2, duration=0.1))
    wrench = Protocol(name="p", phases=phases).commands(wrist, DT)["wrench"]
    np.testing.assert_array_equal(wrench[99], [0, -0.3, -0.1, 0, 0, 0])
    np.testing.assert_array_equal(wrench[-1], [-0.2, -0.3, -0.1, 0, 0, 0])


def test_an_output_angle_is_of_any_joint_with_a_pair_of_its_own() -> None:
    wrist = tn.load("hybrid-scaled-up")
    phase = Cycles(axis="pitch", output_amplitude="30 deg", period=1.0, count=1)
    angle = Protocol(name="p", phases=(phase,)).commands(wrist, DT)["handle_angle"][:, 1].max()
    assert np.degrees(tn.statics.output_angle(tn.control.compensated(wrist).axis("pitch"), angle)) == pytest.approx(30)
    bent = tn.statics.chain.output_angles(wrist, [0.0, angle, 0.0])
    assert np.degrees(bent[1]) == pytest.approx(30, abs=1e-6)


@pytest.mark.parametrize(
    ("kind", "given", "key"),
    [
        (StepLoad, {"wrench": Wrench(fx=1.0), "force": 1.0}, "force"),
        (StepLoad, {"wrench": Wrench(fx=1.0), "weight": 1.0}, "weight"),
        (Ramp, {"wrench": Wrench(fx=1.0), "radial_force": 1.0}, "radial_force"),
        (Ramp, {"handle_angle": 0.1, "handle_angles": {"handle_yaw": 0.1}}, "handle_angles"),
        (Ramp, {"spool_velocity": (1, 1), "spool_velocities": {"yaw_agonist": 1.0}}, "spool_velocities"),
    ],
)
def test_a_load_or_a_ramp_is_given_in_one_way_only(kind: Any, given: dict[str, Any], key: str) -> None:
    with refused(key, kind=ProtocolError):
        kind(duration=1.0, **given)


def test_a_motion_is_of_an_axis_or_of_a_joint() -> None:
    with refused("axis", kind=ProtocolError):
        Cycles(axis="yaw", joint="handle_yaw", amplitude=0.1, period=1.0, count=1)

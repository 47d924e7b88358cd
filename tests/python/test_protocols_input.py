"""Claims about protocols that cannot be read or run: each ends in a sentence that names phase, key and value."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tenodesis import simulate
from tenodesis.instrument import Instrument
from tenodesis.simulate import Cycles, Hold, Motion, Pretension, Protocol, ProtocolError, Ramp, StepLoad

from .conftest import refused

DT = 1e-3
DEG = math.radians(1)


def one(phase: Any, *more: Any) -> Protocol:
    return Protocol(name="test", phases=[phase, *more])


CYCLES = '[[phases]]\nkind = "cycles"\namplitude = "20 deg"\nspeed = "20 deg/s"\ncount = 2\n'
STEP = '[[phases]]\nkind = "step-load"\nforce = "1 N"\nduration = "1 s"\n'
HOLD = '[[phases]]\nkind = "hold"\nduration = "1 s"\n'

MOTION = '[[phases]]\nkind = "motion"\n'
BAD = [
    ("", "phases is missing"),
    ("phases = []", "phases = []: "),
    ("phases = [3]", "phase 1 = 3"),
    ("speed = 1\n" + HOLD, "speed is not a known key"),
    ("[[phases]]\nduration = '1 s'", "phase 1: kind is missing"),
    (HOLD + HOLD.replace("hold", "rest"), "phase 2: kind is 'rest'"),
    (HOLD + "time = '1 s'", "phase 1 (hold): time is not a known key"),
    (HOLD.replace('"1 s"', '"-1 s"'), "phase 1 (hold): duration = '-1 s': it must be a duration above 0 s and below "),
    (HOLD.replace('"1 s"', "1"), "phase 1 (hold): duration = 1: it has no unit; write a duration above 0 s"),
    (HOLD.replace('duration = "1 s"', ""), "phase 1 (hold): duration is missing"),
    (HOLD + "axis = 'roll'", "phase 1 (hold): axis = 'roll': it must be 'yaw' or 'pitch'."),
    (CYCLES.replace("count = 2", "count = 0"), "phase 1 (cycles): count = 0: "),
    (
        CYCLES.replace("20 deg/s", "20 Hz"),
        "phase 1 (cycles): speed = '20 Hz': it is not measured by angle; write it like",
    ),
    (
        CYCLES.replace("20 deg/s", "0 deg/s"),
        "phase 1 (cycles): speed = '0 deg/s': it must be a speed above 1e-06 rad/s",
    ),
    (CYCLES.replace('speed = "20 deg/s"', ""), "phase 1 (cycles): none of speed and period is given; give exactly one"),
    (CYCLES + "period = '1 s'", "phase 1 (cycles): speed and period are given; give only one of them."),
    (CYCLES.replace('amplitude = "20 deg"', ""), "phase 1 (cycles): none of amplitude and output_amplitude is given"),
    (CYCLES + "output_amplitude = '1 deg'", "phase 1 (cycles): amplitude and output_amplitude are given"),
    (CYCLES + "from = '1 deg'\nsymmetric = true", "phase 1 (cycles): from and symmetric are both given"),
    (CYCLES + "shape = 'square'", "phase 1 (cycles): shape = 'square': it must be 'triangle', 'sine' or 'smooth'."),
    (STEP + "weight = '1 N'", "phase 1 (step-load): force and weight are given"),
    (STEP.replace('force = "1 N"', ""), "phase 1 (step-load): none of force, weight and moment is given"),
    (STEP + "handle_angle = '1 deg'\noutput_angle = '1 deg'", "phase 1 (step-load): handle_angle and output_angle are"),
    (STEP + "delay = '-1 s'", "phase 1 (step-load): delay = '-1 s': it must be a duration of at least 0 s"),
    (MOTION + "angle_unit = 'deg'", "phase 1 (motion): none of file and data is given"),
    (MOTION + "angle_unit = 'deg'\nfile = 'a'\ndata = 'time'", "phase 1 (motion): file and data are given"),
    (MOTION + "file = 'a'", "phase 1 (motion): angle_unit is missing"),
    ('[[phases]]\nkind = "ramp"\nduration = "1 s"', "phase 1 (ramp): nothing is ramped; give handle_angle, force,"),
    (
        '[[phases]]\nkind = "ramp"\nduration = "1 s"\nspool_velocity = ["1 rad/s", "1 m/s"]',
        "phase 1 (ramp): spool_velocity (value 2) = '1 m/s': it is not measured by angle",
    ),
    ('[[phases]]\nkind = "pretension"\ntension = "-1 N"', "tension = '-1 N': it must be a force above 0 N"),
    ('[[phases]]\nkind = "pretension"\nrate = "1 deg/s"', "rate = '1 deg/s': it is measured in deg/s; it must be a sp"),
]


@pytest.mark.parametrize(("text", "start"), BAD)
def test_a_bad_file_ends_in_a_sentence_that_names_place_and_value(text: str, start: str) -> None:
    with pytest.raises(ProtocolError) as problem:
        simulate.parse(f'name = "p"\n{text}', "my.toml")
    assert str(problem.value).startswith("my.toml")
    assert start in str(problem.value)
    assert str(problem.value).endswith(".")
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize("name", ['""', '"a\\nb"', f'"{"x" * 61}"', "3"])
def test_a_name_that_cannot_be_shown_is_refused(name: str) -> None:
    with refused("name", kind=ProtocolError):
        simulate.parse(f"name = {name}\n{HOLD}")


SAMPLES = [
    ("", "data has no column 'time'; it has none"),
    ("t,angle\n0,1\n1,2\n", "data has no column 'time'; it has t, angle"),
    ("time,a,b\n0,1\n1,2\n", "data has no column 'angle'; it has time, a, b"),
    ("time,angle\n", "data has 0 rows of numbers"),
    ("# x\ntime,angle\n0,1\n1,nan\n", "data: line 4: angle is 'nan'; it must be a finite number"),
    ("time,angle\n0,1\n1,\n", "data: line 3: angle is ''"),
    ("time,angle\n0,1\n1,2\n1,3\n", "data: line 4: time is 1 after 1; times must increase strictly"),
]


@pytest.mark.parametrize(("rows", "start"), SAMPLES)
def test_bad_samples_are_refused_when_the_protocol_is_read(rows: str, start: str) -> None:
    text = f'name = "p"\n{MOTION}data = """\n{rows}"""\nangle_unit = "deg"\n'
    with pytest.raises(ProtocolError) as problem:
        simulate.parse(text)
    assert f"phase 1 (motion): {start}" in str(problem.value)


def test_a_file_of_samples_that_is_bad_or_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_bytes(b"\xff\xfe\x00")
    (tmp_path / "c.csv").write_text("time\n")
    for name, start in (
        ("a.csv", "there is no such file"),
        ("b.csv", "it is not UTF-8"),
        (".", "there is no such file"),
        ("c.csv", "c.csv has no column 'angle'"),
    ):
        with pytest.raises(ProtocolError, match=rf"^Motion: .*{start}"):
            Motion(file=tmp_path / name, angle_unit="deg")


BEYOND: list[tuple[Callable[[], Any], str, str]] = [
    (
        lambda: Cycles(amplitude="50 deg", speed=1, count=1),
        "amplitude",
        "cycles): amplitude is 50 deg; it must be within the handle's range of ±45 deg.",
    ),
    (lambda: Cycles(amplitude=0.1, start=-0.8, speed=1, count=1), "from", "cycles): from is -45.8366 deg"),
    (
        lambda: Cycles(amplitude="44 deg", speed=1, count=1),
        "amplitude",
        "cycles): amplitude is 44 deg, which bends the unloaded tip to 114.888 deg; that must be within the joint's "
        "stops at ±106.667 deg.",
    ),
    (
        lambda: Cycles(output_amplitude="90 deg", speed=1, count=1),
        "output_amplitude",
        "cycles): output_amplitude is 90 deg; it must be within the output range of ±80 deg.",
    ),
    (lambda: Cycles(amplitude=0, speed=1, count=1), "amplitude", "cycles): the cycles start at their far end"),
    (lambda: StepLoad(handle_angle=1, force=1, duration=1), "handle_angle", "step-load): handle_angle is 57.2958 deg"),
    (
        lambda: StepLoad(output_angle=1.5, force=1, duration=1),
        "output_angle",
        "step-load): output_angle is 85.9437 deg",
    ),
    (lambda: Ramp(handle_angle=-1, duration=1), "handle_angle", "ramp): handle_angle is -57.2958 deg"),
    (lambda: Hold(axis="pitch", duration=1), "axis", "hold): axis is pitch; it must be yaw, which scaled-up has."),
    (lambda: Pretension(axis="pitch"), "axis", "pretension): axis is pitch"),
    (lambda: Hold(duration="2 h"), "duration", "hold): the run lasts 2 h by its end; it must last at most 1 h in all"),
    (lambda: Cycles(amplitude=0.1, period=1e5, count=1_000_000), "duration", "cycles): the run lasts "),
]


@pytest.mark.parametrize(("phase", "key", "start"), BEYOND)
def test_what_an_instrument_cannot_do_is_refused(
    scaled: Instrument, phase: Callable[[], Any], key: str, start: str
) -> None:
    protocol = one(Hold(duration=0.1), phase())
    with pytest.raises(ProtocolError) as problem:
        protocol.duration(scaled)
    assert str(problem.value).startswith(f"test: phase 2 ({start}")
    assert problem.value.key == key


def test_a_recorded_angle_beyond_the_range_is_named_by_line_and_time(scaled: Instrument) -> None:
    data = "# made up\ntime,angle\n\n1.0,0\n1.25,5\n1.5,12\n2.0,-3\n"
    for scale, start in ((4.0, "48 deg"), (3.6, "43.2 deg, which bends the unloaded tip")):
        with pytest.raises(ProtocolError) as problem:
            one(Motion(data=data, angle_unit="deg", scale=scale)).duration(scaled)
        assert f"test: phase 1 (motion): data: line 6 (1.5 s): the handle angle is {start}" in str(problem.value)
        assert problem.value.value == pytest.approx(12 * scale * DEG)


def test_a_weight_needs_the_pulley_of_the_rig(real: Instrument) -> None:
    with refused("weight", 1.0, kind=ProtocolError):
        one(StepLoad(weight=1, duration=1)).duration(real)


def test_commands_of_a_closed_loop_phase_are_refused(scaled: Instrument) -> None:
    with refused("phase", "pretension", kind=ProtocolError):
        one(Pretension()).commands(scaled, DT)


@pytest.mark.parametrize("bad", [0.0, -1e-3, 1e-320, math.nan, math.inf])
def test_a_time_step_that_is_no_time_is_refused(scaled: Instrument, bad: float) -> None:
    with pytest.raises(ProtocolError) as problem:
        one(Hold(duration=1)).duration(scaled, bad)
    assert problem.value.key == "time_step"


def test_a_protocol_that_is_not_there_is_refused_with_what_there_is(tmp_path: Path) -> None:
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    for bad, start in (
        (
            "nothing",
            "nothing: there is no such file and no protocol of that name; .* cycles, pretension, step-load, ti",
        ),
        (tmp_path, "there is no such file"),
        (tmp_path / "b.toml", "is not UTF-8 text"),
        ("a\0b", "is no path"),
    ):
        with pytest.raises(ProtocolError, match=start):
            simulate.load(bad)


def test_every_problem_of_a_file_is_named_at_once() -> None:
    with pytest.raises(ProtocolError) as problem:
        simulate.parse(HOLD.replace('"1 s"', "1") + CYCLES.replace("count = 2", "count = 0"), "my.toml")
    assert [line.split(" = ")[0] for line in str(problem.value).splitlines()] == [
        "my.toml: name is missing; it is required.",
        "my.toml: phase 1 (hold): duration",
        "my.toml: phase 2 (cycles): count",
    ]

"""Claims about chirps, load steps during motions, and motions that pass into one another."""

import math
from typing import Any

import numpy as np
import pytest

from tenodesis import simulate, statics
from tenodesis.control import Controller
from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.simulate import Chirp, Cycles, Hold, LoadStep, Motion, Protocol, Ramp, StepLoad
from tenodesis.simulate.motion import csv_text
from tenodesis.twin import Twin

DT = 1e-3
DEG = math.radians(1)


def commands(inst: Instrument, *phases: Any) -> dict[str, Array]:
    return Protocol(name="test", phases=phases).commands(inst, DT)


def motion(times: Array, degrees: Array, **more: Any) -> Motion:
    return Motion(data=csv_text(times, degrees, "time", "angle"), angle_unit="deg", **more)


SWEEPS = ["linear", "logarithmic"]


@pytest.mark.parametrize("sweep", SWEEPS)
@pytest.mark.parametrize("ends", [(0.5, 4.0), (4.0, 0.5), (2.0, 2.0)])
def test_a_chirps_frequency_is_the_one_asked_for_at_every_instant(sweep: Any, ends: tuple[float, float]) -> None:
    first, last = ends
    chirp = Chirp(amplitude=0.1, start_frequency=first, end_frequency=last, duration=20.0, sweep=sweep)
    share = np.linspace(0, 1, 2001)
    step = 1e-6
    found = (chirp.cycles(share + step, 20.0) - chirp.cycles(share - step, 20.0)) / (2 * step * 20.0)
    expected = first + (last - first) * share if sweep == "linear" else first * (last / first) ** share
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("sweep", SWEEPS)
def test_a_chirp_crosses_its_middle_at_every_half_period(scaled: Instrument, sweep: Any) -> None:
    chirp = Chirp(amplitude=10 * DEG, start_frequency=0.5, end_frequency=4.0, duration=20.0, sweep=sweep)
    angle = commands(scaled, chirp)["handle_angle"]
    time = np.arange(1, len(angle) + 1) * DT
    before = np.flatnonzero(angle[:-1] * angle[1:] < 0)
    crossings = time[before] - angle[before] * DT / (angle[before + 1] - angle[before])
    cycles = chirp.cycles(crossings / 20.0, 20.0)
    np.testing.assert_allclose(2 * cycles, np.round(2 * cycles), atol=1e-2)
    assert abs(angle).max() == pytest.approx(10 * DEG, rel=1e-3)


def test_a_chirp_of_an_output_angle_is_one_of_the_handle_angle_that_gives_it(scaled: Instrument) -> None:
    frequencies = {"start_frequency": 0.5, "end_frequency": 4.0, "duration": 5.0}
    handle = float(statics.handle_angle(scaled, 20 * DEG))
    one, other = (
        commands(scaled, Chirp(**size, **frequencies))["handle_angle"]
        for size in ({"amplitude": handle}, {"output_amplitude": 20 * DEG})
    )
    np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.parametrize("sweep", SWEEPS)
def test_a_chirp_begins_and_ends_at_rest_in_its_middle(scaled: Instrument, sweep: Any) -> None:
    chirp = Chirp(handle_angle="5 deg", amplitude="10 deg", start_frequency=1, end_frequency=5, duration=8, sweep=sweep)
    angle = commands(scaled, Hold(duration=0.1), chirp, Hold(duration=0.1))["handle_angle"]
    speed = np.diff(angle) / DT
    largest = 2 * np.pi * 5 * 10 * DEG
    assert abs(speed).max() <= largest
    # Neither a jump of the angle nor one of the speed, at the joints or within.
    assert abs(np.diff(speed)).max() <= 1.2 * largest * 2 * np.pi * 5 * DT
    assert angle[-1] == angle[-101] == pytest.approx(5 * DEG)
    assert abs(speed[-101]) < 1e-3 * largest


def test_a_chirp_of_the_load_holds_the_handle_and_swings_about_the_load_there_is(scaled: Instrument) -> None:
    chirp = Chirp(handle_angle="10 deg", force_amplitude="0.5 N", start_frequency=1, end_frequency=2, duration=6)
    found = commands(scaled, Ramp(force=1.0, duration=0.5), chirp)
    held, force = found["handle_angle"][-6000:], found["force"][-6000:]
    assert (held == 10 * DEG).all()
    assert force.max() == pytest.approx(1.5, rel=1e-3)
    assert force.min() == pytest.approx(0.5, rel=1e-3)
    assert force[-1] == pytest.approx(1.0)
    assert abs(np.diff(force)).max() <= 0.5 * 2 * np.pi * 2 * DT


CHIRP: dict[str, Any] = {"amplitude": "10 deg", "start_frequency": "1 Hz", "end_frequency": "5 Hz", "duration": "8 s"}
REFUSED: list[tuple[dict[str, Any], str, str]] = [
    ({"amplitude": "50 deg"}, "handle_angle + amplitude", "handle_angle + amplitude is 50 deg; it must be within the"),
    ({"handle_angle": "-40 deg"}, "handle_angle - amplitude", "handle_angle - amplitude is -50 deg; it must be within"),
    ({"duration": "1 s"}, "duration", "duration is 1 s; it must be at least 1.2 s, one period of start_frequency and"),
    ({"end_frequency": "200 Hz"}, "end_frequency", "end_frequency is 200 Hz; it must be at most 100 Hz, 10 time steps"),
    (
        {"speed_limit": "200 deg/s"},
        "amplitude",
        "amplitude is 10 deg, which at 5 Hz needs 314.2 deg/s; it must be at most 6.366 deg with a speed_limit of 200",
    ),
]


@pytest.mark.parametrize(("change", "key", "start"), REFUSED)
def test_a_chirp_that_cannot_be_is_refused_in_a_sentence(
    scaled: Instrument, change: dict[str, Any], key: str, start: str
) -> None:
    with pytest.raises(ProtocolError) as problem:
        commands(scaled, Chirp(**{**CHIRP, **change}))
    assert str(problem.value).startswith(f"test: phase 1 (chirp): {start}")
    assert str(problem.value).endswith(".")
    assert problem.value.key == key


TEXT = """
name = "swept"
[[phases]]
kind = "chirp"
amplitude = "10 deg"
start_frequency = "0.5 Hz"
end_frequency = "5 Hz"
sweep = "linear"
duration = "6 s"
force = "0.2 N"
load_steps = [
  { after = "1 s", force = "1 N", duration = "0.5 s" },
  { after = "2 s", moment = "0.05 N*m", rise = "50 ms", duration = "1 s" },
]

[[phases]]
kind = "cycles"
amplitude = "20 deg"
speed = "40 deg/s"
count = 2

[[phases.load_steps]]
after = "0.5 s"
force = "-1 N"
"""


def test_a_file_with_chirp_and_load_steps_is_the_protocol_written_in_python(scaled: Instrument) -> None:
    read = simulate.parse(TEXT)
    steps = (LoadStep(after=1, force=1, duration=0.5), LoadStep(after=2, moment=0.05, rise=0.05, duration=1))
    chirp = Chirp(
        amplitude=10 * DEG,
        start_frequency=0.5,
        end_frequency=5,
        sweep="linear",
        duration=6,
        force=0.2,
        load_steps=steps,
    )
    cycles = Cycles(amplitude=20 * DEG, speed=40 * DEG, count=2, load_steps=(LoadStep(after=0.5, force=-1),))
    written = Protocol(name="swept", phases=(chirp, cycles))
    again = simulate.parse(read.to_toml())
    for name, values in written.commands(scaled, DT).items():
        np.testing.assert_array_equal(read.commands(scaled, DT)[name], values)
        np.testing.assert_array_equal(again.commands(scaled, DT)[name], values)


@pytest.mark.parametrize(
    ("change", "start"),
    [
        (("0.5 Hz", "3 rad/s"), "phase 1 (chirp): start_frequency = '3 rad/s': it is measured by angle; write a freq"),
        (
            ('amplitude = "10 deg"', ""),
            "phase 1 (chirp): none of amplitude, output_amplitude and force_amplitude is given",
        ),
        (('force = "1 N", ', ""), "load_steps 1: none of force, weight and moment is given; give exactly one of them"),
        (('after = "2 s"', 'since = "2 s"'), "load_steps 2: since is not a known key; it must be one of force, weight"),
    ],
)
def test_a_bad_chirp_or_load_step_in_a_file_is_named_with_its_phase(change: tuple[str, str], start: str) -> None:
    with pytest.raises(ProtocolError) as problem:
        simulate.parse(TEXT.replace(*change), "my.toml")
    assert start in str(problem.value)
    assert str(problem.value).startswith("my.toml: phase ")


def test_a_load_step_in_a_motion_is_the_step_load_of_a_held_handle(scaled: Instrument) -> None:
    held = Chirp(force_amplitude=0.0, start_frequency=5, end_frequency=5, duration=2.0)
    for rise in (0.0, 0.05):
        step = LoadStep(after=0.3, force=1.5, rise=rise, duration=0.5)
        stepped = commands(scaled, held.model_copy(update={"load_steps": (step,)}))["force"]
        alone = commands(scaled, StepLoad(delay=0.3, force=1.5, rise=rise, duration=0.5, release=1.2 - 2 * rise))[
            "force"
        ]
        np.testing.assert_allclose(stepped, alone, atol=1e-12)


def test_load_steps_leave_the_motion_as_it_is_and_the_load_as_it_was(scaled: Instrument) -> None:
    plain = Cycles(amplitude=20 * DEG, speed=40 * DEG, count=3, force=0.5, force_end=1.0)
    steps = (LoadStep(after=0.5, force=-1, duration=0.5), LoadStep(after=1.5, force=2, duration=0.2, rise=0.1))
    before = commands(scaled, plain)
    after = commands(scaled, plain.model_copy(update={"load_steps": steps}))
    np.testing.assert_array_equal(after["handle_angle"], before["handle_angle"])
    free = np.ones(len(before["force"]), bool)
    free[500:1000] = free[1500:1900] = False
    np.testing.assert_allclose(after["force"][free], before["force"][free], atol=1e-12)
    assert (after["force"][500:1000] == -1).all()
    assert after["force"][1650] == 2


def test_a_load_step_without_a_duration_stays_for_what_follows(scaled: Instrument) -> None:
    cycles = Cycles(amplitude=20 * DEG, speed=40 * DEG, count=2, load_steps=(LoadStep(after=0.5, force=-1),))
    force = commands(scaled, cycles, Hold(duration=0.1))["force"]
    assert (force[:500] == 0).all()
    assert (force[500:] == -1).all()


@pytest.mark.parametrize(
    ("steps", "start"),
    [
        (({"after": 1.5, "duration": 1.0},), "load_steps 1 lasts until 2.5 s; it must be over within the motion's 2 s"),
        (
            ({"duration": 1.0}, {"after": 0.5}),
            "load_steps 2 has after = 0.5 s, while the load before is on; it must wait",
        ),
    ],
)
def test_load_steps_that_do_not_fit_are_refused(
    scaled: Instrument, steps: tuple[dict[str, Any], ...], start: str
) -> None:
    loads = tuple(LoadStep(force=1, **step) for step in steps)
    with pytest.raises(ProtocolError) as problem:
        commands(scaled, Cycles(amplitude=20 * DEG, speed=40 * DEG, count=2, load_steps=loads))
    assert str(problem.value).startswith(f"test: phase 1 (cycles): {start}")


def test_a_motion_cut_in_two_runs_as_the_whole(scaled: Instrument) -> None:
    times = np.linspace(0, 2, 41)
    degrees = 10 * np.sin(2 * np.pi * 0.4 * times)
    whole = commands(scaled, motion(times, degrees))["handle_angle"]
    for cut in (5, 11, 20, 37):
        parts = commands(scaled, motion(times[: cut + 1], degrees[: cut + 1]), motion(times[cut:], degrees[cut:]))
        np.testing.assert_allclose(parts["handle_angle"], whole, atol=1e-6)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_motion_takes_over_and_hands_over_the_speed_of_its_neighbours(scaled: Instrument, direction: float) -> None:
    # 20 deg/s into the motion, 10 deg/s out of it; the recording's own ends are slower and faster.
    times, degrees = np.array([0.0, 0.25, 0.5025]), direction * np.array([10.0, 13.0, 17.0])
    before = Ramp(handle_angle=direction * 10 * DEG, duration=0.5)
    after = Ramp(handle_angle=direction * 22 * DEG, duration=0.5)
    angle = commands(scaled, before, motion(times, degrees), after)["handle_angle"]
    speed = direction * np.diff(angle) / DT / DEG
    # Below what the cubic's curvature changes in a step there is no jump.
    assert abs(np.diff(speed)).max() < 0.3
    assert speed[498:501] == pytest.approx(20, abs=0.3)
    assert speed[1001:1005] == pytest.approx(10, abs=0.3)
    assert speed.min() > 5


def test_cycles_pass_into_a_motion_without_a_dip_and_a_turn_is_at_rest(scaled: Instrument) -> None:
    cycles = Cycles(amplitude=20 * DEG, speed=40 * DEG, count=1)
    times = np.linspace(0, 1, 11)
    on = commands(scaled, cycles, motion(times, -20 * times))["handle_angle"]
    turning = commands(scaled, cycles, motion(times, 20 * times))["handle_angle"]
    assert np.diff(on)[999:1002] / DT / DEG == pytest.approx(-40, abs=2)
    assert np.diff(turning)[999] / DT / DEG == pytest.approx(0, abs=2)


def test_a_motion_beside_a_phase_that_rests_or_begins_elsewhere_is_at_rest_there(scaled: Instrument) -> None:
    times = np.linspace(0, 1, 11)
    rising = motion(times, 20 * times)
    for after in (Hold(duration=0.1), Cycles(amplitude=10 * DEG, speed=1, count=1), motion(times, 10 * times)):
        angle = commands(scaled, rising, after)["handle_angle"]
        assert np.diff(angle)[998] / DT / DEG == pytest.approx(0, abs=1)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_the_move_to_a_motion_passes_into_it_without_a_stop(scaled: Instrument, direction: float) -> None:
    times = np.linspace(0, 1, 11)
    angle = direction * commands(scaled, motion(times, direction * (10 + 15 * times)))["handle_angle"]
    speed = np.diff(angle, prepend=0.0) / DT / DEG
    joint = int(np.searchsorted(angle, 10 * DEG - 1e-9))
    assert speed[joint - 3 : joint + 3] == pytest.approx(15, abs=0.3)
    assert speed.max() < 20.01
    assert (speed >= 0).all()
    assert abs(np.diff(speed)).max() < 1
    assert abs(speed[0]) < 0.01


def test_the_move_to_a_motion_that_turns_back_or_is_faster_stops_there(scaled: Instrument) -> None:
    times = np.linspace(0, 1, 11)
    for rate in (-5.0, 25.0):
        angle = commands(scaled, motion(times, 10 + rate * times))["handle_angle"]
        joint = len(angle) - 1000
        assert angle[joint - 1] == pytest.approx(10 * DEG)
        assert np.diff(angle)[joint - 2 : joint + 1] / DT / DEG == pytest.approx(0, abs=2)


def test_motions_of_two_axes_do_not_join(real: Instrument) -> None:
    both = real.replace(axes=("yaw", "pitch"))
    times = np.linspace(0, 1, 11)
    angle = commands(both, motion(times, 20 * times), motion(times, 20 * times, axis="pitch"))["handle_angle"]
    assert np.diff(angle[:, 0])[998] / DT / DEG == pytest.approx(0, abs=1)
    assert angle[1000, 1] / DEG == pytest.approx(0, abs=1e-2)


def test_what_is_wrong_with_the_next_phase_is_said_of_that(scaled: Instrument) -> None:
    times = np.linspace(0, 1, 11)
    with pytest.raises(ProtocolError, match=r"test: phase 2 \(cycles\): amplitude is 57"):
        commands(scaled, motion(times, 20 * times), Cycles(amplitude=1, speed=1, count=1))


def test_a_controller_runs_chirps_and_load_steps(scaled: Instrument) -> None:
    protocol = simulate.parse(TEXT.replace('kind = "cycles"', 'kind = "cycles"\nradial_force = "0 N"'))
    run = simulate.execute(Twin(scaled, time_step=DT), protocol, Controller(scaled))
    commanded = protocol.commands(scaled, DT)
    np.testing.assert_array_equal(run["commanded_handle_angle"], commanded["handle_angle"])
    np.testing.assert_array_equal(run["force"], commanded["force"])

"""Claims about motor currents in the place of load cells: what they show, what they hide, and what fails safely."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, header, parameters, tension_from_current
from tenodesis.control.resolution import check_force_limit, resolution, sentences
from tenodesis.errors import FaultWarning, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.recording.summary import outcome
from tenodesis.recording.writer import Recorder
from tenodesis.run import Run
from tenodesis.simulate import FaultInjection
from tenodesis.twin import Twin

from .can_bench import AGONIST, TIMEOUT, axis, bench_instrument, served, table
from .conftest import refused
from .test_homing import failure, unhomed
from .test_homing_proof import ALLOWED, home_on, moved, settled

CURRENTS: dict[str, Any] = {"sensors.kind": "current", "sensors.current_range": 6.0, "drives.torque_constant": 0.1}
GEARED = CURRENTS | {"drives.gear_efficiency": 0.9, "drives.friction_torque": 5e-3}
EXACT: dict[str, Any] = {
    "sensors.current_noise": 0.0,
    "sensors.current_bits": 24,
    "drives.torque_ripple": 0.0,
    "drives.encoder_counts": 2**20,
}
COUNT = 2000
HANDLE = np.radians(14.5)  # 33 deg of output


@pytest.fixture(scope="module")
def geared(scaled: Instrument) -> Instrument:
    return scaled.replace(**GEARED)


def last_error(run: Run) -> float:
    """Mean error of the tip in the last half second, deg."""
    wanted = tn.statics.output_angle(tn.load("scaled-up"), HANDLE)
    return float(np.degrees(run["output_angle"][-1000:].mean() - wanted))


def loaded(inst: Instrument, **options: Any) -> Run:
    """The hand bends the handle in 1 s, and the load comes 1 s later."""
    ramp = np.clip(np.arange(COUNT * 6) / 2000, 0, 1)
    load = np.where(np.arange(COUNT * 6) > 4000, 1.5, 0.0)
    return Twin(inst, seed=1).run(HANDLE * ramp**2 * (3 - 2 * ramp), load, **options)


def test_a_current_of_a_motor_that_moves_lies_on_an_edge_of_its_friction(geared: Instrument) -> None:
    inst = geared.replace(**EXACT)
    sensor = inst.tension_sensor
    for speed, edge in ((0.05, 1 / 0.9), (-0.05, 0.9)):
        run = Twin(inst).run(np.zeros(COUNT), spool_velocity=(speed, speed))
        expected = sensor.gain * (edge * run["tension"][-1] + np.sign(speed) * 1.0)
        assert run["measured_tension"][-1] == pytest.approx(expected, rel=1e-3)


def test_a_motor_at_rest_keeps_its_current_while_its_friction_carries_a_load(geared: Instrument) -> None:
    inst = geared.replace(**EXACT, friction=None)
    run = Twin(inst).run(np.zeros(COUNT), np.linspace(0, 0.2, COUNT))
    assert abs(run["tension"][-1] - run["tension"][0]).min() > 1
    assert np.ptp(run["measured_tension"], axis=0) == pytest.approx(0, abs=0.01)


def test_currents_are_their_tensions_over_the_constant_of_the_drive(geared: Instrument, tmp_path: Path) -> None:
    run = loaded(geared, controller=Controller(geared)).rows(-500)
    assert tension_from_current(geared, run["measured_current"]) == pytest.approx(run["measured_tension"])
    with Recorder(tmp_path / "run.mcap", axes=run.axes) as recorder:
        recorder.write(run)
    read = tn.Recording.open(tmp_path / "run.mcap")
    assert np.array_equal(read.run["measured_current"], run["measured_current"])
    assert np.array_equal(read.run["estimated_force"], run["estimated_force"])
    assert read.topics["/controller/measured_cf"].type == "geometry_msgs/msg/WrenchStamped"


def test_the_law_restores_the_angle_by_currents_alone(geared: Instrument) -> None:
    run = loaded(geared, controller=Controller(geared))
    assert run.fault_times == {}
    assert abs(last_error(run)) < 1
    assert last_error(loaded(geared)) < -8
    std = run["estimated_output_angle_std"][4000:]
    assert np.mean(((run["estimated_output_angle"] - run["output_angle"])[4000:] / std) ** 2) < 4


@pytest.mark.parametrize(
    ("how", "named"),
    [({"mode": "set", "value": 200.0}, "load_cell_range"), ({"mode": "hold"}, "load_cell_stuck")],
    ids=["saturated", "stale"],
)
def test_a_current_that_fails_leaves_the_tip_as_motors_that_stand_do(
    geared: Instrument, how: dict[str, Any], named: str
) -> None:
    fault = FaultInjection("tension.agonist", start=1.5, **how)
    with pytest.warns(FaultWarning, match=named):
        run = loaded(geared, controller=Controller(geared), fault_injection=[fault])
    standing = loaded(geared)
    assert abs(last_error(run)) < abs(last_error(standing)) + 0.5


def test_friction_of_the_drive_is_friction_to_the_observer(scaled: Instrument, geared: Instrument) -> None:
    cells, currents = (parameters(inst).axes[0] for inst in (scaled, geared))
    exponents = [own["sheath_coefficient"] * own["sheath_bend"] for own in (cells, currents)]
    assert exponents[1] - exponents[0] == pytest.approx(geared.tension_sensor.friction)
    assert "SCALED_UP_TENSION_PER_CURRENT" in header(geared)
    assert "TENSION_PER_CURRENT" not in header(scaled)


@pytest.mark.parametrize("slack", [0.0, 2e-3], ids=["tight", "slack"])
def test_homing_by_currents_finds_the_pretension_and_refuses_a_load(geared: Instrument, slack: float) -> None:
    run = home_on(settled(geared, slack), unhomed(geared))
    assert failure(run) == ""
    assert run["tension"][-1] == pytest.approx(geared.pretension, rel=0.05)
    assert abs(run["output_angle"][-1]) < np.radians(0.5)
    run = home_on(settled(geared, slack, 0.7), unhomed(geared), 0.7)
    assert failure(run) == "tip_loaded"
    assert moved(run) < ALLOWED


def test_homing_by_currents_that_are_too_coarse_moves_nothing(geared: Instrument) -> None:
    coarse = geared.replace(**{"sensors.current_noise": 0.05})
    run = home_on(settled(coarse, 2e-3), unhomed(coarse))
    assert failure(run) == "too_coarse"
    assert np.ptp(run["spool_angle"]) == 0


def test_check_and_record_say_what_tells_the_tensions(scaled: Instrument, geared: Instrument) -> None:
    known = resolution(geared)
    assert f"{geared.tension_sensor.per_current:.3g} N/A; until they move" in sentences(geared)[1]
    assert known.hidden_force == pytest.approx(2 * geared.pretension * np.sinh(0.1458) / (93.5 / 7.5), rel=0.02)
    assert resolution(scaled).hidden_force == 0
    run = loaded(geared, controller=Controller(geared))
    force, std = run["estimated_force"][-1], run["estimated_force_std"][-1]
    assert outcome(run, geared)["tip force"].startswith(f"yaw {force:+.2f} ± {2 * std:.2f} N at the end")
    assert "tip force" not in outcome(loaded(geared), geared)
    with refused("control.force_limit", 0.01, kind=InstrumentError):
        check_force_limit(geared.replace(**{"control.force_limit": 0.01}))


def test_what_currents_cannot_tell_is_refused(scaled: Instrument) -> None:
    for changes, words in (
        ({"sensors.kind": "current"}, "current_range is not given"),
        ({"sensors.kind": "current", "sensors.current_range": 6.0}, "torque_constant is not given"),
        (CURRENTS | {"drives.friction_torque": 0.13}, "hold the pretension of 25 N without any current"),
        (CURRENTS | {"drives.gear_efficiency": 1.2}, "gear_efficiency"),
    ):
        with pytest.raises(InstrumentError, match=words) as caught:
            scaled.replace(**changes)
        assert str(caught.value).count(". ") == 0
    with refused("inst"):
        tension_from_current(scaled, 1.0)


def test_drives_tell_their_currents_by_can(scaled: Instrument) -> None:
    inst = bench_instrument(scaled).replace(**GEARED)
    cells = {"agonist_tension": None, "antagonist_tension": None}
    settings = table(inst, rated_current=3.0, yaw=axis(inst, **cells))
    with served(inst, settings) as (device, bench, clock):
        clock.pass_time(1 / inst.sensors.sampling_rate)
        measured = device.read(TIMEOUT)
        assert measured is not None
        count = inst.tension_sensor.per_current * 3.0 / 1000
        assert measured.tension[0] == pytest.approx(bench.plant.latest["measured_tension"][-1], abs=count)  # type: ignore[attr-defined]
        bench.fixed[AGONIST, 0x6078, 0] = 2**15 - 1
        clock.pass_time(1 / inst.sensors.sampling_rate)
        again = device.read(TIMEOUT)
        assert again is not None
        assert np.isnan(again.tension[0, 0])


def test_a_kind_of_sensor_that_a_device_does_not_give_is_refused(scaled: Instrument) -> None:
    yaw = axis(scaled)
    with refused("sensors.kind", kind=InstrumentError):
        scaled.replace(**CURRENTS, devices={"canopen": {"yaw": yaw}})
    with refused("devices.canopen.yaw.agonist_tension", kind=InstrumentError):
        scaled.replace(devices={"canopen": {"yaw": {key: one for key, one in yaw.items() if "tension" not in key}}})


def test_axes_of_different_pretensions_have_a_tension_per_current_each() -> None:
    inst = tn.load("real-size").replace(**GEARED | {"drives.gear_efficiency": 0.7, "drives.friction_torque": 0.02})
    inst = inst.replace(overrides={"pitch": {"pretension": 0.4 * inst.pretension}})
    yaw, pitch = (one.tension_sensor.per_current for one in inst.planar)
    assert abs(yaw / pitch - 1) > 0.1
    assert tension_from_current(inst, 1.0, "pitch") == pytest.approx(pitch)
    assert tension_from_current(inst, 1.0) == tension_from_current(inst, 1.0, "yaw") == pytest.approx(yaw)
    defined = re.findall(r"#define (\w+_TENSION_PER_CURRENT) TENODESIS_C\((\S+)\)", header(inst))
    assert [(name, float(value)) for name, value in defined] == [
        ("REAL_SIZE_YAW_TENSION_PER_CURRENT", pytest.approx(yaw, rel=1e-6)),
        ("REAL_SIZE_PITCH_TENSION_PER_CURRENT", pytest.approx(pitch, rel=1e-6)),
    ]
    with refused("axis", "roll", kind=InstrumentError):
        tension_from_current(inst, 1.0, "roll")


def test_currents_tell_the_tensions_of_joints_that_share_tendons() -> None:
    plain = tn.load("needle-driver")
    inst = plain.replace(**GEARED | EXACT | {"drives.torque_constant": 0.02, "drives.friction_torque": 2e-3})
    (gain,) = {sensor.gain for sensor in inst.tension_sensors}
    radius = inst.own_drives.spool_radius
    assert radius != inst.drives.spool_radius
    for speed, edge in ((0.05, 1 / 0.9), (-0.05, 0.9)):
        run = Twin(inst).run(np.zeros((COUNT, 0)), spool_velocity=speed)
        pull = edge * run.tension + np.sign(speed) * 2e-3 / radius
        assert run.measured_tension[-1] == pytest.approx(gain * pull[-1], rel=2e-3)
        torque = run.measured_current * inst.drives.torque_constant * inst.drives.gear_ratio
        assert torque[-1] == pytest.approx(pull[-1] * radius, rel=2e-3)
    with refused("drives.torque_constant", kind=InstrumentError):
        plain.replace(**{"sensors.kind": "current", "sensors.current_range": 6.0})

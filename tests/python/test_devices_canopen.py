"""CiA 402 drives on a CAN bus: the loop through it, in speeds and in positions."""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from math import nan, pi
from typing import Any

import can
import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller
from tenodesis.devices import canopen
from tenodesis.devices.can_layout import LEAD, Aim, layout
from tenodesis.devices.canopen import CanOpenDevice
from tenodesis.errors import DeviceError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanOpen
from tenodesis.twin import Twin

from .can_bench import (
    AGONIST,
    ANTAGONIST,
    HEARTBEAT,
    RATE,
    SPEED,
    SPEED_UNIT,
    TICKS,
    TIMEOUT,
    at_rest,
    axis,
    bench_instrument,
    controlled,
    in_process,
    motion,
    moves,
    reopened,
    served,
    set_off,
    simulated,
    stops,
    table,
    tick,
)
from .conftest import refused, until
from .simulated_bench.bench import SimulatedBench, TwinPlant

EMERGENCY_OVERVOLTAGE = 0x3210
ANSWER_TIME = 60.0  # s, of an answer that comes, however busy the machine


@pytest.fixture(scope="module")
def inst() -> Instrument:
    return bench_instrument(tn.load("real-size"))


# The loop


def test_the_reference_without_lag_is_the_twin_with_its_controller(inst: Instrument) -> None:
    twin = Twin(inst)
    steps = round(1 / RATE / twin.time_step)
    handle, force = np.repeat([motion(n / RATE) for n in range(TICKS)], steps, 0).T
    # The bench has measured once before the controller first speaks.
    before = twin.run(handle[:steps], force[:steps])["output_angle"]
    run = twin.run(handle[steps:], force[steps:], controller=Controller(inst))["output_angle"]
    there = np.concatenate([before, run])[steps - 1 :: steps]
    # Commands are rounded as in frames, and what is rounded may shift a decision of the law by a tick.
    assert np.max(np.abs(there - in_process(inst, 0)[0])) < inst.control.dead_band / 10


def test_closed_loop_over_can_is_the_twin_with_commands_one_tick_late(inst: Instrument) -> None:
    plant = TwinPlant(Twin(inst), motion)
    with served(inst, plant=plant) as (device, _, _):
        tips, commands = controlled(inst, plant, partial(device.read, TIMEOUT), device.write)
    assert np.abs(commands).max() > 0.1  # rad/s: the motors are at work
    late, late_commands = in_process(inst, 1)
    assert np.max(np.abs(tips - late)) < 1e-9
    assert np.max(np.abs(commands - late_commands)) < 1e-6
    at_once, later = (np.abs(tips - in_process(inst, lag)[0]) for lag in (0, 2))
    assert min(at_once.max(), later.max()) > 1e-6  # the lag is one tick, no less and no more
    settled_at_once, settled_late = (in_process(inst, lag, 3 * TICKS)[0][-1] for lag in (0, 1))
    assert abs(settled_at_once - settled_late) < inst.control.dead_band  # which costs nothing that lasts


def test_a_bench_of_two_axes_is_told_apart(inst: Instrument) -> None:
    both = tn.load("real-size").replace(**{"sensors.sampling_rate": RATE})
    settings = table(both, yaw=axis(both), pitch=axis(both, agonist=3, sensors=11))
    moved = np.array([[0.1, 0.2], [0.3, 0.4]])
    with served(both, settings) as (device, bench, _):
        for _ in range(20):
            measured = device.read(TIMEOUT)
            device.write(moved)
        assert measured is not None
        assert np.all(np.argsort(measured.spool_angle.ravel()) == np.arange(4))
        assert np.allclose(bench.velocity, moved, atol=SPEED_UNIT)


def test_speed_is_cut_to_the_limit_and_what_is_not_finite_stops(inst: Instrument) -> None:
    limit = inst.drives.motor_speed / inst.drives.gear_ratio
    with served(inst) as (device, bench, _clock):
        for speeds, sent in (((99.0, -99.0), (limit, -limit)), ((nan, np.inf), (0.0, 0.0)), ((0.5, nan), (0.5, 0.0))):
            device.write(np.array([speeds]))
            device.read(TIMEOUT)
            assert until(lambda sent=sent: np.allclose(bench.velocity[0], sent, atol=SPEED_UNIT))  # type: ignore[misc]
        with pytest.raises(ValueError, match=r"shape \(2,\); it must be \(1, 2\)"):
            device.write(np.zeros(2))


def test_positions_go_on_where_the_encoder_wraps(inst: Instrument) -> None:
    counts = 2 * pi / inst.drives.encoder_counts / inst.drives.gear_ratio
    with served(inst, positions={AGONIST: 2**31 - 20, ANTAGONIST: -(2**31) + 20}) as (device, _bench, clock):
        angles = np.array([tick(device, clock) for _ in range(100)])[:, 0]
    assert np.all(np.abs(np.diff(angles, axis=0)) < 4 * counts)  # at 0.5 rad/s, less than one per sample
    assert angles[-1, 0] > (2**31 + 20) * counts
    assert angles[0, 1] == pytest.approx((2**31 - 20) * counts)


def test_zero_here_counts_from_where_it_was_opened(inst: Instrument) -> None:
    settings = table(inst, zero="here")
    with served(inst, settings, positions={AGONIST: 123456, ANTAGONIST: -99}) as (device, bench, clock):
        first = tick(device, clock)
        assert bench.fastest == 0
    assert first is not None and np.abs(first).max() < 3 * 2 * pi / inst.drives.encoder_counts


def test_profile_velocity_is_a_mode_too(inst: Instrument) -> None:
    with served(inst, table(inst, mode="profile-velocity")) as (device, bench, clock):
        assert {drive.get(0x6061) for drive in bench.drives.values()} == {3}
        set_off(device, bench, clock)


# Positions


def by_position(inst: Instrument, **changes: Any) -> CanOpen:
    return table(inst, mode="cyclic-position", **changes)


def test_the_loop_by_positions_ends_where_that_by_speeds_does(inst: Instrument) -> None:
    plant = TwinPlant(Twin(inst), motion)
    start = {AGONIST: 2**31 - 40, ANTAGONIST: -(2**31) + 40}  # where encoders begin anew
    with served(inst, by_position(inst, zero="here"), plant=plant, positions=start) as (device, bench, _):
        assert {drive.get(0x6061) for drive in bench.drives.values()} == {8}
        tips, _ = controlled(inst, plant, partial(device.read, TIMEOUT), device.write, 1000)
    off = np.abs(tips - in_process(inst, 1, 1000)[0])
    before_the_load = round(0.4 * RATE)
    assert off[:before_the_load].max() < np.radians(0.1)
    # Each of the two loops comes to rest within one dead band of the target.
    assert off[-1] < 2 * inst.control.dead_band


@pytest.mark.parametrize("position", [0, 123_456, 2**31 - 2, -(2**31) + 2])
def test_drives_that_are_told_positions_stay_where_they_are_until_they_are_told_more(
    inst: Instrument, position: int
) -> None:
    start = {AGONIST: position, ANTAGONIST: -position}
    with served(inst, by_position(inst), positions=start) as (device, bench, clock):
        for _ in range(5):
            tick(device, clock, 0.0)
        assert bench.fastest == 0
        set_off(device, bench, clock)
        for _ in range(100):
            tick(device, clock, nan)
        assert np.abs(bench.velocity).max() < 0.02 * SPEED


def test_a_motor_that_is_held_up_is_not_to_catch_up_at_a_bound(inst: Instrument) -> None:
    drive = layout(inst, by_position(inst)).drives[0]
    aim = Aim(drive, 1000, 1 / RATE)
    full = drive.most_units * drive.speed_per_unit
    for _ in range(1000):
        aim.go_on(full, 1000)
    ahead = (aim.target - 1000) * abs(drive.angle_per_count)
    assert ahead == pytest.approx(abs(full) * LEAD, rel=1e-3)
    assert aim.go_on(-full, 1000) < aim.go_on(full, 1000)


def test_a_stop_finds_drives_that_are_told_positions(inst: Instrument) -> None:
    with served(inst, by_position(inst)) as (device, bench, clock):
        set_off(device, bench, clock)
        bench.drives[ANTAGONIST].fault(EMERGENCY_OVERVOLTAGE)
        stops(device, bench, "emergency", lambda: [tick(device, clock) for _ in range(5)])


def test_closing_leaves_the_drives_without_power(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        device.close()
        assert at_rest(bench)
        assert {drive.state for drive in bench.drives.values()} == {"switch on disabled"}
        assert [drive.log[-2:] for drive in bench.drives.values()] == [
            ["quick stop active: quick stop", "switch on disabled"]
        ] * 2
        device.close()
        with refused("state", "closed", kind=DeviceError):
            device.read(TIMEOUT)


def test_a_closed_bench_can_be_opened_again(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        device.close()
        with reopened(device):
            set_off(device, bench, clock)


@contextmanager
def in_real_time(inst: Instrument) -> Iterator[tuple[CanOpenDevice, SimulatedBench]]:
    """A device and its simulated bench that both go by the clock."""
    settings = table(inst, heartbeat=0.1)
    with simulated(inst, settings, time.monotonic_ns) as bench:
        yield CanOpenDevice(inst, settings), bench


def test_closing_takes_longer_than_drives_wait_for_us_and_keeps_them_to_the_end(inst: Instrument) -> None:
    slow = inst.replace(**{"drives.motor_acceleration": inst.drives.motor_speed / 0.5})
    with in_real_time(slow) as (device, bench):
        assert device.capabilities.stops_alone < 0.5
        with device:
            for _ in range(5):
                device.read(TIMEOUT)
                device.write(np.full((1, 2), SPEED))
            assert moves(bench)
        logs = [drive.log for drive in bench.drives.values()]
        assert [log[-2:] for log in logs] == [["quick stop active: quick stop", "switch on disabled"]] * 2
        assert bench.fastest > 0 and not bench.velocity.any()
        assert all(drive.operational for drive in bench.drives.values())


def test_drives_wait_at_rest_however_late_the_first_command_comes(inst: Instrument) -> None:
    with in_real_time(inst) as (device, bench), device:
        time.sleep(2 * device.capabilities.stops_alone)
        assert {drive.state for drive in bench.drives.values()} == {"operation enabled"}
        assert bench.fastest == 0
        for _ in range(5):
            device.read(TIMEOUT)
            device.write(np.full((1, 2), SPEED))
        assert moves(bench)
        # From then on nothing but commands keeps them going.
        assert until(lambda: {drive.state for drive in bench.drives.values()} == {"quick stop active"})


def test_a_drive_that_does_not_say_that_it_has_stopped_is_named_at_the_end(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        bench.cut_off(ANTAGONIST)
        with refused("node", 2, kind=DeviceError):
            device.close()
        assert bench.drives[AGONIST].state == "switch on disabled"
        device.close()


def test_a_drive_that_heeds_no_pdo_any_more_loses_its_power_by_sdo(
    inst: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The bench answers only once it has simulated a period for each SYNC that stopping has sent it.
    monkeypatch.setattr(canopen, "_ANSWER_TIME", ANSWER_TIME)
    with served(inst) as (device, bench, clock):
        set_off(device, bench, clock)
        clock.pass_time(4 * HEARTBEAT)
        assert until(lambda: {drive.state for drive in bench.drives.values()} == {"quick stop active"})
        assert until(lambda: not any(drive.operational for drive in bench.drives.values()))
        device.close()
        assert {drive.state for drive in bench.drives.values()} == {"switch on disabled"}


# Another transport


@pytest.mark.process
def test_the_bus_may_be_udp_multicast(inst: Instrument) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("", 0))
        port = free.getsockname()[1]
    options = {"port": port, "hop_limit": 0}  # it does not leave this computer
    settings = table(inst, interface="udp_multicast", channel="239.74.163.9", options=options)
    _need_multicast(settings)
    with served(inst, settings) as (device, bench, clock):
        angles = np.array([tick(device, clock) for _ in range(50)])[:, 0]
        assert moves(bench)
        assert not device.capabilities.simulated
    assert np.all(angles[-1] > 0.02)


def _need_multicast(settings: CanOpen) -> None:
    """Skip where no frame comes from one socket to another."""
    try:
        buses = [can.Bus(interface=settings.interface, channel=settings.channel, **settings.options) for _ in range(2)]
    except (can.CanError, OSError, ImportError) as problem:
        pytest.skip(f"no UDP multicast here: {problem}")
    try:
        buses[0].send(can.Message(arbitration_id=1, is_extended_id=False))
        came = buses[1].recv(1.0)
    except (can.CanError, OSError) as problem:
        pytest.skip(f"no UDP multicast here: {problem}")
    finally:
        for bus in buses:
            bus.shutdown()
    if came is None:
        pytest.skip("no UDP multicast here: frames do not come back")


def test_drives_hold_tensions_by_their_torques_and_follow_speeds_again(inst: Instrument) -> None:
    settings = table(inst, rated_torque=0.2, tension_drives=True)
    wanted = np.array([[1.3, 1.2]]) * inst.pretension
    with served(inst, settings) as (device, bench, clock):
        assert device.capabilities.holds_tension
        for _ in range(10):
            device.hold(wanted)
            tick(device, clock, 0.0)
        # To half a thousandth of the rated torque.
        step = 0.5e-3 * 0.2 * inst.drives.gear_ratio * inst.drives.gear_efficiency / inst.drives.spool_radius
        np.testing.assert_allclose(bench.tension, wanted, atol=step)
        for _ in range(round(10 * inst.drives.time_constant * RATE)):
            tick(device, clock, 0.0)
        clock.pass_time(1 / RATE)
        measured = device.read(TIMEOUT)
        assert measured is not None
        np.testing.assert_allclose(measured.tension, wanted, rtol=0.01)
        device.hold(np.zeros((1, 2)))
        for _ in range(3):
            tick(device, clock, SPEED)
        assert not bench.tension.any()
        assert moves(bench)


def test_a_stop_finds_drives_that_hold_tensions_and_others_hold_none(inst: Instrument) -> None:
    settings = table(inst, rated_torque=0.2, tension_drives=True)
    with served(inst, settings) as (device, bench, clock):
        device.hold(np.full((1, 2), np.nan))
        tick(device, clock, 0.0)
        assert not bench.tension.any()
        device.hold(np.full((1, 2), inst.pretension))
        for _ in range(3):
            tick(device, clock, 0.0)
        assert bench.tension.all()
        bench.drives[AGONIST].fault(0x2310)
        stops(device, bench, "overcurrent", lambda: [tick(device, clock, 0.0) for _ in range(9)])
        assert until(lambda: not bench.tension.any())
    with served(inst) as (device, _, _), refused("spool_tension"):
        device.hold(np.full((1, 2), 10.0))
    for wrong in ({}, {"rated_torque": 0.2, "mode": "cyclic-position"}):
        with pytest.raises(ValueError, match="rated_torque and the mode cyclic-velocity"):
            table(inst, tension_drives=True, **wrong)

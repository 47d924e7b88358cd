"""CiA 402 drives on a CAN bus: the loop through it, and what becomes of motors when something is wrong."""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import isnan, nan, pi
from typing import Any

import can
import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, OperatingState
from tenodesis.devices import cia402
from tenodesis.devices.can_aim import LEAD, Aim
from tenodesis.devices.can_layout import Sensor, layout
from tenodesis.devices.canopen import CanOpenDevice
from tenodesis.devices.simulated.bench import SimulatedBench, TwinPlant
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanOpen
from tenodesis.run import Array
from tenodesis.twin import Twin

from .can_bench import (
    AGONIST,
    ANTAGONIST,
    COUNTER,
    HEARTBEAT,
    RATE,
    SENSORS,
    SPEED_UNIT,
    TIMEOUT,
    Prompt,
    axis,
    bench_instrument,
    reopened,
    served,
    simulated,
    table,
    tick,
)

TICKS = 300
SPEED = 0.5  # rad/s
EMERGENCY_OVERVOLTAGE = 0x3210


@pytest.fixture(scope="module")
def inst() -> Instrument:
    return bench_instrument(tn.load("real-size"))


def motion(time: float) -> tuple[float, float]:
    """The hand bends the handle by 20 deg in 0.3 s, then the tip is loaded."""
    return np.radians(20) * (1 - np.cos(pi * min(time, 0.3) / 0.3)) / 2, 0.5 if time > 0.4 else 0.0


def until(condition: Callable[[], bool]) -> bool:
    """Whether the simulated bench, a thread of its own, comes to that."""
    end = time.monotonic() + 10
    while not condition() and time.monotonic() < end:
        time.sleep(1e-3)
    return condition()


def at_rest(bench: SimulatedBench) -> bool:
    return until(lambda: not bench.velocity.any() and all(drive.velocity == 0 for drive in bench.drives.values()))


def moves(bench: SimulatedBench) -> bool:
    return until(lambda: bool(np.abs(bench.velocity).max() > 0.9 * SPEED))


def stops(device: CanOpenDevice, bench: SimulatedBench, named: str, act: Callable[[], object]) -> None:
    """What is done fails by that name, leaves all motors at rest, and nothing moves one afterwards."""
    with pytest.raises(DeviceError, match=named):
        act()
    assert at_rest(bench)
    with pytest.raises(DeviceError, match=named):
        device.write(np.full((1, 2), SPEED))
    with pytest.raises(DeviceError, match=named):
        device.read(TIMEOUT)
    assert at_rest(bench)


# The loop


def in_process(inst: Instrument, lag: int, ticks: int = TICKS) -> tuple[Array, Array]:
    """Output angles and commands of the twin in process, its commands late by so many ticks and rounded as frames."""
    plant, controller = TwinPlant(Twin(inst), motion), Controller(inst)
    waiting = [np.zeros((1, 2)) for _ in range(1 + lag)]
    tips, commands = [], []
    for n in range(ticks):
        measured = plant.step(waiting.pop(0))
        answer = controller.step((n + 1) / RATE, measured.handle_angle[0], measured.tension[0], measured.spool_angle[0])
        waiting.append(np.round(answer.spool_velocity / SPEED_UNIT)[np.newaxis] * SPEED_UNIT)
        assert plant.latest is not None
        tips.append(plant.latest["output_angle"][-1])
        commands.append(answer.spool_velocity)
    assert answer.state == OperatingState.ENABLED
    return np.array(tips), np.array(commands)


def test_the_reference_without_lag_is_the_twin_with_its_controller(inst: Instrument) -> None:
    twin = Twin(inst)
    steps = round(1 / RATE / twin.time_step)
    handle, force = np.repeat([motion(n / RATE) for n in range(TICKS)], steps, 0).T
    # The bench has measured once before the controller first speaks.
    before = twin.run(handle[:steps], force[:steps])["output_angle"]
    run = twin.run(handle[steps:], force[steps:], controller=Controller(inst))["output_angle"]
    there = np.concatenate([before, run])[steps - 1 :: steps]
    assert np.max(np.abs(there - in_process(inst, 0)[0])) < 1e-5  # rad: commands are rounded as in frames


def test_closed_loop_over_can_is_the_twin_with_commands_one_tick_late(inst: Instrument) -> None:
    plant, controller = TwinPlant(Twin(inst), motion), Controller(inst)
    tips, commands = [], []
    with served(inst, plant=plant) as (device, _, _):
        for n in range(TICKS):
            measured = device.read(TIMEOUT)
            assert measured is not None
            answer = controller.step(
                (n + 1) / RATE, measured.handle_angle[0], measured.tension[0], measured.spool_angle[0]
            )
            device.write(answer.spool_velocity[np.newaxis])
            assert plant.latest is not None
            tips.append(plant.latest["output_angle"][-1])
            commands.append(answer.spool_velocity)
    assert np.abs(commands).max() > 0.1  # rad/s: the motors are at work
    late, late_commands = in_process(inst, 1)
    assert np.max(np.abs(tips - late)) < 1e-9
    assert np.max(np.abs(np.array(commands) - late_commands)) < 1e-6
    at_once, later = (np.abs(tips - in_process(inst, lag)[0]) for lag in (0, 2))
    assert min(at_once.max(), later.max()) > 1e-6  # the lag is one tick, no less and no more
    assert at_once[-1] < inst.control.dead_band  # which costs nothing that lasts


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
        for speeds, told in (((99.0, -99.0), (limit, -limit)), ((nan, np.inf), (0.0, 0.0)), ((0.5, nan), (0.5, 0.0))):
            device.write(np.array([speeds]))
            device.read(TIMEOUT)
            assert until(lambda told=told: np.allclose(bench.velocity[0], told, atol=SPEED_UNIT))  # type: ignore[misc]
        with pytest.raises(ValueError, match=r"shape \(2,\); allowed is \(1, 2\)"):
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
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)


# Positions


def by_position(inst: Instrument, **changes: Any) -> CanOpen:
    return table(inst, mode="cyclic-position", **changes)


def test_the_loop_by_positions_ends_where_that_by_speeds_does(inst: Instrument) -> None:
    plant, controller = TwinPlant(Twin(inst), motion), Controller(inst)
    tips = []
    start = {AGONIST: 2**31 - 40, ANTAGONIST: -(2**31) + 40}  # where encoders begin anew
    with served(inst, by_position(inst, zero="here"), plant=plant, positions=start) as (device, bench, _):
        assert {drive.get(0x6061) for drive in bench.drives.values()} == {8}
        for n in range(1000):
            measured = device.read(TIMEOUT)
            assert measured is not None
            answer = controller.step(
                (n + 1) / RATE, measured.handle_angle[0], measured.tension[0], measured.spool_angle[0]
            )
            device.write(answer.spool_velocity[np.newaxis])
            assert plant.latest is not None
            tips.append(plant.latest["output_angle"][-1])
        assert answer.state == OperatingState.ENABLED
    off = np.abs(tips - in_process(inst, 1, 1000)[0])
    before_the_load = round(0.4 * RATE)
    assert off[:before_the_load].max() < np.radians(0.1)
    assert off[-1] < inst.control.dead_band


@pytest.mark.parametrize("position", [0, 123_456, 2**31 - 2, -(2**31) + 2])
def test_drives_that_are_told_positions_stay_where_they_are_until_they_are_told_more(
    inst: Instrument, position: int
) -> None:
    start = {AGONIST: position, ANTAGONIST: -position}
    with served(inst, by_position(inst), positions=start) as (device, bench, clock):
        for _ in range(5):
            tick(device, clock, 0.0)
        assert bench.fastest == 0
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
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
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
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
        with pytest.raises(DeviceError, match="not open"):
            device.read(TIMEOUT)


def test_a_closed_bench_can_be_opened_again(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        device.close()
        with reopened(device):
            tick(device, clock)
            tick(device, clock)
            assert moves(bench)


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
        with pytest.raises(DeviceError, match=r"^The antagonist drive of yaw \(node 2\) did not say to have stopped"):
            device.close()
        assert bench.drives[AGONIST].state == "switch on disabled"
        device.close()


def test_a_drive_that_heeds_no_pdo_any_more_loses_its_power_by_sdo(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        clock.pass_time(4 * HEARTBEAT)
        assert until(lambda: {drive.state for drive in bench.drives.values()} == {"quick stop active"})
        assert until(lambda: not any(drive.operational for drive in bench.drives.values()))
        device.close()
        assert {drive.state for drive in bench.drives.values()} == {"switch on disabled"}


# Heartbeats


def test_a_drive_whose_heartbeat_is_lost_stops_all_motors(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        bench.mangle = lambda can_id, data: None if can_id == 0x700 + ANTAGONIST else data
        stops(
            device,
            bench,
            r"heartbeat of the antagonist drive of yaw \(node 2\) is lost",
            lambda: [tick(device, clock) for _ in range(20)],
        )


def test_a_drive_whose_cable_is_pulled_is_named_and_stops_alone(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        bench.cut_off(AGONIST)
        stops(
            device,
            bench,
            r"agonist drive of yaw \(node 1\)",
            lambda: [tick(device, clock) for _ in range(9)],
        )


@pytest.mark.parametrize(("safe_state", "state"), [("hold", "quick stop active"), ("neutral", "switch on disabled")])
def test_drives_stop_by_themselves_once_this_computer_falls_silent(
    inst: Instrument, safe_state: str, state: str
) -> None:
    inst = inst.replace(**{"control.safe_state": safe_state})
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        # The loop hangs: it neither reads nor writes.
        clock.pass_time(4 * HEARTBEAT)
        assert until(lambda: {drive.state for drive in bench.drives.values()} == {state})
        assert at_rest(bench)
        assert all(f"{state}: heartbeat lost" in drive.log for drive in bench.drives.values())
        stops(device, bench, "emergency: 0x8130|not operational|in state", lambda: tick(device, clock))


def test_reading_alone_does_not_keep_motors_going(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)

        def read_only() -> None:
            for _ in range(20):
                clock.pass_time(1 / RATE)
                device.read(TIMEOUT)

        stops(device, bench, "0x8130|was silent for 1[0-9] ms", read_only)


def test_a_drive_that_starts_anew_is_named(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        bench.network.send_message(0x700 + AGONIST, b"\x00")
        stops(device, bench, r"node 1\) has started anew", lambda: [tick(device, clock) for _ in range(3)])


@pytest.mark.parametrize("act", ["read", "write"])
def test_no_drive_goes_on_after_this_computer_hung_though_it_might(inst: Instrument, act: str) -> None:
    """The worst drives that CiA 402 allows: enabled again from a quick stop, by a command that still waits."""
    with served(inst) as (device, bench, clock):
        for drive in bench.drives.values():
            drive.resumes = drive.stays_operational = True
        bench.mangle = lambda can_id, data: None if can_id in (0x80 + AGONIST, 0x80 + ANTAGONIST) else data
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        clock.pass_time(4 * HEARTBEAT)
        assert until(lambda: {drive.state for drive in bench.drives.values()} == {"quick stop active"})
        assert at_rest(bench)
        bench.fastest = 0.0
        do = {"read": lambda: device.read(TIMEOUT), "write": lambda: device.write(np.full((1, 2), SPEED))}[act]
        stops(device, bench, "This computer was silent for 1[0-9] ms", do)
        assert bench.fastest == 0


# Frames


class Deaf(Prompt):
    """A bus that takes no frames of an id, or carries them to nobody."""

    refused = lost = -1

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if msg.arbitration_id == self.refused:
            raise can.CanOperationError("transmit buffer full")
        if msg.arbitration_id != self.lost:
            super().send(msg, timeout)


def deaf(device: CanOpenDevice) -> Deaf:
    assert isinstance(device._bus, Deaf)
    return device._bus


def test_a_stop_reaches_the_drives_that_it_can_reach(inst: Instrument) -> None:
    with served(inst, kind=Deaf) as (device, bench, clock):
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        deaf(device).refused = 0x200 + AGONIST
        with pytest.raises(DeviceError, match=r"does not carry frames: transmit buffer full\. All motors are told"):
            device.write(np.full((1, 2), SPEED))
        assert until(lambda: bench.drives[ANTAGONIST].state == "quick stop active")
        assert "did not carry the stop" in device.problem
        clock.pass_time(4 * HEARTBEAT)
        assert at_rest(bench)


def test_a_drive_whose_commands_are_lost_stops_all_motors(inst: Instrument) -> None:
    with served(inst, kind=Deaf) as (device, bench, clock):
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        deaf(device).lost = 0x200 + ANTAGONIST
        with pytest.raises(DeviceError, match=r"node 2\) reports an emergency: 0x8250 \(a PDO that did not come\)"):
            for _ in range(20):
                tick(device, clock, 0.0)
        assert until(lambda: bench.drives[AGONIST].state == "quick stop active")
        clock.pass_time(4 * HEARTBEAT)
        assert at_rest(bench)


def test_what_fails_at_the_end_of_opening_leaves_nothing_open(inst: Instrument) -> None:
    with served(inst, kind=Deaf) as (device, bench, clock):
        device.close()
        deaf(device).refused = 0x200 + AGONIST
        with pytest.raises(DeviceError, match="does not carry frames"), reopened(device):
            pass
        assert {drive.state for drive in bench.drives.values()} == {"switch on disabled"}
        deaf(device).refused = -1
        deaf(device).prompt = False
        with reopened(device):
            tick(device, clock)
            tick(device, clock)
            assert moves(bench)


class Babbling(Prompt):
    """A bus on which somebody talks without end."""

    talks = False
    most = 100_000
    """Frames after which whoever listens has lost the case."""

    def pick(self, message: can.Message | None) -> can.Message | None:
        if message is None and self.talks:
            self.most -= 1
            assert self.most > 0, "whoever waits for silence waits for ever"
            return can.Message(arbitration_id=0x77, is_extended_id=False)
        return message


@pytest.mark.parametrize("when", ["reading", "closing"])
def test_who_talks_without_end_keeps_nobody_from_stopping(inst: Instrument, when: str) -> None:
    with served(inst, kind=Babbling) as (device, bench, clock):
        tick(device, clock)
        bus = device._bus
        assert isinstance(bus, Babbling)
        device._paced = True
        bus.talks = True
        if when == "reading":
            stops(device, bench, "is flooded", lambda: tick(device, clock))
        device.close()
        assert {drive.state for drive in bench.drives.values()} == {"switch on disabled"}


class Doubled(Prompt):
    """A bus with two nodes of one id."""

    node = 0
    _again: can.Message | None = None

    def pick(self, message: can.Message | None) -> can.Message | None:
        if message is None:
            message, self._again = self._again, None
        elif message.arbitration_id == 0x180 + self.node:
            self._again = message
        return message


def test_two_nodes_of_one_id_are_named(inst: Instrument) -> None:
    with served(inst, kind=Doubled) as (device, bench, clock):
        tick(device, clock)
        assert isinstance(device._bus, Doubled)
        device._bus.node = SENSORS
        stops(
            device,
            bench,
            r"The sensor node of yaw \(node 10\) has answered 7 samples twice; look for a second node of that id",
            lambda: [tick(device, clock) for _ in range(12)],
        )
        assert device.counts["twice"] >= 7


class Broken(Prompt):
    """A bus whose controller reports an error."""

    error: int | None = None

    def pick(self, message: can.Message | None) -> can.Message | None:
        if message is None and self.error is not None:
            message = can.Message(arbitration_id=self.error, is_error_frame=True, is_extended_id=False)
            self.error = None
        return message


def test_a_controller_that_is_off_the_bus_stops_the_bench_and_other_errors_are_told(inst: Instrument) -> None:
    with served(inst, kind=Broken) as (device, bench, clock):
        tick(device, clock)
        bus = device._bus
        assert isinstance(bus, Broken)
        device._settings = device._settings.model_copy(update={"interface": "socketcan"})
        bus.error = 0x08  # a violation of the protocol
        tick(device, clock)
        assert device.counts["bus"] == 1 and "reports errors" in device.problem
        bus.error = 0x48
        stops(device, bench, "is off the bus after too many errors", lambda: tick(device, clock))


def test_heartbeats_and_emergencies_without_content_are_named(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        bench.network.send_message(0x700 + AGONIST, b"")
        tick(device, clock)
        assert device.counts["short"] == 1 and "A heartbeat of the agonist drive" in device.problem
        bench.network.send_message(0x80 + ANTAGONIST, b"\x10")
        tick(device, clock)
        assert device.counts["short"] == 2 and "An emergency of the antagonist drive" in device.problem


class Careless(Prompt):
    """A bus that loses and delays frames of measurements on their way to the device."""

    def __init__(self, bus: can.BusABC, bench: SimulatedBench) -> None:
        super().__init__(bus, bench)
        self._random = np.random.default_rng(1)
        self._kept: list[tuple[int, can.Message]] = []
        self.withheld = 0
        made.append(self)

    def pick(self, message: can.Message | None) -> can.Message | None:
        if message is None:
            late = [one for one in self._kept if one[0] < self.asked]
            if late:
                self._kept.remove(late[0])
                return late[0][1]
            return None
        if self.prompt and 0x180 < message.arbitration_id < 0x580:
            drawn = self._random.uniform()
            if drawn < 0.1:
                self.withheld += 1
                if drawn < 0.05:
                    self._kept.append((self.asked, message))
                return self.recv(0.0)
        return message


made: list[Careless] = []


def test_lost_frames_are_missing_and_late_ones_are_counted_and_a_tick_old_at_most(inst: Instrument) -> None:
    count = 2 * pi / inst.drives.encoder_counts / inst.drives.gear_ratio
    speed, missing = 2.0, 0
    assert speed / RATE > 2 * count  # a tick later is told apart
    # A long heartbeat: bad luck is no loss.
    with served(inst, table(inst, heartbeat=1.0), Careless) as (device, bench, _):
        for _ in range(60):
            measured = device.read(TIMEOUT)
            device.write(np.full((1, 2), speed))
            assert measured is not None
            assert isinstance(bench.plant, TwinPlant) and bench.plant.latest is not None
            truth = bench.plant.latest["measured_spool_angle"][-1]
            lost = np.isnan(measured.spool_angle[0])
            missing += int(lost.sum()) + int(np.isnan(measured.handle_angle[0]))
            assert np.all(np.abs(measured.spool_angle[0] - truth)[~lost] < speed / RATE + 1.5 * count)
        assert 5 < missing == device.counts["missing"] <= made[0].withheld
        # Those that stood in for the next are followed by it.
        assert made[0].withheld - missing <= device.counts["twice"]
        assert device.counts["late"] + device.counts["twice"] > 2
        assert "frame of" in device.problem


def test_a_lost_frame_is_a_fault_to_the_controller_and_stops_its_motors(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        controller = Controller(inst)
        states = []
        for n in range(30):
            clock.pass_time(1 / RATE)
            if n == 5:
                bench.mangle = lambda can_id, data: None if can_id == 0x180 + SENSORS else data
            if n == 7:
                bench.mangle = lambda can_id, data: data
            measured = device.read(TIMEOUT)
            assert measured is not None
            answer = controller.step(
                (n + 1) / RATE, measured.handle_angle[0], measured.tension[0], measured.spool_angle[0]
            )
            states.append(answer.state)
            device.write(answer.spool_velocity[np.newaxis])
        assert device.counts["missing"] == 2
        assert states[4] == OperatingState.ENABLED
        assert np.isfinite(answer.spool_velocity).all()
        assert at_rest(bench)


def test_a_node_that_never_answers_again_stops_the_bench(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        bench.mangle = lambda can_id, data: None if can_id == 0x180 + SENSORS else data
        stops(
            device,
            bench,
            r"node 10\) has measured nothing for 7 samples\. The sensor node of yaw \(node 10\) has not answered",
            lambda: [tick(device, clock) for _ in range(10)],
        )


@pytest.mark.parametrize(("node", "size"), [(AGONIST, 5), (ANTAGONIST, 0), (SENSORS, 3), (SENSORS, 7)])
def test_a_frame_of_wrong_length_is_named_and_its_values_are_missing(inst: Instrument, node: int, size: int) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        bench.mangle = lambda can_id, data: data[:size] if can_id == 0x180 + node else data
        measured = device.read(TIMEOUT)
        assert measured is not None
        assert np.isnan(measured.spool_angle[0]).tolist() == [node == AGONIST, node == ANTAGONIST]
        assert np.isnan(measured.tension).all() == (node == SENSORS)
        assert device.counts["short"] == 1
        assert f"(node {node}) has {size} bytes" in device.problem
        stops(device, bench, f"has {size} bytes", lambda: [tick(device, clock) for _ in range(9)])


def test_a_drive_whose_counter_stands_tells_the_past(inst: Instrument) -> None:
    settings = table(inst, counter={"object": COUNTER[0], "sub": COUNTER[1]})
    with served(inst, settings) as (device, bench, clock):
        for _ in range(3):
            angles = tick(device, clock)
            assert angles is not None and np.isfinite(angles).all()
        bench.fixed[AGONIST, *COUNTER] = bench.drives[AGONIST].get(*COUNTER) - 1
        measured = device.read(TIMEOUT)
        assert measured is not None
        assert np.isnan(measured.spool_angle[0]).tolist() == [True, False]
        assert device.counts["past"] == 1
        stops(device, bench, "tells the past: its counter", lambda: [tick(device, clock) for _ in range(9)])


def test_a_counter_may_wrap(inst: Instrument) -> None:
    settings = table(inst, counter={"object": COUNTER[0], "sub": COUNTER[1]})
    with served(inst, settings) as (device, bench, clock):
        for drive in bench.drives.values():
            drive.set(*COUNTER, 2**16 - 3)
        for _ in range(8):
            tick(device, clock)
        assert not device.counts


@pytest.mark.parametrize("raw", [-(2**15), 2**15 - 1])
def test_a_sensor_at_the_end_of_its_range_is_not_a_number(inst: Instrument, raw: int) -> None:
    with served(inst) as (device, bench, clock):
        bench.fixed[SENSORS, 0x6401, 3] = raw
        clock.pass_time(1 / RATE)
        measured = device.read(TIMEOUT)
        assert measured is not None
        assert np.isnan(measured.tension[0]).tolist() == [False, True]
        assert device.counts["saturated"] == 1
        assert "antagonist tension by node 10 is beyond its range" in device.problem


def test_a_sensor_that_says_not_a_number_is_taken_at_its_word(inst: Instrument) -> None:
    handle = {"node": SENSORS, "object": 0x9130, "sub": 1, "type": "f32", "gain": 1.0}
    with served(inst, table(inst, yaw=axis(inst, handle_angle=handle))) as (device, bench, _clock):
        bench.fixed[SENSORS, 0x9130, 1] = nan
        measured = device.read(TIMEOUT)
        assert measured is not None
        assert isnan(measured.handle_angle[0]) and np.isfinite(measured.tension).all()
        assert "handle angle by node 10" in device.problem


def test_a_drive_that_tells_no_position_is_named(inst: Instrument) -> None:
    with served(inst) as (device, bench, _clock):
        bench.fixed[ANTAGONIST, 0x6064, 0] = -(2**31)
        measured = device.read(TIMEOUT)
        assert measured is not None
        assert np.isnan(measured.spool_angle[0]).tolist() == [False, True]
        assert "antagonist drive of yaw (node 2) tells no position" in device.problem


def test_a_flooded_bus_stops_the_bench(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)

        def flood() -> None:
            for _ in range(6000):
                bench.network.send_message(0x77, b"\x00" * 8)
            device.read(TIMEOUT)

        stops(device, bench, "is flooded", flood)


# Drives


def test_statuswords_tell_the_states_of_cia_402() -> None:
    """By the bits that the profile's table of states gives, high to low from bit 6, x of either value."""
    patterns = {
        "not ready to switch on": "0xx0000",
        "switch on disabled": "1xx0000",
        "ready to switch on": "01x0001",
        "switched on": "01x0011",
        "operation enabled": "01x0111",
        "quick stop active": "00x0111",
        "fault reaction active": "0xx1111",
        "fault": "0xx1000",
    }
    tables = {name: re.compile(pattern.replace("x", ".")) for name, pattern in patterns.items()}
    for word in range(2**16):
        bits = f"{word & 0x7F:07b}"
        allowed = [name for name, pattern in tables.items() if pattern.fullmatch(bits)]
        told = cia402.state(word)
        assert [told] == allowed or (not allowed and told == f"unknown (0x{word:04X})")


def test_an_emergency_that_is_over_stops_nobody(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        bench.drives[AGONIST].emergency(0)
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)


def test_an_emergency_is_named_and_stops_all_motors(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        bench.drives[AGONIST].emergency(EMERGENCY_OVERVOLTAGE)
        stops(
            device,
            bench,
            r"agonist drive of yaw \(node 1\) reports an emergency: 0x3210 \(overvoltage of the supply\)",
            lambda: [tick(device, clock) for _ in range(3)],
        )


def test_a_drive_that_leaves_operation_stops_the_other_too(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        bench.mangle = lambda can_id, data: None if can_id == 0x80 + ANTAGONIST else data  # its emergency is lost
        bench.drives[ANTAGONIST].fault(0x8611)
        stops(device, bench, r"node 2\) is in state fault", lambda: [tick(device, clock) for _ in range(3)])


def test_a_fault_at_the_start_is_reset_once(inst: Instrument) -> None:
    with served(inst) as (device, bench, _):
        device.close()
        bench.drives[AGONIST].fault(EMERGENCY_OVERVOLTAGE)
        with reopened(device):
            assert bench.drives[AGONIST].state == "operation enabled"
        device.close()
        bench.drives[AGONIST].fault(EMERGENCY_OVERVOLTAGE)
        bench.drives[AGONIST].fault_stays = True
        with pytest.raises(DeviceError, match=r"node 1\) is in fault 0x3210 \(overvoltage"), reopened(device):
            pass
        assert at_rest(bench) and bench.fastest == 0


def test_a_drive_may_take_its_time_to_leave_a_fault(inst: Instrument) -> None:
    with served(inst) as (device, bench, _):
        device.close()
        bench.drives[AGONIST].reset_time = 0.1
        bench.drives[AGONIST].fault(EMERGENCY_OVERVOLTAGE)
        with reopened(device):
            assert bench.drives[AGONIST].state == "operation enabled"


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"shows_mode": False}, r"node 1\) does not take mode 6"),
        ({"homing_methods": ()}, r"node 1\) refuses 35 .* in object 6098h"),
        ({"homes": False}, r"node 1\) says that it took its present position for zero, and is at 5000 counts"),
    ],
)
def test_a_drive_that_does_not_do_as_it_is_told_is_refused(
    inst: Instrument, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], named: str
) -> None:
    monkeypatch.setattr("tenodesis.devices.can_setup._STATE_TIME", 0.2)
    with served(inst, table(inst, zero="here")) as (device, bench, _):
        device.close()
        drive = bench.drives[AGONIST]
        drive._offset -= 5000
        drive.measure(drive._turned)
        for name, value in change.items():
            setattr(drive, name, value)
        with pytest.raises(DeviceError, match=named), reopened(device):
            pass
        assert all(drive.state == "switch on disabled" for drive in bench.drives.values())
        assert bench.fastest == 0


def test_an_older_drive_takes_its_position_for_zero_by_the_older_method(inst: Instrument) -> None:
    with served(inst, table(inst, zero="here")) as (device, bench, clock):
        device.close()
        bench.drives[AGONIST].homing_methods = (35,)
        bench.drives[AGONIST]._offset -= 5000
        with reopened(device):
            first = tick(device, clock)
        assert bench.drives[AGONIST].get(0x6098) == 35
        assert first is not None and np.abs(first).max() < 3 * 2 * pi / inst.drives.encoder_counts


def test_a_bench_that_another_program_serves_is_left_alone(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        tick(device, clock)
        assert moves(bench)
        logs = [list(drive.log) for drive in bench.drives.values()]
        other = can.Bus(interface="virtual", channel=device._settings.channel)
        beat = other.send_periodic(can.Message(arbitration_id=0x77F, data=[5], is_extended_id=False), HEARTBEAT)
        try:
            late = table(inst, channel=device._settings.channel, heartbeat=0.2)
            with pytest.raises(DeviceError, match=r"another program already: .* node 127, which is master"):
                CanOpenDevice(inst, late).open()
        finally:
            beat.stop()
            other.shutdown()
        assert [list(drive.log) for drive in bench.drives.values()] == logs
        assert moves(bench)


def refused(inst: Instrument, settings: CanOpen, named: str, **changes: Any) -> None:
    """Opening fails by that name, with a bench that has the usual table, and moves nothing."""
    told = settings.model_copy(update={"channel": "tenodesis refused"} | changes)
    usual = table(inst, channel="tenodesis refused")
    bus = can.Bus(interface="virtual", channel="tenodesis refused")
    try:
        with SimulatedBench(inst, usual, bus) as bench:
            device = CanOpenDevice(inst, told)
            with pytest.raises(DeviceError, match=named):
                device.open()
            with pytest.raises(DeviceError, match="not open"):
                device.write(np.full((1, 2), SPEED))
            assert at_rest(bench) and bench.fastest == 0
            assert all(drive.state != "operation enabled" for drive in bench.drives.values())
    finally:
        bus.shutdown()


def test_a_node_id_where_nobody_is_is_named_with_those_that_are_there(
    inst: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tenodesis.devices.can_setup._ANSWER_TIME", 0.2)
    wrong = table(inst, yaw=axis(inst, antagonist={"node": 77}))
    refused(inst, wrong, r"antagonist drive of yaw \(node 77\) does not answer on virtual .*nodes 1.* are there")


def test_a_node_that_is_no_drive_is_refused(inst: Instrument) -> None:
    sensors = {
        name: {"node": AGONIST, "object": 0x6401, "sub": sub, "gain": 1.0}
        for sub, name in enumerate(("handle_angle", "agonist_tension", "antagonist_tension", "output_angle"))
    }
    wrong = table(inst, yaw=axis(inst, **sensors) | {"agonist": {"node": SENSORS}})
    refused(inst, wrong, r"agonist drive of yaw \(node 10\) is no CiA 402 drive, its device profile is 401")


def test_a_drive_that_would_not_stop_alone_is_refused(inst: Instrument, monkeypatch: pytest.MonkeyPatch) -> None:
    from tenodesis.devices.simulated import cia402

    without = tuple(one for one in cia402._DRIVE_OBJECTS if one[0] != 0x6007)
    monkeypatch.setattr(cia402, "_DRIVE_OBJECTS", without)
    refused(inst, table(inst), r"node 1\) has no object 6007h:00. Without it the motor would not stop by itself")


def test_an_interface_that_is_not_there_is_one_sentence(inst: Instrument) -> None:
    for interface in ("socketcan", "no-such-interface"):
        device = CanOpenDevice(inst, table(inst, interface=interface, channel="can9"))
        with pytest.raises(DeviceError, match=rf"^CAN interface {interface}, channel can9, cannot be opened: .*\.$"):
            device.open()


# The table


def test_a_bus_that_is_too_slow_is_refused_with_what_it_can_do(inst: Instrument) -> None:
    fast = inst.replace(**{"sensors.sampling_rate": 2000.0})
    with pytest.raises(InstrumentError, match=r"take 265% of a bus of 500000 bit/s; allowed is up to \d+ Hz"):
        layout(fast, table(fast, bitrate=500_000, heartbeat=0.01))
    assert 0.5 < layout(fast, table(fast, bitrate=2_000_000, heartbeat=0.01)).load < 0.9


def test_the_bus_load_is_that_of_the_frames_as_counted_by_hand(inst: Instrument) -> None:
    # Davis et al. 2007: at most 135 bits for 8 bytes, 115 for 6, 65 for 1 and 55 for none.
    planned = layout(inst, table(inst, bitrate=1_000_000, heartbeat=0.01))
    cyclic = 55 + 2 * 2 * 115 + 135
    assert planned.load == pytest.approx((cyclic * RATE + 4 * 65 / 0.01) / 1e6)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"yaw": None, "pitch": None}, "neither yaw nor pitch"),
        ({"master": AGONIST}, r"yaw.agonist.node is 1, which is master already"),
        ({"master": SENSORS}, "a sensor's node is 10, which is master"),
        ({"heartbeat": 0.0}, "heartbeat"),
        ({"velocity_unit": 0.0}, "velocity_unit"),
    ],
)
def test_a_table_that_makes_no_bench_is_refused(inst: Instrument, changes: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        table(inst, **changes)


def test_a_gain_of_zero_and_two_drives_at_one_node_are_refused(inst: Instrument) -> None:
    silent = {"node": SENSORS, "object": 0x6401, "sub": 1, "gain": 0.0}
    with pytest.raises(ValueError, match="by which nothing would be told"):
        table(inst, yaw=axis(inst, handle_angle=silent))
    with pytest.raises(ValueError, match=r"yaw.antagonist.node is 1, which is yaw.agonist already"):
        table(inst, yaw=axis(inst, antagonist={"node": AGONIST}))


def test_two_sensors_that_are_one_are_refused(inst: Instrument) -> None:
    cell = {"node": SENSORS, "object": 0x6401, "sub": 2, "gain": 0.01}
    wrong = table(inst, yaw=axis(inst, agonist_tension=cell, antagonist_tension=cell))
    with pytest.raises(InstrumentError, match=r"antagonist tension of yaw is read from .* as the agonist tension of"):
        layout(inst, wrong)


def test_a_heartbeat_between_two_samples_is_refused(inst: Instrument) -> None:
    with pytest.raises(InstrumentError, match=r"heartbeat is 0\.001 s; .* allowed is a sampling period, 0\.002 s"):
        layout(inst, table(inst, heartbeat=1e-3))


@pytest.mark.parametrize("share", [1.5, 0.4])
def test_a_unit_that_leaves_no_speeds_to_choose_is_refused(inst: Instrument, share: float) -> None:
    with pytest.raises(InstrumentError, match=r"velocity_unit is .* allowed is one of which it makes 10 to"):
        layout(inst, table(inst, velocity_unit=share * inst.drives.motor_speed))


def test_no_unit_rounds_a_speed_beyond_the_limit(inst: Instrument) -> None:
    unit = inst.drives.motor_speed / 10.7
    planned = layout(inst, table(inst, velocity_unit=unit))
    for drive, sign in zip(planned.drives, (1, -1), strict=True):
        told = drive.velocity(planned.speed_limit)
        assert told == sign * 10  # 10.7 would be rounded to 11
        assert drive.velocity(-planned.speed_limit) == -told


def test_what_is_more_than_any_number_is_not_a_number() -> None:
    assert isnan(Sensor(0, 0, 1e300, 0.0, None).value(3e38))
    assert isnan(Sensor(0, 0, 1e308, 0.0, (-(2**31), 2**31 - 1)).value(-(2**31) + 1))
    assert Sensor(0, 0, 2.0, 1.0, None).value(3.0) == 7.0


def test_an_axis_without_its_table_is_refused(inst: Instrument) -> None:
    both = tn.load("real-size")
    with pytest.raises(InstrumentError, match=r"devices\.canopen\.pitch is missing"):
        CanOpenDevice(both, table(both))


# Another transport


def test_the_bus_may_be_udp_multicast(inst: Instrument) -> None:
    options = {"port": 43199, "hop_limit": 0}  # it does not leave this computer
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

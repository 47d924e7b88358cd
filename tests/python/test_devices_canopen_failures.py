"""CiA 402 drives on a CAN bus: motors stop when heartbeats or frames fail."""

from collections.abc import Callable
from math import isnan, nan, pi
from time import monotonic

import can
import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, OperatingState
from tenodesis.devices.canopen import CanOpenDevice
from tenodesis.errors import DeviceError
from tenodesis.instrument import Instrument

from .can_bench import (
    AGONIST,
    ANTAGONIST,
    COUNTER,
    HEARTBEAT,
    RATE,
    SENSORS,
    SPEED,
    TIMEOUT,
    Prompt,
    at_rest,
    axis,
    bench_instrument,
    reopened,
    served,
    set_off,
    stops,
    table,
    tick,
)
from .conftest import refused, until
from .simulated_bench.bench import SimulatedBench, TwinPlant


@pytest.fixture(scope="module")
def inst() -> Instrument:
    return bench_instrument(tn.load("real-size"))


# Heartbeats


def silent(bench: SimulatedBench, *ids: int) -> None:
    """Frames of these ids are lost."""
    bench.mangle = lambda can_id, data: None if can_id in ids else data


def faulted_in_silence(bench: SimulatedBench) -> None:
    silent(bench, 0x80 + ANTAGONIST)  # its emergency is lost
    bench.drives[ANTAGONIST].fault(0x8611)


@pytest.mark.parametrize(
    ("fail", "named"),
    [
        (lambda bench: silent(bench, 0x700 + ANTAGONIST), r"antagonist drive of yaw \(node 2\) is lost"),
        (lambda bench: silent(bench, 0x180 + SENSORS), r"node 10\) has measured nothing for 7 samples\. The "),
        (lambda bench: bench.cut_off(AGONIST), r"agonist drive of yaw \(node 1\)"),
        (lambda bench: bench.network.send_message(0x700 + AGONIST, b"\x00"), r"node 1\) has restarted"),
        (lambda bench: bench.drives[AGONIST].emergency(0x3210), r"emergency: 0x3210 \(overvoltage of the supply\)"),
        (faulted_in_silence, r"node 2\) is in state fault"),
    ],
)
def test_a_node_that_fails_is_named_and_stops_all_motors(
    inst: Instrument, fail: Callable[[SimulatedBench], object], named: str
) -> None:
    with served(inst) as (device, bench, clock):
        set_off(device, bench, clock)
        fail(bench)
        stops(device, bench, named, lambda: [tick(device, clock) for _ in range(20)])


@pytest.mark.parametrize(("safe_state", "state"), [("hold", "quick stop active"), ("neutral", "switch on disabled")])
def test_drives_stop_by_themselves_once_this_computer_falls_silent(
    inst: Instrument, safe_state: str, state: str
) -> None:
    inst = inst.replace(**{"control.safe_state": safe_state})
    with served(inst) as (device, bench, clock):
        set_off(device, bench, clock)
        # The loop hangs: it neither reads nor writes.
        clock.pass_time(4 * HEARTBEAT)
        assert until(lambda: {drive.state for drive in bench.drives.values()} == {state})
        assert at_rest(bench)
        assert all(f"{state}: heartbeat lost" in drive.log for drive in bench.drives.values())
        stops(device, bench, "emergency: 0x8130|not operational|in state", lambda: tick(device, clock))


def test_where_a_motor_does_not_obey_all_drives_lose_their_voltage(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        set_off(device, bench, clock)
        device.cut_power()
        assert until(lambda: {drive.state for drive in bench.drives.values()} == {"switch on disabled"})
        # The first word to each drive takes its voltage: no stop comes before that.
        assert all("quick stop active" not in str(drive.log) for drive in bench.drives.values())
        with refused("state", "closed", kind=DeviceError):
            tick(device, clock)


def test_reading_alone_does_not_keep_motors_going(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)

        def read_only() -> None:
            for _ in range(20):
                clock.pass_time(1 / RATE)
                device.read(TIMEOUT)

        stops(device, bench, "0x8130|was silent for 1[0-9] ms", read_only)


@pytest.mark.parametrize("act", ["read", "write"])
def test_no_drive_goes_on_after_this_computer_hung_though_it_might(inst: Instrument, act: str) -> None:
    """The worst drives that CiA 402 allows: enabled again from a quick stop, by a command that still waits."""
    with served(inst) as (device, bench, clock):
        for drive in bench.drives.values():
            drive.resumes = drive.stays_operational = True
        bench.mangle = lambda can_id, data: None if can_id in (0x80 + AGONIST, 0x80 + ANTAGONIST) else data
        set_off(device, bench, clock)
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
    assert isinstance(device._can.bus, Deaf)
    return device._can.bus


def test_a_stop_reaches_the_drives_that_it_can_reach(inst: Instrument) -> None:
    with served(inst, kind=Deaf) as (device, bench, clock):
        set_off(device, bench, clock)
        deaf(device).refused = 0x200 + AGONIST
        with refused("bus", kind=DeviceError):
            device.write(np.full((1, 2), SPEED))
        assert until(lambda: bench.drives[ANTAGONIST].state == "quick stop active")
        assert "The stop was not sent" in device.problem
        clock.pass_time(4 * HEARTBEAT)
        assert at_rest(bench)


def test_a_drive_whose_commands_are_lost_stops_all_motors(inst: Instrument) -> None:
    with served(inst, kind=Deaf) as (device, bench, clock):
        set_off(device, bench, clock)
        deaf(device).lost = 0x200 + ANTAGONIST
        with refused("node", 2, kind=DeviceError):
            for _ in range(20):
                tick(device, clock, 0.0)
        assert until(lambda: bench.drives[AGONIST].state == "quick stop active")
        clock.pass_time(4 * HEARTBEAT)
        assert at_rest(bench)


def test_what_fails_at_the_end_of_opening_leaves_nothing_open(inst: Instrument) -> None:
    with served(inst, kind=Deaf) as (device, bench, clock):
        device.close()
        deaf(device).refused = 0x200 + AGONIST
        with refused("bus", kind=DeviceError), reopened(device):
            pass
        assert {drive.state for drive in bench.drives.values()} == {"switch on disabled"}
        deaf(device).refused = -1
        deaf(device).prompt = False
        with reopened(device):
            set_off(device, bench, clock)


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
        bus = device._can.bus
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
        assert isinstance(device._can.bus, Doubled)
        device._can.bus.node = SENSORS
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
        bus = device._can.bus
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
    assert speed / RATE > 2 * count  # a tick later would stand out
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
        stops(device, bench, "sent an old frame: counter", lambda: [tick(device, clock) for _ in range(9)])


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
        assert "antagonist drive of yaw (node 2) gives no position" in device.problem


def test_a_flooded_bus_stops_the_bench(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)

        def flood() -> None:
            for _ in range(6000):
                bench.network.send_message(0x77, b"\x00" * 8)
            device._read_at = monotonic()  # however long that took: time passes for heartbeats
            device.read(TIMEOUT)

        stops(device, bench, "is flooded", flood)

"""A CAN bus with a simulated bench on it, for tests: lock-step, on a clock that stands until it is advanced."""

import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import pi
from typing import Any
from unittest.mock import patch

import can
import numpy as np
import pytest
from numpy.typing import NDArray

from tenodesis.control import Controller, OperatingState
from tenodesis.devices import can_setup
from tenodesis.devices.canopen import CanOpenDevice
from tenodesis.errors import DeviceError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanOpen
from tenodesis.run import Array
from tenodesis.twin import Twin

from .conftest import until
from .simulated_bench.bench import SimulatedBench, TwinPlant

RATE = 500.0  # Hz
TIMEOUT = 5.0  # s: of an answer that comes, however busy the machine
SPEED_UNIT = 1e-4  # rad/s
HEARTBEAT = 4e-3  # s
AGONIST, ANTAGONIST, SENSORS = 1, 2, 10
TICKS = 300
SPEED = 0.5  # rad/s
COUNTER = (0x2101, 0)

_channels = (f"tenodesis test {n}" for n in itertools.count())


class Clock:
    """Stands until it is advanced, ns."""

    def __init__(self) -> None:
        self.now = 1_000_000_000

    def __call__(self) -> int:
        return self.now

    def pass_time(self, seconds: float) -> None:
        self.now += round(seconds * 1e9)


class Prompt(can.BusABC):
    """A bus that reports at once that nothing more comes, once the bench has answered all that it was sent."""

    def __init__(self, bus: can.BusABC, bench: SimulatedBench) -> None:
        self._bus, self._bench = bus, bench
        self._before = bench.syncs
        self.prompt = False
        self.asked = 0
        super().__init__(channel=bus.channel_info)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.asked += msg.arbitration_id == 0x80
        # An SDO is answered apart from SYNC.
        self.prompt = self.prompt and not 0x600 < msg.arbitration_id < 0x680
        self._bus.send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        end = time.monotonic() + (TIMEOUT if timeout is None else timeout)
        while True:
            answered = self.prompt and self._bench.syncs - self._before >= self.asked
            left = end - time.monotonic()
            message = self.pick(self._bus.recv(0 if answered else max(0.0, min(left, 0.01))))
            if message is not None or answered or left <= 0:
                return message

    def pick(self, message: can.Message | None) -> can.Message | None:
        """What becomes of a frame; of none, where none came."""
        return message

    def shutdown(self) -> None:
        super().shutdown()
        self._bus.shutdown()


def bench_instrument(inst: Instrument) -> Instrument:
    """An instrument whose bench runs at the tests' rate, one axis of it."""
    return inst.axis(inst.axes[0]).replace(**{"sensors.sampling_rate": RATE})


def axis(inst: Instrument, agonist: int = AGONIST, sensors: int = SENSORS, **changes: Any) -> dict[str, Any]:
    angle = inst.sensors.encoder_range / 2**inst.sensors.encoder_bits
    tension = 2 * inst.sensors.load_cell_range / 2**inst.sensors.load_cell_bits
    return {
        "agonist": {"node": agonist},
        "antagonist": {"node": agonist + 1, "reversed": True},
        "handle_angle": {"node": sensors, "object": 0x6401, "sub": 1, "gain": angle},
        "agonist_tension": {"node": sensors, "object": 0x6401, "sub": 2, "gain": tension},
        "antagonist_tension": {"node": sensors, "object": 0x6401, "sub": 3, "gain": tension},
        "output_angle": {"node": sensors, "object": 0x6401, "sub": 4, "gain": angle},
    } | changes


def table(inst: Instrument, **changes: Any) -> CanOpen:
    values = {
        "interface": "virtual",
        "channel": next(_channels),
        "velocity_unit": SPEED_UNIT,
        "heartbeat": HEARTBEAT,
        "yaw": axis(inst),
    }
    return CanOpen.model_validate(values | changes)


@contextmanager
def simulated(
    inst: Instrument, settings: CanOpen, clock: Callable[[], int], **options: Any
) -> Iterator[SimulatedBench]:
    """A simulated bench that runs."""
    bus = can.Bus(interface=settings.interface, channel=settings.channel, **settings.options)
    try:
        with (
            patch.object(can_setup, "_ANSWER_TIME", TIMEOUT),
            SimulatedBench(inst, settings, bus, clock=clock, **options) as bench,
        ):
            yield bench
    finally:
        bus.shutdown()


@contextmanager
def served(
    inst: Instrument, settings: CanOpen | None = None, kind: type[Prompt] = Prompt, **options: Any
) -> Iterator[tuple[CanOpenDevice, SimulatedBench, Clock]]:
    """A device that is open, its simulated bench, and the clock of both."""
    settings = table(inst) if settings is None else settings
    clock = Clock()
    with simulated(inst, settings, clock, **options) as bench:
        bus = kind(can.Bus(interface=settings.interface, channel=settings.channel, **settings.options), bench)
        device = CanOpenDevice(inst, settings, bus=bus, clock=clock, paced=False)
        try:
            with device:
                bus.prompt = True
                yield device, bench, clock
        finally:
            bus.shutdown()


@contextmanager
def reopened(device: CanOpenDevice) -> Iterator[None]:
    """A device is opened again on a bus of which answers to other than SYNC are waited for."""
    bus = device._can.bus
    assert isinstance(bus, Prompt)
    device.open()
    bus.prompt = True
    yield


def tick(device: CanOpenDevice, clock: Clock, speed: float = 0.5) -> NDArray[np.float64] | None:
    """One sampling period: read, then write a speed to all motors; the measurement's spool angles."""
    clock.pass_time(1 / RATE)
    measured = device.read(TIMEOUT)
    device.write(np.full((len(device.capabilities.axes), 2), speed))
    return None if measured is None else measured.spool_angle


def motion(time: float) -> tuple[float, float]:
    """The hand bends the handle by 20 deg in 0.3 s, then the tip is loaded."""
    return np.radians(20) * (1 - np.cos(pi * min(time, 0.3) / 0.3)) / 2, 0.5 if time > 0.4 else 0.0


def at_rest(bench: SimulatedBench) -> bool:
    return until(lambda: not bench.velocity.any() and all(drive.velocity == 0 for drive in bench.drives.values()))


def moves(bench: SimulatedBench) -> bool:
    return until(lambda: bool(np.abs(bench.velocity).max() > 0.9 * SPEED))


def set_off(device: CanOpenDevice, bench: SimulatedBench, clock: Clock) -> None:
    """After two periods the motors move."""
    tick(device, clock)
    tick(device, clock)
    assert moves(bench)


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


def controlled(
    inst: Instrument, plant: TwinPlant, read: Callable[[], Any], write: Callable[[Array], Any], ticks: int = TICKS
) -> tuple[Array, Array]:
    """Output angles and commands of a loop over what reads and writes, enabled to its end."""
    controller = Controller(inst)
    tips, commands = [], []
    for n in range(ticks):
        measured = read()
        assert measured is not None
        answer = controller.step((n + 1) / RATE, measured.handle_angle[0], measured.tension[0], measured.spool_angle[0])
        write(answer.spool_velocity[np.newaxis])
        assert plant.latest is not None
        tips.append(plant.latest["output_angle"][-1])
        commands.append(answer.spool_velocity)
    assert answer.state == OperatingState.ENABLED
    return np.array(tips), np.array(commands)


def in_process(inst: Instrument, lag: int, ticks: int = TICKS) -> tuple[Array, Array]:
    """Output angles and commands of the twin in process, its commands late by so many ticks and rounded as frames."""
    plant = TwinPlant(Twin(inst), motion)
    waiting = [np.zeros((1, 2)) for _ in range(1 + lag)]

    def write(velocity: Array) -> None:
        waiting.append(np.round(velocity / SPEED_UNIT) * SPEED_UNIT)

    return controlled(inst, plant, lambda: plant.step(waiting.pop(0)), write, ticks)

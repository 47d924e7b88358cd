"""CiA 402 drives and their sensors on a CAN bus, one SYNC per tick."""

import logging
import struct
import time
from collections import Counter
from collections.abc import Callable
from math import isfinite, nan
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from tenodesis.devices import cia402
from tenodesis.devices.can_layout import COLUMNS, DriveFrames, SensorFrame, layout
from tenodesis.devices.can_setup import MISSED_HEARTBEATS, Setup
from tenodesis.devices.device import Capabilities, Measurement
from tenodesis.devices.settings import CanOpen
from tenodesis.errors import DeviceError
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

if TYPE_CHECKING:
    import can

_SYNC = 0x80
_OPERATIONAL = 5
_BOOTED = 0
_STOPPING_TIME = 0.5  # s, beyond the time that the motors take from their full speed
_FLOOD = 5000
_ANSWER_TIME = 0.2  # s, of an SDO server whose answer changes nothing
_NEVER_MEASURED = -(2**31)
"""Position that some drives give for none; an encoder passes it only where it wraps."""
_NEARBY = 2**16  # counts
_HALF_COUNTER = 2**15


class CanOpenDevice:
    """A bench on a CAN bus: its drives measure and act on SYNC, which `read` sends.

    Parameters
    ----------
    inst
        The instrument.
    settings
        Its table devices.canopen, unless another is given.
    bus
        A bus of python-can that is open already; by default the settings' own.
    clock
        What heartbeats and measurements are timed by, ns.
    paced
        Whether `read` waits until a sampling period has passed since the last SYNC; if not, the caller keeps time, and
        `read` waits for all answers as long as it is told.

    Raises
    ------
    InstrumentError
        The instrument file does not tell how its bench is served.
    """

    def __init__(
        self,
        inst: Instrument,
        settings: CanOpen,
        *,
        bus: "can.BusABC | None" = None,
        clock: Callable[[], int] = time.monotonic_ns,
        paced: bool = True,
    ) -> None:
        self._inst, self._settings, self._clock, self._paced = inst, settings, clock, paced
        self._plan = layout(inst, settings)
        self._period = round(1e9 / inst.sensors.sampling_rate)
        self._loss = round(MISSED_HEARTBEATS * settings.heartbeat * 1e9)
        self._given, self._bus = bus, bus
        self._opened = False
        self._failed: DeviceError | None = None
        self._frames: dict[int, DriveFrames | SensorFrame] = {drive.measured_id: drive for drive in self._plan.drives}
        self._frames |= {frame.cob_id: frame for frame in self._plan.sensors}
        self._values = np.full((len(inst.axes), len(COLUMNS)), nan)
        self._spools = np.full((len(inst.axes), 2), nan)
        self._turned: dict[int, int] = {}
        self._position: dict[int, int] = {}
        self._counted: dict[int, int] = {}
        self._waiting: set[int] = set()
        self._missed: dict[int, int] = {}
        self._heard: dict[int, int] = {}
        self._due = 0
        self._beaten = 0
        self._states: dict[int, str] = {}
        self._stopping = False
        self.counts: Counter[str] = Counter()
        """Frames by what was wrong with them: missing, late, twice, short, past; and sensors saturated."""
        self.problem = ""
        """What was wrong last, in one sentence."""
        self.round_trip = nan
        """Time from the last SYNC to the last of its answers, s."""
        self.capabilities = Capabilities(
            name="canopen",
            axes=inst.axes,
            rate=inst.sensors.sampling_rate,
            clocked=paced,
            simulated=settings.interface == "virtual",
            distal_encoder=all(getattr(settings, name).output_angle is not None for name in inst.axes),
            # A command that comes between two SYNCs acts at the second.
            latency=self._period / 1e9,
            stops_alone=self._loss / 1e9,
        )

    def open(self) -> None:
        """Prepare all nodes and enable the drives, at rest."""
        import can  # noqa: PLC0415 - slow to import, and only a bench needs it
        import canopen  # noqa: PLC0415 - as above

        if self._opened:
            raise DeviceError("The canopen bench is open already; close it first.")
        # What the library logs of an answer that does not come, an error tells in a sentence.
        logging.getLogger("canopen").setLevel(logging.CRITICAL)
        self._bus = bus = self._given or self._connect()
        self._failed = None
        self._stopping = False
        network = canopen.Network(bus)
        network.NOTIFIER_CYCLE = 0.01
        beat = None
        try:
            network.connect()
            setup = Setup(network, self._inst, self._settings, self._plan)
            setup.prepare()
            beat = network.send_periodic(
                0x700 + self._settings.master, bytes((_OPERATIONAL,)), self._settings.heartbeat
            )
            setup.enable()
            self._opened = True
        except (can.CanError, OSError) as problem:
            raise DeviceError(f"{self._place} does not carry frames: {_told(problem)}") from None
        finally:
            if beat is not None:
                beat.stop()
            if network.notifier is not None:
                network.notifier.stop(1.0)
            if not self._opened:
                if beat is not None:
                    self._quick_stop()
                self._release()
        self._start()

    def _start(self) -> None:
        self._turned.clear()
        self._position.clear()
        self._counted.clear()
        self.counts.clear()
        self.problem = ""
        now = self._clock()
        self._heard = dict.fromkeys(self._plan.nodes, now)
        self._missed = dict.fromkeys(self._frames, 0)
        self._due = now
        self._beaten = now - self._loss
        self.write(np.zeros((len(self._plan.axes), 2)))

    def read(self, timeout: float) -> Measurement | None:
        """Send SYNC and return what drives and sensors measured at it; None where no node has answered."""
        self._refuse()
        began = time.monotonic()
        # What has come without being asked: heartbeats, emergencies, and answers that are too late.
        self._waiting = set()
        self._take_all(0.0)
        if self._paced:
            if self._due - self._clock() > timeout * 1e9:
                self._take_all(timeout)
                self._watch()
                return None
            while (left := self._due - self._clock()) > 0:
                self._take_all(left / 1e9)
        self._watch()
        self._values.fill(nan)
        self._spools.fill(nan)
        self._waiting = set(self._frames)
        measured_at = self._clock()
        self._due = max(self._due + self._period, measured_at)
        self._send(_SYNC, b"")
        sent = time.monotonic()
        end = min(began + timeout, sent + self._period / 1e9) if self._paced else began + timeout
        while self._waiting and self._take(max(0.0, end - time.monotonic())):
            pass
        self.round_trip = nan if self._waiting else time.monotonic() - sent
        answered = len(self._waiting) < len(self._frames)
        self._count_missing()
        if not answered:
            return None
        return Measurement(
            measured_at,
            self._values[:, 0].copy(),
            self._values[:, 1:3].copy(),
            self._spools.copy(),
            self._values[:, 3].copy(),
        )

    def write(self, spool_velocity: Array) -> None:
        """Send speeds, which act at the next SYNC; and our heartbeat, which thus stops with the commands."""
        self._refuse()
        speeds = np.asarray(spool_velocity, float)
        if speeds.shape != (len(self._plan.axes), 2):
            raise ValueError(f"spool_velocity has shape {speeds.shape}; allowed is {(len(self._plan.axes), 2)}.")
        limit = self._plan.speed_limit
        for drive in self._plan.drives:
            speed = float(speeds[drive.axis, drive.tendon])
            speed = min(max(speed, -limit), limit) if isfinite(speed) else 0.0
            self._send(drive.commanded_id, drive.command(cia402.ENABLE, speed))
        now = self._clock()
        if now - self._beaten >= self._settings.heartbeat * 1e9:
            self._send(0x700 + self._settings.master, bytes((_OPERATIONAL,)))
            self._beaten = now

    def close(self) -> None:
        """Stop the motors, take their power away and let go of the bus."""
        if not self._opened:
            return
        self._opened = False
        try:
            if self._stop():
                self._release_drives()
        finally:
            self._release()

    def __enter__(self) -> Self:
        """Open."""
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    @property
    def _place(self) -> str:
        return f"CAN interface {self._settings.interface}, channel {self._settings.channel},"

    def _connect(self) -> "can.BusABC":
        import can  # noqa: PLC0415 - slow to import

        options: dict[str, Any] = dict(self._settings.options)
        if self._settings.bitrate is not None:
            options["bitrate"] = self._settings.bitrate
        try:
            return can.Bus(interface=self._settings.interface, channel=self._settings.channel, **options)
        except (can.CanError, OSError, ImportError, ValueError, TypeError) as problem:
            raise DeviceError(f"{self._place} cannot be opened: {_told(problem)}") from None

    def _release_drives(self) -> None:
        """Let the drives, which have no power, not miss our heartbeat."""
        import can  # noqa: PLC0415 - slow to import; by now it is

        assert self._bus is not None
        answers = {0x580 + drive.node for drive in self._plan.drives}
        try:
            for drive in self._plan.drives:
                self._transmit(0x600 + drive.node, struct.pack("<BHBI", 0x23, 0x1016, 1, 0))
            end = time.monotonic() + _ANSWER_TIME
            while answers and (message := self._bus.recv(max(0.0, end - time.monotonic()))) is not None:
                answers.discard(message.arbitration_id)
        except (can.CanError, OSError) as problem:
            self.problem = f"{self._place} does not carry frames: {_told(problem)}"

    def _release(self) -> None:
        if self._given is None and self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def _refuse(self) -> None:
        if self._failed is not None:
            raise DeviceError(str(self._failed))
        if not self._opened:
            raise DeviceError("The canopen bench is not open; open it first.")

    def _transmit(self, can_id: int, data: bytes) -> None:
        import can  # noqa: PLC0415 - slow to import; by now it is

        assert self._bus is not None
        self._bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def _send(self, can_id: int, data: bytes) -> None:
        import can  # noqa: PLC0415 - as above

        try:
            self._transmit(can_id, data)
        except (can.CanError, OSError) as problem:
            self._fail(f"{self._place} does not carry frames: {_told(problem)}")

    def _take_all(self, wait: float) -> None:
        """Take what has come, and what comes within a time."""
        end = time.monotonic() + wait
        for _ in range(_FLOOD):
            if not self._take(max(0.0, end - time.monotonic())):
                return
        self._fail(f"{self._place} is flooded: {_FLOOD} frames between two SYNCs; look for who sends them.")

    def _take(self, wait: float) -> bool:
        """Take one frame, if one comes within a time."""
        import can  # noqa: PLC0415 - as above

        assert self._bus is not None
        try:
            message = self._bus.recv(wait)
        except (can.CanError, OSError, ValueError) as problem:
            self._fail(f"{self._place} gives no frames: {_told(problem)}")
        if message is None:
            return False
        if message.is_error_frame:
            self._tell("bus", f"{self._place} reports errors; look at termination and bit rate.")
        elif not message.is_remote_frame and not message.is_extended_id:
            self._sort(message.arbitration_id, bytes(message.data))
        return True

    def _sort(self, can_id: int, data: bytes) -> None:
        frame = self._frames.get(can_id)
        if frame is not None:
            self._measured(can_id, frame, data)
            return
        node = can_id & 0x7F
        if node not in self._heard or self._stopping:
            return
        if can_id == 0x700 + node and data:
            self._heartbeat(node, data[0] & 0x7F)
        elif can_id == 0x80 + node and len(data) >= 2:
            emergency = cia402.Emergency(int.from_bytes(data[:2], "little"))
            if not emergency.over:
                self._fail(f"{self._named(node)} reports an emergency: {emergency}.")

    def _measured(self, can_id: int, frame: DriveFrames | SensorFrame, data: bytes) -> None:
        name = f"{frame.name} (node {frame.node})"
        form = frame.measured if isinstance(frame, DriveFrames) else frame.format
        if can_id not in self._waiting:
            late = self._missed[can_id] > 0
            self._tell("late" if late else "twice", f"A frame of {name} came {'too late' if late else 'twice'}.")
            return
        if len(data) != form.size:
            self._tell("short", f"A frame of {name} has {len(data)} bytes; allowed are {form.size}.")
            return
        values = form.unpack(data)
        if isinstance(frame, SensorFrame):
            for sensor, raw in zip(frame.sensors, values, strict=True):
                value = sensor.value(raw)
                self._values[sensor.axis, sensor.column] = value
                if not isfinite(value):
                    self._tell("saturated", f"The {COLUMNS[sensor.column]} by node {frame.node} is beyond its range.")
        elif not self._moved(frame, *values):
            return
        self._waiting.discard(can_id)

    def _moved(self, drive: DriveFrames, status: int, position: int, counted: int | None = None) -> bool:
        """Take what a drive says of itself; False where it is of the past."""
        state = cia402.state(status)
        self._states[drive.node] = state
        if self._stopping:
            return True
        if state != cia402.OPERATION_ENABLED:
            self._fail(f"{self._named(drive.node)} is in state {state}, though it was enabled; look for the cause.")
        if counted is not None:
            before = self._counted.get(drive.node)
            self._counted[drive.node] = counted
            if before is not None and not 0 < (counted - before) % (2 * _HALF_COUNTER) < _HALF_COUNTER:
                self._counted[drive.node] = before
                self._tell("past", f"{self._named(drive.node)} tells the past: its counter went {before} → {counted}.")
                return False
        last = self._position.get(drive.node)
        moved = None if last is None else (position - last + 2**31) % 2**32 - 2**31
        if position == _NEVER_MEASURED and (moved is None or abs(moved) > _NEARBY):
            self._tell("saturated", f"{self._named(drive.node)} tells no position.")
            return True
        turned = position if moved is None else self._turned[drive.node] + moved
        self._position[drive.node], self._turned[drive.node] = position, turned
        self._spools[drive.axis, drive.tendon] = turned * drive.angle_per_count
        return True

    def _heartbeat(self, node: int, state: int) -> None:
        if state == _BOOTED:
            self._fail(f"{self._named(node)} has started anew; look at its power.")
        if state != _OPERATIONAL:
            self._fail(f"{self._named(node)} is not operational any more (state {state}).")
        self._heard[node] = self._clock()

    def _watch(self) -> None:
        """Fail if a node's heartbeat is lost."""
        now = self._clock()
        for node, heard in self._heard.items():
            if now - heard > self._loss:
                self._fail(
                    f"The heartbeat of {self._named(node)} is lost, for {(now - heard) / 1e6:.0f} ms; look at its "
                    "power and cable."
                )

    def _count_missing(self) -> None:
        for can_id, frame in self._frames.items():
            if can_id not in self._waiting:
                self._missed[can_id] = 0
                continue
            self._missed[can_id] += 1
            self._tell("missing", f"{self._named(frame.node)} has not answered a SYNC.", unless=True)
            if self._missed[can_id] * self._period > self._loss:
                self._fail(
                    f"{self._named(frame.node)} has measured nothing for {self._missed[can_id]} samples. {self.problem}"
                )

    def _tell(self, kind: str, sentence: str, *, unless: bool = False) -> None:
        """Count what was wrong and keep it; unless: a more telling sentence is kept already."""
        self.counts[kind] += 1
        if not (unless and self.problem):
            self.problem = sentence[0].upper() + sentence[1:]

    def _named(self, node: int) -> str:
        return f"{self._plan.nodes[node]} (node {node})"

    def _fail(self, sentence: str) -> None:
        """Stop all motors and raise; no heartbeat of ours follows, so that a drive that missed it stops by itself."""
        self._failed = DeviceError(f"{sentence[0].upper()}{sentence[1:]} All motors are told to stop.")
        self._quick_stop()
        raise self._failed

    def _quick_stop(self) -> None:
        import can  # noqa: PLC0415 - as above

        self._stopping = True
        try:
            for drive in self._plan.drives:
                self._transmit(drive.commanded_id, drive.command(cia402.QUICK_STOP, 0.0))
            self._transmit(_SYNC, b"")
        except (can.CanError, OSError) as problem:
            self.problem = f"{self._place} did not carry the stop: {_told(problem)}"

    def _stop(self) -> bool:
        """Quick-stop all drives, then take their power away; whether all say so."""
        import can  # noqa: PLC0415 - as above

        self._quick_stop()
        limit = self._inst.drives
        rest_at = time.monotonic() + min(limit.motor_speed / limit.motor_acceleration, _STOPPING_TIME)
        period = min(max(self._period / 1e9, 2e-3), _STOPPING_TIME / 10)
        try:
            while (now := time.monotonic()) < rest_at + _STOPPING_TIME:
                word = cia402.QUICK_STOP if now < rest_at else cia402.DISABLE_VOLTAGE
                for drive in self._plan.drives:
                    self._transmit(drive.commanded_id, drive.command(word, 0.0))
                self._states.clear()
                self._waiting = {drive.measured_id for drive in self._plan.drives}
                self._transmit(_SYNC, b"")
                while (self._paced or self._waiting) and self._take(max(0.0, now + period - time.monotonic())):
                    pass
                if (
                    word == cia402.DISABLE_VOLTAGE
                    and not self._waiting
                    and set(self._states.values()) == {cia402.SWITCH_ON_DISABLED}
                ):
                    return True
        except (can.CanError, OSError, DeviceError):
            return False
        return False


def _told(problem: BaseException) -> str:
    """Return a problem of a library as the end of a sentence."""
    text = " ".join(str(problem).split()).rstrip(".")
    return f"{text or type(problem).__name__}."

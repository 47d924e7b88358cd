"""CiA 402 drives and their sensors on a CAN bus, one SYNC per tick."""

import logging
import struct
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from math import isfinite, nan
from typing import Any, NoReturn

import can
import canopen
import numpy as np
from canopen.network import PeriodicMessageTask

from tenodesis.devices import cia402
from tenodesis.devices.can_layout import Aim, DriveFrames, SensorFrame, layout
from tenodesis.devices.can_setup import MISSED_HEARTBEATS, Setup
from tenodesis.devices.cia402 import DriveState
from tenodesis.devices.device import Bench, Capabilities, Measurement
from tenodesis.errors import DeviceError, Error
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanOpen
from tenodesis.run import Array

_ANSWER_TIME = 0.2  # s, of an SDO server to what stops a motor, or changes nothing
_ERRORS = (can.CanError, OSError, ValueError)
"""What python-can raises on a bus that carries no frames, or only damaged frames."""


class BusError(DeviceError):
    """A bus does not carry frames."""


class CanBus:
    """The bus that a bench's table devices.canopen names, or a given bus of python-can, open, which stays open."""

    def __init__(self, settings: CanOpen, given: can.BusABC | None = None) -> None:
        self._settings, self._given = settings, given
        self._open: can.BusABC | None = None
        self.name = f"CAN interface {settings.interface}, channel {settings.channel},"

    @property
    def bus(self) -> can.BusABC:
        """The open bus of python-can."""
        assert self._open is not None
        return self._open

    def open(self) -> None:
        """Open the bus; raises DeviceError if there is no such bus."""
        settings = self._settings
        if self._given is not None:
            self._open = self._given
            return
        options: dict[str, Any] = dict(settings.options)
        if settings.bitrate is not None:
            options["bitrate"] = settings.bitrate
        try:
            self._open = can.Bus(interface=settings.interface, channel=settings.channel, **options)
        except (*_ERRORS, ImportError, TypeError) as problem:
            raise DeviceError(
                f"{self.name} cannot be opened: {cause(problem)}", key="devices.canopen.channel", value=settings.channel
            ) from None

    def close(self) -> None:
        """Close the bus, unless it was given."""
        if self._given is None and self._open is not None:
            self._open.shutdown()
            self._open = None

    @contextmanager
    def carrying(self) -> Iterator[None]:
        """Raise BusError where the libraries say within this context that the bus does not carry frames."""
        try:
            yield
        except Error:
            raise
        except _ERRORS as problem:
            raise BusError(f"{self.name} does not carry frames: {cause(problem)}", key="bus") from None

    def send(self, can_id: int, data: bytes) -> None:
        """Send a frame; raises BusError."""
        with self.carrying():
            self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))

    def receive(self, wait: float) -> can.Message | None:
        """Return the next frame, or None where none comes within a time, s; raises BusError."""
        with self.carrying():
            return self.bus.recv(wait)

    def write_object(self, nodes: Iterable[int], index: int, sub: int, value: bytes) -> set[int]:
        """Write an object of nodes by SDO, which needs no SYNC, and return the nodes that have not confirmed it.

        Raises BusError if the bus does not carry the frames.
        """
        request = struct.pack("<BHB", 0x23 | 4 - len(value) << 2, index, sub) + value.ljust(4, b"\0")
        waiting = set(nodes)
        for node in sorted(waiting):
            self.send(0x600 + node, request)
        end = time.monotonic() + _ANSWER_TIME
        while waiting and (left := end - time.monotonic()) > 0:
            message = self.receive(left)
            if message is not None and bytes(message.data[:4]) == b"\x60" + request[1:4]:
                waiting.discard(message.arbitration_id - 0x580)
        return waiting


def cause(problem: BaseException) -> str:
    """Return a problem of a library as the end of a sentence."""
    text = " ".join(str(problem).split()).rstrip(".")
    return f"{text or type(problem).__name__}."


_SYNC = 0x80
_OPERATIONAL = 5
_BEAT = bytes((_OPERATIONAL,))
"""Our heartbeat."""
_BOOTED = 0
_STOPPING_TIME = 0.5  # s, beyond the time that the motors take from their full speed
_FLOOD = 5000
_BUS_OFF = 0x40  # class of an error frame, as SocketCAN has it
_LISTENED = 1.5
"""Heartbeats for which another program is listened for."""
_NEVER_MEASURED = -(2**31)
"""Position that some drives give for none; an encoder passes it only where it wraps."""
_NEARBY = 2**16  # counts
_HALF_COUNTER = 2**15
_WITHOUT_POWER = cia402.DISABLE_VOLTAGE.to_bytes(2, "little")


class CanOpenDevice(Bench):
    """A bench on a CAN bus: its drives measure and act on SYNC, which `read` sends.

    A bus of python-can that is open already may be given; by default it is the settings' own. Heartbeats and
    measurements are timed by the clock (ns). If paced, `read` waits until a sampling period has passed since the last
    SYNC; if not, the caller keeps time, and `read` waits for all answers until its timeout.

    Raises InstrumentError if the instrument file does not describe how its bench is wired.
    """

    def __init__(
        self,
        inst: Instrument,
        settings: CanOpen,
        *,
        bus: can.BusABC | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        paced: bool = True,
    ) -> None:
        self._inst, self._settings, self._clock, self._paced = inst, settings, clock, paced
        self._plan = plan = layout(inst, settings)
        self._period = round(1e9 / inst.sensors.sampling_rate)
        self._loss = round(MISSED_HEARTBEATS * settings.heartbeat * 1e9)
        capabilities = Capabilities(
            name="canopen",
            axes=plan.wiring.names.joints,
            rate=inst.sensors.sampling_rate,
            clocked=paced,
            simulated=settings.interface == "virtual",
            distal_encoder=plan.wiring.distal,
            # A command that comes between two SYNCs acts at the second.
            latency=self._period / 1e9,
            stops_alone=self._loss / 1e9,
            tendons=plan.wiring.tendons,
            holds_tension=settings.tension_drives,
        )
        super().__init__(capabilities, plan.speed_limit)
        self._tension = np.zeros(capabilities.spools)
        self._can = CanBus(settings, bus)
        self._beat: PeriodicMessageTask | None = None
        self._frames: dict[int, DriveFrames | SensorFrame] = {drive.measured_id: drive for drive in plan.drives}
        self._frames |= {frame.cob_id: frame for frame in plan.sensors}
        names = plan.wiring.names
        self._values = np.full(len(names.handle_joints) + len(names.tendons) + len(names.joints), nan)
        self._spools = np.full(len(names.tendons), nan)
        self._turned: dict[int, int] = {}
        self._position: dict[int, int] = {}
        self._counted: dict[int, int] = {}
        self._aims: dict[int, Aim] = {}
        self._waiting: set[int] = set()
        self._missed: Counter[int] = Counter()
        self._twice: set[int] = set()
        self._doubled: Counter[int] = Counter()
        self._heard: dict[int, int] = {}
        self._due = 0
        self._beaten = 0
        self._beat_id = 0x700 + settings.master
        self._read_at = 0.0
        self._states: dict[int, DriveState] = {}
        self._stopping = False
        self.round_trip = nan
        """Time from the last SYNC to the last of its answers, s."""

    def open(self) -> None:
        """Prepare all nodes and enable the drives, at rest; they keep at rest until the first `write`."""
        self._begin()
        # The library logs an answer that does not come; here an error reports it.
        logging.getLogger("canopen").setLevel(logging.CRITICAL)
        self._stopping = False
        self._tension.fill(0.0)
        self._can.open()
        ours = False
        try:
            self._look_for_another()
            ours = True
            self._prepare()
            self._start()
        except BaseException:
            if ours:
                self._give_up()
            self._can.close()
            raise
        self._opened = True

    def _look_for_another(self) -> None:
        """Refuse a bench that another program serves: its motors are not ours to stop, nor to move."""
        end = time.monotonic() + _LISTENED * self._settings.heartbeat
        while (left := end - time.monotonic()) > 0:
            message = self._can.receive(left)
            if message is not None and message.arbitration_id == self._beat_id:
                raise DeviceError(
                    f"{self._can.name} is served by another program already: it carries heartbeats of node "
                    f"{self._settings.master}, which is master; end that program first, or choose another master.",
                    key="devices.canopen.master",
                    value=self._settings.master,
                    allowed="the only master",
                )

    def _prepare(self) -> None:
        network = canopen.Network(self._can.bus)
        network.NOTIFIER_CYCLE = 0.01
        try:
            with self._can.carrying():
                self._set_up(network)
        finally:
            if network.notifier is not None:
                network.notifier.stop(1.0)

    def _set_up(self, network: canopen.Network) -> None:
        network.connect()
        setup = Setup(network, self._inst, self._settings, self._plan)
        setup.prepare()
        # Until the first command, which may be long in coming, the drives are at rest and held by this.
        self._beat = network.send_periodic(self._beat_id, _BEAT, self._settings.heartbeat)
        positions = setup.enable()
        self._aims = {
            drive.node: Aim(drive, positions[drive.node], self._period / 1e9)
            for drive in self._plan.drives
            if drive.aims
        }

    def _start(self) -> None:
        for kept in (self._turned, self._position, self._counted, self._missed, self._doubled):
            kept.clear()
        now = self._clock()
        self._heard = dict.fromkeys(self._plan.nodes, now)
        self._due = now
        self._beaten = now - self._loss
        self._read_at = time.monotonic()
        self._command(np.zeros(self._spools.shape))

    def _give_up(self) -> None:
        """Leave what could not be opened: motors stopped and without power, as far as they hear."""
        self._end_beat()
        self._quick_stop()
        self._write_all((drive.node for drive in self._plan.drives), 0x6040, 0, _WITHOUT_POWER)

    def read(self, timeout: float) -> Measurement | None:
        """Send SYNC and return what drives and sensors measured at it; None where no node has answered."""
        self._refuse()
        began = time.monotonic()
        # Unrequested frames: heartbeats, emergencies, and answers that are too late.
        self._waiting = set()
        self._take_all(began)
        if self._paced:
            if self._due - self._clock() > timeout * 1e9:
                self._take_all(began + timeout)
                self._watch()
                return None
            while (left := self._due - self._clock()) > 0:
                self._take_all(time.monotonic() + left / 1e9)
        self._watch()
        self._heed_silence()
        self._count_doubled()
        self._values.fill(nan)
        self._spools.fill(nan)
        self._waiting = set(self._frames)
        measured_at = self._clock()
        self._due = max(self._due + self._period, measured_at)
        self._send(_SYNC, b"")
        sent = time.monotonic()
        end = min(began + timeout, sent + self._period / 1e9) if self._paced else began + timeout
        self._take_all(end, answers=True)
        self.round_trip = nan if self._waiting else time.monotonic() - sent
        answered = len(self._waiting) < len(self._frames)
        self._count_missing()
        if not answered:
            return None
        handle, tension, output = self._plan.wiring.split(self._values.copy())
        spools = self._spools.reshape(tension.shape).copy()
        return Measurement(measured_at, handle, tension, spools, output)

    def write(self, spool_velocity: Array) -> None:
        """Send speeds, which act at the next SYNC; and our heartbeat, which thus stops with the commands."""
        self._refuse()
        speeds = self._speeds(spool_velocity)
        self._heed_silence()
        self._command(speeds)
        now = self._clock()
        if now - self._beaten >= self._settings.heartbeat * 1e9:
            self._send(self._beat_id, _BEAT)
            self._beaten = now
        self._end_beat()

    def cut_power(self) -> None:
        """Take the drives' power away at once, without a stop that one of them does not obey, and close."""
        self._refuse()
        self._stopping = True
        for drive in self._plan.drives:
            self._send(drive.commanded_id, self._resting(drive, cia402.DISABLE_VOLTAGE))
        self._send(_SYNC, b"")
        self.close()

    def close(self) -> None:
        """Stop the motors, take their power away and let go of the bus.

        Raises DeviceError if a drive does not report that it has no power; a drive that failed before has reported why.
        """
        if not self._opened:
            return
        self._opened = False
        try:
            powered = self._stop()
            if powered:
                names = " and ".join(self._named(node) for node in sorted(powered))
                self.problem = f"{names} did not say to have stopped: switch the motors off by hand."
                self.problem = self.problem[0].upper() + self.problem[1:]
            # Those that have no power need not miss our heartbeat.
            self._write_all({drive.node for drive in self._plan.drives} - powered, 0x1016, 1, bytes(4))
        finally:
            self._end_beat()
            self._can.close()
        if powered and self._failed is None:
            raise DeviceError(self.problem, key="node", value=min(powered))

    def _write_all(self, nodes: Iterable[int], index: int, sub: int, value: bytes) -> set[int]:
        """Write an object of nodes by SDO, and return the nodes that have confirmed it."""
        asked = set(nodes)
        try:
            return asked - self._can.write_object(asked, index, sub, value)
        except BusError as problem:
            self.problem = str(problem)
            return set()

    def _send(self, can_id: int, data: bytes) -> None:
        try:
            self._can.send(can_id, data)
        except BusError as problem:
            self._fail(str(problem))

    def hold(self, spool_tension: Array) -> None:
        """Have drives hold tensions by their torques, from the next `write` on; one that is not finite is none."""
        if not self.capabilities.holds_tension:
            super().hold(spool_tension)
            return
        tension = np.asarray(spool_tension, float).reshape(self._tension.shape)
        self._tension = np.where(np.isfinite(tension), np.maximum(tension, 0.0), 0.0)

    def _command(self, speeds: Array) -> None:
        for drive in self._plan.drives:
            if drive.torque_per_tension:
                pull = drive.pull(float(self._tension.flat[drive.spool]), cia402.MODES[self._settings.mode])
                self._send(drive.torque_id, pull)
            speed = float(speeds.flat[drive.spool])
            aim = self._aims.get(drive.node)
            target = drive.velocity(speed) if aim is None else aim.go_on(speed, self._turned.get(drive.node))
            self._send(drive.commanded_id, drive.command(cia402.ENABLE, target))

    def _resting(self, drive: DriveFrames, controlword: int) -> bytes:
        """Return the frame of a command that is no motion."""
        aim = self._aims.get(drive.node)
        return drive.command(controlword, 0 if aim is None else aim.target)

    def _end_beat(self) -> None:
        """From now on our heartbeat goes with the commands alone."""
        if self._beat is not None:
            self._beat.stop()
            self._beat = None

    def _take_all(self, end: float, *, answers: bool = False) -> None:
        """Take what has come, and what comes until a time (by the monotonic clock) or until all have answered."""
        now = time.monotonic()
        # Heartbeats accumulate while nothing reads them.
        beats = 2 * len(self._heard) * (now - self._read_at) / self._settings.heartbeat
        self._read_at = now
        for _ in range(_FLOOD + round(beats)):
            if (answers and not self._waiting) or not self._take(max(0.0, end - time.monotonic())):
                return
        self._fail(f"{self._can.name} is flooded: {_FLOOD} frames between two SYNCs; find the program that sends them.")

    def _take(self, wait: float) -> bool:
        """Receive a frame, if it comes within a time."""
        try:
            message = self._can.receive(wait)
        except BusError as problem:
            self._fail(str(problem))
        if message is None:
            return False
        if message.is_error_frame:
            if self._settings.interface == "socketcan" and message.arbitration_id & _BUS_OFF:
                self._fail(f"{self._can.name} is off the bus after too many errors; look at termination and bit rate.")
            self._note("bus", f"{self._can.name} reports errors; look at termination and bit rate.")
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
        least = {0x700 + node: 1, 0x80 + node: 2}.get(can_id)
        if least is None:
            return
        if len(data) < least:
            kind = "A heartbeat" if least == 1 else "An emergency"
            self._note("short", f"{kind} of {self._named(node)} has {len(data)} bytes; it must have {least} or more.")
        elif least == 1:
            self._heartbeat(node, data[0] & 0x7F)
        else:
            emergency = cia402.Emergency(int.from_bytes(data[:2], "little"))
            if not emergency.over:
                self._fail(f"{self._named(node)} reports an emergency: {emergency}.", node)

    def _measured(self, can_id: int, frame: DriveFrames | SensorFrame, data: bytes) -> None:
        name = f"{frame.name} (node {frame.node})"
        form = frame.measured if isinstance(frame, DriveFrames) else frame.format
        if can_id not in self._waiting:
            late = self._missed[can_id] > 0
            if not late:
                self._twice.add(can_id)
            self._note("late" if late else "twice", f"A frame of {name} came {'too late' if late else 'twice'}.")
            return
        if len(data) != form.size:
            self._note("short", f"A frame of {name} has {len(data)} bytes; it must have {form.size}.")
            return
        values = form.unpack(data)
        if isinstance(frame, SensorFrame):
            for sensor, raw in zip(frame.sensors, values, strict=True):
                value = sensor.value(raw)
                self._values[sensor.place] = value
                if not isfinite(value):
                    self._note("saturated", f"The {sensor.name} by node {frame.node} is beyond its range.")
        elif not self._moved(frame, *values):
            return
        self._waiting.discard(can_id)

    def _moved(self, drive: DriveFrames, status: int, position: int, counted: int | None = None) -> bool:
        """Take a drive's status and position; return False where they are old."""
        state = cia402.state(status)
        self._states[drive.node] = state
        if self._stopping:
            return True
        if state != DriveState.OPERATION_ENABLED:
            found = cia402.described(status)
            self._fail(
                f"{self._named(drive.node)} is in state {found}, though it was enabled; look for the cause.", drive.node
            )
        if counted is not None:
            before = self._counted.get(drive.node)
            self._counted[drive.node] = counted
            if before is not None and not 0 < (counted - before) % (2 * _HALF_COUNTER) < _HALF_COUNTER:
                self._counted[drive.node] = before
                self._note("past", f"{self._named(drive.node)} sent an old frame: counter {before} → {counted}.")
                return False
        last = self._position.get(drive.node)
        moved = None if last is None else cia402.wrapped(position - last)
        if position == _NEVER_MEASURED and (moved is None or abs(moved) > _NEARBY):
            self._note("saturated", f"{self._named(drive.node)} gives no position.")
            return True
        turned = position if moved is None else self._turned[drive.node] + moved
        self._position[drive.node], self._turned[drive.node] = position, turned
        self._spools[drive.spool] = turned * drive.angle_per_count
        return True

    def _heartbeat(self, node: int, state: int) -> None:
        if state == _BOOTED:
            self._fail(f"{self._named(node)} has restarted; look at its power.", node)
        if state != _OPERATIONAL:
            self._fail(f"{self._named(node)} is not operational any more (state {state}).", node)
        self._heard[node] = self._clock()

    def _watch(self) -> None:
        """Fail if a node's heartbeat is lost."""
        now = self._clock()
        for node, heard in self._heard.items():
            if now - heard > self._loss:
                self._fail(
                    f"The heartbeat of {self._named(node)} is lost, for {(now - heard) / 1e6:.0f} ms; look at its "
                    "power and cable.",
                    node,
                )

    def _heed_silence(self) -> None:
        """Fail where the drives have not heard from us for so long that they have stopped, or are about to."""
        silent = self._clock() - self._beaten
        if self._beat is None and silent > self._loss:
            beats = f"{MISSED_HEARTBEATS} heartbeats or more"
            self._fail(f"This computer was silent for {silent / 1e6:.0f} ms, {beats}; find out what delays it.")

    def _count_doubled(self) -> None:
        """Fail where every answer of a node comes twice, unlike an answer that is occasionally late."""
        for can_id, frame in self._frames.items():
            self._doubled[can_id] = self._doubled[can_id] + 1 if can_id in self._twice else 0
            if self._doubled[can_id] * self._period > self._loss:
                self._fail(
                    f"{self._named(frame.node)} has answered {self._doubled[can_id]} samples twice; look for a second "
                    "node of that id.",
                    frame.node,
                )
        self._twice.clear()

    def _count_missing(self) -> None:
        for can_id, frame in self._frames.items():
            if can_id not in self._waiting:
                self._missed[can_id] = 0
                continue
            self._missed[can_id] += 1
            # A problem of a received frame is more specific.
            known = self.problem
            self._note("missing", f"{self._named(frame.node)} has not answered a SYNC.")
            self.problem = known or self.problem
            if self._missed[can_id] * self._period > self._loss:
                name = self._named(frame.node)
                self._fail(
                    f"{name} has measured nothing for {self._missed[can_id]} samples. {self.problem}", frame.node
                )

    def _named(self, node: int) -> str:
        return f"{self._plan.nodes[node]} (node {node})"

    def _fail(self, sentence: str, node: int | None = None) -> NoReturn:
        """Stop all motors and raise; no heartbeat of ours follows, so that a drive that missed it stops by itself."""
        about: dict[str, Any] = {"key": "bus"} if node is None else {"key": "node", "value": node}
        self._failed = DeviceError(f"{sentence[0].upper()}{sentence[1:]} All motors are commanded to stop.", **about)
        self._end_beat()
        self._quick_stop()
        raise self._failed

    def _quick_stop(self) -> None:
        """Send every motor a stop, as far as the bus carries it."""
        self._stopping = True
        frames = [(drive.commanded_id, self._resting(drive, cia402.QUICK_STOP)) for drive in self._plan.drives]
        for can_id, data in (*frames, (_SYNC, b"")):
            try:
                self._can.send(can_id, data)
            except BusError as problem:
                self.problem = f"The stop was not sent: {problem}"

    def _stop(self) -> set[int]:
        """Quick-stop all drives, then switch their power off; return those that have not confirmed it."""
        self._quick_stop()
        powered = {drive.node for drive in self._plan.drives}
        limit = self._inst.drives
        rest_at = time.monotonic() + min(limit.motor_speed / limit.motor_acceleration, _STOPPING_TIME)
        period = min(max(self._period / 1e9, 2e-3), self._settings.heartbeat)
        while powered and (now := time.monotonic()) < rest_at + _STOPPING_TIME:
            with suppress(BusError):
                self._ask_to_rest(cia402.QUICK_STOP if now < rest_at else cia402.DISABLE_VOLTAGE)
            self._hear_states(now + period)
            if now >= rest_at:
                powered -= {node for node, state in self._states.items() if state == DriveState.SWITCH_ON_DISABLED}
        # A drive that lost our heartbeat ignores PDOs, but not SDOs.
        return powered - self._write_all(powered, 0x6040, 0, _WITHOUT_POWER)

    def _ask_to_rest(self, word: int) -> None:
        for drive in self._plan.drives:
            self._can.send(drive.commanded_id, self._resting(drive, word))
        # After a failure, silence is another way to stop them.
        if self._failed is None and self._beat is None:
            self._can.send(self._beat_id, _BEAT)
        self._states.clear()
        self._waiting = {drive.measured_id for drive in self._plan.drives}
        self._can.send(_SYNC, b"")

    def _hear_states(self, end: float) -> None:
        """Take the drives' answers until a time, however many frames there are, and none where the bus is broken."""
        while (self._paced or self._waiting) and (left := end - time.monotonic()) > 0:
            try:
                message = self._can.receive(left)
            except BusError:
                time.sleep(left)
                return
            if message is not None and message.arbitration_id in self._waiting:
                self._sort(message.arbitration_id, bytes(message.data))

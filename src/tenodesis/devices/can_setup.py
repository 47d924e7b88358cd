"""How the nodes of a CANopen bench are prepared and its drives enabled, before the first SYNC."""

import struct
import time
from collections.abc import Callable, Iterable
from math import inf, pi

from canopen import Network, ObjectDictionary, RemoteNode, SdoAbortedError
from canopen.sdo.exceptions import SdoError

from tenodesis.devices import cia402
from tenodesis.devices.can_layout import TORQUE_OBJECTS, DriveFrames, Layout
from tenodesis.errors import DeviceError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanOpen

MISSED_HEARTBEATS = 3
"""Heartbeats that may be missed before their node counts as lost, both ways."""

_ANSWER_TIME = 1.0  # s, of an SDO server
_STATE_TIME = 5.0  # s, of a drive's change of state
_MODE_TIME = 5.0  # s, of a drive's change of mode
_HOMING_TIME = 5.0  # s; nothing moves meanwhile
_RESET_TIME = 1.0  # s, of a drive that leaves its fault
_AT_ZERO = 0.01  # turns, by which a position may be beside zero once it was taken for it
_POLL = 2e-3  # s
_ON_EVERY_SYNC = 1
_INVALID = 0x8000_0000
_NO_REMOTE_REQUEST = 0x4000_0000
_NOT_THERE = (0x0602_0000, 0x0609_0011)
"""SDO abort codes of an object or sub-index that a node does not have."""
_OPERATIONAL, _PRE_OPERATIONAL = 1, 128  # NMT commands


class Setup:
    """Prepares nodes by SDO on a listening network; DeviceError is raised for what a node refuses."""

    def __init__(self, network: Network, inst: Instrument, settings: CanOpen, plan: Layout) -> None:
        self._network = network
        self._inst, self._settings, self._plan = inst, settings, plan
        self._nodes: dict[int, RemoteNode] = {}
        for number in plan.nodes:
            node = RemoteNode(number, ObjectDictionary())
            node.sdo.RESPONSE_TIMEOUT = _ANSWER_TIME
            network.add_node(node)
            self._nodes[number] = node
        self._name = {number: f"{name} (node {number})" for number, name in plan.nodes.items()}

    def prepare(self) -> None:
        """Find all nodes, take the drives' power away, and set what every node sends, heeds and does by itself."""
        for number in self._plan.nodes:
            self._network.send_message(0, bytes((_PRE_OPERATIONAL, number)))
        # Before anything else: no drive may turn on by an earlier command.
        for drive in self._plan.drives:
            kind = self._read(drive.node, 0x1000, 0, "I") & 0xFFFF
            if kind != 402:
                raise DeviceError(
                    f"{self._name[drive.node]} is no CiA 402 drive, its device profile is {kind}; it must be the node "
                    "id of a drive.",
                    key="node",
                    value=drive.node,
                    allowed="the node id of a drive",
                )
            self._write(drive.node, 0x6040, 0, "H", cia402.DISABLE_VOLTAGE)
        for number in self._plan.nodes:
            self._write(number, 0x1017, 0, "H", round(self._settings.heartbeat * 1e3))
        for drive in self._plan.drives:
            self._prepare_drive(drive)
        taken: set[int] = set()
        for frame in self._plan.sensors:
            number = (frame.cob_id - 0x180) >> 8
            cob_id = frame.cob_id | _NO_REMOTE_REQUEST
            self._map(frame.node, 0x1800 + number, 0x1A00 + number, cob_id, frame.objects)
            taken.add(frame.cob_id)
        for number in self._plan.nodes:
            self._silence(number, taken)

    def enable(self) -> dict[int, int]:
        """Lead all drives to operation enabled, at rest; from now on they heed our heartbeat.

        Returns the counts that each is at, by node.
        """
        positions = {}
        for number in self._plan.nodes:
            self._network.send_message(0, bytes((_OPERATIONAL, number)))
        for drive in self._plan.drives:
            if self._settings.zero == "here":
                self._home_here(drive)
            positions[drive.node] = self._read(drive.node, 0x6064, 0, "i")
            index = drive.commanded_objects[1][0]
            self._write(drive.node, index, 0, "i", positions[drive.node] if drive.aims else 0)
            mode = cia402.MODES[self._settings.mode]
            self._mode(drive, mode)
            self._lead(drive)
            # Some drives show the requested mode, and accept or reject it once they are enabled.
            self._mode_is(drive, mode)
        return positions

    def _prepare_drive(self, drive: DriveFrames) -> None:
        node, limit = drive.node, self._inst.drives
        lost = round(MISSED_HEARTBEATS * self._settings.heartbeat * 1e3)
        self._must_heed(node, 0x1016, 1, "I", self._settings.master << 16 | lost)
        self._must_heed(node, 0x6007, 0, "h", cia402.QUICK_STOP_ON_LOSS)
        hold = self._inst.control.safe_state != "neutral"
        self._must_heed(node, 0x605A, 0, "h", cia402.STOP_AND_HOLD if hold else cia402.STOP_AND_LET_GO)
        self._write(node, 0x605E, 0, "h", cia402.STOP_AND_LET_GO, needed=False)
        # The time between SYNCs, in microseconds, and in steps of 100 of them or of 1 ms.
        period = 1 / self._inst.sensors.sampling_rate
        exponent = -4 if period < 0.025 else -3
        self._write(node, 0x1006, 0, "I", round(period * 1e6), needed=False)
        self._write(node, 0x60C2, 1, "B", min(max(1, round(period * 10**-exponent)), 255), needed=False)
        self._write(node, 0x60C2, 2, "b", exponent, needed=False)
        acceleration = max(1, round(limit.motor_acceleration / self._plan.unit))
        # Ramps of the profile, of the quick stop, and the largest ones.
        for index in (0x6083, 0x6084, 0x6085, 0x60C5, 0x60C6):
            self._write(node, index, 0, "I", min(acceleration, 2**32 - 1), needed=False)
        self._write(node, 0x607F, 0, "I", max(1, round(limit.motor_speed / self._plan.unit)), needed=False)
        # Commands that do not come any more, though our heartbeat does, are to be an emergency.
        self._write(node, 0x1400, 5, "H", lost, needed=False)
        self._map(node, 0x1400, 0x1600, drive.commanded_id, drive.commanded_objects)
        if drive.torque_per_tension:
            # A rope that breaks lets the motor run: its speed has a limit, in turns a minute, in this mode, too.
            self._write(node, 0x6080, 0, "I", max(1, round(limit.motor_speed * 30 / pi)))
            self._map(node, 0x1401, 0x1601, drive.torque_id, TORQUE_OBJECTS)
        self._map(node, 0x1800, 0x1A00, drive.measured_id | _NO_REMOTE_REQUEST, drive.measured_objects)

    def _silence(self, node: int, taken: Iterable[int]) -> None:
        """Switch a node's other PDOs off: none may move a motor, or fill the bus."""
        pulls = {drive.torque_id for drive in self._plan.drives if drive.torque_per_tension}
        for number in range(1, 4):
            commanded, measured = (first + 0x100 * number + node for first in (0x200, 0x180))
            if commanded not in pulls:
                self._write(node, 0x1400 + number, 1, "I", _INVALID | commanded, needed=False)
            if measured not in taken:
                self._write(node, 0x1800 + number, 1, "I", _INVALID | measured, needed=False)

    def _map(
        self, node: int, communication: int, mapping: int, cob_id: int, objects: tuple[tuple[int, int, int], ...]
    ) -> None:
        self._write(node, communication, 1, "I", cob_id | _INVALID)
        self._write(node, communication, 2, "B", _ON_EVERY_SYNC)
        self._write(node, mapping, 0, "B", 0)
        for place, (index, sub, bits) in enumerate(objects, start=1):
            self._write(node, mapping, place, "I", index << 16 | sub << 8 | bits)
        self._write(node, mapping, 0, "B", len(objects))
        self._write(node, communication, 1, "I", cob_id)

    def _home_here(self, drive: DriveFrames) -> None:
        self._mode(drive, cia402.HOMING_MODE)
        today, older = cia402.HOME_HERE
        if not self._write(drive.node, 0x6098, 0, "b", today, needed=False):
            self._write(drive.node, 0x6098, 0, "b", older)
        self._write(drive.node, 0x607C, 0, "i", 0, needed=False)
        self._lead(drive)
        self._write(drive.node, 0x6040, 0, "H", cia402.START_HOMING)

        def attained() -> bool:
            status = self._status(drive)
            if status & cia402.HOMING_ERROR or cia402.state(status) != cia402.DriveState.OPERATION_ENABLED:
                raise DeviceError(
                    f"{self._name[drive.node]} cannot take its present position for zero; it needs "
                    'devices.canopen.zero = "keep", or a drive that has homing method 37 or 35.',
                    key="devices.canopen.zero",
                    value=self._settings.zero,
                    allowed='"keep"',
                )
            return bool(status & cia402.HOMING_ATTAINED)

        self._wait(attained, _HOMING_TIME, lambda: f"{self._name[drive.node]} did not end its homing")
        self._write(drive.node, 0x6040, 0, "H", cia402.SWITCH_ON)
        position = self._read(drive.node, 0x6064, 0, "i")
        if abs(position) > max(2.0, _AT_ZERO * self._inst.drives.encoder_counts):
            raise DeviceError(
                f"{self._name[drive.node]} reports its present position as zero, and is at {position} "
                'counts; it needs devices.canopen.zero = "keep", or a drive that homes.',
                key="devices.canopen.zero",
                value=position,
                allowed='"keep"',
            )

    def _mode(self, drive: DriveFrames, mode: int) -> None:
        self._write(drive.node, 0x6060, 0, "b", mode)
        self._mode_is(drive, mode)

    def _mode_is(self, drive: DriveFrames, mode: int) -> None:
        self._wait(
            lambda: self._read(drive.node, 0x6061, 0, "b") == mode,
            _MODE_TIME,
            lambda: f"{self._name[drive.node]} does not take mode {mode} (6060h); it must be a drive that has it",
        )

    def _lead(self, drive: DriveFrames) -> None:
        """Lead a drive, out of a fault too, but once only: a fault that returns is named."""
        reset_until = inf
        status = -1

        def enabled() -> bool:
            nonlocal reset_until, status
            before, status = status, self._status(drive)
            reached = cia402.state(status)
            if reached == cia402.DriveState.FAULT:
                if reset_until < inf:
                    if (
                        before >= 0
                        and cia402.state(before) == cia402.DriveState.FAULT
                        and time.monotonic() < reset_until
                    ):
                        return False
                    cause = cia402.Emergency(self._read(drive.node, 0x603F, 0, "H"))
                    raise DeviceError(
                        f"{self._name[drive.node]} is in fault {cause} and returns to it when reset; mend the cause, "
                        "then open the bench again.",
                        key="node",
                        value=drive.node,
                    )
                reset_until = time.monotonic() + _RESET_TIME
                self._write(drive.node, 0x6040, 0, "H", cia402.DISABLE_VOLTAGE)
            if reached in cia402.NEXT:
                self._write(drive.node, 0x6040, 0, "H", cia402.NEXT[reached])
            return reached == cia402.DriveState.OPERATION_ENABLED

        self._wait(
            enabled,
            _STATE_TIME,
            lambda: f"{self._name[drive.node]} stays in state {cia402.described(status)}; look at its enable input",
        )

    def _status(self, drive: DriveFrames) -> int:
        return self._read(drive.node, 0x6041, 0, "H")

    def _wait(self, done: Callable[[], bool], limit: float, problem: Callable[[], str]) -> None:
        until = time.monotonic() + limit
        while not done():
            if time.monotonic() > until:
                raise DeviceError(f"{problem()}.")
            time.sleep(_POLL)

    def _must_heed(self, node: int, index: int, sub: int, code: str, value: int) -> None:
        """Write an object that a drive's own watchdog depends on, and check that the drive keeps it."""
        try:
            self._write(node, index, sub, code, value)
        except DeviceError as problem:
            raise DeviceError(
                f"{problem} Without it the motor would not stop by itself once it has lost our heartbeat.",
                key=problem.key,
                value=problem.value,
                allowed=problem.allowed,
            ) from None
        kept = self._read(node, index, sub, code)
        if kept != value:
            raise DeviceError(
                f"{self._name[node]} keeps {kept} in object {index:04X}h, not {value}: it would not stop by itself "
                "without our heartbeat; it must be a drive that does.",
                key=f"{index:04X}h",
                value=kept,
                allowed=str(value),
            )

    def _write(self, node: int, index: int, sub: int, code: str, value: int, *, needed: bool = True) -> bool:
        try:
            self._nodes[node].sdo.download(index, sub, struct.pack("<" + code, value))
        except SdoAbortedError as refused:
            if not needed:
                return False
            why = "has no" if refused.code in _NOT_THERE else f"refuses {value} (SDO abort {refused.code:08X}h) in"
            raise DeviceError(
                f"{self._name[node]} {why} object {index:04X}h:{sub:02X}.", key=f"{index:04X}h:{sub:02X}", value=value
            ) from None
        except SdoError:
            raise self._silent(node) from None
        return True

    def _read(self, node: int, index: int, sub: int, code: str) -> int:
        try:
            raw = self._nodes[node].sdo.upload(index, sub)
            return int(struct.unpack("<" + code, raw)[0])
        except SdoAbortedError as refused:
            raise DeviceError(
                f"{self._name[node]} does not return object {index:04X}h:{sub:02X} (SDO abort {refused.code:08X}h).",
                key=f"{index:04X}h:{sub:02X}",
            ) from None
        except SdoError:
            raise self._silent(node) from None
        except struct.error:
            raise DeviceError(
                f"{self._name[node]} returns object {index:04X}h:{sub:02X} in {len(raw)} bytes; it must have "
                f"{struct.calcsize('<' + code)}.",
                key=f"{index:04X}h:{sub:02X}",
                value=raw,
            ) from None

    def _silent(self, node: int) -> DeviceError:
        heard = sorted(number for number in self._network.scanner.nodes if number != self._settings.master)
        others = f"nodes {', '.join(str(number) for number in heard)} are there" if heard else "no node is"
        return DeviceError(
            f"{self._name[node]} does not answer on {self._settings.interface} {self._settings.channel}, where "
            f"{others}; look at its node id, bit rate, power and cable.",
            key="node",
            value=node,
            allowed="a node that answers",
        )

"""Nodes on a CAN bus as CiA 301 and CiA 402 have them: a drive, and a module with sensors."""

import struct
import time
from collections.abc import Callable, Iterable

import canopen
from canopen import objectdictionary as od

from tenodesis.devices.cia402 import DriveState, wrapped

_RAMPS = (0x6083, 0x6084, 0x6085, 0x60C5, 0x60C6, 0x607F)
_DRIVE_OBJECTS: tuple[tuple[int, str, int, str], ...] = (
    (0x603F, "Error code", od.UNSIGNED16, "ro"),
    (0x6040, "Controlword", od.UNSIGNED16, "rw"),
    (0x6041, "Statusword", od.UNSIGNED16, "ro"),
    (0x6007, "Abort connection option code", od.INTEGER16, "rw"),
    (0x605A, "Quick stop option code", od.INTEGER16, "rw"),
    (0x605E, "Fault reaction option code", od.INTEGER16, "rw"),
    (0x6060, "Modes of operation", od.INTEGER8, "rw"),
    (0x6061, "Modes of operation display", od.INTEGER8, "ro"),
    (0x6064, "Position actual value", od.INTEGER32, "ro"),
    (0x607A, "Target position", od.INTEGER32, "rw"),
    (0x607C, "Home offset", od.INTEGER32, "rw"),
    (0x6098, "Homing method", od.INTEGER8, "rw"),
    (0x60FF, "Target velocity", od.INTEGER32, "rw"),
    (0x6071, "Target torque", od.INTEGER16, "rw"),
    (0x6080, "Max motor speed", od.UNSIGNED32, "rw"),
    *((index, f"Limit {index:04X}", od.UNSIGNED32, "rw") for index in _RAMPS),
)
_MODES = (3, 6, 8, 9)
_POSITION_GAIN = 20.0  # 1/s, of the drive's own loop beside the step of its target
_HOME_HERE = (35, 37)
_VALUE_OUT_OF_RANGE = 0x0609_0030
_HEARTBEAT_LOST, _PDO_LENGTH, _PDO_TIMEOUT = 0x8130, 0x8210, 0x8250
_PRE_OPERATIONAL = "PRE-OPERATIONAL"

NOT_READY, DISABLED, READY = DriveState.NOT_READY, DriveState.SWITCH_ON_DISABLED, DriveState.READY
SWITCHED_ON, ENABLED, QUICK_STOP, FAULT = (
    DriveState.SWITCHED_ON,
    DriveState.OPERATION_ENABLED,
    DriveState.QUICK_STOP_ACTIVE,
    DriveState.FAULT,
)
_STATUS = {
    NOT_READY: 0x00,
    DISABLED: 0x40,
    READY: 0x21,
    SWITCHED_ON: 0x23,
    ENABLED: 0x27,
    QUICK_STOP: 0x07,
    FAULT: 0x08,
}


class Node:
    """A node with PDOs on SYNC and a heartbeat of its own, timed by the clock (ns).

    The device type is object 1000h; `objects` are index, sub-index and type (of the canopen library) of what else it
    has.
    """

    def __init__(
        self,
        number: int,
        device_type: int,
        network: canopen.Network,
        clock: Callable[[], int],
        objects: Iterable[tuple[int, int, int]] = (),
    ) -> None:
        self.number = number
        self._clock = clock
        self._network = network
        self._next_beat: int | None = None
        self.cut_off = False
        """Whether its cable is pulled: it neither sends nor hears."""
        self.local = canopen.LocalNode(number, self._dictionary(device_type, objects))
        network.add_node(self.local)
        self.local.add_write_callback(self._written)
        self.local.nmt.state = _PRE_OPERATIONAL

    def _dictionary(self, device_type: int, objects: Iterable[tuple[int, int, int]]) -> od.ObjectDictionary:
        made = od.ObjectDictionary()
        _add(made, 0x1000, "Device type", od.UNSIGNED32, device_type, access="ro")
        _add(made, 0x1001, "Error register", od.UNSIGNED8, access="ro")
        _add_record(made, 0x1016, "Consumer heartbeat time", [(1, od.UNSIGNED32, 0)])
        _add(made, 0x1017, "Producer heartbeat time", od.UNSIGNED16)
        for n in range(4):
            for base, first in ((0x1400, 0x200), (0x1800, 0x180)):
                cob_id = 0x8000_0000 | (first + 0x100 * n + self.number)
                communication = [(1, od.UNSIGNED32, cob_id), (2, od.UNSIGNED8, 1), (5, od.UNSIGNED16, 0)]
                _add_record(made, base + n, f"PDO {base + n:04X}", communication)
                mapping = [(sub, od.UNSIGNED32, 0) for sub in range(1, 9)]
                _add_record(made, base + 0x200 + n, f"PDO {base + 0x200 + n:04X}", mapping, writable_count=True)
        by_index: dict[int, list[tuple[int, int, int]]] = {}
        for index, sub, kind in objects:
            by_index.setdefault(index, []).append((sub, kind, 0))
        for index, subs in by_index.items():
            if subs[0][0] == 0:
                _add(made, index, f"Object {index:04X}", subs[0][1])
            else:
                _add_record(made, index, f"Object {index:04X}", subs)
        return made

    @property
    def operational(self) -> bool:
        """Whether it takes part in PDOs."""
        return self.local.nmt.state == "OPERATIONAL" and not self.cut_off

    def set(self, index: int, sub: int, raw: float) -> None:
        """Set an object, clipped to what its type holds."""
        variable = self.local.object_dictionary.get_variable(index, sub)
        assert variable is not None
        if variable.data_type in od.INTEGER_TYPES:
            half = 2 ** (len(variable) - 1)
            least = -half if variable.data_type in od.SIGNED_TYPES else 0
            raw = min(max(round(raw), least), least + 2 * half - 1)
        self.local.data_store.setdefault(index, {})[sub] = variable.encode_raw(raw)

    def get(self, index: int, sub: int = 0) -> int:
        """Return an integer object."""
        variable = self.local.object_dictionary.get_variable(index, sub)
        assert variable is not None
        return int(variable.decode_raw(self.local.get_data(index, sub)))

    def started(self) -> None:
        """Take the PDOs as they are mapped, once commanded to be operational."""
        self.local.tpdo.read()
        self.local.rpdo.read()

    def send_pdos(self) -> None:
        """Send what is mapped to PDOs on SYNC."""
        for pdo in self.local.tpdo.values():
            if pdo.enabled:
                pdo.data = bytearray(b"".join(self.local.get_data(one.index, one.subindex) for one in pdo.map))
                pdo.transmit()

    def poll(self) -> None:
        """Do what is due at this time: the heartbeat."""
        if self._next_beat is None or self.cut_off:
            return
        now = self._clock()
        if now >= self._next_beat:
            states = {"OPERATIONAL": 5, "STOPPED": 4}
            self._network.send_message(0x700 + self.number, bytes((states.get(self.local.nmt.state, 127),)))
            self._next_beat = now + self.get(0x1017) * 1_000_000

    def _written(self, index: int, subindex: int, od: object, data: bytes) -> None:
        if index == 0x1017:
            (time,) = struct.unpack("<H", data)
            self._next_beat = self._clock() if time else None


class Drive(Node):
    """A CiA 402 drive: states, modes, homing, its watch over the master, and emergencies.

    `counter` is index and sub-index of a u16 that counts its measurements, `position` the counts that its encoder shows
    at the start; `objects` are as of :class:`Node`.
    """

    def __init__(
        self,
        number: int,
        network: canopen.Network,
        clock: Callable[[], int],
        *,
        counter: tuple[int, int] | None = None,
        position: int = 0,
        objects: Iterable[tuple[int, int, int]] = (),
    ) -> None:
        own = [(index, 0, kind) for index, _, kind, _ in _DRIVE_OBJECTS]
        extra = [] if counter is None else [(*counter, od.UNSIGNED16)]
        super().__init__(number, 0x0002_0192, network, clock, [*own, *extra, *objects])
        for index, name, _, access in _DRIVE_OBJECTS:
            variable = self.local.object_dictionary[index]
            assert isinstance(variable, od.ODVariable)
            variable.access_type, variable.name = access, name
        self.counter = counter
        self.state: DriveState = DISABLED
        self.target = 0
        """Target velocity in force."""
        self._aim = self._aim_step = 0  # target position, and by how much it went on with the last SYNC
        self.torque = 0
        """Target torque, in thousandths of the rated one; in force in mode 10."""
        self._start = position
        self._turned = 0
        self._offset = 0
        self._heard: int | None = None
        self._listens_to = 0
        self._control = 0
        self._commanded: int | None = None
        self._leaves_fault_at: float | None = None
        self.fault_stays = False
        """Whether a fault cannot be reset."""
        self.reset_time = 0.0
        """What it takes to leave a fault, s."""
        self.resumes = False
        """Whether it may be enabled again from a quick stop, as CiA 402 allows but does not recommend."""
        self.stays_operational = False
        """Whether it goes on taking PDOs once it has lost the master, as object 1029h may set it."""
        self.shows_mode = True
        """Whether it takes the modes that are set."""
        self.homing_methods: tuple[int, ...] = _HOME_HERE
        self.homes = True
        """Whether homing that it reports as attained has set its zero."""
        self.log: list[str] = []
        """States it has been in, and why it left operation enabled."""
        self._show()

    def pursuit(self, rate: float) -> float:
        """Speed at which a drive follows target positions that come at a rate (Hz), counts/s."""
        if not (self.state == ENABLED and self.operational and self.get(0x6061) == 8):
            return 0.0
        behind = wrapped(self._aim - self._aim_step - self.get(0x6064))
        return self._aim_step * rate + _POSITION_GAIN * behind

    @property
    def velocity(self) -> int:
        """Speed of the motor, in units of the target velocity."""
        return self.target if self.state == ENABLED and self.operational and self.get(0x6061) in (3, 9) else 0

    @property
    def pull(self) -> int:
        """Torque in force, in thousandths of the rated one."""
        return self.torque if self.state == ENABLED and self.operational and self.get(0x6061) == 10 else 0

    def started(self) -> None:
        """Take the PDOs as they are mapped."""
        super().started()
        for pdo in self.local.rpdo.values():
            if pdo.enabled:
                pdo.data = bytearray()

    def measure(self, turned: int) -> None:
        """Set what it measures: counts turned since the start."""
        self._turned = turned
        self.set(0x6064, 0, wrapped(self._start + turned - self._offset))
        if self.counter is not None:
            self.set(*self.counter, (self.get(*self.counter) + 1) % 2**16)

    def act(self) -> None:
        """Heed the commands that came since the last SYNC."""
        aimed = False
        for pdo in self.local.rpdo.values():
            if not (pdo.enabled and pdo.data):
                continue
            self._commanded = self._clock()
            if len(pdo.data) != pdo.length // 8:
                self.emergency(_PDO_LENGTH)
            else:
                values = {one.index: one.od.decode_raw(bytes(one.get_data())) for one in pdo.map}
                if 0x60FF in values:
                    self.target = values[0x60FF]
                if 0x607A in values:
                    self._aim_step, self._aim = wrapped(values[0x607A] - self._aim), values[0x607A]
                    aimed = True
                if 0x6071 in values:
                    self.set(0x6061, 0, values[0x6060])
                    self.torque = values[0x6071]
                if 0x6040 in values:
                    self._obey(values[0x6040])
            pdo.data = bytearray()
        if not aimed:
            self._aim_step = 0

    def fault(self, code: int) -> None:
        """Fall into fault, with an emergency."""
        self.set(0x603F, 0, code)
        self._become(FAULT, f"fault {code:04X}")
        self.emergency(code)

    def emergency(self, code: int) -> None:
        """Send an emergency."""
        self.local.emcy.send(code, 1)

    def poll(self) -> None:
        """Send the heartbeat, and see whether the master's or its commands have been lost."""
        super().poll()
        if self._leaves_fault_at is not None and time.monotonic() > self._leaves_fault_at:
            self._leave_fault()
        entry = self.get(0x1016, 1)
        master, milliseconds = entry >> 16 & 0x7F, entry & 0xFFFF
        if master != self._listens_to:
            self._listens_to = master
            self._heard = None
            if master:
                self._network.subscribe(0x700 + master, self._hear)
        if milliseconds and self._heard is not None and self._clock() - self._heard > milliseconds * 1_000_000:
            self._heard = None
            self._lose_master()
        if self._commanded is not None:
            self._miss_commands(self._commanded)

    def _miss_commands(self, since: int) -> None:
        deadline = self.get(0x1400, 5)
        if self.state != ENABLED or not self.operational:
            self._commanded = None
        elif deadline and self._clock() - since > deadline * 1_000_000:
            self._commanded = None
            self.emergency(_PDO_TIMEOUT)

    def _hear(self, can_id: int, data: bytearray, timestamp: float) -> None:
        if not self.cut_off and can_id == 0x700 + self._listens_to:
            self._heard = self._clock()

    def _lose_master(self) -> None:
        self.emergency(_HEARTBEAT_LOST)
        if self.state == ENABLED:
            option = self.get(0x6007)
            if option == 3:
                self._quick_stop("heartbeat lost")
            elif option == 2:
                self._become(DISABLED, "heartbeat lost")
            elif option == 1:
                self.fault(_HEARTBEAT_LOST)
        if not self.stays_operational:
            self.local.nmt.state = _PRE_OPERATIONAL

    def _quick_stop(self, why: str) -> None:
        self.target = 0
        self._become(QUICK_STOP if self.get(0x605A) in (5, 6) else DISABLED, why)

    def _written(self, index: int, subindex: int, od: object, data: bytes) -> None:
        super()._written(index, subindex, od, data)
        if index == 0x6040:
            self._obey(int.from_bytes(data, "little"))
        elif index == 0x60FF:
            self.target = int.from_bytes(data, "little", signed=True)
        elif index == 0x607A:
            self._aim, self._aim_step = int.from_bytes(data, "little", signed=True), 0
        elif index == 0x6060:
            (mode,) = struct.unpack("<b", data)
            if mode not in _MODES:
                raise canopen.SdoAbortedError(_VALUE_OUT_OF_RANGE)
            if self.shows_mode:
                self.set(0x6061, 0, mode)
        elif index == 0x6098 and int.from_bytes(data, "little", signed=True) not in self.homing_methods:
            raise canopen.SdoAbortedError(_VALUE_OUT_OF_RANGE)

    def _obey(self, word: int) -> None:
        rising = word & ~self._control
        self._control = word
        if self.state != FAULT:
            self._go(word)
        elif rising & 0x80:
            self._reset()
        if self.state == ENABLED and self.get(0x6061) == 6 and rising & 0x10:
            if self.homes:
                self._offset = self._start + self._turned - self.get(0x607C)
                self.measure(self._turned)
            self.set(0x6041, 0, self.get(0x6041) | 1 << 12)

    def _go(self, word: int) -> None:
        """Take the state that a controlword leads to."""
        if not word & 0x02:
            self._become(DISABLED)
        elif not word & 0x04:
            if self.state == ENABLED:
                self._quick_stop("quick stop")
            elif self.state != QUICK_STOP:
                self._become(DISABLED)
        elif self.state == QUICK_STOP:
            if self.resumes and word & 0x0F == 0x0F:
                self._become(ENABLED)
        elif not word & 0x01:
            self._become(READY)
        elif not word & 0x08:
            if self.state != DISABLED:
                self._become(SWITCHED_ON)
        elif self.state in (SWITCHED_ON, ENABLED):
            self._become(ENABLED)

    def _reset(self) -> None:
        if self.reset_time:
            self._leaves_fault_at = time.monotonic() + self.reset_time
        elif not self.fault_stays:
            self._leave_fault()

    def _leave_fault(self) -> None:
        self._leaves_fault_at = None
        self.set(0x603F, 0, 0)
        self._become(DISABLED)

    def _become(self, state: DriveState, why: str = "") -> None:
        if state != self.state:
            self.state = state
            self.log.append(f"{state}: {why}" if why else state)
        if state != ENABLED:
            self.target = 0
        self._show()

    def _show(self) -> None:
        powered = self.state in (READY, SWITCHED_ON, ENABLED, QUICK_STOP)
        self.set(0x6041, 0, _STATUS[self.state] | 0x0200 | (0x10 if powered else 0))


def _add(made: od.ObjectDictionary, index: int, name: str, kind: int, value: int = 0, *, access: str = "rw") -> None:
    variable = od.ODVariable(name, index)
    variable.data_type, variable.access_type, variable.default = kind, access, value
    made.add_object(variable)


def _add_record(
    made: od.ObjectDictionary, index: int, name: str, subs: list[tuple[int, int, int]], *, writable_count: bool = False
) -> None:
    record = od.ODRecord(name, index)
    count = 0 if writable_count else max(sub for sub, _, _ in subs)
    for sub, kind, value in [(0, od.UNSIGNED8, count), *subs]:
        variable = od.ODVariable(f"{name} {sub}", index, sub)
        variable.data_type, variable.default = kind, value
        variable.access_type = "rw" if sub or writable_count else "ro"
        record.add_member(variable)
    made.add_object(record)

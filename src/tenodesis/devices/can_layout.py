"""What the frames on the CAN bus carry, from an instrument and its table devices.canopen."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, inf, isfinite, nan, pi

from tenodesis.devices import cia402
from tenodesis.devices.cia402 import wrapped
from tenodesis.devices.wiring import Plug, Wiring, wiring
from tenodesis.errors import InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanAngle, CanDrive, CanOpen, CanTension

_CODES = {"i8": "b", "u8": "B", "i16": "h", "u16": "H", "i32": "i", "u32": "I", "f32": "f"}
_MOST_PDOS = 4  # of the predefined connection set
_PDO_BYTES = 8
_MOST_LOAD = 0.9
_LEAST_UNITS, _MOST_UNITS = 10, 2**31 - 1  # of target velocity, in the motor's speed
_STATUS_AND_POSITION = "<Hi"
_CONTROL_AND_TARGET = struct.Struct("<Hi")
TORQUE_OBJECTS = ((0x6060, 0, 8), (0x6071, 0, 16))
"""Mode of operation and target torque, of a drive that may hold a tension."""
_MEASURED_OBJECTS = ((0x6041, 0, 16), (0x6064, 0, 32))
LEAD = 0.05
"""Largest lag of a motor, as time at full speed, s; a blocked motor must not jump when it is released."""
_TARGET_VELOCITY, _TARGET_POSITION = 0x60FF, 0x607A
_MODE_AND_TORQUE = struct.Struct("<bh")
_MOST_TORQUE = 1000
"""Largest target torque, in thousandths of the rated one."""
_TORQUE, _CURRENT = 0x6077, 0x6078
"""Actual values of a drive, in thousandths of its rated ones."""


@dataclass(frozen=True)
class Sensor:
    """A sensor's place in a frame and in a measurement."""

    place: int
    """As of :class:`tenodesis.devices.wiring.Plug`."""
    name: str
    gain: float
    offset: float
    ends: tuple[int, int] | None
    """Integers at which it is saturated."""

    def value(self, raw: float) -> float:
        """Return the sensor's value in SI units; NaN where it is at the end of its range or has none."""
        if self.ends is not None and raw in self.ends:
            return nan
        value = self.gain * raw + self.offset
        return value if isfinite(value) else nan


@dataclass(frozen=True)
class SensorFrame:
    """A PDO by which a node sends the values of its sensors."""

    node: int
    name: str
    cob_id: int
    objects: tuple[tuple[int, int, int], ...]
    """Index, sub-index and bits of what is mapped."""
    format: struct.Struct
    sensors: tuple[Sensor, ...]


@dataclass(frozen=True)
class DriveFrames:
    """The PDOs of a drive."""

    node: int
    name: str
    spool: int
    """Number of its tendon."""
    measured_id: int
    measured_objects: tuple[tuple[int, int, int], ...]
    measured: struct.Struct
    """Statusword, position and, if the drive has it, the counter."""
    commanded_id: int
    commanded_objects: tuple[tuple[int, int, int], ...]
    angle_per_count: float
    """Of the spool, rad; negative where positive turns unwind."""
    speed_per_unit: float
    """Of the spool, rad/s; negative where positive turns unwind."""
    most_units: int
    """Largest target velocity that is within the motor's speed."""
    torque_per_tension: float = 0.0
    """Thousandths of the rated torque by a newton; negative where positive turns unwind, 0 where it holds none."""

    @property
    def torque_id(self) -> int:
        """Of the PDO with mode and target torque."""
        return 0x300 + self.node

    def pull(self, tension: float, mode: int) -> bytes:
        """Return the frame that has it hold a tension, N; at 0 it is in a mode in which it follows speeds."""
        torque = min(max(round(tension * self.torque_per_tension), -_MOST_TORQUE), _MOST_TORQUE)
        return _MODE_AND_TORQUE.pack(cia402.TORQUE_MODE if tension > 0 else mode, torque)

    @property
    def aims(self) -> bool:
        """Whether its target is a position rather than a velocity."""
        return self.commanded_objects[1][0] == _TARGET_POSITION

    def velocity(self, spool_velocity: float) -> int:
        """Return the target velocity of a speed."""
        units = round(spool_velocity / self.speed_per_unit)
        return min(max(units, -self.most_units), self.most_units)

    def command(self, controlword: int, target: int) -> bytes:
        """Return the frame of a command."""
        return _CONTROL_AND_TARGET.pack(controlword, target)


class Aim:
    """A target position, in counts without an end, that goes on with every command, after a period (s)."""

    def __init__(self, drive: DriveFrames, position: int, period: float) -> None:
        self._drive, self._period = drive, period
        self._counts = float(position)

    @property
    def target(self) -> int:
        """Where it is to be at the next SYNC, as the drive counts."""
        return wrapped(round(self._counts))

    def go_on(self, spool_velocity: float, turned: int | None) -> int:
        """Return the target a tick further on, by a finite speed (rad/s) within the limit.

        `turned` is where the motor is, counted on without an end; None where it is not known yet.
        """
        drive = self._drive
        self._counts += spool_velocity * self._period / drive.angle_per_count
        if turned is not None:
            lead = abs(drive.most_units * drive.speed_per_unit / drive.angle_per_count) * LEAD
            self._counts = min(max(self._counts, turned - lead), turned + lead)
        return self.target


@dataclass(frozen=True)
class Layout:
    """All frames of a bench."""

    wiring: Wiring
    drives: tuple[DriveFrames, ...]
    sensors: tuple[SensorFrame, ...]
    speed_limit: float
    """Of a spool, rad/s."""
    unit: float
    """Motor speed that 1 of a target velocity stands for, rad/s."""
    load: float
    """Share of the bus that the frames take up; NaN where its bit rate is unknown."""

    @property
    def nodes(self) -> dict[int, str]:
        """Names of the nodes, by id, drives first."""
        named = {drive.node: drive.name for drive in self.drives}
        for frame in self.sensors:
            named.setdefault(frame.node, frame.name)
        return named


def layout(inst: Instrument, settings: CanOpen) -> Layout:
    """Return the frames by which an instrument's bench is served.

    Raises InstrumentError if an axis is missing, two sensors are one, a node has more sensors than its PDOs carry, the
    heartbeat is faster than the samples, the unit of velocity is too coarse or too fine, or the bus is too slow.
    """
    wired = wired_by(inst, settings)
    unit = settings.velocity_unit or 2 * pi / inst.drives.encoder_counts
    drives = tuple(_drive(inst, settings, plug, unit) for plug in wired.drives)
    sensors = tuple(_sensor_frames(wired.sensors, {drive.node for drive in drives}))
    speed = inst.drives.motor_speed
    if not _LEAST_UNITS <= speed / unit <= _MOST_UNITS:
        raise InstrumentError(
            f"devices.canopen.velocity_unit is {unit:g} rad/s, of which drives.motor_speed, {speed:g} rad/s, makes "
            f"{speed / unit:.3g}; it must make {_LEAST_UNITS} to {_MOST_UNITS} of them.",
            key="devices.canopen.velocity_unit",
            value=unit,
        )
    period = 1 / inst.sensors.sampling_rate
    if period > settings.heartbeat * (1 + 1e-9):
        raise InstrumentError(
            key="devices.canopen.heartbeat",
            value=settings.heartbeat,
            allowed=f"a sampling period, {period:g} s, or more",
        )
    load = _load(inst, settings, drives, sensors)
    if load > _MOST_LOAD:
        raise InstrumentError(
            f"sensors.sampling_rate is {inst.sensors.sampling_rate:g} Hz, at which {len(drives)} drives and their "
            f"sensors take {load:.0%} of a bus of {settings.bitrate} bit/s; it must be at most "
            f"{inst.sensors.sampling_rate * _MOST_LOAD / load:.0f} Hz, or the bus faster.",
            key="sensors.sampling_rate",
            value=inst.sensors.sampling_rate,
        )
    return Layout(wired, drives, sensors, speed / inst.drives.gear_ratio, unit, load)


def wired_by(inst: Instrument, settings: CanOpen) -> Wiring:
    """Return how the bench of an instrument is wired; where its drives' currents measure the tensions, by these."""
    of_torque = settings.rated_torque is not None
    # The file has been checked for either, and for the torque constant.
    rated = (settings.rated_torque if of_torque else settings.rated_current) or 0.0
    per_unit = rated / 1000 / ((inst.drives.torque_constant or 1.0) if of_torque else 1.0)

    def current_of(drive: CanDrive, per_current: float) -> CanTension:
        gain = per_unit * per_current
        code = _TORQUE if of_torque else _CURRENT
        return CanTension(node=drive.node, object=code, gain=-gain if drive.reversed else gain)

    return wiring(inst, settings, "canopen", current_of)


def _drive(inst: Instrument, settings: CanOpen, plug: Plug, unit: float) -> DriveFrames:
    drive: CanDrive = plug.part
    counter = settings.counter
    objects = _MEASURED_OBJECTS if counter is None else (*_MEASURED_OBJECTS, (counter.object, counter.sub, 16))
    turn = (-1 if drive.reversed else 1) / inst.drives.gear_ratio
    return DriveFrames(
        drive.node,
        plug.name,
        plug.place,
        0x180 + drive.node,
        objects,
        struct.Struct(_STATUS_AND_POSITION + ("" if counter is None else "H")),
        0x200 + drive.node,
        ((0x6040, 0, 16), (_TARGET_POSITION if settings.mode == "cyclic-position" else _TARGET_VELOCITY, 0, 32)),
        turn * 2 * pi / inst.drives.encoder_counts,
        turn * unit,
        floor(inst.drives.motor_speed / unit * (1 + 1e-12)),
        _torque_per_tension(inst, settings) * (-1 if drive.reversed else 1) if settings.tension_drives else 0.0,
    )


def _torque_per_tension(inst: Instrument, settings: CanOpen) -> float:
    drives = inst.own_drives
    per_newton = drives.spool_radius / drives.gear_ratio / drives.gear_efficiency
    return 1000 * per_newton / (settings.rated_torque or inf)


def _sensor_frames(sensors: Sequence[Plug], drives: set[int]) -> list[SensorFrame]:
    by_node: dict[int, list[Plug]] = {}
    taken_by: dict[tuple[int, int, int], str] = {}
    for plug in sensors:
        source: CanAngle | CanTension = plug.part
        place, name = (source.node, source.object, source.sub), f"the {plug.name} of {plug.of}"
        if taken_by.setdefault(place, name) != name:
            raise InstrumentError(
                f"devices.canopen: {name} is read from node {place[0]}, object {place[1]:04X}h:{place[2]:02X}, as "
                f"{taken_by[place]} is; each must have an object of its own.",
                key="devices.canopen",
                value=place,
                allowed="an object of its own",
            )
        by_node.setdefault(source.node, []).append(plug)
    frames = []
    for node, plugs in by_node.items():
        packed: list[list[Plug]] = [[]]
        for one in plugs:
            taken = sum(_size(plug.part) for plug in packed[-1])
            if taken + _size(one.part) > _PDO_BYTES:
                packed.append([])
            packed[-1].append(one)
        first = 2 if node in drives else 1  # a drive's first PDO is taken
        if first + len(packed) - 1 > _MOST_PDOS:
            raise InstrumentError(
                f"devices.canopen: node {node} has {len(plugs)} sensors; they must fit into "
                f"{_MOST_PDOS + 1 - first} PDOs of {_PDO_BYTES} bytes.",
                key="devices.canopen",
                value=node,
            )
        served = " and ".join(dict.fromkeys(plug.of for plug in plugs))
        frames += [
            _sensor_frame(node, f"the sensor node of {served}", number, held)
            for number, held in enumerate(packed, start=first)
        ]
    return frames


def _sensor_frame(node: int, name: str, number: int, held: Sequence[Plug]) -> SensorFrame:
    return SensorFrame(
        node,
        name,
        0x80 + 0x100 * number + node,
        tuple((plug.part.object, plug.part.sub, 8 * _size(plug.part)) for plug in held),
        struct.Struct("<" + "".join(_CODES[plug.part.type] for plug in held)),
        tuple(
            Sensor(plug.place, plug.name, plug.part.gain, plug.part.offset, integer_range(plug.part.type))
            for plug in held
        ),
    )


def integer_range(kind: str) -> tuple[int, int] | None:
    """Return the least and the largest number of a type; None if the type is no integer."""
    if kind == "f32":
        return None
    bits = int(kind[1:])
    return (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if kind[0] == "i" else (0, 2**bits - 1)


def _size(source: CanAngle | CanTension) -> int:
    return int(source.type[1:]) // 8


def _load(
    inst: Instrument, settings: CanOpen, drives: tuple[DriveFrames, ...], sensors: tuple[SensorFrame, ...]
) -> float:
    if settings.bitrate is None:
        return nan
    cyclic = _bits(0) + sum(_bits(drive.measured.size) + _bits(_CONTROL_AND_TARGET.size) for drive in drives)
    cyclic += sum(_bits(frame.format.size) for frame in sensors)
    cyclic += sum(_bits(_MODE_AND_TORQUE.size) for drive in drives if drive.torque_per_tension)
    nodes = {drive.node for drive in drives} | {frame.node for frame in sensors}
    heartbeats = (1 + len(nodes)) * _bits(1) / settings.heartbeat
    return (cyclic * inst.sensors.sampling_rate + heartbeats) / settings.bitrate


def _bits(size: int) -> int:
    """Return the most bits that a frame of `size` bytes takes, with stuffing and the gap to the next.

    Source: R. I. Davis, A. Burns, R. J. Bril and J. J. Lukkien, Controller Area Network (CAN) schedulability
    analysis: refuted, revisited and revised, Real-Time Systems 35, 2007.
    """
    return 34 + 8 * size + 13 + floor((34 + 8 * size - 1) / 4)

"""Table devices of an instrument file: wiring and calibration of the devices of its bench."""

import math
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, Any, Generic, Literal, Self, TypeAlias, TypeVar

from pydantic import Field, model_validator

from tenodesis.errors import ArgumentError
from tenodesis.toml import FileTable
from tenodesis.units import (
    Angle,
    AnglePerCount,
    AnglePerVolt,
    Current,
    CurrentPerVolt,
    Moment,
    MotorSpeed,
    SignedCurrent,
    SignedForce,
    SignedVoltage,
    SpeedPerVolt,
    TensionPerCount,
    TensionPerVolt,
    Time,
    Voltage,
)

Channel = Annotated[str, Field(min_length=1, max_length=100)]

NodeId = Annotated[int, Field(ge=1, le=127, strict=True)]
ObjectIndex = Annotated[int, Field(ge=0x1000, le=0xFFFF, strict=True)]
SubIndex = Annotated[int, Field(ge=0, le=255, strict=True)]
Drive = TypeVar("Drive", bound=FileTable)
AngleSensor = TypeVar("AngleSensor", bound=FileTable)
LoadCell = TypeVar("LoadCell", bound=FileTable)
CanType: TypeAlias = Literal["i8", "u8", "i16", "u16", "i32", "u32", "f32"]
_TENDONS = "Drive and load cell of each tendon, by its name, where the file lists joints and tendons"
_HANDLE_JOINTS = "Encoder of each joint of the handle, by its name, likewise"
_JOINTS = "Distal encoders of joints at the tip, by their names, likewise"
CanMode: TypeAlias = Literal["cyclic-velocity", "profile-velocity", "cyclic-position"]


class Axis(FileTable, Generic[Drive, AngleSensor, LoadCell]):
    """The drives and sensors of one bending axis."""

    agonist: Drive = Field(description="Drive of the agonist tendon")
    antagonist: Drive = Field(description="Drive of the antagonist tendon")
    handle_angle: AngleSensor = Field(description="Encoder of the handle")
    agonist_tension: LoadCell | None = Field(default=None, description="Load cell of the agonist tendon, if any")
    antagonist_tension: LoadCell | None = Field(default=None, description="Load cell of the antagonist tendon, if any")
    output_angle: AngleSensor | None = Field(default=None, description="Distal encoder, as a bench may have")

    @property
    def drives(self) -> tuple[Drive, Drive]:
        """Drives of agonist and antagonist."""
        return self.agonist, self.antagonist

    @property
    def sources(self) -> dict[str, AngleSensor | LoadCell]:
        """The sensors that are there, by what they measure, in the order of a measurement's row."""
        named = {
            "handle angle": self.handle_angle,
            "agonist tension": self.agonist_tension,
            "antagonist tension": self.antagonist_tension,
            "output angle": self.output_angle,
        }
        return {name: source for name, source in named.items() if source is not None}


class CanSource(FileTable):
    """The object of a node that contains a sensor's reading and can be mapped to its PDOs."""

    node: NodeId = Field(description="Node that has the sensor: a drive, or a CiA 401 or 404 module")
    object: ObjectIndex = Field(description="Index of the object, such as 0x6401")
    sub: SubIndex = Field(default=0, description="Its sub-index")
    type: CanType = Field(default="i16", description="Its type; the ends of an integer's range count as saturated")


class CanAngle(CanSource):
    """An angle's sensor."""

    gain: AnglePerCount = Field(description="Angle per count, or per 1 of f32")
    offset: Angle = Field(default=0.0, description="Angle at count 0")


class CanTension(CanSource):
    """A load cell."""

    gain: TensionPerCount = Field(description="Tension per count, or per 1 of f32")
    offset: SignedForce = Field(default=0.0, description="Tension at count 0")


class CanDrive(FileTable):
    """A CiA 402 drive; counts per turn, gear ratio and limits are those of the table drives."""

    node: NodeId = Field(description="Its node id")
    reversed: bool = Field(default=False, strict=True, description="Whether positive turns unwind")


class CanAxis(Axis[CanDrive, CanAngle, CanTension]):
    """The sensors and drives of one bending axis on the CAN bus."""


class CanTendon(CanDrive):
    """The drive of a tendon, and its load cell."""

    tension: CanTension | None = Field(default=None, description="Its load cell, if any")


class CanCounter(FileTable):
    """An object of each drive, u16, that counts its measurements; while it is constant, readings are old."""

    object: ObjectIndex = Field(description="Index of the object")
    sub: SubIndex = Field(default=0, description="Its sub-index")


class CanOpen(FileTable):
    """A CAN bus with a CiA 402 drive per tendon; SYNC comes once per sampling period of the table sensors."""

    interface: str = Field(default="socketcan", description="Interface, by its name in python-can")
    channel: str = Field(default="can0", description="Channel of that interface")
    bitrate: int | None = Field(
        default=None, ge=10_000, le=8_000_000, strict=True, description="Bits per second, if it is not set elsewhere"
    )
    options: dict[str, str | int | float | bool] = Field(default={}, description="Further options of the interface")
    mode: CanMode = Field(
        default="cyclic-velocity",
        description="Mode of the drives: cyclic-velocity, profile-velocity or cyclic-position",
    )
    velocity_unit: MotorSpeed | None = Field(
        default=None, description="Motor speed per unit of target velocity; by default one count per second"
    )
    zero: Literal["keep", "here"] = Field(
        default="keep", description="Zero of the positions: that of the drives, or the position at opening"
    )
    rated_current: Current | None = Field(
        default=None, description="Object 6075h of the drives, of which 6078h gives thousandths, for currents"
    )
    rated_torque: Moment | None = Field(
        default=None, description="Instead: object 6076h, of which 6077h gives thousandths"
    )
    tension_drives: bool = Field(
        default=False,
        description="Whether drives may hold tensions, by torque (mode 10, objects 6060h and 6071h in a second PDO); "
        "takes rated_torque and the mode cyclic-velocity",
    )
    counter: CanCounter | None = Field(default=None, description="Counter of a drive's measurements")
    master: NodeId = Field(default=127, description="Node id of this computer")
    heartbeat: Annotated[Time, Field(ge=1e-3, le=1.0)] = Field(
        default=0.01, description="Time between heartbeats, both ways; three of them missed are a loss"
    )
    yaw: CanAxis | None = Field(default=None, description="Sensors and drives of yaw")
    pitch: CanAxis | None = Field(default=None, description="Sensors and drives of pitch")
    tendons: Mapping[str, CanTendon] = Field(default={}, description=_TENDONS)
    handle_joints: Mapping[str, CanAngle] = Field(default={}, description=_HANDLE_JOINTS)
    joints: Mapping[str, CanAngle] = Field(default={}, description=_JOINTS)

    @model_validator(mode="after")
    def _nodes(self) -> Self:
        _check_given(self)
        if self.rated_current is not None and self.rated_torque is not None:
            raise ArgumentError(
                "rated_current and rated_torque are both given; a drive reports its current by one of them",
                key="rated_current",
            )
        if self.tension_drives and (self.rated_torque is None or self.mode != "cyclic-velocity"):
            wrong = "rated_torque is missing" if self.rated_torque is None else f"mode is {self.mode}"
            raise ArgumentError(
                f"tension_drives is true, but {wrong}; give rated_torque and the mode cyclic-velocity",
                key="tension_drives",
            )
        seen: dict[int, str] = {self.master: "master"}
        for place, drive in self.drives():
            if drive.node in seen:
                raise ArgumentError(
                    f"{place}.node is {drive.node}, which is {seen[drive.node]} already; it must be another one",
                    key=f"{place}.node",
                    value=drive.node,
                )
            seen[drive.node] = place
        sources: list[CanSource] = [*self.handle_joints.values(), *self.joints.values()]
        sources += [one.tension for one in self.tendons.values() if one.tension is not None]
        sources += [one for axis in filter(None, (self.yaw, self.pitch)) for one in axis.sources.values()]
        if any(source.node == self.master for source in sources):
            raise ArgumentError(
                f"a sensor's node is {self.master}, which is master; it must be another node",
                key="node",
                value=self.master,
            )
        return self

    def drives(self) -> Iterator[tuple[str, CanDrive]]:
        """Yield the drives with their keys."""
        for name, axis in (("yaw", self.yaw), ("pitch", self.pitch)):
            if axis is not None:
                yield f"{name}.agonist", axis.agonist
                yield f"{name}.antagonist", axis.antagonist
        for name, tendon in self.tendons.items():
            yield f"tendons.{name}", tendon


class NiAngle(FileTable):
    """An analogue encoder."""

    channel: Channel = Field(description="Analogue input, such as ai0")
    gain: AnglePerVolt = Field(description="Angle per volt")
    offset: Angle = Field(default=0.0, description="Angle at 0 V")


class NiTension(FileTable):
    """An amplified load cell."""

    channel: Channel = Field(description="Analogue input, such as ai2")
    gain: TensionPerVolt = Field(description="Tension per volt")
    offset: SignedForce = Field(default=0.0, description="Tension at 0 V")


class NiCurrent(FileTable):
    """A drive's analogue output of its motor's current."""

    channel: Channel = Field(description="Analogue input, such as ai4")
    gain: CurrentPerVolt = Field(description="Current per volt; negative if winding gives a negative voltage")
    offset: SignedCurrent = Field(default=0.0, description="Current at 0 V")


class NiDrive(FileTable):
    """A drive with an analogue speed input, and its motor's quadrature encoder."""

    speed: Channel = Field(description="Analogue output of the speed command, such as ao0")
    gain: SpeedPerVolt = Field(description="Motor speed per volt; negative if positive rotation unwinds")
    standstill: SignedVoltage = Field(default=0.0, description="Voltage at which the motor is at rest")
    counter: Channel = Field(description="Counter of the motor's encoder, such as ctr0")
    reversed: bool = Field(default=False, strict=True, description="Whether the encoder counts down as it winds")
    current: NiCurrent | None = Field(default=None, description="Its motor's current, for sensors of kind current")


class NiTendon(NiDrive):
    """The drive of a tendon, its motor's encoder, and its load cell."""

    tension: NiTension | None = Field(default=None, description="Its load cell, if any")


class NiAxis(Axis[NiDrive, NiAngle, NiTension]):
    """The sensors and drives of one bending axis."""


class NiDaq(FileTable):
    """A data acquisition device of National Instruments, at the sampling rate of the table sensors."""

    device: Channel = Field(default="Dev1", description="Name of the device in its driver")
    wiring: Literal["differential", "single-ended", "default"] = Field(
        default="differential", description="How analogue inputs are wired"
    )
    input_limit: Voltage = Field(default=10.0, description="Range of the analogue inputs to either side")
    output_limit: Voltage = Field(default=10.0, description="Largest speed command to either side")
    ahead: Annotated[int, Field(ge=1, le=100, strict=True)] = Field(
        default=6,
        description="Speed commands buffered in the device: each delays by a sample; when none is left, it stops",
    )
    alive: Channel | None = Field(
        default=None, description="Digital line that changes with every command, for a relay that needs it to"
    )
    relay: Channel | None = Field(
        default=None, description="Digital line that is high while the motors may have their supply, for a relay in it"
    )
    watchdog: Time | None = Field(
        default=0.025, description="Time without a command after which a device that can sets the outputs by itself"
    )
    yaw: NiAxis | None = Field(default=None, description="Sensors and drives of yaw")
    pitch: NiAxis | None = Field(default=None, description="Sensors and drives of pitch")
    tendons: Mapping[str, NiTendon] = Field(default={}, description=_TENDONS)
    handle_joints: Mapping[str, NiAngle] = Field(default={}, description=_HANDLE_JOINTS)
    joints: Mapping[str, NiAngle] = Field(default={}, description=_JOINTS)

    @model_validator(mode="after")
    def _channels(self) -> Self:
        _check_given(self)
        axes = [axis for axis in (self.yaw, self.pitch) if axis is not None]
        drives = [*(drive for axis in axes for drive in axis.drives), *self.tendons.values()]
        used = [one.channel for axis in axes for one in axis.sources.values()]
        used += [one.channel for one in (*self.handle_joints.values(), *self.joints.values())]
        used += [one.tension.channel for one in self.tendons.values() if one.tension is not None]
        used += [drive.current.channel for drive in drives if drive.current is not None]
        used += [name for drive in drives for name in (drive.speed, drive.counter)]
        twice = next((name for name in used if used.count(name) > 1), None)
        if twice is not None:
            raise ArgumentError(
                f"channel {twice!r} is given twice; each signal must have a channel of its own",
                key="channel",
                value=twice,
            )
        for drive in drives:
            if not math.fabs(drive.standstill) < self.output_limit:
                raise ArgumentError(
                    f"standstill of {drive.speed} is {drive.standstill:g} V; it must be below output_limit, "
                    f"{self.output_limit:g} V",
                    key="standstill",
                )
        return self


def _check_given(bench: CanOpen | NiDaq) -> None:
    if bench.yaw is None and bench.pitch is None and not bench.tendons:
        raise ArgumentError(
            "neither yaw nor pitch is given, nor tendons; give one table for each axis of the instrument, or for each "
            "tendon where it lists joints and tendons",
            key="yaw",
        )


class Serial(FileTable):
    """A microcontroller with the firmware at a serial port."""

    port: Annotated[str, Field(min_length=1, max_length=300)] = Field(
        default="/dev/ttyACM0", description="Port, socket://HOST:PORT or unix://PATH"
    )
    baud_rate: Annotated[int, Field(ge=1200, le=20_000_000, strict=True)] = Field(
        default=3_000_000, description="Bits per second"
    )
    timeout: Annotated[Time, Field(gt=0, le=10)] = Field(
        default=0.25, description="Longest wait for an answer, with all repetitions"
    )
    sensors: Literal["twin", "board"] = Field(
        default="twin", description="Plant of the controller: the twin, or sensors and motors of the board itself"
    )


class Devices(FileTable):
    """The devices of a bench, a table each."""

    canopen: CanOpen | None = Field(default=None, description="CiA 402 drives on a CAN bus")
    nidaq: NiDaq | None = Field(default=None, description="Data acquisition by nidaqmx")
    serial: Serial | None = Field(default=None, description="A microcontroller with the firmware")

    def check_tensions(self, kind: str) -> None:
        """Check that each device gives what sensors.kind says; raises ValueError."""
        benches: tuple[tuple[str, CanOpen | NiDaq | None], ...] = (("canopen", self.canopen), ("nidaq", self.nidaq))
        for name, bench in benches:
            if bench is None:
                continue
            if kind == "current" and isinstance(bench, CanOpen):
                if bench.rated_current is None and bench.rated_torque is None:
                    raise ArgumentError(
                        "sensors.kind is current, but devices.canopen has neither rated_current nor rated_torque; give "
                        "one of them, or load cells",
                        key="sensors.kind",
                    )
                continue
            for place, wired, side in _wired(bench):
                if kind == "current":
                    drive = getattr(wired, side) if side else wired
                    missing, other, key = drive.current is None, "load-cell", f"{side}.current".lstrip(".")
                else:
                    key = f"{side}_tension".lstrip("_")
                    missing, other = getattr(wired, key) is None, "current"
                if missing:
                    raise ArgumentError(
                        f"devices.{name}.{place}.{key} is missing; without it sensors.kind must be {other}",
                        key=f"devices.{name}.{place}.{key}",
                    )


def _wired(bench: CanOpen | NiDaq) -> Iterator[tuple[str, Any, str]]:
    """Yield the tables of a bench in which a tendon is wired: their key, the table, and which tendon of an axis."""
    for axis, tendon in product(("yaw", "pitch"), ("agonist", "antagonist")):
        if getattr(bench, axis) is not None:
            yield axis, getattr(bench, axis), tendon
    for name, wired in bench.tendons.items():
        yield f"tendons.{name}", wired, ""

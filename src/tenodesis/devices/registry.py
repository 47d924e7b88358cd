"""The available devices, what each needs, and how a device is made for an instrument."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from tenodesis.control.pairs import compensated
from tenodesis.devices.device import Device
from tenodesis.errors import ArgumentError, DeviceError
from tenodesis.extras import require
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.instrument.devices import Serial


@dataclass(frozen=True)
class Kind:
    """A kind of device."""

    description: str
    needs: str
    make: Callable[[Instrument], Device] | None
    """None of the twin, which is a part of the live loop."""


def make(name: str, inst: Instrument, address: str | None = None) -> Device:
    """Return a device for an instrument, not open yet; the address replaces a serial device's port in the file.

    Raises
    ------
    DeviceError
        There is no such device, it cannot be made here, or the instrument file has no table for it.
    MissingExtraError
        Its libraries are not installed.
    InstrumentError
        The table does not suit the instrument.
    """
    if name not in KINDS:
        raise DeviceError(key="NAME", value=name, allowed=f"one of {', '.join(KINDS)}")
    made = KINDS[name].make
    if made is None:
        can = ", ".join(key for key, kind in KINDS.items() if kind.make is not None)
        raise DeviceError(key="NAME", value=name, allowed=f"one of {can}: the live loop serves others itself")
    if address is not None:
        if name != "serial":
            raise DeviceError(key="--address", value=address, allowed=f"left out: {name} has none, only serial has")
        given = (inst.devices.serial or Serial()).model_copy(update={"port": address})
        inst = inst.model_copy(update={"devices": inst.devices.model_copy(update={"serial": given})})
    return made(inst)


def _canopen(inst: Instrument) -> Device:
    if inst.devices.canopen is None:
        raise _without_table("canopen", inst)
    require("can", "devices")
    require("canopen", "devices")
    from tenodesis.devices.canopen import CanOpenDevice  # noqa: PLC0415 - its libraries are an extra

    return CanOpenDevice(inst, inst.devices.canopen)


def _nidaq(inst: Instrument) -> Device:
    from tenodesis.devices.nidaq import NiDaqDevice  # noqa: PLC0415 - as above

    if inst.devices.nidaq is None:
        raise _without_table("nidaq", inst)
    return NiDaqDevice(inst, inst.devices.nidaq)


def _serial(inst: Instrument) -> Device:
    from tenodesis.devices.serial import SerialDevice  # noqa: PLC0415 - as above

    return SerialDevice(on_board(inst), inst.devices.serial or Serial())


def on_board(inst: Instrument) -> ShortForm:
    """Return what the controller on a board is made for; raises DeviceError where its firmware serves no joint."""
    try:
        return compensated(inst)
    except ArgumentError as problem:
        raise DeviceError(
            f"serial is a controller on a board, whose firmware serves pairs of tendons, and no joint of {inst.name} "
            "has one of its own; canopen and nidaq take it, with the law of all joints on this computer.",
            key=problem.key,
            allowed="canopen or nidaq",
        ) from None


def _without_table(name: str, inst: Instrument) -> DeviceError:
    return DeviceError(
        f"{inst.name} has no table devices.{name}, which describes the wiring of its bench; add that table.",
        key=f"devices.{name}",
    )


KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "twin": Kind("the digital twin, in the loop's own process", "nothing", None),
        "canopen": Kind(
            "a CiA 402 drive per tendon and sensors on a CAN bus",
            "table devices.canopen; the extra [devices]; a CAN interface",
            _canopen,
        ),
        "nidaq": Kind(
            "analogue encoders, load cells and speed commands, clocked by hardware",
            "table devices.nidaq; the extra [devices] and the driver NI-DAQmx",
            _nidaq,
        ),
        "serial": Kind(
            "the controller on a microcontroller with the firmware, whose sensors are its own or the twin's",
            "table devices.serial; the extra [devices]; a serial port",
            _serial,
        ),
    }
)
"""All devices, by name."""

"""CiA 402: the states and emergencies of a drive, and the words that command it."""

from enum import StrEnum
from types import MappingProxyType
from typing import NamedTuple

DISABLE_VOLTAGE = 0x0000
QUICK_STOP = 0x0002
SHUTDOWN = 0x0006
SWITCH_ON = 0x0007
ENABLE = 0x000F
START_HOMING = 0x001F
FAULT_RESET = 0x0080

HOMING_ATTAINED = 1 << 12
HOMING_ERROR = 1 << 13

HOMING_MODE = 6
TORQUE_MODE = 10
"""Cyclic synchronous torque."""
MODES = MappingProxyType({"cyclic-velocity": 9, "profile-velocity": 3, "cyclic-position": 8})
HOME_HERE = (37, 35)
"""Methods that take the present position for zero: that of today's profile, and that of older drives."""

QUICK_STOP_ON_LOSS = 3
"""What a drive does once it has lost our heartbeat, object 6007h."""
STOP_AND_HOLD = 6
"""Slow down by the quick stop ramp and stay there, object 605Ah."""
STOP_AND_LET_GO = 2
"""Slow down by the quick stop ramp, then without power, objects 605Ah and 605Eh."""


class DriveState(StrEnum):
    """States of a drive."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


_STATES = (
    (0x4F, 0x00, DriveState.NOT_READY),
    (0x4F, 0x40, DriveState.SWITCH_ON_DISABLED),
    (0x6F, 0x21, DriveState.READY),
    (0x6F, 0x23, DriveState.SWITCHED_ON),
    (0x6F, 0x27, DriveState.OPERATION_ENABLED),
    (0x6F, 0x07, DriveState.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, DriveState.FAULT_REACTION),
    (0x4F, 0x08, DriveState.FAULT),
)
"""Mask and bits of a statusword, and the state that they mean."""

NEXT = MappingProxyType(
    {
        DriveState.FAULT: FAULT_RESET,
        DriveState.QUICK_STOP_ACTIVE: DISABLE_VOLTAGE,
        DriveState.SWITCH_ON_DISABLED: SHUTDOWN,
        DriveState.READY: SWITCH_ON,
        DriveState.SWITCHED_ON: ENABLE,
    }
)
"""Controlword that leads from a state towards operation enabled; from the others a drive continues by itself."""

_EMERGENCIES = {
    0x2310: "continuous overcurrent",
    0x2320: "short circuit",
    0x3210: "overvoltage of the supply",
    0x3220: "undervoltage of the supply",
    0x4210: "too hot",
    0x4310: "too hot",
    0x5441: "a limit or stop switch",
    0x7121: "motor blocked",
    0x7300: "sensor",
    0x7305: "encoder",
    0x8110: "frames lost by the drive",
    0x8120: "CAN error passive",
    0x8130: "heartbeat of this computer lost",
    0x8140: "recovered from bus off",
    0x8210: "a PDO of wrong length",
    0x8250: "a PDO that did not come",
    0x8400: "speed controller",
    0x8611: "following error",
}
_GROUPS = (
    (0xF000, 0x1000, "of no particular kind"),
    (0xF000, 0x2000, "current"),
    (0xF000, 0x3000, "voltage"),
    (0xF000, 0x4000, "temperature"),
    (0xFF00, 0x5000, "hardware"),
    (0xF000, 0x6000, "software"),
    (0xF000, 0x7000, "an additional module"),
    (0xFF00, 0x8100, "communication"),
    (0xF000, 0x8000, "monitoring"),
    (0xFF00, 0x9000, "an external cause"),
)


class Emergency(NamedTuple):
    """The error code of an emergency message or of object 603Fh."""

    code: int

    @property
    def over(self) -> bool:
        """Whether it announces the end of an emergency."""
        return self.code & 0xFF00 == 0

    def __str__(self) -> str:
        known = _EMERGENCIES.get(self.code)
        if known is None:
            known = next((name for mask, code, name in _GROUPS if self.code & mask == code), "of the drive's own kind")
        return f"0x{self.code:04X} ({known})"


def wrapped(counts: int) -> int:
    """Return counts as a drive has them, in 32 bits."""
    return (counts + 2**31) % 2**32 - 2**31


def state(statusword: int) -> DriveState:
    """Return the state in a statusword."""
    return next((state for mask, bits, state in _STATES if statusword & mask == bits), DriveState.UNKNOWN)


def described(statusword: int) -> str:
    """Return the state in a statusword for a message; an unknown state with the word itself."""
    found = state(statusword)
    return f"{found} (0x{statusword:04X})" if found is DriveState.UNKNOWN else str(found)

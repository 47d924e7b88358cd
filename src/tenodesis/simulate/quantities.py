"""Quantities of a protocol: signed or not, with a unit in files, SI numbers in Python."""

import re
from typing import Annotated, Any

from pydantic import BeforeValidator

from tenodesis.units import Quantity, annotation

_TURNING = re.compile(r"deg|°|rad|turn|rev|arcmin|rpm")


def _turning(value: Any) -> Any:
    """Refuse what is as often a second as a speed but does not turn, like Hz."""
    if isinstance(value, str) and any(letter.isalpha() for letter in value) and not _TURNING.search(value):
        raise ValueError('it is not measured by angle; write it like "20 deg/s"')
    return value


Duration = Annotated[float, *annotation(Quantity("duration", "s", "2 s", above=0, below=1e6))]
Delay = Annotated[float, *annotation(Quantity("duration", "s", "0.5 s", at_least=0, below=1e6))]
Tension = Annotated[float, *annotation(Quantity("force", "N", "30 N", above=0, below=1e5))]
TendonSpeed = Annotated[float, *annotation(Quantity("speed", "m/s", "1 mm/s", above=1e-7, below=10))]
Force = Annotated[float, *annotation(Quantity("force", "N", "1 N", above=-1e5, below=1e5))]
Moment = Annotated[float, *annotation(Quantity("moment", "N*m", "0.15 N*m", above=-1e5, below=1e5))]
Speed = Annotated[
    float, *annotation(Quantity("speed", "rad/s", "20 deg/s", above=1e-6, below=1e3)), BeforeValidator(_turning)
]
SpoolVelocity = Annotated[
    float, *annotation(Quantity("velocity", "rad/s", "1 rad/s", above=-1e4, below=1e4)), BeforeValidator(_turning)
]

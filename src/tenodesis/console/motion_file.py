"""Recorded motions of the hand, as protocols that repeat them."""

from typing import Literal

import numpy as np

from tenodesis.errors import ProtocolError, RecordingError
from tenodesis.recording import Recording
from tenodesis.simulate import Motion, Protocol
from tenodesis.simulate.motion import csv_text

_UNITS: dict[str, Literal["deg", "rad"]] = {"deg": "deg", "rad": "rad"}
_ROWS_PER_SECOND = 100


def motion_protocol(content: bytes, name: str) -> Protocol:
    """Return a protocol that moves the first axis as a CSV file tells.

    The time's column is the first whose name begins with time, the angle's the first that ends with deg or rad.

    Raises
    ------
    ProtocolError
        It is no such file.
    """
    try:
        data = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ProtocolError(f"{name} is not UTF-8 text; allowed is a CSV file.") from None
    lines = (line for line in data.splitlines() if line.strip() and not line.lstrip().startswith("#"))
    header = [cell.strip().strip('"') for cell in next(lines, "").split(",")]
    times = [column for column in header if column.lower().startswith("time")]
    angles = [(column, unit) for column in header for unit in _UNITS if column.lower().rstrip("])").endswith(unit)]
    if not times or not angles:
        raise ProtocolError(
            f"{name} has the columns {', '.join(header) or 'none'}; allowed are one whose name begins with time, in s, "
            "and one whose name ends with deg or rad."
        )
    column, unit = angles[0]
    try:
        motion = Motion(data=data, time_column=times[0], angle_column=column, angle_unit=_UNITS[unit], limit=True)
    except ValueError as problem:
        raise ProtocolError(f"{name}: {problem}") from None
    return Protocol(name=name[:60], description="A recorded motion", phases=(motion,))


def repeated(recording: Recording) -> Protocol:
    """Return a protocol that moves the handle as in a recording of the bench, axis after axis.

    Raises
    ------
    RecordingError
        It has no handle angle, or not two rows.
    """
    run = recording.run
    named = [name for name in ("measured_handle_angle", "handle_angle") if name in run.signals()]
    if not named or len(run) < 2:
        raise RecordingError(f"{recording.path} has no motion of the handle.")
    angles = run[named[0]].reshape(len(run), -1)
    rows = np.unique(np.linspace(0, len(run) - 1, max(2, int(recording.duration * _ROWS_PER_SECOND))).astype(int))
    phases = tuple(
        Motion(
            axis=axis,
            data=csv_text(run.time[rows], angles[rows, n], "time_s", "angle_rad"),
            time_column="time_s",
            angle_column="angle_rad",
            angle_unit="rad",
            limit=True,
        )
        for n, axis in enumerate(run.axes)
    )
    return Protocol(
        name=f"as {recording.path.stem}"[:60], description="The handle's motion of a recording", phases=phases
    )

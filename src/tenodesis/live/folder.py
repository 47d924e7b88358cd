"""The folder of a live runtime: its files, and the file that describes the runtime."""

import json
from pathlib import Path
from typing import Any, NamedTuple

from tenodesis.errors import LiveError
from tenodesis.files import atomic_file
from tenodesis.instrument import Instrument, load

RING = "ring"
"""The ticks, in shared memory."""
SOCKET = "control.sock"
"""Socket that accepts commands."""
INSTRUMENT = "instrument.toml"
_SESSION = "session.json"


class About(NamedTuple):
    """The description of a runtime."""

    inst: Instrument
    device: str
    period: float
    """Between ticks, s."""
    simulated: bool
    distal_encoder: bool
    started: str
    """Time and date, ISO 8601."""
    pid: int


def write(folder: Path, about: About) -> None:
    """Write the description of a runtime; the instrument file is in the folder already.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    content: dict[str, Any] = about._asdict()
    del content["inst"]
    with atomic_file(folder / _SESSION) as new:
        new.write_text(json.dumps(content, indent=2), "utf-8")


def read(folder: Path) -> About:
    """Return the description of the runtime of a folder.

    Raises
    ------
    LiveError
        It is no such folder.
    """
    try:
        content = json.loads((folder / _SESSION).read_text("utf-8"))
        return About(load(folder / INSTRUMENT), **content)
    except (OSError, ValueError, TypeError) as problem:
        raise LiveError(
            f"{folder} is no folder of a live instrument ({problem}); start one with `tenodesis console`."
        ) from None

"""What a twin steps: the core's twin of an instrument, with commands and signals by name."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis._core import Status
from tenodesis.run import Array, Names
from tenodesis.twin.commands import Frame, Held
from tenodesis.twin.contact import Contact

Rows: TypeAlias = Any
"""Commands as the core takes them."""


class Constant(NamedTuple):
    """What acts on a twin during an entire call: tissue by joint, what the jaws hold, and the wrench's axes."""

    contact: Sequence[Contact | None] = ()
    held: Held | None = None
    axes: Frame = "tip"


class Ticks(NamedTuple):
    """Time and what comes from outside, in a loop that a controller closes."""

    time_step: float
    first_step: int
    relay: float
    requests: NDArray[np.uint8] | None
    values: Array | None
    modes: NDArray[np.uint8] | None


class Outcome(NamedTuple):
    """Steps taken, the last status, where it was, and signals by name, each of shape (n, columns)."""

    steps: int
    status: Status
    where: str
    signals: dict[str, Array]
    control: Array = np.empty((0, 0, 0))
    """Of the controller, (n, axes, columns)."""


class TwinCore(Protocol):
    """The core's twin of an instrument, with its state."""

    names: Names
    kind: str
    """In words, what twins must have in common to exchange states."""
    widths: Mapping[str, int]
    """Columns of the commands that it takes, by name."""
    axes: tuple[str, ...]
    """What a controller compensates."""
    own_tendons: Sequence[int]
    """Tendons whose motors a controller moves."""
    steps_per_tick: int
    spool_radius: float
    stretch: float
    """Largest of a tendon at rest, m."""
    cores: list[Any]
    state: tuple[bytes, ...]

    def check(self, commands: Mapping[str, Array]) -> None:
        """Raise ArgumentError for a handle angle beyond the handle's range, or a weight without a rig."""

    def rows(self, commands: Mapping[str, Array], constant: Constant) -> Rows:
        """Return commands as the core takes them."""

    def commanded(self, rows: Rows, *, tissue: bool) -> dict[str, Array]:
        """Return the commands that are signals of a run."""

    def run(self, rows: Rows) -> Outcome:
        """Step over commands."""

    def run_controlled(self, controller: _core.Controller, rows: Rows, ticks: Ticks) -> Outcome:
        """Step over commands, with a controller in the loop."""

    def audit(self, rows: Rows) -> tuple[int, Status, list[float]]:
        """Step over commands; return steps, the last status, and the values of an energy balance."""

    def device(self, time_step: float) -> "_core.LiveDevice":
        """Return it as a device of the live loop, whose time step is in s."""

    def now(self) -> Mapping[str, Array]:
        """Return the signals as they stand, each of shape (1, columns)."""

    def handle_wanted(self) -> Array:
        """Return the angles of the handle's joints by the last command, rad."""

    def tissue(self) -> list[tuple[float, float, float]]:
        """Return the tissue of the last command, by joint, as :attr:`Contact.row` has it."""

"""What a twin steps: the core's twin of an instrument, with commands and signals by name."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import _core
from tenodesis._core import Status
from tenodesis.run import Array, Names
from tenodesis.twin.commands import Frame, Held
from tenodesis.twin.contact import NO_TISSUE, Contact
from tenodesis.twin.rows import CONTROL, columns_by_name, signals_of_commands

_UNSEEN = ("sweeps",)


class Surroundings(NamedTuple):
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


class Stepped(NamedTuple):
    """Steps taken, the last status, and signals by name, each of shape (n, columns)."""

    steps: int
    status: Status
    signals: dict[str, Array]
    control: Array = np.empty((0, 0, 0))
    """Of the controller, (n, axes, columns)."""


class TwinCore(ABC):
    """The core's twin of an instrument, with its state.

    Parameters
    ----------
    core
        The twin.
    names
        What columns are named after.
    pairs
        By name of what a controller compensates: joint of the handle, agonist and antagonist.
    steps_per_tick
        Time steps between two samples of the sensors.
    unseen
        Signals of the core that a run has not.
    """

    kind: str
    """In words, what twins must have in common to exchange states."""
    widths: Mapping[str, int]
    """Columns of the commands that it takes, by name."""
    spool_radius: float
    stretch: float
    """Largest of a tendon at rest, m."""
    grips = False
    """Whether it has jaws that grip."""

    def __init__(
        self,
        core: _core.Twin,
        names: Names,
        pairs: Mapping[str, tuple[int, int, int]],
        steps_per_tick: int,
        unseen: Sequence[str] = (),
    ) -> None:
        self.core, self.names, self.steps_per_tick = core, names, steps_per_tick
        self.axes = tuple(pairs)
        self.pairs = list(pairs.values())
        self.own_tendons: Sequence[int] = [tendon for _, *tendons in self.pairs for tendon in tendons]
        self.columns = columns_by_name(core.commands)
        self.signals = {
            name: columns for name, columns in columns_by_name(core.signals).items() if name not in (*_UNSEEN, *unseen)
        }
        self._width = sum(width for _, width in core.signals)

    @property
    def state(self) -> bytes:
        """The complete state."""
        return self.core.state

    @state.setter
    def state(self, state: bytes) -> None:
        self.core.state = state

    @abstractmethod
    def check(self, commands: Mapping[str, Array]) -> None:
        """Raise ArgumentError for a handle angle beyond the handle's range, or a weight without a rig."""

    @abstractmethod
    def check_axes(self, commands: Mapping[str, Array], axes: Frame) -> None:
        """Raise ArgumentError for axes of a wrench that do not go with the commands."""

    def rows(self, commands: Mapping[str, Array], constant: Surroundings) -> Array:
        """Return the commands as rows of the core's columns."""
        self.check_axes(commands, constant.axes)
        rows = np.zeros((len(commands["handle_angle"]), sum(width for _, width in self.core.commands)))
        for name, values in commands.items():
            # A row that stands for all, of zeros, takes no time.
            if name in self.columns and (any(values.strides) or values[:1].any()):
                rows[:, self.columns[name]] = values
        tissue = [NO_TISSUE if contact is None else contact.row for contact in constant.contact]
        rows[:, self.columns["contact"]] = np.ravel(tissue)
        return rows

    def commanded(self, rows: Array, *, tissue: bool, tension: bool) -> dict[str, Array]:
        """Return the commands that are signals of a run."""
        commands = {name: rows[:, columns] for name, columns in self.columns.items()}
        return signals_of_commands(commands, tissue=tissue, grip=self.grips, tension=tension)

    def run(self, rows: Array) -> Stepped:
        """Step over commands."""
        out = self._room(len(rows))
        steps, status = self.core.run(rows, out)
        return Stepped(steps, Status(status), self.named(out))

    def run_controlled(self, controller: _core.Controller, rows: Array, ticks: Ticks) -> Stepped:
        """Step over commands, with a controller in the loop."""
        out = self._room(len(rows))
        control = np.empty((len(rows), len(self.pairs), len(CONTROL)))
        steps, status = self.core.run_controlled(
            controller,
            self.pairs,
            rows,
            self.steps_per_tick,
            ticks.time_step,
            ticks.relay,
            ticks.first_step,
            ticks.requests,
            ticks.values,
            ticks.modes,
            out,
            control,
        )
        return Stepped(steps, Status(status), self.named(out), control)

    def audit(self, rows: Array) -> tuple[int, Status, list[float]]:
        """Step over commands; return steps, the last status, and the values of an energy balance."""
        totals = np.zeros(len(_core.energies()))
        steps, status = self.core.run(rows, self._room(len(rows)), totals)
        return steps, Status(status), totals.tolist()

    def device(self, time_step: float) -> "_core.LiveDevice":
        """Return it as a device of the live loop, whose time step is in s."""
        return _core.TwinDevice(self.core, time_step, self.steps_per_tick)

    def now(self) -> Mapping[str, Array]:
        """Return the signals as they stand, each of shape (1, columns)."""
        out = self._room(1)
        self.core.now(out[0])
        return self.named(out)

    def handle_wanted(self) -> Array:
        """Return the angles of the handle's joints by the last command, rad."""
        return np.array([self.core.handle_wanted(n) for n in range(len(self.names.handle_joints))])

    def tissue(self) -> list[tuple[float, float, float]]:
        """Return the tissue of the last command, by joint, as :attr:`Contact.row` has it."""
        return [self.core.contact(n) for n in range(len(self.names.joints))]

    def named(self, out: Array) -> dict[str, Array]:
        """Return rows of the core's signals by name; their last axis is that of the columns."""
        return {name: out[..., columns] for name, columns in self.signals.items()}

    def _room(self, count: int) -> Array:
        return np.empty((count, self._width))

"""A protocol on a live instrument: commands are sent ahead of time, homing when its phase is reached."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import Enum, auto
from typing import Any, NamedTuple, Protocol

import numpy as np

from tenodesis.control import OperatingState
from tenodesis.control.controller import fault_names
from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.live.layout import CommandColumns
from tenodesis.run import Array, fault_bits
from tenodesis.simulate import Pretension
from tenodesis.simulate.command import SMOOTH, Between, between, sampled
from tenodesis.simulate.execution import check_controllable
from tenodesis.simulate.protocol import Planned, block_size, errors_of
from tenodesis.twin import Held

_AHEAD = 0.1
"""Least time by which the queue is kept ahead, s."""
_TURNS_AHEAD = 5
"""Least number of calls of `advance` by which the queue is kept ahead, at the speed of its consumption."""
_BLOCK = 0.1
"""Time computed at once, s."""
_APPROACH = math.radians(20)
"""Largest speed of the handle on the way to the start of the protocol or of its continuation, rad/s."""
_UNLOADING = 0.5
"""Least time in which loads change on that way, s."""
_PATIENCE = 1.0
"""Time within which the instrument must begin what was requested, s, on its clock."""
_CONSTANT = ("contact", "held")
"""Commands that do not change along a segment."""


class Progress(NamedTuple):
    """Progress of a protocol, s; homing counts with its timeout, as in :meth:`tenodesis.simulate.Protocol.duration`."""

    done: float
    total: float


class Queue(Protocol):
    """The runtime's queue of commands; every tick consumes a command."""

    @property
    def pending(self) -> int:
        """Number of rows not yet consumed."""
        ...

    def push(self, rows: Array) -> int:
        """Append rows of commands, shape (n, width), and return how many fitted."""
        ...

    def drop(self) -> None:
        """Drop the rows not yet consumed."""
        ...


class Player:
    """A protocol that is being played; `advance` is to be called every 20 ms or so.

    First the handle goes smoothly from where it is to where the protocol begins, and the loads to none; the joints of a
    tool without a handle go from where they are meant to be to straight. Nothing is sent while the instrument is not
    enabled; once it is enabled again, the handle goes back to where it was, and the protocol goes on. Homing that fails
    is the operator's to repeat.

    Parameters
    ----------
    plan
        The protocol on the instrument.
    queue
        Takes the commands.
    ask
        Requests home, resume or pause of the controller.
    latest
        Returns the newest tick: ``time`` (s), ``state``, ``faults``, ``homed``, ``homing``, ``output_angle`` (rad) and
        ``commands``, what was commanded by name.
    inst
        The instrument.
    assumed
        What its controller is made for; None where it has none.
    columns
        Of the commands.
    time_step
        Time between two ticks, s, as in the plan.

    Raises
    ------
    ProtocolError
        A controller cannot run it: it moves the spools, or requires of homing what that does not do. Or its drives are
        to hold tensions, and follow speeds alone.
    """

    def __init__(
        self,
        plan: Sequence[Planned],
        queue: Queue,
        ask: Callable[[str], object],
        latest: Callable[[], Mapping[str, Any]],
        *,
        inst: Instrument,
        assumed: ShortForm | None,
        columns: CommandColumns,
        time_step: float,
    ) -> None:
        if assumed is not None:
            check_controllable(plan, inst, assumed)
        if "spool_tension" not in columns:
            _check_follows_speeds(plan)
        self._plan, self._queue, self._ask, self._latest = tuple(plan), queue, ask, latest
        self._inst, self._columns, self._time_step = inst, columns, time_step
        self._total = math.fsum(planned.seconds for planned in plan)
        self._tick: Mapping[str, Any] = {}
        self._script = self._play()
        self._over = self._homing = self._interrupted = False
        self._at = np.zeros(columns.width)
        """Last row sent."""
        self._least = self._ahead = max(1, round(_AHEAD / time_step))
        self._pending = self._given = 0
        self._homed = self._under_way = self._done = 0.0
        self.held = False
        """Whether the operator's last request was to pause or disable: then the operator homes or resumes."""
        self.problem: str | None = None
        """Why it does not continue and what to do, in a sentence; None while it continues."""

    @property
    def progress(self) -> Progress:
        """Progress."""
        if not self._over:
            given = self._homed + self._under_way + (self._given - self._queue.pending) * self._time_step
            self._done = max(self._done, min(given, self._total))
        return Progress(self._done, self._total)

    @property
    def finished(self) -> bool:
        """Whether it is done or was cancelled."""
        return self._over

    def advance(self) -> None:
        """Send the commands that are due, and evaluate the newest tick."""
        if self._over:
            return
        self._tick = self._latest()
        pending = self._queue.pending
        self._ahead = max(self._least, _TURNS_AHEAD * (self._pending - pending))
        self._pending = pending
        try:
            next(self._script)
        except StopIteration:
            self._over, self._done = True, self._total

    def cancel(self) -> None:
        """End it: the handle stays where it is, the loads too, and homing pauses."""
        if self._over:
            return
        self._done, self._over, self.problem = self.progress.done, True, None
        try:
            self._queue.drop()
        finally:
            if self._homing:
                self._ask("pause")

    # What follows are turns: a yield waits for the next.

    def _play(self) -> Iterator[None]:
        homes_first = isinstance(self._plan[0].phase, Pretension)
        yield from self._send(self._way_to(self._start()), self._plan[0], disabled=homes_first)
        if not homes_first:
            yield from self._send(self._straightening(), self._plan[0])
        present: Between | None = None
        held: Held | None = None
        for planned in self._plan:
            if isinstance(planned.phase, Pretension):
                yield from self._home(planned)
                continue
            for commands in sampled(planned.segments, block_size(self._time_step, _BLOCK)):
                if commands.get("between") != present:
                    # How far the jaws are open is known when they are there.
                    yield from self._emptied()
                    present = commands.get("between")
                    held = None if present is None else present.held(self._opening)
                given = {**commands, "held": held}
                rows = self._columns.row(given, len(commands["handle_angle"]))
                yield from self._send(rows, planned, played=True)
        yield from self._emptied()
        if self._constants(self._at).any():
            self._queue.drop()

    def _start(self) -> Array:
        """Return the row from which the protocol begins."""
        initial = self._plan[0].initial
        single = {name: values[np.newaxis] for name, values in initial.values.items()}
        row: Array = self._columns.row({**single, "contact": initial.contact}, 1)[0]
        return row

    def _straightening(self) -> Array:
        """Return rows (n, width) in which the spools of a tool without a handle turn its joints back to straight."""
        speeds, aimed = self._plan[0].initial.speeds, np.ravel(self._tick.get("commanded_output_angle", np.nan))
        if speeds is None or not np.isfinite(aimed).all():
            return np.empty((0, self._columns.width))
        aims = np.array([aimed[arcs].sum() for arcs in self._inst.bends.values()])
        steps = math.ceil(SMOOTH.peak * float(np.abs(aims).max()) / _APPROACH / self._time_step)
        rows = np.repeat(self._start()[np.newaxis], steps, axis=0)
        if steps:
            left = 1 - SMOOTH.way(np.arange(steps + 1) / steps)
            rows[:, self._columns.columns["spool_velocity"]] = speeds(np.outer(left, aims))
        return rows

    @property
    def _opening(self) -> float:
        return float(self._inst.grip_arms @ np.ravel(self._tick["output_angle"]))

    def _constants(self, row: Array) -> Array:
        """Return the commands in a row that do not change along a segment."""
        named = self._columns.named(row)
        return np.concatenate([named[name] for name in _CONSTANT if name in named])

    def _send(self, rows: Array, planned: Planned, *, disabled: bool = False, played: bool = False) -> Iterator[None]:
        """Send the rows that are due, while the instrument is enabled or need not be."""
        while len(rows):
            if not self._ready(planned, disabled=disabled):
                self._interrupted = True
            elif self._interrupted and not self._queue.pending:
                self._interrupted = False
                yield from self._send(self._way_to(self._at), planned, disabled=disabled)
            elif not self._interrupted and self._pending < self._ahead:
                accepted = self._queue.push(rows[: self._ahead - self._pending])
                self._pending += accepted
                if accepted:
                    self._at = rows[accepted - 1]
                    rows = rows[accepted:]
                    self._given += accepted if played else 0
                if len(rows) == 0:
                    return
            yield

    def _ready(self, planned: Planned, *, disabled: bool) -> bool:
        """Whether commands may be sent; if not, the problem states why."""
        state, homing = self._state, bool(self._tick["homing"])
        if state == OperatingState.FAULT:
            self._wait(planned, f"{self._faults()}; clear it and enable the instrument to go on")
        elif disabled or (state == OperatingState.ENABLED and not homing):
            self.problem = None
        elif homing:
            self._wait(planned, "the instrument is homing; resume it after that to go on")
        elif not self._tick["homed"]:
            self._wait(planned, f"the instrument is {state.name} and not homed; home and resume it to go on")
        else:
            way = "resume" if state == OperatingState.PAUSED else "enable"
            self._wait(planned, f"the instrument is {state.name}; {way} it to go on")
        return self.problem is None

    def _home(self, planned: Planned) -> Iterator[None]:
        """Home and resume; where homing fails, wait until the operator has repeated it."""
        yield from self._emptied()
        stage, since, self._homing = _Homing.ASKED, self._time, True
        if self.held:
            stage = _Homing.FAILED
            self._wait(planned, f"the operator has paused it, and it is {self._state.name}; home it to go on")
        elif self._state != OperatingState.FAULT:
            self._ask("home")
        while True:
            yield
            homing = self._state == OperatingState.ENABLED and bool(self._tick["homing"])
            if stage is _Homing.UNDER_WAY:
                self._under_way = min(self._time - since, planned.seconds)
            if self._state == OperatingState.FAULT:
                stage = _Homing.FAILED
                self._wait(planned, f"{self._faults()}; clear it and home the instrument to go on")
            elif homing and stage in {_Homing.ASKED, _Homing.FAILED}:
                stage, since, self.problem = _Homing.UNDER_WAY, self._time, None
            elif homing and stage is _Homing.UNDER_WAY and self._time - since > planned.seconds:
                stage = _Homing.OUT_OF_TIME
                self._ask("pause")
                self._wait(planned, f"it has not homed within {planned.seconds:g} s; home the instrument to go on")
            elif not homing and stage is _Homing.UNDER_WAY and self._tick["homed"]:
                break
            elif not homing and stage is _Homing.UNDER_WAY:
                stage = _Homing.FAILED
                self._wait(planned, "homing was ended; home the instrument to go on")
            elif not homing and stage is _Homing.OUT_OF_TIME:
                stage = _Homing.FAILED
            elif stage is _Homing.ASKED and self._time - since > _PATIENCE:
                stage = _Homing.FAILED
                self._wait(planned, "the instrument does not begin to home; home it to go on")
        self._homing = False
        self._under_way = 0.0
        self._homed += planned.seconds
        yield from self._resume()

    def _resume(self) -> Iterator[None]:
        """Resume, and wait for a limited time; the next commands report the problem if it failed."""
        if self.held:
            return
        asked = self._time
        self._ask("resume")
        while self._state != OperatingState.ENABLED and self._time - asked < _PATIENCE:
            yield

    def _emptied(self) -> Iterator[None]:
        """Wait until all commands sent are carried out."""
        while self._queue.pending:
            yield

    def _way_to(self, end: Array) -> Array:
        """Return rows (n, width) from the present commands to others (width,), with their tissue; spools rest."""
        target, there = self._columns.named(end), self._tick["commands"]
        begin = {name: target[name] if name in _CONSTANT else there.get(name, target[name]) for name in target}
        for name in ("spool_velocity", "spool_tension"):
            if name in target:
                begin[name] = target[name] = np.zeros_like(target[name])
        start, last = (np.concatenate([row[name] for name in self._columns.columns]) for row in (begin, target))
        if (start == last).all():
            return np.empty((0, self._columns.width))
        way = np.abs(target["handle_angle"] - begin["handle_angle"]).max(initial=0.0)
        seconds = max(SMOOTH.peak * float(way) / _APPROACH, _UNLOADING)
        steps = math.ceil(seconds / self._time_step)
        return between(start, last, SMOOTH.way(np.arange(1, steps + 1) / steps))

    @property
    def _time(self) -> float:
        return float(self._tick["time"])

    @property
    def _state(self) -> OperatingState:
        return OperatingState(int(self._tick["state"]))

    def _faults(self) -> str:
        (mask,) = fault_bits([np.ravel(self._tick["faults"])])
        return f"fault {', '.join(fault_names(int(mask))) or 'of an unknown name'}"

    def _wait(self, planned: Planned, why: str) -> None:
        done, total = self.progress
        self.problem = f"{planned.label} waits at {done:.3g} of {total:.3g} s: {why}, or cancel the protocol."


class _Homing(Enum):
    ASKED = auto()
    UNDER_WAY = auto()
    OUT_OF_TIME = auto()
    FAILED = auto()


def _check_follows_speeds(plan: Sequence[Planned]) -> None:
    """Refuse a phase in which drives are to hold tensions."""
    for planned in plan:
        if getattr(planned.phase, "spool_tensions", None):
            with errors_of(planned.label):
                raise ProtocolError(
                    "spool_tensions is given, but the drives of this bench follow speeds; it must have drives that "
                    "hold tensions, such as devices.canopen.tension_drives",
                    key="spool_tensions",
                    allowed="drives that hold tensions",
                )

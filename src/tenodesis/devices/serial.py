"""A controller on a board: a microcontroller with the firmware of ``firmware/link.cpp`` on a serial port or a socket.

The board computes; everything else is as with :class:`tenodesis.control.Controller`: a twin's run or the live loop
takes either. Each tick waits for the board's answer; a board that fails is no error but a fault, with velocities 0 and
estimates NaN, until the request ``clear`` or a reset has set the link up again. A board with sensors and motors of its
own ticks by itself, and the live loop follows it (:class:`StreamedController`).
"""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite, nan
from typing import Literal, NamedTuple, Self

import numpy as np

from tenodesis import _core
from tenodesis.control.controller import ActuationName, Controller, LawName, ObserverName
from tenodesis.devices.device import Capabilities, Device, Measurement
from tenodesis.errors import ArgumentError, DeviceError
from tenodesis.extras import require, require_live
from tenodesis.instrument import ShortForm
from tenodesis.instrument.devices import Serial
from tenodesis.run import Array

BAUD_RATE = 3_000_000
"""Bits per second of a serial port, unless another is given: a tick of one axis takes 138 bytes, 87 of them back."""

_CONNECT_TIMEOUT = 3.0  # s
_LONGEST_SILENCE = 4e6  # s


class Board(NamedTuple):
    """Name, versions and clock of a board."""

    name: str
    protocol_version: int
    interface_version: int
    clock: float
    """Of the processor, Hz."""
    has_sensors: bool
    """Whether it can measure by itself."""


class LinkCounts(NamedTuple):
    """Numbers of frames over the link, by outcome."""

    answers: int
    repetitions: int
    """Messages that were repeated."""
    damaged: int
    """Frames from the board that came damaged."""
    stale: int
    """Answers that came too late."""
    board_damaged: int
    """Frames to the board that came damaged."""


class LinkProblem(NamedTuple):
    """A failure of a link."""

    name: str
    """As ``link_lost``, ``wrong_version`` or ``not_a_number``."""
    text: str


class BoardController(Controller):
    """The controller of an instrument on a board, computed there in single precision.

    Parameters
    ----------
    address
        ``socket://HOST:PORT``, ``unix://PATH``, or a serial port such as ``/dev/ttyACM0``.
    inst, observer, law, actuation, homed, enabled, period, own_clock
        As of :class:`~tenodesis.control.Controller`; the board is sent them.
    timeout
        Longest wait for an answer, with all repetitions, s.
    repetitions
        How often a message whose answer is lost or damaged is repeated; the board acts on it once.
    silence
        Time without a tick, by the board's clock, after which it stops by itself, s; None: the instrument's
        ``control.watchdog``. With a simulated plant, which may pause, a longer one.
    baud_rate
        Of a serial port, bit/s.

    Raises
    ------
    ValueError
        An option is not valid, or the parameters make no controller.
    DeviceError
        There is no such port, no board behind it, or one of another version.
    """

    _core_type: Literal["SerialController", "StreamedController"]
    _needs = "a board with the firmware of this version"

    def __init__(
        self,
        address: str,
        inst: ShortForm,
        observer: ObserverName = "friction",
        law: LawName = "robust",
        actuation: ActuationName = "differential",
        *,
        homed: bool = True,
        enabled: bool = True,
        period: float | None = None,
        own_clock: bool = False,
        timeout: float = 0.25,
        repetitions: int = 2,
        silence: float | None = None,
        baud_rate: int = BAUD_RATE,
    ) -> None:
        require_live()
        # Arguments are checked before the board is contacted.
        super().__init__(
            inst,
            observer,
            law,
            actuation,
            homed=homed,
            enabled=enabled,
            precision="single",
            period=period,
            own_clock=own_clock,
        )
        if not (isfinite(timeout) and 0 < timeout < 1e4):
            raise ArgumentError(key="timeout", value=timeout, allowed="a time above 0 and below 10 000 s")
        if not 0 <= repetitions <= 1000:
            raise ArgumentError(key="repetitions", value=repetitions, allowed="a number from 0 to 1000")
        if silence is not None and not 1e-3 <= silence <= _LONGEST_SILENCE:
            raise ArgumentError(key="silence", value=silence, allowed="a time of 0.001 s or more, or None")
        self.address = address
        with _open(address, baud_rate) as descriptor:
            self._link: _core.BoardController = getattr(_core, self._core_type)(
                descriptor,
                self.core.parameters(),
                timeout,
                max(timeout, _CONNECT_TIMEOUT),
                repetitions,
                0 if silence is None else round(silence * 1e3),
            )
        self.core = self._link
        if self.problem is not None:
            problem = self.problem.text
            self._link.close()
            raise DeviceError(
                f"{address}: {problem}; it must be {self._needs}.", key="port", value=address, allowed=self._needs
            )

    @property
    def board(self) -> Board:
        """Name, versions and clock of the board."""
        return Board(*self._link.board())

    @property
    def problem(self) -> LinkProblem | None:
        """Problem of the link since it was last set up, by a request to clear or a reset."""
        problem, text = self._link.problem()
        return LinkProblem(problem.name.lower(), text) if problem else None

    @property
    def link_counts(self) -> LinkCounts:
        """Numbers of frames over the link, by outcome."""
        return LinkCounts(*self._link.link_counts())

    @property
    def computing_time(self) -> float:
        """Time that the board took for a tick, from the frame's last byte or its own measurement on, s."""
        return self._link.busy() / self.board.clock

    @property
    def stopped(self) -> bool:
        """Whether the board has stopped by itself and waits to be enabled or resumed."""
        return self._link.stopped()

    def close(self) -> None:
        """Stop the board, and release it; a second time does nothing."""
        self._link.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class SerialController(BoardController):
    """A controller on a board that is sent a measurement per tick and answers it; options as of its base."""

    _core_type = "SerialController"


class StreamedController(BoardController):
    """A controller on a board with sensors and motors of its own, which ticks by itself; options as of its base.

    A step sends nothing to the board: it returns the answer of the newest tick that was received. Requests go to the
    board with the next frame. Raises DeviceError if the board measures nothing by itself.
    """

    _core_type = "StreamedController"
    _needs = "a board with the firmware of this version and sensors of its own"

    def device(self) -> "_core.StreamedDevice":
        """Return its sensors and motors, as the live loop takes them."""
        assert isinstance(self._link, _core.StreamedController)
        return _core.StreamedDevice(self._link)


@contextmanager
def _open(address: str, baud_rate: int) -> Iterator[int]:
    """Yield the descriptor of an open line, which is closed afterwards; a copy stays open."""
    scheme, found, rest = address.partition("://")
    if not found:
        with _port(address, baud_rate) as descriptor:
            yield descriptor
        return
    host, _, port = rest.rpartition(":")
    if scheme == "unix" and rest:
        line, target = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM), rest
    elif scheme == "socket" and host and port.isdecimal() and int(port) < 2**16:
        line = None
    else:
        allowed = "socket://HOST:PORT, unix://PATH or a serial port such as /dev/ttyACM0"
        raise ArgumentError(key="address", value=address, allowed=allowed)
    try:
        if line is None:
            line = socket.create_connection((host.strip("[]"), int(port)), _CONNECT_TIMEOUT)
            line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        else:
            line.settimeout(_CONNECT_TIMEOUT)
            line.connect(target)
    except OSError as problem:
        raise DeviceError(
            f"{address} does not answer ({problem.strerror or problem}); a board must listen there.",
            key="port",
            value=address,
            allowed="where a board listens",
        ) from None
    with line:
        yield line.fileno()


@contextmanager
def _port(path: str, baud_rate: int) -> Iterator[int]:
    serial = require("serial", "devices")
    try:
        port = serial.Serial(path, baud_rate, timeout=0, exclusive=True)
    except (OSError, ValueError) as problem:
        raise DeviceError(f"{path} cannot be opened at {baud_rate} bit/s: {problem}.", key="port", value=path) from None
    with port:
        port.reset_input_buffer()
        yield port.fileno()


class SerialDevice(Device):
    """The line to a board: what it measures by itself, or how soon it answers a tick."""

    def __init__(self, inst: ShortForm, settings: Serial) -> None:
        self._inst, self._settings = inst, settings
        self._streams = settings.sensors == "board"
        rate = inst.sensors.sampling_rate
        self.capabilities = Capabilities(
            "serial", inst.axes, rate, self._streams, not self._streams, False, 1 / rate, inst.control.watchdog
        )
        self._controller: BoardController | None = None
        self._bench: _core.StreamedDevice | None = None
        self._lost = 0
        self.round_trip = nan
        """From a tick's question to its answer, s; NaN where the board ticks by itself."""

    @property
    def counts(self) -> dict[str, int]:
        """Number of frames that were lost, damaged or late, by kind."""
        if self._controller is None:
            return {}
        counts = self._controller.link_counts
        return {
            "lost": self._lost,
            "repeated": counts.repetitions,
            "damaged": counts.damaged,
            "stale": counts.stale,
            "damaged on the board": counts.board_damaged,
        }

    def open(self) -> None:
        """Begin a session with the board, its controller disabled.

        Raises DeviceError if there is no such port, no board behind it, or an unsuitable one.
        """
        settings = self._settings
        kind = StreamedController if self._streams else SerialController
        self._controller = kind(
            settings.port,
            self._inst,
            homed=False,
            enabled=False,
            timeout=settings.timeout,
            baud_rate=settings.baud_rate,
        )
        if isinstance(self._controller, StreamedController):
            self._bench = self._controller.device()

    def read(self, timeout: float) -> Measurement | None:
        """Return what the board has measured, or the measurement that it was sent and has answered.

        Raises DeviceError if the link has failed.
        """
        if self._controller is None:
            raise DeviceError("the board is not open; open it first.", key="state", value="closed")
        measured = self._answered(self._controller) if self._bench is None else self._heard(self._bench, timeout)
        if self._controller.problem is not None:
            raise DeviceError(
                f"{self._settings.port}: {self._controller.problem.text}.", key="port", value=self._settings.port
            )
        return measured

    def _answered(self, controller: BoardController) -> Measurement:
        axes = len(self._inst.axes)
        angle, spools = np.zeros(axes), np.zeros((axes, 2))
        tension = np.full((axes, 2), self._inst.pretension)
        began = time.monotonic()
        if axes == 1:
            controller.step(began, angle[0], tension[0], spools[0])
        else:
            controller.step(began, angle, tension, spools)
        now = time.monotonic_ns()
        self.round_trip = now / 1e9 - began
        return Measurement(now, angle, tension, spools, np.full(axes, nan))

    def _heard(self, bench: "_core.StreamedDevice", timeout: float) -> Measurement | None:
        found = bench.read(timeout)
        if found is None:
            return None
        self._lost += bench.overtaken()
        rows = np.array(found[1])
        return Measurement(found[0], rows[:, 0], rows[:, 1:3], rows[:, 3:5], np.full(len(rows), nan))

    def write(self, spool_velocity: Array) -> None:
        """Keep the connection to the board alive; its motors rest, whatever the speed."""
        del spool_velocity
        if self._bench is not None:
            self._bench.rest()

    def close(self) -> None:
        """Stop the board, and release it; a second time does nothing."""
        if self._controller is not None:
            self._controller.close()

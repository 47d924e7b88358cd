"""The live loop of an instrument: its device and controller in a thread of the core, and its queue of orders."""

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core
from tenodesis.control import Controller, Request
from tenodesis.control.controller import ActuationName, LawName
from tenodesis.devices.device import Capabilities, Device
from tenodesis.devices.serial import SerialController, StreamedController
from tenodesis.errors import ArgumentError, DeviceError, LiveError
from tenodesis.instrument import ShortForm
from tenodesis.instrument.devices import Serial
from tenodesis.live import folder as folders
from tenodesis.live.device_thread import DeviceThread
from tenodesis.plant import check_runnable
from tenodesis.run import Array
from tenodesis.simulate.fault_injection import INJECTION_MODES, INJECTION_POINTS, check_mode
from tenodesis.twin import Twin

_RING_SECONDS = 8.0
"""Time by which a reader may fall behind, s."""
ORDERS = tuple(order.name.lower() for order in _core.Order)
"""Orders in the queue of the core's loop, by number."""
_LATE_BOUND = 0.05
"""Delay above which real motors are stopped where the instrument has no watchdog, s."""
_LARGEST_FORCE = 100.0
"""At the tip, N."""

PROBLEMS = (
    None,
    "The load was more than the tip can hold, and was not applied.",
    "A tick came later than the bound, and the motors were stopped: see the timing, then clear or resume.",
    "The device was silent for longer than the bound, and the motors were stopped: look at its cables and power.",
    "The operator went away, and the motors were paused: resume to go on.",
    "The tip is where tissue is to be, which is placed as soon as the tip has left.",
)
"""Problems of the core's loop, by number."""

DeviceName: TypeAlias = Literal["twin", "nidaq", "canopen", "serial"]
Maker: TypeAlias = Callable[[ShortForm], Device]


@dataclass(frozen=True)
class Choices:
    """Options of a loop."""

    device: DeviceName = "twin"
    address: str | None = None
    """Of a serial device."""
    law: LawName = "robust"
    actuation: ActuationName = "differential"
    speed: float = 1.0
    """Simulated over real time; 0: as fast as possible."""
    seed: int = 0
    real_time: bool = True
    """Whether to request real-time scheduling and locked memory."""
    late_bound: float | None = None
    """Delay above which the loop itself stops real motors, s; by default twice the instrument's watchdog."""


def rehearse(inst: ShortForm, choices: Choices) -> None:
    """Check all that can be checked of a loop without its device: instrument, twin, controller, table of the device.

    Raises
    ------
    InstrumentError
        A value of the instrument prevents a loop.
    ArgumentError
        Twin or controller cannot be made.
    DeviceError
        The device does not suit the instrument, or its table is missing.
    """
    check_runnable(inst)
    twin = Twin(inst, seed=choices.seed)
    Controller(inst, law=choices.law, actuation=choices.actuation, period=twin.time_step * twin.steps_per_tick)
    if choices.device not in ("twin", "serial"):
        _check_axes(_made(choices.device, inst).capabilities, inst)


class LiveLoop:
    """The loop of an instrument, from `start` to `finish`; orders take effect with the next tick.

    Parameters
    ----------
    inst
        The instrument; its controller ticks at its sampling rate.
    folder
        Where its ring goes; nothing of that name may be there.
    choices
        Device, law and more.
    device
        A device that Python serves, in place of the one that `choices` names.

    Raises
    ------
    DeviceError
        The device cannot be opened.
    LiveError
        The folder cannot be written.
    ArgumentError
        There is no device of that name.
    """

    def __init__(
        self, inst: ShortForm, folder: Path, choices: Choices | None = None, *, device: Device | None = None
    ) -> None:
        self.inst, self.folder = inst, folder
        self.choices = choices = choices or Choices()
        if choices.device not in get_args(DeviceName):
            raise ArgumentError(key="device", value=choices.device, allowed=_one_of(get_args(DeviceName)))
        self.law, self.actuation = choices.law, choices.actuation
        self._lock = threading.Lock()
        self._device = device
        self._device_thread: DeviceThread | None = None
        if device is None and choices.device not in ("twin", "serial"):
            self._device = _made(choices.device, inst)
        if self._device is not None:
            self._device.open()
        try:
            self._make(choices)
        except BaseException:
            self._close_device()
            raise

    def _make(self, choices: Choices) -> None:
        inst = self.inst
        twin = Twin(inst, seed=choices.seed)
        self.period = twin.time_step * twin.steps_per_tick
        self.controller = _controller(inst, choices, served=self._device is not None)
        live, self.capabilities = self._bench(twin)
        ranges = [one.handle_range for one in (inst.axis(name) for name in inst.axes)]
        path = self.folder / folders.RING
        try:
            self.core = _core.Runtime(
                live,
                self.controller.core,
                str(path),
                round(_RING_SECONDS / self.period),
                ranges,
                self.period,
                choices.speed,
                choices.late_bound or 2 * inst.control.watchdog or _LATE_BOUND,
                choices.real_time,
            )
        except (OSError, RuntimeError) as problem:
            raise LiveError(f"{path} cannot be written: {problem}.") from None

    def _bench(self, twin: Twin) -> tuple[_core.LiveDevice, Capabilities]:
        """Return the device of the core's loop and its capabilities."""
        axes, rate = self.inst.axes, 1 / self.period
        if self._device is not None:
            has = self._device.capabilities
            _check_axes(has, self.inst)
            box = _core.MailboxDevice(len(axes))
            self._device_thread = DeviceThread(self._device, box, self.period)
            return box, has
        if isinstance(self.controller, StreamedController):
            stops_alone = self.inst.control.watchdog
            return self.controller.device(), Capabilities(
                "serial", axes, rate, True, False, False, self.period, stops_alone
            )
        return _core.TwinDevice(twin.cores, twin.time_step, twin.steps_per_tick), Capabilities(
            self.choices.device, axes, rate, False, True, True, self.period, 0.0
        )

    def start(self) -> None:
        """Begin; motors are at rest until the controller is enabled."""
        if self._device_thread is not None:
            self._device_thread.start()
        self.core.start()

    def finish(self) -> None:
        """Stop the motors and end; a second time does nothing."""
        self.core.finish()
        self._close_device()

    def _close_device(self) -> None:
        if self._device_thread is not None:
            self._device_thread.finish()
        elif self._device is not None:
            self._device.close()
        close = getattr(getattr(self, "controller", None), "close", None)
        if close is not None:
            with suppress(DeviceError):
                close()

    @property
    def problem(self) -> str | None:
        """What is wrong with the loop or its device, in a sentence."""
        if self._device_thread is not None and self._device_thread.problem is not None:
            return self._device_thread.problem
        link = getattr(self.controller, "problem", None)
        return PROBLEMS[self.core.problem] if link is None else str(link.text)

    @property
    def unanswered(self) -> int:
        """Measurements of a device to which no answer came in time, so that its motors were commanded to rest."""
        return 0 if self._device_thread is None else self._device_thread.unanswered

    def request(self, what: Request | str) -> None:
        """Send a request to the controller, a :class:`Request` or its name."""
        try:
            asked = Request[what.upper()] if isinstance(what, str) else Request(what)
        except (KeyError, ValueError):
            names = [request.name.lower() for request in Request]
            raise LiveError(key="request", value=what, allowed=_one_of(names)) from None
        self._order("request", int(asked))

    def stop(self) -> None:
        """Stop the motors at once, and pause; enable, resume, home or clear releases them."""
        self.core.stop()

    def choose(self, law: str, actuation: str) -> None:
        """Change compensation law and actuation mode with the next tick."""
        for argument, value, allowed in (("law", law, LawName), ("actuation", actuation, ActuationName)):
            if value not in get_args(allowed):
                raise LiveError(key=argument, value=value, allowed=_one_of(get_args(allowed)))
        self._order("law", get_args(LawName).index(law), get_args(ActuationName).index(actuation))
        self.law, self.actuation = law, actuation  # type: ignore[assignment]

    def hand(self, angles: ArrayLike) -> None:
        """Move the handle to angles, rad, shape (axes,)."""
        self._per_axis("hand", "handle_angle", angles, 10.0)

    def force(self, forces: ArrayLike) -> None:
        """Load the tip tangentially, N, shape (axes,)."""
        self._per_axis("force", "force", forces, _LARGEST_FORCE)

    def radial_force(self, forces: ArrayLike) -> None:
        """Load the tip along the end-effector, N, shape (axes,)."""
        self._per_axis("radial", "radial_force", forces, _LARGEST_FORCE)

    def speed(self, factor: float) -> None:
        """Run simulated time at this multiple of wall time; 0: as fast as possible."""
        if not self.capabilities.simulated:
            raise LiveError("speed can be changed on the twin only: the device keeps real time.")
        if not (factor == 0 or 0.1 <= factor <= 100):
            raise LiveError(key="speed", value=factor, allowed="from 0.1 to 100, or 0 for as fast as possible")
        self._order("speed", value=float(factor))

    def inject_fault(self, point: str, mode: str, value: float, seconds: float, axis: str | None = None) -> None:
        """Inject a fault, as :class:`tenodesis.simulate.FaultInjection` is, from now on for a time, s."""
        if not self.capabilities.simulated:
            raise LiveError("faults can be injected on the twin only.")
        for argument, value_given, allowed in (("point", point, INJECTION_POINTS), ("mode", mode, INJECTION_MODES)):
            if value_given not in allowed:
                raise LiveError(key=argument, value=value_given, allowed=_one_of(allowed))
        check_mode(point, mode)
        if axis is not None and axis not in self.inst.axes:
            raise LiveError(key="axis", value=axis, allowed=_one_of(self.inst.axes))
        if not 0 < seconds <= 3600:
            raise LiveError(key="seconds", value=seconds, allowed="above 0, up to 3600")
        ticks = round(seconds / self.period)
        for n, name in enumerate(self.inst.axes):
            if axis in (None, name):
                place, how = INJECTION_POINTS.index(point), INJECTION_MODES.index(mode)
                self._order("inject_fault", place, how, axis=n, value=float(value), ticks=ticks)

    @property
    def pending(self) -> int:
        """Remaining ticks of a played motion."""
        return self.core.pending_rows

    def push(self, rows: Array) -> int:
        """Append ticks of a played motion, shape (n, axes, 3) or with tissue (n, axes, 6), and return how many fitted.

        A row per tick and axis: handle angle (rad), force and radial force (N); tissue's angle (rad), stiffness (N/m,
        negative in extension) and damping (N s/m).
        """
        with self._lock:
            return self.core.play(np.ascontiguousarray(rows, float))

    def drop(self) -> None:
        """Drop the remaining ticks of a played motion and its tissue; the handle stays where it is."""
        self._order("drop")

    def _per_axis(self, order: str, argument: str, values: ArrayLike, most: float) -> None:
        array = np.asarray(values, float).reshape(-1)
        if array.shape != (len(self.inst.axes),) or not np.all(np.abs(array) <= most):
            allowed = f"{len(self.inst.axes)} finite numbers, at most {most:g}"
            raise LiveError(key=argument, value=np.asarray(values).tolist(), allowed=allowed)
        for n, value in enumerate(array.tolist()):
            self._order(order, axis=n, value=value)

    def _order(self, kind: str, a: int = 0, b: int = 0, *, axis: int = 0, value: float = 0.0, ticks: int = 0) -> None:
        self._given(self.core.order, ORDERS.index(kind), a, b, axis, value, ticks)

    def _given(self, order: Callable[..., Any], *arguments: Any) -> None:
        # The core's queue takes orders from one thread at a time.
        with self._lock:
            taken = order(*arguments)
        if not taken:
            raise LiveError("too many commands at once; this one was refused.")


def _controller(inst: ShortForm, choices: Choices, *, served: bool) -> Controller:
    """Return the controller, disabled; spool angles count from pretension where they are the twin's."""
    if choices.device != "serial" or served:
        return Controller(inst, law=choices.law, actuation=choices.actuation, homed=not served, enabled=False)
    settings = inst.devices.serial or Serial()
    streams = settings.sensors == "board"
    kind = StreamedController if streams else SerialController
    return kind(
        choices.address or settings.port,
        inst,
        law=choices.law,
        actuation=choices.actuation,
        homed=not streams,
        enabled=False,
        # Simulated time may pause, which is no reason for a board without motors to stop.
        silence=None if streams else 10.0,
        timeout=settings.timeout,
        baud_rate=settings.baud_rate,
    )


def _check_axes(has: Capabilities, inst: ShortForm) -> None:
    if has.axes != inst.axes:
        raise DeviceError(f"{has.name} has {' and '.join(has.axes)}; {inst.name} has {' and '.join(inst.axes)}.")


def _made(name: str, inst: ShortForm) -> Device:
    from tenodesis.devices import registry  # noqa: PLC0415 - drivers are needed for their devices alone

    return registry.make(name, inst)


def _one_of(names: Iterable[str]) -> str:
    return f"one of {', '.join(names)}"

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
from tenodesis.control import Controller, JointController, Request
from tenodesis.control.controller import ActuationName, LawName
from tenodesis.control.joints import JointLawName
from tenodesis.control.pairs import names_of
from tenodesis.control.parameters import tension_limit
from tenodesis.devices import registry
from tenodesis.devices.device import Capabilities, Device
from tenodesis.devices.serial import SerialController, StreamedController
from tenodesis.errors import ArgumentError, DeviceError, LiveError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.instrument.devices import Serial
from tenodesis.live import folder as folders
from tenodesis.live.controlled import controlled, free_motors, served_pairs
from tenodesis.live.device_thread import DeviceThread
from tenodesis.live.layout import CommandColumns
from tenodesis.plant import check_runnable
from tenodesis.run import Array
from tenodesis.simulate.fault_injection import INJECTION_MODES, INJECTION_POINTS, check_mode
from tenodesis.statics.chain import coordinates
from tenodesis.twin import Held, Twin
from tenodesis.twin.commands import check_held, grip_error

_RING_SECONDS = 8.0
"""Time by which a reader may fall behind, s."""
ORDERS = tuple(order.name.lower() for order in _core.Order)
"""Orders in the queue of the core's loop, by number."""
_LATE_BOUND = 0.05
"""Delay above which real motors are stopped where the instrument has no watchdog, s."""
_LARGEST_FORCE, _LARGEST_MOMENT = 100.0, 10.0
"""At the tip, N and N m."""
_JOINT_SPEED = 1.5
"""Of joints that motors without a controller move, rad/s."""

PROBLEMS = (
    None,
    "The load was more than the tip can hold, and was not applied.",
    "A tick came later than the bound, and the motors were stopped: see the timing, then clear or resume.",
    "The device was silent for longer than the bound, and the motors were stopped: look at its cables and power.",
    "The operator went away, and the motors were paused: resume to go on.",
    "The tip is where tissue is to be, which is placed as soon as the tip has left.",
    "A motor would have wound a tendon beyond the largest tension, and the motors were stopped: lessen the load.",
    "A sensor beside a motor had no value, and the motors were stopped: look at its cable.",
)
"""Problems of the core's loop, by number."""

DeviceName: TypeAlias = Literal["twin", "nidaq", "canopen", "serial"]


@dataclass(frozen=True)
class Choices:
    """Options of a loop."""

    device: DeviceName = "twin"
    address: str | None = None
    """Of a serial device."""
    law: LawName = "robust"
    """Where no joint has a pair of its own: off, by which spools go where they are ordered, or that of all joints."""
    actuation: ActuationName = "differential"
    speed: float = 1.0
    """Simulated over real time; 0: as fast as possible."""
    seed: int = 0
    real_time: bool = True
    """Whether to request real-time scheduling and locked memory."""
    late_bound: float | None = None
    """Delay above which the loop itself stops real motors, s; by default twice the instrument's watchdog."""


def rehearse(inst: Instrument, choices: Choices) -> None:
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
    assumed, _ = controlled(inst)
    if assumed is inst:
        check_runnable(inst)
    twin = Twin(inst, seed=choices.seed)
    period = twin.time_step * twin.steps_per_tick
    if assumed is None:
        JointController(inst, period=period)
    else:
        Controller(assumed, law=choices.law, actuation=choices.actuation, period=period)
    if choices.device not in ("twin", "serial"):
        _check_device(registry.make(choices.device, inst).capabilities, inst)
    elif choices.device == "serial":
        _check_board(inst)


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
        self, inst: Instrument, folder: Path, choices: Choices | None = None, *, device: Device | None = None
    ) -> None:
        self.inst, self.folder = inst, folder
        self.assumed, self.refused = controlled(inst)
        """What the controller is made for; None where it is that of all joints, and why it is no other."""
        self.choices = choices = choices or Choices()
        if choices.device not in get_args(DeviceName):
            raise ArgumentError(key="device", value=choices.device, allowed=_one_of(get_args(DeviceName)))
        self.laws: tuple[str, ...] = get_args(JointLawName if self.assumed is None else LawName)
        self.law: str = choices.law if choices.law in self.laws else self.laws[-1]
        self.actuation = choices.actuation
        self._lock = threading.Lock()
        self._device = device
        self._device_thread: DeviceThread | None = None
        if device is None and choices.device not in ("twin", "serial"):
            self._device = registry.make(choices.device, inst)
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
        self._spool_radius = twin.spool_radius
        own = served_pairs(inst)
        self.axes = tuple(own)
        """Axes that the controller compensates."""
        self.motors = free_motors(inst)
        """Tendons whose motors no controller commands, by number."""
        self.controller = _controller(self.assumed, choices, inst, served=self._device is not None)
        self.device, self.capabilities = self._bench(twin)
        core = self.controller.core
        if isinstance(core, _core.JointController):
            joints = _core.LiveJoints(self.device, core, self.period)
            joints.compensates = self.law != "off"
            self.device, core = joints, _core.JointSwitch(joints)
        self.commands = CommandColumns(self.device.commands)
        path = self.folder / folders.RING
        try:
            self.core = _core.Runtime(
                self.device,
                core,
                [tuple(pair[1:]) for pair in own.values()],
                self.motors,
                str(path),
                round(_RING_SECONDS / self.period),
                [joint.range for joint in inst.handle_joints],
                self.period,
                choices.speed,
                choices.late_bound or 2 * inst.control.watchdog or _LATE_BOUND,
                self._motor_speed,
                tension_limit(inst),
                choices.real_time,
            )
        except (OSError, RuntimeError) as problem:
            raise LiveError(f"{path} cannot be written: {problem}.", key="path", value=path) from None

    @property
    def _motor_speed(self) -> float:
        """Largest speed of spools that no controller commands, rad/s."""
        drives, arms = self.inst.drives, np.abs(self.inst.tendon_arms("tip"))
        return min(drives.motor_speed / drives.gear_ratio, _JOINT_SPEED * float(arms.max()) / self._spool_radius)

    def _bench(self, twin: Twin) -> tuple[_core.LiveDevice, Capabilities]:
        """Return the device of the core's loop and its capabilities."""
        inst, rate, joints = self.inst, 1 / self.period, names_of(self.inst).joints
        if self._device is not None:
            has = self._device.capabilities
            _check_device(has, inst)
            sizes = len(inst.tip_joints), len(inst.handle_joints), len(inst.tendons)
            box = _core.MailboxDevice(*sizes, has.distal_encoder, has.holds_tension)
            self._device_thread = DeviceThread(self._device, box, self.period)
            return box, has
        if isinstance(self.controller, StreamedController):
            stops_alone = inst.control.watchdog
            return self.controller.device(), Capabilities(
                "serial", joints, rate, True, False, False, self.period, stops_alone
            )
        return twin.live_device, Capabilities(self.choices.device, joints, rate, False, True, True, self.period, 0.0)

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
        for argument, value, allowed in (("law", law, self.laws), ("actuation", actuation, get_args(ActuationName))):
            if value not in allowed:
                raise LiveError(key=argument, value=value, allowed=_one_of(allowed))
        self._order("law", self.laws.index(law), get_args(ActuationName).index(actuation))
        self.law, self.actuation = law, actuation  # type: ignore[assignment]

    def hand(self, angles: ArrayLike) -> None:
        """Move the handle's joints or, without a handle, those at the tip by their motors, to angles, rad."""
        inst = self.inst
        array = _numbers("handle_angle", angles, len(inst.handle_joints or inst.bends), 10.0)
        if inst.handle_joints:
            self._each("hand", enumerate(array.tolist()))
            return
        within = inst.bent(array.clip(*inst.bend_limits.T))
        arms = inst.tendon_arms("tip") @ coordinates(inst.tip_joints, within)[0]
        self._each("motor", ((tendon, float(arms[tendon]) / self._spool_radius) for tendon in self.motors))

    def move_motors(self, angles: ArrayLike) -> None:
        """Turn the spools whose motors no controller commands to angles, rad, shape (motors,)."""
        if not self.motors:
            raise LiveError(
                f"{self.inst.name} has no motors but those that its controller commands.", key="spool_velocities"
            )
        array = _numbers("angles", angles, len(self.motors), 100.0)
        self._each("motor", zip(self.motors, array.tolist(), strict=True))

    def force(self, force: ArrayLike) -> None:
        """Load the tip tangentially, N, shape (axes,)."""
        self._load("force", force, _LARGEST_FORCE)

    def radial_force(self, force: ArrayLike) -> None:
        """Load the tip along the end-effector, N, shape (axes,)."""
        self._load("radial_force", force, _LARGEST_FORCE)

    def wrench(self, wrench: ArrayLike) -> None:
        """Load the tip with a force (N) and a moment (N m) in its axes, shape (6,)."""
        self._load("wrench", wrench, np.repeat([_LARGEST_FORCE, _LARGEST_MOMENT], 3))

    def grip_force(self, force: float) -> None:
        """Press the jaws apart with a force, N."""
        if self.inst.grip is None:
            raise grip_error("grip_force", self.inst)
        self._load("grip_force", force, _LARGEST_FORCE)

    def hold(self, held: Held | None, output_angle: ArrayLike) -> None:
        """Put something between jaws whose joints are at angles, rad, or take it away."""
        if self.inst.grip is None:
            raise grip_error("held", self.inst)
        check_held(held, None, float(self.inst.grip_arms @ np.asarray(output_angle)))
        opening, stiffness, damping = held or (0.0, 0.0, 0.0)
        first = self.commands.columns["held"].start if "held" in self.commands else None
        if first is None:
            raise self._without("held")
        # The stiffness comes last and goes first: the jaws never press what is not there.
        values = ((first, opening), (first + 2, damping), (first + 1, stiffness))
        self._each("load", values if stiffness else values[::-1])

    def speed(self, factor: float) -> None:
        """Run simulated time at this multiple of wall time; 0: as fast as possible."""
        if not self.capabilities.simulated:
            raise LiveError(
                "speed can be changed on the twin only: the device keeps real time.",
                key="speed",
                allowed="left alone: the device keeps real time",
            )
        if not (factor == 0 or 0.1 <= factor <= 100):
            raise LiveError(key="speed", value=factor, allowed="from 0.1 to 100, or 0 for as fast as possible")
        self._order("speed", value=float(factor))

    def inject_fault(self, point: str, mode: str, value: float, seconds: float, axis: str | None = None) -> None:
        """Inject a fault, as :class:`tenodesis.simulate.FaultInjection` is, from now on for a time, s."""
        if not self.capabilities.simulated:
            raise LiveError(
                "faults can be injected on the twin only.", key="fault", allowed="injected on the twin only"
            )
        for argument, value_given, allowed in (("point", point, INJECTION_POINTS), ("mode", mode, INJECTION_MODES)):
            if value_given not in allowed:
                raise LiveError(key=argument, value=value_given, allowed=_one_of(allowed))
        check_mode(point, mode)
        if self.refused is not None:
            raise LiveError("the law of all joints takes no injected faults.", key="fault")
        if axis is not None and axis not in self.axes:
            raise LiveError(key="axis", value=axis, allowed=_one_of(self.axes))
        if not 0 < seconds <= 3600:
            raise LiveError(key="seconds", value=seconds, allowed="above 0, up to 3600")
        ticks = round(seconds / self.period)
        for n, name in enumerate(self.axes):
            if axis in (None, name):
                place, how = INJECTION_POINTS.index(point), INJECTION_MODES.index(mode)
                self._order("inject_fault", place, how, at=n, value=float(value), ticks=ticks)

    @property
    def pending(self) -> int:
        """Remaining ticks of a played motion."""
        return self.core.pending_rows

    def push(self, rows: Array) -> int:
        """Append ticks of a played motion, rows of :attr:`commands`, shape (n, width), and return how many fitted."""
        with self._lock:
            return self.core.play(np.ascontiguousarray(rows, float))

    def drop(self) -> None:
        """Drop the rest of a played motion, tissue and what the jaws hold; the handle stays where it is."""
        self._order("drop")

    def _load(self, name: str, values: ArrayLike, most: float | Array) -> None:
        columns = self.commands.columns.get(name)
        if columns is None:
            raise self._without(name)
        array = _numbers(name, values, columns.stop - columns.start, most)
        self._each("load", enumerate(array.tolist(), columns.start))

    def _without(self, name: str) -> LiveError:
        loads = [one for one in ("force", "radial_force", "wrench", "grip_force") if one in self.commands]
        instead = (
            f"it takes {', '.join(loads)}" if loads else f"{self.capabilities.name} has nothing that loads the tip"
        )
        return LiveError(f"{name} cannot be given to {self.inst.name}: {instead}.", key=name)

    def _each(self, order: str, values: Iterable[tuple[int, float]]) -> None:
        for at, value in values:
            self._order(order, at=at, value=value)

    def _order(self, kind: str, a: int = 0, b: int = 0, *, at: int = 0, value: float = 0.0, ticks: int = 0) -> None:
        self._given(self.core.order, ORDERS.index(kind), a, b, at, value, ticks)

    def _given(self, order: Callable[..., Any], *arguments: Any) -> None:
        # The core's queue takes orders from one thread at a time.
        with self._lock:
            taken = order(*arguments)
        if not taken:
            raise LiveError("too many commands at once; this one was refused.")


def _controller(
    assumed: ShortForm | None, choices: Choices, inst: Instrument, *, served: bool
) -> Controller | JointController:
    """Return the controller, disabled; spool angles count from pretension where they are the twin's."""
    if choices.device == "serial" and not served:
        return _board(_check_board(inst), choices)
    if assumed is None:
        return JointController(inst, enabled=False)
    return Controller(assumed, law=choices.law, actuation=choices.actuation, homed=not served, enabled=False)


def _board(inst: ShortForm, choices: Choices) -> SerialController | StreamedController:
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


def _check_board(inst: Instrument) -> ShortForm:
    """Return what the controller on a board is made for; raise DeviceError where a board cannot serve."""
    assumed = registry.on_board(inst)
    if len(assumed.axes) != len(inst.tip_joints) and (inst.devices.serial or Serial()).sensors == "board":
        raise DeviceError(
            f"a board with sensors and motors of its own serves {' and '.join(assumed.axes)}; {inst.name} has "
            f'{", ".join(joint.name for joint in inst.tip_joints)}: give devices.serial.sensors = "twin".',
            key="devices.serial.sensors",
            value="board",
            allowed='"twin"',
        )
    return assumed.model_copy(update={"devices": inst.devices})


def _check_device(has: Capabilities, inst: Instrument) -> None:
    axes = names_of(inst).joints
    if has.axes != axes:
        raise DeviceError(
            f"{has.name} has {' and '.join(has.axes)}; {inst.name} has {' and '.join(axes)}.",
            key="axes",
            value=has.axes,
            allowed=" and ".join(axes),
        )


def _numbers(argument: str, values: ArrayLike, count: int, most: float | Array) -> Array:
    """Return so many numbers, each of which is finite and at most its bound."""
    array = np.asarray(values, float).reshape(-1)
    if array.shape != (count,) or not np.all(np.abs(array) <= most):
        bound = f"{most:g}" if np.ndim(most) == 0 else " or ".join(f"{one:g}" for one in np.unique(most)[::-1])
        amount = "a finite number" if count == 1 else f"{count} finite numbers"
        allowed = f"{amount} of magnitude {bound} at most"
        raise LiveError(key=argument, value=np.asarray(values).tolist(), allowed=allowed)
    return array


def _one_of(names: Iterable[str]) -> str:
    return f"one of {', '.join(names)}"

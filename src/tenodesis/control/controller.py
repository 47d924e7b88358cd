"""The controller of the core, one tick at a time, for any plant."""

from __future__ import annotations

from enum import IntEnum
from math import isfinite
from typing import Any, Literal, NamedTuple, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core
from tenodesis.control.pairs import compensated
from tenodesis.control.parameters import FAULTS, HOMING_REASONS, parameters, safe_state
from tenodesis.control.resolution import check_force_limit
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike

ObserverName: TypeAlias = Literal["paper", "exact", "friction"]
"""How the tip is estimated: by eq. 19 as printed, by the exact statics, or with friction."""
LawName: TypeAlias = Literal["off", "paper", "paper-feedback", "exact", "robust"]
"""How the motors are commanded; docs/controller.md says when to use which."""
ActuationName: TypeAlias = Literal["agonist", "differential"]
Precision: TypeAlias = Literal["double", "single"]

_SIGNALS = _core.control_signals()
_CHANNELS = ("handle_angle", "tension.agonist", "tension.antagonist", "spool_angle.agonist", "spool_angle.antagonist")
_LATEST = 2**63 / 1e9  # s


class OperatingState(IntEnum):
    """State of the controller, as in the Collaborative Robotics Toolkit."""

    DISABLED = 0
    ENABLED = 1
    PAUSED = 2
    FAULT = 3


class Request(IntEnum):
    """Requests that a controller takes."""

    NONE = 0
    ENABLE = 1
    DISABLE = 2
    PAUSE = 3
    RESUME = 4
    HOME = 5
    CLEAR = 6


class Output(NamedTuple):
    """Result of one tick: floats, or with two axes arrays of shape (2,)."""

    spool_velocity: NDArray[np.float64]
    """To send to the drives, rad/s, agonist and antagonist: shape (2,), with two axes (2, 2)."""
    output_angle: Any
    """rad"""
    output_angle_std: Any
    """rad; NaN, as the other deviations, from an observer that estimates none"""
    tip_force: Any
    """N; positive against positive flexion"""
    tip_force_std: Any
    friction_scale: Any
    """Estimated friction over that of the instrument file"""
    friction_scale_std: Any
    state: OperatingState
    faults: tuple[str, ...]
    """Names of the latched faults; outside a fault, of the conditions that hold now"""
    first_faults: tuple[str, ...]
    """Names of the faults that came first"""
    homed: bool
    homing: bool
    homing_failure: Any
    """Why the last homing failed, as of :func:`homing_failure`; with two axes a tuple of two"""
    cut_power: bool
    """Whether a motor does not obey, so that a relay in the supply of the motors must open"""


class FlightRecord(NamedTuple):
    """The last moments before a fault, and a few after, by record (n,), axis and tendon."""

    time: NDArray[np.float64]
    state: NDArray[np.int64]
    faults: NDArray[np.int64]
    """Masks of bits, :data:`FAULTS` in order."""
    handle_angle: NDArray[np.float64]
    tension: NDArray[np.float64]
    spool_angle: NDArray[np.float64]
    spool_velocity: NDArray[np.float64]
    output_angle: NDArray[np.float64]
    fault_row: int | None
    """Row of the fault's first tick; None without a fault."""


class LoopState:
    """What a controller in a loop knows of its plant, and the request that waits."""

    _ran: tuple[object, float] | None = None

    def __init__(self, *, enabled: bool) -> None:
        self.enabled_at_start = bool(enabled)
        self.forget()

    def forget(self) -> None:
        """Return to the start."""
        self._request = Request.ENABLE if self.enabled_at_start else Request.NONE
        self._ran = None

    def begin(self, plant: object, time: float) -> None:
        """Begin, or continue, a run on a plant at its time, s.

        Raises
        ------
        ValueError
            It has run on another plant, or on this one up to a later time, and was not reset: its observer would take
            one plant's state for the other's.
        """
        if self._ran is not None:
            before, until = self._ran
            if before is not plant or time < until * (1 - 1e-12):
                where = "on another plant" if before is not plant else f"on this plant, to {until:.6g} s,"
                raise ArgumentError(
                    f"the controller has run {where} before; call its reset(), or make a new one, for a run from "
                    f"{time:.6g} s on.",
                    key="controller",
                    allowed="a controller that is new or reset",
                )
        self._ran = plant, time

    def ask(self, request: Request | str) -> None:
        """Make a request with the next tick: a :class:`Request` or its name."""
        self._request = as_request(request)

    def take_request(self) -> Request:
        """Return the request for the next tick, and forget it."""
        asked, self._request = self._request, Request.NONE
        return asked


class Controller(LoopState):
    """A controller for an instrument and any plant: the twin, a bench, another simulator.

    Parameters
    ----------
    inst
        The instrument, of which it serves the joints with a pair of tendons of their own (:func:`pairs`); its table
        control has the set points, its table friction the observer's first guess.
    observer
        Estimates the output angle: ``paper`` (eq. 19), ``exact`` (with slack and motors), ``friction``.
    law
        Commands the motors: ``off``, ``paper`` (eq. 22 as a set point), ``paper-feedback`` (the pseudo-error of Fig. 12
        winds the spools), ``exact``, ``robust`` (needs the friction observer).
    actuation
        ``agonist``: one motor; ``differential``: both.
    homed
        Whether spool angles count from where both tendons have their pretension at a straight handle. If not, it must
        be homed first; it does not compensate before.
    enabled
        Whether the first tick enables it.
    precision
        ``single`` computes as a microcontroller does.
    period
        Nominal time between ticks, s; by default the instrument's sampling period.
    own_clock
        Whether ticks count as one period each, whatever time is given.

    Raises
    ------
    ValueError
        A choice is unknown, the robust law has another observer, the load cells do not resolve the instrument's
        force_limit, no joint has a pair of its own, or the core refuses the parameters.
    """

    def __init__(
        self,
        inst: InstrumentLike,
        observer: ObserverName = "friction",
        law: LawName = "robust",
        actuation: ActuationName = "differential",
        *,
        homed: bool = True,
        enabled: bool = True,
        precision: Precision = "double",
        period: float | None = None,
        own_clock: bool = False,
    ) -> None:
        inst = compensated(inst)
        chosen_observer = _choice("observer", observer, ObserverName)
        chosen_law = _choice("law", law, LawName)
        chosen_actuation = _choice("actuation", actuation, ActuationName)
        single = _choice("precision", precision, Precision) == 1
        if law == "robust" and observer != "friction":
            problem = f'law is "robust" and observer "{observer}"; it must be "friction" with that law.'
            raise ArgumentError(problem, key="observer", value=observer, allowed="friction")
        if period is not None and not (isfinite(period) and 0 < period < 1):
            raise ArgumentError(key="period", value=period, allowed="a time above 0 and below 1 s")
        check_force_limit(inst)
        self.inst = inst
        self.observer, self.law, self.actuation = observer, law, actuation
        self.precision, self.own_clock = precision, bool(own_clock)
        super().__init__(enabled=enabled)
        self.homed_at_start = bool(homed)
        self.parameters = parameters(inst, period)
        after_fault = ("hold", "neutral").index(safe_state(inst))
        stop = ("return", "hold").index(inst.control.stop)
        observe = ("strokes", "dither", "auto").index(inst.control.observe)
        common, axes, limits = self.parameters.rows()
        try:
            self.core = _core.Controller(
                self.parameters.joint_type,
                chosen_observer,
                chosen_law,
                chosen_actuation,
                after_fault,
                stop,
                observe,
                own_clock,
                homed,
                common,
                axes,
                limits,
                single,
            )
        except (ValueError, RuntimeError):
            raise ArgumentError(
                f"the parameters of {inst.name} make no controller; its pretension must be below the tension_limit of "
                f"{self.parameters.axes[0]['tension_limit']:g} N, its joints must leave length to the stem, and the "
                "exponents of its contacts (friction coefficient times bend) must add up to 4 at most.",
                key="inst",
                value=inst.name,
            ) from None

    def __repr__(self) -> str:
        return (
            f"<Controller for {self.inst.name!r}: {self.observer} observer, {self.law} law, {self.actuation}, "
            f"{self.precision} precision>"
        )

    def step(
        self,
        time: float,
        handle_angle: ArrayLike,
        tensions: ArrayLike,
        spool_angles: ArrayLike,
        request: Request | str = Request.NONE,
    ) -> Output:
        """Step the controller by one tick.

        Parameters
        ----------
        time
            Of the measurements, s, from any start; 0 or more.
        handle_angle
            rad; with two axes shape (2,).
        tensions
            Beside the spools, agonist and antagonist, N; shape (2,), with two axes (2, 2), axis before tendon.
        spool_angles
            rad, positive winds; as tensions.
        request
            Request of this tick, a :class:`Request` or its name; :meth:`ask` queues one too.

        Raises
        ------
        ValueError
            A shape, the time or the request is wrong. Measurements may have any value, NaN included: that is a fault,
            not an error.
        """
        if not (isfinite(time) and 0 <= time < _LATEST):
            raise ArgumentError(key="time", value=time, allowed="a number of seconds, 0 or more")
        asked = as_request(request)
        self._ran = None, time
        axes = len(self.inst.axes)
        measured = np.empty((axes, 5))
        measured[:, :1] = _shaped("handle_angle", handle_angle, axes, 1)
        measured[:, 1:3] = _shaped("tensions", tensions, axes, 2)
        measured[:, 3:] = _shaped("spool_angles", spool_angles, axes, 2)
        if asked == Request.NONE:
            asked = self.take_request()
        rows, _, state, homed, homing, faults, first, cut_power = self.core.step(
            round(time * 1e9), int(asked), measured
        )
        table = np.array(rows)
        signals = {name: table[:, n] if axes > 1 else float(table[0, n]) for n, name in enumerate(_SIGNALS)}
        failures = tuple(homing_failure(int(word)) for word in table[:, _SIGNALS.index("homing_failure")])
        sent = table[:, _SIGNALS.index("commanded_spool_velocity.agonist") :][:, :2]
        return Output(
            sent if axes > 1 else sent[0],
            signals["estimated_output_angle"],
            signals["estimated_output_angle_std"],
            signals["estimated_force"],
            signals["estimated_force_std"],
            signals["friction_scale"],
            signals["friction_scale_std"],
            OperatingState(state),
            fault_names(faults),
            fault_names(first),
            homed,
            homing,
            failures if axes > 1 else failures[0],
            cut_power,
        )

    def choose(self, law: LawName, actuation: ActuationName | None = None) -> None:
        """Change the law, and the actuation, from the next tick on; ``off`` lets the motors return home.

        Raises
        ------
        ValueError
            There is no such choice, or the law does not work with the observer.
        """
        actuation = self.actuation if actuation is None else actuation
        chosen = _choice("law", law, LawName), _choice("actuation", actuation, ActuationName)
        if not self.core.choose(*chosen):
            raise ArgumentError(key="law", value=law, allowed="a law that works with the observer")
        self.law, self.actuation = law, actuation

    def reset(self) -> None:
        """Return to the state in which it was made."""
        self.core.reset()
        self.forget()

    def counts(self, axis: str | None = None) -> dict[str, dict[str, int]]:
        """Return how often each fault was confirmed, and each sensor's bad samples, by default of the first axis.

        Raises
        ------
        ValueError
            There is no such axis.
        """
        faults, bad, late = self.core.counts(self._number_of(axis))
        return {
            "faults": dict(zip(FAULTS, faults, strict=True)),
            "bad_samples": dict(zip(_CHANNELS, bad, strict=True)),
            "ticks": {"late": late},
        }

    def wound(self, axis: str | None = None) -> float:
        """Return how far motors hold the tip from where it is with spools at home, rad, by default of the first axis.

        Raises
        ------
        ValueError
            There is no such axis.
        """
        return self.core.wound(self._number_of(axis))

    def _number_of(self, axis: str | None) -> int:
        if axis is not None and axis not in self.inst.axes:
            raise ArgumentError(key="axis", value=axis, allowed=f"one of {', '.join(self.inst.axes)}")
        return 0 if axis is None else self.inst.axes.index(axis)

    def flight_record(self) -> FlightRecord:
        """Return the flight recorder's records: the last 200 ms at 2 kHz, frozen by a fault until it is cleared."""
        rows, place = self.core.records()
        axes = len(self.inst.axes)
        table = np.array(rows).reshape(len(rows), 3 + 8 * axes)
        own = table[:, 3:].reshape(len(rows), axes, 8)
        shaped = own[:, 0] if axes == 1 else own
        return FlightRecord(
            table[:, 0],
            table[:, 1].astype(np.int64),
            table[:, 2].astype(np.int64),
            shaped[..., 0],
            shaped[..., 1:3],
            shaped[..., 3:5],
            shaped[..., 5:7],
            shaped[..., 7],
            None if place < 0 else place,
        )

    def check_instrument(self, inst: InstrumentLike) -> None:
        """Check that a plant's instrument has the axes and joints that the controller is for.

        Raises
        ------
        ValueError
            It has others.
        """
        inst = compensated(inst)
        if inst.axes != self.inst.axes or inst.joint_type != self.inst.joint_type:
            raise ArgumentError(
                f"the controller is for {' and '.join(self.inst.axes)} of a {self.inst.joint_type}; the twin must be "
                f"of such an instrument, not {' and '.join(inst.axes)} of a {inst.joint_type}.",
                key="controller",
            )


def fault_names(mask: int) -> tuple[str, ...]:
    """Return the names of the faults in a mask of bits."""
    return tuple(name for n, name in enumerate(FAULTS) if mask >> n & 1)


def homing_failure(word: int) -> str:
    """Return a value of the signal ``homing_failure`` in words: ``"tip_loaded"``, ``"motor_dead.agonist"``, ``""``."""
    reason, tendon = tuple(HOMING_REASONS)[word & 255], word >> 8
    return ("" if not word else reason) + ("", ".agonist", ".antagonist")[tendon]


def _choice(argument: str, value: str, choices: Any) -> int:
    allowed = get_args(choices)
    if value not in allowed:
        raise ArgumentError(key=argument, value=value, allowed=f"one of {', '.join(allowed)}")
    return allowed.index(value)


def as_request(request: Request | str) -> Request:
    """Return a request by itself or its name; raises ArgumentError if there is none."""
    try:
        return Request[request.upper()] if isinstance(request, str) else Request(request)
    except (KeyError, ValueError):
        names = ", ".join(name.lower() for name in Request.__members__)
        raise ArgumentError(key="request", value=request, allowed=f"one of {names}") from None


def _shaped(argument: str, value: ArrayLike, axes: int, columns: int) -> NDArray[np.float64]:
    array = np.asarray(value, float)
    shape = tuple(size for size, needed in ((axes, axes > 1), (columns, columns > 1)) if needed)
    if array.shape != shape:
        problem = f"{argument} has shape {array.shape}; it must be {shape}."
        raise ArgumentError(problem, key=argument, value=array.shape, allowed=str(shape))
    return array.reshape(axes, columns)

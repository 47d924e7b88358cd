"""The twin of a coupled instrument in time: friction at every bend of its tendons, inertia of links, jaws that grip."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import _core, plant
from tenodesis._core import Status
from tenodesis.control import Controller, Request
from tenodesis.coupled.axes import pairs
from tenodesis.coupled.description import CoupledInstrument
from tenodesis.coupled.reading import CoupledLike, load
from tenodesis.coupled.rows import twin_rows
from tenodesis.coupled.statics import Axes
from tenodesis.errors import ArgumentError, NoSolutionError
from tenodesis.run import TENDONS, Array, Names, Run
from tenodesis.statics.query import common_shape, numbers, place
from tenodesis.twin.rows import CONTROL, check_seed
from tenodesis.twin.twin import Energy

_OF_CONTROLLER = tuple(name for name in CONTROL if "." not in name)
_LEFT_OUT = ("contact_force", "sweeps")
"""Signals of the core that are not kept."""


class Held(NamedTuple):
    """What the jaws hold: a spring that they press."""

    opening: float
    """Opening of the jaws, by the arms of the grip and their angles, below which they press it, m"""
    stiffness: float
    """N/m"""
    damping: float = 0.0
    """N s/m"""


class Twin:
    """The twin of a coupled instrument, at rest with straight joints and tendons at their pretension at first.

    Time step in s; the sensors' noise has a seed from 0 to 2**64 - 1. A quasi-static twin leaves inertia and damping
    out: every step ends at rest.

    Raises
    ------
    ArgumentError
        The time step is too long for the fastest oscillation or does not divide the sampling period, or the seed is
        invalid.
    """

    def __init__(
        self, inst: CoupledLike, *, time_step: float = plant.TIME_STEP, seed: int = 0, quasi_static: bool = False
    ) -> None:
        check_seed(seed)
        self.inst: CoupledInstrument = load(inst)
        self.time_step = time_step
        self.quasi_static = quasi_static
        rows = twin_rows(self.inst, time_step, quasi_static)
        self.core = _core.WristTwin(
            self.inst.core,
            rows.passages,
            rows.contacts,
            rows.segments,
            rows.links,
            rows.load_cells,
            rows.rig,
            rows.parameters,
            rows.law,
            rows.steps_per_sample,
            quasi_static,
            self.inst.sensors.kind == "current",
            int(seed),
        )
        self._steps_per_tick = rows.steps_per_sample
        self._pairs = pairs(self.inst)
        self._steps = 0
        self._angles = np.zeros(len(self.inst.tip_joints))
        self._held: Held | None = None
        self.names = names_of(self.inst)
        self._signals: list[tuple[str, int]] = self.core.signals
        self._width = sum(width for _, width in self._signals)

    @property
    def spool_radius(self) -> float:
        """Radius of the spools, m."""
        return self.inst.spool_radius or self.inst.drives.spool_radius

    @property
    def time(self) -> float:
        """Time simulated since the start, s."""
        return self._steps * self.time_step

    def __repr__(self) -> str:
        kind = "quasi-static" if self.quasi_static else "dynamic"
        return f"<Twin of {self.inst.name!r} at {self.time:.6g} s, {kind} steps of {self.time_step:g} s>"

    def run(
        self,
        handle_angle: ArrayLike,
        wrench: ArrayLike = 0.0,
        *,
        grip_force: ArrayLike = 0.0,
        spool_velocity: ArrayLike = 0.0,
        held: Held | None = None,
        axes: Axes = "tip",
        controller: Controller | None = None,
        request: ArrayLike = 0,
    ) -> Run:
        """Step over arrays of commands, from the present state, and return the signals, one row per step.

        Parameters
        ----------
        handle_angle
            Of the handle's joints, or the hand's aim if the hand has a stiffness, (n, handle joints), rad; 0 for all.
        wrench
            Force (N) and moment (N m) on the tip, (n, 6) or (6,): x, y, z of either.
        grip_force
            Force that presses the jaws apart, N, (n,) or a number.
        spool_velocity
            Spool velocities commanded, rad/s, (n, tendons) or (tendons,).
        held
            What the jaws hold, for the whole call; it stays in place if the next call has the same.
        axes
            "tip": the wrench turns with the end-effector, z along it; "stem": it keeps its direction.
        controller
            Closes the loop over the joints with a pair of tendons of their own: a controller made for
            :func:`compensated`. Other motors follow spool_velocity.
        request
            Request to the controller at each step, values of :class:`tenodesis.control.Request`; shape (n,).

        Raises
        ------
        ArgumentError
            A command is not finite or does not fit the instrument, the jaws are too narrow for what is put between, or
            the controller is for another instrument, or has run elsewhere and was not reset.
        NoSolutionError
            The load is more than the tendons can hold; the twin is then in its state before the call.
        """
        commands, given = self._commands(handle_angle, wrench, grip_force, spool_velocity, held, axes)
        out = np.empty((len(commands), self._width))
        controlled: dict[str, Array] = {}
        if controller is None:
            self._advance(out, lambda: self.core.run(commands, out, None))
        else:
            controlled = self._closed(controller, request, commands, out)
        first = self._steps - len(commands) + 1
        time = np.arange(first, first + len(commands), dtype=np.float64) * self.time_step
        ends = np.cumsum([width for _, width in self._signals]).tolist()
        kept = {
            name: out[:, end - width : end]
            for (name, width), end in zip(self._signals, ends, strict=True)
            if name not in _LEFT_OUT
        }
        signals = given | kept | controlled
        shape = self.names.shape
        shaped: dict[str, Any] = {name: values.reshape(shape(name, len(time))) for name, values in signals.items()}
        return Run(time, *self.names, **shaped)

    def _closed(self, controller: Controller, request: ArrayLike, commands: Array, out: Array) -> dict[str, Array]:
        """Step with a controller in the loop and return its signals."""
        if not self._pairs or set(controller.inst.axes) != set(self._pairs):
            raise ArgumentError(
                f"the controller is for {' and '.join(controller.inst.axes)}; it must be for "
                f"{' and '.join(self._pairs) or 'nothing'} of {self.inst.name}, as one of "
                "Controller(tn.coupled.compensated(inst)) is.",
                key="controller",
            )
        asked = np.asarray(request)
        if asked.dtype.kind not in "iu" or not np.isin(asked, list(Request)).all():
            raise ArgumentError(key="request", value=request, allowed="values of Request, 0 to 6")
        requests = np.array(np.broadcast_to(asked, len(commands)), np.uint8)
        controller.begin(self, self.time)
        pending = controller.take_request()
        if len(commands) and not requests[0]:
            requests[0] = pending
        axes = [tuple(self._pairs[axis][1:]) for axis in controller.inst.axes]
        control = np.empty((len(commands), len(axes), len(CONTROL)))
        core, steps = controller.core, self._steps
        self._advance(
            out,
            lambda: self.core.run_controlled(
                core,
                axes,
                commands,
                self._steps_per_tick,
                self.time_step,
                np.inf,
                steps,
                requests,
                None,
                None,
                out,
                control,
            ),
        )
        controller.begin(self, self.time)
        velocity = commands[:, len(self.inst.handle_joints) :][:, : len(self.inst.tendons)].copy()
        sent = [CONTROL.index(f"commanded_spool_velocity.{side}") for side in TENDONS]
        for n, (_, *tendons) in enumerate(axes):
            velocity[:, tendons] = control[:, n, sent]
        named = {name: control[:, :, CONTROL.index(name)] for name in _OF_CONTROLLER}
        return {"commanded_spool_velocity": velocity, **named}

    def energy(
        self,
        handle_angles: ArrayLike,
        wrench: ArrayLike = 0.0,
        *,
        grip_force: ArrayLike = 0.0,
        spool_velocity: ArrayLike = 0.0,
        held: Held | None = None,
        axes: Axes = "tip",
    ) -> Energy:
        """Step over arrays of commands and return the energy balance, J; otherwise as :meth:`run`."""
        commands, _ = self._commands(handle_angles, wrench, grip_force, spool_velocity, held, axes)
        out = np.empty((len(commands), self._width))
        totals = np.zeros(len(_core.wrist_energies()))
        self._advance(out, lambda: self.core.run(commands, out, totals))
        before, after, handle, spools, load, friction, damping, tissue, least, residual, sweeps = totals.tolist()
        return Energy(before, after, handle, spools, load, friction, damping, tissue, least, residual, int(sweeps))

    def _advance(self, out: Array, step: Callable[[], tuple[int, Status]]) -> None:
        before = self.core.copy()
        steps, status = step()
        if status != Status.OK:
            self.core = before
            raise _lost(self.inst, Status(status), f"step {steps} ({self.time + steps * self.time_step:.6g} s)")
        self._steps += len(out)
        if len(out):
            self._angles = out[-1, : len(self._angles)].copy()

    def _place(self, held: Held | None) -> Held:
        """Return what the jaws hold, put between them if it is new."""
        if held is None:
            self._held = None
            return Held(0.0, 0.0)
        if not isinstance(held, Held):
            raise TypeError(f"held is {held!r}; it must be a Held.")
        for name, value in held._asdict().items():
            if not np.isfinite(value) or (name != "opening" and value < 0):
                allowed = "a finite number" if name == "opening" else "a finite number that is not negative"
                raise ArgumentError(key=f"held.{name}", value=value, allowed=allowed)
        opening = float(self.inst.grip_arms @ self._angles)
        if held != self._held and held.opening > opening + 1e-12:
            allowed = f"at most {opening:.4g} m, to which the jaws are open"
            raise ArgumentError(key="held.opening", value=held.opening, allowed=allowed)
        self._held = held
        return held

    def _commands(  # noqa: PLR0917
        self,
        handle_angles: ArrayLike,
        wrench: ArrayLike,
        grip_force: ArrayLike,
        spool_velocity: ArrayLike,
        held: Held | None,
        axes: Axes,
    ) -> tuple[Array, dict[str, Array]]:
        """Return the core's rows of commands, and the signals that they are."""
        inst = self.inst
        if axes not in ("tip", "stem"):
            raise ArgumentError(key="axes", value=axes, allowed="tip or stem")
        grip = numbers("grip_force", grip_force)
        if inst.grip is None and (np.any(grip) or held is not None):
            key = "held" if held is not None else "grip_force"
            raise ArgumentError(
                f"{key} is given, but {inst.name} has nothing that grips; its file must have a table [grip] with the "
                "jaws.",
                key=key,
                allowed="nothing without a table [grip]",
            )
        given = {
            "handle_angle": _rows("handle_angle", handle_angles, len(inst.handle_joints)),
            "wrench": _rows("wrench", wrench, 6),
            "grip_force": grip[..., np.newaxis],
            "spool_velocity": _rows("spool_velocity", spool_velocity, len(inst.tendons)),
        }
        for name, rows in given.items():
            if not np.isfinite(rows).all():
                first = int(np.argmin(np.isfinite(rows).ravel()))
                shape = grip.shape if name == "grip_force" else rows.shape
                at = place(first, shape)
                raise ArgumentError(key=f"{name}{at}", value=float(rows.ravel()[first]), allowed="a finite number")
        shape = common_shape({name: rows.shape[:-1] for name, rows in given.items()})
        if len(shape) != 1:
            raise ArgumentError(
                f"the commands have shape {shape} without joints or tendons; it must be (n,), one row per step.",
                key="handle_angle",
                value=shape,
                allowed="(n,)",
            )
        if not inst.dynamics.hand_stiffness:
            _check_range(inst, given["handle_angle"])
        full = {name: np.broadcast_to(rows, (*shape, rows.shape[-1])) for name, rows in given.items()}
        constant = np.broadcast_to([float(axes == "stem"), *self._place(held)], (*shape, 4))
        # Weight, bend of the sheaths, length let out, tissue.
        none = np.zeros((*shape, 2 + len(inst.tendons) + 3 * len(inst.tip_joints)))
        columns = (full["handle_angle"], full["spool_velocity"], full["wrench"], full["grip_force"], constant, none)
        commanded = {
            "commanded_handle_angle": full["handle_angle"],
            "wrench": full["wrench"],
            "applied_grip_force": full["grip_force"][:, 0],
            "commanded_spool_velocity": full["spool_velocity"],
        }
        return np.ascontiguousarray(np.concatenate(columns, axis=1)), commanded


def names_of(inst: CoupledLike) -> Names:
    """Return what the columns of an instrument's runs are named after."""
    inst = load(inst)
    own = [inst.tip_joints[pair.joint] for pair in pairs(inst).values()]
    groups = (inst.tip_joints, inst.handle_joints, inst.tendons, own)
    return Names(*(tuple(one.name for one in group) for group in groups))


def _rows(key: str, value: ArrayLike, width: int) -> Array:
    """Return an argument with its last axis of a given length; a single 0 stands for all zeros."""
    array = numbers(key, value)
    if array.ndim == 0 and not array:
        return np.zeros(width)
    if array.ndim == 0 or array.shape[-1] != width:
        allowed = f"of shape (n, {width}) or ({width},)"
        raise ArgumentError(f"{key} has shape {array.shape}; it must be {allowed}.", key=key, value=array.shape)
    return array


def _check_range(inst: CoupledInstrument, angles: Array) -> None:
    limits: Sequence[float] = [joint.range for joint in inst.handle_joints]
    beyond = np.argwhere(np.abs(np.atleast_2d(angles)) > np.asarray(limits) + 1e-9)
    if beyond.size:
        row, column = map(int, beyond[0])
        joint = inst.handle_joints[column]
        raise ArgumentError(
            key=f"handle_angle[{row}] of {joint.name}",
            value=float(np.atleast_2d(angles)[row, column]),
            allowed=f"within its range of ±{joint.range:.4g} rad",
        )


def _lost(inst: CoupledInstrument, status: Status, where: str) -> Exception:
    if status == Status.OUT_OF_RANGE:
        return NoSolutionError(f"at {where} the handle was pushed beyond its range; give a smaller load or angle.")
    return NoSolutionError(
        f"at {where} the joints of {inst.name} find no equilibrium: the load is more than the tendons can hold; give a "
        "smaller load or more pretension."
    )

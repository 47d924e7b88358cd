"""The twin with a controller in its loop."""

import warnings
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import _core
from tenodesis.control.controller import OperatingState, fault_names
from tenodesis.control.joints import JointController
from tenodesis.errors import ArgumentError, FaultWarning
from tenodesis.instrument import Instrument, InstrumentLike
from tenodesis.run import TENDONS, Array, Run, fault_bits
from tenodesis.twin.chain_core import ChainCore
from tenodesis.twin.commands import check_finite
from tenodesis.twin.core import Stepped, Ticks, TwinCore
from tenodesis.twin.rows import CONTROL


class LoopController(Protocol):
    """Interface of a controller in a twin's loop, such as :class:`tenodesis.control.Controller`."""

    @property
    def core(self) -> _core.Controller:
        """The controller of the core."""

    def check_instrument(self, inst: InstrumentLike) -> None:
        """Raise ValueError for an instrument with other axes or joints than the controller's."""

    def begin(self, plant: object, time: float) -> None:
        """Raise ValueError if it has run on another plant, or on this one up to a later time (s), and was not reset."""

    def take_request(self) -> int:
        """Return the pending request, and clear it."""


class SignalFault(Protocol):
    """Interface of a fault between twin and controller, such as :class:`tenodesis.simulate.FaultInjection`."""

    def schedule(
        self, axes: tuple[str, ...], start: float, time: Array, values: Array, modes: NDArray[np.uint8]
    ) -> None:
        """Write values and modes by axis, step and signal, in the core's form; `start` is the first step's, s."""


def run_closed_loop(
    core: TwinCore,
    rows: Array,
    controller: LoopController,
    request: ArrayLike,
    faults: Sequence[SignalFault],
    *,
    first_step: int,
    time_step: float,
    relay: float,
) -> Stepped:
    """Step a twin of the core with the controller in the loop."""
    if not relay >= 0:
        raise ArgumentError(key="relay", value=relay, allowed="a time in s, 0 or more")
    count = len(rows)
    for name in ("spool_velocity", "spool_tension"):
        if rows[:, core.columns[name]][:, list(core.own_tendons)].any():
            raise ArgumentError(f"{name} and a controller are both given; give one of them.", key=name)
    values = modes = None
    if faults:
        values = np.zeros((len(core.axes), count, len(_core.fault_injection_points())))
        modes = np.zeros(values.shape, np.uint8)
        time = np.arange(first_step + 1, first_step + 1 + count, dtype=np.float64) * time_step
        for fault in faults:
            fault.schedule(core.axes, first_step * time_step, time, values, modes)
    requests = _requests(controller, np.asarray(request), count)
    return core.run_controlled(controller.core, rows, Ticks(time_step, first_step, relay, requests, values, modes))


def run_joint_loop(
    core: TwinCore,
    rows: Array,
    controller: JointController,
    *,
    target: ArrayLike | None,
    request: ArrayLike,
    faults: Sequence[SignalFault],
    first_step: int,
    time_step: float,
) -> tuple[Stepped, dict[str, Array]]:
    """Step a twin of the core with the controller of all joints in the loop; return the outcome, and its signals."""
    inst, count = controller.inst, len(rows)
    if not isinstance(core, ChainCore):
        raise ArgumentError(
            f"{inst.name} is in the short form; give the twin tn.instrument.expanded(inst).", key="controller"
        )
    if faults:
        raise ArgumentError(
            "fault_injection is given with a controller of all joints, which takes none; its step takes any "
            "measurement.",
            key="fault_injection",
        )
    for name in ("spool_velocity", "spool_tension"):
        if rows[:, core.columns[name]].any() and (inst.handle_joints or name == "spool_tension"):
            raise ArgumentError(f"{name} and a controller are both given; give one of them", key=name)
    joints = len(core.names.joints)
    wanted = np.zeros(joints) if target is None else np.asarray(target, float)
    if target is not None and inst.handle_joints:
        raise ArgumentError(
            f"target is given, but {inst.name} has a handle, whose angles are the targets; leave it out.", key="target"
        )
    if wanted.shape not in {(joints,), (count, joints)} and wanted.ndim and joints > 1:
        raise ArgumentError(
            f"target has the shape {wanted.shape}; it must be ({joints},) or ({count}, {joints}), by joint.",
            key="target",
            value=wanted.shape,
        )
    wanted = np.ascontiguousarray(
        np.broadcast_to(wanted.reshape(-1, joints) if wanted.ndim else wanted, (count, joints))
    )
    check_finite("target", wanted)
    requests = _requests(controller, np.asarray(request), count)
    ticks = Ticks(time_step, first_step, np.inf, requests, None, None)
    return core.run_joints(controller, rows, wanted, [0] * count if requests is None else requests.tolist(), ticks)


def controlled_signals(control: Array, velocity: Array, own: Sequence[int]) -> dict[str, Array]:
    """Return a controller's signals, shape (n, axes, columns), and the spool velocities (n, tendons) with its own."""
    sent = velocity.copy()
    sides = [CONTROL.index(f"commanded_spool_velocity.{side}") for side in TENDONS]
    sent[:, list(own)] = control[:, :, sides].reshape(len(sent), -1)
    named = {name: control[:, :, n] for n, name in enumerate(CONTROL) if "." not in name}
    return {"commanded_spool_velocity": sent, **named}


def warn_of_faults(run: Run, inst: Instrument, *, stacklevel: int = 3) -> None:
    """Warn if the controller of a run on an instrument faulted, by :class:`FaultWarning`: when, and which faults."""
    states, masks = run.operating_state, run.faults
    if states is None or masks is None:
        return
    rows = np.flatnonzero((states == OperatingState.FAULT).reshape(len(run), -1).any(axis=1))
    if not rows.size:
        return
    row = int(rows[0])
    names = fault_names(int(fault_bits(masks)[row]))
    hint = ""
    if "load_cell_stuck" in names and inst.tension_sensors[0].noise == 0:
        hint = (
            f"; the load cells of {inst.name} have no noise, so that their readings stand still: give it "
            "sensors.load_cell_noise, or make the controller for it"
        )
    warnings.warn(
        f"the controller faulted at {run.time[row]:.6g} s: {', '.join(names)}; it stopped the motors then{hint}.",
        FaultWarning,
        stacklevel=stacklevel,
    )


def _requests(
    controller: LoopController | JointController, request: NDArray[Any], count: int
) -> NDArray[np.uint8] | None:
    """Return the requests of each step; a pending request comes with the first."""
    pending = controller.take_request()
    if not pending and not request.any():
        return None
    requests = np.array(np.broadcast_to(request, (count,)), np.uint8)
    if count and not requests[0]:
        requests[0] = pending
    return requests

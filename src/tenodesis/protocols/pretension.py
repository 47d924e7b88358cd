"""Winding until the tendons are tight."""

from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.protocols.command import Command, Segment, sampled
from tenodesis.protocols.phase import Phase
from tenodesis.protocols.quantities import Duration, TendonSpeed, Tension
from tenodesis.protocols.twin import Twin
from tenodesis.signals import Array, Run

_CYCLE = 0.01
"""Time between two readings of the load cells, s."""
_SETTLING = 0.1
"""Time in which what is missing shrinks to a third, once the speed is no longer at its limit, s."""
_SETTLED = 0.2
"""Time within the tolerance after which a tendon counts as tight, s."""


class Pretension(Phase):
    """The motors wind until the load cells read a tension: closed loop, on every axis if none is given."""

    kind: Literal["pretension"] = "pretension"
    tension: Tension | None = Field(default=None, description="Tension; the instrument's pretension if not given")
    rate: TendonSpeed = Field(default=1e-3, description="Largest tendon speed")
    tolerance: Tension = Field(default=0.5, description="Largest difference to the tension")
    timeout: Duration = Field(default=30.0, description="Time after which to give up")

    def after(self, held: Command, inst: Instrument) -> Command:
        """Return the command the phase ends with: the drives at rest."""
        for axis in self._axes(inst):
            held = held.on(axis, spool_velocity=0.0)
        return held

    def run(self, twin: Twin, held: Command) -> Iterator[Run]:
        """Wind, and yield what a twin says to that in short runs.

        Raises
        ------
        ProtocolError
            A tendon does not get tight within the timeout, or its load cell reads nothing.
        """
        axes = self._axes(twin.inst)
        insts = [_alone(twin.inst, axis) for axis in axes]
        wanted = np.array([[inst.pretension if self.tension is None else self.tension] for inst in insts])
        gain = np.array([[1 / (inst.tendon_stiffness * _SETTLING)] for inst in insts])
        steps = max(1, round(_CYCLE / twin.time_step))
        held, elapsed, settled = self.after(held, twin.inst), 0.0, 0.0
        while settled < _SETTLED:
            (commands,) = sampled([Segment(held, held, steps)], steps)
            run = twin.run(**commands)
            yield run
            elapsed += steps * twin.time_step
            read = _read(run)[axes]
            missing = wanted - read
            tight = np.abs(missing) <= self.tolerance
            settled = settled + steps * twin.time_step if tight.all() else 0.0
            if settled < _SETTLED and elapsed >= self.timeout:
                raise ProtocolError(self._told(twin.inst, read, wanted, tight))
            winding = np.clip(missing * gain, -self.rate, self.rate) / twin.spool_radius
            for axis, velocity in zip(axes, winding, strict=True):
                held = held.on(axis, spool_velocity=velocity)

    def _axes(self, inst: Instrument) -> list[int]:
        return list(range(len(inst.axes))) if self.axis is None else [inst.axes.index(self.axis)]

    def _told(self, inst: Instrument, read: Array, wanted: Array, tight: NDArray[np.bool_]) -> str:
        """Say which tendon is not tight, or the first that is not steady."""
        row, tendon = np.argwhere(~tight)[0] if not tight.all() else (0, 0)
        name = f"the {('agonist', 'antagonist')[tendon]} of {inst.axes[self._axes(inst)[row]]}"
        return (
            f"{name} reads {read[row, tendon]:.4g} N after the timeout of {self.timeout:g} s; allowed is "
            f"{wanted[row, 0]:g} ± {self.tolerance:g} N for {_SETTLED:g} s: hook it in, or give a larger timeout, rate "
            "or tolerance"
        )


def _alone(inst: Instrument, axis: int) -> Instrument:
    return inst.axis(inst.axes[axis]) if len(inst.axes) > 1 else inst


def _read(run: Run) -> Array:
    """Return the last tensions the load cells read, by axis and tendon, N."""
    read = np.full(2, np.nan) if run.measured_tension is None else np.asarray(run.measured_tension[-1])
    if not np.isfinite(read).all():
        raise ProtocolError("the load cells read no tension; allowed is a twin or bench that measures both tendons'")
    return read.reshape(-1, 2)

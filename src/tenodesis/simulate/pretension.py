"""Winding until the tendons are tight."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.simulate.command import Command, Segment, sampled
from tenodesis.simulate.phase import Phase
from tenodesis.simulate.twin import Twin
from tenodesis.units import Duration, Length, WindingSpeed, WindingTension

_CYCLE = 0.01
"""Time between two commands to the drives, over which the load cells' readings are averaged, s."""
_SETTLING = 0.1
"""Time in which what is missing shrinks to a third, once the speed is no longer at its limit, s."""
_SETTLED = 0.2
"""Time within the tolerance after which the drives are stopped, s."""
_STOPPED = 0.2
"""Time within the tolerance with the drives at rest after which a tendon counts as tight, s."""
_SLOWNESS = 4.0
"""Settling time over the drives' time constant, at least: with less, the loop would overshoot."""
_SLACK = 10e-3
"""Slack that a tendon may have, m."""
_DRIFT = math.radians(10)
"""Turn of the tip that shows that the load cells of its tendons disagree."""


class Pretension(Phase):
    """The motors wind until the load cells read a tension: closed loop, on every axis if none is given."""

    kind: Literal["pretension"] = "pretension"
    tension: WindingTension | None = Field(
        default=None, description="Tension; the instrument's pretension if not given"
    )
    rate: WindingSpeed = Field(default=1e-3, description="Largest tendon speed")
    tolerance: WindingTension = Field(default=0.5, description="Largest difference to the tension")
    timeout: Duration = Field(default=30.0, description="Time after which to give up")
    travel: Length | None = Field(
        default=None, description="Length wound after which to give up; 10 mm and twice the stretch if not given"
    )

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
            A tendon does not get tight within timeout and travel, its load cell reads nothing, or the tip is pulled
            aside.
        """
        axes = self._axes(twin.inst)
        insts = [_alone(twin.inst, axis) for axis in axes]
        wanted = np.array([[inst.pretension if self.tension is None else self.tension] for inst in insts])
        stretch = wanted / [[inst.tendon_stiffness] for inst in insts]
        travel = _SLACK + 2 * stretch if self.travel is None else np.full_like(wanted, self.travel)
        settling = max(_SETTLING, _SLOWNESS * twin.inst.drives.time_constant)
        gain = np.array([[1 / (inst.tendon_stiffness * settling)] for inst in insts])
        steps = max(1, round(_CYCLE / twin.time_step))
        stopped = _STOPPED + twin.inst.drives.time_constant
        held, elapsed, settled = self.after(held, twin.inst), 0.0, 0.0
        first: Run | None = None
        while settled < _SETTLED + stopped:
            (commands,) = sampled([Segment(held, held, steps)], steps)
            run = twin.run(**commands)
            yield run
            first = first or run
            elapsed += steps * twin.time_step
            read = _read(run)[axes]
            missing = wanted - read
            tight = np.abs(missing) <= self.tolerance
            settled = settled + steps * twin.time_step if tight.all() else 0.0
            wound = _turned(first, run, "measured_spool_angle", (-1, 2))[axes] * twin.spool_radius
            self._refuse_drift(twin.inst, _turned(first, run, "measured_output_angle", (-1,))[axes])
            over = (wound > travel) & ~tight
            if over.any():
                given = f"the travel of {travel[over.any(axis=1)][0, 0] * 1e3:.3g} mm"
                raise ProtocolError(self._told(twin.inst, over, given, read=read, wanted=wanted, wound=wound))
            if settled < _SETTLED + stopped and elapsed >= self.timeout:
                given = f"the timeout of {self.timeout:g} s"
                raise ProtocolError(self._told(twin.inst, ~tight, given, read=read, wanted=wanted, wound=wound))
            speed = self.rate if settled < _SETTLED else 0.0
            winding = np.clip(missing * gain, -speed, speed) / twin.spool_radius
            for axis, velocity in zip(axes, winding, strict=True):
                held = held.on(axis, spool_velocity=velocity)

    def _axes(self, inst: Instrument) -> list[int]:
        return list(range(len(inst.axes))) if self.axis is None else [inst.axes.index(self.axis)]

    def _refuse_drift(self, inst: Instrument, turned: Array) -> None:
        """Refuse to pull the tip aside, which load cells that disagree would do without end."""
        for axis, angle in zip(self._axes(inst), turned, strict=True):
            if abs(angle) > _DRIFT:
                raise ProtocolError(
                    f"the tip's {inst.axes[axis]} turned by {math.degrees(angle):.3g} deg while its tendons were "
                    f"wound; allowed is {math.degrees(_DRIFT):.3g} deg: hook both tendons in, or calibrate their load "
                    "cells"
                )

    def _told(
        self, inst: Instrument, wrong: NDArray[np.bool_], given: str, *, read: Array, wanted: Array, wound: Array
    ) -> str:
        """Say which tendon is not tight, or the first that is not steady, after what it was given."""
        row, tendon = np.argwhere(wrong)[0] if wrong.any() else (0, 0)
        name = f"the {('agonist', 'antagonist')[tendon]} of {inst.axes[self._axes(inst)[row]]}"
        length = wound[row, tendon]
        by_motor = "" if np.isnan(length) else f" with {length * 1e3:.3g} mm wound"
        advice = "hook it in, or give a larger timeout, rate or tolerance"
        if not np.isnan(length):
            advice = "see whether it is unhooked, broken or jammed, or give a larger timeout, travel, rate or tolerance"
        return (
            f"{name} reads {read[row, tendon]:.4g} N after {given}{by_motor}; allowed is "
            f"{wanted[row, 0]:g} ± {self.tolerance:g} N for {_STOPPED:g} s: {advice}"
        )


def _alone(inst: Instrument, axis: int) -> Instrument:
    return inst.axis(inst.axes[axis]) if len(inst.axes) > 1 else inst


def _read(run: Run) -> Array:
    """Return the mean tensions the load cells read, by axis and tendon, N."""
    read = np.full(2, np.nan) if run.measured_tension is None else np.mean(run.measured_tension, axis=0)
    if not np.isfinite(read).all():
        raise ProtocolError("the load cells read no tension; allowed is a twin or bench that measures both tendons'")
    return read.reshape(-1, 2)


def _turned(first: Run, last: Run, name: str, shape: tuple[int, ...]) -> Array:
    """Return by how much a measured angle has changed between two runs, rad, by axis; NaN where it is not measured."""
    before, after = getattr(first, name), getattr(last, name)
    if before is None or after is None:
        return np.full((len(first.axes), *shape[1:]), np.nan)
    return np.asarray(after[-1] - before[0]).reshape(shape)

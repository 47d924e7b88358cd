"""The closed-loop phase: winding until the tendons are tight."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tenodesis.errors import ProtocolError
from tenodesis.instrument import ShortForm
from tenodesis.run import Array, Run
from tenodesis.simulate.command import Command, Plant, Segment, sampled
from tenodesis.simulate.phases import Phase
from tenodesis.units import Duration, Length, WindingSpeed, WindingTension

_CYCLE = 0.01
"""Time between two commands to the drives, over which the load cells' readings are averaged, s."""
_SETTLING = 0.1
"""Time constant of the tension's error, once the speed is no longer at its limit, s."""
_SETTLED = 0.2
"""Time within the tolerance after which the drives are stopped, s."""
_STOPPED = 0.2
"""Time within the tolerance with the drives at rest after which a tendon counts as tight, s."""
_SLOWNESS = 4.0
"""Least ratio of the settling time to the drives' time constant; with less, the loop would overshoot."""
_SLACK = 10e-3
"""Largest slack of a tendon, m."""
_DRIFT = math.radians(10)
"""Rotation of the tip that shows that the load cells of its tendons disagree."""


class Pretension(Phase):
    """The motors wind until the load cells read a tension (closed loop), on every axis if no axis is given."""

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

    def end(self, command: Command, inst: ShortForm) -> Command:
        """Return the command that the phase ends with, after a command: the drives at rest."""
        for axis in self._axes(inst):
            command = command.on(axis, spool_velocity=0.0)
        return command

    def run(self, plant: Plant, command: Command) -> Iterator[Run]:
        """Wind, from a command on, and yield the plant's response in short runs.

        Raises ProtocolError if a tendon does not get tight within timeout and travel, its load cell reads nothing, or
        the tip is pulled aside.
        """
        axes = self._axes(plant.inst)
        insts = [plant.inst.planar[axis] for axis in axes]
        target = np.array([[inst.pretension if self.tension is None else self.tension] for inst in insts])
        stretch = target / [[inst.tendon_stiffness] for inst in insts]
        travel = _SLACK + 2 * stretch if self.travel is None else np.full_like(target, self.travel)
        settling = max(_SETTLING, _SLOWNESS * plant.inst.drives.time_constant)
        gain = np.array([[1 / (inst.tendon_stiffness * settling)] for inst in insts])
        steps = max(1, round(_CYCLE / plant.time_step))
        stopped = _STOPPED + plant.inst.drives.time_constant
        command, elapsed, settled = self.end(command, plant.inst), 0.0, 0.0
        first: Run | None = None
        while settled < _SETTLED + stopped:
            (commands,) = sampled([Segment(command, command, steps)], steps)
            run = plant.run(**commands)
            yield run
            first = first or run
            elapsed += steps * plant.time_step
            tension = _measured_tension(run)[axes]
            error = target - tension
            tight = np.abs(error) <= self.tolerance
            settled = settled + steps * plant.time_step if tight.all() else 0.0
            wound = _turned(first, run, "measured_spool_angle", (-1, 2))[axes] * plant.spool_radius
            self._check_tip(plant.inst, _turned(first, run, "measured_output_angle", (-1,))[axes])
            beyond = (wound > travel) & ~tight
            if beyond.any():
                limit = f"the travel of {travel[beyond.any(axis=1)][0, 0] * 1e3:.3g} mm"
                raise self._not_tight(plant.inst, beyond, limit, tension=tension, target=target, wound=wound)
            if settled < _SETTLED + stopped and elapsed >= self.timeout:
                limit = f"the timeout of {self.timeout:g} s"
                raise self._not_tight(plant.inst, ~tight, limit, tension=tension, target=target, wound=wound)
            speed = self.rate if settled < _SETTLED else 0.0
            winding = np.clip(error * gain, -speed, speed) / plant.spool_radius
            for axis, velocity in zip(axes, winding, strict=True):
                command = command.on(axis, spool_velocity=velocity)

    def _axes(self, inst: ShortForm) -> list[int]:
        return list(range(len(inst.axes))) if self.axis is None else [inst.axes.index(self.axis)]

    def _check_tip(self, inst: ShortForm, turned: Array) -> None:
        """Check that the tip (rad, by axis) is not pulled aside, as happens endlessly if the load cells disagree."""
        for axis, angle in zip(self._axes(inst), turned, strict=True):
            if abs(angle) > _DRIFT:
                raise ProtocolError(
                    f"the tip's {inst.axes[axis]} turned by {math.degrees(angle):.3g} deg while its tendons were "
                    f"wound; it must be at most {math.degrees(_DRIFT):.3g} deg: hook both tendons in, or calibrate "
                    "their load cells"
                )

    def _not_tight(
        self, inst: ShortForm, wrong: NDArray[np.bool_], limit: str, *, tension: Array, target: Array, wound: Array
    ) -> ProtocolError:
        """Return the error about the first tendon that is not tight at a limit, or about the first tendon."""
        row, tendon = np.argwhere(wrong)[0] if wrong.any() else (0, 0)
        name = f"the {('agonist', 'antagonist')[tendon]} of {inst.axes[self._axes(inst)[row]]}"
        length = wound[row, tendon]
        by_motor = "" if np.isnan(length) else f" with {length * 1e3:.3g} mm wound"
        advice = "hook it in, or give a larger timeout, rate or tolerance"
        if not np.isnan(length):
            advice = "see whether it is unhooked, broken or jammed, or give a larger timeout, travel, rate or tolerance"
        return ProtocolError(
            f"{name} reads {tension[row, tendon]:.4g} N after {limit}{by_motor}; it must be "
            f"{target[row, 0]:g} ± {self.tolerance:g} N for {_STOPPED:g} s: {advice}"
        )


def _measured_tension(run: Run) -> Array:
    """Return the mean tensions that the load cells read, N, shape (axes, 2)."""
    read = np.full(2, np.nan) if run.measured_tension is None else np.mean(run.measured_tension, axis=0)
    if not np.isfinite(read).all():
        raise ProtocolError("the load cells read no tension; both tendons' tension must be measured")
    return read.reshape(-1, 2)


def _turned(first: Run, last: Run, name: str, shape: tuple[int, ...]) -> Array:
    """Return by how much a measured angle has changed between two runs, rad, by axis; NaN where it is not measured."""
    before, after = getattr(first, name), getattr(last, name)
    if before is None or after is None:
        return np.full((len(first.axes), *shape[1:]), np.nan)
    return np.asarray(after[-1] - before[0]).reshape(shape)

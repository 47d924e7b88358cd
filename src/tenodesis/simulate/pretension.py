"""The closed-loop phase: winding until the tendons are tight."""

import math
from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tenodesis.errors import ProtocolError
from tenodesis.run import Array, Run
from tenodesis.simulate.command import Command, Plant, Segment, sampled
from tenodesis.simulate.phases import Phase
from tenodesis.simulate.places import Places
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
_RETURN = 0.2
"""Time in which the spools go to the middle of two angles, s."""
_SLACK = 10e-3
"""Largest slack of a tendon, m."""
_DRIFT = math.radians(10)
"""Rotation of the tip that shows that the load cells of its tendons disagree."""


class Pretension(Phase):
    """The motors wind until the load cells read a tension (closed loop): all tendons, or the pair of an axis."""

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

    def end(self, command: Command, places: Places) -> Command:
        """Return the command that the phase ends with, after a command: the drives at rest."""
        return self._winding(command, places, 0.0)

    def run_both_ways(self, plant: Plant, command: Command, rise: float) -> Iterator[Run]:
        """Wind to the tension, by a rise (share of it) beyond and back, and then to the middle of both spool angles.

        Friction makes load cells beside the spools read too much on the way up, and too little on the way back. Yields
        and raises as :meth:`run`.
        """
        places, found = Places.of(plant.inst), []
        for share in (1.0, 1.0 + rise, 1.0):
            for run in self.run(plant, command, share):
                yield run
            found.append(run.by_column("measured_spool_angle")[-1])
        wound, still = self._tendons(places), self.end(command, places)
        middle = self._winding(command, places, ((found[0] - found[-1]) / 2 / _RETURN)[wound])
        for at, seconds in ((middle, _RETURN), (still, _STOPPED + plant.inst.drives.time_constant)):
            steps = max(1, round(seconds / plant.time_step))
            (commands,) = sampled([Segment(at, at, steps)], steps)
            yield plant.run(**commands)

    def run(self, plant: Plant, command: Command, share: float = 1.0) -> Iterator[Run]:
        """Wind to a share of the tension, from a command on, and yield the plant's response in short runs.

        Raises ProtocolError if a tendon does not get tight within timeout and travel, its load cell reads nothing, or
        the tip is pulled aside.
        """
        places = Places.of(plant.inst)
        tendons = self._tendons(places)
        stiffness = plant.inst.stiffnesses[tendons]
        target = plant.inst.pretensions[tendons] if self.tension is None else np.full(len(tendons), self.tension)
        target = share * target
        travel = _SLACK + 2 * target / stiffness if self.travel is None else np.full_like(target, self.travel)
        settling = max(_SETTLING, _SLOWNESS * plant.inst.drives.time_constant)
        gain = 1 / (stiffness * settling)
        steps = max(1, round(_CYCLE / plant.time_step))
        stopped = _STOPPED + plant.inst.drives.time_constant
        command, elapsed, settled = self.end(command, places), 0.0, 0.0
        first: Run | None = None
        while settled < _SETTLED + stopped:
            (commands,) = sampled([Segment(command, command, steps)], steps)
            run = plant.run(**commands)
            yield run
            first = first or run
            elapsed += steps * plant.time_step
            tension = _measured_tension(run)[tendons]
            error = target - tension
            tight = np.abs(error) <= self.tolerance
            settled = settled + steps * plant.time_step if tight.all() else 0.0
            wound = _turned(first, run, "measured_spool_angle", len(plant.inst.tendons))[tendons] * plant.spool_radius
            self._check_tip(places, _turned(first, run, "measured_output_angle", len(plant.inst.tip_joints)))
            beyond = (wound > travel) & ~tight
            if beyond.any():
                limit = f"the travel of {travel[beyond][0] * 1e3:.3g} mm"
                raise self._not_tight(places, beyond, limit, tension=tension, target=target, wound=wound)
            if settled < _SETTLED + stopped and elapsed >= self.timeout:
                limit = f"the timeout of {self.timeout:g} s"
                raise self._not_tight(places, ~tight, limit, tension=tension, target=target, wound=wound)
            speed = self.rate if settled < _SETTLED else 0.0
            command = self._winding(command, places, np.clip(error * gain, -speed, speed) / plant.spool_radius)

    def _tendons(self, places: Places) -> list[int]:
        """Return the numbers of the tendons that are wound."""
        return places.wound if self.axis is None else list(places.axes[self.axis].tendons)

    def _winding(self, command: Command, places: Places, velocity: Array | float) -> Command:
        """Return a command with velocities of the spools, rad/s."""
        velocities = command.spool_velocity.copy()
        velocities[self._tendons(places)] = velocity
        return command._replace(spool_velocity=velocities)

    def _check_tip(self, places: Places, turned: Array) -> None:
        """Check that the tip (rad, by joint) is not pulled aside, as happens endlessly if the load cells disagree."""
        turns = [(n, joint.name) for n, joint in enumerate(places.inst.tip_joints)]
        if self.axis is not None:
            turns = [(places.axes[self.axis].bends[0], self.axis)]
        for joint, name in turns:
            angle = turned[joint]
            if abs(angle) > _DRIFT:
                raise ProtocolError(
                    f"the tip's {name} turned by {math.degrees(angle):.3g} deg while its tendons were "
                    f"wound; it must be at most {math.degrees(_DRIFT):.3g} deg: hook its tendons in, or calibrate "
                    "their load cells",
                    key="tip_angle",
                    value=angle,
                    allowed=f"at most {math.degrees(_DRIFT):.3g} deg from the start",
                )

    def _not_tight(
        self, places: Places, wrong: NDArray[np.bool_], limit: str, *, tension: Array, target: Array, wound: Array
    ) -> ProtocolError:
        """Return the error about the first tendon that is not tight at a limit, or about the first tendon."""
        tendon = int(np.argmax(wrong))
        name = places.tendon_name(self._tendons(places)[tendon])
        length = wound[tendon]
        by_motor = "" if np.isnan(length) else f" with {length * 1e3:.3g} mm wound"
        advice = "hook it in, or give a larger timeout, rate or tolerance"
        if not np.isnan(length):
            advice = "see whether it is unhooked, broken or jammed, or give a larger timeout, travel, rate or tolerance"
        return ProtocolError(
            f"{name} reads {tension[tendon]:.4g} N after {limit}{by_motor}; it must be "
            f"{target[tendon]:g} ± {self.tolerance:g} N for {_STOPPED:g} s: {advice}",
            key="tension",
            value=tension[tendon],
            allowed=f"{target[tendon]:g} ± {self.tolerance:g} N",
        )


def _measured_tension(run: Run) -> Array:
    """Return the mean tensions that the load cells read, N, by tendon."""
    read = np.full(2, np.nan) if run.measured_tension is None else np.mean(run.measured_tension, axis=0)
    if not np.isfinite(read).all():
        raise ProtocolError(
            "the load cells read no tension; both tendons' tension must be measured",
            key="measured_tension",
            allowed="measured at both tendons",
        )
    return np.asarray(read)


def _turned(first: Run, last: Run, name: str, columns: int) -> Array:
    """Return by how much a measured angle changed between two runs, rad, by column; NaN where it is not measured."""
    before, after = getattr(first, name), getattr(last, name)
    if before is None or after is None:
        return np.full(columns, np.nan)
    return np.asarray(after[-1] - before[0]).reshape(columns)

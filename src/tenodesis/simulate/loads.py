"""Loads that are put on the tip and taken off again."""

from collections.abc import Sequence
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tenodesis.errors import ArgumentError, ProtocolError
from tenodesis.run import COMPONENTS, Array
from tenodesis.simulate.command import Command
from tenodesis.simulate.model import ProtocolModel, check_choice
from tenodesis.simulate.places import Place, Places
from tenodesis.units import Delay, Duration, SignedForce, SignedMoment


class Wrench(ProtocolModel):
    """Force and moment on the tip, in the tip's axes; components that are not given stay as they were."""

    fx: SignedForce | None = Field(default=None, description="Force to where positive yaw bends")
    fy: SignedForce | None = Field(default=None, description="Force to where positive pitch bends")
    fz: SignedForce | None = Field(default=None, description="Force along the tip, outward")
    mx: SignedMoment | None = Field(default=None, description="Moment about x")
    my: SignedMoment | None = Field(default=None, description="Moment about y")
    mz: SignedMoment | None = Field(default=None, description="Moment about z")


class NamedLoad(ProtocolModel):
    """A load on the tip by its components."""

    wrench: Wrench | None = Field(default=None, description="Force and moment on the tip")
    grip_force: SignedForce | None = Field(default=None, description="Force that presses the jaws apart")

    @property
    def names_load(self) -> bool:
        """Whether it has such a load."""
        return self.wrench is not None or self.grip_force is not None

    @model_validator(mode="after")
    def _check_alone(self) -> Self:
        for key in ("force", "radial_force", "force_end", "weight", "moment", "load_steps", "force_amplitude"):
            if self.wrench is not None and getattr(self, key, None) not in (None, ()):
                raise ArgumentError(f"wrench and {key} are given; give only one of them", key=key)
        return self

    def on_tip(self, command: Command, places: Places) -> Command:
        """Return a command with this load; raises ProtocolError for a component that the instrument does not take."""
        for name in COMPONENTS:
            value = getattr(self.wrench, name, None)
            if value is not None:
                for where in places.component(name):
                    command = command.with_value(where, value)
        return command if self.grip_force is None else command._replace(grip_force=np.array([self.grip_force]))


class AppliedLoad(ProtocolModel):
    """A load on the tip, in one of three forms."""

    force: SignedForce | None = Field(default=None, description="Tangential force at the tip")
    weight: SignedForce | None = Field(default=None, description="Force on the load rig's cable instead")
    moment: SignedMoment | None = Field(default=None, description="Moment of the load rig instead")
    rise: Delay = Field(default=0.0, description="Time of the linear rise and fall of the load")

    @model_validator(mode="after")
    def _check_form(self) -> Self:
        check_choice(self, "force", "weight", "moment", required=not self.names_load)
        return self

    @property
    def names_load(self) -> bool:
        """Whether it has a load by its components as well."""
        return False

    @property
    def is_tangential(self) -> bool:
        """Whether it has a force at the tip, in any form."""
        return (self.force, self.weight, self.moment) != (None,) * 3

    def tip_force(self, place: Place) -> float:
        """Return the tangential force on a place at the tip, N, for either form of the load.

        Raises ProtocolError if the load is a weight and the instrument's file lacks the radius of the cable's pulley.
        """
        if self.force is not None:
            return self.force
        moment = self.moment
        if self.weight is not None:
            radius = place.inst.conditions.cable_pulley_radius
            if radius is None:
                raise ProtocolError(
                    f"weight is given, but {place.inst.name} has no conditions.cable_pulley_radius; "
                    "give that, or force or moment instead of weight",
                    key="weight",
                    value=self.weight,
                )
            moment = self.weight * radius
        return (moment or 0.0) / place.rig_arm


class LoadStep(AppliedLoad):
    """A load that is put on during a motion, and taken off again if it has a duration."""

    after: Delay = Field(default=0.0, description="Time from the start of the motion")
    duration: Duration | None = Field(
        default=None, description="Time under the full load; else it stays, also for the phases that follow"
    )

    @property
    def end(self) -> float:
        """Time from the start of the motion at which the load has come, or has gone again, s."""
        return self.after + self.rise + (0.0 if self.duration is None else self.duration + self.rise)

    def share(self, time: Array) -> Array:
        """Return how much of the load is on at times (n,), s, from the start of the motion."""
        came = _risen(time - self.after, self.rise)
        if self.duration is None:
            return came
        return came - _risen(time - self.after - self.rise - self.duration, self.rise)


def check_load_steps(steps: Sequence[LoadStep], seconds: float) -> None:
    """Check that load steps are one after another within a motion that lasts some seconds, or raise ProtocolError."""
    free: float | None = 0.0
    for number, step in enumerate(steps, 1):
        if free is None or step.after < free * (1 - 1e-9):
            allowed = "the load before has a duration and is off" if free is None else f"{free:g} s, when it is off"
            raise ProtocolError(
                f"load_steps {number} has after = {step.after:g} s, while the load before is on; it must wait until "
                f"{allowed}",
                key="after",
                value=step.after,
                allowed=allowed,
            )
        if step.end > seconds * (1 + 1e-9):
            raise ProtocolError(
                f"load_steps {number} lasts until {step.end:g} s; it must be over within the motion's {seconds:g} s",
                key="load_steps",
                value=step.end,
                allowed=f"at most {seconds:g} s",
            )
        free = None if step.duration is None else step.end


def stepped_force(
    steps: Sequence[LoadStep], place: Place, force: Array, done: NDArray[np.int64], time_step: float
) -> Array:
    """Return the force (N) at numbers of steps done (n,), from what it is without load steps (n,)."""
    for step in steps:
        # A load is there within the step in which it comes, as between two phases.
        share = step.share(np.asarray((done - (0 if step.rise else 1)) * time_step, float))
        force = (1 - share) * force + share * step.tip_force(place)
    return force


def _risen(time: Array, rise: float) -> Array:
    """Return the share of a linear rise that is over at times since its beginning, s."""
    late = time >= -1e-9 * np.maximum(1.0, np.abs(time))
    return np.where(late, 1.0 if not rise else np.clip(time / rise, 0.0, 1.0), 0.0)

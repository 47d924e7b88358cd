"""A load that comes suddenly."""

from collections.abc import Iterator
from typing import Literal, Self

from pydantic import Field, model_validator

from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.simulate.choice import at_most_one, exactly_one
from tenodesis.simulate.command import Segment
from tenodesis.simulate.phase import Moving, Setting
from tenodesis.simulate.reach import checked, of_output
from tenodesis.units import Angle, Delay, Duration, SignedForce, SignedMoment


class StepLoad(Moving):
    """The handle is held; a load comes after a delay, lasts, and is taken off again if a release is given.

    Taken off means back to the force there was before; without a release the load stays for the phases that follow.
    """

    kind: Literal["step-load"] = "step-load"
    handle_angle: Angle | None = Field(default=None, description="Handle angle held; where it is if not given")
    output_angle: Angle | None = Field(default=None, description="The same, as output angle without load")
    delay: Delay = Field(default=0.0, description="Time at the handle angle before the load")
    force: SignedForce | None = Field(default=None, description="Tangential force at the tip")
    weight: SignedForce | None = Field(default=None, description="Force on the load rig's cable instead")
    moment: SignedMoment | None = Field(default=None, description="Moment of the load rig instead")
    rise: Delay = Field(default=0.0, description="Time in which the load comes and goes, linearly")
    duration: Duration = Field(description="Time under the whole load")
    release: Duration | None = Field(default=None, description="Time after the load was taken off; else it stays")

    @model_validator(mode="after")
    def _unambiguous(self) -> Self:
        at_most_one(self, "handle_angle", "output_angle")
        exactly_one(self, "force", "weight", "moment")
        return self

    def segments(self, at: Setting) -> Iterator[Segment]:
        """Yield the way to the handle angle, the wait, the load, and its release."""
        angle = self._angle(at)
        free = at.held.on(at.axis, handle_angle=angle)
        loaded = free.on(at.axis, force=self.tip_force(at.inst))
        yield from self.approached(at, angle)
        yield at.still(free, self.delay)
        yield at.linear(free, loaded, self.rise)
        yield at.still(loaded, self.duration)
        if self.release is not None:
            yield at.linear(loaded, free, self.rise)
            yield at.still(free, self.release)

    def tip_force(self, inst: Instrument) -> float:
        """Return the tangential force at the tip, N, whichever way the load is given.

        Raises
        ------
        ProtocolError
            The load is a weight and the instrument's file does not tell the cable's pulley.
        """
        if self.force is not None:
            return self.force
        moment = self.moment
        if self.weight is not None:
            radius = inst.conditions.cable_pulley_radius
            if radius is None:
                raise ProtocolError(
                    f"weight is given, but {inst.name} has no conditions.cable_pulley_radius; "
                    "allowed is to give that, or force or moment instead of weight"
                )
            moment = self.weight * radius
        return (moment or 0.0) / inst.rig_arm

    def _angle(self, at: Setting) -> float:
        if self.output_angle is not None:
            return of_output(at.inst, "output_angle", self.output_angle)
        if self.handle_angle is not None:
            return checked(at.inst, "handle_angle", self.handle_angle)
        return float(at.held.handle_angle[at.axis])

"""Going somewhere linearly."""

from collections.abc import Iterator
from typing import Literal, Self

from pydantic import Field, model_validator

from tenodesis.simulate.command import Segment
from tenodesis.simulate.phase import OpenLoop, Setting
from tenodesis.simulate.reach import checked
from tenodesis.units import Angle, Duration, SignedForce, SpoolVelocity


class Ramp(OpenLoop):
    """What is given goes there linearly from where it is; the rest stays, and all of it stays there afterwards."""

    kind: Literal["ramp"] = "ramp"
    duration: Duration = Field(description="How long")
    handle_angle: Angle | None = Field(default=None, description="Handle angle at the end")
    force: SignedForce | None = Field(default=None, description="Tangential force at the tip at the end")
    radial_force: SignedForce | None = Field(default=None, description="Force along the end-effector at the end")
    spool_velocity: tuple[SpoolVelocity, SpoolVelocity] | None = Field(
        default=None, description="Spool velocities at the end, agonist's and antagonist's; positive winds"
    )

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Self:
        if (self.handle_angle, self.force, self.radial_force, self.spool_velocity) == (None,) * 4:
            raise ValueError("nothing is ramped; give handle_angle, force, radial_force or spool_velocity")
        return self

    def segments(self, at: Setting) -> Iterator[Segment]:
        """Yield the one segment there is."""
        if self.handle_angle is not None:
            checked(at.inst, "handle_angle", self.handle_angle)
        end = at.held.on(
            at.axis,
            handle_angle=self.handle_angle,
            force=self.force,
            radial_force=self.radial_force,
            spool_velocity=self.spool_velocity,
        )
        yield at.linear(at.held, end, self.duration)

"""What the phases of a protocol have in common."""

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import NamedTuple

from pydantic import BaseModel, ConfigDict, Field

from tenodesis.instrument import AxisName, Instrument
from tenodesis.simulate.command import Command, Path, Segment, between
from tenodesis.simulate.shapes import SMOOTH
from tenodesis.units import HandleSpeed, SignedForce


class Strict(BaseModel):
    """A model that takes what it knows and nothing else."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, populate_by_name=True)


class Setting(NamedTuple):
    """Where a phase begins: the instrument of the phase's axis, that axis's number, the last command, the time step."""

    inst: Instrument
    axis: int
    held: Command
    time_step: float

    def steps(self, seconds: float) -> int:
        """Return a duration (s) in whole time steps, rounded up."""
        return math.ceil(seconds / self.time_step * (1 - 1e-9))

    def still(self, held: Command, seconds: float) -> Segment:
        """Return the segment in which nothing changes for a duration (s)."""
        return Segment(held, held, self.steps(seconds))

    def linear(self, start: Command, end: Command, seconds: float) -> Segment:
        """Return the segment that goes linearly from start to end in a duration (s)."""
        return Segment(start, end, self.steps(seconds))


class Phase(Strict):
    """A part of a protocol, on one axis."""

    axis: AxisName | None = Field(default=None, description="Axis it acts on; the first if not given")


class OpenLoop(Phase):
    """A phase whose commands are known before it runs."""

    @abstractmethod
    def segments(self, at: Setting) -> Iterator[Segment]:
        """Yield what the phase asks for, beginning at a setting.

        Raises
        ------
        ProtocolError
            The instrument cannot be asked for it.
        """


class Moving(OpenLoop):
    """A phase that begins at a handle angle of its own."""

    approach: HandleSpeed = Field(
        default=math.radians(20), description="Largest handle speed on the way to where it begins"
    )

    def approached(self, at: Setting, angle: float) -> Iterator[Segment]:
        """Yield the smooth move (minimum jerk) to a handle angle (rad), if the handle is not there."""
        begin = float(at.held.handle_angle[at.axis])
        steps = at.steps(SMOOTH.peak * abs(angle - begin) / self.approach)
        if steps:
            yield Segment(
                at.held,
                at.held.on(at.axis, handle_angle=angle),
                steps,
                at.axis,
                lambda done: between(begin, angle, SMOOTH.way(done / steps)),
            )


class Loaded(Moving):
    """A phase that moves the handle under load."""

    force: SignedForce | None = Field(default=None, description="Tangential force at the tip; as it was if not given")
    force_end: SignedForce | None = Field(default=None, description="Force it goes to linearly; constant if not given")
    radial_force: SignedForce | None = Field(
        default=None, description="Force along the end-effector; as it was if not given"
    )

    def moved(self, at: Setting, angles: tuple[float, float], steps: int, path: Path) -> Segment:
        """Return the segment under this load that follows a path between two handle angles (rad)."""
        start = at.held.on(at.axis, handle_angle=angles[0], force=self.force, radial_force=self.radial_force)
        end = start.on(at.axis, handle_angle=angles[1], force=self.force_end)
        return Segment(start, end, steps, at.axis, path)

"""Flexion and extension of the handle."""

from collections.abc import Iterator
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tenodesis.errors import ProtocolError
from tenodesis.run import Array
from tenodesis.simulate.choice import exactly_one
from tenodesis.simulate.command import Segment, between
from tenodesis.simulate.phase import Loaded, Setting
from tenodesis.simulate.reach import checked, of_output
from tenodesis.simulate.shapes import SHAPES, ShapeName
from tenodesis.units import Angle, Duration, HandleSpeed


class Cycles(Loaded):
    """The handle goes from one angle to another and back, some times.

    A stroke lasts a whole number of time steps, rounded up, so that the handle is at either end exactly.
    """

    kind: Literal["cycles"] = "cycles"
    amplitude: Angle | None = Field(default=None, description="Handle angle it goes to")
    output_amplitude: Angle | None = Field(default=None, description="The same, as output angle without load")
    start: Angle = Field(default=0.0, alias="from", description="Handle angle it goes from and back to")
    symmetric: bool = Field(default=False, strict=True, description="From the negative of where it goes to")
    speed: HandleSpeed | None = Field(default=None, description="Mean handle speed")
    period: Duration | None = Field(default=None, description="Duration of a cycle")
    count: int = Field(ge=1, le=1_000_000, strict=True, description="Number of cycles")
    shape: ShapeName = Field(default="triangle", description="Handle angle over time")

    @model_validator(mode="after")
    def _unambiguous(self) -> Self:
        exactly_one(self, "amplitude", "output_amplitude")
        exactly_one(self, "speed", "period")
        if self.symmetric and "start" in self.model_fields_set:
            raise ValueError("from and symmetric are both given; allowed is one of them")
        return self

    def ends(self, at: Setting) -> tuple[float, float]:
        """Return the handle angles (rad) the cycles go from and to.

        Raises
        ------
        ProtocolError
            One is beyond what is allowed, or both are the same.
        """
        if self.amplitude is not None:
            far = checked(at.inst, "amplitude", self.amplitude)
        else:
            far = of_output(at.inst, "output_amplitude", self.output_amplitude or 0.0)
        near = -far if self.symmetric else checked(at.inst, "from", self.start)
        if near == far:
            raise ProtocolError("the cycles begin where they go to; allowed is an amplitude that differs from there")
        return near, far

    def segments(self, at: Setting) -> Iterator[Segment]:
        """Yield the way to the first cycle, and the cycles."""
        near, far = self.ends(at)
        yield from self.approached(at, near)
        seconds = self.period / 2 if self.period is not None else abs(far - near) / (self.speed or 1.0)
        stroke = at.steps(seconds)

        def path(done: NDArray[np.int64]) -> Array:
            cycle = done % (2 * stroke)
            return between(near, far, SHAPES[self.shape].way(np.minimum(cycle, 2 * stroke - cycle) / stroke))

        yield self.moved(at, (near, near), 2 * stroke * self.count, path)

"""A recorded motion of the wrist."""

import math
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from tenodesis.run import Array
from tenodesis.simulate import recording
from tenodesis.simulate.choice import exactly_one
from tenodesis.simulate.command import Segment
from tenodesis.simulate.interpolation import monotone_cubic
from tenodesis.simulate.phase import Loaded, Setting
from tenodesis.simulate.reach import largest, refuse_beyond
from tenodesis.simulate.recording import Recording
from tenodesis.units import Angle

_RADIANS = {"rad": 1.0, "deg": math.radians(1)}


class Motion(Loaded):
    """The handle follows a recording: `scale` times the recorded angle plus `offset`.

    Between samples it follows a monotone piecewise cubic, so it passes through them, turns where they do, and has no
    jumps of speed, which straight lines would have at each sample.
    """

    kind: Literal["motion"] = "motion"
    file: Path | None = Field(default=None, description="CSV file, relative to the protocol's file")
    data: str | None = Field(default=None, description="What such a file holds, instead of it")
    time_column: str = Field(default="time", description="Column of times, s")
    angle_column: str = Field(default="angle", description="Column of angles")
    angle_unit: Literal["deg", "rad"] = Field(description="Unit of that column")
    scale: float = Field(default=1.0, strict=True, description="Handle angle by recorded angle")
    offset: Angle = Field(default=0.0, description="Handle angle where the recorded one is nought")
    limit: bool = Field(default=False, strict=True, description="Cut off what is beyond the ranges; else an error")

    @field_validator("file")
    @classmethod
    def _beside_the_protocol(cls, file: Path | None, info: ValidationInfo) -> Path | None:
        return file and Path((info.context or {}).get("folder", "")) / file

    @model_validator(mode="after")
    def _readable(self) -> Self:
        exactly_one(self, "file", "data")
        _ = self.recording
        return self

    @cached_property
    def recording(self) -> Recording:
        """The recording as it is in the file."""
        if self.file is None:
            return recording.parse(self.data or "", "data", self.time_column, self.angle_column)
        return recording.read(self.file, self.time_column, self.angle_column)

    def with_data(self) -> Self:
        """Return the same phase with the recording in it instead of the file it is from."""
        data = recording.text(self.recording, self.time_column, self.angle_column)
        given = {key: getattr(self, key) for key in self.model_fields_set if key != "file"}
        return type(self)(**{**given, "data": data})

    def handle_angles(self, at: Setting) -> Array:
        """Return the handle angle at every time of the recording, rad.

        Raises
        ------
        ProtocolError
            One is beyond the handle's range, or the output's without load, and is not to be cut off.
        """
        angles = self.scale * _RADIANS[self.angle_unit] * self.recording.values + self.offset
        if self.limit:
            return np.clip(angles, -largest(at.inst), largest(at.inst))
        places = zip(self.recording.lines, self.recording.times, strict=True)
        told = [f"{self.file or 'data'}: line {line} ({time:g} s): the handle angle" for line, time in places]
        refuse_beyond(at.inst, told, angles)
        return angles

    def segments(self, at: Setting) -> Iterator[Segment]:
        """Yield the way to the first sample, and the motion."""
        angles = self.handle_angles(at)
        times = self.recording.times - self.recording.times[0]
        yield from self.approached(at, float(angles[0]))

        def path(done: NDArray[np.int64]) -> Array:
            return monotone_cubic(times, angles, np.minimum(done * at.time_step, times[-1]))

        yield self.moved(at, (float(angles[0]), float(angles[-1])), at.steps(float(times[-1])), path)

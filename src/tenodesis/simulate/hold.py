"""Holding still."""

from collections.abc import Iterator
from typing import Literal

from pydantic import Field

from tenodesis.simulate.command import Segment
from tenodesis.simulate.phase import OpenLoop, Setting
from tenodesis.units import Duration


class Hold(OpenLoop):
    """Handle, loads and spool velocities stay as they are."""

    kind: Literal["hold"] = "hold"
    duration: Duration = Field(description="How long")

    def segments(self, at: Setting) -> Iterator[Segment]:
        """Yield the one segment there is."""
        yield at.still(at.held, self.duration)

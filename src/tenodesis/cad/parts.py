"""What an instrument is made of: a part with its solid, where it sits, and the dimensions of its drawing."""

from dataclasses import dataclass, field
from typing import Literal

from tenodesis.cad.kernel import Location, Point, Solid

View = Literal["front", "side", "top"]


@dataclass(frozen=True)
class Dimension:
    """A dimension of a drawing, between two points of the part, mm, seen along y (front), x (side) or z (top)."""

    name: str
    first: Point
    second: Point
    view: View = "front"
    offset: float = 0.0
    """Of the dimension line from the points, in units of the view's height; across the measured direction."""
    sign: Literal["", "Ø", "R"] = ""
    key: str = ""
    """Key of the instrument file that sets it, or the name under which a tolerance is given; by default part.name."""
    note: str = ""
    along: Literal["x", "y"] | None = None
    """Direction on the page that it measures; None for that between its points."""


@dataclass(frozen=True)
class Part:
    """A kind of part: a solid in its own frame, mm, and its places in the frames of bodies (m elsewhere)."""

    name: str
    title: str
    solid: Solid
    body: str
    """Name of the body that it is fixed to, as in :func:`tenodesis.kinematics.frames`; or "rig_bar", "bench"."""
    places: tuple[Location, ...]
    made: bool = True
    """Whether it is to be made; otherwise bought to size, and drawn for assembly only."""
    density: float = 0.0
    """kg/m³."""
    dimensions: tuple[Dimension, ...] = ()
    notes: tuple[str, ...] = ()
    away: Point = field(default=(0.0, 0.0, 0.0))
    """By how much it is moved in the exploded view, in its body's frame, mm."""
    upright: Point = (0.0, 0.0, 0.0)
    """Turn about x, y and z that puts it on the printer's bed, deg."""

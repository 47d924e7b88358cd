"""What an instrument is made of: a part with its solid, where it sits, and the dimensions of its drawing."""

import math
from dataclasses import dataclass, field
from typing import Literal

from tenodesis.cad.kernel import Location, Point, Solid

View = Literal["front", "side", "top"]
STEEL = 7800.0
"""Density of steel, kg/m³."""


PAGE: dict[View, tuple[Point, Point]] = {
    "front": ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
    "side": ((0.0, -1.0, 0.0), (0.0, 0.0, 1.0)),
    "top": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
}
"""Directions across and up the page, by view: seen from -y, from -x and from z."""


def on_page(view: View, point: Point) -> tuple[float, float]:
    """Return where a point of a part is on the page, mm."""
    across, up = (sum(one * other for one, other in zip(way, point, strict=True)) for way in PAGE[view])
    return across, up


@dataclass(frozen=True)
class Dimension:
    """A dimension of a drawing, between two points of the part, mm, seen from -y (front), -x (side) or z (top)."""

    name: str
    first: Point
    second: Point
    view: View = "front"
    side: Literal[1, -1] = 1
    """Of the view on which it stands: 1 for above or to the right."""
    sign: Literal["", "Ø", "R"] = ""
    key: str = ""
    """Key of the instrument file that sets it, under which a tolerance may be given; by default its name."""
    factor: float = 1.0
    """By which the key's value, and its tolerance, is in the dimension."""
    along: Literal["x", "y"] = "x"
    """Direction on the page that it measures."""

    @property
    def value(self) -> float:
        """Its nominal value, mm."""
        place = 0 if self.along == "x" else 1
        return abs(on_page(self.view, self.second)[place] - on_page(self.view, self.first)[place])


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


def bought(  # noqa: PLR0917
    name: str,
    title: str,
    solid: Solid,
    body: str,
    places: tuple[Location, ...],
    away: Point = (0.0, 0.0, 0.0),
    dimensions: tuple[Dimension, ...] = (),
) -> Part:
    """Return a part of steel that is bought to size."""
    return Part(name, title, solid, body, places, False, STEEL, dimensions, away=away)


def pin(  # noqa: PLR0917
    name: str,
    diameter: float,
    length: float,
    solid: Solid,
    body: str,
    places: tuple[Location, ...],
    away: Point,
) -> Part:
    """Return a dowel pin of a diameter and a length, mm."""
    return bought(name, f"Dowel pin ISO 2338 {diameter:g} x {math.ceil(length):g}", solid, body, places, away)

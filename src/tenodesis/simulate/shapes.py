"""Shapes of a stroke: the fraction of the way at a fraction of the time."""

from collections.abc import Callable
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from tenodesis.run import Array

ShapeName: TypeAlias = Literal["triangle", "sine", "smooth"]


class Shape(NamedTuple):
    """A shape, and its largest speed over its mean speed."""

    way: Callable[[Array], Array]
    peak: float


def _sine(time: Array) -> Array:
    return (1 - np.cos(np.pi * time)) / 2


def _minimum_jerk(time: Array) -> Array:
    return time**3 * (10 + time * (6 * time - 15))


SHAPES: dict[ShapeName, Shape] = {
    "triangle": Shape(np.copy, 1.0),
    "sine": Shape(_sine, np.pi / 2),
    "smooth": Shape(_minimum_jerk, 15 / 8),
}
SMOOTH = SHAPES["smooth"]

"""Series of numbers that carry their derivatives by a model's parameters along."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from tenodesis.run import Array


@dataclass(frozen=True)
class Dual:
    """A series, (n,), and its derivatives, (parameters, n); n is 1 for a number that stands for all samples."""

    value: Array
    slopes: Array

    # arrays leave arithmetic with a dual to the dual
    __array_ufunc__ = None

    def __add__(self, other: "Operand") -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.value + other.value, self.slopes + other.slopes)
        value = self.value + other
        return Dual(value, np.broadcast_to(self.slopes, (self.slopes.shape[0], value.size)))

    __radd__ = __add__

    def __neg__(self) -> "Dual":
        return Dual(-self.value, -self.slopes)

    def __sub__(self, other: "Operand") -> "Dual":
        return self + (-other)

    def __rsub__(self, other: "Array | float") -> "Dual":
        return -self + other

    def __mul__(self, other: "Operand") -> "Dual":
        if isinstance(other, Dual):
            return Dual(self.value * other.value, self.slopes * other.value + self.value * other.slopes)
        return Dual(self.value * other, self.slopes * other)

    __rmul__ = __mul__

    def __rtruediv__(self, other: "Array | float") -> "Dual":
        return Dual(other / self.value, -other / self.value**2 * self.slopes)

    def mapped(self, value: Array, slope: Array) -> "Dual":
        """Return a function of this, given its value and its derivative by this."""
        return Dual(value, slope * self.slopes)

    def exp(self) -> "Dual":
        """Return e to the power of this."""
        grown = np.exp(self.value)
        return self.mapped(grown, grown)

    def above(self, least: float) -> "Dual":
        """Return this, or the least where this is not above it."""
        over = self.value > least
        return Dual(np.where(over, self.value, least), np.where(over, self.slopes, 0.0))

    def first(self) -> "Dual":
        """Return the first sample."""
        return Dual(self.value[:1], self.slopes[:, :1])

    def taken(self, places: Array | slice) -> "Dual":
        """Return the samples at some places."""
        return Dual(self.value[places], self.slopes[:, places])


Operand: TypeAlias = Dual | Array | float


def number(value: Operand) -> Dual:
    """Return a value that depends on no parameter as a dual number; return a dual number unchanged."""
    if isinstance(value, Dual):
        return value
    return Dual(np.atleast_1d(np.asarray(value, dtype=np.float64)), np.zeros((1, 1)))


def unknowns(names: Sequence[str], values: Array, *, exact: bool) -> dict[str, Dual]:
    """Return parameters by name, each with its own derivative, or without derivatives where none is requested."""
    rows = np.eye(len(names)) if exact else np.zeros((0, len(names)))
    return {name: Dual(values[at : at + 1], rows[:, at : at + 1]) for at, name in enumerate(names)}


def joined(parts: Sequence[Dual]) -> Dual:
    """Return several series joined end to end."""
    rows = np.broadcast_shapes(*(one.slopes.shape[:1] for one in parts))[0]
    return Dual(
        np.concatenate([one.value for one in parts]),
        np.concatenate([np.broadcast_to(one.slopes, (rows, one.value.size)) for one in parts], axis=1),
    )

"""Tissue that the tip of a twin meets."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self, TypeAlias, get_args

import numpy as np

from tenodesis.errors import ArgumentError
from tenodesis.run import Array

Side: TypeAlias = Literal["flexion", "extension"]
"""Where tissue lies as seen from where the tip touches it."""


@dataclass(frozen=True)
class Contact:
    """Tissue that the tip touches at an output angle: a spring and a damper along the tip's path, which never pull.

    Its force is square to the end-effector, as a tangential force is. It grows with the way that the tip has come into
    the tissue, square to the end-effector, and with the speed of that (Kelvin and Voigt).

    Raises
    ------
    ArgumentError
        A value is not finite, a stiffness or damping is negative, the angle is beyond half a turn, or there is no such
        side.
    """

    angle: float
    """Output angle at which the tip touches, rad."""
    stiffness: float
    """At the tip, N/m; 0 is no tissue."""
    damping: float = 0.0
    """At the tip, N s/m."""
    side: Side = "flexion"
    """Whether the tissue lies at output angles above that, in flexion, or below, in extension."""

    def __post_init__(self) -> None:
        for name, unit in (("stiffness", "N/m"), ("damping", "N s/m")):
            value = getattr(self, name)
            if not 0 <= value < math.inf:
                raise ArgumentError(key=f"contact.{name}", value=value, allowed=f"0 {unit} or more")
        if not abs(self.angle) < math.pi:
            raise ArgumentError(key="contact.angle", value=self.angle, allowed="between -pi and pi rad")
        if self.side not in get_args(Side):
            raise ArgumentError(key="contact.side", value=self.side, allowed=f"one of {', '.join(get_args(Side))}")

    @classmethod
    def of_row(cls, angle: float, stiffness: float, damping: float) -> Self | None:
        """Return what a command's columns describe, as :attr:`row` gives them; None where there is no tissue."""
        return cls(angle, abs(stiffness), damping, "extension" if stiffness < 0 else "flexion") if stiffness else None

    @property
    def row(self) -> tuple[float, float, float]:
        """The columns of a command: angle, stiffness, negative in extension, and damping."""
        return self.angle, self.stiffness if self.side == "flexion" else -self.stiffness, self.damping

    def check_outside(self, output_angle: float) -> None:
        """Raise ArgumentError if a tip at an output angle, rad, is inside the tissue."""
        flexion = self.side == "flexion"
        into = output_angle - self.angle if flexion else self.angle - output_angle
        if self.stiffness and into > 0:
            at, allowed = math.degrees(output_angle), "at or above" if flexion else "at or below"
            raise ArgumentError(
                f"contact.angle is {math.degrees(self.angle):.6g} deg, but the tip, at {at:.6g} deg, is inside that "
                f"tissue already; it must be {allowed} the tip's angle.",
                key="contact.angle",
                value=self.angle,
                allowed=f"{allowed} {at:.6g} deg",
            )


NO_TISSUE = (0.0, 0.0, 0.0)
"""The columns of a command without tissue."""

Contacts: TypeAlias = Contact | Sequence[Contact | None]
"""Tissue of one axis, or by axis, None where there is none."""


def rows_of(contact: Contacts | None, axes: tuple[str, ...]) -> Array:
    """Return the columns of a command for tissue, shape (axes, 3).

    Raises ArgumentError unless there is one for each axis.
    """
    return np.array([NO_TISSUE if one is None else one.row for one in by_axis(contact, axes)])


def by_axis(contact: Contacts | None, axes: tuple[str, ...]) -> tuple[Contact | None, ...]:
    """Return the tissue of each axis; errors as :func:`rows_of`."""
    if contact is None:
        return (None,) * len(axes)
    given = (contact,) if isinstance(contact, Contact) else tuple(contact)
    if len(given) != len(axes) or not all(one is None or isinstance(one, Contact) for one in given):
        allowed = "a Contact" if len(axes) == 1 else f"a Contact or None for each of {' and '.join(axes)}"
        raise ArgumentError(key="contact", value=contact, allowed=allowed)
    return given

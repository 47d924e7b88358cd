"""Where an instrument is held in the chapters, and the loads that take most from its joints there."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from tenodesis import statics
from tenodesis.instrument import FullForm
from tenodesis.report import style
from tenodesis.report.content import Array, Chart
from tenodesis.simulate import Wrench
from tenodesis.statics import chain

_MULTIPLES = (0.5, 1.0, 2.0)
"""Of the shown load, in tables."""
_TAKEN = np.radians(10.0)
"""What the shown load takes about, from the joint that gives way most."""
_LARGEST = 5.0  # N
_FELT = 0.02
"""Share of the largest loss, by direction of a force, below which the direction is left out."""
_FARTHEST = 1.8
"""How far curves go, over the bent state."""


class State(NamedTuple):
    """A state in which the handle and the motors are held."""

    name: str
    angles: Array
    """Of the tip's joints without a load, (joints,), rad"""
    handle: Array
    """(handle joints,), rad"""
    strokes: Array
    """Wound by the motors, (tendons,), m"""

    def along(self, inst: FullForm, points: int = 61) -> tuple[Array, Array, Array]:
        """Return shares (n,) of the way from straight through this state, and handle angles and strokes there."""
        ranges = np.array([joint.range for joint in inst.handle_joints])
        beyond = np.divide(ranges, np.abs(self.handle), out=np.full(len(ranges), np.inf), where=self.handle != 0)
        shares = np.linspace(0.0, min([_FARTHEST, *beyond]), points)
        return shares, np.outer(shares, self.handle), np.outer(shares, self.strokes)


class Load(NamedTuple):
    """A load of the shown size, against flexion of the bent state."""

    name: str
    """Direction in names of results: x, y, z, grip"""
    direction: str
    """In words"""
    size: float
    """N"""
    wrench: Array
    """Force and moment at the tip, (6,), N and N m"""
    grip: float
    """Force that presses the jaws apart, N"""
    multiples: tuple[float, ...]
    """Of the load, in tables, the largest last"""

    def keys(self) -> dict[str, Any]:
        """Return the keys of a protocol's phase under this load."""
        wrench = {name: float(value) for name, value in zip(Wrench.model_fields, self.wrench, strict=True) if value}
        return {"wrench": Wrench(**wrench)} | ({"grip_force": self.grip} if self.grip else {})

    def text(self, multiple: float = 1.0) -> str:
        """Return a multiple of the load in words."""
        return f"{multiple * self.size:.3g} N {self.direction}"


def states(inst: FullForm) -> list[State]:
    """Return the straight state, and one that is bent by half of the range at the tip, or else at the handle."""
    found = []
    for name, angles in zip(("straight", "bent"), statics.usual_states(inst), strict=False):
        handle, strokes = statics.hold(inst, angles)
        found.append(State(name, angles, handle, strokes))
    return found


def loads(inst: FullForm) -> list[Load]:
    """Return the forces along the tip's axes that take something from a joint, and the grip if there are jaws.

    Forces have the sizes of the instrument's conditions. Without them, and of the grip, the size is one digit of what
    takes about ten degrees from a joint of the bent state, at most five newtons.
    """
    bent = states(inst)[-1]
    rates = chain.rates(inst, bent.handle, strokes=bent.strokes)
    by_force = rates.by_wrench[:, :3]
    most = np.abs(by_force).max(axis=0)
    given = sorted(inst.conditions.forces)
    size = given[min(1, len(given) - 1)] if given else _shown(float(most.max()))
    multiples = tuple(force / size for force in given) or _MULTIPLES
    found = []
    for n, axis in enumerate("xyz"):
        if most[n] >= _FELT * most.max():
            sign = -1.0 if by_force[:, n] @ np.sign(bent.angles + 1e-12) > 0 else 1.0
            wrench = np.zeros(6)
            wrench[n] = sign * size
            found.append(Load(axis, f"along {'−' if sign < 0 else ''}{axis}", size, wrench, 0.0, multiples))
    if inst.jaws:
        grip = _shown(float(np.abs(rates.by_grip).max()))
        found.append(Load("grip", "between the jaws", grip, np.zeros(6), grip, _MULTIPLES))
    return found


def most_taking(inst: FullForm, joint: int) -> Load:
    """Return the load that takes most from a joint of the tip, by its place, in the bent state."""
    bent = states(inst)[-1]
    rates = chain.rates(inst, bent.handle, strokes=bent.strokes)
    return max(loads(inst), key=lambda one: abs(rates.by_wrench[joint] @ one.wrench + rates.by_grip[joint] * one.grip))


def looks(inst: FullForm) -> dict[str, dict[str, Any]]:
    """Return how the curve of each joint of the tip looks, by name; wider ones show behind those drawn later."""
    names = [joint.name for joint in inst.tip_joints]
    colors = style.colors(len(names) + 1)[1:]
    return {
        name: {"color": color, "lw": max(2.8 - 0.7 * n, 1.2)}
        for n, (name, color) in enumerate(zip(names, colors, strict=True))
    }


def legend(inst: FullForm) -> list[tuple[str, str, str]]:
    """Return the entries of a legend for the joints of the tip."""
    return [(name, look["color"], "-") for name, look in looks(inst).items()]


def panels(count: int, wide: float = 2.6, height: float = 3.6) -> tuple[Chart, Sequence[Axes]]:
    """Return a chart of panels of a width, inches, side by side."""
    return Chart.panels(count, width=max(7.0, wide * count + 0.4), height=height)


def described(inst: FullForm, state: State) -> str:
    """Return the angles of a state in words."""
    angles = zip(inst.tip_joints, np.degrees(state.angles), strict=True)
    return ", ".join(f"{joint.name} {angle + 0.0:.3g}°".replace("-", "−") for joint, angle in angles)


def _shown(rate: float) -> float:
    return float(f"{_TAKEN / max(rate, _TAKEN / _LARGEST):.1g}")

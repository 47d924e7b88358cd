"""What a way of making parts allows: thinnest wall, play, backlash, steepest overhang, density."""

from collections.abc import Mapping
from typing import NamedTuple

from tenodesis.errors import ArgumentError


class Process(NamedTuple):
    """A way of making parts; lengths in m, density in kg/m³. Values are ours: to be measured on the machine at hand."""

    name: str
    material: str
    density: float
    wall: float
    """Thinnest wall."""
    play: float
    """Between parts that move against each other, on each side."""
    bore: float
    """By which a bore for a rope or pin is wider than it, on the diameter."""
    backlash: float
    """Play of a gear pair along its pitch circle."""
    overhang: float
    """Steepest overhang without a support, deg from the vertical; 90 where none is needed."""


PROCESSES: Mapping[str, Process] = {
    one.name: one
    for one in (
        Process("fdm", "PLA", 1240.0, 0.8e-3, 0.25e-3, 0.2e-3, 0.15e-3, 45.0),
        Process("sla", "resin", 1180.0, 0.5e-3, 0.12e-3, 0.1e-3, 0.08e-3, 60.0),
        Process("milled", "brass", 8500.0, 0.15e-3, 0.04e-3, 0.04e-3, 0.03e-3, 90.0),
    )
}
"""Processes by name."""


def process(name: "str | Process") -> Process:
    """Return a process by its name. Raises ValueError if there is none."""
    if isinstance(name, Process):
        return name
    if name not in PROCESSES:
        raise ArgumentError(key="process", value=name, allowed=f"one of {', '.join(PROCESSES)}")
    return PROCESSES[name]

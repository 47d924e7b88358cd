"""What a protocol asks of a twin, or of a bench."""

from typing import Protocol

from tenodesis.instrument import Instrument
from tenodesis.signals import Array, Run


class Twin(Protocol):
    """What a protocol is run on."""

    @property
    def inst(self) -> Instrument:
        """The instrument."""

    @property
    def time_step(self) -> float:
        """Time step, s."""

    @property
    def spool_radius(self) -> float:
        """Radius of the spools, m."""

    def run(self, *, handle_angle: Array, force: Array, radial_force: Array, spool_velocity: Array) -> Run:
        """Go on from the present state by as many time steps as there are commands."""

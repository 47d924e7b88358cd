"""What a protocol asks of a twin, or of a bench."""

from typing import Protocol

from numpy.typing import ArrayLike

from tenodesis.control import Controller
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run


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


class Controllable(Twin, Protocol):
    """What a protocol is run on with a controller in the loop."""

    def run(
        self,
        *,
        handle_angle: Array,
        force: Array,
        radial_force: Array,
        spool_velocity: ArrayLike = 0.0,
        controller: Controller | None = None,
        request: ArrayLike = 0,
    ) -> Run:
        """Go on as :meth:`Twin.run`; a controller is asked a request at each step, and moves the spools itself."""

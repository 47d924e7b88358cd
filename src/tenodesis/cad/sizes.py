"""Sizes that the parts of an instrument share, mm, and the refusal of those that cannot be made."""

from typing import Any, NamedTuple, NoReturn

from tenodesis.cad.process import Process
from tenodesis.errors import InstrumentError


class Sizes(NamedTuple):
    """Sizes that all parts share, mm."""

    process: Process
    rope: float
    """Diameter of a tendon."""

    @property
    def wall(self) -> float:
        """Thinnest wall."""
        return 1e3 * self.process.wall

    @property
    def play(self) -> float:
        """Between parts that move, on each side."""
        return 1e3 * self.process.play

    @property
    def bore(self) -> float:
        """By which a bore is wider than what goes through it."""
        return 1e3 * self.process.bore

    @property
    def tunnel(self) -> float:
        """Diameter of a tendon's tunnel."""
        return self.rope + self.bore

    @property
    def groove(self) -> float:
        """Radius of a groove's round bottom: 5 % more than the rope's."""
        return 0.525 * self.rope


def refuse(key: str, value: Any, because: str, allowed: str, *, unit: str = " mm") -> NoReturn:
    """Raise InstrumentError: one sentence with the dimension, its value, why it cannot be, and what would do."""
    raise InstrumentError(
        f"{key} is {value:.4g}{unit}: {because}; it must be {allowed}.", key=key, value=value, allowed=allowed
    )

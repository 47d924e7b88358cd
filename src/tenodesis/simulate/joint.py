"""The speed of the handle where a phase passes into the next."""

from typing import NamedTuple


class Edge(NamedTuple):
    """How the handle moves at an end of a phase: its speed, rad/s.

    A phase that adapts its speed there to its neighbour has an interval instead, s, over which that is the mean speed.
    """

    speed: float
    interval: float | None = None


REST = Edge(0.0)


def joint_speed(before: Edge, after: Edge) -> float:
    """Return the speed (rad/s) that both sides of a joint have, of which at least one adapts.

    It is 0 where the direction changes, else that of the neighbour that does not adapt, up to three times the mean
    speed of the other, so that a cubic remains monotone (Fritsch and Carlson 1980); between two that adapt, their
    weighted harmonic mean (Fritsch and Butland 1984).
    """
    if before.speed * after.speed <= 0:
        return 0.0
    if before.interval is not None and after.interval is not None:
        earlier, later = 2 * after.interval + before.interval, after.interval + 2 * before.interval
        return (earlier + later) / (earlier / before.speed + later / after.speed)
    fixed, adapting = (after, before) if before.interval is not None else (before, after)
    most = 3 * abs(adapting.speed)
    return max(-most, min(fixed.speed, most))

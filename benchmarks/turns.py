"""What the benchmarks have in common: things measured in turns, so that they meet the same noise, and their targets."""

from collections.abc import Callable
from timeit import timeit

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def seconds(work: Callable[[], object]) -> Callable[[], float]:
    """Return what measures how long work takes, s."""
    return lambda: timeit(work, number=1)


def rate(count: float, work: Callable[[], object]) -> Callable[[], float]:
    """Return what measures how many of so many pieces work does in a second."""
    return lambda: count / timeit(work, number=1)


def in_turns(rounds: int, *measures: Callable[[], float]) -> Array:
    """Return what each measure gives in each round, (measures, rounds)."""
    return np.array([[measure() for measure in measures] for _ in range(rounds)]).T


def judged(value: float, target: float, unit: str = "", *, most: bool = False) -> str:
    """Return a target, and whether a value reaches it: from above, or if it is the most that is allowed, from below."""
    reached = value <= target if most else value >= target
    return f"target {target:g}{unit} {'reached' if reached else 'MISSED'}"


def times_faster(peer: str, ours: Array, theirs: Array, target: float | None = None) -> None:
    """Print how many times our rates are those of a peer in the same rounds: mean of all, and the worst round."""
    mean, worst = ours.mean() / theirs.mean(), (ours / theirs).min()
    print(f"  over {peer:<40} mean {mean:6.1f}x   worst {worst:6.1f}x", end="")
    print("" if target is None else f"   {judged(mean, target, 'x')}")


def said(what: str, rates: Array, unit: str, target: float | None = None, *, per: float = 1e6) -> None:
    """Print mean and worst of rates, in millions a second, and whether the mean reaches a target."""
    print(f"  {what:<45} mean {rates.mean() / per:6.2f} {unit}   worst {rates.min() / per:6.2f}", end="")
    print("" if target is None else f"   {judged(rates.mean() / per, target)}")

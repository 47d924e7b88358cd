"""How many threads large arrays are worked on with."""

import os

_threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def set_threads(count: int) -> None:
    """Set how many threads large arrays are worked on with; results do not depend on it.

    Raises
    ------
    ValueError
        The count is below one.
    """
    global _threads  # noqa: PLW0603
    if count < 1:
        raise ValueError(f"count is {count}; allowed is a whole number of at least 1.")
    _threads = count


def threads() -> int:
    """Return how many threads large arrays are worked on with: by default, the cores there are."""
    return _threads

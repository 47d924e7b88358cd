"""Number of threads that large arrays are computed with."""

import os

from tenodesis.errors import ArgumentError

MOST_THREADS = 1024

_threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def set_threads(count: int) -> None:
    """Set the number of threads that large arrays are computed with; results do not depend on it.

    Raises
    ------
    ValueError
        The count is no integer from 1 to 1024.
    """
    global _threads  # noqa: PLW0603
    if not isinstance(count, int) or not 1 <= count <= MOST_THREADS:
        raise ArgumentError(key="count", value=count, allowed=f"an integer from 1 to {MOST_THREADS}")
    _threads = count


def threads() -> int:
    """Return the number of threads that large arrays are computed with, by default the number of cores."""
    return _threads

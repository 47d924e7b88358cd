"""Number of threads that large arrays are computed with, and pools of as many."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from tenodesis.errors import ArgumentError

if TYPE_CHECKING:
    from concurrent.futures import ThreadPoolExecutor

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


@contextmanager
def thread_pool() -> "Iterator[ThreadPoolExecutor]":
    """Yield a pool of as many threads; after an exception, Ctrl-C among them, it begins nothing more."""
    from concurrent.futures import ThreadPoolExecutor  # noqa: PLC0415 - most programs do without

    with ThreadPoolExecutor(threads()) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise

"""What works the samples out: this machine's threads, or a Ray cluster; the results are the same to the last bit."""

from collections.abc import Callable, Sequence
from typing import Protocol

from tenodesis.errors import StudyError
from tenodesis.run import Array
from tenodesis.tolerance.cluster import Cluster
from tenodesis.tolerance.evaluation import Task, evaluate

NAMES = ("threads", "ray")


class Engine(Protocol):
    """Works out chunks of samples."""

    def evaluate(self, task: Task, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order, calling `progress` with the samples of each one done."""


class Threads:
    """One chunk after the other, each by the core's own threads."""

    def evaluate(self, task: Task, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order."""
        results = []
        for chunk in chunks:
            results.append(evaluate(task, chunk))
            progress(len(chunk))
        return results


def named(engine: str, address: str | None) -> Engine:
    """Return the engine of that name.

    Raises
    ------
    StudyError
        There is none of that name, or the address does not go with it.
    """
    if engine not in NAMES:
        raise StudyError(f"engine is {engine!r}; allowed are {' and '.join(NAMES)}.")
    if engine == "threads" and address is not None:
        raise StudyError(f"address is {address!r}, but engine is threads; allowed is an address with engine ray only.")
    if engine == "threads":
        return Threads()
    if address is None:
        raise StudyError(
            "engine is ray, but there is no address; allowed is that of a running cluster, host:port or auto."
        )
    return Cluster(address)

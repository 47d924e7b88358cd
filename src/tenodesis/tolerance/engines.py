"""The engines that evaluate samples: this machine's threads, or a Ray cluster; results are equal to the last bit."""

from collections.abc import Callable, Sequence
from typing import Protocol

from tenodesis import cluster
from tenodesis.errors import StudyError
from tenodesis.run import Array
from tenodesis.tolerance.evaluation import Evaluation, evaluate

NAMES = ("threads", "ray")


class Engine(Protocol):
    """Evaluates chunks of samples."""

    def evaluate(self, task: Evaluation, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order; `progress` is called with the number of samples of each."""


class Threads:
    """Evaluates the chunks in sequence with the core's threads."""

    def evaluate(self, task: Evaluation, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order."""
        results = []
        for chunk in chunks:
            results.append(evaluate(task, chunk))
            progress(len(chunk))
        return results


class ClusterEngine:
    """A Ray cluster, by its address as :class:`tenodesis.cluster.Cluster` takes it."""

    def __init__(self, address: str) -> None:
        self.address = address

    def evaluate(self, task: Evaluation, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order.

        Raises StudyError if Ray is not installed, the cluster does not answer, or it cannot evaluate a chunk.
        """
        with cluster.Cluster(self.address) as ray:
            sizes = [len(chunk) for chunk in chunks]
            return ray.map(evaluate, task, chunks, sizes, lambda n: progress(sizes[n]))


def named(engine: str, address: str | None) -> Engine:
    """Return the engine of that name; raises StudyError if there is none, or the address does not go with it."""
    if engine not in NAMES:
        raise StudyError(key="engine", value=engine, allowed=" or ".join(NAMES))
    if engine == "threads" and address is not None:
        raise StudyError(
            f"address is {address!r}, but engine is threads; an address goes with engine ray only.",
            key="address",
            value=address,
        )
    if engine == "threads":
        return Threads()
    if address is None:
        raise StudyError(
            "engine is ray, but there is no address; it must be host:port, auto or local.",
            key="address",
        )
    return ClusterEngine(address)

"""Work shared out over a Ray cluster (extra ``cluster``), by the tolerance study and by campaigns of one's own."""

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self, TypeVar

from tenodesis.errors import StudyError
from tenodesis.threads import set_threads

__all__ = ["Cluster", "Share"]

Shared = TypeVar("Shared")
Chunk = TypeVar("Chunk")
Result = TypeVar("Result")

PATIENCE = 20.0
"""Longest time for a cluster to answer, s."""
_CONNECTION_TIMEOUT = 5.0  # s
_RETRIES = 10
_ADDRESS = "host:port of a Ray cluster's head, auto, or local"
_QUIET = {"log_to_driver": False, "logging_level": "CRITICAL"}
_UNAUTHENTICATED = "Unauthenticated"
_POLL = 0.1  # s
_MOST_OUTPUT = 1 << 20
_PROBE = "import ray, sys; ray.init(address=sys.argv[1], log_to_driver=False, logging_level='CRITICAL')"


@dataclass
class Share:
    """What a node has done."""

    chunks: int = 0
    """How many."""
    size: int = 0
    """Of these chunks, in what the caller counts."""
    seconds: float = 0.0
    """Time of its cores."""


class Cluster:
    """A Ray cluster, connected to in a ``with`` block.

    Parameters
    ----------
    address
        ``host:port`` of its head, ``auto`` for the one on this machine, or ``local`` for one that is started on this
        machine and ends with the block.

    Raises
    ------
    StudyError
        Where the block begins: Ray is not installed, or no cluster answers there.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.shares: dict[str, Share] = {}
        """What each node has done, by its address."""
        self._ours = False

    def __enter__(self) -> Self:
        ray = _imported()
        if ray.is_initialized():
            return self
        local = self.address == "local"
        if not local:
            self._check_that_it_answers()
        try:
            ray.init(address=self.address, **_QUIET, **({"include_dashboard": False} if local else {}))
        except Exception as problem:  # Ray raises whatever its layers do
            raise self._unusable(str(problem)) from None
        self._ours = True
        if not ray.cluster_resources().get("CPU", 0) >= 1:
            self.__exit__()
            raise StudyError(key="address", value=self.address, allowed="a cluster with at least 1 CPU")
        return self

    def __exit__(self, *_: object) -> None:
        if self._ours:
            self._ours = False
            _imported().shutdown()

    def map(
        self,
        function: Callable[[Shared, Chunk], Result],
        shared: Shared,
        chunks: Sequence[Chunk],
        sizes: Sequence[int],
        progress: Callable[[int], None] = lambda chunk: None,
    ) -> list[Result]:
        """Return what a function makes of the data common to all chunks and of each, in the chunks' order.

        A core at a time works on a chunk, with one thread. A chunk lost with its node is worked on again by another.

        Parameters
        ----------
        function
            Of the common data and a chunk; the nodes must have the modules that it uses.
        shared
            Sent once to each node.
        chunks
            Of about a second of work each.
        sizes
            What each chunk adds to the share of its node, such as its runs.
        progress
            Called with the number of each chunk that is done.

        Raises
        ------
        StudyError
            The cluster could not work on a chunk.
        """
        results: dict[int, Result] = {}
        for n, result in self.stream(function, shared, chunks, sizes):
            results[n] = result
            progress(n)
        return [results[n] for n in range(len(chunks))]

    def stream(
        self, function: Callable[[Shared, Chunk], Result], shared: Shared, chunks: Sequence[Chunk], sizes: Sequence[int]
    ) -> Iterator[tuple[int, Result]]:
        """Yield the number of each chunk and what the function makes of it, as they are done, otherwise as :meth:`map`.

        Raises StudyError if the cluster could not work on a chunk.
        """
        ray = _imported()
        work = ray.remote(num_cpus=1, max_retries=_RETRIES)(_alone)
        common = ray.put(shared)
        pending = {work.remote(function, common, chunk): n for n, chunk in enumerate(chunks)}
        try:
            while pending:
                done, _ = ray.wait(list(pending), num_returns=1)
                n = pending.pop(done[0])
                result, node, seconds = ray.get(done[0])
                share = self.shares.setdefault(node, Share())
                share.chunks += 1
                share.size += sizes[n]
                share.seconds += seconds
                yield n, result
        except ray.exceptions.RayError as problem:
            reason = str(problem).strip().splitlines()[-1]
            raise StudyError(
                f"the cluster at {self.address} could not work on a chunk: {reason}", key="address", value=self.address
            ) from None

    def _check_that_it_answers(self) -> None:
        """Raise for an address where no cluster answers; Ray itself would wait for minutes and then end the process."""
        if self.address != "auto":
            host, _, port = self.address.rpartition(":")
            if not host or "/" in host or not port.isdigit():
                raise StudyError(key="address", value=self.address, allowed=_ADDRESS)
            try:
                socket.create_connection((host.strip("[]"), int(port)), timeout=_CONNECTION_TIMEOUT).close()
            except (OSError, OverflowError) as problem:
                raise self._unusable(str(getattr(problem, "strerror", None) or problem)) from None
        returned, errors = self._probe()
        if returned is None:
            reason = f"it did not answer as a cluster within {PATIENCE:g} s"
            if _UNAUTHENTICATED in errors:
                reason = "it does not accept the token: RAY_AUTH_MODE and RAY_AUTH_TOKEN must be the cluster's"
            raise self._unusable(reason)
        if returned:
            lines = [line for line in errors.splitlines() if "Error: " in line]
            raise self._unusable(lines[-1].partition("Error: ")[2] if lines else "it gave no reason")

    def _probe(self) -> tuple[int | None, str]:
        """Connect in a separate process and return its exit status (None without an answer) and its errors."""
        with tempfile.TemporaryFile() as output:
            probe = subprocess.Popen(
                [sys.executable, "-c", _PROBE, self.address], stdout=subprocess.DEVNULL, stderr=output
            )

            def errors() -> str:
                # Read at a position, since the process writes at the common one.
                return os.pread(output.fileno(), _MOST_OUTPUT, 0).decode("utf-8", "replace")

            try:
                deadline = time.monotonic() + PATIENCE
                while probe.poll() is None and time.monotonic() < deadline and _UNAUTHENTICATED not in errors():
                    time.sleep(_POLL)
                return probe.poll(), errors()
            finally:
                probe.kill()
                probe.wait()

    def _unusable(self, reason: str) -> StudyError:
        reason = reason.strip().splitlines()[0].rstrip(".")
        return StudyError(
            f"no Ray cluster can be used at {self.address} ({reason}); the address must be {_ADDRESS}.",
            key="address",
            value=self.address,
            allowed=_ADDRESS,
        )


def _imported() -> Any:
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    try:
        import ray  # noqa: PLC0415
    except ImportError:
        raise StudyError(
            "Ray is not installed; pip install 'tenodesis[cluster]' adds it.",
            key="module",
            value="ray",
            allowed="installed with the extra [cluster]",
        ) from None
    return ray


def _alone(function: Callable[[Shared, Chunk], Result], shared: Shared, chunk: Chunk) -> tuple[Result, str, float]:
    """Work on a chunk with a single thread, which is what the cluster reserves for it; also node and time taken, s."""
    set_threads(1)
    begun = time.perf_counter()
    result = function(shared, chunk)
    return result, _imported().util.get_node_ip_address(), time.perf_counter() - begun

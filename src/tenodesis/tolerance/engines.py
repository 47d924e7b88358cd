"""The engines that evaluate samples: this machine's threads, or a Ray cluster; results are equal to the last bit."""

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Protocol

from tenodesis.errors import StudyError
from tenodesis.run import Array
from tenodesis.threads import set_threads
from tenodesis.tolerance.evaluation import Task, evaluate

NAMES = ("threads", "ray")

PATIENCE = 20.0
"""Longest time for a cluster to answer, s."""
_CONNECTION_TIMEOUT = 5.0  # s
_RETRIES = 10
_ADDRESS = "host:port of a Ray cluster's head, or auto"
_QUIET = {"log_to_driver": False, "logging_level": "CRITICAL"}
_UNAUTHENTICATED = "Unauthenticated"
_POLL = 0.1  # s
_MOST_OUTPUT = 1 << 20
_PROBE = "import ray, sys; ray.init(address=sys.argv[1], log_to_driver=False, logging_level='CRITICAL')"


class Engine(Protocol):
    """Evaluates chunks of samples."""

    def evaluate(self, task: Task, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order; `progress` is called with the number of samples of each."""


class Threads:
    """Evaluates the chunks in sequence with the core's threads."""

    def evaluate(self, task: Task, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order."""
        results = []
        for chunk in chunks:
            results.append(evaluate(task, chunk))
            progress(len(chunk))
        return results


class Cluster:
    """A running Ray cluster, by the host:port of its head, or auto for the one on this machine.

    A chunk lost with its node is evaluated again by another.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    def evaluate(self, task: Task, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order.

        Raises StudyError if Ray is not installed, the cluster does not answer, or it cannot evaluate a chunk.
        """
        ray = _imported()
        with self._connected(ray):
            work = ray.remote(num_cpus=1, max_retries=_RETRIES)(_evaluate_alone)
            shared = ray.put(task)
            pending = {work.remote(shared, chunk): n for n, chunk in enumerate(chunks)}
            results: dict[int, Array] = {}
            try:
                while pending:
                    done, _ = ray.wait(list(pending), num_returns=1)
                    n = pending.pop(done[0])
                    results[n] = ray.get(done[0])
                    progress(len(chunks[n]))
            except ray.exceptions.RayError as problem:
                reason = str(problem).strip().splitlines()[-1]
                raise StudyError(
                    f"the cluster at {self.address} could not evaluate a chunk of samples: {reason}"
                ) from None
        return [results[n] for n in range(len(chunks))]

    @contextmanager
    def _connected(self, ray: Any) -> Iterator[None]:
        if ray.is_initialized():
            yield
            return
        self._check_that_it_answers()
        try:
            ray.init(address=self.address, **_QUIET)
        except Exception as problem:  # Ray raises whatever its layers do
            raise self._unusable(str(problem)) from None
        try:
            if not ray.cluster_resources().get("CPU", 0) >= 1:
                raise StudyError(f"the cluster at {self.address} has no CPU to work with; it must have at least 1.")
            yield
        finally:
            ray.shutdown()

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
        raise StudyError("engine is ray, but Ray is not installed; pip install 'tenodesis[cluster]' adds it.") from None
    return ray


def _evaluate_alone(task: Task, rows: Array) -> Array:
    """Evaluate a chunk with a single thread, which is what the cluster reserves for it."""
    set_threads(1)
    return evaluate(task, rows)


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
            "engine is ray, but there is no address; it must be that of a running cluster, host:port or auto.",
            key="address",
        )
    return Cluster(address)

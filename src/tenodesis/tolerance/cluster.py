"""The samples worked out on a Ray cluster, for those who outgrow one machine."""

import os
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from tenodesis.errors import StudyError
from tenodesis.run import Array
from tenodesis.threads import set_threads
from tenodesis.tolerance.evaluation import Task, evaluate

PATIENCE = 20.0
"""Time for a cluster to answer, s."""
_KNOCK = 5.0  # s
_RETRIES = 10
_QUIET = {"log_to_driver": False, "logging_level": "CRITICAL"}
_UNAUTHENTICATED = b"Unauthenticated"
_PROBE = "import ray, sys; ray.init(address=sys.argv[1], log_to_driver=False, logging_level='CRITICAL')"


class Cluster:
    """A running Ray cluster; a chunk lost with its node is worked out again by another.

    Parameters
    ----------
    address
        Where it is, host:port of its head, or auto for the one on this machine.
    """

    def __init__(self, address: str) -> None:
        self.address = address

    def evaluate(self, task: Task, chunks: Sequence[Array], progress: Callable[[int], None]) -> list[Array]:
        """Return the results of the chunks in their order; they come back in any.

        Raises
        ------
        StudyError
            Ray is not installed, the cluster does not answer, or it cannot work out a chunk.
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
                told = str(problem).strip().splitlines()[-1]
                raise StudyError(
                    f"the cluster at {self.address} could not work out a chunk of samples: {told}"
                ) from None
        return [results[n] for n in range(len(chunks))]

    @contextmanager
    def _connected(self, ray: Any) -> Iterator[None]:
        if ray.is_initialized():
            yield
            return
        self._knock()
        try:
            ray.init(address=self.address, **_QUIET)
        except Exception as problem:  # Ray raises whatever its layers do
            raise StudyError(self._refused(str(problem))) from None
        try:
            if not ray.cluster_resources().get("CPU", 0) >= 1:
                raise StudyError(
                    f"the cluster at {self.address} has no CPU to work with; allowed is one with at least 1."
                )
            yield
        finally:
            ray.shutdown()

    def _knock(self) -> None:
        """Refuse an address where no cluster answers; Ray itself would wait for minutes and then end the process."""
        if self.address != "auto":
            host, _, port = self.address.rpartition(":")
            if not host or "/" in host or not port.isdigit():
                raise StudyError(f"address is {self.address!r}; allowed is host:port of a Ray cluster's head, or auto.")
            try:
                socket.create_connection((host.strip("[]"), int(port)), timeout=_KNOCK).close()
            except (OSError, OverflowError) as problem:
                told = getattr(problem, "strerror", None) or problem
                raise StudyError(self._refused(str(told))) from None
        try:
            probe = subprocess.run(
                [sys.executable, "-c", _PROBE, self.address],
                capture_output=True,
                text=True,
                timeout=PATIENCE,
                check=False,
            )
        except subprocess.TimeoutExpired as waited:
            if _UNAUTHENTICATED in (waited.stderr or b""):
                reason = "it does not accept the token: RAY_AUTH_MODE and RAY_AUTH_TOKEN must be the cluster's"
            else:
                reason = f"what is there did not answer as a cluster within {PATIENCE:g} s"
            raise StudyError(self._refused(reason)) from None
        if probe.returncode:
            lines = [line for line in probe.stderr.splitlines() if "Error: " in line]
            raise StudyError(self._refused(lines[-1].partition("Error: ")[2] if lines else "it gave no reason"))

    def _refused(self, reason: str) -> str:
        reason = reason.strip().splitlines()[0].rstrip(".")
        return f"no Ray cluster can be used at {self.address} ({reason}); allowed is host:port of its head, or auto."


def _imported() -> Any:
    os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
    try:
        import ray  # noqa: PLC0415
    except ImportError:
        raise StudyError("engine is ray, but Ray is not installed; pip install 'tenodesis[cluster]' adds it.") from None
    return ray


def _evaluate_alone(task: Task, rows: Array) -> Array:
    """Work out a chunk by one thread, since that is what the cluster reckons with."""
    set_threads(1)
    return evaluate(task, rows)

"""The Ray engine, on a cluster of two nodes on this machine's loopback addresses."""

import fcntl
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tenodesis import cluster, tolerance, twin
from tenodesis.control import Controller
from tenodesis.errors import StudyError
from tenodesis.instrument import Instrument
from tenodesis.tolerance import conduct

from .conftest import refused
from .test_tolerance import FEW, assert_same, varied

# Not imported here, since Ray reads how to authenticate when it is.
if find_spec("ray") is None:
    pytest.skip("Ray is not installed: pip install 'tenodesis[cluster]'", allow_module_level=True)
if not Path("/proc/self/cmdline").exists():
    pytest.skip("the test finds a cluster's processes in /proc", allow_module_level=True)

# Ray takes 127.0.0.1 for the machine's outer address.
HEAD, SECOND = "127.0.0.2", "127.0.0.3"


ATTEMPTS = 4
"""Ray gives a node 30 s to start, and has no option for it: a node of a busy machine may need another attempt."""
PATIENCE = 300.0
"""For a cluster that answers beside everything else that this machine does, s."""


class TwoNodes:
    """A cluster whose processes all name its own folder, so that no other's are ever touched."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.address = ""
        self.agents: set[int] = set()

    def start(self) -> None:
        for _ in range(ATTEMPTS):
            self.address = f"{HEAD}:{free_port()}"
            problem = self.start_both()
            if problem is None:
                break
            self.stop()
        else:
            pytest.fail(f"Ray has not started in {ATTEMPTS} attempts. {problem}")
        self.agents = {child for pid, _ in self.processes() for child in children(pid)}

    def start_both(self) -> str | None:
        """Start the nodes; return what Ray says if one has not started."""
        common = ["--num-cpus=1", "--object-store-memory=80000000", "--disable-usage-stats"]
        port = self.address.rpartition(":")[2]
        head = ["--head", f"--port={port}", f"--node-ip-address={HEAD}", "--include-dashboard=false"]
        for arguments in (
            [*head, f"--temp-dir={self.folder}"],
            [f"--address={self.address}", f"--node-ip-address={SECOND}"],
        ):
            started = subprocess.run(
                [str(Path(sys.executable).with_name("ray")), "start", *arguments, *common],
                capture_output=True,
                text=True,
                timeout=600,
                check=False,
            )
            if started.returncode != 0:
                return started.stdout + started.stderr
        return None

    def processes(self) -> Iterator[tuple[int, list[str]]]:
        for entry in Path("/proc").iterdir():
            if entry.name.isdigit() and int(entry.name) != os.getpid():
                words = title(int(entry.name)).split("\0")
                if any(str(self.folder) in word for word in words):
                    yield int(entry.name), words

    @cached_property
    def second(self) -> int:
        """The process that stands for the second node, its raylet."""
        (raylet,) = [
            pid
            for pid, words in self.processes()
            if words[0].endswith("/raylet") and any(word.endswith(f"={SECOND}") for word in words)
        ]
        return raylet

    @property
    def second_is_at_work(self) -> bool:
        return any(title(pid).startswith("ray::_alone") for pid in children(self.second))

    def stop(self) -> None:
        # Agents take another title than their command line, and are found as children.
        left = {pid for pid, _ in self.processes()} | self.agents
        left |= {pid for parent in left for pid in children(parent)}
        for pid in left:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)


def children(parent: int) -> list[int]:
    """Return a process's children, none if it is gone."""
    with suppress(OSError):
        threads = Path(f"/proc/{parent}/task").iterdir()
        return [int(pid) for thread in threads for pid in (thread / "children").read_text().split()]
    return []


def title(pid: int) -> str:
    """Return what a process calls itself, nothing if it is gone."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_text("utf-8", "replace")
    return ""


def free_port() -> int:
    with socket.socket() as listener:
        listener.bind((HEAD, 0))
        return int(listener.getsockname()[1])


@contextmanager
def one_cluster_at_a_time() -> Iterator[None]:
    """Wait for the cluster of another test process, which has the same addresses and starts as many processes."""
    with (Path(tempfile.gettempdir()) / f"tenodesis-ray-{os.getuid()}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


@pytest.fixture
def two_nodes(monkeypatch: pytest.MonkeyPatch) -> Iterator[TwoNodes]:
    for key, value in {
        "RAY_AUTH_MODE": "token",
        "RAY_AUTH_TOKEN": secrets.token_hex(16),
        "RAY_USAGE_STATS_ENABLED": "0",
        # A dead node, which refuses the connection, is noticed in seconds; one that waits for the processor lives.
        "RAY_health_check_initial_delay_ms": "500",
        "RAY_health_check_period_ms": "500",
        "RAY_health_check_timeout_ms": "60000",
        "RAY_health_check_failure_threshold": "3",
    }.items():
        monkeypatch.setenv(key, value)
    # The path of a socket may not have more than about a hundred characters.
    with (
        one_cluster_at_a_time(),
        tempfile.TemporaryDirectory(prefix="tenodesis-ray-", ignore_cleanup_errors=True) as folder,
    ):
        nodes = TwoNodes(Path(folder))
        try:
            nodes.start()
            yield nodes
        finally:
            nodes.stop()


@pytest.mark.process
def test_nodes_share_a_campaign_and_one_killed_at_work_loses_nothing(
    real: Instrument, scaled: Instrument, two_nodes: TwoNodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", PATIENCE)
    monkeypatch.setattr(conduct, "CHUNK", 32)
    reported: list[int] = []
    killed_at: list[int] = []

    def progress(done: int, total: int) -> None:
        reported.append(done)
        if not killed_at and two_nodes.second_is_at_work:
            killed_at.append(done)
            os.kill(two_nodes.second, signal.SIGKILL)

    def campaign(insts: list[Instrument], law: Any) -> Any:
        controllers = [Controller(scaled, law=law) for _ in insts]
        return twin.run_many(insts, np.full(2000, 0.1), 0.5, controllers=controllers)["output_angle"]

    def lasting(insts: list[Instrument], law: Any) -> Any:
        # So that the second node has started before the first has done all.
        time.sleep(1.0)
        return campaign(insts, law)

    plants, laws = [scaled.replace(pretension=tension) for tension in (20, 25, 30)], ["off", "robust"] * 8
    arguments = (real, scaled, varied(*FEW))
    with cluster.Cluster(two_nodes.address) as nodes:
        for law, angles in zip(laws, nodes.map(lasting, plants, laws, [len(plants)] * len(laws)), strict=True):
            np.testing.assert_array_equal(angles, campaign(plants, law))
        assert set(nodes.shares) == {HEAD, SECOND} and all(share.seconds > 0 for share in nodes.shares.values())
        assert sum(share.size for share in nodes.shares.values()) == len(plants) * len(laws)
        found = tolerance.study(
            *arguments, samples=2048, seed=5, engine="ray", address=two_nodes.address, progress=progress
        )
    assert killed_at and killed_at[0] < found.runs
    assert reported[-1] == found.runs
    assert_same(found, tolerance.study(*arguments, samples=2048, seed=5))
    assert np.isfinite(found.responses["loss_flexion"].scheme).all()


@pytest.mark.process
def test_a_cluster_that_wants_another_token_is_distinguished_from_none(
    real: Instrument, scaled: Instrument, two_nodes: TwoNodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", PATIENCE)
    monkeypatch.setenv("RAY_AUTH_TOKEN", secrets.token_hex(16))
    with refused("address", kind=StudyError):
        tolerance.study(real, scaled, varied(*FEW), samples=8, engine="ray", address=two_nodes.address)


@pytest.mark.parametrize(
    ("address", "message"),
    [
        (lambda: f"{HEAD}:{free_port()}", r"no Ray cluster can be used at 127\.0\.0\.2:\d+ \(Connection refused\)"),
        (lambda: "nonsense", "address is 'nonsense'; it must be host:port of a Ray cluster's head, auto, or local"),
        (lambda: f"{HEAD}:99999", "no Ray cluster can be used at 127.0.0.2:99999"),
    ],
)
def test_where_no_cluster_is_one_sentence_says_so(
    real: Instrument, scaled: Instrument, address: Callable[[], str], message: str
) -> None:
    with pytest.raises(StudyError, match=message):
        tolerance.study(real, scaled, varied(*FEW), samples=8, engine="ray", address=address())


@pytest.mark.process
def test_what_listens_but_is_no_cluster_is_given_up_in_time(
    real: Instrument, scaled: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster, "PATIENCE", 2.0)
    with socket.socket() as mute:
        mute.bind((HEAD, 0))
        mute.listen()
        address = f"{HEAD}:{mute.getsockname()[1]}"
        with refused("address", kind=StudyError):
            tolerance.study(real, scaled, varied(*FEW), samples=8, engine="ray", address=address)


def test_without_ray_the_extra_is_named(real: Instrument, scaled: Instrument, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with refused("module", "ray", kind=StudyError):
        tolerance.study(real, scaled, varied(*FEW), samples=8, engine="ray", address="127.0.0.2:6379")

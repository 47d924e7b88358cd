"""Claims about ends: a process that is asked to end does, whatever it is at, and what it leaves is tidied up."""

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from tenodesis.errors import LiveError
from tenodesis.live import folder as folders
from tenodesis.live import host as hosts
from tenodesis.live import runtime_process
from tenodesis.live.host import Host

from .conftest import ROOT, until

pytestmark = pytest.mark.process


def python(program: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60, cwd=ROOT
    )


def test_a_signal_within_the_wait_for_it_is_not_a_deadlock() -> None:
    """The main thread holds the event's lock when the signal comes, as it does for moments of every wait."""
    done = python("""
import os, signal, threading
from tenodesis.live.shutdown import on_signal
before = [signal.getsignal(one) for one in (signal.SIGTERM, signal.SIGINT)]
for number in (signal.SIGTERM, signal.SIGINT):
    stop = threading.Event()
    with on_signal(stop.set):
        with stop._cond:
            os.kill(os.getpid(), number)
            for _ in range(100_000):
                pass
        assert stop.wait(30)
assert [signal.getsignal(one) for one in (signal.SIGTERM, signal.SIGINT)] == before
assert signal.set_wakeup_fd(-1) == -1
assert threading.active_count() == 1
print("ended")
""")
    assert (done.stdout, done.stderr, done.returncode) == ("ended\n", "", 0)


def test_a_recorder_told_to_end_within_its_wait_ends() -> None:
    done = python("""
import os, signal, sys
from tenodesis.live.recorder import RecordingOutcome, supervise
def work(stop):
    with stop._cond:
        os.kill(os.getpid(), signal.SIGTERM)
        for _ in range(100_000):
            pass
    assert stop.wait(30)
    return RecordingOutcome(0, 0.0, 0, 0)
sys.exit(supervise(work))
""")
    assert (done.stderr, done.returncode) == ("", 0)


@pytest.fixture
def place(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder in which hosts put theirs; the path of a socket may not be long."""
    with tempfile.TemporaryDirectory() as folder:
        monkeypatch.setattr(hosts, "_SHARED", Path(folder))
        yield Path(folder)


def test_a_runtime_ends_in_order_when_it_is_told_to_and_one_that_does_not_start_in_time_is_ended(
    place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    host = Host("scaled-up", recordings=tmp_path)
    assert host._process is not None
    process = host._process._process
    process.send_signal(signal.SIGTERM)
    assert process.wait(20) == 0
    started, make = [], subprocess.Popen

    def starting(*arguments: object, **options: object) -> "subprocess.Popen[bytes]":
        started.append(make(*arguments, **options))  # type: ignore[call-overload]
        return started[-1]  # type: ignore[no-any-return]

    monkeypatch.setattr(runtime_process, "_TO_START", 0.0)
    monkeypatch.setattr(runtime_process.subprocess, "Popen", starting)
    with pytest.raises(LiveError, match="the runtime has not started within 0 s"):
        host.start("real-size")
    assert host.generation == 1
    assert started[0].returncode is not None
    host.close()
    assert list(place.iterdir()) == []


def test_what_a_killed_host_left_is_kept_until_nobody_works_in_it(place: Path) -> None:
    """Numbers of processes say nothing: to another namespace of processes, all those of this one are strangers."""
    killed, mine, other = place / "tenodesis-1-x", place / "tenodesis-x", place / "tenodesis-other"
    for folder in (killed, mine, other):
        (folder / "1").mkdir(parents=True)
        (folder / "1" / "ring").write_bytes(b"ticks")
    host, held = folders.make_lock(killed), folders.make_lock(mine)
    # As a runtime that is still closing its recording.
    closing = subprocess.Popen(["cat"], stdin=subprocess.PIPE, pass_fds=(host,))
    os.close(host)
    try:
        hosts._tidy()
        assert (killed / "1" / "ring").exists()
    finally:
        closing.communicate()
    hosts._tidy()
    assert not killed.exists()
    assert (mine / "1" / "ring").exists()
    assert (other / "1" / "ring").exists()
    os.close(held)


def test_a_killed_host_leaves_its_runtime_its_folder_until_that_has_ended(place: Path, tmp_path: Path) -> None:
    program = f"""
import time
from pathlib import Path
from tenodesis.live import host
host._SHARED = Path({str(place)!r})
live = host.Host("scaled-up", recordings=Path({str(tmp_path)!r}))
print(live.pid, live.folder, flush=True)
time.sleep(600)
"""
    killed = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert killed.stdout is not None
    pid, folder = killed.stdout.readline().split()
    os.kill(int(pid), signal.SIGSTOP)
    killed.kill()
    killed.communicate()
    hosts._tidy()
    assert (Path(folder) / "ring").exists()
    os.kill(int(pid), signal.SIGCONT)
    until(lambda: hosts._tidy() or not Path(folder).exists())

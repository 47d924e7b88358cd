"""Cost of a tick of the complete live loop, relative to the controller alone in the same ticks, and timing.

Peer: the controller alone, timed within the same ticks. The rest of a tick is the twin's step, the orders, and the
record in shared memory that every watcher reads.
"""

import argparse
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

import tenodesis as tn
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders
from tenodesis.live.loop import Choices, LiveLoop
from tenodesis.live.ticks import Reader

TICKS = 200_000
BLOCK = 4000


def made(folder: Path, name: str, **choices: object) -> LiveLoop:
    inst = tn.load(name)
    (folder / folders.INSTRUMENT).write_text(to_toml(inst), "utf-8")
    loop = LiveLoop(inst, folder, Choices(**choices))  # type: ignore[arg-type]
    has = loop.capabilities
    folders.write(folder, folders.About(inst, has.name, loop.period, has.simulated, has.distal_encoder, "", 0))
    return loop


def ticks(name: str) -> None:
    """Compute time of a tick while the handle turns and the tip is loaded, as fast as it goes, with one watcher."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        loop = made(Path(folder), name, real_time=False)
        reader = Reader(folder)
        loop.request("enable")
        handle = np.radians(25) * np.sin(2 * np.pi * np.arange(BLOCK) / BLOCK)
        rows = np.stack([handle, np.full(BLOCK, 0.5), np.zeros(BLOCK)], -1)[:, np.newaxis]
        lost = 0
        for _ in range(TICKS // BLOCK):
            loop.push(rows)
            loop.core.run_ticks(BLOCK)
            lost += reader.read(2 * BLOCK)[1]
        compute, control = loop.core.compute, loop.core.control
        print(
            f"{name:10}: a tick through the runtime p50 {compute[0] * 1e9:5.0f} ns, "
            f"p99 {compute[1] * 1e9:6.0f} ns, worst {compute[2] * 1e6:6.1f} us; the controller alone "
            f"p50 {control[0] * 1e9:5.0f} ns, worst {control[2] * 1e6:6.1f} us; ratio of p50 "
            f"{compute[0] / control[0]:.2f}, of worst {compute[2] / control[2]:.2f}; "
            f"{TICKS} ticks, lost to the watcher {lost}"
        )


def on_time(name: str, seconds: float) -> None:
    """How late ticks begin at 2 kHz by the clock, with a watcher that reads all, while another thread is busy."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        loop = made(Path(folder), name)
        reader = Reader(folder)
        loop.request("enable")
        ending = threading.Event()

        def busy() -> None:
            while not ending.is_set():
                np.linalg.norm(np.random.default_rng().random((200, 200)))

        worker = threading.Thread(target=busy)
        worker.start()
        loop.start()
        read = lost = 0
        end = time.monotonic() + seconds
        memory = resident()
        while time.monotonic() < end:
            run, more = reader.read(4000)
            read, lost = read + len(run), lost + more
            time.sleep(0.05)
        grown = resident() - memory
        loop.finish()
        run, more = reader.read(10**6)
        read, lost = read + len(run), lost + more
        ending.set()
        worker.join()
        core, late = loop.core, loop.core.lateness
        print(
            f"{name:10}: {seconds:g} s at {1 / loop.period:g} Hz beside a busy thread: {core.ticks} ticks of "
            f"{seconds / loop.period:.0f} due, read {read}, lost {lost}; late {core.late} "
            f"({100 * core.late / max(core.ticks, 1):.2f} %), given up {core.missed}; lateness "
            f"p50 {late[0] * 1e6:.0f} us, p99 {late[1] * 1e6:.0f} us, worst {late[2] * 1e3:.1f} ms; "
            f"memory grown {grown / 1e6:+.1f} MB"
        )
        for sentence in core.refused:
            print(f"{'':10}  {sentence}")


def resident() -> int:
    """Memory of this process, bytes."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0, help="of the run by the clock")
    given = parser.parse_args()
    for one in ("real-size", "scaled-up"):
        ticks(one)
    on_time("scaled-up", given.seconds)

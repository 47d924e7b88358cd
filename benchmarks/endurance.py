"""A long live session with all processes: ticks, their rows in the recording, and memory.

A runtime process, its recorder and an operator who turns the handle and changes the load, beside busy processes.
At the end the file is read back: each tick of the recording must be in it once, a period after the
one before. There is no peer to compare with; the figures are counts.
"""

import argparse
import json
import multiprocessing
import os
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.progress import track

import tenodesis as tn
from tenodesis.instrument import as_short_form
from tenodesis.live.host import Host
from tenodesis.live.recorder import STATUS

STEP = 0.05
"""Time between two things that the operator does, s."""
WARM = 10.0
"""Time after which memory is taken for that of a process at work, s."""


def busy() -> None:
    """Compute for nothing."""
    random = np.random.default_rng(1)
    while True:
        np.linalg.svd(random.random((200, 200)))


def resident(pid: int) -> float:
    """Return a process's memory, MB."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def session(name: str, seconds: float, folder: Path) -> Path:
    """Operate an instrument for a time, recorded; return the recording."""
    host = Host(name, recordings=folder)
    link = host.connect("endurance")
    try:
        link.acquire()
        link.request("enable")
        path = link.record(True, "endurance")
        inst = as_short_form(link.inst)
        axes, range_ = len(inst.axes), 0.9 * inst.handle_range
        memory: dict[str, list[float]] = {"runtime": [], "recorder": []}
        loads: list[float] = []
        begun, before = time.monotonic(), link.status().timing
        for step in track(range(round(seconds / STEP)), description=f"{name}, live", transient=True):
            passed = time.monotonic() - begun
            link.heartbeat()
            link.hand([range_ * np.sin(1.3 * passed)] * axes)
            link.force([0.3 * (1 + np.sin(0.4 * passed))] * axes)
            if step % round(1 / STEP) == 0 and passed > min(WARM, seconds / 2):
                recorder = json.loads((host.folder / STATUS).read_text())["pid"]
                memory["runtime"].append(resident(host.pid or 0))
                memory["recorder"].append(resident(recorder))
                loads.append(os.getloadavg()[0])
            time.sleep(max(0.0, begun + (step + 1) * STEP - time.monotonic()))
        status = link.status()
        link.record(False)
    finally:
        link.close()
        host.close()
    timing = status.timing
    ticks = timing.ticks - before.ticks
    late = timing.late - before.late
    print(
        f"{name}: {seconds:g} s at {inst.sensors.sampling_rate:g} Hz, load {min(loads):.1f}-{max(loads):.1f}: "
        f"{ticks} ticks, given up {timing.missed - before.missed}, more than half a period late {late} "
        f"({100 * late / ticks:.2f} %); lateness p99 {1e6 * timing.lateness_p99:.0f} us, "
        f"worst {1e3 * timing.lateness_worst:.1f} ms; at the end {status.state}, {status.problem or 'no problem'}"
    )
    for process, values in memory.items():
        print(f"{'':4}memory of the {process}: {values[0]:.1f} MB, at most {max(values):.1f}, at last {values[-1]:.1f}")
    assert path is not None
    return path


def read_back(path: Path, period: float) -> None:
    """Count the rows of a recording by their times."""
    recording = tn.Recording.open(path, signals=["commanded_handle_angle"])
    steps = np.diff(recording.run.time)
    ends = [event.content for event in recording.events if event.content.get("event") == "recording_ended"]
    print(
        f"    recording: {path.stat().st_size / 1e6:.1f} MB, {len(steps) + 1} rows over {steps.sum():.3f} s, of "
        f"{steps.sum() / period + 1:.0f} due; intervals other than a period: {np.sum(np.abs(steps - period) > 1e-6)}; "
        f"it says {', '.join(map(str, ends))}; damage: {recording.damage}"
    )


def main() -> None:
    """Run a session and read its recording back."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--instrument", default="scaled-up")
    parser.add_argument("--busy", type=int, default=os.cpu_count() or 1, help="processes that compute beside it")
    given = parser.parse_args()
    workers = [multiprocessing.Process(target=busy, daemon=True) for _ in range(given.busy)]
    for worker in workers:
        worker.start()
    with tempfile.TemporaryDirectory() as folder:
        try:
            path = session(given.instrument, given.seconds, Path(folder))
        finally:
            for worker in workers:
                worker.kill()
        read_back(path, 1 / tn.load(given.instrument).sensors.sampling_rate)


if __name__ == "__main__":
    main()

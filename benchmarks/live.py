"""Cost of a tick of the complete live loop, relative to the controller alone in the same ticks.

Peer: the controller alone, timed within the same ticks. The rest of a tick is the twin's step, the orders, and the
record in shared memory that every watcher reads. How punctual ticks are by the clock, ``endurance.py`` measures.
"""

import tempfile
from pathlib import Path

import numpy as np

import tenodesis as tn
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders
from tenodesis.live.loop import Choices, LiveLoop
from tenodesis.live.ticks import Reader
from tenodesis.twin.rows import columns_by_name

TICKS = 200_000
BLOCK = 4000


def made(folder: Path, name: str, **choices: object) -> LiveLoop:
    inst = tn.load(name)
    (folder / folders.INSTRUMENT).write_text(to_toml(inst), "utf-8")
    loop = LiveLoop(inst, folder, Choices(**choices))  # type: ignore[arg-type]
    has, device = loop.capabilities, loop.device
    sides = device.commands, device.signals
    folders.write(folder, folders.About(inst, has.name, loop.period, has.simulated, has.distal_encoder, "", 0, *sides))
    return loop


def ticks(name: str) -> None:
    """Compute time of a tick while the handle turns and the tip is loaded, as fast as it goes, with one watcher."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        loop = made(Path(folder), name, real_time=False)
        reader = Reader(folder)
        loop.request("enable")
        handle = np.radians(25) * np.sin(2 * np.pi * np.arange(BLOCK) / BLOCK)
        columns = columns_by_name(loop.device.commands)
        rows = np.zeros((BLOCK, sum(width for _, width in loop.device.commands)))
        rows[:, columns["handle_angle"]], rows[:, columns["force"]] = handle[:, np.newaxis], 0.5
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


if __name__ == "__main__":
    for one in ("real-size", "scaled-up"):
        ticks(one)

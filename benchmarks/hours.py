"""Time and peak memory of every command that writes or reads a long recording, and how soon Ctrl-C ends it."""

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

_CYCLE = 2.568
"""Duration of a cycle of the protocol on the instrument, s."""
_INTERRUPTED_AFTER = 4.0
"""s, of which a second or two go by until a command's work begins."""
_PROTOCOL = """name = "hours"
[[phases]]
kind = "cycles"
output_amplitude = "60 deg"
speed = "20 deg/s"
count = {count}
force = "1 N"
"""


class Measured(NamedTuple):
    """How a command ended: time until then, s, peak memory, MB, and exit code."""

    seconds: float
    megabytes: float
    exit_code: int


def commands(recording: str) -> dict[str, list[str]]:
    """Return the arguments of each command by what it is called; the first writes the recording."""
    return {
        "record": ["record", "real-size", "hours.toml", "--out", recording],
        "record --every 10": ["record", "real-size", "hours.toml", "--out", "thin.mcap", "--every", "10"],
        "info": ["info", recording],
        "export recording, CSV": ["export", "recording", recording, "--out", "rows.csv"],
        "export recording, Parquet": ["export", "recording", recording, "--out", "rows.parquet"],
        "replay": ["replay", recording],
        "identify": ["identify", recording, "--out", "found"],
    }


def measured(arguments: Sequence[str], folder: Path, limit: float, interrupt: float | None = None) -> Measured:
    """Run a command in a folder for at most so long, s; with `interrupt`, Ctrl-C comes then, from which time counts."""
    with subprocess.Popen(
        [sys.executable, "-m", "tenodesis.cli", *arguments],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as process:
        begun = time.monotonic()
        sent = False
        while True:
            pid, status, usage = os.wait4(process.pid, os.WNOHANG)
            now = time.monotonic()
            if pid:
                process.returncode = os.waitstatus_to_exitcode(status)
                return Measured(now - begun, usage.ru_maxrss / 1e3, process.returncode)
            if interrupt is not None and not sent and now - begun > interrupt:
                process.send_signal(signal.SIGINT)
                begun, sent = now, True
            elif now - begun > limit:
                process.kill()
            time.sleep(0.02)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[10.0, 59.0], help="durations at 2 kHz")
    parser.add_argument("--only", nargs="+", default=[], help="commands, by their first word")
    parser.add_argument("--limit", type=float, default=900.0, help="longest time of a command, s")
    given = parser.parse_args(arguments)
    print("| command | minutes | s | MB | exit code | s after Ctrl-C, its exit code |\n|---|---|---|---|---|---|")
    for minutes in given.minutes:
        with TemporaryDirectory() as name:
            folder = Path(name)
            count = max(1, round(60 * minutes / _CYCLE))
            (folder / "hours.toml").write_text(_PROTOCOL.format(count=count), "utf-8")
            for about, words in commands("hours.mcap").items():
                if words[0] != "record" and given.only and words[0] not in given.only:
                    continue
                took = measured(words, folder, given.limit)
                stopped = ""
                if took.seconds > 2 * _INTERRUPTED_AFTER:
                    again = ["--overwrite"] if "--out" in words else []
                    target = [
                        word.replace("hours.mcap", "again.mcap") if words[0] == "record" else word for word in words
                    ]
                    ended = measured([*target, *again], folder, given.limit, _INTERRUPTED_AFTER)
                    stopped = f"{ended.seconds:.1f}, {ended.exit_code}"
                cells = (about, f"{minutes:g}", f"{took.seconds:.1f}", f"{took.megabytes:.0f}", took.exit_code, stopped)
                print(f"| {' | '.join(map(str, cells))} |", flush=True)


if __name__ == "__main__":
    main()

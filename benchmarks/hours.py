"""Time and peak memory of every command that writes or reads a long _RECORDING, and how soon Ctrl-C ends it.

Ctrl-C comes amid a command's work, after half of the time that it takes.
"""

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

sys.path.append(str(Path(__file__).parents[1] / "studies"))

import figures

COLUMNS = (
    figures.Heading("time", "time", "s", ".3g"),
    figures.Heading("computed", "of it on a processor", "s", ".3g"),
    figures.Heading("memory", "peak memory", "MB", ".3g"),
    figures.Heading("code", "exit code", "", ".0f"),
    figures.Heading("interrupted", "time after Ctrl-C", "s", ".2g"),
    figures.Heading("interrupted_code", "its exit code", "", ".0f"),
)
_CYCLE = 2.568
"""Duration of a cycle of the protocol on the instrument, s."""
_LEAST = 6.0
"""Time of a command that is interrupted, s."""
_RECORDING, _SCALED = _KEPT = ("hours.mcap", "scaled.mcap")
_PROTOCOL = """name = "hours"
[[phases]]
kind = "cycles"
output_amplitude = "60 deg"
speed = "20 deg/s"
count = {count}
force = "1 N"
"""


class Measured(NamedTuple):
    """How a command ended: time until then and of it on a processor, s, peak memory, MB, and exit code."""

    seconds: float
    computed: float
    megabytes: float
    exit_code: int


def commands() -> dict[str, list[str]]:
    """Return the arguments of each command by what it is called; the first writes the recording."""
    return {
        "record": ["record", "real-size", "hours.toml", "--out", _RECORDING],
        "record, scaled-up": ["record", "scaled-up", "hours.toml", "--out", _SCALED],
        "record --every 10": ["record", "real-size", "hours.toml", "--out", "thin.mcap", "--every", "10"],
        "info": ["info", _RECORDING],
        "map": ["map", _RECORDING, "--plot-out", "map.png"],
        "export recording, CSV": ["export", "recording", _RECORDING, "--out", "rows.csv"],
        "export recording, Parquet": ["export", "recording", _RECORDING, "--out", "rows.parquet"],
        "replay": ["replay", _RECORDING],
        "replay --out": ["replay", _RECORDING, "--out", "again.mcap", "--plot-out", "replay.png"],
        "transfer": ["transfer", "real-size", _SCALED, "--out", "carried.mcap"],
        "identify": ["identify", _RECORDING, "--out", "found"],
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
                computed = usage.ru_utime + usage.ru_stime
                return Measured(now - begun, computed, usage.ru_maxrss / 1e3, process.returncode)
            if interrupt is not None and not sent and now - begun > interrupt:
                process.send_signal(signal.SIGINT)
                begun, sent = now, True
            elif now - begun > limit:
                process.kill()
            time.sleep(0.02)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, nargs="+", default=[10.0, 60.0], help="durations at 2 kHz")
    parser.add_argument("--only", nargs="+", default=[], help="commands, by their first word")
    parser.add_argument("--limit", type=float, default=900.0, help="longest time of a command, s")
    figures.arguments(parser)
    given = parser.parse_args(arguments)
    # a shell lets what it starts in the background ignore Ctrl-C, and commands would inherit that
    signal.signal(signal.SIGINT, signal.default_int_handler)
    rows: dict[str, list[float | None]] = {}
    print(figures.headed(COLUMNS))
    for minutes in given.minutes:
        with TemporaryDirectory() as name:
            folder = Path(name)
            count = max(1, int(60 * minutes / _CYCLE))
            (folder / "hours.toml").write_text(_PROTOCOL.format(count=count), "utf-8")
            for about, words in commands().items():
                if words[0] != "record" and given.only and words[0] not in given.only:
                    continue
                took = measured(words, folder, given.limit)
                stopped: list[float | None] = [None, None]
                if took.seconds > _LEAST:
                    again = ["--overwrite"] if any(word.endswith("out") for word in words) else []
                    target = ["broken.mcap" if words[0] == "record" and word in _KEPT else word for word in words]
                    ended = measured([*target, *again], folder, given.limit, took.seconds / 2)
                    stopped = [ended.seconds, ended.exit_code]
                row = rows[f"{about}, {minutes:g} min"] = [*took, *stopped]
                print(f"{about}, {minutes:g} min: {figures.shown(row)}", flush=True)
                for path in folder.iterdir():
                    if path.is_file() and path.name not in {"hours.toml", *_KEPT}:
                        path.unlink()
    if given.figures is not None:
        command = "python benchmarks/hours.py --figures docs/results.json"
        figures.keep("hours", figures.FigureTable(command, "command, recording", COLUMNS, rows), given.figures)


if __name__ == "__main__":
    main()

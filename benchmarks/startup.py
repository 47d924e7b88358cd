"""CPU time of `tenodesis --help` and `import tenodesis` against that of `python -c pass`, in one run."""

import resource
import subprocess
import sys
from statistics import median

RUNS = 15
LIMIT = 12.0
"""Largest ratio of the help."""


def cpu_seconds(*arguments: str) -> float:
    """Return the CPU time of a Python process, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the ratios: median, and worst over best."""
    cases = {
        "tenodesis --help": ("-m", "tenodesis.cli", "--help"),
        "tenodesis export --help": ("-m", "tenodesis.cli", "export", "--help"),
        "import tenodesis": ("-c", "import tenodesis"),
    }
    times: dict[str, list[float]] = {name: [] for name in ("pass", *cases)}
    for _ in range(RUNS):
        times["pass"].append(cpu_seconds("-c", "pass"))
        for name, arguments in cases.items():
            times[name].append(cpu_seconds(*arguments))
    base = times.pop("pass")
    print(f"python -c pass: {1e3 * median(base):.1f} ms of CPU time, median of {RUNS}")
    for name, found in times.items():
        ratios = [own / median(base) for own in found]
        print(f"{name}: {median(ratios):.1f} times that, worst {max(ratios):.1f}")
    if median(times["tenodesis --help"]) > LIMIT * median(base):
        sys.exit(f"tenodesis --help takes more than {LIMIT:g} times as long as python -c pass")


if __name__ == "__main__":
    main()

"""CPU time of `tenodesis --help`, `check` and `import tenodesis` against that of bare Python and of NumPy, in one run."""

import os
import resource
import subprocess
import sys
import tempfile
from statistics import median

RUNS = 15
LIMITS = {"tenodesis --help": 12.0, "tenodesis check": 24.0}
"""Largest ratios to bare Python."""


def cpu_seconds(environment: dict[str, str], *arguments: str) -> float:
    """Return the CPU time of a Python process, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print the ratios: median, and worst over best."""
    cases = {
        "python -c pass": ("-c", "pass"),
        "import numpy": ("-c", "import numpy"),
        "tenodesis --help": ("-m", "tenodesis.cli", "--help"),
        "tenodesis export --help": ("-m", "tenodesis.cli", "export", "--help"),
        "tenodesis check": ("-m", "tenodesis.cli", "check", "real-size"),
        "import tenodesis": ("-c", "import tenodesis"),
    }
    times: dict[str, list[float]] = {name: [] for name in cases}
    with tempfile.TemporaryDirectory() as compiled:
        # As installed: pip compiles what it installs.
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
        environment["PYTHONPYCACHEPREFIX"] = compiled
        for number in range(RUNS + 1):
            for name, arguments in cases.items():
                own = cpu_seconds(environment, *arguments)
                if number:
                    times[name].append(own)
    base, numpy = median(times.pop("python -c pass")), median(times.pop("import numpy"))
    print(
        f"python -c pass: {1e3 * base:.1f} ms of CPU time, median of {RUNS}; import numpy: {numpy / base:.1f} times it"
    )
    for name, found in times.items():
        ratio, worst = median(found) / base, max(found) / base
        print(f"{name}: {ratio:.1f} times python -c pass, worst {worst:.1f}; {median(found) / numpy:.2f} import numpy")
    for name, limit in LIMITS.items():
        if median(times[name]) > limit * base:
            sys.exit(f"{name} takes more than {limit:g} times as long as python -c pass")


if __name__ == "__main__":
    main()

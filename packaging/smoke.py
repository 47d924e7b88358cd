"""Check that an installed wheel works: an instrument, a recorded run, and its identification, in an empty folder."""

import subprocess
import sys
import tempfile
from pathlib import Path

import tenodesis as tn

PROTOCOLS = Path(tn.__file__).parent / "simulate/shipped"


def main() -> None:
    """Run the commands; one that fails ends the program."""
    with tempfile.TemporaryDirectory() as folder:
        for words in (
            ["check", "real-size"],
            ["record", "scaled-up", PROTOCOLS / "cycles.toml", "--out", "run.mcap"],
            ["identify", "run.mcap", "--fit", "friction", "--out", "identified"],
        ):
            subprocess.run([sys.executable, "-m", "tenodesis.cli", *words], cwd=folder, check=True)
    print(f"tenodesis {tn.__version__} works.")


if __name__ == "__main__":
    main()

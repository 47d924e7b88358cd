"""Runs in each tutorial before its first cell: %%bash prints what a shell prints, and fails where a command fails."""

import os
import subprocess

from IPython.core.magic import register_cell_magic

for _name in ("FORCE_COLOR", "CLICOLOR", "CLICOLOR_FORCE"):
    os.environ.pop(_name, None)
os.environ.update(NO_COLOR="1", TERM="dumb")


@register_cell_magic
def bash(_line: str, cell: str) -> None:
    """Run a cell in bash and print its output in one piece; the first command that fails ends it."""
    done = subprocess.run(
        ["bash", "-e", "-c", cell], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    print(done.stdout.strip("\n"))
    done.check_returncode()

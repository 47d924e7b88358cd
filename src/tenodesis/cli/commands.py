"""The command line; the module of a command is imported when the command runs."""

import sys

from tenodesis.cli.table import ALL, COMMANDS, Group, print_overview
from tenodesis.errors import Error


def main() -> None:
    """Run the command line; an error that a user can correct ends in one sentence and exit code 1."""
    *words, last = sys.argv
    group = ALL if len(words) == 1 else COMMANDS.get(" ".join(words[1:]))
    if last == "--help" and isinstance(group, Group):
        usage = " ".join(["tenodesis", *words[1:], "[OPTIONS] COMMAND [ARGS]..."])
        print_overview(usage, group.help, group.commands.items())
        return
    from tenodesis.cli.app import app  # noqa: PLC0415 - typer takes longer than the overview

    try:
        app(prog_name="tenodesis")
    except Error as problem:
        from rich.console import Console  # noqa: PLC0415

        errors = Console(stderr=True, highlight=False, soft_wrap=True)
        errors.print(f"tenodesis: {problem}", markup=False, style="red")
        sys.exit(1)

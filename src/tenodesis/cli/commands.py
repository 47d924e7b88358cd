"""The command line; the module of a command is imported when the command runs."""

import signal
import sys

from tenodesis.cli import interrupts

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""


def main() -> None:
    """Run the command line; an error that a user can correct ends in one sentence and exit code 1, Ctrl-C in 130."""
    try:
        interrupts.install()
        _run()
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        sys.stderr.write("tenodesis: interrupted before the command began; nothing is written.\n")
        sys.exit(INTERRUPTED)


def _run() -> None:
    # All imports are here, so that Ctrl-C ends them in a sentence as well.
    from tenodesis.cli.table import ALL, COMMANDS, HELP_OPTIONS, VERSION_OPTION, EntryGroup, print_overview  # noqa: PLC0415

    *words, last = sys.argv
    group = ALL if len(words) == 1 else COMMANDS.get(" ".join(words[1:]))
    if last in HELP_OPTIONS and isinstance(group, EntryGroup):
        print_overview(" ".join(["tenodesis", *words[1:], "[OPTIONS] COMMAND [ARGS]..."]), group)
        return
    if sys.argv[1:] == [VERSION_OPTION]:
        from tenodesis.version import __version__  # noqa: PLC0415

        print(f"tenodesis {__version__}")
        return
    import warnings  # noqa: PLC0415

    from tenodesis.cli.app import app  # noqa: PLC0415 - typer takes longer than the overview
    from tenodesis.errors import CommandInterruptedError, Error, FaultWarning  # noqa: PLC0415

    usual = warnings.formatwarning

    def formatted(message: Warning | str, category: type[Warning], filename: str, line: int, text: str | None) -> str:
        if issubclass(category, FaultWarning):
            return f"tenodesis: warning: {message}\n"
        return usual(message, category, filename, line, text)

    warnings.formatwarning = formatted  # type: ignore[assignment]
    try:
        app(prog_name="tenodesis")
    except Error as problem:
        from rich.console import Console  # noqa: PLC0415

        errors = Console(stderr=True, highlight=False, soft_wrap=True)
        errors.print(f"tenodesis: {problem}", markup=False, style="red")
        sys.exit(INTERRUPTED if isinstance(problem, CommandInterruptedError) else 1)
    finally:
        warnings.formatwarning = usual

"""The commands as typer runs them: each is a stub until it is called."""

import inspect
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from tenodesis.cli.table import ALL, HELP_OPTIONS, VERSION_OPTION, Entry, EntryGroup, print_help, print_overview
from tenodesis.errors import CommandError, CommandInterruptedError
from tenodesis.version import __version__

_DEFAULT = "list"


class _Stub(TyperCommand):
    """A command whose module is imported when it is called."""

    def __init__(self, name: str, command: Entry, hidden: bool = False) -> None:
        super().__init__(name, help=command.help, hidden=hidden)
        self._function = command.function

    def make_context(self, info_name: str | None, args: list[str], parent: Any = None, **extra: Any) -> Any:
        """Return the context of the command itself, which replaces this group."""
        return built(info_name or "", load(self._function)).make_context(info_name, args, parent=parent, **extra)


class _Command(TyperCommand):
    """A command whose help fits 80 columns with every name whole."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help: names in one column, kinds of value before what they mean in the other."""
        panels: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for one in self.get_params(ctx):
            written, meaning = one.get_help_record(ctx) or ("", "")
            if one.param_type_name == "argument":
                name, _, kind = written.partition(" ")
            else:
                name = ", ".join([*one.opts, *one.secondary_opts])
                kind = "" if getattr(one, "is_flag", False) else written.split(one.opts[0])[-1].strip()
            # spaces, at which a line may end
            kind = "" if kind in {"<str>", "<path>"} else kind.replace("|", " | ")
            panels["Arguments" if one.param_type_name == "argument" else "Options"].append(
                (name, f"{kind} {meaning}".strip())
            )
        usage = " ".join([ctx.command_path, *self.collect_usage_pieces(ctx)])
        print_help(usage, inspect.cleandoc(self.help or ""), {title: rows for title, rows in panels.items() if rows})


class _Commands(TyperGroup):
    """A group of stubs; its help imports none of them."""

    def __init__(self, *, group: EntryGroup = ALL, **settings: Any) -> None:
        super().__init__(**settings | {"help": group.help, "no_args_is_help": group.default is None})
        self._group = group
        for name, command in group.commands.items():
            if isinstance(command, EntryGroup):
                self.commands[name] = _Commands(name=name, group=command)
            else:
                self.commands[name] = _Stub(name, command)
        if group.default is not None:
            self.commands[_DEFAULT] = _Stub(_DEFAULT, group.default, hidden=True)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Name the default command where none is."""
        return super().parse_args(ctx, args or ([_DEFAULT] if self._group.default is not None else []))

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print the help from the table of commands."""
        usage = " ".join([ctx.command_path, *self.collect_usage_pieces(ctx)])
        print_overview(usage, self._group)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is called; a word for what other commands do is answered with these."""
        if args[0] == "plot" and self._group is ALL:
            raise CommandError(
                "plot is no command; tenodesis replay FILE --plot-out FIGURE.png draws a recording, with --instrument "
                "beside what another instrument makes of it; bench and identify write figures, and tn.plot in Python "
                "draws the signals of any run.",
                key="COMMAND",
                value="plot",
            )
        return super().resolve_command(ctx, args)

    def make_context(self, *arguments: Any, **extra: Any) -> Any:
        """Return the context; Ctrl-C, which typer would end without a word, ends in a sentence."""
        try:
            return super().make_context(*arguments, **extra)
        except KeyboardInterrupt:
            raise _interrupted() from None

    def invoke(self, ctx: Any) -> Any:
        """Run the command; Ctrl-C as in :meth:`make_context`."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise _interrupted() from None


def _interrupted() -> CommandInterruptedError:
    outputs = sys.modules.get("tenodesis.cli.outputs")
    written = [] if outputs is None else outputs.WRITTEN
    done = f"written: {', '.join(map(str, written))}" if written else "nothing is written"
    return CommandInterruptedError(f"interrupted; {done}.")


def load(function: str) -> Callable[..., None]:
    """Return the function of a command, from MODULE.FUNCTION within this package."""
    module, _, name = function.partition(".")
    found: Callable[..., None] = getattr(import_module(f"tenodesis.cli.{module}"), name)
    return found


def built(name: str, function: Callable[..., None]) -> Any:
    """Return a function as a command."""
    alone = typer.Typer(add_completion=False)
    alone.command(name, cls=_Command)(function)
    return typer.main.get_command(alone)


def _print_version(value: bool) -> None:
    if value:
        typer.echo(f"tenodesis {__version__}")
        raise typer.Exit


app = typer.Typer(
    cls=_Commands, pretty_exceptions_enable=False, context_settings={"help_option_names": list(HELP_OPTIONS)}
)


@app.callback()
def _root(
    version: Annotated[bool, typer.Option(VERSION_OPTION, callback=_print_version, is_eager=True)] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q")] = False,
) -> None:
    """Set what holds for every command."""
    from tenodesis.cli.common import Settings  # noqa: PLC0415 - the overview does without

    Settings.quiet = quiet

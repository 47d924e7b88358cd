"""The reference of the commands, from the commands themselves."""

from collections.abc import Iterator, Mapping

import typer
from typer.cli import get_docs_for_click

from tenodesis.cli.app import built, load
from tenodesis.cli.table import COMMANDS, Entry, EntryGroup


def text() -> str:
    """Return the help of every command as Markdown."""
    return "\n".join(_texts("tenodesis", COMMANDS))


def _texts(prefix: str, commands: Mapping[str, Entry | EntryGroup]) -> Iterator[str]:
    for name, command in commands.items():
        words = f"{prefix} {name}"
        if isinstance(command, EntryGroup):
            if command.default is not None:
                yield _text(words, command.default)
            yield from _texts(words, command.commands)
        else:
            yield _text(words, command)


def _text(words: str, command: Entry) -> str:
    """Return the help of a command as Markdown, a level below the page's title."""
    built_command = built(words, load(command.function))
    text = get_docs_for_click(obj=built_command, ctx=typer.Context(built_command), name=words)
    return text.replace("\n#", "\n##").replace("# ", "## ", 1) if text.startswith("# ") else text

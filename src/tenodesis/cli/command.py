"""What every command has: quiet, JSON, permission to replace what exists, and errors that end in a sentence."""

import inspect
import json
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

import typer

from tenodesis.cli.common import Settings
from tenodesis.cli.outputs import Outputs
from tenodesis.errors import CommandError, Error
from tenodesis.json_values import json_values

Quiet: TypeAlias = Annotated[bool, typer.Option("--quiet", "-q", help="Print results, warnings and errors only.")]
_Overwrite: TypeAlias = Annotated[bool, typer.Option("--overwrite", help="Replace files that exist.")]


class Answer(NamedTuple):
    """What a command says."""

    content: Callable[[], Any]
    """Returns it for JSON."""
    show: Callable[[], None]
    """Prints it for people."""
    exit_code: int = 0
    """1 where something must be corrected, though there is an answer."""


def command(*reads: str, json: str = "") -> Callable[[Callable[..., Answer | None]], Callable[..., None]]:
    """Give a function the options that commands share, and return it as a command.

    A function that takes ``outputs`` has ``--overwrite``.

    Parameters
    ----------
    reads
        Parameters that name what is read, which is never written over.
    json
        Help of ``--json``, of a function that returns an answer.
    """

    def decorate(function: Callable[..., Answer | None]) -> Callable[..., None]:
        own = inspect.signature(function)
        public = own.replace(parameters=[one for name, one in own.parameters.items() if name != "outputs"])
        writes = public != own
        shared = {
            **({"json": Annotated[bool, typer.Option("--json", help=json)]} if json else {}),
            **({"overwrite": _Overwrite} if writes else {}),
            "quiet": Quiet,
        }

        @wraps(function)
        def run(
            *arguments: Any, quiet: bool = False, overwrite: bool = False, json: bool = False, **options: Any
        ) -> None:
            Settings.quiet = Settings.quiet or quiet or json
            given = public.bind_partial(*arguments, **options).arguments
            if writes:
                given["outputs"] = Outputs(_paths(given.get(name) for name in reads), overwrite)
            try:
                answer = function(**given)
            except Error:
                raise
            except ValueError as problem:
                raise CommandError(str(problem)) from problem
            if answer is not None and json:
                _print_json(answer.content())
            elif answer is not None:
                answer.show()
            if answer is not None and answer.exit_code:
                raise typer.Exit(answer.exit_code)

        added = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
            for name, kind in shared.items()
        ]
        run.__signature__ = public.replace(parameters=[*public.parameters.values(), *added])  # type: ignore[attr-defined]
        run.__annotations__ = {**function.__annotations__, **shared}
        return run

    return decorate


def _print_json(content: Any) -> None:
    typer.echo(json.dumps(json_values(content), indent=1, ensure_ascii=False))


def _paths(given: Any) -> list[Path | str]:
    """Return paths and names, of which parameters may have several or none."""
    found: list[Path | str] = []
    for one in given:
        found += one if isinstance(one, list) else [] if one is None else [one]
    return found

"""The command that shows a live instrument to Foxglove, and to whatever speaks its WebSocket protocol."""

import tempfile
import threading
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from tenodesis.errors import LiveError

console = Console()

_PLACES = (Path("/dev/shm"), Path(tempfile.gettempdir()))
"""Where folders of runtimes are."""


def register(app: typer.Typer) -> None:
    """Add the command to an app."""
    app.command()(foxglove)


def foxglove(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER", help="Folder of the runtime. Default: that of the one that runs.", show_default=False
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; by default none but this computer can connect.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0 takes any that is free.")] = 8765,
    rate: Annotated[float, typer.Option(help="Messages per second and topic, Hz.")] = 100.0,
    all_rows: Annotated[bool, typer.Option("--all", help="Send every row instead.")] = False,
) -> None:
    """Show a live instrument to Foxglove: the recordings' topics over a WebSocket, to watch and nothing else."""
    from tenodesis.live import foxglove as live  # noqa: PLC0415 - the command line is to start quickly
    from tenodesis.live.ending import on_signal  # noqa: PLC0415
    from tenodesis.live.record import Reader  # noqa: PLC0415

    folder = _running() if folder is None else folder
    stop = threading.Event()
    with on_signal(stop.set):
        with live.Server(Reader(folder), host, port, rate=None if all_rows else rate, folder=folder) as server:
            shared = live.warning(host)
            if shared is not None:
                console.print(f"warning: {shared}", markup=False, highlight=False, soft_wrap=True, style="yellow")
            _say(f"Foxglove: ws://{_in_url(host)}:{server.port} (Ctrl-C ends it).")
            live.serve(server, stop)
        if not stop.is_set():
            _say("The runtime has ended.")
        if server.lost:
            _say(f"{server.lost} rows were not sent, for this was too slow.")


def _running() -> Path:
    """Return the folder of the runtime that runs, where there is but one."""
    from tenodesis.live import folder as folders  # noqa: PLC0415
    from tenodesis.live.record import Reader  # noqa: PLC0415

    found = []
    for place in _PLACES:
        for ring in place.glob(f"tenodesis-*/*/{folders.RING}"):
            try:
                if Reader(ring.parent).alive:
                    found.append(ring.parent)
            except LiveError:
                continue
    if not found:
        raise LiveError("no live instrument runs here; start one with `tenodesis console`, or give its FOLDER.")
    if found[1:]:
        raise LiveError(f"several live instruments run: {', '.join(map(str, sorted(found)))}; give one as FOLDER.")
    return found[0]


def _in_url(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _say(sentence: str) -> None:
    console.print(sentence, markup=False, highlight=False, soft_wrap=True)

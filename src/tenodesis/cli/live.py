"""The commands about a live instrument: the page in the browser, and Foxglove."""

import tempfile
import threading
from pathlib import Path
from typing import Annotated

import typer

from tenodesis import instrument
from tenodesis.cli.common import InstrumentFile, console, say, warn
from tenodesis.control.controller import ActuationName, LawName
from tenodesis.errors import CommandError, LiveError
from tenodesis.live import folder as folders
from tenodesis.live import foxglove as live_foxglove
from tenodesis.live.host import Host
from tenodesis.live.loop import Choices, DeviceName
from tenodesis.live.shutdown import on_signal
from tenodesis.live.ticks import Reader

_PLACES = (Path("/dev/shm"), Path(tempfile.gettempdir()))
"""Where folders of runtimes are."""


def live_console(  # noqa: PLR0917
    instrument_file: InstrumentFile = "scaled-up",
    device: Annotated[DeviceName, typer.Option(help="Device to control.")] = "twin",
    address: Annotated[
        str | None, typer.Option(help="Of a serial device: /dev/ttyACM0, or socket://127.0.0.1:5555.")
    ] = None,
    law: Annotated[LawName, typer.Option(help="Compensation law.")] = "robust",
    actuation: Annotated[ActuationName, typer.Option(help="Motors that act.")] = "differential",
    host: Annotated[
        str, typer.Option(help="Address to listen on; other than on this computer's own, browsers need the token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; the next free port if it is taken.")] = 8080,
    token: Annotated[
        str | None, typer.Option(help="Token for browsers on other computers; by default a random token.")
    ] = None,
    recordings: Annotated[Path, typer.Option(help="Folder of recordings.")] = Path("recordings"),
    seed: Annotated[int, typer.Option(help="Seed of the twin's sensor noise.", min=0)] = 0,
    foxglove: Annotated[
        int | None,
        typer.Option(help="Also serve Foxglove on this port; 0: any free port.", show_default=False),
    ] = None,
) -> None:
    """Open the live instrument in the browser: move its handle, push on its tip, switch the compensation on and off."""
    from tenodesis.console import serve  # noqa: PLC0415 - foxglove does without the page

    if not 0 < port < 65536:
        raise CommandError(key="--port", value=port, allowed="between 1 and 65535")
    instrument.load(instrument_file)
    ending = threading.Event()
    choices = Choices(device=device, address=address, law=law, actuation=actuation, seed=seed)
    with on_signal(ending.set):
        with console.status("Starting the runtime"):
            live = Host(instrument_file, choices, recordings)
        try:
            page = serve(live.connect, host, port, token, recordings=recordings)
            try:
                say(f"Console: {page.url}   (Ctrl-C ends it)")
                say(f"Runtime: process {live.pid}, folder {live.folder}; recordings go to {recordings.absolute()}.")
                if page.token is not None:
                    say(f"Browsers need the token {page.token}")
                if foxglove is not None:
                    with live_foxglove.Server(Reader(live.folder), "127.0.0.1", foxglove, folder=live.folder) as server:
                        say(f"Foxglove: ws://127.0.0.1:{server.port}")
                        live_foxglove.serve(server, ending)
                ending.wait()
            finally:
                page.close()
        finally:
            live.close()


def foxglove(
    folder: Annotated[
        Path | None,
        typer.Argument(
            metavar="FOLDER", help="Folder of the runtime. Default: that of the only runtime.", show_default=False
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen on; by default only this computer can connect.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0: any free port.")] = 8765,
    rate: Annotated[float, typer.Option(help="Messages per second and topic, Hz.")] = 100.0,
    all_rows: Annotated[bool, typer.Option("--all", help="Send every row instead.")] = False,
) -> None:
    """Show a live instrument to Foxglove: the recordings' topics over a WebSocket, read-only."""
    folder = _running() if folder is None else folder
    stop = threading.Event()
    with on_signal(stop.set):
        reader = Reader(folder)
        with live_foxglove.Server(reader, host, port, rate=None if all_rows else rate, folder=folder) as server:
            shared = live_foxglove.warning(host)
            if shared is not None:
                warn(shared)
            say(f"Foxglove: ws://{f'[{host}]' if ':' in host else host}:{server.port} (Ctrl-C ends it).")
            live_foxglove.serve(server, stop)
        if not stop.is_set():
            say("The runtime has ended.")
        if server.lost:
            say(f"{server.lost} rows were not sent, for this was too slow.")


def _running() -> Path:
    """Return the folder of the only runtime that runs."""
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

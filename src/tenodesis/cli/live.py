"""The commands about a live instrument: the page in the browser, and Foxglove."""

import os
import threading
import webbrowser
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from tenodesis.cli.command import command
from tenodesis.cli.common import InstrumentFile, SerialAddress, console, load_instrument, say, warn
from tenodesis.control.controller import ActuationName, LawName
from tenodesis.errors import CommandError, LiveError
from tenodesis.live import folder as folders
from tenodesis.live import foxglove as live_foxglove
from tenodesis.live.host import Host
from tenodesis.live.joined import running
from tenodesis.live.loop import Choices, DeviceName
from tenodesis.live.shutdown import on_signal
from tenodesis.live.ticks import Reader

ListenOn: TypeAlias = Annotated[
    str, typer.Option(help="Address to listen on; by default only this computer can connect.")
]
_DESKTOPS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Variables of the environment, one of which is set where a browser has a screen."""


@command()
def live_console(  # noqa: PLR0917
    instrument_file: InstrumentFile = "scaled-up",
    device: Annotated[DeviceName, typer.Option(help="Device to control.")] = "twin",
    address: SerialAddress = None,
    law: Annotated[
        LawName, typer.Option(help="Compensation law; of all joints, or off, where none has tendons of its own.")
    ] = "robust",
    actuation: Annotated[ActuationName, typer.Option(help="Motors that act.")] = "differential",
    host: ListenOn = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; the next free port if it is taken.")] = 8080,
    token: Annotated[
        str | None,
        typer.Option(
            help="Token that browsers need; by default a random one. Every account can see the arguments of programs.",
            envvar="TENODESIS_TOKEN",
        ),
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser of this desktop.")] = True,
    recordings: Annotated[Path, typer.Option(help="Folder of recordings.")] = Path("recordings"),
    instruments: Annotated[
        list[Path] | None,
        typer.Option(help="Folder of instrument files that the page may run; repeatable.", show_default="the current"),
    ] = None,
    solids: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Draw the parts of this file, the assembly.glb of tenodesis cad, instead of plain solids.",
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the twin's sensor noise.", min=0)] = 0,
    foxglove: Annotated[int | None, typer.Option(help="Also serve Foxglove on this port; 0: any free port.")] = None,
) -> None:
    """Open the live instrument in the browser: move its handle, push on its tip, switch the compensation on and off."""
    from tenodesis.console import link_page, load_parts, serve  # noqa: PLC0415 - foxglove does without the page

    if not 0 < port < 65536:
        raise CommandError(key="--port", value=port, allowed="between 1 and 65535")
    inst = load_instrument(instrument_file)
    parts = None if solids is None else load_parts(solids)
    if parts is not None and (other := parts.differs(inst)):
        raise CommandError(f"--solids {solids} are not those of {instrument_file}: {other}.", key="--solids")
    ending = threading.Event()
    choices = Choices(device=device, address=address, law=law, actuation=actuation, seed=seed)
    with on_signal(ending.set):
        with console.status("Starting the runtime"):
            live = Host(instrument_file, choices, recordings)
        try:
            page = serve(
                live.connect, host, port, token,
                recordings=recordings, instruments=instruments or [Path.cwd()], parts=parts,
            )  # fmt: skip
            try:
                opener = folders.write_link(live.home, page.url, link_page(page.url))
                _open(page.url, opener, browser=browser)
                say(f"Runtime: process {live.pid}, folder {live.folder}; recordings go to {recordings.absolute()}.")
                if foxglove is not None:
                    with live_foxglove.FoxgloveServer(
                        Reader(live.folder), "127.0.0.1", foxglove, folder=live.folder
                    ) as server:
                        say(f"Foxglove: ws://127.0.0.1:{server.port}")
                        live_foxglove.serve(server, ending)
                ending.wait()
            finally:
                page.close()
        finally:
            live.close()


def _open(url: str, opener: Path, *, browser: bool) -> None:
    """Print the link to the page and, on a desktop, open it by a file, for arguments are seen by every account."""
    say(f"Console: {url}   (Ctrl-C ends it)")
    if browser and any(os.environ.get(name) for name in _DESKTOPS):
        webbrowser.open(opener.as_uri())


@command()
def foxglove(
    folder: Annotated[
        Path | None, typer.Argument(metavar="FOLDER", help="Folder of the runtime. Default: that of the only runtime.")
    ] = None,
    host: ListenOn = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port to listen on; 0: any free port.")] = 8765,
    rate: Annotated[float, typer.Option(help="Messages per second and topic, Hz.")] = 100.0,
    all_rows: Annotated[bool, typer.Option("--all", help="Send every row instead.")] = False,
) -> None:
    """Show a live instrument to Foxglove: the recordings' topics over a WebSocket, read-only."""
    folder = running() if folder is None else folder
    stop = threading.Event()
    with on_signal(stop.set):
        reader = Reader(folder)
        with live_foxglove.FoxgloveServer(reader, host, port, rate=None if all_rows else rate, folder=folder) as server:
            shared = live_foxglove.warning(host)
            if shared is not None:
                warn(shared)
            say(f"Foxglove: ws://{f'[{host}]' if ':' in host else host}:{server.port} (Ctrl-C ends it).")
            live_foxglove.serve(server, stop)
        if not stop.is_set():
            say("The runtime has ended.")
        if server.lost:
            say(f"{server.lost} rows were not sent, for this was too slow.")


@command()
def link() -> None:
    """Print the link that opens the page of the console that runs here, its token included."""
    url = folders.read_link(running().parent)
    if url is None:
        raise LiveError(
            "the live instrument that runs here has no page; start one with `tenodesis console`.",
            key="FOLDER",
            allowed="of a live instrument with a page",
        )
    say(url)

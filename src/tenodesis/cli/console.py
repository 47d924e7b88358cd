"""The command that opens the live instrument in the browser."""

import threading
from pathlib import Path
from typing import Annotated, get_args

import typer
from rich.console import Console

from tenodesis import instrument
from tenodesis.control.controller import ActuationName, LawName
from tenodesis.errors import CommandError

console = Console()


def register(app: typer.Typer) -> None:
    """Add the command to an app."""
    app.command(name="console")(live_console)


def live_console(  # noqa: PLR0917
    instrument_file: Annotated[
        str, typer.Argument(metavar="INSTRUMENT", help="Instrument file, or the name of one that is shipped.")
    ] = "scaled-up",
    device: Annotated[str, typer.Option(help="twin, nidaq, canopen or serial.")] = "twin",
    address: Annotated[
        str | None, typer.Option(help="Of a serial device: /dev/ttyACM0, or socket://127.0.0.1:5555.")
    ] = None,
    law: Annotated[str, typer.Option(help=f"Compensation law: {', '.join(get_args(LawName))}.")] = "robust",
    actuation: Annotated[str, typer.Option(help=f"{', '.join(get_args(ActuationName))}.")] = "differential",
    host: Annotated[
        str, typer.Option(help="Address to listen on; on any but this computer's own, browsers need the token.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="Port; the next free one if it is taken.")] = 8080,
    token: Annotated[str | None, typer.Option(help="Token for browsers elsewhere; by default one is made up.")] = None,
    recordings: Annotated[Path, typer.Option(help="Folder of recordings.")] = Path("recordings"),
    seed: Annotated[int, typer.Option(help="Seed of the twin's sensor noise.", min=0)] = 0,
    foxglove: Annotated[
        int | None, typer.Option(help="Serve Foxglove on this port too, to watch; 0 takes any.", show_default=False)
    ] = None,
) -> None:
    """Open the live instrument in the browser: move its handle, push on its tip, switch the compensation on and off."""
    # The page and its server are large; no other command waits for them.
    from tenodesis.console.page import serve  # noqa: PLC0415
    from tenodesis.live.ending import on_signal  # noqa: PLC0415
    from tenodesis.live.foxglove import Server as Foxglove  # noqa: PLC0415
    from tenodesis.live.host import Host  # noqa: PLC0415
    from tenodesis.live.loop import Choices, DeviceName  # noqa: PLC0415
    from tenodesis.live.record import Reader  # noqa: PLC0415

    for option, value, allowed in (
        ("--device", device, get_args(DeviceName)),
        ("--law", law, get_args(LawName)),
        ("--actuation", actuation, get_args(ActuationName)),
    ):
        if value not in allowed:
            raise CommandError(f"{option} is {value}; allowed are {', '.join(allowed)}.")
    if not 0 < port < 65536:
        raise CommandError(f"--port is {port}; allowed are 1 to 65535.")
    instrument.load(instrument_file)
    ending = threading.Event()
    choices = Choices(device=device, address=address, law=law, actuation=actuation, seed=seed)  # type: ignore[arg-type]
    with on_signal(ending.set):
        with console.status("Starting the runtime"):
            live = Host(instrument_file, choices, recordings)
        try:
            page = serve(live.connect, host, port, token, recordings=recordings)
            try:
                _say(f"Console: {page.url}   (Ctrl-C ends it)")
                _say(f"Runtime: process {live.pid}, folder {live.folder}; recordings go to {recordings.absolute()}.")
                if page.token is not None:
                    _say(f"Browsers need the token {page.token}")
                if foxglove is None:
                    ending.wait()
                else:
                    with Foxglove(Reader(live.folder), "127.0.0.1", foxglove, folder=live.folder) as server:
                        _say(f"Foxglove: ws://127.0.0.1:{server.port}")
                        _relay(server, ending)
            finally:
                page.close()
        finally:
            live.close()


def _relay(server: object, ending: threading.Event) -> None:
    from tenodesis.live import foxglove as live  # noqa: PLC0415

    live.serve(server, ending)  # type: ignore[arg-type]
    ending.wait()


def _say(sentence: str) -> None:
    console.print(sentence, markup=False, highlight=False, soft_wrap=True)

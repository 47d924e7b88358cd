"""The commands about devices: what there is, and whether one keeps time."""

from typing import Annotated

import numpy as np
import typer
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from tenodesis import instrument
from tenodesis.devices import registry
from tenodesis.devices.communication_test import Findings, measure

_STEP = 0.1  # s, between two strokes of the progress bar


def register(app: typer.Typer) -> None:
    """Add the commands about devices."""
    devices = typer.Typer(invoke_without_command=True, help="List devices, or test one.")
    devices.callback()(list_devices)
    devices.command("test")(test_device)
    app.add_typer(devices, name="devices")


def list_devices(context: typer.Context) -> None:
    """List the devices and what each needs."""
    if context.invoked_subcommand is not None:
        return
    table = Table(box=box.SIMPLE_HEAD)
    for heading in ("device", "what it is", "what it needs"):
        table.add_column(heading, overflow="fold")
    for name, kind in registry.KINDS.items():
        table.add_row(name, kind.description, kind.needs)
    Console().print(table)


def test_device(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The device: canopen, nidaq or serial.")],
    instrument_file: Annotated[
        str, typer.Option("--instrument", help="Instrument file with its table devices, or the name of a shipped one.")
    ] = "real-size",
    seconds: Annotated[float, typer.Option(help="How long to measure, s.")] = 10.0,
    address: Annotated[
        str | None, typer.Option(help="Of a serial device: /dev/ttyACM0, or socket://127.0.0.1:5555.")
    ] = None,
) -> None:
    """Measure a device's rate, jitter and losses, with the motors at rest; exit code 1 if the controller needs more."""
    console = Console()
    inst = instrument.load(instrument_file)
    device = registry.make(name, inst, address)
    bar = Progress(
        TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn(), console=console, transient=True
    )
    with bar:
        task = bar.add_task(escape(f"{name}: motors at rest"), total=seconds)
        shown = 0.0

        def progress(done: float) -> None:
            nonlocal shown
            # Drawing takes time that the device should have.
            if done - shown >= _STEP:
                shown = done
                bar.update(task, completed=done)

        findings = measure(device, inst, seconds, progress)
    console.print(_table(findings))
    console.print(findings.verdict, style="green" if findings.good else "red", markup=False, soft_wrap=True)
    if not findings.good:
        raise typer.Exit(1)


def _table(findings: Findings) -> Table:
    title = f"{findings.name}: {findings.measurements} measurements, controller at {1 / findings.period:.4g} Hz"
    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD)
    for heading in ("", "measured", "allowed"):
        table.add_column(heading, justify="left" if not heading else "right", overflow="fold")
    for share, label in ((0.5, "interval, p50"), (0.99, "interval, p99"), (1.0, "interval, worst")):
        table.add_row(label, f"{findings.quantile(share) * 1e3:.4g} ms", "")
    if findings.round_trips.size:
        table.add_row("round trip, p50", f"{np.quantile(findings.round_trips, 0.5) * 1e3:.4g} ms", "")
    table.add_row("reads without a measurement", str(findings.missed), "")
    table.add_row("measured twice", str(findings.twice), "")
    for kind, count in sorted(findings.counted.items()):
        table.add_row(escape(f"{kind}, by the device"), str(count), "")
    for sensor, count in findings.blind.items():
        if count:
            table.add_row(f"{sensor.replace('_', ' ')} without a value", str(count), "")
    table.add_section()
    for bound in findings.bounds:
        sign = "≥" if bound.at_least else "≤"
        table.add_row(
            bound.name,
            f"{bound.value:.4g} {bound.unit}".rstrip(),
            f"{sign} {bound.limit:.4g} {bound.unit}".rstrip(),
            style=None if bound.kept else "red",
        )
    return table

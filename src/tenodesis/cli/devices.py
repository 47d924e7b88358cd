"""The commands about devices: list them, and measure whether a device keeps time."""

from typing import Annotated

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from tenodesis.cli.command import command
from tenodesis.cli.common import InstrumentFile, ProgressBar, SerialAddress, console, load_instrument, say, table
from tenodesis.devices import registry
from tenodesis.devices.communication_test import Findings, measure

_STEP = 0.1  # s, between two updates of the progress bar


@command()
def list_devices() -> None:
    """List the devices and what each needs."""
    rows = ((name, kind.description, kind.needs) for name, kind in registry.KINDS.items())
    console.print(table(None, "device", "what it is", "what it needs", rows=rows))


@command()
def test_device(
    instrument_file: InstrumentFile,
    name: Annotated[str, typer.Argument(metavar="DEVICE", help="The device: canopen, nidaq or serial.")],
    seconds: Annotated[float, typer.Option(help="How long to measure, s.")] = 10.0,
    address: SerialAddress = None,
) -> None:
    """Measure a device's rate, jitter and losses, with the motors at rest; exit code 1 if the controller needs more."""
    inst = load_instrument(instrument_file)
    device = registry.make(name, inst, address)
    shown = 0.0
    with ProgressBar(escape(f"{name}: motors at rest"), " s") as bar:

        def progress(done: float) -> None:
            nonlocal shown
            # Drawing takes time that the device should have.
            if done - shown >= _STEP:
                shown = done
                bar(done, seconds)

        findings = measure(device, inst, seconds, progress)
    console.print(_results(findings))
    say(findings.verdict, style="green" if findings.good else "red")
    if not findings.good:
        raise typer.Exit(1)


def _results(findings: Findings) -> Table:
    results = table(
        f"{findings.name}: {findings.measurements} measurements, controller at {1 / findings.period:.4g} Hz",
        "",
        ">measured",
        ">limit",
    )
    for share, described in ((0.5, "interval, p50"), (0.99, "interval, p99"), (1.0, "interval, worst")):
        results.add_row(described, f"{findings.quantile(share) * 1e3:.4g} ms", "")
    if findings.round_trips.size:
        results.add_row("round trip, p50", f"{np.quantile(findings.round_trips, 0.5) * 1e3:.4g} ms", "")
    results.add_row("reads without a measurement", str(findings.missed), "")
    results.add_row("measured twice", str(findings.twice), "")
    for kind, count in sorted(findings.counted.items()):
        results.add_row(escape(f"{kind}, by the device"), str(count), "")
    for sensor, count in findings.blind.items():
        if count:
            results.add_row(f"{sensor.replace('_', ' ')} without a value", str(count), "")
    results.add_section()
    for bound in findings.bounds:
        sign = "≥" if bound.at_least else "≤"
        results.add_row(
            bound.name,
            f"{bound.value:.4g} {bound.unit}".rstrip(),
            f"{sign} {bound.limit:.4g} {bound.unit}".rstrip(),
            style=None if bound.kept else "red",
        )
    return results

"""The command that estimates a tool's far end, its torque and angle, from its near end."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from tenodesis.cli.command import command
from tenodesis.cli.common import check_choice, console, load_instrument, refuse_choices, say, table, warn
from tenodesis.cli.identify import check_files, recordings_of
from tenodesis.cli.outputs import Outputs
from tenodesis.errors import CommandError
from tenodesis.files import read_regular
from tenodesis.identification.force import observed, report
from tenodesis.identification.force.fitting import fit_force
from tenodesis.identification.force.model import RECALIBRATED, SIGNALS, WIDTH, ForceModel, from_json
from tenodesis.identification.force.report import RunResult, Traces, assess, bounds_of, pooled, traces
from tenodesis.identification.formats import load_all
from tenodesis.identification.registry import FORMATS
from tenodesis.identification.report import grouped
from tenodesis.instrument import expanded
from tenodesis.magnitude import rms, rms_of_finite
from tenodesis.recording.lab_tables import has_headings
from tenodesis.units import in_unit

OF_TENDONS = "tendons"
FORMATS_OF_FORCE = ("davinci-tool", "davinci-posture", OF_TENDONS)
_LARGEST = 10_000_000


@command("logs", "test", "prior", "instrument_file")
def force(  # noqa: PLR0917
    outputs: Outputs,
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG…", help="Recordings of both ends, or folders of text files.")
    ],
    signal: Annotated[str, typer.Option("--from", help="torque or current, measured at the near end.")] = "torque",
    format_name: Annotated[
        str | None,
        typer.Option(
            "--format",
            help=f"{', '.join(FORMATS_OF_FORCE)}. Default: {FORMATS_OF_FORCE[0]} of text without headings, else "
            f"{OF_TENDONS}.",
        ),
    ] = None,
    instrument_file: Annotated[
        str | None,
        typer.Option(
            "--instrument", metavar="INSTRUMENT", help=f"Of {OF_TENDONS}: file or shipped name. Default: recorded."
        ),
    ] = None,
    test: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Recording held out; repeatable.")] = None,
    prior: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL",
            help="Model of another tool: LOG recalibrates offsets, friction and pretension; the rest is carried over.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for model.json or force.csv, and force.svg.")] = Path("out/force"),
) -> None:
    """Estimate torque and angle of a tool's jaw from its spindle's angle and torque, or motor current.

    Of a LOG of all tendons' tensions and spools: angles of all joints, load at the tip and grip, without a fit.
    """
    tests = test or []
    check_files(logs, tests)
    check_choice("--from", signal, SIGNALS)
    of_tendons = instrument_file is not None or any(has_headings(one) for one in logs)
    format_name = format_name or (OF_TENDONS if of_tendons else FORMATS_OF_FORCE[0])
    check_choice("--format", format_name, FORMATS_OF_FORCE)
    if format_name == OF_TENDONS:
        own = {"--test": str(tests[0]) if tests else None, "--prior": None if prior is None else str(prior)}
        refuse_choices("tensions of all tendons need no fit", own)
        if logs[1:]:
            raise CommandError(key="LOG", value=str(logs[1]), allowed="one recording at a time of all tendons")
        inst = None if instrument_file is None else expanded(load_instrument(instrument_file))
        with outputs.folder(out, (observed.TABLE, observed.FIGURE)):
            all_joints = observed.observed(logs[0], inst)
            observed.write(all_joints, out)
        for note in all_joints.notes:
            say(f"{all_joints.name}: {note}.")
        _print_observed(all_joints)
        say(f"Written: {out / observed.TABLE}, {out / observed.FIGURE}")
        return
    refuse_choices(f"{format_name} has a model of its own", {"--instrument": instrument_file})
    with outputs.folder(out, (report.MODEL, report.FIGURE)):
        before = None if prior is None else _read(prior)
        files = recordings_of(logs, tests, format_name)
        measured = load_all(FORMATS[format_name].load, [*files, *tests])
        chosen = next(one for one in SIGNALS if one == signal)
        model = fit_force(measured[: len(files)], chosen, prior=before)
        found = [traces(model, one) for one in measured]
        results = [assess(one) for one in found]
        by_use = {"fitted": results[: len(files)], "held out": results[len(files) :]}
        report.write(model, by_use, found[len(files) :] or found, out)
    for names, sentence in grouped({one.name: one.notes for one in measured}):
        say(f"{names}: {sentence}.")
    _print_parameters(model)
    _print_errors(by_use)
    _print_bounds(found)
    _print_undetermined(model, carried=prior is not None)
    say(f"Written: {out / report.MODEL}, {out / report.FIGURE}")


def _print_observed(found: observed.Observed) -> None:
    title = f"{found.name}: estimated from the drive end, and recorded minus that"
    shown = table(title, "", ">least", ">most", ">± 95 %", "unit", ">rmse", ">covered")
    for one in found.channels:
        scale = in_unit(observed.SHOWN[one.unit], one.unit)
        spread = WIDTH * rms(one.std)
        numbers = [f"{scale * number:.3g}" for number in (one.value.min(), one.value.max(), spread, one.rmse)]
        compared = ["", ""] if math.isnan(one.rmse) else [numbers[3], f"{100 * one.covered:.0f} %"]
        shown.add_row(escape(one.name), *numbers[:3], observed.SHOWN[one.unit], *compared)
    console.print(shown)


def _read(path: Path) -> ForceModel:
    try:
        numbers = json.loads(read_regular(path, _LARGEST))
    except OSError as problem:
        raise CommandError(f"--prior is {path}, which cannot be read: {problem.strerror}.", key="--prior") from None
    except ValueError:
        numbers = {}
    return from_json(numbers if isinstance(numbers, dict) else {}, str(path))


def _print_parameters(model: ForceModel) -> None:
    shown = table("parameters", "parameter", ">value", ">±", "unit", "")
    weak = model.undetermined()
    for one in model.unknowns:
        use = "carried over" if one.name not in model.free else "not determined" if one.name in weak else ""
        shown.add_row(one.name, f"{model.values[one.name]:.4g}", f"{model.std(one.name):.2g}", one.unit, use)
    console.print(shown)


def _print_errors(by_use: dict[str, list[RunResult]]) -> None:
    title = "rmse, measured minus estimated, and share of samples within the 95 % interval"
    shown = table(title, "run", "use", ">torque\n[mN·m]", ">covered", ">angle\n[deg]", ">covered")
    for use, rows in by_use.items():
        for one in [*rows, *([pooled(rows)] if len(rows) > 1 else [])]:
            shown.add_row(
                escape(one.name),
                use,
                f"{1e3 * one.torque_rmse:.2f}",
                f"{100 * one.torque_covered:.0f} %",
                f"{math.degrees(one.angle_rmse):.2f}",
                f"{100 * one.angle_covered:.0f} %",
            )
    console.print(shown)
    for one in (one for rows in by_use.values() for one in rows if one.runaway):
        warn(
            f"{one.name}: its drive runs away; without {one.runaway:.2g} s around that, the errors are "
            f"{1e3 * one.torque_rmse_steady:.2f} mN·m and {math.degrees(one.angle_rmse_steady):.2f} deg."
        )


def _print_bounds(found: Sequence[Traces]) -> None:
    bounds = [bounds_of(one.series) for one in found]

    def mean(name: str, scale: float) -> str:
        found = rms_of_finite([getattr(one, name) for one in bounds])
        return "unknown" if math.isnan(found) else f"{scale * found:.2g}"

    say(
        f"What bounds it: noise of the torque sensors {mean('near_torque_noise', 1e3)} (spindle) and "
        f"{mean('far_torque_noise', 1e3)} mN·m (jaw); from cycle to cycle the jaw repeats to "
        f"{mean('far_torque_cycles', 1e3)} mN·m and {mean('far_angle_cycles', math.degrees(1))} deg, the spindle's "
        f"torque to {mean('near_torque_cycles', 1e3)} mN·m."
    )


def _print_undetermined(model: ForceModel, *, carried: bool) -> None:
    weak = model.undetermined()
    if weak:
        say(f"These recordings do not determine {', '.join(weak)}: what was believed before holds, with its spread.")
    if carried:
        say(f"Recalibrated: {', '.join(RECALIBRATED)}. All else is carried over, and its uncertainty with it.")

"""The command that writes an instrument's solids, drawings and pictures: ``tenodesis cad``."""

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from tenodesis import cad
from tenodesis.cli.common import InstrumentFile, ProgressBar, check_choice, load_instrument, quantity, say
from tenodesis.cli.outputs import Overwrite, write_errors, writing
from tenodesis.errors import CommandError
from tenodesis.extras import require
from tenodesis.instrument import Instrument
from tenodesis.units import Length

_SMALL_MODULES = ("distal", "proximal")


def write_cad(  # noqa: PLR0917
    instrument_file: InstrumentFile,
    process: Annotated[
        str, typer.Option(help=f"How parts are made, which sets walls and plays: {', '.join(cad.PROCESSES)}.")
    ] = "fdm",
    axis: Annotated[str | None, typer.Option(help="Bending axis. Default: the first.", show_default=False)] = None,
    module: Annotated[
        list[str] | None,
        typer.Option(
            metavar="END=LENGTH",
            help="Module of the gears at an end, as in --module 'distal=0.25 mm'. Default: the coarsest that fits.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for solids, drawings and pictures.")] = Path("cad"),
    overwrite: Overwrite = False,
) -> None:
    """Write an instrument on its bench as solids: STEP, STL, glTF, drawings, pictures; checked over its range."""
    for name in ("build123d", "trimesh"):
        require(name, "cad")
    inst = load_instrument(instrument_file)
    check_choice("--process", process, cad.PROCESSES)
    if axis is not None:
        check_choice("--axis", axis, inst.axes)
    modules = _modules(module or [])
    outputs = [("--out", out / file) for file in cad.FILES]
    with (
        writing(outputs, [instrument_file], overwrite=overwrite, folder=out, subfolders=cad.FOLDERS),
        ProgressBar("", None) as bar,
        write_errors(out),
    ):
        checks = write_pack(inst, out, bar, process=process, axis=axis, modules=modules)
    print_checks(checks, process)
    say(f"{out / 'drawings.pdf'}, {out / 'assembly.step'}, {out / 'step'}, {out / 'stl'} and pictures are written.")


def write_pack(inst: Instrument, out: Path, bar: ProgressBar, **choices: Any) -> cad.Checks:
    """Build an instrument's solids and write their pack, with a progress bar."""

    def report(done: float, total: float, doing: str) -> None:
        bar(done, total, f"{doing:<20}")

    report(0, 1, "solids")
    return cad.write(cad.build(inst, **choices), out, progress=report)


def print_checks(checks: cad.Checks, process: str) -> None:
    """Print what was checked, and the parts whose walls are thinner than the process allows."""
    found = checks.agreement
    say(
        f"Checked: no parts overlap over the working range; at {found.angles} angles the tendons' lengths are the "
        f"statics' within {_length(found.excursion)}, the tip's place the kinematics' within {_length(found.tip)}; "
        f"{len(checks.printable)} meshes are closed."
    )
    for place, play in checks.play.items():
        say(f"Backlash of the gears at the {place}: {math.degrees(sum(play)):.2g}°.")
    say(f"Inertia of the tip from its solids: {checks.tip_inertia:.3g} kg·m² (dynamics.tip_inertia).")
    least = cad.PROCESSES[process].wall
    thin = {one.part: one.least_wall for one in checks.printable if one.least_wall < 0.98 * least}
    if thin:
        parts = ", ".join(f"{part} {1e3 * wall:.2g} mm" for part, wall in thin.items())
        say(f"Thinner somewhere than the {1e3 * least:g} mm that {process} allows: {parts}.")


def _length(value: float) -> str:
    return "a nanometre" if value < 1e-9 else f"{1e6 * value:.2g} µm"


def _modules(given: list[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for one in given:
        end, equals, value = one.partition("=")
        if not equals or end.strip() not in _SMALL_MODULES:
            raise CommandError(
                key="--module", value=one, allowed="distal=LENGTH or proximal=LENGTH, like 'distal=1 mm'"
            )
        found[end.strip()] = quantity("--module", value.strip(), Length)
    return found

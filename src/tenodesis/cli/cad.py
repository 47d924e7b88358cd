"""The command that writes an instrument's solids, drawings and pictures: ``tenodesis cad``."""

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
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

_ENDS = ("distal", "proximal")


def write_cad(  # noqa: PLR0917
    instrument_file: InstrumentFile,
    process: Annotated[
        str, typer.Option(help=f"How parts are made, which sets walls and plays: {', '.join(cad.PROCESSES)}.")
    ] = "sla",
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
    inst = load_instrument(instrument_file)
    check_choice("--process", process, cad.PROCESSES)
    if axis is not None:
        check_choice("--axis", axis, inst.axes)
    modules = _modules(module or [])
    checks = write_solids(
        inst, out, [instrument_file], option="--out", overwrite=overwrite, process=process, axis=axis, modules=modules
    )
    print_checks(checks, process)
    say(f"{out / 'drawings.pdf'}, {out / 'assembly.step'}, {out / 'step'}, {out / 'stl'} and pictures are written.")


def writing_solids(out: Path, inputs: Sequence[str], *, option: str, overwrite: bool) -> AbstractContextManager[None]:
    """Return the context in which a pack is written: refused before the work if it must not be."""
    for name in ("build123d", "trimesh"):
        require(name, "cad")
    outputs = [(option, out / file) for file in cad.FILES]
    return writing(outputs, inputs, overwrite=overwrite, folder=out, subfolders=cad.FOLDERS)


def write_solids(
    inst: Instrument,
    out: Path,
    inputs: Sequence[str],
    *,
    option: str,
    overwrite: bool,
    tolerances: Mapping[str, float] | None = None,
    **choices: Any,
) -> cad.Checks:
    """Build solids and write their pack, with a progress bar; choices are those of :func:`cad.build`."""
    with (
        writing_solids(out, inputs, option=option, overwrite=overwrite),
        ProgressBar("", None) as bar,
        write_errors(out),
    ):

        def report(done: float, total: float, doing: str) -> None:
            bar(done, total, f"{doing:<20}")

        report(0, 1, "solids")
        return cad.write(cad.build(inst, **choices), out, tolerances, report)


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
        if not equals or end.strip() not in _ENDS:
            raise CommandError(
                key="--module", value=one, allowed="distal=LENGTH or proximal=LENGTH, like 'distal=1 mm'"
            )
        found[end.strip()] = quantity("--module", value.strip(), Length)
    return found

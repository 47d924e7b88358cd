"""The command that writes an instrument's solids, drawings and pictures: ``tenodesis cad``."""

import math
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Annotated

import typer
from markupsafe import Markup

from tenodesis import cad
from tenodesis.cad.assembly import Progress
from tenodesis.cli.command import command
from tenodesis.cli.common import InstrumentFile, ProgressBar, check_choice, load_instrument, quantity, say
from tenodesis.cli.outputs import Outputs
from tenodesis.errors import CommandError, InstrumentError
from tenodesis.extras import require
from tenodesis.files import write_errors
from tenodesis.instrument import as_short_form
from tenodesis.instrument.tip_motion import tip_inertia
from tenodesis.report import style
from tenodesis.scaling import AnyDesign, JointDesign
from tenodesis.scaling.plan import PlanFigure
from tenodesis.units import Length

_ENDS = ("distal", "proximal")


@command("instrument_file")
def write_cad(  # noqa: PLR0917
    outputs: Outputs,
    instrument_file: InstrumentFile,
    process: Annotated[
        str, typer.Option(help=f"How parts are made, which sets walls and plays: {', '.join(cad.PROCESSES)}.")
    ] = "sla",
    axis: Annotated[str | None, typer.Option(help="Bending axis. Default: the first.")] = None,
    module: Annotated[
        list[str] | None,
        typer.Option(
            metavar="END=LENGTH",
            help="Module of the gears at an end, as in --module 'distal=0.25 mm'. Default: the coarsest that fits.",
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for solids, drawings and pictures.")] = Path("cad"),
) -> None:
    """Write an instrument on its bench as solids: STEP, STL, glTF, drawings, pictures; checked over its range."""
    inst = load_instrument(instrument_file)
    check_choice("--process", process, cad.PROCESSES)
    if axis is not None and inst.short_form is not None:
        check_choice("--axis", axis, inst.short_form.axes)
    modules = _modules(module or [])
    with writing_solids(outputs, out, "--out"), ProgressBar("", None) as bar:
        report = in_step(bar)
        report(0, 1, "solids")
        model = cad.build(inst, process=process, axis=axis, modules=modules)
        with write_errors(out, CommandError):
            checks = cad.write(model, out, progress=report)
    print_checks(checks, model)
    say(f"{out / 'drawings.pdf'}, {out / 'assembly.step'}, {out / 'step'}, {out / 'stl'} and pictures are written.")


def writing_solids(outputs: Outputs, out: Path, option: str) -> AbstractContextManager[None]:
    """Return the context in which a pack is written: refused before the work if it must not be."""
    for name in ("build123d", "rtree", "trimesh"):
        require(name, "cad")
    return outputs.folder(out, cad.FILES, cad.FOLDERS, option=option)


def in_step(bar: ProgressBar) -> Progress:
    """Return what shows the progress of solids on a bar, its descriptions of one width."""
    return lambda done, total, doing: bar(done, total, f"{doing:<20}")


def print_checks(checks: cad.Checks, model: cad.Model) -> None:
    """Print what was checked, the tip's inertia, and the parts whose walls are thinner than the process allows."""
    found = checks.agreement
    say(
        f"Checked: no parts overlap over the working range; at {found.angles} angles the tendons' lengths are the "
        f"statics' within {_length(found.excursion)}, the tip's place the kinematics' within {_length(found.tip)}; "
        f"{len(checks.printable)} meshes are closed."
    )
    for place, play in checks.play.items():
        of = f"at the {place}" if model.axis is not None else f"of {place}"
        say(f"Backlash of the gears {of}: {math.degrees(sum(play)):.2g}°.")
    _print_inertia(checks, model)
    least = model.process.wall
    thin = {one.part: one.least_wall for one in checks.printable if one.least_wall < 0.98 * least}
    if thin:
        parts = ", ".join(f"{part} {1e3 * wall:.2g} mm" for part, wall in thin.items())
        say(f"Thinner somewhere than the {1e3 * least:g} mm that {model.process.name} allows: {parts}.")


def _print_inertia(checks: cad.Checks, model: cad.Model) -> None:
    given, built = model.given.short_form, checks.instrument.short_form
    if given is None or built is None:
        links = ", ".join(
            f"{joint.bend} {1e3 * (joint.mass or 0.0):.3g} g"
            for joint in checks.instrument.expanded.tip_joints
            if joint.arc == joint.arc_count or not joint.arc
        )
        more = checks.instrument.sources["joints.inertia"].partition("; ")[2]
        say(
            f"Links of the tip from their solids: {links}; the instrument file that is written has them"
            f"{f', and inertias {more}' if more else ''}."
        )
        return
    old, new = (tip_inertia(inst.axis(model.axis or "yaw")) for inst in (given, built))
    light = "" if new <= checks.tip_inertia * (1 + 1e-9) else f", {new:.3g} in the file, the least its twin can follow"
    was = "" if given.dynamics.tip_inertia is not None else ", of a tip that swings at 20 Hz"
    say(
        f"Inertia of the tip from its solids: {checks.tip_inertia:.3g} kg·m²{light} (before: {old:.3g} kg·m²{was}); "
        f"the instrument file that is written has it{' for both axes' if len(given.axes) > 1 else ''}."
    )


class DesignSolids:
    """The solids of a scale model, in a folder if one is given; what cannot be made is reported in the end."""

    def __init__(self, folder: Path | None, process: str) -> None:
        self._folder, self._process = folder, process
        self._model: cad.Model | None = None
        self._checks: cad.Checks | None = None
        self._refused: InstrumentError | None = None

    def build(self, design: AnyDesign, report: Progress) -> AnyDesign:
        """Build them, with the modules of the design's gears, and return the design with their inertia."""
        if self._folder is None or isinstance(design, JointDesign):
            return design
        report(0, 1, "solids")
        wheels = {"distal": design.choice.distal, "proximal": design.choice.proximal}
        modules = {end: wheel.module for end, wheel in wheels.items() if wheel.module is not None}
        try:
            self._model = cad.build(design.scaled_up, process=self._process, modules=modules)
        except InstrumentError as problem:
            self._refused = problem
            return design
        return design.built_as(as_short_form(cad.with_inertia(self._model)))

    @property
    def backlash(self) -> float | None:
        """Play of their gears along the pitch circle, m; None where there are no solids."""
        return None if self._model is None else self._model.process.backlash

    def write(self, tolerances: Mapping[str, float] | None, report: Progress) -> None:
        """Write their pack."""
        if self._folder is None or self._model is None:
            return
        try:
            with write_errors(self._folder, CommandError):
                self._checks = cad.write(self._model, self._folder, tolerances, report)
        except InstrumentError as problem:
            self._refused = problem

    def picture(self, out: Path) -> PlanFigure | None:
        """Return their picture for a plan in a folder, with the way to their glTF file from there."""
        if self._folder is None or self._checks is None:
            return None
        svg = Markup(style.inlined("solids", (self._folder / "assembly.svg").read_text("utf-8")))
        caption = "The solids on their bench, the tip and the joint of the handle"
        return PlanFigure(caption, svg, Path(os.path.relpath(self._folder / cad.ASSEMBLY, out)).as_posix())

    def report(self) -> None:
        """Print what was checked. Raises InstrumentError if they cannot be made."""
        if self._model is not None and self._checks is not None:
            print_checks(self._checks, self._model)
            say(f"Its solids, drawings and pictures are written to {self._folder}.")
        if self._refused is not None:
            raise self._refused


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

"""What ``tenodesis scale`` does with an instrument of several joints."""

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape

from tenodesis import scaling, tolerance, workshop
from tenodesis.cli.cad import in_step
from tenodesis.cli.common import ProgressBar, console, say, table
from tenodesis.cli.outputs import Outputs
from tenodesis.control.controller import fault_names
from tenodesis.errors import CommandError, NoSolutionError, ProtocolError, StudyError
from tenodesis.files import atomic_files, write_errors
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_file
from tenodesis.report import style
from tenodesis.scaling import Catalogue, JointDesign, JointFront, figures, joints_plan
from tenodesis.scaling.design import PREFERENCES, Preference
from tenodesis.scaling.joints_plan import AsBuilt, distance
from tenodesis.scaling.plan import part_rows
from tenodesis.scaling.practical import PracticalFront
from tenodesis.scaling.sweep import Progress as Report

_FILES = ("scaled-up.toml", "plan.html", "plan.pdf", "parts.csv", "front.csv", "front.svg", "front.png")
_SAMPLES = 64
_SHARE = 0.95
_SHOWN_ERROR = 0.01  # deg, the smallest that is told apart
_HEADING = """Scale model of {}, designed by tenodesis scale; plan.html lists what to build and which weights to use.
The links' inertia and damping, and the ropes' true modulus, are to be measured once it stands."""


def scale_joints(  # noqa: PLR0917
    outputs: Outputs,
    inst: Instrument,
    parts: Catalogue,
    pins: Mapping[str, Any],
    prefer: Preference,
    pick: int | None,
    out: Path,
    target: float | None,
) -> None:
    """Design a scale model, write its files, and print front, factors and errors.

    With a target, deg, also what a workshop needs for it: tolerances, order list, assembly and first run.
    """
    files = (*_FILES, *(workshop.FILES if target is not None else ()))
    with outputs.folder(out, files), ProgressBar("", None) as bar:
        report = in_step(bar)
        front = scaling.design_joints(
            inst, parts, pins=pins, progress=lambda doing, done, total: report(done, total, doing)
        )
        if pick is not None and not 1 <= pick <= len(front):
            raise CommandError(key="--pick", value=pick, allowed=f"a row of the front, from 1 to {len(front)}")
        chosen = front.best(prefer) if pick is None else pick - 1
        design = front[chosen]
        report(0, 1, "drawing instruments from tolerances")
        built, lacking = _built(design)
        pack, without = None, ""
        if target is not None:
            pack, without = packed(design, None, target, None, lambda doing, done, total: report(done, total, doing))
        report(0, 1, "writing the plan")
        _write(out, front, design, built, pack)
    _print(front, chosen, design, built)
    if pack is not None:
        print_built(pack.budget)
    for sentence in (lacking, without):
        if sentence:
            say(sentence)
    say(f"{', '.join(str(out / name) for name in _FILES[:5])} and a picture of the front are written.")
    print_pack(out, pack)


def _built(design: JointDesign) -> tuple[AsBuilt | None, str]:
    """Return the errors that most instruments keep that are built to usual tolerances; or a sentence on why not."""
    try:
        found = tolerance.drawn(design.real_size, design.scaled_up, samples=_SAMPLES)
    except StudyError as problem:
        return None, f"As built is left out: {problem}"
    kept = [float(np.quantile(found[f"similarity_largest.{one}"], _SHARE)) for one in design.comparison.joints]
    return AsBuilt(_SHARE, tuple(kept), 1e-3 * float(np.quantile(found["tip_largest"], _SHARE))), ""


def packed(
    design: scaling.AnyDesign, practical: PracticalFront | None, target: float, backlash: float | None, report: Report
) -> tuple[workshop.Pack | None, str]:
    """Return what a workshop needs besides the plan; or a sentence on why a design has no such, and the plan alone."""
    try:
        return workshop.prepare(design, practical, target=target, backlash=backlash, progress=report), ""
    except (StudyError, ProtocolError, NoSolutionError) as problem:
        return None, f"There are no tolerances, order list and first run for it: {problem}"


def print_pack(out: Path, pack: workshop.Pack | None) -> None:
    """Print which files a workshop gets besides the plan, and which are left of an earlier design."""
    if pack is not None:
        say(f"Beside them: {', '.join(workshop.FILES)}.")
        if pack.first_run.faults:
            say(f"warning: the controller faults in the first run: {', '.join(fault_names(pack.first_run.faults))}.")
    elif left := [name for name in workshop.FILES if (out / name).exists()]:
        say(f"warning: of an earlier design are {', '.join(left)} in {out}; delete them.")


def print_built(budget: workshop.Budget) -> None:
    """Print what instruments built to a budget keep, and what that costs."""
    forces = budget.forces or tuple(budget.by_force)
    keeps = "keep" if budget.is_kept else "keep, with every grade that lowers it by 1 % for a cost of 1,"
    dearest = max(budget.dimensions.values(), key=lambda one: one.cost)
    say(
        f"With friction: as designed {budget.designed:.2g}°; as built to the tolerances of the plan, up to "
        f"{max(forces):.3g} N: median {budget.built.median:.2g}°, {100 * budget.share:g} % {keeps} "
        f"{budget.built.kept:.2g}° ({budget.samples} drawn); cost {budget.cost:.3g}, most of it {dearest.key} "
        f"({dearest.cost:.2g}). With the cheapest grades {budget.coarsest.kept:.2g}°."
    )


def _write(
    out: Path, front: JointFront, design: JointDesign, built: AsBuilt | None, pack: workshop.Pack | None
) -> None:
    with write_errors(out, CommandError), atomic_files(out) as new:
        (new / _FILES[0]).write_text(to_file(design.scaled_up, comment=_HEADING.format(design.real_size.name)), "utf-8")
        joints_plan.write(design, new, built, None if pack is None else pack.supplement())
        if pack is not None:
            pack.write(new)
        with (new / "parts.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([("number", "part", "take", "which is"), *part_rows(design)])
        write_front(front, front, design.objectives, new)


def write_front(
    front: "scaling.Front | JointFront", drawn: "scaling.Front | JointFront", chosen: scaling.Objectives, folder: Path
) -> None:
    """Write the designs of a front as CSV, and the picture of one with the chosen design."""
    with style.applied():
        figure = figures.draw_front(drawn, {"this design": chosen})
        figure.savefig(folder / "front.svg", metadata={"Date": None}, dpi=200)
        figure.savefig(folder / "front.png", dpi=200)
    columns = {"row": list(range(1, len(front) + 1)), **front.table()}
    with (folder / "front.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        for row in zip(*columns.values(), strict=True):
            writer.writerow(f"{value:.9g}" if isinstance(value, float) else value for value in row)


def print_designs(
    front: "scaling.Front | JointFront",
    rows: Sequence[int],
    chosen: int | None,
    built: Callable[[int], float] | None = None,
) -> None:
    """Print some designs of a front, with what most of them keep as built (deg) where that is known."""
    title = (
        f"{front.real_size.name}: {front.examined} scale models judged, {front.feasible} meet every constraint, "
        f"{len(front)} on the front"
    )
    also = () if built is None else (">as built",)
    designs = table(title, ">row", ">as designed", *also, ">resolution", ">length", ">margin", "made of")
    for index in rows:
        one = front.objectives[index]
        row = (
            str(index + 1), error_text(one.similarity_error), *(() if built is None else (f"{built(index):.2g}°",)),
            f"{1e3 * one.force_resolution:.3g} mN", f"{1e3 * one.overall_length:.4g} mm", f"{one.tension_margin:.3g}",
            escape(front.described(index)),
        )  # fmt: skip
        designs.add_row(*row, style="bold" if index == chosen else None)
    console.print(designs)


def _print(front: JointFront, chosen: int, design: JointDesign, built: AsBuilt | None) -> None:
    print_designs(front, sorted({front.best(one) for one in PREFERENCES} | {chosen}), chosen)
    pair = design.comparison
    found = {"as designed": design.error, "with friction\nat rest": design.error_at_rest}
    columns = {name: (error.largest.tolist(), error.largest_at_tip) for name, error in found.items()}
    if built is not None:
        columns[f"as built,\n{100 * built.share:g} % keep"] = (list(built.joints), built.tip)
    errors = table("largest similarity error", "", *(f">{name}" for name in columns))
    for n, joint in enumerate(pair.joints):
        errors.add_row(joint, *(error_text(angles[n]) for angles, _ in columns.values()))
    errors.add_row("at the real-size tip", *(distance(tip) for _, tip in columns.values()))
    console.print(errors)
    factors = pair.factors
    say(
        f"Row {chosen + 1} is taken: {design.scaled_up.name}, length x {factors['length']:.4g}, force x "
        f"{factors['force']:.4g}, tension x {factors['tension']:.4g}, time x {factors['time']:.4g}."
    )
    if (stock := front.in_stock) is not None:
        say(f"With wheels in stock alone: {error_text(stock.error)} as designed, length x {stock.factor:.4g}.")
    say("As built: by usual tolerances; tenodesis tolerance says which of them dominate.")


def error_text(degrees: float) -> str:
    """Return a similarity error as text."""
    return f"{degrees:.2f}°" if degrees >= _SHOWN_ERROR else f"<{_SHOWN_ERROR:g}°"

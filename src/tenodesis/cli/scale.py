"""The command that designs a scale model: ``tenodesis scale``."""

import csv
import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np
import typer
from rich.markup import escape

from tenodesis import cad, scaling, tolerance, workshop
from tenodesis.cli.cad import DesignSolids, in_step, writing_solids
from tenodesis.cli.command import command
from tenodesis.cli.common import ProgressBar, check_choice, console, load_instrument, quantity, say, table
from tenodesis.cli.outputs import Outputs
from tenodesis.control.controller import fault_names
from tenodesis.errors import CommandError, NoSolutionError, ProtocolError, StudyError
from tenodesis.extras import require
from tenodesis.files import atomic_files, write_errors
from tenodesis.instrument import expanded
from tenodesis.instrument.text import to_file
from tenodesis.report import style
from tenodesis.scaling import AnyDesign, Front, JointDesign, JointFront, figures, plan
from tenodesis.scaling.design import PREFERENCES, Preference
from tenodesis.scaling.plan import AsBuilt, distance
from tenodesis.scaling.practical import OBJECTIVES as PRACTICAL_OBJECTIVES
from tenodesis.scaling.practical import SIMILAR, Objective, PracticalFront, practical_front
from tenodesis.scaling.practical import as_built as built_usually
from tenodesis.scaling.sweep import Progress as Report
from tenodesis.units import SimilarityError

AnyFront: TypeAlias = Front | JointFront

_FILES = ("scaled-up.toml", "plan.html", "plan.pdf", "parts.csv", "front.csv", "front.svg", "front.png")
_SHOWN = 10
_TRIED = 20
_NEAR = 0.9  # of the tension that a part allows
_SAMPLES = 64
_SHARE = 0.95
_SHOWN_ERROR = 0.01  # deg, the smallest that is told apart
_HEADING = """Scale model of {}, designed by tenodesis scale; plan.html lists what to build and which weights to use.
The tip's inertia and damping, and the ropes' true modulus, are to be measured once it stands."""


@command("instrument_file", "catalogue")
def scale(  # noqa: PLR0917
    outputs: Outputs,
    instrument_file: Annotated[
        str, typer.Argument(metavar="INSTRUMENT", help="The real-size instrument: file or shipped name.")
    ] = "real-size",
    catalogue: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Parts and constraints: file, or one of {', '.join(scaling.shipped())}; several are merged in order. "
            "Default: standard."
        ),
    ] = None,
    factor: Annotated[float | None, typer.Option(help="Scaled-up over real-size distal radius. Default: free.")] = None,
    pin: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE", help=f"Fix a choice, as in --pin 'overall_length=1 m': {', '.join(scaling.PINS)}."
        ),
    ] = None,
    prefer: Annotated[Preference, typer.Option(help="Objective by which to choose from the front.")] = "similarity",
    pick: Annotated[int | None, typer.Option(help="Row of front.csv to choose instead, counted from 1.")] = None,
    objective: Annotated[
        Objective | None,
        typer.Option(
            help=f"Take the best of all designs judged, similar to {SIMILAR:g}°, by this instead of --prefer."
        ),
    ] = None,
    as_built: Annotated[
        str, typer.Option(help="Similarity error that 95 % of the instruments built to the tolerances must keep.")
    ] = f"{workshop.TARGET:g} deg",
    parts_too: Annotated[
        bool,
        typer.Option(
            "--parts/--no-parts", help="Whether to choose tolerances, and list parts, assembly and first run."
        ),
    ] = True,
    combinations: Annotated[
        int,
        typer.Option(help="About how many scale models to judge, first over all parts, then over lengths of the best."),
    ] = scaling.COMBINATIONS,
    out: Annotated[Path, typer.Option(help="Folder for instrument file, plan and front.")] = Path("prototype"),
    solids: Annotated[
        Path | None, typer.Option("--cad", help="Folder for its solids, drawings and pictures as well.")
    ] = None,
    process: Annotated[str, typer.Option("--cad-process", help="How its parts are made, as of tenodesis cad.")] = "sla",
    joints: Annotated[
        bool, typer.Option("--joints", help="Of two planar axes, design both at once instead of the first.")
    ] = False,
) -> None:
    """Design a scale model of an instrument from stock parts: instrument file, test plan, and how similar it is.

    Of an instrument that lists joints and tendons, all joints at once; --objective and --cad are of planar instruments
    alone.
    """
    require("typst", "design")
    if objective is not None and pick is not None:
        raise CommandError(
            f"--objective is {objective} and --pick is {pick}; give one of them.",
            key="--pick",
            value=pick,
            allowed="given without --objective",
        )
    target = float(np.degrees(quantity("--as-built", as_built, SimilarityError)))
    check_choice("--cad-process", process, cad.PROCESSES)
    if solids is not None and solids.resolve() == out.resolve():
        raise CommandError(
            f"--cad and --out are both {out}; give different folders.",
            key="--cad",
            value=solids,
            allowed="another folder than --out",
        )
    inst = load_instrument(instrument_file)
    together = joints or inst.short_form is None
    for option, value in (("--objective", objective), ("--cad", solids)):
        if together and value is not None:
            raise CommandError(
                f"{option} is given, but {inst.name} is designed by its joints; leave it out.", key=option, value=value
            )
    with ExitStack() as stack:
        if solids is not None:
            stack.enter_context(writing_solids(outputs, solids, "--cad"))
        parts = scaling.load(*(catalogue or ()))
        pins = _pins(factor, pin or [])
        stack.enter_context(outputs.folder(out, (*_FILES, *(workshop.FILES if parts_too else ()))))
        report = in_step(stack.enter_context(ProgressBar("", None)))

        def designing(doing: str, done: int, total: int) -> None:
            report(done, total, doing)

        def searched(pins: dict[str, Any]) -> AnyFront:
            if together:
                return scaling.design_joints(inst, parts, pins=pins, progress=designing)
            return scaling.design(inst, parts, pins=pins, combinations=combinations, progress=designing)

        front = searched(pins)
        practical = _practical(front, objective, parts_too=parts_too)
        chosen, design = _chosen(front, prefer, pick) if objective is None else _best(practical, objective)
        free = searched({}) if pins and not together else front
        built = DesignSolids(solids, process)
        design = built.build(design, report)
        report(0, 1, "drawing instruments from tolerances")
        kept, lacking = _built(design)
        pack, without = _packed(design, practical, target, built.backlash, designing) if parts_too else (None, "")
        built.write(None if pack is None else pack.budget.drawn, report)
        report(0, 1, "writing the plan")
        supplement = _supplement(pack, None if objective is None else chosen, built.picture(out))
        _write(out, front, free, design, kept, supplement, pack)
    _print_front(front, chosen if objective is None else None, design, kept)
    if isinstance(free, Front) and free is not front:
        say(f"Without the pins, {scaling.rivals_text(free, design.objectives)}")
    if practical is not None:
        _print_objectives(practical, objective)
    if pack is not None:
        _print_budget(pack.budget)
    for sentence in filter(None, (lacking, without)):
        say(sentence)
    picture = "its picture" if free is front else "a picture of the front without pins"
    say(f"{', '.join(str(out / name) for name in _FILES[:5])} and {picture} are written.")
    _print_pack(out, pack)
    built.report()


def _pins(factor: float | None, pins: Sequence[str]) -> dict[str, Any]:
    given: dict[str, str] = {}
    for pin in pins:
        key, equals, value = pin.partition("=")
        if not equals or not key.strip() or not value.strip():
            raise CommandError(key="--pin", value=pin, allowed="KEY=VALUE, like 'overall_length=1 m'")
        if key.strip() in given:
            raise CommandError(
                f"--pin names {key.strip()} twice; name it once.", key="--pin", value=key.strip(), allowed="named once"
            )
        given[key.strip()] = value.strip()
    if factor is not None and "factor" in given:
        raise CommandError(
            f"--factor is {factor:g} and --pin names factor as well; give one of them.",
            key="--pin",
            value="factor",
            allowed="given without --factor",
        )
    return scaling.parse_pins(given, file=True) | ({} if factor is None else scaling.parse_pins({"factor": factor}))


def _chosen(front: AnyFront, prefer: Preference, pick: int | None) -> tuple[int, AnyDesign]:
    """Return the index of the design to take, and the design: the first whose test forces can be hung."""
    if pick is not None:
        if not 1 <= pick <= len(front):
            raise CommandError(key="--pick", value=pick, allowed=f"a row of the front, from 1 to {len(front)}")
        return pick - 1, front[pick - 1]
    return _first_hung(front, front.ranked(prefer))


def _first_hung(front: AnyFront | PracticalFront, ranked: Sequence[int]) -> tuple[int, AnyDesign]:
    """Return the first design, with its index, whose test forces can be hung."""
    problems = []
    for index in ranked[:_TRIED]:
        try:
            return index, front[index]
        except scaling.DesignError as problem:
            problems.append(problem)
    raise problems[0]


def _practical(front: AnyFront, objective: Objective | None, *, parts_too: bool) -> PracticalFront | None:
    """Return the designs by what a workshop asks; None where they are not asked for, or there are none."""
    if isinstance(front, JointFront) or (objective is None and not parts_too):
        return None
    try:
        return practical_front(front)
    except scaling.DesignError:
        if objective is None:
            return None
        raise


def _best(practical: PracticalFront | None, objective: Objective) -> tuple[int, AnyDesign]:
    """Return the index on the practical front and the design: the first whose test forces can be hung."""
    assert practical is not None
    return _first_hung(practical, practical.ranked(objective))


def _supplement(
    pack: workshop.Pack | None, marked: int | None, pictured: plan.PlanFigure | None
) -> plan.Supplement | None:
    """Return what the plan has of parts and solids; `marked` is the design's index on the practical front."""
    found = None if pack is None else pack.supplement(marked)
    if pictured is None:
        return found
    found = found or plan.Supplement(None, ())
    return replace(found, rows=((pictured,), *found.rows))


def _built(design: AnyDesign) -> tuple[AsBuilt | None, str]:
    """Return the errors that most instruments keep that are built to usual tolerances; or a sentence on why not.

    Those of one plane are linear, and in its front.
    """
    if not isinstance(design, JointDesign):
        return None, ""
    try:
        found = tolerance.drawn(design.real_size, design.scaled_up, samples=_SAMPLES)
    except StudyError as problem:
        return None, f"As built is left out: {problem}"
    kept = [float(np.quantile(found[f"similarity_largest.{one}"], _SHARE)) for one in design.comparison.joints]
    return AsBuilt(_SHARE, tuple(kept), 1e-3 * float(np.quantile(found["tip_largest"], _SHARE))), ""


def _packed(
    design: AnyDesign, practical: PracticalFront | None, target: float, backlash: float | None, report: Report
) -> tuple[workshop.Pack | None, str]:
    """Return what a workshop needs besides the plan; or a sentence on why a design has no such, and the plan alone."""
    try:
        return workshop.prepare(design, practical, target=target, backlash=backlash, progress=report), ""
    except (StudyError, ProtocolError, NoSolutionError) as problem:
        return None, f"There are no tolerances, order list and first run for it: {problem}"


def _print_pack(out: Path, pack: workshop.Pack | None) -> None:
    """Print which files a workshop gets besides the plan, and which are left of an earlier design."""
    if pack is not None:
        say(f"Beside them: {', '.join(workshop.FILES)}.")
        if pack.first_run.faults:
            say(f"warning: the controller faults in the first run: {', '.join(fault_names(pack.first_run.faults))}.")
    elif left := [name for name in workshop.FILES if (out / name).exists()]:
        say(f"warning: of an earlier design are {', '.join(left)} in {out}; delete them.")


def _print_budget(budget: workshop.Budget) -> None:
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


def _write(  # noqa: PLR0917
    out: Path,
    front: AnyFront,
    free: AnyFront,
    design: AnyDesign,
    built: AsBuilt | None,
    supplement: plan.Supplement | None,
    pack: workshop.Pack | None,
) -> None:
    """Write all files to a temporary place, and move them when all are written."""
    with write_errors(out, CommandError), atomic_files(out) as new:
        (new / _FILES[0]).write_text(to_file(design.scaled_up, comment=_HEADING.format(design.real_size.name)), "utf-8")
        plan.write(design, new, supplement, built)
        with (new / "parts.csv").open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([("number", "part", "take", "which is"), *plan.part_rows(design)])
        if pack is not None:
            pack.write(new)
        _write_front(front, free, design.objectives, new)


def _write_front(front: AnyFront, drawn: AnyFront, chosen: scaling.Objectives, folder: Path) -> None:
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


def _print_front(front: AnyFront, chosen: int | None, design: AnyDesign, kept: AsBuilt | None) -> None:
    built = partial(built_usually, front) if isinstance(front, Front) else None
    title = (
        f"{front.real_size.name}: {front.examined} scale models judged, {front.feasible} meet every constraint, "
        f"{len(front)} on the front"
    )
    also = () if built is None else (">as built",)
    designs = table(title, ">row", ">as designed", *also, ">resolution", ">length", ">margin", "made of")
    for index in _representatives(front, chosen):
        one = front.objectives[index]
        row = (
            str(index + 1), _error_text(one.similarity_error), *(() if built is None else (f"{built(index):.2g}°",)),
            f"{1e3 * one.force_resolution:.3g} mN", f"{1e3 * one.overall_length:.4g} mm", f"{one.tension_margin:.3g}",
            escape(front.described(index)),
        )  # fmt: skip
        designs.add_row(*row, style="bold" if index == chosen else None)
    console.print(designs)
    say(
        "As designed: largest similarity error over the working range. As built: what 95 % keep with usual tolerances; "
        "tenodesis tolerance says which of them dominate. Resolution: least force on the real instrument. Margin: "
        "breaking load over the largest tension."
    )
    if isinstance(design, JointDesign):
        _print_errors(design, kept)
    factors, pretensions = design.comparison.factors, expanded(design.scaled_up).pretensions
    tight = " to ".join(dict.fromkeys(f"{one:.4g}" for one in (pretensions.min(), pretensions.max())))
    say(
        f"{'Another design' if chosen is None else f'Row {chosen + 1}'} is taken: {design.scaled_up.name}, length "
        f"x {factors['length']:.4g}, force x {factors['force']:.4g}, tension x {factors['tension']:.4g}, time "
        f"x {factors['time']:.4g}; pretension {tight} N."
    )
    if isinstance(front, JointFront) and (stock := front.in_stock) is not None:
        say(f"With wheels in stock alone: {_error_text(stock.error)} as designed, length x {stock.factor:.4g}.")
    for sentence in _strained(design):
        say(sentence)


def _print_errors(design: JointDesign, built: AsBuilt | None) -> None:
    pair = design.comparison
    found = {"as designed": design.error, "with friction\nat rest": design.error_at_rest}
    columns = {name: (error.largest.tolist(), error.largest_at_tip) for name, error in found.items()}
    if built is not None:
        columns[f"as built,\n{100 * built.share:g} % keep"] = (list(built.joints), built.tip)
    errors = table("largest similarity error", "", *(f">{name}" for name in columns))
    for n, joint in enumerate(pair.joints):
        errors.add_row(joint, *(_error_text(angles[n]) for angles, _ in columns.values()))
    errors.add_row("at the real-size tip", *(distance(tip) for _, tip in columns.values()))
    console.print(errors)


def _error_text(degrees: float) -> str:
    """Return a similarity error as text."""
    return f"{degrees:.2f}°" if degrees >= _SHOWN_ERROR else f"<{_SHOWN_ERROR:g}°"


def _strained(design: AnyDesign) -> Iterator[str]:
    """Yield a sentence for each limit that the largest tension comes near: the rope's, the motors'."""
    limits, choice = design.catalogue.constraints, design.choice
    torque = math.inf if limits.spool_torque is None else limits.spool_torque
    for what, most in (
        (f"the rope, {choice.rope.name}, allows", choice.rope.breaking_load / limits.tension_margin),
        ("the motors hold", torque / choice.spool.radius),
    ):
        if design.largest_tension > _NEAR * most:
            yield (
                f"Near its limit: the largest tension is {100 * design.largest_tension / most:.0f} % of the "
                f"{most:.4g} N that {what}; --prefer margin has more room."
            )


def _print_objectives(practical: PracticalFront, taken: Objective | None) -> None:
    title = "similar to 0.3°, by what a workshop asks"
    found = table(title, "", ">cost", ">length", ">weeks", ">as designed", ">as built", "made of")
    for objective in PRACTICAL_OBJECTIVES:
        index = practical.best(objective)
        one = practical.practical[index]
        row = (
            f"{one.cost:.3g}", f"{1e3 * one.overall_length:.4g} mm", str(int(one.waiting + 1e-9)),
            _error_text(practical.exact[index].similarity_error), f"{one.as_built:.2g}°",
            escape(practical.described(index)),
        )  # fmt: skip
        found.add_row(objective, *row, style="bold" if objective == taken else None)
    console.print(found)
    say(
        "Cost: of parts, 1 is one turned to general tolerances. Weeks: kinds of wheels and ropes that take weeks "
        "to get. "
        "As built: what 95 % keep with usual tolerances, without friction."
    )


def _representatives(front: AnyFront, chosen: int | None) -> list[int]:
    """Return a few designs of the front: the best by every preference, the chosen design, and some between."""
    best = {front.best(prefer) for prefer in PREFERENCES} | (set() if chosen is None else {chosen})
    step = max(len(front) // max(_SHOWN - len(best), 1), 1)
    return sorted(best | set(list(range(0, len(front), step))[: max(_SHOWN - len(best), 0)]))

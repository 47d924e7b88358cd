"""The command that designs a scale model: ``tenodesis scale``."""

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape

from tenodesis import cad, scaling, workshop
from tenodesis.cli.cad import DesignSolids, in_step, writing_solids
from tenodesis.cli.command import command
from tenodesis.cli.common import ProgressBar, check_choice, console, load_instrument, quantity, say, table
from tenodesis.cli.outputs import Outputs
from tenodesis.cli.scale_joints import (
    error_text,
    packed,
    print_built,
    print_designs,
    print_pack,
    scale_joints,
    write_front,
)
from tenodesis.errors import CommandError
from tenodesis.extras import require
from tenodesis.files import atomic_files, write_errors
from tenodesis.instrument import ShortForm
from tenodesis.instrument.text import to_file
from tenodesis.scaling import Catalogue, Design, Front, plan
from tenodesis.scaling.design import PREFERENCES, Preference
from tenodesis.scaling.practical import OBJECTIVES as PRACTICAL_OBJECTIVES
from tenodesis.scaling.practical import SIMILAR, Objective, PracticalFront, practical_front
from tenodesis.scaling.practical import as_built as built_usually
from tenodesis.scaling.sweep import Progress as Report
from tenodesis.units import SimilarityError

_SHOWN = 10
_TRIED = 20
_NEAR = 0.9  # of the tension that a part allows
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
    files = ["scaled-up.toml", "plan.html", "plan.pdf", "front.csv", "front.svg", "front.png"]
    files += workshop.FILES if parts_too else ()
    inst = load_instrument(instrument_file)
    if joints or inst.short_form is None:
        for option, value in (("--objective", objective), ("--cad", solids)):
            if value is not None:
                raise CommandError(
                    f"{option} is given, but {inst.name} is designed by its joints; leave it out.",
                    key=option,
                    value=value,
                )
        parsed = _pins(factor, pin or [])
        parts = scaling.load(*(catalogue or ()))
        scale_joints(outputs, inst, parts, parsed, prefer, pick, out, target if parts_too else None)
        return
    with ExitStack() as stack:
        if solids is not None:
            stack.enter_context(writing_solids(outputs, solids, "--cad"))
        model = load_instrument(instrument_file, planar=True)
        parts = scaling.load(*(catalogue or ()))
        pins = _pins(factor, pin or [])
        stack.enter_context(outputs.folder(out, files))
        report = in_step(stack.enter_context(ProgressBar("", None)))

        def designing(doing: str, done: int, total: int) -> None:
            report(done, total, doing)

        front = _front(model, parts, pins, combinations, designing)
        practical = _practical(front, objective, parts_too=parts_too)
        chosen, design = _chosen(front, prefer, pick) if objective is None else _best(practical, objective)
        free = _front(model, parts, {}, combinations, designing) if pins else None
        built = DesignSolids(solids, process)
        design = built.build(design, report)
        pack, lacking = packed(design, practical, target, built.backlash, designing) if parts_too else (None, "")
        built.write(None if pack is None else pack.budget.drawn, report)
        report(0, 1, "writing the plan")
        supplement = _supplement(pack, None if objective is None else chosen, built.picture(out))
        _write(out, files, front, design, free, supplement, pack)
    _print_front(front, chosen if objective is None else None, design, free)
    if practical is not None:
        _print_objectives(practical, objective)
    if pack is not None:
        if objective is not None and practical is not None:
            _print_built(pack, practical.practical[chosen].as_built)
        else:
            _print_built(pack, built_usually(front, chosen))
    if lacking:
        say(lacking)
    _print_written(out, pack, pins=bool(pins))
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


def _front(model: ShortForm, parts: Catalogue, pins: dict[str, Any], combinations: int, report: Report) -> Front:
    return scaling.design(model, parts, pins=pins, combinations=combinations, progress=report)


def _chosen(front: Front, prefer: Preference, pick: int | None) -> tuple[int, Design]:
    """Return the index of the design to take, and the design: the first whose test forces can be hung."""
    if pick is not None:
        if not 1 <= pick <= len(front):
            raise CommandError(key="--pick", value=pick, allowed=f"a row of the front, from 1 to {len(front)}")
        return pick - 1, front[pick - 1]
    return _first_hung(front, front.ranked(prefer))


def _first_hung(front: Front | PracticalFront, ranked: Sequence[int]) -> tuple[int, Design]:
    """Return the first design, with its index, whose test forces can be hung."""
    problems = []
    for index in ranked[:_TRIED]:
        try:
            return index, front[index]
        except scaling.DesignError as problem:
            problems.append(problem)
    raise problems[0]


def _practical(front: Front, objective: Objective | None, *, parts_too: bool) -> PracticalFront | None:
    """Return the designs by what a workshop asks; None where they are not asked for, or there are none."""
    if objective is None and not parts_too:
        return None
    try:
        return practical_front(front)
    except scaling.DesignError:
        if objective is None:
            return None
        raise


def _best(practical: PracticalFront | None, objective: Objective) -> tuple[int, Design]:
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


def _write(  # noqa: PLR0917
    out: Path,
    files: Sequence[str],
    front: Front,
    design: Design,
    free: Front | None,
    supplement: plan.Supplement | None,
    pack: workshop.Pack | None,
) -> None:
    """Write all files to a temporary place, and move them when all are written."""
    with write_errors(out, CommandError), atomic_files(out) as new:
        (new / files[0]).write_text(to_file(design.scaled_up, comment=_HEADING.format(design.real_size.name)), "utf-8")
        plan.write(design, new, supplement)
        if pack is not None:
            pack.write(new)
        write_front(front, free or front, design.objectives, new)


def _print_front(front: Front, chosen: int | None, design: Design, free: Front | None) -> None:
    print_designs(front, _representatives(front, chosen), chosen, partial(built_usually, front))
    say(
        "As designed: largest similarity error over the working range. As built: what 95 % keep with usual tolerances, "
        "without friction. Resolution: least force on the real instrument. Margin: breaking load over the largest "
        "tension."
    )
    factors = design.comparison.factors
    say(
        f"{'Another design' if chosen is None else f'Row {chosen + 1}'} is taken: {design.scaled_up.name}, length "
        f"x {factors['length']:.4g}, force x "
        f"{factors['force']:.4g}, tension x {factors['tension']:.4g}; pretension {design.scaled_up.pretension:.4g} N."
    )
    for sentence in _strained(design):
        say(sentence)
    if free is not None:
        say(f"Without the pins, {scaling.rivals_text(free, design.objectives)}")


def _strained(design: Design) -> Iterator[str]:
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


def _print_written(out: Path, pack: workshop.Pack | None, *, pins: bool) -> None:
    picture = "a picture of the front without pins" if pins else "its picture"
    names = ("scaled-up.toml", "plan.html", "plan.pdf", "front.csv")
    say(f"{', '.join(str(out / name) for name in names)} and {picture} are written.")
    print_pack(out, pack)


def _print_objectives(practical: PracticalFront, taken: Objective | None) -> None:
    title = "similar to 0.3°, by what a workshop asks"
    found = table(title, "", ">cost", ">length", ">weeks", ">as designed", ">as built", "made of")
    for objective in PRACTICAL_OBJECTIVES:
        index = practical.best(objective)
        one = practical.practical[index]
        row = (
            f"{one.cost:.3g}", f"{1e3 * one.overall_length:.4g} mm", str(int(one.waiting + 1e-9)),
            error_text(practical.exact[index].similarity_error), f"{one.as_built:.2g}°",
            escape(practical.described(index)),
        )  # fmt: skip
        found.add_row(objective, *row, style="bold" if objective == taken else None)
    console.print(found)
    say(
        "Cost: of parts, 1 is one turned to general tolerances. Weeks: kinds of wheels and ropes that take weeks "
        "to get. "
        "As built: what 95 % keep with usual tolerances, without friction."
    )


def _print_built(pack: workshop.Pack, usually: float) -> None:
    say(f"As built with usual tolerances {usually:.2g}°, without friction, as in the tables.")
    print_built(pack.budget)


def _representatives(front: Front, chosen: int | None) -> list[int]:
    """Return a few designs of the front: the best by every preference, the chosen design, and some between."""
    best = {front.best(prefer) for prefer in PREFERENCES} | (set() if chosen is None else {chosen})
    step = max(len(front) // max(_SHOWN - len(best), 1), 1)
    return sorted(best | set(list(range(0, len(front), step))[: max(_SHOWN - len(best), 0)]))

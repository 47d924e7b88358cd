"""The command that finds a model's parameters in recordings."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
import typer
from rich.markup import escape

from tenodesis.cli.command import Answer, command
from tenodesis.cli.common import ProgressBar, check_choice, console, load_instrument, note, quantity, say, table, warn
from tenodesis.cli.outputs import JSON, Outputs, check_suffix, write_text
from tenodesis.errors import CommandError, IdentificationError
from tenodesis.identification import mistakes, report
from tenodesis.identification.comparison import (
    LEAST_EXCESS,
    ArrangementComparison,
    Fitted,
    compare_arrangements,
    excess,
)
from tenodesis.identification.fit import LEAST_REPLICATES, STARTS, fit
from tenodesis.identification.formats import MeasuredRun, load_all
from tenodesis.identification.formats.instrument_run import InstrumentRun, columns_of, first_axis
from tenodesis.identification.kinematic.model import chosen_laws, is_kinematic, joints_of
from tenodesis.identification.problem import Problem
from tenodesis.identification.registry import FORMATS, Format
from tenodesis.identification.report import axis_label
from tenodesis.identification.results import Fit, to_json, unexplained, worse_held_out
from tenodesis.identification.routing import RoutingRun
from tenodesis.identification.split import LEAST_LENGTH, LEAST_SHARE, LONGEST, FittedPart, shortened, split
from tenodesis.identification.uncertainty import LossName
from tenodesis.instrument import ShortForm, parse
from tenodesis.recording.blocks import first_run
from tenodesis.recording.metadata import DYNAMIC, QUASI_STATIC
from tenodesis.report.page import json_text
from tenodesis.units import Duration

_HELD = {"sheath_bend": "sheath bend", "wrist_pitch": "pitch"}
"""Angles that are held through a recording, by column."""
_WIDE = 2
"""Columns of errors up to which their headings have one line."""
_TEXTS = (".txt", ".csv")
_JOINTS, _TENDONS = "joints", "tendons"
_OF_INSTRUMENTS = ("recording", "csv", "mcap")
"""Formats whose recordings may lack the tensions."""
_SHARED = "Tendons turn several joints: all of them are fitted together (--format tendons)."
_SEVERAL = "The instrument has two axes: both are fitted together (--format tendons)."
_APART = "The twin moved each axis by itself: the first is fitted alone (--format tendons fits both as one chain)."
_LONGEST = f"{LONGEST:g} s"
ArrangementChoice: TypeAlias = Literal["auto", "compare", "file"]


@command("logs", "test", "instrument_file", json="Print parameters, intervals and errors as JSON.")
def identify(  # noqa: PLR0917
    outputs: Outputs,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG…", help="Recordings to fit, or folders of text files.")],
    format_name: Annotated[str, typer.Option("--format", help=f"{', '.join(FORMATS)}.")] = "recording",
    test: Annotated[list[Path] | None, typer.Option(metavar="FILE", help="Recording held out; repeatable.")] = None,
    train_until: Annotated[
        float | None, typer.Option(metavar="SHARE", help="Fit this share of each LOG's duration, hold out the rest.")
    ] = None,
    train_from: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Fit each LOG from this share of its duration on, hold out the rest."),
    ] = None,
    parameters: Annotated[
        str | None,
        typer.Option("--fit", metavar="NAMES", help="Parameters or groups: friction,stiffness. Default: all."),
    ] = None,
    instrument_file: Annotated[
        str | None, typer.Option("--instrument", metavar="INSTRUMENT", help="Initial values: file or shipped name.")
    ] = None,
    law: Annotated[
        str | None, typer.Option(help="Friction law; the choice depends on the format. Default: the format's.")
    ] = None,
    arrangement: Annotated[
        ArrangementChoice,
        typer.Option(
            help="Compare arrangements of contacts: if the file's own leaves more than noise, always, or never (file)."
        ),
    ] = "auto",
    json_file: Annotated[
        Path | None, typer.Option("--json-out", help="Write what --json prints here as well.", hidden=True)
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for report.html, result.json and instrument.toml.")] = Path(
        "out/identification"
    ),
    longest: Annotated[
        str,
        typer.Option(help="Of a longer LOG of an instrument, this long a stretch is fitted: that which says the most."),
    ] = _LONGEST,
    starts: Annotated[
        int | None,
        typer.Option(
            help=f"Starts of the search, the first from the file's or the model's values. Default: {STARTS}, or 1 "
            "where a LOG is too long to fit as a whole.",
            min=1,
        ),
    ] = None,
    bootstrap: Annotated[
        int, typer.Option(help=f"Replicates of a block bootstrap, at least {LEAST_REPLICATES}; 0 for none.", min=0)
    ] = 0,
    seed: Annotated[int, typer.Option(help="Seed of starts and bootstrap.", min=0)] = 0,
    loss: Annotated[
        LossName | None, typer.Option(help="Loss; soft_l1 is robust to outliers. Default: the format's.")
    ] = None,
) -> Answer:
    """Identify a model from recordings: parameters with intervals, errors on held-out runs, and the instrument file."""
    tests = test or []
    check_files(logs, tests)
    with outputs.folder(out, (report.PAGE, report.NUMBERS, report.INSTRUMENT), json_out=json_file):
        check_suffix("--json-out", json_file, JSON)
        check_choice("--format", format_name, FORMATS)
        if 0 < bootstrap < LEAST_REPLICATES:
            raise CommandError(
                key="--bootstrap", value=bootstrap, allowed=f"0 for none, or at least {LEAST_REPLICATES}"
            )
        share, part = _split(train_until, train_from)
        seconds = _longest(longest, is_split=share is not None)
        files = recordings_of(logs, tests, format_name)
        _check_given(format_name, arrangement, instrument_file)
        format_name, measured = _loaded(format_name, [*files, *tests])
        kind = FORMATS[format_name]
        if law is not None:
            check_choice("--law", law, kind.laws)
        inst = _starting_from(instrument_file, format_name)
        chosen = law or kind.law
        _check_different(measured)
        count = len(files)
        measured, tries = _stretches(measured, count, chosen, inst, parameters, seconds, starts)

        def problem_of(inst: ShortForm | None) -> Problem:
            def build(train: Sequence[MeasuredRun], held_out: Sequence[MeasuredRun]) -> Problem:
                return kind.problem(train, held_out, law=chosen, instrument=inst)

            if share is None:
                return build(measured[:count], measured[count:])
            return split(measured[:count], measured[count:], share, part, build)

        def fitted(
            problem: Problem, unknowns: Sequence[str] = (), *, screening: bool = False, refine: bool = True
        ) -> Fit:
            names = None if parameters is None else [*chosen_parameters(problem, parameters), *unknowns]
            with ProgressBar("searches") as bar:
                return fit(
                    problem,
                    names,
                    train=range(count),
                    test=range(count, len(problem.runs)),
                    starts=1 if screening else tries,
                    bootstrap=0 if screening else bootstrap,
                    refine=refine,
                    seed=seed,
                    loss=loss or kind.loss,
                    progress=bar,
                )

        explain = partial(_explained, measured[:count], kind, chosen, inst, parameters)
        problem = mistakes.answered(partial(problem_of, inst), explain)
        found = mistakes.answered(partial(fitted, problem), explain)
        explained = explain() if mistakes.unexplained_excess(problem, found, range(count)) else None
        compared = None
        if _asks_for_arrangements(arrangement, problem, found, range(count), explained):
            compared, problem, found = _arranged(
                kind, measured, Fitted(problem, found), problem_of, fitted, law=chosen, inst=inst, train=range(count)
            )
        found, ratio = _judged(problem, found, range(count), explained, _unknown_joints(instrument_file, measured))
        extrapolated = {one.name: _extrapolated(one, measured[:count]) for one in measured[count:]}
        notes = {one.name: (*one.notes, *extrapolated.get(one.name, ())) for one in measured}
        rows = [] if compared is None else compared.to_json()
        written = report.write(
            problem,
            found,
            out,
            runs=range(len(problem.runs)),
            format=format_name,
            law=chosen,
            notes=notes,
            arrangements=rows,
        )
        numbers = to_json(found, format=format_name, law=chosen, notes=notes, arrangements=rows)
        if json_file is not None:
            write_text(json_file, json_text(numbers))
            written = [*written, json_file]

    words = [word.strip() for word in (parameters or "").split(",")]
    groups = {word: problem.groups[word] for word in words if len(problem.groups.get(word, ())) > 1}

    def show() -> None:
        _print_arrangements(compared, asked=arrangement == "compare")
        for word, names in groups.items():
            note(f"{word}: {', '.join(names)}.")
        _print_fit(found, written, notes)

    return Answer(lambda: numbers, show, 1 if ratio else 0)


def _loaded(format_name: str, files: Sequence[Path]) -> tuple[str, list[MeasuredRun]]:
    """Return recordings and their format: that of joints where an instrument's recording holds no tensions."""
    together = _together(files[0]) if format_name in _OF_INSTRUMENTS else None
    if together == _APART:
        note(_APART)
    elif together is not None and (found := _of_tendons(files, together)):
        return _TENDONS, found
    try:
        found = _read_as(format_name, files)
    except IdentificationError as lacking:
        if format_name in _OF_INSTRUMENTS and lacking.key == "joint":
            note(_SHARED)
            return _TENDONS, _read_as(_TENDONS, files)
        if format_name not in _OF_INSTRUMENTS or "tension" not in str(lacking.value):
            raise
        try:
            found = _read_as(_JOINTS, files)
        except IdentificationError as problem:
            # a table that names neither tensions nor joints is told what it lacks first
            raise (lacking if problem.key == "columns" and not problem.value else problem) from None
        note("Without both tensions coupling, play and offset of the joints are identified (--format joints).")
        return _JOINTS, found
    if (
        together is None
        and any(isinstance(run, InstrumentRun) and run.others for run in found)
        and (tendons := _of_tendons(files, _SEVERAL))
    ):
        return _TENDONS, tendons
    return format_name, found


def _of_tendons(files: Sequence[Path], why: str) -> list[MeasuredRun]:
    """Return recordings of all tendons, and say why these are fitted; none where they cannot be."""
    with suppress(IdentificationError):
        found = _read_as(_TENDONS, files)
        note(why)
        return found
    return []


def _together(path: Path) -> str | None:
    """Return why all tendons of a recording are fitted together, or not, by its first rows; None if nothing says so."""
    found = first_run(path)
    if found is None:
        return None
    run, metadata = found
    try:
        columns_of(first_axis(run), str(path), [])
    except IdentificationError as problem:
        return _SHARED if problem.key == "joint" else None
    if not run.axes[1:]:
        return None
    twin = metadata.get("mode") in (DYNAMIC, QUASI_STATIC) and "instrument" in metadata
    return _APART if twin and parse(metadata["instrument"], str(path)).short_form is not None else _SEVERAL


def _read_as(format_name: str, files: Sequence[Path]) -> list[MeasuredRun]:
    kind = FORMATS[format_name]
    with ProgressBar("reading", None) as bar:
        return load_all(partial(kind.load, progress=bar) if kind.shows_progress else kind.load, files)


def _starting_from(name: str | None, format_name: str) -> Any:
    """Return the instrument that a search starts from; recordings of joints only name those of theirs."""
    if name is None or format_name == _JOINTS:
        return None
    return load_instrument(name) if format_name == _TENDONS else load_instrument(name, planar=True)


def _unknown_joints(name: str | None, measured: Sequence[MeasuredRun]) -> tuple[str, ...]:
    """Return which joints of a recording an instrument does not have."""
    inst = None if name is None else load_instrument(name)
    if inst is None or not is_kinematic(measured[0]):
        return ()
    known = [joint.name for joint in inst.tip_joints] + ["yaw", "jaw"] * (inst.grip is not None)
    unknown = [one for one in joints_of(measured) if one not in known]
    return (f"{inst.name} has no joint {', '.join(unknown)}; it has {', '.join(known)}.",) if unknown else ()


def _explained(
    runs: Sequence[MeasuredRun], kind: Format, law: str, inst: ShortForm | None, parameters: str | None
) -> mistakes.Explanation | None:
    """Return the mistake that explains recordings of an instrument, None if none does or there is no instrument."""
    known = inst is not None or any(isinstance(run, InstrumentRun) and run.instrument is not None for run in runs)
    if not known or kind.arrangements is None:
        return None

    def build(changed: Sequence[MeasuredRun], other: ShortForm | None) -> Problem:
        return kind.problem(changed, [], law=law, instrument=other or inst)

    def free(problem: Problem) -> list[str]:
        return (
            [one.name for one in problem.parameters] if parameters is None else chosen_parameters(problem, parameters)
        )

    with ProgressBar("likely mistakes") as bar:
        return mistakes.explain(runs, build, free, instruments=mistakes.shipped_planar(), progress=bar)


def _asks_for_arrangements(
    arrangement: str, problem: Problem, found: Fit, train: Sequence[int], explained: mistakes.Explanation | None
) -> bool:
    """Return whether other arrangements are to be fitted; a mistake in the recordings makes all of them wrong."""
    return arrangement == "compare" or (
        arrangement == "auto" and explained is None and excess(problem, found, train) > LEAST_EXCESS
    )


def _judged(
    problem: Problem,
    found: Fit,
    train: Sequence[int],
    explained: mistakes.Explanation | None,
    unknown: Sequence[str],
) -> tuple[Fit, float]:
    """Return a fit with what is said against it, and how many times the noise it leaves, 0 if explained."""
    ratio = mistakes.unexplained_excess(problem, found, train)
    found = mistakes.contradicted(found, ratio, explained) if ratio else found
    held_out = [one for one in found.files if one.split == "test"]
    said = (
        *unexplained(problem, found.vector, held_out),
        *worse_held_out(found.files),
        *chosen_laws(problem),
        *unknown,
    )
    return replace(found, warnings=(*found.warnings, *said)), ratio


def _stretches(  # noqa: PLR0917
    measured: Sequence[MeasuredRun],
    count: int,
    law: str,
    inst: ShortForm | None,
    parameters: str | None,
    seconds: float,
    starts: int | None,
) -> tuple[list[MeasuredRun], int]:
    """Return recordings, of long ones to be fitted the stretch that says the most, and how many starts to try."""
    free = None if parameters is None else (lambda problem: chosen_parameters(problem, parameters))
    with ProgressBar("stretches") as bar:
        train = [
            shortened(one, law=law, instrument=inst, free=free, longest=seconds, progress=bar)
            for one in measured[:count]
        ]
    if isinstance(measured[0], RoutingRun):
        return [*train, *measured[count:]], starts or 1
    cut = any(one is not whole for one, whole in zip(train, measured, strict=False))
    if cut and starts is None:
        note(
            f"Of a long recording one start is tried, the file's or the model's values; --starts {STARTS} tries others."
        )
    # a model of joints has searched from several starts of its own
    return [*train, *measured[count:]], starts or (1 if cut or is_kinematic(measured[0]) else STARTS)


def _arranged(
    kind: Format,
    measured: Sequence[MeasuredRun],
    own: Fitted,
    problem_of: Callable[[ShortForm | None], Problem],
    fitted: Callable[..., Fit],
    *,
    law: str,
    inst: ShortForm | None,
    train: Sequence[int],
) -> tuple[ArrangementComparison | None, Problem, Fit]:
    """Return the comparison of a format's arrangements, and problem and fit of the one that recordings ask for."""
    if kind.arrangements is None:
        return None, *own
    options = kind.arrangements(measured, law=law, instrument=inst, fitted=own.fit.free)
    if len(options) < 2:
        return None, *own
    known = {(options[0].name, True): own}

    def fitted_as(name: str, carefully: bool) -> Fitted:
        if (name, carefully) not in known:
            one = next(option for option in options if option.name == name)
            problem = problem_of(one.instrument)
            found = fitted(problem, one.unknowns, screening=True, refine=carefully)
            known[name, carefully] = Fitted(problem, found)
        return known[name, carefully]

    names = [option.name for option in options]
    compared = compare_arrangements(names[0], names[1:], fitted_as, train=train)
    if compared.chosen != compared.own:
        one = next(option for option in options if option.name == compared.chosen)
        problem = problem_of(one.instrument)
        known[one.name, True] = Fitted(problem, fitted(problem, one.unknowns))
        compared = compare_arrangements(names[0], names[1:], fitted_as, train=train)
    return compared, fitted_as(compared.chosen, True).problem, compared.result


def chosen_parameters(problem: Problem, text: str) -> list[str]:
    """Return the parameters that names of parameters, groups, or words within the names stand for.

    Raises
    ------
    CommandError
        A name stands for none.
    """
    names = [one.name for one in problem.parameters]
    groups = problem.groups
    found: list[str] = []
    for word in (part.strip() for part in text.split(",")):
        if word in names:
            meant = [word]
        elif word in groups:
            meant = list(groups[word])
        else:
            meant = [name for name in names if word and word in name.replace(".", "_").split("_")]
        if not meant:
            allowed = ", ".join([*names, *(f"{group} (group)" for group in groups)])
            raise CommandError(key="--fit", value=word, allowed=f"one of {allowed}")
        found += meant
    return list(dict.fromkeys(found))


def _split(until: float | None, from_: float | None) -> tuple[float | None, FittedPart]:
    """Return the share at which recordings are split, None where they are not, and which part is fitted."""
    if until is not None and from_ is not None:
        raise CommandError(
            "--train-until and --train-from are both given; give one of them.",
            key="--train-until",
            value=until,
            allowed="given without --train-from",
        )
    share = until if from_ is None else from_
    if share is not None and not LEAST_SHARE <= share <= 1 - LEAST_SHARE:
        option = "--train-until" if from_ is None else "--train-from"
        allowed = f"between {LEAST_SHARE:g} and {1 - LEAST_SHARE:g}"
        raise CommandError(key=option, value=share, allowed=allowed)
    return share, "until" if from_ is None else "from"


def _longest(given: str, *, is_split: bool) -> float:
    """Return the duration up to which a recording is fitted as a whole, s; one that is split is, up to its split."""
    seconds: float = quantity("--longest", given, Duration)
    allowed = ""
    if is_split and given != _LONGEST:
        allowed = "left out with --train-until and --train-from, which divide the whole recording"
    elif seconds < LEAST_LENGTH:
        allowed = f"at least {LEAST_LENGTH:g} s"
    if allowed:
        raise CommandError(key="--longest", value=given, allowed=allowed)
    return np.inf if is_split else seconds


def recordings_of(logs: Sequence[Path], tests: Sequence[Path], format_name: str) -> list[Path]:
    """Return the recordings, with the text files of each folder that are not held out in its place."""
    held_out = {path.resolve() for path in tests}
    files: list[Path] = []
    for path in logs:
        # A folder of a bag is one recording.
        if not path.is_dir() or format_name == "mcap" or (format_name == "recording" and not _has_texts(path)):
            files.append(path)
            continue
        texts = sorted(one for one in path.iterdir() if one.suffix.lower() in _TEXTS)
        if not texts:
            needed = f"a recording, or a folder with files that end in {' or '.join(_TEXTS)}"
            raise CommandError(key="LOG", value=str(path), allowed=needed)
        files += [one for one in texts if one.resolve() not in held_out]
    return files


def _has_texts(folder: Path) -> bool:
    return any(one.suffix.lower() in _TEXTS for one in folder.iterdir())


def check_files(logs: Sequence[Path], tests: Sequence[Path]) -> None:
    """Refuse recordings that do not exist or are given twice; raises CommandError."""
    seen: dict[Path, str] = {}
    for what, paths in (("LOG", logs), ("--test", tests)):
        for path in paths:
            if not path.exists():
                raise CommandError(
                    f"{what} is {str(path)!r}; it must be the path of a recording, and there is no such file.",
                    key=what,
                    value=str(path),
                    allowed="the path of a recording",
                )
            place = path.resolve()
            if place in seen:
                raise CommandError(key=what, value=str(path), allowed=f"given once, not as {seen[place]} too")
            seen[place] = what


def _check_different(measured: Sequence[MeasuredRun]) -> None:
    """Refuse a copy under another name: held out it would say nothing, and fitted it would count twice."""
    for one, other in combinations(measured, 2):
        same_bytes = bool(one.checksum) and one.checksum == other.checksum
        same_columns = one.columns.keys() == other.columns.keys() and np.array_equal(one.time, other.time)
        if same_bytes or (same_columns and all(np.array_equal(one[name], other[name]) for name in one.columns)):
            raise CommandError(
                f"{one.name} and {other.name} hold the same samples; give a recording once.",
                key="LOG",
                value=other.name,
                allowed="given once",
            )


def _extrapolated(one: MeasuredRun, trained: Sequence[MeasuredRun]) -> tuple[str, ...]:
    """Return a note where a held-out recording has a sheath bend or pitch beyond those of the fitted recordings."""
    column = next((name for name in _HELD if name in one.columns), None)
    if column is None:
        return ()
    angle, angles = (float(np.degrees(one[column][0])), [float(np.degrees(other[column][0])) for other in trained])
    if min(angles) <= angle <= max(angles):
        return ()
    fitted = f"{min(angles):.4g}" if min(angles) == max(angles) else f"{min(angles):.4g} to {max(angles):.4g}"
    return (f"held out at a {_HELD[column]} of {angle:.4g} deg, fitted at {fitted} deg: extrapolation",)


def _print_arrangements(compared: ArrangementComparison | None, *, asked: bool) -> None:
    if compared is None:
        if asked:
            warn("these recordings and this instrument leave one arrangement of contacts; none was compared.")
        return
    rows = compared.to_json()
    held_out = [key for key in rows[0] if key.startswith("test_rmse")]
    shown = held_out or [key for key in rows[0] if key.startswith("train_rmse")]
    title = f"arrangements: residuals over noise, rmse {'held out' if held_out else 'fitted'}"
    signals = (f">{key.rpartition('_')[2]}" for key in shown)
    listed = table(title, "arrangement", ">fitted", ">criterion", ">over\nnoise", *signals)
    for row in rows:
        mark = " (file)" if row["own"] else ""
        values = (f"{row['bic']:.4g}", f"{row['excess']:.3g}", *(f"{row[key]:.3g}" for key in shown))
        listed.add_row(row["arrangement"] + mark, str(row["parameters"]), *values)
    console.print(listed)


def _print_fit(found: Fit, written: Sequence[Path], notes: dict[str, tuple[str, ...]]) -> None:
    for names, sentence in report.grouped(notes):
        say(f"{names}: {sentence}.")
    _print_parameters(found)
    keys = list(dict.fromkeys(key for one in found.files for key in one.rmse))
    labels = [axis_label(key) if len(keys) <= _WIDE else axis_label(key).replace(" ", "\n", 1) for key in keys]
    errors = table("rmse, measured minus model", "run", "use", *(f">{label}" for label in labels))
    for run in found.files:
        values = (f"{run.rmse[key]:.4g}" if key in run.rmse else "" for key in keys)
        errors.add_row(escape(run.name), "fitted" if run.split == "train" else "held out", *values)
    for name, rmse in (("fitted", found.train_rmse), ("held out", found.test_rmse)):
        if rmse:
            errors.add_row("all", name, *(f"{rmse[key]:.4g}" if key in rmse else "" for key in keys))
    console.print(errors)
    for sentence in (*found.identifiability.statements, *found.warnings):
        say(sentence)
    say(
        f"{found.same_optimum} of {found.starts} starts came to this optimum; {found.evaluations} evaluations in "
        f"{found.seconds:.3g} s."
    )
    say(f"Written: {', '.join(str(path) for path in written)}")


def _check_given(format_name: str, arrangement: str, instrument_file: str | None) -> None:
    """Refuse what is wrong whatever the recordings hold."""
    _check_arrangement(FORMATS[format_name], format_name, arrangement)
    if instrument_file is not None:
        load_instrument(instrument_file)


def _check_arrangement(kind: Format, format_name: str, arrangement: str) -> None:
    if arrangement == "compare" and kind.arrangements is None:
        allowed = f"auto or file with the format {format_name}, which has one arrangement"
        raise CommandError(key="--arrangement", value=arrangement, allowed=allowed)


def _print_parameters(found: Fit) -> None:
    heading = ">95 % interval" + (", bootstrap" if found.bootstrap else "")
    shown = [(one.name, report.shown(found, one)) for one in found.parameters if one.name in found.free]
    rows = [
        (name, row.value, row.unit, row.bootstrap if found.bootstrap else row.interval, row.identifiable)
        for name, row in shown
    ]
    # on 80 columns no name is broken
    console.print(table("parameters", "parameter", ">value", "unit", heading, "identi-\nfiable", rows=rows))
    held = [one.name for one in found.parameters if one.name not in found.free]
    if held:
        say(f"Held: {', '.join(held)}.")

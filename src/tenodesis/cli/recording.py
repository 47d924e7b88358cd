"""The commands about recordings: make one, look at it, run it again, export it."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, cast, get_args

import typer
from pydantic import TypeAdapter, ValidationError
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from tenodesis import instrument, simulate
from tenodesis import twin as twins
from tenodesis.control import Controller
from tenodesis.control.controller import ActuationName, LawName, ObserverName
from tenodesis.errors import CommandError
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml
from tenodesis.live import account
from tenodesis.recording import Recorder, Recording, choices, tables
from tenodesis.recording.outcome import outcome
from tenodesis.recording.replay import Replay
from tenodesis.recording.replay import replay as run_again
from tenodesis.recording.simulation import record as record_run
from tenodesis.recording.summary import describe
from tenodesis.run import Run
from tenodesis.units import Duration, in_unit

console = Console()
exports = typer.Typer(help="Write what other programs read.", no_args_is_help=True)

_PATIENCE = 1.0
"""Time after which a progress bar is shown, s."""


def _allowed(choices: object) -> str:
    return ", ".join(get_args(choices))


def register(app: typer.Typer) -> None:
    """Add the commands about recordings to an app."""
    for command in (record, info, replay):
        app.command()(command)
    app.add_typer(exports, name="export")


def record(  # noqa: PLR0917
    protocol_file: Annotated[
        str, typer.Argument(metavar="PROTOCOL", help="Protocol file, or the name of one that is shipped.")
    ],
    instrument_file: Annotated[
        str, typer.Argument(metavar="INSTRUMENT", help="Instrument file, or the name of one that is shipped.")
    ] = "scaled-up",
    out: Annotated[
        Path | None,
        typer.Option(help="The file. Default: recordings/PROTOCOL-INSTRUMENT[-LAW].mcap.", show_default=False),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.")] = 0,
    time_step: Annotated[str, typer.Option(help="Time step, with its unit.")] = f"{twins.TIME_STEP * 1e3:g} ms",
    quasi_static: Annotated[bool, typer.Option("--quasi-static", help="Leave inertia and damping out.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a file that exists.")] = False,
    axis: Annotated[str | None, typer.Option(help="Axis to run alone. Default: all.", show_default=False)] = None,
    law: Annotated[
        str | None,
        typer.Option(
            help=f"What the motors do, with a controller in the loop: {_allowed(LawName)}. Default: no controller.",
            show_default=False,
        ),
    ] = None,
    observer: Annotated[
        str | None,
        typer.Option(
            help=f"What tells the controller where the tip is: {_allowed(ObserverName)}. Default: friction.",
            show_default=False,
        ),
    ] = None,
    actuation: Annotated[
        str | None,
        typer.Option(help=f"Which motors act: {_allowed(ActuationName)}. Default: differential.", show_default=False),
    ] = None,
    controller_instrument: Annotated[
        str | None,
        typer.Option(
            metavar="INSTRUMENT",
            help="What the controller takes the instrument for: file or name. Default: INSTRUMENT.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Run a protocol on the twin of an instrument and record it, with --law under a controller.

    A protocol that begins with a pretension phase finds slack tendons, which a controller homes.
    """
    inst = instrument.load(instrument_file)
    told = inst if controller_instrument is None else instrument.load(controller_instrument)
    if axis is not None:
        inst, told = inst.axis(axis), told.axis(axis)
    protocol = simulate.load(protocol_file)
    step = _duration("--time-step", time_step)
    with _values_reported():
        protocol.plan(inst, step)
        controller = _controller(
            told, inst, protocol, step, law=law, observer=observer, actuation=actuation, other=controller_instrument
        )
    path = _default_path(protocol_file, instrument_file, law) if out is None else out
    _refuse_existing(path, overwrite)
    with _values_reported(), _progress(path) as progress:
        run = record_run(
            inst,
            protocol,
            path,
            controller=controller,
            time_step=step,
            seed=seed,
            quasi_static=quasi_static,
            overwrite=overwrite,
            progress=progress,
        )
    _say(f"{path}: {protocol.name} on {inst.name}, {run.time[-1]:.6g} s, {len(run)} rows, {_size(path)}.")
    _tell_outcome(run, inst)


def info(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recordings.")],
) -> None:
    """Print what recordings hold: what made them, their topics, their signals' ranges, and what happened besides."""
    for file in files:
        recording = Recording.open(file)
        if files[1:]:
            console.rule(escape(str(file)))
        console.print(describe(recording))
        events = account.describe(recording)
        if events is not None:
            console.print(events)


def replay(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording.")],
    instrument_file: Annotated[
        str | None,
        typer.Option("--instrument", metavar="INSTRUMENT", help="Instrument file or shipped name. Default: recorded."),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Recording to write the replay to.", show_default=False)] = None,
    plot: Annotated[Path | None, typer.Option(help="Figure to draw: PNG, SVG or PDF.", show_default=False)] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace a recording that exists.")] = False,
) -> None:
    """Run a recording's commands again and print how the twin differs from the recording."""
    if out is not None:
        _refuse_existing(out, overwrite)
    recording = Recording.open(file)
    inst = None if instrument_file is None else instrument.load(instrument_file)
    with _values_reported():
        again = run_again(recording, inst)
    if recording.damage is not None:
        _say(recording.damage)
    _tell(again)
    if not again.exact:
        _tell_outcome(again.run, again.inst)
    if out is not None:
        metadata = {
            **recording.metadata,
            **choices.carried(recording, again.inst),
            "instrument": to_toml(again.inst),
            "replay_of": str(file),
        }
        with Recorder(out, axes=again.run.axes, metadata=metadata, overwrite=overwrite) as recorder:
            recorder.write(again.run)
        _say(f"{out}: the replay, {again.run.time[-1]:.6g} s, {len(again.run)} rows, {_size(out)}.")
    if plot is not None:
        from tenodesis.report.replay import plot as draw  # noqa: PLC0415

        draw(again, plot)
        _say(f"{plot}: recorded and replayed output angles and tensions.")


@exports.callback()
def _exports() -> None:
    """Keep commands by name even while there is one."""


@exports.command("recording")
def export_recording(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording.")],
    to: Annotated[Path, typer.Option(help="Table to write: .csv or .parquet.")],
) -> None:
    """Write a recording's signals as a table, with a column for each signal of each axis or tendon, in SI units."""
    writers = {".csv": tables.to_csv, ".parquet": tables.to_parquet}
    if to.suffix not in writers:
        raise CommandError(f"{to} has the extension {to.suffix!r}; allowed are {', '.join(writers)}.")
    recording = Recording.open(file)
    writers[to.suffix](recording.run, to)
    if recording.damage is not None:
        _say(recording.damage)
    _say(f"{to}: {len(recording.run)} rows, {_size(to)}.")


def _controller(
    told: Instrument,
    inst: Instrument,
    protocol: simulate.Protocol,
    time_step: float,
    *,
    law: str | None,
    observer: str | None,
    actuation: str | None,
    other: str | None,
) -> Controller | None:
    """Return the controller that is asked for, ticking as the twin samples, homed unless it finds slack tendons."""
    if law is None:
        given = {"--observer": observer, "--actuation": actuation, "--controller-instrument": other}
        for option, text in given.items():
            if text is not None:
                raise CommandError(
                    f"{option} is {text!r}, but there is no controller without --law; allowed are {_allowed(LawName)}."
                )
        return None
    controller = Controller(
        told,
        cast(ObserverName, "friction" if observer is None else observer),
        cast(LawName, law),
        cast(ActuationName, "differential" if actuation is None else actuation),
        homed=not isinstance(protocol.phases[0], simulate.Pretension),
        period=max(time_step, 1 / inst.sensors.sampling_rate),
    )
    controller.refuse_another(inst)
    return controller


def _tell_outcome(run: Run, inst: Instrument) -> None:
    """Print what came of a run if it had a controller."""
    for about, fact in outcome(run, inst).items():
        _say(f"{about}: {fact}.")


def _say(sentence: str) -> None:
    console.print(sentence, markup=False, highlight=False, soft_wrap=True)


def _size(path: Path) -> str:
    size = path.stat().st_size
    return f"{size / 1e6:.3g} MB" if size >= 1e6 else f"{size / 1e3:.3g} kB"


def _default_path(protocol_file: str, instrument_file: str, law: str | None) -> Path:
    folder = Path("recordings")
    try:
        folder.mkdir(exist_ok=True)
    except OSError as problem:
        raise CommandError(f"{folder} cannot be made: {problem.strerror}.") from None
    parts = (Path(protocol_file).stem, Path(instrument_file).stem, *(() if law is None else (law,)))
    return folder / f"{'-'.join(parts)}.mcap"


def _refuse_existing(path: Path, overwrite: bool) -> None:
    if path.exists() and not overwrite:
        raise CommandError(f"{path} exists already; allowed is another path, or --overwrite.")


def _duration(option: str, text: str) -> float:
    try:
        return TypeAdapter(Duration).validate_python(text, context={"file": True})
    except ValidationError as invalid:
        told = invalid.errors(include_url=False)[0]["msg"].removeprefix("Value error, ")
        raise CommandError(f"{option} = {text!r}: {told}.") from None


@contextmanager
def _values_reported() -> Iterator[None]:
    """Raise what a twin says about its arguments as an error of the command."""
    try:
        yield
    except ValueError as problem:
        raise CommandError(str(problem)) from problem


@contextmanager
def _progress(path: Path) -> Iterator["_Progress"]:
    """Show how far a run is if it takes long, and let Ctrl-C end it between two blocks."""
    shown = _Progress()
    before = signal.signal(signal.SIGINT, shown.interrupt)
    try:
        yield shown
    except KeyboardInterrupt:
        raise CommandError(f"interrupted; {_held(path)}.") from None
    except ValueError as problem:
        if not shown.called:
            raise
        raise CommandError(f"{str(problem).rstrip('.')}; {_held(path)}.") from problem
    finally:
        shown.stop()
        signal.signal(signal.SIGINT, before)


def _held(path: Path) -> str:
    """Say what a recording that was broken off holds."""
    run = Recording.open(path).run
    return f"{path} holds what was before, {run.time[-1] if len(run) else 0:.6g} s, {len(run)} rows"


class _Progress:
    """What a run is told to report to."""

    def __init__(self) -> None:
        columns = (TextColumn("{task.fields[done]} s of {task.fields[whole]} s"), BarColumn(), TimeElapsedColumn())
        self._bar = Progress(*columns, console=console, transient=True)
        self._task = self._bar.add_task("", total=None, done="", whole="")
        self._begun = time.monotonic()
        self._shown = self._interrupted = False
        self.called = False

    def interrupt(self, *_: object) -> None:
        self._interrupted = True

    def stop(self) -> None:
        if self._shown:
            self._bar.stop()

    def __call__(self, done: float, whole: float) -> None:
        self.called = True
        if self._interrupted:
            raise KeyboardInterrupt
        if not self._shown and console.is_interactive and time.monotonic() > self._begun + _PATIENCE:
            self._bar.start()
            self._shown = True
        self._bar.update(self._task, completed=done, total=whole, done=f"{done:.0f}", whole=f"{whole:.0f}")


def _tell(again: Replay) -> None:
    """Print whether a replay is the same to the last bit, or by how much it differs."""
    recording, rows = again.recording, len(again.run)
    if again.exact:
        _say(f"{recording.path}: replayed bit by bit on {again.inst.name}, {again.run.time[-1]:.6g} s, {rows} rows.")
        return
    title = f"{escape(str(recording.path))}: replay on {escape(again.inst.name)}, difference to the recording"
    table = Table("signal", title=title, title_justify="left", box=box.SIMPLE_HEAD)
    for heading in ("rms", "largest", "unit"):
        table.add_column(heading, justify="left" if heading == "unit" else "right")
    for name, difference in again.differences().items():
        unit = "deg" if difference.unit == "rad" else difference.unit
        factor = in_unit(unit, difference.unit)
        table.add_row(name, f"{difference.rms * factor:.3g}", f"{difference.largest * factor:.3g}", unit)
    console.print(table)

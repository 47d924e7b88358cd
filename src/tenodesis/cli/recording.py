"""The commands about recordings: record, describe, repeat, export."""

import signal
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, cast

import typer
from rich.markup import escape

from tenodesis import control, simulate
from tenodesis import twin as twins
from tenodesis.cli.command import Answer, command
from tenodesis.cli.common import (
    AnyLaw,
    InstrumentFile,
    ProgressBar,
    console,
    file_size,
    load_instrument,
    load_protocol,
    quantity,
    refuse_choices,
    say,
    table,
    warn_resolution,
)
from tenodesis.cli.outputs import FIGURE, RECORDING, TABLES, Outputs, output
from tenodesis.control import Controller, JointController
from tenodesis.control.controller import ActuationName, LawName, ObserverName
from tenodesis.errors import ArgumentError, CommandError, CommandInterruptedError, Error, ProtocolError
from tenodesis.files import write_errors
from tenodesis.instrument import Instrument, ShortForm, expanded
from tenodesis.live import event_summary
from tenodesis.recording import Blocks, simulation, summary, tables
from tenodesis.recording.replay import Replayed
from tenodesis.recording.replay import replay_file as run_again
from tenodesis.recording.summary import contents, describe
from tenodesis.run import Run
from tenodesis.units import Duration, in_unit


@command("instrument_file", "protocol_file", "controller_instrument")
def record(  # noqa: PLR0917
    outputs: Outputs,
    instrument_file: InstrumentFile,
    protocol_file: Annotated[
        str | None, typer.Argument(metavar="PROTOCOL", help="Protocol file, or the name of a shipped protocol.")
    ] = None,
    out: Annotated[
        Path | None, output(RECORDING, "The file. Default: recordings/PROTOCOL-INSTRUMENT[-LAW].mcap.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise.")] = 0,
    time_step: Annotated[str, typer.Option(help="Time step, with its unit.")] = f"{twins.TIME_STEP * 1e3:g} ms",
    quasi_static: Annotated[bool, typer.Option("--quasi-static", help="Omit inertia and damping.")] = False,
    axis: Annotated[str | None, typer.Option(help="Axis to run alone. Default: all.")] = None,
    law: Annotated[
        AnyLaw | None,
        typer.Option(
            help="Compensation law of a controller in the loop; joints: of all joints, whatever tendons turn them. "
            "Default: no controller."
        ),
    ] = None,
    observer: Annotated[
        ObserverName | None, typer.Option(help="Observer of the controller. Default: friction.")
    ] = None,
    actuation: Annotated[ActuationName | None, typer.Option(help="Motors that act. Default: differential.")] = None,
    controller_instrument: Annotated[
        str | None,
        typer.Option(
            metavar="INSTRUMENT", help="Instrument that the controller assumes: file or name. Default: INSTRUMENT."
        ),
    ] = None,
    every: Annotated[
        int, typer.Option(help="Of how many rows one is written; a file of fewer than all is not replayed.", min=1)
    ] = 1,
    home: Annotated[
        bool,
        typer.Option("--home", help="With --law joints: home first, which learns the tendons' stiffness and friction."),
    ] = False,
) -> None:
    """Run a protocol on the twin of an instrument and record it, with --law under a controller.

    A protocol that begins with a pretension phase finds slack tendons, which are tightened. By default every joint
    moves, the tip is loaded, and jaws grip.
    """
    inst, protocol = _inputs(instrument_file, protocol_file)
    other = inst if controller_instrument is None else load_instrument(controller_instrument)
    if axis is not None:
        inst, other = inst.axis(axis), other.axis(axis)
    step = quantity("--time-step", time_step, Duration)
    protocol.plan(inst, step)
    period = max(step, 1 / inst.sensors.sampling_rate)
    has_pairs = bool(control.pairs(other))
    controller: Controller | JointController | None = None
    assumed: ShortForm | None = None
    if law == "joints" or (law == "off" and not has_pairs):
        refuse_choices("the law of all joints has one of its own", {"--observer": observer, "--actuation": actuation})
        inst = expanded(inst)
        controller = JointController(other, law, period=period)
    else:
        if home:
            raise CommandError(
                "--home goes with --law joints; other laws home where a protocol begins with a pretension phase",
                key="--home",
            )
        # Without a law an instrument need not have a joint that one could serve.
        assumed = _assumed(other, law) if law is not None or has_pairs else None
        controller = _controller(
            assumed, protocol, period, law=law, observer=observer, actuation=actuation, other=controller_instrument
        )
    if controller is not None:
        controller.check_instrument(inst)
    path = _default_path(protocol_file or protocol.name, instrument_file, law) if out is None else out
    with outputs.files(out=path), _progress(path, every) as progress:
        if assumed is not None:
            warn_resolution(assumed)
        simulation.record(
            inst,
            protocol,
            path,
            controller=controller,
            time_step=step,
            seed=seed,
            quasi_static=quasi_static,
            every=every,
            home=home,
            overwrite=outputs.overwrite,
            progress=progress,
            each=progress.add,
        )
    say(f"{path}: {protocol.name} on {inst.name}, {progress.done}, {file_size(path)}.")
    _print_facts(_summary(path).seen.outcome)


@command(json="Print JSON: a list with one entry per recording.")
def info(files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recordings.")]) -> Answer:
    """Print the contents of recordings: origin, topics, ranges of the signals, and events."""

    def show() -> None:
        for file in files:
            found = _summary(file)
            if files[1:]:
                console.rule(escape(str(file)))
            console.print(describe(found))
            events = event_summary.describe(found)
            if events is not None:
                console.print(events)

    return Answer(lambda: [{"file": str(file), **contents(_summary(file))} for file in files], show)


@command("file", "instrument_file")
def replay(
    outputs: Outputs,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording.")],
    instrument_file: Annotated[
        str | None,
        typer.Option("--instrument", metavar="INSTRUMENT", help="Instrument file or shipped name. Default: recorded."),
    ] = None,
    out: Annotated[Path | None, output(RECORDING, "Recording to write the replay to.")] = None,
    plot_out: Annotated[Path | None, output(FIGURE, "Figure to draw: PNG, SVG or PDF.")] = None,
) -> None:
    """Run a recording's commands again and print how the twin differs from the recording."""
    with outputs.files(out=out, plot_out=plot_out):
        inst = None if instrument_file is None else load_instrument(instrument_file)
        with ProgressBar(f"replaying {file.name}", None) as bar:
            done = run_again(file, inst, out, overwrite=outputs.overwrite, progress=bar)
        again = done.replay
        if again.recording.damage is not None:
            say(again.recording.damage)
        _print_differences(done)
        if not again.exact:
            _print_facts(done.outcome)
        if out is not None:
            say(f"{out}: the replay, {done.time:.6g} s, {done.rows} rows, {file_size(out)}.")
        if plot_out is not None:
            from tenodesis.report.replay import plot as draw  # noqa: PLC0415

            draw(again, plot_out)
            say(f"{plot_out}: recorded and replayed output angles and tensions.")


@command("file")
def export_recording(
    outputs: Outputs,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording.")],
    out: Annotated[
        Path | None, output(TABLES, "Table to write: .csv or .parquet. Default: FILE's name with .csv.")
    ] = None,
) -> None:
    """Write a recording's signals as a table, with a column for each signal of each axis or tendon, in SI units."""
    path = Path(file.with_suffix(".csv").name) if out is None else out
    write = {".csv": tables.write_csv, ".parquet": tables.write_parquet}[path.suffix]
    with outputs.files(out=path):
        with ProgressBar(f"reading {file.name}", None) as bar:
            blocks = Blocks(file, progress=bar)
            rows = write(blocks, path)
        if blocks.damage is not None:
            say(blocks.damage)
        say(f"{path}: {rows} rows, {file_size(path)}.")


def _inputs(instrument_file: str, protocol_file: str | None) -> tuple[Instrument, simulate.Protocol]:
    """Return instrument and protocol; an error about their order has the right command."""
    if _is_protocol(instrument_file) and (protocol_file is None or not _is_protocol(protocol_file)):
        problem = "which needs an instrument" if protocol_file is None else "and the instrument comes first"
        raise CommandError(
            f"{instrument_file} is a protocol, {problem}: tenodesis record {protocol_file or 'scaled-up'} "
            f"{instrument_file}.",
            key="INSTRUMENT",
            value=instrument_file,
        )
    inst = load_instrument(instrument_file)
    return inst, simulate.default_protocol(inst) if protocol_file is None else load_protocol(protocol_file)


def _is_protocol(name_or_path: str) -> bool:
    try:
        simulate.load(name_or_path)
    except ProtocolError:
        return False
    return True


def _controller(
    assumed: ShortForm | None,
    protocol: simulate.Protocol,
    period: float,
    *,
    law: LawName | None,
    observer: ObserverName | None,
    actuation: ActuationName | None,
    other: str | None,
) -> Controller | None:
    """Return the controller of an assumed instrument, with a tick per sample; homed unless it finds slack tendons."""
    if law is None:
        given = {"--observer": observer, "--actuation": actuation, "--controller-instrument": other}
        refuse_choices("there is no controller without --law", given)
        return None
    return Controller(
        cast("ShortForm", assumed),
        observer or "friction",
        law,
        actuation or "differential",
        homed=not isinstance(protocol.phases[0], simulate.Pretension),
        period=period,
    )


def _summary(path: Path) -> summary.Summary:
    with ProgressBar(f"reading {path.name}", None) as bar:
        return summary.read(path, bar)


def _assumed(inst: Instrument, law: LawName | None) -> ShortForm:
    """Return what a controller of joints with pairs of their own is made for."""
    try:
        return control.compensated(inst)
    except ArgumentError as problem:
        raise CommandError(
            f"{problem} Its joints have a law of all joints: --law joints.", key="--law", value=law
        ) from None


def _print_facts(facts: Mapping[str, str]) -> None:
    """Print what came of a run."""
    for about, fact in facts.items():
        say(f"{about}: {fact}.")


def _default_path(protocol_file: str, instrument_file: str, law: str | None) -> Path:
    folder = Path("recordings")
    with write_errors(folder, CommandError):
        folder.mkdir(exist_ok=True)
    parts = (Path(protocol_file).stem, Path(instrument_file).stem, *(() if law is None else (law,)))
    return folder / f"{'-'.join(parts)}.mcap"


@contextmanager
def _progress(path: Path, every: int) -> Iterator["_Interruptible"]:
    """Show the progress of a run, and let Ctrl-C end it between two blocks."""
    with ProgressBar("", " s") as bar:
        shown = _Interruptible(bar, every)
        before = signal.signal(signal.SIGINT, shown.interrupt)
        try:
            yield shown
        except KeyboardInterrupt:
            raise CommandInterruptedError(f"interrupted; {path} {shown.held}.") from None
        except ValueError as problem:
            if not shown.called:
                raise
            key = problem.key if isinstance(problem, Error) else ""
            raise CommandError(f"{str(problem).rstrip('.')}; {path} {shown.held}.", key=key) from problem
        finally:
            signal.signal(signal.SIGINT, before)


class _Interruptible:
    """Progress of a run, whose next report ends the run after an interrupt."""

    def __init__(self, bar: ProgressBar, every: int) -> None:
        self._bar, self._every, self._interrupted, self.called = bar, every, False, False
        self._rows, self._time = 0, 0.0

    def add(self, run: Run) -> None:
        """Count the rows of a block."""
        self._rows, self._time = self._rows + len(run), float(run.time[-1])

    @property
    def done(self) -> str:
        """The time and the rows that are run, in words."""
        written = "" if self._every == 1 else f" of which one in {self._every} is written"
        return f"{self._time:.6g} s, {self._rows} rows{written}"

    @property
    def held(self) -> str:
        """What the file of a run that has ended early does."""
        return f"holds the run up to there, {self.done}"

    def interrupt(self, *_: object) -> None:
        self._interrupted = True

    def __call__(self, done: float, total: float) -> None:
        self.called = True
        if self._interrupted:
            raise KeyboardInterrupt
        self._bar(done, total)


def _print_differences(done: Replayed) -> None:
    """Print whether a replay is the same to the last bit, or by how much it differs."""
    again, recording = done.replay, done.replay.recording
    if again.exact:
        say(f"{recording.path}: replayed bit by bit on {again.inst.name}, {done.time:.6g} s, {done.rows} rows.")
        return
    title = f"{recording.path}: replay on {again.inst.name}, difference to the recording"
    rows = []
    for name, difference in done.differences.items():
        unit = "deg" if difference.unit == "rad" else difference.unit
        factor = in_unit(unit, difference.unit)
        rows.append((name, f"{difference.rms * factor:.3g}", f"{difference.largest * factor:.3g}", unit))
    console.print(table(title, "signal", ">rms", ">largest", "unit", rows=rows))

"""Recordings of an instrument: MCAP files with ROS 2 messages, as ``tenodesis record`` and a bench write them.

A bag of ROS 2 is a folder of such files, whose topics may each have a clock of their own.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap_ros2.decoder import DecoderFactory

from tenodesis.errors import IdentificationError, InstrumentError, RecordingError
from tenodesis.identification.formats.instrument_run import TENDONS, InstrumentRun, checked
from tenodesis.identification.formats.measured import checksum
from tenodesis.instrument import Instrument
from tenodesis.recording import Recording, cdr, container, schemas
from tenodesis.recording.decode import Decoded, MisfitError, decode
from tenodesis.signals import SIGNALS, Array

__all__ = ["TENDONS", "InstrumentRun", "load"]

_SIGNALS = (
    "commanded_handle_angle",
    "measured_handle_angle",
    "measured_output_angle",
    "measured_tension",
    "measured_spool_angle",
    "force",
    "radial_force",
)


_CLOCK = "/tendons/measured_js"


class _Signals(NamedTuple):
    """What was read of the first axis: by time, as (n,) or per tendon (n, 2)."""

    time: Array
    axes: tuple[str, ...]
    signals: Mapping[str, Array]
    notes: tuple[str, ...]
    instrument: Instrument | None


class _Series(NamedTuple):
    """A topic's stamps (n,) in ns, the joints' names, and each array of numbers (n, count)."""

    stamps: Array
    joints: tuple[str, ...]
    numbers: Mapping[str, Array]


def load(path: Path) -> InstrumentRun:
    """Return the first axis of a recording, or of a bag: a folder of MCAP files.

    Columns: handle_angle (commanded, where the recording has it, otherwise measured), measured_handle_angle,
    measured_output_angle (rad), tension_agonist, tension_antagonist, force, radial_force (N), spool_agonist,
    spool_antagonist (rad). What was not recorded is left out; without a force the tip is taken to be free. Topics with
    stamps of their own are brought to those of the load cells.

    Raises
    ------
    IdentificationError
        The file is no recording, or lacks what is needed, or is not usable.
    """
    files = _files(path)
    try:
        read = _recorded(files[0]) if len(files) == 1 else None
        read = _merged(path, files) if read is None else read
    except RecordingError as problem:
        raise IdentificationError(str(problem)) from None
    notes = list(read.notes)
    columns = _columns(read.signals, path, notes)
    if read.axes[1:]:
        notes.append(f"of the axes {' and '.join(read.axes)} the first is taken")
    digest = checksum(files[0]) if len(files) == 1 else ""
    return checked(path.name, read.time, columns, notes=notes, checksum=digest, instrument=read.instrument)


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    files = sorted(path.glob("*.mcap"))
    if not files:
        raise IdentificationError(f"{path} holds no MCAP file; allowed is a recording, or the folder of a ROS 2 bag.")
    return files


def _recorded(path: Path) -> _Signals | None:
    """Return a recording whose topics share their stamps, or None for one whose topics do not."""
    recording = Recording.open(path)
    if any(reason.startswith("its stamps") for reason in recording.left_out.values()):
        return None
    run = recording.run
    notes = [] if recording.damage is None else [recording.damage]
    notes += [f"{topic} is left out: {reason}" for topic, reason in recording.left_out.items()]
    found = {name: run.signals()[name] for name in _SIGNALS if name in run.signals()}
    first = {name: values[:, 0] if run.axes[1:] else values for name, values in found.items()}
    return _Signals(run.time, run.axes, first, tuple(notes), _instrument(recording))


def _merged(path: Path, files: Sequence[Path]) -> _Signals:
    """Return the topics of one or several files, interpolated to the stamps of the load cells."""
    topics: dict[str, list[Decoded]] = {}
    notes = []
    factory = DecoderFactory()
    known = {topic.name for axes in (("",), ("yaw", "pitch")) for topic in schemas.topics(axes)}
    for file in files:
        data = file.read_bytes()
        if not container.is_mcap(data):
            raise RecordingError(f"{file} is no MCAP file.")
        contents = container.scan(data)
        if contents.damage is not None:
            notes.append(f"{file.name} is read in part only: {contents.damage}")
        for number, messages in contents.messages.items():
            channel = contents.channels[number]
            schema = contents.schemas.get(channel.schema_id)
            if channel.topic not in known or schema is None:
                continue
            try:
                topics.setdefault(channel.topic, []).append(decode(factory, schema, channel.message_encoding, messages))
            except MisfitError as problem:
                notes.append(f"{channel.topic} is left out: {problem}")
    axes = schemas.axes_of({name: parts[0].joints for name, parts in topics.items()}) or ("yaw",)
    if _CLOCK not in topics:
        raise RecordingError(f"{path} lacks measured_tension; its topics are {', '.join(topics) or 'none of these'}.")
    series = {name: _series(parts) for name, parts in topics.items()}
    stamps = series[_CLOCK].stamps
    inside = np.ones(stamps.size, dtype=np.bool_)
    found: dict[str, Array] = {}
    for topic in schemas.topics(axes):
        own = series.get(topic.name)
        for field, signal in topic.signals.items() if own is not None else ():
            if own is None or signal not in _SIGNALS or signal in found or field not in own.numbers:
                continue
            # the first axis's joints, or the number itself
            joints = [joint for joint in topic.joints if joint in own.joints][: 2 if SIGNALS[signal].per_tendon else 1]
            at = [own.joints.index(joint) for joint in joints] if topic.joints else [0]
            values = [np.interp(stamps, own.stamps, own.numbers[field][:, column]) for column in at]
            if values:
                found[signal] = np.stack(values, axis=1)
                inside &= (stamps >= own.stamps[0]) & (stamps <= own.stamps[-1])
    notes.append("topics have stamps of their own: all are interpolated to those of the load cells")
    cut = {name: values[inside] if values.shape[1] > 1 else values[inside, 0] for name, values in found.items()}
    return _Signals((stamps[inside] - stamps[:1].sum()) / cdr.SECOND, axes, cut, tuple(notes), None)


def _series(parts: Sequence[Decoded]) -> _Series:
    """Return a topic's messages of all files in order of their stamps."""
    stamps = np.concatenate([part.stamps for part in parts])
    order = np.argsort(stamps, kind="stable")
    numbers = {
        name: np.concatenate([part.numbers[name] for part in parts])[order]
        for name in parts[0].numbers
        if all(name in part.numbers for part in parts)
    }
    return _Series(stamps[order].astype(np.float64), parts[0].joints, numbers)


def _columns(signals: Mapping[str, Array], path: Path, notes: list[str]) -> dict[str, Array]:
    handle = next((name for name in ("commanded_handle_angle", "measured_handle_angle") if _there(signals, name)), None)
    missing = [name for name in ("measured_tension",) if not _there(signals, name)]
    if missing or handle is None:
        lacking = ", ".join([*missing, *([] if handle else ["measured_handle_angle"])])
        raise IdentificationError(f"{path} lacks {lacking}; it has {', '.join(signals) or 'no signals'}.")
    if handle == "measured_handle_angle":
        notes.append("the handle is where its encoder says, for no commanded angle was recorded")
    columns = {"handle_angle": signals[handle]}
    for name in ("measured_handle_angle", "measured_output_angle", "force", "radial_force"):
        if _there(signals, name):
            columns[name] = signals[name]
    for name, column in (("measured_tension", "tension"), ("measured_spool_angle", "spool")):
        if _there(signals, name):
            columns |= {f"{column}_{tendon}": signals[name][:, n] for n, tendon in enumerate(TENDONS)}
    return columns


def _there(signals: Mapping[str, Array], name: str) -> bool:
    return name in signals and bool(np.isfinite(signals[name]).any())


def _instrument(recording: Recording) -> Instrument | None:
    try:
        inst = recording.instrument()
    except (InstrumentError, RecordingError):
        return None
    return inst.axis(inst.axes[0]) if inst.axes[1:] else inst

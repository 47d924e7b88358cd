"""The choices a controller was made with, as recordings hold them, and the controller they make again."""

import tomllib
from collections.abc import Mapping
from typing import Any

import tomli_w

from tenodesis.control import FAULTS, Controller
from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument, parse
from tenodesis.instrument.text import to_toml
from tenodesis.recording.reader import Recording

CONTROLLER = "controller"
"""Metadata of the choices, as TOML."""
INSTRUMENT = "controller_instrument"
"""Metadata of the instrument that the controller was told, where that is not the one that was recorded."""


def described(controller: Controller, inst: Instrument) -> dict[str, str]:
    """Return the metadata of a controller that ran on an instrument."""
    choices = {
        "law": controller.law,
        "observer": controller.observer,
        "actuation": controller.actuation,
        "homed": controller.homed_at_start,
        "enabled": controller.enabled_at_start,
        "precision": getattr(controller, "precision", "double"),
        "own_clock": getattr(controller, "own_clock", False),
        "period": controller.parameters.common["period"],
    }
    # Names of the bits, so that a file tells its faults by itself.
    metadata = {CONTROLLER: tomli_w.dumps({**choices, "faults": list(FAULTS)})}
    return metadata if controller.inst == inst else metadata | {INSTRUMENT: to_toml(controller.inst)}


def carried(recording: Recording, inst: Instrument) -> dict[str, str]:
    """Return the metadata by which a replay on an instrument still says what the controller was told."""
    if CONTROLLER not in recording.metadata or INSTRUMENT in recording.metadata or recording.instrument() == inst:
        return {}
    return {INSTRUMENT: recording.metadata["instrument"]}


def made_again(recording: Recording) -> Controller | None:
    """Return a controller as the one that a recording was made with was at its start, or None if it had none.

    Raises
    ------
    RecordingError
        What the recording says of it makes no controller.
    InstrumentError
        The instrument it was told is not valid in this version.
    """
    choices = choices_of(recording)
    if choices is None:
        return None
    choices.pop("faults", None)
    inst = instrument_of(recording)
    try:
        return Controller(inst, **choices)
    except (TypeError, ValueError) as problem:
        raise RecordingError(f"{recording.path}: metadata {CONTROLLER}: {problem}") from None


def instrument_of(recording: Recording) -> Instrument:
    """Return the instrument that the controller was told.

    Raises
    ------
    RecordingError
        The recording does not hold its instrument.
    InstrumentError
        It is not valid in this version.
    """
    told = recording.metadata.get(INSTRUMENT)
    return recording.instrument() if told is None else parse(told, f"{recording.path}: {INSTRUMENT}")


def in_words(choices: Mapping[str, Any], told: Instrument, inst: Instrument) -> str:
    """Say in a few words what a controller was, and what it was told if that is not the instrument that ran."""
    words = f"{choices.get('law')} law, {choices.get('observer')} observer, {choices.get('actuation')} actuation"
    return words if told == inst else f"{words}, told another instrument ({told.name})"


def choices_of(recording: Recording) -> dict[str, Any] | None:
    """Return the choices that a recording holds, as they are written.

    Raises
    ------
    RecordingError
        They are not TOML.
    """
    text = recording.metadata.get(CONTROLLER)
    try:
        return None if text is None else tomllib.loads(text)
    except tomllib.TOMLDecodeError as problem:
        raise RecordingError(f"{recording.path}: metadata {CONTROLLER} is not valid TOML: {problem}.") from None

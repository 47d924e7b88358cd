"""The metadata of a recording: what was run, and the controller restored from it."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import tomli_w

from tenodesis.control import FAULTS, Controller, JointController
from tenodesis.control.pairs import compensated
from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument, as_short_form, expanded, parse
from tenodesis.instrument.text import to_toml
from tenodesis.plant import TIME_STEP
from tenodesis.recording.reader import Recording
from tenodesis.toml import parse_toml

if TYPE_CHECKING:
    from tenodesis.simulate import Protocol

CONTROLLER = "controller"
"""Key of the controller's choices, as TOML."""
CONTROLLER_INSTRUMENT = "controller_instrument"
"""Key of the controller's instrument, where it differs from the recorded instrument."""
_SERVES, _ALL_JOINTS = "serves", "all joints"
"""Key of what the controller serves, if it is more than joints with pairs of their own."""
EVERY = "every"
"""Key of the number of rows of which one was written."""
DYNAMIC = "dynamic"
"""Mode of a twin with inertia and damping."""
QUASI_STATIC = "quasi-static"
"""Mode of a twin without inertia and damping."""


def metadata_of(
    inst: Instrument,
    protocol: "Protocol | None" = None,
    *,
    seed: int = 0,
    time_step: float = TIME_STEP,
    quasi_static: bool = False,
    controller: Controller | JointController | None = None,
    every: int = 1,
) -> dict[str, str]:
    """Return the metadata of a twin's recording, from which it can be replayed.

    Parameters
    ----------
    inst, protocol, controller
        What was run: the instrument, the protocol if the run followed one, and the controller if one closed the loop.
    seed, time_step, quasi_static
        Of the twin, as for :class:`tenodesis.twin.Twin`.
    every
        Of how many of its rows one is written.
    """
    return (
        {"instrument": to_toml(inst)}
        | ({} if protocol is None else {"protocol": protocol.to_toml()})
        | {"seed": str(seed), "time_step": repr(float(time_step))}
        | {"mode": QUASI_STATIC if quasi_static else DYNAMIC}
        | ({} if every == 1 else {EVERY: str(every)})
        | ({} if controller is None else _metadata_of_controller(controller, inst))
    )


def metadata_of_replay(recording: Recording, inst: Instrument) -> dict[str, str]:
    """Return the metadata of a recording's replay on an instrument; the controller's instrument is unchanged."""
    metadata = {**recording.metadata, "instrument": to_toml(inst), "replay_of": str(recording.path)}
    if CONTROLLER in metadata and CONTROLLER_INSTRUMENT not in metadata and recording.instrument() != inst:
        metadata[CONTROLLER_INSTRUMENT] = recording.metadata["instrument"]
    return metadata


def controller_choices(recording: Recording) -> dict[str, Any] | None:
    """Return the controller's choices in a recording's form, or None if there was no controller.

    Raises
    ------
    RecordingError
        They are not TOML.
    """
    text = recording.metadata.get(CONTROLLER)
    return None if text is None else parse_toml(text, RecordingError, f"{recording.path}: metadata {CONTROLLER}")


def controller_instrument(recording: Recording) -> Instrument:
    """Return the controller's instrument.

    Raises
    ------
    RecordingError
        The recording does not contain its instrument.
    InstrumentError
        The instrument is not valid in this version.
    """
    text = recording.metadata.get(CONTROLLER_INSTRUMENT)
    all_joints = (controller_choices(recording) or {}).get(_SERVES) == _ALL_JOINTS
    if text is None:
        return expanded(recording.instrument()) if all_joints else compensated(recording.instrument())
    inst = parse(text, f"{recording.path}: {CONTROLLER_INSTRUMENT}")
    return expanded(inst) if all_joints else as_short_form(inst)


def restored_controller(recording: Recording) -> Controller | JointController | None:
    """Return a recording's controller as it was at its start, or None if it had no controller.

    Raises
    ------
    RecordingError
        The choices in the recording make no controller.
    InstrumentError
        The controller's instrument is not valid in this version.
    """
    choices = controller_choices(recording)
    if choices is None:
        return None
    choices.pop("faults", None)
    inst = controller_instrument(recording)
    try:
        return JointController(inst, **choices) if choices.pop(_SERVES, None) else Controller(inst, **choices)
    except (TypeError, ValueError) as problem:
        raise RecordingError(f"{recording.path}: metadata {CONTROLLER}: {problem}", key=CONTROLLER) from None


def in_words(choices: Mapping[str, Any], controller_inst: Instrument, inst: Instrument) -> str:
    """Return a short description of a controller's choices, with its instrument if it differs from that of the run."""
    if choices.get(_SERVES) == _ALL_JOINTS:
        words, own = f"{choices.get('law')} law, all joints", expanded(inst) == controller_inst
    else:
        words = f"{choices.get('law')} law, {choices.get('observer')} observer, {choices.get('actuation')} actuation"
        own = compensated(inst) == controller_inst
    return words if own else f"{words}, made for another instrument ({controller_inst.name})"


def _metadata_of_controller(controller: Controller | JointController, inst: Instrument) -> dict[str, str]:
    choices: dict[str, Any] = {"law": controller.law, "enabled": controller.enabled_at_start}
    if isinstance(controller, JointController):
        choices |= {_SERVES: _ALL_JOINTS, "period": controller.period}
        own: Instrument = expanded(inst)
    else:
        choices |= {
            "observer": controller.observer,
            "actuation": controller.actuation,
            "homed": controller.homed_at_start,
            "precision": getattr(controller, "precision", "double"),
            "own_clock": getattr(controller, "own_clock", False),
            "period": controller.parameters.common["period"],
        }
        own = compensated(inst)
    # With the names of the fault bits, a file explains its own faults.
    metadata = {CONTROLLER: tomli_w.dumps({**choices, "faults": list(FAULTS)})}
    return metadata if controller.inst == own else metadata | {CONTROLLER_INSTRUMENT: to_toml(controller.inst)}

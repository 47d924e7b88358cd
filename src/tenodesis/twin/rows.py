"""Rows of the core: commands, checks before a run, and signals."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tenodesis import _core
from tenodesis._core import Status
from tenodesis.errors import ArgumentError, NoSolutionError
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.run import HELD, TISSUE, Array, Run
from tenodesis.statics.query import handle_angle_error

CONTROL = _core.control_signals()
_COMMANDED = {
    "handle_angle": "commanded_handle_angle",
    "spool_velocity": "commanded_spool_velocity",
    "spool_tension": "commanded_spool_tension",
    "radial_force": "radial_force",
    "wrench": "wrench",
    "grip_force": "applied_grip_force",
}
"""Signals that are commands, by the name of the command's columns."""


def columns_by_name(columns: Sequence[tuple[str, int]]) -> dict[str, slice]:
    """Return where the columns of each name are in a row, from their names and widths in order."""
    ends = np.cumsum([width for _, width in columns]).tolist()
    return {name: slice(end - width, end) for (name, width), end in zip(columns, ends, strict=True)}


def signals_of_commands(commands: Mapping[str, Array], *, tissue: bool, grip: bool, tension: bool) -> dict[str, Array]:
    """Return the signals of a run in commands by name, (n, columns), with or without some of them.

    tissue: that at the tip; grip: what jaws hold; tension: tensions that drives hold.
    """
    signals = {signal: commands[name] for name, signal in _COMMANDED.items() if name in commands}
    if not tension:
        signals.pop("commanded_spool_tension", None)
    if tissue:
        signals |= {name: commands["contact"][:, n :: len(TISSUE)] for n, name in enumerate(TISSUE)}
    if grip:
        signals |= {name: commands["held"][:, [n]] for n, name in enumerate(HELD)}
    return signals


def check_seed(seed: int) -> None:
    """Raise ArgumentError for a seed that is no integer from 0 to 2**64 - 1."""
    if not isinstance(seed, int | np.integer) or isinstance(seed, bool) or not 0 <= seed < 2**64:
        raise ArgumentError(key="seed", value=seed, allowed="an integer from 0 to 2**64 - 1")


def check_handle_range(inst: ShortForm, handle_angle: Array, axis: str = "") -> None:
    """Raise ArgumentError for the first handle angle, rad, shape (n,), beyond the handle's range."""
    wrong = np.flatnonzero(np.abs(handle_angle) > inst.handle_range + 1e-9)
    if wrong.size:
        first = int(wrong[0])
        raise handle_angle_error(
            inst.handle_range, float(handle_angle[first]), f"[{first}]{f' of {axis}' if axis else ''}"
        )


def check_rig(inst: Instrument) -> None:
    """Raise ArgumentError for an instrument on which the load rig has no pulley to hang a weight on."""
    if inst.conditions.cable_pulley_radius is None:
        raise ArgumentError(
            f"weight is given, but {inst.name} has no conditions.cable_pulley_radius; give a force, or that key.",
            key="weight",
        )


def lost(status: Status, step: int, time: float) -> Exception:
    """Return the exception for a run that the core ended at a step, of which it is the value."""
    where = f"step {step} ({time:.6g} s)"
    if status == Status.OUT_OF_RANGE:
        return NoSolutionError(
            f"at {where} the handle was pushed beyond its range; give a smaller load or angle.",
            key="handle_angle",
            value=step,
        )
    if status == Status.NOT_FINITE:
        return ArgumentError(
            f"at {where} a command is not finite; it must be a finite number.",
            key="command",
            value=step,
            allowed="finite",
        )
    return NoSolutionError(
        f"at {where} the tip finds no equilibrium: the load is more than the tendons can hold; give a smaller load or "
        "more pretension.",
        key="load",
        value=step,
    )


def with_currents(run: Run, inst: Instrument) -> Run:
    """Return a run with the motors' currents, where these give the tensions of its instrument."""
    if inst.sensors.kind != "current" or run.measured_tension is None:
        return run
    return replace(run, measured_current=run.measured_tension / [one.per_current for one in inst.tension_sensors])

"""Commands of a twin: its arguments, checked, with a row per step and a column per joint, tendon or component."""

from collections.abc import Mapping
from typing import Literal, NamedTuple, TypeAlias, TypedDict

import numpy as np
from numpy.typing import ArrayLike

from tenodesis.errors import ArgumentError
from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.statics.query import place
from tenodesis.twin.contact import Contacts

Frame: TypeAlias = Literal["tip", "stem"]
"""Axes of a wrench: they turn with the end-effector, z along it, or keep their direction."""

_BY_COLUMN = ("wrench", "spool_velocity", "let_out", "spool_tension")
"""Arguments whose last axis is that of their columns, even with one dimension."""
_INSTEAD = {**dict.fromkeys(("force", "radial_force", "weight"), "wrench"), "wrench": "force and radial_force"}


class Held(NamedTuple):
    """What the jaws hold: a spring that they press."""

    opening: float
    """Opening of the jaws, by the arms of the grip and their angles, below which they press it, m"""
    stiffness: float
    """N/m"""
    damping: float = 0.0
    """N s/m"""


class Loads(TypedDict, total=False):
    """What may act on a twin beside handle and tangential force, as :meth:`tenodesis.twin.Twin.run` takes it."""

    radial_force: ArrayLike
    weight: ArrayLike
    wrench: ArrayLike
    grip_force: ArrayLike
    spool_velocity: ArrayLike
    sheath_bend: ArrayLike
    let_out: ArrayLike
    spool_tension: ArrayLike
    contact: Contacts | None
    held: Held | None
    axes: Frame


def as_columns(given: Mapping[str, ArrayLike], widths: Mapping[str, int], inst: Instrument) -> dict[str, Array]:
    """Return arguments, by name, as arrays of shape (n, columns), for those whose number of columns is in `widths`.

    Raises
    ------
    ArgumentError
        A shape does not fit, a value is not finite, or an argument is given that the instrument's twin does not take.
    """
    arrays = {name: np.asarray(value, float) for name, value in given.items()}
    for name in arrays.keys() - widths.keys():
        if np.any(arrays.pop(name)):
            raise _refused(name, inst)
    arrays = {name: _by_row(name, array, widths[name]) for name, array in arrays.items()}
    count = _rows_of(arrays, widths)
    full = {}
    for name, array in arrays.items():
        width = widths[name]
        by_column = name in _BY_COLUMN
        shape = (count,) if width == 1 and not by_column else (count, width)
        # A value per step is for all columns.
        each_step = array.shape == (count,) and len(shape) == 2 and not by_column
        fits = array.ndim > 0 or not array or (width > 0 and name != "wrench")
        if array.ndim == 0 and not array:
            full[name] = np.broadcast_to(0.0, (count, width))
            continue
        try:
            found = np.broadcast_to(array[:, np.newaxis] if each_step else array, shape)
        except ValueError:
            fits = False
        if not fits:
            problem = f"{name} has shape {array.shape}; it must be {shape}, or a number."
            raise ArgumentError(problem, key=name, value=array.shape, allowed=str(shape))
        check_finite(name, array)
        full[name] = found.reshape(count, width)
    return full


def check_spool_tension(tension: Array, inst: Instrument) -> None:
    """Raise ArgumentError for tensions (..., tendons) that no drive can hold; one number is for all."""
    if (tension < 0).any():
        at = int(np.argmax(tension < 0))
        allowed = "above 0 N, or 0 N for a drive that follows spool_velocity"
        raise ArgumentError(
            key=f"spool_tension{place(at, tension.shape)}", value=float(tension.flat[at]), allowed=allowed
        )
    for m, tendon in enumerate(inst.tendons):
        held = tension[..., m if tension.shape[-1] > 1 else 0]
        if tendon.start != "spool" and held.any():
            allowed = f"0 N for {tendon.name}, which has no spool"
            raise ArgumentError(key="spool_tension", value=float(held.max()), allowed=allowed)


def check_finite(name: str, array: Array) -> None:
    """Raise ArgumentError for the first value that is not finite."""
    finite = np.isfinite(array)
    if not finite.all():
        first = int(np.argmin(finite))
        at = place(first, array.shape)
        raise ArgumentError(key=f"{name}{at}", value=float(array.flat[first]), allowed="a finite number")


def check_no_wrench(wrench: ArrayLike, inst: Instrument) -> None:
    """Raise ArgumentError for a wrench on an instrument that takes forces of axes."""
    if np.any(wrench):
        raise _refused("wrench", inst)


def check_held(held: Held | None, there: Held | None, opening: float) -> None:
    """Raise ArgumentError for something that cannot be held, or that is put between jaws (m) too narrow for it."""
    if held is None:
        return
    if not isinstance(held, Held):
        raise TypeError(f"held is {held!r}; it must be a Held.")
    for name, value in held._asdict().items():
        if not np.isfinite(value) or (name != "opening" and value < 0):
            allowed = "a finite number" if name == "opening" else "a finite number that is not negative"
            raise ArgumentError(key=f"held.{name}", value=value, allowed=allowed)
    if held != there and held.opening > opening + 1e-12:
        allowed = f"at most {opening:.4g} m, to which the jaws are open"
        raise ArgumentError(key="held.opening", value=held.opening, allowed=allowed)


def _by_row(name: str, array: Array, width: int) -> Array:
    """Return an argument without an axis for its only column, and with one axis for those of several pairs."""
    if width == 1 and array.ndim == 2 and array.shape[1] == 1 and name not in _BY_COLUMN:
        return array[:, 0]
    pairs = name in _BY_COLUMN and array.ndim > 1 and width > 2 and array.shape[-2:] == (width // 2, 2)
    return array.reshape(*array.shape[:-2], width) if pairs else array


def _rows_of(arrays: Mapping[str, Array], widths: Mapping[str, int]) -> int:
    """Return the number of steps: of the first argument that has rows, whose number may be that of its columns."""
    by_row = {name: array for name, array in arrays.items() if array.ndim > (name in _BY_COLUMN)}
    sure = [len(array) for name, array in by_row.items() if array.ndim > 1 or widths[name] == 1]
    return (sure or [len(array) for array in by_row.values()] or [1])[0]


def _refused(name: str, inst: Instrument) -> ArgumentError:
    instead = _INSTEAD.get(name)
    if instead is None:
        return grip_error(name, inst)
    return ArgumentError(
        f"{name} is given, which the twin of {inst.name} does not take; give {instead}.", key=name, allowed=instead
    )


def grip_error(key: str, inst: Instrument) -> ArgumentError:
    """Return the error for what jaws hold, or what presses them apart, where there are none."""
    return ArgumentError(
        f"{key} is given, but {inst.name} has nothing that grips; its file must have a table [grip] with the jaws.",
        key=key,
        allowed="nothing without a table [grip]",
    )

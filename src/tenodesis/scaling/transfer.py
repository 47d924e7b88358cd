"""Carry a recording made on a scaled-up instrument to real-size units."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tenodesis.errors import RecordingError
from tenodesis.instrument import Instrument
from tenodesis.instrument.text import to_toml
from tenodesis.recording import Recorder, Recording
from tenodesis.recording.schemas import TRANSFERRED
from tenodesis.run import SIGNALS, Array, Run
from tenodesis.scaling.transfer_factors import QUANTITY, comparison, factors
from tenodesis.scaling.transfer_friction import carry_friction, left_behind, shared_axes
from tenodesis.similarity import Comparison

FACTORS = "transfer_factors"
"""Metadata of the factors, by axis, as TOML."""
BEFORE = "scaled_up_"
"""What the keys of the metadata of the recording that was carried over begin with."""

_MADE_ANEW = ("axes", "tenodesis", "python", "numpy")
_SAME = 0.01
"""Share by which a pretension or a ratio may be off and still count as the same."""


@dataclass(frozen=True)
class Carried:
    """A recording in real-size units; :func:`carry` makes it."""

    recording: Recording
    run: Run
    """In real-size units."""
    real_size: Instrument
    """The real-size instrument with the axes of the recording, and with the friction carried over if there is one."""
    scaled_up: Instrument
    """The scaled-up instrument that was recorded."""
    comparisons: Mapping[str, Comparison]
    """Both instruments as they are, by axis."""
    factors: Mapping[str, Mapping[str, float]]
    """Scaled-up over real-size, by axis and key."""
    warnings: tuple[str, ...]
    """What was not similar, damaged or not carried over, in sentences."""

    @cached_property
    def metadata(self) -> dict[str, str]:
        """The metadata of the recording to write; what made the original goes on under other keys."""
        before = {f"{BEFORE}{key}": text for key, text in self.recording.metadata.items() if key not in _MADE_ANEW}
        return {
            **before,
            "instrument": to_toml(self.real_size),
            TRANSFERRED: self.recording.path.name,
            f"{BEFORE}instrument": to_toml(self.scaled_up),
            FACTORS: tomli_w.dumps({axis: dict(own) for axis, own in self.factors.items()}),
        }

    @property
    def largest_force(self) -> float:
        """Largest tangential force at the tip, N; NaN where none was recorded."""
        return _largest(self.run, "force")

    @property
    def largest_tension(self) -> float:
        """Largest tension of a tendon, N; NaN where none was recorded."""
        return _largest(self.run, "tension", "distal_tension", "measured_tension")

    def similarity_error(self) -> float:
        """Return the largest similarity error up to the largest force, without friction, deg; NaN without a force."""
        if not self.largest_force > 0:
            return math.nan
        pairs = self.comparisons.values()
        return max(
            one.error(pretension=one.scaled_up.pretension, largest_force=self.largest_force).largest for one in pairs
        )

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write it as a recording, with the topics of the original.

        Raises
        ------
        RecordingError
            The file cannot be written, or exists, or time steps shrink to less than 1 ns.
        """
        with Recorder(path, axes=self.run.axes, metadata=self.metadata, overwrite=overwrite) as recorder:
            recorder.write(self.run)


def transfer(
    recording: Recording,
    real_size: Instrument,
    *,
    scaled_up: Instrument | None = None,
    time_factor: float | None = None,
) -> Run:
    """Return a recording's signals in real-size units; arguments and errors as for :func:`carry`."""
    return carry(recording, real_size, scaled_up=scaled_up, time_factor=time_factor).run


def carry(
    recording: Recording,
    real_size: Instrument,
    *,
    scaled_up: Instrument | None = None,
    time_factor: float | None = None,
) -> Carried:
    """Carry a recording made on a scaled-up instrument to real-size units.

    Angles and what a controller says of its state are the same; forces, tensions, torques, spool angles, velocities and
    time are divided by the factors of similarity of their axis, of the instruments as their tables mismatch say they
    truly are. A radial force is divided by the factor of tension.

    Parameters
    ----------
    recording
        The recording, whole or damaged.
    real_size
        The real-size instrument; it may have axes that were not recorded.
    scaled_up
        The instrument that was recorded; by default the one that the recording holds.
    time_factor
        Factor of time; by default that of the tips' swings.

    Raises
    ------
    RecordingError
        The recording has no instrument or no rows, or other axes than the scaled-up instrument.
    InstrumentError
        The two have different joint types, the real-size one lacks an axis, or the carried friction is not allowed.
    ValueError
        The time factor is no number above 0.
    """
    scaled_up = _scaled_up(recording, scaled_up)
    run, axes = recording.run, recording.run.axes
    shared_axes(scaled_up, real_size)
    if not len(run):
        raise RecordingError(f"{recording.path} has no rows; there is nothing to carry over.")
    pairs = {axis: comparison(real_size.axis(axis), scaled_up.axis(axis)) for axis in axes}
    scale = {axis: factors(pair, time_factor) for axis, pair in pairs.items()}
    # Axes share one clock.
    scale = {axis: factors(pair, scale[axes[0]]["time"]) for axis, pair in pairs.items()}
    carried: dict[str, Any] = {
        name: values / _column([scale[axis][QUANTITY[name]] for axis in axes], name) if name in QUANTITY else values
        for name, values in run.signals().items()
    }
    rubbing = scaled_up.friction.law != "none"
    source = recording.path.name
    told = carry_friction(scaled_up, real_size, source=source, time_factor=time_factor) if rubbing else real_size
    return Carried(
        recording,
        replace(run, time=run.time / scale[axes[0]]["time"], **carried),
        told if told.axes == axes else told.axis(axes[0]),
        scaled_up,
        pairs,
        scale,
        _warnings(recording, scaled_up, real_size, pairs),
    )


def _scaled_up(recording: Recording, scaled_up: Instrument | None) -> Instrument:
    if scaled_up is None and "instrument" not in recording.metadata:
        raise RecordingError(
            f"{recording.path} does not hold its instrument; allowed is to give the scaled-up instrument beside it."
        )
    inst = recording.instrument() if scaled_up is None else scaled_up
    if inst.axes != recording.run.axes:
        raise RecordingError(
            f"{recording.path} has the axes {' and '.join(recording.run.axes)}, {inst.name} {' and '.join(inst.axes)}; "
            "allowed is a scaled-up instrument with the same."
        )
    return inst


def _column(scales: list[float], signal: str) -> Array | float:
    """Return factors by axis in the shape of a signal's axes and tendons."""
    if len(scales) == 1:
        return scales[0]
    column = np.array(scales)
    return column[:, np.newaxis] if SIGNALS[signal].per_tendon else column


def _largest(run: Run, *names: str) -> float:
    there = run.signals()
    sizes = [np.abs(there[name]) for name in names if name in there]
    known = [float(np.nanmax(size)) for size in sizes if not np.isnan(size).all()]
    return max(known, default=math.nan)


def _warnings(
    recording: Recording, scaled_up: Instrument, real_size: Instrument, pairs: Mapping[str, Comparison]
) -> tuple[str, ...]:
    sentences = [] if recording.damage is None else [recording.damage]
    sentences += [f"{topic} of {recording.path} is left out: {why}." for topic, why in recording.left_out.items()]
    for axis, pair in pairs.items():
        where = f" ({axis})" if len(pairs) > 1 else ""
        sentences += _dissimilar(pair, where)
    if scaled_up.friction.law == "none":
        sentences.append(f"{scaled_up.name} has no friction to carry over: {real_size.name} keeps its own.")
    return (*sentences, *left_behind(scaled_up))


def _dissimilar(pair: Comparison, where: str) -> list[str]:
    """Say of one axis that the ratio of radii is not the same, or the pretension not the scaled one."""
    real_size, scaled_up = pair.real_size, pair.scaled_up
    sentences = []
    ratio = next(group for group in pair.groups if group.name == "R/r")
    if not abs(ratio.ratio - 1) <= _SAME:
        sentences.append(
            f"R/r is {ratio.scaled_up:.4g} on {scaled_up.name} and {ratio.real_size:.4g} on {real_size.name}{where}: "
            "the same handle angle asks for another output angle."
        )
    right = real_size.pretension * pair.tension_factor
    more = scaled_up.pretension - right
    if abs(more) > _SAME * right:
        sentences.append(
            f"the pretension of {scaled_up.name}{where} was {scaled_up.pretension:.4g} N, {abs(more):.3g} N "
            f"{'more' if more > 0 else 'less'} than the {right:.4g} N that {real_size.pretension:.4g} N of "
            f"{real_size.name} scale to: slack is not similar."
        )
    return sentences

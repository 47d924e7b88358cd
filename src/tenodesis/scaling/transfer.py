"""Convert a run or recording of a scaled-up instrument to real-size units."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from tenodesis.errors import RecordingError
from tenodesis.instrument import ShortForm, as_short_form
from tenodesis.instrument.text import to_toml
from tenodesis.recording import Recorder, Recording
from tenodesis.recording.schemas import TRANSFERRED
from tenodesis.run import SIGNALS, TENDONS, Array, Run
from tenodesis.scaling.transfer_factors import QUANTITY, comparison, factors
from tenodesis.scaling.transfer_friction import carry_friction, left_behind, shared_axes
from tenodesis.similarity import Comparison

FACTORS = "transfer_factors"
"""Metadata key of the factors, by axis, as TOML."""
BEFORE = "scaled_up_"
"""Prefix of the keys of the original recording's metadata."""

_RENEWED = ("axes", "tenodesis", "python", "numpy")
"""Metadata that the recorder writes itself."""
_SAME = 0.01
"""Share by which a pretension or a ratio may differ and still count as the same."""


@dataclass(frozen=True)
class Carried:
    """A run in real-size units; :func:`carry` makes it."""

    run: Run
    """In real-size units."""
    real_size: ShortForm
    """The real-size instrument with the axes of the run, and with the transferred friction if there is any."""
    scaled_up: ShortForm
    """The scaled-up instrument of the original run."""
    comparisons: Mapping[str, Comparison]
    """Both instruments as built, by axis."""
    factors: Mapping[str, Mapping[str, float]]
    """Scaled-up over real-size, by axis and key."""
    warnings: tuple[str, ...]
    """Sentences on what was not similar, damaged or not converted."""
    source: str = ""
    """Name of the recording, if a recording was converted."""
    original: Mapping[str, str] | None = None
    """Metadata of that recording."""

    @cached_property
    def metadata(self) -> dict[str, str]:
        """Metadata of the recording to write; those of the original get a prefix."""
        before = {f"{BEFORE}{key}": text for key, text in (self.original or {}).items() if key not in _RENEWED}
        return {
            **before,
            "instrument": to_toml(self.real_size),
            TRANSFERRED: self.source or f"a run of {self.scaled_up.name}",
            f"{BEFORE}instrument": to_toml(self.scaled_up),
            FACTORS: tomli_w.dumps({axis: dict(own) for axis, own in self.factors.items()}),
        }

    @property
    def largest_force(self) -> float:
        """Largest tangential force at the tip, N; NaN if none was recorded."""
        return _largest(self.run, "force")

    @property
    def largest_tension(self) -> float:
        """Largest tension of a tendon, N; NaN if none was recorded."""
        return _largest(self.run, "tension", "distal_tension", "measured_tension")

    def similarity_error(self) -> float:
        """Return the largest similarity error up to the largest force, without friction, deg; NaN if no force."""
        if not self.largest_force > 0:
            return math.nan
        return max(
            pair.error(pretension=pair.scaled_up.pretension, largest_force=self.largest_force).largest
            for pair in self.comparisons.values()
        )

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write it as a recording, with the topics of the original.

        Raises RecordingError if the file cannot be written, or exists, or time steps shrink to less than 1 ns.
        """
        with Recorder(path, axes=self.run.names, metadata=self.metadata, overwrite=overwrite) as recorder:
            recorder.write(self.run)


def carry(
    source: Recording | Run,
    real_size: ShortForm,
    *,
    scaled_up: ShortForm | None = None,
    time_factor: float | None = None,
) -> Carried:
    """Convert a recording or run of a scaled-up instrument to real-size units.

    Angles and the controller's states stay the same; forces, tensions, torques, spool angles, velocities and time are
    divided by the similarity factors of their axis, between the instruments as built: with the true stiffness and
    pretension of their tables mismatch. A radial force is divided by the factor of tension.

    Parameters
    ----------
    source
        The recording, complete or damaged, or the run.
    real_size
        The real-size instrument; it may have axes that were not recorded.
    scaled_up
        The instrument of the run; by default that of the recording.
    time_factor
        Factor of time; by default that of the tips' periods.

    Raises
    ------
    RecordingError
        There is no instrument or there are no rows, or the axes differ from those of the scaled-up instrument.
    InstrumentError
        The two have different joint types, the real-size one lacks an axis, or the carried friction is not allowed.
    ValueError
        The time factor is not a number above 0.
    """
    recording = source if isinstance(source, Recording) else None
    run = source if isinstance(source, Run) else source.run
    where = str(recording.path) if recording else "the run"
    original = _scaled_up(recording, run, scaled_up, where)
    shared_axes(original, real_size)
    if not len(run):
        raise RecordingError(f"{where} has no rows; there is nothing to convert.")
    undivided = [name for name in run.signals() if SIGNALS[name].of in ("components", "run")]
    if undivided:
        raise RecordingError(f"{where} has {undivided[0]}, which is of no axis; it must have forces of its axes.")
    pairs = {axis: comparison(real_size.axis(axis), original.axis(axis)) for axis in run.axes}
    scale = {axis: factors(pair, time_factor) for axis, pair in pairs.items()}
    # Axes share one clock.
    time = scale[run.axes[0]]["time"]
    scale = {axis: factors(pair, time) for axis, pair in pairs.items()}
    carried: dict[str, Any] = {
        name: values / _by_axis([own[QUANTITY[name]] for own in scale.values()], name) if name in QUANTITY else values
        for name, values in run.signals().items()
    }
    name = recording.path.name if recording else ""
    result = real_size
    if original.friction.law != "none":
        result = carry_friction(original, real_size, source=name, time_factor=time_factor)
    return Carried(
        replace(run, time=run.time / time, **carried),
        result if result.axes == run.axes else result.axis(run.axes[0]),
        original,
        pairs,
        scale,
        (*(_damages(recording) if recording else ()), *_warnings(original, real_size, pairs)),
        name,
        recording.metadata if recording else None,
    )


def _scaled_up(recording: Recording | None, run: Run, given: ShortForm | None, where: str) -> ShortForm:
    if given is not None:
        inst = given
    elif recording is not None and "instrument" in recording.metadata:
        inst = as_short_form(recording.instrument())
    else:
        raise RecordingError(f"{where} does not contain its instrument; give the scaled-up instrument as well.")
    if inst.axes != run.axes:
        raise RecordingError(
            f"{where} has the axes {' and '.join(run.axes)}, {inst.name} {' and '.join(inst.axes)}; "
            "the scaled-up instrument must have the same."
        )
    return inst


def _by_axis(scales: list[float], signal: str) -> Array | float:
    """Return factors by axis in the shape of a signal's columns."""
    if len(scales) == 1:
        return scales[0]
    return np.repeat(scales, len(TENDONS)) if SIGNALS[signal].per_tendon else np.array(scales)


def _largest(run: Run, *names: str) -> float:
    signals = run.signals()
    sizes = [np.abs(signals[name]) for name in names if name in signals]
    known = [float(np.nanmax(size)) for size in sizes if not np.isnan(size).all()]
    return max(known, default=math.nan)


def _damages(recording: Recording) -> list[str]:
    damage = [] if recording.damage is None else [recording.damage]
    return damage + [f"{topic} of {recording.path} is left out: {why}." for topic, why in recording.left_out.items()]


def _warnings(scaled_up: ShortForm, real_size: ShortForm, pairs: Mapping[str, Comparison]) -> list[str]:
    sentences = []
    for axis, pair in pairs.items():
        sentences += _dissimilar(pair, f" ({axis})" if len(pairs) > 1 else "")
    if scaled_up.friction.law == "none":
        sentences.append(f"{scaled_up.name} has no friction to transfer: {real_size.name} keeps its own.")
    return [*sentences, *left_behind(scaled_up)]


def _dissimilar(pair: Comparison, where: str) -> list[str]:
    """Return warnings on an axis whose ratio of radii differs, or whose pretension is not the scaled pretension."""
    real_size, scaled_up = pair.real_size, pair.scaled_up
    sentences = []
    ratio = next(group for group in pair.groups if group.name == "R/r")
    if not abs(ratio.ratio - 1) <= _SAME:
        sentences.append(
            f"R/r is {ratio.scaled_up:.4g} on {scaled_up.name} and {ratio.real_size:.4g} on {real_size.name}{where}: "
            "the same handle angle leads to another output angle."
        )
    similar = pair.scaled_pretension
    more = scaled_up.pretension - similar
    if abs(more) > _SAME * similar:
        sentences.append(
            f"the pretension of {scaled_up.name}{where} was {scaled_up.pretension:.4g} N, {abs(more):.3g} N "
            f"{'more' if more > 0 else 'less'} than the {similar:.4g} N that {real_size.pretension:.4g} N of "
            f"{real_size.name} scale to: slack is not similar."
        )
    return sentences

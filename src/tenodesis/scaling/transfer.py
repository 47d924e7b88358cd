"""Convert runs, recordings and identified friction of a scaled-up instrument to real-size units."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import degrees
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import tomli_w

from tenodesis import plant
from tenodesis.errors import ArgumentError, InstrumentError, RecordingError
from tenodesis.instrument import FullForm, Instrument, ShortForm, expanded
from tenodesis.instrument.text import to_toml
from tenodesis.magnitude import rms
from tenodesis.recording import Recorder, Recording
from tenodesis.recording.schemas import TRANSFERRED
from tenodesis.run import SIGNALS, TENDONS, Array, Run, concatenate
from tenodesis.similarity import Comparison, JointComparison, compare, compare_joints
from tenodesis.simulate import Cycles, Protocol, execute
from tenodesis.statics import up_to_force
from tenodesis.twin import TIME_STEP, Twin

KEYS = (
    "length",
    "force",
    "tension",
    "torque",
    "handle_torque",
    "motor_stroke",
    "spool_angle",
    "spool_velocity",
    "time",
)
"""The factors, scaled-up over real-size, as in :attr:`tenodesis.similarity.Comparison.factors`."""
OF_JOINTS = ("moment", "grip_force")
"""Those that only instruments have whose joints and tendons are listed."""

QUANTITY = {
    "force": "force",
    "contact_force": "force",
    "contact_stiffness": "contact_stiffness",
    "contact_damping": "contact_damping",
    "estimated_force": "force",
    "estimated_force_std": "force",
    # A radial force bends the joint by its radius alone, as a tension does, and not by the end-effector's length.
    "radial_force": "tension",
    "measured_tension": "tension",
    # Of the same motor on the same spool.
    "measured_current": "tension",
    "tension": "tension",
    "distal_tension": "tension",
    "handle_torque": "handle_torque",
    "measured_spool_angle": "spool_angle",
    "spool_angle": "spool_angle",
    "commanded_spool_velocity": "spool_velocity",
    "commanded_spool_tension": "tension",
    "spool_velocity": "spool_velocity",
    "output_velocity": "output_velocity",
    "wrench": "wrench",
    "applied_grip_force": "grip_force",
    "grip_force": "grip_force",
    "held_opening": "length",
    "held_stiffness": "held_stiffness",
    "held_damping": "held_damping",
}
"""Factor of each signal that scales; the others are the same on both instruments: angles, ratios and states."""

ALL_JOINTS = "all joints"
"""Of the factors that hold for all of several joints."""


def as_built(inst: ShortForm) -> ShortForm:
    """Return a one-axis instrument with the true stiffness and pretension of its table mismatch."""
    mismatch = inst.mismatch
    if mismatch.stiffness_ratio == 1 and mismatch.pretension_ratio == 1:
        return inst
    return inst.replace(
        **{
            "tendon_stiffness": inst.tendon_stiffness * mismatch.stiffness_ratio,
            "pretension": inst.pretension * mismatch.pretension_ratio,
            "mismatch.stiffness_ratio": None,
            "mismatch.pretension_ratio": None,
            # The default inertia depends on the nominal stiffness.
            "dynamics.tip_inertia": plant.parameters(inst)["tip_inertia"],
        }
    )


def comparison(real_size: ShortForm, scaled_up: ShortForm) -> Comparison:
    """Return the comparison of two one-axis instruments as built, with their tables mismatch."""
    return compare(as_built(real_size), as_built(scaled_up))


def factors(compared: Comparison | JointComparison, time_factor: float | None = None) -> Mapping[str, Any]:
    """Return the factors of two instruments, scaled-up over real-size, by :data:`KEYS`, and those that follow.

    That is, of angular velocity, and of tissue that the tips bend into by the same angles; of several joints also of
    wrenches, and of what jaws hold.

    Raises ValueError if the time factor is not a number above 0.
    """
    found: dict[str, Any] = {key: compared.factors[key] for key in (*KEYS, *OF_JOINTS) if key in compared.factors}
    if time_factor is not None:
        if not 0 < time_factor < math.inf:
            raise ArgumentError(key="time_factor", value=time_factor, allowed="a number above 0")
        found["time"] = float(time_factor)
        found["spool_velocity"] = found["spool_angle"] / found["time"]
    # Force over the tip's way, whose factor is that of torque over force.
    stiffness = found["force"] ** 2 / found["torque"]
    found |= {
        "output_velocity": 1 / found["time"],
        "contact_stiffness": stiffness,
        "contact_damping": stiffness * found["time"],
    }
    if "moment" in found:
        held = found["grip_force"] / found["length"]
        found |= {
            "wrench": np.repeat([found["force"], found["moment"]], 3),
            "held_stiffness": held,
            "held_damping": held * found["time"],
        }
    return found


_T = TypeVar("_T", bound=Instrument)


def carry_friction(scaled: Instrument, real_size: _T, *, source: str = "", time_factor: float | None = None) -> _T:
    """Return the real-size instrument with the friction of the scaled-up instrument.

    Coefficients, bends and the arrangement of contacts stay the same, since capstan friction is dimensionless; constant
    friction scales as a tension; viscous friction, the speed and memory of the Stribeck law, the references of a power
    of the tension, vertex radius and bending stiffness scale by their dimensions. Only the table friction, where routes
    are listed their coefficients and wraps, and its source change; `source` is the file of the scaled-up instrument or
    recording, named in it. The factor of time is by default that of the tips' periods.

    Raises InstrumentError if the scaled-up instrument has no friction, no axis or another joint type in common, or the
    carried friction is not allowed.
    """
    if scaled.friction.law == "none":
        raise InstrumentError(
            f"{scaled.name} has no friction to transfer; its friction.law must not be none.",
            key="friction.law",
            value=scaled.friction.law,
            allowed="a law other than none",
        )
    changes: dict[str, Any] = {}
    if isinstance(scaled, ShortForm) and isinstance(real_size, ShortForm):
        axis = shared_axes(scaled, real_size)[0]
        scale = factors(comparison(real_size.axis(axis), scaled.axis(axis)), time_factor)
    else:
        scale = factors(compare_joints(real_size, scaled), time_factor)
        changes["tendons"] = _routed_as(expanded(scaled), expanded(real_size))
    sources = {key: text for key, text in real_size.sources.items() if key.partition(".")[0] != "friction"}
    sources["friction"] = f"transferred from {scaled.name}" + (f" ({source})" if source else "")
    return real_size.replace(friction=_scaled(scaled, scale), sources=sources, **changes)


def _routed_as(scaled: FullForm, real_size: FullForm) -> list[dict[str, Any]]:
    """Return the tendons of the real-size instrument with coefficients and wraps of the scaled-up one's routes."""
    tables = [tendon.model_dump(exclude_unset=True) for tendon in real_size.as_given("tendons")]
    for table, tendon in zip(tables, scaled.as_given("tendons"), strict=True):
        for row, crossing in zip(table["route"], tendon.route, strict=True):
            own = crossing.model_dump(include={"coefficient", "base_wrap", "guide_wrap"}, exclude_unset=True)
            row.update({key: value for key, value in own.items() if value is not None})
    return tables


def shared_axes(scaled: ShortForm, real_size: ShortForm) -> tuple[str, ...]:
    """Return the axes of the scaled-up instrument.

    Raises InstrumentError if the real-size one lacks one of them, or has another joint type.
    """
    if scaled.joint_type != real_size.joint_type:
        raise InstrumentError(
            f"{scaled.name} has joint_type {scaled.joint_type}, {real_size.name} {real_size.joint_type}; "
            "both must have the same.",
            key="joint_type",
            value=scaled.joint_type,
            allowed=real_size.joint_type,
        )
    for axis in scaled.axes:
        real_size.axis(axis)
    return scaled.axes


def left_behind(scaled: ShortForm) -> tuple[str, ...]:
    """Return sentences on entries of the scaled-up instrument's table mismatch that are not transferred."""
    mismatch = scaled.mismatch
    sentences = []
    if mismatch.stiffness_ratio != 1:
        sentences.append(
            f"{scaled.name} has mismatch.stiffness_ratio {mismatch.stiffness_ratio:g}: a property of its ropes, which "
            "is not transferred; the factors are those of its true ropes."
        )
    errors = {
        "handle_encoder_offset": f"{degrees(mismatch.handle_encoder_offset):.3g} deg",
        "output_encoder_offset": f"{degrees(mismatch.output_encoder_offset):.3g} deg",
        "load_cell_gain": f"{mismatch.load_cell_gain[0]:g} and {mismatch.load_cell_gain[1]:g}",
        "load_cell_bias": f"{mismatch.load_cell_bias[0]:g} N and {mismatch.load_cell_bias[1]:g} N",
    }
    defaults = type(mismatch)()
    found = [f"{key} {text}" for key, text in errors.items() if getattr(mismatch, key) != getattr(defaults, key)]
    if found:
        sentences.append(f"{scaled.name} has mismatch.{', '.join(found)}: measured signals are converted as measured.")
    return tuple(sentences)


def _scaled(scaled: Instrument, scale: Mapping[str, float]) -> dict[str, object]:
    """Return the table friction of the real-size file, without defaults and without keys that its law does not use."""
    friction = scaled.friction
    speed = scale["motor_stroke"] / scale["time"]
    by_dimension = {
        "constant": scale["tension"],
        "reference_tension": scale["tension"],
        "reference_radius": scale["length"],
        "vertex_radius": scale["length"],
        "tendon_bending_stiffness": scale["tension"] * scale["length"] ** 2,
        "viscous": scale["tension"] / speed,
        "stribeck_speed": speed,
        "memory": scale["time"],
    }
    of_law = {"stribeck": {"stribeck_speed", "memory"}, "capstan-power": {"reference_tension", "reference_radius"}}
    given = friction.model_dump(exclude_defaults=True).keys() - of_law["stribeck"]
    given |= of_law.get(friction.law, set())
    values = {key: getattr(friction, key) for key in type(friction).model_fields if key in given}
    return {key: value / by_dimension[key] if key in by_dimension else value for key, value in values.items()}


FACTORS = "transfer_factors"
"""Metadata key of the factors, by axis, as TOML."""
BEFORE = "scaled_up_"
"""Prefix of the keys of the original recording's metadata."""

_RENEWED = ("axes", "tenodesis", "python", "numpy")
"""Metadata that the recorder writes itself."""
_LOADS = ("force", "wrench", "tension", "distal_tension", "measured_tension")
_SAME = 0.01
"""Share by which a pretension or a ratio may differ and still count as the same."""


@dataclass(frozen=True)
class Carried:
    """A run in real-size units; :func:`carry` makes it."""

    run: Run
    """In real-size units; of blocks, the rows of the largest loads and the last."""
    real_size: Instrument
    """The real-size instrument with the axes of the run, and with the transferred friction if there is any."""
    scaled_up: Instrument
    """The scaled-up instrument of the original run."""
    comparisons: Mapping[str, Comparison | JointComparison]
    """Both instruments as built, by axis; of several joints one for all."""
    factors: Mapping[str, Mapping[str, Any]]
    """Scaled-up over real-size, by axis and key; of several joints for all."""
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
            FACTORS: tomli_w.dumps(
                {
                    axis: {key: np.asarray(value).tolist() for key, value in own.items()}
                    for axis, own in self.factors.items()
                }
            ),
        }

    @property
    def largest_force(self) -> float:
        """Largest force at the tip, N, tangential where axes have each their own; NaN if none was recorded."""
        if self.run.wrench is not None:
            return float(np.linalg.norm(self.run.wrench[:, :3], axis=1).max())
        return _largest(self.run, "force")

    @property
    def largest_tension(self) -> float:
        """Largest tension of a tendon, N; NaN if none was recorded."""
        return _largest(self.run, *_LOADS[2:])

    def similarity_error(self) -> float:
        """Return the largest similarity error up to the largest force, without friction, deg; NaN if no force."""
        if not self.largest_force > 0:
            return math.nan
        return max(_similarity_error(pair, self.largest_force) for pair in self.comparisons.values())

    def write(self, path: str | Path, *, overwrite: bool = False) -> None:
        """Write it as a recording, with the topics of the original.

        Raises RecordingError if the file cannot be written, or exists, or time steps shrink to less than 1 ns.
        """
        with Recorder(path, axes=self.run.names, metadata=self.metadata, overwrite=overwrite) as recorder:
            recorder.write(self.run)

    def write_blocks(self, runs: Iterable[Run], path: str | Path, *, overwrite: bool = False) -> tuple["Carried", int]:
        """Convert consecutive runs of the scaled-up instrument and write them; return what they are, and their rows.

        Raises as `write`.
        """
        kept: list[Run] = []
        rows = 0
        with Recorder(path, axes=self.run.names, metadata=self.metadata, overwrite=overwrite) as recorder:
            for run in runs:
                part = _divided(run, self.factors)
                recorder.write(part)
                kept = _peaks([*kept, *_peaks([part])])
                rows += len(run)
        return replace(self, run=concatenate(kept)), rows


def carry(
    source: Recording | Run,
    real_size: Instrument,
    *,
    scaled_up: Instrument | None = None,
    time_factor: float | None = None,
) -> Carried:
    """Convert a recording or run of a scaled-up instrument to real-size units.

    Angles and the controller's states stay the same; forces, tensions, torques, spool angles, velocities and time are
    divided by the similarity factors of their axis, between the instruments as built: with the true stiffness and
    pretension of their tables mismatch. A radial force is divided by the factor of tension. Where joints and tendons
    are listed, all joints have the factors of :class:`tenodesis.similarity.JointComparison`.

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
    if not len(run):
        raise RecordingError(f"{where} has no rows; there is nothing to convert.", key="rows", value=0)
    name = recording.path.name if recording else ""
    result = real_size
    if original.friction.law != "none":
        result = carry_friction(original, real_size, source=name, time_factor=time_factor)
    pairs: dict[str, Comparison | JointComparison]
    if isinstance(original, ShortForm) and isinstance(real_size, ShortForm) and isinstance(result, ShortForm):
        shared_axes(original, real_size)
        undivided = [one for one in run.signals() if SIGNALS[one].of in ("components", "run")]
        if undivided:
            raise RecordingError(
                f"{where} has {undivided[0]}, which is of no axis; it must have forces of its axes.",
                key=undivided[0],
                allowed="of the instrument's axes",
            )
        by_axis = {axis: comparison(real_size.axis(axis), original.axis(axis)) for axis in run.axes}
        warnings = _warnings(original, real_size, by_axis)
        pairs = {**by_axis}
        # Axes share one clock.
        time_factor = factors(by_axis[run.axes[0]], time_factor)["time"]
        result = result if result.axes == run.axes else result.axis(run.axes[0])
    else:
        pair = compare_joints(real_size, original)
        pairs, warnings = {ALL_JOINTS: pair}, _unlike_joints(pair)
    scale = {axis: factors(one, time_factor) for axis, one in pairs.items()}
    return Carried(
        _divided(run, scale),
        result,
        original,
        pairs,
        scale,
        (*(_damages(recording) if recording else ()), *warnings),
        name,
        recording.metadata if recording else None,
    )


def _unlike_joints(pair: JointComparison) -> list[str]:
    """Return warnings on groups of several joints that differ, and on friction that there is not."""
    real, scaled = pair.real_size.name, pair.scaled_up.name
    sentences = [
        f"{group.name} is {group.scaled_up:.4g} on {scaled} and {group.real_size:.4g} on {real}: {group.meaning}."
        for group in pair.groups
        if group.kind in ("elastic", "pretension") and not abs(group.ratio - 1) <= _SAME and group.real_size
    ]
    if pair.scaled_up.friction.law == "none":
        sentences.append(f"{scaled} has no friction to transfer: {real} keeps its own.")
    return sentences


def _scaled_up(recording: Recording | None, run: Run, given: Instrument | None, where: str) -> Instrument:
    if given is not None:
        inst = given
    elif recording is not None and "instrument" in recording.metadata:
        inst = recording.instrument()
    else:
        raise RecordingError(
            f"{where} does not contain its instrument; give the scaled-up instrument as well.",
            key="instrument",
            allowed="in the recording",
        )
    own = inst.axes if isinstance(inst, ShortForm) else tuple(joint.name for joint in inst.tip_joints)
    if own != run.axes:
        raise RecordingError(
            f"{where} has the axes {' and '.join(run.axes)}, {inst.name} {' and '.join(own)}; "
            "the scaled-up instrument must have the same.",
            key="axes",
            value=run.axes,
            allowed=" and ".join(own),
        )
    return inst


def _divided(run: Run, scale: Mapping[str, Mapping[str, Any]]) -> Run:
    """Return a run in real-size units by the factors of its axes."""
    carried: dict[str, Any] = {
        name: values / _by_axis([own[QUANTITY[name]] for own in scale.values()], name) if name in QUANTITY else values
        for name, values in run.signals().items()
    }
    return replace(run, time=run.time / next(iter(scale.values()))["time"], **carried)


def _peaks(runs: Sequence[Run]) -> list[Run]:
    """Return the rows with the largest loads, and the last, each as a run."""
    run = concatenate(runs)
    sizes = [np.abs(values).reshape(len(run), -1) for name, values in run.signals().items() if name in _LOADS]
    rows = {int(np.nan_to_num(size).max(axis=1).argmax()) for size in sizes} | {len(run) - 1}
    return [concatenate([run.rows(row, row + 1)]) for row in sorted(rows)]


def _by_axis(scales: list[Any], signal: str) -> Any:
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


def _similarity_error(pair: Comparison | JointComparison, force: float) -> float:
    """Return the largest error up to a force, without friction, with the pretensions as built, deg."""
    if isinstance(pair, Comparison):
        return pair.error(pretension=pair.scaled_up.pretension, largest_force=force).largest
    up_to = compare_joints(pair.real_size, pair.scaled_up, loads=up_to_force(pair.loads, force))
    return float(up_to.error(pretensions=pair.scaled_up.pretensions).largest.max())


SPEED = float(np.radians(40))
"""Speed of the scaled-up handle, rad/s."""


class RoundTrip(NamedTuple):
    """Output angles (rad) over the real-size handle angle (rad), each of shape (n,).

    `predicted` is by the scaled-up distal encoder, converted; `direct` is that of the real-size twin.
    """

    handle_angle: Array
    predicted: Array
    direct: Array

    @property
    def rms(self) -> float:
        """Root mean square of the difference, deg."""
        return rms(np.degrees(self.predicted - self.direct))

    @property
    def largest(self) -> float:
        """Largest difference, deg."""
        return float(np.degrees(np.abs(self.predicted - self.direct).max()))


def round_trip(
    real_size: ShortForm, scaled_up: ShortForm, force: float, *, amplitude: float, seed: int = 0
) -> RoundTrip:
    """Run two hysteresis cycles on the scaled-up twin, convert them, and run the real-size twin directly.

    The second cycle is returned: the first one still depends on the initial state of friction. Both instruments have
    one axis and their friction. The force acts on the scaled-up tip, N; the cycle ends at an unloaded output angle of
    `amplitude` (rad) on either side. Raises NoSolutionError if a tip is loaded past what it can hold.
    """
    cycles = Cycles(output_amplitude=amplitude, symmetric=True, speed=SPEED, count=2, force=force)
    run = execute(Twin(scaled_up, seed=seed), Protocol(name="cycles", phases=(cycles,)))
    carried = carry(run, real_size, scaled_up=scaled_up).run
    time = np.arange(1, int(carried.time[-1] / TIME_STEP)) * TIME_STEP
    handle, load = (np.interp(time, carried.time, carried[name]) for name in ("commanded_handle_angle", "force"))
    direct = Twin(real_size, seed=seed).run(handle, load)["output_angle"]
    predicted = np.interp(time, carried.time, carried["measured_output_angle"])
    turns = np.flatnonzero(handle <= handle.min() + np.radians(0.1))
    kept = slice(int(turns[turns < 0.8 * time.size][-1]), None)
    return RoundTrip(handle[kept], predicted[kept], direct[kept])

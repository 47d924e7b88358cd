"""The instrument's own twin as a model of its recordings, with exact derivatives through stick and slip."""

from collections.abc import Sequence
from math import degrees, pi, sqrt
from typing import Any

import numpy as np

from tenodesis import _core, plant
from tenodesis._core import Status
from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.instrument_run import TENDONS, InstrumentRun
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.models.twin_misplaced import Marginalised, marginalised
from tenodesis.identification.models.twin_runs import READINGS, Prepared, prepared
from tenodesis.identification.models.twin_unknowns import LARGEST_OFFSET, UNKNOWNS
from tenodesis.identification.problem import Parameter, Trace
from tenodesis.instrument import Instrument
from tenodesis.run import Array

DEFAULT_LAW = "capstan"

LONGEST_STEP = 2e-3
"""Time that samples are averaged over at most, s."""

_LAWS = ("none", "capstan", "capstan-constant", "stribeck")
_ROW = _core.twin_parameters()
_BIAS = 1.0
"""By how much a longer step may move the parameters altogether, in standard deviations."""
_COARSE = 0.5
"""Root mean square error above which it is not asked, in standard deviations of a step's mean reading."""
_SEEN = 1e-8
_LOST = 1e3
"""Residual of a sample that the model does not reach because its tip was lost, in standard deviations."""
_CELL = 5e-3
"""Share of its range by which a parameter may change before what errors of commands do is worked out anew."""
_CELLS_KEPT = 4
_FAR = 9.0
"""Mean square of residuals, in variances, above which parameters are far off and errors of commands do not count."""
_FAINT = 1e-4
"""Variance of a lasting error, over that of a reading, below which it is left out."""
_MOST_HANDLE = 0.9  # of the compliance that the joints leave over
_MOST_DAMPING = 2.0  # times the critical damping
_ANGLES = {"measured_handle_angle": "handle_angle_deg", "measured_output_angle": "output_angle_deg"}


class TwinProblem:
    """Recordings of an instrument, and its twin as their model.

    The handle is where it was commanded to be, or where its encoder says less its offset; the spools are where their
    encoders say. A run that does not begin at rest and straight is led there first.
    """

    def __init__(self, runs: Sequence[Measured], law: str, inst: Instrument) -> None:
        if law not in _LAWS:
            raise IdentificationError(
                f"law is {law!r}; allowed for recordings of an instrument are {', '.join(_LAWS)}."
            )
        # What the file says of its own errors is not known to who identifies them.
        self._inst = _under(law, inst.replace(mismatch=None))
        self._nominal = plant.parameters(self._inst) | {"hand_stiffness": 0.0}
        # An encoder that says too much may show a handle beyond its range.
        for run in runs:
            if np.abs(run["handle_angle"]).max() > inst.handle_range + LARGEST_OFFSET:
                raise IdentificationError(
                    f"{run.name}: the handle is at up to {degrees(np.abs(run['handle_angle']).max()):.4g} deg; allowed "
                    f"is the range of {inst.name}, ±{degrees(inst.handle_range):.4g} deg, and what an encoder may err "
                    "by: another instrument, or a wider handle_range."
                )
        kind, parameters, handle_range = self._inst.spec.__getstate__()
        self._spec = _core.Spec(kind, parameters, handle_range + 2 * LARGEST_OFFSET + 0.01)
        for run in runs:
            self._check_rate(run)
        finest = [prepared(run, self._inst, 1) for run in runs]
        given = {name for run in finest for name in run.measured}
        as_read = any(run.as_read for run in finest)
        spooled = any("spool_agonist" in run.columns for run in runs)
        self._names = [name for name in UNKNOWNS if _applies(name, law, given, spooled=spooled, as_read=as_read)]
        self._variables = [_ROW.index(UNKNOWNS[name].number) for name in self._names]
        stride = min(self._stride(run, fine) for run, fine in zip(runs, finest, strict=True))
        self._runs = finest if stride == 1 else [prepared(run, self._inst, stride) for run in runs]
        self._known: dict[int, dict[bytes, Marginalised]] = {}

    def _check_rate(self, run: Measured) -> None:
        longest = plant.longest_step(self._inst)
        if run.sample_time > longest * (1 + 1e-6):
            raise IdentificationError(
                f"{run.name} has a sample every {1e3 * run.sample_time:.3g} ms, too few for the tip of "
                f"{self._inst.name}, which swings at "
                f"{plant.natural_frequency(self._inst) / (2 * pi):.3g} Hz; allowed is at most {1e3 * longest:.3g} ms."
            )

    def _stride(self, run: Measured, finest: Prepared) -> int:
        """Return how many samples make the longest steps that hardly move what a fit would find."""
        longest = min(LONGEST_STEP, plant.longest_step(self._inst))
        stride = max(1, int(longest / run.sample_time * (1 + 1e-6)))
        if stride == 1:
            return 1
        numbers = [self._nominal[name] for name in _ROW]
        fine = self._run(finest, numbers, [])[:, 0, finest.lead :]
        while stride > 1:
            coarse = prepared(run, self._inst, stride)
            count = len(coarse.commands) - coarse.lead
            means = fine[:, : count * stride].reshape(len(READINGS), count, stride).mean(axis=2)
            rows = [READINGS.index(name) for name in coarse.measured]
            scale = sqrt(stride) / np.array([coarse.deviation[name] for name in coarse.measured])
            there = self._run(coarse, numbers, [])[:, 0, coarse.lead :]
            off = ((there - means)[rows] * scale[:, None]).ravel()
            known = np.isfinite(off)
            if known.any() and np.sqrt(np.mean(off[known] ** 2)) < _COARSE:
                slopes = self._run(coarse, numbers, self._variables)[rows, 1:, coarse.lead :] * scale[:, None, None]
                slopes = slopes.transpose(0, 2, 1).reshape(off.size, -1)[known]
                directions, sizes, _ = np.linalg.svd(slopes, full_matrices=False)
                if np.linalg.norm(directions[:, sizes > _SEEN * sizes.max()].T @ off[known]) < _BIAS:
                    break
            stride //= 2
        return stride

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The unknowns, starting from the instrument file."""
        out = []
        for name in self._names:
            one = UNKNOWNS[name]
            upper = one.upper
            if name == "handle_length_share":
                upper = min(upper, _MOST_HANDLE * (1 - sum(_core.joint_shares(self._inst.spec))))
            if name == "dynamics.tip_damping":
                critical = 2 * plant.natural_frequency(self._inst) * self._nominal["tip_inertia"]
                upper = _MOST_DAMPING * max(critical, self._nominal["tip_damping"])
            start = float(np.clip(self._nominal[one.number], one.lower, upper))
            out.append(Parameter(name, one.unit, start, one.lower, upper, one.meaning))
        return tuple(out)

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(run.name for run in self._runs)

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of parameters by group: stiffness, pretension, friction, sheath, drives, sensors, load_cells."""
        kinds = dict.fromkeys(UNKNOWNS[name].group for name in self._names)
        return {kind: tuple(name for name in self._names if UNKNOWNS[name].group == kind) for kind in kinds}

    def channels(self, run: int) -> int:
        """Return how many sensors the residuals of a run hold."""
        return len(self._runs[run].measured)

    def sample_time(self, run: int) -> float:
        """Return the time between residuals of a sensor, s."""
        return float(np.median(np.diff(self._runs[run].time)))

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus model, in standard deviations, one sensor after the other."""
        residuals = self._plain(self._model(values, run, [])[:, 0], run)
        return self._whitened(residuals, residuals, values, run)

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals by every parameter, exact through stick and slip."""
        return self.derivatives(values, run, range(len(self._names)))

    def derivatives(self, values: Array, run: int, which: Sequence[int]) -> Array:
        """Return the derivatives of the residuals by some parameters, given their indices, shape (n, how many)."""
        one = self._runs[run]
        model = self._model(values, run, [self._variables[index] for index in which])
        parts = [
            -np.nan_to_num(model[READINGS.index(name), 1:].T / one.deviation[name], nan=0.0) for name in one.measured
        ]
        return self._whitened(np.concatenate(parts), self._plain(model[:, 0], run), values, run)

    def lasting(self, values: Array, run: int) -> Array:
        """Return what lasting errors may do to residuals, one deviation each, (n, m).

        That is rounding that noise does not dither away, and what errors of commands do that is not linear in them.
        """
        one = self._runs[run]
        model = self._model(values, run, [])[:, 0]
        count, sensors = len(one.kept), list(one.sensors.items())
        waves = []
        for place, (name, sensor) in enumerate(sensors):
            for harmonic, size in enumerate(sensor.lasting, 1):
                if size > _FAINT * sensor.deviation**2:
                    turns = 2 * pi * harmonic / sensor.resolution * model[READINGS.index(name)]
                    for wave in (np.cos(turns), np.sin(turns)):
                        waves.append(np.zeros(count * len(sensors)))
                        waves[-1][place * count : (place + 1) * count] = sqrt(size) / sensor.deviation * wave
        plain = self._plain(model, run)
        near = self._near(plain, values, run)
        errors = np.nan_to_num(np.stack([np.zeros(plain.size), *waves], axis=1))
        return errors if near is None else near.whitened(np.concatenate([errors, near.bent], axis=1))

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus model: output_angle_deg where there is a distal encoder, tension_N of both tendons."""
        off = self._off(values, run)
        errors = {"tension_N": np.concatenate([off[f"tension_{tendon}"] for tendon in TENDONS])}
        if "measured_output_angle" in off:
            errors = {"output_angle_deg": np.degrees(off["measured_output_angle"])} | errors
        return errors

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return every sensor's signal beside the model's."""
        one = self._runs[run]
        off = self._off(values, run)
        traces = {}
        for name, measured in one.measured.items():
            scale = 180 / pi if name in _ANGLES else 1.0
            traces[_ANGLES.get(name, f"{name}_N")] = Trace(one.time, measured * scale, (measured - off[name]) * scale)
        return traces

    def instrument(self, values: Array) -> Instrument:
        """Return the instrument with these values in place, those that differ from its own."""
        # What follows from the stiffness unless it is given was not fitted, and stays.
        inst = self._inst.replace(**{"dynamics.tip_inertia": self._nominal["tip_inertia"]})
        inst = inst.replace(**{"dynamics.tip_damping": self._nominal["tip_damping"]})
        for one, value in zip(self.parameters, values, strict=True):
            if value != one.start:
                inst = inst.replace(**UNKNOWNS[one.name].changes(inst, float(value)))
        return inst

    def advice(self, names: Sequence[str]) -> str | None:
        """Return what recording would tell parameters apart, if one is known."""
        asked = set(names)
        if {"friction.sheath_coefficient", "friction.sheath_bend"} <= asked:
            return "A sheath's friction is its coefficient times its bend: record a run at another, measured bend."
        if any("load_cell" in name for name in asked) and {"stiffness_ratio", "pretension_ratio"} & asked:
            return "Record handle cycles under two or more known forces at the tip, and one with a tendon let slack."
        if "drives.backlash" in asked:
            return "Record reversals of the spools under low tension."
        if "handle_length_share" in asked:
            return "Record reversals of the spools as well as of the handle: they strain different shares of a tendon."
        if asked & {"friction.vertex_coefficient", "friction.sheath_coefficient", "friction.constant"}:
            return "Record cycles at two pretensions and both small and large handle angles, with common-mode pulls."
        return None

    def _plain(self, model: Array, run: int) -> Array:
        """Return measured minus model, given by reading and kept step, in standard deviations."""
        one = self._runs[run]
        parts = [(data - model[READINGS.index(name)]) / one.deviation[name] for name, data in one.measured.items()]
        return np.asarray(np.nan_to_num(np.concatenate(parts), nan=_LOST), dtype=np.float64)

    def _whitened(self, rows: Array, plain: Array, values: Array, run: int) -> Array:
        """Return rows, (n,) or (n, m), with the errors of commands within what encoders leave open marginalised."""
        near = self._near(plain, values, run)
        return rows if near is None else near.whitened(rows)

    def _near(self, plain: Array, values: Array, run: int) -> Marginalised | None:
        """Return what errors of commands do near some values.

        None where there are none, or where plain residuals tell that parameters are far off.
        """
        one = self._runs[run]
        if not one.misplaced or one.stride * np.mean(plain**2) > _FAR:
            return None
        width = np.array([parameter.upper - parameter.lower for parameter in self.parameters]) * _CELL
        near = np.round(values / width) * width
        known = self._known.setdefault(run, {})
        if near.tobytes() not in known:
            if len(known) >= _CELLS_KEPT:
                del known[next(iter(known))]
            known[near.tobytes()] = marginalised(one, lambda commands: self._expected(commands, near, run))
        return known[near.tobytes()]

    def _expected(self, commands: Array, values: Array, run: int) -> Array:
        """Return what the sensors of a run are expected to read, in standard deviations, one after the other."""
        one = self._runs[run]
        model = self._run(one._replace(commands=commands), self._numbers(values), [])[:, 0, one.kept]
        parts = [model[READINGS.index(name)] / sensor.deviation for name, sensor in one.sensors.items()]
        return np.asarray(np.nan_to_num(np.concatenate(parts)), dtype=np.float64)

    def _numbers(self, values: Array) -> list[float]:
        given = {UNKNOWNS[name].number: float(value) for name, value in zip(self._names, values, strict=True)}
        return [(self._nominal | given)[name] for name in _ROW]

    def _off(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus model by sensor; NaN from where the model's tip is lost."""
        model = self._model(values, run, [])[:, 0]
        return {name: data - model[READINGS.index(name)] for name, data in self._runs[run].measured.items()}

    def _model(self, values: Array, run: int, variables: Sequence[int]) -> Array:
        """Return what every sensor is expected to read and its derivatives, by reading, row and kept step."""
        one = self._runs[run]
        return self._run(one, self._numbers(values), variables)[:, :, one.kept]

    def _run(self, run: Prepared, numbers: list[float], variables: Sequence[int]) -> Array:
        numbers[_ROW.index("time_step")] = run.time_step
        friction = self._inst.friction
        spec = _core.TwinSpec(
            self._spec, numbers, friction.law == "stribeck", friction.sheath_contacts, 1, quasi_static=False
        )
        out = np.full((len(READINGS), 1 + len(variables), len(run.commands)), np.nan)
        _, status = _core.twin_gradient(spec, run.commands, run.as_read, list(variables), out)
        if status in (Status.NOT_FINITE, Status.OUT_OF_RANGE):
            raise IdentificationError(f"{run.name}: a command is not finite or beyond the handle's range.")
        return out


def problem(
    train: Sequence[Measured], test: Sequence[Measured], *, law: str, instrument: Instrument | None
) -> TwinProblem:
    """Return the problem of an instrument's recordings.

    Raises
    ------
    IdentificationError
        No instrument is known, or the law is none of the twin's.
    """
    runs = [*train, *test]
    known = [run.instrument for run in runs if isinstance(run, InstrumentRun) and run.instrument is not None]
    inst = instrument or (known[0] if known else None)
    if inst is None:
        raise IdentificationError(f"{runs[0].name} does not hold its instrument; give --instrument.")
    return TwinProblem(runs, law, inst.axis(inst.axes[0]) if inst.axes[1:] else inst)


def _applies(name: str, law: str, given: set[str], *, spooled: bool, as_read: bool) -> bool:
    """Return whether a recording of these sensors, under a law, has anything to do with a parameter."""
    if name.startswith("friction.") and law == "none":
        return False
    if name == "friction.constant":
        return law in ("capstan-constant", "stribeck")
    if name in ("friction.static_ratio", "friction.stribeck_speed"):
        return law == "stribeck"
    if name == "mismatch.output_encoder_offset":
        return "measured_output_angle" in given
    if name == "mismatch.handle_encoder_offset":
        return as_read or "measured_handle_angle" in given
    return name != "drives.backlash" or spooled


def _under(law: str, inst: Instrument) -> Instrument:
    if law == inst.friction.law:
        return inst
    if law == "none":
        return inst.replace(friction=None)
    changes: dict[str, Any] = {"friction.law": law}
    if law != "stribeck":
        changes["friction.static_ratio"] = None
    if law == "capstan":
        changes["friction.constant"] = None
    return inst.replace(**changes)

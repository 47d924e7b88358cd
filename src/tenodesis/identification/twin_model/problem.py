"""The instrument's own twin as a model of its recordings, with exact derivatives through stick and slip."""

from collections.abc import Callable, Sequence
from math import ceil, degrees, pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from tenodesis import _core, plant
from tenodesis._core import Status
from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.instrument_run import InstrumentRun
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Parameter, Problem
from tenodesis.identification.twin_model import tuning
from tenodesis.identification.twin_model.marginalise import Marginalisation, marginalise
from tenodesis.identification.twin_model.stepped import ChannelLabel, SteppedProblem
from tenodesis.identification.twin_model.steps import READINGS, SteppedRun, in_steps
from tenodesis.instrument import ShortForm
from tenodesis.instrument.compliance import compliance_shares
from tenodesis.magnitude import rms_of_finite
from tenodesis.run import TENDONS, Array


class TwinUnknown(NamedTuple):
    """A parameter of the twin: its name in the core, unit, bounds, meaning, changes to an instrument, and group."""

    number: str
    unit: str
    lower: float
    upper: float
    meaning: str
    changes: Callable[[ShortForm, float], dict[str, Any]]
    group: str


def _stiffness(inst: ShortForm, ratio: float) -> dict[str, Any]:
    if inst.given_stiffness is not None:
        return {"tendon_stiffness": inst.given_stiffness * ratio}
    return {"tendon_modulus": (inst.tendon_modulus or 0.0) * ratio}


def _pretension(inst: ShortForm, ratio: float) -> dict[str, Any]:
    return {"pretension": inst.pretension * ratio}


def _key(key: str) -> Callable[[ShortForm, float], dict[str, Any]]:
    return lambda _, value: {key: value}


def _of_pair(key: str, place: int) -> Callable[[ShortForm, float], dict[str, Any]]:
    def changes(inst: ShortForm, value: float) -> dict[str, Any]:
        pair = list(getattr(inst.mismatch, key))
        pair[place] = value
        return {f"mismatch.{key}": tuple(pair)}

    return changes


# The largest bend and coefficient together stay below the largest friction exponent that the core takes.
_KEYS = (
    ("friction.vertex_coefficient", "1", 0.0, 1.0, "friction coefficient at the joints", "friction"),
    ("friction.sheath_coefficient", "1", 0.0, 1.0, "friction coefficient in the sheath", "friction"),
    ("friction.sheath_bend", "rad", 0.0, 3 * pi, "total bend of the sheath", "sheath"),
    ("friction.base_wrap", "rad", 0.0, 1.0, "wrap angle of a joint when it is straight", "friction"),
    ("friction.load_index", "1", 0.3, 1.0, "power of the tension that friction grows with", "friction"),
    ("friction.constant", "N", 0.0, 20.0, "load-independent friction of each joint and of the sheath", "friction"),
    ("friction.static_ratio", "1", 1.0, 3.0, "static over kinetic friction coefficient", "friction"),
    ("friction.stribeck_speed", "m/s", 1e-5, 0.1, "slip speed at which static friction has vanished", "friction"),
    ("friction.viscous", "N*s/m", 0.0, 100.0, "viscous friction of each joint and of the sheath", "viscous"),
    ("dynamics.tip_damping", "N*m*s", 0.0, 1.0, "viscous damping of the tip", "viscous"),
    ("dynamics.tip_inertia", "kg*m^2", 1e-12, 1e3, "inertia about the output angle", "inertia"),
    ("drives.backlash", "rad", 0.0, 0.5, "backlash of the gearbox, at the spool", "drives"),
    ("drives.gear_efficiency", "1", 0.3, 1.0, "efficiency of the gearbox, as currents show it", "drives"),
    ("drives.friction_torque", "N*m", 0.0, 1.0, "friction of motor and gearbox, as currents show it", "drives"),
    ("mismatch.handle_encoder_offset", "rad", -0.3, 0.3, "offset of the handle's encoder", "sensors"),
    ("mismatch.output_encoder_offset", "rad", -0.3, 0.3, "offset of the distal encoder", "sensors"),
)
"""Key of an instrument file, unit, bounds, meaning and group of the parameters that are a key's value."""

UNKNOWNS = {
    "stiffness_ratio": TwinUnknown(
        "stiffness_ratio", "1", 0.2, 3.0, "true over nominal stiffness of the tendons", _stiffness, "stiffness"
    ),
    "handle_length_share": TwinUnknown(
        "handle_length_share",
        "1",
        0.02,
        0.8,
        "share of a tendon's compliance between spool and handle joint",
        _key("friction.handle_compliance_share"),
        "stiffness",
    ),
    "pretension_ratio": TwinUnknown(
        "pretension_ratio", "1", 0.1, 4.0, "true over nominal pretension", _pretension, "pretension"
    ),
    **{
        key: TwinUnknown(key.partition(".")[2], unit, lower, upper, meaning, _key(key), group)
        for key, unit, lower, upper, meaning, group in _KEYS
    },
    **{
        f"mismatch.load_cell_{kind}.{tendon}": TwinUnknown(
            f"{tendon}_load_cell_{kind}",
            unit,
            lower,
            upper,
            f"{kind} of the {tendon}'s load cell",
            _of_pair(f"load_cell_{kind}", place),
            "load_cells",
        )
        for kind, unit, lower, upper in (("gain", "1", 0.5, 2.0), ("bias", "N", -20.0, 20.0))
        for place, tendon in enumerate(TENDONS)
    },
}
"""Every parameter that recordings may identify, by name."""

SHOWN_BY_CURRENTS = ("drives.gear_efficiency", "drives.friction_torque")
"""Parameters that load cells beside the spools do not show."""

LARGEST_OFFSET = UNKNOWNS["mismatch.handle_encoder_offset"].upper


DEFAULT_LAW = "capstan"

LAWS = ("none", "capstan", "capstan-constant", "stribeck", "capstan-power")
"""Friction laws of the twin."""

_LAWS_OF = {
    "friction.constant": ("capstan-constant", "stribeck"),
    "friction.static_ratio": ("stribeck",),
    "friction.stribeck_speed": ("stribeck",),
    "friction.load_index": ("capstan-power",),
}
"""Friction laws that have a parameter, where not all have it."""

_ROW = _core.twin_parameters()
_ANGLES = {
    "measured_handle_angle": ChannelLabel("handle_angle_deg", "", 180 / pi),
    "measured_output_angle": ChannelLabel("output_angle_deg", "output_angle_deg", 180 / pi),
}


class TwinProblem(SteppedProblem):
    """Recordings of an instrument, and its twin as their model.

    The handle angle is the commanded one, or that of its encoder less its offset; spool angles are those of their
    encoders. A run that does not begin at rest and straight is led there first.
    """

    searches_near = 3

    def __init__(self, runs: Sequence[MeasuredRun], law: str, inst: ShortForm) -> None:
        if law not in LAWS:
            raise IdentificationError(
                key="law", value=law, allowed=f"one of {', '.join(LAWS)} for recordings of an instrument"
            )
        # What is identified stands in a mismatch of its own; the file's is where the search starts.
        self._inst = _under(law, inst.replace(mismatch=None))
        self._starts = plant.parameters(inst)
        self._nominal = plant.parameters(self._inst) | {"hand_stiffness": 0.0}
        for run in runs:
            self._check_range(run)
            self._check_rate(run)
        kind, parameters, handle_range = self._inst.spec.__getstate__()
        self._spec = _core.Spec(kind, parameters, handle_range + 2 * LARGEST_OFFSET + 0.01)
        finest = [in_steps(run, self._inst, 1) for run in runs]
        given = {name for run in finest for name in run.measured}
        handle_as_read = any(run.handle_as_read for run in finest)
        spooled = any("spool_agonist" in run.columns for run in runs)
        self._names = [
            name
            for name in UNKNOWNS
            if _applies(name, law, given, spooled=spooled, handle_as_read=handle_as_read)
            and (name != "friction.base_wrap" or self._inst.friction.base_wrap > 0)
            and (name not in SHOWN_BY_CURRENTS or self._inst.sensors.kind == "current")
        ]
        self._variables = [_ROW.index(UNKNOWNS[name].number) for name in self._names]
        self._measured, self._swiftness = runs, 1.0
        self._step(finest, [self._nominal[name] for name in _ROW])
        self.parameters = self._parameters()
        self.runs = tuple(run.name for run in self._runs)

    def _step(self, finest: list[SteppedRun], numbers: list[float]) -> None:
        """Put the recordings into steps that suit a twin."""
        stride = min(self._stride(run, fine, numbers) for run, fine in zip(self._measured, finest, strict=True))
        runs = finest if stride == 1 else [in_steps(run, self._inst, stride) for run in self._measured]
        longest = tuning.LONGEST_SHARE * plant.longest_step(self._inst) / self._swiftness
        self._runs = [run._replace(substeps=ceil(run.time_step / longest) if stride == 1 else 1) for run in runs]
        self._known: dict[int, dict[bytes, Marginalisation]] = {}
        self._held: dict[int, Marginalisation] = {}

    def _check_range(self, run: MeasuredRun) -> None:
        # an encoder with an offset may show a handle beyond its range
        largest, limit = float(np.abs(run["handle_angle"]).max()), self._inst.handle_range
        if largest > limit + LARGEST_OFFSET:
            raise IdentificationError(
                f"{run.name}: handle_angle is up to {degrees(largest):.4g} deg; it must be within the range of "
                f"{self._inst.name}, ±{degrees(limit):.4g} deg, but for an encoder's offset: another instrument, or a "
                "wider handle_range.",
                key="handle_angle",
                value=largest,
            )

    def _check_rate(self, run: MeasuredRun) -> None:
        longest = plant.longest_step(self._inst)
        if run.sample_time > longest * (1 + 1e-6):
            raise IdentificationError(
                f"{run.name} has a sample every {1e3 * run.sample_time:.3g} ms, too few for the tip of "
                f"{self._inst.name}, which oscillates at {plant.natural_frequency(self._inst) / (2 * pi):.3g} Hz; it "
                f"must be at most {1e3 * longest:.3g} ms.",
                key="sample_time",
                value=run.sample_time,
            )

    def _stride(self, run: MeasuredRun, finest: SteppedRun, numbers: list[float]) -> int:
        """Return how many samples make the longest steps that hardly move the parameters of a fit."""
        longest = min(tuning.LONGEST_STEP, plant.longest_step(self._inst) / self._swiftness)
        stride = max(1, int(longest / run.sample_time * (1 + 1e-6)))
        if stride == 1:
            return 1
        fine = self._run(finest, numbers, [])[:, 0, finest.lead :]
        while stride > 1:
            coarse = in_steps(run, self._inst, stride)
            count = len(coarse.commands) - coarse.lead
            means = fine[:, : count * stride].reshape(len(READINGS), count, stride).mean(axis=2)
            rows = [READINGS.index(name) for name in coarse.measured]
            scale = sqrt(stride) / np.array([coarse.deviation[name] for name in coarse.measured])
            there = self._run(coarse, numbers, [])[:, 0, coarse.lead :]
            off = ((there - means)[rows] * scale[:, None]).ravel()
            known = np.isfinite(off)
            if rms_of_finite(off) < tuning.COARSE_STEP:
                slopes = self._run(coarse, numbers, self._variables)[rows, 1:, coarse.lead :] * scale[:, None, None]
                slopes = slopes.transpose(0, 2, 1).reshape(off.size, -1)[known]
                directions, sizes, _ = np.linalg.svd(slopes, full_matrices=False)
                if (
                    np.linalg.norm(directions[:, sizes > tuning.UNSEEN_DIRECTION * sizes.max()].T @ off[known])
                    < tuning.STEP_BIAS
                ):
                    break
            stride //= 2
        return stride

    def _parameters(self) -> tuple[Parameter, ...]:
        """Return the unknowns, starting from the instrument file."""
        out = []
        for name in self._names:
            one = UNKNOWNS[name]
            lower, upper = one.lower, one.upper
            start = (self._starts if _of_mismatch(name) else self._nominal)[one.number]
            if name == "handle_length_share":
                shares = compliance_shares(self._inst)
                upper = min(
                    upper, tuning.MOST_HANDLE_SHARE * (1 - (shares.handle_joint + shares.tip_joint) - shares.anchor)
                )
            if name == "dynamics.tip_damping":
                critical = 2 * plant.natural_frequency(self._inst) * self._nominal["tip_inertia"]
                upper = tuning.MOST_DAMPING * max(critical, self._nominal["tip_damping"])
            if name == "dynamics.tip_inertia":
                lower, upper = start / tuning.INERTIA_RATIO, start * tuning.INERTIA_RATIO
            out.append(
                Parameter(name, one.unit, float(np.clip(start, lower, upper)), lower, upper, one.meaning, one.group)
            )
        return tuple(out)

    def sensors(self, run: int) -> tuple[str, ...]:
        """Return what these sensors are called."""
        return tuple(name.removeprefix("measured_").replace("_", " ") for name in self._runs[run].measured)

    def residuals_near(self, values: Array, run: int, other: Problem, there: Array) -> Array:
        """Return the residuals, (n,), whitened as those of another model of the same recordings are near its values."""
        if not isinstance(other, TwinProblem) or other._runs[run].stride != self._runs[run].stride:
            return self.residuals(values, run)
        return other._whitened(self.plain_residuals(values, run), other.plain_residuals(there, run), there, run)

    def refine(self, values: Array, runs: Sequence[int]) -> bool:
        """Marginalise errors of commands near some values, and no longer as values change.

        What follows the values in a search draws it to where errors of commands have larger effects, for these
        explain more. Where the tip turns out to swing faster, steps are shortened as well.
        """
        given = dict(zip(self._names, values.tolist(), strict=True))
        inertia = given["dynamics.tip_inertia"] / self._nominal["tip_inertia"]
        swiftness = sqrt(given["stiffness_ratio"] / inertia)
        finer = swiftness > tuning.SWIFTER * self._swiftness and any(
            one.stride > 1 or one.substeps > 1 for one in self._runs
        )
        if finer:
            self._swiftness = swiftness
            self._step([in_steps(run, self._inst, 1) for run in self._measured], self._numbers(values))
        for run in runs:
            if self._runs[run].input_errors:
                self._held[run] = self._marginalised(values, run)
        return finer or any(run in self._held for run in runs)

    def sensor_noise(self, run: int) -> tuple[float, ...]:
        """Return the standard deviation of the residuals of each sensor of a perfect model."""
        one = self._runs[run]
        return tuple(
            one.sensors[name].deviation_of_mean(one.stride) / one.sensors[name].deviation for name in one.measured
        )

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus model, in standard deviations, one sensor after the other."""
        residuals = self.plain_residuals(values, run)
        return self._whitened(residuals, residuals, values, run)

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals by every parameter, exact through stick and slip."""
        return self.derivatives(values, run, range(len(self._names)))

    def derivatives(self, values: Array, run: int, which: Sequence[int]) -> Array:
        """Return the derivatives of the residuals by some parameters, given their indices, shape (n, how many)."""
        model, slopes = self._differentiated(values, run, which)
        return self._whitened(slopes, self._plain(_by_name(model[:, 0]), run), values, run)

    def plain_derivatives(self, values: Array, run: int, which: Sequence[int]) -> Array:
        """Return those of the residuals with errors of commands included, as :meth:`plain_residuals` has them."""
        return self._differentiated(values, run, which)[1]

    def begins_known(self, run: int) -> bool:
        """Return whether a run begins at rest, or what came before has no effect on what is compared."""
        one = self._runs[run]
        return one.lead == 0 or int(one.kept[0]) > one.lead

    def _differentiated(self, values: Array, run: int, which: Sequence[int]) -> tuple[Array, Array]:
        """Return the model of a run, and the derivatives of the residuals by some parameters."""
        model = self._model(values, run, [self._variables[index] for index in which])
        return model, -np.nan_to_num(self._scaled(_by_name(model[:, 1:].swapaxes(1, 2)), run), nan=0.0)

    def systematic_errors(self, values: Array, run: int) -> Array:
        """Return the effects of systematic errors on residuals, one deviation each, (n, m).

        They are rounding that noise does not average out, and nonlinear effects of errors of the commands.
        """
        one = self._runs[run]
        model = self._model(values, run, [])[:, 0]
        count, sensors = len(one.kept), list(one.sensors.items())
        waves = []
        for place, (name, sensor) in enumerate(sensors):
            for number, size in sensor.harmonics(sensor.deviation**2):
                turns = number * model[READINGS.index(name)]
                for wave in (np.cos(turns), np.sin(turns)):
                    waves.append(np.zeros(count * len(sensors)))
                    waves[-1][place * count : (place + 1) * count] = sqrt(size) / sensor.deviation * wave
        plain = self._plain(_by_name(model), run)
        near = self._marginalisation(plain, values, run)
        errors = np.nan_to_num(np.stack([np.zeros(plain.size), *waves], axis=1))
        return errors if near is None else near.whitened(np.concatenate([errors, near.nonlinear], axis=1))

    def instrument(self, values: Array) -> ShortForm:
        """Return the instrument with these values in place, those that differ from its own."""
        # by default inertia and damping follow from the stiffness, which may change here
        inst = self._inst.replace(**{"dynamics.tip_inertia": self._nominal["tip_inertia"]})
        inst = inst.replace(**{"dynamics.tip_damping": self._nominal["tip_damping"]})
        for one, value in zip(self.parameters, values, strict=True):
            own = self._nominal[UNKNOWNS[one.name].number] if _of_mismatch(one.name) else one.start
            if value != own:
                inst = inst.replace(**UNKNOWNS[one.name].changes(inst, float(value)))
        return inst

    def advice(self, names: Sequence[str]) -> str | None:
        """Return which recording would make these parameters identifiable, if known."""
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

    def _whitened(self, rows: Array, plain: Array, values: Array, run: int) -> Array:
        """Return rows, (n,) or (n, m), with the errors that encoders leave in commands marginalised out."""
        near = self._marginalisation(plain, values, run)
        return rows if near is None else near.whitened(rows)

    def _marginalisation(self, plain: Array, values: Array, run: int) -> Marginalisation | None:
        """Return how errors of commands are marginalised out near some values.

        None where there are none, or where plain residuals show that parameters are far off.
        """
        if run in self._held:
            return self._held[run]
        one = self._runs[run]
        if not one.input_errors or self._far(plain, run):
            return None
        width = np.array([parameter.upper - parameter.lower for parameter in self.parameters]) * tuning.CELL
        near = np.round(values / width) * width
        known = self._known.setdefault(run, {})
        if near.tobytes() not in known:
            if len(known) >= tuning.CELLS_KEPT:
                del known[next(iter(known))]
            known[near.tobytes()] = self._marginalised(near, run)
        return known[near.tobytes()]

    def _marginalised(self, values: Array, run: int) -> Marginalisation:
        return marginalise(self._runs[run], lambda commands: self._expected(commands, values, run))

    def _far(self, plain: Array, run: int) -> bool:
        return bool(self._runs[run].stride * np.mean(plain**2) > tuning.FAR)

    def _expected(self, commands: Array, values: Array, run: int) -> Array:
        """Return the model's sensor readings of a run, in standard deviations, one sensor after the other."""
        one = self._runs[run]
        model = self._run(one._replace(commands=commands), self._numbers(values), [])[:, 0, one.kept]
        return np.asarray(np.nan_to_num(self._scaled(_by_name(model), run)), dtype=np.float64)

    def _readings(self, values: Array, run: int) -> dict[str, Array]:
        return _by_name(self._model(values, run, [])[:, 0])

    def _shown(self, channel: str) -> ChannelLabel:
        return _ANGLES.get(channel) or ChannelLabel(f"{channel}_N", "tension_N")

    def _numbers(self, values: Array) -> list[float]:
        given = {UNKNOWNS[name].number: float(value) for name, value in zip(self._names, values, strict=True)}
        return [(self._nominal | given)[name] for name in _ROW]

    def _model(self, values: Array, run: int, variables: Sequence[int]) -> Array:
        """Return the model's sensor readings and their derivatives, by reading, row and kept step."""
        one = self._runs[run]
        return self._run(one, self._numbers(values), variables)[:, :, one.kept]

    def _run(self, run: SteppedRun, numbers: list[float], variables: Sequence[int]) -> Array:
        numbers[_ROW.index("time_step")] = run.time_step / run.substeps
        spec = plant.core_spec(self._inst, self._spec, numbers, 1, quasi_static=False)
        commands = run.fine_commands
        out = np.full((len(READINGS), 1 + len(variables), len(commands)), np.nan)
        _, status = _core.twin_gradient(spec, commands, run.handle_as_read, list(variables), out)
        if status in (Status.NOT_FINITE, Status.OUT_OF_RANGE):
            raise IdentificationError(
                f"{run.name}: a command is not finite or beyond the handle's range.", key="handle_angle"
            )
        return out[:, :, run.substeps - 1 :: run.substeps]


def problem(
    train: Sequence[MeasuredRun], test: Sequence[MeasuredRun], *, law: str, instrument: ShortForm | None
) -> TwinProblem:
    """Return the problem of an instrument's recordings.

    Raises IdentificationError if no instrument is known, or the law is none of the twin's.
    """
    runs = [*train, *test]
    return TwinProblem(runs, law, instrument_of(runs, instrument).planar[0])


def instrument_of(runs: Sequence[MeasuredRun], given: ShortForm | None) -> ShortForm:
    """Return the given instrument, or that of the first recording that contains one, without its mismatch.

    Raises IdentificationError if none does.
    """
    if given is not None:
        return given
    known = [run.instrument for run in runs if isinstance(run, InstrumentRun) and run.instrument is not None]
    if not known:
        raise IdentificationError(f"{runs[0].name} contains no planar instrument; give --instrument.", key="instrument")
    # that of a recorded twin is the truth
    return known[0].replace(mismatch=None)


def _by_name(readings: Array) -> dict[str, Array]:
    return dict(zip(READINGS, readings, strict=True))


def _applies(name: str, law: str, given: set[str], *, spooled: bool, handle_as_read: bool) -> bool:
    """Return whether recordings of these sensors, under a friction law, can depend on a parameter."""
    if name.startswith("friction."):
        return law != "none" and law in _LAWS_OF.get(name, LAWS)
    if name == "mismatch.output_encoder_offset":
        return "measured_output_angle" in given
    if name == "mismatch.handle_encoder_offset":
        return handle_as_read or "measured_handle_angle" in given
    return name != "drives.backlash" or spooled


def _of_mismatch(name: str) -> bool:
    """Return whether an instrument file has a parameter in its table [mismatch]."""
    return name.startswith("mismatch.") or name in {"stiffness_ratio", "pretension_ratio"}


def _under(law: str, inst: ShortForm) -> ShortForm:
    if law == inst.friction.law:
        return inst
    if law == "none":
        return inst.replace(friction=None)
    changes: dict[str, Any] = {"friction.law": law}
    if law != "stribeck":
        changes["friction.static_ratio"] = None
    if law == "capstan":
        changes["friction.constant"] = None
    if law != "capstan-power":
        changes["friction.load_index"] = None
    return inst.replace(**changes)

"""The instrument's own twin as a model of its recordings, with exact derivatives through stick and slip."""

from collections.abc import Callable, Sequence
from math import pi, sqrt
from typing import Any, NamedTuple

import numpy as np

from tenodesis import _core, twin
from tenodesis._core import Status
from tenodesis.errors import IdentificationError
from tenodesis.identification.formats.mcap import TENDONS, InstrumentRun
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.problem import Parameter, Trace
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

DEFAULT_LAW = "capstan"

STEP = 2e-3
"""Time step, s, that samples are averaged over, or less for a tip that swings fast."""

_LAWS = ("none", "capstan", "capstan-constant", "stribeck")
_ROW = _core.twin_parameters()
_COMMANDS = _core.twin_commands()
_READINGS = ("measured_handle_angle", "measured_output_angle", "tension_agonist", "tension_antagonist")
"""What the core tells of a twin's sensors, in its order."""

_LOST = 1e3
"""Residual of a sample that the model does not reach because its tip was lost, in standard deviations."""


class _Unknown(NamedTuple):
    """One number of a twin: its name in the core, unit, bounds, meaning, and what it does to an instrument."""

    number: str
    unit: str
    lower: float
    upper: float
    meaning: str
    changes: Callable[[Instrument, float], dict[str, Any]]
    group: str


def _stiffness(inst: Instrument, ratio: float) -> dict[str, Any]:
    if inst.given_stiffness is not None:
        return {"tendon_stiffness": inst.given_stiffness * ratio}
    return {"tendon_modulus": (inst.tendon_modulus or 0.0) * ratio}


def _key(key: str) -> Callable[[Instrument, float], dict[str, Any]]:
    return lambda _, value: {key: value}


def _of_pair(key: str, place: int) -> Callable[[Instrument, float], dict[str, Any]]:
    def changes(inst: Instrument, value: float) -> dict[str, Any]:
        pair = list(getattr(inst.mismatch, key))
        pair[place] = value
        return {f"mismatch.{key}": tuple(pair)}

    return changes


_UNKNOWNS = {
    "stiffness_ratio": _Unknown(
        "stiffness_ratio", "1", 0.2, 3.0, "true over nominal stiffness of the tendons", _stiffness, "stiffness"
    ),
    "handle_length_share": _Unknown(
        "handle_length_share",
        "1",
        0.02,
        0.8,
        "share of a tendon's compliance between spool and handle joint",
        lambda *_: {},
        "stiffness",
    ),
    "pretension_ratio": _Unknown(
        "pretension_ratio",
        "1",
        0.1,
        4.0,
        "true over nominal pretension",
        lambda inst, ratio: {"pretension": inst.pretension * ratio},
        "pretension",
    ),
    "friction.vertex_coefficient": _Unknown(
        "vertex_coefficient",
        "1",
        0.0,
        1.0,
        "friction coefficient at the joints",
        _key("friction.vertex_coefficient"),
        "friction",
    ),
    "friction.sheath_coefficient": _Unknown(
        "sheath_coefficient",
        "1",
        0.0,
        1.0,
        "friction coefficient in the sheath",
        _key("friction.sheath_coefficient"),
        "friction",
    ),
    "friction.sheath_bend": _Unknown(
        "sheath_bend", "rad", 0.0, 4 * pi, "total bend of the sheath", _key("friction.sheath_bend"), "sheath"
    ),
    "friction.constant": _Unknown(
        "constant",
        "N",
        0.0,
        20.0,
        "load-independent friction of each joint and of the sheath",
        _key("friction.constant"),
        "friction",
    ),
    "friction.viscous": _Unknown(
        "viscous",
        "N*s/m",
        0.0,
        100.0,
        "viscous friction of each joint and of the sheath",
        _key("friction.viscous"),
        "viscous",
    ),
    "dynamics.tip_damping": _Unknown(
        "tip_damping", "N*m*s", 0.0, 1.0, "viscous damping of the tip", _key("dynamics.tip_damping"), "viscous"
    ),
    "drives.backlash": _Unknown(
        "backlash", "rad", 0.0, 0.5, "backlash of the gearbox, at the spool", _key("drives.backlash"), "drives"
    ),
    "mismatch.handle_encoder_offset": _Unknown(
        "handle_encoder_offset",
        "rad",
        -0.3,
        0.3,
        "what the handle's encoder says too much",
        _key("mismatch.handle_encoder_offset"),
        "sensors",
    ),
    "mismatch.output_encoder_offset": _Unknown(
        "output_encoder_offset",
        "rad",
        -0.3,
        0.3,
        "what the distal encoder says too much",
        _key("mismatch.output_encoder_offset"),
        "sensors",
    ),
    **{
        f"mismatch.load_cell_{kind}.{tendon}": _Unknown(
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
"""Every number that recordings may be asked for, by name."""


class _Prepared(NamedTuple):
    """One run averaged over steps: the core's commands, and what was measured by reading."""

    name: str
    time: Array
    time_step: float
    commands: Array
    measured: dict[str, Array]
    as_read: bool


class TwinProblem:
    """Recordings of an instrument, and its twin as their model.

    The handle is where it was commanded to be, or where its encoder says less its offset; the spools are where their
    encoders say.
    """

    def __init__(self, runs: Sequence[Measured], law: str, inst: Instrument) -> None:
        if law not in _LAWS:
            raise IdentificationError(
                f"law is {law!r}; allowed for recordings of an instrument are {', '.join(_LAWS)}."
            )
        # What the file says of its own errors is not known to who identifies them.
        self._inst = _under(law, inst.replace(mismatch=None))
        self._runs = [_prepared(run, self._inst) for run in runs]
        self._nominal = twin.numbers(self._inst, STEP)
        given = {name for run in self._runs for name in run.measured}
        spooled = any("spool_agonist" in run.columns for run in runs)
        self._names = [name for name in _UNKNOWNS if self._applies(name, law, given, spooled)]
        self._variables = [_ROW.index(_UNKNOWNS[name].number) for name in self._names]
        self._sigma = _deviations(self._inst)

    def _applies(self, name: str, law: str, given: set[str], spooled: bool) -> bool:
        if name.startswith("friction.") and law == "none":
            return False
        if name == "friction.constant":
            return law in ("capstan-constant", "stribeck")
        if name == "mismatch.output_encoder_offset":
            return "measured_output_angle" in given
        if name == "mismatch.handle_encoder_offset":
            return "measured_handle_angle" in given or any(run.as_read for run in self._runs)
        return name != "drives.backlash" or spooled

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """The unknowns, starting from the instrument file."""
        return tuple(
            Parameter(
                name,
                one.unit,
                float(np.clip(self._nominal[one.number], one.lower, one.upper)),
                one.lower,
                one.upper,
                one.meaning,
            )
            for name, one in ((name, _UNKNOWNS[name]) for name in self._names)
        )

    @property
    def runs(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(run.name for run in self._runs)

    @property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of parameters by group: stiffness, pretension, friction, sheath, drives, sensors, load_cells."""
        kinds = dict.fromkeys(_UNKNOWNS[name].group for name in self._names)
        return {kind: tuple(name for name in self._names if _UNKNOWNS[name].group == kind) for kind in kinds}

    def channels(self, run: int) -> int:
        """Return how many sensors the residuals of a run hold."""
        return len(self._runs[run].measured)

    def sample_time(self, run: int) -> float:
        """Return the time between samples, s."""
        return self._runs[run].time_step

    def residuals(self, values: Array, run: int) -> Array:
        """Return measured minus model, in standard deviations, one sensor after the other."""
        one = self._runs[run]
        model = self._model(values, run, [])[:, 0]
        return np.concatenate(
            [self._scaled(name, measured - model[_READINGS.index(name)]) for name, measured in one.measured.items()]
        )

    def jacobian(self, values: Array, run: int) -> Array:
        """Return the derivatives of the residuals, exact through stick and slip."""
        one = self._runs[run]
        model = self._model(values, run, self._variables)[:, 1:]
        parts = [-np.nan_to_num(model[_READINGS.index(name)].T / self._sigma[name], nan=0.0) for name in one.measured]
        return np.concatenate(parts)

    def errors(self, values: Array, run: int) -> dict[str, Array]:
        """Return measured minus model: output_angle_deg where there is a distal encoder, tension_N of both tendons."""
        one = self._runs[run]
        model = self._model(values, run, [])[:, 0]
        off = {name: measured - model[_READINGS.index(name)] for name, measured in one.measured.items()}
        errors = {"tension_N": np.concatenate([off[f"tension_{tendon}"] for tendon in TENDONS])}
        if "measured_output_angle" in off:
            errors = {"output_angle_deg": np.degrees(off["measured_output_angle"])} | errors
        return errors

    def traces(self, values: Array, run: int) -> dict[str, Trace]:
        """Return every sensor's signal beside the model's."""
        one = self._runs[run]
        model = self._model(values, run, [])[:, 0]
        names = {"measured_output_angle": "output_angle_deg", "measured_handle_angle": "handle_angle_deg"}
        traces = {}
        for name, measured in one.measured.items():
            degrees = 180 / pi if name in names else 1.0
            expected = model[_READINGS.index(name)] * degrees
            traces[names.get(name, f"{name}_N")] = Trace(one.time, measured * degrees, expected)
        return traces

    def instrument(self, values: Array) -> Instrument:
        """Return the instrument with these values in place; a share of compliance has no key of its own."""
        inst = self._inst
        for name, value in zip(self._names, values, strict=True):
            changes = _UNKNOWNS[name].changes(inst, float(value))
            if changes:
                inst = inst.replace(**changes)
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

    def _scaled(self, name: str, off: Array) -> Array:
        return np.nan_to_num(off / self._sigma[name], nan=_LOST)

    def _model(self, values: Array, run: int, variables: Sequence[int]) -> Array:
        """Return what every sensor is expected to read and its derivatives, by reading, row and step."""
        one = self._runs[run]
        numbers = [self._nominal[name] for name in _ROW]
        for name, value in zip(self._names, values, strict=True):
            numbers[_ROW.index(_UNKNOWNS[name].number)] = float(value)
        numbers[_ROW.index("time_step")] = one.time_step
        inst = self._inst
        spec = _core.TwinSpec(
            inst.spec, numbers, inst.friction.law == "stribeck", inst.friction.sheath_contacts, 1, False
        )
        out = np.full((len(_READINGS), 1 + len(variables), one.commands.shape[0]), np.nan)
        _, status = _core.twin_gradient(spec, one.commands, one.as_read, list(variables), out)
        if status in (Status.NOT_FINITE, Status.OUT_OF_RANGE):
            raise IdentificationError(
                f"{one.name}: the handle was beyond the range of {inst.name}; allowed is another instrument, or one with "
                "a wider handle_range."
            )
        return out


def problem(
    train: Sequence[Measured], test: Sequence[Measured], *, law: str, instrument: Instrument | None
) -> TwinProblem:
    """Return the problem of an instrument's recordings.

    Raises
    ------
    IdentificationError
        No instrument is known, it has two axes, or the law is none of the twin's.
    """
    runs = [*train, *test]
    known = [run.instrument for run in runs if isinstance(run, InstrumentRun) and run.instrument is not None]
    inst = instrument or (known[0] if known else None)
    if inst is None:
        raise IdentificationError(f"{runs[0].name} does not hold its instrument; give --instrument.")
    return TwinProblem(runs, law, inst.axis(inst.axes[0]) if inst.axes[1:] else inst)


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


def _prepared(run: Measured, inst: Instrument) -> _Prepared:
    """Average a run over steps; samples that were dropped are bridged."""
    longest = min(STEP, twin.longest_step(inst))
    stride = max(1, int(longest / run.sample_time * (1 + 1e-6)))
    if run.sample_time > longest * (1 + 1e-6):
        raise IdentificationError(
            f"{run.name} has a sample every {1e3 * run.sample_time:.3g} ms, too few for the tip of {inst.name}, which "
            f"swings at {twin.swing(inst) / (2 * pi):.3g} Hz; allowed is at most {1e3 * longest:.3g} ms."
        )
    step = stride * run.sample_time
    edges = np.arange(run.time[0], run.time[-1] + step / 2, step)
    count = edges.size - 1
    place = np.minimum(np.searchsorted(edges, run.time, side="right") - 1, count - 1)
    weights = np.bincount(place, minlength=count)

    def mean(column: Array) -> Array:
        sums = np.bincount(place, column, minlength=count)
        filled = weights > 0
        middles = (edges[:-1] + edges[1:]) / 2
        averaged: Array = np.interp(middles, middles[filled], sums[filled] / weights[filled])
        return averaged

    commands = np.zeros((count, len(_COMMANDS)))
    commands[:, _COMMANDS.index("handle_angle")] = mean(run["handle_angle"])
    if "force" in run.columns:
        commands[:, _COMMANDS.index("force")] = mean(run["force"])
    for tendon in TENDONS:
        if f"spool_{tendon}" in run.columns:
            wound = inst.drives.spool_radius * mean(run[f"spool_{tendon}"])
            commands[:, _COMMANDS.index(f"{tendon}_let_out")] = -wound
    as_read = "measured_handle_angle" not in run.columns or np.array_equal(
        run["measured_handle_angle"], run["handle_angle"]
    )
    told = [name for name in _READINGS if name in run.columns and not (as_read and name == "measured_handle_angle")]
    return _Prepared(
        run.name, (edges[:-1] + edges[1:]) / 2, step, commands, {name: mean(run[name]) for name in told}, as_read
    )


def _deviations(inst: Instrument) -> dict[str, float]:
    """Return the standard deviation of a reading of every sensor, with its steps."""
    sensors = inst.sensors
    encoder = sqrt(sensors.encoder_noise**2 + (sensors.encoder_range / 2**sensors.encoder_bits) ** 2 / 12)
    cell = sqrt(sensors.load_cell_noise**2 + (2 * sensors.load_cell_range / 2**sensors.load_cell_bits) ** 2 / 12)
    return {
        "measured_handle_angle": encoder,
        "measured_output_angle": encoder,
        **{f"tension_{tendon}": cell for tendon in TENDONS},
    }

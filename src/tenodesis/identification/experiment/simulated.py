"""The experiment on the twin: it runs protocols, whose derivatives predict how well they identify parameters."""

import math
from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from tenodesis import plant, twin
from tenodesis.control.parameters import tension_limit
from tenodesis.errors import Error, NoSolutionError, ProtocolError
from tenodesis.identification.experiment.candidates import Phase
from tenodesis.identification.experiment.information import Information, converters, information
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Parameter, scales
from tenodesis.identification.twin_model.problem import TwinProblem
from tenodesis.identification.twin_model.tuning import LONGEST_STEP
from tenodesis.instrument import ShortForm
from tenodesis.run import TENDONS, Array, Run
from tenodesis.simulate import Protocol

_OFF = ((0.8, 0.8), (1.2, 1.2))
"""Stiffness and pretension, over the file's, with which a protocol must run as well."""
_CANDIDATE = "candidate"
_COARSE = 2.0
"""Largest RMS error of longer steps, in standard deviations of a sample."""


class InfeasibleProtocolError(Error):
    """A protocol that the instrument cannot run; the message is a short reason."""


class SimulatedExperiment:
    """A one-axis instrument with its sensors, on which protocols are run.

    The mismatch of the instrument's file is left out; `law` is the friction law of the model.
    """

    def __init__(self, inst: ShortForm, law: str, *, distal_encoder: bool) -> None:
        self.inst = inst.replace(mismatch=None)
        self.law = law
        self.distal_encoder = distal_encoder
        self.time_step = _time_step(inst)
        self._sensors = converters(self.inst)
        self._limit = tension_limit(self.inst)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All unknowns of the model, starting from the file."""
        return self._still.parameters

    @cached_property
    def groups(self) -> Mapping[str, tuple[str, ...]]:
        """Names of parameters by group."""
        return self._still.groups

    @cached_property
    def values(self) -> Array:
        """The file's values of all parameters."""
        return np.array([one.start for one in self.parameters])

    @cached_property
    def scale(self) -> Array:
        """Unit of the changes of each parameter, shape (parameters,)."""
        return scales(self.parameters, self.values)

    def run(self, phases: Sequence[Phase]) -> Run:
        """Return the twin's response.

        Raises InfeasibleProtocolError if the protocol is beyond a range, loses the tip, or exceeds the tension limit,
        with the file's stiffness and pretension or with both a fifth off.
        """
        try:
            commands = Protocol(name=_CANDIDATE, phases=tuple(phases)).commands(self.inst, self.time_step)
        except ProtocolError as problem:
            raise InfeasibleProtocolError(str(problem).removeprefix(f"{_CANDIDATE}: ").rstrip(".")) from None
        runs = [self._run(self.inst, commands)]
        for stiffness, pretension in _OFF:
            changes = {"mismatch.stiffness_ratio": stiffness, "mismatch.pretension_ratio": pretension}
            self._run(self.inst.replace(**changes), commands)
        return runs[0]

    def information(self, run: Run, until: Sequence[float] = (math.inf,)) -> tuple[TwinProblem, list[Information]]:
        """Return the model of a run, and its information on all parameters until some times (s).

        Only every n-th sample is taken where that is accurate enough.
        """
        every = max(1, int(LONGEST_STEP / self.time_step * (1 + 1e-6)))
        problem = self._thinned(run, every)
        while every > 1 and self._too_coarse(problem, run):
            every //= 2
            problem = self._thinned(run, every)
        return problem, information(problem, self.values, self.scale, self._sensors, averaged=every, until=until)

    def _thinned(self, run: Run, every: int) -> TwinProblem:
        """Return the model of every n-th sample, each with the noise of a mean of n."""
        sensors = self.inst.sensors
        finer = round(math.log2(every))
        angle, force = self._sensors["deg"].deviation_of_mean(every), self._sensors["N"].deviation_of_mean(every)
        inst = self.inst.replace(
            **{
                "sensors.encoder_bits": min(32, sensors.encoder_bits + finer),
                "sensors.load_cell_bits": min(32, sensors.load_cell_bits + finer),
                "sensors.encoder_noise": _beside(math.radians(angle), self._sensors["deg"].resolution * _DEGREE, every),
                "sensors.load_cell_noise": _beside(force, self._sensors["N"].resolution, every),
            }
        )
        return TwinProblem([self._measured(run, every)], self.law, inst)

    def _stepping_errors(self, problem: TwinProblem, run: Run) -> list[Array]:
        """Return the error of the model against the twin, by sensor, in the units of its traces."""
        true = {
            "handle_angle_deg": np.degrees(run["handle_angle"]),
            "output_angle_deg": np.degrees(run["output_angle"]),
        }
        true |= {f"tension_{tendon}_N": run["tension"][:, n] for n, tendon in enumerate(TENDONS)}
        traces = problem.traces(self.values, 0)
        return [np.interp(one.time, run.time, true[name]) - one.model for name, one in traces.items()]

    def _too_coarse(self, problem: TwinProblem, run: Run) -> bool:
        sensors = [self._sensors[name.rpartition("_")[2]] for name in problem.traces(self.values, 0)]
        pairs = zip(self._stepping_errors(problem, run), sensors, strict=True)
        return not all(np.sqrt(np.mean(off**2)) < _COARSE * sensor.deviation_of_mean(1) for off, sensor in pairs)

    @cached_property
    def _still(self) -> TwinProblem:
        """The model of an experiment in which nothing happens."""
        nothing = twin.Twin(self.inst, time_step=self.time_step).run(np.zeros(64))
        return TwinProblem([self._measured(nothing, 1)], self.law, self.inst)

    def _run(self, inst: ShortForm, commands: dict[str, Array]) -> Run:
        try:
            run = twin.Twin(inst, time_step=self.time_step).run(
                commands["handle_angle"],
                commands["force"],
                radial_force=commands["radial_force"],
                spool_velocity=commands["spool_velocity"],
            )
        except NoSolutionError:
            raise InfeasibleProtocolError("the tip is lost") from None
        except ValueError as problem:
            raise InfeasibleProtocolError(str(problem).rstrip(".")) from None
        bent, pulled = float(np.abs(run["output_angle"]).max()), float(run["tension"].max())
        if bent >= self.inst.output_stop:
            raise InfeasibleProtocolError("the tip is bent to its stop")
        if pulled > self._limit:
            raise InfeasibleProtocolError(
                f"a tendon is pulled by {pulled:.3g} N, above the limit of {self._limit:.3g} N"
            )
        return run

    def _measured(self, run: Run, every: int) -> MeasuredRun:
        columns = {
            "handle_angle": run["commanded_handle_angle"],
            "measured_handle_angle": run["measured_handle_angle"],
            "measured_output_angle": run["measured_output_angle"],
            "force": run["force"],
        }
        if not self.distal_encoder:
            del columns["measured_output_angle"]
        for n, tendon in enumerate(TENDONS):
            columns |= {
                f"tension_{tendon}": run["measured_tension"][:, n],
                f"spool_{tendon}": run["measured_spool_angle"][:, n],
            }
        # counted from the end, where blocks come to rest
        kept = {name: values[::-1][::every][::-1] for name, values in columns.items()}
        return MeasuredRun("the proposed protocol", run.time[::-1][::every][::-1], kept)


_DEGREE = math.radians(1)


def _beside(deviation: float, resolution: float, finer: int) -> float:
    """Return the noise that, with rounding to steps n times finer, makes up a deviation."""
    return math.sqrt(max(deviation**2 - (resolution / finer) ** 2 / 12, 0.0))


def _time_step(inst: ShortForm) -> float:
    """Return the sampling period, or an integer fraction of it that the tip's oscillation allows, s."""
    period = 1 / inst.sensors.sampling_rate
    return period / max(1, math.ceil(period / min(twin.TIME_STEP, plant.longest_step(inst)) * (1 - 1e-9)))

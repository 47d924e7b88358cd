"""The bench that an experiment is planned for: its twin runs protocols, whose derivatives say what they would tell."""

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from tenodesis import twin
from tenodesis.control.parameters import tension_limit
from tenodesis.errors import NoSolutionError, ProtocolError
from tenodesis.identification.differences import scales
from tenodesis.identification.experiment.candidates import Phase
from tenodesis.identification.experiment.information import Information, converters, information
from tenodesis.identification.formats.instrument_run import TENDONS
from tenodesis.identification.formats.measured import Measured
from tenodesis.identification.models.twin import TwinProblem
from tenodesis.identification.problem import Parameter
from tenodesis.instrument import Instrument
from tenodesis.protocols import Protocol
from tenodesis.signals import Array, Run

_OFF = ((0.8, 0.8), (1.2, 1.2))
"""Stiffness and pretension, over the file's, with which a protocol must run as well."""
_PLACES = 4
"""At how many places of their step the spools' encoders are tried."""


class Unfit(Exception):
    """A protocol that the bench cannot run; the message is a short reason."""


class Bench:
    """An instrument of one axis with its sensors.

    Parameters
    ----------
    inst
        The instrument; what its file says of its own errors is left out.
    law
        Friction law of the model.
    distal_encoder
        Whether there is one.
    """

    def __init__(self, inst: Instrument, law: str, *, distal_encoder: bool) -> None:
        self.inst = inst.replace(mismatch=None)
        self.law = law
        self.distal_encoder = distal_encoder
        self.time_step = _time_step(inst)
        self._sensors = converters(self.inst)
        self._limit = tension_limit(self.inst)
        self._drawn = np.random.default_rng(0).random((_PLACES, 2))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All unknowns of the model, starting from the file."""
        return self._still.parameters

    @cached_property
    def groups(self) -> dict[str, tuple[str, ...]]:
        """Names of parameters by group."""
        return self._still.groups

    @cached_property
    def values(self) -> Array:
        """The file's values of all parameters."""
        return np.array([one.start for one in self.parameters])

    @cached_property
    def scale(self) -> Array:
        """What changes of parameters are measured by, shape (parameters,)."""
        return scales(self.parameters, self.values)

    def run(self, phases: Sequence[Phase]) -> Run:
        """Return what the twin does.

        Raises
        ------
        Unfit
            The protocol is beyond a range, loses the tip, or pulls too hard, if not here then with tendons and
            pretension that are a fifth off.
        """
        try:
            commands = Protocol(name="candidate", phases=tuple(phases)).commands(self.inst, self.time_step)
        except ProtocolError as problem:
            raise Unfit(str(problem).partition(": ")[2].rstrip(".")) from None
        runs = [self._run(self.inst, commands)]
        for stiffness, pretension in _OFF:
            changes = {"mismatch.stiffness_ratio": stiffness, "mismatch.pretension_ratio": pretension}
            self._run(self.inst.replace(**changes), commands)
        return runs[0]

    def problem(self, run: Run) -> TwinProblem:
        """Return the model of a run, with further runs in which spools' encoders are at other places of their step."""
        return TwinProblem([self._measured(run, spools) for spools in self._spools(run)], self.law, self.inst)

    def tells(self, problem: TwinProblem) -> Information:
        """Return what a run tells of all parameters."""
        return self.tells_until(problem, (math.inf,))[0]

    def tells_until(self, problem: TwinProblem, times: Sequence[float]) -> list[Information]:
        """Return what a run tells of all parameters until some times, s."""
        averaged = max(1, round(problem.sample_time(0) * self.inst.sensors.sampling_rate))
        return information(problem, self.values, self.scale, self._sensors, averaged, times)

    @cached_property
    def _still(self) -> TwinProblem:
        """The model of a bench on which nothing happens."""
        nothing = twin.Twin(self.inst, time_step=self.time_step).run(np.zeros(64))
        return TwinProblem([self._measured(nothing, nothing["spool_angle"])], self.law, self.inst)

    def _run(self, inst: Instrument, commands: dict[str, Array]) -> Run:
        try:
            run = twin.Twin(inst, time_step=self.time_step).run(**commands)
        except NoSolutionError:
            raise Unfit("the tip is lost") from None
        except ValueError as problem:
            raise Unfit(str(problem).rstrip(".")) from None
        bent, pulled = float(np.abs(run["output_angle"]).max()), float(run["tension"].max())
        if bent >= self.inst.output_stop:
            raise Unfit("the tip is bent to its stop")
        if pulled > self._limit:
            raise Unfit(f"a tendon is pulled by {pulled:.3g} N, above the limit of {self._limit:.3g} N")
        return run

    def _measured(self, run: Run, spools: Array) -> Measured:
        columns = {
            "handle_angle": run["commanded_handle_angle"],
            "measured_handle_angle": run["measured_handle_angle"],
            "measured_output_angle": run["measured_output_angle"],
            "force": run["force"],
        }
        if not self.distal_encoder:
            del columns["measured_output_angle"]
        for n, tendon in enumerate(TENDONS):
            columns |= {f"tension_{tendon}": run["measured_tension"][:, n], f"spool_{tendon}": spools[:, n]}
        return Measured("the proposed protocol", run.time, columns)

    def _spools(self, run: Run) -> list[Array]:
        """Return what the spools' encoders read, first as it is, then at other places of their step if they turn."""
        read = run["measured_spool_angle"]
        if not np.ptp(read):
            return [read]
        true, drives = run["spool_angle"], self.inst.drives
        step = 2 * math.pi / drives.encoder_counts / drives.gear_ratio
        return [read, *(step * (np.floor(true / step + place) - np.floor(place)) for place in self._drawn)]


def _time_step(inst: Instrument) -> float:
    """Return the sampling period or a whole part of it that the tip's swing allows, s, near the usual step."""
    period = 1 / inst.sensors.sampling_rate
    return period / max(1, math.ceil(period / min(twin.TIME_STEP, twin.longest_step(inst)) * (1 - 1e-9)))

"""Experiments on the twin: they run motions, whose derivatives predict how well these identify parameters."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import tomli_w

from tenodesis import plant, simulate, twin
from tenodesis.control.parameters import tension_limit
from tenodesis.errors import Error, NoSolutionError, ProtocolError
from tenodesis.identification import identifiability
from tenodesis.identification.experiment import candidates as blocks
from tenodesis.identification.experiment.candidates import Candidate, Phase
from tenodesis.identification.experiment.information import Information, converters, information
from tenodesis.identification.formats.measured import MeasuredRun
from tenodesis.identification.problem import Parameter, Problem, scales
from tenodesis.identification.twin_model.problem import TwinProblem
from tenodesis.identification.twin_model.tuning import LONGEST_STEP
from tenodesis.instrument import Instrument, ShortForm
from tenodesis.instrument.text import readable, with_units
from tenodesis.magnitude import rms
from tenodesis.run import TENDONS, Array, Run
from tenodesis.simulate import Protocol
from tenodesis.units import READABLE

_OFF = ((0.8, 0.8), (1.2, 1.2))
"""Stiffness and pretension, over the file's, with which a protocol must run as well."""
_CANDIDATE = "candidate"
_COARSE = 2.0
"""Largest RMS error of longer steps, in standard deviations of a sample."""
_UNITS = {si: unit for si, unit in READABLE.items() if si != "s"}
_SCALING = (
    "stiffness_ratio",
    "pretension_ratio",
    "mismatch.load_cell_gain.agonist",
    "mismatch.load_cell_gain.antagonist",
)
"""Parameters that scale together where no force is known."""


class InfeasibleProtocolError(Error):
    """A protocol that the instrument cannot run; the message is a short reason."""


class Experiment(ABC):
    """An instrument with its sensors, on which motions are tried: candidates, what they do, and what they say."""

    inst: Instrument
    law: str
    """Friction law of the model."""
    distal_encoder: bool
    forces: tuple[float, ...]
    """Known at the tip, N, ascending."""
    caveat: ClassVar[str]
    """What its predictions leave out."""
    orders: ClassVar[int]
    """Orders of the chosen motions that are tried."""
    repeats: ClassVar[int]
    """How often a motion may be chosen while others fit: repetitions also repeat the model's errors."""

    @property
    @abstractmethod
    def candidates(self) -> list[Candidate]:
        """The motions that are offered."""

    @abstractmethod
    def baselines(self, duration: float) -> Mapping[str, tuple[Any, ...]]:
        """Return the unplanned motions to compare with by name, each of a duration, s."""

    @property
    @abstractmethod
    def _model(self) -> Problem:
        """A model of its recordings."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """All unknowns of the model, starting from the file."""
        return self._model.parameters

    @property
    def groups(self) -> Mapping[str, tuple[str, ...]]:
        """Names of parameters by group."""
        return self._model.groups

    @cached_property
    def values(self) -> Array:
        """The file's values of all parameters, at which derivatives are taken."""
        return self._model.starting_values(())

    @cached_property
    def scale(self) -> Array:
        """Unit of the changes of each parameter, shape (parameters,)."""
        return scales(self.parameters, self.values)

    @property
    def assumed(self) -> dict[str, float]:
        """Values in place of those that the file lacks, by parameter."""
        return {}

    @abstractmethod
    def run(self, phases: Sequence[Any]) -> Run:
        """Return the twin's response; raises InfeasibleProtocolError if the instrument cannot run them."""

    @abstractmethod
    def information(self, run: Run, until: Sequence[float] = (math.inf,)) -> tuple[Problem, list[Information]]:
        """Return the model of a run, and its information on all parameters until some times (s)."""

    def prediction(self, run: Run, until: Sequence[float] = (math.inf,)) -> tuple[Problem, list[Information]]:
        """Return them as predictions have them, after a choice."""
        return self.information(run, until)

    def joined(self, phases: Sequence[Any]) -> tuple[Protocol | None, Run]:
        """Return the protocol of motions, if a file may hold it, and the twin's response; raises as :meth:`run`."""
        return None, self.run(phases)

    def unidentifiable(self, problem: Problem, everything: Information) -> dict[str, str]:
        """Return why all candidates together do not identify some parameters, by those parameters' names."""
        return {}


def to_text(protocol: Protocol, comment: str = "") -> str:
    """Return the text of a protocol file, with a comment at its head."""
    phases = [{"kind": phase.kind} | with_units(phase, unset=False) for phase in protocol.phases]
    values = with_units(protocol, unset=False) | {"phases": readable(phases, _UNITS)}
    head = "".join(f"# {line}".rstrip() + "\n" for line in comment.splitlines())
    return f"{head}\n{tomli_w.dumps(values)}" if head else tomli_w.dumps(values)


class SimulatedExperiment(Experiment):
    """A one-axis instrument with its sensors, on which protocols are run.

    The mismatch of the instrument's file is left out; `law` is the friction law of the model.
    """

    caveat = (
        "Predicted intervals account for the sensors' noise and rounding alone: they are the best that a bench can "
        "reach. Effects beyond the model, its longer time steps, inaccurate loads and an instrument that differs from "
        "its file make them wider."
    )
    orders, repeats = 3, 2
    inst: ShortForm

    def __init__(
        self, inst: ShortForm, law: str | None, *, distal_encoder: bool, forces: Sequence[float] | None = None
    ) -> None:
        self.inst = inst.replace(mismatch=None)
        self.law = law or inst.friction.law
        self.forces = blocks.loads(self.inst, forces)
        self.distal_encoder = distal_encoder
        self.time_step = _time_step(inst)
        self._sensors = converters(self.inst)
        self._limit = tension_limit(self.inst)

    @cached_property
    def candidates(self) -> list[Candidate]:
        """The blocks of phases that are offered."""
        return blocks.candidates(self.inst, self.forces)

    def baselines(self, duration: float) -> dict[str, tuple[Phase, ...]]:
        """Return plain cycles, and the paper's under the loads of Fig. 14, or of the bench where the file has none."""
        of_paper = self.inst.conditions.forces or self.forces[:3] if self.forces else ()
        return blocks.baselines(self.inst, of_paper, duration)

    def joined(self, phases: Sequence[Phase]) -> tuple[Protocol, Run]:
        """Return the protocol of phases, with the digits that its file will have, and the twin's response."""
        about = f"Proposed to identify {self.inst.name}"[:200]
        protocol = simulate.parse(to_text(Protocol(name="identification", description=about, phases=tuple(phases))))
        return protocol, self.run(protocol.phases)

    def unidentifiable(self, problem: Problem, everything: Information) -> dict[str, str]:
        """Return why all candidates together do not identify some parameters, by those parameters' names."""
        base = problem.residuals(self.values, 0)

        def change(values: Array) -> float:
            return float(np.sum((problem.residuals(values, 0) - base) ** 2))

        indices = range(len(self.parameters))
        examined = identifiability.examine(
            problem, indices, self.values, scale=self.scale, found=everything.uncertainty(), change=change
        )
        why: dict[str, str] = {}
        for one in examined.combinations:
            if len(one.names) == 1:
                sentence = f"No candidate identifies {one.names[0]}: the readings hardly depend on it."
            else:
                known = f"only {one.known} acts" if one.known else "they change the readings in the same way"
                sentence = f"No candidate identifies {identifiability.listed(one.names)} separately: {known}."
            reason = self._reason(problem, one.names)
            why |= dict.fromkeys(one.names, f"{sentence} {reason}" if reason else sentence)
        for name, fine in examined.identifiable.items():
            if not fine and name not in why:
                reason = self._reason(problem, (name,))
                sentence = f"No candidate identifies {name}: it depends on several others."
                why[name] = f"{sentence} {reason}" if reason else sentence
        if not self.forces and self.inst.joint_type != "continuum":
            # A continuum's backbone is a known force.
            sentence = (
                f"No candidate identifies {', '.join(_SCALING)} separately: without a known force at the tip all "
                "tensions scale together, but for the tip's oscillation, whose inertia is held at the file's. Put "
                "known loads on the tip, or hold the gains at a calibration's."
            )
            why |= dict.fromkeys(_SCALING, sentence)
        return why

    def _reason(self, problem: Problem, names: Sequence[str]) -> str | None:
        """Return why some parameters are not identifiable, or what would make them so."""
        if "handle_length_share" in names and self.law == "none":
            return "Without friction the tension is the same all along a tendon."
        if "friction.sheath_coefficient" in names and not self.inst.friction.sheath_bend:
            return "The sheath of the file has no bend: give its bend, measured."
        if not self.distal_encoder and any(name.startswith(("mismatch.load_cell", "stiffness")) for name in names):
            return (
                "A distal encoder would identify them, or holding the load cells' gains and biases at a calibration's."
            )
        return problem.advice(names)

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
        return not all(rms(off) < _COARSE * sensor.deviation_of_mean(1) for off, sensor in pairs)

    @cached_property
    def _model(self) -> TwinProblem:
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

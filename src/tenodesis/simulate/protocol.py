"""Protocols: phases in order, their plan on an instrument, and the files they are read from."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias

import tomli_w
from pydantic import Field, field_validator

from tenodesis.errors import ProtocolError
from tenodesis.instrument import InstrumentLike, Name, as_instrument
from tenodesis.instrument.text import with_units
from tenodesis.run import Array
from tenodesis.simulate.applies import applied_to
from tenodesis.simulate.chirp import Chirp
from tenodesis.simulate.command import Command, Segment, sampled
from tenodesis.simulate.joint import REST
from tenodesis.simulate.model import ProtocolModel
from tenodesis.simulate.motion import Motion
from tenodesis.simulate.phases import Cycles, GrippedObject, Hold, Ramp, Start, StepLoad, TissueContact
from tenodesis.simulate.places import Place, Places
from tenodesis.simulate.pretension import Pretension
from tenodesis.toml import parse_toml, read_text, validated

OpenLoopPhase: TypeAlias = Hold | Cycles | StepLoad | Ramp | Motion | Chirp | TissueContact | GrippedObject
AnyPhase: TypeAlias = Pretension | OpenLoopPhase
"""A phase of any kind."""

_MOST_NAMED = 8
"""Phases that a protocol's short description names."""
LONGEST = 3600.0
"""Longest run, s."""

_SHIPPED = Path(__file__).parent / "shipped"


class Planned(NamedTuple):
    """A phase on an instrument: its label in errors, its initial command, and its segments if it is open-loop."""

    phase: AnyPhase
    label: str
    initial: Command
    segments: tuple[Segment, ...]
    seconds: float


class Protocol(ProtocolModel):
    """An experiment on the bench; it begins with the handle straight, without load, the drives at rest."""

    name: Name = Field(description="Name of the protocol")
    description: str = Field(default="", max_length=200, description="One line about the protocol")
    phases: tuple[Annotated[AnyPhase, Field(discriminator="kind")], ...] = Field(description="The phases, in order")

    @field_validator("phases")
    @classmethod
    def _check_phases(cls, phases: tuple[AnyPhase, ...]) -> tuple[AnyPhase, ...]:
        if not phases:
            raise ValueError("it must have one or more phases")
        return phases

    def __repr__(self) -> str:
        kinds = ", ".join(phase.kind for phase in self.phases[:_MOST_NAMED])
        more = f" and {len(self.phases) - _MOST_NAMED} more" if len(self.phases) > _MOST_NAMED else ""
        return f"<Protocol {self.name!r}: {kinds}{more}>"

    __str__ = __repr__

    def to_toml(self) -> str:
        """Return the text of a protocol file of this protocol, recorded motions included."""
        phases = [phase.with_data() if isinstance(phase, Motion) else phase for phase in self.phases]
        tables = [{"kind": phase.kind} | with_units(phase, unset=False) for phase in phases]
        return tomli_w.dumps(with_units(self, unset=False) | {"phases": tables}, multiline_strings=True)

    def duration(self, inst: InstrumentLike, time_step: float = 1e-3) -> float:
        """Return the duration of a run, s; closed-loop phases count with their timeout.

        Every move is rounded up to full time steps (s). Raises ProtocolError if the instrument cannot run it, or not
        within an hour.
        """
        return math.fsum(planned.seconds for planned in self.plan(inst, time_step))

    def commands(self, inst: InstrumentLike, time_step: float) -> dict[str, Array]:
        """Return the commands of all time steps (s), by name.

        For n steps: handle_angle (rad) by joint of the handle, (n, joints), and spool_velocity (rad/s) by tendon,
        (n, tendons), with spool_tension (N) where drives hold some. Loads (N, N m) are force and radial_force by axis,
        (n, axes), where the axes do not act on each other; else wrench (n, 6), and grip_force (n,). With a single joint
        its angle and forces have shape (n,).

        Raises ProtocolError if a phase is closed-loop or has tissue or an object, whose force is not known before, the
        instrument cannot run it, or not within an hour.
        """
        for phase in self.phases:
            if isinstance(phase, Pretension):
                raise ProtocolError(
                    f"{self.name}: the commands of a {phase.kind} phase follow from its load cells; "
                    "execute the protocol on a twin instead",
                    key="phase",
                    value=phase.kind,
                )
            if isinstance(phase, TissueContact | GrippedObject):
                raise ProtocolError(
                    f"{self.name}: the force in a {phase.kind} phase follows from the tip's angle; execute the "
                    "protocol on a twin instead",
                    key="phase",
                    value=phase.kind,
                )
        segments = [segment for planned in self.plan(inst, time_step) for segment in planned.segments]
        (commands,) = sampled(segments, sum(segment.steps for segment in segments))
        return commands

    @property
    def has_tension_drives(self) -> bool:
        """Whether drives hold tensions in it."""
        return any(isinstance(phase, Ramp) and phase.spool_tensions for phase in self.phases)

    @property
    def has_tissue(self) -> bool:
        """Whether the tip meets tissue in it."""
        return any(isinstance(phase, TissueContact) for phase in self.phases)

    def plan(self, inst: InstrumentLike, time_step: float) -> list[Planned]:
        """Return the phases planned on an instrument, at a time step (s).

        Raises ProtocolError if the instrument cannot run it, or not within an hour.
        """
        places = Places.of(as_instrument(inst))
        block_size(time_step, time_step)
        plan: list[Planned] = []
        command, total = Command.rest(places, time_step, tissue=self.has_tissue, tension=self.has_tension_drives), 0.0
        before, before_at = REST, None
        for number, (phase, following) in enumerate(zip(self.phases, (*self.phases[1:], None), strict=True), 1):
            label = f"{self.name}: phase {number} ({phase.kind})"
            with errors_of(label):
                at = applied_to(phase, places)
                if isinstance(phase, Pretension):
                    planned, before = Planned(phase, label, command, (), phase.timeout), REST
                    command = phase.end(command, places)
                else:
                    edge = before if at is before_at else REST
                    start = Start(at, command, time_step, places, edge, _continuing(following, at, places))
                    planned, before = _planned(phase, label, start), phase.edges(start)[1]
                    command = planned.segments[-1].end
            before_at = at
            plan.append(planned)
            total += planned.seconds
            if total > LONGEST * (1 + 1e-6):
                raise ProtocolError(
                    f"{label}: the run lasts {total / 3600:.4g} h by its end; it must last at most 1 h in all, since "
                    "every time step is computed and kept.",
                    key="duration",
                    value=total,
                    allowed="at most 1 h",
                )
        return plan


def shipped() -> tuple[str, ...]:
    """Return the names of the protocols that come with the package."""
    return tuple(sorted(file.stem for file in _SHIPPED.glob("*.toml")))


def load(name_or_path: str | Path) -> Protocol:
    """Read a protocol that comes with the package, by name, or a protocol file, by path.

    Raises ProtocolError if there is no such protocol or file, it cannot be read, or it is not valid.
    """
    source = str(name_or_path)
    path = _SHIPPED / f"{source}.toml" if source in shipped() else Path(name_or_path)
    text = read_text(path, ProtocolError, source=source, kind="protocol", names=shipped())
    return parse(text, source, folder=path.parent)


def parse(text: str, source: str = "protocol", *, folder: Path | None = None) -> Protocol:
    """Read a protocol from the text of a protocol file; messages start with `source`.

    Recorded motions are in a folder; without it the text may name no file, for it may come from somebody else. Raises
    ProtocolError if the text is not TOML or not a valid protocol.
    """
    context = {"file": True, "folder": folder}
    values = parse_toml(text, ProtocolError, source, "a protocol")
    return validated(Protocol, values, ProtocolError, source, context=context, entries={"phases": "phase"})


def json_schema() -> dict[str, Any]:
    """Return the JSON schema of protocol files, for editors that complete and check TOML."""
    schema = Protocol.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": "Tenodesis protocol"}


@contextmanager
def errors_of(label: str) -> Iterator[None]:
    """Add the name of the phase to errors raised within."""
    try:
        yield
    except ProtocolError as problem:
        raise ProtocolError(
            f"{label}: {problem}.", key=problem.key, value=problem.value, allowed=problem.allowed
        ) from None


def block_size(time_step: float, seconds: float) -> int:
    """Return how many time steps (s) fit into a block of some seconds, at least 1.

    Raises ProtocolError if either is below 1e-9 s, or no number.
    """
    for key, value in (("time_step", time_step), ("seconds", seconds)):
        if not 1e-9 <= value < math.inf:
            raise ProtocolError(key=key, value=value, allowed="a time of at least 1e-9 s")
    return max(1, math.floor(seconds / time_step * (1 + 1e-9)))


def _continuing(following: AnyPhase | None, at: Place, places: Places) -> OpenLoopPhase | None:
    """Return the phase after one if it is open-loop and of the same place; its own plan reports what is wrong."""
    if following is None or isinstance(following, Pretension):
        return None
    try:
        return following if following.place(places) is at else None
    except ProtocolError:
        return None


def _planned(phase: OpenLoopPhase, label: str, start: Start) -> Planned:
    segments = tuple(phase.segments(start))
    seconds = math.fsum(segment.steps * start.time_step for segment in segments)
    return Planned(phase, label, start.command, segments, seconds)

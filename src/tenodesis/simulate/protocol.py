"""Protocols: phases in order, their plan on an instrument, and the files they are read from."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeAlias, cast

import tomli_w
from pydantic import Field, field_validator

from tenodesis.coupled import CoupledInstrument, Joint
from tenodesis.errors import ProtocolError
from tenodesis.instrument import InstrumentLike, Name, ShortForm, as_short_form
from tenodesis.instrument.text import with_units
from tenodesis.run import Array
from tenodesis.simulate.chirp import Chirp
from tenodesis.simulate.command import AnyCommand, Command, CoupledCommand, Segment, sampled
from tenodesis.simulate.joint import REST
from tenodesis.simulate.model import ProtocolModel
from tenodesis.simulate.motion import Motion
from tenodesis.simulate.phases import Cycles, GrippedObject, Hold, Ramp, Start, StepLoad, TissueContact
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
    """A phase on an instrument: its label in errors, its initial command, and its segments if it is open-loop.

    Where joints share tendons the initial command is a CoupledCommand, which nothing asks for.
    """

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

    def duration(self, inst: InstrumentLike | CoupledInstrument, time_step: float = 1e-3) -> float:
        """Return the duration of a run, s; closed-loop phases count with their timeout.

        Every move is rounded up to full time steps (s). Raises ProtocolError if the instrument cannot run it, or not
        within an hour.
        """
        return math.fsum(planned.seconds for planned in self.plan(inst, time_step))

    def commands(self, inst: InstrumentLike, time_step: float) -> dict[str, Array]:
        """Return the commands of all time steps (s), by name.

        For n steps: handle_angle (rad), force and radial_force (N), of shape (n,), and spool_velocity (rad/s), of shape
        (n, 2), agonist first; with two axes (n, 2) and (n, 2, 2), axis before tendon.

        Raises ProtocolError if a phase is closed-loop or has tissue, whose force is not known before, the instrument
        cannot run it, or not within an hour.
        """
        inst = as_short_form(inst)
        closed = [phase.kind for phase in self.phases if isinstance(phase, Pretension)]
        if closed:
            raise ProtocolError(
                f"{self.name}: the commands of a {closed[0]} phase follow from its load cells; "
                "execute the protocol on a twin instead"
            )
        if self.has_tissue:
            raise ProtocolError(
                f"{self.name}: the force in a contact phase follows from the tip's angle; execute the protocol on a "
                "twin instead"
            )
        segments = [segment for planned in self.plan(inst, time_step) for segment in planned.segments]
        (commands,) = sampled(segments, sum(segment.steps for segment in segments))
        return commands

    @property
    def has_tissue(self) -> bool:
        """Whether the tip meets tissue in it."""
        return any(isinstance(phase, TissueContact) for phase in self.phases)

    def plan(self, inst: InstrumentLike | CoupledInstrument, time_step: float) -> list[Planned]:
        """Return the phases planned on an instrument, at a time step (s).

        Raises ProtocolError if the instrument cannot run it, or not within an hour.
        """
        inst = inst if isinstance(inst, CoupledInstrument) else as_short_form(inst)
        block_size(time_step, time_step)
        moved = _moved(inst)
        names = list(moved) or [""]
        plan: list[Planned] = []
        command, total = _rest(inst, tissue=self.has_tissue), 0.0
        before, before_axis = REST, ""
        for number, (phase, following) in enumerate(zip(self.phases, (*self.phases[1:], None), strict=True), 1):
            label = f"{self.name}: phase {number} ({phase.kind})"
            axis = phase.acts_on or names[0]
            after = following if isinstance(following, OpenLoopPhase) else None
            if after is not None and (after.acts_on or names[0]) != axis:
                after = None
            with errors_of(label):
                _check_keys(phase, inst)
                _check_axis(phase, inst)
                if isinstance(phase, Pretension):
                    initial = cast("Command", command)
                    planned, before = Planned(phase, label, initial, (), phase.timeout), REST
                    command = phase.end(initial, cast("ShortForm", inst))
                else:
                    index = names.index(axis)
                    edge = before if axis == before_axis else REST
                    whole = inst if isinstance(inst, CoupledInstrument) else None
                    start = Start(moved.get(axis), index, command, time_step, edge, after, whole)
                    planned, before = _planned(phase, label, start), phase.edges(start)[1]
                    command = planned.segments[-1].end
            before_axis = axis
            plan.append(planned)
            total += planned.seconds
            if total > LONGEST * (1 + 1e-6):
                raise ProtocolError(
                    f"{label}: the run lasts {total / 3600:.4g} h by its end; it must last at most 1 h in all, since "
                    "every time step is computed and kept."
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


_OF_PLANAR = {
    "axis": "joint",
    "force": "wrench",
    "force_end": "wrench of a ramp",
    "radial_force": "wrench",
    "weight": "wrench",
    "moment": "wrench",
    "load_steps": "wrench of a step-load",
    "force_amplitude": "amplitude",
    "output_amplitude": "amplitude",
    "output_angle": "handle_angle",
    "spool_velocity": "spool_velocities",
}
"""Keys of planar instruments, and what takes their place where joints share tendons."""

_OF_COUPLED = {
    "joint": "axis",
    "wrench": "force and radial_force",
    "grip_force": "force",
    "handle_angles": "handle_angle",
    "spool_velocities": "spool_velocity",
}
"""The same the other way round."""

_KINDS = {"pretension": "hold; its tendons are at their pretension at the start", "contact": "object"}


def _check_keys(phase: AnyPhase, inst: ShortForm | CoupledInstrument) -> None:
    """Refuse a phase of a kind, or with a key, that this kind of instrument does not have."""
    is_coupled = isinstance(inst, CoupledInstrument)
    what = "whose joints share tendons" if is_coupled else "whose axes are planar"
    kinds = _KINDS if is_coupled else {"object": "contact"}
    if phase.kind in kinds:
        raise ProtocolError(
            f"kind is {phase.kind}, which {inst.name}, {what}, does not have; it must be {kinds[phase.kind]}",
            key="kind",
            value=phase.kind,
            allowed=kinds[phase.kind],
        )
    instead = _OF_PLANAR if is_coupled else _OF_COUPLED
    if is_coupled and phase.kind == "ramp":
        instead = instead | {"handle_angle": "handle_angles"}
    for key in instead:
        if key in phase.model_fields_set and getattr(phase, key) not in (None, (), {}):
            raise ProtocolError(
                f"{key} is given, which {inst.name}, {what}, does not have; give {instead[key]}",
                key=key,
                value=getattr(phase, key),
                allowed=instead[key],
            )


def _moved(inst: ShortForm | CoupledInstrument) -> dict[str, ShortForm | Joint]:
    """Return what a phase may move by its name: axes, or joints of the handle."""
    if isinstance(inst, CoupledInstrument):
        return {joint.name: joint for joint in inst.handle_joints}
    return dict(zip(inst.axes, inst.planar, strict=True))


def _rest(inst: ShortForm | CoupledInstrument, *, tissue: bool) -> AnyCommand:
    if isinstance(inst, CoupledInstrument):
        return CoupledCommand.rest(inst)
    return Command.rest(len(inst.axes), tissue=tissue)


def _check_axis(phase: AnyPhase, inst: ShortForm | CoupledInstrument) -> None:
    key = "joint" if phase.axis is None else "axis"
    given, names = phase.acts_on, list(_moved(inst))
    if given is not None and given not in names:
        allowed = " or ".join(names) or "left out"
        raise ProtocolError(
            f"{key} is {given}; it must be {allowed}, which {inst.name} has"
            if names
            else f"{key} is {given}; it must be left out, since {inst.name} has no joint at its handle",
            key=key,
            value=given,
            allowed=allowed,
        )


def _planned(phase: OpenLoopPhase, label: str, start: Start) -> Planned:
    segments = tuple(phase.segments(start))
    seconds = math.fsum(segment.steps * start.time_step for segment in segments)
    return Planned(phase, label, cast("Command", start.command), segments, seconds)

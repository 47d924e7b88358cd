"""The open-loop phases of a protocol: hold, ramp, cycles, step load and contact, and what all phases have in common."""

import math
from abc import abstractmethod
from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tenodesis.errors import ArgumentError, ProtocolError
from tenodesis.instrument import AxisName, Instrument
from tenodesis.run import Array
from tenodesis.simulate.command import (
    SHAPES,
    SMOOTH,
    Between,
    Command,
    Moved,
    PathByStep,
    Segment,
    ShapeName,
    arriving,
    between,
)
from tenodesis.simulate.joint import REST, Edge
from tenodesis.simulate.loads import AppliedLoad, LoadStep, NamedLoad, check_load_steps, stepped_force
from tenodesis.simulate.model import ProtocolModel, check_choice
from tenodesis.simulate.places import Place, Places
from tenodesis.simulate.reach import check_handle_angle, check_output_angles, unloaded_handle_angle
from tenodesis.twin import Contact, Side
from tenodesis.units import (
    Angle,
    Delay,
    Duration,
    HandleSpeed,
    PositiveForce,
    SignedForce,
    Spacing,
    SpoolVelocity,
    TissueDamping,
    TissueStiffness,
)

_ROUNDING = 1e-12
"""Largest difference of an angle to what it is after a conversion of units, rad."""


class Start(NamedTuple):
    """The start of a phase: what it acts on, the last command, and the time step (s).

    And its neighbours: the end of the phase before, and the phase after if that is open-loop and of the same place.
    """

    place: Place
    command: Command
    time_step: float
    places: Places
    before: Edge = REST
    after: "OpenLoop | None" = None

    @property
    def handle_angle(self) -> float:
        """The handle angle of the joint, rad, without a handle that to which spools turn the tip's."""
        return self.command.at(self.place, "handle_angle")

    def reached(self, key: str, angle: float) -> float:
        """Return a handle angle (rad), given by a key; raises ProtocolError if it is not reached."""
        return check_handle_angle(self.place, key, angle)

    def at(self, angle: float) -> bool:
        """Return whether the handle is at an angle (rad), up to rounding."""
        return abs(angle - self.handle_angle) < _ROUNDING

    def steps(self, seconds: float) -> int:
        """Return the number of time steps of a duration (s), rounded up."""
        return math.ceil(seconds / self.time_step * (1 - 1e-9))

    def segment(self, first: Command, last: Command, seconds: float) -> Segment:
        """Return the linear segment between two commands over a duration (s)."""
        return Segment(first, last, self.steps(seconds))


class Phase(ProtocolModel):
    """A part of a protocol, on one axis or joint of the handle."""

    axis: AxisName | None = Field(default=None, description="Axis it acts on; the first if not given")

    def place(self, places: Places) -> Place:
        """Return what it acts on; raises ProtocolError if the instrument does not have it."""
        return places.first if self.axis is None else places.named("axis", self.axis)


class OpenLoop(Phase):
    """A phase whose commands are known before it runs."""

    @abstractmethod
    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield the segments of the phase; raises ProtocolError if the instrument cannot follow them."""

    def edges(self, start: Start) -> tuple[Edge, Edge]:
        """Return how the handle moves at the beginning and at the end."""
        return REST, REST


class Moving(OpenLoop):
    """A phase that begins at a handle angle of its own."""

    joint: str | None = Field(
        default=None,
        description="Joint of the handle that it moves, or of the tip without one, in place of an axis; the first if "
        "not given",
    )
    approach: HandleSpeed = Field(default=math.radians(20), description="Largest handle speed on the way to its start")

    @model_validator(mode="after")
    def _check_place(self) -> Self:
        check_choice(self, "axis", "joint", required=False)
        return self

    def place(self, places: Places) -> Place:
        """Return what it moves; raises ProtocolError if the instrument does not have it."""
        return super().place(places) if self.joint is None else places.named("joint", self.joint)

    def approached(self, start: Start, angle: float, speed: float = 0.0) -> Iterator[Segment]:
        """Yield the smooth move (minimum jerk) to a handle angle (rad), if the handle is not there.

        It arrives with a speed (rad/s) in its direction, at most the largest on the way.
        """
        begin = start.handle_angle
        steps = 0 if start.at(angle) else start.steps(SMOOTH.peak * abs(angle - begin) / self.approach)
        way = SMOOTH.way if not speed else arriving(speed * steps * start.time_step / (angle - begin))
        if steps:
            yield Segment(
                start.command,
                start.command.on(start.place, handle_angle=angle),
                steps,
                start.place,
                {"handle_angle": lambda done: between(begin, angle, way(done / steps))},
            )


def _usual_force(inst: Instrument) -> float:
    """Return the middle one of the forces of an instrument's conditions, the lower of two, N; 1 N without any."""
    forces = sorted(inst.conditions.forces) or [1.0]
    return forces[(len(forces) - 1) // 2]


class Loaded(NamedLoad, Moving):
    """A phase that moves the handle under load."""

    force: SignedForce | None = Field(default=None, description="Tangential force at the tip; as it was if not given")
    usual_force: bool = Field(
        default=False,
        strict=True,
        description="Load the tip by the middle one of the instrument's conditions.forces instead, by 1 N without them",
    )
    force_end: SignedForce | None = Field(default=None, description="Force at the end of a ramp; constant if not given")
    radial_force: SignedForce | None = Field(
        default=None, description="Force along the end-effector; as it was if not given"
    )
    load_steps: tuple[LoadStep, ...] = Field(
        default=(), max_length=1000, description="Loads put on, and taken off, during the motion, one after another"
    )

    @model_validator(mode="after")
    def _check_force(self) -> Self:
        if self.usual_force:
            check_choice(self, "usual_force", "force", "wrench", required=False)
        return self

    def moved(
        self, start: Start, angles: tuple[float, float], steps: int, path: PathByStep, more: PathByStep | None = None
    ) -> Segment:
        """Return the segment under this load that follows a path between two handle angles (rad).

        More force (N) may be added along a path of its own; load steps come on top. Raises ProtocolError if the load
        steps do not fit into the motion.
        """
        check_load_steps(self.load_steps, steps * start.time_step)
        tangential = _usual_force(start.places.inst) if self.usual_force else self.force
        first = self.on_tip(start.command, start.places).on(
            start.place, handle_angle=angles[0], force=tangential, radial_force=self.radial_force
        )
        last = first.on(start.place, handle_angle=angles[1], force=self.force_end)
        paths: dict[Moved, PathByStep] = {"handle_angle": path}
        if self.load_steps or more is not None:
            ends = first.at(start.place, "force"), last.at(start.place, "force")

            def force(done: NDArray[np.int64]) -> Array:
                base = between(*ends, done / steps) + (0.0 if more is None else more(done))
                return stepped_force(self.load_steps, start.place, base, done, start.time_step)

            paths["force"] = force
            last = last.on(start.place, force=float(force(np.array([steps]))[0]))
        return Segment(first, last, steps, start.place, paths)


class Hold(OpenLoop):
    """Handle, loads and spool velocities stay as they are."""

    kind: Literal["hold"] = "hold"
    duration: Duration = Field(description="How long")

    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield its only segment."""
        yield start.segment(start.command, start.command, self.duration)


class Ramp(NamedLoad, OpenLoop):
    """The given commands change linearly to the given values; the others stay constant."""

    kind: Literal["ramp"] = "ramp"
    duration: Duration = Field(description="How long")
    handle_angle: Angle | None = Field(default=None, description="Handle angle at the end")
    force: SignedForce | None = Field(default=None, description="Tangential force at the tip at the end")
    radial_force: SignedForce | None = Field(default=None, description="Force along the end-effector at the end")
    spool_velocity: tuple[SpoolVelocity, SpoolVelocity] | None = Field(
        default=None, description="Spool velocities at the end, agonist's and antagonist's; positive winds"
    )
    handle_angles: Mapping[str, Angle] = Field(
        default={},
        description="Handle angles at the end by joint of the handle, several at once; without one unloaded angles by "
        "joint of the tip",
    )
    spool_velocities: Mapping[str, SpoolVelocity] = Field(
        default={}, description="Spool velocities at the end by tendon, several at once"
    )
    spool_tensions: Mapping[str, PositiveForce] = Field(
        default={},
        description="Tensions at the end by tendon, which their drives hold until a ramp gives them spool_velocities",
    )

    @model_validator(mode="after")
    def _check_given(self) -> Self:
        of_axis = (self.handle_angle, self.force, self.radial_force, self.spool_velocity)
        of_tendons = (self.handle_angles, self.spool_velocities, self.spool_tensions)
        if of_axis == (None,) * 4 and not self.names_load and not any(of_tendons):
            raise ArgumentError(
                "nothing is ramped; give handle_angle, force, radial_force or spool_velocity", key="handle_angle"
            )
        if both := sorted(self.spool_velocities.keys() & self.spool_tensions.keys()):
            raise ArgumentError(
                f"spool_velocities and spool_tensions are given for {both[0]}; give one of them", key="spool_tensions"
            )
        for one, several in (("handle_angle", "handle_angles"), ("spool_velocity", "spool_velocities")):
            if getattr(self, one) is not None and getattr(self, several):
                raise ArgumentError(f"{one} and {several} are given; give only one of them", key=several)
        return self

    def edges(self, start: Start) -> tuple[Edge, Edge]:
        """Return the constant speed of the handle."""
        angle = self.handle_angles.get(start.place.name, self.handle_angle)
        way = 0.0 if angle is None else angle - start.handle_angle
        return (Edge(way / self.duration),) * 2

    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield its only segment."""
        if self.handle_angle is not None:
            start.reached("handle_angle", self.handle_angle)
        end = self.on_tip(start.command, start.places).on(
            start.place,
            handle_angle=self.handle_angle,
            force=self.force,
            radial_force=self.radial_force,
            spool_velocity=self.spool_velocity,
        )
        for name, angle in self.handle_angles.items():
            place = start.places.listed("handle_angles", name)
            end = end.on(place, handle_angle=check_handle_angle(place, f"handle_angles.{name}", angle))
        begin = start.command
        velocities = end.spool_velocity.copy()
        tensions = None if begin.spool_tension is None else begin.spool_tension.copy()
        for name, velocity in self.spool_velocities.items():
            m = start.places.tendon("spool_velocities", name)
            velocities[m] = velocity
            if tensions is not None:
                tensions[m] = 0.0
        if tensions is not None:
            # A drive begins to hold with the tension at rest, and ceases at once.
            held = tensions.copy()
            for name, tension in self.spool_tensions.items():
                m = start.places.tendon("spool_tensions", name)
                held[m] = held[m] or start.places.inst.pretensions[m]
                tensions[m], velocities[m] = tension, 0.0
            begin = begin._replace(spool_tension=held)
        yield start.segment(begin, end._replace(spool_velocity=velocities, spool_tension=tensions), self.duration)


class Cycles(Loaded):
    """Flexion and extension: the handle moves from one angle to another and back, `count` times.

    The duration of a stroke is rounded up to full time steps, so that the handle is at either end exactly.
    """

    kind: Literal["cycles"] = "cycles"
    amplitude: Angle | None = Field(default=None, description="Handle angle at the far end")
    output_amplitude: Angle | None = Field(default=None, description="The same, as output angle without load")
    start: Angle = Field(default=0.0, alias="from", description="Handle angle at the start and the return")
    symmetric: bool = Field(default=False, strict=True, description="Start at the negative of the far end")
    speed: HandleSpeed | None = Field(default=None, description="Mean handle speed")
    period: Duration | None = Field(default=None, description="Duration of a cycle")
    count: int = Field(ge=1, le=1_000_000, strict=True, description="Number of cycles")
    shape: ShapeName = Field(default="triangle", description="Handle angle over time")

    @model_validator(mode="after")
    def _check_choices(self) -> Self:
        check_choice(self, "amplitude", "output_amplitude")
        check_choice(self, "speed", "period")
        if self.symmetric and "start" in self.model_fields_set:
            raise ArgumentError("from and symmetric are both given; give only one of them", key="from")
        return self

    def ends(self, start: Start) -> tuple[float, float]:
        """Return the handle angles (rad) the cycles go from and to.

        Raises ProtocolError if an angle is out of range, or both are the same.
        """
        if self.amplitude is not None:
            far = start.reached("amplitude", self.amplitude)
        else:
            far = unloaded_handle_angle(start.place, "output_amplitude", self.output_amplitude or 0.0)
        near = -far if self.symmetric else start.reached("from", self.start)
        if near == far:
            raise ProtocolError(
                "the cycles start at their far end; give an amplitude that differs from the start",
                key="amplitude",
                allowed="different from the start",
            )
        return near, far

    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield the move to the first cycle, and the cycles."""
        near, far = self.ends(start)
        yield from self.approached(start, near)
        stroke = self._stroke(start, near, far)

        def path(done: NDArray[np.int64]) -> Array:
            cycle = done % (2 * stroke)
            return between(near, far, SHAPES[self.shape].way(np.minimum(cycle, 2 * stroke - cycle) / stroke))

        yield self.moved(start, (near, near), 2 * stroke * self.count, path)

    def edges(self, start: Start) -> tuple[Edge, Edge]:
        """Return the speed of a triangle's strokes; other shapes begin and end at rest, and so does an approach."""
        if self.shape != "triangle":
            return REST, REST
        near, far = self.ends(start)
        speed = (far - near) / (self._stroke(start, near, far) * start.time_step)
        return Edge(speed) if start.at(near) else REST, Edge(-speed)

    def _stroke(self, start: Start, near: float, far: float) -> int:
        """Return the time steps of a stroke."""
        return start.steps(self.period / 2 if self.period is not None else abs(far - near) / (self.speed or 1.0))


class StepLoad(NamedLoad, Moving, AppliedLoad):
    """The handle is held; after a delay a load is applied, held, and removed again if a release is given.

    After the release the force is what it was before; without a release the load stays for the phases that follow.
    """

    kind: Literal["step-load"] = "step-load"
    handle_angle: Angle | None = Field(default=None, description="Handle angle held; the present angle if not given")
    output_angle: Angle | None = Field(default=None, description="The same, as output angle without load")
    delay: Delay = Field(default=0.0, description="Time at the handle angle before the load")
    duration: Duration = Field(description="Time under the full load")
    release: Duration | None = Field(default=None, description="Time after the load was taken off; else it stays")

    @model_validator(mode="after")
    def _check_choices(self) -> Self:
        check_choice(self, "handle_angle", "output_angle", required=False)
        return self

    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield the move to the handle angle, the delay, the load, and its release."""
        angle = self._angle(start)
        free = start.command.on(start.place, handle_angle=angle)
        force = self.tip_force(start.place) if self.is_tangential else None
        loaded = self.on_tip(free, start.places).on(start.place, force=force)
        yield from self.approached(start, angle)
        yield start.segment(free, free, self.delay)
        yield start.segment(free, loaded, self.rise)
        yield start.segment(loaded, loaded, self.duration)
        if self.release is not None:
            yield start.segment(loaded, free, self.rise)
            yield start.segment(free, free, self.release)

    def _angle(self, start: Start) -> float:
        if self.output_angle is not None:
            return unloaded_handle_angle(start.place, "output_angle", self.output_angle)
        if self.handle_angle is not None:
            return start.reached("handle_angle", self.handle_angle)
        return start.handle_angle


class GrippedObject(OpenLoop):
    """The jaws get an object between them, a spring that they press, or lose it; all else stays as it is.

    Without a duration the phase takes one time step.
    """

    kind: Literal["object"] = "object"
    stiffness: TissueStiffness = Field(description="Of the object; 0 N/m takes it away")
    opening: Spacing | None = Field(
        default=None, description="Opening of the jaws below which they press it; as far as they are open by default"
    )
    damping: TissueDamping = Field(default=0.0, description="Of the object")
    duration: Duration | None = Field(default=None, description="How long; else it stays for the phases that follow")

    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield the time with the object, and what follows it."""
        between = Between(self.opening, self.stiffness, self.damping) if self.stiffness else None
        placed = start.command._replace(between=between)
        yield start.segment(placed, placed, self.duration or start.time_step)
        if self.duration is not None:
            free = placed._replace(between=None)
            yield start.segment(free, free, 0.0)


class TissueContact(OpenLoop):
    """The tip gets tissue that it meets from an output angle on, or loses it; all else stays as it is.

    Its force is a function of the tip's angle and velocity, as :class:`tenodesis.twin.Contact` says. Without a duration
    the phase takes one time step.
    """

    kind: Literal["contact"] = "contact"
    stiffness: TissueStiffness = Field(description="At the tip; 0 N/m takes the tissue away")
    angle: Angle | None = Field(default=None, description="Output angle at which the tip touches")
    damping: TissueDamping = Field(default=0.0, description="At the tip")
    side: Side = Field(default="flexion", description="Whether it lies above that angle, in flexion, or below")
    duration: Duration | None = Field(default=None, description="How long; else it stays for the phases that follow")

    @model_validator(mode="after")
    def _check_angle(self) -> Self:
        if self.stiffness and self.angle is None:
            raise ArgumentError(
                "angle is missing; give the output angle at which the tip touches the tissue", key="angle"
            )
        return self

    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield the time in contact, and what follows it."""
        contacts = self._contacts(start.place)
        touching = start.command.touching(contacts)
        yield start.segment(touching, touching, self.duration or start.time_step)
        if self.duration is not None:
            free = touching.touching(dict.fromkeys(contacts))
            yield start.segment(free, free, 0.0)

    def _contacts(self, place: Place) -> dict[int, Contact | None]:
        """Return the tissue on each joint of a place: arcs that bend alike meet what a tip with its lever meets."""
        if not self.stiffness or self.angle is None:
            return dict.fromkeys(place.bends)
        check_output_angles(place, ["angle"], [self.angle])
        count = len(place.bends)
        return {
            joint: Contact(self.angle / count, share * self.stiffness, share * self.damping, self.side)
            for joint, lever in zip(place.bends, place.levers, strict=True)
            for share in [sum(place.levers) / lever]
        }

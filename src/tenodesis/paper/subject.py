"""What the chapters study: an instrument's joints, where they are held and moved, and the loads that they bear there.

An instrument whose file lists joints and tendons has all its joints; a planar one has the first of its axes, under the
conditions of its file, and its results are named after what there is several of: loads, but neither joints nor motions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from tenodesis import statics
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import FullForm, Instrument, ShortForm, expanded
from tenodesis.report import style
from tenodesis.report.content import Array, Chart
from tenodesis.report.curves import forces
from tenodesis.run import Run
from tenodesis.simulate import AnyPhase, Cycles, Hold, Ramp, Wrench
from tenodesis.statics import Rates, chain
from tenodesis.statics.bends import Bends

HANDLE_SPEED = float(np.radians(10))
"""Of a planar instrument's handle, rad/s."""
SPEED = float(np.radians(20))
"""Of the joint that follows, about, rad/s."""
_MULTIPLES = (0.5, 1.0, 2.0)
"""Of the shown load, in tables."""
_FARTHEST = 1.8
"""How far curves go, over the bent state."""
_POINTS = 81
_SPOOL_RISE = 0.2
"""Time in which spools come to their speed, s."""
_TURNS = np.radians(0.5)
"""Least angle of a motion."""


class HeldState(NamedTuple):
    """A state in which the handle and the motors are held."""

    name: str
    angles: Array
    """Of the tip's joints without a load, (joints,), rad"""
    handle: Array
    """(handle joints,), rad"""
    strokes: Array
    """Wound by the motors, (tendons,), m"""


class Load(NamedTuple):
    """A load against flexion of the bent state."""

    name: str
    """Among results: x, y, z, grip; of a planar instrument its size"""
    direction: str
    """In words; empty of a planar instrument"""
    size: float
    """N"""
    wrench: Array
    """Force and moment at the tip, (6,), N and N m"""
    grip: float
    """Force that presses the jaws apart, N"""
    multiples: tuple[float, ...]
    """Of the load, in tables, the largest last"""

    def times(self, multiple: float) -> "Load":
        """Return a multiple of the load."""
        size = multiple * self.size
        name = self.name if self.direction else f"at_{size:g}N"
        return self._replace(name=name, size=size, wrench=multiple * self.wrench, grip=multiple * self.grip)

    @property
    def all(self) -> "list[Load]":
        """The load in every size of tables."""
        return [self.times(multiple) for multiple in self.multiples]

    @property
    def short(self) -> str:
        """Among names of files."""
        return self.name.removeprefix("at_")

    def keys(self) -> dict[str, Any]:
        """Return the keys of a protocol's phase under this load."""
        if not self.direction:
            return {"force": self.size}
        wrench = {name: float(value) for name, value in zip(Wrench.model_fields, self.wrench, strict=True) if value}
        return {"wrench": Wrench(**wrench)} | ({"grip_force": self.grip} if self.grip else {})

    @property
    def text(self) -> str:
        """The load in words."""
        return f"{self.size:.3g} N {self.direction}" if self.direction else f"{self.size:g} N"


class FarMotion(NamedTuple):
    """A motion from the straight instrument to its far end, handle and motors in proportion."""

    name: str
    """Of the handle's joint that is moved, or of the tip's that the motors bend; empty of a planar instrument"""
    follows: int
    """Place of the tip's joint that turns most"""
    handle: Array
    """At the far end, (handle joints,), rad"""
    strokes: Array
    """At the far end, (tendons,), m"""
    shares: Array
    """Shares of the way, (n,)"""
    angles: Array
    """Of the tip's joints there, without load and friction, (n, joints), rad"""

    @property
    def driven(self) -> tuple[str, int, float]:
        """The signal that is moved, its column, and its value at the far end: a handle angle, or a stroke (m)."""
        name, end = ("handle_angle", self.handle) if self.handle.any() else ("spool_angle", self.strokes)
        most = int(np.argmax(np.abs(end)))
        return name, most, float(end[most])


def key(*parts: str) -> str:
    """Return the name of a result, without the parts that are empty."""
    return ".".join(part for part in parts if part)


@dataclass(frozen=True)
class Subject:
    """An instrument of joints and tendons, or one axis of a planar one."""

    given: ShortForm | FullForm

    @classmethod
    def of(cls, inst: Instrument) -> "Subject":
        """Return what is studied of an instrument."""
        return cls(expanded(inst) if inst.short_form is None else inst.short_form.planar[0])

    @property
    def plane(self) -> ShortForm | None:
        """The instrument in the short form; None if its file lists joints and tendons."""
        return self.given.short_form

    @cached_property
    def inst(self) -> FullForm:
        """The instrument as joints and tendons."""
        return expanded(self.given)

    @cached_property
    def joints(self) -> list[str]:
        """Names of the tip's joints, a backbone's arcs as one."""
        return list(self.plane.axes) if self.plane is not None else self.bends.names

    @cached_property
    def bends(self) -> Bends:
        """The tip's joints, a backbone's arcs as one."""
        return Bends.of(self.inst)

    def turned(self, run: Run) -> Array:
        """Return the output angles of a run, (n, joints), rad."""
        return self.bends.summed(run.by_column("output_angle"))

    def rates(self, handle: Array, strokes: Array) -> Rates:
        """Return how the joints answer at rest."""
        return self.bends.rates(chain.rates(self.inst, handle, strokes=strokes))

    @property
    def labels(self) -> list[str]:
        """Names of the joints among results."""
        return [""] if self.plane is not None else self.joints

    @cached_property
    def handles(self) -> list[str]:
        """Names among results of the handle's joints, if those of the tip follow them one by one; else none."""
        if self.plane is not None:
            return [""]
        names = [joint.name for joint in self.inst.handle_joints]
        return names if len(names) == len(self.joints) else []

    @property
    def cycles(self) -> int:
        """Cycles of a motion; the last one is judged."""
        return self.given.conditions.cycles or 2

    def angles(self, handle: Array, load: Load | None = None, strokes: Array | float = 0.0) -> Array:
        """Return angles without friction, (..., joints), at handle angles (..., handle joints) and strokes, rad."""
        if self.plane is not None:
            force = 0.0 if load is None else load.size
            return np.asarray(statics.output_angle(self.plane, handle[..., 0], force))[..., np.newaxis]
        wrench, grip = (0.0, 0.0) if load is None else (load.wrench, load.grip)
        return self.bends.summed(chain.output_angles(self.inst, handle, wrench, grip_force=grip, strokes=strokes))

    def way(self, motion: FarMotion, shares: Array, load: Load | None = None) -> Array:
        """Return the angles without friction at shares (n,) of a motion, (n, joints), rad."""
        return self.angles(np.outer(shares, motion.handle), load, np.outer(shares, motion.strokes))

    def target(self, run: Run, load: Load | None = None) -> Array:
        """Return the angles without friction at a run's handle angles and strokes, (n, joints), rad."""
        return self.angles(run.by_column("handle_angle"), load, run.by_column("spool_angle") * self.spool_radius)

    @property
    def spool_radius(self) -> float:
        """Radius of the motors' spools, m."""
        return self.given.own_drives.spool_radius

    def share(self, motion: FarMotion, run: Run) -> Array:
        """Return how far a run is on the way of a motion, (n,)."""
        name, column, end = motion.driven
        return run.by_column(name)[:, column] * (self.spool_radius if name == "spool_angle" else 1.0) / end

    @cached_property
    def states(self) -> list[HeldState]:
        """The straight state, and one that is bent by half of the range at the tip, or else at the handle."""
        found = []
        for name, angles in zip(("straight", "bent"), statics.usual_states(self.inst), strict=False):
            found.append(HeldState(name, angles, *statics.hold(self.inst, angles)))
        return found

    @cached_property
    def held(self) -> list[HeldState]:
        """The states of the chapter on loss: of a planar instrument straight, in the middle and at the range's end."""
        if self.plane is None:
            return self.states
        angles = np.array([0.0, 0.5, 1.0]) * self.plane.output_range
        handles = np.asarray(statics.handle_angle(self.plane, angles))
        return [
            HeldState(f"at_{np.degrees(angle):.4g}deg", np.array([angle]), np.array([handle]), np.zeros(2))
            for angle, handle in zip(angles, handles, strict=True)
        ]

    def along(self, state: HeldState, points: int = 61) -> tuple[Array, Array, Array]:
        """Return shares (n,) of the way from straight through a state, and handle angles and strokes there."""
        ranges = np.array([joint.range for joint in self.inst.handle_joints])
        beyond = np.divide(ranges, np.abs(state.handle), out=np.full(len(ranges), np.inf), where=state.handle != 0)
        shares = np.linspace(0.0, min([_FARTHEST, *beyond]), points)
        return shares, np.outer(shares, state.handle), np.outer(shares, state.strokes)

    @cached_property
    def loads(self) -> list[Load]:
        """The loads of :func:`tenodesis.statics.usual_loads`; of a planar instrument, the force across the tip."""
        if self.plane is not None:
            return [Load("", "", 1.0, np.empty(0), 0.0, tuple(forces(self.plane)[1:]))]
        usual = statics.usual_loads(self.inst)
        given = sorted(self.inst.conditions.forces)
        found = []
        for load in usual:
            if load.name == "grip":
                found.append(Load("grip", "between the jaws", load.size, load.wrench, load.grip_force, _MULTIPLES))
                continue
            multiples = tuple(force / load.size for force in given) or _MULTIPLES
            sign = "−" if load.wrench["xyz".index(load.name)] < 0 else ""
            found.append(Load(load.name, f"along {sign}{load.name}", load.size, load.wrench, 0.0, multiples))
        return found

    def loads_of(self, motion: FarMotion) -> list[Load | None]:
        """Return the loads of a motion: none and the one that takes most of its joint, or those of the conditions."""
        return list(self.loads[0].all) if self.plane is not None else [None, self.most_taking(motion.follows)]

    def most_taking(self, joint: int) -> Load:
        """Return the load that takes most from a joint of the tip, by its place, in the bent state."""
        bent = self.states[-1]
        rates = self.rates(bent.handle, bent.strokes)

        def taken(load: Load) -> float:
            return float(abs(rates.by_wrench[joint] @ load.wrench + rates.by_grip[joint] * load.grip))

        return max(self.loads, key=taken)

    @cached_property
    def motions(self) -> list[FarMotion]:
        """The motion of every joint of the handle; without a handle, of the motors for all that bends at the tip.

        A motion goes as far as the range of what is moved, and of the joints that it turns. What turns no joint is left
        out, and so is a joint that motors do not turn.
        """
        if self.plane is not None:
            shares, end = np.linspace(0.0, 1.0, _POINTS), np.array([statics.reach(self.plane)])
            return [FarMotion("", 0, end, np.zeros(2), shares, self.angles(np.outer(shares, end)))]
        handles, tendons = self.inst.handle_joints, len(self.inst.tendons)
        ends: list[tuple[str, Array, Array]] = [
            (joint.name, joint.range * row, np.zeros(tendons))
            for joint, row in zip(handles, np.eye(len(handles)), strict=True)
        ]
        if not handles:
            for name, far in zip(self.inst.bends, np.diag(self.inst.bend_ends), strict=True):
                try:
                    ends.append((name, *statics.hold(self.inst, self.inst.bent(far))))
                except NoSolutionError:
                    continue
        found = (self._motion(*end) for end in ends)
        return [motion for motion in found if motion is not None]

    def _motion(self, name: str, handle: Array, strokes: Array) -> FarMotion | None:
        shares = np.linspace(0.0, 1.0, _POINTS)
        angles = self.angles(np.outer(shares, handle), strokes=np.outer(shares, strokes))
        low, high = self.bends.summed(np.array([joint.limits for joint in self.inst.tip_joints]).T)
        beyond = ~((angles >= low - 1e-6) & (angles <= high + 1e-6)).all(axis=1)
        last = int(np.argmax(beyond)) - 1 if beyond.any() else _POINTS - 1
        if last < 1:
            return None
        end = shares[last]
        angles = self.angles(np.outer(end * shares, handle), strokes=np.outer(end * shares, strokes))
        turned = np.abs(angles[-1] - angles[0])
        if not turned.max() > _TURNS:
            return None
        return FarMotion(name, int(np.argmax(turned)), end * handle, end * strokes, shares, angles)

    def there_and_back(self, motion: FarMotion) -> list[AnyPhase]:
        """Return the phases of the cycles of a motion."""
        if self.plane is not None:
            return [Cycles(amplitude=motion.handle[0], speed=HANDLE_SPEED, count=self.cycles)]
        seconds = float(np.ptp(motion.angles[:, motion.follows])) / SPEED
        out = self.moved(motion.handle, motion.strokes, seconds)
        return self.cycles * [*out, *self.moved(0 * motion.handle, -motion.strokes, seconds)]

    def moved(self, handle: Array, strokes: Array, seconds: float) -> list[AnyPhase]:
        """Return the phases in which the handle moves to angles (rad), and motors wind lengths (m), in a time (s)."""
        phases: list[AnyPhase] = []
        if handle.size:
            angles = {joint.name: float(angle) for joint, angle in zip(self.inst.handle_joints, handle, strict=True)}
            phases.append(Ramp(duration=seconds, handle_angles=angles))
        speeds = strokes / self.spool_radius / seconds
        spools = {tendon.name: float(speed) for tendon, speed in zip(self.inst.tendons, speeds, strict=True) if speed}
        if spools:
            phases += [
                Ramp(duration=_SPOOL_RISE, spool_velocities=spools),
                Hold(duration=max(seconds - _SPOOL_RISE, 1e-3)),
                Ramp(duration=_SPOOL_RISE, spool_velocities=dict.fromkeys(spools, 0.0)),
            ]
        return phases

    def described(self, state: HeldState) -> str:
        """Return the angles of a state in words."""
        angles = zip(self.joints, np.degrees(self.bends.summed(state.angles)), strict=True)
        return ", ".join(f"{joint} {angle + 0.0:.3g}°".replace("-", "−") for joint, angle in angles)

    @property
    def looks(self) -> dict[str, dict[str, Any]]:
        """How the curve of each joint of the tip looks, by name; wider ones show behind those drawn later."""
        colors = style.colors(len(self.joints) + 1)[1:]
        return {
            name: {"color": color, "lw": max(2.8 - 0.7 * n, 1.2)}
            for n, (name, color) in enumerate(zip(self.joints, colors, strict=True))
        }

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """Entries of a legend for the joints of the tip."""
        return [(name, look["color"], "-") for name, look in self.looks.items()]


def panels(count: int, wide: float = 2.6, height: float = 3.6) -> tuple[Chart, Sequence[Axes]]:
    """Return a chart of panels of a width, inches, side by side."""
    return Chart.panels(count, width=max(7.0, wide * count + 0.4), height=height)

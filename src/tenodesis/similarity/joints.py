"""Similarity of two instruments of several joints: factors, groups, and the error in angles and at the tip."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from tenodesis import kinematics, plant, statics, twin
from tenodesis.errors import ArgumentError
from tenodesis.instrument import FullForm, InstrumentLike, Joint, expanded
from tenodesis.instrument.instrument import arm_of
from tenodesis.magnitude import rms_of_finite
from tenodesis.run import Array
from tenodesis.similarity.groups import DEFINITIONS, Group, Kind
from tenodesis.statics import UsualLoad, chain
from tenodesis.statics.bends import Bends

_RANDOM = 16
"""States of the working range beside those in which one joint is bent alone."""
_SHARES = (-1.0, -0.75, -0.5, 0.5, 0.75, 1.0)
"""Of the end of a joint's range."""
_WITHIN = 0.75
"""Share of the ranges in which all joints are bent at once."""
_REACHED = 1e-3
"""Farthest that a state may be from what was asked for, rad."""
_FARTHEST = math.radians(150)
"""To which a joint is bent; its equations end at half a turn, and loads and tolerances take it farther, rad."""
_LOADING = 8
"""Steps in which a load is laid on."""
_STEPS = 12
"""Steps of a motion from straight to its end."""
_SLOW = 0.2
"""Largest speed of a spool in the loops with friction, rad/s."""
_LEAST_STEP = 0.1  # s


class WorkingStates(NamedTuple):
    """Unloaded states that both instruments are held in, and the loads there."""

    angles: Array
    """Of the real-size tip's joints, (states, joints), rad"""
    handle: Array
    """Of the handle's joints, the same of both, (states, handle joints), rad"""
    strokes: Array
    """Wound on the real-size instrument, (states, tendons), m"""
    scaled_strokes: Array
    """Wound on the scaled-up one, which hold the same angles, (states, tendons), m"""
    wrench: Array
    """On the real-size tip, (loads, 6), N and N m"""
    grip_force: Array
    """(loads,), N"""


@dataclass(frozen=True)
class JointError:
    """Difference between the scaled-up and the real-size instrument over a working range.

    `angle` (deg, shape (n, loads, joints), a backbone's arcs as one joint) is scaled-up minus real-size; `tip` (m,
    shape (n, loads)) is how far that moves the real-size tip, of two jaws the farther one. NaN where one of them has no
    equilibrium.
    """

    joints: tuple[str, ...]
    angle: Array
    tip: Array

    @property
    def largest(self) -> Array:
        """Largest magnitude by joint, deg."""
        return np.asarray(np.nanmax(np.abs(self.angle), axis=(0, 1)))

    @property
    def rms(self) -> Array:
        """Root mean square by joint, deg."""
        return np.array([rms_of_finite(self.angle[..., joint]) for joint in range(len(self.joints))])

    @property
    def largest_at_tip(self) -> float:
        """Largest distance at the real-size tip, m."""
        return float(np.nanmax(self.tip))

    @property
    def rms_at_tip(self) -> float:
        """Root mean square of the distance at the real-size tip, m."""
        return rms_of_finite(self.tip)

    @property
    def unsolved(self) -> float:
        """Share of the points at which either instrument has no equilibrium."""
        return float(np.isnan(self.tip).mean())

    def __repr__(self) -> str:
        shown = ", ".join(f"{name} {one:.3g} deg" for name, one in zip(self.joints, self.largest, strict=True))
        return f"<JointError: largest {shown}, {1e3 * self.largest_at_tip:.3g} mm at the tip>"


@dataclass(frozen=True)
class WorkingRange:
    """A real-size instrument in its states and under its loads, which all its scale models are compared with."""

    inst: FullForm
    loads: tuple[UsualLoad, ...]
    """The largest of the working range."""

    @cached_property
    def held(self) -> tuple[Array, Array, Array, Array]:
        """What bends, (states, bends), angles of joints and handle, rad, and strokes, m, of the unloaded states."""
        inst = self.inst
        most = _FARTHEST * np.array([[len(arcs)] for arcs in inst.bends.values()])
        bends = np.array(list(_spread(np.clip(inst.bend_limits, -most, most))))
        wanted = np.array([inst.bent(row) for row in bends])
        handle, strokes = statics.hold(inst, wanted)
        ranges = np.array([joint.range for joint in inst.handle_joints])
        within = (np.abs(handle) <= ranges).all(axis=1)
        bends, wanted, handle, strokes = (one[within] for one in (bends, wanted, handle, strokes))
        angles = chain.output_angles(inst, handle if handle.shape[1] else 0.0, strokes=strokes)
        reached = np.abs(angles - wanted).max(axis=1) <= _REACHED
        return bends[reached], angles[reached], handle[reached], strokes[reached]

    @cached_property
    def load_rows(self) -> tuple[Array, Array]:
        """Wrenches (loads, 6), N and N m, and grip forces (loads,), N."""
        return _load_rows(self.loads)

    @cached_property
    def loaded(self) -> Array:
        """Angles in all states under all loads, (states, loads, joints), rad."""
        _, _, handle, strokes = self.held
        return _loaded(self.inst, handle, strokes, *self.load_rows)

    @cached_property
    def places(self) -> Array:
        """Of the ends of the tip there, as of :meth:`places_at`."""
        return self.places_at(self.loaded)

    def places_at(self, angles: Array) -> Array:
        """Return the places of the ends of the tip at angles (..., joints), rad, shape (..., ends, 3), m."""
        found = kinematics.tip_pose(self.inst, np.nan_to_num(angles)).position
        return np.asarray(found.reshape(*angles.shape[:-1], -1, 3))

    @cached_property
    def rates(self) -> chain.Rates:
        """How what bends answers in the unloaded states."""
        _, _, handle, strokes = self.held
        return Bends.of(self.inst).rates(chain.rates(self.inst, handle, strokes=strokes))

    @cached_property
    def frequency(self) -> float:
        """Lowest natural frequency, Hz."""
        return float(plant.natural_frequencies(self.inst)[0])


@dataclass(frozen=True)
class JointComparison:
    """Two instruments with the same joints and tendons; :func:`compare_joints` makes it."""

    working: WorkingRange
    scaled_up: FullForm

    @property
    def real_size(self) -> FullForm:
        """The real-size instrument."""
        return self.working.inst

    @property
    def loads(self) -> tuple[UsualLoad, ...]:
        """On the real-size instrument, the largest of the working range."""
        return self.working.loads

    def __repr__(self) -> str:
        found = ", ".join(f"{key} {value:.4g}" for key, value in self.factors.items())
        return f"<JointComparison of {self.real_size.name!r} and {self.scaled_up.name!r}: {found}>"

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the tip's joints, a backbone's arcs as one."""
        return tuple(Bends.of(self.real_size).names)

    @cached_property
    def length_factor(self) -> float:
        """Factor of the tendons' arms about the tip's joints, by least squares."""
        return self._arms_factor("tip")

    def _arms_factor(self, place: Literal["tip", "handle"]) -> float:
        real, scaled = (inst.tendon_arms(place) for inst in (self.real_size, self.scaled_up))
        return float((real * scaled).sum() / (real * real).sum()) if real.any() else self.length_factor

    @cached_property
    def factors(self) -> dict[str, float]:
        """Scale factors: of lengths, tendons, loads, motors and time; angles have the factor 1.

        `force`, `grip_force` and `moment` are those by which loads at the tip take the same angles, to first order and
        by least squares over the unloaded states of the working range; `torque` is that of moments about joints.
        """
        length = self.length_factor
        stiffness = float(np.exp(np.mean(np.log(self.scaled_up.stiffnesses / self.real_size.stiffnesses))))
        time = self.working.frequency / plant.natural_frequencies(self.scaled_up)[0]
        spool = length * self.real_size.own_drives.spool_radius / self.scaled_up.own_drives.spool_radius
        force, moment, grip = self._load_factors
        return {
            "length": length,
            "tendon_stiffness": stiffness,
            "tension": stiffness * length,
            "force": force,
            "moment": moment,
            "grip_force": grip,
            "torque": stiffness * length**2,
            "handle_torque": stiffness * length * self._arms_factor("handle"),
            "motor_stroke": length,
            "spool_angle": spool,
            "spool_velocity": spool / float(time),
            "time": float(time),
        }

    @cached_property
    def _load_factors(self) -> tuple[float, float, float]:
        states, real = self.states, self.working.rates
        found = chain.rates(self.scaled_up, states.handle, strokes=states.scaled_strokes)
        scaled = Bends.of(self.scaled_up).rates(found)
        pairs = (
            (real.by_wrench[..., :3], scaled.by_wrench[..., :3]),
            (real.by_wrench[..., 3:], scaled.by_wrench[..., 3:]),
            (real.by_grip, scaled.by_grip),
        )
        force, moment, grip = (_fitted(*pair) for pair in pairs)
        return force, moment, grip if self.real_size.jaws else force

    @property
    def scaled_pretensions(self) -> Array:
        """Pretensions of the scaled-up tendons, (tendons,), N, that keep those of the real size over k r."""
        return self.real_size.pretensions * self.factors["tension"]

    @cached_property
    def states(self) -> WorkingStates:
        """Each joint bent alone to both sides, all joints bent at once, and the loads with their halves.

        A handle with as many joints as the tip is held at the same angles in both instruments; otherwise motors hold
        the same unloaded angles in both. States that either cannot be held in are left out.
        """
        bends, angles, handle, strokes = self.working.held
        scaled = self.scaled_up
        other = strokes if handle.any() else statics.hold(scaled, np.array([scaled.bent(row) for row in bends]))[1]
        return WorkingStates(angles, handle, strokes, other, *self.working.load_rows)

    @cached_property
    def groups(self) -> tuple[Group, ...]:
        """The dimensionless groups of both, those alike as one; r and k are of the first joint and the first tendon."""
        ours, theirs = (dict(_groups(inst)) for inst in (self.real_size, self.scaled_up))
        load = max((one.size for one in self.loads if one.wrench.any()), default=0.0)
        scale = [inst.stiffnesses[0] * inst.tip_joints[0].radius for inst in (self.real_size, self.scaled_up)]
        alike: dict[tuple[Kind, str, float, float], list[str]] = {}
        for (name, kind, meaning), value in ours.items():
            other = theirs.get((name, kind, meaning), float("nan"))
            alike.setdefault((kind, meaning, value, other), []).append(name)
        found = [
            Group(names[0] + (f" and {len(names) - 1} more" if names[1:] else ""), *group)
            for group, names in alike.items()
        ]
        meaning = "force at the tip over k r, at the factor of force"
        found.append(Group("F/(k r)", "load", meaning, load / scale[0], load * self.factors["force"] / scale[1]))
        return tuple(found)

    def error(self, *, pretensions: Array | None = None) -> JointError:
        """Return the difference of both instruments at rest without friction, over the working states and loads.

        Parameters
        ----------
        pretensions
            Of the scaled-up tendons, (tendons,), N; by default those of the real size, scaled.
        """
        states = self.states
        scaled = with_pretensions(self.scaled_up, self.scaled_pretensions if pretensions is None else pretensions)
        wrench, grip = self.scaled_loads(states.wrench, states.grip_force)
        found = _loaded(scaled, states.handle, states.scaled_strokes, wrench, grip)
        return self._between(found, self.working.loaded, self.working.places)

    def scaled_loads(self, wrench: Array, grip_force: Array) -> tuple[Array, Array]:
        """Return wrenches (..., 6) and grip forces on the scaled-up instrument by those on the real-size one."""
        factors = self.factors
        by = np.repeat([factors["force"], factors["moment"]], 3)
        return wrench * by, grip_force * factors["grip_force"]

    def between(self, found: Array, expected: Array) -> JointError:
        """Return the error between angles of the tip's joints, scaled-up and real-size, (n, loads, joints), rad."""
        return self._between(found, expected, self.working.places_at(expected))

    def between_many(self, found: Array, expected: Array) -> list[JointError]:
        """Return the errors of many scaled-up instruments, (instruments, n, loads, joints), rad, as :meth:`between`.

        The angles expected are those of all, (n, loads, joints), or of each.
        """
        one = self._between(found, expected, self.working.places_at(expected))
        return [JointError(self.joints, *both) for both in zip(one.angle, one.tip, strict=True)]

    def _between(self, found: Array, expected: Array, places: Array) -> JointError:
        angle = np.degrees(Bends.of(self.real_size).summed(found - expected))
        tip = np.linalg.norm(self.working.places_at(found) - places, axis=-1).max(axis=-1)
        return JointError(self.joints, angle, np.where(np.isnan(angle).any(axis=-1), np.nan, tip))

    @cached_property
    def motions(self) -> "JointMotions":
        """Loops from straight to both ends of each joint, on the quasi-static twin, without and under each load."""
        return JointMotions.of(self)

    def error_at_rest(self, *, pretensions: Array | None = None) -> JointError:
        """Return the difference with friction at rest, while each joint is bent to and fro under constant loads.

        The loads are none and each of :attr:`loads`, laid on before; rows are the steps of the loops after that.
        Parameter as of :meth:`error`.
        """
        tensions = self.scaled_pretensions if pretensions is None else pretensions
        expected = self.motions.angles([self.real_size])
        found = self.motions.angles([with_pretensions(self.scaled_up, tensions)], scaled=True)
        return self.between(found[0], expected[0])


class JointMotions(NamedTuple):
    """Commands of loops of both instruments, by loop (motion and load) and step."""

    names: list[str]
    """Of the joint that is bent, by loop"""
    joints: int
    """Of the tip"""
    handle: Array
    """(loops, n, handle joints), rad"""
    strokes: Array
    """(loops, n, tendons), m"""
    scaled_strokes: Array
    wrench: Array
    """(loops, n, 6), N and N m"""
    scaled_wrench: Array
    grip: Array
    """(loops, n, 1), N"""
    scaled_grip: Array

    @classmethod
    def of(cls, pair: JointComparison) -> "JointMotions":
        """Return those of a comparison."""
        states = pair.states
        there = np.concatenate([np.linspace(0, 1, _STEPS + 1), np.linspace(1, 0, _STEPS + 1)[1:]])
        path = np.concatenate([np.zeros(_LOADING), there, -there[1:], there[1:]])
        laid = np.minimum(np.arange(len(path)) / (_LOADING - 1), 1.0)
        names, commands = [], []
        loads = [(np.zeros(6), 0.0), *((one.wrench, one.grip_force) for one in pair.loads)]
        for name, row in _ends(pair):
            for wrench, grip in loads:
                other, gripped = pair.scaled_loads(wrench, np.asarray(grip))
                parts = (states.handle[row], states.strokes[row], states.scaled_strokes[row])
                names.append(name)
                commands.append(
                    (
                        *(np.outer(path, part) for part in parts),
                        *(np.outer(laid, one) for one in (wrench, other)),
                        *(laid[:, np.newaxis] * float(one) for one in (grip, gripped)),
                    )
                )
        joints = len(pair.real_size.tip_joints)
        return cls(names, joints, *(np.array(part) for part in zip(*commands, strict=True)))

    @property
    def steps(self) -> int:
        """Steps of a loop after loading."""
        return int(self.strokes.shape[1]) - _LOADING

    @property
    def last_loop(self) -> tuple[slice, slice]:
        """Steps, after loading, from straight to the end the second time, and from there back."""
        return slice(-2 * _STEPS - 1, -_STEPS), slice(-_STEPS - 1, None)

    def angles(self, insts: Sequence[FullForm | None], *, scaled: bool = False) -> Array:
        """Return the angles of the tip's joints in the loops after loading, (instruments, n, loops, joints), rad.

        NaN from where a run is lost, and where there is no instrument.
        """
        loops, valid = len(self.names), [inst for inst in insts if inst is not None]
        every = [inst for inst in valid for _ in range(loops)]
        angles = np.full((len(insts), self.steps, loops, self.joints), np.nan)
        if not every:
            return angles
        strokes, wrench, grip = (
            (self.scaled_strokes, self.scaled_wrench, self.scaled_grip)
            if scaled
            else (self.strokes, self.wrench, self.grip)
        )
        radius = every[0].own_drives.spool_radius
        wound = np.diff(strokes, axis=1, prepend=strokes[:, :1]) / radius
        step = max(_LEAST_STEP, float(np.abs(wound).max()) / _SLOW)

        def repeated(rows: Array) -> Array:
            return np.tile(np.repeat(rows, 2, axis=1), (len(valid), 1, 1))

        # Spools move by the mean of two velocities: at rest in every second step they are where they are meant to be.
        velocity = repeated(wound / step)
        velocity[:, 1::2] = 0.0
        batch = twin.run_many(
            every,
            repeated(self.handle),
            wrench=repeated(wrench),
            grip_force=repeated(grip) if grip.any() else 0.0,
            spool_velocity=velocity,
            seeds=[0] * len(every),
            every=2,
            time_step=step,
            quasi_static=True,
        )
        found = batch["output_angle"][:, _LOADING:].reshape(len(valid), loops, self.steps, self.joints)
        angles[[inst is not None for inst in insts]] = np.swapaxes(found, 1, 2)
        return angles


def compare_joints(
    real_size: InstrumentLike | WorkingRange, scaled_up: InstrumentLike, *, loads: Sequence[UsualLoad] | None = None
) -> JointComparison:
    """Compare a scaled-up instrument of several joints with the real-size one that it models.

    Parameters
    ----------
    real_size, scaled_up
        Instruments whose joints and tendons have the same names, mechanisms and routes; two planar axes are joints. The
        :attr:`JointComparison.working` of another comparison stands for the first with its loads.
    loads
        The largest on the real-size instrument; by default :func:`tenodesis.statics.usual_loads`.

    Raises
    ------
    ArgumentError
        Joints or tendons differ.
    """
    if not isinstance(real_size, WorkingRange):
        own = expanded(real_size)
        real_size = WorkingRange(own, tuple(statics.usual_loads(own) if loads is None else loads))
    real, scaled = real_size.inst, expanded(scaled_up)
    for what in ("tip_joints", "handle_joints", "tendons"):
        ours, theirs = ([_kind_of(one) for one in getattr(inst, what)] for inst in (real, scaled))
        if ours != theirs:
            odd = next((pair for pair in zip(ours, theirs, strict=False) if pair[0] != pair[1]), (ours, theirs))
            raise ArgumentError(
                f"{scaled.name} has other {what.replace('_', ' ')} than {real.name}: {_words(odd[1])} instead of "
                f"{_words(odd[0])}; names, mechanisms and routes must be the same.",
                key="scaled_up",
                value=scaled.name,
            )
    return JointComparison(real_size, scaled)


def with_pretensions(inst: FullForm, tensions: Array) -> FullForm:
    """Return an instrument with other pretensions of its tendons, (tendons,), N."""
    if np.allclose(inst.pretensions, tensions, rtol=1e-12):
        return inst
    named = zip(inst.as_given("tendons"), tensions.tolist(), strict=True)
    return inst.replace(**{f"tendons.{tendon.name}.pretension": tension for tendon, tension in named})


def _kind_of(one: object) -> tuple[object, ...]:
    if isinstance(one, Joint):
        return one.name, one.mechanism, one.axis_vector
    name, route, start = (getattr(one, key) for key in ("name", "route", "start"))
    return name, start, tuple((crossing.joint, crossing.side, crossing.angle) for crossing in route)


def _words(kind: object) -> str:
    return str(kind[0]) if isinstance(kind, tuple) and kind else f"{len(kind)}" if isinstance(kind, list) else str(kind)


def _fitted(real: Array, scaled: Array) -> float:
    """Return the factor of a load by which the second turns what the first does, by least squares."""
    known = np.isfinite(real) & np.isfinite(scaled)
    across = float((real[known] * scaled[known]).sum())
    own = float((scaled[known] ** 2).sum())
    return across / own if own else 1.0


def _spread(spans: Array) -> Iterator[Array]:
    """Yield the straight state, each joint alone to both sides, and all at once, within spans (joints, 2)."""
    from scipy.stats import qmc  # noqa: PLC0415 - takes half a second

    yield np.zeros(len(spans))
    for n, (low, high) in enumerate(spans):
        for share in _SHARES:
            row = np.zeros(len(spans))
            row[n] = share * (high if share > 0 else -low)
            if row[n]:
                yield row
    if len(spans) > 1:
        for point in qmc.Sobol(len(spans), scramble=True, rng=0).random(_RANDOM):
            yield _WITHIN * (spans[:, 0] + point * (spans[:, 1] - spans[:, 0]))


def _ends(pair: JointComparison) -> Iterator[tuple[str, int]]:
    """Yield the joint and the row of the state in which it alone is bent farthest."""
    states = pair.states
    moved = Bends.of(pair.real_size).summed(states.angles)
    for n, name in enumerate(pair.joints):
        others = np.abs(np.delete(moved, n, axis=1)).max(axis=1, initial=0.0)
        alone = np.where(others < _REACHED, moved[:, n], 0.0)
        if alone.any():
            yield name, int(np.argmax(np.abs(alone) + _REACHED * (alone > 0)))


def _load_rows(loads: Sequence[UsualLoad]) -> tuple[Array, Array]:
    """Return wrenches (n, 6) and grip forces (n,): none, each to both sides and by half, and all at once."""
    rows = [(np.zeros(6), 0.0)]
    for one in loads:
        shares = (0.5, 1.0) if one.grip_force else (-1.0, -0.5, 0.5, 1.0)
        rows += [(share * one.wrench, share * one.grip_force) for share in shares]
    if len(loads) > 1:
        together = np.sum([one.wrench for one in loads], axis=0) / np.sqrt(len(loads))
        rows.append((together, sum(one.grip_force for one in loads) / 2))
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


def _loaded(inst: FullForm, handle: Array, strokes: Array, wrench: Array, grip: Array) -> Array:
    """Return the angles at states under loads, (states, loads, joints), rad."""
    held = handle[:, np.newaxis] if handle.shape[1] else 0.0
    found = chain.output_angles(inst, held, wrench, grip_force=grip, strokes=strokes[:, np.newaxis])
    return np.asarray(found)


def _groups(inst: FullForm) -> Iterator[tuple[tuple[str, Kind, str], float]]:
    """Yield name, kind, meaning and value of the groups without those of a load."""
    radius, stiffness, friction = inst.tip_joints[0].radius, inst.stiffnesses[0], inst.friction
    yield from _groups_of_joints(inst, radius, stiffness)
    yield from _groups_of_tendons(inst, radius, stiffness)
    if inst.grip is not None and inst.grip.length:
        yield ("l(grip)/r", "elastic", "length to what jaws hold over r"), inst.grip.length / radius
    if friction.law != "none":
        values = (friction.vertex_coefficient, friction.sheath_coefficient, friction.sheath_bend)
        of_friction = zip(("mu", "mu_s", "phi_s"), values, strict=True)
        for name, value in (*of_friction, ("f_c/(kr)", friction.constant / stiffness / radius)):
            yield (name, *DEFINITIONS[name]), value
    frequencies = plant.natural_frequencies(inst)
    for n, one in enumerate(frequencies[1:], 2):
        meaning = "natural frequency over the lowest: how the links' inertia is spread"
        yield (f"omega_{n}/omega_1", "inertia", meaning), float(one / frequencies[0])
    if inst.geometry.insertion:
        yield ("insertion/r", "elastic", "length beyond the port over r"), inst.geometry.insertion / radius


def _groups_of_joints(inst: FullForm, radius: float, stiffness: float) -> Iterator[tuple[tuple[str, Kind, str], float]]:
    for joint in inst.joints:
        yield (f"r({joint.name})/r", "elastic", "radius of a joint over the first one's"), joint.radius / radius
        if joint.end_effector_length:
            yield (
                (f"l({joint.name})/r", "elastic", "length to where forces act over r: tension per force"),
                joint.end_effector_length / radius,
            )
        if joint.place == "tip" and joint.is_sprung:
            spring = joint.own_stiffness / (stiffness * radius**2)
            yield (f"kappa({joint.name})/(k r^2)", "elastic", "spring or backbone of a joint over k r²"), spring
        if joint.backbone_length:
            yield (f"L({joint.name})/r", "elastic", "length of a backbone over r"), joint.backbone_length / radius


def _groups_of_tendons(
    inst: FullForm, radius: float, stiffness: float
) -> Iterator[tuple[tuple[str, Kind, str], float]]:
    known = {joint.name: joint for joint in inst.joints}
    for tendon, k, tension in zip(inst.tendons, inst.stiffnesses, inst.pretensions, strict=True):
        name = tendon.name
        yield (f"k({name})/k", "elastic", "stiffness of a tendon over the first one's"), k / stiffness
        meaning = "pretension over k r: when a tendon goes slack"
        yield (f"T_o({name})/(k r)", "pretension", meaning), tension / (stiffness * radius)
        for crossing in tendon.route:
            joint = known[crossing.joint]
            at = f"{name}, {joint.name}"
            if crossing.radius is not None:
                meaning = "arm of a tendon about a joint over r: how it couples joints"
                yield (f"a({at})/r", "elastic", meaning), abs(arm_of(crossing, joint)) / radius
            if crossing.base_wrap:
                yield (f"phi_0({at})", "friction", "bend of a tendon over the straight joint, rad"), crossing.base_wrap
            if crossing.guide_wrap:
                yield (f"phi_g({at})", "friction", "bend of a tendon over guides, rad"), crossing.guide_wrap
            if crossing.coefficient is not None:
                yield (f"mu({at})", "friction", "friction coefficient of a contact"), crossing.coefficient

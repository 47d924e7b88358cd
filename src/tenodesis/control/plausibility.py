"""What is implausible about an instrument: values that a file may have, but hardly any instrument has."""

from collections.abc import Callable, Iterator
from math import degrees, inf, pi, radians
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tenodesis import kinematics, plant, statics
from tenodesis._core import Status, unloaded_limit
from tenodesis.control.one_arc import one_arc
from tenodesis.control.parameters import tension_limit
from tenodesis.control.resolution import warnings as unresolved
from tenodesis.errors import Error, InstrumentError
from tenodesis.instrument import FullForm, Instrument, InstrumentLike, ShortForm, as_instrument
from tenodesis.instrument.tip_motion import tip_inertia
from tenodesis.statics import Equilibrium
from tenodesis.statics.chain import equilibrium, rates, straight_arms

_STEEL = 7850.0  # kg/m^3
_MODULUS = (1e9, 250e9)  # Pa, of ropes: soft braids to tungsten wire
_STRESS, _LIMIT_STRESS = 1e9, 2e9  # Pa, at rest and at the tension limit
_STRAIN = 0.05
_AT_ITS_END = 1 - 1e-6  # of a joint's bend over its limit
_PULLEY_PER_ROPE = 4.0  # diameters
_COEFFICIENT = 0.6
_INERTIA_OVER_ROD = 10.0
_ROD_OVER_INERTIA = 50.0
_MORE = (2.0, 4.0, 8.0, 16.0)  # pretensions
_ROUND_UP = 1.01
_SIMULATED = 26.0  # over the least inertia that can be simulated: what identification asks for, with a margin
_LENGTH = (0.05, 3.0)  # m
_HAND_SPEED = radians(60)  # rad/s
_REACH = _FROM_STRAIGHT = radians(0.5)
_DISTURBANCE = 0.05  # of the joint that is moved


class Implausible(NamedTuple):
    """A value that is allowed, but hardly meant."""

    key: str
    """Key of the file, with the table before a dot."""
    sentence: str


class Rule(NamedTuple):
    """A rule of the short form: the key that it is about, and what it finds."""

    key: str
    find: Callable[[ShortForm], str]
    """Returns the sentence, empty if the value is plausible; its instrument has one axis."""


def implausible(inst: InstrumentLike) -> tuple[Implausible, ...]:
    """Return what is implausible about an instrument, each in one sentence; of axes, what their sensors lack too."""
    given = as_instrument(inst)
    if (short := given.short_form) is None:
        joints = given.expanded
        return tuple(Implausible(key, sentence) for key, find in JOINT_RULES for sentence in find(joints))
    found: dict[str, Implausible] = {}
    several = bool(short.overrides)
    for axis in short.planar if several else short.planar[:1]:
        for rule in RULES:
            sentence = rule.find(axis)
            if sentence:
                # An axis without a value of its own has the same mistake.
                found.setdefault(sentence, Implausible(rule.key, sentence))
    for sentence in unresolved(short):
        found.setdefault(sentence, Implausible("sensors", sentence))
    try:
        plant.check_runnable(short)
    except Error as problem:
        sentence = f"this file can be neither run live nor simulated in time steps of {plant.TIME_STEP:g} s: {problem}"
        found[sentence] = Implausible(problem.key, sentence)
    return tuple(found.values())


def solid_tip_inertia(inst: ShortForm) -> float:
    """Return the inertia about its joint, kg m^2, of a steel rod of the stem's diameter and the end-effector's length.

    Without a stem diameter it is as wide as the distal joint.
    """
    width = inst.stem_diameter or 2 * _radius(inst, "distal")
    mass = _STEEL * pi / 4 * width**2 * inst.end_effector_length
    return mass * inst.end_effector_length**2 / 3


def _radius(inst: ShortForm, end: str) -> float:
    return float(getattr(inst, _radius_key(inst, end)))


def _radius_key(inst: ShortForm, end: str) -> str:
    return next(field for field, parameter in inst.parameter_fields.items() if parameter == f"{end}_radius")


def _section(inst: ShortForm) -> float | None:
    """Return the section of a tendon, m^2, if its diameter is known."""
    return None if inst.tendon_diameter is None else pi / 4 * inst.tendon_diameter**2


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g} mm"


def _modulus(inst: ShortForm) -> str:
    modulus = inst.tendon_modulus
    if modulus is None or inst.given_stiffness is not None or _MODULUS[0] <= modulus <= _MODULUS[1]:
        return ""
    shown = f"{modulus / 1e9:.3g} GPa" if modulus >= 1e9 else f"{modulus / 1e6:.3g} MPa"
    return (
        f"tendon_modulus is {shown}; ropes have {_MODULUS[0] / 1e9:g} to {_MODULUS[1] / 1e9:g} GPa, "
        "those of steel 50 to 190 GPa."
    )


def _strain(inst: ShortForm) -> str:
    strain = inst.pretension / inst.tendon_stiffness / (inst.tendon_length or inst.overall_length)
    if strain <= _STRAIN:
        return ""
    return f"pretension is {inst.pretension:g} N, which stretches a tendon by {100 * strain:.3g} % of its length."


def _stress(inst: ShortForm) -> str:
    section = _section(inst)
    if section is None:
        return ""
    if inst.pretension / section > _STRESS:
        return (
            f"pretension is {inst.pretension:g} N, a stress of {inst.pretension / section / 1e9:.3g} GPa in a tendon "
            f"of {_mm(inst.tendon_diameter or 0)}; ropes of steel break at 1.5 to 2 GPa."
        )
    limit = tension_limit(inst)
    if limit / section > _LIMIT_STRESS:
        return (
            f"the motors wind up to {limit:.3g} N, a stress of {limit / section / 1e9:.3g} GPa in a tendon of "
            f"{_mm(inst.tendon_diameter or 0)}; give breaking_load, or a smaller control.tension_limit."
        )
    return ""


def _strength(inst: ShortForm) -> str:
    limit = inst.control.tension_limit
    if limit is None or inst.breaking_load is None or limit < inst.breaking_load:
        return ""
    return f"control.tension_limit is {limit:g} N, and tendons break at a breaking_load of {inst.breaking_load:g} N."


def _no_pretension(inst: ShortForm) -> str:
    return "pretension is 0 N: a tendon is slack under any load." if inst.pretension == 0 else ""


def _slack(inst: ShortForm) -> str:
    least = min(inst.conditions.forces, default=inf)
    forces = _slack_loads(inst)
    force = float(np.fmin.reduce(forces))
    if force == 0 < inst.pretension:
        return (
            f"pretension is {inst.pretension:g} N, with which a tendon is slack without a load "
            f"{'at the straight tip' if forces[0] == 0 else 'at the end of the working range'}{_enough(inst, least)}."
        )
    if not 0 < force < least < inf:
        return ""
    return (
        f"pretension is {inst.pretension:g} N, with which a tendon goes slack at {force:.2g} N at the tip already, "
        f"below the smallest of conditions.forces, {least:g} N{_enough(inst, least)}."
    )


def _slack_loads(inst: ShortForm) -> NDArray[np.float64]:
    """Return the loads, N, under which a tendon goes slack, straight and at the end of the working range."""
    loads: NDArray[np.float64] = statics.slack_load(inst, np.array([0.0, statics.reach(inst)]))
    return loads


def _enough(inst: ShortForm, load: float) -> str:
    """Return the pretension that keeps the tendons taut up to a load, as the end of a sentence."""
    from scipy.optimize import brentq  # noqa: PLC0415

    def spare(pretension: float) -> float:
        return float(np.fmin.reduce(_slack_loads(inst.replace(pretension=pretension)))) - load

    most = next((times * inst.pretension for times in _MORE if spare(times * inst.pretension) > 0), None)
    if most is None:
        return ""
    found = brentq(spare, inst.pretension, most, rtol=1e-3)
    return f"; a pretension of {_ROUND_UP * found:.3g} N keeps them taut up to {load:g} N"


def _pulley_in_stem(inst: ShortForm) -> str:
    key, radius = _radius_key(inst, "distal"), _radius(inst, "distal")
    if inst.stem_diameter is None or 2 * radius <= inst.stem_diameter:
        return ""
    wide = "the tendons are" if inst.joint_type == "continuum" else "the joint is"
    return (
        f"{key} is {_mm(radius)}, so that {wide} {_mm(2 * radius)} wide, wider than the stem of "
        f"{_mm(inst.stem_diameter)}."
    )


def _rope_in_stem(inst: ShortForm) -> str:
    if inst.stem_diameter is None or inst.tendon_diameter is None or 2 * inst.tendon_diameter < inst.stem_diameter:
        return ""
    return f"tendon_diameter is {_mm(inst.tendon_diameter)}: two tendons fill the stem of {_mm(inst.stem_diameter)}."


def _rope_on_pulley(inst: ShortForm) -> str:
    return _rope_on(inst, "a pulley", _radius(inst, "distal")) if inst.joint_type == "tendon-pulley" else ""


def _rope_on(inst: Instrument, pulley: str, radius: float) -> str:
    rope = inst.tendon_diameter
    if rope is None or 2 * radius >= _PULLEY_PER_ROPE * rope:
        return ""
    return (
        f"tendon_diameter is {_mm(rope)}, on {pulley} of only {2 * radius / rope:.2g} times that; ropes last on "
        f"pulleys of at least {_PULLEY_PER_ROPE:g} times their diameter."
    )


def _length(inst: ShortForm) -> str:
    if _LENGTH[0] <= inst.overall_length <= _LENGTH[1]:
        return ""
    return f"overall_length is {_mm(inst.overall_length)}; instruments have {_mm(_LENGTH[0])} to {_LENGTH[1]:g} m."


def _stem(inst: ShortForm) -> str:
    try:
        kinematics.dimensions(inst)
    except InstrumentError as problem:
        return str(problem)
    return ""


def _rods(inst: ShortForm) -> str:
    if inst.joint_type != "continuum" or len(inst.axes) < 2:
        return ""
    return (
        f"axes are {' and '.join(inst.axes)}, each a backbone of its own, {len(inst.axes)} of "
        f"{1e3 * inst.backbone_length:.4g} mm one after another; one backbone that bends in two planes is listed as a "
        "joint with planes = 2."
    )


def _reach(inst: ShortForm) -> str:
    reached = float(statics.output_angle(inst, np.array([inst.handle_range]))[0])
    if unloaded_limit(inst.spec) > _AT_ITS_END:
        return (
            f"handle_range is {degrees(inst.handle_range):.4g} deg, which bends the unloaded tip by "
            f"{degrees(reached):.4g} deg, all that its joint can; its stop is at {degrees(inst.output_stop):.4g} deg, "
            "and tenodesis scale takes a smaller handle_range only."
        )
    if not reached < inst.output_range - _REACH:
        return ""
    return (
        f"handle_range is {degrees(inst.handle_range):.4g} deg, which bends the unloaded tip by {degrees(reached):.3g} "
        f"deg only; output_range is {degrees(inst.output_range):.4g} deg."
    )


def _load(inst: ShortForm) -> str:
    force = max(inst.conditions.forces, default=0.0)
    handle = np.linspace(0.0, statics.reach(inst), 17)
    if np.isfinite(statics.output_angle(inst, handle, force)).all():
        return ""
    return f"conditions.forces has {force:g} N, which the tip cannot hold over its working range."


def _sheath(inst: ShortForm) -> str:
    friction = inst.friction
    bends = friction.sheath_bend or friction.sheath_bend_per_handle_angle
    if friction.sheath_coefficient and not bends:
        return (
            f"friction.sheath_coefficient is {friction.sheath_coefficient:g}, but without a bend it has no effect; "
            "give friction.sheath_bend."
        )
    if bends and not friction.sheath_coefficient:
        return "friction.sheath_bend is given, but without friction.sheath_coefficient it has no effect."
    return ""


def _law(inst: ShortForm) -> str:
    friction = inst.friction
    given = (friction.vertex_coefficient, friction.sheath_coefficient, friction.constant, friction.viscous)
    if friction.law == "none" or any(given):
        return ""
    return f'friction.law is "{friction.law}", but no coefficient is given, so that there is no friction.'


def _coefficient(inst: ShortForm) -> str:
    for key in ("vertex_coefficient", "sheath_coefficient"):
        value = getattr(inst.friction, key)
        if value > _COEFFICIENT:
            return f"friction.{key} is {value:g}; ropes on metal or plastic have 0.03 to 0.3."
    return ""


def _inertia(inst: ShortForm) -> str:
    rod, given = solid_tip_inertia(inst), inst.dynamics.tip_inertia
    inertia = tip_inertia(inst)
    swings = f"{plant.natural_frequency(inst) / (2 * pi):.3g} Hz"
    if given is None:
        problem = f"dynamics.tip_inertia is not given, so that the tip swings at {swings}: {inertia:.2g} kg*m^2, "
    else:
        problem = f"dynamics.tip_inertia is {inertia:.2g} kg*m^2, with which the tip swings at {swings}, "
    size = f"a steel rod of the end-effector's size ({rod:.2g} kg*m^2)"
    if inertia > _INERTIA_OVER_ROD * rod:
        # The least that can be simulated is no mistake of the file.
        return (
            ""
            if inertia <= _SIMULATED * plant.least_tip_inertia(inst)
            else f"{problem}{inertia / rod:.0f} times {size}."
        )
    if _ROD_OVER_INERTIA * inertia < rod:
        return f"{problem}a {rod / inertia:.0f}th of {size}."
    return ""


def _load_cell(inst: ShortForm) -> str:
    limit, largest = tension_limit(inst), inst.tension_sensor.range
    given = f"sensors.load_cell_range is {largest:g} N"
    if inst.sensors.kind == "current":
        given = f"sensors.current_range is {inst.sensors.current_range:g} A, which stands for {largest:.3g} N"
    if largest <= inst.pretension:
        return f"{given}, which the pretension of {inst.pretension:g} N takes up already."
    if largest < limit:
        return f"{given}, below control.tension_limit, {limit:.3g} N."
    if largest < 1.5 * inst.pretension:
        return f"{given}, which leaves little above the pretension of {inst.pretension:g} N."
    return ""


def _motors(inst: ShortForm) -> str:
    drives = inst.drives
    wound = drives.motor_speed / drives.gear_ratio * drives.spool_radius
    asked = inst.control.tendon_speed
    if asked is not None and asked > wound:
        return f"control.tendon_speed is {1e3 * asked:.3g} mm/s, and the motors wind {1e3 * wound:.3g} mm/s at most."
    needed = _radius(inst, "proximal") * _HAND_SPEED
    if wound >= needed:
        return ""
    return (
        f"drives.motor_speed is {degrees(drives.motor_speed):.4g} deg/s, with which the spools wind {1e3 * wound:.2g} "
        f"mm/s; a hand at {degrees(_HAND_SPEED):.0f} deg/s moves the tendons by {1e3 * needed:.2g} mm/s."
    )


RULES: tuple[Rule, ...] = (
    Rule("overall_length", _length),
    Rule("overall_length", _stem),
    Rule("stem_diameter", _pulley_in_stem),
    Rule("tendon_diameter", _rope_in_stem),
    Rule("tendon_diameter", _rope_on_pulley),
    Rule("tendon_modulus", _modulus),
    Rule("pretension", _no_pretension),
    Rule("pretension", _strain),
    Rule("pretension", _stress),
    Rule("pretension", _slack),
    Rule("axes", _rods),
    Rule("handle_range", _reach),
    Rule("conditions.forces", _load),
    Rule("friction.sheath_coefficient", _sheath),
    Rule("friction.law", _law),
    Rule("friction.vertex_coefficient", _coefficient),
    Rule("dynamics.tip_inertia", _inertia),
    Rule("drives.motor_speed", _motors),
    Rule("sensors.load_cell_range", _load_cell),
    Rule("control.tension_limit", _strength),
)
"""The rules of the short form, in the order of its file."""


def _at_rest(inst: FullForm) -> Equilibrium:
    return equilibrium(inst, np.zeros((1, len(inst.handle_joints))))


def _rest(inst: FullForm) -> Iterator[str]:
    rest = _at_rest(inst)
    if rest.status[0] != Status.OK:
        yield "without a load and with the handle straight, the joints find no equilibrium under the pretension."
        return
    off = [
        f"{joint.name} at {degrees(angle):.2g}°"
        for joint, angle in zip(inst.tip_joints, rest.output_angle[0], strict=True)
        if abs(angle) > _FROM_STRAIGHT
    ]
    if off:
        yield f"the pretensions do not balance: with a straight handle, joints rest off straight, {', '.join(off)}."


def _slack_at_rest(inst: FullForm) -> Iterator[str]:
    slack = [t.name for t, tension in zip(inst.tendons, _at_rest(inst).tensions[0], strict=True) if tension == 0]
    if slack:
        yield f"slack without a load: {', '.join(slack)}."


def _overloaded(inst: FullForm) -> Iterator[str]:
    largest = float(inst.pretensions.max())
    if inst.breaking_load is not None and largest >= inst.breaking_load:
        yield f"pretension is {largest:g} N, and tendons break at a breaking_load of {inst.breaking_load:g} N."


def _useless(inst: FullForm) -> Iterator[str]:
    for tendon, arms in zip(inst.tendons, inst.tendon_arms("tip"), strict=True):
        if not arms.any():
            yield f"tendon {tendon.name} bends no joint at the tip: it crosses none, or all in their middle."


def _disturbing(inst: FullForm) -> Iterator[str]:
    """Yield what the handle's joints turn besides; without a handle, what the tendons that end at a joint turn."""
    found = rates(inst, np.zeros((1, len(inst.handle_joints))))
    names, bends = list(inst.bends), list(inst.bends.values())
    if inst.handle_joints:
        moves = [
            (f"handle joint {joint.name}", column)
            for joint, column in zip(inst.handle_joints, found.by_handle[0].T, strict=True)
        ]
    else:
        ends, arms = np.array([tendon.route[-1].joint for tendon in inst.tendons]), straight_arms(inst)
        moves = [
            (
                f"the tendons that end at joint {name}",
                found.by_stroke[0] @ np.where(ends == inst.tip_joints[bend[-1]].name, arms[:, bend[-1]], 0.0),
            )
            for name, bend in zip(names, bends, strict=True)
        ]
    for what, angles in moves:
        turned = np.array([angles[bend].sum() for bend in bends])
        if not np.isfinite(turned).all() or not turned.any():
            continue
        most = int(np.argmax(np.abs(turned)))
        others = [
            f"{name} by {share:+.2g}"
            for name, share in zip(names, turned / turned[most], strict=True)
            if name != names[most] and abs(share) > _DISTURBANCE
        ]
        if others:
            yield f"turning {names[most]} by {what} also turns {', '.join(others)} of its angle."


def _wider_than_stem(inst: FullForm) -> Iterator[str]:
    for joint in inst.tip_joints:
        if inst.stem_diameter is not None and 2 * joint.radius > inst.stem_diameter:
            yield (
                f"radius of joint {joint.name} is {_mm(joint.radius)}, so that it is {_mm(2 * joint.radius)} wide, "
                f"wider than the stem of {_mm(inst.stem_diameter)}."
            )


def _rope_on_joints(inst: FullForm) -> Iterator[str]:
    pulleys = [joint for joint in inst.tip_joints if joint.mechanism == "pulley"]
    yield from filter(None, (_rope_on(inst, f"joint {joint.name}", joint.radius) for joint in pulleys))


def _one_arc(inst: FullForm) -> Iterator[str]:
    found = one_arc(inst)
    if found is not None and found.matters:
        yield (
            f"{found.joint} bends as one arc: {found.force:g} N across moves the tip by {1e3 * found.given:.3g} mm, "
            f"and by {1e3 * found.finer:.3g} mm in {found.arcs} arcs, which bend into an S; give arcs = {found.arcs}"
        )


JOINT_RULES: tuple[tuple[str, Callable[[FullForm], Iterator[str]]], ...] = (
    ("pretension", _rest),
    ("pretension", _slack_at_rest),
    ("pretension", _overloaded),
    ("tendons.route", _useless),
    ("tendons.route", _disturbing),
    ("joints.arcs", _one_arc),
    ("joints.radius", _wider_than_stem),
    ("joints.radius", _rope_on_joints),
)
"""The rules of a file of joints and tendons: the key that each is about, and what yields its sentences."""

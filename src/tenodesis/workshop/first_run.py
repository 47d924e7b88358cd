"""The first run of a scale model: its protocol, what must be read at every step, and what the motors must do."""

import json
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tenodesis import statics
from tenodesis.control import Controller, JointController
from tenodesis.control.parameters import tension_limit
from tenodesis.errors import FaultWarning, NoSolutionError
from tenodesis.instrument import FullForm, Instrument, expanded
from tenodesis.run import Array, Run, fault_bits
from tenodesis.scaling import AnyDesign, TestLoad
from tenodesis.simulate import Protocol, execute
from tenodesis.simulate.protocol import parse
from tenodesis.statics import chain
from tenodesis.twin import Twin

FIRST_RUN, CONTROLLED = "first-run.toml", "first-run-controlled.toml"
UNCERTAIN = (0.5, 2.0)
"""Share of the guessed friction between which a reading must lie."""
MARGIN = 1.5
"""Of the motors' speed over what the twin's runs need; and of their torque for a moment over what they hold."""
_OF_LIMIT = 0.9  # of the controller's limit: the largest tension of the first run without friction
_OF_SLACK = 0.8  # of the load at which a tendon goes slack: the largest load of the first run
_SMALL = np.radians(20)  # rad, output
_SPEED = np.radians(10)  # rad/s, handle
_LEAST_TOLERANCE = 0.5  # N
_DELAY, _RISE, _HELD = 0.5, 0.5, 2.0  # s, of a load
_PAUSE, _BRIEF = 10.0, 1.0  # s, in which people read, or a twin comes to rest
_FOR_LOADS, _LONGEST_HELD = 160.0, 20.0  # s, in which weights hang in all, and one at most
_STROKE, _STROKE_SPEED = np.radians(6), np.radians(2)  # rad and rad/s, of the handle
_FASTER = 4.0
"""Times that slow moves are faster in a brief run."""
_JOG, _JOG_HELD, _JOG_RAMP = 0.2, 1.0, 0.3  # share of a tendon's stretch, and s
_WINDOW = 0.5  # s, over which readings are averaged
_SHARE_OF_RANGE = 0.02  # of a reading: what encoders and cells leave open
_LEAST_TURN = 0.3  # deg, of a joint under a load: less is not read
_SHARES = np.arange(10, 0, -1) / 10  # of a joint's range, the largest of which is held
_REACHED = 1e-3  # rad
_SPOOL_RISE = 0.2  # s, in which spools that move joints come to their speed
_LOADS = ("force", "wrench", "applied_grip_force")
_BEFORE = 0.4  # s, from the start of a step load, whose load comes later


class Reading(NamedTuple):
    """What must be read at a step of the first run, in deg or N."""

    step: str
    what: str
    unit: str
    expected: float
    low: float
    high: float
    otherwise: str
    """What to look for if it is not."""


class Demand(NamedTuple):
    """What a drive must do at its spool, from the twin's runs under the controller; speeds without a margin."""

    seen: float
    """N, largest in the runs."""
    largest_tension: float
    """N, the controller's limit, below which the first run stays."""
    torque: float
    """N*m at the spool, at that tension."""
    speed: float
    """rad/s."""
    acceleration: float
    """rad/s^2."""

    @property
    def inertia(self) -> float:
        """Largest inertia of rotor and gearing at the spool, kg*m^2, that the margin of torque accelerates."""
        return (MARGIN - 1) * self.torque / self.acceleration


@dataclass(frozen=True)
class FirstRun:
    """The first run of a scale model, as the twin has it; :func:`rehearse` makes it."""

    protocol: Protocol
    readings: tuple[Reading, ...]
    demand: Demand
    left: float
    """Largest difference in output angle, deg, that the controller leaves under a load of the protocol, at rest."""
    faults: int
    """Mask of the controller's faults over the protocol; 0 if there is none."""


class _Stage(NamedTuple):
    """A step of the first run: a comment, its phases, and what is read at the end of which of them."""

    comment: str
    phases: tuple[str, ...]
    read: str = ""
    """What is read at it: slack, tighten, jog, bend, move or load; nothing by default."""
    value: float = 0.0
    """Angle, rad, number of the tendon, or number of the test load."""
    winds: bool = False
    """Whether it moves the motors, so that it is left out with a controller."""
    bend: int = 0
    """What bends in it, by number."""


def protocol(design: AnyDesign, *, controlled: bool = False, brief: bool = False) -> Protocol:
    """Return the protocol of the first run of a design, or what of it a controller runs.

    A brief one has the same phases, with fewer cycles and shorter holds.
    """
    text = "\n".join(_text(design, _stages(design, brief=brief), controlled=controlled))
    return parse(f'name = "first run"\n{text}', FIRST_RUN)


def protocol_text(design: AnyDesign, about: str = "", *, controlled: bool = False) -> str:
    """Return the text of the file of that protocol; `about` says how similar the design is."""
    name, law = (CONTROLLED, f" --law {law_of(design.bench)}") if controlled else (FIRST_RUN, "")
    head = [
        f"# From rope to loaded tip, for {design.scaled_up.name}. On the twin:",
        "#",
        f"#   tenodesis record scaled-up.toml {name}{law} --out {Path(name).stem}.mcap",
        *([f"#\n# {about}"] if about else []),
        "",
        f'name = "first run{", with the controller" if controlled else ""}"',
        'description = "Tighten, jog, strokes at several bends, moves, weights one by one, cycles, excitation"',
        "",
    ]
    return "\n".join([*head, *_text(design, _stages(design), controlled=controlled)])


def law_of(inst: Instrument) -> str:
    """Return the law of the controller that the first run tries: that of all joints where they share tendons."""
    return "joints" if inst.short_form is None else "robust"


def _kept(design: AnyDesign, stages: Sequence[_Stage], *, controlled: bool) -> list[_Stage]:
    """Return the steps of a protocol: a controller has the motors, and one of all joints finds tendons tight."""
    if not controlled:
        return list(stages)
    tightens = law_of(design.bench) == "robust"
    return [one for one in stages if not one.winds and (tightens or one.read != "tighten")]


def _text(design: AnyDesign, stages: Sequence[_Stage], *, controlled: bool) -> Iterator[str]:
    for stage in _kept(design, stages, controlled=controlled):
        yield f"# {stage.comment}"
        yield from stage.phases


class _Bend(NamedTuple):
    """What bends at the tip by itself, and how handle or motors hold it."""

    inst: FullForm
    number: int
    name: str
    ends: tuple[float, float]
    """Farthest that is held, below and above straight, rad."""

    @classmethod
    def all_of(cls, inst: FullForm) -> "list[_Bend]":
        """Return those of an instrument that its handle or motors turn."""
        found = []
        for number, (name, limits) in enumerate(zip(inst.bends, inst.bend_limits, strict=True)):
            one = cls(inst, number, name, (0.0, 0.0))
            low, high = (next((share * end for share in _SHARES if one._is_held(share * end)), 0.0) for end in limits)
            if low or high:
                found.append(one._replace(ends=(low, high)))
        return found

    def at(self, share: float) -> float:
        """Return the angle, rad, at a share of the end to one side."""
        return share * self.ends[1] if share > 0 else -share * self.ends[0]

    def held(self, angle: float) -> tuple[Array, Array]:
        """Return the handle's angles (rad) and the motors' strokes (m) that hold an angle, rad, the others straight."""
        return statics.hold(self.inst, self.inst.bent(angle * np.eye(len(self.inst.bends))[self.number]))

    def _is_held(self, angle: float) -> bool:
        try:
            handle, strokes = self.held(angle)
            reached = chain.output_angles(self.inst, handle, strokes=strokes) @ self.row
        except NoSolutionError:
            return False
        within = np.abs(handle) <= np.array([joint.range for joint in self.inst.handle_joints]) * (1 + 1e-9)
        return bool(angle and within.all() and abs(reached - angle) < _REACHED)

    @property
    def row(self) -> Array:
        """Ones at the joints that it has, (joints,)."""
        return np.isin(np.arange(len(self.inst.tip_joints)), self.inst.bends[self.name]).astype(float)

    def joint(self, angle: float) -> tuple[str, float] | None:
        """Return the joint of the handle, and its angle, rad, that holds an angle; None if more than one does."""
        handle, _ = self.held(angle)
        moved = np.flatnonzero(np.abs(handle) > _REACHED)
        return (self.inst.handle_joints[moved[0]].name, float(handle[moved[0]])) if moved.size == 1 else None

    @property
    def speed(self) -> float:
        """Of the joint of the handle, or of the tip where motors turn it, rad/s."""
        far = max(self.ends, key=abs)
        joint = self.joint(far)
        return float(2 * _SPEED if joint is None else min(_SPEED, abs(joint[1]) / 2))

    def cycles(
        self, near: float, far: float, speed: float, count: int, load: Mapping[str, Any] | None = None, **more: str
    ) -> list[str]:
        """Return the phases of moves between two angles, rad, and back."""
        joint = self.joint(far)
        if joint is not None:
            start = self.joint(near) if near else None
            from_ = {} if start is None else {"from": _deg(start[1])}
            speed_ = f"{math.degrees(speed):.4g} deg/s"
            return [
                _phase("cycles", joint=joint[0], **from_, amplitude=_deg(joint[1]), speed=speed_, count=count,
                       **(load or {}), **more)
            ]  # fmt: skip
        first = [] if load is None else [_phase("ramp", duration="0.5 s", **load)]
        there, back = self.moved(near, far, speed), self.moved(far, near, speed)
        begin = self.moved(0.0, near, 2 * _SPEED) if near else []
        return [*first, *begin, *(there + back) * count, *(self.moved(near, 0.0, 2 * _SPEED) if near else [])]

    def moved(self, before: float, after: float, speed: float) -> list[str]:
        """Return the phases of a move from one angle to another, rad, at a speed, rad/s."""
        seconds = max(abs(after - before) / speed, 2 * _SPOOL_RISE)
        (handle, strokes), (_, old) = self.held(after), self.held(before)
        found = []
        if handle.size:
            angles = {joint.name: _deg(angle) for joint, angle in zip(self.inst.handle_joints, handle, strict=True)}
            found.append(_phase("ramp", duration=f"{seconds:.4g} s", handle_angles=angles))
        speeds = (strokes - old) / self.inst.own_drives.spool_radius / seconds
        wound = {t.name: v for t, v in zip(self.inst.tendons, speeds, strict=True) if v and t.start == "spool"}
        return found + (_wound(wound, seconds) if wound else [])

    def loaded(self, test: TestLoad, shares: Sequence[float], held: float) -> tuple[str, ...]:
        """Return the phases in which a load hangs at shares of its ends, one after another."""
        found: list[str] = []
        for share in shares:
            angle = self.at(share)
            joint = self.joint(angle) if angle else None
            if joint is not None:
                found.append(_load(test, held, joint=joint[0], handle_angle=_deg(joint[1])))
            elif angle:
                there, back = self.moved(0.0, angle, 2 * _SPEED), self.moved(angle, 0.0, 2 * _SPEED)
                found += [*there, _load(test, held), *back]
        return tuple(found)


def _stages(design: AnyDesign, *, brief: bool = False) -> list[_Stage]:
    """Return the steps of the first run; those that are read come first."""
    inst = design.bench
    whole = expanded(inst)
    bends = _Bend.all_of(whole)
    pause = _BRIEF if brief else _PAUSE
    count, faster = (1, _FASTER) if brief else (2, 1.0)
    loads = _loads(design, bends)
    # Weights are hung by hand.
    hung = len(loads) * (1 + 2 * len(bends))
    held = _BRIEF if brief else min(_LONGEST_HELD, _FOR_LOADS / hung)
    tolerance = f"{_tolerance(inst):.3g} N"
    found = [
        _Stage("Motors off, ropes loose: the cells read nothing.", (_hold(pause),), "slack", winds=True),
        _Stage(
            "The motors wind until all load cells read the pretension; under a controller this is its homing.",
            (_phase("pretension", tolerance=tolerance, timeout="60 s"), _hold(pause)),
            "tighten",
        ),
    ]
    motors = [n for n, tendon in enumerate(whole.tendons) if tendon.start == "spool"]
    for number in motors:
        comment = f"Jog: the motor of {whole.tendons[number].name} winds and lets out again."
        found.append(_Stage(comment, _jogged(whole, [number]), "jog", number, winds=True))
    for place, one in enumerate(bends):
        for share in (0.0, 0.5, 1.0, -0.5, -1.0):
            angle = one.at(share)
            if share == 0 or angle:
                comment = f"Friction: a short stroke of {one.name} at a bend of {math.degrees(angle):.0f} deg."
                phases = (*_stroke(one, angle, count, faster), _hold(_BRIEF))
                found.append(_Stage(comment, phases, "bend", angle, bend=place))
        for angle in (min(_SMALL, max(one.ends)), one.ends[1], one.ends[0]):
            if angle:
                comment = f"{one.name} slowly to {math.degrees(angle):.0f} deg and back."
                phases = tuple(one.cycles(0.0, angle, one.speed / 2 * faster, count))
                found.append(_Stage(comment, phases, "move", angle, bend=place))
    for number, test in enumerate(loads):
        found.append(_Stage(f"{_hung(test)}.", (_load(test, held),), "load", number))
    for one in bends:
        ends = [angle for angle in reversed(one.ends) if angle]
        fast = tuple(phase for angle in ends for phase in one.cycles(0.0, angle, 3 * one.speed, 2 * count))
        found.append(_Stage(f"The same moves of {one.name} fast.", fast))
        found += [
            _Stage(f"{_hung(test)}, {one.name} at half the bend either way.", one.loaded(test, (0.5, -0.5), held))
            for test in loads
        ]
        under = [
            phase for angle in ends for phase in one.cycles(0.0, angle, one.speed * faster, count, loads[0].applied)
        ]
        lifted = _phase("ramp", duration="2 s", **loads[0]._replace(force=0.0).applied)
        found.append(_Stage(f"{_hung(loads[0])}: {one.name} slowly under the weight.", (*under, lifted, _hold(_BRIEF))))
    found += _excitation(whole, bends, motors, loads[0])
    found.append(_Stage("At rest: cells and encoders read what they read after tightening.", (_hold(pause),)))
    return found


def _excitation(inst: FullForm, bends: Sequence[_Bend], motors: Sequence[int], test: TestLoad) -> Iterator[_Stage]:
    """Yield the motions that tenodesis identify needs: of joints, and of the motors, at several loads."""

    def moved(shares: Sequence[float]) -> tuple[str, ...]:
        return tuple(
            phase
            for one in bends
            for share in shares
            if one.at(share)
            for phase in one.cycles(0.0, one.at(share), 3 * one.speed, 2, shape="sine")
        )

    yield _Stage("For tenodesis identify: joints at two speeds, motors, a weight.", moved((0.8, -0.8, 0.4, -0.4)))
    yield _Stage(
        "All motors wind and let out together, then one after another.",
        (*_jogged(inst, motors, 2), *(part for n in motors for part in _jogged(inst, [n]))),
        winds=True,
    )
    yield _Stage(f"{_hung(test)}, for identification.", (_load(test, _HELD), *moved((0.8, -0.8))))


def _deg(angle: float) -> str:
    return f"{math.degrees(angle):.6g} deg"


def _angle(angle: float) -> str:
    return f"{math.degrees(angle):.0f}°".replace("-", "\N{MINUS SIGN}")


def _hung(test: TestLoad) -> str:
    return f"{test.weights.sentence.partition(':')[0]}: {test.real_force:.3g} N on the real-size tip, {test.direction}"


def _load(test: TestLoad, held: float, **at: str) -> str:
    return _phase(
        "step-load", **at, **test.applied, delay=f"{_DELAY:g} s", rise=f"{_RISE:g} s", duration=f"{held:.4g} s",
        release=f"{held / 2:.4g} s",
    )  # fmt: skip


def _hold(seconds: float) -> str:
    return _phase("hold", duration=f"{seconds:.6g} s")


def _stroke(bend: _Bend, angle: float, count: int, faster: float) -> list[str]:
    """Return a short stroke about an angle of the tip, rad, toward the straight where it ends."""
    speed, joint = _STROKE_SPEED * faster, bend.joint(angle or max(bend.ends, key=abs))
    if joint is None:
        near = angle - math.copysign(_STROKE, angle or max(bend.ends, key=abs))
        return bend.cycles(near if angle else 0.0, angle or -near, speed, count)
    name, at = joint if angle else (joint[0], 0.0)
    return [
        _phase("cycles", joint=name, **{"from": _deg(at - math.copysign(_STROKE, at))}, amplitude=_deg(at),
               speed=f"{math.degrees(speed):.4g} deg/s", count=count)
    ]  # fmt: skip


def _jogged(inst: FullForm, motors: Sequence[int], times: int = 1) -> tuple[str, ...]:
    """Return the ramps of motors that wind a share of the tendons' stretch and let it out again."""
    names = [inst.tendons[n].name for n in motors]
    angles = _JOG * inst.pretensions.max() / inst.stiffnesses[motors] / inst.own_drives.spool_radius
    speeds = dict(zip(names, (angles / (_JOG_HELD + _JOG_RAMP)).tolist(), strict=True))
    there = [*_wound(speeds, _JOG_HELD + _JOG_RAMP, _JOG_RAMP), _hold(_BRIEF)]
    back = _wound({name: -one for name, one in speeds.items()}, _JOG_HELD + _JOG_RAMP, _JOG_RAMP)
    return (*there, *back, _hold(_BRIEF)) * times


def _wound(speeds: Mapping[str, float], seconds: float, rise: float = _SPOOL_RISE) -> list[str]:
    """Return phases in which spools turn at speeds (rad/s), from rest to rest."""
    turning = {name: f"{math.degrees(speed):.6g} deg/s" for name, speed in speeds.items()}
    return [
        _phase("ramp", duration=f"{rise:g} s", spool_velocities=turning),
        _hold(seconds - rise),
        _phase("ramp", duration=f"{rise:g} s", spool_velocities=dict.fromkeys(turning, "0 deg/s")),
    ]


def _phase(kind: str, **values: Any) -> str:
    rows = [f"{key} = {_toml(value)}" for key, value in values.items()]
    return "\n".join(["[[phases]]", f'kind = "{kind}"', *rows, ""])


def _toml(value: object) -> str:
    """Return a value as TOML, tables in one line."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{key} = {_toml(one)}' for key, one in value.items())} }}"
    return json.dumps(value)


def _tolerance(inst: Instrument) -> float:
    """Return how far a load cell may read off the pretension, N."""
    return max(_LEAST_TOLERANCE, 0.01 * float(inst.pretensions.max()))


def _loads(design: AnyDesign, bends: Sequence[_Bend]) -> list[TestLoad]:
    """Return the test loads under which no tendon goes slack or near the controller's limit; at least the smallest."""
    inst = expanded(design.bench)
    tests = sorted((test for test in design.tests if test.force > 0), key=lambda test: test.force)
    states = [one.held(one.at(share)) for one in bends for share in (0.0, 0.5, -0.5)]
    handle, strokes = (np.array(part) for part in zip(*states, strict=True))
    tight, limit = inst.pretensions > 0, _OF_LIMIT * tension_limit(inst)
    allowed = []
    for test in tests:
        wrench, grip = test.load
        try:
            tensions = chain.tensions(inst, handle, wrench, grip_force=grip, strokes=strokes)
        except NoSolutionError:
            continue
        rest = tensions[0, tight] / inst.pretensions[tight]
        if rest.min(initial=1.0) >= 1 - _OF_SLACK and tensions.max() <= limit:
            allowed.append(test)
    return allowed or tests[:1]


def rehearse(design: AnyDesign, *, brief: bool = False, seed: int = 0) -> FirstRun:
    """Run the first run of a design on the twin, without and with the controller.

    What is read is that of a brief run, which has the same phases; with the controller it is the whole one unless
    `brief`. The sensors' noise has a seed. Raises ProtocolError if the twin cannot run the protocol.
    """
    inst = design.bench
    stages = _stages(design, brief=True)
    last = max(n for n, stage in enumerate(stages) if stage.read) + 1
    read = parse("\n".join(['name = "read"', *_text(design, stages[:last], controlled=False)]), FIRST_RUN)
    runs = [_steps(_with_friction(inst, share), stages[:last], read, seed) for share in (1.0, *UNCERTAIN)]
    closed, left, faults = under_law(design, brief=brief, seed=seed)
    bends = _Bend.all_of(expanded(inst))
    readings = _readings(design, bends, stages[:last], runs)
    return FirstRun(protocol(design), tuple(readings), _demand(inst, closed), left, faults)


def under_law(design: AnyDesign, *, brief: bool = False, seed: int = 0) -> tuple[list[Run], float, int]:
    """Run the first run of a design with the controller; return its steps, what is left of their loads, and its faults.

    As of :class:`FirstRun`. Raises ProtocolError if the twin cannot run the protocol.
    """
    inst = design.bench
    controller = Controller(inst, homed=False) if law_of(inst) == "robust" else JointController(inst)
    steps = _kept(design, _stages(design, brief=brief), controlled=True)
    with warnings.catch_warnings():
        # Its faults are told in the plan.
        warnings.simplefilter("ignore", FaultWarning)
        closed = _steps(inst, steps, protocol(design, controlled=True, brief=brief), seed, controller)
    faults = np.bitwise_or.reduce(np.concatenate([fault_bits(run["faults"]) for run in closed]))
    bends = _Bend.all_of(expanded(inst))
    loaded = [run for step, run in zip(steps, closed, strict=True) if step.read == "load"]
    left = max((float(np.abs(_moved(bends, run, _loaded(run))).max()) for run in loaded), default=0.0)
    return closed, left, int(faults)


def _steps(
    inst: Instrument,
    stages: Sequence[_Stage],
    planned: Protocol,
    seed: int,
    controller: Controller | JointController | None = None,
) -> list[Run]:
    """Return the run of every step of one run of a protocol, on a twin whose tendons are slack where it winds them."""
    twin = Twin(inst, seed=seed)
    tight = next((n for n, phase in enumerate(planned.phases) if phase.kind == "pretension"), None)
    if tight is not None:
        _loosen(twin)
    whole = execute(twin, planned, controller)
    rows = [round(phase.seconds / twin.time_step) for phase in planned.plan(inst, twin.time_step)]
    if tight is not None:
        # Only tightening takes as long as it takes.
        rows[tight] += len(whole) - sum(rows)
    last = np.cumsum([len(stage.phases) for stage in stages]) - 1
    ends = np.cumsum(rows)[last].tolist()
    return [whole.rows(begin, end) for begin, end in zip([0, *ends[:-1]], ends, strict=True)]


def _loosen(twin: Twin) -> None:
    """Make the tendons slack; those without pretension are hung in taut, since no reading shows when they are."""
    inst = twin.inst
    spools = twin.loosen(max(2e-3, 1.25 * float((inst.pretensions / inst.stiffnesses).max()))).by_column("spool_angle")
    back = np.where(inst.pretensions > 0, 0.0, spools[0] - spools[-1])
    if back.any():
        steps = np.arange(round(2 / twin.time_step)) < round(1 / twin.time_step)
        twin.run(np.zeros((steps.size, len(inst.handle_joints))), spool_velocity=np.outer(steps, back))


def _with_friction(inst: Instrument, share: float) -> Instrument:
    friction = inst.friction
    return inst.replace(
        **{
            "friction.vertex_coefficient": share * friction.vertex_coefficient,
            "friction.sheath_coefficient": share * friction.sheath_coefficient,
        }
    )


def _readings(
    design: AnyDesign, bends: Sequence[_Bend], stages: Sequence[_Stage], runs: Sequence[Sequence[Run]]
) -> Iterator[Reading]:
    """Yield what must be read; of the runs the first has the guessed friction."""
    inst, loads = expanded(design.bench), _loads(design, bends)
    share = _SHARE_OF_RANGE * float(inst.pretensions.max())
    names = [tendon.name.replace("_", " ") for tendon in inst.tendons]
    for n, stage in enumerate(stages):
        at = [run[n] for run in runs]
        if stage.read == "slack":
            zero = [0.0, *(float(np.abs(_last(run, "measured_tension")).max()) for run in at)]
            yield _reading("slack", "load cells", "N", zero, _LEAST_TOLERANCE, "cell not tared; rope caught")
        elif stage.read == "tighten":
            yield from _tightened(inst, bends, names, at)
        elif stage.read == "jog":
            tendon = int(stage.value)
            jumped = [float(np.ptp(run.by_column("measured_tension")[:, tendon])) for run in at]
            yield _reading(
                f"jog the {names[tendon]}", f"load cell, {names[tendon]}, change", "N", jumped, share,
                "nothing: the cables of motors or cells are exchanged",
            )  # fmt: skip
        elif stage.read == "bend":
            cycle = 2 * _STROKE / (_FASTER * _STROKE_SPEED) + _BRIEF
            wide = [float(np.ptp(_last(run, "measured_tension", cycle), axis=0).max()) for run in at]
            yield _reading(
                f"stroke of {bends[stage.bend].name} at {_angle(stage.value)}", "load cells, largest change", "N",
                wide, share, "more: a sharp or dirty vertex at this bend",
            )  # fmt: skip
        elif stage.read == "move":
            yield from _moves(inst, bends[stage.bend], stage.value, at)
        elif stage.read == "load":
            yield from _hangs(inst, bends, loads[int(stage.value)], at, share)


def _tightened(inst: FullForm, bends: Sequence[_Bend], names: Sequence[str], runs: Sequence[Run]) -> Iterator[Reading]:
    for n, name in enumerate(names):
        read = [float(np.mean(_last(run, "measured_tension")[:, n])) for run in runs]
        yield _reading(
            "tighten", f"load cell, {name}", "N", [float(inst.pretensions[n]), *read], _tolerance(inst),
            "rope not seated, cell not tared, spool slips",
        )  # fmt: skip
    for one in bends:
        turned = [float(np.degrees(np.mean(_last(run, "measured_output_angle") @ one.row))) for run in runs]
        yield _reading("tighten", one.name, "deg", [0.0, *turned], 1.0, "cells differ in gain: swap them and see")


def _moves(inst: FullForm, bend: _Bend, angle: float, runs: Sequence[Run]) -> Iterator[Reading]:
    step, sign = f"{bend.name} to {_angle(angle)}", np.sign(angle)
    turned = [run.by_column("measured_output_angle") @ bend.row for run in runs]
    reached = [float(np.degrees(sign * (sign * one).max())) for one in turned]
    yield _reading(step, f"{bend.name}, farthest", "deg", reached, 0.5, "radii, or a tendon that slips on its wheel")
    strained = [float(run["measured_tension"].max()) for run in runs]
    yield _reading(
        step, "load cells, largest", "N", strained, _SHARE_OF_RANGE * float(inst.pretensions.max()),
        "more: a sharp or dirty vertex; less: slack in a termination",
    )  # fmt: skip


def _hangs(
    inst: FullForm, bends: Sequence[_Bend], test: TestLoad, runs: Sequence[Run], share: float
) -> Iterator[Reading]:
    """Yield the joints and the cells that a load moves; of those that it hardly moves, the first."""
    step = f"load {test.real_force:.3g} N real-size, {test.force:.3g} N {test.direction}"
    moved = np.array([_moved(bends, run, _loaded(run)) for run in runs])
    for n in _felt(moved[0], _LEAST_TURN):
        why = "more: rope softer than assumed, or slack"
        yield _reading(step, f"{bends[n].name}, change under the load", "deg", moved[:, n].tolist(), _LEAST_TURN, why)
    pulled = np.array([run.by_column("measured_tension")[_loaded(run)].mean(axis=0) for run in runs])
    for n in _felt(pulled[0] - inst.pretensions, share):
        cell = f"load cell, {inst.tendons[n].name.replace('_', ' ')}"
        why = "friction in the sheath; weights on the wrong cable"
        yield _reading(step, cell, "N", pulled[:, n].tolist(), share, why)


def _felt(changes: Array, least: float) -> list[int]:
    """Return where changes are at least of a size, and where the largest is."""
    return [n for n, one in enumerate(np.abs(changes)) if one >= min(least, float(np.abs(changes).max()))]


def _reading(  # noqa: PLR0917
    step: str, what: str, unit: str, values: Sequence[float], tolerance: float, otherwise: str
) -> Reading:
    return Reading(step, what, unit, values[0], min(values) - tolerance, max(values) + tolerance, otherwise)


def _last(run: Run, name: str, seconds: float = _WINDOW) -> Array:
    end = run.time[-1]
    found: Array = run.by_column(name)[run.time >= end - seconds]
    return found


def _loaded(run: Run) -> Array:
    """Return which steps of a step load are at its end, before the release."""
    given = [run.by_column(name) for name in _LOADS if getattr(run, name) is not None]
    size = np.abs(np.concatenate(given, axis=1)).max(axis=1)
    end = run.time[np.flatnonzero(size >= 0.999 * size.max())[-1]]
    mask: Array = (run.time >= end - _WINDOW) & (run.time < end)
    return mask


def _moved(bends: Sequence[_Bend], run: Run, at: Array) -> Array:
    """Return by how much what bends reads off its angle at the start of a run, deg, (bends,)."""
    angle = np.column_stack([run.by_column("measured_output_angle") @ one.row for one in bends])
    before = run.time < run.time[0] + _BEFORE
    return np.asarray(np.degrees(angle[at].mean(axis=0) - angle[before].mean(axis=0)))


def _demand(inst: Instrument, runs: Sequence[Run]) -> Demand:
    radius = inst.own_drives.spool_radius
    tension = np.concatenate([run.by_column("tension") for run in runs])
    velocity = np.concatenate([run.by_column("spool_velocity") for run in runs])
    time = np.concatenate([run.time for run in runs])
    step = float(np.median(np.diff(time)))
    seen = float(tension.max())
    largest = max(seen, tension_limit(inst))
    return Demand(
        seen,
        largest,
        largest * radius,
        float(np.abs(velocity).max()),
        float(np.abs(np.diff(velocity, axis=0)).max() / step),
    )

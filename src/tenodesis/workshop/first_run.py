"""The first run of a scale model: its protocol, what must be read at every step, and what the motors must do."""

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tenodesis import statics
from tenodesis.control import Controller
from tenodesis.control.parameters import tension_limit
from tenodesis.instrument import ShortForm
from tenodesis.run import Array, Run, concatenate
from tenodesis.scaling import Design, TestLoad
from tenodesis.simulate import Protocol, execute
from tenodesis.simulate.protocol import parse
from tenodesis.twin import Twin

FIRST_RUN, CONTROLLED = "first-run.toml", "first-run-controlled.toml"
UNCERTAIN = (0.5, 2.0)
"""Share of the guessed friction between which a reading must lie."""
MARGIN = 1.5
"""Of the motors' speed over what the twin's runs need; and of their torque for a moment over what they hold."""
_OF_LIMIT = 0.9  # of the controller's limit: the largest tension of the first ten minutes without friction
_OF_SLACK = 0.8  # of the load at which a tendon goes slack: the largest load of the first ten minutes
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
    rms_torque: float
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
    """The first ten minutes of a scale model, as the twin has them; :func:`rehearse` makes it."""

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
    """Output angle, rad, number of the tendon, or number of the test load."""
    winds: bool = False
    """Whether it moves the motors, so that it is left out with a controller."""


def protocol(design: Design, *, controlled: bool = False, brief: bool = False) -> Protocol:
    """Return the protocol of the first ten minutes of a design, or what of it a controller runs.

    A brief one has the same phases, with fewer cycles and shorter holds.
    """
    text = "\n".join(_text(_stages(design, brief=brief), controlled=controlled))
    return parse(f'name = "first ten minutes"\n{text}', FIRST_RUN)


def protocol_text(design: Design, about: str = "", *, controlled: bool = False) -> str:
    """Return the text of the file of that protocol; `about` says how similar the design is."""
    name, law = (CONTROLLED, " --law robust") if controlled else (FIRST_RUN, "")
    head = [
        f"# From rope to loaded tip in ten minutes, for {design.scaled_up.name}. On the twin:",
        "#",
        f"#   tenodesis record scaled-up.toml {name}{law} --out {Path(name).stem}.mcap",
        *([f"#\n# {about}"] if about else []),
        "",
        f'name = "first ten minutes{", with the controller" if controlled else ""}"',
        'description = "Tighten, jog, strokes at several bends, moves, weights one by one, cycles, excitation"',
        "",
    ]
    return "\n".join([*head, *_text(_stages(design), controlled=controlled)])


def _text(stages: Sequence[_Stage], *, controlled: bool) -> Iterator[str]:
    for stage in stages:
        if not (controlled and stage.winds):
            yield f"# {stage.comment}"
            yield from stage.phases


def _stages(design: Design, *, brief: bool = False) -> list[_Stage]:
    """Return the steps of the first run; those that are read come first."""
    inst = design.scaled_up.planar[0]
    end, pause = inst.output_range, _BRIEF if brief else _PAUSE
    count, faster = (1, _FASTER) if brief else (2, 1.0)
    speed = min(_SPEED, statics.reach(inst) / 2)
    loads = _loads(design)
    # Weights are hung by hand.
    held = _BRIEF if brief else min(_LONGEST_HELD, _FOR_LOADS / (3 * len(loads)))
    found = [
        _Stage("Motors off, ropes loose: the cells read nothing.", (_hold(pause),), "slack", winds=True),
        _Stage(
            "The motors wind until both load cells read the pretension; under a controller this is its homing.",
            (
                _phase(
                    "pretension", tension=f"{inst.pretension:.6g} N", tolerance=f"{_tolerance(inst):.3g} N",
                    timeout="60 s",
                ),
                _hold(pause),
            ),
            "tighten",
        ),
    ]  # fmt: skip
    for number, name in enumerate(("agonist", "antagonist")):
        comment = f"Jog: the {name}'s motor winds and lets out again."
        found.append(_Stage(comment, _jogged(inst, number), "jog", number, winds=True))
    for share in (0.0, 0.5, 1.0, -0.5, -1.0):
        angle = share * end
        comment = f"Friction: a short stroke at a bend of {math.degrees(angle):.0f} deg."
        found.append(_Stage(comment, (_stroke(inst, angle, count, faster), _hold(_BRIEF)), "bend", angle))
    for angle in (min(_SMALL, end), end, -end):
        comment = f"Slowly to {math.degrees(angle):.0f} deg and back."
        found.append(_Stage(comment, (_cycles(angle, speed / 2 * faster, count),), "move", angle))
    for number, test in enumerate(loads):
        phase = _load(test, _output(0.0), held)
        found.append(_Stage(f"{_hung(test)}.", (phase,), "load", number))
    found += [
        _Stage("The same moves fast.", tuple(_cycles(angle, 3 * speed, 2 * count) for angle in (end, -end))),
        *(
            _Stage(f"{_hung(test)}, at half the bend either way.",
                   tuple(_load(test, _output(share * end), held) for share in (0.5, -0.5)))
            for test in loads
        ),
        _Stage(
            f"{_hung(loads[0])}: slowly under the weight.",
            (
                *(_cycles(angle, speed * faster, count, loads[0].force) for angle in (end, -end)),
                _phase("ramp", duration="2 s", force="0 N"),
                _hold(_BRIEF),
            ),
        ),
        *_excitation(inst, speed, loads[0]),
        _Stage("At rest: cells and encoders read what they read after tightening.", (_hold(pause),)),
    ]  # fmt: skip
    return found


def _excitation(inst: ShortForm, speed: float, test: TestLoad) -> Iterator[_Stage]:
    """Yield the motions that tenodesis identify needs: of the handle, and of the motors, at several loads."""
    comment = "For tenodesis identify: the handle at two speeds, both motors together, a weight."
    moved = tuple(_cycles(share * inst.output_range, 3 * speed, 2, shape="sine") for share in (0.8, -0.8, 0.4, -0.4))
    yield _Stage(comment, moved)
    yield _Stage(
        "Both motors wind and let out together, then one against the other.",
        (*_jogged(inst, None, 2), *_jogged(inst, 0), *_jogged(inst, 1)),
        winds=True,
    )
    yield _Stage(f"{_hung(test)}, for identification.", (_load(test, _output(0.0), _HELD), *moved[:2]))


def _angle(angle: float) -> str:
    return f"{math.degrees(angle):.0f}°".replace("-", "\N{MINUS SIGN}")


def _hung(test: TestLoad) -> str:
    return f"{test.weights.sentence.partition(':')[0]}: {test.real_force:.3g} N on the real-size tip"


def _output(angle: float) -> dict[str, str]:
    return {"output_angle": f"{math.degrees(angle):.6g} deg"} if angle else {"handle_angle": "0 deg"}


def _load(test: TestLoad, at: Mapping[str, str], held: float) -> str:
    return _phase(
        "step-load", **at, weight=f"{test.weights.weight:.9g} N", delay=f"{_DELAY:g} s", rise=f"{_RISE:g} s",
        duration=f"{held:.4g} s", release=f"{held / 2:.4g} s",
    )  # fmt: skip


def _hold(seconds: float) -> str:
    return _phase("hold", duration=f"{seconds:g} s")


def _cycles(angle: float, speed: float, count: int, force: float | None = None, **more: str) -> str:
    given = {} if force is None else {"force": f"{force:.9g} N"}
    return _phase(
        "cycles", output_amplitude=f"{math.degrees(angle):.6g} deg", speed=f"{math.degrees(speed):.4g} deg/s",
        count=count, **given, **more,
    )  # fmt: skip


def _stroke(inst: ShortForm, angle: float, count: int, faster: float) -> str:
    """Return a short stroke of the handle about the angle of an output angle, toward the straight where it ends."""
    at = statics.handle_angle(inst, angle)
    near, far = at - math.copysign(_STROKE, at), at
    return _phase(
        "cycles", **{"from": f"{math.degrees(near):.6g} deg"}, amplitude=f"{math.degrees(far):.6g} deg",
        speed=f"{math.degrees(_STROKE_SPEED * faster):.4g} deg/s", count=count,
    )  # fmt: skip


def _jogged(inst: ShortForm, tendon: int | None, times: int = 1) -> tuple[str, ...]:
    """Return the ramps of a motor, or of both, that winds a share of its stretch and lets it out again."""
    angle = _JOG * inst.pretension / inst.tendon_stiffness / inst.drives.spool_radius
    speed = math.degrees(angle / (_JOG_HELD + _JOG_RAMP))

    def ramp(share: float, seconds: float) -> str:
        both = [f"{share * speed if tendon in (None, n) else 0.0:.6g} deg/s" for n in range(2)]
        return _phase("ramp", duration=f"{seconds:g} s", spool_velocity=both)

    there = (ramp(1, _JOG_RAMP), ramp(1, _JOG_HELD), ramp(0, _JOG_RAMP), _hold(_BRIEF))
    back = (ramp(-1, _JOG_RAMP), ramp(-1, _JOG_HELD), ramp(0, _JOG_RAMP), _hold(_BRIEF))
    return (there + back) * times


def _phase(kind: str, **values: str | int | list[str]) -> str:
    rows = [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    return "\n".join(["[[phases]]", f'kind = "{kind}"', *rows, ""])


def _tolerance(inst: ShortForm) -> float:
    """Return how far a load cell may read off the pretension, N."""
    return max(_LEAST_TOLERANCE, 0.01 * inst.pretension)


def _loads(design: Design) -> list[TestLoad]:
    """Return the test loads under which no tendon goes slack or near the controller's limit; at least the smallest."""
    inst = design.scaled_up.planar[0]
    bound, limit = _OF_SLACK * float(statics.slack_force(inst, 0.0)), _OF_LIMIT * tension_limit(inst)
    tests = sorted((test for test in design.tests if test.force > 0), key=lambda test: test.force)
    bends = np.array([statics.handle_angle(inst, share * inst.output_range) for share in (0.0, 0.5, -0.5)])
    allowed = []
    for test in tests:
        strained = statics.tensions(inst, bends, test.force)
        if test.force <= bound and max(np.max(strained.agonist), np.max(strained.antagonist)) <= limit:
            allowed.append(test)
    return allowed or tests[:1]


def rehearse(design: Design, *, brief: bool = False, seed: int = 0) -> FirstRun:
    """Run the first ten minutes of a design on the twin, without and with the controller.

    What is read is that of a brief run, which has the same phases; with the controller it is the whole one unless
    `brief`. The sensors' noise has a seed. Raises ProtocolError if the twin cannot run the protocol.
    """
    inst = design.scaled_up.planar[0]
    stages = _stages(design, brief=True)
    last = max(n for n, stage in enumerate(stages) if stage.read) + 1
    read = parse("\n".join(['name = "read"', *_text(stages[:last], controlled=False)]), FIRST_RUN)
    runs = [_phases(_with_friction(inst, share), read, seed) for share in (1.0, *UNCERTAIN)]
    controller = Controller(inst, homed=False)
    steps = [stage for stage in _stages(design, brief=brief) if not stage.winds]
    closed = _staged(steps, _phases(inst, protocol(design, controlled=True, brief=brief), seed, controller))
    faults = [int(value) for run in closed for value in np.unique(np.asarray(run["faults"]).astype(np.int64))]
    loaded = [run for step, run in zip(steps, closed, strict=True) if step.read == "load"]
    left = max((abs(_moved(run, _loaded(run))) for run in loaded), default=0.0)
    readings = _readings(design, stages[:last], [_staged(stages[:last], run) for run in runs])
    return FirstRun(protocol(design), tuple(readings), _demand(inst, closed), left, int(np.bitwise_or.reduce(faults)))


def _phases(inst: ShortForm, planned: Protocol, seed: int, controller: Controller | None = None) -> list[Run]:
    """Return the run of every phase of one run of a protocol, on a twin whose tendons are slack before."""
    twin = Twin(inst, seed=seed)
    twin.loosen(max(2e-3, 1.25 * inst.pretension / inst.tendon_stiffness))
    whole = execute(twin, planned, controller)
    steps = [round(phase.seconds / twin.time_step) for phase in planned.plan(inst, twin.time_step)]
    # Only tightening takes as long as it takes.
    tight = next(n for n, phase in enumerate(planned.phases) if phase.kind == "pretension")
    steps[tight] += len(whole) - sum(steps)
    ends = np.cumsum(steps).tolist()
    return [whole.rows(begin, end) for begin, end in zip([0, *ends[:-1]], ends, strict=True)]


def _staged(stages: Sequence[_Stage], runs: Sequence[Run]) -> list[Run]:
    """Return the run of every step, from those of its phases."""
    given = iter(runs)
    return [concatenate([next(given) for _ in stage.phases]) for stage in stages]


def _with_friction(inst: ShortForm, share: float) -> ShortForm:
    friction = inst.friction
    return inst.replace(
        **{
            "friction.vertex_coefficient": share * friction.vertex_coefficient,
            "friction.sheath_coefficient": share * friction.sheath_coefficient,
        }
    )


def _readings(design: Design, stages: Sequence[_Stage], runs: Sequence[Sequence[Run]]) -> Iterator[Reading]:
    """Yield what must be read; of the runs the first has the guessed friction."""
    inst = design.scaled_up.planar[0]
    share = _SHARE_OF_RANGE * inst.pretension
    for n, stage in enumerate(stages):
        at = [run[n] for run in runs]
        if stage.read == "slack":
            zero = [0.0, *(float(np.abs(_last(run, "measured_tension")).max()) for run in at)]
            yield _reading("slack", "load cells", "N", zero, _LEAST_TOLERANCE, "cell not tared; rope caught")
        elif stage.read == "tighten":
            yield from _tightened(inst, at)
        elif stage.read == "jog":
            name = ("agonist", "antagonist")[int(stage.value)]
            jumped = [float(np.ptp(run["measured_tension"][:, int(stage.value)])) for run in at]
            yield _reading(
                f"jog the {name}", f"load cell, {name}, change", "N", jumped, share,
                "nothing: the motor's or the cell's cables are exchanged",
            )  # fmt: skip
        elif stage.read == "bend":
            cycle = 2 * _STROKE / (_FASTER * _STROKE_SPEED) + _BRIEF
            wide = [float(np.ptp(_last(run, "measured_tension", cycle), axis=0).max()) for run in at]
            yield _reading(
                f"stroke at {_angle(stage.value)}", "load cells, largest change", "N", wide, share,
                "more: a sharp or dirty vertex at this bend",
            )  # fmt: skip
        elif stage.read == "move":
            yield from _moves(inst, stage.value, at)
        elif stage.read == "load":
            yield from _hangs(_loads(design)[int(stage.value)], at, share)


def _tightened(inst: ShortForm, runs: Sequence[Run]) -> Iterator[Reading]:
    for n, name in enumerate(("agonist", "antagonist")):
        read = [float(np.mean(_last(run, "measured_tension")[:, n])) for run in runs]
        yield _reading(
            "tighten", f"load cell, {name}", "N", [inst.pretension, *read], _tolerance(inst),
            "rope not seated, cell not tared, spool slips",
        )  # fmt: skip
    turned = [float(np.degrees(np.mean(_last(run, "measured_output_angle")))) for run in runs]
    yield _reading("tighten", "tip", "deg", [0.0, *turned], 1.0, "cells differ in gain: swap them and see")


def _moves(inst: ShortForm, angle: float, runs: Sequence[Run]) -> Iterator[Reading]:
    step, sign = f"move to {_angle(angle)}", np.sign(angle)
    reached = [float(np.degrees(sign * (sign * run["measured_output_angle"]).max())) for run in runs]
    yield _reading(step, "tip, farthest", "deg", reached, 0.5, "radii, or a tendon that slips on its wheel")
    strained = [float(run["measured_tension"].max()) for run in runs]
    yield _reading(
        step, "load cells, largest", "N", strained, _SHARE_OF_RANGE * inst.pretension,
        "more: a sharp or dirty vertex; less: slack in a termination",
    )  # fmt: skip


def _hangs(test: TestLoad, runs: Sequence[Run], share: float) -> Iterator[Reading]:
    step = f"load {test.real_force:.3g} N real-size, {test.force:.3g} N"
    moved = [_moved(run, _loaded(run)) for run in runs]
    yield _reading(step, "tip, change under the load", "deg", moved, 0.3, "more: rope softer than assumed, or slack")
    for tendon, name in enumerate(("agonist", "antagonist")):
        pulled = [float(np.mean(run["measured_tension"][_loaded(run), tendon])) for run in runs]
        yield _reading(
            step, f"load cell, {name}", "N", pulled, share, "friction in the sheath; weights on the wrong cable"
        )


def _reading(  # noqa: PLR0917
    step: str, what: str, unit: str, values: Sequence[float], tolerance: float, otherwise: str
) -> Reading:
    return Reading(step, what, unit, values[0], min(values) - tolerance, max(values) + tolerance, otherwise)


def _last(run: Run, name: str, seconds: float = _WINDOW) -> Array:
    end = run.time[-1]
    found: Array = run[name][run.time >= end - seconds]
    return found


def _loaded(run: Run) -> Array:
    """Return which steps of a step load are at its end, before the release."""
    under = np.flatnonzero(np.abs(run["force"]) >= 0.999 * np.abs(run["force"]).max())
    end = run.time[under[-1]]
    mask: Array = (run.time >= end - _WINDOW) & (run.time < end)
    return mask


def _moved(run: Run, at: Array) -> float:
    """Return by how much the tip reads off its angle at the start of a run, deg."""
    angle = run["measured_output_angle"]
    before = angle[run.time < run.time[0] + 0.4]
    return float(np.degrees(np.mean(angle[at]) - np.mean(before)))


def _demand(inst: ShortForm, runs: Sequence[Run]) -> Demand:
    radius = inst.drives.spool_radius
    tension = np.concatenate([run["tension"] for run in runs])
    velocity = np.concatenate([run["spool_velocity"] for run in runs])
    time = np.concatenate([run.time for run in runs])
    step = float(np.median(np.diff(time)))
    seen = float(tension.max())
    largest = max(seen, tension_limit(inst))
    return Demand(
        seen,
        largest,
        largest * radius,
        float(np.sqrt(np.mean(tension**2, axis=0)).max()) * radius,
        float(np.abs(velocity).max()),
        float(np.abs(np.diff(velocity, axis=0)).max() / step),
    )

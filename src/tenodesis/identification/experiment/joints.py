"""Planning an experiment on instruments whose tendons turn several joints: which motions and loads say the most."""

import io
import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError, NoSolutionError
from tenodesis.identification import identifiability, routing
from tenodesis.identification.experiment.information import Criterion, CriterionName, Information, choose
from tenodesis.identification.problem import Parameter, scales
from tenodesis.instrument import FullForm
from tenodesis.recording.signal_tables import unit_of
from tenodesis.run import Array, Run
from tenodesis.twin import Twin

BLOCK = 3.0
"""Time of a motion, in which it grows from rest and fades, s."""
LOAD = 0.5
"""Known force at the tip, where none is given, N."""
HALF = 1.96
"""Half a 95 % interval, in standard deviations."""
OPTIMISTIC = (
    "Predicted intervals account for noise and rounding of the sensors, and for offsets and gains of the load cells as "
    "the file states them. Effects beyond the model, inaccurate loads and an instrument that differs from its file "
    "make them wider."
)
_WANTED = ("friction", "stiffness", "pretension")
_SHARE, _MOST_ANGLE = 0.5, 0.6
"""Of a joint's range that is used, and the largest angle, rad."""
_SLOW, _FAST, _APART = 1 / 3, 1.0, 0.21
"""Frequencies of motions, and by which they differ among joints that move together, Hz."""
_MOST = 4
"""Times that a motion is taken at most."""
_UNKNOWN_COEFFICIENT = 0.1


class TimedMotion(NamedTuple):
    """A motion with its load, and when it begins, s."""

    name: str
    begins: float


class JointPlan(NamedTuple):
    """Motions of an instrument's joints, in their order, and what they are predicted to determine."""

    inst: FullForm
    blocks: tuple[TimedMotion, ...]
    run: Run
    """What the twin does; its commands are those of the bench."""
    wanted: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    std: dict[str, float]
    """Predicted standard deviation of each parameter with all of them open, SI; infinite where none is seen"""
    alone: dict[str, float]
    """By motions of all joints together without load, repeated as long"""
    assumed: dict[str, float]
    """Friction coefficients in place of those that the file lacks"""

    def identifiable(self, name: str) -> bool:
        """Return whether a parameter is predicted to be identifiable, by the rule that fits are judged by."""
        one = next(one for one in self.parameters if one.name == name)
        return identifiability.is_identifiable(one, self.std[name])


class _Motion(NamedTuple):
    name: str
    angles: Array
    """(n, joints), rad"""
    wrench: Array
    """(n, 6), N and N m"""


def plan(
    inst: FullForm,
    want: Sequence[str] | None = None,
    *,
    duration: float,
    force: float = LOAD,
    law: str | None = None,
    criterion: CriterionName = "D",
    distal_encoder: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> JointPlan:
    """Propose motions of several joints after which the wanted parameters are known best, and predict how well.

    Of each joint alone, slowly and fast, and of all together, each without and with a load that turns, those are taken
    that have the most information a second. The design is local: slopes are taken at the file's values.

    Raises
    ------
    IdentificationError
        A name is no parameter, none of the motions fits into the duration, or the instrument follows none.
    """
    law, given = law or (inst.friction.law if inst.friction.law != "none" else "capstan"), inst
    if inst.friction.law == "none" and law != "none":
        guess = dict.fromkeys(("friction.vertex_coefficient", "friction.sheath_coefficient"), _UNKNOWN_COEFFICIENT)
        inst = inst.replace(**{"friction.law": "capstan"}, **guess)
    motions = _motions(inst, force)
    offered: list[Information] = []
    names: list[int] = []
    parameters: tuple[Parameter, ...] = ()
    steps = len(motions) + 2
    for place, motion in enumerate(motions):
        _tell(progress, place, steps)
        try:
            problem = _problem(inst, [motion], law, distal_encoder=distal_encoder)[1]
        except NoSolutionError:
            continue
        parameters = problem.parameters
        offered.append(_information(problem))
        names.append(place)
    if not offered:
        raise IdentificationError(f"{inst.name} follows none of the motions.", key="inst", value=inst.name)
    wanted = _wanted(parameters, want)
    measure = Criterion(
        criterion, range(len(parameters)), [n for n, one in enumerate(parameters) if one.name in wanted]
    )
    chosen = choose(offered, [BLOCK] * len(offered), duration, measure, most=_MOST)
    if not chosen:
        raise IdentificationError(key="duration", value=duration, allowed=f"at least {BLOCK:g} s")
    taken = [motions[names[one]] for one in chosen]
    run, problem = _problem(inst, taken, law, distal_encoder=distal_encoder)
    _tell(progress, steps - 1, steps)
    together = next(motion for motion in motions if motion.name.startswith("all"))
    others = _problem(inst, [together] * len(taken), law, distal_encoder=distal_encoder)[1]
    _tell(progress, steps, steps)
    blocks = tuple(TimedMotion(motion.name, place * BLOCK) for place, motion in enumerate(taken))
    starts = zip((one.name for one in parameters), problem.starting_values(()).tolist(), strict=True)
    assumed = {name: start for name, start in starts if start != routing.Routing.value(given, name)}
    return JointPlan(inst, blocks, run, wanted, parameters, _std(problem), _std(others), assumed)


def commands(found: JointPlan) -> str:
    """Return what a bench commands as a table: the handle's angles or the spools' velocities, and the load."""
    run, inst = found.run, found.inst
    signal = "commanded_handle_angle" if inst.handle_joints else "commanded_spool_velocity"
    columns = {"time [s]": run.time}
    for one in (signal, "wrench"):
        columns |= {
            f"{name} [{unit_of(name)}]": row
            for name, row in zip(run.names.headings(one), run.signals()[one].T, strict=True)
        }
    text = io.StringIO()
    np.savetxt(text, np.stack([*columns.values()], axis=1), "%.7g", ",", header=",".join(columns), comments="")
    return text.getvalue()


def to_json(found: JointPlan) -> dict[str, Any]:
    """Return the motions and the predicted deviations, SI; those that are infinite as None."""
    parameters = {
        one.name: {
            "start": one.start,
            "unit": one.unit,
            "std": found.std[one.name] if math.isfinite(found.std[one.name]) else None,
            "identifiable": found.identifiable(one.name),
        }
        for one in found.parameters
    }
    blocks = [{"motion": one.name, "begins": one.begins, "seconds": BLOCK} for one in found.blocks]
    return {"instrument": found.inst.name, "wanted": [*found.wanted], "blocks": blocks, "parameters": parameters}


def _tell(progress: Callable[[int, int], None] | None, done: int, total: int) -> None:
    """Report how many of how many runs are done, where progress is wanted."""
    if progress is not None:
        progress(done, total)


def _motions(inst: FullForm, force: float) -> list[_Motion]:
    """Return the candidates: joints of the handle where there is one, else of the tip, jaws of one axis together."""
    joints = inst.handle_joints or inst.tip_joints
    groups: dict[str, list[int]] = (
        {joint.name: [n] for n, joint in enumerate(joints)} if inst.handle_joints else dict(inst.arc_places)
    )
    jaws = inst.grip.jaws if inst.grip is not None and not inst.handle_joints else ()
    if len(jaws) > 1:
        both = [arc for jaw in jaws for arc in groups.pop(jaw)]
        groups["both jaws"] = both
    time = np.arange(round(BLOCK / _step(inst))) * _step(inst)
    grown = np.minimum(1, np.minimum(time, BLOCK - time) / (BLOCK / 6))

    def wave(group: str, frequency: float) -> Array:
        angles = np.zeros((time.size, len(joints)))
        arcs = groups[group]
        parts = 1 if len(jaws) > 1 and group == "both jaws" else len(arcs)
        most = min(_SHARE * min(joints[arc].range for arc in arcs) * parts, _MOST_ANGLE) / parts
        angles[:, arcs] = (most * grown * np.sin(2 * np.pi * frequency * time))[:, np.newaxis]
        return angles

    moved = {
        f"{group}, {pace}": wave(group, frequency)
        for group, (pace, frequency) in product(groups, (("slowly", _SLOW), ("fast", _FAST)))
    }
    if len(jaws) > 1:
        opened = np.zeros((time.size, len(joints)))
        # the first jaw opens to positive angles
        opened[:, both] = (0.5 * _MOST_ANGLE * np.sin(np.pi * time / BLOCK) ** 2)[:, np.newaxis] * np.array([1, -1])
        moved["jaws open and close"] = opened
    moved["all joints together"] = np.sum(
        [wave(group, _SLOW + _APART * place) for place, group in enumerate(groups)], axis=0
    )
    loads = {"": np.zeros((time.size, 6))}
    if force > 0:
        turning = np.zeros((time.size, 6))
        turning[:, 0] = force * grown * np.sin(2 * np.pi * time / BLOCK * 2)
        turning[:, 1] = force * grown * np.sin(2 * np.pi * time / BLOCK * 3)
        loads[f", {force:g} N that turns"] = turning
    resting = {"at rest": np.zeros((time.size, len(joints)))} if force > 0 else {}
    return [
        _Motion(name + load, angles, wrench)
        for (name, angles), (load, wrench) in product((moved | resting).items(), loads.items())
        if name != "at rest" or load
    ]


def _step(inst: FullForm) -> float:
    """Return the twin's longest step that is a fraction of a sampling period, s."""
    period = 1 / inst.sensors.sampling_rate
    return next(period / parts for parts in range(1, 64) if _suits(inst, period / parts))


def _suits(inst: FullForm, step: float) -> bool:
    try:
        return Twin(inst, time_step=step).time_step > 0
    except ValueError:
        return False


def _problem(
    inst: FullForm, motions: Sequence[_Motion], law: str, *, distal_encoder: bool
) -> tuple[Run, routing.Routing]:
    """Return the twin's run through motions, one after another, and the problem of its readings."""
    angles = np.concatenate([motion.angles for motion in motions])
    wrench = np.concatenate([motion.wrench for motion in motions])
    step = _step(inst)
    twin = Twin(inst, time_step=step)
    if inst.handle_joints:
        run = twin.run(angles, wrench=wrench)
    else:
        wound = -np.gradient(angles @ inst.tendon_arms("tip").T, step, axis=0) / twin.spool_radius
        run = twin.run(np.zeros((len(angles), 0)), wrench=wrench, spool_velocity=wound)
    read = routing.of_run(run, inst)
    if not distal_encoder:
        columns = {name: row for name, row in read.columns.items() if not name.startswith("output_angle")}
        read = routing.RoutingRun(read.name, read.time, columns, read.notes, instrument=inst)
    return run, routing.problem([read], [], law=law)


def _information(problem: routing.Routing) -> Information:
    """Return the information in a run."""
    values = problem.starting_values(())
    slopes = problem.jacobian(values, 0) * scales(problem.parameters, values)
    curvature = slopes.T @ slopes
    return Information(curvature, curvature)


def _std(problem: routing.Routing) -> dict[str, float]:
    """Return the standard deviation of each parameter with all of them open, SI.

    Errors of load cells count here alone: they do not average out over motions, and choose none.
    """
    values = problem.starting_values(())
    problem.weigh_sensors(values, [0])
    std = _information(problem).uncertainty().std * scales(problem.parameters, values)
    return dict(zip((one.name for one in problem.parameters), std.tolist(), strict=True))


def _wanted(parameters: Sequence[Parameter], want: Sequence[str] | None) -> tuple[str, ...]:
    """Return the parameters that names of parameters or groups stand for."""
    found: list[str] = []
    for word in _WANTED if want is None else want:
        named = [one.name for one in parameters if word in (one.name, one.group)]
        if not named:
            allowed = ", ".join(dict.fromkeys(name for one in parameters for name in (one.group, one.name)))
            raise IdentificationError(key="want", value=word, allowed=f"of {allowed}")
        found += named
    return tuple(dict.fromkeys(found))

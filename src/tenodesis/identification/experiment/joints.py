"""Experiments on instruments whose tendons turn several joints: motions and loads, and what these say."""

import io
import math
from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np

from tenodesis.errors import IdentificationError, NoSolutionError
from tenodesis.identification import routing
from tenodesis.identification.experiment.candidates import Candidate
from tenodesis.identification.experiment.information import Information
from tenodesis.identification.experiment.simulated import Experiment, InfeasibleProtocolError
from tenodesis.instrument import FullForm
from tenodesis.recording.signal_tables import unit_of
from tenodesis.run import Array, Run
from tenodesis.twin import Twin

BLOCK = 3.0
"""Time of a motion, in which it grows from rest and fades, s."""
LOAD = 0.5
"""Known force at the tip, where none is given, N."""
_SHARE, _MOST_ANGLE = 0.5, 0.6
"""Of a joint's range that is used, and the largest angle, rad."""
_SLOW, _FAST, _APART = 1 / 3, 1.0, 0.21
"""Frequencies of motions, and by which they differ among joints that move together, Hz."""
_UNKNOWN_COEFFICIENT, _ROUNDING = 0.1, 1e-9


class LoadedMotion(NamedTuple):
    """A motion with its load, from rest to rest."""

    angles: Array
    """(n, joints), rad"""
    wrench: Array
    """(n, 6), N and N m"""


class JointExperiment(Experiment):
    """An instrument of several joints, of which each moves alone and all together, without and with a load that turns.

    Friction that the file lacks is guessed.
    """

    caveat = (
        "Predicted intervals account for noise and rounding of the sensors, and for offsets and gains of the load "
        "cells as the file states them. Effects beyond the model, inaccurate loads and an instrument that differs from "
        "its file make them wider."
    )
    orders, repeats = 1, 4
    inst: FullForm

    def __init__(
        self, inst: FullForm, law: str | None, *, distal_encoder: bool, forces: Sequence[float] | None = None
    ) -> None:
        self.law = law or (inst.friction.law if inst.friction.law != "none" else "capstan")
        self.forces = (LOAD,) if forces is None else tuple(sorted(forces))
        self.distal_encoder, self._given, self.inst = distal_encoder, inst, inst
        if inst.friction.law == "none" and self.law != "none":
            guess = dict.fromkeys(("friction.vertex_coefficient", "friction.sheath_coefficient"), _UNKNOWN_COEFFICIENT)
            self.inst = inst.replace(**{"friction.law": "capstan"}, **guess)

    @cached_property
    def candidates(self) -> list[Candidate]:
        """The motions."""
        return [Candidate(name, "motion", (one,)) for name, one in _motions(self.inst, max(self.forces, default=0.0))]

    def baselines(self, duration: float) -> dict[str, tuple[LoadedMotion, ...]]:
        """Return motions of all joints together without load, repeated as long."""
        alone = next(one.phases for one in self.candidates if one.name.startswith("all"))
        return {"all joints together": alone * int(duration / BLOCK + _ROUNDING)}

    @cached_property
    def _model(self) -> routing.Routing:
        """The model of the first motion that the instrument follows."""
        for one in self.candidates:
            try:
                return self._problem(self.run(one.phases))
            except InfeasibleProtocolError:
                continue
        raise IdentificationError(f"{self.inst.name} follows none of the motions.", key="inst", value=self.inst.name)

    @cached_property
    def values(self) -> Array:
        """Where slopes are taken."""
        return self._model.starting_values(())

    @property
    def assumed(self) -> dict[str, float]:
        """Friction coefficients in place of those that the file lacks."""
        starts = zip((one.name for one in self.parameters), self.values.tolist(), strict=True)
        return {name: start for name, start in starts if start != routing.Routing.value(self._given, name)}

    def run(self, phases: Sequence[LoadedMotion]) -> Run:
        """Return the twin's run through motions, one after another.

        Raises InfeasibleProtocolError if the instrument does not follow them.
        """
        angles = np.concatenate([motion.angles for motion in phases])
        wrench = np.concatenate([motion.wrench for motion in phases])
        inst, step = self.inst, _step(self.inst)
        twin = Twin(inst, time_step=step)
        try:
            if inst.handle_joints:
                return twin.run(angles, wrench=wrench)
            wound = -np.gradient(angles @ inst.tendon_arms("tip").T, step, axis=0) / twin.spool_radius
            return twin.run(np.zeros((len(angles), 0)), wrench=wrench, spool_velocity=wound)
        except NoSolutionError:
            raise InfeasibleProtocolError("the instrument does not follow it") from None

    def information(self, run: Run, until: Sequence[float] = (math.inf,)) -> tuple[routing.Routing, list[Information]]:
        """Return the model of a run, and its information on all parameters."""
        problem = self._problem(run)
        return problem, [self._of(problem)]

    def prediction(self, run: Run, until: Sequence[float] = (math.inf,)) -> tuple[routing.Routing, list[Information]]:
        """Return them with the errors of load cells, which do not average out over motions, and choose none."""
        problem = self._problem(run)
        problem.weigh_sensors(self.values, [0])
        return problem, [self._of(problem)]

    def _problem(self, run: Run) -> routing.Routing:
        read = routing.of_run(run, self.inst)
        if not self.distal_encoder:
            columns = {name: row for name, row in read.columns.items() if not name.startswith("output_angle")}
            read = routing.RoutingRun(read.name, read.time, columns, read.notes, instrument=self.inst)
        return routing.problem([read], [], law=self.law)

    def _of(self, problem: routing.Routing) -> Information:
        slopes = problem.jacobian(self.values, 0) * self.scale
        curvature = slopes.T @ slopes
        return Information(curvature, curvature)


def commands(run: Run) -> str:
    """Return what a bench commands as a table: the handle's angles or the spools' velocities, and the load."""
    signal = "commanded_handle_angle" if run.handle_joints else "commanded_spool_velocity"
    columns = {"time [s]": run.time}
    for one in (signal, "wrench"):
        columns |= {
            f"{name} [{unit_of(name)}]": row
            for name, row in zip(run.names.headings(one), run.signals()[one].T, strict=True)
        }
    text = io.StringIO()
    np.savetxt(text, np.stack([*columns.values()], axis=1), "%.7g", ",", header=",".join(columns), comments="")
    return text.getvalue()


def _motions(inst: FullForm, force: float) -> list[tuple[str, LoadedMotion]]:
    """Return the candidates: joints of the handle where there is one, else of the tip, jaws of one axis together."""
    joints = inst.handle_joints or inst.tip_joints
    groups: dict[str, list[int]] = (
        {joint.name: [n] for n, joint in enumerate(joints)} if inst.handle_joints else dict(inst.arc_places)
    )
    jaws = inst.grip.jaws if inst.grip is not None and not inst.handle_joints else ()
    if len(jaws) > 1:
        both = [arc for jaw in jaws for arc in groups.pop(jaw)]
        groups["both jaws"] = both
    step = _step(inst)
    time = np.arange(round(BLOCK / step)) * step
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
        (name + load, LoadedMotion(angles, wrench))
        for (name, angles), (load, wrench) in product((moved | resting).items(), loads.items())
        if name != "at rest" or load
    ]


def _step(inst: FullForm) -> float:
    return routing.steps_within(inst, 1 / inst.sensors.sampling_rate)[0]

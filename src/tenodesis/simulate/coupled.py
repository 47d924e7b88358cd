"""Protocols of instruments whose joints share tendons: running them on the twin, and one for any such instrument."""

import math
from collections.abc import Callable, Sequence

import numpy as np

from tenodesis import coupled
from tenodesis.control import Controller
from tenodesis.coupled import CoupledInstrument, Held
from tenodesis.errors import ArgumentError, ProtocolError
from tenodesis.run import Array, Run, concatenate
from tenodesis.simulate.command import Between, sampled
from tenodesis.simulate.loads import Wrench
from tenodesis.simulate.phases import Cycles, GrippedObject, Hold, Ramp, StepLoad
from tenodesis.simulate.protocol import AnyPhase, Planned, Protocol, block_size, errors_of

_BLOCK = 1.0
"""Longest block, s."""
_SPEED = math.radians(40)
"""Of joints in the default protocol, rad/s."""
_RISE = 0.2
"""Time in which the spools come to their speed, s."""
_LOAD = 1.0
"""Largest load in the default protocol, N."""
_LOST = math.radians(5)
"""Largest angle that it may take from a joint, rad."""
_PRESSED = 1e-3
"""How far the jaws close beyond where they touch the object, m."""
_OBJECT = 2e3
"""Stiffness of the object, N/m."""


def execute_coupled(
    twin: coupled.Twin,
    protocol: Protocol,
    controller: Controller | None = None,
    *,
    on_block: Callable[[Run], object] | None = None,
    progress: Callable[[float, float], object] | None = None,
) -> Run:
    """Run a protocol on a twin at rest: straight, without load, with nothing between the jaws.

    Parameters
    ----------
    twin
        The twin.
    protocol
        The protocol; all of it is checked before the first step.
    controller
        Closes the loop over the joints with a pair of tendons of their own, as for :meth:`tenodesis.coupled.Twin.run`;
        it is homed. After a fault its motors hold and the protocol goes on.
    on_block
        Called with every block, 1 s of a run at most.
    progress
        Called after every block with the seconds done and those of the entire run.

    Raises
    ------
    ProtocolError
        The instrument cannot run the protocol, its jaws are too narrow for what is put between them, or the protocol
        moves the spools of a controller.
    NoSolutionError
        The load is more than the tendons can hold.
    """
    plan = protocol.plan(twin.inst, twin.time_step)
    check_coupled(plan, twin.inst, controller)
    total = sum(planned.seconds for planned in plan)
    runs: list[Run] = []
    angles = np.zeros(len(twin.inst.tip_joints))
    between: Between | None = None
    held: Held | None = None
    for planned in plan:
        with errors_of(planned.label):
            for block in sampled(planned.segments, block_size(twin.time_step, _BLOCK)):
                if block["between"] != between:
                    between = block["between"]
                    held = None if between is None else between.held(float(twin.inst.grip_arms @ angles))
                runs.append(_continued(twin, block, held, controller))
                angles = runs[-1].by_column("output_angle")[-1]
                if on_block is not None:
                    on_block(runs[-1])
                if progress is not None:
                    progress(min(twin.time, total), total)
    return concatenate(runs)


def default_protocol(inst: CoupledInstrument) -> Protocol:
    """Return a protocol that shows what an instrument does.

    Every joint of the handle in turn goes through half of its range and back; without a handle the spools drive every
    joint of the tip so. Then the tip is loaded across, each way, and jaws grip an object.
    """
    if inst.handle_joints:
        phases: list[AnyPhase] = [
            Cycles(joint=joint.name, amplitude=joint.range / 2, speed=_SPEED, count=1, shape="smooth")
            for joint in inst.handle_joints
        ]
    else:
        phases = [phase for n in range(len(inst.tip_joints)) for phase in _there_and_back(inst, n)]
    force = _bearable(inst)
    for component in ("fx", "fy"):
        for sign in (1, -1):
            wrench = Wrench(**{component: sign * force})
            phases.append(StepLoad(wrench=wrench, delay=0.2, rise=0.1, duration=0.5, release=0.3))
    if inst.grip is not None:
        phases += _gripping(inst)
    return Protocol(name="default", description=f"Motion, load and grip of {inst.name}"[:200], phases=tuple(phases))


def check_coupled(plan: Sequence[Planned], inst: CoupledInstrument, controller: Controller | None) -> None:
    """Raise ProtocolError if a phase moves the spools that a controller moves."""
    own = [] if controller is None else [m for pair in coupled.pairs(inst).values() for m in pair[2:]]
    for planned in plan:
        moved = [m for m in own if any(part.end.spool_velocity[m] for part in planned.segments)]
        if moved:
            name = inst.tendons[moved[0]].name
            raise ProtocolError(
                f"{planned.label}: spool_velocities names {name}; a phase must leave that motor to the controller.",
                key="spool_velocities",
                value=name,
            )


def _continued(twin: coupled.Twin, block: dict[str, Array], held: Held | None, controller: Controller | None) -> Run:
    try:
        return twin.run(
            block["handle_angle"],
            block["wrench"],
            grip_force=block["grip_force"][:, 0],
            spool_velocity=block["spool_velocity"],
            held=held,
            controller=controller,
        )
    except ArgumentError as problem:
        if not problem.key.startswith("held."):
            raise
        raise ProtocolError(
            str(problem).removeprefix("held.").rstrip("."),
            key=problem.key.removeprefix("held."),
            value=problem.value,
            allowed=problem.allowed,
        ) from None


def _there_and_back(inst: CoupledInstrument, number: int) -> list[AnyPhase]:
    """Return phases in which the spools drive a joint of the tip through half of its range and back."""
    angles = np.zeros(len(inst.tip_joints))
    # A jaw opens.
    angles[number] = (-1 if inst.grip_arms[number] < 0 else 1) * inst.tip_joints[number].range / 2
    seconds = inst.tip_joints[number].range / 2 / _SPEED
    return [*_driven(inst, angles, seconds), Hold(duration=_RISE), *_driven(inst, -angles, seconds)]


def _driven(inst: CoupledInstrument, angles: Array, seconds: float) -> list[AnyPhase]:
    """Return phases in which the spools draw what tendons that do not stretch would for a change of the angles."""
    speeds = inst.tendon_arms("tip") @ angles / (inst.spool_radius or inst.drives.spool_radius) / seconds
    spools = {
        tendon.name: float(speed)
        for tendon, speed in zip(inst.tendons, speeds, strict=True)
        if speed and tendon.start == "spool"
    }
    if not spools:
        return []
    return [
        Ramp(duration=_RISE, spool_velocities=spools),
        Hold(duration=max(seconds - _RISE, 1e-3)),
        Ramp(duration=_RISE, spool_velocities=dict.fromkeys(spools, 0.0)),
    ]


def _bearable(inst: CoupledInstrument) -> float:
    """Return a force across the tip, N, that takes no more than a few degrees from a joint."""
    rates = coupled.rates(inst, np.zeros(len(inst.handle_joints)))
    most = float(np.abs(rates.by_wrench[:, :2]).max())
    return float(f"{min(_LOAD, _LOST / most):.1g}")


def _gripping(inst: CoupledInstrument) -> list[AnyPhase]:
    """Return phases in which the jaws close on an object, hold it, and let go."""
    arms = inst.grip_arms
    placed: list[AnyPhase] = [GrippedObject(stiffness=_OBJECT)]
    removed: list[AnyPhase] = [GrippedObject(stiffness=0.0)]
    closed = -_PRESSED * arms / float(arms @ arms)
    if not inst.handle_joints:
        close, open_again = (_driven(inst, sign * closed, 2 * _RISE) for sign in (1, -1))
        return [*placed, *close, Hold(duration=1.0), *open_again, *removed]
    quarters = np.diag([joint.range / 4 for joint in inst.handle_joints])
    aims = np.concatenate([quarters, -quarters])
    opened = coupled.output_angles(inst, aims) @ arms
    most = int(np.argmin(opened))
    if not opened[most] < 0:
        return []
    angles = aims[most] * min(1.0, -_PRESSED / opened[most])
    joint = inst.handle_joints[most % len(quarters)].name
    moves = [Ramp(duration=2 * _RISE, handle_angles={joint: aim}) for aim in (float(angles.sum()), 0.0)]
    return [*placed, moves[0], Hold(duration=1.0), moves[1], *removed]

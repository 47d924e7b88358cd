"""The twin under a load that is applied suddenly, with the controller in the loop, and the response of the tip."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tenodesis import statics
from tenodesis.control import Controller, LawName, Request
from tenodesis.instrument import ShortForm
from tenodesis.paper.context import COEFFICIENTS, held_angles
from tenodesis.paper.step_load import approach_time, step_force
from tenodesis.report.content import Array, named
from tenodesis.run import Run
from tenodesis.simulate import campaign
from tenodesis.simulate.command import SMOOTH
from tenodesis.statics import Actuation
from tenodesis.twin import TIME_STEP, Twin

NEAR = 1.0
"""Error within which the tip counts as back, deg."""

_AVERAGED, _LAST = 0.5, 1.0  # s
_FOLLOWS = 0.5  # deg
_STANDS = 1e-2  # rad/s


class HeldMotion(NamedTuple):
    """Handle angle (rad) and force (N) by step, both (n,): the handle is moved and held, then the load comes."""

    handle_angle: Array
    force: Array
    loaded: int
    """First step under the load."""
    desired: float
    """Output angle without friction and load, rad."""


class StepResponse(NamedTuple):
    """The response of the tip and the motors to the load; errors are against the angle of eq. 18."""

    before: float
    """Error before the load, deg."""
    final: float
    """Error at the end, deg."""
    settling_time: float
    """Time from the load after which the tip stays near, s; infinite if it does not."""
    overshoot: float
    """Overshoot of the tip beyond the desired angle after the load, deg; negative if it stays short of it."""
    largest: float
    """Largest error after the load, deg."""
    rest_time: float
    """Time from the load after which the motors are at rest, s; infinite if they move in the last second."""
    highest_tension: float
    """N"""
    observer_error: float
    """Error of the observer at the end, deg; NaN if it has no estimate."""
    friction_scale: float
    """Friction scale that the observer has found."""
    faulted: bool


def controller_model(inst: ShortForm, friction: float = 1.0, identified: bool = True) -> ShortForm:
    """Return the controller's model of an instrument: its friction by a factor, its stiffness identified or not."""
    changes: dict[str, float] = {}
    if friction != 1:
        changes = {f"friction.{key}": friction * getattr(inst.friction, key) for key in COEFFICIENTS}
    if identified and inst.mismatch.stiffness_ratio != 1:
        # A stiffness in the file takes precedence over the modulus.
        key = "tendon_modulus" if inst.given_stiffness is None else "tendon_stiffness"
        nominal = inst.tendon_modulus if key == "tendon_modulus" else inst.tendon_stiffness
        if nominal is not None:
            changes[key] = nominal * inst.mismatch.stiffness_ratio
    return inst.replace(**changes) if changes else inst


def missing(inst: ShortForm, *, seeds: int = 1, rough: bool = False) -> str:
    """Return in words why a law cannot be studied on an instrument, with noise or on friction; empty if it can."""
    if not seeds:
        return "the number of noise seeds is 0"
    if rough and inst.friction.law == "none":
        return f"{named(inst)} has no friction"
    try:
        Controller(controller_model(inst))
    except ValueError:
        return f"{named(inst)} cannot be compensated"
    return ""


def held_states(inst: ShortForm) -> list[float]:
    """Return the output angles (rad) that are held, where the handle reaches them."""
    angles = held_angles(inst)
    handle = statics.handle_angle(inst, np.array(angles))
    return [output for output, angle in zip(angles, handle, strict=True) if abs(angle) <= inst.handle_range]


def held_motion(
    inst: ShortForm, desired: float, force: float, before: float, after: float, *, wait: float = 0.0
) -> HeldMotion:
    """Return the motion to the handle angle that without friction gives an output angle (rad), and the load (N) on it.

    The handle waits for a time, s; the load comes `before` s later and stays for `after` s.
    """
    handle = float(statics.handle_angle(inst, desired))
    steps = round((before + after) / TIME_STEP)
    time = np.arange(1, steps + 1) * TIME_STEP
    part = np.clip(time / max(approach_time(handle), TIME_STEP), 0, 1)
    loaded, still = round(before / TIME_STEP), np.zeros(round(wait / TIME_STEP))
    angles, loads = handle * SMOOTH.way(part), np.where(np.arange(steps) < loaded, 0, force)
    return HeldMotion(np.append(still, angles), np.append(still, loads), still.size + loaded, desired)


def simulate_motion(
    inst: ShortForm,
    model: ShortForm,
    motion: HeldMotion,
    law: LawName,
    actuation: Actuation = "differential",
    *,
    seed: int = 15,
    paused: bool = False,
    sheath_bend: ArrayLike = 0.0,
    homed: int | None = None,
) -> Run:
    """Run the twin with a controller that has a model of the instrument.

    If it is paused, the motors stand from when the load comes, wherever the file has motors that stop return.

    If `homed` is a step, the controller homes until then; if not, it has been homed before.

    Raises NoSolutionError if the joint does not hold the load.
    """
    request = np.zeros(len(motion.force), int)
    if paused:
        request[motion.loaded] = Request.PAUSE
        model = model.replace(**{"control.stop": "hold"})
    if homed is not None:
        request[0], request[homed] = Request.HOME, Request.RESUME
    return Twin(inst, seed=seed).run(
        motion.handle_angle,
        motion.force,
        controller=Controller(model, law=law, actuation=actuation, homed=homed is None),
        request=request,
        sheath_bend=sheath_bend,
    )


def response(run: Run, motion: HeldMotion) -> StepResponse:
    """Compute the response of the tip and the motors in a run of a motion."""
    error = np.degrees(run["output_angle"] - motion.desired)
    after = error[motion.loaded :]
    averaged, last = round(_AVERAGED / TIME_STEP), round(_LAST / TIME_STEP)
    off = np.flatnonzero(np.abs(after) > NEAR)
    back = 0 if not off.size else int(off[-1]) + 1
    turning = np.flatnonzero(np.abs(run["spool_velocity"][motion.loaded :]).max(1) > _STANDS)
    stands = 0 if not turning.size else int(turning[-1]) + 1
    observer_error = np.degrees(run["estimated_output_angle"] - run["output_angle"])[-averaged:].mean()
    return StepResponse(
        before=float(error[motion.loaded - 1]),
        final=float(after[-averaged:].mean()),
        settling_time=back * TIME_STEP if back < after.size else np.inf,
        overshoot=float(after.max()),
        largest=float(np.abs(after).max()),
        rest_time=stands * TIME_STEP if stands < after.size - last else np.inf,
        highest_tension=float(run["tension"].max()),
        observer_error=float(observer_error),
        friction_scale=float(run["friction_scale"][-1]),
        faulted=bool(run["faults"][-1]),
    )


def tip_delay(run: Run, paused: Run, motion: HeldMotion, spool_radius: float) -> tuple[float, float]:
    """Return when after the load the tip follows the motors, s, and what the agonist's motor has wound by then, m.

    The tip follows once it is half a degree above where it is with the motors paused; NaN if it never does.
    """
    ahead = np.degrees(run["output_angle"] - paused["output_angle"])[motion.loaded :]
    follows = np.flatnonzero(ahead > _FOLLOWS)
    if not follows.size:
        return np.nan, np.nan
    wound = run["spool_angle"][motion.loaded :, 0]
    return float(follows[0]) * TIME_STEP, spool_radius * float(wound[follows[0]] - wound[0])


def held(
    inst: ShortForm,
    states: Sequence[float],
    laws: Mapping[LawName, Sequence[float]],
    times: tuple[float, float],
    measure: Callable[[Callable[..., Run], HeldMotion, ShortForm], Mapping[str, Any]],
    *,
    load: float | Callable[[float], float] | None = None,
    plant: ShortForm | None = None,
    identified: bool = True,
    seeds: Sequence[int] = (15,),
    wait: float = 0.0,
    **how: Any,
) -> campaign.Rows:
    """Return a row for each held state, law, error of the friction that it assumes and noise seed.

    Parameters
    ----------
    inst
        What the controller's model is made of.
    states
        Output angles, rad.
    laws
        By law the errors of the assumed friction, as shares of the true friction.
    times
        Before the load and under it, s.
    measure
        Returns metrics of a run, by what runs it (with further arguments of :func:`simulate_motion`), its motion, and
        the controller's model.
    load
        N, or of each state; by default the step load.
    plant
        The instrument that is run; by default the model's.
    identified, wait, how
        As :func:`controller_model`, :func:`held_motion` and :func:`simulate_motion` take them.
    """
    force = step_force(inst) if load is None else load
    motions = {
        state: held_motion(inst, state, force(state) if callable(force) else force, *times, wait=wait)
        for state in states
    }
    models = {
        error: controller_model(inst, 1 + error, identified) for error in {one for few in laws.values() for one in few}
    }

    def trial(state: float, law: LawName, error: float, seed: int) -> Mapping[str, Any]:
        arguments = (plant or inst, models[error], motions[state], law)
        return measure(partial(simulate_motion, *arguments, seed=seed, **how), motions[state], models[error])

    cases = [
        {"state": state, "law": law, "error": error, "seed": seed}
        for state in states
        for law, errors in laws.items()
        for error in errors
        for seed in seeds
    ]
    return campaign.run(trial, cases, on="threads")

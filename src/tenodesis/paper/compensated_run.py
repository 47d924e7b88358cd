"""A load applied suddenly to the held twin with the controller in the loop, and what became of the tip."""

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tenodesis import statics
from tenodesis.control import Controller, LawName, Request
from tenodesis.errors import NoSolutionError
from tenodesis.instrument import Instrument
from tenodesis.paper.loss import shown_force
from tenodesis.paper.step_load import APPROACH, rigged
from tenodesis.run import Run
from tenodesis.statics import Actuation
from tenodesis.threads import threads
from tenodesis.twin import TIME_STEP, Twin

Array = NDArray[np.float64]
T = TypeVar("T")
R = TypeVar("R")

NEAR = 1.0
"""Output angle within which the tip counts as back, deg."""

_SETTLED, _LAST = 0.5, 1.0  # s
_FOLLOWS = 0.5  # deg
_STANDS = 1e-2  # rad/s
_COEFFICIENTS = ("vertex_coefficient", "sheath_coefficient", "constant")


class Held(NamedTuple):
    """Handle angle (rad) and force (N) by step: the handle is moved and held, then the load comes."""

    handle_angle: Array
    force: Array
    loaded: int
    """First step under the load."""
    wanted: float
    """Output angle without friction and load, rad."""


class Outcome(NamedTuple):
    """What became of the tip, deg, s and N; errors count from the angle of eq. 18."""

    before: float
    """Error before the load."""
    final: float
    """Error at the end."""
    settled: float
    """Time from the load on after which the tip stays near; infinite if it does not."""
    overshoot: float
    """How far the tip goes beyond the wanted angle after the load, negative if it stays short of it."""
    farthest: float
    """How far it is off after the load, at most."""
    rest: float
    """Time from the load on after which the motors stand; infinite if they are at work in the last second."""
    highest: float
    """Highest tension."""
    observed: float
    """Error of the observer at the end, NaN if it does not know."""
    scale: float
    """Friction scale that it has found."""
    faulted: bool


def known(inst: Instrument, friction: float = 1.0, identified: bool = True) -> Instrument:
    """Return an instrument as its controller knows it: friction by a factor, the tendons' stiffness identified or not.

    Raises
    ------
    ValueError
        There is no such instrument.
    """
    changes: dict[str, float] = {}
    if friction != 1:
        changes = {f"friction.{key}": friction * getattr(inst.friction, key) for key in _COEFFICIENTS}
    if identified and inst.mismatch.stiffness_ratio != 1:
        # A given stiffness goes before the modulus.
        key = "tendon_modulus" if inst.given_stiffness is None else "tendon_stiffness"
        nominal = inst.tendon_modulus if key == "tendon_modulus" else inst.tendon_stiffness
        if nominal is not None:
            changes[key] = nominal * inst.mismatch.stiffness_ratio
    return inst.replace(**changes) if changes else inst


def refusal(inst: Instrument) -> str | None:
    """Return why an instrument cannot be compensated; None if it can."""
    try:
        Controller(known(inst))
    except ValueError as problem:
        return str(problem)
    return None


def caveat(inst: Instrument) -> str:
    """Return what is to be said of errors that count from eq. 18, as HTML; nothing if a law can bring them to none."""
    if inst.joint_type != "continuum":
        return ""
    return (
        "<p>Errors count from the unloaded angle. The laws bring a continuum beyond it, to where tendons that do not "
        "stretch would, since they give back what its backbone’s own moment takes as well.</p>"
    )


def load(inst: Instrument) -> float:
    """Return the force that the step load makes at the tip, N."""
    return rigged(inst) or shown_force(inst)


def states(inst: Instrument) -> list[float]:
    """Return the output angles (rad) that are held, where the handle reaches them."""
    wanted = inst.conditions.output_angles or tuple(np.linspace(0.0, 0.9 * inst.output_range, 4))
    handle = statics.handle_angle(inst, np.array(wanted))
    return [one for one, angle in zip(wanted, handle, strict=True) if abs(angle) <= inst.handle_range]


def held(inst: Instrument, wanted: float, force: float, before: float, after: float) -> Held:
    """Return the motion to the handle angle that without friction brings the tip where it is wanted, and the load."""
    handle = float(statics.handle_angle(inst, wanted))
    steps = round((before + after) / TIME_STEP)
    time = np.arange(1, steps + 1) * TIME_STEP
    part = np.clip(time / max(abs(handle) / APPROACH * 15 / 8, TIME_STEP), 0, 1)
    loaded = round(before / TIME_STEP)
    return Held(
        handle * part**3 * (10 - 15 * part + 6 * part**2), np.where(np.arange(steps) < loaded, 0, force), loaded, wanted
    )


def apply(
    inst: Instrument,
    told: Instrument,
    motion: Held,
    law: LawName,
    actuation: Actuation = "differential",
    *,
    seed: int = 15,
    paused: bool = False,
    sheath_bend: ArrayLike = 0.0,
) -> Run:
    """Run the twin with a controller that was told an instrument; paused: the motors are held from the load on.

    Raises
    ------
    NoSolutionError
        The joint does not hold the load.
    """
    request = np.zeros(len(motion.force), int)
    if paused:
        request[motion.loaded] = Request.PAUSE
    return Twin(inst, seed=seed).run(
        motion.handle_angle,
        motion.force,
        controller=Controller(told, law=law, actuation=actuation),
        request=request,
        sheath_bend=sheath_bend,
    )


def outcome(run: Run, motion: Held) -> Outcome:
    """Work out what became of the tip."""
    error = np.degrees(run["output_angle"] - motion.wanted)
    after = error[motion.loaded :]
    rest, last = round(_SETTLED / TIME_STEP), round(_LAST / TIME_STEP)
    off = np.flatnonzero(np.abs(after) > NEAR)
    back = 0 if not off.size else int(off[-1]) + 1
    turning = np.flatnonzero(np.abs(run["spool_velocity"][motion.loaded :]).max(1) > _STANDS)
    stood = 0 if not turning.size else int(turning[-1]) + 1
    observed = np.degrees(run["estimated_output_angle"] - run["output_angle"])[-rest:].mean()
    return Outcome(
        float(error[motion.loaded - 1]),
        float(after[-rest:].mean()),
        back * TIME_STEP if back < after.size else np.inf,
        float(after.max()),
        float(np.abs(after).max()),
        stood * TIME_STEP if stood < after.size - last else np.inf,
        float(run["tension"].max()),
        float(observed),
        float(run["friction_scale"][-1]),
        bool(run["faults"][-1]),
    )


def delay(run: Run, paused: Run, motion: Held, spool_radius: float) -> tuple[float, float]:
    """Return when after the load the tip follows the motors, s, and what the agonist's had wound by then, m.

    The tip follows once it stands half a degree above where it stands with the motors held; NaN if it never does.
    """
    ahead = np.degrees(run["output_angle"] - paused["output_angle"])[motion.loaded :]
    follows = np.flatnonzero(ahead > _FOLLOWS)
    if not follows.size:
        return np.nan, np.nan
    wound = run["spool_angle"][motion.loaded :, 0]
    return float(follows[0]) * TIME_STEP, spool_radius * float(wound[follows[0]] - wound[0])


def together(work: Callable[[T], R], cases: Iterable[T]) -> list[R | None]:
    """Return what the cases come to, side by side over threads, in order; None where the joint does not hold."""

    def one(case: T) -> R | None:
        try:
            return work(case)
        except NoSolutionError:
            return None

    with ThreadPoolExecutor(threads()) as pool:
        return list(pool.map(one, cases))

"""Time steps that an instrument's twin can take, and whether one can run with the default step at all."""

from math import ceil, floor, log10, pi, sqrt

import numpy as np

from tenodesis.errors import ArgumentError, InstrumentError
from tenodesis.instrument import ShortForm
from tenodesis.instrument.compliance import compliance_shares
from tenodesis.instrument.tip_motion import straight_stiffness, tip_inertia

TIME_STEP = 5e-4
"""Default time step, s."""
LARGEST_PHASE_STEP = 0.5
"""Phase of the fastest oscillation that a time step may take, rad: a twelfth of its period; beyond, errors grow."""
_LONGEST_TICK = 1.0
"""Time between ticks that a controller allows without a watchdog, s."""
_MOST_STEPS = 2**31 - 1
_DIVISION_ERROR = 1e-6


def natural_frequency(inst: ShortForm) -> float:
    """Return the angular natural frequency of the straight, unloaded, frictionless tip, rad/s."""
    return sqrt(straight_stiffness(inst) / tip_inertia(inst))


def longest_step(inst: ShortForm) -> float:
    """Return the longest time step that the tip's natural frequency allows, s."""
    return LARGEST_PHASE_STEP / natural_frequency(inst)


def least_tip_inertia(inst: ShortForm) -> float:
    """Return the smallest inertia of the tip that time steps of the default length can follow, kg m^2."""
    return straight_stiffness(inst) * (TIME_STEP / LARGEST_PHASE_STEP) ** 2


def check_runnable(inst: ShortForm) -> None:
    """Refuse an instrument that no twin of the default time step, and so no live loop, can run.

    Raises
    ------
    InstrumentError
        A value prevents it; the message names the key, the value and what is allowed.
    ArgumentError
        Its joints and handle leave no compliance to the stem.
    """
    for planar in inst.planar:
        _check_inertia(planar)
    _check_ticks(inst)
    for planar in inst.planar:
        _check_compliance(planar)


def _check_inertia(inst: ShortForm) -> None:
    if longest_step(inst) >= TIME_STEP:
        return
    raise _not_runnable(
        "dynamics.tip_inertia",
        f"{inst.dynamics.tip_inertia:g} kg*m^2",
        f"at least {_rounded_up(least_tip_inertia(inst)):g} kg*m^2, so that the tip swings slowly enough for time "
        f"steps of {TIME_STEP:g} s",
    )


def _check_ticks(inst: ShortForm) -> None:
    rate, watchdog = inst.sensors.sampling_rate, inst.control.watchdog
    period = max(1 / rate, TIME_STEP)
    longest = watchdog or _LONGEST_TICK
    if period < longest:
        _check_division(rate, period)
    elif period > TIME_STEP:
        reason = "after which control.watchdog stops the motors" if watchdog else "the longest time between ticks"
        allowed = f"above {1 / longest:g} Hz: its period must be shorter than {longest:g} s, {reason}"
        raise _not_runnable("sensors.sampling_rate", f"{rate:g} Hz", allowed)
    else:
        allowed = f"above {TIME_STEP:g} s, the time between ticks, or 0"
        raise _not_runnable("control.watchdog", f"{watchdog:g} s", allowed)


def _check_division(rate: float, period: float) -> None:
    steps = round(period / TIME_STEP)
    if abs(steps * TIME_STEP / period - 1) > _DIVISION_ERROR:
        allowed = f"such that a period takes whole time steps of {TIME_STEP:g} s, as {1 / (steps * TIME_STEP):g} Hz"
        raise _not_runnable("sensors.sampling_rate", f"{rate:g} Hz", allowed)


def _not_runnable(key: str, value: str, allowed: str) -> InstrumentError:
    return InstrumentError(f"{key} is {value}; to run it must be {allowed}.", key=key, value=value, allowed=allowed)


def _rounded_up(value: float) -> float:
    """Return a value of three digits that is at least as large."""
    unit = 10.0 ** (floor(log10(value)) - 2)
    return ceil(value / unit) * unit


def steps_per_sample(inst: ShortForm, time_step: float, quasi_static: bool) -> int:
    """Return how many time steps (s) a sampling period takes.

    Raises
    ------
    ValueError
        The time step does not suit the instrument, or its joints and handle leave no compliance to the stem.
    """
    if not (np.isfinite(time_step) and time_step > 0):
        raise ArgumentError(key="time_step", value=time_step, allowed="a time above 0 s")
    if not quasi_static and time_step > (longest := longest_step(inst)):
        allowed = f"at most {longest:.3g} s"
        problem = (
            f"time_step is {time_step:g} s; it must be {allowed}, a twelfth of a period of the tip of {inst.name} "
            f"({natural_frequency(inst) / (2 * pi):.3g} Hz)."
        )
        raise ArgumentError(problem, key="time_step", value=time_step, allowed=allowed)
    per_sample = steps_per_period(inst.sensors.sampling_rate, time_step)
    _check_compliance(inst)
    return per_sample


def steps_per_period(rate: float, time_step: float) -> int:
    """Return how many time steps (s) a sampling period takes; raises ArgumentError where they do not divide it."""
    period = 1 / rate
    per_sample = max(1, round(period / time_step))
    if per_sample > _MOST_STEPS:
        allowed = f"at least {1 / (_MOST_STEPS * time_step):.3g} Hz"
        problem = f"sensors.sampling_rate is {rate:g} Hz; with time steps of {time_step:g} s it must be {allowed}."
        raise ArgumentError(problem, key="sensors.sampling_rate", value=rate, allowed=allowed)
    if period > time_step and abs(per_sample * time_step / period - 1) > _DIVISION_ERROR:
        allowed = f"an integer fraction of the sampling period of {period:g} s, or more"
        problem = f"time_step is {time_step:g} s; it must be {allowed}."
        raise ArgumentError(problem, key="time_step", value=time_step, allowed=allowed)
    return per_sample


def _check_compliance(inst: ShortForm) -> None:
    """Raise ArgumentError if handle and joints leave no share of a tendon's compliance to the stem."""
    shares = compliance_shares(inst)
    share, joints = shares.handle, shares.handle_joint + shares.tip_joint + shares.anchor
    if shares.stem > 0:
        return
    if inst.friction.handle_compliance_share is None:
        raise ArgumentError(
            f"handle_length and joints take {share + joints:.3g} of the length of a tendon of {inst.name}; it must be "
            "less than 1: give a shorter handle_length or a longer tendon_length.",
            key="handle_length",
            value=inst.handle_length,
            allowed="less than the tendon's length without the joints",
        )
    raise ArgumentError(
        f"friction.handle_compliance_share is {share:g}, which with the joints makes {share + joints:.3g} of the "
        f"compliance of {inst.name}; it must be below {1 - joints:.3g}.",
        key="friction.handle_compliance_share",
        value=share,
        allowed=f"below {1 - joints:.3g}",
    )

"""The handle's motions, loads and friction that tests of observers and laws share."""

from typing import Any

import numpy as np

from tenodesis.instrument import Instrument
from tenodesis.run import Array
from tenodesis.twin import TIME_STEP

from .twin_motions import slack_force, smooth


def with_friction(inst: Instrument, scale: float = 1.0, **more: Any) -> Instrument:
    """The first axis with the friction of the paper's instruments, times a scale, otherwise as its file says it is."""
    table = {"vertex_coefficient": 0.1 * scale, "sheath_coefficient": 0.1 * scale, "sheath_bend": np.radians(10)}
    friction = {f"friction.{key}": value for key, value in {"law": "capstan", **table}.items()}
    return smooth(inst).replace(**friction | more)


def clock(duration: float) -> Array:
    return np.arange(1, round(duration / TIME_STEP) + 1, dtype=np.float64) * TIME_STEP


def eased(to: float, duration: float, total: float) -> Array:
    """A command that leaves zero and arrives with zero velocity, then holds, rad."""
    share = np.clip(clock(total) / duration, 0, 1)
    return np.asarray(to * share**3 * (10 - 15 * share + 6 * share**2), np.float64)


def load_of(inst: Instrument, share: float) -> float:
    """Force (N) at a share of what slackens a tendon of the straight instrument."""
    return share * slack_force(inst)

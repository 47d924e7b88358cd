"""Episodes: what a hand, a load and tissue do to an instrument, and how instruments differ."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics, tolerance
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form
from tenodesis.plant import TIME_STEP
from tenodesis.run import Array
from tenodesis.tolerance.parameters import resolve
from tenodesis.twin.rows import columns_by_name

_WIDTHS = (("handle_angle", 1), ("spool_velocity", 2), ("force", 1), ("contact", 3), ("spool_tension", 2))
COMMANDS = columns_by_name(_WIDTHS)
"""Columns of a row of commands, by name."""
WIDTH = sum(width for _, width in _WIDTHS)
_FINGERS_STILL = 0.2
"""Time before the hand moves, s."""
_LOAD_RISE = 0.05  # s


@dataclass(frozen=True)
class Task:
    """What an instrument is asked to do in an episode: follow the hand twice, under a load or into tissue.

    Raises
    ------
    ArgumentError
        A value is out of its range.
    """

    period: float = 5e-3
    """Time between two actions, s; a multiple of the sensors' sampling period and of the twin's step."""
    duration: float = 4.0
    """Of an episode, s."""
    reach: float = 0.9
    """Largest unloaded output angle that the hand asks for, as a share of the instrument's output range."""
    move_time: float = 0.8
    """Of one movement of the hand, of minimum jerk, s."""
    tremor: float = np.radians(0.2)
    """Largest amplitude of the hand's tremor, at 6 to 12 Hz, rad."""
    force: float = 1.0
    """Largest load, as a share of the largest of the instrument's conditions.forces."""
    tissue: float = 0.5
    """Share of the episodes in which the tip meets tissue instead of a load."""
    tissue_stiffness: tuple[float, float] = (100.0, 5000.0)
    """Range of its stiffness, drawn uniformly in the logarithm, N/m."""
    action_cost: float = 0.01
    """Reward lost by full speed of both spools, or by their tensions' largest change, in one period."""
    drive: Literal["velocity", "tension"] = "velocity"
    """What an action commands of a spool: its velocity, or the tension that it holds."""

    def __post_init__(self) -> None:
        if self.drive not in ("velocity", "tension"):
            raise ArgumentError(key="drive", value=self.drive, allowed="velocity or tension")
        positive = {"period": self.period, "duration": self.duration, "move_time": self.move_time}
        for key, value in positive.items():
            if not (np.isfinite(value) and value > 0):
                raise ArgumentError(key=key, value=value, allowed="a time above 0 s")
        for key, share in {"reach": self.reach, "tissue": self.tissue}.items():
            if not 0 <= share <= 1:
                raise ArgumentError(key=key, value=share, allowed="between 0 and 1")
        for key, value in {"tremor": self.tremor, "force": self.force, "action_cost": self.action_cost}.items():
            if not (np.isfinite(value) and value >= 0):
                raise ArgumentError(key=key, value=value, allowed="0 or more")
        low, high = self.tissue_stiffness
        if not 0 < low <= high < np.inf:
            raise ArgumentError(key="tissue_stiffness", value=self.tissue_stiffness, allowed="two above 0, in order")


class Episodes:
    """The episodes of many environments, each with its own hand, load and tissue."""

    def __init__(self, inst: ShortForm, task: Task, count: int) -> None:
        self._task = task
        self._reach = float(statics.handle_angle(inst, task.reach * inst.output_range))
        self._force = task.force * max(inst.conditions.forces)
        angles = np.linspace(-self._reach, self._reach, 257) * 1.05
        self._handle = np.clip(angles, -inst.handle_range, inst.handle_range)
        self._output = np.asarray(statics.unloaded_angle(inst, self._handle))
        self._limit = inst.handle_range
        names = ("first", "second", "pause", "amplitude", "frequency", "phase", "force", "at")
        self._drawn = {name: np.zeros(count) for name in names}
        self._contact = np.zeros((count, 3))

    def draw(self, which: NDArray[np.int64], random: np.random.Generator, alike: int) -> None:
        """Begin new episodes in some environments, by index; as many in a row have the same."""
        n, task = len(which) // alike, self._task
        values = {
            "first": random.uniform(-self._reach, self._reach, n),
            "second": random.uniform(-self._reach, self._reach, n),
            "pause": random.uniform(0.2, 0.6, n) * task.duration,
            "amplitude": random.uniform(0, task.tremor, n),
            "frequency": random.uniform(6.0, 12.0, n),
            "phase": random.uniform(0, 2 * np.pi, n),
            "force": random.uniform(-self._force, self._force, n),
            "at": random.uniform(0.2, 0.8, n) * task.duration,
        }
        meets = random.random(n) < task.tissue
        values["force"][meets] = 0.0
        for name, value in values.items():
            self._drawn[name][which] = np.repeat(value, alike)
        aim = self.target(values["first"])
        low, high = np.log(task.tissue_stiffness)
        stiffness = np.exp(random.uniform(low, high, n))
        # In the way of the first movement, and never where the straight tip is.
        self._contact[which, 0] = np.repeat(aim * random.uniform(0.3, 1.0, n), alike)
        self._contact[which, 1] = np.repeat(np.where(meets, np.copysign(stiffness, aim), 0.0), alike)

    def target(self, handle_angle: Array) -> Array:
        """Return the output angle without load and friction, rad."""
        return np.asarray(np.interp(handle_angle, self._handle, self._output), np.float64)

    def commands(self, tick: NDArray[np.int64], out: Array) -> None:
        """Write the commands of a period that begins after so many periods, shape (count,), into rows of COMMANDS."""
        task, d = self._task, self._drawn
        steps = out.shape[1]
        time = tick[:, np.newaxis] * task.period + (1 + np.arange(steps)) * TIME_STEP
        first, second, pause = (d[name][:, np.newaxis] for name in ("first", "second", "pause"))
        angle = first * _minimum_jerk((time - _FINGERS_STILL) / task.move_time)
        angle += (second - first) * _minimum_jerk((time - _FINGERS_STILL - pause) / task.move_time)
        wave = np.sin(2 * np.pi * d["frequency"][:, np.newaxis] * time + d["phase"][:, np.newaxis])
        angle += d["amplitude"][:, np.newaxis] * wave * np.minimum(time / _FINGERS_STILL, 1)
        out[:, :, COMMANDS["handle_angle"]] = np.clip(angle, -self._limit, self._limit)[..., np.newaxis]
        rise = np.clip((time - d["at"][:, np.newaxis]) / _LOAD_RISE, 0, 1)
        out[:, :, COMMANDS["force"]] = (d["force"][:, np.newaxis] * rise)[..., np.newaxis]
        out[:, :, COMMANDS["contact"]] = self._contact[:, np.newaxis]


def randomised(
    inst: InstrumentLike, count: int, tolerances: tolerance.Tolerances | None = None, seed: int = 0
) -> list[ShortForm]:
    """Return instruments as a workshop would build them: drawn from the tolerances of a file.

    Parameters
    ----------
    inst
        The nominal instrument, of one axis.
    count
        How many to draw.
    tolerances
        As :func:`tenodesis.tolerance.load` reads them; by default those of :func:`tenodesis.tolerance.default`.
    seed
        Of the draws.

    Raises
    ------
    StudyError
        A key is unknown, cannot vary, or its tolerance is not understood.
    """
    nominal = as_short_form(inst)
    given = tolerance.default(nominal) if tolerances is None else tolerances
    parameters = [one for one in resolve(given, nominal, nominal) if one.instrument == "scaled-up"]
    random = np.random.default_rng(seed)
    return [nominal.replace(**_drawn(parameters, random)) for _ in range(count)]


def _drawn(parameters: Sequence[tolerance.UncertainParameter], random: np.random.Generator) -> dict[str, Any]:
    changes = {}
    for one in parameters:
        if one.distribution == "normal":
            value = random.normal(one.nominal, one.width)
        elif one.distribution == "triangular":
            value = random.triangular(one.nominal - one.width, one.nominal, one.nominal + one.width)
        else:
            value = random.uniform(one.nominal - one.width, one.nominal + one.width)
        changes[one.key] = float(np.clip(value, one.lower, one.upper))
    return changes


def _minimum_jerk(share: Array) -> Array:
    """Return the way covered by a movement of minimum jerk (Flash, Hogan 1985), from 0 to 1."""
    s = np.clip(share, 0, 1)
    return s**3 * (10 - 15 * s + 6 * s**2)

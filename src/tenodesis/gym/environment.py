"""An instrument in a hand, on a load or on tissue, whose motors a policy drives."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from tenodesis import _core, control, plant
from tenodesis.errors import ArgumentError
from tenodesis.gym.episodes import COMMANDS, WIDTH, Episodes, Task
from tenodesis.instrument import InstrumentLike, as_short_form
from tenodesis.run import Array
from tenodesis.threads import threads
from tenodesis.twin import Contact
from tenodesis.twin.rows import columns_by_name

_READ = ("measured_handle_angle", "measured_tension", "measured_spool_angle")
_TRUE = ("handle_angle", "output_angle", "tension")
_READINGS = 5
"""Columns of what is read."""
_BOUNDS = np.array([2, 50, 50, 100, 100, 1, 1], np.float32)
"""Of an observation, which is cut there."""
_OBSERVED = _BOUNDS.size
_LEAST_TENSION = 0.01
"""Tension that an action of -1 commands, over that at rest: a spool with none would run on."""
_LOST = -10.0
"""Reward of a step that the instrument does not survive."""

Info = dict[str, Any]
Observations = NDArray[np.float32]


class TendonVectorEnv(VectorEnv[Observations, NDArray[np.float32], NDArray[Any]]):
    """Many instruments of one kind, each in its own hand; they step in the lanes of the processor's vectors.

    An observation has what the proximal sensors say, and what was done: handle angle over its range, tension over
    pretension less 1 and spool angle in rad of agonist and antagonist, and the last action; shape (7,). An action has
    the spool velocities of both, -1 to 1 of the drives' limit; or, where the task's drives hold tensions, these, from
    next to none by that at rest to the controller's limit. The reward of a period is minus the distance of the tip,
    in degrees, from where the first instrument, if rigid and without friction, would have it, less the action's cost.
    An episode is terminated, with a reward of -10, where the tip finds no equilibrium or a tension passes the
    controller's limit, and truncated after the task's duration. An environment that is done begins its next episode in
    the same step (``final_obs`` and ``final_info`` have its last).

    Parameters
    ----------
    instruments
        One, or several that episodes draw from, such as :func:`randomised` gives; all of one kind and one axis.
    num_envs
        How many environments.
    task
        What is asked of them.

    Raises
    ------
    ArgumentError
        An instrument has two axes, the number of environments is none, or the period does not fit the sensors'.
    """

    def __init__(
        self, instruments: InstrumentLike | Sequence[InstrumentLike], num_envs: int = 1, task: Task | None = None
    ) -> None:
        given = [instruments] if isinstance(instruments, InstrumentLike) else list(instruments)
        insts = [as_short_form(one) for one in given]
        self.task = Task() if task is None else task
        if not insts or num_envs < 1:
            raise ArgumentError(key="num_envs", value=num_envs, allowed="1 or more, of one instrument or more")
        for inst in insts:
            if len(inst.axes) != 1:
                raise ArgumentError(f"{inst.name} has two axes; it must have one: inst.axis(name).", key="instruments")
        self._steps = _steps(self.task.period, plant.steps_per_sample(insts[0], plant.TIME_STEP, False))
        self._insts = insts
        self._specs = [plant.spec(inst, plant.TIME_STEP, False) for inst in insts]
        self._pretension = np.array([inst.pretension for inst in insts])
        self._handle_range = insts[0].handle_range
        self._speed = insts[0].drives.motor_speed / insts[0].drives.gear_ratio
        self.tension_limit = float(control.parameters(insts[0]).axes[0]["tension_limit"])
        """Tension beyond which an episode is terminated, N."""
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.num_envs = num_envs
        self.single_observation_space = gymnasium.spaces.Box(-_BOUNDS, _BOUNDS, dtype=np.float32)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        batch = gymnasium.vector.utils.batch_space
        self.observation_space = batch(self.single_observation_space, num_envs)
        self.action_space = batch(self.single_action_space, num_envs)
        self._episodes = Episodes(insts[0], self.task, num_envs)
        self._commands = np.zeros((num_envs, self._steps, WIDTH))
        self._ends = np.zeros((num_envs, 2), np.int64)
        self._tick = np.zeros(num_envs, np.int64)
        self._which = np.zeros(num_envs, np.int64)
        self._seeds = np.zeros(num_envs, np.uint64)
        self._twins = _core.TwinBatch(self._resting(range(num_envs)))
        twin = self._resting([0])[0]
        self._given = _places(columns_by_name(twin.commands), COMMANDS)
        self._kept = _places(columns_by_name(twin.signals), (*_READ, *_TRUE))
        self._out = np.zeros((num_envs, len(self._kept), 1))

    def reset(self, *, seed: int | list[int | None] | None = None, options: Info | None = None) -> tuple[Any, Info]:
        """Begin new episodes in all environments: observations, shape (num_envs, 7), and an empty information.

        A list of seeds is taken for the first of them: environments draw from one stream. With the option ``alike``, a
        divisor of ``num_envs``, as many environments in a row have the same episode, so that policies can be compared.
        """
        super().reset(seed=seed[0] if isinstance(seed, list) else seed, options=options)
        alike = (options or {}).get("alike", 1)
        if not isinstance(alike, int) or alike < 1 or self.num_envs % alike:
            raise ArgumentError(key="alike", value=alike, allowed=f"a divisor of the {self.num_envs} environments")
        self._begin(np.arange(self.num_envs), alike)
        return np.zeros((self.num_envs, _OBSERVED), np.float32), {}

    def step(self, actions: NDArray[np.float32]) -> tuple[Any, Any, Any, Any, Info]:
        """Step all environments by one period: observations, rewards, terminations, truncations, information.

        The information has the error of each tip, in rad, and what it was aimed at.
        """
        action = np.clip(np.asarray(actions, np.float64), -1, 1)
        if action.shape != (self.num_envs, 2) or not np.isfinite(action).all():
            allowed = f"finite, of shape ({self.num_envs}, 2)"
            raise ArgumentError(key="actions", value=action.shape, allowed=allowed)
        self._episodes.commands(self._tick, self._commands)
        self._commands[:, :, COMMANDS[f"spool_{self.task.drive}"]] = self._driven(action)[:, np.newaxis]
        self._out.fill(np.nan)
        self._twins.advance(
            self._commands,
            self._given,
            self._kept,
            self._steps,
            self._out,
            self._ends,
            threads(),
            [],
            [],
            1,
            plant.TIME_STEP,
        )
        self._tick += 1
        values = self._out[:, :, 0]
        handle, output, *tensions = values[:, _READINGS:].T
        aim = self._episodes.target(handle)
        error = output - aim
        terminated = (self._ends[:, 1] != 0) | (np.max(tensions, axis=0) > self.tension_limit)
        truncated = ~terminated & (self._tick * self.task.period >= self.task.duration - 1e-9)
        rewards = -np.degrees(np.abs(error)) - self.task.action_cost * (action**2).sum(1) / 2
        rewards[terminated] = _LOST
        observed = self._observed(values, action)
        info: Info = {"error": error, "aim": aim}
        done = terminated | truncated
        if done.any():
            final = np.empty(self.num_envs, object)
            for n in np.flatnonzero(done):
                final[n] = observed[n].copy()
            info |= {"final_obs": final, "_final_obs": done.copy()}
            info |= {"final_info": {"error": error, "_error": done.copy()}, "_final_info": done.copy()}
            self._begin(np.flatnonzero(done))
            observed[done] = 0.0
        return observed, rewards, terminated, truncated, info

    def _driven(self, action: Array) -> Array:
        """Return what actions (num_envs, 2) command the spools: rad/s, or N."""
        if self.task.drive == "velocity":
            return action * self._speed
        rest = self._pretension[self._which, np.newaxis]
        room = np.where(action > 0, self.tension_limit - rest, rest)
        return np.asarray(np.maximum(rest + action * room, _LEAST_TENSION * rest))

    def _observed(self, values: Array, action: Array) -> Observations:
        observed = np.empty((self.num_envs, _OBSERVED), np.float32)
        observed[:, 0] = values[:, 0] / self._handle_range
        observed[:, 1:3] = values[:, 1:3] / self._pretension[self._which, np.newaxis] - 1
        observed[:, 3:5] = values[:, 3:5]
        observed[:, 5:] = action
        return np.clip(np.nan_to_num(observed), -_BOUNDS, _BOUNDS)

    def episodes(self) -> Info:
        """Return what happens in the present episodes, from their beginning, as arguments of ``tn.twin.run_many``.

        Another controller may so be run on the very same instruments, hands, loads, tissue and noise: ``inst``,
        ``handle_angle`` and ``force``, shape (num_envs, steps), ``contact`` and ``seeds``.
        """
        steps = round(self.task.duration / plant.TIME_STEP)
        rows = np.zeros((self.num_envs, steps, WIDTH))
        self._episodes.commands(np.zeros_like(self._tick), rows)
        return {
            "inst": [self._insts[n] for n in self._which],
            "handle_angle": rows[:, :, COMMANDS["handle_angle"]][:, :, 0],
            "force": rows[:, :, COMMANDS["force"]][:, :, 0],
            "contact": [Contact.of_row(*row) for row in rows[:, 0, COMMANDS["contact"]]],
            "seeds": self._seeds.copy(),
        }

    def _resting(self, which: Iterable[int]) -> list[_core.Twin]:
        return [_core.axes_twin([self._specs[self._which[n]]], [int(self._seeds[n])]) for n in which]

    def _begin(self, which: NDArray[np.int64], alike: int = 1) -> None:
        drawn = len(which) // alike
        self._which[which] = np.repeat(self.np_random.integers(len(self._specs), size=drawn), alike)
        self._seeds[which] = np.repeat(self.np_random.integers(2**63, size=drawn, dtype=np.uint64), alike)
        self._twins.restart(which.tolist(), self._resting(which))
        self._episodes.draw(which, self.np_random, alike)
        self._tick[which] = 0


class TendonEnv(gymnasium.Env[Observations, NDArray[np.float32]]):
    """One instrument in one hand: a :class:`TendonVectorEnv` of one, for libraries that take single environments."""

    def __init__(self, instruments: InstrumentLike | Sequence[InstrumentLike], task: Task | None = None) -> None:
        self._many = TendonVectorEnv(instruments, 1, task)
        self.observation_space = self._many.single_observation_space
        self.action_space = self._many.single_action_space

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Observations, Info]:
        """Begin a new episode: observation, shape (7,), and an empty information."""
        super().reset(seed=seed)
        observed, info = self._many.reset(seed=seed, options=options)
        return observed[0], info

    def step(self, action: NDArray[np.float32]) -> tuple[Observations, float, bool, bool, Info]:
        """Step by one period: observation, reward, terminated, truncated, information with the tip's error, rad."""
        observed, rewards, terminated, truncated, info = self._many.step(np.asarray(action)[np.newaxis])
        done = bool(terminated[0] or truncated[0])
        last = info["final_obs"][0] if done else observed[0]
        details = {"error": float(info["error"][0]), "aim": float(info["aim"][0])}
        return last, float(rewards[0]), bool(terminated[0]), bool(truncated[0]), details


def _places(columns: Mapping[str, slice], names: Iterable[str]) -> list[int]:
    return [place for name in names for place in range(columns[name].start, columns[name].stop)]


def _steps(period: float, per_sample: int) -> int:
    steps = round(period / plant.TIME_STEP)
    if steps < 1 or abs(steps * plant.TIME_STEP - period) > 1e-9 * period or steps % per_sample:
        allowed = f"a multiple of {per_sample * plant.TIME_STEP:g} s"
        raise ArgumentError(key="period", value=period, allowed=allowed)
    return steps

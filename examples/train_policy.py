"""Train a small policy as a rival of the laws, and judge all of them on the same episodes of instruments held out.

    python examples/train_policy.py --tuned tuned.json

The policy has one hidden layer and no memory but its last action. It is trained by augmented random search (Mania, Guy
and Recht 2018, version V1-t) in NumPy: a policy moved both ways along random directions, on the same episodes.
"""

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis import gym
from tenodesis.control import Controller, LawName
from tenodesis.instrument import Instrument
from tenodesis.paper.step_response import controller_model
from tenodesis.twin import TIME_STEP, run_many

Array = NDArray[np.float64]
OBSERVED, HIDDEN = 7, 12
SIZES = (HIDDEN * (OBSERVED + 1), HIDDEN, OBSERVED)
SPEED = 0.1  # of the drives' limit, by which a weight of 1 winds
NOISE, RATE = 0.1, 0.05
HELD_OUT, WORSE = 12345, 0.1  # seed; deg
LOST = 99.0
"""Error that counts for an episode that is lost at once, deg."""
TASK = gym.Task(tissue=0.0)
"""Loads alone: in tissue an angle given back is a force, which the law limits, and the reward does not."""
OTHER = gym.Task(tissue=0.0, duration=8.0, move_time=0.4, tremor=np.radians(0.4), force=1.2)
MIRROR = np.array([0, 2, 1, 4, 3, 6, 5])
"""The antagonist sees what the agonist would in an instrument that bends the other way."""


class Judged(NamedTuple):
    """RMS over episodes, of the worst, and of last half seconds, deg; shares worse than motors off, and lost."""

    rms: float
    worst: float
    end: float
    worse: float
    lost: float


def actions(policies: Array, observed: Array) -> Array:
    """Return actions, shape (episodes, policies, 2), by policies of shape (policies, parameters)."""
    first, second, direct = np.split(policies, np.cumsum(SIZES)[:-1], axis=1)
    layer = first.reshape(-1, OBSERVED + 1, HIDDEN)
    mirrored = observed[..., MIRROR] * np.array([-1, *[1] * (OBSERVED - 1)])
    both = np.stack([observed, mirrored], 2)  # (episodes, policies, tendon, observed)
    hidden = np.tanh(np.einsum("epto,poh->epth", both, layer[:, :-1]) + layer[:, np.newaxis, -1])
    wound: Array = np.einsum("epth,ph->ept", hidden, second) + np.einsum("epto,po->ept", both, direct)
    return SPEED * wound


def roll(many: gym.TendonVectorEnv, policies: Array, seed: int) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return mean rewards (episodes, policies), errors in deg (episodes, policies, periods), and which were lost."""
    observed, _ = many.reset(seed=seed, options={"alike": len(policies)})
    shape = (many.num_envs // len(policies), len(policies))
    lost, rewards, errors = np.zeros(many.num_envs, bool), np.zeros(many.num_envs), []
    for _ in range(round(many.task.duration / many.task.period)):
        action = actions(policies, observed.reshape(*shape, OBSERVED).astype(float))
        observed, reward, terminated, _, info = many.step(action.reshape(-1, 2).astype(np.float32))
        lost |= terminated
        rewards += np.where(lost, -10, reward)  # a new episode must not pay
        errors.append(np.where(lost, np.nan, np.degrees(info["error"])))
    return rewards.reshape(shape) / len(errors), np.stack(errors, -1).reshape(*shape, -1), lost.reshape(shape)


def train(options: argparse.Namespace, inst: Instrument) -> Array:
    """Return the parameters of a policy; it begins with motors that stand."""
    random = np.random.default_rng(options.seed)
    insts = [inst, *gym.randomised(inst, 255, seed=1)]
    many = gym.TendonVectorEnv(insts, 2 * options.directions * options.episodes, TASK)
    policy = np.zeros(sum(SIZES))
    policy[: SIZES[0]] = random.normal(0, 0.5, SIZES[0])
    for iteration in range(options.iterations):
        moves = random.normal(size=(options.directions, policy.size))
        rewards = roll(many, np.concatenate([policy + NOISE * moves, policy - NOISE * moves]), iteration)[0].mean(0)
        ahead, back = np.split(rewards, 2)
        best = np.argsort(np.maximum(ahead, back))[-max(options.directions // 2, 1) :]
        spread = np.concatenate([ahead[best], back[best]]).std()
        policy += RATE / (len(best) * spread) * (ahead - back)[best] @ moves[best]
        print(f"iteration {iteration + 1:4}: mean reward {rewards.mean():.3f}, best {rewards.max():.3f}", flush=True)
    return policy


def by_law(many: gym.TendonVectorEnv, known: Instrument, law: LawName) -> tuple[Array, NDArray[np.bool_]]:
    """Return what :func:`roll` does of a law's errors, in the present episodes of the environments."""
    batch = run_many(
        **many.episodes(),
        controllers=[Controller(known, law=law) for _ in range(many.num_envs)],
        signals=("output_angle", "handle_angle", "tension.agonist", "tension.antagonist"),
        every=round(many.task.period / TIME_STEP),
    )
    tension = np.maximum(batch["tension.agonist"], batch["tension.antagonist"])
    lost = np.maximum.accumulate((tension > many.tension_limit) | np.isnan(tension), axis=1)
    errors = np.degrees(batch["output_angle"] - tn.statics.output_angle(known, batch["handle_angle"]))
    return np.where(lost, np.nan, errors), lost[:, -1]


def judged(errors: Array, lost: NDArray[np.bool_], off: Array) -> Judged:
    """Return the figures of episodes, by their errors and those of motors off."""
    # Lost in its first period, an episode has no error of its own.
    empty = np.isnan(errors).all(axis=1)
    errors = np.where(empty[:, np.newaxis], LOST, errors)
    rms, rms_off = (np.sqrt(np.nanmean(one**2, axis=1)) for one in (errors, off))
    end = np.sqrt(np.nanmean(errors[:, -100:] ** 2))
    return Judged(np.sqrt(np.mean(rms**2)), rms.max(), end, np.mean(lost | (rms > rms_off + WORSE)), lost.mean())


def compare(
    policy: Array, laws: dict[str, tuple[Instrument, LawName]], task: gym.Task, count: int
) -> dict[str, Judged]:
    """Return the figures of the policy, of motors off, and of laws by what they know, on the same episodes."""
    inst = tn.load("scaled-up")
    many = gym.TendonVectorEnv([inst, *gym.randomised(inst, 127, seed=1000)], count, task)
    found: dict[str, tuple[Array, NDArray[np.bool_]]] = {}
    for name, own in {"motors off": np.zeros_like(policy), "policy": policy}.items():
        _, errors, lost = roll(many, own[np.newaxis], HELD_OUT)
        found[name] = errors[:, 0], lost[:, 0]
    for name, (known, law) in laws.items():
        many.reset(seed=HELD_OUT)
        found[name] = by_law(many, known, law)
    return {name: judged(*one, found["motors off"][0]) for name, one in found.items()}


def main(arguments: Sequence[str] | None = None) -> tuple[Array, dict[str, dict[str, Judged]]]:
    """Train, print the tables, and return the policy and the figures by task and name."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--iterations", type=int, default=200)
    parser.add_argument("--directions", type=int, default=12, help="of an iteration")
    parser.add_argument("--episodes", type=int, default=8, help="of each policy in an iteration")
    parser.add_argument("--held-out", type=int, default=128, help="episodes of a task to judge by")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--tuned", type=Path, help="parameters of the robust law, as tune_law.py writes them")
    parser.add_argument("--out", type=Path, default=Path("policy.npz"), help="file for the policy")
    parser.add_argument("--trained", action="store_true", help="judge the policy in that file, and train none")
    options = parser.parse_args(arguments)
    inst, begun = tn.load("scaled-up"), time.perf_counter()
    if options.trained:
        policy = np.load(options.out)["policy"]
    else:
        policy = train(options, inst)
        with options.out.open("wb") as file:
            np.savez(file, policy=policy)
        print(f"trained in {time.perf_counter() - begun:.0f} s")
    known = controller_model(inst)
    laws: dict[str, tuple[Instrument, LawName]] = {
        "eq. 22": (known, "paper"),
        "robust law as shipped": (known, "robust"),
    }
    if options.tuned:
        laws["robust law tuned"] = known.replace(**json.loads(options.tuned.read_text("utf-8"))), "robust"
    tasks = {"the task trained for": TASK, "another task": OTHER}
    tables = {name: compare(policy, laws, task, options.held_out) for name, task in tasks.items()}
    for task, table in tables.items():
        print(
            f"\n{task + ', errors [deg]':38}{'RMS':>6}{'worst':>8}{'at the end':>12}{'worse than off':>16}{'lost':>7}"
        )
        for name, one in table.items():
            print(f"{name:38}{one.rms:6.2f}{one.worst:8.2f}{one.end:12.2f}{one.worse:16.1%}{one.lost:7.1%}")
    return policy, tables


if __name__ == "__main__":
    main()

"""Environments for reinforcement learning: Gymnasium's rules, rewards from the twin, and what is refused."""

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tenodesis import gym, tolerance
from tenodesis.instrument import Instrument
from tenodesis.twin import Twin

from .conftest import refused

SHORT = gym.Task(duration=0.5, move_time=0.1)


def test_an_environment_keeps_gymnasiums_rules(scaled: Instrument) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.TendonEnv(scaled, SHORT), skip_render_check=True)


def test_episodes_repeat_by_seed_and_differ_by_environment(scaled: Instrument) -> None:
    insts = gym.randomised(scaled, 4, seed=3)
    assert len({inst.tendon_stiffness for inst in insts}) == 4
    runs = []
    for _ in range(2):
        many = gym.TendonVectorEnv(insts, 5, SHORT)
        many.reset(seed=7)
        runs.append([many.step(np.full((5, 2), 0.01, np.float32)) for _ in range(60)])
    for first, again in zip(*runs, strict=True):
        np.testing.assert_array_equal(first[0], again[0])
        np.testing.assert_array_equal(first[1], again[1])
    rewards = np.array([step[1] for step in runs[0]])
    assert np.unique(rewards[-1]).size == 5


def test_the_reward_is_the_twins_distance_from_a_rigid_instrument(scaled: Instrument) -> None:
    calm = gym.Task(duration=0.5, move_time=0.1, tremor=0.0, tissue=0.0, force=0.0, action_cost=0.0)
    one = gym.TendonVectorEnv(scaled, 1, calm)
    one.reset(seed=1)
    angles, rewards = [], []
    for tick in range(80):
        one._episodes.commands(np.array([tick]), one._commands)
        angles.append(one._commands[0, :, 0].copy())
        _, reward, *_, info = one.step(np.zeros((1, 2), np.float32))
        rewards.append(reward[0])
        assert reward[0] == pytest.approx(-np.degrees(abs(info["error"][0])))
    run = Twin(scaled).run(np.concatenate(angles))
    aim = one._episodes.target(run.handle_angle)
    np.testing.assert_allclose(rewards, -np.degrees(np.abs(run.output_angle - aim))[9::10], rtol=1e-9)
    assert min(rewards) < -0.5


def test_an_episode_ends_in_time_or_where_a_tendon_is_overstrained(scaled: Instrument) -> None:
    many = gym.TendonVectorEnv(scaled, 3, SHORT)
    many.reset(seed=2)
    still = np.zeros((3, 2), np.float32)
    for _ in range(99):
        *_, truncated, info = many.step(still)
        assert not truncated.any() and "final_obs" not in info
    observed, _, terminated, truncated, info = many.step(still)
    assert truncated.all() and not terminated.any()
    assert not observed.any() and np.any(info["final_obs"][0])
    wind = np.array([[1, 1], [0, 0], [0, 0]], np.float32)
    for _ in range(90):
        _, reward, terminated, *_ = many.step(wind)
        if terminated.any():
            break
    assert list(terminated) == [True, False, False] and reward[0] == -10


def test_what_makes_no_environment_is_refused(scaled: Instrument, real: Instrument) -> None:
    with refused("instruments"):
        gym.TendonVectorEnv(real)
    with refused("num_envs", 0):
        gym.TendonVectorEnv(scaled, 0)
    with refused("period", 7e-4):
        gym.TendonVectorEnv(scaled, 1, gym.Task(period=7e-4))
    with refused("tissue", 2.0):
        gym.Task(tissue=2.0)
    many = gym.TendonVectorEnv(scaled, 2)
    many.reset(seed=0)
    with refused("actions"):
        many.step(np.full((2, 2), np.nan, np.float32))
    assert gym.randomised(scaled, 1, tolerance.default(scaled))

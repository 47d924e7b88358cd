"""Environments for reinforcement learning: Gymnasium's rules, rewards from the twin, and what is refused."""

import warnings

import numpy as np
from gymnasium.utils.env_checker import check_env

from tenodesis import gym, statics, tolerance
from tenodesis.instrument import Instrument
from tenodesis.twin import run_many

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


def test_episodes_are_those_of_the_twin_and_the_reward_is_its_distance_from_a_rigid_instrument(
    scaled: Instrument,
) -> None:
    task = gym.Task(duration=0.5, move_time=0.1, tissue_stiffness=(50, 100), action_cost=0.0)
    many = gym.TendonVectorEnv([scaled, *gym.randomised(scaled, 4, seed=1)], 8, task)
    many.reset(seed=3)
    given = many.episodes()
    actions = np.random.default_rng(0).uniform(-0.05, 0.05, (99, 8, 2)).astype(np.float32)
    steps = [many.step(action) for action in actions]
    speed = scaled.drives.motor_speed / scaled.drives.gear_ratio
    wound = np.repeat(np.append(actions, actions[-1:], 0), 10, axis=0).swapaxes(0, 1) * speed
    assert np.ptp(given["force"]) > 1 and any(given["contact"]) and len(set(given["seeds"])) == 8
    batch = run_many(**given, spool_velocity=wound, signals=("output_angle", "handle_angle"), every=10)
    off = batch["output_angle"] - statics.output_angle(scaled, batch["handle_angle"])
    np.testing.assert_allclose(-np.degrees(np.abs(off[:, :-1])), np.transpose([step[1] for step in steps]), atol=1e-2)
    np.testing.assert_allclose(off[:, :-1].T, [step[4]["error"] for step in steps], atol=2e-4)
    assert np.abs(off).max() > np.radians(1)


def test_episodes_may_be_alike_for_policies_to_be_compared(scaled: Instrument) -> None:
    many = gym.TendonVectorEnv(gym.randomised(scaled, 4, seed=3), 6, SHORT)
    many.reset(seed=1, options={"alike": 3})
    for _ in range(60):
        observed, reward, *_ = many.step(np.zeros((6, 2), np.float32))
    assert np.unique(reward).size == np.unique(observed, axis=0).shape[0] == 2
    assert reward[0] == reward[2] != reward[3]
    with refused("alike", 4):
        many.reset(options={"alike": 4})


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


def test_drives_may_hold_tensions_instead(scaled: Instrument) -> None:
    task = gym.Task(drive="tension", tissue=0.0)
    many = gym.TendonVectorEnv(scaled, 4, task)
    many.reset(seed=3)
    for _ in range(200):
        observed, _, ended, _, _ = many.step(np.tile([0.2, 0.0], (4, 1)).astype(np.float32))
    assert not ended.any()
    expected = [0.2 * (many.tension_limit / scaled.pretension - 1), 0.0]
    np.testing.assert_allclose(observed[:, 1:3], np.tile(expected, (4, 1)), atol=0.02)
    with refused("drive", "torque"):
        gym.Task(drive="torque")  # type: ignore[arg-type]

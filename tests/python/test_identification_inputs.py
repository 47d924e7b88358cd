"""The motion of handle and spools from their quantised encoders."""

import numpy as np
import pytest

from tenodesis.identification.twin_model.steps import QuantisedSensor, smoothed, unrounded

from .twin_recordings import STEP


def test_rounding_is_taken_off_a_turning_spool() -> None:
    time = np.arange(0, 4, STEP)
    angle = 0.3 * np.clip(time - 1, 0, 1) - 0.1 * np.clip(time - 3, 0, 0.5)
    step = 2 * np.pi / 4096
    plain = np.round(angle / step) * step
    better = unrounded(plain, STEP, step).values
    moving = (time > 1.05) & (time < 1.95)
    assert np.abs(better - angle)[moving].max() < 0.15 * step
    assert np.abs(better - plain).max() <= 0.51 * step
    assert np.array_equal(unrounded(np.full(100, 3.0), STEP, step).values, np.full(100, 3.0))


@pytest.mark.parametrize("amplitude", [6.3, 6.7, 20.2])
def test_a_signal_turns_within_a_step_as_deep_as_its_acceleration_says(amplitude: float) -> None:
    time = np.arange(0, 2, STEP)
    signal = amplitude * np.sin(5.6 * time + 0.3)
    path = unrounded(np.round(signal), STEP, 1.0)
    inside = slice(300, -300)
    turning = (np.abs(signal) > amplitude - 0.5)[inside]
    off = (path.values - signal)[inside]
    # a path that turned in the middle of its step would be off by 0.13 to 0.2 steps
    assert np.sqrt(np.mean(off[turning] ** 2)) < 0.075
    known = np.zeros(time.size)
    for error in path.errors:
        known[error.first : error.first + error.shape.size] += error.shape**2
    assert np.sqrt(np.mean(off**2)) < np.sqrt(np.mean(known[inside]))


def test_smoothing_takes_noise_off_and_leaves_the_signal() -> None:
    time = np.arange(0, 8, STEP)
    angle = 0.4 * 2 / np.pi * np.arcsin(np.sin(np.pi * time))
    noise = 7e-4
    better = smoothed(
        angle + np.random.default_rng(0).normal(0, noise, time.size), STEP, QuantisedSensor(noise, 1e-9)
    ).values
    assert np.sqrt(np.mean((better - angle) ** 2)) < 0.2 * noise


def test_the_last_digit_of_a_clock_changes_no_reconstruction() -> None:
    angle = 0.4 * np.sin(np.arange(2000) * 4e-3) + np.random.default_rng(0).normal(0, 7e-4, 2000)
    one, other = (smoothed(angle, step, QuantisedSensor(7e-4, 1e-9)) for step in (4e-3, 4e-3 + 4e-18))
    assert len(one.errors) == len(other.errors)
    for a, b in zip(one.errors, other.errors, strict=True):
        assert a.first == b.first
        assert a.shape == pytest.approx(b.shape, abs=1e-12)


def test_a_smoothed_path_keeps_its_kinks_and_knows_how_well() -> None:
    time = np.arange(0, 4, STEP)
    angle = 0.4 * 2 / np.pi * np.arcsin(np.sin(np.pi * time))
    noise = 7e-4
    ratios = []
    for seed in range(4):
        path = smoothed(
            angle + np.random.default_rng(seed).normal(0, noise, time.size), STEP, QuantisedSensor(noise, 1e-9)
        )
        off = path.values - angle
        assert np.abs(off).max() < 4 * noise
        independent = np.zeros((time.size, len(path.errors)))
        for column, error in enumerate(path.errors):
            independent[error.first : error.first + error.shape.size, column] = error.shape
        expected = np.sum((independent @ path.mixing) ** 2)
        ratios.append(np.sum(off**2) / expected)
    assert 0.5 < np.mean(ratios) < 1.5


def test_a_handle_that_stops_does_not_turn_round_in_its_smoothed_path() -> None:
    time = 2e-3 * np.arange(1500)
    true = np.radians(15) * np.minimum(time, 1.0)
    sensor = QuantisedSensor(noise=5e-4, resolution=2 * np.pi / 2**12)
    for seed in range(4):
        noisy = true + sensor.noise * np.random.default_rng(seed).standard_normal(time.size)
        path = smoothed(np.round(noisy / sensor.resolution) * sensor.resolution, 2e-3, sensor).values
        near = np.abs(time - 1.0) < 0.05
        assert np.abs(path - true)[near].max() < 1.2 * sensor.deviation  # 1.5 to 2 with kinks of eleven samples

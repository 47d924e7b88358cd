"""The twin's sensors, drives and hand."""

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.instrument import Instrument
from tenodesis.twin import TIME_STEP, Twin

from .twin_motions import QUIET, clock, eased, same, settled, slack_force, smooth, with_friction


def test_sensors_read_multiples_of_their_converters_resolution(scaled: Instrument) -> None:
    inst = smooth(scaled)
    run = Twin(inst).run(eased(0.3, 0.5))
    sensors = inst.sensors
    for name, step in {
        "measured_handle_angle": sensors.encoder_range / 2**sensors.encoder_bits,
        "measured_output_angle": sensors.encoder_range / 2**sensors.encoder_bits,
        "measured_tension": 2 * sensors.load_cell_range / 2**sensors.load_cell_bits,
    }.items():
        counts = run.signals()[name] / step
        assert np.abs(counts - np.round(counts)).max() < 1e-9
        assert np.unique(np.round(counts)).size > 3


def test_without_noise_sensors_are_right_to_half_a_step(scaled: Instrument) -> None:
    inst = smooth(scaled).replace(**QUIET)
    run = Twin(inst).run(eased(0.3, 0.5), spool_velocity=[1.0, -0.5])
    for kind, step in {
        "handle_angle": inst.sensors.encoder_range / 2**inst.sensors.encoder_bits,
        "output_angle": inst.sensors.encoder_range / 2**inst.sensors.encoder_bits,
        "tension": 2 * inst.sensors.load_cell_range / 2**inst.sensors.load_cell_bits,
        "spool_angle": 2 * np.pi / inst.drives.encoder_counts / inst.drives.gear_ratio,
    }.items():
        signals = run.signals()
        assert np.abs(signals[f"measured_{kind}"] - signals[kind]).max() <= step / 2 * (1 + 1e-9)


def test_noise_is_as_large_as_it_is_said_to_be(scaled: Instrument) -> None:
    inst = smooth(scaled).replace(**{"sensors.encoder_bits": 24, "sensors.load_cell_bits": 32})
    run = Twin(inst, seed=3).run(np.zeros(40000))
    for kind, size in {
        "handle_angle": inst.sensors.encoder_noise,
        "output_angle": inst.sensors.encoder_noise,
        "tension": inst.sensors.load_cell_noise,
    }.items():
        noise = run.signals()[f"measured_{kind}"] - run.signals()[kind]
        assert noise.std(axis=0) == pytest.approx(size, rel=0.02)
        assert np.abs(noise.mean(axis=0)).max() < 4 * size / np.sqrt(40000)
        white = np.mean(noise[1:] * noise[:-1], axis=0) / noise.var(axis=0)
        assert np.abs(white).max() < 4 / np.sqrt(40000)


def test_the_same_seed_gives_the_same_bits_and_another_seed_other_noise(scaled: Instrument) -> None:
    inst = with_friction(scaled)
    handle_angle = eased(0.3, 0.5)
    one, again, other = (Twin(inst, seed=seed).run(handle_angle) for seed in (7, 7, 8))
    same(one, again)
    for name, values in one.signals().items():
        differs = name.startswith("measured") and "spool" not in name
        assert np.array_equal(values, other.signals()[name]) != differs, name


def test_samples_are_held_when_steps_are_finer(scaled: Instrument) -> None:
    inst = with_friction(scaled)
    run = Twin(inst, time_step=TIME_STEP / 8, seed=1).run(eased(0.3, 0.1, TIME_STEP / 8))
    for name in ("measured_handle_angle", "measured_output_angle", "measured_tension"):
        values = run.signals()[name]
        changes = np.flatnonzero(np.diff(values.reshape(values.shape[0], -1), axis=0).any(axis=1)) + 1
        assert changes.size > 100
        assert ((changes + 1) % 8 == 0).all()


def test_sensors_err_as_the_mismatch_says(scaled: Instrument) -> None:
    inst = smooth(scaled).replace(
        **QUIET,
        **{
            "mismatch.handle_encoder_offset": 0.02,
            "mismatch.output_encoder_offset": -0.03,
            "mismatch.load_cell_gain": (1.1, 0.9),
            "mismatch.load_cell_bias": (0.5, -0.7),
        },
    )
    run = Twin(inst).run(eased(0.3, 0.5))
    encoder = inst.sensors.encoder_range / 2**inst.sensors.encoder_bits / 2 * (1 + 1e-9)
    cell = inst.sensors.load_cell_range / 2**inst.sensors.load_cell_bits * (1 + 1e-9)
    assert np.abs(run.measured_handle_angle - run.handle_angle - 0.02).max() <= encoder
    assert np.abs(run.measured_output_angle - run.output_angle + 0.03).max() <= encoder
    assert np.abs(run.measured_tension - run.tension * [1.1, 0.9] - [0.5, -0.7]).max() <= cell


def test_a_load_cell_tells_no_more_than_its_range(scaled: Instrument) -> None:
    run = Twin(smooth(scaled).replace(**{"sensors.load_cell_range": 20.0})).run(np.zeros(10))
    assert run.measured_tension == pytest.approx(20)


def test_drives_keep_to_their_limits(scaled: Instrument) -> None:
    inst = smooth(scaled).replace(**{"drives.gear_ratio": 2.0})
    run = Twin(inst).run(np.zeros(1000), spool_velocity=[50.0, -50.0])
    velocity = run.spool_velocity
    assert velocity is not None and run.spool_angle is not None
    drives = inst.drives
    speed, acceleration = drives.motor_speed / drives.gear_ratio, drives.motor_acceleration / drives.gear_ratio
    assert np.abs(velocity).max() == pytest.approx(speed, rel=1e-9)
    rate = np.diff(velocity, axis=0, prepend=0) / TIME_STEP
    assert np.abs(rate).max() == pytest.approx(acceleration, rel=1e-9)
    assert np.allclose(np.diff(run.spool_angle, axis=0), (velocity[1:] + velocity[:-1]) / 2 * TIME_STEP, atol=1e-12)


def test_backlash_is_invisible_while_the_tendons_are_taut(scaled: Instrument) -> None:
    inst = with_friction(scaled).replace(**QUIET)
    t = clock(1.0)
    velocity = 0.5 * np.stack([np.sin(12 * t), -np.sin(9 * t)], -1)
    one, other = (
        Twin(inst.replace(**{"drives.backlash": play})).run(0.2 * np.sin(6 * t), spool_velocity=velocity)
        for play in (0.0, 0.05)
    )
    assert one.tension is not None and one.tension.min() > 0
    for name in ("output_angle", "tension", "spool_angle", "handle_torque"):
        assert np.abs(one.signals()[name] - other.signals()[name]).max() < 1e-9, name


# Hand


def test_a_very_stiff_hand_holds_the_handle_at_its_commanded_angle(scaled: Instrument) -> None:
    t = clock(1.0)
    wanted, force = 0.3 * np.sin(2 * np.pi * t) ** 3, 1.0 * np.sin(np.pi * t) ** 2
    for inst in (smooth(scaled), with_friction(scaled)):
        held = Twin(inst).run(wanted, force)
        apart = []
        for stiffness in (1e4, 9e5):
            hand = Twin(inst.replace(**{"dynamics.hand_stiffness": stiffness, "dynamics.hand_inertia": 1e-6}))
            run = hand.run(wanted, force)
            apart.append(np.abs(run.handle_angle - wanted).max())
            assert np.abs(run.output_angle - held.output_angle).max() < 30 * apart[-1]
            assert np.abs(run.handle_torque - held.handle_torque).max() < 0.02 * np.abs(held.handle_torque).max()
        assert apart[1] < 0.05 * apart[0] < 1e-4


def test_the_hand_feels_the_load_on_the_tip(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    torques = []
    for share in (0.0, 0.2, 0.4):
        twin = settled(Twin(inst), 0.0, 0.1)
        twin.run(np.zeros(1000), share * slack_force(inst) * np.minimum(1, clock(0.5) / 0.3))
        run = twin.run(eased(0.3, 0.5), share * slack_force(inst))
        torques.append(run.handle_torque[-1])
    assert torques[0] < torques[1] < torques[2]


def test_at_rest_hand_and_tendons_balance(any_inst: Instrument) -> None:
    inst = smooth(any_inst).replace(**{"dynamics.hand_stiffness": 10.0})
    force = 0.3 * slack_force(inst)
    twin = Twin(inst, quasi_static=True)
    twin.run(eased(0.25, 1.0), force * np.minimum(1, clock(1.0) / 0.3))
    run = twin.run([0.25, 0.25], force)
    angle, torque = run.handle_angle[-1], run.handle_torque[-1]
    rest = tn.statics.equilibrium(inst, angle, force)
    assert torque == pytest.approx(10.0 * (0.25 - angle), rel=1e-9)
    assert torque == pytest.approx((rest.agonist - rest.antagonist) * handle_arm(inst, angle), rel=1e-8)
    assert run.output_angle[-1] == pytest.approx(rest.output_angle, abs=1e-9)


def handle_arm(inst: Instrument, angle: float) -> float:
    """Moment arm of a tendon at the handle, m."""
    if inst.joint_type == "tendon-gear":
        return float(inst.proximal_gear_radius * np.cos(angle / 2))  # type: ignore[attr-defined]
    return float(inst.proximal_pulley_radius)  # type: ignore[attr-defined]


# State, steps, many runs

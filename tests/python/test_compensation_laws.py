"""What the laws give back, and what they cost: the paper's, the exact and the robust law on the twin."""

from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, OperatingState
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.twin import TIME_STEP, Twin

from .motions import clock, eased, load_of, with_friction
from .twin_motions import smooth


def row(time: float) -> int:
    return round(time / TIME_STEP) - 1


def target(inst: Instrument, handle: Array) -> Array:
    return np.asarray(tn.statics.unloaded_angle(inst, handle), float)


def missed(inst: Instrument, run: Run) -> Array:
    """What the tip has too much of its angle, deg."""
    return np.degrees(run["output_angle"] - target(inst, run["handle_angle"]))


def held(inst: Instrument, handle: float, force: Array, *, seed: int = 1, **options: Any) -> Run:
    """Bring the handle to an angle (deg) in 1.5 s, under a load over time."""
    total = len(force) * TIME_STEP
    controller = Controller(inst, **options)
    return Twin(inst, seed=seed).run(eased(np.radians(handle), 1.5, total), force, controller=controller)


def stepped(inst: Instrument, total: float, *, at: float = 4.0, until: float = np.inf, share: float = 0.37) -> Array:
    time = clock(total)
    return np.where((time > at) & (time <= until), load_of(inst, share), 0.0)


def test_exact_gives_all_back_of_a_slack_tendon(any_inst: Instrument) -> None:
    """Until the tendon that hangs is reported, 2 s after it went slack."""
    inst = smooth(any_inst).replace(**{"control.position_gain": 8.0})
    run = held(inst, 0, stepped(inst, 3.9, at=2, share=1.15), law="exact")
    assert run["tension"][row(2.5) :].min() == 0
    assert run["operating_state"][-1] == OperatingState.ENABLED
    assert abs(missed(inst, run)[-1]) < 0.5


# ---- the robust law


@pytest.mark.parametrize("handle", [-25, 0, 14, 25])
@pytest.mark.parametrize("sign", [-1, 1])
def test_robust_gives_the_angle_back_at_either_sign(any_inst: Instrument, handle: float, sign: int) -> None:
    inst = with_friction(any_inst)
    run = held(inst, handle, sign * stepped(inst, 10, share=0.3))
    off = held(inst, handle, sign * stepped(inst, 10, share=0.3), law="off")
    assert run["operating_state"][-1] == OperatingState.ENABLED
    assert abs(missed(inst, run)[-1]) < 0.6
    assert abs(missed(inst, run)[-1]) < 0.1 * abs(missed(inst, off)[-1]) + 0.1


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize("name", ["scaled", "real"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_robust_restores_the_angle_whatever_friction_it_assumes(
    name: str, sign: int, precision: Any, request: pytest.FixtureRequest
) -> None:
    nominal = with_friction(request.getfixturevalue(name))
    most = nominal.drives.motor_acceleration / nominal.drives.gear_ratio * TIME_STEP
    handle, force = eased(sign * 0.25, 1.5, 11), sign * stepped(nominal, 11, at=3, share=0.35)
    for scale in (0.7, 1.0, 1.43):
        inst = with_friction(nominal, scale)
        run = Twin(inst, seed=1).run(handle, force, controller=Controller(nominal, precision=precision))
        assert run["operating_state"].max() == OperatingState.ENABLED
        assert abs(missed(inst, run)[-1]) < 0.5
        estimated = run["estimated_output_angle"][-1] - run["output_angle"][-1]
        assert abs(estimated) < 3 * run["estimated_output_angle_std"][-1]
        assert np.abs(np.diff(run["commanded_spool_velocity"], axis=0)).max() <= most * (1 + 1e-5)


@pytest.mark.parametrize("handle", [0, 14, 25])
def test_robust_does_not_hunt(any_inst: Instrument, handle: float) -> None:
    inst = with_friction(any_inst)
    run = held(inst, handle, stepped(inst, 70))
    phase, sent = run["phase"][row(10) :], run["commanded_spool_velocity"][row(10) :]
    assert ((phase[1:] != 0) & (phase[:-1] == 0)).sum() <= 2
    moving = np.flatnonzero(np.concatenate([[True], sent.any(1), [True]]))
    assert np.diff(moving).max() * TIME_STEP >= 5
    tip = np.degrees(run["output_angle"][row(10) :])
    assert np.ptp(tip) < 0.5
    assert sent.any(1).mean() < 0.05


@pytest.mark.parametrize("scale", [0.7, 1.0, 1.43])
@pytest.mark.parametrize("handle", [0, 14, 28.5, 33.2])
def test_robust_is_at_rest_6_s_after_a_load_whatever_the_friction(
    scaled: Instrument, scale: float, handle: float
) -> None:
    nominal = with_friction(scaled, tendon_modulus=0.85 * 50e9)
    true = nominal.replace(**{"friction.vertex_coefficient": 0.1 * scale, "friction.sheath_coefficient": 0.1 * scale})
    for seed in (1, 2, 3):
        twin = Twin(true, seed=seed)
        run = twin.run(
            eased(np.radians(handle), 1.5, 16), stepped(true, 16, share=0.37), controller=Controller(nominal)
        )
        assert np.ptp(np.degrees(run["output_angle"][row(10) :])) < 0.5, seed
        assert abs(missed(true, run)[-1]) < 0.7, seed


def test_robust_keeps_still_at_rest_with_the_error_it_knows_within_two_dead_bands(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    run = held(inst, 14, stepped(inst, 12))
    at_rest = run["phase"] == 0
    assert at_rest[row(8) :].mean() > 0.9
    # A drive that was commanded to move slows down first.
    resting = at_rest & np.concatenate([np.zeros(200, bool), at_rest[:-200]])
    assert not run["commanded_spool_velocity"][resting & (run.time > 8)].any()
    known = np.degrees(run["estimated_output_angle"] - target(inst, run["measured_handle_angle"]))
    step = np.degrees(inst.sensors.encoder_range / 2**inst.sensors.encoder_bits)
    assert abs(np.median(known[row(11) :])) < 2 * np.degrees(inst.control.dead_band) + 2.5 * step


def test_mean_tension_does_not_grow_over_loads_put_on_and_off(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    for handle in (0, 14):
        time = clock(120)
        run = held(inst, handle, np.where(time % 4 > 2, load_of(inst, 0.37), 0.0), seed=5)
        cycles = run["tension"].mean(1).reshape(30, -1).mean(1)
        assert run["operating_state"].max() == OperatingState.ENABLED
        assert cycles[-5:].mean() < 1.1 * max(cycles[1:6].mean(), inst.pretension)
        # A stroke ends where the tip is on target: a cycle's mean scatters by a tenth of the pretension.
        assert cycles[15:].mean() < 1.05 * cycles[1:15].mean()
        assert cycles.max() < 1.4 * inst.pretension


def test_mean_tension_does_not_grow_over_cycles_of_the_handle(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    time = clock(200)
    handle = np.radians(13) * (1 - np.cos(2 * np.pi * 0.25 * time))
    run = Twin(inst, seed=7).run(handle, load_of(inst, 0.3), controller=Controller(inst))
    cycles = run["tension"].mean(1).reshape(50, -1).mean(1)
    assert run["operating_state"].max() == OperatingState.ENABLED
    assert cycles[-5:].mean() < 1.2 * cycles[1:6].mean()
    assert cycles.max() < 1.4 * inst.pretension


@pytest.mark.parametrize("handle", [0, 25])
def test_no_tendon_is_wound_beyond_the_limit(any_inst: Instrument, handle: float) -> None:
    """The load alone stays below it; for 0.1 s after the load fell, its oscillation may add to what the motors wind."""
    inst = with_friction(any_inst)
    force = stepped(inst, 14, share=0.45)
    alone = held(inst, handle, force, law="off")["tension"]
    limit = max(1.02 * alone.max(), 1.8 * inst.pretension)
    run = held(inst.replace(**{"control.tension_limit": limit}), handle, force)
    assert run["operating_state"].max() == OperatingState.ENABLED
    oscillating = np.abs(run.time - 4.05) < 0.05
    assert run["tension"][~oscillating].max() <= 1.02 * limit
    assert run["tension"].max() <= 1.06 * limit
    above = run["measured_tension"][:-1] > limit + 5 * inst.sensors.load_cell_noise
    assert (run["commanded_spool_velocity"][1:][above & ~oscillating[1:, np.newaxis]] <= 0).all()


def test_at_the_limit_strokes_do_not_turn_back_at_every_tick(scaled: Instrument) -> None:
    """Between a tendon at its limit and one about to hang no stroke is left."""
    inst = with_friction(scaled)
    run = held(inst.replace(**{"control.tension_limit": 50.0}), 25, stepped(inst, 20, share=0.8))
    assert run["operating_state"].max() == OperatingState.ENABLED
    last = run["phase"][row(10) :]
    assert (last[1:] != last[:-1]).sum() < 10 * 20


@pytest.mark.parametrize("share", [0.9, 1.0, 1.1])
def test_what_is_known_of_friction_survives_a_load_at_the_slack_limit(scaled: Instrument, share: float) -> None:
    inst = with_friction(scaled)
    for handle in (14, 33.2):
        for seed in (1, 2):
            run = held(inst, handle, stepped(inst, 14, share=share), seed=seed)
            off = abs(run["friction_scale"][-1] - 1)
            assert off < 3 * run["friction_scale_std"][-1], (handle, seed)
            wrong = abs(run["estimated_output_angle"][-1] - run["output_angle"][-1])
            assert wrong < 3 * run["estimated_output_angle_std"][-1], (handle, seed)


def test_both_tendons_keep_tight_at_rest(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    run = held(inst, 14, stepped(inst, 12, share=0.6))
    assert run["operating_state"].max() == OperatingState.ENABLED
    assert run["tension"][row(8) :].min() > 0.05 * inst.pretension


@pytest.mark.parametrize("handle", [0, 14, 25])
def test_a_load_taken_off_lets_the_tip_return_within_3_s(any_inst: Instrument, handle: float) -> None:
    inst = with_friction(any_inst)
    run = held(inst, handle, stepped(inst, 14, until=9))
    assert np.abs(missed(inst, run)[row(12) :]).max() < 1


def test_a_handle_moved_under_load_is_followed(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    time = clock(20)
    handle = np.radians(13) * (1 - np.cos(2 * np.pi * 0.25 * time))
    force = np.where(time > 2, load_of(inst, 0.3), 0.0)
    rms = {}
    for law in ("off", "robust"):
        run = Twin(inst, seed=2).run(handle, force, controller=Controller(inst, law=law))
        rms[law] = float(np.sqrt(np.mean(missed(inst, run)[row(8) :] ** 2)))
    assert rms["robust"] < rms["off"] / 5


@pytest.mark.parametrize("law", ["paper", "exact", "robust"])
def test_one_motor_is_one_motor(any_inst: Instrument, law: Any) -> None:
    inst = with_friction(any_inst)
    run = held(inst, 14, stepped(inst, 8), law=law, actuation="agonist")
    sent = run["commanded_spool_velocity"]
    assert sent[:, 0].any()
    assert not sent[:, 1].any()
    assert not run["spool_angle"][:, 1].any()


@pytest.mark.parametrize("handle", [0, 14, 25])
def test_one_motor_lets_no_tendon_go_slack(any_inst: Instrument, handle: float) -> None:
    """Against a load that the antagonist bears the agonist can only give way, and not past its least tension."""
    inst = with_friction(any_inst)
    run = held(inst, -handle, -stepped(inst, 10), actuation="agonist")
    off = held(inst, -handle, -stepped(inst, 10), law="off")
    assert run["operating_state"].max() == OperatingState.ENABLED
    assert abs(missed(inst, run)[-1]) < abs(missed(inst, off)[-1])


@pytest.mark.parametrize("rate", [500.0, 1000.0, 10000.0])
def test_robust_needs_no_particular_rate(scaled: Instrument, rate: float) -> None:
    inst = with_friction(scaled, **{"sensors.sampling_rate": rate})
    step = min(TIME_STEP, 1 / rate)
    time = np.arange(1, round(10 / step) + 1) * step
    share = np.clip(time / 1.5, 0, 1)
    handle = np.radians(25) * share**3 * (10 - 15 * share + 6 * share**2)
    force = np.where(time > 4, load_of(inst, 0.3), 0.0)
    run = Twin(inst, seed=1, time_step=step).run(handle, force, controller=Controller(inst))
    assert run["operating_state"].max() == OperatingState.ENABLED
    assert abs(missed(inst, run)[-1]) < 0.5

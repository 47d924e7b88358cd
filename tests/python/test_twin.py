"""The digital twin against the statics, MuJoCo, its own energy balance and the law of friction."""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import tenodesis as tn
from tenodesis.errors import ArgumentError, InstrumentError, NoSolutionError
from tenodesis.instrument import Instrument
from tenodesis.plant import natural_frequency
from tenodesis.run import SIGNALS, Run
from tenodesis.twin import TIME_STEP, Twin, run_many
from tenodesis.verification import mujoco_dynamics

from .conftest import refused

Array = NDArray[np.float64]
LAWS: dict[str, dict[str, Any]] = {
    "capstan": {"law": "capstan"},
    "constant": {"law": "capstan-constant", "constant": 0.2},
    "stribeck": {"law": "stribeck", "constant": 0.2, "static_ratio": 1.5},
    "viscous": {"law": "capstan", "viscous": 20.0},
}
QUIET = {"sensors.encoder_noise": 0.0, "sensors.load_cell_noise": 0.0}


def alone(inst: Instrument) -> Instrument:
    return inst.axis("yaw") if len(inst.axes) > 1 else inst


def smooth(inst: Instrument) -> Instrument:
    """The first axis without friction, as its file says it is."""
    return alone(inst).replace(friction=None, mismatch=None)


def rubbed(inst: Instrument, law: str = "capstan", **friction: Any) -> Instrument:
    """The first axis with friction at all contacts."""
    table = {"vertex_coefficient": 0.3, "sheath_coefficient": 0.15, "sheath_bend": 1.0} | LAWS[law] | friction
    return smooth(inst).replace(**{f"friction.{key}": value for key, value in table.items()})


def slack_force(inst: Instrument) -> float:
    return float(tn.statics.slack_force(inst, 0.0))


def handle(inst: Instrument, output_angle: float) -> float:
    return float(tn.statics.handle_angle(inst, output_angle))


def clock(duration: float, time_step: float = TIME_STEP) -> Array:
    return np.arange(1, round(duration / time_step) + 1) * time_step


def eased(to: float, duration: float, time_step: float = TIME_STEP) -> Array:
    """A command that leaves zero and arrives with zero velocity."""
    return to * (1 - np.cos(np.pi * clock(duration, time_step) / duration)) / 2


def settled(twin: Twin, handle_angle: float, duration: float = 2.5) -> Twin:
    """Move the handle there and wait until the tip rests."""
    twin.run(eased(handle_angle, 0.4, twin.time_step))
    twin.run(np.full(round(duration / twin.time_step), handle_angle))
    return twin


def same(one: Run, other: Run) -> None:
    for name, values in one.signals().items():
        np.testing.assert_array_equal(values, other.signals()[name], err_msg=name)


# Statics


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("winding", [0.0, 0.4], ids=["motors still", "motors winding"])
def test_at_rest_without_friction_it_is_the_statics_to_rounding(
    any_inst: Instrument, sign: int, winding: float
) -> None:
    inst = smooth(any_inst)
    t = np.linspace(0, 1, 8000)
    handle_angle = sign * 0.9 * handle(inst, inst.output_range) * np.sin(9 * t)
    force = -sign * 1.2 * slack_force(inst) * np.cos(9 * t + 1.2) * np.minimum(1, 20 * t)
    velocity = winding * np.stack([np.sin(40 * t), -np.cos(33 * t)], -1)
    run = Twin(inst, quasi_static=True).run(handle_angle, force, spool_velocity=velocity)
    wound = run.spool_angle * inst.drives.spool_radius
    rest = tn.statics.equilibrium(inst, handle_angle, force, wound=(wound[:, 0], wound[:, 1]))
    tension = np.stack([rest.agonist, rest.antagonist], -1)
    assert (tension == 0).any(axis=0).all()
    assert np.abs(run.output_angle - rest.output_angle).max() < 1e-9
    for tension_of_run in (run.tension, run.distal_tension):
        assert np.abs(tension_of_run - tension).max() < 1e-9 * inst.pretension


def test_a_jump_at_rest_ends_where_the_statics_says(real: Instrument) -> None:
    inst = smooth(real)
    run = Twin(inst, quasi_static=True).run([-0.5794], [0.2308])
    rest = tn.statics.equilibrium(inst, [-0.5794], [0.2308])
    # The least drag of tendon.hpp, over the millimetres that slip in this one step.
    assert run.output_angle == pytest.approx(rest.output_angle, abs=1e-8)
    assert run.distal_tension[0] == pytest.approx([rest.agonist[0], rest.antagonist[0]], abs=1e-6)


def test_moved_slowly_it_tends_to_the_statics(any_inst: Instrument) -> None:
    inst = smooth(any_inst)
    goal = handle(inst, 0.8)
    off = []
    for duration in (1.0, 2.0):
        t = clock(duration)
        force = 0.3 * slack_force(inst) * np.sin(np.pi * t / duration) ** 2
        handle_angle = eased(goal, duration)
        run = Twin(inst).run(handle_angle, force)
        off.append(np.abs(run.output_angle - tn.statics.output_angle(inst, handle_angle, force)).max())
    assert off[1] < 0.6 * off[0] < 0.1


@pytest.mark.parametrize("share", [-1.3, -0.5, 0.0, 0.5, 1.3])
def test_left_alone_it_comes_to_rest_where_the_statics_says(any_inst: Instrument, share: float) -> None:
    inst = smooth(any_inst)
    force, handle_angle = share * slack_force(inst), float(np.copysign(0.1, share))  # away from the fold
    twin = Twin(inst)
    twin.run(np.full(4000, handle_angle), force * np.minimum(1, clock(2.0) / 0.5))
    run = twin.run(np.full(8000, handle_angle), force)
    rest = tn.statics.equilibrium(inst, handle_angle, force)
    assert run.output_angle[-1] == pytest.approx(float(rest.output_angle), abs=1e-9)
    assert run.tension[-1] == pytest.approx([float(rest.agonist), float(rest.antagonist)], abs=1e-7)
    assert abs(run.output_velocity[-1]) < 1e-9


# Energy


def worked(inst: Instrument, kind: str, time_step: float) -> tuple[Twin, dict[str, Array]]:
    """A twin and commands that do all kinds of work on it."""
    t = clock(2.0, time_step)
    once = np.sin(np.pi * t / 2) ** 2
    command = {
        "handle_angle": 0.6 * handle(inst, inst.output_range) * np.sin(np.pi * t) ** 3,
        "force": 0.3 * slack_force(inst) * once,
    }
    if kind == "step load":
        command["force"] = np.where((t > 0.7) & (t < 1.4), 0.3, 0.0) * slack_force(inst)
    if kind == "slack":
        command = {"handle_angle": 0.2 * command["handle_angle"], "force": 4 * command["force"]}
    if kind == "rig":
        inst = inst.replace(**{"conditions.cable_pulley_radius": 0.015})
        command["weight"] = command.pop("force") * inst.rig_arm / 0.015
    if kind == "motors":
        command["spool_velocity"] = np.stack([np.sin(np.pi * t), -np.sin(np.pi * t)], -1)
    if kind == "hand":
        inst = inst.replace(**{"dynamics.hand_stiffness": 20.0})
    return Twin(inst, time_step=time_step), command


WORK = ["smooth", "step load", "slack", "rig", "motors", "hand"]


MECHANISMS = ["real", "scaled", "pulley", "continuum"]


# Pairs: every kind of work with every law, and each of both with every mechanism.
@pytest.mark.parametrize(
    ("name", "law", "kind"),
    [(MECHANISMS[(n + m) % 4], law, kind) for n, kind in enumerate(WORK) for m, law in enumerate([None, *LAWS])],
)
def test_the_energy_balance_closes(request: pytest.FixtureRequest, name: str, law: str | None, kind: str) -> None:
    inst = request.getfixturevalue(name)
    twin, command = worked(rubbed(inst, law) if law else smooth(inst), kind, TIME_STEP)
    energy = twin.energy(**command)
    assert abs(energy.unaccounted) < 1e-3 * energy.work
    assert energy.work > 0
    assert energy.damping >= 0
    if law:
        assert energy.friction > 0.1 * energy.work
        assert energy.least_friction >= -1e-15 * energy.work  # rounding
    assert energy.residual < 1e-9


@pytest.mark.parametrize("kind", ["smooth", "step load", "rig", "motors", "hand"])
@pytest.mark.parametrize("law", [None, "capstan", "stribeck"])
def test_the_energy_balance_is_of_second_order(scaled: Instrument, law: str | None, kind: str) -> None:
    left = []
    for time_step in (TIME_STEP, TIME_STEP / 2, TIME_STEP / 4):
        twin, command = worked(rubbed(scaled, law) if law else smooth(scaled), kind, time_step)
        energy = twin.energy(**command)
        left.append(abs(energy.unaccounted) / energy.work)
    order = np.log2(np.array(left[:-1]) / left[1:])
    assert (order > 1.8).all() and (order < 2.3).all()


def test_slack_and_stops_leave_less_of_the_energy_over_with_smaller_steps(scaled: Instrument) -> None:
    left = []
    for time_step in (TIME_STEP, TIME_STEP / 4, TIME_STEP / 16):
        twin, command = worked(rubbed(scaled), "slack", time_step)
        energy = twin.energy(**command)
        left.append(abs(energy.unaccounted) / energy.work)
    assert left[0] > 3 * left[1] > 9 * left[2]


@pytest.mark.parametrize("contacts", [1, 4, 16])
@pytest.mark.parametrize("law", LAWS)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_friction_never_gives_energy_back_in_smooth_motion(law: str, contacts: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    inst = rubbed(tn.load(random.choice(["real-size", "scaled-up"])), law, sheath_contacts=contacts)
    t = clock(0.5)
    wave = [sum(random.normal() * np.sin(random.uniform(1, 25) * t) for _ in range(3)) / 3 for _ in range(2)]
    energy = Twin(inst).energy(0.3 * np.tanh(wave[0]), 0.4 * slack_force(inst) * np.tanh(wave[1]))
    assert energy.friction >= 0
    assert energy.least_friction >= -1e-15 * energy.work  # rounding
    assert energy.residual < 1e-9
    assert energy.sweeps <= 96 + 16 * (inst.friction.sheath_contacts + 2)


@pytest.mark.parametrize("law", LAWS)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_friction_takes_energy_and_keeps_its_law_in_jumpy_motion(law: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    inst = rubbed(tn.load(random.choice(["real-size", "scaled-up"])), law)
    handle_angle = np.repeat(random.uniform(-0.3, 0.3, 20), 30)
    force = np.repeat(random.uniform(-0.4, 0.4, 20), 30) * slack_force(inst)
    energy = Twin(inst).energy(handle_angle, force)
    assert energy.friction > 0
    assert energy.residual < 1e-9
    assert energy.sweeps <= 96 + 16 * (inst.friction.sheath_contacts + 2)


# Friction


def cycle(inst: Instrument, cycles: int = 2, period: float = 2.0) -> tuple[Run, Array]:
    """The last of some handle cycles, and where in it the handle flexes."""
    t = clock(cycles * period)
    handle_angle = 0.7 * handle(inst, inst.output_range) * np.sin(2 * np.pi * t / period)
    last = round((cycles - 1) * period / TIME_STEP)
    twin = Twin(inst)
    twin.run(handle_angle[:last])
    return twin.run(handle_angle[last:]), np.gradient(handle_angle[last:]) > 0


def test_friction_widens_the_loop_that_costs_the_hand_work(any_inst: Instrument) -> None:
    work, lag = [], []
    for inst in (smooth(any_inst), rubbed(any_inst, vertex_coefficient=0.1), rubbed(any_inst)):
        run, _ = cycle(inst)
        work.append(np.trapezoid(run.handle_torque, run.handle_angle))
        lag.append(-np.trapezoid(run.output_angle, run.handle_angle))
    assert 0 < work[0] < work[1] < work[2]
    assert 0 < lag[0] < lag[1] < lag[2]


def test_the_agonist_is_tighter_in_flexion_and_the_antagonist_in_extension(any_inst: Instrument) -> None:
    run, flexing = cycle(rubbed(any_inst))
    for share in (-0.5, 0.0, 0.5):
        near = np.abs(run.handle_angle - share * run.handle_angle.max()) < 0.02 * run.handle_angle.max()
        flexion, extension = (run.tension[near & way].mean(axis=0) for way in (flexing, ~flexing))
        assert flexion[0] > extension[0] and flexion[1] < extension[1]
        assert run.output_angle[near & flexing].mean() < run.output_angle[near & ~flexing].mean()


def test_a_small_reversal_at_the_handle_does_not_reach_the_tip(any_inst: Instrument) -> None:
    inst = rubbed(any_inst)
    twin = settled(Twin(inst), 0.3)
    run = twin.run(0.3 - eased(1e-3, 0.4))
    free = settled(Twin(smooth(any_inst)), 0.3).run(0.3 - eased(1e-3, 0.4))
    assert np.ptp(run.output_angle) < 0.35 * np.ptp(free.output_angle)


def test_a_tendon_slackens_and_tautens_without_chatter(any_inst: Instrument) -> None:
    inst = rubbed(any_inst)
    t = clock(4.0)
    run = Twin(inst).run(np.zeros(t.size), -1.8 * slack_force(inst) * np.sin(np.pi * t / 4) ** 2)
    slack = (run.distal_tension == 0).any(axis=1)
    assert slack.any() and not slack[-1]
    assert np.count_nonzero(np.diff(slack.astype(int))) == 2


def test_with_motors_let_out_both_tendons_hang_slack_and_wound_again_they_are_as_before(any_inst: Instrument) -> None:
    inst = smooth(any_inst)
    twin = Twin(inst)
    loose = twin.loosen(2 * inst.pretension / inst.tendon_stiffness)
    assert (loose.tension[-1] == 0).all()
    speed = -loose.commanded_spool_velocity
    again = twin.run(np.zeros(len(loose)), spool_velocity=speed)
    assert again.tension[-1] == pytest.approx([inst.pretension] * 2, rel=1e-6)
    assert again.spool_angle[-1] == pytest.approx([0, 0], abs=1e-6)  # what drives still coast


@pytest.mark.parametrize("quasi_static", [False, True], ids=["moving", "at rest"])
@pytest.mark.parametrize("contacts", [1, 4, 16])
def test_wound_slack_and_taut_again_the_tendons_keep_the_law(
    any_inst: Instrument, contacts: int, quasi_static: bool
) -> None:
    inst = rubbed(any_inst, sheath_contacts=contacts)
    t = clock(1.2)
    # Out by twice what the pretension stretches, and back, both and then each in turn.
    out = 2 * inst.pretension / inst.tendon_stiffness / inst.drives.spool_radius
    speed = -np.pi / 0.4 * out * np.sin(2 * np.pi * t / 0.4)
    velocity = np.stack([np.where(t < 0.8, speed, 0), np.where((t < 0.4) | (t > 0.8), speed, 0)], -1)
    command = {"handle_angle": 0.2 * np.sin(12 * t), "spool_velocity": velocity}
    run = Twin(inst, quasi_static=quasi_static).run(**command)
    slack = run.tension == 0
    assert slack.all(axis=1).any() and slack.any(axis=0).all()
    assert (run.tension[-1] > 0.5 * inst.pretension).all()
    energy = Twin(inst, quasi_static=quasi_static).energy(**command)
    assert energy.residual < 1e-9
    assert energy.friction > 0


def test_constant_friction_does_not_grow_with_the_sheaths_contacts(scaled: Instrument) -> None:
    tips = [cycle(rubbed(scaled, "constant", constant=3.0, sheath_contacts=2**n), 1)[0].output_angle for n in range(5)]
    free = cycle(rubbed(scaled, "capstan"), 1)[0].output_angle
    apart = [np.abs(one - other).max() for one, other in itertools.pairwise(tips)]
    assert all(finer < 0.75 * coarser for coarser, finer in itertools.pairwise(apart))
    assert np.abs(tips[-1] - tips[0]).max() < 0.1 * np.abs(tips[0] - free).max()


def test_more_sheath_contacts_converge(scaled: Instrument) -> None:
    tips = [cycle(rubbed(scaled, sheath_contacts=2**n), 1)[0].output_angle for n in range(6)]
    apart = [np.abs(one - other).max() for one, other in itertools.pairwise(tips)]
    assert all(finer < 0.75 * coarser for coarser, finer in itertools.pairwise(apart))
    assert apart[-1] < np.radians(0.05)


@pytest.mark.parametrize("law", LAWS)
def test_finer_steps_converge(scaled: Instrument, law: str) -> None:
    inst = rubbed(scaled, law)
    tips = []
    for times in (4, 16, 64):
        t = clock(2.0, TIME_STEP / times)
        tips.append(Twin(inst, time_step=TIME_STEP / times).run(0.3 * np.sin(np.pi * t) ** 3).output_angle)
    coarse, fine = np.abs(tips[0] - tips[1][3::4]).max(), np.abs(tips[1] - tips[2][3::4]).max()
    assert fine < 0.5 * coarse < np.radians(0.05)


# MuJoCo


def refined(values: Array, times: int) -> Array:
    """The same command, linear in time, at a fraction of the time step."""
    fine = np.arange(1, times * values.size + 1) / times
    return np.interp(fine, np.arange(values.size + 1), np.concatenate([values[:1], values]))


def three_ways(inst: Instrument, handle_angle: Array, force: Array) -> list[Array]:
    """The tip by the twin, by the twin at a sixteenth of its step, and by MuJoCo, in degrees."""
    start = float(handle_angle[0])
    tips = []
    for times in (1, 16):
        twin = settled(Twin(inst, time_step=TIME_STEP / times), start)
        run = twin.run(refined(handle_angle, times), refined(force, times))
        assert run.output_angle is not None
        tips.append(run.output_angle[times - 1 :: times])
    dynamics = inst.dynamics
    assert dynamics.tip_inertia is not None and dynamics.tip_damping is not None
    motion = mujoco_dynamics.simulate(
        inst, handle_angle, force, TIME_STEP, inertia=dynamics.tip_inertia, damping=dynamics.tip_damping, substeps=4
    )
    return [np.degrees(tip) for tip in (*tips, motion.output_angle)]


@pytest.mark.parametrize("output", [0, 33, 67])
@pytest.mark.parametrize(("name", "force", "own"), [("real", 0.52, 0.015), ("scaled", 1.5, 8e-4)])
def test_under_a_step_load_it_moves_as_in_mujoco(
    request: pytest.FixtureRequest, name: str, force: float, own: float, output: int
) -> None:
    inst = smooth(request.getfixturevalue(name))
    t = clock(0.5)
    twin, fine, peer = three_ways(
        inst, np.full(t.size, handle(inst, np.radians(output))), np.where(t > 0.1, force, 0.0)
    )
    assert np.ptp(peer) > 5
    assert np.abs(twin - peer).max() < 0.1
    assert np.abs(fine - peer).max() < 1e-4
    assert np.abs(twin - fine).max() < own  # what a step of 0.5 ms is wrong by


@pytest.mark.parametrize(("name", "force"), [("real", 0.52), ("scaled", 1.5)])
def test_through_a_loaded_cycle_it_moves_as_in_mujoco(request: pytest.FixtureRequest, name: str, force: float) -> None:
    inst = smooth(request.getfixturevalue(name))
    t = clock(2.0) - TIME_STEP
    handle_angle = handle(inst, np.radians(67)) * np.sin(np.pi * t) ** 3
    twin, fine, peer = three_ways(inst, handle_angle, 0.5 * force * (1 - np.cos(2 * np.pi * t)))
    assert peer.max() > 50 and peer.min() < -50
    assert np.abs(twin - peer).max() < 1e-3
    assert np.abs(fine - peer).max() < 1e-5


# Sensors and drives


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
    inst = rubbed(scaled)
    handle_angle = eased(0.3, 0.5)
    one, again, other = (Twin(inst, seed=seed).run(handle_angle) for seed in (7, 7, 8))
    same(one, again)
    for name, values in one.signals().items():
        differs = name.startswith("measured") and "spool" not in name
        assert np.array_equal(values, other.signals()[name]) != differs, name


def test_samples_are_held_when_steps_are_finer(scaled: Instrument) -> None:
    inst = rubbed(scaled)
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
    inst = rubbed(scaled).replace(**QUIET)
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
    for inst in (smooth(scaled), rubbed(scaled)):
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
    inst = rubbed(any_inst)
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


def test_a_state_set_again_repeats_the_run_bit_by_bit(any_inst: Instrument) -> None:
    twin = Twin(rubbed(any_inst, "stribeck", sheath_contacts=4), seed=5)
    twin.run(eased(0.3, 0.3), spool_velocity=[0.2, -0.1])
    kept = twin.state
    t = clock(0.3)
    command = {"handle_angle": 0.3 * np.cos(9 * t), "force": 0.4 * np.sin(8 * t)}
    first = twin.run(**command)
    twin.run(np.zeros(100))
    twin.state = kept
    assert twin.time == pytest.approx(0.3)
    again = twin.run(**command)
    same(first, again)
    np.testing.assert_array_equal(first.time, again.time)
    fresh = Twin(twin.inst, seed=99)
    fresh.state = kept
    same(first, fresh.run(**command))


def test_in_pieces_or_step_by_step_it_is_the_run_in_one(real: Instrument) -> None:
    t = clock(0.2)
    handle_angle = np.stack([0.2 * np.sin(9 * t), 0.1 * np.sin(5 * t)], -1)
    force = np.stack([0.2 * np.sin(20 * t), 0.1 * t], -1)
    velocity = np.stack([[[0.1, -0.1], [0.2, 0.0]]] * t.size)
    at_once = Twin(real, seed=4).run(handle_angle, force, spool_velocity=velocity)
    pieces, steps = Twin(real, seed=4), Twin(real, seed=4)
    cut = [0, 1, 7, 130, t.size]
    parts = [
        pieces.run(handle_angle[a:b], force[a:b], spool_velocity=velocity[a:b]) for a, b in itertools.pairwise(cut)
    ]
    singles = [steps.step(handle_angle[k], force[k], spool_velocity=velocity[k]) for k in range(t.size)]
    for name, values in at_once.signals().items():
        assert SIGNALS[name].per_tendon == (values.ndim == 3)
        np.testing.assert_array_equal(values, np.concatenate([part.signals()[name] for part in parts]))
        np.testing.assert_array_equal(values, np.stack([single.signals()[name] for single in singles]))
    assert [float(single.time) for single in singles] == pytest.approx(at_once.time)


def test_each_axis_is_a_twin_of_its_own(real: Instrument) -> None:
    t = clock(0.3)
    handle_angle = np.stack([0.2 * np.sin(9 * t), 0.15 * np.sin(5 * t)], -1)
    force = np.stack([0.3 * np.sin(20 * t), 0.2 * t], -1)
    both = Twin(real).run(handle_angle, force)
    assert both.axes == ("yaw", "pitch")
    for n, name in enumerate(both.axes):
        one = Twin(real.axis(name)).run(handle_angle[:, n], force[:, n])
        for signal, values in one.signals().items():
            if not signal.startswith("measured"):
                np.testing.assert_array_equal(both.signals()[signal][:, n], values)
    noise = both.measured_handle_angle - both.handle_angle
    assert not np.array_equal(noise[:, 0], noise[:, 1])
    shared = Twin(real).run(handle_angle, force[:, 0])
    np.testing.assert_array_equal(shared.force[:, 1], force[:, 0])


@pytest.fixture
def threads() -> Iterator[None]:
    before = tn.threads.threads()
    yield
    tn.set_threads(before)


@pytest.mark.usefixtures("threads")
def test_many_runs_are_the_single_ones_whatever_the_threads(any_inst: Instrument) -> None:
    inst = rubbed(any_inst)
    runs, t = 7, clock(0.2)
    vary = {
        "pretension": np.linspace(15, 30, runs),
        "friction.vertex_coefficient": np.linspace(0, 0.4, runs),
        "mismatch.stiffness_ratio": np.linspace(0.8, 1.2, runs),
    }
    handle_angle = np.linspace(0.05, 0.3, runs)[:, None] * np.sin(20 * t)
    force = 0.3 * slack_force(inst) * np.sin(9 * t)
    velocity = np.linspace(0, 1, runs)[:, None, None] * np.stack([np.sin(30 * t), np.cos(30 * t)], -1)
    signals = ("output_angle", "tension.antagonist", "measured_tension.agonist", "handle_torque")
    seeds = np.arange(runs) * 11
    batches = []
    for count in (1, 2, 3):
        tn.set_threads(count)
        batches.append(
            run_many(
                inst, handle_angle, force, spool_velocity=velocity, vary=vary, seeds=seeds, signals=signals, every=4
            )
        )
    for batch in batches:
        assert (batch.steps == t.size).all() and (batch.status == 0).all()
        np.testing.assert_allclose(batch.time, t[3::4], rtol=1e-12)
        for name in signals:
            np.testing.assert_array_equal(batch[name], batches[0][name])
    for n in range(runs):
        own = inst.replace(**{key: float(values[n]) for key, values in vary.items()})
        run = Twin(own, seed=int(seeds[n])).run(handle_angle[n], force, spool_velocity=velocity[n])
        for name in signals:
            kind, _, side = name.partition(".")
            values = run.signals()[kind]
            values = values[:, ["agonist", "antagonist"].index(side)] if side else values
            np.testing.assert_array_equal(batches[0][name][n], values[3::4])


def test_a_lost_run_is_reported_and_leaves_the_others_alone(scaled: Instrument) -> None:
    inst = smooth(scaled)
    force = np.outer([0.0, 40.0, 1.0], np.linspace(0, 1, 400))
    batch = run_many(inst, np.zeros(400), force, quasi_static=True)
    lost = int(batch.steps[1])
    assert list(batch.status != 0) == [False, True, False]
    assert 0 < lost < 400
    assert np.isfinite(batch["output_angle"][1, :lost]).all() and np.isnan(batch["output_angle"][1, lost:]).all()
    assert np.isfinite(batch["output_angle"][[0, 2]]).all()


# Bad input


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"friction.vertex_coefficient": -0.1}, r"friction\.vertex_coefficient = -0\.1: .*greater than or equal to 0"),
        ({"friction.law": "coulomb"}, "friction.law = 'coulomb': it must be 'none', 'capstan'"),
        ({"breaking_load": 20.0}, "pretension is 25 N, at which a tendon of 20 N breaking_load has broken"),
        ({"friction.sheath_contacts": 33}, "friction.sheath_contacts = 33: .*less than or equal to 32"),
        ({"sensors.encoder_bits": 3}, "sensors.encoder_bits = 3"),
        ({"dynamics.tip_inertia": 0.0}, "dynamics.tip_inertia = 0"),
    ],
)
def test_an_instrument_that_cannot_be_is_refused(scaled: Instrument, changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(InstrumentError, match=sentence):
        scaled.replace(**changes)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("time_step", value) for value in (0.1, 3e-4, -1.0, float("nan"))),
        *(("seed", value) for value in (-1, 2**64, 1.5, True)),
    ],
)
def test_a_twin_that_cannot_be_is_refused(scaled: Instrument, key: str, value: Any) -> None:
    with refused(key, value):
        Twin(scaled, **{key: value})


@pytest.mark.parametrize(
    ("time_step", "sentence"),
    [
        (0.1, r"^time_step is 0\.1 s; it must be at most 0\.00881 s, a twelfth of a period of the tip of scaled-up"),
        (3e-4, r"^time_step is 0\.0003 s; it must be an integer fraction of the sampling period of 0\.0005 s, or more"),
    ],
)
def test_a_time_step_that_cannot_be_is_said_in_a_sentence(scaled: Instrument, time_step: float, sentence: str) -> None:
    with pytest.raises(ArgumentError, match=sentence):
        Twin(scaled, time_step=time_step)


def test_the_largest_time_step_is_said_and_taken(any_inst: Instrument) -> None:
    inst = smooth(any_inst)
    longest = 0.5 / natural_frequency(inst)
    with refused("time_step"):
        Twin(inst, time_step=longest * 1.001)
    run = Twin(inst, time_step=longest * 0.999).run(np.full(2000, 0.2))
    assert run.output_angle[-1] == pytest.approx(tn.statics.output_angle(inst, 0.2, 0.0), abs=1e-8)


@pytest.mark.parametrize(
    ("command", "key", "value"),
    [
        ({"handle_angle": [0, np.nan]}, "handle_angle[1]", np.nan),
        ({"handle_angle": np.nan}, "handle_angle", np.nan),
        ({"force": np.nan}, "force", np.nan),
        ({"radial_force": np.inf}, "radial_force", np.inf),
        ({"weight": -np.inf}, "weight", -np.inf),
        ({"spool_velocity": np.nan}, "spool_velocity", np.nan),
        ({"force": [0, np.inf]}, "force[1]", np.inf),
        ({"radial_force": [np.nan, 0]}, "radial_force[0]", np.nan),
        ({"weight": [0, np.nan]}, "weight[1]", np.nan),
        ({"spool_velocity": [[0, 0], [0, np.nan]]}, "spool_velocity[1, 1]", np.nan),
        ({"handle_angle": [0, 0.1, 2]}, "handle_angle[2]", 2.0),
        ({"force": [0, 0, 0]}, "force", (3,)),
        ({"handle_angle": [[0, 0, 0]]}, "handle_angle", (1, 3)),
    ],
)
def test_a_command_that_cannot_be_is_refused_and_nothing_done(
    scaled: Instrument, command: dict[str, Any], key: str, value: Any
) -> None:
    twin = Twin(scaled)
    before = twin.state
    for call in (twin.run, twin.energy):
        with refused(key, value):
            call(**({"handle_angle": [0, 0]} | command))
    assert twin.state == before


def test_a_handle_angle_beyond_range_names_its_axis(real: Instrument) -> None:
    with refused("handle_angle[1] of pitch", 1.0):
        Twin(real).run([[0, 0], [0, 1.0]])


def test_loaded_past_the_fold_at_rest_it_says_where(scaled: Instrument) -> None:
    inst = smooth(scaled)
    force = np.linspace(0, 30, 4000)
    folds = int(np.argmin(np.isfinite(tn.statics.output_angle(inst, 0.0, force))))
    twin = Twin(inst, quasi_static=True)
    with pytest.raises(NoSolutionError, match=rf"at step {folds} .* more than the tendons can hold"):
        twin.run(np.zeros(4000), force)


def test_loaded_past_the_fold_in_motion_it_snaps_to_the_stop(scaled: Instrument) -> None:
    inst = smooth(scaled).replace(**{"dynamics.output_stop": 1.8})
    force = np.minimum(np.linspace(0, 30, 4000), 12.0)
    run = Twin(inst).run(np.zeros(4000), force)
    assert np.isnan(tn.statics.output_angle(inst, [0.0], 12.0)).all()
    assert run.output_angle[-1] < -1.8


@pytest.mark.parametrize(
    ("arguments", "key", "value"),
    [
        ({"signals": ["tip"]}, "signals", "tip"),
        ({"every": 3}, "every", 3),
        ({"seeds": [1, 2]}, "seeds", (2,)),
        ({"seeds": [-1]}, "seed", -1),
        ({"seeds": [1.5]}, "seed", 1.5),
        ({"seeds": [True]}, "seed", True),
        ({"handle_angle": np.nan}, "handle_angle", np.nan),
        ({"force": np.nan}, "force", np.nan),
        ({"force": [0, np.nan]}, "force[1]", np.nan),
        ({"vary": {"pretension": [1.0, 2.0], "handle_length": [0.1]}}, "vary", None),
        ({"force": np.zeros((2, 2)), "vary": {"pretension": [1.0, 2.0, 3.0]}}, "handle_angle", (2, 2)),
        ({"time_step": 0.1}, "time_step", 0.1),
    ],
)
def test_runs_that_cannot_be_are_refused(scaled: Instrument, arguments: dict[str, Any], key: str, value: Any) -> None:
    with refused(key, value):
        run_many(scaled, **({"handle_angle": [0.0, 0.0]} | arguments))


@pytest.mark.parametrize(("key", "values"), [("pretensions", [1.0, 2.0]), ("pretension", [20.0, -2.0])])
def test_a_value_that_cannot_vary_so_is_refused(scaled: Instrument, key: str, values: list[float]) -> None:
    with refused(key, kind=InstrumentError):
        run_many(scaled, [0.0, 0.0], vary={key: values})


def test_runs_of_unlike_twins_or_two_axes_are_refused(real: Instrument, scaled: Instrument) -> None:
    for insts in (real, [scaled, smooth(scaled)], []):
        with refused("inst"):
            run_many(insts, [0.0])
    with pytest.raises(ArgumentError, match="real-size has two axes; it must have one"):
        Twin(real).energy([0.0])


def test_a_state_of_another_kind_of_twin_is_refused(real: Instrument, scaled: Instrument, pulley: Instrument) -> None:
    twin = Twin(scaled)
    with pytest.raises(ArgumentError, match=r"state is of a twin with .* 2 axes, .*; it must be of one with .* 1 axes"):
        twin.state = Twin(real).state
    for other, different in (
        (Twin(rubbed(scaled, sheath_contacts=4)), "4 sheath contacts"),
        (Twin(rubbed(scaled, "stribeck")), "stribeck friction"),
        (Twin(scaled, time_step=TIME_STEP / 2), "steps of 0.00025 s"),
        (Twin(rubbed(pulley)), "tendon-pulley joints"),
    ):
        other.run([0.1])
        assert different in other.state.kind
        with refused("state", other.state.kind):
            twin.state = other.state
    assert twin.time == 0


def test_a_handle_that_takes_all_of_the_tendon_is_refused(scaled: Instrument) -> None:
    with refused("handle_length", 1.0):
        Twin(scaled.replace(handle_length=1.0))

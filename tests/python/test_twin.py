"""The digital twin against the statics, MuJoCo, its own energy balance and the law of friction."""

import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from peers import chain_dynamics

import tenodesis as tn
from tenodesis.instrument import Instrument
from tenodesis.run import Run
from tenodesis.twin import TIME_STEP, Twin

from .twin_motions import (
    AS_BUILT,
    LAWS,
    Array,
    changes_with_finer_steps,
    clock,
    eased,
    handle,
    settled,
    slack_force,
    smooth,
    with_friction,
)


@pytest.mark.parametrize(
    ("sign", "winding", "kind"),
    [(sign, winding, "as in its file") for sign in (1, -1) for winding in (0.0, 0.4)]
    + [(1, 0.4, kind) for kind in AS_BUILT if kind not in ("power", "bending")],
)
def test_at_rest_without_friction_it_is_the_statics_to_rounding(
    any_inst: Instrument, sign: int, winding: float, kind: str
) -> None:
    inst = smooth(any_inst).replace(**{f"friction.{key}": value for key, value in AS_BUILT.get(kind, {}).items()})
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
    [(MECHANISMS[(n + m) % 4], law, kind) for n, kind in enumerate(WORK) for m, law in enumerate([None, *LAWS])]
    + [("scaled", kind, "smooth") for kind in AS_BUILT],
)
def test_the_energy_balance_closes(request: pytest.FixtureRequest, name: str, law: str | None, kind: str) -> None:
    inst = request.getfixturevalue(name)
    twin, command = worked(with_friction(inst, law) if law else smooth(inst), kind, TIME_STEP)
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
        twin, command = worked(with_friction(scaled, law) if law else smooth(scaled), kind, time_step)
        energy = twin.energy(**command)
        left.append(abs(energy.unaccounted) / energy.work)
    order = np.log2(np.array(left[:-1]) / left[1:])
    assert (order > 1.8).all() and (order < 2.3).all()


def test_slack_and_stops_leave_less_of_the_energy_over_with_smaller_steps(scaled: Instrument) -> None:
    left = []
    for time_step in (TIME_STEP, TIME_STEP / 4, TIME_STEP / 16):
        twin, command = worked(with_friction(scaled), "slack", time_step)
        energy = twin.energy(**command)
        left.append(abs(energy.unaccounted) / energy.work)
    assert left[0] > 3 * left[1] > 9 * left[2]


@pytest.mark.parametrize(
    ("law", "more", "quasi_static"),
    [(law, {"sheath_contacts": contacts}, False) for law in LAWS for contacts in (1, 4, 16)]
    + [(kind, {}, still) for kind in AS_BUILT for still in (False, True)],
)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_friction_never_gives_energy_back_in_smooth_motion(
    law: str, more: dict[str, Any], quasi_static: bool, seed: int
) -> None:
    random = np.random.default_rng(seed)
    inst = with_friction(tn.load(random.choice(["real-size", "scaled-up"])), law, **more)
    t = clock(0.5)
    wave = [sum(random.normal() * np.sin(random.uniform(1, 25) * t) for _ in range(3)) / 3 for _ in range(2)]
    twin = Twin(inst, quasi_static=quasi_static)
    energy = twin.energy(0.3 * np.tanh(wave[0]), 0.4 * slack_force(inst) * np.tanh(wave[1]))
    assert energy.friction >= 0
    assert energy.least_friction >= -1e-15 * energy.work  # rounding
    assert energy.residual < 1e-9
    assert law in AS_BUILT or energy.sweeps <= 96 + 16 * (inst.friction.sheath_contacts + 2)


@pytest.mark.parametrize("law", LAWS)
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_friction_takes_energy_and_keeps_its_law_in_jumpy_motion(law: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    inst = with_friction(tn.load(random.choice(["real-size", "scaled-up"])), law)
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
    for inst in (smooth(any_inst), with_friction(any_inst, vertex_coefficient=0.1), with_friction(any_inst)):
        run, _ = cycle(inst)
        work.append(np.trapezoid(run.handle_torque, run.handle_angle))
        lag.append(-np.trapezoid(run.output_angle, run.handle_angle))
    assert 0 < work[0] < work[1] < work[2]
    assert 0 < lag[0] < lag[1] < lag[2]


def test_the_agonist_is_tighter_in_flexion_and_the_antagonist_in_extension(any_inst: Instrument) -> None:
    run, flexing = cycle(with_friction(any_inst))
    for share in (-0.5, 0.0, 0.5):
        near = np.abs(run.handle_angle - share * run.handle_angle.max()) < 0.02 * run.handle_angle.max()
        flexion, extension = (run.tension[near & way].mean(axis=0) for way in (flexing, ~flexing))
        assert flexion[0] > extension[0] and flexion[1] < extension[1]
        assert run.output_angle[near & flexing].mean() < run.output_angle[near & ~flexing].mean()


def test_a_small_reversal_at_the_handle_does_not_reach_the_tip(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
    twin = settled(Twin(inst), 0.3)
    run = twin.run(0.3 - eased(1e-3, 0.4))
    free = settled(Twin(smooth(any_inst)), 0.3).run(0.3 - eased(1e-3, 0.4))
    assert np.ptp(run.output_angle) < 0.35 * np.ptp(free.output_angle)


def test_a_tendon_slackens_and_tautens_without_chatter(any_inst: Instrument) -> None:
    inst = with_friction(any_inst)
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
    inst = with_friction(any_inst, sheath_contacts=contacts)
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
    tips = [
        cycle(with_friction(scaled, "constant", constant=3.0, sheath_contacts=2**n), 1)[0].output_angle
        for n in range(5)
    ]
    free = cycle(with_friction(scaled, "capstan"), 1)[0].output_angle
    apart = [np.abs(one - other).max() for one, other in itertools.pairwise(tips)]
    assert all(finer < 0.75 * coarser for coarser, finer in itertools.pairwise(apart))
    assert np.abs(tips[-1] - tips[0]).max() < 0.1 * np.abs(tips[0] - free).max()


def test_more_sheath_contacts_converge(scaled: Instrument) -> None:
    tips = [cycle(with_friction(scaled, sheath_contacts=2**n), 1)[0].output_angle for n in range(6)]
    apart = [np.abs(one - other).max() for one, other in itertools.pairwise(tips)]
    assert all(finer < 0.75 * coarser for coarser, finer in itertools.pairwise(apart))
    assert apart[-1] < np.radians(0.05)


@pytest.mark.parametrize("law", [*LAWS, *AS_BUILT])
def test_finer_steps_converge(scaled: Instrument, law: str) -> None:
    inst = with_friction(scaled, law)
    coarse, fine = changes_with_finer_steps(inst, 2.0 if law in LAWS else 1.0)
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
    wrench = np.pad(-force[:, np.newaxis], ((0, 0), (0, 5)))
    motion = chain_dynamics.simulate(inst.expanded, handle_angle[:, np.newaxis], wrench, TIME_STEP, substeps=4)
    return [np.degrees(tip) for tip in (*tips, motion.output_angle[:, 0])]


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

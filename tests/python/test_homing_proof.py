"""Homing proves the wiring before it winds, refuses under load, says why, and leaves the tip where it is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import HOMING_REASONS, Controller, OperatingState, Request, homing_failure
from tenodesis.control.controller import fault_names
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run, fault_bits
from tenodesis.simulate import FaultInjection
from tenodesis.twin import TIME_STEP, Twin

from .test_homing import INSTRUMENTS, LOADS, failure, home, instrument, known, unhomed, with_friction

ALLOWED = np.radians(3.0)
SECONDS = 17.0


def settled(inst: Instrument, slack: float, force: float = 0.0) -> Twin:
    """Return a twin at its pretension or with slack tendons, whose loaded tip has come to rest."""
    twin = Twin(inst, seed=2)
    if slack:
        twin.loosen(slack)
    ease = np.minimum(1, np.arange(1, 8001) / 1600)
    twin.run(np.zeros(8000), force * ease)
    return twin


def home_on(
    twin: Twin,
    controller: Controller,
    force: float = 0.0,
    faults: Sequence[FaultInjection] = (),
    handle: Array | None = None,
) -> Run:
    """Home a twin as it stands, until homing has ended."""
    count = round(SECONDS / TIME_STEP)
    request = np.zeros(count, int)
    request[100] = Request.HOME
    injected = [replace(one, start=twin.time) for one in faults]
    hand = np.zeros(count) if handle is None else handle
    return twin.run(hand, force, controller=controller, request=request, fault_injection=injected)


def moved(run: Run) -> float:
    return float(np.abs(run["output_angle"] - run["output_angle"][0]).max())


def inject(*faults: tuple[str, str, float]) -> list[FaultInjection]:
    return [FaultInjection(point, mode, value) for point, mode, value in faults]  # type: ignore[arg-type]


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("share", [-1.0, -0.5, 0.2, 0.5, 1.0])
def test_homing_again_under_a_load_refuses_and_leaves_the_tip_where_it_is(name: str, share: float) -> None:
    """Regulating both tensions wound the tip into its stop here, without a fault."""
    inst = instrument(name)
    force = share * LOADS[name]
    twin = settled(inst, 0.0, force)
    run = home_on(twin, unhomed(inst), force)
    assert failure(run) == "tip_loaded"
    assert run["operating_state"][-1] == OperatingState.FAULT
    assert moved(run) < ALLOWED
    # What was let out to find it is wound again.
    assert abs(run["output_angle"][-1] - run["output_angle"][0]) < np.radians(0.5)
    assert np.abs(run["spool_angle"][-1] - run["spool_angle"][0]).max() * inst.drives.spool_radius < 50e-6


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("share", [-1.0, 0.2, 1.0])
def test_homing_slack_tendons_under_a_load_refuses_as_well(name: str, share: float) -> None:
    inst = instrument(name)
    force = share * LOADS[name]
    run = home_on(settled(inst, 4e-3, force), unhomed(inst), force)
    assert failure(run) == "tip_loaded"
    assert moved(run) < ALLOWED


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_a_load_that_homing_does_not_see_costs_less_than_half_a_degree(name: str) -> None:
    inst = instrument(name)
    seen = []
    for force in np.linspace(0, 0.1 * LOADS[name], 9):
        run = home_on(settled(inst, 0.0, force), unhomed(inst), force)
        seen.append(failure(run) == "tip_loaded")
        if not seen[-1]:
            assert run["operating_state"][-1] == OperatingState.PAUSED
            assert abs(run["output_angle"][-1]) < np.radians(0.5)
    assert not seen[0]
    assert seen == sorted(seen)


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("slack", [0.0, 4e-3], ids=["tight", "slack"])
@pytest.mark.parametrize("bias", [2.0, 5.0])
@pytest.mark.parametrize("side", ["agonist", "antagonist"])
def test_a_cell_that_is_not_tared_is_named_and_nothing_wound(name: str, slack: float, bias: float, side: str) -> None:
    inst = instrument(name)
    run = home_on(settled(inst, slack), unhomed(inst), faults=inject((f"tension.{side}", "add", bias)))
    assert failure(run) == f"cell_offset.{side}"
    assert moved(run) < np.radians(1)
    assert run["tension"].max() < 1.1 * max(inst.pretension * (slack == 0), 1)


SIDE = "antagonist"
VELOCITY, ANGLE, TENSION = f"spool_velocity.{SIDE}", f"spool_angle.{SIDE}", f"tension.{SIDE}"
BOTH = ("spool_velocity.agonist", VELOCITY, "spool_angle.agonist", ANGLE)
# What is wrong, and what homing calls it from tight and, where it differs, from slack tendons: these cannot
# distinguish a motor from its encoder.
WIRING: dict[str, tuple[list[FaultInjection], *tuple[str, ...]]] = {
    "cells swapped": (inject((TENSION, "swap", 0)), "cells_swapped"),
    "motors with encoders swapped": (inject((VELOCITY, "swap", 0), (ANGLE, "swap", 0)), "cells_swapped"),
    "motors swapped": (inject((VELOCITY, "swap", 0)), "motors_swapped"),
    "encoders swapped": (inject((ANGLE, "swap", 0)), "encoders_swapped", "motors_swapped"),
    "motor reversed": (inject((VELOCITY, "scale", -1)), f"motor_reversed.{SIDE}"),
    "encoder reversed": (inject((ANGLE, "scale", -1)), f"encoder_reversed.{SIDE}", f"motor_reversed.{SIDE}"),
    "motor with encoder reversed": (inject((VELOCITY, "scale", -1), (ANGLE, "scale", -1)), f"spool_reversed.{SIDE}"),
    "both reversed": (inject(*((point, "scale", -1) for point in BOTH)), "spool_reversed.agonist", "tendons_slack"),
    "cell reversed": (inject((TENSION, "scale", -1)), "load_cell_range", f"cell_reversed.{SIDE}"),
    "motor without power": (inject((VELOCITY, "set", 0)), f"motor_dead.{SIDE}"),
    "encoder dead": (inject((ANGLE, "scale", 0)), f"motor_dead.{SIDE}"),
    "encoder of half the gain": (inject((ANGLE, "scale", 0.5)), f"encoder_gain.{SIDE}"),
    "cell of half the gain": (inject((TENSION, "scale", 0.5)), f"cell_gains_apart.{SIDE}"),
    "cell of 1.25 times the gain": (inject((TENSION, "scale", 1.25)), "cell_gains_apart.agonist"),
}


@pytest.mark.parametrize("name", INSTRUMENTS)
@pytest.mark.parametrize("slack", [0.0, 4e-3], ids=["tight", "slack"])
@pytest.mark.parametrize("wrong", WIRING)
@pytest.mark.parametrize("friction", [0.5, 2.0])
def test_every_fault_of_the_wiring_is_named_before_the_tip_has_moved_far(
    name: str, slack: float, wrong: str, friction: float
) -> None:
    inst = instrument(name)
    faults, from_tight, *from_slack = WIRING[wrong]
    controller = Controller(known(inst), homed=False, enabled=False)
    run = home_on(settled(with_friction(inst, friction), slack), controller, faults=faults)
    answer = failure(run) or fault_names(int(np.bitwise_or.reduce(fault_bits(run["faults"]))))[0]
    assert answer == (from_slack[0] if slack and from_slack else from_tight)
    assert moved(run) < ALLOWED
    assert not (run["commanded_spool_velocity"][-1]).any()


@pytest.mark.parametrize("name", ["scaled-up", "real-size", "pulley", "continuum"])
@pytest.mark.parametrize("points", [[TENSION], [VELOCITY, ANGLE]], ids=["cells", "motors with encoders"])
def test_swapped_cables_are_seen_without_any_friction_by_the_tips_inertia(
    name: str, points: list[str], any_frictionless: dict[str, Instrument]
) -> None:
    inst = any_frictionless[name]
    run = home_on(settled(inst, 0.0), unhomed(inst), faults=inject(*((point, "swap", 0) for point in points)))
    assert failure(run) == "cells_swapped"
    assert moved(run) < ALLOWED
    assert not failure(home_on(settled(inst, 0.0), unhomed(inst)))


@pytest.fixture(scope="module")
def any_frictionless() -> dict[str, Instrument]:
    """The paper's instruments and those of the other mechanisms, without friction."""
    made = {name: with_friction(instrument(name), 0.0) for name in INSTRUMENTS}
    for name in ("pulley", "continuum"):
        inst = tn.load(f"examples/{name}.toml")
        made[name] = inst.replace(**{"friction.law": "none"})
    return made


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_a_hand_that_moves_makes_homing_wait_at_first_and_refuse_later(name: str) -> None:
    inst = instrument(name)
    time = np.arange(1, round(SECONDS / TIME_STEP) + 1) * TIME_STEP
    early = np.radians(10) * np.clip(time / 1.5, 0, 1)
    run = home_on(settled(inst, 2e-3), unhomed(inst), handle=early)
    assert not failure(run)
    assert run["operating_state"][-1] == OperatingState.PAUSED
    wound = np.flatnonzero(run["commanded_spool_velocity"].any(axis=1))
    assert time[wound[0]] > 1.5
    late = np.radians(2) * np.clip((time - 2) / 0.2, 0, 1)
    run = home_on(settled(inst, 2e-3), unhomed(inst), handle=late)
    assert failure(run) == "handle_moved"


def test_a_reason_is_forgotten_when_homing_starts_again() -> None:
    inst = instrument("scaled-up")
    controller = unhomed(inst)
    twin = settled(inst, 0.0)
    failed = home_on(twin, controller, faults=inject((VELOCITY, "set", 0)))
    assert failure(failed) == "motor_dead.antagonist"
    count = round(8 / TIME_STEP)
    request = np.zeros(count, int)
    request[100], request[200] = Request.CLEAR, Request.HOME
    again = twin.run(np.zeros(count), controller=controller, request=request)
    assert homing_failure(int(again["homing_failure"][150])) == "motor_dead.antagonist"
    assert again["homing_failure"][-1] == 0
    assert again["operating_state"][-1] == OperatingState.PAUSED


def test_the_controllers_output_says_why_homing_failed() -> None:
    inst = instrument("scaled-up")
    controller = unhomed(inst)
    out = controller.step(0.0, 0.0, (0.0, 0.0), (0.0, 0.0), Request.HOME)
    assert out.homing_failure == ""
    flicker = 0.02
    for n in range(1, 4000):
        flicker = -flicker
        out = controller.step(n * TIME_STEP, 0.0, (flicker, flicker), (0.0, 0.0))
        if out.state == OperatingState.FAULT:
            break
    assert out.homing_failure == "motor_dead.agonist"
    assert out.first_faults == ("homing_failed",)
    reason, _, tendon = out.homing_failure.partition(".")
    assert reason in HOMING_REASONS
    assert tendon == "agonist"


@pytest.mark.parametrize("name", INSTRUMENTS)
def test_homing_does_not_move_a_free_tip_by_more_than_its_jogs(name: str) -> None:
    inst = instrument(name)
    for seed, slack in enumerate((0.5e-3, 3e-3, 8e-3)):
        run, _ = home(inst, unhomed(inst), slack=slack, seed=seed, seconds=12.0)
        assert run["operating_state"][-1] == OperatingState.PAUSED
        assert np.abs(run["output_angle"]).max() < np.radians(0.8)
        assert abs(run["output_angle"][-1]) < np.radians(0.02)

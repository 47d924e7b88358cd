"""What reaches the controller and the drives when a fault is injected between them and the instrument."""

from dataclasses import replace

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, Request
from tenodesis.run import Array
from tenodesis.simulate import FaultInjection
from tenodesis.twin import TIME_STEP, Twin

from .conftest import refused

TICKS = 400


def read(*faults: FaultInjection) -> Array:
    """Return what the controller read last, by tick: with a bent handle, turned spools and a loaded tip."""
    inst = tn.load("scaled-up").axis("yaw")
    controller = Controller(inst, law="off", enabled=False)
    twin = Twin(inst, seed=4)
    ease = np.linspace(0, 1, TICKS)
    twin.run(0.1 * ease, spool_velocity=(-0.2, 0.3))
    twin.run(np.full(TICKS, 0.1), 0.4 * ease, controller=controller, fault_injection=faults)
    record = controller.flight_record()
    return np.column_stack([record.handle_angle, record.tension, record.spool_angle])


@pytest.mark.parametrize("column", range(5))
def test_a_scaled_sensor_arrives_multiplied(column: int) -> None:
    expected = read()
    assert (expected[-1] != 0).all()
    expected[:, column] *= -1.5
    point = tn.simulate.INJECTION_POINTS[column]
    assert np.array_equal(read(FaultInjection(point, "scale", -1.5)), expected)  # type: ignore[arg-type]


@pytest.mark.parametrize("side", ["agonist", "antagonist"])
@pytest.mark.parametrize(("signal", "order"), [("tension", [0, 2, 1, 3, 4]), ("spool_angle", [0, 1, 2, 4, 3])])
def test_swapped_sensors_arrive_exchanged_whichever_of_the_two_is_named(
    signal: str, order: list[int], side: str
) -> None:
    exchanged = read(FaultInjection(f"{signal}.{side}", "swap"))  # type: ignore[arg-type]
    assert np.array_equal(exchanged, read()[:, order])
    assert not np.array_equal(exchanged, read())


def test_a_signal_that_was_exchanged_may_be_scaled_as_well() -> None:
    both = read(FaultInjection("tension.agonist", "swap"), FaultInjection("tension.antagonist", "scale", 2.0))
    assert np.array_equal(both, read()[:, [0, 2, 1, 3, 4]] * [1, 1, 2, 1, 1])


@pytest.mark.parametrize(("mode", "value", "moves"), [("swap", 0.0, (0, 1)), ("scale", -1.0, (-1, 0))])
def test_a_fault_of_the_drives_signals_turns_the_spools_it_says(
    mode: str, value: float, moves: tuple[int, int]
) -> None:
    """Only the agonist's motor is commanded, until the watch stops it."""
    inst = tn.load("scaled-up").axis("yaw")
    controller = Controller(inst, "exact", "paper", "agonist")
    fault = FaultInjection("spool_velocity.agonist", mode, value)  # type: ignore[arg-type]
    request = np.zeros(TICKS, int)
    request[0] = Request.ENABLE
    result = Twin(inst).run(np.zeros(TICKS), 1.0, controller=controller, request=request, fault_injection=[fault])
    turned = result["spool_angle"][-1]
    sent = result["commanded_spool_velocity"].sum(axis=0)
    assert sent[0] != 0
    assert sent[1] == 0
    direction = np.sign(sent[0])
    assert np.array_equal(np.sign(np.round(turned, 5)), direction * np.array(moves))


@pytest.mark.parametrize(("point", "mode"), [("handle_angle", "swap"), ("tick", "swap"), ("tick", "scale")])
def test_only_a_tendons_signal_can_be_swapped_and_the_tick_not_be_scaled(point: str, mode: str) -> None:
    with pytest.raises(ValueError, match=f"mode is {mode} at {point}"):
        FaultInjection(point, mode)  # type: ignore[arg-type]


def test_two_faults_at_one_point_must_come_one_after_the_other() -> None:
    scaled, shifted = FaultInjection("tension.agonist", "scale", 2.0), FaultInjection("tension.agonist", "add", 1.0)
    with refused("point"):
        read(scaled, shifted)
    # The twin has run for as long before.
    half = (1.5 * TICKS + 0.5) * TIME_STEP
    found, expected = (
        read(*faults)[:, 1] for faults in ([replace(scaled, stop=half), replace(shifted, start=half)], [])
    )
    middle = expected.size // 2
    assert np.array_equal(found[:middle], 2 * expected[:middle])
    assert np.array_equal(found[middle:], expected[middle:] + 1)

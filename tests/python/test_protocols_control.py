"""Claims about protocols with a controller in the loop: it homes where it must, and its faults end nothing."""

from typing import Any

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import simulate
from tenodesis.control import FAULTS, Controller, OperatingState, Request
from tenodesis.errors import ProtocolError
from tenodesis.instrument import Instrument
from tenodesis.run import CONTROL, Run
from tenodesis.simulate import Cycles, FaultInjection, Hold, Pretension, Protocol, Ramp, StepLoad
from tenodesis.twin import Twin

from .conftest import refused

PUSHED = StepLoad(output_angle="40 deg", delay=0.2, force=1.0, duration=1.5, approach="60 deg/s")


def one(*phases: Any) -> Protocol:
    return Protocol(name="test", phases=phases)


def states(run: Run) -> list[int]:
    """The controller's states in the order in which they come."""
    state = run["operating_state"].reshape(len(run), -1)[:, 0]
    return [int(value) for n, value in enumerate(state) if n == 0 or value != state[n - 1]]


def slack(inst: Instrument) -> Twin:
    twin = Twin(inst, seed=2)
    twin.loosen(2e-3)
    return twin


class Stuck(Twin):
    """A twin the agonist's load cell of which sticks after half a second."""

    def run(self, *arguments: Any, **commands: Any) -> Run:
        return super().run(
            *arguments, **commands, fault_injection=[FaultInjection("tension.agonist", "hold", start=0.5)]
        )


def test_a_protocol_in_blocks_is_the_run_of_its_commands_at_once(scaled: Instrument) -> None:
    protocol = one(Cycles(amplitude="15 deg", period=0.8, count=1, force=0.5), PUSHED)
    seen: list[Run] = []
    run = simulate.execute(Twin(scaled, seed=3), protocol, Controller(scaled), on_block=seen.append)
    commands: dict[str, Any] = dict(protocol.commands(scaled, 5e-4))
    commands.pop("spool_velocity")
    whole = Twin(scaled, seed=3).run(**commands, controller=Controller(scaled))
    assert len(seen) > 2
    for name, values in whole.signals().items():
        np.testing.assert_array_equal(values, run[name], name)
    assert set(CONTROL) <= run.signals().keys()


@pytest.mark.parametrize("homed", [False, True])
def test_a_pretension_is_the_controllers_homing(any_inst: Instrument, homed: bool) -> None:
    controller = Controller(any_inst, homed=homed)
    protocol = one(Pretension(), Hold(duration=0.4))
    run = simulate.execute(slack(any_inst), protocol, controller)
    assert states(run) == [OperatingState.ENABLED, OperatingState.PAUSED, OperatingState.ENABLED]
    request = run["request"].reshape(len(run), -1)[:, 0]
    assert request[request != 0].tolist() == [Request.HOME, Request.RESUME]
    first = run["measured_tension"][0]
    assert (first < 0.2 * any_inst.pretension).all()
    held = run["operating_state"].reshape(len(run), -1)[:, 0] == OperatingState.PAUSED
    at_home = run["tension"].reshape(len(run), -1)[held][-1]
    np.testing.assert_allclose(at_home, any_inst.pretension, rtol=0.02)


def test_joints_that_are_listed_are_homed_as_axes_are() -> None:
    inst = tn.instrument.expanded("real-size")
    twin = Twin(inst, seed=2)
    twin.loosen(2e-3)
    run = simulate.execute(twin, one(Pretension()), Controller(tn.control.compensated(inst), homed=False))
    assert states(run) == [OperatingState.ENABLED, OperatingState.PAUSED, OperatingState.ENABLED]
    np.testing.assert_allclose(run["tension"][-1], inst.pretension, rtol=0.03)


def test_a_controller_that_does_not_start_enabled_stays_paused_after_homing(scaled: Instrument) -> None:
    controller = Controller(scaled, homed=False, enabled=False)
    run = simulate.execute(slack(scaled), one(Pretension(), Hold(duration=0.1)), controller)
    assert states(run) == [OperatingState.ENABLED, OperatingState.PAUSED]


def test_a_fault_ends_nothing_and_the_motors_hold_where_the_file_has_them(scaled: Instrument) -> None:
    protocol = one(PUSHED, Hold(duration=0.5))
    run = simulate.execute(Stuck(scaled), protocol, Controller(scaled.replace(**{"control.stop": "hold"})))
    assert len(run) == protocol.commands(scaled, 5e-4)["force"].size
    assert states(run)[-1] == OperatingState.FAULT
    assert int(run["faults"][-1]) >> FAULTS.index("load_cell_stuck") & 1
    found = int(np.argmax(run["operating_state"] == OperatingState.FAULT))
    assert 0.5 < run.time[found] < 0.6
    assert not run["commanded_spool_velocity"][found + 200 :].any()
    assert np.ptp(run["spool_angle"][found + 400 :], axis=0).max() < 1e-3


def test_a_fault_while_homing_ends_the_homing_and_not_the_run(scaled: Instrument) -> None:
    run = simulate.execute(Stuck(scaled), one(Hold(duration=0.4), Pretension(), PUSHED), Controller(scaled))
    assert states(run)[-1] == OperatingState.FAULT
    assert run["force"][-1] == 1


def test_homing_that_outlasts_its_phase_ends_the_run(scaled: Instrument) -> None:
    with refused("timeout", 0.2, kind=ProtocolError):
        simulate.execute(slack(scaled), one(Pretension(timeout=0.2)), Controller(scaled, homed=False))


@pytest.mark.parametrize(
    ("phases", "sentence"),
    [
        ((Ramp(duration=0.1, spool_velocity=(0.1, 0.0)),), r"phase 2 \(ramp\): spool_velocity is given"),
        ((Ramp(duration=0.1, force=1.0), Pretension()), r"phase 3 \(pretension\): the tip is loaded"),
        ((Pretension(tension="20 N"),), r"tension is 20 N; with a controller it must be the pretension of 25 N"),
    ],
)
def test_what_a_controller_cannot_run_is_refused_before_anything_moves(
    scaled: Instrument, phases: tuple[Any, ...], sentence: str
) -> None:
    twin = Twin(scaled)
    with pytest.raises(ProtocolError, match=sentence):
        simulate.execute(twin, one(Hold(duration=0.1), *phases), Controller(scaled))
    assert twin.time == 0


def test_a_pretension_of_one_axis_is_refused(real: Instrument) -> None:
    with refused("axis", "pitch", kind=ProtocolError):
        simulate.execute(Twin(real), one(Pretension(axis="pitch")), Controller(real))
    alone = real.axis("pitch")
    run = simulate.execute(slack(alone), one(Pretension(axis="pitch")), Controller(alone, homed=False))
    assert states(run)[-1] == OperatingState.ENABLED


def test_a_controller_for_another_plant_is_refused(scaled: Instrument, real: Instrument, pulley: Instrument) -> None:
    for other in (real, pulley):
        twin = Twin(scaled)
        with refused("controller"):
            simulate.execute(twin, one(PUSHED), Controller(other))
        assert twin.time == 0

"""The controller's requests and states, and wrong arguments and readings."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tenodesis.control import Controller, OperatingState, Output, Request
from tenodesis.instrument import Instrument
from tenodesis.simulate import FaultInjection
from tenodesis.twin import Twin

from .conftest import refused
from .test_control import PERIOD, clock, eased, with_friction

# ---- requests and states


class Session:
    """A straight instrument at rest, and a controller that is asked things."""

    def __init__(self, inst: Instrument, **options: Any) -> None:
        self.controller = Controller(inst, **options)
        self.inst, self.time, self.spools = inst, 0.0, np.zeros(2)
        self.random = np.random.default_rng(1)
        self.handle = 0.0

    def step(self, request: Request | str = "none") -> Output:
        self.time += PERIOD
        tensions = self.inst.pretension + self.random.normal(0, self.inst.sensors.load_cell_noise, 2)
        return self.controller.step(self.time, self.handle, tensions, self.spools, request)

    def steps(self, count: int) -> Iterator[Output]:
        for _ in range(count):
            yield self.step()


@pytest.mark.parametrize("by_name", [True, False])
def test_requests_lead_through_the_states(scaled: Instrument, by_name: bool) -> None:
    session = Session(scaled, enabled=False)
    assert session.step().state == OperatingState.DISABLED
    for request, state in [
        ("resume", OperatingState.DISABLED),
        ("pause", OperatingState.DISABLED),
        ("clear", OperatingState.DISABLED),
        ("enable", OperatingState.ENABLED),
        ("enable", OperatingState.ENABLED),
        ("pause", OperatingState.PAUSED),
        ("enable", OperatingState.PAUSED),
        ("resume", OperatingState.ENABLED),
        ("disable", OperatingState.DISABLED),
    ]:
        assert session.step(request if by_name else Request[request.upper()]).state == state, request


def test_what_is_asked_comes_with_the_next_tick_and_only_once(scaled: Instrument) -> None:
    session = Session(scaled)
    assert session.step().state == OperatingState.ENABLED
    session.controller.ask("disable")
    assert session.step().state == OperatingState.DISABLED
    assert session.step("enable").state == OperatingState.ENABLED
    assert all(out.state == OperatingState.ENABLED for out in session.steps(5))


def test_nothing_compensates_before_it_is_homed(scaled: Instrument) -> None:
    session = Session(scaled, homed=False)
    out = session.step()
    assert out.state == OperatingState.DISABLED
    assert not out.homed
    out = session.step("home")
    assert out.state == OperatingState.ENABLED
    assert out.homing


def test_a_controller_that_is_not_enabled_sends_nothing(scaled: Instrument) -> None:
    inst = with_friction(scaled)
    requests = np.zeros(round(3 / PERIOD), int)
    for law in ("paper", "paper-feedback", "exact", "robust"):
        controller = Controller(inst, "friction", law, enabled=False)
        run = Twin(inst, seed=1).run(eased(0.3, 1, 3), 1.0, controller=controller, request=requests)
        assert (run["operating_state"] == OperatingState.DISABLED).all()
        assert not run["commanded_spool_velocity"].any()


@pytest.mark.parametrize("law", ["paper", "paper-feedback", "exact", "robust"])
def test_no_change_of_state_jerks(scaled: Instrument, law: Any) -> None:
    inst = with_friction(scaled)
    drives = inst.drives
    most = drives.motor_acceleration / drives.gear_ratio * PERIOD
    requests = np.zeros(round(8 / PERIOD), int)
    asked = {2.0: "ENABLE", 2.7: "PAUSE", 3.0: "RESUME", 4.2: "DISABLE", 4.6: "ENABLE", 5.5: "PAUSE", 5.6: "RESUME"}
    for time, name in asked.items():
        requests[round(time / PERIOD)] = Request[name]
    controller = Controller(inst, "friction", law, enabled=False)
    force = np.where(clock(8) > 0.5, 1.2, 0.0)
    run = Twin(inst, seed=1).run(eased(0.4, 0.4, 8), force, controller=controller, request=requests)
    sent = run["commanded_spool_velocity"]
    assert set(np.unique(run["operating_state"])) == {0, 1, 2}
    assert np.abs(sent).max() > 0.01
    assert np.abs(np.diff(sent, axis=0)).max() <= most * (1 + 1e-9)


# ---- what cannot be


@pytest.mark.parametrize("channel", range(5))
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300])
def test_a_reading_that_is_no_number_is_a_fault_not_an_exception(scaled: Instrument, channel: int, bad: float) -> None:
    session = Session(scaled)
    for _ in session.steps(100):
        pass
    row = np.array([0.0, 25.0, 25.0, 0.0, 0.0])
    row[channel] = bad
    out = session.controller.step(session.time + PERIOD, row[0], row[1:3], row[3:])
    assert out.state == OperatingState.FAULT
    assert "not_a_number" in out.first_faults
    assert np.isfinite(out.spool_velocity).all()
    session.time += PERIOD
    assert session.step().state == OperatingState.FAULT
    assert session.step("clear").state == OperatingState.DISABLED
    assert session.step("enable").state == OperatingState.ENABLED


def test_a_fault_of_one_axis_stops_both(real: Instrument) -> None:
    handle = np.stack([eased(0.3, 0.5, 2), eased(-0.2, 0.5, 2)], 1)
    lost = FaultInjection("tension.agonist", "set", np.nan, start=1.5, axis="pitch")
    force = 0.2 * (clock(2) > 1)[:, np.newaxis] * [1, -1]
    run = Twin(real, seed=1).run(handle, force, controller=Controller(real), fault_injection=[lost])
    time = run.time - PERIOD
    assert ((time >= 1.5 - 1e-9) == (run["operating_state"] == OperatingState.FAULT).T).all()
    sent = run["commanded_spool_velocity"]
    assert sent[(time > 1) & (time < 1.5)].any()
    assert not sent[time > 1.6].any()


@pytest.mark.parametrize("leap", [-PERIOD, 0.0, 0.1, 100.0])
def test_time_that_runs_backward_stands_still_or_leaps_is_a_late_tick(scaled: Instrument, leap: float) -> None:
    session = Session(scaled)
    for _ in session.steps(100):
        pass
    session.time += leap - PERIOD
    out = session.step()
    assert out.state == OperatingState.FAULT
    assert out.first_faults == ("tick_late",)


@pytest.mark.parametrize(
    ("key", "value", "wrong"),
    [
        ("time", -1.0, -1.0),
        ("time", np.nan, np.nan),
        ("handle_angle", [0.1, 0.2], (2,)),
        ("tensions", 25.0, ()),
        ("tensions", [[25.0, 25.0]], (1, 2)),
        ("spool_angles", [0.0, 0.0, 0.0], (3,)),
        ("request", "start", "start"),
        ("request", 9, 9),
    ],
)
def test_a_bad_argument_is_named(scaled: Instrument, key: str, value: Any, wrong: Any) -> None:
    given = {"time": 0.0, "handle_angle": 0.0, "tensions": (25.0, 25.0), "spool_angles": (0.0, 0.0)} | {key: value}
    with refused(key, wrong):
        Controller(scaled).step(**given)


def test_a_refused_tick_does_not_swallow_what_was_asked(scaled: Instrument) -> None:
    controller = Controller(scaled)
    with refused("tensions"):
        controller.step(0, 0.0, (1, 2, 3), (0, 0))
    assert controller.step(0, 0.0, (25, 25), (0, 0)).state == OperatingState.ENABLED


def test_two_axes_want_their_shapes(real: Instrument) -> None:
    controller = Controller(real)
    with refused("handle_angle", allowed="(2,)"):
        controller.step(0, 0.0, np.full((2, 2), 30), np.zeros((2, 2)))
    out = controller.step(0, [0.0, 0.0], np.full((2, 2), 30), np.zeros((2, 2)))
    assert out.spool_velocity.shape == (2, 2)
    assert out.output_angle.shape == (2,)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("observer", "kalman"),
        ("observer", "exact"),
        ("law", "pid"),
        ("actuation", "both"),
        ("precision", "half"),
        ("period", 0.0),
        ("period", np.nan),
    ],
)
def test_an_unknown_choice_is_named(scaled: Instrument, key: str, value: Any) -> None:
    with refused(key, value):
        Controller(scaled, **{key: value})


def test_choices_are_listed_in_a_sentence(scaled: Instrument) -> None:
    with pytest.raises(ValueError, match=r"^law is 'pid'; it must be one of off, paper, paper-feedback, exact, robus"):
        Controller(scaled, law="pid")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=r'law is "robust" and observer "exact"; it must be "friction" with that law.'):
        Controller(scaled, observer="exact")


def test_a_limit_below_the_pretension_is_named(scaled: Instrument) -> None:
    with refused("inst", "scaled-up"):
        Controller(scaled.replace(**{"control.tension_limit": 20.0}))

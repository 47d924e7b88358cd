"""Claims about running protocols: block by block, and winding until the tendons are tight."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from tenodesis import simulate
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run
from tenodesis.simulate import Hold, Pretension, Protocol, ProtocolError, Ramp

from .conftest import refused

DT = 1e-3


@dataclass
class Springs:
    """A twin that is no more than tendons of the instrument's stiffness, with load cells."""

    inst: Instrument
    time_step: float = DT
    spool_radius: float = 0.01
    hooked: Array = field(default_factory=lambda: np.ones(2))
    measures: bool = True
    time: float = 0.0

    def __post_init__(self) -> None:
        self.wound = np.zeros((len(self.inst.axes), 2))

    def run(self, *, handle_angle: Array, force: Array, radial_force: Array, spool_velocity: Array, **_: Any) -> Run:
        time: Array = self.time + self.time_step * np.arange(1.0, len(force) + 1)
        velocity = spool_velocity.reshape(len(force), -1, 2)
        wound = self.wound + self.time_step * self.spool_radius * np.cumsum(velocity, axis=0)
        self.wound, self.time = wound[-1], float(time[-1])
        tension = np.maximum(0, self.hooked * self.inst.tendon_stiffness * wound).reshape(spool_velocity.shape)
        return Run(
            time,
            self.inst.axes,
            commanded_handle_angle=handle_angle,
            force=force,
            radial_force=radial_force,
            commanded_spool_velocity=spool_velocity,
            measured_tension=tension if self.measures else None,
        )


def one(phase: Any, *more: Any) -> Protocol:
    return Protocol(name="test", phases=[phase, *more])


@pytest.mark.parametrize("name", simulate.shipped())
def test_every_shipped_protocol_runs_on_every_mechanism(any_inst: Instrument, name: str) -> None:
    protocol = simulate.load(name)
    assert protocol.name == name
    assert protocol.description
    run = simulate.execute(Springs(any_inst), protocol)
    assert len(run) * DT <= protocol.duration(any_inst) + 1e-9
    assert run.commanded_handle_angle is not None
    assert np.abs(run.commanded_handle_angle).max() <= any_inst.handle_range


def test_executing_gives_one_run_of_all_commands_and_reports_block_by_block(scaled: Instrument) -> None:
    protocol = simulate.load("cycles")
    seen: list[Run] = []
    times: list[tuple[float, float]] = []
    run = simulate.execute(Springs(scaled), protocol, on_block=seen.append, progress=lambda *at: times.append(at))
    expected = protocol.commands(scaled, DT)
    np.testing.assert_array_equal(run.commanded_handle_angle, expected["handle_angle"])
    np.testing.assert_array_equal(run.commanded_spool_velocity, expected["spool_velocity"])
    np.testing.assert_allclose(np.diff(run.time), DT)
    assert sum(len(block) for block in seen) == len(run)
    assert max(len(block) for block in seen) == 1000
    assert times == sorted(times)
    assert times[-1] == pytest.approx((protocol.duration(scaled),) * 2)


def test_pretension_winds_every_tendon_to_what_the_instrument_asks(any_inst: Instrument) -> None:
    twin = Springs(any_inst)
    run = simulate.execute(twin, one(Pretension(), Hold(duration=0.1)))
    assert run.measured_tension is not None
    assert run.commanded_spool_velocity is not None
    assert run.measured_tension.shape[1:] == (2 * len(any_inst.axes),)
    np.testing.assert_allclose(run.measured_tension[-290:], any_inst.pretension, atol=0.5)
    assert np.abs(run.commanded_spool_velocity).max() <= 1e-3 / twin.spool_radius * (1 + 1e-12)
    assert (run.commanded_spool_velocity[-100:] == 0).all()


def test_pretension_lets_out_what_is_too_tight(scaled: Instrument) -> None:
    twin = Springs(scaled)
    twin.wound[:] = 40 / scaled.tendon_stiffness
    run = simulate.execute(twin, one(Pretension(tension="10 N", tolerance="0.1 N", rate="5 mm/s")))
    assert run.measured_tension is not None
    np.testing.assert_allclose(run.measured_tension[-1], 10, atol=0.1)


def test_pretension_on_one_axis_leaves_the_other_alone(real: Instrument) -> None:
    run = simulate.execute(Springs(real), one(Pretension(axis="pitch")))
    assert run.measured_tension is not None
    np.testing.assert_allclose(run.measured_tension[-1], [0, 0, 30, 30], atol=0.5)


def test_pretension_holds_handle_and_load_where_they_were(scaled: Instrument) -> None:
    run = simulate.execute(Springs(scaled), one(Ramp(handle_angle=0.2, force=1, duration=0.1), Pretension()))
    assert run.commanded_handle_angle is not None
    assert run.force is not None
    assert (run.commanded_handle_angle[99:] == 0.2).all()
    assert (run.force[99:] == 1).all()


def test_a_tendon_that_does_not_get_tight_ends_the_run(scaled: Instrument) -> None:
    twin = Springs(scaled, hooked=np.array([1.0, 0.0]))
    with pytest.raises(ProtocolError) as problem:
        simulate.execute(twin, one(Hold(duration=0.1), Pretension(timeout="1 s", rate="20 mm/s")))
    assert str(problem.value) == (
        "test: phase 2 (pretension): the antagonist of yaw reads 0 N after the timeout of 1 s; it must be "
        "25 ± 0.5 N for 0.2 s: hook it in, or give a larger timeout, rate or tolerance."
    )
    assert twin.time == pytest.approx(1.1, abs=0.011)


def test_pretension_without_load_cells_ends_the_run(scaled: Instrument) -> None:
    with refused("measured_tension", kind=ProtocolError):
        simulate.execute(Springs(scaled, measures=False), one(Pretension()))


def test_nothing_runs_before_the_whole_protocol_was_checked(scaled: Instrument) -> None:
    twin = Springs(scaled)
    with refused("handle_angle", 3.0, kind=ProtocolError):
        simulate.execute(twin, one(Hold(duration=1), Ramp(handle_angle=3, duration=1)))
    assert twin.time == 0


def test_runs_that_differ_are_not_joined(scaled: Instrument) -> None:
    zeros = np.zeros(3)
    run = Run(zeros, ("yaw",), force=zeros)
    assert len(simulate.concatenate([run, run])) == 6
    for bad in ([], [run, Run(zeros, ("yaw",))], [run, Run(zeros, ("pitch",), force=zeros)]):
        with refused("runs"):
            simulate.concatenate(bad)

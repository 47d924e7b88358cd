"""The live loop: the same as the closed loop of a run, seen whole by who keeps up, safe when somebody leaves."""

import contextlib
import os
import time

import numpy as np
import pytest

import tenodesis as tn
from tenodesis.control import Controller, OperatingState
from tenodesis.control.controller import fault_names
from tenodesis.devices.device import Capabilities, Measurement
from tenodesis.errors import DeviceError, LiveError
from tenodesis.instrument.text import to_toml
from tenodesis.live import folder as folders
from tenodesis.live.lease import SECONDS, Lease
from tenodesis.live.loop import PROBLEMS, Choices, LiveLoop
from tenodesis.live.ticks import Reader
from tenodesis.run import fault_bits
from tenodesis.twin import Twin

from .conftest import refused, until

INST = tn.load("scaled-up")


def commanded(loop, folder):
    """Write what a runtime's folder holds beside the ring."""
    (folder / folders.INSTRUMENT).write_text(to_toml(loop.inst), "utf-8")
    has = loop.capabilities
    folders.write(
        folder,
        folders.About(
            loop.inst,
            has.name,
            loop.period,
            has.simulated,
            has.distal_encoder,
            "2026-01-01",
            os.getpid(),
            loop.device.commands,
            loop.device.signals,
        ),
    )
    return loop


def looped(folder, inst=INST, device=None, **choices):
    return commanded(LiveLoop(inst, folder, Choices(**{"real_time": False} | choices), device=device), folder)


@pytest.fixture
def live(tmp_path):
    """A loop and a reader of its ticks."""
    return looped(tmp_path), Reader(tmp_path)


def states(reader):
    """Operating states in the rows that have come."""
    return {OperatingState(int(state)) for state in np.nan_to_num(reader.read(100_000)[0].operating_state)}


def commands(n):
    share = np.clip(np.arange(n) / n, 0, 1)
    return np.radians(30) * share, np.where(share > 0.6, 1.0, 0.0)


@pytest.mark.parametrize("axes", [("yaw",), ("yaw", "pitch")])
def test_a_live_loop_does_what_a_run_with_the_controller_does_bit_for_bit(tmp_path, axes):
    inst = INST.replace(axes=axes)
    handle, force = commands(4000)
    loop = looped(tmp_path, inst, seed=3)
    reader = Reader(tmp_path)
    each = {name: np.tile(values[:, np.newaxis], len(axes)) for name, values in (("h", handle), ("f", force))}
    rows = loop.commands.row({"handle_angle": each["h"], "force": each["f"]}, 4000)
    assert loop.push(rows) == 4000
    loop.request("enable")
    loop.core.run_ticks(4000)
    live, lost = reader.read(5000)
    run = Twin(inst, seed=3).run(
        handle if axes == ("yaw",) else each["h"], force if axes == ("yaw",) else each["f"], controller=Controller(inst)
    )
    assert lost == 0
    # The loop counts nanoseconds.
    assert np.abs(live.time - run.time).max() < 1e-12
    for name, values in run.signals().items():
        assert np.array_equal(live[name], values, equal_nan=True), name


def test_a_reader_gets_every_tick_whole_or_is_told_how_many_it_missed(tmp_path):
    loop = looped(tmp_path, speed=0)
    slow, quick = Reader(tmp_path), Reader(tmp_path)
    loop.start()
    seen = 0
    while slow.written < 40_000:
        run, lost = quick.read(4096)
        seen += len(run) + lost
        # Ticks come in order, none twice.
        assert (np.diff(run.time) > 0).all()
        # A record that was torn would have one time and another one's handle.
        assert np.isfinite(run.handle_angle).all()
    loop.finish()
    run, lost = slow.read(10**6)
    assert lost > 0
    assert len(run) + lost == slow.written
    assert np.allclose(np.diff(run.time), loop.period)


def test_the_queue_of_played_ticks_tells_how_many_fitted_and_is_left_out_on_demand(tmp_path):
    loop = looped(tmp_path)
    rows = loop.commands.row({"handle_angle": np.full(6000, 0.3)}, 6000)
    assert loop.push(rows) == 4096 == loop.pending
    loop.drop()
    reader = Reader(tmp_path)
    loop.core.run_ticks(10)
    run, _ = reader.read()
    assert loop.pending == 0
    # A hand that nobody moves stays.
    assert (run.commanded_handle_angle == 0).all()


def test_a_hand_that_follows_a_slider_is_no_faster_than_a_hand_and_arrives(live):
    loop, reader = live
    loop.hand([0.5])
    loop.core.run_ticks(3000)
    angle = reader.read(4000)[0].commanded_handle_angle
    assert abs(angle[-1] - 0.5) < 1e-6
    assert np.abs(np.diff(angle)).max() / loop.period <= 3 + 1e-9
    assert angle.max() < 0.5 * 1.001


def test_a_stop_sends_nothing_but_zero_from_its_tick_on_until_it_is_set_free(live):
    loop, reader = live
    handle, force = commands(2000)
    loop.push(loop.commands.row({"handle_angle": handle, "force": force}, len(handle)))
    loop.request("enable")
    loop.core.run_ticks(1500)
    assert np.abs(reader.read(2000)[0].commanded_spool_velocity[-200:]).max() > 0
    loop.stop()
    loop.core.run_ticks(500)
    stopped, _ = reader.read(2000)
    assert not stopped.commanded_spool_velocity.any()
    assert stopped.operating_state[-1] == OperatingState.PAUSED
    loop.request("resume")
    loop.core.run_ticks(1000)
    going, _ = reader.read(2000)
    assert going.operating_state[-1] == OperatingState.ENABLED
    assert np.abs(going.commanded_spool_velocity).max() > 0


@pytest.mark.parametrize("again", [False, True])
def test_after_a_stop_the_motors_stand_and_then_return_unless_it_is_pressed_once_more(live, again):
    loop, reader = live
    handle, force = commands(2000)
    loop.push(loop.commands.row({"handle_angle": handle, "force": force}, len(handle)))
    loop.request("enable")
    loop.core.run_ticks(2500)
    wound = loop.core.wound(0)
    assert abs(wound) > np.radians(1)
    for _ in range(1 + again):
        loop.stop()
        loop.core.run_ticks(500)
    reader.read(10**5)
    loop.core.run_ticks(8000)
    run, _ = reader.read(10**5)
    assert run.operating_state[-1] == OperatingState.PAUSED
    assert bool(run.commanded_spool_velocity.any()) is not again
    assert abs(loop.core.wound(0)) == pytest.approx(abs(wound) if again else 0, abs=np.radians(0.3))


def test_a_lease_that_runs_out_pauses_within_the_loop_whatever_python_does(live):
    loop, reader = live
    loop.request("enable")
    loop.core.lease(60)
    loop.start()
    until(lambda: OperatingState.ENABLED in states(reader))
    loop.core.lease(0.05)
    until(lambda: OperatingState.PAUSED in states(reader))
    loop.finish()
    assert states(reader) <= {OperatingState.PAUSED}
    assert loop.problem == PROBLEMS[4]


def test_nothing_sets_motors_free_once_the_operator_has_gone(live):
    loop, reader = live
    loop.core.lease(60)
    loop.request("enable")
    loop.core.run_ticks(10)
    assert reader.read()[0].operating_state[-1] == OperatingState.ENABLED
    loop.core.lease(0)
    # Whoever comes next has not asked for what was asked before.
    loop.core.lease(60)
    loop.core.run_ticks(10)
    assert reader.read()[0].operating_state[-1] == OperatingState.PAUSED
    loop.core.lease(0)
    for request in ("enable", "resume", "home"):
        loop.request(request)
    loop.core.run_ticks(10)
    assert reader.read()[0].operating_state[-1] == OperatingState.PAUSED


def test_a_stop_is_taken_when_no_other_order_is(live):
    loop, reader = live
    loop.request("enable")
    loop.core.run_ticks(10)
    with contextlib.suppress(LiveError):
        while True:
            loop.force([0.5])
    loop.stop()
    loop.core.run_ticks(10)
    assert reader.read()[0].operating_state[-1] == OperatingState.PAUSED


def test_a_request_is_not_lost_in_a_tick_that_the_controller_does_not_get(live):
    loop, reader = live
    loop.request("enable")
    loop.core.run_ticks(10)
    loop.inject_fault("tick", "hold", 0, 1.5 * loop.period)
    loop.request("pause")
    loop.core.run_ticks(10)
    run, _ = reader.read()
    assert OperatingState.PAUSED in run.operating_state


def test_a_disable_is_not_weakened_by_a_pause_and_many_requests_end_in_the_last(live):
    loop, reader = live
    loop.request("enable")
    loop.core.run_ticks(10)
    loop.request("disable")
    loop.request("pause")
    loop.core.run_ticks(10)
    assert reader.read()[0].operating_state[-1] == OperatingState.DISABLED
    for _ in range(6):
        loop.request("clear")
        loop.request("home")
    loop.request("enable")
    loop.core.run_ticks(20)
    assert reader.read()[0].operating_state[-1] == OperatingState.ENABLED


def test_a_load_that_the_tip_cannot_hold_is_not_taken_and_said(live):
    loop, reader = live
    loop.core.run_ticks(10)
    loop.force([90.0])
    loop.core.run_ticks(2000)
    run, _ = reader.read(5000)
    assert np.isfinite(run.output_angle).all()
    assert len(run) == 2010


def test_a_signal_spoilt_on_purpose_is_the_fault_it_stands_for(live):
    loop, reader = live
    loop.request("enable")
    loop.core.run_ticks(200)
    loop.inject_fault("tension.agonist", "set", float("nan"), 0.5)
    loop.core.run_ticks(400)
    run, _ = reader.read(1000)
    assert run.operating_state[-1] == OperatingState.FAULT
    assert Controller(INST).counts()["faults"].keys() == set(tn.control.FAULTS)
    assert "not_a_number" in fault_names(int(run.faults[-1]))
    assert np.isfinite(run.commanded_spool_velocity).all()


@pytest.mark.parametrize(
    ("order", "says"),
    [
        (lambda loop: loop.hand([np.nan]), "handle_angle"),
        (lambda loop: loop.hand([0.1, 0.2]), "handle_angle"),
        (lambda loop: loop.force([np.inf]), "force"),
        (lambda loop: loop.request("fly"), "request is 'fly'"),
        (lambda loop: loop.choose("best", "agonist"), "law is 'best'"),
        (lambda loop: loop.speed(-1), "speed is -1"),
        (lambda loop: loop.speed(1e-9), "speed is 1e-09"),
        (lambda loop: loop.inject_fault("moon", "add", 1, 1), "point is 'moon'"),
        (lambda loop: loop.inject_fault("tick", "add", 1, -1), "seconds is -1"),
    ],
)
def test_an_order_that_makes_no_sense_is_refused_by_name(tmp_path, order, says):
    loop = looped(tmp_path)
    with pytest.raises(LiveError, match=says):
        order(loop)


def test_more_orders_than_the_queue_holds_are_refused_and_said(tmp_path):
    loop = looped(tmp_path)
    with pytest.raises(LiveError, match="too many commands at once"):
        for _ in range(3000):
            loop.force([0.5])


def test_the_law_can_be_changed_on_the_way(live):
    loop, reader = live
    loop.choose("off", "differential")
    loop.request("enable")
    handle, force = commands(1000)
    loop.push(loop.commands.row({"handle_angle": handle, "force": force}, len(handle)))
    loop.core.run_ticks(1000)
    off, _ = reader.read(2000)
    assert not off.commanded_spool_velocity.any()
    loop.choose("robust", "differential")
    loop.core.run_ticks(4000)
    on, _ = reader.read(5000)
    assert np.abs(on.commanded_spool_velocity).max() > 0
    # It gives back what the load has taken.
    wanted = Twin(INST).run(np.full(4000, handle[-1])).output_angle[-1]
    assert abs(on.output_angle[-1] - wanted) < abs(off.output_angle[-1] - wanted) / 3


class Bench:
    """A device that Python serves: the twin, which knows what may go wrong with it."""

    def __init__(self, inst=INST, rate=200.0):
        self.twin = Twin(inst, seed=1)
        self.inst, self.rate = inst, rate
        self.commands, self.closed, self.cut = [], False, False
        self.mode = "well"
        self.speed = np.zeros(2)
        self.time = 0

    @property
    def capabilities(self):
        return Capabilities("bench", self.inst.axes, self.rate, True, False, True, 1 / self.rate, 0.1)

    def open(self):
        pass

    def read(self, timeout):
        if self.mode == "silent":
            time.sleep(timeout)
            return None
        if self.mode == "broken":
            raise DeviceError("the cable is out; put it in.")
        time.sleep(1 / self.rate)
        turning = np.array([1.0, self.speed[1]]) if self.mode == "runaway" else self.speed
        run = self.twin.run(np.zeros(10), spool_velocity=turning)
        self.time += 5_000_000 if self.mode != "past" else -5_000_000
        tension = run.measured_tension[-1] if self.mode != "nan" else np.full(2, np.nan)
        return Measurement(
            max(self.time, 0),
            run.measured_handle_angle[-1:],
            tension[np.newaxis],
            run.measured_spool_angle[-1:],
            run.measured_output_angle[-1:],
        )

    def write(self, spool_velocity):
        self.speed = np.asarray(spool_velocity)[0]
        self.commands.append(self.speed)

    def close(self):
        self.speed = np.zeros(2)
        self.closed = True

    def cut_power(self):
        self.cut = True
        self.close()


def slow_rate(inst=INST):
    """An instrument that samples no faster than any machine keeps up with."""
    return inst.replace(**{"sensors.sampling_rate": 200.0})


def set_moving(loop, bench):
    """Home; a machine that is too busy for a tick makes a fault of its own, which is cleared."""
    end = time.monotonic() + 30
    while not np.any(bench.speed):
        assert time.monotonic() < end, "it does not move"
        for request, seconds in (("clear", 0.05), ("home", 1.0)):
            loop.request(request)
            begun = time.monotonic()
            while time.monotonic() < begun + seconds and not np.any(bench.speed):
                time.sleep(0.01)


def moving(folder):
    """Return a bench whose motors move, its loop, and the reader of its ring."""
    bench = Bench(slow_rate())
    loop = looped(folder, slow_rate(), device=bench, late_bound=0.5)
    reader = Reader(folder)
    loop.start()
    until(lambda: reader.written > 50)
    set_moving(loop, bench)
    return bench, loop, reader


@pytest.mark.parametrize("mode", ["silent", "broken", "past", "nan"])
def test_a_device_that_fails_moves_no_motor_and_is_named(tmp_path, mode):
    bench, loop, reader = moving(tmp_path)
    bench.mode = mode
    until(lambda: not np.any(bench.speed))
    begun = len(bench.commands)
    if mode in ("silent", "broken"):
        until(lambda: loop.problem is not None)
    time.sleep(0.3)
    loop.finish()
    assert not np.any(bench.commands[begun:])
    assert bench.closed
    run, _ = reader.read(10**5)
    if mode == "broken":
        assert loop.problem == "the cable is out; put it in."
    elif mode == "silent":
        assert loop.problem == PROBLEMS[3]
    else:
        assert {"past": "tick_late", "nan": "not_a_number"}[mode] in fault_names(int(np.nan_to_num(run.faults[-1])))
    assert run.output_angle is None


def test_a_motor_that_does_not_obey_loses_its_supply(tmp_path):
    bench, loop, reader = moving(tmp_path)
    bench.mode = "runaway"
    until(lambda: bench.cut)
    until(lambda: loop.problem is not None)
    loop.finish()
    assert bench.closed and "the supply of all motors was cut" in loop.problem
    run, _ = reader.read(10**5)
    assert "motor_not_following" in fault_names(int(np.nan_to_num(run.faults[-1])))


def test_a_device_is_closed_when_its_loop_cannot_be_made(tmp_path):
    (tmp_path / folders.RING).write_bytes(b"taken")
    bench = Bench(slow_rate())
    with refused("path", kind=LiveError):
        LiveLoop(slow_rate(), tmp_path, Choices(), device=bench)
    assert bench.closed


def test_a_lease_is_held_by_one_and_runs_out():
    now = [0.0]
    renewed = []
    lease = Lease(renewed.append, lambda: now[0])
    one, other = object(), object()
    assert lease.acquire(one, "one", force=False) is None
    assert lease.acquire(other, "other", force=False) == "one"
    assert not lease.renew(other)
    assert lease.renew(one)
    now[0] = SECONDS + 0.1
    assert lease.origin is None
    assert not lease.renew(one)
    assert lease.acquire(other, "other", force=False) is None
    assert lease.acquire(one, "one", force=True) is None
    assert not lease.release(other)
    assert lease.release(one)
    assert renewed[-1] == 0


def hiccup(tmp_path, pause, **control):
    """Return the faults that a bench causes whose thread pauses once, its clock going on."""
    inst = slow_rate().replace(**control)
    bench = Bench(inst)
    loop = looped(tmp_path, inst, device=bench)
    reader = Reader(tmp_path)
    loop.start()
    until(lambda: reader.written > 50)
    before = reader.written
    read = bench.read

    def paused(timeout):
        bench.read = read
        time.sleep(pause)
        bench.time += round(pause * 1e9)
        return read(timeout)

    bench.read = paused
    until(lambda: reader.written > before + 100)
    loop.finish()
    run, _ = reader.read(10**5)
    return fault_names(int(np.bitwise_or.reduce(fault_bits(run.faults))))


@pytest.mark.process
def test_a_bench_that_pauses_for_less_than_the_watchdog_is_no_fault(tmp_path):
    """The loop waits for two periods, which is less: the time that stands still meanwhile is the loop's."""
    assert "tick_late" not in hiccup(tmp_path, 0.06, **{"control.watchdog": 2.0})


@pytest.mark.process
def test_a_bench_that_pauses_for_longer_than_the_watchdog_is_a_fault(tmp_path):
    assert "tick_late" in hiccup(tmp_path, 0.3, **{"control.watchdog": 0.1})

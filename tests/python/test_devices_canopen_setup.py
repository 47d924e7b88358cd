"""CiA 402 drives on a CAN bus: how they are prepared, and tables that make no bench."""

import re
from math import isnan, pi
from typing import Any
from unittest.mock import patch

import can
import numpy as np
import pytest

import tenodesis as tn
from tenodesis.devices import can_setup, cia402
from tenodesis.devices.can_layout import Sensor, layout
from tenodesis.devices.canopen import CanOpenDevice
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import CanOpen

from .can_bench import (
    AGONIST,
    HEARTBEAT,
    RATE,
    SENSORS,
    SPEED,
    TIMEOUT,
    at_rest,
    axis,
    bench_instrument,
    moves,
    reopened,
    served,
    set_off,
    table,
    tick,
)
from .conftest import refused
from .simulated_bench.bench import SimulatedBench

EMERGENCY_OVERVOLTAGE = 0x3210


@pytest.fixture(scope="module")
def inst() -> Instrument:
    return bench_instrument(tn.load("real-size"))


# Drives


def test_statuswords_tell_the_states_of_cia_402() -> None:
    """By the bits that the profile's table of states gives, high to low from bit 6, x of either value."""
    patterns = {
        "not ready to switch on": "0xx0000",
        "switch on disabled": "1xx0000",
        "ready to switch on": "01x0001",
        "switched on": "01x0011",
        "operation enabled": "01x0111",
        "quick stop active": "00x0111",
        "fault reaction active": "0xx1111",
        "fault": "0xx1000",
    }
    tables = {name: re.compile(pattern.replace("x", ".")) for name, pattern in patterns.items()}
    for word in range(2**16):
        bits = f"{word & 0x7F:07b}"
        allowed = [name for name, pattern in tables.items() if pattern.fullmatch(bits)]
        found = cia402.state(word)
        assert [found] == allowed or (not allowed and cia402.described(word) == f"unknown (0x{word:04X})")


def test_an_emergency_that_is_over_stops_nobody(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        tick(device, clock)
        bench.drives[AGONIST].emergency(0)
        set_off(device, bench, clock)


def test_a_fault_at_the_start_is_reset_once(inst: Instrument) -> None:
    with served(inst) as (device, bench, _):
        device.close()
        bench.drives[AGONIST].fault(EMERGENCY_OVERVOLTAGE)
        with reopened(device):
            assert bench.drives[AGONIST].state == "operation enabled"
        device.close()
        bench.drives[AGONIST].fault(EMERGENCY_OVERVOLTAGE)
        bench.drives[AGONIST].fault_stays = True
        with refused("node", 1, kind=DeviceError), reopened(device):
            pass
        assert at_rest(bench) and bench.fastest == 0


def test_a_drive_may_take_its_time_to_leave_a_fault(inst: Instrument) -> None:
    with served(inst) as (device, bench, _):
        device.close()
        bench.drives[AGONIST].reset_time = 0.1
        bench.drives[AGONIST].fault(EMERGENCY_OVERVOLTAGE)
        with reopened(device):
            assert bench.drives[AGONIST].state == "operation enabled"


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"shows_mode": False}, r"node 1\) does not take mode 6"),
        ({"homing_methods": ()}, r"node 1\) refuses 35 .* in object 6098h"),
        ({"homes": False}, r"node 1\) reports its present position as zero, and is at 5000 counts"),
    ],
)
def test_a_drive_that_does_not_do_as_it_is_told_is_refused(
    inst: Instrument, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], named: str
) -> None:
    monkeypatch.setattr("tenodesis.devices.can_setup._MODE_TIME", 0.0)
    with served(inst, table(inst, zero="here")) as (device, bench, _):
        device.close()
        drive = bench.drives[AGONIST]
        drive._offset -= 5000
        drive.measure(drive._turned)
        for name, value in change.items():
            setattr(drive, name, value)
        with pytest.raises(DeviceError, match=named), reopened(device):
            pass
        assert all(drive.state == "switch on disabled" for drive in bench.drives.values())
        assert bench.fastest == 0


def test_an_older_drive_takes_its_position_for_zero_by_the_older_method(inst: Instrument) -> None:
    with served(inst, table(inst, zero="here")) as (device, bench, clock):
        device.close()
        bench.drives[AGONIST].homing_methods = (35,)
        bench.drives[AGONIST]._offset -= 5000
        with reopened(device):
            first = tick(device, clock)
        assert bench.drives[AGONIST].get(0x6098) == 35
        assert first is not None and np.abs(first).max() < 3 * 2 * pi / inst.drives.encoder_counts


def test_a_bench_that_another_program_serves_is_left_alone(inst: Instrument) -> None:
    with served(inst) as (device, bench, clock):
        set_off(device, bench, clock)
        logs = [list(drive.log) for drive in bench.drives.values()]
        other = can.Bus(interface="virtual", channel=device._settings.channel)
        beat = other.send_periodic(can.Message(arbitration_id=0x77F, data=[5], is_extended_id=False), HEARTBEAT)
        try:
            late = table(inst, channel=device._settings.channel, heartbeat=1.0)
            with refused("devices.canopen.master", 127, kind=DeviceError):
                CanOpenDevice(inst, late).open()
        finally:
            beat.stop()
            other.shutdown()
        assert [list(drive.log) for drive in bench.drives.values()] == logs
        assert moves(bench)


def not_opened(
    inst: Instrument, settings: CanOpen, named: str, *, answer_time: float = TIMEOUT, **changes: Any
) -> None:
    """Opening fails by that name, with a bench that has the usual table, and moves nothing."""
    changed = settings.model_copy(update={"channel": "tenodesis refused"} | changes)
    usual = table(inst, channel="tenodesis refused")
    bus = can.Bus(interface="virtual", channel="tenodesis refused")
    try:
        with patch.object(can_setup, "_ANSWER_TIME", answer_time), SimulatedBench(inst, usual, bus) as bench:
            device = CanOpenDevice(inst, changed)
            with pytest.raises(DeviceError, match=named):
                device.open()
            with pytest.raises(DeviceError, match="not open"):
                device.write(np.full((1, 2), SPEED))
            assert at_rest(bench) and bench.fastest == 0
            assert all(drive.state != "operation enabled" for drive in bench.drives.values())
    finally:
        bus.shutdown()


def test_a_node_id_where_nobody_is_is_named_with_those_that_are_there(inst: Instrument) -> None:
    wrong = table(inst, yaw=axis(inst, antagonist={"node": 77}))
    said = r"antagonist drive of yaw \(node 77\) does not answer on virtual .*nodes 1.* are there"
    not_opened(inst, wrong, said, answer_time=1.5)


def test_a_node_that_is_no_drive_is_refused(inst: Instrument) -> None:
    sensors = {
        name: {"node": AGONIST, "object": 0x6401, "sub": sub, "gain": 1.0}
        for sub, name in enumerate(("handle_angle", "agonist_tension", "antagonist_tension", "output_angle"))
    }
    wrong = table(inst, yaw=axis(inst, **sensors) | {"agonist": {"node": SENSORS}})
    not_opened(inst, wrong, r"agonist drive of yaw \(node 10\) is no CiA 402 drive, its device profile is 401")


def test_a_drive_that_would_not_stop_alone_is_refused(inst: Instrument, monkeypatch: pytest.MonkeyPatch) -> None:
    from .simulated_bench import cia402

    without = tuple(one for one in cia402._DRIVE_OBJECTS if one[0] != 0x6007)
    monkeypatch.setattr(cia402, "_DRIVE_OBJECTS", without)
    not_opened(inst, table(inst), r"node 1\) has no object 6007h:00. Without it the motor would not stop by itself")


def test_an_interface_that_is_not_there_is_one_sentence(inst: Instrument) -> None:
    for interface in ("socketcan", "no-such-interface"):
        device = CanOpenDevice(inst, table(inst, interface=interface, channel="can9"))
        with refused("devices.canopen.channel", "can9", kind=DeviceError):
            device.open()


# The table


def test_a_bus_that_is_too_slow_is_refused_with_what_it_can_do(inst: Instrument) -> None:
    fast = inst.replace(**{"sensors.sampling_rate": 2000.0})
    with refused("sensors.sampling_rate", 2000.0, kind=InstrumentError):
        layout(fast, table(fast, bitrate=500_000, heartbeat=0.01))
    assert 0.5 < layout(fast, table(fast, bitrate=2_000_000, heartbeat=0.01)).load < 0.9


def test_the_bus_load_is_that_of_the_frames_as_counted_by_hand(inst: Instrument) -> None:
    # Davis et al. 2007: at most 135 bits for 8 bytes, 115 for 6, 65 for 1 and 55 for none.
    planned = layout(inst, table(inst, bitrate=1_000_000, heartbeat=0.01))
    cyclic = 55 + 2 * 2 * 115 + 135
    assert planned.load == pytest.approx((cyclic * RATE + 4 * 65 / 0.01) / 1e6)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"yaw": None, "pitch": None}, "neither yaw nor pitch"),
        ({"master": AGONIST}, r"yaw.agonist.node is 1, which is master already"),
        ({"master": SENSORS}, "a sensor's node is 10, which is master"),
        ({"heartbeat": 0.0}, "heartbeat"),
        ({"velocity_unit": 0.0}, "velocity_unit"),
    ],
)
def test_a_table_that_makes_no_bench_is_refused(inst: Instrument, changes: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        table(inst, **changes)


def test_a_gain_of_zero_and_two_drives_at_one_node_are_refused(inst: Instrument) -> None:
    silent = {"node": SENSORS, "object": 0x6401, "sub": 1, "gain": 0.0}
    with pytest.raises(ValueError, match=r"yaw\.handle_angle\.gain\n.*it is 0; it must be"):
        table(inst, yaw=axis(inst, handle_angle=silent))
    with pytest.raises(ValueError, match=r"yaw.antagonist.node is 1, which is yaw.agonist already"):
        table(inst, yaw=axis(inst, antagonist={"node": AGONIST}))


def test_two_sensors_that_are_one_are_refused(inst: Instrument) -> None:
    cell = {"node": SENSORS, "object": 0x6401, "sub": 2, "gain": 0.01}
    wrong = table(inst, yaw=axis(inst, agonist_tension=cell, antagonist_tension=cell))
    with refused("devices.canopen", kind=InstrumentError, allowed="an object of its own"):
        layout(inst, wrong)


def test_a_heartbeat_between_two_samples_is_refused(inst: Instrument) -> None:
    with refused("devices.canopen.heartbeat", 0.001, kind=InstrumentError):
        layout(inst, table(inst, heartbeat=1e-3))


@pytest.mark.parametrize("share", [1.5, 0.4])
def test_a_unit_that_leaves_no_speeds_to_choose_is_refused(inst: Instrument, share: float) -> None:
    with refused("devices.canopen.velocity_unit", kind=InstrumentError):
        layout(inst, table(inst, velocity_unit=share * inst.drives.motor_speed))


def test_no_unit_rounds_a_speed_beyond_the_limit(inst: Instrument) -> None:
    unit = inst.drives.motor_speed / 10.7
    planned = layout(inst, table(inst, velocity_unit=unit))
    for drive, sign in zip(planned.drives, (1, -1), strict=True):
        commanded = drive.velocity(planned.speed_limit)
        assert commanded == sign * 10  # 10.7 would be rounded to 11
        assert drive.velocity(-planned.speed_limit) == -commanded


def test_what_is_more_than_any_number_is_not_a_number() -> None:
    assert isnan(Sensor(0, "tension", 1e300, 0.0, None).value(3e38))
    assert isnan(Sensor(0, "tension", 1e308, 0.0, (-(2**31), 2**31 - 1)).value(-(2**31) + 1))
    assert Sensor(0, "tension", 2.0, 1.0, None).value(3.0) == 7.0


def test_an_axis_without_its_table_is_refused(inst: Instrument) -> None:
    both = tn.load("real-size")
    with refused("devices.canopen.pitch", kind=InstrumentError, allowed="given"):
        CanOpenDevice(both, table(both))

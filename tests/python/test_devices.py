"""Devices by name, and the communication test."""

import dataclasses
from collections import Counter
from collections.abc import Sequence
from importlib import resources
from math import inf, nan
from typing import Any, ClassVar

import numpy as np
import pytest
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis import instrument
from tenodesis.cli.app import app
from tenodesis.devices import registry
from tenodesis.devices.communication_test import Findings, measure
from tenodesis.devices.device import Capabilities, Measurement
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.run import Array

from .conftest import refused

PERIOD_NS = 500_000

TABLES = """
[devices.nidaq]
device = "Dev2"
ahead = 3
output_limit = "9 V"

[devices.nidaq.yaw]
handle_angle = { channel = "ai0", gain = "72 deg/V", offset = "-180 deg" }
agonist_tension = { channel = "ai1", gain = "20 N/V", offset = "-0.5 N" }
antagonist_tension = { channel = "ai2", gain = "-20 N/V" }
output_angle = { channel = "ai3", gain = "72 deg/V" }
agonist = { speed = "ao0", gain = "4 rad/s/V", counter = "ctr0" }
antagonist = { speed = "ao1", gain = "-4 rad/s/V", standstill = "20 mV", counter = "ctr1", reversed = true }

[devices.canopen]
interface = "virtual"
velocity_unit = "0.001 rpm"

[devices.canopen.yaw]
agonist = { node = 1 }
antagonist = { node = 2, reversed = true }
handle_angle = { node = 10, object = 0x6401, sub = 1, gain = "0.0879 deg", offset = "-180 deg" }
agonist_tension = { node = 10, object = 0x6401, sub = 2, gain = "6.1 mN" }
antagonist_tension = { node = 10, object = 0x6401, sub = 3, gain = "6.1 mN" }

[devices.serial]
port = "/dev/ttyACM3"
"""


@pytest.fixture(scope="module")
def inst() -> Instrument:
    return tn.load("real-size").axis("yaw").replace(**{"drives.gear_ratio": 5.0})


@pytest.fixture(scope="module")
def wired() -> Instrument:
    """An instrument whose file describes its devices."""
    file = (resources.files("tenodesis") / "instruments" / "real-size.toml").read_text("utf-8")
    return instrument.parse(file.replace('axes = ["yaw", "pitch"]', 'axes = ["yaw"]') + TABLES)


# The communication test


class Scripted:
    """A device that measures at given instants; None is none."""

    def __init__(self, inst: Instrument, times: Sequence[int | None], **changes: Any) -> None:
        self.capabilities = Capabilities("scripted", inst.axes, 2000.0, True, True, False, 0.0, 0.0)
        self._times = list(times)
        self._changes = changes
        self.now = 0.0
        self.written: list[Array] = []
        self.closed = False

    def open(self) -> None:
        pass

    def close(self) -> None:
        self.closed = True

    def __enter__(self) -> "Scripted":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def read(self, timeout: float) -> Measurement | None:
        if not self._times:
            self.now = inf
            return None
        time = self._times.pop(0)
        if time is None:
            return None
        axes = len(self.capabilities.axes)
        values = Measurement(time, np.zeros(axes), np.ones((axes, 2)), np.zeros((axes, 2)), np.full(axes, nan))
        return values._replace(**{key: change(time) for key, change in self._changes.items()})

    def write(self, spool_velocity: Array) -> None:
        self.written.append(spool_velocity)


def found(inst: Instrument, times: Sequence[int | None], **changes: Any) -> tuple[Findings, Scripted]:
    device = Scripted(inst, times, **changes)
    findings = measure(device, inst, 10.0, clock=lambda: device.now)
    # The script's end is a read without a measurement of its own.
    return dataclasses.replace(findings, missed=findings.missed - 1), device


EVEN = [n * PERIOD_NS for n in range(2001)]


def test_a_device_that_keeps_time_is_good_enough_and_its_motors_rest(inst: Instrument) -> None:
    findings, device = found(inst, EVEN)
    assert findings.good
    assert findings.verdict == "scripted is good enough for a controller at 2000 Hz."
    assert findings.quantile(0.5) == findings.quantile(1.0) == PERIOD_NS / 1e9
    assert not np.any(device.written) and len(device.written) == len(EVEN) + 1
    assert device.closed


def test_intervals_are_told_as_they_were(inst: Instrument) -> None:
    # 97 periods of 0.5 ms, two of 0.6 ms and one of 2 ms.
    intervals = [PERIOD_NS] * 97 + [600_000] * 2 + [2_000_000]
    findings, _ = found(inst, np.cumsum([0, *intervals]).tolist())
    assert findings.quantile(0.5) == PERIOD_NS / 1e9
    assert findings.quantile(1.0) == 2e-3
    assert findings.quantile(0.99) == pytest.approx(np.quantile(intervals, 0.99) / 1e9)


HALF_AS_FAST = [2 * time for time in EVEN]
JITTERING = np.cumsum([0, *[PERIOD_NS // 2] * 990, *[PERIOD_NS * 2] * 400, *[PERIOD_NS // 2] * 90]).tolist()
STALLING = [time + (30_000_000 if n > 1000 else 0) for n, time in enumerate(EVEN)]
LOSING = [None if n % 100 == 7 else time for n, time in enumerate(EVEN)]
REPEATING = sorted([*EVEN, *EVEN[5:10]])
RETURNING = [*EVEN[:1000], EVEN[990], *EVEN[1000:]]


@pytest.mark.parametrize(
    ("times", "named"),
    [
        (HALF_AS_FAST, "rate is 1000 Hz, must be at least 1980 Hz"),
        (JITTERING, "jitter (p99 of intervals) is 1 ms, must be at most 0.75 ms"),
        (STALLING, "worst interval is 30.5 ms, must be at most 25 ms"),
        (LOSING, "losses is 0.9995 %, must be at most 0.1 %"),
        (REPEATING, "losses is 0.2493 %"),
        (RETURNING, "backward in time is 1, must be at most 0"),
    ],
)
def test_what_fails_is_named_with_its_bound(inst: Instrument, times: Sequence[int | None], named: str) -> None:
    findings, _ = found(inst, times)
    assert not findings.good
    assert named in findings.verdict
    assert findings.verdict.startswith("scripted is not good enough for a controller at 2000 Hz: ")


def test_what_a_device_misses_by_its_own_count_is_a_loss_of_the_measurement_it_was_in(inst: Instrument) -> None:
    class Counting(Scripted):
        counts: ClassVar[Counter[str]] = Counter()

        def read(self, timeout: float) -> Measurement | None:
            measured = super().read(timeout)
            if measured is not None and measured.time % (100 * PERIOD_NS) == 0:
                self.counts.update(missing=3, late=2)
            elif measured is not None:
                self.counts.update(saturated=1)
            return measured

    device = Counting(inst, EVEN)
    findings = measure(device, inst, 10.0, clock=lambda: device.now)
    assert findings.flawed == 21
    assert findings.counted == {"missing": 63, "late": 42, "saturated": 1980}
    assert "losses is 1.099 %" in findings.verdict  # and the script's end


def test_spools_that_turn_and_sensors_that_are_silent_are_named(inst: Instrument) -> None:
    creeping, _ = found(inst, EVEN, spool_angle=lambda time: np.full((1, 2), time * 1e-9))
    assert "spools turned is" in creeping.verdict and creeping.turned == pytest.approx(1.0)
    blind, _ = found(inst, EVEN, tension=lambda time: np.full((1, 2), nan if time % (10 * PERIOD_NS) == 0 else 1.0))
    assert "sensors without a value is 201" in blind.verdict


def test_a_device_that_fails_midway_is_named(inst: Instrument) -> None:
    def fail(time: int) -> Array:
        if time > PERIOD_NS * 100:
            raise DeviceError("Somebody pulled the plug.")
        return np.zeros(1)

    device = Scripted(inst, EVEN, handle_angle=fail)
    findings = measure(device, inst, 10.0, clock=lambda: device.now)
    assert findings.verdict.endswith("it failed. Somebody pulled the plug.")
    assert not findings.good and device.closed


def test_a_device_without_any_measurement_is_not_good_enough(inst: Instrument) -> None:
    findings, _ = found(inst, [None] * 100)
    assert not findings.good and "rate is 0 Hz" in findings.verdict


# By name


def test_devices_are_listed_with_what_they_need() -> None:
    result = CliRunner().invoke(app, ["devices"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    for name in ("twin", "canopen", "nidaq", "serial"):
        assert name in result.output
    assert "NI-DAQmx" in result.output


def test_a_test_by_command_tells_all_and_fails_by_its_exit_code(
    inst: Instrument, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Quick(Scripted):
        """Ends soon by itself, since the command goes by the real clock."""

        def read(self, timeout: float) -> Measurement | None:
            measured = super().read(timeout)
            if measured is None:
                raise DeviceError("The script has ended.")
            return measured

    monkeypatch.setattr(registry, "make", lambda name, inst, address: Quick(inst, EVEN))
    result = CliRunner().invoke(app, ["devices", "test", "real-size", "canopen"], env={"COLUMNS": "200"})
    assert result.exit_code == 1
    for line in ("2001 measurements", "interval, p50", "0.5 ms", "rate", "losses", "The script has ended."):
        assert line in result.output


def test_a_device_is_made_from_its_table(wired: Instrument) -> None:
    assert registry.make("nidaq", wired).capabilities.distal_encoder
    canopen = registry.make("canopen", wired.replace(**{"sensors.sampling_rate": 500.0})).capabilities
    assert (canopen.axes, canopen.rate, canopen.distal_encoder) == (("yaw",), 500.0, False)


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("canopen", "real-size has no table devices.canopen"),
        ("nidaq", "real-size has no table devices.nidaq"),
        ("twin", "NAME is 'twin'; it must be one of canopen, nidaq, serial"),
        ("toaster", "NAME is 'toaster'; it must be one of twin, canopen, nidaq, serial"),
    ],
)
def test_a_device_that_cannot_be_made_is_one_sentence(name: str, named: str) -> None:
    with pytest.raises(DeviceError, match=named):
        registry.make(name, tn.load("real-size"))


def test_a_bad_duration_is_refused(inst: Instrument) -> None:
    with refused("--seconds", -1, kind=DeviceError):
        measure(Scripted(inst, EVEN), inst, -1)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('gain = "72 deg/V", offset', 'gain = "72 deg", offset'), "devices.nidaq.yaw.handle_angle.gain"),
        (('gain = "20 N/V"', "gain = 20"), "devices.nidaq.yaw.agonist_tension.gain"),
        (("node = 2, reversed", "node = 1, reversed"), "devices.canopen.yaw.antagonist.node"),
        (("sub = 1, gain", "sub = 1, gian"), "devices.canopen.yaw.handle_angle.gain"),
    ],
)
def test_a_table_with_a_slip_is_told_by_key(change: tuple[str, str], named: str) -> None:
    file = (resources.files("tenodesis") / "instruments" / "real-size.toml").read_text("utf-8")
    assert change[0] in TABLES
    with refused(named, kind=InstrumentError):
        instrument.parse(file + TABLES.replace(*change))

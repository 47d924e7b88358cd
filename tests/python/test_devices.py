"""Devices by name, the communication test, and the bench at a data acquisition device."""

import dataclasses
import inspect
from collections import Counter
from collections.abc import Callable, Sequence
from math import degrees, inf, isinf, nan, radians
from types import SimpleNamespace
from typing import Any, ClassVar
from unittest.mock import MagicMock

import numpy as np
import pytest
from typer.testing import CliRunner

import tenodesis as tn
from tenodesis import cli, instrument
from tenodesis.devices import registry
from tenodesis.devices.communication_test import Findings, measure
from tenodesis.devices.device import Capabilities, Measurement
from tenodesis.devices.nidaq import NiDaqDevice
from tenodesis.devices.nidaq_tasks import NiTasks, Samples
from tenodesis.devices.settings import NiDaq
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

AHEAD = 3
PERIOD_NS = 500_000
ENCODER = radians(72)  # per V: 5 V are a turn
CELL = 20.0  # N/V
MOTOR = 4.0  # rad/s/V

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
    """An instrument whose file tells of its devices."""
    file = (instrument.resources.files("tenodesis") / "instruments" / "real-size.toml").read_text("utf-8")
    return instrument.parse(file.replace('axes = ["yaw", "pitch"]', 'axes = ["yaw"]') + TABLES)


@pytest.fixture(scope="module")
def settings(inst: Instrument) -> NiDaq:
    axis = {
        "handle_angle": {"channel": "ai0", "gain": ENCODER, "offset": -np.pi},
        "agonist_tension": {"channel": "ai1", "gain": CELL, "offset": -0.5},
        "antagonist_tension": {"channel": "ai2", "gain": -CELL},
        "output_angle": {"channel": "ai3", "gain": ENCODER},
        "agonist": {"speed": "ao0", "gain": MOTOR, "counter": "ctr0"},
        "antagonist": {"speed": "ao1", "gain": -MOTOR, "standstill": 0.02, "counter": "ctr1", "reversed": True},
    }
    return NiDaq.model_validate({"device": "Dev2", "ahead": AHEAD, "output_limit": 9.0, "yaw": axis})


class FakeTasks:
    """Samples as they are given; keeps what it is told."""

    stops_alone = inf

    def __init__(self, samples: Sequence[Samples | DeviceError | None] = ()) -> None:
        self.samples = list(samples)
        self.told: list[tuple[list[float], int]] = []
        self.state = ""
        self.fails = False

    def open(self) -> None:
        self.state = "open"

    def read(self, timeout: float) -> Samples | None:
        given = self.samples.pop(0)
        if isinstance(given, DeviceError):
            raise given
        return given

    def write(self, volts: Array, count: int) -> None:
        if self.fails:
            raise DeviceError("The device Dev2 takes no commands: underflow.")
        self.told.append((volts.tolist(), count))

    def close(self) -> None:
        self.state = "at standstill"


def sample(number: int, volts: Sequence[float] = (2.5, 1.0, -2.0, 0.0)) -> Samples:
    return Samples(number, np.array(volts), np.array([5.0, -10.0]))


# nidaq


def test_volts_become_angles_and_tensions_by_the_calibration(inst: Instrument, settings: NiDaq) -> None:
    tasks = FakeTasks([sample(0)])
    with NiDaqDevice(inst, settings, tasks=tasks, clock=lambda: 7) as device:
        measured = device.read(1.0)
    assert measured is not None
    assert degrees(measured.handle_angle[0]) == pytest.approx(2.5 * 72 - 180, abs=1e-9)
    assert measured.tension.tolist() == [[19.5, 40.0]]
    assert measured.output_angle[0] == 0
    assert measured.spool_angle.tolist() == [[1.0, 2.0]]  # through a gearbox of 5, the second counts down
    assert measured.time == 7


def test_the_file_and_the_arguments_mean_the_same_table(settings: NiDaq, wired: Instrument) -> None:
    assert wired.devices.nidaq is not None
    told, given = wired.devices.nidaq.model_dump(), settings.model_dump()
    for name, value in told["yaw"]["handle_angle"].items():
        assert given["yaw"]["handle_angle"][name] == (value if isinstance(value, str) else pytest.approx(value))
    assert told["yaw"]["antagonist"] == given["yaw"]["antagonist"]
    assert wired.devices.canopen is not None
    assert wired.devices.canopen.velocity_unit == pytest.approx(0.001 * 2 * np.pi / 60)


def test_speeds_become_volts_within_the_limits_and_not_a_number_is_standstill(
    inst: Instrument, settings: NiDaq
) -> None:
    tasks = FakeTasks([sample(0)])
    fastest = inst.drives.motor_speed / inst.drives.gear_ratio
    with NiDaqDevice(inst, settings, tasks=tasks) as device:
        device.read(1.0)
        for speeds in ((0.4, 0.4), (nan, inf), (99.0, -99.0)):
            device.write(np.array([speeds]))
        with pytest.raises(ValueError, match="shape"):
            device.write(np.zeros(2))
    volts = np.array([one for one, _ in tasks.told])
    assert volts[0] == pytest.approx([0.5, 0.02 - 0.5])
    assert volts[1].tolist() == [0.0, 0.02]
    assert volts[2] == pytest.approx([fastest * 5 / MOTOR, 0.02 + fastest * 5 / MOTOR])
    assert tasks.state == "at standstill"


def test_no_command_is_beyond_the_outputs_limit(inst: Instrument, settings: NiDaq) -> None:
    weak = settings.model_copy(update={"output_limit": 1.0})
    tasks = FakeTasks()
    with NiDaqDevice(inst, weak, tasks=tasks) as device:
        device.write(np.array([[99.0, 99.0]]))
    assert tasks.told[0][0] == [1.0, -1.0]


def test_as_many_commands_wait_as_are_told_whatever_was_missed(inst: Instrument, settings: NiDaq) -> None:
    numbers = (0, 1, 2, 7, 8, 8 + AHEAD)
    tasks = FakeTasks([sample(n) for n in numbers])
    with NiDaqDevice(inst, settings, tasks=tasks) as device:
        for _ in numbers:
            device.read(1.0)
            device.write(np.zeros((1, 2)))
        device.write(np.zeros((1, 2)))  # the second for one sample adds none
        assert device.counts["missing"] == 4 + AHEAD - 1
        assert device.capabilities.latency == pytest.approx((1 + AHEAD) * PERIOD_NS / 1e9)
    counts = [count for _, count in tasks.told]
    assert AHEAD + np.cumsum(counts[:-1]) == pytest.approx(np.array(numbers) + 1 + AHEAD)
    assert counts[-1] == 0


def test_time_is_that_of_the_sample_clock_and_the_past_is_not_measured(inst: Instrument, settings: NiDaq) -> None:
    with NiDaqDevice(inst, settings, tasks=FakeTasks([sample(4), sample(9), sample(9), sample(2), None])) as device:
        first, second = device.read(1.0), device.read(1.0)
        assert first is not None and second is not None
        assert second.time - first.time == 5 * PERIOD_NS
        assert [device.read(1.0) for _ in range(3)] == [None] * 3
        assert device.counts["past"] == 2
        assert device.problem == "Sample 2 came after sample 9."


@pytest.mark.parametrize("volts", [10.0, -9.995, nan])
def test_an_open_wire_is_not_a_number_and_named(inst: Instrument, settings: NiDaq, volts: float) -> None:
    with NiDaqDevice(inst, settings, tasks=FakeTasks([sample(0, (0.0, 1.0, volts, 1.0))])) as device:
        measured = device.read(1.0)
        assert measured is not None
        assert np.isnan(measured.tension).tolist() == [[False, True]]
        assert "Input ai2" in device.problem


@pytest.mark.parametrize("fails", ["read", "write"])
def test_a_device_that_fails_is_put_to_standstill(inst: Instrument, settings: NiDaq, fails: str) -> None:
    tasks = FakeTasks([DeviceError("The device Dev2 gives no samples: unplugged.")])
    tasks.fails = fails == "write"
    named = "unplugged" if fails == "read" else "underflow"
    with NiDaqDevice(inst, settings, tasks=tasks) as device:
        with pytest.raises(DeviceError, match=named):
            device.read(1.0) if fails == "read" else device.write(np.ones((1, 2)))
        assert tasks.state == "at standstill"
        with pytest.raises(DeviceError, match=named):
            device.write(np.ones((1, 2)))
    assert not tasks.told


def test_without_its_driver_one_sentence_says_so(inst: Instrument, settings: NiDaq) -> None:
    nidaqmx = pytest.importorskip("nidaqmx")
    try:
        version = nidaqmx.system.System.local().driver_version
    except nidaqmx.errors.Error:
        device = NiDaqDevice(inst, settings)
        with pytest.raises(DeviceError, match=r"^nidaq needs the driver NI-DAQmx, which is not installed.*it\.$"):
            device.open()
        with pytest.raises(DeviceError, match="not open"):
            device.read(1.0)
    else:
        pytest.skip(f"the driver is here: {version}")


def test_counts_that_no_quadrature_encoder_has_are_refused(inst: Instrument, settings: NiDaq) -> None:
    with pytest.raises(InstrumentError, match=r"encoder_counts is 4097; allowed .* multiple of 4"):
        NiDaqDevice(inst.replace(**{"drives.encoder_counts": 4097}), settings)
    with pytest.raises(InstrumentError, match=r"devices\.nidaq\.pitch is missing"):
        NiDaqDevice(tn.load("real-size"), settings)
    with pytest.raises(ValueError, match="'ao0' is given twice"):
        yaw = settings.model_dump()["yaw"]
        NiDaq.model_validate({"yaw": yaw | {"antagonist": yaw["agonist"]}})


def checked(kind: Any, name: str, effect: Callable[..., Any] = lambda *_, **__: None) -> MagicMock:
    """A method of the package nidaqmx that refuses arguments which the real one does not have."""
    signature = inspect.signature(getattr(kind, name))

    def call(*arguments: Any, **named: Any) -> Any:
        signature.bind(None, *arguments, **named)
        return effect(*arguments, **named)

    return MagicMock(side_effect=call)


class FakeNi:
    """The package nidaqmx with its own signatures, and no device behind them."""

    def __init__(self, *, watchdog: bool = True) -> None:
        nidaqmx = pytest.importorskip("nidaqmx")
        readers = pytest.importorskip("nidaqmx.stream_readers")
        writers = pytest.importorskip("nidaqmx.stream_writers")
        for part in ("system", "types"):
            pytest.importorskip(f"nidaqmx.{part}")
        from nidaqmx.task import collections
        from nidaqmx.task._timing import Timing

        self.constants, self.errors, self.types = nidaqmx.constants, nidaqmx.errors, nidaqmx.types
        self.tasks: list[Any] = []
        self.written: list[Array] = []
        self.at_once: list[list[float]] = []
        self.log: list[str] = []
        self.late = False

        def task() -> Any:
            number = len(self.tasks)
            made = SimpleNamespace(
                timing=SimpleNamespace(cfg_samp_clk_timing=checked(Timing, "cfg_samp_clk_timing")),
                in_stream=SimpleNamespace(avail_samp_per_chan=2),
                out_stream=SimpleNamespace(),
                start=checked(nidaqmx.Task, "start", lambda: self.log.append(f"start {number}")),
                close=checked(nidaqmx.Task, "close", lambda: self.log.append(f"close {number}")),
                write=checked(nidaqmx.Task, "write", lambda data, auto_start=False: self.at_once.append(data)),
            )
            for kind, collection, add in (
                ("ai", collections.AIChannelCollection, "add_ai_voltage_chan"),
                ("ao", collections.AOChannelCollection, "add_ao_voltage_chan"),
                ("ci", collections.CIChannelCollection, "add_ci_ang_encoder_chan"),
                ("do", collections.DOChannelCollection, "add_do_chan"),
            ):
                setattr(made, f"{kind}_channels", SimpleNamespace(**{add: checked(collection, add)}))
            self.tasks.append(made)
            return made

        def fill(data: Array, number_of_samples_per_channel: int = -1, timeout: float = 10.0) -> None:
            if self.late:
                raise nidaqmx.errors.DaqReadError("late", -200284, 0)
            data[:] = 1.5

        def keep(data: Array, timeout: float = 10.0) -> None:
            self.written.append(data.copy())

        self.write = checked(writers.AnalogMultiChannelWriter, "write_many_sample", keep)
        reader = SimpleNamespace(read_many_sample=checked(readers.AnalogMultiChannelReader, "read_many_sample", fill))
        counter = SimpleNamespace(
            read_many_sample_double=checked(readers.CounterReader, "read_many_sample_double", fill)
        )
        writer = SimpleNamespace(write_many_sample=self.write)
        self.Task = task
        self.stream_readers = SimpleNamespace(
            AnalogMultiChannelReader=checked(readers.AnalogMultiChannelReader, "__init__", lambda _: reader),
            CounterReader=checked(readers.CounterReader, "__init__", lambda _: counter),
        )
        self.stream_writers = SimpleNamespace(
            AnalogMultiChannelWriter=checked(writers.AnalogMultiChannelWriter, "__init__", lambda _, auto_start: writer)
        )
        kind = nidaqmx.system.WatchdogTask
        methods = ("cfg_watchdog_ao_expir_states", "start", "stop", "close", "reset_timer")
        self.watchdog = SimpleNamespace(**{name: checked(kind, name) for name in methods})

        def armed(device_name: str, timeout: float) -> Any:
            if not watchdog:
                raise nidaqmx.errors.DaqError("it has none", -200077)
            return self.watchdog

        devices = SimpleNamespace(devices=SimpleNamespace(device_names=["Dev1", "Dev2"]))
        self.system = SimpleNamespace(
            WatchdogTask=checked(kind, "__init__", armed), System=SimpleNamespace(local=lambda: devices)
        )


def ni_tasks(settings: NiDaq, ni: FakeNi, **changes: Any) -> NiTasks:
    settings = settings.model_copy(update=changes)
    assert settings.yaw is not None
    return NiTasks(
        settings,
        [one.channel for one in settings.yaw.inputs],
        settings.yaw.drives,
        rate=2000.0,
        encoder_counts=4096,
        ni=ni,
    )


def test_outputs_stand_before_the_clock_starts_and_after_it_stops(settings: NiDaq) -> None:
    ni = FakeNi()
    tasks = ni_tasks(settings, ni, alive="port0/line3")
    tasks.open()
    assert ni.at_once == [[0.0, 0.02]]
    assert ni.written[0].tolist() == [[0.0] * AHEAD, [0.02] * AHEAD]
    rest, analogue, *clocked = range(len(ni.tasks))
    assert ni.log[0] == f"close {rest}"
    assert ni.log[-1] == f"start {analogue}"  # last: it clocks the others
    assert sorted(ni.log[1:-1]) == sorted(f"start {n}" for n in clocked)
    names = [call.args[0] for call in ni.tasks[analogue].ai_channels.add_ai_voltage_chan.call_args_list]
    assert names == ["Dev2/ai0", "Dev2/ai1", "Dev2/ai2", "Dev2/ai3"]
    rates = [task.timing.cfg_samp_clk_timing.call_args.args[0] for task in ni.tasks[1:5]]
    sources = [task.timing.cfg_samp_clk_timing.call_args.kwargs.get("source") for task in ni.tasks[1:5]]
    assert rates == [2000.0] * 4 and sources == [None] + ["/Dev2/ai/SampleClock"] * 3
    regeneration = ni.constants.RegenerationMode.DONT_ALLOW_REGENERATION
    assert ni.tasks[4].out_stream.regen_mode == regeneration
    assert ni.tasks[2].ci_channels.add_ci_ang_encoder_chan.call_args.kwargs["pulses_per_rev"] == 1024
    samples = tasks.read(1.0)
    assert samples is not None and samples.number == 1
    assert samples.volts.tolist() == [1.5] * 4 and samples.turned.tolist() == [1.5] * 2
    for _ in range(2):
        tasks.write(np.array([1.0, 2.0]), 2)
    assert ni.written[-1].tolist() == [[1.0, 1.0], [2.0, 2.0]]
    assert [call.args[0] for call in ni.tasks[5].write.call_args_list] == [True, False]
    tasks.close()
    assert ni.at_once[-1] == [0.0, 0.02]
    assert all(task.close.called for task in ni.tasks)
    closed = len(ni.log)
    tasks.close()
    assert len(ni.log) == closed


def test_a_watchdog_is_armed_where_there_is_one(settings: NiDaq) -> None:
    ni = FakeNi()
    tasks = ni_tasks(settings, ni)
    tasks.open()
    (states,) = ni.watchdog.cfg_watchdog_ao_expir_states.call_args.args
    told = {state.physical_channel: state.expiration_state for state in states}
    assert told == {"Dev2/ao0": 0, "Dev2/ao1": 0.02}
    assert tasks.stops_alone == settings.watchdog
    tasks.write(np.zeros(2), 1)
    assert ni.watchdog.reset_timer.called
    without = ni_tasks(settings, FakeNi(watchdog=False))
    without.open()
    assert isinf(without.stops_alone)


def test_samples_that_are_late_are_none_and_other_errors_are_told(settings: NiDaq) -> None:
    ni = FakeNi()
    tasks = ni_tasks(settings, ni)
    tasks.open()
    ni.late = True
    assert tasks.read(0.01) is None
    ni.write.side_effect = ni.errors.DaqWriteError("underflow\nmore", -200290, 0)
    with pytest.raises(DeviceError, match=r"^The device Dev2 takes no commands: underflow.*\.$"):
        tasks.write(np.zeros(2), 1)
    with pytest.raises(DeviceError, match=r"device is 'Dev9'; allowed is one that the driver knows: Dev1, Dev2"):
        ni_tasks(settings, ni, device="Dev9").open()


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
        (HALF_AS_FAST, "rate is 1000 Hz, allowed is at least 1980 Hz"),
        (JITTERING, "jitter (p99 of intervals) is 1 ms, allowed is at most 0.75 ms"),
        (STALLING, "worst interval is 30.5 ms, allowed is at most 25 ms"),
        (LOSING, "losses is 0.9995 %, allowed is at most 0.1 %"),
        (REPEATING, "losses is 0.2493 %"),
        (RETURNING, "backward in time is 1, allowed is at most 0"),
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
    assert findings.told == {"missing": 63, "late": 42, "saturated": 1980}
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
    result = CliRunner().invoke(cli.app, ["devices"], env={"COLUMNS": "200"})
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

    monkeypatch.setattr(registry, "make", lambda name, inst: Quick(inst, EVEN))
    result = CliRunner().invoke(cli.app, ["devices", "test", "canopen"], env={"COLUMNS": "200"})
    assert result.exit_code == 1
    for told in ("2001 measurements", "interval, p50", "0.5 ms", "rate", "losses", "The script has ended."):
        assert told in result.output


def test_a_device_is_made_from_its_table(wired: Instrument) -> None:
    assert registry.make("nidaq", wired).capabilities.distal_encoder
    canopen = registry.make("canopen", wired.replace(**{"sensors.sampling_rate": 500.0})).capabilities
    assert (canopen.axes, canopen.rate, canopen.distal_encoder) == (("yaw",), 500.0, False)


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("canopen", "real-size has no table devices.canopen"),
        ("nidaq", "real-size has no table devices.nidaq"),
        ("twin", "twin is served by the live loop itself; allowed here are canopen, nidaq"),
        ("toaster", "NAME is 'toaster'; allowed are twin, canopen, nidaq, serial"),
    ],
)
def test_a_device_that_cannot_be_made_is_one_sentence(name: str, named: str) -> None:
    with pytest.raises(DeviceError, match=named):
        registry.make(name, tn.load("real-size"))


def test_a_bad_duration_is_refused(inst: Instrument) -> None:
    with pytest.raises(DeviceError, match=r"--seconds is -1; allowed is"):
        measure(Scripted(inst, EVEN), inst, -1)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (('gain = "72 deg/V", offset', 'gain = "72 deg", offset'), r"devices\.nidaq\.yaw\.handle_angle\.gain"),
        (('gain = "20 N/V"', "gain = 20"), r"devices\.nidaq\.yaw\.agonist_tension\.gain = 20: it has no unit"),
        (("node = 2, reversed", "node = 1, reversed"), r"yaw\.antagonist\.node is 1, which is yaw\.agonist already"),
        (("sub = 1, gain", "sub = 1, gian"), r"devices\.canopen\.yaw\.handle_angle\.gian is not a known key"),
    ],
)
def test_a_table_with_a_slip_is_told_by_key(change: tuple[str, str], named: str) -> None:
    file = (instrument.resources.files("tenodesis") / "instruments" / "real-size.toml").read_text("utf-8")
    assert change[0] in TABLES
    with pytest.raises(InstrumentError, match=named):
        instrument.parse(file + TABLES.replace(*change))

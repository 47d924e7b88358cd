"""The bench at a data acquisition device: volts, samples, and the tasks that the driver is given."""

from collections.abc import Sequence
from importlib import resources
from math import degrees, inf, isinf, nan, pi, radians

import numpy as np
import pytest

import tenodesis as tn
from tenodesis import instrument
from tenodesis.devices.nidaq import AnalogSamples, NiDaqDevice
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import NiDaq
from tenodesis.run import Array

from .conftest import refused
from .ni_stand_in import FakeNi, ni_tasks
from .test_devices import TABLES

AHEAD = 3
PERIOD_NS = 500_000
ENCODER = radians(72)  # per V: 5 V are a turn
CELL = 20.0  # N/V
MOTOR = 4.0  # rad/s/V


@pytest.fixture(scope="module")
def inst() -> Instrument:
    return tn.load("real-size").axis("yaw").replace(**{"drives.gear_ratio": 5.0})


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
    """Samples as they are given; keeps what is written."""

    stops_alone = inf
    unwatched = "It has no watchdog."

    def __init__(self, samples: Sequence[AnalogSamples | DeviceError | None] = ()) -> None:
        self.samples = list(samples)
        self.written: list[tuple[list[float], int]] = []
        self.state = ""
        self.fails = False

    def open(self) -> None:
        self.state = "open"

    def read(self, timeout: float) -> AnalogSamples | None:
        given = self.samples.pop(0)
        if isinstance(given, DeviceError):
            raise given
        return given

    def write(self, volts: Array, count: int) -> None:
        if self.fails:
            raise DeviceError("The device Dev2 takes no commands: underflow.")
        self.written.append((volts.tolist(), count))

    def close(self) -> None:
        self.state = "at standstill"


def sample(number: int, volts: Sequence[float] = (2.5, 1.0, -2.0, 0.0)) -> AnalogSamples:
    return AnalogSamples(number, np.array(volts), np.array([5.0, -10.0]))


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


def test_volts_become_tensions_by_the_currents_of_the_drives(inst: Instrument, settings: NiDaq) -> None:
    currents = {"sensors.kind": "current", "sensors.current_range": 6.0, "drives.torque_constant": 0.1}
    table = settings.model_dump()
    for tendon, channel, gain in (("agonist", "ai1", 0.5), ("antagonist", "ai2", -0.25)):
        table["yaw"][tendon]["current"] = {"channel": channel, "gain": gain, "offset": 0.1}
        del table["yaw"][f"{tendon}_tension"]
    wired = inst.replace(**currents, devices={"nidaq": table})
    assert wired.devices.nidaq is not None
    with NiDaqDevice(wired, wired.devices.nidaq, tasks=FakeTasks([sample(0)])) as device:
        measured = device.read(1.0)
    assert measured is not None
    assert measured.tension[0] == pytest.approx(np.array([0.6, 0.6]) * 0.1 * 5 / inst.drives.spool_radius)
    assert measured.output_angle[0] == 0
    del table["yaw"]["antagonist"]["current"]
    with refused("devices.nidaq.yaw.antagonist.current", kind=InstrumentError):
        inst.replace(**currents, devices={"nidaq": table})
    with refused("devices.nidaq.yaw.agonist_tension", kind=InstrumentError):
        inst.replace(devices={"nidaq": table})


def test_the_file_and_the_arguments_mean_the_same_table(settings: NiDaq) -> None:
    file = (resources.files("tenodesis") / "instruments" / "real-size.toml").read_text("utf-8")
    wired = instrument.parse(file.replace('axes = ["yaw", "pitch"]', 'axes = ["yaw"]') + TABLES)
    assert wired.devices.nidaq is not None
    read, given = wired.devices.nidaq.model_dump(), settings.model_dump()
    for name, value in read["yaw"]["handle_angle"].items():
        assert given["yaw"]["handle_angle"][name] == (value if isinstance(value, str) else pytest.approx(value))
    assert read["yaw"]["antagonist"] == given["yaw"]["antagonist"]
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
        with refused("spool_velocity", allowed="shape (1, 2)"):
            device.write(np.zeros(2))
    volts = np.array([one for one, _ in tasks.written])
    assert volts[0] == pytest.approx([0.5, 0.02 - 0.5])
    assert volts[1].tolist() == [0.0, 0.02]
    assert volts[2] == pytest.approx([fastest * 5 / MOTOR, 0.02 + fastest * 5 / MOTOR])
    assert tasks.state == "at standstill"


def test_no_command_is_beyond_the_outputs_limit(inst: Instrument, settings: NiDaq) -> None:
    weak = settings.model_copy(update={"output_limit": 1.0})
    tasks = FakeTasks()
    with NiDaqDevice(inst, weak, tasks=tasks) as device:
        device.write(np.array([[99.0, 99.0]]))
    assert tasks.written[0][0] == [1.0, -1.0]


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
    counts = [count for _, count in tasks.written]
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


def test_an_angle_that_is_more_than_any_number_is_none(inst: Instrument, settings: NiDaq) -> None:
    yaw = settings.model_dump()["yaw"]
    huge = NiDaq.model_validate({"yaw": yaw | {"handle_angle": {"channel": "ai0", "gain": 1e308}}})
    with NiDaqDevice(inst, huge, tasks=FakeTasks([sample(0, (9.0, 1.0, 1.0, 1.0))])) as device:
        measured = device.read(1.0)
    assert measured is not None and np.isnan(measured.handle_angle[0]) and np.isfinite(measured.tension).all()


@pytest.mark.parametrize("gain", [0.0, nan, inf])
def test_a_gain_that_tells_nothing_is_refused(settings: NiDaq, gain: float) -> None:
    yaw = settings.model_dump()["yaw"]
    for key, one in (("handle_angle", yaw["handle_angle"]), ("agonist", yaw["agonist"])):
        with pytest.raises(ValueError, match=rf"yaw\.{key}\.gain"):
            NiDaq.model_validate({"yaw": yaw | {key: one | {"gain": gain}}})


@pytest.mark.parametrize("signed", [True, False])
def test_a_motor_turns_on_where_its_counter_begins_anew(inst: Instrument, settings: NiDaq, signed: bool) -> None:
    """A counter of 32 bits, read with a sign or without one, that both motors drive over its ends and back."""
    count = 2 * pi / inst.drives.encoder_counts
    counts = np.concatenate([np.linspace(0, 3e9, 5), np.linspace(3e9, -6e9, 9)]).round().astype(np.int64)
    turned = np.stack([counts, -counts], axis=1)
    counted = turned % 2**32
    counted[(counted >= 2**31) & signed] -= 2**32
    samples = [AnalogSamples(n, np.ones(4), row * count) for n, row in enumerate(counted)]
    with NiDaqDevice(inst, settings, tasks=FakeTasks(samples)) as device:
        measured = [device.read(1.0) for _ in samples]
        spools = np.array([one.spool_angle[0] for one in measured if one is not None])
    np.testing.assert_allclose(spools * inst.drives.gear_ratio / count, turned * (1, -1), atol=1e-3)


def test_time_begins_with_the_first_sample_however_late_it_is_read(inst: Instrument, settings: NiDaq) -> None:
    now = [0]
    with NiDaqDevice(inst, settings, tasks=FakeTasks([sample(0), sample(1)]), clock=lambda: now[0]) as device:
        now[0] = 10**9
        first, second = device.read(1.0), device.read(1.0)
    assert first is not None and second is not None
    assert (first.time, second.time) == (10**9, 10**9 + PERIOD_NS)


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
    assert not tasks.written


def test_without_its_driver_one_sentence_says_so(inst: Instrument, settings: NiDaq) -> None:
    nidaqmx = pytest.importorskip("nidaqmx")
    try:
        version = nidaqmx.system.System.local().driver_version
    except nidaqmx.errors.Error:
        device = NiDaqDevice(inst, settings)
        with refused("driver", "NI-DAQmx", kind=DeviceError):
            device.open()
        with refused("state", "closed", kind=DeviceError):
            device.read(1.0)
    else:
        pytest.skip(f"the driver is here: {version}")


def test_counts_that_no_quadrature_encoder_has_are_refused(inst: Instrument, settings: NiDaq) -> None:
    with refused("drives.encoder_counts", 4097, kind=InstrumentError):
        NiDaqDevice(inst.replace(**{"drives.encoder_counts": 4097}), settings)
    with refused("devices.nidaq.pitch", kind=InstrumentError, allowed="given"):
        NiDaqDevice(tn.load("real-size"), settings)
    with pytest.raises(ValueError, match="'ao0' is given twice"):
        yaw = settings.model_dump()["yaw"]
        NiDaq.model_validate({"yaw": yaw | {"antagonist": yaw["agonist"]}})


def test_outputs_stand_before_the_clock_starts_and_after_it_stops(settings: NiDaq) -> None:
    ni = FakeNi()
    tasks = ni_tasks(settings, ni, alive="port0/line3")
    tasks.open()
    assert ni.at_once == [[0.0, 0.02]]
    assert ni.written[0].tolist() == [[0.0] * AHEAD, [0.02] * AHEAD]
    rest, analogue, *clocked = range(len(ni.tasks))
    # However long it takes until somebody reads: the outputs do not run dry meanwhile.
    assert ni.log == [f"close {rest}"]
    samples = tasks.read(1.0)
    assert ni.log[-2:] == ["start watchdog", f"start {analogue}"]  # last: it clocks the others
    assert sorted(ni.log[1:-2]) == sorted(f"start {n}" for n in clocked)
    names = [call.args[0] for call in ni.tasks[analogue].ai_channels.add_ai_voltage_chan.call_args_list]
    assert names == ["Dev2/ai0", "Dev2/ai1", "Dev2/ai2", "Dev2/ai3"]
    rates = [task.timing.cfg_samp_clk_timing.call_args.args[0] for task in ni.tasks[1:5]]
    sources = [task.timing.cfg_samp_clk_timing.call_args.kwargs.get("source") for task in ni.tasks[1:5]]
    assert rates == [2000.0] * 4 and sources == [None] + ["/Dev2/ai/SampleClock"] * 3
    regeneration = ni.constants.RegenerationMode.DONT_ALLOW_REGENERATION
    assert ni.tasks[4].out_stream.regen_mode == regeneration
    assert ni.tasks[2].ci_channels.add_ci_ang_encoder_chan.call_args.kwargs["pulses_per_rev"] == 1024
    assert samples is not None and samples.number == 1
    assert samples.volts.tolist() == [1.5] * 4 and samples.turned.tolist() == [1.5] * 2
    for _ in range(2):
        tasks.write(np.array([1.0, 2.0]), 2)
    assert ni.written[-1].tolist() == [[1.0, 1.0], [2.0, 2.0]]
    assert [call.args[0] for call in ni.tasks[5].write.call_args_list] == [True, False]
    began = len(ni.log)
    tasks.close()
    assert ni.at_once[-1] == [0.0, 0.02]
    assert ni.log[began : began + 2] == ["close 4", "close 6"]  # nothing but standstill follows the outputs' end
    assert all(task.close.called for task in ni.tasks)
    closed = len(ni.log)
    tasks.close()
    assert len(ni.log) == closed


@pytest.mark.parametrize("stuck", [1, 2, 4, 5])
def test_a_task_that_cannot_be_closed_keeps_no_output_from_standstill(settings: NiDaq, stuck: int) -> None:
    ni = FakeNi()
    tasks = ni_tasks(settings, ni, alive="port0/line3")
    tasks.open()
    tasks.read(1.0)
    ni.stuck = stuck
    with refused("devices.nidaq.device", "Dev2", kind=DeviceError):
        tasks.close()
    assert ni.at_once[-1] == [0.0, 0.02]
    assert all(task.close.called for task in ni.tasks)
    assert ni.watchdog.stop.called and ni.watchdog.close.called


def test_outputs_that_cannot_be_put_to_standstill_are_left_to_the_watchdog_and_named(settings: NiDaq) -> None:
    ni = FakeNi()
    tasks = ni_tasks(settings, ni)
    tasks.open()
    tasks.read(1.0)
    ni.unwritable = True
    with refused("devices.nidaq.device", "Dev2", kind=DeviceError):
        tasks.close()
    assert all(task.close.called for task in ni.tasks)
    assert not ni.watchdog.stop.called and not ni.watchdog.close.called


def test_what_fails_at_the_opening_is_told_with_what_fails_after_it(inst: Instrument, settings: NiDaq) -> None:
    ni = FakeNi()
    ni.unwritable = True
    with refused("devices.nidaq.device", "Dev2", kind=DeviceError):
        NiDaqDevice(inst, settings, tasks=ni_tasks(settings, ni)).open()


def test_a_watchdog_is_armed_where_there_is_one(settings: NiDaq) -> None:
    ni = FakeNi()
    tasks = ni_tasks(settings, ni)
    tasks.open()
    assert not ni.watchdog.start.called  # it would expire before the first command
    (states,) = ni.watchdog.cfg_watchdog_ao_expir_states.call_args.args
    written = {state.physical_channel: state.expiration_state for state in states}
    assert written == {"Dev2/ao0": 0, "Dev2/ao1": 0.02}
    assert tasks.stops_alone == settings.watchdog and not tasks.unwatched
    tasks.read(1.0)
    assert ni.watchdog.start.called
    tasks.write(np.zeros(2), 1)
    assert ni.watchdog.reset_timer.called


def test_a_relay_gives_motors_their_supply_only_while_the_bench_is_open(inst: Instrument, settings: NiDaq) -> None:
    for cut in (False, True):
        ni = FakeNi()
        device = NiDaqDevice(inst, settings, tasks=ni_tasks(settings, ni, relay="port0/line4"))
        device.open()
        relay = ni.tasks[-1]
        assert [call.args[0] for call in relay.do_channels.add_do_chan.call_args_list] == ["Dev2/port0/line4"]
        assert [call.args[0] for call in relay.write.call_args_list] == [True]
        (states,) = ni.watchdog.cfg_watchdog_do_expir_states.call_args.args
        assert [(one.physical_channel, one.expiration_state.name) for one in states] == [("Dev2/port0/line4", "LOW")]
        (device.cut_power if cut else device.close)()
        assert relay.write.call_args.args[0] is False
        assert relay.close.called and all(task.close.called for task in ni.tasks)


@pytest.mark.parametrize("ill", ["none", "unfit"])
def test_a_device_without_a_watchdog_says_why(inst: Instrument, settings: NiDaq, ill: str) -> None:
    ni = FakeNi(watchdog=ill != "none")
    if ill == "unfit":
        ni.watchdog.control.side_effect = ni.errors.DaqError("it has none", -200077)
    tasks = ni_tasks(settings, ni)
    with NiDaqDevice(inst, settings, tasks=tasks) as device:
        assert isinf(device.capabilities.stops_alone)
        assert "Dev2 has no watchdog that it could arm" in device.problem and "it has none" in device.problem
        device.read(1.0)
        device.write(np.zeros((1, 2)))
    assert not ni.watchdog.start.called
    assert ni.watchdog.close.called == (ill == "unfit")


def test_samples_that_are_late_are_none_and_other_errors_are_told(settings: NiDaq) -> None:
    ni = FakeNi()
    tasks = ni_tasks(settings, ni)
    tasks.open()
    ni.late = True
    assert tasks.read(0.01) is None
    ni.write.side_effect = ni.errors.DaqWriteError("underflow\nmore", -200290, 0)
    with refused("devices.nidaq.device", "Dev2", kind=DeviceError):
        tasks.write(np.zeros(2), 1)
    with refused("devices.nidaq.device", "Dev9", kind=DeviceError):
        ni_tasks(settings, ni, device="Dev9").open()

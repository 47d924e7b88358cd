"""A bench at a data acquisition device: analogue encoders, load cells and speed commands, clocked by hardware."""

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import inf, nan, pi
from typing import Any, NamedTuple, NoReturn

import numpy as np

from tenodesis.devices.device import Bench, Capabilities, Measurement
from tenodesis.devices.wiring import wiring
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.extras import require
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import NiDaq, NiDrive, NiTension
from tenodesis.run import Array

_BUFFER = 10_000  # samples
_NOT_YET_THERE = -200284
_WIRING = {"differential": "DIFF", "single-ended": "RSE", "default": "DEFAULT"}


class AnalogSamples(NamedTuple):
    """The newest samples of all channels."""

    number: int
    """How many came before, since the start."""
    volts: Array
    """By analogue input."""
    turned: Array
    """By counter, rad of the motor."""


class NiTasks:
    """What a bench needs of a data acquisition device, all on one sample clock, by nidaqmx (`ni`).

    Its failures become DeviceError.

    Samples of the analogue inputs, and of the drives' outputs and counters, are in the order given here, `rate` a
    second; a motor's encoder has `encoder_counts` a turn.
    """

    def __init__(
        self,
        settings: NiDaq,
        inputs: Sequence[str],
        drives: Sequence[NiDrive],
        *,
        rate: float,
        encoder_counts: int,
        ni: Any = None,
    ) -> None:
        self._settings, self._inputs, self._drives = settings, tuple(inputs), tuple(drives)
        self._rate, self._encoder_counts = rate, encoder_counts
        self._ni = ni
        self._standstill = np.array([drive.standstill for drive in drives])
        self._tasks: list[Any] = []
        self._outputs: Any = None
        self._opened = False
        self._runs = False
        self._number = 0
        self._level = False
        self._watchdog: Any = None
        self._alive: Any = None
        self._relay: Any = None
        self.stops_alone = inf
        """Time without a command after which the outputs go to standstill by themselves, s; infinite if never."""
        self.unwatched = ""
        """Why the outputs do not go to standstill by themselves, in a sentence; empty where they do."""

    def open(self) -> None:
        """Put the outputs to standstill and prepare the clock."""
        self._ni = ni = self._ni or _driver()
        with self._named_problems("cannot be opened"):
            names = list(ni.system.System.local().devices.device_names)
            if self._settings.device not in names:
                raise DeviceError(
                    key="devices.nidaq.device",
                    value=self._settings.device,
                    allowed=f"a device of the driver: {', '.join(names) or 'it has none'}",
                )
            self._opened, self._runs = True, False
            self._number = 0
            self._rest()
            self._prepare(ni)

    def _prepare(self, ni: Any) -> None:
        settings, clock = self._settings, f"/{self._settings.device}/ai/SampleClock"
        timing = {"sample_mode": ni.constants.AcquisitionType.CONTINUOUS, "samps_per_chan": _BUFFER}
        analogue = self._task(ni)
        for name in self._inputs:
            analogue.ai_channels.add_ai_voltage_chan(
                self._channel(name),
                terminal_config=getattr(ni.constants.TerminalConfiguration, _WIRING[settings.wiring]),
                min_val=-settings.input_limit,
                max_val=settings.input_limit,
            )
        analogue.timing.cfg_samp_clk_timing(self._rate, **timing)
        self._counters = []
        for drive in self._drives:
            counter = self._task(ni)
            counter.ci_channels.add_ci_ang_encoder_chan(
                self._channel(drive.counter),
                decoding_type=ni.constants.EncoderType.X_4,
                units=ni.constants.AngleUnits.RADIANS,
                pulses_per_rev=self._encoder_counts // _EDGES_PER_PERIOD,
            )
            counter.timing.cfg_samp_clk_timing(self._rate, source=clock, **timing)
            self._counters.append(ni.stream_readers.CounterReader(counter.in_stream))
        self._outputs = outputs = self._output_task(ni)
        outputs.timing.cfg_samp_clk_timing(self._rate, source=clock, **timing)
        outputs.out_stream.output_buf_size = _BUFFER
        outputs.out_stream.regen_mode = ni.constants.RegenerationMode.DONT_ALLOW_REGENERATION
        self._stream = analogue.in_stream
        self._reader = ni.stream_readers.AnalogMultiChannelReader(analogue.in_stream)
        self._writer = ni.stream_writers.AnalogMultiChannelWriter(outputs.out_stream, auto_start=False)
        self._append(self._standstill, settings.ahead)
        if settings.alive is not None:
            self._alive = self._digital_task(ni, settings.alive)
            self._tasks.append(self._alive)
        self._watch(ni)
        if settings.relay is not None:
            self._relay = self._digital_task(ni, settings.relay)
            self._relay.write(True)

    def _run(self) -> None:
        """Start the clock; from now on the outputs run dry unless they are written."""
        analogue, *clocked = self._tasks
        # What is clocked by the analogue inputs waits for them; starting it may take longer than the watchdog waits.
        for task in (*clocked, self._outputs):
            task.start()
        if self._watchdog is not None:
            self._watchdog.start()
        analogue.start()
        self._runs = True

    def _watch(self, ni: Any) -> None:
        """Arm the device's own watchdog, if there is one."""
        self.stops_alone, self.unwatched = inf, ""
        if self._settings.watchdog is None:
            return
        expired = ni.constants.WatchdogAOExpirState.VOLTAGE
        states = [
            ni.types.AOExpirationState(self._channel(drive.speed), drive.standstill, expired) for drive in self._drives
        ]
        try:
            self._watchdog = ni.system.WatchdogTask(self._settings.device, timeout=self._settings.watchdog)
            self._watchdog.cfg_watchdog_ao_expir_states(states)
            if self._settings.relay is not None:
                line = self._channel(self._settings.relay)
                low = ni.types.DOExpirationState(line, ni.constants.Level.LOW)
                self._watchdog.cfg_watchdog_do_expir_states([low])
            self._watchdog.control(ni.constants.TaskMode.TASK_VERIFY)
            self.stops_alone = self._settings.watchdog
        except ni.errors.DaqError as problem:
            self.unwatched = (
                f"The device {self._settings.device} has no watchdog that it could arm, and holds its last speeds when "
                f"this computer hangs: {_first_line(problem)}."
            )
            if self._watchdog is not None:
                self._watchdog.close()
                self._watchdog = None

    def read(self, timeout: float) -> AnalogSamples | None:
        """Return the newest samples, once there are some that were not read; None if there are none within a time, s.

        The first call starts the clock; from then on every sample must be answered.
        """
        with self._named_problems("gives no samples"):
            if not self._runs:
                self._run()
            count = max(1, int(self._stream.avail_samp_per_chan))
            volts = np.empty((len(self._inputs), count))
            try:
                self._reader.read_many_sample(volts, count, timeout)
            except self._ni.errors.DaqReadError as problem:
                if problem.error_code == _NOT_YET_THERE:
                    return None
                raise
            turned = np.empty((len(self._drives), count))
            for row, reader in zip(turned, self._counters, strict=True):
                reader.read_many_sample_double(row, count, timeout)
        self._number += count
        return AnalogSamples(self._number - 1, volts[:, -1], turned[:, -1])

    def write(self, volts: Array, count: int) -> None:
        """Append `count` equal samples, shape (outputs,), to those that wait, and show that we are alive."""
        with self._named_problems("takes no commands"):
            if count:
                self._append(volts, count)
            if self._watchdog is not None:
                self._watchdog.reset_timer()
            if self._alive is not None:
                self._level = not self._level
                self._alive.write(self._level)

    def cut_power(self) -> None:
        """Open the relay in the motors' supply, if there is one."""
        if self._relay is not None:
            with self._named_problems("cannot open the relay; switch the motors off by hand"):
                self._relay.write(False)

    def close(self) -> None:
        """Put the outputs to standstill, stop the clock, and open the relay."""
        if not self._opened:
            return
        self._opened = False
        problems: list[str] = []

        def done(act: Callable[[], Any]) -> bool:
            try:
                act()
            except self._ni.errors.Error as problem:
                problems.append(_first_line(problem))
                return False
            return True

        # Outputs come first: between the end of their task and standstill they hold the last speed.
        if self._outputs is not None:
            done(self._outputs.close)
        rests = done(self._rest)
        while self._tasks:
            done(self._tasks.pop().close)
        # What failed to close may have kept the outputs.
        rests = rests or done(self._rest)
        relay, self._relay = self._relay, None
        if relay is not None:
            # A digital line keeps its level when its task ends.
            done(lambda: relay.write(False))
            done(relay.close)
        if self._watchdog is not None and rests:
            done(self._watchdog.stop)
            done(self._watchdog.close)
        self._outputs = self._alive = self._watchdog = None
        if problems:
            what = "cannot be released" if rests else "cannot be put to standstill; switch the motors off by hand"
            raise DeviceError(
                f"The device {self._settings.device} {what}: {problems[0]}.",
                key="devices.nidaq.device",
                value=self._settings.device,
            )

    def _rest(self) -> None:
        """Put the outputs to standstill at once, without the clock."""
        outputs = self._output_task(self._ni)
        try:
            outputs.write(self._standstill.tolist(), auto_start=True)
        finally:
            outputs.close()

    def _append(self, volts: Array, count: int) -> None:
        self._writer.write_many_sample(np.ascontiguousarray(np.repeat(volts[:, np.newaxis], count, 1)))

    def _task(self, ni: Any) -> Any:
        task = ni.Task()
        self._tasks.append(task)
        return task

    def _digital_task(self, ni: Any, line: str) -> Any:
        task = ni.Task()
        task.do_channels.add_do_chan(self._channel(line))
        return task

    def _output_task(self, ni: Any) -> Any:
        task = ni.Task()
        for drive in self._drives:
            task.ao_channels.add_ao_voltage_chan(
                self._channel(drive.speed), min_val=-self._settings.output_limit, max_val=self._settings.output_limit
            )
        return task

    def _channel(self, name: str) -> str:
        return f"{self._settings.device}/{name}"

    @contextlib.contextmanager
    def _named_problems(self, what: str) -> Iterator[None]:
        try:
            yield
        except self._ni.errors.Error as problem:
            raise DeviceError(
                f"The device {self._settings.device} {what}: {_first_line(problem)}.",
                key="devices.nidaq.device",
                value=self._settings.device,
            ) from None


def _first_line(problem: Exception) -> str:
    return str(problem).split("\n")[0].rstrip(".")


def _driver() -> Any:
    """Return the package nidaqmx, once it has found the driver."""
    ni: Any = require("nidaqmx", "devices")
    for part in ("system", "constants", "errors", "stream_readers", "stream_writers", "types"):
        require(f"nidaqmx.{part}", "devices")
    try:
        _ = ni.system.System.local().driver_version
    except ni.errors.Error:
        raise DeviceError(
            "nidaq needs the driver NI-DAQmx, which is not installed on this computer; install it from National "
            "Instruments, and the device appears in it.",
            key="driver",
            value="NI-DAQmx",
            allowed="installed",
        ) from None
    return ni


_SATURATED = 0.999
"""Share of the inputs' range beyond which a voltage means an open wire."""
_EDGES_PER_PERIOD = 4
_COUNTS = 2**32
"""After which a counter wraps."""


class NiDaqDevice(Bench):
    """A bench at a data acquisition device.

    Tasks read and write volts; by default they are the device's own. The clock (ns) times the first sample; those after
    it follow the device's clock. Raises InstrumentError if the instrument file does not describe how its bench is
    wired.
    """

    def __init__(
        self,
        inst: Instrument,
        settings: NiDaq,
        *,
        tasks: NiTasks | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._wiring = plan = wiring(inst, settings, "nidaq", _current)
        if tasks is None and inst.drives.encoder_counts % _EDGES_PER_PERIOD:
            raise InstrumentError(
                key="drives.encoder_counts",
                value=inst.drives.encoder_counts,
                allowed=f"a multiple of {_EDGES_PER_PERIOD}: nidaq counts all edges",
            )
        self._settings, self._clock = settings, clock
        rate = inst.sensors.sampling_rate
        wired = [plug.part for plug in plan.sensors]
        drives = [plug.part for plug in plan.drives]
        self._channels = [one.channel for one in wired]
        self._places = [plug.place for plug in plan.sensors]
        self._spools = [plug.place for plug in plan.drives]
        self._gains = np.array([one.gain for one in wired])
        self._offsets = np.array([one.offset for one in wired])
        self._limit = _SATURATED * settings.input_limit
        self._turns = np.array([-1.0 if drive.reversed else 1.0 for drive in drives]) / inst.drives.gear_ratio
        self._standstill = np.array([drive.standstill for drive in drives])
        with np.errstate(over="ignore"):
            self._volts_per_speed = inst.drives.gear_ratio / np.array([drive.gain for drive in drives])
        self._period = 1e9 / rate
        self._tasks = tasks or NiTasks(
            settings, self._channels, drives, rate=rate, encoder_counts=inst.drives.encoder_counts
        )
        super().__init__(
            Capabilities(
                name="nidaq",
                axes=plan.names.joints,
                rate=rate,
                clocked=True,
                simulated=False,
                distal_encoder=plan.distal,
                latency=(1 + settings.ahead) / rate,
                stops_alone=self._tasks.stops_alone,
                tendons=plan.tendons,
            ),
            inst.drives.motor_speed / inst.drives.gear_ratio,
        )
        self._turn = _COUNTS * 2 * pi / inst.drives.encoder_counts
        self._counted, self._wraps = np.zeros((2, len(drives)))
        self._started: int | None = None
        self._newest = -1
        self._appended = 0

    def open(self) -> None:
        """Put the outputs to standstill; the first `read` starts the clock."""
        self._begin()
        try:
            self._tasks.open()
        except BaseException as problem:
            try:
                self._tasks.close()
            except DeviceError as worse:
                raise DeviceError(f"{problem} {worse}", key=worse.key, value=worse.value) from None
            raise
        self._opened = True
        self.capabilities = replace(self.capabilities, stops_alone=self._tasks.stops_alone)
        self.problem = self._tasks.unwatched
        self._started = None
        self._newest = -1
        self._appended = self._settings.ahead
        self._counted, self._wraps = np.zeros((2, len(self._turns)))

    def read(self, timeout: float) -> Measurement | None:
        """Return the newest sample, once it has not been read yet."""
        self._refuse()
        try:
            samples = self._tasks.read(timeout)
        except DeviceError as problem:
            self._fail(problem)
        if samples is None:
            return None
        step = samples.number - self._newest
        if step < 1:
            self._note("past", f"Sample {samples.number} came after sample {self._newest}.")
            return None
        if step > 1:
            self._note("missing", f"{step - 1} samples came faster than they were read.", step - 1)
        self._newest = samples.number
        if self._started is None:
            self._started = self._clock() - round(samples.number * self._period)
        there = np.abs(samples.volts) < self._limit
        if not there.all():
            place = self._channels[int(np.argmin(there))]
            self._note("saturated", f"Input {place} is at the end of its range; look for an open wire.")
        with np.errstate(over="ignore"):
            values = self._gains * samples.volts + self._offsets
        values[~(there & np.isfinite(values))] = nan
        names = self._wiring.names
        row = np.full(len(names.handle_joints) + len(names.tendons) + len(names.joints), nan)
        row[self._places] = values
        handle, tension, output = self._wiring.split(row)
        spools = np.full(len(names.tendons), nan)
        spools[self._spools] = self._unwrapped(samples.turned) * self._turns
        measured_at = self._started + round(samples.number * self._period)
        return Measurement(measured_at, handle, tension, spools.reshape(tension.shape), output)

    def write(self, spool_velocity: Array) -> None:
        """Append a speed to those that wait in the device, as many times as samples have passed."""
        self._refuse()
        speeds = self._speeds(spool_velocity).ravel()[self._spools]
        limit = self._settings.output_limit
        with np.errstate(invalid="ignore"):
            volts = np.clip(self._standstill + speeds * self._volts_per_speed, -limit, limit)
        volts = np.where(np.isfinite(volts), volts, self._standstill)
        count = max(0, self._newest + 1 + self._settings.ahead - self._appended)
        self._appended += count
        try:
            self._tasks.write(volts, count)
        except DeviceError as problem:
            self._fail(problem)

    def cut_power(self) -> None:
        """Open the relay in the motors' supply, if there is one, and close."""
        self._refuse()
        try:
            self._tasks.cut_power()
        except DeviceError as problem:
            self._fail(problem)
        self.close()

    def close(self) -> None:
        """Put the outputs to standstill and let go of the device."""
        if self._opened:
            self._opened = False
            self._tasks.close()

    def _unwrapped(self, turned: Array) -> Array:
        """Return how far the motors have turned, beyond what a counter holds, rad."""
        moved = turned - self._counted
        self._wraps -= np.nan_to_num(np.round(moved / self._turn))
        self._counted = turned
        return turned + self._wraps * self._turn

    def _fail(self, problem: DeviceError) -> NoReturn:
        """Put the outputs to standstill and raise."""
        self._failed = problem
        try:
            self.close()
        except DeviceError as worse:
            self._failed = DeviceError(f"{problem} {worse}", key=problem.key, value=problem.value)
        raise self._failed


def _current(drive: NiDrive, per_current: float) -> NiTension:
    """Return the source of a drive's current as that of a tension; the file has been checked for it."""
    assert drive.current is not None
    one = drive.current
    return NiTension(channel=one.channel, gain=one.gain * per_current, offset=one.offset * per_current)

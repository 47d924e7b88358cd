"""The tasks of a data acquisition device, in volts and radians of the motors, by nidaqmx."""

import contextlib
import importlib
from collections.abc import Iterator, Sequence
from math import inf
from typing import Any, NamedTuple, Protocol

import numpy as np

from tenodesis.devices.settings import NiDaq, NiDrive
from tenodesis.errors import DeviceError
from tenodesis.signals import Array

_BUFFER = 10_000  # samples
_NOT_YET_THERE = -200284
_EDGES_PER_PERIOD = 4
_WIRING = {"differential": "DIFF", "single-ended": "RSE", "default": "DEFAULT"}


class Samples(NamedTuple):
    """The newest samples of all channels."""

    number: int
    """How many came before, since the start."""
    volts: Array
    """By analogue input."""
    turned: Array
    """By counter, rad of the motor."""


class Tasks(Protocol):
    """What a bench needs of a data acquisition device, all on one sample clock."""

    @property
    def stops_alone(self) -> float:
        """Time without a command after which the outputs go to standstill by themselves, s; infinite if never."""
        ...

    def open(self) -> None:
        """Put the outputs to standstill and start the clock."""
        ...

    def read(self, timeout: float) -> Samples | None:
        """Return the newest samples, once there are some that were not read; None if there are none within a time."""
        ...

    def write(self, volts: Array, count: int) -> None:
        """Append so many equal samples, shape (outputs,), to those that wait."""
        ...

    def close(self) -> None:
        """Put the outputs to standstill and stop the clock."""
        ...


class NiTasks:
    """The tasks by nidaqmx; whatever fails there raises DeviceError.

    Parameters
    ----------
    settings
        Table devices.nidaq.
    inputs
        Analogue inputs, in the order of the samples.
    drives
        Drives, in the order of the outputs and of the counters.
    rate
        Samples per second.
    encoder_counts
        Counts per turn of a motor.
    ni
        The package nidaqmx.
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
        self._opened = False
        self._number = 0
        self._level = False
        self._watchdog: Any = None
        self._alive: Any = None
        self.stops_alone = inf

    def open(self) -> None:
        """Put the outputs to standstill and start the clock."""
        self._ni = ni = self._ni or _driver()
        with self._told("cannot be opened"):
            names = list(ni.system.System.local().devices.device_names)
            if self._settings.device not in names:
                raise DeviceError(
                    f"devices.nidaq.device is {self._settings.device!r}; allowed is one that the driver knows: "
                    f"{', '.join(names) or 'it knows none'}."
                )
            self._opened = True
            self._rest()
            self._start(ni)

    def _start(self, ni: Any) -> None:
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
        outputs = self._output_task(ni)
        outputs.timing.cfg_samp_clk_timing(self._rate, source=clock, **timing)
        outputs.out_stream.output_buf_size = _BUFFER
        outputs.out_stream.regen_mode = ni.constants.RegenerationMode.DONT_ALLOW_REGENERATION
        self._stream = analogue.in_stream
        self._reader = ni.stream_readers.AnalogMultiChannelReader(analogue.in_stream)
        self._writer = ni.stream_writers.AnalogMultiChannelWriter(outputs.out_stream, auto_start=False)
        self._append(self._standstill, settings.ahead)
        if settings.alive is not None:
            self._alive = self._task(ni)
            self._alive.do_channels.add_do_chan(self._channel(settings.alive))
        self._watch(ni)
        # What is clocked by the analogue inputs waits for them.
        for task in self._tasks[1:]:
            task.start()
        analogue.start()
        self._number = 0

    def _watch(self, ni: Any) -> None:
        """Arm the device's own watchdog, if it has one."""
        if self._settings.watchdog is None:
            return
        expired = ni.constants.WatchdogAOExpirState.VOLTAGE
        states = [
            ni.types.AOExpirationState(self._channel(drive.speed), drive.standstill, expired) for drive in self._drives
        ]
        try:
            self._watchdog = ni.system.WatchdogTask(self._settings.device, timeout=self._settings.watchdog)
            self._watchdog.cfg_watchdog_ao_expir_states(states)
            self._watchdog.start()
            self.stops_alone = self._settings.watchdog
        except ni.errors.DaqError:
            # Few devices have one; that this one has not, capabilities say.
            if self._watchdog is not None:
                self._watchdog.close()
            self._watchdog, self.stops_alone = None, inf

    def read(self, timeout: float) -> Samples | None:
        """Return the newest samples."""
        with self._told("gives no samples"):
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
        return Samples(self._number - 1, volts[:, -1], turned[:, -1])

    def write(self, volts: Array, count: int) -> None:
        """Append samples, and show that we are alive."""
        with self._told("takes no commands"):
            if count:
                self._append(volts, count)
            if self._watchdog is not None:
                self._watchdog.reset_timer()
            if self._alive is not None:
                self._level = not self._level
                self._alive.write(self._level)

    def close(self) -> None:
        """Put the outputs to standstill and stop the clock."""
        if not self._opened:
            return
        self._opened = False
        with self._told("cannot be put to standstill; switch the motors off by hand"):
            try:
                while self._tasks:
                    self._tasks.pop().close()
            finally:
                self._rest()
                if self._watchdog is not None:
                    self._watchdog.stop()
                    self._watchdog.close()
                    self._watchdog = None

    def _rest(self) -> None:
        """Put the outputs to standstill at once, without the clock."""
        outputs = self._output_task(self._ni)
        try:
            outputs.write(self._standstill.tolist(), auto_start=True)
        finally:
            self._tasks.remove(outputs)
            outputs.close()

    def _append(self, volts: Array, count: int) -> None:
        self._writer.write_many_sample(np.ascontiguousarray(np.repeat(volts[:, np.newaxis], count, 1)))

    def _task(self, ni: Any) -> Any:
        task = ni.Task()
        self._tasks.append(task)
        return task

    def _output_task(self, ni: Any) -> Any:
        task = self._task(ni)
        for drive in self._drives:
            task.ao_channels.add_ao_voltage_chan(
                self._channel(drive.speed), min_val=-self._settings.output_limit, max_val=self._settings.output_limit
            )
        return task

    def _channel(self, name: str) -> str:
        return f"{self._settings.device}/{name}"

    @contextlib.contextmanager
    def _told(self, what: str) -> Iterator[None]:
        try:
            yield
        except self._ni.errors.Error as problem:
            text = str(problem).split("\n")[0].rstrip(".")
            raise DeviceError(f"The device {self._settings.device} {what}: {text}.") from None


def _driver() -> Any:
    """Return the package nidaqmx, once it has found the driver."""
    try:
        ni = importlib.import_module("nidaqmx")
        for part in ("system", "constants", "errors", "stream_readers", "stream_writers", "types"):
            importlib.import_module(f"nidaqmx.{part}")
    except ImportError:
        raise DeviceError("nidaq needs the Python package nidaqmx, which is not installed; pip installs it.") from None
    try:
        _ = ni.system.System.local().driver_version
    except ni.errors.Error:
        raise DeviceError(
            "nidaq needs the driver NI-DAQmx, which is not installed on this computer; install it from National "
            "Instruments, and the device appears in it."
        ) from None
    return ni

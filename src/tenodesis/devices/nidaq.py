"""A bench at a data acquisition device: analogue encoders, load cells and speed commands, clocked by hardware."""

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from math import nan
from types import TracebackType
from typing import Self

import numpy as np

from tenodesis.devices.device import Capabilities, Measurement
from tenodesis.devices.nidaq_tasks import NiTasks, Tasks
from tenodesis.devices.settings import NiAxis, NiDaq
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.signals import Array

_SATURATED = 0.999
"""Of the inputs' range, beyond which a voltage says nothing: an open wire is there."""
_EDGES_PER_PERIOD = 4


class NiDaqDevice:
    """A bench at a data acquisition device.

    Parameters
    ----------
    inst
        The instrument.
    settings
        Its table devices.nidaq.
    tasks
        What reads and writes volts; by default the device's own.
    clock
        What the first sample is timed by, ns; those after it follow the device's clock.

    Raises
    ------
    InstrumentError
        The instrument file does not tell how its bench is served.
    """

    def __init__(
        self,
        inst: Instrument,
        settings: NiDaq,
        *,
        tasks: Tasks | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        axes: list[NiAxis] = []
        for name in inst.axes:
            axis: NiAxis | None = getattr(settings, name)
            if axis is None:
                raise InstrumentError(f"devices.nidaq.{name} is missing; {inst.name} has that axis.")
            axes.append(axis)
        if tasks is None and inst.drives.encoder_counts % _EDGES_PER_PERIOD:
            raise InstrumentError(
                f"drives.encoder_counts is {inst.drives.encoder_counts}; allowed with nidaq, which counts all edges of "
                f"a quadrature encoder, is a multiple of {_EDGES_PER_PERIOD}."
            )
        self._axes, self._settings, self._clock = axes, settings, clock
        rate = inst.sensors.sampling_rate
        wired = [one for axis in axes for one in axis.inputs]
        drives = [drive for axis in axes for drive in axis.drives]
        self._gains = np.array([one.gain for one in wired])
        self._offsets = np.array([one.offset for one in wired])
        self._limit = _SATURATED * settings.input_limit
        self._turns = np.array([-1.0 if drive.reversed else 1.0 for drive in drives]) / inst.drives.gear_ratio
        self._standstill = np.array([drive.standstill for drive in drives])
        self._volts_per_speed = inst.drives.gear_ratio / np.array([drive.gain for drive in drives])
        self._speed_limit = inst.drives.motor_speed / inst.drives.gear_ratio
        self._period = 1e9 / rate
        self._tasks: Tasks = tasks or NiTasks(
            settings,
            [one.channel for one in wired],
            drives,
            rate=rate,
            encoder_counts=inst.drives.encoder_counts,
        )
        self._opened = False
        self._failed: DeviceError | None = None
        self._started = 0
        self._newest = -1
        self._appended = 0
        self.counts: Counter[str] = Counter()
        """Samples by what was wrong with them: missing, past, saturated."""
        self.problem = ""
        """What was wrong last, in one sentence."""
        self.capabilities = Capabilities(
            name="nidaq",
            axes=inst.axes,
            rate=rate,
            clocked=True,
            simulated=False,
            distal_encoder=all(axis.output_angle is not None for axis in axes),
            latency=(1 + settings.ahead) / rate,
            stops_alone=self._tasks.stops_alone,
        )

    def open(self) -> None:
        """Put the outputs to standstill and start the clock."""
        if self._opened:
            raise DeviceError("The nidaq bench is open already; close it first.")
        self._failed = None
        try:
            self._tasks.open()
        except BaseException:
            self._tasks.close()
            raise
        self._opened = True
        self.capabilities = replace(self.capabilities, stops_alone=self._tasks.stops_alone)
        self._started = self._clock()
        self._newest = -1
        self._appended = self._settings.ahead
        self.counts.clear()
        self.problem = ""

    def read(self, timeout: float) -> Measurement | None:
        """Return the newest sample, once there is one that was not read."""
        self._refuse()
        try:
            samples = self._tasks.read(timeout)
        except DeviceError as problem:
            self._fail(problem)
        if samples is None:
            return None
        step = samples.number - self._newest
        if step < 1:
            self._tell("past", f"Sample {samples.number} came after sample {self._newest}.")
            return None
        if step > 1:
            self._tell("missing", f"{step - 1} samples came faster than they were read.", step - 1)
        self._newest = samples.number
        there = np.abs(samples.volts) < self._limit
        if not there.all():
            place = self._axes_inputs()[int(np.argmin(there))]
            self._tell("saturated", f"Input {place} is at the end of its range; look for an open wire.")
        values = np.where(there, self._gains * samples.volts + self._offsets, nan)
        turned = (samples.turned * self._turns).reshape(-1, 2)
        rows = np.full((len(self._axes), 4), nan)
        first = 0
        for row, axis in zip(rows, self._axes, strict=True):
            count = len(axis.inputs)
            row[:count] = values[first : first + count]
            first += count
        measured_at = self._started + round(samples.number * self._period)
        return Measurement(measured_at, rows[:, 0], rows[:, 1:3], turned, rows[:, 3])

    def write(self, spool_velocity: Array) -> None:
        """Append a speed to those that wait in the device, as many times as samples have passed."""
        self._refuse()
        speeds = np.asarray(spool_velocity, float)
        if speeds.shape != (len(self._axes), 2):
            raise ValueError(f"spool_velocity has shape {speeds.shape}; allowed is {(len(self._axes), 2)}.")
        told = np.where(np.isfinite(speeds), np.clip(speeds, -self._speed_limit, self._speed_limit), 0.0).ravel()
        limit = self._settings.output_limit
        volts = np.clip(self._standstill + told * self._volts_per_speed, -limit, limit)
        count = max(0, self._newest + 1 + self._settings.ahead - self._appended)
        self._appended += count
        try:
            self._tasks.write(volts, count)
        except DeviceError as problem:
            self._fail(problem)

    def close(self) -> None:
        """Put the outputs to standstill and let go of the device."""
        if self._opened:
            self._opened = False
            self._tasks.close()

    def __enter__(self) -> Self:
        """Open."""
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()

    def _axes_inputs(self) -> list[str]:
        return [one.channel for axis in self._axes for one in axis.inputs]

    def _refuse(self) -> None:
        if self._failed is not None:
            raise DeviceError(str(self._failed))
        if not self._opened:
            raise DeviceError("The nidaq bench is not open; open it first.")

    def _fail(self, problem: DeviceError) -> None:
        """Put the outputs to standstill and raise."""
        self._failed = problem
        try:
            self.close()
        except DeviceError as worse:
            self._failed = DeviceError(f"{problem} {worse}")
        raise self._failed

    def _tell(self, kind: str, sentence: str, count: int = 1) -> None:
        self.counts[kind] += count
        self.problem = sentence

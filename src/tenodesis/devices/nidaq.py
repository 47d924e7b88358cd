"""A bench at a data acquisition device: analogue encoders, load cells and speed commands, clocked by hardware."""

import time
from collections.abc import Callable
from dataclasses import replace
from math import nan, pi
from typing import NoReturn

import numpy as np

from tenodesis.devices.device import Bench, Capabilities, Measurement
from tenodesis.devices.nidaq_tasks import NiTasks
from tenodesis.devices.wiring import wiring
from tenodesis.errors import DeviceError, InstrumentError
from tenodesis.instrument import Instrument
from tenodesis.instrument.devices import NiDaq, NiDrive, NiTension
from tenodesis.run import Array

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
                f"drives.encoder_counts is {inst.drives.encoder_counts}; nidaq counts all edges of a "
                f"quadrature encoder, so it must be a multiple of {_EDGES_PER_PERIOD}."
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
            settings,
            self._channels,
            drives,
            rate=rate,
            encoder_counts=inst.drives.encoder_counts,
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
                raise DeviceError(f"{problem} {worse}") from None
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
            self._failed = DeviceError(f"{problem} {worse}")
        raise self._failed


def _current(drive: NiDrive, per_current: float) -> NiTension:
    """Return the source of a drive's current as that of a tension; the file has been checked for it."""
    assert drive.current is not None
    one = drive.current
    return NiTension(channel=one.channel, gain=one.gain * per_current, offset=one.offset * per_current)

"""Whether a device keeps time well enough for the controller: rate, jitter, losses, with the motors at rest."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite, nan, pi

import numpy as np

from tenodesis.devices.device import Device
from tenodesis.errors import DeviceError
from tenodesis.instrument import Instrument
from tenodesis.run import Array

LEAST_RATE = 0.99
"""Of the controller's rate."""
MOST_JITTER = 1.5
"""Of a period: the 99th percentile of the intervals between measurements."""
MOST_LOSSES = 1e-3
"""Of the measurements."""
MOST_TURN = 8
"""Encoder counts by which a spool at rest may turn."""
_PATIENCE = 4
"""Periods for which a measurement is waited for, as the live loop does."""
_SENSORS = ("handle_angle", "tension", "spool_angle")


@dataclass(frozen=True)
class Bound:
    """What was measured, in its unit, and what it may be."""

    name: str
    value: float
    limit: float
    unit: str
    at_least: bool = False

    @property
    def kept(self) -> bool:
        """Whether it is as it may be."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit


@dataclass(frozen=True)
class Findings:
    """What a communication test has found."""

    name: str
    period: float
    """Of the controller, s."""
    intervals: Array
    """Between measurements, s."""
    round_trips: Array
    """s; empty where the device does not measure them."""
    measurements: int
    """How many there were."""
    missed: int
    """Reads without a measurement, in time."""
    twice: int
    """Measurements with the time of the measurement before."""
    flawed: int
    """Measurements of which the device missed a part, or had parts that came late, twice, short or from the past."""
    backward: int
    """Measurements of an earlier instant."""
    counted: Mapping[str, int] = field(default_factory=dict)
    """Problems that the device itself counted, by kind."""
    blind: Mapping[str, int] = field(default_factory=dict)
    """Measurements in which a sensor gave nothing."""
    turned: float = 0.0
    """Largest angle by which a spool turned, rad."""
    watchdog: float = inf
    """Time without a tick after which the controller stops, s."""
    counts_per_radian: float = 1.0
    """Of a spool's encoder."""
    problem: str = ""
    """Why it ended early."""

    def quantile(self, share: float) -> float:
        """Return a quantile of the intervals, s; NaN without any."""
        return float(np.quantile(self.intervals, share)) if self.intervals.size else nan

    @property
    def bounds(self) -> tuple[Bound, ...]:
        """All that must be kept."""
        duration = float(self.intervals.sum())
        rate = self.intervals.size / duration if duration > 0 else 0.0
        asked = self.measurements + self.missed
        share = (self.missed + self.twice + self.flawed) / asked if asked else 1.0
        bounds = [
            Bound("rate", rate, LEAST_RATE / self.period, "Hz", at_least=True),
            Bound("jitter (p99 of intervals)", self._or_worst(0.99) * 1e3, MOST_JITTER * self.period * 1e3, "ms"),
            Bound("worst interval", self._or_worst(1.0) * 1e3, self.watchdog * 1e3, "ms"),
            Bound("losses", 100 * share, 100 * MOST_LOSSES, "%"),
            Bound("backward in time", self.backward, 0, ""),
            Bound("sensors without a value", sum(self.blind.values()), MOST_LOSSES * self.measurements, ""),
            Bound("spools turned", self.turned * self.counts_per_radian, MOST_TURN, "counts"),
        ]
        if self.round_trips.size:
            trip = float(np.quantile(self.round_trips, 0.99))
            bounds.append(Bound("round trip (p99)", trip * 1e3, self.period * 1e3, "ms"))
        return tuple(bounds)

    def _or_worst(self, share: float) -> float:
        value = self.quantile(share)
        return value if isfinite(value) else inf

    @property
    def good(self) -> bool:
        """Whether it is good enough."""
        return not self.problem and all(bound.kept for bound in self.bounds)

    @property
    def verdict(self) -> str:
        """Whether the device is good enough for the controller, in one sentence."""
        rate = f"{1 / self.period:.4g} Hz"
        if self.problem:
            return f"{self.name} is not good enough for a controller at {rate}: it failed. {self.problem}"
        failed = [
            f"{bound.name} is {bound.value:.4g} {bound.unit}".rstrip()
            + f", must be {'at least' if bound.at_least else 'at most'} {bound.limit:.4g} {bound.unit}".rstrip()
            for bound in self.bounds
            if not bound.kept
        ]
        if failed:
            return f"{self.name} is not good enough for a controller at {rate}: {'; '.join(failed)}."
        return f"{self.name} is good enough for a controller at {rate}."


def measure(
    device: Device,
    inst: Instrument,
    seconds: float,
    progress: Callable[[float], None] = lambda _: None,
    *,
    clock: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Findings:
    """Read a device for a time as the live loop does, its motors commanded to rest with every tick.

    The device is not open yet; the instrument's sampling period is the controller's. Times are in s, `progress` is
    called with the time done, and clock and sleep are the test's own. Raises DeviceError if the device cannot be
    opened, or the time is not one.
    """
    if not 0 < seconds <= 3600:
        raise DeviceError(key="--seconds", value=seconds, allowed="a time above 0 and up to 3600 s")
    period = 1 / inst.sensors.sampling_rate
    rest = np.zeros(device.capabilities.spools)
    times: list[int] = []
    trips: list[float] = []
    blind = dict.fromkeys(_SENSORS, 0)
    missed = flawed = 0
    least, most = np.full(rest.shape, inf), np.full(rest.shape, -inf)
    problem = ""
    with device:
        began = due = clock()
        try:
            while (now := clock()) - began < seconds:
                before = _faults(device)
                measured = device.read(_PATIENCE * period)
                device.write(rest)
                progress(now - began)
                if measured is None:
                    missed += 1
                    continue
                times.append(measured.time)
                flawed += _faults(device) > before
                trip = float(getattr(device, "round_trip", nan))
                if isfinite(trip):
                    trips.append(trip)
                for name in _SENSORS:
                    blind[name] += bool(np.isnan(getattr(measured, name)).any())
                least, most = np.fmin(least, measured.spool_angle), np.fmax(most, measured.spool_angle)
                if not device.capabilities.clocked:
                    due = max(due + period, clock())
                    sleep(max(0.0, due - clock()))
        except DeviceError as failed:
            problem = str(failed)
        counted: Mapping[str, int] = dict(getattr(device, "counts", {}))
    instants = np.array(times, np.int64)
    steps = instants[1:] - instants[:-1]
    # A measurement that lies before the one it follows is no interval.
    intervals = steps[steps > 0] / 1e9
    turned = np.where(np.isfinite(most - least), most - least, 0.0)
    return Findings(
        name=device.capabilities.name,
        period=period,
        intervals=intervals,
        round_trips=np.array(trips),
        measurements=len(times),
        missed=missed,
        flawed=flawed,
        twice=int((steps == 0).sum()),
        backward=int((steps < 0).sum()),
        counted=counted,
        blind=blind,
        turned=float(turned.max()),
        watchdog=inst.control.watchdog,
        counts_per_radian=inst.drives.encoder_counts * inst.drives.gear_ratio / (2 * pi),
        problem=problem,
    )


def _faults(device: Device) -> int:
    """Return how many losses a device has counted; a sensor at its end is none."""
    counts: Mapping[str, int] = getattr(device, "counts", {})
    return sum(count for kind, count in counts.items() if kind != "saturated")

"""The phase that sweeps a frequency: of the handle angle, or of the load on a handle that is held."""

import math
from collections.abc import Iterator
from functools import partial
from typing import Literal, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from tenodesis.errors import ProtocolError
from tenodesis.run import Array
from tenodesis.simulate.command import SMOOTH, Segment
from tenodesis.simulate.model import check_choice
from tenodesis.simulate.phases import Loaded, Start
from tenodesis.simulate.reach import unloaded_handle_angle
from tenodesis.units import Angle, Duration, Frequency, HandleSpeed, SignedForce

Sweep: TypeAlias = Literal["linear", "logarithmic"]

_LEAST_STEPS = 10
"""Least number of time steps per period."""


class Chirp(Loaded):
    """The handle angle, or the force, is a sine whose frequency goes from one value to another.

    The amplitude fades in over the first period of the start frequency and out over the last of the end frequency, so
    that the handle begins and ends at rest in the middle.
    """

    kind: Literal["chirp"] = "chirp"
    amplitude: Angle | None = Field(default=None, description="Amplitude of the handle angle")
    output_amplitude: Angle | None = Field(
        default=None, description="The same, as output angle without load about the straight tip"
    )
    force_amplitude: SignedForce | None = Field(
        default=None, description="Amplitude of the tangential force at the tip instead, while the handle is held"
    )
    handle_angle: Angle | None = Field(
        default=None, description="Handle angle in the middle, or held; the present angle if not given"
    )
    start_frequency: Frequency = Field(description="Frequency at the start")
    end_frequency: Frequency = Field(description="Frequency at the end")
    sweep: Sweep = Field(default="logarithmic", description="Frequency over time: linear or logarithmic")
    duration: Duration = Field(description="How long")
    speed_limit: HandleSpeed = Field(default=20.0, description="Largest handle speed; a faster chirp is an error")

    @model_validator(mode="after")
    def _check_choices(self) -> Self:
        check_choice(self, "amplitude", "output_amplitude", "force_amplitude")
        return self

    def segments(self, start: Start) -> Iterator[Segment]:
        """Yield the move to the middle, and the chirp."""
        middle = start.handle_angle if self.handle_angle is None else self.handle_angle
        angle = self._handle_amplitude(start)
        size = abs(angle)
        names = ["handle_angle", "handle_angle + amplitude", "handle_angle - amplitude"]
        for name, reached in zip(names, middle + np.array([0.0, size, -size]), strict=True):
            start.reached(name, float(reached))
        steps = start.steps(self.duration)
        self._check_rates(start, steps)
        yield from self.approached(start, middle)

        def wave(done: NDArray[np.int64]) -> Array:
            return self._wave(done / steps, steps * start.time_step)

        if self.force_amplitude is None:
            yield self.moved(start, (middle, middle), steps, lambda done: middle + angle * wave(done))
            return
        size = self.force_amplitude
        held = partial(np.full_like, fill_value=middle, dtype=np.float64)
        yield self.moved(start, (middle, middle), steps, held, lambda done: size * wave(done))

    def _handle_amplitude(self, start: Start) -> float:
        """Return the amplitude of the handle angle, rad; raises ProtocolError if no handle angle gives it."""
        if self.output_amplitude is None:
            return self.amplitude or 0.0
        return unloaded_handle_angle(start.place, "output_amplitude", self.output_amplitude)

    def cycles(self, share: Array, seconds: float) -> Array:
        """Return the periods done (n,) after shares of a duration (s); its derivative by time is the frequency."""
        first, last = self.start_frequency, self.end_frequency
        if self.sweep == "linear":
            return seconds * share * (first + (last - first) / 2 * share)
        growth = math.log(last / first)
        return seconds * first * (np.expm1(growth * share) / growth if growth else share)

    def _wave(self, share: Array, seconds: float) -> Array:
        begun = np.minimum(1.0, share * seconds * self.start_frequency)
        left = np.clip((1 - share) * seconds * self.end_frequency, 0.0, 1.0)
        return SMOOTH.way(begun) * SMOOTH.way(left) * np.sin(2 * np.pi * self.cycles(share, seconds))

    def _check_rates(self, start: Start, steps: int) -> None:
        """Check that the chirp lasts long enough, is resolved by the time step, and is not too fast for the handle."""
        most = max(self.start_frequency, self.end_frequency)
        key = "end_frequency" if self.end_frequency == most else "start_frequency"
        least = 1 / self.start_frequency + 1 / self.end_frequency
        finest = 1 / (_LEAST_STEPS * start.time_step)
        amplitude = self._handle_amplitude(start)
        speed = 2 * math.pi * most * abs(amplitude)
        if steps * start.time_step < least * (1 - 1e-9):
            raise ProtocolError(
                f"duration is {self.duration:g} s; it must be at least {least:g} s, one period of start_frequency and "
                "one of end_frequency",
                key="duration",
                value=self.duration,
                allowed=f"at least {least:g} s",
            )
        if most > finest * (1 + 1e-9):
            raise ProtocolError(
                f"{key} is {most:g} Hz; it must be at most {finest:g} Hz, {_LEAST_STEPS} time steps of "
                f"{start.time_step:g} s per period",
                key=key,
                value=most,
                allowed=f"at most {finest:g} Hz",
            )
        if speed > self.speed_limit * (1 + 1e-9):
            allowed = math.degrees(self.speed_limit / (2 * math.pi * most))
            raise ProtocolError(
                f"amplitude is {math.degrees(amplitude):.6g} deg, which at {most:g} Hz needs "
                f"{math.degrees(speed):.4g} deg/s; it must be at most {allowed:.4g} deg with a speed_limit of "
                f"{math.degrees(self.speed_limit):.4g} deg/s",
                key="amplitude",
                value=amplitude,
                allowed=f"at most {allowed:.4g} deg",
            )

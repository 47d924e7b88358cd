"""The round trip: a run of the scaled-up twin converted to real-size units, compared with the real-size twin."""

from typing import NamedTuple

import numpy as np

from tenodesis.instrument import ShortForm
from tenodesis.run import Array
from tenodesis.scaling.transfer import carry
from tenodesis.simulate import Cycles, Protocol, execute
from tenodesis.twin import TIME_STEP, Twin

SPEED = float(np.radians(40))
"""Speed of the scaled-up handle, rad/s."""


class RoundTrip(NamedTuple):
    """Output angles (rad) over the real-size handle angle (rad), each of shape (n,).

    `predicted` is by the scaled-up distal encoder, converted; `direct` is that of the real-size twin.
    """

    handle_angle: Array
    predicted: Array
    direct: Array

    @property
    def rms(self) -> float:
        """Root mean square of the difference, deg."""
        return float(np.degrees(np.sqrt(np.mean((self.predicted - self.direct) ** 2))))

    @property
    def largest(self) -> float:
        """Largest difference, deg."""
        return float(np.degrees(np.abs(self.predicted - self.direct).max()))


def round_trip(
    real_size: ShortForm, scaled_up: ShortForm, force: float, *, amplitude: float, seed: int = 0
) -> RoundTrip:
    """Run two hysteresis cycles on the scaled-up twin, convert them, and run the real-size twin directly.

    The second cycle is returned: the first one still depends on the initial state of friction. Both instruments have
    one axis and their friction. The force acts on the scaled-up tip, N; the cycle ends at an unloaded output angle of
    `amplitude` (rad) on either side. Raises NoSolutionError if a tip is loaded past what it can hold.
    """
    cycles = Cycles(output_amplitude=amplitude, symmetric=True, speed=SPEED, count=2, force=force)
    run = execute(Twin(scaled_up, seed=seed), Protocol(name="cycles", phases=(cycles,)))
    carried = carry(run, real_size, scaled_up=scaled_up).run
    time = np.arange(1, int(carried.time[-1] / TIME_STEP)) * TIME_STEP
    handle, load = (np.interp(time, carried.time, carried[name]) for name in ("commanded_handle_angle", "force"))
    direct = Twin(real_size, seed=seed).run(handle, load)["output_angle"]
    predicted = np.interp(time, carried.time, carried["measured_output_angle"])
    turns = np.flatnonzero(handle <= handle.min() + np.radians(0.1))
    kept = slice(int(turns[turns < 0.8 * time.size][-1]), None)
    return RoundTrip(handle[kept], predicted[kept], direct[kept])

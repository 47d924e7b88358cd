"""The round trip: what a scaled-up instrument does on the bench, carried back, against the real-size one's own twin."""

import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tenodesis.instrument import Instrument
from tenodesis.recording import Recording
from tenodesis.recording.session import record
from tenodesis.run import Array
from tenodesis.scaling.transfer import carry
from tenodesis.simulate import Cycles, Protocol
from tenodesis.twin import TIME_STEP, Twin

SPEED = float(np.radians(40))
"""Speed of the scaled-up handle, rad/s."""


class RoundTrip(NamedTuple):
    """Both output angles (rad) over the handle angle (rad) of the real-size instrument, row by row.

    `predicted` is the scaled-up one's distal encoder, carried over; `direct` the real-size twin's own.
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
    real_size: Instrument, scaled_up: Instrument, force: float, *, amplitude: float, seed: int = 0
) -> RoundTrip:
    """Run two hysteresis cycles on the scaled-up twin, carry the recording over, and run the real-size twin directly.

    The second cycle is returned: in the first one, what stuck before is still remembered.

    Parameters
    ----------
    real_size, scaled_up
        The real-size and the scaled-up instrument, of one axis, with their friction.
    force
        Constant force at the scaled-up tip, N.
    amplitude
        Unloaded output angle that the handle goes to, to either side, rad.
    seed
        Of the sensors' noise.

    Raises
    ------
    NoSolutionError
        A tip is loaded past what it can hold.
    """
    cycles = Cycles(output_amplitude=amplitude, symmetric=True, speed=SPEED, count=2, force=force)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scaled-up.mcap"
        record(scaled_up, Protocol(name="cycles", phases=(cycles,)), path, seed=seed)
        carried = carry(Recording.open(path), real_size).run
    time = np.arange(1, int(carried.time[-1] / TIME_STEP)) * TIME_STEP
    handle, load = (np.interp(time, carried.time, carried[name]) for name in ("commanded_handle_angle", "force"))
    direct = Twin(real_size, seed=seed).run(handle, load)["output_angle"]
    predicted = np.interp(time, carried.time, carried["measured_output_angle"])
    turns = np.flatnonzero(handle <= handle.min() + np.radians(0.1))
    kept = slice(int(turns[turns < 0.8 * time.size][-1]), None)
    return RoundTrip(handle[kept], predicted[kept], direct[kept])

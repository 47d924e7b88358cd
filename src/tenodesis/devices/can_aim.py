"""Where a drive that is told positions is to be: the speeds of its ticks, summed up."""

from tenodesis.devices.can_layout import DriveFrames

LEAD = 0.05
"""Time by whose way at full speed a motor may be behind, s: one that is held up is not to catch up at a bound."""
_TURN = 2**32
"""Counts after which a target position begins anew."""


class Aim:
    """A target position, counted on without an end.

    Parameters
    ----------
    drive
        The drive.
    position
        Where it is, counts.
    period
        Between commands, s.
    """

    def __init__(self, drive: DriveFrames, position: int, period: float) -> None:
        self._drive, self._period = drive, period
        self._counts = float(position)

    @property
    def target(self) -> int:
        """Where it is to be at the next SYNC, as the drive counts."""
        return (round(self._counts) + _TURN // 2) % _TURN - _TURN // 2

    def go_on(self, spool_velocity: float, turned: int | None) -> int:
        """Return the target a tick further on.

        Parameters
        ----------
        spool_velocity
            rad/s, finite and within the limit.
        turned
            Where the motor is, counted on without an end; None where it has not said so yet.
        """
        drive = self._drive
        self._counts += spool_velocity * self._period / drive.angle_per_count
        if turned is not None:
            lead = abs(drive.most_units * drive.speed_per_unit / drive.angle_per_count) * LEAD
            self._counts = min(max(self._counts, turned - lead), turned + lead)
        return self.target

"""What came of a run, gathered block by block: ranges, the tip's deviation, tensions, and states of a controller."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, nan, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.control import FAULTS, OperatingState, Request
from tenodesis.instrument import Instrument
from tenodesis.recording.tables import columns
from tenodesis.run import COMMANDS, CONTROL, MEASURED, Array, Run, concatenate, fault_bits
from tenodesis.statics.bends import Bends

_RANGED = ({**COMMANDS, **MEASURED, **CONTROL}.keys() | {"grip_force"}) - {
    "operating_state",
    "faults",
    "phase",
    "homing_failure",
    "request",
}
"""Signals whose ranges are shown; those of states have no meaning."""
_SLACK = 1e-6
"""Tension up to which a tendon is slack, N: the twin leaves up to 1e-9 by rounding."""


def tip_error(run: Run, inst: Instrument) -> Array:
    """Return the tip's angles less its unloaded ones (:func:`tenodesis.statics.targets`), rad, shape (n, joints).

    Those of a tool without a handle are those that were commanded under a law.

    Angles that only the encoders have are taken from there.

    Raises
    ------
    KeyError
        The run has no handle angle, or no output angle.
    """

    def angle(name: str) -> Array:
        return run.by_column(name if name in run.signals() else f"measured_{name}")

    output = angle("output_angle")
    if run.commanded_output_angle is not None:
        return output - run.by_column("commanded_output_angle")
    return output - statics.targets(inst, angle("handle_angle"))


def outcome(run: Run, inst: Instrument, names: Sequence[str] = FAULTS) -> dict[str, str]:
    """Return the outcome of a run in words: its controller's state and faults, the tip's deviation, and tensions.

    Parameters
    ----------
    run
        The run.
    inst
        The instrument that ran.
    names
        Names of the faults, in the order of their bits.
    """
    found = Outcome(inst, names)
    found.add(run)
    return found.facts()


class Outcome:
    """The outcome of a run that comes block by block; parameters as for :func:`outcome`."""

    def __init__(self, inst: Instrument, names: Sequence[str] = FAULTS) -> None:
        self._inst, self._names = inst, names
        self._steps: list[float] = []
        self._last: Run | None = None
        self._bends = Bends.of(inst.expanded)
        self._error: Array | None = None
        """At the last row, (bends,)."""
        self._worst: dict[str, tuple[float, float]] = {}
        """Largest deviation of each joint, or of the sum of a backbone's arcs, rad, and when, s."""
        self._squares: Any = 0.0
        self._enabled = 0
        self._homing = False
        self._states: dict[float, int] = {}
        self._known = 0
        self._faults: dict[str, float] = {}
        self._least: Any = np.inf
        self._most: Any = -np.inf
        self._slack: dict[str, tuple[int, float]] = {}

    def add(self, run: Run) -> None:
        """Take the next rows."""
        if not len(run):
            return
        if len(run) > 1:
            self._steps.append(float(np.median(np.diff(run.time))))
        enabled = self._add_states(run)
        signals = run.signals().keys()
        aims = {"handle_angle", "measured_handle_angle"} if self._inst.handle_joints else {"commanded_output_angle"}
        if aims & signals and {"output_angle", "measured_output_angle"} & signals:
            self._add_error(run, self._bends.summed(tip_error(run, self._inst)), enabled)
        self._add_tensions(run)
        # a view would hold all of the block
        self._last = concatenate([run.rows(-1)])

    def facts(self) -> dict[str, str]:
        """Return the outcome in words, by what is said."""
        run = self._last
        if run is None:
            return {}
        if run.operating_state is None or run.faults is None:
            return ({} if self._error is None else {"tip": self._deviation(self._error)}) | self._tensions(run)
        faults = sorted((time, list(self._names).index(name), name) for name, time in self._faults.items())
        facts = {
            "state": self._state(float(run.by_column("operating_state")[0, 0])),
            "faults": ", ".join(f"{name} from {time:.6g} s" for time, _, name in faults) or "none",
        }
        if self._error is not None:
            facts["tip"] = self._tip(self._error)
        return facts | _tip_force(run) | self._tensions(run)

    @property
    def _step(self) -> float:
        return float(np.median(self._steps)) if self._steps else 0.0

    def _add_states(self, run: Run) -> NDArray[np.bool_] | None:
        """Count states and faults; return the rows (n,) in which the controller was enabled, other than to home."""
        if run.operating_state is None or run.faults is None:
            return None
        state = run.by_column("operating_state")[:, 0]
        known = state[~np.isnan(state)]
        self._known += known.size
        for value in dict.fromkeys(known.tolist()):
            self._states[value] = self._states.get(value, 0) + int(np.count_nonzero(known == value))
        masks = fault_bits(run.faults)
        if masks.any():
            for bit, name in enumerate(self._names):
                rows = np.flatnonzero(masks >> bit & 1)
                if rows.size:
                    self._faults.setdefault(name, float(run.time[rows[0]]))
        enabled: NDArray[np.bool_] = state == OperatingState.ENABLED
        begins = [-1] * self._homing
        if run.request is not None:
            begins += np.flatnonzero(run.by_column("request")[:, 0] == Request.HOME).tolist()
        self._homing = False
        for row in begins:
            rest = np.flatnonzero(~enabled[row + 1 :])
            enabled[max(row, 0) : row + 1 + int(rest[0]) if rest.size else None] = False
            self._homing = self._homing or not rest.size
        return enabled

    def _add_error(self, run: Run, error: Array, enabled: NDArray[np.bool_] | None) -> None:
        self._error = error[-1].copy()
        if enabled is not None:
            self._squares = self._squares + (error[enabled] ** 2).sum(axis=0)
            self._enabled += int(enabled.sum())
        for name, off in zip(self._bends.names, error.T, strict=True):
            if not np.isnan(off).all():
                row = int(np.nanargmax(np.abs(off)))
                if abs(off[row]) > abs(self._worst.get(name, (0.0, nan))[0]) or name not in self._worst:
                    self._worst[name] = (float(off[row]), float(run.time[row]))

    def _add_tensions(self, run: Run) -> None:
        tension = run.measured_tension if run.tension is None else run.tension
        if tension is None:
            return
        self._least = np.fmin(self._least, np.fmin.reduce(tension, axis=0))
        self._most = np.fmax(self._most, np.fmax.reduce(tension, axis=0))
        if run.distal_tension is not None:
            for name, loose in zip(run.tendons, run.distal_tension.T <= _SLACK, strict=True):
                if loose.any():
                    count, first = self._slack.get(name, (0, float(run.time[loose.argmax()])))
                    self._slack[name] = (count + int(np.count_nonzero(loose)), first)

    def _deviation(self, error: Array) -> str:
        joints = self._bends.names
        end = dict(zip(joints, error.tolist(), strict=True))
        return "; ".join(
            f"{name} {_signed(off)} off the unloaded angle at most, at {time:.4g} s, {_signed(end[name])} at the end"
            for name, (off, time) in sorted(self._worst.items(), key=lambda one: joints.index(one[0]))
        )

    def _tip(self, error: Array) -> str:
        parts = []
        for name, off, squares in zip(
            self._bends.names, error, np.broadcast_to(self._squares, error.shape), strict=True
        ):
            rms = f", {degrees(sqrt(squares / self._enabled)):.2f} deg RMS while enabled" if self._enabled else ""
            parts.append(f"{name} {_signed(off)} off the unloaded angle at the end{rms}")
        return "; ".join(parts)

    def _tensions(self, run: Run) -> dict[str, str]:
        """Return the ranges of the tensions beside the spools, and for how long tendons were slack at the tip."""
        if run.measured_tension is None and run.tension is None:
            return {}
        ends = zip(run.tendons, np.atleast_1d(self._least), np.atleast_1d(self._most), strict=True)
        facts = {"tensions": ", ".join(f"{name} {least:.3g} to {most:.3g} N" for name, least, most in ends)}
        if run.distal_tension is not None:
            slack = [
                f"{name} for {count * self._step:.3g} s, first at {first:.4g} s"
                for name, (count, first) in sorted(self._slack.items(), key=lambda one: run.tendons.index(one[0]))
            ]
            facts["slack"] = ", ".join(slack) or "no tendon"
        return facts

    def _state(self, last: float) -> str:
        """Return the state at the end and how long each state lasted, in order of their first rows."""
        lasted = ", ".join(f"{_state_name(value)} {count * self._step:.3g} s" for value, count in self._states.items())
        end = _state_name(last) if self._known else "not running"
        return f"{end} at the end" + (f" ({lasted})" if len(self._states) > 1 else "")


@dataclass
class Facts:
    """What is said about a recording's rows."""

    rows: int
    first: float
    """Time of the first row, s."""
    last: float
    step: float
    """Median time between two rows, s."""
    ranges: dict[str, tuple[float, float] | None]
    """Least and greatest value of each column by its heading in SI units, None without one."""
    outcome: dict[str, str]
    rises: dict[str, tuple[float, int]]
    """When each fault came first, s, and how often it came."""


class Seen(Facts):
    """What is said about a recording's rows, gathered block by block.

    Parameters
    ----------
    inst
        The instrument that ran, None if it is not known.
    names
        Names of the faults, in the order of their bits.
    """

    def __init__(self, inst: Instrument | None = None, names: Sequence[str] = FAULTS) -> None:
        self._outcome = None if inst is None else Outcome(inst, names)
        self._bits = 0
        self._steps: list[float] = []
        super().__init__(rows=0, first=0.0, last=0.0, step=nan, ranges={}, outcome={}, rises={})

    def add(self, run: Run) -> None:
        """Take the next rows."""
        if not len(run):
            return
        self.first = self.first if self.rows else float(run.time[0])
        self.last = float(run.time[-1])
        self.rows += len(run)
        if len(run) > 1:
            self._steps.append(float(np.median(np.diff(run.time))))
        for heading, values in columns(run).items():
            if heading.partition(" [")[0].partition(".")[0] in _RANGED:
                least, most = float(np.fmin.reduce(values)), float(np.fmax.reduce(values))
                before = self.ranges.setdefault(heading, None)
                if not np.isnan(least):
                    self.ranges[heading] = (
                        (least, most) if before is None else (min(before[0], least), max(before[1], most))
                    )
        if run.faults is not None:
            self._add_faults(run)
        if self._outcome is not None:
            self._outcome.add(run)

    def done(self) -> Facts:
        """Return it, with what only the end tells."""
        self.step = float(np.median(self._steps)) if self._steps else nan
        self.outcome = {} if self._outcome is None else self._outcome.facts()
        return self

    def _add_faults(self, run: Run) -> None:
        masks = fault_bits(run["faults"])
        if self._bits or masks.any():
            for bit, name in enumerate(FAULTS):
                rises = np.flatnonzero(np.diff(masks >> bit & 1, prepend=self._bits >> bit & 1) == 1)
                if rises.size:
                    time, count = self.rises.get(name, (float(run.time[rises[0]]), 0))
                    self.rises[name] = (time, count + rises.size)
        self._bits = int(masks[-1])


def _tip_force(run: Run) -> dict[str, str]:
    """Return the observer's last force at the tip; empty where it knows no deviation of it."""
    if run.estimated_force is None or run.estimated_force_std is None:
        return {}
    forces = (run.by_column(name)[-1] for name in ("estimated_force", "estimated_force_std"))
    last = zip(run.compensated, *forces, strict=True)
    parts = [f"{name} {force:+.2f} ± {2 * std:.2f} N" for name, force, std in last if np.isfinite(std)]
    return {"tip force": f"{', '.join(parts)} at the end, by the observer (two standard deviations)"} if parts else {}


def _state_name(state: float) -> str:
    return OperatingState(int(state)).name if state in set(OperatingState) else f"state {state:g}"


def _signed(angle: float) -> str:
    """Return an angle (rad) in deg with its sign, none where it rounds to nothing."""
    rounded = round(degrees(angle), 2)
    return f"{rounded:+.2f} deg" if rounded else "0.00 deg"

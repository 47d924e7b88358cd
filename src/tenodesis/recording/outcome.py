"""What came of a run with a controller, in words."""

from collections.abc import Sequence
from math import degrees

import numpy as np
from numpy.typing import NDArray

from tenodesis import statics
from tenodesis.control import FAULTS, OperatingState, Request
from tenodesis.instrument import Instrument
from tenodesis.run import Array, Run


def tip_error(run: Run, inst: Instrument) -> Array:
    """Return by how much the tip is off where eq. 18 has it without load and friction, rad, by row and axis.

    Of angles that the twin did not tell, those of the encoders are taken.

    Raises
    ------
    KeyError
        The run has no handle angle, or no output angle.
    """
    rows = (len(run), len(run.axes))
    handle, output = (
        (run[name] if name in run.signals() else run[f"measured_{name}"]).reshape(rows)
        for name in ("handle_angle", "output_angle")
    )
    error = np.empty(rows)
    for n, name in enumerate(run.axes):
        alone = inst.axis(name) if len(inst.axes) > 1 else inst
        within = np.clip(handle[:, n], -alone.handle_range, alone.handle_range)
        # Eq. 19 with equal tensions.
        aim = statics.estimate_output_angle(alone, within, alone.pretension, alone.pretension)
        error[:, n] = output[:, n] - aim
    return error


def outcome(run: Run, inst: Instrument, names: Sequence[str] = FAULTS) -> dict[str, str]:
    """Return facts about a run by what they are about, none if it had no controller.

    Parameters
    ----------
    run
        The run.
    inst
        The instrument that ran.
    names
        Of the faults, in the order of their bits.
    """
    if run.operating_state is None or run.faults is None or not len(run):
        return {}
    state = run.operating_state.reshape(len(run), -1)[:, 0]
    facts = {"state": _states(state, run.time), "faults": _faults(run.faults, run.time, names)}
    there = run.signals().keys()
    if {"handle_angle", "measured_handle_angle"} & there and {"output_angle", "measured_output_angle"} & there:
        facts["tip"] = _tip(run, tip_error(run, inst), _compensating(run, state))
    return facts


def _compensating(run: Run, state: Array) -> NDArray[np.bool_]:
    """Return the rows in which it was enabled, other than to home."""
    enabled: NDArray[np.bool_] = state == OperatingState.ENABLED
    if run.request is not None:
        for row in np.flatnonzero(run.request.reshape(len(run), -1)[:, 0] == Request.HOME):
            rest = np.flatnonzero(~enabled[row + 1 :])
            enabled[row : row + 1 + rest[0] if rest.size else None] = False
    return enabled


def _tip(run: Run, error: Array, during: NDArray[np.bool_]) -> str:
    parts = []
    for name, off in zip(run.axes, error.T, strict=True):
        rms = f", {degrees(np.sqrt(np.mean(off[during] ** 2))):.2f} deg RMS while enabled" if during.any() else ""
        parts.append(f"{name} {degrees(off[-1]):+.2f} deg off eq. 18 at the end{rms}")
    return "; ".join(parts)


def _states(state: Array, time: Array) -> str:
    """Say which state it ended in, and how long each lasted, in the order in which they came."""
    step = float(np.median(np.diff(time))) if time.size > 1 else 0.0
    known = state[~np.isnan(state)]
    seen = dict.fromkeys(known.tolist())
    lasted = ", ".join(f"{_name(one)} {np.count_nonzero(known == one) * step:.3g} s" for one in seen)
    end = _name(state[-1]) if known.size else "not running"
    return f"{end} at the end" + (f" ({lasted})" if len(seen) > 1 else "")


def _name(state: float) -> str:
    return OperatingState(int(state)).name if state in set(OperatingState) else f"state {state:g}"


def _faults(faults: Array, time: Array, names: Sequence[str]) -> str:
    """Say which faults there were, and when each came first."""
    masks = np.bitwise_or.reduce(np.nan_to_num(faults).astype(np.int64).reshape(time.size, -1), axis=1)
    found = {name: np.flatnonzero(masks >> bit & 1) for bit, name in enumerate(names)}
    first = sorted((int(rows[0]), name) for name, rows in found.items() if rows.size)
    return ", ".join(f"{name} from {time[row]:.6g} s" for row, name in first) or "none"

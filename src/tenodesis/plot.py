"""The curves of the report as matplotlib figures: of an instrument's statics and routing, and of runs.

Every function returns a figure in the report's style, which notebooks show and ``savefig`` writes. Instruments are
given as such, by name or by path; of two axes, the first is drawn. Forces are tangential at the tip, in N; by default
those of the instrument's conditions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from tenodesis import statics
from tenodesis.errors import ArgumentError
from tenodesis.instrument import InstrumentLike, ShortForm, as_short_form, expanded
from tenodesis.report import curves, space, style
from tenodesis.report import routing as routes
from tenodesis.report.content import Chart
from tenodesis.report.curves import Loop, SteppedCurve
from tenodesis.run import Run

__all__ = [
    "hysteresis",
    "input_output",
    "loss",
    "posture",
    "routing",
    "run",
    "step_response",
    "tension",
    "transmissibility",
]

_MOST_POINTS = 20_000


def input_output(inst: InstrumentLike, forces: Sequence[float] | None = None) -> Figure:
    """Draw the output angle over the handle angle, and where the antagonist goes slack (Fig. 7)."""
    inst = _planar(inst)
    with style.applied():
        return curves.input_output(inst, _loads(inst, forces)).figure


def loss(inst: InstrumentLike, forces: Sequence[float] | None = None) -> Figure:
    """Draw the loss of output angle over the unloaded output angle, by the full model and by eq. 17 (Fig. 11)."""
    inst = _planar(inst)
    with style.applied():
        chart, (axis,) = Chart.panels()
        curves.draw_losses(chart, axis, inst, [force for force in _loads(inst, forces) if force])
        return chart.figure


def tension(inst: InstrumentLike, forces: Sequence[float] | None = None) -> Figure:
    """Draw how both tendons' tension varies over the output angle (Fig. 8)."""
    inst = _planar(inst)
    with style.applied():
        return curves.tension(inst, [force for force in _loads(inst, forces) if force]).figure


def transmissibility(inst: InstrumentLike, forces: Sequence[float] | None = None) -> Figure:
    """Draw the torque transmissibility over the output angle (Fig. 9)."""
    inst = _planar(inst)
    with style.applied():
        return curves.transmissibility(inst, _loads(inst, forces)).figure


def hysteresis(run: Run, inst: InstrumentLike) -> Figure:
    """Draw a run's output angle over its handle angle, beside the theory without friction and eq. 19 (Fig. 14).

    Raises KeyError if the run has no measured angles and tensions.
    """
    inst, run = _planar(inst), run.axis(run.axes[0])
    largest = run["force"][int(np.argmax(np.abs(run["force"])))]
    heading = curves.load_name(float(largest)) if np.ptp(run["force"]) == 0 else f"up to {largest:.3g} N"
    run = run[:: max(1, len(run) // _MOST_POINTS)]
    with style.applied():
        return curves.hysteresis(inst, [Loop(heading, run, curves.estimated_output_angle(inst, run))]).figure


def step_response(run: Run, inst: InstrumentLike) -> Figure:
    """Draw output angle and agonist tension of a run around the first change of its load (Fig. 15).

    Raises
    ------
    ArgumentError
        The load does not change.
    KeyError
        The run has no output angle, or no measured tensions.
    """
    inst, run = _planar(inst), run.axis(run.axes[0])
    changed = np.flatnonzero(np.diff(run["force"]))
    if not changed.size:
        raise ArgumentError("run has a constant force; it must have a load that comes.", key="run")
    first = int(changed[0]) + 1
    run = run.rows(0, _end_of_load(run, first))
    handle = run["measured_handle_angle" if run.handle_angle is None else "handle_angle"][first]
    held = np.clip([handle], -inst.handle_range, inst.handle_range)
    theory = float(np.asarray(statics.output_angle(inst, held, float(run["force"][-1])))[0])
    heading = f"{round(float(np.degrees(curves.output_of(run)[first - 1])), 1) + 0.0:g} deg"
    with style.applied():
        return curves.step_response([SteppedCurve(heading, run, float(run.time[first]), theory)]).figure


def run(run: Run, signals: Sequence[str] = ()) -> Figure:
    """Draw signals of a run over time, a panel each: those named, or angles, tensions and loads.

    Each has a curve per joint, tendon or component; ``tension.jaw_1`` is one of them. Raises KeyError if a signal is
    unknown or was not recorded.
    """
    with style.applied():
        return curves.signals(run, signals).figure


def routing(inst: InstrumentLike) -> Figure:
    """Draw the tendons' routes over the joints, unrolled from handle to tip, and the moment arms as a table."""
    return routes.draw(expanded(inst))


def posture(inst: InstrumentLike, angles: ArrayLike = 0.0, handle_angles: ArrayLike = 0.0) -> Figure:
    """Draw an instrument in space, its tip and its handle, with all joints at angles (rad, each end's joints).

    Raises ArgumentError if an angle is not finite, or half a turn or more, or their number is not that of the joints.
    """
    return space.draw(expanded(inst), angles, handle_angles)


def _end_of_load(run: Run, first: int) -> int:
    """Return the row at which the load that comes at a row is taken off, or the handle moves."""
    for name in ("force", "commanded_handle_angle"):
        if name not in run.signals():
            continue
        rate = np.diff(run[name][first:])
        resting = int(np.argmax(rate == 0)) if name == "force" else 0
        moving = np.flatnonzero(rate[resting:])
        if moving.size:
            run = run.rows(0, first + resting + int(moving[0]) + 1)
    return len(run)


def _planar(inst: InstrumentLike) -> ShortForm:
    return as_short_form(inst).planar[0]


def _loads(inst: ShortForm, forces: Sequence[float] | None) -> list[float]:
    return curves.forces(inst) if forces is None else [float(force) for force in forces]


def __dir__() -> list[str]:
    return sorted(__all__)

"""A load that comes suddenly on the held, bent instrument, on the twin: what every joint loses."""

from typing import NamedTuple

import numpy as np

from tenodesis import simulate
from tenodesis.control import Controller
from tenodesis.instrument import FullForm
from tenodesis.paper.any_instrument.cycles import target
from tenodesis.paper.any_instrument.held import Load, State, described, legend, loads, looks, panels, states
from tenodesis.paper.any_instrument.motions import moved
from tenodesis.paper.context import Context, RecordedRun, has_friction
from tenodesis.report import style
from tenodesis.report.content import Array, Column, Plot, Section, named
from tenodesis.run import Run

APPROACH, BEFORE, AFTER = 3.0, 1.0, 3.0
"""Time in which the state is reached, rest before the load, and time under it, s."""
RISE = 0.05
"""Time in which the load comes, s."""
SEED = 15

_EVERY = 10  # samples that are drawn
_BEFORE_STEP = 0.5
"""Time that is shown before the load, s."""
_AVERAGED = 0.2  # s


class Response(NamedTuple):
    """A run with a step load, and what it took from every joint, (joints,), rad."""

    load: Load
    recorded: RecordedRun
    run: Run
    """From shortly before the load on, thinned"""
    before: Array
    """Angles before the load"""
    lost: Array
    """Angles before the load, less those at the end"""
    expected: Array
    """The same by statics without friction"""


def protocol(inst: FullForm, state: State, load: Load, after: float = AFTER) -> simulate.Protocol:
    """Return the protocol: to a state by handle and motors, and a load that comes and stays for a time (s)."""
    phases = [
        *moved(inst, state.handle, state.strokes, APPROACH),
        simulate.Hold(duration=BEFORE),
        simulate.StepLoad(rise=RISE, duration=after, **load.keys()),
    ]
    return simulate.Protocol(
        name=f"step load {load.name}", description=f"{load.text()} on the bent instrument", phases=phases
    )


def respond(
    inst: FullForm, state: State, load: Load, *, controller: Controller | None = None, after: float = AFTER
) -> Response | None:
    """Run a step load on the twin; None if the joints cannot hold it."""
    recorded = RecordedRun.of(inst, protocol(inst, state, load, after), SEED, controller)
    if recorded is None:
        return None
    run = recorded.run
    came = int(np.argmax((run["wrench"] != 0).any(axis=1) | (run["applied_grip_force"] != 0)))
    held = run.rows(came - 1, came)
    before, after_load = held.by_column("output_angle")[0], run.rows(-1).by_column("output_angle")[0]
    free, loaded = target(inst, held)[0], target(inst, held, load.wrench, load.grip)[0]
    first = int(np.searchsorted(run.time, run.time[came] - _BEFORE_STEP))
    shown = run.rows(first, None, _EVERY)
    return Response(load, recorded, shown, before, before - after_load, free - loaded)


def section(context: Context) -> Section:
    """Compute the step loads in the directions that matter on the bent instrument."""
    inst = context.whole
    state = states(inst)[-1]
    found = [done for done in (respond(inst, state, load) for load in loads(inst)) if done is not None]
    title = "A sudden load on the held instrument"
    if not found:
        return Section("step_load", title, f"<p>Not run: {named(inst)} holds none of the loads on the twin.</p>")
    context.recordings |= {f"step_load_{done.load.name}": done.recorded for done in found}
    table = context.table(
        "Angle that the load takes from each joint on the twin, and by statics without friction",
        "load",
        *(
            each
            for joint in inst.tip_joints
            for each in (
                Column(
                    f"{joint.name} [°]",
                    f"step_load.lost.{joint.name}.{{load}}",
                    "deg",
                    f"Angle that a step load of {{words}} takes from {joint.name} on the twin",
                ),
                f"{joint.name}, statics [°]",
            )
        ),
    )
    for done in found:
        angles = np.degrees(np.column_stack([done.lost, done.expected])).ravel()
        table.row(done.load.text(), *map(float, angles), load=done.load.name, words=done.load.text())
    text = (
        f"<p>Handle and motors bring the tip to {described(inst, state)} and hold it there; then the load comes in "
        f"{1e3 * RISE:.0f} ms and stays."
    )
    if has_friction(inst):
        text += (
            " With friction a joint may lose less than without: it was held back already, or it does not give way "
            "until its tendons slip."
        )
    return Section("step_load", title, text + "</p>", [_plot(context, found)], [table])


def _plot(context: Context, found: list[Response]) -> Plot:
    inst = context.whole
    chart, axes = panels(len(found), 2.6, 3.5)
    for axis, done in zip(axes, found, strict=True):
        time = chart.keep(f"time, {done.load.name} [s]", done.run.time - done.run.time[0] - _BEFORE_STEP)
        after = time >= 0
        for n, (name, look) in enumerate(looks(inst).items()):
            change = np.degrees(done.run.by_column("output_angle")[:, n] - done.before[n])
            chart.curve(axis, time, f"{name}, {done.load.name} [deg]", change, **look)
            axis.plot(
                time[after], np.full(after.sum(), -np.degrees(done.expected[n])), ":", color=look["color"], lw=1.1
            )
        axis.set(title=done.load.text(), xlabel="time [s]", xlim=(time[0], time[-1]))
    axes[0].set_ylabel("change of angle [deg]")
    style.legend_outside(chart.figure, *legend(inst), ("statics, no friction", style.MUTED, ":"))
    return chart.plot("step_load", f"Change of every joint's angle when a load comes, {named(inst)} on the twin.")
